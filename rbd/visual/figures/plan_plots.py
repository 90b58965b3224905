"""Plot of a plan on given axes: forces, what is used of friction and torques, which contact stands when, what is certified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rbd.errors.inputs import check_kind
from rbd.planning import Plan
from rbd.visual.figures.plots import axes_of, frame
from rbd.visual.figures.walk_plots import ROW, WIDTH, draw_bars
from rbd.visual.style import contact_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

BEYOND = "#c0392b"
"""Color of what is not certified, and of limits."""


def plot_plan(axes: Axes | Sequence[Axes] | None, plan: Plan) -> list[Artist]:
    """Draw a plan over time: normal forces of its contacts, what is used of friction and torques, and when contacts stand.

    Intervals that are not certified are red bands in all panels; keyframes are dotted lines.

    Args:
        axes: Three Matplotlib axes, or the first, or the first two; None: three on a new figure, that of `artists[0].figure`.
        plan: Of `rbd.plan`, or `error.plan` of a `CannotPlan`.

    Returns:
        The curves of normal forces; of friction and torques; bars; bands and lines.

    Raises:
        InputError: if `axes` are none or too many, or `plan` is no plan.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
        >>> low = {"com": stand.com - [0.0, 0.0, 0.05]}
        >>> artists = rbd.plan(solo, {0.0: stand, 0.5: low}, feet, progress=False).plot()
        >>> [axes.get_ylabel() for axes in artists[0].figure.axes]
        ['normal forces [N]', 'used of limits [%]', '']
    """
    check_kind("plan", plan, Plan, "a plan: rbd.plan(...), or error.plan of a CannotPlan")
    names = [contact.name for contact in plan.contacts.contacts]
    bars = 0.5 + ROW * len(names)
    given = axes_of(axes, 3, (WIDTH, 4.6 + bars), height_ratios=[2.2, 1.8, bars], sharex=True)
    colors, x = contact_colors(names), plan.intervals
    t = np.stack([x.start, x.end], axis=1).ravel()
    sizes = np.cumsum([len(np.asarray(contact.corners)) for contact in plan.contacts.contacts])[:-1]
    drawn: list[Artist] = []
    for name, part in zip(names, np.split(plan.normal_forces, sizes, axis=2), strict=True):
        drawn += given[0].plot(t, part.sum(axis=2).T.ravel(), color=colors[name], lw=1.3, label=name)
    given[0].set(ylabel="normal forces [N]")
    if len(given) > 1:
        used = np.abs(x.torques) / plan.robot.effort_limit
        for values, color, label in ((plan.friction_shares, "0.25", "friction"), (used, "C0", "torques")):
            drawn += given[1].plot(t, 100.0 * values.max(axis=2).T.ravel(), lw=1.3, color=color, label=label)
        drawn.append(given[1].axhline(100.0, color=BEYOND, ls="--", lw=1.0))
        given[1].set(ylabel="used of limits [%]", ylim=(0.0, None))
    for ax in given[:2]:
        frame(ax, "y")
        ax.legend(frameon=False, fontsize=8, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    for ax in given[2:]:
        stays = {name: [(a, b - a) for a, b in plan.contacts.intervals(name)] for name in names}
        drawn += draw_bars(ax, stays, colors, alpha=0.6, linewidth=0.0)
    for ax in given:
        drawn += [ax.axvspan(a, b, color=BEYOND, alpha=0.25, lw=0.0) for a, b in _together(x.start[~x.sure], x.end[~x.sure])]
        drawn += [ax.axvline(time, color="0.6", ls=":", lw=0.8, zorder=0) for time, _ in plan.contacts.keys]
    given[-1].set(xlim=(float(t[0]), float(t[-1])), xlabel="time [s]")
    return drawn


def _together(start: Sequence[float], end: Sequence[float]) -> list[tuple[float, float]]:
    """Intervals, those that follow each other as one."""
    out: list[tuple[float, float]] = []
    for a, b in zip(start, end, strict=True):
        out[-1:] = [(out[-1][0], b)] if out and a - out[-1][1] < 1e-9 else [*out[-1:], (a, b)]
    return out
