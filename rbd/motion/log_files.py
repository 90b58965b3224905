"""Motions in logs of robots: joint states and the pose of the base, from MCAP and rosbag2 (and rosbag1), by `rosbags`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import conjugate, exponential, logarithm, product
from rbd.motion.base_files import BaseAndJoints, frames_of
from rbd.motion.file_conventions import known_name, single_joints
from rbd.motion.file_frames import Frames, ReadSettings, check_unit, file_times
from rbd.motion.fitting_joints import check_given_rates

LOGS = (".mcap", ".db3", ".bag")
"""Suffixes of logs; of rosbag2 also folders with a `metadata.yaml`."""
JOINTS = "sensor_msgs/msg/JointState"
BASES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "tf2_msgs/msg/TFMessage",
)
"""Types of messages with the pose of a base; the first that a log has is taken."""
GAP = 0.1
"""Longest time between poses of the base over which they are interpolated without a note [s]."""


@dataclass(eq=False)
class _Track:
    """What a topic says over time."""

    t: list[float] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)
    names: Sequence[str] = ()
    left_out: int = 0


def is_log(path: Path) -> bool:
    """Whether a path is one of a log: by its suffix, or a folder of rosbag2."""
    return path.suffix.lower() in LOGS or os.path.isfile(path / "metadata.yaml")


def of_log(path: Path, robot: CheckedModel | None, given: ReadSettings) -> Frames:
    """The frames of a log: at each message of joint states, the base interpolated between its poses.

    Raises:
        InputError: no such log, `rosbags` is not installed, no joint states, several topics of them and none named, no pose of
            the base of a floating robot; as `frames_of`.
    """
    if robot is None:
        raise InputError(f"{path.name} does not name its robot; give it: robot='g1'.")
    joints, bases = _tracks(path)
    if not joints:
        raise InputError(f"{path.name} has no joint states; expected messages of {JOINTS}.")
    topic = given.motion or next(iter(joints))
    check_known(f"{path.name} has no joint states on", topic, joints)
    if given.motion is None and len(joints) > 1:
        raise InputError(f"{path.name} has joint states on {', '.join(map(repr, joints))}; name one: motion={topic!r}.")
    track = joints[topic]
    t, first = np.unique(np.array(track.t), return_index=True)
    rows = [track.rows[i] for i in first]
    notes = [f"joint states are those of {topic!r}."]
    if track.left_out or len(t) < len(track.t):
        notes.append(
            f"left out: {track.left_out} messages with other joints, {len(track.t) - len(t)} at times that were there."
        )
    place = turn = None
    if robot.floating:
        name, base = _base_of(path, robot, bases)
        at, when = np.unique(np.array(base.t), return_index=True)
        poses = np.array([base.rows[i] for i in when])
        check_unit(poses[:, 3:], f"{path.name}: orientation {{}} of {name}".format)
        inside = (t >= at[0]) & (t <= at[-1])
        if inside.sum() < 2:
            raise InputError(f"{path.name}: {name} has poses at other times than the joint states of {topic!r}.")
        t, rows = t[inside], [row for row, here in zip(rows, inside, strict=True) if here]
        place, turn = _between(at, poses, t)
        longest = f"; up to {np.diff(at).max():.2g} s apart" if np.diff(at).max(initial=0.0) > GAP else ""
        notes.append(f"the base is interpolated between {len(at)} poses of {name}{longest}.")
    known = [known_name(name, single_joints(robot)) for name in track.names]
    other = [name for name, k in zip(track.names, known, strict=True) if k is None]
    if other:
        notes.append(f"joints that {robot.name} has not are not read: {', '.join(other):.300}.")
    own = [i for i, k in enumerate(known) if k is not None]
    names = [str(known[i]) for i in own]
    if not names:
        raise InputError(f"{path.name}: none of the joints of {topic!r} is of {robot.name}: {', '.join(track.names):.300}.")
    x = np.array([position for position, _ in rows])[:, own]
    v = [velocity for _, velocity in rows]
    t, told = file_times(path, len(t), given, t=t - t[0], column="stamp")
    held = BaseAndJoints(names, x, place, turn, given.quaternion or "xyzw", where=f"{path.name}: pose {{}}".format)
    found = frames_of(path, robot, given, t, [*notes, *told], held)
    if all(len(each) == len(track.names) for each in v):
        said = check_given_rates(found, names, np.array(v)[:, own], path.name, trust=given.trust)
        found = replace(found, notes=(*found.notes, *said))
    return found


def _tracks(path: Path) -> tuple[dict[str, _Track], dict[tuple[str, str, str], _Track]]:
    """({topic: joint states}, {(type, topic, frame): poses}) of a log."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(f"{path.name} is a log, which the package rosbags reads; pip install 'rbd-contact[logs]'.") from None
    joints: dict[str, _Track] = {}
    bases: dict[tuple[str, str, str], _Track] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as log:
            topics = [each for each in log.connections if each.msgtype in (JOINTS, *BASES)]
            for connection, received, raw in log.messages(connections=topics) if topics else ():
                message: Any = log.deserialize(raw, connection.msgtype)
                if connection.msgtype == JOINTS:
                    _add_joints(joints.setdefault(connection.topic, _Track()), message, received)
                for each in message.transforms if connection.msgtype == BASES[3] else [message]:
                    if connection.msgtype in BASES:
                        frame = str(getattr(each, "child_frame_id", "")).lstrip("/")
                        _add_pose(bases.setdefault((connection.msgtype, connection.topic, frame), _Track()), each, received)
    except InputError:
        raise
    except Exception as error:  # readers of logs can raise any exception on invalid bytes
        raise InputError(f"{path.name} is no log that can be read: {str(error)[:200] or type(error).__name__}.") from error
    return joints, bases


def _time(message: Any, received: int) -> float:
    """A message's own time, else when it was received [s]."""
    stamp = message.header.stamp
    own = float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return own if own > 0.0 else 1e-9 * received


def _add_joints(track: _Track, message: Any, received: int) -> None:
    names, position = list(message.name), np.array(message.position, float)
    if not track.names:
        track.names = names
    if names != track.names or len(position) != len(names) or not np.isfinite(position).all():
        track.left_out += 1
        return
    track.t.append(_time(message, received))
    track.rows.append((position, np.array(message.velocity, float)))


def _add_pose(track: _Track, message: Any, received: int) -> None:
    pose = getattr(message, "pose", None)
    pose = getattr(pose, "pose", pose)  # of an Odometry it has a covariance beside it
    place, turn = (
        (message.transform.translation, message.transform.rotation) if pose is None else (pose.position, pose.orientation)
    )
    row = np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w], float)
    if np.isfinite(row).all():
        track.t.append(_time(message, received))
        track.rows.append(row)


def _base_of(path: Path, robot: CheckedModel, bases: dict[tuple[str, str, str], _Track]) -> tuple[str, _Track]:
    """(what it is, poses) of the base: of the best type, and of transforms that of the robot's first link."""
    links = robot.links()
    for kind in BASES:
        for (own, topic, frame), track in bases.items():
            if own == kind and track.t and (frame in ("", links[0], "base_link", "base") or kind == BASES[0]):
                return f"{topic!r} ({kind}{f', {frame}' if frame else ''})", track
    told = _listed(f"{topic} {frame}" for _, topic, frame in bases)
    raise InputError(
        f"{path.name} has no pose of the base of {robot.name}, {links[0]!r}; expected messages of {', '.join(BASES)}. "
        f"Poses in it: {told or 'none'}. An arm that is fixed is read with load_robot(..., root='fixed')."
    )


def _listed(names: Iterable[str]) -> str:
    return f"{', '.join(names):.300}"


def _between(at: Array, poses: Array, t: Array) -> tuple[Array, Array]:
    """(places, quaternions x, y, z, w) at times between those of poses: along straight lines, about one axis."""
    i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, max(0, len(at) - 2))
    j = np.minimum(i + 1, len(at) - 1)
    s = ((t - at[i]) / np.where(j > i, at[j] - at[i], 1.0))[:, None]
    turn = poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1)[:, None]
    way = logarithm(product(conjugate(turn[i]), turn[j]))
    return poses[i, :3] + s * (poses[j, :3] - poses[i, :3]), product(turn[i], exponential(s * way))
