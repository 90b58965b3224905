"""The plane that a contact stands on, and how far from it a contact is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_float, as_vector3
from rbd.errors import InputError, UnknownName, nearest

TOUCHES = 1e-3
"""A contact whose points are all within this of its plane touches it [m]."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A plane that contacts stand on: a floor, a step, a table, a ramp.

    Attributes:
        point: Any point of it, in W, shape (3,) [m].
        normal: Its normal, out of the ground, a unit vector in W, shape (3,).

    Raises:
        InputError: numbers that are not finite, a normal that is not of unit length.

    >>> rbd.Ground(point=(0, 0, 0.17))            # a step, 17 cm up
    """

    point: Sequence[float] | Array = field(default=(0.0, 0.0, 0.0), kw_only=True)
    normal: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    height: float = field(init=False, repr=False)
    level: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        point, n = as_vector3("point of the ground", self.point), as_vector3("normal of the ground", self.normal)
        length = float(np.linalg.norm(n))
        if abs(length - 1.0) > 1e-6:
            raise InputError(f"normal of the ground has length {length:.6g}; expected a unit vector.")
        put = object.__setattr__
        put(self, "point", point)
        put(self, "normal", n / length)
        put(self, "height", float(self.normal @ point))
        put(self, "level", bool(np.array_equal(self.normal, [0.0, 0.0, 1.0])))

    def distances(self, points: Array) -> Array:
        """How far points are above the plane, negative below, shape (k,) [m].

        Args:
            points: In W, shape (k, 3) [m].
        """
        return np.asarray(points @ np.asarray(self.normal)) - self.height

    def below(self, x: float, y: float) -> float:
        """Height of the plane in W at (x, y) [m]; of one that stands upright, of its `point`."""
        nx, ny, nz = np.asarray(self.normal).tolist()
        return (self.height - nx * x - ny * y) / nz if abs(nz) > 1e-3 else float(self.point[2])

    def same(self, other: Ground) -> bool:
        """Whether both are one plane, to a micrometre at the points given."""
        if np.abs(np.asarray(self.normal) - np.asarray(other.normal)).max() > 1e-9:
            return False
        return bool(abs(self.distances(np.asarray(other.point)[None])[0]) < 1e-6)

    @classmethod
    def of(cls, name: str, given: object) -> Ground | None:
        """What `on=` of a contact says: a plane, the height of a level one, or None where no plane is known.

        Raises:
            InputError: if it is something else.
        """
        if given is None or isinstance(given, Ground):
            return given
        height = as_float(given)
        if not abs(height) < 1e100:
            raise InputError(
                f"on of {name!r:.80} is {given!r:.80}; expected rbd.Ground(point=..., normal=...), the height of a level "
                "ground [m], or None where it is not known."
            )
        return FLOOR if height == 0.0 else cls(point=(0.0, 0.0, height))


FLOOR = Ground()
"""The plane z = 0."""

On = Ground | float | None
"""What a contact stands on: a plane, the height of a level one [m], or None where it is not known."""


def grounds_of(names: Sequence[str], on: On | Mapping[str, On]) -> dict[str, Ground | None]:
    """The plane of each of several feet.

    Args:
        names: Of the feet.
        on: One for all, or {foot: its own}; feet that are not named stand on z = 0.

    Raises:
        UnknownName: a foot that is none, with the nearest names.
        InputError: what is no plane.
    """
    if not isinstance(on, Mapping):
        one = Ground.of("the feet", on)
        return dict.fromkeys(names, one)
    for name in on:
        if name not in names:
            raise UnknownName(f"on names {name!r:.80}, which is no foot; {nearest(name, names)}.")
    return {name: Ground.of(name, on.get(name, FLOOR)) for name in names}
