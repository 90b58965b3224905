"""A chain's motion in numbers, for many samples at once: linear in the number of links, no symbols.

Written from the structure, as the recursion over segments, points as complex numbers x + i y: a segment is ell e^(i psi), its
absolute rates are running sums of joint rates, and every sum over links is a product with the lengths. Samples go in blocks,
links along the first axis.
What it computes equals the symbols of `rbd.planar.kinematics`; a test compares them.

How freely the end point moves in each direction, how strongly it pushes: joint velocities of |qd| <= 1 rad/s make end-point
velocities in {v : v^T (J J^T)^-1 v <= 1}, an ellipse whose semi-axes are the singular values of J. Joint torques of |tau| <=
1 N m balance forces in {f : f^T J J^T f <= 1}, tau = J^T f being the virtual work: the same axes, the reciprocal lengths.
Where the chain moves easily it pushes weakly. Manipulability is sqrt(det J J^T), the velocity ellipse's area over pi
[Yoshikawa1985]. The unit ball of rates depends on how angles are measured, and so do the ellipses: robots measure joint angles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array, as_float, check_whole, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice
from rbd.planar.angles import JOINT, SEGMENT, VERTICAL, AngleMap, angle_map, samples, units
from rbd.planar.expressions import check_motion
from rbd.planar.kinematics import Split, check_joint

VELOCITY, FORCE = "velocity", "force"
ROUND_OFF = 8 * float(np.finfo(float).eps)
"""A point this near an edge of what the chain can reach, relative to its length, is on it: the point is no more accurate."""
CELLS = 8192
"""Numbers per array of a block: a dozen of them stay in the cache."""


@dataclass(frozen=True, eq=False)
class Ellipse(Displayed):
    """The ellipse of velocities, or of forces, that a point of a chain can have.

    Attributes:
        kind: "velocity" or "force".
        centre: The point, shape (2,) [m].
        semi_axes: Their lengths, longest first, shape (2,) [m/s per rad/s, or N per N m]; at a singular configuration the
            velocity ellipse has a zero, the force ellipse an infinite one.
        directions: Unit vectors along them as columns, shape (2, 2); x not negative.
        manipulability: sqrt(det J J^T) [m^2], zero where singular; the same of both kinds.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 0.5])
        >>> ellipse = arm.ellipse([0.0, np.pi / 2])
        >>> ellipse.semi_axes.round(4), round(ellipse.manipulability, 4), ellipse.is_singular
        (array([1.1441, 0.437 ]), 0.5, False)
    """

    kind: str
    centre: Array
    semi_axes: Array
    directions: Array
    manipulability: float

    @property
    def is_singular(self) -> bool:
        """Whether one direction is lost."""
        return self.manipulability == 0.0

    def points(self, count: int = 100, *, scale: float = 1.0, longest: float = np.inf) -> Array:
        """The closed outline about the centre, shape (count, 2) [m], semi-axes times `scale` and cut at `longest`.

        Raises:
            InputError: if an axis is infinite and `longest` is too, or numbers are not positive.
        """
        check_whole("count", count, 100_000, least=3)
        if not (0.0 < as_float(scale) < np.inf and as_float(longest) > 0.0):
            raise InputError(f"scale is {scale!r:.80}, longest is {longest!r:.80}; expected positive numbers.")
        axes = np.minimum(scale * self.semi_axes, longest)
        if not np.isfinite(axes).all():
            raise InputError("at a singular configuration the force ellipse has an infinite axis; give `longest` to cut it.")
        around = np.linspace(0.0, 2.0 * np.pi, int(count))
        return self.centre + np.column_stack([axes[0] * np.cos(around), axes[1] * np.sin(around)]) @ self.directions.T


@dataclass(frozen=True, eq=False)
class ChainNumbers:
    """Numeric kinematics of a chain whose lengths are numbers; angles follow the chain's convention.

    Every function takes arrays of shape (n,) or (samples, n), of one shape, and returns one value or (samples, ...); `i` is the
    joint, 0 the base, None the end point. All raise `InputError` on other shapes, numbers that are not finite, and joints
    that are not there.

    Attributes:
        ell: Its lengths, shape (n,) [m].
        angles: How its angles are measured; see `rbd.planar.angles`.
        outer: The farthest that the end point gets from the base [m]: the sum of the lengths.
        inner: The nearest [m]: the longest link less all others, or zero.
    """

    ell: Array
    angles: str
    outer: float
    inner: float

    @classmethod
    def of(cls, lengths: tuple[sympy.Expr, ...], angles: str) -> ChainNumbers:
        """The functions of a chain with these lengths.

        Raises:
            InputError: if its lengths are symbols.
        """
        if not all(length.is_number for length in lengths):
            first = ", ".join(str(length) for length in lengths[:4])
            raise InputError(
                f"lengths are symbols ({first}); numbers are needed [m], as chain.with_lengths([0.5] * {len(lengths)}). Only "
                "inverse_formulas does without, for one and two links."
            )
        # Sums of the exact lengths: 0.1 + 0.2 - 0.3 is no hole.
        total, longest = sum(lengths), max(lengths, key=float)
        return cls(np.array([float(length) for length in lengths]), angles, float(total), max(float(2 * longest - total), 0.0))

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.ell)

    @lazy
    def to_segment(self) -> AngleMap:
        """From its angles to those of the links from x, psi = A q + b."""
        return angle_map(self.n, self.angles, SEGMENT)

    @property
    def from_segment(self) -> AngleMap:
        """The map back."""
        return self.to_segment.inverse

    @lazy
    def ends(self) -> Array:
        """Lengths of the links that lead to each joint, zeros beyond it [m], shape (n + 1, n)."""
        return np.tril(np.ones((self.n + 1, self.n)), -1) * self.ell

    def positions(self, q: Any) -> Array:
        """Positions of all joints from the base to the end point [m], shape (n + 1, 2) or (samples, n + 1, 2)."""
        return self._run(lambda q: self.ends @ self._directions(q), (q,))

    def position(self, q: Any, i: int | None = None) -> Array:
        """Position of joint i [m], shape (2,) or (samples, 2)."""
        return self._motion(i, q)

    def velocity(self, q: Any, qd: Any, i: int | None = None) -> Array:
        """Velocity of joint i [m/s], shape (2,) or (samples, 2)."""
        return self._motion(i, q, qd)

    def acceleration(self, q: Any, qd: Any, qdd: Any, i: int | None = None) -> Array:
        """Acceleration of joint i [m/s^2], shape (2,) or (samples, 2)."""
        return self._motion(i, q, qd, qdd)

    def jerk(self, q: Any, qd: Any, qdd: Any, qddd: Any, i: int | None = None) -> Array:
        """Jerk of joint i [m/s^3], shape (2,) or (samples, 2)."""
        return self._motion(i, q, qd, qdd, qddd)

    def jacobian(self, q: Any, i: int | None = None) -> Array:
        """Jacobian of joint i [m], shape (2, n) or (samples, 2, n): v = J qd."""
        return self._slope(i, q)

    def jacobian_rate(self, q: Any, qd: Any, i: int | None = None) -> Array:
        """Time derivative of the Jacobian of joint i [m/s], shape (2, n) or (samples, 2, n)."""
        return self._slope(i, q, qd)

    def jacobian_second_rate(self, q: Any, qd: Any, qdd: Any, i: int | None = None) -> Array:
        """Second time derivative of the Jacobian of joint i [m/s^2], shape (2, n) or (samples, 2, n)."""
        return self._slope(i, q, qd, qdd)

    def split(self, q: Any, qd: Any, qdd: Any, i: int | None = None) -> Split[Array]:
        """Acceleration of joint i in its three parts [m/s^2], each of shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(q: Array, qd: Array, qdd: Array) -> Array:
            u, (own, mixed) = self._directions(q), self._squares(qd)
            return np.stack([ell @ (1j * self._rates(qdd) * u), -(ell @ (own * u)), -(ell @ (mixed * u))])

        parts = self._run(block, (q, qd, qdd))
        return Split(parts[..., 0, :], parts[..., 1, :], parts[..., 2, :], self.angles)

    def ellipse(self, q: Sequence[float] | Array, kind: str, i: int | None = None) -> Ellipse:
        """Velocity or force ellipse of joint i at one configuration; see `Chain.ellipse`."""
        check_choice("the kind of an ellipse", kind, (VELOCITY, FORCE))
        joint, given = check_joint(self.n, i, first=1), samples("q", q, self.n)
        if given.ndim != 1:
            raise InputError(f"q came with shape {given.shape}; expected one configuration, ({self.n},).")
        U, sigma, _ = np.linalg.svd(self.jacobian(given, joint))
        axes = np.array([sigma[0], sigma[1] if len(sigma) == 2 else 0.0])
        # Rounding leaves a link on a line 1e-16 off it: below that, the direction is lost.
        if axes[1] <= 8 * self.n * np.finfo(float).eps * axes[0]:
            axes[1] = 0.0
        manipulability = float(axes[0] * axes[1])
        if kind == FORCE:
            with np.errstate(divide="ignore"):
                axes, U = 1.0 / axes[::-1], U[:, ::-1]
        signs = np.where((U[0] < 0.0) | ((U[0] == 0.0) & (U[1] < 0.0)), -1.0, 1.0)
        return Ellipse(kind, self.position(given, joint), axes, U * signs, manipulability)

    # What the end point reaches

    def distance(self, points: Array) -> Array:
        """Distances of points to the set that the end point can reach [m], shape (...)."""
        r = np.hypot(points[..., 0], points[..., 1])
        return np.maximum(np.maximum(r - self.outer, self.inner - r), 0.0)

    def reachable(self, distance: Array, tolerance: float) -> Array:
        """Whether points at such distances count as within reach, shape (...)."""
        return distance <= max(tolerance, ROUND_OFF) * self.outer

    def nearest(self, points: Array, direction: Array) -> Array:
        """The nearest points within reach [m], shape (..., 2); for the base itself, the one in a direction [rad]."""
        r = np.hypot(points[..., 0], points[..., 1])
        inside = (r >= self.inner) & (r <= self.outer)
        away = np.where(r > 0.0, np.arctan2(points[..., 1], points[..., 0]), direction)
        return np.where(inside[..., None], points, np.clip(r, self.inner, self.outer)[..., None] * units(away))

    def beyond(self, target: Array) -> str:
        """Position of an unreachable target, for a message."""
        r = float(np.hypot(*target))
        if self.n == 1:
            side = "outside" if r > self.outer else "inside"
            return f"{side} the circle of radius {self.outer:g} m, all that one link reaches"
        if r > self.outer:
            return f"beyond {self.outer:g} m, where the chain is stretched out"
        return f"in the hole of radius {self.inner:g} m around the base, as one link is longer than all others together"

    def _up_to(self, i: int | None) -> Array:
        """Lengths of the links before joint i, zeros beyond."""
        if i is None:
            return self.ell
        ell = self.ell.copy()
        ell[check_joint(self.n, i) :] = 0.0
        return ell

    def _motion(self, i: int | None, *given: Any) -> Array:
        """The position of joint i, or its derivative by time as often as rates are given."""
        ell = self._up_to(i)
        return self._run(lambda *x: ell @ self._vectors(*x), given)

    def _slope(self, i: int | None, *given: Any) -> Array:
        """The Jacobian of joint i, or its derivative: joint j turns every link after it (or that of segment j alone)."""
        ell = 1j * self._up_to(i)[:, None]

        def block(*x: Array) -> Array:
            segments = ell * self._vectors(*x)
            return _running(segments[::-1])[::-1] if self.angles == JOINT else segments

        return self._run(block, given).swapaxes(-1, -2)

    def _vectors(self, q: Array, *rates: Array) -> Array:
        """Derivatives of e^(i psi) by time, as many as there are rates, (n, samples)."""
        u = self._directions(q)
        if not rates:
            return u
        w, *higher = (self._rates(x) for x in rates)
        if not higher:
            return 1j * w * u
        if len(higher) == 1:
            return (1j * higher[0] - w * w) * u
        return (1j * (higher[1] - w * w * w) - 3.0 * w * higher[0]) * u  # NumPy's w**3 is fifty times as slow

    def _rates(self, rates: Array) -> Array:
        """Rates of the segments' absolute angles, (n, samples)."""
        return _running(rates) if self.angles == JOINT else rates

    def _directions(self, q: Array) -> Array:
        """Unit vectors along the segments, e^(i psi), (n, samples)."""
        out = np.empty(q.shape, complex)
        if self.angles == VERTICAL:  # psi = q - pi/2, exactly
            out.real, out.imag = np.sin(q), -np.cos(q)
        else:
            psi = self._rates(q)
            out.real, out.imag = np.cos(psi), np.sin(psi)
        return out

    def _squares(self, qd: Array) -> tuple[Array, Array]:
        """Each segment's squared rate as its squares and its mixed products, (n, samples) each.

        (qd_1 + .. + qd_k)^2 = sum_j qd_j^2 + 2 sum_j qd_j (qd_1 + .. + qd_{j-1}): without subtraction.
        """
        if self.angles != JOINT:
            return qd**2, np.zeros_like(qd)
        before = np.zeros_like(qd)
        before[1:] = _running(qd[:-1])
        return _running(qd**2), 2.0 * _running(qd * before)

    def _run(self, block: Callable[..., Array], given: tuple[Any, ...]) -> Array:
        """X and y of a function's complex numbers (..., samples) over blocks of (n, samples), shape (samples, ..., 2)."""
        checked = check_motion(self.n, given, len(given))
        if checked[0].ndim == 1:  # one sample: nothing to cut or to turn
            return block(*[x[:, None] for x in checked]).view(float)
        step = max(1, CELLS // self.n)
        starts = range(0, max(1, len(checked[0])), step)
        parts = [np.ascontiguousarray(block(*[np.ascontiguousarray(x[k : k + step].T) for x in checked]).T) for k in starts]
        z = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return z.view(float).reshape(*z.shape, 2)


def _running(rows: Array) -> Array:
    """Running sums down the rows; NumPy walks across them, ten times as slow for long ones."""
    if rows.shape[1] < 16:
        return np.add.accumulate(rows)
    out = rows.copy()
    for k in range(1, len(out)):
        out[k] += out[k - 1]
    return out
