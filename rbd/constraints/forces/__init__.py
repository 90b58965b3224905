"""Force elements: springs, dampers and bushings, between bodies and in joints. They go where `external` goes."""

from rbd.constraints.forces.element import ElementPicture
from rbd.constraints.forces.joint_springs import JointDamping, JointSpring
from rbd.constraints.forces.springs import Bushing, Damper, Spring

__all__ = ["Bushing", "Damper", "ElementPicture", "JointDamping", "JointSpring", "Spring"]
