"""Curves of a study over one of its dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.visual.figures.plots import frame
from rbd.visual.figures.study_data import Axis, Quantity
from rbd.visual.figures.study_maps import NOT_OK_COLOR, NUMBERS, dress
from rbd.visual.style import distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

FEW = 8
"""So many curves have colours and names of their own; more have one scale of colours."""
LOWEST, _ROOM = 0.02, 0.3
"""Height of the lowest row of crosses, and of all rows, as shares of the axes' height."""


def draw_curves(ax: Axes, x: Axis, shown: Quantity, ok: Array, not_run: Array, colors: Mapping[str, str]) -> list[Artist]:
    """A line for each family, broken where there is no value; crosses at the axis where a sample is not ok.

    The last ok sample before one that is not ok has a ring.

    Args:
        ax: Axes, empty.
        x: Across.
        shown: Numbers, shape (len(x), families).
        ok: Which samples are ok, of the same shape.
        not_run: Which were not run.
        colors: {name of a family: its colour}, in order.

    Returns:
        The lines, then crosses and rings.
    """
    order = np.argsort(x.at, kind="stable")
    at, values, good = x.at[order], shown.values[order], ok[order]
    bad = ~good & ~not_run[order]
    lines: list[Artist] = []
    marks: list[Artist] = []
    step = min(0.03, _ROOM / max(1, len(colors)))
    for k, (name, color) in enumerate(colors.items()):
        curve = np.where(good[:, k], values[:, k], np.nan)
        lines += ax.plot(at, curve, "o-", color=color, lw=1.7, ms=3.0 if len(at) <= 60 else 0.0, label=name, zorder=3)
        if bad[:, k].any():
            low = np.full(bad[:, k].sum(), LOWEST + k * step)
            marks += ax.plot(
                at[bad[:, k]], low, "x", color=color, ms=5.0, mew=1.3, transform=ax.get_xaxis_transform(), zorder=4
            )
        beside = np.zeros(len(at), bool)
        beside[:-1] |= bad[1:, k]
        beside[1:] |= bad[:-1, k]
        last = beside & np.isfinite(curve)
        if last.any() and not x.words:
            marks += ax.plot(at[last], curve[last], "o", mfc="white", mec=color, mew=1.8, ms=7.5, zorder=5)
    dress(ax, x, "x")
    ax.set_ylabel(shown.label)
    ax.margins(y=0.12)
    frame(ax, "y")
    return lines + marks


def keys_of_curves(lines: Sequence[Artist], ok: Array, not_run: Array, *, named: bool) -> list[Artist]:
    """Entries of the legend: the families where they are named, crosses and rings."""
    from matplotlib.lines import Line2D

    keys = list(lines) if named else []
    bad = ~ok & ~not_run
    if bad.any():
        cross: dict[str, Any] = {"marker": "x", "ls": "", "color": NOT_OK_COLOR, "ms": 5.0, "mew": 1.3}
        keys.append(Line2D([], [], label=f"not ok ({int(bad.sum())})", **cross))
        if (bad[1:] & ok[:-1] | bad[:-1] & ok[1:]).any():
            ring: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "white", "mec": NOT_OK_COLOR, "mew": 1.8, "ms": 7.0}
            keys.append(Line2D([], [], label="the last that is ok", **ring))
    if not_run.any():
        keys.append(Line2D([], [], ls="", label=f"not run ({int(not_run.sum())})"))
    return keys


def family_colors(by: Axis | None, names: Sequence[str]) -> dict[str, str]:
    """{family: colour}: of a few or of categories colours that differ, of many numbers one scale."""
    if by is None or by.words or len(names) <= FEW:
        return dict(zip(names, distinct_colors(len(names)), strict=True))
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    norm = scale_of(by)
    return {name: to_hex(colormaps[NUMBERS](norm(at))) for name, at in zip(names, by.at, strict=True)}


def scale_of(by: Axis) -> Normalize:
    """The colours of many families, by the numbers that they stand for."""
    from matplotlib.colors import LogNorm, Normalize

    return (LogNorm if by.scale == "log" else Normalize)(float(by.at.min()), float(by.at.max()))
