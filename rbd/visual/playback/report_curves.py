"""Curves of a report on a motion: the charts of its page, and the same with Matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.errors import InputError
from rbd.motion.report import MotionReport
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.playback.curves import BOLD, FINE, GREY, Chart, Choice, Line, a_list, chart, most_used, top_of
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.style import WRENCH_COLOR, contact_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


def report_charts(report: MotionReport, choice: Choice = True) -> list[Chart]:
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
        Line("3 × noise", GREY, 300.0 * report.open, FINE),
        Line("missing", WRENCH_COLOR, 100.0 * report.missing_scaled),
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
        used = [Line(name, colors[name], 100.0 * report.used_friction[:, g]) for name, g in place.items()]
        own.append(
            chart("friction", f"friction used, % (coefficient {report.friction:g})", used, limits={"limit": 100.0},
                  least_top=120.0, percentile=99.5)
        )  # fmt: skip
    if any(np.isfinite(report.edge_margin[:, g]).any() for g in place.values()):
        edges = [Line(name, colors[name], 1e3 * report.edge_margin[:, g]) for name, g in place.items()]
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
