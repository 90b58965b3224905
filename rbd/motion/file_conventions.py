"""Conventions of files of motions: the order of joints, the meaning of columns, the order of quaternions."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, RbdError, nearest
from rbd.errors.inputs import check_different, check_known, listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import conjugate, rotated
from rbd.motion.file_frames import standing_q
from rbd.motion.rates import REST_RATE, turning_error
from rbd.motion.symmetry import other_side
from rbd.robots.robot import Robot

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_WAIST = ("waist_yaw", "waist_roll", "waist_pitch")


def _unitree(leg: Iterable[str], waist: Iterable[str], arm: Iterable[str]) -> tuple[str, ...]:
    legs, arms = ([f"{side}_{name}_joint" for side in ("left", "right") for name in limb] for limb in (list(leg), list(arm)))
    return (*legs, *(f"{name}_joint" for name in waist), *arms)


def _g1(waist: Iterable[str], arm: Iterable[str]) -> tuple[str, ...]:
    return _unitree(_LEG, waist, arm)


FORMATS: Mapping[str, tuple[str, ...]] = {
    "G1 with 29 joints": _g1(_WAIST, _ARM),
    "G1 with 23 joints (no waist roll and pitch, no wrist pitch and yaw)": _g1(_WAIST[:1], _ARM[:5]),
    "G1 with 23 joints (no wrists)": _g1(_WAIST, _ARM[:4]),
}
"""Joints of published motion files by format; of Unitree's own descriptions `g1_29dof` and `g1_23dof`, and of ASAP's."""
_H1_LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle")
_H1_2_LEG = ("hip_yaw", "hip_pitch", "hip_roll", "knee", "ankle_pitch", "ankle_roll")
OTHERS: Mapping[str, tuple[str, ...]] = {
    "H1 with 19 joints": _unitree(_H1_LEG, ("torso",), _ARM[:4]),
    "H1-2 with 27 joints": _unitree(_H1_2_LEG, ("torso",), _ARM),
}
"""Joints of files of robots that need not be in the catalogue, so that they are told."""


def single_joints(robot: CheckedModel) -> tuple[str, ...]:
    """Names of the joints with one degree of freedom, in the order of the model."""
    return tuple(joint.name for joint in robot.joints.values() if joint.nv == 1)


def left_still(robot: CheckedModel, given: Container[str]) -> list[str]:
    """A note of the joints that a file does not give."""
    missing = [j.name for j in robot.joints.values() if j.id not in robot.bases and j.name not in given]
    if not missing:
        return []
    posture = robot.source.posture if isinstance(robot, Robot) and robot.source.posture else "neutral"
    return [f"{len(missing)} joints are not in the file and stay as in the posture {posture!r}: {', '.join(missing)}."]


def file_order(robot: CheckedModel) -> tuple[str, ...]:
    """The same in the order in which the robot's file states them; the model's where it has no file."""
    known = single_joints(robot)
    if not isinstance(robot, Robot):
        return known
    try:
        element = robot.element
    except RbdError:
        return known
    stated = dict.fromkeys(str(e.get("name")) for e in element.iter("joint"))
    order = [name for name in stated if name in known]
    return tuple(order) if len(order) == len(known) else known


def breadth_first(robot: CheckedModel) -> tuple[str, ...]:
    """The same, joints nearer to the base first, siblings in the order of the robot's file: as Isaac's articulations."""
    model, rank = robot.model, {name: i for i, name in enumerate(file_order(robot))}
    ways = {name: [rank.get(model.names[i], -1) for i in model.supports[model.getJointId(name)]] for name in rank}
    return tuple(sorted(rank, key=lambda name: (len(ways[name]), ways[name])))


def formats(robot: CheckedModel) -> dict[str, tuple[str, ...]]:
    """{what it is: joints in order} of the formats that fit this robot; its own file's first."""
    own = file_order(robot)
    found = {f"all {len(own)} joints of {robot.name}": own}
    for name, joints in FORMATS.items():
        if set(joints) < set(own):
            found[name] = joints
    return found


def checked_joints(robot: CheckedModel, joints: Sequence[str]) -> tuple[str, ...]:
    """Names of joints that are given, each of which the robot has once, with one degree of freedom.

    Raises:
        InputError: an unknown name, with the nearest; one twice; no list.
    """
    joints, known = listed_items("joints", joints, "a list of names, in the order of the columns"), single_joints(robot)
    for name in joints:
        check_known(f"{robot.name} has, with one degree of freedom, no joint", name, known)
    check_different(joints, "joints of the columns")
    return tuple(joints)


def beyond_limits(robot: CheckedModel, names: Sequence[str], x: Array) -> Array:
    """How far each joint is beyond its limits in the mean over the frames, shape (k,) [rad, m]."""
    model, columns = robot.model, [robot.joints[name].q.start for name in names]
    free = np.where([robot.joints[name].is_continuous for name in names], np.inf, 0.0)
    lower, upper = model.lowerPositionLimit[columns] - free, model.upperPositionLimit[columns] + free
    return np.asarray(np.maximum(0.0, np.maximum(lower - x, x - upper)).mean(axis=0))


def names_of_width(
    robot: CheckedModel, x: Array, joints: Sequence[str] | None, what: str, *, last: bool = False
) -> tuple[tuple[str, ...], list[str]]:
    """(joints of columns, notes): those given, else of the format that has as many.

    Of two formats that of which joints are within limits, or else that of which left and right are more alike in the median. Of
    the clips here that is right in 301 of 310 pieces of 1 to 10 s, read with 23 joints.

    Args:
        robot: The robot.
        x: Positions of joints, shape (n, k).
        joints: Their names, where they are known.
        what: The beginning of the message, "dance.pkl: dof_pos has".
        last: Of two formats that fit as well take the last.

    Raises:
        InputError: another number of joints; with what they look like.
    """
    width = x.shape[1]
    if joints is not None:
        unknown = [name for name in joints if name not in single_joints(robot)]
        if unknown and (told := looks_like(joints)):
            raise InputError(f"{what} joints that {robot.name} has not, {unknown[0]!r:.80} first.{told}")
        names = checked_joints(robot, joints)
        if len(names) != width:
            raise InputError(f"{what} {width} columns of joints; joints names {len(names)}.")
        return names, []
    known = formats(robot)
    fitting = {name: order for name, order in known.items() if len(order) == width}
    if not fitting:
        told = "; ".join(f"{len(order)}: {name}" for name, order in known.items())
        raise InputError(
            f"{what} {width} columns of joints; expected {told}.{looks_like(width)} Give the robot that it was made for, or "
            "name the joints in order, joints=[...]."
        )
    off = {name: float(beyond_limits(robot, order, x).mean()) for name, order in fitting.items()}
    apart = {name: _sides_apart(order, x) for name, order in fitting.items()}
    chosen, *others = sorted(list(fitting)[:: -1 if last else 1], key=lambda name: (off[name], 0.0 if last else apart[name]))
    notes = [f"{width} joints without names: {chosen}, in that order."]
    if others:
        far, sides = (f"{x[chosen]:.2g} rad in the mean, else {x[others[0]]:.2g}" for x in (off, apart))
        told = f"joints are beyond limits by {far}; sizes of left and right differ by {sides}"
        notes.append(f"as many joints has {others[0]}; {told}. If it is that, name them: joints=[...].")
    return fitting[chosen], notes


def _sides_apart(order: Sequence[str], x: Array) -> float:
    """By how much the sizes of left and right joints differ, in the median of the frames and the mean of the joints [rad]."""
    size = np.abs(np.median(x, axis=0)) if len(x) else np.zeros(len(order))
    return float(np.abs(size - size[[order.index(other_side(name, order)) for name in order]]).mean())


def looks_like(joints: int | Sequence[str]) -> str:
    """Which known robot has this number of joints, or joints of these names, in words; empty if none has."""
    known = {**FORMATS, **OTHERS}
    found = [
        what
        for what, order in known.items()
        if (len(order) == joints if isinstance(joints, int) else set(order) == {known_name(name, order) for name in joints})
    ]
    return f" These look like {' or '.join(found)}." if found else ""


BASE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Columns of a floating base: its place, and a quaternion."""
TIMES = "the first column increases and was taken for times [s]."
"""The note of a table without a header that has one column more than a format."""
_BASE = r"(?:(?:root|base|pelvis|floating_base|free_?flyer|root_joint|body)[ _./]?)?"
_WORDS = {
    re.compile(r"(?:t|time|times|timestamp|seconds)(?:[ _]?[\[(]?(?:s|sec)[\])]?)?$"): "time",
    re.compile(r"(?:frame|frames|index|frame_id|frame_index|#|)$"): "",
    re.compile(_BASE + r"(?:q|quat|quaternion|rot|rotation|orientation)[ _./]?([xyzw])$"): "q",
    re.compile(_BASE + r"(?:pos|position|trans|translate|p|t)?[ _./]?([xyz])$"): "",
}
"""What the names of columns mean that are no joints: times, the numbers of frames, parts of a base."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What is where in a table.

    Attributes:
        time: The column of times; None without one.
        base: Columns of a floating base, x, y, z and its quaternion; empty of a robot without one.
        named: Whether the quaternion is x, y, z, w by its names; else it is in the order of the file.
        joints: {joint: its column}.
        notes: What was guessed, in words.
    """

    time: int | None
    base: tuple[int, ...]
    named: bool
    joints: dict[str, int]
    notes: tuple[str, ...]


def columns_of_header(robot: CheckedModel, names: Sequence[str], path: Path) -> Columns:
    """Columns by the names of a header: time, root x y z, quaternion, joints of the robot.

    Raises:
        InputError: a name that the robot lacks, one twice, a base without all its columns.
    """
    known, joints, parts = single_joints(robot), dict[str, int](), dict[str, int]()
    counted, notes = [], []
    for k, name in enumerate(names):
        joint, part = known_name(name, known), _part(name)
        if joint is None and part is None:
            raise InputError(
                f"{path.name}: column {k + 1} is named {name!r:.80}, which {robot.name} has no joint for; "
                f"{nearest(name, [*known, 't', 'root_x', 'root_qw'])}. Leave the column out, or give another robot."
                f"{looks_like([other for other in names if _part(other) is None])}"
            )
        if joint is None and not part:
            counted.append(name or f"column {k + 1}")
            continue
        where, key = (parts, str(part)) if joint is None else (joints, joint)
        if key in where:
            raise InputError(f"{path.name}: columns {where[key] + 1} and {k + 1} are both {key!r:.80}. Leave one out.")
        where[key] = k
    if counted:
        notes.append(f"columns that only count frames are not read: {', '.join(counted)}.")
    time = parts.pop("time", None)
    missing = [word for word in BASE if word not in parts]
    if robot.floating and missing:
        raise InputError(
            f"{path.name}: its header has no column of the base for {', '.join(missing)}; expected root_x, root_y, "
            "root_z [m], root_qx, root_qy, root_qz, root_qw. Angles of Euler are not read."
        )
    if parts and not robot.floating:
        notes.append(f"{robot.name} has no floating base; the columns of one are not read.")
    base = tuple(parts[word] for word in BASE) if robot.floating else ()
    return Columns(time, base, True, joints, tuple(notes))


def columns_by_number(robot: CheckedModel, numbers: Array, joints: Sequence[str] | None, path: Path) -> Columns:
    """Columns of a table without a header: root x y z, quaternion, joints in the order of a format with as many.

    A column more, that increases, in front is one of times.

    Raises:
        InputError: no format has this number of columns; the message lists the formats.
    """
    width, base = numbers.shape[1], len(BASE) if robot.floating else 0
    moving = [joint for joint in robot.joints.values() if joint.id not in robot.bases]
    if robot.bases and not robot.floating or any(joint.nv > 1 for joint in moving):
        raise InputError(
            f"{path.name}: {robot.name} has joints of several degrees of freedom; give arrays to Motion.of_arrays."
        )
    known = formats(robot) if joints is None else {"the joints that were given": checked_joints(robot, joints)}
    told = "; ".join(f"{base + len(order)}: {what}" for what, order in known.items())
    expected = (
        f"expected ({'x, y, z and a quaternion of the base, then joints' if base else 'joints'}) {told}; or one more, times, "
        "in front. Name the joints in order, joints=[...], or write their names in a header."
    )
    fitting = [(i, what) for i in (0, 1) for what, order in known.items() if width == i + base + len(order)]
    if not fitting:
        raise InputError(f"{path.name} has {width} columns; {expected}{looks_like(width - base)}")
    shift, what = fitting[0]
    if shift and not (np.diff(numbers[:, 0]) > 0.0).all():
        raise InputError(
            f"{path.name} has {width} columns, one more than {what} of {robot.name}: "
            f"were the first that of times, it would increase. {expected}"
        )
    at = shift + base
    names, said = names_of_width(robot, numbers[:, at:], joints, f"{path.name} has")
    order = {name: at + i for i, name in enumerate(names)}
    return Columns(0 if shift else None, tuple(range(shift, at)), False, order, (*([TIMES] if shift else []), *said))


def known_name(name: str, known: Sequence[str]) -> str | None:
    """The joint that a name in a file means: with or without `_joint`, with `_dof` or `_pos` behind; None if none."""
    word = re.sub(r"([_.](dof|pos|position|angle|q))$", "", name.strip())
    return next((each for each in (name, word, f"{word}_joint") if each in known), None)


def _part(name: str) -> str | None:
    """What else it means: "time", a part of `BASE`, "" if it counts frames; None if nothing."""
    for pattern, meaning in _WORDS.items():
        if found := pattern.match(name.lower().strip()):
            return meaning + "".join(found.groups())
    return None


CLEARLY = 0.3
"""By how much the mean cosine of the tilt must differ for an order to be seen."""

TELLING = 2.0
"""An order fits angular velocities if the other one fits them this many times worse."""


def order_base(robot: CheckedModel, t: Array, q: Array, v: Array | None, given: str | None, source: str) -> list[str]:
    """Bring the base's quaternions of configurations into the order x, y, z, w, in place; notes where they were not.

    They are x, y, z, w unless given, or unless the angular velocities fit the other order only, or, where these do not tell,
    the base of a robot with a known posture stays upright in the other order only.
    """
    if given == "xyzw" or not robot.floating:
        return []
    notes = [] if given else _seen_as_wxyz(robot, t, q, v, source)
    if given or notes:
        q[:, 3:7] = q[:, [4, 5, 6, 3]]
    return [f"{note} Else give quaternion='xyzw'." for note in notes]


def _seen_as_wxyz(robot: CheckedModel, t: Array, q: Array, v: Array | None, source: str) -> list[str]:
    """Why quaternions must be w, x, y, z; nothing where they need not be."""
    turn = q[:, 3:7]
    if v is not None and len(t) > 1:
        orders = (turn, turn[:, [1, 2, 3, 0]])
        own, swapped = (turning_error(robot, t, np.hstack([q[:, :3], x, q[:, 7:]]), v) for x in orders)
        if max(own, swapped) > max(REST_RATE, TELLING * min(own, swapped)):
            told = f"angular velocities fit to {swapped:.2g} rad/s, in the other order to {own:.2g}"
            return [f"quaternions were taken as w, x, y, z: {told}."] if swapped < own else []
    if not isinstance(robot, Robot) or not (robot.source.posture or robot.source.feet):
        return []
    found, notes = chosen_order(robot, turn, None, source)
    return [] if found is turn else notes


def chosen_order(
    robot: CheckedModel, turn: Array, given: str | None, file: str, usual: str | None = None
) -> tuple[Array, list[str]]:
    """(quaternions as x, y, z, w, notes): in the order given, else in that in which the base stays upright.

    A wrong order shows: with every turn of the heading the base rolls. It is x, y, z, w, or that of the format, where frames do
    not tell; against that of a format they must tell twice as clearly, for a robot can lie on the floor.

    Args:
        robot: The robot, whose standing posture tells which of its axes is up.
        turn: Four columns, shape (n, 4).
        given: "xyzw", "wxyz" or None.
        file: Name for the notes.
        usual: That of the file's format, if it has one.
    """
    orders = {"xyzw": turn, "wxyz": turn[:, [1, 2, 3, 0]]}
    upright = {name: _upright(robot, x) for name, x in orders.items()}
    first = usual or "xyzw"
    second = "wxyz" if first == "xyzw" else "xyzw"
    chosen = given or (second if upright[second] > upright[first] + (CLEARLY if usual is None else 2.0 * CLEARLY) else first)
    other = "wxyz" if chosen == "xyzw" else "xyzw"
    tilt = f"cosine of the base's tilt in the mean {upright[chosen]:.2f}, in the other order {upright[other]:.2f}"
    notes: list[str] = []
    if max(upright.values()) < -CLEARLY:
        notes.append(f"the base is upside down, in either order of its quaternion: {tilt}. Does it turn the base to the world?")
    if given is None and chosen == usual:
        return orders[chosen], notes
    if given is None:
        sure = abs(upright[chosen] - upright[other]) > CLEARLY
        notes.append(f"quaternions were taken as {', '.join(chosen)}{': ' if sure else ', the usual order: '}{tilt}.")
    elif upright[other] > upright[chosen] + CLEARLY:
        notes.append(
            f"the base spins or lies with quaternions as {', '.join(chosen)}: {tilt}. Is {file} in {', '.join(other)}?"
        )
    return orders[chosen], notes


def _upright(robot: CheckedModel, turn: Array) -> float:
    """The mean cosine between the vertical and the axis of the base that is up when it stands."""
    axis = rotated(conjugate(standing_q(robot)[3:7]), np.array([0.0, 0.0, 1.0]))
    norm = np.linalg.norm(turn, axis=1)
    return float(np.mean(rotated(turn / np.where(norm > 0.0, norm, 1.0)[:, None], axis)[:, 2]))
