"""`rbd mechanism`: every model of `urdf/` with loops or wheels, and the picture of its branches."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.mechanism_report import report_mechanism

URDF = Path(__file__).parent.parent / "urdf"


def _report(name: str):
    robot = rbd.load_robot(URDF / f"{name}.urdf")
    q = next(iter(robot.postures.values()), None)
    return report_mechanism(robot, robot.neutral() if q is None else q)


_known = cache(_report)
"""Reports that are only read."""


@pytest.mark.parametrize(
    ("name", "finite", "branches"),
    [("four_bar", 1, 2), ("slider_crank", 1, 2), ("five_bar", 2, 2), ("six_bar", 1, 4), ("parallel_leg", 2, 8)],
)
def test_closed_loops_have_their_mobility_and_branches(name, finite, branches):
    """Planar mechanisms: by Gruebler, and two ways to close each loop of two bars."""
    report = _known(name)
    m = report.mobility
    assert m.count.value == m.instantaneous == m.finite == finite
    assert report.branches is not None and len(report.branches) == branches
    assert list(report.poses()) == [f"branch {i}" for i in range(branches)] and report.shown in report.poses()
    text = str(report)
    for part in ("closed", "mobility:", "not proved", name):
        assert part in text


@pytest.mark.parametrize(
    ("name", "growth"), [("unicycle", (2, 3, 4)), ("chaplygin_sleigh", (2, 3)), ("two_wheeled", (2, 3, 4))]
)
def test_what_rolls_is_tested_for_integrability(name, growth):
    """Heading, place and wheel angles are reached by two velocities; of two wheels one relation stays."""
    report = _known(name)
    assert report.integrable is not None and report.integrable.growth == growth
    assert "branches" in report.left_out or report.branches is None


def test_the_command_prints_and_writes(tmp_path):
    """The whole answer on the screen, in numbers and in a picture with every branch."""
    page, numbers = tmp_path / "x.html", tmp_path / "x.json"
    run = CliRunner().invoke(app, ["mechanism", str(URDF / "four_bar.urdf"), "--html", str(page), "--json", str(numbers)])
    assert run.exit_code == 0, run.output
    assert "2 branches" in run.output and "finite" in run.output and page.stat().st_size > 100_000
    data = json.loads(numbers.read_text())
    degrees = {"counted": 1, "instantaneous": 1, "finite": 1, "rank": 2}
    assert {name: data["mobility"][name] for name in degrees} == degrees
    assert np.shape(data["branches"]) == (2, 6) and data["left_out"] == {}


def test_an_open_chain_is_answered_too():
    """A robot without loops: words and mobility."""
    run = CliRunner().invoke(app, ["mechanism", str(URDF / "walker.urdf")])
    assert run.exit_code == 0, run.output
    assert "branched" in run.output or "serial" in run.output


def test_bad_files_are_refused_with_code_two(tmp_path):
    """A loop between frames that are not there: by name, with the nearest."""
    (tmp_path / "four_bar.urdf").write_text((URDF / "four_bar.urdf").read_text())
    broken = (URDF / "four_bar.loops.yaml").read_text().replace("rocker_tip", "rocker_top")
    (tmp_path / "four_bar.loops.yaml").write_text(broken)
    run = CliRunner().invoke(app, ["mechanism", str(tmp_path / "four_bar.urdf")])
    assert run.exit_code == 2 and "rocker_tip" in run.output


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "six_bar", "slider_crank"])
def test_the_legend_lists_every_branch(name, tmp_path):
    """Also that which the robot itself shows; each in a colour of its own."""
    page = tmp_path / "x.html"
    answer = CliRunner().invoke(app, ["mechanism", str(URDF / f"{name}.urdf"), "--html", str(page)])
    assert answer.exit_code == 0
    legend = json.loads(re.search(r'stage\.note\(\{"legend": (.*?)\}\);', page.read_text(encoding="utf-8"))[1])
    listed = {entry["name"]: entry["color"] for entry in legend["entries"] if entry["name"].startswith("branch")}
    count = len(_known(name).branches)
    assert sorted(listed) == [f"branch {i}" for i in range(count)] and len(set(listed.values())) == count


def test_a_pose_that_is_none_of_the_branches_hides_none():
    """Where the search missed the branch of the pose itself, all that it found are drawn beside it."""
    report = _known("four_bar")
    assert report.shown in ("branch 0", "branch 1")
    found = tuple(b for i, b in enumerate(report.branches.found) if f"branch {i}" != report.shown)
    missed = replace(report, branches=replace(report.branches, found=found))
    assert missed.shown == "" and list(missed.poses()) == ["branch 0"]


def test_a_whole_turn_is_the_same_pose():
    """A branch is told by its pose, not by how often a joint has turned."""
    report, arm = _known("four_bar"), rbd.load_robot("ur5", root="fixed")
    q = np.linspace(-1.0, 1.0, arm.nq)  # plain angles, that a whole turn does not change to themselves
    found = tuple(replace(report.branches.found[0], state=rbd.State(arm, x)) for x in (q + 0.1, q + 2.0 * np.pi))
    assert replace(report, robot=arm, state=arm.at(q), branches=replace(report.branches, found=found)).shown == "branch 1"


def test_a_motion_that_is_not_found_is_left_out_with_the_reason(monkeypatch):
    """All else is told."""

    def lost(*arguments, **settings):
        raise rbd.NoSolution("the way is lost")

    monkeypatch.setattr("rbd.cli.mechanism_report.trace", lost)
    report = _report("four_bar")
    assert report.left_out == {"motion": "the way is lost"} and report.motion is None and report.along is None
    assert len(report.branches) == 2 and report.mobility.finite == 1 and "the way is lost" in str(report)
