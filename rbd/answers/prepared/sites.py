"""`Site`: the body to which a contact is fixed, and the contact's pose on it."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    joint: int
    X_JC: pin.SE3
    size: int

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
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED if point else pin.ReferenceFrame.LOCAL
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
