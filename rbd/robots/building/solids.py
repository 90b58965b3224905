"""Homogeneous solids: their masses, centres of mass, inertias and shapes, for the bodies of `rbd.RobotBuilder`.

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
from rbd.model.urdf import FARTHEST, SMALLEST
from rbd.robots.building.numbers import (
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

    def _unit_inertia(self) -> Array:
        """About the centre of mass in its own axes, per kilogram, shape (3, 3) [m2]."""
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
        R, unit = self.rotation, self._unit_inertia()
        inertia = R @ unit @ R.T if any(self.rpy) else unit
        return MassProperties(self.kilograms, self.centre, self.kilograms * inertia)

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

    def _unit_inertia(self) -> Array:
        x, y, z = self.size
        return np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0

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

    def _unit_inertia(self) -> Array:
        return 0.4 * self.radius**2 * np.eye(3)

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

    def _unit_inertia(self) -> Array:
        r, across = self.radius, (3.0 * self.radius**2 + self.length**2) / 12.0
        return np.diag([across, across, r * r / 2.0])

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

    def _unit_inertia(self) -> Array:
        r, L = self.radius, self.length
        tube = L / (L + 4.0 / 3.0 * r)
        ends = 1.0 - tube
        along = (tube / 2.0 + 0.4 * ends) * r * r
        across = tube * (3.0 * r * r + L * L) / 12.0 + ends * (0.4 * r * r + L * L / 4.0 + 3.0 / 8.0 * L * r)
        return np.diag([across, across, along])

    def _geometry(self) -> Geometry:
        yield "capsule", (("radius", (self.radius,)), ("length", (self.length,)))


def joined(solids: Iterable[Solid]) -> MassProperties:
    """Mass, centre of mass and inertia about it of several solids as one body, by the parallel-axis theorem."""
    each = [solid.mass_properties() for solid in solids]
    heavy = [one for one in each if one.mass > 0.0]
    mass = sum(one.mass for one in heavy)
    if not heavy:
        return MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    com = np.sum([one.mass * one.com for one in heavy], axis=0) / mass
    total = np.zeros((3, 3))
    for one in heavy:
        total += one.inertia
        r = one.com - com
        total += one.mass * (float(r @ r) * np.eye(3) - np.outer(r, r))
    return MassProperties(mass, com, total)
