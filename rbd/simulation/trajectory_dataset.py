"""A trajectory as a header and named arrays, for files, and as an xarray.Dataset with names and units."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.installation import VERSION
from rbd.model.checked_model import CheckedModel
from rbd.model.joint_names import FORCE_OF, motors, positions, velocities
from rbd.simulation.events import Event
from rbd.simulation.robot_recipe import recipe, robot_numbers, robot_of
from rbd.simulation.trajectory_fields import COLUMNS, RESIDUALS, WORDS, Column, Fields
from rbd.simulation.trajectory_file import xarray_or_error

if TYPE_CHECKING:
    import xarray

AXES = ["x", "y", "z"]
SPATIAL = [*AXES, "about_x", "about_y", "about_z"]
NUMBERS = "robot_numbers"

_TOLD = {c.name: c for c in COLUMNS} | {f"residual_{c.name}": c for c in RESIDUALS}
_TOLD["energy"] = Column("energy", "", "J", "kinetic and potential energy")


def keys(names: tuple[str, ...]) -> dict[str, str]:
    """{constraint: the word that stands for it in names of variables}: itself, where netCDF takes it."""
    plain = re.compile(r"(?!constraint_)[A-Za-z]\w*", re.ASCII)
    return {name: name if plain.fullmatch(name) else f"constraint_{i}" for i, name in enumerate(names)}


def header_of(fields: Fields) -> dict[str, Any]:
    """All that is not arrays."""
    return {
        "rbd": VERSION,
        "robot": recipe(fields["robot"]),
        "constraints": list(fields["forces"]),
        "contacts": list(fields["points"]),
        "step": float(fields["step"]),
        **{word: fields[word] for word in WORDS},
        "events": [[float(e.t), e.name, e.kind, int(e.point), float(e.speed), float(e.impulse)] for e in fields["events"]],
    }


def arrays_of(fields: Fields) -> dict[str, Array]:
    """{variable: array}, one row a sample, and the robot's numbers."""
    out = {"times": fields["times"], **{c.name: fields[c.name] for c in COLUMNS}}
    out |= {f"residual_{name}": x for name, x in fields["residuals"].items()}
    for name, key in keys(tuple(fields["forces"])).items():
        out[f"force_{key}"], out[f"mode_{key}"] = fields["forces"][name], fields["modes"][name]
        if name in fields["points"]:
            out[f"points_{key}"], out[f"point_forces_{key}"] = fields["points"][name], fields["point_forces"][name]
    return out | {NUMBERS: robot_numbers(fields["robot"])}


def fields_of(
    header: Mapping[str, Any], arrays: Mapping[str, Array], folder: Path, robot: CheckedModel | None
) -> dict[str, Any]:
    """Fields of a `Trajectory` from a header and arrays that a file holds; sizes are checked where it is made.

    Raises:
        InputError: something is missing, or not what it should be.
        ModelError: the robot's file is gone, or has changed.
    """
    names, contacts = _words(header, "constraints"), _words(header, "contacts")
    key = keys(names)
    if not set(contacts) <= set(names) or not isinstance(header.get("robot"), dict):
        raise InputError("its header names contacts that are no constraints, or no robot")

    def found(name: str, kind: str = "f") -> Array:
        if name not in arrays:
            raise InputError(f"it holds no {name!r:.80}")
        if arrays[name].dtype.kind != kind:
            raise InputError(f"{name!r:.80} is of type {arrays[name].dtype}; expected {'numbers' if kind == 'f' else 'words'}")
        return arrays[name].astype(float) if kind == "f" else arrays[name]

    return {
        "robot": robot_of(header["robot"], found(NUMBERS), folder, robot),
        "times": found("times"),
        **{c.name: found(c.name) for c in COLUMNS},
        "residuals": {c.name: found(f"residual_{c.name}") for c in RESIDUALS},
        "forces": {name: found(f"force_{key[name]}") for name in names},
        "modes": {name: found(f"mode_{key[name]}", "U") for name in names},
        "points": {name: found(f"points_{key[name]}") for name in contacts},
        "point_forces": {name: found(f"point_forces_{key[name]}") for name in contacts},
        "events": tuple(_event(given) for given in _list(header, "events")),
        "step": as_float(header.get("step")),
        **{word: header.get(word) for word in WORDS},
    }


def dataset_of(fields: Fields) -> xarray.Dataset:
    """The trajectory with named dimensions, labels and units; see `Trajectory.to_xarray`."""
    xr, arrays = xarray_or_error(), arrays_of(fields)
    del arrays[NUMBERS]
    arrays["energy"] = arrays["kinetic"] + arrays["potential"]
    coords: dict[str, Any] = {"time": ("time", arrays.pop("times"), {"units": "s"}), **_labels(fields["robot"])}
    dims = {c.name: [c.axis] for c in COLUMNS if c.axis}
    units = {name: c.unit for name, c in _TOLD.items() if c.unit}
    told = {name: c.meaning for name, c in _TOLD.items()}
    for name, word in keys(tuple(fields["forces"])).items():
        contact, m = name in fields["points"], fields["forces"][name].shape[1]
        dims[f"force_{word}"] = [f"{word}_row"]
        coords[f"{word}_row"] = SPATIAL[:m] if contact and m in (3, 6) else np.arange(m).astype(str)
        units[f"force_{word}"] = "N, then N m" if m == 6 else "N" if contact else "N or N m"
        told[f"force_{word}"] = f"what {name} does to the robot" + (", world axes" if contact else ", by rows")
        told[f"mode_{word}"] = f"mode of {name}"
        if contact:
            dims[f"points_{word}"] = dims[f"point_forces_{word}"] = [f"{word}_point", "axis"]
            units[f"points_{word}"], units[f"point_forces_{word}"] = "m", "N"
            told[f"points_{word}"] = f"points of {name} in W; NaN where one is not there"
            told[f"point_forces_{word}"] = f"force at each point of {name}, world axes"
    variables: dict[str, Any] = {}
    for name, x in arrays.items():
        attrs = {"long_name": told[name]} | ({"units": units[name]} if name in units else {})
        variables[name] = (["time", *dims.get(name, [])], x, attrs)
    about: dict[str, Any] = {"title": f"motion of {fields['robot'].name}", "step": float(fields["step"]), "rbd": VERSION}
    about |= {word: fields[word] for word in WORDS}
    about["frames"] = "W, z up; forces are those on the robot; quaternions x, y, z, w"
    return xr.Dataset(variables | _event_variables(fields["events"]), coords, about)


def _labels(robot: CheckedModel) -> dict[str, Any]:
    """Names along the dimensions, with a unit each where units differ."""
    q, v, tau = positions(robot), velocities(robot), motors(robot)
    return {
        "position": [c.name for c in q],
        "velocity": [c.name for c in v],
        "motor": np.array([c.name for c in tau], str),
        "axis": AXES,
        "spatial": SPATIAL,
        "position_unit": ("position", [c.unit for c in q]),
        "velocity_unit": ("velocity", [f"{c.unit}/s" for c in v]),
        "motor_unit": ("motor", np.array([FORCE_OF[c.unit] for c in tau], str)),
    }


def _event_variables(events: tuple[Event, ...]) -> dict[str, Any]:
    return {
        "event_time": ("event", np.array([e.t for e in events], float), {"units": "s"}),
        "event_constraint": ("event", np.array([e.name for e in events], str)),
        "event_kind": ("event", np.array([e.kind for e in events], str)),
        "event_point": ("event", np.array([e.point for e in events], int)),
        "event_speed": ("event", np.array([e.speed for e in events], float), {"units": "m/s or rad/s"}),
        "event_impulse": ("event", np.array([e.impulse for e in events], float), {"units": "N s or N m s"}),
    }


def for_netcdf(fields: Fields) -> tuple[dict[str, Any], xarray.Dataset]:
    """Header and dataset that netCDF 3 can hold: no arrays without entries, and modes as numbers with a key (CF's flags)."""
    header, dataset = header_of(fields), dataset_of(fields)
    dataset[NUMBERS] = (("joint", "number"), robot_numbers(fields["robot"]))
    words = sorted({str(word) for modes in fields["modes"].values() for word in np.unique(modes)})
    for name in [name for name in dataset.data_vars if str(name).startswith("mode_")]:
        codes = np.searchsorted(words, dataset[name].values).astype(np.int8)
        meanings = " ".join(w.replace(" ", "_") for w in words)
        attrs = {"flag_values": np.arange(len(words), dtype=np.int8), "flag_meanings": meanings}
        dataset[name] = ("time", codes, {**dataset[name].attrs, **attrs})
    empty = [name for name, x in dataset.variables.items() if not x.size]
    arrays = arrays_of(fields)
    header |= {"arrays": sorted(arrays), "modes": words, "empty": {str(x): list(dataset[x].shape) for x in empty}}
    dataset = dataset.drop_vars(empty)
    for variable in dataset.variables.values():
        variable.encoding["_FillValue"] = None
    return header | {"sha256": _checksum(header, arrays)}, dataset


def arrays_of_netcdf(header: Mapping[str, Any], dataset: xarray.Dataset) -> dict[str, Array]:
    """What `arrays_of` gave, from what `for_netcdf` made of it.

    Raises:
        InputError: numbers of modes that have no word, shapes that are none, or a checksum that differs.
    """
    words, empty, wanted = _words(header, "modes"), header.get("empty"), _words(header, "arrays")
    found = {"times" if name == "time" else str(name): variable.values for name, variable in dataset.variables.items()}
    out = {name: found[name] for name in wanted if name in found and found[name].dtype.kind in "fi"}
    for name in [name for name in out if name.startswith("mode_")]:
        codes = out[name]
        if codes.dtype.kind != "i" or codes.ndim != 1 or codes.size and not 0 <= codes.min() <= codes.max() < len(words):
            raise InputError(f"{name!r:.80} holds numbers for which it gives no mode")
        out[name] = np.array([words[code] for code in codes])
    for name, shape in empty.items() if isinstance(empty, dict) else ():
        if not isinstance(shape, list) or not all(type(k) is int and 0 <= k < 2**31 for k in shape) or 0 not in shape:
            raise InputError(f"its header gives {name!r:.80} the shape {shape!r:.80}")
        if name in wanted:
            try:
                out[name] = np.zeros(shape)
            except ValueError:  # too many dimensions, or lengths whose product no computer can count
                raise InputError(f"its header gives {name!r:.80} the shape {shape!r:.80}") from None
    rest = {key: value for key, value in header.items() if key not in ("sha256", "format", "version")}
    if _checksum(rest, out) != header.get("sha256"):
        raise InputError("its numbers are not those that were written (their checksum differs)")
    return out


def _checksum(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> str:
    """Of the header and of all that a trajectory is made of: netCDF has none of its own."""
    found = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name, x in sorted(arrays.items()):
        text = "\0".join(x.tolist()).encode(errors="surrogatepass") if x.dtype.kind == "U" else x.astype("<f8").tobytes()
        found.update(name.encode(errors="surrogatepass") + text)
    return found.hexdigest()


def _list(header: Mapping[str, Any], what: str) -> list[Any]:
    value = header.get(what)
    if not isinstance(value, list):
        raise InputError(f"{what} in its header is {value!r:.80}; expected a list")
    return value


def _words(header: Mapping[str, Any], what: str) -> tuple[str, ...]:
    value = _list(header, what)
    if not all(isinstance(word, str) and word for word in value) or len(set(value)) != len(value):
        raise InputError(f"{what} in its header are {value!r:.80}; expected different words")
    return tuple(value)


def _event(given: object) -> Event:
    kinds = (float, str, str, int, float, float)
    if not isinstance(given, list) or [type(x) for x in given] != list(kinds):
        raise InputError(f"an event in its header is {given!r:.80}; expected time, name, kind, point, speed, impulse")
    return Event(*given)
