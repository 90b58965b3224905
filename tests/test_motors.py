"""Motors: which joints have one, their limits at rest and at speed, their rotors in M; they travel with the robot."""

from __future__ import annotations

import copy
import math
import pickle
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import CannotMove, EffortLimitWarning, InputError, JointNotFound, ModelError, SpeedLimitWarning

LINE = [(0.0, 10.0), (5.0, 10.0), (10.0, 0.0)]
FAST = 7.5
"""A speed at which LINE leaves 5 N m [rad/s]."""
GRAVITY = 9.81


@pytest.fixture(scope="module")
def arm() -> rbd.Robot:
    """One link of 1 m and 1 kg, M = 1/3; the motor drives with 10 N m at rest, and with 5 N m at 7.5 rad/s."""
    plain = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    return plain.with_motors({"joint_1": rbd.Motor(torque_speed=LINE)})


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def torque_for(arm: rbd.Robot, tau: float, speed: float) -> rbd.Actuation:
    """What inverse dynamics finds for the acceleration of a torque."""
    state = arm.at([0.0], [speed])
    return rbd.inverse_dynamics(state, (tau - state.h) / state.M[0], [])


def test_limits_are_the_line_while_it_drives_and_those_at_rest_while_it_brakes(arm):
    """Where tau v > 0 the line; tau v < 0, and at rest: its first torque; beyond its end nothing drives."""
    for speed, least, most in (
        (0.0, -10.0, 10.0),
        (4.0, -10.0, 10.0),
        (FAST, -10.0, 5.0),
        (-FAST, -5.0, 10.0),
        (12.0, -10.0, 0.0),
        (-12.0, 0.0, 10.0),
    ):
        found = arm.torque_limits([speed])
        assert (found[0].tolist(), found[1].tolist()) == ([least], [most])
    many = arm.torque_limits(np.array([[0.0], [FAST], [-FAST]]))
    assert np.array_equal(many, [[[-10.0], [-10.0], [-5.0]], [[10.0], [5.0], [10.0]]])
    assert np.array_equal(arm.torque_limits(), [[-10.0], [10.0]])


def test_inverse_dynamics_keeps_the_line(arm):
    """Just below it there is a torque, with the margin that is left; just above it the message has joint, speed and line."""
    assert torque_for(arm, 4.9, FAST).tau == pytest.approx([4.9], abs=1e-12)
    assert torque_for(arm, 4.9, FAST).margins.torque == pytest.approx([0.02], abs=1e-9)
    assert torque_for(arm, 4.9, -FAST).margins.torque == pytest.approx([0.51], abs=1e-9)  # it brakes there
    assert torque_for(arm, -9.9, FAST).tau == pytest.approx([-9.9], abs=1e-12)
    words = "torque-speed line .* 'joint_1' needs 5.1 N m at 7.5 rad/s, where its torque-speed line leaves 5 N m"
    with pytest.raises(CannotMove, match=words) as caught:
        torque_for(arm, 5.1, FAST)
    error = caught.value
    assert error.excess == pytest.approx([0.01], abs=1e-6)  # of the limit at rest
    assert [(limit.kind, limit.name) for limit in error.limits] == [("motor", "joint_1")]
    assert error.nearest().tau == pytest.approx([5.0], abs=1e-5)
    with pytest.raises(CannotMove, match="a torque limit prevents it. At best 'joint_1' needs 101 % of its limit"):
        torque_for(arm, -10.1, FAST)


def test_beyond_the_end_of_the_line_it_only_brakes(arm):
    """Gravity pulls it down, and against its motion: no torque may drive it."""
    with pytest.raises(CannotMove, match="needs 0.1 N m at 12 rad/s, where its torque-speed line leaves 0 N m"):
        torque_for(arm, 0.1, 12.0)
    assert torque_for(arm, 0.0, 12.0).margins.torque.tolist() == [1.0]


def test_many_states_have_the_same_answers(solo):
    """In blocks and one by one, within the lines and beyond them; in contact, where forces may be shared out."""
    robot = solo.with_motors({name: rbd.Motor(torque_speed=[(0.0, 3.0), (8.0, 0.0)]) for name in solo.actuated_names})
    feet, up = robot.feet(), np.eye(robot.nv)[2]
    still = robot.standing()
    state = still.with_velocity(rbd.mechanism.project_velocity(still.with_velocity(0.3 * up), feet).v)
    for lift, possible in ((1.0, True), (25.0, True), (60.0, False)):
        a = rbd.mechanism.project_acceleration(state, lift * up, feet).a
        many = rbd.control.inverse_dynamics_many(robot, state.q, state.v, a, feet)
        if not possible:
            assert np.isnan(many.tau).all()
            with pytest.raises(CannotMove, match="torque-speed line"):
                rbd.inverse_dynamics(state, a, feet)
            continue
        one = rbd.inverse_dynamics(state, a, feet)
        least, most = robot.torque_limits(state.v)
        assert (least <= one.tau).all() and (one.tau <= most).all() and one.residuals.within(1e-9)
        assert np.abs(many.tau[0] - one.tau).max() < 1e-9
    # Without lines the same motion is possible: the lines refuse it, not the limits at rest.
    plain = solo.with_motors({name: rbd.Motor(limit=4.0) for name in solo.actuated_names})
    assert rbd.inverse_dynamics(rbd.State(plain, state.q, state.v), a, feet).residuals.within(1e-9)


def test_the_least_effort_is_at_a_line_where_it_was_beyond(solo):
    """One hip's line is drawn below what it used: its torque is on the line, other joints take the rest, and effort grows."""
    feet, up = solo.feet(), np.eye(solo.nv)[2]
    still = solo.standing()
    v = rbd.mechanism.project_velocity(still.with_velocity(0.3 * up), feet).v
    a = rbd.mechanism.project_acceleration(still.with_velocity(v), 5.0 * up, feet).a
    limits = {name: rbd.Motor(limit=3.0) for name in solo.actuated_names}
    free = solo.with_motors(limits)
    used = rbd.inverse_dynamics(rbd.State(free, still.q, v), a, feet)
    i = int(np.argmax(np.where(used.tau * v[solo.actuated] > 0.0, np.abs(used.tau), 0.0)))
    name, speed = solo.actuated_names[i], abs(v[solo.actuated[i]])
    most = 0.7 * abs(used.tau[i])
    bound = free.with_motors({name: rbd.Motor(torque_speed=[(0.0, 3.0), (speed, most), (2.0 * speed, 0.0)])})
    found = rbd.inverse_dynamics(rbd.State(bound, still.q, v), a, feet)
    assert abs(found.tau[i]) == pytest.approx(most, rel=1e-6) and found.margins.torque[i] == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(found.tau) > np.linalg.norm(used.tau) and found.residuals.within(1e-9)
    # The same program by another way: a limit of that size at rest, its cost that of a motor of 3 N m.
    small = free.with_motors({name: rbd.Motor(limit=most)})
    cost = rbd.statics.Effort(torques={name: (most / 3.0) ** 2})
    same = rbd.inverse_dynamics(rbd.State(small, still.q, v), a, feet, objective=cost)
    assert np.abs(same.tau - found.tau).max() < 1e-6
    assert np.abs(rbd.solve(found.state, found.tau, feet).a - a).max() < 1e-7


def test_solve_warns_of_a_torque_beyond_the_line(arm):
    """It takes any torque, and says what the motor has at this speed; braking with more is within its limits."""
    state = arm.at([0.0], [FAST])
    with pytest.warns(EffortLimitWarning, match="tau of joint_1 is 6 N m at 7.5 rad/s, where .* leaves 5 N m; 1 of 1"):
        rbd.solve(state, [6.0], [])
    with pytest.warns(EffortLimitWarning, match="beyond its effort limit of 10 N m"):
        rbd.solve(state, [-11.0], [])
    with pytest.warns(EffortLimitWarning, match="at 1 of 2 states"):
        rbd.solve_many(arm, np.zeros((2, 1)), [[FAST], [-FAST]], [6.0], [])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbd.solve(state, [-9.0], [])


def test_a_joint_that_is_too_fast_is_named(arm):
    """Of a speed limit that was given; the file's own is for controllers and for check_motion, as before."""
    robot = arm.with_motors({"joint_1": rbd.Motor(speed_limit=5.0)})
    with pytest.warns(SpeedLimitWarning, match="joint_1 moves at 6 rad/s, faster than the 5 rad/s of its motor") as seen:
        rbd.inverse_dynamics(robot.at([0.0], [-6.0]), [0.0], [])
    assert seen[0].filename == __file__
    with pytest.warns(SpeedLimitWarning, match="at 1 of 2 states"):
        rbd.control.inverse_dynamics_many(robot, np.zeros((2, 1)), [[4.0], [6.0]], [[0.0]], [])
    assert robot.joints["joint_1"].speed == 5.0


def test_controllers_keep_the_line(arm):
    """A stiff PD asks for more than there is: each controller gives what the line leaves, in its direction."""
    hold = rbd.control.HoldPosture(arm.at([1.0]), frequency=30.0)
    ahead, behind = arm.at([0.0], [FAST]), arm.at([2.0], [FAST])
    assert hold(ahead, 0.0).tolist() == [5.0] and hold(behind, 0.0).tolist() == [-10.0]
    task = rbd.control.PostureTask(arm.at([1.0]).q, gain=1e4)
    off = rbd.control.Limits(velocity=False, position=False)
    step = rbd.control.step(ahead, [task], [], limits=off)
    assert step.tau == pytest.approx([5.0], abs=1e-9) and step.at_limit == {"torque": ("joint_1",)}
    half = rbd.control.step(ahead, [task], [], limits=rbd.control.Limits(torque=0.5, velocity=False, position=False))
    assert half.tau == pytest.approx([2.5], abs=1e-9)
    assert rbd.control.step(behind, [task], [], limits=off).tau == pytest.approx([-10.0], abs=1e-9)


def test_a_whole_body_controller_never_drives_beyond_the_line(arm):
    """A swing up over 0.4 s: at every step of the record the torque is within the limits of its speed."""
    task = rbd.control.PostureTask(arm.at([2.5]).q, gain=400.0)
    control = rbd.control.WholeBodyController([task], limits=rbd.control.Limits(velocity=False, position=False))
    run = rbd.simulate(arm.at([0.0]), controller=control, duration=0.4, step=2e-3)
    least, most = arm.torque_limits(run.v[:-1])
    assert (run.v[:-1] > 5.0).any()  # where the line falls
    slack = 0.02 * 10.0  # the speed changes while a torque is held
    assert (run.tau[:-1] >= least - slack).all() and (run.tau[:-1] <= most + slack).all()


def test_plots_draw_the_limits_at_the_speed_of_each_time(arm):
    """Two dashed curves in place of straight lines: what drives falls with the speed, what brakes does not."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    run = rbd.simulate(arm.at([0.0]), controller=lambda state, t: np.array([9.0]), duration=0.6, step=5e-3)
    figure, axes = pyplot.subplots()
    drawn = rbd.visual.plot_joint(axes, run, "joint_1", what="tau")
    dashed = [line.get_ydata() for line in drawn if len(line.get_ydata()) == len(run.t)][1:]
    least, most = arm.torque_limits(run.v)
    assert np.array_equal(dashed, [least[:, 0], most[:, 0]]) and most.min() < 9.0
    pyplot.close(figure)
    shown = rbd.solve(arm.at([0.0], [-FAST]), [4.0], [])._repr_html_()
    assert shown
    page = rbd.inverse_dynamics(arm.at([0.0], [FAST]), [0.0], [])
    assert "98" in page._repr_html_()  # 4.905 of the 5 N m that the line leaves, in per cent


def test_a_rotor_is_on_the_diagonal_of_m(solo):
    """gear^2 times its own inertia, in place of the file's; a pendulum with it swings slower by the closed form."""
    robot = solo.with_motors({"FL_KFE": rbd.Motor(gear=-9.0, rotor_inertia=2e-5)})
    more = robot.standing().M - solo.standing().M
    at = solo.joints["FL_KFE"].v.start
    assert more[at, at] == pytest.approx(81.0 * 2e-5 - solo.model.armature[at], abs=1e-15)
    more[at, at] = 0.0
    assert np.abs(more).max() < 1e-15
    plain = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    heavy = plain.with_motors({"joint_1": rbd.Motor(gear=50.0, rotor_inertia=4e-5)})  # 0.1 kg m2
    a = rbd.solve(heavy.at([0.0]), [0.0], []).a
    assert a == pytest.approx([-0.5 * GRAVITY / (1.0 / 3.0 + 0.1)], rel=1e-12)


def test_joints_that_are_not_named_keep_what_they_have(solo):
    """And the robot that was asked stays as it was; None takes a motor away, others_passive all that are not named."""
    before = solo.digest
    robot = solo.with_motors({"FL_HAA": rbd.Motor(limit=2.0), "FR_HAA": None})
    assert robot.nu == solo.nu - 1 and "FR_HAA" in robot.passive and "FR_HAA" not in robot.actuated_names
    assert robot.effort_limit.tolist() == [2.0, *solo.effort_limit[1:3], *solo.effort_limit[4:]]
    assert solo.digest == before and solo.nu == 12 and not solo.motor_data
    again = robot.with_motors({"FR_HAA": rbd.Motor(), "FL_HAA": rbd.Motor()})
    assert again.nu == 12 and np.array_equal(again.effort_limit, solo.effort_limit)
    alone = solo.with_motors({"FL_KFE": rbd.Motor(limit=3.0)}, others_passive=True)
    assert alone.actuated_names == ("FL_KFE",) and len(alone.passive) == 11 and alone.standing().M.shape == (18, 18)


@pytest.mark.parametrize(
    ("given", "effort"),
    [
        ({"limit": 4.0}, 4.0),
        ({"limit": math.inf}, math.inf),
        ({"torque_speed": LINE}, 10.0),
        ({"limit": 4.0, "torque_speed": LINE}, 4.0),
        ({"limit": 40.0, "torque_speed": LINE}, 10.0),
        ({}, 1000.0),
    ],
)
def test_the_limit_at_rest_is_the_smaller_one(solo, given, effort):
    """Of the limit and of the line's first torque; without either the file's."""
    assert solo.with_motors({"FL_HAA": rbd.Motor(**given)}).effort_limit[0] == effort


def robots() -> dict[str, rbd.Robot]:
    """With motors of their own: of the catalogue, of a file with passive joints, of a pair, by hand."""
    solo = rbd.load_robot("solo12")
    kneed = solo.with_motors({"FL_KFE": rbd.Motor(gear=9.0, rotor_inertia=1e-4, torque_speed=LINE), "FR_KFE": None})
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    driven = bars.with_motors({name: rbd.Motor(limit=7.0) for name in bars.passive})
    pair = rbd.robots.merge_robots(kneed, rbd.testing.box(mass=2.0), names=("", "crate_"))
    return {
        "solo": kneed,
        "bars": driven,
        "pair": pair,
        "pair with more": pair.with_motors({"HL_KFE": rbd.Motor(torque_speed=LINE)}),
        "rotors": rbd.load_robot("talos", rotors=True),
    }


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
@pytest.mark.parametrize("name", ["solo", "bars", "pair", "pair with more", "rotors"])
def test_copies_and_pickles_have_the_same_motors(name):
    """Copied, deep-copied, pickled, and once more: names, limits at rest and at speed, M, and the digest."""
    robot = robots()[name]
    v = np.full(robot.nv, FAST)
    sent = pickle.loads(pickle.dumps(robot))
    for other in (copy.copy(robot), copy.deepcopy(robot), sent, copy.deepcopy(sent)):
        assert other.is_like(robot) and other.digest == robot.digest and other.motor_data == robot.motor_data
        assert other.actuated_names == robot.actuated_names and other.passive == robot.passive
        assert np.array_equal(other.torque_limits(v), robot.torque_limits(v))
        assert np.array_equal(other.model.armature, robot.model.armature) and other is not robot


def test_other_lines_make_another_robot(solo):
    """Two robots with equal limits at rest and different lines are not alike, also not by their digests."""
    one, other = (solo.with_motors({"FL_HAA": rbd.Motor(torque_speed=[(0.0, 3.0), (w, 0.0)])}) for w in (8.0, 9.0))
    assert np.array_equal(one.effort_limit, other.effort_limit)
    assert not one.is_like(other) and one.digest != other.digest


def test_a_pair_keeps_the_lines_of_both(solo):
    """By prefixed names."""
    pair = robots()["pair with more"]
    assert sorted(pair.motor_data) == ["FL_KFE", "FR_KFE", "HL_KFE"] and "FR_KFE" in pair.passive
    most = pair.torque_limits(np.full(pair.nv, FAST))[1]
    assert [most[pair.actuated_names.index(name)] for name in ("FL_KFE", "HL_KFE")] == [5.0, 5.0]


@pytest.mark.parametrize("end", ["npz", "nc"])
def test_a_saved_motion_has_the_motors_of_its_robot(tmp_path: Path, solo, end: str):
    """Lines, infinite limits, rotors and joints without a motor come back with `Trajectory.load`."""
    motors = {"FL_HAA": rbd.Motor(torque_speed=LINE), "FL_HFE": rbd.Motor(limit=math.inf, gear=9, rotor_inertia=1e-5)}
    robot = solo.with_motors({**motors, "FR_KFE": None})
    run = rbd.simulate(robot.standing(), duration=0.01, step=5e-3)
    run.save(tmp_path / f"run.{end}")
    again = rbd.Trajectory.load(tmp_path / f"run.{end}").robot
    assert again.motor_data == robot.motor_data and again.is_like(robot)


def squat(robot: rbd.Robot, n: int = 31, drop: float = 0.5) -> rbd.Motion:
    """Down and up on all feet in 1.2 s, the feet kept to first order."""
    state, held = robot.standing(), robot.feet(friction=None)
    q, h = [state.q], 1.2 / (n - 1)
    for k in range(n - 1):
        down = np.zeros(robot.nv)
        down[2] = -0.5 * drop * np.sin(2.0 * np.pi * k / (n - 1))
        v = rbd.mechanism.project_velocity(state.with_velocity(down), held).v
        state = robot.at(pin.integrate(robot.model, state.q, h * v))
        q.append(state.q)
    return rbd.Motion.of_arrays(robot, h * np.arange(n), np.array(q))


def test_check_motion_and_inverse_dynamics_agree_on_slow_motors(solo):
    """Frame by frame: where one finds torques within the lines, so does the other; the repair keeps them."""
    weak = {n: rbd.Motor(limit=0.5) for n in solo.actuated_names}
    slow = {n: rbd.Motor(torque_speed=[(0.0, 0.98), (2.0, 0.0)]) for n in weak if n.endswith("KFE")}
    robot = solo.with_motors(weak | slow)
    plain = squat(solo)
    motion = rbd.Motion.of_arrays(robot, plain.t, plain.q, plain.v, plain.a)
    report = rbd.check_motion(motion, self_collision=False)
    held, feet, possible = robot.feet(friction=None), robot.feet(0.7, on=None), []
    for q, v, a in zip(motion.q, motion.v, motion.a, strict=True):
        still = robot.at(q)
        state = still.with_velocity(rbd.mechanism.project_velocity(still.with_velocity(v), held).v)
        try:
            rbd.inverse_dynamics(state, rbd.mechanism.project_acceleration(state, a, held).a, feet, margin=0.0)
            possible.append(True)
        except CannotMove as error:
            assert error.excess is not None and "torque-speed line of a motor prevents it" in str(error)
            possible.append(error.excess.max() < 0.01)  # what check_motion takes for rounding of the data
    assert 5 < sum(possible) < 26 and np.array_equal(report.possible, possible)
    assert report.of_cause("torque-speed").any() and "which leaves" in str(report)
    assert rbd.check_motion(squat(solo), self_collision=False).possible.all()
    near = report.repaired(progress=False)
    assert near.n == motion.n and rbd.check_motion(near, self_collision=False).possible.all()


BAD = {
    "gear": ({"gear": 0.0}, "gear of a motor is 0.0; expected a ratio that is not 0"),
    "gear nan": ({"gear": math.nan}, "gear of a motor is nan"),
    "limit": ({"limit": -3.0}, "limit of a motor is -3.0; expected a torque > 0"),
    "limit zero": ({"limit": 0.0}, "limit of a motor is 0.0.*give None in place of the motor"),
    "limit word": ({"limit": "big"}, "limit of a motor is 'big'"),
    "speed": ({"speed_limit": -1.0}, "speed_limit of a motor is -1.0; expected a speed > 0"),
    "rotor": ({"rotor_inertia": -1e-5}, "rotor_inertia of a motor is -1e-05; expected 0 or more"),
    "number": ({"torque_speed": 3.0}, "torque_speed of a motor is 3.0; expected .*two points or more"),
    "one point": ({"torque_speed": [(0.0, 3.0)]}, "two points or more"),
    "triples": ({"torque_speed": [(0.0, 3.0, 1.0), (1.0, 2.0, 1.0)]}, "two points or more"),
    "rises": ({"torque_speed": [(0.0, 3.0), (1.0, 4.0)]}, "rises from 3 at speed 0 to 4 at 1.*given as .torque, speed."),
    "speeds": ({"torque_speed": [(1.0, 3.0), (1.0, 2.0)]}, "speeds of a motor's torque_speed do not increase: 1 follows 1"),
    "negative": ({"torque_speed": [(0.0, 3.0), (1.0, -2.0)]}, r"has the point \(1, -2\); expected finite numbers of 0 or more"),
    "nan": ({"torque_speed": [(0.0, math.nan), (1.0, 0.0)]}, r"has the point \(0, nan\)"),
    "nothing": ({"torque_speed": [(0.0, 0.0), (1.0, 0.0)]}, "starts with the torque 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_numbers_of_a_motor_are_named(case):
    """What came, what was expected, what to try."""
    given, says = BAD[case]
    with pytest.raises(InputError, match=says):
        rbd.Motor(**given)


def test_bad_motors_of_a_robot_are_named(solo):
    """Unknown joints with the nearest names; what is no motor; joints that cannot have one."""
    with pytest.raises(JointNotFound, match="no joint 'FL_KFA' in solo12.*'FL_KFE'"):
        solo.with_motors({"FL_KFA": rbd.Motor()})
    with pytest.raises(InputError, match="motor of 'FL_KFE' is 3.0; expected rbd.Motor"):
        solo.with_motors({"FL_KFE": 3.0})
    with pytest.raises(InputError, match="motors is .* expected {joint: rbd.Motor"):
        solo.with_motors([rbd.Motor()])
    for motor in (rbd.Motor(), None):
        with pytest.raises(InputError, match=r"joint 'root_joint' of solo12 has 6 degrees of freedom \(floating\)"):
            solo.with_motors({"root_joint": motor})
    with pytest.raises(InputError, match="others_passive"):
        solo.with_motors({}, others_passive=1)
    with pytest.raises(InputError, match=r"v of solo12 has shape \(3,\); expected \(18,\) or \(n, 18\)"):
        solo.torque_limits(np.zeros(3))
    with pytest.raises(InputError, match="v of solo12"):
        solo.torque_limits(np.full(18, np.nan))


ROTOR_URDF = """<robot name="bar">
  <link name="base"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>{dynamics}
    <limit effort="9" velocity="9"/></joint>
  <link name="bar"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  {transmission}
</robot>"""
ROS = """<transmission name="t"><type>SimpleTransmission</type><joint name="j"/><actuator name="m">
  <mechanicalReduction>50</mechanicalReduction><motorInertia>4e-5</motorInertia></actuator></transmission>"""
DRAKE = """<transmission xmlns:drake="d"><type>SimpleTransmission</type><joint name="j"/><actuator name="m">
  <drake:rotor_inertia value="4e-5"/><drake:gear_ratio value="50"/></actuator></transmission>"""


def bar(tmp_path: Path, transmission: str = "", dynamics: str = "", srdf: str = "", **more) -> rbd.Robot:
    """A bar whose M is 0.35 kg m2 without a rotor."""
    path = tmp_path / "bar.urdf"
    path.write_text(ROTOR_URDF.format(transmission=transmission, dynamics=dynamics))
    if srdf:
        path.with_suffix(".srdf").write_text(f'<robot name="bar"><rotor_params>{srdf}</rotor_params></robot>')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        return rbd.load_robot(path, root="fixed", **more)


OWN = 0.35
SRDF = '<joint name="j" mass="1e-5" gear_ratio="100"/>'


def test_dynamics_armature_is_in_m(tmp_path):
    """As before: it is what the file says is seen at the joint."""
    assert bar(tmp_path, dynamics='<dynamics armature="0.2"/>').at().M == pytest.approx(OWN + 0.2)


@pytest.mark.parametrize(("transmission", "srdf"), [(ROS, ""), (DRAKE, ""), ("", SRDF), (ROS, SRDF)])
def test_rotors_of_transmissions_and_srdf_are_in_m_if_asked_for(tmp_path, transmission, srdf):
    """n^2 I = 0.1 kg m2; else the doctor names the joint, and what it leaves out."""
    without = bar(tmp_path, transmission, srdf=srdf)
    assert without.at().M == pytest.approx(OWN)
    report = rbd.doctor(without)
    told = [f for f in (*report.warnings, *report.notes) if f.kind == "armature"]
    assert told and all(f.where == "j" and "not in M" in f.text and "rotors=True" in f.text for f in told)
    inside = bar(tmp_path, transmission, srdf=srdf, rotors=True)
    assert inside.at().M == pytest.approx(OWN + 0.1)
    report = rbd.doctor(inside)
    assert [f.text for f in report.notes if f.kind == "armature"] == ["its rotor is in M, 0.1 at the joint [kg m2, kg]"]
    assert not [f for f in (*report.warnings, *inside.report.warnings) if f.kind == "armature"]


def test_a_transmission_counts_before_an_srdf(tmp_path):
    """Of one joint, and the rotor that was asked for replaces the joint's armature."""
    other = '<joint name="j" mass="1e-5" gear_ratio="10"/>'
    assert bar(tmp_path, ROS, '<dynamics armature="0.2"/>', other, rotors=True).at().M == pytest.approx(OWN + 0.1)


@pytest.mark.parametrize(
    ("transmission", "srdf", "says"),
    [
        (ROS.replace(">50<", ">0<"), "", "transmission of joint 'j' has a gear of 0"),
        (ROS.replace("4e-5", "-1"), "", "transmission of joint 'j' has a rotor inertia of -1 kg m2"),
        (ROS.replace("4e-5", "light"), "", "inertia is 'light'; expected a finite number"),
        ("", SRDF.replace("100", "0"), "rotor_params of joint 'j' has a gear of 0"),
        ("", SRDF.replace("1e-5", "x"), "mass is 'x'; expected a finite number"),
    ],
)
def test_broken_rotors_are_named(tmp_path, transmission, srdf, says):
    """Where they are asked for; else the robot loads as before."""
    assert bar(tmp_path, transmission, srdf=srdf).at().M == pytest.approx(OWN)
    with pytest.raises(ModelError, match=says):
        bar(tmp_path, transmission, srdf=srdf, rotors=True)


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
def test_the_rotors_of_talos():
    """Its SRDF states 1e-5 kg m2 behind gears of 100: a tenth at each joint; off unless asked for, and then told by name."""
    plain, geared = rbd.load_robot("talos"), rbd.load_robot("talos", rotors=True)
    more = np.diag(geared.standing().M - plain.standing().M)
    named = [geared.joints[name].v.start for name in plain.rotors()]
    expected = np.zeros(38)
    expected[named] = 0.1
    assert len(named) == 30 and np.abs(more - expected).max() < 1e-12
    told = {f.where for f in rbd.doctor(plain).notes if f.kind == "armature"}
    assert told == set(plain.rotors())
