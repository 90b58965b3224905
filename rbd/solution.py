"""The answer and its proof: residuals recomputed from the problem, never taken from a solver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from rbd.arrays import Array, lazy
from rbd.contact_force import ContactForce, contact_force, corner_split
from rbd.problem import GaussProblem
from rbd.rays import rays
from rbd.residuals import SOLVED, USABLE, Residuals, blame, residuals
from rbd.rows import Rows

RANK_TOLERANCE = 1e-9
"""Singular values of J below this, times the largest, count as zero in `Solution.rank`."""


class Status(StrEnum):
    """What the residuals of a solution amount to."""

    SOLVED = "solved"
    """Every scaled residual is at most 1e-9."""
    INACCURATE = "inaccurate"
    """Every scaled residual is at most 1e-7; said aloud by a warning."""
    FAILED = "failed"
    """A scaled residual is above 1e-7: not an answer."""
    INFEASIBLE = "infeasible"
    """Not an answer, and a linear program confirms that there is none."""


class Gauss(float):
    """Gauss's function 1/2 |a - a_free|_M^2 [N m/s2], the sum of the constraints' shares.

    A float that also carries `shares`: {name: 1/2 f_i . J_i (a - a_free)}. A share may be negative: one constraint
    can push where another already pulls.
    """

    shares: dict[str, float]

    def __new__(cls, total: float, shares: dict[str, float]) -> Gauss:
        """A total with its shares."""
        self = super().__new__(cls, total)
        self.shares = shares
        return self


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """Acceleration and constraint forces of one `GaussProblem`, with what proves them.

    Attributes:
        problem: What was solved.
        a: Acceleration, shape (nv,) [m/s2, rad/s2]; on a floating base, linear then angular in the base's axes.
        multipliers: Row forces f, stacked as the rows are, shape (m,) [N, N m], on the robot.
        weights: What adds up to f: of the rays (`problem.rays`) where the law speaks of facets, else of the true parts
            (`problem.parts`), shape (r,); None where all rows hold.
        law: The law whose residuals are given: "bilateral", "convex", "convex, 4 facets" or "coulomb".
        solver: Name of the solver.
        iterations: What the solver needed.
        seconds: Time in the solver [s].
        infeasible: Whether a linear program confirmed that no acceleration satisfies the rows.
        others: Other motions that satisfy the same law, where the solver found some (Painleve's paradox).
        reason: Why there is no answer, in the solver's words; empty where there is one.
    """

    problem: GaussProblem
    a: Array
    multipliers: Array
    weights: Array | None
    law: str
    solver: str
    iterations: int
    seconds: float
    infeasible: bool = False
    others: tuple[Solution, ...] = ()
    reason: str = ""

    @property
    def a_free(self) -> Array:
        """Acceleration without the constraints, shape (nv,)."""
        return self.problem.a_free

    @lazy
    def residuals(self) -> Residuals:
        """How far a and f are from the equations of the law; see `Residuals`."""
        return residuals(self.problem, self.a, self.multipliers, self.weights, self.law)

    @lazy
    def status(self) -> Status:
        """What the residuals amount to."""
        if self.residuals.within(SOLVED):
            return Status.SOLVED
        if self.residuals.within(USABLE):
            return Status.INACCURATE
        return Status.INFEASIBLE if self.infeasible else Status.FAILED

    @lazy
    def forces(self) -> dict[str, Array]:
        """Force (3,) of a point, wrench (6,) of a surface at its centre: on the robot, world axes [N, N m].

        A constraint without a resultant (a function, a joint) gives its row forces (m,).
        """
        f, out = self.multipliers, {}
        for rows in self.problem.rows:
            part = f[self.problem.slices[rows.name]]
            out[rows.name] = part.copy() if rows.resultant is None else rows.resultant @ part
        return out

    @lazy
    def corner_forces(self) -> dict[str, Array]:
        """Forces at the corners of each contact, shape (k, 3), on the robot, world axes [N]; a point has one corner.

        They add up to the wrench, but four of them are not unique. A contact that holds has no corner law: its split is
        the minimum-norm one, and may pull.
        """
        return {r.name: self._corners(i, r) for i, r in enumerate(self.problem.rows) if r.patch is not None}

    def _corners(self, i: int, rows: Rows) -> Array:
        P = self.problem
        if self.weights is not None and len(rows) and "facets" not in self.law and not rays(rows.cone).all_lines:
            assert rows.patch is not None
            return P.parts.point_forces(self.weights, P.parts.slices[i]) @ rows.patch.axes.T
        weights = None if self.weights is None else self.weights[P.ray_slices[i]]
        return corner_split(rows, self.multipliers[P.slices[rows.name]], weights)

    @lazy
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return {r.name: contact_force(r.patch, self.forces[r.name]) for r in self.problem.rows if r.patch is not None}

    @lazy
    def accelerations(self) -> dict[str, Array]:
        """J a + J_dot v of each constraint, shape (m,), in its own axes, feedback left out [m/s2, rad/s2]."""
        c = self.problem.J @ self.a + self.problem.bias
        return {name: c[part] for name, part in self.problem.slices.items()}

    @lazy
    def gauss(self) -> Gauss:
        """Gauss's function and each constraint's share of it."""
        P = self.problem
        moved = self.a - P.a_free
        work = self.multipliers * (P.J @ moved)
        shares = {name: 0.5 * float(work[part].sum()) for name, part in P.slices.items()}
        return Gauss(0.5 * float(moved @ P.M @ moved), shares)

    @lazy
    def rank(self) -> int:
        """Rank of J, at singular values above `RANK_TOLERANCE` times the largest."""
        if not self.problem.m:
            return 0
        s = np.linalg.svd(self.problem.J, compute_uv=False)
        return int((s > RANK_TOLERANCE * s[0]).sum())

    @property
    def worst(self) -> str:
        """The constraint that misses its equations most, and by how much, in words."""
        return blame(self.problem, self.a, self.multipliers, self.weights, self.law)

    def __repr__(self) -> str:
        return f"Solution({self.status}, law {self.law!r}, {self.solver}, worst residual {self.residuals.worst:.1e})"

    def __str__(self) -> str:
        lines = [f"{self.status} by {self.solver}, law: {self.law}; {self.problem.m} rows of rank {self.rank}"]
        if self.contacts:
            lines.append(f"  {'contact':<16}{'normal':>11}{'tangential':>13}{'friction used':>15}  centre of pressure")
        lines += [f"  {name:<16}{contact}" for name, contact in self.contacts.items()]
        others = [r.name for r in self.problem.rows if r.patch is None]
        lines += [f"  {name:<16}force {np.array2string(self.forces[name], precision=4)}" for name in others]
        lines.append(f"  1/2 |a - a_free|_M^2 = {self.gauss:.6g} N m/s2")
        lines.append(f"  residuals: {self.residuals}")
        return "\n".join(lines)
