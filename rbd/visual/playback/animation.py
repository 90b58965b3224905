"""A motion as one page with a play button and a scrub bar, as a strip of pictures, or live in the viewer."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_array, check_positive, check_whole
from rbd.audits import AuditReport, EnginesCompared
from rbd.control.walking.plan import WalkPlan
from rbd.errors import InputError, PictureError
from rbd.errors.inputs import check_kind, check_known, listed_items
from rbd.model.external import External
from rbd.model.state import State
from rbd.motion.report import MotionReport
from rbd.planning import Plan
from rbd.visual.marks.mark import Sizes
from rbd.visual.marks.regions import Drawn, footprints_of, legend_of
from rbd.visual.marks.surfaces import surface_entries
from rbd.visual.pages.browser import Browser
from rbd.visual.pages.page import photograph, write_page
from rbd.visual.playback.audit_motion import shown_audit, shown_comparison
from rbd.visual.playback.curves import Choice, described, together
from rbd.visual.playback.followed_plans import drawn_plans
from rbd.visual.playback.motion_frames import PushesAt, frames_of
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.playback.plan_motion import shown_plan
from rbd.visual.playback.planar_motion import is_planar, shown_planar
from rbd.visual.playback.report_motion import shown_report
from rbd.visual.playback.shown_motion import ShownMotion, a_time
from rbd.visual.robot_meshes import RobotPart, robot_parts
from rbd.visual.scene import Scene
from rbd.visual.style import MOST_SIZE, a_page, a_path, a_picture, check_size
from rbd.visual.verified_frames import motion_verified

if TYPE_CHECKING:
    from rbd.motion.reference_motion import Motion
    from rbd.planar.planned_motion import PlanarMotion
    from rbd.simulation.trajectory import Trajectory

MOST_PICTURES = 100
CAPTION_HEIGHT = 34
"""Size of a picture in a strip, in pixels, as in animation.css."""
GAP = 6
VIEWER_SECONDS = 20.0
"""Time that a replay waits for the browser that it opened [s]."""
FAR = 5.0
"""By default the camera follows a robot that travels more than this many times its size."""
MOST_FPS, LEAST_SPEED, MOST_SPEED = 1000.0, 1e-3, 1000.0
USUAL: Mapping[str, Any] = {"speed": 1.0, "trace": True, "ground": True, "footprints": True}
"""{setting: its value where neither the user nor the kind of motion says so}."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Playback:
    """How a motion is shown: the settings that pages, strips and videos share, as `rbd.visual.export_motion` describes them.

    None stands for what the kind of motion has, see `ShownMotion.defaults`.

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
        trace: Whether to draw the path of the centre of mass; by default of all but reports.
        footprints: Whether to draw footprints.
        plan: A plan of a walk, or plans with their times, whose footprints are drawn.
        regions: Regions and pushes that are drawn throughout.
        ground: Whether to draw the ground.
        seen_from: Direction from the robot to the camera.
        arrow_per_weight: Length of an arrow as large as the weight [m].
        layers: Which layers are shown at first.
        view: Where the camera stands at first.
    """

    fps: float | None = None
    speed: float | None = None
    title: str | None = None
    start: float | None = None
    playing: bool = False
    external: External | PushesAt = None
    ghost: Trajectory | Motion | None = None
    beside: Trajectory | Motion | None = None
    beside_external: External | PushesAt = None
    charts: Choice = True
    follow: bool | None = None
    trace: bool | None = None
    footprints: bool | None = None
    plan: WalkPlan | Sequence[tuple[float, WalkPlan]] | None = None
    regions: Sequence[Drawn] = ()
    ground: bool | None = None
    seen_from: Sequence[float] | Array | None = None
    arrow_per_weight: float | None = None
    layers: Mapping[str, bool] | None = None
    view: str = "start"

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Playback:
        """The settings with these names.

        Raises:
            InputError: a name that there is not.
        """
        for name in settings:
            check_known("there is no setting", name, [f.name for f in fields(cls)], InputError)
        return cls(**settings)

    @property
    def pace(self) -> float:
        """The speed; that which is usual where none is given."""
        return float(USUAL["speed"] if self.speed is None else self.speed)

    def resolved(self, shown: ShownMotion) -> Playback:
        """With what the kind of motion has where nothing was given.

        Raises:
            InputError: a title that is no text, a speed or a rate that is no positive number.
        """
        usual = {**USUAL, "title": shown.title, **shown.defaults}
        given: Any = replace(self, **{name: value for name, value in usual.items() if getattr(self, name) is None})
        check_kind("title", given.title, str, "text")
        speed = check_positive("speed", given.speed, MOST_SPEED)
        if speed < LEAST_SPEED:
            raise InputError(f"speed is {speed:.3g}; expected at least {LEAST_SPEED:g}.")
        fps = None if given.fps is None else check_positive("fps", given.fps, MOST_FPS)
        return replace(given, speed=speed, fps=fps, title=given.title or shown.title)


def shown_motion(motion: Any) -> ShownMotion:
    """A motion of any kind, as it is shown.

    Raises:
        InputError: what is none, fewer than two samples, times that do not increase.
    """
    if isinstance(motion, ShownMotion):
        return motion
    if isinstance(motion, MotionReport):
        return shown_report(motion)
    if isinstance(motion, AuditReport):
        return shown_audit(motion)
    if isinstance(motion, EnginesCompared):
        return shown_comparison(motion)
    if isinstance(motion, Plan):
        return shown_plan(motion)
    return shown_planar(motion) if is_planar(motion) else ShownMotion.of_trajectory(motion)


def export_motion(
    motion: Trajectory | Motion | MotionReport | AuditReport | EnginesCompared | Plan | PlanarMotion,
    path: str | PathLike[str],
    *,
    fps: float | None = None,
    speed: float | None = None,
    title: str | None = None,
    start: float | None = None,
    external: External | PushesAt = None,
    ghost: Trajectory | Motion | None = None,
    beside: Trajectory | Motion | None = None,
    beside_external: External | PushesAt = None,
    charts: Choice = True,
    follow: bool | None = None,
    trace: bool | None = None,
    footprints: bool | None = None,
    plan: WalkPlan | Sequence[tuple[float, WalkPlan]] | None = None,
    regions: Sequence[Drawn] = (),
    ground: bool | None = None,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
    layers: Mapping[str, bool] | None = None,
    view: str = "start",
    verify: Any = None,
) -> Path:
    """Write a motion as one HTML page that needs no network and no server; returns its path.

    The page has the robot's meshes once and its poses at every frame; between two frames bodies go straight and turn evenly
    (slerp). An arrow's length is the force times one scale for the whole motion, stated in the legend; what is longer than the
    robot is cut, and has two heads. The support polygon is the hull of the points that carry load. A disk at each point of a
    trajectory has the colour of its mode (open, sticks, slips, impact), filled by the share of friction used, where the
    contact's normal is known: on planes that stay, on terrain, of soles. Slopes, walls and tables of these planes are drawn as
    pieces around the contacts. Above the bar each contact has a lane: filled while it touches, striped while it slips, with a
    mark at each event. Beside the robot, in narrow windows below it, are charts over time with a line at the present; a click
    on one goes to that time, dragging across (or two fingers) enlarges what is between, in all charts, and the pointer reads
    values. The page is dark where the reader's system is; the key d turns that. Keys: space
    plays, left and right step (shift: ten frames), up and down change the speed, page up and page down go from event to event,
    f follows the robot, c folds the charts. `x.html#t=0.5` opens at 0.5 s.

    Of a report the wrench that is missing is drawn too, as a force at the centre of mass and as a moment over 0.3 m, and there
    is a lane for each cause, with a mark at its worst frame. Where it has a report `before`, of the same frames, as that of a
    repaired motion, this one's motion is the ghost, on the same floor and at the same pace, with lanes of its contacts.

    Of an audit the engine's forces stand beside those of the law, by `rbd.solve` in up to 300 frames; a disk at each point has
    the colour of its mode; each cause has a lane, and a row in the legend that goes to its worst frame. Of a long record the
    page has up to 1000 frames, those that are worst among them. Two engines compared are beside each other.

    A planar chain is upright in W, its x to the right and its y up, with the path of the end point behind it.

    Args:
        motion: What `rbd.simulate`, `rbd.check_motion`, `rbd.audit`, `rbd.audits.compare` or `rbd.plan` returned, or
            `error.plan` of a `CannotPlan`, whose missing wrench is drawn where nothing is certified; an `rbd.Motion`, which has
            no forces; or a motion of a planar chain; two samples at least, of an audit one.
        path: Of the page, ends in .html.
        fps: Frames a second of playback at `speed`; by default 30, more where bodies turn fast; of a report its own.
        speed: Seconds of motion a second at first; the page can change it. By default 1, of a planar chain 0.5.
        title: Headline; by default the robot's name, or what the report says.
        start: Time at which the page opens [s]; by default the first, of a report that at which most is missing.
        external: The external forces that were given to `rbd.simulate`: constant, or as a function of state and time.
        ghost: A second motion of the same robot, an `rbd.Motion` or a trajectory, drawn translucent in one colour at the same
            times.
        beside: A second motion, of this robot or another, drawn to the right of the first at the same times with its own
            forces; its curves are dashed.
        beside_external: The external forces of `beside`.
        charts: Whether to draw the charts that there are numbers for; or the names of some: "forces", "torques",
            "centre of pressure", "energy", "residuals"; "angles", "speeds", "height", which an `rbd.Motion` has too; of a
            report "missing wrench", "deviation" (from the motion before) and "friction".
        follow: Whether the camera initially follows the robot; by default if it travels far.
        trace: Whether to draw the path of the centre of mass; by default of all but reports.
        footprints: Whether to draw the outlines of soles where they stood, of those that stood in two places or more; by
            default of all but audits.
        plan: A plan of a walk, as `walk.plan`: its footprints and ways of feet are drawn as lines, and the capture point, which
            moves. Of several with their times, as `balance.plans`, each is drawn until the next: so one sees footholds change.
        regions: What `Scene.draw` takes, drawn throughout: `rbd.control.capture_region(...)`, for example.
        ground: Whether to draw the ground z = 0 as a grid; by default of all but planar chains.
        seen_from: Direction from the robot to the camera, in W, shape (3,); by default from the front left.
        arrow_per_weight: Length of an arrow as large as the robot's weight [m].
        layers: {layer: whether it is shown at first}, where that is to differ from `rbd.visual.pages.link.LAYERS`; the page can
            change it.
        view: Where the camera stands at first: "start", "front", "side" or "top".
        verify: Constraints of a simulated motion, as they were given to `rbd.simulate`: the page gets a button "verify". It
            carries M, J, h, tau, a and f of answers of `rbd.solve` in some samples, 60 kB a minute, and computes their
            residuals anew in the browser. A slider makes friction less, and tells which contacts leave their cones.

    Raises:
        InputError: no motion, fewer than two samples, invalid settings, charts that it has no numbers for.
        PictureError: the file cannot be written.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> print(rbd.visual.export_motion(swing, "swing.html", speed=0.5, charts=["energy"]).name)
        swing.html
    """
    settings = {name: value for name, value in locals().items() if name not in ("motion", "path", "verify")}
    target = a_page(path)
    answers = "" if verify is None else motion_verified(motion, verify, external)
    write_page(target, motion_scene(motion, Playback.of(settings)).page(answers))
    return target


def motion_scene(motion: Any, given: Playback, sheet: Mapping[str, object] | None = None, scene: Scene | None = None) -> Scene:
    """The scene of `export_motion`, with all frames: to be written as a page, or served live.

    Args:
        motion: As for `export_motion`.
        given: Its settings.
        sheet: Of a strip of pictures: its times, columns and sizes.
        scene: Where it is shown, a scene of the same robot; by default a new one.

    Raises:
        InputError: as `export_motion`.
    """
    shown = shown_motion(motion)
    given = given.resolved(shown)
    if scene is None:
        look = {name: getattr(given, name) for name in ("seen_from", "arrow_per_weight", "layers", "view")}
        scene = Scene(shown.robot, ground=bool(given.ground), legend=False, **look)
    scene.show(State(shown.robot, np.array(shown.q[0], float)))
    page = _page(shown, robot_parts(shown.robot), scene.sizes, bool(given.ground), given).with_ghost(given.ghost)
    follows = page.goes_far(FAR) if given.follow is None else bool(given.follow)
    camera = scene.direction(shown.terrains, page.around(follows) if shown.terrains else None)
    charts, times, outlines = shown.charts(given.charts), [shown.t], footprints_of(shown)
    if given.beside is not None:
        second = shown_motion(given.beside)
        page = page.with_second(_beside(second, page, given), camera)
        charts = together(charts, second.charts(True if given.charts is True else [c.name for c in charts]))
        times.append(second.t)
        shift = page.second.shift if page.second is not None else ()
        prints = footprints_of(second)
        moved = [tuple([corners + shift for corners in stood.outlines]) for stood in prints]
        outlines += [replace(p, name=f"{p.name}, 2", outlines=o) for p, o in zip(prints, moved, strict=True)]
    first, last = float(page.frames.times[0]), float(page.frames.times[-1])
    given_regions = listed_items("regions", given.regions, "a list of what Scene.draw takes")
    drawn: list[Drawn] = [*(outlines if given.footprints else ()), *given_regions]
    planned, spans, way = drawn_plans(given.plan, shown, page.frames.times)
    paths = [f"marks/statics/{len(drawn) + i}" for i in range(len(planned))]
    if planned:
        page = page.with_moving(paths[-1], way)
    settings: dict[str, object] = {
        "title": given.title,
        "start": first if given.start is None else a_time("start", given.start, first, last),
        "follow": follows,
        "trace": bool(given.trace),
        "playing": bool(given.playing),
        "charts": described(times, charts) if charts else None,
        "named": legend_of([*given_regions, *planned[-1:]]) + [(n, c) for n, c, _ in surface_entries(page.surfaces)],
        "card": None if shown.card is None else asdict(shown.card),
        "spans": [{"path": path, "from": a, "to": b} for path, (a, b) in zip(paths, spans, strict=True)],
    }
    if sheet is not None:
        settings["sheet"] = sheet
    scene.stand_on(*page.terrains, *page.surfaces)
    whole = page.whole(settings, given.pace)
    scene.stage_motion(whole, page.around(follows), page.further_parts, title=given.title, seen_from=camera)
    if drawn or planned:
        scene.draw(*drawn, *planned)
    return scene


def _beside(second: ShownMotion, first: MotionPage, given: Playback) -> MotionPage:
    """The frames of a motion that is to be shown beside a first one, of its robot or another."""
    parts: Sequence[RobotPart] = robot_parts(second.robot)
    if len(parts) == len(first.parts) and all(one.looks_like(other) for one, other in zip(parts, first.parts, strict=True)):
        parts = first.parts  # their meshes are in the page already
    return _page(second, parts, first.sizes, first.ground, replace(given, external=given.beside_external))


def _page(shown: ShownMotion, parts: Sequence[RobotPart], sizes: Sizes, ground: bool, given: Playback) -> MotionPage:
    joints = sorted({part.joint for part in parts} - {0})
    frames = frames_of(shown, joints, fps=given.fps, speed=given.pace, external=given.external)
    return MotionPage(shown, frames, parts, sizes, ground)


def motion_sheet(
    motion: Trajectory | Motion | MotionReport | AuditReport | EnginesCompared | Plan | PlanarMotion,
    times: Sequence[float] | Array | int,
    png_path: str | PathLike[str],
    *,
    columns: int | None = None,
    width: int = 360,
    height: int = 360,
    browser: Browser | None = None,
    **settings: Any,
) -> Path:
    """Draw a motion at some times side by side, all from one camera, with the time under each; returns the picture's path.

    Args:
        motion: As for `export_motion`.
        times: When [s], or how many pictures evenly from the first to the last.
        png_path: Path of the picture.
        columns: Pictures in a row; all of them by default.
        width: Of one picture, in pixels.
        height: Of one picture without its caption, in pixels.
        browser: An open browser; by default one is started.
        **settings: Others of `export_motion`, as `external`, `ghost`, `follow`, `trace`, `ground` and `seen_from`.

    Raises:
        InputError: no motion, times outside it, invalid sizes, unknown settings.
        PictureError: no browser, or it made no picture.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.motion_sheet(swing, 4, "swing.png")  # doctest: +SKIP
        PosixPath('swing.png')
    """
    given = Playback.of({"charts": False, **settings})
    if a_path("the picture", png_path).suffix.lower() != ".png":
        raise PictureError(f"cannot write the picture {str(png_path)!r:.80}: expected a name that ends in .png.")
    picture = a_picture(png_path)
    width, height = check_size(width, height, MOST_SIZE)
    t = shown_motion(motion).t
    at = _picture_times(times, float(t[0]), float(t[-1]))
    in_a_row = len(at) if columns is None else min(check_whole("columns", columns, MOST_PICTURES), len(at))
    sheet = {"times": at, "columns": in_a_row, "width": width, "height": height, "gap": GAP}
    scene = motion_scene(motion, replace(given, start=at[0]), sheet)
    across = in_a_row * (width + GAP) - GAP
    down = math.ceil(len(at) / in_a_row) * (height + CAPTION_HEIGHT + GAP) - GAP
    return photograph(scene.page(), picture, across, down, browser)


def replay(
    motion: Trajectory | Motion | MotionReport | AuditReport | EnginesCompared | Plan | PlanarMotion,
    *,
    speed: float | None = None,
    scene: Scene | None = None,
    external: External | PushesAt = None,
) -> None:
    """Show a motion live: the page plays it as it opens; returns when it is over. Ctrl-C ends it sooner, and is no error.

    The page plays at the pace of the clock, can be paused and stepped, and stays as it is when the motion is over.

    Args:
        motion: As for `export_motion`.
        speed: Seconds of motion a second; by default 1, of a planar chain 0.5.
        scene: The live scene to show it in: `Scene(robot)` of the same robot, with `scene.open()` called. By default a new
            one is opened in the browser, on 127.0.0.1, and closed afterwards.
        external: The external forces that were given to `rbd.simulate`.

    Raises:
        InputError: no motion, or a scene of another robot.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.replay(swing, speed=0.5)  # doctest: +SKIP
    """
    check_kind("scene", scene, Scene | None, "a rbd.visual.Scene, or None")
    shown = shown_motion(motion)
    given = Playback(speed=speed, external=external, charts=False, trace=False, playing=True).resolved(shown)
    used = motion_scene(motion, given, scene=scene)
    with contextlib.ExitStack() as closing:
        closing.enter_context(contextlib.suppress(KeyboardInterrupt))
        if scene is None:
            closing.enter_context(used)
            used.open()
            used.wait_for_viewer(VIEWER_SECONDS)
        try:
            time.sleep(float(shown.t[-1] - shown.t[0]) / given.pace)
        except KeyboardInterrupt:
            used.pause_motion()


def _picture_times(times: Sequence[float] | Array | int, first: float, last: float) -> list[float]:
    if isinstance(times, int | np.integer) and not isinstance(times, bool):
        return [float(t) for t in np.linspace(first, last, check_whole("times", times, MOST_PICTURES))]
    given = as_array("times", times)
    if given.ndim != 1 or not 1 <= len(given) <= MOST_PICTURES:
        raise InputError(f"times have the shape {given.shape}; expected 1 to {MOST_PICTURES} times in a list.")
    return [a_time("a time", float(t), first, last) for t in given]
