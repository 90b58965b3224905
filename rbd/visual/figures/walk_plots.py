"""Plots of walks on given axes: a plan from above, from the side and over time; a controller's torques against their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Heights
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.control_log import ControlLog
from rbd.control.walking.plan import WalkPlan
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.visual.figures.plots import axes_of, frame
from rbd.visual.figures.trajectory_plots import draw_chart, spans
from rbd.visual.marks.terrain import EDGE_COLOR, faces_of
from rbd.visual.playback.curves import most_used
from rbd.visual.style import COM_COLOR, contact_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

WIDTH, ROW = 9.0, 0.26
"""Width of a figure, and height of a contact's bar [inches]."""
LOWEST, HIGHEST = 1.1, 4.8
"""Height of the view from above [inches]."""
AROUND = 0.12
"""Room around footprints and the centre of mass, as a share of their size, and at least so much over h."""
GREYS = (0.72, 0.94)
"""Brightness of the lowest and of the highest tread."""
SAMPLES = 61
"""Points of a way through the air."""


def plot_walk(axes: Axes | Sequence[Axes] | None, plan: WalkPlan) -> list[Artist]:
    """Draw a plan of a walk: from above, ways of feet from the side, and which foot stands when.

    From above: footprints, numbered in the order of their landing (those of one time share a number), the first stance without
    number, over treads of the terrain with their heights, and the path of the centre of mass. From the side: height of the feet
    in the air over how far they have come, and below it what is under them; of a foot that was put elsewhere on its way, from
    then on. Over time: a bar while a foot stands.

    Args:
        axes: Three Matplotlib axes, or the first, or the first two; None: three on a new figure, that of `artists[0].figure`.
        plan: `walk.plan`.

    Returns:
        The path of the centre of mass, then footprints, numbers, treads; ways of feet; bars.

    Raises:
        InputError: if `axes` are none or too many, or `plan` is no plan.

    Example:
        >>> walk = rbd.control.Walk(rbd.load_robot("solo12"), 2, gait="trot")
        >>> artists = rbd.visual.plot_walk(None, walk.plan)
        >>> [axes.get_xlabel() for axes in artists[0].figure.axes]
        ['x [m]', 'distance along its way [m]', 'time [s]']
    """
    check_kind("plan", plan, WalkPlan, "walk.plan of a rbd.control.Walk")
    low, high = _view(plan)
    above = float(np.clip(WIDTH * (high - low)[1] / (high - low)[0], LOWEST, HIGHEST))
    heights = [above, 1.5, 0.5 + ROW * len(plan.poses)]
    given = axes_of(axes, 3, (WIDTH, sum(heights) + 1.2), height_ratios=heights)
    panels = (_from_above, _from_the_side, _over_time)
    return [artist for ax, panel in zip(given, panels, strict=False) for artist in panel(ax, plan)]


def plot_control(axes: Axes | Sequence[Axes] | None, log: ControlLog) -> list[Artist]:
    """Draw what a controller did: motor torques in % of their limits, and contacts as planned (frame) and counted on (filled).

    The motors that come nearest to their limits have a curve each, the largest of the others one together.

    Args:
        axes: Two Matplotlib axes, or the first; None: both on a new figure, that of `artists[0].figure`.
        log: Of a controller, as `walk.log`.

    Returns:
        The lines of torques and of the limit, then the bars.

    Raises:
        InputError: if `axes` are none or too many; no log, or one without a step.

    Example:
        >>> walk = rbd.control.Walk(rbd.load_robot("solo12"), 1, gait="trot")
        >>> run = rbd.simulate(walk.state, walk.contacts, duration=0.1, step=2e-3, controller=walk, progress=False)
        >>> artists = walk.log.plot()
        >>> [axes.get_ylabel() for axes in artists[0].figure.axes]
        ['motor torques, % of their limits', '']
    """
    check_kind("log", log, ControlLog, "the log of a controller, as walk.log")
    if not len(log):
        raise InputError("log has no step of control yet; simulate with its controller first.")
    share = 100.0 * log.torque_use
    limited = bool(share.any()) or not log.tau.any()
    title = "motor torques, % of their limits" if limited else "motor torques, N or N m (no limits are known)"
    bars = 0.5 + ROW * len(log.planned)
    given = axes_of(axes, 2, (WIDTH, 3.6 + bars), height_ratios=[3.2, bars], sharex=True)
    values = share if limited else np.abs(log.tau)
    chart = most_used("torques", title, log.motors, values, limit=100.0 if limited else None)
    drawn = draw_chart(given[0], log.t, chart)
    given[0].legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    colors = contact_colors(log.planned)
    for ax in given[1:]:
        drawn += draw_bars(ax, {name: spans(log.t, on) for name, on in log.assumed.items()}, colors, alpha=0.6, linewidth=0.0)
        drawn += draw_bars(ax, {name: spans(log.t, on) for name, on in log.planned.items()}, colors, frames=True, linewidth=0.8)
    given[-1].set(xlim=(float(log.t[0]), float(log.t[-1]) or 1.0), xlabel="time [s]")
    return drawn


def draw_bars(
    ax: Axes, rows: Mapping[str, list[tuple[float, float]]], colors: Mapping[str, str], frames: bool = False, **look: Any
) -> list[Artist]:
    """A row of bars (begin, length) a name; frames alone, or filled."""
    frame(ax)
    ax.set(ylim=(len(rows) - 0.5, -0.5), yticks=range(len(rows)), yticklabels=list(rows))
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    return [
        ax.broken_barh(found, (y - 0.36, 0.72), facecolor="none" if frames else colors[name], edgecolor=colors[name], **look)
        for y, (name, found) in enumerate(rows.items())
    ]


def _prints(plan: WalkPlan) -> list[tuple[str, Array, int]]:
    """(foot, corners in W, number) of each foothold, shape (k, 3) [m]; 0 is the first stance."""
    times = sorted({round(step.end, 6) for step in plan.footsteps})
    number = {t: i + 1 for i, t in enumerate(times)}
    return [
        (foot, plan.outline(foot, X), number.get(round(lands, 6), 0)) for foot in plan.poses for X, lands, _ in plan.stays(foot)
    ]


def _view(plan: WalkPlan) -> tuple[Array, Array]:
    """(lowest, highest) corner of a box around all footprints and the centre of mass, shape (3,) [m]."""
    points = np.vstack([plan.centroid.com, *[corners for _, corners, _ in _prints(plan)]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = AROUND * max(float((high - low)[:2].max()), float((high - low)[2]))
    return low - 0.5 * room, high + 0.5 * room


def _from_above(ax: Axes, plan: WalkPlan) -> list[Artist]:
    low, high = _view(plan)
    colors = contact_colors(plan.poses)
    path: list[Artist] = [*ax.plot(*plan.centroid.com[:, :2].T, color=COM_COLOR, lw=1.3, zorder=4, label="centre of mass")]
    drawn = _treads(ax, plan.floor.on, low, high) if isinstance(plan.floor.on, Terrain) else []
    named = set[str]()
    for foot, corners, number in _prints(plan):
        label = foot if foot not in named and (number or not plan.swings[foot]) else None
        named |= {label} if label else set()
        middle, color = corners.mean(axis=0), colors[foot]
        if len(corners) > 1:
            look: dict[str, Any] = {"facecolor": color if number else "none", "edgecolor": color, "lw": 0.9}
            drawn += ax.fill(*corners[:, :2].T, alpha=0.45 if number else 0.9, zorder=3, label=label, **look)
        else:
            look = {"mfc": color if number else "none", "mec": color, "alpha": 0.55 if number else 0.9}
            drawn += ax.plot(*middle[:2], "o", ms=11.0, zorder=3, label=label, ls="none", **look)
        if number:
            drawn.append(
                ax.text(middle[0], middle[1], str(number), ha="center", va="center", fontsize=8, zorder=5, clip_on=True)
            )
    ax.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    frame(ax)
    columns = 5
    ax.legend(frameon=False, fontsize=8, ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    return path + drawn


def _treads(ax: Axes, terrain: Terrain, low: Array, high: Array) -> list[Artist]:
    """What can be stood on in a box of x and y, the higher the brighter, each level piece with its height."""
    deep = np.array([0.0, 0.0, 10.0])
    drawn: list[Artist] = []
    faces = [
        (float(corners[:, 2].max()), float(np.ptp(corners[:, 2])), corners)
        for solid in terrain.solids
        if not isinstance(solid, Heights)
        for n, corners in faces_of(solid, low - deep, high + deep)
        if n[2] > np.sqrt(0.5)
    ]
    grids = [solid for solid in terrain.solids if isinstance(solid, Heights)]
    levels = [z for z, _, _ in faces] + [z for grid in grids for z in (float(grid.z.min()), float(grid.z.max()))]
    least, most = min(levels, default=0.0), max(levels, default=0.0)
    for grid in grids:
        x, y = (grid.origin[i] + grid.spacing[i] * np.arange(grid.z.shape[i]) for i in (0, 1))
        look: dict[str, Any] = {"cmap": "gray", "vmin": least - 3.0 * (most - least), "vmax": most + 0.3 * (most - least)}
        drawn.append(ax.pcolormesh(x, y, grid.z.T, shading="gouraud", zorder=0, **look))
    for z, drop, corners in sorted(faces, key=lambda face: face[0]):
        grey = GREYS[0] + (GREYS[1] - GREYS[0]) * (z - least) / ((most - least) or 1.0)
        drawn += ax.fill(*corners[:, :2].T, facecolor=str(grey), edgecolor=EDGE_COLOR, lw=0.7, zorder=1)
        if most > least and drop < 1e-6:
            corner = corners[:, :2].min(axis=0)
            text = f"{100.0 * z:.3g} cm".replace("-", "\N{MINUS SIGN}")
            drawn.append(
                ax.text(corner[0], corner[1], f"  {text}", fontsize=7, color="0.35", va="bottom", zorder=2, clip_on=True)
            )
    return drawn


def _from_the_side(ax: Axes, plan: WalkPlan) -> list[Artist]:
    colors = contact_colors(plan.poses)
    drawn: list[Artist] = []
    way = (plan.centroid.com[-1] - plan.centroid.com[0])[:2]
    ahead = way / np.linalg.norm(way) if np.linalg.norm(way) > 1e-3 else np.zeros(2)
    start = np.mean([X.translation[:2] for X in plan.poses.values()], axis=0)
    for foot, own in plan.swings.items():
        before = plan.poses[foot].translation[:2]
        come = float(ahead @ (before - start))
        half = 0.5 * float(np.ptp(np.asarray(plan.floor.feet[foot].corners)[:, 0]))
        for swing in own:
            P = plan.way(swing, SAMPLES)
            s = come + np.cumsum(np.linalg.norm(np.diff([before, *P[:, :2]], axis=0), axis=1))
            below = np.array([plan.floor.top(x, y) for x, y, _ in P])
            floor = np.where(np.isfinite(below), below, np.nan)
            ax.plot(s, floor, color=EDGE_COLOR, lw=0.9, zorder=2)
            drawn += ax.plot(s, P[:, 2], color=colors[foot], lw=1.5, zorder=4)
            for at, z in ((s[0], P[0, 2]), (s[-1], P[-1, 2]))[swing.since is not None :]:
                ax.plot([at - half, at + half], [z, z], color=colors[foot], lw=2.5, alpha=0.5, zorder=3, solid_capstyle="butt")
            come, before = float(s[-1]), P[-1, :2]
    ax.set(xlabel="distance along its way [m]", ylabel="feet, z [m]")
    ax.margins(y=0.12)
    frame(ax, "y")
    return drawn


def _over_time(ax: Axes, plan: WalkPlan) -> list[Artist]:
    first, last = min(float(plan.t[0]), 0.0), plan.duration
    rows = {
        foot: [
            (max(lands, first), min(lifted, last) - max(lands, first))
            for _, lands, lifted in plan.stays(foot)
            if lands < last and lifted > first
        ]
        for foot in plan.poses
    }
    drawn = draw_bars(ax, rows, contact_colors(plan.poses), alpha=0.6, linewidth=0.0)
    ax.set(xlim=(first, last), xlabel="time [s]")
    return drawn
