"""Gauss's principle as a quadratic program in the acceleration, by ProxSuite."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, identity, is_finite, max_abs, zeros
from rbd.displayed import Displayed
from rbd.problem.answer import Answer
from rbd.problem.gauss_problem import BILATERAL, CONVEX, GaussProblem, Law, checked
from rbd.problem.programs import nonnegative
from rbd.problem.residuals import ENOUGH, SOLVED
from rbd.solvers import qp
from rbd.solvers.kkt import constrained, held_refined, independent_factor
from rbd.solvers.refinement import rays_refined

POLISH = 1e-12
"""Residuals above this, over the largest numbers of the problem, call for an active-set refinement."""

_ROUNDING = float(np.finfo(float).eps)
_POLISHED = 4
"""Largest number of its rounds: more than one where small weights would turn negative."""
_STEEP = 1e4
"""Friction coefficients up to this lose at most 1e-12 of a normal force."""


@dataclass(frozen=True)
class ProxQP(Displayed):
    """Solver of Gauss's least-constraint problem, minimise `1/2 |a - a_free|_M^2`, as a QP; forces are its multipliers.

    Bilateral constraints are equalities; for every ray r of a force cone, r . (J a + offset) >= 0 is one inequality, its
    multiplier is that ray's weight, and the force is the sum of weight times ray. Circular cones are replaced by the
    circumscribed pyramids of their contacts' `facets`.

    The QP is posed in z, with a = a_free + L^-T Q z: L L^T = M makes the inertia metric Euclidean, and W = L^-1 J^T = Q R
    leaves out directions in the null space of J. Its Hessian is the identity whatever the robot's inertia, so ProxSuite
    needs no preconditioner. Forces between two bounds (dry friction) are soft rows, at the cost of the bound.

    Attributes:
        policy: Settings of ProxSuite to try in order; each answer is checked by its residuals.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> state = rbd.State(box, [0, 0, 0.1, 0, 0, 0, 1])
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6, facets=8)
        >>> solution = rbd.solve(state, [], [face], solver=rbd.ProxQP())
        >>> print(solution.law, solution.status, solution.forces["face"].round(3))
        convex, 8 facets solved [0.   0.  98.1  0.  0.   0. ]
    """

    policy: tuple[qp.Setting, ...] = qp.POLICY
    law: Law = CONVEX

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Names the first contact that slides, turns or impacts: no pyramid of forces describes its friction."""
        T = checked(problem).force_set
        if T.impact:
            return f"{T.impact}."
        if not T.slipping:
            return None
        r = problem.rows[T.slipping[0]]
        return (
            f"{r.name!r} moves at {r.speed:.3g} m/s, so its friction follows its motion, which no pyramid describes. "
            "Use rbd.ConeSolver()."
        )

    def solve(self, problem: GaussProblem) -> Answer:
        """The best of the attempts; the first that is `solved`, most often the first of all.

        Contradictory rows, and the least violation, are left to `rbd.solve_problem`.
        """
        start = time.perf_counter()
        P = checked(problem)
        if not P.m:
            seconds = time.perf_counter() - start
            return Answer(P, P.a_free.copy(), np.zeros(0), None, BILATERAL, "ProxQP", 0, seconds, method="QP")
        independent, T = independent_factor(P.delassus), P.force_set.pyramids
        # R^T R = J M^-1 J^T, m x m where the rows are independent, else (k, m) from W = Q R.
        R = np.asarray(np.linalg.qr(P.whitened, mode="r")) if independent is None else independent

        def answer(weights: Array, iterations: int) -> Answer:
            f, kept = (weights, None) if P.bilateral else (T.G @ weights, weights)
            a, seconds = constrained(P, f), time.perf_counter() - start
            redundant = independent is None
            return Answer(P, a, f, kept, pyramidal_law(P), "ProxQP", iterations, seconds, redundant=redundant, method="QP")

        return self._best(P, R, answer)

    def _best(self, P: GaussProblem, R: Array, answer: Callable[[Array, int], Answer]) -> Answer:
        """The best of the attempts; `answer` maps weights and iterations to an `Answer`."""
        rays = _Rays(P, R)
        along, opening, holds = rays.along, rays.opening, rays.holds
        # Scale of the QP's data; if far from one, its tolerances would be meaningless.
        length, rate = _size(math.sqrt(max_abs(P.delassus.diagonal()))), _size(max_abs(opening))
        rows, side = along if length == 1.0 else along / length, opening * (-1.0 / rate)
        A, b = (rows[holds], side[holds]) if holds.any() else (None, None)
        C, l = (rows[~holds], side[~holds]) if not holds.all() else (None, None)
        n = R.shape[0]
        H, g = identity(n), zeros(n)
        if rays.gives and C is not None and l is not None:
            H, g, A, C, l = rays.softened(A, C, l, length**2 / rate)
        best: Answer | None = None
        for attempt in qp.attempts(H, g, A, b, C, l, policy=self.policy):
            weights = rays.weights(attempt, rate / length**2)
            found = answer(weights, attempt.iterations)
            if not _exact(found):
                found = _better(found, answer(rays.polished(weights), attempt.iterations))
                if not found.residuals.within(ENOUGH):
                    found = held_refined(found) if P.bilateral else rays_refined(found)
            best = found if best is None else _better(best, found)
            if best.residuals.within(SOLVED):
                return best
        assert best is not None
        return best


def eased(answer: Answer) -> Answer:
    """The same answer of `ProxQP`, without large internal forces between contacts.

    ProxSuite's internal forces may be a million times as large as necessary, and leave their rounding in results
    computed from them.
    """
    P, w = answer.problem, answer.weights
    if w is None:
        return answer
    w = _Rays(P, np.asarray(np.linalg.qr(P.whitened, mode="r"))).polished(w, few=True)
    f = P.force_set.pyramids.G @ w
    return replace(answer, a=constrained(P, f), multipliers=f, weights=w)


def too_steep(failed: Answer) -> str:
    """Message if friction is so large that rounding of the rays' forces is the residual; else empty.

    A normal force is a sum of rays; their tangential parts, mu times as large, cancel up to rounding.
    """
    P, w, T = failed.problem, failed.weights, failed.problem.force_set
    if w is None or not failed.law.facets or not is_finite(w):
        return ""
    terms, most, out = np.abs(P.force_set.pyramids.G) @ np.abs(w), 0.1 * failed.residuals.worst, ""
    for rows, columns in zip(P.rows, T.slices, strict=True):
        own, mu = P.slices[rows.name], T.mu[(T.cone_at >= columns.start) & (T.cone_at < columns.stop)].max(initial=0.0)
        relative = float((terms[own] / failed.residuals.scales.row_forces[own]).max(initial=0.0))
        lost = _ROUNDING * max(relative, mu)  # tolerance for a nearly zero force
        if mu > _STEEP and lost > most:
            most = lost
            out = (
                f"{rows.name} has friction {mu:.3g}, too much for a pyramid in double precision: its normal force is a sum of "
                "rays whose tangential forces, as many times as large, cancel up to their rounding. Use rbd.ConeSolver(), "
                "whose cones are circular, or friction=None for a bilateral contact"
            )
    return out


class _Rays:
    """The rays, posed in weights u >= 0: w = base + sign u, u <= room; they accelerate at `along z + opening`.

    The constant force of the base moves to the rows' acceleration. A row with room is soft: along z + opening + n >= 0 with
    n >= 0 at a cost of room n, so that its multiplier u stays below the room: dual to the bound, and exact. Weights with
    equal bounds drop out.

    Attributes:
        along, opening: Of the remaining weights.
        holds: Which are of lines, whose acceleration is zero.
        room: Upper bounds of their u; inf for lines and rays.
        soft: Where the room is finite.
        gives: Whether any is soft.
    """

    def __init__(self, P: GaussProblem, R: Array) -> None:
        rays, c = P.force_set.pyramids, P.free_row_acceleration
        along, opening = (R.T, c) if P.bilateral else (rays.H.T @ R.T, rays.H.T @ c + rays.offset)
        self.base = np.where(rays.below, rays.finite_lower, rays.finite_upper)
        self.sign = np.where(rays.below | ~rays.above, 1.0, -1.0)
        self.kept = rays.lower < rays.upper
        moved = opening + along @ (along.T @ self.base)
        self.along = (self.sign[:, None] * along)[self.kept]
        self.opening = (self.sign * moved)[self.kept]
        self.holds = rays.is_line[self.kept]
        self.room = np.where(rays.below & rays.above, rays.finite_upper - rays.finite_lower, math.inf)[self.kept]
        self.soft = np.isfinite(self.room)
        self.gives = bool(self.soft.any())

    def softened(self, A: Array | None, C: Array, l: Array, scale: float) -> tuple[Array, Array, Array | None, Array, Array]:
        """(H, g, A, C, l) in (z, n) of a QP in z, with unit Hessian, whose multipliers are `scale` times the weights."""
        k, n, room = len(C), C.shape[1], self.room[~self.holds]
        soft = np.flatnonzero(np.isfinite(room))
        s = len(soft)
        H, g = np.zeros((n + s, n + s)), np.zeros(n + s)
        H[:n, :n], g[n:] = np.eye(n), scale * room[soft]
        wide = np.zeros((k + s, n + s))
        wide[:k, :n], wide[soft, n + np.arange(s)], wide[k:, n:] = C, 1.0, np.eye(s)
        return H, g, None if A is None else np.hstack([A, np.zeros((len(A), s))]), wide, np.r_[l, np.zeros(s)]

    def weights(self, attempt: qp.QPResult, scale: float) -> Array:
        """All weights w of an attempt."""
        u = np.zeros(len(self.holds))
        u[self.holds] = attempt.y
        u[~self.holds] = np.maximum(attempt.z[: np.count_nonzero(~self.holds)], 0.0)
        return self._all(u * scale)

    def polished(self, weights: Array, few: bool = False) -> Array:
        """`_polished` for the weights w."""
        u = (self.sign * (weights - self.base))[self.kept]
        return self._all(_polished(u, self.along, self.opening, self.holds, self.room, few))

    def _all(self, u: Array) -> Array:
        w = self.base.copy()
        w[self.kept] += self.sign[self.kept] * np.minimum(u, self.room)
        return w


def _size(top: float) -> float:
    """The largest entry where it is far from one, else one: ordinary robots are not scaled."""
    return 1.0 if top == 0.0 or 1e-3 <= top <= 1e6 else top


def _exact(found: Answer) -> bool:
    """Whether residuals are at most `POLISH` times the largest numbers of the problem, and solved."""
    P, (momentum, gap, off_cone, slack, _) = found.problem, found.residuals.values
    force = POLISH * max(1.0, max_abs(P.rhs), max_abs(found.multipliers))
    rate = max(1.0, max_abs(found.a))
    near = momentum <= force and gap <= POLISH * rate and off_cone <= force and slack <= force * rate
    return near and _creep(found) <= POLISH * rate and found.residuals.within(SOLVED)


def _creep(found: Answer) -> float:
    """The largest acceleration of forces between their bounds, such as dry friction that is not at its limit: they hold."""
    P, w = found.problem, found.weights
    T = P.force_set.pyramids
    if w is None or not T.has_intervals:
        return 0.0
    inside = T.below & T.above & (w > T.lower) & (w < T.upper)
    return max_abs(T.accelerations(P.J @ found.a + P.offset)[inside])


def _better(one: Answer, other: Answer) -> Answer:
    return other if other.residuals.less_than(one.residuals) else one


def _polished(
    weights: Array, along: Array, opening: Array, holds: Array, room: Array | float = math.inf, few: bool = False
) -> Array:
    """Corrected weights of the rays strictly inside their bounds, so that their accelerations are zero to rounding.

    Args:
        weights: Shape (r,).
        along: As of `_Rays`.
        opening: As there.
        holds: As there.
        room: Upper bounds of the weights.
        few: First reduce to few rays with the same force.
    """
    moved = _on_few(weights, along, holds, room) if few else weights.copy()
    for _ in range(_POLISHED):
        small = 1e-8 * max(1.0, float(np.abs(moved).max(initial=0.0)))
        active = holds | ((moved > small) & (moved < room - small))
        B = along[active]
        miss = B @ (along.T @ moved) + opening[active]
        moved[active] -= np.linalg.lstsq(B.T, np.linalg.lstsq(B, miss, rcond=1e-12)[0], rcond=1e-12)[0]
        pulls = ~holds & (moved < 0.0)
        if not pulls.any():
            break
        moved[pulls] = 0.0  # the least loaded; repeat without them
    return moved


def _on_few(weights: Array, along: Array, holds: Array, room: Array | float) -> Array:
    """Weights with the same force and few nonzero entries; the given ones where none are found."""
    moved, some = weights.copy(), holds | ((weights > 0.0) & ~np.isfinite(room))
    E, lines = along[some].T, holds[some]
    u = nonnegative(np.hstack([E, -E[:, lines]]), E @ weights[some])
    if u is None:
        return moved
    n = E.shape[1]
    u[:n][lines] -= u[n:]
    moved[some] = u[:n]
    return moved


def pyramidal_law(P: GaussProblem) -> Law:
    """The law with the pyramids that replace circular cones, e.g. "convex, 4 facets"."""
    return BILATERAL if P.bilateral else _with_facets(P.force_set.facets)


@lru_cache(maxsize=64)
def _with_facets(facets: tuple[int, ...]) -> Law:
    return Law("convex", facets)
