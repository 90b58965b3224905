"""Plots of a driven mechanism over its driven joint: angles, rates, transmission angle, path of a point.

Axes first, artists out, no window, no global state. Angles are drawn in degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.mechanism.branch_tracing import Trace
from rbd.mechanism.four_bar_class import FourBarPins, four_bar_pins
from rbd.mechanism.partition import link_rates
from rbd.model.inertial import body_names
from rbd.model.joints import ANGLE
from rbd.model.state import State
from rbd.records import joined
from rbd.robots.linkage import link_angles
from rbd.visual.figures.planar_plots import ANGLE_COLORS, BOLD
from rbd.visual.figures.plots import an_axis, cut_peaks, frame as frame_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_BURST, _OFTEN = 4.0, 92.0
"""(factor, per cent): rates beyond this factor times the size of so many per cent of them are cut off, with a note."""
_SIZE = (4.6, 3.4)
"""Of a panel [inches]."""


def plot_trace(
    axes: Axes | Sequence[Axes] | Array | None,
    trace: Trace,
    *,
    frame: str | None = None,
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
) -> list[Artist]:
    """Angles, rates, transmission angle and coupler curve of a driven mechanism, a panel each.

    Angles are those of its links from the ground where it moves in the x-z plane, as `rbd.mechanism.link_angles`; of others,
    those of its joints. Rates are over the rate of the driven joint: rad/s at 1 rad/s of it. What slides has its own panels.
    Transmission angle and coupler curve, by default that of the coupler's middle, are those of a planar four-bar. Limits of the
    motion are dashed lines.

    Args:
        axes: Empty Matplotlib axes, as many as panels, in this order; None: a new figure.
        trace: What `rbd.mechanism.trace` returned.
        frame: Frame of the link whose point's path is drawn, of any mechanism.
        offset: The point from the frame's origin, in its axes [m].

    Returns:
        The lines, panel by panel; then the marks of limits and the notes.

    Raises:
        InputError: other axes, no trace; Matplotlib is not installed.
        FrameNotFound: with the nearest names.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
        >>> turn = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(0.0, 2 * np.pi), steps=36)
        >>> artists = turn.plot()
        >>> print(*(ax.get_title() for ax in artists[0].figure.axes), sep=" | ")
        angle [°] | rate, over that of crank_joint | transmission angle [°], 41.4 to 92.9 | path of the middle of the coupler
    """
    check_kind("trace", trace, Trace, "what rbd.mechanism.trace returned")
    states = trace.states
    pins = four_bar_pins(states[0], trace.constraints, trace.joint)
    path, point = _path(trace, states, pins, frame, offset)
    angles, turning, sliding, along = _motions(trace, states)
    degree = trace.unit == ANGLE
    across = np.degrees(trace.input) if degree else trace.input
    over = f"rate, over that of {trace.joint}"
    panels: list[tuple[str, dict[str, Array]]] = []
    if angles:
        panels += [("angle [°]", {name: np.degrees(np.unwrap(x)) for name, x in angles.items()}), (over, turning)]
    if sliding:
        rate = f"{over} [m{'/rad' if degree else '/m'}]"
        panels += [(f"displacement of {joined(sliding)} [m]", sliding), (rate, along)]
    if pins is not None:
        mu = np.degrees([pins.transmission_angle(state) for state in states])
        panels.append((f"transmission angle [°], {mu.min():.1f} to {mu.max():.1f}", {"": mu}))
    grid = _axes_for(axes, len(panels) + (path is not None))
    drawn: list[Artist] = []
    notes: list[Artist] = []
    colors = {name: ANGLE_COLORS[k % len(ANGLE_COLORS)] for k, name in enumerate([*angles, *sliding])}
    for ax, (title, curves) in zip(grid, panels, strict=False):  # the path's follows
        for name, curve in curves.items():
            drawn += ax.plot(across, curve, color=colors.get(name, "0.25"), lw=BOLD, label=name, zorder=3)
        if title.startswith(over):
            values = np.column_stack(list(curves.values()))
            notes += cut_peaks(ax, across, values, "", factor=_BURST, often=_OFTEN, across="°" if degree else " m")
        for limit in trace.limits:
            notes.append(ax.axvline(np.degrees(limit.value) if degree else limit.value, color="0.5", lw=1.0, ls="--", zorder=1))
        frame_axes(ax, "y")
        ax.set(title=title, xlabel=f"{trace.joint} [{'°' if degree else 'm'}]")
        if len(curves) > 1:
            ax.legend(frameon=False, fontsize="small")
    if pins is not None:
        notes.append(grid[len(panels) - 1].axhline(90.0, color="0.75", lw=0.8, zorder=1))
    if path is not None:
        ax = grid[len(panels)]
        drawn += ax.plot(path[:, 0], path[:, 2], color=ANGLE_COLORS[1], lw=BOLD, zorder=3)
        notes += ax.plot(path[:1, 0], path[:1, 2], "o", color="white", mec=ANGLE_COLORS[1], ms=7.0, mew=1.6, zorder=4)
        frame_axes(ax, "both")
        ax.set(title=f"path of {point}", xlabel="x [m]", ylabel="z [m]")
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.08)
    return drawn + notes


def _motions(trace: Trace, states: Sequence[State]) -> tuple[dict[str, Array], ...]:
    """{name: values} of what turns [rad] and its rates, of what slides [m] and its rates."""
    robot, joints = trace.robot, [joint for joint in trace.robot.joints.values() if joint.nv == 1]
    v = trace.rates
    sliding = [joint for joint in joints if not joint.is_angle]
    slides = {joint.name: np.array([joint.coordinate(q) for q in trace.q]) for joint in sliding}
    along = {joint.name: v[:, joint.v.start] for joint in sliding}
    turning = [joint for joint in joints if joint.is_angle]
    try:
        each = [link_angles(state) for state in states]
        links = body_names(robot)
        names = {joint.name: links[joint.id - 1] for joint in turning}
        angles = {name: np.array([x[name] for x in each]) for name in names.values()}
        rated = [link_rates(state, np.nan_to_num(rates)) for state, rates in zip(states, v, strict=True)]
        lost = np.isnan(v).any(axis=1)
        rates = {name: np.where(lost, np.nan, [x[name] for x in rated]) for name in names.values()}
    except InputError:  # not in the x-z plane
        angles = {joint.name: np.array([joint.coordinate(q) for q in trace.q]) for joint in turning}
        rates = {joint.name: v[:, joint.v.start] for joint in turning}
    return angles, rates, slides, along


def _path(
    trace: Trace, states: Sequence[State], pins: FourBarPins | None, frame: str | None, offset: Sequence[float] | Array
) -> tuple[Array | None, str]:
    """Positions of the point whose path is drawn, and its name."""
    if frame is not None:
        return trace.points(frame, offset), f"a point of {frame}" if np.any(offset) else frame
    if pins is None:
        return None, ""
    return np.array([pins.middle(state) for state in states]), "the middle of the coupler"


def _axes_for(axes: Any, panels: int) -> list[Axes]:
    """The axes that are given, as many as panels; for None new ones, two in a row."""
    if axes is None:
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise InputError("plots need Matplotlib. Install the extra: pip install 'rbd-contact[plot]'") from None
        rows = -(-panels // 2)
        figure = Figure(figsize=(2 * _SIZE[0], rows * _SIZE[1]), layout="constrained")
        return [figure.add_subplot(rows, 2, k + 1) for k in range(panels)]
    given = list(np.ravel(np.asarray(axes, dtype=object)))
    if len(given) != panels:
        raise InputError(f"axes are {len(given)}; expected {panels}, one a panel, or None for a new figure.")
    for ax in given:
        an_axis(ax)
    return given
