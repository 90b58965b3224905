"""Conic programs by another solver, SCS, an operator splitting: what it says of a program, from its definition alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scs
from scipy.sparse import csc_matrix

from rbd.arrays import Array
from rbd.problem.conic import Certificate, Conic


@dataclass(frozen=True, eq=False)
class Second:
    """What SCS says.

    Attributes:
        status: "solved", "infeasible", "unbounded", or anything else where it does not know.
        x: Shape (n,).
        value: 1/2 x . H x + g . x.
    """

    status: str
    x: Array
    value: float


def by_scs(program: Conic, *, eps: float = 1e-10, steps: int = 100_000) -> Second:
    """Minimise 1/2 x P x + c x with M x + s = h, s in a product of cones: (s_0, s_1, s_2) with |(s_1, s_2)| <= s_0."""
    n, I = len(program.g), np.eye(len(program.g))
    rows, side = [program.A], [program.b]
    for matrix, bound, sign in (
        (program.C, program.high, 1.0),
        (program.C, program.low, -1.0),
        (I, program.upper, 1.0),
        (I, program.lower, -1.0),
    ):
        there = np.isfinite(bound)
        rows.append(sign * matrix[there])
        side.append(sign * bound[there])
    for (t, s, normal), mu in zip(program.cones, program.mu, strict=True):
        rows.append(-np.array([mu * I[normal], I[t], I[s]]))
        side.append(np.zeros(3))
    M, h = np.vstack(rows), np.concatenate(side)
    cones = {"z": len(program.b), "l": len(h) - len(program.b) - 3 * len(program.mu), "q": [3] * len(program.mu)}
    data = {"P": csc_matrix(np.triu(program.H)), "A": csc_matrix(M), "b": h, "c": program.g}
    settings = {"verbose": False, "eps_abs": eps, "eps_rel": eps, "eps_infeas": 1e-9, "max_iters": steps}
    found = scs.SCS(data, cones, **settings).solve()
    x = np.asarray(found["x"])
    return Second(found["info"]["status"], x, program.value(x) if len(x) == n else np.nan)


def proof(program: Conic, certificate: Certificate) -> tuple[Array, float, float]:
    """(r, gap, left) of a certificate, from its definition: r = -A^T y - C^T z; the least of all terms; what r is outside by.

    y . b + least of z . s over low <= s <= high + least of r . x over X, and the largest part of r for which that is -inf.
    """
    y, z = certificate.y, certificate.z
    r = -(program.A.T @ y) - program.C.T @ z
    gap, left = float(y @ program.b), 0.0
    for k in range(len(z)):
        bound = program.low[k] if z[k] > 0.0 else program.high[k]
        gap += z[k] * bound if z[k] else 0.0
    in_cones = {int(c) for c in program.cones.ravel()}
    for j in set(range(len(r))) - in_cones:
        bound = program.lower[j] if r[j] > 0.0 else program.upper[j]
        if np.isfinite(bound):
            gap += r[j] * bound
        else:
            left = max(left, abs(r[j]))
    for (t, s, n), mu in zip(program.cones, program.mu, strict=True):
        # The dual of |x_t| <= mu x_n is mu |r_t| <= r_n: how far r is from it, by the nearest point of a half-plane.
        tangent = float(np.hypot(r[t], r[s]))
        if mu * tangent > r[n]:
            along = max(0.0, (tangent + mu * r[n]) / (1.0 + mu**2))  # of the nearest point of the edge: (along, mu along)
            sideways = (tangent - along) / tangent * max(abs(r[t]), abs(r[s])) if tangent else 0.0
            left = max(left, sideways, abs(float(r[n] - mu * along)))
    return r, gap, left
