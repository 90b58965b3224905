"""A model made again joint by joint: with ball joints, which Pinocchio's reader of URDF does not know, or in another order.

Pinocchio is given ball joints, the type "spherical" of a URDF, as floating ones. It numbers the joints on one body by their
names in the alphabet.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import pinocchio as pin

PER_POSITION = ("lowerPositionLimit", "upperPositionLimit")
PER_VELOCITY = (
    *("armature", "damping", "rotorInertia", "rotorGearRatio", "lowerEffortLimit", "upperEffortLimit"),
    *("lowerVelocityLimit", "upperVelocityLimit", "lowerDryFrictionLimit", "upperDryFrictionLimit"),
)
"""Vectors of a Pinocchio model with an entry for each entry of q, and of v."""


def remade(model: pin.Model, balls: Collection[str], order: Sequence[str] = ()) -> pin.Model:
    """The same model with ball joints in place of floating ones, and the joints on each body in a given order.

    q of a ball joint is the quaternion x, y, z, w of its child's axes in its own, v the angular velocity in the child's axes.

    Args:
        model: As Pinocchio's reader of URDF made it.
        balls: Names of the ball joints.
        order: Names of joints. Those on one body come in this order, each with all that hang on it; others after them.

    Returns:
        The model itself where there is nothing to change.
    """
    if not balls and not order:
        return model
    made, numbers = pin.Model(), {0: 0}
    made.name, made.gravity = model.name, model.gravity
    for i in _depth_first(model, {name: k for k, name in enumerate(order)}):
        name = model.names[i]
        kind = pin.JointModelSpherical() if name in balls else model.joints[i]
        numbers[i] = made.addJoint(numbers[model.parents[i]], kind, model.jointPlacements[i], name)
        made.inertias[numbers[i]] = model.inertias[i]
    for frame in list(model.frames)[1:]:
        moved = pin.Frame(frame)
        moved.parentJoint = numbers[frame.parentJoint]
        made.addFrame(moved, False)
    for keys, start, size in ((PER_POSITION, "idx_q", "nq"), (PER_VELOCITY, "idx_v", "nv")):
        for key in keys:
            values = getattr(made, key).copy()
            for i in range(1, model.njoints):
                if model.names[i] not in balls:
                    joint, other = model.joints[i], made.joints[numbers[i]]
                    old, new, n = getattr(joint, start), getattr(other, start), getattr(joint, size)
                    values[new : new + n] = getattr(model, key)[old : old + n]
            setattr(made, key, values)
    return made


def _depth_first(model: pin.Model, rank: dict[str, int]) -> Iterator[int]:
    """Numbers of the joints, each followed by those beyond it."""
    on: dict[int, list[int]] = {}
    for i in sorted(range(model.njoints - 1, 0, -1), key=lambda i: rank.get(model.names[i], len(rank)), reverse=True):
        on.setdefault(model.parents[i], []).append(i)
    waiting = on.get(0, [])
    while waiting:
        i = waiting.pop()
        yield i
        waiting += on.get(i, [])
