"""Layers, labels, views and links of a page, read back from a headless browser."""

from __future__ import annotations

import io
import json
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

import rbd
from rbd.visual import Scene, screenshot
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.pages.link import LAYERS, VIEWS, page_link
from rbd.visual.robot_layers import CLOSE_M, collision_parts, front_of

PUSH_N = np.array([0.0, 60.0, 0.0])
WIDTH, HEIGHT = 700, 520
TAGS = "[...document.querySelectorAll('.tags span')]"


@dataclass(frozen=True, eq=False)
class Shown:
    """A page of Talos, and what it shows."""

    robot: rbd.Robot
    state: rbd.State
    held: rbd.Actuation
    page: Path


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Talos held on two soles, pushed sideways; a page in a file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        robot = rbd.load_robot("talos")
    state = robot.standing()
    push = rbd.ExternalForce("torso_2_link", PUSH_N, offset=[0.0, 0.0, 0.2])
    held = rbd.hold(state, robot.soles(), external=push)
    with Scene(robot) as scene:
        scene.show(state, held, external=push)
        return Shown(robot, state, held, scene.export(tmp_path_factory.mktemp("page") / "talos.html"))


@pytest.fixture(scope="module")
def opened(shown: Shown, browser: Browser) -> Iterator[BrowserPage]:
    """The page, open in a small window."""
    with browser.open(shown.page, width=WIDTH, height=HEIGHT) as opened:
        yield opened


@pytest.fixture
def page(opened: BrowserPage) -> BrowserPage:
    """It as it opens."""
    opened.evaluate(
        "stage.layers.on = { ...stage.layers.first }; stage.layers.apply(); stage.toolbar.open(''); stage.labels.clear();"
        "foldLegend(stage.legend, false); stage.views.go('start')"
    )
    opened.mouse("mouseMoved", WIDTH - 10, HEIGHT - 60)
    opened.evaluate("clearTimeout(stage.views.waiting); history.replaceState(null, '', location.pathname)")
    return opened


def pixels(page: BrowserPage) -> np.ndarray:
    """What is seen, shape (height, width, 3), 0 to 255."""
    page.evaluate("stage.viewer.render()")
    with Image.open(io.BytesIO(page.picture())) as image:
        return np.asarray(image.convert("RGB"), float)


def visible(page: BrowserPage, path: str) -> bool:
    """Whether an object and all above it are visible."""
    return bool(page.evaluate(f"seen(stage.layers.object({json.dumps(path)}))"))


def point_at(page: BrowserPage, point: np.ndarray) -> list[str]:
    """What the page says, line by line, of what it draws at a point of W [m]."""
    x, y = page.evaluate(f"stage.project({np.asarray(point).tolist()})")
    page.mouse("mouseMoved", x, y)
    page.wait("!stage.labels.tip.hidden")
    return str(page.evaluate("stage.labels.tip.innerText")).split("\n")


def rest(page: BrowserPage) -> str:
    """The address's fragment, after changes have been written to it."""
    return str(page.evaluate("new Promise((told) => setTimeout(() => told(location.hash), 500))"))


# Layers


def test_switches_hide_what_they_say(page: BrowserPage):
    """Meshes: flags and pixels; the forces stay."""
    before = pixels(page)
    page.key("l")
    named = page.evaluate("[...stage.toolbar.boxes].map(([name, box]) => [name, box.checked, box.parentElement.textContent])")
    assert [name for name, _, _ in named] == [name for name in LAYERS if name in {n for n, _, _ in named}]
    assert all(checked is LAYERS[name] and text == name for name, checked, text in named)
    assert {"meshes", "frames", "collision shapes", "axes", "forces"} <= {name for name, _, _ in named}
    page.evaluate("stage.toolbar.boxes.get('meshes').click()")
    assert not visible(page, "robot/0") and visible(page, "marks/contacts/left_sole/force")
    page.evaluate("stage.toolbar.open('')")
    after = pixels(page)
    dark = [(picture[:, 250:].max(axis=2) < 70).sum() for picture in (before, after)]
    blue = [(np.abs(p - [0, 0x72, 0xB2]).max(axis=2) < 45).sum() for p in (before, after)]
    assert dark[1] < 0.2 * dark[0] and blue[1] > 0.5 * blue[0] > 0
    assert rest(page) == "#off=meshes"


def test_each_layer_can_be_hidden_alone(page: BrowserPage):
    """Every mark is seen if, and only if, its layer is on."""
    listed = page.evaluate("stage.layers.listed.map(({path, layer}) => [path, layer])")
    layers = sorted({layer for _, layer in listed})
    assert layers
    for hidden in layers:
        page.evaluate(f"stage.layers.show({json.dumps(hidden)}, false)")
        shown = page.evaluate("stage.layers.listed.map(({path}) => seen(stage.layers.object(`marks/${path}`)))")
        wanted = [layer != hidden and LAYERS[layer] for _, layer in listed]
        assert shown == wanted, hidden
        page.evaluate(f"stage.layers.show({json.dumps(hidden)}, {json.dumps(LAYERS[hidden])})")


def test_frames_are_those_of_pinocchio(page: BrowserPage, shown: Shown):
    """The triads are at the joints' placements; they are off at first."""
    assert not visible(page, "frames")
    data = shown.robot.model.createData()
    pin.forwardKinematics(shown.robot.model, data, shown.state.q)
    drawn = page.evaluate(
        "stage.frames.map((f) => [f.userData.label().title, ...f.position.toArray(), ...f.quaternion.toArray()])"
    )
    poses = {name: np.array(numbers) for name, *numbers in drawn}
    for joint in range(1, shown.robot.model.njoints):
        X = pin.XYZQUATToSE3(poses[shown.robot.model.names[joint]])
        assert np.abs((data.oMi[joint].inverse() * X).homogeneous - np.eye(4)).max() < 1e-5
    assert {"left_sole", "right_sole"} <= set(poses)


def test_collision_shapes_hold_all_points_of_the_file(shown: Shown):
    """A drawn hull is no farther than two millimetres from the convex hull that contacts are computed with."""
    parts = collision_parts(shown.robot)
    assert len(parts) == len(shown.robot.collision_model.geometryObjects)
    for part, given in zip(parts, shown.robot.collision_model.geometryObjects, strict=True):
        assert part.part.name == given.name and part.outside <= CLOSE_M
        if part.hull:
            points = np.asarray(given.geometry.vertices())
            corners = part.part.mesh.vertices
            assert np.isin(corners.round(12), points.round(12)).all()
            up = np.eye(3)[2]
            assert (points @ up).max() - (corners @ up).max() <= CLOSE_M
    assert sum(len(part.part.mesh.faces) for part in parts) < 12_000


def test_python_chooses_layers_and_view(shown: Shown, browser: Browser, tmp_path: Path):
    """`Scene(layers=, view=)` opens the page so; the link does not repeat what the page says itself."""
    with Scene(shown.robot, layers={"meshes": False, "axes": True}, view="top") as scene:
        scene.show(shown.state, shown.held)
        written = scene.export(tmp_path / "top.html")
    with browser.open(written, width=400, height=300) as page:
        assert not visible(page, "robot") and visible(page, "marks/contacts/left_sole/force")
        assert page.evaluate("stage.views.name") == "top" and page.evaluate("stage.views.link()") == ""
        assert page.evaluate("stage.gauges.node.hidden") is False
    with pytest.raises(rbd.InputError, match="view is 'left'; expected one of start, front, side, top"):
        Scene(shown.robot, view="left")


# Views and links


@pytest.mark.parametrize(
    ("key", "view", "towards"), [("1", "front", [1, 0, 0.1]), ("2", "side", [0, 1, 0.1]), ("3", "top", [0, 0, 1])]
)
def test_views_put_the_camera_where_they_say(page: BrowserPage, key: str, view: str, towards: list[float]):
    """The camera stands on that side of what it looks at, keeps the robot in the window, and the link says so."""
    page.key(key)
    camera = np.array(page.evaluate("stage.views.camera()"))
    seen = (camera[:3] - camera[3:]) / np.linalg.norm(camera[:3] - camera[3:])
    assert np.abs(seen - np.array(towards) / np.linalg.norm(towards)).max() < 2e-3
    assert rest(page) == f"#view={view}"
    spots = np.array(page.evaluate("stage.view.points.map((p) => stage.project(p))"))
    assert spots.min() > 0 and (spots < [WIDTH, HEIGHT]).all()
    page.key("0")
    assert rest(page) == ""


def test_the_front_is_where_the_toes_point(shown: Shown):
    """A robot turned by a right angle is seen from its own front; iCub's is along -x."""
    turned = rbd.State(shown.robot, np.array([*shown.state.q[:3], 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5), *shown.state.q[7:]]))
    for state, front in ((shown.state, [1.0, 0.0]), (turned, [0.0, 1.0])):
        data = shown.robot.model.createData()
        pin.forwardKinematics(shown.robot.model, data, state.q)
        assert np.allclose(front_of(shown.robot, data, ()), front, atol=1e-3)


def test_a_link_opens_as_written(shown: Shown, browser: Browser):
    """View, layers on and off, whatever the order; unknown words change nothing; a new link is followed."""
    link = page_link(view="side", layers={"axes": True, "collision shapes": True, "meshes": False})
    assert link == "view=side&on=axes,collision%20shapes&off=meshes"
    with browser.open(shown.page, width=400, height=300, fragment=f"x=%ZZ&&{link.replace('axes', 'no,axes')}") as page:
        assert page.evaluate("stage.views.name") == "side" and not visible(page, "robot/3") and visible(page, "collision/3")
        assert visible(page, "marks/contacts/left_sole/force")
        page.evaluate("location.hash = 'view=top&on=meshes'")
        page.wait("stage.views.name === 'top'")
        assert visible(page, "robot/3")


def test_a_turned_camera_is_kept(page: BrowserPage, shown: Shown, browser: Browser):
    """Dragging writes the camera's place into the link, which opens there."""
    page.mouse("mousePressed", 400, 300, button="left")
    page.mouse("mouseMoved", 460, 320, button="left")
    page.mouse("mouseReleased", 460, 320, button="left")
    link = rest(page)
    assert link.startswith("#camera=") and page.evaluate("stage.views.name") == ""
    where = page.evaluate("stage.views.camera()")
    with browser.open(shown.page, width=WIDTH, height=HEIGHT, fragment=link[1:]) as again:
        assert np.abs(np.array(again.evaluate("stage.views.camera()")) - where).max() < 2e-3


def test_what_is_no_link_is_refused():
    """By name; nothing is nothing."""
    assert page_link() == "" and page_link(at=0.5, controls=False) == "t=0.5&controls=off"
    assert set(VIEWS) == {"start", "front", "side", "top"}
    for given, words in (
        ({"at": float("nan")}, "expected a time"),
        ({"view": "left"}, "expected one of start"),
        ({"layers": {"cone": True}}, "no layer 'cone'"),
        ({"layers": ["cones"]}, "expected {name"),
    ):
        with pytest.raises(rbd.InputError, match=words):
            page_link(**given)


# Names


def test_a_body_is_named_where_it_is_seen(page: BrowserPage, shown: Shown):
    """The pointer on the chest tells the link and its joint; away from the robot nothing."""
    x, y = page.evaluate(f"stage.project({shown.state.frame('torso_2_link', [0.1, 0.1, 0.1]).X_WF.translation.tolist()})")
    page.mouse("mouseMoved", x, y)
    page.wait("!stage.labels.tip.hidden")
    told = page.evaluate("stage.labels.tip.innerText").split("\n")
    mass = shown.robot.model.inertias[shown.robot.model.getJointId("torso_2_joint")].mass
    assert told[:2] == ["torso_2_link", "moved by torso_2_joint"] and told[2].startswith(f"{mass:.5g} kg")
    page.mouse("mouseMoved", WIDTH - 10, HEIGHT - 60)
    page.wait("stage.labels.tip.hidden")


@pytest.mark.parametrize("name", ["left_sole", "right_sole"])
def test_an_arrow_is_named_with_its_force(page: BrowserPage, shown: Shown, name: str):
    """The pointer on the middle of a contact's arrow, before or behind the robot, tells the numbers of the solution."""
    force, arrow = shown.held.forces[name][:3], shown.held.contacts[name]
    with Scene(shown.robot) as scene:
        scene.show(shown.state)
        middle = arrow.centre_of_pressure + 0.5 * scene.metres_per_newton * force
    told = point_at(page, middle)
    assert told[:2] == [name, f"|f| {np.linalg.norm(force):.4g} N"]
    written = re.search(r"force on the robot \((.*), (.*), (.*)\) N", told[2])
    assert written is not None and np.abs(np.array([float(x) for x in written.groups()]) - force).max() < 0.06
    assert told[3].startswith(f"normal {force[2]:.4g} N") and f"of mu {0.7:g}" in told[4]
    page.key("Escape")
    assert page.evaluate("stage.labels.tip.hidden")


def test_a_push_is_named_and_in_the_legend(page: BrowserPage, shown: Shown):
    """With its vector."""
    at = shown.state.frame("torso_2_link", [0.0, 0.0, 0.2]).X_WF.translation + [0.0, 0.03, 0.0]
    told = point_at(page, at)
    assert told[0] == "push on torso_2_link" and "|f| 60 N" in told and any("(0, 60, 0) N" in line for line in told)
    legend = page.evaluate("document.getElementById('legend').innerText")
    assert "push on torso_2_link" in legend and "(0, 60, 0) N" in legend


def test_nothing_hidden_is_named(page: BrowserPage, shown: Shown):
    """A hidden arrow gives way to what is behind it; the legend's line goes with the layer."""
    at = shown.state.frame("torso_2_link", [0.0, 0.0, 0.2]).X_WF.translation + [0.0, 0.03, 0.0]
    page.evaluate("stage.toolbar.show('pushes', false)")
    assert point_at(page, at)[0] == "torso_2_link"
    lines = page.evaluate("[...document.querySelectorAll('#legend tr:not([hidden])')].map((r) => r.innerText).join()")
    assert "push" not in lines and "left_sole" in lines


def test_labels_stand_where_their_marks_are(page: BrowserPage, shown: Shown):
    """Switched on, each contact has one tag with its |f| at the solution's number; no tag covers another."""
    page.key("n")
    page.evaluate("stage.viewer.render()")
    tags = page.evaluate(f"{TAGS}.map((s) => [s.textContent, ...edgesOf(s.getBoundingClientRect())])")
    texts = [tag[0] for tag in tags]
    for name, force in shown.held.forces.items():
        assert texts.count(f"{name}: |f| {np.linalg.norm(force[:3]):.4g} N") == 1
    assert any(text.startswith("centre of mass: ") for text in texts)
    for i, (_, left, top, right, bottom) in enumerate(tags):
        for _, x0, y0, x1, y1 in tags[:i]:
            assert right <= x0 + 0.5 or x1 <= left + 0.5 or bottom <= y0 + 0.5 or y1 <= top + 0.5
    page.evaluate("stage.toolbar.show('forces', false); stage.viewer.render()")
    assert not any("sole: |f|" in text for text in page.evaluate(f"{TAGS}.map((s) => s.textContent)"))


def test_a_finger_taps(page: BrowserPage, shown: Shown):
    """A tap names what is near; one elsewhere takes the name away; a drag names nothing."""
    x, y = page.evaluate(f"stage.project({shown.state.frame('torso_2_link', [0.1, 0.1, 0.1]).X_WF.translation.tolist()})")
    tap = (
        "(([x, y, dx]) => { const send = (kind, x, y) => document.querySelector('#meshcat-pane canvas').dispatchEvent("
        "new PointerEvent(kind, { clientX: x, clientY: y, pointerType: 'touch', pointerId: 7, bubbles: true }));"
        "send('pointerdown', x, y); send('pointerup', x + dx, y); return stage.labels.tip.hidden; })"
    )
    assert page.evaluate(f"{tap}([{x}, {y}, 40])") is True
    assert page.evaluate(f"{tap}([{x}, {y}, 2])") is False
    assert page.evaluate(f"{tap}([{WIDTH - 8}, {HEIGHT - 60}, 0])") is True


# What lies over the picture


def test_the_scale_bar_is_as_long_as_it_says(page: BrowserPage):
    """Its pixels are the window's between two points so far apart at the robot's distance, before and after zooming."""
    page.evaluate("stage.toolbar.show('axes', true)")
    for distance in (1.0, 0.5):
        page.evaluate(
            f"stage.viewer.camera.position.sub(stage.viewer.controls.target).multiplyScalar({distance}).add(stage.viewer.controls.target);"
            "stage.viewer.render()"
        )
        text, width = page.evaluate("[stage.gauges.bar.textContent, stage.gauges.bar.getBoundingClientRect().width]")
        number, unit = text.split()
        metres = float(number) * {"m": 1.0, "cm": 0.01, "mm": 0.001}[unit]
        span = page.evaluate(
            "(() => { const c = stage.viewer.camera, T = MeshCat.THREE, [x, y, z] = stage.view.centre;"
            "const side = new T.Vector3(1, 0, 0).applyQuaternion(c.getWorldQuaternion(new T.Quaternion()));"
            f"const d = [side.x, -side.z, side.y].map((s) => s * {metres / 2});"
            "const a = stage.project([x - d[0], y - d[1], z - d[2]]), b = stage.project([x + d[0], y + d[1], z + d[2]]);"
            "return Math.hypot(b[0] - a[0], b[1] - a[1]); })()"
        )
        assert abs(span - width) < 1.0


def test_the_legend_folds(page: BrowserPage, shown: Shown, browser: Browser):
    """Open in a wide window, folded in a small one; a click and a key change it."""
    rows = "getComputedStyle(document.querySelector('#legend table')).display !== 'none'"
    assert page.evaluate(rows)
    page.key("h")
    assert not page.evaluate(rows) and page.evaluate("document.querySelector('#legend button').ariaExpanded") == "false"
    with browser.open(shown.page, width=420, height=320) as small:
        assert not small.evaluate(rows)
        box = small.evaluate(
            "(() => { const b = document.querySelector('#legend button').getBoundingClientRect(); return [b.x, b.y]; })()"
        )
        small.click(box[0] + 5, box[1] + 5)
        assert small.evaluate(rows)


def test_keys_reach_what_they_name(page: BrowserPage):
    """Layers, help and labels open and close by keys; every button has a name, every switch a label."""
    for key, panel in (("l", "layers"), ("?", "help")):
        page.key(key)
        assert page.evaluate(f"document.getElementById('{panel}').hidden") is False
        page.key("Escape")
        assert page.evaluate(f"document.getElementById('{panel}').hidden") is True
    page.key("n")
    assert page.evaluate("stage.layers.on.labels") is True
    page.key("?")
    help_ = page.evaluate("document.getElementById('help').innerText")
    assert "#view=front&on=labels,axes&off=cones" in help_ and "#on=labels" in help_ and "f\tthe camera" not in help_
    assert page.evaluate("[...document.querySelectorAll('.toolbar button')].every((b) => b.ariaLabel || b.textContent)")


def test_pictures_have_no_buttons(shown: Shown, browser: Browser, tmp_path: Path):
    """A screenshot cannot be clicked: neither buttons nor the mark of a fold are in it; view and layers are as asked."""
    with browser.open(shown.page, width=400, height=300, fragment=page_link(controls=False)) as page:
        assert page.evaluate("getComputedStyle(document.querySelector('.toolbar')).display") == "none"
        page.key("n")
        assert page.evaluate("stage.layers.on.labels") is False
    picture = screenshot(shown.page, tmp_path / "top.png", width=400, height=300, view="top", layers={"meshes": False})
    with Image.open(picture) as image:
        seen = np.asarray(image.convert("RGB"), float)
    assert (seen.max(axis=2) < 60).mean() < 0.01
