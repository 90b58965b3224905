"""Velocities and impulses of one step or one impact: Gauss's problem at the level of velocity.

    M v+ = M v + h (S^T tau + tau_ext - h(q, v)) + J^T p          (an impact: h = 0)
    u+ = J v+ + offset,        p in h K        u+ and p obey the contact law, as accelerations and forces do in `rbd.solve`

It is a `GaussProblem` whose unknown is v+, and whose multipliers are impulses; sets of bounded forces are scaled by h. With
M = L L^T, W = L^-1 J^T and y = L^-1 (M v + h (...)),

    u+ = W^T W p + W^T y + offset,        v+ = L^-T (y + W p)

What is tried, in order: the shortest impulses that hold every row still, and those near the last ones; Newton's steps; all that
`rbd.ConeSolver` tries. The problem itself is put together only for the last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import Array, inertia_factor, is_finite, max_abs
from rbd.errors import NoSolution
from rbd.mechanism.projection import ZERO
from rbd.mechanism.stage_solver import CONTRADICTION, INDEPENDENT, OWED
from rbd.problem.cones import Box, Cone, Product
from rbd.problem.parts import Parts, parts_of
from rbd.problem.problem import GaussProblem
from rbd.problem.residuals import USABLE
from rbd.problem.rows import Rows
from rbd.simulation.contact_points import Layout, Snapshot
from rbd.solution import Solution
from rbd.solvers.admm import ConeSolver, holding
from rbd.solvers.contact_solve import Stillness
from rbd.solvers.kkt import independent_factor
from rbd.solvers.newton import Scaled, scaled, steps_from, yielding_steps
from rbd.solvers.pinocchio_admm import admm

EXACT = 1e-10
"""Scaled merit below which weights are an answer."""
STILL = 1e-13
"""Scaled velocity that is left to rows that are held still."""
_ROUNDING = 1e-14
"""Of velocities, times the root of the mass that a point feels [kg^1/2 m/s]."""
_NOTHING = 1e-100
"""Velocities below this are zero [m/s, rad/s]: divided by them, others would overflow."""
_QUICK = 10
"""Newton's steps that are tried first; from the step before, two as a rule."""


@dataclass(frozen=True, eq=False)
class VelocityAnswer:
    """What a step or an impact does.

    Attributes:
        v: Velocity after it, shape (nv,).
        impulse: Row impulses, shape (p,) [N s, N m s]; zero of points that do not act.
        velocity: u+ of all points, shape (p,) [m/s, rad/s].
        law: How far they are from the law, scaled.
        least: Whether the impulses are known to be the shortest that do the same.
    """

    v: Array
    impulse: Array
    velocity: Array
    law: float
    least: bool = False


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The rows of the points that act.

    Attributes:
        index: Which rows.
        groups: (constraint, its rows among them, their set).
        parts: Their sets as weights, which are the row impulses themselves: each set is one point's own.
        bilateral: Whether all hold, whatever it takes.
        held: Which of the rows hold, whatever it takes; indices.
        stillness: Of the parts, if there are any.
    """

    index: Array | slice
    groups: tuple[tuple[str, slice, Cone], ...]
    parts: Parts
    bilateral: bool
    held: Array
    stillness: Stillness | None


class VelocitySolver:
    """Solves the velocity problems of one run; it keeps the rows it has chosen, and the last forces to start from."""

    def __init__(self, law: str) -> None:
        self.law = law
        self.coulomb = law == "coulomb"
        self._chosen: dict[tuple[int, bytes, float], _Chosen] = {}
        self._layout: Layout | None = None
        self.redundant = RedundantRows()

    def solve(
        self, at: Snapshot, active: Array, rhs: Array, offset: Array, h: float, guess: Array, shift: Array | None = None
    ) -> VelocityAnswer:
        """Velocity and impulses.

        Args:
            at: The points, and M.
            active: Which points act, shape (k,).
            rhs: M v + h (...), shape (nv,).
            offset: Of u+ = J v+ + offset, shape (p,).
            h: Length of the step [s]; 0 for an impact, where bounded forces do nothing.
            guess: Impulses to start from, shape (p,).
            shift: Added to u+ where the law looks at it, shape (p,): friction opposes u+ + shift.

        Raises:
            NoSolution: naming the constraints that act; or what is not finite.
            SingularInertia: M is not positive definite.
        """
        chosen = self._rows(at.layout, active, h)
        M, index, impulse = at.state.M, chosen.index, np.zeros(len(offset))
        L = inertia_factor(at.state.M)
        y = blas.dtrsv(L, rhs, lower=1)
        if not is_finite(y):
            raise NoSolution(f"the momentum of {at.state.robot.name}, or a force on it, is not finite at this state.")
        merit, least = 0.0, False
        if chosen.parts.size:
            J, c, left_out = at.J[index], offset[index], 0.0
            W = blas.dtrsm(1.0, L, J.T, lower=1)
            if len(chosen.held):
                whole = W
                W, c, left_out = self.redundant.reduced(W, c, chosen.held, at.drift)
                if W is not whole:
                    J = (np.tril(L) @ W).T
            D, u = W.T @ W, W.T @ y + c
            if not is_finite(u):
                raise NoSolution(f"the velocity of {_names(chosen)} is not finite at this state.")
            if max_abs(u) < _NOTHING:
                u = np.zeros(len(u))

            def problem() -> GaussProblem:
                rows = [Rows(name, J[span], c[span], cone) for name, span, cone in chosen.groups]
                return GaussProblem(M, rhs, rows, from_state=True)

            f, merit, least = self._impulses(chosen, D, u, guess[index], None if shift is None else shift[index], h, problem)
            if left_out:
                merit = max(merit, self._contradiction(chosen, at, left_out / (max(h, max_abs(u)) or 1.0)))
            impulse[index] = f
            y = y + W @ f
        v = blas.dtrsv(L, y, lower=1, trans=1)
        return VelocityAnswer(v, impulse, at.J @ v + offset, merit, least)

    def _contradiction(self, chosen: _Chosen, at: Snapshot, missed: float) -> float:
        """What held rows miss, over the size of what they ask; what a pose and a velocity that are off account for is no error.

        Raises:
            NoSolution: where they contradict each other.
        """
        if missed > max(CONTRADICTION, OWED * max(at.drift, at.drift_rate)):
            raise NoSolution(
                f"no velocity satisfies the constraints together: {_names(chosen)} contradict each other, by {missed:.3g} "
                "of what they ask for."
            )
        return missed

    def _impulses(
        self,
        chosen: _Chosen,
        D: Array,
        u: Array,
        guess: Array,
        shift: Array | None,
        h: float,
        problem: Callable[[], GaussProblem],
    ) -> tuple[Array, float, bool]:
        """(row impulses, how far they are from the law, whether they are known to be the shortest)."""
        if chosen.bilateral:
            return *_held(D, u, max(h, max_abs(u)) or 1.0, problem), False
        if shift is None and chosen.stillness is not None:
            shortest = chosen.stillness.impulses(D, u, np.zeros(len(u)), STILL, others=False)
            if shortest is not None:
                return *shortest, True
            still = chosen.stillness.impulses(D, u, guess, STILL)
            if still is not None:
                return *still, False
        T = chosen.parts
        if shift is not None:
            x, merit, S = self._tried(D, u + shift, T, guess)
            if merit <= _exact(S):
                return T.project(S.weights(x)), merit, False
            # Sole and load may be such that no friction opposes the velocity in the middle: then that at the end.
        x, merit, S = self._tried(D, u, T, guess)
        exact = _exact(S)
        if merit > exact:
            x, merit = yielding_steps(S, S.guess(T.project(holding(problem()))), coulomb=self.coulomb)
        if merit > exact:
            x, merit = yielding_steps(S, np.zeros(T.size), coulomb=self.coulomb)
        if merit <= exact:
            return T.project(S.weights(x)), merit, False
        return *self._searched(problem()), False

    def _tried(self, D: Array, u: Array, T: Parts, guess: Array) -> tuple[Array, float, Scaled]:
        """(scaled weights, merit, the scaled problem) from a guess."""
        S = scaled(D, u, T)
        x, merit, _ = steps_from(S, S.guess(guess), coulomb=self.coulomb, iterations=_QUICK)
        if merit > _exact(S):  # rows that repeat each other: near by ADMM, then exact
            near, _ = admm(S, x, coulomb=self.coulomb, iterations=200, tolerance=1e-6)
            x, merit, _ = steps_from(S, near, coulomb=self.coulomb, iterations=_QUICK)
        if merit > _exact(S):
            x, merit = yielding_steps(S, x, coulomb=self.coulomb)
        return x, merit, S

    def _searched(self, P: GaussProblem) -> tuple[Array, float]:
        """The long way: all that `rbd.ConeSolver` tries."""
        found = Solution.of(ConeSolver(law=self.law).solve(P))
        if not found.residuals.within(USABLE):
            names = ", ".join(r.name for r in P.rows)
            raise NoSolution(
                f"no velocity satisfies the contact law together with {names}: {found.reason or found.worst}.",
                problem=P,
                result=found,
            )
        return found.multipliers, found.residuals.worst

    def _rows(self, layout: Layout, active: Array, h: float) -> _Chosen:
        if layout is not self._layout:
            self._layout, self.redundant = layout, RedundantRows()
            self._chosen.clear()
        key = id(layout), active.tobytes(), h if layout.boxed else 0.0
        known = self._chosen.get(key)
        if known is None:
            if len(self._chosen) > 500:
                self._chosen.clear()
            known = self._chosen[key] = _choose(layout, active, h)
        return known


class RedundantRows:
    """The held rows of one layout that repeat each other, at a pose that is a little off; it remembers their largest norms.

    A hinge that closes a planar loop has five rows, two of which are independent; of the hinge that closes Bricard's
    mechanism four of five are. That is so on the constraints only. Where the pose is off by `drift`, as in the middle of a
    step, the rows differ from each other by as much, and all of them together would allow no motion. With W = L^-1 J^T and
    rows divided by their norms, singular values below `OWED` times drift, over the largest, are therefore left out, and
    what the rows ask there too.

    Attributes:
        found: Whether those that it was asked for last repeat each other.
    """

    def __init__(self) -> None:
        self.found = False
        self._norms = np.zeros(0)

    def reduced(self, W: Array, c: Array, held: Array, drift: float) -> tuple[Array, Array, float]:
        """(W, c, the largest part of c that was left out): the same arrays where the held rows are well independent.

        Args:
            W: L^-1 J^T, shape (nv, m).
            c: Velocity of the rows less J v, shape (m,).
            held: Which rows are held, indices.
            drift: How far their position is off [m, rad].
        """
        H = W[:, held]
        norms = np.sqrt(np.einsum("ij,ij->j", H, H))
        if len(norms) == len(self._norms):
            norms = np.maximum(norms, self._norms)
        most = float(norms.max())
        self._norms = norms = np.maximum(norms, 1e-6 * most) if most > 0.0 else np.ones(len(norms))
        R, info = lapack.dpotrf(H.T @ H, lower=0, clean=0)
        self.found = info != 0 or not (R.diagonal() > INDEPENDENT * norms).all()
        if not self.found:
            return W, c, 0.0
        U, s, Vt = np.linalg.svd(H / norms, full_matrices=False)
        kept = s > max(ZERO, OWED * drift) * s[0]
        self.found = not kept.all() or len(s) < len(held)
        if not self.found:
            return W, c, 0.0
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        told = c[held] / norms
        within = Vt.T @ (Vt @ told)
        W, c = W.copy(), c.copy()
        W[:, held], c[held] = (U * s) @ Vt * norms, within * norms
        return W, c, max_abs((told - within) * norms)


def _exact(S: Scaled) -> float:
    """The merit that will do: where next to nothing moves, rounding is more than `EXACT` of it."""
    return max(EXACT, _ROUNDING / S.rate)


def chosen_rows(layout: Layout, active: Array) -> tuple[Array | slice, tuple[tuple[str, slice, Cone], ...], Parts]:
    """(rows of the points that act, (constraint, its rows among them, set of its forces), these sets as weights)."""
    chosen = _choose(layout, active, 1.0)
    return chosen.index, chosen.groups, chosen.parts


def _choose(layout: Layout, active: Array, h: float) -> _Chosen:
    points = np.flatnonzero(active)
    index = slice(None) if active.all() else np.flatnonzero(np.repeat(active, layout.widths))
    groups: list[tuple[str, slice, Cone]] = []
    at, i = 0, 0
    while i < len(points):
        owner, members = layout.owners[points[i]], []
        while i < len(points) and layout.owners[points[i]] == owner:
            members.append(_over(layout.cones[points[i]], h))
            i += 1
        cone = members[0] if len(members) == 1 else Product(members)
        groups.append((owner, slice(at, at + cone.dim), cone))
        at += cone.dim
    # Sets alone matter here: rows of zeros stand in for those of a state.
    parts = parts_of([Rows(name, np.zeros((cone.dim, 1)), np.zeros(cone.dim), cone) for name, _, cone in groups])
    bilateral = bool(len(parts.mu) == 0 and np.isneginf(parts.lower).all() and np.isposinf(parts.upper).all())
    held = np.flatnonzero(layout.held[index])
    return _Chosen(index, tuple(groups), parts, bilateral, held, Stillness(parts) if parts.size else None)


def _held(D: Array, u: Array, size: float, problem: Callable[[], GaussProblem]) -> tuple[Array, float]:
    """(impulses that hold rows still, whatever it takes, the least where rows repeat each other; what they miss, over size)."""
    R = independent_factor(D)
    if R is not None:
        f = -lapack.dpotrs(R, u)[0]
    else:
        W = problem().whitened
        f = np.linalg.lstsq(W, -np.linalg.lstsq(W.T, u, rcond=1e-10)[0], rcond=1e-10)[0]
    return f, max_abs(D @ f + u) / size


def _names(chosen: _Chosen) -> str:
    return ", ".join(name for name, _, _ in chosen.groups)


def _over(cone: Cone, h: float) -> Cone:
    """Impulses over a time h of forces in a set; what is a cone stays."""
    if not isinstance(cone, Box):
        return cone
    return Box(*(np.where(np.isfinite(bound), 0.0, bound) if h == 0.0 else h * bound for bound in (cone.lo, cone.hi)))
