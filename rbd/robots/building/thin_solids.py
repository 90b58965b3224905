"""Solids without extension in some direction: thin plates and rods, and point masses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.urdf import FARTHEST, LIGHTEST, SMALLEST
from rbd.robots.building.numbers import Triple, checked_number, checked_numbers, checked_triple
from rbd.robots.building.solids import Geometry, MassProperties, Solid

THIN = 0.01
"""Thickness of plates and rods as they are drawn, and radius of a rod, over their lengths."""


@dataclass(frozen=True)
class Plate(Solid):
    """A thin plate in the x-y plane of its axes: m/12 y^2 about x, m/12 x^2 about y, m/12 (x^2 + y^2) about z.

    It is drawn with a thickness of 1 % of its shorter side, which has no effect on its inertia; a thick plate is a `Box`.

    Attributes:
        size: Sides (x, y) [m]; its density is in kg/m2.

    Example:
        >>> print(rbd.robots.Plate((3.0, 2.0), mass=12.0).mass_properties().inertia.diagonal())
        [ 4.  9. 13.]
    """

    size: Sequence[float] | Array = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        sides = checked_numbers("size of the Plate", self.size, (2,), most=FARTHEST)
        if min(sides) < SMALLEST:
            raise InputError(f"size of the Plate is {self.size!r:.80}; expected two sides of {SMALLEST:g} m or more.")
        object.__setattr__(self, "size", sides)

    @property
    def volume(self) -> float:
        """Its area [m2]."""
        return float(np.prod(self.size))

    def _unit_inertia(self) -> Array:
        x, y = self.size
        return np.diag([y * y, x * x, x * x + y * y]) / 12.0

    def _geometry(self) -> Geometry:
        yield "box", (("size", (*self.size, max(THIN * min(self.size), SMALLEST))),)


@dataclass(frozen=True)
class Rod(Solid):
    """A thin uniform bar from one point of the body to another: m L^2 / 12 across, m r^2 / 2 about its length.

    Its thickness is neglected across. `at` and `rpy` follow from its ends.

    Attributes:
        start: One end in the body's axes, shape (3,) [m].
        end: The other end, shape (3,) [m]; its density is in kg/m.
        radius: [m]; 1 % of its length if it is not given. Zero is a line, drawn as thick as by default.

    Example:
        >>> bar = rbd.robots.Rod((0, 0, 0), (0, 0, 1.2), mass=2.0, radius=0.0).mass_properties()
        >>> print(bar.com, bar.inertia.diagonal())
        [0.  0.  0.6] [0.24 0.24 0.  ]
    """

    start: Sequence[float] | Array = field(kw_only=False)
    end: Sequence[float] | Array = field(kw_only=False)
    radius: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(self.at) or any(self.rpy):
            raise InputError("the Rod has at or rpy besides its ends; expected the ends alone: Rod(start, end, mass=...).")
        for key in ("start", "end"):
            object.__setattr__(self, key, checked_triple(f"{key} of the Rod", getattr(self, key)))
        if self.length < SMALLEST:
            raise InputError(
                f"the Rod from {self.start} to {self.end} is {self.length:g} m long; expected {SMALLEST:g} or more."
            )
        if self.radius is not None:
            self._size("radius", 0.0)

    @property
    def length(self) -> float:
        """[m]."""
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    @property
    def volume(self) -> float:
        """Its length [m]."""
        return self.length

    @property
    def thickness(self) -> float:
        """Its radius, as it enters the inertia [m]."""
        return THIN * self.length if self.radius is None else self.radius

    @property
    def centre(self) -> Array:
        """Its middle in the body's axes, shape (3,) [m]."""
        return (np.array(self.start, float) + np.array(self.end, float)) / 2.0

    def mass_properties(self) -> MassProperties:
        """Mass, centre of mass and inertia about it, in the body's axes."""
        m, L, r = self.kilograms, self.length, self.thickness
        along = np.subtract(self.end, self.start) / L
        project = np.outer(along, along)
        return MassProperties(m, self.centre, m * L**2 / 12.0 * (np.eye(3) - project) + m * r**2 / 2.0 * project)

    def _place(self) -> tuple[Triple, Triple]:
        x, y, z = np.subtract(self.end, self.start) / self.length
        middle = checked_triple("the middle", self.centre)
        return middle, (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x) if math.hypot(x, y) > 0.0 else 0.0)

    def _geometry(self) -> Geometry:
        yield "cylinder", (("radius", (self.thickness or THIN * self.length,)), ("length", (self.length,)))


@dataclass(frozen=True)
class PointMass(Solid):
    """A mass without extension; drawn as a small ball, which cannot touch.

    A body of one point mass has no inertia about the point, which is right for a pendulum's bob.

    Attributes:
        kilogram: Its mass [kg].
        radius: Of the ball that is drawn [m].

    Example:
        >>> print(rbd.robots.PointMass(3.0, at=(0, 0, -1)).mass_properties().com)
        [ 0.  0. -1.]
    """

    kilogram: float = field(kw_only=False)
    radius: float = field(default=0.03, kw_only=True)
    collides: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None or self.density is not None:
            raise InputError("the PointMass has a mass or density besides its own; expected PointMass(kilogram, at=...).")
        object.__setattr__(self, "kilogram", checked_number("the PointMass", self.kilogram, least=LIGHTEST))
        self._size("radius")

    @property
    def volume(self) -> float:
        """Zero [m3]."""
        return 0.0

    @property
    def kilograms(self) -> float:
        """Its mass [kg]."""
        return self.kilogram

    def _unit_inertia(self) -> Array:
        return np.zeros((3, 3))

    def _geometry(self) -> Geometry:
        yield "sphere", (("radius", (self.radius,)),)
