"""Two motions in one page, beside each other: each with its own robot, forces and curves, at the same times."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.errors import InputError
from rbd.visual import export_motion
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.playback.animation import shown_motion
from rbd.visual.robot_meshes import robot_parts

FROM_THREE = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From three.js's world, y up, to W, z up."""
BELOW = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))


def slides(speed: float, duration: float, name: str = "face") -> rbd.Trajectory:
    """A box of 10 kg slides along x on level ground; friction 0.5 stops it."""
    face = rbd.SurfaceContact(name, "box", half_lengths=(0.2, 0.2), placement=BELOW, friction=0.5)
    start = rbd.State(rbd.load_robot("urdf/box.urdf"), [0, 0, 0.1, 0, 0, 0, 1.0], [speed, 0, 0, 0, 0, 0])
    return rbd.simulate(start, [face], duration=duration, step=5e-3, progress=False)


@pytest.fixture(scope="module")
def slow() -> rbd.Trajectory:
    return slides(0.5, 0.4)


@pytest.fixture(scope="module")
def fast() -> rbd.Trajectory:
    return slides(1.0, 0.3, "bottom")


@pytest.fixture(scope="module")
def stands() -> rbd.Trajectory:
    """Another robot, Solo, on its four feet."""
    solo = rbd.load_robot("solo12")
    hold = rbd.control.HoldPosture(solo.standing(), solo.feet())
    return rbd.simulate(solo.standing(), solo.feet(), duration=0.2, step=0.01, controller=hold, progress=False)


def told(page: Path) -> dict[str, Any]:
    """The motion that a page holds."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    found: dict[str, Any] = next(n["motion"] for n in notes if "motion" in n)
    return found


def poses(shown: BrowserPage, reel: int) -> Array:
    """Of the pieces of a motion's robot in the viewer, in W, shape (n, 4, 4)."""
    matrices = shown.evaluate(
        f"stage.player.reels[{reel}].cast.parts.map(({{ object }}) => {{ object.updateWorldMatrix(true, false);"
        " return object.matrixWorld.toArray(); })"
    )
    return np.array([FROM_THREE @ np.reshape(m, (4, 4)).T for m in matrices])


def expected(trajectory: rbd.Trajectory, t: float) -> Array:
    """Pinocchio's poses of the pieces at a time."""
    robot = trajectory.robot
    assert isinstance(robot, rbd.Robot)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, trajectory.at(min(t, float(trajectory.t[-1]))).q)
    return np.array([(data.oMi[x.joint] * x.placement).homogeneous for x in robot_parts(robot) if x.joint])


def test_two_motions_move_beside_each_other(
    browser: Browser, slow: rbd.Trajectory, fast: rbd.Trajectory, tmp_path: Path
) -> None:
    """Each as Pinocchio places it, the second displaced; after its end it stays, while the other goes on."""
    page = export_motion(slow, tmp_path / "x.html", beside=fast)
    shift = np.array(told(page)["second"]["shift"])
    assert np.count_nonzero(shift) == 1  # along one axis of W
    assert abs(shift).max() > 0.4  # clear of each other: the box is 0.4 m wide
    with browser.open(page, width=400, height=300) as shown:
        assert shown.evaluate("stage.player.last") == pytest.approx(0.4)
        for t in (0.0, 0.1, 0.35):
            shown.evaluate(f"stage.player.seek({t})")
            assert np.abs(poses(shown, 0) - expected(slow, t)).max() < 1e-5
            moved = expected(fast, t)
            moved[:, :3, 3] += shift
            assert np.abs(poses(shown, 1) - moved).max() < 1e-5
        apart = poses(shown, 1)[0, 0, 3] - poses(shown, 0)[0, 0, 3] - shift[0]
        assert apart == pytest.approx(fast.q[-1, 0] - slow.q[-1, 0], abs=1e-4)
        assert apart > 0.05


def test_each_has_its_own_forces_and_legend(
    browser: Browser, slow: rbd.Trajectory, fast: rbd.Trajectory, tmp_path: Path
) -> None:
    """Arrows are the forces of each motion at the time: the slow box rests, the fast one still slides."""
    page = export_motion(slow, tmp_path / "x.html", beside=fast, title="Two boxes")
    with browser.open(page, width=400, height=300, fragment="t=0.15") as shown:
        forces = np.array(shown.evaluate("stage.player.reels.map((reel) => reel.cast.tracks[0].force)"))
        assert forces[0] == pytest.approx([0.0, 0.0, 98.1], abs=1e-3)
        assert forces[1] == pytest.approx([-49.05, 0.0, 98.1], abs=1e-3)
        legend = shown.evaluate("document.getElementById('legend').textContent")
        for words in ("Two boxes", "1: box", "2: box, dashed curves", "face", "bottom", "sticks", "slips"):
            assert words in legend


def test_curves_of_the_second_are_dashed(browser: Browser, slow: rbd.Trajectory, fast: rbd.Trajectory, tmp_path: Path) -> None:
    """On the axes of the first, at their own times; each row of numbers says whose they are."""
    page = export_motion(slow, tmp_path / "x.html", beside=fast, charts=["energy"])
    with browser.open(page, width=400, height=300, fragment="t=0.05") as shown:
        dashes = shown.evaluate("stage.player.curves.charts[0].plot.series.slice(1).map(({ dash }) => dash)")
        assert dashes == [[]] * 3 + [[5, 2.5]] * 3
        counts = shown.evaluate("stage.player.curves.charts[0].plot.data.slice(1).map((y) => y.filter(Number.isFinite).length)")
        assert counts == [len(slow)] * 3 + [len(fast)] * 3  # each at its own times
        rows = shown.evaluate("[...document.querySelectorAll('.curves .keys')].map((row) => row.textContent)")
        for row, run, name in zip(rows, (slow, fast), ("1: box", "2: box, dashed curves"), strict=True):
            i = int(np.abs(run.t - 0.05).argmin())
            assert row.startswith(f"{name}kinetic {float(f'{run.kinetic[i]:.3g}'):g}")


def test_another_robot_beside_it(browser: Browser, slow: rbd.Trajectory, stands: rbd.Trajectory, tmp_path: Path) -> None:
    """Its meshes are sent too; those of the same robot are not sent again."""
    page = export_motion(slow, tmp_path / "x.html", beside=stands)
    motion = told(page)
    assert motion["second"]["tree"] == "second"
    with browser.open(page, width=400, height=300, fragment="t=0.1") as shown:
        moved = expected(stands, 0.1)
        moved[:, :3, 3] += motion["second"]["shift"]
        assert np.abs(poses(shown, 1) - moved).max() < 1e-5
        assert shown.evaluate("stage.player.reels[1].cast.tracks.length") == 4
    alone = export_motion(stands, tmp_path / "y.html")
    twice = export_motion(stands, tmp_path / "z.html", beside=stands)
    assert told(twice)["second"]["tree"] == "robot"
    assert twice.stat().st_size < 1.2 * alone.stat().st_size


def test_motions_without_forces_too(stands: rbd.Trajectory, tmp_path: Path) -> None:
    """An `rbd.Motion` beside a trajectory: its charts are those of the first that it has numbers for."""
    motion = rbd.Motion.of_arrays(stands.robot, stands.t, stands.q, stands.v, stands.a)
    both = told(export_motion(motion, tmp_path / "x.html", beside=stands, charts=["height"]))
    assert [line["motion"] for line in both["charts"]["charts"][0]["lines"]] == [0, 1]
    mixed = told(export_motion(stands, tmp_path / "y.html", beside=motion))
    assert {line["motion"] for chart in mixed["charts"]["charts"] for line in chart["lines"] if chart["name"] == "forces"} == {
        0
    }
    with pytest.raises(InputError, match=r"rbd\.Motion"):
        export_motion(stands, tmp_path / "z.html", beside="it")  # type: ignore[arg-type]
    assert len(shown_motion(motion).t) == len(stands.t)


def test_the_camera_sees_both(slow: rbd.Trajectory, fast: rbd.Trajectory, tmp_path: Path) -> None:
    """The box around what it frames holds both robots."""
    text = export_motion(slow, tmp_path / "x.html", beside=fast).read_text(encoding="utf-8")
    view = json.loads(re.findall(r'stage\.note\((\{"view".*)\);', text)[-1])["view"]
    shift = np.array(told(tmp_path / "x.html")["second"]["shift"])
    low, high = np.min(view["points"], axis=0), np.max(view["points"], axis=0)
    axis = int(np.abs(shift).argmax())
    assert high[axis] - low[axis] > abs(shift[axis]) + 0.35
