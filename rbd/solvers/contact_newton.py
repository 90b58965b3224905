"""Forces of the points of contact bodies, by Newton's method on the bodies' own few rows; compiled where Numba is installed.

    find w in the cones,  f = P w,  s = D f + c,  y = P' s  paired with w by the law

The method is that of `rbd.solvers.newton`, whose linear systems have three unknowns for each point. Here they have one for each
row of the bodies: six for a sole, whether it has 4 corners or 32 (Woodbury's identity on I - V + V (P' D P + k)). Sources: as
there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, is_finite
from rbd.problem.cones import FrictionCone, Product
from rbd.problem.force_set import at_rest
from rbd.solvers import compiled as _compiled_code
from rbd.solvers.newton import FOUND, leaves_motion_open, scaled, settled, steps_from


class ContactForces(NamedTuple):
    """Forces of the points of contact bodies.

    Attributes:
        weights: Forces of the points (tangent, tangent, normal), in their cones to rounding, shape (3 k,).
        wrench: P `weights`, shape (nw,).
        merit: Largest entry of |w - P(w - y)|, scaled: an answer if below `FOUND`; infinite for numbers that are not finite.
        steps: Newton's steps taken.
        open: Whether the points that slip leave a family of motions under Coulomb's law, of which this is the limit of equally
            compliant points (see `rbd.ConeSolver`).
    """

    weights: Array
    wrench: Array
    merit: float
    steps: int
    open: bool


class ContactNewton:
    """Solves for the forces of one set of points, whose map P and frictions stay: what depends on them is computed once.

    Not for two threads at a time: working arrays belong to the object.

    Args:
        P: The wrench of the points' forces on the bodies' rows (nw, 3 k): columns tangent, tangent, normal of each point.
        mu: Friction of the points, shape (k,).
    """

    def __init__(self, P: Array, mu: Array) -> None:
        self.P, self.mu = np.array(P, dtype=float), np.array(mu, dtype=float)
        self.sets = at_rest(Product([FrictionCone(m) for m in self.mu.tolist()]))
        self._compiled: _Compiled | None = None

    def forces(self, D: Array, c: Array, start: Array, *, coulomb: bool, compiled: bool | None = None) -> ContactForces:
        """Forces that obey the law; `merit` says whether they do. Never raises.

        Args:
            D: Inverse operational-space inertia of the bodies' rows, symmetric positive definite, shape (nw, nw).
            c: Acceleration of the rows without the points' forces, shape (nw,); or velocity, and then forces are impulses.
            start: Weights to start from, shape (3 k,), in the cones or not.
            coulomb: Coulomb's law; else the convex one.
            compiled: Whether compiled code is used; None: where it is installed, see `rbd.solvers.compiled`.
        """
        if _compiled_code.in_use() if compiled is None else compiled and _compiled_code.installed():
            if self._compiled is None:
                self._compiled = _Compiled(self.P, self.mu)
            return self._compiled.forces(D, c, start, coulomb)
        return self._plain(D, c, start, coulomb)

    def _plain(self, D: Array, c: Array, start: Array, coulomb: bool) -> ContactForces:
        P, T = self.P, self.sets
        if not (is_finite(D) and is_finite(c) and is_finite(start)):
            return ContactForces(np.zeros(P.shape[1]), np.zeros(len(P)), math.inf, 0, False)
        S = scaled(P.T @ D @ P, P.T @ c, T)
        w, merit, steps = steps_from(S, S.guess(T.project(start)), coulomb=coulomb)
        if merit > FOUND:
            w, merit, more = steps_from(S, np.zeros(len(w)), coulomb=coulomb)
            steps += more
        opened = coulomb and merit < FOUND and leaves_motion_open(S, w)
        if opened:
            w, more = settled(S, w)
            steps += more
        weights = T.project(S.weights(w))
        return ContactForces(weights, P @ weights, merit, steps, opened)


def contact_forces(
    D: Array, c: Array, P: Array, mu: Array, start: Array, *, coulomb: bool, compiled: bool | None = None
) -> ContactForces:
    """Forces of the points of contact bodies: `ContactNewton.forces`, for one call."""
    return ContactNewton(P, mu).forces(D, c, start, coulomb=coulomb, compiled=compiled)


class _Compiled:
    """Working arrays of the compiled code."""

    def __init__(self, P: Array, mu: Array) -> None:
        nw, n = P.shape
        k = n // 3
        touched = [np.flatnonzero(np.abs(P[:, 3 * i : 3 * i + 3]).any(axis=1)) for i in range(k)]
        d = max((int(rows[-1] - rows[0]) + 1 for rows in touched if len(rows)), default=1)
        first = np.array([min(int(rows[0]), nw - d) if len(rows) else 0 for rows in touched], dtype=np.int64)
        columns = np.array([P[first[j // 3] : first[j // 3] + d, j] for j in range(n)]).reshape(n, d)
        self.n, self.size = n, n + nw
        vectors, squares, rows = 10 * n + 4 * nw + n * d + 4 * k, 4 * nw * nw, 2 * n * nw
        memory = np.zeros(vectors + squares + rows + nw * n)
        self.fixed = (columns, first, mu, np.arange(k), memory, np.zeros(k, dtype=np.int64))
        self.run = _kernel()

    def forces(self, D: Array, c: Array, start: Array, coulomb: bool) -> ContactForces:
        out = np.empty(self.size)
        D = D if D.flags.c_contiguous else D.T  # symmetric
        merit, steps, opened = self.run(D, c, start, coulomb, *self.fixed, out)
        return ContactForces(out[: self.n], out[self.n :], merit, steps, opened)


@cache
def _kernel() -> Callable[..., tuple[float, int, bool]]:
    from rbd.solvers.contact_kernel import body_forces  # imports Numba

    return body_forces
