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

from rbd import compiled as _compiled_code
from rbd.arrays import Array, is_finite, max_abs, zeros
from rbd.solvers.contact_steps import ContactSteps, Reached
from rbd.solvers.newton import FOUND, Order, Scaled, plain_steps_from
from rbd.solvers.pinocchio_admm import admm
from rbd.solvers.point_law import law_residual

_ALL = 12
"""Up to this number of points, all are taken into account from the start."""


_ITERATIONS = 40
"""Of Pinocchio's ADMM, from whose weights Newton's steps are tried again; they take as long as four of these."""
_NEAR = 1e-7
"""Its tolerance."""
_STEP = 3.0
"""Its step size, for a scaled D."""
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

    Not for two threads at a time: working arrays belong to the object.

    Args:
        P: The wrench of the points' forces on the bodies' rows (nw, 3 k): columns tangent, tangent, normal of each point.
        mu: Friction of the points, shape (k,).
    """

    def __init__(self, P: Array, mu: Array) -> None:
        self.P, self.mu = np.array(P, dtype=float), np.array(mu, dtype=float)
        self._pull = np.ascontiguousarray(self.P.T)
        k = len(self.mu)
        self._order = Order(None, 0, zeros(0), zeros(0), self.mu, 1 / (1 + self.mu**2), 3 * np.arange(k), np.full(k, 3))
        self._compiled: _Compiled | None = None
        self._steps: ContactSteps | None = None

    def forces(self, D: Array, c: Array, start: Array, *, coulomb: bool, compiled: bool | None = None) -> ContactForces:
        """Forces that obey the law; `merit` says whether they do. Never raises.

        Args:
            D: Inverse operational-space inertia of the bodies' rows, symmetric positive definite, shape (nw, nw).
            c: Acceleration of the rows without the points' forces, shape (nw,); or velocity, and then forces are impulses.
            start: Weights to start from, shape (3 k,), in the cones or not, finite or not.
            coulomb: Coulomb's law; else the convex one.
            compiled: Whether compiled code is used; None: where it is installed, see `rbd.compiled`.
        """
        run: Callable[[Array, Array, Array, bool], ContactForces] = self._plain
        if _compiled_code.in_use() if compiled is None else compiled and _compiled_code.installed():
            run = self._fast().forces
        return run(D, c, start, coulomb)

    def release(self, D: Array, f: Array, w: Array, change: Array, least_norm: Array) -> int:
        """Forces of the convex law on bodies that are held, in one compiled call.

        Returns:
            2 if they are found, 1 if all points stick, and nothing is written; 0 if nothing is known.

        Args:
            D: As in `forces`.
            f: Forces on the rows that hold them, shape (nw,); written: those of the points.
            w: Written: weights, shape (3 k,).
            change: Its first entries are written: accelerations of the rows, shape (nw or more,).
            least_norm: Weights of minimum norm for forces on the rows, from which to start, shape (3 k, nw).
        """
        return self._fast().release(D, f, w, change, least_norm) if _compiled_code.in_use() else 0

    def _fast(self) -> _Compiled:
        """The compiled form, made when it is first needed."""
        if self._compiled is None:
            self._compiled = _Compiled(self.P, self.mu)
        return self._compiled

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
        return law_residual(self._pull, y, gauss.weights / push, self.mu, coulomb=True)

    def _plain(self, D: Array, c: Array, start: Array, coulomb: bool) -> ContactForces:
        P, newton = self.P, self._steps
        if newton is None:
            newton = self._steps = ContactSteps(P, self.mu)
        if not newton.pose(D, c):
            return ContactForces(np.zeros(P.shape[1]), np.zeros(len(P)), math.inf, 0, False)
        first = start / newton.unit
        if not is_finite(first):
            first = np.zeros(len(start))
        found = newton.steps_from(first, coulomb=coulomb)
        if not found.merit <= FOUND:
            none, unit = zeros(0), np.full(len(first), newton.unit)
            S = Scaled(newton.D, newton.q, self._order, none, none, unit, newton.rate)
            near, taken = admm(S, first, coulomb=coulomb, iterations=_ITERATIONS, tolerance=_NEAR, step=_STEP)
            steps = found.steps + taken
            for guess in (near, zeros(len(first))):
                found = newton.steps_from(guess, coulomb=coulomb)
                steps += found.steps
                if found.merit <= FOUND:
                    break
            if not found.merit <= FOUND:
                w, merit, more = plain_steps_from(S, near, coulomb=coulomb)
                found, steps = Reached(newton.projected(w, coulomb=coulomb), merit, 0), steps + more
            found = found._replace(steps=steps)
        opened = coulomb and found.merit <= FOUND and newton.leaves_motion_open(found.w)
        if opened:
            found = newton.settled(found, coulomb=coulomb)
        weights = newton.unit * found.w
        return ContactForces(weights, P @ weights, found.merit, found.steps, opened)


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
        begin = seeds(columns, first)
        self.fixed = (columns, first, mu, begin, memory, np.zeros((2, k), dtype=np.int64))
        self.share = None if len(begin) == k else np.linalg.pinv(P.reshape(nw, k, 3)[:, begin].reshape(nw, -1)) @ P
        self._run, self._release = _kernel(), _release()

    def forces(self, D: Array, c: Array, start: Array, coulomb: bool) -> ContactForces:
        out = np.empty(self.size)
        D = D if D.flags.c_contiguous else D.T  # symmetric
        if self.share is not None:  # weights of the first points, of the same wrench
            start = self.share.dot(start)
        merit, steps, opened = self._run(D, c, start, coulomb, *self.fixed, out)
        return ContactForces(out[: self.n], out[self.n :], merit, steps, opened)

    def release(self, D: Array, f: Array, w: Array, change: Array, least_norm: Array) -> int:
        D = D if D.flags.c_contiguous else D.T  # symmetric
        return int(self._release(D, f, w, change, least_norm, FOUND, *self.fixed))


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


@cache
def _kernel() -> Callable[..., tuple[float, int, bool]]:
    from rbd.solvers.contact_kernel import body_forces  # imports Numba

    return body_forces


@cache
def _release() -> Callable[..., int]:
    from rbd.solvers.release_kernel import release  # imports Numba

    return release
