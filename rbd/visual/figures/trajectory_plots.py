"""Plots of motions on given axes: forces with contact modes, energies, joints with their limits.

Axes first, artists out, no window, no global state. Colours of contacts are those of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import ANGLE, FORCE_OF, PURE, Coordinate
from rbd.motion.report import MotionReport
from rbd.motion.retiming.timing import Timing
from rbd.simulation.simulated_motion import HOLDS, OPEN, PUSHES, SLIPS, STICKS
from rbd.simulation.trajectory import Trajectory
from rbd.visual.figures.plots import an_axis, axes_of, axes_or_new, cut_peaks, frame
from rbd.visual.playback.curves import GREY, CurveChart
from rbd.visual.playback.report_motion import report_charts
from rbd.visual.playback.trajectory_charts import energy_curves
from rbd.visual.style import CONTACT_COLORS, contact_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_BOLD, _FINE, _HAIR = 1.7, 0.9, 0.6
"""Line widths of main curves, of secondary curves, of marks [points]."""
_GREY = "0.45"
_CAUSES = 5
"""Causes of a timing that have a colour."""
_ROW = 0.045
"""Height of a contact's band, as a share of the axes' height."""
_MODES: dict[str, dict[str, Any]] = {
    STICKS: {"alpha": 0.85, "linewidth": 0.0},
    HOLDS: {"alpha": 0.85, "linewidth": 0.0},
    PUSHES: {"alpha": 0.45, "linewidth": 0.0},
    SLIPS: {"hatch": "//////", "linewidth": _HAIR},
}
"""Fill of each mode; open contacts are empty."""
_BURST, _OFTEN = 3.0, 98.0
"""(factor, per cent): a peak beyond this factor times the percentile of the samples is cut off."""
WHATS = ("q", "v", "a", "tau")
_NONE = 1e100
"""Limits beyond it mean that there are none."""


def plot_forces(ax: Axes, trajectory: Trajectory, *, names: Sequence[str] | None = None) -> list[Artist]:
    """Forces over time, and below them the mode of each contact: sticks, slips or open.

    Of a contact the vertical force is a bold line and the size of the horizontal one a fine one (world axes, on the robot); of
    any other constraint each row is a line. Hairlines mark beginnings and ends of contact, dotted ones events of yours; the
    dotted line across is the weight of a floating robot, if a force comes near it. A peak that would hide all else is cut off,
    with a note. The impulse of an impact is no force: it is in `trajectory.events`.

    Args:
        ax: Matplotlib axes, empty. The band is a child of them and carries the time axis.
        trajectory: What `rbd.simulate` returns.
        names: Names of constraints; all contacts by default, or all constraints if there is no contact.

    Returns:
        The artists: two lines a contact and one a row of other constraints, then bands, hairlines and notes.

    Raises:
        InputError: if `ax` are no axes, or a name is unknown.

    Example:
        >>> from matplotlib.figure import Figure
        >>> corner = rbd.PointContact("corner", "box", friction=0.6, on=0.0)
        >>> fall = rbd.simulate(rbd.State(rbd.testing.box(), [0, 0, 0.02, 0, 0, 0, 1]), [corner], duration=0.1, step=1e-2)
        >>> vertical, horizontal, *marks = rbd.visual.plot_forces(Figure().subplots(), fall)
        >>> vertical.get_label(), vertical.get_ydata()[[0, -1]].round(1)  # in the air, and at rest
        ('corner', array([ 0. , 98.1]))
    """
    _check(ax, trajectory)
    chosen = _chosen(trajectory, names)
    colors = contact_colors((*trajectory.contacts, *trajectory.names))
    t, curves = trajectory.t, list[Array]()
    drawn: list[Artist] = []
    for name in chosen:
        force, color = trajectory.forces[name], colors[name]
        if name in trajectory.points:
            rows = [force[:, 2], np.hypot(force[:, 0], force[:, 1])]
            drawn += ax.plot(t, rows[0], color=color, lw=_BOLD, label=name, zorder=3)
            drawn += ax.plot(t, rows[1], color=color, lw=_FINE, alpha=0.8, zorder=2)
        else:
            rows = list(force.T)
            for k, row in enumerate(rows):
                label = name if len(rows) == 1 else f"{name}, row {k + 1}"
                look: dict[str, Any] = {"lw": _BOLD if k == 0 else _FINE, "alpha": 0.5 ** (k / 3), "zorder": 3}
                drawn += ax.plot(t, row, color=color, label=label, **look)
        curves += rows
    notes = cut_peaks(ax, t, np.array(curves).T, "N", factor=_BURST, often=_OFTEN) if curves else []
    weight = trajectory.robot.mass * float(np.linalg.norm(trajectory.robot.gravity))
    carried = max((np.abs(trajectory.forces[x][:, :3]).max(initial=0.0) for x in chosen if x in trajectory.points), default=0.0)
    if trajectory.robot.floating and carried > 0.4 * weight:
        notes.append(ax.axhline(weight, color=_GREY, lw=_HAIR + 0.2, ls=":", zorder=1, label=f"weight {weight:.4g} N"))
    notes += _event_marks(ax, trajectory, chosen, colors)
    _dress(ax, trajectory, "force [N]" if all(name in trajectory.points for name in chosen) else "force [N, N m]")
    bands = _bands(ax, trajectory, chosen, colors)
    _legend(ax, _keys(trajectory, chosen))
    return drawn + bands + notes


def plot_energy(ax: Axes, trajectory: Trajectory) -> list[Artist]:
    """Kinetic, potential and total energy over time; potential relative to the start.

    Where there are springs, their energy too; and where dampers take work out, the sum of the total and this work.

    Args:
        ax: Matplotlib axes, empty.
        trajectory: What `rbd.simulate` returns.

    Returns:
        The lines of kinetic, potential and total energy, then those of springs and dampers, then hairlines at contact events.

    Raises:
        InputError: if `ax` are no axes.

    Example:
        >>> from matplotlib.figure import Figure
        >>> fall = rbd.simulate(rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1]), duration=0.2, step=1e-2)
        >>> kinetic, potential, total = rbd.visual.plot_energy(Figure().subplots(), fall)
        >>> print(kinetic.get_label(), kinetic.get_ydata()[[0, -1]].round(3))  # m (g t)^2 / 2
        kinetic [ 0.    19.247]
    """
    _check(ax, trajectory)
    drawn: list[Artist] = []
    for line in energy_curves(trajectory):
        label, total = line.name, line.name == "total"
        if total:
            change = line.values[-1] - line.values[0]
            label = f"total, changes by {change:.3g} J".replace("by -", "by \N{MINUS SIGN}")
        drawn += ax.plot(trajectory.t, line.values, color=line.color, lw=_BOLD, label=label, zorder=4 if total else 3)
    marks = _event_marks(ax, trajectory, trajectory.contacts)
    _dress(ax, trajectory, "energy [J]")
    _legend(ax, [])
    return drawn + marks


def plot_joint(ax: Axes, trajectory: Trajectory, joint: str | Sequence[str], *, what: str = "q") -> list[Artist]:
    """A joint's position, velocity, acceleration or torque over time, its limits dashed.

    A limit far away from all values is named in the legend and not drawn: it would flatten the motion.

    Args:
        ax: Matplotlib axes, empty.
        trajectory: What `rbd.simulate` returns.
        joint: A joint's name, or several; of a joint with several degrees of freedom one of its coordinates, as "root_joint.z".
        what: "q" (a continuous joint's angle is not wrapped), "v", "a" or "tau".

    Returns:
        A line a joint, then the dashed limits that are in sight, then hairlines at contact events.

    Raises:
        InputError: if `ax` are no axes; an unknown joint; joints whose values have different units.

    Example:
        >>> from matplotlib.figure import Figure
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> lines = rbd.visual.plot_joint(Figure().subplots(), swing, ["crank_joint", "rocker_joint"], what="v")
        >>> [line.get_label() for line in lines]
        ['crank_joint (limit ±100 rad/s)', 'rocker_joint (limit ±100 rad/s)']
    """
    _check(ax, trajectory)
    curves = joint_curves(trajectory, joint, what)
    drawn: list[Artist] = []
    limits: list[Artist] = []
    low, high = min(float(c.values.min()) for c in curves), max(float(c.values.max()) for c in curves)
    span = high - low or max(abs(high), 1.0) * 0.1
    for i, curve in enumerate(curves):
        color = CONTACT_COLORS[i % len(CONTACT_COLORS)]
        near = [x for x in curve.limits if low - 0.6 * span <= x <= high + 0.6 * span]
        far = [x for x in curve.limits if x not in near]
        drawn += ax.plot(trajectory.t, curve.values, color=color, lw=_BOLD, label=_label(curve, far), zorder=3)
        limits += [ax.axhline(x, color=color, lw=1.1, ls=(0, (5, 3)), zorder=2) for x in near]
        limits += [ax.plot(trajectory.t, x, color=color, lw=1.1, ls=(0, (5, 3)), zorder=2)[0] for x in curve.at_speed]
    marks = _event_marks(ax, trajectory, trajectory.contacts)
    _dress(ax, trajectory, f"{curves[0].quantity} [{curves[0].unit}]")
    _legend(ax, [_line("limit", color=_GREY, lw=1.1, ls=(0, (5, 3)))] if limits else [])
    return drawn + limits + marks


def plot_report(axes: Axes | Sequence[Axes] | None, report: MotionReport) -> list[Artist]:
    """Curves over time: the missing wrench with its threshold and its noise, and the torques in % of their limits.

    Frames that are not possible are shaded.

    Args:
        axes: Matplotlib axes for the missing wrench, or two, the second for the torques; None: both on a new figure, that of
            `artists[0].figure`.
        report: What `rbd.check_motion` returned.

    Returns:
        The lines of three times the noise, of the missing wrench and its threshold, then those of the torques and their limit,
        then the shades.

    Raises:
        InputError: no report, or what are no axes; no Matplotlib.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=20.0)
        >>> artists = rbd.visual.plot_report(None, rbd.check_motion(hop))
        >>> [axes.get_ylabel() for axes in artists[0].figure.axes]
        ['missing wrench, % of the weight', 'motor torques, % of their limits']
    """
    check_kind("report", report, MotionReport, "what rbd.check_motion returned")
    given, t = axes_of(axes, 2, (8.0, 5.6), sharex=True), report.motion.t
    charts = report_charts(report, ["missing wrench"])
    charts += [made for made in report_charts(report) if made.name == "torques"]
    drawn = [artist for ax, made in zip(given, charts, strict=False) for artist in draw_chart(ax, t, made)]
    for ax in given:
        low, high = ax.get_ylim()
        look: dict[str, Any] = {"color": "#d55e00", "alpha": 0.10, "lw": 0.0, "step": "mid", "label": "not possible"}
        drawn.append(ax.fill_between(t, low, high, where=~report.possible, **look))
        ax.set(ylim=(low, high), xlim=(float(t[0]), float(t[-1])))
        ax.legend(frameon=False, fontsize=8, ncols=2)
    given[-1].set_xlabel("time [s]")
    return drawn


def plot_timing(ax: Axes | None, timing: Timing) -> list[Artist]:
    """How much faster than it was a motion is along its path, s', below the largest s' that each point allows by itself.

    The line has a colour for each of the causes that bind it longest; the others are grey.

    Args:
        ax: Matplotlib axes; None: those of a new figure of pyplot.
        timing: What `rbd.motion.find_timing` returned.

    Returns:
        The line of the largest s', that of s' = 1, then the coloured ones.

    Raises:
        InputError: no timing, or what are no axes; no Matplotlib.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> arm = arm.with_motors({"joint_1": rbd.Motor(limit=8.0)})
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([-1.5]), np.array([0.0])], [0.0, 0.6])
        >>> [line.get_label() for line in rbd.visual.plot_timing(None, rbd.motion.find_timing(motion))]
        ['possible by itself', 'as it was', 'fastest', 'motor of joint_1']
    """
    check_kind("timing", timing, Timing, "what rbd.motion.find_timing returned")
    ax, s, shares = axes_or_new(ax), timing.s, timing.shares()
    an_axis(ax)
    drawn: list[Artist] = []
    drawn += ax.plot(s, timing.most(), color=_GREY, lw=_FINE, ls="--", label="possible by itself", zorder=2)
    drawn.append(ax.axhline(1.0, color=_GREY, lw=_HAIR, label="as it was", zorder=1))
    causes, named = np.array(timing.causes), list(shares)[:_CAUSES]
    for name, color in zip([*named, ""], [*CONTACT_COLORS[: len(named)], _GREY], strict=True):
        own = causes == name if name else ~np.isin(causes, named)
        ends = np.concatenate([own, [False]]) | np.concatenate([[False], own])
        if own.any():
            gaps = np.where(ends, timing.pace, np.nan)
            drawn += ax.plot(s, gaps, color=color, lw=_BOLD, label=name or "other", zorder=3)
    top = 1.05 * max(float(timing.pace.max()), 1.0)
    ax.set(xlim=(s[0], s[-1]), ylim=(0.0, top), xlabel="time as it was, s [s]", ylabel="pace s' [1]")
    frame(ax, "y")
    ax.legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return drawn


def draw_chart(ax: Axes, t: Array, chart: CurveChart) -> list[Artist]:
    """A chart of a motion on axes, over times of shape (n,) [s]: its lines, then its limits, dashed."""
    drawn: list[Artist] = []
    for line in chart.lines:
        above = 2 if line.color == GREY else 3
        drawn += ax.plot(t, line.values, label=line.name, color=line.color, lw=line.width, zorder=above)
    drawn += [ax.axhline(limit, color="0.2", lw=_FINE, ls="--", label=name) for name, limit in chart.limits.items()]
    ax.set(ylim=(chart.low, chart.top), ylabel=chart.title)
    frame(ax, "y")
    return drawn


def _check(ax: Axes, trajectory: Trajectory) -> None:
    an_axis(ax)
    check_kind("trajectory", trajectory, Trajectory, "what rbd.simulate returns")


def _chosen(trajectory: Trajectory, names: Sequence[str] | None) -> tuple[str, ...]:
    if names is None:
        return trajectory.contacts or trajectory.names
    if isinstance(names, str) or not np.iterable(names):
        raise InputError(f"names are {names!r:.80}; expected a list of constraints' names.")
    if not len(list(names)):
        raise InputError("names are empty; expected some of the constraints' names, or None for all contacts.")
    for name in names:
        if not isinstance(name, str) or name not in trajectory.names:
            raise InputError(f"no constraint {name!r:.80} in this trajectory; {nearest(name, trajectory.names)}.")
    return tuple(dict.fromkeys(names))


def _dress(ax: Axes, trajectory: Trajectory, label: str) -> None:
    frame(ax, "y")
    ax.set(xlabel="time [s]", ylabel=label)
    if len(trajectory) > 1:
        ax.set_xlim(trajectory.t[0], trajectory.t[-1])


def _event_marks(ax: Axes, trajectory: Trajectory, names: Iterable[str], colors: dict[str, str] | None = None) -> list[Artist]:
    """A hairline for each time at which a contact begins or ends, in its colour or grey; events of yours are dotted."""
    out: list[Artist] = []
    for name in [*names, *sorted({e.name for e in trajectory.events} - set(trajectory.names))]:
        own = name not in trajectory.forces
        times = sorted({e.t for e in trajectory.events if e.name == name and (own or e.kind in ("touches", "leaves"))})
        if times:
            faint, color = min(0.55, 10.0 / len(times)), _GREY if own else colors[name] if colors else "0.6"
            look: dict[str, Any] = {"color": color, "lw": _HAIR, "alpha": faint, "ls": ":" if own else "-", "zorder": 1}
            out.append(ax.vlines(times, 0.0, 1.0, transform=ax.get_xaxis_transform(), **look))
    return out


def _bands(ax: Axes, trajectory: Trajectory, names: Sequence[str], colors: dict[str, str]) -> list[Artist]:
    """One row a constraint below the axes, filled by its mode; the time axis moves below them."""
    height = _ROW * len(names)
    below = ax.inset_axes((0.0, -0.03 - height, 1.0, height), sharex=ax)
    below.set(xlabel=ax.get_xlabel(), ylim=(len(names) - 0.5, -0.5), yticks=[])
    ax.set_xlabel("")
    ax.tick_params(axis="x", labelbottom=False, length=0)
    below.spines[["top", "right", "left"]].set_visible(False)
    out: list[Artist] = []
    for y, name in enumerate(names):
        out.append(below.axhline(y, color=colors[name], lw=_HAIR, alpha=0.6))
        for mode, style in _MODES.items():
            if found := spans(trajectory.t, trajectory.modes[name] == mode):
                out.append(below.broken_barh(found, (y - 0.36, 0.72), zorder=2, **_filled(colors[name], style)))
    return out


def spans(t: Array, there: Array) -> list[tuple[float, float]]:
    """(begin, length) of each run of samples; a sample covers the time to the next one."""
    edges = np.flatnonzero(np.diff(np.r_[False, there, False]))
    ends = np.r_[t, t[-1]]
    return [(t[a], ends[b] - t[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _filled(color: str, style: dict[str, Any]) -> dict[str, Any]:
    return {"facecolor": "white" if "hatch" in style else color, "edgecolor": color, **style}


def _keys(trajectory: Trajectory, names: Sequence[str]) -> list[Artist]:
    """Legend of bold and fine lines and of each fill, in grey."""
    from matplotlib.patches import Patch

    out: list[Artist] = []
    if any(name in trajectory.points for name in names):
        out += [_line("vertical", color=_GREY, lw=_BOLD), _line("horizontal", color=_GREY, lw=_FINE, alpha=0.8)]
    shown = {str(mode) for name in names for mode in np.unique(trajectory.modes[name])} - {OPEN}
    out += [Patch(label=mode, **_filled(_GREY, style)) for mode, style in _MODES.items() if mode in shown]
    ends = any(e.name in names and e.kind in ("touches", "leaves") for e in trajectory.events)
    return out + [_line("touches, leaves", color=_GREY, lw=0.0, marker="|", ms=9.0, mew=_HAIR)] * ends


def _line(label: str, **style: Any) -> Artist:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)


def _legend(ax: Axes, more: list[Artist]) -> None:
    """Above the axes, where no curve runs."""
    handles = [*ax.get_legend_handles_labels()[0], *more]
    longest = max((len(str(h.get_label())) for h in handles), default=0)
    letters = 15.0 * ax.figure.get_figure(root=True).get_figwidth()  # that small print has room for in a line
    columns = max(1, min(len(handles), 5, int(letters / (longest + 8))))
    ax.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        frameon=False,
        fontsize="small",
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.4,
    )


def _label(curve: Curve, far: Sequence[float]) -> str:
    """The joint's name, with the limits that are out of sight."""
    if not far:
        return curve.name
    both = len(far) == 2 and far[0] == -far[1]
    values = f"±{far[1]:.4g}" if both else " and ".join(f"{x:.4g}" for x in far)
    return f"{curve.name} (limit {values} {curve.unit})"


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a plot.

    Attributes:
        name: Of the joint, or of one of its coordinates.
        quantity: "angle", "position", "velocity", "acceleration", "torque", "force" or "coordinate".
        unit: Its unit, as it is printed.
        values: Shape (n,).
        limits: Those that are the same all the time, in order.
        at_speed: Others, shape (n,): of torques of a motor with a torque-speed line.
    """

    name: str
    quantity: str
    unit: str
    values: Array
    limits: tuple[float, ...]
    at_speed: tuple[Array, ...] = ()


def joint_curves(trajectory: Trajectory, joints: str | Sequence[str], what: str) -> list[Curve]:
    """The curves of joints, all of one unit.

    Raises:
        InputError: an unknown joint or quantity; a joint without a motor, if torques are requested; several units.
    """
    if not isinstance(what, str) or what not in WHATS:
        raise InputError(f"what is {what!r:.80}; expected one of {', '.join(map(repr, WHATS))}.")
    asked = [joints] if isinstance(joints, str) else joints
    if not np.iterable(asked) or not len(list(asked)):
        raise InputError(f"joint is {joints!r:.80}; expected a joint's name, or a list of them.")
    out = [curve for name in asked for curve in _curves(trajectory, name, what)]
    units = list(dict.fromkeys(curve.unit for curve in out))
    if len(units) > 1:
        raise InputError(
            f"{joints!r:.80} has values in {' and in '.join(units)}; expected one unit. Name one, e.g. {out[0].name!r}."
        )
    return out


def _curves(trajectory: Trajectory, name: str, what: str) -> list[Curve]:
    robot, joints = trajectory.robot, trajectory.robot.joints
    if not isinstance(name, str):
        raise InputError(f"no joint {name!r:.80}; expected the name of a joint, or a list of names.")
    if what == "q" and name in joints and joints[name].is_continuous:
        cosine, sine = trajectory.q[:, joints[name].q].T
        return [Curve(name, "angle", ANGLE, np.unwrap(np.arctan2(sine, cosine)), ())]
    labels = joints.positions if what == "q" else robot.motor_coordinates if what == "tau" else joints.velocities
    if not (found := [i for i, c in enumerate(labels) if name in (c.name, c.joint)]):
        if what == "tau" and any(name in (c.name, c.joint) for c in joints.velocities):
            raise InputError(f"{name!r:.80} carries no motor; {nearest(name, [c.name for c in labels])}.")
        raise InputError(f"no joint {name!r:.80} in {robot.name}; {nearest(name, [*joints, *(c.name for c in labels)])}.")
    values = getattr(trajectory, what)
    lines = robot.limits_at(trajectory.v) if what == "tau" and robot.torque_lines else ()
    both = {i: tuple(each[:, i] for each in lines) if lines and robot.torque_lines.has(i) else () for i in found}
    limits = {i: (() if both[i] else _limits(robot, i, what), both[i]) for i in found}
    return [Curve(labels[i].name, *_quantity(labels[i], what), values[:, i], *limits[i]) for i in found]


def _quantity(coordinate: Coordinate, what: str) -> tuple[str, str]:
    """(quantity, unit)."""
    unit = coordinate.unit
    if what == "q":
        return {ANGLE: "angle", PURE: "coordinate"}.get(unit, "position"), unit
    if what == "tau":
        return ("torque" if unit == ANGLE else "force"), FORCE_OF[unit]
    return ("velocity", f"{unit}/s") if what == "v" else ("acceleration", f"{unit}/s²")


def _limits(robot: CheckedModel, i: int, what: str) -> tuple[float, ...]:
    """Limits of entry i; none if the file states none."""
    model, both = robot.model, tuple[float, ...]()
    if what == "q":
        low, high = float(model.lowerPositionLimit[i]), float(model.upperPositionLimit[i])
        both = (low, high) if low < high else ()
    elif what in ("v", "tau"):
        most = float(model.velocityLimit[i] if what == "v" else robot.effort_limit[i])
        both = (-most, most)
    return tuple(x for x in both if math.isfinite(x) and 0.0 < abs(x) < _NONE or x == 0.0 and what == "q")
