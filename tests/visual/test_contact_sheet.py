"""The contact sheet: whole robots side by side, from the front, with their forces."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.errors import InputError, ModelError
from rbd.visual import Scene, contact_colors, contact_sheet


def test_two_robots_stand_side_by_side(tmp_path, browser):
    """Each cell has a robot that fills it, arrows in the colours of its contacts, and a caption above."""
    robots = ["bolt", rbd.load_robot("solo12")]
    picture = contact_sheet(robots, tmp_path / "two.png", columns=3, width=240, height=260, browser=browser)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"), float)
    assert pixels.shape == (260 + 44, 2 * 240 + 4, 3)
    for i, feet in enumerate((2, 4)):
        cell = pixels[44:, 244 * i : 240 + 244 * i]
        for color in contact_colors(map(str, range(feet))).values():
            near = np.linalg.norm(cell - list(bytes.fromhex(color[1:])), axis=2) < 60
            assert near.sum() > 20, (i, color)
        caption = pixels[:44, 244 * i : 240 + 244 * i]
        assert (caption.max(axis=2) < 110).sum() > 40  # letters


@pytest.mark.parametrize(("name", "ahead"), [("talos", 1.0), ("icub", -1.0)])
def test_the_camera_stands_where_the_toes_point(name, ahead, tmp_path):
    """Talos looks along x, iCub along -x; the camera is in front of each, on its left."""
    robot = rbd.load_robot(name)
    state = robot.standing()
    with Scene(robot, legend=False) as scene:
        scene.show(state, rbd.hold(state, robot.soles()))
        text = scene.export(tmp_path / "page.html").read_text(encoding="utf-8")
    notes = [json.loads(note) for note in re.findall(r"stage\.note\((\{.*)\);", text)]
    direction = [note["view"]["direction"] for note in notes if "view" in note][-1]
    assert direction == pytest.approx([ahead, 0.62 * ahead, 0.34], abs=1e-3)
    assert not any("legend" in note for note in notes)


def test_what_cannot_be_drawn_is_refused(tmp_path):
    """No robots, no size, a robot without feet."""
    with pytest.raises(InputError, match="no robots"):
        contact_sheet([], tmp_path / "none.png")
    with pytest.raises(InputError, match="robots are 3; expected robots or their names"):
        contact_sheet(3, tmp_path / "none.png")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="2 is no robot; expected robots or their names"):
        contact_sheet(["bolt", 2], tmp_path / "none.png")  # type: ignore[list-item]
    with pytest.raises(InputError, match="columns is 0"):
        contact_sheet(["bolt"], tmp_path / "none.png", columns=0)
    with pytest.raises(ModelError, match="no feet are known for panda|no standing posture"):
        contact_sheet(["panda"], tmp_path / "none.png")
