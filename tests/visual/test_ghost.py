"""A second motion of the same robot in one picture: translucent, at the same times, with the meshes of the first."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from test_animation import FROM_THREE

import rbd
from rbd.arrays import Array
from rbd.errors import InputError
from rbd.visual import Browser, export_motion, find_browser, motion_sheet
from rbd.visual.robot_meshes import robot_parts

SINGLE = 1e-5
"""Numbers of a page have seven digits [m]."""


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def still(solo: rbd.Robot) -> rbd.Motion:
    """It stands for 0.4 s."""
    return rbd.motion.minimum_jerk(solo, [solo.standing().q] * 2, [0.0, 0.4], rate=50.0)


@pytest.fixture(scope="module")
def rises(solo: rbd.Robot) -> rbd.Motion:
    """Its trunk goes up by 10 cm and turns, in 0.2 s: it ends before the other, and has other frames."""
    low = solo.standing().q
    high = low.copy()
    high[2] += 0.1
    high[3:7] = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 0.8]))).coeffs()
    return rbd.motion.minimum_jerk(solo, [low, high], [0.0, 0.2], rate=75.0)


@pytest.fixture(scope="module")
def pages(still: rbd.Motion, rises: rbd.Motion, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(without the ghost, with it)."""
    report, folder = rbd.check_motion(still), tmp_path_factory.mktemp("ghost")
    return export_motion(report, folder / "alone.html"), export_motion(report, folder / "both.html", ghost=rises)


def told(page: Path) -> dict[str, Any]:
    """The motion that a page holds."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    found: dict[str, Any] = next(n["motion"] for n in notes if "motion" in n)
    return found


def poses(motion: dict[str, Any]) -> Array:
    """Of bodies, shape (frames, bodies, 7)."""
    rows = np.frombuffer(base64.b64decode(motion["rows"]), "<f4").reshape(len(motion["times"]), -1)
    return rows[:, : 7 * motion["bodies"]].reshape(len(rows), -1, 7)


def q_at(motion: rbd.Motion, t: float) -> Array:
    """Between its frames, after its end the last."""
    i = int(np.clip(np.searchsorted(motion.t, t, side="right") - 1, 0, motion.n - 2))
    share = float(np.clip((t - motion.t[i]) / (motion.t[i + 1] - motion.t[i]), 0.0, 1.0))
    q = np.array(pin.interpolate(motion.robot.model, motion.q[i], motion.q[i + 1], share))
    q[:3] = (1.0 - share) * motion.q[i, :3] + share * motion.q[i + 1, :3]
    return q


def test_its_poses_are_those_of_the_second_motion(pages: tuple[Path, Path], rises: rbd.Motion) -> None:
    """At each time of the first one, as Pinocchio places the bodies; after its end it stays as it is."""
    alone, both = told(pages[0]), told(pages[1])
    bodies = both["ghost"]["bodies"]
    assert alone["ghost"] is None
    assert both["bodies"] == 2 * alone["bodies"] == 2 * bodies
    assert np.array_equal(poses(both)[:, :bodies], poses(alone))
    model, data = rises.robot.model, rises.robot.model.createData()
    joints = sorted({part.joint for part in robot_parts(rises.robot)} - {0})
    for t, row in zip(both["times"], poses(both)[:, bodies:], strict=True):
        pin.forwardKinematics(model, data, q_at(rises, t))
        for joint, pose in zip(joints, row, strict=True):
            assert np.abs(pin.XYZQUATToSE3(pose.astype(float)).homogeneous - data.oMi[joint].homogeneous).max() < SINGLE


def test_meshes_are_in_the_page_once(pages: tuple[Path, Path]) -> None:
    """Poses alone are added."""
    alone, both = (page.stat().st_size for page in pages)
    assert both < 1.05 * alone


def test_the_camera_sees_both(still: rbd.Motion, rises: rbd.Motion, tmp_path: Path) -> None:
    """What it frames includes a ghost that is three metres away."""
    far = rises.lifted(3.0)
    texts = [
        export_motion(rbd.check_motion(still), tmp_path / f"{i}.html", ghost=ghost).read_text(encoding="utf-8")
        for i, ghost in enumerate((rises, far))
    ]
    near, high = (json.loads(re.findall(r'stage\.note\((\{"view".*)\);', text)[-1])["view"]["radius"] for text in texts)
    assert high > near + 1.0


def test_the_floor_of_a_report_is_that_of_its_ghost(still: rbd.Motion, tmp_path: Path) -> None:
    """A page's floor is at zero: both are lowered by the same height."""
    low = rbd.Motion.of_arrays(still.robot, still.t, still.q - 0.2 * np.eye(still.robot.nq)[2], still.v, still.a, ground=-0.2)
    motion = told(export_motion(rbd.check_motion(low), tmp_path / "low.html", ghost=low))
    half = motion["bodies"] // 2
    assert np.array_equal(poses(motion)[:, :half], poses(motion)[:, half:])


def test_trajectories_have_ghosts_too(solo: rbd.Robot, rises: rbd.Motion, tmp_path: Path) -> None:
    """A motion beside a trajectory, and a trajectory beside itself."""
    hold = rbd.control.HoldPosture(solo.standing(), solo.feet())
    run = rbd.simulate(solo.standing(), solo.feet(), duration=0.05, step=5e-3, controller=hold, progress=False)
    by_motion = told(export_motion(run, tmp_path / "x.html", ghost=rises))
    by_run = told(export_motion(run, tmp_path / "y.html", ghost=run))
    assert by_motion["ghost"]["name"] == "minimum jerk (translucent)"
    half = by_run["bodies"] // 2
    assert np.array_equal(poses(by_run)[:, :half], poses(by_run)[:, half:])


def test_two_motions_in_one_page(still: rbd.Motion, rises: rbd.Motion, tmp_path: Path) -> None:
    """Of reference motions no forces are known: the page has both robots, and no contacts."""
    motion = told(export_motion(rises, tmp_path / "x.html", ghost=still))
    half = motion["bodies"] // 2
    assert motion["contacts"] == []
    assert poses(motion)[0, :half] == pytest.approx(poses(motion)[0, half:], abs=1e-6)
    assert poses(motion)[-1, 0, 2] - poses(motion)[-1, half, 2] > 0.05
    with pytest.raises(InputError, match=r"rbd\.Motion"):
        export_motion("rises", tmp_path / "y.html")  # type: ignore[arg-type]


def test_a_ghost_of_another_robot_is_refused(still: rbd.Motion, rises: rbd.Motion, tmp_path: Path) -> None:
    """And nothing is written; the same robot loaded twice is the same."""
    arm = rbd.load_robot("panda", root="fixed")
    report = rbd.check_motion(still)
    for ghost, words in ((3, "rbd.Motion"), (rbd.motion.minimum_jerk(arm, [arm.at().q] * 2, [0.0, 0.1]), "same robot")):
        with pytest.raises(InputError, match=words):
            export_motion(report, tmp_path / "x.html", ghost=ghost)
    assert not list(tmp_path.iterdir())
    again = rbd.load_robot("solo12")  # the same file, loaded a second time
    same = rbd.Motion.of_arrays(again, rises.t, rises.q, rises.v, rises.a)
    assert export_motion(report, tmp_path / "x.html", ghost=same).exists()


ASK = """(() => {
stage.player.seek(0.1);
const cast = stage.player.cast;
const world = (node) => { node.updateWorldMatrix(true, false); return node.matrixWorld.toArray(); };
const half = cast.parts.length / 2;
const meshes = cast.parts.slice(half).map(({ object }) => object.children.map((each) => each.geometry.uuid));
const firsts = cast.parts.slice(0, half).map(({ object }) => {
  const found = [];
  object.traverse((each) => each.isMesh && found.push(each.geometry.uuid, each.geometry.uuid));
  return found;
});
return {
  parts: cast.parts.map((part) => world(part.object)), meshes, firsts,
  legend: document.getElementById("legend").textContent,
};
})()"""


def test_the_browser_places_it_and_shares_the_meshes(pages: tuple[Path, Path], rises: rbd.Motion, browser: Browser) -> None:
    """World poses of both in the viewer's own tree; geometries are the same objects."""
    with browser.open(pages[1], width=800, height=600) as page:
        said = page.evaluate(ASK)
    parts = [part for part in robot_parts(rises.robot) if part.joint]
    assert len(said["parts"]) == 2 * len(parts)
    assert said["meshes"] == said["firsts"]
    assert all(said["meshes"])
    assert "minimum jerk (translucent)" in said["legend"]
    data = rises.robot.model.createData()
    pin.forwardKinematics(rises.robot.model, data, q_at(rises, 0.1))
    for part, matrix in zip(parts, said["parts"][len(parts) :], strict=True):
        shown = FROM_THREE @ np.reshape(matrix, (4, 4)).T
        assert np.abs(shown - (data.oMi[part.joint] * part.placement).homogeneous).max() < 1e-4


def test_a_strip_shows_it_in_its_colour(solo: rbd.Robot, rises: rbd.Motion, tmp_path: Path) -> None:
    """Violet where the second motion is, and nowhere without it."""
    image_of = pytest.importorskip("PIL.Image")
    if find_browser() is None:
        pytest.skip("Chromium is not installed: nothing to photograph")
    hold = rbd.control.HoldPosture(solo.standing(), solo.feet())
    run = rbd.simulate(solo.standing(), solo.feet(), duration=0.2, step=5e-3, controller=hold, progress=False)
    violet = []
    for i, ghost in enumerate((None, rises)):
        path = motion_sheet(run, [0.2], tmp_path / f"{i}.png", width=240, height=240, ghost=ghost, trace=False)
        with image_of.open(path) as image:
            r, g, b = np.moveaxis(np.asarray(image.convert("RGB"), float), 2, 0)
        violet.append(int(((r - g > 8.0) & (b - r > 8.0)).sum()))
    assert violet[0] == 0
    assert violet[1] > 3000  # of 57,600
