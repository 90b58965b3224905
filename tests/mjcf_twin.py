"""An MJCF file read by rbd beside the same file in MuJoCo: M, gravity, motors, limits, joint by joint in the file's order.

Both count q and v in the order of the file. Where a body floats, MuJoCo's linear velocity is in world axes and Pinocchio's in
the body's, and quaternions are w, x, y, z there and x, y, z, w here; angular velocities of free and ball joints are the same.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import rbd

Array = NDArray[np.float64]

SAME = 1e-8
"""Largest difference, as a share of the largest entry; where all are below 1, in SI units."""


def compiled(path: Path) -> mujoco.MjModel | str:
    """MuJoCo's model of a file, or why it has none."""
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return str(error)


def differences(robot: rbd.Robot, model: mujoco.MjModel, seed: int = 0, *, motors: bool = True) -> list[str]:
    """What differs between the two, in words; nothing where they are the same robot.

    Args:
        robot: As `rbd.load_robot` made it.
        model: Of the same file.
        seed: Of the configurations at which M and gravity are compared.
        motors: Whether the number of motors and their joints are compared.
    """
    if (robot.nv, robot.nq) != (model.nv, model.nq):
        return [f"nv, nq are {robot.nv}, {robot.nq}, and {model.nv}, {model.nq} in MuJoCo"]
    out = []
    if motors:
        if robot.nu != model.nu:
            out.append(f"nu is {robot.nu}, and {model.nu} in MuJoCo")
        elif sorted(robot.actuated) != sorted(model.jnt_dofadr[model.actuator_trnid[:, 0]]):
            out.append("the motors are at other joints")
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    draws = [pin.integrate(robot.model, robot.posture("qpos0"), random.normal(size=robot.nv) * k) for k in (0.0, 1.0, 1.0)]
    for q in draws:
        data.qpos[:] = qpos(robot.model, q)
        M, g = terms(model, data, robot.model)
        state = rbd.State(robot, q)
        for name, ours, theirs in (("M", state.M, M), ("gravity", state.h, g)):
            apart = float(np.abs(ours - theirs).max(initial=0.0) / max(1.0, np.abs(theirs).max(initial=0.0)))
            if not apart < SAME:
                out.append(f"{name} differs by {apart:.3g} of its largest entry, at index {np.argmax(np.abs(ours - theirs))}")
    return out + _limits(robot, model)


def qpos(model: pin.Model, q: Array) -> Array:
    """MuJoCo's q of Pinocchio's."""
    out = np.array(q, float)
    for joint in model.joints:
        if joint.nq in (4, 7):
            at = joint.idx_q + joint.nq - 4
            out[at : at + 4] = np.roll(out[at : at + 4], 1)
    return out


def terms(model: mujoco.MjModel, data: mujoco.MjData, ours: pin.Model) -> tuple[Array, Array]:
    """(M, gravity force) in Pinocchio's velocities, at the data's qpos and at rest."""
    data.qvel[:] = 0.0
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    M, T = np.empty((model.nv, model.nv)), np.eye(model.nv)
    for column, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    for joint in ours.joints:
        if joint.nv == 6:
            at = int(joint.idx_v)
            body = int(model.dof_bodyid[at])
            T[at : at + 3, at : at + 3] = data.xmat[body].reshape(3, 3)
    return T.T @ M @ T, T.T @ data.qfrc_bias


def _limits(robot: rbd.Robot, model: mujoco.MjModel) -> list[str]:
    out = []
    for i in range(model.njnt):
        if model.jnt_type[i] < int(mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        at = model.jnt_qposadr[i]
        ours = robot.model.lowerPositionLimit[at], robot.model.upperPositionLimit[at]
        on = model.jnt_limited[i] and not model.opt.disableflags & (
            int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        )
        theirs = tuple(model.jnt_range[i]) if on else (-np.inf, np.inf)
        if not np.allclose(ours, theirs, rtol=1e-12, atol=1e-12):
            out.append(f"limits of joint {i} are {ours}, and {theirs} in MuJoCo")
    return out


def motor_limits(robot: rbd.Robot, model: mujoco.MjModel) -> list[str]:
    """What differs between the torque limits of plain motors (force = gain control), joint by joint; nothing if none does.

    MuJoCo clips the control to its range and gain times it to the force's range; the gear takes that to the joint, whose own
    range of actuator forces counts last.
    """
    out = []
    for i in range(model.nu):
        joint = int(model.actuator_trnid[i, 0])
        gear, gain = float(model.actuator_gear[i, 0]), float(model.actuator_gainprm[i, 0])
        most = np.inf
        if model.actuator_ctrllimited[i]:
            most = min(most, np.abs(gear * gain * model.actuator_ctrlrange[i]).min())
        if model.actuator_forcelimited[i]:
            most = min(most, np.abs(gear * model.actuator_forcerange[i]).min())
        if model.jnt_actfrclimited[joint]:
            most = min(most, np.abs(model.jnt_actfrcrange[joint]).min())
        name = model.joint(joint).name
        if name not in robot.actuated_names:
            out.append(f"{name} has no motor")
        elif (ours := robot.effort_limit[robot.actuated_names.index(name)]) != most:
            out.append(f"the limit of {name} is {ours}, and {most} in MuJoCo")
    return out
