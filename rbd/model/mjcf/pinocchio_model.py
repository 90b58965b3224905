"""Pinocchio's model of an MJCF file that was read."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.mjcf.loops_and_motors import BALL, FREE, HINGE, is_off
from rbd.model.mjcf.reading import Mjcf

_ALIGNED = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}


def pose(p: Array, quaternion: Array) -> pin.SE3:
    """Of a position and MuJoCo's quaternion w, x, y, z."""
    return pin.SE3(pin.Quaternion(*quaternion.tolist()).matrix(), p)


def build(mjcf: Mjcf) -> pin.Model:
    """The model: q, v and the joints in the order of the file, quaternions as x, y, z, w.

    A body with several joints is attached by a chain of massless ones. q of a hinge or a slide is the file's
    coordinate: `ref` in the posture that is drawn. A floating body's q is its pose in W.

    Raises:
        ValueError: from Pinocchio, where it refuses.
    """
    m, model = mjcf.model, pin.Model()
    model.name = mjcf.name
    model.gravity.linear = np.zeros(3) if is_off(m, "GRAVITY") else np.array(m.opt.gravity)
    carriers = [(0, pin.SE3.Identity(), 0)]  # of each body: joint, pose on that joint, frame
    for i in range(1, m.nbody):
        joint, X, frame = carriers[m.body_parentid[i]]
        X = X * pose(m.body_pos[i], m.body_quat[i])
        for j in range(m.body_jntadr[i], m.body_jntadr[i] + m.body_jntnum[i]):
            joint, frame = _add_joint(model, mjcf, j, joint, X, frame)
            X = pin.SE3(np.eye(3), np.zeros(3) if m.jnt_type[j] == FREE else -m.jnt_pos[j])
        frame = model.addFrame(pin.Frame(mjcf.bodies[i], joint, frame, X, pin.FrameType.BODY))
        if joint:
            R = pin.Quaternion(*m.body_iquat[i].tolist()).matrix()
            inertia = pin.Inertia(float(m.body_mass[i]), m.body_ipos[i], R @ np.diag(m.body_inertia[i]) @ R.T)
            model.appendBodyToJoint(joint, inertia, X)
        carriers.append((joint, X, frame))
    for i in range(m.nsite):
        joint, X, frame = carriers[m.site_bodyid[i]]
        if name := m.site(i).name:
            at = X * pose(m.site_pos[i], m.site_quat[i])
            model.addFrame(pin.Frame(name, joint, frame, at, pin.FrameType.OP_FRAME))
    _set_properties(model, mjcf)
    model.referenceConfigurations["qpos0"] = _ours(mjcf, m.qpos0)
    for name, q in mjcf.keys.items():
        model.referenceConfigurations[name] = _ours(mjcf, q)
    return model


def _add_joint(model: pin.Model, mjcf: Mjcf, j: int, parent: int, X: pin.SE3, frame: int) -> tuple[int, int]:
    """(joint, its frame), hung from a parent joint at the pose X that the body has there when the joint has not moved."""
    m = mjcf.model
    kind, axis = m.jnt_type[j], m.jnt_axis[j]
    at = X * pin.SE3(np.eye(3), m.jnt_pos[j])
    if kind == FREE:
        made, at = pin.JointModelFreeFlyer(), pin.SE3.Identity()
    elif kind == BALL:
        made = pin.JointModelSpherical()
    else:
        letter, ref = _ALIGNED.get(tuple(axis.tolist())), float(m.qpos0[m.jnt_qposadr[j]])
        name, turned = ("R", "RevoluteUnaligned") if kind == HINGE else ("P", "PrismaticUnaligned")
        made = getattr(pin, f"JointModel{name}{letter}")() if letter else getattr(pin, f"JointModel{turned}")(axis)
        # and back by `ref`, so that the file's drawing is at q = ref
        at = at * (pin.SE3(pin.exp3(-ref * axis), np.zeros(3)) if kind == HINGE else pin.SE3(np.eye(3), -ref * axis))
    index = model.addJoint(parent, made, at, mjcf.joints[j])
    return index, model.addJointFrame(index, frame)


def _set_properties(model: pin.Model, mjcf: Mjcf) -> None:
    m = mjcf.model
    limited = np.zeros(m.njnt, bool) if is_off(m, "LIMIT") or is_off(m, "CONSTRAINT") else m.jnt_limited.astype(bool)
    low, high = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    armature, effort = np.array(m.dof_armature), np.full(model.nv, np.inf)
    for j in range(m.njnt):
        if m.jnt_type[j] not in (FREE, BALL):
            low[m.jnt_qposadr[j]], high[m.jnt_qposadr[j]] = m.jnt_range[j] if limited[j] else (-np.inf, np.inf)
    for joint, motor in (mjcf.motors or {}).items():
        at = m.jnt_dofadr[joint]
        armature[at] += motor.inertia
        effort[at] = np.inf if motor.limit is None else motor.limit
    model.lowerPositionLimit, model.upperPositionLimit = low, high
    model.armature, model.damping = armature, m.dof_damping * (not is_off(m, "DAMPER"))
    friction = m.dof_frictionloss * (not is_off(m, "FRICTIONLOSS"))
    model.upperDryFrictionLimit, model.lowerDryFrictionLimit = friction, -friction
    model.upperEffortLimit, model.lowerEffortLimit = effort, -effort


def _ours(mjcf: Mjcf, qpos: Array) -> Array:
    """MuJoCo's q, whose quaternions are w, x, y, z of any length, in Pinocchio's order."""
    q, m = np.array(qpos, float), mjcf.model
    for kind, at in zip(m.jnt_type, m.jnt_qposadr, strict=True):
        if kind in (FREE, BALL):
            at += 3 if kind == FREE else 0
            q[at : at + 4] = np.roll(q[at : at + 4], -1) / np.linalg.norm(q[at : at + 4])
    return q
