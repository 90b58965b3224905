"""The bicycle of Meijaard, Papadopoulos, Ruina and Schwab (2007): four rigid bodies, knife-edge wheels; published matrices.

Their axes have z down; here z is up, so y and z change sign and with them the products of inertia xz.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

import rbd
from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel

WHEELBASE, TRAIL, TILT = 1.02, 0.08, math.pi / 10.0
REAR, FRONT = 0.3, 0.35
G = 9.81
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
"""M x'' + v C1 x' + (g K0 + v^2 K2) x = 0 of lean and steer, their equation (5.3), with the numbers of their section 5(b)."""
AT_5 = (-0.322866429004087, -0.775341882195845 + 4.464867713788229j, -14.078389692798218)
"""Capsize, weave and castering at 5 m/s, their table 2 [1/s]."""


def whipple(passive: tuple[str, ...] = ("front_hub",)) -> CheckedModel:
    """The bicycle; its base is the rear frame, with the origin where the rear wheel touches when upright."""
    model = pin.Model()
    X = pin.SE3.Identity
    frame = model.addJoint(0, pin.JointModelFreeFlyer(), X(), "root_joint")
    rear = model.addJoint(frame, pin.JointModelRY(), _at(0.0, REAR), "rear_hub")
    foot = WHEELBASE + TRAIL  # where the steering axis meets the ground
    axis = np.array([-math.sin(TILT), 0.0, math.cos(TILT)])
    fork = model.addJoint(frame, pin.JointModelRevoluteUnaligned(axis), _at(foot, 0.0), "steer")
    front = model.addJoint(fork, pin.JointModelRY(), _at(WHEELBASE - foot, FRONT), "front_hub")
    for joint, mass, (x, z), (xx, yy, zz, xz) in (
        (rear, 2.0, (0.0, 0.0), (0.0603, 0.12, 0.0603, 0.0)),
        (frame, 85.0, (0.3, 0.9), (9.2, 11.0, 2.8, -2.4)),
        (fork, 4.0, (0.9 - foot, 0.7), (0.05892, 0.06, 0.00708, 0.00756)),
        (front, 3.0, (0.0, 0.0), (0.1405, 0.28, 0.1405, 0.0)),
    ):
        inertia = np.array([[xx, 0.0, xz], [0.0, yy, 0.0], [xz, 0.0, zz]])
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([x, 0.0, z]), inertia), X())
    for name, joint in (("rear_wheel", rear), ("front_wheel", front), ("frame", frame)):
        model.addBodyFrame(name, joint, X(), 0)
    return CheckedModel(model, passive=passive, name="whipple")


def tyres() -> list[rbd.RollingDisk]:
    """Both wheels roll without slip."""
    return [
        rbd.RollingDisk("rear_tyre", "rear_wheel", radius=REAR, axis=(0, 1, 0)),
        rbd.RollingDisk("front_tyre", "front_wheel", radius=FRONT, axis=(0, 1, 0)),
    ]


def upright(bicycle: CheckedModel, speed: float) -> rbd.State:
    """The bicycle upright and straight at a speed [m/s]."""
    v = np.zeros(bicycle.nv)
    v[0] = speed
    v[bicycle.joints["rear_hub"].v], v[bicycle.joints["front_hub"].v] = speed / REAR, speed / FRONT
    return rbd.State(bicycle, pin.neutral(bicycle.model), v)


def published(speed: float) -> Array:
    """Eigenvalues of the published matrices at a speed, shape (4,) [1/s]."""
    stiffness, damping = np.linalg.solve(M, G * K0 + speed**2 * K2), np.linalg.solve(M, speed * C1)
    return np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]]))


def _at(x: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, 0.0, z]))
