"""The viewer of the pages: bundled from its sources, it understands what Python sends, and shows colours as they are given."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import umsgpack
from PIL import Image

import rbd
from rbd.visual import Scene
from rbd.visual.pages.browser import Browser, BrowserPage

TOP = Path(__file__).parents[2]
SOURCES, WEB = TOP / "rbd/visual/pages/viewer", TOP / "rbd/visual/pages/web"
BOX = """<robot name="block"><link name="b">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="0.4 0.4 0.4"/></geometry><material name="m"><color rgba="0.8 0.4 0.2 1"/></material></visual>
</link></robot>"""


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[BrowserPage]:
    """A page with one box, from the front and above."""
    folder = tmp_path_factory.mktemp("block")
    (folder / "block.urdf").write_text(BOX)
    robot = rbd.load_robot(folder / "block.urdf")
    with Scene(robot, seen_from=(1.0, 0.0, 0.8), legend=False) as scene:
        scene.show(robot.at())
        page = scene.export(folder / "block.html")
    with browser.open(page, width=320, height=240, fragment="controls=off&off=centre of mass") as shown:
        yield shown


def test_the_bundle_is_that_of_its_sources() -> None:
    """Their sum stands in its first line: who changes them runs `make viewer`. Versions are exact; no lock file."""
    names = re.search(r"SOURCES = (\[.*\]);", (SOURCES / "build.js").read_text(encoding="utf-8"))
    assert names and sorted(json.loads(names[1])) == sorted(p.name for p in SOURCES.iterdir() if p.is_file())
    whole = b"".join((SOURCES / name).read_bytes() for name in json.loads(names[1]))
    with (WEB / "viewer/viewer.min.js").open(encoding="utf-8") as file:
        assert hashlib.sha256(whole).hexdigest() in file.readline()
    versions = json.loads((SOURCES / "package.json").read_text(encoding="utf-8"))["devDependencies"].values()
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions)


def test_all_that_pages_use_of_three_is_in_the_bundle() -> None:
    """Each name after `T.`, or after `THREE.`, in the pages' scripts."""
    used = {n for p in WEB.glob("*.js") for n in re.findall(r"\b(?:T|THREE)\.([A-Z]\w+)", p.read_text(encoding="utf-8"))}
    listed = set(re.findall(r"\b[A-Z]\w+(?=,)", (SOURCES / "three.js").read_text(encoding="utf-8")))
    assert len(used) > 30 and used <= listed and listed - used == {"Box3"}  # which tests use


def test_numbers_of_any_kind_and_size_move_an_object(block: BrowserPage) -> None:
    """Whole numbers have other codes in msgpack than fractions, by their size; an array may have more than fifteen of them."""
    places = [[0, -1, 127], [128, -33, 255], [256, -129, 65535], [65536, -32769, 2**32], [-(2**40), 0.125, -1e-300]]
    for at in places:
        matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *at, 1.0]
        data = umsgpack.packb({"type": "set_transform", "path": "/meshcat/moved/" + 40 * "x", "matrix": matrix})
        command = f"stage.viewer.handle_command_bytearray(new Uint8Array({list(data)}))"
        found = f"stage.viewer.scene_tree.find(['meshcat', 'moved', {40 * 'x'!r}]).object.position.toArray()"
        assert block.evaluate(f"({command}, {found})") == at
    delete = list(umsgpack.packb({"type": "delete", "path": "/meshcat/moved"}))
    block.evaluate(f"stage.viewer.handle_command_bytearray(new Uint8Array({delete}))")
    assert block.evaluate("'moved' in stage.viewer.scene_tree.find(['meshcat']).children") is False


def test_colours_are_those_of_the_light_that_is_written(block: BrowserPage) -> None:
    """The top of a box has its colour times the light it gets, plus the gleam; the background is that between its two colours.

    Closed form: c (sky + sum of lamps times cos) + lamps times Blinn and Phong's gleam, as pixels from 0 to 255. The sky's axis
    lies along W's y, so that a level surface gets half of its light, and half of the ground's.
    """
    seen = np.asarray(Image.open(io.BytesIO(block.picture())).convert("RGB"), float)
    view, camera = block.evaluate("[stage.view, stage.views.camera()]")
    x, y = block.evaluate("stage.project([0, 0, 0.2])")
    turn = np.arctan2(view["direction"][1], view["direction"][0]) - np.arctan2(0.62, 1.0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    up, eye, color = np.array([0.0, 0.0, 1.0]), np.array(camera[:3]) - [0.0, 0.0, 0.2], np.array([0.8, 0.4, 0.2])
    eye /= np.linalg.norm(eye)
    light, gleam = 0.62 * (1.0 + np.array([0xB9, 0xBE, 0xC6]) / 255.0) / 2.0, 0.0
    for strength, way in ((0.5, [1.2, 0.9, 2.6]), (0.18, [1.0, -2.0, 0.6])):
        to = R @ way / np.linalg.norm(way)
        half = (to + eye) / np.linalg.norm(to + eye)
        light = light + strength * to[2]
        gleam += strength * to[2] * 0x22 / 255 * 0.25 * (0.5 * 20 + 1) * (half @ up) ** 20
    assert np.abs(seen[round(y), round(x)] - 255.0 * (color * light + gleam)).max() < 1.5
    top, bottom = np.trunc(255 * np.array([[0.99, 0.99, 1.0], [0.86, 0.89, 0.92]]))
    for rows, color in ((seen[:4], top), (seen[-4:], bottom)):
        assert np.abs(rows.max(axis=(0, 1)) - color).max() < 1.5  # lines of the grid before it are darker
