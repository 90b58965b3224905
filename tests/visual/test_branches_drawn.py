"""The branches of a mechanism in the browser: their colours, and that every bar of every branch is seen."""

from __future__ import annotations

import io
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

import rbd
from rbd.cli.mechanism_report import MechanismReport, report_mechanism
from rbd.visual import Scene
from rbd.visual.drawn_robot import APART, placed_parts, pose_colors, striped
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
    three.push([path.join("/").replace("Scene/", ""), object]);
  });
  for (const [path, object] of three) {
    const shine = object.material;
    if (!shine.emissive) continue;
    object.material = new shine.constructor();
    object.material.copy(shine);
    object.material.color.setRGB(0, 0, 0);
    if (shine.specular) object.material.specular.setRGB(0, 0, 0);
    object.material.emissive.setRGB(...(bars[path] || [0, 0, 0]));
  }
  stage.viewer.set_dirty();
  stage.viewer.render();
})"""
"""Paints each bar named in its colour and all else black, each where it is and behind what it is behind: {path: rgb}."""
PURE = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)]
LEAST_PIXELS = 60
"""Of a bar in a picture of 700 x 520: what is left of the crank that four branches share is a stripe of some hundred."""


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


@pytest.mark.parametrize("name", ["slider_crank", "six_bar"])
def test_every_bar_of_every_branch_is_seen(name, browser: Browser, tmp_path):
    """Painted one by one in a colour that nothing else has, each bar is there from the first point of view."""
    it = report(name)
    every = [(branch, joint, numbers) for branch, links in bars(it).items() for joint, numbers in links.items()]
    hidden = []
    with browser.open(page_of(it, tmp_path / "page.html"), width=700, height=520) as page:
        page.evaluate("stage.legend.style.display = 'none', stage.fit(), 1")
        for few in (every[i : i + len(PURE)] for i in range(0, len(every), len(PURE))):
            painted = {f"meshcat/{group(it, branch)}/{i}": color for (branch, _, numbers), color in zip(few, PURE, strict=False)
                       for i in numbers}  # fmt: skip
            page.evaluate(f"{PAINT}({json.dumps(painted)}), 1")
            image = np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB")).astype(int)
            for (branch, joint, _), color in zip(few, PURE, strict=False):
                seen = np.abs(image - 255 * np.array(color)).max(axis=2) < 60
                if seen.sum() < LEAST_PIXELS:
                    hidden.append((branch, joint, int(seen.sum())))
    assert not hidden


def test_the_page_has_the_branches_in_the_colours_of_its_legend(browser: Browser, tmp_path):
    """Each branch has all bars and one colour: that of the legend, which tells its angles as the text does."""
    it = report("six_bar")
    with browser.open(page_of(it, tmp_path / "page.html"), width=700, height=520) as page:
        found = page.evaluate("""(() => {
          const out = {};
          const root = stage.viewer.scene_tree.find(["meshcat"]).object;
          for (const [name, group] of [["robot", root.getObjectByName("robot")],
              ...root.getObjectByName("beside").children.map(each => [`beside/${each.name}`, each])]) {
            for (const part of group.children) {
              part.traverse(object => {
                if (object.isMesh) (out[name] ??= []).push([Number(part.name), object.material.color.getHexString()]);
              });
            }
          }
          return out;
        })()""")
        entries = page.evaluate(
            "[...document.querySelectorAll('#legend tr')].map(row => row.textContent.replace(/\\u00a0/g, ' '))"
        )
        swatches = page.evaluate("[...document.querySelectorAll('#legend i')].map(i => getComputedStyle(i).backgroundColor)")
    fixed = {i for i, part in enumerate(robot_parts(it.robot)) if not part.joint}
    moving = {i for links in bars(it)["branch 0"].values() for i in links}
    told = ["#" + "".join(f"{int(x):02x}" for x in re.findall(r"\d+", swatch)[:3]) for swatch in swatches]
    for k, branch in enumerate(it.poses()):
        drawn = [(i, color) for i, color in found[group(it, branch)] if i not in fixed]
        assert {i for i, _ in drawn} == moving and {f"#{color}" for _, color in drawn} == {told[k]}
        assert entries[2 * k] == branch and entries[2 * k + 1] == it.legend()[0][branch][0]
    assert len(set(told[:4])) == 4
    grey = {color for i, color in found["robot"] if i in fixed}
    assert min(np.linalg.norm(np.subtract(rgb(a), rgb(f"#{b}"))) for a in told[:4] for b in grey) > APART


def test_bars_at_one_place_are_striped():
    """Two branches of a four-bar share the crank: each has half of its length, together all of it; other bars are whole."""
    it = report("four_bar")
    parts, model = robot_parts(it.robot), it.robot.model
    data = [model.createData() for _ in it.poses()]
    for each, state in zip(data, it.poses().values(), strict=True):
        pin.forwardKinematics(model, each, state.q)
    one, two = placed_parts(parts, data, ["#0072b2", None])
    crank = it.robot.joint_id("crank_joint")
    for a, b in zip(one, two, strict=True):
        whole = area(parts[a.number].mesh)
        assert a.part.color == "#0072b2" and b.part.color == parts[b.number].color
        shared = a.part.joint == crank or area(a.part.mesh) < whole  # so are the coupler's discs on the crank's pin
        if shared:
            assert area(a.part.mesh) + area(b.part.mesh) == pytest.approx(whole, rel=1e-9)
        else:
            assert area(a.part.mesh) == area(b.part.mesh) == whole
        assert shared == (a.part.joint == crank or bool(np.abs(a.X_WG.translation - b.X_WG.translation).max() < 1e-9))


def area(mesh: Mesh) -> float:
    """Area of all triangles [m2]."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def test_stripes_lie_side_by_side_across_the_longest_side():
    """Three poses on a bar of 6 m: six pieces of 1 m, in turn; large meshes are not cut, but sorted by triangles."""
    bar = box(np.array([3.0, 0.1, 0.2]))
    for rank in range(3):
        x = striped(bar, rank, 3).vertices[:, 0]
        assert set(np.round(x, 9)) == {rank - 3.0, rank - 2.0, float(rank), rank + 1.0}
    rng = np.random.default_rng(0)
    cloud = Mesh(rng.uniform(size=(300, 3)), rng.integers(0, 300, (5000, 3)))
    assert sum(len(striped(cloud, rank, 2).faces) for rank in range(2)) == 5000


def test_colours_of_poses_keep_away_from_what_is_there():
    """Not the blue that a frame has, no grey; forty poses have forty colours."""
    assert "#0072b2" not in pose_colors(6, ["#0072b2", "#7f7f7f"])
    colors = [np.array(rgb(color)) for color in pose_colors(6, ["#0072b2"])]
    assert all(np.ptp(color) >= APART for color in colors)
    assert min(np.linalg.norm(a - b) for i, a in enumerate(colors) for b in colors[:i]) >= APART
    assert len(set(pose_colors(40, []))) == 40


def sent(scene: Scene) -> dict[str, bytes | str]:
    """{part of the robot or its transform: the message that the page gets of it}."""
    kept = scene.recorder._kept
    return {f"{path} {kind}": message for (path, kind), (_, message) in kept.items() if path.startswith("/meshcat/robot/")}


@pytest.mark.parametrize("shown", ["", "first"])
def test_a_robot_that_moves_on_takes_its_stripes_along(shown):
    """Bars are striped where they are, not where they were; without poses the robot has its own colours again."""
    robot = rbd.load_robot(URDF / "four_bar.urdf")
    first, second = (robot.at(name) for name in ("assembled", "crossed"))
    with Scene(robot) as scene:
        scene.show(first)
        clean = sent(scene)
        scene.beside({"second": second}, shown=shown)
        striped_there = sent(scene)
        scene.show(second)
        on_each_other = sent(scene)
        scene.show(first)
        assert sent(scene) == striped_there != clean
        rocker = next(i for i, part in enumerate(robot_parts(robot)) if part.joint == robot.joint_id("rocker_joint"))
        whole, shared = (each[f"/meshcat/robot/{rocker} set_object/"] for each in (striped_there, on_each_other))
        assert shared != whole
        scene.beside({})
        assert {what: message for what, message in sent(scene).items() if "delete" not in what} == clean


def test_a_skeleton_has_no_ellipsoids_in_its_branches(tmp_path):
    """Of a robot without visual shapes bones alone are drawn in each branch; its own ellipsoids come back after."""
    text = re.sub(r"<visual>.*?</visual>", "", (URDF / "four_bar.urdf").read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "bare.loops.yaml").write_text((URDF / "four_bar.loops.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    robot = rbd.load_robot(tmp_path / "bare.urdf")
    with Scene(robot) as scene:
        scene.show(robot.at("assembled"))
        clean = sent(scene)
        scene.beside({"crossed": robot.at("crossed")}, shown="assembled")
        assert len(sent(scene)) < len(clean)
        scene.beside({})
        assert {what: message for what, message in sent(scene).items() if "delete" not in what} == clean
