"""Screenshots of pages, taken by a headless browser."""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from os import PathLike
from pathlib import Path

from rbd.arrays import as_float
from rbd.errors import InputError, PictureError
from rbd.model.output_files import check_place, write_file
from rbd.visual.arguments import a_count, a_path, is_there

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TIMEOUT_SECONDS = 120.0
# Quiet, without a graphics card (SwiftShader draws in software), and unable to reach any other machine.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--virtual-time-budget=3000",
)


def find_browser() -> str | None:
    """Path of Chromium or Chrome on this machine, or None."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def screenshot(
    html_path: str | PathLike[str],
    png_path: str | PathLike[str],
    *,
    width: int = 1280,
    height: int = 960,
    at: float | None = None,
) -> Path:
    """Draw a page in headless Chromium and write what it shows as a PNG; returns the picture's path.

    Args:
        html_path: The page, as `Scene.export` writes it.
        png_path: Where the picture goes.
        width: Pixels across.
        height: Pixels down.
        at: Time to show [s], of a page that `export_motion` wrote; by default where it starts.

    Raises:
        InputError: if the size is no number of pixels, or the time is none.
        PictureError: if there is no page, no browser, or no picture came of it.
    """
    page, picture = a_path("the page", html_path), a_path("the picture", png_path)
    width, height = a_count("width", width), a_count("height", height)
    if at is not None and not math.isfinite(as_float(at)):
        raise InputError(f"at is {at!r:.80}; expected a time in seconds.")
    if not is_there(page):
        raise PictureError(f"no page {str(html_path)!r}; write one with scene.export(...) first.")
    check_place(picture, PictureError)
    browser = find_browser()
    if browser is None:
        raise PictureError(f"no browser found; looked on PATH for {', '.join(BROWSERS)}. Install Chromium.")
    with tempfile.TemporaryDirectory(prefix="rbd-browser-") as profile:
        taken = Path(profile) / "taken.png"
        command = [browser, *FLAGS, f"--window-size={width},{height}", f"--user-data-dir={profile}/profile"]
        command += [f"--screenshot={taken}", page.resolve().as_uri() + ("" if at is None else f"#t={float(at)!r}")]
        try:
            run = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_SECONDS, check=False)
        except subprocess.TimeoutExpired as error:
            raise PictureError(f"the browser took over {TIMEOUT_SECONDS:g} s with {str(html_path)!r}.") from error
        if not taken.is_file():
            last = (run.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise PictureError(f"the browser made no picture of {str(html_path)!r} (exit {run.returncode}): {last}")
        write_file(picture, lambda file: file.write(taken.read_bytes()), PictureError)
    return picture
