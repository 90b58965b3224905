"""Bodies that move in the x-z plane, free ones, balls: robots without files, their states, and what is read off them.

A planar place is (x, z, angle) of the centre of mass in W, the angle about +y, from x to -z [m, rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import rbd
from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel

HERE = pin.SE3.Identity()


def flat_body(mass: float, inertia: float, *, gravity: float = 9.81) -> CheckedModel:
    """A body that cannot leave the x-z plane: two sliders, a hinge about y; its frame "body" at its centre of mass."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    at = 0
    for name, joint in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ()), ("turn", pin.JointModelRY())):
        at = model.addJoint(at, joint, HERE, name)
    model.appendBodyToJoint(at, pin.Inertia(mass, np.zeros(3), np.diag([inertia, inertia, inertia])), HERE)
    model.addBodyFrame("body", at, HERE, 0)
    return CheckedModel(model, passive=("x", "z", "turn"), name="flat_body")


def free_body(mass: float, moments: Sequence[float]) -> CheckedModel:
    """A free body with these principal moments, its frame "body" at its centre of mass."""
    return chain([("root_joint", pin.JointModelFreeFlyer(), mass, moments)], names=("body",), name="free_body")


def ball(mass: float = 2.0, radius: float = 0.1) -> CheckedModel:
    """A solid ball, free, its frame "body" at its centre."""
    return free_body(mass, [0.4 * mass * radius**2] * 3)


def chain(
    joints: Sequence[tuple[str, pin.JointModel, float, Sequence[float]]], *, names: Sequence[str], name: str
) -> CheckedModel:
    """Bodies side by side, each on its own joint to the world with its centre of mass there; frames of these names."""
    model = pin.Model()
    for (joint_name, joint, mass, moments), frame in zip(joints, names, strict=True):
        at = model.addJoint(0, joint, HERE, joint_name)
        model.appendBodyToJoint(at, pin.Inertia(mass, np.zeros(3), np.diag(moments)), HERE)
        model.addBodyFrame(frame, at, HERE, 0)
    return CheckedModel(model, name=name, passive=[j[0] for j in joints if j[1].shortname() != "JointModelFreeFlyer"])


def pendulum(mass: float, length: float) -> CheckedModel:
    """A point mass on a bar, hinged to the world about y at the origin, hanging down at q = 0; joint "hinge", no motor."""
    model = pin.Model()
    at = model.addJoint(0, pin.JointModelRY(), HERE, "hinge")
    model.appendBodyToJoint(at, pin.Inertia(mass, np.array([0.0, 0.0, -length]), np.zeros((3, 3))), HERE)
    model.addBodyFrame("bob", at, pin.SE3(np.eye(3), np.array([0.0, 0.0, -length])), 0)
    return CheckedModel(model, passive=("hinge",), name="pendulum")


def slider(mass: float) -> CheckedModel:
    """A mass on a slider along x; joint "slide", frame "body"."""
    return chain([("slide", pin.JointModelPX(), mass, [1.0, 1.0, 1.0])], names=("body",), name="slider")


def flat_state(robot: CheckedModel, place: Sequence[float] | Array, rate: Sequence[float] | Array = (0, 0, 0)) -> rbd.State:
    """A state at (x, z, angle) with their rates, of a `flat_body` or of a free one."""
    (x, z, angle), (vx, vz, w) = np.asarray(place, float), np.asarray(rate, float)
    if robot.floating:
        return free_state(robot, (x, 0.0, z), (0.0, angle, 0.0), (vx, 0.0, vz), (0.0, w, 0.0))
    return rbd.State(robot, np.array([x, z, angle]), np.array([vx, vz, w]))


def free_state(
    robot: CheckedModel,
    position: Sequence[float] | Array,
    turn: Sequence[float] | Array = (0.0, 0.0, 0.0),
    v: Sequence[float] | Array = (0.0, 0.0, 0.0),
    w: Sequence[float] | Array = (0.0, 0.0, 0.0),
) -> rbd.State:
    """A free body at a position, turned by a rotation vector, with velocities v and w of its centre; all in W."""
    R = pin.exp3(np.asarray(turn, float))
    q = pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(position, float)))
    return rbd.State(robot, q, np.concatenate([R.T @ np.asarray(v, float), R.T @ np.asarray(w, float)]))


def free(inertia: pin.Inertia) -> CheckedModel:
    """One body in space, its frame "body" at its centre."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "root_joint")
    model.appendBodyToJoint(joint, inertia, HERE)
    model.addFrame(pin.Frame("body", joint, 0, HERE, pin.FrameType.OP_FRAME))
    return CheckedModel(model, name="body")


def state_of(robot: CheckedModel, R: np.ndarray, p: np.ndarray, v_W: np.ndarray, w_W: np.ndarray) -> rbd.State:
    """The body at a pose with a velocity in world axes."""
    return rbd.State(robot, pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(p, float))), np.r_[R.T @ v_W, R.T @ w_W])


def flat_motion(state: rbd.State) -> Array:
    """(x, z, angle, and their rates) of a `flat_body` or of a free one; the angle within half a turn."""
    if not state.robot.floating:
        return np.concatenate([state.q, state.v])
    X, v, w = free_motion(state)
    angle = math.atan2(X.rotation[0, 2], X.rotation[0, 0])
    return np.array([X.translation[0], X.translation[2], angle, v[0], v[2], w[1]])


def free_motion(state: rbd.State) -> tuple[pin.SE3, Array, Array]:
    """Pose of a free body, and the velocities v and w of its centre in W."""
    X = state.base_pose()
    return X, X.rotation @ state.v[:3], X.rotation @ state.v[3:6]


def floor_point(name: str, offset: Sequence[float], *, friction: float | None, frame: str = "body", **more) -> rbd.PointContact:
    """A point of the body, (x, z) or (x, y, z) from its frame, above the floor through the origin."""
    x, y, z = offset if len(offset) == 3 else (offset[0], 0.0, offset[1])
    more = {"anchor": (0.0, 0.0, 0.0)} | more
    return rbd.PointContact(name, frame, offset=(x, y, z), friction=friction, **more)
