"""Left and right of a robot: which joint mirrors which, verified on its model, and mirrored configurations."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel

ACROSS = np.array([1.0, -1.0, 1.0])
"""What mirroring across the plane of x and z does to a vector; an angular one changes the sign of the others."""
APART, TILTED = 5e-3, 1e-2
"""How far a joint may be from the mirror image of its partner [m], and its axis [1]."""
_WORDS = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R", "lf": "rf", "lh": "rh", "LF": "RF", "LH": "RH"}
_WORDS |= {"FL": "FR", "RL": "RR", "HL": "HR", "BL": "BR", "fl": "fr", "rl": "rr", "hl": "hr", "bl": "br"}
_PARTNER = {**_WORDS, **{right: left for left, right in _WORDS.items()}}


@dataclass(frozen=True, eq=False)
class Symmetry:
    """How left and right are exchanged.

    Attributes:
        partner: For each velocity of a joint, that of its mirror image, shape (nv,); the base's are its own.
        sign: What its coordinate is multiplied by, shape (nv,).
        error: How far the model is from symmetric: the largest distance of a joint from its image [m].
    """

    partner: Array
    sign: Array
    error: float


def other_side(name: str, known: Iterable[str]) -> str:
    """The joint's name with left and right exchanged, where there is one; else its own."""
    names = set(known)
    parts = re.split(r"(left|right|Left|Right|LEFT|RIGHT|[_. -])", name)
    for k, part in enumerate(parts):
        if part in _PARTNER:
            other = "".join([*parts[:k], _PARTNER[part], *parts[k + 1 :]])
            if other in names:
                return other
    return name


def symmetry_of(robot: CheckedModel) -> Symmetry:
    """Left and right by the names of joints, checked on the model: axes and places are mirror images.

    Raises:
        InputError: no floating base, joints of several degrees of freedom, or a joint that is not the image of its partner.
    """
    model = robot.model
    joints = [joint for joint in robot.joints.values() if joint.id > 1]
    odd = [joint.name for joint in joints if joint.nv != 1]
    if not robot.floating or odd:
        why = f"joint {odd[0]!r:.80} has several degrees of freedom" if odd else "it has no floating base"
        raise InputError(f"a motion of {robot.name} cannot be mirrored: {why}.")
    data = model.createData()
    q = pin.neutral(model)
    J = pin.computeJointJacobians(model, data, q)
    partner, sign, error = np.arange(robot.nv), np.ones(robot.nv), 0.0
    sign[:6] = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    for joint in joints:
        other = robot.joints[other_side(joint.name, robot.joints)]
        i, k = joint.v.start, other.v.start
        place = ACROSS * data.oMi[joint.id].translation
        there = data.oMi[other.id].translation
        angular = joint.is_angle
        axis = -ACROSS * J[3:, i] if angular else ACROSS * J[:3, i]
        own = J[3:, k] if angular else J[:3, k]
        along = float(axis @ own)
        apart = float(np.linalg.norm(place - there))
        if other.is_angle != angular or apart > APART or abs(abs(along) - float(own @ own)) > TILTED:
            raise InputError(
                f"a motion of {robot.name} cannot be mirrored: joint {joint.name!r:.80} is not the mirror image of "
                f"{other.name!r:.80} (off by {1e3 * apart:.3g} mm, cosine of the axes {along:.4g})."
            )
        partner[k], sign[k] = i, np.sign(along)
        error = max(error, apart)
    return Symmetry(partner, sign, error)


def mirrored(robot: CheckedModel, symmetry: Symmetry, q: Array, rates: Iterable[Array]) -> tuple[Array, list[Array]]:
    """Configurations, and velocities or accelerations, with left and right exchanged, across the plane y = 0."""
    out = q.copy()
    out[:, 1] *= -1.0
    out[:, [3, 5]] *= -1.0
    index = {joint.v.start: joint for joint in robot.joints.values() if joint.id > 1}
    for k, joint in index.items():
        source, sign = index[int(symmetry.partner[k])], symmetry.sign[k]
        out[:, joint.q] = q[:, source.q] * (np.array([1.0, sign]) if joint.is_continuous else sign)
    return out, [symmetry.sign * x[:, symmetry.partner] for x in rates]
