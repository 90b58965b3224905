"""Arms of a robot that walks: which of its joints they are, how they swing, and how far they are held aside."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import ConvexShape, convex_shape
from rbd.errors import InputError, ModelError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, with_values

SWINGS, WIDEST = 0.4, 0.35
"""A hand swings by this share of how far the foot of the other side is before its own, at most by this angle [rad]."""
JOINTS, BESIDE = 3, 0.05
"""An arm has three motors or more, and all its joints are farther from the robot's middle plane than 0.05 h."""
STOPS = 0.1
"""Arms swing at most up to this before the limits of their joints [rad]."""
CLEAR = 0.03
"""Arms are held aside until they are so far from legs and trunk in poses of the plan [m] ..."""
ASIDE = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
"""... by one of these angles [rad]."""

ArmsGiven = bool | Mapping[str, float] | Callable[[float], Mapping[str, float]]
"""Whether arms swing; or {joint: angle} [rad], or a function of time that gives it."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm that swings.

    Attributes:
        side: 1 of the left arm, -1 of the right one.
        tree: Indices of its joints in the model.
        swing: Name of the joint that swings it: the one that moves the hand most along the heading.
        rate: By how much it moves the hand forwards [m/rad].
        aside: Name of the joint that holds it aside: of the others the one that moves the hand most so.
        outward: Its direction, 1 or -1.
    """

    side: int
    tree: frozenset[int]
    swing: str
    rate: float
    aside: str
    outward: int


def arms_of(state: State, feet: Sequence[Any], yaw: float, h: float) -> tuple[Arm, ...]:
    """Two arms of a robot as it stands, or none: limbs without feet, on both sides, with equally many motors.

    Args:
        state: Where it starts.
        feet: Its contacts.
        yaw: Its heading [rad].
        h: Height of the centre of mass over them [m].
    """
    robot, model = state.robot, state.robot.model
    legs, n = leg_joints(robot, feet), model.njoints
    trees = [set(map(int, below)) for below in model.subtrees]
    ahead, left = np.array([math.cos(yaw), math.sin(yaw), 0.0]), np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    places = np.vstack([np.zeros((1, 3)), state.joint_places(range(1, n))[1]])
    middle = np.mean([state.frame(f.frame).X_WF.act(f.placement.translation) for f in feet], axis=0)
    over = (places - middle) @ left / h
    sides = [0 if trees[j] & legs or j == 0 else _side(over[sorted(trees[j])]) for j in range(n)]
    out = list[Arm]()
    motor = {int(v): name for v, name in zip(robot.actuated.tolist(), robot.actuated_names, strict=True)}
    for j in range(1, n):
        hinges = [k for k in sorted(trees[j]) if model.joints[k].nv == 1 and model.joints[k].idx_v in motor]
        if not sides[j] or sides[model.parents[j]] or len(hinges) < JOINTS:
            continue
        tree = sorted(trees[j])
        hand = tree[int(np.linalg.norm(places[tree] - places[j], axis=1).argmax())]
        J = state.frame(model.names[hand]).J[:3, [model.joints[k].idx_v for k in hinges]]
        forward, outward = ahead @ J, sides[j] * (left @ J)
        one = int(np.abs(forward).argmax())
        outward[one] = 0.0
        other = int(np.abs(outward).argmax())
        out.append(
            Arm(
                sides[j], frozenset(trees[j]), model.names[hinges[one]], float(forward[one]), model.names[hinges[other]],
                int(np.sign(outward[other])),
            )
        )  # fmt: skip
    alike = len(out) == 2 and out[0].side != out[1].side and len(out[0].tree) == len(out[1].tree)
    return tuple(sorted(out, key=lambda arm: -arm.side)) if alike else ()


def given_arms(robot: CheckedModel, feet: Sequence[Any], start: Array, given: Any) -> HeldArms:
    """Arms at angles that a user gives: {joint: angle}, or a function of time.

    Raises:
        InputError: what is neither, joints of legs or without a motor, angles beyond their limits.
        JointNotFound: with the nearest names.
    """
    function, values, said = None, given, "arms of Walk"
    if callable(given):
        function, said = given, "what arms of Walk gives at 0 s"
        try:
            values = given(0.0)
        except TypeError as error:
            raise InputError(f"arms of Walk is {given!r:.80}, and no function of time: {error}.") from error
    expected = "True, False, {joint: angle [rad]}, or a function of time that gives these"
    check_kind(said, values, Mapping, expected)
    q = with_values(robot, start, values, argument=said)
    legs, motors = leg_joints(robot, feet), set(robot.actuated_names)
    for name in values:
        joint = robot.joints[name]
        if joint.id in legs or joint.name not in motors:
            why = "carries a foot" if joint.id in legs else "has no motor"
            raise InputError(f"{said}: joint {name!r:.80} {why}; expected joints of arms, head or trunk with a motor.")
        angle = joint.coordinate(q)
        if not joint.lower - 1e-9 <= angle <= joint.upper + 1e-9:
            raise InputError(
                f"{said}: {name!r:.80} is at {angle:.4g}; expected it within its limits, {joint.lower:.4g} to "
                f"{joint.upper:.4g}."
            )
    return HeldArms(robot, start, start if function else q, function=function)


def leg_joints(robot: CheckedModel, feet: Sequence[Any]) -> set[int]:
    """Indices of the joints from the world to feet."""
    model, out = robot.model, set[int]()
    for foot in feet:
        out |= set(map(int, model.supports[model.frames[model.getFrameId(foot.frame)].parentJoint]))
    return out - {0}


def _side(over: Array) -> int:
    """1 or -1 of joints that are all on the left or all on the right of the middle, else 0."""
    return int(np.sign(over[0])) if (over > BESIDE).all() or (over < -BESIDE).all() else 0


@dataclass(frozen=True, eq=False)
class HeldArms:
    """Postures of the arms: from those of a start to others, about which they swing against the legs.

    Attributes:
        robot: The robot.
        start: Its posture at the start, shape (nq,).
        q: That with the arms as they are held, shape (nq,).
        arms: Those that swing.
        function: Of time, where joints have angles of their own.
    """

    robot: CheckedModel
    start: Array
    q: Array
    arms: tuple[Arm, ...] = ()
    function: Callable[[float], Mapping[str, float]] | None = None

    def posture(self, t: float, share: float, ahead: float) -> Array:
        """Posture at a time [s], so much of the way from the start, the right foot so far before the left one [m]."""
        if self.function is not None:
            return with_values(self.robot, self.start, self.function(t), argument="what arms of Walk gives")
        swung = self._swung(ahead)
        return swung if share >= 1.0 else np.asarray(pin.interpolate(self.robot.model, self.start, swung, share))

    def _swung(self, ahead: float) -> Array:
        return self._moved([(arm.swing, _within(SWINGS * arm.side * ahead / arm.rate, WIDEST)) for arm in self.arms])

    def clear_in(self, poses: Sequence[Array], ahead: Sequence[float]) -> HeldArms:
        """The same, held aside as little as keeps them clear of other bodies in poses with the right foot so far before.

        Of bodies without collision shapes, and of pairs that overlap in the posture itself, nothing is known.
        """
        pairs = [p for p in self._pairs() if not (self._gaps(self.q, [p]) < 0.0).any()]
        best, farthest = self, -math.inf
        for angle in ASIDE if pairs and poses else ():
            some = replace(self, q=self._moved([(arm.aside, arm.outward * angle) for arm in self.arms]))
            gap = min(float(some._gaps(some._in_pose(q, x), pairs).min()) for q, x in zip(poses, ahead, strict=True))
            if gap > farthest + 1e-4:
                best, farthest = some, gap
            if gap > CLEAR:
                break
        return best

    def _moved(self, by: Sequence[tuple[str, float]]) -> Array:
        """The posture with joints turned by angles, as far as their limits."""
        values = {}
        for name, angle in by:
            joint = self.robot.joints[name]
            now = float(self.q[joint.q][0])
            values[name] = min(max(now + angle, min(joint.lower + STOPS, now)), max(joint.upper - STOPS, now))
        return with_values(self.robot, self.q, values)

    def _in_pose(self, q: Array, ahead: float) -> Array:
        """A pose with the arms as they swing."""
        mine, out = self._swung(ahead), q.copy()
        for j in (self.robot.model.joints[j] for arm in self.arms for j in arm.tree):
            out[j.idx_q : j.idx_q + j.nq] = mine[j.idx_q : j.idx_q + j.nq]
        return out

    def _pairs(self) -> list[tuple[ConvexShape, ConvexShape]]:
        """Shapes of an arm and of what is neither this arm nor within two joints of the shape."""
        shapes, parents = list[ConvexShape](), self.robot.model.parents
        for shape in getattr(getattr(self.robot, "collision_model", None), "geometryObjects", ()):
            try:
                shapes.append(convex_shape(shape))
            except ModelError:  # unbounded
                continue
        return [
            (one, other)
            for arm in self.arms
            for one in shapes
            if one.joint in arm.tree
            for other in shapes
            if other.joint not in arm.tree | {parents[one.joint], parents[parents[one.joint]]}
        ]

    def _gaps(self, q: Array, pairs: Sequence[tuple[ConvexShape, ConvexShape]]) -> Array:
        """Signed distances of pairs, shape (k,) [m]."""
        data = self.robot.model.createData()
        pin.forwardKinematics(self.robot.model, data, q)
        request, result, out = coal.DistanceRequest(), coal.DistanceResult(), np.empty(len(pairs))
        for k, pair in enumerate(pairs):
            X, Y = (data.oMi[s.joint] * s.X_JC for s in pair)
            result.clear()
            X, Y = (coal.Transform3s(Z.rotation, Z.translation) for Z in (X, Y))
            out[k] = coal.distance(pair[0].coal, X, pair[1].coal, Y, request, result)
        return out


def _within(x: float, most: float) -> float:
    return min(max(x, -most), most)
