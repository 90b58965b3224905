"""How far the centre of mass can be from contacts that stand, and these from each other, in whatever pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.mechanism.reach import links_between, links_to_com
from rbd.robots.robot import Robot

if TYPE_CHECKING:
    from rbd.planning.stays import PlannedContacts, Stay

ROUNDING = 1e-9
"""Distances may be larger by this share than they are computed."""
OFF = 1e-3
"""Two contacts that are farther from each other than they can be by less count as in reach [m]."""


@dataclass(frozen=True, eq=False)
class Near:
    """The centre of mass is within a distance of a place, because a contact stands.

    Attributes:
        name: Of the contact.
        t: When [s].
        centre: The place, shape (3,) [m].
        radius: The distance [m].
    """

    name: str
    t: float
    centre: Array
    radius: float


@dataclass(frozen=True, eq=False)
class Apart:
    """Two contacts that stand at the same time are farther apart than the links between them are long.

    Attributes:
        names: Of the contacts.
        t: When [s].
        distance: Of the ends of links that may turn [m].
        longest: The largest possible one [m].
    """

    names: tuple[str, str]
    t: float
    distance: float
    longest: float

    def __str__(self) -> str:
        one, other = (f"{name!r:.80}" for name in self.names)
        return (
            f"{one} and {other} stand at {self.t:g} s, {self.distance:.3f} m apart, and the links between have a length of "
            f"{self.longest:.3f} m; move them nearer by {100.0 * (self.distance - self.longest):.1f} cm"
        )


def _site(robot: Robot, contact: Contact) -> tuple[int, pin.SE3, bool]:
    """(joint, centre of a contact in its axes, whether it is a surface, so that its body does not turn)."""
    joint, X = robot.site(contact.frame)
    corners = np.asarray(contact.corners)
    return joint, X * contact.placement * pin.SE3(np.eye(3), corners.mean(axis=0)), len(corners) > 2


def centre_of_mass_near(robot: Robot, contact: Contact, X: pin.SE3) -> tuple[Array, float]:
    """(place, distance): the centre of mass is not farther from it while the centre of a contact is at X, in W [m]."""
    joint, Y, flat = _site(robot, contact)
    w, length = links_to_com(robot, joint, Y.translation)
    turned = X.rotation @ Y.rotation.T @ w if flat else np.zeros(3)
    return X.translation + turned, (1.0 + ROUNDING) * (length + (not flat) * float(np.linalg.norm(w)))


def centre_of_mass_limits(supports: PlannedContacts) -> Iterator[Near]:
    """Where it can be at the ends of stays, but for the first and the last time of all; none where slides have no limits."""
    (first, _), (last, _) = supports.keys[0], supports.keys[-1]
    for contact, own in zip(supports.contacts, supports.stays, strict=True):
        for s in own:
            times = [t for t in (s.start, s.end) if first + 1e-9 < t < last - 1e-9]
            centre, radius = centre_of_mass_near(supports.robot, contact, s.X) if times else (np.zeros(3), np.inf)
            yield from (Near(contact.name, t, centre, radius) for t in times if np.isfinite(radius))


def apart(robot: Robot, one: tuple[Contact, Stay], other: tuple[Contact, Stay]) -> Apart:
    """How far two contacts are from each other, and can be at most: between the ends of bodies that may turn."""
    (a, X, flat), (b, Y, level) = (_site(robot, contact) for contact, _ in (one, other))
    links, longest = links_between(robot, a, X.translation, b, Y.translation)
    (start, R), (end, S) = ((s.X.translation, s.X.rotation) for _, s in (one, other))
    if flat:
        start = start + R @ X.rotation.T @ links.pop(0)
    if level and links:
        end = end - S @ Y.rotation.T @ links.pop()
    longest += sum(float(np.linalg.norm(w)) for w in links)
    t = max(one[1].start, other[1].start)
    return Apart((one[0].name, other[0].name), t, float(np.linalg.norm(end - start)), (1.0 + ROUNDING) * longest)


def too_far_apart(supports: PlannedContacts) -> Apart | None:
    """The worst pair of contacts that stand together; None: all are in reach of each other."""
    stays = [(c, s) for c, own in zip(supports.contacts, supports.stays, strict=True) for s in own]
    pairs = [
        apart(supports.robot, x, y) for i, x in enumerate(stays) for y in stays[i + 1 :]
        if x[0] is not y[0] and max(x[1].start, y[1].start) <= min(x[1].end, y[1].end) + 1e-9
    ]  # fmt: skip
    found = [x for x in pairs if x.distance > x.longest + OFF]
    return max(found, key=lambda x: x.distance - x.longest, default=None)
