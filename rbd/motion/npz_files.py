"""Motions in .npz: of `Motion.save`, of q and t, and of bodies over time, whose joint order is verified by kinematics."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel, with_plain_motors
from rbd.motion.derivation import NEARLY_UNIT, Derivation, Method
from rbd.motion.file_conventions import breadth_first, checked_joints, chosen_order, file_order, formats, left_still, standing_q
from rbd.motion.file_frames import Frames, check_rate, check_same_rate, counts_frames, joint_positions, unit_of
from rbd.robots.loading import load_robot
from rbd.robots.travelling import given_texts
from rbd.simulation.trajectory_file import npz_arrays

NEAR, TURNED = 1e-3, 5e-3
"""How far a body may be from where kinematics puts it: a millimetre, and an angle [rad] that four decimals leave."""
ROUNDED = 1e-6
"""Norms off by less, as numbers of single precision are, are not told."""
PROVED = 500
"""Number of frames, evenly spread, on which an order of joints is tested."""
BODIES = ("fps", "joint_pos", "body_pos_w", "body_quat_w")


def of_npz(
    path: Path,
    robot: CheckedModel | None,
    rate: float | None,
    quaternion: str | None,
    joints: Sequence[str] | None,
    units: str | None,
    trust: bool,
) -> Frames:
    """The frames of an .npz, by what it holds.

    Raises:
        InputError: nothing known; sizes that do not fit; an order of joints that kinematics does not prove.
    """
    arrays = npz_arrays(path)
    if robot is None:
        if "robot" not in arrays:
            raise InputError(f"{path.name} does not name its robot; give it: robot='g1'.")
        texts = given_texts({key: _text(arrays, key) for key in ("text", "loop_file") if key in arrays})
        robot = load_robot(_text(arrays, "robot")) if texts is None else load_robot(**texts)
        if "motors" in arrays:
            robot = with_plain_motors(robot, _motors(path, _text(arrays, "motors")))
    for name, x in arrays.items():
        if x.dtype.kind != "U" and not np.isfinite(x).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(x))[0])
            raise InputError(f"{path.name}: {name}{list(where)} is {x[where]}; expected a finite number.")
    if {"q", "t"} <= set(arrays):
        return _of_q(path, robot, arrays, rate, quaternion, trust)
    if set(BODIES[1:]) <= set(arrays):
        return _of_bodies(path, robot, arrays, rate, quaternion, joints, units)
    raise InputError(
        f"{path.name} holds {', '.join(sorted(arrays))[:200] or 'nothing'}; expected q and t, or {', '.join(BODIES)}, "
        "or what Motion.save or Trajectory.save writes."
    )


def _of_q(
    path: Path, robot: CheckedModel, arrays: dict[str, Array], rate: float | None, quaternion: str | None, trust: bool
) -> Frames:
    names = [c.name for c in robot.joints.positions]
    if "coordinates" in arrays and [str(n) for n in arrays["coordinates"].ravel()] != names:
        own = [str(n) for n in arrays["coordinates"].ravel()]
        odd = next((n for n in own if n not in names), None) or next((n for n in names if n not in own), "their order")
        raise InputError(f"{path.name} holds a motion of another robot than {robot.name}: they differ in {odd!r:.80}.")
    t, q = _numbers(path, arrays, "t"), _numbers(path, arrays, "q")
    for what, x, shape in (("t", t, (len(t),)), ("q", q, (len(t), robot.nq))):
        if x.shape != shape:
            raise InputError(f"{path.name}: {what} has shape {x.shape}; expected {shape} for {robot.name}.")
    v, a = (_numbers(path, arrays, name) if name in arrays else None for name in ("v", "a"))
    notes = tuple(str(note) for note in arrays["notes"].ravel()) if arrays.get("notes", q).dtype.kind == "U" else ()
    how = None
    if "derivation" in arrays and v is not None and a is not None:
        try:
            window, order, cutoff = (float(x) for x in _numbers(path, arrays, "derivation"))
            noise = [_numbers(path, arrays, f"noise_{x}") for x in "qva"]
            if any(x.shape != (robot.nv,) for x in noise):
                raise ValueError
            method: Method = "low-pass" if _text(arrays, "method") == "low-pass" else "local polynomial"
            how = Derivation(method, window, int(order), cutoff, *noise)
        except (ValueError, KeyError):
            raise InputError(f"{path.name}: what it says of how v and a came from q cannot be read. Leave it out.") from None
    ground = float(_numbers(path, arrays, "ground").ravel()[0]) if arrays.get("ground", np.empty(0)).size == 1 else 0.0
    rounding = _rounding(robot, arrays["q"][:, :3], arrays["q"][:, 3:7], arrays["q"])
    saved = "coordinates" in arrays  # by Motion.save
    if counts_frames(t) and not saved and not trust:
        if rate is None:
            raise InputError(
                f"{path.name}: t is {t[0]:g}, {t[1]:g}, {t[2]:g}, ...: these count frames. Give rate=30 [Hz], or whatever "
                "it is."
            )
        notes = (*notes, f"t counts frames, from {t[0]:g} to {t[-1]:g}; times are those of the rate.")
        t = (t - t[0]) / rate
    elif rate is not None and len(t) > 1 and t[-1] > t[0]:
        check_same_rate(rate, (len(t) - 1) / float(t[-1] - t[0]), f"the times in {path.name} have")
    turns = quaternion or ("xyzw" if saved else None)
    return Frames(robot, t, q, v, a, how, notes, rounding, ground, turns)


def _of_bodies(
    path: Path,
    robot: CheckedModel,
    arrays: dict[str, Array],
    rate: float | None,
    quaternion: str | None,
    joints: Sequence[str] | None,
    units: str | None,
) -> Frames:
    x, place, turn = (_numbers(path, arrays, name) for name in BODIES[1:])
    n = len(x)
    if (
        x.ndim != 2
        or place.ndim != 3
        or place.shape[0] != n
        or place.shape[2] != 3
        or turn.shape != (*place.shape[:2], 4)
        or not n
    ):
        raise InputError(
            f"{path.name}: joint_pos {x.shape}, body_pos_w {place.shape}, body_quat_w {turn.shape}; "
            "expected (n, joints), (n, bodies, 3), (n, bodies, 4)."
        )
    if not robot.floating or not place.shape[1]:
        raise InputError(f"{path.name} holds bodies in the world, the base first; {robot.name} has no floating base.")
    notes: list[str] = []
    if "fps" in arrays:
        own = check_rate(float(_numbers(path, arrays, "fps").ravel()[0]), f"fps in {path.name}")
        check_same_rate(rate, own, f"fps in {path.name} is")
        rate = own
    if rate is None:
        raise InputError(f"{path.name} has no fps; give rate=50 [Hz], or whatever it is.")
    flat = turn.reshape(-1, 4)
    norm = np.linalg.norm(flat, axis=1)
    if not (np.abs(norm - 1.0) <= NEARLY_UNIT).all():
        i = int(np.argmax(~(np.abs(norm - 1.0) <= NEARLY_UNIT)))
        frame, body = divmod(i, turn.shape[1])
        raise InputError(f"{path.name}: body_quat_w[{frame}, {body}] has norm {norm[i]:.6g}; expected 1 to {NEARLY_UNIT:g}.")
    turn = (flat / norm[:, None]).reshape(turn.shape)
    off = float(np.abs(norm - 1.0).max())
    if off > ROUNDED:
        notes.append(f"quaternions in body_quat_w were normalised: off by up to {off:.1g}.")
    base, told = chosen_order(robot, turn[:, 0], quaternion or "wxyz", path.name)
    turn = turn if quaternion == "xyzw" else turn[:, :, [1, 2, 3, 0]]
    notes += told
    orders = _orders(path, robot, arrays, joints, x.shape[1])
    errors = {}
    for what, names in orders.items():
        q = np.tile(standing_q(robot), (n, 1))
        q[:, :3], q[:, 3:7] = place[:, 0], base
        joint_positions(robot, q, names, x * unit_of(robot, names, x, units, path.name))
        *error, links = _error(robot, q, place, turn)
        errors[what] = error
        if error[0] <= NEAR and error[1] <= TURNED:
            least = min(PROVED, n)
            notes.append(
                f"joints are in the order of {what}: {least} frames of {place.shape[1]} bodies agree with kinematics to "
                f"{1e3 * error[0]:.2g} mm and {error[1]:.1g} rad."
            )
            notes += left_still(robot, names)
            unseen = _unseen(robot, names, links)
            if unseen:
                raise InputError(
                    f"{path.name}: no body shows the angles of {', '.join(unseen)[:300]}, so their order is not proved. "
                    "Such a file needs the last link of every limb, or save q and t instead."
                )
            noise = _rounding(robot, arrays["body_pos_w"][:, 0], arrays["body_quat_w"][:, 0], arrays["joint_pos"])
            return Frames(robot, np.arange(n) / rate, q, notes=tuple(notes), noise=noise)
    told_errors = "; ".join(f"{what}: {1e3 * e[0]:.3g} mm, {e[1]:.2g} rad" for what, e in errors.items())
    raise InputError(
        f"{path.name}: no order of joints puts all bodies within {1e3 * NEAR:g} mm and {TURNED:g} rad of body_pos_w and "
        f"body_quat_w; the worst body by order is off by {told_errors}. "
        "Give joints=[...] in order, or the robot that it was made for."
    )


def _orders(
    path: Path, robot: CheckedModel, arrays: dict[str, Array], joints: Sequence[str] | None, width: int
) -> dict[str, tuple[str, ...]]:
    """{what it is: joints in order} to be tried."""
    if joints is None and arrays.get("joint_names", np.empty(0)).dtype.kind == "U":
        joints = [str(name) for name in arrays["joint_names"].ravel()]
    if joints is not None:
        found = {"the names given": checked_joints(robot, joints)}
    else:
        found = {"the robot's file": file_order(robot), "breadth-first search": breadth_first(robot)}
        for what, names in formats(robot).items():
            found.setdefault(what, names)
            found[f"breadth-first search, {what}"] = tuple(name for name in breadth_first(robot) if name in names)
    fitting = {what: names for what, names in found.items() if len(names) == width}
    if not fitting:
        counts = sorted({len(names) for names in found.values()})
        raise InputError(f"{path.name}: joint_pos has {width} columns; {robot.name} has {', '.join(map(str, counts))} joints.")
    return fitting


def _unseen(robot: CheckedModel, names: Sequence[str], shown: set[int]) -> list[str]:
    """Joints that neither move nor carry a joint of the set of those shown."""
    ids = {name: robot.joint_id(name) for name in names}
    return [name for name, i in ids.items() if not shown & set(robot.model.subtrees[i])]


def _rounding(robot: CheckedModel, place: Array, turn: Array, joints: Array) -> Array:
    """Standard deviation of q that numbers of single precision leave along each velocity, shape (nv,); of double, zero."""
    noise = np.zeros(robot.nv)
    for part, own, factor in ((slice(6, None), joints, 1.0), (slice(0, 3), place, 1.0), (slice(3, 6), turn, 2.0)):
        if own.dtype == np.float32 and own.size and (robot.floating or part.start == 6):
            last = float(np.spacing(np.float32(max(1.0, np.abs(own).max()))))
            noise[part if robot.floating else slice(None)] = factor * last / np.sqrt(12.0)
    return noise


def _error(robot: CheckedModel, q: Array, place: Array, turn: Array) -> tuple[float, float, set[int]]:
    """(largest distance [m], largest angle [rad], joints) of the bodies from, and of, their nearest links in all frames."""
    model, data = robot.model, robot.model.createData()
    links = [robot.frame_id(name) for name in robot.links()]
    frames = np.unique(np.linspace(0, len(q) - 1, min(PROVED, len(q))).round().astype(int))
    p, x = np.empty((len(frames), len(links), 3)), np.empty((len(frames), len(links), 4))
    for i, at in enumerate(frames):
        pin.framesForwardKinematics(model, data, q[at])
        for k, link in enumerate(links):
            X = pin.SE3ToXYZQUAT(data.oMf[link])
            p[i, k], x[i, k] = X[:3], X[3:]
    far = angle = 0.0
    joints = set[int]()
    for body in range(place.shape[1]):
        distance = np.linalg.norm(p - place[frames, body, None], axis=2).max(axis=0)
        # twice the sine of half the angle, from the chord of the quaternions, up to sign
        cosine = np.abs((x * turn[frames, body, None]).sum(axis=2))
        turned = (2.0 * np.sqrt(np.maximum(0.0, 2.0 - 2.0 * cosine))).max(axis=0)
        best = int(np.argmin(distance / NEAR + turned / TURNED))
        far, angle = max(far, float(distance[best])), max(angle, float(turned[best]))
        joints.add(int(model.frames[links[best]].parentJoint))
    return far, angle, joints


def _numbers(path: Path, arrays: dict[str, Array], name: str) -> Array:
    x = arrays[name]
    if x.dtype.kind == "U":
        raise InputError(f"{path.name}: {name} is text; expected numbers.")
    return np.atleast_1d(x.astype(float))


def _motors(path: Path, text: str) -> object:
    """The motors of `rbd.model.motors.plain_motors`.

    Raises:
        InputError: the text is no JSON.
    """
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(f"{path.name}: motors is {text!r:.80}; expected JSON, as Motion.save writes it.") from None


def _text(arrays: dict[str, Array], name: str) -> str:
    x = arrays.get(name, np.array(""))
    return str(x.ravel()[0]) if x.size else ""
