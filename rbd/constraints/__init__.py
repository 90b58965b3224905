"""Constraints: each gives named rows with a set for its forces. They know no solver."""

from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.constraints.joint import JointCoupling, JointFriction, JointLimit, JointLock
from rbd.constraints.joint_lists import joint_frictions, joint_limits, mimics
from rbd.constraints.line_contact import LineContact
from rbd.constraints.stabilisation import Baumgarte

__all__ = [
    "Baumgarte",
    "JointCoupling",
    "JointFriction",
    "JointLimit",
    "JointLock",
    "LineContact",
    "PointContact",
    "SurfaceContact",
    "joint_frictions",
    "joint_limits",
    "mimics",
]
