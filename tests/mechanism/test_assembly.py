"""Assembling: onto the constraints, held joints held, failures that say why."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from planar_models import (
    IDENTITY,
    absolute,
    at,
    bar,
    checked,
    four_bar,
    four_bar_angles,
    six_bar,
    slider_crank,
)
from states import at_neutral

import rbd
from rbd.constraints.descent import descend
from rbd.errors import CannotAssemble
from rbd.mechanism import assemble
from rbd.mechanism.constraint_error import Closure
from rbd.model.checked_model import CheckedModel

URDF = Path(__file__).parents[2] / "urdf"
CRANK = math.radians(40.0)


def test_nortons_four_bar_assembles_to_its_published_angles():
    """Norton's 40 / 120 / 80 / 100 at 40 deg: (20.298, 57.325) and (-60.98, -98.01) deg, by the start."""
    robot, loops = four_bar(40.0, 120.0, 80.0, 100.0)
    for start, expected in (([0.0, 0.5, 1.0], (20.298, 57.325)), ([0.0, -1.0, -1.5], (-60.98, -98.01))):
        found = assemble(rbd.State(robot, np.array(start)), loops, fixed={"crank": CRANK})
        assert np.abs(np.degrees(absolute(found.q))[1:] - expected).max() < 0.0075  # printed to 0.001 and 0.01
        assert found.q[0] == CRANK
        assert found.residual <= 1e-12 and found.dof == 0
        assert found.residual == np.abs(loops[0].rows(rbd.State(robot, found.q)).error).max()


@pytest.mark.parametrize("continuous", [False, True])
def test_a_four_bar_from_anywhere_ends_on_one_of_its_two_circles_crossings(rng: np.random.Generator, continuous: bool):
    """Closed form: where the coupler's circle about the crank's tip meets the rocker's about its pivot."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0, continuous=continuous)
    for _ in range(50):
        crank = rng.uniform(-math.pi, math.pi)
        q0 = pin.integrate(robot.model, pin.neutral(robot.model), rng.uniform(-3.0, 3.0, size=3))
        found = assemble(rbd.State(robot, q0), loops, fixed={"crank": crank})
        q = pin.difference(robot.model, pin.neutral(robot.model), found.q) if continuous else found.q
        if continuous:
            q[0] = crank
        gaps = [
            np.abs(np.exp(1j * absolute(q)[1:]) - np.exp(1j * np.array(angles))).max()
            for angles in four_bar_angles(1.0, 3.0, 2.5, 3.0, crank)
        ]
        assert min(gaps) < 1e-11


def test_the_end_is_quadratic():
    """Each of the last steps squares the error: |e_next| < 10 |e|^2 below a centimetre."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    closure = Closure(robot, loops, {"crank": 0.7})
    start = closure.start(np.array([0.7, 0.3, 1.0]))
    sizes = [descend(closure, start, tolerance=1e-15, most=most).at.residual for most in range(1, 7)]
    small = [(e, after) for e, after in zip(sizes, sizes[1:], strict=False) if 1e-7 < e < 1e-2]
    assert len(small) >= 1
    assert all(after < 10.0 * e * e for e, after in small)


def test_rows_that_repeat_each_other_do_no_harm():
    """A planar loop closed with three rows (rank 2), and the same loop once more under another name."""
    robot, _ = four_bar(1.0, 3.0, 2.5, 3.0)
    twice = [rbd.LoopClosure(name, "coupler_tip", "rocker_tip", kind="point") for name in ("one", "other")]
    found = assemble(rbd.State(robot, np.array([0.7, 0.3, 1.0])), twice, fixed={"crank": 0.7})
    assert found.residual <= 1e-12 and found.iterations < 10
    assert found.dof == 0
    assert np.abs(absolute(found.q)[1:] - four_bar_angles(1.0, 3.0, 2.5, 3.0, 0.7)[0]).max() < 1e-11


def test_a_start_on_the_constraints_stays():
    """A robot that is assembled does not move."""
    robot, loops = six_bar()
    first = assemble(rbd.State(robot, np.array([0.7, 0.1, 1.5, -0.5, 1.0])), loops)
    again = assemble(rbd.State(robot, first.q), loops)
    assert again.iterations == 0 and again.moved == 0.0
    assert np.array_equal(again.q, first.q)


def test_moved_is_the_way_from_the_start():
    """|q - q0| in the velocities' coordinates, a whole turn being no way."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    q0 = np.array([0.7, 0.3, 1.0])
    found = assemble(rbd.State(robot, q0), loops)
    assert found.moved == pytest.approx(float(np.linalg.norm(found.q - q0)), abs=1e-12)
    turned = assemble(rbd.State(robot, found.q), loops, fixed={"crank": found.q[0] + 2.0 * math.pi})
    assert turned.moved < 1e-12


def test_a_loop_that_is_too_long_is_told_with_its_gap():
    """Bars 1, 1, 1 on a ground of 5: stretched towards each other they stay 5 - 3 = 2 m apart, a true minimum."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 5.0)
    with pytest.raises(CannotAssemble, match=r"'loop' is 2 m .* true minimum .* cannot close") as caught:
        assemble(rbd.State(robot, np.array([0.3, 0.2, 0.1])), loops)
    error = caught.value
    assert error.distances["loop"] == pytest.approx(2.0, abs=1e-12)
    assert error.minimum and error.elsewhere is None
    assert np.abs(absolute(error.q) - [0.0, 0.0, math.pi]).max() < 1e-6 or abs(abs(absolute(error.q)[2]) - math.pi) < 1e-6


def test_a_saddle_of_the_distance_is_left():
    """Aligned the wrong way the distance has no slope, and yet the loop closes: no local trick stops it."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.5)
    aligned = np.array([0.0, math.pi, math.pi])  # tips at 0 and 0.5: all on the x axis
    found = assemble(rbd.State(robot, aligned), loops, fixed={"crank": 0.0})
    assert found.residual <= 1e-12
    assert absolute(found.q)[1:] in [pytest.approx(angles, abs=1e-6) for angles in four_bar_angles(1.0, 1.0, 1.0, 1.5, 0.0)]


def test_fixed_values_that_contradict_each_other_are_named():
    """Crank at 0.7 puts the rocker at one of two angles; held at 0.3 no coupler reaches, and both joints are named."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(CannotAssemble, match="contradict each other.*'rocker' at") as caught:
        assemble(rbd.State(robot, np.array([0.7, 0.0, 1.5])), loops, fixed={"crank": 0.7, "rocker": 0.3})
    rocker = four_bar_angles(1.0, 3.0, 2.5, 3.0, 0.7)[0][1]
    assert f"'rocker' at {rocker:.6g}" in str(caught.value)
    tip, pivot = np.array([math.cos(0.7), math.sin(0.7)]), np.array([3.0, 0.0])
    end = pivot + 2.5 * np.array([math.cos(0.3), math.sin(0.3)])
    assert caught.value.distances["loop"] == pytest.approx(abs(np.linalg.norm(end - tip) - 3.0), abs=1e-9)  # closed form


def test_one_fixed_value_out_of_reach_says_where_it_would_be():
    """A triple rocker's crank held beyond its limit: the limit's closed form is what the message offers."""
    robot, loops = four_bar(2.0, 2.0, 2.2, 3.5)
    with pytest.raises(CannotAssemble, match="The fixed value prevents it"):
        assemble(rbd.State(robot, np.array([0.5, 0.5, 1.5])), loops, fixed={"crank": 2.5})


def test_a_start_too_far_away_is_refused_where_asked():
    """`within` refuses an answer that is far from the start, and carries it."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(CannotAssemble, match="the start is too far") as caught:
        assemble(rbd.State(robot, np.array([0.7, 2.0, -1.0])), loops, within=0.3)
    assert Closure(robot, loops).start(caught.value.elsewhere).residual <= 1e-12


def test_a_start_in_a_wrong_valley_says_that_another_start_closes():
    """A six-bar's start from which the distance has a true minimum: not that the loops cannot close."""
    robot, loops = six_bar()
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(60):
        try:
            assemble(rbd.State(robot, rng.uniform(-math.pi, math.pi, size=5)), loops, fixed={"crank": 0.7})
        except CannotAssemble as error:
            errors.append(error)
    assert errors
    for error in errors:
        assert error.elsewhere is not None
        assert "From another start it closes" in str(error)
        assert Closure(robot, loops, {"crank": 0.7}).start(error.elsewhere).residual <= 1e-12


def test_slider_and_crank_meet_at_their_closed_form_from_far_away():
    """X = r cos t + sqrt(l^2 - r^2 sin^2 t), from a slider a kilometre off."""
    robot, loops = slider_crank(1.0, 3.0)
    found = assemble(rbd.State(robot, np.array([0.4, -0.3, 1000.0])), loops, fixed={"crank": 0.4})
    assert abs(found.q[2] - (math.cos(0.4) + math.sqrt(9.0 - math.sin(0.4) ** 2))) < 1e-11


@pytest.mark.parametrize("kind", ["point", "revolute", "rigid"])
def test_a_free_body_is_brought_to_a_frame(kind: str, rng: np.random.Generator):
    """A free flyer closed with the ground: its origin, its axis, its whole pose; the base's quaternion stays one."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), IDENTITY, "base")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), IDENTITY)
    model.addFrame(pin.Frame("body", joint, 0, at(0.1, 0.2, 0.3), pin.FrameType.OP_FRAME))
    robot = CheckedModel(model, name="body")
    closure = rbd.LoopClosure("weld", "universe", "body", kind=kind, axis=(0.0, 0.6, 0.8))
    for _ in range(10):
        q0 = np.r_[rng.normal(size=3), pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()]
        found = assemble(rbd.State(robot, q0), [closure])
        X = rbd.State(robot, found.q).frame("body").X_WF
        assert np.abs(X.translation).max() < 1e-12
        axis = np.array([0.0, 0.6, 0.8])
        if kind != "point":
            assert np.abs(X.rotation @ axis - axis).max() < 1e-12
        if kind == "rigid":
            assert np.abs(X.rotation - np.eye(3)).max() < 1e-12
        assert abs(np.linalg.norm(found.q[3:]) - 1.0) < 1e-15
        assert found.dof == {"point": 3, "revolute": 1, "rigid": 0}[kind]


def test_joints_with_several_freedoms_are_fixed_exactly():
    """A base held at a pose, and a continuous joint at an angle beyond a turn."""
    robot = rbd.load_robot("bolt")
    foot = robot.feet(friction=None)[0]
    q0 = robot.standing().q
    touch = foot.anchored(rbd.State(robot, q0))
    base = np.array([0.01, 0.02, q0[2] - 0.03, 0.0, 0.0, 0.0, 1.0])
    found = assemble(rbd.State(robot, q0), [touch], fixed={"root_joint": base})
    assert np.array_equal(found.q[:7], base)
    four, loops = four_bar(1.0, 3.0, 2.5, 3.0, continuous=True)
    turned = assemble(at_neutral(four), loops, fixed={"crank": 0.7 + 2.0 * math.pi})
    assert np.abs(turned.q[:2] - [math.cos(0.7), math.sin(0.7)]).max() < 1e-15


def with_limits(lower: float, upper: float) -> tuple[CheckedModel, list[rbd.LoopClosure]]:
    """The four-bar, its rocker's limits given."""
    model = pin.Model()
    crank = bar(model, 0, IDENTITY, "crank", 1.0)
    bar(model, crank, at(1.0), "coupler", 3.0)
    bar(model, 0, at(3.0), "rocker", 2.5)
    robot, loops = checked(model, "four bar"), [rbd.LoopClosure("loop", "coupler_tip", "rocker_tip", kind="planar")]
    model.lowerPositionLimit[2], model.upperPositionLimit[2] = lower, upper
    return robot, loops


def test_joints_beyond_their_limits_are_reported_or_kept_within():
    """The open branch has the rocker at 1.52 rad; with limits from 1.8 to 2.4 the crank must go elsewhere."""
    robot, loops = with_limits(1.8, 2.4)
    q0 = np.array([0.7, -0.03, 1.5])
    loose = assemble(rbd.State(robot, q0), loops)
    assert [joint.joint for joint in loose.beyond_limits] == ["rocker"]
    assert loose.beyond_limits[0].value == loose.q[2] < 1.8
    assert f"rocker at {np.degrees(loose.q[2]):.2f} deg" in str(loose)
    kept = assemble(rbd.State(robot, q0), loops, within_limits=True)
    assert 1.8 - 1e-12 <= kept.q[2] <= 2.4 and not kept.beyond_limits
    assert kept.residual <= 1e-12
    by_hand = assemble(rbd.State(robot, q0), [*loops, *rbd.constraints.joint_limits(robot)])
    assert np.array_equal(by_hand.q, kept.q)


def test_couplings_and_locks_are_met():
    """Gears and locks are constraints like any other: rocker = crank + 1 and the coupler left to follow."""
    robot, loops = four_bar(2.0, 3.0, 2.5, 3.0)
    gear = rbd.JointCoupling("gear", "rocker", "crank", ratio=1.0, offset=1.0)
    found = assemble(rbd.State(robot, np.array([0.5, 0.0, 1.5])), [*loops, gear])
    assert abs(found.q[2] - found.q[0] - 1.0) < 1e-12 and found.dof == 0
    lock = rbd.JointLock("lock", "crank", position=0.4)
    assert abs(assemble(rbd.State(robot, np.array([0.5, 0.0, 1.5])), [*loops, lock]).q[0] - 0.4) < 1e-12


def test_constraints_of_velocity_alone_are_named_and_passed_over():
    """A Pfaffian row has no place to be; beside a loop it is said so, alone it is refused."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    rolls = rbd.VelocityConstraint("rolls", lambda q: np.array([[1.0, 0.0, -1.0]]))
    found = assemble(rbd.State(robot, np.array([0.7, 0.3, 1.0])), [*loops, rolls])
    assert len(found.skipped) == 1 and "'rolls'" in found.skipped[0]
    assert "'rolls'" in str(found)
    with pytest.raises(rbd.InputError, match="no constraint determines a position"):
        assemble(rbd.State(robot, np.zeros(3)), [rolls])
    with pytest.raises(rbd.InputError, match="none was given"):
        assemble(rbd.State(robot, np.zeros(3)), [])


def test_contacts_that_can_slip_are_refused():
    """Where a rubbing foot is, forces decide."""
    robot = rbd.load_robot("bolt")
    state = robot.standing()
    feet = [foot.anchored(state) for foot in robot.feet()]
    with pytest.raises(rbd.InputError, match="can slip or break"):
        assemble(state, feet)


@pytest.mark.parametrize(
    ("more", "error", "match"),
    [
        ({"fixed": {"cranck": 0.0}}, rbd.errors.JointNotFound, "nearest: 'crank'"),
        ({"fixed": {"crank": [0.0, 1.0]}}, rbd.InputError, "2 numbers"),
        ({"fixed": {"crank": math.nan}}, rbd.InputError, "not finite"),
        ({"fixed": ["crank"]}, rbd.InputError, "mapping"),
        ({"tolerance": 0.0}, rbd.InputError, "tolerance"),
        ({"within": -1.0}, rbd.InputError, "within"),
        ({"max_iterations": 0}, rbd.InputError, "max_iterations"),
    ],
)
def test_bad_arguments_are_refused_in_words(more: dict, error: type[Exception], match: str):
    """What came, what was expected, what is near."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(error, match=match):
        assemble(rbd.State(robot, np.zeros(3)), loops, **more)


def test_two_constraints_of_one_name_and_lone_ones_are_refused():
    """As `rbd.solve` does."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(rbd.errors.DuplicateName):
        assemble(rbd.State(robot, np.zeros(3)), [*loops, *loops])
    with pytest.raises(rbd.InputError, match="give a list"):
        assemble(rbd.State(robot, np.zeros(3)), loops[0])
    with pytest.raises(rbd.InputError, match="no constraint"):
        assemble(rbd.State(robot, np.zeros(3)), ["loop"])


def test_lengths_too_large_for_the_tolerance_are_told():
    """At 30 km one rounding is 4e-12 m: where 1e-12 is missed the message says so, and with its tolerance it closes."""
    scale, told = 1e4, 0
    robot, loops = four_bar(scale, 3.0 * scale, 2.5 * scale, 3.0 * scale)
    q0 = np.array([0.7, 0.3, 1.0])
    for crank in np.linspace(0.1, 1.0, 10):
        try:
            assert assemble(rbd.State(robot, q0), loops, fixed={"crank": crank}).residual <= 1e-12
        except CannotAssemble as error:
            assert "rounding of lengths" in str(error)
            given = float(str(error).split("give tolerance=")[1][:-1])
            assert assemble(rbd.State(robot, q0), loops, fixed={"crank": crank}, tolerance=given).residual <= given < 1e-7
            told += 1
    assert told


def test_the_loops_of_a_file_are_the_default():
    """None stands for `robot.loops()`; every model of ours with loops assembles from a rough start."""
    rng = np.random.default_rng(3)
    for file in ("four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"):
        robot = rbd.load_robot(URDF / f"{file}.urdf")
        assert robot.loops()
        q0 = pin.integrate(robot.model, robot.posture("assembled"), 0.2 * rng.normal(size=robot.nv))
        found = assemble(rbd.State(robot, q0))
        assert found.residual <= 1e-12
        assert max(np.abs(loop.rows(rbd.State(robot, found.q)).error).max() for loop in robot.loops()) <= 1e-12


@pytest.mark.parametrize("length", [1e-3, 1.0, 100.0])
def test_a_slide_far_away_is_reached_in_few_steps_by_small_mechanisms_as_by_large_ones(length: float, tmp_path: Path):
    """A rod on a cart, its tip pinned 300 of its lengths away: rows are asked for a dozen times at most, whatever the unit."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "cart.urdf").write_text(f"""<robot name="cart"><link name="base"/>
        <joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
        <limit lower="-1e9" upper="1e9" effort="1" velocity="1"/></joint><link name="cart">{inertial}</link>
        <joint name="crank" type="continuous"><parent link="cart"/><child link="rod"/><origin xyz="{length} 0 0"/>
        <axis xyz="0 0 1"/></joint><link name="rod">{inertial}</link>
        <joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="{length} 0 0"/></joint>
        <link name="tip"/></robot>""")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        robot = rbd.load_robot(tmp_path / "cart.urdf", root="fixed")
    pin_there = rbd.PointContact("pin", "tip", anchor=(300.0 * length, 0.5 * length, 0.0))
    asked = []

    class Counted:
        name = "pin"

        def rows(self, state: rbd.State) -> rbd.Rows:
            asked.append(state)
            return pin_there.rows(state)

    q = assemble(rbd.State(robot, np.array([0.0, np.cos(0.3), np.sin(0.3)])), [Counted()]).q
    assert np.abs(q - [(299.0 - np.sqrt(0.75)) * length, np.sqrt(0.75), 0.5]).max() < 2e-12 * max(1.0 / length, 300.0 * length)
    assert len(asked) <= 12
