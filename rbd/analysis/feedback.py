"""The part of the acceleration that Baumgarte stabilisation makes."""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas

from rbd.arrays import Array
from rbd.problem.law import Law
from rbd.problem.problem import GaussProblem
from rbd.problem.subspaces import RANK

CARRIES = 1e-9
"""A weight is active above this, times the largest weight (at least 1 N)."""


def feedback_acceleration(problem: GaussProblem, weights: Array | None, law: Law) -> Array:
    """The change of a that the feedback makes through the active rows, shape (nv,) [m/s2, rad/s2].

        da = M^-1 J^T G dw      with      H^T (J da + feedback) = 0

    over the columns of the sets whose weights can change: all where rows hold, rays and half-lines that carry something,
    weights between their bounds, second-order cones that stick; of a contact that slips, one column along its force, its
    direction held still. Where the active rows stay the same without the feedback, a - da is exactly the acceleration
    without it, but for slipping circular cones, whose direction turns.

    Args:
        problem: What was solved.
        weights: As `Answer.weights`; None where all rows hold.
        law: The law of the answer.
    """
    P = problem
    if not any(r.stabilised for r in P.rows):
        return np.zeros(P.nv)
    fed = P.offset - P.bias
    if not fed.any():
        return np.zeros(P.nv)
    G, H = _active(P, weights, law)
    B = P.whitened @ G
    if H is G:  # least squares in the inertia metric, where feedback contradicts itself
        moved = np.linalg.lstsq(B.T, -G.T @ fed, rcond=RANK)[0]
    else:
        moved = B @ np.linalg.lstsq((P.whitened @ H).T @ B, -H.T @ fed, rcond=RANK)[0]
    return np.asarray(blas.dtrsv(P.factor, moved, lower=1, trans=1))


def _active(P: GaussProblem, weights: Array | None, law: Law) -> tuple[Array, Array]:
    """(G, H) of the columns whose weights can change."""
    if weights is None:
        one = np.eye(P.m)
        return one, one
    small = CARRIES * max(1.0, float(np.abs(weights).max(initial=0.0)))
    T, found = P.force_set_of(law), [(np.zeros((P.m, 0)), np.zeros((P.m, 0)))]
    for e in T.elements:
        G, H, w = T.G[:, e.columns], T.H[:, e.columns], weights[e.columns]
        if not e.is_cone:
            free = (w > T.lower[e.columns] + small) & (w < T.upper[e.columns] - small)
            found.append((G[:, free], H[:, free]))
        elif w[2] > small:
            used = float(np.hypot(w[0], w[1]))
            if used < e.mu * w[2] - small:  # sticks
                found.append((G, H))
                continue
            along = G @ np.array([[e.mu * w[0] / used], [e.mu * w[1] / used], [1.0]])
            # Under Coulomb's law a point that slips keeps its normal still; under the convex one, its force's own direction.
            found.append((along, H[:, 2:] if law.kind == "coulomb" else along))
    G = np.hstack([g for g, _ in found])
    return G, G if T.H is T.G and law.kind != "coulomb" else np.hstack([h for _, h in found])
