"""Worlds against closed forms: blocks on slopes, drops, joints with friction and damping; and trees against Pinocchio's ABA."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.worlds import Worlds

G = 9.81


def box_with_face(on=0.0, friction=0.5):
    """A box of 10 kg and its lower face, of 0.4 m by 0.4 m, at its frame's origin."""
    return rbd.testing.box(mass=10.0), rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=friction, on=on)


def test_a_block_on_a_slope_slides_and_stops():
    """Down a slope of angle s: v' = g (sin s - mu cos s); if mu > tan s it stops after v0^2 / (2 g (mu cos s - sin s))."""
    s, v0, h = 0.3, 1.2, 1e-3
    R = pin.utils.rotate("y", s)
    slope = rbd.Ground(normal=R[:, 2], point=np.zeros(3))
    box, face = box_with_face(on=slope)
    q = np.r_[np.zeros(3), pin.Quaternion(R).coeffs()]
    mu = np.array([0.1, 0.2, 0.5, 0.7, 1.0])
    state = rbd.State(box, q, [v0, 0, 0, 0, 0, 0])
    worlds = rbd.simulate_many(state, [face], duration=0.8, step=h, friction=mu, record=200)
    rate = G * (np.sin(s) - mu * np.cos(s))
    down = worlds.q[:, :, :3] @ R[:, 0]
    t = worlds.t
    stop = np.where(rate < 0.0, -v0 / np.minimum(rate, -1e-9), np.inf)[:, None]
    slides = np.minimum(t, stop)
    assert np.abs(down - (v0 * slides + 0.5 * rate[:, None] * slides**2)).max() < 2.0 * h * h * np.abs(rate).max()
    assert np.abs(worlds.v[rate < 0, -1]).max() < 1e-9 and (worlds.v[rate > 0, -1, 0] > v0).all()
    assert worlds.depth.max() < 1e-9 and not len(worlds.flagged)


def test_friction_turns_with_the_motion():
    """A block on level ground that slides is pushed across its motion: friction of size mu m g opposes both."""
    box, face = box_with_face()
    worlds = rbd.simulate_many(
        rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0]), [face], duration=0.1, step=1e-3, friction=[0.3, 0.6],
        pushes=rbd.worlds.WorldPushes("box", (0.0, 15.0, 0.0), start=0.0, duration=1.0), record=10,
    )  # fmt: skip
    f = worlds.forces["face"][:, 1:]
    assert np.abs(np.hypot(f[..., 0], f[..., 1]) - np.array([[0.3], [0.6]]) * 10.0 * G).max() < 1e-6
    assert np.abs(f[..., 2] - 10.0 * G).max() < 1e-6
    assert (f[..., 0] < 0.0).all() and (f[..., 1] < 0.0).all()


@pytest.mark.parametrize("law", ["coulomb", "convex"])
def test_a_dropped_box_comes_to_rest_and_gains_no_energy(law):
    """Tilted boxes fall, strike with a corner and settle: energy never grows, but for the step's error."""
    box, face = box_with_face()
    rng = np.random.default_rng(2)
    q = np.tile([0.0, 0, 0.4, 0, 0, 0, 1], (6, 1))
    for i in range(6):
        q[i, 3:] = pin.Quaternion(pin.exp3(rng.uniform(-0.4, 0.4, 3))).coeffs()
    v = np.c_[rng.uniform(-1, 1, (6, 2)), np.zeros((6, 1)), rng.uniform(-1, 1, (6, 3))]
    worlds = rbd.simulate_many((box, q, v), [face], duration=1.2, step=1e-3, law=law, record=20)
    assert not len(worlds.flagged) and worlds.depth.max() < 1e-4
    energy = np.array([[_energy(worlds.state(i, k)) for k in range(len(worlds.t))] for i in range(6)])
    assert np.diff(energy, axis=1).max() < 2e-4 * energy[:, 0].max()
    if law == "coulomb":
        assert np.abs(worlds.v[:, -1]).max() < 1e-6 and np.abs(worlds.q[:, -1, 2:5]).max() < 1e-4


def _energy(state):
    """Kinetic and potential [J]."""
    return pin.computeMechanicalEnergy(state.robot.model, state.robot.model.createData(), state.q, state.v)


def test_a_point_mass_falls_strikes_and_stays():
    """The height is z0 - g t^2 / 2 up to the impact, whose impulse is m sqrt(2 g z0), and which slows sliding by mu of it."""
    box = rbd.testing.box(mass=2.0)
    point = rbd.PointContact("centre", "box", friction=0.2, on=0.0)
    z0 = np.array([0.02, 0.05, 0.1, 0.2])
    q = np.tile([0.0, 0, 0, 0, 0, 0, 1], (4, 1))
    com = box.model.inertias[1].lever
    assert np.abs(com[:2]).max() < 1e-12
    q[:, 2] = z0
    v = np.tile([2.0, 0, 0, 0, 0, 0], (4, 1))
    worlds = rbd.simulate_many((box, q, v), [point], duration=0.25, step=1e-3, record=1)
    speed = np.sqrt(2.0 * G * z0)
    for i in range(4):
        flies = worlds.t < speed[i] / G - 1e-3
        assert np.abs(worlds.q[i, flies, 2] - (z0[i] - 0.5 * G * worlds.t[flies] ** 2)).max() < 1e-9
        after = int(np.flatnonzero(~flies)[0]) + 2
        assert abs(worlds.v[i, after, 2]) < 1e-9
        lost = 2.0 - worlds.v[i, after, 0]
        assert abs(lost - 0.2 * (speed[i] + G * (worlds.t[after] - speed[i] / G))) < 0.2 * G * 1e-3
        assert np.abs(worlds.q[i, after:, 2]).max() < 1e-4


def test_a_joint_with_friction_or_damping_follows_its_closed_form():
    """A flywheel: dry friction stops it after v I / torque; damping d lets it slow by exp(-d t / I), to order 2."""
    b = rbd.RobotBuilder("flywheel", root="fixed")
    b.body("wheel", mass=1.0, com=(0, 0, 0), inertia=np.diag([0.1, 0.1, 0.2]))
    b.joint("axle", "ground", "wheel", "continuous", axis=(0, 0, 1))
    wheel = b.robot()
    dry = rbd.JointFriction("dry", "axle", torque=0.5)
    start = (wheel, np.array([np.cos(0.3), np.sin(0.3)]), np.array([[1.0], [-2.0], [60.0]]))
    worlds = rbd.simulate_many(start, [dry], duration=1.0, step=1e-3, record=1)
    t = worlds.t[None]
    v0 = start[2]
    expected = np.sign(v0) * np.maximum(np.abs(v0) - 0.5 / 0.2 * t, 0.0)
    assert np.abs(worlds.v[:, :, 0] - expected).max() < 1e-9 + 0.5 / 0.2 * 1e-3
    assert np.abs(worlds.v[:2, -1]).max() < 1e-8 * 1e-3  # at rest but for what the law's residual leaves in a step
    angle = 0.3 + 60.0 * t[0] - 0.5 * 2.5 * t[0] ** 2
    assert np.abs(worlds.q[2, :, 0] - np.cos(angle)).max() < 1e-9  # after nine turns
    damped = rbd.simulate_many((wheel, start[1], v0 / 3.0), [], duration=1.0, step=1e-2, damping={"axle": [0.0, 0.3, 2.0]})
    exact = v0[:, 0] / 3.0 * np.exp(-np.array([0.0, 0.3, 2.0]) / 0.2)
    assert np.abs(damped.v[:, -1, 0] - exact).max() < 20.0 * (0.01 * 10.0) ** 2 * 0.05


def random_tree(rng, free):
    """A random tree of hinges, slides and continuous joints, with armature."""
    model = pin.Model()
    kinds = [
        pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ(),
        pin.JointModelRevoluteUnaligned(*_unit(rng)), pin.JointModelPrismaticUnaligned(*_unit(rng)), pin.JointModelRUBY(),
    ]  # fmt: skip
    last = 0
    for i in range(int(rng.integers(3, 12))):
        above = list(model.supports[last])[free if i else 0 :] or [0]  # depth-first: on the last body or one that carries it
        parent = int(above[int(rng.integers(len(above)))])
        kind = pin.JointModelFreeFlyer() if free and i == 0 else kinds[int(rng.integers(len(kinds)))]
        j = model.addJoint(parent, kind, pin.SE3.Random() if i else pin.SE3.Identity(), f"joint {i}")
        last = j
        inertia = pin.Inertia(rng.uniform(0.2, 3.0), rng.uniform(-0.2, 0.2, 3), _inertia(rng))
        model.appendBodyToJoint(j, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"body {i}", j, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    model.armature = np.where(np.arange(model.nv) < 6 * free, 0.0, rng.uniform(0.0, 0.1, model.nv))
    return CheckedModel(model, name="tree")


def _unit(rng):
    x = rng.standard_normal(3)
    return x / np.linalg.norm(x)


def _inertia(rng):
    """About the centre of mass, of some points."""
    x = rng.uniform(-0.2, 0.2, (6, 3))
    return np.eye(3) * (x * x).sum() - x.T @ x


@pytest.mark.parametrize("free", [0, 1])
def test_accelerations_of_random_trees_are_those_of_aba(free, exhaustive):
    """One step of h from (q, v): (v+ - v) / h is ABA's at q (+) h/2 v, of a base in the world's axes."""
    rng = np.random.default_rng(5 + free)
    pin.seed(3)
    for _ in range(200 if exhaustive else 12):
        robot = random_tree(rng, free)
        model, h, n = robot.model, 1e-4, 3
        q = np.array([pin.integrate(model, pin.neutral(model), rng.uniform(-2, 2, model.nv)) for _ in range(n)])
        v, tau = rng.uniform(-2, 2, (n, model.nv)), rng.uniform(-5, 5, (n, robot.nu))
        worlds = Worlds(robot, [], q, v, step=h)
        worlds.drive(tau=tau)
        before = worlds._unpacked(worlds._v)
        worlds.advance()
        a = (worlds._unpacked(worlds._v) - before) / h
        for i in range(n):
            found, data = a[i].copy(), model.createData()
            middle = pin.integrate(model, q[i], 0.5 * h * v[i])
            rates = v[i].copy()
            if free:
                R = pin.Quaternion(q[i, 3:7]).toRotationMatrix()
                w = R @ v[i, 3:6]
                turned = pin.exp3(0.5 * h * w) @ R
                middle[:3] = q[i, :3] + 0.5 * h * (R @ v[i, :3])
                rates[:3], rates[3:6] = turned.T @ R @ v[i, :3], turned.T @ w
                found[:3] = turned.T @ found[:3] - np.cross(rates[3:6], rates[:3])
                found[3:6] = turned.T @ found[3:6]
            full = np.zeros(model.nv)
            full[robot.actuated] = tau[i]
            exact = pin.aba(model, data, middle, rates, full)
            assert np.abs(found - exact).max() < 1e-9 * max(1.0, np.abs(exact).max())


def test_a_strong_damper_does_not_jump_between_the_limits_of_its_motor():
    """G1 stands by servos that damp ten times as much as is critical for a step; it fell."""
    g1 = rbd.load_robot("g1")
    standing, feet = g1.standing(), g1.feet()
    servo = rbd.worlds.Servo(200.0, 40.0, target=standing.q[7:], torque=rbd.hold(standing, feet).tau)
    worlds = rbd.simulate_many(standing, feet, duration=0.4, step=2e-3, controller=servo)
    assert np.abs(worlds.v[0, -1]).max() < 1e-9 and abs(worlds.q[0, -1, 2] - standing.q[2]) < 1e-9
