"""Constraints whose rows are constant, or those of a pose fixed to a body: their derivatives need no differences."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rbd.arrays import Array
from rbd.constraints.contact import Contact, PointContact, SurfaceContact
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.joint import JointCoupling, JointFriction, JointLimit, JointLock
from rbd.model.derivatives import FixedPose
from rbd.problem.rows import Rows

_FIXED = (Contact, PointContact, SurfaceContact)
_CONSTANT = (DrivenJoint, JointCoupling, JointFriction, JointLimit, JointLock)


@dataclass(frozen=True, eq=False)
class FixedRows:
    """The rows of a constraint among the six of a pose, linear then angular.

    Attributes:
        pose: The pose and its axes.
        rows: Which of the six.
    """

    pose: FixedPose
    rows: slice

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(range(6)[self.rows])

    def wrench(self, f: Array) -> Array:
        """(force, moment) at the pose, in its axes, of row forces, shape (6,)."""
        out = np.zeros(6)
        out[self.rows] = f
        return out


def fixed_rows_of(constraint: object) -> FixedRows | None:
    """The rows of a point or of a patch on ground at rest, as those of a pose; None for other constraints.

    An edge is not among them: two of its rows are the turn of a line. Neither are constraints with feedback.
    """
    return _of_contact(constraint) if isinstance(constraint, Contact) and type(constraint) in _FIXED else None


@lru_cache(maxsize=256)
def _of_contact(contact: Contact) -> FixedRows | None:
    k = len(contact.corners)
    if k == 2 or not contact.on_still_ground:
        return None
    rows = slice(6) if k > 2 else slice(2 if contact.friction == 0.0 else 0, 3)
    return FixedRows(FixedPose(contact.frame, contact.placement, None if k > 2 else contact._axes), rows)


def are_constant(constraint: object, rows: Rows) -> bool:
    """Whether J is the same in all states, and J_dot v at one time: of joints with one degree of freedom, without feedback.

    Args:
        constraint: The constraint.
        rows: Its rows at a state; a limit has them at its bound alone, and is taken from its side.
    """
    kind = type(constraint)
    return kind in _CONSTANT and (kind is not JointLock or len(rows) == 1)
