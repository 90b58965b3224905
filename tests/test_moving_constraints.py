"""Bilateral constraints with a velocity: `solve` says that they move on, as only their accelerations are prescribed."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rbd
from rbd.errors import MovingConstraintWarning

pytestmark = pytest.mark.filterwarnings("error::rbd.errors.MovingConstraintWarning")


def turning(robot: rbd.Robot, rate: float) -> rbd.State:
    """An arm that turns its elbow [rad/s]."""
    v = np.zeros(robot.nv)
    v[2] = rate
    return robot.at().with_velocity(v)


def test_a_lock_that_turns_is_said() -> None:
    """With its velocity; its joint keeps it, as the answer has no acceleration there. Baumgarte's feedback takes it away."""
    arm = rbd.load_robot("ur5", root="fixed")
    lock = rbd.JointLock("lock", "elbow_joint")
    with pytest.warns(MovingConstraintWarning, match="of ur5.* move: 'lock' at 4 m/s or rad/s.*project_velocity"):
        solution = rbd.solve(turning(arm, 4.0), np.zeros(6), [lock])
    assert abs(solution.a[2]) < 1e-9
    rbd.solve(turning(arm, 4.0), np.zeros(6), [lock], rest_speed=5.0)
    rbd.solve(arm.at(), np.zeros(6), [lock])
    rbd.solve(turning(arm, 4.0), np.zeros(6), [rbd.constraints.Baumgarte(10.0).of(lock)])


@pytest.mark.parametrize("bilateral", [True, False])
def test_soles_that_move_are_said_in_the_prepared_form(talos: rbd.Robot, bilateral: bool) -> None:
    """Of two soles the one that moves, alone or beside one that can slip; not after projection."""
    standing = talos.standing()
    left, right = talos.soles(friction=None)
    both = [left, right if bilateral else talos.soles(friction=0.8)[1]]
    v = np.zeros(talos.nv)
    knee = talos.joints["leg_left_4_joint"].v
    v[knee] = 0.5
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", MovingConstraintWarning)
        with pytest.warns(MovingConstraintWarning, match="'left_sole' at 0.[0-9]+ m/s") as told:
            found = rbd.solve(standing.with_velocity(v), np.zeros(talos.nu), both)
        assert "right_sole" not in str(told[0].message)
        still = rbd.mechanism.project_velocity(standing.with_velocity(v), [left, right])
        again = rbd.solve(still, np.zeros(talos.nu), both)
    if bilateral:
        assert found.solver == again.solver == "ContactDynamics"


def test_on_moving_ground_they_are_at_rest() -> None:
    """A box that rides on a belt, held to it; and one held to ground that does not move."""
    box = rbd.testing.box()
    riding = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
    rbd.solve(riding, [], [rbd.PointContact("held", "box", on=rbd.Ground(velocity=(1.0, 0.0, 0.0)))])
    with pytest.warns(MovingConstraintWarning, match="'held' at 1 m/s"):
        rbd.solve(riding, [], [rbd.PointContact("held", "box")])


@pytest.mark.parametrize("loose", [False, True])
def test_many_states_say_which(talos: rbd.Robot, loose: bool) -> None:
    """In blocks and one at a time: the same states."""
    standing, soles = talos.standing(), list(talos.soles(friction=None))
    constraints = [*soles, rbd.JointLock("lock", "torso_1_joint")] if loose else soles
    v = np.zeros((4, talos.nv))
    v[1, talos.joints["leg_left_4_joint"].v] = 0.5
    v[3, talos.joints["arm_left_1_joint"].v] = 0.5  # moves no sole
    with pytest.warns(MovingConstraintWarning, match="a bilateral constraint moves at 1 of 4 states of talos"):
        found = rbd.solve_many(talos, np.tile(standing.q, (4, 1)), v, np.zeros(talos.nu), constraints)
    assert found.warned["a bilateral constraint moves"].tolist() == [False, True, False, False]
