"""Contact points of a motion on terrain: heights above the tread under each sole, and the part of it that rests there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.constraints.surface import contact_axes
from rbd.constraints.terrain.pieces import Plates
from rbd.constraints.terrain.resting import BESIDE, SAME_NORMAL
from rbd.constraints.terrain.terrain import Terrain, check_still
from rbd.constraints.terrain.touches import Touches
from rbd.motion.contact_timeline import ContactTimeline, FloorPoints

NEAR_M = 0.25
"""A sole within this of a piece is over its top; else its corners are above what is under each of them [m]."""
LEVEL_M = 0.006
"""Tops that differ by less are one; a sole that is deeper in a wall is in it [m]."""
HIGH_M = 10.0
"""Height of points with nothing under them, or less [m]."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class OverTerrain:
    """Where the points of a motion are over a terrain, in n frames of k points.

    Each corner of a sole has a second point, used where the corner is cut off and the outline has two crossings in its place.

    Attributes:
        points: The points.
        corners: Where they are as fixed to the robot, shape (n, k, 3) [m].
        places: The same, corners over an edge moved to the part of the sole over the top that it is nearest to.
        heights: Above that top, or above what is under a point of no sole, minus the depth in a wall, shape (n, k) [m].
        rests: Which points are of that part, or of no sole, shape (n, k).
        cut: Which corners of soles are not over that top, though part of the sole is, shape (n, k).
        normals: Of that top, shape (n, k, 3).
    """

    points: FloorPoints
    corners: Array
    places: Array
    heights: Array
    rests: Array
    cut: Array
    normals: Array

    @classmethod
    def of(cls, terrain: Terrain, points: FloorPoints, R: Array, p: Array) -> OverTerrain:
        """Evaluated frame by frame.

        Args:
            terrain: The terrain.
            points: Corners of feet, and of other bodies.
            R: Orientations of the joints' axes, shape (n, joints, 3, 3).
            p: Their origins, shape (n, joints, 3).

        Raises:
            InputError: a piece of the terrain moves.
        """
        check_still(terrain)
        flat = [isinstance(c, Contact) and len(c.corners) > 1 for c in points.contacts]
        firsts = np.flatnonzero(np.array(flat)[points.group])
        k, soles = len(points), [np.flatnonzero(points.group == g) for g in np.unique(points.group[firsts])]
        second = np.full(k, -1)
        second[firsts] = k + np.arange(len(firsts))
        points = points.and_again(firsts)
        corners = points.places(R, p)
        n = len(corners)
        out = cls(
            points, corners, corners.copy(), np.minimum(terrain.heights_of(corners), HIGH_M), np.ones((n, len(points)), bool),
            np.zeros((n, len(points)), bool), np.tile(_UP, (n, len(points), 1)),
        )  # fmt: skip
        out.rests[:, k:] = False
        at = np.concatenate([[0], np.cumsum([len(own) for own in soles])]).astype(int)
        radii = np.zeros(len(soles))
        tops, ups = np.zeros((0, 4)), np.stack([_normals(corners[:, own]) for own in soles], axis=1) if soles else _UP
        for i in range(n if len(firsts) else 0):
            P = np.ascontiguousarray(corners[i, firsts])
            found = Touches.of(terrain.polytopes, Plates(P, at, ups[i], radii), NEAR_M)
            if len(tops) != len(terrain.pieces):
                tops = np.array([piece.faces[piece.faces[:, 2].argmax()] for piece in terrain.pieces])
            for s, own in enumerate(soles):
                out._stand(terrain, i, own, second[own], found, np.flatnonzero(found.which[:, 5] == s), ups[i, s], tops)
        used = np.ones(len(points), bool)
        used[k:] = out.rests[:, k:].any(axis=0)
        changed = {name: getattr(out, name)[:, used] for name in ("corners", "places", "heights", "rests", "cut", "normals")}
        return replace(out, points=points.some(used), **changed)

    @property
    def axes(self) -> Array | None:
        """Tangents and normal of what is under the points, as columns, shape (n, k, 3, 3); None where all is level."""
        if np.abs(self.normals - _UP).max(initial=0.0) <= SAME_NORMAL:
            return None
        different, at = np.unique(self.normals.reshape(-1, 3), axis=0, return_inverse=True)
        return np.array([contact_axes(normal) for normal in different])[at].reshape(*self.normals.shape, 3)

    def of_timeline(self, lanes: ContactTimeline, kept: Array) -> ContactTimeline:
        """Contacts of some of the points, with the places at which soles rest."""
        axes = self.axes
        return replace(lanes, places=self.places[:, kept], cut=self.cut[:, kept], axes=None if axes is None else axes[:, kept])

    def _stand(
        self, terrain: Terrain, i: int, own: Array, second: Array, found: Touches, near: Array, up: Array, tops: Array
    ) -> None:
        """Frame i of a sole: what it is over, by the points at which it is near to pieces.

        Over an edge they are those of the sole laid flat onto the top: one that is tilted by a millionth touches with a point.
        """
        is_under = found.normals[near] @ up > BESIDE
        under, walls = near[is_under], near[~is_under]
        depth = min(0.0, float(found.gaps[walls].min(initial=0.0)))
        free = own
        if len(under):
            top = tops[found.which[under[found.gaps[under].argmin()], 3]]
            under = under[np.abs(tops[found.which[under, 3]] - top).max(axis=1) <= LEVEL_M]
            places, kinds, n = found.places[under], found.which[under], top[:3]
            if np.count_nonzero(kinds[:, 0] == 0) < len(own):
                corners = self.corners[i, own]
                flat = corners - np.outer(corners @ n - top[3], n)
                plate = Plates(np.ascontiguousarray(flat), np.array([0, len(own)]), n[None].copy(), np.zeros(1))
                laid = Touches.of(terrain.polytopes, plate, LEVEL_M)
                over = (laid.normals @ n > BESIDE) & (np.abs(tops[laid.which[:, 3]] - top).max(axis=1) <= LEVEL_M)
                kinds, places = laid.which[over], laid.places[over]
                places = places + np.outer((corners[0] - places) @ up / (n @ up), n)
            at_corner = kinds[:, 0] == 0
            whole = np.zeros(len(own), bool)
            whole[kinds[at_corner, 1]] = True
            free = own[~whole]
            self.heights[i, own[whole]] = self.corners[i, own[whole]] @ top[:3] - top[3]
            self.normals[i, own] = self.normals[i, second] = top[:3]
            slots = np.concatenate([free, second[~whole]])
            self.cut[i, slots], self.rests[i, free] = True, False
            for x in places[~at_corner][: len(slots)]:  # corners on an edge are crossings too
                j = int(np.where(self.rests[i, slots], np.inf, np.linalg.norm(self.corners[i, slots] - x, axis=1)).argmin())
                slot = slots[j]
                self.places[i, slot], self.heights[i, slot], self.rests[i, slot] = x, x @ top[:3] - top[3], True
            free = slots[~self.rests[i, slots]]
        self.heights[i, free] = np.maximum(self.heights[i, free], depth)
        if depth < -LEVEL_M:
            x = found.places[walls[found.gaps[walls].argmin()]]
            self.heights[i, own[np.linalg.norm(self.corners[i, own] - x, axis=1).argmin()]] = depth


def _normals(corners: Array) -> Array:
    """Of a sole's corners in order, shape (n, k, 3), on the upper side, shape (n, 3); of an edge z."""
    if corners.shape[1] < 3:
        return np.tile(_UP, (len(corners), 1))
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    return np.asarray(n * (np.copysign(1.0, n[:, 2]) / np.linalg.norm(n, axis=1))[:, None])
