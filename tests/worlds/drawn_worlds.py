"""Random worlds for the tests of many worlds, and the same worlds in `rbd.simulate`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin

import rbd


@cache
def leg() -> rbd.Robot:
    """A planar leg: a carriage that slides up and down, hip, knee, and a foot point 0.6 m below."""
    b = rbd.RobotBuilder("leg", root="fixed")
    b.body("carriage", mass=3.0, com=(0, 0, 0), inertia=np.diag([0.02, 0.02, 0.02]))
    b.body("thigh", mass=1.0, com=(0, 0, -0.15), inertia=np.diag([0.01, 0.01, 0.002]))
    b.body("shin", mass=0.6, com=(0, 0, -0.15), inertia=np.diag([0.008, 0.008, 0.001]))
    b.joint("rail", "ground", "carriage", "prismatic", axis=(0, 0, 1))
    b.joint("hip", "carriage", "thigh", "revolute", axis=(0, 1, 0), motor=True, effort=40.0, limits=(-1.5, 1.5))
    b.joint("knee", "thigh", "shin", "revolute", at=(0, 0, -0.3), axis=(0, 1, 0), motor=True, effort=40.0, limits=(-2.5, -0.1))
    b.frame("foot", "shin", at=(0, 0, -0.3))
    return b.robot()


@cache
def standing(name: str) -> tuple[rbd.State, tuple[rbd.Constraint, ...], np.ndarray]:
    """(state, contacts, torques that hold it) of a robot by name."""
    if name == "leg":
        bent = leg().at([0.0, 0.4, -0.8])
        state = leg().at([0.6 * np.cos(0.4), 0.4, -0.8])
        assert abs(bent.frame("foot").X_WF.translation[2] + state.q[0]) < 1e-12
        contacts = (rbd.PointContact("foot", "foot", friction=0.8, on=0.0),)
    else:
        robot = rbd.load_robot(name)
        state, contacts = robot.standing(), tuple(robot.feet())
    return state, contacts, rbd.hold(state, contacts).tau


def drawn(name: str, n: int, seed: int, kick: float = 0.3):
    """(robot, contacts, q, v, tau, friction) of n worlds: a kick in all velocities, torques off by a twentieth."""
    rng = np.random.default_rng(seed)
    state, contacts, tau = standing(name)
    robot = state.robot
    v = kick * rng.standard_normal((n, robot.nv))
    tau = tau + 0.05 * np.abs(tau).max() * rng.standard_normal((n, robot.nu))
    return robot, contacts, np.tile(state.q, (n, 1)), v, tau, rng.uniform(0.3, 1.0, n)


def simulated(robot, q, v, contacts, *, tau=None, friction=None, step, duration, **others) -> rbd.Trajectory:
    """One world by `rbd.simulate`."""
    given = [c.with_friction(float(friction)) if friction is not None and hasattr(c, "with_friction") else c for c in contacts]
    controller = None if tau is None else lambda state, t: tau
    return rbd.simulate(
        rbd.State(robot, q, v), given, duration=duration, step=step, controller=controller, progress=False, may_sink=True,
        **others,
    )  # fmt: skip


def apart(robot, q, other) -> float:
    """The largest difference of two configurations [m, rad]."""
    return float(np.abs(pin.difference(robot.model, q, other)).max())
