"""Rotor inertias, damping and springs of joints that a robot's files state.

Seen at the joint, a rotor of inertia I behind a gear of n turns a turn of the joint has the inertia n^2 I. Pinocchio reads
neither; `rbd.load_robot(..., rotors=True)` adds them to M.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rbd.constraints.forces.joint_springs import JointDamping, JointSpring
from rbd.model.checked_model import CheckedModel
from rbd.model.input_files import FileLimits, read_xml
from rbd.model.motors import Motor
from rbd.model.urdf import Complaints

Element = ElementTree.Element
_INERTIA = {"motorInertia": "mechanicalReduction", "rotor_inertia": "gear_ratio"}
"""Elements of rotor inertias in transmissions, and of their gears: of ROS, and of Drake (which has them as values)."""


@dataclass(frozen=True)
class Rotor:
    """A rotor that a file states.

    Attributes:
        joint: The joint that it drives.
        inertia: About its own axis [kg m2].
        gear: Turns of the rotor for a turn of the joint.
        file: Name of the file.
    """

    joint: str
    inertia: float
    gear: float
    file: str

    @property
    def motor(self) -> Motor:
        """As data of a motor."""
        return Motor(gear=self.gear, rotor_inertia=self.inertia)


def rotors_of(
    element: Element | None, name: str, srdf: Path | None, limits: FileLimits, joints: Collection[str]
) -> list[Rotor]:
    """The rotors of joints, those of the URDF's transmissions before those of the SRDF; of one joint the first counts.

    Args:
        element: The first element of the robot's file; None to look at the SRDF alone.
        name: Of that file, for messages.
        srdf: The semantic file, if there is one.
        limits: How large it may be.
        joints: Those that may have a rotor; others are passed over.

    Raises:
        ModelError: a number that is none, a gear of zero; an SRDF that cannot be read.
    """
    found = list(_of_transmissions(element, name)) if element is not None and element.tag == "robot" else []
    if srdf is not None and srdf.is_file():
        found += _of_srdf(read_xml(srdf, limits), srdf.name)
    first: dict[str, Rotor] = {}
    for rotor in found:
        if rotor.joint in joints and rotor.inertia:
            first.setdefault(rotor.joint, rotor)
    return list(first.values())


def _of_transmissions(robot: Element, name: str) -> Iterator[Rotor]:
    for transmission in robot.findall("transmission"):
        driven, motors = transmission.findall("joint"), transmission.findall("actuator")
        if len(driven) != 1 or len(motors) != 1:
            continue  # a differential: no gear of one joint
        parts = {part.tag.rpartition("}")[2].rpartition(":")[2]: part for part in (*transmission, *driven[0], *motors[0])}
        for inertia, gear in _INERTIA.items():
            if inertia in parts:
                both = ElementTree.Element("rotor")  # of ROS the numbers are texts of elements; no gear is a direct drive
                for key, element in (("inertia", parts[inertia]), ("gear", parts.get(gear))):
                    both.set(key, "1" if element is None else (element.get("value") or element.text or "").strip())
                yield _rotor(name, "transmission", driven[0].get("name", ""), both, ("inertia", "gear"))


def _of_srdf(robot: Element, name: str) -> Iterator[Rotor]:
    keys = "mass", "gear_ratio"  # Pinocchio's name for the inertia is "mass"
    return (_rotor(name, "rotor_params", x.get("name", ""), x, keys) for x in robot.iterfind("rotor_params/joint"))


def _rotor(file: str, part: str, joint: str, element: Element, keys: tuple[str, str]) -> Rotor:
    """The rotor whose inertia and gear are attributes of an element."""
    wrong, what = Complaints(file), f"the {part} of joint {joint!r:.80}"
    inertia, gear = (wrong.numbers(what, element, key)[0] for key in keys)
    if inertia < 0.0:
        wrong.add(f"{what} has a rotor inertia of {inertia:g} kg m2; expected zero or more.")
    if inertia and gear == 0.0:
        wrong.add(f"{what} has a gear of 0; expected turns of the rotor for a turn of the joint.")
    wrong.refuse()
    return Rotor(joint, inertia, gear, file)


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


def file_springs(springs: Mapping[str, tuple[float, float]]) -> list[JointSpring]:
    """Springs of joints as force elements.

    Args:
        springs: {joint: (stiffness [N m/rad, N/m], rest [rad, m])}; of a ball joint the rest is 0: its drawn orientation.
    """
    return [JointSpring(joint, stiffness=k, rest=rest) for joint, (k, rest) in springs.items()]
