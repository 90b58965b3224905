"""The whole-body controller in simulations: contacts that come and go, forces that fade, and what is told about it."""

from __future__ import annotations

import math
import pickle
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.control import (
    AcceptedStep,
    ComTask,
    ContactSchedule,
    ContactTouch,
    ForceTask,
    FrameTask,
    Limits,
    MomentumTask,
    PostureTask,
    Reference,
    WholeBodyController,
    whole_body,
)
from rbd.control.contact_schedule import ContactWatch

URDF = Path(__file__).parents[2] / "urdf"
INF = math.inf


def shifted(start: np.ndarray, by: Sequence[float], duration: float) -> Callable[[float], Reference]:
    """From a point to another at rest, along a line: a polynomial of order 5."""

    def at(t: float) -> Reference:
        u = min(max(t / duration, 0.0), 1.0)
        s, ds, dds = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 - 60 * u**3 + 30 * u**4, 60 * u - 180 * u**2 + 120 * u**3
        d = np.asarray(by)
        return Reference(start + s * d, ds / duration * d, dds / duration**2 * d)

    return at


def lifted(start: np.ndarray, height: float, begin: float, end: float, sinks: float = 0.05) -> Callable[[float], Reference]:
    """A point that goes up and down from one time to another, a polynomial of order 6; then it sinks until it touches."""
    up, duration = np.array([0.0, 0.0, height]), end - begin

    def at(t: float) -> Reference:
        if t > end:
            return Reference(start - [0.0, 0.0, sinks * (t - end)], np.array([0.0, 0.0, -sinks]))
        u = max(t - begin, 0.0) / duration
        x = u - u * u
        z, v, a = 64 * x**3, 192 * x**2 * (1 - 2 * u) / duration, 384 * x * (1 - 5 * x) / duration**2
        return Reference(start + z * up, v * up, a * up)

    return at


class Quadruped:
    """Solo12 that moves its weight off its left hind foot, lifts it by 2 cm, and puts it down."""

    begin, end = 0.3, 0.5

    def __init__(self) -> None:
        self.robot = rbd.load_robot("solo12")
        self.state = self.robot.standing()
        self.feet = self.robot.feet(friction=0.7)
        self.hind_left = self.feet[2]
        points = {foot.name: foot.rows(self.state).patch.point for foot in self.feet}
        middle = np.mean([p for name, p in points.items() if name != "hind_left"], axis=0)
        self.com = shifted(self.state.com, [*(0.8 * (middle - self.state.com)[:2]), 0.0], 0.25)
        self.foot = self.state.frame("HL_FOOT").X_WF.translation

    def controller(self, **given: Any) -> WholeBodyController:
        """It assumes less friction than there is: forces at the edge of their cones would slip."""
        lands = given.pop("lands", self.end)
        tasks = [
            ComTask(self.com, cost=100.0),
            FrameTask("base_link", self.state.frame("base_link").X_WF.rotation, orientation_cost=10.0),
            PostureTask(self.state.q, cost=0.1, gain=50.0),
            FrameTask("HL_FOOT", lifted(self.foot, 0.02, self.begin, lands), position_cost=100.0, gain=900.0),
        ]
        given.setdefault("schedule", ContactSchedule({"hind_left": [(-INF, self.begin), (self.end, INF)]}, fade=0.04))
        return WholeBodyController(tasks, self.robot.feet(friction=0.6), **given)

    def run(self, controller: WholeBodyController, duration: float = 0.6, **given: Any) -> rbd.Trajectory:
        """The motion, at 2 ms."""
        constraints = given.pop("constraints", self.feet)
        given = {"step": 2e-3, "progress": False, **given}
        return rbd.simulate(self.state, constraints, duration=duration, controller=controller, **given)


@pytest.fixture(scope="module")
def quadruped() -> Quadruped:
    """Solo12."""
    return Quadruped()


def heights(motion: rbd.Trajectory, contact: rbd.constraints.Contact) -> np.ndarray:
    """Of a contact's centre over time [m]."""
    robot = motion.robot
    return np.array([contact.rows(rbd.State(robot, q)).patch.point[2] for q in motion.q])


@pytest.fixture(scope="module")
def step_on_three_legs(quadruped: Quadruped) -> tuple[WholeBodyController, rbd.Trajectory]:
    """A lifted foot, and back."""
    controller = quadruped.controller()
    return controller, quadruped.run(controller)


def test_a_foot_is_lifted_and_put_down(quadruped: Quadruped, step_on_three_legs: tuple[WholeBodyController, rbd.Trajectory]):
    """By its swing task, which is left out where the foot stands; the others keep still."""
    controller, motion = step_on_three_legs
    z = {foot.name: heights(motion, foot) for foot in quadruped.feet}
    assert z["hind_left"].max() == pytest.approx(0.02, abs=1e-3)
    assert abs(z["hind_left"][-1]) < 1e-6
    log = controller.log
    swing, missed = (log.t >= 0.3) & (log.t < 0.5), log.missed["HL_FOOT"]
    assert np.isnan(missed[log.assumed["hind_left"]]).all() and not np.isnan(missed[swing]).any()
    assert (~log.planned["hind_left"] == swing).all()
    assert not log.assumed["hind_left"][swing].any() and log.assumed["hind_left"][-1] and log.assumed["hind_left"][0]
    for foot in ("front_left", "front_right", "hind_right"):
        assert log.assumed[foot].all() and log.touching[foot].all()
        assert np.abs(z[foot]).max() < 1e-6
    com = np.array([quadruped.com(t).value for t in motion.t])
    assert np.abs(motion.com - com).max() < 5e-3
    assert log.residual.max() < 1e-7 and log.violations == 0
    assert "hind_left" in log.disagreements and set(log.disagreements) == {"hind_left"}
    assert set(log.disagreements["hind_left"]) <= {"late", "partial"}
    assert (np.abs(motion.tau) <= quadruped.robot.effort_limit).all()


def test_it_computes_once_a_step_and_holds(step_on_three_legs: tuple[WholeBodyController, rbd.Trajectory]):
    """One entry of the log at each sample, the torques of which are recorded."""
    controller, motion = step_on_three_legs
    assert (controller.log.t == motion.t).all() and len(controller.log) == 301
    assert (motion.tau[-1] == controller(motion[-1].state, 0.6)).all()


def test_a_fresh_and_a_used_controller_give_the_same_bits(quadruped: Quadruped):
    """And two objects; also where half steps are extrapolated, at a rate of its own."""
    first, second = quadruped.controller(every=4e-3), quadruped.controller(every=4e-3)
    method = rbd.TimeStepping(extrapolate=True)
    runs = [quadruped.run(each, 0.4, integrator=method) for each in (first, first, second)]
    for run in runs[1:]:
        assert (run.q == runs[0].q).all() and (run.tau == runs[0].tau).all()
    assert (first.log.residual == second.log.residual).all() and str(first) == str(second)
    tau = runs[0].tau
    assert (tau[:-1:2] == tau[1::2]).all() and (tau[2::2] != tau[:-1:2]).any(axis=1).all()
    assert np.abs(np.diff(first.log.t) - 4e-3).max() < 1e-9
    assert heights(runs[0], quadruped.hind_left).max() > 0.015


def test_a_foot_that_lands_early_is_taken_as_a_contact(quadruped: Quadruped):
    """Its swing ends 60 ms before its contact is planned."""
    controller = quadruped.controller(lands=0.44)
    motion = quadruped.run(controller)
    log = controller.log
    early = log.disagreements["hind_left"]["early"]
    assert 10 <= early <= 32 and 0.43 < log.first["hind_left", "early"] < 0.48
    assert log.assumed["hind_left"][log.t > 0.48].all() and "late" not in log.disagreements["hind_left"]
    assert "touches before it is planned, and is taken as a contact" in str(controller)
    assert np.abs(heights(motion, quadruped.hind_left)[log.t > 0.48]).max() < 1e-6


def test_a_foot_that_touches_at_the_start_of_its_swing_has_not_landed(quadruped: Quadruped):
    """A foot that is never lifted touches unplanned, until half of its swing has passed; then it has landed."""
    tasks = [ComTask(quadruped.com, cost=100.0), PostureTask(quadruped.state.q, cost=0.1, gain=50.0)]
    schedule = ContactSchedule({"hind_left": [(-INF, 0.1), (0.3, INF)]}, fade=0.04)
    controller = WholeBodyController(tasks, quadruped.robot.feet(friction=0.6), schedule=schedule)
    for k in range(31):
        controller.accepted(AcceptedStep(quadruped.state, 0.01 * k, 0.01, {}))
    log = controller.log
    assert log.disagreements == {"hind_left": {"unplanned": 6, "early": 10}}  # after a fade: 0.14 to 0.19, 0.2 to 0.29
    assert (log.assumed["hind_left"] == ~((log.t > 0.095) & (log.t < 0.195))).all()


def test_a_late_foot_goes_on_with_its_swing(quadruped: Quadruped):
    """It sinks at 0.05 m/s from when it was planned to touch, until it does; then its force fades in."""
    late = quadruped.controller(schedule=ContactSchedule({"hind_left": [(-INF, 0.3), (0.45, INF)]}, fade=0.04), lands=0.5)
    motion = quadruped.run(late)
    log = late.log
    assert 20 <= log.disagreements["hind_left"]["late"] <= 40
    touches = log.t[log.assumed["hind_left"] & (log.t > 0.4)][0]
    assert 0.49 < touches < 0.53 and abs(heights(motion, quadruped.hind_left)[-1]) < 1e-6
    assert "planned, and does not touch" in str(late)


def test_what_touches_unplanned_is_named(quadruped: Quadruped):
    """A contact of the simulation that the controller does not have."""
    three = [foot for foot in quadruped.robot.feet(friction=0.6) if foot.name != "front_left"]
    only = WholeBodyController([PostureTask(quadruped.state.q)], three)
    quadruped.run(only, 0.01)
    assert only.log.disagreements == {"front_left": {"unplanned": 6}}
    assert "front_left: touches, and is not planned, in 6 steps, first at t = 0 s" in str(only)


def test_a_wall_that_the_trunk_meets_is_named_and_not_counted_on(quadruped: Quadruped):
    """The trunk moves forward by 1 cm, against a wall 5 mm away: the log says since when, and the step knows no force there."""
    state = quadruped.state
    nose = state.frame("base_link").X_WF.translation + [0.2, 0.0, 0.0]
    wall = rbd.PointContact(
        "nose",
        "base_link",
        offset=(0.2, 0.0, 0.0),
        friction=0.5,
        on=rbd.Ground(point=nose + [5e-3, 0.0, 0.0], normal=(-1.0, 0.0, 0.0)),
    )
    forward = ComTask(shifted(state.com, [0.01, 0.0, 0.0], 0.2), cost=100.0)
    controller = WholeBodyController([forward, PostureTask(state.q, cost=0.1)], quadruped.robot.feet(friction=0.6))
    motion = quadruped.run(controller, 0.25, constraints=[*quadruped.feet, wall])
    log = controller.log
    assert log.disagreements["nose"].keys() == {"unplanned"} and 0.05 < log.first["nose", "unplanned"] < 0.15
    assert controller.actuation.forces.keys() == {foot.name for foot in quadruped.feet}
    assert motion.forces["nose"][-1][0] < -0.1 and motion.com[-1, 0] - state.com[0] < 7e-3


def touch(*names: str, gap: float = 0.0) -> ContactTouch:
    """Points of collision shapes that touch, and one that does not."""
    k = len(names)
    gaps, touches = np.append(np.full(k, gap), 0.01), np.append(np.ones(k, bool), False)
    return ContactTouch(gaps, touches, np.zeros((k + 1, 3)), (*names, "HR_FOOT_0:9"))


def test_collision_shapes_that_touch_are_named_by_their_link(quadruped: Quadruped):
    """Those of feet whose own contacts are planned are none, and make them touch; nor is what always acts, as a loop."""
    above = rbd.State(quadruped.robot, quadruped.state.q + 3e-4 * np.eye(quadruped.robot.nq)[2])
    three = [foot for foot in quadruped.robot.feet(friction=0.6) if foot.name != "front_left"]
    controller = WholeBodyController([PostureTask(quadruped.state.q)], three)
    told = {
        "shapes": touch("HL_FOOT_0:1", "HL_FOOT_0:5", "FL_FOOT_0:1", "FL_FOOT_0:2", "FL_UPPER_LEG_0:3"),
        "loop": touch("", gap=-INF),
    }
    controller.accepted(AcceptedStep(above, 0.0, 1e-3, told))
    log = controller.log
    assert log.disagreements.pop("front_right") == log.disagreements.pop("hind_right") == {"late": 1}
    assert log.disagreements == {"shapes: FL_FOOT_0": {"unplanned": 1}, "shapes: FL_UPPER_LEG_0": {"unplanned": 1}}
    assert {name for name, there in log.assumed.items() if there[0]} == {"hind_left"}


def test_talos_squats(talos: rbd.Robot):
    """Its centre of mass goes down by 3 cm and up in 0.5 s, on both soles."""
    state, soles = talos.standing(), talos.soles(friction=0.7)
    com = lifted(state.com, -0.03, 0.0, 0.5)
    controller = WholeBodyController(
        [
            ComTask(com, cost=100.0),
            PostureTask(state.q, cost=0.01, gain=40.0),
            FrameTask("torso_2_link", state.frame("torso_2_link").X_WF.rotation, orientation_cost=10.0),
        ],
        soles,
    )
    motion = rbd.simulate(state, soles, duration=0.5, step=4e-3, controller=controller, progress=False)
    wanted = np.array([com(t).value for t in motion.t])
    assert np.abs(motion.com - wanted).max() < 1e-3 and np.ptp(motion.com[:, 2]) > 0.029
    log = controller.log
    assert not log.disagreements and log.violations == 0 and log.residual.max() < 1e-7
    assert 0.05 < log.torque_share.max() < 1.0 and (np.abs(motion.tau) <= talos.effort_limit).all()
    assert log.torque_share.max() == pytest.approx((np.abs(motion.tau) / talos.effort_limit).max(), abs=1e-12)
    assert str(controller).splitlines()[-1] == "what touches is what was planned, in all steps"


def test_an_arm_without_contacts_follows_its_tasks():
    """Smooth motion by the method of Runge and Kutta, torques held for a step: an error of the order of the step."""
    arm = rbd.load_robot("ur5", root="fixed")
    state = arm.at([0.2, -1.2, 1.5, -0.4, 0.3, 0.1])
    hand = shifted(state.frame("tool0").X_WF.translation, [0.1, 0.1, -0.1], 0.4)
    tasks = [FrameTask("tool0", hand, position_cost=100.0, gain=400.0), PostureTask(state.q, cost=0.01)]
    errors = []
    for step in (4e-3, 2e-3):
        controller = WholeBodyController(tasks)
        motion = rbd.simulate(state, duration=0.5, step=step, controller=controller, progress=False)
        p = np.array([rbd.State(arm, q).frame("tool0").X_WF.translation for q in motion.q])
        errors.append(np.abs(p - np.array([hand(t).value for t in motion.t])).max())
        assert not controller.log.disagreements and len(controller.log) == len(motion.t)
    assert errors[0] < 2e-3 and errors[1] == pytest.approx(0.5 * errors[0], rel=0.3), errors


def test_a_leg_with_loops_moves_its_motors():
    """Its loops are contacts of the controller, which always act: three parallelograms stay closed."""
    leg = rbd.load_robot(URDF / "parallel_leg.urdf")
    state = leg.at("assembled")
    controller = WholeBodyController([PostureTask(state.q, gain=400.0)], leg.loops())
    push = rbd.ExternalForce("foot", (20.0, 0.0, -30.0))
    motion = rbd.simulate(state, leg.loops(), duration=0.1, step=1e-3, controller=controller, external=push, progress=False)
    assert not controller.log.disagreements and all(there.all() for there in controller.log.assumed.values())
    still = rbd.simulate(state, leg.loops(), duration=0.1, step=1e-3, controller=controller, progress=False)
    assert np.abs(still.q - state.q).max() < 1e-6
    assert np.abs(motion.q - state.q).max() > 1e-4  # the push, of which it does not know
    a = rbd.solve(state, still.tau[0], leg.loops()).a
    assert np.abs(a).max() < 1e-3  # the cost of any acceleration is 1e-4 of the task's


@pytest.mark.filterwarnings("ignore:the steps of solo12 lose energy")  # 0.14 % where a foot begins to slide
def test_a_foot_that_slides_is_counted(quadruped: Quadruped):
    """Ground of little friction, of which the controller does not know: it goes on, and says so."""
    controller = WholeBodyController(
        [ComTask(shifted(quadruped.state.com, [0.03, 0.0, 0.0], 0.1), cost=100.0), PostureTask(quadruped.state.q, cost=0.1)],
        quadruped.robot.feet(friction=0.7),
    )
    motion = quadruped.run(controller, 0.12, constraints=quadruped.robot.feet(friction=0.1))
    assert sum(kinds.get("slips", 0) for kinds in controller.log.disagreements.values()) > 20
    assert "taken as a contact, and slides" in str(controller)
    assert len(motion.t) == 61


def test_steps_that_violate_contacts_are_counted_and_said_once(quadruped: Quadruped):
    """A foot that should keep still, and rise with a lift that is not there."""
    lift = rbd.PointContact("lift", "FL_FOOT", friction=0.6, on=rbd.Ground(acceleration=(0.0, 0.0, 1.0)))
    controller = WholeBodyController([PostureTask(quadruped.state.q)], [*quadruped.feet, lift], every=4e-3)
    with pytest.warns(rbd.errors.RelaxedLimitsWarning, match="At t = 0 s. Said once in a motion") as said:
        quadruped.run(controller, 0.02)
    assert [each.filename for each in said] == [__file__]
    log = controller.log
    assert log.violations == len(log) == 6 and log.violation == pytest.approx(0.5, abs=0.01)  # half of 1 m/s2 each
    assert "6 steps could not keep contacts or joint limits, by at most 0.5 m/s2" in str(controller)
    with pytest.warns(rbd.errors.RelaxedLimitsWarning):
        quadruped.run(controller, 0.02)  # once in each motion


def test_a_simulation_without_contacts_is_refused(quadruped: Quadruped):
    """The feet that the controller counts on would carry nothing; a motion in the air wants none."""
    falls = quadruped.controller()
    with pytest.raises(rbd.InputError, match=r"counts on front_left, .* and the simulation has no contacts"):
        quadruped.run(falls, constraints=[])
    jumps = ContactSchedule({foot.name: [(1.0, INF)] for foot in quadruped.feet}, flight=True)
    controller = WholeBodyController([PostureTask(quadruped.state.q)], quadruped.feet, schedule=jumps)
    assert quadruped.run(controller, 0.2, constraints=[]).com[-1, 2] < quadruped.state.com[2]


def test_limits_of_joints_are_no_contacts_that_come_late(quadruped: Quadruped):
    """The same list may be given to the simulation and to the controller."""
    both = [*quadruped.feet, *quadruped.robot.joint_limits()]
    controller = WholeBodyController([PostureTask(quadruped.state.q)], both)
    quadruped.run(controller, constraints=both)
    assert controller.log.disagreements == {}


def test_a_step_leaves_the_filters_of_warnings_alone(quadruped: Quadruped):
    """They are those of all threads: two simulations at once would put back each other's, and silence what comes later."""
    seen = []

    def target(t: float) -> np.ndarray:
        seen.append((list(warnings.filters), warnings.showwarning))
        return quadruped.state.com

    controller = WholeBodyController([ComTask(target), PostureTask(quadruped.state.q)], quadruped.feet)
    before = list(warnings.filters), warnings.showwarning
    controller.accepted(AcceptedStep(quadruped.state, 0.0, 1e-3, {}))
    assert seen and all(each == before for each in seen)


def test_what_a_task_raises_stops_the_simulation(quadruped: Quadruped):
    """The error of a user's function is the cause, at its time."""

    def fails(t: float) -> np.ndarray:
        if t > 0.0095:
            raise ArithmeticError("no plan")
        return quadruped.state.com

    controller = WholeBodyController([ComTask(fails), PostureTask(quadruped.state.q)], quadruped.robot.feet(friction=0.6))
    with pytest.raises(rbd.errors.SimulationStopped, match="no plan") as stopped:
        quadruped.run(controller)
    assert stopped.value.t == pytest.approx(0.008) and isinstance(stopped.value.__cause__, rbd.errors.InputError)
    assert len(controller.log) == 5 and len(stopped.value.trajectory.t) == 5


def test_a_step_without_an_answer_is_never_silent(quadruped: Quadruped, monkeypatch: pytest.MonkeyPatch):
    """It stops the simulation, and says when and on what the robot stood."""
    controller = quadruped.controller()

    def fails(*given: Any, **settings: Any) -> None:
        raise rbd.NoSolution("no torques")

    controller.accepted(AcceptedStep(quadruped.state, 0.0, 1e-3, {}))
    monkeypatch.setattr(whole_body, "silent_step", fails)
    with pytest.raises(rbd.NoSolution) as failed:
        controller.accepted(AcceptedStep(quadruped.state, 0.5, 1e-3, {}))
    assert failed.value.__notes__ == ["at t = 0.5 s, on front_left, front_right, hind_left, hind_right"]
    with pytest.raises(rbd.errors.SimulationStopped, match="no torques"):
        quadruped.run(controller)


def test_a_used_controller_can_be_sent_to_another_process(quadruped: Quadruped):
    """With what it remembers, and its log."""
    controller = WholeBodyController([PostureTask(quadruped.state.q)], quadruped.feet, schedule=ContactSchedule({}))
    controller.accepted(AcceptedStep(quadruped.state, 0.0, 1e-3, {}))
    copied = pickle.loads(pickle.dumps(controller))
    assert (copied.actuation.tau == controller.actuation.tau).all() and str(copied) == str(controller)
    copied.reset()
    copied.accepted(AcceptedStep(quadruped.state, 0.0, 1e-3, {}))
    assert (copied.actuation.tau == controller.actuation.tau).all()


def test_it_wants_to_be_told(quadruped: Quadruped, talos: rbd.Robot):
    """No torques before the first step, none for another robot, until it is reset."""
    controller = quadruped.controller()
    with pytest.raises(rbd.errors.InputError, match="before it was told of a step"):
        controller(quadruped.state, 0.0)
    with pytest.raises(rbd.errors.InputError, match="has done no step yet"):
        _ = controller.actuation
    assert str(controller).endswith("no step of control yet")
    with pytest.raises(rbd.errors.InputError, match="expected rbd.control.AcceptedStep"):
        controller.accepted(quadruped.state)
    controller.accepted(AcceptedStep(quadruped.state, 0.0, 1e-3, {}))
    assert (controller(quadruped.state, 0.0) == controller.actuation.tau).all()
    other = talos.standing()
    for ask in (lambda: controller(other, 0.0), lambda: controller.accepted(AcceptedStep(other, 0.0, 1e-3, {}))):
        with pytest.raises(rbd.errors.InputError, match="told of another robot, and got a state of talos"):
            ask()
    with pytest.raises(rbd.errors.InputError, match="expected a State"):
        controller(quadruped.state.q, 0.0)
    with pytest.raises(rbd.errors.InputError, match="held for 0.02 s, longer than the horizon"):
        controller.accepted(AcceptedStep(quadruped.state, 0.0, 0.02, {}))
    controller.reset()
    assert not len(controller.log)


SOLO = rbd.load_robot("solo12")
FEET = SOLO.feet(friction=0.7)
POSTURE = PostureTask(SOLO.posture("standing"))
LOOP = rbd.LoopClosure("loop", "FL_FOOT", "FR_FOOT")


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"tasks": []}, "InputError", "tasks are empty"),
        ({"tasks": POSTURE}, "InputError", "expected a list"),
        ({"tasks": [PostureTask]}, "InputError", "is no task"),
        ({"tasks": [POSTURE, POSTURE]}, "DuplicateName", "two tasks are named 'posture'"),
        ({"tasks": [POSTURE, ForceTask("front_lef", [0.0, 0.0, 5.0])]}, "UnknownName", "nearest: 'front_left'"),
        ({"contacts": FEET[0]}, "InputError", "single constraint"),
        ({"contacts": [*FEET, FEET[0]]}, "DuplicateName", "two contacts are named 'front_left'"),
        ({"contacts": ["front_left"]}, "InputError", "is no constraint"),
        ({"schedule": {"front_left": [(0.0, 1.0)]}}, "InputError", "expected rbd.control.ContactSchedule"),
        ({"schedule": ContactSchedule({"front_lft": [(0.0, 1.0)]})}, "UnknownName", "nearest: 'front_left'"),
        (
            {"schedule": ContactSchedule({foot.name: [(0.0, 1.0), (1.2, INF)] for foot in FEET})},
            "InputError",
            "lifts all contacts at once, from 1 to 1.2 s: front_left, front_right, hind_left, hind_right",
        ),
        (
            {"schedule": ContactSchedule({foot.name: [(0.0, 1.0)] for foot in FEET})},
            "InputError",
            r"from 1 to inf s.*flight=True",
        ),
        (
            {"contacts": SOLO.feet(friction=None), "schedule": ContactSchedule({"front_left": [(0.0, 1.0)]})},
            "InputError",
            "lifts 'front_left', which is bilateral",
        ),
        (
            {"contacts": [*FEET, LOOP], "schedule": ContactSchedule({"loop": [(0.0, 1.0)]})},
            "InputError",
            "lifts 'loop', which is bilateral",
        ),
        ({"limits": 0.9}, "InputError", "expected rbd.control.Limits"),
        ({"every": 0.0}, "InputError", "every of WholeBodyController is 0.0"),
        ({"every": math.nan}, "InputError", "every of WholeBodyController is nan"),
        ({"every": 0.02}, "InputError", "held for 0.02 s, longer than the horizon"),
        ({"contact_damping": -1.0}, "InputError", "contact_damping is -1.0"),
        ({"early": 0.0}, "InputError", "early is 0.0"),
        ({"early": 1.5}, "InputError", "early is 1.5"),
    ],
)
def test_wrong_controllers_are_refused(given: dict[str, Any], error: str, message: str):
    """Where they are made."""
    with pytest.raises(getattr(rbd.errors, error), match=message):
        WholeBodyController(**{"tasks": [POSTURE], "contacts": FEET, **given})


def test_what_is_not_refused():
    """Flight that is said; a robot that stands on feet that no schedule names; a longer horizon."""
    jump = ContactSchedule({foot.name: [(0.0, 1.0), (1.2, INF)] for foot in FEET}, flight=True)
    trot = ContactSchedule({foot.name: [(0.0, 1.0), (1.2, INF)] for foot in FEET[:3]})
    for schedule in (jump, trot):
        assert WholeBodyController([POSTURE], FEET, schedule=schedule).schedule is schedule
    slow = WholeBodyController([POSTURE], every=0.02, limits=Limits(horizon=0.02))
    assert slow.every == 0.02 and WholeBodyController([POSTURE], every=0.02, limits=Limits(position=False, velocity=False))


def largest_force(controller: WholeBodyController, foot: str) -> float:
    """That the last step could have asked of a foot [N]: what it asked for, of a task that wants as much as there is."""
    return float(controller.actuation.contacts[foot].normal)


def test_a_contact_lost_for_an_instant_does_not_fade_in():
    """Nor one that carries a robot alone; one that was in the air for longer does, beside others."""
    standing, robot = SOLO.standing(), SOLO
    tasks = [POSTURE, *(ForceTask(foot.name, [0.0, 0.0, 30.0], cost=1e3) for foot in FEET)]
    controller = WholeBodyController(tasks, FEET, schedule=ContactSchedule({}, fade=0.04))

    def told(t: float, *lost: str) -> dict[str, float]:
        touches = {
            foot.name: ContactTouch(np.array([0.01 * (foot.name in lost)]), np.array([foot.name not in lost]), np.zeros((1, 3)))
            for foot in FEET
        }
        controller.accepted(AcceptedStep(standing, t, 1e-3, touches))
        return {name: largest_force(controller, name) for name in controller.actuation.contacts}

    start = told(0.0)
    assert len(start) == 4 and min(start.values()) > 5.0
    assert told(0.01, "front_left").keys() == {"front_right", "hind_left", "hind_right"}
    assert told(0.04, "front_left").keys() == {"front_right", "hind_left", "hind_right"}
    assert told(0.05)["front_left"] > 5.0  # lost at 0.01, for no longer than a fade
    told(0.1, "front_left")
    back = told(0.2)
    assert abs(back["front_left"]) < 1e-9 and back["hind_right"] > 5.0
    assert told(0.21)["front_left"] == pytest.approx(0.15625 * 12.0 * robot.mass, rel=1e-6)  # 3 x^2 - 2 x^3, x = 1/4
    assert told(0.25)["front_left"] > 5.0
    assert not told(0.3, *start)
    assert min(told(0.4).values()) > 5.0  # all at once, from the air


@pytest.mark.parametrize("flight", [False, True])
def test_a_foot_that_carries_alone_is_not_lifted(flight: bool):
    """The next one is late: it stays, without a fade, until that touches; not where the schedule has a flight."""
    first, second = FEET[0], FEET[3]
    intervals = {first.name: [(-INF, 0.3)], second.name: [(0.25, INF)]}
    controller = WholeBodyController([POSTURE], [first, second], schedule=ContactSchedule(intervals, fade=0.04, flight=flight))
    state, touches = SOLO.standing(), ContactTouch(np.zeros(1), np.ones(1, bool), np.zeros((1, 3)))
    away = ContactTouch(np.full(1, 0.01), np.zeros(1, bool), np.zeros((1, 3)))
    forces = []
    for k in range(50):
        t = 0.01 * k
        told = {first.name: touches, second.name: touches if t > 0.395 else away}
        controller.accepted(AcceptedStep(state, t, 1e-3, told))
        forces.append(largest_force(controller, first.name) if first.name in controller.actuation.contacts else 0.0)
    log, kinds = controller.log, controller.log.disagreements[first.name]
    assert (log.assumed[first.name] == (log.t < (0.295 if flight else 0.395))).all()
    assert (log.assumed[second.name] == (log.t > 0.395)).all() and log.disagreements[second.name] == {"late": 15}
    assert kinds.get("overdue", 0) == (0 if flight else 10) and kinds["unplanned"] == (16 if flight else 6)
    assert forces[29] == pytest.approx(forces[26] * (0.15625 if flight else 1.0), rel=1e-6) and forces[26] > 1.0


def test_contacts_that_all_fade_can_carry_the_robot():
    """Two pairs of feet that change at once: their bounds are scaled to the full force, 12 m/s2; in a flight they are not."""
    pairs = {"front_left": [(-INF, 0.3)], "hind_right": [(-INF, 0.3)], "front_right": [(0.26, INF)], "hind_left": [(0.26, INF)]}
    full = 12.0 * SOLO.mass
    for flight in (False, True):
        watch = ContactWatch(FEET, ContactSchedule(pairs, fade=0.04, flight=flight), 0.5)
        for t in (0.0, 0.1, 0.26, 0.27, 0.28, 0.29):
            step = AcceptedStep(SOLO.standing(), t, 1e-3, {})
            watch.see(step)
            most = {name: bound[1] for name, bound in watch.bounds(step, full, {"front_left": 4.0, "hind_right": 4.0}).items()}
            if t == 0.27:
                assert most["front_left"] == most["hind_right"] and most["front_right"] == most["hind_left"]
                rises, falls = 0.15625 * full, 0.84375 * 4.0
                assert most["hind_left"] / most["hind_right"] == pytest.approx(rises / falls, rel=1e-9)
                assert sum(most.values()) == pytest.approx(2.0 * (rises + falls) if flight else full, rel=1e-9)


def test_forces_of_contacts_that_are_not_counted_on_are_not_asked_for():
    """A ForceTask of a foot in the air, as a FrameTask of a foot that stands."""
    tasks = [POSTURE, ForceTask("front_left", [0.0, 0.0, 8.0], cost=10.0), FrameTask("HL_FOOT", np.zeros(3))]
    controller = WholeBodyController(tasks, FEET, schedule=ContactSchedule({"front_left": [(-INF, 0.1), (0.3, INF)]}, fade=0.0))
    for t in (0.0, 0.11):
        controller.accepted(AcceptedStep(SOLO.standing(), t, 1e-3, {}))
    missed = controller.log.missed
    assert np.isnan(missed["force of front_left"]).tolist() == [False, True] and np.isnan(missed["HL_FOOT"]).all()
    assert controller.log.assumed["front_left"].tolist() == [True, False]


def test_talos_steps_in_place(talos: rbd.Robot):
    """It lifts a foot by 2 cm and puts it down. With a fade torques change by little in a step; without, by the foot's load."""
    state, soles = talos.standing(), talos.soles(friction=0.7)
    points = [sole.rows(state).patch.point for sole in soles]
    foot = state.frame(soles[1].frame).X_WF
    up = lifted(foot.translation, 0.02, 0.6, 1.0, sinks=0.02)
    tasks = [
        ComTask(shifted(state.com, [0.0, 0.8 * (points[0] - state.com)[1], 0.0], 0.55), cost=100.0, gain=60.0),
        MomentumTask(angular_cost=0.02, gain=3.0),
        FrameTask("torso_2_link", state.frame("torso_2_link").X_WF.rotation, orientation_cost=10.0),
        PostureTask(state.q, cost=0.1, gain=40.0),
        FrameTask(soles[1].frame, foot.rotation, orientation_cost=20.0, gain=400.0, name="flat"),
        FrameTask(soles[1].frame, up, position_cost=100.0, gain=400.0),
    ]
    jumps = {}
    for fade in (0.06, 0.0):
        schedule = ContactSchedule({"right_sole": [(-INF, 0.6), (1.0, INF)]}, fade=fade)
        controller = WholeBodyController(tasks, talos.soles(friction=0.65), schedule=schedule)
        motion = rbd.simulate(state, soles, duration=1.15, step=2e-3, controller=controller, progress=False)
        z, log = heights(motion, soles[1]), controller.log
        assert z.max() == pytest.approx(0.02, abs=1e-3) and abs(z[-1]) < 1e-6 and log.violations == 0
        assert np.abs(heights(motion, soles[0])).max() < 1e-5
        landed = motion.t[log.assumed["right_sole"] & (motion.t > 0.8)][0]
        assert 0.98 < landed < 1.06
        change = np.abs(np.diff(motion.tau, axis=0)).max(axis=1)
        jumps[fade] = [
            float(change[(motion.t[1:] > a) & (motion.t[1:] < b)].max()) for a, b in ((0.5, 0.64), (landed - 1e-3, 1.2))
        ]
        kinds = {kind for contact in log.disagreements.values() for kind in contact}  # corners unload where the weight shifts
        assert kinds <= {"late", "partial", "slips"} and log.disagreements["right_sole"]["late"] <= 30
    assert jumps[0.06][0] < 2.5 and jumps[0.0][0] > 4.0 * jumps[0.06][0], jumps  # N m a step
    assert jumps[0.06][1] < 8.0 and jumps[0.0][1] > 4.0 * jumps[0.06][1], jumps


@pytest.mark.parametrize("integrator", [rbd.DormandPrince8(), rbd.RungeKutta4()])
def test_it_computes_at_its_own_rate(integrator: Any):
    """Each 10 ms, held in between, also where steps have lengths of their own."""
    arm = rbd.load_robot("ur5", root="fixed")
    state = arm.at([0.2, -1.2, 1.5, -0.4, 0.3, 0.1])
    bent = state.q + 0.05
    controller = WholeBodyController([PostureTask(bent, gain=200.0)], every=0.01)
    motion = rbd.simulate(state, duration=0.1, step=2e-3, controller=controller, integrator=integrator, progress=False)
    assert np.abs(controller.log.t - 0.01 * np.arange(11)).max() < 1e-9
    held = motion.tau[:-1].reshape(10, 5, arm.nu)
    assert (held == held[:, :1]).all() and (np.diff(held[:, 0], axis=0) != 0.0).any(axis=1).all()
