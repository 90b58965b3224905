"""Frames in which bodies of a robot overlap, by their collision shapes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import convex_shape
from rbd.displayed import Displayed
from rbd.errors import ModelError
from rbd.model.checked_model import CheckedModel

DEEP_M = 2e-3
"""Shapes that overlap by less do not count as in collision [m]."""


@dataclass(frozen=True, eq=False)
class SelfCollisions(Displayed):
    """Where bodies overlap.

    Attributes:
        inside: Frames with an overlap, shape (n,).
        pairs: {(body, body): frames}.
        left_out: Pairs that already overlap in the robot's own postures, by the names of their shapes.
    """

    inside: Array
    pairs: dict[tuple[str, str], Array]
    left_out: tuple[tuple[str, str], ...]


def self_collisions(robot: CheckedModel, q: Array, R: Array, p: Array) -> SelfCollisions:
    """Overlaps of convex hulls of shapes, in each frame.

    Tested are the collision pairs of the robot's file, else all of bodies that neither one joint nor two in a row connect;
    left out are pairs that overlap in its standing or neutral posture. Balls around the shapes rule out most pairs.

    Args:
        robot: The robot.
        q: Configurations, shape (n, nq).
        R: Orientations of joints, as `placements`.
        p: Their origins.
    """
    shapes = _shapes(robot)
    n = len(q)
    inside = np.zeros(n, bool)
    found: dict[tuple[str, str], Array] = {}
    skipped: list[tuple[str, str]] = []
    rest = _at_rest(robot)
    centres = [np.matmul(R[:, s.joint], s.centre) + p[:, s.joint] for s in shapes]
    for i, j in _pairs(robot, shapes):
        one, other = shapes[i], shapes[j]
        apart = np.linalg.norm(centres[i] - centres[j], axis=1) - one.reach - other.reach
        near = np.flatnonzero(apart < 0.0)
        if not len(near):
            continue
        gap = _Gap(one, other)
        if any(gap.at(*rest, f) < 0.0 for f in range(len(rest[0]))):
            skipped.append((one.name, other.name))
            continue
        hits = gap.hits(R, p, near)
        if len(hits):
            key = (one.link, other.link)
            found[key] = np.union1d(found.get(key, np.zeros(0, int)), hits)
            inside[hits] = True
    return SelfCollisions(inside, found, tuple(skipped))


@dataclass(frozen=True, eq=False)
class _Shape:
    name: str
    link: str
    joint: int
    coal: Any
    X: pin.SE3
    centre: Array
    reach: float
    number: int


class _Gap:
    """Distance of two shapes, frame by frame."""

    def __init__(self, one: _Shape, other: _Shape) -> None:
        import coal

        self.one, self.other, self.coal = one, other, coal
        self.request, self.result = coal.DistanceRequest(), coal.DistanceResult()

    def at(self, R: Array, p: Array, f: int) -> float:
        """Signed distance in a frame, and `DEEP_M` more [m]."""
        places = []
        for s in (self.one, self.other):
            X = pin.SE3(R[f, s.joint], p[f, s.joint]) * s.X
            places.append(self.coal.Transform3s(X.rotation, X.translation))
        self.result.clear()
        return (
            float(self.coal.distance(self.one.coal, places[0], self.other.coal, places[1], self.request, self.result)) + DEEP_M
        )

    def hits(self, R: Array, p: Array, frames: Array) -> Array:
        """Those of some frames in which they overlap; frames before which they cannot have moved so far are not tested."""
        a, b = self.one, self.other
        Rel = np.matmul(R[frames, a.joint].transpose(0, 2, 1), R[frames, b.joint])
        arm = np.matmul(R[frames, a.joint].transpose(0, 2, 1), (p[frames, b.joint] - p[frames, a.joint])[..., None])[..., 0]
        centre = np.matmul(Rel, b.centre) + arm
        hits = []
        known, at = 0.0, -1
        for i, f in enumerate(frames):
            if at >= 0:
                turned = float(np.linalg.norm(Rel[i] - Rel[at]))  # Frobenius: at least the largest motion of a unit vector
                if known - float(np.linalg.norm(centre[i] - centre[at])) - turned * b.reach > 0.0:
                    continue
            known, at = self.at(R, p, int(f)), i
            if known < 0.0:
                hits.append(f)
        return np.array(hits, int)


def _shapes(robot: CheckedModel) -> list[_Shape]:
    model = getattr(robot, "collision_model", None)
    if model is None:
        return []
    stand_ins: frozenset[str] = getattr(robot, "collision_stand_ins", frozenset())
    out = []
    for number, shape in enumerate(model.geometryObjects):
        if shape.name in stand_ins:
            continue
        try:
            found = convex_shape(shape)
        except ModelError:
            continue
        link = robot.model.frames[shape.parentFrame].name
        out.append(_Shape(shape.name, link, found.joint, found.coal, found.X_JC, found.centre, found.reach, number))
    return out


def _pairs(robot: CheckedModel, shapes: list[_Shape]) -> list[tuple[int, int]]:
    model: Any = getattr(robot, "collision_model", None)
    if model is None:
        return []
    listed = {frozenset((int(c.first), int(c.second))) for c in model.collisionPairs}
    parents = robot.model.parents
    out = []
    for i, j in combinations(range(len(shapes)), 2):
        a, b = shapes[i].joint, shapes[j].joint
        if listed:
            if frozenset((shapes[i].number, shapes[j].number)) in listed:
                out.append((i, j))
        elif a != b and not _near(parents, a, b):
            out.append((i, j))
    return out


def _near(parents: Any, a: int, b: int) -> bool:
    """Whether one carries the other by one joint or two in a row."""
    up_a = {a, parents[a], parents[parents[a]]}
    up_b = {b, parents[b], parents[parents[b]]}
    return b in up_a or a in up_b


def _at_rest(robot: CheckedModel) -> tuple[Array, Array]:
    """(R, p) of the neutral posture and of those that the robot has by name."""
    from rbd.motion.frame_terms import placements

    known = [pin.neutral(robot.model), *getattr(robot, "postures", {}).values()]
    return placements(robot, np.array(known))
