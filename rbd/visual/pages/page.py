"""One HTML page that shows a scene: its messages recorded, the page written, and photographed by a headless browser.

A page is self-contained, for a file, or receives data by a socket, for a live viewer.
"""

from __future__ import annotations

import base64
import html
import json
import tempfile
import zlib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from os import PathLike
from pathlib import Path
from string import Template

from rbd.errors import PictureError
from rbd.model.output_files import check_place, write_file, write_text
from rbd.visual.packed_meshes import MARK, split
from rbd.visual.pages.browser import Browser, one_browser
from rbd.visual.pages.link import page_link
from rbd.visual.style import MOST_PIXELS, a_path, check_size, check_there

# The page forbids all requests of the browser: only the contents of the file are loaded.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; connect-src {connect}"
)


@cache
def text_of(package: str, path: str) -> str:
    """A text file of a package."""
    return files(package).joinpath(path).read_text(encoding="utf-8")


@cache
def system_colors() -> str:
    """The colours of pages by what they are for, as a style: dark where the reader's system is."""
    text = text_of("rbd.visual.pages", "web/colors.css").rstrip()
    return text.replace(':root[data-theme="dark"] {', "@media (prefers-color-scheme: dark) { :root {") + " }\n"


ONLY_ITSELF = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
"""Policy of a page without requests, whose scripts and styles are its own."""


def page_template(style: str, body: str, policy: str = ONLY_ITSELF) -> Template:
    """A page with `$title`, and what else its style, body and policy leave open."""
    return Template(f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
{style}
</style>
</head>
<body>
{body}
</body>
</html>
""")


_PAGE = page_template(
    "$style",
    """<noscript>This page is a picture to turn and play: it needs JavaScript, which is off here.</noscript>
<div id="meshcat-pane"></div>
<aside id="legend"></aside>
<script type="text/plain" id="library">$library</script>
<script type="text/plain" id="pieces">$pieces</script>
<script>
$stage
</script>
<script>
const OLD_BROWSER = "$old";
if (typeof unpackPage === "undefined") document.body.innerHTML = '<p class="failed">' + OLD_BROWSER + "</p>";
</script>
<script>
let stage;
unpackPage($sizes, (made) => {
stage = made;
$start
});
</script>""",
    policy="$policy",
)
SCRIPTS = (
    *("theme.js", "stage.js", "meshes.js", "primitives.js", "layers.js", "legend.js", "labels.js", "naming.js"),
    *("views.js", "gauges.js", "toolbar.js"),
    *("support.js", "force_elements.js", "animation.js", "curves.js", "reel.js", "timeline.js"),
    *("live.js", "controls.js", "backdrop.js", "verify.js"),
)
OLD_BROWSER = (
    "This browser is too old for this page. Chrome and Edge 90, Firefox 113, Safari 16.4 and all later ones can show it."
)
"""What a page says where its scripts do not run."""
LEVEL = 6
"""Of zlib: level 9 takes four times as long, for a hundredth less."""
STYLES = ("colors.css", "stage.css", "toolbar.css", "uplot/uPlot.min.css", "animation.css", "controls.css")


def offline_page(title: str, messages: Iterable[bytes | str]) -> str:
    """A self-contained page with the whole scene and the viewer.

    Args:
        title: Shown on the browser's tab.
        messages: Messages from a `Recorder`.
    """
    return _page(title, messages, connect="'none'")


def live_page(title: str, messages: Iterable[bytes | str], address: str) -> str:
    """The same page, which then listens for changes on a web socket: `address` is like ws://127.0.0.1:7000/changes."""
    # A policy's sources are compared without their query.
    allowed = address.partition("?")[0]
    return _page(title, messages, connect=allowed, then=f"stage.connect({json.dumps(address)});")


def write_page(target: Path, text: str) -> None:
    """Write a page.

    Raises:
        PictureError: if the file cannot be written.
    """
    write_text(target, text, PictureError)


def _script(messages: Iterable[bytes | str]) -> tuple[list[str], dict[bytes, int]]:
    """Lines that build the scene, and {piece: its number} of the bytes that they name; equal triangles are one piece."""
    lines: list[str] = []
    pieces: dict[bytes, int] = {}
    for message in messages:
        if isinstance(message, str):
            lines.append(f"stage.note({script_safe(message)});")
        elif message.startswith(MARK):
            header, triangles = split(message)
            lines.append(f"stage.place({script_safe(header)}, {pieces.setdefault(triangles, len(pieces))});")
        else:
            lines.append(f"stage.command({pieces.setdefault(message, len(pieces))});")
    return lines, pieces


def script_safe(text: str) -> str:
    """JSON that is safe inside a script element, for any names."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _page(title: str, messages: Iterable[bytes | str], *, connect: str, then: str = "") -> str:
    lines, pieces = _script(messages)
    size, library = _library()
    return _PAGE.substitute(
        title=html.escape(title),
        policy=_POLICY.format(connect=connect),
        style="\n".join(text_of("rbd.visual.pages", f"web/{name}") for name in STYLES),
        library=library,
        old=OLD_BROWSER,
        pieces=_deflated(b"".join(pieces)),
        sizes=json.dumps([size, *map(len, pieces)]),
        stage="\n".join(text_of("rbd.visual.pages", f"web/{name}") for name in SCRIPTS),
        start="\n".join(line for line in [*lines, "stage.ready();", then] if line),
    )


@cache
def _library() -> tuple[int, str]:
    """Charts and viewer, which `make viewer` bundles: the length of both, and their scripts deflated."""
    parts = ("uplot/LICENSE", "uplot/uPlot.iife.min.js", "viewer/viewer.min.js")
    licence, charts, viewer = (text_of("rbd.visual.pages", f"web/{name}") for name in parts)
    script = f"/*!\n{licence}*/\n{charts}\n{viewer}".encode()
    return len(script), _deflated(script)


def _deflated(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, LEVEL)).decode("ascii")


def screenshot(
    html_path: str | PathLike[str],
    png_path: str | PathLike[str],
    *,
    width: int = 1280,
    height: int = 960,
    at: float | None = None,
    view: str | None = None,
    layers: Mapping[str, bool] | None = None,
    browser: Browser | None = None,
) -> Path:
    """Draw a page in headless Chromium and write it as a PNG; returns the picture's path.

    Args:
        html_path: The page, as `Scene.export` writes it.
        png_path: Path of the picture.
        width: Pixels across.
        height: Pixels down.
        at: Time to show [s], of a page that `export_motion` wrote; by default where it starts.
        view: Where the camera stands: "start", "front", "side" or "top"; by default as the page opens.
        layers: {layer: whether it is shown}, of `rbd.visual.pages.link.LAYERS`; the others are shown as the page has them.
        browser: An open browser, to draw many pictures; by default one is started for this picture, which takes longer.

    Raises:
        InputError: if the size is no number of pixels, the time is none, or there is no such view or layer.
        PictureError: if there is no page, no browser, a closed one, or it made no picture.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> with rbd.visual.Scene(robot) as scene:
        ...     scene.show(robot.at("assembled"))
        ...     page = scene.export("four_bar.html")
        >>> rbd.visual.screenshot(page, "four_bar.png")  # doctest: +SKIP
        PosixPath('four_bar.png')
    """
    page, picture = a_path("the page", html_path), a_path("the picture", png_path)
    width, height = check_size(width, height, MOST_PIXELS)
    fragment = page_link(at=at, view=view, layers=layers, controls=False)
    check_there(page)
    check_place(picture, PictureError)
    with one_browser(browser) as used, used.open(page, width=width, height=height, fragment=fragment) as shown:
        taken = shown.picture()
    write_file(picture, lambda file: file.write(taken), PictureError)
    return picture


def photograph(text: str, picture: Path, width: int, height: int, browser: Browser | None = None) -> Path:
    """`screenshot` of a page that is no file, by its text."""
    with tempfile.TemporaryDirectory(prefix="rbd-page-") as folder:
        page = Path(folder) / "page.html"
        write_page(page, text)
        return screenshot(page, picture, width=width, height=height, browser=browser)
