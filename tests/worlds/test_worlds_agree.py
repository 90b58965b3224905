"""Worlds against `rbd.simulate`: the same law and events, to the order of the step."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from drawn_worlds import apart, drawn, simulated, standing

import rbd

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")
DURATION, STEPS = 0.04, (1e-3, 2.5e-4)


def differences(name, n, seed, law="coulomb"):
    """Largest difference in the configuration of each world at both steps, shape (2, n), and what stopped."""
    robot, contacts, q, v, tau, mu = drawn(name, n, seed)
    found, stopped = np.zeros((2, n)), np.zeros(n, bool)
    for k, step in enumerate(STEPS):
        worlds = rbd.simulate_many((robot, q, v), contacts, duration=DURATION, step=step, tau=tau, friction=mu, law=law)
        stopped |= worlds.stopped >= 0
        assert worlds.residual.max() < 1e-8
        for i in np.flatnonzero(~stopped):
            one = simulated(robot, q[i], v[i], contacts, tau=tau[i], friction=mu[i], step=step, duration=DURATION, law=law)
            found[k, i] = apart(robot, worlds.q[i, -1], one.q[-1])
    return found[:, ~stopped], stopped


@pytest.mark.parametrize("name", ["solo12", "go2", "g1", "talos", "leg"])
def test_kicked_robots_move_as_in_simulate(name, exhaustive, record_property):
    """Kicked, slipping and landing: the difference falls with the step, about as the step does."""
    n = 500 if exhaustive else 3
    found, stopped = differences(name, n, 7)
    assert stopped.sum() <= 0.002 * n
    median = np.median(found, axis=1)
    record_property("counted", f"{name}: {n} worlds, {int(stopped.sum())} stopped, differences {median}, {found.max(axis=1)}")
    assert median[1] < 0.4 * median[0]
    # of errors h U, with U of the phase in which events meet the steps even in 0 to 1, one in eight grows at a quarter of h
    assert (found[1] < np.maximum(found[0], 1e-4)).mean() >= 0.85


def test_convex_worlds_move_as_in_simulate():
    """The convex law: slipping feet rise."""
    found, stopped = differences("solo12", 3, 5, law="convex")
    assert not stopped.any()
    assert np.median(found[1]) < 0.4 * np.median(found[0])


def test_worlds_differ_in_gravity_ground_mass_and_pushes():
    """Each world of Solo12 has its own; `rbd.simulate` with the same changes agrees, to order 2, or 1 where they fall."""
    state, contacts, tau = standing("solo12")
    robot, n = state.robot, 5
    gravity = np.array([[0, 0, -9.81], [0.5, 0, -3.7], [0, 0.3, -9.0], [0, 0, -9.81], [0.1, 0.2, -8.0]])
    ground, mass = np.array([0.0, -0.003, 0.0, -0.0031, -0.0032]), np.array([1.0, 1.3, 0.8, 0.9, 1.1])
    force, start, offset = (
        np.array([[8.0, 0, 0], [0, 6, 0], [-3, 4, 2], [1, 1, 1], [0, 5, 0]]),
        0.005 * np.arange(n),
        (0.1, 0, 0.05),
    )
    found = np.zeros((2, n))
    for k, step in enumerate(STEPS):
        pushes = rbd.worlds.WorldPushes("base_link", force, start=start, duration=0.015, offset=offset)
        worlds = rbd.simulate_many(
            state, contacts, duration=DURATION, step=step, tau=tau, gravity=gravity, ground=ground, mass=mass, pushes=pushes
        )
        for i in range(n):
            other = robot.with_gravity(gravity[i])
            for j in range(1, other.model.njoints):
                I = other.model.inertias[j]
                other.model.inertias[j] = pin.Inertia(I.mass * mass[i], I.lever, I.inertia * mass[i])
            push = rbd.control.Push("base_link", force[i], start=float(start[i]), duration=0.015, offset=offset)
            feet = [c.with_ground(float(ground[i])) for c in contacts]
            one = simulated(other, state.q, None, feet, tau=tau, step=step, duration=DURATION, external=push)
            found[k, i] = apart(robot, worlds.q[i, -1], one.q[-1])
    stands, falls = found[:, ground == 0.0], found[:, ground < 0.0]
    assert (stands[1] < stands[0] / 8.0).all() and stands.max() < 1e-6
    assert falls[1].mean() < falls[0].mean() / 2.0 and falls.max() < 2e-4


def test_worlds_on_stairs_move_as_in_simulate():
    """Solo12 falls, turned, with its feet on a floor and a step of 5 cm: the difference falls with the step."""
    stairs = rbd.Terrain.stairs(0.05, 0.3, 2, start=(0.1, 0.0, -0.05))
    state, contacts, tau = standing("solo12")
    robot, rng = state.robot, np.random.default_rng(3)
    feet = [contact.with_ground(stairs) for contact in contacts]
    q = np.tile(state.q, (4, 1))
    q[:, :2] += rng.uniform(-0.02, 0.02, (4, 2))
    q[:, 2] += 0.004
    v = 0.1 * rng.standard_normal((4, robot.nv))
    found = np.zeros((2, 4))
    for k, step in enumerate(STEPS):
        worlds = rbd.simulate_many((robot, q, v), feet, duration=0.06, step=step, tau=tau)
        assert not len(worlds.flagged)
        for i in range(4):
            one = simulated(robot, q[i], v[i], feet, tau=tau, step=step, duration=0.06)
            found[k, i] = apart(robot, worlds.q[i, -1], one.q[-1])
    assert np.median(found[1]) < 0.5 * np.median(found[0])
    assert found[1].max() < 2e-3
    assert worlds.certify(0, every=20).worst < 1e-6


@pytest.mark.parametrize("what", ["stops", "friction", "damping"])
def test_joints_of_worlds_move_as_in_simulate(what):
    """A double pendulum with stops, dry friction, or viscous damping: order 2, and 1 through impacts at stops."""
    robot = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[0.5, 0.4]), masses=[1.0, 0.8])
    constraints, many, other, viscous = [], {}, {}, [0.1, 0.3, 0.0]
    if what == "stops":
        constraints = [
            rbd.JointLimit("stop", "joint_2", upper=0.6, lower=-0.5),
            rbd.JointLimit("low", "joint_1", lower=-2.0, upper=2.0),
        ]
    elif what == "friction":
        constraints = [rbd.JointFriction("dry", "joint_1", torque=1.5), rbd.JointFriction("dry 2", "joint_2", torque=0.2)]
    else:
        many = {"damping": {"joint_1": 0.8, "joint_2": viscous}}
    q, v = np.tile([0.2, 0.53], (3, 1)), np.array([[0.0, 1.0], [1.0, 2.0], [-3.0, 4.0]])
    found = np.zeros((2, 3))
    for k, step in enumerate(STEPS):
        worlds = rbd.simulate_many((robot, q, v), constraints, duration=0.08, step=step, **many)
        assert not len(worlds.flagged)
        assert worlds.certify(k, every=10).worst < 1e-7
        for i in range(3):
            if many:
                damping = rbd.JointDamping({"joint_1": 0.8, "joint_2": viscous[i]})
                other = {"external": damping, "integrator": rbd.TimeStepping()}
            one = simulated(robot, q[i], v[i], constraints, step=step, duration=0.08, **other)
            found[k, i] = apart(robot, worlds.q[i, -1], one.q[-1])
    if what == "stops":
        assert worlds.v[:, -1, 1].min() < 1e-9 and (found < 0.6 * np.array(STEPS)[:, None]).all()
    else:
        assert (found[1] < found[0] / (10.0 if what == "damping" else 2.0) + 1e-9).all()
