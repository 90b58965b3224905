"""A motion as a video: one browser draws all its pictures, which go to ffmpeg or into a GIF as they come."""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import check_positive
from rbd.errors import InputError, PictureError
from rbd.model.output_files import check_place, write_file
from rbd.simulation.progress_bar import progress_of
from rbd.visual.pages.browser import Browser, BrowserPage, a_browser, one_browser
from rbd.visual.pages.encoders import QUALITY, Encoder, encoder_of
from rbd.visual.pages.link import page_link
from rbd.visual.pages.page import text_of, write_page
from rbd.visual.playback.animation import Playback, motion_scene, shown_motion
from rbd.visual.style import MOST_SIZE, a_path, check_size

if TYPE_CHECKING:
    from rbd.motion.reference_motion import Motion
    from rbd.motion.report import MotionReport
    from rbd.planar.planned_motion import PlanarMotion
    from rbd.simulation.trajectory import Trajectory

MOST_FPS = 240.0
MOST_FRAMES = 20_000
LEAST_SIZE = 16
LAID_OUT = 960
"""Width of the window of all pictures that are neither very small nor very large."""
SMALLEST_SCALE, LARGEST_SCALE = 0.5, 4.0
SAMPLES = 6
"""Pictures from which a .gif takes its colours."""
BATCH = 6
"""Pictures that the browser draws at a time, while those before them are written."""
# The page's own canvas without smoothed edges, whose cost is that of all triangles: video.js smooths the picture.
_BEFORE = """
window.mostSegments = 300;
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, given) {
  const quick = { ...given, antialias: false, preserveDrawingBuffer: true };
  return plain.call(this, kind, kind.includes("webgl") ? quick : given);
};
"""


def export_video(
    motion: Trajectory | Motion | MotionReport | PlanarMotion,
    path: str | PathLike[str],
    *,
    fps: float = 30.0,
    width: int = 960,
    height: int = 540,
    view: str | None = None,
    layers: Mapping[str, bool] | None = None,
    browser: Browser | None = None,
    progress: bool = True,
    **settings: Any,
) -> Path:
    """Write a motion as a video, with its legend and the time; returns its path.

    The name's ending is the kind: .mp4 is made by the `ffmpeg` on PATH, .gif by Pillow. A headless browser draws the pictures,
    coarser than a page does: details below a pixel are merged, and bodies cast shadows on the ground, or the terrain, alone.
    Neither a screen nor a graphics card is needed. Ctrl-C ends it; the file is written whole or not at all.

    Args:
        motion: As for `export_motion`.
        path: Of the video, ends in .mp4 or .gif.
        fps: Pictures a second; at most 240, in a .gif 50.
        width: Pixels across, even for .mp4.
        height: Pixels down, even for .mp4.
        view: Where the camera stands: "start", "front", "side" or "top".
        layers: {layer: whether it is shown}, of `rbd.visual.pages.link.LAYERS`.
        browser: An open browser; by default one is started.
        progress: Whether to draw a bar on a terminal while it works.
        **settings: Others of `export_motion`, as `speed`, `title`, `external`, `ghost`, `beside`, `follow` and `seen_from`.

    Raises:
        InputError: no motion, fewer than two samples, invalid settings, more than 20,000 pictures.
        PictureError: another ending, no ffmpeg, no Pillow, no browser, or the file cannot be written.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> rbd.visual.export_video(swing, "swing.gif", fps=20, speed=0.1)  # doctest: +SKIP
        PosixPath('swing.gif')
    """
    given = Playback.of({"charts": False, **settings})
    target, write = _checked(path, fps, width, height)
    link = page_link(view=view, layers=layers, controls=False)
    shown = shown_motion(motion)
    speed = given.resolved(shown).pace
    scene = motion_scene(motion, given)
    spans = [shown.t] if given.beside is None else [shown.t, shown_motion(given.beside).t]
    times = frame_times(min(float(t[0]) for t in spans), max(float(t[-1]) for t in spans), float(fps), speed)
    look = {"width": width, "height": height, "quality": QUALITY[target.suffix.lower()], "speed": speed}
    with tempfile.TemporaryDirectory(prefix="rbd-video-") as folder, one_browser(browser) as used:
        page = Path(folder) / "page.html"
        write_page(page, scene.page())
        across, down = _window(width, height)
        with used.open(page, width=across, height=down, fragment=link, before=_BEFORE) as opened:
            script = text_of("rbd.visual.pages", "web/video.js")
            opened.evaluate(f"{script}\nvoid (window.video = new Video(stage, {json.dumps(look)}))")
            with progress_of(times, shown=progress, doing="drawing the video") as reached:
                samples = _frames(opened, times[:: max(1, len(times) // SAMPLES)])
                write_file(target, lambda file: write(file, _frames(opened, times, reached), samples), PictureError)
    return target


def check_video(path: str | PathLike[str]) -> None:
    """Refuse, before a long motion is computed, a video that could not be made afterwards.

    Raises:
        PictureError: another ending, no ffmpeg, no Pillow, no browser, or a file that cannot be written.
    """
    _checked(path, 30.0, 960, 540)
    a_browser()


def _checked(path: str | PathLike[str], fps: float, width: int, height: int) -> tuple[Path, Encoder]:
    target = a_path("the video", path)
    check_size(width, height, MOST_SIZE, least=LEAST_SIZE)
    write = encoder_of(target, check_positive("fps", fps, MOST_FPS), width, height)
    check_place(target, PictureError)
    return target, write


def frame_times(first: float, last: float, fps: float, speed: float) -> list[float]:
    """Times of the pictures [s]: evenly from the first on; the last picture is at or beyond the last time.

    Raises:
        InputError: if there are too many.
    """
    n = int(np.ceil((last - first) * fps / speed - 1e-9)) + 1
    if n > MOST_FRAMES:
        raise InputError(f"a video of {n} pictures; expected at most {MOST_FRAMES}: give a lower fps or a higher speed.")
    return [min(last, first + i * speed / fps) for i in range(n)]


def _window(width: int, height: int) -> tuple[int, int]:
    """Size of the window in which legend and time are laid out: they take the same share of pictures of all sizes."""
    scale = min(max(width / LAID_OUT, SMALLEST_SCALE), LARGEST_SCALE)
    return round(width / scale), round(height / scale)


def _frames(page: BrowserPage, times: Sequence[float], reached: Callable[[float], None] | None = None) -> Iterator[bytes]:
    """The pictures (JPEG); a batch is drawn while the one before it is used."""
    batches = [list(times[i : i + BATCH]) for i in range(0, len(times), BATCH)]
    asked = page.begin(f"video.frames({json.dumps(batches[0])})")
    for batch, after in zip(batches, [*batches[1:], None], strict=True):
        drawn = page.value(asked)
        if after is not None:
            asked = page.begin(f"video.frames({json.dumps(after)})")
        for t, picture in zip(batch, drawn, strict=True):
            yield base64.b64decode(picture)
            if reached is not None:
                reached(t)
