"""Draws of a study as points of two of their coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.visual.figures.plots import frame
from rbd.visual.figures.study_curves import LOWEST
from rbd.visual.figures.study_data import Axis, Quantity
from rbd.visual.figures.study_maps import NOT_OK_COLOR, NUMBERS, SIGNED, dress
from rbd.visual.style import distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

MANY = 2000
"""More points are drawn smaller."""


def draw_points(
    ax: Axes, x: Axis, y: Axis, shown: Quantity | None, ok: Array, not_run: Array, norm: Normalize | None
) -> list[Artist]:
    """Draws as points of two of their coordinates, coloured by a quantity; crosses where a sample is not ok.

    Args:
        ax: Axes, empty.
        x: Across.
        y: Up.
        shown: Numbers or categories that colour the points, shape (n,); None: one colour.
        ok: Which are ok, shape (n,).
        not_run: Which were not run; they are left out.
        norm: Of the colours, of numbers.

    Returns:
        The points, of categories one artist each, then the crosses.
    """
    drawn: list[Artist] = []
    bad = ~ok & ~not_run
    size = 26.0 if len(ok) <= MANY else 6.0
    style: dict[str, Any] = {"s": size, "linewidths": 0.4, "edgecolors": "white", "zorder": 3}
    there = np.isfinite(x.at) & np.isfinite(y.at)
    if shown is None:
        drawn.append(ax.scatter(x.at[ok & there], y.at[ok & there], color=distinct_colors(1)[0], **style))
    elif shown.categories:
        for i, (text, color) in enumerate(shown.categories):
            which = (shown.values == i) & ~not_run & there
            if which.any():  # those that are ok are pale, so that their rim is grey
                rim = {**style, "edgecolors": "0.55" if text == "ok" else "white"}
                drawn.append(ax.scatter(x.at[which], y.at[which], color=color, label=f"{text} ({int(which.sum())})", **rim))
    else:
        which = ok & np.isfinite(shown.values) & there
        name = SIGNED if norm is not None and norm.vmin is not None and norm.vmin < 0.0 else NUMBERS
        drawn.append(ax.scatter(x.at[which], y.at[which], c=shown.values[which], cmap=name, norm=norm, **style))
    if bad.any() and not (shown is not None and shown.categories and shown.label == "reason"):
        high = there & bad
        if high.any():
            drawn += ax.plot(x.at[high], y.at[high], "x", color=NOT_OK_COLOR, ms=5.0, mew=1.0, zorder=2)
        low = np.isfinite(x.at) & ~np.isfinite(y.at) & bad
        if low.any():  # of a sample that is not ok the quantity drawn upwards has no value: it is marked at the axis
            at = np.full(low.sum(), LOWEST)
            style = {"color": NOT_OK_COLOR, "ms": 5.0, "mew": 1.0, "zorder": 4, "transform": ax.get_xaxis_transform()}
            drawn += ax.plot(x.at[low], at, "x", **style)
    dress(ax, x, "x")
    dress(ax, y, "y")
    frame(ax, "both")
    return drawn


def keys_of_points(shown: Quantity | None, ok: Array, not_run: Array) -> list[Artist]:
    """Entries of the legend: categories with their counts, crosses, and how many were not run."""
    from matplotlib.lines import Line2D

    keys: list[Artist] = []
    dot: dict[str, Any] = {"marker": "o", "ls": "", "ms": 6.0, "mec": "0.55", "mew": 0.5}
    if shown is not None:
        for i, (text, color) in enumerate(shown.categories):
            count = int(((shown.values == i) & ~not_run).sum())
            if count:
                keys.append(Line2D([], [], color=color, label=f"{text} ({count})", **dot))
    bad = ~ok & ~not_run
    if bad.any() and not (shown is not None and shown.categories and shown.label == "reason"):
        cross: dict[str, Any] = {"marker": "x", "ls": "", "color": NOT_OK_COLOR, "ms": 5.0, "mew": 1.0}
        keys.append(Line2D([], [], label=f"not ok ({int(bad.sum())})", **cross))
    if not_run.any():
        keys.append(Line2D([], [], ls="", label=f"not run ({int(not_run.sum())})"))
    return keys
