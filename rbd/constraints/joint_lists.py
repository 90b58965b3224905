"""Joint limits, mimic couplings and dry friction that a robot's file states, as lists of constraints."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from rbd.constraints.joint import JointCoupling, JointFriction
from rbd.constraints.joint_limit import JointLimit
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.input_files import read_xml


def joint_limits(robot: CheckedModel, *, margin: float = 1e-6) -> list[JointLimit]:
    """Limits of every joint with one degree of freedom and a bound, named "<joint>_limit"; most are inactive at a time.

    One constraint a joint, for both bounds. Continuous joints, and those with several DOF (a floating base),
    have none.

    Args:
        robot: The robot.
        margin: Distance within which a joint is at its bound [rad] or [m].

    Raises:
        InputError: not a robot, or a negative margin.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> limits = rbd.constraints.joint_limits(solo)
        >>> len(limits), limits[0].name, limits[0].bounds(solo)
        (12, 'FL_HAA_limit', (-10.0, 10.0))
    """
    limited = [j for j in _checked(robot).joints.values() if min(-j.lower, j.upper) < math.inf]
    return [JointLimit(f"{joint.name}_limit", joint.name, margin=margin) for joint in limited]


def joint_frictions(robot: CheckedModel) -> list[JointFriction]:
    """Dry friction of every joint with one degree of freedom for which the file states it, named "<joint>_friction".

    `friction` of a URDF's <dynamics>, `frictionloss` of an MJCF's joint. Damping is not included.

    Args:
        robot: The robot.

    Raises:
        InputError: not a robot.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> frictions = rbd.constraints.joint_frictions(talos)
        >>> print(len(frictions), frictions[0])
        20 JointFriction(name='torso_1_joint_friction', joint='torso_1_joint', torque=1.0)
    """
    rough = [joint for joint in _checked(robot).joints.values() if joint.friction > 0.0]
    return [JointFriction(f"{joint.name}_friction", joint.name, joint.friction) for joint in rough]


def mimics(robot: Any) -> list[JointCoupling]:
    """Couplings by a URDF's <mimic> tags, named "<joint>_mimic": q_joint = multiplier q_other + offset.

    The loader leaves every joint free, with a separate motor; these rows couple them. Joints that do not move, or that
    mimic one that does not, are left out.

    Args:
        robot: Of `rbd.load_robot`: its file is read again.

    Raises:
        InputError: a robot without a URDF file.
        ModelError: a file that has changed since.

    Example:
        >>> panda = rbd.load_robot("panda", root="fixed")
        >>> [(each.joint, each.to, each.ratio) for each in rbd.constraints.mimics(panda)]
        [('panda_finger_joint2', 'panda_finger_joint1', 1.0)]
    """
    path = getattr(_checked(robot), "urdf", None)
    if not isinstance(path, Path):
        raise InputError(f"{robot.name} has no file to read mimics from; use rbd.load_robot, or give rbd.JointCoupling.")
    root = read_xml(path, robot.limits)
    if root.tag != "robot":
        raise InputError(
            f"{path.name} is an MJCF file, and mimics are read from a URDF's <mimic> tags. "
            "Give rbd.JointCoupling(name, joint, to, ratio=...)."
        )
    return [coupling for joint in root.findall("joint") for coupling in _coupling(robot, joint)]


def _coupling(robot: CheckedModel, joint: ElementTree.Element) -> list[JointCoupling]:
    mimic, name = joint.find("mimic"), joint.get("name", "")
    if mimic is None:
        return []
    to, known = mimic.get("joint", ""), robot.joints
    if not all(n in known and known[n].nv == 1 for n in (name, to)):
        return []
    ratio, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0")))
    return [JointCoupling(f"{name}_mimic", name, to, ratio=ratio, offset=offset)]


def _checked(robot: CheckedModel) -> CheckedModel:
    if not isinstance(robot, CheckedModel):
        raise InputError(f"expected a robot, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
    return robot
