"""Motions to files: tables of text, arrays to the last bit, and what GMR, BeyondMimic and MuJoCo's tools read."""

from __future__ import annotations

import io
import json
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_whole
from rbd.constraints.terrain.plain import plain_of
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.errors.inputs import check_choice
from rbd.model.array_file import a_path
from rbd.model.checked_model import CheckedModel
from rbd.model.motors import plain_motors
from rbd.model.output_files import check_place, write_file
from rbd.model.sampled_motion import SampledAccelerations, to_world
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.derivation import Derivation, is_uniform
from rbd.motion.file_conventions import BASE, breadth_first, file_order
from rbd.motion.file_frames import joint_values
from rbd.robots import catalogue
from rbd.robots.robot import Robot
from rbd.robots.travelling import texts_of

ENDINGS = {
    "motion": (".csv", ".npz"),
    "beyondmimic": (".npz",),
    "gmr": (".pkl", ".npz"),
    "mujoco": (".npz",),
}
"""{kind of file: how its name ends}."""


@dataclass(frozen=True, eq=False)
class ToSave:
    """A motion that is written.

    Attributes:
        motion: Robot, times, configurations, velocities and accelerations.
        contacts: Which points touch and slide, when; None where that is not known.
        forces: At these points, in W, shape (n, k, 3) [N]; None where they are not known.
        notes: What is said of it.
        derivation: How v and a came from q, or None.
        ground: Height of the floor [m], or the terrain; None where it is not known.
    """

    motion: SampledAccelerations
    contacts: ContactTimeline | None
    forces: Array | None
    notes: tuple[str, ...]
    derivation: Derivation | None
    ground: float | Terrain | None


def save_motion(given: ToSave, path: object, kind: str, *, header: bool, decimals: int) -> None:
    """Write a motion; arguments and errors as `Motion.save`."""
    check_choice("kind", kind, tuple(ENDINGS))
    endings = " or ".join(ENDINGS[kind])
    where = a_path(path, f"one that ends in {endings}, e.g. 'walk{ENDINGS[kind][-1]}'")
    suffix = where.suffix.lower()
    if suffix not in ENDINGS[kind]:
        raise InputError(f"path is {path!r:.80}; a file of kind {kind!r} ends in {endings}.")
    check_place(where)
    motion, beside = given.motion, _contacts(given)
    if suffix == ".csv":
        if isinstance(given.ground, Terrain):
            raise InputError(f"a .csv cannot hold {given.ground}; expected an .npz, or a motion on a level floor.")
        return _write_csv(where, motion, header=header, decimals=decimals)
    held = _own(given) if kind == "motion" else _KINDS[kind](motion, _single_joints(motion, where))
    arrays = {name: x for name, x in {**held, **beside}.items() if x is not None}
    if suffix == ".npz":
        write_file(where, lambda file: np.savez(file, allow_pickle=False, **arrays))
    else:
        data = pickle.dumps(arrays, protocol=4)
        write_file(where, lambda file: file.write(data))


def _contacts(given: ToSave) -> dict[str, Array]:
    """What is known of the floor and of the contacts there: their places, whether they touch and slide, and the forces."""
    lanes, out = given.contacts, _floor(given.ground)
    if lanes is None:
        return out
    out |= {"contact_names": np.array(lanes.names, dtype="U"), "contact_positions": lanes.places}
    out |= {"contact_labels": lanes.touches, "contact_slides": lanes.slides, "contact_raised": lanes.raised}
    out |= _floor(lanes.ground)
    return out if given.forces is None else out | {"contact_forces": given.forces}


def _floor(ground: float | Terrain | None) -> dict[str, Array]:
    if isinstance(ground, Terrain):
        return {"terrain": np.array(json.dumps(plain_of(ground)))}
    return {} if ground is None else {"ground": np.array(ground)}


def _write_csv(path: Path, motion: SampledAccelerations, *, header: bool, decimals: int) -> None:
    """A table: times and a header with names, or neither; base x y z, quaternion x y z w, joints in the robot's own order."""
    check_whole("decimals", decimals, 17)
    robot, joints = motion.robot, _single_joints(motion, path, floating=False)
    columns = [motion.q[:, :7]] if robot.floating else []
    columns.append(joint_values(robot, motion.q, joints))
    names = [*(f"root_{name}" for name in BASE if robot.floating), *joints]
    if header:
        columns.insert(0, motion.t[:, None])
        names.insert(0, "t")
    out = io.BytesIO()
    # a 1e-9 s off is 60 um/s2 in an acceleration over 0.2 s at 10 m/s2: times have more decimals than the rest
    formats = [f"%.{max(9, decimals)}f"] * header + [f"%.{decimals}f"] * (len(names) - header)
    table = np.concatenate(columns, axis=1)
    np.savetxt(out, table, fmt=formats, delimiter=",", header=",".join(names) if header else "", comments="")
    write_file(path, lambda file: file.write(out.getvalue()))


def _own(given: ToSave) -> dict[str, Array]:
    """t, q, v, a to the last bit, the names of the coordinates, the robot's, and how v and a came from q."""
    robot, how = given.motion.robot, given.derivation
    held = {name: getattr(given.motion, name) for name in ("t", "q", "v", "a")}
    held["coordinates"] = np.array([c.name for c in robot.joints.positions])
    held["robot"] = np.array(_source(robot))
    if isinstance(robot, Robot) and robot.source.in_memory:
        texts = texts_of(robot.text, robot.mechanism)
        held |= {key: np.array(texts[key]) for key in ("text", "loop_file") if texts[key]}
    if robot.motor_data:
        held["motors"] = np.array(json.dumps(plain_motors(robot.motor_data)))
    if isinstance(robot, Robot) and robot.carried:
        held["carried"] = np.array(json.dumps([each.plain for each in robot.carried]))
    held["notes"] = np.array(given.notes, dtype="U") if given.notes else np.array([""])[:0]
    if how is not None:
        held["derivation"], held["method"] = np.array([how.window, how.order, how.cutoff]), np.array(how.method)
        held |= {f"noise_{name}": getattr(how, f"noise_{name}") for name in "qva"}
    return held


def _bodies(motion: SampledAccelerations, joints: Sequence[str]) -> dict[str, Any]:
    """As trackers of motions read it: fps, joints breadth-first, poses and velocities of all bodies in the world."""
    robot, n = motion.robot, len(motion.t)
    order = tuple(name for name in breadth_first(robot) if name in joints)
    ids = [1, *(robot.joint_id(name) for name in order)]
    model, data = robot.model, robot.model.createData()
    shapes = {"body_pos_w": 3, "body_quat_w": 4, "body_lin_vel_w": 3, "body_ang_vel_w": 3}
    out: dict[str, Any] = {name: np.empty((n, len(ids), k)) for name, k in shapes.items()}
    for i in range(n):
        pin.forwardKinematics(model, data, motion.q[i], motion.v[i])
        for k, joint in enumerate(ids):
            X = pin.SE3ToXYZQUAT(data.oMi[joint])
            twist = pin.getVelocity(model, data, joint, pin.LOCAL_WORLD_ALIGNED).vector
            out["body_pos_w"][i, k], out["body_quat_w"][i, k] = X[:3], X[[6, 3, 4, 5]]
            out["body_lin_vel_w"][i, k], out["body_ang_vel_w"][i, k] = twist[:3], twist[3:]
    out["fps"] = np.array([_rate(motion)])
    out["joint_pos"], out["joint_vel"] = joint_values(robot, motion.q, order), _velocities(motion, order)
    links = {robot.site(name)[0]: name for name in reversed(robot.links())}
    out["joint_names"], out["body_names"] = np.array(order), np.array([links.get(i, model.names[i]) for i in ids])
    return out


def _gmr(motion: SampledAccelerations, joints: Sequence[str]) -> dict[str, Any]:
    """As GMR writes it: fps, root_pos, root_rot x y z w, dof_pos; and where links are as seen from the base."""
    robot = motion.robot
    model, data, links = robot.model, robot.model.createData(), robot.links()
    ids = [robot.frame_id(name) for name in links]
    places = np.empty((len(motion.t), len(ids), 3))
    for i, q in enumerate(motion.q):
        pin.framesForwardKinematics(model, data, q)
        places[i] = [data.oMi[1].actInv(data.oMf[k].translation) for k in ids]
    base = {"root_pos": motion.q[:, :3].copy(), "root_rot": motion.q[:, 3:7].copy(), "fps": _rate(motion)}
    return base | {"dof_pos": joint_values(robot, motion.q, joints), "local_body_pos": places, "link_body_list": list(links)}


def _mujoco(motion: SampledAccelerations, joints: Sequence[str]) -> dict[str, Any]:
    """MuJoCo's qpos and qvel, as LocoMuJoCo names them: quaternions w x y z, velocities of a base linear in world axes."""
    q, v = motion.q, to_world(motion.robot, motion.q, motion.v)
    qpos = np.hstack([q[:, :3], q[:, [6, 3, 4, 5]], joint_values(motion.robot, q, joints)])
    qvel = np.hstack([v[:, :6], _velocities(motion, joints)])
    types = {"jnt_type": np.array([0, *(3 if motion.robot.joints[name].is_angle else 2 for name in joints)])}
    names = np.array([motion.robot.model.names[1], *joints])
    return {"qpos": qpos, "qvel": qvel, "joint_names": names, "frequency": np.array(_rate(motion)), **types}


_KINDS: Mapping[str, Callable[[SampledAccelerations, Sequence[str]], dict[str, Any]]] = {
    "beyondmimic": _bodies,
    "gmr": _gmr,
    "mujoco": _mujoco,
}


def _rate(motion: SampledAccelerations) -> float:
    return (len(motion.t) - 1) / float(motion.t[-1] - motion.t[0])


def _velocities(motion: SampledAccelerations, joints: Sequence[str]) -> Array:
    return motion.v[:, [motion.robot.joints[name].v.start for name in joints]]


def _single_joints(motion: SampledAccelerations, path: Path, *, floating: bool = True) -> tuple[str, ...]:
    """The joints of a file of another tool, in the robot's own order.

    Raises:
        InputError: joints of several degrees of freedom, which have no column; no floating base, or unequal times.
    """
    robot = motion.robot
    others = [joint.name for joint in robot.joints.values() if joint.nv > 1 and not (robot.floating and joint.id == 1)]
    if others:
        raise InputError(f"{path.name}: joint {others[0]!r:.80} of {robot.name} is no single number. Save it as .npz with q.")
    if floating and not robot.floating:
        raise InputError(f"{path.name}: {robot.name} has no floating base, and such a file begins with it.")
    if floating and (len(motion.t) < 2 or not is_uniform(motion.t)):
        raise InputError("such a file has one rate for all frames; resample the motion first: motion.resample(rate).")
    return file_order(robot)


def _source(robot: CheckedModel) -> str:
    """What `load_robot` loads it by."""
    if not isinstance(robot, Robot):
        return robot.name
    name = robot.source.name
    by_name = name in catalogue.names() and catalogue.find(name).urdf == robot.urdf  # and no other robot of that name
    return name if by_name else str(robot.urdf)
