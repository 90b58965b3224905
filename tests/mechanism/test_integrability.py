"""Growth vectors that are known: what velocity constraints leave, together."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from linkages import Builder, at, bennett, closed, free, pinned, planar_chain
from states import at_neutral

import rbd
from rbd.constraints import FunctionConstraint, JointLock, KnifeEdge, RollingBall, RollingDisk, VelocityConstraint
from rbd.constraints.manifold import ConstraintManifold
from rbd.mechanism import integrability
from rbd.mechanism.frobenius import ad, brackets, derivative

URDF = Path(__file__).parents[2] / "urdf"
X, Y, TURN, PLANE, BALL, FLY = (
    pin.JointModelPX,
    pin.JointModelPY,
    pin.JointModelRZ,
    pin.JointModelPlanar,
    pin.JointModelSpherical,
    pin.JointModelFreeFlyer,
)
BLADE = VelocityConstraint("blade", [0.0, 1.0, 0.0])  # of a planar joint


def along(q: np.ndarray) -> np.ndarray:
    """The row -sin(th) x' + cos(th) y' of coordinates x, y, th."""
    return np.array([-np.sin(q[2]), np.cos(q[2]), 0.0])


class TestBrackets:
    """Brackets themselves, against motion to and fro, a textbook and an identity."""

    @pytest.mark.parametrize("kind", [PLANE, BALL, FLY, TURN])
    def test_the_structure_constants_are_those_of_moving_to_and_fro(self, kind: type, rng: np.random.Generator):
        """Along X, Y, -X, -Y by h each ends h^2 [X, Y] from the start, to first order; Pinocchio moves, we multiply."""
        robot = free(kind())
        for _ in range(3):
            x, y, h = *rng.normal(size=(2, robot.nv)), 1e-4
            q = start = pin.randomConfiguration(robot.model, -np.ones(robot.nq), np.ones(robot.nq))
            for v in (x, y, -x, -y):
                q = pin.integrate(robot.model, q, h * v)
            moved = pin.difference(robot.model, start, q) / h**2
            np.testing.assert_allclose(moved, ad(robot, x, y), atol=20.0 * h)

    def test_fields_of_coordinates_have_the_textbook_bracket(self):
        """X = (cos th, sin th, 0) and Y = (0, 0, 1): [X, Y] = (sin th, -cos th, 0)."""
        held = ConstraintManifold(rbd.State(free(X(), Y(), TURN()), np.zeros(3)), [])

        def fields(q: np.ndarray) -> np.ndarray:
            return np.array([[np.cos(q[2]), 0.0], [np.sin(q[2]), 0.0], [0.0, 1.0]])

        q = np.array([0.3, -0.2, 0.7])
        found = brackets(held, fields, fields, [(0, 1)])(q)[:, 0]
        np.testing.assert_allclose(found, [np.sin(0.7), -np.cos(0.7), 0.0], atol=1e-12)
        rise = derivative(held, fields, q, np.array([0.0, 0.0, 2.0]))[:, 0]
        np.testing.assert_allclose(rise, [-2.0 * np.sin(0.7), 2.0 * np.cos(0.7), 0.0], atol=1e-11)

    def test_along_no_direction_nothing_changes(self):
        """The derivative along zero is zero, of fields that vary."""
        held = ConstraintManifold(rbd.State(free(X()), np.zeros(1)), [])
        assert not derivative(held, lambda q: np.array([[np.sin(q[0]) + 1.0]]), np.array([0.3]), np.zeros(1)).any()

    def test_the_jacobi_identity_holds_two_deep(self, rng: np.random.Generator):
        """[X, [Y, Z]] + [Y, [Z, X]] + [Z, [X, Y]] = 0 for fields that vary, on a floating base."""
        robot = free(FLY())
        held = ConstraintManifold(rbd.State(robot, pin.neutral(robot.model)), [])
        A = rng.normal(size=(6, 3, 7))

        def fields(q: np.ndarray) -> np.ndarray:
            return A @ np.sin(q)

        q = pin.integrate(robot.model, pin.neutral(robot.model), 0.5 * rng.normal(size=6))
        inner = brackets(held, fields, fields, [(1, 2), (2, 0), (0, 1)])
        total = brackets(held, fields, inner, [(0, 0), (1, 1), (2, 2)])(q)
        assert np.abs(total).max() > 0.1
        assert np.abs(total.sum(axis=1)).max() < 1e-7


class TestNonholonomic:
    """Constraints that leave more configurations than velocities."""

    def test_a_knife_edge_is_not_integrable_on_a_planar_joint(self):
        """Its row is the constant (0, 1, 0), whose partial derivatives are all zero; the growth vector is (2, 3)."""
        found = integrability(at_neutral(free(PLANE())), [BLADE])
        assert not found.holonomic and found.growth == (2, 3)
        assert (found.velocity_dof, found.configuration_dof) == (2, 3)
        assert found.agreed and found.complete and found.points.shape == (3, 4)

    def test_nor_in_coordinates_nor_as_a_constraint_of_its_own(self):
        """The same edge on x, y and th; and `KnifeEdge`."""
        assert integrability(at_neutral(free(X(), Y(), TURN())), [VelocityConstraint("blade", along)]).growth == (2, 3)
        robot = Builder().joint("base", PLANE(), at()).robot()
        assert integrability(at_neutral(robot), [KnifeEdge("blade", "base")]).growth == (2, 3)

    def test_an_edge_off_the_centre_is_none_either(self):
        """Chaplygin's sleigh: y' + a w = 0 in its own axes."""
        assert integrability(at_neutral(free(PLANE())), [VelocityConstraint("blade", [0.0, 1.0, 0.4])]).growth == (2, 3)

    def test_an_upright_disk_that_rolls_reaches_all_in_two_brackets(self):
        """X' = r cos(th) ph', y' = r sin(th) ph': (2, 3, 4) [Murray1994]."""

        def rolls(q: np.ndarray) -> np.ndarray:
            return np.array([[1.0, 0.0, 0.0, -0.3 * np.cos(q[2])], [0.0, 1.0, 0.0, -0.3 * np.sin(q[2])]])

        found = integrability(at_neutral(free(X(), Y(), TURN(), TURN())), [VelocityConstraint("disk", rolls)])
        assert found.growth == (2, 3, 4) and "all nearby can be reached" in str(found)

    def test_a_car_reaches_all_in_two_brackets(self):
        """No side slip at either axle, 0.8 apart: (2, 3, 4)."""

        def axles(q: np.ndarray) -> np.ndarray:
            s = q[2] + q[3]
            return np.array([[*along(q), 0.0], [-np.sin(s), np.cos(s), 0.8 * np.cos(q[3]), 0.0]])

        assert integrability(at_neutral(free(X(), Y(), TURN(), TURN())), [VelocityConstraint("axles", axles)]).growth == (
            2,
            3,
            4,
        )

    def test_a_car_with_a_trailer_takes_three(self):
        """Steering, car, trailer hitched at the rear axle: (2, 3, 4, 5)."""

        def axles(q: np.ndarray) -> np.ndarray:
            s, t = q[2] + q[3], q[2] + q[4]
            front = [-np.sin(s), np.cos(s), 0.8 * np.cos(q[3]), 0.0, 0.0]
            trailer = [-np.sin(t), np.cos(t), -1.0, 0.0, -1.0]
            return np.array([[*along(q), 0.0, 0.0], front, trailer])

        robot = free(X(), Y(), TURN(), TURN(), TURN())
        found = integrability(at_neutral(robot), [VelocityConstraint("axles", axles)], points=[[0.1, 0.2, 0.3, 0.2, 0.25]])
        assert found.growth == (2, 3, 4, 5)

    @pytest.mark.parametrize(("pivots", "growth"), [(True, (3, 5)), (False, (2, 3, 5))])
    def test_a_ball_on_a_plate(self, pivots: bool, growth: tuple[int, ...]):
        """With spin (3, 5); without, Cartan's (2, 3, 5)."""

        def rolls(q: np.ndarray) -> np.ndarray:
            R = pin.Quaternion(q[2:6]).matrix()
            A = np.zeros((3, 5))
            A[0, 0], A[0, 2:], A[1, 1], A[1, 2:], A[2, 2:] = 1.0, -0.4 * R[1], 1.0, 0.4 * R[0], R[2]
            return A[: 2 if pivots else 3]

        assert integrability(at_neutral(free(X(), Y(), BALL())), [VelocityConstraint("ball", rolls)]).growth == growth

    def test_a_free_ball_keeps_its_height(self):
        """Of three rows one integrates, the height: 3 degrees of freedom of velocity, 5 of configuration, of 6."""
        robot = Builder().joint("ball", FLY(), at()).robot()
        found = integrability(at_neutral(robot), [RollingBall("rolls", "ball", radius=0.3, friction=None)])
        assert found.growth == (3, 5) and (found.velocity_dof, found.configuration_dof) == (3, 5)
        assert "of 3 constraints together 1 can be integrated" in str(found)
        np.testing.assert_allclose(found.points[:, 2], 0.3, atol=1e-12)  # brought onto the plane first

    def test_a_free_disk_that_leans(self):
        """It leans, turns and rolls: (3, 4, 5) of 6, its height kept by a function of its lean."""
        robot = Builder().joint("disk", FLY(), at()).robot()
        rolls = [RollingDisk("rolls", "disk", radius=0.3, friction=None)]
        turned = pin.Quaternion(0.8, 0.5, 0.1, 0.2).normalized().coeffs()
        found = integrability(at_neutral(robot), rolls, points=[closed(robot, rolls, np.r_[0.0, 0.0, 0.3, turned]).q])
        assert found.growth == (3, 4, 5)

    def test_a_bicycle_has_three_freedoms_of_velocity_and_seven_of_configuration(self):
        """On round wheels that neither slip nor leave the ground: lean, steer and roll; 7 of 9 [Meijaard2007], section 2."""
        bicycle = rbd.load_robot(URDF / "bicycle.urdf")
        q = pin.integrate(bicycle.model, bicycle.neutral(), np.r_[0.1, 0.2, 0.0, 0.3, 0.1, 0.5, np.full(3, 0.4)])
        state = closed(bicycle, bicycle.wheels(), q)
        found = integrability(at_neutral(bicycle), points=[state.q])
        assert (found.velocity_dof, found.configuration_dof, found.growth) == (3, 7, (3, 5, 7))

    def test_two_driven_wheels_leave_one_integral(self):
        """In all r (ph1 - ph2) = 2 b th stays constant: (2, 3, 4) of 5."""
        rows = np.array([[0.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.0, -0.5, -0.1, 0.0], [1.0, 0.0, 0.5, 0.0, -0.1]])
        wheels = [VelocityConstraint("wheels", rows)]
        found = integrability(at_neutral(free(PLANE(), TURN(), TURN())), wheels, points=[[0.1, 0.2, 1.0, 0.0, 0.3, 0.1]])
        assert found.growth == (2, 3, 4) and (found.velocity_dof, found.configuration_dof) == (2, 4)

    def test_a_row_that_turns_slowly_is_told_from_one_that_does_not(self):
        """X' + k y th' = 0 with k = 1e-3 has the bracket k; the gap to what counts as zero is shown."""
        robot = free(X(), Y(), TURN())
        slow = integrability(at_neutral(robot), [VelocityConstraint("slow", lambda q: np.array([1.0, 0.0, 1e-3 * q[1]]))])
        assert slow.growth == (2, 3)
        assert all(r.gap[0] is not None and 5e-4 < r.gap[0] < 2e-3 for r in slow.reports)


class TestHolonomic:
    """Constraints of configuration, in disguise or together."""

    def test_a_row_with_an_integrating_factor_is_holonomic(self):
        """X' + x th' = 0: its mixed partial derivatives differ, and x e^th is constant; beside a free y, too."""
        two = integrability(at_neutral(free(X(), TURN())), [VelocityConstraint("row", lambda q: np.array([1.0, q[0]]))])
        assert two.holonomic and two.growth == (1,)
        three = integrability(
            at_neutral(free(X(), Y(), TURN())), [VelocityConstraint("row", lambda q: np.array([1.0, 0.0, q[0]]))]
        )
        assert three.holonomic and three.growth == (2,) and three.configuration_dof == 2
        assert max(r.gap[1] for r in three.reports) < 1e-10

    def test_the_same_row_on_a_planar_joint_is_holonomic(self):
        """There it reads (cos th, -sin th, x): brackets of the row alone would not do."""
        row = VelocityConstraint("row", lambda q: np.array([q[2], -q[3], q[0]]))
        assert integrability(at_neutral(free(PLANE())), [row]).holonomic

    def test_a_disk_that_rolls_along_a_line_is_holonomic(self):
        """X' = r th': x - r th is constant."""
        found = integrability(at_neutral(free(X(), TURN())), [VelocityConstraint("rolls", [1.0, -0.3])])
        assert found.holonomic and (found.velocity_dof, found.configuration_dof) == (1, 1)

    def test_a_wheel_whose_steering_is_locked_is_holonomic_together(self):
        """Neither row of the upright disk is integrable beside the other; with the steering locked all three are, together."""

        def rolls(q: np.ndarray) -> np.ndarray:
            return np.array([[1.0, 0.0, 0.0, -0.3 * np.cos(q[2])], [0.0, 1.0, 0.0, -0.3 * np.sin(q[2])]])

        disk, lock = VelocityConstraint("disk", rolls), VelocityConstraint("lock", [0.0, 0.0, 1.0, 0.0])
        robot = free(X(), Y(), TURN(), TURN())
        assert not integrability(at_neutral(robot), [disk]).holonomic
        assert integrability(at_neutral(robot), [disk, lock]).growth == (1,)

    def test_two_knife_edges_on_one_body_are_holonomic_together(self):
        """They leave a turn about the point where their normals meet: one degree of freedom, a circle."""
        robot = free(PLANE())
        other = VelocityConstraint("other", [np.sin(0.3), np.cos(0.3), 1.0])
        assert (
            not integrability(at_neutral(robot), [BLADE]).holonomic and not integrability(at_neutral(robot), [other]).holonomic
        )
        both = integrability(at_neutral(robot), [BLADE, other])
        assert both.holonomic and both.growth == (1,) and "blade, other" in str(both)

    def test_two_skates_on_a_hinge_are_not(self):
        """Each row alone leaves 3 of 4 and the pair 2: the growth is that of the distribution, not of its rows."""

        def skates(q: np.ndarray) -> np.ndarray:
            c, s = np.cos(q[4]), np.sin(q[4])
            return np.array([[0.0, 1.0, 0.0, 0.0], [-s, c, 1.0 * c, 0.0]])

        found = integrability(at_neutral(free(PLANE(), TURN())), [VelocityConstraint("skates", skates)])
        assert found.velocity_dof == 2 and found.configuration_dof == 4

    def test_constraints_of_configuration_given_as_velocities_are_holonomic(self):
        """A bar's length on a planar joint, its Jacobian as a Pfaffian row."""

        def row(q: np.ndarray) -> np.ndarray:
            c, s = q[2], q[3]
            return np.array([q[0] * c + q[1] * s, -q[0] * s + q[1] * c, 0.0])

        assert integrability(at_neutral(free(PLANE())), [VelocityConstraint("bar", row)]).growth == (2,)

    def test_loops_are_holonomic_also_where_rows_are_redundant(self):
        """A four-bar closed in space, and Bennett's linkage, whose rows are of full rank beside its motion."""
        assert integrability(at_neutral(planar_chain((1.0, 1.2, 1.4), 1.5)), [pinned("revolute")]).growth == (1,)
        q = closed(bennett(), [pinned("revolute")], np.array([0.9, -1.0, 0.4])).q
        assert integrability(at_neutral(bennett()), [pinned("revolute")], points=[q]).growth == (1,)

    def test_a_function_by_differences_is_holonomic(self):
        """Its J is right to 1e-10, its brackets to 1e-8: below the tolerance."""
        rod = FunctionConstraint("rod", lambda q: np.hypot(q[0] - 2.0, q[1]) + 0.3 * np.sin(q[2]) - 1.0)
        found = integrability(at_neutral(free(X(), Y(), TURN())), [rod])
        assert found.growth == (2,) and found.holonomic

    def test_a_humanoid_on_two_soles_is_holonomic(self, talos: rbd.Robot):
        """26 degrees of freedom of velocity and of configuration."""
        found = integrability(talos.at(), talos.soles(friction=None), points=[talos.standing().q])
        assert found.growth == (26,) and found.holonomic

    def test_no_constraints_take_nothing(self):
        """All brackets stay in all velocities."""
        assert integrability(at_neutral(free(FLY())), []).growth == (6,)


class TestPoints:
    """Where it looks, and what it says of it."""

    def test_it_says_where_it_looked_and_how(self):
        """Number of points, seed, tolerance, and that it is no proof."""
        text = str(integrability(at_neutral(free(PLANE())), [BLADE], seed=5))
        for words in ("3 configurations", "seed 5", "tolerance 1e-06", "not a proof", "growth vector (2, 3) of 3"):
            assert words in text

    def test_points_that_differ_are_reported(self):
        """Martinet's fields x' = y^2 z' / 2: (2, 3) off the plane y = 0, and deeper, or more slowly, on it."""
        row = VelocityConstraint("row", lambda q: np.array([1.0, 0.0, -0.5 * q[1] ** 2]))
        found = integrability(
            at_neutral(free(X(), Y(), X())), [row], points=[[0.0, 0.5, 0.0], [0.0, -0.4, 0.1], [0.0, 0.0, 0.0]]
        )
        assert not found.agreed and found.growth == (2, 3) and not found.holonomic
        assert "the points differ" in str(found)

    def test_singular_points_are_reported(self):
        """A flat parallelogram: J has a lower rank than nearby."""
        robot = planar_chain((1.0, 2.0, 1.0), 2.0)
        found = integrability(at_neutral(robot), [pinned()], points=[[0.0, 0.0, -np.pi]])
        assert not found.reports[0].regular and "singular points among them" in str(found)

    def test_points_off_the_constraints_are_refused(self):
        """And those of a wrong size, and constraints that never meet."""
        robot = planar_chain((1.0, 2.0, 1.0), 2.0)
        with pytest.raises(rbd.InputError, match="not assembled"):
            integrability(at_neutral(robot), [pinned()], points=[np.zeros(3)])
        with pytest.raises(rbd.InputError, match="expected"):
            integrability(at_neutral(robot), [pinned()], points=[np.zeros(2)])
        with pytest.raises(rbd.InputError, match="no three regular configurations"):
            integrability(at_neutral(planar_chain((1.0, 1.0), 5.0)), [pinned()])

    def test_a_locked_joint_is_one_of_position(self):
        """Points are brought onto it before they are looked at."""
        found = integrability(at_neutral(free(X(), TURN())), [JointLock("lock", "j1", position=0.7)])
        np.testing.assert_allclose(found.points[:, 1], 0.7, atol=1e-12)
        assert found.growth == (1,)

    def test_what_is_held_altogether_goes_nowhere(self):
        """A hinge whose rate is held: no degree of freedom of velocity, none of configuration."""
        found = integrability(at_neutral(free(TURN())), [VelocityConstraint("held", [1.0])])
        assert found.growth == (0,) and found.holonomic and found.configuration_dof == 0 and found.reports[0].regular

    @pytest.mark.parametrize(("limit", "value", "growth"), [("_DEEPEST", 1, (2, 3)), ("_EVALUATIONS", 20, (2, 3))])
    def test_a_growth_that_was_cut_short_says_so(self, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, growth: object):
        """A rolling disk grows (2, 3, 4): with one bracket, or work for one, it is not said to reach no more than three."""

        def rolls(q: np.ndarray) -> np.ndarray:
            return np.array([[1.0, 0.0, 0.0, -0.3 * np.cos(q[2])], [0.0, 1.0, 0.0, -0.3 * np.sin(q[2])]])

        disk = free(X(), Y(), TURN(), TURN())
        assert integrability(at_neutral(disk), [VelocityConstraint("rolls", rolls)]).growth == (2, 3, 4)
        monkeypatch.setattr(sys.modules["rbd.mechanism.frobenius"], limit, value)
        found = integrability(at_neutral(disk), [VelocityConstraint("rolls", rolls)])
        assert found.growth == growth and not found.complete
        assert "it was still growing" in str(found)

    def test_draws_where_a_rank_changes_nearby_are_left_out(self):
        """A row that comes and goes every hundredth of a radian, zero or one: only points where it holds are looked at."""
        row = VelocityConstraint("comb", lambda q: np.array([float(np.floor(100.0 * q[0]) % 2.0), 0.0]))
        found = integrability(at_neutral(free(TURN(), TURN())), [row], seed=1)
        assert len(found.reports) == 3 and all(r.rank == 1 and r.regular for r in found.reports)
        assert all(np.floor(100.0 * q[0]) % 2.0 == 1.0 for q in found.points)
