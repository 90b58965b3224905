"""The branches of a mechanism in the browser: their colours, and that every bar of every branch is seen."""

from __future__ import annotations

import io
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.cli.mechanism_report import MechanismReport, report_mechanism
from rbd.visual import Scene
from rbd.visual.other_poses import APART, placed_parts, pose_colors, striped
from rbd.visual.pages.browser import Browser
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.shapes import Mesh, box
from rbd.visual.style import rgb

URDF = Path(__file__).parents[2] / "urdf"
PAINT = """(bars => {
  const three = [];
  stage.viewer.scene.traverse(object => {
    if (!object.isMesh) return;
    const path = [];
    for (let at = object; at; at = at.parent) if (at.name) path.unshift(at.name);
    three.push([path.join("/"), object]);
  });
  const flat = (object, red) => {
    const shine = object.material;
    object.material = new shine.constructor();
    object.material.copy(shine);
    object.material.color.setRGB(0, 0, 0);
    if (object.material.specular) object.material.specular.setRGB(0, 0, 0);
    object.material.emissive.setRGB(red, 0, red);
    object.receiveShadow = false;
  };
  for (const [path, object] of three) {
    if (object.material.emissive) flat(object, bars.some(bar => path.includes(bar)) ? 1 : 0);
  }
  stage.viewer.set_dirty();
  stage.viewer.render();
})"""
"""Paints the bars named pure magenta and all else black, each where it is and behind what it is behind."""


@cache
def report(name: str) -> MechanismReport:
    """The analysis of a model of `urdf/`."""
    robot = rbd.load_robot(URDF / f"{name}.urdf")
    return report_mechanism(robot, next(iter(robot.postures.values())), tries=60)


def page_of(it: MechanismReport, path: Path) -> Path:
    """The page that `rbd mechanism` writes."""
    details, note = it.legend()
    with Scene(it.robot) as scene:
        scene.show(it.state)
        scene.beside(it.poses(), shown=it.shown, details=details, note=note)
        return scene.export(path)


def bars(it: MechanismReport) -> dict[str, dict[str, list[int]]]:
    """{branch: {link's joint: numbers of its parts}} of what moves."""
    parts = robot_parts(it.robot)
    names = list(it.robot.model.names)
    moving = {names[p.joint]: [i for i, q in enumerate(parts) if q.joint == p.joint] for p in parts if p.joint}
    return {name: moving for name in it.poses()}


def group(it: MechanismReport, branch: str) -> str:
    """Path of a branch in the viewer's tree."""
    others = [name for name in it.poses() if name != it.shown]
    return "robot" if branch == it.shown else f"beside/{others.index(branch)}"


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"])
def test_every_bar_of_every_branch_is_seen(name, browser: Browser, tmp_path):
    """Painted one by one in a colour that nothing else has, each bar is there from the first point of view."""
    it = report(name)
    hidden = []
    with browser.open(page_of(it, tmp_path / "page.html"), width=700, height=520) as page:
        page.evaluate("stage.legend.hidden = true, window.dispatchEvent(new Event('resize')), 1")
        for branch, links in bars(it).items():
            for joint, numbers in links.items():
                wanted = [f"meshcat/{group(it, branch)}/{i}/" for i in numbers]
                page.evaluate(f"{PAINT}({json.dumps(wanted)}), 1")
                image = np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB")).astype(int)
                seen = int(((image[:, :, 0] > 150) & (image[:, :, 2] > 150) & (image[:, :, 1] < 60)).sum())
                if seen < 12:
                    hidden.append((branch, joint, seen))
    assert not hidden
