"""Constraints on joints: stops, locks, gears, dry friction."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.problem.rows import Rows
from rbd.testing import check_constraint

G = 9.81
ROBOTS = ["talos", "tiago", "panda", "ur5"]
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver(law="coulomb")]
IDENTITY = pin.SE3.Identity()


def at_point(mass: float, x: float, z: float) -> pin.Inertia:
    """A point mass in the plane of the pendulums."""
    return pin.Inertia(mass, np.array([x, 0.0, z]), np.zeros((3, 3)))


def pendulum(mass: float = 2.0, length: float = 0.5) -> CheckedModel:
    """A point mass on a bar: q is the angle from hanging, growing towards -x."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), IDENTITY, "hinge")
    model.appendBodyToJoint(joint, at_point(mass, 0.0, -length), IDENTITY)
    return CheckedModel(model, name="pendulum")


def two_bars() -> CheckedModel:
    """Shoulder and elbow: 3 kg at the end of 0.4 m, 1 kg at the end of 0.7 m more."""
    model = pin.Model()
    shoulder = model.addJoint(0, pin.JointModelRY(), IDENTITY, "shoulder")
    model.appendBodyToJoint(shoulder, at_point(3.0, 0.0, -0.4), IDENTITY)
    elbow = model.addJoint(shoulder, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.4])), "elbow")
    model.appendBodyToJoint(elbow, at_point(1.0, 0.0, -0.7), IDENTITY)
    return CheckedModel(model, name="two bars")


def wheels(*inertias: float, kind: type = pin.JointModelRZ) -> CheckedModel:
    """Wheels on axles of their own, vertical: gravity does nothing to them."""
    model = pin.Model()
    for i, inertia in enumerate(inertias):
        joint = model.addJoint(0, kind(), pin.SE3(np.eye(3), np.array([float(i), 0.0, 0.0])), f"wheel{i}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), inertia * np.eye(3)), IDENTITY)
    return CheckedModel(model, name="wheels")


def joints_of_every_kind() -> CheckedModel:
    """A chain: free flyer, planar, spherical, Euler angles, three sliders, continuous, helical, and two in one."""
    model, parent = pin.Model(), 0
    both = pin.JointModelComposite()
    both.addJoint(pin.JointModelRX())
    both.addJoint(pin.JointModelSpherical())
    chain = {
        "base": pin.JointModelFreeFlyer(),
        "plane": pin.JointModelPlanar(),
        "ball": pin.JointModelSpherical(),
        "euler": pin.JointModelSphericalZYX(),
        "sliders": pin.JointModelTranslation(),
        "turntable": pin.JointModelRUBY(),
        "screw": pin.JointModelHX(0.1),
        "slider": pin.JointModelPZ(),
        "both": both,
    }
    for name, kind in chain.items():
        parent = model.addJoint(parent, kind, pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3])), name)
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), IDENTITY)
    return CheckedModel(model, name="chain")


def part(robot: CheckedModel, joint: str, q: np.ndarray) -> np.ndarray:
    """A joint's part of q."""
    found = robot.model.joints[robot.joint_id(joint)]
    return q[found.idx_q : found.idx_q + found.nq]


def column(robot: CheckedModel, joint: str) -> int:
    """Where a joint's velocity stands in v."""
    return int(robot.model.joints[robot.joint_id(joint)].idx_v)


def drawn(robot: CheckedModel, rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """A configuration that is nothing special."""
    return pin.integrate(robot.model, pin.neutral(robot.model), size * rng.normal(size=robot.nv))


class TestLimit:
    """A stop pushes back, and never pulls."""

    @pytest.mark.parametrize("name", ROBOTS)
    def test_every_limit_of_a_robot_describes_its_motion(self, name):
        """Both sides, the joint well beyond its bound; `error` is the distance to it."""
        robot = rbd.load_robot(name, root="fixed")
        for limit in rbd.constraints.joint_limits(robot):
            for side, bound, out in zip(("lower", "upper"), limit.bounds(robot), (-0.3, 0.3), strict=True):
                q = robot.neutral()
                q[robot.model.joints[robot.joint_id(limit.joint)].idx_q] = bound + out
                state = robot.at(q)
                assert limit.side(state) == side and limit.rows(state).error == pytest.approx([-0.3], abs=1e-12)
                report = check_constraint(limit, state, draws=1)
                assert report.rows == 1 and report.against == "motion of the error" and report.jacobian < 1e-9

    @pytest.mark.parametrize("solver", SOLVERS)
    @pytest.mark.parametrize(("side", "sign"), [("lower", 1.0), ("upper", -1.0)])
    def test_a_pendulum_leans_on_its_stop(self, solver, side, sign):
        """At 40 deg the stop carries m g l sin q less what the motor lifts; the motor's share beyond that opens it."""
        robot, q = pendulum(2.0, 0.5), sign * math.radians(40.0)
        weight = 2.0 * G * 0.5 * math.sin(abs(q))
        stop = rbd.JointLimit("stop", "hinge", **{side: q})
        state = rbd.State(robot, np.array([q]))
        for lift in (0.0, 0.4 * weight, weight, 1.5 * weight):
            s = rbd.solve(state, np.array([sign * lift]), [stop], solver=solver)
            push = max(0.0, weight - lift)
            assert s.forces["stop"] == pytest.approx([push], abs=1e-9)
            assert s.problem.J.T @ s.multipliers == pytest.approx([sign * push], abs=1e-9)  # negative at an upper bound
            assert s.a == pytest.approx([sign * max(0.0, lift - weight) / (2.0 * 0.5**2)], abs=1e-9)

    def test_away_from_its_bounds_it_has_no_rows(self, talos):
        """Zero rows of width nv, not None; the answer is that without it, by KKT too. Closed grippers are at theirs."""
        tau, limits, q = np.zeros(talos.nu), rbd.constraints.joint_limits(talos), talos.standing().q.copy()
        assert [x.joint for x in limits if x.side(talos.at(q)) == "upper"] == ["gripper_left_joint", "gripper_right_joint"]
        for gripper in ("gripper_left_joint", "gripper_right_joint"):
            q[talos.model.joints[talos.joint_id(gripper)].idx_q] = -0.1
        state = talos.at(q)
        assert all(limit.rows(state).J.shape == (0, talos.nv) and limit.side(state) == "" for limit in limits)
        for solver in (rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver(law="coulomb")):
            bare, limited = (rbd.solve(state, tau, [*talos.soles(None), *more], solver=solver) for more in ([], limits))
            assert np.abs(bare.a - limited.a).max() < 1e-9
            assert limited.forces[limits[0].name].shape == (0,) and limits[0].name not in str(limited)

    @pytest.mark.parametrize(("q", "active"), [(0.3, True), (0.3 + 0.9e-4, True), (0.3 + 1.1e-4, False), (0.1, True)])
    def test_the_margin_says_how_near_is_there(self, q, active):
        """Within the margin and anywhere beyond the bound."""
        stop = rbd.JointLimit("stop", "hinge", lower=0.3, margin=1e-4)
        assert len(stop.rows(rbd.State(pendulum(), np.array([q])))) == active

    def test_a_joint_that_leaves_its_stop_feels_nothing(self):
        """Swinging away at 1 rad/s: free, by any law; swinging into it wants an impact, and is refused by name."""
        robot, q = pendulum(), np.array([0.5])
        stop = rbd.JointLimit("stop", "hinge", lower=0.5)
        for solver in SOLVERS:
            with pytest.warns(rbd.errors.OpeningContactWarning, match="'stop' at 1 m/s"):
                s = rbd.solve(rbd.State(robot, q, np.array([1.0])), np.zeros(1), [stop], solver=solver)
            assert s.forces["stop"] == pytest.approx([0.0]) and s.a == pytest.approx([-G / 0.5 * math.sin(0.5)])
            with pytest.raises(rbd.errors.ContactMoves, match="'stop' approaches at 1 m/s: an impact"):
                rbd.solve(rbd.State(robot, q, np.array([-1.0])), np.zeros(1), [stop], solver=solver)

    def test_a_range_of_nothing_holds_from_both_sides(self):
        """Equal bounds, two rows: the pendulum stays, whichever way it is pushed."""
        stop, state = rbd.JointLimit("stop", "hinge", lower=0.2, upper=0.2), rbd.State(pendulum(), np.array([0.2]))
        assert stop.side(state) == "both"
        for push in (-30.0, 30.0):
            s = rbd.solve(state, np.array([push]), [stop])
            assert s.a == pytest.approx([0.0], abs=1e-9) and s.forces["stop"].min() >= 0.0
            net = push - 2.0 * G * 0.5 * math.sin(0.2)
            assert s.forces["stop"] @ [1.0, -1.0] == pytest.approx(-net)

    def test_bounds_come_from_the_file_unless_given(self, talos):
        """Each side by itself; infinity takes one away."""
        knee = "leg_left_4_joint"
        low, high = rbd.JointLimit("knee", knee).bounds(talos)
        at = talos.model.joints[talos.joint_id(knee)].idx_q
        assert (low, high) == (talos.model.lowerPositionLimit[at], talos.model.upperPositionLimit[at])
        assert rbd.JointLimit("knee", knee, lower=0.1).bounds(talos) == (0.1, high)
        assert rbd.JointLimit("knee", knee, upper=math.inf).bounds(talos) == (low, math.inf)

    def test_the_list_of_a_robot_has_every_bound_once(self):
        """Tiago: all joints but its base and the two wheels, which turn for ever."""
        tiago = rbd.load_robot("tiago")
        named = {limit.joint for limit in rbd.constraints.joint_limits(tiago, margin=1e-3)}
        one = {n for n in tiago.joints if tiago.model.joints[tiago.joint_id(n)].nv == 1}
        assert one - named == {"wheel_left_joint", "wheel_right_joint"} and named < one
        assert {limit.margin for limit in rbd.constraints.joint_limits(tiago, margin=1e-3)} == {1e-3}

    def test_joints_without_a_bound_are_refused(self):
        """One that turns for ever, one with several degrees of freedom, one whose file states nothing; with what to do."""
        chain = joints_of_every_kind()
        state = rbd.State(chain, pin.neutral(chain.model))
        for joint, said in (
            ("turntable", "is continuous.*JointLock"),
            ("ball", "has 3 degrees of freedom; expected a joint with one"),
            ("slider", "has no bound.*Give lower= or upper="),
        ):
            with pytest.raises(rbd.InputError, match=said):
                rbd.JointLimit("stop", joint).rows(state)
        assert rbd.constraints.joint_limits(chain) == []
        assert rbd.JointLimit("stop", "slider", upper=0.0).side(state) == "upper"
        with pytest.raises(rbd.InputError, match="lower bound 9 above its upper one"):
            rbd.JointLimit("stop", "leg_left_4_joint", lower=9.0).bounds(rbd.load_robot("talos"))


class TestLock:
    """A joint that is held."""

    @pytest.mark.parametrize("joint", list(joints_of_every_kind().joints))
    @pytest.mark.parametrize("seed", range(3))
    def test_every_kind_of_joint_describes_its_motion(self, joint, seed):
        """Held where it is, and measured from a position far away: J and J_dot v are those of the error."""
        robot, rng = joints_of_every_kind(), np.random.default_rng(seed)
        state = rbd.State(robot, drawn(robot, rng))
        nv = robot.model.joints[robot.joint_id(joint)].nv
        assert check_constraint(rbd.JointLock("lock", joint), state).rows == nv
        there = part(robot, joint, drawn(robot, rng))
        report = check_constraint(rbd.JointLock("lock", joint, position=there), state)
        assert report.rows == nv and report.against == "motion of the error"
        assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-8

    @pytest.mark.parametrize("joint", list(joints_of_every_kind().joints))
    def test_near_its_position_the_error_is_the_difference(self, joint, rng):
        """On the manifold, to third order; at the position itself it is zero, and J the identity."""
        robot = joints_of_every_kind()
        q, at = drawn(robot, rng), robot.model.joints[robot.joint_id(joint)]
        lock = rbd.JointLock("lock", joint, position=part(robot, joint, q))
        own = slice(at.idx_v, at.idx_v + at.nv)
        here = lock.rows(rbd.State(robot, q))
        assert np.abs(here.error).max() < 1e-15 and here.J[:, own] == pytest.approx(np.eye(at.nv))
        step = np.zeros(robot.nv)
        step[own] = 1e-3 * rng.normal(size=at.nv)
        turns = at.shortname() in ("JointModelFreeFlyer", "JointModelPlanar")  # where lengths turn with the body: second order
        tolerance = 1e-5 if turns else 1e-8
        assert lock.rows(rbd.State(robot, pin.integrate(robot.model, q, step))).error == pytest.approx(step[own], abs=tolerance)

    @pytest.mark.parametrize("solver", [rbd.KKT(), *SOLVERS])
    def test_a_locked_elbow_makes_a_pendulum_of_the_two_bars(self, solver):
        """I a = -g sum(m x): both masses about the shoulder, at speed; the brake carries what the fore-arm needs."""
        robot, q, speed = two_bars(), np.array([0.3, 0.8]), 1.7
        state = rbd.State(robot, q, np.array([speed, 0.0]))
        s = rbd.solve(state, np.zeros(2), [rbd.JointLock("brake", "elbow")], solver=solver)
        elbow = 0.4 * np.array([math.sin(q[0]), math.cos(q[0])])  # towards -x and down
        arm = 0.7 * np.array([math.sin(q.sum()), math.cos(q.sum())])
        tip = elbow + arm
        inertia, torque = 3.0 * 0.4**2 + 1.0 * tip @ tip, -G * (3.0 * elbow[0] + 1.0 * tip[0])
        a = torque / inertia
        assert s.a == pytest.approx([a, 0.0], abs=1e-10)
        # The brake's torque about the elbow moves 1 kg with the tip's acceleration, against its weight.
        acceleration = a * np.array([tip[1], -tip[0]]) - speed**2 * tip
        push = acceleration - np.array([0.0, G])
        assert s.forces["brake"] == pytest.approx([arm[1] * push[0] - arm[0] * push[1]])

    def test_a_locked_base_is_a_fixed_base(self):
        """Panda with its free base locked moves as Panda on a fixed base, at any velocity of its joints."""
        rng = np.random.default_rng(4)
        fixed, floating = (rbd.load_robot("panda", root=root) for root in ("fixed", "free_flyer"))
        q, v = rng.uniform(-1.0, 1.0, fixed.nq), rng.normal(size=fixed.nv)
        state = rbd.State(floating, np.r_[pin.neutral(floating.model)[:7], q], np.r_[np.zeros(6), v])
        tau = np.clip(rng.normal(size=fixed.nu), -fixed.effort_limit, fixed.effort_limit)
        s = rbd.solve(state, tau, [rbd.JointLock("floor", "root_joint")], solver=rbd.KKT())
        free = rbd.dynamics.free_acceleration(rbd.State(fixed, q, v), tau)
        assert s.a == pytest.approx(np.r_[np.zeros(6), free], abs=1e-9 * np.abs(free).max())

    def test_the_position_of_a_continuous_joint_is_an_angle(self):
        """Wrapped: from 3 to -3 rad it is 2 pi - 6; cos and sin are taken too."""
        robot = wheels(1.0, kind=pin.JointModelRUBZ)
        state = rbd.State(robot, np.array([math.cos(-3.0), math.sin(-3.0)]))
        for position in (3.0, [math.cos(3.0), math.sin(3.0)]):
            error = rbd.JointLock("lock", "wheel0", position=position).rows(state).error
            assert error == pytest.approx([2.0 * math.pi - 6.0])

    @pytest.mark.parametrize(
        ("joint", "position", "said"),
        [
            ("ball", [0.0, 0.0, 0.0], "has 3 numbers; expected 4"),
            ("ball", [0.0, 0.0, 0.0, 1.1], r"quaternion \(x, y, z, w\) .* of norm 1.1"),
            ("base", 0.0, "has 1 numbers; expected 7"),
            ("turntable", [1.0, 1.0], "unit circle"),
            ("turntable", [1.0, 0.0, 0.0], "expected an angle"),
            ("slider", [1.0, 2.0], "expected one number"),
        ],
    )
    def test_a_position_that_does_not_fit_is_refused(self, joint, position, said):
        """With the sizes, and the norm."""
        robot = joints_of_every_kind()
        with pytest.raises(rbd.InputError, match=said):
            rbd.JointLock("lock", joint, position=position).rows(rbd.State(robot, pin.neutral(robot.model)))


class TestCoupling:
    """Gears."""

    @pytest.mark.parametrize("solver", [rbd.KKT(), *SOLVERS])
    @pytest.mark.parametrize("ratio", [-1.0, 3.0, -0.25, 0.0])
    def test_geared_wheels_turn_as_one(self, solver, ratio):
        """(I1 + r^2 I2) a1 = tau1 + r tau2, a2 = r a1; f = I2 a2 - tau2 turns the second."""
        I1, I2, tau = 2.0, 0.3, np.array([5.0, -1.0])
        gear = rbd.JointCoupling("gear", "wheel1", "wheel0", ratio=ratio)
        s = rbd.solve(rbd.State(wheels(I1, I2), np.zeros(2)), tau, [gear], solver=solver)
        a = (tau[0] + ratio * tau[1]) / (I1 + ratio**2 * I2)
        assert s.a == pytest.approx([a, ratio * a], abs=1e-9)
        assert s.forces["gear"] == pytest.approx([I2 * ratio * a - tau[1]], abs=1e-9)

    def test_it_describes_its_motion(self, rng):
        """Sliders and screws too, at any place; the error says how far the teeth are apart."""
        robot = joints_of_every_kind()
        q = drawn(robot, rng)
        for joint, to in (("slider", "screw"), ("turntable", "slider"), ("screw", "turntable")):
            gear = rbd.JointCoupling("gear", joint, to, ratio=-1.5, offset=0.2)
            assert check_constraint(gear, rbd.State(robot, q)).against == "motion of the error"
        slider, screw = (float(part(robot, joint, q)[0]) for joint in ("slider", "screw"))
        error = rbd.JointCoupling("gear", "slider", "screw", ratio=-1.5, offset=0.2).rows(rbd.State(robot, q)).error
        assert error == pytest.approx([slider + 1.5 * screw - 0.2])

    @pytest.mark.parametrize(("ratio", "known"), [(3.0, True), (-0.5, True), (1.0, True), (2.5, False)])
    def test_wheels_that_turn_for_ever_know_their_angle_up_to_turns(self, ratio, known):
        """Many turns on, the error is still small; where it would be ambiguous there is none."""
        robot, gear = wheels(1.0, 1.0, kind=pin.JointModelRUBZ), rbd.JointCoupling("g", "wheel1", "wheel0", ratio=ratio)
        for turn in (0.1, 20.0, -333.3):
            angles = turn, ratio * turn + 0.01
            q = np.array([f(x) for x in angles for f in (math.cos, math.sin)])
            rows = gear.rows(rbd.State(robot, q))
            assert rows.error == pytest.approx([0.01], abs=1e-9) if known else rows.error is None

    def test_mimics_of_a_file_are_its_gears(self):
        """Panda's second finger follows the first: pushed alone, it takes the first along."""
        panda = rbd.load_robot("panda", root="fixed")
        (gear,) = rbd.constraints.mimics(panda)
        assert (gear.joint, gear.to, gear.ratio, gear.offset) == ("panda_finger_joint2", "panda_finger_joint1", 1.0, 0.0)
        state, tau = panda.at(np.r_[0.3, -0.5, 0.4, -1.9, 0.2, 1.6, 0.7, 0.01, 0.01]), np.zeros(panda.nu)
        tau[-1] = 0.5
        s = rbd.solve(state, tau, [gear], solver=rbd.KKT())
        assert s.a[-1] == pytest.approx(s.a[-2], abs=1e-12) and abs(rbd.dynamics.free_acceleration(state, tau)[-2]) > 1e-3
        assert gear.rows(state).error == pytest.approx([0.0])

    def test_multiplier_and_offset_are_read(self, tmp_path):
        """Also of fixed joints and of joints that mimic such, which give no gear; the defaults are 1 and 0."""

        def joint(name, parent, child, more, kind="revolute"):
            limit = "<limit lower='-1' upper='1' effort='9' velocity='9'/>" if kind != "fixed" else ""
            return f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>{limit}{more}</joint>"

        inertial = "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
        path = tmp_path / "hand.urdf"
        path.write_text(
            "<robot name='hand'>"
            + "".join(f"<link name='{n}'>{inertial}</link>" for n in "abcdef")
            + joint("thumb", "a", "b", "")
            + joint("index", "a", "c", "<mimic joint='thumb' multiplier='-2' offset='0.1'/>")
            + joint("ring", "a", "d", "<mimic joint='thumb'/>")
            + joint("nail", "d", "e", "<mimic joint='thumb'/>", kind="fixed")
            + joint("little", "a", "f", "<mimic joint='nail'/>")
            + "</robot>"
        )
        found = {m.name: (m.joint, m.to, m.ratio, m.offset) for m in rbd.constraints.mimics(rbd.load_robot(path, root="fixed"))}
        assert found == {"index_mimic": ("index", "thumb", -2.0, 0.1), "ring_mimic": ("ring", "thumb", 1.0, 0.0)}

    def test_a_robot_without_a_urdf_has_none_to_read(self, tmp_path):
        """A model built by hand; an MJCF file."""
        with pytest.raises(rbd.InputError, match="no file to read mimics from"):
            rbd.constraints.mimics(pendulum())
        path = tmp_path / "bar.xml"
        path.write_text(
            "<mujoco><worldbody><body name='bar'><joint name='hinge' axis='0 1 0' frictionloss='0.25'/>"
            "<inertial pos='0 0 -1' mass='1' diaginertia='1 1 1'/></body></worldbody></mujoco>"
        )
        bar = rbd.load_robot(path, root="fixed")
        with pytest.raises(rbd.InputError, match="MJCF"):
            rbd.constraints.mimics(bar)
        assert [(f.name, f.torque) for f in rbd.constraints.joint_frictions(bar)] == [("hinge_friction", 0.25)]
        assert rbd.constraints.joint_limits(bar) == []  # no range in the file


class TestFriction:
    """Dry friction: holds, then rubs."""

    @pytest.mark.parametrize("solver", SOLVERS)
    @pytest.mark.parametrize(
        ("tau", "v", "force"), [(1.5, 0.0, -1.5), (-1.9, 0.0, 1.9), (5.0, 0.0, -2.0), (-5.0, 0.0, 2.0), (1.5, 0.4, -2.0),
                                (1.5, -0.4, 2.0), (5.0, -1e-5, 2.0), (1.5, 1e-7, -1.5)],
    )  # fmt: skip
    def test_it_sticks_slips_and_brakes(self, solver, tau, v, force):
        """2 N m on a wheel of 0.5 kg m2: held up to that, braked by it; above 1e-6 rad/s the motion says which way."""
        state = rbd.State(wheels(0.5), np.zeros(1), np.array([v]))
        s = rbd.solve(state, np.array([tau]), [rbd.JointFriction("axle", "wheel0", 2.0)], solver=solver)
        assert s.forces["axle"] == pytest.approx([force], abs=1e-9) and s.a == pytest.approx([(tau + force) / 0.5], abs=1e-9)
        assert s.status is rbd.problem.Status.SOLVED

    def test_it_describes_its_motion(self, talos):
        """One row, the joint's own rate."""
        assert check_constraint(rbd.JointFriction("knee", "leg_left_4_joint", 1.0), talos.standing()).velocity < 1e-12

    def test_the_files_friction_is_a_list(self, talos):
        """20 of Talos's joints have 1 N m; a robot whose file states none has none."""
        found = rbd.constraints.joint_frictions(talos)
        assert len(found) == 20 and {f.torque for f in found} == {1.0}
        assert rbd.constraints.joint_frictions(rbd.load_robot("g1")) == []

    def test_no_friction_is_no_force(self):
        """A torque of zero is allowed, at rest and moving."""
        for v in (0.0, 1.0):
            state = rbd.State(wheels(0.5), np.zeros(1), np.array([v]))
            s = rbd.solve(state, np.array([3.0]), [rbd.JointFriction("axle", "wheel0", 0.0)])
            assert s.forces["axle"].tolist() == [0.0] and s.a == pytest.approx([6.0])

    def test_it_takes_power_out_of_a_moving_robot(self, talos, rng):
        """On held soles, all joints moving: the power of each friction is -torque |v|, on Talos and by both solvers."""
        q, v = talos.standing().q, rng.normal(size=talos.nv)
        J = np.concatenate([sole.rows(talos.at(q)).J for sole in talos.soles(None)])
        v -= np.linalg.lstsq(J, J @ v, rcond=None)[0]
        rubbing = [rbd.JointFriction(f"{j} rubs", j, 2.0) for j in talos.joints if j != "root_joint"]
        answers = [
            rbd.solve(talos.at(q, v), np.zeros(talos.nu), [*talos.soles(None), *rubbing], solver=solver)
            for solver in (rbd.ProxQP(), rbd.ConeSolver(law="coulomb"))
        ]
        for f in rubbing:
            rate = float(v[column(talos, f.joint)])
            assert all(s.forces[f.name][0] * rate == pytest.approx(-2.0 * abs(rate)) for s in answers)
        assert np.abs(answers[0].a - answers[1].a).max() < 1e-8 * np.abs(answers[0].a).max()


@pytest.mark.parametrize("name", ["talos", "panda", "ur5"])
def test_all_kinds_together_are_answered_alike_by_both_codes(name):
    """Stops, locks, gears, friction (and rubbing soles, sticking): ProxQP and ConeSolver agree, on robots that move or rest."""
    robot, rng = rbd.load_robot(name, root="free_flyer" if name == "talos" else "fixed"), np.random.default_rng(11)
    q = robot.standing().q if robot.floating else 0.3 * rng.uniform(0.1, 1.0, robot.nq)
    joints = [j for j in robot.joints if j != "root_joint"]
    for draw in range(4):
        chosen = rng.permutation(joints)
        stop, other = str(chosen[0]), str(chosen[1])
        feet = robot.soles(0.7) if robot.floating else []
        constraints = [
            *feet,
            rbd.JointLimit("stop", stop, lower=float(part(robot, stop, q)[0]), upper=math.inf),
            rbd.JointLimit("other stop", other, lower=-math.inf, upper=float(part(robot, other, q)[0])),
            rbd.JointLock("lock", str(chosen[2])),
            rbd.JointCoupling("gear", str(chosen[3]), str(chosen[4]), ratio=float(rng.normal())),
            *[rbd.JointFriction(f"{j} rubs", j, float(rng.uniform(0.0, 3.0))) for j in joints],
        ]
        tau = np.clip(5.0 * rng.normal(size=robot.nu), -robot.effort_limit, robot.effort_limit)
        v = np.zeros(robot.nv)
        if draw % 2 and not feet:
            v[column(robot, str(chosen[5]))] = 0.3
        one, two = (rbd.solve(robot.at(q, v), tau, constraints, solver=s) for s in (rbd.ProxQP(), rbd.ConeSolver(law="convex")))
        if not feet or one.law == two.law:
            assert np.abs(one.a - two.a).max() < 1e-7 * max(1.0, np.abs(one.a).max())
        assert one.status is two.status is rbd.problem.Status.SOLVED


@pytest.mark.parametrize(
    "make",
    [
        lambda joint: rbd.JointLimit("c", joint, lower=0.0),
        lambda joint: rbd.JointLock("c", joint),
        lambda joint: rbd.JointCoupling("c", joint, "arm_left_1_joint", ratio=1.0),
        lambda joint: rbd.JointCoupling("c", "arm_left_1_joint", joint, ratio=1.0),
        lambda joint: rbd.JointFriction("c", joint, 1.0),
    ],
)
def test_a_joint_that_is_not_there_is_refused_with_the_nearest(talos, make):
    """Unknown ids crash Pinocchio; joints with six degrees of freedom are no one-row joints."""
    with pytest.raises(rbd.errors.JointNotFound, match="'leg_left_4_joint'"):
        make("leg_left_4_jiont").rows(talos.standing())
    constraint = make("root_joint")
    if not isinstance(constraint, rbd.JointLock):
        with pytest.raises(rbd.InputError, match="has 6 degrees of freedom"):
            constraint.rows(talos.standing())
    with pytest.raises(rbd.InputError, match="want a State, got Robot"):
        make("leg_left_4_joint").rows(talos)


@pytest.mark.parametrize(
    ("said", "make"),
    [
        ("name", lambda: rbd.JointLimit("", "knee")),
        ("joint", lambda: rbd.JointLock("lock", 3)),
        ("lower of 'stop'", lambda: rbd.JointLimit("stop", "knee", lower="0")),
        ("upper of 'stop'", lambda: rbd.JointLimit("stop", "knee", upper=math.nan)),
        ("swapped", lambda: rbd.JointLimit("stop", "knee", lower=1.0, upper=0.0)),
        ("margin", lambda: rbd.JointLimit("stop", "knee", margin=-1e-3)),
        ("position", lambda: rbd.JointLock("lock", "knee", position=math.inf)),
        ("position", lambda: rbd.JointLock("lock", "knee", position=np.eye(3))),
        ("itself", lambda: rbd.JointCoupling("gear", "knee", "knee", ratio=1.0)),
        ("ratio", lambda: rbd.JointCoupling("gear", "knee", "hip", ratio=math.inf)),
        ("offset", lambda: rbd.JointCoupling("gear", "knee", "hip", ratio=1.0, offset=None)),
        ("torque", lambda: rbd.JointFriction("rub", "knee", -1.0)),
        ("torque", lambda: rbd.JointFriction("rub", "knee", math.inf)),
        ("the robot is 'talos'; expected a robot", lambda: rbd.constraints.joint_limits("talos")),
        (r"the robot is \[\]; expected a robot", lambda: rbd.constraints.joint_frictions([])),
        ("the robot is None; expected a robot", lambda: rbd.constraints.mimics(None)),
    ],
)
def test_what_means_nothing_is_refused(said, make):
    """By name, before any robot is involved."""
    with pytest.raises(rbd.InputError, match=said):
        make()


def test_a_constraint_serves_many_robots_and_travels(talos):
    """One object on two robots gives each its own rows; a copy by pickle gives the same."""
    stop = rbd.JointLimit("stop", "hinge", lower=0.1)
    for robot in (pendulum(), CheckedModel(pin.Model(pendulum().model), name="another"), pendulum()):
        assert len(stop.rows(rbd.State(robot, np.array([0.0])))) == 1
    lock = rbd.JointLock("lock", "leg_left_4_joint", position=0.3)
    first, again = lock.rows(talos.standing()), pickle.loads(pickle.dumps(lock)).rows(talos.standing())
    assert isinstance(first, Rows) and np.array_equal(first.J, again.J) and np.array_equal(first.error, again.error)
