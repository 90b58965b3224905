"""The pictures of docs/courses/planar_chains/index.md, as PNG files beside this script; `make.py` calls `pictures()`."""

import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import rbd
import rbd.planar
from rbd.visual import Scene, screenshot
from rbd.visual.planar_figures import plot_ellipses, plot_sticks
from rbd.visual.planar_plots import plot_panels, plot_paths, plot_split

PICTURES = Path(__file__).resolve().parent
LINK, OTHER, GREY = "#24344d", "#b8c0cc", "0.45"
VELOCITY, TANGENTIAL, CENTRIPETAL = "#0072b2", "#009e73", "#d55e00"


def pictures() -> Iterator[Path]:
    """All of them."""
    yield links()
    yield ellipses()
    yield from motions()
    yield leg()


def links() -> Path:
    """One link with its velocity and the parts of its acceleration, and two links on both branches to one target."""
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    one, two = figure.subplots(1, 2)
    angle, rate, acceleration = np.radians(40.0), 0.8, 0.55
    e, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    around = np.radians(np.linspace(-8.0, 98.0, 100))
    one.plot(np.cos(around), np.sin(around), color="0.8", lw=1.0, ls="--")
    _link(one, [(0.0, 0.0), e], LINK)
    _angle(one, (0.0, 0.0), 0.0, angle, 0.28, "$\\theta$")
    one.text(*(0.5 * e + 0.06 * n), "$\\ell$", color=LINK, ha="center", va="center", fontsize=13)
    _arrow(one, e, rate * n, VELOCITY, "$\\mathbf{v} = \\ell\\dot\\theta\\,\\mathbf{n}$", (-0.02, 0.04))
    _arrow(one, e, 0.55 * acceleration * n, TANGENTIAL, "tangential\n$\\ell\\ddot\\theta\\,\\mathbf{n}$", (0.24, 0.04))
    _arrow(one, e, -0.5 * rate**2 * e, CENTRIPETAL, "centripetal\n$-\\ell\\dot\\theta^2\\,\\mathbf{e}$", (0.30, -0.14))
    one.set(xlim=(-0.25, 1.45), ylim=(-0.22, 1.36))

    arm = rbd.planar.Chain(2, lengths=(0.6, 0.5))
    found = rbd.planar.inverse(arm, (0.62, 0.62))
    for q, color in ((found.branches[1], OTHER), (found.branches[0], LINK)):
        points = arm.numeric.positions(q)
        _link(two, points, color)
        if color == LINK:
            _angle(two, points[0], 0.0, q[0], 0.3, "$\\theta_1$")
            two.plot(*np.array([points[1], points[1] + 0.24 * (points[1] - points[0]) / 0.6]).T, color=GREY, lw=1.0, ls=":")
            _angle(two, points[1], q[0], q[0] + q[1], 0.15, "$\\theta_2$")
            style = {"color": LINK, "ha": "center", "va": "center", "fontsize": 13}
            two.text(*(0.6 * points[1] + (-0.02, 0.05)), "$\\ell_1$", **style)
            two.text(*(0.5 * (points[1] + points[2]) + (0.06, 0.0)), "$\\ell_2$", **style)
    two.plot([0.0, 0.62], [0.0, 0.62], color=GREY, lw=1.0, ls="--")
    two.text(0.66, 0.64, "target (x, y)", color=LINK, va="center")
    two.text(*(arm.numeric.positions(found.branches[1])[1] + (-0.03, 0.04)), "the other branch", color=GREY, ha="right")
    two.set(xlim=(-0.3, 1.0), ylim=(-0.12, 0.8))
    for ax, title in ((one, "One link"), (two, "Two links, two ways to one point")):
        _plane(ax, title)
    return _save(figure, "planar_links")


def ellipses() -> Path:
    """Velocity and force ellipses of an arm that stretches."""
    arm = rbd.planar.Chain(2, lengths=(0.5, 0.5))
    q = np.array([rbd.planar.inverse(arm, (x, 0.0), start=(0.5, -1.0)).q for x in (0.3, 0.6, 0.85)])
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    for ax, kind in zip(figure.subplots(1, 2), ("velocity", "force"), strict=True):
        plot_ellipses(ax, arm, q, kind=kind, count=3)
        ax.set_title("what it reaches at 1 rad/s" if kind == "velocity" else "what it holds at 1 N m", loc="left")
    return _save(figure, "planar_ellipses")


def motions() -> Iterator[Path]:
    """The motions of section 6."""
    arm = rbd.planar.Chain(2, lengths=(0.5, 0.5))
    reach = rbd.planar.minimum_jerk([-0.5, 0.5], [0.0, 0.5 * np.sqrt(2.0)], 1.0)
    turn = rbd.planar.minimum_jerk(np.radians([90.0, 90.0]), np.radians([45.0, 90.0]), 1.0)
    figure = Figure(figsize=(9.0, 6.6), layout="constrained")
    rows = figure.subplots(2, 2)
    for axes, motion, told in (
        (rows[0], rbd.planar.endpoint_motion(arm, reach), "planned for the hand"),
        (rows[1], rbd.planar.joint_motion(arm, turn), "planned for the joints"),
    ):
        plot_paths(axes, motion)
        for ax in axes:
            ax.set_title(f"{ax.get_title(loc='left')}, {told}", loc="left")
    yield _save(figure, "planar_paths")

    text = rbd.planar.minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0)
    motion = rbd.planar.endpoint_motion(arm, text, times=np.linspace(0.01, 1.0, 100))
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    plot_panels(figure.subplots(2, 4, sharex=True), motion)
    yield _save(figure, "planar_panels")
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    plot_split(figure.subplots(1, 3, sharex=True, sharey=True), motion)
    yield _save(figure, "planar_parts")
    figure = Figure(figsize=(6.0, 4.2), layout="constrained")
    plot_sticks(figure.subplots(), arm, motion.q, count=9)
    yield _save(figure, "planar_sticks")


def leg() -> Path:
    """Talos from the side, and its leg as three links in the plane with both ellipses of its sole."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        talos = rbd.load_robot("talos")
    stance = talos.standing()
    pitch = talos.actuated[[talos.actuated_names.index(f"leg_left_{i}_joint") for i in (3, 4, 5)]]
    chain = rbd.planar.Chain(3, lengths=(0.380, 0.325, 0.107))
    q = -stance.q[pitch + 1] - [np.pi / 2, 0.0, 0.0]
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    beside, fast, strong = figure.subplots(1, 3, width_ratios=(1.0, 1.1, 1.1))
    with tempfile.TemporaryDirectory() as folder, Scene(talos, seen_from=(0.0, -1.0, 0.05), legend=False) as scene:
        scene.show(stance)
        page = scene.export(Path(folder) / "talos.html")
        shot = Image.open(screenshot(page, Path(folder) / "talos.png", width=520, height=900))
        beside.imshow(np.asarray(shot))
    beside.set_axis_off()
    for ax, kind, title in ((fast, "velocity", "velocity at 1 rad/s"), (strong, "force", "force at 1 N m")):
        plot_ellipses(ax, chain, q, kind=kind, count=1)
        ax.set_title(title, loc="left")
    return _save(figure, "planar_leg")


def _link(ax: Axes, points, color: str) -> None:
    x, y = np.array(points).T
    ax.plot(x, y, color=color, lw=6.0, solid_capstyle="round", solid_joinstyle="round", zorder=3)
    ax.plot(x[:-1], y[:-1], "o", color="white", mec=color, mew=1.8, ms=9.0, zorder=4)
    ax.plot(x[-1:], y[-1:], "o", color=color, ms=10.0, zorder=4)


def _angle(ax: Axes, at, start: float, stop: float, radius: float, name: str) -> None:
    around = np.linspace(start, stop, 40)
    ax.plot(at[0] + radius * np.cos(around), at[1] + radius * np.sin(around), color=GREY, lw=1.2, zorder=2)
    middle = 0.5 * (start + stop)
    away = np.add(at, 1.3 * radius * np.array([np.cos(middle), np.sin(middle)]))
    ax.text(*away, name, ha="center", va="center", fontsize=12)


def _arrow(ax: Axes, at, vector, color: str, name: str, shift: tuple[float, float]) -> None:
    style = {"arrowstyle": "-|>", "color": color, "lw": 2.4, "mutation_scale": 18, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", xy=np.add(at, vector), xytext=at, arrowprops=style, zorder=5)
    ax.text(*(np.add(at, vector) + shift), name, color=color, ha="center", va="bottom")


def _plane(ax: Axes, title: str) -> None:
    ax.axhline(0.0, color="0.6", lw=1.0, zorder=1)
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(title, loc="left")


def _save(figure: Figure, name: str) -> Path:
    figure.savefig(PICTURES / f"{name}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{name}.png"


if __name__ == "__main__":
    for made in pictures():
        print(made.name)
