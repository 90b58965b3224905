"""How far linear functions reach over an admissible set: by linear programs; where cones are circular, along a barrier's path.

What is reached is attained: by forces on the planes that bound them; with circular cones strictly inside, within `EXACT` of
the end.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linprog

from rbd.analysis.admissible import Admissible, null_space
from rbd.analysis.barrier import ConeSet, interior, least
from rbd.arrays import Array

EXACT = 1e-10
"""How near an end is come to where cones are circular, over the size of the forces."""
_TOUCHING = 8
_FAR = 1e4
_THIN = ((1e8, "highs"), (1e8, "highs-ipm"), (1e6, "highs"))
"""What is open by less than one part in this is taken for shut; the program is hard at that scale, and asked in turn."""


class Reach:
    """The admissible set in coordinates of the directions that change no motion, in units of its size.

    x = start + size * basis @ z, D z >= d, cones.
    """

    def __init__(self, adm: Admissible) -> None:
        self.adm = adm
        self.basis = adm.null
        self.start = adm.start / adm.size
        self.shut = self._shut()
        inside = self._planes()[0] @ self.basis
        self.basis = self.basis @ null_space(inside[self.shut])[0]
        loose, _ = null_space(np.vstack([self._planes()[0], self._cone_rows()]) @ self.basis)
        self.loose = self.basis @ loose
        """Directions that no bound and no cone feels, shape (n, .)."""
        self.basis = self.basis @ null_space(loose.T)[0] if loose.size else self.basis
        self.closed = self._closed()
        self.thin = False
        """Whether circular cones leave the set no inside, so that they were widened by `EXACT`."""
        self.open_cones = ~self.shut[len(adm.d) :].reshape(len(adm.mu), _TOUCHING).all(axis=1)
        self.cones, self.centre = self._cone_set()

    @property
    def dimension(self) -> int:
        """Dimension of the set."""
        return self.basis.shape[1] + self.loose.shape[1]

    @property
    def directions(self) -> Array:
        """All directions within the set, shape (n, dimension)."""
        return np.hstack([self.basis, self.loose])

    def is_unique(self, functions: Array) -> bool:
        """Whether linear functions of x, shape (k, n), are constant over the set."""
        change = functions @ self.directions
        return bool(np.abs(change).max(initial=0.0) <= 1e-9 * max(1.0, float(np.abs(functions).max(initial=0.0))))

    def largest(self, function: Array) -> tuple[float, Array | None]:
        """(largest value of function . x, where it is attained); infinite and None where there is no end."""
        x0 = self.adm.start
        if self.is_unique(function[None]):
            return float(function @ x0), x0.copy()
        if np.abs(function @ self.loose).max(initial=0.0) > 1e-9 * np.abs(function).max():
            return math.inf, None
        if not self.closed and self._endless(function):
            return math.inf, None
        z = self._farthest(function @ self.basis)
        x = self.adm.kept(self.adm.size * (self.start + self.basis @ z))
        return float(function @ x), x

    def _planes(self) -> tuple[Array, Array]:
        """(normals, offsets): normals @ x >= offsets in units of size; planes that touch the cones in place of these."""
        adm, n = self.adm, len(self.start)
        angle = 2.0 * math.pi * np.arange(_TOUCHING) / _TOUCHING
        touching = np.zeros((len(adm.mu), _TOUCHING, n))
        for i, (at, mu) in enumerate(zip(adm.cone_at, adm.mu, strict=True)):
            inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(_TOUCHING, mu)])
            touching[i, :, at : at + 3] = inward / math.hypot(1.0, mu)
        flat = touching.reshape(len(adm.mu) * _TOUCHING, n)
        return np.vstack([adm.D, flat]), np.concatenate([adm.d / adm.size, np.zeros(len(flat))])

    def _cone_rows(self) -> Array:
        rows = np.zeros((3 * len(self.adm.mu), len(self.start)))
        rows[np.arange(len(rows)), self.adm.cone_columns.ravel()] = 1.0
        return rows

    def _shut(self) -> Array:
        """Planes that every point of the set lies on, by the point of the widened set that leaves most planes behind.

        x / theta is in the set; theta >= 1 scales the relative interior away from the planes.
        """
        normals, offsets = self._planes()
        q, z = len(offsets), self.basis.shape[1]
        if not q:
            return np.zeros(0, bool)
        if not z:
            return np.zeros(q, bool)
        gap = offsets - normals @ self.start
        # variables: z, theta, t <= 1: normals basis z - gap theta - t >= 0
        A = np.hstack([normals @ self.basis, -gap[:, None], -np.eye(q)])
        cost = np.concatenate([np.zeros(z + 1), -np.ones(q)])
        for scale, method in _THIN:
            limits = [(None, None)] * z + [(1.0, scale)] + [(0.0, 1.0)] * q
            found = linprog(cost, A_ub=-A, b_ub=np.zeros(q), bounds=limits, method=method)
            if found.status == 0:
                return np.asarray(found.x[z + 1 :] < 0.5)
        return np.zeros(q, bool)

    def _closed(self) -> bool:
        """Whether no direction of the set goes on for ever."""
        normals = self._planes()[0] @ self.basis
        if not normals.size:
            return True
        found = linprog(
            -normals.sum(axis=0), A_ub=-normals, b_ub=np.zeros(len(normals)), bounds=(-1.0, 1.0), method="highs", options=_TIGHT
        )
        return found.x is not None and -found.fun < 1e-7

    def _endless(self, function: Array) -> bool:
        """Whether the function grows for ever along some direction of the set."""
        q = function @ self.basis / np.abs(function @ self.basis).max()
        if self.cones is None:
            normals = self._planes()[0] @ self.basis
            found = linprog(-q, A_ub=-normals, b_ub=np.zeros(len(normals)), bounds=(-1.0, 1.0), method="highs", options=_TIGHT)
            return found.x is None or -found.fun > 1e-9
        on = self.cones
        away = ConeSet(on.A, np.zeros_like(on.b), on.C, np.zeros_like(on.at), on.mu).boxed(1.0).widened(EXACT)
        return float(q @ least(np.zeros((len(q), len(q))), -q, away, np.zeros(len(q)), 1e-6)) > 1e-4

    def _farthest(self, q: Array) -> Array:
        """Where q . z is largest, shape (z,)."""
        scale = float(np.abs(q).max())
        if self.cones is not None:
            inside = self.cones if self.closed else self.cones.boxed(_FAR)
            return least(np.zeros((len(q), len(q))), -q / scale, inside, self.centre, EXACT)
        normals, offsets = self._planes()
        A, b = normals @ self.basis, offsets - normals @ self.start
        found = linprog(-q / scale, A_ub=-A, b_ub=-b, bounds=(None, None), method="highs", options=_TIGHT)
        return np.zeros(len(q)) if found.x is None else _on_planes(A, b, found.x)

    def _cone_set(self) -> tuple[ConeSet | None, Array]:
        """(the set with its circular cones, a point strictly inside); None where all is flat."""
        adm, B = self.adm, self.basis
        z0 = np.zeros(B.shape[1])
        if not len(adm.mu):
            return None, z0
        kept, D = self.open_cones, adm.D[~self.shut[: len(adm.d)]]
        d = adm.d[~self.shut[: len(adm.d)]] / adm.size
        felt = np.abs(D @ B).max(axis=1, initial=0.0) > 1e-9
        C, at = B[adm.cone_columns[kept]], self.start[adm.cone_columns[kept]]
        on = ConeSet(D[felt] @ B, (d - D @ self.start)[felt], C, at, adm.mu[kept])
        centre = interior(on, z0, 0.01)
        if centre is not None:
            return on, centre
        self.thin = True
        return on.widened(EXACT), z0


_TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def _on_planes(A: Array, b: Array, z: Array) -> Array:
    """The point moved onto the planes that it touches: the last digits, which the program's tolerance leaves open."""
    touched = np.abs(A @ z - b) <= 1e-8
    if not touched.any():
        return z
    return np.asarray(z + np.linalg.lstsq(A[touched], b[touched] - A[touched] @ z, rcond=1e-12)[0])
