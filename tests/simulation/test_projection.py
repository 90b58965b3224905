"""Constraints kept by projection, by feedback, or not; and the way through singular poses."""

from __future__ import annotations

import math
from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import chain as side_by_side, flat_body
from scipy.integrate import solve_ivp
from smooth_models import along, chain, swinging

import rbd
from rbd.arrays import inertia_factor
from rbd.mechanism.projection import correction, project_position
from rbd.testing import box

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
    (given,) = robot.loops()
    loop = rbd.LoopClosure("pin", given.frame_a, given.frame_b, kind=kind, axis=given.axis)
    on = robot.at("assembled")
    if kind == "rigid":  # a weld where a hinge is: only what is planar can be met
        loop = rbd.LoopClosure("pin", given.frame_a, given.frame_b, kind="point", axis=given.axis)
    offset = 1e-3 * np.array([1.0, -2.0, 1.5])
    start = rbd.State(robot, pin.integrate(robot.model, on.q, offset))
    equations = _stacked([loop])
    found = project_position(start, equations, rbd.simulation.Projection())
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
    J, _ = _stacked(robot.loops())(state)
    v = state.v - correction(inertia_factor(state.M), J, J @ state.v)
    assert np.abs(J @ v).max() < 1e-13
    _, _, Vt = np.linalg.svd(J)
    assert abs(Vt[-1] @ state.M @ (v - state.v)) < 1e-12
    assert abs(v @ state.M @ (state.v - v)) < 1e-12


def _mass_on_a_slider(x=0.0, mass=1.0):
    return rbd.State(side_by_side([("x", pin.JointModelPX(), mass, [0.0] * 3)], names=("body",), name="mass"), np.array([x]))


def _of_x(error, slope):
    return lambda state: (np.array([[slope(state.q[0])]]), np.array([error(state.q[0])]))


@pytest.mark.parametrize("start", [0.2, 0.3, -0.4])
def test_a_step_that_goes_too_far_is_halved(start):
    """Arctan(100 x) = 0: Newton's steps from there jump over the root, ever farther; halved, they find it."""
    equations = _of_x(lambda x: math.atan(100.0 * x), lambda x: 100.0 / (1.0 + (100.0 * x) ** 2))
    assert abs(start - math.atan(100.0 * start) * (1.0 + (100.0 * start) ** 2) / 100.0) > 2.0
    assert abs(project_position(_mass_on_a_slider(start), equations, rbd.simulation.Projection()).q[0]) < 1e-14


@pytest.mark.parametrize("start", [0.3, -0.49, 0.07])
def test_what_cannot_be_met_ends_where_no_step_comes_nearer(start):
    """1 + x^2 = 0 has no root: near x = 0, where the error is least, and nearer than it began."""
    equations = _of_x(lambda x: 1.0 + x * x, lambda x: 2.0 * x)
    found = project_position(_mass_on_a_slider(start), equations, rbd.simulation.Projection()).q[0]
    assert abs(found) < 0.03
    assert abs(found) < abs(start)


def test_it_takes_no_more_steps_than_it_is_given():
    """One of Newton's: x - (x^2 - 1/4) / (2 x); the error left is the square of the step."""
    equations = _of_x(lambda x: x * x - 0.25, lambda x: 2.0 * x)
    found = project_position(_mass_on_a_slider(0.6), equations, rbd.simulation.Projection(iterations=1)).q[0]
    assert found == pytest.approx(0.6 - 0.11 / 1.2, abs=1e-15)
    assert found * found - 0.25 == pytest.approx((0.11 / 1.2) ** 2, abs=1e-15)


def test_what_is_not_off_is_not_moved():
    """No error, or no rows: a correction of zeros."""
    state = rbd.State(chain(2), np.array([0.3, 0.5]))
    L = inertia_factor(state.M)
    assert correction(L, np.eye(2), np.zeros(2)).tolist() == [0.0, 0.0]
    assert correction(L, np.zeros((0, 2)), np.zeros(0)).tolist() == [0.0, 0.0]
    assert correction(L, np.zeros((1, 2)), np.ones(1)).tolist() == [0.0, 0.0]  # a row that nothing moves


INTEGRATORS = pytest.mark.parametrize("integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping()])


@INTEGRATORS
def test_a_body_without_mass_has_no_motion(integrator):
    """M is singular: said so before the first step."""
    start = _mass_on_a_slider(mass=0.0)
    with pytest.raises(rbd.errors.SimulationStopped, match=r"step of mass .*M.1 x 1. is not positive definite") as stopped:
        rbd.simulate(start, duration=0.1, step=0.01, integrator=integrator, progress=False)
    assert isinstance(stopped.value.__cause__, rbd.errors.SingularInertia)


@INTEGRATORS
def test_a_force_that_no_mass_can_follow_stops_the_run(integrator):
    """1e140 N on 1e-200 kg: larger than all numbers."""
    start = _mass_on_a_slider(mass=1e-200)
    with pytest.raises(rbd.errors.SimulationStopped, match="(acceleration|momentum) of mass.* is not finite at"):
        rbd.simulate(
            start, duration=0.1, step=0.01, integrator=integrator, progress=False, external=lambda s, t: np.array([1e140])
        )


def test_an_error_with_the_sign_of_its_jacobian_wrong_is_told():
    """Each step back doubles it: the run stops with how far it is off, by name."""

    class Wrong:
        name = "wrong"

        def rows(self, state):
            return rbd.Rows(
                self.name, np.array([[0.0, 1.0]]), np.zeros(1), rbd.problem.Free(1), error=np.array([1e-6 - state.q[1]])
            )

    with pytest.raises(rbd.errors.SimulationStopped, match="'wrong' is off by .* m .or rad., and nothing brings it back"):
        rbd.simulate(rbd.State(chain(2), np.array([0.1, 0.0])), [Wrong()], duration=0.1, step=0.01, progress=False)


@pytest.mark.parametrize("integrator", [rbd.RungeKutta4(), rbd.DormandPrince8()])
def test_a_lock_without_a_position_keeps_the_one_at_the_start(integrator):
    """Of joints with an angle, and with cosine and sine: they stand, and the forces are those of `rbd.solve`."""
    arm = rbd.load_robot("ur5", root="fixed")
    q = np.array([0.3, -1.0, 0.8, 0.2, -0.4, 0.1])
    tiago = rbd.load_robot("tiago", root="fixed")
    wheel = next(n for n in tiago.joints if tiago.model.joints[tiago.joint_id(n)].nq == 2)
    for start, joint in ((rbd.State(arm, q), "elbow_joint"), (tiago.at(), wheel)):
        lock = rbd.JointLock("lock", joint)
        v = start.v.copy()
        v[[i for i in range(len(v)) if i != start.robot.model.joints[start.robot.joint_id(joint)].idx_v][0]] = 0.5
        found = rbd.simulate(start.with_velocity(v), [lock], duration=0.05, step=5e-3, integrator=integrator, progress=False)
        at = start.robot.model.joints[start.robot.joint_id(joint)]
        assert np.abs(found.q[:, at.idx_q : at.idx_q + at.nq] - start.q[at.idx_q : at.idx_q + at.nq]).max() < 1e-12
        proved = rbd.solve(found.state(-1), found.tau[-1], [lock], solver=rbd.KKT())
        assert np.abs(found.forces["lock"][-1] - proved.forces["lock"]).max() < 1e-6


@pytest.mark.parametrize(("integrator", "step"), [(rbd.RungeKutta4(), 2e-3), (rbd.DormandPrince8(), 0.02)])
@pytest.mark.parametrize("anchor", [None, (0.0, 0.0, 0.0)])
def test_what_a_belt_carries_along_goes_with_it(integrator, step, anchor):
    """A body pinned to a belt at 0.3 m/s: the pin goes 0.3 t, with an anchor or without, and the body swings about it."""
    belt = rbd.PointContact(
        "belt", "body", offset=(0.0, 0.0, 0.1), friction=None, on=rbd.Ground(velocity=(0.3, 0.0, 0.0)), anchor=anchor
    )
    start = rbd.State(flat_body(2.0, 0.02), np.array([0.0, -0.1, 0.0]), np.array([0.3 - 0.2, 0.0, 2.0]))
    found = rbd.simulate(start, [belt], duration=1.0, step=step, integrator=integrator, progress=False)
    every = round(0.1 / step)
    pins = np.array([found.state(i).frame("body", (0.0, 0.0, 0.1)).X_WF.translation for i in range(0, len(found), every)])
    assert len(pins) == 11 and np.abs(pins[:, 0] - 0.3 * found.t[::every]).max() < 1e-8
    assert np.abs(pins[:, 2]).max() < 1e-8
    drive = 2.0 * 9.81 * 0.1 / (0.02 + 2.0 * 0.01)
    swing = solve_ivp(lambda t, y: [y[1], -drive * math.sin(y[0])], (0.0, 1.0), [0.0, 2.0], rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.abs([found.q[-1, 2] - swing[0], found.v[-1, 2] - swing[1]]).max() < 1e-6


@pytest.mark.parametrize("integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping(), None], ids=repr)
@pytest.mark.parametrize("friction", [None, 0.6])
def test_a_ground_that_accelerates_is_refused(integrator, friction):
    """How it moves later is not known: carried along at its first velocity, its forces would be of another motion."""
    pin_on = rbd.PointContact(
        "lift",
        "body",
        offset=(0.0, 0.0, 0.1),
        friction=friction,
        on=rbd.Ground(velocity=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 1.0)),
    )
    start = rbd.State(flat_body(2.0, 0.02), np.array([0.0, -0.1, 0.0]))
    why = "the ground of 'lift' accelerates, and how it moves is known at one"
    if friction is not None and not isinstance(integrator, rbd.TimeStepping | None):
        why = "'lift' can break or slip"
    with pytest.raises(rbd.InputError if integrator is None and friction is None else rbd.errors.Unsupported, match=why):
        rbd.simulate(start, [pin_on], duration=0.1, step=0.01, integrator=integrator, progress=False)


def test_a_ground_that_tilts_is_refused_under_friction():
    """Its plane would stay: a box that turns with it at 0.5 rad/s would be level for ever. In its plane it may turn."""
    sole = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    start = rbd.State(box(10.0), np.r_[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0], np.r_[0.05, 0.0, 0.0, 0.0, 0.5, 0.0])

    def moved(spin, friction, begin):
        ground = rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0, *spin), about=(0.0, 0.0, 0.0))
        floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=sole, friction=friction, on=ground)
        return rbd.simulate(begin, [floor], duration=0.1, step=0.01, progress=False)

    with pytest.raises(rbd.errors.Unsupported, match="the ground of 'floor' tilts: its angular velocity is not along"):
        moved((0.0, 0.5, 0.0), 0.6, start)
    assert moved((0.0, 0.5, 0.0), None, start).q[-1, 4] == pytest.approx(np.sin(0.025), abs=1e-6)
    turning = start.with_velocity(np.r_[np.zeros(5), 0.5])
    assert moved((0.0, 0.0, 0.5), 0.6, turning).q[-1, 5] == pytest.approx(np.sin(0.025), abs=1e-6)


class _Table:
    """Holds z of a mass while x < 1 (it slides on a table), and y of another always."""

    name = "table"

    def rows(self, state):
        J = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])[0 if state.q[0] < 1.0 else 1 :]
        return rbd.Rows(self.name, J, np.zeros(len(J)), rbd.problem.Free(len(J)))


@pytest.mark.parametrize("x", [0.9, 0.5])
@pytest.mark.parametrize(("integrator", "step", "close"), [(rbd.RungeKutta4(), 1e-3, 2e-3), (rbd.DormandPrince8(), 0.1, 1e-9)])
def test_what_slides_over_the_edge_of_a_table_falls(integrator, step, close, x):
    """Two rows, then one: z = -g t^2 / 2 from the edge on, to the order of a step that goes over it; y stays."""
    joints = [(name, joint, 1.0, [1.0] * 3) for name, joint in zip(
        "xzy", (pin.JointModelPX(), pin.JointModelPZ(), pin.JointModelPY()), strict=True)]  # fmt: skip
    robot = side_by_side(joints, names=("a", "b", "c"), name="three")
    start = rbd.State(robot, np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    found = rbd.simulate(start, [_Table()], duration=0.8, step=step, integrator=integrator, progress=False)
    falls = 0.8 - (1.0 - x)
    assert abs(found.q[-1, 1] + 0.5 * 9.81 * falls**2) < close
    assert abs(found.v[-1, 1] + 9.81 * falls) < close
    assert np.abs(found.q[:, 2]).max() == 0.0
    assert found.forces["table"][0] == pytest.approx([9.81, 0.0])
    assert not found.forces["table"][-1].any()


@INTEGRATORS
def test_a_constraint_that_says_nothing_changes_nothing(integrator):
    """A row of zeros: the free motion, and no force."""

    class Idle:
        name = "idle"

        def rows(self, state):
            return rbd.Rows(self.name, np.zeros((1, 2)), np.zeros(1), rbd.problem.Free(1))

    start = rbd.State(chain(2), np.array([0.1, 0.2]), np.array([1.0, -1.0]))
    one, other = (
        rbd.simulate(start, given, duration=0.2, step=0.01, integrator=integrator, progress=False) for given in ([Idle()], [])
    )
    assert np.abs(one.q - other.q).max() < 1e-14
    assert not one.forces["idle"].any()


def test_projection_feedback_and_neither_drift_as_they_should():
    """Projection leaves rounding, Baumgarte a little that stays, None what accumulates."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    start = swinging(robot, "assembled", 6.0)
    drift = {}
    for by in (rbd.simulation.Projection(), rbd.constraints.Baumgarte(40.0), None):
        found = rbd.simulate(start, robot.loops(), duration=2.0, step=4e-3, stabilisation=by, progress=False)
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
    for name in robot.joints:
        joint, sign = robot.model.joints[robot.joint_id(name)], 1.0 if name.startswith("crank") else -1.0
        q[joint.idx_q : joint.idx_q + 2] = np.cos(phi), sign * np.sin(phi)
        v[joint.idx_v] = sign * rate
    return rbd.State(robot, q, v)


@pytest.mark.parametrize(
    ("integrator", "step", "every"), [(rbd.RungeKutta4(), STEP, 10), (rbd.DormandPrince8(1e-12, 1e-13), 0.1, 1)]
)
def test_the_benchmark_passes_its_singular_pose_ten_times(integrator, step, every, exhaustive):
    """IFToMM A02, N = 2, for 10 s: loops, energy, and where it is, of Gonzalez's benchmark and of its closed form."""
    step = step if exhaustive else max(step, 2.0 * STEP)  # of order 4 the longer one is as good as the bounds ask
    robot = rbd.mechanism.n_four_bar(2)
    start = swinging(robot, "assembled", -1.0)
    found = rbd.simulate(
        start, robot.loops(), duration=10.0, step=step, integrator=integrator, record_every=every, progress=False
    )
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
    infinite = (
        pytest.warns(rbd.errors.InaccurateWarning, match="at t = 0 s; 1 of 51") if phi == 0.0 and n > 1 else nullcontext()
    )
    with infinite:
        found = rbd.simulate(_flat(robot, n, phi, 3.0), robot.loops(), duration=0.05, step=STEP, progress=False)
    true = _phi(n, phi, 3.0, 0.05)
    q = found.q[-1]
    assert abs(np.arctan2(q[1], q[0]) - true[0]) < 1e-11
    assert np.abs(np.abs(found.v[-1]) - abs(true[1])).max() < 1e-9
    assert np.abs(found.energy - found.energy[0]).max() < 1e-9


@pytest.mark.parametrize("rate", [1e-1, 1e-3, 0.0])
@pytest.mark.parametrize(("n", "phi"), [(1, 0.0), (1, 1e-5), (3, 1e-5)])
def test_a_start_beside_the_singular_pose_that_is_slow_falls_away_from_it(n, phi, rate):
    """Bars aligned, level, hardly moving or at rest: they turn round near the pose, and fall as the closed form says."""
    robot = rbd.mechanism.n_four_bar(n)
    found = rbd.simulate(_flat(robot, n, phi, rate), robot.loops(), duration=0.05, step=STEP, progress=False)
    true, q = _phi(n, phi, rate, 0.05), found.q[-1]
    assert abs(np.arctan2(q[1], q[0]) - true[0]) < 1e-11
    assert np.abs(np.abs(found.v[-1]) - abs(true[1])).max() < 1e-9
    assert np.ptp(found.energy) < 1e-10


@pytest.mark.parametrize("phi", [0.0, 1e-9, 1e-5])
def test_cranks_without_weight_turn_evenly_through_the_singular_pose(phi):
    """No gravity: nothing accelerates, at the pose neither; phi = phi_0 + w t."""
    robot = rbd.mechanism.n_four_bar(1)
    robot.model.gravity.linear = np.zeros(3)
    found = rbd.simulate(_flat(robot, 1, phi, 3.0), robot.loops(), duration=0.05, step=STEP, progress=False)
    q = found.q[-1]
    assert abs(np.arctan2(q[1], q[0]) - (phi + 3.0 * 0.05)) < 1e-12
    assert np.abs(found.a).max() < 1e-7


def test_a_step_too_long_for_a_sharp_turn_is_refused():
    """A parallelogram 0.1 mm short of one turns within milliseconds: steps of 30 ms are told so, with what they leave."""
    robot = rbd.mechanism.four_bar(1.0, 2.0, 1.0, 2.0 + 1e-4, crank_angle=0.3)
    with pytest.raises(
        rbd.errors.SimulationStopped, match=r"to t = 0.09 s of four_bar is too long .* leaves 'coupler_pin'.*DormandPrince8"
    ):
        rbd.simulate(swinging(robot, "assembled", -4.0), robot.loops(), duration=0.15, step=0.03, progress=False)


def _across(kind):
    """Four-bars whose two branches cross, bars of unlike masses: the way is curved, and the bars do not move alike."""
    lengths = {"antiparallelogram": (1, 2, 1, 2), "kite": (1, 2, 2, 1)}[kind]
    robot = rbd.mechanism.four_bar(*lengths, crank_angle=0.3, masses=[1.0, 1.5, 0.7])
    return swinging(robot, "crossed" if kind == "antiparallelogram" else "assembled", -4.0)


@pytest.mark.parametrize("kind", ["antiparallelogram", "kite"])
def test_a_curved_branch_is_followed_through_the_crossing_wherever_steps_fall(kind):
    """Steps end anywhere about the pose, exactly on it too; energy changes by 16 times less at half the step."""
    start = _across(kind)
    loops = start.robot.loops()
    fine = rbd.simulate(
        start, loops, duration=0.15, step=0.15, integrator=rbd.DormandPrince8(1e-12, 1e-13), progress=False
    ).state(-1)
    worst = []
    for h in (2e-3, 1e-3):
        errors = []
        for shift in np.linspace(0.0, 1.0, 3):
            n = int(0.15 / h)
            times = [0.0, *(shift * h + h * np.arange(1, n)), 0.15]
            motion = rbd.simulation.simulated_motion.SimulatedMotion(
                start.robot, loops, stabilisation=rbd.simulation.Projection()
            )
            *_, last = rbd.RungeKutta4().run(motion, start, times)
            errors.append(np.abs(last.state.v - fine.v).max())
        worst.append(max(errors))
    assert worst[1] < 2e-7
    assert worst[1] < worst[0] / 8.0


@pytest.mark.parametrize("gap", [1e-6, 1e-8])
def test_branches_that_nearly_cross_turn_away(gap):
    """A parallelogram 1e-6 m short of one cannot pass: it turns onto the other branch, sharply; the adaptive steps see it."""
    robot = rbd.mechanism.four_bar(1.0, 2.0, 1.0, 2.0 + gap, crank_angle=0.3)
    start = swinging(robot, "assembled", -4.0)
    found = rbd.simulate(start, robot.loops(), duration=0.15, step=0.01, integrator=rbd.DormandPrince8(), progress=False)
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
        rbd.simulation.Projection(**given)
