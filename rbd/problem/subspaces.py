"""Null spaces, ranges and ranks of matrices, and which singular values count as zero."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array

RANK = 1e-9
"""Singular values up to this, over the largest, are zero: of Jacobians, of generators, of columns made of them.

Rounding leaves 1e-15 of dependent rows, and the poses of a loop that is closed to 1e-12 a little more; what is independent on a
robot, such as the lever arm of a millimetre, is at 1e-3 or above.
"""
SQUARED = 1e-11
"""The same of matrices such as J M^-1 J^T, whose singular values are squares: 3e-6 of what they are squares of."""


def null_space(A: Array, tolerance: float = RANK, *, unit: bool = False) -> Array:
    """Orthonormal columns that A takes to zero, shape (n, n - rank).

    Args:
        A: Shape (m, n).
        tolerance: Singular values up to this, over the largest, are zero.
        unit: Measure them against one in place of the largest: A has columns of unit length, or is part of a unitary matrix.
    """
    if not A.size:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[_count(s, tolerance, unit) :].T)


def range_of(A: Array, tolerance: float = RANK) -> Array:
    """Orthonormal columns that span what A reaches, shape (m, rank)."""
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, : _count(s, tolerance, False)])


def rank_of(A: Array, tolerance: float = RANK, *, unit: bool = False) -> int:
    """The number of singular values that are not zero; arguments as of `null_space`."""
    return _count(np.linalg.svd(A, compute_uv=False), tolerance, unit) if A.size else 0


def _count(s: Array, tolerance: float, unit: bool) -> int:
    return int((s > tolerance * (1.0 if unit else float(s[0]))).sum()) if len(s) else 0
