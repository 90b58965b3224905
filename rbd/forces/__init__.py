"""Force elements: springs, dampers and bushings, between bodies and in joints. They go where `external` goes."""

from rbd.forces.joint import JointDamping, JointSpring

__all__ = ["JointDamping", "JointSpring"]
