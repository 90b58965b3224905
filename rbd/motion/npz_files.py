"""Motions in .npz: of `Motion.save`, of q and t, and of bodies over time, whose joint order is verified by kinematics."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.terrain.plain import terrain_of
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel, with_plain_motors
from rbd.motion.array_files import NamedArrays, named_arrays
from rbd.motion.base_files import (
    FREE,
    JOINTS,
    MOST_OBJECTS,
    PLACES,
    TURNS,
    checked_rates_of,
    of_base,
    of_qpos,
    times_in,
)
from rbd.motion.contact_lanes import StoredContacts
from rbd.motion.derivation import Derivation, Method
from rbd.motion.file_conventions import (
    breadth_first,
    checked_joints,
    chosen_order,
    file_order,
    formats,
    known_name,
    left_still,
    looks_like,
    single_joints,
)
from rbd.motion.file_frames import (
    Frames,
    ReadSettings,
    check_unit,
    configurations,
    file_times,
    joint_values,
    rounding_noise,
    single_step,
    unit_of,
)
from rbd.motion.fitting_joints import check_joints
from rbd.robots.loading import load_robot
from rbd.robots.robot import with_plain_things
from rbd.robots.travelling import given_texts

NEAR, TURNED = 1e-3, 5e-3
"""How far a body may be from where kinematics puts it: a millimetre, and an angle [rad] that four decimals leave."""
REVISED = 0.03
"""How far it may be where joints are named and all angles agree: revisions of a robot differ by a centimetre [m]."""
ROUNDED = 1e-6
"""Norms off by less, as numbers of single precision are, are not told."""
TESTED = 500
"""Number of frames, evenly spread, on which an order of joints is tested."""
BODIES = ("fps", "joint_pos", "body_pos_w", "body_quat_w")


def of_named_arrays(path: Path, robot: CheckedModel | None, given: ReadSettings) -> Frames:
    """The frames of an .npz, an .npy, a pickle or a file of joblib, by what it holds.

    Raises:
        InputError: nothing known; sizes that do not fit; an order of joints that kinematics does not confirm.
    """
    file = named_arrays(path, given.motion)
    robot = _stored_robot(file) if robot is None else robot
    for needed, frames_of in KINDS:
        if all(file.first(*names) for names in needed):
            contacts, ground = _contacts(file)
            found = frames_of(file, robot, given)
            if contacts is not None and len(contacts.touches) != len(found.t):
                raise InputError(f"{path.name}: contact_labels has {len(contacts.touches)} rows for {len(found.t)} frames.")
            return replace(found, contacts=contacts, ground=ground)
    held = ", ".join(sorted([*file.arrays, *file.others]))[:200] or "nothing"
    raise InputError(
        f"{path.name} holds {held}; expected q and t; {', '.join(BODIES)}; root_pos, root_rot, dof_pos, fps (GMR, TWIST); "
        "root_trans_offset, root_rot, dof, fps (PHC, ASAP); qpos (MuJoCo, LocoMuJoCo); or what Motion.save writes."
    )


def _stored_robot(file: NamedArrays) -> CheckedModel:
    """The robot that `Motion.save` wrote.

    Raises:
        InputError: there is none, or its motors or what it carries are no JSON.
    """
    if "robot" not in file:
        raise InputError(f"{file.path.name} does not name its robot; give it: robot='g1'.")
    texts = given_texts({key: file.text(key) for key in ("text", "loop_file") if key in file})
    robot = load_robot(file.text("robot")) if texts is None else load_robot(**texts)
    given = [file.text(key) if key in file else "null" for key in ("motors", "carried")]
    try:
        motors, things = map(json.loads, given)
    except json.JSONDecodeError:
        raise InputError(f"{file.path.name}: motors, carried are {given!r:.80}; expected JSON of Motion.save.") from None
    return with_plain_things(with_plain_motors(robot, motors), things)


def _contacts(file: NamedArrays) -> tuple[StoredContacts | None, float | Terrain | None]:
    """(contacts and forces of the floor, its height [m] or the terrain) as `Motion.save` writes them; None without them.

    Raises:
        InputError: their shapes do not fit, or a terrain that is none.
    """
    heights = file.numbers("ground").ravel() if "ground" in file else np.zeros(0)
    ground: float | Terrain | None = float(heights[0]) if len(heights) == 1 else None
    if "terrain" in file:
        try:
            ground = terrain_of(json.loads(file.text("terrain")))
        except json.JSONDecodeError:
            raise InputError(f"{file.path.name}: terrain is no JSON of Motion.save.") from None
    names = file.texts("contact_names")
    kinds = [f"contact_{what}" for what in ("labels", "slides", "raised")]
    if not names or not set(kinds) <= set(file.arrays):
        return None, ground
    labels = [file.numbers(name) > 0.0 for name in kinds]
    forces = file.numbers("contact_forces") if "contact_forces" in file else None
    file.used.add("contact_positions")  # those of kinematics
    shape = (len(labels[0]), len(names))
    for what, x in zip([*kinds, "contact_forces"], [*labels, forces], strict=True):
        own = shape if what in kinds else (*shape, 3)
        if x is not None and x.shape != own:
            raise InputError(f"{file.path.name}: {what} has shape {x.shape}; expected {own}, for contact_names.")
    touches, slides, raised = labels
    return StoredContacts(names, touches, slides, raised, forces), ground


def _of_q(file: NamedArrays, robot: CheckedModel, given: ReadSettings) -> Frames:
    path, names = file.path, [c.name for c in robot.joints.positions]
    own = file.texts("coordinates")  # of Motion.save
    if own is not None and own != names:
        odd = next((n for n in own if n not in names), None) or next((n for n in names if n not in own), "their order")
        raise InputError(f"{path.name} holds a motion of another robot than {robot.name}: they differ in {odd!r:.80}.")
    t, q = file.numbers("t"), file.numbers("q")
    for what, x, shape in (("t", t, (len(t),)), ("q", q, (len(t), robot.nq))):
        if x.shape != shape:
            raise InputError(f"{path.name}: {what} has shape {x.shape}; expected {shape} for {robot.name}.")
    v, a = (file.numbers(name) if name in file else None for name in ("v", "a"))
    how = None
    if "derivation" in file and v is not None and a is not None:
        try:
            window, order, cutoff = (float(x) for x in file.numbers("derivation"))
            noise = [file.numbers(f"noise_{x}") for x in "qva"]
            if any(x.shape != (robot.nv,) for x in noise):
                raise ValueError
            method: Method = "low-pass" if file.text("method") == "low-pass" else "local polynomial"
            how = Derivation(method, window, int(order), cutoff, *noise)
        except (ValueError, KeyError):
            raise InputError(f"{path.name}: what it says of how v and a came from q cannot be read. Leave it out.") from None
    t, told = file_times(path, len(t), replace(given, trust=given.trust or own is not None), t=t)
    stored = file.arrays["q"]
    rounding = rounding_noise(robot, single_step(stored[:, :3]), single_step(stored[:, 3:7]), robot.joints, single_step(stored))
    turns = given.quaternion or (None if own is None else "xyzw")
    if own is None and not given.trust:
        moving = single_joints(robot)
        told += check_joints(robot, moving, joint_values(robot, q, moving), q, path.name, given.units)
    notes = (*(file.texts("notes") or ()), *told)
    return Frames(robot, t, q, v, a, how, notes, rounding, quaternion=turns)


def _of_bodies(file: NamedArrays, robot: CheckedModel, given: ReadSettings) -> Frames:
    path = file.path
    x, place, turn = (file.numbers(name) for name in BODIES[1:])
    n, base_body, steps = len(x), 0, [single_step(file.arrays[name]) for name in BODIES[1:]]
    fits = x.ndim == 2 and place.ndim == 3 and place.shape[::2] == (n, 3) and turn.shape == (*place.shape[:2], 4)
    if not fits or not n:
        raise InputError(
            f"{path.name}: joint_pos {x.shape}, body_pos_w {place.shape}, body_quat_w {turn.shape}; "
            "expected (n, joints), (n, bodies, 3), (n, bodies, 4)."
        )
    if not robot.floating or not place.shape[1]:
        raise InputError(f"{path.name} holds bodies in the world, the base first; {robot.name} has no floating base.")
    t, notes = times_in(file, given, n)
    v = file.numbers("joint_vel") if "joint_vel" in file else None
    counts = {len(names) for names in _candidates(file, robot, given.joints).values()}
    objects = next((k for k in range(MOST_OBJECTS) if x.shape[1] - FREE * (k + 1) in counts), None)
    if objects is not None and x.shape[1] not in counts:  # a free joint in front, as of holosoma
        off = np.abs(place - x[:, None, :3]).max(axis=(0, 2), initial=0.0)
        base_body = int(off.argmin())
        if off[base_body] > NEAR:
            raise InputError(f"{path.name}: joint_pos begins with no body's place: the nearest is {off[base_body]:.3g} m away.")
        k = x.shape[1] - FREE * (objects + 1)
        notes.append(
            f"joint_pos begins with the free joint of body {base_body}, and ends with those of {objects} objects, not read."
        )
        x, v = x[:, FREE : FREE + k], None if v is None else v[:, FREE - 1 : FREE - 1 + k]
    place, turn, base_body, told = _own_bodies(file, robot, place, turn, base_body)
    notes += told
    flat = turn.reshape(-1, 4)
    norm = check_unit(flat, lambda i: f"{path.name}: body_quat_w[{i // turn.shape[1]}, {i % turn.shape[1]}]")
    turn = (flat / norm[:, None]).reshape(turn.shape)
    off = float(np.abs(norm - 1.0).max())
    if off > ROUNDED:
        notes.append(f"quaternions in body_quat_w were normalised: off by up to {off:.1g}.")
    base, told = chosen_order(robot, turn[:, base_body], given.quaternion or "wxyz", path.name)
    notes += told
    turn = turn if given.quaternion == "xyzw" else turn[:, :, [1, 2, 3, 0]]
    errors, named = {}, given.joints is not None or file.texts("joint_names") is not None
    for what, names in _orders(file, robot, given.joints, x.shape[1]).items():
        unit = unit_of(robot, names, x, given.units, path.name)
        q = configurations(robot, (place[:, base_body], base), names, x * unit)
        far, angle, links = _error(robot, q, place, turn)
        errors[what] = f"{1e3 * far:.3g} mm, {angle:.2g} rad"
        if angle <= TURNED and far <= (REVISED if named else NEAR):
            other = "; distances are those of another revision of the robot" if far > NEAR else ""
            notes.append(
                f"joints are in the order of {what}: {min(TESTED, n)} frames of {place.shape[1]} bodies agree with kinematics "
                f"to {1e3 * far:.2g} mm and {angle:.1g} rad{other}."
            )
            unseen = [name for name in names if not links & set(robot.model.subtrees[robot.joint_id(name)])]
            if unseen and named:
                notes.append(f"no body shows the angles of {', '.join(unseen):.300}; they are in the order of their names.")
            elif unseen:
                raise InputError(
                    f"{path.name}: no body shows the angles of {', '.join(unseen)[:300]}, so their order is not confirmed. "
                    "Such a file needs the last link of every limb, or save q and t instead."
                )
            notes += left_still(robot, names)
            noise = rounding_noise(robot, steps[1], steps[2], names, unit * steps[0])
            found = Frames(robot, t, q, notes=tuple(notes), noise=noise)
            return checked_rates_of(file, found, given, names, v)
    raise InputError(
        f"{path.name}: no order of joints puts all bodies within {1e3 * NEAR:g} mm and {TURNED:g} rad of body_pos_w and "
        f"body_quat_w; the worst body by order is off by {'; '.join(f'{what}: {error}' for what, error in errors.items())}. "
        "Give joints=[...] in order, or the robot that it was made for."
    )


KINDS: Sequence[tuple[Sequence[Sequence[str]], Callable[[NamedArrays, CheckedModel, ReadSettings], Frames]]] = (
    ((("q",), ("t",)), _of_q),
    ([(name,) for name in BODIES[1:]], _of_bodies),
    ((PLACES, TURNS, JOINTS), of_base),
    ((("qpos",),), of_qpos),
)  # fmt: skip
"""(arrays that a kind of file has, each by one of some names; what makes frames of them); the first that fits is taken."""


def _own_bodies(
    file: NamedArrays, robot: CheckedModel, place: Array, turn: Array, base: int
) -> tuple[Array, Array, int, list[str]]:
    """(places, quaternions, index of the base, notes) of the bodies that are links of the robot, where the file names them."""
    names = file.texts("body_names")
    if names is None or len(names) != place.shape[1]:
        return place, turn, base, []
    own = [i for i, name in enumerate(names) if name in robot.links()]
    others = [name for i, name in enumerate(names) if i not in own]
    if not others or not own:
        return place, turn, base, []
    base = own.index(base) if base in own else 0
    note = f"bodies that {robot.name} has no links for are not read: {', '.join(others):.400}."
    return place[:, own], turn[:, own], base, [note]


def _candidates(file: NamedArrays, robot: CheckedModel, joints: Sequence[str] | None) -> dict[str, tuple[str, ...]]:
    """{what it is: joints in order} that a file can have."""
    joints = file.texts("joint_names") if joints is None else joints
    if joints is not None:
        return {"the names given": checked_joints(robot, [known_name(name, single_joints(robot)) or name for name in joints])}
    found = {"the robot's file": file_order(robot), "breadth-first search": breadth_first(robot)}
    for what, names in formats(robot).items():
        found.setdefault(what, names)
        found[f"breadth-first search, {what}"] = tuple(name for name in breadth_first(robot) if name in names)
    return found


def _orders(file: NamedArrays, robot: CheckedModel, joints: Sequence[str] | None, width: int) -> dict[str, tuple[str, ...]]:
    """{what it is: joints in order} to be tried."""
    found = _candidates(file, robot, joints)
    fitting = {what: names for what, names in found.items() if len(names) == width}
    if not fitting:
        counts = sorted({len(names) for names in found.values()})
        raise InputError(
            f"{file.path.name}: joint_pos has {width} columns; {robot.name} has {', '.join(map(str, counts))} joints."
            f"{looks_like(width)}"
        )
    return fitting


def _error(robot: CheckedModel, q: Array, place: Array, turn: Array) -> tuple[float, float, set[int]]:
    """(largest distance [m], largest angle [rad], joints) of the bodies from, and of, their nearest links in all frames."""
    model, data = robot.model, robot.model.createData()
    links = [robot.frame_id(name) for name in robot.links()]
    frames = np.unique(np.linspace(0, len(q) - 1, min(TESTED, len(q))).round().astype(int))
    X = np.empty((len(frames), len(links), 7))
    for i, at in enumerate(frames):
        pin.framesForwardKinematics(model, data, q[at])
        X[i] = [pin.SE3ToXYZQUAT(data.oMf[link]) for link in links]
    far = angle = 0.0
    joints = set[int]()
    for body in range(place.shape[1]):
        distance = np.linalg.norm(X[..., :3] - place[frames, body, None], axis=2).max(axis=0)
        # twice the sine of half the angle, from the chord of the quaternions, up to sign
        cosine = np.abs((X[..., 3:] * turn[frames, body, None]).sum(axis=2))
        turned = (2.0 * np.sqrt(np.maximum(0.0, 2.0 - 2.0 * cosine))).max(axis=0)
        best = int(np.argmin(distance / NEAR + turned / TURNED))
        far, angle = max(far, float(distance[best])), max(angle, float(turned[best]))
        joints.add(int(model.frames[links[best]].parentJoint))
    return far, angle, joints
