"""Constrained least squares of contact forces: the weights of a force set that fit measured generalised forces.

    minimise |W (E w - b)|^2     subject to     w in X

E w are the generalised forces of the weights w at the coordinates that are measured, b what was measured, W the inverse of a
square root of the covariance of b, and X a product of lines, half-lines, intervals and circular cones. Where w is not unique
the one of least norm is taken: of all w if that is in X, else of those in X that fit as well.

Without an active limit the singular value decomposition of W E gives it. Else proximal steps,

    w <- argmin |W (E w - b)|^2 + eps |w - w_before|^2,     w in X

end at a minimiser [Rockafellar1976]: each is strictly convex, and `rbd.solvers.conic` solves it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import RANK, Array
from rbd.errors import NoSolution
from rbd.problem.conic import Conic
from rbd.problem.force_set import Element, ForceSet
from rbd.solvers.conic import newton_steps, solve_conic

_PROXIMAL = 1e-6
"""eps over the largest eigenvalue of the least squares."""
_STEPS = 40
"""Proximal steps. Directions that the data determine to a thousandth of the best one need two or three."""
_SAME = 1e-13
"""A step that moves the fit by less, over its size, was the last."""
_FITS = 1e-10
"""A fit that is worse than the one without limits by less, over its size, is as good."""
_ACTIVE = 1e-9
"""A slope of the squares below this, over their size, is that of a limit that is not active."""
_ROUNDING = 1e-14
"""Weights outside of their sets by less, over the largest, are on the edge."""
_USABLE = 1e-6
"""A miss of the conic solver from which proximal steps go on."""
_EMPTY = 1e-5
"""Points whose normal force is below this share of the weight may be those that carry nothing."""
_EXACT = 1e-11
_EDGE = 1e-9
"""Shares of a force by which it is on the edge of its cone."""


@dataclass(frozen=True, eq=False)
class ForceFit:
    """Weights of contact forces, and what the data say of them.

    Attributes:
        w: Weights, shape (p,) [N].
        tangent: Directions in which the weights may move, with the active limits kept, shape (p, d).
        left: What is left, W (b - E w), shape (k,), in standard deviations where W is of a covariance.
        rank: How many directions of the weights the data determine, active limits kept.
        least_norm: Whether w is the one of least norm among those that fit as well; else it is so to about six digits.
    """

    w: Array
    tangent: Array
    left: Array
    rank: int
    least_norm: bool

    def covariance(self, E: Array, W: Array) -> Array:
        """Covariance of the weights for data with the covariance that W is of, shape (p, p).

        To first order, the active limits kept, the curvature of cones left out. Directions that the data leave open count as
        known: w is the one of least norm.
        """
        P = self.tangent @ np.linalg.pinv(W @ E @ self.tangent, rcond=RANK)
        return np.asarray(P @ P.T)


def fit_forces(E: Array, b: Array, W: Array, sets: ForceSet, unit: float) -> ForceFit:
    """The weights that fit best.

    Args:
        E: Generalised forces of unit weights at the measured coordinates, shape (k, p).
        b: Measured generalised forces, shape (k,).
        W: Inverse of a square root of their covariance, shape (k, k).
        sets: The sets of the weights.
        unit: A size of forces [N].

    Raises:
        NoSolution: the program over the cones was not solved.
    """
    A, c = W @ E, W @ b
    size = float(np.linalg.norm(A, 2)) if A.size else 0.0
    if size == 0.0:  # no weights, or none that the data see
        w = sets.project(np.zeros(sets.size))
        return ForceFit(w, np.eye(sets.size), c - A @ w, 0, True)
    A, target = A / size, c / (size * unit)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = s > RANK * s[0]
    U, s, Vt = U[:, kept], s[kept], Vt[kept]
    known = (U.T @ target) / s
    x, least = Vt.T @ known, True
    bounds = sets.lower / unit, sets.upper / unit
    program = Conic.of(np.eye(sets.size), np.zeros(sets.size), Vt, known, *bounds, sets.cone_columns, sets.mu)
    inside = program.project(x)
    if float(np.abs(inside - x).max()) <= _ROUNDING * max(1.0, float(np.abs(x).max())):
        x = inside  # forces of rounding, of a foot in the air, are zero
    else:
        x, least = _limited(program, A, target, U @ (U.T @ target))
    slope = A.T @ (A @ x - target)
    tangent = _tangent(sets, x, slope, _ACTIVE * max(1.0, float(np.linalg.norm(target))))
    free = np.linalg.svd(A @ tangent, compute_uv=False) if tangent.size else np.zeros(0)
    w = x * unit
    return ForceFit(w, tangent, c - W @ (E @ w), int((free > RANK).sum()), least)


def _limited(program: Conic, A: Array, target: Array, best: Array) -> tuple[Array, bool]:
    """(x, whether its norm is the least) with limits that the fit without them breaks.

    Args:
        program: The x of least norm that fit as well as without limits.
        A: Shape (k, p), its largest singular value one.
        target: Shape (k,).
        best: A x of the fit without limits, shape (k,).
    """
    n = len(program.g)
    none = np.zeros((0, n))
    H, g = A.T @ A + _PROXIMAL * np.eye(n), -A.T @ target
    near = replace(program, H=H, A=none, b=np.zeros(0), g=g)
    x, size = _minimiser(near, np.zeros(n)), max(1.0, float(np.linalg.norm(target)))
    for _ in range(_STEPS):
        near = replace(near, g=g - _PROXIMAL * x)
        ahead = _minimiser(near, x)
        moved = float(np.linalg.norm(A @ (ahead - x)))
        x = ahead
        if moved <= _SAME * size:
            break
    if float(np.linalg.norm(A @ x - best)) <= _FITS * size:  # cones allow the fit without limits: with other weights
        exact = solve_conic(program)
        if exact.solved:
            return exact.x, True
    return x, False


def _minimiser(near: Conic, x: Array) -> Array:
    """The minimiser of a strictly convex program without equations, from a start.

    Raises:
        NoSolution: it was not found to six digits.
    """
    none = np.zeros(0)
    quick = newton_steps(near, x, none, none)
    if quick is not None:
        return quick.x
    found = solve_conic(near)
    if found.solved:
        return found.x
    # Points that carry nothing, and need no force to do so, are kinks on which Newton's method does not end: without them.
    loaded = np.ones(len(x), bool)
    empty = found.x[near.cones[:, 2]] <= _EMPTY
    loaded[near.cones[empty]] = False
    where = np.cumsum(loaded) - 1
    part = replace(
        near, H=near.H[np.ix_(loaded, loaded)], g=near.g[loaded], A=near.A[:, loaded], C=near.C[:, loaded],
        lower=near.lower[loaded], upper=near.upper[loaded], cones=where[near.cones[~empty]], mu=near.mu[~empty],
    )  # fmt: skip
    rest = newton_steps(part, found.x[loaded], none, none)
    if rest is not None:
        out = np.zeros(len(x))
        out[loaded] = rest.x
        if near.miss(out, none, none) <= _EXACT:
            return out
    if found.miss > _USABLE:
        raise NoSolution(f"the least squares over the friction cones ended {found.outcome.value}, missed by {found.miss:.1e}.")
    return found.x


def _tangent(sets: ForceSet, x: Array, slope: Array, zero: float) -> Array:
    """Directions that keep the active limits: those with a slope of the squares against them, shape (p, d)."""
    columns = [np.zeros((sets.size, 0))]
    for e in sets.elements:
        part = e.columns
        if np.abs(slope[part]).max(initial=0.0) <= zero:
            own = np.eye(e.size)
        elif e.is_cone:
            own = _along_the_cone(e, x[part])
        else:
            inside = (x[part] > sets.lower[part]) & (x[part] < sets.upper[part])
            own = np.eye(e.size)[:, inside]
        wide = np.zeros((sets.size, own.shape[1]))
        wide[part] = own
        columns.append(wide)
    return np.concatenate(columns, axis=1)


def _along_the_cone(e: Element, force: Array) -> Array:
    """Directions along the surface of a friction cone at a force (tangent, tangent, normal), shape (3, 0, 2 or 3)."""
    tangential = float(np.hypot(force[0], force[1]))
    if tangential <= 0.0 and force[2] <= 0.0:
        return np.zeros((3, 0))
    if tangential < e.mu * force[2] * (1.0 - _EDGE):
        return np.eye(3)
    u, v = force[:2] / tangential
    edge = np.array([e.mu * u, e.mu * v, 1.0]) / np.hypot(e.mu, 1.0)
    return np.column_stack([edge, [-v, u, 0.0]])
