"""Motions from files and to files: tables of text, .npz with bodies or with q, and trajectories."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag, check_whole
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.motors import plain_motors
from rbd.model.output_files import check_place, write_file
from rbd.motion.base_files import BaseAndJoints, frames_of
from rbd.motion.csv_files import Table, read_table
from rbd.motion.derivation import Derivation
from rbd.motion.file_conventions import (
    BASE,
    TIMES,
    breadth_first,
    columns_by_number,
    columns_of_header,
    file_order,
)
from rbd.motion.file_frames import (
    Frames,
    ReadSettings,
    counts_frames,
    file_times,
    joint_values,
)
from rbd.motion.npz_files import of_named_arrays
from rbd.robots import catalogue
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.robots.travelling import texts_of
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_file import a_path

_PACKED = (b"x\x01", b"x\x5e", b"x\x9c", b"x\xda", b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"]\0\0")
_ARRAYS = (b"PK", *(b"\x80" + bytes([i]) for i in range(2, 6)), b"\x93NUMPY", *_PACKED)
"""How archives, arrays of NumPy, pickles and compressed files of joblib begin."""
PICKLES = (".pkl", ".pickle", ".joblib", ".p")
"""Suffixes of pickles, whose oldest protocols are text."""
SUFFIXES = (".csv", ".txt", ".npz", ".npy", ".nc", *PICKLES)
"""Files of a folder that are read as motions; others are read where they are named."""


def read_frames(
    path: str | os.PathLike[str],
    robot: CheckedModel | str | os.PathLike[str] | None,
    given: ReadSettings,
    *,
    progress: bool = True,
) -> Frames:
    """The frames of a file; arguments and errors as `Motion.read`."""
    where = a_path(path, "the path of a file with a motion, e.g. 'dance.csv'")
    kind = where.suffix.lower()
    check_flag("progress", progress)
    if robot is not None and not isinstance(robot, CheckedModel):
        robot = load_robot(robot)
    begins = _beginning(where)
    if kind == ".nc" or (begins.startswith(b"PK") and _is_trajectory(where)):
        motion = Trajectory.load(where, robot)
        notes = ("v and a are those of the trajectory.",)
        return Frames(motion.robot, motion.t, motion.q, motion.v, motion.a, notes=notes, simulated=True)
    if kind in (".npz", ".npy", *PICKLES) or begins.startswith(_ARRAYS):
        if not begins:
            raise InputError(f"{where.name} is empty.")
        return of_named_arrays(where, robot, given)
    if robot is None:
        raise InputError(f"{where.name} does not name its robot; give it: robot='g1'.")
    return _of_table(where, read_table(where, progress=progress), robot, given)


def _of_table(path: Path, table: Table, robot: CheckedModel, given: ReadSettings) -> Frames:
    """The frames of a table, by its header or by the number of its columns."""
    x, first = table.numbers, table.first_line
    if table.names is not None and given.joints is None:
        columns = columns_of_header(robot, table.names, path)
    else:
        columns = columns_by_number(robot, x, given.joints, path)
    names, joints = list(columns.joints), list(columns.joints.values())
    place, turn = list(columns.base[:3]), list(columns.base[3:])
    notes = list(columns.notes)
    at, t, what, step = columns.time, None, "", 0.0
    if at is not None:
        t, step = x[:, at], float(table.steps[at])
        what = f"the column of times, {table.names[at]!r:.80}," if table.names else "the column of times, the first,"
        if counts_frames(t) and not given.trust:
            notes = [note for note in notes if note != TIMES]
    t, told = file_times(path, len(x), given, t=t, column=what, row=lambda i: f"line {first + i}", step=step)
    notes += told
    worth = {"base": place, "quaternion": turn, "joints": joints}
    last = {part: float(table.steps[own].max(initial=0.0)) for part, own in worth.items()}
    if max(last.values()):
        decimals = ", ".join(f"{part} {last[part]:.1g}" for part, own in worth.items() if own)
        notes.append(f"the last decimals are worth: {decimals}; their rounding is counted as noise of q.")
    base = (x[:, place], x[:, turn]) if turn else (None, None)
    where = f"{path.name}, line {{}}: the quaternion in columns {min(turn, default=0) + 1} to {min(turn, default=0) + 4}".format
    order, steps = "xyzw" if columns.named else given.quaternion, (last["base"], last["quaternion"], last["joints"])
    held = BaseAndJoints(names, x[:, joints], base[0], base[1], order, steps, lambda i: where(first + i))
    return frames_of(path, robot, given, t, notes, held)


def _is_trajectory(path: Path) -> bool:
    try:
        with ZipFile(path) as archive:
            return {"header.npy", "tau.npy"} <= set(archive.namelist())
    except (BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError):
        return False


def _beginning(path: Path) -> bytes:
    """The first bytes of a regular file."""
    try:
        if path.is_file() or not path.exists():
            with path.open("rb") as file:
                return file.read(8)
    except (OSError, ValueError) as error:
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    raise InputError(f"{str(path)!r:.200} is no file; expected one with a motion.")


def a_motion_path(path: object) -> Path:
    """A path that ends in .csv or .npz, where a file can be written.

    Raises:
        InputError: if it does not, or cannot.
    """
    where = a_path(path, "one that ends in .csv or .npz, e.g. 'walk.npz'")
    if where.suffix.lower() not in (".csv", ".npz"):
        raise InputError(f"path is {path!r:.80}; expected one that ends in .csv or .npz, e.g. 'walk.npz'.")
    check_place(where)
    return where


def write_csv(path: Path, robot: CheckedModel, t: Array, q: Array, *, header: bool, decimals: int) -> None:
    """A table: times and a header with names, or neither; base x y z, quaternion x y z w, joints in the robot's own order.

    Raises:
        InputError: joints of several degrees of freedom, which have no column.
    """
    check_whole("decimals", decimals, 17)
    joints = _single_joints(robot, path)
    columns = [q[:, :7]] if robot.floating else []
    columns.append(joint_values(robot, q, joints))
    names = [*(f"root_{name}" for name in BASE if robot.floating), *joints]
    if header:
        columns.insert(0, t[:, None])
        names.insert(0, "t")
    out = io.BytesIO()
    # a 1e-9 s off is 60 um/s2 in an acceleration over 0.2 s at 10 m/s2: times have more decimals than the rest
    formats = [f"%.{max(9, decimals)}f"] * header + [f"%.{decimals}f"] * (len(names) - header)
    table = np.concatenate(columns, axis=1)
    np.savetxt(out, table, fmt=formats, delimiter=",", header=",".join(names) if header else "", comments="")
    write_file(path, lambda file: file.write(out.getvalue()))


def write_motion(
    path: Path,
    robot: CheckedModel,
    arrays: Mapping[str, Array],
    notes: Sequence[str],
    derivation: Derivation | None,
    ground: float,
) -> None:
    """An .npz with t, q, v, a to the last bit, the names of the coordinates, the robot's, and how v and a came from q."""
    stored = dict(arrays)
    stored["coordinates"] = np.array([c.name for c in robot.joints.positions])
    stored["robot"] = np.array(_source(robot))
    if isinstance(robot, Robot) and robot.source.in_memory:
        texts = texts_of(robot.text, robot.mechanism)
        stored |= {key: np.array(texts[key]) for key in ("text", "loop_file") if texts[key]}
    if robot.motor_data:
        stored["motors"] = np.array(json.dumps(plain_motors(robot.motor_data)))
    stored["notes"] = np.array(list(notes), dtype="U") if notes else np.array([""])[:0]
    stored["ground"] = np.array(ground)
    if derivation is not None:
        stored["derivation"] = np.array([derivation.window, derivation.order, derivation.cutoff])
        stored["method"] = np.array(derivation.method)
        for name in "qva":
            stored[f"noise_{name}"] = getattr(derivation, f"noise_{name}")
    write_file(path, lambda file: np.savez(file, allow_pickle=False, **stored))


def write_bodies(path: Path, robot: CheckedModel, t: Array, q: Array, v: Array) -> None:
    """An .npz as trackers of motions read it: fps, joints breadth-first, poses and velocities of all bodies in the world.

    Raises:
        InputError: unequal times, no floating base, or joints of several degrees of freedom.
    """
    joints = _single_joints(robot, path)
    if not robot.floating:
        raise InputError(f"{path.name}: {robot.name} has no floating base, and such a file begins with it.")
    order = tuple(name for name in breadth_first(robot) if name in joints)
    ids = [1, *(robot.joint_id(name) for name in order)]
    model, data, n = robot.model, robot.model.createData(), len(t)
    shapes = {"body_pos_w": 3, "body_quat_w": 4, "body_lin_vel_w": 3, "body_ang_vel_w": 3}
    out = {name: np.empty((n, len(ids), k)) for name, k in shapes.items()}
    for i in range(n):
        pin.forwardKinematics(model, data, q[i], v[i])
        for k, joint in enumerate(ids):
            X = pin.SE3ToXYZQUAT(data.oMi[joint])
            twist = pin.getVelocity(model, data, joint, pin.LOCAL_WORLD_ALIGNED).vector
            out["body_pos_w"][i, k], out["body_quat_w"][i, k] = X[:3], X[[6, 3, 4, 5]]
            out["body_lin_vel_w"][i, k], out["body_ang_vel_w"][i, k] = twist[:3], twist[3:]
    out["fps"] = np.array([(n - 1) / (t[-1] - t[0])])
    out["joint_pos"] = joint_values(robot, q, order)
    out["joint_vel"] = v[:, [robot.joints[name].v.start for name in order]]
    links = {robot.site(name)[0]: name for name in reversed(robot.links())}
    out["joint_names"], out["body_names"] = np.array(order), np.array([links.get(i, model.names[i]) for i in ids])
    write_file(path, lambda file: np.savez(file, allow_pickle=False, **out))


def _single_joints(robot: CheckedModel, path: Path) -> tuple[str, ...]:
    others = [joint.name for joint in robot.joints.values() if joint.nv > 1 and not (robot.floating and joint.id == 1)]
    if others:
        raise InputError(f"{path.name}: joint {others[0]!r:.80} of {robot.name} is no single number. Save it as .npz with q.")
    return file_order(robot)


def _source(robot: CheckedModel) -> str:
    """What `load_robot` loads it by."""
    if not isinstance(robot, Robot):
        return robot.name
    name = robot.source.name
    by_name = name in catalogue.names() and catalogue.find(name).urdf == robot.urdf  # and no other robot of that name
    return name if by_name else str(robot.urdf)
