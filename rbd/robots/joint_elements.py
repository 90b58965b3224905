"""The damping and the springs of a robot's file as force elements; they act where they are given as `external`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rbd.constraints.forces.joint import JointDamping, JointSpring
from rbd.model.checked_model import CheckedModel


def file_damping(robot: CheckedModel) -> JointDamping:
    """The viscous damping of a robot's file, of a URDF's <dynamics damping> or of an MJCF's joints; empty if it states none.

    Raises:
        InputError: a damping of the file is negative or not finite; with the joint's name.
    """
    found: dict[str, float] = {}
    given = np.array(robot.model.damping)
    for joint in robot.joints.values():
        own = given[joint.v]
        if own.any():
            if (own == own[0]).all():
                found[joint.name] = float(own[0])
            else:
                found.update({c.name: float(d) for c, d in zip(joint.velocities, own, strict=True)})
    return JointDamping(found)


def file_springs(springs: Mapping[str, tuple[float, float]], prefix: str = "") -> list[JointSpring]:
    """Springs of joints as force elements.

    Args:
        springs: {joint: (stiffness [N m/rad, N/m], rest [rad, m])}; of a ball joint the rest is 0: its drawn orientation.
        prefix: Before the names of joints.
    """
    return [JointSpring(prefix + joint, stiffness=k, rest=rest) for joint, (k, rest) in springs.items()]
