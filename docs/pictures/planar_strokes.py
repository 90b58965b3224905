"""Strokes of the drawings in the course on planar chains: links, hinges, angles, arrows; colours, and writing of the file."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

PICTURES = Path(__file__).resolve().parent
LINK, OTHER, GREY, GROUND = "#24344d", "#b8c0cc", "0.45", "0.25"


def along(angle: float) -> np.ndarray:
    """Unit vector at an angle from x."""
    return np.array([np.cos(angle), np.sin(angle)])


def across(angle: float) -> np.ndarray:
    """Unit vector a quarter turn further."""
    return np.array([-np.sin(angle), np.cos(angle)])


def link(
    ax: Axes, points, color: str, *, width: float = 6.0, last: bool = True, alpha: float = 1.0, front: bool = False
) -> None:
    """A row of links, their hinges, and a dot at the end."""
    x, y = np.array(points).T
    order = 5 if front else 3
    style = {"solid_capstyle": "round", "solid_joinstyle": "round", "alpha": alpha}
    ax.plot(x, y, color=color, lw=width, zorder=order, **style)
    ax.plot(x[:-1], y[:-1], "o", color="white", mec=color, mew=1.8, ms=9.0, zorder=order + 1)
    if last:
        ax.plot(x[-1:], y[-1:], "o", color=color, ms=10.0, zorder=order + 1)
    else:
        ax.plot(x[-1:], y[-1:], "o", color="white", mec=color, mew=1.8, ms=9.0, zorder=order + 1)


def hinge(ax: Axes, at) -> None:
    """A hinge on the ground."""
    corners = np.add(at, [(0.0, 0.0), (-0.05, -0.08), (0.05, -0.08)])
    ax.add_patch(Polygon(corners, closed=True, facecolor="0.85", edgecolor=GROUND, lw=1.0, zorder=2))


def angle_mark(
    ax: Axes, at, start: float, stop: float, radius: float, name: str, *, color: str = GREY, far: float = 1.3
) -> None:
    """An arc between two directions, with its name."""
    around = np.linspace(start, stop, 40)
    ax.plot(at[0] + radius * np.cos(around), at[1] + radius * np.sin(around), color=color, lw=1.3, zorder=2)
    away = np.add(at, far * radius * along(0.5 * (start + stop)))
    ax.text(*away, name, ha="center", va="center", fontsize=12, color="black" if color == GREY else color, zorder=8)


def turn(ax: Axes, at, radius: float, start: float, stop: float, color: str) -> None:
    """A circular arrow, counterclockwise."""
    around = np.linspace(start, stop, 40)
    x, y = at[0] + radius * np.cos(around), at[1] + radius * np.sin(around)
    ax.plot(x, y, color=color, lw=1.6, zorder=5)
    tip = {"arrowstyle": "-|>", "color": color, "lw": 1.6, "mutation_scale": 11, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", xy=(x[-1], y[-1]), xytext=(x[-4], y[-4]), arrowprops=tip, zorder=5)


def arrow(
    ax: Axes, at, vector, color: str, name: str = "", shift=(0.0, 0.0), *, width: float = 2.4, ha: str = "center", front=False
) -> None:
    """An arrow from a point, with its name at the tip."""
    style = {"arrowstyle": "-|>", "color": color, "lw": width, "mutation_scale": 16, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", xy=np.add(at, vector), xytext=at, arrowprops=style, zorder=7 if front else 6)
    ax.text(*(np.add(at, vector) + shift), name, color=color, ha=ha, va="bottom", zorder=8)


def plane(ax: Axes, title: str, *, ground: bool = True) -> None:
    """Axes without a frame, both directions at one scale, over a line for the ground."""
    if ground:
        ax.axhline(0.0, color="0.6", lw=1.0, zorder=0)
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(title, loc="left")


def save(figure: Figure, name: str) -> Path:
    """Write a figure beside this script."""
    figure.savefig(PICTURES / f"{name}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{name}.png"
