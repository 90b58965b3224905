"""The answer and its proof: residuals recomputed from the problem, never taken from a solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from rbd.analysis.admissible import Admissible
from rbd.analysis.complementary import admissible
from rbd.analysis.contradiction import Contradiction, contradiction
from rbd.analysis.family import motion_freedom
from rbd.analysis.feedback import feedback_acceleration
from rbd.analysis.force_choice import GIVEN_WEIGHT, MINIMUM_NORM, UNIQUE, metric, shortest
from rbd.analysis.uniqueness import Uniqueness, uniqueness
from rbd.arrays import Array, lazy
from rbd.errors import NoSolution, Unsupported
from rbd.problem.cones import FrictionCone, LineCone, WrenchCone
from rbd.problem.contact_force import ContactForce, contact_force, corner_split
from rbd.problem.openings import opening_words
from rbd.problem.problem import GaussProblem
from rbd.problem.rays import rays
from rbd.problem.residuals import ENOUGH, SOLVED, USABLE, Residuals, blame, residuals
from rbd.problem.rows import Patch, Rows

if TYPE_CHECKING:
    from rbd.analysis.sensitivity import Derivatives

RANK_TOLERANCE = 1e-9
"""Singular values of J below this, times the largest, count as zero in `Solution.rank`."""


class Status(StrEnum):
    """What the residuals of a solution amount to."""

    SOLVED = "solved"
    """Every scaled residual is at most 1e-9."""
    INACCURATE = "inaccurate"
    """Every scaled residual is at most 1e-7; said aloud by a warning."""
    FAILED = "failed"
    """A scaled residual is above 1e-7, or a contact approaches, which is an impact: not an answer."""
    INFEASIBLE = "infeasible"
    """Not an answer, and a certificate proves that there is none (`Solution.contradiction`)."""


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

    def __reduce__(self) -> tuple[object, ...]:
        return Gauss, (float(self), self.shares)


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
        infeasible: Whether the solver knows that no acceleration satisfies the rows; see `contradiction` for the proof.
        others: Other motions that satisfy the same law, where the solver found some (Painleve's paradox).
        reason: Why there is no answer, or what the several are, in the solver's words; else empty.
        chosen_corners: Corner forces that were chosen together with the multipliers; None: chosen when asked for.
        choice: What they are, `force_choice`, where they were chosen.
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
    chosen_corners: Mapping[str, Array] | None = None
    choice: str = ""

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
        if self.impact:
            return Status.FAILED
        if self.residuals.within(SOLVED):
            return Status.SOLVED
        if self.residuals.within(USABLE):
            return Status.INACCURATE
        return Status.INFEASIBLE if self.infeasible or self.contradiction is not None else Status.FAILED

    @lazy
    def contradiction(self) -> Contradiction | None:
        """The rows that contradict each other under this law, with the proof; None where they do not."""
        return contradiction(self.problem, self.law)

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

        They add up to the wrench, but four of them are not unique: `force_choice` says which these are, `uniqueness()` how far
        they could go. A contact that holds has no corner law: its corners may pull. `weights` stay what the solver found. Rows
        made by hand with a friction, line or wrench cone and no patch: in their own axes, as the solver left them.
        """
        by_hand = {r.name: self._by_hand(i, r) for i, r in enumerate(self.problem.rows) if r.patch is None and _has_points(r)}
        return by_hand | {name: corners.copy() for name, corners in self._split[0].items()}

    def _by_hand(self, i: int, rows: Rows) -> Array:
        corners = np.zeros((1, 3)) if isinstance(rows.cone, FrictionCone) else rows.cone.corners  # type: ignore[attr-defined]
        patch = Patch(np.zeros(3), np.eye(3), corners, None)
        return self._corners(i, replace(rows, patch=patch, resultant=np.eye(len(rows))))

    @property
    def force_choice(self) -> str:
        """Which of all forces that give the same motion under the same law `corner_forces` and `forces` are.

        "unique"; "minimum norm of the corner forces [N]", inside the cones, row forces of what is no contact counted in
        their units; "minimum of the given weight"; or "as ProxQP left it", as of what is no answer.
        """
        return self._split[1]

    @lazy
    def _split(self) -> tuple[Mapping[str, Array], str]:
        """(corner forces, which they are)."""
        if self.chosen_corners is not None:
            return self.chosen_corners, self.choice
        corners = {r.name: self._corners(i, r) for i, r in enumerate(self.problem.rows) if r.patch is not None}
        if self.residuals.within(USABLE):
            found = self._admissible
            if not found.null.shape[1]:
                return corners, UNIQUE
            if found.rank == self.problem.m:  # the row forces are unique, their split is not
                x = shortest(found)
                if x is not None and self._agrees(found, x):
                    return corners | found.corner_forces(x), MINIMUM_NORM
        return corners, f"as {self.solver} left it"

    def _agrees(self, found: Admissible, x: Array) -> bool:
        missed = np.abs(found.forces(x) - self.multipliers)
        return bool((missed <= SOLVED * self.residuals.scales.row_forces).all()) and found.outside(x) <= SOLVED * found.size

    @lazy
    def _admissible(self) -> Admissible:
        tolerance = SOLVED if self.residuals.within(SOLVED) else USABLE
        return admissible(self.problem, self.a, self.multipliers, self.weights, self.law, tolerance=tolerance)

    def with_forces(self, weight: Mapping[str, object] | None = None) -> Solution:
        """The same motion with the forces that minimise sum_i weight_i |corner force_i|^2, inside their cones.

        Args:
            weight: {contact: positive number, one number a corner (k,), or a positive definite matrix (3k, 3k) on its stacked
                corner forces in world axes}; 1 of what is not named. Constraints that are no contacts count with their row
                forces, in units of their rows. None: minimum norm.

        Returns:
            A solution whose `force_choice` says so; `multipliers`, `weights`, `forces` and `corner_forces` belong together, and
            its residuals certify them. Where rounding keeps those above 1e-9, or they were not found within
            `rbd.problem.limits.FORCE_CHOICE_WORK`, the forces stay as they were, and it says that.

        Raises:
            InputError: on a weight that is not positive or does not fit.
            UnknownName: on a name that is no constraint of the problem.
            NoSolution: if this is no answer.
        """
        self._must_be_one("other forces were asked for")
        return self._with(self._admissible, weight)

    def settled(self) -> Solution:
        """The same with forces of minimum norm, `with_forces()`; itself where it is no answer.

        For solvers to call where rows depend on each other, so that all of them return the same forces.
        """
        return self._with(self._admissible, None) if self.residuals.within(USABLE) else self

    def _with(self, found: Admissible, weight: Mapping[str, object] | None) -> Solution:
        x = shortest(found, metric(found, weight))
        corners = {r.name: self._corners(i, r) for i, r in enumerate(self.problem.rows) if r.patch is not None}
        if x is not None:
            name = UNIQUE if not found.null.shape[1] else MINIMUM_NORM if weight is None else GIVEN_WEIGHT
            f = self.multipliers if found.rank == self.problem.m else found.forces(x)
            chosen = corners | found.corner_forces(x)
            out = replace(self, multipliers=f, weights=found.law_weights(x), chosen_corners=chosen, choice=name)
            if out.residuals.within(ENOUGH):
                return out
            # Great internal forces leave their rounding in a: once more from the smaller ones.
            again = replace(out, a=self.a_free + self.problem.solve_M(self.problem.J.T @ f))
            out = again if again.residuals.less_than(out.residuals) else out
            if out.residuals.within(SOLVED if self.residuals.within(SOLVED) else USABLE):
                return out
        return replace(self, chosen_corners=corners, choice=f"as {self.solver} left it")

    def uniqueness(self) -> Uniqueness:
        """What is unique of the forces, and how far the rest could go with the same motion under the same law.

        It tells too whether the motion itself stands alone: under Coulomb's law a patch that slips and turns on more than three
        corners has a family of motions, and the solver returns one of them.

        Raises:
            NoSolution: if this is no answer.
        """
        self._must_be_one("its uniqueness was asked for")
        return uniqueness(
            self._admissible, self.a, self.law, self.corner_forces, self.force_choice, self.multipliers, motion_freedom(self)
        )

    def _must_be_one(self, what: str) -> None:
        if not self.residuals.within(USABLE):
            raise NoSolution(f"{self.worst}: this is no answer, and {what}.", problem=self.problem, result=self)

    def _corners(self, i: int, rows: Rows) -> Array:
        P = self.problem
        if self.weights is not None and len(rows) and "facets" not in self.law and not rays(rows.cone).all_lines:
            assert rows.patch is not None
            return P.parts.at_points(self.weights, P.parts.slices[i]) @ rows.patch.axes.T
        weights = None if self.weights is None else self.weights[P.ray_slices[i]]
        return corner_split(rows, self.multipliers[P.slices[rows.name]], weights)

    @property
    def opening(self) -> tuple[str, ...]:
        """Names of the contacts, and stops, that carry nothing as they, or some of their points, already move away.

        Faster than `GaussProblem.rest_speed`; `problem.openings` has their points and speeds.
        """
        return tuple(dict.fromkeys(point.rows for point in self.problem.openings))

    @property
    def impact(self) -> str:
        """Which contact approaches, in words: no acceleration answers that. Empty where none does; `rbd.solve` refuses it."""
        return self.problem.parts.impact if self.problem.moving else ""

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
    def feedback_acceleration(self) -> Array:
        """The part of a that the rows' feedback makes, shape (nv,): zero without stabilisation; see `rbd.analysis.feedback`.

        Through the active rows as they are: a less this is the motion that they alone would make.
        """
        return feedback_acceleration(self.problem, self.weights, self.law)

    def derivatives(self) -> Derivatives:
        """How a and the forces change with q, v, tau and external forces, the contact modes held; see `Derivatives`.

        Raises:
            NotDifferentiable: at a change of contact mode.
            Unsupported: of a problem built by hand, which has no state to differentiate by.
        """
        if self.problem.origin is None:
            raise Unsupported(
                "a problem built by hand has no state to differentiate by. Use rbd.solve(state, ...), or "
                "solver.solve(rbd.gauss_problem(state, ...))."
            )
        return self.problem.origin.derivatives(self)

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
        others = [r.name for r in self.problem.rows if r.patch is None and len(r)]  # limits that are not reached have no rows
        lines += [f"  {name:<15} force {np.array2string(self.forces[name], precision=4)}" for name in others]
        if self.impact:
            lines.append(f"  {self.impact}")
        if self.opening:
            lines.append(f"  move away and carry nothing: {opening_words(self.problem.openings)}")
        if self.reason:
            lines.append(f"  {'one of several motions: ' if self.others else ''}{self.reason}")
        lines.append(f"  1/2 |a - a_free|_M^2 = {self.gauss:.6g} N m/s2")
        lines.append(f"  residuals: {self.residuals}")
        return "\n".join(lines)


def _has_points(rows: Rows) -> bool:
    return isinstance(rows.cone, FrictionCone | LineCone | WrenchCone)
