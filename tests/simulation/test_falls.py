"""Robots that fall with all of their collision shapes: what is skipped because it cannot have come near changes nothing."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.contact_kinematics import Between

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


@pytest.mark.parametrize("name", ROBOTS)
def test_shapes_whose_ball_is_far_change_no_bit(name):
    """As a robot falls the points near the ground are the same where each shape has a ball that is always near."""
    state = tumbling(name)
    contacts = rbd.CollisionContacts("ground", state.robot, margin=0.05)
    plane = contacts._finder.plane
    assert plane is not None
    whole = plane.another()
    whole.points._given = (*plane.points._given[:5], np.full(len(plane.points.shapes), 1e3), *plane.points._given[6:])
    seen = 0
    for k in range(60):
        now = rbd.State(state.robot, pin.integrate(state.robot.model, state.q, 2e-3 * k * state.v), state.v)
        found, every = (each.at(now, 0.05) for each in (plane, whole))
        assert (found is None) == (every is None)
        if found is not None and every is not None:
            seen += len(found.numbers)
            for what in ("numbers", "gaps", "positions", "J", "bias"):
                assert np.array_equal(getattr(found, what), getattr(every, what))
    assert seen > 100


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
        return rbd.simulate(state, [contacts], duration=0.02, step=1e-3, progress=False)

    monkeypatch.setattr(Between, "_asked", counted)
    quick = fold()
    monkeypatch.setattr(Between, "_asked", all_asked)
    whole = fold()
    assert 0 < asked[0] < 0.5 * asked[1]
    assert len(quick.events) > 5 and quick.events == whole.events
    for what in ("q", "v", "a"):
        assert np.array_equal(getattr(quick, what), getattr(whole, what))
    assert np.array_equal(quick.forces["own"], whole.forces["own"])
