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
from rbd.simulation.recording import point_forces, points_and_rows

_NONE = ContactTouch(zeros(0), np.zeros(0, bool), np.zeros((0, 3)))


def touches_of(now: Instant, constraints: Sequence[Constraint], sources: Sequence[Source]) -> dict[str, ContactTouch]:
    """{contact: its points} at the beginning of a time step.

    Args:
        now: The beginning of the step.
        constraints: All of the motion; those that never have points are left out.
        sources: The sources of their points, in the order of the layout.
    """
    at, touching = now.at, now.touching
    out = {c.name: _NONE for c in constraints if callable(member(c, "points"))}  # also where no point is near now
    for source, measured, (points, rows) in zip(sources, at.places, at.layout.spans, strict=True):
        if measured.points is None or measured.axes is None:
            continue
        gaps, touches, force = at.gap[points].copy(), touching[points].copy(), now.force[rows]
        for owner, mine, row in points_and_rows(measured.structure):
            pushed = point_forces(measured, force[row], mine)
            if pushed is None:
                pushed = np.zeros((mine.stop - mine.start, 3))
            out[owner] = ContactTouch(gaps[mine], touches[mine], pushed, _labels(source, measured.structure, mine))
    return {c.name: out[c.name] for c in constraints if c.name in out}


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
        k = len(r.patch.corners)
        pushed = acting[r.name].point_forces if r.name in acting else None
        out[r.name] = ContactTouch(np.full(k, ALWAYS), np.ones(k, bool), np.zeros((k, 3)) if pushed is None else pushed)
    return out


def _labels(source: Source, structure: Structure, points: slice) -> tuple[str, ...]:
    """What a source calls these of its points; empty if they are only numbered."""
    label = getattr(source, "label", None)
    return () if label is None else tuple(label(number) for number in structure.numbers[points])
