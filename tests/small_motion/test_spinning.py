"""Small motion of what spins and of what rests on moving ground, and what is refused: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flat_bodies import ball

import rbd
from rbd.mechanism.small_motion.tangent_space import spin_axes


@pytest.mark.parametrize("rate", [0.0, 20.0, 40.0])
def test_a_sleeping_top_is_stable_above_lagranges_rate(rate: float):
    """Growth sqrt(4 A m g l - C^2 w^2) / (2 A) on a ball joint, none above w = 2 sqrt(A m g l) / C."""
    b = rbd.RobotBuilder("top", root="fixed")
    b.body("body", mass=1.0, com=(0.0, 0.0, 0.2), inertia=(0.01, 0.01, 0.02))
    b.joint("tip", "ground", "body", "ball")
    top = b.robot()
    A, C, moment = 0.01 + 0.04, 0.02, 9.81 * 0.2
    small = rbd.linearise(top.at(None, [0.0, 0.0, rate]))
    inside = 4.0 * A * moment - (C * rate) ** 2
    assert abs(small.eigenvalues.real.max() - math.sqrt(max(inside, 0.0)) / (2.0 * A)) < 1e-9
    assert small.stable is (False if inside > 0.0 else None)
    if inside < 0.0:  # precession and nutation, seen from the spinning body
        turning = (C * rate + np.array([1.0, -1.0]) * math.sqrt(-inside)) / (2.0 * A) - rate
        found = [2.0 * math.pi * mode.frequency for mode in small.modes() if mode.frequency]
        assert np.allclose(np.sort(found), np.sort(np.abs(turning)), rtol=1e-9)


@pytest.mark.parametrize("spin", [0.0, 1.0, 0.3])
def test_a_ball_on_a_turntable_circles_at_two_sevenths_of_its_rate(spin: float):
    """Whatever the ball spins at; in its own axes the rate is less by the spin."""
    solid, rate = ball(2.0, 0.1), 1.0
    disc = rbd.Ground(point=(0, 0, 0), velocity=(0, 0, 0, 0, 0, rate))
    rolls = rbd.RollingBall("rolls", "body", radius=0.1, on=disc)
    state = rbd.State(solid, [0, 0, 0.1, 0, 0, 0, 1], [0, 0, 0, 0, 0, spin])
    small = rbd.linearise(state, [rolls])
    assert np.abs(small.eigenvalues.imag - abs(2.0 / 7.0 * rate - spin)).min() < 1e-10
    assert small.stable is None and small.difference < 1e-10


def test_a_singular_configuration_is_refused():
    """Where two branches of a square four-bar meet there is no one linear motion."""
    square = rbd.mechanism.four_bar(1.0, 1.0, 1.0, 1.0, crank_angle=1.0)
    flat = rbd.mechanism.assemble(square.at("assembled"), fixed={"crank_joint": 0.0})
    weightless = square.with_gravity((0.0, 0.0, 0.0))
    with pytest.raises(rbd.errors.NotDifferentiable):
        rbd.linearise(weightless.at(flat.q))


def test_edges_without_freedom_have_no_modes():
    """A joint that is locked, pressed on its stop, or held by dry friction."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    (joint,) = arm.actuated_names
    stop, lock = rbd.JointLimit("stop", joint, lower=-1.4), rbd.JointLock("lock", joint)
    for held in (stop, lock):
        small = rbd.linearise(arm.at([-1.4]), [held])
        assert small.n == 0 and small.modes() == () and small.verdict.startswith("No mode")
    rubbed = rbd.linearise(arm.at([-1.4]), [rbd.JointFriction("rubs", joint, 3.0)])
    assert (rubbed.n, rubbed.symmetries.shape) == (1, (1, 1))
    with pytest.raises(rbd.errors.Unsupported, match="'rubs' yields"):
        rbd.linearise(arm.at([-1.0]), [rbd.JointFriction("rubs", joint, 1.0)])


@pytest.mark.parametrize(
    ("inertia", "axes"),
    [((0.1, 0.01, 0.1), [1]), ((0.1, 0.1, 0.19), [2]), ((0.1, 0.1, 0.1), [0, 1, 2]), ((0.1, 0.11, 0.12), [])],
    ids=["rod", "disk", "ball", "brick"],
)
def test_a_body_of_revolution_spins_about_its_own_axis(inertia: tuple[float, float, float], axes: list[int]) -> None:
    """About the line through its centre of mass, of whatever of its moments are equal: the longest axis of a rod."""
    builder = rbd.RobotBuilder("body", root="free_flyer")
    builder.body("body", mass=1.0, com=(0.1, 0.2, 0.3), inertia=inertia)
    found = spin_axes(builder.robot())
    assert found.shape == (6, len(axes))
    for column in found.T:
        axis = np.abs(column[3:])
        assert np.allclose(column[:3], np.cross([0.1, 0.2, 0.3], column[3:])) and axis.max() == pytest.approx(1.0)
    assert sorted(int(np.argmax(np.abs(column[3:]))) for column in found.T) == axes
