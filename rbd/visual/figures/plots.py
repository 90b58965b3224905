"""Common parts of plots, and the ranges of forces that go with one motion.

Axes first, artists out, no window, no global state. Only Matplotlib's own objects are used.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rbd.answers.analysis.uniqueness import Range, Uniqueness
from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.visual.style import contact_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_NET, _CORNER = 9.0, 4.0
"""Line widths of a contact's range and of its corners' [points]."""


def plot_ranges(ax: Axes, uniqueness: Uniqueness) -> list[Artist]:
    """Ranges of normal forces with the same motion: a bar a contact, a thin one a corner, the answer marked.

    Ranges without an end run to the edge of the axes and end in an arrow. Colours are those of the scene.

    Args:
        ax: Matplotlib axes to draw on; they should be empty, as their limits are set.
        uniqueness: `solution.uniqueness()`.

    Returns:
        What was drawn: for every range its bar (a line) and its mark, then arrows.

    Raises:
        InputError: if `ax` are not axes, or `uniqueness` is not a `Uniqueness`.

    Example:
        >>> from matplotlib.figure import Figure
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> solution = rbd.solve(rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1]), [], [face])
        >>> axes = Figure().subplots()
        >>> artists = rbd.visual.plot_ranges(axes, solution.uniqueness())
        >>> axes.get_xlabel(), len(artists)  # a bar and a mark for the face, and for each of its four corners
        ('normal force [N]; bar: possible with the same motion, dot: returned', 10)
    """
    an_axis(ax)
    check_kind("uniqueness", uniqueness, Uniqueness, "what solution.uniqueness() returns")
    lines: list[tuple[str, Range, str, float]] = []
    colors = contact_colors(uniqueness.contacts)
    for name, contact in uniqueness.contacts.items():
        lines.append((name, contact.normal, colors[name], _NET))
        if len(contact.corners) > 1:
            lines += [(f"corner {i + 1}", corner, colors[name], _CORNER) for i, corner in enumerate(contact.corners)]
    low, high = _limits([r for _, r, _, _ in lines])
    drawn: list[Artist] = []
    arrows: list[Artist] = []
    for y, (_, r, color, width) in enumerate(lines):
        ends = (max(r.lowest, low), min(r.highest, high))
        drawn += ax.plot(ends, (y, y), "-", color=color, lw=width, alpha=0.45, solid_capstyle="butt")
        drawn += ax.plot([r.value], [y], "o", color=color, ms=6.0, mec="white", mew=0.8)
        for end, edge, marker in ((r.lowest, low, "<"), (r.highest, high, ">")):
            if math.isinf(end):
                arrows += ax.plot([edge], [y], marker, color=color, ms=8.0, clip_on=False)
    ax.set_yticks(range(len(lines)), [label for label, _, _, _ in lines])
    ax.axvline(0.0, color="0.6", lw=0.8, zorder=0)
    words = "normal force [N]; bar: possible with the same motion, dot: returned"
    ax.set(xlim=(low, high), ylim=(len(lines) - 0.4, -0.6), xlabel=words)
    return drawn + arrows


def an_axis(ax: object) -> None:
    """Refuse an object that is not axes.

    Raises:
        InputError: if it is none.
    """
    if isinstance(ax, type) or not callable(getattr(ax, "set_yticks", None)):
        raise InputError(f"ax is {ax!r:.80}; expected Matplotlib axes, e.g. matplotlib.figure.Figure().subplots().")


def axes_or_new(ax: Axes | None) -> Axes:
    """The axes given, or those of a new figure of pyplot, which `plt.show()` then shows.

    Raises:
        InputError: Matplotlib is not installed.
    """
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise InputError("Matplotlib is not installed here. Install the extra: pip install 'rbd-contact[plot]'") from error
    return pyplot.subplots(layout="constrained")[1]


def axes_of(axes: Any, most: int, size: tuple[float, float], **layout: Any) -> list[Axes]:
    """The axes that are given, as a list; for None `most` new ones, one below the other, on a figure of this size [inches].

    Raises:
        InputError: too many, or what are no axes; Matplotlib is not installed.
    """
    if axes is None:
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise InputError("plots need Matplotlib. Install the extra: pip install 'rbd-contact[plot]'") from None
        return list(Figure(figsize=size, layout="constrained").subplots(most, **layout))
    given = list(np.ravel(np.asarray(axes, dtype=object)))
    if not 1 <= len(given) <= most:
        raise InputError(f"axes are {len(given)}; expected one{', or two' if most == 2 else f' to {most}'}.")
    for ax in given:
        an_axis(ax)
    return given


def frame(ax: Axes, grid: Literal["x", "y", "both"] | None = None) -> None:
    """A frame open above and on the right, behind it pale lines across "x", "y" or "both"."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_axisbelow(True)
    if grid is not None:
        ax.grid(axis=grid, color="0.92", lw=0.7, zorder=0)


def cut_peaks(ax: Axes, t: Array, values: Array, unit: str, *, factor: float, often: float, across: str = " s") -> list[Artist]:
    """Limits of an axis that show most samples well; a note of the largest if that is cut off.

    Args:
        ax: Axes.
        t: Times, shape (n,) [s], or what else runs across.
        values: Of all curves, shape (n, k); NaN where there is none.
        unit: Their unit.
        factor: Samples larger than this factor times the usual size are cut off.
        often: Per cent of the samples that are at most as large as the usual size.
        across: Unit of t, with a space before it where it has one.
    """
    known = np.isfinite(values).all(axis=1)
    t, values = t[known], values[known]
    size = np.abs(values)
    usual = float(np.percentile(size, often))
    within = values[size <= factor * usual]
    if not usual or len(within) == values.size:
        return []
    low, high = float(within.min()), float(within.max())
    room = 0.06 * max(high - low, usual)
    ax.set_ylim(min(0.0, low) - room, max(0.0, high) + room)
    worst = np.unravel_index(int(size.argmax()), values.shape)
    peak = float(f"{values[worst]:.3g}")
    told = f"{peak:,.0f}" if abs(peak) >= 1000.0 else f"{peak:g}"
    text = f"cut off: {told} {unit}\nat {t[worst[0]]:.3g}{across}".replace("-", "\N{MINUS SIGN}")
    y, va = (0.97, "top") if peak > high else (0.03, "bottom")
    ground = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
    style: dict[str, Any] = {"ha": "right", "va": va, "color": "0.3", "fontsize": "x-small", "bbox": ground, "zorder": 5}
    return [ax.text(0.97, y, text, transform=ax.transAxes, **style)]


def _limits(ranges: list[Range]) -> tuple[float, float]:
    """Limits of the axis, with room beyond the last finite end."""
    ends = [x for r in ranges for x in (r.lowest, r.value, r.highest) if math.isfinite(x)] + [0.0]
    room = 0.06 * max(max(ends) - min(ends), 1.0)
    endless = (any(r.lowest == -math.inf for r in ranges), any(r.highest == math.inf for r in ranges))
    return min(ends) - room * (1.0 + 3.0 * endless[0]), max(ends) + room * (1.0 + 3.0 * endless[1])
