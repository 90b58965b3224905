"""Footprints: where the soles of a robot that walks stood, on the ground of its motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array
from rbd.visual.style import contact_colors

if TYPE_CHECKING:
    from rbd.simulation.trajectory import Trajectory

APART = 0.1
"""Footprints nearer to the one before than this share of their size are the same: a foot that was lifted for an instant."""


@dataclass(frozen=True, eq=False)
class Footprints:
    """The outlines of a contact where it stood.

    Attributes:
        name: Of the contact.
        color: The contact's.
        outlines: Corners in W, in order around each outline, shape (n, k, 3) [m].
    """

    name: str
    color: str
    outlines: Array


def footprints_of(trajectory: Trajectory) -> list[Footprints]:
    """Of each contact of three points or more, the places where all its points carried load; none if it stood in one place.

    A contact that slides leaves one footprint, where it stands best: where its least loaded point carries most.
    """
    found = []
    for name, color in contact_colors(trajectory.points).items():
        points = np.asarray(trajectory.points[name])
        if points.shape[1] < 3:  # points and edges leave no print
            continue
        load = np.linalg.norm(trajectory.point_forces[name], axis=-1).min(axis=-1, initial=np.inf)
        load = np.where(np.isfinite(points).all(axis=(1, 2)), np.nan_to_num(load, posinf=0.0), 0.0)
        there = np.concatenate([[False], np.asarray(trajectory.modes[name]) != "open", [False]])
        edges = np.flatnonzero(there[1:] != there[:-1]).reshape(-1, 2).tolist()
        best = [first + int(load[first:end].argmax()) for first, end in edges]
        places: list[Array] = []
        for outline in (points[i] for i in best if load[i] > 0.0):
            if not places or _distance(places[-1], outline) > APART:
                places.append(outline)
        if len(places) > 1:
            found.append(Footprints(name, color, np.array(places)))
    return found


def _distance(one: Array, other: Array) -> float:
    """How far two outlines are from each other, in sizes of the first."""
    return float(np.linalg.norm(other - one, axis=1).max() / np.ptp(one, axis=0).max())
