"""Robots that fall with all of their collision shapes: what is skipped because it cannot have come near changes nothing."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.contact_kinematics import Between
from rbd.constraints.convex.points_near_plane import LowPoints

ROBOTS = ("talos", "g1", "solo12")


def tumbling(name: str, seed: int = 3) -> rbd.State:
    """A robot on its side in the air, its lowest point 1 cm above the ground, that falls, turns and moves its joints."""
    robot, rng = rbd.load_robot(name), np.random.default_rng(seed)
    q, v = robot.standing().q.copy(), rng.normal(size=robot.nv)
    R = pin.exp3(rng.normal(size=3))
    q[3:7] = pin.Quaternion(R).coeffs()
    v[:3], v[3:6] = R.T @ [0.5, 0.0, -1.0], (2.0, 1.0, -1.0)
    low = rbd.CollisionContacts("ground", robot, margin=10.0).points(robot.at(q)).gaps.min()
    q[2] -= low - 0.01
    return rbd.State(robot, q, v)


def look_at_all(self: LowPoints, up: np.ndarray, height: np.ndarray, margin: float) -> object:
    """In place of `LowPoints._current`: a list of all points, each time."""
    return self._listed(np.ones(len(self.body), bool))


@pytest.mark.parametrize("name", ROBOTS)
def test_points_that_cannot_be_near_change_no_bit_of_a_fall(name, monkeypatch):
    """With all points looked at each time the fall is the same to the last bit, and so are its events, forces and residuals."""
    state, asked = tumbling(name), []
    near = LowPoints.near

    def counted(self, up, height, margin):
        found = near(self, up, height, margin)
        asked[-1] += len(found[0].index)
        return found

    monkeypatch.setattr(LowPoints, "near", counted)

    def fall() -> rbd.Trajectory:
        asked.append(0)
        contacts = rbd.CollisionContacts("ground", state.robot, friction=0.6)
        return rbd.simulate(state, [contacts], duration=0.08, step=1e-3, progress=False)

    quick = fall()
    monkeypatch.setattr(LowPoints, "_current", look_at_all)
    whole = fall()
    assert asked[0] < 0.3 * asked[1]
    assert len(quick.events) > 5 and quick.events == whole.events
    for what in ("q", "v", "a", "momentum"):
        assert np.array_equal(getattr(quick, what), getattr(whole, what))
    for what in ("forces", "points", "point_forces", "residuals"):
        for one, other in zip(getattr(quick, what).values(), getattr(whole, what).values(), strict=True):
            assert np.array_equal(one, other, equal_nan=True)


@pytest.mark.filterwarnings("ignore:bodies of solo12 are inside each other")  # the hulls of its trunk and thighs
def test_pairs_that_cannot_have_come_near_change_no_bit(monkeypatch):
    """Solo12 folds its legs: with all pairs near by their balls asked each time its contacts are the same to the last bit."""
    state, asked = tumbling("solo12"), [0, 0]
    pairs = Between._asked

    def counted(self, *given):
        out = pairs(self, *given)
        asked[0] += len(out)
        return out

    def all_asked(self, R, p, centres, near, margin):
        asked[1] += len(near)
        return near.tolist()

    def fold() -> rbd.Trajectory:
        contacts = rbd.CollisionContacts("own", state.robot, friction=0.6, ground=False, pairs=True)
        return rbd.simulate(state, [contacts], duration=0.03, step=1e-3, progress=False)

    monkeypatch.setattr(Between, "_asked", counted)
    quick = fold()
    monkeypatch.setattr(Between, "_asked", all_asked)
    whole = fold()
    assert 0 < asked[0] < 0.5 * asked[1]
    assert len(quick.events) > 5 and quick.events == whole.events
    for what in ("q", "v", "a"):
        assert np.array_equal(getattr(quick, what), getattr(whole, what))
    assert np.array_equal(quick.forces["own"], whole.forces["own"])
