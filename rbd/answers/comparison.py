"""Comparison of answers to one problem: by every solver that accepts it, and by both contact laws.

Differences between solvers; and the behaviour of each contact under each law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rbd.answers.least_constraint import answered, assembled
from rbd.answers.solution import Solution, solution_of
from rbd.arrays import Array, max_abs, range_of
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed
from rbd.errors import NoSolution, Reason
from rbd.model.external import External
from rbd.model.state import State
from rbd.problem.answer import CARRIES_NOTHING_N, Status, at_corners
from rbd.problem.cones import NonNegative
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.gauss_problem import CONVEX, GaussProblem, Law
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.records import Field
from rbd.solvers import Solver
from rbd.solvers.admm import ConeSolver
from rbd.solvers.default import solver_of
from rbd.solvers.kkt import KKT
from rbd.solvers.proxqp import ProxQP, pyramidal_law

SAME = 1e-7
"""Accelerations and forces that differ by less, over max(1, the largest entry), are the same."""


@dataclass(frozen=True, eq=False)
class SolverAnswer:
    """The answer of one solver.

    Attributes:
        solver: Its name, with its law.
        law: The law of the answer.
        status: What its residuals amount to.
        worst: Largest scaled residual.
        seconds: Time in the solver [s].
        a: Acceleration, shape (nv,).
        unique_forces: The part of the row forces that the motion decides, shape (m,) [N, N m].
    """

    solver: str
    law: Law
    status: Status
    worst: float
    seconds: float
    a: Array
    unique_forces: Array


@dataclass(frozen=True, eq=False, repr=False)
class SolverComparison(Displayed):
    """The answers of all solvers to one problem, and their differences.

    Attributes:
        answers: In the order of the solvers.
        refused: {solver: why it does not take the problem}.
        differences: (one, other, in a, in the unique part of the forces) for each pair, over max(1, largest entry).

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> all_of_them = rbd.studies.compare_solvers(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face])
        >>> all_of_them.agree, [answer.solver for answer in all_of_them.answers]
        (True, ['ProxQP', 'ConeSolver on pyramids', 'ConeSolver, convex', 'ConeSolver, coulomb'])
    """

    answers: tuple[SolverAnswer, ...]
    refused: dict[str, str]
    differences: tuple[tuple[str, str, float, float], ...]

    @property
    def worst(self) -> float:
        """Largest difference between two solved answers of one law; zero if no two share a law."""
        law = {x.solver: x.law for x in self.answers}
        return max([max(da, df) for one, other, da, df in self.differences if law[one] == law[other]], default=0.0)

    @property
    def agree(self) -> bool:
        """Whether all are solved, and those of one law agree, to `SAME`."""
        return all(x.status is Status.SOLVED for x in self.answers) and self.worst <= SAME

    def __repr__(self) -> str:
        return f"SolverComparison({len(self.answers)} answers, worst {self.worst:.1e} within a law)"

    def __str__(self) -> str:
        lines = [f"  {'solver':<24}{'law':<20}{'status':<12}{'worst residual':>15}{'time':>12}"]
        lines += [
            f"  {x.solver:<24}{str(x.law):<20}{x.status:<12}{x.worst:>15.1e}{1e6 * x.seconds:>9.0f} us" for x in self.answers
        ]
        law = {x.solver: x.law for x in self.answers}
        for same, title in ((True, "one law, so these must agree"), (False, "two laws: these may differ")):
            pairs = [d for d in self.differences if (law[d[0]] == law[d[1]]) is same]
            if pairs:
                lines.append(f"  {title} (relative):")
                lines += [f"    {one} and {other}: a {da:.1e}, forces {df:.1e}" for one, other, da, df in pairs]
        lines += [f"  {name} does not take it: {why}" for name, why in self.refused.items()]
        verdict = "all that must agree do" if self.agree else "NOT ALL AGREE"
        return "\n".join([f"{len(self.answers)} solvers; {verdict}, to {self.worst:.1e}", *lines])


def compare_solvers(
    state: State,
    tau: Array | None,
    constraints: Sequence[Constraint] = (),
    *,
    external: External = None,
    rest_speed: float = REST_SPEED,
    loops: bool = True,
) -> SolverComparison:
    """The answers of all solvers to one problem, and their differences in a and in the unique part of the forces.

    The solvers are `KKT`, `ProxQP`, `ConeSolver` under both laws, and, where friction cones occur, `ConeSolver` on ProxQP's
    pyramids, so that each law with pyramids has two solvers. The unique part of the forces is their part in the
    range of J: J^T f decides it.

    Args:
        state: The robot at (q, v).
        tau: Motor torques, shape (nu,); None: zero.
        constraints: Contacts and other constraints.
        external: Other forces of the world, as in `rbd.solve`.
        rest_speed: Up to which speed a contact is at rest [m/s, rad/s], as in `rbd.solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        A table; print it. Solvers that refuse are listed with their reason.

    Raises:
        NoSolution: if no solver has an answer.
        InputError: as `rbd.solve`.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> found = rbd.studies.compare_solvers(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face])
        >>> found.worst < 1e-9, list(found.refused)
        (True, ['KKT'])
    """
    problem = assembled(state, tau, constraints, external, rest_speed, loops)
    asked: list[tuple[str, Solver, GaussProblem]] = [
        ("KKT", KKT(), problem),
        ("ProxQP", ProxQP(), problem),
        ("ConeSolver, convex", ConeSolver(law="convex"), problem),
        ("ConeSolver, coulomb", ConeSolver(law="coulomb"), problem),
    ]
    if problem.force_set.facets and ProxQP().reason_unsupported(problem) is None:
        asked.insert(2, ("ConeSolver on pyramids", ConeSolver(law="convex"), _pyramidal(problem, problem.force_set.pyramids)))
    answers, refused = [], {}
    unique = _projector(problem)
    for name, solver, posed in asked:
        reason = solver.reason_unsupported(posed)
        if reason is not None:
            refused[name] = reason
            continue
        answers.append(_answer(name, solution_of(posed, solver), problem, unique))
    if not any(x.status is Status.SOLVED for x in answers):
        tried = "; ".join(
            [f"{x.solver}: {x.status}, worst residual {x.worst:.1e}" for x in answers]
            + [f"{name} does not take it: {why}" for name, why in refused.items()]
        )
        raise NoSolution(f"no solver has an answer ({tried}). rbd.solve says why.", problem=problem)
    return SolverComparison(tuple(answers), refused, tuple(_differences(answers)))


def _differences(answers: Sequence[SolverAnswer]) -> list[tuple[str, str, float, float]]:
    solved = [x for x in answers if x.status is Status.SOLVED]
    return [
        (one.solver, other.solver, _relative(one.a, other.a), _relative(one.unique_forces, other.unique_forces))
        for i, one in enumerate(solved)
        for other in solved[i + 1 :]
    ]


def _relative(x: Array, y: Array) -> float:
    return max_abs(x - y) / max(1.0, max_abs(x), max_abs(y))


def _projector(problem: GaussProblem) -> Array:
    """Onto the range of J, shape (m, m): the forces that J^T does not send to zero."""
    U = range_of(problem.J)
    return U @ U.T


def _pyramidal(problem: GaussProblem, pyramids: ForceSet) -> GaussProblem:
    """The same problem with a row for each ray of a pyramid: weights on rays are nonnegative numbers.

    Rays of separating points are left out, as their forces are zero.
    """
    rows = []
    for i, r in enumerate(problem.rows):
        G = _bent(problem, i, pyramids)
        if G is not None:
            bent = None if r.resultant is None else r.resultant @ G
            r = Rows(r.name, G.T @ r.J, G.T @ r.bias, NonNegative(G.shape[1]), feedback=G.T @ r.feedback, resultant=bent)
        rows.append(r)
    return replace(problem, rows=rows, balance=None)


def _bent(problem: GaussProblem, i: int, T: ForceSet) -> Array | None:
    """The rays of a unilateral constraint, as columns; None if it has sets other than pyramids and half-lines."""
    r = problem.rows[i]
    own = at_rest(r.cone).pyramids
    if not own.facets or own.has_lines or own.has_intervals:
        return None
    at = T.slices[i]
    return T.G[problem.slices[r.name], at][:, T.upper[at] > 0.0]


def _answer(name: str, solution: Solution, problem: GaussProblem, unique: Array) -> SolverAnswer:
    f, law = solution.multipliers, solution.law
    if solution.problem is not problem:
        f, law = _row_forces(solution, problem, problem.force_set.pyramids), pyramidal_law(problem)
    return SolverAnswer(name, law, solution.status, solution.residuals.worst, solution.seconds, solution.a, unique @ f)


def _row_forces(solution: Solution, problem: GaussProblem, pyramids: ForceSet) -> Array:
    """Row forces of a problem, shape (m,), from the answer to `_pyramidal` of it."""
    f, parts = solution.multipliers, solution.problem.slices.values()
    bent = [(part, _bent(problem, i, pyramids)) for i, part in enumerate(parts)]
    return np.concatenate([f[part] if G is None else G @ f[part] for part, G in bent] or [f])


@dataclass(frozen=True)
class Confirmation:
    """An answer beside that of Gauss's least-constraint QP in ProxSuite, by `confirmed_by_qp`.

    Attributes:
        law: Of the answer.
        a: Largest difference of the accelerations [m/s2, rad/s2].
        f: Largest difference of the row forces in their unique part [N, N m].
        same: Whether both are below `SAME`, over max(1, the largest entry).
    """

    law: Law
    a: float
    f: float
    same: bool


def obeys_gauss(solution: Solution) -> bool:
    """Whether an answer is also that of Gauss's principle with circular cones: of Coulomb's law, whether no point slips."""
    w = solution.weights
    return w is None or solution.residuals.under(CONVEX, w).within(SOLVED)


def confirmed_by_qp(solution: Solution) -> Confirmation:
    """The differences between an answer that obeys Gauss's principle and that of the least-constraint QP, by ProxSuite.

    The QP has pyramids around the friction cones, each turned until a facet touches its cone where friction opposes the
    acceleration of its point. What obeys Gauss's principle with these cones obeys it with these pyramids, so that the QP's
    acceleration, which is unique, is the answer's.

    Args:
        solution: An answer at rest, see `obeys_gauss`; where a point slips, one of the convex law.

    Raises:
        NoSolution: ProxSuite has no answer.
        ContactMoves, Unsupported: a contact slides or approaches.
    """
    problem = solution.problem
    if solution.weights is None:
        found = answered(problem, ProxQP())
        f = found.multipliers
    else:
        T = problem.force_set
        pyramids = T.with_pyramids(facing=-T.accelerations(problem.J @ solution.a + problem.offset))
        found = answered(_pyramidal(problem, pyramids), ProxQP())
        f = _row_forces(found, problem, pyramids)
    unique = _projector(problem)
    mine, theirs = unique @ solution.multipliers, unique @ f
    worst = max(_relative(solution.a, found.a), _relative(mine, theirs))
    return Confirmation(solution.law, max_abs(solution.a - found.a), max_abs(mine - theirs), worst <= SAME)


@dataclass(frozen=True)
class ContactUnderLaw:
    """Force and motion of one contact under one law, summed over its points.

    At rest no power flows yet; these are the rates at which it starts to flow [N m/s2 = W/s].

    Attributes:
        normal: Normal force [N].
        slip: Largest tangential acceleration of its points [m/s2].
        lift_off: Largest normal acceleration of its loaded points [m/s2]: zero under Coulomb's law.
        dissipation: What friction takes, -sum f_t . y_t [W/s].
        lifted: What the normal forces return by lifting, sum f_n y_n [W/s]: under the convex law all that friction takes.
    """

    normal: float
    slip: float
    lift_off: float
    dissipation: float
    lifted: float


@dataclass(frozen=True, eq=False, repr=False)
class LawComparison(Displayed):
    """The answers of the convex and of Coulomb's law at one state, both with circular cones, and how they differ.

    Attributes:
        convex: The answer of the associated (convex) law.
        coulomb: The answer of Coulomb's law; if it is one of several motions, the others are in `coulomb.others`.
        under_convex: {contact: what it does under the convex law}.
        under_coulomb: {contact: what it does under Coulomb's law}.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> push = [rbd.ExternalForce("box", (80.0, 0.0, 0.0))]
        >>> both = rbd.studies.compare_laws(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face], external=push)
        >>> print(both.agree, f"{both.normal_ratio['face']:.4f}")
        False 1.0951
    """

    convex: Solution
    coulomb: Solution
    under_convex: dict[str, ContactUnderLaw]
    under_coulomb: dict[str, ContactUnderLaw]

    fields: ClassVar[tuple[Field, ...]] = (
        Field(
            "worst_residual", (), "1", "largest scaled residual of both answers",
            lambda both: np.fmax(both.convex.residuals.worst, both.coulomb.residuals.worst), certificate=True,
        ),
        Field("difference", (), "1", "difference of the accelerations, relative"),
        Field("agree", (), "", "whether both laws give one motion, to 1e-7, and no other"),
        Field(
            "normal_ratio", (), "1", "normal force of each contact, convex over Coulomb's law",
            None, "normal_ratio_{}", "normal force of {}, convex over Coulomb's law",
        ),
        Field(
            "lift_off", (), "m/s2", "normal acceleration of each loaded contact under the convex law",
            lambda both: {name: contact.lift_off for name, contact in both.under_convex.items()},
            "lift_off_{}", "normal acceleration of {} under the convex law", default=False,
        ),
        Field(
            "motions", (), "1", "number of motions under Coulomb's law",
            lambda both: 1 + len(both.coulomb.others), default=False,
        ),
    )  # fmt: skip

    @property
    def no_answer(self) -> tuple[Reason, str] | None:
        """Why one of the two is no answer, and a message; None where both are."""
        return self.convex.no_answer or self.coulomb.no_answer

    @property
    def difference(self) -> float:
        """Largest difference of the accelerations, over max(1, the largest entry)."""
        return _relative(self.convex.a, self.coulomb.a)

    @property
    def agree(self) -> bool:
        """Whether the robot has the same motion under both, to `SAME`, and no other motion of Coulomb's law was found."""
        return self.difference <= SAME and not self.coulomb.others

    @property
    def normal_ratio(self) -> dict[str, float]:
        """{contact: normal force of the convex law over Coulomb's}; NaN where Coulomb's is zero."""
        pairs = ((name, self.under_convex[name].normal, c.normal) for name, c in self.under_coulomb.items())
        return {name: convex / normal if normal > CARRIES_NOTHING_N else float("nan") for name, convex, normal in pairs}

    def __str__(self) -> str:
        parts = f"they differ: accelerations by {self.difference:.2g}, relative"
        verdict = "the same motion" if self.difference <= SAME else parts
        if self.coulomb.others:
            verdict += f"; Coulomb's law has {1 + len(self.coulomb.others)} motions"
        heads = ("normal", "ratio", "slip", "lift-off", "dissipation", "returned")
        units = ("[N]", "", "[m/s2]", "[m/s2]", "[W/s]", "[W/s]")
        lines = [f"convex against Coulomb's law, circular cones: {verdict}"]
        lines.append(f"  {'contact':<16}{'law':<9}" + "".join(f"{x:>13}" for x in heads))
        lines.append(" " * 27 + "".join(f"{x:>13}" for x in units))
        for name, ratio in self.normal_ratio.items():
            for law, found in (("convex", self.under_convex[name]), ("coulomb", self.under_coulomb[name])):
                shown = "-" if law == "coulomb" or ratio != ratio else f"{ratio:.4f}"
                rest = (found.slip, found.lift_off, found.dissipation, found.lifted)
                # + 0.0 turns the -0.000 of rounding into 0.000
                numbers = "".join(f"{round(x, 3) + 0.0:>13.3f}" for x in rest)
                lines.append(f"  {name if law == 'convex' else '':<16}{law:<9}{found.normal:>13.3f}{shown:>13}{numbers}")
        return "\n".join(lines)


def compare_laws(
    state: State,
    tau: Array | None,
    constraints: Sequence[Constraint],
    *,
    external: External = None,
    rest_speed: float = REST_SPEED,
    loops: bool = True,
) -> LawComparison:
    """Convex and Coulomb's law compared, both with circular cones: the effect of the convex relaxation.

    Where a loaded point starts to slip, the convex law lets it lift at mu times its tangential acceleration, gives it another
    normal force, and puts back by lifting what friction takes. The two differ too where a point without load breaks with
    `y_n < mu |y_t|`, and where Coulomb's law has several motions: then a `NonUniqueMotionWarning` warns of it, and
    `coulomb.others` has the others. Elsewhere they agree.

    Args:
        state: The robot, its contacts at rest.
        tau: Motor torques, shape (nu,); None: zero.
        constraints: Contacts and other constraints.
        external: Other forces of the world, as in `rbd.solve`.
        rest_speed: Up to which speed a contact is at rest [m/s, rad/s], as in `rbd.solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        Both answers with their certificates, and the behaviour of each contact under each; printable.

    Raises:
        NoSolution, ContactMoves, InputError: as `rbd.solve`; a contact that already slides has no convex law.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> for force in (30.0, 80.0):  # less and more than the friction of 58.86 N
        ...     push = [rbd.ExternalForce("box", (force, 0.0, 0.0))]
        ...     both = rbd.studies.compare_laws(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face], external=push)
        ...     print(both.agree, both.coulomb.a[[0, 2]].round(3), both.convex.a[[0, 2]].round(3))
        True [ 0. 0.] [0. 0.]
        False [2.114 0.   ] [1.554 0.933]
    """
    problem = assembled(state, tau, constraints, external, rest_speed, loops)
    convex, coulomb = (answered(problem, solver_of(law, None)) for law in ("convex", "coulomb"))
    return LawComparison(convex, coulomb, _under(convex), _under(coulomb))


def _under(solution: Solution) -> dict[str, ContactUnderLaw]:
    P = solution.problem
    T = P.force_set
    y = T.accelerations(P.J @ solution.a + P.offset)
    out = {}
    for i, rows in enumerate(P.rows):
        if rows.patch is None:
            continue
        f = at_corners(rows.patch, solution.corner_forces[rows.name])
        motion = (
            np.zeros_like(f) if at_rest(rows.cone).bilateral else T.point_accelerations(y, i)
        )  # bilateral constraints do not move
        loaded = f[:, 2] > CARRIES_NOTHING_N
        out[rows.name] = ContactUnderLaw(
            normal=float(f[:, 2].sum()),
            slip=float(np.hypot(motion[:, 0], motion[:, 1]).max(initial=0.0)),
            lift_off=float(motion[loaded, 2].max(initial=0.0)),
            dissipation=-float((f[:, :2] * motion[:, :2]).sum()),
            lifted=float((f[:, 2] * motion[:, 2]).sum()),
        )
    return out
