"""Error of a joint's position from a target, with its Jacobian and bias."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, block_diagonal, cross_matrix

UNIT_TOLERANCE = 1e-6
"""How far a quaternion's norm may be from one before it is refused."""


def position_error(kind: str, target: Array, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """(error, J, J_dot v) of a `Piece` of a joint at q, from its target.

    Args:
        kind: Of the piece.
        target: Its part of q where the error is zero.
        q: Its part of q.
        v: Its part of v.
    """
    if kind == "number":
        return q - target, np.eye(1), np.zeros(1)
    if kind == "circle":
        return np.array([_angle_between(target, q)]), np.eye(1), np.zeros(1)
    if kind == "sphere":
        return _turned(target, q, v)
    if kind == "plane":
        turn = _angle_between(target[2:], q[2:])
        R = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        R_l = np.array([[target[2], -target[3]], [target[3], target[2]]])
        error = np.r_[R_l.T @ (q[:2] - target[:2]), turn]
        return error, block_diagonal([R, np.eye(1)]), np.r_[R @ np.array([-v[2] * v[1], v[2] * v[0]]), 0.0]
    error, J, bias = _turned(target[3:], q[3:], v[3:])
    R_l = pin.Quaternion(target[3:]).matrix()
    R = R_l.T @ pin.Quaternion(q[3:]).matrix()
    w, u = v[3:], v[:3]
    return np.r_[R_l.T @ (q[:3] - target[:3]), error], block_diagonal([R, J]), np.r_[R @ (cross_matrix(w) @ u), bias]


def _angle_between(one: Array, other: Array) -> float:
    """From one (cos, sin) to the other, in (-pi, pi]."""
    return math.atan2(one[0] * other[1] - one[1] * other[0], one[0] * other[0] + one[1] * other[1])


def _turned(target: Array, q: Array, w: Array) -> tuple[Array, Array, Array]:
    """Twice the vector part of the quaternion from one orientation to the other, its Jacobian in body axes, its bias.

    (x, s)' = 1/2 (s w + x x w, -x . w), so (2 x)'' = (s 1 + [x]) w' - 1/2 |w|^2 x: of s' w + x' × w all but that cancels.
    """
    x0, s0, x1, s1 = target[:3], float(target[3]), q[:3], float(q[3])
    s = s0 * s1 + float(x0 @ x1)
    x = s0 * x1 - s1 * x0 - cross_matrix(x0) @ x1
    if s < 0.0:  # the same orientation, the short way
        s, x = -s, -x
    return 2.0 * x, s * np.eye(3) + cross_matrix(x), -0.5 * float(w @ w) * x
