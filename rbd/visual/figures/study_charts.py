"""A study as a map, as curves over one of its dimensions, and as points of two coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.visual.figures.plots import frame
from rbd.visual.figures.study_data import NOT_RUN_COLOR, Axis, Quantity
from rbd.visual.style import distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

NUMBERS, SIGNED = "viridis", "PuOr"
"""Colour maps that colour-blind readers can read: of numbers of one sign, and of both."""
NO_VALUE_COLOR, NOT_OK_COLOR, BOUNDARY_COLOR = "#c4c9ce", "#3d454c", "#d6006c"
MOST_PIECES = 2000
"""More pieces of hatched cells are drawn plain, and more pieces of a boundary thin: hatching takes a millisecond each."""
_HATCH: dict[str, Any] = {"linewidth": 0.0, "edgecolor": "#8d949b"}
_CROSS: dict[str, Any] = {"marker": "x", "ls": "", "color": NOT_OK_COLOR, "ms": 5.0, "mew": 1.3}


def draw_map(
    ax: Axes, x: Axis, y: Axis | None, shown: Quantity, ok: Array, not_run: Array, norm: Normalize | None
) -> list[Artist]:
    """A cell for each sample, centred on it; where there is no value it is grey and hatched; the boundary is a line.

    Args:
        ax: Axes, empty.
        x: Across.
        y: Up; None: one row.
        shown: Values of shape (len(x), len(y)).
        ok: Which samples are ok, of the same shape.
        not_run: Which were not run.
        norm: Of the colours, of numbers.

    Returns:
        The cells, those without a value, the boundary, as far as they are there.
    """
    from matplotlib.colors import ListedColormap

    order = [np.argsort(axis.at, kind="stable") if axis is not None else np.arange(1) for axis in (x, y)]
    pick = np.ix_(*order)
    values, good, waiting = (a.reshape(ok.shape[0], -1)[pick].T for a in (shown.values, ok, not_run))
    across, up = (_edges(axis) if axis is not None else np.array([-0.5, 0.5]) for axis in (x, y))
    drawn: list[Artist] = []
    there = values >= 0 if shown.categories else np.isfinite(values)
    look: dict[str, Any] = {"cmap": _map_of(norm), "norm": norm}
    if shown.categories:
        colors = ListedColormap([color for _, color in shown.categories])
        look = {"cmap": colors, "vmin": -0.5, "vmax": len(shown.categories) - 0.5}
    drawn.append(ax.pcolormesh(across, up, np.ma.masked_array(values, ~there), **look))
    drawn += _cells(ax, across, up, ~there & ~waiting, NO_VALUE_COLOR, "/////")
    drawn += _cells(ax, across, up, waiting, NOT_RUN_COLOR, "....")
    drawn += _boundary(ax, across, up, good, ~good & ~waiting, (not x.words, y is not None and not y.words))
    dress(ax, x, "x")
    if y is None:
        ax.set_yticks([])
    else:
        dress(ax, y, "y")
    ax.set_xlim(across[0], across[-1])
    ax.set_ylim(up[0], up[-1])
    return drawn


def _map_of(norm: Normalize | None) -> str:
    """The map of colours of numbers."""
    return SIGNED if norm is not None and norm.vmin is not None and norm.vmin < 0.0 else NUMBERS


def dress(ax: Axes, axis: Axis, which: str) -> None:
    """Label, scale and words of an axis, "x" or "y"."""
    chosen = ax.xaxis if which == "x" else ax.yaxis
    chosen.set_label_text(axis.label)
    if axis.words:
        chosen.set_ticks(range(len(axis.words)), list(axis.words))
        if which == "x" and sum(map(len, axis.words)) > 40:
            ax.tick_params(axis="x", labelrotation=30)
        return
    if axis.scale == "log":
        from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

        (ax.set_xscale if which == "x" else ax.set_yscale)("log")
        chosen.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        chosen.set_major_formatter(lambda value, _: f"{value:g}")
        chosen.set_minor_locator(NullLocator())
        chosen.set_minor_formatter(NullFormatter())


def legend_keys(
    shown: Quantity | None, bad: Array, not_run: Array, *, cells: bool = False, blank: Array | None = None
) -> list[Artist]:
    """Entries of the legend: each category, what is not ok, what has no value, what was not run, with how many samples.

    Args:
        shown: What is drawn.
        bad: Samples that are drawn as not ok.
        not_run: Those that were not run.
        cells: Whether samples are cells of a map; else they are points.
        blank: Samples that are ok and have no value.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    counts = [] if shown is None else [int(((shown.values == i) & ~not_run).sum()) for i in range(len(shown.categories))]
    categories = () if shown is None else shown.categories
    named = [(f"{text} ({n})", color) for (text, color), n in zip(categories, counts, strict=True) if n]
    if cells:
        keys: list[Artist] = [Patch(facecolor=color, edgecolor="0.6", linewidth=0.5, label=label) for label, color in named]
        for which, text in ((bad, "not ok"), (blank, "ok, without a finite value")):
            if which is not None and which.any():
                keys.append(Patch(facecolor=NO_VALUE_COLOR, hatch="/////", label=f"{text} ({int(which.sum())})", **_HATCH))
        if not_run.any():
            keys.append(Patch(facecolor=NOT_RUN_COLOR, hatch="....", label=f"not run ({int(not_run.sum())})", **_HATCH))
        return keys
    dot: dict[str, Any] = {"marker": "o", "ls": "", "ms": 6.0, "mec": "0.55", "mew": 0.5}
    keys = [Line2D([], [], color=color, label=label, **dot) for label, color in named]
    if bad.any():
        keys.append(Line2D([], [], label=f"not ok ({int(bad.sum())})", **_CROSS))
    if not_run.any():
        keys.append(Line2D([], [], ls="", label=f"not run ({int(not_run.sum())})"))
    return keys


def boundary_key() -> Artist:
    """The entry of the boundary in the legend of a map."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=BOUNDARY_COLOR, lw=2.2, label="between the last ok and the first not ok")


def ring_key() -> Artist:
    """The entry of the rings in the legend of curves."""
    from matplotlib.lines import Line2D

    ring: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "white", "mec": NOT_OK_COLOR, "mew": 1.8, "ms": 7.0}
    return Line2D([], [], label="the last that is ok", **ring)


def _edges(axis: Axis) -> Array:
    return Axis(axis.name, axis.label, np.sort(axis.at), axis.words, axis.scale).edges


def _cells(ax: Axes, across: Array, up: Array, which: Array, color: str, hatch: str) -> list[Artist]:
    """Hatched cells as one artist, neighbours above each other as one piece; very many pieces are not hatched."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import ListedColormap

    if not which.any():
        return []
    steps = np.diff(np.pad(which.T.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (i, first), (_, last) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    if len(i) > MOST_PIECES:
        return [ax.pcolormesh(across, up, np.ma.masked_array(which, ~which), cmap=ListedColormap([color]))]
    left, right, low, high = across[i], across[i + 1], up[first], up[last]
    corners = np.stack([np.column_stack(p) for p in ((left, low), (right, low), (right, high), (left, high))], axis=1)
    cells = PolyCollection(list(corners), facecolor=color, hatch=hatch, **_HATCH)
    ax.add_collection(cells)
    return [cells]


def _boundary(ax: Axes, across: Array, up: Array, good: Array, bad: Array, ordered: tuple[bool, bool]) -> list[Artist]:
    """Edges of cells between ok and not ok, along axes that are ordered: categories have no boundary between them."""
    from matplotlib.collections import LineCollection

    lines = []
    if ordered[0]:
        j, i = np.nonzero(good[:, :-1] & bad[:, 1:] | bad[:, :-1] & good[:, 1:])
        lines += [np.stack([np.column_stack([across[i + 1], up[j + k]]) for k in (0, 1)], axis=1)]
    if ordered[1]:
        j, i = np.nonzero(good[:-1] & bad[1:] | bad[:-1] & good[1:])
        lines += [np.stack([np.column_stack([across[i + k], up[j + 1]]) for k in (0, 1)], axis=1)]
    segments = np.concatenate(lines) if lines else np.zeros((0, 2, 2))
    if not len(segments):
        return []
    width = 2.2 if len(segments) <= MOST_PIECES else 0.4
    line = LineCollection(list(segments), colors=BOUNDARY_COLOR, linewidths=width, capstyle="round", zorder=3, label="boundary")
    ax.add_collection(line)
    return [line]


FEW = 8
"""Up to this many curves have colours and names of their own; more share one scale of colours."""
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


MANY = 2000
"""More points are drawn smaller."""


def draw_points(
    ax: Axes, x: Axis, y: Axis, shown: Quantity | None, ok: Array, bad: Array, not_run: Array, norm: Normalize | None
) -> list[Artist]:
    """Draws as points of two of their coordinates, coloured by a quantity; crosses where a sample is not ok.

    Args:
        ax: Axes, empty.
        x: Across.
        y: Up.
        shown: Numbers or categories that colour the points, shape (n,); None: one colour.
        ok: Which are ok, shape (n,).
        bad: Which have a cross.
        not_run: Which were not run; they are left out.
        norm: Of the colours, of numbers.

    Returns:
        The points, of categories one artist each, then the crosses.
    """
    drawn: list[Artist] = []
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
        drawn.append(ax.scatter(x.at[which], y.at[which], c=shown.values[which], cmap=_map_of(norm), norm=norm, **style))
    # Of a sample that is not ok the quantity drawn upwards may have no value: it is marked at the axis.
    low = bad & np.isfinite(x.at) & ~np.isfinite(y.at)
    for which, up, more in ((bad & there, y.at, {}), (low, np.full(len(ok), LOWEST), {"transform": ax.get_xaxis_transform()})):
        if which.any():
            drawn += ax.plot(x.at[which], up[which], **(_CROSS | {"mew": 1.0, "zorder": 2} | more))
    dress(ax, x, "x")
    dress(ax, y, "y")
    frame(ax, "both")
    return drawn
