"""Controllers that compute with another model than the robot's, and contacts that a motion has switched off."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import HoldPosture, PostureTask, TrackingController, WholeBodyController
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.simulation import StateEvent, Switch

LOAD = 10.0
"""Mass on the trunk that the nominal model lacks [kg]."""


def loaded(robot: rbd.Robot) -> CheckedModel:
    """The robot with a load on its base."""
    model = robot.model.copy()
    model.inertias[1] = model.inertias[1] + pin.Inertia(LOAD, np.zeros(3), 1e-3 * np.eye(3))
    return CheckedModel(model, name="loaded")


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def carried(robot: CheckedModel, state: rbd.State, controller: object, feet: list[rbd.PointContact]) -> rbd.Trajectory:
    """A tenth of a second."""
    return rbd.simulate(state.on(robot), feet, duration=0.1, step=1e-3, controller=controller, progress=False)


def test_a_whole_body_controller_of_the_nominal_robot_does_not_know_the_load(solo: rbd.Robot) -> None:
    """With the simulated model it carries the load; with the nominal one its torques lack it, and it sinks."""
    state, feet, heavy = solo.standing(), solo.feet(friction=0.8), loaded(solo)
    tasks = [PostureTask(state.q)]
    knowing, nominal = WholeBodyController(tasks, feet), WholeBodyController(tasks, feet, robot=solo)
    first, second = (carried(heavy, state, controller, feet) for controller in (knowing, nominal))
    assert np.abs(first.q - first.q[0]).max() < 1e-6
    # At the first step the torques are those of the nominal robot, to the bit; the load falls as these leave it.
    alone = WholeBodyController(tasks, feet)
    assert np.array_equal(second.tau[0], carried(solo, state, alone, feet).tau[0])
    assert np.abs(first.tau[0] - second.tau[0]).max() > 0.2 * np.abs(second.tau[0]).max()
    assert second.q[-1, 2] < second.q[0, 2] - 1e-3


def test_a_tracking_controller_of_the_nominal_robot_lags_behind_with_a_load(solo: rbd.Robot) -> None:
    """Its torques are those for the nominal robot; told the load, it follows. Without `robot=` another robot is refused."""
    stand, feet, heavy = solo.standing(), solo.feet(friction=0.8), loaded(solo)
    motion = rbd.motion.minimum_jerk(solo, [stand.q, stand.q], [0.0, 0.1], rate=100.0)
    settings = {"contacts": feet, "frequency": 15.0}
    nominal, knowing = (TrackingController(motion, robot=model, **settings) for model in (solo, heavy))
    lags = [np.abs(carried(heavy, stand, controller, feet).q[-1] - stand.q).max() for controller in (nominal, knowing)]
    assert lags[1] < 1e-5 < 1e-3 < lags[0]
    assert np.array_equal(nominal.reference.tau, TrackingController(motion, **settings).reference.tau)
    with pytest.raises(InputError, match="give it: TrackingController"):
        carried(heavy, stand, TrackingController(motion, **settings), feet)


def test_a_model_with_other_joints_is_refused(solo: rbd.Robot) -> None:
    """With the first joint that differs; and what is no robot."""
    bolt, stand = rbd.load_robot("bolt"), solo.standing()
    controller = WholeBodyController([PostureTask(stand.q)], solo.feet(friction=0.8), robot=bolt)
    with pytest.raises(InputError, match="solo12 and bolt have different joints or motors: 'HL_HAA' in place of 'FL_HAA'"):
        controller.accepted(rbd.control.AcceptedStep(stand, 0.0, 1e-3, {}))
    motion = rbd.motion.minimum_jerk(solo, [stand.q, stand.q], [0.0, 0.1], rate=100.0)
    with pytest.raises(InputError, match="different joints"):
        TrackingController(motion, solo.feet(), robot=bolt)
    with pytest.raises(InputError, match="expected a robot"):
        WholeBodyController([PostureTask(stand.q)], robot="bolt")
    with pytest.raises(InputError, match="expected a robot"):
        TrackingController(motion, robot=3)
    assert stand.on(solo) is stand


class Watching:
    """Notes what is told of steps."""

    def __init__(self) -> None:
        self.off: list[frozenset[str]] = []

    def accepted(self, step: rbd.control.AcceptedStep) -> None:
        """What is off."""
        self.off.append(step.inactive)

    def __call__(self, state: rbd.State, t: float) -> np.ndarray:
        """No torques."""
        return np.zeros(state.robot.nu)


def switched(state: rbd.State, feet: list[rbd.PointContact], controller: object) -> rbd.Trajectory:
    """A motion in which the first foot is off from the start, and the second from 5 ms on."""
    event = StateEvent(lambda s, t: t - 5e-3, "second off", then=Switch(off=feet[1].name))
    return rbd.simulate(
        state, feet, duration=0.01, step=1e-3, controller=controller, events=[event], inactive=feet[0].name, progress=False,
        may_sink=True,
    )  # fmt: skip


def test_what_is_switched_off_is_told_to_controllers(solo: rbd.Robot) -> None:
    """From the start, and from the event on."""
    feet, seen = solo.feet(friction=0.8), Watching()
    switched(solo.standing(), feet, seen)
    assert {feet[0].name} == seen.off[0] and {feet[0].name, feet[1].name} == seen.off[-1]
    assert all(a <= b for a, b in zip(seen.off, seen.off[1:], strict=False))


def test_what_is_switched_off_does_not_touch(solo: rbd.Robot) -> None:
    """A whole-body controller does not count on a foot that is off though it is on the ground: its log says late."""
    state, feet = solo.standing(), solo.feet(friction=0.8)
    controller = WholeBodyController([PostureTask(state.q)], feet)
    switched(state, feet, controller)
    assert feet[0].name not in controller.actuation.contacts and feet[1].name not in controller.actuation.contacts
    assert {feet[2].name, feet[3].name} == set(controller.actuation.contacts)


@pytest.mark.parametrize("tracks", [False, True])
def test_gains_are_those_without_what_is_switched_off(solo: rbd.Robot, tracks: bool) -> None:
    """The torques of a posture that is left, where a foot on the ground is off, are those of a foot in the air."""
    state, feet = solo.standing(), solo.feet(friction=0.8)
    still = rbd.motion.minimum_jerk(solo, [state.q, state.q], [0.0, 0.1], rate=100.0)
    make = (lambda c: TrackingController(still, c, torques="none")) if tracks else (lambda c: HoldPosture(state, c))
    controller, without = make(feet), make(feet[1:])
    pushed = rbd.State(solo, state.q, np.r_[np.zeros(6), 0.1 * np.ones(12)])
    all_on = controller(pushed, 0.0)
    controller.accepted(rbd.control.AcceptedStep(pushed, 0.0, 1e-3, {}, frozenset([feet[0].name])))
    off = controller(pushed, 0.0)
    controller.reset()
    assert np.array_equal(controller(pushed, 0.0), all_on)
    if tracks:
        assert np.abs(off - without(pushed, 0.0)).max() < 1e-9 < 1e-3 < np.abs(off - all_on).max()
    else:
        assert np.abs(off - all_on).max() > 1e-3
