"""A report on a motion as a page, as curves, or live: forces, the missing wrench, causes over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.motion.causes import CAUSES
from rbd.motion.report import MotionReport
from rbd.simulation.simulated_motion import OPEN, SLIPS, STICKS, Event
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.pages.page import write_page
from rbd.visual.playback.animation import FAR, play_live
from rbd.visual.playback.curves import (
    BOLD,
    FINE,
    GREY,
    Choice,
    CurveChart,
    CurveLine,
    a_list,
    chart,
    described,
    most_used,
    top_of,
)
from rbd.visual.playback.motion_frames import MOST_NUMBERS, Track
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.playback.staging import Playback, a_time, checked, staged
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.scene import Scene
from rbd.visual.style import CONTACT_COLORS, WRENCH_COLOR, a_page, contact_colors, distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from rbd.motion.reference_motion import Motion
    from rbd.simulation.trajectory import Trajectory


def report_charts(report: MotionReport, choice: Choice = True) -> list[CurveChart]:
    """The charts of a report: the missing wrench, torques, friction, centre of pressure; or those that are named.

    Args:
        report: The report.
        choice: True: all that there are numbers for; or names: "missing wrench", "torques", "friction", "centre of pressure",
            and "angles", "speeds", "height" of `curves.CHARTS`.

    Raises:
        InputError: an unknown name, or one that there are no numbers for.
    """
    threshold = 100.0 * report.settings.threshold
    missing = [
        CurveLine("3 × noise", GREY, 300.0 * report.open, FINE),
        CurveLine("missing", WRENCH_COLOR, 100.0 * report.missing_scaled),
    ]
    own = [
        chart("missing wrench", "missing wrench, % of the weight", missing, limits={"threshold": threshold},
              least_top=5.0 * threshold, percentile=98.0)
    ]  # fmt: skip
    if np.isfinite(report.limit).any():
        names = report.motion.robot.actuated_names
        own.append(most_used("torques", "motor torques, % of their limits", names, 100.0 * report.used_torque, limit=100.0))
    group, touches = report.lanes.points.group, report.lanes.touches
    place = {str(c.name): g for g, c in enumerate(report.lanes.contacts) if touches[:, group == g].any()}
    colors = contact_colors(place)
    if place:
        used = [CurveLine(name, colors[name], 100.0 * report.used_friction[:, g]) for name, g in place.items()]
        own.append(
            chart("friction", f"friction used, % (coefficient {report.friction:g})", used, limits={"limit": 100.0},
                  least_top=120.0, percentile=99.5)
        )  # fmt: skip
    if any(np.isfinite(report.edge_margin[:, g]).any() for g in place.values()):
        edges = [CurveLine(name, colors[name], 1e3 * report.edge_margin[:, g]) for name, g in place.items()]
        own.append(chart("centre of pressure", "centre of pressure: distance from the sole's edge, mm", edges))
    if isinstance(choice, bool):
        return own if choice else []
    known = {one.name: one for one in own}
    return [known[name] if name in known else charts_of(report.motion, [name])[0] for name in a_list(choice)]


def plot_report(axes: Axes | Sequence[Axes] | None, report: MotionReport) -> list[Artist]:
    """Curves over time: the missing wrench with its threshold and its noise, and the torques in % of their limits.

    Frames that are not possible are shaded.

    Args:
        axes: Matplotlib axes for the missing wrench, or two, the second for the torques; None: both on a new figure, that of
            `artists[0].figure`.
        report: What `rbd.check_motion` returned.

    Returns:
        The lines of the missing wrench, three times the noise and the threshold, then those of the torques and their limit,
        then the shades.

    Raises:
        InputError: no report, or what are no axes; no Matplotlib.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=20.0)
        >>> artists = rbd.visual.plot_report(None, rbd.check_motion(hop))
        >>> [axes.get_ylabel() for axes in artists[0].figure.axes]
        ['missing wrench [% of the weight]', 'torque [% of its limit]']
    """
    if not isinstance(report, MotionReport):
        raise InputError(f"report is {report!r:.80}; expected what rbd.check_motion returned.")
    given = _two_axes(axes)
    t, missing = report.motion.t, given[0]
    drawn: list[Artist] = [
        *missing.plot(t, 100.0 * report.missing_scaled, color=WRENCH_COLOR, lw=BOLD, label="missing", zorder=3),
        *missing.plot(t, 300.0 * report.open, color=GREY, lw=1.2, label="three times the noise", zorder=2),
        missing.axhline(threshold := 100.0 * report.settings.threshold, color="0.2", lw=FINE, ls="--", label="threshold"),
    ]
    missing.set_ylim(0.0, top_of(100.0 * report.missing_scaled, 3.0 * threshold, 100.0))
    missing.set_ylabel("missing wrench [% of the weight]")
    if len(given) > 1:
        for line in (x for one in report_charts(report) if one.name == "torques" for x in one.lines):
            above = 2 if line.color == GREY else 3
            drawn += given[1].plot(t, line.values, label=line.name, color=line.color, lw=line.width, zorder=above)
        drawn.append(given[1].axhline(100.0, color="0.2", lw=FINE, ls="--", label="limit"))
        given[1].set_ylabel("torque [% of its limit]")
        given[1].set_ylim(bottom=0.0)
    for ax in given:
        low, high = ax.get_ylim()
        drawn.append(
            ax.fill_between(t, low, high, where=~report.possible, color="#d55e00", alpha=0.10, lw=0.0, step="mid",
                            label="not possible")
        )  # fmt: skip
        ax.set_ylim(low, high)
        ax.set_xlim(float(t[0]), float(t[-1]))
        frame(ax, "y")
        ax.legend(frameon=False, fontsize=8, ncols=2)
    given[-1].set_xlabel("time [s]")
    return drawn


def _two_axes(axes: Any) -> list[Axes]:
    if axes is None:
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise InputError("plots need Matplotlib. Install the extra: pip install 'rbd-contact[plot]'") from None
        return list(Figure(figsize=(8.0, 5.6), layout="constrained").subplots(2, sharex=True))
    given = list(np.ravel(np.asarray(axes, dtype=object)))
    if not 1 <= len(given) <= 2:
        raise InputError(f"axes are {len(given)}; expected one, or two.")
    for ax in given:
        an_axis(ax)
    return given


MOMENT_ARM = 0.3
"""A missing moment is drawn as the force that has it at this distance [m], as the report weighs it."""
MOMENT_COLOR = "#8a2f4f"
MOST_FPS = 120.0
"""Motions of a higher rate are shown at the page's own."""
_YES = "yes"


@dataclass(frozen=True)
class WorstFrame(Event):
    """The worst frame of a cause, as a mark on the bar.

    Attributes:
        words: What it says.
    """

    words: str = ""

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True, eq=False)
class Played:
    """A report in the form of a trajectory that can be shown; heights are those above the floor.

    Attributes:
        robot: The robot.
        t: Times, shape (n,) [s].
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        points: {contact: its points in W, shape (n, k, 3) [m]}, of contacts that ever touch.
        point_forces: {contact: the forces there, shape (n, k, 3) [N]}.
        modes: {contact or cause: its mode at each frame}.
        events: Touches, and the worst frame of each cause.
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    points: Mapping[str, Array]
    point_forces: Mapping[str, Array]
    modes: Mapping[str, Sequence[str]]
    events: tuple[Event, ...]

    @classmethod
    def of(cls, report: MotionReport) -> Played:
        """That of a report."""
        motion, lanes = report.motion, report.lanes
        q, places = np.array(motion.q), lanes.places - [0.0, 0.0, lanes.ground]
        q[:, 2] -= lanes.ground
        points, forces, modes = {}, {}, {}
        events: list[Event] = []
        for g, contact in enumerate(lanes.contacts):
            own = lanes.points.group == g
            on: Array = np.asarray(lanes.touches[:, own].any(axis=1))
            slips = lanes.slides[:, own].any(axis=1)
            if not on.any():
                continue
            name = str(contact.name)
            points[name], forces[name] = places[:, own], report.forces[:, own]
            modes[name] = np.where(slips, SLIPS, np.where(on, STICKS, OPEN)).tolist()
            for i in (np.flatnonzero(np.diff(on)) + 1).tolist():
                corner = int(lanes.touches[i if on[i] else i - 1, own].argmax())
                events.append(Event(float(motion.t[i]), name, "touches" if on[i] else "leaves", corner))
        for cause in CAUSES:
            if (found := report.of_cause(cause)).any():
                modes[cause] = np.where(found, _YES, OPEN).tolist()
                events.append(_worst(report, cause))
        return cls(motion.robot, motion.t, q, motion.v, points, forces, modes, tuple(events))


def export_report(
    path: str | PathLike[str],
    report: MotionReport,
    *,
    fps: float | None = None,
    speed: float = 1.0,
    title: str | None = None,
    start: float | None = None,
    ghost: Trajectory | Motion | None = None,
    charts: Choice = True,
    follow: bool | None = None,
    trace: bool = False,
    seen_from: Sequence[float] | Array | None = None,
    arrow_per_weight: float | None = None,
    layers: Mapping[str, bool] | None = None,
    view: str = "start",
) -> Path:
    """Write the report as one HTML page that needs no network and no server; returns its path.

    The robot moves with its contact forces and with the wrench that is missing, as a force at the centre of mass and as a
    moment over 0.3 m. Above the bar are a lane for each contact and one for each cause, with a mark at its worst frame; beside
    the robot are curves of the missing wrench, of torques and of friction. Page up and page down go from mark to mark; keys and
    settings are those of `rbd.visual.export_motion`.

    Args:
        path: Of the page, ends in .html.
        report: What `rbd.check_motion` returned, of two frames at least.
        fps: Frames a second of playback at `speed`; by default those of the motion, up to 120.
        speed: Seconds of motion a second at first.
        title: Headline; by default the motion's source and how many frames are possible.
        start: Time at which the page opens [s]; by default the frame in which most is missing, the first if nothing is.
        ghost: A second motion of the same robot, drawn translucent in one colour, as the reference of a nearest motion.
        charts: Whether to draw the charts, or the names of some: "missing wrench", "torques", "friction", "centre of pressure",
            "angles", "speeds", "height".
        follow: Whether the camera initially follows the robot; by default if it travels far.
        trace: Whether to draw the path of the centre of mass.
        seen_from: Direction from the robot to the camera, in W, shape (3,); by default from the front left.
        arrow_per_weight: Length of an arrow as large as the robot's weight [m].
        layers: {layer: whether it is shown at first}, where that is to differ from `rbd.visual.pages.link.LAYERS`; the page can
            change it.
        view: Where the camera stands at first: "start", "front", "side" or "top".

    Raises:
        InputError: no report, one of a single frame, invalid settings.
        PictureError: the file cannot be written.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=20.0)
        >>> print(rbd.visual.export_report("hop.html", rbd.check_motion(hop)).name)
        hop.html
    """
    given = Playback.of(locals())
    target = a_page(path)
    scene = report_scene(report, given)
    write_page(target, scene.page(title or headline_of(report)))
    return target


def report_scene(report: MotionReport, given: Playback) -> Scene:
    """The scene of `export_report`, with all frames: to be written as a page, or served live.

    Args:
        report: As for `export_report`.
        given: Its settings; without external forces, a second motion beside, and footprints.

    Raises:
        InputError: as `export_report`.
    """
    played = checked_report(report)
    page, scene = _staged(report, played, replace(given, fps=_fps(report) if given.fps is None else given.fps))
    page = page.with_ghost(given.ghost, report.lanes.ground)
    first, last = float(played.t[0]), float(played.t[-1])
    bad = ~report.possible
    worst = float(played.t[int(np.argmax(np.where(bad, report.missing_scaled, -1.0)))]) if bad.any() else first
    begin = worst if given.start is None else a_time("start", given.start, first, last)
    follows = page.goes_far(FAR) if given.follow is None else bool(given.follow)
    drawn = report_charts(report, given.charts)
    settings = {"title": given.title or headline_of(report), "start": begin, "speed": float(given.speed), "follow": follows}
    settings |= {"trace": bool(given.trace), "playing": bool(given.playing)}
    settings["charts"] = described([report.motion.t], drawn) if drawn else None
    scene.stage_motion(page.whole(settings), page.around(follows))
    return scene


def headline_of(report: MotionReport) -> str:
    """The motion's source, and how many of its frames are possible."""
    return f"{report.motion.source}: {int(report.possible.sum())} of {report.n} frames possible"


def show_report(report: MotionReport, *, speed: float = 1.0) -> None:
    """Show the motion live in the browser, with its forces and the missing wrench; returns when it is over.

    Args:
        report: What `rbd.check_motion` returned, of two frames at least.
        speed: Seconds of motion a second.

    Raises:
        InputError: no report, one of a single frame, an invalid speed.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> report = rbd.check_motion(rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=20.0))
        >>> rbd.visual.show_report(report)  # doctest: +SKIP
    """
    page, scene = _staged(report, checked_report(report), Playback(fps=30.0, speed=speed))
    play_live(page, scene, report.motion.source, float(speed))


def checked_report(report: object) -> Played:
    """A report in the form that can be shown.

    Raises:
        InputError: it is none, or it has a single frame.
    """
    if not isinstance(report, MotionReport):
        raise InputError(f"report is {report!r:.80}; expected what rbd.check_motion returned.")
    played = Played.of(report)
    checked(played)
    return played


def _fps(report: MotionReport) -> float | None:
    """The motion's own rate, so that each picture is one of its frames; None where those would be too many."""
    rate = report.motion.rate
    width = 8 * report.motion.robot.model.njoints + 6 * len(report.lanes.names)
    return rate if rate <= MOST_FPS and report.n * width <= MOST_NUMBERS else None


def _staged(report: MotionReport, played: Played, given: Playback) -> tuple[MotionPage, Scene]:
    """The frames with the missing wrench beside the contact forces, and a scene with the robot at its start."""
    page, scene = staged(played, given)  # type: ignore[arg-type]
    frames = page.frames
    at = frames.times
    missing = np.column_stack([np.interp(at, played.t, column) for column in report.missing.T])
    com = frames.com if len(frames.com) else np.zeros((len(at), 3))
    pushes = (
        Track("missing force", com[:, None], missing[:, None, :3], WRENCH_COLOR),
        Track(f"missing moment / {MOMENT_ARM:g} m", com[:, None], missing[:, None, 3:] / MOMENT_ARM, MOMENT_COLOR),
    )
    lanes = {cause: color for cause, color in cause_colors().items() if cause in frames.modes}
    return replace(page, frames=replace(frames, pushes=pushes), lanes=lanes), scene


def cause_colors() -> dict[str, str]:
    """{cause: colour}; none is the colour of one of the first contacts."""
    return dict(zip(CAUSES, distinct_colors(len(CONTACT_COLORS) + len(CAUSES))[len(CONTACT_COLORS) :], strict=True))


def _worst(report: MotionReport, cause: str) -> WorstFrame:
    i = int(report.worst(cause, 1)[0])
    t = float(report.motion.t[i])
    told = f"{t:.3f} s: {cause}, worst frame {i}"
    if cause in ("floats", "friction", "tips"):
        told += f", {_percent(100.0 * report.missing_scaled[i])} % of the weight missing"
    if cause == "motor":
        j = int(np.argmax(report.excess[i]))
        told += f", {report.motion.robot.actuated_names[j]} {_percent(100.0 * report.excess[i, j])} % beyond its limit"
    if cause == "torque-speed":
        told += f", {report.on_line(i)}"
    if cause == "sinks":
        told += f", {-1e3 * float(report.lanes.heights[i].min()):.0f} mm below the floor"
    return WorstFrame(t, cause, cause, words=told)


def _percent(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 or value == 0.0 else f"{value:.2g}"
