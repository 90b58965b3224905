"""Planar chains as stick figures, and the ellipses of their end point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, check_whole
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.visual.figures.planar_plots import PATH_COLOR
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.style import CONTACT_COLORS, rgb

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from rbd.planar.chain import Chain
    from rbd.planar.numeric import Ellipse

LINK_COLOR, GROUND_COLOR, REACH_COLOR = "#24344d", "0.25", "0.75"
FORCE_COLOR = CONTACT_COLORS[6]
KINDS = ("manipulability", "velocity", "force")
MOST_STICKS = 200
_FAINTEST, _DARKEST = 0.13, 1.0
_LARGEST = 0.22
"""Semi-axis of the largest velocity ellipse as a share of the chain's length; force ellipses are cut at 1.6 of that."""


def plot_sticks(ax: Axes, chain: Chain, q_samples: Sequence[Sequence[float]] | Array, *, count: int = 9) -> list[Artist]:
    """The chain at some times of a motion, the earliest faint, the last dark, over the path of its end point.

    The dashed arcs bound what it can reach. Poses are spread evenly over the samples: over time, if these are.

    Args:
        ax: Matplotlib axes, empty; both directions get the same scale.
        chain: The chain, its lengths numbers.
        q_samples: Angles as the chain measures them [rad], shape (samples, n), or (n,) for one pose.
        count: How many poses are drawn; the first and the last always are, if there are two or more.

    Returns:
        The path (a line), a line a pose from the first to the last, the joints of the last one, then the base and the arcs.

    Raises:
        InputError: other axes, shapes or numbers, or lengths that are symbols.

    Example:
        >>> from matplotlib.figure import Figure
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.visual.plot_sticks(Figure().subplots(), arm, np.linspace([0.0, 0.5], [1.0, 1.5], 20), count=5)[0]
        >>> path.get_xydata().shape
        (20, 2)
    """
    an_axis(ax)
    points = _points(chain, q_samples)
    shown = _spread(len(points), check_whole("count", count, MOST_STICKS))
    drawn: list[Artist] = [*ax.plot(*points[:, -1].T, color=PATH_COLOR, lw=2.2, zorder=5, solid_capstyle="round")]
    for i, sample in enumerate(shown):
        age = 1.0 if len(shown) == 1 else i / (len(shown) - 1)
        drawn += _stick(ax, points[sample], _FAINTEST + (_DARKEST - _FAINTEST) * age**2.2, 2.0 + 1.6 * age, zorder=3 + age)
    last = points[shown[-1]]
    drawn += ax.plot(*last[1:-1].T, "o", color="white", mec=LINK_COLOR, mew=1.6, ms=7.0, ls="none", zorder=6)
    drawn += ax.plot(*points[0, -1], "o", color="white", mec=PATH_COLOR, mew=1.6, ms=7.0, zorder=6)
    drawn += ax.plot(*last[-1], "o", color=PATH_COLOR, mec="white", mew=1.0, ms=9.0, zorder=7)
    drawn += _base(ax, chain)
    _stage(ax)
    return drawn


def plot_ellipses(
    ax: Axes, chain: Chain, q_samples: Sequence[Sequence[float]] | Array, *, kind: str = "manipulability", count: int = 5
) -> list[Artist]:
    """The ellipse of the end point at some poses: directions of large velocity, and of large force.

    - "manipulability": all velocities that joint rates of unit length, `|qd| <= 1 rad/s`, can give [Yoshikawa1985], filled the
      darker the larger its area is, with the manipulability sqrt(det(J J^T)) [m^2] next to it;
    - "velocity": the same ellipses as outlines with their axes;
    - "force": all forces that joint torques of unit length, `|tau| <= 1 N m`, can balance: long where the other is short, and
      cut off (its axis dashed) where one direction costs no torque at all.

    All ellipses of a picture have one scale; see its title.

    Args:
        ax: Matplotlib axes, empty.
        chain: The chain, its lengths numbers.
        q_samples: Angles as the chain measures them [rad], shape (samples, n), or (n,).
        kind: One of the three kinds.
        count: How many poses, evenly along the path of the end point.

    Returns:
        For each pose the link's line, the outline, the axes of the ellipse; then notes, the base and the arcs.

    Raises:
        InputError: other axes, shapes or numbers, another kind, or lengths that are symbols.

    Example:
        >>> from matplotlib.figure import Figure
        >>> figure, arm = Figure(), rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> axes = figure.subplots()
        >>> artists = rbd.visual.plot_ellipses(axes, arm, [[0.2, 1.0], [0.6, 1.5]], kind="velocity")
        >>> figure.savefig("ellipses.png")
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('x [m]', 'y [m]')
    """
    an_axis(ax)
    check_known("no ellipse is called", kind, KINDS, InputError)
    points = _points(chain, q_samples)
    q = np.atleast_2d(np.asarray(q_samples, float))
    shown = _along(points[:, -1], check_whole("count", count, MOST_STICKS))
    ellipses = [chain.ellipse(q[sample], "force" if kind == "force" else "velocity") for sample in shown]
    size = float(sum(float(length) for length in chain.lengths))
    scale, longest = _scale(ellipses, size, kind)
    best = max((e.manipulability for e in ellipses), default=0.0) or 1.0
    drawn: list[Artist] = []
    notes: list[Artist] = []
    for sample, ellipse in zip(shown, ellipses, strict=True):
        drawn += _stick(ax, points[sample], 0.35, 2.2, zorder=2)
        drawn += _outline(ax, ellipse.points(120, scale=scale, longest=longest), kind, ellipse.manipulability / best)
        drawn += _axes(ax, ellipse, scale, longest, kind)
        if kind == "manipulability":
            notes.append(_tag(ax, ellipse, scale, _short(ellipse.manipulability, best)))
    drawn += [*notes, _key(ax, scale, kind, size), *_base(ax, chain)]
    _stage(ax)
    return drawn


def _points(chain: Chain, q_samples: object) -> Array:
    """Joints of every sample, shape (samples, n + 1, 2) [m]."""
    numeric = getattr(chain, "numeric", None)
    if numeric is None or isinstance(chain, type):
        raise InputError(f"chain is {chain!r:.80}; expected a planar chain, e.g. rbd.planar.Chain(2, lengths=(0.5, 0.5)).")
    points = np.asarray(numeric.positions(q_samples))
    points = points[None] if points.ndim == 2 else points
    if not len(points):
        raise InputError("q_samples are empty; expected at least one pose.")
    return points


def _spread(samples: int, count: int) -> Array:
    """Numbers of at most `count` samples, evenly; a single one is the last."""
    if count == 1:
        return np.array([samples - 1])
    return np.unique(np.linspace(0, samples - 1, min(count, samples)).round().astype(int))


def _along(path: Array, count: int) -> Array:
    """Numbers of at most `count` samples, evenly along a path: overlapping ellipses would be unreadable."""
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    if far[-1] == 0.0 or count == 1:
        return _spread(len(path), count)
    return np.unique(np.searchsorted(far, np.linspace(0.0, far[-1], count) * (1.0 - 1e-12)))


def _stick(ax: Axes, points: Array, alpha: float, width: float, zorder: float) -> list[Artist]:
    style: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round", "zorder": zorder}
    return list(ax.plot(*points.T, color=_blend(LINK_COLOR, alpha), lw=width, **style))


def _blend(color: str, alpha: float) -> tuple[float, ...]:
    """A colour on white: faint sticks that cross each other stay even."""
    return tuple(1.0 - alpha * (1.0 - np.array(rgb(color))))


def _base(ax: Axes, chain: Chain) -> list[Artist]:
    """The hinge on the ground, and the arcs between which the end point stays."""
    from matplotlib.patches import Circle

    lengths = [float(length) for length in chain.lengths]
    outer, inner = sum(lengths), max(2.0 * max(lengths) - sum(lengths), 0.0)
    drawn: list[Artist] = []
    for radius in (outer, inner):
        if radius > 1e-9 * outer:  # as a mere artist: limits are set by the chain, not by all it could reach
            circle = Circle((0.0, 0.0), radius, fill=False, ec=REACH_COLOR, lw=0.9, ls=(0, (4, 4)), zorder=0.5)
            circle.set_clip_path(ax.patch)
            drawn.append(ax.add_artist(circle))
    s = 0.045 * outer
    drawn += ax.fill([0.0, -s, s], [0.0, -1.5 * s, -1.5 * s], color="0.85", ec=GROUND_COLOR, lw=1.2, zorder=1)
    drawn += ax.plot([-1.9 * s, 1.9 * s], [-1.5 * s, -1.5 * s], color=GROUND_COLOR, lw=1.4, zorder=1)
    drawn += ax.plot(0.0, 0.0, "o", color="white", mec=GROUND_COLOR, mew=1.6, ms=7.0, zorder=6)
    return drawn


def _stage(ax: Axes) -> None:
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    frame(ax)
    ax.locator_params(nbins=6)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def _scale(ellipses: Sequence[Ellipse], size: float, kind: str) -> tuple[float, float]:
    """Metres of paper a metre a second, or a newton; and where a semi-axis is cut [m]."""
    axes = np.array([e.semi_axes for e in ellipses])
    if kind != "force":
        return _LARGEST * size / float(axes.max()), np.inf
    # Long axes grow without bound towards a singular pose: the short ones set the scale, as they do not.
    usual = float(np.median(axes[np.isfinite(axes)]))
    return 0.5 * _LARGEST * size / usual, 1.6 * _LARGEST * size


def _outline(ax: Axes, outline: Array, kind: str, share: float) -> list[Artist]:
    filled = {"force": 0.12, "manipulability": 0.06 + 0.44 * share, "velocity": 0.0}[kind]
    color = FORCE_COLOR if kind == "force" else CONTACT_COLORS[0]
    return list(ax.fill(*outline.T, fc=(*rgb(color), filled), ec=color, lw=1.5, zorder=4))


def _axes(ax: Axes, ellipse: Ellipse, scale: float, longest: float, kind: str) -> list[Artist]:
    """Both semi-axes as hairlines across; dashed where cut."""
    drawn: list[Artist] = []
    color = FORCE_COLOR if kind == "force" else CONTACT_COLORS[0]
    for length, direction in zip(ellipse.semi_axes, ellipse.directions.T, strict=True):
        cut = scale * length > longest
        ends = ellipse.centre + np.outer([-1.0, 1.0], direction) * min(scale * length, longest) * (1.25 if cut else 1.0)
        drawn += ax.plot(*ends.T, color=color, lw=0.9, ls=(0, (3, 2)) if cut else "-", zorder=4.5)
    return drawn


def _tag(ax: Axes, ellipse: Ellipse, scale: float, text: str) -> Artist:
    """The number next to the ellipse, on the side away from the base."""
    across = ellipse.directions[:, 1]
    side = across if across @ ellipse.centre >= 0.0 else -across
    at = ellipse.centre + scale * ellipse.semi_axes[1] * side
    ground = {"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4}
    ha = "left" if side[0] > 0.38 else "right" if side[0] < -0.38 else "center"
    va = "bottom" if side[1] > 0.38 else "top" if side[1] < -0.38 else "center"
    place: dict[str, Any] = {"xytext": 5.0 * side, "textcoords": "offset points", "ha": ha, "va": va, "zorder": 6}
    return ax.annotate(text, at, fontsize="small", color=CONTACT_COLORS[0], bbox=ground, **place)


def _short(value: float, largest: float) -> str:
    """Two digits of the largest, so that all numbers of a picture have the same decimals."""
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(largest))))}f}"


def _key(ax: Axes, scale: float, kind: str, size: float) -> Artist:
    """The scale of lengths on paper, above the axes."""
    per, unit = ("1 N m", "N") if kind == "force" else ("1 rad/s", "m/s")
    bar = 10.0 ** np.floor(np.log10(0.25 * size))
    what = "manipulability [m²];" if kind == "manipulability" else f"{kind} ellipses:"
    title = f"{what} {bar:g} m drawn is {bar / scale:.2g} {unit} at {per}"
    return ax.set_title(title, loc="left", fontsize="small")
