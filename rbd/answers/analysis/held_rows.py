"""Derivatives of an answer in which every row is bilateral or belongs to a sticking point, so that all rows are equations.

    M da - J^T df = r,        J da = -c

r is the change of the forces and inertia forces without the multipliers', c that of the rows' accelerations at fixed a. With
L L^T = M, X = L^-1 J^T = Q R and Q orthonormal, N = L^-1 - Q Q^T L^-1 and B = L^-T X (X^T X)^-1,

    da = N^T N r - B c,        df = -B^T r - (X^T X)^-1 c

It covers rows of full rank alone: the rest, and all other modes, is `rbd.answers.analysis.active_set`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.linalg import blas, lapack

from rbd.answers.analysis.modes import RESOLUTION
from rbd.arrays import Array, identity, max_abs
from rbd.problem.answer import Answer
from rbd.problem.cones import Cone
from rbd.problem.problem import GaussProblem

INDEPENDENT = 1e-6
"""Least pivot of X^T X over its diagonal: singular values of X above 1e-3, far from those that count as zero."""
ROOM = 1e-3
"""Corner forces this far inside their cones, over the largest row force, are no change of mode; nearer ones go another way."""


class HeldRows:
    """The equations of such an answer, factorised once.

    Attributes:
        words: {constraint: "holds" of each row or "sticks" of each corner}.
        internal: Row forces that cause no motion: none, shape (m, 0).
    """

    def __init__(self, problem: GaussProblem, words: dict[str, tuple[str, ...]], factor: Array) -> None:
        P = problem
        self.words, self.internal, self._R = words, np.zeros((P.m, 0)), factor
        E = blas.dtrsm(1.0, P.factor, identity(P.nv), lower=1)
        if not P.m:
            self._free, self._B = E.T @ E, np.zeros((P.nv, 0))
            return
        Q = blas.dtrsm(1.0, factor, P.whitened, side=1)
        N = E - Q @ (Q.T @ E)
        self._free = N.T @ N
        self._B = E.T @ blas.dtrsm(1.0, factor, Q, side=1, trans_a=1)

    @classmethod
    def of(cls, answer: Answer) -> HeldRows | None:
        """The equations, or None where they are not surely those of the answer."""
        P = answer.problem
        words = {}
        c = None
        load = max(1.0, max_abs(answer.multipliers))
        for r in P.rows:
            if answer.weights is None or r.cone.bilateral or not len(r):
                words[r.name] = ("holds",) * len(r)
                continue
            span, points = P.slices[r.name], _sticking_weights(r.cone, answer.multipliers[P.slices[r.name]])
            c = P.J @ answer.a + P.offset if c is None else c
            if points is None or r.speed > 0.1 * P.rest_speed or max_abs(c[span]) > 0.1 * RESOLUTION:
                return None
            w, mu = points
            room = (mu * w[:, 2] - np.hypot(w[:, 0], w[:, 1])).min()
            if not room > ROOM * mu * load:
                return None
            words[r.name] = ("sticks",) * len(w)
        factor, info = lapack.dpotrf(P.delassus, lower=0, clean=1) if P.m else (np.zeros((0, 0)), 0)
        if info or (factor.diagonal() ** 2 < INDEPENDENT * P.delassus.diagonal()).any():
            return None
        return cls(P, words, factor)

    def derivative(self, r: Array, c: Array, u: Array) -> tuple[Array, Array]:
        """(da, df): change of the acceleration and of the row forces, shapes (nv, n) and (m, n).

        Args:
            r: Change of forces less inertia forces at fixed a and f, shape (nv, n) [N, N m].
            c: Change of the rows' accelerations at fixed a, shape (m, n).
            u: Change of the rows' velocities, shape (m, n); it has no effect.
        """
        if not len(c):
            return self._free @ r, c
        return self._free @ r - self._B @ c, -(self._B.T @ r) - lapack.dpotrs(self._R, c)[0]

    def by_force(self) -> tuple[Array, Array]:
        """(da, df) by a generalised force, shapes (nv, nv) and (m, nv)."""
        return self._free.copy(), -self._B.T

    def by_friction(self, names: Sequence[str]) -> tuple[Array, Array]:
        """(da, df) by friction coefficients: zero, as nothing slips, shapes (nv, n) and (m, n)."""
        return np.zeros((len(self._free), len(names))), np.zeros((len(self.internal), len(names)))

    def response(self, r: Array) -> Array:
        """Acceleration by a generalised force r under the rows, shape (nv, n)."""
        return self._free @ r


def _sticking_weights(cone: Cone, f: Array) -> tuple[Array, float] | None:
    """(weights of minimum norm of row forces f, shape (k, 3), their coefficient); None of sets that are not all friction."""
    inverse, mu = _split(cone)
    return ((inverse @ f).reshape(-1, 3), mu) if mu else None


@lru_cache(maxsize=256)
def _split(cone: Cone) -> tuple[Array, float]:
    G, parts = cone.generators()
    return np.linalg.pinv(G), parts[0].mu if len({part.mu for part in parts}) == 1 else 0.0
