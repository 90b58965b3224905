"""The checked model: names, motors, limits, and numbers that Pinocchio would not refuse."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import FrameNotFound, InputError, JointNotFound
from rbd.model.checked_model import CheckedModel


def test_motors_are_orthonormal_rows(talos: rbd.Robot) -> None:
    """S S^T = I of size nu, S^T S is a projection, and S v are the motors' rates in the order of tau."""
    S = talos.actuation
    assert S.shape == (talos.nu, talos.nv) == (32, 38)
    assert np.array_equal(S @ S.T, np.eye(talos.nu))
    v = np.arange(talos.nv, dtype=float)
    assert np.array_equal(S @ v, v[talos.actuated])
    for row, name in enumerate(talos.actuated_names):
        assert talos.model.joints[talos.joint_id(name)].idx_v == talos.actuated[row]


def test_nobody_puts_a_torque_on_the_floating_base(talos: rbd.Robot) -> None:
    """The six columns of the base in S are zero: S^T tau has no base part, whatever tau is."""
    assert np.array_equal(talos.actuation[:, :6], np.zeros((talos.nu, 6)))
    assert talos.floating


@pytest.mark.parametrize("passive", [["panda_joint2", "panda_joint5"], ("panda_joint5", "panda_joint2")])
def test_a_passive_joint_has_no_motor(passive: list[str]) -> None:
    """The size nu shrinks by the passive joints' coordinates; their columns of S vanish; S S^T stays the identity."""
    whole, robot = rbd.load_robot("panda", root="fixed"), rbd.load_robot("panda", root="fixed", passive=passive)
    assert (robot.nu, robot.nv) == (whole.nu - 2, whole.nv)
    assert np.array_equal(robot.actuation @ robot.actuation.T, np.eye(robot.nu))
    assert np.array_equal(robot.actuation, np.delete(whole.actuation, [1, 4], axis=0))
    assert np.array_equal(robot.effort_limit, np.delete(whole.effort_limit, [1, 4]))
    assert not set(passive) & set(robot.actuated_names)


def test_one_passive_joint_may_be_given_as_a_word() -> None:
    """A lone name is one joint, not a list of letters."""
    assert rbd.load_robot("panda", root="fixed", passive="panda_joint2").nu == 8


def test_a_lone_passive_joint_of_a_bare_model_is_one_joint() -> None:
    """Not a list of letters there either."""
    model = pin.buildSampleModelManipulator()
    assert CheckedModel(model, passive=model.names[1]).nu == CheckedModel(model).nu - model.joints[1].nv


def test_how_far_away_a_robot_is_is_judged_coordinate_by_coordinate() -> None:
    """90 km along each axis is taken, though that is 156 km in all; 101 km along one is not."""
    robot = rbd.load_robot(Path(__file__).parents[1] / "urdf" / "box.urdf")
    far = np.array([9e4, 9e4, 9e4, 0.0, 0.0, 0.0, 1.0])
    assert robot.at(far).com.tolist() == [9e4, 9e4, 9e4]
    with pytest.raises(InputError, match="q of box reaches 1.01e.05; at most 100000 is taken"):
        robot.at(np.array([1.01e5, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))


def test_naming_the_base_passive_changes_nothing(talos: rbd.Robot) -> None:
    """A floating base never has a motor, said or not."""
    assert rbd.load_robot("talos", passive=["root_joint"]).nu == talos.nu


def test_effort_limits_are_those_of_the_file(talos: rbd.Robot) -> None:
    """One entry a motor, as the URDF's XML has it; Talos' knees have 300 N m."""
    file = {
        joint.get("name"): float(limit.get("effort", "nan"))
        for joint in ElementTree.parse(talos.urdf).getroot().findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    assert talos.effort_limit.tolist() == [file[name] for name in talos.actuated_names]
    assert file["leg_left_4_joint"] == 300.0


def test_an_effort_limit_of_zero_is_no_limit(tmp_path: Path) -> None:
    """Files that leave a limit at zero, or have none, state none: inf, not a motor that can do nothing."""
    joint = '<joint name="{0}" type="{1}"><parent link="a"/><child link="{0}_"/>{2}</joint>'
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    link = '<link name="{}">' + inertial + "</link>"
    limits = {
        "j0": ("revolute", '<limit lower="-1" upper="1" effort="0" velocity="1"/>'),
        "j1": ("continuous", '<axis xyz="0.6 0 0.8"/>'),
        "j2": ("revolute", '<limit lower="-1" upper="1" effort="7" velocity="1"/>'),
    }
    text = link.format("a") + "".join(link.format(n + "_") + joint.format(n, kind, lim) for n, (kind, lim) in limits.items())
    (tmp_path / "mine.urdf").write_text(f'<robot name="mine">{text}</robot>')
    robot = rbd.load_robot(tmp_path / "mine.urdf", root="fixed")
    assert robot.effort_limit.tolist() == [np.inf, np.inf, 7.0]
    with pytest.raises(InputError, match="unit circle"):  # of a skew endless joint
        rbd.State(robot, [0.0, 1.0, 1.0, 0.0])  # type: ignore[arg-type]


def test_mass_is_the_sum_of_the_links(talos: rbd.Robot) -> None:
    """Talos' reduced file adds up to 90.27 kg with its base; a welded base is no moving mass."""
    moving = sum(inertia.mass for inertia in talos.model.inertias)
    assert abs(talos.mass - moving) < 1e-12
    fixed = rbd.load_robot("talos", root="fixed")
    assert abs(talos.mass - fixed.mass - talos.model.inertias[1].mass) < 1e-12


def test_frames_lists_links_and_joints(talos: rbd.Robot) -> None:
    """Every name in `frames()` is answered by `frame`, without doubles; sole links and joints are among them."""
    names = talos.frames()
    assert len(names) == len(set(names))
    assert {"left_sole_link", "leg_left_4_joint", "torso_2_link"} <= set(names)
    for name in names:
        assert talos.frame(name).name == name
    assert set(talos.joints) == set(talos.model.names) - {"universe"}


class TestTheJointTable:
    """`robot.joints`: by name, in the model's order."""

    def test_it_says_where_coordinates_stand_and_what_they_measure(self, talos: rbd.Robot) -> None:
        """Slices of q and v, unit, limits of the file."""
        knee, base = talos.joints["leg_left_4_joint"], talos.joints["root_joint"]
        at = talos.model.joints[knee.id]
        assert (knee.q, knee.v) == (slice(at.idx_q, at.idx_q + 1), slice(at.idx_v, at.idx_v + 1))
        assert (knee.nq, knee.nv, knee.unit, knee.is_angle, knee.is_continuous) == (1, 1, "rad", True, False)
        assert (knee.lower, knee.upper) == (talos.model.lowerPositionLimit[at.idx_q], talos.model.upperPositionLimit[at.idx_q])
        assert knee.effort == dict(zip(talos.actuated_names, talos.effort_limit, strict=True))[knee.name]
        assert knee.speed == talos.model.velocityLimit[at.idx_v] and knee.friction == 0.0
        assert (base.q, base.v, base.unit, base.is_angle) == (slice(0, 7), slice(0, 6), "m, rad", False)
        assert (base.lower, base.upper, base.speed, base.effort) == (-np.inf, np.inf, np.inf, np.inf)

    def test_it_goes_through_the_joints_in_order(self, talos: rbd.Robot) -> None:
        """Its slices follow each other through all of q and of v; each velocity has a name of its own."""
        joints = talos.joints
        assert list(joints) == list(talos.model.names)[1:] and len(joints) == talos.model.njoints - 1
        assert np.array_equal(np.concatenate([np.arange(talos.nq)[j.q] for j in joints.values()]), np.arange(talos.nq))
        assert np.array_equal(np.concatenate([np.arange(talos.nv)[j.v] for j in joints.values()]), np.arange(talos.nv))
        for i, coordinate in enumerate(joints.velocities):
            assert joints.velocity(coordinate.name) == slice(i, i + 1)
        assert joints.velocity("root_joint") == slice(0, 6) and joints.get("knee") is None and 3 not in joints
        assert joints.angular.tolist() == [c.unit == "rad" for c in joints.velocities]

    def test_a_name_that_is_none_is_answered_with_the_nearest(self, talos: rbd.Robot) -> None:
        """Of joints, and where a part of a joint may be meant of these too."""
        with pytest.raises(rbd.errors.JointNotFound, match="no joint 'leg_left_4' in talos; nearest: 'leg_left_4_joint'"):
            talos.joints["leg_left_4"]
        with pytest.raises(rbd.errors.JointNotFound, match="'root_joint.wz'"):
            talos.joints.velocity("root_joint.ww")
        with pytest.raises(rbd.errors.JointNotFound, match=r"no joint \[\]"):
            talos.joints[[]]  # type: ignore[index]

    def test_a_base_has_no_one_coordinate(self, talos: rbd.Robot) -> None:
        """Its x is not it."""
        q = talos.neutral()
        assert talos.joints["leg_left_4_joint"].coordinate(q) == q[10]
        with pytest.raises(rbd.InputError, match="joint 'root_joint' has 6 degrees of freedom; expected one"):
            talos.joints["root_joint"].coordinate(q)

    def test_it_is_printed_as_a_table(self) -> None:
        """One line a joint; a joint alone says the same."""
        bar = rbd.mechanism.slider_crank(0.3, 1.0)
        assert str(bar.joints).splitlines()[0] == "3 joints of slider_crank" and len(str(bar.joints).splitlines()) == 4
        assert "slider_joint  prismatic along x " in repr(bar.joints)
        panda = rbd.load_robot("panda", root="fixed").joints["panda_joint4"]
        assert repr(panda) == "Joint('panda_joint4', revolute about z, q[3:4], v[3:4], rad, -3.072 to -0.0698, at most 87 N m)"

    def test_a_slide_inside_a_joint_made_of_joints_is_a_length(self) -> None:
        """A composite of a slide and a ball: metres, then radians."""
        model = pin.Model()
        joint = model.addJoint(0, _composite(pin.JointModelSpherical()), pin.SE3.Identity(), "both")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
        both = CheckedModel(model).joints["both"]
        assert both.unit == "m, rad" and [c.unit for c in both.velocities] == ["m", "rad", "rad", "rad"]


def test_of_a_link_and_a_joint_of_one_name_the_link_is_meant(tmp_path: Path) -> None:
    """The link `hand` hangs 3 m below the joint `hand`'s other bodies: `frame` gives the link's."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    text = (
        f'<robot name="r"><link name="a">{inertial}</link><link name="b">{inertial}</link><link name="hand">{inertial}</link>'
        f'<joint name="hand" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
        '<joint name="weld" type="fixed"><parent link="b"/><child link="hand"/><origin xyz="0 0 -3"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(text)
    robot = rbd.load_robot(tmp_path / "r.urdf", root="fixed")
    assert robot.at().frame("hand").X_WF.translation.tolist() == [0.0, 0.0, -3.0]


@pytest.mark.parametrize("name", ["left_sol_link", "LEFT_SOLE_LINK", "leftsole", None, 7, ["left_sole_link"], "", "universal"])
def test_an_unknown_frame_is_refused_with_the_nearest(talos: rbd.Robot, name: object) -> None:
    """Unknown ids crash Pinocchio: no unknown name gets to it, and a near miss is told what was meant."""
    for ask in (talos.frame, talos.frame_id):
        with pytest.raises(FrameNotFound, match=r"no frame .* in talos; .*See robot\.frames\(\)\.") as caught:
            ask(name)  # type: ignore[arg-type]
    if isinstance(name, str) and name.startswith("left"):
        assert "'left_sole_link'" in str(caught.value)


@pytest.mark.parametrize("name", ["leg_left_4", "universe", None, 3, {}])
def test_an_unknown_joint_is_refused_with_the_nearest(talos: rbd.Robot, name: object) -> None:
    """As for frames; the universe is no joint."""
    with pytest.raises(JointNotFound, match=r"no joint .* in talos; ") as caught:
        talos.joint_id(name)  # type: ignore[arg-type]
    if name == "leg_left_4":
        assert "'leg_left_4_joint'" in str(caught.value)
    with pytest.raises(JointNotFound):
        rbd.load_robot("talos", passive=[name])  # type: ignore[list-item]


def test_a_quaternion_a_little_off_is_normalised(talos: rbd.Robot) -> None:
    """Norms within 1e-6 of one are rounding: the state's quaternion is exactly unit, the user's array untouched."""
    q = talos.standing().q.copy()
    q[3:7] *= 1.0 + 1e-7
    given = q.copy()
    state = rbd.State(talos, q)
    assert abs(np.linalg.norm(state.q[3:7]) - 1.0) < 1e-15
    assert np.array_equal(q, given)
    assert np.abs(state.q - talos.standing().q).max() < 1e-15


@pytest.mark.parametrize("scale", [1.0 + 1e-5, 1.0 - 1e-5, 0.0, -2.0])
def test_a_quaternion_off_the_unit_sphere_is_refused(talos: rbd.Robot, scale: float) -> None:
    """Norms further off than 1e-6 are mistakes: Pinocchio would shear the robot (det R = 1.05) and say nothing."""
    q = talos.standing().q.copy()
    q[3:7] *= scale
    with pytest.raises(InputError, match=r"q\[3:7\] has the quaternion .* norm .*; expected norm 1 to 1e-06"):
        rbd.State(talos, q)


def test_an_endless_joint_wants_a_unit_circle() -> None:
    """A continuous joint's (cos, sin) is checked as a quaternion is."""
    robot = rbd.load_robot("tiago_dual", root="fixed")
    joint = next(j for j in robot.model.joints if j.nq == 2 and j.nv == 1)
    q = robot.neutral()
    q[joint.idx_q] = 1.01
    with pytest.raises(InputError, match="unit circle"):
        rbd.State(robot, q)
    q[joint.idx_q : joint.idx_q + 2] = [0.6, 0.8]
    assert np.array_equal(rbd.State(robot, q).q, q)


@pytest.mark.parametrize(
    ("joint", "block"),
    [
        (pin.JointModelSpherical(), (0, 4)),
        (pin.JointModelPlanar(), (2, 4)),
        (pin.JointModelRUBX(), (0, 2)),
    ],
)
def test_every_kind_of_unit_block_is_checked(joint: pin.JointModel, block: tuple[int, int]) -> None:
    """Joints whose coordinates live on a sphere or a circle are refused off it, alone and inside a composite."""
    for wrapped, shift in ((joint, 0), (_composite(joint), 1)):
        model = pin.Model()
        body = model.addJoint(0, wrapped, pin.SE3.Identity(), "j")
        model.appendBodyToJoint(body, pin.Inertia.Random(), pin.SE3.Identity())
        robot = CheckedModel(model, name="made")
        q = pin.neutral(model)
        rbd.State(robot, q)
        q[block[0] + shift : block[1] + shift] *= 1.001
        with pytest.raises(InputError, match="norm"):
            rbd.State(robot, q)


def _composite(joint: pin.JointModel) -> pin.JointModel:
    out = pin.JointModelComposite()
    out.addJoint(pin.JointModelPX())
    out.addJoint(joint)
    return out


@pytest.mark.parametrize("what", ["q", "v", "tau"])
def test_sizes_are_checked_before_pinocchio(talos: rbd.Robot, what: str) -> None:
    """One number too few or too many, a column or a scalar: refused with both shapes."""
    check = {"q": talos.check_q, "v": talos.check_v, "tau": talos.check_tau}[what]
    size = {"q": talos.nq, "v": talos.nv, "tau": talos.nu}[what]
    for shape in ((size - 1,), (size + 1,), (size, 1), (1, size), (), (0,)):
        with pytest.raises(InputError, match=rf"{what} of talos has shape .*expected \({size},\)"):
            check(np.ones(shape))


def test_a_tau_with_the_base_in_it_is_told_so(talos: rbd.Robot) -> None:
    """The most common mistake, tau of size nv, is answered with the reason."""
    with pytest.raises(InputError, match="tau has no entry for the floating base"):
        talos.check_tau(np.zeros(talos.nv))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("what", ["q", "v", "tau"])
def test_nan_and_infinity_are_refused_where_they_stand(talos: rbd.Robot, what: str, bad: float) -> None:
    """The message has the index and the number."""
    check = {"q": talos.check_q, "v": talos.check_v, "tau": talos.check_tau}[what]
    value = talos.standing().q.copy() if what == "q" else np.zeros(talos.nv if what == "v" else talos.nu)
    value[9] = bad
    with pytest.raises(InputError, match=rf"{what} of talos is not finite at \(9,\): {bad}"):
        check(value)


def test_what_is_checked_is_a_copy(talos: rbd.Robot) -> None:
    """Checked arrays are new: what the user does to his own afterwards changes nothing."""
    for check, value in ((talos.check_v, np.ones(talos.nv)), (talos.check_tau, np.ones(talos.nu))):
        out = check(value)
        value[:] = 7.0
        assert np.array_equal(out, np.ones(len(out)))


def test_lists_and_whole_numbers_are_numbers(talos: rbd.Robot) -> None:
    """A list of integers gives floats."""
    out = talos.check_v([1] * talos.nv)  # type: ignore[arg-type]
    assert out.dtype == float and np.array_equal(out, np.ones(talos.nv))


def test_joints_that_are_not_depth_first_are_refused():
    """Pinocchio's algorithms take a subtree for a block of columns; M would be wrong without a word."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "arm")
    other = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "other")
    hand = model.addJoint(arm, pin.JointModelRX(), pin.SE3.Identity(), "hand")
    for joint in (arm, other, hand):
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    with pytest.raises(rbd.errors.ModelError, match=r"depth-first: below 'arm' stand the numbers \[1, 3\]"):
        CheckedModel(model)
