"""Points of contacts that move away from what they touch: named, counted, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_LISTED = 6  # points or contacts that are listed one by one


@dataclass(frozen=True)
class Opening:
    """A point that moves away from what it touches: it carries nothing.

    Attributes:
        rows: Name of its rows.
        corner: Number of the point among the points of its rows, from 0.
        of: How many points these rows have.
        speed: Along the normal [m/s]; of a joint's limit, of the joint [rad/s, m/s].
    """

    rows: str
    corner: int
    of: int
    speed: float


def opening_words(openings: Sequence[Opening]) -> str:
    """E.g. "'left_sole' at 0.2 m/s, 'right_sole' (points 1, 2 of 4) at up to 0.3 m/s"; points are counted from 1."""
    names = list(dict.fromkeys(point.rows for point in openings))
    told = [_told([point for point in openings if point.rows == name]) for name in names[:_LISTED]]
    return ", ".join(told) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")


def _told(points: list[Opening]) -> str:
    name, of = points[0].rows, points[0].of
    which = ""
    if len(points) < of:
        numbers = ", ".join(str(point.corner + 1) for point in points[:_LISTED])
        which = f" (point{'s' * (len(points) > 1)} {numbers}{', ...' * (len(points) > _LISTED)} of {of})"
    fastest = max(point.speed for point in points)
    return f"{name!r:.80}{which} at {'up to ' * (len(points) > 1)}{fastest:.3g} m/s"
