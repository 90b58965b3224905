"""Homogeneous solids, plates, rods and point masses: their masses, centres of mass, inertias and shapes, for the builder.

A solid has its own axes, at `at` and turned by `rpy` in those of its body. Its moments of inertia are those of the textbooks,
about its centre of mass; a body joins those of its solids by the parallel-axis theorem.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.urdf import FARTHEST, LIGHTEST, SMALLEST
from rbd.robots.number_checks import Triple, checked_color, checked_number, checked_numbers, checked_triple

THIN = 0.01
"""Thickness of plates and rods as they are drawn, and radius of a rod, over their lengths."""


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

    kind: ClassVar[str] = ""
    """The shape, as Pinocchio and Coal call it; its element in a URDF is that in small letters."""
    sizes: ClassVar[Mapping[str, int]] = {}
    """{a size of it: of how many numbers}; the element has the same."""

    def __post_init__(self) -> None:
        what, put = type(self).__name__, object.__setattr__
        for key in ("at", "rpy"):
            put(self, key, checked_triple(f"{key} of the {what}", getattr(self, key)))
        for key in ("mass", "density"):
            if getattr(self, key) is not None:
                put(self, key, checked_number(f"{key} of the {what}", getattr(self, key), least=0.0))
        if self.mass is not None and self.density is not None:
            raise InputError(f"the {what} has mass {self.mass:g} and density {self.density:g}; expected one of them.")
        for key in ("draws", "collides"):
            check_flag(f"{key} of the {what}", getattr(self, key))
        checked_color(f"color of the {what}", self.color)
        for key, count in self.sizes.items():
            said, value = f"{key} of the {what}", getattr(self, key)
            if count == 1:
                put(self, key, checked_number(said, value, least=SMALLEST, most=FARTHEST))
            else:
                put(self, key, checked_numbers(said, value, (count,), least=SMALLEST, most=FARTHEST))

    @property
    def volume(self) -> float:
        """[m3]; of a rod its length [m], of a plate its area [m2]: what the density is multiplied by."""
        return float(getattr(coal, self.kind)(*self._numbers).computeVolume())

    @property
    def kilograms(self) -> float:
        """Its mass, given or from its density [kg]; zero for a shape without mass."""
        return self.mass if self.mass is not None else (self.density or 0.0) * self.volume

    def _inertia(self, mass: float) -> pin.Inertia:
        """Of a mass [kg], in its own axes."""
        return getattr(pin.Inertia, f"From{self.kind}")(mass, *self._numbers)

    @property
    def _numbers(self) -> list[float]:
        """Its sizes, one after the other."""
        return [float(x) for key in self.sizes for x in np.ravel(getattr(self, key))]

    def mass_properties(self) -> pin.Inertia:
        """Its mass [kg], centre of mass (`lever`, (3,) [m]) and inertia about it (3, 3) [kg m2], in the body's axes."""
        X = pin.SE3(pin.rpy.rpyToMatrix(np.array(self.rpy, float)), np.array(self.at, float))
        return X.act(self._inertia(self.kilograms))

    def place(self) -> tuple[Triple, Triple]:
        """(at, rpy) of its shape."""
        return checked_triple("at", self.at), checked_triple("rpy", self.rpy)

    def drawn_sizes(self) -> dict[str, tuple[float, ...]]:
        """The attributes of its element in a URDF."""
        return {key: tuple(np.ravel(getattr(self, key)).tolist()) for key in self.sizes}


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

    kind = "Box"
    sizes = {"size": 3}


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

    kind = "Sphere"
    sizes = {"radius": 1}


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

    kind = "Cylinder"
    sizes = {"radius": 1, "length": 1}


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

    kind = "Capsule"
    sizes = {"radius": 1, "length": 1}


def joined(solids: Iterable[Solid]) -> pin.Inertia:
    """Mass, centre of mass and inertia about it of several solids as one body."""
    return sum((solid.mass_properties() for solid in solids if solid.kilograms > 0.0), pin.Inertia.Zero())


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

    kind = "Box"
    sizes = {"size": 2}

    @property
    def volume(self) -> float:
        """Its area [m2]."""
        return float(np.prod(self.size))

    def _inertia(self, mass: float) -> pin.Inertia:
        return pin.Inertia.FromBox(mass, *self.size, 0.0)

    def drawn_sizes(self) -> dict[str, tuple[float, ...]]:
        """Those of a box 1 % thick."""
        return {"size": (*self.size, max(THIN * min(self.size), SMALLEST))}


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
        >>> print(bar.lever, bar.inertia.diagonal())
        [0.  0.  0.6] [0.24 0.24 0.  ]
    """

    start: Sequence[float] | Array = field(kw_only=False)
    end: Sequence[float] | Array = field(kw_only=False)
    radius: float | None = field(default=None, kw_only=True)
    kind = "Cylinder"

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
            object.__setattr__(self, "radius", checked_number("radius of the Rod", self.radius, least=0.0, most=FARTHEST))

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

    def mass_properties(self) -> pin.Inertia:
        """As of all solids."""
        m, L, r = self.kilograms, self.length, self.thickness
        along = np.subtract(self.end, self.start) / L
        project = np.outer(along, along)
        return pin.Inertia(m, self.centre, m * L**2 / 12.0 * (np.eye(3) - project) + m * r**2 / 2.0 * project)

    def place(self) -> tuple[Triple, Triple]:
        """(at, rpy) of a cylinder whose z is along it."""
        x, y, z = np.subtract(self.end, self.start) / self.length
        middle = checked_triple("the middle", self.centre)
        return middle, (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x) if math.hypot(x, y) > 0.0 else 0.0)

    def drawn_sizes(self) -> dict[str, tuple[float, ...]]:
        """Those of a cylinder; a line is drawn as thick as by default."""
        return {"radius": (self.thickness or THIN * self.length,), "length": (self.length,)}


@dataclass(frozen=True)
class PointMass(Solid):
    """A mass without extension; drawn as a small ball, which cannot touch.

    A body of one point mass has no inertia about the point, which is right for a pendulum's bob.

    Attributes:
        kilogram: Its mass [kg].
        radius: Of the ball that is drawn [m].

    Example:
        >>> print(rbd.robots.PointMass(3.0, at=(0, 0, -1)).mass_properties().lever)
        [ 0.  0. -1.]
    """

    kilogram: float = field(kw_only=False)
    radius: float = field(default=0.03, kw_only=True)
    collides: bool = field(default=False, kw_only=True)
    kind = "Sphere"
    sizes = {"radius": 1}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None or self.density is not None:
            raise InputError("the PointMass has a mass or density besides its own; expected PointMass(kilogram, at=...).")
        object.__setattr__(self, "kilogram", checked_number("the PointMass", self.kilogram, least=LIGHTEST))

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
