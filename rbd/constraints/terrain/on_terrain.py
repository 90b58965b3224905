"""Contacts on terrain, as points: of their corners, of their outline over edges, and of what is under them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rbd.arrays import Array, zeros
from rbd.constraints.contact_points import MARGIN, Group, Measured, Structure
from rbd.constraints.ground_points import PlanePoints
from rbd.constraints.surface import UP, cone_of, contact_axes, out_along
from rbd.constraints.terrain.pieces import CORNER, ON_FACE, Plates
from rbd.constraints.terrain.touches import Touches
from rbd.model.state import State

BESIDE = 0.5
"""A point whose normal has less than this along a sole's is beside it, as at a riser."""
_KINDS = ("corner {} on", "outline {} over", "under it,", "outline {} nearest to")
_BESIDE = ("corner {} beside", "outline {} beside", "beside", "outline {} beside")
_NONE = zeros((0, 7))
_MOST_STRUCTURES = 1000
"""Number of cached sets of points; a sole that slides over many pieces can have a new one at every step."""


class OnTerrain:
    """Points of contacts on one terrain, computed together: those nearer than `MARGIN`.

    Args:
        contacts: Contacts with a coefficient of friction; all at points, or all of edges and patches.
        start: Any state of the robot.
    """

    def __init__(self, contacts: Sequence[Any], start: State) -> None:
        self.contacts, self._robot = tuple(contacts), start.robot
        self.terrain = contacts[0].on
        sites = [self._robot.site(c.frame) for c in contacts]
        self.placements = [X_JF * c.placement for c, (_, X_JF) in zip(contacts, sites, strict=True)]
        self.joints = sorted({joint for joint, _ in sites})
        self._joint = np.array([self.joints.index(joint) for joint, _ in sites])
        self._carries = np.array([self._robot.joints.carrying(joint) for joint in self.joints])
        self._at = np.concatenate([[0], np.cumsum([len(c.corners) for c in contacts])]).astype(int)
        each = np.repeat(np.arange(len(contacts)), [len(c.corners) for c in contacts])
        self._of = self._joint[each]
        self._arms = np.concatenate(
            [X.translation + c.corners @ X.rotation.T for c, X in zip(contacts, self.placements, strict=True)]
        )
        self._centres = np.array([X.translation for X in self.placements])
        self._ups = np.array(
            [X.rotation[:, 2] if len(c.corners) > 2 else UP for c, X in zip(contacts, self.placements, strict=True)]
        )
        R = start.joint_places(self.joints)[0][self._joint]
        self._alongs = np.array([
            Q @ X.rotation[:, 0] if len(c.corners) > 1 else UP[[2, 0, 1]]
            for c, X, Q in zip(contacts, self.placements, R, strict=True)
        ])  # fmt: skip
        self._flat = np.array([len(c.corners) > 2 for c in contacts])
        self.alone = len(contacts[0].corners) == 1
        self._cones = tuple(cone_of(c.name, c.corners[:1], c.friction, c.facets) for c in contacts)
        self._names, self._radii = [c.name for c in contacts], np.zeros(len(contacts))
        self._kept = np.array([[c.dim == 3, c.dim == 3, True] for c in self._cones])
        self._some = not self._kept.all()
        self._most = max(len(c.corners) for c in contacts)
        self._numbers: dict[tuple[int, ...], int] = {}
        self._labels: dict[tuple[int, ...], str] = {}
        self._first: dict[tuple[int, int], int] = {}  # the plane in which each corner was seen first
        self._seen: dict[bytes, Structure] = {}

    @classmethod
    def joined(cls, sources: Sequence[OnTerrain], start: State) -> OnTerrain:
        """Several sources as one."""
        return cls([contact for source in sources for contact in source.contacts], start)

    @property
    def group(self) -> Group | None:
        """Contacts on the same terrain are computed together."""
        return OnTerrain.joined, (id(self.terrain), self.alone)

    def touches(self, state: State, margin: float = MARGIN) -> tuple[Touches, Array, Array]:
        """(what they touch, R_WJ and places of their joints) at a state."""
        R, p = state.joint_places(self.joints)
        return self.touches_of(R, p, state.t, margin), R, p

    def touches_of(self, R: Array, p: Array, t: float, margin: float = MARGIN) -> Touches:
        """What they touch at a time [s], with R_WJ and places of their joints, shapes (joints, 3, 3) and (joints, 3)."""
        plates = (R[self._of] @ self._arms[:, :, None])[:, :, 0] + p[self._of]
        ups = np.where(self._flat[:, None], (R[self._joint] @ self._ups[:, :, None])[:, :, 0], self._ups)
        return Touches.of(self.terrain.polytopes, Plates(plates, self._at, ups, self._radii), margin, t)

    def gaps(self, state: State, t: float) -> Array:
        """The gaps of `at`."""
        return self.touches(state)[0].gaps

    def at(self, state: State, t: float) -> Measured:
        """Their points at a state."""
        return self.measured(state, *self.touches(state))

    def measured(self, state: State, found: Touches, R: Array, p: Array) -> Measured:
        """Their points at a state where `touches` found them."""
        plate, P = found.which[:, 5], found.places
        axes, J, velocity, bias = found.rows(state, self.joints, self._joint, self._carries, self._alongs)
        kept = np.flatnonzero(self._kept[plate].ravel()) if self._some else slice(None)
        arms = None if self.alone else P - ((R[self._joint] @ self._centres[:, :, None])[:, :, 0] + p[self._joint])[plate]
        return Measured(
            self.structure(found), J[kept], velocity[kept], bias[kept], found.gaps, zeros(len(J))[kept],
            None, arms, P, axes,
        )  # fmt: skip

    def passing(self, found: Touches, R: Array, p: Array) -> Array:
        """Points that are not corners over faces: their place in their joint's axes, normal, and plane, shape (k, 7).

        The arguments are those of `measured`. They are other points of the body where it moves; a body at rest keeps them.
        """
        at = np.flatnonzero((found.which[:, 0] != CORNER) | (found.which[:, 4] != ON_FACE))
        if not len(at):
            return _NONE
        of, P, n = self._joint[found.which[at, 5]], found.places[at], found.normals[at]
        local = (R[of].swapaxes(1, 2) @ (P - p[of])[:, :, None])[:, :, 0]
        return np.concatenate([local, n, (np.vecdot(n, P) - found.gaps[at])[:, None]], axis=1)

    def on_planes(self, found: Touches, passing: Array) -> PlanePoints | None:
        """The points as points on planes, those of `passing` where they are now; None of moving pieces."""
        kind, corner, face, piece, how, plate = found.which.T
        pieces = [self.terrain.pieces[i] for i in piece.tolist()]
        if any(each.kind is not None for each in pieces):
            return None
        fixed = (kind == CORNER) & (how == ON_FACE)
        planes, arms = np.empty((len(kind), 4)), np.empty((len(kind), 3))
        arms[~fixed], planes[~fixed] = passing[:, :3], passing[:, 3:]
        arms[fixed] = self._arms[(self._at[plate] + corner)[fixed]]
        for k in np.flatnonzero(fixed).tolist():
            planes[k] = pieces[k].faces[face[k]]
        axes = np.array([contact_axes(n, along) for n, along in zip(planes[:, :3], self._alongs[plate], strict=True)])
        return PlanePoints(
            self._robot, self.structure(found), np.array(self.joints)[self._joint[plate]],
            partial(np.stack, [arms, arms - self._centres[plate]], axis=2), axes.reshape(-1, 3, 3), planes[:, 3],
            point_alone=self.alone,
        )  # fmt: skip

    def label(self, number: int) -> str:
        """What a point is, by its number in this motion."""
        if number < self._most:
            return f"corner {number}"
        return list(self._labels.values())[number - self._most]

    def name_of(self, found: Touches, point: int) -> str:
        """What a point is, the piece in which it is, and the way out."""
        kind, i, _, piece, _, plate = found.which[point].tolist()
        name = f"{self._names[plate]}, {_KINDS[kind].format(i)} {self.terrain.pieces[piece].name}"
        return name + out_along(found.normals[point])

    def structure(self, found: Touches) -> Structure:
        """The same object for the same points: corners keep their numbers from one piece to the next in its plane."""
        key = found.which.tobytes()
        known = self._seen.get(key)
        if known is None:
            numbers, owners = list[int](), list[int]()
            steep = self._flat[found.which[:, 5]] & (np.vecdot(found.normals, found.plates.ups[found.which[:, 5]]) < BESIDE)
            for (kind, i, j, piece, _, plate), beside in zip(found.which.tolist(), steep.tolist(), strict=True):
                at = self.terrain.plane(piece, j) if kind == 0 else piece
                if kind == 0 and not beside and self._first.setdefault((plate, i), at) == at:
                    numbers.append(i)
                else:
                    what = (plate, kind, i, 0 if kind == 0 else j, at)
                    name = (_BESIDE if beside else _KINDS)[kind].format(i)
                    self._labels.setdefault(what, f"{name} {self.terrain.pieces[piece].name}")
                    numbers.append(self._most + self._numbers.setdefault(what, len(self._numbers)))
                owners.append(plate)
            names, cones = tuple(self._names[o] for o in owners), tuple(self._cones[o] for o in owners)
            pieces = tuple(self.terrain.pieces[piece].name for piece in found.which[:, 3].tolist())
            if len(self._seen) >= _MOST_STRUCTURES:
                self._seen.clear()
            known = self._seen[key] = Structure(names, tuple(numbers), cones, pieces)
        return known


def rests(label: str, part: Sequence[int] | None) -> bool:
    """Whether a point with this label is under its contact, or under some of its corners."""
    kind, number, *_ = label.split()
    return "beside" not in label and (part is None or (kind == "corner" and int(number) in part))
