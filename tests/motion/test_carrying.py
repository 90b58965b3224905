"""Motions of robots that carry: the cause "grasp", its repair, following with masses that are wrong, files and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.errors import InputError
from rbd.motion import Motion, check_motion, minimum_jerk
from rbd.motion.grasps import Grasps

LEFT, RIGHT = "left_wrist_yaw_link", "right_wrist_yaw_link"
BOX = rbd.Carried(3.0, [LEFT, RIGHT], size=(0.2, 0.3, 0.15), name="box")


def holding(g1: rbd.Robot, **angles: float) -> np.ndarray:
    """G1 stands with both arms alike."""
    q = g1.standing().q.copy()
    for name, angle in {"shoulder_roll": 0.15, "shoulder_yaw": 0.0, "wrist_roll": 0.0, "wrist_pitch": 0.0, **angles}.items():
        for side, sign in (("left", 1.0), ("right", -1.0 if name.endswith(("roll", "yaw")) else 1.0)):
            q[g1.joints[f"{side}_{name}_joint"].q] = sign * angle
    return q


@pytest.fixture(scope="module")
def lift(g1: rbd.Robot) -> Motion:
    """G1 lifts both arms; on the way the hands come 11 cm nearer to each other."""
    low, high = holding(g1, shoulder_pitch=-0.3, elbow=0.3), holding(g1, shoulder_pitch=-1.0, elbow=0.5)
    return minimum_jerk(g1, [low, high, low], [0.0, 0.7, 1.4])


@pytest.fixture(scope="module")
def lifted(lift: Motion) -> Motion:
    """The same with a box, repaired."""
    return check_motion(lift.carrying(BOX)).repaired(progress=False)


def test_hands_that_leave_their_grasp_are_a_cause(lift: Motion):
    """Its size in words; within the tolerance it is none; hands of a robot that carries nothing move as they like."""
    report = check_motion(lift.carrying(BOX))
    first, last = (lift.robot.at(lift.q[i]) for i in (0, 42))
    near, far = (np.linalg.norm(at.frame(LEFT).X_WF.translation - at.frame(RIGHT).X_WF.translation) for at in (last, first))
    assert report.grasps.errors[0].max() < 1e-9 and report.grasps.errors[42, 0, 0] >= far - near > 0.1
    assert report.of_cause("grasp").mean() > 0.5 and report.worst("grasp")[0] == 42
    assert {c for c in rbd.motion.CAUSES if report.of_cause(c).any()} == {"grasp"}
    assert "grasp of box by " in report.why(0, 84)[0] and "carries    box, 3 kg in left" in str(report)
    assert report.summary()["carried"][0]["mass"] == 3.0 and json.dumps(report.summary())
    assert check_motion(lift.carrying(BOX), grasp_tolerance=(0.2, 1.0)).possible.all() and report.score < 75.0
    assert check_motion(lift).possible.all() and check_motion(lift.carrying(rbd.Carried(1.0, [LEFT]))).possible.all()
    for wrong in (0.1, (1.0, np.nan), None):
        with pytest.raises(InputError, match="grasp_tolerance"):
            check_motion(lift, grasp_tolerance=wrong)  # type: ignore[arg-type]


def test_the_weight_is_in_the_forces_and_torques(lift: Motion):
    """At rest in the first frame: the floor bears 3 kg more, and a motor that cannot hold them is named."""
    bare, loaded = check_motion(lift), check_motion(lift.carrying(BOX))
    assert (loaded.forces[0] - bare.forces[0])[:, 2].sum() == pytest.approx(3.0 * 9.81, rel=1e-3)
    heavy = check_motion(lift.carrying(replace(BOX, mass=15.0, inertia=None)))
    assert heavy.of_cause("motor").any() and "motor " in " ".join(heavy.why(0, 84))
    assert heavy.score < loaded.score


def test_the_repair_keeps_the_grasp(lift: Motion, lifted: Motion):
    """To less than a millimetre; it is possible, near the reference, and its notes say so."""
    report = check_motion(lifted)
    assert report.possible.all() and lifted.robot.carried[0].second == lift.carrying(BOX).robot.carried[0].second
    assert report.grasps.errors[..., 0].max() < 1e-3 and report.grasps.errors[..., 1].max() < 1e-2
    assert rbd.motion.MotionDifference.of(lifted, lift).joint_rms < 0.05
    assert any("hands leave the grasp of box by 0.0 mm" in note for note in lifted.notes)


@pytest.mark.parametrize("share, most", [(1.0, 1e-3), (1.2, 1e-2), (0.8, 1.2e-2)])
def test_it_is_followed_though_the_mass_is_wrong(g1: rbd.Robot, lifted: Motion, share: float, most: float):
    """To its end, by a controller that thinks the box 20 % heavier or lighter; hands keep their grasp to about a centimetre."""
    held = lifted.robot.carried[0]
    guess = g1.carrying(replace(held, mass=share * held.mass, inertia=share * np.array(held.inertia)))
    controller = rbd.control.follow(lifted, robot=guess)
    soles = lifted.robot.soles(on=lifted.ground)
    run = rbd.simulate(lifted.state(0), soles, duration=lifted.duration, step=4e-3, controller=controller, progress=False)
    off = rbd.motion.MotionDifference.of(run, lifted)
    assert off.left_out < 0.005 and np.abs(off.base).max() < 0.01 and off.joint_rms < 0.05
    assert Grasps.of(lifted.robot, run.q).errors[..., 0].max() < most


def test_files_and_edits_keep_what_is_carried(lift: Motion, lifted: Motion, tmp_path: Path):
    """Own files are read with it; others name no object, and get one by `carrying`; contacts stay; a mirror is refused."""
    lifted.save(tmp_path / "own.npz")
    again = Motion.read(tmp_path / "own.npz")
    assert again.robot.is_like(lifted.robot) and again.robot.carried == lifted.robot.carried
    lifted.save(tmp_path / "other.npz", kind="mujoco")
    plain = Motion.read(tmp_path / "other.npz", robot="g1")
    assert not plain.robot.carried and plain.carrying(BOX).robot.mass == lifted.robot.mass
    known = lift.with_contacts(rbd.motion.find_contacts(lift)).carrying(BOX)
    assert known.contacts is not None and check_motion(known).lanes.points.robot is known.robot
    assert known.cut(0.2, 0.6).robot is known.robot
    with pytest.raises(InputError, match="carries box, 3 kg .*expected free hands"):
        known.mirror()
    with pytest.raises(InputError, match="is a bare model"):
        arm = rbd.testing.box()
        minimum_jerk(arm, 2 * [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], [0.0, 0.1]).carrying(BOX)


def test_the_command_carries(lift: Motion, tmp_path: Path):
    """One motion and a data set; a wrong option is refused in words."""
    names = [str(tmp_path / f"{name}.csv") for name in "ab"]
    for name in names:
        lift.save(name, header=False)
    found = []
    for files in (names[:1], names):
        option = ["--carry", f"3@{LEFT},{RIGHT}", "--robot", "g1", "--rate", "60", "--json", str(tmp_path / "out.json")]
        assert CliRunner().invoke(app, ["check", *files, *option]).exit_code == 1
        found += json.loads((tmp_path / "out.json").read_text())["motions"]
    assert len(found) == 3 and all(each["causes"].get("grasp", 0) > 30 and each["carried"] for each in found)
    for text in ("x@a", "3", f"3@{LEFT},"):
        done = CliRunner().invoke(app, ["check", names[0], "--robot", "g1", "--rate", "60", "--carry", text])
        assert done.exit_code == 2 and "--carry" in done.output
