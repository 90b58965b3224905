"""What messages propose is done here, as they say it."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.terminal import in_options
from rbd.errors import BadEvent, InputError, ModelError, RbdError, RbdWarning


def message(call: object, kind: type[Exception] = RbdError) -> str:
    """Of the error that a call raises."""
    with pytest.raises(kind) as error:
        call()  # type: ignore[operator]
    return str(error.value)


def test_the_joints_that_it_asks_to_fix_can_be_fixed() -> None:
    """A crank, a slider locked to its place, and a ball joint: its name is proposed, and not that of a velocity, 'ball.wx'."""
    builder = rbd.RobotBuilder("hand", root="fixed")
    for name in ("arm", "tool", "slider"):
        builder.body(name, rbd.robots.Box((0.1, 0.1, 0.1), mass=1.0))
    builder.joint("crank", "ground", "arm", "revolute", axis=(0, 1, 0))
    builder.joint("ball", "arm", "tool", "ball", at=(0.2, 0, 0))
    builder.joint("rail", "ground", "slider", "prismatic")
    state = builder.robot().at()
    lock = [rbd.JointLock("lock", "rail", position=0.0)]
    said = message(lambda: rbd.mechanism.trace(state, lock, joint="crank", values=[0.0, 0.1]), InputError)
    (joint,) = re.search(r"fixed=\{'(\w+)': \.\.\.", said).groups()  # type: ignore[union-attr]
    assert joint == "ball" and joint in state.robot.joints
    fixed = {joint: state.q[state.robot.joints[joint].q]}
    assert rbd.mechanism.trace(state, lock, joint="crank", values=[0.0, 0.1], fixed=fixed).q[-1, 0] == 0.1


def test_the_command_line_names_its_options(tmp_path: Path) -> None:
    """A motion without times: --rate, and not rate=; which it then takes."""
    q = np.zeros((20, 36))
    q[:] = rbd.load_robot("g1").standing().q
    np.savetxt(tmp_path / "still.csv", q, delimiter=",")
    command = ["check", str(tmp_path / "still.csv"), "--robot", "g1"]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code == 2 and "give --rate 30 [Hz]" in refused.output and "rate=" not in refused.output
    assert CliRunner().invoke(app, [*command, "--rate", "30"]).exit_code == 0


def test_every_option_that_the_command_line_names_is_one() -> None:
    """By the command's parser: an argument without a value, with one, and as the subject of a sentence."""
    parsers = get_command(app).commands  # type: ignore[attr-defined]
    named = 0
    for command in app.registered_commands:
        parser = parsers[command.name or command.callback.__name__]
        known = {option: each for each in parser.params for option in (*each.opts, *each.secondary_opts)}
        for argument in (each.name for each in parser.params if each.param_type_name == "option" and each.name != "help"):
            word = argument.rstrip("_")
            for said in (f"{word} is 3.", f"Give {word}= a path.", f"Say {word}=3, or less.", f"Try {word}=True of it."):
                (option,) = re.findall(r"--[\w-]+", in_options(said, command.callback))
                assert known[option].name == argument
                assert "=" not in in_options(said, command.callback) and "True" not in in_options(said, command.callback)
                named += 1
    assert named > 200


def test_a_flag_that_is_proposed_is_taken(tmp_path: Path) -> None:
    """--trust, and not --trust True, whose "True" would be another motion."""
    q = np.tile(rbd.load_robot("g1").standing().q, (20, 1))
    np.savez(tmp_path / "off.npz", t=np.arange(20) / 30.0, q=q, v=np.ones((20, 35)))
    command = ["check", str(tmp_path / "off.npz"), "--robot", "g1"]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code == 2 and "take them as they are: --trust." in " ".join(refused.output.split())
    assert CliRunner().invoke(app, [*command, "--trust"]).exit_code == 0


def test_info_does_not_refer_to_itself() -> None:
    """Remarks on a known file are one sentence, and its list is in the same report."""
    told = CliRunner().invoke(app, ["info", "talos"]).output
    assert "remarks on its file: 5 links have inertias that no body has" in told and "All are below." in told
    assert "`rbd info`" not in told and "rgbd_optical_frame" in told.split("All are below.")[1]


def test_two_robots_are_wanted_by_the_name_of_the_function() -> None:
    assert message(lambda: rbd.robots.merge_robots("g1", "solo12")).startswith("a robot of merge_robots is 'g1'")


def test_an_event_that_returns_none_says_so() -> None:
    """Not that it gave nan."""
    event = rbd.simulation.StateEvent(lambda state: None, "lift")
    start = rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1])
    said = message(lambda: rbd.simulate(start, duration=0.1, step=0.01, events=[event]))
    assert "event 'lift' gave None" in said and "nan" not in said


def test_a_controller_that_returns_none_says_so() -> None:
    """It forgot its `return`; the motion is not one without torques."""
    solo = rbd.load_robot("solo12")
    start, feet = solo.standing(), solo.feet(friction=0.7)
    said = message(lambda: rbd.simulate(start, feet, duration=0.002, step=0.001, controller=lambda state, t: None), InputError)
    assert "the controller gave None at t = 0 s" in said and "return" in said


def test_numbers_are_written_as_they_are_typed() -> None:
    """In errors and in warnings of all kinds: 0.06, not NumPy's word for it."""
    for given in (np.float64(-0.06), np.float32(-0.5), np.int64(-3)):
        said = message(lambda given=given: rbd.PointContact("foot", "FL_FOOT", friction=given))
        assert said.startswith(f"friction is {given}; ") and "np." not in said
    assert str(InputError("joint np.str_('knee') at np.float64(0.06), (np.int64(1), np.float64(nan))")) == (
        "joint 'knee' at 0.06, (1, nan)"
    )
    cut = f"x is {[np.float64(1 / 3)] * 9!r:.60}; expected np.str_('a(b)c') or {np.True_!r}, and numpy.arange(n)."
    assert str(InputError(cut)) == f"x is [{1 / 3}, 0.33333333333333; expected 'a(b)c' or True, and numpy.arange(n)."
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warnings.warn("off by np.float64(0.06)", RbdWarning, stacklevel=1)
    assert str(told[0].message) == "off by 0.06"


def test_damping_and_springs_are_made_alike() -> None:
    """A joint and its number; damping also of several joints. What a spring's message proposes works."""
    one, same = rbd.JointDamping("knee", damping=0.5), rbd.JointDamping({"knee": 0.5})
    assert one == same == rbd.JointDamping("knee", 0.5) == rbd.JointDamping(damping={"knee": 0.5})
    assert rbd.JointSpring("knee", stiffness=20.0).joint == "knee"
    said = message(lambda: rbd.JointSpring({"knee": 20.0}, stiffness=1.0))  # type: ignore[arg-type]
    springs = eval(re.search(r"\[.*\]", said)[0], {"JointSpring": rbd.JointSpring})  # type: ignore[index]
    assert springs == [rbd.JointSpring("knee", stiffness=20.0)]
    for wrong in (lambda: rbd.JointDamping("knee"), lambda: rbd.JointDamping({"knee": 0.5}, 0.3), lambda: rbd.JointDamping()):
        message(wrong, InputError)


def test_no_torques_are_zero_in_every_verb() -> None:
    """`tau=None` is zero torques wherever torques are given."""
    solo = rbd.load_robot("solo12")
    state, feet, zero = solo.standing(), solo.feet(friction=0.7), np.zeros(12)
    assert np.array_equal(rbd.solve(state, None, feet).a, rbd.solve(state, zero, feet).a)
    assert np.array_equal(rbd.gauss_problem(state, None, feet).rhs, rbd.gauss_problem(state, zero, feet).rhs)
    many = [rbd.solve_many(solo, state.q, None, tau, feet).a for tau in (None, zero)]
    assert np.array_equal(*many)
    assert np.array_equal(solo.torque_use(None), solo.torque_use(zero))
    assert np.array_equal(rbd.dynamics.free_acceleration(state, None), rbd.dynamics.free_acceleration(state, zero))


@pytest.mark.parametrize("name", ["world", "World", "universe"])
def test_the_world_of_the_builder_is_explained(name: str) -> None:
    """It is called ground there."""
    builder = rbd.RobotBuilder("arm", root="fixed")
    builder.body("link", rbd.robots.Box((0.1, 0.1, 0.1), mass=1.0))
    builder.joint("hinge", name, "link")
    assert f"is {name!r}; what is fixed is called 'ground'" in message(builder.robot, ModelError)
    builder = rbd.RobotBuilder("arm", root="fixed")
    builder.body("link", rbd.robots.Box((0.1, 0.1, 0.1), mass=1.0))
    builder.joint("hinge", "ground", "link")
    assert builder.robot().nv == 1


def test_events_that_give_no_number_are_bad_events() -> None:
    event = rbd.simulation.StateEvent(lambda state: "high", "lift")
    start = rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1])
    assert issubclass(BadEvent, RbdError)
    assert "event 'lift' gave 'high'" in message(lambda: rbd.simulate(start, duration=0.1, step=0.01, events=[event]))
