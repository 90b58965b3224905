"""Contents of a trajectory file: a header with the robot's source and numbers, and named arrays.

A robot is stored as its source with its inertias and placements, so that a changed robot is noticed.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.constraints.forces.element_numbers import data_of, element_of
from rbd.constraints.terrain.plain import plain_of, terrain_of
from rbd.errors import InputError, ModelError, ModelWarning, RbdError
from rbd.errors.warned import ForceElementWarning, stacklevel_of_user
from rbd.installation import VERSION
from rbd.model.array_file import checksum, listed_in, words_in
from rbd.model.checked_model import CheckedModel, with_plain_motors
from rbd.model.external import ForceElement
from rbd.model.input_files import FileLimits
from rbd.model.motors import plain_motors
from rbd.modules import xarray_or_error
from rbd.problem.ground import Ground
from rbd.robots import catalogue
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import beside
from rbd.robots.robot import Robot, with_plain_things
from rbd.robots.travelling import given_texts, texts_of
from rbd.simulation.simulated_motion import Event
from rbd.simulation.trajectory_fields import ENTRIES, WORDS, FieldColumn, Fields, columns_of, keys

if TYPE_CHECKING:
    import xarray

SPATIAL = ["x", "y", "z", "about_x", "about_y", "about_z"]
NUMBERS = "robot_numbers"
EVENT = (
    ("time", "t", float, "s"),
    ("constraint", "name", str, ""),
    ("kind", "kind", str, ""),
    ("point", "point", int, ""),
    ("speed", "speed", float, "m/s or rad/s"),
    ("impulse", "impulse", float, "N s or N m s"),
    ("piece", "piece", str, ""),
)
"""Of an event: name in a dataset, field, type, unit."""


def header_of(fields: Fields) -> dict[str, Any]:
    """The header: all data that are not arrays."""
    return {
        "rbd": VERSION,
        "robot": recipe(fields["robot"]),
        "constraints": list(fields["forces"]),
        "contacts": list(fields["points"]),
        "step": float(fields["step"]),
        **{word: str(fields[word]) for word in WORDS},
        "events": [[kind(getattr(e, field)) for _, field, kind, _ in EVENT] for e in fields["events"]],
        "absent": list(fields["absent"]),
        "pushed": bool(fields["pushed"]),
        "terrains": [plain_of(terrain, fields["t"]) for terrain in fields["terrains"]],
        "driven": dict(fields["driven"]),
        "friction": dict(fields["friction"]),
        "planes": {name: _plane_data(plane) for name, plane in fields["planes"].items()},
        **header_of_elements(fields["elements"]),
    }


def arrays_of(fields: Fields) -> dict[str, Array]:
    """{variable: array}, one row a sample, and the robot's numbers."""
    columns = columns_of(list(fields["forces"]), fields["points"])
    return {"t": fields["t"]} | {c.variable: c.of(fields) for c in columns} | {NUMBERS: robot_numbers(fields["robot"])}


def fields_of(
    header: Mapping[str, Any], arrays: Mapping[str, Array], folder: Path, robot: CheckedModel | None
) -> dict[str, Any]:
    """Fields of a `Trajectory` from a file's header and arrays; sizes are checked by the trajectory.

    Raises:
        InputError: an entry is missing, or of the wrong type.
        ModelError: the robot's file is gone, or has changed.
    """
    names, contacts = words_in(header, "constraints"), words_in(header, "contacts")
    if not set(contacts) <= set(names) or not isinstance(header.get("robot"), dict):
        raise InputError("its header names contacts that are no constraints, or no robot")

    def found(name: str, *, words: bool = False) -> Array:
        if name not in arrays:
            raise InputError(f"it holds no {name!r:.80}")
        if arrays[name].dtype.kind != ("U" if words else "f"):
            raise InputError(f"{name!r:.80} is of type {arrays[name].dtype}; expected {'words' if words else 'numbers'}")
        return arrays[name] if words else arrays[name].astype(float)

    made = robot_of(header["robot"], found(NUMBERS), folder, robot)
    t = found("t")
    out: dict[str, Any] = {
        "robot": made,
        "elements": elements_in(header, made),
        "pushed": bool(header.get("pushed", False)),
        "terrains": tuple(terrain_of(given) for given in listed_in(header, "terrains")) if "terrains" in header else (),
        "driven": header.get("driven", {}),
        "friction": header.get("friction", {}),
        "planes": _planes_in(header.get("planes", {})),
        "t": t,
        "events": tuple(_event(given) for given in listed_in(header, "events")),
        "absent": words_in(header, "absent") if "absent" in header else (),
        "step": as_float(header.get("step")),
        **{word: header.get(word) for word in WORDS},
        **{name: {} for name in ENTRIES},
    }
    for c in columns_of(names, contacts):
        lacks = c.missing is not None and c.variable not in arrays
        c.put(out, np.full(len(t), c.missing) if lacks else found(c.variable, words=c.words))
    return out


_PLANE = ("normal", "point", "velocity", "about")
"""What a header tells of a plane, of `rbd.Ground`."""


def _plane_data(plane: Ground) -> dict[str, list[float]]:
    return {name: np.asarray(x).tolist() for name in _PLANE if (x := getattr(plane, name)) is not None}


def _planes_in(given: object) -> dict[str, Ground]:
    """The planes of a header; none of files of earlier versions."""
    try:
        known: Any = given
        return {str(name): Ground(**{key: data.get(key) for key in _PLANE}) for name, data in known.items()}
    except (TypeError, AttributeError, ValueError, InputError) as error:
        raise InputError(f"planes in its header are {given!r:.80}; expected {{contact: normal, point}}") from error


def dataset_of(fields: Fields) -> xarray.Dataset:
    """The trajectory with named dimensions, labels and units; see `Trajectory.to_xarray`."""
    xr = xarray_or_error()
    robot: CheckedModel = fields["robot"]
    coords: dict[str, Any] = {dim: np.array(axis.labels, str) for dim, axis in robot.coordinate_axes.items()}
    coords |= {"time": ("time", fields["t"], {"units": "s"}), "spatial": SPATIAL, **robot.unit_coordinates}
    for name, key in keys(tuple(fields["forces"])).items():
        m = fields["forces"][name].shape[1]
        coords[f"{key}_row"] = SPATIAL[:m] if name in fields["points"] and m in (3, 6) else np.arange(m).astype(str)
    variables: dict[str, Any] = {}
    whole = FieldColumn("energy", (), "J", "whole energy")
    values = {**fields, "energy": fields["kinetic"] + fields["potential"] + fields["elastic"]}
    for c in [*columns_of(list(fields["forces"]), fields["points"]), whole]:
        array = c.of(values)
        unit = "N, then N m" if c.field == "forces" and array.shape[1] == 6 else c.unit
        variables[c.variable] = (["time", *c.dims], array, {"long_name": c.meaning} | ({"units": unit} if unit else {}))
    about: dict[str, Any] = {"title": f"motion of {robot.name}", "step": float(fields["step"]), "rbd": VERSION}
    about |= {word: str(fields[word]) for word in WORDS}
    about["frames"] = "W, z up; forces are those on the robot; quaternions x, y, z, w"
    for name, field, kind, unit in EVENT:
        column = np.array([getattr(event, field) for event in fields["events"]], kind)
        variables[f"event_{name}"] = ("event", column, {"units": unit} if unit else {})
    return xr.Dataset(variables, coords, about)


def for_netcdf(fields: Fields) -> tuple[dict[str, Any], xarray.Dataset]:
    """Header and dataset for netCDF 3: no arrays without entries, and modes as numbers with a key (CF's flags)."""
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
    return header | {"sha256": checksum(header, arrays)}, dataset


def arrays_of_netcdf(header: Mapping[str, Any], dataset: xarray.Dataset) -> dict[str, Array]:
    """The arrays of `arrays_of`, from the dataset of `for_netcdf`.

    Raises:
        InputError: mode numbers without a name, invalid shapes, or a different checksum.
    """
    words, empty, wanted = words_in(header, "modes"), header.get("empty"), words_in(header, "arrays")
    found = {"t" if name == "time" else str(name): variable.values for name, variable in dataset.variables.items()}
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
    if checksum(rest, out) != header.get("sha256"):
        raise InputError("its numbers are not those that were written (their checksum differs)")
    return out


def _event(given: object) -> Event:
    kinds = [kind for _, _, kind, _ in EVENT]
    if not isinstance(given, list) or [type(x) for x in given] not in (kinds, kinds[:-1]):  # older files name no piece
        raise InputError(f"an event in its header is {given!r:.80}; expected time, name, kind, point, speed, impulse, piece")
    return Event(*given)


_COLUMNS = {"placement": 12, "mass": 1, "centre of mass": 3, "inertia": 6, "axis": 6, "rotor inertia": 1}
"""Columns of `robot_numbers` for each joint and its body."""
_RELATIVE, _ABSOLUTE = 1e-9, 1e-12
"""Largest difference between two readings of one file, on two machines."""


def recipe(robot: CheckedModel) -> dict[str, Any]:
    """A robot's source, as plain data; "file" is empty for a robot built by hand, and for one in memory, which has a "text"."""
    out: dict[str, Any] = {
        "name": robot.name,
        "file": "",
        "joints": list(robot.joints),
        "kinds": [f"JointModel{joint.kind}" for joint in robot.joints.values()],
        "sizes": [robot.nq, robot.nv, robot.nu],
        "motors": list(robot.actuated_names),
    }
    if not isinstance(robot, Robot) or not (robot.source.in_memory or os.path.isfile(robot.urdf)):
        return out
    texts = texts_of(robot.text, robot.mechanism) if robot.source.in_memory else {}
    loops = texts.get("loops") if texts else _loops(robot)
    if loops is None:
        return out
    name = robot.source.name
    by_name = robot.source.known and _found(name) == robot.urdf
    return out | {
        "file": "" if texts else name if by_name else str(robot.urdf.resolve()),
        **texts,
        "root": None if robot.urdf.suffix == ".xml" else robot.root,  # an MJCF says itself
        "plane": robot.plane,
        "passive": sorted(robot.passive),
        "loops": loops,
        "package_dirs": [] if robot.source.known else [str(folder) for folder in robot.source.package_dirs],
        "limits": asdict(robot.limits),
        "leave_out": sorted(robot.leave_out),
        "gravity": None if np.array_equal(robot.gravity, robot._as_made.gravity.linear) else robot.gravity.tolist(),
        "motor_data": plain_motors(robot.motor_data),
        "carried": [each.plain for each in robot.carried],
    }


def robot_numbers(robot: CheckedModel) -> Array:
    """Placement, inertia, axis and rotor inertia of every joint, shape (joints + 1, 29); gravity in the last row."""
    model = robot.model
    rows = np.zeros((model.njoints, sum(_COLUMNS.values())))
    q = pin.neutral(model)
    for i in range(1, model.njoints):
        joint, inertia, axis = model.joints[i], model.inertias[i], np.zeros(6)
        if joint.nv == 1:  # others use the axes of their frame
            data = joint.createData()
            joint.calc(data, q)
            axis = np.asarray(data.S, float).reshape(-1)
        rows[i - 1] = np.concatenate(
            [
                model.jointPlacements[i].homogeneous[:3].reshape(-1),
                [inertia.mass],
                inertia.lever,
                inertia.inertia[np.triu_indices(3)],
                axis,
                [model.armature[joint.idx_v]],
            ]
        )
    rows[-1, :3] = robot.gravity
    return rows


def robot_of(given: Mapping[str, Any], numbers: Array, folder: Path, robot: CheckedModel | None) -> CheckedModel:
    """The robot of a recipe, compared with the numbers that were written with it.

    Args:
        given: A `recipe`, from a file: all of it is checked.
        numbers: Its `robot_numbers`.
        folder: Folder of the file; a model file that has moved is searched here by name.
        robot: The robot, if given by the user.

    Raises:
        InputError: no robot where one must be given, a robot other than that of the recipe, an invalid recipe.
        ModelError: its file is gone, or has changed since.
    """
    if robot is not None:
        if not isinstance(robot, CheckedModel):
            raise InputError(f"robot is {robot!r:.80}; expected a robot: rbd.load_robot(name).")
        _check_same(given, robot, InputError, "robot")
        if change := next(_changes(robot, numbers), ""):
            warnings.warn(
                f"{robot.name} is not as it was when this motion was computed: {change}. States are those of the robot given.",
                ModelWarning,
                stacklevel=4,
            )
        return robot
    loaded = _loaded(given, folder)
    remedy = "Give the robot as it was: Trajectory.load(path, robot=...)."
    _check_same(given, loaded, ModelError, remedy)
    if change := next(_changes(loaded, numbers), ""):
        raise ModelError(f"the file of {loaded.name} has changed since this motion was computed: {change}. {remedy}")
    return loaded


def _loaded(given: Mapping[str, Any], folder: Path) -> Robot:
    file = given.get("file")
    text = given_texts(given)
    if text is None and (not isinstance(file, str) or not file):
        raise InputError(
            f"{given.get('name')!r:.80} was built by hand, so no file of it can be read again. "
            "Build it once more and give it: Trajectory.load(path, robot=...)."
        )
    path = Path(file if isinstance(file, str) else "")
    loops = given.get("loops", True)
    if path.is_absolute() and not os.path.isfile(path) and os.path.isfile(folder / path.name):
        file = str(folder / path.name)
        if isinstance(loops, str):
            loops = str(folder / Path(loops).name)
    try:
        with warnings.catch_warnings(action="ignore", category=ModelWarning):  # they were given when the robot was first loaded
            more: dict[str, Any] = {key: given.get(key) for key in ("root", "gravity", "plane")} | (text or {"loops": loops})
            more |= {key: given.get(key, ()) for key in ("passive", "package_dirs", "leave_out")}
            loaded = load_robot(file or None, limits=FileLimits(**given.get("limits", {})), **more)
            return with_plain_things(with_plain_motors(loaded, given.get("motor_data")), given.get("carried"))
    except (RbdError, TypeError) as error:
        raise ModelError(
            f"the robot of this motion cannot be loaded again: {error} Give it: Trajectory.load(path, robot=...)."
        ) from error


def _check_same(given: Mapping[str, Any], robot: CheckedModel, kind: type[RbdError], remedy: str) -> None:
    """Refuse a robot with other joints, sizes or motors."""
    there = recipe(robot)
    for what in ("joints", "kinds", "sizes", "motors"):
        if given.get(what) != there[what]:
            was, now = given.get(what), there[what]
            if isinstance(was, list) and len(was) == len(now):
                was, now = next((pair for pair in zip(was, now, strict=True) if pair[0] != pair[1]), (was, now))
            raise kind(
                f"this motion is of {given.get('name')!r:.80} with {what} {str(was)[:120]}; {robot.name} has {str(now)[:120]}. "
                + ("Give the robot that was simulated." if remedy == "robot" else remedy)
            )


def _changes(robot: CheckedModel, numbers: Array) -> Iterator[str]:
    """Messages: differences between a robot and the numbers of the simulated one."""
    now = robot_numbers(robot)
    if numbers.shape != now.shape:
        raise InputError(f"the numbers of {robot.name} in the file have shape {numbers.shape}; expected {now.shape}.")
    same = np.isclose(now, numbers, rtol=_RELATIVE, atol=_ABSOLUTE)
    for i, name in enumerate(robot.joints):
        at = 0
        for what, width in _COLUMNS.items():
            part = slice(at, at + width)
            at += width
            if not same[i, part].all():
                k = at - width + int(np.argmin(same[i, part]))
                yield f"the {what} at joint {name!r} was {numbers[i, k]:.9g} and is {now[i, k]:.9g}"
    if not same[-1].all():
        yield f"gravity was {numbers[-1, :3].tolist()} and is {now[-1, :3].tolist()}"


def _loops(robot: Robot) -> str | bool | None:
    """The argument of `load_robot` that closes the same loops; None if not known.

    A `Robot` stores the contents and name of its loop file, not its folder.
    """
    own, name = beside(robot.urdf), robot.mechanism.file.name
    if not name:
        return own is None and bool(robot.mechanism.equalities)
    if own is not None and own.name == name:
        return True
    other = robot.urdf.parent / name
    return os.fspath(other.resolve()) if os.path.isfile(other) else None


def _found(name: str) -> Path | None:
    try:
        return catalogue.find(name).urdf
    except RbdError:
        return None


_KNOWN, _OTHERS = "elements", "other_elements"


def header_of_elements(elements: Sequence[ForceElement]) -> dict[str, Any]:
    """The entries of a header that describe the elements; of classes of a user a file has the names alone."""
    data = [data_of(element) for element in elements]
    others = [element.name for element, known in zip(elements, data, strict=True) if known is None]
    return {_KNOWN: [known for known in data if known is not None], _OTHERS: others}


def elements_in(header: Mapping[str, Any], robot: CheckedModel) -> tuple[ForceElement, ...]:
    """The elements that a header describes, none of files of earlier versions; those that it only names are warned of.

    Raises:
        InputError: no elements, or none of the robot.
    """
    others = words_in(header, _OTHERS) if _OTHERS in header else ()
    found = tuple(element_of(data) for data in (listed_in(header, _KNOWN) if _KNOWN in header else ()))
    for element in found:
        element.check_on(robot)
    names = [element.name for element in found]
    if len(set(names)) != len(names):
        raise InputError(f"its header has two force elements of one name: {', '.join(names):.200}")
    if others:
        warnings.warn(
            f"force elements acted that the file has by name alone ({', '.join(others):.200}), as they are not of "
            "rbd.constraints.forces. Drawings do not show them, and rbd.identify needs them: external=[...].",
            ForceElementWarning,
            stacklevel=stacklevel_of_user(),
        )
    return found
