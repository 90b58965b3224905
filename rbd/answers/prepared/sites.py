"""`Site`: the body to which a contact is fixed, and the contact's pose on it; prepared forms stored with a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.problem.cones import Cone


@dataclass(frozen=True, eq=False)
class Site:
    """The place of one contact on the body of one joint.

    Attributes:
        joint: The joint's number.
        X_JC: From the joint to the contact's centre and axes; of a point, in the joint's axes.
        size: Number of rows: 3 of a point, in world axes; 6 of a patch, in its own.
        turns: Whether a point's rows are in the joint's axes instead, and turn with it.
    """

    joint: int
    X_JC: pin.SE3
    size: int
    turns: bool = False

    @classmethod
    def of(cls, robot: CheckedModel, contact: Contact) -> Site:
        """The site of a contact that `covered` accepts.

        Raises:
            FrameNotFound: with the nearest names.
        """
        joint, X_JF = robot.site(contact.frame)
        X_JC = X_JF * contact.placement
        if len(contact.corners) == 1:
            return cls(joint, pin.SE3(np.eye(3), X_JC.translation), 3)
        return cls(joint, X_JC, 6)

    @property
    def key(self) -> tuple[object, ...]:
        """Its values."""
        return self.joint, self.size, self.X_JC.homogeneous.tobytes()

    def in_joint_axes(self, corners: Array) -> Array:
        """Points of the contact in the joint's axes, shape (k, 3) [m]."""
        return np.ascontiguousarray(corners @ self.X_JC.rotation.T + self.X_JC.translation)

    def pinocchio(self, model: pin.Model) -> pin.RigidConstraintModel:
        """The contact as Pinocchio has it."""
        point = self.size == 3
        kind = pin.ContactType.CONTACT_3D if point else pin.ContactType.CONTACT_6D
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED if point and not self.turns else pin.ReferenceFrame.LOCAL
        return pin.RigidConstraintModel(kind, model, self.joint, self.X_JC, axes)


def covered(robot: CheckedModel, contacts: tuple[object, ...]) -> bool:
    """Whether the contacts are points and patches on still ground, each on a body of its own, with friction or bilateral.

    Raises:
        FrameNotFound: with the nearest names.
    """
    if not robot.sound:
        return False
    joints, names = set(), set()
    for contact in contacts:
        if (
            not isinstance(contact, Contact)
            or len(contact.corners) == 2
            or contact.friction == 0.0
            or isinstance(contact.friction, Cone)
        ):
            return False
        if not contact.on_still_ground:
            return False
        joints.add(robot.site(contact.frame)[0])
        names.add(contact.name)
    return 0 < len(contacts) == len(joints) == len(names) and 0 not in joints


Bodies = TypeVar("Bodies")
MOST, MOST_BODIES = 64, 16
"""Sets of contacts, and of bodies in contact, that are kept with a robot."""


def kept_form(
    robot: CheckedModel,
    key: object,
    contacts: tuple[object, ...],
    make: Callable[[CheckedModel, tuple[Contact, ...]], Any],
) -> Any:
    """The form of a robot's contacts under a key; None where they are not covered.

    Args:
        robot: The robot.
        key: Has the contacts in it.
        contacts: The contacts, or what was given for them.
        make: Makes the form, where it is asked for the first time.

    Raises:
        FrameNotFound: with the nearest names.
    """
    try:
        return robot.kept[key]
    except KeyError:
        pass
    except TypeError:  # objects that cannot be keys
        return None
    made = make(robot, contacts) if covered(robot, contacts) else None  # type: ignore[arg-type]
    keep(robot.kept, key, made, MOST)
    return made


def kept_bodies(
    robot: CheckedModel, contacts: tuple[Contact, ...], kind: Callable[[CheckedModel, tuple[Site, ...]], Bodies]
) -> Bodies:
    """The bodies in contact, by the values of their sites: contacts are often made anew, with another friction.

    Args:
        robot: The robot.
        contacts: On these bodies.
        kind: Makes them from the robot and the sites.
    """
    sites = tuple([Site.of(robot, contact) for contact in contacts])
    key = (kind, *[site.key for site in sites])
    found: Bodies | None = robot.kept_bodies.get(key)
    if found is None:
        found = kind(robot, sites)
        keep(robot.kept_bodies, key, found, MOST_BODIES)
    return found


def keep(kept: dict[Any, Any], key: object, value: object, most: int) -> None:
    """Store a value under a key; if there are `most` values already, the oldest is removed."""
    while len(kept) >= most:  # another thread may have removed it
        kept.pop(next(iter(kept)), None)
    kept[key] = value
