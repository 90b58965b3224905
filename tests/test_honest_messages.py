"""Messages that once misled: the friction that is needed, loops that a posture closes, a right screw, laws that differ."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import NonUniqueMotionWarning
from rbd.model.checked_model import CheckedModel
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.residuals import residuals_of
from rbd.statics.least_friction import BRACKET, Balance, rounded_up as enough
from rbd.testing import ConstraintWrong, box, check_constraint

G = 9.81
MASS = 3.0
WEIGHT = MASS * G
CORNERS = [(x, y) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]


def floor(friction: float, facets: int = 4, normal=(0.0, 0.0, 1.0)) -> list[rbd.PointContact]:
    """Four points under a box of 0.2 m height."""
    return [
        rbd.PointContact(f"p{i}", "box", offset=(*p, -0.1), friction=friction, facets=facets, on=rbd.Ground(normal=normal))
        for i, p in enumerate(CORNERS)
    ]


def told(call) -> str:
    """The message of what cannot be held."""
    with pytest.raises(rbd.CannotHold) as error:
        call()
    return str(error.value)


def coefficient(message: str) -> float:
    """The number in it."""
    return float(re.search(r"coefficient of ([\d.]+)", message)[1])


class TestFriction:
    """The least coefficient that `CannotHold` names is that of circular cones."""

    @pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 2.0])
    @pytest.mark.parametrize(("friction", "facets"), [("cone", 4), ("inscribed", 3), ("inscribed", 4), ("inscribed", 8)])
    def test_a_pushed_box_needs_what_it_is_pushed_with(self, angle, friction, facets):
        """Closed form: |push| / weight, whatever the direction, and whatever the pyramids are, of which the words tell."""
        state = rbd.State(box(MASS), pin.neutral(box(MASS).model))
        push = 0.4992 * WEIGHT * np.array([np.cos(angle), np.sin(angle), 0.0])
        external = rbd.ExternalForce("box", push, offset=(0.0, 0.0, -0.1))
        message = told(lambda: rbd.hold(state, floor(0.2, facets), external=external, friction=friction))
        assert coefficient(message) == 0.4992 and ("circular" in message) == (friction == "inscribed")
        with_margin = told(lambda: rbd.hold(state, floor(0.2, facets), external=external, friction=friction, margin=0.2))
        assert coefficient(with_margin) == pytest.approx(0.4992 / 0.8, rel=1e-5)

    @pytest.mark.parametrize("slope", [0.2, 0.4992, 1.3])
    def test_a_ramp_needs_its_slope(self, slope):
        """The tangent of its angle; points on a ramp turned about the vertical."""
        angle = np.arctan(slope)
        normal = pin.exp3(np.array([0.0, 0.0, 0.7])) @ np.array([np.sin(angle), 0.0, np.cos(angle)])
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        points = [  # below the centre of mass along z, so that no moment is left
            rbd.PointContact(f"p{i}", "box", offset=(*p, -0.1), on=rbd.Ground(normal=normal), friction=0.01)
            for i, p in enumerate(CORNERS)
        ]
        assert coefficient(told(lambda: rbd.hold(state, points))) == pytest.approx(slope, rel=5e-4)

    def test_a_ladder_needs_half_its_slope(self):
        """On a rough floor and against a wall without friction of its own ... both rough: tan(theta) = (1 - mu^2) / (2 mu)."""
        robot = box(MASS, (0.01, 0.01, 2.0))
        theta = np.deg2rad(50.0)
        R = pin.rpy.rpyToMatrix(0.0, np.pi / 2 - theta, 0.0)
        state = rbd.State(robot, pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3))))
        ends = [
            rbd.PointContact("foot", "box", offset=(0, 0, -1.0), friction=0.01),
            rbd.PointContact("top", "box", offset=(0, 0, 1.0), on=rbd.Ground(normal=(-1, 0, 0)), friction=0.01),
        ]
        mu = coefficient(told(lambda: rbd.hold(state, ends)))
        assert mu == pytest.approx(-np.tan(theta) + np.hypot(1.0, np.tan(theta)), rel=5e-4)

    def test_a_robot_holds_above_it_and_not_below(self, talos):
        """What is told does, and a thousandth less does not; fine pyramids bracket it from inside."""
        state, push = talos.standing(), rbd.ExternalForce("torso_2_link", (60.0, 45.0, 0.0))
        mu = coefficient(told(lambda: rbd.hold(state, talos.soles(0.01), external=push)))
        rbd.hold(state, talos.soles(mu), external=push)
        assert coefficient(told(lambda: rbd.hold(state, talos.soles(0.999 * mu), external=push))) == mu
        rbd.hold(state, talos.soles(1.002 * mu, facets=64), external=push, friction="inscribed")
        fine = talos.soles(0.998 * mu, facets=64)
        assert coefficient(told(lambda: rbd.hold(state, fine, external=push, friction="inscribed"))) == mu

    def test_the_least_coefficient_that_is_told_is_the_least(self, talos):
        """To six digits: a hundred-thousandth more does, and as much less does not."""
        state, push = talos.standing(), rbd.ExternalForce("torso_2_link", (60.0, 45.0, 0.0))
        said = told(lambda: rbd.hold(state, talos.soles(0.01), external=push))
        least = float(re.search(r"the least is ([\d.]+)\)", said)[1])
        assert least <= coefficient(said) < 1.001 * least and "none below" not in said
        rbd.hold(state, talos.soles(least * (1.0 + 1e-5)), external=push)
        assert float(re.search(r"the least is ([\d.]+)\)", told(
            lambda: rbd.hold(state, talos.soles(least * (1.0 - 1e-5)), external=push)
        ))[1]) == pytest.approx(least, rel=3e-6)  # fmt: skip

    def test_where_circular_cones_do_hold_it_says_so(self):
        """The pyramids inside are what is in the way: more facets are the remedy, and it works."""
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        external = rbd.ExternalForce("box", (0.5 * WEIGHT, 0.0, 0.0), offset=(0.0, 0.0, -0.1))
        message = told(lambda: rbd.hold(state, floor(0.6), external=external, friction="inscribed"))
        assert "circular cones would hold it" in message and coefficient(message) == pytest.approx(0.5, rel=1e-4)
        rbd.hold(state, floor(0.6, facets=16), external=external, friction="inscribed")
        rbd.hold(state, floor(0.6), external=external)

    def test_of_smooth_and_rough_contacts(self):
        """Smooth ones take the coefficient too; those that have more keep theirs; those that hold are left alone."""
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        external = rbd.ExternalForce("box", (0.3 * WEIGHT, 0.0, 0.0), offset=(0.0, 0.0, -0.1))
        assert coefficient(told(lambda: rbd.hold(state, floor(0.0), external=external))) == pytest.approx(0.3, rel=1e-4)
        mixed = [*floor(0.0)[:2], *(replaced(c, 0.1) for c in floor(0.0)[2:])]
        assert coefficient(told(lambda: rbd.hold(state, mixed, external=external))) == pytest.approx(0.3, rel=1e-4)

    def test_a_ball_and_shapes_count_too(self):
        """On collision shapes and under a ball it is as on any contact: |push| / weight."""
        robot = rbd.load_robot(Path(__file__).parent.parent / "urdf" / "box.urdf")
        state = rbd.State(robot, np.array([0, 0, 0.1, 0, 0, 0, 1.0]))
        external = rbd.ExternalForce("box", (0.0, 0.25 * robot.mass * G, 0.0), offset=(0.0, 0.0, -0.1))
        ground = rbd.CollisionContacts("ground", robot, friction=0.1)
        assert coefficient(told(lambda: rbd.hold(state, [ground], external=external))) == pytest.approx(0.25, rel=1e-4)
        ball = rbd.RollingBall("ball", "box", radius=0.1, friction=0.1)
        assert coefficient(told(lambda: rbd.hold(state, [ball], external=external))) == pytest.approx(0.25, rel=1e-4)

    def test_where_a_motor_is_too_weak_as_well_it_says_both(self):
        """An arm's end on a rough wall: friction could carry it, its motors could not."""
        robot = weak_arm(limit=0.5)
        state = rbd.State(robot, np.zeros(robot.nq))
        wall = rbd.PointContact("tip", "tip", on=rbd.Ground(normal=(-1, 0, 0)), friction=0.1)
        message = told(lambda: rbd.hold(state, [wall]))
        assert "torque limit" in message

    def test_a_lock_beside_the_soles_asks_for_no_friction(self, talos):
        """Of what does not rub there is no coefficient to raise: with an elbow locked as it stands it is what it was."""
        state, push = talos.standing(), rbd.ExternalForce("torso_2_link", (60.0, 45.0, 0.0))
        alone = coefficient(told(lambda: rbd.hold(state, talos.soles(0.01), external=push)))
        lock = rbd.JointLock("elbow", "arm_left_4_joint")
        assert coefficient(told(lambda: rbd.hold(state, [*talos.soles(0.01), lock], external=push))) == alone

    @pytest.mark.parametrize("push", [0.0, 0.3])
    def test_what_presses_needs_what_it_is_pushed_with(self, push):
        """One cone under a body of unit weight, in numbers: nothing where nothing pushes."""
        assert one_cone(push).least() == pytest.approx(push, rel=1e-5, abs=0.0)

    def test_newtons_step_is_proved_by_a_program_just_below_it(self, monkeypatch):
        """A push of 0.3 of the weight: within a millionth in ten programs; halving the bracket takes twenty."""
        monkeypatch.setattr("rbd.problem.programs.FRICTION_PROGRAMS", 10)
        assert one_cone(0.3).least() == pytest.approx(0.3, rel=BRACKET, abs=0.0)

    def test_zero_is_told_as_zero_and_the_rest_rounded_up(self):
        """So much does: four digits."""
        assert [enough(mu) for mu in (0.0, 0.25, 0.123412, 3.0001)] == ["0", "0.25", "0.1235", "3.001"]

    def test_a_search_cut_short_says_so(self, monkeypatch):
        """One program is not enough."""
        monkeypatch.setattr("rbd.problem.programs.FRICTION_PROGRAMS", 1)
        robot = box(MASS)
        external = rbd.ExternalForce("box", (0.3 * WEIGHT, 0.1 * WEIGHT, 0.0), offset=(0.0, 0.0, -0.1))
        state = rbd.State(robot, pin.neutral(robot.model))
        assert "whether more friction would do was not found" in told(lambda: rbd.hold(state, floor(0.01), external=external))

    def test_the_bracket_is_narrow(self):
        """What is told is within a millionth, relative, of what is so."""
        assert BRACKET <= 1e-6


def one_cone(push: float) -> Balance:
    """A body of unit weight on one frictionless point whose coefficient may grow, pushed along the ground."""
    forces = Unknowns(3, cones=np.array([[0, 1, 2]]), mu=np.zeros(1))
    return Balance(Conic.of({"forces": forces}, [({"forces": np.eye(3)}, np.array([push, 0.0, 1.0]))]), np.ones(1, bool))


def replaced(contact: rbd.PointContact, friction: float) -> rbd.PointContact:
    """The same point with another coefficient."""
    return rbd.PointContact(contact.name, contact.frame, offset=contact.offset, friction=friction)


def weak_arm(limit: float) -> CheckedModel:
    """One slide along x with a weak motor, and a body on a passive slide along z beyond it."""
    model = pin.Model()
    x = model.addJoint(
        0, pin.JointModelPX(), pin.SE3.Identity(), "press",
        max_effort=np.array([limit]), max_velocity=np.array([1.0]), min_config=np.array([-1.0]), max_config=np.array([1.0]),
    )  # fmt: skip
    z = model.addJoint(x, pin.JointModelPZ(), pin.SE3.Identity(), "slide")
    for joint in (x, z):
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.1, 0.1, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", z, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return CheckedModel(model, name="arm", passive=["slide"])


FOUR_BAR = Path(__file__).parent.parent / "urdf" / "four_bar.urdf"


class TestLoops:
    """What the doctor says of loops, by the postures that are given."""

    @pytest.mark.parametrize(("digits", "said"), [(15, False), (4, False), (3, False), (1, True)])
    def test_rounded_angles_close_a_loop(self, tmp_path, digits, said):
        """A posture written with so many digits closes it to that; with one it does not."""
        text = FOUR_BAR.with_name("four_bar.loops.yaml").read_text()
        (line,) = re.findall(r"assembled: {(.*)}", text)
        angles = re.sub(r"-?\d+\.\d+", lambda x: str(round(float(x[0]), digits)), line)
        head = text[: text.index("postures:")]
        (tmp_path / "bar.urdf").write_text(FOUR_BAR.read_text())
        (tmp_path / "bar.loops.yaml").write_text(head + f"postures:\n  mine: {{{angles}}}\n")
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            loaded = rbd.load_robot(tmp_path / "bar.urdf")
        assert any("open in every posture" in str(w.message) for w in seen) is said
        assert ("closed in 'mine'" in str(rbd.doctor(loaded))) is not said


class Screw:
    """A right or wrong screw: one row of a coupling, an entry of its J multiplied."""

    name = "screw"

    def __init__(self, gear: rbd.JointCoupling, column: int = 0, factor: float = 1.0) -> None:
        self.gear, self.column, self.factor = gear, column, factor

    def rows(self, state: rbd.State) -> rbd.Rows:
        """The coupling's, changed."""
        rows = self.gear.rows(state)
        J = rows.J.copy()
        J[0, self.column] *= self.factor
        return replace(rows, J=J, velocity=J @ state.v)


@pytest.fixture
def spindle() -> CheckedModel:
    """A joint that turns for ever and one that slides."""
    model = pin.Model()
    for joint, name in ((pin.JointModelRUBX(), "spin"), (pin.JointModelPX(), "slide")):
        at = model.addJoint(0, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(at, pin.Inertia.FromBox(1.0, 0.1, 0.1, 0.1), pin.SE3.Identity())
    return CheckedModel(model, name="spindle")


class TestScrew:
    """A screw's error is known up to its pitch; `check_constraint` sees past that, and sees what is wrong."""

    @pytest.mark.parametrize("pitch", [0.5, 0.01, 1e-3, 1e-5])
    def test_a_right_screw_passes(self, spindle, rng, pitch):
        """From half a metre to a hundredth of a millimetre a turn, anywhere, in either direction."""
        gear = rbd.JointCoupling("screw", "slide", "spin", ratio=pitch / (2 * np.pi))
        for seed in range(5):
            state = rbd.State(spindle, pin.integrate(spindle.model, pin.neutral(spindle.model), rng.normal(size=2)))
            assert check_constraint(gear, state, seed=seed).against == "motion of the error"
            assert gear.rows(state).period == pytest.approx(pitch)
        check_constraint(rbd.JointCoupling("screw", "spin", "slide", ratio=2 * np.pi / pitch), state, tolerance=1e-6)

    @pytest.mark.parametrize("pitch", [0.5, 0.01, 1e-3])
    @pytest.mark.parametrize(("column", "factor"), [(0, 2.0), (0, -1.0), (1, 1.01), (1, 2.0), (1, -1.0)])
    def test_a_wrong_one_does_not(self, spindle, rng, pitch, column, factor):
        """Twice the pitch, a left-hand thread, a slide that moves too far."""
        gear = rbd.JointCoupling("screw", "slide", "spin", ratio=pitch / (2 * np.pi))
        state = rbd.State(spindle, pin.integrate(spindle.model, pin.neutral(spindle.model), rng.normal(size=2)))
        with pytest.raises(ConstraintWrong):
            check_constraint(Screw(gear, column, factor), state)

    def test_a_lock_half_a_turn_away(self, spindle):
        """Where its angle jumps by a full turn the motion does not."""
        check_constraint(rbd.JointLock("lock", "spin", position=np.pi), rbd.State(spindle, pin.neutral(spindle.model)))

    def test_a_users_own_error_that_jumps_nearby(self, spindle):
        """A function that folds its angle tells no period; smaller steps stay on this side."""

        def folded(q):
            angle = np.arctan2(q[1], q[0])
            return np.array([np.remainder(q[2] - 0.002 * angle + 0.001, 0.004) - 0.001])

        own = rbd.FunctionConstraint("own", folded)
        state = rbd.State(spindle, np.array([1.0, 0.0, 0.0]))
        check_constraint(own, state, tolerance=1e-6)

    def test_a_period_wants_an_error(self):
        """And numbers that are none below zero."""
        for given in ({"period": [1.0]}, {"period": [-1.0], "error": [0.1]}, {"period": [np.nan], "error": [0.1]}):
            with pytest.raises(rbd.InputError, match="period is"):
                rbd.Rows("it", np.eye(1), np.zeros(1), rbd.problem.Free(1), **given)


def walls(friction: float, kind: str) -> list:
    """What a box touches on its left and on its right."""
    sides = (("left", -1.0), ("right", 1.0))
    if kind == "two":
        return [
            rbd.PointContact(n, "box", offset=(0.2 * s, 0, 0), on=rbd.Ground(normal=(-s, 0, 0)), friction=friction)
            for n, s in sides
        ]
    if kind == "eight":
        return [
            rbd.PointContact(f"{n}{i}", "box", offset=(0.2 * s, *p), on=rbd.Ground(normal=(-s, 0, 0)), friction=friction)
            for n, s in sides
            for i, p in enumerate([(0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)])
        ]
    out = []
    for n, s in sides:
        R = np.array([[0, 0, -s], [0, 1, 0], [s, 0, 0]])
        placement = pin.SE3(R, np.array([0.2 * s, 0.0, 0.0]))
        out.append(rbd.SurfaceContact(n, "box", half_lengths=(0.1, 0.2), placement=placement, friction=friction))
    return out


class TestSeveralMotions:
    """Where both laws are right and differ, Coulomb's law has both motions, and it is said."""

    @pytest.mark.parametrize("kind", ["two", "eight", "faces"])
    @pytest.mark.parametrize("friction", [0.3, 1.0])
    @pytest.mark.parametrize("solver", [None, rbd.ConeSolver()], ids=["default", "cones"])
    def test_a_box_between_two_walls_falls_or_is_jammed(self, kind, friction, solver):
        """It falls at 9.81 with no force, or stays with as much as the walls like: both satisfy Coulomb's law."""
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        contacts = walls(friction, kind)
        with pytest.warns(NonUniqueMotionWarning, match=r"no one motion: Coulomb's law admits 2 motions .* jammed") as seen:
            s = rbd.solve(state, np.zeros(0), contacts, solver=solver)
        assert seen[0].filename == __file__ and (s.method == "QP") == (solver is None)
        motions = sorted([s.a[2], *(o.a[2] for o in s.others)])
        assert motions == pytest.approx([-G, 0.0], abs=1e-9)
        for each in (s, *s.others):
            assert each.residuals.within(1e-9)
            assert residuals_of(s.problem, each.a, each.multipliers, each.weights, "coulomb").within(1e-9)
        assert "one of several motions" in str(s)

    def test_compare_laws_says_it_too(self):
        """They differ while nothing slips."""
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        with pytest.warns(NonUniqueMotionWarning):
            both = rbd.studies.compare_laws(state, np.zeros(0), walls(0.5, "two"))
        assert not both.agree and len(both.coulomb.others) == 1
        motions = [both.coulomb, *both.coulomb.others]
        assert min(np.abs(each.a - both.convex.a).max() for each in motions) < 1e-9
        assert sorted(each.a[2] for each in motions) == pytest.approx([-G, 0.0], abs=1e-9)
        assert "Coulomb's law has 2 motions" in str(both)

    def test_one_motion_is_one(self, talos):
        """A slipping box, a box that falls past one wall, and a robot that is pushed: nothing is said."""
        robot = box(MASS)
        state = rbd.State(robot, pin.neutral(robot.model))
        push = rbd.ExternalForce("box", (0.8 * WEIGHT, 0.0, 0.0))
        slips = rbd.solve(state, np.zeros(0), floor(0.5), external=push, solver=rbd.ConeSolver())
        assert slips.a[0] == pytest.approx(0.3 * G) and not slips.others
        past = rbd.solve(state, np.zeros(0), walls(0.5, "two")[:1], solver=rbd.ConeSolver())
        assert past.a[2] == pytest.approx(-G) and not past.others
        standing = talos.standing()
        assert not rbd.solve(standing, np.zeros(talos.nu), talos.soles(0.3), solver=rbd.ConeSolver()).others

    def test_whenever_the_convex_motion_is_coulombs_too_it_is_among_them(self):
        """Boxes with points anywhere: the laws differ, and then either the convex motion breaks Coulomb's law or it is told."""
        rng, robot, differ, several = np.random.default_rng(7), box(MASS), 0, 0
        state = rbd.State(robot, pin.neutral(robot.model))
        for _ in range(60):
            contacts = []
            for i in range(int(rng.integers(1, 6))):
                n = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) if rng.random() < 0.5 else rng.normal(size=3)
                n = n / np.linalg.norm(n)
                p, mu = -0.2 * n + 0.1 * rng.normal(size=3), float(rng.choice([0.3, 0.7, 1.0, 3.0]))
                contacts.append(rbd.PointContact(f"c{i}", "box", offset=p, on=rbd.Ground(normal=n), friction=mu))
            push = rbd.ExternalForce("box", rng.normal(size=3) * rng.choice([0.0, 5.0, 30.0]))
            P = rbd.gauss_problem(state, np.zeros(0), contacts, external=push)
            convex, coulomb = rbd.ConeSolver(law="convex").solve(P), rbd.ConeSolver().solve(P)
            if not (convex.residuals.within(1e-9) and coulomb.residuals.within(1e-9)):
                continue
            size = max(1.0, np.abs(coulomb.a).max())
            if np.abs(convex.a - coulomb.a).max() > 1e-6 * size:
                differ += 1
                both = residuals_of(P, convex.a, convex.multipliers, convex.weights, "coulomb").within(1e-9)
                found = any(np.abs(o.a - convex.a).max() < 1e-6 * size for o in coulomb.others)
                assert found or not both
                several += found
        assert differ > 20 and several > 5
