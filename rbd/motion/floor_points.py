"""`FloorPoints`: the points with which a robot can touch the floor, and where they are in many frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from rbd.arrays import Array
from rbd.constraints.collision import CollisionContacts
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import Contact
from rbd.constraints.convex.rounds import Ball, Oval
from rbd.constraints.convex.solids import ConvexShape, convex_shape
from rbd.errors import InputError, ModelError
from rbd.model.checked_model import CheckedModel
from rbd.robots.robot import Robot

_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""A mesh counts as its vertices farthest along these."""


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
        groups: list[tuple[Constraint, int, Array, Array]] = []
        for foot in feet:
            groups.append((foot, *_corners(robot, foot)))
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
    X = X_JF * foot.placement
    return joint, foot.corners @ X.rotation.T + X.translation, np.zeros(len(foot.corners))


def _bodies(robot: CheckedModel, feet: set[int]) -> Iterator[tuple[Constraint, int, Array, Array]]:
    """Shapes by the link that carries them; those of feet are left out, their soles count."""
    model = getattr(robot, "collision_model", None)
    if model is None:
        return
    stand_ins: frozenset[str] = getattr(robot, "collision_stand_ins", frozenset())
    by_link: dict[str, list[ConvexShape]] = {}
    for shape in model.geometryObjects:
        if shape.parentJoint == 0 or shape.parentJoint in feet or shape.name in stand_ins:
            continue
        try:
            found = convex_shape(shape)
        except ModelError:  # a plane or a height field: no points
            continue
        by_link.setdefault(robot.model.frames[shape.parentFrame].name, []).append(found)
    for link, shapes in by_link.items():
        local, radius = zip(*(_extremes(shape) for shape in shapes), strict=True)
        contact = CollisionContacts(link, robot, ground=[shape.name for shape in shapes])
        yield contact, shapes[0].joint, np.concatenate(local), np.concatenate(radius)


def _extremes(shape: ConvexShape) -> tuple[Array, Array]:
    """(points or centres, radii) with which a shape touches."""
    points = shape.vertices
    if len(points) > len(_DIRECTIONS):
        points = points[np.unique((points @ _DIRECTIONS.T).argmax(axis=0))]
    balls = [r for r in shape.rounds if isinstance(r, Ball)]
    ovals = [r.lowest(-d) for r in shape.rounds if isinstance(r, Oval) for d in _DIRECTIONS]
    centres = np.array([r.centre for r in balls]).reshape(-1, 3)
    local = np.concatenate([points, np.array(ovals).reshape(-1, 3), centres])
    return local, np.concatenate([np.zeros(len(points) + len(ovals)), [r.radius for r in balls]])
