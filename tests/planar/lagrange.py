"""Lagrange's equations by differentiation, for any kinetic and potential energy.

`rbd.planar.dynamics` writes the equations of a chain down at once; what is here derives them independently. Coordinates are
functions of time, theta_i(t).

    tau_i = d/dt (dT/d qd_i) - dT/d q_i + dV/d q_i = sum_j M_ij qdd_j + sum_jk G_ijk qd_j qd_k + g_i
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp


def euler_lagrange(T: sp.Expr, V: sp.Expr, q: sp.Matrix, t: sp.Symbol) -> sp.Matrix:
    """Generalised forces tau(q, qd, qdd) that a motion needs, shape (n, 1) [N m for angles].

    Args:
        T: Kinetic energy, in q and its rates [J].
        V: Potential energy, in q [J].
        q: Coordinates, functions of t, shape (n, 1).
        t: Time.

    """
    return sp.Matrix([T.diff(x.diff(t)).diff(t) - T.diff(x) + V.diff(x) for x in q])


def mass_matrix(T: sp.Expr, rates: sp.Matrix) -> sp.Matrix:
    """M(q) of T = 1/2 qd^T M qd, shape (n, n): the second derivatives by the rates."""
    return sp.hessian(T, list(rates))


def christoffel(M: sp.Matrix, q: sp.Matrix) -> sp.ImmutableDenseNDimArray:
    """Christoffel symbols of the first kind, G_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i), shape (n, n, n) [kg m2].

    sum_jk G_ijk qd_j qd_k is the force of Coriolis and centrifugal terms on coordinate i: G_ijj is centrifugal, G_ijk + G_ikj
    Coriolis.
    """
    n = len(q)
    slope = [M.diff(x) for x in q]
    entries = [(slope[k][i, j] + slope[j][i, k] - slope[i][j, k]) / 2 for i in range(n) for j in range(n) for k in range(n)]
    return sp.ImmutableDenseNDimArray(entries, (n, n, n))


def coriolis_matrix(G: sp.NDimArray, rates: sp.Matrix) -> sp.Matrix:
    """C(q, qd) with C_ij = sum_k G_ijk qd_k, shape (n, n): the one for which Mdot - 2 C is skew."""
    n = len(rates)
    return sp.Matrix(n, n, lambda i, j: sp.Add(*(G[i, j, k] * rates[k] for k in range(n))))


def energies(
    positions: Sequence[sp.Matrix],
    angles: Sequence[sp.Expr],
    masses: Sequence[sp.Expr],
    inertias: Sequence[sp.Expr],
    gravity: sp.Expr,
    t: sp.Symbol,
) -> tuple[sp.Expr, sp.Expr]:
    """(T, V) of bodies in the plane, by differentiating where they are [J].

    T = sum 1/2 m_i |dp_i/dt|^2 + 1/2 I_i (dphi_i/dt)^2 and V = sum m_i g y_i.

    Args:
        positions: Centres of mass (x, y), functions of time, each (2, 1) [m].
        angles: phi_i, from any fixed direction [rad].
        masses: m_i [kg].
        inertias: I_i about the centres of mass [kg m2].
        gravity: g, along -y [m/s2].
        t: Time.
    """
    T, V = sp.Integer(0), sp.Integer(0)
    for p, phi, m, inertia in zip(positions, angles, masses, inertias, strict=True):
        v = p.diff(t)
        T += m * (v.T * v)[0] / 2 + inertia * phi.diff(t) ** 2 / 2
        V += m * gravity * p[1]
    return T, V
