"""The pictures of example 28, a walk: seven times of it over its plan, and all of it moving; `make.py` calls `pictures()`."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import scenes
from matplotlib.figure import Figure
from photographs import motion_sheet
from PIL import Image

PICTURES = Path(__file__).resolve().parent
EXAMPLE = "28_talos_walks"
WIDTH, HEIGHT, DPI = 2136, 430, 178  # [pixels]
SIDE = (0.45, -1.0, 0.2)


def pictures() -> Iterator[Path]:
    """All of them."""
    yield walk()
    yield walking()


def walk() -> Path:
    """A strip of pictures, and the plan below it, from above."""
    result = scenes.result(EXAMPLE)
    plan = result.controller.plan
    times = [plan.footsteps[0].start - 0.15, *[step.end - 0.15 for step in plan.footsteps]]
    with tempfile.TemporaryDirectory() as folder:
        size: dict[str, Any] = {"width": WIDTH // len(times) - 5, "height": HEIGHT}
        strip = motion_sheet(result.walk, times, Path(folder) / "strip.png", **size, seen_from=SIDE, trace=False)
        above = Path(folder) / "above.png"
        figure = Figure(figsize=(WIDTH / DPI, 3.4), layout="constrained")
        plan.plot(figure.subplots())
        figure.savefig(above, dpi=DPI, metadata={"Software": None})
        return stacked([strip, above], PICTURES / "walk.png")


def walking() -> Path:
    """The moving picture of the README: the whole walk, as a GIF, which every code host shows."""
    shown: dict[str, Any] = {"width": 640, "height": 400, "fps": 12.5}
    return scenes.result(EXAMPLE).walk.video(PICTURES / "walking.gif", seen_from=(0.6, -1.0, 0.25), trace=False, **shown)


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
