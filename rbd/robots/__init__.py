"""Robots: load them by name or file, standing postures, soles, loops, merging, and faults of a model."""

from typing import TYPE_CHECKING as _TYPE_CHECKING

from rbd.modules import named as _named

if _TYPE_CHECKING:
    from rbd.robots.building.builder import RobotBuilder as RobotBuilder
    from rbd.robots.building.solids import (
        Box as Box,
        Capsule as Capsule,
        Cylinder as Cylinder,
        Plate as Plate,
        PointMass as PointMass,
        Rod as Rod,
        Sphere as Sphere,
    )
    from rbd.robots.diagnosis import ModelIssue as ModelIssue, ModelReport as ModelReport
    from rbd.robots.loading import doctor as doctor, load_robot as load_robot
    from rbd.robots.loop_file import LoopFile as LoopFile
    from rbd.robots.merge import RobotPair as RobotPair, merge_robots as merge_robots
    from rbd.robots.posture import place_on_ground as place_on_ground
    from rbd.robots.robot import Robot as Robot

_NAMES = {
    "building.builder": "RobotBuilder",
    "building.solids": "Box Capsule Cylinder Plate PointMass Rod Sphere",
    "diagnosis": "ModelIssue ModelReport",
    "loading": "doctor load_robot",
    "loop_file": "LoopFile",
    "merge": "RobotPair merge_robots",
    "posture": "place_on_ground",
    "robot": "Robot",
}
_HOME = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names.split()}

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


def __getattr__(name: str) -> object:
    globals()[name] = found = _named(__name__, _HOME, name)
    return found
