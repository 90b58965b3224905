"""Configurations between samples of a motion, the poses of bodies there, and those of a second motion beside it: a ghost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import SampledPoses


def configuration_between(trajectory: SampledPoses, i: int, share: float) -> Array:
    """Between sample i and the next: joints on their manifold, free bases straight and turning evenly, shape (nq,)."""
    q = trajectory.q
    if share in (0.0, 1.0):
        return np.array(q[i + int(share)], float)
    model, before, after = trajectory.robot.model, np.array(q[i], float), np.array(q[i + 1], float)
    between = np.array(pin.interpolate(model, before, after, share))
    # Pinocchio takes a free base along a screw, in a bow that grows with its turn; a flying body moves nearly straight.
    for joint in model.joints:
        if joint.shortname() == "JointModelFreeFlyer":
            at = slice(joint.idx_q, joint.idx_q + 3)
            between[at] = (1.0 - share) * before[at] + share * after[at]
    return between


def body_poses(robot: CheckedModel, q: Sequence[Array], joints: Sequence[int]) -> tuple[Array, Array]:
    """(X_WJ of joints as position and quaternion, shape (n, k, 7); centre of mass, (n, 3), or (0, 3) of a robot without mass).

    A quaternion is in the half-space of the one before.
    """
    model, data = robot.model, robot.model.createData()
    poses, com = np.zeros((len(q), len(joints), 7)), np.zeros((len(q), 3))
    for i, q_i in enumerate(q):
        com[i] = pin.centerOfMass(model, data, q_i) if robot.mass > 0.0 else np.nan
        if robot.mass <= 0.0:
            pin.forwardKinematics(model, data, q_i)
        for j, joint in enumerate(joints):
            poses[i, j] = pin.SE3ToXYZQUAT(data.oMi[joint])
    if len(joints):
        back = np.einsum("ijk,ijk->ij", poses[1:, :, 3:], poses[:-1, :, 3:]) < 0.0
        signs = np.cumprod(np.where(back, -1.0, 1.0), axis=0)
        poses[1:, :, 3:] *= signs[:, :, None]
    return poses, com if np.isfinite(com).all() else np.zeros((0, 3))


def checked_ghost(ghost: Any, robot: CheckedModel) -> SampledPoses:
    """A motion that can be drawn beside one of a robot.

    Raises:
        InputError: no motion, one of another robot, or one without samples.
    """
    if not all(hasattr(ghost, name) for name in ("robot", "t", "q")) or not isinstance(ghost.robot, CheckedModel):
        raise InputError(f"ghost is {ghost!r:.80}; expected an rbd.Motion, or what rbd.simulate returned.")
    if ghost.robot.nq != robot.nq or list(ghost.robot.model.names) != list(robot.model.names):
        raise InputError(f"ghost is a motion of {ghost.robot.name}, shown beside one of {robot.name}; expected the same robot.")
    if not len(ghost.t) or not np.isfinite(ghost.q).all():
        raise InputError("ghost has no samples, or its q is not finite.")
    found: SampledPoses = ghost
    return found


def ghost_poses(ghost: SampledPoses, times: Array, joints: Sequence[int], down: float) -> Array:
    """Its poses at the times of another motion; before its first sample and after its last as these are, shape (n, k, 7).

    Args:
        ghost: The motion.
        times: Shape (n,) [s].
        joints: Of the poses.
        down: By how much it is lowered [m].
    """
    t = np.asarray(ghost.t, float)
    q = [np.array(ghost.q[0], float)] * len(times)
    if len(t) > 1:
        at = np.clip(times, t[0], t[-1])
        low = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        share = np.clip((at - t[low]) / (t[low + 1] - t[low]), 0.0, 1.0)
        q = [configuration_between(ghost, int(i), float(w)) for i, w in zip(low, share, strict=True)]
    poses, _ = body_poses(ghost.robot, q, joints)
    poses[:, :, 2] -= down
    return poses
