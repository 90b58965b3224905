"""Pseudo-inertia matrices: a body's inertial parameters as a symmetric 4 x 4 matrix, positive definite if a body can have them.

    P = [ Sigma   m c ]        Sigma = integral of x x^T dm = 1/2 tr(I) 1 - I,    I about the origin
        [ m c^T   m   ]

is linear in the ten parameters, and positive semidefinite exactly for parameters of some distribution of positive mass
[Wensing2018]. The distance of two bodies that no choice of axes or units changes is the entropic divergence [Lee2020]

    D(P, P_0) = tr(P_0^-1 P) - log det(P_0^-1 P) - 4.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array

_SYMMETRIC = ((0, 1), (0, 2), (1, 2))
THIN = 1e-3
"""Where a model's body is impossible, its second moments are raised to this share of the largest."""


def _basis() -> Array:
    """P of a unit of each parameter, shape (10, 4, 4)."""
    out = np.zeros((10, 4, 4))
    out[0, 3, 3] = 1.0
    for i in range(3):
        out[1 + i, i, 3] = out[1 + i, 3, i] = 1.0
    places = {(0, 0): 4, (0, 1): 5, (1, 1): 6, (0, 2): 7, (1, 2): 8, (2, 2): 9}
    for (i, j), k in places.items():
        if i == j:
            out[k, :3, :3] = 0.5 * np.eye(3)
            out[k, i, i] -= 1.0
        else:
            out[k, i, j] = out[k, j, i] = -1.0
    return out


BASIS = _basis()
"""P = sum of theta_k BASIS[k], shape (10, 4, 4)."""


def pseudo_inertia(theta: Array) -> Array:
    """P of ten parameters, shape (..., 4, 4)."""
    return np.asarray(np.tensordot(theta, BASIS, axes=1))


def central(theta: Array) -> tuple[float, Array, Array]:
    """(mass, centre of mass (3,), inertia about it (3, 3)) of ten parameters; a mass above zero.

    In the axes of the joint's frame.
    """
    m, c = float(theta[0]), theta[1:4] / theta[0]
    I = np.array([[theta[4], theta[5], theta[7]], [theta[5], theta[6], theta[8]], [theta[7], theta[8], theta[9]]])
    return m, c, I - m * (c @ c * np.eye(3) - np.outer(c, c))


def is_possible(theta: Array) -> bool:
    """Whether some body has these parameters: P is positive definite, well above rounding."""
    m = float(theta[0])
    if not m > 0.0:
        return False
    moments = np.linalg.eigvalsh(_second_moments(theta))
    return bool(moments[0] > 1e-9 * max(moments[2], 1e-12 * m))


def made_possible(theta: Array) -> Array:
    """The parameters with the same mass and centre of mass, and second moments about it raised to be positive."""
    m, c = float(theta[0]), theta[1:4] / theta[0]
    moments, axes = np.linalg.eigh(_second_moments(theta))
    least = max(THIN * float(moments[2]), 1e-6 * m)
    P = np.empty((4, 4))
    P[:3, :3] = (axes * np.maximum(moments, least)) @ axes.T + m * np.outer(c, c)
    P[3, :3] = P[:3, 3] = m * c
    P[3, 3] = m
    return parameters_of(P)


def parameters_of(P: Array) -> Array:
    """The ten parameters of a pseudo-inertia matrix, shape (10,)."""
    Sigma = P[:3, :3]
    I = np.trace(Sigma) * np.eye(3) - Sigma
    return np.array([P[3, 3], *P[:3, 3], I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def size_of(theta: Array) -> Array:
    """Typical sizes of a body's parameters, shape (10,): m, m r and m r^2, r its radius of gyration about the origin."""
    m = float(theta[0])
    r2 = 0.5 * float(theta[4] + theta[6] + theta[9]) / m
    return np.array([m, *[m * r2**0.5] * 3, *[m * r2] * 6])


def whitened_basis(P: Array) -> Array:
    """L^-1 BASIS_k L^-T with P = L L^T, shape (10, 4, 4): changes of a body's parameters relative to the body itself."""
    inverse = np.linalg.inv(np.linalg.cholesky(P))
    return np.asarray(inverse @ BASIS @ inverse.T)


def _second_moments(theta: Array) -> Array:
    """About the centre of mass, shape (3, 3)."""
    P, m = pseudo_inertia(theta), float(theta[0])
    c = theta[1:4] / m
    return np.asarray(P[:3, :3] - m * np.outer(c, c))
