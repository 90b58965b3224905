"""A plot on given polar axes of what depends on a horizontal direction: largest impulses, pushes, distances to an edge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, as_array, check_finite
from rbd.errors import InputError
from rbd.visual.figures.plots import an_axis
from rbd.visual.style import distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_MARKERS = "os^Dv*PX"
_AROUND = {0: "ahead (x)", 90: "left (y)", 180: "back", 270: "right"}
_FILL = 0.08


def plot_directions(
    ax: Axes,
    directions: Sequence[Sequence[float]] | Array,
    curves: Mapping[str, Sequence[float] | Array],
    *,
    quantity: str = "",
    unit: str = "",
) -> list[Artist]:
    """Draw sizes by horizontal direction as closed curves on polar axes, seen from above: x points up, y to the left.

    Each curve has its colour and its marker, the same in the legend, and goes round in the order of the angles.

    Args:
        ax: Matplotlib axes with a polar projection.
        directions: In W, shape (k, 2) or (k, 3): horizontal parts of any length above zero, which does not count.
        curves: {name in the legend: sizes, shape (k,), none below zero}.
        quantity: What the sizes are: the title of the legend.
        unit: Their unit, written at the circles.

    Returns:
        For each curve its line and its area.

    Raises:
        InputError: axes that are not polar, a direction without a horizontal part, sizes that do not fit or are below zero.

    Example:
        >>> from matplotlib.figure import Figure
        >>> solo, axes = rbd.load_robot("solo12"), Figure().add_subplot(projection="polar")
        >>> around = [(np.cos(angle), np.sin(angle), 0.0) for angle in np.arange(8) * np.pi / 4]
        >>> limits = rbd.statics.push_limits(solo.standing(), solo.feet(), "base_link", around)
        >>> line, area = rbd.visual.plot_directions(
        ...     axes, around, {"four feet": limits.forces}, quantity="largest push at the base", unit="N"
        ... )
        >>> float(np.abs(line.get_ydata()[:-1] - limits.forces).max())  # the last point is the first again
        0.0
    """
    an_axis(ax)
    if getattr(ax, "name", None) != "polar":
        raise InputError("ax are not polar axes; make them: figure.add_subplot(projection='polar').")
    angles = _angles(directions)
    if not isinstance(curves, Mapping) or not all(isinstance(name, str) for name in curves):
        raise InputError(f"curves are {curves!r:.80}; expected {{name: sizes}}.")
    for what, text in (("quantity", quantity), ("unit", unit)):
        if not isinstance(text, str):
            raise InputError(f"{what} is {text!r:.80}; expected text.")
    sizes = {name: _sizes(name, given, len(angles)) for name, given in curves.items()}
    order = np.argsort(angles, kind="stable")
    closed = np.append(order, order[:1])
    drawn: list[Artist] = []
    for i, (color, (name, size)) in enumerate(zip(distinct_colors(len(sizes)), sizes.items(), strict=True)):
        marker = _MARKERS[i % len(_MARKERS)]
        drawn += ax.plot(angles[closed], size[closed], marker + "-", color=color, lw=1.6, ms=5.0, mec="white", label=name)
        drawn += ax.fill(angles[closed], size[closed], color=color, alpha=_FILL, lw=0.0)
    ax.set_theta_zero_location("N")  # type: ignore[attr-defined]  # of polar axes alone
    ax.set_xticks(np.radians(range(0, 360, 45)), [_AROUND.get(angle, f"{angle}°") for angle in range(0, 360, 45)])
    ax.set_rlim(0.0, 1.08 * max((float(size.max(initial=0.0)) for size in sizes.values()), default=0.0) or 1.0)  # type: ignore[attr-defined]
    ax.set_rlabel_position(202.5)  # type: ignore[attr-defined]
    ax.yaxis.set_major_formatter(lambda size, _: f"{size:g} {unit}".strip())
    ax.tick_params(axis="y", labelsize="small", labelcolor="0.35")
    ax.grid(color="0.88", lw=0.7)
    ax.spines["polar"].set_visible(False)
    if sizes:
        ax.legend(frameon=False, fontsize="small", title=quantity or None, loc="center left", bbox_to_anchor=(1.12, 0.5))
    return drawn


def _angles(directions: Sequence[Sequence[float]] | Array) -> Array:
    """Angles from x towards y in [0, 2 pi), shape (k,)."""
    given = as_array("directions", directions)
    if given.ndim != 2 or given.shape[1] not in (2, 3) or not len(given):
        raise InputError(f"directions have shape {given.shape}; expected (k, 2) or (k, 3), one or more of them.")
    check_finite("directions", given)
    if not given[:, :2].any(axis=1).all():
        raise InputError("a direction has no horizontal part; expected vectors in W, e.g. (0, 1, 0).")
    return np.arctan2(given[:, 1], given[:, 0]) % (2.0 * np.pi)


def _sizes(name: str, given: Sequence[float] | Array, count: int) -> Array:
    size = as_array(f"sizes of {name!r:.80}", given)
    if size.shape != (count,):
        raise InputError(f"sizes of {name!r:.80} have shape {size.shape}; expected ({count},), one per direction.")
    check_finite(f"sizes of {name!r:.80}", size)
    if (size < 0.0).any():
        raise InputError(f"a size of {name!r:.80} is {size.min():g}; expected none below zero.")
    return size
