"""Maps of a study over two of its dimensions: a cell for each sample, and the boundary between ok and not ok."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.visual.figures.study_data import NOT_RUN_COLOR, Axis, Quantity

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
    if shown.categories:
        colors = ListedColormap([color for _, color in shown.categories])
        there = values >= 0
        cells = np.ma.masked_array(values, ~there)
        drawn.append(ax.pcolormesh(across, up, cells, cmap=colors, vmin=-0.5, vmax=len(shown.categories) - 0.5))
    else:
        there = np.isfinite(values)
        name = SIGNED if norm is not None and norm.vmin is not None and norm.vmin < 0.0 else NUMBERS
        drawn.append(ax.pcolormesh(across, up, np.ma.masked_array(values, ~there), cmap=name, norm=norm))
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


def keys_of_map(shown: Quantity, ok: Array, not_run: Array, *, bounded: bool) -> list[Artist]:
    """Entries of the legend: categories with how many samples each has, samples without a value, and the boundary."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Artist] = []
    if shown.categories:
        counts = [int((shown.values == i).sum()) for i in range(len(shown.categories))]
        for (text, color), count in zip(shown.categories, counts, strict=True):
            if count and not (text == "not_run" and color == NOT_RUN_COLOR):
                keys.append(Patch(facecolor=color, edgecolor="0.6", linewidth=0.5, label=f"{text} ({count})"))
    nothing = (shown.values < 0 if shown.categories else ~np.isfinite(shown.values)) & ~not_run
    for which, text in ((nothing & ~ok, "not ok"), (nothing & ok, "ok, without a finite value")):
        if which.any():
            keys.append(Patch(facecolor=NO_VALUE_COLOR, hatch="/////", label=f"{text} ({int(which.sum())})", **_HATCH))
    if not_run.any():
        keys.append(Patch(facecolor=NOT_RUN_COLOR, hatch="....", label=f"not run ({int(not_run.sum())})", **_HATCH))
    if bounded:
        keys.append(Line2D([], [], color=BOUNDARY_COLOR, lw=2.2, label="between the last ok and the first not ok"))
    return keys


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
