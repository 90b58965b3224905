"""Gauss's principle as a quadratic program in the acceleration, by ProxSuite."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, identity, largest, zeros
from rbd.problem import GaussProblem, checked
from rbd.rays import rays
from rbd.residuals import SOLVED
from rbd.solution import Solution
from rbd.solvers import qp
from rbd.solvers.kkt import constrained, independent_factor

POLISH = 1e-12
"""An answer whose scaled residuals are above this gets one step on its active rays; kept if it is better."""


@dataclass(frozen=True)
class ProxQP:
    """Gauss's least-constraint problem, minimise 1/2 |a - a_free|_M^2, as a ProxSuite QP; forces are its multipliers.

    Constraints that hold are equalities; for every ray r of a force cone, r . (J a + offset) >= 0 is one inequality, its
    multiplier is that ray's weight, and the force is the sum of weight times ray. Circular cones are replaced by the
    circumscribed pyramids of their contacts' `facets`.

    The QP is posed in z, with a = a_free + L^-T Q z: L L^T = M makes the inertia metric Euclidean, and W = L^-1 J^T = Q R
    leaves out the directions that no row feels. Its Hessian is the identity whatever the robot's inertia, so ProxSuite
    needs no preconditioner.

    Attributes:
        policy: Settings of ProxSuite to try in order; each answer is judged by its own residuals.
    """

    policy: tuple[qp.Setting, ...] = qp.POLICY
    law: str = "convex"

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Names the first constraint whose forces are bounded on both sides, or that already moves."""
        if checked(problem).moving:
            r = problem.moving[0]
            return (
                f"{r.name!r} moves at {r.speed:.3g} m/s, so its friction follows its motion, which no pyramid of forces says. "
                "Use rbd.ADMM()."
            )
        if not problem.rays.has_intervals:
            return None
        bad = next(r for r in problem.rows if rays(r.cone).has_intervals)
        return f"ProxQP takes cones, and {bad.name!r} has forces in a bounded set ({type(bad.cone).__name__})."

    def solve(self, problem: GaussProblem) -> Solution:
        """The best of the attempts; the first that is `solved`, most often the first of all."""
        start = time.perf_counter()
        P = checked(problem)
        if not P.m:
            return Solution(P, P.a_free.copy(), np.zeros(0), None, "bilateral", "ProxQP", 0, time.perf_counter() - start)
        R = _factor(P)
        along, opening, holds = _ray_rows(P, R)
        # Of the QP's data; far from one, its tolerances would mean nothing.
        length, rate = _size(math.sqrt(largest(P.delassus.diagonal()))), _size(largest(opening))
        A: Array | None = along if length == 1.0 else along / length
        b: Array | None = opening * (-1.0 / rate)
        C: Array | None = None
        l: Array | None = None
        if not P.bilateral:
            A, b, C, l = None, None, A, b
            if P.rays.has_lines and C is not None and l is not None:
                A, b, C, l = C[holds], l[holds], C[~holds], l[~holds]
        n = R.shape[0]
        best: Solution | None = None
        for attempt in qp.attempts(identity(n), zeros(n), A, b, C, l, None, policy=self.policy):
            weights = np.maximum(attempt.z, 0.0) if A is None else attempt.y
            if A is not None and C is not None:
                weights = np.empty(len(holds))
                weights[holds] = attempt.y
                weights[~holds] = np.maximum(attempt.z, 0.0)
            if length != 1.0 or rate != 1.0:
                weights = weights * (rate / length**2)
            found = _solution(P, weights, attempt.iterations, start)
            if not found.residuals.within(POLISH):
                found = _better(found, _solution(P, _polished(weights, along, opening, holds), attempt.iterations, start))
            best = found if best is None else _better(best, found)
            if best.residuals.within(SOLVED):
                return best
        assert best is not None
        violation = qp.least_violation(along[holds], -opening[holds], along[~holds], -opening[~holds])
        infeasible = not math.isnan(violation) and violation > 1e-6 * max(1.0, float(np.abs(opening).max()))
        return Solution(
            P, best.a, best.multipliers, best.weights, best.law, "ProxQP", best.iterations,
            time.perf_counter() - start, infeasible,
        )  # fmt: skip


def _factor(P: GaussProblem) -> Array:
    """R with R^T R = J M^-1 J^T, shape (k, m): m x m where the rows are independent, else from W = Q R."""
    R = independent_factor(P.delassus)
    return np.asarray(np.linalg.qr(P.whitened, mode="r")) if R is None else R


def _ray_rows(P: GaussProblem, R: Array) -> tuple[Array, Array, Array]:
    """(along, opening, holds): rays accelerate at `along z + opening`; those that hold must keep still."""
    if P.bilateral:
        return R.T, P.free_row_acceleration, P.rays.is_line
    G = P.rays.G
    return G.T @ R.T, G.T @ P.free_row_acceleration, P.rays.is_line


def _size(top: float) -> float:
    """The largest entry where it is far from one, else one: ordinary robots are solved as they are."""
    return 1.0 if top == 0.0 or 1e-3 <= top <= 1e6 else top


def _solution(P: GaussProblem, weights: Array, iterations: int, start: float) -> Solution:
    f = weights if P.bilateral else P.rays.G @ weights
    a = constrained(P, f)
    kept = None if P.bilateral else weights
    return Solution(P, a, f, kept, law_name(P), "ProxQP", iterations, time.perf_counter() - start)


def _better(one: Solution, other: Solution) -> Solution:
    return other if not other.residuals.worst >= one.residuals.worst else one


def _polished(weights: Array, along: Array, opening: Array, holds: Array) -> Array:
    """Weights moved, within the rays that carry something, so that those rays keep still to rounding."""
    active = holds | (weights > 1e-8 * max(1.0, float(np.abs(weights).max())))
    B = along[active]
    miss = B @ (along.T @ weights) + opening[active]
    moved = weights.copy()
    moved[active] -= np.linalg.lstsq(B.T, np.linalg.lstsq(B, miss, rcond=1e-12)[0], rcond=1e-12)[0]
    return np.where(holds, moved, np.maximum(moved, 0.0))


def law_name(P: GaussProblem) -> str:
    """The law with what stands in for circular cones, e.g. "convex, 4 facets"."""
    if P.bilateral:
        return "bilateral"
    facets = sorted(P.rays.facets)
    return "convex" + (f", {' and '.join(map(str, facets))} facets" if facets else "")
