"""Intervals that contain exact results: midpoint-radius arithmetic of arrays with outward rounding, and verified solves.

An interval is {x : |x - mid| <= rad}, entry by entry. Each result contains what exact arithmetic would give for every choice of
exact operands in theirs. It rests on these facts of floating-point numbers, and on no others:

* Doubles are IEEE 754 binary64, and +, -, *, / and sqrt of NumPy arrays are rounded to nearest, gradual underflow included
  (no compiler option "fast-math", no flush to zero): |fl(x op y) - (x op y)| <= u |x op y| + eta, u = 2^-53, eta = 2^-1074.
* A product of matrices by BLAS sums the n products of each entry in any order, with fused multiply-adds or without (so not by
  Strassen's method): its error is at most n u / (1 - n u) |A| |B| + 2 n eta.
* `math.sin` and `math.cos` are within 4 units in the last place of 1 for arguments up to `LARGEST_ANGLE`.

Error-free transformations (Knuth's sum, Dekker's product) give residuals as if computed with twice the digits, so that
a verified solve returns intervals of a few units in the last place. A result that overflows has NaN or infinite radii: no test
(`inside`, `positive`) holds of it. Sources: [Rump2010].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array, as_array
from rbd.displayed import Displayed
from rbd.errors import InputError

U = 2.0**-53
"""Half a unit in the last place of 1."""
TINY = 1e-300
"""Far above what underflow can add to any of the sums here, 4 n 2^-1074."""
LARGEST_ANGLE = 1e5
"""Largest argument of sin and cos [rad]."""
_SPLIT = 2.0**27 + 1.0

Real: TypeAlias = "Intervals | Array | float"


def above(x: Array, operations: int) -> Array:
    """An upper bound of the exact sum of terms that are not negative, of which floating point gave x.

    Args:
        x: The sums that were computed, of any shape.
        operations: How often a term was rounded on its way into the sum, at most.
    """
    return np.asarray(x * (1.0 + 2.0 * (operations + 2) * U) + TINY)


@dataclass(frozen=True, eq=False, repr=False)
class Intervals(Displayed):
    """Intervals of numbers, an array of them: |x - mid| <= rad, entry by entry.

    Sums, products and matrix products (`@`) with other intervals, or with arrays as exact doubles, contain the exact results.

    Attributes:
        mid: Midpoints.
        rad: Radii, of the same shape, zero or more; NaN or infinity where nothing is known.

    Example:
        >>> third = rbd.answers.analysis.Intervals.of(1.0, 1.0) / 3.0
        >>> bool(third.lower < third.upper), bool((third * 3.0 - 1.0).contains(0.0))
        (True, True)
    """

    mid: Array
    rad: Array

    __array_priority__ = 1000.0
    __array_ufunc__ = None  # array op Intervals is answered here

    @classmethod
    def of(cls, lower: object, upper: object) -> Intervals:
        """The intervals from `lower` to `upper`, one of which may be a single number.

        Raises:
            InputError: ends that are not finite, are reversed, or of different shapes.
        """
        lo, hi = as_array("lower", lower), as_array("upper", upper)
        try:
            lo, hi = (x.copy() for x in np.broadcast_arrays(lo, hi))
        except ValueError:
            raise InputError(f"lower has shape {lo.shape}, upper {hi.shape}; expected one shape.") from None
        if not (np.isfinite(lo) & np.isfinite(hi) & (lo <= hi)).all():
            raise InputError(f"intervals from {lo!r:.80} to {hi!r:.80}; expected finite ends, lower <= upper.")
        return cls._between(lo, hi)

    @classmethod
    def exact(cls, x: Real) -> Intervals:
        """Intervals of no width, of doubles taken as exact; intervals as they are."""
        if isinstance(x, Intervals):
            return x
        mid = np.asarray(x, float)
        return cls(mid, np.zeros_like(mid))

    @classmethod
    def _between(cls, lo: Array, hi: Array) -> Intervals:
        mid = np.where(lo == hi, lo, 0.5 * lo + 0.5 * hi)
        return cls(mid, np.where(lo == hi, 0.0, above(np.maximum(hi - mid, mid - lo), 2)))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.mid.shape

    @property
    def lower(self) -> Array:
        """Lower ends, rounded down."""
        return np.where(self.rad == 0.0, self.mid, np.nextafter(self.mid - self.rad, -np.inf))

    @property
    def upper(self) -> Array:
        """Upper ends, rounded up."""
        return np.where(self.rad == 0.0, self.mid, np.nextafter(self.mid + self.rad, np.inf))

    @property
    def width(self) -> Array:
        """Widths, 2 rad."""
        return 2.0 * self.rad

    @property
    def size(self) -> Array:
        """Upper bounds of the absolute values."""
        return above(np.abs(self.mid) + self.rad, 1)

    @property
    def T(self) -> Intervals:
        """The transposed array."""
        return Intervals(self.mid.T, self.rad.T)

    def __getitem__(self, at: object) -> Intervals:
        return Intervals(np.asarray(self.mid[at]), np.asarray(self.rad[at]))  # type: ignore[call-overload]

    def __neg__(self) -> Intervals:
        return Intervals(-self.mid, self.rad)

    def __add__(self, other: Real) -> Intervals:
        b = Intervals.exact(other)
        mid = self.mid + b.mid
        return Intervals(mid, above(self.rad + b.rad + U * np.abs(mid), 3))

    def __sub__(self, other: Real) -> Intervals:
        return self + (-Intervals.exact(other))

    def __rsub__(self, other: Real) -> Intervals:
        return (-self) + other

    def __mul__(self, other: Real) -> Intervals:
        b = Intervals.exact(other)
        mid = self.mid * b.mid
        return Intervals(mid, above(np.abs(self.mid) * b.rad + self.rad * (np.abs(b.mid) + b.rad) + U * np.abs(mid), 6))

    def __truediv__(self, other: Real) -> Intervals:
        """Quotients; infinite radii where the divisor may be zero."""
        b = Intervals.exact(other)
        far = (b.lower > 0.0) | (b.upper < 0.0)
        one, two = 1.0 / np.where(far, b.lower, 1.0), 1.0 / np.where(far, b.upper, 1.0)
        inverse = Intervals._between(np.nextafter(np.minimum(one, two), -np.inf), np.nextafter(np.maximum(one, two), np.inf))
        out = self * inverse
        return Intervals(out.mid, np.where(far, out.rad, np.inf))

    def __matmul__(self, other: Real) -> Intervals:
        return product(self, other)

    def __rmatmul__(self, other: Real) -> Intervals:
        return product(other, self)

    __radd__, __rmul__ = __add__, __mul__

    def sqrt(self) -> Intervals:
        """Square roots of the parts that are not negative; NaN where there is none."""
        with np.errstate(invalid="ignore"):
            lo, hi = np.sqrt(np.maximum(self.lower, 0.0)), np.sqrt(self.upper)
        return Intervals._between(np.maximum(np.nextafter(lo, -np.inf), 0.0), np.nextafter(hi, np.inf))

    def sin(self) -> Intervals:
        """Sines."""
        return self._wave(math.sin, math.cos)

    def cos(self) -> Intervals:
        """Cosines."""
        return self._wave(math.cos, math.sin)

    def _wave(self, value: Callable[[float], float], slope: Callable[[float], float]) -> Intervals:
        """|sin(m + d) - sin m| <= |cos m| |d| + d^2 / 2, and 2 at most; the same of cos."""
        known = np.abs(self.mid) <= LARGEST_ANGLE
        x, r = np.where(known, self.mid, 0.0), self.rad
        mid, rate = (np.vectorize(f, otypes=[float])(x) if x.size else x.copy() for f in (value, slope))
        rad = above(8.0 * U + (np.abs(rate) + 8.0 * U) * r + 0.5 * r * r, 5)
        return Intervals(mid, np.where(known, np.minimum(rad, 2.0), 2.0))

    def contains(self, x: object) -> Array:
        """Whether doubles x are surely in the intervals, entry by entry."""
        y = np.asarray(x, float)
        away = np.where(y == self.mid, 0.0, np.nextafter(np.abs(y - self.mid), np.inf))
        return np.asarray(away <= self.rad)

    def inside(self, other: Intervals) -> Array:
        """Whether they are surely in the interior of others, entry by entry."""
        return np.asarray((other.lower < self.lower) & (self.upper < other.upper))

    def positive(self) -> Array:
        """Whether they are surely above zero, entry by entry."""
        return np.asarray(self.lower > 0.0)

    def hull(self, other: Real) -> Intervals:
        """The smallest intervals that hold both."""
        b = Intervals.exact(other)
        return Intervals._between(np.minimum(self.lower, b.lower), np.maximum(self.upper, b.upper))

    def intersection(self, other: Real) -> Intervals:
        """What both have in common.

        Raises:
            InputError: if that is nothing.
        """
        b = Intervals.exact(other)
        lo, hi = np.maximum(self.lower, b.lower), np.minimum(self.upper, b.upper)
        if not (lo <= hi).all():
            raise InputError("intervals without a common number: one of them does not hold what it should.")
        return Intervals._between(lo, hi)

    def __str__(self) -> str:
        widest = float(self.width.max(initial=0.0))
        return f"intervals of shape {self.shape}, widest {widest:.1e}"


def product(a: Real, b: Real) -> Intervals:
    """Matrix products, of intervals or of exact doubles, by BLAS with an a-priori bound of its error [Rump2010]."""
    A, B = Intervals.exact(a), Intervals.exact(b)
    n = A.mid.shape[-1]
    sizes, beyond = np.abs(A.mid), np.abs(B.mid)
    rad = (n * U * 1.0000001) * (sizes @ beyond)
    if B.rad.any():
        rad = rad + sizes @ B.rad
    if A.rad.any():
        rad = rad + A.rad @ (beyond + B.rad)
    return Intervals(np.asarray(A.mid @ B.mid), above(rad, n + 5))


def sums(terms: Array, extra: Array | float = 0.0) -> tuple[Array, Array, Array]:
    """(high, low, rad): sums along the last axis, |sum - (high + low)| <= rad, as if computed with twice the digits.

    Args:
        terms: Doubles, shape (..., n).
        extra: Upper bounds of what else is in the sums, shape (...).
    """
    lost, sizes, n = np.zeros(terms.shape[:-1]), np.zeros(terms.shape[:-1]), terms.shape[-1]
    while terms.shape[-1] > 1:
        half = terms.shape[-1] // 2
        x, y = terms[..., :half], terms[..., half : 2 * half]
        s = x + y
        z = s - x
        e = (x - (s - z)) + (y - z)  # Knuth: s + e = x + y
        lost, sizes = lost + e.sum(axis=-1), sizes + np.abs(e).sum(axis=-1)
        terms = np.concatenate([s, terms[..., 2 * half :]], axis=-1)
    top = terms[..., 0] if terms.shape[-1] else lost
    high = top + lost
    z = high - top
    low = (top - (high - z)) + (lost - z)
    return high, low, above((n + 8) * U * sizes + extra, n + 8)


def products(x: Array, y: Array) -> tuple[Array, Array]:
    """(p, e): x y = p + e entry by entry, up to `TINY`, by Dekker's method."""
    p = x * y
    a, b = _SPLIT * x, _SPLIT * y
    xh, yh = a - (a - x), b - (b - y)
    xl, yl = x - xh, y - yh
    return p, xl * yl - (((p - xh * yh) - xl * yh) - xh * yl)


def residual(parts: list[tuple[Array, Array]], added: list[Array], extra: Array | float = 0.0) -> tuple[Array, Array, Array]:
    """(high, low, rad) of sum_k A_k x_k + sum of `added`, with exact doubles, as `sums` gives them, shape (m,).

    Args:
        parts: (A, x) with shapes (m, n) and (n,).
        added: Vectors, shape (m,).
        extra: Upper bounds of what else is in the sums, shape (m,).
    """
    terms = [part for A, x in parts for part in products(A, np.broadcast_to(x, A.shape))]
    return sums(np.concatenate([*terms, *[v[:, None] for v in added]], axis=1), extra + TINY)


def bounded_by(E: Array, start: Array, *, steps: int = 12) -> Array | None:
    """Bounds v > 0 with start + E v < v, so that the spectral radius of E >= 0 is below 1; None where none was found.

    Args:
        E: Upper bounds, non-negative, shape (n, n).
        start: Likewise, shape (n,).
        steps: Widenings that are tried.
    """
    n, floor = len(start), TINY + 1e-30 * float(start.max(initial=0.0))
    v = start * 1.1 + floor
    for _ in range(steps):
        image = above(start + E @ v, n + 1)
        if not np.isfinite(image).all():
            return None
        if (image < v).all():
            return v
        v = 1.1 * np.maximum(image, v) + floor
    return None


def solve(A: Real, b: Real, x: Array | None = None) -> Intervals | None:
    """The solutions of A x = b for all A and b in intervals: Krawczyk's test with an approximate inverse; None where it fails.

    That every A is regular is shown too: |I - R A| v < v for some v > 0.

    Args:
        A: Shape (n, n).
        b: Shape (n,).
        x: An approximate solution, or None.
    """
    K, c = Intervals.exact(A), Intervals.exact(b)
    try:
        R = np.linalg.inv(K.mid)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(R).all():
        return None
    x = R @ c.mid if x is None else x
    for _ in range(2):  # one step with the accurate residual leaves the last digits
        high, low, rad = residual([(-K.mid, x)], [c.mid])
        x = x + R @ high
    high, low, rad = residual([(-K.mid, x)], [c.mid])
    rad = above(rad + c.rad + K.rad @ np.abs(x) + np.abs(low), len(x) + 4)
    step = product(R, Intervals(high, rad))
    E = product(R, K)
    contraction = above(np.abs(np.eye(len(x)) - E.mid) + E.rad, 3)
    v = bounded_by(contraction, step.size)
    if v is None:
        return None
    return Intervals.exact(x) + Intervals(step.mid, above(step.rad + contraction @ v, len(x) + 2))


def positive_definite(A: Array, factor: Array) -> bool:
    """Whether x^T A x > 0 for all x other than zero, shown from an approximate Cholesky factor L of A.

    With R = L^-1 approximately, |I - R A R^T| < 1 in the 2-norm leaves no such x.

    Args:
        A: Exact doubles, shape (n, n).
        factor: L, lower triangular (the rest is not read), shape (n, n).
    """
    try:
        R = np.linalg.inv(np.tril(factor))
    except np.linalg.LinAlgError:
        return False
    E = product(product(R, A), R.T)
    off = above(np.abs(np.eye(len(A)) - E.mid) + E.rad, 3)
    by_rows, by_columns = off.sum(axis=1).max(initial=0.0), off.sum(axis=0).max(initial=0.0)
    return bool(by_rows * by_columns < 0.99)
