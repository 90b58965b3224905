"""What touches at the beginning of a step, for controllers: gaps, points in contact, and the forces of the step before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rbd.arrays import zeros
from rbd.constraints.constraint import Constraint, member
from rbd.constraints.contact_points import ALWAYS, Source, Structure
from rbd.control.accepted_steps import ContactTouch
from rbd.problem.rows import Rows
from rbd.simulation.instant import Instant
from rbd.simulation.motion import ConstraintForce
from rbd.simulation.recording import constraint_forces, points_and_rows

_NONE = ContactTouch(zeros(0), np.zeros(0, bool), np.zeros((0, 3)))


def touches_of(now: Instant, constraints: Sequence[Constraint], sources: Sequence[Source]) -> dict[str, ContactTouch]:
    """{contact: its points} at the beginning of a time step.

    Args:
        now: The beginning of the step.
        constraints: All of the motion; those that never have points are left out.
        sources: The sources of their points, in the order of the layout.
    """
    at, touching, layout = now.at, now.touching, now.at.layout
    names = tuple(c.name for c in constraints)
    acting = constraint_forces(at, now.force, np.zeros(len(at.gap)), names)
    out = {c.name: _NONE for c in constraints if callable(member(c, "points"))}  # also where no point is near now
    for source, structure, (points, _) in zip(sources, layout.structures, layout.spans, strict=True):
        for owner, mine, _ in points_and_rows(structure):
            k = slice(points.start + mine.start, points.start + mine.stop)
            force = _forces(acting[owner], len(at.gap[k]))
            if force is not None:
                out[owner] = ContactTouch(at.gap[k].copy(), touching[k].copy(), force, _labels(source, structure, mine))
    return {name: out[name] for name in names if name in out}


def held_touches(rows: Sequence[Rows], acting: Mapping[str, ConstraintForce]) -> dict[str, ContactTouch]:
    """{contact: its points} of bilateral constraints in smooth motion: all touch.

    Args:
        rows: Their rows.
        acting: Their forces under the torques of the step before; none in the first.
    """
    out = {}
    for r in rows:
        if r.patch is None or r.resultant is None:
            continue
        k, x = len(r.patch.corners), acting.get(r.name)
        force = None if x is None else _forces(x, k)
        out[r.name] = ContactTouch(np.full(k, ALWAYS), np.ones(k, bool), np.zeros((k, 3)) if force is None else force)
    return out


def _forces(acting: ConstraintForce, k: int) -> np.ndarray | None:
    """Forces at a contact's k points, shape (k, 3); None where it has no points."""
    if acting.points is None:
        return None
    return np.zeros((k, 3)) if acting.point_forces is None else np.array(acting.point_forces)


def _labels(source: Source, structure: Structure, points: slice) -> tuple[str, ...]:
    """What a source calls these of its points; empty if they are only numbered."""
    label = getattr(source, "label", None)
    return () if label is None else tuple(label(number) for number in structure.numbers[points])
