"""Motions from files and to files: tables of text, .npz with bodies or with q, and trajectories."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.motors import plain_motors
from rbd.model.output_files import check_place, write_file
from rbd.motion.csv_files import BASE, TIMES, Columns, Table, columns_by_number, columns_of_header, read_table
from rbd.motion.derivation import NEARLY_UNIT, Derivation
from rbd.motion.file_conventions import breadth_first, check_quaternion, chosen_order, file_order, left_still, standing_q
from rbd.motion.file_frames import Frames, check_rate, check_same_rate, counts_frames, joint_positions, joint_values, unit_of
from rbd.motion.npz_files import of_npz
from rbd.robots import catalogue
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.robots.travelling import texts_of
from rbd.simulation.trajectory import Trajectory

ROUNDING = 1.0 / np.sqrt(12.0)
"""Standard deviation of rounding, over what the last decimal is worth."""
_RATE = re.compile(r"(?<![\d.])(\d{1,4}(?:\.\d+)?)[ _-]?(?:hz|fps)", re.IGNORECASE)


def read_frames(
    path: str | os.PathLike[str],
    robot: CheckedModel | str | os.PathLike[str] | None,
    *,
    rate: float | None = None,
    quaternion: str | None = None,
    joints: Sequence[str] | None = None,
    units: str | None = None,
    trust: bool = False,
    progress: bool = True,
) -> Frames:
    """The frames of a file; arguments and errors as `Motion.read`."""
    where = _a_path(path)
    check_flag("progress", progress)
    check_flag("trust", trust)
    check_quaternion(quaternion)
    if units is not None and (not isinstance(units, str) or units not in ("rad", "deg")):
        raise InputError(f"units is {units!r:.80}; expected 'rad' or 'deg'.")
    rate = None if rate is None else check_rate(rate)
    if robot is not None and not isinstance(robot, CheckedModel):
        robot = load_robot(robot)
    if where.suffix.lower() in (".pkl", ".pickle", ".pt", ".pth", ".joblib", ".p"):
        raise InputError(
            f"{where.name} is a pickle, which can run any program when read; save q and t as .npz or .csv instead."
        )
    if where.suffix.lower() in (".npz", ".nc"):
        return _of_arrays_in(where, robot, rate, quaternion, joints, units, trust)
    if where.suffix.lower() == ".npy":
        raise InputError(f"{where.name} holds one array without times; give it to Motion.of_arrays(robot, t, q).")
    if robot is None:
        raise InputError(f"{where.name} does not name its robot; give it: robot='g1'.")
    with _opened(where) as begin:
        if begin[:2] in (b"PK", b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05") or begin[:6] == b"\x93NUMPY":
            raise InputError(
                f"{where.name} is no text; expected a table of numbers, or an archive named .npz. Pickles are not read."
            )
    table = read_table(where, progress=progress)
    by_name = table.names is not None and joints is None
    if by_name:
        assert table.names is not None
        columns = columns_of_header(robot, table.names, where)
    else:
        columns = columns_by_number(robot, table.numbers, joints, where)
    notes = list(columns.notes)
    x = table.numbers
    t = _times(where, table, columns, rate, notes, trust)
    q = np.tile(standing_q(robot), (len(x), 1))
    noise = np.zeros(robot.nv)
    if columns.place:
        q[:, :3] = x[:, columns.place]
        turn, told = chosen_order(robot, x[:, columns.turn], "xyzw" if columns.named else quaternion, where.name)
        _check_norms(where, turn, columns, table)
        q[:, 3:BASE] = turn
        notes += told
        noise[:3] = ROUNDING * table.steps[list(columns.place)].max()
        noise[3:6] = 2.0 * ROUNDING * table.steps[list(columns.turn)].max()
    names, at = list(columns.joints), list(columns.joints.values())
    scale = unit_of(robot, names, x[:, at], units, where.name)
    joint_positions(robot, q, names, x[:, at] * scale)
    for name, unit in zip(names, scale, strict=True):
        noise[robot.joints[name].v] = ROUNDING * unit * table.steps[at].max()
    notes += left_still(robot, columns.joints)
    if (noise > 0.0).any():
        notes.append(_decimals(table.steps, columns, len(at)))
    return Frames(robot, t, q, notes=tuple(notes), noise=noise)


def _of_arrays_in(
    path: Path,
    robot: CheckedModel | None,
    rate: float | None,
    quaternion: str | None,
    joints: Sequence[str] | None,
    units: str | None,
    trust: bool,
) -> Frames:
    with _opened(path) as begin:
        if not begin:
            raise InputError(f"{path.name} is empty.")
    if path.suffix == ".nc" or _is_trajectory(path):
        motion = Trajectory.load(path, robot)
        notes = ("v and a are those of the trajectory.",)
        return Frames(motion.robot, motion.t, motion.q, motion.v, motion.a, notes=notes, simulated=True)
    return of_npz(path, robot, rate, quaternion, joints, units, trust)


def _is_trajectory(path: Path) -> bool:
    try:
        with ZipFile(path) as archive:
            return {"header.npy", "tau.npy"} <= set(archive.namelist())
    except (BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError):
        return False


def _times(path: Path, table: Table, columns: Columns, rate: float | None, notes: list[str], trust: bool) -> Array:
    """Times of its column, or of the rate; even ones where the column is even to its decimals."""
    n = len(table.numbers)
    t = None if columns.time is None else table.numbers[:, columns.time]
    numbers = None
    if t is not None and counts_frames(t) and not trust:
        t, numbers = None, t
        notes[:] = [note for note in notes if note != TIMES]
    if t is not None:
        bad = np.flatnonzero(~(np.diff(t) > 0.0))
        if len(bad):
            i = int(bad[0])
            raise InputError(
                f"{path.name}, line {table.first_line + i + 1}: time {t[i + 1]:.9g} s does not follow {t[i]:.9g} s. "
                "Sort the frames, leave out repeated ones."
            )
        if n > 1:
            own = check_rate((n - 1) / (t[-1] - t[0]), f"the rate of the times in {path.name}")
            check_same_rate(rate, own, f"the times in {path.name} have")
            even = np.linspace(t[0], t[-1], n)
            if 0.0 < np.abs(t - even).max() <= 1.01 * table.steps[columns.time]:
                notes.append(f"times are even to their decimals, and were taken for even: {own:.6g} Hz.")
                t = even
        return np.asarray(t)
    if rate is None:
        found = _RATE.search(path.stem)
        if found is None:
            what = "has no times"
            if numbers is not None:
                at = table.names[columns.time] if table.names and columns.time is not None else "the first column"
                what += f": {at!r:.80} counts frames, {numbers[0]:g}, {numbers[1]:g}, {numbers[2]:g}, ..."
            raise InputError(f"{path.name} {what}; give rate=30 [Hz], or whatever it is: most such files have 30 or 60.")
        rate = check_rate(float(found[1]), f"the rate in the name of {path.name}")
        notes.append(f"the rate, {rate:g} Hz, was taken from the file's name.")
    if numbers is not None:
        notes.append(f"the column of times counts frames, from {numbers[0]:g} to {numbers[-1]:g}; times are those of the rate.")
        return np.asarray((numbers - numbers[0]) / rate)
    return np.asarray(np.arange(n) / rate)


def _check_norms(path: Path, turn: Array, columns: Columns, table: Table) -> None:
    norm = np.linalg.norm(turn, axis=1)
    bad = np.flatnonzero(~(np.abs(norm - 1.0) <= NEARLY_UNIT))
    if len(bad):
        i, first = int(bad[0]), min(columns.turn) + 1
        raise InputError(
            f"{path.name}, line {table.first_line + i}: the quaternion in columns {first} to {first + 3} has norm "
            f"{norm[i]:.6g}; expected 1 to {NEARLY_UNIT:g}. Are these its columns?"
        )


def _decimals(steps: Array, columns: Columns, joints: int) -> str:
    parts = {"base": columns.place, "quaternion": columns.turn, "joints": tuple(columns.joints.values())}
    told = [f"{what} {max(steps[list(at)]):.1g}" for what, at in parts.items() if at]
    return f"the last decimals are worth: {', '.join(told)}; their rounding is counted as noise of q."


@contextmanager
def _opened(path: Path) -> Iterator[bytes]:
    """The first bytes of a regular file."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{str(path)!r:.200} is no file; expected one with a motion.")
        with path.open("rb") as file:
            yield file.read(8)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error


def _a_path(path: object) -> Path:
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"path is {path!r:.80}; expected the path of a file with a motion, e.g. 'dance.csv'.")
    try:
        return Path(text).expanduser()
    except RuntimeError:  # "~nobody"
        return Path(text)


BASE_NAMES = ("root_x", "root_y", "root_z", "root_qx", "root_qy", "root_qz", "root_qw")


def a_motion_path(path: object) -> Path:
    """A path that ends in .csv or .npz, where a file can be written.

    Raises:
        InputError: if it does not, or cannot.
    """
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str) or "\0" in text or Path(text).suffix.lower() not in (".csv", ".npz"):
        raise InputError(f"path is {path!r:.80}; expected one that ends in .csv or .npz, e.g. 'walk.npz'.")
    where = Path(text)
    check_place(where)
    return where


def write_csv(path: Path, robot: CheckedModel, t: Array, q: Array, *, header: bool, decimals: int) -> None:
    """A table: times and a header with names, or neither; base x y z, quaternion x y z w, joints in the robot's own order.

    Raises:
        InputError: joints of several degrees of freedom, which have no column.
    """
    if isinstance(decimals, bool) or not isinstance(decimals, int) or not 1 <= decimals <= 17:
        raise InputError(f"decimals is {decimals!r:.80}; expected a whole number from 1 to 17.")
    joints = _single_joints(robot, path)
    columns = [q[:, :7]] if robot.floating else []
    columns.append(joint_values(robot, q, joints))
    names = [*(BASE_NAMES if robot.floating else ()), *joints]
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
