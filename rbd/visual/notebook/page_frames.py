"""Pages inside a notebook: a scene, a motion or a report in a frame of its own."""

from __future__ import annotations

import base64
import html
import re
import tempfile
import zlib
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from rbd.arrays import check_flag, check_whole
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, PictureError
from rbd.motion.reference_motion import Motion
from rbd.motion.report import MotionReport
from rbd.simulation.trajectory import Trajectory
from rbd.visual.pages.browser import Browser, find_browser
from rbd.visual.pages.page import LEVEL, photograph
from rbd.visual.playback.animation import Playback, motion_scene
from rbd.visual.scene import Scene
from rbd.visual.style import a_path, check_there
from rbd.visual.terrain_alone import terrain_page

WIDTH, HEIGHT = 860, 420
"""Size of a picture, in pixels; a frame is as wide as the notebook."""
LEAST, MOST = 120, 4000
NO_PICTURE = "No Chromium was found on this machine, so there is no picture for viewers without scripts."
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy" content="[^"]*">')
# It is empty until it is unpacked, and without scripts: it lets the picture behind it through.
_PACKED = """<!DOCTYPE html>
<html><head><meta charset="utf-8">{policy}</head><body><script>
const packed = Uint8Array.from(atob("{data}"), (letter) => letter.charCodeAt(0));
const text = new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).text();
text.then((page) => { document.open(); document.write(page); document.close(); });
</script></body></html>
"""
_pictures: WeakKeyDictionary[Scene | Terrain, tuple[int, bytes]] = WeakKeyDictionary()


@dataclass(frozen=True, repr=False)
class NotebookPage:
    """A page for a notebook, as `notebook_page` makes it: put it at the end of a cell.

    Attributes:
        page: The page, HTML that needs no network; empty where only its picture is shown.
        picture: A PNG of the page, for viewers without scripts; empty where this machine has no browser.
        title: Its name, for screen readers.
        height: Of the frame [pixels].
    """

    page: str
    picture: bytes
    title: str
    height: int = HEIGHT

    def _repr_html_(self) -> str:
        """The frame, for Jupyter and its kin."""
        return frame_html(self.page, self.picture, self.title, self.height)

    def __repr__(self) -> str:
        size = f"{len(self.page) / 1e6:.1f} MB page" if self.page else "no page"
        return f"NotebookPage({self.title!r}, {size}, picture of {len(self.picture) / 1e3:.0f} kB)"


def notebook_page(
    shown: Scene | Trajectory | Motion | MotionReport | Terrain | str | PathLike[str],
    *,
    height: int = HEIGHT,
    still: bool = False,
    browser: Browser | None = None,
    **options: Any,
) -> NotebookPage:
    """A page inside a notebook: put it at the end of a cell. A scene at the end of a cell does the same with its defaults.

    The page is a part of the stored notebook: about 3 MB for each frame with a humanoid. `still=True` stores a picture
    of some ten kilobytes in its place.

    Args:
        shown: A scene, a motion, the report of `rbd.check_motion`, a terrain, or the path of a page.
        height: Of the frame [pixels].
        still: Whether to show the picture alone.
        browser: An open browser, to take many pictures; by default one is started for this picture, which takes longer.
        **options: Of a motion or a report those of `rbd.visual.export_motion`. Charts are left out unless `charts` is given: a
            frame is low.

    Raises:
        InputError: nothing that has a page, or invalid options.
        PictureError: an empty scene, no such page, or a picture was asked for where no browser is.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
        >>> frame = rbd.visual.notebook_page(swing, height=300, speed=0.5)
        >>> frame.title, frame.height
        ('four_bar', 300)
    """
    height = check_whole("height", height, MOST, least=LEAST)
    check_flag("still", still)
    title, page = _page_of(shown, options)
    if still and find_browser() is None:
        raise PictureError("still=True wants a picture, and no browser was found. Install Chromium, or leave it out.")
    return NotebookPage("" if still else page, _picture(page, height, browser), title, height)


def _page_of(shown: object, options: dict[str, Any]) -> tuple[str, str]:
    """The title and the page of what can be shown."""
    if isinstance(shown, Trajectory | Motion | MotionReport):
        scene = motion_scene(shown, Playback.of({"charts": False, **options}))
        return scene.title, scene.page()
    if options:
        raise InputError(f"options {', '.join(options)} are for motions and reports alone.")
    if isinstance(shown, Scene):
        return shown.robot.name, shown.page()
    if isinstance(shown, Terrain):
        return "terrain", terrain_page(shown)
    if not isinstance(shown, str | PathLike):
        raise InputError(
            f"a notebook page of {shown!r:.80}; expected a scene, a motion, a report, a terrain, or the path of a page."
        )
    path = a_path("the page", shown)
    check_there(path)
    try:
        return path.stem, path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise PictureError(f"the page {str(path)!r} cannot be read: {error}.") from error


def page_frame(shown: Scene | Terrain, page: str, name: str) -> str:
    """The frame of a page as HTML; its picture is taken once for each content of what it shows."""
    known = _pictures.get(shown)
    if known is None or known[0] != hash(page):
        known = _pictures[shown] = hash(page), _picture(page, HEIGHT)
    return frame_html(page, known[1], name, HEIGHT)


def frame_html(page: str, picture: bytes, title: str, height: int) -> str:
    """A frame with a page, or its picture alone, as HTML.

    The page is in a sandbox: it runs its own scripts, and reaches neither the notebook nor the network. Frames of one notebook
    cannot share the viewer, 0.3 MB of each: no frame may read another, and scripts of the notebook itself are taken out of it.

    Args:
        page: The page; empty for the picture alone.
        picture: A PNG; empty where there is none.
        title: For screen readers.
        height: [pixels].
    """
    name, image = html.escape(title), ""
    fill = "position:absolute;left:0;top:0;width:100%;height:100%"
    if picture:
        source = "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
        style = f"{fill};object-fit:contain;margin:0" if page else "max-width:100%"
        image = f'<img src="{source}" alt="{name}, drawn with its forces" style="{style}">'
    if not page:
        return f"<div>{image}</div>"
    text = html.escape(packed_page(page))
    frame = f'<iframe srcdoc="{text}" sandbox="allow-scripts" title="{name}" style="{fill};border:0"></iframe>'
    note = "" if picture else f"<p>{NO_PICTURE}</p>"
    return f'<div style="position:relative;max-width:64em;height:{height}px;overflow:hidden">{image}{frame}</div>{note}'


def packed_page(page: str) -> str:
    """A page as one deflated block, which it unpacks under the page's own policy: a quarter smaller, without the quotes."""
    policy = POLICY.search(page)
    data = base64.b64encode(zlib.compress(page.encode(), LEVEL)).decode("ascii")
    return _PACKED.replace("{policy}", policy[0] if policy else "").replace("{data}", data)


def _picture(page: str, height: int, browser: Browser | None = None) -> bytes:
    """A PNG of a page, without its buttons; empty where this machine has no browser."""
    if browser is None and find_browser() is None:
        return b""
    with tempfile.TemporaryDirectory(prefix="rbd-notebook-") as folder:
        return photograph(page, Path(folder) / "picture.png", WIDTH, height, browser).read_bytes()
