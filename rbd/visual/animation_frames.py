"""Frames of a motion: where every body, force and mark is at each picture, as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.robots.robot import Robot
from rbd.visual.forces import Push, pushes

if TYPE_CHECKING:
    from rbd.simulation.trajectory import Trajectory

Pushes: TypeAlias = Iterable[Push] | Push | None
PushesAt: TypeAlias = Callable[[State, float], Pushes]

FPS = 30.0
"""Frames a second of playback where nothing turns fast: between two the page goes the straight way."""
LARGEST_TURN = 0.5
"""Largest turn of a body from one frame to the next [rad]: beyond pi the page would turn it the other way."""
MOST_FPS = 480.0
MOST_NUMBERS = 4_000_000
"""Numbers in all frames together: 16 MB."""
NEAR = 0.25
"""A sample this share of a frame's interval away is taken as the frame; else the motion is interpolated there."""
MOST_STRETCHES = 400
MOST_SAMPLES_LOOKED_AT = 400
OPEN = "open"
WANTED = ("robot", "times", "q", "v", "points", "point_forces", "modes", "events")


@dataclass(frozen=True, eq=False)
class Track:
    """Forces at some points over time.

    Attributes:
        name: Of the contact, or of the frame that is pushed.
        points: In W, shape (n, k, 3) [m]; NaN where there is no such point at that time.
        forces: On the robot, in W, shape (n, k, 3) [N]; zero where nothing touches.
    """

    name: str
    points: Array
    forces: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "forces", np.nan_to_num(self.forces, nan=0.0, posinf=0.0, neginf=0.0))


@dataclass(frozen=True, eq=False)
class Frames:
    """A motion as a row of pictures.

    Attributes:
        times: Shape (n,) [s], increasing; the first and the last are those of the trajectory.
        joints: Numbers of the joints that carry something that moves.
        poses: X_WJ of each of them: position [m] and quaternion x, y, z, w, shape (n, number of joints, 7); a quaternion
            lies in the half-space of the one before.
        com: Centre of mass in W, shape (n, 3) [m]; zero frames, shape (0, 3), of a robot without mass.
        contacts: Each contact's points and forces.
        pushes: Each external force.
        modes: {constraint: its mode at each frame}, contacts first.
        stretches: {constraint: (from [s], to [s], mode) of each time it is in one mode}, as fine as the samples.
    """

    times: Array
    joints: tuple[int, ...]
    poses: Array
    com: Array
    contacts: tuple[Track, ...]
    pushes: tuple[Track, ...]
    modes: Mapping[str, Sequence[str]]
    stretches: Mapping[str, Sequence[tuple[float, float, str]]]

    def rows(self) -> Array:
        """All that moves, one row a frame: poses, centre of mass, then point and force of each point, shape (n, width)."""
        n = len(self.times)
        com = self.com if len(self.com) else np.full((n, 3), np.nan)
        tracks = [np.concatenate([t.points, t.forces], axis=2).reshape(n, -1) for t in (*self.contacts, *self.pushes)]
        return np.column_stack([self.poses.reshape(n, -1), com, *tracks])


def checked(trajectory: object) -> Trajectory:
    """A trajectory that can be shown.

    Raises:
        InputError: if it is none, has fewer than two samples, or its times do not increase.
    """
    missing = [name for name in WANTED if not hasattr(trajectory, name)]
    if missing or not isinstance(getattr(trajectory, "robot", None), CheckedModel):
        raise InputError(f"{trajectory!r:.80} is no trajectory; expected what rbd.simulate returned.")
    shown: Trajectory = trajectory  # type: ignore[assignment]
    n = len(shown.times)
    if n < 2:
        some = "no sample" if n == 0 else "one sample only"
        raise InputError(f"the trajectory has {some}; a motion wants two. Show a single state with rbd.visual.Scene.")
    if not np.all(np.isfinite(shown.times)) or np.min(np.diff(shown.times)) <= 0.0:
        raise InputError("the times of the trajectory do not increase; expected those that rbd.simulate gave.")
    finite = np.isfinite(shown.q).all(axis=1)
    if not finite.all():
        i = int(np.argmin(finite))
        raise InputError(f"q is not finite at {shown.times[i]:.6g} s; show what is before it: trajectory[:{i}].")
    return shown


def robot_of(trajectory: Trajectory) -> Robot:
    """The trajectory's robot, with its meshes."""
    robot = trajectory.robot
    if not isinstance(robot, Robot):
        raise InputError(f"{robot.name!r} has no meshes: it is a bare model. Load the robot with rbd.load_robot.")
    return robot


def positive(what: str, value: object, most: float, unit: str) -> float:
    """A finite number above zero, `most` at most.

    Raises:
        InputError: if it is not.
    """
    number = as_float(value)
    if not 0.0 < number <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a number above 0, at most {most:g}{unit}.")
    return number


def frames_of(
    trajectory: Trajectory,
    joints: Sequence[int],
    *,
    fps: float | None = None,
    speed: float = 1.0,
    external: Pushes | PushesAt = None,
) -> Frames:
    """Frames of a trajectory, evenly in time: its own samples where they are near, else interpolated.

    Joints are interpolated on their manifold, free bases straight and turning evenly, points and forces linearly; modes are
    those of the nearest sample.

    Args:
        trajectory: As `checked` passed it.
        joints: Numbers of the joints whose poses are wanted.
        fps: Frames a second of playback at `speed`. By default 30, and more where a body turns by over half a radian
            between two.
        speed: Seconds of motion a second.
        external: The external forces of the motion, as `rbd.simulate` was given them: not known to a trajectory.

    Raises:
        InputError: if `external` holds anything but forces at frames.
    """
    times = np.asarray(trajectory.times, float)
    if fps is None:
        fps = min(MOST_FPS, max(FPS, _fastest_turn(trajectory, joints) * speed / LARGEST_TURN))
        width = 7 * len(joints) + 3 + sum(6 * np.shape(p)[1] for p in trajectory.points.values())
        fps = min(fps, max(1.0, MOST_NUMBERS / width * speed / (times[-1] - times[0])))
    at = frame_times(times, speed / fps)
    low = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    share = np.clip((at - times[low]) / (times[low + 1] - times[low]), 0.0, 1.0)
    q = [_between(trajectory, int(i), float(w)) for i, w in zip(low, share, strict=True)]
    poses, com = _kinematics(trajectory.robot, q, joints)
    contacts = tuple(
        Track(name, _blend(points, low, share), _blend(trajectory.point_forces[name], low, share))
        for name, points in trajectory.points.items()
    )
    nearest = np.where(share < 0.5, low, low + 1)
    ordered = [*trajectory.points, *(name for name in trajectory.modes if name not in trajectory.points)]
    unknown = [""] * len(times)
    given = {name: [str(mode) for mode in trajectory.modes.get(name, unknown)] for name in ordered}
    modes = {name: [words[i] for i in nearest] for name, words in given.items()}
    stretches = {name: _stretches(times, words) for name, words in given.items()}
    for name in ordered:  # what chatters is told as coarsely as it is shown
        if len(stretches[name]) > MOST_STRETCHES:
            stretches[name] = _stretches(at, modes[name])
    pushed = _pushed(trajectory.robot, q, at, external)
    return Frames(at, tuple(joints), poses, com, contacts, pushed, modes, stretches)


def frame_times(times: Array, interval: float) -> Array:
    """Times of frames about `interval` [s] apart from the first to the last of the samples' times, on samples where near."""
    first, last = float(times[0]), float(times[-1])
    even = np.linspace(first, last, max(1, round((last - first) / interval)) + 1)
    right = np.clip(np.searchsorted(times, even), 1, len(times) - 1)
    near = np.where(even - times[right - 1] <= times[right] - even, times[right - 1], times[right])
    return np.unique(np.where(np.abs(near - even) <= NEAR * interval, near, even))


def _stretches(times: Array, modes: Sequence[str]) -> list[tuple[float, float, str]]:
    """(from, to, mode) of each run of equal modes; a sample's mode holds until the next one."""
    edges = [0, *(i for i in range(1, len(modes)) if modes[i] != modes[i - 1]), len(modes) - 1]
    return [(float(times[a]), float(times[b]), modes[a]) for a, b in zip(edges, edges[1:], strict=False) if b > a]


def _between(trajectory: Trajectory, i: int, share: float) -> Array:
    q = trajectory.q
    if share in (0.0, 1.0):
        return np.array(q[i + int(share)], float)
    model, before, after = trajectory.robot.model, np.array(q[i], float), np.array(q[i + 1], float)
    between = np.array(pin.interpolate(model, before, after, share))
    # Pinocchio takes a free base along a screw, in a bow that grows with its turn; what flies goes nearly straight.
    for joint in model.joints:
        if joint.shortname() == "JointModelFreeFlyer":
            at = slice(joint.idx_q, joint.idx_q + 3)
            between[at] = (1.0 - share) * before[at] + share * after[at]
    return between


def _blend(values: Array, low: Array, share: Array) -> Array:
    """Between two samples linearly; where one of them is not there, the other."""
    values = np.asarray(values, float)
    before, after, w = values[low], values[low + 1], share[:, None, None]
    blended = np.where(w == 0.0, before, np.where(w == 1.0, after, (1.0 - w) * before + w * after))
    nearer = np.where(w < 0.5, before, after)
    return np.where(np.isfinite(blended), blended, nearer)


def _kinematics(robot: CheckedModel, q: Sequence[Array], joints: Sequence[int]) -> tuple[Array, Array]:
    model, data = robot.model, robot.model.createData()
    poses, com = np.zeros((len(q), len(joints), 7)), np.zeros((len(q), 3))
    for i, q_i in enumerate(q):
        com[i] = pin.centerOfMass(model, data, q_i) if robot.mass > 0.0 else np.nan
        if robot.mass <= 0.0:
            pin.forwardKinematics(model, data, q_i)
        for j, joint in enumerate(joints):
            poses[i, j] = pin.SE3ToXYZQUAT(data.oMi[joint])
    if len(joints):
        back = np.einsum("ijk,ijk->ij", poses[1:, :, 3:], poses[:-1, :, 3:]) < 0.0
        signs = np.cumprod(np.where(back, -1.0, 1.0), axis=0)
        poses[1:, :, 3:] *= signs[:, :, None]
    return poses, com if np.isfinite(com).all() else np.zeros((0, 3))


def _fastest_turn(trajectory: Trajectory, joints: Sequence[int]) -> float:
    """Largest angular velocity of a body [rad/s], at some hundred samples."""
    model, data = trajectory.robot.model, trajectory.robot.model.createData()
    fastest = 0.0
    for i in np.unique(np.linspace(0, len(trajectory.times) - 1, MOST_SAMPLES_LOOKED_AT).astype(int)):
        pin.forwardKinematics(model, data, np.array(trajectory.q[i], float), np.array(trajectory.v[i], float))
        fastest = max([fastest, *(float(np.linalg.norm(data.v[j].angular)) for j in joints)])
    return fastest


def _pushed(robot: CheckedModel, q: Sequence[Array], times: Array, external: Pushes | PushesAt) -> tuple[Track, ...]:
    """External forces at every frame; one that is not given at some times is zero then."""
    if external is None:
        return ()
    found: dict[tuple[str, int], list[tuple[int, Array, Array]]] = {}
    for i, (q_i, t) in enumerate(zip(q, times, strict=True)):
        state = State(robot, q_i)
        given = external(state, float(t)) if callable(external) else external
        count: dict[str, int] = {}
        for name, point, force in pushes(state, given):
            count[name] = number = count.get(name, 0) + 1
            found.setdefault((name, number), []).append((i, point, force))
    tracks = []
    for (name, _), seen in found.items():
        points, forces = np.full((len(q), 1, 3), np.nan), np.zeros((len(q), 1, 3))
        for i, point, force in seen:
            points[i, 0], forces[i, 0] = point, force
        tracks.append(Track(name, points, forces))
    return tuple(tracks)
