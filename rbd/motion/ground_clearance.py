"""How far a robot's links are from its ground: planes, and convex pieces of terrain, along directions that separate them.

Of a convex shape and a convex piece, for each unit vector n

    distance  >=  min over the shape of n . x  -  max over the piece of n . x

with equality for the best n. That is the normal of a face of the piece wherever the shape's lowest point along it is over that
face; else it is found by Coal's distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times
from rbd.constraints.contact import Contact
from rbd.constraints.convex.convex_shapes import ConvexShape, convex_shape, polyhedron
from rbd.constraints.surface import On, surface_of
from rbd.constraints.terrain.pieces import Piece, half_space
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import ModelError
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_timeline import convex_shapes
from rbd.motion.frame_terms import placements
from rbd.motion.self_collision import DEEP_M, NearBodies
from rbd.problem.ground import Ground
from rbd.robots.robot import Robot

POINT_M = 0.05
"""A link that touches with a point rolls and tilts about it: what is this near to the point counts only as the point [m]."""
ROOM_M, ROOM_OWN_M = 0.01, 0.003
"""Links are kept so much farther than they have to be, if possible; those with a contact [m]."""
AT_ONCE = 4_000_000
"""Heights that are computed at once."""
OVER_M = 1e-9
"""A point this far beyond the edge of a face is over it [m]."""


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A convex part of a link.

    Attributes:
        link: Name of the link.
        shape: The shape; the `coal` of round ones may be larger.
        corners: All corners, shape (n, 3), in the joint's axes [m].
        contacts: Numbers of the contacts that its link touches with.
    """

    link: str
    shape: ConvexShape
    corners: Array
    contacts: tuple[int, ...] = ()

    @property
    def joint(self) -> int:
        """The joint that carries it."""
        return self.shape.joint

    def facing(self, R: Array, p: Array, faces: Array) -> Array:
        """Those of a piece's faces (N, d) that may be the highest under it at one of k placements of its joint, by a ball."""
        h = (p + R @ self.shape.centre) @ faces[:, :3].T - faces[:, 3]
        return faces[(h + 2.0 * self.shape.reach >= h.max(axis=1)[:, None]).any(axis=0)]

    def heights(self, R: Array, p: Array, faces: Array) -> Array:
        """How high it is over planes (N, d), shape (F, 4), at placements of its joint, shape (k, F) [m].

        Args:
            R: Of the joint, shape (k, 3, 3).
            p: Its origin, shape (k, 3) [m].
            faces: (N, d), N x = d.
        """
        N, out = faces[:, :3], np.empty((len(R), len(faces)))
        size = max(AT_ONCE // max(len(self.corners) * len(N), 1), 1)
        for i in range(0, len(R), size):
            some = slice(i, i + size)
            along = N @ R[some]  # the directions in the joint's axes
            least = np.full(along.shape[:2], np.inf)
            if len(self.corners):
                least = (along @ self.corners.T).min(axis=2)
            for part in self.shape.rounds:
                least = np.minimum(least, along @ part.centre - np.linalg.norm(along @ part.root, axis=2))
            out[some] = least + p[some] @ N.T - faces[:, 3]
        return out

    def lowest(self, R: Array, p: Array, n: Array) -> Array:
        """The points with the smallest n . x for one direction (3,), or one of each placement (k, 3), shape (k, 3) [m]."""
        along = each_times(R.swapaxes(1, 2), np.broadcast_to(n, p.shape))
        best, at = np.full(len(R), np.inf), np.zeros((len(R), 3))
        if len(self.corners):
            own = along @ self.corners.T
            i = own.argmin(axis=1)
            best, at = own[np.arange(len(R)), i], self.corners[i]
        for part in self.shape.rounds:
            w = along @ part.root
            size = np.linalg.norm(w, axis=1)
            x = part.centre - (w @ part.root) / np.maximum(size, 1e-300)[:, None]
            lower = along @ part.centre - size < best
            best, at = np.where(lower, along @ part.centre - size, best), np.where(lower[:, None], x, at)
        return p + each_times(R, at)


@dataclass(frozen=True, eq=False)
class OverGround:
    """Shapes of a robot's links, and the pieces of the ground that they are to stay off.

    Attributes:
        shapes: Of the links.
        pieces: Of the ground.
        own: Which pieces are of what each contact may stand on, shape (contacts, pieces).
        least: How far shapes have to be from pieces, shape (shapes, pieces) [m]; minus infinity of pairs that are left out.
        wanted: How far they are kept from these, if possible [m].
        solids: {number of a piece: the same for Coal's distances}, filled as they are needed.
    """

    shapes: tuple[LinkShape, ...]
    pieces: tuple[Piece, ...]
    own: Array
    least: Array
    wanted: Array
    solids: dict[int, ConvexShape] = field(default_factory=dict)

    @classmethod
    def of(cls, robot: Robot, contacts: Sequence[Contact], ground: On, near: Array) -> OverGround:
        """Of a robot over the ground, and over the terrain on which its contacts stand.

        A plane on which none but a contact of its own stands is a part of a body whose edges are not known, and does not count.

        Args:
            robot: The robot.
            contacts: With which it touches: their links touch what they stand on.
            ground: What counts if a contact stands on it.
            near: Places that the robot comes to, of which grids of heights are taken, shape (k, 3) [m].
        """
        level = surface_of("the ground", ground)
        pieces, on = dict[bytes, Piece](), list[set[bytes]]()
        for contact in contacts:
            found: tuple[Piece, ...] = ()
            if isinstance(contact.on, Terrain):
                contact.on.polytopes(near, 1.0)
                found = contact.on.pieces
            elif isinstance(level, Ground) and isinstance(contact.on, Ground) and _same(contact.on, level):
                found = (half_space("the ground", level),)
            keyed = {piece.faces.round(9).tobytes(): piece for piece in found}
            pieces |= keyed
            on.append(set(keyed))
        own = np.array([[key in each for key in pieces] for each in on], bool).reshape(len(on), len(pieces))
        shapes = tuple(_shapes(robot, contacts))
        none = np.zeros((len(shapes), len(pieces)))
        return cls(shapes, tuple(pieces.values()), own, none, none)

    def kept(self, clearance: float, robot: CheckedModel, q: Array, stands: Array) -> OverGround:
        """The same, with distances to keep.

        Links with a contact may be `DEEP_M` inside the pieces on which it stands in a keyframe, and are outside of all others.
        Where one of them is deeper in such a keyframe, the point that touches is not on their surface: they are left out there.
        Links that are nearer than wanted in the first or the last keyframe, or where they stand, may be so near.

        Args:
            clearance: Of links without a contact [m].
            robot: The robot.
            q: Keyframes, shape (k, nq).
            stands: Which contacts stand in these, shape (k, contacts).
        """
        R, p = placements(robot, q)
        gaps = np.full((len(q), *self.least.shape), np.inf)
        for i, j, near in self.near(R, p, clearance + ROOM_M):
            gaps[near.frames, i, j] = near.gap
        own = np.array([bool(shape.contacts) for shape in self.shapes])
        least = np.where(own[:, None], 0.0, clearance) + 0.0 * self.least
        room = np.where(own, ROOM_OWN_M, ROOM_M)[:, None]
        wanted = np.minimum(least + room, np.maximum(np.minimum(gaps[0], gaps[-1]), least))
        for c, on in enumerate(self.own):
            links = np.array([c in shape.contacts for shape in self.shapes])
            gap = gaps[stands[:, c]][:, links].min(axis=0, initial=np.inf)
            rests, deep = (on & (gap < x).any(axis=0) for x in (DEEP_M, -DEEP_M))
            least[np.ix_(links, rests)] = -DEEP_M
            least[np.ix_(links, deep)] = -np.inf
            wanted[links] = np.minimum(wanted[links], np.where(rests, np.minimum(gap, 0.0), np.maximum(gap, 0.0)))
        return replace(self, least=least, wanted=wanted)

    def near(
        self, R: Array, p: Array, within: float | Array, stands: Array | None = None
    ) -> Iterator[tuple[int, int, NearBodies]]:  # fmt: skip
        """(shape, piece, where) of each pair that is nearer than a distance in some poses.

        `NearBodies.first` is on the piece, `second` on the shape, and the normal points from the piece.

        Args:
            R: Orientations of joints, as `placements`.
            p: Their origins.
            within: The distance, or one for each pair, shape (shapes, pieces) [m].
            stands: Which contacts stand, shape (n, contacts): poses in which one of a link stands are left out.
        """
        each = np.broadcast_to(within, self.least.shape)
        for i, j, frames in self.close(R, p, each, stands):
            within = float(each[i, j])
            one, piece = self.shapes[i], self.pieces[j]
            turn, place = R[frames, one.joint], p[frames, one.joint]
            faces = one.facing(turn, place, piece.faces)
            heights = one.heights(turn, place, faces)
            best = heights.argmax(axis=1)
            gap, normal = heights[np.arange(len(frames)), best], faces[best, :3]
            some = gap < within
            if not some.any():
                continue
            frames, turn, place, gap, normal = (x[some] for x in (frames, turn, place, gap, normal))
            point = one.lowest(turn, place, normal)
            beside = np.flatnonzero(piece.depths(point - gap[:, None] * normal) > OVER_M)
            if len(beside):
                n = self._separating(i, j, turn[beside], place[beside])
                ends = one.lowest(turn[beside], place[beside], n)
                height = np.vecdot(n, ends) - (n @ piece.vertices.T).max(axis=1)
                better = height > gap[beside]
                k = beside[better]
                gap[k], normal[k], point[k] = height[better], n[better], ends[better]
            found = NearBodies(frames, gap, normal, point - gap[:, None] * normal, point).some(gap < within)
            if len(found.frames):
                yield i, j, found

    def close(
        self, R: Array, p: Array, within: Array, stands: Array | None = None
    ) -> Iterator[tuple[int, int, Array]]:  # fmt: skip
        """(shape, piece, frames) of pairs that may be as near there, by balls around the shapes; arguments as of `near`."""
        joint = np.array([s.joint for s in self.shapes], int)
        reach = np.array([s.shape.reach for s in self.shapes])
        centre = np.array([s.shape.centre for s in self.shapes]).reshape(-1, 3)
        c = p[:, joint] + each_times(R[:, joint], np.broadcast_to(centre, (len(R), *centre.shape)))
        far = (reach + within.max(axis=1, initial=0.0))[:, None]
        free = None if stands is None else [~stands[:, list(shape.contacts)].any(axis=1) for shape in self.shapes]
        low, high = c.min(axis=0) - far, c.max(axis=0) + far
        box = np.array([piece.box for piece in self.pieces]).reshape(-1, 6)
        meet = (low[:, None] <= box[:, 3:]).all(axis=2) & (high[:, None] >= box[:, :3]).all(axis=2)
        for i, j in np.argwhere(meet & ~np.isneginf(self.least)).tolist():
            near = self.pieces[j].depths(c[:, i]) < reach[i] + within[i, j]
            frames = np.flatnonzero(near if free is None else near & free[i])
            if len(frames):
                yield i, j, frames

    def _separating(self, i: int, j: int, R: Array, p: Array) -> Array:
        """Directions that separate a shape from a piece best in k poses of its joint, by Coal, shape (k, 3)."""
        one, piece, request, result = self.shapes[i].shape, self.pieces[j], coal.DistanceRequest(), coal.DistanceResult()
        solid = self.solids.get(j) or self.solids.setdefault(j, polyhedron(piece.name, piece.vertices))
        turns, places, out = R @ one.X_JC.rotation, R @ one.X_JC.translation + p, np.empty((len(R), 3))
        for k, (turn, place) in enumerate(zip(turns, places, strict=True)):
            result.clear()
            coal.distance(solid.coal, coal.Transform3s(), one.coal, coal.Transform3s(turn, place), request, result)
            out[k] = result.normal
        return np.where(np.isfinite(out), out, [0.0, 0.0, 1.0])  # of shapes that touch, sometimes

    def bounds(self, i: int, j: int, R: Array, p: Array, bent: Array, within: float) -> Array:
        """How far a shape is from a piece at least, between two poses of its joint each, shape (m,) [m].

        Args:
            i: Number of the shape.
            j: Number of the piece.
            R: Of its joint, shape (2, m, 3, 3).
            p: Its place, shape (2, m, 3) [m].
            bent: How far points of it are from straight lines between, shape (m,) [m].
            within: Directions beside faces are sought where they are nearer than this.
        """
        one, piece, m = self.shapes[i], self.pieces[j], len(bent)
        every = R.reshape(-1, 3, 3), p.reshape(-1, 3)
        faces = one.facing(*every, piece.faces)
        least = one.heights(*every, faces).reshape(2, m, -1).min(axis=0)
        best = least.argmax(axis=1)
        out, normal = least[np.arange(m), best] - bent, faces[best, :3]
        if not len(piece.vertices):
            return out
        point = one.lowest(R[0], p[0], normal)
        beside = piece.depths(point - np.vecdot(point, normal)[:, None] * normal + faces[best, 3:] * normal) > OVER_M
        k = np.flatnonzero(beside & (out < within))
        for end in range(2):
            n = self._separating(i, j, R[end, k], p[end, k])
            low = np.min([np.vecdot(n, one.lowest(R[other, k], p[other, k], n)) for other in range(2)], axis=0)
            out[k] = np.maximum(out[k], low - (n @ piece.vertices.T).max(axis=1) - bent[k])
        return out


def _same(one: Ground, other: Ground) -> bool:
    """Whether both are one plane, and it is known where."""
    if one.point is None or other.point is None:
        return False
    return bool(np.allclose(np.asarray(one.normal), np.asarray(other.normal)) and abs(one.height - other.height) < 1e-9)


def _shapes(robot: Robot, contacts: Sequence[Contact]) -> Iterator[LinkShape]:
    """Collision shapes, or visual ones where a robot has none; of links with a contact at a point without what is near to it.

    A hand's fingers touch with it: what a link with a contact carries, unless there is another contact or a foot among it.
    """
    sites = [robot.site(contact.frame) for contact in contacts]
    feet = {robot.site(foot.frame)[0] for foot in robot.feet()} if robot.source.feet else set()
    ends = {joint for joint, _ in sites} | feet
    carried = [set(robot.model.subtrees[joint]) - {joint} for joint, _ in sites]
    links = [{joint} | (beyond if not beyond & ends else set()) for (joint, _), beyond in zip(sites, carried, strict=True)]
    corners = [
        np.asarray(c.corners) @ (X * c.placement).rotation.T + (X * c.placement).translation
        for c, (_, X) in zip(contacts, sites, strict=True)
    ]
    for link, shape in _all_shapes(robot):
        own = tuple(k for k, joints in enumerate(links) if shape.joint in joints)
        touching = [corners[k] for k in own if len(corners[k]) < 3 and sites[k][0] == shape.joint]
        points = np.concatenate(touching or [np.zeros((0, 3))])
        found = LinkShape(link, shape, shape.corners, own)
        if len(points):
            kept = _away(found, points)
            if kept is None:
                continue
            found = kept
        yield found
    for k, (contact, (joint, _)) in enumerate(zip(contacts, sites, strict=True)):
        if len(corners[k]) < 3:  # what touches itself
            for x in corners[k]:
                X = pin.SE3(np.eye(3), x)
                dot = ConvexShape(contact.name, joint, x[None], (), np.zeros((0, 4)), coal.Sphere(OVER_M), X)
                yield LinkShape(contact.name, dot, x[None], (k,))


def _away(given: LinkShape, points: Array) -> LinkShape | None:
    """What of a shape is farther than `POINT_M` from some points; None: nothing."""
    shape = given.shape
    far = np.linalg.norm(given.corners[:, None] - points, axis=2).min(axis=1, initial=np.inf) > POINT_M
    rounds = tuple(r for r in shape.rounds if np.linalg.norm(points - r.centre, axis=1).min() > POINT_M)
    if not far.any() and not rounds:
        return None
    kept = given.corners[far]
    left = replace(shape, vertices=kept, rounds=rounds) if rounds else replace(polyhedron(shape.name, kept), joint=shape.joint)
    return replace(given, shape=left, corners=kept)


def _all_shapes(robot: CheckedModel) -> Iterator[tuple[str, ConvexShape]]:
    found = [(link, shape) for _, link, shape in convex_shapes(robot) if shape.joint]
    yield from found
    visual = None if found else getattr(robot, "visual_model", None)
    for each in () if visual is None else visual.geometryObjects:
        try:
            shape = convex_shape(each)
        except ModelError:
            continue
        if shape.joint:
            yield robot.model.frames[each.parentFrame].name, shape
