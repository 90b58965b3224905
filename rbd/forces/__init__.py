"""Force elements: springs, dampers and bushings, between bodies and in joints. They go where `external` goes."""

from rbd.forces.joint import JointDamping, JointSpring
from rbd.forces.shapes import ElementShape

__all__ = ["ElementShape", "JointDamping", "JointSpring"]
