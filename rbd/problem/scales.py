"""Scales of residuals: the sizes of the terms of the same row or point, with lower bounds for what is at rest.

Every row of an equation has a separate scale: a finger of a milligram is checked as strictly as the pelvis that carries it.
A row whose terms are all near zero would have no scale. Every scale has a lower bound: for accelerations, 1 m/s2 (rad/s2);
for forces, the force that accelerates the coordinate, or the row, at 1 m/s2, at most 1 N.

    equations of motion, row i     max(|M| |a|, |rhs|, |J|^T |f|)_i,                    at least min(1, M_ii)
    row i of a constraint          (|J| |a| + |bias| + |feedback|)_i,                   at least 1
    column h of a set              |h|^T (the above)
    force of row i                 |f_i|,                                               at least min(1, 1 / D_ii)
    weights of a point             sum of |weights| of its columns, and bounds (*),      at least min(1, 1 / (n^T D n))
    momentum, component k          max(|A_g| |a| + |bias|, |wrench|, forces with their arms)_k,
                                                                                        at least min(1, max_j |A_g|_kj)

with D = J M^-1 J^T, and n the column of the point's normal. (*) Without bounds where distances to the law are measured. One
lever arm is the radius of gyration, with the largest of the linear terms: rounding of the forces on a base turns the body
about its centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.force_set import ForceSet
from rbd.problem.problem import GaussProblem, Law


class Scales:
    """Sizes of the equations' terms at one answer, in physical units."""

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
        # Moments about the centre of mass: those about the base, less the moment of the forces with the arm between.
        own[3:] = np.maximum(own[3:], np.sqrt(A[3:].max() / max(A[:3].max(), 1e-300)) * own[:3].max())
        return own

    def of_columns(self, weights: Array | None, law: Law) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns of the law's weights; of the rows where all are bilateral.

        Args:
            weights: As `Answer.weights`; None where all rows are bilateral.
            law: As `Answer.law`.
        """
        P = self._given[0]
        if P.bilateral or weights is None:
            return self.rows, self.row_forces
        return self.of_set(P.force_set_of(law), weights)

    def of_set(self, T: ForceSet, w: Array) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns of a force set, shapes (p,).

        The columns of a cone, or of its pyramid, share the scale of their weights; of a cone the two tangential ones share that
        of their accelerations.

        Args:
            T: The set.
            w: Its weights, shape (p,).
        """
        pushes = np.maximum(self.pushes(T, w), T.sums((np.abs(w) + T.bound_size) * (T.normal_share > 0.0)))
        return self.along(T), pushes[T.element_at]

    def along(self, T: ForceSet) -> Array:
        """Of the accelerations of the columns of a force set, shape (p,)."""
        along = np.abs(T.H).T @ self.rows + np.abs(T.offset)
        if len(T.mu):
            i, j, _ = T.cone_columns.T
            along[i] = along[j] = np.maximum(along[i], along[j])
        return along

    def pushes(self, T: ForceSet, w: Array) -> Array:
        """Of the weights of the elements of a force set, bounds left out, shape (e,)."""
        mobility = np.einsum("ij,ij->j", T.normals, self._given[0].delassus @ T.normals)
        return np.maximum(T.sums(np.abs(w) * (T.normal_share > 0.0)), least_forces(mobility))


def least_forces(mobility: Array | Sequence[float]) -> Array:
    """The force that accelerates a point of that mobility [1/kg] at 1 m/s2, 1 N at most."""
    return 1.0 / np.maximum(mobility, 1.0)
