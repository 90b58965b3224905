"""Ball joints of a URDF: joints of the type "spherical", which Pinocchio's reader of URDF does not know.

Pinocchio is given them as floating joints. Its model is then made again, joint by joint, with a ball joint in place of each.
"""

from __future__ import annotations

from collections.abc import Collection

import pinocchio as pin

PER_POSITION = ("lowerPositionLimit", "upperPositionLimit")
PER_VELOCITY = (
    *("armature", "damping", "rotorInertia", "rotorGearRatio", "lowerEffortLimit", "upperEffortLimit"),
    *("lowerVelocityLimit", "upperVelocityLimit", "lowerDryFrictionLimit", "upperDryFrictionLimit"),
)
"""Vectors of a Pinocchio model with an entry for each entry of q, and of v."""


def with_ball_joints(model: pin.Model, names: Collection[str]) -> pin.Model:
    """The same model with ball joints in place of floating ones.

    q of a ball joint is the quaternion x, y, z, w of its child's axes in its own, v the angular velocity in the child's axes.

    Args:
        model: As Pinocchio's reader of URDF made it.
        names: Of the joints in question.

    Returns:
        The model itself where there are none.
    """
    if not names:
        return model
    made = pin.Model()
    made.name, made.gravity = model.name, model.gravity
    for i in range(1, model.njoints):
        name = model.names[i]
        kind = pin.JointModelSpherical() if name in names else model.joints[i]
        made.addJoint(model.parents[i], kind, model.jointPlacements[i], name)
        made.inertias[i] = model.inertias[i]
    for frame in list(model.frames)[1:]:
        made.addFrame(frame, False)
    for keys, start, size in ((PER_POSITION, "idx_q", "nq"), (PER_VELOCITY, "idx_v", "nv")):
        for key in keys:
            values = getattr(made, key).copy()
            for i in range(1, model.njoints):
                if model.names[i] not in names:
                    old, new, n = (
                        getattr(model.joints[i], start),
                        getattr(made.joints[i], start),
                        getattr(model.joints[i], size),
                    )
                    values[new : new + n] = getattr(model, key)[old : old + n]
            setattr(made, key, values)
    return made
