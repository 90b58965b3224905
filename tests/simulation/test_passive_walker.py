"""Passive walkers whose stance changes at the strike, over a hundred steps: the limit cycle, its period, published numbers."""

from __future__ import annotations

import numpy as np
import pytest
from passive_walkers import COMPASS, GAIT, MCGEER, SIDES, SIMPLEST

import rbd

FAST = rbd.DormandPrince8(rtol=1e-8, atol=1e-10, longest=0.5)
EXACT = rbd.DormandPrince8(rtol=1e-11, atol=1e-13, longest=0.5)


def walked(walker, y, steps, period, **given):
    """(periods of the steps, angles and rates after each strike, the trajectory)."""
    begun = walker.start(y)
    motion = rbd.simulate(
        begun, walker.feet, duration=steps * period, step=0.6 * period, events=walker.strikes, inactive="right",
        progress=False, **given,
    )  # fmt: skip
    times = np.array([e.t for e in motion.events if e.name.endswith("strikes")])
    after = [motion.state(int(np.flatnonzero(motion.t == t)[0])) for t in times]
    found = np.array([walker.angles(state, SIDES[1 - i % 2]) for i, state in enumerate(after)])
    return np.diff(np.r_[0.0, times]), found, motion


def test_the_simplest_walker_keeps_the_published_gait_over_a_hundred_steps():
    """Begun on Bhounsule's fixed point, which is stable: after a hundred strikes it has every digit still."""
    again, period = SIMPLEST.step(GAIT)
    assert np.abs(again - GAIT).max() < 1e-12
    periods, found, motion = walked(SIMPLEST, GAIT, 100.5, period, integrator=EXACT)
    assert len(periods) == 100
    assert np.abs(found - GAIT).max() < 1e-10
    assert np.abs(periods - period).max() < 1e-9
    assert motion.residuals["law"].max() < 1e-9


def test_mcgeers_walker_with_round_feet_converges_to_its_gait():
    """From 3 % off: angles, rates and period of the hundredth step are the fixed point of the planar equations."""
    gait = np.array([0.18887, -0.18887, -0.23878, -0.1874])
    for _ in range(25):
        gait, period = MCGEER.step(gait)
    again, _ = MCGEER.step(gait)
    assert np.abs(again - gait).max() < 1e-9
    periods, found, motion = walked(MCGEER, gait * [1.0, 1.0, 1.03, 1.0], 100.8, period, integrator=FAST)
    assert len(periods) >= 100
    assert np.abs(found[0] - gait).max() > 1e-3
    assert np.abs(found[99] - gait).max() < 1e-7
    assert abs(periods[99] - period) < 1e-7
    assert motion.residuals["drift"].max() < 1e-11


def test_every_step_of_a_compass_gait_is_that_of_the_planar_equations():
    """Not only the limit: periods and states after each of the first strikes, to 1e-10."""
    y = np.array([0.2738, -0.2738, -1.09, -0.376])
    periods, found, motion = walked(COMPASS, y, 6, 0.735, integrator=EXACT)
    for period, after in zip(periods, found, strict=True):
        y, wanted = COMPASS.step(y)
        assert abs(period - wanted) < 1e-10
        assert np.abs(after - y).max() < 1e-10
    kinds = [(e.name, e.kind) for e in motion.events[:3]]
    assert kinds == [("right strikes", "rises through zero"), ("left", "leaves"), ("right", "touches")]


@pytest.mark.parametrize(("by", "order"), [(rbd.RungeKutta4(), 4)])
def test_strikes_keep_the_order_of_the_integrator(by, order):
    """Two steps of a compass gait: half the step has a sixteenth of the error, in the times and after the strikes."""
    y = np.array([0.2738, -0.2738, -1.09, -0.376])
    one, _ = COMPASS.step(y)
    two, _ = COMPASS.step(one)
    errors = []
    for step in (0.04, 0.02):
        motion = rbd.simulate(
            COMPASS.start(y), COMPASS.feet, duration=1.6, step=step, events=COMPASS.strikes, inactive="right", integrator=by
        )
        last = [e.t for e in motion.events if e.name.endswith("strikes")][1]
        found = COMPASS.angles(motion.state(int(np.flatnonzero(motion.t == last)[0])), "left")
        errors.append(np.abs(found - two).max())
    assert 0.6 * 2**order < errors[0] / errors[1] < 1.7 * 2**order


def test_a_mirrored_walker_is_the_same():
    """Legs relabelled at each strike by `then`, which computes the impact itself: the same times, one foot only."""
    left, right = COMPASS.feet
    y = np.array([0.2738, -0.2738, -1.09, -0.376])

    def swap(state, t):
        after = rbd.impact(state, [right])
        mirrored = [0, 1, 3, 2]
        q, v = state.q[mirrored], after.v[mirrored]
        offset = state.frame("right").X_WF.translation
        q[[0, 1]] -= offset[[0, 2]]  # the same place again, so that the anchored foot is where it was
        return rbd.simulation.Switch(q=q, v=v)

    strike = rbd.simulation.StateEvent(COMPASS.strikes[0].function, "strike", direction=1, then=swap, terminal=4)
    motion = rbd.simulate(COMPASS.start(y), [left], duration=5.0, step=0.1, events=[strike], integrator=EXACT)
    periods, _, _ = walked(COMPASS, y, 4.3, 0.735, integrator=EXACT)
    times = [e.t for e in motion.events if e.name == "strike"]
    assert np.abs(np.array(times) - np.cumsum(periods)[:4]).max() < 1e-9
    assert motion.end_reason is rbd.errors.Reason.EVENT
    assert motion.t[-1] == times[-1]
