"""What a new constraint and a new solver must pass: `check_constraint`, `check_solver` and the reference problems.

Nothing here trusts what it checks. A Jacobian is compared with the motion of the contact point itself, J_dot v with
its second difference, a solver's answer with the equations of its law, written down here once more, and with closed
forms.

    ContractBroken (an RbdError)
      ConstraintWrong     rows that do not describe the motion they claim
      SolverWrong         an answer that misses its law or the closed form
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

from rbd.arrays import Array
from rbd.cones import Box, Cone, Free, FrictionCone, LineCone, NonNegative, Product, WrenchCone
from rbd.errors import InputError, RbdError
from rbd.least_constraint import Constraint
from rbd.parts import REST_SPEED
from rbd.problem import GaussProblem
from rbd.reference_problems import ReferenceProblem, box, reference_problems
from rbd.rows import Patch, Rows
from rbd.solution import Solution, Status
from rbd.solvers import Solver
from rbd.state import State

__all__ = [
    "ConstraintReport",
    "ConstraintWrong",
    "ContractBroken",
    "ReferenceProblem",
    "SolverReport",
    "SolverWrong",
    "box",
    "check_constraint",
    "check_solver",
    "law_residuals",
    "reference_problems",
]

STEP = 5e-3
"""Time step of the differences [s]: with speeds of order one, rounding and truncation both stay below 1e-9."""

_NODES = STEP * np.arange(-3, 4)
_FIRST = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * STEP)  # sixth order
_SECOND = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / (180.0 * STEP**2)  # sixth order


class ContractBroken(RbdError):
    """A constraint or a solver does not do what it says."""


class ConstraintWrong(ContractBroken):
    """Rows that do not describe the motion they claim."""


class SolverWrong(ContractBroken):
    """Answers that miss the law or the closed form.

    Attributes:
        report: What ran, what was skipped, what failed.
    """

    def __init__(self, message: str, report: SolverReport) -> None:
        super().__init__(message)
        self.report = report


@dataclass(frozen=True)
class ConstraintReport:
    """What `check_constraint` compared, and the largest deviations found, scaled as the tolerance is.

    Attributes:
        name: The constraint's name.
        rows: Number of rows.
        against: What J and J_dot v were compared with: "motion of the patch", "motion of the error", or "its own J",
            where the rows give neither patch nor error: then only J_dot v was checked, and a wrong J passes.
        jacobian: Deviation of J v from the motion; None where there was nothing to compare J with.
        velocity: Deviation of the rows' `velocity` from J v.
        jdot_v: Deviation of J a + J_dot v from the motion.
    """

    name: str
    rows: int
    against: str
    jacobian: float | None
    velocity: float
    jdot_v: float


def check_constraint(
    constraint: Constraint, state: State, *, seed: int = 0, draws: int = 5, tolerance: float = 1e-7, moving: bool = True
) -> ConstraintReport:
    """How far a constraint's J, velocity and J_dot v are from motion along curves of the robot; raises if far.

    Along q(t) = q (+) (v t + a t^2 / 2) the velocity is v + a t up to t^2, on a floating base too (there v and a are in
    the base's axes). The contact's point and axes are differenced in t, to sixth order, without any Jacobian. Rows that
    have `patch` and `resultant` must give

        J v            = resultant^T (p', w)
        J a + J_dot v  = resultant^T (p'', w')      with the patch's axes held still, as `bias` has it,

    p the patch's point and w the angular velocity of its axes (which turn with the body where the resultant is a
    wrench; where that has no moment about x, of the x axis alone); of a contact against another body, as seen from that
    body's frame. Rays of the force cone must push along the patch's normal. Rows with an `error` and no patch must give
    J v = error' and J a + J_dot v = error''. A patch with an error must give them too where its error is zero, the second
    where J v = 0. Rows with neither have only their J_dot v checked, against the change of their own J; the report says so.

    Of a contact with a surface whose motion is given, what its rows give at v = 0 is the surface's own, and is taken out of
    them first, together with what changes its sign with v: the Coriolis term of a surface that turns, which is not checked.

    Args:
        constraint: What is checked.
        state: Where; a generic posture sees more than a symmetric one.
        seed: Of the drawn velocities and accelerations.
        draws: How many.
        tolerance: Largest deviation, over max(1, largest term).
        moving: False draws velocities with J v = 0 only: for rows in axes that turn, whose J_dot v is right only
            while the constraint is met.

    Raises:
        ConstraintWrong: with the row and the numbers.
        InputError: if the constraint has no rows at this state: there is nothing to check.
    """
    rng, nv = np.random.default_rng(seed), state.robot.nv
    rows = constraint.rows(state.with_velocity(np.zeros(nv)))
    if rows.name != constraint.name:
        raise ConstraintWrong(f"constraint {constraint.name!r} gave rows named {rows.name!r}; forces go by the rows' name.")
    if not len(rows):
        raise InputError(f"constraint {constraint.name!r} has no rows at this state; choose one where it acts.")
    _check_normal(rows)
    worst = {"J v": 0.0, "velocity": 0.0, "J a + J_dot v": 0.0}
    for _ in range(draws):
        v, a = rng.normal(size=nv), rng.normal(size=nv)
        if not moving:
            v -= np.linalg.pinv(rows.J) @ (rows.J @ v)
        at, bias = constraint.rows(state.with_velocity(v)), np.zeros(len(rows))
        if rows.velocity.any() or rows.bias.any():  # a surface moves by itself: J_dot v is what is quadratic in v
            bias = 0.5 * (constraint.rows(state.with_velocity(-v)).bias - at.bias) - rows.bias
        first, second, against, errors = _motion(constraint, state, rows, v, a)
        deviations = {"J v": (rows.J @ v, first), "J a + J_dot v": (rows.J @ a + (at.bias + bias), second)}
        if at.velocity.any() or rows.velocity.any():  # else the rows do not give it
            deviations["velocity"] = (at.velocity - rows.velocity, rows.J @ v)
        if errors is not None:
            deviations["error' against J v:"] = (_FIRST @ errors, rows.J @ v)
            if not moving:
                deviations["error'' against J a + J_dot v:"] = (_SECOND @ errors, rows.J @ a + (at.bias + bias))
        for what, (given, found) in deviations.items():
            gap = np.abs(given - found) / max(1.0, float(np.abs(found).max()), float(np.abs(given).max()))
            worst[what] = max(worst.get(what, 0.0), float(gap.max()))
            if not gap.max() <= tolerance:
                i = int(np.argmax(gap))
                raise ConstraintWrong(
                    f"{constraint.name!r}: {what} of row {i} is {given[i]:.9g}, and {against} says {found[i]:.9g} "
                    f"(tolerance {tolerance:g}). Look for a wrong sign, frame or axis, or a term left out."
                )
    jacobian = None if against == "its own J" else worst["J v"]
    return ConstraintReport(constraint.name, len(rows), against, jacobian, worst["velocity"], worst["J a + J_dot v"])


def _motion(constraint: Constraint, state: State, rows: Rows, v: Array, a: Array) -> tuple[Array, Array, str, Array | None]:
    """(J v, J a + J_dot v, whence, the errors of a patch that is at its anchor) as the motion along the curve has them."""
    model, q = state.robot.model, state.q
    states = [State(state.robot, pin.integrate(model, q, v * t + 0.5 * a * t * t)) for t in _NODES]
    along = [constraint.rows(s) for s in states]
    if rows.patch is not None and rows.resultant is not None:
        about = rows.resultant[3:]
        of_line = len(about) == 3 and not np.abs(rows.patch.axes[:, 0] @ about).max(initial=0.0) > 1e-12  # no moment about x
        y, anchored = _patch_motion(states, along, state, rows.patch, of_line), None
        if rows.error is not None and np.abs(rows.error).max(initial=0.0) < 1e-9:
            anchored = np.array([r.error for r in along])
        y = y[:, : len(rows.resultant)]
        return rows.resultant.T @ (_FIRST @ y), rows.resultant.T @ (_SECOND @ y), "motion of the patch", anchored
    if rows.error is not None:
        errors = np.array([r.error for r in along])
        return _FIRST @ errors, _SECOND @ errors, "motion of the error", None
    own = np.array([r.J @ (v + a * t) for r, t in zip(along, _NODES, strict=True)])
    return rows.J @ v, _FIRST @ own, "its own J", None


def _patch_motion(states: list[State], along: list[Rows], state: State, patch: Patch, of_line: bool) -> Array:
    """Way and rotation vector of a patch from where it is at `state`, shape (nodes, 6), in world axes.

    Against another body: as seen from its frame, whose axes stand as they do at `state`. Of a line, the turn of its
    direction x alone, x at `state` cross x.
    """
    y = np.zeros((len(along), 6))
    X_WB0 = _body(state, patch)
    for i, (moved, r) in enumerate(zip(states, along, strict=True)):
        assert r.patch is not None
        back = X_WB0 * _body(moved, patch).inverse()  # moves the other body to where it was
        y[i, :3] = back.act(r.patch.point) - patch.point
        # The second derivative of the rotation vector at zero is the angular acceleration.
        turned = back.rotation @ r.patch.axes
        y[i, 3:] = np.cross(patch.axes[:, 0], turned[:, 0]) if of_line else pin.log3(turned @ patch.axes.T)
    return y


def _body(state: State, patch: Patch) -> pin.SE3:
    return pin.SE3.Identity() if patch.against is None else state.frame(patch.against).X_WF


def _check_normal(rows: Rows) -> None:
    """Forces that only push must push along the patch's normal, out of the ground."""
    if rows.patch is None or rows.resultant is None:
        return
    G = _corner_rays(rows.cone)
    if G is not None and (rows.patch.axes[:, 2] @ (rows.resultant @ G)[:3]).min() <= 0.0:
        raise ConstraintWrong(f"{rows.name!r}: a force of its cone pulls along the patch's normal; one of them is upside down.")


@dataclass(frozen=True)
class SolverReport:
    """What `check_solver` ran.

    Attributes:
        ran: {problem: largest residual, scaled as `Solution.residuals`}.
        skipped: {problem: why the solver does not take it}.
        failed: {problem: what is wrong}.
    """

    ran: dict[str, float]
    skipped: dict[str, str]
    failed: dict[str, str]


def check_solver(
    solver: Solver,
    *,
    problems: Sequence[ReferenceProblem] | None = None,
    tolerance: float = 1e-9,
    accuracy: float = 1e-7,
) -> SolverReport:
    """What ran and what was skipped, of all reference problems put to a solver; raises if an answer is wrong.

    Each answer must satisfy the equations of motion, the constraints and the force sets of the law that it names,
    recomputed here, must agree with the closed form, and must know that it is solved. A floor must push up with the
    weight.

    Args:
        solver: What is checked.
        problems: By default `reference_problems()`.
        tolerance: Largest scaled residual.
        accuracy: Largest deviation of a and of the forces from the closed form, over max(1, largest entry).

    Raises:
        SolverWrong: if any fails, or none ran; the message has a line for each, with numbers.
    """
    report = SolverReport({}, {}, {})
    for reference in reference_problems() if problems is None else problems:
        reason = solver.reason_unsupported(reference.problem)
        if reason is not None:
            report.skipped[reference.name] = reason
            continue
        solution = solver.solve(reference.problem)
        found = law_residuals(reference.problem, solution, solver.law)
        report.ran[reference.name] = max(found.values())
        wrong = [f"{what} {value:.2e} > {tolerance:g}" for what, value in found.items() if not value <= tolerance]
        wrong += _against_closed_form(reference, solution, solver.law, accuracy)
        if not wrong and solution.status is not Status.SOLVED:
            wrong = [f"its status is {solution.status}, though its residuals are small"]
        if wrong:
            report.failed[reference.name] = "; ".join(wrong)
    if report.failed or not report.ran:
        name = type(solver).__name__
        lines = [f"  {what}: {why}" for what, why in report.failed.items()] or ["  it takes none of the problems"]
        raise SolverWrong(f"{name} fails {len(report.failed)} of {len(report.ran)} problems:\n" + "\n".join(lines), report)
    return report


def _against_closed_form(reference: ReferenceProblem, solution: Solution, law: str, accuracy: float) -> list[str]:
    pairs = []
    a = reference.a.get(law, reference.a.get("any"))
    if a is not None:
        pairs.append(("a", solution.a, a))
    pairs += [(f"force of {name!r}", solution.forces[name], f) for name, f in reference.forces.items()]
    if reference.net_force is not None:
        total = np.sum([f[:3] for f in solution.forces.values()], axis=0)
        pairs.append(("sum of the forces", total, reference.net_force))
    wrong = []
    for what, given, expected in pairs:
        gap = float(np.abs(given - expected).max(initial=0.0)) / max(1.0, float(np.abs(expected).max(initial=0.0)))
        if not gap <= accuracy:
            wrong.append(f"{what} is {np.round(given, 6).tolist()}, not {np.round(expected, 6).tolist()}")
    return wrong


def law_residuals(problem: GaussProblem, solution: Solution, law: str) -> dict[str, float]:
    """Scaled residuals of an answer's law, computed without `rbd.residuals` and without the answer's weights.

    Args:
        problem: What is answered.
        solution: The answer; "facets" in its law says that pyramids stand for the cones.
        law: The solver's law.

    Returns:
        stationarity, feasibility, cone and complementarity, scaled as in `rbd.residuals.Residuals`; NaN becomes inf.
    """
    a, f, M = solution.a, solution.multipliers, problem.M
    force_scale = max(1.0, (np.abs(M) @ np.abs(a)).max(), np.abs(problem.rhs).max(), np.abs(f).max(initial=0.0))
    worst = {"stationarity": 0.0, "feasibility": 0.0, "cone": 0.0, "complementarity": 0.0}
    row_scale, at, left = 1.0, 0, M @ a - problem.rhs
    for rows in problem.rows:
        part, offset = f[at : at + len(rows)], rows.bias + rows.feedback
        at += len(rows)
        left = left - rows.J.T @ part
        if not len(rows):
            continue
        row_scale = max(row_scale, float((np.abs(rows.J) @ np.abs(a) + np.abs(offset)).max()))
        corners = None
        if "facets" not in solution.law and isinstance(rows.cone, WrenchCone | LineCone):
            if rows.patch is None:
                raise InputError(f"rows {rows.name!r}: true cones at a patch's corners want its patch.")
            corners = solution.corner_forces[rows.name] @ rows.patch.axes  # true cones: the solver says how it is split
        cone = _against_motion(rows.cone, rows.velocity)
        gaps = _gaps(cone, rows.J @ a + offset, part, "pyramids" if "facets" in solution.law else law, corners)
        for what, value in zip(("feasibility", "cone", "complementarity"), gaps, strict=True):
            worst[what] = max(worst[what], value)
    worst["stationarity"] = float(np.abs(left).max()) / force_scale
    worst["feasibility"] /= row_scale
    worst["cone"] /= force_scale
    worst["complementarity"] /= force_scale * row_scale
    return {what: value if np.isfinite(value) else np.inf for what, value in worst.items()}


def _against_motion(cone: Cone, velocity: Array) -> Cone:
    """The set with the moving components of its boxes at the bound against their motion."""
    if isinstance(cone, Product):
        ends = np.cumsum([part.dim for part in cone.cones])[:-1]
        return Product([_against_motion(part, u) for part, u in zip(cone.cones, np.split(velocity, ends), strict=True)])
    if not isinstance(cone, Box) or not (np.abs(velocity) > REST_SPEED).any():
        return cone
    lo = np.where((velocity < -REST_SPEED) & np.isfinite(cone.hi), cone.hi, cone.lo)
    return Box(lo, np.where((velocity > REST_SPEED) & np.isfinite(cone.lo), cone.lo, cone.hi))


def _gaps(cone: Cone, c: Array, f: Array, law: str, corners: Array | None) -> tuple[float, float, float]:
    """How far c is from where it may be, f from the cone, and the two from being complementary."""
    if isinstance(cone, Product):
        ends = np.cumsum([part.dim for part in cone.cones])[:-1]
        parts = zip(cone.cones, np.split(c, ends), np.split(f, ends), strict=True)
        found = [_gaps(part, c_i, f_i, law, corners) for part, c_i, f_i in parts]
        return max(x[0] for x in found), max(x[1] for x in found), max(x[2] for x in found)
    if isinstance(cone, Free):
        return float(np.abs(c).max()), 0.0, 0.0
    if isinstance(cone, NonNegative):
        return float(np.maximum(-c, 0.0).max()), float(np.maximum(-f, 0.0).max()), float(np.abs(f * c).max())
    if isinstance(cone, Box):
        opens, closes, low, high = np.maximum(c, 0.0), np.maximum(-c, 0.0), np.isfinite(cone.lo), np.isfinite(cone.hi)
        gap = np.where(low, 0.0, opens) + np.where(high, 0.0, closes)  # where no bound ends the force, nothing may move
        slack = opens * np.abs(f - np.where(low, cone.lo, f)) + closes * np.abs(np.where(high, cone.hi, f) - f)
        beyond = np.maximum(np.maximum(cone.lo - f, f - cone.hi), 0.0)
        return float(gap.max(initial=0.0)), float(beyond.max(initial=0.0)), float(slack.max(initial=0.0))
    if not isinstance(cone, FrictionCone | WrenchCone | LineCone):
        raise InputError(f"check_solver knows no {type(cone).__name__}; give it problems with the sets of rbd.cones.")
    if law == "pyramids":
        G = _corner_rays(cone)
        assert G is not None
        return float(np.maximum(-(G.T @ c), 0.0).max()), float(nnls(G, f)[1]), abs(float(f @ c))
    C, mu = (_corner_map(cone).T @ c).reshape(-1, 3), cone.mu
    corners = f[None] if corners is None else corners
    if law == "coulomb":
        C = C + mu * np.linalg.norm(C[:, :2], axis=1)[:, None] * np.array([0.0, 0.0, 1.0])
    opening = mu * np.linalg.norm(C[:, :2], axis=1) - C[:, 2]
    beyond = np.linalg.norm(corners[:, :2], axis=1) - mu * corners[:, 2]
    split = float(np.abs(_corner_map(cone) @ corners.ravel() - f).max())
    slack = float(np.abs((C * corners).sum(axis=1)).max())
    return float(np.maximum(opening, 0.0).max()), max(split, float(np.maximum(beyond, 0.0).max())), slack


def _corner_map(cone: FrictionCone | WrenchCone | LineCone) -> Array:
    """Row forces of stacked corner forces: identity for a point, p and c x p for a patch; of a line no moment about it."""
    if isinstance(cone, FrictionCone):
        return np.eye(3)
    G = np.hstack([np.vstack([np.eye(3), np.cross(c, np.eye(3)).T]) for c in cone.corners])
    return G[[0, 1, 2, 4, 5]] if isinstance(cone, LineCone) else G


def _corner_rays(cone: Cone) -> Array | None:
    """Rays of the corner pyramids as columns, from their facets: a ray is where two neighbouring facets meet."""
    if isinstance(cone, NonNegative):
        return np.eye(cone.dim) if cone.dim == 1 else None
    if not isinstance(cone, FrictionCone | WrenchCone | LineCone):
        return None
    angle = 2.0 * np.pi * np.arange(cone.facets) / cone.facets
    inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(cone.facets, cone.mu)])
    rays = np.cross(inward, np.roll(inward, -1, axis=0))
    rays = (rays / rays[:, 2:]).T
    G = _corner_map(cone)
    return np.hstack([G[:, i : i + 3] @ rays for i in range(0, G.shape[1], 3)])
