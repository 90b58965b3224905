"""The card of a scene: what it shows in words, the page itself, and the forces as a table, folded."""

from __future__ import annotations

from collections import Counter

import numpy as np

from rbd.visual.name_lists import joined
from rbd.visual.notebook.card import Card, Fold, Table
from rbd.visual.notebook.frames import scene_frame
from rbd.visual.notebook.registry import card_of
from rbd.visual.notebook.values import fixed, number, vector
from rbd.visual.scene import Scene


@card_of.register
def _scene(record: Scene) -> Card:
    name = record.robot.name
    if not record.shown:
        return Card(f"{name}: the scene is empty; call scene.show(state, solution) first")
    contacts = record.contacts
    upward = sum(float(c.force[2]) for c in contacts)
    who = "1 contact pushes" if len(contacts) == 1 else f"{len(contacts)} contacts push"
    carries = f"{who} it up by {fixed(upward, 2)} N" if contacts else "no contact forces are shown"
    rows = [(c.name, vector(c.force, 2), fixed(float(np.linalg.norm(c.force)), 2)) for c in contacts]
    forces = Table(rows, ("contact", "force on the robot, in W [N]", "|f| [N]"))
    layers = Counter(mark.layer for mark in record.drawn)
    drawn = joined(f"{n} of {layer}" for layer, n in layers.items())
    scale = [("length of an arrow", f"{number(1e3 * record.metres_per_newton, 3)}", "mm/N"), ("marks", drawn, "")]
    return Card(f"{name}: {carries}", None, (), (), [Fold("Forces", [forces, Table(scale)])], scene_frame(record))
