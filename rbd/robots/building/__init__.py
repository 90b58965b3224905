"""Models in memory: `rbd.RobotBuilder`, and the solids of its bodies."""

from rbd.robots.building.builder import RobotBuilder
from rbd.robots.building.solids import Box, Capsule, Cylinder, Plate, PointMass, Rod, Sphere

__all__ = ["Box", "Capsule", "Cylinder", "Plate", "PointMass", "RobotBuilder", "Rod", "Sphere"]
