"""Scenes and motions inside a notebook: the page in a frame, its picture behind it, in a headless browser."""

from __future__ import annotations

import base64
import io
import re
import time
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.errors import PictureError
from rbd.visual import Scene, notebook_page
from rbd.visual.notebook import page_frames
from rbd.visual.notebook.page_frames import HEIGHT, NO_PICTURE, NotebookPage, frame_html
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.pages.page import SCRIPTS, text_of

URDF = Path(__file__).parents[2] / "urdf"
WIDTH = 700
RED = (200, 30, 30)


def four_bar_scene() -> Scene:
    """A scene of a four-bar: a small page."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    scene = Scene(robot)
    scene.show(robot.at("assembled"))
    return scene


def red_picture() -> bytes:
    """A PNG in one colour, to see where it shines through."""
    file = io.BytesIO()
    Image.new("RGB", (WIDTH, HEIGHT), RED).save(file, "PNG")
    return file.getvalue()


def notebook(folder: Path, *outputs: str) -> Path:
    """A page with outputs below each other, as a notebook of the width of a frame shows them."""
    page = folder / "notebook.html"
    shown = "".join(f"<div>{each}</div>" for each in outputs)
    page.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body style="margin:0;background:#fff">{shown}</body>')
    return page


def pixels(page: BrowserPage) -> np.ndarray:
    """What is seen, shape (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB")).astype(float)


def reddish(seen: np.ndarray) -> float:
    """Share of the pixels in the colour of the picture behind the frame."""
    return float((np.abs(seen - RED).max(axis=2) < 3.0).mean())


def test_a_frame_draws_the_page_itself(browser: Browser, tmp_path: Path) -> None:
    """In a sandbox at 700 x 420 it is drawn over the picture, as the page alone is."""
    page = four_bar_scene().page()
    alone = tmp_path / "alone.html"
    alone.write_text(page, encoding="utf-8")
    with browser.open(alone, width=WIDTH, height=HEIGHT) as opened:
        expected = pixels(opened)
    shown = notebook(tmp_path, frame_html(page, red_picture(), "four_bar", HEIGHT))
    with browser.open(shown, width=WIDTH, height=HEIGHT) as opened:
        until = time.monotonic() + 60.0
        while np.abs(pixels(opened) - expected).mean() > 2.0 and time.monotonic() < until:
            time.sleep(0.1)
        seen = pixels(opened)
    assert np.abs(seen - expected).mean() < 2.0
    assert reddish(seen) == 0.0


def test_a_frame_stores_the_page_deflated_once() -> None:
    """Letter by letter the page; its scripts take a third of their size, and what is deflated already no more than before."""
    page = four_bar_scene().page()
    [data] = re.findall(r'atob\("([^"]*)"\)', page_frames.packed_page(page))
    assert zlib.decompress(base64.b64decode(data)).decode() == page
    scripts = sum(len(text_of("rbd.visual.pages", f"web/{name}")) for name in SCRIPTS)
    assert len(frame_html(page, b"", "four_bar", HEIGHT)) < len(page) - 0.6 * scripts


def test_without_scripts_the_picture_is_seen(browser: Browser, tmp_path: Path) -> None:
    """The frame lets the picture behind it through; and a viewer that removes frames has the picture too."""
    html = frame_html(four_bar_scene().page(), red_picture(), "four_bar", HEIGHT)
    with browser.open(notebook(tmp_path), width=WIDTH, height=HEIGHT) as opened:
        opened._call("Emulation.setScriptExecutionDisabled", value=True)
        seen, until, again = 0.0, time.monotonic() + 60.0, 0.0
        while seen < 0.95 and time.monotonic() < until:
            with suppress(PictureError):  # while it goes from one page to the other
                if time.monotonic() > again:  # a browser under load drops a page that is asked for while it opens another
                    opened._call("Page.navigate", url=notebook(tmp_path, html).as_uri())
                    again = time.monotonic() + 10.0
                seen = reddish(pixels(opened))
        assert seen > 0.95
    without = re.sub(r"<iframe.*?</iframe>", "", html, flags=re.DOTALL)
    with browser.open(notebook(tmp_path, without), width=WIDTH, height=HEIGHT) as opened:
        assert reddish(pixels(opened)) > 0.95


def test_the_frame_is_closed_to_notebook_and_network() -> None:
    """Sandboxed without the notebook's origin; the page's own policy forbids requests; its text ends where the quotes end."""
    html = frame_html(four_bar_scene().page(), b"", 'a "robot"', HEIGHT)
    [sandbox] = re.findall(r'sandbox="([^"]*)"', html)
    assert sandbox == "allow-scripts"
    [page] = re.findall(r'srcdoc="([^"]*)"', html)
    assert "connect-src &#x27;none&#x27;" in page and "<" not in page
    assert 'title="a &quot;robot&quot;"' in html


def test_a_scene_at_the_end_of_a_cell_is_drawn_with_its_forces(browser: Browser, tmp_path: Path) -> None:
    """First the words, then the page over a PNG of it; the same content is photographed once."""
    box = rbd.load_robot(URDF / "box.urdf")
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
    state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    with Scene(box) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        html = scene._repr_html_()
        assert f"its contacts push it up by {9.81 * box.mass:.2f} N" in html
        [taken] = re.findall(r'src="data:image/png;base64,([^"]*)"', html)
        picture = Image.open(io.BytesIO(base64.b64decode(taken)))
        assert picture.size == (page_frames.WIDTH, HEIGHT) and len(np.unique(np.asarray(picture.convert("L")))) > 50
        begin = time.thread_time()
        assert scene._repr_html_() == html
        assert time.thread_time() - begin < 1.0


def test_a_motion_and_a_report_are_put_inline() -> None:
    """With the options of their pages; `still=True` is a picture alone, a third of the smallest page or less."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.1, step=1e-2)
    inline = notebook_page(swing, height=300, speed=0.5)
    assert '"speed": 0.5' in inline.page and inline.height == 300
    still = notebook_page(swing, still=True)
    assert not still.page and "<iframe" not in still._repr_html_()
    assert 3 * len(still._repr_html_()) < len(inline._repr_html_()) and "kB" in repr(still)
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
    hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
    assert notebook_page(rbd.check_motion(hop), still=True, start=0.3).picture


def test_without_a_browser_there_is_the_page_and_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture is left out, and the output says so; a picture alone is refused."""
    monkeypatch.setattr(page_frames, "find_browser", lambda: None)
    with four_bar_scene() as scene:
        html = scene._repr_html_()
        assert NO_PICTURE in html and "<iframe" in html and "<img" not in html
        with pytest.raises(PictureError, match="Install Chromium"):
            notebook_page(scene, still=True)
    assert "MB page, picture of 0 kB" in repr(NotebookPage("x" * 10**6, b"", "x"))


def test_what_has_no_page_is_refused(tmp_path: Path) -> None:
    """With what was given, what is expected, what to try."""
    with pytest.raises(rbd.InputError, match="expected a scene, a motion, a report, a terrain, or the path of a page"):
        notebook_page(3)  # type: ignore[arg-type]
    with pytest.raises(PictureError, match="no page"):
        notebook_page(tmp_path / "none.html")
    with pytest.raises(rbd.InputError, match="height is 10; expected a whole number from 120"):
        notebook_page(tmp_path / "none.html", height=10)
    with pytest.raises(rbd.InputError, match="options speed are for motions and reports alone"):
        notebook_page(tmp_path / "none.html", speed=2.0)
    (tmp_path / "bytes.html").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(PictureError, match="cannot be read"):
        notebook_page(tmp_path / "bytes.html")
    with four_bar_scene() as scene:
        file = scene.export(tmp_path / "page.html")
        assert notebook_page(file).title == "page"
