"""Springs and dampers on a robot under whole-body control: the torques take them into account, or do not know of them."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.control import ComTask, PostureTask, WholeBodyController


@pytest.fixture(scope="module")
def stand(talos: rbd.Robot) -> rbd.State:
    return talos.standing()


@pytest.fixture(scope="module")
def springs(talos: rbd.Robot, stand: rbd.State) -> list[object]:
    hand = stand.frame("gripper_left_base_link").X_WF.translation
    return [
        rbd.Spring("gripper_left_base_link", to=hand + [0.2, 0.3, 0.8], stiffness=60.0, rest=0.3),
        rbd.JointDamping(dict.fromkeys(talos.actuated_names, 2.0)),
    ]


def tasks_of(stand: rbd.State) -> list[object]:
    return [ComTask(stand.com, cost=100.0, gain=60.0), PostureTask(stand.q, cost=1.0, gain=40.0)]


def test_a_step_of_control_carries_a_spring(talos: rbd.Robot, stand: rbd.State, springs: list[object]) -> None:
    """The motion that the torques make under the spring is the one that control found."""
    soles = talos.soles(friction=0.7)
    found = rbd.control.step(stand, tasks_of(stand), soles, external=springs)
    moved = rbd.solve(stand, found.tau, soles, external=springs)
    assert np.abs(moved.a - found.a).max() < 1e-8
    without = rbd.control.step(stand, tasks_of(stand), soles)
    assert np.abs(found.tau - without.tau).max() > 1.0


def test_a_controller_that_knows_a_spring_does_not_sag(talos: rbd.Robot, stand: rbd.State, springs: list[object]) -> None:
    """Without knowing it, the hand is pulled aside until the posture's gain balances the spring."""
    soles, sag = talos.soles(friction=0.7), {}
    for name, known in (("knows", springs), ("asks", lambda state, t: springs), ("does not know", None)):
        controller = WholeBodyController(tasks_of(stand), soles, external=known)
        run = rbd.simulate(stand, soles, duration=0.1, step=2e-3, controller=controller, external=springs)
        sag[name] = float(np.abs(run.q[-1] - stand.q).max())
        assert run.residuals["law"].max() < 1e-9
    assert sag["knows"] < 1e-7 and sag["asks"] == sag["knows"] and sag["does not know"] > 1e-3
