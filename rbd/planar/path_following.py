"""Joint angles along a path of the end point; the quintic, which is the minimum-jerk motion between two points at rest.

One branch of the inverse kinematics is followed continuously, with angles without jumps by a turn. One and two links are
computed for all samples at once. Two links stay on their branch, except where the path runs through a singular pose: there both
branches meet, and the chain continues in the one without a kink in its motion, as a path through the base or along
a tangent of the outer circle demands. More links follow the path of least motion: each step is perpendicular to the null
space of J half-way, so that q' = J^+ r' as samples become dense.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_whole, is_finite, locked
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.planar.angles import nearest_turn, plain, wrapped
from rbd.planar.chain import Chain, check_chain
from rbd.planar.inverse_kinematics import SINGULAR, TOLERANCE, check_start, check_tolerance, nearest_pose, triangle
from rbd.planar.numeric import ROUND_OFF, ChainNumbers

SHAPE = (0.0, 0.0, 0.0, 10.0, -15.0, 6.0)
"""Coefficients of s(u) = 10 u^3 - 15 u^4 + 6 u^5, lowest power first [Flash1985]."""
DERIVATIVES = 3


@dataclass(frozen=True)
class Peaks(Displayed):
    """The largest values of a minimum-jerk motion, and when.

    Attributes:
        speed: 15/8 D/d, once, at d/2.
        speed_at: Its time [s].
        acceleration: 10/sqrt(3) D/d^2, twice: forwards at (1 - 1/sqrt 3) d/2, backwards at (1 + 1/sqrt 3) d/2.
        acceleration_at: Both times [s].
        jerk: 60 D/d^3, forwards, at both ends.
        jerk_at: Both times [s].

    Example:
        >>> peaks = rbd.planar.minimum_jerk(0.0, 1.0, 1.0).peaks
        >>> peaks.speed, peaks.speed_at, round(peaks.acceleration, 4), peaks.jerk
        (1.875, 0.5, 5.7735, 60.0)
    """

    speed: float
    speed_at: float
    acceleration: float
    acceleration_at: tuple[float, float]
    jerk: float
    jerk_at: tuple[float, float]


@dataclass(frozen=True, eq=False)
class MinimumJerk(Displayed):
    """A straight motion from rest to rest whose integral of squared jerk is the least.

    `x(t) = x0 + (x1 - x0) (10 u^3 - 15 u^4 + 6 u^5)`, `u = t/d`, [Flash1985], [Duarte2021] "Let's plot some simulated data".
    Before and after it rests. At 0 and at d the jerk jumps between zero outside and 60 (x1 - x0)/d^3 inside; there the value
    inside is returned.

    Attributes:
        start: Where it begins, any shape: a number, a point of the plane [m], joint angles [rad].
        stop: Where it ends, the same shape.
        duration: d [s], above zero.

    Example:
        >>> reach = rbd.planar.MinimumJerk(0.0, 1.0, 2.0)
        >>> reach.displacement([0.0, 0.5, 1.0]).round(4), reach.velocity([0.0, 0.5, 1.0]).round(4)
        (array([0.    , 0.1035, 0.5   ]), array([0.    , 0.5273, 0.9375]))
    """

    start: Array
    stop: Array
    duration: float
    _step: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        start, stop, duration = _values("start", self.start), _values("stop", self.stop), as_float(self.duration)
        if start.shape != stop.shape:
            raise InputError(f"start has shape {start.shape} and stop {stop.shape}; expected as many numbers in both.")
        if not 0.0 < duration < math.inf:
            raise InputError(f"duration is {self.duration!r:.80}; expected seconds above zero.")
        step = np.asarray(stop - start)  # of two numbers without a shape the difference is no array
        # The jerk divides by the cube of the duration: refuse before it overflows.
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            steepest = 60.0 * step / duration / duration / duration
        if not is_finite(steepest):
            raise InputError(
                f"duration is {duration:g} s for a motion of {_size(step):.3g}: its jerk is too large to be a number."
            )
        self.__dict__.update(start=locked(start), stop=locked(stop), duration=duration, _step=locked(step))

    def displacement(self, t: float | Sequence[float] | Array) -> Array:
        """Position at times t, shape `(*t.shape, *start.shape)`; exactly `start` before it and `stop` after."""
        share = self._shape(t, 0)
        return (1.0 - share) * self.start + share * self.stop

    def velocity(self, t: float | Sequence[float] | Array) -> Array:
        """Its rate at times t, per second: `(x1 - x0)/d (30 u^2 - 60 u^3 + 30 u^4)`; zero outside."""
        return self._shape(t, 1) * self._step

    def acceleration(self, t: float | Sequence[float] | Array) -> Array:
        """Its second derivative at times t: `(x1 - x0)/d^2 (60 u - 180 u^2 + 120 u^3)`; zero outside."""
        return self._shape(t, 2) * self._step

    def jerk(self, t: float | Sequence[float] | Array) -> Array:
        """Its third derivative at times t: `(x1 - x0)/d^3 (60 - 360 u + 360 u^2)`; zero outside [0, d], not at its ends."""
        return self._shape(t, 3) * self._step

    @property
    def distance(self) -> float:
        """Length of the step `D = |x1 - x0|`, Euclidean."""
        return _size(self._step)

    @property
    def peaks(self) -> Peaks:
        """The largest speed, acceleration and jerk, in closed form, and when."""
        d, far = self.duration, self.distance
        early, late = (0.5 * (1.0 + sign / math.sqrt(3.0)) * d for sign in (-1.0, 1.0))
        return Peaks(
            1.875 * far / d, 0.5 * d, 10.0 / math.sqrt(3.0) * far / d**2, (early, late), 60.0 * far / d**3, (0.0, d)
        )  # fmt: skip

    def times(self, samples: int = 101) -> Array:
        """Evenly spaced times from 0 to d, shape (samples,) [s].

        Raises:
            InputError: if `samples` is no whole number above one.
        """
        return np.linspace(0.0, self.duration, check_whole("samples", samples, 10_000_000, least=2))

    def symbolic(self, derivative: int = 0, *, t: Any = None) -> Any:
        """The motion, or a derivative of it, in SymPy, for 0 <= t <= d: an expression, or a column of them.

        Args:
            derivative: 0 to 3: displacement, velocity, acceleration, jerk.
            t: SymPy's symbol of time; `Symbol("t")`, a chain's own, by default.

        Raises:
            InputError: any other derivative, or a t that is no symbol.
        """
        import sympy

        whole = isinstance(derivative, int | np.integer) and not isinstance(derivative, bool)
        if not whole or derivative not in range(DERIVATIVES + 1):
            raise InputError(f"derivative is {derivative!r:.80}; expected 0, 1, 2 or 3.")
        t = sympy.Symbol("t") if t is None else t
        check_kind("t", t, sympy.Symbol, "a symbol, e.g. sympy.Symbol('t')")
        u = t / _exact(self.duration)
        share = sum(int(c) * u**k for k, c in enumerate(SHAPE))
        if self.start.ndim > 1:
            raise InputError(f"start has shape {self.start.shape}; in symbols only numbers and lists of numbers are written.")
        ends = zip(np.atleast_1d(self.start), np.atleast_1d(self.stop), strict=True)
        rows = [sympy.diff(_exact(a) + (_exact(b) - _exact(a)) * share, t, derivative) for a, b in ends]
        return rows[0] if self.start.ndim == 0 else sympy.Matrix(rows)

    def _shape(self, t: float | Sequence[float] | Array, derivative: int) -> Array:
        """s(u) or a derivative by time, shaped so that it multiplies `start`."""
        times = as_array("t", t)
        if not np.isfinite(times).all():
            raise InputError("t is not finite; expected times in seconds.")
        u = np.clip(times / self.duration, 0.0, 1.0)
        coefficients = np.polynomial.polynomial.polyder(SHAPE, derivative)
        out = np.polynomial.polynomial.polyval(u, coefficients)
        if derivative:
            inside = (times >= 0.0) & (times <= self.duration)
            out = np.where(inside, out, 0.0) / self.duration**derivative
        return out.reshape(times.shape + (1,) * self.start.ndim)


def minimum_jerk(start: float | Sequence[float] | Array, stop: float | Sequence[float] | Array, duration: float) -> MinimumJerk:
    """The minimum-jerk motion from `start` to `stop`, at rest at both, in `duration` seconds.

    Of any dimension, in joint space or end-point space: the path is straight there, and only there. `endpoint_motion` and
    `joint_motion` take it through a chain.

    Args:
        start: A number or an array of any shape: a point [m], angles [rad].
        stop: The same shape.
        duration: Above zero [s].

    Raises:
        InputError: shapes that differ, numbers that are not finite, a duration that is not above zero.

    Example:
        >>> reach = rbd.planar.minimum_jerk([1.0, 0.0], [0.5, 0.5], 2.0)
        >>> reach.displacement(1.0).tolist(), round(reach.peaks.speed, 6)
        ([0.75, 0.25], 0.662913)
    """
    return MinimumJerk(start, stop, duration)  # type: ignore[arg-type]


def _values(what: str, value: object) -> Array:
    out = as_array(what, value)
    if not out.size or not is_finite(out.ravel()):
        raise InputError(f"{what} is {value!r:.80}; expected finite numbers, at least one.")
    return out


def _size(step: Array) -> float:
    return float(np.linalg.norm(step.ravel()))


def _exact(value: float) -> Any:
    """A fraction where the number was typed as one, so that 0.5 prints as 1/2; else the float itself."""
    import sympy

    near = Fraction(float(value)).limit_denominator(1000)
    return sympy.Rational(near.numerator, near.denominator) if float(near) == float(value) else sympy.Float(float(value))


KINK = 0.1
"""A branch is changed at a singular pose only if that reduces the kink below this fraction of the one without change."""
WIDE = 0.5 * np.pi
"""A step of an angle between samples beyond which the path counts as sampled too coarsely [rad]."""


@dataclass(frozen=True, eq=False)
class InversePath(Displayed):
    """Angles of a chain along a path of its end point, as `inverse_path` finds them.

    Attributes:
        points: The given path, shape (samples, 2) [m].
        q: Angles, as the chain measures them, shape (samples, n) [rad]; where a point is out of reach (`check=False`), those
            of the nearest point within it.
        reachable: Whether each point is within reach, shape (samples,).
        distance: How far it is out of reach, shape (samples,) [m].
        singular: Whether the chain is in line there, shape (samples,): joint rates are then undetermined or without bound.
        switches: Samples at which two links go over to the other branch, through a singular pose.
        note: Remark on special cases; else empty.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.planar.inverse_path(arm, np.linspace([1.0, 0.5], [0.5, 1.0], 5))
        >>> path.q.round(3), path.switches
        (array([[-0.514,  1.955],
               [-0.383,  2.006],
               [-0.226,  2.024],
               [-0.053,  2.006],
               [ 0.13 ,  1.955]]), ())
    """

    points: Array
    q: Array
    reachable: Array
    distance: Array
    singular: Array
    switches: tuple[int, ...]
    note: str

    def __len__(self) -> int:
        return len(self.points)


def inverse_path(
    chain: Chain,
    points: Sequence[Sequence[float]] | Array,
    *,
    start: Sequence[float] | Array | None = None,
    branch: int = 0,
    tolerance: float = TOLERANCE,
    check: bool = True,
) -> InversePath:
    """Angles of a chain whose end point follows a path.

    Args:
        chain: The chain, its lengths numbers.
        points: Where the end point shall be, shape (samples, 2) [m].
        start: Angles to begin near to, shape (n,) [rad]; two links then begin in the nearer branch.
        branch: Without a start, the branch of two links to begin in: 0 bends counterclockwise (theta_2 in (0, pi)), 1
            clockwise. It decides too which way a chain leaves a singular pose that it begins in.
        tolerance: As in `inverse`.
        check: Whether to refuse paths that leave the reach; False gives the nearest points instead.

    Raises:
        InputError: on a path that leaves the reach, with the first such sample and its distance; on wrong shapes, numbers
            that are not finite, or another branch.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> square = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        >>> rbd.planar.inverse_path(arm, square).q.round(3)
        array([[-1.047,  2.094],
               [ 0.   ,  1.571],
               [ 0.524,  2.094]])
    """
    arm = check_chain(chain).numeric
    path = plain("points", points, ("samples", 2), ": x and y [m]")
    if not len(path):
        raise InputError(f"points have shape {path.shape}; expected x and y of at least one sample, (samples, 2) [m].")
    near = check_start(start, arm.n)
    check_branch(branch)
    distance = arm.distance(path)
    within = arm.reachable(distance, check_tolerance(tolerance))
    notes = []
    if not within.all():
        first, worst = int(np.argmin(within)), int(np.argmax(distance))
        x, y = path[first]
        message = (
            f"sample {first} of {len(path)}, ({x:g}, {y:g}) m, is out of reach by {distance[first]:g} m: "
            f"{arm.beyond(path[first])}; {np.sum(~within)} samples are out of reach, the farthest is sample {worst}, "
            f"by {distance[worst]:g} m"
        )
        if check:
            raise InputError(f"{message}. Move the path, or take the nearest points that can be reached: check=False.")
        notes.append(message)
    direction = np.array(0.0 if near is None else np.arctan2(*arm.position(near)[::-1]))
    reached = arm.nearest(path, direction)
    switches: tuple[int, ...] = ()
    if arm.n == 1:
        q = arm.from_segment(np.unwrap(np.arctan2(reached[:, 1], reached[:, 0]))[:, None])
        singular = np.zeros(len(path), dtype=bool)
    elif arm.n == 2:
        q, singular, switches = _one_branch(arm, reached, near, branch)
    else:
        q, stuck = _least_motion(arm, reached, near)
        s = np.linalg.svd(arm.jacobian(q), compute_uv=False)
        singular = s[:, 1] <= SINGULAR * s[:, 0]
        if stuck:
            notes.append(f"the chain had to jump to another pose at sample {stuck[0]}: sample the path more finely")
    q = q + ((wrapped(q[0]) if near is None else nearest_turn(q[0], near)) - q[0])
    notes += _notes(q, singular, switches)
    return InversePath(path, q, within, distance, singular, switches, "; ".join(notes))


def _notes(q: Array, singular: Array, switches: tuple[int, ...]) -> list[str]:
    notes = []
    if singular.any():
        many = int(singular.sum())
        others = f" and {many - 1} more" if many > 1 else ""
        notes.append(f"singular at sample {int(np.argmax(singular))}{others}: the chain is in line, stretched or folded")
    if switches:
        notes.append(f"goes over to the other branch at sample {', '.join(map(str, switches[:5]))}")
    steps = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
    if len(steps) and steps.max() > WIDE:
        k = int(np.argmax(steps))
        notes.append(
            f"an angle changes by {steps[k]:.3g} rad between samples {k} and {k + 1}: sample the path more finely to be sure "
            "that it is followed"
        )
    return notes


def _one_branch(arm: ChainNumbers, points: Array, near: Array | None, branch: int) -> tuple[Array, Array, tuple[int, ...]]:
    bend, lean, toward = triangle(arm, points)
    r = np.hypot(points[:, 0], points[:, 1])
    somewhere = r > ROUND_OFF * arm.outer
    if not somewhere.all():  # at the base the line to the target has no direction: the last one's is used, or the next one's
        last = np.maximum.accumulate(np.where(somewhere, np.arange(len(r)), -1))
        following = int(np.argmax(somewhere)) if somewhere.any() else 0
        toward = toward[np.where(last < 0, following, last)]
    toward = np.unwrap(toward)

    def pose(k: int, sign: float) -> Array:
        """The links' angles at a sample in one of the branches."""
        first = toward[k] - sign * lean[k]
        return np.array([first, first + sign * bend[k]])

    sign = 1.0 - 2.0 * branch
    if near is not None:
        gaps = [float(np.linalg.norm(nearest_turn(arm.from_segment(pose(0, s)), near) - near)) for s in (1.0, -1.0)]
        sign = 1.0 if gaps[0] <= gaps[1] else -1.0
    singular = np.sin(bend) < SINGULAR
    signs, switches = np.full(len(r), sign), []
    for before, after in _meetings(arm, points, singular):
        if before >= 1 and after + 1 < len(r) and _kink_less(pose, signs[before], before, after):
            signs[after:] *= -1.0
            switches.append(after)
    first = toward - signs * lean
    psi = np.unwrap(np.stack([first, first + signs * bend], axis=-1), axis=0)
    return arm.from_segment(psi), singular, tuple(switches)


def _meetings(arm: ChainNumbers, points: Array, singular: Array) -> list[tuple[int, int]]:
    """Last sample before each singular stretch of the path, and first one after it."""
    edges = np.diff(np.concatenate([[False], singular, [False]]).astype(int))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    found = [(int(i) - 1, int(j)) for i, j in zip(begins, ends, strict=True)]
    if arm.inner == 0.0 and len(points) > 1:  # the path between two samples may lead through the base
        step = np.diff(points, axis=0)
        length = np.hypot(step[:, 0], step[:, 1])
        across = np.abs(points[:-1, 0] * step[:, 1] - points[:-1, 1] * step[:, 0])
        through = (np.sum(points[:-1] * points[1:], axis=1) < 0.0) & (across <= 1e-9 * arm.outer * length)
        found += [(int(k), int(k) + 1) for k in np.flatnonzero(through & ~singular[:-1] & ~singular[1:])]
    return sorted(found)


def _kink_less(pose, sign: float, before: int, after: int) -> bool:  # type: ignore[no-untyped-def]  # a local function
    """Whether the other branch continues the motion before a singular pose, and this one does not."""
    kinks = []
    into = nearest_turn(pose(before, sign), pose(before - 1, sign)) - pose(before - 1, sign)
    for other in (sign, -sign):
        here = pose(after, other)
        out = nearest_turn(pose(after + 1, other), here) - here
        jump = nearest_turn(here, pose(before, sign)) - pose(before, sign)
        kinks.append(float(np.linalg.norm(out - into) + np.linalg.norm(jump / (after - before) - 0.5 * (into + out))))
    return kinks[1] < KINK * kinks[0]


def _least_motion(arm: ChainNumbers, points: Array, near: Array | None) -> tuple[Array, list[int]]:
    """Least motion from sample to sample; and the samples at which it lost the path and restarted."""
    q = np.empty((len(points), arm.n))
    q[0] = nearest_pose(arm, points[0], near)[0]
    stuck = []
    for k in range(1, len(points)):
        moved = _step(arm, points[k], q[k - 1])
        if moved is None:
            moved = nearest_pose(arm, points[k], q[k - 1])[0]
            if np.abs(moved - q[k - 1]).max() > WIDE:
                stuck.append(k)
        q[k] = moved
    return q, stuck


def _step(arm: ChainNumbers, target: Array, q0: Array) -> Array | None:
    """The pose at a target whose displacement from q0 is perpendicular to the null space half-way; None if not found."""
    q = q0
    for _ in range(20):
        error = arm.position(q) - target
        _, s, Vt = np.linalg.svd(arm.jacobian(0.5 * (q + q0)))
        J = arm.jacobian(q)
        rows = np.vstack([J / arm.outer, Vt[2:]])
        if s[1] <= 1e-6 * s[0] or np.linalg.cond(rows) > 1e8:
            return None
        step = -np.linalg.solve(rows, np.concatenate([error / arm.outer, Vt[2:] @ (q - q0)]))
        size = float(np.abs(step).max())
        if size > 1.0:
            return None
        q = q + step
        # The null space half-way is recomputed in every round: it converges linearly, at a rate of the step's size.
        if size <= 1e-12 and np.hypot(*(arm.position(q) - target)) <= ROUND_OFF * arm.outer:
            return q
    return None


def check_branch(branch: object) -> None:
    """Refuse a value that is neither 0 nor 1.

    Raises:
        InputError: saying which is which.
    """
    if isinstance(branch, bool) or not isinstance(branch, int | np.integer) or branch not in (0, 1):
        raise InputError(f"branch is {branch!r:.80}; expected 0 (bends counterclockwise) or 1 (clockwise).")
