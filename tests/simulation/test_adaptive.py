"""DormandPrince8: energy, agreement with fixed steps, dense output, tolerances."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import chain as side_by_side
from smooth_models import chain, off, swinging

import rbd


@pytest.mark.parametrize("name", ["double pendulum", "ur5"])
def test_energy_stays_to_one_part_in_a_thousand_millions(name):
    """Ten seconds, released: within 1e-9 of the peak kinetic energy."""
    if name == "ur5":
        robot = rbd.load_robot("ur5", root="fixed")
        start = rbd.State(robot, pin.neutral(robot.model))
    else:
        start = rbd.State(chain(2, com=0.5, inertia=1.0 / 12.0), np.zeros(2))
    found = rbd.simulate(start, duration=10.0, step=0.05, integrator=rbd.DormandPrince8(), progress=False)
    assert np.abs(found.energy - found.energy[0]).max() <= 1e-9 * found.kinetic.max()


def test_moments_between_steps_are_as_good_as_the_steps():
    """Dense output on the constraints: every recorded moment of a four-bar is on a run with far smaller tolerances."""
    robot = rbd.mechanism.four_bar(40, 120, 80, 100)
    start = swinging(robot, "assembled", 4.0)
    coarse, fine = (
        rbd.simulate(start, robot.loops(), duration=0.5, step=2e-3, integrator=by, progress=False)
        for by in (rbd.DormandPrince8(rtol=1e-8, atol=1e-10), rbd.DormandPrince8(rtol=1e-13, atol=1e-14, longest=5e-3))
    )
    assert max(off(coarse.state(i), fine.state(i)) for i in range(len(fine))) < 1e-6
    assert coarse.residuals["drift"].max() < 1e-9  # of bars of 100 m


def test_smaller_tolerances_give_smaller_errors():
    """On a spinning free body, whose orientation is no vector."""
    robot = rbd.load_robot("solo12")
    start = rbd.State(robot, robot.standing().q, np.linspace(-3.0, 3.0, robot.nv))
    by = [rbd.DormandPrince8(rtol=r, atol=r, longest=1.0) for r in (1e-13, 1e-9, 1e-6, 1e-3)]
    ends = [rbd.simulate(start, duration=0.3, step=0.3, integrator=b, progress=False).state(-1) for b in by]
    errors = [off(ends[0], end) for end in ends[1:]]
    assert errors[0] < 1e-7
    assert errors[0] < errors[1] < errors[2]


def test_a_short_push_is_not_stepped_over():
    """A robot at rest, pushed for 0.1 s after 0.5 s: steps are never longer than `longest`."""
    robot = chain(1)
    robot.model.gravity.linear = np.zeros(3)
    found = rbd.simulate(
        rbd.State(robot, np.zeros(1)), duration=1.0, step=0.5, integrator=rbd.DormandPrince8(rtol=1e-8, atol=1e-8),
        progress=False, controller=lambda state, t: np.array([1.0 if 0.5 <= t < 0.6 else 0.0]),
    )  # fmt: skip
    assert abs(found.v[-1, 0] - 0.1) < 1e-5


@pytest.mark.parametrize("given", [{"rtol": 0.0}, {"rtol": 1e-15}, {"atol": -1.0}, {"longest": 0.0}, {"rtol": True}])
def test_settings_that_are_none_are_refused(given):
    """With what was expected."""
    with pytest.raises(rbd.errors.InputError, match="expected"):
        rbd.DormandPrince8(**given)


class _Wall:
    """Keeps the second of two masses still, and asks for two accelerations of it where the first is beyond 1 m."""

    name = "wall"

    def __init__(self):
        self.seen = 0

    def rows(self, state):
        beyond = bool(state.q[0] > 1.0)
        self.seen += beyond
        return rbd.Rows(self.name, np.array([[0.0, 1.0], [0.0, 1.0]]), np.array([0.0, 10.0 * beyond]), rbd.problem.Free(2))


def _swings_to(amplitude, wall, **settings):
    """An oscillator x'' = -x from rest at minus the amplitude."""
    joints = [(name, joint, 1.0, [1.0] * 3) for name, joint in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()))]
    start = rbd.State(side_by_side(joints, names=("a", "b"), name="two"), np.array([-amplitude, 0.0]))
    return rbd.simulate(
        start, [wall], duration=6.0, step=0.5, integrator=rbd.DormandPrince8(longest=np.inf, **settings), progress=False,
        external=lambda state, t: np.array([-state.q[0], 0.0]),
    )  # fmt: skip


def test_a_trial_that_has_no_acceleration_is_tried_shorter():
    """Stages of a long step guess beyond a wall that the motion itself does not reach: it is -A cos t all the same."""
    wall = _Wall()
    found = _swings_to(0.999, wall, rtol=1e-4, atol=1e-4)
    assert wall.seen > 0
    assert found.q[:, 0].max() < 1.0
    assert np.abs(found.q[:, 0] + 0.999 * np.cos(found.t)).max() < 1e-3


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_where_no_step_has_an_acceleration_it_stops_at_that_time(rtol):
    """A = 1.1 m reaches the wall at t = arccos(-1 / 1.1), and the error of the shortest step says so."""
    with pytest.raises(
        rbd.errors.SimulationStopped, match="no acceleration satisfies .* at t = ([0-9.]+) s: 'wall' misses 5"
    ) as told:
        _swings_to(1.1, _Wall(), rtol=rtol, atol=rtol)
    at = float(str(told.value).split("at t = ")[1].split(" s")[0])
    assert abs(at - np.arccos(-1.0 / 1.1)) < max(10.0 * rtol, 5e-6)  # it is told to six digits
    assert told.value.t == 2.5


def test_a_jump_that_no_step_gets_over_is_told():
    """Pushed by 1 N into a barrier that pushes back with 1e8 N from 1 m on: at sqrt(2) s steps shrink to nothing."""
    robot = side_by_side([("x", pin.JointModelPX(), 1.0, [1.0] * 3)], names=("a",), name="one")
    with pytest.raises(
        rbd.errors.SimulationStopped, match=r"no step is short enough at t = 1.41421 s for rtol 1e-10 .*a jump in the"
    ):
        rbd.simulate(
            rbd.State(robot, np.zeros(1)), duration=2.0, step=0.1, integrator=rbd.DormandPrince8(), progress=False,
            external=lambda state, t: np.array([1.0 - 1e8 * (state.q[0] > 1.0)]),
        )  # fmt: skip
