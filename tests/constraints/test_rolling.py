"""Balls, disks and wheels on planes: rolling, slipping, spinning, on turntables and belts, against closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import free, state_of

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import box, check_constraint

G = 9.81
HERE = pin.SE3.Identity()
UP = np.array([0.0, 0.0, 1.0])
SOLVERS = [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()]
EACH_SOLVER = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
MOVING = {"velocity": (0.3, -0.2, 0.5, 0.4, 0.3, -0.7), "acceleration": (1, 2, 3, 0.3, 0.2, 0.1), "about": (0.3, 0.4, 0.5)}
KINDS = {
    "ball": lambda **more: rbd.RollingBall("it", "body", radius=0.3, **more),
    "disk": lambda **more: rbd.RollingDisk("it", "body", radius=0.3, axis=(0.2, 1.0, 0.3), **more),
    "wheel": lambda **more: rbd.RollingWheel("it", "body", radius=0.3, axis=(0.2, 1.0, 0.3), **more),
}


def world(state: rbd.State, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration of the body's origin, and its angular acceleration, in world axes."""
    R, v = pin.XYZQUATToSE3(state.q).rotation, state.v
    return R @ (a[:3] + np.cross(v[3:], v[:3])), R @ a[3:]


def solid_ball(m: float, r: float) -> CheckedModel:
    """A ball of uniform density."""
    return free(pin.Inertia.FromSphere(m, r))


@pytest.fixture
def tumbling(rng: np.random.Generator) -> rbd.State:
    """A body with no symmetry, anyhow."""
    robot = free(pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3))
    return rbd.State(robot, pin.integrate(robot.model, pin.neutral(robot.model), rng.normal(size=6)), rng.normal(size=6))


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.6, 0, 0.8)])
@pytest.mark.parametrize("friction", [None, 0.5, 0.0])
@pytest.mark.parametrize("kind", KINDS)
def test_what_rolls_describes_its_motion(tumbling, kind, friction, normal):
    """The height's two derivatives, and the change of the other rows along the motion, off the plane and slipping."""
    for more in ({}, MOVING):
        rolling = KINDS[kind](friction=friction, on=rbd.Ground(normal=normal, point=(0.1, 0.2, 0.3), **more))
        report = check_constraint(rolling, tumbling)
        assert report.rows == (1 if friction == 0.0 else 2 if kind == "wheel" and friction is None else 3)
        assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_the_velocity_of_the_material_point_that_touches(tumbling, kind):
    """J v against differences of that point's place, and its place against the lowest of all points of the body."""
    n = np.array([0.6, 0.0, 0.8])
    rows = KINDS[kind](on=rbd.Ground(normal=n, point=(0.0, 0.0, 0.0)), friction=0.4).rows(tumbling)
    X, h = pin.XYZQUATToSE3(tumbling.q), 1e-5
    p, R = rows.patch.point, rows.patch.axes
    material = X.actInv(p)
    model = tumbling.robot.model
    ends = [pin.XYZQUATToSE3(pin.integrate(model, tumbling.q, s * h * tumbling.v)).act(material) for s in (1.0, -1.0)]
    assert np.abs(R @ rows.velocity - (ends[0] - ends[1]) / (2.0 * h)).max() < 1e-8
    turn = np.linspace(0.0, 2.0 * np.pi, 4001)
    if kind == "ball":
        assert p == pytest.approx(X.translation - 0.3 * n)
    else:
        e = np.array([0.2, 1.0, 0.3]) / np.linalg.norm([0.2, 1.0, 0.3])
        x = np.cross(e, UP) / np.linalg.norm(np.cross(e, UP))
        rim = X.translation + 0.3 * (np.outer(np.cos(turn), x) + np.outer(np.sin(turn), np.cross(e, x))) @ X.rotation.T
        assert 0.0 <= (rim @ n).min() - p @ n < 1e-6 and np.linalg.norm(p - X.translation) == pytest.approx(0.3)
        assert R[:, 0] @ np.cross(X.rotation @ e, n) > 0.0  # a positive spin rolls it that way
    assert rows.error[2] == pytest.approx(p @ n) and np.abs(R.T @ R - np.eye(3)).max() < 1e-15


@pytest.mark.parametrize("kind", KINDS)
def test_a_plane_that_moves_is_seen_from_itself(tumbling, kind):
    """A rigid plane that flies, turns and tilts: rows by time, plane and body both moved, against J a + J_dot v."""
    normal, about = np.array([0.6, 0.0, 0.8]), np.array(MOVING["about"])
    u, s = np.array(MOVING["velocity"]), np.array(MOVING["acceleration"], float)
    point = np.array([0.1, 0.2, 0.3])
    a = np.random.default_rng(8).normal(size=6)
    model, v = tumbling.robot.model, tumbling.v

    def seen(t: float) -> np.ndarray:
        """Rows' velocity at t in axes that the plane carries (of a disk: in those that it has then)."""
        turn = pin.exp3(u[3:] * t + 0.5 * s[3:] * t * t)  # W and W' at t = 0
        there = about + u[:3] * t + 0.5 * s[:3] * t * t
        now = {
            "velocity": np.r_[u[:3] + s[:3] * t, u[3:] + s[3:] * t],
            "about": there,
            "point": there + turn @ (point - about),
            "normal": turn @ normal,
        }
        q = pin.integrate(model, tumbling.q, v * t + 0.5 * a * t * t)
        rows = KINDS[kind](friction=0.5, on=rbd.Ground(**now)).rows(rbd.State(tumbling.robot, q, v + a * t))
        R0 = rows.patch.axes
        if kind != "ball":
            return rows.velocity
        return (
            KINDS[kind](friction=0.5, on=rbd.Ground(normal=normal, point=(0.0, 0.0, 0.0))).rows(tumbling).patch.axes.T
            @ turn.T
            @ R0
            @ rows.velocity
        )

    rows = KINDS[kind](friction=0.5, on=rbd.Ground(normal=normal, point=point, **MOVING)).rows(tumbling)
    h = 1e-3
    found = sum(w * seen(k * h) for k, w in zip((-3, -2, -1, 1, 2, 3), (-1, 9, -45, 45, -9, 1), strict=True)) / (60.0 * h)
    assert np.abs(rows.velocity - seen(0.0)).max() < 1e-14
    assert np.abs(rows.J @ a + rows.bias - found).max() < 1e-9


@EACH_SOLVER
@pytest.mark.parametrize("spin", [0.0, 40.0])
def test_a_ball_rolls_down_an_incline_with_five_sevenths(spin, solver):
    """Down it goes with 5/7 g sin(b) whatever it spins, and the plane carries m g cos(b) and 2/7 m g sin(b)."""
    m, r, b = 2.0, 0.15, 0.4
    n, down = np.array([np.sin(b), 0.0, np.cos(b)]), np.array([np.cos(b), 0.0, -np.sin(b)])
    speed = 1.3 * down + 0.4 * np.cross(n, down)
    w = np.cross(n, speed) / r + spin * n
    state = state_of(solid_ball(m, r), pin.exp3(np.array([0.3, -0.5, 0.9])), r * n, speed, w)
    ball = rbd.RollingBall("ball", "body", radius=r, on=rbd.Ground(normal=n, point=(0.0, 0.0, 0.0)))
    assert ball.rows(state).speed < 1e-14
    s = rbd.solve(state, np.zeros(0), [ball], solver=solver)
    a, turn = world(state, s.a)
    assert np.abs(a - 5.0 / 7.0 * G * np.sin(b) * down).max() < 1e-9
    assert np.abs(turn - np.cross(n, a) / r).max() < 1e-8
    assert np.abs(s.forces["ball"] - m * G * (np.cos(b) * n - 2.0 / 7.0 * np.sin(b) * down)).max() < 1e-8
    assert s.residuals.centroidal < 1e-9


def test_a_material_point_is_no_rolling_contact():
    """A ball that rolls, as a PointContact: held, it is dragged into the ground with w^2 r; pressing, it seems to lift off."""
    m, r = 1.0, 0.1
    w = np.array([0.0, 30.0, 0.0])
    state = state_of(solid_ball(m, r), np.eye(3), [0.0, 0.0, r], np.array([3.0, 0.0, 0.0]), w)
    rolls = rbd.solve(state, np.zeros(0), [rbd.RollingBall("ball", "body", radius=r)])
    sticks, presses = (
        rbd.solve(state, np.zeros(0), [rbd.PointContact("ball", "body", offset=(0, 0, -r), friction=f)]) for f in (None, 0.5)
    )
    assert rolls.forces["ball"] == pytest.approx([0.0, 0.0, m * G], abs=1e-9) and np.abs(world(state, rolls.a)[0]).max() < 1e-10
    assert world(state, sticks.a)[0][2] == pytest.approx(-(30.0**2) * r)
    assert np.abs(presses.forces["ball"]).max() < 1e-9  # so it would fall through


@pytest.mark.parametrize("spin", [0.0, 25.0])
def test_a_ball_slips_then_rolls(spin):
    """It has -mu g and 5 mu g / 2 r while it slips, spinning too; after 2 v0 / (7 mu g) it rolls, with 5/7 v0, and stays so."""
    m, r, mu, v0 = 1.5, 0.11, 0.2, 2.0
    robot, ball = solid_ball(m, r), rbd.RollingBall("ball", "body", radius=r, friction=mu)
    robot_state = state_of(robot, np.eye(3), [0.0, 0.0, r], np.array([v0, 0.0, 0.0]), np.array([0.0, 0.0, spin]))
    s = rbd.solve(robot_state, np.zeros(0), [ball], solver=rbd.ConeSolver())
    a, turn = world(robot_state, s.a)
    assert np.abs(a - [-mu * G, 0.0, 0.0]).max() < 1e-8
    assert np.abs(turn - [0.0, 2.5 * mu * G / r, 0.0]).max() < 1e-7
    assert s.contacts["ball"].friction_used == pytest.approx(1.0) and s.law.kind == "coulomb"
    t = 2.0 * v0 / (7.0 * mu * G)  # the accelerations stay, so this is exact
    v, w = np.array([v0 + a[0] * t, 0.0, 0.0]), np.array([0.0, turn[1] * t, spin])
    later = state_of(robot, np.eye(3), [v0 * t, 0.0, r], v, w)
    assert later.v[0] == pytest.approx(5.0 / 7.0 * v0) and ball.rows(later).speed < 1e-8
    for solver in (rbd.ConeSolver(), rbd.ProxQP()):
        s = rbd.solve(later, np.zeros(0), [ball], solver=solver)
        assert np.abs(s.a - np.r_[-np.cross(later.v[3:], later.v[:3]), np.zeros(3)]).max() < 1e-8
        assert s.contacts["ball"].friction_used < 1e-7


@pytest.mark.parametrize(("mu", "rolls"), [(0.4948, False), (0.495, True)])
def test_a_ball_rolls_on_an_incline_while_friction_lasts(mu, rolls):
    """From rest at 60 deg: it needs mu = 2/7 tan(60 deg) = .494872; with less it slides with g (sin - mu cos)."""
    m, r, b = 1.0, 0.2, np.deg2rad(60.0)
    n, down = np.array([np.sin(b), 0.0, np.cos(b)]), np.array([np.cos(b), 0.0, -np.sin(b)])
    state = state_of(solid_ball(m, r), np.eye(3), r * n, np.zeros(3), np.zeros(3))
    ball = rbd.RollingBall("ball", "body", radius=r, on=rbd.Ground(normal=n, point=(0.0, 0.0, 0.0)), friction=mu)
    s = rbd.solve(state, np.zeros(0), [ball], solver=rbd.ConeSolver())
    slides = G * (np.sin(b) - mu * np.cos(b))
    assert (5.0 / 7.0 * G * np.sin(b) > slides) == rolls
    expected = 5.0 / 7.0 * G * np.sin(b) if rolls else slides
    assert np.abs(world(state, s.a)[0] - expected * down).max() < 1e-8


@pytest.mark.parametrize("friction", [None, 0.6])
@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_a_ball_on_a_turntable_circles_at_two_sevenths(tilt, friction):
    """It has 2/7 W x v, plus 5/7 of gravity along a table that leans, wherever it is and whatever it spins."""
    m, r, W = 0.7, 0.08, 3.0
    n, down = np.array([np.sin(tilt), 0.0, np.cos(tilt)]), np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    axis_at = np.array([0.5, -0.2, 0.3])
    along, across = 0.6 * down, np.cross(n, down)
    p = axis_at + 0.7 * down + 0.3 * across
    v = along - 0.9 * across
    w = np.cross(n, v - np.cross(W * n, p - axis_at)) / r + 5.0 * n
    table = {"point": axis_at, "about": axis_at, "velocity": np.r_[np.zeros(3), W * n]}
    ball = rbd.RollingBall("ball", "body", radius=r, on=rbd.Ground(normal=n, **table), friction=friction)
    state = state_of(solid_ball(m, r), pin.exp3(np.array([0.1, 0.2, 0.3])), p + r * n, v, w)
    assert ball.rows(state).speed < 1e-14
    for solver in [rbd.KKT()] * (friction is None) + [rbd.ProxQP(), rbd.ConeSolver()]:
        a, _ = world(state, rbd.solve(state, np.zeros(0), [ball], solver=solver).a)
        assert np.abs(a - 2.0 / 7.0 * W * np.cross(n, v) - 5.0 / 7.0 * G * np.sin(tilt) * down).max() < 1e-8


def test_a_ball_lies_still_on_the_level_alone():
    """Statics: the floor holds it with its weight; on an incline nothing does, however rough."""
    m, r, b = 1.2, 0.1, 0.02
    robot = solid_ball(m, r)
    level = state_of(robot, np.eye(3), [0.3, 0.2, r], np.zeros(3), np.zeros(3))
    for friction in (None, 0.5):
        held = rbd.hold(level, [rbd.RollingBall("floor", "body", radius=r, friction=friction)])
        assert np.abs(held.forces["floor"] - [0.0, 0.0, m * G]).max() < 1e-9
        n = np.array([np.sin(b), 0.0, np.cos(b)])
        with pytest.raises(rbd.CannotHold):
            p = [0.3, 0.2, r] - r * n
            rbd.hold(level, [rbd.RollingBall("slope", "body", radius=r, on=rbd.Ground(normal=n, point=p), friction=friction)])


def test_a_ball_on_a_plank_that_speeds_up_keeps_two_sevenths_of_it():
    """A plank pulled at A under a ball at rest on it: a = 2/7 A."""
    A = np.array([1.4, -0.7, 0.0])
    state = state_of(solid_ball(1.0, 0.1), np.eye(3), [0, 0, 0.1], np.array([0.5, 0.0, 0.0]), np.zeros(3))
    plank = rbd.RollingBall(
        "ball", "body", radius=0.1, on=rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.5, 0, 0), acceleration=A)
    )
    assert plank.rows(state).speed == 0.0
    assert np.abs(world(state, rbd.solve(state, np.zeros(0), [plank]).a)[0] - 2.0 / 7.0 * A).max() < 1e-9


def _leaning(th: float, w: np.ndarray, heading: float, r: float, seed: int) -> tuple[np.ndarray, ...]:
    """(R, up, t, e) of a disk whose axis e stands th off the vertical, spun by any angle; w in those axes, to the world."""
    turn = pin.exp3(UP * heading)
    e, up = turn @ [0.0, np.sin(th), np.cos(th)], turn @ [0.0, -np.cos(th), np.sin(th)]
    t = np.cross(e, up)
    R = np.column_stack([t, e, np.cross(t, e)]) @ pin.exp3(np.array([0.0, float(seed), 0.0]))
    return R, up, t, e, w[0] * t + w[1] * up + w[2] * e


@EACH_SOLVER
@pytest.mark.parametrize("th", [0.3, 1.2, np.pi / 2, 2.0])
def test_a_leaning_disk_obeys_its_equations(th, solver):
    """A thin disk (A = m r^2/4, C = m r^2/2), its angular velocity along its up, its heading t, its axis e.

        (A + m r^2) w_t' = (C + m r^2) w_u w_e - A w_u^2 cot th + m g r cos th
        A w_u' = -C w_t w_e + A w_t w_u cot th         (C + m r^2) w_e' = -m r^2 w_t w_u

    Newton and Euler about the centre, the contact's force left out.
    """
    m, r = 1.3, 0.25
    A, C = 0.25 * m * r**2, 0.5 * m * r**2
    wt, wu, we = w = np.array([0.7, -1.1, 6.0])
    R, up, t, e, w_W = _leaning(th, w, 0.6, r, 2)
    cot = np.cos(th) / np.sin(th)
    robot = free(pin.Inertia(m, np.zeros(3), np.diag([A, C, A])))
    state = state_of(robot, R, r * np.sin(th) * UP + [0.3, 0.4, 0.0], r * np.cross(w_W, up), w_W)
    disk = rbd.RollingDisk("disk", "body", radius=r)
    rows = disk.rows(state)
    assert rows.speed < 1e-14 and abs(rows.error[2]) < 1e-15
    dt = ((C + m * r**2) * wu * we - A * wu**2 * cot + m * G * r * np.cos(th)) / (A + m * r**2)
    du = (-C * wt * we + A * wt * wu * cot) / A
    de = -m * r**2 * wt * wu / (C + m * r**2)
    frame = wt * t + wu * up + wu * cot * e
    turn = dt * t + du * up + de * e + np.cross(frame, w_W)
    s = rbd.solve(state, np.zeros(0), [disk], solver=solver)
    a, found = world(state, s.a)
    assert np.abs(found - turn).max() < 1e-7 * np.abs(turn).max()
    along = r * ((de + wt * wu) * t + (-dt + wu * we) * e + (-(wt**2) - we * wu * cot) * up)  # of v = r (w_e t - w_t e)
    assert np.abs(a - along).max() < 1e-7 * np.abs(along).max()
    assert np.abs(s.forces["disk"] - m * (along + G * UP)).max() < 1e-7 * m * np.abs(along).max()


def test_a_disk_rolls_steadily_in_a_circle():
    """Leaning th, precessing at W: (C + m r^2) W w_e sin th = A W^2 sin th cos th - m g r cos th keeps the lean."""
    m, r, th, W = 1.0, 0.3, 1.0, -2.5
    A, C = 0.25 * m * r**2, 0.5 * m * r**2
    we = (A * W**2 * np.sin(th) * np.cos(th) - m * G * r * np.cos(th)) / ((C + m * r**2) * W * np.sin(th))
    R, up, _, e, w_W = _leaning(th, np.array([0.0, W * np.sin(th), we]), 0.0, r, 1)
    robot = free(pin.Inertia(m, np.zeros(3), np.diag([A, C, A])))
    v = r * np.cross(w_W, up)
    state = state_of(robot, R, r * np.sin(th) * UP, v, w_W)
    for solver in SOLVERS:
        a, turn = world(state, rbd.solve(state, np.zeros(0), [rbd.RollingDisk("disk", "body", radius=r)], solver=solver).a)
        assert np.abs(turn - np.cross(W * UP, w_W)).max() < 1e-8 and np.abs(a - np.cross(W * UP, v)).max() < 1e-9


@pytest.mark.parametrize(("torque", "slips"), [(1.0, False), (5.0, True)])
def test_a_wheel_that_is_driven_rolls_until_it_slips(torque, slips):
    """A hoop-like wheel with a torque: a = M r / (C + m r^2) while C, m and M ask for less than mu m g, else mu g."""
    m, r, C, mu = 2.0, 0.3, 0.05, 0.4
    robot = free(pin.Inertia(m, np.zeros(3), np.diag([0.03, C, 0.03])))
    state = state_of(robot, np.eye(3), r * UP, np.zeros(3), np.zeros(3))
    wheel = rbd.RollingWheel("wheel", "body", radius=r, friction=mu)
    s = rbd.solve(state, np.zeros(0), [wheel], external=np.array([0, 0, 0, 0, torque, 0.0]), solver=rbd.ConeSolver())
    rolls = torque * r / (C + m * r**2)
    assert (rolls > mu * G) == slips
    assert s.a[0] == pytest.approx(mu * G if slips else rolls) and abs(s.a[2]) < 1e-9
    assert s.a[4] == pytest.approx((torque - mu * m * G * r) / C if slips else rolls / r)


def _vehicle() -> CheckedModel:
    """A car on a planar joint, two wheels of 0.1 m on an axle of 0.5 m; motors on the wheels."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])), "plane")
    model.appendBodyToJoint(base, pin.Inertia(4.0, np.zeros(3), np.diag([0.1, 0.1, 0.2])), HERE)
    for side, y in (("left", 0.25), ("right", -0.25)):
        wheel = model.addJoint(base, pin.JointModelRUBY(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), side)
        model.appendBodyToJoint(wheel, pin.Inertia(0.5, np.zeros(3), np.diag([0.002, 0.003, 0.002])), HERE)
        model.addFrame(pin.Frame(f"{side}_wheel", wheel, 0, HERE, pin.FrameType.OP_FRAME))
    return CheckedModel(model, passive=["plane"], name="vehicle")


@EACH_SOLVER
def test_a_two_wheeled_vehicle_drives_by_the_difference_of_its_wheels(solver):
    """Torques give m v' = (M_l + M_r) / r and I w' = b (M_r - M_l) / 2 r, spinning wheels counted in m and I.

    The car has v = r (left + right) / 2, w = r (right - left) / b; no row speaks of a height that cannot change.
    """
    r, b = 0.1, 0.5
    robot = _vehicle()
    wheels = [rbd.RollingWheel(side, f"{side}_wheel", radius=r) for side in ("left", "right")]
    q = np.array([0.3, 0.1, np.cos(0.7), np.sin(0.7), 1.0, 0.0, 0.0, 1.0])
    v = np.array([0.5 * r * (4.0 + 7.0), 0.0, r * (7.0 - 4.0) / b, 4.0, 7.0])
    state = rbd.State(robot, q, v)
    J = np.vstack([w.rows(state).J for w in wheels])
    assert J.shape == (4, 5) and np.linalg.matrix_rank(J) == 3 and np.abs(J @ v).max() < 1e-15  # the side is told twice
    tau = np.array([0.7, 0.2])
    s = rbd.solve(state, tau, wheels, solver=solver)
    mass = 4.0 + 2 * 0.5 + 2 * 0.003 / r**2
    inertia = 0.2 + 2 * (0.5 * 0.25**2 + 0.002) + 2 * 0.003 * (0.5 * b / r) ** 2
    forward, turn = tau.sum() / r / mass, (tau[1] - tau[0]) * 0.5 * b / r / inertia
    expected = [forward, 0.0, turn, (forward - 0.5 * b * turn) / r, (forward + 0.5 * b * turn) / r]
    assert np.abs(s.a - expected).max() < 1e-9 and s.status == "solved"
    side = sum(f for f in s.forces.values()) @ [-np.sin(0.7), np.cos(0.7), 0.0]
    assert side == pytest.approx(5.0 * v[0] * v[2])  # what turns the way of its centre


def test_friction_on_a_vehicle_that_cannot_press_is_refused():
    """On a planar joint the normal row is empty, and friction would be nothing."""
    robot = _vehicle()
    wheel = rbd.RollingWheel("left", "left_wheel", radius=0.1, friction=0.5)
    with pytest.raises(rbd.InputError, match="no normal force, as .* plane. Use friction=None"):
        wheel.rows(rbd.State(robot, pin.neutral(robot.model)))


@pytest.mark.parametrize("kind", KINDS)
def test_what_has_risen_is_pulled_back_by_its_height_alone(kind):
    """Baumgarte: w^2 error on the normal row, 2 zeta w velocity on all of them."""
    robot = free(pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3))
    state = state_of(robot, np.eye(3), 0.35 * UP, np.array([0.1, 0.2, 0.3]), np.zeros(3))
    rolling = KINDS[kind]()
    rows = rbd.constraints.Baumgarte(10.0).of(rolling).rows(state)
    expected = 20.0 * rows.velocity
    if kind != "wheel":
        assert rows.error[2] > 0.04
        expected[2] += 100.0 * rows.error[2]
    assert np.abs(rows.feedback - expected).max() < 1e-12
    assert rows.holonomic.tolist() == [False, False, True][: len(rows)] and not rows.error[:2].any()


@pytest.mark.parametrize("kind", ["disk", "wheel"])
def test_a_disk_that_lies_flat_is_refused(kind):
    """Its rim touches all round."""
    make = rbd.RollingDisk if kind == "disk" else rbd.RollingWheel
    with pytest.raises(rbd.InputError, match="lies flat on its plane"):
        make("coin", "box", radius=0.1, axis=(0, 0, 1)).rows(rbd.State(box(), pin.neutral(box().model)))


@pytest.mark.parametrize("friction", [None, 0.5, 0.0])
@pytest.mark.parametrize("kind", KINDS)
def test_what_rolls_on_a_body_describes_its_motion(rng, kind, friction):
    """The height above the body's plane and its two derivatives, and the change of the other rows, both bodies tumbling."""
    pair = rbd.robots.merge_robots(
        free(pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3)), free(pin.Inertia.FromBox(3.0, 0.4, 0.2, 0.3)), names=("", "t_")
    )
    state = pair.at(pin.integrate(pair.model, pair.neutral(), rng.normal(size=12)), rng.normal(size=12))
    rolling = KINDS[kind](friction=friction, on=rbd.Body("t_body", normal=(0.6, 0.0, 0.8)))
    report = check_constraint(rolling, state)
    assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9
    alone = KINDS[kind](friction=friction, on=rbd.Ground(
        normal=state.frame("t_body").X_WF.rotation @ [0.6, 0.0, 0.8], point=state.frame("t_body").X_WF.translation,
        velocity=state.frame("t_body").v, about=state.frame("t_body").X_WF.translation,
        acceleration=state.frame("t_body").bias))  # fmt: skip
    ours, theirs = rolling.rows(state), alone.rows(rbd.State(pair.members[0], state.q[:7], state.v[:6]))
    turn = ours.patch.axes.T @ theirs.patch.axes if len(ours) == 3 and kind == "ball" else np.eye(len(ours))
    assert np.abs(ours.velocity - turn @ theirs.velocity).max() < 1e-13
    assert np.abs(ours.bias - turn @ theirs.bias).max() < 1e-12


@EACH_SOLVER
def test_a_ball_on_a_free_plank_holds_it_back_with_two_sevenths_of_its_mass(solver):
    """F = (M + 2/7 m) a of a plank on ice pulled under a ball, which gains 2/7 a."""
    m, M, F, r = 1.4, 3.0, 6.0, 0.1
    pair = rbd.robots.merge_robots(solid_ball(m, r), box(M, (1.0, 1.0, 0.2)), names=("ball_", ""))
    top = rbd.Body("box", normal=(0.0, 0.0, 1.0))
    state = pair.at(pair.q(np.r_[0.0, 0.0, r, 0, 0, 0, 1.0], np.r_[0, 0, 0, 0, 0, 0, 1.0]))
    ball = rbd.RollingBall("ball", "ball_body", radius=r, on=top)
    held = rbd.VelocityConstraint("level", np.c_[np.zeros((5, 6)), np.eye(6)[1:]])  # the plank slides along x alone
    s = rbd.solve(state, np.zeros(0), [ball, held], external=rbd.ExternalForce("box", (F, 0.0, 0.0)), solver=solver)
    a = F / (M + 2.0 / 7.0 * m)
    assert s.a[6] == pytest.approx(a) and s.a[0] == pytest.approx(2.0 / 7.0 * a)
    assert s.forces["ball"] == pytest.approx([m * 2.0 / 7.0 * a, 0.0, m * G], abs=1e-8)


@pytest.mark.parametrize("kind", [rbd.RollingBall, rbd.RollingDisk, rbd.RollingWheel])
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"radius": 0.0}, r"radius of 'it' is 0.0; expected a length > 0"),
        ({"radius": np.nan}, "radius of 'it'"),
        ({"radius": "1"}, "radius of 'it'"),
        ({"friction": -0.1}, "friction"),
        ({"friction": 0.5, "facets": 2}, "facets"),
        ({"on": rbd.Ground(normal=(0, 0, 1))}, "on of 'it' is .*with a point"),
        ({"on": None}, "on of 'it' is None; expected rbd.Ground"),
        ({"on": "floor"}, "on of 'it' is 'floor'; expected rbd.Ground"),
        ({"on": rbd.Body("body")}, "between 'body' and itself"),
        ({"name": ""}, "the name of what rolls"),
        ({"frame": None}, "the frame of what rolls"),
    ],
)
def test_what_rolls_nowhere_is_refused(kind, given, words):
    """At once, with what came and what was expected."""
    with pytest.raises(rbd.InputError, match=words):
        kind(**({"name": "it", "frame": "body", "radius": 0.1} | given))


def test_an_axis_of_no_length_is_refused():
    """Of a disk and of a wheel."""
    for kind in (rbd.RollingDisk, rbd.RollingWheel):
        with pytest.raises(rbd.InputError, match="axis of 'it' has length 0"):
            kind("it", "body", radius=0.1, axis=(0, 0, 0))
