"""Forces of the points of contact bodies, by Newton's method on the bodies' own few rows; the residual of their law.

    find w in the cones,  f = P w,  s = D f + c,  y = P' s  paired with w by the law

The method is that of `rbd.solvers.newton`, whose linear systems have three unknowns for each point. Here they have one for each
row of the bodies: six for a sole, whether it has 4 corners or 32 (Woodbury's identity on I - V + V (P' D P + k)). Sources: as
there.

It estimates from above the scaled residuals of `rbd.problem.residuals`: how fast points sink, and their distance to the law
(`rbd.problem.law_distance`), both over lower bounds of their scales. The distance is Euclidean: of projections that norm, over
the scale, does not grow with the scale.
"""

from __future__ import annotations

import math
from functools import cache
from types import ModuleType
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.solvers.newton import FOUND

_ALL = 12
"""Up to this number of points, all are taken into account from the start."""
_STILL, _NEARLY = 1e-12, 1e-6
"""Accelerations of loaded points that count as zero, over the largest of the bodies without forces; in between: undecided.

Near the last forces that hold a body Newton's method leaves 1e-9 m/s2 of nothing; beyond them the body may slide at 1 m/s2.
"""


class ContactForces(NamedTuple):
    """Forces of the points of contact bodies.

    Attributes:
        weights: Forces of the points (tangent, tangent, normal), in their cones to rounding, shape (3 k,).
        wrench: P `weights`, shape (nw,).
        merit: Largest entry of |w - P(w - y)|, scaled, or the length of that vector, which is no less: an answer if below
            `FOUND`; infinite for numbers that are not finite.
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

    Args:
        P: The wrench of the points' forces on the bodies' rows (nw, 3 k): columns tangent, tangent, normal of each point.
        mu: Friction of the points, shape (k,).
    """

    def __init__(self, P: Array, mu: Array) -> None:
        self.P, self.mu = np.array(P, dtype=float), np.array(mu, dtype=float)
        self._pull = np.ascontiguousarray(self.P.T)
        nw, n = self.P.shape
        k = n // 3
        touched = [np.flatnonzero(np.abs(self.P[:, 3 * i : 3 * i + 3]).any(axis=1)) for i in range(k)]
        d = max((int(rows[-1] - rows[0]) + 1 for rows in touched if len(rows)), default=1)
        first = np.array([min(int(rows[0]), nw - d) if len(rows) else 0 for rows in touched], dtype=np.int64)
        columns = np.array([self.P[first[j // 3] : first[j // 3] + d, j] for j in range(n)]).reshape(n, d)
        begin = seeds(columns, first)
        self._fixed = (columns, first, self.mu, begin)
        self._share = None if len(begin) == k else np.linalg.pinv(self.P.reshape(nw, k, 3)[:, begin].reshape(nw, -1)) @ self.P

    def forces(self, D: Array, c: Array, start: Array, *, coulomb: bool) -> ContactForces:
        """Forces that obey the law; `merit` says whether they do. Never raises.

        Args:
            D: Inverse operational-space inertia of the bodies' rows, symmetric positive definite, shape (nw, nw).
            c: Acceleration of the rows without the points' forces, shape (nw,); or velocity, and then forces are impulses.
            start: Weights to start from, shape (3 k,), in the cones or not, finite or not.
            coulomb: Coulomb's law; else the convex one.
        """
        n = len(self._pull)
        out = np.empty(n + len(c))
        D = D if D.flags.c_contiguous else D.T  # symmetric
        if self._share is not None:  # weights of the first points, of the same wrench
            start = self._share.dot(start)
        merit, steps, opened = contact_kernel().body_forces(D, c, start, coulomb, *self._fixed, out)
        return ContactForces(out[:n], out[n:], merit, steps, opened)

    def found(self, D: Array, c: Array, start: Array, *, coulomb: bool) -> ContactForces:
        """Forces that obey the law, searched from the other law's forces too; arguments as of `forces`.

        Under Coulomb's law: `gauss_first`.
        """
        if coulomb:
            return self.gauss_first(D, c, start)
        found = self.forces(D, c, start, coulomb=False)
        if not found.merit <= FOUND:  # most get there from Coulomb's forces, at a tenth of what the general way costs
            found = self.forces(D, c, self.forces(D, c, start, coulomb=True).weights, coulomb=False)
        return found

    def gauss_first(self, D: Array, c: Array, start: Array) -> ContactForces:
        """Forces of Coulomb's law: those of the convex law where they obey Coulomb's too.

        Loaded points then keep still, though some could slip as well. Where it cannot be decided, the merit is infinite.

        Args:
            D: As in `forces`.
            c: As in `forces`.
            start: As in `forces`.
        """
        gauss = self.forces(D, c, start, coulomb=False)
        far = self._from_coulomb(D, c, gauss)
        if far <= _STILL:
            return gauss
        if far <= _NEARLY:
            return gauss._replace(merit=math.inf)
        found = self.forces(D, c, gauss.weights, coulomb=True)
        if not found.merit <= FOUND:
            found = self.forces(D, c, start, coulomb=True)
        return found._replace(steps=found.steps + gauss.steps)

    def _from_coulomb(self, D: Array, c: Array, gauss: ContactForces) -> float:
        """How far forces of the convex law are from Coulomb's: loaded points that do not keep still."""
        if not gauss.merit <= FOUND:
            return math.inf
        rate, push = max_abs(c), max_abs(gauss.weights)
        if not rate > 0.0 or not push > 0.0:
            return 0.0
        y = (D @ gauss.wrench + c) / rate
        return law_residual(self._pull.dot(y), gauss.weights / push, self.mu, coulomb=True)


def seeds(columns: Array, first: Array) -> Array:
    """The points with which the search begins: all of a few, else four of each body, far from each other."""
    if len(first) <= _ALL:
        return np.arange(len(first))
    out: list[int] = []
    for row in np.unique(first):
        here = np.flatnonzero(first == row)
        places = columns.reshape(len(first), -1)[here]
        far = np.linalg.norm(places - places.mean(axis=0), axis=1)
        for _ in range(min(4, len(here))):
            new = int(far.argmax())
            out.append(int(here[new]))
            away = np.linalg.norm(places - places[new], axis=1)
            far = away if len(out) % 4 == 1 else np.minimum(far, away)
    return np.array(out)


LEAST_PUSH = 1e-3
"""Lower bound of the scale of a point's force [N]: what accelerates a gram at 1 m/s2."""


@cache
def contact_kernel() -> ModuleType:
    """`rbd.solvers.contact_kernel`, imported with the first contact that needs it: it imports Numba."""
    from rbd.solvers import contact_kernel

    return contact_kernel


def law_residual(y: Array, w: Array, mu: Array, *, coulomb: bool) -> float:
    """The residual: the largest of all points; NaN or infinite where a number is not finite.

    Args:
        y: Accelerations of the points (tangent, tangent, normal), shape (3k,).
        w: Weights, likewise.
        mu: Friction coefficients, shape (k,).
        coulomb: Coulomb's law; else the convex one.
    """
    return contact_kernel().point_misses(y[None], w[None], mu[None], LEAST_PUSH, coulomb, np.empty((1, 3)))


def point_misses(y: Array, w: Array, mu: Array, *, coulomb: bool) -> Array:
    """The largest of the points at each of n states, shape (3, n), scaled; NaN or infinite where a number is not finite.

    How far accelerations are from those allowed, weights from their cones, and both from their law.

    Args:
        y: Accelerations of the points (tangent, tangent, normal), shape (n, 3k).
        w: Weights, likewise.
        mu: Friction coefficients, shape (n, k).
        coulomb: Coulomb's law; else the convex one.
    """
    out = np.empty((len(y), 3))
    y, w, mu = (np.ascontiguousarray(each) for each in (y, w, mu))
    contact_kernel().point_misses(y, w, mu, LEAST_PUSH, coulomb, out)
    return out.T
