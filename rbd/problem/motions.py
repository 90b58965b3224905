"""Motions of time, of driven joints and moving ground: constant speed, a spline or a function, with two derivatives.

A function that gives its value alone is differentiated here: differences of sixth order, with steps that shrink until those of
fourth order agree, exact to 1e-10 in s' and 1e-9 in s'', of the largest of value and derivative.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_finite, is_finite
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError

Motion: TypeAlias = Callable[[float], Any]
"""A motion as users give it: t -> s, or t -> (s, s', s''); or a spline of SciPy's, whose derivatives are its own."""
STEP = 0.01
"""First step of differences that is tried [s]."""
ROUGH = 1e-6
"""Relative difference of two orders above which a function has no derivative."""
INSTANT = 1e-8
"""Time within which a change is a jump [s]."""
SMOOTH = 1e-9
"""A change that differs by less, relative, from the integral of the rate is no jump."""
DIFFERENCES = 1e-7
"""The same of rates by differences."""
_NODES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_STEPS = STEP * 0.25 ** np.arange(9)
_WANTS = "a function t -> s or t -> (s, s', s''), a spline of SciPy's, or rbd.Speed(rate)"


@dataclass(frozen=True, eq=False)
class Speed(Displayed):
    """Motion at constant speed, s = start + rate t, for `rbd.DrivenJoint` and `rbd.Ground(motion=)`.

    Attributes:
        rate: [rad/s] or [m/s]; of ground a vector (3,) in W.
        start: s at t = 0 [rad] or [m], of the rate's shape.

    Raises:
        InputError: numbers that are not finite, or not of one shape.

    Example:
        >>> crank = rbd.Speed(30.0, start=0.5)
        >>> crank(0.1)
        (3.5, 30.0, 0.0)
    """

    rate: float | Sequence[float] | Array
    start: float | Sequence[float] | Array = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        rate = as_finite("rate of a Speed", self.rate, (), ("n",))
        start = as_finite("start of a Speed", self.start, (), rate.shape)
        number = not rate.ndim
        self.__dict__.update(rate=float(rate) if number else rate, start=float(start) if number else start + 0.0 * rate)

    def __call__(self, t: float) -> tuple[Any, Any, Any]:
        """(s, s', s'') at a time [s]."""
        rate: Any = self.rate
        return self.start + rate * t, rate, 0.0 * rate


class Prescribed:
    """A motion of time with its derivatives, checked: (s, s', s''), or (s, s').

    Args:
        what: What it is, for messages: "motion of 'crank'".
        motion: As users give it.
        shape: Shape of s: () or (n,); None for (n,) of any n, and a number counts as one.
        orders: Number of derivatives, 1 or 2.

    Raises:
        InputError: it is no motion, or a spline that has no such derivatives.
    """

    def __init__(self, what: str, motion: object, shape: tuple[int, ...] | None = (), orders: int = 2) -> None:
        if not callable(motion) or isinstance(motion, type):
            raise InputError(f"{what} is {motion!r:.80}; expected {_WANTS}.")
        self.what, self.shape, self._orders = what, shape, orders
        self._each: list[Callable[[float], Any]] = [motion]
        self._ends: tuple[float, float] | None = None
        self._smooth, self._exact = (math.inf, -math.inf), SMOOTH
        if callable(getattr(motion, "derivative", None)):
            self._ends = _ends(motion)
            try:
                for _ in range(orders):
                    self._each.append(self._each[-1].derivative())  # type: ignore[attr-defined]
            except Exception as error:
                raise InputError(f"{what} is a spline that is not twice differentiable ({error}); give a cubic one.") from error

    def __reduce__(self) -> tuple[object, ...]:
        return Prescribed, (self.what, self._each[0], self.shape, self._orders)

    def at(self, t: float) -> Array:
        """(s, s', s'') at a time [s], or (s, s'), along the first axis, each of `shape`.

        Raises:
            InputError: values of a wrong size, or not finite; no derivative here; beyond the ends of a spline.
        """
        if self._ends is not None and not self._ends[0] - INSTANT <= t <= self._ends[1] + INSTANT:
            raise InputError(
                f"{self.what} is a spline from t = {self._ends[0]:g} to {self._ends[1]:g} s, asked at t = {t:.6g} s. Give more "
                "of it, a shorter duration, or the time at which to start: state.at_time(t)."
            )
        if len(self._each) > 1:
            return np.array([self._called(f, t, 0) for f in self._each])
        given = self._called(self._each[0], t, self._orders + 1)
        n = self.shape or (given.shape[-1:] if self.shape is None else ())
        if given.shape == (self._orders + 1, *n):
            return given
        self._exact = DIFFERENCES
        return np.concatenate([given[None], self._derivatives(t, given)])

    def jump(self, since: float, t: float) -> float | None:
        """A time in an interval at which s or s' jumps [s]; None if there is none.

        Each change is compared with the integral of its rate by Simpson's rule, in intervals halved until they agree. An
        interval that was found smooth is not looked at again.
        """
        first, last = self._smooth
        begin = last if first <= since <= last else since
        found = self._jump(begin, t, self._stacked(begin), self._stacked(t)) if t > begin else None
        if found is None:
            self._smooth = (first if begin == last else since), max(t, begin)
        return found

    def _stacked(self, t: float) -> Array:
        return self.at(t).reshape(self._orders + 1, -1)

    def _jump(self, since: float, t: float, before: Array, after: Array) -> float | None:
        h, middle = t - since, 0.5 * (since + t)
        between = self._stacked(middle)
        most = np.abs([before[1:], between[1:], after[1:]]).max(axis=(0, 2))
        size = self._exact * np.maximum(np.abs([before[:-1], after[:-1]]).max(axis=(0, 2)), h * most)
        change = after[:-1] - before[:-1]
        off = np.abs(change - h / 6.0 * (before[1:] + 4.0 * between[1:] + after[1:])).max(axis=1)
        if (off <= size).all():
            return None
        if h > INSTANT:
            early = self._jump(since, middle, before, between)
            return self._jump(middle, t, between, after) if early is None else early
        return t if (np.abs(change).max(axis=1) > 3.0 * h * most + size).any() else None

    def _called(self, f: Callable[[float], Any], t: float, several: int) -> Array:
        """A value of one of the functions; of `several` that may come together."""
        try:
            out = f(t)
        except RbdError:
            raise
        except Exception as error:
            raise InputError(f"{self.what} raised {type(error).__name__} at t = {t:.6g} s: {str(error):.200}.") from error
        given = as_array(self.what, out)
        if self.shape is None:
            given = np.atleast_1d(given)
        n = given.shape[-1:] if self.shape is None else self.shape
        if given.shape not in (n, (several, *n)):
            one, all_ = ("a number", "(s, s', s'')") if n == () else (f"shape {n}", f"{several} of them")
            raise InputError(
                f"{self.what} gave {out!r:.80} at t = {t:.6g} s, of shape {given.shape}; expected s, {one}"
                + (f", or with its derivatives, {all_}." if several else ".")
            )
        if not is_finite(given.ravel()):
            raise InputError(f"{self.what} is {out!r:.80} at t = {t:.6g} s; expected finite numbers.")
        return given

    def _derivatives(self, t: float, middle: Array) -> Array:
        """(s', s''), or (s',), by differences.

        Raises:
            InputError: two orders differ at every step.
        """
        from rbd.problem.difference_kernel import judged

        flat, k = np.atleast_1d(middle), self._orders
        found, left, size = np.ones((k, len(flat) + 2)), np.arange(k), 0.0
        found[:, -2] = np.inf
        for h in _STEPS:
            values = np.array([np.atleast_1d(self._called(self._each[0], t + x, 0)) for x in h * _NODES])
            moved = np.broadcast_to(values, (len(left), 1, *values.shape)).copy()
            left, size = judged(moved, flat, np.array([h]), left, 1, size, found)
            if not len(left):
                break
        apart = float((found[:, -2] / found[:, -1]).max()) if len(left) else 0.0
        if not apart <= ROUGH:
            raise InputError(
                f"{self.what} has no derivatives at t = {t:.6g} s that differences can find (two orders are apart by "
                f"{min(apart, 1.0):.1g}, expected {ROUGH:g}): a jump, a kink, noise, or the end of where it is defined? Give "
                "its derivatives with it, t -> (s, s', s''), where s' may not jump."
            )
        return found[:, :-2].reshape(k, *middle.shape)


def _ends(spline: Any) -> tuple[float, float] | None:
    """Where a spline begins and ends [s]; None if that is not known, or if it repeats."""
    if getattr(spline, "extrapolate", None) == "periodic":
        return None
    x = getattr(spline, "x", None)
    if x is None and hasattr(spline, "t") and hasattr(spline, "k"):
        x = spline.t[spline.k : len(spline.t) - spline.k]
    return None if x is None or not len(x) else (float(x[0]), float(x[-1]))
