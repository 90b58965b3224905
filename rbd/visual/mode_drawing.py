"""Drawings of modes of small motion: two poses beside the state, an animation, and bars of the coordinates that move."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import check_positive, check_whole
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.mechanism.small_motion.linearised import Linearised
from rbd.mechanism.small_motion.modes import Mode
from rbd.motion.reference_motion import Motion
from rbd.visual.figures.plots import an_axis
from rbd.visual.playback.animation import export_motion
from rbd.visual.robot_meshes import drawable
from rbd.visual.scene import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

FRAMES = 60
"""Of one period of an animation."""
AMPLITUDE = 0.15
"""Of a drawing [rad, or parts of the robot's length]."""
_COLORS = {"grows": "#d55e00", "decays": "#0072b2", "neutral": "#666666"}


def mode_scene(mode: Mode, *, amplitude: float = AMPLITUDE, **options: Any) -> Scene:
    """A scene with a mode's two poses of largest displacement, beside the state; the size is chosen, a mode has none.

    Of a mode whose parts do not move in phase, the first pose is that in which the largest entry is largest, and the second
    follows a quarter of a period later.

    Args:
        mode: Of `rbd.linearise(...).modes()`.
        amplitude: Of the largest entry [rad, or parts of the robot's length].
        options: Those of `rbd.visual.Scene`.

    Raises:
        InputError: no mode, an amplitude that is not positive, a mode of velocities alone.

    Example:
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> found = rbd.find_equilibrium(bars.at("assembled"))
        >>> scene = rbd.visual.mode_scene(found.linearised.modes()[0])
        >>> print(scene.export("mode.html").name)
        mode.html
    """
    size = _drawn_size(mode, amplitude)
    turned = "a quarter later" if np.iscomplexobj(mode.dq) else "the other way"
    later = -1j if np.iscomplexobj(mode.dq) else -1.0
    poses = {mode.title: mode.pose(size), turned: mode.pose(size * later)}
    scene = Scene(drawable(mode.state.robot), **options)
    scene.show(mode.state.with_velocity(mode.state.robot.zero_v))
    scene.beside(poses, note=f"{mode.words}; drawn with {size:g} rad (or robot's lengths) at the largest")
    return scene


def export_mode(mode: Mode, path: str | PathLike[str], *, amplitude: float = AMPLITUDE, **options: Any) -> Path:
    """Write a mode as an HTML page that plays one period for ever; returns its path.

    The mode neither grows nor decays there, and a moving robot stays at its place. A mode without oscillation goes to and
    fro once a second.

    Args:
        mode: Of `rbd.linearise(...).modes()`.
        path: Of the page, ends in .html.
        amplitude: Of the largest entry [rad, or parts of the robot's length].
        options: Those of `rbd.visual.export_motion`.

    Raises:
        InputError: no mode, an amplitude that is not positive, a mode of velocities alone.
        PictureError: the page cannot be written.

    Example:
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> found = rbd.find_equilibrium(bars.at("assembled"))
        >>> print(rbd.visual.export_mode(found.linearised.modes()[0], "swing.html").name)
        swing.html
    """
    size = _drawn_size(mode, amplitude)
    period = 1.0 / mode.frequency if mode.frequency else 1.0
    phases = np.linspace(0.0, 2.0 * math.pi, FRAMES + 1)
    q = np.array([mode.pose(size * np.exp(1j * phase)).q for phase in phases])
    robot, t = drawable(mode.state.robot), period * phases / (2.0 * math.pi)
    motion = Motion.of_arrays(robot, t, q, source="mode", quaternion="xyzw", trust=True)
    settings: dict[str, Any] = {"charts": False, "trace": False, "title": mode.title, "follow": False} | options
    return export_motion(motion, path, **settings)


def plot_mode(ax: Axes, mode: Mode, *, most: int = 10) -> list[Artist]:
    """Bars of a mode's shape: how far each coordinate moves, and by how much later than the largest.

    Args:
        ax: Matplotlib axes.
        mode: Of `rbd.linearise(...).modes()`.
        most: So many coordinates at most, those that move most.

    Returns:
        The bars and the texts of the phases.

    Raises:
        InputError: no axes, no mode.

    Example:
        >>> from matplotlib.figure import Figure
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> mode = rbd.find_equilibrium(bars.at("assembled")).linearised.modes()[0]
        >>> len(rbd.visual.plot_mode(Figure().subplots(), mode))
        3
    """
    an_axis(ax)
    check_kind("mode", mode, Mode, "one of rbd.linearise(...).modes()")
    names = list(mode.shares)[: check_whole("most", most)]
    joints = mode.state.robot.joints
    every = [c.name for c in joints.velocities]
    shape = (mode.dv if mode.of_velocity else mode.dq) / joints.scale
    values = [complex(shape[every.index(name)]) for name in names]
    places = np.arange(len(names))[::-1]
    signed = [value.real if not np.iscomplexobj(shape) else abs(value) for value in values]
    artists: list[Artist] = list(ax.barh(places, signed, color=_color_of(mode), height=0.6))
    if np.iscomplexobj(shape):
        for place, value in zip(places, values, strict=True):
            said = f"  {round(math.degrees(math.atan2(value.imag, value.real)))} deg"
            artists.append(ax.text(abs(value), float(place), said, va="center", fontsize=8))
        ax.margins(x=0.3)
    ax.axvline(0.0, color="black", lw=0.6)
    ax.set_yticks(places, names)
    ax.set(xlabel="rate, of the largest" if mode.of_velocity else "shape, of the largest [rad, robot's lengths]")
    ax.set_title(f"{mode.eigenvalue.real:+.3g} {mode.eigenvalue.imag:+.3g} i 1/s: {mode.words}", fontsize=9)
    return artists


def plot_eigenvalues(ax: Axes, linearised: Linearised) -> list[Artist]:
    """The eigenvalues in the complex plane: those that decay blue, those that grow red, neutral ones grey.

    Args:
        ax: Matplotlib axes.
        linearised: What `rbd.linearise` returned.

    Returns:
        The markers.

    Raises:
        InputError: no axes, nothing linearised.

    Example:
        >>> from matplotlib.figure import Figure
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> small = rbd.find_equilibrium(bars.at("assembled")).linearised
        >>> len(rbd.visual.plot_eigenvalues(Figure().subplots(), small))
        2
    """
    an_axis(ax)
    check_kind("linearised", linearised, Linearised, "what rbd.linearise returned")
    artists: list[Artist] = []
    for mode in linearised.modes():
        value = mode.eigenvalue
        both = [value.imag, -value.imag] if mode.frequency else [0.0]
        artists += ax.plot([value.real] * len(both), both, "o", color=_color_of(mode), ms=5)
    ax.axvline(0.0, color="black", lw=0.6)
    ax.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    return artists


def _color_of(mode: Mode) -> str:
    return _COLORS["grows" if mode.grows else "decays" if mode.decays else "neutral"]


def _drawn_size(mode: Mode, amplitude: float) -> float:
    """The amplitude of the drawing of a mode, both checked."""
    size = check_positive("amplitude", amplitude, 1e3)
    check_kind("mode", mode, Mode, "one of rbd.linearise(...).modes()")
    if mode.of_velocity or not np.isfinite(mode.dq).all():
        raise InputError(f"the mode {mode.title!r:.80} changes velocities alone: it has no poses to draw.")
    return size
