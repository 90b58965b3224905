"""Driven joints in pictures: where they are, which way they move, and what the legend says of them."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.visual.marks.other_constraints import AROUND_TORQUES, drive_marks, shown_drives

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
