"""Planar chains as stick figures, the ellipses of their end point, and motions in Meshcat as a page or live."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, ModelWarning, nearest
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.visual.figures.planar_plots import PATH_COLOR, check_motion
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.playback.animation import export_motion, replay
from rbd.visual.playback.staging import checked
from rbd.visual.style import CONTACT_COLORS, a_count, rgb

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from rbd.planar.chain import Chain
    from rbd.planar.numeric import Ellipse
    from rbd.planar.planned_motion import PlanarMotion

LINK_COLOR, GROUND_COLOR, REACH_COLOR = "#24344d", "0.25", "0.75"
FORCE_COLOR = CONTACT_COLORS[6]
KINDS = ("manipulability", "velocity", "force")
MOST_STICKS = 200
_FAINTEST, _DARKEST = 0.13, 1.0
_LARGEST = 0.22
"""Semi-axis of the largest velocity ellipse as a share of the chain's length; force ellipses are cut at 1.6 of that."""
SEEN_FROM = (0.12, -1.0, 0.18)
"""From before the plane, so that x runs to the right, a little aside and above."""
BEADS = 60
"""Pieces of the path at most."""


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
    shown = _spread(len(points), a_count("count", count, MOST_STICKS))
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
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"no ellipse is called {kind!r:.80}; {nearest(kind, KINDS)}.")
    points = _points(chain, q_samples)
    q = np.atleast_2d(np.asarray(q_samples, float))
    shown = _along(points[:, -1], a_count("count", count, MOST_STICKS))
    ellipses = [chain.ellipse(q[sample], "force" if kind == "force" else "velocity") for sample in shown]
    size = float(sum(float(length) for length in chain.lengths))
    scale, longest = _scale(ellipses, size, kind)
    best = max((e.manipulability for e in ellipses), default=0.0) or 1.0
    drawn: list[Artist] = []
    notes: list[Artist] = []
    outlines = []
    for sample, ellipse in zip(shown, ellipses, strict=True):
        drawn += _stick(ax, points[sample], 0.35, 2.2, zorder=2)
        outlines.append(ellipse.points(120, scale=scale, longest=longest))
        drawn += _outline(ax, outlines[-1], kind, ellipse.manipulability / best)
        drawn += _axes(ax, ellipse, scale, longest, kind)
        if kind == "manipulability":
            notes.append(_tag(ax, ellipse, scale, _short(ellipse.manipulability, best)))
    notes.append(_key(ax, scale, kind, size))
    drawn += notes + _base(ax, chain)
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
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")


def _scale(ellipses: Sequence[Ellipse], size: float, kind: str) -> tuple[float, float]:
    """Metres of paper a metre a second, or a newton; and where a semi-axis is cut [m]."""
    axes = np.array([e.semi_axes for e in ellipses])
    if kind != "force":
        return _LARGEST * size / float(axes.max()), np.inf
    # Long axes grow without bound towards a singular pose: the short ones set the scale, as they do not.
    usual = float(np.median(axes[np.isfinite(axes)]))
    return 0.5 * _LARGEST * size / usual, 1.6 * _LARGEST * size


def _outline(ax: Axes, outline: Array, kind: str, share: float) -> list[Artist]:
    if kind == "force":
        return list(ax.fill(*outline.T, fc=(*rgb(FORCE_COLOR), 0.12), ec=FORCE_COLOR, lw=1.5, zorder=4))
    blue = rgb(CONTACT_COLORS[0])
    filled = (*blue, 0.06 + 0.44 * share) if kind == "manipulability" else (*blue, 0.0)
    return list(ax.fill(*outline.T, fc=filled, ec=CONTACT_COLORS[0], lw=1.5, zorder=4))


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
    title = f"{kind} ellipses: {bar:g} m drawn is {bar / scale:.2g} {unit} at {per}"
    if kind == "manipulability":
        title = f"manipulability [m²]; {bar:g} m drawn is {bar / scale:.2g} {unit} at {per}"
    return ax.set_title(title, loc="left", fontsize="small")


@dataclass(frozen=True, eq=False)
class _Played:
    """The data of a motion for the pages of `rbd.visual.playback.animation`, without contacts or forces."""

    robot: Robot
    t: Array
    q: Array
    v: Array
    points: Mapping[str, Array] = field(default_factory=dict)
    point_forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, Array] = field(default_factory=dict)
    events: tuple[Any, ...] = ()


def export_planar(
    motion: PlanarMotion, path: str | PathLike[str], *, title: str | None = None, speed: float = 0.5, start: float | None = None
) -> Path:
    """Write a planar motion as one HTML page that needs no network; returns its path.

    The chain is vertical in W, its x to the right and its y up, with the path of the end point behind it. It is seen from
    the front, and can be turned.

    Args:
        motion: What `endpoint_motion` or `joint_motion` returned, two samples at least.
        path: Of the page, ends in .html.
        title: Headline; what moves, by default.
        speed: Seconds of motion a second at first; the page can change it.
        start: Time at which the page opens [s]; the first by default.

    Raises:
        InputError: not a motion, or invalid settings.
        PictureError: the file cannot be written.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> reach = rbd.planar.endpoint_motion(arm, rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0))
        >>> print(rbd.visual.export_planar(reach, "reach.html").name)
        reach.html
    """
    check_motion(motion)
    title = title if title is not None else f"{motion.chain.n} link{'s' * (motion.chain.n > 1)}, minimum jerk"
    with _played(motion) as played:
        return export_motion(
            played, path, title=title, speed=speed, start=start, follow=False, trace=False, ground=False, charts=False,
            seen_from=SEEN_FROM,
        )  # fmt: skip


def replay_planar(motion: PlanarMotion, *, speed: float = 0.5) -> None:
    """Show a planar motion live in the browser, paced by the clock; returns when it is over.

    Args:
        motion: What `endpoint_motion` or `joint_motion` returned, two samples at least.
        speed: Seconds of motion a second.

    Raises:
        InputError: not a motion, or an invalid speed.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> reach = rbd.planar.endpoint_motion(arm, rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0))
        >>> rbd.visual.replay_planar(reach, speed=0.5)  # doctest: +SKIP
    """
    check_motion(motion)
    with _played(motion) as played:
        replay(played, speed=speed)


@contextmanager
def _played(motion: PlanarMotion) -> Iterator[Any]:
    """The motion of a robot that looks like the chain, its file existing as long as it is shown."""
    from rbd.planar.robot_file import robot_coordinates, to_urdf

    if len(motion) < 2:
        raise InputError("the motion has one sample only; expected two at least.")
    chain = motion.chain
    text = _drawn(to_urdf(chain, masses=[1.0] * chain.n, plane="xz"), motion)
    coordinates = robot_coordinates(chain)
    with tempfile.TemporaryDirectory(prefix="rbd-planar-") as folder:
        file = Path(folder) / "chain.urdf"
        file.write_text(text, encoding="utf-8")
        with warnings.catch_warnings():
            # It has no mass on purpose: then no centre of mass is drawn, of masses that were not given.
            warnings.simplefilter("ignore", ModelWarning)
            robot = load_robot(file, root="fixed")
        played = _Played(robot, motion.t, coordinates(motion.q), coordinates.rates(motion.qd))
        checked(played)
        yield played


def _drawn(text: str, motion: PlanarMotion) -> str:
    """The chain's URDF without masses and their balls, with a ball at the end point and the path behind."""
    root = ElementTree.fromstring(text)
    size = sum(float(length) for length in motion.chain.lengths)
    material = ElementTree.SubElement(root, "material", name="path")
    ElementTree.SubElement(material, "color", rgba=" ".join(f"{x:.3f}" for x in rgb(PATH_COLOR)) + " 1")
    links = {link.get("name"): link for link in root.iter("link")}
    for link in links.values():
        for mass in link.iter("mass"):
            mass.set("value", "0")
        for visual in link.findall("visual"):
            if visual.find("geometry/sphere") is not None:
                link.remove(visual)
    last = float(motion.chain.lengths[-1])
    _visual(links[f"link_{motion.chain.n}"], (last, 0.0, 0.0), (0.0, 0.0, 0.0), "sphere", radius=0.022 * size)
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(motion.x, axis=0).T))])
    beads = np.linspace(0.0, far[-1], BEADS + 1)
    points = np.column_stack([np.interp(beads, far, column) for column in motion.x.T]) if far[-1] > 0.0 else motion.x[:1]
    for a, b in zip(points[:-1], points[1:], strict=True):
        along, middle = b - a, 0.5 * (a + b)
        length = float(np.hypot(*along))
        # A cylinder is along z: turned about y it is in the plane. Longer by its width, so that bends have no gaps.
        turn = (0.0, float(np.arctan2(along[0], along[1])), 0.0)
        size_ = {"radius": 0.004 * size, "length": length + 0.002 * size}
        _visual(links["base"], (middle[0], 0.0, middle[1]), turn, "cylinder", **size_)
    return ElementTree.tostring(root, encoding="unicode")


def _visual(link: ElementTree.Element, xyz: tuple[float, ...], rpy: tuple[float, ...], shape: str, **sizes: float) -> None:
    visual = ElementTree.SubElement(link, "visual")
    place = {"xyz": " ".join(f"{x:.9g}" for x in xyz), "rpy": " ".join(f"{x:.9g}" for x in rpy)}
    ElementTree.SubElement(visual, "origin", place)
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, shape, {name: f"{value:.9g}" for name, value in sizes.items()})
    ElementTree.SubElement(visual, "material", name="path")
