"""The picture: right arrows at right places, one offline page, a robot that fills the view."""

from __future__ import annotations

import json
import os
import re
import urllib.error
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import psutil
import pytest
from page_contents import block, contents
from PIL import Image

import rbd
from rbd.errors import InputError, PictureError
from rbd.model.external import ExternalForce
from rbd.problem.rows import Patch
from rbd.robots.loading import load_robot
from rbd.statics.equilibrium import hold
from rbd.visual import Scene, contact_colors, screenshot
from rbd.visual.pages.recorder import Recorder
from rbd.visual.robot_meshes import robot_parts, skeleton

MM = 1e-3
PUSH = ExternalForce("torso_2_link", [0.0, 60.0, 0.0], offset=[0.0, 0.0, 0.2])


@pytest.fixture(scope="module")
def talos():
    return load_robot("talos")


@pytest.fixture(scope="module")
def standing(talos):
    return talos.standing()


@pytest.fixture(scope="module")
def held(talos, standing):
    """Talos at rest on two soles, pushed sideways."""
    return hold(standing, talos.soles(), external=PUSH)


@pytest.fixture
def scene(talos, standing, held):
    with Scene(talos) as scene:
        scene.show(standing, held, external=PUSH)
        yield scene


@pytest.fixture(scope="module")
def page(talos, standing, held, tmp_path_factory):
    with Scene(talos) as scene:
        scene.show(standing, held, external=PUSH)
        return scene.export(tmp_path_factory.mktemp("page") / "standing.html")


@pytest.fixture(scope="module")
def picture(page, browser):
    """A screenshot of the page, shape (720, 960, 3), 0 to 255."""
    with Image.open(screenshot(page, page.with_suffix(".png"), width=960, height=720, browser=browser)) as image:
        return np.asarray(image.convert("RGB"), float)


def legend_of(scene, folder):
    """The legend that a page of this scene shows: (value by name, colour by name, lines below)."""
    text = scene.export(folder / "legend.html").read_text(encoding="utf-8")
    notes = [json.loads(note) for note in re.findall(r"stage\.note\((\{.*)\);", text)]
    legend = next(note["legend"] for note in notes if "legend" in note)
    values = {entry["name"]: entry["value"] for entry in legend["entries"]}
    return values, {entry["name"]: entry["color"] for entry in legend["entries"]}, legend["notes"]


# Arrows


def test_the_arrows_drawn_are_the_forces_solved_for(scene, held):
    """Each arrow starts where its contact's resultant acts, and is force times the scene's scale long."""
    drawn = {mark.path: mark for mark in scene.drawn}
    for name, wrench in held.forces.items():
        vertices = drawn[f"contacts/{name}/force"].points
        vector = scene.metres_per_newton * wrench[:3]
        start = held.contacts[name].centre_of_pressure
        along = (vertices - start) @ vector / (vector @ vector)
        assert abs(along.min()) < 1e-9 and np.allclose(vertices[along.argmax()], start + vector, atol=1e-9)
        assert abs(start[2]) < MM


def test_the_push_starts_at_the_point_that_is_pushed(scene, standing):
    """The arrow of an external force starts at frame + offset, in world axes."""
    vertices = next(mark for mark in scene.drawn if mark.path == "pushes/0/force").points
    at = standing.frame(PUSH.frame, PUSH.offset).X_WF.translation
    tail = vertices[vertices[:, 1].argmin()]
    assert abs(tail[1] - at[1]) < 1e-9 and np.linalg.norm(tail - at) < 0.02
    assert abs(np.ptp(vertices[:, 1]) - 60.0 * scene.metres_per_newton) < 1e-9


def test_one_metre_of_arrow_is_the_weight_of_a_man_sized_robot(scene, talos):
    """The scale is stated in the legend and does not change when other forces are shown."""
    assert scene.metres_per_newton * talos.mass * 9.81 == pytest.approx(1.0)


# Robot


def test_every_mesh_of_talos_is_in_the_page_at_its_place(page, talos, standing):
    """Each visual geometry has one object, with the pose that Pinocchio gives it."""
    data, geometry = talos.model.createData(), talos.visual_model
    geometry_data = pin.GeometryData(geometry)
    pin.updateGeometryPlacements(talos.model, data, geometry, geometry_data, standing.q)
    assert len(robot_parts(talos)) == len(geometry.geometryObjects)
    placed = {c["path"]: c["matrix"] for c in contents(page) if c.get("type") == "set_transform"}
    for i, expected in enumerate(geometry_data.oMg):
        assert np.allclose(np.reshape(placed[f"/meshcat/robot/{i}"], (4, 4)).T, expected.homogeneous)
    lowest = [
        (part.mesh.vertices @ X.rotation.T + X.translation)[:, 2].min()
        for part, X in zip(robot_parts(talos), geometry_data.oMg, strict=True)
    ]
    assert abs(min(lowest)) < 5 * MM  # on the ground


def test_a_robot_without_meshes_is_a_skeleton(talos):
    """A ball on each joint, and bones as long as the model's."""
    bones = skeleton(talos.model)
    assert len(bones) == talos.model.njoints - 1
    assert max(np.abs(part.mesh.vertices).max() for part in bones) > 0.3


# Page


def test_the_page_asks_for_nothing_from_outside(page):
    """No address stands in the page, and it forbids the browser every request, and scripts made of texts.

    The viewer names a dialect of XML; a comment says where uPlot is from.
    """
    text = page.read_text(encoding="utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy and "default-src 'none'" in policy[1] and "connect-src 'none'" in policy[1] and "eval" not in policy[1]
    assert not re.search(r"http|(?:wss?|file)://", text.replace("http-equiv", ""))
    assert not re.search(r"<(?:script|link|img|iframe)[^>]+(?:src|href)=", text)
    addresses = re.findall(rb"(?:https?|wss?|file)://[^\s\"']+", block(text, "library") + block(text, "pieces"))
    assert set(addresses) == {b"http://www.w3.org/1999/xhtml", b"https://github.com/leeoniya/uPlot"}


def test_the_page_holds_no_path_of_this_machine(page):
    """No folder of the maker's computer goes out with the picture."""
    text = page.read_text(encoding="utf-8")
    for part in (text.encode(), block(text, "library"), block(text, "pieces")):
        for folder in {str(Path.home()), str(Path(__file__).parents[2]), "site-packages"}:
            assert folder.encode() not in part


def test_the_same_scene_gives_the_same_page(talos, standing, held, page, tmp_path):
    """No clock, no network card's number and no random name goes into a page."""
    with Scene(talos) as scene:
        scene.show(standing, held, external=PUSH)
        again = scene.export(tmp_path / "again.html")
    assert again.read_bytes() == page.read_bytes()


def test_the_legend_names_forces_and_scale(scene, held, tmp_path):
    """A reader finds every contact with its size in newtons, its colour and the scale."""
    sizes, colors, notes = legend_of(scene, tmp_path)
    for name, wrench in held.forces.items():
        assert sizes[name] == f"|f| {np.linalg.norm(wrench[:3]):.4g} N"
        assert colors[name] == contact_colors(held.forces)[name]
    assert sizes["push on torso_2_link"] == "|f| 60 N"
    assert any("the weight" in note for note in notes)


def test_names_cannot_break_out_of_the_page(talos, standing, tmp_path):
    """A contact called </script> is text in the legend, not a part of the page."""
    with Scene(talos) as scene:
        name, patch = "</script><b>", Patch(np.zeros(3), np.eye(3), np.zeros((1, 3)), 0.6)
        rows = [SimpleNamespace(name=name, patch=patch)]
        forces = {name: np.array([0.0, 0.0, 100.0])}
        solution = SimpleNamespace(problem=SimpleNamespace(rows=rows), forces=forces, corner_forces={})
        scene.show(standing, solution)
        text = scene.export(tmp_path / "odd.html").read_text(encoding="utf-8")
    assert "</script><b>" not in text


def test_a_contact_keeps_its_colour_when_another_leaves(talos, standing, held, tmp_path):
    """Colours go by first appearance in a scene, not by place in the last solution."""
    with Scene(talos) as scene:
        scene.show(standing, held)
        both = legend_of(scene, tmp_path)[1]
        scene.show(standing, hold(standing, talos.soles(friction=None)[1:]))
        one = legend_of(scene, tmp_path)[1]
    assert one["right_sole"] == both["right_sole"] and "left_sole" not in one


def test_what_is_no_longer_shown_leaves_the_scene():
    """A deletion takes everything below its path along, and nothing beside it."""
    recorder = Recorder()
    for path in ("/meshcat/marks/a", "/meshcat/marks/b/c", "/meshcat/marksmen"):
        recorder.send(SimpleNamespace(lower=lambda path=path: {"type": "set_object", "path": path}))
    seen = recorder.messages()[1]
    recorder.send(SimpleNamespace(lower=lambda: {"type": "delete", "path": "/meshcat/marks"}))
    assert sum(b"set_object" in message for message in recorder.messages()[0]) == 1
    assert [b"delete" in message for message in recorder.messages(after=seen)[0]] == [True]


def test_wrong_uses_are_refused_in_words(talos, standing, tmp_path):
    """What came, what was expected, what to try."""
    with Scene(talos) as scene:
        with pytest.raises(PictureError, match="call scene.show"):
            scene.export(tmp_path / "empty.html")
        with pytest.raises(InputError, match=r"external of talos has shape \(39,\); expected \(38,\): nv"):
            scene.show(standing, external=np.zeros(talos.nv + 1))
        scene.show(standing)
        with pytest.raises(PictureError, match="No such file or directory. Give a file in a folder"):
            scene.export(tmp_path / "no" / "folder.html")
        with pytest.raises(PictureError, match=r"ends in \.html"):
            scene.export(tmp_path / "picture.png")
        with pytest.raises(InputError, match="coordinates"):
            scene.show(rbd.load_robot("bolt").standing())
        with pytest.raises(InputError, match="wants a State first"):
            scene.show(SimpleNamespace(q=np.zeros(3)))
    with pytest.raises(PictureError, match="no page"):
        screenshot(tmp_path / "none.html", tmp_path / "none.png")
    with pytest.raises(InputError, match="arrow_per_weight"):
        Scene(talos, arrow_per_weight=0.0)
    box = rbd.testing.box()
    with (
        Scene(box) as scene,
        pytest.raises(InputError, match="'box' has no meshes: it is a bare model. Load the robot with rbd.load_robot"),
    ):
        scene.show(rbd.State(box, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="Scene wants a robot, got 'talos'. Load one with rbd.load_robot"):
        Scene("talos")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seen_from is .*expected .* not straight up or down"):
        Scene(talos, seen_from=(0.0, 0.0, 1.0))


def test_without_a_browser_there_is_no_picture(monkeypatch, tmp_path):
    """None on the PATH, one that ends without a picture, and one that does not end."""
    page = tmp_path / "x.html"
    page.write_text("<html></html>")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PictureError, match="no browser found; looked on PATH for chromium, .*Install Chromium"):
        screenshot(page, tmp_path / "x.png")
    browser = tmp_path / "chromium"
    both = "echo one >&2; echo no screen >&2; exit 1"
    for says, words in (
        ("exit 3", "exit 3.: it said nothing"),
        (both, "exit 1.: no screen"),
        ("kill -9 $$", "exit -9.: it said"),
    ):
        browser.write_text(f"#!/bin/sh\n{says}\n")
        browser.chmod(0o755)
        with pytest.raises(PictureError, match=f"the browser has ended .{words}"):
            screenshot(page, tmp_path / "x.png")
    browser.write_text("no program")
    with pytest.raises(PictureError, match="the browser .* cannot be started: "):
        screenshot(page, tmp_path / "x.png")
    monkeypatch.setattr("rbd.visual.pages.browser.TIMEOUT_SECONDS", 0.05)
    browser.write_text("#!/bin/sh\nread nothing < fifo\n")
    os.mkfifo(tmp_path / "fifo")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PictureError, match="the browser took over 0.05 s"):
        screenshot(page, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_where_nothing_weighs_an_arrow_is_told_in_newtons_alone(tmp_path):
    """Without gravity a force is no share of a weight."""
    text = '<body name="b"><freejoint/><geom size=".1"/></body>'
    (tmp_path / "ball.xml").write_text(f'<mujoco><option gravity="0 0 0"/><worldbody>{text}</worldbody></mujoco>')
    robot = rbd.load_robot(tmp_path / "ball.xml")
    with Scene(robot) as scene:
        scene.show(robot.at(), external=rbd.ExternalForce("b", (3.0, 0.0, 0.0)))
        page = scene.page()
    assert "the weight" not in page.split('"legend"', 1)[1][:2000] and "N" in page


def test_a_skeleton_shows_through_its_glass(tmp_path, browser):
    """Translucent parts write no depth: what is inside is drawn, whatever the order."""
    shape = '<collision><geometry><box size=".1 .1 .1"/></geometry></collision>'
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    link = f'<link name="b">{inertia}{shape}</link>'
    (tmp_path / "glass.urdf").write_text(f'<robot name="glass">{link}</robot>')
    robot = rbd.load_robot(tmp_path / "glass.urdf")
    glass = [part for part in robot_parts(robot) if part.opacity < 0.5]
    with Scene(robot) as scene:
        scene.show(robot.at())
        page = scene.export(tmp_path / "glass.html")
    with browser.open(page, width=160, height=120) as shown:
        each = "[0, 1, 2].map(i => stage.layers.object(`robot/${i}`).children[0].material)"
        writes = shown.evaluate(f"{each}.filter(m => m.depthWrite).length")
        assert len(glass) == 1 and writes == len(robot_parts(robot)) - 1 == 2


def test_the_camera_can_stand_elsewhere(talos, standing, tmp_path):
    """ICub looks along -x: its picture is better taken from there."""
    with Scene(talos, seen_from=(-1.0, 0.5, 0.3)) as scene:
        scene.show(standing)
        assert '"direction": [-1.0, 0.5, 0.3]' in scene.export(tmp_path / "behind.html").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="seen_from"):
        Scene(talos, seen_from=(0.0, 0.0, 1.0))


# Live


def test_the_live_scene_listens_on_this_machine_only(scene):
    """One listening socket, on 127.0.0.1; requests under another host's name are refused; none after close."""
    address = urllib.request.urlopen(scene.url, timeout=10)
    with address:
        assert b"stage.connect" in address.read()
    port = int(scene.url.rstrip("/").rsplit(":", 1)[1])

    def listening():
        return [c.laddr for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN]

    assert [where.ip for where in listening() if where.port == port] == ["127.0.0.1"]
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(urllib.request.Request(scene.url, headers={"Host": "elsewhere.example"}), timeout=10)
    refused.value.close()
    assert refused.value.code == 404
    scene.close()
    assert port not in [where.port for where in listening()]


def test_a_live_viewer_is_told_what_changes(scene, standing):
    """A browser whose page is older than the scene gets the difference on its socket."""
    import asyncio

    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    async def watch():
        with urllib.request.urlopen(scene.url, timeout=10) as answer:
            text = answer.read().decode()
        address = json.loads(re.search(r'stage\.connect\((".*?")\)', text)[1])
        socket = await websocket_connect(HTTPRequest(address, headers={"Origin": scene.url.rstrip("/")}))
        stream = socket.protocol.stream
        scene.show(standing)
        told = []
        while not (told and isinstance(told[-1], str) and '"legend"' in told[-1]):
            told.append(await asyncio.wait_for(socket.read_message(), 10))
        socket.close()
        stream.close()  # the loop ends before the server answers
        return told

    told = asyncio.run(watch())
    assert any(isinstance(m, bytes) and b"delete" in m for m in told)
    assert "left_sole" not in told[-1] and "centre of mass" in told[-1]


# Looking at it


def colored(picture, color, reach=60):
    """Mask of the pixels whose colour is near '#rrggbb', shape (height, width)."""
    wanted = np.array(list(bytes.fromhex(color[1:])), float)
    return np.linalg.norm(picture - wanted, axis=2) < reach


def test_the_robot_fills_the_view_whole_and_on_the_ground(picture):
    """Dark and saturated pixels (the white head is not told from the sky) span 3/4 of the height and touch no edge."""
    assert picture.shape == (720, 960, 3)
    view = picture[20:, 340:]  # without the legend
    thing = (view.max(axis=2) < 110) | (np.ptp(view, axis=2) > 90)
    assert thing.mean() > 0.05
    rows, columns = np.flatnonzero(thing.any(axis=1)) + 20, np.flatnonzero(thing.any(axis=0))
    assert rows[0] > 5 and rows[-1] < 715 and columns[-1] < view.shape[1] - 5
    assert 0.75 * 720 < np.ptp(rows) < 0.98 * 720


def test_the_arrows_of_two_soles_are_seen_side_by_side(picture, held):
    """Both contacts' colours are in the lower half, the left foot's on the right of a picture taken from the front."""
    middle = {}
    for name in held.forces:
        seen = colored(picture, contact_colors(held.forces)[name])
        seen[:, :340] = False
        assert seen.sum() > 300
        middle[name] = np.argwhere(seen).mean(axis=0)
    assert min(row for row, _ in middle.values()) > 360
    assert middle["left_sole"][1] > middle["right_sole"][1]


class TestBeside:
    """Further poses at the same place."""

    def test_every_pose_is_drawn_and_named(self, g1):
        """A part for each moving piece of each pose, in the legend by name; the next call replaces them."""
        state = g1.standing()
        with Scene(g1) as scene:
            scene.show(state)
            scene.beside({"one": state, "two": g1.at()})
            messages = "".join(str(m) for m in scene.recorder.messages()[0])
            assert "beside/0/" in messages and "beside/1/" in messages and "two" in messages
            scene.beside({})
            left = [str(m) for m in scene.recorder.messages()[0] if "beside/0/" in str(m)]
            assert all("delete" in message for message in left)

    def test_many_poses_have_colours_of_their_own(self, tmp_path):
        """After the eight of the palette others follow; the pose that is shown is listed too."""
        robot = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
        state = robot.at()
        with Scene(robot) as scene:
            scene.show(state)
            scene.beside({f"pose {i}": state for i in range(30)}, shown="here")
            colors = {name: color for name, color in legend_of(scene, tmp_path)[1].items() if name[:4] in ("pose", "here")}
            assert len(colors) == 31 and len({color for name, color in colors.items() if name != "here"}) == 30
            scene.beside({})
            assert "here" not in legend_of(scene, tmp_path)[1]

    def test_without_a_legend_poses_have_no_names(self, g1):
        """They are drawn all the same."""
        with Scene(g1, legend=False) as scene:
            scene.show(g1.standing())
            before = len(scene.recorder.messages()[0])
            scene.beside({"a nameless pose": g1.at()})
            assert len(scene.recorder.messages()[0]) > before and "a nameless pose" not in scene.page()

    def test_what_is_no_pose_is_refused(self, g1):
        """By name; and nothing before a first picture."""
        with Scene(g1) as scene:
            with pytest.raises(rbd.errors.PictureError, match="empty"):
                scene.beside({})
            scene.show(g1.standing())
            with pytest.raises(rbd.InputError, match="'odd' is no state"):
                scene.beside({"odd": np.zeros(3)})
            with pytest.raises(rbd.InputError, match="expected"):
                scene.beside([g1.standing()])
