"""A motion as one page with a play button and a scrub bar, as a strip of pictures, or live in the viewer."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, as_array
from rbd.errors import InputError, PictureError
from rbd.visual.marks.regions import footprints_of
from rbd.visual.pages.browser import Browser
from rbd.visual.pages.page import screenshot, write_page
from rbd.visual.playback.curves import Choice, described, together
from rbd.visual.playback.motion_frames import Pushes, PushesAt
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.playback.staging import Playback, a_second, a_time, checked, displaced, staged
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.robot_layers import FRONT_LEFT
from rbd.visual.scene import Scene
from rbd.visual.style import a_count, a_page, a_path, a_picture

if TYPE_CHECKING:
    from rbd.motion.reference_motion import Motion
    from rbd.simulation.trajectory import Trajectory

MOST_PICTURES = 100
CAPTION_HEIGHT = 34
"""Size of a picture in a strip, in pixels, as in animation.css."""
GAP = 6
LIVE_FPS = 30.0
VIEWER_SECONDS = 20.0
"""Time that a replay waits for the browser that it opened [s]."""
FAR = 5.0
"""By default the camera follows a robot that travels more than this many times its size."""


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
    beside: Trajectory | Motion | None = None,
    beside_external: Pushes | PushesAt = None,
    charts: Choice = True,
    follow: bool | None = None,
    trace: bool = True,
    footprints: bool = True,
    ground: bool = True,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
    layers: Mapping[str, bool] | None = None,
    view: str = "start",
) -> Path:
    """Write a motion as one HTML page that needs no network and no server; returns its path.

    The page has the robot's meshes once and its poses at every frame; between two frames bodies go straight and turn
    evenly (slerp). An arrow's length is the force times one scale for the whole motion, stated in the legend; what is
    longer than the robot is cut, and has two heads. The support polygon is the hull of the points that carry load. Above the
    bar each contact has a lane: filled while it touches, striped while it slips, with a mark at each event. Beside the robot,
    in narrow windows below it, are charts over time with a cursor at the present; a click on one goes to that time. Keys: space
    plays, left and right step (shift: ten frames), up and down change the speed, page up and page down go from event to event,
    f follows the robot, c folds the charts. `x.html#t=0.5` opens at 0.5 s.

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
        beside: A second motion, of this robot or another, drawn to the right of the first at the same times with its own
            forces; its curves are dashed.
        beside_external: The external forces of `beside`.
        charts: Whether to draw the charts that there are numbers for; or the names of some: "forces", "torques",
            "centre of pressure", "energy", "residuals"; "angles", "speeds", "height", which an `rbd.Motion` has too.
        follow: Whether the camera initially follows the robot; by default if it travels far.
        trace: Whether to draw the path of the centre of mass.
        footprints: Whether to draw the outlines of soles where they stood, of those that stood in two places or more.
        ground: Whether to draw the ground z = 0 as a grid.
        seen_from: Direction from the robot to the camera, in W, shape (3,); by default from the front left.
        arrow_per_weight: Length of an arrow as large as the robot's weight [m].
        layers: {layer: whether it is shown at first}, where that is to differ from `rbd.visual.pages.link.LAYERS`; the page can
            change it.
        view: Where the camera stands at first: "start", "front", "side" or "top".

    Raises:
        InputError: not a trajectory, fewer than two samples, invalid settings, charts that it has no numbers for.
        PictureError: the file cannot be written.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> print(rbd.visual.export_motion(swing, "swing.html", speed=0.5, charts=["energy"]).name)
        swing.html
    """
    settings = Playback.of(locals())
    target = a_page(path)
    scene = motion_scene(trajectory, settings)
    write_page(target, scene.page(title))
    return target


def motion_scene(trajectory: Trajectory | Motion, given: Playback) -> Scene:
    """The scene of `export_motion`, with all frames: to be written as a page, or served live.

    Args:
        trajectory: As for `export_motion`.
        given: Its settings.

    Raises:
        InputError: as `export_motion`.
    """
    shown = checked(trajectory)
    motion, scene = staged(shown, given)
    motion = motion.with_ghost(given.ghost)
    drawn, times = charts_of(shown, given.charts), [np.asarray(shown.t)]
    second = None
    if given.beside is not None:
        second = checked(given.beside)
        camera = FRONT_LEFT if given.seen_from is None else given.seen_from
        motion = motion.with_second(a_second(second, motion, given), camera)
        drawn = together(drawn, charts_of(second, True if given.charts is True else [c.name for c in drawn]))
        times.append(np.asarray(second.t))
    first, last = float(motion.frames.times[0]), float(motion.frames.times[-1])
    begin = first if given.start is None else a_time("start", given.start, first, last)
    follows = motion.goes_far(FAR) if given.follow is None else bool(given.follow)
    settings = {"title": _a_title(given.title, shown), "start": begin, "speed": float(given.speed), "follow": follows}
    settings |= {
        "trace": bool(given.trace),
        "playing": bool(given.playing),
        "charts": described(times, drawn) if drawn else None,
    }
    scene.stage_motion(motion.whole(settings), motion.around(follows), motion.further_parts())
    outlines = footprints_of(shown) + ([] if second is None else displaced(footprints_of(second), motion))
    if given.footprints and outlines:
        scene.draw(*outlines)
    return scene


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
    browser: Browser | None = None,
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
        browser: An open browser; by default one is started.

    Raises:
        InputError: not a trajectory, times outside it, invalid sizes.
        PictureError: no browser, or it made no picture.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.motion_sheet(swing, 4, "swing.png")  # doctest: +SKIP
        PosixPath('swing.png')
    """
    given = Playback.of(locals())
    if a_path("the picture", png_path).suffix.lower() != ".png":
        raise PictureError(f"cannot write the picture {str(png_path)!r:.80}: expected a name that ends in .png.")
    picture = a_picture(png_path)
    width, height = a_count("width", width, 4000), a_count("height", height, 4000)
    shown = checked(trajectory)
    at = _picture_times(times, float(shown.t[0]), float(shown.t[-1]))
    in_a_row = len(at) if columns is None else min(a_count("columns", columns, MOST_PICTURES), len(at))
    motion, scene = staged(shown, given)
    motion = motion.with_ghost(ghost)
    follows = motion.goes_far(FAR) if follow is None else bool(follow)
    settings = {"title": "", "start": at[0], "speed": 1.0, "follow": follows, "trace": bool(trace)}
    sheet = {"times": at, "columns": in_a_row, "width": width, "height": height, "gap": GAP}
    scene.stage_motion(replace(motion, events=()).whole({**settings, "sheet": sheet}), motion.around(follows))
    if footprints and (outlines := footprints_of(shown)):
        scene.draw(*outlines)
    with tempfile.TemporaryDirectory(prefix="rbd-motion-") as folder:
        page = Path(folder) / "sheet.html"
        write_page(page, scene.page())
        across = in_a_row * (width + GAP) - GAP
        down = math.ceil(len(at) / in_a_row) * (height + CAPTION_HEIGHT + GAP) - GAP
        return screenshot(page, picture, width=across, height=down, browser=browser)


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
    motion, used = staged(shown, Playback(fps=LIVE_FPS, speed=speed, external=external), scene)
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


def _a_title(title: str | None, trajectory: Trajectory) -> str:
    if title is not None and not isinstance(title, str):
        raise InputError(f"title is {title!r:.80}; expected text.")
    return title or str(trajectory.robot.name)


def _picture_times(times: Sequence[float] | Array | int, first: float, last: float) -> list[float]:
    if isinstance(times, int | np.integer) and not isinstance(times, bool):
        return [float(t) for t in np.linspace(first, last, a_count("times", times, MOST_PICTURES))]
    given = as_array("times", times)
    if given.ndim != 1 or not 1 <= len(given) <= MOST_PICTURES:
        raise InputError(f"times have the shape {given.shape}; expected 1 to {MOST_PICTURES} times in a list.")
    return [a_time("a time", float(t), first, last) for t in given]
