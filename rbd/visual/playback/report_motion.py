"""A report on a motion, as it is shown: contact forces, the missing wrench, causes over time, its charts, and its reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.terrain import Terrain
from rbd.motion.causes import CAUSES
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.difference import MotionDifference
from rbd.motion.reference_motion import Motion
from rbd.motion.report import MotionReport
from rbd.simulation.simulated_motion import OPEN, SLIPS, STICKS, Event
from rbd.visual.playback.curves import FINE, GREY, Choice, CurveChart, CurveLine, chart, most_used
from rbd.visual.playback.motion_frames import MOST_NUMBERS, body_poses
from rbd.visual.playback.shown_motion import ShownMotion, Track
from rbd.visual.playback.trajectory_charts import OF_POSES, Maker, chosen_charts, makers_of
from rbd.visual.robot_meshes import drawable
from rbd.visual.style import COM_COLOR, CONTACT_COLORS, WRENCH_COLOR, contact_colors, distinct_colors

MOMENT_ARM = 0.3
"""A missing moment is drawn as the force that has it at this distance [m], as the report weighs it."""
MOMENT_COLOR = "#8a2f4f"
MOST_FPS = 120.0
"""Motions of a higher rate are shown at the page's own."""
YES = "yes"
"""Mode of what is no contact where it is the case."""


def report_charts(report: MotionReport, choice: Choice = True) -> list[CurveChart]:
    """The charts of a report: the missing wrench, deviation, torques, friction, centre of pressure; or those that are named.

    Args:
        report: The report.
        choice: True: all that there are numbers for; or names: "missing wrench", "deviation", "torques", "friction", "centre of
            pressure", and "angles", "speeds", "height" of the motion.

    Raises:
        InputError: an unknown name, or one that there are no numbers for.
    """
    own = {
        "missing wrench": _missing, "deviation": _deviation, "torques": _torques, "friction": _friction,
        "centre of pressure": _pressure,
    }  # fmt: skip
    makers: dict[str, Maker] = {name: partial(make, report) for name, make in own.items()}
    poses = makers_of(report.motion)
    return chosen_charts(report.motion.robot.name, makers | {name: poses[name] for name in OF_POSES}, choice, tuple(own))


def _missing(report: MotionReport) -> CurveChart:
    threshold = 100.0 * report.settings.threshold
    lines = [
        CurveLine("3 × noise", GREY, 300.0 * report.open, FINE),
        CurveLine("missing", WRENCH_COLOR, 100.0 * report.missing_scaled),
    ]
    scale = {"limits": {"threshold": threshold}, "least_top": 5.0 * threshold, "percentile": 98.0}
    return chart("missing wrench", "missing wrench, % of the weight", lines, **scale)  # type: ignore[arg-type]


def _reference(report: MotionReport) -> Motion | None:
    """The motion of the report before, at the times and on the floor of this one; None without one of the same frames."""
    before, m = report.before, report.motion
    if before is None or before.n != report.n or not m.robot.is_like(before.motion.robot):
        return None
    q = before.motion.q.copy()
    q[:, 2] += report.lanes.zero - before.lanes.zero
    return replace(before.motion, t=m.t, q=q)


def _deviation(report: MotionReport) -> CurveChart | None:
    if (reference := _reference(report)) is None:
        return None
    off = MotionDifference.of(report.motion, reference)
    lines = [
        CurveLine("joints, rms", CONTACT_COLORS[0], 1e3 * np.sqrt(np.square(off.joints).mean(axis=1))),
        CurveLine("base", CONTACT_COLORS[1], 1e3 * np.linalg.norm(off.base, axis=1)),
        CurveLine("centre of mass", COM_COLOR, 1e3 * np.linalg.norm(off.com, axis=1)),
    ]
    return chart("deviation", "distance from the reference: base, centre of mass, mm; joints, mrad", lines, least_top=1.0)


def _torques(report: MotionReport) -> CurveChart | None:
    if not np.isfinite(report.limit).any():
        return None
    names = report.motion.robot.actuated_names
    return most_used("torques", "motor torques, % of their limits", names, 100.0 * report.used_torque, limit=100.0)


def _places(report: MotionReport) -> dict[str, int]:
    """{contact that touches at times: its number}."""
    group, touches = report.lanes.points.group, report.lanes.touches
    return {str(c.name): g for g, c in enumerate(report.lanes.contacts) if touches[:, group == g].any()}


def _of_contacts(report: MotionReport, values: Array) -> list[CurveLine]:
    """A line for each contact that touches at times, of values of shape (n, number of contacts)."""
    places = _places(report)
    return [CurveLine(name, color, values[:, places[name]]) for name, color in contact_colors(places).items()]


def _friction(report: MotionReport) -> CurveChart | None:
    lines = _of_contacts(report, 100.0 * report.used_friction)
    title = f"friction used, % (coefficient {report.friction:g})"
    return chart("friction", title, lines, limits={"limit": 100.0}, least_top=120.0, percentile=99.5) if lines else None


def _pressure(report: MotionReport) -> CurveChart | None:
    lines = _of_contacts(report, 1e3 * report.edge_margin)
    known = any(np.isfinite(line.values).any() for line in lines)
    return chart("centre of pressure", "centre of pressure: distance from the sole's edge, mm", lines) if known else None


@dataclass(frozen=True)
class WorstFrame(Event):
    """The worst frame of a cause, as a mark on the bar.

    Attributes:
        words: What it says.
    """

    words: str = ""

    def __str__(self) -> str:
        return self.words


def shown_report(report: MotionReport) -> ShownMotion:
    """A report as a motion that can be shown; heights are those above the floor, contacts those that ever touch.

    Beside one with a report before, of the same frames: its motion as a ghost, and lanes of its contacts.
    """
    motion, lanes, reference = report.motion, report.lanes, _reference(report)
    q, places = np.array(motion.q), lanes.places - [0.0, 0.0, lanes.zero]
    q[:, 2] -= lanes.zero
    points, forces, modes = {}, {}, {}
    events: list[Event] = []
    for name, g in _places(report).items():
        own, on = lanes.points.group == g, lanes.of_contact(name)
        points[name], forces[name], modes[name] = places[:, own], report.forces[:, own], _modes(lanes, name)
        for i in (np.flatnonzero(np.diff(on)) + 1).tolist():
            corner = int(lanes.touches[i if on[i] else i - 1, own].argmax())
            events.append(Event(float(motion.t[i]), name, "touches" if on[i] else "leaves", corner))
    names = dict[str, str]()
    if report.before is not None and reference is not None:
        names = {name: f"{name}, before" for name in _places(report.before)}
        modes |= {words: _modes(report.before.lanes, name) for name, words in names.items()}
    colors = contact_colors(dict.fromkeys([*points, *names]))
    for cause in CAUSES:
        if (found := report.of_cause(cause)).any():
            modes[cause] = np.where(found, YES, OPEN).tolist()
            events.append(_worst(report, cause))
    com = body_poses(motion.robot, q, ())[1][:, None]
    pushes = (
        Track("missing force", com, report.missing[:, None, :3], WRENCH_COLOR),
        Track(f"missing moment / {MOMENT_ARM:g} m", com, report.missing[:, None, 3:] / MOMENT_ARM, MOMENT_COLOR),
    )
    worst = 0 if report.possible.all() else int(np.argmax(np.where(report.possible, -1.0, report.missing_scaled)))
    return ShownMotion(
        report,
        drawable(motion.robot),
        motion.t,
        q,
        motion.v,
        headline_of(report),
        points,
        forces,
        modes,
        tuple(events),
        lanes={words: colors[name] for name, words in names.items()} | dict(cause_colors()),
        pushes=pushes,
        terrains=(lanes.ground,) if isinstance(lanes.ground, Terrain) else (),
        down=lanes.zero,
        charts=partial(report_charts, report),
        defaults={"trace": False, "fps": _fps(report), "start": float(motion.t[worst]), "ghost": reference},
    )


def _modes(lanes: ContactTimeline, name: str) -> list[str]:
    """Whether a contact sticks, slips or is open, at each frame."""
    own = lanes.points.group == [c.name for c in lanes.contacts].index(name)
    on, slips = (each[:, own].any(axis=1) for each in (lanes.touches, lanes.slides))
    return np.where(slips, SLIPS, np.where(on, STICKS, OPEN)).tolist()


def headline_of(report: MotionReport) -> str:
    """The motion's title, and how many of its frames are possible."""
    return f"{report.motion.title}: {int(report.possible.sum())} of {report.n} frames possible"


def _fps(report: MotionReport) -> float | None:
    """The motion's own rate, so that each picture is one of its frames; None where those would be too many."""
    rate = report.motion.rate
    width = 8 * report.motion.robot.model.njoints + 6 * len(report.lanes.names)
    return rate if rate <= MOST_FPS and report.n * width <= MOST_NUMBERS else None


def cause_colors() -> Mapping[str, str]:
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
    if cause == "tilted sole":
        told += f", {np.rad2deg(float(report.feet_faults.tilt[i].max())):.0f} degrees"
    if cause == "grasp":
        told += f", {report.grasps.words(i, i + 1)}"
    if cause == "hovering foot":
        told += f", {1e3 * float(report.feet_faults.hover[i].max()):.0f} mm above the floor"
    if cause == "sinks":
        told += f", {-1e3 * float(report.lanes.heights[i].min()):.0f} mm below the floor"
    return WorstFrame(t, cause, cause, words=told)


def _percent(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 or value == 0.0 else f"{value:.2g}"
