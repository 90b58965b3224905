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
    ContactTouch,
    FrameTask,
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
    assert log.disagreements == {"hind_left": {"unplanned": 5, "early": 10}}  # after the fade: 0.15 to 0.19, 0.2 to 0.29
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
