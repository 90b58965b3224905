"""One enumeration of reasons: every error, answer, state, frame and early end has one, and its number never changes."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd import errors, testing
from rbd.answers.many import StateStatus
from rbd.errors import InputError, RbdError, Reason
from rbd.motion import CAUSES
from rbd.problem import Status
from rbd.statics import Effort

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "reasons.md"
FROZEN = {
    0: "",
    10: "bad_input",
    11: "unknown_name",
    12: "duplicate_name",
    13: "model_error",
    14: "wrong_pinocchio",
    15: "unknown_name: robot",
    16: "unknown_name: frame",
    17: "unknown_name: joint",
    18: "bad_input: event",
    20: "contact_moves",
    21: "contact_moves: impact",
    22: "contact_moves: slides",
    23: "contact_moves: held",
    24: "not_at_rest",
    25: "unsupported",
    26: "singular_inertia",
    27: "not_differentiable",
    28: "not_enclosed",
    30: "no_solution",
    31: "no_solution: contradiction",
    32: "cannot_assemble",
    33: "cannot_reach",
    34: "cannot_reach: proved",
    35: "singular_pose",
    36: "no_steady_state",
    37: "cannot_plan",
    40: "cannot_hold",
    41: "cannot_hold: friction",
    42: "cannot_hold: motor",
    43: "cannot_hold: support",
    44: "cannot_hold: passive joint",
    45: "cannot_hold: no contact",
    46: "cannot_hold: undecided",
    47: "cannot_hold: friction margin",
    48: "cannot_hold: friction and motor",
    49: "cannot_hold: request",
    50: "cannot_move",
    51: "cannot_move: friction",
    52: "cannot_move: motor",
    53: "cannot_move: support",
    54: "cannot_move: passive joint",
    55: "cannot_move: no contact",
    56: "cannot_move: undecided",
    57: "cannot_move: friction margin",
    58: "cannot_move: request",
    59: "cannot_move: contact motion",
    60: "simulation_stopped",
    61: "simulation_stopped: sinks",
    62: "simulation_stopped: no solution",
    63: "simulation_stopped: bad input",
    64: "simulation_stopped: other error",
    65: "interrupted",
    66: "simulation_stopped: event",
    67: "event",
    68: "simulation_stopped: no event",
    70: "not_possible",
    71: "not_possible: floats",
    72: "not_possible: sinks",
    73: "not_possible: slides",
    74: "not_possible: friction",
    75: "not_possible: tips",
    76: "not_possible: motor",
    77: "not_possible: joint limit",
    78: "not_possible: speed limit",
    79: "not_possible: torque-speed",
    80: "not_possible: jump",
    81: "not_possible: self-collision",
    82: "not_possible: tilted sole",
    83: "not_possible: hovering foot",
    84: "not_possible: grasp",
    85: "picture_error",
    86: "contract_broken",
    87: "contract_broken: constraint",
    88: "contract_broken: solver",
    89: "contract_broken: task",
    90: "other_error",
    91: "study_stopped",
    99: "not_run",
}
"""Codes of stored datasets: a new reason takes a new one, and none is changed or used again."""
ERRORS = [
    kind
    for room in (errors, testing.solver_check)
    for _, kind in inspect.getmembers(room, inspect.isclass)
    if kind.__module__ == room.__name__ and issubclass(kind, RbdError)
]
ORIGIN = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def test_a_code_stands_for_one_reason_for_ever() -> None:
    """The table of codes is the one that was written down; codes are those that an int16 and two digits hold."""
    assert {reason.code: str(reason) for reason in Reason} == FROZEN
    assert len(Reason.__members__) == len(FROZEN) and list(FROZEN) == sorted(FROZEN)
    for reason in Reason:
        assert Reason.of_code(np.int16(reason.code)) is reason
        assert reason.meaning.endswith(".") and reason.kind.kind is reason.kind
        assert str(reason) == (f"{reason.kind}: {reason.detail}" if reason.detail else reason.kind)


def test_reasons_survive_pickling_and_copies() -> None:
    """The same object again, and not another one of the same text."""
    for reason in Reason:
        assert pickle.loads(pickle.dumps(reason)) is reason and copy.deepcopy(reason) is reason


def test_every_error_has_a_reason_of_its_own() -> None:
    """No two classes of errors share one; only the root has that of errors in general."""
    assert {kind for kind in ERRORS if kind.reason is Reason.OTHER_ERROR} == {RbdError}
    assert len({kind.reason for kind in ERRORS}) == len(ERRORS)
    for kind in ERRORS:
        assert "reason" in vars(kind)
        assert not kind.reason.detail or kind.__bases__[0].reason is kind.reason.kind


def test_every_cause_of_a_motion_has_a_reason() -> None:
    """As many as there are causes, in their order."""
    details = [reason.detail for reason in Reason if reason.kind is Reason.NOT_POSSIBLE and reason.detail]
    assert details == list(CAUSES)
    assert [Reason.of_cause(cause).detail for cause in CAUSES] == details


def test_every_status_has_a_reason() -> None:
    """Answered ones none; of the others each has its own, which leads back to it."""
    lost = [status for status in StateStatus if status > StateStatus.INACCURATE]
    assert len({status.reason for status in lost}) == len(lost)
    assert all(StateStatus.of_reason(status.reason) is status for status in lost)
    assert StateStatus.SOLVED.reason is StateStatus.INACCURATE.reason is Reason.NONE
    for status in Status:
        assert status.reason is StateStatus.of_answer(status).reason


def test_what_refuses_a_state_has_a_status() -> None:
    """By kinds of reasons; what has no status of its own has failed."""
    expected = {
        Reason.UNKNOWN_FRAME: StateStatus.BAD_INPUT,
        Reason.NOT_AT_REST: StateStatus.CONTACT_MOVES,
        Reason.CONTACT_MOVES_SLIDES: StateStatus.CONTACT_MOVES,
        Reason.CANNOT_HOLD_MOTOR: StateStatus.CANNOT_MOVE,
        Reason.CANNOT_MOVE_CONTACT: StateStatus.CANNOT_MOVE,
        Reason.SINGULAR_INERTIA: StateStatus.FAILED,
    }
    assert {reason: StateStatus.of_reason(reason) for reason in expected} == expected


def test_other_errors_are_other_errors() -> None:
    """Also those with an attribute of this name, as UnicodeDecodeError has."""
    assert Reason.of(ZeroDivisionError("x")) is Reason.OTHER_ERROR
    assert Reason.of(UnicodeDecodeError("utf-8", b"x", 0, 1, "bad byte")) is Reason.OTHER_ERROR


@pytest.mark.parametrize("code", [1, -1, 1e9, 42.0, "42", None, True])
def test_a_code_that_is_none_is_refused(code: object) -> None:
    """With those that there are."""
    with pytest.raises(InputError, match="the code of a reason is .*expected one of 0, 10, 11"):
        Reason.of_code(code)  # type: ignore[arg-type]


def test_a_cause_that_is_none_is_refused() -> None:
    """With those that there are."""
    with pytest.raises(InputError, match="cause is 'tip'; expected one of floats, sinks"):
        Reason.of_cause("tip")


def reason_of(ask: Callable[[], object]) -> Reason:
    """Of the error that a question raises, which keeps it in a pickle and in a copy."""
    with pytest.raises(RbdError) as caught:
        ask()
    error = caught.value
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)
    assert again.reason is copy.copy(error).reason is error.reason
    assert error.reason.kind is type(error).reason.kind
    return error.reason


@pytest.fixture(scope="module")
def weak() -> rbd.Robot:
    """Talos with motors that are hardly strong enough to stand."""
    robot = rbd.load_robot("talos")
    robot.effort_limit[:] = 1.02 * np.abs(rbd.hold(robot.standing(), robot.soles(0.7)).tau) + 0.3
    return robot


def test_what_prevents_a_pose_has_a_code(talos: rbd.Robot, weak: rbd.Robot) -> None:
    """Talos pushed, in the air, with weak motors, asked for too much."""
    state = talos.standing()
    torso, hand = (state.frame(name).J for name in ("torso_2_link", "arm_left_7_link"))
    asked = Effort(normal_force={"left_sole": (0.0, 20.0)}, edge_margin=0.05)
    panda = rbd.load_robot("panda", root="fixed", passive=["panda_joint2"])

    def holding(mu: float, push: np.ndarray, **settings: object) -> Reason:
        return reason_of(lambda: rbd.hold(state, talos.soles(mu), external=push, **settings))

    assert holding(0.1, 100.0 * torso[1]) is Reason.CANNOT_HOLD_FRICTION
    assert holding(0.1, 62.7 * torso[1], friction="inscribed") is Reason.CANNOT_HOLD_FRICTION
    assert holding(0.1, 87.0 * torso[1], margin=0.05) is Reason.CANNOT_HOLD_FRICTION_MARGIN
    assert holding(0.7, -150.0 * hand[2]) is Reason.CANNOT_HOLD_MOTOR
    assert holding(0.7, 200.0 * torso[1]) is Reason.CANNOT_HOLD_SUPPORT
    assert holding(0.7, 0.0 * hand[2], objective=asked) is Reason.CANNOT_HOLD_REQUEST
    assert reason_of(lambda: rbd.hold(state, [])) is Reason.CANNOT_HOLD_NO_CONTACT
    assert reason_of(lambda: rbd.hold(panda.standing(), [])) is Reason.CANNOT_HOLD_PASSIVE
    both = reason_of(lambda: rbd.hold(weak.standing(), weak.soles(0.1), external=100.0 * torso[1]))
    assert both is Reason.CANNOT_HOLD_FRICTION_AND_MOTOR


def test_what_is_not_searched_or_not_found_has_a_code(talos: rbd.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a proof it is undecided; where the search for the friction is cut short, and in push_limits, it has no detail."""
    state, push = talos.standing(), 100.0 * talos.standing().frame("torso_2_link").J[1]
    corner = rbd.PointContact("corner", "box", friction=0.5, on=rbd.Ground(normal=(0.6, 0.0, 0.8)))
    steep = rbd.State(testing.box(mass=10.0), ORIGIN)
    assert reason_of(lambda: rbd.statics.push_limits(steep, [corner], "box", np.eye(3)[:2])) is Reason.CANNOT_HOLD
    with monkeypatch.context() as patch:
        patch.setattr("rbd.problem.programs.FRICTION_PROGRAMS", 0)
        assert reason_of(lambda: rbd.hold(steep, [corner])) is Reason.CANNOT_HOLD
    monkeypatch.setattr("rbd.statics.limits.Relaxable.refuted", lambda self, relaxed=(): None)
    assert reason_of(lambda: rbd.hold(state, talos.soles(0.1), external=push)) is Reason.CANNOT_HOLD_UNDECIDED
    still = np.zeros(talos.nv)
    ask = reason_of(lambda: rbd.inverse_dynamics(state, still, talos.soles(0.1), external=push))
    assert ask is Reason.CANNOT_MOVE_UNDECIDED


def test_what_prevents_a_motion_has_a_code(talos: rbd.Robot) -> None:
    """The same reasons, of accelerations; and accelerations that a contact does not allow."""
    state, still = talos.standing(), np.zeros(talos.nv)
    torso, hand = (state.frame(name).J for name in ("torso_2_link", "arm_left_7_link"))
    asked = Effort(normal_force={"left_sole": (0.0, 20.0)}, edge_margin=0.05)
    box = testing.box(mass=10.0)
    sinking = -np.eye(6)[2]
    corner = rbd.PointContact("corner", "box", friction=0.5)
    panda = rbd.load_robot("panda", root="fixed", passive=["panda_joint2"])

    def moving(mu: float, push: np.ndarray, **settings: object) -> Reason:
        return reason_of(lambda: rbd.inverse_dynamics(state, still, talos.soles(mu), external=push, **settings))

    assert moving(0.1, 100.0 * torso[1]) is Reason.CANNOT_MOVE_FRICTION
    assert moving(0.1, 87.0 * torso[1], margin=0.05) is Reason.CANNOT_MOVE_FRICTION_MARGIN
    assert moving(0.7, -150.0 * hand[2]) is Reason.CANNOT_MOVE_MOTOR
    assert moving(0.7, 200.0 * torso[1]) is Reason.CANNOT_MOVE_SUPPORT
    assert moving(0.7, 0.0 * hand[2], objective=asked) is Reason.CANNOT_MOVE_REQUEST
    assert reason_of(lambda: rbd.inverse_dynamics(state, still, [])) is Reason.CANNOT_MOVE_NO_CONTACT
    at_rest = panda.standing()
    assert reason_of(lambda: rbd.inverse_dynamics(at_rest, np.zeros(panda.nv), [])) is Reason.CANNOT_MOVE_PASSIVE
    assert reason_of(lambda: rbd.inverse_dynamics(rbd.State(box, ORIGIN), sinking, [corner])) is Reason.CANNOT_MOVE_CONTACT


def test_what_rbd_solve_refuses_has_a_code() -> None:
    """Impacts, sliding under the convex law, contradictions, solvers; a held point that moves."""
    box = testing.box(mass=10.0)
    at = rbd.State(box, ORIGIN)
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2))
    lift = rbd.SurfaceContact("lift", "box", half_lengths=(0.2, 0.2), on=rbd.Ground(acceleration=(0, 0, 1.0)))
    corner = rbd.PointContact("corner", "box", friction=0.5)
    falling, sliding = (rbd.State(box, ORIGIN, v) for v in ([0, 0, -0.5, 0, 0, 0], [0.5, 0, 0, 0, 0, 0]))
    pinned = rbd.PointContact("corner", "box", friction=None)
    assert reason_of(lambda: rbd.solve(falling, [], [corner])) is Reason.CONTACT_MOVES_IMPACT
    assert reason_of(lambda: rbd.solve(sliding, [], [corner], law="convex")) is Reason.CONTACT_MOVES_SLIDES
    assert reason_of(lambda: rbd.inverse_dynamics(sliding, np.zeros(6), [pinned])) is Reason.CONTACT_MOVES_HELD
    assert reason_of(lambda: rbd.inverse_dynamics(falling, np.zeros(6), [corner])) is Reason.CONTACT_MOVES_IMPACT
    assert reason_of(lambda: rbd.hold(falling, [corner])) is Reason.NOT_AT_REST
    assert reason_of(lambda: rbd.solve(at, [], [floor, lift])) is Reason.CONTRADICTION
    assert reason_of(lambda: rbd.solve(at, [], [corner], solver=rbd.KKT())) is Reason.UNSUPPORTED
    found = rbd.solve(at, [], [floor, lift], check=False)
    assert found.status.reason is Reason.CONTRADICTION


def test_what_cannot_be_reached_has_a_code() -> None:
    """With a proof that links are too short, and without one."""
    solo = rbd.load_robot("solo12")
    far = {"FL_FOOT": (5.0, 0.0, 0.0), "FR_FOOT": (0.0, 0.0, 0.0)}
    assert reason_of(lambda: rbd.find_pose(solo, far)) is Reason.OUT_OF_REACH
    assert errors.CannotReach("no pose was found").reason is Reason.CANNOT_REACH


def test_states_without_an_answer_have_codes(talos: rbd.Robot) -> None:
    """Beside the status of each state, as the error of the state alone has it: without the search for limits no detail."""
    solo = rbd.load_robot("solo12")
    q, v = np.tile(solo.standing().q, (4, 1)), np.zeros((4, solo.nv))
    v[1, 2] = -0.1
    q[2, 0] = np.nan
    q[3, 3:7] = 2.0
    found = rbd.solve_many(solo, q, v, np.zeros(solo.nu), solo.feet())
    assert found.reason_codes.tolist() == [0, 21, 10, 10] and found.reason_codes.dtype == np.int16
    assert not found.reason_codes.flags.writeable
    assert [StateStatus.of_reason(Reason.of_code(code)) for code in found.reason_codes[1:]] == found.status[1:].tolist()
    push = rbd.ExternalForce("torso_2_link", (0.0, 200.0, 0.0))
    poses = rbd.statics.hold_many(talos, np.tile(talos.standing().q, (2, 1)), talos.soles(0.7), external=push)
    assert poses.reason_codes.tolist() == [40, 40] and set(poses.status) == {StateStatus.CANNOT_MOVE}
    assert reason_of(lambda: poses[0]) is Reason.CANNOT_HOLD_SUPPORT


def test_the_early_end_of_a_simulation_has_a_code(tmp_path: Path) -> None:
    """Of the error, and of the trajectory until then, which keeps it in its file."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)

    def stopped(failing: Callable[[float], float]) -> errors.SimulationStopped:
        with pytest.raises(errors.SimulationStopped) as caught, np.errstate(invalid="ignore"):
            rbd.simulate(bars.at("assembled"), bars.loops(), duration=0.1, step=0.01, controller=lambda state, t: [failing(t)])
        assert caught.value.trajectory.end_reason is caught.value.reason
        return caught.value

    assert stopped(lambda t: 1.0 / (t < 0.042)).reason is Reason.STOPPED_OTHER
    error = stopped(lambda t: np.sqrt(0.042 - t))
    assert error.reason is Reason.STOPPED_BAD_INPUT and error.reason.kind is errors.SimulationStopped.reason
    path = tmp_path / "stopped.npz"
    error.trajectory.save(path)
    assert rbd.Trajectory.load(path).end_reason is Reason.STOPPED_BAD_INPUT
    whole = rbd.simulate(bars.at("assembled"), bars.loops(), duration=0.02, step=0.01)
    assert whole.end_reason is whole[:1].end_reason is Reason.NONE
    with pytest.raises(InputError, match=r"end_reason of a trajectory is 'bored'; expected a rbd.errors.Reason"):
        rbd.Trajectory(**{**vars(whole), "end_reason": "bored"})


def test_frames_of_a_motion_have_codes() -> None:
    """That of the first of their causes; 0 where a frame is possible."""
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
    report = rbd.check_motion(rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0))
    codes = report.reason_codes
    assert codes.shape == (report.n,) and codes.dtype == np.int16
    assert ((codes == 0) == report.possible).all()
    assert ((codes == Reason.NOT_POSSIBLE_FLOATS.code) == report.of_cause("floats")).all()
    for i in np.flatnonzero(codes):
        assert Reason.of_code(codes[i]).detail == CAUSES[int(report.causes[i].argmax())]


def table_of(reasons: list[Reason]) -> list[str]:
    """Rows of a table in Markdown."""
    return [f"| {reason.code} | {f'`{reason}`' if reason else '(empty)'} | {reason.meaning} |" for reason in reasons]


def test_the_page_has_them_all() -> None:
    """Every reason stands in the tables of docs/reference/reasons.md, with its code and meaning, in order."""
    rows = re.findall(r"^\| \d+ \|.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    expected = table_of(list(Reason))
    assert rows == expected, "\n".join(expected)
