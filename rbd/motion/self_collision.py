"""Frames in which bodies of a robot overlap, by their collision shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times
from rbd.constraints.convex.convex_shapes import ConvexShape
from rbd.displayed import Displayed
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_timeline import convex_shapes
from rbd.motion.frame_terms import placements

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
    shapes = list(convex_shapes(robot))
    inside, found, skipped = np.zeros(len(q), bool), dict[tuple[str, str], Array](), list[tuple[str, str]]()
    rest = placements(robot, np.array([pin.neutral(robot.model), *getattr(robot, "postures", {}).values()]))
    centres = [np.matmul(R[:, s.joint], s.centre) + p[:, s.joint] for _, _, s in shapes]
    for i, j in _pairs(robot, shapes):
        (_, link, one), (_, second, other) = shapes[i], shapes[j]
        near = np.flatnonzero(np.linalg.norm(centres[i] - centres[j], axis=1) < one.reach + other.reach)
        if not len(near):
            continue
        if len(_overlaps(one, other, *rest, np.arange(len(rest[0])))):
            skipped.append((one.name, other.name))
            continue
        hits = _overlaps(one, other, R, p, near)
        if len(hits):
            found[link, second] = np.union1d(found.get((link, second), hits), hits)
            inside[hits] = True
    return SelfCollisions(inside, found, tuple(skipped))


def _overlaps(one: ConvexShape, other: ConvexShape, R: Array, p: Array, frames: Array) -> Array:
    """Those of some frames in which two shapes are inside each other by more than `DEEP_M`.

    Frames before which they have not moved so far as they were apart are not measured.
    """
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    back = R[frames, one.joint].swapaxes(1, 2)
    turned = np.matmul(back, R[frames, other.joint])
    centre = np.matmul(turned, other.centre) + each_times(back, p[frames, other.joint] - p[frames, one.joint])
    # the Frobenius norm is at least the largest motion of a unit vector
    steps = np.linalg.norm(np.diff(centre, axis=0), axis=1) + other.reach * np.linalg.norm(np.diff(turned, axis=0), axis=(1, 2))
    path = np.concatenate([[0.0], np.cumsum(steps)])
    hits, i = list[int](), 0
    while i < len(frames):
        X, Y = (pin.SE3(R[frames[i], s.joint], p[frames[i], s.joint]) * s.X_JC for s in (one, other))
        places = (coal.Transform3s(Z.rotation, Z.translation) for Z in (X, Y))
        result.clear()
        gap = float(coal.distance(one.coal, next(places), other.coal, next(places), request, result)) + DEEP_M
        if gap < 0.0:
            hits.append(frames[i])
        i = max(i + 1, int(np.searchsorted(path, path[i] + gap)))
    return np.array(hits, int)


def _pairs(robot: CheckedModel, shapes: Sequence[tuple[int, str, ConvexShape]]) -> list[tuple[int, int]]:
    """The collision pairs of the robot's file, else all of bodies that neither one joint nor two in a row connect."""
    if not shapes:
        return []
    model: Any = getattr(robot, "collision_model", None)
    listed = {frozenset((int(c.first), int(c.second))) for c in model.collisionPairs}
    parents, out = robot.model.parents, []
    for i, j in combinations(range(len(shapes)), 2):
        (number, _, one), (second, _, other) = shapes[i], shapes[j]
        a, b = one.joint, other.joint
        beside = a in {b, parents[b], parents[parents[b]]} or b in {parents[a], parents[parents[a]]}
        if frozenset((number, second)) in listed if listed else not beside:
            out.append((i, j))
    return out
