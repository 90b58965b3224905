"""Models in memory: `rbd.RobotBuilder`, and the solids of its bodies."""

from rbd.robots.building.builder import RobotBuilder
from rbd.robots.building.solids import Box, Capsule, Cylinder, Sphere
from rbd.robots.building.thin_solids import Plate, PointMass, Rod

__all__ = ["Box", "Capsule", "Cylinder", "Plate", "PointMass", "RobotBuilder", "Rod", "Sphere"]
