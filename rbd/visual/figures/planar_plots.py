"""Plots of planar chains on given axes: curves over time, paths, and the parts of the acceleration.

Axes first, artists out, no window, no global state. Angles are drawn in degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.visual.figures.plots import an_axis, cut_peaks, frame
from rbd.visual.playback.planar_motion import PATH_COLOR, is_planar
from rbd.visual.style import CONTACT_COLORS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from rbd.planar.planned_motion import PlanarMotion

X_COLOR, Y_COLOR = CONTACT_COLORS[0], CONTACT_COLORS[1]
ANGLE_COLORS = tuple(CONTACT_COLORS[k] for k in (2, 6, 4, 3, 5, 7))
BOLD, PALE = 1.9, 5.0
"""Line widths of a curve, and of the total behind its parts [points]."""
_STROKES = ("-", "--", ":", "-.")
"""Of the angles; the next one where the colours begin again."""
SPACES = ("endpoint", "joint")
ROWS = {
    "endpoint": ("position [m]", "velocity [m/s]", "acceleration [m/s²]", "jerk [m/s³]"),
    "joint": ("angle [°]", "velocity [°/s]", "acceleration [°/s²]", "jerk [°/s³]"),
}
PARTS = ("tangential", "centripetal", "coriolis")
ANGLES = {"joint": "joint angles", "segment": "segment angles", "vertical": "angles from the vertical"}
_BURST, _OFTEN = 4.0, 92.0
"""(factor, per cent): a curve beyond this factor times the size of so many per cent of its samples is cut off, with a note."""
_BEATS = 21
"""Dots along a path, evenly in time: close together where it is slow."""


def plot_panels(axes: Sequence[Sequence[Axes]] | Array, motion: PlanarMotion) -> list[Artist]:
    """Displacement, velocity, acceleration and jerk over time, of the end point and of the angles: 2 x 4 panels.

    The space in which the motion was planned is the upper row, what follows from it the lower one. Where a curve shoots up
    near a singular pose the axis is cut off, with a note of the curve's maximum.

    Args:
        axes: Eight empty Matplotlib axes, shape (2, 4), as `Figure().subplots(2, 4, sharex=True)` gives them.
        motion: What `endpoint_motion` or `joint_motion` returned.

    Returns:
        The lines, row by row and panel by panel: x and y of the end point, or one line an angle; then the notes.

    Raises:
        InputError: other axes, or no motion.

    Example:
        >>> from matplotlib.figure import Figure
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> reach = rbd.planar.endpoint_motion(arm, rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0))
        >>> lines = rbd.visual.plot_panels(Figure().subplots(2, 4, sharex=True), reach)
        >>> len(lines)  # x and y, or two angles, in each of eight panels
        16
    """
    grid = _axes_for(motion, axes, (2, 4))
    drawn: list[Artist] = []
    notes: list[Artist] = []
    for row, space in enumerate(SPACES if motion.space == "endpoint" else SPACES[::-1]):
        names, colors = _curves(motion, space)
        kinds = ("x", "v", "a", "j") if space == "endpoint" else ("q", "qd", "qdd", "qddd")
        for column, (kind, title) in enumerate(zip(kinds, ROWS[space], strict=True)):
            ax, values = grid[row, column], getattr(motion, kind)
            values = values if space == "endpoint" else np.degrees(values)
            for k, (curve, name, color) in enumerate(zip(values.T, names, colors, strict=True)):
                style: dict[str, Any] = {"ls": _STROKES[k // len(ANGLE_COLORS) % len(_STROKES)], "zorder": 3}
                drawn += ax.plot(motion.t, curve, color=color, lw=BOLD, label=name, **style)
            unit = title[title.index("[") + 1 : -1]
            notes += cut_peaks(ax, motion.t, values, unit, factor=_BURST, often=_OFTEN)
            _dress(ax, motion, title)
            if row == 1:
                ax.set_xlabel("time [s]")
        grid[row, 0].set_ylabel("end point" if space == "endpoint" else ANGLES.get(motion.chain.angles, "angles"))
        _legend(grid[row, 0], ncols=-(-len(names) // 6))
    return drawn + notes


def plot_paths(axes: Sequence[Axes] | Array, motion: PlanarMotion) -> list[Artist]:
    """The path in the plane, and the path in the space of the angles: a straight path in one is curved in the other.

    Dots lie evenly in time, close together where the motion is slow. Of two links the second angle is drawn over the first,
    of more links each further one; the one angle of one link over time.

    Args:
        axes: Two empty Matplotlib axes, shape (2,).
        motion: What `endpoint_motion` or `joint_motion` returned.

    Returns:
        For each curve its line, its dots, and its marks of beginning and end.

    Raises:
        InputError: other axes, or no motion.

    Example:
        >>> from matplotlib.figure import Figure
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> reach = rbd.planar.endpoint_motion(arm, rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0))
        >>> path = rbd.visual.plot_paths(Figure().subplots(1, 2), reach)[0]
        >>> path.get_xydata()[[0, -1]].round(3)  # from the start to the stop
        array([[1. , 0.5],
               [0.5, 1. ]])
    """
    plane, joints = _axes_for(motion, axes, (2,))
    drawn = _path(plane, motion, motion.x[:, 0], motion.x[:, 1], PATH_COLOR, "end point")
    plane.set(xlabel="x [m]", ylabel="y [m]")
    plane.set_title("end-point space", loc="left")
    plane.set_aspect("equal", adjustable="datalim")
    names, colors = _curves(motion, "joint")
    q = np.degrees(motion.q)
    if motion.chain.n == 1:
        drawn += _path(joints, motion, motion.t, q[:, 0], colors[0], names[0])
        joints.set(xlabel="time [s]", ylabel=f"{names[0]} [°]")
    else:
        for k in range(1, motion.chain.n):
            drawn += _path(joints, motion, q[:, 0], q[:, k], colors[k if motion.chain.n > 2 else 0], names[k])
        joints.set(xlabel=f"{names[0]} [°]", ylabel=f"{names[1]} [°]" if motion.chain.n == 2 else "further angles [°]")
        if motion.chain.n > 2:
            _legend(joints)
    space = "joint space" if motion.chain.angles == "joint" else f"space of the {ANGLES[motion.chain.angles]}"
    joints.set_title(space, loc="left")
    for ax in (plane, joints):
        frame(ax, "both")
        ax.margins(0.08)
    return drawn


def plot_split(axes: Sequence[Axes] | Array, motion: PlanarMotion) -> list[Artist]:
    """The three parts of the end point's acceleration, each in front of the sum, a thick pale line.

    Tangential: what angular accelerations give; centripetal: what squares of angular velocities give; Coriolis: what products
    of two different ones give. Which is which depends on the chain's angles; their sum does not.

    Args:
        axes: Three empty Matplotlib axes, shape (3,).
        motion: What `endpoint_motion` or `joint_motion` returned.

    Returns:
        Panel by panel: x and y of the whole, then x and y of the part.

    Raises:
        InputError: other axes, or no motion.

    Example:
        >>> from matplotlib.figure import Figure
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> reach = rbd.planar.endpoint_motion(arm, rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0))
        >>> len(rbd.visual.plot_split(Figure().subplots(1, 3), reach))  # x and y of the sum and of the part, in three panels
        12
    """
    panels = _axes_for(motion, axes, (3,))
    parts = [np.asarray(getattr(motion.split, part), float) for part in PARTS]
    everything = np.hstack([motion.a, *parts])
    low, high = float(everything.min()), float(everything.max())
    room = 0.06 * (high - low) or 1.0
    drawn: list[Artist] = []
    for ax, title, part in zip(panels, ("tangential", "centripetal", "Coriolis"), parts, strict=True):
        for values, style in ((motion.a, {"lw": PALE, "alpha": 0.25}), (part, {"lw": BOLD})):
            suffix = ", whole" if values is motion.a else ""
            for curve, name, color in zip(values.T, "xy", (X_COLOR, Y_COLOR), strict=True):
                drawn += ax.plot(motion.t, curve, color=color, label=name + suffix, zorder=3, **style)
        _dress(ax, motion, title)
        ax.axhline(0.0, color="0.75", lw=0.8, zorder=1)
        ax.set(xlabel="time [s]", ylim=(low - room, high + 4.0 * room))  # with room for the legend
    panels[0].set_ylabel("acceleration of the end point [m/s²]")
    _legend(panels[0], loc="upper left", ncols=2)
    return drawn


def _axes_for(motion: object, axes: object, shape: tuple[int, ...]) -> Array:
    """Matplotlib axes in an array of a shape, for a motion of a planar chain.

    Raises:
        InputError: if they are others, or it is none.
    """
    grid = np.array(axes, dtype=object)
    if grid.shape != shape:
        came = "one" if grid.shape == () else f"an array of shape {grid.shape}"
        how = f"Figure().subplots({', '.join(map(str, shape if len(shape) > 1 else (1, *shape)))})"
        raise InputError(f"axes are {came}; expected {' x '.join(map(str, shape))} Matplotlib axes, e.g. {how}.")
    for ax in grid.flat:
        an_axis(ax)
    if not is_planar(motion):
        raise InputError(f"motion is {motion!r:.80}; expected what rbd.planar.endpoint_motion or joint_motion returns.")
    return grid


def _curves(motion: PlanarMotion, space: str) -> tuple[list[str], list[str]]:
    """Names and colours of the curves of a row."""
    if space == "endpoint":
        return ["x", "y"], [X_COLOR, Y_COLOR]
    angles = range(motion.chain.n)
    names = ["$\\theta$"] if len(angles) == 1 else [f"$\\theta_{{{k + 1}}}$" for k in angles]
    return names, [ANGLE_COLORS[k % len(ANGLE_COLORS)] for k in angles]


def _path(ax: Axes, motion: PlanarMotion, across: Array, up: Array, color: str, name: str) -> list[Artist]:
    beats = np.linspace(motion.t[0], motion.t[-1], _BEATS)
    x, y = (np.interp(beats, motion.t, values) for values in (across, up))
    return [
        *ax.plot(across, up, color=color, lw=BOLD, label=name, zorder=3),
        *ax.plot(x, y, "o", color=color, ms=4.0, mew=0.0, zorder=4),
        *ax.plot(across[:1], up[:1], "o", color="white", mec=color, ms=8.0, mew=1.6, zorder=5),
        *ax.plot(across[-1:], up[-1:], "o", color=color, mec="white", ms=9.0, mew=1.2, zorder=5),
    ]


def _dress(ax: Axes, motion: PlanarMotion, title: str) -> None:
    frame(ax, "y")
    ax.set_title(title, loc="left", fontsize="medium")
    ax.locator_params(nbins=5)
    if len(motion.t) > 1:
        ax.set_xlim(min(0.0, motion.t[0]), motion.t[-1])


def _legend(ax: Axes, loc: str = "best", ncols: int = 1) -> None:
    style: dict[str, Any] = {"handlelength": 1.4, "columnspacing": 1.0, "borderaxespad": 0.2}
    ax.legend(loc=loc, frameon=False, fontsize="small", ncols=ncols, **style)  # type: ignore[call-overload]
