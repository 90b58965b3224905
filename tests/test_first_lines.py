"""The first line of each command answers what was asked; times are printed with --verbose only."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app

URDF = Path(__file__).parents[1] / "urdf"
STRANGE = "sqrt(N m)"
"""A unit that few know."""


def printed(*arguments: str) -> tuple[int, list[str]]:
    """(exit code, lines of the standard output) of a command."""
    answer = CliRunner().invoke(app, list(arguments))
    return answer.exit_code, answer.stdout.splitlines()


@pytest.mark.parametrize(
    ("arguments", "first"),
    [
        (["stand", "talos"], r"talos stands: the largest torque is 24\.1 % of its limit \(arm_left_4_joint\), right_sole uses"),
        (["stand", "talos", "--push", "0,80,0"], r"Motors can withstand the push: the largest torque is 32\.2 %"),
        (["stand", "talos", "--push", "0,119,0"], r"No motor torques withstand the push: it tips\."),
        (["region", "talos"], r"The centre of mass of talos is 85\.7 mm inside its support region: it can stand\."),
        (["simulate", "solo12", "--duration", "0.02"], r"After 0\.02 s it stands on .*at rest\."),
        (
            ["simulate", str(URDF / "four_bar.urdf"), "--duration", "0.05"],
            r"After 0\.05 s four_bar has moved its centre of mass",
        ),
        (["mechanism", str(URDF / "four_bar.urdf"), "--tries", "20"], r"four_bar moves with 1 degree of freedom\."),
        (["mechanism", str(URDF / "unicycle.urdf")], r"unicycle has 2 degrees of freedom of velocity and 4 of configuration"),
        (["plane", "--from", "1,0", "--to", "0.5,0.5"], r"Both points are reached\."),
        (["plane", "--from", "1,0", "--to", "1.5,0"], r"Not reached: \(1\.5, 0\) m by 0\.5 m\."),
        (["info", "solo12"], r"solo12: 2\.\d* kg"),
    ],
)
def test_the_first_line_answers(arguments, first):
    """Before any table; no unit that few know is told, and no times are."""
    code, lines = printed(*arguments)
    assert code == (1 if {"1.5,0", "0,119,0"} & set(arguments) else 0) and re.match(first, lines[0]), lines[0]
    text = "\n".join(lines)
    assert STRANGE not in text and not re.search(r"^ *times ", text, re.M)


@pytest.mark.parametrize("arguments", [["stand", "solo12"], ["region", "talos"], ["simulate", "solo12", "--duration", "0.02"]])
def test_times_are_printed_when_asked_for(arguments):
    """With --verbose: how long loading took, and the rest."""
    code, lines = printed(*arguments, "--verbose")
    (times,) = [line for line in lines if re.match(" *times ", line)]
    assert code == 0 and "load " in times


def test_branches_are_told_in_degrees_with_the_names_of_their_joints():
    """One line a branch, in the angles that the configuration has; displacements in metres."""
    _, lines = printed("mechanism", str(URDF / "slider_crank.urdf"), "--tries", "20")
    robot = rbd.load_robot(URDF / "slider_crank.urdf")
    crank = robot.joints["crank_joint"].coordinate(robot.at(next(iter(robot.postures))).q)
    assert f"branches with crank_joint at {np.degrees(crank):.2f} deg:" in lines
    found = rbd.mechanism.branches(robot.at(), fixed={"crank_joint": crank}, tries=20)
    for i, branch in enumerate(found.found):
        rod, slide = (robot.joints[name].coordinate(branch.q) for name in ("rod_joint", "slider_joint"))
        line = f"  branch {i}: rod_joint {np.degrees(rod):.2f} deg, slider_joint {slide:.5g} m"
        assert any(each.startswith(line) for each in lines) and f"{line}; {branch.hits} hit" in str(found)


def test_a_check_says_first_whether_the_motion_is_possible(tmp_path):
    """Solo12 stands still, or hops: all frames possible, or what prevents them in how many."""
    solo = rbd.load_robot("solo12")
    low = solo.standing().q
    high = low + 0.15 * np.eye(solo.nq)[2]
    rbd.motion.minimum_jerk(solo, [low, low], [0.0, 0.3], rate=50.0).save(tmp_path / "still.npz")
    rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0).save(tmp_path / "hop.npz")
    code, lines = printed("check", str(tmp_path / "still.npz"))
    assert code == 0 and lines[0] == "Possible: no cause against any of its 16 frames."
    code, lines = printed("check", str(tmp_path / "hop.npz"))
    assert code == 1 and lines[0].startswith("Not possible in 24 of 31 frames: floats in 24")
    code, lines = printed("check", str(tmp_path))
    assert code == 1 and lines[0] == "1 of 2 motions possible."
