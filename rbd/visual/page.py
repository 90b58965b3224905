"""One HTML page that shows a scene: its messages recorded, the page written, and photographed by a headless browser.

A page is self-contained, for a file, or receives data by a socket, for a live viewer.
"""

from __future__ import annotations

import base64
import html
import json
import math
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterable
from functools import cache
from importlib.resources import files
from os import PathLike
from pathlib import Path
from string import Template
from typing import Any, Protocol

import umsgpack

from rbd.arrays import as_float
from rbd.errors import InputError, PictureError
from rbd.model.forks import renewed_after_fork
from rbd.model.output_files import check_place, write_file, write_text
from rbd.visual.style import a_count, a_path, is_there

# The page forbids all requests of the browser: only the contents of the file are loaded.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; connect-src {connect}"
)

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="$policy">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
$style
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<aside id="legend"></aside>
<script>
$meshcat
</script>
<script>
$stage
</script>
<script>
const stage = new Stage(document.getElementById("meshcat-pane"), document.getElementById("legend"));
$start
</script>
</body>
</html>
""")
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


def offline_page(title: str, messages: Iterable[bytes | str]) -> str:
    """A self-contained page with the whole scene and the viewer.

    Args:
        title: Shown on the browser's tab.
        messages: Messages from a `Recorder`.
    """
    return _page(title, _script(messages), connect="'none'")


def live_page(title: str, messages: Iterable[bytes | str], address: str) -> str:
    """The same page, which then listens for changes on a web socket: `address` is like ws://127.0.0.1:7000/changes."""
    # A policy's sources are compared without their query.
    allowed = address.partition("?")[0]
    return _page(title, f"{_script(messages)}\nstage.connect({json.dumps(address)});", connect=allowed)


def write_page(target: Path, text: str) -> None:
    """Write a page.

    Raises:
        PictureError: if the file cannot be written.
    """
    write_text(target, text, PictureError)


def _script(messages: Iterable[bytes | str]) -> str:
    lines = []
    for message in messages:
        if isinstance(message, bytes):
            lines.append(f'stage.command("{base64.b64encode(message).decode("ascii")}");')
        else:
            lines.append(f"stage.note({script_safe(message)});")
    return "\n".join([*lines, "stage.ready();"])


def script_safe(text: str) -> str:
    """JSON that is safe inside a script element, for any names."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _page(title: str, start: str, *, connect: str) -> str:
    return _PAGE.substitute(
        title=html.escape(title),
        policy=_POLICY.format(connect=connect),
        style=_text("rbd.visual", "stage.css") + _text("rbd.visual", "animation.css"),
        meshcat=_text("meshcat", "viewer/dist/main.min.js"),
        stage="\n".join(_text("rbd.visual", name) for name in ("stage.js", "animation.js", "curves.js", "timeline.js")),
        start=start,
    )


@cache
def _text(package: str, path: str) -> str:
    return files(package).joinpath(path).read_text(encoding="utf-8")


class Command(Protocol):
    """A Meshcat command."""

    def lower(self) -> dict[str, Any]:
        """The command as plain data."""


class Recorder:
    """The `window` of a `meshcat.Visualizer` that needs no server.

    It stores the messages that a viewer needs to show the present scene, oldest first, and passes every new message to
    one listener, such as a live server. Messages are bytes (packed Meshcat commands) or text (JSON for our own page).
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, str], tuple[int, bytes | str]] = {}
        self._count = 0
        self._listener: Callable[[bytes | str], None] | None = None
        renewed_after_fork(self)

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock, and no listener, because a live server's thread stays with the parent."""
        self._lock, self._listener = threading.Lock(), None

    def send(self, command: Command) -> None:
        """Store a Meshcat command; a newer one of the same kind on the same path replaces it.

        A deletion removes all commands at and below its path, and is stored for viewers that have received them.
        """
        data = command.lower()
        path, kind = data["path"], data["type"]
        packed = umsgpack.packb(data)
        with self._lock:
            if kind == "delete":
                below = path.rstrip("/") + "/"
                self._kept = {key: m for key, m in self._kept.items() if not (key[0] + "/").startswith(below)}
            self._keep((path, kind + "/" + data.get("property", "")), packed)

    def post(self, topic: str, text: str) -> None:
        """Store a message for our page; a newer one on the same topic replaces it."""
        with self._lock:
            self._keep(("", topic), text)

    def messages(self, *, after: int = 0) -> tuple[list[bytes | str], int]:
        """Messages for a viewer that has received the first `after` of them, oldest first, and their count so far."""
        with self._lock:
            return [message for number, message in self._kept.values() if number > after], self._count

    def listen(self, listener: Callable[[bytes | str], None] | None) -> None:
        """Pass every later message to `listener`; None: to none."""
        with self._lock:
            self._listener = listener

    def _keep(self, key: tuple[str, str], message: bytes | str) -> None:
        self._count += 1
        self._kept.pop(key, None)
        self._kept[key] = (self._count, message)
        if self._listener is not None:
            self._listener(message)


def find_browser() -> str | None:
    """Path of Chromium or Chrome on this machine, or None.

    Example:
        >>> rbd.visual.find_browser()  # doctest: +SKIP
        '/usr/bin/chromium'
    """
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def screenshot(
    html_path: str | PathLike[str],
    png_path: str | PathLike[str],
    *,
    width: int = 1280,
    height: int = 960,
    at: float | None = None,
) -> Path:
    """Draw a page in headless Chromium and write it as a PNG; returns the picture's path.

    Args:
        html_path: The page, as `Scene.export` writes it.
        png_path: Path of the picture.
        width: Pixels across.
        height: Pixels down.
        at: Time to show [s], of a page that `export_motion` wrote; by default where it starts.

    Raises:
        InputError: if the size is no number of pixels, or the time is none.
        PictureError: if there is no page, no browser, or it made no picture.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> with rbd.visual.Scene(robot) as scene:
        ...     scene.show(robot.at("assembled"))
        ...     page = scene.export("four_bar.html")
        >>> rbd.visual.screenshot(page, "four_bar.png")  # doctest: +SKIP
        PosixPath('four_bar.png')
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
