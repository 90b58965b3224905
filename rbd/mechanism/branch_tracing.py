"""Driving a mechanism by one joint: poses, limits of motion, singular poses along the path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_finite, max_abs
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError
from rbd.mechanism.assembly import TOLERANCE, assemble, check_descent, check_flag
from rbd.mechanism.closure import Closure
from rbd.mechanism.continuation import Curve
from rbd.mechanism.coordinates import Beyond
from rbd.mechanism.driving import Crossing, Drive, Limit, Motion
from rbd.model.checked_model import FARTHEST, CheckedModel

_SHOWN = 6


@dataclass(frozen=True, eq=False)
class Trace:
    """Poses of a driven mechanism, in order.

    Attributes:
        joint: The driven joint.
        input: Its values, shape (n,) [rad, m]; a continuous joint's go on beyond a turn.
        q: Poses, shape (n, nq).
        residual: Largest entry of the errors, shape (n,) [m, rad].
        sigma_min: Least singular value of J2, the columns of all other free joints, shape (n,).
        condition: Condition number of J2, shape (n,); inf where it is singular.
        limits: Where the driven joint turned back, or would have.
        crossings: Singular poses that were passed.
        unreached: Values asked for that were not reached, shape (k,).
        stopped_by: Name of the stop that ended the motion, or "".
        closed: Whether the motion came back to where it began.
        beyond_limits: Joints outside the limits of the robot's file somewhere on the way, as they first were.
        moved: How far the first pose is from q0, as in `Assembly`.
        steps: Steps tried.
    """

    joint: str
    input: Array
    q: Array
    residual: Array
    sigma_min: Array
    condition: Array
    limits: tuple[Limit, ...]
    crossings: tuple[Crossing, ...]
    unreached: Array
    stopped_by: str
    closed: bool
    beyond_limits: tuple[Beyond, ...]
    moved: float
    steps: int

    def __len__(self) -> int:
        return len(self.input)

    @property
    def complete(self) -> bool:
        """Whether every value asked for was reached."""
        return not len(self.unreached)

    def __str__(self) -> str:
        worst = int(np.argmin(self.sigma_min))
        start = f"; it began {self.moved:.3g} from q0" if self.moved > 0.1 else ""
        lines = [
            f"{self.joint} from {self.input[0]:.6g} to {self.input[-1]:.6g}: {len(self)} poses, off {self.residual.max():.0e}"
            + start,
            f"  nearest to singular at {self.input[worst]:.6g}: least singular value of J2 {self.sigma_min[worst]:.3g}",
        ]
        for limit in self.limits[:_SHOWN]:
            lines.append(f"  limit: {'at most' if limit.greatest else 'at least'} {limit.value:.9g}")
        lines += [f"  passes a singular pose at {crossing.value:.6g}: branches meet" for crossing in self.crossings[:_SHOWN]]
        more = max(0, len(self.limits) - _SHOWN) + max(0, len(self.crossings) - _SHOWN)
        lines += [f"  and {more} more of these"] * bool(more)
        if self.stopped_by:
            lines.append(f"  stopped by {self.stopped_by!r} at {self.input[-1]:.6g}")
        if len(self.unreached):
            first, last = self.unreached[0], self.unreached[-1]
            lines.append(f"  not reached: {first:.6g}" + f" to {last:.6g}" * (len(self.unreached) > 1))
        lines += ["  back where it began"] * self.closed
        lines += [f"  beyond its limits: {joint}" for joint in self.beyond_limits]
        return "\n".join(lines)


def trace(
    robot: CheckedModel,
    constraints: Sequence[Constraint] | None,
    q0: Array,
    joint: str,
    values: Sequence[float] | Array,
    *,
    steps: int = 100,
    fixed: Mapping[str, object] | None = None,
    past_limits: bool = False,
    longest_step: float = 0.1,
    tolerance: float = TOLERANCE,
    max_steps: int = 100_000,
    progress: Callable[[float], None] | None = None,
) -> Trace:
    """The poses of a mechanism while one joint is driven through its range, on one branch.

    The branch is that of q0 assembled with the joint at the first value. Along it the poses are followed by arc length
    (`rbd.mechanism.continuation`): singular poses are passed straight on, and where the joint turns back its limit is found.

    Args:
        robot: The robot.
        constraints: As for `assemble`; stops (`rbd.JointLimit`) end the motion. None for the loops and wheels of its file.
        q0: Start, shape (nq,): assembled first, with the joint at the first value.
        joint: The driven joint, with one freedom.
        values: (start, stop), or three and more values that are visited in order [rad, m].
        steps: Intervals between start and stop.
        fixed: {joint: value} held exactly, where the mechanism has more than one freedom.
        past_limits: Go on where the joint turns back, over the other side, until it passes the last value or is back where
            it began; the poses are then those of the steps, with whatever values the joint has.
        longest_step: Of the way between two poses, angles in rad, what slides over the robot's length.
        tolerance: Largest entry of the errors [m, rad].
        max_steps: Most steps along the curve that are tried.
        progress: Called with the part of the way that is done, in [0, 1].

    Returns:
        The poses that were reached; `limits` and `unreached` say why not all were.

    Raises:
        InputError: a start where branches meet, or where the joint is at its limit; more than one freedom, or none.
        CannotAssemble: the start does not close.
        NoSolution: the branch is lost; says where.

    >>> motion = rbd.mechanism.trace(robot, loops, q0, "crank", (0.0, 6.28), steps=360)
    """
    wanted = _wanted(values, _whole("steps", steps))
    check_descent(tolerance, max_steps, "max_steps")
    check_flag("past_limits", past_limits)
    if not 0.0 < as_float(longest_step) <= 0.5:
        raise InputError(f"longest_step is {longest_step!r:.80}; expected a number > 0, at most 0.5 [rad].")
    if progress is not None and not callable(progress):
        raise InputError(f"progress is {progress!r:.80}; expected a function that takes a number, or None.")
    fixed = {} if fixed is None else fixed
    closure = Closure(robot, constraints, fixed, one_sided=False)
    driven = Drive(closure, joint)
    first = assemble(robot, constraints, q0, fixed={**fixed, joint: float(wanted[0])}, tolerance=tolerance)
    curve = Curve(closure, tolerance, longest_step)
    motion = Motion(curve, driven, driven.start(curve, closure.start(first.q)), float(wanted[0]), max_steps, progress)
    if past_limits:
        motion.go_round(float(wanted[-1]))
    else:
        motion.visit(wanted)
    return _found(motion, first.moved)


def _found(motion: Motion, moved: float) -> Trace:
    values = np.array([value for value, _ in motion.samples])
    least, condition = np.empty(len(values)), np.empty(len(values))
    beyond: dict[str, Beyond] = {}
    for i, (_, p) in enumerate(motion.samples):
        J2 = p.misfit.J[:, motion.drive.others]
        s = np.linalg.svd(J2, compute_uv=False) if J2.size else np.ones(1)
        least[i] = s[-1] if len(s) >= J2.shape[1] else 0.0
        condition[i] = s[0] / least[i] if least[i] > 0.0 else np.inf
        for each in motion.curve.closure.coordinates.beyond_limits(p.q):
            beyond.setdefault(each.joint, each)
    return Trace(
        motion.drive.joint,
        values,
        np.array([p.q for _, p in motion.samples]),
        np.array([p.misfit.residual for _, p in motion.samples]),
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
    )


def _wanted(values: Sequence[float] | Array, steps: int) -> Array:
    """The values to visit."""
    wanted = as_array("values", values)
    if wanted.ndim != 1 or len(wanted) < 2:
        raise InputError(f"values have shape {wanted.shape}; expected (start, stop), or more values in order.")
    check_finite("values", wanted)
    if max_abs(wanted) > FARTHEST:
        raise InputError(f"values reach {max_abs(wanted):.3g}; at most {FARTHEST:g} is taken [rad, m].")
    return np.linspace(wanted[0], wanted[1], steps + 1) if len(wanted) == 2 else wanted


def _whole(what: str, value: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= 1_000_000:
        raise InputError(f"{what} is {value!r:.80}; expected a whole number from 1 to 1000000.")
    return value
