"""Motions, ellipses and the leg of the course on planar chains, as PNG files beside this script."""

import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from photographs import screenshot
from PIL import Image
from planar_strokes import save

import rbd
import rbd.planar
from rbd.visual import Scene
from rbd.visual.figures.planar_figures import plot_ellipses, plot_sticks
from rbd.visual.figures.planar_plots import plot_panels, plot_paths, plot_split


def pictures() -> Iterator[Path]:
    """All of them."""
    yield one_link_panels()
    yield ellipses()
    yield from motions()
    yield leg()


def one_link_panels() -> Path:
    """The text's one-link motion: 0 to 90 degrees in 1 s with the least jerk, a link of 1 m."""
    turn = rbd.planar.minimum_jerk([0.0], [0.5 * np.pi], 1.0)
    motion = rbd.planar.joint_motion(rbd.planar.Chain(1, lengths=[1.0]), turn)
    figure = Figure(figsize=(9.8, 5.0), layout="constrained")
    plot_panels(figure.subplots(2, 4, sharex=True), motion)
    return save(figure, "planar_one_link_panels")


def ellipses() -> Path:
    """Velocity and force ellipses of an arm that stretches."""
    arm = rbd.planar.Chain(2, lengths=(0.5, 0.5))
    q = np.array([rbd.planar.inverse(arm, (x, 0.0), start=(0.5, -1.0)).q for x in (0.3, 0.6, 0.85)])
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    for ax, kind in zip(figure.subplots(1, 2), ("velocity", "force"), strict=True):
        plot_ellipses(ax, arm, q, kind=kind, count=3)
    return save(figure, "planar_ellipses")


def motions() -> Iterator[Path]:
    """The motions of the page on smooth motion."""
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
    yield save(figure, "planar_paths")

    text = rbd.planar.minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0)
    motion = rbd.planar.endpoint_motion(arm, text, times=np.linspace(0.01, 1.0, 100))
    figure = Figure(figsize=(9.8, 5.0), layout="constrained")
    plot_panels(figure.subplots(2, 4, sharex=True), motion)
    yield save(figure, "planar_panels")
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    plot_paths(figure.subplots(1, 2), motion)
    yield save(figure, "planar_text_paths")
    figure = Figure(figsize=(8.8, 3.4), layout="constrained")
    plot_split(figure.subplots(1, 3, sharex=True, sharey=True), motion)
    yield save(figure, "planar_parts")
    figure = Figure(figsize=(6.0, 4.2), layout="constrained")
    plot_sticks(figure.subplots(), arm, motion.q, count=9)
    yield save(figure, "planar_sticks")


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
    for ax, kind in ((fast, "velocity"), (strong, "force")):
        plot_ellipses(ax, chain, q, kind=kind, count=1)
        ax.set_title(ax.get_title(loc="left").replace(": ", ":\n"), loc="left", fontsize="small")
    return save(figure, "planar_leg")


if __name__ == "__main__":
    for made in pictures():
        print(made.name)
