"""The joints of an MJCF file, and the motors at them: its <actuator> elements.

MuJoCo's control goes through a gain and a gear; here tau is the torque at the joint itself. So a gear is in the limits of tau
alone, and a servo (position, velocity) is a motor whose own control law is left out.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.errors import nearest
from rbd.model.mjcf.elements import ACTUATORS, KNOWN, MAIN, Defaults, check_attributes
from rbd.model.mjcf.poses import Pose
from rbd.model.mjcf.settings import Settings, keyword, limited, numbers
from rbd.model.urdf import FARTHEST, Complaints

Element = ElementTree.Element
FREEDOMS = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}
LEAVE = "load_robot(..., leave_out=['actuators']) gives every joint a motor without limits"
_ELSEWHERE = ("tendon", "site", "refsite", "body", "cranksite", "slidersite")
_OWN_LAW = ("kp", "kv", "gainprm", "biasprm", "gaintype", "biastype", "dyntype", "dynprm")
Remark = tuple[str, str, str]


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a body.

    Attributes:
        name: Its name, or one made from its body's name.
        kind: "free", "ball", "hinge" or "slide".
        axis: Unit vector in the body's axes, shape (3,).
        p: Where it is on the body, shape (3,) [m].
        ref: Its coordinate in the posture that the file draws [rad, m].
        range: Its limits [rad, m]; None where it has none. Of a ball joint the largest angle is the second.
        armature: Rotor inertia, of each degree of freedom [kg m2, kg].
        damping: [N m s/rad, N s/m].
        friction: Dry friction [N m, N].
        stiffness: Of its spring [N m/rad, N/m].
        springref: Coordinate at which the spring is relaxed [rad, m].
        tuned: Whether MuJoCo computes stiffness and damping from its inertia (`springdamper`); `damping` is then without it.
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
    springref: float = 0.0
    tuned: bool = False
    effort: tuple[float, float] | None = None


def read_joint(wrong: Complaints, body: str, index: int, element: Element, X: Pose, settings: Settings) -> Joint:
    """A <joint> or <freejoint> whose class is carried out; X is the pose of the frames around it, on its body.

    Raises:
        ModelError: naming the joint and the fault.
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
        0.0 if "damper" in off else values["damping"],
        0.0 if "frictionloss" in off else values["frictionloss"],
        0.0 if "spring" in off else values["stiffness"],
        numbers(wrong, what, element, "springref", 1, (0.0,))[0] * turns if kind in ("hinge", "slide") else 0.0,
        any(spring) and not {"spring", "damper"} <= off,
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


@dataclass(frozen=True)
class Motor:
    """A motor at a joint.

    Attributes:
        name: Its name, or its joint's.
        joint: At which it is.
        effort: Largest torque or force either way [N m, N]; None where there is no limit.
        armature: Its rotor inertia, seen at the joint [kg m2, kg].
    """

    name: str
    joint: str
    effort: float | None
    armature: float


def read_motors(
    wrong: Complaints, root: Element, defaults: Defaults, settings: Settings, joints: Mapping[str, Joint]
) -> tuple[tuple[Motor, ...], tuple[Remark, ...]]:
    """The motors in the order of the file, and remarks about them.

    Raises:
        ModelError: an actuator that is no torque at one hinge or slide, or a second one there.
    """
    motors: dict[str, Motor] = {}
    remarks: list[Remark] = []
    for raw in root.findall("actuator/*"):
        what = f"<{raw.tag:.40}> {raw.get('name') or raw.get('joint') or '':.80}".strip()
        if raw.tag not in ACTUATORS or raw.tag not in KNOWN:
            wrong.stop(f"{what} is no motor at a joint, and not read. {LEAVE}.")
        element = _resolved(wrong, what, raw, defaults)
        motor, told = _motor(wrong, what, element, settings, joints)
        if motor.joint in motors:
            wrong.stop(f"{what} is a second actuator at joint {motor.joint!r:.80}; expected one a joint. {LEAVE}.")
        motors[motor.joint] = motor
        remarks += [(kind, motor.name, text) for kind, text in told]
    return tuple(motors.values()), tuple(remarks)


def _resolved(wrong: Complaints, what: str, raw: Element, defaults: Defaults) -> Element:
    """With its class defaults for actuators; all kinds share one default, but not their control laws."""
    element = defaults.resolved(raw)
    kinds = defaults.given(raw, None, "kind") if raw.get("class", MAIN) else {}
    for key, kind in kinds.items():
        if kind != raw.tag and key not in raw.attrib:
            if key in _OWN_LAW and raw.tag == "general":
                wrong.stop(f"{what} has {key} from a default for <{kind}>; what that means is not read. Write it out. {LEAVE}.")
            if key not in KNOWN[raw.tag]:
                element.attrib.pop(key, None)
    return element


def _motor(
    wrong: Complaints, what: str, element: Element, settings: Settings, joints: Mapping[str, Joint]
) -> tuple[Motor, list[tuple[str, str]]]:
    for key in _ELSEWHERE:
        if element.get(key) is not None:
            wrong.stop(f"{what} acts on a {key}, which no torque at one joint is; it is not read. {LEAVE}.")
    check_attributes(wrong, what, element)
    given = [element.get(key) for key in ("joint", "jointinparent") if element.get(key) is not None]
    if len(given) != 1:
        wrong.stop(f"{what} names {len(given)} joints; expected one.")
    name = given[0] or ""
    if name not in joints:
        wrong.stop(f"{what} acts on a joint {name!r:.80}, which is not in the file; {nearest(name, sorted(joints))}.")
    joint = joints[name]
    if joint.kind not in ("hinge", "slide"):
        wrong.stop(f"{what} acts on {name!r:.80}, a {joint.kind} joint; motors are read at hinges and slides. {LEAVE}.")
    words = element.get("gear", "1").split()
    gear = numbers(wrong, what, element, "gear", len(words), (1.0,))[0]
    if gear == 0.0 or len(words) > 6:
        wrong.stop(f"{what} has the gear {element.get('gear')!r:.40}; expected up to six numbers, the first not zero.")
    armature = numbers(wrong, what, element, "armature", 1, (0.0,))[0]
    if armature < 0.0:
        wrong.stop(f"{what} has armature {armature:g}; expected zero or more.")
    effort, told = _effort(wrong, what, element, settings, joint, gear)
    return Motor(element.get("name") or name, name, effort, armature * gear * gear), told


def _effort(
    wrong: Complaints, what: str, element: Element, settings: Settings, joint: Joint, gear: float
) -> tuple[float | None, list[tuple[str, str]]]:
    """The largest torque either way, None for no limit, and remarks."""
    told: list[tuple[str, str]] = []
    gain = _gain(wrong, what, element)
    force = limited(wrong, what, element, settings, "forcelimited", "forcerange")
    control = limited(wrong, what, element, settings, "ctrllimited", "ctrlrange")
    low, high = -math.inf, math.inf
    for span, factor in ((control if gain is not None and "clampctrl" not in settings.off else None, gain), (force, 1.0)):
        if span is not None and factor is not None:
            ends = sorted(factor * gear * end for end in span)
            low, high = max(low, ends[0]), min(high, ends[1])
    if joint.effort is not None:
        low, high = max(low, joint.effort[0]), min(high, joint.effort[1])
    if gain is None:
        told.append(("servo", f"<{element.tag}>: its own control law is left out; tau is the torque at the joint"))
    if low == -math.inf and high == math.inf:
        return None, told
    least = min(-low, high)
    if not least > 0.0:
        came = f"torques from {low:g} to {high:g}"
        wrong.stop(f"{what} gives joint {joint.name!r:.80} {came}: limits here are the same both ways, and not zero. {LEAVE}.")
    if abs(low + high) > 1e-12 * least:
        told.append(("one-sided", f"gives torques from {low:g} to {high:g}; taken as {least:g} either way"))
    return least, told


def _gain(wrong: Complaints, what: str, element: Element) -> float | None:
    """Force over control; None where the force is more than that."""
    if element.tag == "motor":
        return 1.0
    if element.tag != "general":
        return None
    words = element.get("gainprm", "1").split()
    values = numbers(wrong, what, element, "gainprm", len(words), (1.0,))
    laws = [
        keyword(wrong, what, element, key, default, known)
        for key, default, known in (
            ("gaintype", "fixed", ("fixed", "affine", "muscle", "user")),
            ("biastype", "none", ("none", "affine", "muscle", "user")),
            ("dyntype", "none", ("none", "integrator", "filter", "filterexact", "muscle", "user")),
        )
    ]
    return values[0] if laws == ["fixed", "none", "none"] and values and values[0] != 0.0 else None
