"""The residual `energy`: energy that steps make is told, and whatever does work is in the balance."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.control.schedules import Push
from rbd.errors import InaccurateWarning, SimulationStopped
from rbd.model.array_file import read_npz, write_npz
from tests.simulation.smooth_models import two_links

STEPS, KUTTA, EXACT = rbd.TimeStepping(), rbd.RungeKutta4(), rbd.DormandPrince8()
TURN = [0.0, 0.0, 0.0, 0.0, 100.0, 0.0, -50.0]
"""Velocity of the two links [m/s, rad/s]."""


def turning(h: float, by: object) -> rbd.Trajectory:
    """Two free links at 100 rad/s, for a tenth of a second."""
    start = rbd.State(two_links(), [0, 0, 0, 0, 0, 0, 1, 0.5], TURN)
    return rbd.simulate(start, duration=0.1, step=h, integrator=by, progress=False)


@pytest.mark.parametrize(("by", "h"), [(STEPS, 0.01), (STEPS, 0.005), (KUTTA, 0.02), (KUTTA, 0.01)])
def test_steps_that_make_energy_are_told_with_those_that_do_not(by: object, h: float) -> None:
    """Nothing acts on the two links, so that their kinetic energy is constant: all of its change is the residual."""
    with pytest.warns(InaccurateWarning, match="energy' passes 0.1 %.*the turn of '.*per second; times the step") as said:
        wrong = turning(h, by)
    change = wrong.energy - wrong.energy[0]
    np.testing.assert_allclose(wrong.residuals["energy"], change, atol=1e-12 * wrong.kinetic.max())
    assert np.abs(change).max() > 1e-3 * wrong.kinetic.max() and wrong.residuals["law"].max() < 1e-12
    assert len(said) == 1
    number = r"([\d.e-]+)"
    wanted = rf"at t = {number} s.* {number} per second; times the step that is {number}\. .* about {number} s\."
    found = re.search(wanted, str(said[0].message))
    assert found is not None
    passed, rate, times, shorter = map(float, found.groups())
    above = np.abs(change) > 1e-3 * np.maximum.accumulate(wrong.kinetic)
    assert passed == pytest.approx(wrong.t[above][0]) and times == pytest.approx(h * rate, rel=0.05) and 50.0 < rate < 400.0
    assert shorter < h
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        turning(0.1 / np.ceil(0.1 / shorter), by)


def test_a_motion_that_grows_beyond_bounds_says_that_its_steps_made_energy() -> None:
    with pytest.raises(SimulationStopped, match="grown beyond bounds.*the steps of two links make energy"):
        turning(0.02, rbd.TimeStepping(extrapolate=True))


def test_one_that_chooses_its_steps_is_to_have_a_smaller_tolerance() -> None:
    with pytest.warns(InaccurateWarning, match="smaller tolerance"):
        turning(0.01, rbd.DormandPrince8(rtol=1e-2, atol=1e-2))
    assert np.abs(turning(0.01, EXACT).residuals["energy"]).max() < 1e-5


@dataclass(frozen=True)
class Case:
    """A motion with work, `least` of it at least [J]."""

    run: Callable[[float, object], rbd.Trajectory]
    least: float


def box(v: list[float], z: float = 0.0) -> rbd.State:
    return rbd.State(rbd.testing.box(mass=10.0), [0, 0, z, 0, 0, 0, 1], v)


def case(start: rbd.State, constraints: object = (), duration: float = 0.4, least: float = 0.5, **more: object) -> Case:
    def run(h: float, by: object) -> rbd.Trajectory:
        return rbd.simulate(start, constraints, duration=duration, step=h, integrator=by, progress=False, **more)  # type: ignore

    return Case(run, least)


def arm(v: list[float]) -> rbd.State:
    return rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0]).at([0.3, 0.8], v)


def feedback(state: rbd.State, t: float) -> np.ndarray:
    return -8.0 * state.v[state.robot.motors] + 5.0 * np.sin(20.0 * t)


SOLE = rbd.SurfaceContact("sole", "box", half_lengths=(0.2, 0.2), friction=0.3, on=0.0)
CORNER = rbd.PointContact("corner", "box", friction=0.3, on=0.0)
BELT = rbd.SurfaceContact("belt", "box", half_lengths=(0.2, 0.2), friction=0.3, on=rbd.Ground(velocity=(1.0, 0, 0, 0, 0, 0)))
HELD = rbd.PointContact("held", "box", offset=(0.3, 0.0, 0.0), friction=None, on=rbd.Ground(velocity=(0, 0, 1.0, 0, 0, 0)))
SPRING, DAMPER = rbd.Spring("box", to=(0, 0, 2), stiffness=300.0, rest=0.8), rbd.Damper("box", to=(0, 0, 2), damping=20.0)
WIND = rbd.ExternalForce("box", (30.0, 5.0, 40.0), offset=(0.2, 0.0, 0.1))
STOPS = [rbd.JointLimit("stop", "joint_2")]
ANY = {
    "gravity and motors": case(arm([1.0, 2.0]), controller=feedback),
    "spring and damper": case(box([1, 0, 0, 1, 0, 0]), external=[SPRING, DAMPER]),
    "a push": case(box([1, 0, 0, 0, 2, 0]), external=WIND),
    "a push and a spring": case(box([1, 0, 0, 0, 2, 0]), external=[WIND, SPRING, DAMPER]),
    "a function of time": case(box([1, 0, 0, 0, 2, 0]), external=lambda s, t: [WIND] if t < 0.2 else [SPRING, DAMPER]),
    "a push for a time": case(box([1, 0, 0, 0, 2, 0]), external=Push("box", (80.0, 0, 0), start=0.1, duration=0.2)),
    "moving ground": case(box([0, 0, 1.0, 0, 0, 0]), [HELD]),
}
CONTACT = {
    "sliding": case(box([1.0, 0.5, 0, 0, 0, 1.0]), [SOLE]),
    "an impact": case(box([0.5, 0, 0, 1.0, 2.0, 0], 0.1), [CORNER], restitution=0.5),
    "a belt": case(box([0.0, 0, 0, 0, 0, 0]), [BELT]),
    "dry friction": case(arm([3.0, 2.0]), [rbd.JointFriction("rubs", "joint_1", 2.0)], duration=0.3),
    "a limit": case(arm([3.0, 2.0]), STOPS, duration=0.3, least=-1.0),
}


def checked(one: Case, by: object) -> None:
    """What steps make of energy is of second order or below, and no more than a warning's share."""
    sizes = []
    for h in (4e-3, 2e-3):
        run = one.run(h, by)
        sizes.append(float(np.abs(run.residuals["energy"]).max()))
        assert np.ptp(run.energy) > one.least
    assert sizes[1] < max(0.4 * sizes[0], 1e-7), sizes


JUMPS = ("a function of time", "a push for a time")
"""Forces that jump at samples, which Kutta's method takes at both ends of a step: it errs by a step's work, rightly told."""


@pytest.mark.parametrize(
    ("name", "by"), [(name, by) for name in ANY for by in (STEPS, KUTTA, EXACT) if by is not KUTTA or name not in JUMPS]
)
def test_whatever_does_work_is_in_the_balance(name: str, by: object) -> None:
    checked(ANY[name], by)


@pytest.mark.parametrize("name", CONTACT)
def test_what_contacts_take_is_in_the_balance(name: str) -> None:
    checked(CONTACT[name], STEPS)


@pytest.mark.parametrize("by", [STEPS, KUTTA, EXACT], ids=lambda by: type(by).__name__)
def test_a_switch_that_stops_the_robot_takes_its_energy(by: object) -> None:
    """The jump of the state at an event is work of the switch."""
    stop = rbd.simulation.StateEvent(lambda state, t: t - 0.1, "stop", then=rbd.simulation.Switch(v=np.zeros(6)), direction=1)
    run = rbd.simulate(box([1.0, 0, 5.0, 0, 0, 0]), duration=0.3, step=0.01, integrator=by, events=[stop], progress=False)
    assert np.ptp(run.energy) > 50.0 and np.abs(run.residuals["energy"]).max() < 1e-9


@pytest.mark.parametrize("by", [STEPS, KUTTA], ids=lambda by: type(by).__name__)
def test_feedback_that_closes_an_open_anchor_works(by: object) -> None:
    """Baumgarte's feedback pulls a box to its anchor: its work is no error of the steps."""
    pull = rbd.PointContact("pull", "box", friction=None, anchor=(0.1, 0.0, 0.0))
    stabilised = rbd.constraints.Baumgarte(frequency=10.0)
    run = rbd.simulate(
        box([0, 0, 0, 0, 0, 0]), [pull], duration=0.3, step=1e-3, integrator=by, stabilisation=stabilised, progress=False
    )
    assert np.ptp(run.energy) > 0.2
    assert np.abs(run.residuals["energy"]).max() < 1e-3 * run.kinetic.max()


def test_the_size_and_the_lack_of_it_are_saved(tmp_path: Path) -> None:
    """A file of an earlier version has none: it is not known then, which the table says."""
    with pytest.warns(InaccurateWarning):
        wrong = turning(0.01, KUTTA)
    wrong.save(tmp_path / "wrong.npz")
    again = rbd.Trajectory.load(tmp_path / "wrong.npz", wrong.robot)
    assert np.array_equal(again.residuals["energy"], wrong.residuals["energy"])
    header, arrays = read_npz(tmp_path / "wrong.npz")
    write_npz(tmp_path / "old.npz", header, {name: x for name, x in arrays.items() if name != "residual_energy"})
    old = rbd.Trajectory.load(tmp_path / "old.npz", wrong.robot)
    assert np.isnan(old.residuals["energy"]).all() and "energy not known" in str(old)
    assert "energy not known" not in str(again)
