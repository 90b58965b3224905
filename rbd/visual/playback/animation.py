"""A motion as one page with a play button and a scrub bar, as a strip of pictures, or live in the viewer."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_array, as_float
from rbd.errors import InputError, PictureError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.robots.robot import Robot
from rbd.simulation.motion import Event
from rbd.visual.marks.footprints import footprints_of
from rbd.visual.pages.page import screenshot, write_page
from rbd.visual.playback.frames import MotionPage, Pushes, PushesAt, frames_of
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.scene import Scene
from rbd.visual.style import a_count, a_page, a_path, a_picture

if TYPE_CHECKING:
    from rbd.motion.motion import Motion
    from rbd.simulation.trajectory import Trajectory

MOST_FPS, LEAST_SPEED, MOST_SPEED = 1000.0, 1e-3, 1000.0
MOST_PICTURES = 100
FORCES = ("points", "point_forces", "modes", "events")
WANTED = ("robot", "t", "q", "v", *FORCES)
CAPTION_HEIGHT = 34
"""Size of a picture in a strip, in pixels, as in animation.css."""
GAP = 6
LIVE_FPS = 30.0
VIEWER_SECONDS = 20.0
"""Time that a replay waits for the browser that it opened [s]."""
FAR = 5.0
"""By default the camera follows a robot that travels more than this many times its size."""


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


def export_motion(
    trajectory: Trajectory | Motion,
    path: str | PathLike[str],
    *,
    fps: float | None = None,
    speed: float = 1.0,
    title: str | None = None,
    start: float | None = None,
    external: Pushes | PushesAt = None,
    ghost: Trajectory | Motion | None = None,
    follow: bool | None = None,
    trace: bool = True,
    footprints: bool = True,
    ground: bool = True,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
) -> Path:
    """Write a motion as one HTML page that needs no network and no server; returns its path.

    The page has the robot's meshes once and its poses at every frame; between two frames bodies go straight and turn
    evenly (slerp). An arrow's length is the force times one scale for the whole motion, stated in the legend; what is
    longer than the robot is cut, and has two heads. Above the bar each contact has a lane: filled while it touches,
    striped while it slips, with a mark at each event. Keys: space plays, left and right step (shift: ten frames), up and
    down change the speed, page up and page down go from event to event, f follows the robot. `x.html#t=0.5` opens at 0.5 s.

    Args:
        trajectory: What `rbd.simulate` returned, or an `rbd.Motion`, which has no forces; two samples at least.
        path: Of the page, ends in .html.
        fps: Frames a second of playback at `speed`; by default 30, more where bodies turn fast.
        speed: Seconds of motion a second at first; the page can change it.
        title: Headline; the robot's name by default.
        start: Time at which the page opens [s]; the first by default.
        external: The external forces that were given to `rbd.simulate`: constant, or as a function of state and time.
        ghost: A second motion of the same robot, an `rbd.Motion` or a trajectory, drawn translucent in one colour at the same
            times.
        follow: Whether the camera initially follows the robot; by default if it travels far.
        trace: Whether to draw the path of the centre of mass.
        footprints: Whether to draw the outlines of soles where they stood, of those that stood in two places or more.
        ground: Whether to draw the ground z = 0 as a grid.
        seen_from: Direction from the robot to the camera, in W, shape (3,); by default from the front left.
        arrow_per_weight: Length of an arrow as large as the robot's weight [m].

    Raises:
        InputError: not a trajectory, fewer than two samples, invalid settings.
        PictureError: the file cannot be written.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> print(rbd.visual.export_motion(swing, "swing.html", speed=0.5).name)
        swing.html
    """
    target = a_page(path)
    shown = checked(trajectory)
    motion, scene = staged(shown, fps, speed, external, ground, seen_from, arrow_per_weight)
    motion = motion.with_ghost(ghost)
    first, last = float(motion.frames.times[0]), float(motion.frames.times[-1])
    begin = first if start is None else a_time("start", start, first, last)
    follows = motion.goes_far(FAR) if follow is None else bool(follow)
    settings = {"title": _a_title(title, shown), "start": begin, "speed": float(speed), "follow": follows, "trace": bool(trace)}
    scene.stage_motion(motion.whole(shown.events, settings), motion.around(follows))
    if footprints and (outlines := footprints_of(shown)):
        scene.draw(*outlines)
    write_page(target, scene.page(title))
    return target


def motion_sheet(
    trajectory: Trajectory | Motion,
    times: Sequence[float] | Array | int,
    png_path: str | PathLike[str],
    *,
    columns: int | None = None,
    width: int = 360,
    height: int = 360,
    external: Pushes | PushesAt = None,
    ghost: Trajectory | Motion | None = None,
    follow: bool | None = None,
    trace: bool = True,
    footprints: bool = True,
    ground: bool = True,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
) -> Path:
    """Draw a motion at some times side by side, all from one camera, with the time under each; returns the picture's path.

    Args:
        trajectory: What `rbd.simulate` returned, or an `rbd.Motion`, which has no forces; two samples at least.
        times: When [s], or how many pictures evenly from the first to the last.
        png_path: Path of the picture.
        columns: Pictures in a row; all of them by default.
        width: Of one picture, in pixels.
        height: Of one picture without its caption, in pixels.
        external: As for `export_motion`; so are `ghost`, `follow`, `trace`, `ground`, `seen_from` and `arrow_per_weight`.
        ghost: A second motion of the same robot, drawn translucent.
        follow: Whether each picture is centred on the robot.
        trace: Whether to draw the path of the centre of mass.
        footprints: Whether to draw the outlines of soles where they stood, of those that stood in two places or more.
        ground: Whether to draw the ground.
        seen_from: Direction from the robot to the camera.
        arrow_per_weight: Length of an arrow as large as the weight [m].

    Raises:
        InputError: not a trajectory, times outside it, invalid sizes.
        PictureError: no browser, or it made no picture.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.motion_sheet(swing, 4, "swing.png")  # doctest: +SKIP
        PosixPath('swing.png')
    """
    if a_path("the picture", png_path).suffix.lower() != ".png":
        raise PictureError(f"cannot write the picture {str(png_path)!r:.80}: expected a name that ends in .png.")
    picture = a_picture(png_path)
    width, height = a_count("width", width, 4000), a_count("height", height, 4000)
    shown = checked(trajectory)
    at = _picture_times(times, float(shown.t[0]), float(shown.t[-1]))
    in_a_row = len(at) if columns is None else min(a_count("columns", columns, MOST_PICTURES), len(at))
    motion, scene = staged(shown, None, 1.0, external, ground, seen_from, arrow_per_weight)
    motion = motion.with_ghost(ghost)
    follows = motion.goes_far(FAR) if follow is None else bool(follow)
    settings = {"title": "", "start": at[0], "speed": 1.0, "follow": follows, "trace": bool(trace)}
    sheet = {"times": at, "columns": in_a_row, "width": width, "height": height, "gap": GAP}
    scene.stage_motion(motion.whole((), {**settings, "sheet": sheet}), motion.around(follows))
    if footprints and (outlines := footprints_of(shown)):
        scene.draw(*outlines)
    with tempfile.TemporaryDirectory(prefix="rbd-motion-") as folder:
        page = Path(folder) / "sheet.html"
        write_page(page, scene.page())
        across = in_a_row * (width + GAP) - GAP
        down = math.ceil(len(at) / in_a_row) * (height + CAPTION_HEIGHT + GAP) - GAP
        return screenshot(page, picture, width=across, height=down)


def replay(
    trajectory: Trajectory | Motion, *, speed: float = 1.0, scene: Scene | None = None, external: Pushes | PushesAt = None
) -> None:
    """Show a motion live, paced by the clock; returns when it is over. Ctrl-C ends it sooner, and is no error.

    Late frames are skipped, so that the motion keeps its pace. The picture stays at the last frame shown.

    Args:
        trajectory: What `rbd.simulate` returned, or an `rbd.Motion`, which has no forces; two samples at least.
        speed: Seconds of motion a second.
        scene: The live scene to show it in: `Scene(robot)` of the same robot, with `scene.open()` called. By default a new
            one is opened in the browser, on 127.0.0.1, and closed afterwards.
        external: The external forces that were given to `rbd.simulate`.

    Raises:
        InputError: no trajectory, or a scene of another robot.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.replay(swing, speed=0.5)  # doctest: +SKIP
    """
    shown = checked(trajectory)
    if scene is not None and not isinstance(scene, Scene):
        raise InputError(f"scene is {scene!r:.80}; expected a rbd.visual.Scene, or None.")
    motion, used = staged(shown, LIVE_FPS, speed, external, scene=scene)
    play_live(motion, used, shown.robot.name, float(speed), opened=scene is not None)


def play_live(motion: MotionPage, scene: Scene, title: str, speed: float, *, opened: bool = False) -> None:
    """Show frames live, paced by the clock, from the first to the last; Ctrl-C ends it.

    Args:
        motion: The frames.
        scene: The scene that `staged` made.
        title: Headline.
        speed: Seconds of motion a second.
        opened: Whether the scene is in a browser already; else it is opened, and closed afterwards.
    """
    settings = {"title": title, "follow": motion.goes_far(FAR), "trace": False}
    scene.stage_motion(motion.opening(settings), motion.around(bool(settings["follow"])))
    try:
        with contextlib.suppress(KeyboardInterrupt):
            if not opened:
                scene.open()
                scene.wait_for_viewer(VIEWER_SECONDS)
            _pace(motion, scene, speed)
    finally:
        if not opened:
            scene.close()


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


def _pace(motion: MotionPage, scene: Scene, speed: float) -> None:
    times = motion.frames.times
    began = time.monotonic()
    i = 0
    while True:
        scene.stage_moment(motion.moment(i))
        if i == len(times) - 1:
            return
        now = times[0] + (time.monotonic() - began) * speed
        i = max(i + 1, min(int(np.searchsorted(times, now)), len(times) - 1))
        time.sleep(max(0.0, (times[i] - times[0]) / speed - (time.monotonic() - began)))


def staged(
    trajectory: Trajectory,
    fps: float | None,
    speed: float,
    external: Pushes | PushesAt,
    ground: bool = True,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
    scene: Scene | None = None,
) -> tuple[MotionPage, Scene]:
    """The frames of a motion, and a scene with the robot at its start."""
    speed = positive("speed", speed, MOST_SPEED, "")
    if speed < LEAST_SPEED:
        raise InputError(f"speed is {speed:.3g}; expected at least {LEAST_SPEED:g}.")
    fps = None if fps is None else positive("fps", fps, MOST_FPS, " frames a second")
    robot = robot_of(trajectory)
    if scene is None:
        scene = Scene(robot, ground=ground, seen_from=seen_from, arrow_per_weight=arrow_per_weight, legend=False)
    scene.show(State(robot, np.array(trajectory.q[0], float)))
    parts = robot_parts(robot)
    joints = sorted({part.joint for part in parts} - {0})
    weight = float(robot.mass * np.linalg.norm(robot.gravity))
    frames = frames_of(trajectory, joints, fps=fps, speed=speed, external=external)
    return MotionPage(frames, parts, scene.sizes, bool(ground), weight, robot), scene


def _a_title(title: str | None, trajectory: Trajectory) -> str:
    if title is not None and not isinstance(title, str):
        raise InputError(f"title is {title!r:.80}; expected text.")
    return title or str(trajectory.robot.name)


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


def _picture_times(times: Sequence[float] | Array | int, first: float, last: float) -> list[float]:
    if isinstance(times, int | np.integer) and not isinstance(times, bool):
        return [float(t) for t in np.linspace(first, last, a_count("times", times, MOST_PICTURES))]
    given = as_array("times", times)
    if given.ndim != 1 or not 1 <= len(given) <= MOST_PICTURES:
        raise InputError(f"times have the shape {given.shape}; expected 1 to {MOST_PICTURES} times in a list.")
    return [a_time("a time", float(t), first, last) for t in given]
