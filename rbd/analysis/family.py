"""Whether a motion under Coulomb's law stands alone, or in a family.

Under the convex law and where all rows hold the motion is the minimum of a strictly convex function: unique. Under Coulomb's
law friction follows the load of each point. Where a patch slips and turns on more than three corners statics leaves the loads
open, each share of them turns the friction another way, and a whole family of motions satisfies the law.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import blas

from rbd.analysis.active_set import RANK_TOLERANCE
from rbd.analysis.modes import modes_of
from rbd.arrays import Array

if TYPE_CHECKING:
    from rbd.solution import Solution


def motion_freedom(solution: Solution) -> int:
    """Dimension of the family of motions with the same contact modes; zero where the motion stands alone among them.

    With the forces that may change, J^T Phi, and the accelerations that must stay zero, Psi^T J, it is the rank of the first
    less that of the second (see `rbd.analysis.modes`), in the metric of inertia. Motions with other modes are not looked for.
    """
    if solution.law != "coulomb":
        return 0
    P, modes = solution.problem, modes_of(solution)
    if not modes.phi:
        return 0
    C = modes.generators
    return _rank(P.factor, P.J.T @ (C.G @ np.array(modes.phi).T)) - _rank(P.factor, P.J.T @ (C.H @ np.array(modes.psi).T))


def _rank(L: Array, X: Array) -> int:
    X = blas.dtrsm(1.0, L, X, lower=1)
    length = np.linalg.norm(X, axis=0)
    return int((np.linalg.svd(X / np.where(length > 0.0, length, 1.0), compute_uv=False) > RANK_TOLERANCE).sum())
