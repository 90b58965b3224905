"""Scenes side by side: a frame for each with its caption and its own forces, one picture of all, what is refused."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.answers.solution import nearest_motion
from rbd.visual import Scene, contact_colors, scenes_beside, screenshot

URDF = Path(__file__).parents[2] / "urdf" / "box.urdf"
BOX = rbd.State(rbd.load_robot(URDF), [0, 0, 0.1, 0, 0, 0, 1])
FACE = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)


def push(force: float) -> rbd.ExternalForce:
    return rbd.ExternalForce("box", (force, 0.0, 0.0))


def pushed(force: float) -> rbd.Solution:
    return rbd.solve(BOX, [], [FACE], external=push(force))


def frames(page) -> dict[str, str]:
    """{caption: the page in its frame}."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r'<iframe title="([^"]*)" srcdoc="([^"]*)"', text)
    return {html.unescape(caption): html.unescape(inner) for caption, inner in found}


def test_each_answer_has_a_frame_with_its_own_forces(tmp_path):
    """A solution, what holds a robot, a nearest motion, a state, three things in a row, a scene: pages of their own."""
    held = rbd.hold(BOX, [FACE], external=push(20.0))
    scene = Scene(BOX.robot)
    scene.show(BOX, pushed(30.0), external=push(30.0))
    given = {
        "solved <50 N>": pushed(50.0),
        "held": held,
        "nearest": nearest_motion(rbd.gauss_problem(BOX, [], [FACE], external=push(90.0))),
        "state": BOX,
        "in a row": (BOX, pushed(40.0), push(40.0)),
        "scene": scene,
    }
    page = scenes_beside(given, tmp_path / "all.html")
    found = frames(page)
    assert list(found) == list(given)
    for caption, size in zip(given, (50, 20, 90, None, 40, 30), strict=True):
        assert (f"({size}, 0, 0) N" in found[caption]) == (size is not None), caption
    text = page.read_text(encoding="utf-8")
    assert (
        "repeat(3, " in text and "repeat(2, " in text and "http" not in re.sub(r'srcdoc="[^"]*"', "", text).replace("http-", "")
    )


def test_one_picture_shows_all_of_them(tmp_path, browser):
    """Each half has the arrows of its own contact, and its caption above; the page is ready when all its frames are."""
    page = scenes_beside({"50 N": pushed(50.0), "70 N": pushed(70.0)}, tmp_path / "two.html", legend=False)
    picture = screenshot(page, tmp_path / "two.png", width=640, height=360, browser=browser)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"), float)
    assert pixels.shape == (360, 640, 3)
    color = list(bytes.fromhex(contact_colors(["face"])["face"][1:]))
    for half in (pixels[:, :318], pixels[:, 322:]):
        assert (np.linalg.norm(half[44:] - color, axis=2) < 60).sum() > 50
        assert (half[:44].max(axis=2) < 110).sum() > 20
    above = screenshot(page, tmp_path / "above.png", width=640, height=360, view="top", browser=browser)
    assert above.read_bytes() != picture.read_bytes()


def test_what_cannot_be_shown_is_refused(tmp_path):
    """No scenes, too many, an empty one, other things, a problem without a state, another ending."""
    page = tmp_path / "page.html"
    for given, named in (
        ({}, "0 scenes"),
        ([BOX], "expected {caption"),
        ({"a": 3}, "'a' is 3"),
        ({"a": rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1])}, "no meshes"),
        ({str(i): BOX for i in range(13)}, "13 scenes"),
        ({"a": rbd.solve_problem(rbd.GaussProblem(np.eye(1), np.ones(1), []))}, "built by hand"),
    ):
        with pytest.raises(rbd.InputError, match=named):
            scenes_beside(given, page)
    with pytest.raises(rbd.errors.PictureError, match="empty"):
        scenes_beside({"a": Scene(BOX.robot)}, page)
    with pytest.raises(rbd.errors.PictureError, match="html"):
        scenes_beside({"a": BOX}, tmp_path / "page.png")
    assert not page.exists()
