"""Frames of a motion: positions of bodies, forces and marks in each picture, as JSON for a page."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.motion import OPEN, Event
from rbd.visual.marks.external_forces import Push, pushes
from rbd.visual.marks.legend import scale_note
from rbd.visual.marks.mark import Sizes
from rbd.visual.playback.posed_bodies import body_poses, checked_ghost, configuration_between, ghost_poses
from rbd.visual.robot_meshes import RobotPart, hull_of
from rbd.visual.shapes import outermost
from rbd.visual.style import COM_COLOR, GHOST_COLOR, PUSH_COLOR, contact_colors

if TYPE_CHECKING:
    from rbd.simulation.trajectory import Trajectory

Pushes: TypeAlias = Iterable[Push] | Push | None
PushesAt: TypeAlias = Callable[[State, float], Pushes]

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
MOST_SAMPLES_LOOKED_AT = 400
LONGEST_ARROW = 0.8
"""Longest arrow in sizes of the robot: the arrow of an impact of a millisecond would leave the picture."""
LONGEST_WEIGHT = 1.5
"""Arrows of up to so many weights are not cut."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)
BINS = 100
"""Marks along the bar: events of one contact in the same hundredth of it share one."""
MOST_WORDS = 8
"""Events named by one mark; of more, the first ones and how many there are."""
EVENT_KINDS = ("touches", "slips", "sticks", "leaves")
"""The most telling first: what a mark of several events looks like."""
MOST_POSES_FRAMED = 100


@dataclass(frozen=True, eq=False)
class Track:
    """Forces at some points over time.

    Attributes:
        name: Of the contact, or of what pushes.
        points: In W, shape (n, k, 3) [m]; NaN where there is no such point at that time.
        forces: On the robot, in W, shape (n, k, 3) [N]; zero without contact.
        color: Of what is no contact, as '#rrggbb'.
    """

    name: str
    points: Array
    forces: Array
    color: str = PUSH_COLOR

    def __post_init__(self) -> None:
        object.__setattr__(self, "forces", np.nan_to_num(self.forces, nan=0.0, posinf=0.0, neginf=0.0))


@dataclass(frozen=True, eq=False)
class Frames:
    """A motion as a row of pictures.

    Attributes:
        times: Shape (n,) [s], increasing; the first and the last are those of the trajectory.
        joints: Indices of the joints with moving bodies.
        poses: X_WJ of each of them: position [m] and quaternion x, y, z, w, shape (n, number of joints, 7); a quaternion
            is in the half-space of the one before.
        com: Centre of mass in W, shape (n, 3) [m]; zero frames, shape (0, 3), of a robot without mass.
        contacts: Each contact's points and forces.
        pushes: Each external force.
        modes: {constraint: its mode at each frame}, contacts first.
        stretches: {constraint: (from [s], to [s], mode) of each time it is in one mode}, as fine as the samples.
        ghost: Name of a second motion, whose poses of the same joints follow in `joints` and `poses`; empty if there is none.
    """

    times: Array
    joints: tuple[int, ...]
    poses: Array
    com: Array
    contacts: tuple[Track, ...]
    pushes: tuple[Track, ...]
    modes: Mapping[str, Sequence[str]]
    stretches: Mapping[str, Sequence[tuple[float, float, str]]]
    ghost: str = ""

    @lazy
    def rows(self) -> Array:
        """All that moves, one row a frame: poses, centre of mass, then point and force of each point, shape (n, width)."""
        n = len(self.times)
        com = self.com if len(self.com) else np.full((n, 3), np.nan)
        tracks = [np.concatenate([t.points, t.forces], axis=2).reshape(n, -1) for t in (*self.contacts, *self.pushes)]
        return np.column_stack([self.poses.reshape(n, -1), com, *tracks])


def frames_of(
    trajectory: Trajectory,
    joints: Sequence[int],
    *,
    fps: float | None = None,
    speed: float = 1.0,
    external: Pushes | PushesAt = None,
) -> Frames:
    """Frames of a trajectory, evenly in time: its samples where they are near, else interpolated.

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
        InputError: if `external` contains other than forces at frames.
    """
    times = np.asarray(trajectory.t, float)
    if fps is None:
        fps = min(MOST_FPS, max(FPS, _fastest_turn(trajectory, joints) * speed / LARGEST_TURN))
        width = 7 * len(joints) + 3 + sum(6 * np.shape(p)[1] for p in trajectory.points.values())
        fps = min(fps, max(1.0, MOST_NUMBERS / width * speed / (times[-1] - times[0])))
    at = frame_times(times, speed / fps)
    low = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    share = np.clip((at - times[low]) / (times[low + 1] - times[low]), 0.0, 1.0)
    q = [configuration_between(trajectory, int(i), float(w)) for i, w in zip(low, share, strict=True)]
    poses, com = body_poses(trajectory.robot, q, joints)
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
    for name in ordered:  # chatter is listed as coarsely as it is shown
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


def _fastest_turn(trajectory: Trajectory, joints: Sequence[int]) -> float:
    """Largest angular velocity of a body [rad/s], at some hundred samples."""
    model, data = trajectory.robot.model, trajectory.robot.model.createData()
    fastest = 0.0
    for i in np.unique(np.linspace(0, len(trajectory.t) - 1, MOST_SAMPLES_LOOKED_AT).astype(int)):
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
        for push in pushes(state, given)[0]:
            count[push.name] = number = count.get(push.name, 0) + 1
            found.setdefault((push.name, number), []).append((i, push.point, push.force))
    tracks = []
    for (name, _), seen in found.items():
        points, forces = np.full((len(q), 1, 3), np.nan), np.zeros((len(q), 1, 3))
        for i, point, force in seen:
            points[i, 0], forces[i, 0] = point, force
        tracks.append(Track(f"push on {name}", points, forces))
    return tuple(tracks)


@dataclass(frozen=True, eq=False)
class MotionPage:
    """A motion in the form that the page needs.

    Attributes:
        frames: Its pictures.
        parts: Pieces of the robot, in the order in which the scene sent them.
        sizes: Of the scene's marks.
        ground: Whether there is a ground for the centre of mass to drop a line to.
        weight_N: The robot's weight [N].
        robot: The robot.
        lanes: {mode of the frames that is no contact's: its colour}, of those with a lane above the bar.
    """

    frames: Frames
    parts: Sequence[RobotPart]
    sizes: Sizes
    ground: bool
    weight_N: float
    robot: CheckedModel
    lanes: Mapping[str, str] = field(default_factory=dict)

    @lazy
    def words(self) -> list[str]:
        """The modes that occur, "open" first."""
        shown = {mode for modes in self.frames.modes.values() for mode in modes}
        between = {mode for some in self.frames.stretches.values() for _, _, mode in some}
        return [OPEN, *sorted((shown | between) - {OPEN})]

    @lazy
    def codes(self) -> Array:
        """Mode of each constraint at each frame, as its index in `words`, shape (n, number of constraints)."""
        place = {word: i for i, word in enumerate(self.words)}
        columns = [[place[mode] for mode in modes] for modes in self.frames.modes.values()]
        return np.array(columns, int).reshape(len(columns), len(self.frames.times)).T

    @property
    def longest(self) -> float:
        """Largest length of an arrow [m]."""
        return max(LONGEST_ARROW * self.sizes.body, LONGEST_WEIGHT * self.weight_N * self.sizes.metres_per_newton)

    def with_ghost(self, ghost: Any, down: float = 0.0) -> MotionPage:
        """With a second motion of the same robot, which is drawn in one translucent colour; without one if it is None.

        Args:
            ghost: With robot, t and q; at times that it does not have, as at the nearest that it has.
            down: By how much it is lowered [m].

        Raises:
            InputError: what is no motion, or one of another robot.
        """
        if ghost is None:
            return self
        f = self.frames
        second = checked_ghost(ghost, self.robot)
        poses = np.concatenate([f.poses, ghost_poses(second, f.times, f.joints, down)], axis=1)
        name = f"{getattr(ghost, 'source', '') or 'other motion'} (translucent)"
        return replace(self, frames=replace(f, joints=f.joints * 2, poses=poses, ghost=name))

    def goes_far(self, times: float) -> bool:
        """Whether the centre of mass travels farther along the ground than so many sizes of the robot."""
        com = self.frames.com[:, :2]
        return len(com) > 0 and float(np.ptp(com, axis=0).max()) > times * self.sizes.body

    def around(self, follow: bool) -> Array:
        """Points in W that the camera is to see, shape (n, 3) [m].

        With a camera that follows, as if the centre of mass stayed over where it starts.
        """
        frames = self.frames
        shift = np.zeros((len(frames.times), 3))
        if follow and len(frames.com):
            shift[:, :2] = frames.com[:, :2] - frames.com[0, :2]
        picked = np.unique(np.linspace(0, len(frames.times) - 1, MOST_POSES_FRAMED).astype(int))
        hulls = [hull_of(joint, self.parts) for joint in frames.joints]
        clouds = [np.zeros((0, 3))]
        for i in picked if hulls else ():
            placed = [pin.XYZQUATToSE3(pose) for pose in frames.poses[i]]
            pose = [hull @ X.rotation.T + X.translation for hull, X in zip(hulls, placed, strict=True)]
            clouds.append(outermost(np.vstack(pose)) - shift[i])  # pose by pose: all together would fill the memory
        for track in (*frames.contacts, *frames.pushes):
            clouds += [ends - shift for ends in self._arrow_ends(track)]
        points = np.vstack(clouds)
        points = points[np.isfinite(points).all(axis=1)]
        return outermost(points) if len(points) else points

    def _arrow_ends(self, track: Track) -> list[Array]:
        """Starts and tips of a track's resultant arrows, each of shape (n, 3) [m]; NaN where there is none."""
        size = np.linalg.norm(track.forces, axis=2, keepdims=True)
        total = size.sum(axis=1)
        weight = np.where(total > 0.0, total, np.nan)
        starts = np.sum(np.nan_to_num(track.points) * size, axis=1) / weight
        vectors = self.sizes.metres_per_newton * track.forces.sum(axis=1)
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return [starts, starts + vectors * np.minimum(1.0, self.longest / np.maximum(lengths, 1e-12))]

    def whole(self, events: Sequence[Event], settings: Mapping[str, object]) -> str:
        """The motion with all its frames, as JSON."""
        frames = self.frames
        played = {
            "times": [round(float(t), 9) for t in frames.times],
            "rows": _packed(frames.rows.astype("<f4")),
            "codes": _packed(self.codes.astype("u1")),
            "events": self.marks(events),
            "speeds": sorted({*SPEEDS, float(settings["speed"])}),  # type: ignore[arg-type]
        }
        return json.dumps({"motion": {**self._setup(), **settings, **played}})

    def opening(self, settings: Mapping[str, object]) -> str:
        """The motion without its frames, as JSON: they follow one by one, see `moment`."""
        return json.dumps({"motion": {**self._setup(), **settings}})

    def moment(self, i: int) -> str:
        """One frame, as JSON."""
        row = _packed(self.frames.rows[i].astype("<f4"))
        codes = [int(c) for c in self.codes[i]]
        return json.dumps({"moment": {"t": round(float(self.frames.times[i]), 9), "row": row, "codes": codes}})

    def marks(self, events: Sequence[Event]) -> list[dict[str, object]]:
        """Marks on the bar, in order of time: {t, name, kind, point, words}; events close together share one."""
        first, last = float(self.frames.times[0]), float(self.frames.times[-1])
        bins: dict[tuple[str, int], list[Event]] = {}
        for event in sorted(events, key=lambda e: e.t):
            if first - 1e-9 <= event.t <= last + 1e-9:
                bins.setdefault((event.name, int(BINS * (event.t - first) / (last - first))), []).append(event)
        marks: list[dict[str, object]] = []
        for (name, _), some in bins.items():
            kinds = {e.kind for e in some}
            kind = next((k for k in EVENT_KINDS if k in kinds), some[0].kind)
            words = [str(e) for e in some[:MOST_WORDS]]
            if len(some) > MOST_WORDS:
                words.append(f"and {len(some) - MOST_WORDS} more till {some[-1].t:.6f} s")
            point = next(e.point for e in some if e.kind == kind)
            marks.append({"t": round(float(some[0].t), 9), "name": name, "kind": kind, "point": point, "words": words})
        return sorted(marks, key=lambda mark: float(mark["t"]))  # type: ignore[arg-type]

    def _stretches(self, name: str) -> list[tuple[float, float, int]]:
        """(from, to, code) of each time in one mode other than "open", for its lane above the bar."""
        code = {word: i for i, word in enumerate(self.words)}
        return [(round(a, 9), round(b, 9), code[mode]) for a, b, mode in self.frames.stretches[name] if mode != OPEN]

    def _setup(self) -> dict[str, object]:
        """Bodies, contacts, sizes: the same for a page and for a live scene."""
        frames, sizes = self.frames, self.sizes
        own = len(frames.joints) // 2 if frames.ghost else len(frames.joints)
        body = {joint: j for j, joint in enumerate(frames.joints[:own])}
        parts = [
            {"node": i, "body": body[part.joint], "at": [round(float(x), 9) for x in pin.SE3ToXYZQUAT(part.placement)]}
            for i, part in enumerate(self.parts)
            if part.joint
        ]
        colors = contact_colors(t.name for t in frames.contacts)
        contacts = [
            {"name": t.name, "color": colors[t.name], "points": t.points.shape[1], "stretches": self._stretches(t.name)}
            for t in frames.contacts
        ]
        pushes = [{"name": t.name, "color": t.color, "points": 1} for t in frames.pushes]
        lanes = [{"name": name, "color": color, "stretches": self._stretches(name)} for name, color in self.lanes.items()]
        drawn = {name: getattr(sizes, name) for name in ("body", "shaft", "line", "lift")}
        note = f"{scale_note(sizes.metres_per_newton, self.weight_N)} Two heads: longer than drawn."
        return {
            "parts": parts,
            "bodies": len(frames.joints),
            "ghost": {"name": frames.ghost, "color": GHOST_COLOR, "bodies": own} if frames.ghost else None,
            "contacts": contacts,
            "pushes": pushes,
            "others": list(frames.modes)[len(contacts) :],
            "lanes": lanes,
            "words": self.words,
            "com": COM_COLOR if len(frames.com) else "",
            "ground": self.ground,
            "sizes": {**drawn, "longest": self.longest, "metresPerNewton": sizes.metres_per_newton},
            "note": note if contacts or pushes else "",
        }


def _packed(numbers: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers).tobytes()).decode("ascii")
