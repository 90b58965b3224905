"""Where a joint's coordinates stand in q and v, and how far it is from a position of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, block_diagonal, cross_matrix
from rbd.errors import InputError
from rbd.model.checked_model import UNIT_TOLERANCE, CheckedModel

Found = TypeVar("Found")


@dataclass(frozen=True)
class Piece:
    """Coordinates of a joint that belong together.

    Attributes:
        kind: "number" (q' = v), "circle" (cos, sin), "sphere" (quaternion), "plane" (x, y, cos, sin) or "space" (position,
            quaternion).
        q: Where they begin in q.
        v: Where they begin in v.
    """

    kind: str
    q: int
    v: int

    @property
    def nq(self) -> int:
        """Their number in q."""
        return {"number": 1, "circle": 2, "sphere": 4, "plane": 4, "space": 7}[self.kind]

    @property
    def nv(self) -> int:
        """Their number in v."""
        return {"number": 1, "circle": 1, "sphere": 3, "plane": 3, "space": 6}[self.kind]

    @property
    def unit(self) -> slice:
        """Which of their q must have norm one."""
        begin = {"number": 1, "plane": 2, "space": 3}.get(self.kind, 0)
        return slice(begin, self.nq)


@dataclass(frozen=True)
class JointPlace:
    """A joint's place in q and v.

    Attributes:
        q: Where its coordinates begin in q.
        v: Where they begin in v.
        nv: Its freedoms.
        pieces: What it is made of; more than one for joints in series at one place.
    """

    q: int
    v: int
    nv: int
    pieces: tuple[Piece, ...]

    @property
    def turns(self) -> bool:
        """Whether it is continuous: an angle without end, known up to turns."""
        return self.pieces[0].kind == "circle"

    def coordinate(self, q: Array) -> float:
        """Angle [rad] or displacement [m] of a joint with one freedom; a continuous joint's in (-pi, pi]."""
        return math.atan2(q[self.q + 1], q[self.q]) if self.turns else float(q[self.q])

    def target(self, name: str, position: Array) -> Array:
        """A position of this joint as its part of q, shape (nq of the joint,); a continuous joint's may be an angle.

        Raises:
            InputError: of the wrong size, or with a quaternion off the unit sphere by more than 1e-6.
        """
        if self.turns and position.shape == (1,):
            return np.array([math.cos(position[0]), math.sin(position[0])])
        nq, at = sum(p.nq for p in self.pieces), 0
        if position.shape != (nq,):
            expected = "an angle" if self.turns else f"{nq} numbers, its part of q" if nq > 1 else "one number"
            raise InputError(f"position of {name!r:.80} has {len(position)} numbers; expected {expected}.")
        out = position.copy()
        for piece in self.pieces:
            block = out[at : at + piece.nq][piece.unit]
            at += piece.nq
            norm = float(np.linalg.norm(block)) if len(block) else 1.0
            if not abs(norm - 1.0) <= UNIT_TOLERANCE:
                what = "quaternion (x, y, z, w)" if len(block) == 4 else "unit circle (cos, sin)"
                raise InputError(f"position of {name!r:.80}: its {what} has norm {norm:.9g}; expected 1 to {UNIT_TOLERANCE:g}.")
            block /= norm
        return out

    @property
    def period(self) -> Array | None:
        """Up to which multiples `difference` knows its error, shape (nv,): full turns of angles; None where it knows all."""
        turns = [2.0 * math.pi * (p.kind in ("circle", "plane") and i == p.nv - 1) for p in self.pieces for i in range(p.nv)]
        return np.array(turns) if any(turns) else None

    def difference(self, target: Array, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """(error, J, J_dot v) of the joint at q from its target, J with respect to its own velocities, shape (nv, nv)."""
        errors, blocks, biases, at = [], [], [], 0
        for piece in self.pieces:
            own_q, own_v = q[piece.q : piece.q + piece.nq], v[piece.v : piece.v + piece.nv]
            e, J, bias = _difference(piece.kind, target[at : at + piece.nq], own_q, own_v)
            at += piece.nq
            errors.append(e)
            blocks.append(J)
            biases.append(bias)
        return np.concatenate(errors), block_diagonal(blocks), np.concatenate(biases)


def _difference(kind: str, target: Array, q: Array, v: Array) -> tuple[Array, Array, Array]:
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


class PerRobot(Generic[Found]):
    """What a constraint looks up on a robot, once a robot.

    Args:
        find: Takes the constraint and the robot.
    """

    def __init__(self, find: Callable[[Any, CheckedModel], Found]) -> None:
        self._find = find
        self._found: tuple[CheckedModel, Found] | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return PerRobot, (self._find,)  # what was found belongs to one robot, in one process

    def of(self, constraint: object, robot: CheckedModel) -> Found:
        """What was found; raises what `find` raises."""
        found = self._found
        if found is None or found[0] is not robot:
            self._found = found = robot, self._find(constraint, robot)
        return found[1]


def with_one_freedom(robot: CheckedModel, name: str, joint: str) -> JointPlace:
    """The motion of a joint with one freedom.

    Raises:
        JointNotFound: with the nearest names.
        InputError: it has several.
    """
    motion = joint_motion(robot, joint)
    if motion.nv != 1:
        raise InputError(f"{name!r:.80}: joint {joint!r:.80} has {motion.nv} freedoms; expected a joint with one.")
    return motion


def joint_motion(robot: CheckedModel, joint: str) -> JointPlace:
    """Where a joint's coordinates stand.

    Raises:
        JointNotFound: with the nearest names.
    """
    found = robot.model.joints[robot.joint_id(joint)]
    return JointPlace(found.idx_q, found.idx_v, found.nv, tuple(_pieces(found)))


def _pieces(joint: pin.JointModel) -> list[Piece]:
    kind = joint.shortname()
    if kind == "JointModelComposite":
        return [piece for part in joint.extract().joints for piece in _pieces(part)]
    whole = {"JointModelFreeFlyer": "space", "JointModelSpherical": "sphere", "JointModelPlanar": "plane"}
    if kind in whole:
        return [Piece(whole[kind], joint.idx_q, joint.idx_v)]
    if joint.nq == 2 and joint.nv == 1:
        return [Piece("circle", joint.idx_q, joint.idx_v)]
    return [Piece("number", joint.idx_q + i, joint.idx_v + i) for i in range(joint.nv)]
