"""A solver against the equations of its law, implemented again, and against closed forms; errors of broken contracts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from rbd.answers.solution import Solution
from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError, Reason
from rbd.problem.answer import Answer, Status, at_corners
from rbd.problem.cones import Bounds, Cone, Free, FrictionCone, NonNegative, Product
from rbd.problem.corner_cones import LineCone, UnevenCone, WrenchCone
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.solvers import Solver
from rbd.testing.reference import ReferenceProblem, reference_problems


class ContractBroken(RbdError):
    """A constraint or a solver violates its contract.

    Example:
        >>> wrong = rbd.FunctionConstraint("height", lambda q: q[2] - 1.0, jacobian=lambda q: -np.eye(6)[2])  # its sign
        >>> try:
        ...     rbd.testing.check_constraint(wrong, rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1]))
        ... except rbd.testing.ContractBroken as error:
        ...     print(type(error).__name__)
        ConstraintWrong
    """

    reason = Reason.CONTRACT_BROKEN


class ConstraintWrong(ContractBroken):
    """Rows that do not describe the motion they claim.

    Example:
        >>> wrong = rbd.FunctionConstraint("height", lambda q: q[2] - 1.0, jacobian=lambda q: -np.eye(6)[2])  # its sign
        >>> rbd.testing.check_constraint(wrong, rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1]))
        Traceback (most recent call last):
            ...
        rbd.testing.solver_check.ConstraintWrong: 'height': J v of row 0 is ..., and motion of the error says ...
    """

    reason = Reason.CONSTRAINT_WRONG


class TaskWrong(ContractBroken):
    """Rows of a task that are not the acceleration of the value that they claim.

    Example:
        >>> class Rise:
        ...     name = "rise"
        ...     def terms(self, state, t):
        ...         trunk = state.frame("base_link")
        ...         return rbd.control.TaskTerms("rise", trunk.J[2:3], [0.5], [1.0])  # J_dot v is left out
        >>> moving = rbd.load_robot("solo12").standing().with_joints({"root_joint": [0, 0, 1, 0.1, 0.7, 0.1, 0.7]})
        >>> rbd.testing.check_task(Rise(), lambda state: state.frame("base_link").X_WF.translation[2:], moving)
        Traceback (most recent call last):
            ...
        rbd.testing.solver_check.TaskWrong: 'rise': A a + J_dot v of row 0 is ..., and motion of the value says ...
    """

    reason = Reason.TASK_WRONG


@dataclass(frozen=True)
class SolverReport(Displayed):
    """What `check_solver` found: the problems that a solver passed, with its residuals, and those that it skipped.

    Attributes:
        ran: {problem: largest residual, scaled as `Solution.residuals`}.
        skipped: {problem: why the solver does not take it}.
        failed: {problem: message}.

    Example:
        >>> report = rbd.testing.check_solver(rbd.KKT())
        >>> max(report.ran.values()) < 1e-9, report.failed
        (True, {})
        >>> print(report.skipped["box at rest on four corners"])
        KKT takes bilateral constraints, and 'corner0' has forces in a FrictionCone. ...
    """

    ran: dict[str, float]
    skipped: dict[str, str]
    failed: dict[str, str]


class SolverWrong(ContractBroken):
    """Answers that violate the law or differ from the closed form.

    Attributes:
        report: What ran, what was skipped, what failed.

    Example:
        >>> class Idle(rbd.KKT):
        ...     def solve(self, problem):
        ...         a, f = np.zeros(problem.nv), np.zeros(problem.m)
        ...         return rbd.problem.Answer(problem, a, f, None, "bilateral", "Idle", 0, 0.0)
        >>> try:
        ...     rbd.testing.check_solver(Idle())
        ... except rbd.testing.SolverWrong as error:
        ...     print(error.report.failed["box in free fall"])
        stationarity 1.00e+00 > 1e-09; a is [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], not [0.0, 0.0, -9.81, 0.0, 0.0, 0.0]
    """

    reason = Reason.SOLVER_WRONG

    def __init__(self, message: str, report: SolverReport) -> None:
        super().__init__(message)
        self.report = report

    def __reduce__(self) -> tuple[type[SolverWrong], tuple[str, SolverReport], dict[str, object]]:
        return type(self), (str(self), self.report), self.__dict__


def check_solver(
    solver: Solver,
    *,
    problems: Sequence[ReferenceProblem] | None = None,
    tolerance: float = 1e-9,
    accuracy: float = 1e-7,
) -> SolverReport:
    """Results of a solver on all reference problems, passed and skipped; raises if an answer is wrong.

    Each answer must satisfy the equations of motion, the constraints and the force sets of the law that it names,
    recomputed here, must agree with the closed form, and must know that it is solved. A floor must push up with the
    weight.

    Args:
        solver: The solver to check.
        problems: By default `reference_problems()`.
        tolerance: Largest scaled residual.
        accuracy: Largest deviation of a and of the forces from the closed form, over max(1, largest entry).

    Raises:
        SolverWrong: if any fails, or none ran; the message has a line for each, with numbers.

    Example:
        >>> report = rbd.testing.check_solver(rbd.KKT())
        >>> "ball rolling down an incline, held" in report.ran, max(report.ran.values()) < 1e-9
        (True, True)
    """
    report = SolverReport({}, {}, {})
    for reference in reference_problems() if problems is None else problems:
        reason = solver.reason_unsupported(reference.problem)
        if reason is not None:
            report.skipped[reference.name] = reason
            continue
        answer = solver.solve(reference.problem)
        found = law_residuals(reference.problem, answer, solver.law)
        report.ran[reference.name] = max(found.values())
        wrong = [f"{what} {value:.2e} > {tolerance:g}" for what, value in found.items() if not value <= tolerance]
        wrong += _against_closed_form(reference, answer, Law.of(solver.law).kind, accuracy)
        if not wrong and answer.status is not Status.SOLVED:
            wrong = [f"its status is {answer.status}, though its residuals are small"]
        if wrong:
            report.failed[reference.name] = "; ".join(wrong)
    if report.failed or not report.ran:
        name = type(solver).__name__
        lines = [f"  {what}: {why}" for what, why in report.failed.items()] or ["  it takes none of the problems"]
        raise SolverWrong(f"{name} fails {len(report.failed)} of {len(report.ran)} problems:\n" + "\n".join(lines), report)
    return report


def _against_closed_form(reference: ReferenceProblem, answer: Answer, law: str, accuracy: float) -> list[str]:
    pairs = []
    a = reference.a.get(law, reference.a.get("any"))
    if a is not None:
        pairs.append(("a", answer.a, a))
    pairs += [(f"force of {name!r}", answer.forces[name], f) for name, f in reference.forces.items()]
    if reference.net_force is not None:
        total = np.sum([f[:3] for f in answer.forces.values()], axis=0)
        pairs.append(("sum of the forces", total, reference.net_force))
    wrong = []
    for what, given, expected in pairs:
        gap = float(np.abs(given - expected).max(initial=0.0)) / max(1.0, float(np.abs(expected).max(initial=0.0)))
        if not gap <= accuracy:
            wrong.append(f"{what} is {np.round(given, 6).tolist()}, not {np.round(expected, 6).tolist()}")
    return wrong


def law_residuals(problem: GaussProblem, answer: Answer, law: Law | str) -> dict[str, float]:
    """Scaled residuals of an answer's law, computed without `rbd.problem.residuals` and without the answer's weights.

    Args:
        problem: The problem.
        answer: The answer; its law gives the pyramids that replace cones.
        law: The solver's law.

    Returns:
        stationarity, feasibility, cone and complementarity, each row and each point over its terms as in
        `rbd.problem.residuals`; NaN becomes inf.

    Example:
        >>> wall = rbd.Rows("wall", J=np.array([[-1.0, 0.0]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
        >>> problem = rbd.GaussProblem(M=np.diag([2.0, 1.0]), rhs=np.array([6.0, 1.0]), rows=[wall])
        >>> residuals = rbd.testing.law_residuals(problem, rbd.ProxQP().solve(problem), "convex")
        >>> sorted(residuals), max(residuals.values()) < 1e-9
        (['complementarity', 'cone', 'feasibility', 'stationarity'], True)
    """
    a, f, M = answer.a, answer.multipliers, problem.M
    worst = {"stationarity": 0.0, "feasibility": 0.0, "cone": 0.0, "complementarity": 0.0}
    as_given = Solution.of(replace(answer, redundant=False))
    at, left, force_scale = 0, M @ a - problem.rhs, np.abs(M) @ np.abs(a)
    carried = np.zeros(len(a))
    for rows in problem.rows:
        part, offset = f[at : at + len(rows)], rows.bias + rows.feedback
        at += len(rows)
        left, carried = left - rows.J.T @ part, carried + np.abs(rows.J).T @ np.abs(part)
        if not len(rows):
            continue
        corners = None
        if not answer.law.facets and isinstance(rows.cone, WrenchCone | LineCone | UnevenCone):
            if rows.patch is None:
                raise InputError(f"rows {rows.name!r}: true cones at a patch's corners want its patch.")
            corners = at_corners(rows.patch, as_given.corner_forces[rows.name])  # of circular cones as the solver has them
        cone = _against_motion(rows.cone, rows.velocity, problem.rest_speed)
        terms = np.maximum(np.abs(rows.J) @ np.abs(a) + np.abs(rows.bias) + np.abs(rows.feedback), 1.0)
        mobility = np.einsum("ij,ji->i", rows.J, np.linalg.solve(M, rows.J.T))
        sizes = terms, np.array([1.0 if x <= 1.0 else 1.0 / x for x in mobility])
        gaps = _gaps(cone, rows.J @ a + offset, part, "pyramids" if answer.law.facets else Law.of(law).kind, corners, sizes)
        for what, value in zip(("feasibility", "cone", "complementarity"), gaps, strict=True):
            worst[what] = max(worst[what], value)
    least = np.minimum(np.diag(M), 1.0)
    worst["stationarity"] = float((np.abs(left) / np.max([force_scale, np.abs(problem.rhs), carried, least], axis=0)).max())
    return {what: value if np.isfinite(value) else np.inf for what, value in worst.items()}


def _against_motion(cone: Cone, velocity: Array, rest: float) -> Cone:
    """The set, with moving components of its boxes fixed at the bound that opposes their motion."""
    if isinstance(cone, Product):
        ends = np.cumsum([part.dim for part in cone.cones])[:-1]
        return Product([_against_motion(part, u, rest) for part, u in zip(cone.cones, np.split(velocity, ends), strict=True)])
    if not isinstance(cone, Bounds) or not (np.abs(velocity) > rest).any():
        return cone
    lo = np.where((velocity < -rest) & np.isfinite(cone.hi), cone.hi, cone.lo)
    return Bounds(lo, np.where((velocity > rest) & np.isfinite(cone.lo), cone.lo, cone.hi))


def _gaps(
    cone: Cone, c: Array, f: Array, law: str, corners: Array | None, sizes: tuple[Array, Array]
) -> tuple[float, float, float]:
    """Residuals of c (admissible set), of f (cone) and of their complementarity, each over its terms.

    `sizes`: the terms of the rows' accelerations, and the least forces of the rows that count.
    """
    terms, least = sizes
    if isinstance(cone, Product):
        ends = np.cumsum([part.dim for part in cone.cones])[:-1]
        pieces = zip(cone.cones, *(np.split(x, ends) for x in (c, f, terms, least)), strict=True)
        each = [_gaps(part, c_i, f_i, law, corners, (t_i, l_i)) for part, c_i, f_i, t_i, l_i in pieces]
        return max(x[0] for x in each), max(x[1] for x in each), max(x[2] for x in each)
    if isinstance(cone, Free):
        return float((np.abs(c) / terms).max()), 0.0, 0.0
    push = np.maximum(np.abs(f), least)
    if isinstance(cone, NonNegative):
        works = float((np.abs(f * c) / (push * terms)).max())
        return float((np.maximum(-c, 0.0) / terms).max()), float((np.maximum(-f, 0.0) / push).max()), works
    if isinstance(cone, Bounds):
        opens, closes, low, high = np.maximum(c, 0.0), np.maximum(-c, 0.0), np.isfinite(cone.lo), np.isfinite(cone.hi)
        gap = np.where(low, 0.0, opens) + np.where(high, 0.0, closes)  # unbounded force: no acceleration
        slack = opens * np.abs(f - np.where(low, cone.lo, f)) + closes * np.abs(np.where(high, cone.hi, f) - f)
        beyond = np.maximum(np.maximum(cone.lo - f, f - cone.hi), 0.0)
        reach = push + np.where(low, np.abs(cone.lo), 0.0) + np.where(high, np.abs(cone.hi), 0.0)
        found = gap / terms, beyond / reach, slack / (reach * terms)
        return float(found[0].max(initial=0.0)), float(found[1].max(initial=0.0)), float(found[2].max(initial=0.0))
    if not isinstance(cone, FrictionCone | WrenchCone | LineCone | UnevenCone) or isinstance(cone.mu, Cone):
        raise InputError(f"check_solver knows no {type(cone).__name__}; give it problems with the sets of rbd.problem.cones.")
    E, mu = _corner_map(cone), cone.mu
    C, own = (E.T @ c).reshape(-1, 3), (np.abs(E).T @ terms).reshape(-1, 3)
    sinks = float((np.maximum(-C[:, 2], 0.0) / own[:, 2]).max())
    if law == "pyramids":
        G = corner_rays(cone)
        assert G is not None
        along = np.abs(G).T @ terms
        misses = float((np.maximum(-(G.T @ c), 0.0) / along).max())
        return max(sinks, misses), float(nnls(G, f)[1] / push.max()), abs(float(f @ c)) / float(push.max() * along.max())
    corners = f[None] if corners is None else corners
    load = np.maximum(np.abs(corners).max(axis=1), least.min())
    slip, rub, across = np.linalg.norm(C[:, :2], axis=1), np.linalg.norm(corners[:, :2], axis=1), own[:, :2].max(axis=1)
    outside = np.maximum(np.maximum(rub - mu * corners[:, 2], -corners[:, 2]), 0.0) / load
    split = np.abs(E @ corners.ravel() - f) / np.maximum(np.abs(E) @ np.abs(corners.ravel()), least)
    power = (C[:, :2] * corners[:, :2]).sum(axis=1)
    if law == "coulomb":
        presses = np.abs(C[:, 2] * corners[:, 2]) / (load * own[:, 2])
        rubs = np.abs(power + mu * corners[:, 2] * slip) / (load * max(1.0, mu) * across)
        return sinks, float(max(split.max(), outside.max())), float(max(presses.max(), rubs.max()))
    opening = float((np.maximum(mu * slip - C[:, 2], 0.0) / (mu * across + own[:, 2])).max())
    slacks = np.abs(power + C[:, 2] * corners[:, 2]) / (load * (max(1.0, mu) * across + own[:, 2]))
    return max(sinks, opening), float(max(split.max(), outside.max())), float(slacks.max())


def _corner_map(cone: FrictionCone | WrenchCone | LineCone | UnevenCone) -> Array:
    """Row forces of stacked corner forces: identity for a point, p and c x p for a patch; for a line no moment about it."""
    if isinstance(cone, FrictionCone):
        return np.eye(3)
    if isinstance(cone, UnevenCone):
        pairs = zip(cone.corners, cone.axes, strict=True)
        columns = [[*R[:, j], *np.cross(c, R[:, j])] for c, R in pairs for j in range(3)]
        return np.array(columns).T[{6: [0, 1, 2, 3, 4, 5], 5: [0, 1, 2, 4, 5], 3: [0, 1, 2]}[cone.dim]]
    G = np.hstack([np.vstack([np.eye(3), np.cross(c, np.eye(3)).T]) for c in cone.corners])
    return G[[0, 1, 2, 4, 5]] if isinstance(cone, LineCone) else G


def corner_rays(cone: Cone) -> Array | None:
    """Rays of the corner pyramids as columns, from their facets: a ray is where two neighbouring facets meet."""
    if isinstance(cone, NonNegative):
        return np.eye(cone.dim) if cone.dim == 1 else None
    if not isinstance(cone, FrictionCone | WrenchCone | LineCone | UnevenCone):
        return None
    angle = 2.0 * np.pi * np.arange(cone.facets) / cone.facets
    inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(cone.facets, cone.mu)])
    rays = np.cross(inward, np.roll(inward, -1, axis=0))
    rays = (rays / rays[:, 2:]).T
    G = _corner_map(cone)
    return np.hstack([G[:, i : i + 3] @ rays for i in range(0, G.shape[1], 3)])
