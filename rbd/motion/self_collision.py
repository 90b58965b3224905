"""Frames in which bodies of a robot overlap, by their collision shapes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times
from rbd.constraints.convex.convex_shapes import ConvexShape
from rbd.displayed import Displayed
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_timeline import convex_shapes
from rbd.motion.frame_terms import placements

FAR_M = 0.01
"""How far shapes are apart at rest is not measured beyond this [m]."""
DEEP_M = 2e-3
"""Shapes that overlap by less do not count as in collision [m]."""
SPARE_M = 0.03
"""Of what poses may still move before shapes are measured again [m]."""


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
    inside, found, bodies = np.zeros(len(q), bool), dict[tuple[str, str], Array](), BodyPairs.of(robot)
    for i, j, near in bodies.near(R, p, -DEEP_M):
        pair, hits = (bodies.shapes[i][1], bodies.shapes[j][1]), near.frames
        found[pair] = np.union1d(found.get(pair, hits), hits)
        inside[hits] = True
    return SelfCollisions(inside, found, tuple(bodies.left_out))


class NearBodies(NamedTuple):
    """Where two shapes are near each other, in m frames.

    Attributes:
        frames: Indices of the frames, shape (m,).
        gap: Signed distance, shape (m,) [m].
        normal: Unit vector from the first to the second, in W, shape (m, 3).
        first: Nearest point of the first shape, in W, shape (m, 3) [m].
        second: That of the second.
    """

    frames: Array
    gap: Array
    normal: Array
    first: Array
    second: Array

    def some(self, which: Array) -> NearBodies:
        """Those of some of the frames."""
        return NearBodies(*(x[which] for x in self))


@dataclass(frozen=True, eq=False)
class BodyPairs:
    """Shapes of a robot and pairs of them that must not overlap.

    Attributes:
        shapes: (number, link, shape) of each, as `convex_shapes`.
        pairs: Indices of shapes.
        rest: Poses of joints in the robot's own postures, as `placements`.
        left_out: Names of pairs that overlap there, filled as they come near.
        resting: How far pairs are apart there, at most `FAR_M` [m], filled as they come near.
        known: Of `near`, of the poses before: orientations of joints, centres of shapes, and how far pairs are apart at least.
    """

    shapes: list[tuple[int, str, ConvexShape]]
    pairs: list[tuple[int, int]]
    rest: tuple[Array, Array]
    left_out: list[tuple[str, str]] = field(default_factory=list)
    resting: dict[tuple[int, int], float] = field(default_factory=dict)
    known: list[Array] = field(default_factory=list)

    @classmethod
    def of(cls, robot: CheckedModel) -> BodyPairs:
        """Those of a robot."""
        shapes = list(convex_shapes(robot))
        postures = np.array([pin.neutral(robot.model), *getattr(robot, "postures", {}).values()])
        return cls(shapes, _pairs(robot, shapes), placements(robot, postures))

    def near(self, R: Array, p: Array, within: float, again: bool = False) -> Iterator[tuple[int, int, NearBodies]]:
        """(first, second, where) of each pair that is nearer than a distance in some frames; arguments as `placements`.

        Pairs are not measured where they were farther apart than they have moved since, if this is called again and again,
        for poses of as many frames that are near to each other.
        """
        shapes, turns = [s for *_, s in self.shapes], R.swapaxes(0, 1)
        centres = np.array([np.matmul(turns[s.joint], s.centre) + p[:, s.joint] for s in shapes])
        some, least = list(range(len(self.pairs))), np.full((len(self.pairs) * again, len(R)), -np.inf)
        if again and self.known and self.pairs:
            turned = np.linalg.norm(turns - self.known[0], axis=(2, 3))
            moved = np.linalg.norm(centres - self.known[1], axis=2) + [s.reach * turned[s.joint] for s in shapes]
            least = self.known[2] - moved[np.array(self.pairs)].sum(axis=1)
            some = np.flatnonzero(least.min(axis=1) < within).tolist()
        for k in some:
            i, j = self.pairs[k]
            room = np.linalg.norm(centres[i] - centres[j], axis=1) - (shapes[i].reach + shapes[j].reach)
            room = np.maximum(room, least[k]) if again else room
            close = np.flatnonzero(room < within)
            if len(close) and self.at_rest(i, j) >= -DEEP_M:
                found, room[close] = _near(shapes[i], shapes[j], R, p, close, within, SPARE_M if again else 0.0)
                if len(found.frames):
                    yield i, j, found
            least[k : k + 1] = room
        self.known[:] = [turns, centres, least] if again else []

    def at_rest(self, i: int, j: int) -> float:
        """How far two shapes are apart in the robot's own postures, at most `FAR_M` [m]."""
        if (i, j) not in self.resting:
            one, other = self.shapes[i][2], self.shapes[j][2]
            gap = _near(one, other, *self.rest, np.arange(len(self.rest[0])), FAR_M)[0].gap
            self.resting[i, j] = float(gap.min(initial=FAR_M))
            if self.resting[i, j] < -DEEP_M:
                self.left_out.append((one.name, other.name))
        return self.resting[i, j]


def _near(
    one: ConvexShape, other: ConvexShape, R: Array, p: Array, frames: Array, within: float, spare: float = 0.0
) -> tuple[NearBodies, Array]:
    """(where two shapes are nearer than a distance, among some frames; how far they are apart at least in these).

    Frames before which they have not moved so far as they were apart, less what is spared, are not measured.
    """
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    back = R[frames, one.joint].swapaxes(1, 2)
    turned = np.matmul(back, R[frames, other.joint])
    centre = np.matmul(turned, other.centre) + each_times(back, p[frames, other.joint] - p[frames, one.joint])
    # the Frobenius norm is at least the largest motion of a unit vector
    steps = np.linalg.norm(np.diff(centre, axis=0), axis=1) + other.reach * np.linalg.norm(np.diff(turned, axis=0), axis=(1, 2))
    path = np.concatenate([[0.0], np.cumsum(steps)])
    hits, least, i = list[tuple[float, ...]](), np.empty(len(frames)), 0
    places = [
        (turn @ s.X_JC.rotation, turn @ s.X_JC.translation + p[frames, s.joint])
        for s in (one, other)
        for turn in (R[frames, s.joint],)
    ]
    while i < len(frames):
        X, Y = (coal.Transform3s(turn[i], place[i]) for turn, place in places)
        result.clear()
        gap = float(coal.distance(one.coal, X, other.coal, Y, request, result))
        if gap < within:
            hits.append((frames[i], gap, *result.normal, *result.getNearestPoint1(), *result.getNearestPoint2()))
        last, i = i, max(i + 1, int(np.searchsorted(path, path[i] + gap - within - spare)))
        least[last:i] = gap + path[last] - path[last:i]
    found = np.array(hits).reshape(-1, 11)
    return NearBodies(found[:, 0].astype(int), found[:, 1], found[:, 2:5], found[:, 5:8], found[:, 8:]), least


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
