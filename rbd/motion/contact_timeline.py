"""`ContactTimeline`: which points of a robot touch the floor and slide on it, over time; the points; their contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from rbd.arrays import Array, as_float
from rbd.constraints.collision import CollisionContacts
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import Contact
from rbd.constraints.convex.convex_shapes import ConvexShape, convex_shape
from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed
from rbd.errors import InputError, ModelError, UnknownName, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.urdf import grouped
from rbd.robots.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class ContactTimeline(Displayed):
    """Which contact points touch and slide, when: a lane for each of k points, in n frames.

    Attributes:
        t: Times, shape (n,) [s].
        points: The points.
        touches: Which of them touch, shape (n, k).
        slides: Which of those that touch slide, shape (n, k).
        heights: Above the floor, shape (n, k) [m].
        speeds: Along the floor, by the slope of the position while it touches, shape (n, k) [m/s]; NaN where it does not.
        places: Positions, shape (n, k, 3) [m]; on terrain of a corner over an edge, of the part of its sole that rests.
        ground: Height of the floor [m], or the terrain.
        noise: What the decimals of the data leave in a speed, standard deviation, shape (n, k) [m/s].
        raised: Which of those that touch are above the floor: of a tilted sole, or of a foot that hovers, shape (n, k).
        notes: What was assumed, in words.
        cut: On terrain: which corners of soles are over an edge, shape (n, k); None on a floor.
        axes: On terrain that is not level: tangents and normal of what is under each point, as columns, shape (n, k, 3, 3).

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
        >>> lanes = rbd.motion.find_contacts(hop)
        >>> lanes.names, lanes.intervals("front_left")
        (('front_left 1', 'front_right 1', 'hind_left 1', 'hind_right 1'), [(0.0, 0.06), (0.56, 0.6)])
    """

    t: Array
    points: FloorPoints
    touches: Array
    slides: Array
    heights: Array
    speeds: Array
    places: Array
    ground: float | Terrain
    noise: Array
    raised: Array
    notes: tuple[str, ...] = ()
    cut: Array | None = None
    axes: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the points."""
        return self.points.names

    @property
    def contacts(self) -> tuple[Constraint, ...]:
        """The contacts that the points belong to; `points.group` says which."""
        return self.points.contacts

    def heights_over(self, points: Array) -> Array:
        """Heights of points (..., 3) above the floor, or above what is under them on terrain, shape (...) [m]."""
        ground = self.ground
        return ground.heights_of(points) if isinstance(ground, Terrain) else np.asarray(points[..., 2] - ground)

    def of_contact(self, name: str) -> Array:
        """Whether a point, or any point of a contact, touches, shape (n,)."""
        return np.asarray(self.touches[:, self._chosen(name)].any(axis=1))

    def at_frames(self, chosen: Array | slice) -> ContactTimeline:
        """The same contacts in some of the frames, by a mask, indices or a slice."""
        arrays = ("t", "touches", "slides", "heights", "speeds", "places", "noise", "raised", "cut", "axes")
        given = {name: getattr(self, name) for name in arrays}
        return replace(self, **{name: x[chosen] for name, x in given.items() if x is not None})

    def with_touch(self, name: str, start: float, end: float, touches: bool = True) -> ContactTimeline:
        """A copy in which a point, or all points of a contact, touch from start to end, or do not.

        Points that are said to touch hold, unless they were found to slide or to be raised.

        Args:
            name: Of a point, "left_sole 1", or of a contact, "left_sole".
            start: Time [s].
            end: Time [s].
            touches: Whether they touch.

        Raises:
            UnknownName: with the nearest names.
            InputError: an end before the start.
        """
        first, last = as_float(start), as_float(end)
        if not first <= last:
            raise InputError(f"from {start!r:.40} to {end!r:.40} s; expected a start and a later end.")
        when = (self.t >= first) & (self.t <= last)
        changed = self.touches.copy()
        changed[np.ix_(when, self._chosen(name))] = bool(touches)
        return replace(self, touches=changed, slides=self.slides & changed, raised=self.raised & changed)

    def of(self, names: Sequence[str], intervals: Sequence[Sequence[Sequence[float]]]) -> ContactTimeline:
        """A copy in which exactly these touch.

        Args:
            names: Points or contacts.
            intervals: For each of them a list of (start, end) [s].

        Raises:
            UnknownName: with the nearest names.
            InputError: another number of intervals than of names.
        """
        if len(names) != len(intervals):
            raise InputError(f"{len(intervals)} lists of intervals for {len(names)} names; expected one for each.")
        none = np.zeros_like(self.touches)
        found = replace(self, touches=none, slides=none, raised=none)
        for name, each in zip(names, intervals, strict=True):
            for start, end in each:
                found = found.with_touch(name, start, end)
        return replace(found, slides=self.slides & found.touches, raised=self.raised & found.touches)

    @property
    def on_floor(self) -> Array:
        """Which points touch and are not raised, shape (n, k)."""
        return np.asarray(self.touches & ~self.raised)

    def over_edge(self, frames: Array | Sequence[int] | slice) -> str:
        """Which soles stand over an edge of the terrain in some of these frames: ", left_sole stands over an edge"; or ""."""
        if self.cut is None:
            return ""
        cut, touches = (self.points.group_reduced(np.logical_or, x[frames]) for x in (self.cut, self.touches))
        over = (cut & touches).any(axis=0)
        names = [contact.name for contact, is_over in zip(self.contacts, over, strict=True) if is_over]
        return f", {' and '.join(names)} {'stand' if len(names) > 1 else 'stands'} over an edge" if names else ""

    @property
    def zero(self) -> float:
        """Height of the level floor, 0 on terrain [m]."""
        return 0.0 if isinstance(self.ground, Terrain) else self.ground

    def under(self, contacts: Sequence[int]) -> Array:
        """Height of what is under some contacts, at their lowest points, shape (n, len(contacts)) [m]."""
        out = np.zeros((len(self.t), len(contacts)))
        for f, g in enumerate(contacts):
            own = np.flatnonzero(self.points.group == g)
            lowest = own[self.heights[:, own].argmin(axis=1)][:, None]
            place, height = (np.take_along_axis(x, lowest, axis=1)[:, 0] for x in (self.places[..., 2], self.heights))
            out[:, f] = place - height
        return out

    def level(self, what: str) -> float:
        """Height of the floor [m].

        Raises:
            InputError: it is a terrain, on which a motion cannot be `what`.
        """
        if isinstance(self.ground, Terrain):
            raise InputError(
                f"the contacts are those on {self.ground}; a motion can be {what} on a level floor only: check it with "
                "ground=, a height [m]."
            )
        return self.ground

    def intervals(self, name: str) -> list[tuple[float, float]]:
        """When a point, or any point of a contact, touches: (first time, last time) of each stretch [s]."""
        return [(float(self.t[i]), float(self.t[j - 1])) for i, j in stretches(self.of_contact(name))]

    def stages(self, name: str) -> list[tuple[float, float, tuple[int, ...]]]:
        """(start, end, which) of each stretch in which the same points of a contact touch: an edge, or all of a sole.

        From the last frame before it to the first one after it [s]; points are counted from 0.
        """
        own, last = self.touches[:, self._chosen(name)], len(self.t) - 1
        cuts = [0, *(np.flatnonzero((own[1:] != own[:-1]).any(axis=1)) + 1).tolist(), last + 1]
        return [
            (float(self.t[max(i - 1, 0)]), float(self.t[min(j, last)]), tuple(np.flatnonzero(own[i]).tolist()))
            for i, j in zip(cuts[:-1], cuts[1:], strict=True)
            if own[i].any()
        ]

    def _chosen(self, name: str) -> Array:
        groups = [contact.name for contact in self.contacts]
        if name in groups:
            return np.flatnonzero(self.points.group == groups.index(name))
        if name in self.names:
            return np.array([self.names.index(name)])
        raise UnknownName(f"no contact or point {name!r:.80}; {nearest(name, [*groups, *self.names])}.")

    def __repr__(self) -> str:
        return f"ContactTimeline({len(self.t)} frames, {', '.join(c.name for c in self.contacts)})"


def stretches(on: Array) -> list[tuple[int, int]]:
    """(first, last + 1) of each run of true values."""
    around = np.concatenate([[False], on, [False]])
    begins, ends = np.flatnonzero(around[1:] & ~around[:-1]), np.flatnonzero(around[:-1] & ~around[1:])
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""A mesh counts as its vertices farthest along these."""


AGAIN = "b"
"""What the name of a corner's second point ends in: of a sole on terrain."""


@dataclass(frozen=True, eq=False)
class FloorPoints:
    """Points fixed to bodies, or lowest points of balls fixed to them.

    Attributes:
        robot: The robot.
        contacts: The contacts that they belong to: feet, and one `CollisionContacts` for each other body.
        names: A name for each point: that of its contact and a number, from 1.
        group: Index of each point's contact, shape (k,).
        joint: Index of the joint that carries it, shape (k,).
        local: Its place, or its ball's centre, in that joint's axes, shape (k, 3) [m].
        radius: Of its ball; zero for a point, shape (k,) [m].
    """

    robot: CheckedModel
    contacts: tuple[Constraint, ...]
    names: tuple[str, ...]
    group: Array
    joint: Array
    local: Array
    radius: Array

    @classmethod
    def of(cls, robot: CheckedModel, *, bodies: bool = False) -> FloorPoints:
        """The corners of its feet; and those of the collision shapes of all other bodies.

        Round bodies touch with the lowest points of their balls; of a mesh up to 26 extreme vertices count.

        Args:
            robot: The robot.
            bodies: Whether other bodies than feet can touch.

        Raises:
            InputError: it has neither feet nor shapes that could touch.
        """
        feet = [] if not isinstance(robot, Robot) or not robot.source.feet else list(robot.feet())
        groups: list[tuple[Constraint, int, Array, Array]] = [(foot, *_corners(robot, foot)) for foot in feet]
        if bodies or not feet:
            groups += _bodies(robot, {joint for _, joint, _, _ in groups})
        if not groups:
            raise InputError(
                f"no feet are known for {robot.name}, and it has no collision shapes: nothing can touch the floor. Name the "
                "frames of its feet: rbd.load_robot(file, feet=[...])."
            )
        sizes = [len(local) for *_, local, _ in groups]
        return cls(
            robot,
            tuple(contact for contact, *_ in groups),
            tuple(f"{c.name} {i + 1}" for (c, *_), size in zip(groups, sizes, strict=True) for i in range(size)),
            np.repeat(np.arange(len(groups)), sizes),
            np.repeat([joint for _, joint, _, _ in groups], sizes),
            np.concatenate([local for *_, local, _ in groups]),
            np.concatenate([radius for *_, radius in groups]),
        )

    def __len__(self) -> int:
        return len(self.names)

    def some(self, which: Array) -> FloorPoints:
        """Those that a mask chooses, of the same contacts."""
        names = tuple(name for name, chosen in zip(self.names, which, strict=True) if chosen)
        return FloorPoints(
            self.robot, self.contacts, names, self.group[which], self.joint[which], self.local[which], self.radius[which]
        )

    def and_again(self, which: Array) -> FloorPoints:
        """These points, and some of them, by index, a second time behind them."""
        again = np.concatenate([np.arange(len(self)), which])
        names = (*self.names, *(f"{self.names[i]}{AGAIN}" for i in which))
        return FloorPoints(
            self.robot, self.contacts, names, self.group[again], self.joint[again], self.local[again], self.radius[again]
        )

    def group_reduced(self, of: np.ufunc, values: Array) -> Array:
        """Values of points, shape (n, k), reduced over the points of each contact, shape (n, contacts); zero without points.

        Args:
            of: As `np.minimum` or `np.logical_or`.
            values: Of the points.
        """
        out = np.zeros((len(values), len(self.contacts)), values.dtype)
        for g in np.unique(self.group):
            out[:, g] = of.reduce(values[:, self.group == g], axis=1)
        return out

    def tilts(self, heights: Array) -> Array:
        """Angle between each contact's corners and a level floor, shape (n, contacts) [rad]; zero of a point, and of bodies.

        Args:
            heights: Of the points, shape (n, k) [m].
        """
        out = np.zeros((len(heights), len(self.contacts)))
        for g, contact in enumerate(self.contacts):
            own = np.flatnonzero(self.group == g)
            if isinstance(contact, Contact) and len(own) > 1:
                U, size, _ = np.linalg.svd(self.local[own] - self.local[own].mean(axis=0), full_matrices=False)
                along = size > 1e-6 * size[0]  # heights over lengths along the sole's axes: the sine of the tilt
                slope = np.linalg.norm(heights[:, own] @ (U[:, along] / size[along]), axis=1)
                out[:, g] = np.arcsin(np.minimum(slope, 1.0))
        return out

    def places(self, R: Array, p: Array) -> Array:
        """Where they are in W, shape (n, k, 3) [m].

        Args:
            R: Orientation of every joint's axes, shape (n, joints, 3, 3).
            p: Their origins, shape (n, joints, 3).
        """
        out = np.matmul(R[:, self.joint], self.local[:, :, None])[..., 0] + p[:, self.joint]
        out[..., 2] -= self.radius
        return out


def _corners(robot: CheckedModel, foot: Contact) -> tuple[int, Array, Array]:
    joint, X_JF = robot.site(foot.frame)
    if foot.ball is not None:
        return joint, X_JF.act(np.array(foot.ball.centre))[None], np.array([foot.ball.radius])
    X = X_JF * foot.placement
    return joint, foot.corners @ X.rotation.T + X.translation, np.zeros(len(foot.corners))


def _bodies(robot: CheckedModel, feet: set[int]) -> Iterator[tuple[Constraint, int, Array, Array]]:
    """Shapes by the link that carries them; those of feet are left out, their soles count."""
    found = ((link, shape) for _, link, shape in convex_shapes(robot) if shape.joint and shape.joint not in feet)
    for link, shapes in grouped(found).items():
        local, radius = zip(*(_extremes(shape) for shape in shapes), strict=True)
        contact = CollisionContacts(link, robot, ground=[shape.name for shape in shapes])
        yield contact, shapes[0].joint, np.concatenate(local), np.concatenate(radius)


def convex_shapes(robot: CheckedModel) -> Iterator[tuple[int, str, ConvexShape]]:
    """(number among the robot's collision shapes, link, shape) of each that is bounded, and stands for no other one."""
    model = getattr(robot, "collision_model", None)
    stand_ins: frozenset[str] = getattr(robot, "collision_stand_ins", frozenset())
    for number, shape in enumerate(() if model is None else model.geometryObjects):
        if shape.name in stand_ins:
            continue
        try:
            found = convex_shape(shape)
        except ModelError:  # a plane or a height field: no points
            continue
        yield number, robot.model.frames[shape.parentFrame].name, found


def _extremes(shape: ConvexShape) -> tuple[Array, Array]:
    """(points or centres, radii) with which a shape touches."""
    points = shape.vertices
    if len(points) > len(_DIRECTIONS):
        points = points[np.unique((points @ _DIRECTIONS.T).argmax(axis=0))]
    balls = [r for r in shape.rounds if r.is_ball]
    ovals = [r.lowest(-d) for r in shape.rounds if r.rim < 0 and not r.is_ball for d in _DIRECTIONS]
    centres = np.array([r.centre for r in balls]).reshape(-1, 3)
    local = np.concatenate([points, np.array(ovals).reshape(-1, 3), centres])
    return local, np.concatenate([np.zeros(len(points) + len(ovals)), [r.reach for r in balls]])
