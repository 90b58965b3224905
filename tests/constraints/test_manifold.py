"""Bilateral constraints stacked: rows, ranks, null space, projection."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.constraints.descent import descend
from rbd.constraints.manifold import CLOSED, ConstraintManifold, null_space, own_or, poses_nearby, rank_of


@pytest.fixture(scope="module")
def four_bar() -> rbd.Robot:
    """Crank 0.4 m, coupler 1.2 m, rocker 0.8 m, ground 1 m."""
    return rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)


def scaled_four_bar(length: float) -> rbd.Robot:
    """The same in another unit of length."""
    return rbd.mechanism.four_bar(0.4 * length, 1.2 * length, 0.8 * length, 1.0 * length, crank_angle=0.7)


def test_rows_stand_below_each_other(talos: rbd.Robot):
    """J, bias, velocity and error of two soles are those of each, in order; each row knows whose it is."""
    rng = np.random.default_rng(0)
    state, soles = talos.standing(), talos.soles(friction=None)
    manifold = ConstraintManifold(state, soles)
    moved = rbd.State(talos, state.q, 0.1 * rng.normal(size=talos.nv))
    stack, each = manifold.rows(moved), [c.rows(moved) for c in manifold.constraints]
    for what in ("J", "bias", "velocity", "error"):
        assert np.array_equal(getattr(stack, what), np.concatenate([getattr(r, what) for r in each]))
    assert manifold.names == tuple(stack.names) == tuple((s.name, i) for s in soles for i in range(6))
    assert stack.name_of(6) == soles[1].name and stack.drift == 0.0 and manifold.m == 12 and manifold.n == talos.nv


def test_velocities_of_the_null_space_break_no_row(four_bar: rbd.Robot):
    """Of a four-bar it has one dimension; along it the errors grow with the square of the way."""
    manifold = ConstraintManifold(four_bar.at("assembled"))
    at = manifold.check_assembled()
    N, s = null_space(at.J)
    assert N.shape == (3, 1) and len(s) == 2 and manifold.rank(at.J) == 2
    assert np.abs(at.J @ N).max() < 1e-14
    errors = [np.abs(manifold.at(manifold.move(at.q, h * N[:, 0])).error).max() for h in (1e-3, 1e-4)]
    assert errors[0] / errors[1] == pytest.approx(100.0, rel=0.01)


def test_what_is_projected_is_on_the_constraints(four_bar: rbd.Robot):
    """From a tenth of a radian off, to rounding; what is on them already stays where it is."""
    state = four_bar.at("assembled")
    manifold = ConstraintManifold(state)
    off = manifold.move(state.q, np.array([0.0, 0.1, -0.05]))
    found = manifold.project(off)
    assert np.abs(manifold.at(off).error).max() > 1e-2 and np.abs(found.error).max() < 1e-14
    assert np.linalg.norm(manifold.way(off, found.q)) < 0.2
    assert np.array_equal(manifold.project(found.q).q, found.q)
    with pytest.raises(rbd.InputError, match="is not assembled: row 1 of 'coupler_pin' is off by 0.154"):
        ConstraintManifold(rbd.State(four_bar, off)).check_assembled()


@pytest.mark.parametrize("away", [3.0, 1e3])
def test_a_body_far_from_its_pin_comes_back_in_few_steps(away: float):
    """Translations may be as long as the error: it is not a walk in steps of half the robot's length."""
    body = rbd.testing.box()
    at = rbd.State(body, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    manifold = ConstraintManifold(at, [rbd.PointContact("pin", "box", offset=(0.1, 0.2, 0.3), friction=None, on=None)])
    off = np.array([0.6 * away, 0.0, 0.8 * away, 0.0, 0.6, 0.0, 0.8])
    found = descend(manifold, manifold.at(off), tolerance=1e-12 * away, most=20)
    assert found.closed and found.at.residual < 1e-12 * away


def test_singular_values_know_no_unit_of_length():
    """A four-bar in millimetres has those of one in metres: rows and sliding velocities are divided by lengths of its own."""
    robots = [scaled_four_bar(length) for length in (1.0, 1e3)]
    one, other = (null_space(ConstraintManifold(robot.at("assembled")).at(robot.at("assembled").q).J)[1] for robot in robots)
    assert one == pytest.approx(other, rel=1e-9)


def test_rows_are_measured_at_three_poses_nearby(four_bar: rbd.Robot):
    """Half a radian away, the same each time."""
    q = four_bar.at("assembled").q
    poses = list(poses_nearby(four_bar, q))
    manifold = ConstraintManifold(four_bar.at("assembled"))
    assert [np.linalg.norm(manifold.way(q, p)) for p in poses] == pytest.approx([0.5] * 3)
    assert all(np.array_equal(a, b) for a, b in zip(poses, poses_nearby(four_bar, q), strict=True))
    norms = [np.linalg.norm(manifold.at(p).J, axis=1) for p in [q, *poses]]
    assert np.max(norms, axis=0) == pytest.approx(np.ones(2))


def test_ranks_count_what_is_above_a_fraction():
    """Of the largest, or of one where all are small; of none there is none."""
    assert rank_of(np.array([2.0, 1e-3, 1.9e-8])) == 2 and rank_of(np.array([1e-9, 1e-10])) == 0
    assert rank_of(np.array([1e-9, 1e-10, 1e-18]), least=0.0) == 2 and rank_of(np.zeros(0)) == 0


def test_without_constraints_those_of_the_robots_file_are_meant(four_bar: rbd.Robot, talos: rbd.Robot):
    """Its loops and wheels; a humanoid has none. A lone constraint is told to be put into a list."""
    assert own_or(four_bar, None) == own_or(four_bar, list(own_or(four_bar, None))) and len(own_or(four_bar, None)) == 1
    assert own_or(talos, None) == () and ConstraintManifold(talos.at()).m == 0
    with pytest.raises(rbd.InputError, match="give a list"):
        ConstraintManifold(talos.at(), talos.soles(friction=None)[0])  # type: ignore[arg-type]


def test_what_can_slip_or_bears_one_name_twice_is_refused(talos: rbd.Robot):
    """By name; so is what is no state."""
    state = talos.standing()
    with pytest.raises(rbd.InputError, match="'left_sole' can break or slip"):
        ConstraintManifold(state, talos.soles())
    soles = talos.soles(friction=None)
    with pytest.raises(rbd.InputError, match="two constraints are named 'left_sole'"):
        ConstraintManifold(state, [soles[0], soles[0]])
    with pytest.raises(rbd.InputError, match="a State of a robot was expected first"):
        ConstraintManifold("talos")  # type: ignore[arg-type]


def test_a_lock_without_a_position_is_one_where_the_joint_is(talos: rbd.Robot):
    """As a contact without an anchor: a constraint of position, so that each velocity it leaves is one of finite motion."""
    state = talos.standing()
    knee = talos.joints["leg_left_4_joint"]
    lock = rbd.JointLock("brake", knee.name)
    put = lock.anchored(state)
    assert put.position == pytest.approx(state.q[knee.q]) and put.rows(state).error == pytest.approx([0.0])
    manifold = ConstraintManifold(state, [lock])
    assert manifold.placed.all() and manifold.tolerance == CLOSED
    found = rbd.mechanism.mobility(state, [lock])
    assert not found.velocity_only and found.finite == found.instantaneous == talos.nv - 1


@pytest.mark.parametrize("speed", [0.0, 1e-6, 0.5, 1e4])
def test_a_ball_keeps_its_height_above_a_plane_that_moves_in_itself(speed: float):
    """However fast the ball and the plane are: the row along the normal has a position. On a plane that moves off none has."""
    ball, n, along = rbd.testing.box(), np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
    rng = np.random.default_rng(0)
    state = rbd.State(ball, next(poses_nearby(ball, np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]))), 3.0 * rng.normal(size=6))
    for way, placed in ((along, True), (n, speed == 0.0)):
        plane = rbd.Ground(normal=tuple(n), point=(0.1, 0.2, 0.3), velocity=tuple(speed * way))
        manifold = ConstraintManifold.about(state, [rbd.RollingBall("ball", "box", radius=0.1, on=plane)])
        assert manifold.placed.tolist() == manifold.rows(state).placed.tolist() == [False, False, placed]
