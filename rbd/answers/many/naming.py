"""Names, dimensions, labels and units of the quantities of an answer, at one state and at many; the status of a state."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from rbd.answers.many import naming
from rbd.arrays import Array
from rbd.errors import Reason
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import FORCE_OF
from rbd.modules import xarray_or_error
from rbd.problem.answer import Status

if TYPE_CHECKING:
    import xarray


class StateStatus(IntEnum):
    """What became of one of many states; `solutions.reason_codes` says more where it has no answer, `solutions.reasons` all.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> v = np.zeros((2, solo.nv))
        >>> v[1, 2] = -0.1  # the second falls onto its feet
        >>> solutions = rbd.solve_many(solo, solo.standing().q, v, np.zeros(solo.nu), solo.feet())
        >>> [rbd.answers.many.StateStatus(status).words for status in solutions.status]
        ['solved', 'contact moves']
        >>> [str(rbd.errors.Reason.of_code(code)) for code in solutions.reason_codes]
        ['', 'contact_moves: impact']
    """

    SOLVED = 0
    """Every scaled residual is at most 1e-9."""
    INACCURATE = 1
    """Every scaled residual is at most 1e-7."""
    FAILED = 2
    """No answer within 1e-7 was found, though no proof that there is none."""
    INFEASIBLE = 3
    """The constraints contradict each other."""
    CONTACT_MOVES = 4
    """A contact approaches, which is an impact, or moves as the law does not cover: `ContactMoves`."""
    BAD_INPUT = 5
    """Not finite, a quaternion off the unit sphere, or refused by a constraint: `InputError`."""
    UNSUPPORTED = 6
    """The solver cannot take the problem: `Unsupported`."""
    CANNOT_MOVE = 7
    """No torques and forces within their limits move the robot so: `CannotMove`."""

    @property
    def words(self) -> str:
        """In words, e.g. "contact moves"."""
        return self.name.lower().replace("_", " ")

    @property
    def reason(self) -> Reason:
        """The reason that it stands for, without detail; `NONE` where there is an answer."""
        return _REASON[self]

    @classmethod
    def of_answer(cls, status: Status) -> StateStatus:
        """The status of a state whose answer has this status.

        Args:
            status: Of the answer.
        """
        return cls[status.name]

    @classmethod
    def of_reason(cls, reason: Reason) -> StateStatus:
        """The status of a state that has no answer for this reason; `FAILED` for what has no status of its own.

        Args:
            reason: Of the error.
        """
        return _STATUS.get(reason) or _STATUS.get(reason.kind, cls.FAILED)


_REASON: dict[StateStatus, Reason] = {
    StateStatus.SOLVED: Reason.NONE,
    StateStatus.INACCURATE: Reason.NONE,
    StateStatus.FAILED: Reason.NO_SOLUTION,
    StateStatus.INFEASIBLE: Reason.CONTRADICTION,
    StateStatus.CONTACT_MOVES: Reason.CONTACT_MOVES,
    StateStatus.BAD_INPUT: Reason.BAD_INPUT,
    StateStatus.UNSUPPORTED: Reason.UNSUPPORTED,
    StateStatus.CANNOT_MOVE: Reason.CANNOT_MOVE,
}
_STATUS: dict[Reason, StateStatus] = {
    Reason.UNKNOWN_NAME: StateStatus.BAD_INPUT,
    Reason.DUPLICATE_NAME: StateStatus.BAD_INPUT,
    Reason.NOT_AT_REST: StateStatus.CONTACT_MOVES,
    Reason.CANNOT_HOLD: StateStatus.CANNOT_MOVE,
    **{reason: status for status, reason in _REASON.items() if reason is not Reason.NONE},
}


@dataclass(frozen=True, eq=False)
class Variable:
    """A quantity that is kept, of one sample or of n.

    Attributes:
        values: Of one sample an array of the shape of `dims`; of n samples, one more axis in front.
        dims: Names of the dimensions of one sample's value; empty of a number.
        units: Unit, "" where there is none.
        long_name: What it is.
        labels: {dimension: labels of its entries}, text or numbers.
        flags: {code: its meaning}, of codes.
    """

    values: Array
    dims: tuple[str, ...] = ()
    units: str = ""
    long_name: str = ""
    labels: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)

    @property
    def attributes(self) -> dict[str, Any]:
        """Its unit and what it is, as attributes of an xarray variable; of codes their meanings too, as CF has them."""
        found: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.flags:
            found["flag_values"], found["flag_meanings"] = list(self.flags), " ".join(self.flags.values())
        return {name: value for name, value in found.items() if value}


AXES, SPATIAL = ("x", "y", "z"), ("fx", "fy", "fz", "mx", "my", "mz")
RESIDUAL_OF = {
    "stationarity": "equations of motion",
    "feasibility": "accelerations that the law allows",
    "cone": "forces that the law allows",
    "complementarity": "forces and accelerations that go together",
    "centroidal": "momentum about the centre of mass",
}
"""{equation: what its scaled residual is of}."""

Named: TypeAlias = tuple[str, Variable]
_Form: TypeAlias = tuple[tuple[str, ...], str, str, dict[str, tuple[Any, ...]]]
"""Dimensions, unit, meaning and labels."""
_FLAGS = {int(code): code.name.lower() for code in StateStatus}
_coordinates: WeakKeyDictionary[CheckedModel, dict[str, _Form]] = WeakKeyDictionary()


@lru_cache(maxsize=1000)
def key(name: str) -> str:
    """A constraint's name inside the names of variables: letters, digits and _."""
    return re.sub(r"\W", "_", name)


def coordinates(what: str, values: Array, robot: CheckedModel) -> Named:
    """q, v, a, tau or used_torque, labelled by the coordinates of a robot.

    Args:
        what: Which of them.
        values: Shape (..., nq), (..., nv) or (..., nu).
        robot: The robot.
    """
    forms = _coordinates.get(robot)
    if forms is None:
        forms = _coordinates[robot] = _forms_of(robot)
    return what, Variable(values, *forms[what])


def _forms_of(robot: CheckedModel) -> dict[str, _Form]:
    position = {"position": tuple(c.name for c in robot.joints.positions)}
    velocity = {"velocity": tuple(c.name for c in robot.joints.velocities)}
    motor = {"motor": tuple(c.name for c in robot.motor_coordinates)}
    units = list(dict.fromkeys(c.unit for c in robot.joints.velocities))
    forces = list(dict.fromkeys(FORCE_OF[c.unit] for c in robot.motor_coordinates))
    return {
        "q": (("position",), _or([c.unit for c in robot.joints.positions]), "configuration", position),
        "v": (("velocity",), _or([f"{u}/s" for u in units]), "velocity", velocity),
        "a": (("velocity",), _or([f"{u}/s2" for u in units]), "acceleration", velocity),
        "tau": (("motor",), _or(forces), "motor torques", motor),
        "used_torque": (("motor",), "1", "share of each motor's limit that is used", motor),
    }


def _or(units: list[str]) -> str:
    return " or ".join(dict.fromkeys(units))


def force(name: str, values: Array, *, contact: bool) -> Named:
    """The force of a constraint: (3,) or (6,) of a contact, else one entry a row; a constraint without rows has one of zero.

    Args:
        name: The constraint's name.
        values: Shape (..., m).
        contact: Whether it is the force or wrench of a contact, on the robot, in world axes.
    """
    if not values.shape[-1]:  # a limit that is not reached
        values = np.zeros((*values.shape[:-1], 1))
    known, form = _force(name, values.shape[-1], contact)
    return known, Variable(values, *form)


@lru_cache(maxsize=1000)
def _force(name: str, m: int, contact: bool) -> tuple[str, _Form]:
    contact = contact and m in (3, 6)
    rows = SPATIAL[:m] if contact else tuple(str(i) for i in range(m))
    unit = "N, then N m" if contact and m == 6 else "N" if contact else "N or N m"
    return f"force_{key(name)}", ((f"{key(name)}_row",), unit, f"force of {name}", {f"{key(name)}_row": rows})


def corner_forces(name: str, values: Array) -> Named:
    """Forces at the corners of a contact, shape (..., k, 3), world axes."""
    dims, about = (f"{key(name)}_corner", "axis"), f"forces at the corners of {name}"
    return f"corner_forces_{key(name)}", Variable(values, dims, "N", about, {"axis": AXES})


def of_contact(what: str, name: str, value: Any) -> Named:
    """A number of one contact: `friction_used`, `normal_force`, `margin_friction`, `margin_pressure`, or its `friction`.

    Args:
        what: Which of them.
        name: The contact's name.
        value: Shape (...); None where there is none.
    """
    known, unit, about = _of_contact(what, name)
    return known, Variable(np.asarray(np.nan if value is None else value), (), unit, about)


@lru_cache(maxsize=1000)
def _of_contact(what: str, name: str) -> tuple[str, str, str]:
    unit, about = {
        "friction": ("1", f"coefficient of {name}"),
        "friction_used": ("1", f"|f_t| / (mu f_n) of {name}"),
        "normal_force": ("N", f"normal force of {name}"),
        "margin_friction": ("1", f"share of the friction of {name} that is left"),
        "margin_pressure": ("m", f"distance of the centre of pressure of {name} from the edge"),
    }[what]
    return f"{what}_{key(name)}", unit, about


def centre_of_pressure(name: str, values: Array | None) -> Named:
    """Centre of pressure of a contact in W, shape (..., 3); None where it carries nothing."""
    found = np.full(3, np.nan) if values is None else values
    return f"centre_of_pressure_{key(name)}", Variable(found, ("axis",), "m", f"centre of pressure of {name}", {"axis": AXES})


def residual(equation: str, values: Any) -> Named:
    """The scaled residual of an equation of the law, shape (...)."""
    about = f"scaled residual: {RESIDUAL_OF[equation]}"
    return f"residual_{equation}", Variable(np.asarray(values), (), "1", about)


def worst_residual(values: Any) -> Named:
    """The largest scaled residual, shape (...)."""
    return "worst_residual", Variable(np.asarray(values), (), "1", "largest scaled residual of the answer")


def status(codes: Any) -> Named:
    """`StateStatus` codes, shape (...)."""
    return "status", Variable(np.asarray(codes, np.int8), (), "", "solved, inaccurate, failed, ...", {}, _FLAGS)


def com(values: Array) -> Named:
    """The centre of mass in W, shape (..., 3)."""
    return "com", Variable(values, ("axis",), "m", "centre of mass in W", {"axis": AXES})


def dataset_of(found: Any) -> xarray.Dataset:
    """All arrays of a `ManyAnswers` over the dimension `state`; constraints stand in the names of variables: force_left_sole.

    Raises:
        InputError: xarray is not installed; names the extra.
    """
    xr, robot = xarray_or_error(), found.states.robot
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"state": np.arange(len(found)), "axis": list(naming.AXES)}
    for name, variable in _variables(found):
        variables[name] = (["state", *variable.dims], variable.values, variable.attributes)
        coords |= {dim: np.array(labels, None if labels else str) for dim, labels in variable.labels.items()}
    coords["velocity_unit"] = ("velocity", [f"{c.unit}/s" for c in robot.joints.velocities])
    coords["motor_unit"] = ("motor", np.array([FORCE_OF[c.unit] for c in robot.motor_coordinates], str))
    variables["method"] = ("state", found.method)
    about = {"title": f"{len(found)} states of {robot.name}", "frames": "W, z up; forces are those on the robot"}
    return xr.Dataset(variables, coords, about)


def _variables(found: Any) -> Iterator[naming.Named]:
    states = found.states
    for name, values in (("q", states.q), ("v", states.v), ("a", found.a), ("tau", found.tau)):
        yield naming.coordinates(name, values, states.robot)
    yield naming.status(found.status)
    for name, values in found.residuals.items():
        yield naming.residual(name, values)
    for name, values in states.friction.items():
        yield naming.of_contact("friction", name, values)
    for name, values in found.forces.items():
        yield naming.force(name, values, contact=name in found.friction_used)
    for name, values in found.corner_forces.items():
        yield naming.corner_forces(name, values)
    for name, values in found.friction_used.items():
        yield naming.of_contact("friction_used", name, values)
    for name, values in found.centre_of_pressure.items():
        yield naming.centre_of_pressure(name, values)
