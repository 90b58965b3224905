"""What is checked and made before a motion is shown: its samples, its frames, and a scene with the robot at its start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.robots.robot import Robot
from rbd.simulation.simulated_motion import Event
from rbd.visual.marks.mark import Sizes
from rbd.visual.marks.regions import Footprints
from rbd.visual.playback.curves import Choice
from rbd.visual.playback.motion_frames import Pushes, PushesAt, frames_of
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.robot_meshes import RobotPart, robot_parts
from rbd.visual.scene import Scene

if TYPE_CHECKING:
    from rbd.motion.reference_motion import Motion
    from rbd.simulation.trajectory import Trajectory

MOST_FPS, LEAST_SPEED, MOST_SPEED = 1000.0, 1e-3, 1000.0
FORCES = ("points", "point_forces", "modes", "events")
WANTED = ("robot", "t", "q", "v", *FORCES)


@dataclass(frozen=True, eq=False)
class Forceless:
    """A motion of which no forces are known, an `rbd.Motion`, in the form of a trajectory that can be shown."""

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    points: Mapping[str, Array] = field(default_factory=dict)
    point_forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    events: tuple[Event, ...] = ()


def checked(trajectory: object) -> Trajectory:
    """A trajectory that can be shown.

    Raises:
        InputError: if it is none, has fewer than two samples, or its times do not increase.
    """
    missing = {name for name in WANTED if not hasattr(trajectory, name)}
    if missing - set(FORCES) or not isinstance(getattr(trajectory, "robot", None), CheckedModel):
        raise InputError(f"{trajectory!r:.80} is no trajectory; expected what rbd.simulate returned, or an rbd.Motion.")
    given: Any = trajectory
    shown: Trajectory = Forceless(given.robot, given.t, given.q, given.v) if missing else given  # type: ignore[assignment]
    n = len(shown.t)
    if n < 2:
        some = "no sample" if n == 0 else "one sample only"
        raise InputError(f"the trajectory has {some}; a motion wants two. Show a single state with rbd.visual.Scene.")
    if not np.all(np.isfinite(shown.t)) or np.min(np.diff(shown.t)) <= 0.0:
        raise InputError("the times of the trajectory do not increase; expected those that rbd.simulate gave.")
    finite = np.isfinite(shown.q).all(axis=1)
    if not finite.all():
        i = int(np.argmin(finite))
        raise InputError(f"q is not finite at {shown.t[i]:.6g} s; show what is before it: trajectory[:{i}].")
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Playback:
    """How a motion is shown: the settings that pages, sheets and videos share, as `rbd.visual.export_motion` describes them.

    Attributes:
        fps: Frames a second of playback.
        speed: Seconds of motion a second at first.
        title: Headline.
        start: Time at which the page opens [s].
        playing: Whether the page plays as it opens.
        external: The external forces.
        ghost: A second motion, drawn translucent.
        beside: A second motion, drawn to the right of the first.
        beside_external: Its external forces.
        charts: Which charts.
        follow: Whether the camera follows the robot.
        trace: Whether to draw the path of the centre of mass.
        footprints: Whether to draw footprints.
        ground: Whether to draw the ground.
        seen_from: Direction from the robot to the camera.
        arrow_per_weight: Length of an arrow as large as the weight [m].
        layers: Which layers are shown at first.
        view: Where the camera stands at first.
    """

    fps: float | None = None
    speed: float = 1.0
    title: str | None = None
    start: float | None = None
    playing: bool = False
    external: Pushes | PushesAt = None
    ghost: Trajectory | Motion | None = None
    beside: Trajectory | Motion | None = None
    beside_external: Pushes | PushesAt = None
    charts: Choice = True
    follow: bool | None = None
    trace: bool = True
    footprints: bool = True
    ground: bool = True
    seen_from: Sequence[float] | Array | None = None
    arrow_per_weight: float | None = None
    layers: Mapping[str, bool] | None = None
    view: str = "start"

    @classmethod
    def of(cls, arguments: Mapping[str, Any]) -> Playback:
        """The settings among the arguments of a function."""
        return cls(**{f.name: arguments[f.name] for f in fields(cls) if f.name in arguments})


def staged(trajectory: Trajectory, given: Playback, scene: Scene | None = None) -> tuple[MotionPage, Scene]:
    """The frames of a motion, and a scene with the robot at its start."""
    speed = positive("speed", given.speed, MOST_SPEED, "")
    if speed < LEAST_SPEED:
        raise InputError(f"speed is {speed:.3g}; expected at least {LEAST_SPEED:g}.")
    fps = None if given.fps is None else positive("fps", given.fps, MOST_FPS, " frames a second")
    robot = robot_of(trajectory)
    if scene is None:
        scene = Scene(
            robot, ground=given.ground, seen_from=given.seen_from, arrow_per_weight=given.arrow_per_weight, legend=False,
            layers=given.layers, view=given.view,
        )  # fmt: skip
    scene.show(State(robot, np.array(trajectory.q[0], float)))
    return _page(trajectory, robot_parts(robot), scene.sizes, bool(given.ground), fps, speed, given.external), scene


def a_second(trajectory: Trajectory, first: MotionPage, given: Playback) -> MotionPage:
    """The frames of a motion that is to be shown beside a first one, of its robot or another."""
    robot = robot_of(trajectory)
    parts: Sequence[RobotPart] = robot_parts(robot)
    if len(parts) == len(first.parts) and all(map(_alike, parts, first.parts)):
        parts = first.parts  # their meshes are in the page already
    return _page(trajectory, parts, first.sizes, first.ground, given.fps, given.speed, given.beside_external)


def _page(
    trajectory: Trajectory,
    parts: Sequence[RobotPart],
    sizes: Sizes,
    ground: bool,
    fps: float | None,
    speed: float,
    external: Pushes | PushesAt,
) -> MotionPage:
    robot = trajectory.robot
    joints = sorted({part.joint for part in parts} - {0})
    weight = float(robot.mass * np.linalg.norm(robot.gravity))
    frames = frames_of(trajectory, joints, fps=fps, speed=speed, external=external)
    return MotionPage(frames, parts, sizes, ground, weight, robot_of(trajectory), events=tuple(trajectory.events))


def _alike(one: RobotPart, other: RobotPart) -> bool:
    """Whether two pieces have the same place, look and mesh."""
    if (one.joint, one.color, one.opacity) != (other.joint, other.color, other.opacity) or one.placement != other.placement:
        return False
    pairs = ((one.mesh.vertices, other.mesh.vertices), (one.mesh.faces, other.mesh.faces))
    return one.mesh is other.mesh or all(np.array_equal(x, y) for x, y in pairs)


def displaced(footprints: Sequence[Footprints], motion: MotionPage) -> list[Footprints]:
    """The footprints of the second motion, where that is drawn."""
    shift = motion.second.shift if motion.second is not None else (0.0, 0.0, 0.0)
    return [replace(stood, name=f"{stood.name}, 2", outlines=stood.outlines + shift) for stood in footprints]


def a_time(what: str, value: object, first: float, last: float) -> float:
    """A time from the first to the last of a motion [s].

    Raises:
        InputError: if it is outside, or none.
    """
    t = as_float(value)
    # A time that was computed as the end may lie a rounding beyond it.
    if not first - 1e-9 <= t <= last + 1e-9:
        raise InputError(f"{what} is {value!r:.80}; the motion runs from {first:g} s to {last:g} s.")
    return min(max(t, first), last)
