"""Programs over contact forces and parameters: feasibility, the farthest point along a direction, and proofs of both.

With pyramids a program is linear. With circular cones it is conic; where the conic solver does not end near enough, linear
programs over some rays of each cone follow, to which the multipliers add the rays that would help most: they end at the same
answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.problem.conic import Certificate, Conic
from rbd.problem.programs import CONE_REFINEMENTS, Outcome, linear_program
from rbd.solvers.conic_newton import solve_conic
from rbd.statics.force_balance import ForceBalance

SAME = 1e-9
"""Nothing is farther by less than this, over the size of p."""
_TOLERANCE = 1e-10
_CONIC = 1e-7
_OUTSIDE = 1e-9
"""Forces of a program are this near to balance and to their cones, over the weight."""
_BEYOND = 1e-6
"""What the multipliers of a conic program prove is this near to what its forces reach."""
_PRICED = 1e-9
"""A ray helps whose newton gains more than this."""


@dataclass(frozen=True, eq=False)
class ForceProgram(Conic):
    """What forces w and parameters p must meet, x = (w, p), with an objective still to be said: H = 0 and g = 0."""

    @classmethod
    def of_sets(
        cls, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, cones: Array, mu: Array
    ) -> ForceProgram:
        """From all but the objective; see `rbd.problem.conic.Conic`."""
        n = len(lower)
        return cls(np.zeros((n, n)), np.zeros(n), A, b, C, low, high, lower, upper, cones, mu)

    @classmethod
    def of_loads(cls, A: Array, b: Array, C: Array, low: Array, high: Array, loads: ForceBalance) -> ForceProgram:
        """With forces as weights of the loads, over their unit, and parameters of any size."""
        free, sets = np.full(A.shape[1] - loads.sets.size, np.inf), loads.sets
        lower, upper = np.concatenate([loads.lower, -free]), np.concatenate([loads.upper, free])
        return cls.of_sets(A, b, C, low, high, lower, upper, sets.cone_columns, sets.mu)

    def around(self, middle: Array, within: float) -> ForceProgram:
        """The same, with the two parameters so near to a point."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[-2:], upper[-2:] = middle - within, middle + within
        return replace(self, lower=lower, upper=upper)

    def farthest(self, gain: Array) -> Support:
        """The x with the largest gain . x, and the proof that there is no larger one.

        Args:
            gain: Shape (n,).
        """
        if len(self.mu):
            answer = self._farthest_of_cones(gain)
            return self._farthest_of_rays(gain) if answer.outcome is Outcome.NOT_FOUND else answer
        up, down = np.isfinite(self.high), np.isfinite(self.low)
        rows = np.vstack([self.C[up], -self.C[down]])
        sides = np.concatenate([self.high[up], -self.low[down]])
        bounds = np.column_stack([self.lower, self.upper])
        found = linear_program(-gain, rows, sides, self.A, self.b, bounds=bounds, tolerance=_TOLERANCE)
        if found.outcome is Outcome.NOT_FOUND:  # so near to rounding HiGHS does not always end
            found = linear_program(-gain, rows, sides, self.A, self.b, bounds=bounds)
            if found.solved and self.outside(found.x) > _OUTSIDE:
                return Support(Outcome.NOT_FOUND, gain, found.x, math.nan, found.equal, found.lower)
        if not found.solved:
            return Support(found.outcome, gain, found.x, math.nan, found.equal, found.lower)
        z = np.zeros(len(self.low))
        z[up] += found.lower[: int(up.sum())]
        z[down] -= found.lower[int(up.sum()) :]
        return Support(found.outcome, gain, found.x, self.bound(gain, found.equal, z), found.equal, z)

    def _farthest_of_cones(self, gain: Array) -> Support:
        found = solve_conic(replace(self, g=-gain), newton=False, tolerance=_CONIC)
        contradiction = None if found.certificate is None else Certificate.of(self, found.certificate.y, found.certificate.z)
        if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED) or not len(found.y):
            return Support(found.outcome, gain, found.x, math.nan, found.y, found.z, contradiction)
        # What counts is that forces exist, and that nothing is farther than their proof says: not how the method ended.
        value = self.bound(gain, found.y, found.z)
        met = self.outside(found.x) <= _OUTSIDE and value - float(gain @ found.x) <= _BEYOND
        return Support(Outcome.SOLVED if met else Outcome.NOT_FOUND, gain, found.x, value, found.y, found.z)

    def _farthest_of_rays(self, gain: Array) -> Support:
        """The same over some rays of each cone, and more where the multipliers say that another ray would help."""
        around = np.arange(8) * (np.pi / 4.0)
        rays = [(i, np.array([np.cos(x), np.sin(x)])) for i in range(len(self.mu)) for x in around]
        own = np.setdiff1d(np.arange(len(gain)), self.cones)  # columns of no cone
        for _ in range(CONE_REFINEMENTS):
            E = np.zeros((len(gain), len(own) + len(rays)))
            E[own, np.arange(len(own))] = 1.0
            for k, (i, d) in enumerate(rays, start=len(own)):
                E[self.cones[i], k] = *(self.mu[i] * d), 1.0
            low, high = np.zeros(E.shape[1]), np.full(E.shape[1], np.inf)
            low[: len(own)], high[: len(own)] = self.lower[own], self.upper[own]
            inner = ForceProgram.of_sets(
                self.A @ E, self.b, self.C @ E, self.low, self.high, low, high, self.cones[:0], self.mu[:0]
            )
            found = inner.farthest(gain @ E)
            proof = inner.contradiction() if found.outcome is Outcome.INFEASIBLE else None
            if not found.solved and proof is None:
                return Support(Outcome.NOT_FOUND, gain, gain, math.nan, found.y, found.z)
            y, z = (found.y, found.z) if proof is None else (proof.y, proof.z)
            r = (-gain if proof is None else 0.0) - y @ self.A - z @ self.C
            better = []
            for i, answer in enumerate(r[self.cones]):
                size = float(np.hypot(*answer[:2]))
                if self.mu[i] * size - answer[2] > _PRICED:
                    better.append((i, -answer[:2] / size))
            if not better:
                x = np.zeros(len(gain)) if proof is not None else E @ found.x
                none = None if proof is None else Certificate.of(self, y, z)
                return Support(found.outcome, gain, x, self.bound(gain, y, z), y, z, none)
            rays += better
        return Support(Outcome.NOT_FOUND, gain, gain, math.nan, found.y, found.z)

    def bound(self, gain: Array, y: Array, z: Array) -> float:
        """What gain . x does not exceed, by multipliers, whatever x is."""
        return -self.least(-gain - y @ self.A - z @ self.C, y, z)[0]

    def contradiction(self) -> Certificate | None:
        """The multipliers that prove that no x meets the program, by the least sum of what is missed; None if it is nothing."""
        (e, n), q = self.A.shape, len(self.low)
        A = np.hstack([self.A, np.eye(e), -np.eye(e), np.zeros((e, q))])
        give = np.hstack([np.zeros((q, 2 * e)), -np.eye(q)])
        C, up, down = np.vstack([np.hstack([self.C, give]), np.hstack([-self.C, give])]), self.high, -self.low
        sides = np.concatenate([up, down])
        kept = np.isfinite(sides)
        cost = np.concatenate([np.zeros(n), np.ones(2 * e + q)])
        bounds = np.column_stack([self.lower, self.upper]).tolist() + [(0.0, None)] * (2 * e + q)
        found = linear_program(cost, C[kept], sides[kept], A, self.b, bounds=bounds, tolerance=_TOLERANCE)
        if not found.solved:
            return None
        lower = np.zeros(2 * q)
        lower[kept] = found.lower
        z = lower[:q] - lower[q:]
        proof = Certificate.of(self, found.equal, z)
        return proof if proof is not None and proof.gap > SAME else None

    @property
    def recession(self) -> ForceProgram:
        """The directions in which x may go on without end, cut at |p| <= 1."""

        def gone(bounds: Array) -> Array:
            return np.where(np.isfinite(bounds), 0.0, bounds)

        lower, upper = gone(self.lower), gone(self.upper)
        lower[-2:], upper[-2:] = -1.0, 1.0
        return replace(self, b=np.zeros(len(self.b)), low=gone(self.low), high=gone(self.high), lower=lower, upper=upper)


@dataclass(frozen=True, eq=False)
class Support:
    """The farthest x along a direction.

    Attributes:
        outcome: How the program ended; the rest is meaningless unless that is SOLVED.
        gain: The direction, shape (n,).
        x: Where it is farthest, shape (n,).
        value: What gain . x does not exceed, by the multipliers.
        y: Multipliers of A x = b: gain = -(A^T y + C^T z) - r, where r answers to the sets of x.
        z: Multipliers of the rows between bounds: positive where the lower one holds, negative where the upper one does.
        contradiction: Where there is no x, the proof, if one came with the answer.
    """

    outcome: Outcome
    gain: Array
    x: Array
    value: float
    y: Array
    z: Array
    contradiction: Certificate | None = None

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return self.outcome is Outcome.SOLVED

    @property
    def point(self) -> Array:
        """The two parameters, shape (2,)."""
        return self.x[-2:]

    @property
    def direction(self) -> Array:
        """The direction in the plane, shape (2,)."""
        return self.gain[-2:]
