"""Collision shapes of a robot on terrain: balls, hulls, and pairs of a round or flat shape with a piece."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.contact_kinematics import Between, Touching, points_of_pair
from rbd.constraints.convex.closest_points import meeting
from rbd.constraints.convex.convex_shapes import ConvexShape, polyhedron
from rbd.constraints.surface import UP
from rbd.constraints.terrain.facets import Facets
from rbd.constraints.terrain.pieces import CORNER, UNDER, Piece, Plates, Spots
from rbd.constraints.terrain.terrain import Terrain
from rbd.constraints.terrain.touches import Touches, filled, kernel
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

NEAR_M = 0.01
"""A hull this near to an edge of a piece touches more than a plane; a round shape this near is a pair for Coal's distance."""
_X = np.array([1.0, 0.0, 0.0])
_MOST = 1000
"""Sets of corners whose numbers are kept."""
_ROOM = 256
"""Points and pairs for which there is room at first."""


class OnPieces:
    """Contact points of shapes with terrain. Not for two threads at once.

    Points of hulls and balls keep their numbers from one face to the next.

    Args:
        robot: The robot.
        shapes: Those that can touch.
        terrain: What they touch.
    """

    def __init__(self, robot: CheckedModel, shapes: Sequence[ConvexShape], terrain: Terrain) -> None:
        self.robot, self.terrain = robot, terrain
        self.joints = sorted({shape.joint for shape in shapes})
        of = np.array([self.joints.index(shape.joint) for shape in shapes])
        self._carries = np.array([robot.joints.carrying(joint) for joint in self.joints])
        balls = [(i, j) for i, shape in enumerate(shapes) for j, part in enumerate(shape.rounds) if part.is_ball]
        self._ball_names = [f"{shapes[i].name}:{len(shapes[i].vertices) + j}" for i, j in balls]
        shafts = [i for i, shape in enumerate(shapes) if len(shape.rounds) == 2 and not len(shape.vertices)]
        shafts = [i for i in shafts if all(part.is_ball for part in shapes[i].rounds)]  # of capsules
        self._ball_names += [f"{shapes[i].name}:shaft" for i in shafts]
        parts = [shapes[i].rounds[j] for i, j in balls] + [part for i in shafts for part in shapes[i].rounds]
        self._balls, sizes = np.array([b.centre for b in parts]).reshape(-1, 3), [1] * len(balls) + [2] * len(shafts)
        self._of_balls = (
            np.concatenate([[0], np.cumsum(sizes)]).astype(int), np.tile(UP, (len(sizes), 1)),
            np.array([*[b.reach for b in parts[: len(balls)]], *[shapes[i].rounds[0].reach for i in shafts]]),
        )  # fmt: skip
        hulls = [i for i, shape in enumerate(shapes) if len(shape.vertices) or not all(part.is_ball for part in shape.rounds)]
        self._hulls = [shapes[i] for i in hulls]
        self._body, self._ball_body = of[hulls].astype(int), of[[*[i for i, _ in balls], *shafts]].astype(int)
        self._ball_corners = np.repeat(self._ball_body, sizes)
        self._facets = Facets.of(self._hulls)
        self._bounds = (
            np.array([s.centre for s in self._hulls]).reshape(-1, 3), np.array([s.reach for s in self._hulls]),
            np.diff(self._facets.begins[:, 1]) == 0,
        )  # fmt: skip
        self._prepare()

    def _prepare(self) -> None:
        self._numbers: dict[tuple[object, ...], int] = {}
        self._faces: dict[tuple[str, int], int] = {}
        self._seen: dict[bytes, Array] = {}
        self._between = Between(self.robot, (), 0)
        self._solids: dict[int, ConvexShape] = {}

    def another(self) -> OnPieces:
        """The same with caches of its own."""
        out = copy(self)
        out._prepare()
        return out

    def label(self, number: int) -> str:
        """The name of a point."""
        return str(list(self._numbers)[number][0])

    def at(self, state: State, margin: float) -> list[Touching]:
        """The points within a margin [m]."""
        R, p = state.joint_places(self.joints)
        parts = []
        if len(self._balls):
            centres = (R[self._ball_corners] @ self._balls[:, :, None])[:, :, 0] + p[self._ball_corners]
            found = Touches.of(self.terrain.polytopes, Plates(centres, *self._of_balls), margin, state.t)
            parts += self._rows(state, found, self._ball_body, self._followed(found.which))
        if self._hulls:
            found, which, pairs = self._on_hulls(R, p, margin, state.t)
            parts += self._rows(state, found, self._body[which[:, 5]], self._numbered(which))
            parts += self._paired(state, R, p, pairs, margin)
        return parts

    def _on_hulls(self, R: Array, p: Array, margin: float, t: float) -> tuple[Touches, Array, Array]:
        """(points of hulls, each of a plate of its own; `which`; pairs of a round or flat shape and a piece), at a time [s]."""
        centres, reach, general = self._bounds
        places = (R[self._body] @ centres[:, :, None])[:, :, 0] + p[self._body]
        far, pairs = float(reach.max()) + margin, np.empty((0, 2), int)
        lines, ups = np.empty((0, 2, 3)), np.empty((0, 3))
        arrays = self.terrain.polytopes(places, far, t)
        R, p = np.ascontiguousarray(R), np.ascontiguousarray(p)

        def run(out: Spots) -> int:
            nonlocal pairs, lines, ups
            most = len(out.gaps)
            pairs, lines, ups = np.empty((most, 2), int), np.empty((most, 2, 3)), np.empty((most, 3))
            k, n = kernel("hull").hulls(
                R, p, self._body, centres, reach, general, self._facets, margin, NEAR_M, arrays, out, lines, ups, pairs
            )
            pairs = pairs[:n]
            return int(k)

        spots = filled(_ROOM, run)
        k, which = len(spots.gaps), spots.which.copy()
        spots.which[:, 1], spots.which[:, 5] = 0, np.arange(k)
        plates = Plates(lines[:k].reshape(-1, 3), np.arange(0, 2 * k + 1, 2), ups[:k], np.zeros(k))
        return Touches(plates, spots, arrays.rates), which, pairs

    def _rows(self, state: State, found: Touches, body: Array, numbers: Array) -> list[Touching]:
        """The rows of points on pieces, if there are any; `body` of each of their plates."""
        if not len(found.gaps):
            return []
        axes, J, velocity, bias = found.rows(state, self.joints, body, self._carries, np.tile(_X, (len(body), 1)))
        pieces = tuple([self.terrain.pieces[piece].name for piece in found.which[:, 3].tolist()])
        return [Touching(numbers, self.label, found.places, axes, found.gaps, J, velocity, bias, pieces)]

    def _numbered(self, which: Array) -> Array:
        """Numbers of points of hulls: a corner keeps its own from one piece to the next in its plane, an edge over an edge."""
        key = which.tobytes()
        if key not in self._seen:
            if len(self._seen) >= _MOST:
                self._seen.clear()
            self._seen[key] = np.array([self._number(self._key(*row)) for row in which.tolist()], int)
        return self._seen[key]

    def _key(self, kind: int, i: int, j: int, piece: int, _: int, s: int) -> tuple[object, ...]:
        """What a point of a hull is: its name, and what it has in common with the same point at other states."""
        name, solid = self._hulls[s].name, self.terrain.pieces[piece]
        if kind == CORNER:
            return f"{name}:{i}", self.terrain.plane(piece, j)
        if kind == UNDER:
            return f"{name}:face|{solid.name}:{j}", piece
        d, c = divmod(j, len(solid.vertices))
        a, b = self._facets.edges[self._facets.begins[s, 2] + i, :2].tolist()
        return f"{name}:{a}-{b}|{solid.name}:{c}-{d}", piece

    def _followed(self, which: Array) -> Array:
        """Numbers of balls and shafts: a ball on an edge is the point that it was on the face before."""
        out, balls = [], int((self._of_balls[0][1:] - self._of_balls[0][:-1] == 1).sum())
        for kind, _, j, piece, _, plate in which.tolist():
            name = self._ball_names[plate]
            if plate >= balls:
                out.append(self._number((f"{name}|{self.terrain.pieces[piece].name}:{kind}-{j}", piece)))
                continue
            at = self.terrain.plane(piece, j) if kind == 0 else self._faces.get((name, piece), self.terrain.plane(piece, -1))
            self._faces[name, piece] = at
            out.append(self._number((name, at)))
        return np.array(out, int)

    def _paired(self, state: State, R: Array, p: Array, pairs: Array, margin: float) -> list[Touching]:
        """The points of pairs of a round or flat shape and a piece."""
        out, times = [], Counter[str]()
        for s, piece in pairs.tolist():
            shape, solid = self._hulls[s], self._solid(piece)
            b, given = int(self._body[s]), self.terrain.pieces[piece]
            X, under = pin.SE3(R[b], p[b]), given.motion(state)
            met = meeting(shape, X, solid, under.X_WF, margin)
            if met is None:
                continue
            numbers = []
            for at in met.crossings:
                numbers.append(self._number((at.name, "pair", times[at.name])))
                times[at.name] += 1
            motions = self._between.motion(state, shape.joint), under
            found = points_of_pair(met, (shape, solid), motions, np.array(numbers), self.label)
            if given.rates is not None:  # a belt; its velocity along the edge is taken as constant
                belt = found.axes[0].T @ given.rates[6:]
                found = replace(found, velocity=found.velocity - np.tile([belt[0], belt[1], 0.0], len(numbers)))
            out.append(replace(found, pieces=(given.name,) * len(numbers)))
        return out

    def _solid(self, piece: int) -> ConvexShape:
        known = self._solids.get(piece)
        if known is None:
            found: Piece = self.terrain.pieces[piece]
            known = self._solids[piece] = polyhedron(found.name, found.vertices)
        return known

    def _number(self, key: tuple[object, ...]) -> int:
        return self._numbers.setdefault(key, len(self._numbers))
