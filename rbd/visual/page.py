"""One HTML page that shows a scene: with everything inside for a file, or fed by a socket for a live viewer."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from string import Template

from rbd.errors import PictureError
from rbd.model.output_files import write_text

# The page forbids the browser every request: what is not inside the file cannot be loaded.
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


def offline_page(title: str, messages: Iterable[bytes | str]) -> str:
    """A page that holds the whole scene and the viewer, and loads nothing from anywhere.

    Args:
        title: Shown on the browser's tab.
        messages: What a `Recorder` kept.
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
    """JSON that can stand inside a script element, whatever names it holds."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _page(title: str, start: str, *, connect: str) -> str:
    return _PAGE.substitute(
        title=html.escape(title),
        policy=_POLICY.format(connect=connect),
        style=_text("rbd.visual", "stage.css") + _text("rbd.visual", "animation.css"),
        meshcat=_text("meshcat", "viewer/dist/main.min.js"),
        stage="\n".join(_text("rbd.visual", name) for name in ("stage.js", "animation.js", "timeline.js")),
        start=start,
    )


@cache
def _text(package: str, path: str) -> str:
    return files(package).joinpath(path).read_text(encoding="utf-8")
