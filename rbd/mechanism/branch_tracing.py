"""Driving a mechanism by one joint: `Trace`, its poses, limits of motion and singular poses along a branch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_finite, check_flag, check_positive, check_whole, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.descent import descend
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, NoSolution
from rbd.mechanism.assembly import TOLERANCE, assemble, check_descent
from rbd.mechanism.constraint_error import Closure
from rbd.mechanism.continuation import ArcStep, Drive, Point, PoseCurve
from rbd.mechanism.four_bar_class import four_bar_pins
from rbd.mechanism.idle import told
from rbd.mechanism.poses import LimitViolation, beyond_limits, distance, measured, moved_in_words
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.joints import ANGLE
from rbd.model.state import State, checked

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_AT_REST = 1e-6
"""Rate of the driven joint along the curve, over that of all joints, below which it turns back."""
ARRIVED = 1e-9
"""Distance within which the driven joint counts as at a value, or at a limit [rad, m]."""


def trace(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    joint: str,
    values: Sequence[float] | Array,
    steps: int = 100,
    fixed: Mapping[str, object] | None = None,
    past_limits: bool = False,
    longest_step: float = 0.1,
    tolerance: float = TOLERANCE,
    max_steps: int = 100_000,
    progress: Callable[[float], None] | None = None,
    loops: bool = True,
) -> Trace:
    """The poses of a mechanism while one joint is driven through its range, on one branch.

    The branch is that of the state assembled with the joint at the first value. Along it the poses are followed by arc length
    (`rbd.mechanism.continuation`): singular poses are passed straight on, and where the joint turns back its limit is computed.

    Args:
        state: Start: assembled first, with the joint at the first value; its velocity is not used.
        constraints: As for `assemble`; joint limits (`rbd.JointLimit`) end the motion. None: the loops and wheels of the
            robot's file.
        joint: The driven joint, with one degree of freedom.
        values: (start, stop), or three and more values that are visited in order [rad, m].
        steps: Intervals between start and stop.
        fixed: {joint: value} exact values, where the mechanism has more than one degree of freedom.
        past_limits: Continue past the joint's limits of motion, until it passes the last value or returns to where
            it began; the poses are then those of the steps, with whatever values the joint has.
        longest_step: Largest step between two poses: angles in rad, translations over the robot's length.
        tolerance: Largest entry of the errors [m, rad].
        max_steps: Largest number of steps tried along the curve.
        progress: Called with the fraction of the motion that is done, in [0, 1].
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The poses that were reached; if not all were, see `limits` and `unreached`.

    Raises:
        InputError: a start where branches meet, or where the joint is at its limit; more than one degree of freedom, or none.
        CannotAssemble: the start does not close.
        NoSolution: the branch is lost; with the pose.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(0.0, 2 * np.pi), steps=36)
        >>> rocker = [rbd.mechanism.link_angles(robot.at(q))["rocker"] for q in path.q]
        >>> path.complete, round(min(rocker), 3), round(max(rocker), 3)
        (True, 1.956, 2.636)
    """
    wanted = _wanted(values, check_whole("steps", steps))
    check_descent(tolerance, max_steps, "max_steps")
    check_flag("past_limits", past_limits)
    check_positive("longest_step", longest_step, 0.5, "rad")
    if progress is not None and not callable(progress):
        raise InputError(f"progress is {progress!r:.80}; expected a function that takes a number, or None.")
    fixed = {} if fixed is None else fixed
    closure = Closure(checked(state).robot, constraints, fixed, one_sided=False, loops=loops)
    driven = Drive(closure, joint)
    first = assemble(state, constraints, fixed={**fixed, joint: float(wanted[0])}, tolerance=tolerance, loops=loops)
    curve = PoseCurve(closure, tolerance, longest_step)
    start = closure.start(first.q)
    start = closure.rested(start) if len(start.null) > 1 else start
    motion = DrivenMotion(curve, driven, driven.start(curve, start), float(wanted[0]), max_steps, progress)
    if past_limits:
        motion.go_round(float(wanted[-1]))
    else:
        motion.visit(wanted)
    return _found(motion, first.moved)


def _found(motion: DrivenMotion, moved: float) -> Trace:
    values = np.array([value for value, _ in motion.samples])
    least, condition = np.empty(len(values)), np.empty(len(values))
    beyond: dict[str, LimitViolation] = {}
    closure = motion.curve.closure
    scale, rates = closure.scale, np.zeros((len(values), closure.robot.nv))
    for i, (_, p) in enumerate(motion.samples):
        J2 = p.at.J[:, motion.drive.others]
        s = np.linalg.svd(J2, compute_uv=False) if J2.size else np.ones(1)
        least[i] = s[-1] if len(s) >= J2.shape[1] else 0.0
        condition[i] = s[0] / least[i] if least[i] > 0.0 else np.inf
        speed = motion.drive.rate(p) * scale[motion.drive.column]
        defined = abs(motion.drive.rate(p)) > _AT_REST and not p.singular
        rates[i, closure.free] = p.tangent * scale / speed if defined else np.nan
        beyond |= {x.joint: x for x in beyond_limits(closure.robot, p.q) if x.joint not in beyond}
    return Trace(
        closure.robot,
        tuple(closure.constraints or ()),
        motion.drive.joint,
        values,
        np.array([p.q for _, p in motion.samples]),
        rates,
        np.array([p.at.residual for _, p in motion.samples]),
        least,
        condition,
        tuple(motion.limits),
        tuple(motion.crossings),
        motion.unreached,
        motion.stopped_by,
        motion.closed,
        tuple(beyond.values()),
        moved,
        motion.curve.steps,
        motion.drive.place.unit,
        told(closure.idle or []),
    )


def _wanted(values: Sequence[float] | Array, steps: int) -> Array:
    """The values to visit."""
    wanted = as_finite("values", values, ("n",), meaning=": (start, stop), or more values in order")
    if len(wanted) < 2:
        raise InputError(f"values are {wanted!r:.80}; expected (start, stop), or more values in order.")
    if max_abs(wanted) > FARTHEST:
        raise InputError(f"values reach {max_abs(wanted):.3g}; at most {FARTHEST:g} is taken [rad, m].")
    return np.linspace(wanted[0], wanted[1], steps + 1) if len(wanted) == 2 else wanted


class DrivenMotion:
    """State of the tracing: poses and events found so far."""

    def __init__(
        self, curve: PoseCurve, drive: Drive, start: Point, value: float, most: int, progress: Callable[[float], None] | None
    ) -> None:
        self.curve, self.drive, self.at, self.value = curve, drive, start, value
        self.start, self.most, self.progress = start, most, progress
        self.samples: list[tuple[float, Point]] = [(value, start)]
        self.limits: list[MotionLimit] = []
        self.crossings: list[Bifurcation] = []
        self.unreached = np.zeros(0)
        self.stopped_by, self.closed = "", False
        self.step: ArcStep | None = None
        self.step_value, self.step_turns = value, False

    def visit(self, wanted: Array) -> None:
        """Go to one value after the other, until a limit of motion or a joint limit."""
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
        """Go to one value, and record its pose; False if the motion ends before."""
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
            f"{self.value:.6g}. Drive it less far, or give more max_steps, or a larger "
            "longest_step."
        )

    def _face(self, target: float) -> None:
        """Turn the tangent so that the joint goes towards the target; at a limit, backwards."""
        rate = self.drive.rate(self.at)
        if abs(rate) < 1e-6 or rate * (target - self.value) < 0.0:
            self.at = replace(self.at, tangent=-self.at.tangent)
        self.curve.turn_back()

    def _next(self) -> tuple[ArcStep, float]:
        """The next step, and the joint's value at its end."""
        step = self.curve.advance(self.at)
        self.at = step.start
        return step, self._value(step.end)

    def _value(self, p: Point) -> float:
        """The joint's value at a pose near `at`."""
        return self.value + self.drive.change(self.at.q, p.q)

    def _turns(self, step: ArcStep) -> bool:
        return self.drive.rate(step.start) * self.drive.rate(step.end) <= 0.0 and abs(self.drive.rate(step.start)) > 1e-9

    def _note(self, step: ArcStep) -> None:
        at, known = step.crossing, self.crossings
        if at is not None and not (known and distance(self.curve.closure.robot, known[-1].q, at.q) <= 1e-3):
            known.append(Bifurcation(self._value(at), at.q, float(at.sigma[-1])))

    def _limit(self, step: ArcStep) -> None:
        value = self._value(step.end) if self.at is step.start else self.value
        self.limits.append(MotionLimit(value, self.drive.rate(step.start) > 0.0, step.end.q))

    def _stopped(self, step: ArcStep, target: float | None = None) -> bool:
        """Whether a joint limit ends the motion within a step, before a target within it."""
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

    def _sample(self, step: ArcStep, after: float, target: float) -> None:
        """The pose within a step where the joint has the target's value."""
        found = self._at_value(step, after, target) or self.curve.locate(step, lambda p: self._value(p) - target).end
        self.samples.append((target, found))

    def _at_value(self, step: ArcStep, after: float, target: float) -> Point | None:
        """The same by Newton's steps with the joint fixed; None if they could end on the other side of a limit of motion."""
        if min(abs(self.drive.rate(step.start)), abs(self.drive.rate(step.end))) < 0.05 or step.crossing is not None:
            return None
        closure, curve = self.curve.closure, self.curve
        d = closure.way(step.start.q, step.end.q)
        guess = closure.move(step.start.q, (target - self.value) / (after - self.value) * d)
        pinned = Closure(
            closure.robot, closure.constraints, {**closure.fixed, self.drive.joint: target}, one_sided=False, loops=False
        )
        found = descend(pinned, pinned.start(guess), tolerance=curve.tolerance, most=8)
        if not found.closed:
            return None
        gone = closure.way(step.start.q, found.at.q)
        aside = np.linalg.norm(closure.way(guess, found.at.q))
        if aside > 0.2 * np.linalg.norm(d) or not 0.0 <= gone @ d <= d @ d * (1.0 + 1e-9):
            return None
        return curve.point(closure.at(found.at.q), step.start.tangent)

    def _back(self, step: ArcStep) -> bool:
        """Whether the curve passes its first pose within a step."""
        closure = self.curve.closure
        d, w = closure.way(step.start.q, step.end.q), closure.way(step.start.q, self.start.q)
        length = float(np.linalg.norm(d))
        along = float(w @ d) / length
        aside = float(np.linalg.norm(w - along * d / length))
        return 0.0 <= along <= length and aside < 0.1 * length and float(self.start.tangent @ step.start.tangent) > 0.9


_SHOWN = 6


@dataclass(frozen=True, eq=False)
class MotionLimit:
    """A limit of the driven joint's motion: J2 is singular, and the mechanism turns back there.

    Attributes:
        value: Value of the driven joint [rad, m].
        greatest: Whether it is a maximum of the joint's value; else a minimum.
        q: The pose, shape (nq,).
    """

    value: float
    greatest: bool
    q: Array


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """A singular pose that the motion passes, where another branch crosses, to 1e-5.

    Attributes:
        value: Value of the driven joint [rad, m].
        q: The pose, shape (nq,).
        sigma: Least singular value of J there, of those that are not zero along the motion.
    """

    value: float
    q: Array
    sigma: float


@dataclass(frozen=True, eq=False, repr=False)
class Trace(Displayed):
    """Poses of a mechanism while one joint is driven, in order, with the limits and singular poses that it passes.

    Attributes:
        robot: The mechanism.
        constraints: Those that hold.
        joint: The driven joint.
        input: Its values, shape (n,) [rad, m]; a continuous joint's are not wrapped.
        q: Poses, shape (n, nq).
        rates: Velocities over that of the driven joint, dv/d(input), shape (n, nv); NaN where J2 is singular, as at a limit.
        residual: Largest entry of the errors, shape (n,) [m, rad].
        sigma_min: Least singular value of J2, the columns of all other free joints, shape (n,).
        condition: Condition number of J2, shape (n,); inf where it is singular.
        limits: Limits at which the driven joint turned back, or would have.
        crossings: Singular poses that were passed.
        unreached: Requested values that were not reached, shape (k,).
        stopped_by: Name of the joint limit that ended the motion, or "".
        closed: Whether the motion returned to its first pose.
        beyond_limits: Joints outside the limits of the robot's file somewhere along the motion, at the first such pose.
        moved: Distance of the first pose from the start, as in `Assembly`.
        steps: Steps tried.
        unit: Of the driven joint's values: "rad" or "m".
        idle: Links that turn by themselves, as between two balls, and were left at rest.

    Example:
        >>> robot = rbd.mechanism.four_bar(2.0, 2.0, 2.0, 3.0)  # its crank does not turn round
        >>> path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(1.0, 3.0), steps=20)
        >>> path.complete, path.q.shape, [round(limit.value, 4) for limit in path.limits]
        (False, (10, 6), [1.8235])
        >>> state = path.states[3]  # while the crank turns at 1 rad/s
        >>> round(state.t, 4), round(rbd.mechanism.link_rates(state)["rocker"], 4)
        (0.3, 0.9861)
    """

    robot: CheckedModel
    constraints: tuple[Constraint, ...]
    joint: str
    input: Array
    q: Array
    rates: Array
    residual: Array
    sigma_min: Array
    condition: Array
    limits: tuple[MotionLimit, ...]
    crossings: tuple[Bifurcation, ...]
    unreached: Array
    stopped_by: str
    closed: bool
    beyond_limits: tuple[LimitViolation, ...]
    moved: float
    steps: int
    unit: str = ANGLE
    idle: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.input)

    @property
    def complete(self) -> bool:
        """Whether every requested value was reached."""
        return not len(self.unreached)

    @property
    def t(self) -> Array:
        """When each pose is reached if the driven joint moves at 1 rad/s or 1 m/s, also backwards, shape (n,) [s]."""
        return np.r_[0.0, np.cumsum(np.abs(np.diff(self.input)))]

    @property
    def states(self) -> tuple[State, ...]:
        """The poses as states at the times `t`, moving as the driven joint does; at rest where J2 is singular."""
        way = np.sign(np.gradient(self.input))[:, None] if len(self) > 1 else np.ones((1, 1))
        v = np.where(np.isfinite(self.rates), way * self.rates, 0.0)
        return tuple(State(self.robot, *at, t=float(t)) for *at, t in zip(self.q, v, self.t, strict=True))

    @property
    def transmission_angle(self) -> Array:
        """Of a planar four-bar, the angle between coupler and output at their pin, shape (n,) [rad], in [0, pi].

        Raises:
            InputError: it is no four-bar, or the driven joint is none of its two on the ground.
        """
        pins = four_bar_pins(self.states[0], self.constraints, self.joint)
        if pins is None:
            raise InputError(
                f"{self.robot.name}, driven by {self.joint!r:.80}, has no transmission angle; expected one loop of four hinges "
                "with parallel axes, driven at the ground."
            )
        return np.array([pins.transmission_angle(state) for state in self.states])

    def points(self, frame: str, offset: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
        """Positions of a point of a link in W, shape (n, 3) [m]: of a coupler's, its coupler curve.

        Args:
            frame: A frame of the robot.
            offset: The point from its origin, in its axes [m].
        """
        return np.array([state.frame(frame, offset).X_WF.translation for state in self.states])

    def plot(self, axes: Axes | Sequence[Axes] | None = None, **options: Any) -> list[Artist]:
        """Angles, rates, transmission angle and coupler curve over the driven joint; see `rbd.visual.plot_trace`.

        A new figure is none of pyplot's: `artists[0].figure.savefig("turn.png")` writes it.
        """
        return drawing("plot_trace")(axes, self, **options)

    def __str__(self) -> str:
        def told(value: float) -> str:
            return measured(value, self.unit)

        worst = int(np.argmin(self.sigma_min))
        lines = [
            f"{self.joint} from {told(self.input[0])} to {told(self.input[-1])}: {len(self)} poses, each closed to "
            f"{self.residual.max():.0e} m or rad",
            f"  nearest to singular at {told(self.input[worst])}: least singular value of J2 {self.sigma_min[worst]:.3g}",
        ]
        if self.moved > 0.1:
            lines.append(f"  its first pose is {moved_in_words(self.robot, self.moved)}")
        lines += [f"  limit: {'at most' if x.greatest else 'at least'} {told(x.value)}" for x in self.limits[:_SHOWN]]
        lines += [f"  passes a singular pose at {told(crossing.value)}: branches meet" for crossing in self.crossings[:_SHOWN]]
        more = max(0, len(self.limits) - _SHOWN) + max(0, len(self.crossings) - _SHOWN)
        lines += [f"  and {more} more of these"] * bool(more)
        if self.stopped_by:
            lines.append(f"  stopped by {self.stopped_by!r} at {told(self.input[-1])}")
        if len(self.unreached):
            first, last = self.unreached[0], self.unreached[-1]
            lines.append(f"  not reached: {told(first)}" + f" to {told(last)}" * (len(self.unreached) > 1))
        lines += ["  back where it began"] * self.closed
        lines += [f"  beyond its limits: {joint}" for joint in self.beyond_limits]
        lines += [f"  idle, left at rest: {body} turns by itself" for body in self.idle]
        return "\n".join(lines)
