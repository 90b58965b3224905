"""Following a mechanism's curve of poses by arc length, through turning points and bifurcations, never onto another curve.

A mechanism with one degree of freedom has a curve of poses. A step predicts along the tangent, the null space of J, and is
corrected by the shortest step back onto the constraints [AllgowerGeorg1990]. It is halved where

- the tangent turns by more than 0.2 rad, or the chord is not between the tangents: a jump to a neighbouring curve;
- a singular value of J, followed with its vectors, goes through zero. That happens where two curves cross, and also where a
  step jumps from one to the other of two curves that nearly cross. As the steps get shorter the second bends away, and is
  followed; at a crossing J remains singular, to 1e-5: it is crossed straight on, and reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from rbd.arrays import Array
from rbd.constraints.descent import descend
from rbd.errors import InputError, NoSolution
from rbd.mechanism.constraint_error import Closure, ConstraintResidual, branches_meet, independent_columns

_LEAST_STEP = 1e-6
_MOST_TURN = 0.2
_MOST_SIDEWAYS = 0.05


@dataclass(frozen=True, eq=False)
class Point:
    """A pose on the curve.

    Attributes:
        at: Residual of the constraints there.
        tangent: Unit direction of the curve, shape (free,), in units of `Closure.scale`.
        rows: Orthonormal combinations of the constraints' rows, shape (m, free - 1).
        columns: Orthonormal directions of the free velocities, shape (free, free - 1), in units of `Closure.scale`.
        sigma: Singular values of J, shape (free - 1,): J = rows diag(sigma) columns^T.
        singular: Whether J has lost rank there.
    """

    at: ConstraintResidual
    tangent: Array
    rows: Array
    columns: Array
    sigma: Array
    singular: bool

    @property
    def q(self) -> Array:
        """The configuration."""
        return self.at.q


@dataclass(frozen=True, eq=False)
class ArcStep:
    """A step from one pose to the next.

    Attributes:
        start: The pose before.
        end: The pose after.
        length: Length of the prediction.
        crossing: The pose where another curve crosses in between, to 1e-5, or None.
    """

    start: Point
    end: Point
    length: float
    crossing: Point | None


class PoseCurve:
    """The poses of a mechanism with one degree of freedom.

    Args:
        closure: The constraints.
        tolerance: Largest entry of the errors.
        longest: Longest step, in units of `Closure.scale`.
    """

    def __init__(self, closure: Closure, tolerance: float, longest: float) -> None:
        self.closure, self.tolerance, self.longest = closure, tolerance, longest
        self.size = 0.3 * longest
        self._jump: tuple[ArcStep, float] | None = None
        self.steps = 0

    def point(self, at: ConstraintResidual, along: Array | None) -> Point | None:
        """A pose with its tangent, oriented along `along`; None unless the constraints leave one degree of freedom.

        Where J loses rank the tangent is the projection of `along`: straight on.
        """
        n = len(self.closure.free)
        (U, s, Vt), null = at.svd, at.null
        if not len(null) or (len(null) > 1 and along is None):
            return None
        t = null[0] if len(null) == 1 or along is None else null.T @ (null @ along)
        size = float(np.linalg.norm(t))
        if not size > 0.5:
            return None
        t = t / size
        if along is not None and t @ along < 0.0:
            t = -t
        sigma = np.zeros(n - 1)
        sigma[: min(len(s), n - 1)] = s[: n - 1]
        return Point(at, t, U[:, : n - 1], Vt[: n - 1].T, sigma, len(null) > 1)

    def ahead(self, p: Point, length: float) -> Point | None:
        """The pose after a step of this length; None if the correction does not converge."""
        try:
            predicted = self.closure.at(self.closure.move(p.q, length * p.tangent))
            found = descend(self.closure, predicted, tolerance=self.tolerance, most=12)
        except InputError:
            return None
        return self.point(found.at, p.tangent) if found.closed else None

    def advance(self, p: Point) -> ArcStep:
        """The next pose.

        Raises:
            NoSolution: the curve is lost.
        """
        if p.singular:
            if self._jump is not None:
                return self._cross(p)
            self.size = max(self.size, 0.1 * self.longest)
        while self.size >= _LEAST_STEP:
            self.steps += 1
            end = self.ahead(p, self.size)
            if end is None or not self._follows(p, end):
                self.size *= 0.5
                continue
            step = ArcStep(p, end, self.size, p if p.singular else None)
            if self._flips(p, end):
                if self._jump is None:
                    self._jump = step, 0.0
                self.size *= 0.5
                continue
            self._grow(p, end)
            return step
        return self._cross(p)

    def turn_back(self) -> None:
        """Start again in the opposite direction."""
        self._jump, self.size = None, min(self.size, 0.3 * self.longest)

    def locate(self, step: ArcStep, measure: Callable[[Point], float]) -> ArcStep:
        """The fraction of a step at which a measure, of opposite signs at its ends, is zero."""
        found: dict[float, Point] = {0.0: step.start, step.length: step.end}

        def value(s: float) -> float:
            if s not in found:
                there = self.ahead(step.start, s)
                if there is None:
                    raise NoSolution(f"{self.closure.robot.name}: the curve of poses was lost within a step.")
                found[s] = there
            return measure(found[s])

        s = float(brentq(value, 0.0, step.length, xtol=1e-13, rtol=1e-14))
        value(s)
        return ArcStep(step.start, found[s], s, step.crossing)

    def stop(self, p: Point) -> tuple[float, str]:
        """(least distance to a limit, negative beyond it; its constraint), over the unilateral constraints."""
        sided = [(r.error, r.name) for r in p.at.rows if r.cone.one_sided and r.error is not None and len(r.error)]
        return min([(1.0, ""), *((float(error.min()), name) for error, name in sided)], key=lambda each: each[0])

    def _follows(self, p: Point, end: Point) -> bool:
        d = self.closure.way(p.q, end.q)
        length, between = float(np.linalg.norm(d)), p.tangent + end.tangent
        if not 0.5 * self.size < length < 2.0 * self.size or p.tangent @ end.tangent < np.cos(_MOST_TURN):
            return False
        return float(np.linalg.norm(d / length - between / np.linalg.norm(between))) < _MOST_SIDEWAYS

    def _flips(self, p: Point, end: Point) -> bool:
        """Whether a singular value has gone through zero, tracked from the last pose: one of them, or several at once."""
        if p.singular or end.singular or not len(p.at.J) or len(p.at.J) != len(end.at.J):
            return False
        return bool((np.linalg.eigvals(_followed(p, end)).real < 0.0).any())

    def _grow(self, p: Point, end: Point) -> None:
        """Longer steps where the curve is straight; a jump that was avoided is forgotten once the curve has passed it."""
        if p.tangent @ end.tangent > np.cos(0.3 * _MOST_TURN):
            self.size = min(self.longest, 1.5 * self.size)
        if self._jump is not None:
            step, gone = self._jump
            gone += float(np.linalg.norm(self.closure.way(p.q, end.q)))
            self._jump = (step, gone) if gone < 2.0 * step.length else None

    def _cross(self, p: Point) -> ArcStep:
        """Straight on, across a bifurcation that steps of 1e-6 still detect."""
        if self._jump is None:
            raise NoSolution(
                f"{self.closure.robot.name}: the curve of poses is lost: no step of {_LEAST_STEP:g} leads on from q = "
                f"{np.array2string(p.q, precision=6, threshold=12)}, where its least singular value is {p.sigma[-1]:.2g}."
            )
        step, _ = self._jump
        self._jump, self.size = None, step.length
        gone, length = (float(np.linalg.norm(self.closure.way(a.q, b.q))) for a, b in ((step.start, p), (p, step.end)))
        part = gone / (gone + length)
        tangent = (1.0 - part) * step.start.tangent + part * step.end.tangent  # near the crossing J is nearly singular
        here = replace(p, tangent=tangent / np.linalg.norm(tangent), singular=True)
        end = self.ahead(here, length)
        if end is None or np.linalg.norm(self.closure.way(end.q, step.end.q)) > 0.2 * length:
            end = step.end
        # The singular value is nearly linear: the crossing is at that fraction of the step ahead, or back.
        ahead = np.linalg.eigvals(_followed(step.start, p)).real.min() > 0.0
        small, large = float(p.sigma[-1]) * (1.0 if ahead else -1.0), float(end.sigma[-1])
        rest = small / (small + large) if large > abs(small) else 0.0
        return ArcStep(here, end, length, self.ahead(here, rest * length) or here)


def _followed(p: Point, end: Point) -> Array:
    """J at `end` between the singular vectors of p over its singular values: the identity if `end` were p."""
    return (p.rows.T @ end.at.J @ p.columns) / p.sigma


class Drive:
    """Index of the driven joint among the free velocities."""

    def __init__(self, closure: Closure, joint: str) -> None:
        self.place = closure.robot.joints[joint]
        if self.place.nv != 1:
            raise InputError(f"joint {joint!r:.80} has {self.place.nv} degrees of freedom; expected a joint with one to drive.")
        if closure.held[self.place.v.start]:
            raise InputError(f"joint {joint!r:.80} is driven and fixed; leave it out of fixed=.")
        self.closure, self.joint = closure, joint
        self.column = int(np.searchsorted(closure.free, self.place.v.start))
        self.others = np.arange(len(closure.free)) != self.column

    def change(self, q: Array, to: Array) -> float:
        """Displacement of the joint between two near poses."""
        return float(self.closure.way(q, to)[self.column] * self.closure.scale[self.column])

    def rate(self, p: Point) -> float:
        """Rate of the joint along the curve."""
        return float(p.tangent[self.column])

    def start(self, curve: PoseCurve, at: ConstraintResidual) -> Point:
        """The first pose.

        Raises:
            InputError: the mechanism does not have one degree of freedom there, or the joint does not move.
        """
        name = self.closure.robot.name
        p = curve.point(at, None)
        if p is None:
            freedoms = len(at.null)
            if freedoms == 0:
                raise InputError(f"{name} does not move: its constraints leave no degree of freedom here. Fix fewer joints.")
            if branches_meet(self.closure, at):
                raise InputError(
                    f"at the start, {self.joint!r:.80} = {self.place.coordinate(at.q):.6g}, {name} is singular: {freedoms} "
                    "degrees of freedom, branches meet there. Start a little away, on the intended branch."
                )
            free = self.closure.free[independent_columns(at.J, ~self.others)].tolist()
            joints = [j.name for j in at.state.robot.joints.values() if any(j.v.start <= i < j.v.stop for i in free)]
            others = [x for x in joints if x != self.joint]
            raise InputError(
                f"{name} has {freedoms} degrees of freedom; driving {self.joint!r:.80} decides one. Fix {freedoms - 1} more, "
                f"e.g. fixed={{{', '.join(f'{x!r}: ...' for x in others[: freedoms - 1])}}}."[:500]
            )
        if abs(self.rate(p)) < 1e-5:
            raise InputError(
                f"at the start {self.joint!r:.80} is at rest while {name} moves: it is at a limit of its motion, or not part "
                "of the moving chain. Start a little away, on the intended branch, or drive another joint."
            )
        return p
