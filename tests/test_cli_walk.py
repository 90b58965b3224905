"""`rbd walk`: what it prints and writes, terrain by its words, pushes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.ground_option import ground_of
from rbd.robots.posture import corner_points

TROT = ["walk", "solo12", "--gait", "trot", "--steps", "2", "--friction", "0.6"]


def run(*arguments: str | Path) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = CliRunner().invoke(app, [*map(str, arguments)])
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, " ".join(answer.stderr.split())


def test_a_walk_is_printed_and_written(tmp_path: Path) -> None:
    """Its numbers are those of the same walk in Python; the page has the footprints of the plan."""
    files = {name: tmp_path / f"walk.{end}" for name, end in (("--save", "npz"), ("--html", "html"), ("--json", "json"))}
    files |= {"--log": tmp_path / "log.npz", "--plot": tmp_path / "plan.png", "--torques": tmp_path / "torques.svg"}
    code, out, err = run(*TROT, *(each for pair in files.items() for each in pair))
    assert code == 0 and not err and "solo12 took 4 steps in 1.39 s" in out
    assert "violated steps" in out and "largest friction use" in out and "mm from where they were planned" in out
    walk = rbd.control.Walk(rbd.load_robot("solo12"), 2, gait="trot", friction=0.6)
    own = rbd.simulate(walk.state, walk.contacts, duration=walk.duration, step=2e-3, controller=walk, progress=False)
    saved, log, told = (
        rbd.Trajectory.load(files["--save"]),
        rbd.control.ControlLog.load(files["--log"]),
        files["--json"].read_text(),
    )
    assert saved.q == pytest.approx(own.q, abs=1e-6) and str(log).splitlines()[0] == str(walk.log).splitlines()[0]
    found = json.loads(told)
    assert found["violated_steps"] == 0 and found["control_steps"] == len(log) and not found["fallen"]
    assert found["distance"] == pytest.approx(float(np.linalg.norm((own.com[-1] - own.com[0])[:2])), abs=1e-5)
    assert found["torque_share"] == pytest.approx(log.torque_share.max()) and found["foot_error"] < 1e-3
    assert [(step[0], step[1]) for step in found["steps"]] == [
        (step.foot, pytest.approx(step.end)) for step in walk.plan.footsteps
    ]
    foot = walk.contacts[0]
    along = np.hypot(own.forces[foot.name][:, 0], own.forces[foot.name][:, 1])
    on = own.forces[foot.name][:, 2] > 0.05 * walk.robot.mass * 9.81
    use = (along[on] / (0.6 * own.forces[foot.name][on, 2])).max()
    assert found["friction_use"][foot.name] == pytest.approx(use, rel=1e-3) and use <= 1.0 + 1e-9
    assert "footprints of front_left, as planned" in files["--html"].read_text()
    assert files["--plot"].stat().st_size > 10_000 and "<svg" in files["--torques"].read_text()


def test_a_push_is_taken_up(tmp_path: Path) -> None:
    """The report says what pushed, and that it planned again; footholds moved."""
    push = ["--push", "6,4,0", "--at", "base_link", "--from", "0.5", "--for", "0.1"]
    code, out, _ = run(*TROT, *push, "--json", tmp_path / "walk.json")
    found = json.loads((tmp_path / "walk.json").read_text())
    assert code == 0 and "pushed with" in out and "planned again" in out
    assert found["plans"] > 0 and max(step[3] for step in found["steps"]) > 1e-3


@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_words_alone_suit_the_robot(name: str) -> None:
    """Three stairs of a ninth of its height from before its feet; a slope of 8 degrees."""
    robot = rbd.load_robot(name)
    stand = robot.standing()
    toes = corner_points(stand, robot.feet())
    front, h = float(toes[:, 0].max()), float(stand.com[2] - toes[:, 2].min())
    stairs = ground_of("stairs", "--terrain", robot)
    heights = np.array([stairs.ground_at(x, 0.0).point[2] for x in np.arange(front, front + 2.0 * h, 0.01 * h)])
    rises = np.unique(heights.round(9))
    assert len(rises) == 4 and rises[0] == 0.0
    assert np.diff(rises) == pytest.approx(np.full(3, rises[1])) and 0.09 * h < rises[1] < 0.14 * h
    assert (heights[:15] == 0.0).all() and heights[25] > 0.0
    slope = ground_of("slope", "--terrain", robot)
    assert slope.ground_at(1.0, 0.0).point[2] == pytest.approx(np.tan(np.deg2rad(8.0)))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["talos", "--velocity", "5,0,0"], "at most"),
        (["talos", "--velocity", "5,0"], "expected three numbers, X,Y,TURN"),
        (["talos", "--gait", "trot"], "gait is 'trot', of a robot with 2 feet"),
        (["talos", "--steps", "0"], "steps"),
        (["talos", "--terrain", "hills"], "--terrain is 'hills'; expected a height in metres, stairs:"),
        (["talos", "--terrain", "stairs:0.1"], "e.g. stairs:0.1,0.3,5"),
        (["talos", "--push", "0,80,0"], "--at"),
        (["talos", "--push", "0,80,0", "--at", "torso_2_lnk"], "'torso_2_link'"),
        (["ur5"], "no feet are known for ur5"),
        (["talso"], "'talos'"),
        (["talos", "--log", "walk.nc"], "--log is 'walk.nc'"),
    ],
)
def test_what_is_refused(arguments: list[str], says: str) -> None:
    """Exit code 2, with what was expected, before anything is simulated."""
    code, out, err = run("walk", *arguments)
    assert code == 2 and says in err and not out
