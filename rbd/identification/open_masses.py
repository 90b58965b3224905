"""How far the mass of one body is open, at fixed base parameters: two semidefinite programs."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array, null_space
from rbd.errors import NoSolution
from rbd.identification.possible import pseudo_inertia, whitened_basis

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
    low, high = (_extreme(sign * goal, np.concatenate(blocks), np.concatenate(sides), len(blocks)) for sign in (1.0, -1.0))
    m = float(theta[10 * body])
    return max(0.0, m + low), m - high


def _extreme(goal: Array, G: Array, h: Array, cones: int) -> float:
    """Least goal . y with h + G y in a product of semidefinite cones; -inf where there is none."""
    import clarabel
    from scipy.sparse import csc_matrix

    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.max_iter, settings.time_limit = 200, 20.0
    n, size = len(goal), float(np.abs(goal).max())
    found = clarabel.DefaultSolver(
        csc_matrix((n, n)), goal / size, csc_matrix(-G), h, [clarabel.PSDTriangleConeT(4)] * cones, settings
    ).solve()
    status = str(found.status)
    if "DualInfeasible" in status:
        return -float("inf")
    if "Solved" not in status:
        raise NoSolution(f"how far the mass is open was not found: Clarabel says {status}.")
    return float(goal @ np.asarray(found.x))
