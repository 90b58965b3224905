"""Frames of a motion: positions of bodies, forces and marks in each picture, as JSON arrays for a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External
from rbd.model.sampled_motion import SampledPoses, flat_coordinates, from_flat, interpolated, quaternions
from rbd.model.state import State
from rbd.records import joined
from rbd.visual.marks.applied_forces import (
    PULLS,
    PUSHES,
    RELAXED,
    TURNED,
    ElementPiece,
    element_pieces,
    full_of,
    pushes,
    shown_elements,
)
from rbd.visual.marks.mark import Sizes
from rbd.visual.playback.mode_disks import OFF_GROUND, Disks
from rbd.visual.playback.shown_motion import ShownMotion, Track

PushesAt: TypeAlias = Callable[[State, float], External]

FPS = 30.0
"""Frames a second of playback if no body turns fast: the page interpolates linearly between two."""
LARGEST_TURN = 0.5
"""Largest turn of a body from one frame to the next [rad]: beyond pi the page would turn it the other way."""
MOST_FPS = 480.0
MOST_NUMBERS = 4_000_000
"""Numbers in all frames together: 16 MB."""
NEAR = 0.25
"""A sample this share of a frame's interval away is taken as the frame; else the motion is interpolated there."""
MOST_STRETCHES = 400
"""A contact that carries load farther from z = 0 touches something else [m]."""
MOST_SAMPLES_LOOKED_AT = 400


@dataclass(frozen=True, eq=False)
class PageFrames:
    """A motion as a row of pictures.

    Attributes:
        times: Shape (n,) [s], increasing; the first and the last are those of the trajectory.
        joints: Indices of the joints with moving bodies.
        poses: X_WJ of each of them: position [m] and quaternion x, y, z, w, shape (n, number of joints, 7); a quaternion
            is in the half-space of the one before.
        com: Centre of mass in W, shape (n, 3) [m]; zero frames, shape (0, 3), of a robot without mass.
        contacts: Each contact's points and forces.
        pushes: Each external force.
        elements: Each force element.
        modes: {constraint: its mode at each frame}, contacts first.
        stretches: {constraint: (from [s], to [s], mode) of each time it is in one mode}, as fine as the samples.
        left_out: What of the forces has no picture, in words.
        lifts: Pose of each piece of terrain that has a motion, and of other marks that move, shape (n, pieces, 7).
        disks: {contact: disks at its points}.
        ghost: Name of a second motion, whose poses of the same joints follow in `joints` and `poses`; empty if there is none.
    """

    times: Array
    joints: tuple[int, ...]
    poses: Array
    com: Array
    contacts: tuple[Track, ...]
    pushes: tuple[Track, ...]
    elements: tuple[ElementTrack, ...]
    modes: Mapping[str, Sequence[str]]
    stretches: Mapping[str, Sequence[tuple[float, float, str]]]
    left_out: tuple[str, ...] = ()
    lifts: Array = field(default_factory=lambda: np.zeros((0, 0, 7)))
    disks: Mapping[str, Disks] = field(default_factory=dict)
    ghost: str = ""

    @lazy
    def rows(self) -> Array:
        """All that moves, one row a frame, shape (n, width).

        Poses, of pieces of terrain too, centre of mass, then point and force of each point, then ends, axis and tension of each
        force element.
        """
        n = len(self.times)
        com = self.com if len(self.com) else np.full((n, 3), np.nan)
        tracks = [np.concatenate([t.points, t.forces], axis=2).reshape(n, -1) for t in (*self.contacts, *self.pushes)]
        poses = self.poses.reshape(n, -1), self.lifts.reshape(n, -1)
        return np.column_stack([*poses, com, *tracks, *(element.rows for element in self.elements)])


def frames_of(
    shown: ShownMotion,
    joints: Sequence[int],
    *,
    fps: float | None = None,
    speed: float = 1.0,
    external: External | PushesAt = None,
) -> PageFrames:
    """Frames of a motion, evenly in time: its samples where they are near, else interpolated.

    Joints are interpolated on their manifold, free bases straight and turning evenly, points and forces linearly; modes are
    those of the nearest sample.

    Args:
        shown: The motion.
        joints: Numbers of the joints whose poses are wanted.
        fps: Frames a second of playback at `speed`. By default 30, and more where a body turns by over half a radian
            between two.
        speed: Seconds of motion a second.
        external: The external forces of the motion, as `rbd.simulate` was given them. A trajectory knows force elements alone,
            and these only if no function of time gave others with time.

    Raises:
        InputError: if `external` is not what `rbd.simulate` takes.
    """
    times, robot, chosen = shown.t, shown.robot, fps is None and len(shown.at) > 0
    if fps is None:
        fps = min(MOST_FPS, max(FPS, _fastest_turn(shown, joints) * speed / LARGEST_TURN))
        width = 7 * len(joints) + 3 + sum(6 * np.shape(p)[1] for p in shown.points.values())
        fps = min(fps, max(1.0, MOST_NUMBERS / width * speed / (times[-1] - times[0])))
    at = shown.at if chosen else frame_times(times, speed / fps)
    low, share = _between(times, at)
    q = configurations(shown, low, share)
    poses, com = body_poses(robot, q, joints)
    contacts = tuple(
        Track(name, _blend(points, low, share), _blend(shown.point_forces[name], low, share))
        for name, points in shown.points.items()
    )
    nearest = np.where(share < 0.5, low, low + 1)
    ordered = [*shown.points, *(name for name in shown.modes if name not in shown.points)]
    unknown = [""] * len(times)
    given = {name: [str(mode) for mode in shown.modes.get(name, unknown)] for name in ordered}
    modes = {name: [words[i] for i in nearest] for name, words in given.items()}
    stretches = {name: _stretches(times, words) for name, words in given.items()}
    for name in ordered:  # chatter is listed as coarsely as it is shown
        if len(stretches[name]) > MOST_STRETCHES:
            stretches[name] = _stretches(at, modes[name])
    v = _blend(np.asarray(shown.v, float)[:, None], low, share)[:, 0]
    acting = getattr(shown.source, "elements", ()) if external is None else external
    pushes, elements, left_out = _applied(robot, q, v, at, acting)
    pushes += [replace(t, points=_blend(t.points, low, share), forces=_blend(t.forces, low, share)) for t in shown.pushes]
    left_out += _unknown_elements(shown.source) if external is None else []
    disks = {name: d.at(nearest) for name, d in shown.disks.items()}
    words = (*shown.notes, *left_out, *_without_points(shown), *_without_surfaces(shown))
    moved = [solid for terrain in shown.terrains for solid in terrain.pieces if solid.moved is not None]
    lifts = np.zeros((len(at), len(moved), 7))
    lifts[:, :, 6] = 1.0
    for i, piece in enumerate(moved):
        lifts[:, i, :3] = [piece.shift(t) for t in at.tolist()]
    forces = contacts, tuple(pushes), tuple(elements)
    return PageFrames(at, tuple(joints), poses, com, *forces, modes, stretches, words, lifts, disks)


def _unknown_elements(trajectory: Any) -> list[str]:
    """That force elements acted which the motion does not know, in words: its energies tell."""
    acted = any(np.any(getattr(trajectory, name, 0.0)) for name in ("elastic", "dissipated"))
    if not acted or len(getattr(trajectory, "elements", ())):
        return []
    return ["Not drawn: springs or dampers that acted, which the motion does not know. Give them as external=[...]."]


def _without_points(shown: ShownMotion) -> list[str]:
    """Which constraints carry forces that a motion does not show, in words: their points are not recorded."""
    forces = getattr(shown.source, "forces", {})
    named = forces if isinstance(forces, Mapping) else {}
    names = [name for name, f in named.items() if name not in shown.points and np.any(f)]
    return [f"Not drawn: the forces of {joined(names)}."] if names else []


def _without_surfaces(shown: ShownMotion) -> list[str]:
    """Which contacts carry load where no ground is drawn, in words: on other bodies, and on planes that are not known."""
    loaded = {name: np.linalg.norm(f, axis=-1) > 0.0 for name, f in shown.point_forces.items()}
    heights = {name: np.where(loaded[name], np.asarray(points)[..., 2], 0.0) for name, points in shown.points.items()}
    for terrain in shown.terrains:
        for name, points in shown.points.items():
            at = loaded[name] & (np.abs(heights[name]) > OFF_GROUND)
            heights[name][at] = 0.0 if terrain.jump is not None else terrain.distances(np.asarray(points)[at])
    for surface in shown.surfaces:
        for name, points in shown.points.items():
            off = np.abs((np.nan_to_num(points) - surface.point) @ surface.normal)
            heights[name][loaded[name] & (off <= OFF_GROUND)] = 0.0
    names = [name for name, height in heights.items() if (np.abs(height) > OFF_GROUND).any()]
    return [f"Surfaces off the ground z = 0 are not drawn; there: {joined(names)}."] if names else []


def frame_times(times: Array, interval: float) -> Array:
    """Times of frames about `interval` [s] apart from the first to the last of the samples' times, on samples where near."""
    first, last = float(times[0]), float(times[-1])
    even = np.linspace(first, last, max(1, round((last - first) / interval)) + 1)
    right = np.clip(np.searchsorted(times, even), 1, len(times) - 1)
    near = np.where(even - times[right - 1] <= times[right] - even, times[right - 1], times[right])
    return np.unique(np.where(np.abs(near - even) <= NEAR * interval, near, even))


def _stretches(times: Array, modes: Sequence[str]) -> list[tuple[float, float, str]]:
    """(from, to, mode) of each run of equal modes; a sample's mode applies until the next one."""
    edges = [0, *(i for i in range(1, len(modes)) if modes[i] != modes[i - 1]), len(modes) - 1]
    return [(float(times[a]), float(times[b]), modes[a]) for a, b in zip(edges, edges[1:], strict=False) if b > a]


def _blend(values: Array, low: Array, share: Array) -> Array:
    """Between two samples linearly; if one of them does not exist, the other."""
    values = np.asarray(values, float)
    before, after, w = values[low], values[low + 1], share[:, None, None]
    blended = np.where(w == 0.0, before, np.where(w == 1.0, after, (1.0 - w) * before + w * after))
    nearer = np.where(w < 0.5, before, after)
    return np.where(np.isfinite(blended), blended, nearer)


def _fastest_turn(shown: ShownMotion, joints: Sequence[int]) -> float:
    """Largest angular velocity of a body [rad/s], at some hundred samples."""
    model, data = shown.robot.model, shown.robot.model.createData()
    fastest = 0.0
    for i in np.unique(np.linspace(0, len(shown.t) - 1, MOST_SAMPLES_LOOKED_AT).astype(int)):
        pin.forwardKinematics(model, data, np.array(shown.q[i], float), np.array(shown.v[i], float))
        fastest = max([fastest, *(float(np.linalg.norm(data.v[j].angular)) for j in joints)])
    return fastest


def _applied(
    robot: CheckedModel, q: Array, v: Array, times: Array, external: Any
) -> tuple[list[Track], list[ElementTrack], list[str]]:
    """(pushes, force elements at every frame, what of them is not drawn); one that is not given at some times is zero then.

    Args:
        robot: The robot.
        q: Configuration of each frame.
        v: Velocity of each frame, shape (n, nv).
        times: Their times [s].
        external: As `rbd.simulate` was given it: constant, or a function of state and time.
    """
    if external is None or (isinstance(external, tuple) and not external):
        return [], [], []
    n = len(times)
    pushed: dict[tuple[str, int], Track] = {}
    elements: dict[str, ElementTrack] = {}
    words: dict[str, None] = {}
    for i in range(n):
        state = State(robot, q[i], v[i])
        given = external(state, float(times[i])) if callable(external) else external
        drawn, generalised = pushes(state, given)
        shown, unseen = shown_elements(state, given)
        words |= dict.fromkeys([*([GENERALISED] if generalised else []), *unseen])
        words |= dict.fromkeys([MOMENTS for push in drawn if push.moment.any()])
        for k, push in enumerate(drawn):
            same = sum(one.name == push.name for one in drawn[:k])
            nowhere = Track(push.name, np.full((n, 1, 3), np.nan), np.zeros((n, 1, 3)))
            track = pushed.setdefault((push.name, same), nowhere)
            track.points[i, 0], track.forces[i, 0] = push.start, push.force
        for one in shown:
            rest = ElementTrack(one.name, one.shape, one.unit, np.full((n, 2, 3), np.nan), np.zeros((n, 3)), np.zeros(n))
            acts = elements.setdefault(one.name, rest)
            acts.points[i], acts.axis[i], acts.tension[i] = one.points, one.axis, one.tension
    return list(pushed.values()), list(elements.values()), list(words)


def _between(times: Array, at: Array) -> tuple[Array, Array]:
    """(sample before, share of the way to the next) of each of some times; those outside are at the first or the last."""
    low = np.clip(np.searchsorted(times, at, side="right") - 1, 0, max(0, len(times) - 2))
    step = np.append(np.diff(times), np.inf)[low]
    return low, np.clip((at - times[low]) / step, 0.0, 1.0)


def configurations(motion: SampledPoses, low: Array, share: Array) -> Array:
    """Between each sample `low` and the next: joints on their manifold, bodies straight and turning evenly, shape (n, nq)."""
    robot, q = motion.robot, np.asarray(motion.q, float)
    x, after, w = flat_coordinates(robot, q), np.minimum(low + 1, len(q) - 1), share[:, None]
    turns = [interpolated(q[low][:, at], q[after][:, at], share) for at, _ in quaternions(robot)]
    return from_flat(robot, (1.0 - w) * x[low] + w * x[after], turns)


def body_poses(robot: CheckedModel, q: Array, joints: Sequence[int]) -> tuple[Array, Array]:
    """(X_WJ of joints as position and quaternion, shape (n, k, 7); centre of mass, (n, 3), or (0, 3) of a robot without mass).

    A quaternion is in the half-space of the one before.
    """
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


def checked_ghost(ghost: Any, robot: CheckedModel) -> SampledPoses:
    """A motion that can be drawn beside one of a robot.

    Raises:
        InputError: no motion, one of another robot, or one without samples.
    """
    if not all(hasattr(ghost, name) for name in ("robot", "t", "q")) or not isinstance(ghost.robot, CheckedModel):
        raise InputError(f"ghost is {ghost!r:.80}; expected an rbd.Motion, or what rbd.simulate returned.")
    if ghost.robot.nq != robot.nq or list(ghost.robot.model.names) != list(robot.model.names):
        raise InputError(f"ghost is a motion of {ghost.robot.name}, shown beside one of {robot.name}; expected the same robot.")
    if not len(ghost.t) or not np.isfinite(ghost.q).all():
        raise InputError("ghost has no samples, or its q is not finite.")
    return ghost


def ghost_poses(ghost: SampledPoses, times: Array, joints: Sequence[int], down: float) -> Array:
    """Its poses at the times of another motion; before its first sample and after its last as these are, shape (n, k, 7).

    Args:
        ghost: The motion.
        times: Shape (n,) [s].
        joints: Of the poses.
        down: By how much it is lowered [m].
    """
    q = configurations(ghost, *_between(np.asarray(ghost.t, float), times))
    return body_poses(ghost.robot, q, joints)[0] - [0.0, 0.0, down, 0.0, 0.0, 0.0, 0.0]


GENERALISED = "The generalised external force is not drawn: it has no point of application."
MOMENTS = "Moments of pushes are not drawn."
ELEMENT_COLORS = "Springs and dampers: orange where they pull, blue where they push."


@dataclass(frozen=True, eq=False)
class ElementTrack:
    """A force element over time.

    Attributes:
        name: Its name.
        shape: As of `ShownElement`.
        unit: Of its tension, "N" or "N m".
        points: Its ends in W, shape (n, 2, 3) [m]; NaN where it does not act.
        axis: In W, shape (n, 3); zero of what does not turn.
        tension: Positive where it pulls, shape (n,).
    """

    name: str
    shape: str
    unit: str
    points: Array
    axis: Array
    tension: Array

    @property
    def rows(self) -> Array:
        """One row a frame: both ends, the axis, the tension, shape (n, 10)."""
        return np.column_stack([self.points.reshape(len(self.tension), 6), self.axis, self.tension])


def pieces_of(track: ElementTrack, sizes: Sizes) -> list[ElementPiece]:
    """What is drawn of a force element, of its usual length."""
    lengths = np.linalg.norm(track.points[:, 1] - track.points[:, 0], axis=1)
    known = lengths[np.isfinite(lengths)]
    return element_pieces(track.shape, float(np.median(known)) if len(known) else 0.0, sizes)


def element_look(track: ElementTrack, path: str, sizes: Sizes) -> dict[str, object]:
    """What a page needs to draw a force element, besides where it is: the path of its pieces, and their rules and colours."""
    pieces = [{"start": x.start, "stretched": x.stretched, "opacity": x.opacity} for x in pieces_of(track, sizes)]
    look = {"name": track.name, "shape": track.shape, "unit": track.unit, "turned": track.shape in TURNED}
    return look | {"path": path, "pieces": pieces, "full": full_of(track.unit, sizes), "colors": [RELAXED, PULLS, PUSHES]}
