"""`rbd mechanism`: every model of `urdf/` with loops or wheels, and the picture of its branches."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli import app
from rbd.mechanism_report import mechanism_report

URDF = Path(__file__).parent.parent / "urdf"


def _report(name: str):
    robot = rbd.load_robot(URDF / f"{name}.urdf")
    q = next(iter(robot.postures.values()), None)
    return mechanism_report(robot, robot.neutral() if q is None else q)


@pytest.mark.parametrize(
    ("name", "finite", "branches"),
    [("four_bar", 1, 2), ("slider_crank", 1, 2), ("five_bar", 2, 2), ("six_bar", 1, 4), ("parallel_leg", 2, 8)],
)
def test_closed_loops_have_their_mobility_and_branches(name, finite, branches):
    """Planar mechanisms: by Gruebler, and two ways to close each loop of two bars."""
    report = _report(name)
    m = report.mobility
    assert m.count.value == m.instantaneous == m.finite == finite
    assert report.branches is not None and len(report.branches) == branches
    assert len(report.poses()) == branches - 1
    text = str(report)
    for part in ("closed", "mobility:", "not proved", name):
        assert part in text


@pytest.mark.parametrize(
    ("name", "growth"), [("unicycle", (2, 3, 4)), ("chaplygin_sleigh", (2, 3)), ("two_wheeled", (2, 3, 4))]
)
def test_what_rolls_is_tested_for_integrability(name, growth):
    """Heading, place and wheel angles are reached by two velocities; of two wheels one relation stays."""
    report = _report(name)
    assert report.integrable is not None and report.integrable.growth == growth
    assert "branches" in report.left_out or report.branches is None


def test_the_command_prints_and_writes(tmp_path):
    """The whole answer on the screen, in numbers and in a picture with every branch."""
    page, numbers = tmp_path / "x.html", tmp_path / "x.json"
    run = CliRunner().invoke(app, ["mechanism", str(URDF / "four_bar.urdf"), "--html", str(page), "--json", str(numbers)])
    assert run.exit_code == 0, run.output
    assert "2 branches" in run.output and "finite" in run.output and page.stat().st_size > 100_000
    data = json.loads(numbers.read_text())
    assert data["mobility"] == {"counted": 1, "instantaneous": 1, "finite": 1, "rank": 2}
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
