"""RungeKutta4: energy, order on every kind of joint and constraint, forces, and what it refuses."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from smooth_models import URDF, along, chain, off, swinging

import rbd

TIGHT = rbd.DormandPrince8(rtol=1e-12, atol=1e-13)


def _last(state, constraints, h, duration, integrator=None, **settings):
    every = round(duration / h)
    found = rbd.simulate(
        state, constraints, duration=duration, step=h, integrator=integrator or rbd.RungeKutta4(), record_every=every,
        progress=False, **settings,
    )  # fmt: skip
    return found.state(-1)


def test_energy_of_a_double_pendulum_stays_for_ten_seconds():
    """Two uniform rods released level: the energy keeps to 1e-7 of the peak kinetic energy at 1 ms."""
    robot = chain(2, com=0.5, inertia=1.0 / 12.0)
    found = rbd.simulate(rbd.State(robot, np.zeros(2)), duration=10.0, step=1e-3, record_every=10, progress=False)
    assert np.abs(found.energy - found.energy[0]).max() <= 1e-7 * found.kinetic.max()


def test_energy_of_a_ur5_that_falls_stays():
    """Let go stretched out: to 1e-7 of the peak kinetic energy over 10 s at 2 ms."""
    robot = rbd.load_robot("ur5", root="fixed")
    found = rbd.simulate(rbd.State(robot, pin.neutral(robot.model)), duration=10.0, step=2e-3, record_every=10, progress=False)
    assert np.abs(found.energy - found.energy[0]).max() <= 1e-7 * found.kinetic.max()


def _cases(talos):
    rng = np.random.default_rng(6)
    held = [rbd.SurfaceContact(c.name, c.frame, corners=c.corners, placement=c.placement) for c in talos.soles()]
    stand = talos.standing()
    moving = rbd.State(talos, stand.q, rng.normal(size=talos.nv))
    solo = rbd.load_robot("solo12")
    ur5 = rbd.load_robot("ur5", root="fixed")
    sleigh = rbd.load_robot(URDF / "chaplygin_sleigh.urdf")
    disk = rbd.load_robot(URDF / "rolling_disk.urdf")
    four_bar = rbd.mechanism.four_bar(40, 120, 80, 100)
    leaning = pin.integrate(disk.model, disk.at("upright").q, np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0]))
    leaning[2] = 0.25 * np.cos(0.2)
    rods = chain(2, com=0.5, inertia=1.0 / 12.0)
    yield "double pendulum", rbd.State(rods, np.array([0.3, 1.0]), np.array([2.0, -3.0])), (), 0.02
    yield "ur5", rbd.State(ur5, pin.neutral(ur5.model), rng.normal(size=6)), (), 0.01
    yield "talos in the air", moving, (), 0.01
    yield "talos on held soles", along(stand, held, rng.normal(size=talos.nv)), held, 0.01
    yield "solo12 in the air", rbd.State(solo, solo.standing().q, rng.normal(size=solo.nv)), (), 0.01
    yield "sleigh on a plane", along(sleigh.at(), sleigh.wheels(), np.array([3.0, 0.0, 4.0])), sleigh.wheels(), 0.02
    yield (
        "rolling disk",
        along(rbd.State(disk, leaning), disk.wheels(), np.array([1.0, 0, 0, 0, 12.0, 3.0])),
        disk.wheels(),
        0.01,
    )
    yield "four-bar", swinging(four_bar, "assembled", 4.0), four_bar.loops(), 0.01


def test_half_the_step_has_a_sixteenth_of_the_error(talos):
    """Order 4 on revolute, continuous, planar and floating joints, under soles, loops and rolling."""
    for name, state, constraints, h in _cases(talos):
        true = _last(state, constraints, 16 * h, 16 * h, TIGHT)
        errors = [off(true, _last(state, constraints, step, 16 * h)) for step in (h, h / 2)]
        assert errors[1] > 1e-12, (name, errors)
        assert 11.0 < errors[0] / errors[1] < 24.0, (name, errors)


def test_a_torque_that_changes_with_time_keeps_the_order():
    """The controller is asked at all stages: tau = sin 5 t on a bar without weight turns it by (t - sin(5 t) / 5) / 5 / I."""
    robot = chain(1)
    robot.model.gravity.linear = np.zeros(3)
    true = 2.0 / 5.0 - np.sin(10.0) / 25.0
    errors = []
    for h in (0.05, 0.025):
        found = _last(rbd.State(robot, np.zeros(1)), (), h, 2.0, controller=lambda state, t: np.array([np.sin(5.0 * t)]))
        errors.append(abs(found.q[0] - true))
    assert 14.0 < errors[0] / errors[1] < 18.0


def test_forces_of_recorded_moments_are_those_of_solve(talos):
    """At each moment the forces, and their law, are what rbd.solve says at that state."""
    held = [rbd.SurfaceContact(c.name, c.frame, corners=c.corners, placement=c.placement) for c in talos.soles()]
    state = along(talos.standing(), held, np.full(talos.nv, 0.3))
    found = rbd.simulate(state, held, duration=0.01, step=1e-3, progress=False)
    for i in (0, -1):
        answer = rbd.solve(found.state(i), found.tau[i], held, solver=rbd.KKT())
        assert np.abs(found.a[i] - answer.a).max() < 1e-9 * np.abs(answer.a).max()
        for name, force in answer.forces.items():
            assert np.abs(found.forces[name][i] - force).max() < 1e-7
            assert found.modes[name][i] == "holds"
    assert found.residuals["law"].max() < 1e-10
    assert found.residuals["drift"].max() < 1e-11


def test_the_same_run_twice_is_the_same_to_the_last_bit(talos):
    """No order of sets, no clock: equal input gives equal numbers."""
    held = [rbd.SurfaceContact(c.name, c.frame, corners=c.corners, placement=c.placement) for c in talos.soles()]
    state = along(talos.standing(), held, np.full(talos.nv, 0.5))
    one, two = (_last(state, held, 5e-3, 0.1) for _ in range(2))
    assert np.array_equal(one.q, two.q)
    assert np.array_equal(one.v, two.v)


def test_what_can_break_or_slip_is_refused_by_name(brick):
    """Friction, and a stop that is not reached yet: both want time stepping."""
    contact = rbd.PointContact("corner", "box", offset=(0.2, 0.2, -0.1), friction=0.5, on=-0.1)
    with pytest.raises(rbd.errors.Unsupported, match="corner.*TimeStepping"):
        rbd.simulate(brick.at(), [contact], duration=0.1, step=0.01, integrator=rbd.RungeKutta4())
    arm = rbd.load_robot("ur5", root="fixed")
    stop = rbd.JointLimit("elbow_stop", "elbow_joint", upper=1.0)
    with pytest.raises(rbd.errors.Unsupported, match="elbow_stop.*TimeStepping"):
        rbd.simulate(arm.at(), [stop], duration=0.1, step=0.01, integrator=rbd.DormandPrince8())


def test_a_start_off_the_constraints_is_refused():
    """A loop that is open, and one whose pins fly apart."""
    robot = rbd.mechanism.four_bar(40, 120, 80, 100)
    with pytest.raises(rbd.errors.RbdError, match=r"off by .* at the start.*assemble"):
        rbd.simulate(rbd.State(robot, pin.neutral(robot.model)), robot.loops(), duration=0.1, step=0.01, progress=False)
    apart = rbd.State(robot, robot.at("assembled").q, np.array([1.0, 0.0, 0.0]))
    with pytest.raises(rbd.errors.RbdError, match="that is an impact"):
        rbd.simulate(apart, robot.loops(), duration=0.1, step=0.01, progress=False)


def test_free_motion_factors_no_inertia(monkeypatch):
    """A chain of 200 links: its accelerations are those of the articulated bodies, and satisfy M a + h = 0 to rounding."""
    robot, rng = chain(200), np.random.default_rng(0)
    state = rbd.State(robot, 0.3 * rng.normal(size=200), 0.1 * rng.normal(size=200))
    M, h = state.M, state.h

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("M was factored")

    monkeypatch.setattr(rbd.model.dynamics, "inertia_factor", refused)
    monkeypatch.setattr(rbd.constraints.manifold, "inertia_factor", refused)
    moved = rbd.simulate(state, duration=3e-4, step=1e-4, integrator=rbd.RungeKutta4(), progress=False)
    for a in (rbd.dynamics.free_acceleration(state, None), moved.a[0]):
        assert (np.abs(M @ a + h) <= 1e-12 * (np.abs(M) @ np.abs(a) + np.abs(h))).all()
    assert moved.residuals["law"].max() < 1e-12
