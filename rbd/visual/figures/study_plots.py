"""`plot_study`: what `rbd.study` returned as a map, as curves, as points, or as a map of the reasons without an answer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.figures.study_data import NOT_RUN_COLOR, Axis, Quantity, Samples, StudyData
from rbd.visual.style import distinct_colors

if TYPE_CHECKING:
    import xarray
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

MOST_PANELS = 12
PANEL = (4.4, 3.6)
"""Width and height of a picture's panel, where this module makes the figure [inch]."""
NUMBERS, SIGNED = "viridis", "PuOr"
"""Colour maps that colour-blind readers can read: of numbers of one sign, and of both."""
NO_VALUE_COLOR, NOT_OK_COLOR, BOUNDARY_COLOR = "#c4c9ce", "#3d454c", "#d6006c"
MOST_PIECES = 2000
"""More pieces of hatched cells are drawn plain, and more pieces of a boundary thin: hatching takes a millisecond each."""
FEW = 8
"""Up to this many curves have colours and names of their own; more share one scale of colours."""
LOWEST, _ROOM = 0.02, 0.3
"""Height of the lowest row of crosses, and of all rows, as shares of the axes' height."""
MANY = 2000
"""More points are drawn smaller."""
NO_VALUE: Mapping[str, Any] = {"facecolor": NO_VALUE_COLOR, "hatch": "/////"}
WAITING: Mapping[str, Any] = {"facecolor": NOT_RUN_COLOR, "hatch": "...."}
_HATCH: Mapping[str, Any] = {"linewidth": 0.0, "edgecolor": "#8d949b"}
_CROSS: Mapping[str, Any] = {"marker": "x", "ls": "", "color": NOT_OK_COLOR, "ms": 5.0, "mew": 1.3}
_RING: Mapping[str, Any] = {"marker": "o", "ls": "", "mfc": "white", "mew": 1.8, "label": "the last that is ok"}
_EDGE: Mapping[str, Any] = {"color": BOUNDARY_COLOR, "label": "between the last ok and the first not ok"}
_LEGEND: Mapping[str, Any] = {
    "frameon": False,
    "fontsize": "small",
    "handlelength": 1.5,
    "columnspacing": 1.2,
    "alignment": "left",
}


def plot_study(
    dataset: xarray.Dataset,
    x: str | None = None,
    y: str | None = None,
    value: str | None = None,
    by: str | None = None,
    *,
    ax: Axes | Iterable[Axes] | None = None,
) -> list[Artist]:
    """Draw a study: a map over two dimensions, curves over one, draws as points; or the reasons where there is no answer.

    - Two dimensions (`x` and `y`, or a grid of two): a map, a cell for each sample. Samples without a value are grey and
      hatched. The boundary between ok and not ok is a line along the edges of cells, midway between two samples: nothing is
      interpolated. `by` draws one map for each value of a third dimension; x and y are then the
      other two, if they are not named.
    - One dimension (`x` alone, or a grid of one): curves of the value, one for each value of `by`, or of the other dimension
      of two. Samples that are not ok are crosses at the axis, and the last ok one has a ring.
    - Draws and tables: points of two coordinates coloured by the value, or, with `x` alone, of the value
      over x, coloured by `by`. Samples that are not ok are crosses.
    - `value="reason"`: a map, or points, with a colour for each reason; the legend counts them.
    - `value="ok"` of draws at each point of a grid: the share of them that is ok.

    Further dimensions have to be selected: `dataset.sel(posture="half_sitting")`; those with one value are left out. Values in
    geometric progression have a logarithmic axis, texts and objects places of equal width. Of a dataset of a file only what
    is drawn is read.

    Args:
        dataset: What `rbd.study` returned.
        x: Dimension or coordinate across; by default the first, and of a grid of three `by` is the shortest.
        y: Upwards; by default the second of a grid of two dimensions, or of draws.
        value: Quantity to draw, with labels of its further dimensions: "force_left_sole[fz]". By default the first number that
            is no residual; the reasons where there is none.
        by: Dimension or coordinate with a curve, or a map, for each value.
        ax: Matplotlib axes, empty; of several maps one for each. By default a new figure, which is that of what is returned:
            `rbd.visual.plot_study(dataset)[0].figure.savefig("map.png")`.

    Returns:
        What was drawn: of each map its cells, those without a value and the boundary; of curves the lines, then crosses and
        rings; of draws the points, then crosses.

    Raises:
        InputError: no study, unknown names, dimensions that are neither drawn nor selected.

    Example:
        >>> def slides(friction, push):
        ...     if push > friction * 98.1:
        ...         raise rbd.CannotHold("it slides")
        ...     return {"used": push / (friction * 98.1)}
        >>> table = rbd.study(slides, rbd.grid(friction=[0.2, 0.4, 0.6], push=[10.0, 30.0, 50.0]), executor=0, progress=False)
        >>> cells, without, boundary = rbd.visual.plot_study(table, value="used")
        >>> cells.axes.get_xlabel(), cells.axes.get_ylabel(), int(cells.get_array().count())  # six of nine have a value
        ('friction', 'push', 6)
    """
    names = (x, y, by)
    data = StudyData(dataset, names)
    if isinstance(value, str) and value == "ok":
        data, value = data.averaged(names)
    across, up, rest = _chosen(data, x, y, by)
    if data.drawn_at_random:
        return _points(data, across, up, value, rest, ax)
    dims = [data.dim(what, name) for what, name in (("x", across), ("y", up), ("by", rest)) if name is not None]
    if len(set(dims)) < len(dims):
        raise InputError(f"x, y and by are {across!r}, {up!r} and {rest!r}, which are not all of different dimensions.")
    data.check_left(dims, by_given=rest is not None)
    shown = data.quantity(value)
    if up is None and not shown.categories:
        return _curves(data, across, shown, rest, ax)
    if up is None:  # categories are cells, and families are their rows
        up, rest = rest, None
    return _maps(data, across, up, shown, rest, ax)


def _chosen(data: StudyData, x: object, y: object, by: object) -> tuple[str, str | None, str | None]:
    """The names of x, y and by, with defaults."""
    for what, name in (("x", x), ("y", y), ("by", by)):
        if name is not None:
            data.variable(what, name)
    if x is None and y is not None:
        raise InputError(f"y is {y!r} and x is not given; name both, or x alone for curves.")
    if data.drawn_at_random:
        names = [str(n) for n, v in data.dataset.coords.items() if v.dims == data.dims and n not in data.dims]
        free = [n for n in names if n != by] or list(data.dims)
        if x is None:
            x, y = free[0], (free[1] if len(free) > 1 else None)
        return str(x), None if y is None else str(y), None if by is None else str(by)
    used = [data.dim(what, name) for what, name in (("x", x), ("y", y), ("by", by)) if name is not None]
    free = [d for d in data.dims if d not in used]
    if x is None and by is None and len(free) == 3:
        by = min(free, key=lambda d: data.dataset.sizes[d])
        free.remove(by)
    if x is None:
        x = free.pop(0) if free else by
        if len(free) == 1 and (by is None or not data.numbered(free[0])):
            y = free.pop(0)
    elif y is None and len(free) == 1 and (by is None or not data.numbered(free[0])):
        by, y = (free.pop(0), None) if by is None else (by, free.pop(0))
    if x == by:
        by = None
    return str(x), None if y is None else str(y), None if by is None else str(by)


def _maps(data: StudyData, x: str, y: str | None, shown: Quantity, by: str | None, ax: object) -> list[Artist]:
    """One map, or one for each value of the third name."""
    up = Axis("", "", np.zeros(len(shown.values)), ("",)) if y is None else data.axis("y", y)
    samples = Samples(data.axis("x", x), up, shown, *data.states())
    tall = PANEL[1] if y is not None else 1.2
    axes, own, drawn = _panels(samples, _groups(data, by), ax, (PANEL[0], tall), (6.8, tall + 0.9), draw_map)
    nothing = ~shown.there & ~samples.not_run
    keys = _category_keys(samples, cells=True)
    keys += _key("not ok", nothing & ~samples.ok, cells=True, **NO_VALUE, **_HATCH)
    keys += _key("ok, without a finite value", nothing & samples.ok, cells=True, **NO_VALUE, **_HATCH)
    keys += _key("not run", samples.not_run, cells=True, **WAITING, **_HATCH)
    _legend(axes, own, keys + _named(drawn, _EDGE["label"]), shown.label if shown.categories else "")
    return drawn


def _curves(data: StudyData, x: str, shown: Quantity, by: str | None, ax: object) -> list[Artist]:
    """The value over one dimension, a line for each value of another one."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import to_hex

    axis = None if by is None else data.axis("by", by)
    everything = np.ones(len(shown.values), bool)
    groups = [("", everything)] if axis is None else axis.groups()
    few = axis is None or bool(axis.words) or len(groups) <= FEW
    scale = None if few or axis is None else ScalarMappable(_scale_of(axis), NUMBERS)
    colors = (
        distinct_colors(len(groups))
        if scale is None or axis is None
        else [to_hex(c) for c in scale.to_rgba(np.unique(axis.at))]
    )
    (one,), own = _axes(ax, 1, (7.0, 4.2))
    samples = Samples(data.axis("x", x), Axis(shown.label, shown.label, shown.values), None, *data.states())
    families = [(name, color, samples.some(which)) for (name, which), color in zip(groups, colors, strict=True)]
    drawn = draw_curves(one, families)
    if axis is not None and scale is not None:
        dress(one.figure.colorbar(scale, ax=one).ax, y=axis)
    keys = drawn[: len(groups)] * (few and axis is not None) + _key("not ok", samples.bad, **_CROSS)
    keys += _named(drawn, _RING["label"]) + _key("not run", samples.not_run, ls="")
    _legend([one], own, keys, axis.label if few and axis is not None else "")
    return drawn


def _points(data: StudyData, x: str, y: str | None, value: object, by: str | None, ax: object) -> list[Artist]:
    """Points of two coordinates coloured by the value, one picture for each value of `by`; or of the value over x."""
    shown, across = data.quantity(value), data.axis("x", x)
    colored: Quantity | None = shown
    if y is None:
        up = Axis(shown.label, shown.label, shown.values, tuple(text for text, _ in shown.categories))
        if by is not None:
            colored, by = _colors_of(data.axis("by", by)), None
        elif not shown.categories:
            colored = None
    else:
        up = data.axis("y", y)
    samples = Samples(across, up, colored, *data.states())
    axes, own, drawn = _panels(samples, _groups(data, by), ax, PANEL, (6.4, 4.5), draw_points)
    keys = _category_keys(samples, cells=False)
    if not _by_reason(samples):
        keys += _key("not ok", samples.bad, **_CROSS)
    keys += _key("not run", samples.not_run, ls="")
    _legend(axes, own, keys, colored.label if colored is not None and colored.categories else "")
    return drawn


def _panels(
    samples: Samples,
    groups: list[tuple[str, Array | None]],
    ax: object,
    small: tuple[float, float],
    large: tuple[float, float],
    draw: Callable[[Axes, Samples, Normalize | None], list[Artist]],
) -> tuple[list[Axes], Figure | None, list[Artist]]:
    """(the axes, their figure if it is made here, what is drawn): a picture for each group, with one scale of colours.

    Args:
        samples: All of them.
        groups: (title, which samples) of each picture; None: all.
        ax: The axes given.
        small: Width and height of one of several pictures [inch].
        large: Of the only one.
        draw: What draws a picture.
    """
    axes, own = _axes(ax, len(groups), small if len(groups) > 1 else large)
    norm = None if samples.shown is None else _norm(samples.shown)
    drawn: list[Artist] = []
    for (title, which), one in zip(groups, axes, strict=True):
        drawn += draw(one, samples if which is None else samples.some(which), norm)
        one.set_title(title, fontsize="medium")
    if samples.shown is not None and norm is not None:
        bar = axes[0].figure.colorbar(drawn[0], ax=axes, label=samples.shown.label)  # type: ignore[arg-type]
        if not samples.shown.there.any():
            bar.set_ticks([])
    return axes, own, drawn


def _groups(data: StudyData, by: str | None) -> list[tuple[str, Array | None]]:
    """(title, which samples) of every value of a coordinate; without one a picture of all samples."""
    if by is None:
        return [("", None)]
    axis = data.axis("by", by)
    groups = axis.groups()
    if len(groups) > MOST_PANELS:
        raise InputError(
            f"by={axis.name!r} has {len(groups)} values, more than there is room for pictures ({MOST_PANELS}); select some: "
            f"dataset.isel({{{axis.name!r}: slice(0, {MOST_PANELS})}}) of a grid, dataset.isel(sample=...) of draws."
        )
    name, _, unit = axis.label.partition(" [")
    return [(text if axis.words else f"{name} = {text} {unit.rstrip(']')}".strip(), which) for text, which in groups]


def draw_map(ax: Axes, samples: Samples, norm: Normalize | None) -> list[Artist]:
    """A cell for each sample, centred on it; where there is no value it is grey and hatched; the boundary is a line.

    Args:
        ax: Axes, empty.
        samples: Each at a place of its own, all of a grid.
        norm: Of the colours, of numbers.

    Returns:
        The cells, those without a value, the boundary, as far as they are there.

    Raises:
        InputError: two samples at one place.
    """
    from matplotlib.colors import ListedColormap

    x, y, shown = samples.x, samples.y, samples.shown
    assert shown is not None
    (across, i), (up, j) = x.cells(), y.cells()
    shape = (len(up) - 1, len(across) - 1)
    if len(i) != shape[0] * shape[1]:
        raise InputError(
            f"values of {x.name} or {y.name or x.name} come twice, and a map has one cell for each; select: dataset.isel(...)."
        )
    order = np.lexsort((i, j))
    given = (shown.values, shown.there, samples.ok, samples.not_run)
    values, there, good, waiting = (each[order].reshape(shape) for each in given)
    look: dict[str, Any] = {"cmap": _map_of(norm), "norm": norm}
    if shown.categories:
        colors = ListedColormap([color for _, color in shown.categories])
        look = {"cmap": colors, "vmin": -0.5, "vmax": len(shown.categories) - 0.5}
    drawn: list[Artist] = [ax.pcolormesh(across, up, np.ma.masked_array(values, ~there), **look)]
    drawn += _cells(ax, across, up, ~there & ~waiting, NO_VALUE)
    drawn += _cells(ax, across, up, waiting, WAITING)
    bad = ~good & ~waiting
    pieces = [] if x.words else _borders(across, up, good, bad)
    pieces += [] if y.words else [ends[:, :, ::-1] for ends in _borders(up, across, good.T, bad.T)]
    drawn += _boundary(ax, np.concatenate([np.zeros((0, 2, 2)), *pieces]))
    dress(ax, x=x, y=y)
    ax.set(xlim=(across[0], across[-1]), ylim=(up[0], up[-1]))
    return drawn


def _borders(across: Array, up: Array, good: Array, bad: Array) -> list[Array]:
    """Edges between neighbours along a row of which one is good and one bad, shape (n, 2, 2): both ends of each."""
    j, i = np.nonzero(good[:, :-1] & bad[:, 1:] | bad[:, :-1] & good[:, 1:])
    return [np.stack([np.column_stack([across[i + 1], up[j + k]]) for k in (0, 1)], axis=1)]


def _boundary(ax: Axes, segments: Array) -> list[Artist]:
    """Edges of cells between ok and not ok, along axes that are ordered: categories have no boundary between them."""
    from matplotlib.collections import LineCollection

    if not len(segments):
        return []
    width = 2.2 if len(segments) <= MOST_PIECES else 0.4
    return [ax.add_collection(LineCollection(list(segments), linewidths=width, capstyle="round", zorder=3, **_EDGE))]


def _cells(ax: Axes, across: Array, up: Array, which: Array, look: Mapping[str, Any]) -> list[Artist]:
    """Hatched cells as one artist, neighbours above each other as one piece; very many pieces are not hatched."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import ListedColormap

    if not which.any():
        return []
    steps = np.diff(np.pad(which.T.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (i, first), (_, last) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    if len(i) > MOST_PIECES:
        return [ax.pcolormesh(across, up, np.ma.masked_array(which, ~which), cmap=ListedColormap([look["facecolor"]]))]
    left, right, low, high = across[i], across[i + 1], up[first], up[last]
    corners = np.stack([np.column_stack(p) for p in ((left, low), (right, low), (right, high), (left, high))], axis=1)
    return [ax.add_collection(PolyCollection(list(corners), **look, **_HATCH))]


def draw_curves(ax: Axes, families: list[tuple[str, str, Samples]]) -> list[Artist]:
    """A line for each family, broken where there is no value; crosses at the axis where a sample is not ok.

    The last ok sample before one that is not ok has a ring.

    Args:
        ax: Axes, empty.
        families: (name, colour, samples) of each.

    Returns:
        The lines, then crosses and rings.
    """
    lines: list[Artist] = []
    marks: list[Artist] = []
    step = min(0.03, _ROOM / len(families))
    for k, (name, color, samples) in enumerate(families):
        x, y = samples.x, samples.y
        order = np.argsort(x.at, kind="stable")
        at, bad = x.at[order], samples.bad[order]
        curve = np.where(samples.ok, y.at, np.nan)[order]
        lines += ax.plot(at, curve, "o-", color=color, lw=1.7, ms=3.0 if len(at) <= 60 else 0.0, label=name, zorder=3)
        if bad.any():
            low, foot = np.full(bad.sum(), LOWEST + k * step), ax.get_xaxis_transform()
            marks += ax.plot(at[bad], low, **{**_CROSS, "color": color}, transform=foot, zorder=4)
        beside = np.append(bad[1:], False) | np.append(False, bad[:-1])
        last = beside & np.isfinite(curve)
        if last.any() and not x.words:
            marks += ax.plot(at[last], curve[last], **_RING, mec=color, ms=7.5, zorder=5)
    dress(ax, x=x, y=y)
    ax.margins(y=0.12)
    frame(ax, "y")
    return lines + marks


def _scale_of(axis: Axis) -> Normalize:
    """The colours of many families, by the numbers that they stand for."""
    from matplotlib.colors import LogNorm, Normalize

    return (LogNorm if axis.scale == "log" else Normalize)(float(axis.at.min()), float(axis.at.max()))


def draw_points(ax: Axes, samples: Samples, norm: Normalize | None) -> list[Artist]:
    """Draws as points of two of their coordinates, coloured by a quantity; crosses where a sample is not ok.

    Args:
        ax: Axes, empty.
        samples: Those that were not run are left out.
        norm: Of the colours, of numbers.

    Returns:
        The points, of categories one artist each, then the crosses.
    """
    drawn: list[Artist] = []
    x, y, shown, ok = samples.x, samples.y, samples.shown, samples.ok
    size = 26.0 if len(ok) <= MANY else 6.0
    style: dict[str, Any] = {"s": size, "linewidths": 0.4, "edgecolors": "white", "zorder": 3}
    there = np.isfinite(x.at) & np.isfinite(y.at)
    if shown is None:
        drawn.append(ax.scatter(x.at[ok & there], y.at[ok & there], color=distinct_colors(1)[0], **style))
    elif shown.categories:
        for i, (text, color) in enumerate(shown.categories):
            which = (shown.values == i) & ~samples.not_run & there
            if which.any():  # those that are ok are pale, so that their rim is grey
                rim = {**style, "edgecolors": "0.55" if text == "ok" else "white"}
                drawn.append(ax.scatter(x.at[which], y.at[which], color=color, label=f"{text} ({int(which.sum())})", **rim))
    else:
        which = ok & shown.there & there
        drawn.append(ax.scatter(x.at[which], y.at[which], c=shown.values[which], cmap=_map_of(norm), norm=norm, **style))
    bad = samples.bad & (not _by_reason(samples))
    # Of a sample that is not ok the quantity drawn upwards may have no value: it is marked at the axis.
    low = bad & np.isfinite(x.at) & ~np.isfinite(y.at)
    for which, up, more in ((bad & there, y.at, {}), (low, np.full(len(ok), LOWEST), {"transform": ax.get_xaxis_transform()})):
        if which.any():
            drawn += ax.plot(x.at[which], up[which], **{**_CROSS, "mew": 1.0, "zorder": 2, **more})
    dress(ax, x=x, y=y)
    frame(ax, "both")
    return drawn


def _by_reason(samples: Samples) -> bool:
    """Whether the colours tell why samples are not ok."""
    return samples.shown is not None and bool(samples.shown.categories) and samples.shown.label == "reason"


def _colors_of(axis: Axis) -> Quantity:
    """A coordinate as what colours points."""
    if not axis.words:
        return Quantity(axis.label, axis.at)
    colors = distinct_colors(len(axis.words))
    return Quantity(axis.label, axis.at.astype(int), tuple(zip(axis.words, colors, strict=True)))


def _map_of(norm: Normalize | None) -> str:
    """The map of colours of numbers."""
    return SIGNED if norm is not None and norm.vmin is not None and norm.vmin < 0.0 else NUMBERS


def _norm(shown: Quantity) -> Normalize | None:
    """One scale of colours for all pictures: even around zero where there are both signs; None for categories."""
    from matplotlib.colors import Normalize

    if shown.categories:
        return None
    finite = shown.values[shown.there]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if low < 0.0 < high:
        low, high = -max(-low, high), max(-low, high)
    half = 0.0 if high > low else 0.1 * abs(low) or 1.0  # one value alone has the colour in the middle
    return Normalize(low - half, high + half)


def dress(ax: Axes, **axes: Axis) -> None:
    """Label, scale and words of axes, "x" or "y"."""
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

    for which, axis in axes.items():
        chosen = ax.xaxis if which == "x" else ax.yaxis
        chosen.set_label_text(axis.label)
        if axis.words:
            chosen.set_ticks([k for k, word in enumerate(axis.words) if word], [word for word in axis.words if word])
            if which == "x" and sum(map(len, axis.words)) > 40:
                ax.tick_params(axis="x", labelrotation=30)
        elif axis.scale == "log":
            ax.set(**{f"{which}scale": "log"})
            chosen.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), minor_locator=NullLocator())
            chosen.set(major_formatter=lambda value, _: f"{value:g}", minor_formatter=NullFormatter())


def _axes(ax: object, count: int, size: tuple[float, float]) -> tuple[list[Axes], Figure | None]:
    """The axes to draw on, and the figure if it is made here.

    Raises:
        InputError: other axes than there are maps.
    """
    from matplotlib.figure import Figure

    if ax is None:
        columns = min(3, count)
        rows = -(-count // columns)
        figure = Figure(figsize=(size[0] * columns + 0.8 * (count > 1), size[1] * rows), layout="constrained")
        made = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
        for spare in made[count:]:
            spare.remove()
        return made[:count], figure
    given: list[Any] = [ax] if hasattr(ax, "set_yticks") else list(np.ravel(np.asarray(ax, object)))
    for one in given:
        an_axis(one)
    if len(given) != count:
        raise InputError(f"ax are {len(given)} axes; expected {count}, one for each picture, or None for a new figure.")
    return given, None


def _category_keys(samples: Samples, *, cells: bool) -> list[Artist]:
    """Entries of the legend: each category that is there, with how many samples."""
    if (shown := samples.shown) is None:
        return []
    dot = {"marker": "o", "ls": "", "ms": 6.0, "mec": "0.55", "mew": 0.5}
    frame: dict[str, Any] = {"edgecolor": "0.6", "linewidth": 0.5} if cells else dot
    keys: list[Artist] = []
    for i, (text, color) in enumerate(shown.categories):
        which = (shown.values == i) & ~samples.not_run
        keys += _key(text, which, cells=cells, **{"facecolor" if cells else "color": color}, **frame)
    return keys


def _key(text: str, which: Array, *, cells: bool = False, **look: Any) -> list[Artist]:
    """An entry of the legend with how many samples there are, if any: of cells a patch, else a mark."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if not which.any():
        return []
    label = f"{text} ({int(which.sum())})"
    return [Patch(label=label, **look) if cells else Line2D([], [], label=label, **look)]


def _named(drawn: list[Artist], label: str) -> list[Artist]:
    """The entry of the legend of boundaries or rings, if there are any."""
    from matplotlib.lines import Line2D

    if not any(artist.get_label() == label for artist in drawn):
        return []
    looks = {_EDGE["label"]: {**_EDGE, "lw": 2.2}, _RING["label"]: {**_RING, "mec": NOT_OK_COLOR, "ms": 7.0}}
    return [Line2D([], [], **looks[label])]


def _legend(axes: list[Axes], figure: Figure | None, keys: list[Artist], title: str) -> None:
    """The legend: below all maps of a figure made here, above the last of the axes that were given."""
    across = min(3, len(axes))
    for k, one in enumerate(axes if figure is not None else ()):  # labels at the left and below alone
        if k % across:
            one.set_ylabel("")
        if k + across < len(axes):
            one.set_xlabel("")
    columns = min(len(keys), 3 if len(axes) == 1 else 4)
    if keys and figure is not None:
        figure.legend(handles=keys, title=title or None, loc="outside lower center", ncols=columns, **_LEGEND)
    elif keys:
        axes[-1].legend(handles=keys, title=title or None, loc="lower left", bbox_to_anchor=(0.0, 1.0), **_LEGEND)
