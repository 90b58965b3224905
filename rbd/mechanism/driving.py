"""The driven joint of a mechanism, and the motion that driving it makes: limits, crossings, stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, NoSolution
from rbd.mechanism.closure import Closure, Misfit, rank_of
from rbd.mechanism.continuation import Curve, Point, Step
from rbd.mechanism.descent import branches_meet, descend
from rbd.mechanism.partition import independent_columns
from rbd.mechanism.poses import distance

ARRIVED = 1e-9


@dataclass(frozen=True, eq=False)
class Limit:
    """Where the driven joint can go no farther: J2 is singular, and the mechanism turns back there.

    Attributes:
        value: Of the driven joint [rad, m].
        greatest: Whether it is the greatest value on its way; else the least.
        q: The pose, shape (nq,).
    """

    value: float
    greatest: bool
    q: Array


@dataclass(frozen=True, eq=False)
class Crossing:
    """A singular pose that the motion passes, where another branch crosses: known to 1e-5.

    Attributes:
        value: Of the driven joint [rad, m].
        q: The pose, shape (nq,).
        sigma: Least singular value of J there, of those that are not zero on the way.
    """

    value: float
    q: Array
    sigma: float


class Drive:
    """The driven joint among the free velocities."""

    def __init__(self, closure: Closure, joint: str) -> None:
        self.place = closure.robot.joints[joint]
        if self.place.nv != 1:
            raise InputError(f"joint {joint!r:.80} has {self.place.nv} freedoms; expected a joint with one to drive.")
        if closure.held[self.place.v.start]:
            raise InputError(f"joint {joint!r:.80} is driven and fixed; leave it out of fixed=.")
        self.closure, self.joint = closure, joint
        self.column = int(np.searchsorted(closure.free, self.place.v.start))
        self.others = np.arange(len(closure.free)) != self.column

    def change(self, q: Array, to: Array) -> float:
        """By how much the joint moves between two near poses."""
        return float(self.closure.way(q, to)[self.column] * self.closure.metric[self.column])

    def rate(self, p: Point) -> float:
        """How fast the joint moves along the curve."""
        return float(p.tangent[self.column])

    def start(self, curve: Curve, at: Misfit) -> Point:
        """The first pose.

        Raises:
            InputError: the mechanism has not one freedom there, or the joint does not move with it.
        """
        name = self.closure.robot.name
        p, n = curve.point(at, None), len(self.closure.free)
        if p is None:
            J = at.J if len(at.J) else np.zeros((1, n))
            freedoms = n - rank_of(np.linalg.svd(J, compute_uv=False))
            if freedoms == 0:
                raise InputError(f"{name} does not move: its constraints leave no freedom here. Fix fewer joints.")
            if branches_meet(self.closure, at):
                raise InputError(
                    f"at the start, {self.joint!r:.80} = {self.place.coordinate(at.q):.6g}, {name} is singular: {freedoms} "
                    "freedoms, branches meet there. Begin a little away, on the branch that is meant."
                )
            names = self.closure.names(independent_columns(J, ~self.others))
            others = [x for x in names if x != self.joint]
            raise InputError(
                f"{name} has {freedoms} freedoms; driving {self.joint!r:.80} decides one. Fix {freedoms - 1} more, e.g. "
                f"fixed={{{', '.join(f'{x!r}: ...' for x in others[: freedoms - 1])}}}."[:500]
            )
        if abs(self.rate(p)) < 1e-5:
            raise InputError(
                f"at the start {self.joint!r:.80} stands still while {name} moves: it is at a limit of its motion, or no part "
                "of what moves. Begin a little away, on the branch that is meant, or drive another joint."
            )
        return p


class Motion:
    """What has been found so far."""

    def __init__(
        self, curve: Curve, drive: Drive, start: Point, value: float, most: int, progress: Callable[[float], None] | None
    ) -> None:
        self.curve, self.drive, self.at, self.value = curve, drive, start, value
        self.start, self.most, self.progress = start, most, progress
        self.samples: list[tuple[float, Point]] = [(value, start)]
        self.limits: list[Limit] = []
        self.crossings: list[Crossing] = []
        self.unreached = np.zeros(0)
        self.stopped_by, self.closed = "", False
        self.step: Step | None = None
        self.step_value, self.step_turns = value, False

    def visit(self, wanted: Array) -> None:
        """Go to one value after the other, until a limit or a stop."""
        for i, target in enumerate(wanted[1:], 1):
            if not self._to(float(target)):
                self.unreached = wanted[i:]
                return
            if self.progress is not None:
                self.progress(i / (len(wanted) - 1))

    def go_round(self, target: float) -> None:
        """Follow the curve over its limits until the joint passes the last value, or the curve is closed."""
        self._face(target)
        self.start = self.at
        began, gone = self.value, 0.0
        while self.curve.steps < self.most:
            step, after = self._next()
            if self._stopped(step):
                break
            self._note(step)
            if self._turns(step):
                self._limit(self.curve.locate(step, self.drive.rate))
            if (after - target) * (self.value - target) <= 0.0 and after != self.value:
                self._sample(step, after, target)
                return
            gone += step.length
            if gone > 4.0 * step.length and self._back(step):
                self.closed = True
                self.samples.append((self.value + self.drive.change(self.at.q, self.start.q), self.start))
                break
            self.at, self.value = step.end, after
            self.samples.append((after, step.end))
            if self.progress is not None:
                self.progress(min(1.0, abs(after - began) / max(1e-300, abs(target - began))))
        else:
            raise self._lost()
        self.unreached = np.array([target])

    def _to(self, target: float) -> bool:
        """Go to one value, and take its pose; False where the way ends before."""
        last = self.samples[-1]
        if abs(target - last[0]) <= ARRIVED:
            self.samples.append(last)
            return True
        if self.step is None or (target - last[0]) * (self.step_value - self.value) < 0.0:
            self.at, self.value, self.step = last[1], last[0], None
            self._face(target)
        while self.curve.steps < self.most:
            if self.step is None:
                step, after = self._next()
                turns = self._turns(step)
                if turns:
                    step = self.curve.locate(step, self.drive.rate)
                    after = self.value + self.drive.change(self.at.q, step.end.q)
                self._note(step)
                self.step, self.step_value, self.step_turns = step, after, turns
            if (self.step_value - target) * (self.value - target) <= 0.0:
                if self._stopped(self.step, target):
                    return False
                self._sample(self.step, self.step_value, target)
                return True
            if self._stopped(self.step):
                return False
            self.at, self.value = self.step.end, self.step_value
            if self.step_turns:
                self._limit(self.step)
                self.samples.append((self.value, self.at))
                self.step = None
                return abs(self.value - target) <= ARRIVED
            self.step = None
        raise self._lost()

    def _lost(self) -> NoSolution:
        return NoSolution(
            f"{self.curve.closure.robot.name} does not arrive: after {self.most} steps {self.drive.joint!r:.80} is at "
            f"{self.value:.6g}. Drive a shorter way, or give more max_steps, or a larger "
            "longest_step."
        )

    def _face(self, target: float) -> None:
        """Turn the tangent so that the joint goes towards the target; at a limit, back the way that it came."""
        rate = self.drive.rate(self.at)
        if abs(rate) < 1e-6 or rate * (target - self.value) < 0.0:
            self.at = replace(self.at, tangent=-self.at.tangent)
        self.curve.turn_back()

    def _next(self) -> tuple[Step, float]:
        """The next step, and the joint's value at its end."""
        step = self.curve.advance(self.at)
        self.at = step.start
        return step, self._value(step.end)

    def _value(self, p: Point) -> float:
        """The joint's value at a pose near `at`."""
        return self.value + self.drive.change(self.at.q, p.q)

    def _turns(self, step: Step) -> bool:
        return self.drive.rate(step.start) * self.drive.rate(step.end) <= 0.0 and abs(self.drive.rate(step.start)) > 1e-9

    def _note(self, step: Step) -> None:
        if step.crossing is None:
            return
        robot = self.curve.closure.robot
        if not self.crossings or distance(robot, self.crossings[-1].q, step.crossing.q) > 1e-3:
            self.crossings.append(Crossing(self._value(step.crossing), step.crossing.q, float(step.crossing.sigma[-1])))

    def _limit(self, step: Step) -> None:
        value = self._value(step.end) if self.at is step.start else self.value
        self.limits.append(Limit(value, self.drive.rate(step.start) > 0.0, step.end.q))

    def _stopped(self, step: Step, target: float | None = None) -> bool:
        """Whether a stop ends the motion within a step, before a target within it."""
        least, whose = self.curve.stop(step.end)
        if least >= -ARRIVED:
            return False
        end = self.curve.locate(step, lambda p: self.curve.stop(p)[0]).end
        value = self._value(end)
        if target is not None and (value - target) * np.sign(self._value(step.end) - self.value) >= 0.0:
            return False
        self.samples.append((value, end))
        self.stopped_by = whose
        return True

    def _sample(self, step: Step, after: float, target: float) -> None:
        """The pose within a step where the joint has the target's value."""
        found = self._at_value(step, after, target)
        if found is None:
            found = self.curve.locate(step, lambda p: self._value(p) - target).end
        self.samples.append((target, found))

    def _at_value(self, step: Step, after: float, target: float) -> Point | None:
        """The same by Newton's steps with the joint fixed; None where these could end on the other side of a limit."""
        if min(abs(self.drive.rate(step.start)), abs(self.drive.rate(step.end))) < 0.05 or step.crossing is not None:
            return None
        closure, curve = self.curve.closure, self.curve
        d = closure.way(step.start.q, step.end.q)
        guess = closure.move(step.start.q, (target - self.value) / (after - self.value) * d)
        pinned = Closure(closure.robot, closure.constraints, {**closure.fixed, self.drive.joint: target}, one_sided=False)
        found = descend(pinned, pinned.start(guess), tolerance=curve.tolerance, most=8)
        if not found.closed:
            return None
        gone = closure.way(step.start.q, found.misfit.q)
        aside = np.linalg.norm(closure.way(guess, found.misfit.q))
        if aside > 0.2 * np.linalg.norm(d) or not 0.0 <= gone @ d <= d @ d * (1.0 + 1e-9):
            return None
        return curve.point(closure.at(found.misfit.q), step.start.tangent)

    def _back(self, step: Step) -> bool:
        """Whether the curve passes its beginning within a step."""
        closure = self.curve.closure
        d, w = closure.way(step.start.q, step.end.q), closure.way(step.start.q, self.start.q)
        length = float(np.linalg.norm(d))
        along = float(w @ d) / length
        aside = float(np.linalg.norm(w - along * d / length))
        return 0.0 <= along <= length and aside < 0.1 * length and float(self.start.tangent @ step.start.tangent) > 0.9
