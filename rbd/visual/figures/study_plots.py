"""`plot_study`: what `rbd.study` returned as a map, as curves, as points, or as a map of the reasons without an answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.visual.figures.plots import an_axis
from rbd.visual.figures.study_charts import (
    FEW,
    NUMBERS,
    boundary_key,
    draw_curves,
    draw_map,
    draw_points,
    dress,
    family_colors,
    legend_keys,
    ring_key,
    scale_of,
)
from rbd.visual.figures.study_data import Axis, Quantity, StudyData
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
_LEGEND: dict[str, Any] = {
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
    data = StudyData(dataset, (x, y, by))
    if isinstance(value, str) and value == "ok":
        data = data.averaged((x, y, by))
    across, up, rest = _chosen(data, x, y, by)
    if data.drawn_at_random:
        return _draws(data, across, up, value, rest, ax)
    dims = [data.dim(what, name) for what, name in (("x", across), ("y", up), ("by", rest)) if name is not None]
    if len(set(dims)) < len(dims):
        raise InputError(f"x, y and by are {across!r}, {up!r} and {rest!r}, which are not all of different dimensions.")
    data.check_left(dims, by_given=rest is not None)
    shown, (ok, not_run) = data.quantity(value, dims), data.states(dims)
    if up is None and not shown.categories:
        return _curves(data, across, rest, shown, ok, not_run, ax)
    if up is None:  # categories are cells, and families are their rows
        up, rest = rest, None
    return _maps(data, (across, up, rest), shown, ok, not_run, ax)


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


def _maps(
    data: StudyData, names: tuple[str, str | None, str | None], shown: Quantity, ok: Array, not_run: Array, ax: object
) -> list[Artist]:
    """One map, or one for each value of the third name."""
    x = _distinct(data.axis("x", names[0]))
    y = None if names[1] is None else _distinct(data.axis("y", names[1]))
    panels = _titles(None if names[2] is None else data.axis("by", names[2]))
    tall = PANEL[1] if y is not None else 1.2
    axes, own = _axes(ax, len(panels), (PANEL[0], tall) if len(panels) > 1 else (6.8, tall + 0.9))
    shape = (len(x.at), 1 if y is None else len(y.at), len(panels))
    values, good, waiting = (a.reshape(shape) for a in (shown.values, ok, not_run))
    norm, bounded = _norm(shown, values), False
    drawn: list[Artist] = []
    for k, (title, one) in enumerate(zip(panels, axes, strict=True)):
        part = Quantity(shown.label, values[:, :, k], shown.categories)
        made = draw_map(one, x, y, part, good[:, :, k], waiting[:, :, k], norm)
        bounded |= made[-1].get_label() == "boundary"
        if title:
            one.set_title(title, fontsize="medium")
        drawn += made
    if not shown.categories:
        _color_bar(axes, drawn[0], shown)
    nothing = (shown.values < 0 if shown.categories else ~np.isfinite(shown.values)) & ~not_run
    keys = legend_keys(shown, nothing & ~ok, not_run, cells=True, blank=nothing & ok)
    _legend(axes, own, keys + [boundary_key()] * bounded, shown.label if shown.categories else "")
    return drawn


def _curves(data: StudyData, x: str, by: str | None, shown: Quantity, ok: Array, not_run: Array, ax: object) -> list[Artist]:
    families = None if by is None else data.axis("by", by)
    names = [""] if families is None else _families(families)
    colors = family_colors(families, names)
    (one,), own = _axes(ax, 1, (7.0, 4.2))
    shape = (-1, len(names))
    good, waiting = ok.reshape(shape), not_run.reshape(shape)
    drawn = draw_curves(one, data.axis("x", x), Quantity(shown.label, shown.values.reshape(shape)), good, waiting, colors)
    few = families is not None and (bool(families.words) or len(names) <= FEW)
    if families is not None and not few:
        from matplotlib.cm import ScalarMappable

        bar = one.figure.colorbar(ScalarMappable(scale_of(families), NUMBERS), ax=one)
        dress(bar.ax, families, "y")
    bad = ~good & ~waiting
    keys = drawn[: len(names)] * few + legend_keys(None, bad, np.zeros(0, bool))
    keys += [ring_key()] * bool((bad[1:] & good[:-1] | bad[:-1] & good[1:]).any()) + legend_keys(None, np.zeros(0), waiting)
    _legend([one], own, keys, families.label if few and families is not None else "")
    return drawn


def _families(by: Axis) -> list[str]:
    """A name for each value, all different."""
    words = [by.words[int(i)] for i in by.at] if by.words else []
    for names in (words, *([f"{at:.{digits}g}" for at in by.at] for digits in (4, 9, 17))):
        if len(set(names)) == len(by.at):
            return names
    return [f"{word} ({i})" for i, word in enumerate(words or names)]


def _draws(data: StudyData, x: str, y: str | None, value: object, by: str | None, ax: object) -> list[Artist]:
    """Points of two coordinates coloured by the value, one picture for each value of `by`; or of the value over x."""
    shown, (ok, not_run) = data.quantity(value, data.dims), data.states(data.dims)
    across, everything = data.axis("x", x), [("", np.ones(len(ok), bool))]
    colored: Quantity | None = shown
    if y is None:
        up = Axis(shown.label, shown.label, shown.values, tuple(text for text, _ in shown.categories))
        if not shown.categories or by is not None:
            colored = None if by is None else _colors_of(data.axis("by", by))
        parts = everything
    else:
        up = data.axis("y", y)
        parts = everything if by is None else _groups(data.axis("by", by))
    axes, own = _axes(ax, len(parts), PANEL if len(parts) > 1 else (6.4, 4.5))
    norm = None if colored is None else _norm(colored, colored.values)
    by_reason = colored is not None and bool(colored.categories) and colored.label == "reason"
    bad = ~ok & ~not_run & (not by_reason)
    drawn: list[Artist] = []
    for (title, which), one in zip(parts, axes, strict=True):
        points = [Axis(a.name, a.label, a.at[which], a.words, a.scale) for a in (across, up)]
        part = None if colored is None else Quantity(colored.label, colored.values[which], colored.categories)
        drawn += draw_points(one, points[0], points[1], part, ok[which], bad[which], not_run[which], norm)
        if title:
            one.set_title(title, fontsize="medium")
    if colored is not None and norm is not None:
        _color_bar(axes, drawn[0], colored)
    _legend(axes, own, legend_keys(colored, bad, not_run), colored.label if colored is not None and colored.categories else "")
    return drawn


def _colors_of(axis: Axis) -> Quantity:
    """A coordinate as what colours points."""
    if not axis.words:
        return Quantity(axis.label, axis.at)
    colors = distinct_colors(len(axis.words))
    return Quantity(axis.label, axis.at.astype(int), tuple(zip(axis.words, colors, strict=True)))


def _groups(axis: Axis) -> list[tuple[str, Array]]:
    """(title, which samples) of every value of a coordinate of draws."""
    values = np.unique(axis.at)
    return [(title, axis.at == at) for title, at in zip(_titles(axis, values), values, strict=True)]


def _titles(axis: Axis | None, values: Array | None = None) -> list[str]:
    """The title of the map of each value: name, value, unit; one empty title without an axis."""
    if axis is None:
        return [""]
    at = axis.at if values is None else values
    if len(at) > MOST_PANELS:
        raise InputError(
            f"by={axis.name!r} has {len(at)} values, more than there is room for pictures ({MOST_PANELS}); select some: "
            f"dataset.isel({{{axis.name!r}: slice(0, {MOST_PANELS})}}) of a grid, dataset.isel(sample=...) of draws."
        )
    if axis.words:
        return [axis.words[int(i)] for i in at]
    name, _, unit = axis.label.partition(" [")
    return [f"{name} = {value:g} {unit.rstrip(']')}".strip() for value in at]


def _distinct(axis: Axis) -> Axis:
    if len(np.unique(axis.at)) < len(axis.at):
        raise InputError(f"values of {axis.name} come twice, and a map has one cell for each; select: dataset.isel(...).")
    return axis


def _norm(shown: Quantity, values: Array) -> Normalize | None:
    """One scale of colours for all maps: even around zero where there are both signs; None for categories."""
    from matplotlib.colors import Normalize

    if shown.categories:
        return None
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if low < 0.0 < high:
        low, high = -max(-low, high), max(-low, high)
    half = 0.0 if high > low else 0.1 * abs(low) or 1.0  # one value alone has the colour in the middle
    return Normalize(low - half, high + half)


def _color_bar(axes: list[Axes], drawn: Artist, shown: Quantity) -> None:
    """The scale of colours of numbers; without numbers on it where no sample has one."""
    bar = axes[0].figure.colorbar(drawn, ax=axes, label=shown.label)  # type: ignore[arg-type]
    if not np.isfinite(shown.values).any():
        bar.set_ticks([])


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


def _legend(axes: list[Axes], figure: Figure | None, keys: list[Artist], title: str) -> None:
    """The legend: below all maps of a figure made here, above the last of the axes that were given."""
    if figure is not None:
        columns = min(3, len(axes))
        for k, one in enumerate(axes):  # labels at the left and below alone
            if k % columns:
                one.set_ylabel("")
            if k + columns < len(axes):
                one.set_xlabel("")
    if not keys:
        return
    columns = min(len(keys), 3 if len(axes) == 1 else 4)
    if figure is not None:
        figure.legend(handles=keys, title=title or None, loc="outside lower center", ncols=columns, **_LEGEND)
    else:
        axes[-1].legend(handles=keys, title=title or None, loc="lower left", bbox_to_anchor=(0.0, 1.0), **_LEGEND)
