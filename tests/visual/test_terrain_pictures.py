"""Terrain in pictures and files: solids, shadows, footprints and polygons at its height, and motions that keep it."""

from __future__ import annotations

import base64
import io
import json
import re
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.constraints.terrain.plain import plain_of, terrain_of
from rbd.model.content_hash import digest
from rbd.simulation import Trajectory
from rbd.visual.marks.mark import Sizes
from rbd.visual.marks.regions import footprints_of
from rbd.visual.marks.terrain import ShownTerrain, terrain_marks
from rbd.visual.pages.page import text_of
from rbd.visual.playback import video
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.playback.shown_motion import ShownMotion
from rbd.visual.playback.trajectory_charts import edge_distances
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.stills import SHADE, TREAD, shadow_on, still
from rbd.visual.terrain_alone import corners_of

BOX = rbd.load_robot("box")
STAIRS = rbd.Terrain.stairs(0.1, 0.3, 3)
SIZES = Sizes(1.0, 0.01)
X = np.arange(6) * 0.25
GRID = rbd.Terrain.heights(0.2 * X[:, None] + 0.1 * np.sin(4.0 * X), 0.25, friction=0.5)
KINDS = {
    "stairs": STAIRS,
    "grid": GRID,
    "slope": rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0.2), normal=(0.6, 0.0, 0.8)), "grid": GRID.solids[0]}),
}


def drawn(terrain: rbd.Terrain, about: Any) -> dict[str, Any]:
    marks = terrain_marks(0, ShownTerrain.about(terrain, np.array(about, float)), SIZES)
    return {mark.path.rsplit("/", 1)[1]: mark for mark in marks}


@pytest.fixture(scope="module")
def steps() -> Trajectory:
    """A box that rests with 11 cm over the edge of a tread of 10 cm height."""
    state = rbd.State(BOX, [0.09, 0.0, 0.1, 0, 0, 0, 1])
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=STAIRS)
    return rbd.simulate(state, [face], duration=0.05, step=5e-3, progress=False)


def test_solids_are_where_the_terrain_is():
    """All corners that are drawn are on the surface of the terrain, a hair below it, and its sides end below its lowest top."""
    for terrain in KINDS.values():
        mesh = drawn(terrain, [[0.3, 0.2, 0.1], [0.6, 0.4, 0.3]])["solid"].shape
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        up = np.cross(b - a, c - a)
        tops = ((a + b + c) / 3.0)[up[:, 2] > 1e-6 * np.linalg.norm(up, axis=1)] + [0.0, 0.0, 0.5 * SIZES.lift]
        assert len(tops) > 1
        away = terrain.distances(tops)
        assert away.max() < 1e-9 and (abs(away) < 1e-9).sum() > 7  # inside is what pieces share
    sides = drawn(STAIRS, [[0.0, 0.0, 0.0]])["solid"].points
    assert sides[:, 2].min() == pytest.approx(-0.1 * SIZES.body, abs=SIZES.lift)
    assert 0.3 < sides[:, 2].max() + SIZES.lift


def test_edges_of_treads_are_drawn():
    """Each tread has its front edge as a line, across its width; between the flat triangles of a grid there is none."""
    edges = drawn(STAIRS, [[0.3, 0.0, 0.2]])["edges"].shape
    ends = np.array([one.points for one in edges])
    for x, z in ((0.0, 0.1), (0.3, 0.2), (0.6, 0.3)):
        assert (np.abs(ends - [[[x, -1.0, z], [x, 1.0, z]]]).max(axis=(1, 2)) < 1e-12).any() or (
            np.abs(ends - [[[x, 1.0, z], [x, -1.0, z]]]).max(axis=(1, 2)) < 1e-12
        ).any()
    assert not drawn(GRID, [[0.3, 0.0, 0.2]])["edges"].shape


def test_a_scene_shows_it_in_place_of_the_floor():
    """The terrain is in the legend, no plane is drawn besides, and the camera sees the robot as without it."""
    state = rbd.State(BOX, [0.09, 0.0, 0.1, 0, 0, 0, 1])
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=STAIRS)
    with rbd.visual.Scene(BOX) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        paths = [mark.path for mark in scene.drawn]
        assert "terrain/0/solid" in paths and not any(path.startswith("surfaces") for path in paths)
        corners = next(mark for mark in scene.drawn if mark.path == "support/outline").points
        np.testing.assert_allclose(np.unique(corners[:, 0].round(9)), [0.0, 0.29])  # what is over the edge does not support
        np.testing.assert_allclose(corners[:, 2], 0.1, atol=2.0 * scene.sizes.lift)
        page = scene.page()
        assert "terrain of 4 pieces" in page
        (view,) = re.findall(r'\{"view": .*?"cell": [0-9.]+\}\}', page.replace('\\"', '"'))[-1:]
        assert json.loads(view)["view"]["cell"] == 0.0 and json.loads(view)["view"]["radius"] < 2.0
        scene.show(state)
        assert not any(mark.scenery for mark in scene.drawn)
        scene.stand_on(GRID)
        assert any(mark.scenery for mark in scene.drawn)
        with pytest.raises(rbd.InputError, match="no terrain"):
            scene.stand_on(3.0)  # type: ignore[arg-type]


def test_motions_keep_it(steps, tmp_path):
    """A saved motion, a slice and a pickle have the terrain, and its page stands on it: no words of what is not drawn."""
    path = tmp_path / "steps.npz"
    steps.save(path)
    for motion in (steps, steps[::2], Trajectory.load(path)):
        (terrain,) = motion.terrains
        assert digest(terrain, "terrain") == digest(STAIRS, "terrain")
        shown = ShownMotion.of_trajectory(motion)
        page = MotionPage(shown, frames_of(shown, [1]), robot_parts(BOX), SIZES, True)
        assert not page.frames.left_out and [one.terrain for one in page.terrains] == [terrain]
    text = rbd.visual.export_motion(Trajectory.load(path), tmp_path / "steps.html").read_text(encoding="utf-8")
    assert "terrain of 4 pieces" in text and "terrain/0/solid" in text


def test_points_that_come_and_go(steps):
    """Footprints and the distance from the edge are those of the part that rests, 29 cm of 40 cm."""
    far = edge_distances(steps.points["face"], steps.point_forces["face"])
    np.testing.assert_allclose(steps.forces["face"][:, 2], 9.81 * BOX.mass, rtol=1e-9)
    np.testing.assert_allclose(far, 0.09, atol=1e-6)

    class Moved:
        """The box on one tread, then, a quarter longer on it, on the next."""

        terrains = (STAIRS,)
        points = {"face": np.array([steps.points["face"][1], np.full_like(steps.points["face"][1], np.nan),
                                    steps.points["face"][1] + [0.3, 0.0, 0.1]])}  # fmt: skip
        point_forces = {"face": np.array([steps.point_forces["face"][1]] * 3) * [[[1.0]], [[0.0]], [[1.0]]]}
        modes = {"face": np.array(["sticks", "open", "sticks"])}

    (found,) = footprints_of(Moved)
    assert [len(outline) for outline in found.outlines] == [4, 4]
    np.testing.assert_allclose(found.outlines[0][:, 2], 0.1, atol=1e-9)
    np.testing.assert_allclose(found.outlines[1] - found.outlines[0], np.tile([0.3, 0.0, 0.1], (4, 1)), atol=1e-12)


def test_its_content(tmp_path):
    """Terrains of equal geometry have equal digests, also after their surface was used; others do not; files keep all bits."""
    for make in (lambda: rbd.Terrain.stairs(0.1, 0.3, 3), lambda: rbd.Terrain.heights(GRID.solids[0].z, 0.25, friction=0.5)):
        one, other = make(), make()
        other.distances([[0.3, 0.2, 0.3]])
        assert digest(one, "terrain") == digest(other, "terrain")
        again = terrain_of(json.loads(json.dumps(plain_of(one))))
        assert digest(again, "terrain") == digest(one, "terrain") and str(again) == str(one)
    assert digest(STAIRS, "terrain") != digest(rbd.Terrain.stairs(0.1, 0.3 + 1e-15, 3), "terrain")
    assert digest(STAIRS, "terrain") != digest(rbd.Terrain.stairs(0.1, 0.3, 3, friction=0.5), "terrain")
    for given in ({}, 3, {"friction": None, "pieces": [["a", {"faces": [[0, 0, 1, 0]], "vertices": [], "loops": [[4]]}]]}):
        with pytest.raises(rbd.InputError, match="terrain"):
            terrain_of(given)


def floating() -> rbd.Motion:
    """A box 12 cm over the second tread, which moves 1 cm."""
    t = np.linspace(0.0, 0.2, 5)
    q = np.array([[0.45 + 0.05 * each, 0.0, 0.42, 0, 0, 0, 1] for each in t])
    return rbd.Motion.of_arrays(BOX, t, q, ground=STAIRS, trust=True)


def test_shadows_lie_on_treads():
    """Those of stills fall straight down onto what is under each point; those with nothing under them fall nowhere."""
    rng = np.random.default_rng(7)
    places = rng.uniform([-2.5, -0.4, 0.4], [0.9, 0.4, 0.8], (2000, 3))
    shadows, colors, _ = shadow_on(STAIRS, places)
    kept = places[places[:, 0] >= -2.0]
    assert 0.7 * len(places) < len(shadows) == len(kept) == len(colors)
    np.testing.assert_array_equal(shadows[:, :2], kept[:, :2])
    np.testing.assert_allclose(shadows[:, 2], 0.1 * np.clip(np.floor(kept[:, 0] / 0.3) + 1.0, 0.0, 3.0), atol=1e-12)
    inside = (places[:, 0] > 0.1) & (places[:, 1] > 0.1)
    shadows, _, _ = shadow_on(GRID, places[inside])
    np.testing.assert_allclose(shadows[:, 2], GRID.solids[0].tops(shadows[:, :2]), atol=1e-12)


def test_a_still_shows_the_terrain_and_the_shadow_on_it():
    """The shadow darkens it, as large as what the camera sees of the box from above; without terrain below there is none."""
    state = rbd.State(BOX, [0.45, 0.0, 0.6, 0, 0, 0, 1])

    def greys(terrain: rbd.Terrain) -> np.ndarray:
        picture = Image.open(io.BytesIO(still(BOX, state.q, ground=terrain, size=160))).convert("RGB")
        return np.asarray(picture, float)[..., 0]

    shade = SHADE * sum(TREAD)
    on = [int((np.abs(greys(terrain) - shade) < 1.5).sum()) for terrain in (STAIRS, rbd.Terrain.boxes([(5, 5, -1), (6, 6, 0)]))]
    assert on[0] > 1000 and on[1] < 20, on  # a pixel on an edge may have any grey


def test_shadows_of_videos_lie_on_treads(browser, tmp_path):
    """On the tread under a box a picture of a video is dark where the sun's ray through the box ends, and light beside it."""
    page = rbd.visual.export_motion(floating(), tmp_path / "floating.html", charts=False, seen_from=(-1.0, 0.0, 0.3))
    look = {"width": 960, "height": 320, "quality": 0.9, "speed": 1.0}
    script = """((look) => {
      const T = MeshCat.THREE, video = new Video(stage, look);
      video.draw(0.0);
      let sun;
      stage.lamps.traverse((each) => { if (each.isDirectionalLight && each.castShadow) sun = each; });
      const at = (each) => new T.Vector3().setFromMatrixPosition(each.matrixWorld);
      const to = at(sun).sub(at(sun.target)).normalize();
      const box = new T.Vector3(0.45, 0.32, 0.0), far = (box.y - 0.2) / to.y, paper = video.paper;
      const grey = (x, z) => {
        const p = new T.Vector3(x, 0.2, z).project(stage.viewer.camera);
        const [i, j] = [Math.round((p.x + 1) / 2 * look.width), Math.round((1 - p.y) / 2 * look.height)];
        return paper.getImageData(i, j, 1, 1).data[1];
      };
      const [x, z] = [box.x - far * to.x, box.z - far * to.z];  // of the box's lower side, which is 0.4 m wide
      return { x, z, shadow: grey(0.45, 0.1), left: grey(0.45, -0.34), right: grey(0.45, 0.34) };
    })"""
    with browser.open(page, width=960, height=320, fragment="controls=off", before=video._BEFORE) as opened:  # noqa: SLF001
        opened.evaluate(text_of("rbd.visual.pages", "web/video.js") + "\nwindow.Video = Video; void 0")
        seen = opened.evaluate(f"{script}({json.dumps(look)})")
    assert np.hypot(seen["x"] - 0.45, seen["z"] - 0.1) < 0.18, seen
    assert seen["shadow"] < 0.85 * min(seen["left"], seen["right"]), seen


def test_a_terrain_by_itself(tmp_path, monkeypatch):
    """Its page, and the frame of a notebook, have its solids and its pieces' names; planes alone are drawn about the origin."""
    opened = list[str]()
    monkeypatch.setattr("webbrowser.open", lambda url, new=0: opened.append(url))
    monkeypatch.setattr("rbd.visual.notebook.page_frames.find_browser", lambda: None)
    text = STAIRS.export(tmp_path / "stairs.html").read_text(encoding="utf-8")
    assert "terrain/0/solid" in text and "terrain of 4 pieces" in text and "z 0 to 0.3 m" in text
    shown = STAIRS.show()
    assert opened == [shown.as_uri()] and shown.read_text(encoding="utf-8") == text
    html = STAIRS._repr_html_()
    assert "<iframe" in html and "terrain of 4 pieces" in html
    assert rbd.visual.notebook_page(GRID).title == "terrain"
    slope = KINDS["slope"].solids[0]
    corners = corners_of(rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0.2), normal=(0.6, 0.0, 0.8))}))
    np.testing.assert_allclose(corners @ slope.faces[0, :3], 0.16, atol=1e-12)
    with pytest.raises(rbd.errors.PictureError, match="html"):
        STAIRS.export(tmp_path / "stairs.png")


def test_a_lift_is_drawn_where_it_is(tmp_path):
    """A state shows it where it is at the state's time, a motion takes its marks along; the floor beside it stays."""
    rise = rbd.Speed((0.0, 0.0, 0.2), start=(0.0, 0.0, 0.05))
    lift = rbd.Terrain.boxes([(-1, -1, -0.5), (-0.3, 1, 0)], [(-0.3, -1, -0.5), (1, 1, 0)]).with_motion("box 1", motion=rise)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=lift)
    state = rbd.State(BOX, [0, 0, 0.15, 0, 0, 0, 1], [0, 0, 0.2, 0, 0, 0], t=0.5)
    with rbd.visual.Scene(BOX) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        solid = next(mark for mark in scene.drawn if mark.path == "terrain/0/solid").points
        assert solid[:, 2].max() == pytest.approx(0.15, abs=scene.sizes.lift)
    run = rbd.simulate(state, [face], duration=0.1, step=5e-3, progress=False)
    shown = ShownMotion.of_trajectory(run)
    page = MotionPage(shown, frames_of(shown, [1]), robot_parts(BOX), SIZES, True)
    height = 0.05 + 0.2 * page.frames.times
    np.testing.assert_allclose(page.frames.lifts[:, 0, 2], height, atol=1e-15)
    np.testing.assert_array_equal(page.frames.rows[:, 7:14], page.frames.lifts[:, 0])
    assert not page.frames.left_out and [str(one.terrain.names) for one in page.terrains] == ["('box 0',)", "('box 1',)"]
    (motion,) = json.loads(page.whole({}, 1.0)).values()
    assert motion["lifts"] == [{"path": "marks/terrain/1", "body": 1}] and motion["bodies"] == 2
    floors = np.frombuffer(base64.b64decode(motion["floors"]), np.float32)
    np.testing.assert_allclose(floors, height, atol=1e-6)
    text = rbd.visual.export_motion(run, tmp_path / "lift.html").read_text(encoding="utf-8")
    assert "terrain/1/solid" in text
