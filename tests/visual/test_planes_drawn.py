"""Slopes and walls in pages of motions and audits: a piece of each plane once, and disks at single points on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual.marks.surfaces import ShownSurface
from rbd.visual.playback.animation import Playback, motion_scene
from rbd.visual.playback.audit_motion import shown_audit
from rbd.visual.playback.mode_disks import contact_normals
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.playback.shown_motion import ShownMotion

LEAN, MU = np.radians(20.0), 0.5
NORMAL = np.array([-np.sin(LEAN), 0.0, np.cos(LEAN)])
SLOPE = rbd.Ground(point=(0.0, 0.0, 0.3), normal=NORMAL)
CORNERS = [(x, y, -0.1) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
R = pin.exp3(np.array([0.0, -LEAN, 0.0]))
BOX = rbd.load_robot("urdf/box.urdf")
WALL = rbd.Ground(point=(0.0, 0.5, 0.0), normal=(0.0, -1.0, 0.0))
SIDE = rbd.PointContact("side", "box", offset=(0.0, 0.2, 0.0), friction=MU, on=WALL)


def feet(on: rbd.Ground | rbd.Terrain) -> list[rbd.PointContact]:
    return [rbd.PointContact(f"foot {i}", "box", offset=corner, friction=MU, on=on) for i, corner in enumerate(CORNERS)]


def rested(on: rbd.Ground | rbd.Terrain, speed: float = 0.0) -> rbd.Trajectory:
    """The box on the slope, at rest or sliding across it, and beside a wall that it does not reach."""
    q = [*(np.array(SLOPE.point) + 0.1 * NORMAL), *pin.Quaternion(R).coeffs()]
    start = rbd.State(BOX, q, [0.0, speed, 0.0, 0.0, 0.0, 0.0])
    return rbd.simulate(start, [*feet(on), SIDE], duration=0.1, step=1e-2, progress=False)


@pytest.fixture(scope="module")
def still() -> rbd.Trajectory:
    return rested(SLOPE)


GRID = rbd.Terrain.heights(0.3 + np.tan(LEAN) * np.tile(np.linspace(-1.0, 1.0, 5)[:, None], 5), 0.5, origin=(-1.0, -1.0))


@pytest.mark.parametrize("on", [SLOPE, rbd.Terrain({"slope": SLOPE}), GRID], ids=["plane", "half-space", "grid"])
def test_single_points_on_a_slope_have_disks(on: rbd.Ground | rbd.Terrain) -> None:
    """At rest they use tan(lean) / mu of the friction in the mean, in closed form; sliding all of it."""
    run = rested(on)
    disks = ShownMotion.of_trajectory(run).disks
    normal = sum(run.point_forces[f"foot {i}"][5, 0] @ NORMAL for i in range(4))
    used = [disks[f"foot {i}"].used[5, 0] for i in range(4)]
    pushes = [run.point_forces[f"foot {i}"][5, 0] @ NORMAL for i in range(4)]
    assert np.dot(used, pushes) / normal == pytest.approx(np.tan(LEAN) / MU, abs=1e-6)
    sliding = ShownMotion.of_trajectory(rested(on, speed=2.0)).disks
    for i in range(4):
        assert np.abs(disks[f"foot {i}"].normals[5, 0] - NORMAL).max() < 1e-12
        assert np.abs(sliding[f"foot {i}"].used[5:] - 1.0).max() < 1e-6


def test_each_plane_is_drawn_once(still: rbd.Trajectory) -> None:
    """Four feet on one slope: one piece of it; the wall, which nothing touches, is where the box comes nearest."""
    slope, wall = ShownMotion.of_trajectory(still).surfaces
    assert slope.names == tuple(f"foot {i}" for i in range(4))
    assert wall.names == ("side",)
    assert (slope.title, wall.title) == ("slope of 20 degrees", "wall")
    assert np.abs((slope.corners - SLOPE.point) @ NORMAL).max() < 1e-12
    assert wall.point == pytest.approx([*still.points["side"][0, 0, :1], 0.5, still.points["side"][0, 0, 2]], abs=1e-3)
    scene = motion_scene(still, Playback(charts=False))
    marks = {mark.path: mark for mark in scene.drawn if mark.path.startswith("surfaces/")}
    assert set(marks) == {f"surfaces/{i}/{part}" for i in range(2) for part in ("area", "grid", "edge")}
    assert all(mark.layer == "surfaces" and mark.opacity < 1.0 for mark in marks.values())
    assert not frames_of(ShownMotion.of_trajectory(still), [1]).left_out
    assert '["slope of 20 degrees", "#8d99a6"]' in scene.page().replace('\\"', '"')


def test_a_trajectory_keeps_planes_that_stay(still: rbd.Trajectory, tmp_path: Path) -> None:
    """To the last bit in files; belts that run along their plane too, lifts not, which are terrains."""
    still.save(tmp_path / "run.npz")
    for kept in (still[3:], rbd.Trajectory.load(tmp_path / "run.npz", robot=BOX)):
        assert list(kept.planes) == [*(f"foot {i}" for i in range(4)), "side"]
        assert np.array_equal(kept.planes["foot 2"].normal, SLOPE.normal)
        assert np.array_equal(kept.planes["foot 2"].point, SLOPE.point)
    belt = rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.3, 0.0, 0.0))
    turns = rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0), about=(1.0, 0.0, 0.0))
    rises, tips = rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.1)), rbd.Ground(normal=(0.0, 0.0, 1.0))
    assert [ground.stays for ground in (SLOPE, belt, turns, rises, tips)] == [True, True, True, False, False]
    moved = rbd.Ground(point=(0.0, 0.0, 0.0), motion=lambda t: (0.0, 0.0, np.sin(t)))
    for wrong in ({"hand": SLOPE}, {"side": rises}, {"side": moved}, {"side": 0.0}):
        with pytest.raises(rbd.InputError, match="planes of a trajectory"):
            rbd.Trajectory(**vars(still) | {"planes": wrong})


def test_an_audit_draws_planes_of_the_world(still: rbd.Trajectory) -> None:
    """From points and normals alone: the slope, not the wall, on which nothing pushes; disks with the same share."""
    report = rbd.audit(rbd.audits.from_trajectory(still, [*feet(SLOPE), SIDE]))
    shown = shown_audit(report, 0)
    (slope,) = shown.surfaces
    assert (slope.title, slope.names) == ("slope of 20 degrees", ("box",))
    (disks,) = shown.disks.values()
    own = ShownMotion.of_trajectory(still).disks
    expected = sorted(float(own[f"foot {i}"].used[5, 0]) for i in range(4))
    assert sorted(disks.used[5][np.isfinite(disks.used[5])].tolist()) == pytest.approx(expected, abs=1e-6)


def test_points_of_terrain_have_the_normal_of_the_face_that_pushes() -> None:
    """At an edge the force tells tread from riser; a lift is where it is at the time; far from all none is known."""
    step = rbd.Terrain.boxes([(0.0, -1.0, -1.0), (1.0, 1.0, 0.2)])
    lift = step.with_motion("box 0", motion=lambda t: (0.0, 0.0, 0.3 * t))
    t = np.array([0.0, 1.0])
    edge, up, back = [[0.0, 0.0, 0.2]], [[0.1, 0.0, 1.0]], [[-1.0, 0.0, 0.1]]
    found = contact_normals(np.array([edge, edge]), np.array([up, back]), t, None, [step])
    assert found is not None
    assert np.array_equal(found[:, 0], [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    on_it = np.array([[[0.5, 0.0, 0.2]], [[0.5, 0.0, 0.5]]])
    lifted = contact_normals(on_it, np.array([up, up]), t, None, [lift])
    assert lifted is not None
    assert np.array_equal(lifted[:, 0], [[0.0, 0.0, 1.0]] * 2)
    assert contact_normals(on_it, np.array([up, up]), t, None, [step]) is None


def test_a_surface_moves_with_a_second_motion() -> None:
    """Beside another one it is drawn by as much as its motion."""
    one = ShownSurface.of("foot", SLOPE, np.array([[0.0, 0.0, 0.3], [0.1, 0.0, 0.3]]))
    assert np.abs(one.moved([0.0, 2.0, 0.0]).corners - one.corners - [0.0, 2.0, 0.0]).max() == 0.0
