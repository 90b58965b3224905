"""Drives and what rolls, said in loop files and by the builder; mobility and `rbd mechanism` of what is driven."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.constraints import RollingBody, RollingOnRound
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.robots import Box, LoopFile, Rod, Sphere

RATE, START = 30.0, 0.7
TIMES, VALUES = (0.0, 0.1, 0.3, 0.4, 0.5), (0.2, 0.3, 0.1, 0.25, 0.2)


def slider_crank(**drive: Any) -> rbd.RobotBuilder:
    """A crank of 5 cm, a coupler of 20 cm and a piston, driven at the crank."""
    b = rbd.RobotBuilder("engine", root="fixed")
    b.body("crank", Rod((0, 0, 0), (0.05, 0, 0), mass=0.4))
    b.body("coupler", Rod((0, 0, 0), (0.2, 0, 0), mass=0.3))
    b.body("piston", Box((0.04, 0.04, 0.04), mass=0.5))
    b.joint("crank_joint", "ground", "crank", "continuous", axis=(0, 0, 1))
    b.joint("coupler_joint", "crank", "coupler", at=(0.05, 0, 0), axis=(0, 0, 1))
    b.joint("piston_joint", "ground", "piston", "prismatic", axis=(1, 0, 0))
    b.loop("pin", ("coupler", (0.2, 0, 0)), ("piston", (0, 0, 0)), kind="planar", axis=(0, 0, 1))
    b.posture("assembled", {"crank_joint": 0.0, "coupler_joint": 0.0, "piston_joint": 0.25})
    if drive:
        b.drive("motor", "crank_joint", **drive)
    return b


def rollers() -> rbd.RobotBuilder:
    """A tray that lifts, on which an egg rolls, and a marble in a bowl and one in a pipe."""
    b = rbd.RobotBuilder("rollers", root="fixed")
    b.body("tray", Box((1, 1, 0.1), mass=1.0))
    b.joint("lift", "ground", "tray", "prismatic", axis=(0, 0, 1))
    for name in ("egg", "marble", "bead"):
        b.body(name, Sphere(0.05, mass=0.1))
        b.joint(f"{name}_joint", "ground", name, "free")
    b.wheel("egg_rolls", "egg", kind="rolling_body", shape=(0.1, 0.05, 0.06), radius=0.01, on="tray")
    b.wheel("in_bowl", "marble", kind="rolling_on_round", radius=0.05, surface_radius=-0.5, on=(0.1, 0.2, 0.5))
    b.wheel("in_pipe", "bead", kind="rolling_on_round", radius=0.05, surface_radius=-0.4, axis=(0, 1, 0), on=0.4)
    return b


def test_a_drive_of_the_builder_is_that_of_its_file(tmp_path: Path) -> None:
    """A robot in memory, saved and read, of two texts, and pickled: one joint, rate and start, to the last bit."""
    b = slider_crank(rate=RATE, start=START)
    path = b.save(tmp_path / "engine.urdf")
    texts = rbd.load_robot(text=b.urdf(), loops=LoopFile.of_text(b.loop_file()))
    for robot in (b.robot(), rbd.load_robot(path), texts, pickle.loads(pickle.dumps(texts))):
        (drive,) = robot.drives()
        assert isinstance(drive, rbd.DrivenJoint) and (drive.name, drive.joint) == ("motor", "crank_joint")
        assert isinstance(drive.motion, rbd.Speed) and (drive.motion.rate, drive.motion.start) == (RATE, START)
        assert [loop.name for loop in robot.loops()] == ["pin"] and robot.wheels() == ()
    (line,) = [line for line in b.loop_file().splitlines() if "motor" in line]
    assert line == "  - {kind: speed, name: motor, joint: crank_joint, rate: 30, start: 0.7}"


def test_speed_is_the_kind_that_need_not_be_said() -> None:
    """`rate` alone: from zero."""
    found = LoopFile.of_text("drives: [{name: motor, joint: crank_joint, rate: 2}]").drives
    assert found[0].motion(0.5) == (1.0, 2.0, 0.0)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_drive_follows_the_spline_of_its_points(tmp_path: Path, periodic: bool) -> None:
    """SciPy's cubic spline through the points, with its derivatives; periodic beyond its ends too."""
    b = slider_crank(times=TIMES, values=VALUES, periodic=periodic)
    (drive,) = rbd.load_robot(b.save(tmp_path / "engine.urdf")).drives()
    spline = CubicSpline(TIMES, VALUES, bc_type="periodic" if periodic else "not-a-knot")
    for t in (0.0, 0.17, 0.5, *([1.23] if periodic else [])):
        rows = drive.rows(b.robot().at().at_time(t))
        assert rows.error is not None and abs(rows.error[0] + float(spline(t))) < 1e-15
        assert abs(rows.velocity[0] + float(spline(t, 1))) < 1e-13 and abs(rows.bias[0] + float(spline(t, 2))) < 1e-11
    if not periodic:
        with pytest.raises(InputError, match="motion of 'motor' is a spline from t = 0 to 0.5 s"):
            drive.rows(b.robot().at().at_time(1.0))


def test_a_drive_acts_where_it_is_given() -> None:
    """Not by itself, as a closure does: alone the crank is at rest without gravity; with it the piston's closed form."""
    robot = slider_crank(rate=RATE).robot(gravity=(0, 0, 0))
    assert np.abs(rbd.solve(robot.at("assembled"), []).a).max() < 1e-12
    start = rbd.mechanism.project_velocity(robot.at("assembled"), robot.drives())
    moved = rbd.simulate(start, robot.drives(), duration=0.1, step=1e-3)
    a, r, ell = RATE * moved.t, 0.05, 0.2
    x = r * np.cos(a) + np.sqrt(ell**2 - (r * np.sin(a)) ** 2)
    column = robot.joints["piston_joint"].q
    assert np.abs(moved.q[:, column].ravel() - x).max() < 1e-10  # projected onto the loop at each step


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ("{name: m, joint: crank_jont, rate: 1}", r"drive 'm': .*crank_jont.*'crank_joint'"),
        ("{name: m, joint: crank_joint}", "drives.*'m'.* has no 'rate'"),
        ("{name: m, joint: crank_joint, rat: 1}", "a key 'rat'; nearest: 'rate'"),
        ("{name: m, joint: crank_joint, kind: sped, rate: 1}", "kind of drives.*'sped'.*'speed'"),
        ("{name: m, joint: crank_joint, kind: revolute}", "kind of drives"),
        ("{name: m, joint: crank_joint, rate: fast}", "rate of drives.*'fast'; expected a finite number"),
        ("{name: pin, joint: crank_joint, rate: 1}", "'pin'"),
        ("{name: m, kind: spline, joint: crank_joint, times: [0, 1, 2], values: [0, 1, 0]}", "expected 4 to 10000 finite"),
        ("{name: m, kind: spline, joint: crank_joint, times: [0, 1, 2, 3], values: [0, 1, 0, 1, 2]}", "4 times and 5 values"),
        ("{name: m, kind: spline, joint: crank_joint, times: [0, 1, 1, 2], values: [0, 1, 0, 1]}", "do not increase"),
        ("{name: m, kind: spline, joint: j, times: [0, 1, 2, 3], values: [0, 1, 0, 1], periodic: true}", "repeats"),
        ("{name: m, kind: spline, joint: j, times: [0, 1, 2, 3], values: [0, 1, 0, 1], periodic: 1}", "true or false"),
    ],
)
def test_a_drive_that_is_wrong_is_refused_by_name(drive: str, words: str) -> None:
    """With the file, the drive, what came, what was expected and the nearest names."""
    b = slider_crank()
    with pytest.raises(ModelError, match=words):
        rbd.load_robot(text=b.urdf(), loops=LoopFile.of_text(b.loop_file() + f"drives: [{drive}]\n"))


def test_the_builder_refuses_neither_and_both_and_a_free_joint() -> None:
    """A drive has a rate, or times and values; its joint one degree of freedom."""
    b = slider_crank()
    for keys, words in (({}, "has no 'rate'"), ({"rate": 1.0, "times": TIMES, "values": VALUES}, "a key 'rate'")):
        with pytest.raises(InputError, match=words):
            b.drive("motor", "crank_joint", **keys)
    b = rollers()
    b.drive("spin", "egg_joint", rate=1.0)
    with pytest.raises(ModelError, match=r"drive 'spin': .*'egg_joint'"):
        b.robot()


def test_what_rolls_round_is_said_in_files(tmp_path: Path) -> None:
    """An ellipsoid on a body, balls in a bowl and in a pipe: their rows are those of the same made in Python."""
    b = rollers()
    made = (
        RollingBody("egg_rolls", "egg", shape=(0.1, 0.05, 0.06), radius=0.01, on=rbd.Body("tray")),
        RollingOnRound("in_bowl", "marble", radius=0.05, surface_radius=-0.5, on=rbd.Ground(point=(0.1, 0.2, 0.5))),
        RollingOnRound("in_pipe", "bead", radius=0.05, surface_radius=-0.4, axis=(0, 1, 0), on=0.4),
    )
    rng = np.random.default_rng(0)
    for robot in (b.robot(), rbd.load_robot(b.save(tmp_path / "rollers.urdf"))):
        q = pin.integrate(robot.model, robot.neutral(), rng.normal(size=robot.nv))
        state = robot.at(q, rng.normal(size=robot.nv))
        assert [type(wheel) for wheel in robot.wheels()] == [type(wheel) for wheel in made]
        for wheel, other in zip(robot.wheels(), made, strict=True):
            rows, expected = wheel.rows(state), other.rows(state)
            assert wheel.frames == other.frames
            for what in ("J", "bias", "velocity", "error"):
                assert np.array_equal(getattr(rows, what), getattr(expected, what))


@pytest.mark.parametrize(
    ("wheel", "words"),
    [
        ("{name: w, kind: rolling_body, frame: egg}", "has no 'shape'"),
        ("{name: w, kind: rolling_body, frame: egg, shape: [1, 0, 1]}", "expected semi-axes > 0"),
        ("{name: w, kind: rolling_on_round, frame: egg, radius: 1}", "has no 'surface_radius'"),
        ("{name: w, kind: rolling_on_round, frame: egg, radius: 1, surface_radius: -0.5}", "smaller ball"),
        ("{name: w, kind: rolling_on_rund, frame: egg, radius: 1, surface_radius: 1}", "nearest: 'rolling_on_round'"),
        ("{name: w, kind: rolling_ball, frame: egg, radius: 1, on: [0, 1]}", "a height .*, a point .*, or a frame's name"),
        ("{name: w, kind: rolling_ball, frame: egg, radius: 1, on: try}", "wheel 'w': no frame 'try' in rollers; nearest: 'tr"),
        ("{name: w, kind: rolling_ball, frame: egg, radius: 1, surface_radius: 1}", "a key 'surface_radius'"),
    ],
)
def test_what_rolls_and_is_wrong_is_refused_by_name(wheel: str, words: str) -> None:
    """As drives."""
    b = rollers()
    text = b.loop_file().split("wheels:")[0] + f"wheels: [{wheel}]\n"
    with pytest.raises(ModelError, match=words):
        rbd.load_robot(text=b.urdf(), loops=LoopFile.of_text(text))


def test_a_pair_and_the_doctor_say_what_drives_there_are() -> None:
    """The doctor notes them; a pair leaves them out, and says so."""
    robot = slider_crank(rate=RATE).robot()
    assert any(note.kind == "drive" and "crank_joint" in note.text for note in rbd.doctor(robot).notes)
    with pytest.warns(ModelWarning, match="no loops, wheels or drives of its own: 'pin', 'motor'"):
        rbd.robots.merge_robots(robot, rbd.load_robot("solo12"))


# ------------------------------------------------------------------------------------------------------------ mobility


@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_a_drive_takes_a_degree_of_freedom_at_any_speed(rate: float) -> None:
    """Of a four-bar all, of a five-bar one of two: counts, rank and finite motion are those of a lock in place."""
    for robot, joint, left in ((rbd.mechanism.four_bar(1, 3, 3, 4), "crank_joint", 0), (rbd.load_robot("five_bar"), None, 1)):
        state = robot.at("assembled")
        joint = joint or robot.actuated_names[0]
        at = robot.joints[joint].coordinate(state.q)
        drive = rbd.DrivenJoint("drive", joint, rbd.Speed(rate, start=at - 0.2 * rate))
        found = rbd.mechanism.mobility(state.at_time(0.2), [drive])
        locked = rbd.mechanism.mobility(state, [rbd.JointLock("drive", joint)])
        assert (found.instantaneous, found.finite, found.count.value) == (left, left, left)
        assert found.rank == locked.rank and np.abs(found.singular_values - locked.singular_values).max() < 1e-14
        assert (found.driven, found.t) == (("drive",), 0.2)
        assert "'drive' drives it: taken at t = 0.2 s" in str(found)
        assert ("it moves as 'drive' drives it" in found.verdict) == (left == 0)
    assert locked.driven == ()


def test_other_questions_of_geometry_still_want_rest() -> None:
    """Integrability and singular poses are of J v = 0: a prescribed motion is refused there."""
    robot = rbd.mechanism.four_bar(1, 3, 3, 4)
    state = robot.at("assembled")
    drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(3.0, start=robot.joints["crank_joint"].coordinate(state.q)))
    for ask in (rbd.mechanism.integrability, rbd.mechanism.singularities, rbd.mechanism.classify):
        with pytest.raises(InputError, match="'drive' has prescribed motion; expected constraints at rest"):
            ask(state, [drive])


def test_velocity_constraints_of_time_count_too() -> None:
    """A v = b(t) takes a freedom of velocity, whatever b is."""
    robot = rbd.mechanism.four_bar(1, 3, 3, 4)
    turn = rbd.VelocityConstraint("turn", lambda q: np.array([[1.0, 0.0, 0.0]]), b=lambda t: np.array([2.0 + t]))
    found = rbd.mechanism.mobility(robot.at("assembled"), [turn])
    assert (found.instantaneous, found.driven, found.velocity_only) == (0, ("turn",), True)


# ------------------------------------------------------------------------------------------------------ the command


def test_the_command_turns_the_drives(tmp_path: Path) -> None:
    """Rates and torques over a turn: the piston's speed by the closed form, the torque's work over a turn zero."""
    b = slider_crank(rate=RATE)
    path = b.save(tmp_path / "engine.urdf")
    numbers = tmp_path / "x.json"
    run = CliRunner().invoke(app, ["mechanism", str(path), "--json", str(numbers), "--tries", "20"])
    assert run.exit_code == 0, run.output
    assert "Driven by motor, it has 0 degrees of freedom left." in run.output and "driven by motor:" in run.output
    assert (
        "with crank_joint at 0.00 deg" in run.output and "crank_joint: 30 to 30 rad/s" in run.output
    )  # the input is the driven
    data = json.loads(numbers.read_text())
    assert data["driven"]["driven"] == "motor" and data["driven"]["instantaneous"] == 0
    a, r, ell = np.linspace(0, 2 * np.pi, 361), 0.05, 0.2
    speed = -RATE * r * np.sin(a) * (1 + r * np.cos(a) / np.sqrt(ell**2 - (r * np.sin(a)) ** 2))
    assert np.abs(np.array(data["rates"]["piston_joint"]) - [speed.min(), speed.max()]).max() < 1e-9
    least, most, mean = data["efforts"]["motor"]
    assert np.abs(np.array(data["rates"]["crank_joint"]) - RATE).max() < 1e-12
    assert abs(mean) < 1e-3 * (most - least) and most > 0.0 > least
