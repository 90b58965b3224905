"""Constraints kept by projection, by feedback, or not; and the way through singular poses."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from smooth_models import along, swinging

import rbd
from rbd.mechanism.projection import correction, inertia_factor, project_position

STEP = 1e-3


def _stacked(constraints):
    def equations(state):
        rows = [c.rows(state) for c in constraints]
        return np.vstack([r.J for r in rows]), np.concatenate([r.error for r in rows])

    return equations


@pytest.mark.parametrize("kind", ["planar", "point", "revolute", "rigid"])
def test_position_goes_back_by_the_least_motion_though_rows_repeat(kind):
    """A four-bar closed with 2, 3, 5 or 6 rows of rank 2: onto the loop, along M^-1 J^T to first order in the distance."""
    robot = rbd.mechanism.four_bar(1.0, 2.0, 2.5, 2.2)
    (given,) = robot.loops
    loop = rbd.LoopClosure("pin", given.frame_a, given.frame_b, kind=kind, axis=given.axis)
    on = robot.at("assembled")
    if kind == "rigid":  # a weld where a hinge is: only what is planar can be met
        loop = rbd.LoopClosure("pin", given.frame_a, given.frame_b, kind="point", axis=given.axis)
    offset = 1e-3 * np.array([1.0, -2.0, 1.5])
    start = rbd.State(robot, pin.integrate(robot.model, on.q, offset))
    equations = _stacked([loop])
    found = project_position(start, equations, rbd.Projection())
    flat = _stacked([given])
    assert np.abs(flat(found)[1]).max() < 1e-12
    moved = pin.difference(robot.model, start.q, found.q)
    J = flat(found)[0]
    _, _, Vt = np.linalg.svd(J)
    assert abs(Vt[-1] @ start.M @ moved) < 20.0 * np.linalg.norm(moved) ** 2  # across what is free


def test_velocity_goes_back_without_a_trace_on_what_is_free():
    """The change is perpendicular, in M, to the mechanism's own motion, and takes the kinetic energy of the error alone."""
    robot = rbd.mechanism.n_four_bar(3)
    state = rbd.State(robot, robot.at("assembled").q, np.linspace(-1.0, 2.0, robot.nv))
    J, _ = _stacked(robot.loops)(state)
    v = state.v - correction(inertia_factor(state), J, J @ state.v)
    assert np.abs(J @ v).max() < 1e-13
    _, _, Vt = np.linalg.svd(J)
    assert abs(Vt[-1] @ state.M @ (v - state.v)) < 1e-12
    assert abs(v @ state.M @ (state.v - v)) < 1e-12


def test_projection_feedback_and_neither_drift_as_they_should():
    """Projection leaves rounding, Baumgarte a little that stays, None what accumulates."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    start = swinging(robot, "assembled", 6.0)
    drift = {}
    for by in (rbd.Projection(), rbd.Baumgarte(40.0), None):
        found = rbd.simulate(start, robot.loops, duration=2.0, step=4e-3, stabilisation=by, progress=False)
        drift[type(by).__name__] = found.residuals["drift"]
    assert drift["Projection"].max() < 1e-12
    assert drift["Baumgarte"][-1] < 0.2 * drift["NoneType"][-1]
    assert drift["NoneType"][-1] > 1e-7


def test_a_held_contact_stays_where_it_was_at_the_start(talos):
    """Soles without an anchor are anchored at the start: after motion they are there to 1e-12 m, also in between."""
    held = [rbd.SurfaceContact(c.name, c.frame, corners=c.corners, placement=c.placement) for c in talos.soles()]
    state = along(talos.standing(), held, np.full(talos.nv, 0.4))
    found = rbd.simulate(state, held, duration=0.1, step=5e-3, progress=False)
    for c in held:
        there = [found.state(i).frame(c.frame).X_WF for i in (0, -1)]
        assert np.abs(there[0].homogeneous - there[1].homogeneous).max() < 1e-11
    assert found.residuals["drift"].max() < 1e-12
    assert found.residuals["drift_rate"].max() < 1e-11


def _phi(n, phi, rate, duration):
    """Of the N-four-bar's cranks: [(N + 1)/3 + N] phi'' = -[(N + 1)/2 + N] g cos phi."""
    drive = ((n + 1) / 2 + n) / ((n + 1) / 3 + n) * 9.81
    out = solve_ivp(
        lambda t, y: [y[1], -drive * np.cos(y[0])], (0.0, duration), [phi, rate], method="DOP853", rtol=1e-13, atol=1e-13
    )
    return out.y[:, -1]


def _flat(robot, n, phi, rate):
    """The N-four-bar with its cranks at phi."""
    q, v = robot.at("assembled").q.copy(), np.zeros(robot.nv)
    for name in robot.joints():
        joint, sign = robot.model.joints[robot.joint_id(name)], 1.0 if name.startswith("crank") else -1.0
        q[joint.idx_q : joint.idx_q + 2] = np.cos(phi), sign * np.sin(phi)
        v[joint.idx_v] = sign * rate
    return rbd.State(robot, q, v)


@pytest.mark.parametrize(("integrator", "step"), [(rbd.RungeKutta4(), STEP), (rbd.Adaptive(1e-12, 1e-13), 0.01)])
def test_the_benchmark_passes_its_singular_pose_ten_times(integrator, step):
    """IFToMM A02, N = 2, for 10 s: loops, energy, and where it is, of Gonzalez's benchmark and of its closed form."""
    robot = rbd.mechanism.n_four_bar(2)
    start = swinging(robot, "assembled", -1.0)
    found = rbd.simulate(start, robot.loops, duration=10.0, step=step, integrator=integrator, record_every=10, progress=False)
    tip = found.state(-1).frame("crank_0", (1.0, 0.0, 0.0))
    p, v = tip.X_WF.translation[[0, 2]], tip.v[[0, 2]]
    assert found.residuals["drift"].max() < 1e-12
    assert np.abs(found.energy - found.energy[0]).max() < 1e-8
    assert np.abs(p - [0.32845811, 0.94451854]).max() < 1e-8
    assert np.abs(v - [1.42305147, -0.49486885]).max() < 1e-8
    phi, rate = _phi(2, np.pi / 2, -1.0, 10.0)
    assert np.abs(p - [np.cos(phi), np.sin(phi)]).max() < 1e-9
    assert np.abs(v - rate * np.array([-np.sin(phi), np.cos(phi)])).max() < 1e-9


@pytest.mark.parametrize("n", [1, 3, 6])
@pytest.mark.parametrize("phi", [0.0, 1e-10, 1e-7, 1e-5, 1e-4])
def test_a_start_at_the_singular_pose_or_beside_it_goes_on(n, phi):
    """All bars aligned, where J has lost N ranks: the motion is the closed form's, from any distance.

    The pins' forces grow as 1 / phi where N > 1: at phi = 0 no finite forces make this motion, and a warning says so.
    """
    robot = rbd.mechanism.n_four_bar(n)
    infinite = pytest.warns(rbd.InaccurateWarning, match="at t = 0 s; 1 of 51") if phi == 0.0 and n > 1 else nullcontext()
    with infinite:
        found = rbd.simulate(_flat(robot, n, phi, 3.0), robot.loops, duration=0.05, step=STEP, progress=False)
    true = _phi(n, phi, 3.0, 0.05)
    q = found.q[-1]
    assert abs(np.arctan2(q[1], q[0]) - true[0]) < 1e-11
    assert np.abs(np.abs(found.v[-1]) - abs(true[1])).max() < 1e-9
    assert np.abs(found.energy - found.energy[0]).max() < 1e-9


def _across(kind):
    """Four-bars whose two branches cross, bars of unlike masses: the way is curved, and the bars do not move alike."""
    lengths = {"antiparallelogram": (1, 2, 1, 2), "kite": (1, 2, 2, 1)}[kind]
    robot = rbd.mechanism.four_bar(*lengths, crank_angle=0.3, masses=[1.0, 1.5, 0.7])
    return swinging(robot, "crossed" if kind == "antiparallelogram" else "assembled", -4.0)


@pytest.mark.parametrize("kind", ["antiparallelogram", "kite"])
def test_a_curved_branch_is_followed_through_the_crossing_wherever_steps_fall(kind):
    """Steps end anywhere about the pose, exactly on it too; energy changes by 16 times less at half the step."""
    start = _across(kind)
    loops = start.robot.loops
    fine = rbd.simulate(start, loops, duration=0.15, step=0.15, integrator=rbd.Adaptive(1e-12, 1e-13), progress=False).state(-1)
    worst = []
    for h in (2e-3, 1e-3):
        errors = []
        for shift in np.linspace(0.0, 1.0, 3):
            n = int(0.15 / h)
            times = [0.0, *(shift * h + h * np.arange(1, n)), 0.15]
            motion = rbd.simulation.motion.Motion(start.robot, loops, stabilisation=rbd.Projection())
            *_, last = rbd.RungeKutta4().run(motion, start, times)
            errors.append(np.abs(last.state.v - fine.v).max())
        worst.append(max(errors))
    assert worst[1] < 2e-7
    assert worst[1] < worst[0] / 8.0


def test_branches_that_nearly_cross_turn_away():
    """A parallelogram 1e-6 m short of one cannot pass: it turns onto the other branch, sharply; the adaptive steps see it."""
    robot = rbd.mechanism.four_bar(1.0, 2.0, 1.0, 2.0 + 1e-6, crank_angle=0.3)
    start = swinging(robot, "assembled", -4.0)
    found = rbd.simulate(start, robot.loops, duration=0.15, step=0.01, integrator=rbd.Adaptive(), progress=False)
    assert np.abs(found.energy - found.energy[0]).max() < 1e-6
    assert found.residuals["drift"].max() < 1e-10
    q = found.q[-1].reshape(3, 2)
    coupler = np.arctan2(q[0, 1], q[0, 0]) + np.arctan2(q[1, 1], q[1, 0])
    assert abs(coupler) > 0.1  # a parallelogram's stays level


def test_rows_that_contradict_each_other_stop_the_run_by_name():
    """One joint is to keep still and to speed up: no acceleration does both, and no least-squares one goes on in silence."""
    robot = rbd.load_robot("ur5", root="fixed")
    row = np.eye(6)[0]
    still, faster = rbd.VelocityConstraint("still", row), rbd.VelocityConstraint("faster", row, bias=lambda q, v: [-1.0])
    with pytest.raises(rbd.errors.NoSolution, match="no acceleration satisfies .*(still|faster).* misses 0.5"):
        rbd.simulate(robot.at(), [still, faster], duration=0.1, step=0.01, progress=False)


@pytest.mark.parametrize("given", [{"tolerance": 0.0}, {"tolerance": 1.0}, {"iterations": 0}, {"iterations": 2.5}])
def test_settings_that_are_none_are_refused(given):
    """With what was expected."""
    with pytest.raises(rbd.errors.InputError, match="expected"):
        rbd.Projection(**given)
