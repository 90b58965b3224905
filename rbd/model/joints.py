"""The joint table: indices of each joint's coordinates in q and v, their names, units and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, block_diagonal, cross_matrix
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.world import TURN_RATES, Plane, plane_of_base

UNIT_TOLERANCE = 1e-6
"""How far a quaternion's norm may be from one before it is refused."""
ROUNDED = 4e-16
"""A norm this near to one is one: two roundings."""


def normalise(what: str, block: Array) -> None:
    """Give a quaternion or unit circle norm one, in place; none of another size.

    Raises:
        InputError: its norm is off one by more than `UNIT_TOLERANCE`.
    """
    norm = math.hypot(*block.tolist()) if len(block) else 1.0
    if not abs(norm - 1.0) <= UNIT_TOLERANCE:
        kind = "quaternion (x, y, z, w)" if len(block) == 4 else "unit circle (cos, sin)"
        raise InputError(
            f"{what} has the {kind} {np.round(block, 9).tolist()} of norm {norm:.9g}; expected norm 1 to {UNIT_TOLERANCE:g}. "
            "Divide it by its norm, or build q with robot.model's pinocchio.integrate."
        )
    if abs(norm - 1.0) > ROUNDED:
        block /= norm


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


LENGTH, ANGLE, PURE = "m", "rad", "1"
FORCE_OF = {LENGTH: "N", ANGLE: "N m"}
"""Unit of the force conjugate to a velocity."""

UNLIMITED = 1e100
"""Files that state no limit read as +-DBL_MAX."""
AT_LIMIT = 1e-6
"""A joint that is beyond its limit by less is at it: files round [rad, m]."""

_SIZES = {"number": (1, 1), "circle": (2, 1), "sphere": (4, 3), "plane": (4, 3), "space": (7, 6)}
_BODY_V = [("vx", LENGTH), ("vy", LENGTH), ("vz", LENGTH), ("wx", ANGLE), ("wy", ANGLE), ("wz", ANGLE)]
_TURN = [("qx", PURE), ("qy", PURE), ("qz", PURE), ("qw", PURE)]
_CIRCLE = [("cos", PURE), ("sin", PURE)]
_PLACE = [("x", LENGTH), ("y", LENGTH), ("z", LENGTH)]

_SEVERAL = {
    "FreeFlyer": "floating",
    "Planar": "planar",
    "Spherical": "spherical",
    "SphericalZYX": "spherical, by angles about z, y, x",
    "Translation": "translation along x, y, z",
    "Universal": "universal",
}
"""{Pinocchio's kind: its name}, of joints with several degrees of freedom."""

_Labels = Sequence[tuple[str, str]]
_WHOLE: dict[str, tuple[_Labels, _Labels]] = {
    "JointModelFreeFlyer": (_PLACE + _TURN, _BODY_V),
    "JointModelSpherical": (_TURN, _BODY_V[3:]),
    "JointModelTranslation": (_PLACE, _BODY_V[:3]),
}
"""{kind of joint: (label, unit) of its entries in q and in v}, of those whose entries always have the same."""


@dataclass(frozen=True)
class Coordinate:
    """One entry of q or of v.

    Attributes:
        name: The joint's name, with ".vx" or the like behind it where the joint has several; of no other entry.
        joint: The joint's name.
        unit: "m", "rad" or "1", of q; of v per second.
    """

    name: str
    joint: str
    unit: str


@dataclass(frozen=True)
class Piece:
    """Coordinates of a joint that belong together.

    Attributes:
        kind: "number" (q' = v), "circle" (cos, sin), "sphere" (quaternion), "plane" (x, y, cos, sin) or "space" (position,
            quaternion).
        q: Where they begin in q.
        v: Where they begin in v.
        periodic: Whether it is an angle stored as a number: q and q + 2 pi are the same pose.
    """

    kind: str
    q: int
    v: int
    periodic: bool = False

    @property
    def nq(self) -> int:
        """Their number in q."""
        return _SIZES[self.kind][0]

    @property
    def nv(self) -> int:
        """Their number in v."""
        return _SIZES[self.kind][1]

    @property
    def unit(self) -> slice:
        """Which of their q must have norm one."""
        return slice({"number": 1, "plane": 2, "space": 3}.get(self.kind, 0), self.nq)


@dataclass(frozen=True, eq=False, repr=False)
class Joint(Displayed):
    """A joint of a robot: indices of its coordinates, units, limits.

    Attributes:
        name: Its name.
        id: Its number in the Pinocchio model.
        kind: Pinocchio's name for it: "RZ", "PX", "RevoluteUnaligned", "FreeFlyer", ...
        q: Its part of q, a slice also of one entry: `q[:, joint.q]` of n configurations has shape (n, nq of the joint).
        v: Its part of v, and of accelerations and generalised forces, a slice.
        pieces: Its elementary joints; several for a composite joint.
        positions: A name and a unit for each of its entries in q.
        velocities: Names of its entries in v.
    """

    name: str
    id: int
    kind: str
    q: slice
    v: slice
    pieces: tuple[Piece, ...]
    positions: tuple[Coordinate, ...]
    velocities: tuple[Coordinate, ...]
    _model: pin.Model = field(repr=False)

    @property
    def nq(self) -> int:
        """How many coordinates it has in q."""
        return len(self.positions)

    @property
    def nv(self) -> int:
        """How many degrees of freedom it has."""
        return len(self.velocities)

    @property
    def unit(self) -> str:
        """Of what it moves by: "rad", "m", or "m, rad" where it slides and turns."""
        return ", ".join(dict.fromkeys(c.unit for c in self.velocities))

    @property
    def is_angle(self) -> bool:
        """Whether all its velocities are angular; a screw's is."""
        return self.unit == ANGLE

    @property
    def is_continuous(self) -> bool:
        """Whether it is a continuous angle, known up to full turns; in q it is (cos, sin)."""
        return self.pieces[0].kind == "circle"

    @property
    def lower(self) -> float:
        """Lower limit [rad or m]; -inf where there is none, of continuous joints and those with several degrees of freedom."""
        return self._limit(self._model.lowerPositionLimit, -math.inf)

    @property
    def upper(self) -> float:
        """Upper limit [rad or m]; inf where there is none, of continuous joints and those with several degrees of freedom."""
        return self._limit(self._model.upperPositionLimit, math.inf)

    @property
    def speed(self) -> float:
        """Largest speed of the robot's file [rad/s or m/s]; inf where it states none, or for several degrees of freedom."""
        return self._positive(self._model.velocityLimit)

    @property
    def effort(self) -> float:
        """Largest torque or force of the file [N m or N]; inf where it states none, or for several degrees of freedom."""
        return self._positive(self._model.effortLimit)

    @property
    def friction(self) -> float:
        """Dry friction of the robot's file [N m or N]; zero where it states none, or for several degrees of freedom."""
        return float(self._model.upperDryFrictionLimit[self.v.start]) if self.nv == 1 else 0.0

    def coordinate(self, q: Array) -> float:
        """Angle [rad], of continuous joints in (-pi, pi], or displacement [m]; refused with several degrees of freedom."""
        if self.nv != 1:
            raise InputError(f"joint {self.name!r:.80} has {self.nv} degrees of freedom; expected one. See q[joint.q].")
        at = self.q.start
        return math.atan2(q[at + 1], q[at]) if self.is_continuous else float(q[at])

    def target(self, name: str, position: Array) -> Array:
        """A position of this joint as its part of q, shape (nq of the joint,); a continuous joint's may be an angle.

        Raises:
            InputError: of the wrong size, or with a quaternion off the unit sphere by more than 1e-6.
        """
        if self.is_continuous and position.shape == (1,):
            return np.array([math.cos(position[0]), math.sin(position[0])])
        nq, at = self.nq, 0
        if position.shape != (nq,):
            expected = "an angle" if self.is_continuous else f"{nq} numbers, its part of q" if nq > 1 else "one number"
            raise InputError(f"position of {name!r:.80} has {len(position)} numbers; expected {expected}.")
        out = position.copy()
        for piece in self.pieces:
            normalise(f"position of {name!r:.80}", out[at : at + piece.nq][piece.unit])
            at += piece.nq
        return out

    @property
    def period(self) -> Array | None:
        """Up to which multiples `difference` knows its error, shape (nv,): full turns of angles; None where it knows all."""
        turns = [2.0 * math.pi * (p.kind in ("circle", "plane") and i == p.nv - 1) for p in self.pieces for i in range(p.nv)]
        return np.array(turns) if any(turns) else None

    def difference(self, target: Array, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """(error, J, J_dot v) of the joint at q from its target, J with respect to its velocities, shape (nv, nv)."""
        own = [(p.kind, slice(p.q, p.q + p.nq), slice(p.v, p.v + p.nv)) for p in self.pieces]
        wanted = np.split(target, np.cumsum([p.nq for p in self.pieces])[:-1])
        parts = [position_error(kind, to, q[at], v[moving]) for (kind, at, moving), to in zip(own, wanted, strict=True)]
        errors, blocks, biases = zip(*parts, strict=True)
        return np.concatenate(errors), block_diagonal(blocks), np.concatenate(biases)

    def _limit(self, limits: Array, none: float) -> float:
        if self.nq != 1:
            return none
        limit = float(limits[self.q.start])
        return limit if abs(limit) <= UNLIMITED else none

    def _positive(self, limits: Array) -> float:
        """Zero, missing and +-DBL_MAX all mean that the file states no limit."""
        limit = float(limits[self.v.start]) if self.nv == 1 else math.inf
        return limit if 0.0 < limit <= UNLIMITED else math.inf

    def __repr__(self) -> str:
        return f"Joint({self.name!r}, {', '.join(filter(None, self._cells()[1:]))})"

    @property
    def words(self) -> str:
        """What it does, in URDF's words where it has them: "revolute about z", "prismatic along (0.6, 0, 0.8)", "floating".

        Axes are those of its own frame; "continuous" is a hinge without limits.
        """
        return _words(self._model.joints[self.id], np.zeros(self._model.nq))

    def _cells(self) -> tuple[str, ...]:
        """Row of the printed table: name, what it does, places, unit, limits."""
        places = [f"{what}[{p.start}:{p.stop}]" for what, p in (("q", self.q), ("v", self.v))]
        bounded = math.isfinite(self.lower) or math.isfinite(self.upper)
        bounds = f"{self.lower:.4g} to {self.upper:.4g}" if bounded else ""
        effort = f"at most {self.effort:.4g} {FORCE_OF[self.unit]}" if math.isfinite(self.effort) else ""
        return self.name, self.words, *places, self.unit, bounds, effort


def joint_of(model: pin.Model, i: int, name: str) -> Joint:
    """The joint of a number and its name."""
    made = model.joints[i]
    positions, velocities = (
        tuple(Coordinate(f"{name}.{label}" if len(labels) > 1 else name, name, unit) for label, unit in labels)
        for labels in _labels(made, plane_of_base(model) if i == 1 else None)
    )
    q, v = slice(made.idx_q, made.idx_q + made.nq), slice(made.idx_v, made.idx_v + made.nv)
    kind = made.shortname().removeprefix("JointModel")
    return Joint(name, i, kind, q, v, tuple(_pieces(made)), positions, velocities, model)


def _words(joint: pin.JointModel, q: Array) -> str:
    """What a joint does, in words."""
    kind = joint.shortname().removeprefix("JointModel")
    if kind == "Composite":
        return ", then ".join(_words(part, q) for part in joint.extract().joints)
    if joint.nv != 1 or kind == "Mimic":
        return _SEVERAL.get(kind, kind)
    data = joint.createData()
    joint.calc(data, q)
    along, about = np.split(np.asarray(data.S, float).reshape(6), 2)
    axis = about if about.any() else along
    named = [f"{'-' if x < 0.0 else ''}{name}" for x, name in zip(axis, "xyz", strict=True) if abs(abs(x) - 1.0) < 1e-12]
    told = named[0] if named else f"({', '.join(f'{x + 0.0:.4g}' for x in axis)})"
    if not about.any():
        return f"prismatic along {told}"
    return f"{'helical' if along.any() else 'continuous' if joint.nq > 1 else 'revolute'} about {told}"


def _pieces(joint: pin.JointModel) -> list[Piece]:
    kind = joint.shortname()
    if kind == "JointModelComposite":
        return [piece for part in joint.extract().joints for piece in _pieces(part)]
    whole = {"JointModelFreeFlyer": "space", "JointModelSpherical": "sphere", "JointModelPlanar": "plane"}
    if kind in whole:
        return [Piece(whole[kind], joint.idx_q, joint.idx_v)]
    if joint.nq == 2 and joint.nv == 1:
        return [Piece("circle", joint.idx_q, joint.idx_v)]
    turns = kind in ("JointModelSphericalZYX", "JointModelUniversal") or kind.startswith("JointModelR") and joint.nq == 1
    return [Piece("number", joint.idx_q + i, joint.idx_v + i, turns) for i in range(joint.nv)]


def _labels(joint: pin.JointModel, plane: Plane | None = None) -> tuple[_Labels, _Labels]:
    """(label, unit) of a joint's entries in q and in v; of a planar base by its plane."""
    kind = joint.shortname()
    if kind == "JointModelComposite":
        parts = [_labels(part) for part in joint.extract().joints]
        return tuple(
            [(f"{k}.{label}" if label else f"{k}", unit) for k, part in enumerate(parts) for label, unit in part[i]]
            for i in (0, 1)
        )  # type: ignore[return-value]  # of two
    if kind in _WHOLE:
        return _WHOLE[kind]
    if kind == "JointModelPlanar":
        along, turn = plane or "xy", TURN_RATES[plane or "xy"]
        return [(x, LENGTH) for x in along] + _CIRCLE, [(f"v{x}", LENGTH) for x in along] + [(turn, ANGLE)]
    if joint.nq == 2 and joint.nv == 1:
        return _CIRCLE, [("", ANGLE)]
    unit = LENGTH if kind.startswith("JointModelP") and joint.nv == 1 else ANGLE
    single = [("", unit)] if joint.nv == 1 else [(str(k), unit) for k in range(joint.nv)]
    return single, single
