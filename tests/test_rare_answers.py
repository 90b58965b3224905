"""What is rarely said: nearest motions in words, solvers that fail the check, sets that no checker knows."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd import installation, modules
from rbd.errors import CannotHold, InaccurateWarning, InputError, NoSolution, WrongPinocchio
from rbd.problem.cones import Cone
from rbd.problem.programs import Outcome
from rbd.problem.residuals import blame
from rbd.problem.rows import Rows
from rbd.solvers import conic_newton
from rbd.statics import wanted_motion
from rbd.statics.least_effort import LeastEffort
from rbd.testing import ConstraintWrong, SolverWrong, box, check_constraint, check_solver, law_residuals, reference_problems


def squeezed() -> rbd.GaussProblem:
    """A mass of 1 kg that is to accelerate at 1 or more and at -0.5 or less, and at rest across; loosely, nothing."""
    rows = [
        Rows("low", np.array([[1.0, 0.0]]), np.array([-1.0]), rbd.problem.NonNegative(1)),
        Rows("high", np.array([[-1.0, 0.0]]), np.array([-0.5]), rbd.problem.NonNegative(1)),
        Rows("across", np.array([[0.0, 1.0]]), np.array([0.0]), rbd.problem.Free(1)),
    ]
    return rbd.GaussProblem(np.eye(2), np.ones(2), rows)


def test_a_nearest_motion_names_what_it_misses():
    """Halfway: both stops by 0.75 m/s2; what is met is not listed."""
    near = rbd.answers.solution.nearest_motion(squeezed())
    lines = str(near).splitlines()
    assert lines[0] == "nearest motion: rows are missed by up to 0.75 m/s2 (rad/s2), least squares"
    assert [line.split()[0] for line in lines[1:3]] == ["low", "high"] and "across" not in "\n".join(lines[1:3])
    assert near.a == pytest.approx([0.25, 0.0], abs=1e-9) and "by up to 0.75 m/s2" in repr(near)


@dataclass(frozen=True)
class Lame:
    """A solver that answers with free motion, whatever the rows."""

    law: str = "bilateral"

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """Takes all."""
        return None

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """Free motion."""
        answer = rbd.KKT().solve(rbd.GaussProblem(problem.M, problem.rhs))
        return replace(answer, problem=problem, multipliers=np.zeros(problem.m))


def test_a_nearest_motion_that_its_solver_does_not_find_is_none():
    """A solver that leaves the rows alone has no answer to the relaxed problem."""
    with pytest.raises(NoSolution, match="the nearest motion was not found"):
        rbd.answers.solution.nearest_motion(squeezed(), solver=Lame())


@dataclass(frozen=True)
class Rough:
    """A solver whose motions are off by 1e-8: within the tolerance that is asked for, and not solved."""

    law: str = "bilateral"

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """Takes what `KKT` takes."""
        return rbd.KKT().reason_unsupported(problem)

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """Nearly right."""
        answer = rbd.KKT().solve(problem)
        return replace(answer, a=answer.a + 1e-8 * np.abs(answer.a).max(initial=1.0))


def test_a_solver_fails_that_is_not_right_or_does_not_say_so():
    """Free motion for an answer; an answer that is only nearly solved; no answer to any problem."""
    with pytest.raises(SolverWrong, match="its status is .*, though its residuals are small"):
        check_solver(Rough(), tolerance=1e-5, accuracy=1e-5)
    with pytest.raises(SolverWrong, match="Lame fails .* of .* problems"):
        check_solver(Lame())
    with pytest.raises(SolverWrong, match="it takes none of the problems"):
        check_solver(rbd.KKT(), problems=[p for p in reference_problems() if rbd.KKT().reason_unsupported(p.problem)])


@dataclass(frozen=True)
class Strange(Cone):
    """A set that is a half-line, under a name of its own."""

    dim: int = 1

    def project(self, force):
        """The nearest force that pushes."""
        return np.maximum(force, 0.0)

    def generators(self):
        """One half-line."""
        return rbd.problem.NonNegative(1).generators()


def test_a_checker_says_which_sets_it_knows():
    """Another set is refused by name; true cones want the patch they are at; idle rows are passed over."""
    cone: Cone = Strange()
    P = rbd.GaussProblem(np.eye(1), -np.ones(1), [Rows("odd", np.eye(1), np.zeros(1), cone)])
    with pytest.raises(InputError, match="check_solver knows no Strange"):
        law_residuals(P, rbd.ProxQP().solve(P), "convex")
    corners = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]]
    sole = Rows("sole", np.eye(6), np.zeros(6), rbd.problem.WrenchCone(corners, 0.5))
    idle = Rows("idle", np.zeros((0, 6)), np.zeros(0), rbd.problem.NonNegative(0))
    P = rbd.GaussProblem(np.eye(6), np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0]), [sole, idle])
    with pytest.raises(InputError, match="'sole': true cones at a patch's corners want its patch"):
        law_residuals(P, rbd.ConeSolver().solve(P), "coulomb")
    assert max(law_residuals(P, rbd.ProxQP().solve(P), "convex").values()) < 1e-9


def test_a_constraint_without_velocities_is_checked_by_its_rows():
    """Rows that give no velocity: J v alone is compared, and the report is as good."""

    @dataclass(frozen=True)
    class Silent:
        name: str = "silent"

        def rows(self, state: rbd.State) -> Rows:
            frame = state.frame("box")
            return Rows(self.name, frame.J[:3], frame.bias[:3], rbd.problem.Free(3), error=frame.X_WF.translation.copy())

    robot = box(10.0)
    state = rbd.State(robot, np.array([0.1, 0.2, 0.3, 0.0, 0.0, np.sin(0.2), np.cos(0.2)]))
    report = check_constraint(Silent(), state)
    assert report.name == "silent"
    with pytest.raises(ConstraintWrong, match="gave rows named 'silent'"):
        check_constraint(SimpleNamespace(name="loud", rows=Silent().rows), state)


def test_no_constraint_is_to_blame_where_there_is_none():
    """A problem without rows."""
    P = rbd.GaussProblem(np.eye(1), np.ones(1))
    assert blame(P, np.zeros(1), np.zeros(0), None) == "no constraint"


# -------------------------------------------------------------------------------------------------- the right Pinocchio


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({}, "which knows no robots"),
        ({"Model": object, "__version__": "2.7.0"}, "finds version 2.7.0 at"),
        ({"Model": object, "__version__": "unknown"}, "finds version unknown at"),
        ({"Model": object, "__version__": "4.1.0", "__file__": "/opt/ros/noetic/pinocchio/__init__.py"}, "/opt/ros"),
    ],
)
def test_another_pinocchio_is_refused(given: dict, match: str):
    """A package of that name that is none, an old one, ROS's."""
    module = ModuleType("pinocchio")
    module.__file__ = "/somewhere/pinocchio/__init__.py"
    for name, value in given.items():
        setattr(module, name, value)
    with pytest.raises(WrongPinocchio, match=match):
        installation.check(module)


@pytest.mark.parametrize("content", [None, "raise RuntimeError('made for another Python')"])
def test_a_pinocchio_that_cannot_be_imported_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str | None):
    """None at all: what to install. One that fails: where it is, and how."""
    if content is None:
        monkeypatch.setitem(sys.modules, "pinocchio", None)
        expected = "Pinocchio is not installed here. Try: pip install 'pin>=4.1'"
    else:
        (tmp_path / "pinocchio.py").write_text(content)
        monkeypatch.delitem(sys.modules, "pinocchio")
        monkeypatch.syspath_prepend(tmp_path)
        expected = f"finds {tmp_path / 'pinocchio.py'}, which cannot be imported: RuntimeError: made for another Python"
    with pytest.raises(WrongPinocchio) as error:
        installation._found()
    assert expected in str(error.value)


def test_a_missing_library_of_the_system_is_named(monkeypatch: pytest.MonkeyPatch):
    """A minimal Debian has no OpenMP library; an ImportError of another kind is left as it is."""

    def fails(name: str):
        raise ImportError(told)

    monkeypatch.setattr(modules, "import_module", fails)
    told = "libgomp.so.1: cannot open shared object file: No such file or directory"
    with pytest.raises(WrongPinocchio, match=r"needs libgomp\.so\.1, which this system has not\. Try: install libgomp1"):
        modules.named("rbd", {"solve": "rbd.answers.least_constraint"}, "solve")
    told = "libhdf5.so.310: cannot open shared object file: No such file or directory"
    with pytest.raises(WrongPinocchio, match=r"install the package that has libhdf5\.so\.310"):
        modules.submodule("rbd", "solvers")
    told = "cannot import name 'x'"
    with pytest.raises(ImportError, match="cannot import name 'x'") as error:
        modules.submodule("rbd", "solvers")
    assert not isinstance(error.value, WrongPinocchio)


def test_planar_is_there_when_it_is_first_asked_for(monkeypatch: pytest.MonkeyPatch):
    """It needs SymPy, so `import rbd` leaves it alone; what there is not is said as Python says it."""
    monkeypatch.delattr(rbd, "planar", raising=False)
    assert rbd.planar.Chain(2).n == 2
    with pytest.raises(AttributeError, match="module 'rbd' has no attribute 'plane'"):
        rbd.plane  # noqa: B018
    with pytest.raises(AttributeError, match="has no attribute 'Scene'; there is rbd.visual.Scene$"):
        rbd.Scene  # noqa: B018
    assert not hasattr(rbd, "nothing_like_it") and not hasattr(rbd.statics, "Scene")


# ------------------------------------------------------------------------------------------- holding, and what it leaves


def off_by(relative: float):
    """`solve_conic` with answers that are off by this much."""
    right = conic_newton.solve_conic

    def solve(*given, **more):
        found = right(*given, **more)
        return replace(found, x=found.x * (1.0 + relative))

    return solve


@pytest.mark.parametrize(
    ("relative", "told"), [(1e-8, pytest.warns(InaccurateWarning, match="of talos have a scaled residual of")), (1e-2, None)]
)
def test_torques_that_are_not_found_to_nine_digits_are_told(talos, monkeypatch, relative, told):
    """A program that is solved badly: a warning up to 1e-7, no torques above; never a wrong answer in silence."""
    monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
    monkeypatch.setattr(wanted_motion, "solve_conic", off_by(relative))
    monkeypatch.setattr(wanted_motion, "_balanced", lambda program, x: x)
    if told is None:
        with pytest.raises(CannotHold, match="whether it can be held was not found") as caught:
            rbd.hold(talos.standing(), talos.soles(0.7))
        assert caught.value.certificate is None and caught.value.limits == ()
    else:
        with told:
            held = rbd.hold(talos.standing(), talos.soles(0.7))
        assert held.residuals.stationarity < 1e-7 * talos.mass * 9.81


def test_forces_that_are_a_little_off_are_balanced(talos, monkeypatch):
    """An answer to eight digits is moved, where it is inside its bounds, so that the equations of motion hold to rounding."""
    monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
    monkeypatch.setattr(wanted_motion, "solve_conic", off_by(1e-8))
    assert rbd.hold(talos.standing(), talos.soles(0.7)).residuals.worst < 1e-12


def test_possible_torques_do_where_the_least_are_not_found(talos, monkeypatch):
    """The least effort is not found, and any torques that hold are: they do hold, and say what they are not."""
    settled = conic_newton.settled
    monkeypatch.setattr(conic_newton, "_by_newton", lambda program: None)
    monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
    monkeypatch.setattr(conic_newton, "settled", lambda p, *more: None if p.H.any() else settled(p, *more))
    push = rbd.ExternalForce("torso_2_link", (0.0, 60.0, 0.0))
    for margin in (0.0, 0.05):
        held = rbd.hold(talos.standing(), talos.soles(0.4), external=push, margin=margin)
        assert not held.least and held.status == "solved" and "the least was not found to nine digits" in str(held)
        assert (np.abs(held.tau) <= talos.effort_limit).all()
        assert np.abs(rbd.solve(talos.standing(), held.tau, talos.soles(0.4), external=push).a).max() < 1e-6
    monkeypatch.undo()
    assert rbd.hold(talos.standing(), talos.soles(0.4), external=push).least


def test_torques_that_are_no_numbers_are_none(monkeypatch):
    """A program whose numbers are lost: no torques, of an arm too, whose motors balance whatever its contacts do."""
    arm = rbd.load_robot("ur5", root="fixed")
    nan = np.array([np.nan])
    monkeypatch.setattr(conic_newton, "_by_newton", lambda program: None)
    monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
    monkeypatch.setattr(
        conic_newton,
        "interior_point",
        lambda p: conic_newton.ConicAnswer(p, Outcome.NOT_FOUND, nan * np.ones(len(p.g)), 0 * p.b, nan * p.low, "Clarabel", 1),
    )
    with pytest.raises(CannotHold, match="whether it can be held was not found"):
        rbd.hold(rbd.State(arm, arm.neutral()), [rbd.PointContact("hand", "tool0", friction=0.5)])


def test_a_posture_held_by_a_lock_and_soles_has_margins_of_the_soles(talos):
    """A locked joint carries, and is no contact: torques, friction and centres of pressure are those of the soles."""
    held = rbd.hold(talos.standing(), [*talos.soles(0.7), rbd.JointLock("brake", "arm_left_4_joint")])
    assert set(held.margins.friction) == set(held.margins.centre_of_pressure) == {"left_sole", "right_sole"}
    assert "brake" in held.forces and "brake" not in held.contacts and "brake" not in str(held)
    free = talos.actuated_names.index("arm_left_4_joint")
    assert abs(held.tau[free]) < 1.0  # the lock, or the motor, carries the forearm: least torques choose the lock


def test_a_robot_that_nothing_carries_is_told_without_a_hull(talos):
    """A lock is no ground: the weight is said, and no distance to a hull."""
    with pytest.raises(CannotHold, match="balance its weight") as told:
        rbd.hold(talos.standing(), [rbd.JointLock("brake", "arm_left_4_joint")])
    assert "hull" not in str(told.value)


def test_one_law_alone_has_one_heading():
    """A held pendulum has no law of contact: all solvers are of one sort, or each alone."""
    robot = box(2.0)
    found = rbd.studies.compare_solvers(
        rbd.State(robot, pin.neutral(robot.model)), np.zeros(0), [rbd.PointContact("glue", "box")]
    )
    text = str(found)
    assert found.agree and "all that must agree do" in text
    assert ("two laws" in text) == (len({answer.law for answer in found.answers}) > 1)


def test_laws_are_compared_at_contacts_alone(talos):
    """A lock beside the soles has forces under both laws and no line in the comparison."""
    state = talos.standing()
    contacts = [*talos.soles(0.7), rbd.JointLock("brake", "arm_left_4_joint")]
    found = rbd.studies.compare_laws(state, rbd.hold(state, contacts).tau, contacts)
    assert set(found.under_convex) == set(found.under_coulomb) == {"left_sole", "right_sole"} and found.agree


def test_configurations_far_beyond_the_earth_are_refused():
    """Numbers above the bound are named with it; a passive joint may be given alone."""
    robot = box(1.0)
    with pytest.raises(InputError, match=r"reaches .*; at most .* is taken"):
        rbd.State(robot, np.array([1e12, 0, 0, 0, 0, 0, 1.0]))
