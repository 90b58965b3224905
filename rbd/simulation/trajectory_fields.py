"""Fields of a trajectory: units, meaning, checks, and the printed table."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_number, locked
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, Reason
from rbd.model.checked_model import CheckedModel
from rbd.model.external import is_element
from rbd.problem.ground import Ground
from rbd.records import number
from rbd.simulation.simulated_motion import Event

Fields: TypeAlias = Mapping[str, Any]
"""The fields of a `Trajectory` by name."""


@dataclass(frozen=True)
class FieldColumn:
    """An array of a trajectory with one row a sample: a field, or one entry of a field.

    Attributes:
        name: Name of the field, or of its entry.
        dims: Dimensions of a row: "position" (nq), "velocity" (nv), "motor" (nu), "spatial" (6), "axis" (3), or one of its
            own; none if a row is one number.
        unit: Unit of its entries; empty if each joint has a different one.
        meaning: Description.
        field: The field that it is an entry of; empty for a field.
        key: Its name in names of variables; empty for its own.
        holes: Whether NaN marks what is missing.
        words: Whether it holds words.
        missing: What it is where a file of an earlier version lacks it; None if none does.
    """

    name: str
    dims: tuple[str, ...]
    unit: str
    meaning: str
    field: str = ""
    key: str = ""
    holes: bool = False
    words: bool = False
    missing: float | None = None

    def __str__(self) -> str:
        return f"{self.field} of {self.name!r:.80}" if self.field else self.name

    @property
    def variable(self) -> str:
        """Name in files and datasets."""
        return f"{ENTRIES[self.field]}_{self.key or self.name}" if self.field else self.name

    def size(self, robot: CheckedModel) -> int:
        """Numbers in a row, where they do not depend on a constraint."""
        return math.prod([sizes_of(robot)[dim] for dim in self.dims])

    def of(self, fields: Fields) -> Any:
        """The array among the fields."""
        return fields[self.field][self.name] if self.field else fields[self.name]

    def put(self, fields: dict[str, Any], array: Array) -> None:
        """Set the array among the fields."""
        (fields.setdefault(self.field, {}) if self.field else fields)[self.name] = array


def sizes_of(robot: CheckedModel) -> dict[str, int]:
    """{dimension: its size}, of those that do not depend on constraints."""
    return {"position": robot.nq, "velocity": robot.nv, "motor": robot.nu, "spatial": 6, "axis": 3}


TIME = FieldColumn("t", (), "s", "time")
COLUMNS = (
    FieldColumn("q", ("position",), "", "configuration"),
    FieldColumn("v", ("velocity",), "", "velocity, of a floating base in the base's axes"),
    FieldColumn("a", ("velocity",), "", "acceleration, of a floating base in the base's axes"),
    FieldColumn("tau", ("motor",), "", "motor torques"),
    FieldColumn("kinetic", (), "J", "kinetic energy"),
    FieldColumn("potential", (), "J", "potential energy, zero at the world's origin"),
    FieldColumn("motor_work", (), "J", "work of the motors since the start of the motion"),
    FieldColumn("elastic", (), "J", "energy stored in force elements, e.g. springs", missing=0.0),
    FieldColumn("dissipated", (), "J", "work that force elements, e.g. dampers, have taken out since its start", missing=0.0),
    FieldColumn("momentum", ("spatial",), "N s, then N m s", "linear, then angular momentum about the centre of mass, in W"),
    FieldColumn("com", ("axis",), "m", "centre of mass in W"),
)
"""Fields of the robot at each time."""


def _residual(name: str, unit: str, meaning: str, **more: Any) -> FieldColumn:
    return FieldColumn(name, (), unit, meaning, "residuals", **more)


ENERGY = _residual(
    "energy", "J", "energy that the steps have made since the start of the motion; negative: lost", holes=True, missing=np.nan
)
"""The residual that is NaN where it is not known."""
RESIDUALS = (
    _residual("law", "1", "residual of the contact law, scaled"),
    _residual("drift", "m or rad", "largest position error of the bilateral constraints"),
    _residual("drift_rate", "m/s or rad/s", "largest velocity error of the bilateral constraints"),
    _residual("penetration", "m or rad", "depth of the deepest contact"),
    ENERGY,
)
"""Residuals of each sample."""
WORDS = ("integrator", "law", "stabilisation", "interrupted", "end_reason")
"""The fields that are text."""
ENTRIES = {
    "residuals": "residual", "forces": "force", "modes": "mode", "points": "points", "point_forces": "point_forces",
}  # fmt: skip
"""{field that has an array for each residual or constraint: beginning of their names in files}."""


def keys(names: Sequence[str]) -> dict[str, str]:
    """{constraint: its name in names of variables}: itself, if netCDF accepts it."""
    plain = re.compile(r"(?!constraint_)[A-Za-z]\w*", re.ASCII)
    return {name: name if plain.fullmatch(name) else f"constraint_{i}" for i, name in enumerate(names)}


def columns_of(names: Sequence[str], contacts: Collection[str]) -> Iterator[FieldColumn]:
    """All arrays of a trajectory with one row a sample but its times, in the order of a file.

    Args:
        names: Its constraints.
        contacts: Those that have points.
    """
    yield from COLUMNS
    yield from RESIDUALS
    for name, key in keys(names).items():
        contact, points = name in contacts, (f"{key}_point", "axis")
        unit, axes = ("N", "world axes") if contact else ("N or N m", "by rows")
        yield FieldColumn(name, (f"{key}_row",), unit, f"what {name} does to the robot, {axes}", "forces", key)
        yield FieldColumn(name, (), "", f"mode of {name}", "modes", key, words=True)
        if contact:
            there = f"points of {name} in W; NaN where one is not there"
            yield FieldColumn(name, points, "m", there, "points", key, holes=True)
            yield FieldColumn(name, points, "N", f"force at each point of {name}, world axes", "point_forces", key)


def checked(fields: Fields) -> dict[str, Any]:
    """The fields as stored by a trajectory: read-only arrays of the right sizes, a tuple of events.

    Raises:
        InputError: sizes that do not fit, times that do not increase, numbers that are not finite.
    """
    robot = fields["robot"]
    if not isinstance(robot, CheckedModel):
        raise InputError(f"robot of a trajectory is {robot!r:.80}; expected a robot.")
    n = np.size(fields["t"])
    times = _checked_array(TIME, fields["t"], [n])
    if not n or not (np.diff(times) > 0.0).all():
        raise InputError(f"t of a trajectory is {times[:6]}; expected one or more times, increasing.")
    names, residuals = [c.name for c in RESIDUALS], fields["residuals"]
    if sorted(residuals) != sorted(names):
        raise InputError(f"residuals are {', '.join(map(str, residuals)):.80}; expected {', '.join(names)}.")
    if list(fields["modes"]) != list(fields["forces"]) or list(fields["point_forces"]) != list(fields["points"]):
        raise InputError("forces and modes, points and point_forces must name the same constraints in the same order.")
    if not set(fields["points"]) <= set(fields["forces"]):
        raise InputError("points name contacts that have no forces.")
    out: dict[str, Any] = {**fields, "t": times, **{name: {} for name in ENTRIES}}
    sizes = sizes_of(robot)
    for c in columns_of(list(fields["forces"]), fields["points"]):
        given = c.of(fields)
        value = np.full(n, c.missing) if c.missing is not None and not np.size(given) else given
        array = _checked_array(c, value, [n, *[sizes.get(dim) for dim in c.dims]])
        sizes.update(zip(c.dims, array.shape[1:], strict=True))
        c.put(out, array)
    for name in ("elements", "events", "absent", "terrains"):
        out[name] = tuple(fields[name])
    if not all(is_element(each) for each in out["elements"]):
        raise InputError("elements of a trajectory must be force elements, as of rbd.constraints.forces.")
    if not all(isinstance(each, Terrain) for each in out["terrains"]):
        raise InputError(f"terrains of a trajectory are {fields['terrains']!r:.80}; expected rbd.Terrain.")
    out["driven"] = _driven(robot, fields["driven"], names_of=fields["forces"])
    out["friction"] = _friction(fields["friction"], names_of=fields["forces"])
    out["planes"] = _planes(fields["planes"], names_of=fields["forces"])
    if not all(isinstance(each, Event) for each in out["events"]):
        raise InputError("events of a trajectory must be rbd.simulation Events.")
    if not all(isinstance(each, str) for each in out["absent"]):
        raise InputError(f"absent of a trajectory is {fields['absent']!r:.80}; expected names of events.")
    for word in WORDS:
        if not isinstance(fields[word], str):
            raise InputError(f"{word} of a trajectory is {fields[word]!r:.80}; expected text.")
    try:
        out["end_reason"] = Reason(fields["end_reason"])
    except ValueError:
        raise InputError(f"end_reason of a trajectory is {fields['end_reason']!r:.80}; expected a rbd.errors.Reason.") from None
    if not 0.0 <= as_float(fields["step"]) < np.inf:
        raise InputError(f"step of a trajectory is {fields['step']!r:.80}; expected seconds.")
    return out


def _driven(robot: CheckedModel, given: object, names_of: Mapping[str, Array]) -> Mapping[str, str]:
    """{constraint: joint that it drives}, of constraints with forces and joints of the robot."""
    if not isinstance(given, Mapping) or not set(given) <= set(names_of):
        raise InputError(f"driven of a trajectory is {given!r:.80}; expected {{constraint: joint}} of its constraints.")
    for joint in given.values():
        robot.joints.with_one_freedom(joint, "driven of a trajectory")
    return dict(given)


def _friction(given: object, names_of: Mapping[str, Array]) -> Mapping[str, float]:
    """{contact: coefficient}, of constraints with forces."""
    if not isinstance(given, Mapping) or not set(given) <= set(names_of):
        raise InputError(f"friction of a trajectory is {given!r:.80}; expected {{contact: coefficient}} of its constraints.")
    what = "friction of a trajectory"
    return {name: check_number(what, mu, 0.0, expected="a coefficient of 0 or more") for name, mu in given.items()}


def _planes(given: object, names_of: Mapping[str, Array]) -> Mapping[str, Ground]:
    """{contact: plane that stays}, of constraints with forces."""
    known = isinstance(given, Mapping) and set(given) <= set(names_of)
    if not isinstance(given, Mapping) or not known or not all(isinstance(g, Ground) and g.stays for g in given.values()):
        raise InputError(
            f"planes of a trajectory are {given!r:.80}; expected {{contact: rbd.Ground(point=..., normal=...)}} of its "
            "constraints, that stay where they are."
        )
    return dict(given)


def _checked_array(column: FieldColumn, value: Array, shape: Sequence[int | None]) -> Array:
    """A read-only array of a column, with this shape: itself, if it is one.

    Args:
        column: The column.
        value: The numbers, or words.
        shape: Its sizes; None takes any.

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    if column.words:
        out = np.array(value) if not isinstance(value, np.ndarray) or value.flags.writeable else value
        if out.dtype.kind != "U" or out.shape != tuple(shape):
            raise InputError(f"{column} are {out.dtype} of shape {out.shape}; expected {shape[0]} words.")
        return locked(out)
    out = value
    if type(value) is not np.ndarray or value.dtype != float or value.flags.writeable:
        out = locked(as_array(f"{column} of a trajectory", value))
    if len(out.shape) != len(shape) or any(k is not None and k != m for k, m in zip(shape, out.shape, strict=True)):
        sizes = ", ".join("any" if k is None else str(k) for k in shape)
        raise InputError(f"{column} of a trajectory: shape {out.shape}; expected ({sizes}).")
    bad = np.isinf(out) if column.holes else ~np.isfinite(out)
    if bad.any():
        raise InputError(f"{column} of a trajectory: not finite in sample {int(np.argwhere(bad)[0, 0])}.")
    return out


_EVENTS, _CONSTRAINTS = 8, 16
"""Largest number of entries listed."""


def table(fields: Fields) -> str:
    """The certificate of a motion: duration, steps, method; energy and momentum; worst residuals; constraints; first events."""
    x = {**fields, "energy": fields["kinetic"] + fields["potential"] + fields["elastic"]}
    return "\n".join([_headline(x), *_method(x), *_kept(x), *_residuals(x), *_constraints(x), *_events(x)])


def _headline(x: Fields) -> str:
    steps = f" by steps of {number(1e3 * x['step'])} ms" if x["step"] else ""
    ended = f"; {x['interrupted']}" if x["interrupted"] else ""
    return f"{x['robot'].name}: {x['t'][0]:g} to {x['t'][-1]:g} s{steps}, {len(x['t'])} samples{ended}"


def _method(x: Fields) -> list[str]:
    said = [("integrator", x["integrator"]), ("contact law", x["law"]), ("kept by", x["stabilisation"])]
    return [_line(what, text) for what, text in said if text]


def _kept(x: Fields) -> list[str]:
    change, swing = x["energy"] - x["energy"][0], float(np.ptp(x["energy"]))
    moved = x["com"][-1] - x["com"][0]
    return [
        _line("energy", f"{x['energy'][0]:.6g} J -> {x['energy'][-1]:.6g} J, change {change[-1]:.3g} J, range {swing:.3g} J"),
        _line("", f"kinetic {x['kinetic'][0]:.4g} -> {x['kinetic'][-1]:.4g} J, at most {x['kinetic'].max():.4g} J"),
        *_stored(x),
        *([_line("", _worked(x))] if x["motor_work"].any() or x["dissipated"].any() else []),
        _line("centre of mass", f"moved ({_vector(moved)}) m"),
        _line("momentum", f"({_vector(x['momentum'][-1, :3])}) N s, ({_vector(x['momentum'][-1, 3:])}) N m s at the end"),
    ]


def _stored(x: Fields) -> list[str]:
    elastic = x["elastic"]
    said = f"in springs {elastic[0]:.4g} -> {elastic[-1]:.4g} J, at most {elastic.max():.4g} J"
    return [_line("", said)] if elastic.any() else []


def _worked(x: Fields) -> str:
    done, taken = x["motor_work"] - x["motor_work"][0], x["dissipated"] - x["dissipated"][0]
    rest = x["energy"] - x["energy"][0] - done + taken
    most = float(rest[np.abs(rest).argmax()])
    if not taken.any():
        return f"work of the motors {done[-1]:.4g} J; energy less this work changes by {most:.3g} J"
    motors, rest = (f"work of the motors {done[-1]:.4g} J, ", "out both") if done.any() else ("work ", " this work")
    return f"{motors}taken by dampers {taken[-1]:.4g} J; energy with{rest} changes by {most:.3g} J"


def _residuals(x: Fields) -> list[str]:
    out = []
    for i, residual in enumerate(RESIDUALS):
        values = x["residuals"][residual.name]
        worst = worst_of(values)
        if worst is None:
            out.append(_line("", f"{residual.name} not known"))
            continue
        said = f"{residual.name.replace('_', ' ')} {abs(values[worst]):.1e}"
        said += " (scaled)" if residual.unit == "1" else f" {residual.unit}"
        out.append(_line("" if i else "worst residuals", said + (f" at {x['t'][worst]:.4g} s" if values[worst] else "")))
    return out


def worst_of(residual: Array) -> int | None:
    """The sample at which a residual is largest; None where it is known at none."""
    size = np.abs(residual)
    return None if np.isnan(size).all() else int(np.nanargmax(size))


def _constraints(x: Fields) -> list[str]:
    names = tuple(x["forces"])
    shown, out = names[:_CONSTRAINTS], []
    width = max([0, *(len(name) for name in shown)])
    for i, name in enumerate(shown):
        force, contact = x["forces"][name], name in x["points"]
        size = np.linalg.norm(force[:, :3], axis=1) if contact else np.abs(force).max(axis=1, initial=0.0)
        most = int(np.argmax(size))
        unit = "N" if contact else "N or N m"
        largest = f"at most {size[most]:.4g} {unit} at {x['t'][most]:.4g} s" if size[most] else "no force"
        out.append(_line("" if i else "constraints", f"{name:<{width}}  {x['modes'][name][-1]} at the end, {largest}"))
    return out + [_line("", f"and {len(names) - len(shown)} more")] * (len(names) > len(shown))


def _events(x: Fields) -> list[str]:
    shown = x["events"][:_EVENTS]
    out = [_line("" if i else f"{len(x['events'])} events", str(event)) for i, event in enumerate(shown)]
    out += [_line("", f"and {len(x['events']) - len(shown)} more")] * (len(x["events"]) > len(shown))
    return out + [_line("no event", f"{name} did not happen") for name in x["absent"]]


def _line(what: str, text: str) -> str:
    return f"  {what:<16}{text}"


def _vector(x: Array) -> str:
    return ", ".join(f"{value + 0.0:.4g}" for value in np.where(np.abs(x) < 1e-12, 0.0, x))
