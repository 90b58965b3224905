"""Work of the motors: the energy that they give, under every integrator, and what it balances."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from smooth_models import chain

import rbd
from rbd.control import ZeroOrderHold
from rbd.model.checked_model import CheckedModel

STEPPING = [rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)]
SMOOTH = [rbd.RungeKutta4(), rbd.DormandPrince8()]
START = rbd.State(chain(3), np.array([1.0, 0.5, 0.2]), np.array([1.0, -1.0, 2.0]))


def feedback(state: rbd.State, t: float) -> np.ndarray:
    """Torques that change within a step."""
    return -3.0 * state.q - 0.5 * state.v + np.sin(3.0 * t)


def missing(run: rbd.Trajectory) -> np.ndarray:
    """Energy that the motors have not given, shape (n,) [J]."""
    return run.energy - run.energy[0] - run.motor_work


def moved(controller, integrator, step: float, start: rbd.State = START, constraints=(), duration: float = 0.5):
    """A run of half a second."""
    return rbd.simulate(start, constraints, duration=duration, step=step, controller=controller, integrator=integrator)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@pytest.mark.parametrize("integrator", [*STEPPING, *SMOOTH], ids=repr)
def test_constant_torques_work_through_the_way_of_their_joints(integrator):
    """W = tau . (q(t) - q(0)) at every sample, to rounding; it begins at zero."""
    tau = np.array([2.0, -1.0, 0.5])
    run = moved(lambda state, t: tau, integrator, 0.02)
    assert run.motor_work[0] == 0.0
    assert run.motor_work == pytest.approx((run.q - run.q[0]) @ tau, abs=1e-13)


@pytest.mark.parametrize("integrator", [*STEPPING, rbd.RungeKutta4()], ids=repr)
@pytest.mark.parametrize("held", [False, True])
def test_energy_less_work_is_of_the_integrators_order(integrator, held):
    """Halving the step divides the error by 4 or by 16, whether torques vary within a step or not."""
    order = 4 if isinstance(integrator, rbd.RungeKutta4) else 2
    controller = ZeroOrderHold(feedback, 0.02) if held else feedback
    errors = [np.abs(missing(moved(controller, integrator, h))).max() for h in (0.01, 0.005, 0.0025)]
    for one, two in zip(errors, errors[1:], strict=False):
        assert 0.85 < np.log2(one / two) / order < 1.15
    assert errors[-1] < (3e-4 if order == 2 else 2e-9)


@pytest.mark.parametrize("held", [False, True])
def test_to_a_tolerance_the_balance_is_exact(held):
    """`DormandPrince8`, at its own steps and between them: 1e-9 of 4 J."""
    controller = ZeroOrderHold(feedback, 0.02) if held else feedback
    run = moved(controller, rbd.DormandPrince8(), 7e-3)
    assert np.abs(run.motor_work).max() > 4.0 and np.abs(missing(run)).max() < 1e-9


@pytest.mark.parametrize("integrator", [*SMOOTH, rbd.TimeStepping()], ids=repr)
def test_constraint_forces_of_a_driven_loop_do_no_work(integrator):
    """A four-bar: to 1e-8 of the work of its motors in smooth motion, and of second order by time steps."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    push = np.linspace(4.0, 1.0, bars.nu)

    def error(step: float) -> float:
        run = moved(lambda state, t: push, integrator, step, bars.at("assembled"), bars.loops(), 0.3)
        assert np.abs(run.motor_work).max() > 0.5
        return float(np.abs(missing(run)).max() / np.abs(run.motor_work).max())

    if integrator in SMOOTH:
        assert error(1e-3) < 1e-8
    else:
        assert error(2e-3) / error(1e-3) == pytest.approx(4.0, rel=0.05) and error(1e-3) < 1e-5


def test_a_joint_that_turns_round_and_round_keeps_counting():
    """A hinge without limits, whose two numbers in q repeat: W = tau times the whole angle."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    rotor = CheckedModel(model, name="rotor")
    for integrator in (rbd.RungeKutta4(), rbd.TimeStepping(), rbd.DormandPrince8()):
        run = moved(lambda state, t: np.array([4.0]), integrator, 0.01, rbd.State(rotor, [1.0, 0.0]), duration=3.0)
        assert run.motor_work[-1] == pytest.approx(4.0 * 0.5 * 4.0 * 9.0, rel=1e-9)  # 18 rad, almost three turns


def test_without_a_controller_there_is_no_work():
    """And none of passive joints."""
    for integrator in (*STEPPING, *SMOOTH):
        assert not moved(None, integrator, 0.02).motor_work.any()


def test_friction_and_impacts_are_what_is_missing():
    """A crate slides: E falls by mu m g s. Thrown from 0.1 m it lands plastically, then stops: all its energy is gone."""
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
    along = [1.0, 0, 0, 0, 0, 0]
    slides = rbd.simulate(rbd.State(box, [0, 0, 0, 0, 0, 0, 1], along), [face], duration=0.15, step=1e-3)
    assert missing(slides) == pytest.approx(-0.5 * 98.1 * slides.q[:, 0], abs=1e-9) and not slides.motor_work.any()
    lands = rbd.simulate(rbd.State(box, [0, 0, 0.1, 0, 0, 0, 1], along), [face], duration=0.3, step=1e-3)
    assert np.abs(missing(lands)[lands.t < 0.142]).max() < 1e-9
    assert missing(lands)[-1] == pytest.approx(-98.1 * 0.1 - 0.5 * 10.0 * 1.0, abs=1e-9)


@pytest.fixture(scope="module")
def squats() -> list[rbd.Trajectory]:
    """Talos bends its knees by 8 cm and stretches them, under torques held for 4 ms, at steps of 4, 2 and 1 ms."""
    talos = rbd.load_robot("talos")
    standing, soles = talos.standing(), talos.soles(0.7)
    posture = rbd.control.HoldPosture(standing, soles, frequency=8.0)
    bend = np.zeros(talos.nu)
    for side in ("left", "right"):
        for number, angle in ((3, -0.2), (4, 0.4), (5, -0.2)):
            bend[talos.actuated_names.index(f"leg_{side}_{number}_joint")] = angle

    def controller(state: rbd.State, t: float) -> np.ndarray:
        share = 0.5 * (1.0 - np.cos(2.0 * np.pi * t / 0.5))
        return np.clip(
            posture(state, t) + posture.gains(state).stiffness @ (share * bend), -talos.effort_limit, talos.effort_limit
        )

    held = ZeroOrderHold(controller, 4e-3)
    return [rbd.simulate(standing, soles, duration=0.4, step=h, controller=held) for h in (4e-3, 2e-3, 1e-3)]


def test_the_motors_of_a_squatting_talos_give_the_energy_that_it_has(squats):
    """On sticking soles between impacts: kinetic and potential energy less work is constant to 1e-6 of the work, at 1 ms."""
    exchanged = [np.abs(np.diff(run.motor_work)).sum() for run in squats]
    assert all(work > 20.0 and not run.events for work, run in zip(exchanged, squats, strict=True))
    errors = [np.abs(missing(run)).max() / work for run, work in zip(squats, exchanged, strict=True)]
    assert errors[2] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1) and errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_the_work_is_printed_kept_and_labelled(squats, tmp_path):
    """In the table, in a slice, a sample, a file, and in xarray with its unit."""
    run = squats[0]
    assert f"work of the motors {run.motor_work[-1]:.4g} J" in str(run)
    assert "work of the motors" not in str(moved(None, None, 0.02))
    assert np.array_equal(run[3:9].motor_work, run.motor_work[3:9]) and run[5].motor_work == run.motor_work[5]
    run.save(tmp_path / "squat.npz")
    assert np.array_equal(rbd.Trajectory.load(tmp_path / "squat.npz").motor_work, run.motor_work)
    assert run.to_xarray().motor_work.attrs["units"] == "J"
    rare = rbd.simulate(run.state(0), duration=0.02, step=2e-3, controller=lambda state, t: state.v[6:], record_every=5)
    whole = rbd.simulate(run.state(0), duration=0.02, step=2e-3, controller=lambda state, t: state.v[6:])
    assert np.array_equal(rare.motor_work, whole.motor_work[::5])
