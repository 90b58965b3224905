"""Poses in an MJCF file: position and orientation in any of its five notations."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.mjcf.elements import ORIENTATIONS
from rbd.model.mjcf.settings import Settings, numbers
from rbd.model.urdf import FARTHEST, Complaints

Element = ElementTree.Element


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose X_AB: R_AB, shape (3, 3), and p_AB, shape (3,) [m]."""

    R: Array
    p: Array

    def __mul__(self, other: Pose) -> Pose:
        return Pose(self.R @ other.R, self.p + self.R @ other.p)

    def moved(self, p: Array) -> Pose:
        """The pose of a point at p (3,) of B, with the same axes."""
        return Pose(self.R, self.p + self.R @ p)


def at_rest() -> Pose:
    """No motion at all."""
    return Pose(np.eye(3), np.zeros(3))


def pose(wrong: Complaints, what: str, element: Element, settings: Settings) -> Pose:
    """Of an element with pos and one of quat, axisangle, xyaxes, zaxis, euler.

    Raises:
        ModelError: two orientations, or one that is none.
    """
    p = np.array(numbers(wrong, what, element, "pos", 3, (0.0, 0.0, 0.0), most=FARTHEST))
    return Pose(rotation(wrong, what, element, settings), p)


def rotation(wrong: Complaints, what: str, element: Element, settings: Settings) -> Array:
    """R of an element, shape (3, 3)."""
    given = [key for key in ORIENTATIONS if element.get(key) is not None]
    if len(given) > 1:
        wrong.stop(f"{what} has {' and '.join(given)}; expected one orientation.")
    key = given[0] if given else "quat"
    if element.get(key) is None:
        return np.eye(3)
    count = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}[key]
    x = np.array(numbers(wrong, what, element, key, count, ()))
    if key == "quat":
        return _of_quaternion(x / _length(wrong, what, key, x))
    if key == "axisangle":
        return about(x[:3] / _length(wrong, what, key, x[:3]), x[3] * settings.angle)
    if key == "zaxis":
        return z_along(x / _length(wrong, what, key, x))
    if key == "xyaxes":
        first = x[:3] / _length(wrong, what, key, x[:3])
        second = x[3:] - first * (first @ x[3:])
        second /= _length(wrong, what, key, second)
        return np.column_stack([first, second, np.cross(first, second)])
    R = np.eye(3)
    for letter, angle in zip(settings.eulerseq, x, strict=True):
        turn = about(np.eye(3)["xyz".index(letter.lower())], angle * settings.angle)
        R = R @ turn if letter.islower() else turn @ R
    return R


def about(axis: Array, angle: float) -> Array:
    """The rotation about a unit vector, shape (3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K


def z_along(direction: Array) -> Array:
    """The smallest rotation that turns z into a unit vector; about x where that is -z."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = float(np.linalg.norm(axis))
    return about(np.array([1.0, 0.0, 0.0]) if sine < 1e-10 else axis / sine, math.atan2(sine, direction[2]))


def _of_quaternion(unit: Array) -> Array:
    w, v = unit[0], unit[1:]
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + 2.0 * w * K + 2.0 * K @ K


def _length(wrong: Complaints, what: str, key: str, x: Array) -> float:
    length = float(np.linalg.norm(x))
    if length < 1e-10:
        wrong.stop(f"the {'quaternion' if key == 'quat' else key} of {what} is zero.")
    return length
