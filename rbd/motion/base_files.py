"""Motions as the pose of a base and the positions of joints: of GMR, TWIST, PHC, ASAP, LocoMuJoCo and MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.motion.array_files import NamedArrays
from rbd.motion.file_conventions import (
    chosen_order,
    formats,
    known_name,
    left_still,
    looks_like,
    names_of_width,
    single_joints,
)
from rbd.motion.file_frames import (
    Frames,
    ReadSettings,
    check_rate,
    check_same_rate,
    check_unit,
    configurations,
    file_times,
    rounding_noise,
    single_step,
    unit_of,
)
from rbd.motion.fitting_joints import check_given_rates, check_joints

PLACES = ("root_pos", "root_trans_offset", "root_trans", "base_pos")
TURNS = ("root_rot", "root_quat", "base_quat")
JOINTS = ("dof_pos", "dof", "joint_pos")
VELOCITIES = ("dof_vel", "dof_vels", "joint_vel")
RATES, STEPS, TIMES = ("fps", "frequency", "mocap_framerate", "frame_rate", "rate"), ("dt", "timestep"), ("t", "time", "times")
NAMES = ("joint_names", "dof_names")
FREE = 7
"""Columns of a free joint in MuJoCo's qpos: x, y, z, and a quaternion w, x, y, z."""
MOST_OBJECTS = 9
"""Free joints of objects behind those of a robot, less one, where they have no names."""


@dataclass(frozen=True, eq=False)
class BaseAndJoints:
    """The pose of a base and the positions of joints in all frames, as a file has them.

    Attributes:
        names: The joints, each with one degree of freedom.
        x: Their positions, shape (n, k), in the file's units.
        place: Of the base, shape (n, 3) [m]; None without one.
        turn: Its quaternions, shape (n, 4).
        order: Theirs, "xyzw" or "wxyz", where it was given; None: as the base stays upright.
        usual: Theirs in files of this format; None if it has no rule.
        steps: What the last digit is worth in place, turn and joints.
        where: Names a quaternion in messages.
    """

    names: Sequence[str]
    x: Array
    place: Array | None = None
    turn: Array | None = None
    order: str | None = None
    usual: str | None = None
    steps: tuple[float, float, float | Array] = (0.0, 0.0, 0.0)
    where: Callable[[int], str] = "frame {}".format


def frames_of(
    path: Path, robot: CheckedModel, given: ReadSettings, t: Array, told: Sequence[str], held: BaseAndJoints
) -> Frames:
    """The frames of columns, with notes.

    Raises:
        InputError: a quaternion of another length; joints in degrees, beyond their limits, or with left and right exchanged.
    """
    base, notes, names = None, list(told), held.names
    if held.place is not None and held.turn is not None and robot.floating:
        check_unit(held.turn, held.where)
        ordered, seen = chosen_order(robot, held.turn, held.order, path.name, held.usual)
        base = held.place, ordered
        notes += seen
    unit = unit_of(robot, names, held.x, given.units, path.name)
    q = configurations(robot, base, names, held.x * unit)
    if not given.trust:
        notes += check_joints(robot, names, held.x * unit, q, path.name, given.units)
    place, turn, steps = held.steps
    notes += left_still(robot, names)
    return Frames(robot, t, q, notes=tuple(notes), noise=rounding_noise(robot, place, turn, names, unit * steps))


def of_base(file: NamedArrays, robot: CheckedModel, given: ReadSettings) -> Frames:
    """The frames of a base's positions and quaternions and of joints, each an array, as of GMR, TWIST, PHC and ASAP."""
    keys = [file.first(*names) for names in (PLACES, TURNS, JOINTS)]
    place, turn, x = (_rows(file, key) for key in keys)
    n = len(x)
    if place.shape != (n, 3) or turn.shape != (n, 4) or x.ndim != 2:
        sizes = ", ".join(f"{key} {file.arrays[key].shape}" for key in keys)
        raise InputError(f"{file.path.name}: {sizes}; expected (n, 3), (n, 4), (n, joints).")
    if not robot.floating:
        raise InputError(f"{file.path.name} holds the pose of a base, and {robot.name} has no floating base.")
    t, told = times_in(file, given, n)
    joints, said = _names(file, robot, given, x, f"{keys[2]} has", asap=keys[0] == "root_trans_offset")
    first, second, third = (single_step(file.arrays[key]) for key in keys)
    where = f"{file.path.name}: {keys[1]}[{{}}]".format
    usual = "xyzw" if keys[1] == "root_rot" else None
    held = BaseAndJoints(joints, x, place, turn, given.quaternion, usual, (first, second, third), where)
    found = frames_of(file.path, robot, given, t, [*said, *told], held)
    key = file.first(*VELOCITIES)
    return checked_rates_of(file, found, given, joints, _rows(file, key) if key else None)


def of_qpos(file: NamedArrays, robot: CheckedModel, given: ReadSettings) -> Frames:
    """The frames of MuJoCo's qpos: a free joint x, y, z, then w, x, y, z; then joints; free joints of objects are left out."""
    qpos, path = _rows(file, "qpos"), file.path
    if qpos.ndim != 2:
        raise InputError(f"{path.name}: qpos has shape {qpos.shape}; expected (n, nq).")
    t, told = times_in(file, given, len(qpos))
    width, base, objects = qpos.shape[1], FREE if robot.floating else 0, list[int]()
    where, frees = _layout(file, robot, width) if given.joints is None else ({}, [])
    if where:
        before = [start for start in frees if start < min(where.values())]  # the base is the last before the joints
        base = before[-1] if robot.floating and before else 0
        objects = [start for start in frees if start != base or not robot.floating]
        names: Sequence[str] = tuple(where)
        said, columns = list[str](), np.array(list(where.values()))
    else:
        widths = [len(given.joints)] if given.joints is not None else [len(order) for order in formats(robot).values()]
        count = next((k for k in range(MOST_OBJECTS) if width - base - FREE * k in widths), 0)
        objects = [width - FREE * k for k in range(count, 0, -1)]
        columns = np.arange(base, width - FREE * count)
        names, said = _names(file, robot, given, qpos[:, columns], f"qpos has {base} columns of the base and")
        base = 0
    x, frees = qpos[:, columns], [*([base] if robot.floating else []), *objects]
    for start in objects:
        moves = np.ptp(qpos[:, start : start + 3], axis=0).round(2).tolist()
        said.append(f"columns {start} to {start + FREE - 1} of qpos are of an object, that moves over {moves} m, and not read.")
    step = single_step(file.arrays["qpos"])
    place, turn = (qpos[:, base : base + 3], qpos[:, base + 3 : base + FREE]) if robot.floating else (None, None)
    held = BaseAndJoints(names, x, place, turn, given.quaternion, "wxyz", (step, step, step), f"{path.name}: qpos[{{}}]".format)
    found = frames_of(path, robot, given, t, [*said, *told], held)
    v = _rows(file, "qvel") if "qvel" in file else np.empty(0)
    if v.shape != (len(qpos), width - len(frees)):  # a free joint has a velocity less than positions
        return checked_rates_of(file, found, given, names, None)
    return checked_rates_of(file, found, given, names, v[:, columns - np.searchsorted(np.sort(frees), columns)])


def _layout(file: NamedArrays, robot: CheckedModel, width: int) -> tuple[dict[str, int], list[int]]:
    """({joint: its column of qpos}, first columns of free joints) as the file names them; empty where names do not fit.

    Names that the robot has not are free joints, of its base and of objects, where the file's own types do not say otherwise.
    """
    listed = file.texts(file.first(*NAMES) or NAMES[0])
    if listed is None:
        return {}, []
    known = [known_name(name, single_joints(robot)) for name in listed]
    types = file.numbers("jnt_type").astype(int).tolist() if "jnt_type" in file else []
    if len(types) == len(listed):
        sizes = [{0: FREE, 1: 4}.get(kind, 1) for kind in types]
    else:
        sizes = [FREE if name is None else 1 for name in known]
    if sum(sizes) != width:
        return {}, []
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int).tolist()
    unknown = [name for name, k, size in zip(listed, known, sizes, strict=True) if k is None and size != FREE]
    if unknown:
        raise InputError(
            f"{file.path.name}: joint {unknown[0]!r:.80} is none of {robot.name}; {nearest(unknown[0], single_joints(robot))}."
            f"{looks_like([name for name, size in zip(listed, sizes, strict=True) if size != FREE])}"
        )
    where = {name: start for name, start, size in zip(known, starts, sizes, strict=True) if name is not None and size == 1}
    return where, [start for start, size in zip(starts, sizes, strict=True) if size == FREE]


def times_in(file: NamedArrays, given: ReadSettings, n: int) -> tuple[Array, list[str]]:
    """(times [s], notes): those of a file, or of its rate, or of the rate given.

    Raises:
        InputError: no frames; a rate that no motion has, or another than given; as `file_times`.
    """
    if not n:
        raise InputError(f"{file.path.name} has no frame; expected one row for each.")
    key, step = file.first(*RATES), file.first(*STEPS)
    if (key or step) and not (given.trust and given.rate):
        value = float(file.numbers(key or step).ravel()[0]) if file.arrays[key or step].size else 0.0
        own = check_rate(value if key else 1.0 / value if value else 0.0, f"{key or f'1 / {step}'} in {file.path.name}")
        check_same_rate(given.rate, own, f"{key or f'1 / {step}'} in {file.path.name} is")
        return file_times(file.path, n, replace(given, rate=own))
    key = file.first(*TIMES)
    t = file.numbers(key) if key else None
    return file_times(file.path, n, given, t=t if t is not None and t.shape == (n,) else None, column=key)


def _names(
    file: NamedArrays, robot: CheckedModel, given: ReadSettings, x: Array, what: str, *, asap: bool = False
) -> tuple[Sequence[str], list[str]]:
    """(joints of the columns, notes): as given, as the file names them, or as their number tells."""
    joints = given.joints
    listed = None if joints is not None else file.texts(file.first(*NAMES) or "joint_names")
    if listed is not None and len(listed) == x.shape[1]:
        joints = [known_name(name, single_joints(robot)) or name for name in listed]
    x = np.radians(x) if given.units == "deg" else x
    return names_of_width(robot, x, joints, f"{file.path.name}: {what}", last=asap)


def _rows(file: NamedArrays, key: str) -> Array:
    """An array; a last axis of length one behind two others goes."""
    x = file.numbers(key)
    return x[..., 0] if x.ndim == 3 and x.shape[2] == 1 else x


def checked_rates_of(file: NamedArrays, found: Frames, given: ReadSettings, names: Sequence[str], v: Array | None) -> Frames:
    """The same, after velocities of joints in the file were compared; with a note of what was not read."""
    notes: list[Any] = [f"motion {file.motion!r:.80} of the file."] if file.motion else []
    if v is not None:
        notes += check_given_rates(found, names, v, file.path.name, trust=given.trust)
    return replace(found, notes=(*notes, *found.notes, *file.unread()))
