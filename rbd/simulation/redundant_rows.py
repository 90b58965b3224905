"""Held rows that repeat each other, at a pose that is a little off: what they say together, without what they say apart.

A hinge that closes a planar loop has five rows, two of which are independent; of the hinge that closes Bricard's mechanism
four of five are. That is so on the constraints only. Where the pose is off by `drift`, as in the middle of a step, the rows
differ from each other by as much, and all of them together would allow no motion. With W = L^-1 J^T and rows divided by their
norms, singular values below `OWED` times drift, over the largest, are therefore left out, and what the rows ask there too.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from rbd.arrays import Array, largest
from rbd.mechanism.projection import ZERO
from rbd.mechanism.stage_solver import INDEPENDENT, OWED


class RedundantRows:
    """The held rows of one layout; it remembers the largest norms that they had.

    Attributes:
        found: Whether those that it was asked for last repeat each other.
    """

    def __init__(self) -> None:
        self.found = False
        self._norms = np.zeros(0)

    def reduced(self, W: Array, c: Array, held: Array, drift: float) -> tuple[Array, Array, float]:
        """(W, c, the largest part of c that was left out): the same arrays where the held rows are well independent.

        Args:
            W: L^-1 J^T, shape (nv, m).
            c: Velocity of the rows less J v, shape (m,).
            held: Which rows are held, indices.
            drift: How far their position is off [m, rad].
        """
        H = W[:, held]
        norms = np.sqrt(np.einsum("ij,ij->j", H, H))
        if len(norms) == len(self._norms):
            norms = np.maximum(norms, self._norms)
        most = float(norms.max())
        self._norms = norms = np.maximum(norms, 1e-6 * most) if most > 0.0 else np.ones(len(norms))
        R, info = lapack.dpotrf(H.T @ H, lower=0, clean=0)
        self.found = info != 0 or not (R.diagonal() > INDEPENDENT * norms).all()
        if not self.found:
            return W, c, 0.0
        U, s, Vt = np.linalg.svd(H / norms, full_matrices=False)
        kept = s > max(ZERO, OWED * drift) * s[0]
        self.found = not kept.all() or len(s) < len(held)
        if not self.found:
            return W, c, 0.0
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        told = c[held] / norms
        within = Vt.T @ (Vt @ told)
        W, c = W.copy(), c.copy()
        W[:, held], c[held] = (U * s) @ Vt * norms, within * norms
        return W, c, largest((told - within) * norms)
