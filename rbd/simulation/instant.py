"""Records of a time step, which are handed from step to step: its start, the result; and what controllers see of contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, lazy, zeros
from rbd.constraints.constraint import Constraint, member
from rbd.constraints.contact_points import ALWAYS, PointSource, Structure
from rbd.control.schedules import ContactTouch
from rbd.model.external import ForceElement
from rbd.model.state import State
from rbd.problem.rows import Rows
from rbd.simulation.contact_gaps import GapTolerances
from rbd.simulation.event_detection import ImpactRecord, StepRecord
from rbd.simulation.implicit_forces import ElementTerms
from rbd.simulation.recording import point_forces, points_and_rows
from rbd.simulation.simulated_motion import ConstraintForce
from rbd.simulation.stacked_points import PointLayout, PointMatching, Snapshot
from rbd.simulation.velocity_problem import VelocityAnswer


class Passed(list[StepRecord | ImpactRecord]):
    """Steps and impacts, in order of time.

    Attributes:
        touches: Those of the impacts in which points arrive.
    """

    def __init__(self) -> None:
        self.touches: list[Touch] = []

    def until(self, touch: Touch) -> Passed:
        """Those until a touch."""
        out = Passed()
        out.extend(self[: touch.passed])
        return out


class PreviousStep(NamedTuple):
    """The step before: points at its beginning, active ones, length, impulses, and whether force elements acted."""

    at: Snapshot
    active: Array
    h: float
    impulse: Array
    elements: bool = False


@dataclass(frozen=True, eq=False)
class Instant:
    """The beginning of a step, with data from earlier steps.

    Attributes:
        t: Time [s].
        at: State and contact points.
        gaps: Tolerances of the points' gaps.
        closed: Which points were in contact in the step before, shape (k,).
        leaves: Which points touch and separate, after an impact or at the start: inactive in this step, shape (k,).
        force: Row forces to start from, shape (p,).
        norms: Norms of bilateral rows; see `VelocityAnswer`.
        velocity: The points' velocities by the contact law of the step before, shape (p,); None: J v.
        previous: The step before; None where contact or friction has changed.
        work: Work of the motors since the start of the motion [J].
        dissipated: Work that force elements have taken out of the motion since its start [J].
        other_work: Work of pushes, friction, impacts and moving ground since then [J]; see `Sample`.
    """

    t: float
    at: Snapshot
    gaps: GapTolerances
    closed: Array
    leaves: Array
    force: Array
    norms: Array | None = None
    velocity: Array | None = None
    previous: PreviousStep | None = None
    work: float = 0.0
    dissipated: float = 0.0
    other_work: float = 0.0

    @lazy
    def touching(self) -> Array:
        """Which points are in contact, shape (k,): those without a gap, and closed ones with a small gap.

        Not those that leave after an impact: the step would hold down points that approach again by its end.
        """
        gap, gaps, layout = self.at.gap, self.gaps, self.at.layout
        if self.closed is layout.everything and self.leaves is layout.nothing and self.at.extremes[1] <= gaps.least_loose:
            return self.closed
        touching: Array = ((gap <= gaps.tight) | (self.closed & (gap <= gaps.loose))) & ~self.leaves
        return layout.everything if touching.all() else touching

    def rates(self, active: Array) -> Array:
        """Velocities of the points, shape (p,): for active ones by the law of the step before.

        By that law closed points are at rest; J v is zero only to O(h^2), an error O(h) of the force over half a step.
        """
        at, known = self.at, self.velocity
        if known is None:
            return at.velocity
        return known if active is at.layout.everything else np.where(np.repeat(active, at.layout.widths), known, at.velocity)

    def change(self, h: float) -> Array | None:
        """Change of the points' velocities in a time h, extrapolated from the step before; None if unknown."""
        before = self.previous
        if before is None or before.at.layout is not self.at.layout:
            return None
        return (self.at.velocity - before.at.velocity) * (h / before.h)


class HalfStep(NamedTuple):
    """The first half of a step.

    Attributes:
        start: The beginning of the step.
        active: Which of its points are active.
        tau: Motor torques; None where the half step was extrapolated.
        answer: Velocity and impulses.
        h: Length of the whole step [s].
        u: The points' velocities at its beginning.
        turned: Velocity to which h/2 a was added.
        applied: S^T tau + tau_ext; None where the half step was extrapolated.
        elements: Force elements that act.
        implicit: What they were taken implicitly with; None where there are none, or where their true forces were taken.
    """

    start: Instant
    active: Array
    tau: Array | None
    answer: VelocityAnswer
    h: float
    u: Array
    turned: Array
    applied: Array | None = None
    elements: tuple[ForceElement, ...] = ()
    implicit: ElementTerms | None = None

    @property
    def a(self) -> Array:
        """Acceleration in it, of a floating base in the base's axes, shape (nv,)."""
        return (self.answer.v - self.turned) * (2.0 / self.h)

    def active_in(self, layout: PointLayout) -> Array:
        """Which points of another layout are active, shape (k,)."""
        at = self.start.at
        return self.active if layout is at.layout else PointMatching(at.layout, layout).points(self.active, False)

    def points_in(self, layout: PointLayout) -> tuple[Array, Array, Array, VelocityAnswer]:
        """Which points of another layout are active, their velocities and position errors, and the answer for them."""
        at = self.start.at
        if layout is at.layout:
            return self.active, self.u, at.error, self.answer
        match, answer = PointMatching(at.layout, layout), self.answer
        answer = answer._replace(impulse=match.rows(answer.impulse), velocity=match.rows(answer.velocity), norms=None)
        return match.points(self.active, False), match.rows(self.u), match.rows(at.error), answer


class WholeStep(NamedTuple):
    """A step before positions are corrected: its length, its end, its answer, the points and the torques in its middle.

    And the work in it that force elements take out of the motion, and that of pushes, friction and moving ground [J].
    """

    h: float
    end: Snapshot
    answer: VelocityAnswer
    layout: PointLayout
    tau: Array
    dissipated: float = 0.0
    other_work: float = 0.0


class Touch(NamedTuple):
    """An impact in which points arrive.

    Attributes:
        before: The state before it.
        after: The instant after it.
        late: The points would be through their surfaces within this time, without it [s].
        passed: Number of steps and impacts until then, this one too.
    """

    before: State
    after: Instant
    late: float
    passed: int


class Step(NamedTuple):
    """The end of a step, and the steps and impacts into which it was divided."""

    end: Instant
    passed: Passed


_NONE = ContactTouch(zeros(0), np.zeros(0, bool), np.zeros((0, 3)))


def touches_of(now: Instant, constraints: Sequence[Constraint], sources: Sequence[PointSource]) -> dict[str, ContactTouch]:
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
            pushed = point_forces(measured, force[None, row], mine)
            n = mine.stop - mine.start
            carried = np.zeros((n, 3)) if pushed is None else pushed[0]
            gap, on = (np.repeat(x[mine], len(carried) // n) for x in (gaps, touches))  # of a bilateral patch all touch alike
            out[owner] = ContactTouch(gap, on, carried, _labels(source, measured.structure, mine))
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


def _labels(source: PointSource, structure: Structure, points: slice) -> tuple[str, ...]:
    """What a source calls these of its points; empty if they are only numbered."""
    label = getattr(source, "label", None)
    return () if label is None else tuple(label(number) for number in structure.numbers[points])
