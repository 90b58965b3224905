"""A chain's motion in numbers, for many samples at once: linear in the number of links, no symbols.

Written from the structure, as the recursion over segments: absolute rates are running sums of joint rates, one sine and one
cosine per segment, and every sum over links is a product with the lengths. Samples go in blocks, links along the first axis.
What it computes equals the symbols of `rbd.planar.kinematics`; a test compares them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.planar.angles import JOINT, VERTICAL
from rbd.planar.compiled import check_motion
from rbd.planar.kinematics import Split, check_joint

CELLS = 8192
"""Numbers per array of a block: a dozen of them stay in the cache."""
Block = Callable[..., Array]


@dataclass(frozen=True, eq=False)
class ChainNumbers:
    """Numeric kinematics of a chain whose lengths are numbers; angles are measured as the chain does.

    Every function takes arrays of shape (n,) or (samples, n), all alike, and returns one value or (samples, ...); `i` is the
    joint, 0 the base, None the end point. All raise `InputError` on other shapes, numbers that are not finite, and joints
    that are not there.

    Attributes:
        ell: Its lengths, shape (n,) [m].
        angles: How its angles are measured; see `rbd.planar.angles`.
    """

    ell: Array
    angles: str

    @classmethod
    def of(cls, lengths: tuple[sympy.Expr, ...], angles: str) -> ChainNumbers:
        """The functions of a chain with these lengths.

        Raises:
            InputError: if its lengths are symbols.
        """
        if not all(length.is_number for length in lengths):
            first = ", ".join(str(length) for length in lengths[:4])
            raise InputError(
                f"lengths are symbols ({first}); numbers are needed [m], as chain.with_lengths([0.5] * {len(lengths)})."
            )
        return cls(np.array([float(length) for length in lengths]), angles)

    @property
    def n(self) -> int:
        """How many links."""
        return len(self.ell)

    def positions(self, q: Any) -> Array:
        """Positions of all joints from the base to the end point [m], shape (n + 1, 2) or (samples, n + 1, 2)."""
        n = self.n

        def block(out: Array, q: Array) -> None:
            s, c = self._directions(q)
            out[:, 0] = 0.0
            out[:, 1:, 0] = _running(self.ell[:, None] * c).T
            out[:, 1:, 1] = _running(self.ell[:, None] * s).T

        return self._run(block, (n + 1, 2), (q,))

    def position(self, q: Any, i: int | None = None) -> Array:
        """Position of joint i [m], shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(out: Array, q: Array) -> None:
            s, c = self._directions(q)
            out[:, 0], out[:, 1] = ell @ c, ell @ s

        return self._run(block, (2,), (q,))

    def velocity(self, q: Any, qd: Any, i: int | None = None) -> Array:
        """Velocity of joint i [m/s], shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(out: Array, q: Array, qd: Array) -> None:
            s, c = self._directions(q)
            w = self._rates(qd)
            out[:, 0], out[:, 1] = -(ell @ (w * s)), ell @ (w * c)

        return self._run(block, (2,), (q, qd))

    def acceleration(self, q: Any, qd: Any, qdd: Any, i: int | None = None) -> Array:
        """Acceleration of joint i [m/s^2], shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(out: Array, q: Array, qd: Array, qdd: Array) -> None:
            s, c = self._directions(q)
            w2, alpha = self._rates(qd) ** 2, self._rates(qdd)
            out[:, 0], out[:, 1] = -(ell @ (alpha * s + w2 * c)), ell @ (alpha * c - w2 * s)

        return self._run(block, (2,), (q, qd, qdd))

    def jerk(self, q: Any, qd: Any, qdd: Any, qddd: Any, i: int | None = None) -> Array:
        """Jerk of joint i [m/s^3], shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(out: Array, q: Array, qd: Array, qdd: Array, qddd: Array) -> None:
            s, c = self._directions(q)
            w = self._rates(qd)
            along, across = 3.0 * w * self._rates(qdd), self._rates(qddd) - w * w * w  # NumPy's w**3 is fifty times as slow
            out[:, 0], out[:, 1] = -(ell @ (along * c + across * s)), ell @ (across * c - along * s)

        return self._run(block, (2,), (q, qd, qdd, qddd))

    def jacobian(self, q: Any, i: int | None = None) -> Array:
        """Jacobian of joint i [m], shape (2, n) or (samples, 2, n): v = J qd."""
        ell = self._up_to(i)[:, None]

        def block(out: Array, q: Array) -> None:
            s, c = self._directions(q)
            out[:, 0], out[:, 1] = self._columns(-ell * s).T, self._columns(ell * c).T

        return self._run(block, (2, self.n), (q,))

    def jacobian_rate(self, q: Any, qd: Any, i: int | None = None) -> Array:
        """Time derivative of the Jacobian of joint i [m/s], shape (2, n) or (samples, 2, n)."""
        ell = self._up_to(i)[:, None]

        def block(out: Array, q: Array, qd: Array) -> None:
            s, c = self._directions(q)
            w = ell * self._rates(qd)
            out[:, 0], out[:, 1] = self._columns(-w * c).T, self._columns(-w * s).T

        return self._run(block, (2, self.n), (q, qd))

    def split(self, q: Any, qd: Any, qdd: Any, i: int | None = None) -> Split[Array]:
        """Acceleration of joint i in its three parts [m/s^2], each of shape (2,) or (samples, 2)."""
        ell = self._up_to(i)

        def block(out: Array, q: Array, qd: Array, qdd: Array) -> None:
            s, c = self._directions(q)
            alpha = self._rates(qdd)
            own, mixed = self._squares(qd)
            out[:, 0, 0], out[:, 0, 1] = -(ell @ (alpha * s)), ell @ (alpha * c)
            out[:, 1, 0], out[:, 1, 1] = -(ell @ (own * c)), -(ell @ (own * s))
            out[:, 2, 0], out[:, 2, 1] = -(ell @ (mixed * c)), -(ell @ (mixed * s))

        parts = self._run(block, (3, 2), (q, qd, qdd))
        return Split(parts[..., 0, :], parts[..., 1, :], parts[..., 2, :], self.angles)

    def _up_to(self, i: int | None) -> Array:
        """Lengths of the links before joint i, zeros beyond."""
        ell = self.ell.copy()
        ell[check_joint(self.n, i) :] = 0.0
        return ell

    def _rates(self, rates: Array) -> Array:
        """Rates of the segments' absolute angles, (n, samples)."""
        return _running(rates) if self.angles == JOINT else rates

    def _directions(self, q: Array) -> tuple[Array, Array]:
        """Sine and cosine of the segments' absolute angles, (n, samples) each."""
        if self.angles == VERTICAL:  # phi = q - pi/2, exactly
            return -np.cos(q), np.sin(q)
        phi = self._rates(q)
        return np.sin(phi), np.cos(phi)

    def _columns(self, segments: Array) -> Array:
        """Columns of the Jacobian out of the segments' shares: joint j moves every link after it."""
        return _running(segments[::-1])[::-1] if self.angles == JOINT else segments

    def _squares(self, qd: Array) -> tuple[Array, Array]:
        """Each segment's squared rate in its own squares and its mixed products, (n, samples) each.

        (qd_1 + .. + qd_k)^2 = sum_j qd_j^2 + 2 sum_j qd_j (qd_1 + .. + qd_{j-1}): nothing is subtracted.
        """
        if self.angles != JOINT:
            return qd**2, np.zeros_like(qd)
        before = np.zeros_like(qd)
        before[1:] = _running(qd[:-1])
        return _running(qd**2), 2.0 * _running(qd * before)

    def _run(self, block: Callable[..., None], shape: tuple[int, ...], given: tuple[Any, ...]) -> Array:
        """Check, cut into blocks of (n, samples), fill."""
        n = self.n
        checked = check_motion(n, given, len(given))
        rows = [x.reshape(-1, n) for x in checked]
        out = np.empty((len(rows[0]), *shape))
        step = max(1, CELLS // n)
        for start in range(0, len(out), step):
            part = slice(start, start + step)
            block(out[part], *(np.ascontiguousarray(x[part].T) for x in rows))
        return out.reshape(checked[0].shape[:-1] + shape)


def _running(rows: Array) -> Array:
    """Running sums down the rows; np.cumsum walks across them, ten times as slow for long ones."""
    if rows.shape[1] < 16:
        return np.cumsum(rows, axis=0)
    out = rows.copy()
    for k in range(1, len(out)):
        out[k] += out[k - 1]
    return out
