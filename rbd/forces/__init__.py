"""Force elements: springs, dampers and bushings, between bodies and in joints. They go where `external` goes."""

from rbd.forces.bushing import Bushing
from rbd.forces.element import ElementPicture
from rbd.forces.joint import JointDamping, JointSpring
from rbd.forces.spring import Damper, Spring

__all__ = ["Bushing", "Damper", "ElementPicture", "JointDamping", "JointSpring", "Spring"]
