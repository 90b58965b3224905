"""Steps that save a fall: pushes that fixed feet do not hold, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rbd
from rbd.control import Balance, Push
from rbd.errors import InputError

STEP = 2e-3


class FallsError(Exception):
    """The centre of mass is below 60 % of its height: a run ends early."""


def push_of(link: str, impulse: float, angle: float) -> Push:
    """A level push of 0.1 s."""
    a = math.radians(angle)
    return Push(link, impulse / 0.1 * np.array([math.cos(a), math.sin(a), 0.0]), start=0.0, duration=0.1)


def pushed(balance: Balance, push: Push, duration: float = 2.5) -> rbd.Trajectory | None:
    """The motion after a push; None where the robot falls."""

    def watched(now: rbd.State, t: float) -> tuple:
        if now.com[2] < 0.6 * balance.state.com[2]:
            raise FallsError
        return push(now, t)

    given = {"external": watched, "progress": False, "record_every": 10}
    try:
        return rbd.simulate(balance.state, balance.contacts, duration=duration, step=STEP, controller=balance, **given)
    except rbd.errors.SimulationStopped as stopped:
        if isinstance(stopped.__cause__, FallsError):
            return None
        raise


def stands(run: rbd.Trajectory | None) -> bool:
    """At rest, as high as at first, with both feet on the ground."""
    return (
        run is not None
        and bool(np.abs(run.v[-1, :6]).max() < 0.05)
        and abs(run.com[-1, 2] - run.com[0, 2]) < 0.05
        and all(f[-1, 2] > 0.0 for f in run.forces.values())
    )


@pytest.mark.filterwarnings("ignore::rbd.errors.RelaxedLimitsWarning")
def test_steps_save_a_humanoid_that_falls_without(talos: rbd.Robot, exhaustive: bool) -> None:
    """80 N s at the torso: with steps Talos comes to rest, on feet that it put down elsewhere; without it falls."""
    for angle in (0.0, 180.0) if exhaustive else (0.0,):
        check_saved(talos, angle)


def check_saved(talos: rbd.Robot, angle: float) -> None:
    """From a push in one direction."""
    push = push_of("torso_2_link", 80.0, angle)
    balance = Balance(talos, friction=0.7)
    run = pushed(balance, push, 2.0 if angle == 0.0 else 3.5)
    assert stands(run) and balance.plan.footsteps and balance.plans
    step = balance.plan.footsteps[0]
    moved = (step.pose.translation - balance.plan.poses[step.foot].translation)[:2]
    assert moved @ [math.cos(math.radians(angle)), math.sin(math.radians(angle))] > 0.2
    assert not stands(pushed(Balance(talos, friction=0.7, steps=False), push))


def test_small_pushes_take_no_step(talos: rbd.Robot) -> None:
    """15 N s are held by the feet as they stand; without a push nothing is planned."""
    balance = Balance(talos, friction=0.7)
    assert stands(pushed(balance, push_of("torso_2_link", 15.0, 90.0), 1.5)) and not balance.plan.footsteps
    assert "taken no steps" in str(balance)
    run = rbd.simulate(balance.state, balance.contacts, duration=0.1, step=STEP, controller=balance, progress=False)
    assert not balance.plans and np.abs(run.v[-1]).max() < 1e-2


@pytest.mark.filterwarnings("ignore::rbd.errors.RelaxedLimitsWarning")
def test_used_again_it_gives_the_same_bits(talos: rbd.Robot) -> None:
    """It forgets a motion, its plans, and what it saw of a push."""
    balance = Balance(talos, friction=0.7)
    runs = [pushed(balance, push_of("torso_2_link", 60.0, 0.0), 0.15) for _ in range(2)]
    assert balance.plan.footsteps and runs[0] is not None and runs[1] is not None
    assert np.array_equal(runs[0].q, runs[1].q)


def test_what_is_refused() -> None:
    """Four feet, and no feet."""
    with pytest.raises(InputError, match="has 4 feet; Balance takes steps with two"):
        Balance(rbd.load_robot("solo12"))
    with pytest.raises(rbd.errors.ModelError, match="no feet are known for ur5"):
        Balance(rbd.load_robot("ur5"))
    with pytest.raises(InputError, match="steps of Balance"):
        Balance(rbd.load_robot("g1"), steps="yes")  # type: ignore[arg-type]
