"""How far the mass of one body is open, at fixed base parameters: two semidefinite programs."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array, null_space
from rbd.errors import NoSolution
from rbd.motion.identification.possible import pseudo_inertia, whitened_basis

_INSIDE, _GAP = 1e-5, 1e-4
"""Of an accepted answer: how negative an eigenvalue may be, over the body's own; and the gap to what is proved impossible."""
_UPPER = [(i, j) for j in range(4) for i in range(j + 1)]
"""Entries of a symmetric matrix in Clarabel's order: columns of the upper triangle; off the diagonal times sqrt 2."""


def mass_interval(theta: Array, kept: Array, body: int, bodies: int) -> tuple[float, float]:
    """(least, largest) mass of a body, with all pseudo-inertias positive semidefinite.

    Args:
        theta: Parameters that are possible, shape (p,), bodies first.
        kept: Combinations of the parameters that stay, shape (k, p).
        body: Its number.
        bodies: How many bodies there are.

    Raises:
        NoSolution: a program was not solved.
    """
    with_mass = [b for b in range(bodies) if theta[10 * b] > 0.0]
    unit = np.zeros(len(theta))
    for b in with_mass:
        own = slice(10 * b, 10 * b + 10)
        unit[own] = 1.0 / np.linalg.norm(whitened_basis(pseudo_inertia(theta[own])).reshape(10, 16), axis=1)
    unit[10 * bodies :] = 1.0
    free = np.flatnonzero(unit)
    Z = np.zeros((len(theta), 0))
    scaled = kept[:, free] * unit[free]
    basis = null_space(scaled / np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)[:, None])
    Z = np.zeros((len(theta), basis.shape[1]))
    Z[free] = unit[free, None] * basis
    blocks, sides = [], []
    for b in with_mass:
        own = slice(10 * b, 10 * b + 10)
        relative = np.tensordot(Z[own].T, whitened_basis(pseudo_inertia(theta[own])), axes=1)  # (d, 4, 4)
        if np.abs(relative).max(initial=0.0) <= 1e-12:
            continue
        blocks.append(np.array([(1.0 if i == j else 2.0**0.5) * relative[:, i, j] for i, j in _UPPER]))
        sides.append(np.array([1.0 if i == j else 0.0 for i, j in _UPPER]))
    goal = Z[10 * body]
    m, G, h = float(theta[10 * body]), np.concatenate(blocks), np.concatenate(sides)
    low, high = (_extreme(sign * goal, G, h, m) for sign in (1.0, -1.0))
    return max(0.0, m + low), m - high


def _extreme(goal: Array, G: Array, h: Array, mass: float) -> float:
    """Least goal . y with h + G y in a product of semidefinite cones, to 1e-4 of a mass or of itself; -inf: no least one."""
    import clarabel
    from scipy.sparse import csc_matrix

    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.max_iter, settings.time_limit = 200, 20.0
    n, size = len(goal), float(np.abs(goal).max())
    found = clarabel.DefaultSolver(
        csc_matrix((n, n)), goal / size, csc_matrix(-G), h, [clarabel.PSDTriangleConeT(4)] * (len(h) // 10), settings
    ).solve()
    status = str(found.status)
    if "DualInfeasible" in status:
        return -float("inf")
    y, least = np.asarray(found.x), size * float(found.obj_val_dual)
    if "Solved" in status and np.isfinite(y).all():
        value = float(goal @ y)
        inside = np.linalg.eigvalsh(_matrices(h + G @ y)).min()
        if inside > -_INSIDE and value - least < _GAP * max(mass, abs(value)):  # attained, and nothing beyond it is
            return value
    raise NoSolution(f"how far the mass is open was not found: Clarabel says {status}.")


def _matrices(packed: Array) -> Array:
    """Symmetric matrices of their packed entries, shape (k, 4, 4)."""
    out = np.zeros((len(packed) // 10, 4, 4))
    for (i, j), x in zip(_UPPER, packed.reshape(-1, 10).T, strict=True):
        out[:, i, j] = out[:, j, i] = x if i == j else x / 2.0**0.5
    return out
