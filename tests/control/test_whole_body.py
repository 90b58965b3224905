"""The whole-body controller in simulations: contacts that come and go, forces that fade, and what is told about it."""

from __future__ import annotations

import math
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
    FrameTask,
    MomentumTask,
    PostureTask,
    Reference,
    WholeBodyController,
)

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
    """A point that goes up and down, z = height sin^2, from one time to another; then it sinks until it touches."""
    w = math.pi / (end - begin)

    def at(t: float) -> Reference:
        up = np.array([0.0, 0.0, 1.0])
        if t > end:
            return Reference(start - sinks * (t - end) * up, -sinks * up)
        x = w * max(t - begin, 0.0)
        z, v, a = math.sin(x) ** 2, w * math.sin(2 * x), 2 * w * w * math.cos(2 * x) * (x > 0.0)
        return Reference(start + height * z * up, height * v * up, height * a * up)

    return at


class Quadruped:
    """Solo12 that moves its weight off its left hind foot, lifts it by 2 cm, and puts it down."""

    begin, end = 0.3, 0.5

    def __init__(self) -> None:
        self.robot = rbd.load_robot("solo12")
        self.state = self.robot.standing()
        self.feet = self.robot.feet(friction=0.7)
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


def heights(trajectory: rbd.Trajectory, frame: str) -> np.ndarray:
    """Of a frame over time [m]."""
    robot = trajectory.robot
    return np.array([rbd.State(robot, q).frame(frame).X_WF.translation[2] for q in trajectory.q])


@pytest.fixture(scope="module")
def step_on_three_legs(quadruped: Quadruped) -> tuple[WholeBodyController, rbd.Trajectory]:
    """A lifted foot, and back."""
    controller = quadruped.controller()
    return controller, quadruped.run(controller)


def test_a_foot_is_lifted_and_put_down(quadruped: Quadruped, step_on_three_legs: tuple[WholeBodyController, rbd.Trajectory]):
    """By its swing task, which is left out where the foot stands; the others keep still."""
    controller, motion = step_on_three_legs
    z = heights(motion, "HL_FOOT") - quadruped.foot[2]
    assert z.max() == pytest.approx(0.02, abs=5e-4)
    assert abs(z[-1]) < 1e-5
    log = controller.log
    swing, missed = (log.t >= 0.3) & (log.t < 0.5), log.missed["HL_FOOT"]
    assert np.isnan(missed[log.assumed["hind_left"]]).all() and not np.isnan(missed[swing]).any()
    assert (~log.planned["hind_left"] == swing).all()
    assert not log.assumed["hind_left"][swing].any() and log.assumed["hind_left"][-1] and log.assumed["hind_left"][0]
    for foot in ("front_left", "front_right", "hind_right"):
        assert log.assumed[foot].all() and log.touching[foot].all()
    for frame in ("FL_FOOT", "FR_FOOT", "HR_FOOT"):
        assert abs(heights(motion, frame) - heights(motion, frame)[0]).max() < 1e-6
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
    assert heights(runs[0], "HL_FOOT").max() > quadruped.foot[2] + 0.018


def test_a_foot_that_lands_early_is_taken_as_a_contact(quadruped: Quadruped):
    """Its swing ends 60 ms before its contact is planned."""
    controller = quadruped.controller(lands=0.44)
    quadruped.run(controller)
    log = controller.log
    early = log.disagreements["hind_left"]["early"]
    assert 20 <= early <= 32 and 0.43 < log.first["hind_left", "early"] < 0.46
    assert log.assumed["hind_left"][log.t > 0.46].all() and "late" not in log.disagreements["hind_left"]
    assert "touches before it is planned, and is taken as a contact" in str(controller)
    z = heights(quadruped.run(quadruped.controller(lands=0.44)), "HL_FOOT")
    assert abs(z[-1] - quadruped.foot[2]) < 1e-5


def test_a_foot_that_touches_at_the_start_of_its_swing_has_not_landed(quadruped: Quadruped):
    """A foot that is never lifted touches unplanned, until half of its swing has passed; then it has landed."""
    tasks = [ComTask(quadruped.com, cost=100.0), PostureTask(quadruped.state.q, cost=0.1, gain=50.0)]
    schedule = ContactSchedule({"hind_left": [(-INF, 0.1), (0.3, INF)]}, fade=0.04)
    controller = WholeBodyController(tasks, quadruped.robot.feet(friction=0.6), schedule=schedule)
    for k in range(31):
        controller.accepted(AcceptedStep(quadruped.state, 0.01 * k, 0.01, {}))
    log = controller.log
    assert log.disagreements == {"hind_left": {"unplanned": 5, "early": 10}}  # after the fade: 0.15 to 0.19, 0.2 to 0.29
    assert (log.assumed["hind_left"] == ~((log.t > 0.095) & (log.t < 0.195))).all()


def test_a_late_foot_goes_on_with_its_swing(quadruped: Quadruped):
    """It sinks at 0.05 m/s from when it was planned to touch, until it does; then its force fades in."""
    late = quadruped.controller(schedule=ContactSchedule({"hind_left": [(-INF, 0.3), (0.45, INF)]}, fade=0.04), lands=0.5)
    motion = quadruped.run(late)
    log = late.log
    assert 20 <= log.disagreements["hind_left"]["late"] <= 40
    touches = log.t[log.assumed["hind_left"] & (log.t > 0.4)][0]
    assert 0.49 < touches < 0.53 and abs(heights(motion, "HL_FOOT")[-1] - quadruped.foot[2]) < 1e-5
    assert "planned, and does not touch" in str(late)


def test_what_touches_unplanned_is_named(quadruped: Quadruped):
    """The shank's collision shapes reach the ground that rises under a wall of the simulation; feet are no disagreement."""
    shapes = rbd.CollisionContacts("floor", quadruped.robot, friction=0.7)
    controller = quadruped.controller()
    quadruped.run(controller, 0.02, constraints=[*quadruped.feet, shapes])
    assert not controller.log.disagreements  # the shapes of feet whose own contacts are planned
    only = WholeBodyController(
        [PostureTask(quadruped.state.q)],
        [foot for foot in quadruped.robot.feet(friction=0.6) if foot.name != "front_left"],
    )
    quadruped.run(only, 0.01, constraints=quadruped.feet)
    assert only.log.disagreements == {"front_left": {"unplanned": 6}}
    assert "front_left: touches, and is not planned, in 6 steps, first at t = 0 s" in str(only)
    quadruped.run(only, 0.01, constraints=[*only.contacts, shapes])
    assert len(only.log.disagreements) == 1 and next(iter(only.log.disagreements)).startswith("floor: FL_")


def test_torques_do_not_jump_where_a_foot_is_lifted(talos: rbd.Robot):
    """Talos moves from two feet to one: with a fade, torques change by little in a step; without, by the foot's load."""
    state, soles = talos.standing(), talos.soles(friction=0.7)
    points = [sole.rows(state).patch.point for sole in soles]
    foot = state.frame(soles[1].frame).X_WF
    up = lifted(foot.translation, 0.02, 0.6, 1.0)
    tasks = [
        ComTask(shifted(state.com, [0.0, 0.97 * (points[0] - state.com)[1], 0.0], 0.55), cost=100.0, gain=60.0),
        MomentumTask(angular_cost=0.02, gain=3.0),
        FrameTask("torso_2_link", state.frame("torso_2_link").X_WF.rotation, orientation_cost=10.0),
        PostureTask(state.q, cost=0.1, gain=40.0),
        FrameTask(soles[1].frame, up, position_cost=100.0, gain=400.0),
    ]
    jumps, loads = {}, {}
    for fade in (0.06, 0.0):
        schedule = ContactSchedule({"right_sole": [(-INF, 0.6), (1.0, INF)]}, fade=fade)
        controller = WholeBodyController(tasks, talos.soles(friction=0.65), schedule=schedule)
        motion = rbd.simulate(state, soles, duration=0.66, step=2e-3, controller=controller, progress=False)
        assert heights(motion, soles[1].frame)[-1] > 5e-4 and controller.log.violations == 0
        near = (motion.t > 0.5) & (motion.t < 0.64)
        jumps[fade] = float(np.abs(np.diff(motion.tau[near], axis=0)).max())
        loads[fade] = motion.forces["right_sole"][motion.t < 0.5995][-1][2]
    assert jumps[0.06] < 4.0 and jumps[0.0] > 15.0, jumps  # N m a step
    assert loads[0.06] < 0.1 * loads[0.0]
