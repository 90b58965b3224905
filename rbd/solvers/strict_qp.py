"""Strictly convex quadratic programs of whole-body control, by DAQP: the only file that imports it.

minimise 1/2 x^T H x + g^T x   subject to   l <= x <= u,   low <= C x <= high
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from rbd.arrays import Array

_EQUAL = 5


class StrictAnswer(NamedTuple):
    """The minimiser, multipliers of bounds and rows (H x + g = z + C^T y), and whether there is one."""

    x: Array
    z: Array
    y: Array
    iterations: int
    solved: bool


def solve_strict(H: Array, g: Array, lower: Array, upper: Array, C: Array, low: Array, high: Array) -> StrictAnswer:
    """The minimiser; H positive definite."""
    bottom, top = np.concatenate([lower, low]), np.concatenate([upper, high])
    sense = np.where(bottom == top, _EQUAL, 0).astype(np.int32)
    x, _, flag, info = daqp.solve(H, g, C, top, bottom, sense)
    lam = -np.asarray(info["lam"])
    n = len(g)
    return StrictAnswer(np.asarray(x), lam[:n], lam[n:], int(info["iterations"]), flag == 1)
