"""Steps that save a fall: pushes that fixed feet do not hold, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rbd
from rbd.control import AcceptedStep, Balance, Push, TaskActuation, WholeBodyController
from rbd.control.contact_schedule import SeenContacts
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


@pytest.mark.filterwarnings("ignore::rbd.errors.RelaxedLimitsWarning", "ignore::rbd.errors.InaccurateWarning")
def test_steps_save_a_humanoid_that_falls_without(talos: rbd.Robot, exhaustive: bool) -> None:
    """80 N s at the torso: with steps Talos comes to rest, on feet that it put down elsewhere; without it falls."""
    for angle in range(0, 360, 45) if exhaustive else (0, 90):
        check_saved(talos, float(angle))


def check_saved(talos: rbd.Robot, angle: float) -> None:
    """From a push in one direction."""
    push = push_of("torso_2_link", 80.0, angle)
    balance = Balance(talos, friction=0.7)
    run = pushed(balance, push)
    assert stands(run) and balance.plan.footsteps and balance.plans, angle
    assert balance.log.residual.max() < 1e-7
    for foot in balance.contacts:
        (*_, (X, _, _)) = balance.plan.stays(foot.name)
        assert np.abs(run.points[foot.name][-1].mean(axis=0) - X.translation)[:2].max() < 3e-3  # the plan knows where it stands
    step = balance.plan.footsteps[0]
    moved = (step.pose.translation - balance.plan.poses[step.foot].translation)[:2]
    assert moved @ [math.cos(math.radians(angle)), math.sin(math.radians(angle))] > 0.2
    assert not stands(pushed(Balance(talos, friction=0.7, steps=False), push))


@pytest.mark.filterwarnings("ignore::rbd.errors.RelaxedLimitsWarning")
def test_what_pushes_is_seen(talos: rbd.Robot) -> None:
    """What neither motors nor feet explain is the push: its force, and its moment about the centre of mass."""
    balance, push = Balance(talos, friction=0.7, steps=False), push_of("torso_2_link", 30.0, 90.0)
    rbd.simulate(
        balance.state, balance.contacts, duration=0.02, step=STEP, controller=balance, external=push, progress=False
    )  # fmt: skip
    lever = balance.state.frame("torso_2_link").X_WF.translation - balance.state.com
    assert np.abs(balance._push[:3] - push.force).max() < 0.01 * 300.0  # of a step's change of M and h
    assert np.abs(balance._push[3:] - np.cross(lever, push.force)).max() < 0.05 * 300.0 * balance._planner.h


def test_the_plan_is_the_motion_over_a_centre_of_pressure(talos: rbd.Robot) -> None:
    """M c'' is what its one force says, from the middle of the foot's edge, and it comes to rest over the capture point."""
    balance = Balance(talos, friction=0.7)
    pushed(balance, push_of("torso_2_link", 60.0, 0.0), 0.06)
    plan, w = balance.plans[-1][1], 1.0 / balance._planner.unit
    force, com = plan.centroid.forces[:, 0], plan.centroid.com
    assert np.abs(force[:, 2] - talos.mass * 9.81).max() < 1e-9 * talos.mass
    landing = plan.footsteps[-1].end
    for part in (plan.t < landing, plan.t > landing):
        z = com[part, :2] - force[part, :2] / (talos.mass * w**2)
        assert np.abs(z - z[0]).max() < 1e-12  # one centre of pressure over each stance
    dt = plan.t[1] - plan.t[0]
    n = int((plan.t < landing).sum())
    c = com[:n, :2] - (com[:n, :2] - force[:n, :2] / (talos.mass * w**2))[0]
    assert np.abs(c[2:] + c[:-2] - 2.0 * np.cosh(w * dt) * c[1:-1]).max() < 1e-12  # c'' = w^2 (c - z), exactly sampled
    assert np.abs(com[-1, :2] - com[-2, :2]).max() < 0.05 * balance._planner.h


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


def test_a_step_without_torques_holds_those_before(talos: rbd.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fall is simulated to its end; it is said once and counted. There is nothing to hold at the first step."""
    solved, missing = WholeBodyController._step, [5, 6]

    def broken(self: WholeBodyController, told: AcceptedStep, seen: SeenContacts) -> TaskActuation:
        if round(told.t / STEP) in missing:
            raise rbd.NoSolution("no torques.")
        return solved(self, told, seen)

    monkeypatch.setattr(WholeBodyController, "_step", broken)
    balance = Balance(talos, friction=0.7)
    given = {"duration": 0.02, "step": STEP, "controller": balance, "external": push_of("torso_2_link", 15.0, 90.0)}
    with pytest.warns(rbd.errors.InaccurateWarning, match=r"at t = 0.01 s talos holds the torques .* no torques") as said:
        run = rbd.simulate(balance.state, balance.contacts, progress=False, **given)
    assert len(said) == 1 and balance.unsolved == pytest.approx([0.01, 0.012]) and len(run) == 11
    assert np.array_equal(run.tau[5], run.tau[4]) and np.array_equal(run.tau[6], run.tau[4])
    assert np.abs(run.tau[7] - run.tau[6]).max() > 1e-3 and "no torques were found for 2 steps of control" in str(balance)
    missing[:] = [0]
    with pytest.raises(rbd.errors.SimulationStopped, match="no torques"):
        rbd.simulate(balance.state, balance.contacts, progress=False, **given)
    assert not balance.unsolved


def test_what_is_refused() -> None:
    """Four feet, and no feet."""
    with pytest.raises(InputError, match="has 4 feet; Balance takes steps with two"):
        Balance(rbd.load_robot("solo12"))
    with pytest.raises(rbd.errors.ModelError, match="no feet are known for ur5"):
        Balance(rbd.load_robot("ur5"))
    with pytest.raises(InputError, match="steps of Balance"):
        Balance(rbd.load_robot("g1"), steps="yes")  # type: ignore[arg-type]
