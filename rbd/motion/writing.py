"""Motions to files: tables of text, and .npz of `rbd` or of bodies over time, written whole or not at all."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.motors import plain_motors
from rbd.model.output_files import check_place, write_file
from rbd.motion.derivation import Derivation
from rbd.motion.frames import joint_values
from rbd.motion.joint_orders import breadth_first, file_order
from rbd.robots import catalogue
from rbd.robots.robot import Robot
from rbd.robots.travelling import texts_of

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
