"""The pictures of example 28, a walk: the robot at seven times, and its plan from above; `make.py` calls `pictures()`."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scenes
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from photographs import motion_sheet
from PIL import Image

import rbd
from rbd.visual.figures.plots import frame

PICTURES = Path(__file__).resolve().parent
EXAMPLE = "28_talos_walks"
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
WIDTH, HEIGHT, DPI = 2136, 430, 178  # [pixels]
SIDE = (0.45, -1.0, 0.2)


def pictures() -> Iterator[Path]:
    """All of them."""
    yield walk()


def walk() -> Path:
    """A strip of pictures, with footprints, zero-moment point and centre of mass below it."""
    result = scenes.result(EXAMPLE)
    starts = [start for start, *_ in result.plan.swings]
    times = [starts[0] - 0.15, *[start + 0.55 for start in starts]]
    with tempfile.TemporaryDirectory() as folder:
        size: dict[str, Any] = {"width": WIDTH // len(times) - 5, "height": HEIGHT}
        strip = motion_sheet(result.walk, times, Path(folder) / "strip.png", **size, seen_from=SIDE, trace=False)
        above = Path(folder) / "above.png"
        figure = Figure(figsize=(WIDTH / DPI, 3.4), layout="constrained")
        plot_plan(figure.subplots(), result)
        figure.savefig(above, dpi=DPI, metadata={"Software": None})
        return stacked([strip, above], PICTURES / "walk.png")


def stacked(parts: list[Path], picture: Path) -> Path:
    """Pictures below each other, centred."""
    images = [Image.open(part).convert("RGB") for part in parts]
    width = max(image.width for image in images)
    sheet = Image.new("RGB", (width, sum(image.height for image in images)), "white")
    top = 0
    for image in images:
        sheet.paste(image, ((width - image.width) // 2, top))
        top += image.height
    sheet.save(picture)
    return picture


def plot_plan(ax: Axes, result: Any) -> None:
    """Footprints, zero-moment point and centre of mass from above, planned and walked."""
    plan, walk = result.plan, result.walk
    for (foot, corners), color in zip(walk.points.items(), (BLUE, ORANGE), strict=True):
        stood = [0.0, *[start + 0.9 for start, swung, *_ in plan.swings if swung == foot]]
        for i in np.searchsorted(walk.t, stood):
            ax.fill(*corners[i, :, :2].T, facecolor=color, edgecolor=color, alpha=0.25)
    ax.plot(*plan.zmp.T, color="0.7", lw=3.5, label="zero-moment point, planned")
    ax.plot(*pressure(walk).T, color=GREEN, lw=1.0, label="centre of pressure")
    ax.plot(*plan.com[0].T[:2], color="0.8", lw=4.5, label="centre of mass, planned")
    ax.plot(*walk.com.T[:2], color="black", lw=1.3, label="centre of mass")
    ax.set(aspect="equal", xlabel="forward [m]", ylabel="to the left [m]", yticks=(-0.1, 0.0, 0.1))
    ax.legend(frameon=False, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    frame(ax)


def pressure(walk: rbd.Trajectory) -> np.ndarray:
    """The centre of pressure at each time, shape (n, 2)."""
    points, forces = (np.concatenate(list(each.values()), axis=1) for each in (walk.points, walk.point_forces))
    return (points * forces[..., 2:]).sum(axis=1)[:, :2] / forces[..., 2].sum(axis=1, keepdims=True)
