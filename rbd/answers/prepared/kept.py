"""Prepared forms that are stored with a robot, and found by the contacts of a call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from rbd.answers.prepared.sites import Site, covered
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel

Bodies = TypeVar("Bodies")
MOST, MOST_BODIES = 64, 16
"""Sets of contacts, and of bodies in contact, that are kept with a robot."""


def kept_form(
    robot: CheckedModel,
    key: object,
    contacts: tuple[object, ...],
    make: Callable[[CheckedModel, tuple[Contact, ...]], Any],
) -> Any:
    """The form of a robot's contacts under a key; None where they are not covered.

    Args:
        robot: The robot.
        key: Has the contacts in it.
        contacts: The contacts, or what was given for them.
        make: Makes the form, where it is asked for the first time.

    Raises:
        FrameNotFound: with the nearest names.
    """
    try:
        return robot.kept[key]
    except KeyError:
        pass
    except TypeError:  # objects that cannot be keys
        return None
    made = make(robot, contacts) if covered(robot, contacts) else None  # type: ignore[arg-type]
    keep(robot.kept, key, made, MOST)
    return made


def kept_bodies(
    robot: CheckedModel, contacts: tuple[Contact, ...], kind: Callable[[CheckedModel, tuple[Site, ...]], Bodies]
) -> Bodies:
    """The bodies in contact, by the values of their sites: contacts are often made anew, with another friction.

    Args:
        robot: The robot.
        contacts: On these bodies.
        kind: Makes them from the robot and the sites.
    """
    sites = tuple([Site.of(robot, contact) for contact in contacts])
    key = (kind, *[site.key for site in sites])
    found: Bodies | None = robot.kept_bodies.get(key)
    if found is None:
        found = kind(robot, sites)
        keep(robot.kept_bodies, key, found, MOST_BODIES)
    return found


def keep(kept: dict[Any, Any], key: object, value: object, most: int) -> None:
    """Store a value under a key; if there are `most` values already, the oldest is removed."""
    while len(kept) >= most:  # another thread may have removed it
        kept.pop(next(iter(kept)), None)
    kept[key] = value
