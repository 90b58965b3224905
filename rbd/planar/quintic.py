"""The minimum-jerk motion between two points at rest: a quintic in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array, as_float, is_finite
from rbd.displayed import Displayed
from rbd.errors import InputError

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
        for array in (start, stop, step):
            array.flags.writeable = False
        object.__setattr__(self, "start", start)
        object.__setattr__(self, "stop", stop)
        object.__setattr__(self, "duration", duration)
        object.__setattr__(self, "_step", step)

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
        if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or not 2 <= samples <= 10_000_000:
            raise InputError(f"samples is {samples!r:.80}; expected a whole number, 2 at least.")
        return np.linspace(0.0, self.duration, int(samples))

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
        if not isinstance(t, sympy.Symbol):
            raise InputError(f"t is {t!r:.80}; expected a symbol, e.g. sympy.Symbol('t').")
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
