"""The joints of an MJCF file."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.mjcf.attributes import check_attributes
from rbd.model.mjcf.poses import Pose
from rbd.model.mjcf.settings import Settings, limited, numbers
from rbd.model.urdf import FARTHEST, Complaints

Element = ElementTree.Element
FREEDOMS = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a body.

    Attributes:
        name: Its own, or one made of its body's name.
        kind: "free", "ball", "hinge" or "slide".
        axis: Unit vector in the body's axes, shape (3,).
        p: Where it is on the body, shape (3,) [m].
        ref: Its coordinate in the posture that the file draws [rad, m].
        range: Its limits [rad, m]; None where it has none. Of a ball joint the largest angle is the second.
        armature: Rotor inertia, of each freedom [kg m2, kg].
        damping: [N m s/rad, N s/m].
        friction: Dry friction [N m, N].
        stiffness: Of its spring [N m/rad, N/m].
        effort: Range of the motors' torque [N m, N]; None where it has none.
    """

    name: str
    kind: str
    axis: Array
    p: Array
    ref: float = 0.0
    range: tuple[float, float] | None = None
    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    effort: tuple[float, float] | None = None


def read_joint(wrong: Complaints, body: str, index: int, element: Element, X: Pose, settings: Settings) -> Joint:
    """A <joint> or <freejoint> whose class is carried out; X is the pose of the frames around it, on its body.

    Raises:
        ModelError: naming the joint and what is wrong with it.
    """
    kind = "free" if element.tag == "freejoint" else element.get("type", "hinge")
    name = element.get("name") or (f"{body}_free" if kind == "free" else f"{body}Joint_{index}")
    what = f"joint {name!r:.80}"
    check_attributes(wrong, what, element)
    if kind not in FREEDOMS:
        wrong.stop(f"{what} is of type {kind!r:.40}; expected one of {', '.join(FREEDOMS)}.")
    if element.tag == "freejoint":
        if element.get("align", "auto") not in ("auto", "false"):
            wrong.stop(f"{what} has align={element.get('align')!r:.40}, which moves the frame of its body; it is not read.")
        return Joint(name, kind, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    turns = settings.angle if kind in ("hinge", "ball") else 1.0
    axis = np.array(numbers(wrong, what, element, "axis", 3, (0.0, 0.0, 1.0)))
    if not np.linalg.norm(axis) > 1e-9:
        wrong.stop(f"the axis of {what} is zero.")
    p = np.array(numbers(wrong, what, element, "pos", 3, (0.0, 0.0, 0.0), most=FARTHEST))
    stops = None if kind == "free" else limited(wrong, what, element, settings, "limited", "range")
    spring = numbers(wrong, what, element, "springdamper", 2, (0.0, 0.0))
    keys = ("armature", "damping", "frictionloss", "stiffness")
    values = {key: numbers(wrong, what, element, key, 1, (0.0,))[0] for key in keys}
    for key in keys[:3]:
        if values[key] < 0.0:
            wrong.stop(f"{what} has {key} {values[key]:g}; expected zero or more.")
    off = settings.off
    return Joint(
        name,
        kind,
        X.R @ axis / np.linalg.norm(axis),
        X.p + X.R @ p,
        numbers(wrong, what, element, "ref", 1, (0.0,))[0] * turns if kind in ("hinge", "slide") else 0.0,
        None if stops is None or "limit" in off else (stops[0] * turns, stops[1] * turns),
        values["armature"],
        0.0 if "damper" in off else values["damping"] + spring[1],
        0.0 if "frictionloss" in off else values["frictionloss"],
        0.0 if "spring" in off else max(values["stiffness"], spring[0], key=abs),
        None if kind in ("free", "ball") else limited(wrong, what, element, settings, "actuatorfrclimited", "actuatorfrcrange"),
    )


def check_joints(wrong: Complaints, what: str, joints: Sequence[Joint], *, top: bool) -> None:
    """Refuse joints that MuJoCo does not put together on one body."""
    kinds = [joint.kind for joint in joints]
    if "free" in kinds and not (top and len(kinds) == 1):
        wrong.stop(f"{what} has a free joint; expected that alone on a body that hangs from the world.")
    if sum(FREEDOMS[kind] for kind in kinds) > 6:
        wrong.stop(f"{what} has {sum(FREEDOMS[kind] for kind in kinds)} degrees of freedom; at most 6 are taken on one body.")
    if "ball" in kinds and {"ball", "hinge"} & set(kinds[kinds.index("ball") + 1 :]):
        wrong.stop(f"{what} has a ball joint with another rotation after it; expected the ball joint last.")
