"""Pages are small: meshes travel once, as whole numbers, deflated; and look as the meshes do."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from page_contents import block, contents, meshes, unpacked
from PIL import Image

import rbd
from rbd.errors import PictureError
from rbd.visual import Scene, export_motion, shapes
from rbd.visual.marks import primitives
from rbd.visual.packed_meshes import STEPS, in_order, message, split
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.shapes import Mesh

MM = 1e-3
WEB = Path(rbd.__file__).parent / "visual/pages/web"
MOST_BYTES = {"talos": 3_200_000, "g1": 4_000_000}


@pytest.fixture(scope="module")
def standing_page(tmp_path_factory):
    """A page of a robot that stands on its feet, by the robot's name."""
    made = {}

    def page(name: str) -> Path:
        if name not in made:
            robot = rbd.load_robot(name)
            with Scene(robot) as scene:
                scene.show(robot.standing(), rbd.hold(robot.standing(), robot.feet()))
                made[name] = scene.export(tmp_path_factory.mktemp("page") / f"{name}.html")
        return made[name]

    return page


def read_back(mesh: Mesh) -> Mesh:
    """A mesh as a page would draw it."""
    header, triangles = split(message({"path": "/meshcat/it"}, mesh))
    return unpacked(json.loads(header), triangles)


# What is sent


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_a_page_is_small_and_its_meshes_are_right_to_a_fiftieth_of_a_millimetre(name, standing_page):
    """Every triangle of the robot is there; a point moves by at most half a step on each axis, a 65535th of its box."""
    page = standing_page(name)
    assert page.stat().st_size < MOST_BYTES[name]
    sent = meshes(page)
    for i, part in enumerate(robot_parts(rbd.load_robot(name))):
        whole, drawn = in_order(part.mesh), sent[f"/meshcat/robot/{i}"]
        assert np.array_equal(drawn.faces, whole.faces)
        moved = np.abs(drawn.vertices - whole.vertices)
        assert (moved <= 0.501 * np.ptp(whole.vertices, axis=0) / STEPS + 1e-9).all()
        assert np.linalg.norm(moved, axis=1).max() < 0.02 * MM


def test_a_page_of_a_motion_is_as_small(standing_page, tmp_path):
    """Two seconds of Talos at 30 frames a second."""
    talos = rbd.load_robot("talos")
    still = np.tile(talos.standing().q, (61, 1))
    motion = rbd.Motion(talos, np.linspace(0.0, 2.0, 61), still, np.zeros((61, talos.model.nv)), np.zeros((61, talos.model.nv)))
    assert export_motion(motion, tmp_path / "motion.html").stat().st_size < MOST_BYTES["talos"]


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.ball(0.3, centre=np.array([5.0, -2.0, 1.0])),
        Mesh(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]), np.array([[0, 1, 2]])),
        Mesh(np.eye(3), np.array([[2, 1, 0], [0, 1, 2]])),
        Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)),
        shapes.revolved([(1.0, z) for z in np.linspace(0.0, 9.0, 400)], smooth=True, segments=200),
        Mesh(np.full((3, 3), 1e6), np.array([[0, 1, 2]])),
    ],
    ids=["ball", "flat", "out of order", "empty", "over 65536 vertices", "a point, far away"],
)
def test_triangles_are_read_back(mesh):
    """Same triangles in the same order, turned the same way; coordinates up to half a step."""
    whole, back = in_order(mesh), read_back(mesh)
    assert np.array_equal(back.faces, whole.faces)
    side = np.ptp(mesh.vertices, axis=0) if len(mesh.vertices) else np.zeros(3)
    assert (np.abs(back.vertices - whole.vertices) <= 0.501 * side / STEPS + 1e-9 * np.abs(whole.vertices) + 1e-12).all()


def test_equal_meshes_travel_once(tmp_path):
    """Two poses beside the robot, in other colours: the page grows by their headers alone."""
    robot = rbd.load_robot("ur5", root="fixed")
    with Scene(robot) as scene:
        scene.show(robot.at())
        alone = scene.export(tmp_path / "alone.html")
        scene.beside({"one": robot.at(np.full(6, 0.5)), "two": robot.at(np.full(6, -0.5))})
        three = scene.export(tmp_path / "three.html")
    assert len(meshes(three)) >= len(meshes(alone)) + 2 * 5
    assert three.stat().st_size - alone.stat().st_size < 25_000
    sent = meshes(three)
    first, second = ({m.vertices.tobytes() for path, m in sent.items() if f"/beside/{i}/" in path} for i in (0, 1))
    assert len(first & second & {m.vertices.tobytes() for path, m in sent.items() if "/robot/" in path}) >= 5


def test_a_mark_that_shines_through_the_robot_is_sent_once(standing_page):
    """The page makes the second copy itself."""
    paths = [told["path"] for told in contents(standing_page("talos"))]
    assert any("/marks/" in path for path in paths) and not any(path.endswith("_seen_through") for path in paths)


# What the browser makes of it


def test_the_browser_reads_the_same_triangles_as_python(standing_page, browser):
    """Vertices and triangle corners of two parts, read back from three.js."""
    page = standing_page("talos")
    sent = meshes(page)
    with browser.open(page, width=160, height=120) as shown:
        for path in ("robot/3", "robot/5"):
            found = f"stage.layers.object({json.dumps(path)}).children[0].geometry"
            vertices = np.reshape(shown.evaluate(f"Array.from({found}.attributes.position.array)"), (-1, 3))
            corners = np.reshape(shown.evaluate(f"Array.from({found}.index.array)"), (-1, 3))
            mesh = sent[f"/meshcat/{path}"]
            assert np.array_equal(corners, mesh.faces)
            assert np.abs(vertices - mesh.vertices).max() < 1e-6


START, VECTOR = np.array([0.3, -0.2, 0.1]), np.array([0.2, 0.3, -0.6])


@pytest.fixture(scope="module")
def drawn(standing_page, browser):
    """The points of primitives as the page draws them, shape (n, 3) [m]."""
    with browser.open(standing_page("talos"), width=160, height=120) as shown:

        def points(*some: primitives.Primitive) -> np.ndarray:
            given = json.dumps([one.data() for one in some])
            return np.reshape(shown.evaluate(f"Array.from(solid({given}).attributes.position.array)"), (-1, 3))

        yield points


def test_an_arrow_is_drawn_from_its_point_along_its_vector(drawn):
    """All triangles lie between tail and tip; the tail is at the point, the tip at point + vector, or where it is cut."""
    for longest, heads in ((np.inf, 1), (0.5, 2)):
        arrow = primitives.arrow(START, VECTOR, radius=0.01, longest=longest)
        length = min(longest, np.linalg.norm(VECTOR))
        n = VECTOR / np.linalg.norm(VECTOR)
        vertices = drawn(arrow)
        along = (vertices - START) @ n
        assert abs(along.min()) < 1e-6 and abs(along.max() - length) < 1e-6 and arrow.data()["heads"] == heads
        assert np.abs(vertices[along.argmax()] - arrow.points[1]).max() < 1e-6
        off_axis = np.linalg.norm(vertices - START - along[:, None] * n, axis=1)
        assert off_axis.max() == pytest.approx(0.026, abs=1e-6)  # of the heads, 2.6 radii
        assert (off_axis[np.abs(along) < 1e-6] < 0.0101).all()


@pytest.mark.parametrize("angle", [2.0, -2.0, 5.0, 0.05])
def test_an_arc_is_drawn_around_its_axis_to_its_angle(drawn, angle):
    """Its head ends on the circle at the angle; all of it is near the circle, on its side of the start."""
    axes = shapes.axes_along(np.array([1.0, 2.0, -0.5]))
    arc = primitives.arc(START, axes, 0.2, angle, thickness=0.005)
    local = (drawn(arc) - START) @ axes
    tip = 0.2 * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert np.linalg.norm(local - tip, axis=1).min() < 1e-6 and np.abs((arc.points[-1] - START) @ axes - tip).max() < 1e-12
    assert np.abs(local[:, 2]).max() < 0.0131 and np.abs(np.hypot(local[:, 0], local[:, 1]) - 0.2).max() < 0.0131
    turned = np.arctan2(local[:, 1], local[:, 0]) * np.sign(angle) % (2.0 * np.pi)
    assert ((turned < abs(angle) + 1e-6) | (turned > 2.0 * np.pi - 0.03)).all()
    ring = (drawn(primitives.ring(START, axes, 0.2, thickness=0.005)) - START) @ axes
    assert np.allclose(np.hypot(np.hypot(ring[:, 0], ring[:, 1]) - 0.2, ring[:, 2]), 0.005, atol=2e-4)


def test_lines_areas_cones_and_balls_have_their_points(drawn):
    """A line is as thick as it says, and closed where it says so; corners of areas and rims are there."""
    corners = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    counts = []
    for closed in (False, True):
        vertices = drawn(primitives.line(corners, radius=0.01, closed=closed))
        ends = np.vstack([corners, corners[:1]]) if closed else corners
        along = np.diff(ends, axis=0)
        share = np.clip(np.einsum("pij,ij->pi", vertices[:, None] - ends[:-1], along) / (along**2).sum(axis=1), 0.0, 1.0)
        off = np.linalg.norm(vertices[:, None] - ends[:-1] - share[..., None] * along, axis=2).min(axis=1)
        assert off.max() < 0.0101
        counts.append(len(vertices))
    assert counts[1] > 1.3 * counts[0]  # a third side
    assert np.array_equal(drawn(primitives.polygon(corners)), corners)
    rim = drawn(primitives.fan(START, corners))
    assert {tuple(p) for p in rim.round(6)} == {tuple(p) for p in np.vstack([START, corners]).round(6)} and len(rim) == 9
    balls = drawn(primitives.ball(0.1, corners))
    assert np.allclose(np.linalg.norm(balls[:, None] - corners, axis=2).min(axis=1), 0.1, atol=1e-6)
    both = drawn(primitives.polygon(corners), primitives.ball(0.1, corners))
    assert len(both) == 3 + len(balls)


def test_equal_meshes_share_one_geometry_in_the_browser(tmp_path, browser):
    """A pose beside the robot, and the copy of an arrow that is seen through the robot, use the robot's and the arrow's."""
    robot = rbd.load_robot("ur5", root="fixed")
    with Scene(robot) as scene:
        scene.show(robot.at())
        scene.beside({"one": robot.at(np.full(6, 0.5))})
        page = scene.export(tmp_path / "two.html")
    count = """((path) => { const found = new Set();
    for (const each of path) stage.layers.object(each).traverse(({ geometry }) => geometry && found.add(geometry));
    return found.size; })"""
    with browser.open(page, width=160, height=120) as shown:
        sent = [m.vertices.tobytes() for path, m in meshes(page).items() if "/robot/" in path or "/beside/" in path]
        assert shown.evaluate(f"{count}(['robot', 'beside'])") == len(set(sent)) <= len(sent) - 5


def test_an_old_browser_is_told_in_words(standing_page, browser, tmp_path):
    """Without DecompressionStream the page says what is missing, and in which browsers it is there."""
    text = standing_page("talos").read_text(encoding="utf-8")
    old = tmp_path / "old.html"
    old.write_text(text.replace("<head>", "<head><script>delete globalThis.DecompressionStream;</script>", 1), encoding="utf-8")
    with pytest.raises(PictureError, match="This picture could not be drawn. This browser is too old .* Firefox 113"):
        browser.open(old, width=160, height=120)


def test_the_page_draws_before_it_says_that_it_is_ready(standing_page, browser):
    """The first picture after `ready` shows Talos: a dark and a white robot before a pale background."""
    with browser.open(standing_page("talos"), width=320, height=240) as shown:
        assert shown.evaluate("stage.viewer.renderer.info.render.frame") >= 1
        with Image.open(io.BytesIO(shown.picture())) as image:
            grey = np.asarray(image.convert("L"), float)
    assert (grey < 60.0).mean() > 0.03


def test_the_library_in_the_page_is_that_of_the_package(standing_page):
    """Byte for byte uPlot with its licence, then the viewer, which names the licence of three.js."""
    text = standing_page("talos").read_text(encoding="utf-8")
    library, charts, viewer = block(text, "library"), WEB / "uplot", (WEB / "viewer/viewer.min.js").read_bytes()
    assert library.endswith(b"\n" + viewer) and b"Three.js Authors\n * SPDX-License-Identifier: MIT" in viewer
    assert (charts / "uPlot.iife.min.js").read_bytes() in library and (charts / "LICENSE").read_bytes() in library
    assert b"The MIT License" in library and b"uPlot (v1.6.32)" in library


WRITE = """
import sys, rbd
def loaded(): print(*[m for m in "meshcat IPython pyngrok zmq PIL tornado".split() if m in sys.modules], sep=",")
robot = rbd.load_robot("four_bar")
with rbd.visual.Scene(robot) as scene:
    scene.show(robot.at("assembled"))
    scene.export(sys.argv[1])
    loaded()
    scene.url
    loaded()
"""


def test_a_page_is_written_without_notebooks_servers_and_meshcats_own_package(tmp_path):
    """A live scene loads Tornado, and nothing else of them."""
    done = subprocess.run([sys.executable, "-c", WRITE, str(tmp_path / "p.html")], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["", "tornado"]


def test_a_translucent_body_is_seen_below_the_floor(tmp_path, browser):
    """A box of red glass, half of it below z = 0: its front face is as red there as above."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    look = (
        '<visual><geometry><box size="0.4 0.4 0.4"/></geometry><material name="r"><color rgba="1 0 0 0.6"/></material></visual>'
    )
    (tmp_path / "glass.urdf").write_text(f'<robot name="glass"><link name="b">{mass}{look}</link></robot>')
    robot = rbd.load_robot(tmp_path / "glass.urdf")
    with Scene(robot, seen_from=(1.0, 0.0, 0.3), legend=False) as scene:
        scene.show(robot.at())
        page = scene.export(tmp_path / "glass.html")
    with browser.open(page, width=320, height=240, fragment="controls=off") as shown:
        above, below = (shown.evaluate(f"stage.project([0.2, 0.05, {z}])") for z in (0.1, -0.1))
        with Image.open(io.BytesIO(shown.picture())) as image:
            seen = np.asarray(image.convert("RGB"), float)
    red = [seen[round(y), round(x)] for x, y in (above, below)]
    for pixel in red:
        assert pixel[0] - pixel[1:].max() > 80.0
    assert np.abs(red[0] - red[1]).max() < 40.0


def test_a_page_is_drawn_once(standing_page, browser):
    """Loading ends with one picture: half a second later there is no second one, until something changes."""
    frames = "stage.viewer.renderer.info.render.frame"
    with browser.open(standing_page("talos"), width=160, height=120) as shown:
        at_first = shown.evaluate(frames)
        shown.evaluate("new Promise((done) => setTimeout(done, 500))")
        assert shown.evaluate(frames) == at_first
        shown.resize(200, 150)
        shown.wait(f"{frames} > {at_first}")
