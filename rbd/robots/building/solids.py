"""Homogeneous solids, plates, rods and point masses: their masses, centres of mass, inertias and shapes, for the builder.

A solid has its own axes, at `at` and turned by `rpy` in those of its body. Its moments of inertia are those of the textbooks,
about its centre of mass; a body joins those of its solids by the parallel-axis theorem.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.urdf import FARTHEST, LIGHTEST, SMALLEST
from rbd.robots.building.number_checks import (
    Triple,
    checked_color,
    checked_number,
    checked_numbers,
    checked_triple,
    checked_truth,
)

Geometry = Iterable[tuple[str, tuple[tuple[str, tuple[float, ...]], ...]]]
"""(tag of the URDF, its attributes) of some shapes."""


@dataclass(frozen=True)
class MassProperties:
    """Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m2], all in one body's axes."""

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Drawn:
    """A shape of a URDF: its element, its place in the body's axes, its colour, and whether it is drawn and can touch."""

    geometry: str
    size: tuple[tuple[str, tuple[float, ...]], ...]
    at: Triple
    rpy: Triple
    color: str
    draws: bool
    collides: bool


@dataclass(frozen=True, kw_only=True)
class Solid(Displayed):
    """What all solids have in common.

    Attributes:
        mass: [kg]. Without mass and density the solid is a shape only: it is drawn and can touch, and weighs nothing.
        density: In place of the mass [kg/m3].
        at: The middle of the solid in the body's axes, shape (3,) [m].
        rpy: Roll, pitch and yaw of its axes in the body's, R = Rz(yaw) Ry(pitch) Rx(roll) [rad].
        color: "grey", "orange", "blue", "green", "red", "violet", "steel", or three or four numbers from 0 to 1.
        draws: Whether it is drawn.
        collides: Whether it is a collision shape.
    """

    mass: float | None = None
    density: float | None = None
    at: Sequence[float] | Array = (0.0, 0.0, 0.0)
    rpy: Sequence[float] | Array = (0.0, 0.0, 0.0)
    color: str | Sequence[float] = "blue"
    draws: bool = True
    collides: bool = True

    def __post_init__(self) -> None:
        what = type(self).__name__
        for key in ("at", "rpy"):
            object.__setattr__(self, key, checked_triple(f"{key} of the {what}", getattr(self, key)))
        for key in ("mass", "density"):
            if getattr(self, key) is not None:
                number = checked_number(f"{key} of the {what}", getattr(self, key), least=0.0)
                object.__setattr__(self, key, number)
        if self.mass is not None and self.density is not None:
            raise InputError(f"the {what} has mass {self.mass:g} and density {self.density:g}; expected one of them.")
        for key in ("draws", "collides"):
            checked_truth(f"{key} of the {what}", getattr(self, key))
        checked_color(f"color of the {what}", self.color)

    def _size(self, key: str, least: float = SMALLEST) -> None:
        number = checked_number(f"{key} of the {type(self).__name__}", getattr(self, key), least=least, most=FARTHEST)
        object.__setattr__(self, key, number)

    @property
    def volume(self) -> float:
        """[m3]; of a rod its length [m], of a plate its area [m2]: what the density is multiplied by."""
        raise NotImplementedError

    @property
    def kilograms(self) -> float:
        """Its mass, given or from its density [kg]; zero for a shape without mass."""
        return self.mass if self.mass is not None else (self.density or 0.0) * self.volume

    def _inertia(self, mass: float) -> pin.Inertia:
        """Of a mass [kg], in its own axes."""
        raise NotImplementedError

    def _geometry(self) -> Geometry:
        raise NotImplementedError

    @property
    def rotation(self) -> Array:
        """R of its axes in the body's, shape (3, 3)."""
        return pin.rpy.rpyToMatrix(np.array(self.rpy, float))

    @property
    def centre(self) -> Array:
        """Its centre of mass in the body's axes, shape (3,) [m]."""
        return np.array(self.at, float)

    def mass_properties(self) -> MassProperties:
        """Mass, centre of mass and inertia about it, in the body's axes."""
        return _properties(self._in_body())

    def _in_body(self) -> pin.Inertia:
        return pin.SE3(self.rotation, self.centre).act(self._inertia(self.kilograms))

    def shapes(self) -> tuple[Drawn, ...]:
        """What of it is drawn and can touch."""
        if not (self.draws or self.collides):
            return ()
        at, rpy = self._place()
        color = checked_color("color", self.color)
        return tuple(Drawn(tag, size, at, rpy, color, self.draws, self.collides) for tag, size in self._geometry())

    def _place(self) -> tuple[Triple, Triple]:
        return checked_triple("at", self.at), checked_triple("rpy", self.rpy)


@dataclass(frozen=True)
class Box(Solid):
    """A box with sides (x, y, z) [m] about its middle: m/12 (y^2 + z^2) about x, and so on.

    Attributes:
        size: Sides, shape (3,) [m].

    Example:
        >>> print(rbd.robots.Box((1.0, 2.0, 3.0), mass=12.0).mass_properties().inertia.diagonal())
        [13. 10.  5.]
    """

    size: Sequence[float] | Array = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        sides = checked_numbers("size of the Box", self.size, (3,), most=FARTHEST)
        if min(sides) < SMALLEST:
            raise InputError(f"size of the Box is {self.size!r:.80}; expected sides of {SMALLEST:g} m or more.")
        object.__setattr__(self, "size", sides)

    @property
    def volume(self) -> float:
        """[m3]."""
        return float(np.prod(self.size))

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromBox(mass, *self.size)

    def _geometry(self) -> Geometry:
        yield "box", (("size", tuple(self.size)),)


@dataclass(frozen=True)
class Sphere(Solid):
    """A ball: 2/5 m r^2.

    Attributes:
        radius: [m].

    Example:
        >>> print(rbd.robots.Sphere(0.5, mass=10.0).mass_properties().inertia.diagonal())
        [1. 1. 1.]
    """

    radius: float = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._size("radius")

    @property
    def volume(self) -> float:
        """[m3]."""
        return 4.0 / 3.0 * math.pi * self.radius**3

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromSphere(mass, self.radius)

    def _geometry(self) -> Geometry:
        yield "sphere", (("radius", (self.radius,)),)


@dataclass(frozen=True)
class Cylinder(Solid):
    """A cylinder along z of its axes: m r^2 / 2 about z, m/12 (3 r^2 + L^2) across.

    Attributes:
        radius: [m].
        length: Along z [m].

    Example:
        >>> print(rbd.robots.Cylinder(1.0, 3.0, mass=12.0).mass_properties().inertia.diagonal())
        [12. 12.  6.]
    """

    radius: float = field(kw_only=False)
    length: float = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._size("radius")
        self._size("length")

    @property
    def volume(self) -> float:
        """[m3]."""
        return math.pi * self.radius**2 * self.length

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromCylinder(mass, self.radius, self.length)

    def _geometry(self) -> Geometry:
        yield "cylinder", (("radius", (self.radius,)), ("length", (self.length,)))


@dataclass(frozen=True)
class Capsule(Solid):
    """A cylinder along z with half a ball on either end, all of one density.

    With the cylinder's mass m_c = m V_c / V and that of both half balls m_s = m - m_c: m_c r^2 / 2 + 2/5 m_s r^2 about z;
    m_c (3 r^2 + L^2) / 12 + m_s (2/5 r^2 + L^2 / 4 + 3/8 L r) across.

    Attributes:
        radius: [m].
        length: Of the cylinder, without the half balls [m].

    Example:
        >>> round(float(rbd.robots.Capsule(0.1, 0.3, density=1000.0).kilograms), 3)
        13.614
    """

    radius: float = field(kw_only=False)
    length: float = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._size("radius")
        self._size("length")

    @property
    def volume(self) -> float:
        """[m3]."""
        return math.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius)

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromCapsule(mass, self.radius, self.length)

    def _geometry(self) -> Geometry:
        yield "capsule", (("radius", (self.radius,)), ("length", (self.length,)))


def joined(solids: Iterable[Solid]) -> MassProperties:
    """Mass, centre of mass and inertia about it of several solids as one body."""
    return _properties(sum((solid._in_body() for solid in solids), pin.Inertia.Zero()))


def _properties(inertia: pin.Inertia) -> MassProperties:
    return MassProperties(inertia.mass, inertia.lever, inertia.inertia)


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

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromBox(mass, *self.size, 0.0)

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

    def _in_body(self) -> pin.Inertia:
        m, L, r = self.kilograms, self.length, self.thickness
        along = np.subtract(self.end, self.start) / L
        project = np.outer(along, along)
        return pin.Inertia(m, self.centre, m * L**2 / 12.0 * (np.eye(3) - project) + m * r**2 / 2.0 * project)

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

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))

    def _geometry(self) -> Geometry:
        yield "sphere", (("radius", (self.radius,)),)
