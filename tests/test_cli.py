from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.robot_reports import StandReport

runner = CliRunner()


def run(*arguments: str) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = runner.invoke(app, list(arguments))
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


def test_talos_stands_and_the_table_says_what_its_feet_carry():
    """Each foot's force, friction and centre of pressure; torques; the fall without contacts; residuals."""
    code, out, _ = run("stand", "talos")
    assert code == 0
    for word in ("left_sole", "right_sole", "friction used", "centre of pressure", "885.57", "arm_left_4_joint",
                 "|a - a_free|_M^2", "without contacts", "-9.810", "centroidal", "by closed form, law: coulomb"):  # fmt: skip
        assert word in out, word
    assert re.search(r"Gauss's QP in ProxSuite gives the same: a differs by \S+e-1\d m/s2 at most, f .* by \S+e-1\d N\n", out)


def test_the_file_of_numbers_agrees_with_the_library(tmp_path):
    """--json holds what `hold` and `solve` return for the same question."""
    code, _, _ = run("stand", "talos", "--push", "0,80,0", "--at", "torso_2_link", "--json", str(tmp_path / "out.json"))
    assert code == 0
    data = json.loads((tmp_path / "out.json").read_text())
    robot = rbd.load_robot("talos")
    state, feet = robot.standing(), robot.feet(0.7)
    tau = rbd.hold(state, feet).tau
    solution = rbd.solve(state, tau, feet, external=[rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))])
    found = data["solution"]
    assert (found["status"], found["law"], found["method"]) == ("solved", "coulomb", "closed form")
    assert (data["solver"], data["rows"], data["rank"]) == (solution.solver, 12, 12)
    assert data["effort_limit"] == dict(zip(robot.actuated_names, robot.effort_limit.tolist(), strict=True))
    assert all(0.0 <= found["residual_sizes"][name] < 1e-9 for name in solution.residuals.scaled)
    # rounding differs with the arrays' places in memory
    assert np.abs(np.array(list(found["a"].values())) - solution.a).max() < 1e-9
    assert np.abs(np.array(list(data["held"]["tau"].values())) - tau).max() < 1e-9
    for name, force in solution.forces.items():
        assert np.abs(np.array(found["forces"][name]) - force).max() < 1e-7
        assert data["contacts"][name]["force"] == found["forces"][name][:3]
    fall = np.array(data["com_acceleration_free"])
    assert np.abs(fall - [0.0, 80.0 / robot.mass, -9.81]).max() < 1e-9  # Newton: only weight and push
    assert len(found["residuals"]) == 5 and all(r <= 1e-9 for r in found["residuals"].values())


def test_the_law_is_chosen_by_its_word(tmp_path):
    """On ice, pushed: Coulomb's law keeps on the ground what the convex law lifts. Another word is bad input, said at once."""
    normal = {}
    for law in ("coulomb", "convex"):
        code, out, _ = run("stand", "g1", "--push", "0,90,0", "--at", "torso_link", "--friction", "0.02", "--law", law,
                           "--json", str(tmp_path / f"{law}.json"))  # fmt: skip
        assert code == 1 and f"law: {law}" in out  # no torques withstand it
        data = json.loads((tmp_path / f"{law}.json").read_text())
        assert data["solution"]["law"] == law and data["solution"]["status"] == "solved"
        normal[law] = sum(c["normal"] for c in data["contacts"].values())
        # A point slips: Coulomb's law is no minimum, and Gauss's QP confirms the convex law's answer.
        assert ("a point slips; under --law convex Gauss's QP" in out) is (law == "coulomb") and "gives the same" in out
        assert data["confirmed"]["law"] == "convex" and max(data["confirmed"]["a"], data["confirmed"]["f"]) < 1e-7
    assert normal["convex"] != pytest.approx(normal["coulomb"], rel=1e-6)
    for verb in ("stand", "simulate"):
        code, _, err = run(verb, "g1", "--law", "hooke")
        assert code == 2 and "expected 'coulomb' or 'convex'" in " ".join(err.split())


def test_the_page_is_written(tmp_path):
    """--html writes one file with the robot's name in it."""
    code, out, _ = run("stand", "bolt", "--html", str(tmp_path / "bolt.html"))
    assert code == 0 and "picture:" in out
    assert "bolt" in (tmp_path / "bolt.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["talso"], ["'talso'", "'talos'"]),
        (["nowhere/robot.urdf"], ["nowhere/robot.urdf"]),
        (["talos", "--friction", "-1"], ["friction", "-1"]),
        (["talos", "--friction", "nan"], ["friction", "nan"]),
        (["talos", "--at", "torso_2_link"], ["--push"]),
        (["talos", "--braced"], ["--braced", "--push"]),
        (["talos", "--push", "0,eighty,0", "--at", "torso_2_link"], ["0,eighty,0", "newtons"]),
        (["talos", "--push", "0,inf,0", "--at", "torso_2_link"], ["finite"]),
        (["talos", "--push", "0,80", "--at", "torso_2_link"], ["three numbers"]),
        (["talos", "--push", "0,80,0", "--at", "torso_2_lnk"], ["'torso_2_link'"]),
        (["talos", "--posture", "siting"], ["half_sitting"]),
        (["panda"], ["no feet are known"]),
        (["talos", "--json", "nowhere/out.json"], ["nowhere/out.json"]),
        (["talos", "--html", "nowhere/out.html"], ["nowhere"]),
        (["talos", "--pull", "0,1,0"], ["--pull"]),
    ],
)
def test_bad_input_ends_with_code_2_and_says_what_was_wrong(arguments, words):
    """What came, or what to try, is in the message; nothing is printed as if it were an answer."""
    code, out, complaint = run("stand", *arguments)
    assert code == 2
    for word in words:
        assert word in complaint + out


def test_a_pose_that_cannot_be_held_ends_with_code_1(monkeypatch):
    """Motors of a tenth of their strength cannot hold Talos: no solution, and the motor in the way is named."""
    strong = rbd.load_robot

    def weak(name, **options):
        robot = strong(name, **options)
        robot.effort_limit = 0.1 * robot.effort_limit
        return robot

    monkeypatch.setattr("rbd.robots.loading.load_robot", weak)
    code, out, complaint = run("stand", "talos")
    assert code == 1
    assert "cannot be held" in complaint and "_joint'" in complaint and "torque limit" in complaint
    assert "left_sole" not in out


def pushed(*arguments: str) -> tuple[int, list[str], str]:
    """(exit code, lines, complaints) of Talos pushed at its torso."""
    code, out, complaint = run("stand", "talos", "--at", "torso_2_link", *arguments)
    return code, out.splitlines(), " ".join(complaint.split())


def test_the_first_lines_of_a_push_say_whether_motors_could_withstand_it(tmp_path):
    """Talos tips at 118.262 N: below, the torques of the unpushed pose are told beside those that withstand it."""
    file = tmp_path / "out.json"
    code, lines, _ = pushed("--push", "0,118,0", "--json", str(file))
    assert code == 0 and lines[0].startswith("Motors can withstand the push: the largest torque is 42.3 % of its limit")
    assert any("the torques of the unpushed pose" in line and "1.37" in line for line in lines[1:5])
    data = json.loads(file.read_text())
    assert data["withstood"]["possible"] is True and data["braced"] is False
    assert max(data["withstood"]["used_torque"].values()) == pytest.approx(0.423, abs=5e-4)
    robot = rbd.load_robot("talos")
    push = rbd.ExternalForce("torso_2_link", (0.0, 118.0, 0.0))
    against = rbd.hold(robot.standing(), robot.feet(0.7), external=push)
    assert np.abs(np.array(list(data["withstood"]["tau"].values())) - against.tau).max() < 1e-9
    assert np.abs(np.array(list(data["held"]["tau"].values())) - against.tau).max() > 10.0
    total = sum(np.array(force[:3]) for force in data["withstood"]["forces"].values())
    assert np.abs(total - [0.0, -118.0, robot.mass * 9.81]).max() < 1e-9  # statics
    used = data["withstood"]["friction_used"]
    assert used == pytest.approx({name: 1.0 - left for name, left in against.margins.friction.items()}, abs=1e-9)
    assert "right_sole uses 95.0 % of its friction" in " ".join(" ".join(lines).split())


def test_a_push_without_a_frame_acts_on_the_heaviest_link():
    """Of Talos the torso, 17.6 kg: the same lines as with --at torso_2_link."""
    code, out, _ = run("stand", "talos", "--push", "0,130,0")
    _, lines, _ = pushed("--push", "0,130,0")
    assert code == 1 and out.splitlines()[:2] == lines[:2] and "torso_2_link" in out


def test_a_push_that_no_torques_withstand_names_the_limits_and_still_shows_what_happens(tmp_path):
    """At 119 N it tips over the edges of its soles: no friction and no motor is named. Upwards, its feet lift."""
    file = tmp_path / "out.json"
    code, lines, _ = pushed("--push", "0,119,0", "--json", str(file))
    text = " ".join(" ".join(lines).split())
    assert code == 1 and lines[0] == "No motor torques withstand the push: it tips."
    assert "Together these limits prevent it: the edge of 'left_sole'; the edge of 'right_sole'; the base" in text
    assert (
        "The base misses (0, -" in text and "Below, under the torques of the unpushed pose" in text and "friction used" in text
    )
    data = json.loads(file.read_text())
    assert data["withstood"]["possible"] is False
    assert [limit["kind"] for limit in data["withstood"]["limits"]] == ["edge", "edge", "base"]
    assert (data["withstood"]["reason"], data["withstood"]["reason_code"]) == ("cannot_hold: support", 43)
    (wrench,) = data["withstood"]["missing"]["wrenches"].values()
    force, moment = np.array(wrench[:3]), np.array(wrench[3:])
    assert force[1] < 0.0 < moment[0]  # help against the push, and against its moment
    _, lines, _ = pushed("--push", "0,0,2000")
    assert lines[0] == "No motor torques withstand the push: left_sole and right_sole would have to pull."
    _, lines, _ = pushed("--push", "0,89,0", "--friction", "0.1")
    assert "its feet slip" in lines[0]
    _, lines, _ = pushed("--push", "0,88.5,0", "--friction", "0.1")
    assert "only with friction up to its limit" in " ".join(" ".join(lines[:3]).split())


def test_braced_motors_withstand_the_push_or_there_is_no_answer(tmp_path):
    """--braced: nothing moves, and both feet together carry weight and push; beyond 118.262 N there is no solution."""
    file = tmp_path / "out.json"
    code, lines, _ = pushed("--push", "0,80,0", "--braced", "--json", str(file))
    assert code == 0 and any("under those torques" in line and "(0.000, 0.000, 0.000) m/s2" in line for line in lines[2:5])
    data = json.loads(file.read_text())
    assert data["braced"] is True and data["held"]["tau"] == data["withstood"]["tau"]
    assert np.abs(list(data["solution"]["a"].values())).max() < 1e-8 and data["contacts"]["right_sole"]["normal"] < 200.0
    code, lines, complaint = pushed("--push", "0,119,0", "--braced")
    assert code == 1 and "no solution: talos cannot be held" in complaint and "edge of 'left_sole'" in complaint
    assert not any("friction used" in line for line in lines)


def test_a_push_to_the_left_may_start_with_a_minus():
    """A negative first component is a number, not an option."""
    code, out, _ = run("stand", "talos", "--push", "-20,0,0", "--at", "torso_2_link")
    assert code == 0 and "pushed with (-20.0, 0.0, 0.0) N" in out


def test_the_module_runs_as_a_command():
    """`python -m rbd` is the same program; a bare call shows the help."""
    found = subprocess.run([sys.executable, "-m", "rbd", "stand", "--help"], capture_output=True, text=True, timeout=120)
    assert found.returncode == 0
    assert "--push" in found.stdout and "--json" in found.stdout


def test_the_robots_are_listed_with_whether_they_stand():
    """Every robot file once: degrees of freedom, mass, postures, feet; README and the page say how many stand, and which."""
    code, out, _ = run("robots")
    assert code == 0
    lines = {words[0]: words for line in out.splitlines() if (words := line.split())}
    stand = [name for name, words in lines.items() if words[-1] == "yes"]
    root = Path(__file__).parents[1]
    assert f"\n{len(stand)} robots stand without further files" in (root / "README.md").read_text(encoding="utf-8")
    page = (root / "docs" / "reference" / "robots.md").read_text(encoding="utf-8")
    listed = re.search(r"These (\d+) robots have feet and a posture.*?: (.*?)\. Any other", page, re.S)
    assert int(listed[1]) == len(stand) and sorted(re.findall(r"`(\w+)`", listed[2])) == sorted(stand)
    assert lines["talos"][1:3] == ["38", "90.272"]
    assert "panda" in lines and "xarm7" in lines and "ur5" in lines


def test_info_tells_joints_frames_motors_and_findings():
    """What a user must know before naming a joint or a frame, and what the doctor found."""
    code, out, _ = run("info", "talos")
    assert code == 0
    for word in ("leg_left_4_joint", "left_sole_link", "90.272 kg", "32 motors", "half_sitting", "effort limit", "300",
                 "0 errors", "wrist_right_ft_link"):  # fmt: skip
        assert word in out, word
    assert "RBD_COMPILED" not in out
    code, _, complaint = run("info", "talos", "--root", "welded")
    assert code == 2 and "free_flyer" in complaint


def test_info_says_none_where_the_builder_was_given_no_limits(tmp_path):
    """Its files state 1e4 rad, 1e3 m and speeds of zero there, as a URDF must state something."""
    b = rbd.RobotBuilder("pair", root="fixed")
    b.body("turns", rbd.robots.Rod((0, 0, 0), (1, 0, 0), mass=1.0))
    b.body("slides", rbd.robots.Rod((0, 0, 0), (1, 0, 0), mass=1.0))
    b.body("limited", rbd.robots.Rod((0, 0, 0), (1, 0, 0), mass=1.0))
    b.joint("turn", "ground", "turns", motor=True, effort=5.0)
    b.joint("slide", "turns", "slides", "prismatic")
    b.joint("limit", "slides", "limited", limits=(-1.0, 2.0), speed=3.0)
    code, out, complaint = run("info", str(b.save(tmp_path / "pair.urdf")))
    rows = {words[0]: words[3:] for line in out.splitlines() if len(words := line.split()) > 3}
    assert code == 0, complaint
    assert rows["turn"] == ["none", "none", "none", "5"]
    assert rows["slide"] == ["none", "none", "none", "no", "motor"] and rows["limit"] == ["-1", "2", "3", "no", "motor"]


def test_a_report_of_a_bolted_arm_has_no_motion_of_its_mass_to_compare(tmp_path):
    """The ground takes what it needs: no number is told for it. A motor without a limit has none, and no share of it."""
    ball = '<body name="b"><joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>'
    motor = '<actuator><motor joint="j"/></actuator>'
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody>{motor}</mujoco>")
    state = rbd.load_robot(tmp_path / "arm.xml").at()
    held = rbd.hold(state, [])
    report = StandReport(held, rbd.solve(state, held.tau, []), None, None, {})
    assert np.isnan(report.com_acceleration).all()
    console = Console(file=io.StringIO(), width=120)
    console.print(report)
    (line,) = [line.split() for line in console.file.getvalue().splitlines() if line.split()[:1] == ["j"]]
    assert line[1:] == [f"{-1000.0 * 4.0 / 3.0 * np.pi * 0.1**3 * 9.81 * 0.3:.3f}", "none", "-"]
