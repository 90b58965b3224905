"""Bodies and joints of a model in the making, each checked by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag
from rbd.errors import InputError
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.urdf import LIGHTEST
from rbd.model.world import PLANES
from rbd.robots.building.solids import Solid, joined
from rbd.robots.number_checks import Check, checked_axis, checked_name, checked_number, checked_numbers, checked_triple

URDF_TYPES = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "ball": "spherical",
    "planar": "planar",
    "fixed": "fixed",
    "free": "floating",
}
"""Kinds of joints, and what a URDF calls them; "spherical" is read by `rbd` and by PyBullet."""
SINGLE = ("revolute", "continuous", "prismatic")
FARTHEST_TURN, FARTHEST_SLIDE = 1e4, 1e3
"""Limits [rad, m] of revolute and prismatic joints without limits, which a URDF must state."""
EQUAL = 1e-9
"""Relative rounding of principal moments."""

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Of an inertia: xx, xy, xz, yy, yz, zz."""


@dataclass(frozen=True)
class BuilderBody:
    """A body: its mass properties and solids in its own axes, which are those of its joint; elements to add as they are."""

    name: str
    inertial: pin.Inertia | None = None
    solids: tuple[Solid, ...] = ()
    elements: str = ""

    @property
    def mass(self) -> float:
        """[kg]."""
        return 0.0 if self.inertial is None else self.inertial.mass

    @property
    def thin(self) -> bool:
        """Whether it has mass, and no inertia about some axis, as a point and a line."""
        return self.inertial is not None and float(np.linalg.eigvalsh(self.inertial.inertia)[0]) <= 0.0


_positive: Check = partial(checked_number, least=0.0, most=1e300)


def _limit(what: str, value: object) -> float:
    """A limit above zero; zero stands for none, as in a URDF."""
    number = 0.0 if value is None else _positive(what, value)
    if value is not None and number == 0.0:
        raise InputError(f"{what} is {value!r:.40}; expected a limit above zero, or None.")
    return number


_OF_JOINTS: dict[str, Check] = {
    **{"parent": checked_name, "child": checked_name, "kind": partial(check_choice, known=URDF_TYPES)},
    **{"at": checked_triple, "rpy": checked_triple, "axis": checked_axis, "effort": _limit, "speed": _limit},
    **{"damping": _positive, "friction": _positive, "armature": _positive},
}


@dataclass(frozen=True)
class BuilderJoint:
    """A joint from a parent to a child, as of `RobotBuilder.joint`; `effort` and `speed` are zero where there is no limit."""

    name: str
    parent: str
    child: str
    kind: str
    at: Sequence[float] | Array
    rpy: Sequence[float] | Array
    axis: Sequence[float] | Array
    limits: Sequence[float] | Array | None
    motor: bool
    effort: float | None
    speed: float | None
    damping: float
    friction: float
    armature: float
    plane: str = "xy"

    def __post_init__(self) -> None:
        what, put = f"joint {checked_name('the name of a joint', self.name)!r:.80}", partial(object.__setattr__, self)
        for key, check in _OF_JOINTS.items():
            put(key, check(f"{key} of {what}", getattr(self, key)))
        check_flag(f"motor of {what}", self.motor)
        if self.parent == self.child:
            raise InputError(f"{what} joins {self.parent!r:.80} with itself; expected two bodies.")
        check_choice(f"plane of {what}", self.plane, PLANES)
        if self.plane != "xy" and self.kind != "planar":
            raise InputError(f"{what} is {self.kind} and has a plane, {self.plane!r}; expected kind='planar'.")
        if self.kind == "planar" and self.axis != (0.0, 0.0, 1.0):
            raise InputError(
                f"{what} is planar, with axis {self.axis}; it moves in x and y of its frame: give plane='xz' or 'yz', or turn "
                "that by rpy."
            )
        if self.motor and self.kind in ("fixed", "free"):
            raise InputError(
                f"{what} is {self.kind} and has a motor; expected a joint that a motor can move: {', '.join(SINGLE)}."
            )
        given = [key for key in ("damping", "friction", "armature", "effort", "speed") if getattr(self, key)]
        if given and self.kind not in SINGLE:
            raise InputError(
                f"{what} is {self.kind} and has {given[0]}; a file has that for one degree of freedom: {', '.join(SINGLE)}."
            )
        if self.limits is not None:
            if self.kind not in ("revolute", "prismatic"):
                raise InputError(f"{what} is {self.kind} and has limits; expected a revolute or prismatic joint.")
            low, high = checked_numbers(f"limits of {what}", self.limits, (2,))
            if low > high:
                raise InputError(f"limits of {what} are {low:g}, {high:g}; expected the lower one first.")
            put("limits", (low, high))


def a_body(
    name: str,
    solids: Sequence[Solid],
    mass: float | None,
    com: Sequence[float] | Array | None,
    inertia: Sequence[float] | Array | None,
    elements: str,
) -> BuilderBody:
    """A body of solids, or of given mass properties.

    Raises:
        InputError: both or half of the mass properties, numbers that are wrong, an inertia that no body can have.
    """
    what = f"body {name!r:.80}"
    _check_elements(what, elements)
    for solid in solids:
        check_kind(f"a part of {what}", solid, Solid, "a solid, e.g. rbd.robots.Box((0.1, 0.1, 0.1), mass=1)")
    own = joined(solids)
    if mass is None:
        if com is not None or inertia is not None:
            raise InputError(f"{what} has com or inertia, and no mass; expected all three: mass=..., com=..., inertia=...")
        return BuilderBody(name, own if own.mass > 0.0 else None, tuple(solids), elements)
    if own.mass > 0.0:
        raise InputError(f"{what} has the mass of its solids, {own.mass:g} kg, and mass={mass!r:.40}; expected one of them.")
    kg = checked_number(f"mass of {what}", mass, least=0.0)
    if inertia is None:
        raise InputError(
            f"{what} has a mass and no inertia; give inertia=(Ixx, Iyy, Izz) about its centre of mass, or a solid, e.g. "
            f"rbd.robots.PointMass({kg:g}, at=...)."
        )
    centre = np.array((0.0, 0.0, 0.0) if com is None else checked_triple(f"com of {what}", com))
    tensor = inertia_matrix(f"inertia of {what}", inertia)
    if 0.0 < kg < LIGHTEST or (kg == 0.0 and tensor.any()):
        raise InputError(
            f"{what} has {f'{kg:g} kg' if kg else 'an inertia and no mass'}; no body can have that. Expected a mass of "
            f"{LIGHTEST:g} kg or more, or nothing."
        )
    check_moments(what, tensor)
    return BuilderBody(name, pin.Inertia(kg, centre, tensor), tuple(solids), elements)


def _check_elements(what: str, elements: object) -> None:
    """Refuse what is no row of <visual> and <collision> elements."""
    try:
        found = None if not isinstance(elements, str) else [e.tag for e in ElementTree.fromstring(f"<link>{elements}</link>")]
    except (ElementTree.ParseError, ValueError):
        found = None
    if found is None or "<!" in str(elements) or any(tag not in ("visual", "collision") for tag in found):
        raise InputError(f"elements of {what} are {elements!r:.80}; expected <visual> and <collision> elements of a URDF.")


def inertia_matrix(what: str, inertia: object) -> Array:
    """Three moments, six entries xx, xy, xz, yy, yz, zz, or the matrix, as the matrix (3, 3)."""
    listed = isinstance(inertia, list | tuple) or (isinstance(inertia, np.ndarray) and inertia.ndim > 0)
    rows = list(inertia) if listed else []  # type: ignore[call-overload]
    if len(rows) == 3 and all(isinstance(row, list | tuple | np.ndarray) for row in rows):
        matrix = np.array([checked_numbers(f"row {i} of the {what}", row, (3,)) for i, row in enumerate(rows)])
        if np.abs(matrix - matrix.T).max() > EQUAL * np.abs(matrix).max():
            raise InputError(f"the {what} is {matrix.tolist()}, which is not symmetric; an inertia is.")
        return (matrix + matrix.T) / 2.0
    values = checked_numbers(f"the {what}", inertia, (3, 6))
    if len(values) == 3:
        return np.diag(values)
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(ENTRIES, values, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def check_moments(what: str, inertia: Array) -> None:
    """Refuse an inertia that no body can have.

    Principal moments are integrals of squared distances: none is negative, and none is more than the sum of the others.

    Raises:
        InputError: naming the moments, and the inequality that they violate.
    """
    small, middle, large = (float(x) for x in np.linalg.eigvalsh(inertia))
    told = (
        f"{what} has an inertia that no body can have: its principal moments are {small:.6g}, {middle:.6g}, {large:.6g} kg m2"
    )
    rounding = EQUAL * max(abs(small), abs(large))
    if small < -rounding:
        raise InputError(f"{told}, and {small:.6g} is negative. Expected moments about the centre of mass, zero or more.")
    if small + middle < large - rounding:
        raise InputError(
            f"{told}, which violate the triangle inequality I3 <= I1 + I2: {large:.6g} > {small:.6g} + {middle:.6g} = "
            f"{small + middle:.6g}. Expected moments about the centre of mass; a flat body has I3 = I1 + I2."
        )
