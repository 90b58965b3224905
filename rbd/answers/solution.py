"""`Solution`: an answer with its force distribution, uniqueness, infeasibility proof, derivatives and printed table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rbd.answers.analysis.admissible_forces import Admissible, admissible
from rbd.answers.analysis.conditions import relaxed, row_weights, smallest_violation
from rbd.answers.analysis.contact_modes import feedback_acceleration
from rbd.answers.analysis.enclosure import Enclosure, enclosure_of
from rbd.answers.analysis.force_choice import GIVEN_WEIGHT, MINIMUM_NORM, UNIQUE, metric, shortest
from rbd.answers.analysis.infeasibility import Contradiction, contradiction
from rbd.answers.analysis.sensitivity import Derivatives, StateOrigin
from rbd.answers.analysis.uniqueness import Uniqueness, motion_freedom, uniqueness_of
from rbd.answers.prepared.constraint_dynamics import FoundForces
from rbd.arrays import Array, lazy, max_abs, without_lazies
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution, Unsupported
from rbd.problem.answer import Answer, Status, corner_split, corners_of
from rbd.problem.contact_motion import opening_words
from rbd.problem.gauss_problem import GaussProblem, Law, checked
from rbd.problem.residuals import ENOUGH, SOLVED, USABLE
from rbd.problem.rows import Patch, Rows
from rbd.solvers import Solver
from rbd.solvers.default import solver_of
from rbd.solvers.proxqp import ProxQP, eased, pyramidal_law, too_steep


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Answer):
    """The answer of `rbd.solve`: acceleration and constraint forces, with residuals, ranges of forces and derivatives.

    `Solution.of(answer)` makes one of what a solver returned. It has the attributes of `Answer` (`problem`, `a`,
    `multipliers`, `weights`, `law`, `solver`, `method`, `iterations`, `seconds`, `infeasible`, `reason`, `redundant`), and:

    Attributes:
        others: Other motions that satisfy the same law, where the solver found some (Painleve's paradox, jammed
            points).
        chosen_corners: Corner forces chosen together with the multipliers; None: chosen on first use.
        choice: What they are, `force_choice`, where they were chosen.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> solution = rbd.solve(state, rbd.hold(state, feet).tau, feet)
        >>> print(solution.status, solution.method, np.abs(solution.a).max() < 1e-9)
        solved closed form True
        >>> print(f"{solution.contacts['front_left'].friction_used:.1%} of the friction is used")
        14.0% of the friction is used
    """

    others: tuple[Solution, ...] = ()
    chosen_corners: Mapping[str, Array] | None = None
    choice: str = ""

    @classmethod
    def of(cls, answer: Answer) -> Solution:
        """A solver's answer with its analysis; if rows are linearly dependent, with the forces of minimum norm.

        Those are the forces of `with_forces()`: the same from every solver that finds this motion.

        Raises:
            InputError: if it is no answer.
        """
        if isinstance(answer, Solution):
            return answer
        if not isinstance(answer, Answer):
            raise InputError(f"a solver gave {answer!r:.80}; expected an rbd.problem.Answer.")
        out = cls._copied(answer)
        return out.settled() if answer.redundant else out

    @classmethod
    def prepared(cls, problem: Callable[[], GaussProblem], found: FoundForces, law: Law, seconds: float) -> Solution:
        """An answer that was found and certified without a problem in arrays; that is assembled when it is first asked for.

        Args:
            problem: Assembles it.
            found: The answer.
            law: Whose it is.
            seconds: What it took [s].
        """
        out = cls.__new__(cls)
        a, forces, weights, method, steps = found[:5]
        out.__dict__.update(
            _assemble=problem, a=a, law=law, solver="ContactDynamics", method=method, iterations=steps, seconds=seconds,
            infeasible=False, others=(), reason="", redundant=found.choice != UNIQUE, chosen_corners=None,
            choice="" if found.choice == UNIQUE else found.choice, status=Status.SOLVED,
        )  # fmt: skip
        out.__dict__.update({"multipliers": forces, "weights": weights} if found.choice else {"_found": (forces, weights)})
        return out

    def __getattr__(self, name: str) -> Any:
        """The problem of a prepared answer, and its forces where they are not unique: when they are first asked for."""
        if name == "problem" and "_assemble" in self.__dict__:
            self.__dict__[name] = self.__dict__["_assemble"]()
        elif name in ("multipliers", "weights") and "_found" in self.__dict__:
            self._settle()
        else:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self.__dict__[name]

    def _settle(self) -> None:
        """The forces of minimum norm, in place of those that were found."""
        forces, weights = self.__dict__.pop("_found")
        self.__dict__.update(multipliers=forces, weights=weights)
        settled = self.settled()
        for name in ("a", "multipliers", "weights", "chosen_corners", "choice"):
            self.__dict__[name] = getattr(settled, name)
        for name in [name for name in ("residuals", "_admissible") if name in self.__dict__]:
            del self.__dict__[name]

    def __getstate__(self) -> dict[str, object]:
        """Copies and pickles have the problem, in place of what assembles it, and no values that can be computed again."""
        problem, _ = self.problem, self.multipliers
        kept = without_lazies(self) | {"problem": problem}
        kept.pop("_assemble", None)
        return kept

    @classmethod
    def _copied(cls, answer: Answer) -> Solution:
        out = cls.__new__(cls)
        out.__dict__.update(vars(answer))  # with what was computed of it, above all its residuals
        if answer.others:
            out.__dict__["others"] = tuple([cls._copied(other) for other in answer.others])
        return out

    @lazy
    def status(self) -> Status:
        """Status by the residuals; `INFEASIBLE` too if `contradiction` proves that there is no answer."""
        told = super().status
        proved = told is Status.FAILED and not self.impact and self.contradiction is not None
        return Status.INFEASIBLE if proved else told

    @lazy
    def contradiction(self) -> Contradiction | None:
        """The rows that contradict each other under this law, with the proof; None if they do not."""
        return contradiction(self.problem, self.law)

    @lazy
    def corner_forces(self) -> dict[str, Array]:
        """Forces at the corners of each contact, shape (k, 3), on the robot, world axes [N]; a point has one corner.

        They add up to the wrench, but four of them are not unique: `force_choice` describes the choice, `uniqueness()` how far
        they could go. A bilateral contact has no corner law: its corners may pull. `weights` stay what the solver found. Rows
        built by hand with a friction, line or wrench cone and no patch: in their axes, as the solver returned them.
        """
        by_hand = {r.name: self._by_hand(i, r) for i, r in enumerate(self.problem.rows) if r.patch is None and _has_points(r)}
        return by_hand | {name: corners.copy() for name, corners in self._split[0].items()}

    def _by_hand(self, i: int, rows: Rows) -> Array:
        corners = getattr(rows.cone, "corners", np.zeros((1, 3)))
        patch = Patch(np.zeros(3), np.eye(3), corners, None)
        return self._corners(i, replace(rows, patch=patch, resultant=np.eye(len(rows))))

    @property
    def force_choice(self) -> str:
        """Which `corner_forces` and `forces` were chosen, of those with the same motion under the same law.

        "unique"; "minimum norm of the corner forces [N]", inside the cones, row forces of other constraints in
        their units; "minimum of the given weight"; or "as ProxQP left it", if there is no answer.
        """
        return self._split[1]

    @lazy
    def _split(self) -> tuple[Mapping[str, Array], str]:
        """(corner forces, description of the choice)."""
        if "_found" in self.__dict__:
            self._settle()
        if self.chosen_corners is not None:
            return self.chosen_corners, self.choice
        corners = {r.name: self._corners(i, r) for i, r in enumerate(self.problem.rows) if r.patch is not None}
        if self.choice:
            return corners, self.choice
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
        """The same motion with the forces that minimise `sum_i weight_i |corner force_i|^2`, inside their cones.

        Args:
            weight: {contact: positive number, one number a corner (k,), or a positive definite matrix (3k, 3k) on its stacked
                corner forces in world axes}; 1 if not named. Constraints that are not contacts count with their row
                forces, in units of their rows. None: minimum norm.

        Returns:
            A solution with that `force_choice`; `multipliers`, `weights`, `forces` and `corner_forces` belong together, and
            its residuals certify them. If rounding keeps those above 1e-9, or they were not found within
            `rbd.problem.programs.FORCE_CHOICE_WORK`, the forces are unchanged, and `force_choice` tells it.

        Raises:
            InputError: on a weight that is not positive or does not fit.
            UnknownName: on a name that is no constraint of the problem.
            NoSolution: if this is no answer.
        """
        self._must_be_one("other forces were asked for")
        return self._with(self._admissible, weight)

    def settled(self) -> Solution:
        """The same with forces of minimum norm, `with_forces()`; itself if it is not an answer."""
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
        """Which forces are unique, and the ranges of the others with the same motion under the same law.

        It also shows whether the motion is unique: under Coulomb's law a patch that slips and turns on more than three
        corners has a family of motions, and the solver returns one of them.

        Raises:
            NoSolution: if this is no answer.
        """
        self._must_be_one("its uniqueness was asked for")
        return uniqueness_of(
            self._admissible, self.a, self.law, self.corner_forces, self.force_choice, self.multipliers, motion_freedom(self)
        )

    def enclosure(self) -> Enclosure:
        """Intervals of a and of the forces that contain the exact answer of the posed problem, by interval arithmetic.

        The arrays of the problem are taken as exact doubles: how they follow from the robot is not covered. It shows that there
        is exactly one motion with these contact modes, and, where the law is a convex one, that there is no other at all.

        Raises:
            NoSolution: if this is no answer.
            NotEnclosed: too near a change of contact mode; names the row, and what was needed.
        """
        self._must_be_one("intervals of it were asked for")
        return enclosure_of(self)

    def _must_be_one(self, what: str) -> None:
        if not self.residuals.within(USABLE):
            raise NoSolution(f"{self.worst}: this is no answer, and {what}.", problem=self.problem, result=self)

    def _corners(self, i: int, rows: Rows) -> Array:
        P, f = self.problem, self.multipliers[self.problem.slices[rows.name]]
        if self.weights is None:
            return corner_split(rows, f)
        return corners_of(rows, f, P.force_set_of(self.law), self.weights, i)

    @lazy
    def feedback_acceleration(self) -> Array:
        """The part of a by the rows' feedback, shape (nv,): zero without stabilisation.

        Through the active rows as they are: a less this is the motion that they alone would make.
        """
        return feedback_acceleration(self)

    def derivatives(self, parameters: Sequence[str] = ()) -> Derivatives:
        """Derivatives of a and the forces by q, v, tau and external forces, for fixed contact modes; see `Derivatives`.

        Args:
            parameters: Others to differentiate by, see `rbd.answers.analysis.ParameterDerivatives`: "friction", "mass",
                "inertia", "rotor_inertia", "gravity", and "stiffness", "damping", "rest", "preload" of springs in `external`.

        Raises:
            InputError: unknown parameters, or those of springs where there are none.
            NotDifferentiable: at a change of contact mode.
            Unsupported: of a problem built by hand, which has no state to differentiate by.
        """
        origin = StateOrigin(*self._assemble.args[:1], *self._assemble.args[2:4]) if "_assemble" in self.__dict__ else None
        origin = origin or self.problem.origin  # type: ignore[assignment]
        if origin is None:
            raise Unsupported(
                "a problem built by hand has no state to differentiate by. Use rbd.solve(state, ...), or "
                "rbd.solve_problem(rbd.gauss_problem(state, ...))."
            )
        return origin.derivatives(self, parameters)

    def __str__(self) -> str:
        lines = [f"{self.status} by {self.method or self.solver}, law: {self.law}; {self.problem.m} rows of rank {self.rank}"]
        if self.contacts:
            lines.append(f"  {'contact':<16}{'normal':>11}{'tangential':>13}{'friction used':>15}  centre of pressure")
        lines += [f"  {name:<16}{contact}" for name, contact in self.contacts.items()]
        others = [r.name for r in self.problem.rows if r.patch is None and len(r)]  # limits that are not reached have no rows
        lines += [f"  {name:<15} force {np.array2string(self.forces[name], precision=4)}" for name in others]
        if self.impact:
            lines.append(f"  {self.impact}")
        if self.opening:
            lines.append(f"  separate and carry no force: {opening_words(self.problem.openings)}")
        if self.reason:
            lines.append(f"  {'one of several motions: ' if self.others else ''}{self.reason}")
        lines.append(f"  1/2 |a - a_free|_M^2 = {self.gauss:.6g} N m/s2")
        lines.append(f"  residuals: {self.residuals}")
        return "\n".join(lines)


def _has_points(rows: Rows) -> bool:
    return rows.cone.at_points is not None and not rows.cone.separate


def solution_of(problem: GaussProblem, solver: Solver) -> Solution:
    """A solver's answer with its analysis; for contradictory rows the motion of least violation.

    The solver finds that motion from the rows relaxed by the least violation, so its forces are bounded. An answer that states
    why there is none (`Answer.reason`), though the rows do not contradict each other, is unchanged.
    """
    answer = solver.solve(problem)
    found = Solution.of(answer)
    if found.residuals.within(SOLVED) or found.residuals.within(USABLE):
        if not answer.redundant or found.residuals.within(ENOUGH) or not isinstance(solver, ProxQP):
            return found
        other = Solution.of(eased(answer))
        return other if other.residuals.less_than(found.residuals) else found
    if found.reason and not found.infeasible:
        return found
    if found.contradiction is None:
        reason = found.reason or too_steep(found)
        return replace(found, reason=reason) if reason != found.reason else found
    near = solver.solve(relaxed(problem, smallest_violation(problem, found.law)[0]))
    seconds = found.seconds + near.seconds
    return Solution.of(replace(near, problem=problem, infeasible=True, redundant=False, seconds=seconds))


@dataclass(frozen=True, eq=False, repr=False)
class NearestMotion(Displayed):
    """The motion that violates the constraints least, and of these the one nearest to free motion.

    Attributes:
        a: Acceleration, shape (nv,) [m/s2, rad/s2].
        violation: {constraint: s, shape (m,)}: what would have to be added to its row accelerations [m/s2, rad/s2]; zero
            where it is satisfied.
        optimality: Largest scaled residual of the least violation's own conditions: J^T f = 0, J a + offset + s in K*, and
            f . (J a + offset + s) = 0, with f = W^2 s.
        solution: The answer of the relaxed problem, rows with s added to their feedback, with its certificate.
    """

    a: Array
    violation: Mapping[str, Array]
    optimality: float
    solution: Solution

    @property
    def forces(self) -> dict[str, Array]:
        """Forces of the relaxed problem, as `Solution.forces` [N, N m]."""
        return self.solution.forces

    @property
    def worst(self) -> float:
        """Largest entry of the violation [m/s2, rad/s2]."""
        return max((max_abs(s) for s in self.violation.values()), default=0.0)

    def __str__(self) -> str:
        lines = [f"nearest motion: rows are missed by up to {self.worst:.3g} m/s2 (rad/s2), least squares"]
        for name, s in self.violation.items():
            if max_abs(s) > 0.0:
                lines.append(f"  {name:<16} by {np.array2string(np.round(s, 4) + 0.0, precision=4)}")
        return "\n".join([*lines, str(self.solution)])


def nearest_motion(
    problem: GaussProblem,
    *,
    weights: Mapping[str, float | Array] | None = None,
    law: Law | str | None = None,
    solver: Solver | None = None,
) -> NearestMotion:
    """The motion of least violation, and of these the nearest to free motion in the metric of inertia.

    For a feasible problem it is the answer, with no violation. Else the least violation comes first
    (`rbd.answers.analysis.conditions`); then, among all accelerations with that violation, Gauss's problem: the rows with s
    added to their feedback can be met together.

    Args:
        problem: Constraints that may contradict each other.
        weights: {constraint: weight w > 0 of its rows, one number or shape (m,)}: sum (w s)^2 is minimised. 1 if not given,
            so that 1 rad/s2 counts as 1 m/s2.
        law: Of the violation, and of the relaxed problem, as in `rbd.solve`.
        solver: Solves the relaxed problem, as in `rbd.solve`.

    Raises:
        InputError: unknown constraints, weights that are not positive, a law that is not the solver's.
        Unsupported: the solver cannot take the problem.
        NoSolution: one of the two programs was not solved within tolerance.
    """
    P, chosen = checked(problem), solver_of(law, solver)
    reason = chosen.reason_unsupported(P)
    if reason is not None:
        raise Unsupported(reason)
    told = pyramidal_law(P) if isinstance(chosen, ProxQP) else Law.of(chosen.law)
    s, optimality = smallest_violation(P, told, row_weights(P, weights))
    solution = solution_of(relaxed(P, s) if s.any() else P, chosen)
    if optimality > USABLE or solution.status not in (Status.SOLVED, Status.INACCURATE):
        raise NoSolution(
            f"the nearest motion was not found: least violation to {optimality:.1e}, scaled (usable is 1e-7), relaxed problem "
            f"{solution.status}: {solution.worst}.",
            problem=solution.problem,
            result=solution,
        )
    return NearestMotion(solution.a, {name: s[part].copy() for name, part in P.slices.items()}, optimality, solution)
