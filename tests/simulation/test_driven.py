"""Joints driven as functions of time: against closed forms of piston, torque and force, with work and energy."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, make_interp_spline

import rbd
from rbd.errors import InputError, SimulationStopped
from rbd.mechanism import slider_crank, velocity_partition
from rbd.model.checked_model import CheckedModel
from rbd.model.content_hash import digest

R, L, W, G = 0.045, 0.15, 30.0, 9.81
CRANK, ROD, SLIDER = R, L, R  # masses [kg], one a metre
ENGINE = slider_crank(R, L)
ASSEMBLED = ENGINE.at("assembled")
START = ENGINE.joints["crank_joint"].coordinate(ASSEMBLED.q)


def constant(t):
    """The crank at a constant speed."""
    return START + W * t, W, 0.0


def uneven(t):
    """The crank at a speed that swings by a fifth."""
    return START + W * t + 0.3 * math.sin(20.0 * t), W + 6.0 * math.cos(20.0 * t), -120.0 * math.sin(20.0 * t)


def turning(motion):
    """The engine at the start, with the velocity of the motion."""
    return ASSEMBLED.with_velocity(velocity_partition(ASSEMBLED, ENGINE.loops(), {"crank_joint": motion(0.0)[1]}).v)


def rod_angle(th):
    """(cos, sin) of the rod's angle."""
    sine = -R * np.sin(th) / L
    return np.sqrt(1.0 - sine * sine), sine


def inertia_of(th):
    """T = I(th) th'^2 / 2 of the whole engine, from its bars."""
    cosine, sine = rod_angle(th)
    turn = -R * np.cos(th) / (L * cosine)
    x, z = -R * np.sin(th) - 0.5 * L * sine * turn, R * np.cos(th) + 0.5 * L * cosine * turn
    piston = -R * np.sin(th) - L * sine * turn
    return CRANK * R * R / 3.0 + ROD * (x * x + z * z + L * L / 12.0 * turn * turn) + SLIDER * piston * piston


def weight_of(th):
    """Potential energy."""
    return G * (0.5 * CRANK * R * np.sin(th) + ROD * (R * np.sin(th) + 0.5 * L * rod_angle(th)[1]))


def torque_of(th, rate, acceleration):
    """The crank's torque by Lagrange's equation of one degree of freedom; derivatives by complex steps."""
    e = 1e-30
    slope, weight = inertia_of(th + 1j * e).imag / e, weight_of(th + 1j * e).imag / e
    return inertia_of(th) * acceleration + 0.5 * slope * rate**2 + weight


@pytest.mark.parametrize("motion", [constant, uneven], ids=lambda f: f.__name__)
@pytest.mark.parametrize(
    ("integrator", "h"),
    [(rbd.RungeKutta4(), 1e-3), (rbd.DormandPrince8(), 1e-2), (rbd.TimeStepping(), 1e-3)],
    ids=["RungeKutta4", "DormandPrince8", "TimeStepping"],
)
def test_driven_slider_crank_has_the_piston_and_torque_of_the_closed_form(motion, integrator, h):
    """Over a turn, at constant and uneven speed, by every integrator: piston, speeds and torque to 1e-10; s, s' to 1e-12."""
    drive = rbd.DrivenJoint("drive", "crank_joint", motion)
    found = rbd.simulate(turning(motion), [drive], duration=0.21, step=h, integrator=integrator, progress=False)
    th, rate, acceleration = np.array([motion(t) for t in found.t]).T
    crank, piston = ENGINE.joints["crank_joint"], ENGINE.joints["slider_joint"]
    angle = np.unwrap([float(crank.coordinate(q)) for q in found.q])
    assert np.abs(angle - th).max() <= 1e-12
    assert np.abs(found.v[:, crank.v].ravel() - rate).max() <= 1e-12 * W
    cosine, sine = rod_angle(th)
    assert np.abs(found.q[:, piston.q].ravel() - R * np.cos(th) - L * cosine).max() <= 1e-12
    speed = rate * (-R * np.sin(th) + sine * R * np.cos(th) / cosine)
    assert np.abs(found.v[:, piston.v].ravel() - speed).max() <= 1e-11
    wanted = torque_of(th, rate, acceleration)
    assert np.abs(found.forces["drive"].ravel() - wanted).max() <= 1e-10 * np.abs(wanted).max()
    assert max(found.residuals["drift"].max(), found.residuals["drift_rate"].max()) <= 3e-12


@pytest.mark.parametrize(
    ("integrator", "steps", "order"),
    [(rbd.RungeKutta4(), (1e-3, 5e-4), 4), (rbd.TimeStepping(), (1e-3, 5e-4), 2)],
    ids=["RungeKutta4", "TimeStepping"],
)
def test_the_drivers_work_is_in_the_balance_of_energy(integrator, steps, order):
    """Energy made by the steps falls with the integrator's order; the change of energy is the work of the drive."""
    drive, errors = rbd.DrivenJoint("drive", "crank_joint", uneven), []
    for h in steps:
        found = rbd.simulate(turning(uneven), [drive], duration=0.2, step=h, integrator=integrator, progress=False)
        errors.append(np.abs(found.residuals["energy"]).max())
    assert math.log2(errors[0] / errors[1]) > order - 0.4
    rate = np.array([uneven(t)[1] for t in found.t])
    work = np.trapezoid(found.forces["drive"].ravel() * rate, found.t)
    assert abs(work - (found.energy[-1] - found.energy[0])) <= 1e-4 * np.ptp(found.energy)


def test_a_drive_adds_to_the_motor_of_its_joint():
    """The sum tau + f is the torque that drives the joint; the motor's work and the drive's are both in the balance."""
    drive, torque = rbd.DrivenJoint("drive", "crank_joint", uneven), np.array([0.05])
    alone = rbd.simulate(turning(uneven), [drive], duration=0.1, step=1e-3, progress=False)
    helped = rbd.simulate(turning(uneven), [drive], duration=0.1, step=1e-3, controller=lambda s, t: torque, progress=False)
    assert np.abs(alone.forces["drive"] - helped.forces["drive"] - 0.05).max() <= 1e-12
    assert abs(helped.motor_work[-1] - 0.05 * (uneven(0.1)[0] - START)) <= 1e-9
    assert np.abs(helped.residuals["energy"]).max() <= 1e-6


def kapitza(length=0.2, mass=1.0, cart=0.5):
    """An inverted pendulum, a point mass on a rod, on a pivot that moves up and down."""
    model = pin.Model()
    pivot = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "pivot")
    model.appendBodyToJoint(pivot, pin.Inertia(cart, np.zeros(3), 1e-3 * np.eye(3)), pin.SE3.Identity())
    swing = model.addJoint(pivot, pin.JointModelRY(), pin.SE3.Identity(), "swing")
    model.appendBodyToJoint(swing, pin.Inertia(mass, np.array([0.0, 0.0, length]), np.zeros((3, 3))), pin.SE3.Identity())
    return CheckedModel(model, passive=["pivot", "swing"], name="kapitza")


def test_kapitzas_pendulum_stays_up_with_order_four():
    """Mathieu's equation by SciPy at 1e-12: angle with order 4, down to 1e-8; the shaker's force too."""
    a, w, length = 0.01, 300.0, 0.2

    def shake(t):
        return a * math.cos(w * t), -a * w * math.sin(w * t), -a * w * w * math.cos(w * t)

    def rates(t, y):
        return [y[1], (G + shake(t)[2]) / length * math.sin(y[0])]

    exact = solve_ivp(rates, (0.0, 0.3), [0.3, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
    start, errors = rbd.State(kapitza(), [a, 0.3], [0.0, 0.0]), []
    for h in (1e-3, 5e-4, 1e-4):
        found = rbd.simulate(start, [rbd.DrivenJoint("shaker", "pivot", shake)], duration=0.3, step=h, progress=False)
        errors.append(np.abs(found.q[:, 1] - exact.sol(found.t)[0]).max())
    assert abs(math.log2(errors[0] / errors[1]) - 4.0) < 0.1
    assert errors[-1] <= 1e-8
    found = rbd.simulate(
        start, [rbd.DrivenJoint("shaker", "pivot", shake)], duration=0.3, step=1e-2, integrator=rbd.DormandPrince8(),
        progress=False,
    )  # fmt: skip
    angle, rate = exact.sol(found.t)
    assert np.abs(found.q[:, 1] - angle).max() <= 1e-8
    assert np.abs(angle).max() < 0.4  # it stays up, as a w > sqrt(2 g l)
    lift = np.array([shake(t)[2] for t in found.t])
    turn = (G + lift) / length * np.sin(angle)
    force = 1.5 * (G + lift) - length * (turn * np.sin(angle) + rate**2 * np.cos(angle))
    assert np.abs(found.forces["shaker"].ravel() - force).max() <= 1e-7 * np.abs(force).max()


def test_every_form_of_a_motion_is_the_same():
    """A function of s alone, with its derivatives, a constant speed, splines: one motion, to the error that is stated."""
    t = np.linspace(0.0, 0.2, 401)
    spline = make_interp_spline(t, START + W * t + 0.3 * np.sin(20.0 * t), k=7)
    at = ASSEMBLED.at_time(0.123)
    rows = [
        rbd.DrivenJoint("drive", "crank_joint", motion).rows(at)
        for motion in (uneven, lambda s: uneven(s)[0], spline, CubicSpline(t, spline(t)))
    ]
    for r, tolerance in zip(rows[1:], (1e-9, 1e-8, 1e-4), strict=True):
        for what in ("velocity", "bias", "error"):
            assert np.abs(getattr(r, what) - getattr(rows[0], what)).max() <= tolerance * 120.0
    ones = [rbd.DrivenJoint("drive", "crank_joint", m).rows(at) for m in (constant, rbd.Speed(W, start=START))]
    assert ones[0].velocity == ones[1].velocity
    assert ones[0].bias == ones[1].bias


def test_a_motion_is_resumed_at_its_time():
    """A run of two halves is the run as a whole: the state of the first half's end has its time."""
    drive = rbd.DrivenJoint("drive", "crank_joint", uneven)
    whole = rbd.simulate(turning(uneven), [drive], duration=0.1, step=1e-3, progress=False)
    first = rbd.simulate(turning(uneven), [drive], duration=0.05, step=1e-3, progress=False)
    second = rbd.simulate(first.state(-1), [drive], duration=0.05, step=1e-3, progress=False)
    assert second.t[0] == first.t[-1]
    assert abs(second.t[-1] - 0.1) < 1e-12
    assert np.abs(second.q[-1] - whole.q[-1]).max() <= 1e-12
    assert np.abs(second.forces["drive"][-1] - whole.forces["drive"][-1]).max() <= 1e-10


@pytest.mark.parametrize(
    "integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping()], ids=lambda i: type(i).__name__
)
def test_a_jump_of_the_speed_is_refused_with_its_time(integrator):
    """A speed that changes at once at t = 0.0337 s; a jump of the angle; a kink of s' is none."""

    def jumps(t):
        late = max(t - 0.0337, 0.0)
        return START + W * t + 2.0 * late, W + 2.0 * (late > 0.0), 0.0

    def leaps(t):
        return START + W * t + 1e-4 * (t > 0.0337), W, 0.0

    def ramp(t):
        late = max(t - 0.0337, 0.0)
        return START + W * t + 50.0 * late**2, W + 100.0 * late, 100.0 * (late > 0.0)

    for motion in (jumps, leaps):
        drive = rbd.DrivenJoint("drive", "crank_joint", motion)
        with pytest.raises((InputError, SimulationStopped), match=r"'drive' jumps at t = 0\.0337 s, in position or velocity"):
            rbd.simulate(turning(constant), [drive], duration=0.06, step=1e-3, integrator=integrator, progress=False)
    drive = rbd.DrivenJoint("drive", "crank_joint", ramp)
    found = rbd.simulate(turning(constant), [drive], duration=0.06, step=1e-3, integrator=integrator, progress=False)
    assert found.residuals["drift_rate"].max() <= 3e-12


def _drive(motion):
    return lambda: rbd.DrivenJoint("drive", "crank_joint", motion).rows(ASSEMBLED.at_time(0.1))


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (_drive(lambda t: (1.0, 2.0)), r"shape \(2,\); expected s, a number, or with its derivatives, \(s, s', s''\)"),
        (_drive(lambda t: None), "motion of 'drive'"),
        (_drive(lambda t: np.zeros(4)), "expected s, a number"),
        (_drive(lambda t: math.nan), r"motion of 'drive' is .*nan.* at t = 0.1 s; expected finite numbers"),
        (_drive(lambda t: (0.0, 0.0, math.inf)), "expected finite numbers"),
        (_drive(lambda t: 1.0 / 0.0), "raised ZeroDivisionError at t = 0.1 s"),
        (_drive(lambda t: abs(t - 0.1)), "has no derivatives at t = 0.1 s that differences can find"),
        (_drive(3.0), r"motion of 'drive' is 3.0; expected a function"),
        (_drive(rbd.Speed), "expected a function"),
        (_drive(make_interp_spline(np.linspace(0, 1, 9), np.zeros(9), k=1)), "is a spline that is not twice differentiable"),
        (_drive(CubicSpline(np.linspace(0.2, 1, 9), np.zeros(9))), "is a spline from t = 0.2 to 1 s, asked at t = 0.1 s"),
        (lambda: rbd.Speed(math.nan), "rate of a Speed"),
        (lambda: rbd.Speed(1.0, start=(1.0, 2.0)), "start of a Speed"),
        (lambda: ASSEMBLED.at_time(math.nan), "time t of a state is nan"),
        (lambda: rbd.DrivenJoint("drive", "crank", rbd.Speed(1.0)).check(ENGINE), "crank_joint"),
    ],
)
def test_bad_motions_are_refused_in_words(ask, said):
    """A wrong size, NaN, an error of its own, a kink, beyond the ends of a spline."""
    with pytest.raises((InputError, rbd.RbdError), match=said):
        ask()


def lifted(t):
    """A ground that goes up by 0.1 m and back, with its derivatives."""
    w = 2.0 * math.pi
    return [[0.0, 0.0, x] for x in (0.05 * (1.0 - math.cos(w * t)), 0.05 * w * math.sin(w * t), 0.05 * w * w * math.cos(w * t))]


@pytest.mark.parametrize("friction", [None, 0.6])
def test_a_box_stands_on_a_lift(friction):
    """A box on a shaker of 2 m/s2 stays on it to 1e-12 and presses with m (g + a), bilateral and unilateral."""
    box, floor = rbd.testing.box(mass=2.0), rbd.Ground(point=(0, 0, 0), motion=lifted)
    sole = rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.1), friction=friction, on=floor)
    start = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    found = rbd.simulate(start, [sole], duration=1.0, step=1e-2 if friction is None else 2e-3, progress=False)
    height, speed, lift = np.array([[x[2] for x in lifted(t)] for t in found.t]).T
    assert np.abs(found.q[:, 2] - height).max() <= (1e-12 if friction is None else 1e-9)
    assert np.abs(found.v[:, 2] - speed).max() <= 1e-11
    assert np.abs(found.forces["sole"][:, 2] - 2.0 * (G + lift)).max() <= 1e-9
    assert np.abs(found.residuals["energy"]).max() <= 1e-3 * found.kinetic.max() * (1.0 if friction else 0.01)
    rows = sole.rows(start.at_time(0.25))
    assert abs(rows.patch.gaps[0] + 0.05) <= 1e-12
    assert abs(rows.velocity[2] + 0.1 * math.pi) <= 1e-12


def test_a_ball_leaves_a_shaker_where_it_falls_faster_than_gravity():
    """A point on a plate z = a (1 - cos w t) with a w^2 = 2 g leaves it where a w^2 cos w t = -g, and flies a parabola."""
    a, w = 0.01, math.sqrt(2.0 * G / 0.01)
    plate = rbd.Ground(
        point=(0, 0, 0), motion=lambda t: np.array([[0, 0, a * (1 - math.cos(w * t))], [0, 0, a * w * math.sin(w * t)],
                                                    [0, 0, a * w * w * math.cos(w * t)]])
    )  # fmt: skip
    ball = rbd.PointContact("ball", "box", friction=0.0, on=plate)
    start = rbd.State(rbd.testing.box(mass=1.0), [0, 0, 0, 0, 0, 0, 1])
    leaves = (2.0 * math.pi / 3.0) / w
    flight = []
    for h in (1e-3, 5e-4):
        found = rbd.simulate(start, [ball], duration=leaves + 0.03, step=h, progress=False)
        t = found.t - leaves
        up = a * 1.5 + a * w * math.sin(w * leaves) * t - 0.5 * G * t * t
        flight.append(np.abs(found.q[t > 0.0, 2] - up[t > 0.0]).max())
        assert [event.kind for event in found.events] == ["leaves"]
    assert flight[1] <= 2e-6
    assert np.abs(found.forces["ball"][t > 2e-3]).max() == 0.0


def test_velocities_are_driven_as_a_function_of_time():
    """A v = b(t): two joints that turn against each other at a rate of time, by b alone and with its rate; solve agrees."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
    b, rate = (lambda t: 0.5 * math.sin(3.0 * t)), (lambda t: 1.5 * math.cos(3.0 * t))
    start = arm.at([0.0, 0.5])
    for belt in (rbd.VelocityConstraint("belt", [1.0, 1.0], b=b), rbd.VelocityConstraint("belt", [1.0, 1.0], b=b, b_rate=rate)):
        found = rbd.simulate(start, [belt], duration=0.5, step=1e-3, progress=False)
        given = np.array([b(t) for t in found.t])
        assert np.abs(found.v.sum(axis=1) - given).max() <= 1e-12
        assert np.abs(found.residuals["energy"]).max() <= 1e-9
        again = rbd.solve(found.state(250), found.tau[250], [belt])
        assert np.abs(again.a - found.a[250]).max() <= 1e-9
        assert abs(again.a.sum() - rate(found.t[250])) <= 1e-9


def test_two_drives_of_a_joint_contradict_each_other():
    """Named with their joint; a lock and a drive; a drive into a stop, of which a proof names all that takes part."""
    one = rbd.DrivenJoint("one", "crank_joint", constant)
    for other in (rbd.DrivenJoint("other", "crank_joint", uneven), rbd.JointLock("other", "crank_joint")):
        for ask in (rbd.solve, lambda *given: rbd.simulate(given[0], given[2], duration=0.1, step=1e-2)):
            with pytest.raises(InputError, match="'one' and 'other' both prescribe the motion of joint 'crank_joint'"):
                ask(turning(constant), [0.0], [one, other])
    into = rbd.DrivenJoint("into", "crank_joint", lambda t: (START + 50.0 * t * t, 100.0 * t, 100.0))
    stop = rbd.JointLimit("stop", "slider_joint", lower=float(ASSEMBLED.q[-1]))
    with pytest.raises(rbd.NoSolution, match="'into', 'stop' and 'wrist_pin' .* contradict each other"):
        rbd.solve(ASSEMBLED, [0.0], [into, stop])


def test_statics_and_inverse_dynamics_leave_the_torque_to_the_drive():
    """A drive at rest holds the crank, and its motor gives nothing; a drive that moves is refused in words."""
    still = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(0.0, start=START))
    held = rbd.hold(ASSEMBLED, [still])
    assert abs(held.tau[0]) <= 1e-3 * abs(held.forces["drive"][0])
    assert abs(held.tau[0] + held.forces["drive"][0] - torque_of(START, 0.0, 0.0)) <= 1e-12
    with pytest.raises(rbd.errors.NotAtRest, match="what 'drive' touches, or drives, moves"):
        rbd.hold(ASSEMBLED, [rbd.DrivenJoint("drive", "crank_joint", constant)])
    drive, state = rbd.DrivenJoint("drive", "crank_joint", uneven), turning(uneven)
    moves = rbd.inverse_dynamics(state, rbd.solve(state, [0.0], [drive]).a, [drive])
    assert abs(moves.tau[0]) <= 1e-3 * abs(moves.forces["drive"][0])
    assert abs(moves.tau[0] + moves.forces["drive"][0] - torque_of(*uneven(0.0))) <= 1e-10


def test_a_mechanism_is_assembled_where_its_drive_is_at_a_time():
    """`assemble` and `project_velocity` at t: on the loop and on the drive."""
    drive = rbd.DrivenJoint("drive", "crank_joint", uneven)
    there = rbd.State(ENGINE, rbd.mechanism.assemble(ASSEMBLED.at_time(0.07), [drive]).q, t=0.07)
    moving = rbd.mechanism.project_velocity(there, [drive])
    rows = drive.rows(moving)
    assert max(abs(rows.error[0]), abs(rows.velocity[0])) <= 1e-10
    assert abs(rbd.solve(moving, [0.0], [drive]).forces["drive"][0] - torque_of(*uneven(0.07))) <= 1e-9


def test_what_depends_on_time_is_checked_by_time():
    """`check_constraint` at a time: drives, velocities, ground that moves; it finds a rate of the wrong sign."""
    box = rbd.State(rbd.testing.box(), [0, 0, 0.05, 0.1, 0.7, 0.1, 0.7], t=0.05)
    ground = rbd.Ground(point=(0, 0, 0), normal=(0.6, 0, 0.8), motion=lambda t: (0.1 * math.sin(3 * t), 0, 0.2 * t * t))
    at = turning(uneven).at_time(0.05)
    for constraint, state in (
        (rbd.DrivenJoint("drive", "crank_joint", uneven), at),
        (rbd.DrivenJoint("drive", "crank_joint", lambda t: uneven(t)[0]), at),
        (rbd.VelocityConstraint("row", [1.0, 0.2, 0.3], b=math.cos), at),
        (rbd.PointContact("toe", "box", on=ground).anchored(box), box),
        (rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.1), on=ground), box),
        (rbd.RollingBall("ball", "box", radius=0.05, on=ground), box),
    ):
        rbd.testing.check_constraint(constraint, state)
    wrong = rbd.DrivenJoint("wrong", "crank_joint", lambda t: (math.sin(t), -math.cos(t), -math.sin(t)))
    with pytest.raises(rbd.testing.ConstraintWrong, match="'wrong': bias, by time"):
        rbd.testing.check_constraint(wrong, at)


def test_feedback_and_impacts_take_a_drive():
    """Baumgarte's feedback keeps to it; an impact brings the crank to the drive's speed at once."""
    drive = rbd.DrivenJoint("drive", "crank_joint", uneven)
    by = rbd.constraints.Baumgarte(100.0)
    found = rbd.simulate(turning(uneven), [drive], duration=0.05, step=1e-3, stabilisation=by, progress=False)
    assert found.residuals["drift"].max() <= 1e-7
    met = rbd.impact(ASSEMBLED, [drive])
    assert abs(met.state.v[0] - uneven(0.0)[1]) <= 1e-9


def test_many_states_have_their_times():
    """`solve_many` and `inverse_dynamics_many` at the times of a trajectory answer as one by one; without times at t = 0."""
    drive = rbd.DrivenJoint("drive", "crank_joint", uneven)
    found = rbd.simulate(turning(uneven), [drive], duration=0.02, step=2e-3, progress=False)
    many = rbd.solve_many(ENGINE, found.q, found.v, None, [drive], t=found.t)
    assert np.abs(many.forces["drive"] - found.forces["drive"]).max() <= 1e-10
    moves = rbd.control.inverse_dynamics_many(ENGINE, found.q, found.v, found.a, [drive], t=found.t)
    assert np.abs(moves.forces["drive"] + moves.tau - found.forces["drive"]).max() <= 1e-9
    first = rbd.solve_many(ENGINE, found.q[:1], found.v[:1], None, [drive])
    assert np.abs(first.forces["drive"] - found.forces["drive"][:1]).max() <= 1e-10


def test_the_content_of_a_drive_and_of_a_state_is_that_of_its_time():
    """Keys of stored answers: the same before and after a drive was used, and in a copy; another at another time."""
    drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(W, start=START))
    before = digest(drive)
    rbd.simulate(turning(constant), [drive], duration=0.01, step=1e-3, progress=False)
    assert digest(drive) == before == digest(pickle.loads(pickle.dumps(drive)))
    assert digest(ASSEMBLED) == digest(ASSEMBLED.at_time(0.0)) != digest(ASSEMBLED.at_time(0.1))
