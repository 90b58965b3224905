"""`Footstep`: where and when a foot is put down; footsteps of a gait over level ground, slopes and terrain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_number
from rbd.constraints.contact import Contact
from rbd.constraints.surface import contact_axes
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.walking.gaits import Gait
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.placement import rigid_placement
from rbd.model.state import State
from rbd.problem.ground import Ground

MARGIN = 0.015
"""A sole is put down so far from edges [m] ..."""
ASIDE = 0.2
"""... and for that at most so far before or behind where it was wanted [m]."""
TRIED = 41
"""Number of places that are tried from there to there."""
FLAT = 1e-6
"""Corners on one plane are no farther from it [m] ..."""
BUMPS = 1e-3
"""... and what is around a point foot."""
BESIDE = 0.01
"""Feet pass beside edges at this distance [m]."""
AROUND = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Footstep(Displayed):
    """A foot is put down.

    Attributes:
        foot: Name of the foot.
        pose: Of its contact's centre, z along the ground's normal: pin.SE3 or shape (4, 4).
        start: When it is lifted [s].
        end: When it is to land [s].

    Raises:
        InputError: what is no name, no pose, no times; an end before its start.

    Example:
        >>> pose = np.eye(4)
        >>> pose[:3, 3] = 0.05, 0.085, 0.0
        >>> step = rbd.control.Footstep("left_sole", pose, 1.0, 1.7)
        >>> print(rbd.control.Walk(rbd.load_robot("talos"), [step]))
        talos takes 1 step in 2.60 s, its centre of mass moves by 0.032 m
    """

    foot: str
    pose: pin.SE3
    start: float
    end: float

    def __post_init__(self) -> None:
        check_kind("foot of a Footstep", self.foot, str, "the name of a foot, e.g. 'left_sole'")
        X, said = rigid_placement(f"pose of the step of {self.foot!r:.80}", self.pose), f"of the step of {self.foot!r:.80}"
        start = check_number(f"start {said}", self.start, -1e6, 1e6, expected="a time [s]")
        end = check_number(f"end {said}", self.end, start + 1e-3, 1e6, expected="a time after its start [s]")
        self.__dict__.update(pose=X, start=start, end=end)


def centre_of(state: State, contact: Contact) -> pin.SE3:
    """Pose of the middle of a contact, in its axes."""
    return state.frame(contact.frame).X_WF * contact.placement * pin.SE3(np.eye(3), np.asarray(contact.corners).mean(axis=0))


@dataclass(frozen=True, eq=False)
class Floor:
    """What is walked on, and by which feet.

    Attributes:
        on: A plane, or terrain.
        feet: {foot: contact}.
        rise: How much higher or lower a foot may be put than the others are [m].
    """

    on: Ground | Terrain
    feet: Mapping[str, Any]
    rise: float

    def height(self, x: float, y: float) -> tuple[float, Array]:
        """(z, normal) of what is at (x, y).

        Raises:
            InputError: nothing is there.
        """
        plane = self.on.ground_at(x, y) if isinstance(self.on, Terrain) else self.on
        n, p = np.asarray(plane.normal, float), np.asarray(plane.point, float)
        return float(p[2] - (n[0] * (x - p[0]) + n[1] * (y - p[1])) / n[2]), n

    @property
    def uneven(self) -> bool:
        """Whether it is terrain."""
        return isinstance(self.on, Terrain)

    @property
    def level(self) -> bool:
        """Whether it is a plane along which gravity does nothing; of terrain that is not known."""
        return isinstance(self.on, Ground) and abs(np.asarray(self.on.normal)[2]) > 1.0 - FLAT**2

    def top(self, x: float, y: float) -> float:
        """Height of what is at (x, y); minus infinity over a gap."""
        try:
            return self.height(x, y)[0]
        except InputError:
            return -math.inf

    def tops(self, foot: str, begin: pin.SE3, end: Array) -> Array:
        """How high what lies under a foot is, on its straight way to a place, shape (41,) [m]; not where it begins and ends."""
        a, share = begin.translation, np.linspace(0.0, 1.0, 41)
        corners = np.asarray(self.feet[foot].corners) @ begin.rotation.T
        corners = corners + BESIDE * np.sign(corners) * [1.0, 1.0, 0.0]
        out = np.array([max(self.top(*(a + s * (end - a) + c)[:2]) for c in corners) for s in share])
        out[[0, -1]] = -math.inf
        return out

    def shifted(self, foot: str, X: pin.SE3, d: Array) -> pin.SE3:
        """A foothold shifted along the ground; by less where it would not rest wholly there."""
        for share in (1.0, 0.75, 0.5, 0.25) if d.any() else ():
            x, y = X.translation[:2] + share * d
            try:
                z, n = self.height(x, y)
            except InputError:
                continue
            out = pin.SE3(X.rotation, np.array([x, y, z]))
            if np.abs(n - X.rotation[:, 2]).max() < 1e-6 and self.whole(foot, out):
                return out
        return X

    def pose(self, foot: str, place: Array, yaw: float) -> pin.SE3:
        """Of a foot's contact that is put down at (x, y), whatever the place's z is."""
        x, y = float(place[0]), float(place[1])
        z, n = self.height(x, y)
        along = None if len(self.feet[foot].corners) == 1 else np.array([math.cos(yaw), math.sin(yaw), 0.0])
        return pin.SE3(contact_axes(n, along), np.array([x, y, z]))

    def whole(self, foot: str, X: pin.SE3) -> bool:
        """Whether a foot that is put down so rests on one plane, with a margin around it."""
        if isinstance(self.on, Ground):
            return True
        corners = np.asarray(self.feet[foot].corners)
        point = len(corners) == 1
        corners = corners + MARGIN * (AROUND if point else np.sign(corners) * [1.0, 1.0, 0.0])
        try:
            under = [self.height(*X.act(c)[:2]) for c in corners]
        except InputError:
            return False
        places = np.array([[*X.act(c)[:2], z] for c, (z, _) in zip(corners, under, strict=True)])
        return bool(np.abs((places - X.translation) @ X.rotation[:, 2]).max() < (BUMPS if point else FLAT))

    def nearest(self, foot: str, place: Array, yaw: float, way: Array, level: float) -> pin.SE3:
        """The nearest pose to (x, y), before or behind it along a way, that rests wholly and is not too high or too low.

        Raises:
            InputError: there is none.
        """
        tried = ASIDE * np.linspace(-1.0, 1.0, TRIED)
        for s in sorted(tried.tolist(), key=abs) if self.uneven else [0.0]:
            try:
                X = self.pose(foot, place[:2] + s * way, yaw)
            except InputError:
                continue
            if self.whole(foot, X) and abs(X.translation[2] - level) <= self.rise:
                return X
        x, y = place[:2]
        raise InputError(
            f"{foot!r:.80} finds no place to stand on within {100 * ASIDE:.0f} cm of ({x:.3f}, {y:.3f}) m: a whole foot needs "
            f"one plane, at most {100 * self.rise:.0f} cm higher or lower than the other feet. Give shorter steps, "
            "or `steps` as a list of rbd.control.Footstep."
        )


def moved(x: float, y: float, yaw: float) -> pin.SE3:
    """The plane's motion that advances by x and y while it turns by yaw, at constant rates."""
    return pin.exp6(np.array([x, y, 0.0, 0.0, 0.0, yaw]))


def steps_of(
    floor: Floor,
    poses: Mapping[str, pin.SE3],
    roles: Mapping[str, str],
    gait: Gait,
    n: int,
    advance: Array,
    start: float,
    unit: float,
    yaw: float,
) -> list[Footstep]:
    """Footsteps of a gait.

    Args:
        floor: What is walked on.
        poses: {foot: pose of its contact} at the start.
        roles: {role in the gait: foot}.
        gait: The order of swings.
        n: How many groups of feet swing.
        advance: How far the body moves forwards and aside, and how it turns, in one swing and overlap, shape (3,) [m, rad].
        start: When the first foot is lifted [s].
        unit: sqrt(h / g) [s].
        yaw: The body's heading at the start [rad].
    """
    order, two = list(gait.order), len(roles) == 2
    if two and (advance[1] or advance[2]):  # the foot on the side to which it goes leads
        lead = "left" if (advance[1] or advance[2]) > 0.0 else "right"
        order.sort(key=lambda group: lead not in group)
    middle = np.mean([X.translation for X in poses.values()], axis=0)
    body = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([middle[0], middle[1], 0.0]))
    own = {foot: body.actInv(X) for foot, X in poses.items()}
    turned = {foot: math.atan2(X.rotation[1, 0], X.rotation[0, 0]) - yaw for foot, X in poses.items()}
    now, out, t = {foot: X.translation[2] for foot, X in poses.items()}, list[Footstep](), start
    last = max(n - len(order) + 1, 1)
    for i in range(n):
        k = float(min(i + 1, last))
        aside = 2.0 * math.ceil((i + 1) / 2) if two else k
        B = body * moved(k * advance[0], aside * advance[1], aside * advance[2])
        heading = yaw + aside * advance[2]
        level = dict(now)
        for role in order[i % len(order)]:
            foot = roles[role]
            place = B.act(own[foot].translation)
            others = [z for other, z in level.items() if other != foot]
            turn = turned[foot] if len(floor.feet[foot].corners) > 1 else 0.0
            way = B.rotation[:2, :2] @ (advance[:2] / (np.linalg.norm(advance[:2]) or 1.0))
            X = floor.nearest(foot, place, heading + turn, way, float(np.mean(others)))
            now[foot] = X.translation[2]
            out.append(Footstep(foot, X, t, t + gait.swing * unit))
        t += (gait.swing + gait.overlap) * unit
    return out
