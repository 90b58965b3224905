"""A mechanism's coordinates: which are angles, which poses are the same, what counts as far, how to draw one at random."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, check_finite, lazy
from rbd.errors import InputError
from rbd.mechanism.held import characteristic_length, turning
from rbd.model.checked_model import CheckedModel
from rbd.model.joint_coordinates import JointPlace, Piece, joint_motion

FIXED = "fixed value of joint"


@dataclass(frozen=True)
class Beyond:
    """A joint outside the limits of its file.

    Attributes:
        joint: Its name.
        value: Angle [rad] or displacement [m].
        lower: Lower limit.
        upper: Upper limit.
    """

    joint: str
    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"{self.joint} at {self.value:.6g}, limits {self.lower:.6g} to {self.upper:.6g}"


class Coordinates:
    """The coordinates of a robot's joints.

    Args:
        robot: The robot.

    Attributes:
        names: One a velocity: the joint's name, with its number where the joint has several ("base[2]"), length nv.
        turning: Which velocities are angular, shape (nv,), bool.
        periodic: Which velocities belong to an angle kept as a plain number: q and q + 2 pi are one pose, shape (nv,), bool.
        places: {joint: where its coordinates stand}.
    """

    def __init__(self, robot: CheckedModel) -> None:
        self.robot, self.model = robot, robot.model
        self.places: dict[str, JointPlace] = {name: joint_motion(robot, name) for name in robot.joints()}
        names, periodic = [], []
        for name, place in self.places.items():
            names += [name if place.nv == 1 else f"{name}[{k}]" for k in range(place.nv)]
            periodic += _plain_angles(self.model.joints[robot.joint_id(name)])
        self.names = tuple(names)
        self.turning, self.periodic = turning(robot), np.array(periodic, bool)

    @lazy
    def length(self) -> float:
        """The robot's length [m]; see `rbd.mechanism.held.characteristic_length`."""
        return characteristic_length(self.robot)

    @lazy
    def metric(self) -> Array:
        """Unit of each velocity, shape (nv,): one where it turns, the robot's length where it slides."""
        return np.where(self.turning, 1.0, self.length)

    @lazy
    def reach(self) -> float:
        """How far the mechanism could stretch: all its bodies in a row, by joints and frames [m]; 1 if they have no length."""
        longest = np.zeros(self.model.njoints)
        for frame in self.model.frames:
            longest[frame.parentJoint] = max(longest[frame.parentJoint], np.linalg.norm(frame.placement.translation))
        total = sum(float(np.linalg.norm(X.translation)) for X in self.model.jointPlacements) + float(longest.sum())
        return total if total > 0.0 else 1.0

    def columns(self, joint: str) -> slice:
        """Where a joint's velocities stand in v.

        Raises:
            JointNotFound: with the nearest names.
        """
        self.robot.joint_id(joint)
        place = self.places[joint]
        return slice(place.v, place.v + place.nv)

    def with_values(self, q: Array, values: Mapping[str, object]) -> Array:
        """A copy of q with some joints at the values given: an angle, a displacement, or the joint's part of q.

        Raises:
            InputError: something other than a mapping, values of a wrong size or not finite.
            JointNotFound: with the nearest names.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"fixed is {values!r:.80}; expected a mapping {{joint: value}}, e.g. {{'crank': 0.5}}.")
        out = q.copy()
        for joint, value in values.items():
            self.robot.joint_id(joint)
            place = self.places[joint]
            given = np.atleast_1d(as_array(f"{FIXED} {joint!r:.80}", value))
            check_finite(f"{FIXED} {joint!r:.80}", given)
            if given.ndim != 1:
                raise InputError(f"{FIXED} {joint!r:.80} has shape {given.shape}; expected a number, or its part of q.")
            target = place.target(joint, given)
            out[place.q : place.q + len(target)] = target
        return out

    def way(self, q: Array, to: Array) -> Array:
        """The velocity that leads from one pose to another in unit time, by the short way round, shape (nv,)."""
        d = np.asarray(pin.difference(self.model, q, to))
        if self.periodic.any():
            d[self.periodic] = np.remainder(d[self.periodic] + math.pi, 2.0 * math.pi) - math.pi
        return d

    def distance(self, q: Array, to: Array) -> float:
        """Largest entry of `way`: zero for one pose written in two ways [rad, m]."""
        return float(np.abs(self.way(q, to)).max(initial=0.0))

    def canonical(self, q: Array, keep: Array) -> Array:
        """The same pose with its plain angles in (-pi, pi], or a turn beside it where only that is within the limits.

        Args:
            q: Configuration, shape (nq,).
            keep: Velocities whose coordinates stay as they are, shape (nv,), bool.
        """
        out, low, high = q.copy(), self.model.lowerPositionLimit, self.model.upperPositionLimit
        for place in self.places.values():
            for piece in place.pieces:
                if not self.periodic[piece.v] or keep[piece.v]:
                    continue
                at = piece.q
                angle = math.remainder(out[at], 2.0 * math.pi)
                angle = angle + 2.0 * math.pi if angle < -math.pi + 1e-9 else angle
                turns = [angle, angle - 2.0 * math.pi, angle + 2.0 * math.pi]
                out[at] = next((x for x in turns if low[at] - 1e-9 <= x <= high[at] + 1e-9), angle)
        return out

    def beyond_limits(self, q: Array, margin: float = 1e-9) -> tuple[Beyond, ...]:
        """The joints with one freedom that are outside their file's limits."""
        low, high = self.model.lowerPositionLimit, self.model.upperPositionLimit
        out = []
        for joint, place in self.places.items():
            if place.nv == 1 and not place.turns:
                x, least, most = float(q[place.q]), float(low[place.q]), float(high[place.q])
                if not least - margin <= x <= most + margin:
                    out.append(Beyond(joint, x, least, most))
        return tuple(out)

    def draw(self, rng: np.random.Generator) -> Array:
        """A configuration at random, shape (nq,): angles over their limits or one turn, ways over theirs or the reach."""
        q = np.asarray(pin.neutral(self.model))
        for place in self.places.values():
            for piece in place.pieces:
                q[piece.q : piece.q + piece.nq] = self._drawn(piece, rng)
        return q

    def _drawn(self, piece: Piece, rng: np.random.Generator) -> Array:
        unit = rng.normal(size=4)
        unit /= np.linalg.norm(unit)
        angle = rng.uniform(-math.pi, math.pi)
        circle = np.array([math.cos(angle), math.sin(angle)])
        ways = rng.uniform(-self.reach, self.reach, size=3)
        if piece.kind == "number":
            low = float(self.model.lowerPositionLimit[piece.q])
            high = float(self.model.upperPositionLimit[piece.q])
            if not self.turning[piece.v] and low < self.reach and high > -self.reach:
                low, high = max(low, -self.reach), min(high, self.reach)  # files state kilometres for no limit
            if not (math.isfinite(high - low) and high - low < 1e100):
                return np.array([angle])
            return np.array([rng.uniform(low, high)])
        if piece.kind == "circle":
            return circle
        if piece.kind == "sphere":
            return unit
        return np.r_[ways[:2], circle] if piece.kind == "plane" else np.r_[ways, unit]


def coordinates_of(robot: CheckedModel) -> Coordinates:
    """A robot's coordinates, looked up once a robot.

    Raises:
        InputError: it is none.
    """
    if not isinstance(robot, CheckedModel):
        raise InputError(f"expected a robot, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
    return _coordinates(robot)


_coordinates = lru_cache(maxsize=16)(Coordinates)


def _plain_angles(joint: pin.JointModel) -> list[bool]:
    """Of each velocity of a joint, whether it is that of an angle kept as a plain number."""
    kind = joint.shortname()
    if kind == "JointModelComposite":
        return [each for part in joint.extract().joints for each in _plain_angles(part)]
    plain = kind in ("JointModelSphericalZYX", "JointModelUniversal") or kind.startswith("JointModelR") and joint.nq == 1
    return [plain] * joint.nv
