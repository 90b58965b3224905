"""Motions from files, by what they hold: tables of text, arrays by name, pickles, and trajectories."""

from __future__ import annotations

import os
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np

from rbd.arrays import check_flag
from rbd.errors import InputError
from rbd.model.array_file import a_path
from rbd.model.checked_model import CheckedModel
from rbd.motion.base_files import BaseAndJoints, frames_of
from rbd.motion.csv_files import Table, read_table
from rbd.motion.file_conventions import (
    TIMES,
    columns_by_number,
    columns_of_header,
)
from rbd.motion.file_frames import (
    Frames,
    ReadSettings,
    counts_frames,
    file_times,
)
from rbd.motion.log_files import LOGS, is_log, of_log
from rbd.motion.npz_files import of_named_arrays
from rbd.robots.loading import load_robot
from rbd.simulation.trajectory import Trajectory

_PACKED = (b"x\x01", b"x\x5e", b"x\x9c", b"x\xda", b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"]\0\0")
_ARRAYS = (b"PK", *(b"\x80" + bytes([i]) for i in range(2, 6)), b"\x93NUMPY", *_PACKED)
"""How archives, arrays of NumPy, pickles and compressed files of joblib begin."""
PICKLES = (".pkl", ".pickle", ".joblib", ".p")
"""Suffixes of pickles, whose oldest protocols are text."""
SUFFIXES = (".csv", ".txt", ".npz", ".npy", ".nc", *PICKLES, *LOGS)
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
    if is_log(where):
        return of_log(where, robot, given)
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
        columns = columns_by_number(robot, np.radians(x) if given.units == "deg" else x, given.joints, path)
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
    held = BaseAndJoints(names, x[:, joints], base[0], base[1], order, None, steps, lambda i: where(first + i))
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
