"""Limits of joints: one that is asked to go beyond them brakes in time, at every period; no bound is tighter than needed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.control import Limits, PostureTask, step
from rbd.errors import InputError

A, D = 20.0, 0.01
P = 0.75 * A
"""Braking is planned with it."""


@pytest.fixture(scope="module")
def arm() -> rbd.Robot:
    return rbd.load_robot("panda", root="fixed")


def room_of(arm: rbd.Robot) -> tuple[Array, Array, Array]:
    """Lowest and highest positions, and speeds, of the file, by Pinocchio's own arrays."""
    model = arm.model
    return np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit), np.array(model.velocityLimit)


def viable(arm: rbd.Robot, rng: np.random.Generator, n: int) -> list[rbd.State]:
    """States from which every joint can brake in time with A, some of them just."""
    low, high, fast = room_of(arm)
    out = []
    for _ in range(n):
        q = rng.uniform(low, high)
        q = np.where(rng.random(arm.nq) < 0.3, np.where(rng.random(arm.nq) < 0.5, low, high), q)
        least, most = -np.sqrt(2.0 * A * (q - low)), np.sqrt(2.0 * A * (high - q))
        v = rng.uniform(np.maximum(least, -fast), np.minimum(most, fast))
        v = np.where(rng.random(arm.nv) < 0.3, np.minimum(most, fast), v)
        out.append(rbd.State(arm, q, v))
    return out


@pytest.mark.parametrize("period", [0.001, 0.004, 0.01])
def test_joints_that_are_pushed_to_their_limits_never_pass_them(arm: rbd.Robot, period: float) -> None:
    """Steps with the largest accelerations that are allowed, from random states: within positions and speeds to rounding.

    Between two steps, too: the highest point of each parabola is looked at. The period may be shorter than the horizon.
    """
    low, high, fast = room_of(arm)
    limits, rng = Limits(braking=A, horizon=0.01), np.random.default_rng(2)
    reached = np.zeros(arm.nv, bool)
    for state in viable(arm, rng, 10):
        q, v = state.q.copy(), state.v.copy()
        side = np.where(rng.random(arm.nv) < 0.5, -1.0, 1.0)
        for _ in range(400):
            least, most = limits.accelerations(rbd.State(arm, q, v))
            assert (least <= most).all()
            a = np.where(side > 0.0, most, least)
            turn = np.clip(np.divide(-v, a, out=np.zeros_like(v), where=a != 0.0), 0.0, period)
            extreme = q + turn * (v + 0.5 * turn * a)
            assert (extreme <= high + 1e-12).all() and (extreme >= low - 1e-12).all()
            q, v = np.clip(q + period * (v + 0.5 * period * a), low - 1e-12, high + 1e-12), v + period * a
            assert (np.abs(v) <= fast * (1.0 + 1e-12)).all()
        reached |= np.minimum(high - q, q - low) < 1e-3
    assert reached.sum() >= 5  # the limits are reached, and not kept at a distance


def test_a_joint_that_is_allowed_more_could_not_brake_in_time(arm: rbd.Robot) -> None:
    """The bound is the most: after a step with 0.1 more, the joint passes its limit though it then brakes with P."""
    low, high, _ = room_of(arm)
    limits, rng, told = Limits(velocity=False, braking=A, horizon=D), np.random.default_rng(3), 0
    for state in viable(arm, rng, 40):
        _, most = limits.accelerations(state)
        for a, inside in ((most, True), (most + 0.1, False)):
            q, v = state.q + D * (state.v + 0.5 * D * a), state.v + D * a
            stops = np.where(v > 0.0, q + v * v / (2.0 * P), state.q + state.v**2 / np.maximum(-2.0 * a, 1e-300))
            moving = (v > 0.0) | (state.v > 0.0)
            if inside:
                assert (stops[moving & (most > -A)] <= high[moving & (most > -A)] + 1e-12).all()
            else:
                kept = moving & (most > -A)
                assert (stops[kept] > high[kept]).all()
                told += int(kept.sum())
    assert told > 100


def test_a_joint_beyond_its_limit_comes_back_and_one_too_fast_brakes(arm: rbd.Robot) -> None:
    """Neither is asked for more than A; a joint beyond its limit by e has about e exp(-t / 2 d) left."""
    low, high, fast = room_of(arm)
    limits = Limits(braking=A, horizon=D)
    q, v = high + 0.004, np.zeros(arm.nv)
    for _ in range(100):
        _, most = limits.accelerations(rbd.State(arm, q, v))
        assert (most >= -A).all()
        q, v = q + D * (v + 0.5 * D * most), v + D * most
    assert ((q - high)[:7] < 0.004 * math.exp(-9.0)).all() and (q > high - 1e-4).all()
    middle = 0.5 * (low + high)
    assert limits.accelerations(rbd.State(arm, middle, 2.0 * fast))[1] == pytest.approx(np.maximum(-fast / D, -A))
    assert limits.accelerations(rbd.State(arm, high - 1e-3, fast))[1] == pytest.approx(np.full(arm.nv, -A))


@pytest.mark.parametrize("period", [0.001, 0.005])
def test_an_arm_that_is_asked_to_go_beyond_its_limits_stays_within_them(arm: rbd.Robot, period: float) -> None:
    """Simulated, torques held: every joint is asked to be half a radian beyond a limit, fast; which ones is reported.

    Without a margin the positions pass their limits by a few squares of the period, as accelerations drift.
    """
    low, high, fast = room_of(arm)
    q = arm.at().q.copy()
    q[:] = 0.5 * (low + high)
    goal = np.where(np.arange(arm.nq) % 2, high + 0.5, low - 0.5)
    limits, tasks = (
        Limits(torque=None, braking=15.0, horizon=2.0 * period, margin=20.0 * period**2),
        [PostureTask(goal, gain=900.0)],
    )
    state, seen, furthest, fastest = rbd.State(arm, q), set[str](), 0.0, 0.0
    for _ in range(round(1.6 / period)):
        found = step(state, tasks, limits=limits)
        assert found.violation is None
        seen |= set(found.at_limit)
        for _ in range(2):  # M a + h = tau, from the middle of each half period
            h = 0.5 * period
            a = rbd.dynamics.free_acceleration(state, found.tau)
            half = rbd.State(arm, state.q + 0.5 * h * state.v, state.v + 0.5 * h * a)
            a = rbd.dynamics.free_acceleration(half, found.tau)
            state = rbd.State(arm, state.q + h * half.v, state.v + h * a)
            furthest = max(furthest, float(np.maximum(state.q - high, low - state.q).max()))
            fastest = max(fastest, float((np.abs(state.v) / fast).max()))
    assert furthest <= 0.0 and fastest <= 1.0 + 3.0 * period  # speeds pass theirs by what one period changes
    assert seen == {"position", "velocity"}
    assert (np.minimum(high - state.q, state.q - low) < 5e-3).all()


def test_what_has_no_limits_has_no_bounds() -> None:
    """A box; solo12's base; limits that are switched off; torques as shares of the file's."""
    for state in (rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1]), rbd.load_robot("solo12").standing()):
        least, most = Limits().accelerations(state)
        assert np.isneginf(least[:6]).all() and np.isposinf(most[:6]).all()
    solo = state.robot
    assert np.isfinite(most[6:]).all()
    off = Limits(torque=None, position=False, velocity=False)
    assert np.isinf(off.torques(solo)).all() and np.isinf(off.accelerations(state)).all()
    assert Limits(torque=0.25).torques(solo) == pytest.approx(0.25 * solo.effort_limit)


def test_limits_that_cross_leave_the_middle() -> None:
    """A joint too fast between two near limits: one acceleration is left, and no error."""
    solo = rbd.load_robot("solo12")
    state = solo.standing()
    v = np.zeros(solo.nv)
    v[6:] = 1e3
    least, most = Limits(braking=1.0).accelerations(state.with_velocity(v))
    assert (least <= most).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"torque": 0.0}, {"torque": 1.5}, {"torque": math.nan}, {"torque": "all"}, {"torque": True}, {"position": 1},
        {"velocity": None}, {"braking": 0.0}, {"braking": -1.0}, {"braking": math.nan},
        {"margin": -1e-3}, {"margin": math.nan}, {"horizon": 0.0}, {"horizon": math.inf},
    ],
)  # fmt: skip
def test_limits_that_are_none_are_refused(wrong: dict[str, object]) -> None:
    """At construction, by name."""
    with pytest.raises(InputError, match=next(iter(wrong))):
        dataclasses.replace(Limits(), **wrong)  # type: ignore[arg-type]
