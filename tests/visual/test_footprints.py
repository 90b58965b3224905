"""Footprints of motions: where soles stood, of those that stood in two places or more."""

from dataclasses import replace

import numpy as np
import pytest

import rbd
from rbd.visual import Scene, export_motion
from rbd.visual.marks.regions import footprints_of

SIDE = 0.2


@pytest.fixture(scope="module")
def box() -> rbd.Trajectory:
    """A box that stands for five samples."""
    robot = rbd.load_robot("box")
    face = rbd.SurfaceContact("face", "box", half_lengths=(SIDE / 2, SIDE / 2), friction=0.5)
    return rbd.simulate(robot.at(), [face], duration=0.04, step=1e-2)


def moved(box: rbd.Trajectory, x: list[float], modes: list[str]) -> rbd.Trajectory:
    """As if its face had been elsewhere; without load where its mode is open."""
    open_ = np.array(modes) == "open"
    return replace(
        box,
        points={"face": box.points["face"] + np.array(x)[:, None, None] * [1.0, 0.0, 0.0]},
        point_forces={"face": np.where(open_[:, None, None], 0.0, box.point_forces["face"])},
        modes={"face": np.array(modes)},
    )


def test_each_stand_leaves_a_footprint(box):
    """Two stands 0.3 m apart, with a flight between them: two outlines, those of the corners there."""
    (found,) = footprints_of(moved(box, [0.0, 0.0, 0.2, 0.3, 0.3], ["sticks", "sticks", "open", "sticks", "sticks"]))
    assert found.name == "face"
    assert [outline.shape for outline in found.outlines] == 2 * [(4, 3)]
    assert np.abs(found.outlines[1] - found.outlines[0] - [0.3, 0.0, 0.0]).max() < 1e-9
    assert np.abs(np.ptp(found.outlines[0], axis=0) - [SIDE, SIDE, 0.0]).max() < 1e-9


@pytest.mark.parametrize(
    ("x", "modes"),
    [
        ([0.0] * 5, ["sticks"] * 5),
        ([0.0, 0.0, 0.0, 1e-3, 1e-3], ["sticks", "sticks", "open", "sticks", "sticks"]),
        ([0.0, 0.1, 0.2, 0.3, 0.4], ["slips"] * 5),
        ([0.0, 0.1, 0.2, 0.3, 0.4], ["open"] * 5),
    ],
    ids=["stands", "hops on the spot", "slides", "flies"],
)
def test_what_stands_in_one_place_leaves_none(box, x, modes):
    """Nor does what slides: there is no place where it stood."""
    assert footprints_of(moved(box, x, modes)) == []


def test_a_stand_on_an_edge_leaves_none(box):
    """All its points must have carried load at a time."""
    walks = moved(box, [0.0, 0.0, 0.2, 0.3, 0.3], ["sticks", "sticks", "open", "sticks", "sticks"])
    forces = walks.point_forces["face"].copy()
    forces[3:, 0] = 0.0
    assert footprints_of(replace(walks, point_forces={"face": forces})) == []


def test_points_leave_none(box):
    """A footprint has an area."""
    walks = moved(box, [0.0, 0.0, 0.2, 0.3, 0.3], ["sticks", "sticks", "open", "sticks", "sticks"])
    feet = {"face": walks.points["face"][:, :2]}
    assert footprints_of(replace(walks, points=feet, point_forces={"face": walks.point_forces["face"][:, :2]})) == []


def test_a_page_draws_them_where_they_are(box, tmp_path):
    """Flat on the ground, in the contact's colour, named in the legend; a page without them is smaller."""
    walks = moved(box, [0.0, 0.0, 0.2, 0.3, 0.3], ["sticks", "sticks", "open", "sticks", "sticks"])
    found = footprints_of(walks)
    with Scene(box.robot) as scene:
        scene.show(box.state(0))
        scene.draw(*found)
        marks = {mark.path: mark for mark in scene.drawn if mark.path.startswith("statics/")}
        page = scene.export(tmp_path / "box.html").read_text(encoding="utf-8")
    area = marks["statics/0/areas"]
    assert area.color == rbd.visual.contact_colors(["face"])["face"]
    assert np.abs(np.ptp(area.points, axis=0) - [SIDE + 0.3, SIDE, 0.0]).max() < 1e-9
    assert 0.0 < area.points[0, 2] - found[0].outlines[0][0, 2] < 0.01
    assert "footprints of face" in page
    drawn, bare = tmp_path / "drawn.html", tmp_path / "bare.html"
    export_motion(walks, drawn)
    export_motion(walks, bare, footprints=False)
    assert drawn.stat().st_size > bare.stat().st_size + 1000
    standing = tmp_path / "standing.html"
    export_motion(box, standing)
    export_motion(box, bare, footprints=False)
    assert standing.read_bytes() == bare.read_bytes()
