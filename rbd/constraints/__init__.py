"""Constraints: each returns named rows with a force set, and does not depend on a solver."""

from functools import partial as _partial

from rbd.constraints.collision import CollisionContacts
from rbd.constraints.contact import Contact, LineContact, PointContact, SurfaceContact
from rbd.constraints.contact_points import ContactPoints
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.function import FunctionConstraint
from rbd.constraints.joint import JointCoupling, JointFriction, JointLimit, JointLock, joint_frictions, joint_limits, mimics
from rbd.constraints.loop import LoopClosure
from rbd.constraints.nonholonomic import KnifeEdge, VelocityConstraint
from rbd.constraints.rolling import RollingBall, RollingBody, RollingDisk, RollingOnRound, RollingWheel
from rbd.constraints.stabilisation import Baumgarte
from rbd.constraints.terrain.terrain import Terrain
from rbd.modules import submodule as _submodule

__all__ = [
    "Baumgarte",
    "CollisionContacts",
    "Contact",
    "ContactPoints",
    "DrivenJoint",
    "FunctionConstraint",
    "JointCoupling",
    "JointFriction",
    "JointLimit",
    "JointLock",
    "KnifeEdge",
    "LineContact",
    "LoopClosure",
    "PointContact",
    "RollingBall",
    "RollingBody",
    "RollingDisk",
    "RollingOnRound",
    "RollingWheel",
    "SurfaceContact",
    "Terrain",
    "VelocityConstraint",
    "joint_frictions",
    "joint_limits",
    "mimics",
]


__getattr__ = _partial(_submodule, __name__)
