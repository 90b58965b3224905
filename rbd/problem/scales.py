"""What residuals are measured against: the terms of the same row, or of the same point, and least sizes for what is at rest.

Every row of an equation has its own scale, so that a finger of a milligram is judged as strictly as the pelvis that carries it.
A row whose terms are all near zero would be compared with nothing. It is compared with a least size: 1 m/s2 (rad/s2) of
accelerations; of forces what accelerates the coordinate, or the row, at 1 m/s2, and never more than 1 N.

    equations of motion, row i     max(|M| |a|, |rhs|, |J|^T |f|)_i,                    at least min(1, M_ii)
    row i of a constraint          (|J| |a| + |bias| + |feedback|)_i,                   at least 1
    column h of a set              |h|^T (the above)
    force of row i                 |f_i|,                                               at least min(1, 1 / D_ii)
    weights of a point             sum of |weights| of its columns, and their bounds,   at least min(1, 1 / (n^T D n))
    momentum, component k          max(|A_g| |a| + |bias|, |wrench|, forces with their arms)_k,
                                                                                        at least min(1, max_j |A_g|_kj)

with D = J M^-1 J^T, and n the column of the point's normal. Of the arms of moments one is the radius of gyration, with the
largest of the linear terms: rounding of the forces on a base turns the body about its centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.law import Law
from rbd.problem.parts import Parts
from rbd.problem.problem import GaussProblem
from rbd.problem.rays import Rays


class Scales:
    """Sizes of the terms of the equations at one answer, in their units."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array) -> None:
        self._given = problem, a, f

    @lazy
    def equations(self) -> Array:
        """Of the equations of motion, shape (nv,) [N, N m]."""
        P, a, f = self._given
        terms = np.maximum(np.abs(P.M) @ np.abs(a), np.abs(P.rhs))
        return np.maximum(np.maximum(terms, np.abs(P.J).T @ np.abs(f)), np.minimum(P.M.diagonal(), 1.0))

    @lazy
    def rows(self) -> Array:
        """Of the rows' accelerations, shape (m,) [m/s2, rad/s2]."""
        P, a, _ = self._given
        return np.maximum(np.abs(P.J) @ np.abs(a) + P.offset_size, 1.0)

    @lazy
    def row_forces(self) -> Array:
        """Of the rows' forces, shape (m,) [N, N m]."""
        P, _, f = self._given
        return np.maximum(np.abs(f), least_forces(P.delassus.diagonal()))

    @lazy
    def momentum(self) -> Array:
        """Of the six components of the rate of centroidal momentum, shape (6,) [N, N m]."""
        P, a, f = self._given
        b = P.balance
        assert b is not None
        A = np.abs(b.A_g)
        own = np.maximum(np.maximum(A @ np.abs(a) + np.abs(b.rate_bias), np.abs(b.wrench)), np.minimum(A.max(axis=1), 1.0))
        for rows, part in zip(P.rows, P.slices.values(), strict=True):
            if rows.patch is not None and rows.patch.against is not None:
                continue
            if rows.resultant is not None and rows.patch is not None:
                wrench, point = np.abs(rows.resultant) @ np.abs(f[part]), rows.patch.point
            elif b.base is not None:
                point, axes = b.base
                force = np.abs(rows.J[:, :6]).T @ np.abs(f[part])
                wrench = np.concatenate([np.abs(axes) @ force[:3], np.abs(axes) @ force[3:]])
            else:
                continue
            own[: len(wrench)] = np.maximum(own[: len(wrench)], wrench)
            x, y, z = np.abs(point - b.com)
            own[3:] = np.maximum(own[3:], np.array([[0.0, z, y], [z, 0.0, x], [y, x, 0.0]]) @ wrench[:3])
        # Moments about the centre of mass are those about the base, less the forces' at the arm between.
        own[3:] = np.maximum(own[3:], np.sqrt(A[3:].max() / max(A[:3].max(), 1e-300)) * own[:3].max())
        return own

    def of_columns(self, weights: Array | None, law: Law) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns that the law's weights belong to: of rows that hold, rays, or parts.

        Args:
            weights: As `Answer.weights`; None where all rows hold.
            law: As `Answer.law`.
        """
        P = self._given[0]
        if P.bilateral or weights is None:
            return self.rows, self.row_forces
        if not law.facets:
            return self.of_parts(P.parts, weights)
        along, _, push, point = self.of_rays(P.rays, weights)
        return along, push[point]

    def of_rays(self, R: Rays, w: Array) -> tuple[Array, Array, Array, Array]:
        """(`along` rays, `normal` at points, `push` of points, point of each ray) for weights of `problem.rays`.

        Args:
            R: The rays.
            w: Their weights, shape (r,).

        Returns:
            Scales of the accelerations along each ray (r,) and along each point's normal (k,); of each point's weights (k,);
            the number of each ray's point (r,).
        """
        normals = R.normals
        point = np.repeat(np.arange(len(R.starts)), R.widths)
        terms = np.abs(w) + R.bound_size
        push = np.add.reduceat(terms, R.starts) if len(terms) else terms
        return np.abs(R.G).T @ self.rows, np.abs(normals).T @ self.rows, self._at_least(push, normals), point

    def of_parts(self, T: Parts, w: Array) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns of `problem.parts`, shapes (p,).

        The three columns of a cone share the scale of their weights, and the two tangential ones that of their accelerations.
        """
        push, along = self._at_least(np.abs(w) + T.bound_size, T.G), np.abs(T.H).T @ self.rows + np.abs(T.offset)
        if len(T.mu):
            i, j, n = T.cone_columns.T
            along[i] = along[j] = np.maximum(along[i], along[j])
            push[i] = push[j] = push[n]
        return along, push

    def _at_least(self, push: Array, normals: Array) -> Array:
        P = self._given[0]
        return np.maximum(push, least_forces(np.einsum("ij,ij->j", normals, P.delassus @ normals)))


def least_forces(mobility: Array | Sequence[float]) -> Array:
    """The force that moves something of that mobility [1/kg] at 1 m/s2, 1 N at most."""
    return 1.0 / np.maximum(mobility, 1.0)
