"""`rbd simulate`: what it simulates by itself, what it prints and writes, and how it refuses."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.simulate_report import SimulateReport, loaded, pushes, setup
from rbd.errors import SimulationStopped

runner = CliRunner()


def run(*arguments: str) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = runner.invoke(app, ["simulate", *arguments])
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


def test_a_pushed_robot_is_told_from_push_to_certificate(tmp_path):
    """Solo12 holds its posture on its feet against two pushes; the tables, and the same numbers in the files."""
    code, out, _ = run(
        "solo12", "--duration", "0.2", "--push", "2,0,0", "--push", "-2,1,0", "--at", "base_link", "--from", "0.05",
        "--from", "0.1", "--for", "0.05", "--feet-only", "--json", str(tmp_path / "out.json"),
        "--save", str(tmp_path / "out.npz"),
    )  # fmt: skip
    assert code == 0
    for word in ("on front_left, front_right, hind_left, hind_right, holding its posture",
                 "(2, 0, 0) N at base_link from 0.05 to 0.1 s", "(-2, 1, 0) N at base_link from 0.1 to 0.15 s",
                 "0 to 0.2 s by steps of 1 ms, 201 samples", "it stands on front_left", "sticks", "energy", "penetration",
                 "m or rad", "only its feet touch the ground", "trajectory:"):  # fmt: skip
        assert word in out, word
    data = json.loads((tmp_path / "out.json").read_text())
    trajectory = rbd.Trajectory.load(tmp_path / "out.npz")
    assert data["steps"] == 200 and len(trajectory) == 201
    second = {"frame": "base_link", "force": [-2.0, 1.0, 0.0], "start": 0.1, "duration": 0.05}
    assert {name: data["pushes"][1][name] for name in second} == second
    end = data["motion"]
    assert np.array_equal(list(end["final_q"].values()), trajectory.q[-1])
    assert np.array_equal(list(end["final_v"].values()), trajectory.v[-1])
    assert end["energy_change"] == trajectory.energy[-1] - trajectory.energy[0]
    assert end["motor_work"] == trajectory.motor_work[-1] != 0.0 and "work of the motors" in out
    assert all(c["mode"] == "sticks" for c in data["constraints"].values())
    for c in data["constraints"].values():
        assert c["largest"] >= 0.999 * np.linalg.norm(c["force"]) and 0.0 <= c["largest_at"] <= data["motion"]["duration"]
    assert data["residuals_at"].keys() == data["residuals"].keys() and data["largest_kinetic"] >= 0.0 == data["elastic"]
    weight = sum(c["force"][2] for c in data["constraints"].values())
    assert weight == pytest.approx(trajectory.robot.mass * 9.81, rel=0.05)


def test_a_robot_that_sinks_through_the_floor_of_its_feet_ends_the_run():
    """With the report until then, the reason, and exit code 1; with all shapes it lands on the floor."""
    code, out, err = run("solo12", "--free", "--feet-only", "--duration", "0.4")
    assert code == 1 and "solo12 sinks through the floor: bodies with" in err
    assert "stopped at t = 0.2" in out and "the run stops where it falls through it" in out
    code, out, err = run("solo12", "--free", "--duration", "0.25")
    assert code == 0 and "sinks" not in err and "it has fallen" in out


def test_a_mechanism_swings_with_its_loop_closed(tmp_path):
    """The four-bar of the repository, assembled, without torque: energy stays, and the loop is closed to rounding."""
    code, out, _ = run("urdf/four_bar.urdf", "--duration", "0.1", "--json", str(tmp_path / "out.json"))
    assert code == 0
    for word in ("on coupler_pin, motors without torque", "RungeKutta4", "crank_joint", "rad/s", "drift", "holds"):
        assert word in out, word
    assert "it stands" not in out  # it has no feet
    data = json.loads((tmp_path / "out.json").read_text())
    assert abs(data["motion"]["energy_change"]) < 1e-8 and data["residuals"]["drift"] < 1e-10
    assert data["largest_kinetic"] > 1e-3  # it does move
    assert data["motion"]["motor_work"] == 0.0


@pytest.mark.parametrize(("option", "moves"), [("--hold", False), ("--free", True)])
def test_an_arm_is_bolted_down_and_held_or_let_go(tmp_path, option, moves):
    """UR5 in its neutral posture: held it stays, free it swings without loss."""
    code, out, _ = run("ur5", option, "--duration", "0.05", "--json", str(tmp_path / "out.json"))
    assert code == 0 and ("fixed, holding its posture" in out) is not moves
    data = json.loads((tmp_path / "out.json").read_text())
    assert (max(map(abs, data["motion"]["final_v"].values())) > 0.1) is moves
    assert abs(data["motion"]["energy_change"]) < 1e-7


def test_the_pictures_are_written(tmp_path):
    """--html is one page, --plot one picture, of a motion with a contact and of one without."""
    for robot, name in (("solo12", "stand"), ("ur5", "arm")):
        page, plot = tmp_path / f"{name}.html", tmp_path / f"{name}.png"
        code, out, _ = run(robot, "--duration", "0.02", "--html", str(page), "--plot", str(plot))
        assert code == 0 and "picture:" in out and "plot:" in out
        assert robot in page.read_text()[:2000] or robot in page.read_text()
        assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["talso"], ["'talso'", "'talos'"]),
        (["solo12", "--duration", "-1"], ["duration", "-1"]),
        (["solo12", "--step", "0"], ["step", "0.0"]),
        (["solo12", "--duration", "nan"], ["duration", "nan"]),
        (["solo12", "--friction", "-1"], ["friction", "-1"]),
        (["solo12", "--law", "newton"], ["'newton'", "coulomb"]),
        (["solo12", "--posture", "siting"], ["'siting'", "standing"]),
        (["solo12", "--root", "welded"], ["welded", "free_flyer"]),
        (["solo12", "--push", "0,1,0"], ["--at"]),
        (["solo12", "--at", "base_link"], ["--push"]),
        (["solo12", "--from", "1"], ["--push"]),
        (["solo12", "--push", "0,one,0", "--at", "base_link"], ["0,one,0", "newtons"]),
        (["solo12", "--push", "0,1", "--at", "base_link"], ["three numbers"]),
        (["solo12", "--push", "0,1,0", "--at", "base_lnk"], ["'base_link'"]),
        (["solo12", "--push", "0,1,0", "--at", "base_link", "--for", "0"], ["duration"]),
        (["solo12", "--push", "0,1,0", "--at", "base_link", "--from", "0", "--from", "1"], ["--from came 2 times with 1"]),
        (["solo12", "--html", "nowhere/out.html"], ["nowhere"]),
        (["solo12", "--json", "nowhere/out.json"], ["nowhere"]),
        (["solo12", "--save", "out.txt"], [".npz"]),
        (["solo12", "--plot", "out.txt"], [".png"]),
        (["solo12", "--pull", "0,1,0"], ["--pull"]),
    ],
)
def test_bad_input_ends_with_code_2_before_anything_is_computed(arguments, words):
    """What came, or what to try, is in the message; nothing is printed as if it were an answer."""
    code, out, complaint = run(*arguments)
    assert code == 2 and "steps/s" not in out
    for word in words:
        assert word in complaint + out


def test_a_posture_that_cannot_be_held_ends_with_code_1(monkeypatch):
    """Motors of a tenth of their strength cannot hold Talos: `hold` says so, and nothing is simulated."""

    def weak(name, **options):
        robot = rbd.load_robot(name, **options)
        robot.effort_limit = 0.1 * robot.effort_limit
        return robot

    monkeypatch.setattr("rbd.cli.simulate_report.load_robot", weak)
    code, out, complaint = run("talos")
    assert code == 1 and "torque limit prevents it" in complaint and "steps/s" not in out


@pytest.fixture
def computed(monkeypatch):
    """Lets a test change what `rbd.simulate` does inside the command."""
    original = rbd.simulation.run.simulate

    def change(make) -> None:
        monkeypatch.setattr("rbd.simulation.run.simulate", lambda *a, **k: make(original(*a, **k)))

    return change


def test_a_step_without_a_solution_is_told_with_all_that_was_computed(computed, tmp_path):
    """Code 1, the reason at the end, the tables and files till there."""

    def stop(trajectory):
        raise SimulationStopped(
            "the step after t = 0.02 s has no solution", state=trajectory.state(-1), t=0.02, names=("front_left",),
            trajectory=trajectory, cause=ValueError(),
        )  # fmt: skip

    computed(stop)
    code, out, complaint = run("solo12", "--duration", "0.02", "--json", str(tmp_path / "out.json"))
    assert code == 1 and "0 to 0.02 s by steps of 1 ms" in out and "has no solution" in complaint
    assert json.loads((tmp_path / "out.json").read_text())["steps"] == 20


def test_after_ctrl_c_what_there_is_is_told(monkeypatch):
    """A controller that presses Ctrl-C at 10 ms: the tables say so, and the exit code is 130."""
    original = rbd.simulation.run.simulate

    def interrupted(*args, **settings):
        held = settings["controller"]

        def controller(state, t):
            if t > 0.01:
                raise KeyboardInterrupt
            return held(state, t)

        return original(*args, **{**settings, "controller": controller})

    monkeypatch.setattr("rbd.simulation.run.simulate", interrupted)
    code, out, _ = run("solo12", "--duration", "1")
    assert code == 130 and "interrupted at t = 0.01" in out


def test_what_is_set_up_by_itself():
    """Feet are frictional and held, all other shapes may fall on the ground; a mechanism swings; a floating arm falls free."""
    solo = setup(loaded("solo12"), friction=0.4)
    assert [c.friction for c in solo.constraints] == [0.4] * 5 and solo.controller is not None
    assert isinstance(solo.constraints[-1], rbd.CollisionContacts)
    assert len(setup(loaded("solo12"), bodies=False).constraints) == 4
    assert setup(loaded("solo12"), hold=False).controller is None
    assert setup(loaded("urdf/four_bar.urdf")).controller is None
    assert loaded("ur5").root == "fixed" and loaded("ur5", root="free_flyer").root == "free_flyer"
    floating = setup(loaded("ur5", root="free_flyer"))
    assert floating.controller is None and "touches nothing" in floating.limits[0]
    box = setup(loaded("urdf/box.urdf"))
    assert not box.constraints and box.summary == "free, without motors"


def test_a_fall_is_called_a_fall(tmp_path):
    """Solo12 without torque collapses; the verdict says how high its centre of mass still is."""
    code, out, _ = run("solo12", "--free", "--duration", "0.25", "--step", "2e-3", "--json", str(tmp_path / "out.json"))
    assert code == 0 and "it has fallen" in out
    assert json.loads((tmp_path / "out.json").read_text())["verdict"].startswith("it has fallen")


def test_options_of_several_pushes_go_together():
    """One of each a push, or one for all; defaults from 0 s, for 0.1 s."""
    one, two = pushes(["0,1,0", "2,0,0"], ["a"], [0.5, 1.0], [])
    assert (one.frame, two.frame, one.start, two.start, one.duration) == ("a", "a", 0.5, 1.0, 0.1)
    assert pushes([], [], [], []) == ()


def test_bodies_are_laid_on_the_ground_and_joints_stop_where_they_are_told_to():
    """--bodies: a box without feet starts on the ground and stays; --stops: each joint that has a limit gets one."""
    box = setup(loaded("urdf/box.urdf"), bodies=True)
    assert box.state.com[2] == pytest.approx(0.1, abs=1e-9)  # half its height
    trajectory = rbd.simulate(box.state, box.constraints, duration=0.02, step=2e-3, progress=False)
    assert np.abs(trajectory.com[-1] - trajectory.com[0]).max() < 1e-9
    assert "through it" not in " ".join(setup(loaded("solo12"), bodies=True).limits)
    arm = setup(loaded("ur5"), stops=True)
    assert len(arm.constraints) == 6 and "stop at their limits" not in " ".join(arm.limits)


def test_a_motor_without_a_limit_is_told_with_its_torque(tmp_path):
    """A ball of 4.19 kg held 0.3 m beside its hinge: m g l, at no share of any limit."""
    ball = '<body name="b"><joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>'
    motor = '<actuator><motor joint="j"/></actuator>'
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody>{motor}</mujoco>")
    code, out, _ = run(str(tmp_path / "arm.xml"), "--duration", "0.01")
    torque = 1000.0 * 4.0 / 3.0 * np.pi * 0.1**3 * 9.81 * 0.3
    assert code == 0 and f"j: {-torque:.3f} N m, at" in out and "of its limit" not in out


def test_the_verdict_says_which_feet_are_on_the_ground(tmp_path):
    """Thrown upwards none is; of what stands, those that carry are named, and what slips is said to."""
    given = setup(loaded("solo12"), bodies=False)
    v = np.zeros(given.state.robot.nv)
    v[2] = 1.0
    thrown = rbd.simulate(given.state.with_velocity(v), given.constraints, duration=0.02, step=2e-3, progress=False)
    assert SimulateReport(thrown, given, (), {}).verdict == "it is in the air"
    still = rbd.simulate(given.state, given.constraints, duration=0.02, step=2e-3, controller=given.controller, progress=False)
    told = SimulateReport(still, given, (), {}).verdict
    assert told.startswith("it stands on ") and told.endswith("at rest") and "alone" not in told
    first, *others = given.feet
    modes = {name: np.array(["open"] * len(still.t)) if name == first else still.modes[name] for name in given.feet}
    told = SimulateReport(replace(still, modes=modes), given, (), {}).verdict
    assert told.startswith(f"it is on {', '.join(others)} alone, its centre of mass ")


@pytest.mark.parametrize("height", [5.0, 20.0, -30.0])
def test_a_body_is_laid_on_the_ground_from_any_height(tmp_path, height):
    """Also from where a file draws it far away, and beside a floor of the file's own, which stays where it is."""
    ball = f'<body name="b" pos="0 0 {height}"><freejoint/><geom size=".1"/></body>'
    (tmp_path / "ball.xml").write_text(f'<mujoco><worldbody><geom type="plane" size="1 1 1"/>{ball}</worldbody></mujoco>')
    given = setup(loaded(str(tmp_path / "ball.xml")), bodies=True)
    assert given.state.com == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)


def test_what_is_farther_away_than_the_ground_is_looked_for_stays_there(tmp_path):
    """A keyframe at 100 km, of a ball 1 m above its own origin."""
    ball = '<body name="b"><freejoint/><geom size=".1" pos="0 0 1"/></body>'
    key = '<keyframe><key name="far" qpos="0 0 1e5 1 0 0 0"/></keyframe>'
    (tmp_path / "ball.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody>{key}</mujoco>")
    assert setup(loaded(str(tmp_path / "ball.xml")), posture="far", bodies=True).state.com[2] == 1e5 + 1.0


def test_an_arm_touches_with_what_moves():
    """Its base, bolted to the ground, is no contact."""
    arm = setup(loaded("ur5"), bodies=True)
    (contacts,) = arm.constraints
    assert "base_link_0" not in contacts.ground and "wrist_3_link_0" in contacts.ground and len(contacts.ground) == 7
