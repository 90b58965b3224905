"""Plots of support regions, push limits and of what depends on a horizontal direction, on given axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, as_array, check_finite
from rbd.constraints.convex.polygons import convex_hull
from rbd.control.capture import CaptureRegion
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.state import State
from rbd.model.world import LEAST_FALL, along_gravity, is_along_z
from rbd.robust.places import RobustRegion
from rbd.robust.pushed import RobustPushLimits
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.wrench_cones import ContactWrenchCone
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.visual.figures.plots import an_axis, frame
from rbd.visual.marks.regions import name_and_color
from rbd.visual.style import COM_COLOR, LIMIT_COLORS, PUSH_COLOR, SUPPORT_COLOR, WRENCH_COLOR, contact_colors, distinct_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from rbd.problem.rows import Rows

_ROOM = 0.15
"""Room around what is drawn, as a share of its size."""


def plot_region(ax: Axes, *regions: SupportRegion | ZmpRegion | RobustRegion, labels: Sequence[str] = ()) -> list[Artist]:
    """Draw regions from above, over their contacts, with the centre of mass.

    Each region is an area with its edge; where its outer polygon is larger, that is dashed. One without end is cut off at the
    frame. Several are drawn over each other, the first strongest. Contacts have the colours of the scene.

    Args:
        ax: Matplotlib axes.
        regions: Of `support_region`, `zmp_region` or `rbd.robust.region`, of one robot.
        labels: Their names in the legend; what they are if not given.

    Returns:
        What was drawn: areas, outer polygons, contacts, the centre of mass.

    Raises:
        InputError: if `ax` are no axes, or something is no region.

    Example:
        >>> from matplotlib.figure import Figure
        >>> solo, axes = rbd.load_robot("solo12"), Figure().subplots()
        >>> region = rbd.statics.support_region(solo.standing(), solo.feet())
        >>> artists = rbd.visual.plot_region(axes, region, labels=["four feet"])
        >>> [text.get_text() for text in axes.get_legend().get_texts()]
        ['four feet', 'front_left', 'front_right', 'hind_left', 'hind_right', 'centre of mass']
    """
    an_axis(ax)
    if not regions or not all(isinstance(r, SupportRegion | ZmpRegion | RobustRegion) for r in regions):
        raise InputError(f"regions are {regions!r:.80}; expected what support_region, zmp_region or rbd.robust.region returns.")
    if not isinstance(labels, list | tuple) or len(labels) not in (0, len(regions)):
        raise InputError(f"labels are {labels!r:.80}; expected a name for each of {len(regions)} regions, or none.")
    drawn: list[Artist] = []
    for i, region in enumerate(regions):
        name, color = name_and_color(region)
        if labels:
            name = str(labels[i]) + (" (empty)" if region.empty else "" if region.bounded else " (without end)")
        corners, style = region.vertices[:, :2], ("-", "--", ":", "-.")[i % 4]
        share = 1.0 / (1 + i)
        drawn += ax.fill(*_closed(corners), color=color, alpha=0.18 * share, lw=0.0)
        drawn += ax.plot(*_closed(corners), style, color=color, lw=1.8, alpha=0.4 + 0.6 * share, label=name)
        if region.bounded and len(region.outer) and np.abs(region.outer[:, :2].max(axis=0) - corners.max(axis=0)).max() > 1e-6:
            label = "a member is not held outside" if isinstance(region, RobustRegion) and not labels else None
            drawn += ax.plot(*_closed(region.outer[:, :2]), "--", color=color, lw=1.0, label=label)
    state = regions[0].state
    drawn += _contacts(ax, state, [r for region in regions for r in region.loads.rows])
    com = _seen(state, state.com)
    drawn += ax.plot(com[:1], com[1:], "o", color=COM_COLOR, ms=6.0, mec="white", mew=0.8, label="centre of mass")
    _limits(ax, regions)
    along = "" if is_along_z(state.robot.gravity) else " on z = 0, along gravity"
    _plane(ax, f"x{along} [m]", "y [m]", legend="")
    return drawn


def plot_capture(ax: Axes, region: CaptureRegion) -> list[Artist]:
    """Draw a capture region from above: the inner polygon as an area, the outer one dashed, feet, the state's capture point.

    Args:
        ax: Matplotlib axes.
        region: Of `rbd.control.capture_region`.

    Returns:
        What was drawn: the area and its edge, the outer polygon, contacts, the centre of mass, the capture point.

    Raises:
        InputError: if `ax` are no axes, or `region` something else.

    Example:
        >>> from matplotlib.figure import Figure
        >>> solo, axes = rbd.load_robot("solo12"), Figure().subplots()
        >>> artists = rbd.visual.plot_capture(axes, rbd.control.capture_region(solo.standing(), solo.feet()))
        >>> [text.get_text() for text in axes.get_legend().get_texts()][:2]
        ['comes to rest from here', 'from outside it cannot']
    """
    an_axis(ax)
    check_kind("region of plot_capture", region, CaptureRegion, "what rbd.control.capture_region returns")
    drawn: list[Artist] = [*ax.fill(*_closed(region.inner), color=SUPPORT_COLOR, alpha=0.18, lw=0.0)]
    drawn += ax.plot(*_closed(region.inner), color=SUPPORT_COLOR, lw=1.8, label="comes to rest from here")
    drawn += ax.plot(*_closed(region.outer), "--", color=SUPPORT_COLOR, lw=1.0, label="from outside it cannot")
    drawn += _contacts(ax, region.state, region.end.loads.rows)
    (x, y), point = region.state.com[:2], region.capture_point
    drawn += ax.plot([x], [y], "o", color=COM_COLOR, ms=6.0, mec="white", mew=0.8, label="centre of mass")
    drawn += ax.plot(point[:1], point[1:], "X", color=PUSH_COLOR, ms=8.0, mec="white", mew=0.8, label="capture point")
    points = np.vstack([region.outer, point[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = _ROOM * float((high - low).max())
    ax.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    _plane(ax, "x [m]", "y [m]", legend="")
    return drawn


def plot_pushes(ax: Axes, limits: PushLimits | RobustPushLimits) -> list[Artist]:
    """Draw the largest pushes from above: a dot at the tip of each, coloured by what gives way, joined where they go round.

    Of a robot that is not held without a push, a line along each direction from the smallest push that holds it to the largest.
    Of a set of robots, what every member withstands as an area; on each direction a dot beyond which a member does not.

    Args:
        ax: Matplotlib axes.
        limits: Of `push_limits`, that of `rbd.robust` too; directions that are not level are drawn by their level part.

    Returns:
        What was drawn: the curve through the tips, or the lines; then the dots, one artist a kind of limit.

    Raises:
        InputError: if `ax` are no axes, or `limits` something else.

    Example:
        >>> from matplotlib.figure import Figure
        >>> solo, axes = rbd.load_robot("solo12"), Figure().subplots()
        >>> around = [(np.cos(angle), np.sin(angle), 0.0) for angle in np.arange(8) * np.pi / 4]
        >>> limits = rbd.statics.push_limits(solo.standing(), solo.feet(), "base_link", around)
        >>> curve, *dots = rbd.visual.plot_pushes(axes, limits)
        >>> axes.get_xlabel()
        'push at base_link along x [N]'
    """
    an_axis(ax)
    if isinstance(limits, RobustPushLimits):
        return _both_outlines(ax, limits)
    if not isinstance(limits, PushLimits):
        raise InputError(f"limits are {limits!r:.80}; expected what rbd.statics.push_limits or rbd.robust.push_limits returns.")
    tips = limits.directions[:, :2] * limits.forces[:, None]
    order = np.argsort(np.arctan2(tips[:, 1], tips[:, 0]), kind="stable")
    drawn: list[Artist] = []
    if not limits.held:
        ends = np.array([limits.directions[:, :2] * limits.least[:, None], tips])[:, np.isfinite(limits.forces)]
        drawn += ax.plot(ends[..., 0], ends[..., 1], "-", color="0.6", lw=1.0, zorder=1)
    elif len(tips) > 2:
        drawn += ax.plot(*_closed(tips[order]), "-", color="0.6", lw=1.0, zorder=1)
    kinds = [given[0].kind if given else "none" for given in limits.gives_way]
    for kind, (color, label) in LIMIT_COLORS.items():
        of = tips[[k == kind for k in kinds] & np.isfinite(limits.forces)]
        if len(of):
            drawn += ax.plot(of[:, 0], of[:, 1], "o", color=color, ms=5.0, mec="white", mew=0.6, label=label, zorder=2)
    ax.plot([0.0], [0.0], "+", color=COM_COLOR, ms=9.0)
    _plane(ax, f"push at {limits.frame} along x [N]", "along y [N]", legend="limit reached first")
    return drawn


def _both_outlines(ax: Axes, limits: RobustPushLimits) -> list[Artist]:
    """The pushes that every member withstands, a convex set, as an area; dots on rays beyond which one does not."""
    order = np.argsort(np.arctan2(limits.directions[:, 1], limits.directions[:, 0]), kind="stable")
    inner, outer = ((limits.directions[:, :2] * size[:, None])[order] for size in (limits.inner, limits.outer))
    drawn: list[Artist] = []
    drawn += ax.fill(*_closed(inner), color=PUSH_COLOR, alpha=0.18, lw=0.0)
    drawn += ax.plot(*_closed(inner), "-", color=PUSH_COLOR, lw=1.8, label="every member withstands")
    drawn += ax.plot(*np.stack([inner, outer], axis=1).T, "-", color=PUSH_COLOR, lw=0.7)
    drawn += ax.plot(*outer.T, "o", color=PUSH_COLOR, mfc="white", ms=4.5, mew=1.0, label="a member does not withstand more")
    ax.plot([0.0], [0.0], "+", color=COM_COLOR, ms=9.0)
    _plane(ax, f"push at {limits.frame} along x [N]", "along y [N]", legend="")
    return drawn


def plot_wrench_cone(ax: Axes, cone: ContactWrenchCone) -> list[Artist]:
    """Draw how far a force through the cone's point may lean without a moment: f_x / f_z and f_y / f_z.

    Args:
        ax: Matplotlib axes.
        cone: Of `wrench_cone`.

    Returns:
        The area and its edge; nothing but a mark at zero where no such force is in the cone.

    Raises:
        InputError: if `ax` are no axes, or `cone` something else.

    Example:
        >>> from matplotlib.figure import Figure
        >>> solo = rbd.load_robot("solo12")
        >>> cone = rbd.statics.wrench_cone(solo.standing(), solo.feet(friction=0.7))
        >>> area = rbd.visual.plot_wrench_cone(Figure().subplots(), cone)[0]
        >>> cone.leans().round(3)
        array([[-0.495, -0.495],
               [ 0.495, -0.495],
               [ 0.495,  0.495],
               [-0.495,  0.495]])
    """
    an_axis(ax)
    check_kind("cone", cone, ContactWrenchCone, "what rbd.statics.wrench_cone returns")
    corners = cone.leans()
    drawn: list[Artist] = []
    if len(corners):
        drawn += ax.fill(*_closed(corners), color=WRENCH_COLOR, alpha=0.2, lw=0.0)
        drawn += ax.plot(*_closed(corners), "-", color=WRENCH_COLOR, lw=1.8)
    drawn += ax.plot([0.0], [0.0], "+", color=COM_COLOR, ms=9.0)
    _plane(ax, "$f_x / f_z$ of a force through the point, without a moment", "$f_y / f_z$")
    return drawn


def _plane(ax: Axes, across: str, up: str, *, legend: str | None = None) -> None:
    """The same scale across and up, the names of both, and a legend on the right with this title, where one is given."""
    ax.set_aspect("equal")
    ax.set(xlabel=across, ylabel=up)
    if legend is not None:
        ax.legend(frameon=False, fontsize="small", title=legend or None, loc="center left", bbox_to_anchor=(1.0, 0.5))
    frame(ax, "both")


def _closed(corners: Array) -> tuple[Array, Array]:
    ends = np.vstack([corners, corners[:1]])
    return ends[:, 0], ends[:, 1]


def _seen(state: State, points: Array) -> Array:
    """Points along gravity on z = 0, (x, y); from above where gravity does not meet that plane."""
    g = state.robot.gravity
    meets = abs(g[2]) > LEAST_FALL * np.linalg.norm(g)
    return along_gravity(g, points) if meets else points[..., :2]


def _contacts(ax: Axes, state: State, rows: Sequence[Rows]) -> list[Artist]:
    """The outlines of contacts from above, each once: a patch as an outline, a point as a cross."""
    drawn: list[Artist] = []
    patches = {r.name: r.patch for r in rows if r.patch is not None}
    for name, color in contact_colors(patches).items():
        patch = patches[name]
        assert patch is not None
        corners = convex_hull(_seen(state, patch.corners_W))
        if len(corners) > 2:
            drawn += ax.fill(*_closed(corners), color=color, alpha=0.3, lw=0.0, label=name, zorder=1)
        else:
            drawn += ax.plot(*_closed(corners), "-" if len(corners) == 2 else "x", color=color, lw=3.0, label=name, zorder=1)
    return drawn


def _limits(ax: Axes, regions: Sequence[SupportRegion | ZmpRegion | RobustRegion]) -> None:
    """Room around contacts, centres of mass and regions that end."""
    state = regions[0].state
    points = [_seen(state, state.com)[None]]
    points += [region.vertices[:, :2] for region in regions if region.bounded]
    points += [_seen(state, r.patch.corners_W) for region in regions for r in region.loads.rows if r.patch is not None]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    room = _ROOM * max(float((high - low).max()), 0.05)
    ax.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))


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
    check_kind("quantity", quantity, str, "text")
    check_kind("unit", unit, str, "text")
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
