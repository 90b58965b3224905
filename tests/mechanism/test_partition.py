"""Unknown rates and accelerations from known ones, as in the four-bar's text, and where that ends."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from planar_models import IDENTITY, at, four_bar, four_bar_angles, six_bar, slider_crank

import rbd
from rbd.errors import SingularPose
from rbd.mechanism import acceleration_partition, assemble, independent_velocities, velocity_partition
from rbd.mechanism.constraint_error import independent_columns
from rbd.model.checked_model import CheckedModel

URDF = Path(__file__).parents[2] / "urdf"
Loops = list[rbd.LoopClosure]


def posed(a: float, b: float, c: float, d: float, crank: float, branch: int = 0) -> tuple[rbd.State, Loops]:
    """A four-bar in closed form; branch 0 is the open one."""
    robot, loops = four_bar(a, b, c, d)
    coupler, rocker = four_bar_angles(a, b, c, d, crank)[branch]
    return rbd.State(robot, np.array([crank, coupler - crank, rocker])), loops


def test_nortons_rates_and_accelerations():
    """Crank rate 25, acceleration 15: (coupler, rocker) rates (-4.1209, 6.9980), accelerations (296.089, 470.134)."""
    state, loops = posed(40.0, 120.0, 80.0, 100.0, math.radians(40.0))
    velocity = velocity_partition(state, loops, {"crank": 25.0})
    rates = [velocity.v[0] + velocity.v[1], velocity.v[2]]  # from the ground
    assert np.abs(np.array(rates) - [-4.1209, 6.9980]).max() < 5.1e-5
    moving = state.with_velocity(velocity.v)
    acceleration = acceleration_partition(moving, loops, {"crank": 15.0})
    found = [acceleration.a[0] + acceleration.a[1], acceleration.a[2]]
    assert np.abs(np.array(found) - [296.089, 470.134]).max() < 5.1e-4
    assert velocity.rates == {"coupler": velocity.v[1], "rocker": velocity.v[2]}
    assert acceleration.accelerations == {"coupler": acceleration.a[1], "rocker": acceleration.a[2]}
    assert velocity.residual < 1e-9 and acceleration.residual < 1e-7


def test_rates_of_the_rhombus():
    """Open: the rocker turns with the crank, the coupler not at all; folded: the coupler with the crank, the rocker not."""
    for branch in four_bar_angles(1.0, 1.0, 1.0, 1.0, math.radians(30.0)):
        robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
        state = rbd.State(robot, np.array([math.radians(30.0), branch[0] - math.radians(30.0), branch[1]]))
        v = velocity_partition(state, loops, {"crank": 1.0}).v
        opened = abs(branch[0]) < 1e-9
        assert np.abs(np.array([v[0] + v[1], v[2]]) - ([0.0, 1.0] if opened else [1.0, 0.0])).max() < 1e-12


def test_j2_is_the_texts_and_its_determinant_too():
    """|det J2| = L2 L3 |sin(th3 - th2)|, and the columns are the text's, up to the closing convention's sign."""
    crank = math.radians(40.0)
    for branch in (0, 1):
        state, loops = posed(40.0, 120.0, 80.0, 100.0, crank, branch)
        coupler, rocker = four_bar_angles(40.0, 120.0, 80.0, 100.0, crank)[branch]
        found = velocity_partition(state, loops, {"crank": 1.0}).columns
        assert found.known == ("crank",) and found.unknown == ("coupler", "rocker")
        assert found.volume == pytest.approx(120.0 * 80.0 * abs(math.sin(rocker - coupler)), rel=1e-12)
        links = np.array([[-math.sin(coupler), math.sin(rocker)], [math.cos(coupler), -math.cos(rocker)]])
        s = np.linalg.svd(links * [120.0, 80.0], compute_uv=False)
        assert np.abs(np.linalg.svd(found.J_unknown, compute_uv=False) - s).max() < 1e-10
        assert found.condition == pytest.approx(s[0] / s[1], rel=1e-12)
        assert found.rank == 2 and found.sigma_min == pytest.approx(s[1], rel=1e-12)
        assert np.abs(found.influence[:, 0] - velocity_partition(state, loops, {"crank": 1.0}).v[1:]).max() < 1e-12


def test_rates_are_the_derivatives_of_positions():
    """Assembled before and after, the six-bar's joints have moved by rate times time, to second order."""
    robot, loops = six_bar()
    q = assemble(rbd.State(robot, np.array([0.7, 0.0, 1.5, -1.7, 1.8])), loops, fixed={"crank": 0.7}).q
    h = 1e-4
    ahead, back = (assemble(rbd.State(robot, q), loops, fixed={"crank": 0.7 + e}).q for e in (h, -h))
    state = rbd.State(robot, q)
    velocity = velocity_partition(state, loops, {"crank": 1.0})
    assert np.abs((ahead - back) / (2.0 * h) - velocity.v).max() < 1e-6
    acceleration = acceleration_partition(state.with_velocity(velocity.v), loops, {"crank": 0.0})
    assert np.abs((ahead - 2.0 * q + back) / h**2 - acceleration.a).max() < 1e-3


def test_the_sliders_speed_is_its_closed_form():
    """X' = -r sin t t' - r^2 sin t cos t t' / sqrt(l^2 - r^2 sin^2 t)."""
    robot, loops = slider_crank(1.0, 3.0)
    t, w = 0.6, 2.0
    root = math.sqrt(9.0 - math.sin(t) ** 2)
    q = assemble(rbd.State(robot, np.array([t, -0.5, 3.5])), loops, fixed={"crank": t}).q
    rates = velocity_partition(rbd.State(robot, q), loops, {"crank": w}).rates
    assert rates["slider"] == pytest.approx(-math.sin(t) * w - math.sin(t) * math.cos(t) * w / root, abs=1e-12)


def test_any_joint_may_be_the_known_one():
    """Rates from the rocker's, given that of the crank's motion, are the crank's motion."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    v = velocity_partition(state, loops, {"crank": 1.0}).v
    assert np.abs(velocity_partition(state, loops, {"rocker": v[2]}).v - v).max() < 1e-12
    both = {"rocker": v[2], "crank": 1.0}  # one too many, agreeing
    assert np.abs(velocity_partition(state, loops, both).v - v).max() < 1e-12


def test_links_in_line_are_refused_with_the_reason():
    """At the rocker's limit crank and coupler are in line: driven by the rocker, J2 is singular; by the crank it is not."""
    a, b, c, d = 1.0, 3.0, 2.5, 3.0
    rocker = math.pi - math.acos((c * c + d * d - (a + b) ** 2) / (2.0 * c * d))
    pin_at = np.array([d + c * math.cos(rocker), c * math.sin(rocker)])
    crank = math.atan2(pin_at[1], pin_at[0])
    robot, loops = four_bar(a, b, c, d)
    state = rbd.State(robot, np.array([crank, 0.0, rocker]))
    with pytest.raises(SingularPose, match="'rocker'.*do not decide those of 'crank', 'coupler': J2 is singular") as caught:
        velocity_partition(state, loops, {"rocker": 1.0})
    assert "The pose itself" not in str(caught.value)
    rates = velocity_partition(state, loops, {"crank": 1.0}).rates
    assert abs(rates["rocker"]) < 1e-12  # at its limit it stands still
    with pytest.raises(SingularPose):
        acceleration_partition(state.with_velocity(np.zeros(3)), loops, {"rocker": 0.0})


@pytest.mark.parametrize("crank", [0.0, math.pi])
def test_a_flat_rhombus_is_singular_as_a_pose(crank: float):
    """All links in line: two degrees of freedom at this pose, and the message says so."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    state = rbd.State(robot, np.array([crank, -crank, crank]))
    with pytest.raises(SingularPose, match="The pose itself is singular: 2 degrees of freedom and 1 known rate"):
        velocity_partition(state, loops, {"crank": 1.0})
    assert len(independent_velocities(state, loops)) == 2


def test_a_pose_that_is_singular_only_to_rounding_is_refused_too():
    """Assembled to 1e-12 a stretched rhombus is known to 1e-6: rates of 1e6 would be rounding, and are not given."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    q = assemble(rbd.State(robot, np.array([math.pi, -3.0, 3.0])), loops, fixed={"crank": math.pi}).q
    with pytest.raises(SingularPose):
        velocity_partition(rbd.State(robot, q), loops, {"crank": 1.0})


def test_too_few_rates_are_refused_with_enough():
    """A five-bar has two degrees of freedom; with one rate known the message names a set that does, and it does."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    with pytest.raises(rbd.InputError, match="1 degree of freedom and 0 known rates"):
        velocity_partition(state, loops, {})
    robot = rbd.load_robot(URDF / "five_bar.urdf")
    five = robot.at("assembled")
    with pytest.raises(rbd.InputError, match=r"2 degrees of freedom and 1 known rate; .* e.g. ") as caught:
        velocity_partition(five, None, {"left_crank_joint": 1.0})
    names = [name for name in robot.joints if f"{name!r}" in str(caught.value).split("e.g. ")[1]]
    assert "left_crank_joint" in names and len(names) == 2
    assert velocity_partition(five, None, dict.fromkeys(names, 1.0)).residual < 1e-12


def test_rates_that_contradict_each_other_are_refused_with_what_would_agree():
    """Crank 1 makes the rocker's rate known; another is refused, and the message gives the right ones."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    right = velocity_partition(state, loops, {"crank": 1.0}).rates["rocker"]
    with pytest.raises(rbd.InputError, match="contradict each other") as caught:
        velocity_partition(state, loops, {"crank": 1.0, "rocker": 0.9})
    assert f"'rocker' at {right:.6f}".rstrip("0") in str(caught.value)


def test_accelerations_want_a_velocity_that_the_loops_allow():
    """A velocity that opens the loop is refused, with the way to a right one."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    with pytest.raises(rbd.InputError, match="breaks 'loop' by"):
        acceleration_partition(state.with_velocity(np.array([1.0, 0.0, 0.0])), loops, {"crank": 0.0})


def test_a_state_that_is_not_assembled_is_refused():
    """A millimetre off is no pose of the mechanism."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    off = rbd.State(state.robot, state.q + [0.0, 0.0, 1e-3])
    with pytest.raises(rbd.InputError, match="not assembled: 'loop' is off by"):
        velocity_partition(off, loops, {"crank": 1.0})


def lift() -> tuple[CheckedModel, rbd.PointContact]:
    """A free point held on a lift that rises at 0.5 m/s and speeds up by 0.2 m/s2."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelTranslation(), IDENTITY, "point")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), IDENTITY)
    model.addFrame(pin.Frame("tip", joint, 0, at(0.0), pin.FrameType.OP_FRAME))
    contact = rbd.PointContact("lift", "tip", on=rbd.Ground(velocity=(0.0, 0.0, 0.5), acceleration=(0.0, 0.0, 0.2)))
    return CheckedModel(model, name="point"), contact


def test_what_moves_by_itself_moves_the_mechanism():
    """J v = u: a point on a lift rises with it, without any known rate."""
    robot, contact = lift()
    state = rbd.State(robot, np.zeros(3), np.array([1.0, 2.0, 3.0]))
    velocity = velocity_partition(state, [contact], {})
    assert np.abs(velocity.v - [0.0, 0.0, 0.5]).max() < 1e-15
    acceleration = acceleration_partition(state.with_velocity(velocity.v), [contact], {})
    assert np.abs(acceleration.a - [0.0, 0.0, 0.2]).max() < 1e-15
    with pytest.raises(rbd.InputError, match="contradict"):
        velocity_partition(state, [contact], {"point": [0.0, 0.0, 0.4]})


def test_rolling_decides_velocities_too():
    """A unicycle: forward speed is radius times the wheel's rate, sideways zero; heading and wheel are independent."""
    robot = rbd.load_robot(URDF / "unicycle.urdf")
    state = robot.at()
    names = independent_velocities(state)
    assert set(names) == {"root_joint.wz", "wheel_joint"}
    rates = velocity_partition(state, None, {"root_joint.wz": 0.3, "wheel_joint": 2.0}).rates
    (wheel,) = robot.wheels()
    assert rates["root_joint.vx"] == pytest.approx(2.0 * wheel.radius, abs=1e-14)
    assert rates["root_joint.vy"] == pytest.approx(0.0, abs=1e-14)


def test_joints_with_several_velocities_are_known_whole_or_in_part():
    """A vector for the joint, a number for one of its entries, "joint.wz"; both at once is refused."""
    robot = rbd.load_robot(URDF / "unicycle.urdf")
    state = robot.at()
    part = velocity_partition(state, None, {"root_joint.wz": 0.3, "wheel_joint": 2.0})
    whole = velocity_partition(state, None, {"root_joint": part.v[:3]})
    assert np.abs(whole.v - part.v).max() < 1e-12
    with pytest.raises(rbd.InputError, match="given twice"):
        velocity_partition(state, None, {"root_joint": part.v[:3], "root_joint.wz": 0.3})
    with pytest.raises(rbd.InputError, match="shape"):
        velocity_partition(state, None, {"root_joint": 1.0})
    with pytest.raises(rbd.errors.JointNotFound, match="'root_joint.wz'"):
        velocity_partition(state, None, {"root_joint.wx": 1.0})
    with pytest.raises(rbd.errors.JointNotFound, match="wheel_joint"):
        velocity_partition(state, None, {"weel_joint": 1.0})


@pytest.mark.parametrize("file", ["four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"])
def test_independent_velocities_decide_all_others(file: str):
    """As many as n - rank J, and velocity_partition takes them, better conditioned than 100."""
    robot = rbd.load_robot(URDF / f"{file}.urdf")
    state = robot.at("assembled")
    names = independent_velocities(state)
    J = np.vstack([loop.rows(state).J for loop in robot.loops()])
    assert len(names) == robot.nv - np.linalg.matrix_rank(J)
    found = velocity_partition(state, None, dict.fromkeys(names, 1.0))
    assert found.residual < 1e-12 and found.condition < 100.0


def test_preferred_velocities_are_independent_where_they_can_be():
    """The crank, where it decides all; at the rocker's limit not the rocker."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    for joint in state.robot.joints:
        assert independent_velocities(state, loops, prefer=[joint]) == (joint,)
    robot = rbd.load_robot(URDF / "parallel_leg.urdf")
    at_home = robot.at("assembled")
    assert set(independent_velocities(at_home, prefer=robot.actuated_names)) <= set(robot.actuated_names)
    with pytest.raises(rbd.InputError, match="prefer"):
        independent_velocities(state, loops, prefer="crank")
    with pytest.raises(rbd.errors.JointNotFound):
        independent_velocities(state, loops, prefer=["cranck"])


def test_columns_are_chosen_as_pivoted_qr_does(rng: np.random.Generator):
    """The dependent ones span the rows' space, whatever is preferred; no columns and no rows are no trouble."""
    for _ in range(20):
        J = rng.normal(size=(5, 3)) @ rng.normal(size=(3, 6))
        left = independent_columns(J)
        taken = [i for i in range(6) if i not in left]
        assert len(left) == 3 and np.linalg.matrix_rank(J[:, taken]) == 3
        last = np.zeros(6, bool)
        last[rng.integers(6)] = True
        assert int(np.flatnonzero(last)[0]) in independent_columns(J, last)
    assert independent_columns(np.zeros((0, 2))) == [0, 1]
    assert independent_columns(np.zeros((2, 2))) == [0, 1]


def test_contacts_that_can_slip_are_refused_and_stops_passed_over():
    """Friction: forces decide. A stop that is touched holds nothing by itself."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    stop = rbd.JointLimit("stop", "rocker", lower=float(state.q[2]), upper=3.0)
    v = velocity_partition(state, loops, {"crank": -1.0}).v
    assert len(stop.rows(state)) == 1 and np.array_equal(velocity_partition(state, [*loops, stop], {"crank": -1.0}).v, v)
    slips = rbd.PointContact("rub", "rocker_tip", friction=0.5)
    with pytest.raises(rbd.InputError, match="can slip or break"):
        velocity_partition(state, [*loops, slips], {"crank": 1.0})


def test_tables_name_what_was_found():
    """One line a velocity, with the condition number above."""
    state, loops = posed(1.0, 3.0, 2.5, 3.0, 0.7)
    velocity = velocity_partition(state, loops, {"crank": 1.0})
    assert "1 known, 2 unknown, condition" in str(velocity) and f"{velocity.rates['rocker']:.6g}" in str(velocity)
    moving = state.with_velocity(velocity.v)
    acceleration = acceleration_partition(moving, loops, {"crank": 0.0})
    assert "acceleration" in str(acceleration) and acceleration.condition == velocity.condition and acceleration.rank == 2


def test_every_joint_that_can_move_is_named_where_nothing_is_known():
    """A five-bar has two degrees of freedom, and all four of its joints take part in them."""
    robot = rbd.load_robot("five_bar")
    names = ", ".join(f"'{name}'" for name in robot.joints)
    with pytest.raises(rbd.InputError, match=f"2 degrees of freedom and 0 known rates; {names} can move"):
        velocity_partition(robot.at("assembled"), robot.loops(), {})


def test_rates_that_agree_are_taken_however_large():
    """Two known rates of 1e7 rad/s that agree to twelve digits are no contradiction."""
    robot = rbd.load_robot("four_bar")
    state, names = robot.at("assembled"), list(robot.joints)
    v = velocity_partition(state, robot.loops(), {names[0]: 1.0}).v
    fast = velocity_partition(state, robot.loops(), {names[0]: 1e7, names[2]: 1e7 * float(v[2]) * (1.0 + 1e-12)}).v
    assert np.abs(1e-7 * fast - v).max() < 1e-11
