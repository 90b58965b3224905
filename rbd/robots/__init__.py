"""Robots: load them by name or file, standing postures, soles, loops, merging, and faults of a model."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.robots.building import Box, Capsule, Cylinder, Plate, PointMass, RobotBuilder, Rod, Sphere
from rbd.robots.diagnosis import ModelIssue, ModelReport
from rbd.robots.loading import doctor, load_robot
from rbd.robots.loop_file import LoopFile
from rbd.robots.merge import RobotPair, merge_robots
from rbd.robots.posture import place_on_ground
from rbd.robots.robot import Robot

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "LoopFile",
    "ModelIssue",
    "ModelReport",
    "Plate",
    "PointMass",
    "Robot",
    "RobotBuilder",
    "RobotPair",
    "Rod",
    "Sphere",
    "doctor",
    "load_robot",
    "merge_robots",
    "place_on_ground",
]


__getattr__ = _partial(_submodule, __name__)
