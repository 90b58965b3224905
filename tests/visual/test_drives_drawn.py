"""Driven joints in pictures: where they are, which way they move, and what the legend says of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rbd
from rbd.visual.marks.other_constraints import AROUND_TORQUES, DRIVE_COLOR, drive_marks, shown_drives
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.playback.shown_motion import ShownMotion
from rbd.visual.robot_meshes import robot_parts

ENGINE = rbd.mechanism.slider_crank(0.045, 0.15)


def scene_of(rate: float, t: float = 0.0) -> tuple[rbd.State, rbd.visual.Scene, rbd.DrivenJoint]:
    drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(rate, start=np.pi / 4))
    state = rbd.mechanism.project_velocity(ENGINE.at("assembled"), [drive]).at_time(t)
    scene = rbd.visual.Scene(ENGINE)
    scene.show(state, rbd.solve(state, [0.0], [drive]))
    return state, scene, drive


@pytest.mark.parametrize("rate", [30.0, -30.0])
def test_the_arrow_goes_the_way_the_joint_moves(rate):
    """It lies on a circle about the joint's axis; its head is ahead of its tail by the right-hand rule about the axis."""
    state, scene, drive = scene_of(rate)
    with scene:
        (way,) = (mark for mark in scene.drawn if mark.path == "drives/drive/way")
        assert {mark.path for mark in scene.drawn if mark.path.startswith("drives")} == {
            "drives/drive/way",
            "drives/drive/track",
        }
        shown = shown_drives(state, [drive])[0]
        np.testing.assert_allclose(shown.motion, [np.pi / 4, rate, 0.0], atol=1e-9)
        off = way.points - shown.point
        radius = np.linalg.norm(off - np.outer(off @ shown.axis, shown.axis), axis=1)
        assert abs(np.median(radius) - AROUND_TORQUES * scene.sizes.arc) < 2.0 * scene.sizes.shaft
        turn = np.cross(off[:-1], np.diff(off, axis=0)) @ shown.axis
        assert np.sign(np.median(turn)) == np.sign(rate)
        page = scene.page().replace('\\"', '"')
        assert "crank_joint is driven" in page and f"{rate:g} rad/s" in page and "drives joint crank_joint" in page


def test_at_rest_there_is_no_arrow_and_time_counts():
    """The picture tells the motion at the state's own time; a drive at rest is a ring alone; a lock is no drive."""
    state, scene, drive = scene_of(0.0)
    with scene:
        assert [mark.path for mark in scene.drawn if mark.path.startswith("drives")] == ["drives/drive/track"]
        sizes = scene.sizes
    swing = rbd.DrivenJoint("drive", "crank_joint", lambda t: (np.sin(t), np.cos(t), -np.sin(t)))
    (later,) = shown_drives(state.at_time(2.0), [swing])
    np.testing.assert_allclose(later.motion, [np.sin(2.0), np.cos(2.0), -np.sin(2.0)], atol=1e-9)
    assert later.rate == f"{np.cos(2.0):.4g} rad/s" and len(drive_marks(later, sizes)) == 2
    assert shown_drives(state, [rbd.constraints.JointLock("lock", "crank_joint")]) == []


def page_of(run: rbd.Trajectory, scene: rbd.visual.Scene) -> MotionPage:
    parts = robot_parts(run.robot)
    frames = frames_of(ShownMotion.of_trajectory(run), sorted({part.joint for part in parts} - {0}))
    return MotionPage(ShownMotion.of_trajectory(run), frames, parts, scene.sizes, True)


def test_pages_of_motions_show_what_is_driven(tmp_path):
    """A bent bar about the driven axis goes with the body that turns; the legend names the joint; files keep it, slices too."""
    state, scene, drive = scene_of(30.0)
    run = rbd.simulate(state, [drive], duration=0.05, step=1e-3, progress=False)
    assert run.driven == run[5:].driven == {"drive": "crank_joint"}
    run.save(tmp_path / "run.npz")
    assert rbd.Trajectory.load(tmp_path / "run.npz", robot=ENGINE).driven == run.driven
    with scene:
        page, crank = page_of(run, scene), ENGINE.joints["crank_joint"]
        (bar,) = page.further_parts["drives"]
        assert (bar.name, bar.joint, bar.color) == ("drive", crank.id, DRIVE_COLOR)
        ((point, axis),) = [(x.point, x.axis) for x in shown_drives(state, [drive])]
        R, p = (x[0] for x in state.joint_places([crank.id]))
        off = bar.mesh.vertices @ R.T + p - point  # in W, where the state is the first of the motion
        assert np.abs(off @ axis).max() < 2.0 * scene.sizes.shaft
        radius = np.linalg.norm(off - np.outer(off @ axis, axis), axis=1)
        assert np.abs(radius - AROUND_TORQUES * scene.sizes.arc).max() < 2.0 * scene.sizes.shaft
        motion = json.loads(page.whole({}, 1.0))["motion"]
        assert motion["driven"] == {"drive": {"joint": "crank_joint", "color": DRIVE_COLOR}} and "drive" in motion["others"]
        (rider,) = (each for each in motion["riders"] if each["tree"] == "drives")
        assert rider["node"] == 0 and page.frames.joints[rider["body"]] == crank.id
        assert rider["at"] == [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    with pytest.raises(rbd.InputError, match="expected {constraint: joint}"):
        rbd.Trajectory(**vars(run) | {"driven": {"motor": "crank_joint"}})
    with pytest.raises(rbd.errors.RbdError, match="crank"):
        rbd.Trajectory(**vars(run) | {"driven": {"drive": "crank"}})


def test_a_sliding_drive_is_a_bar_along_its_axis():
    """Of a shaker: as long in the page as in a scene."""
    b = rbd.RobotBuilder("shaker", root="fixed")
    b.body("table", rbd.robots.Box((0.2, 0.2, 0.02), mass=1.0))
    b.joint("rail", "ground", "table", "prismatic", axis=(0, 0, 1))
    robot = b.robot()
    drive = rbd.DrivenJoint("drive", "rail", lambda t: (0.1 * np.sin(t), 0.1 * np.cos(t), -0.1 * np.sin(t)))
    run = rbd.simulate(robot.at([0.0], [0.1]), [drive], duration=0.05, step=1e-2, progress=False)
    with rbd.visual.Scene(robot) as scene:
        scene.show(run.state(0))
        (bar,) = page_of(run, scene).further_parts["drives"]
        (track, _) = drive_marks(shown_drives(run.state(0), [drive])[0], scene.sizes)
        off, half = np.linalg.norm(bar.mesh.vertices[:, :2], axis=1), 0.5 * np.ptp(track.points[:, 2])
        ends = np.abs(bar.mesh.vertices[off > 0.99 * off.max(), 2])  # where its caps begin
        np.testing.assert_allclose(ends, half, rtol=1e-9)
        assert off.max() < scene.sizes.shaft


def test_a_plane_that_moves_is_drawn_where_it_is(tmp_path):
    """A motion keeps it as a half-space that moves, whose marks the page takes along; a plane at rest is no terrain."""
    b = rbd.RobotBuilder("box")
    b.body("box", rbd.robots.Box((0.2, 0.2, 0.1), mass=1.0))
    box, rise = b.robot(), rbd.Speed((0.0, 0.0, 0.2), start=(0.0, 0.0, 0.0))
    start = box.at([0, 0, 0.05, 0, 0, 0, 1], [0, 0, 0.2, 0, 0, 0])
    lift = rbd.Ground(point=(0, 0, 0), motion=rise)
    for contact in (
        rbd.CollisionContacts("c", box, friction=0.5, on=lift),
        rbd.PointContact("c", "box", offset=(0, 0, -0.05), friction=0.5, on=lift),
    ):
        run = rbd.simulate(start, [contact], duration=0.1, step=5e-3, progress=False)
        run.save(tmp_path / "run.npz")
        for each in (run, rbd.Trajectory.load(tmp_path / "run.npz", robot=box)):
            shown = ShownMotion.of_trajectory(each)
            frames = frames_of(shown, [1])
            np.testing.assert_allclose(frames.lifts[:, 0, 2], 0.2 * frames.times, atol=1e-12)
            assert not frames.left_out and [terrain.names for terrain in shown.terrains] == [("ground",)]
    still = rbd.CollisionContacts("c", box, friction=0.5, on=rbd.Ground(point=(0, 0, 0)))
    assert rbd.simulate(box.at(start.q), [still], duration=0.02, step=5e-3, progress=False).terrains == ()
