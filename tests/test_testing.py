"""The checkers themselves: they pass what is right, fail what is wrong, and say what they looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.problem.cones import Free
from rbd.problem.rows import Rows
from rbd.testing import (
    ConstraintWrong,
    ContractBroken,
    SolverWrong,
    box,
    check_constraint,
    check_solver,
    law_residuals,
    reference_problems,
)


@dataclass(frozen=True)
class Changed:
    """A constraint whose rows are changed on their way out."""

    inner: rbd.PointContact | rbd.SurfaceContact
    change: Callable[[Rows], Rows]
    name: str = "sole"

    def rows(self, state: rbd.State) -> Rows:
        """The inner constraint's, changed."""
        return self.change(self.inner.rows(state))


@dataclass(frozen=True)
class Function:
    """The height and the distance from the z axis of a frame: rows with an error, and no patch."""

    frame: str
    name: str = "height"
    sign: float = 1.0
    with_error: bool = True
    bias: float = 1.0

    def rows(self, state: rbd.State) -> Rows:
        """Height and half the squared distance; their second derivatives by hand."""
        at = state.frame(self.frame)
        p, J, v, b = at.X_WF.translation, at.J[:3], at.v[:3], at.bias[:3]
        error = np.array([p[2], 0.5 * (p[0] ** 2 + p[1] ** 2)])
        A = np.array([[0.0, 0.0, 1.0], [p[0], p[1], 0.0]])
        bias = A @ b + np.array([0.0, v[0] ** 2 + v[1] ** 2])
        J = self.sign * A @ J
        return Rows(self.name, J, self.bias * bias, Free(2), J @ state.v, error if self.with_error else None)


@pytest.fixture(scope="module")
def bent(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose: nothing is zero by symmetry."""
    rng = np.random.default_rng(5)
    return talos.at(pin.integrate(talos.model, talos.standing().q, 0.3 * rng.normal(size=talos.nv)))


@pytest.fixture(params=["surface", "point", "smooth point"])
def contact(request: pytest.FixtureRequest, talos: rbd.Robot) -> rbd.PointContact | rbd.SurfaceContact:
    """One contact of each shape."""
    sole = talos.soles(0.5)[0]
    if request.param == "surface":
        return rbd.SurfaceContact("sole", sole.frame, corners=sole.corners, placement=sole.placement, friction=0.5)
    friction = 0.0 if request.param == "smooth point" else 0.5
    return rbd.PointContact(
        "sole", sole.frame, offset=(0.1, 0.02, -0.1), on=rbd.Ground(normal=(0.6, 0.0, 0.8)), friction=friction
    )


def test_a_right_constraint_passes_and_is_measured_to_nine_digits(bent, contact):
    """J v, velocity and J_dot v agree with the motion of the contact to 1e-9."""
    report = check_constraint(contact, bent)
    assert report.against == "motion of the patch"
    assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


@pytest.mark.parametrize(
    ("fault", "change"),
    [
        ("J v", lambda r: replace(r, J=-r.J)),
        ("J v", lambda r: replace(r, J=-r.J, velocity=-r.velocity)),
        ("J v", lambda r: replace(r, J=-r.J, velocity=-r.velocity, bias=-r.bias)),
        ("velocity", lambda r: replace(r, velocity=-r.velocity)),
        ("J_dot v", lambda r: replace(r, bias=np.zeros(len(r)))),
        ("J_dot v", lambda r: replace(r, bias=-r.bias)),
        ("J v", lambda r: replace(r, J=np.roll(r.J, 1, axis=1))),
        ("upside down", lambda r: replace(r, resultant=-r.resultant)),
        ("upside down", lambda r: replace(r, J=-r.J, velocity=-r.velocity, bias=-r.bias, resultant=-r.resultant)),
        ("upside down", lambda r: replace(r, patch=replace(r.patch, axes=r.patch.axes @ np.diag([1.0, -1.0, -1.0])))),
        ("named", lambda r: replace(r, name="other")),
    ],
    ids=[
        "J flipped", "J and velocity flipped", "all three flipped", "velocity flipped", "J_dot v dropped",
        "J_dot v flipped", "columns moved", "resultant flipped", "rows and resultant flipped", "axes upside down", "renamed",
    ],
)  # fmt: skip
def test_a_wrong_constraint_fails_with_its_name_and_numbers(bent, contact, fault, change):
    """Flipped signs, dropped J_dot v, wrong frames: each is caught, by the check that should catch it."""
    with pytest.raises(ConstraintWrong, match=fault):
        check_constraint(Changed(contact, change), bent)


def test_spatial_acceleration_is_not_classical(bent, talos):
    """A bias in spatial acceleration, Pinocchio's `getFrameAcceleration`, lacks w x v, and is caught."""

    def spatial(r: Rows) -> Rows:
        w, v = r.velocity[3:], r.velocity[:3]
        return replace(r, bias=r.bias - np.r_[np.cross(w, v), np.zeros(3)])

    with pytest.raises(ConstraintWrong, match="J_dot v"):
        check_constraint(Changed(replace_name(talos.soles()[0]), spatial), bent)


def replace_name(sole: rbd.SurfaceContact) -> rbd.SurfaceContact:
    """The same patch, named "sole"."""
    return rbd.SurfaceContact("sole", sole.frame, corners=sole.corners, placement=sole.placement, friction=sole.friction)


def test_rows_with_an_error_are_compared_with_its_motion(bent):
    """An error's derivatives are error' = J v and error'' = J a + J_dot v, for rows without a patch."""
    report = check_constraint(Function("gripper_left_base_link"), bent)
    assert report.against == "motion of the error" and max(report.jacobian, report.jdot_v) < 1e-9
    with pytest.raises(ConstraintWrong, match="J v"):
        check_constraint(Function("gripper_left_base_link", sign=-1.0), bent)
    with pytest.raises(ConstraintWrong, match="J_dot v"):
        check_constraint(Function("gripper_left_base_link", bias=0.0), bent)


def test_rows_with_nothing_to_compare_with_say_that_their_jacobian_was_not_checked(bent):
    """Of a nonholonomic constraint only J_dot v is checked, against its own J, and the report says so."""
    report = check_constraint(Function("gripper_left_base_link", with_error=False), bent)
    assert report.against == "its own J" and report.jacobian is None and report.jdot_v < 1e-9
    with pytest.raises(ConstraintWrong, match="J_dot v"):
        check_constraint(Function("gripper_left_base_link", with_error=False, bias=0.0), bent)


def test_a_constraint_without_rows_cannot_be_checked(bent, talos):
    """Nothing to check is no success."""
    empty = Changed(talos.soles()[0], lambda r: Rows("sole", np.zeros((0, talos.nv)), np.zeros(0), Free(0)))
    with pytest.raises(rbd.InputError, match="no rows"):
        check_constraint(empty, bent)


@dataclass(frozen=True)
class Broken:
    """A solver that answers another problem, or spoils the answer."""

    before: Callable[[rbd.GaussProblem], rbd.GaussProblem] = lambda problem: problem
    after: Callable[[rbd.problem.Answer], rbd.problem.Answer] = lambda answer: answer
    inner: rbd.ProxQP | rbd.KKT = rbd.ProxQP()
    refuses: str | None = None

    @property
    def law(self) -> str:
        """The inner solver's."""
        return self.inner.law

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """The inner solver's, or its own."""
        return self.refuses or self.inner.reason_unsupported(problem)

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """The inner solver's answer to the changed problem, put forward as the answer to this one."""
        return self.after(replace(self.inner.solve(self.before(problem)), problem=problem))


def _rows(change: Callable[[Rows], Rows]) -> Callable[[rbd.GaussProblem], rbd.GaussProblem]:
    return lambda P: rbd.GaussProblem(P.M, P.rhs, [change(r) for r in P.rows])


BROKEN = {
    "flipped forces": Broken(after=lambda s: replace(s, multipliers=-s.multipliers)),
    "flipped forces of a flipped J": Broken(before=_rows(lambda r: replace(r, J=-r.J))),
    "dropped J_dot v": Broken(before=_rows(lambda r: replace(r, bias=np.zeros(len(r))))),
    "flipped J_dot v": Broken(before=_rows(lambda r: replace(r, bias=-r.bias))),
    "dropped feedback": Broken(before=_rows(lambda r: replace(r, feedback=np.zeros(len(r))))),
    "everything holds": Broken(before=_rows(lambda r: replace(r, cone=Free(len(r))))),
    "no constraint": Broken(after=lambda s: replace(s, a=s.a_free, multipliers=0.0 * s.multipliers)),
    "not a number": Broken(after=lambda s: replace(s, a=np.full_like(s.a, np.nan))),
    "forces a little off": Broken(after=lambda s: replace(s, multipliers=s.multipliers * (1 + 1e-5))),
}


@pytest.mark.parametrize(
    ("fault", "inner"),
    [(f, rbd.ProxQP()) for f in BROKEN] + [(f, rbd.KKT()) for f in BROKEN if f != "everything holds"],  # KKT may say so
)
def test_a_broken_solver_fails(fault, inner):
    """Flipped forces, a dropped J_dot v and other faults are found, and named problem by problem."""
    with pytest.raises(SolverWrong) as caught:
        check_solver(replace(BROKEN[fault], inner=inner))
    report = caught.value.report
    assert report.failed and all(name in str(caught.value) for name in report.failed)
    if "J_dot v" in fault:
        assert "bob on a turning rod: J_dot v" in report.failed
    if fault == "flipped forces":
        assert any("box held" in name for name in report.failed)


def test_a_flipped_force_fails_on_every_problem_that_has_one():
    """No problem with a force lets a flipped one pass."""
    with pytest.raises(SolverWrong) as caught:
        check_solver(BROKEN["flipped forces"])
    report = caught.value.report
    forceless = {"box in free fall", "bead leaving a hill", "joint pushed off its stop"}
    forceless |= {name for name in report.ran if "pulled up" in name}
    assert set(report.failed) == set(report.ran) - forceless


def test_a_solver_that_takes_nothing_does_not_pass():
    """Skipping everything is no success."""
    with pytest.raises(SolverWrong, match="none of the problems"):
        check_solver(Broken(refuses="not today"))


def test_what_was_skipped_is_listed_with_the_reason():
    """What can break or slip is nothing for KKT: the report says why, and counts what ran."""
    report = check_solver(rbd.KKT())
    assert {"box at rest on a patch", "dry friction sticks"} <= set(report.skipped)
    assert all("KKT takes bilateral constraints" in reason for reason in report.skipped.values())
    assert not report.failed and len(report.ran) == len(reference_problems()) - len(report.skipped) > 0


def test_the_residuals_are_those_of_the_certificate(rng):
    """Two codes, one definition: stationarity and feasibility agree with `Answer.residuals` on spoilt answers."""
    for reference in reference_problems():
        P = reference.problem
        if rbd.ProxQP().reason_unsupported(P) is not None or not P.bilateral:
            continue
        s = rbd.ProxQP().solve(P)
        spoilt = replace(s, a=s.a + 1e-3 * rng.normal(size=P.nv))
        own, theirs = law_residuals(P, spoilt, "bilateral"), spoilt.residuals.scaled
        for what in ("stationarity", "feasibility"):
            assert own[what] == pytest.approx(theirs[what], rel=1e-9, abs=1e-15)


def test_true_cones_and_coulombs_law_are_judged_by_their_own_equations():
    """The 80 N box: Coulomb's answer passes Coulomb's law alone; the pyramid's passes the convex law, along its axis too."""
    mu, weight, cone = 0.6, 98.1, rbd.problem.FrictionCone(0.6)
    rows = Rows("floor", np.eye(3), np.zeros(3), cone)
    problem = rbd.GaussProblem(10.0 * np.eye(3), np.array([80.0, 0.0, -weight]), [rows])
    slides = np.array([-mu * weight, 0.0, weight])
    lifts = rbd.ProxQP().solve(problem)
    for f, passes in ((slides, "coulomb"), (lifts.multipliers, "convex")):
        a = (problem.rhs + f) / 10.0
        answer = rbd.problem.Answer(problem, a, f, None, "convex", "by hand", 1, 0.0)
        for law in ("coulomb", "convex"):
            assert (max(law_residuals(problem, answer, law).values()) < 1e-9) == (law == passes)


def test_the_reference_problems_have_names_answers_and_sources():
    """One name each, and every one says what its answer is."""
    problems = reference_problems()
    assert len({p.name for p in problems}) == len(problems) >= 25
    assert all(p.a and p.source for p in problems)


def test_the_box_is_a_box():
    """Uniform: I = m / 12 (b^2 + h^2), and its frame is its centre."""
    state = rbd.State(box(3.0, (0.2, 0.4, 0.6)), pin.neutral(box().model))
    expected = 3.0 / 12.0 * np.array([0.4**2 + 0.6**2, 0.2**2 + 0.6**2, 0.2**2 + 0.4**2])
    assert np.allclose(np.diag(state.M), [3.0, 3.0, 3.0, *expected], rtol=1e-14)


def test_contract_errors_are_ours():
    """One `except rbd.RbdError` catches them."""
    assert issubclass(ContractBroken, rbd.RbdError)
    assert issubclass(ConstraintWrong, ContractBroken) and issubclass(SolverWrong, ContractBroken)
