"""Pinocchio's model of an MJCF file that was read."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.mjcf.joints import Joint
from rbd.model.mjcf.poses import Pose, about, at_rest
from rbd.model.mjcf.reading import Mjcf

_ALIGNED = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}


def build(mjcf: Mjcf) -> pin.Model:
    """The model: q, v and the joints in the order of the file, quaternions as x, y, z, w.

    A body with several joints is attached by a chain of massless ones. q of a hinge or a slide is the file's
    coordinate: `ref` in the posture that is drawn. A floating body's q is its pose in W.

    Raises:
        ValueError: from Pinocchio, where it refuses.
    """
    model = pin.Model()
    model.name = mjcf.name
    model.gravity.linear = np.array(mjcf.settings.gravity)
    carriers = [(0, at_rest(), 0)]  # of each body: joint, pose on that joint, frame
    for body in mjcf.bodies[1:]:
        joint, X, frame = carriers[body.parent]
        X = X * body.X
        for one in body.joints:
            joint, frame = _add_joint(model, one, joint, X, frame)
            X = Pose(np.eye(3), np.zeros(3) if one.kind == "free" else -one.p)
        placement = pin.SE3(X.R, X.p)
        frame = model.addFrame(pin.Frame(body.name, joint, frame, placement, pin.FrameType.BODY))
        if joint:
            solid = body.solid
            model.appendBodyToJoint(joint, pin.Inertia(solid.mass, solid.centre, solid.inertia), placement)
        carriers.append((joint, X, frame))
    for body, (joint, X, frame) in zip(mjcf.bodies, carriers, strict=True):
        for name, own in body.sites:
            at = X * own
            model.addFrame(pin.Frame(name, joint, frame, pin.SE3(at.R, at.p), pin.FrameType.OP_FRAME))
    _set_properties(model, mjcf)
    model.referenceConfigurations["qpos0"] = _drawn(model, mjcf)
    for name, q in mjcf.keys.items():
        model.referenceConfigurations[name] = _ours(mjcf, q)
    return model


def passive(mjcf: Mjcf) -> tuple[str, ...]:
    """Joints without a motor; a floating base has none anyway."""
    if mjcf.motors is None:
        return ()
    driven = {motor.joint for motor in mjcf.motors}
    return tuple(joint.name for joint in mjcf.joints if joint.name not in driven and joint.kind != "free")


def springs(mjcf: Mjcf) -> dict[str, tuple[float, float]]:
    """{joint: (stiffness [N m/rad, N/m], coordinate at rest [rad, m])}; the latter 0 of a ball joint: its drawn orientation."""
    return {joint.name: (joint.stiffness, joint.springref) for joint in mjcf.joints if joint.stiffness != 0.0}


def _add_joint(model: pin.Model, joint: Joint, parent: int, X: Pose, frame: int) -> tuple[int, int]:
    """(joint, its frame), hung from a parent joint at the pose X that the body has there when the joint has not moved."""
    if joint.kind == "free":
        made, at = pin.JointModelFreeFlyer(), at_rest()
    elif joint.kind == "ball":
        made, at = pin.JointModelSpherical(), X.moved(joint.p)
    else:
        kind = "R" if joint.kind == "hinge" else "P"
        letter = _ALIGNED.get((float(joint.axis[0]), float(joint.axis[1]), float(joint.axis[2])))
        unaligned = pin.JointModelRevoluteUnaligned if kind == "R" else pin.JointModelPrismaticUnaligned
        made = getattr(pin, f"JointModel{kind}{letter}")() if letter else unaligned(joint.axis)
        at = X.moved(joint.p)  # and back by `ref`, so that the file's drawing is at q = ref
        if kind == "R":
            at = at * Pose(about(joint.axis, -joint.ref), np.zeros(3))
        else:
            at = at.moved(-joint.ref * joint.axis)
    index = model.addJoint(parent, made, pin.SE3(at.R, at.p), joint.name)
    return index, model.addJointFrame(index, frame)


def _set_properties(model: pin.Model, mjcf: Mjcf) -> None:
    motors = {motor.joint: motor for motor in mjcf.motors or ()}
    low, high = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    armature, damping, friction, effort = (np.zeros(model.nv) for _ in range(4))
    effort[:] = np.inf
    for joint in mjcf.joints:
        made = model.joints[model.getJointId(joint.name)]
        v = slice(made.idx_v, made.idx_v + made.nv)
        armature[v], damping[v], friction[v] = joint.armature, joint.damping, joint.friction
        if made.nv == 1:
            low[made.idx_q], high[made.idx_q] = joint.range or (-np.inf, np.inf)
            motor = motors.get(joint.name)
            armature[v] += motor.armature if motor else 0.0
            effort[v] = motor.effort if motor and motor.effort is not None else np.inf
    model.lowerPositionLimit, model.upperPositionLimit = low, high
    model.armature, model.damping = armature, damping
    model.upperDryFrictionLimit, model.lowerDryFrictionLimit = friction, -friction
    model.upperEffortLimit, model.lowerEffortLimit = effort, -effort


def _drawn(model: pin.Model, mjcf: Mjcf) -> Array:
    """The configuration in which the file draws its bodies, shape (nq,)."""
    q = pin.neutral(model)
    for body in mjcf.bodies:
        for joint in body.joints:
            at = model.joints[model.getJointId(joint.name)].idx_q
            if joint.kind == "free":
                q[at : at + 7] = pin.SE3ToXYZQUAT(pin.SE3(body.X.R, body.X.p))
            elif joint.kind != "ball":
                q[at] = joint.ref
    return q


def _ours(mjcf: Mjcf, qpos: Array) -> Array:
    """MuJoCo's q, whose quaternions are w, x, y, z of any length, in Pinocchio's order."""
    q, at = np.array(qpos, float), 0
    for joint in mjcf.joints:
        at += 3 if joint.kind == "free" else 0
        if joint.kind in ("free", "ball"):
            q[at : at + 4] = np.roll(q[at : at + 4], -1) / np.linalg.norm(q[at : at + 4])
            at += 4
        else:
            at += 1
    return q
