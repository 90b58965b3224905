"""Mobility three ways: linkages whose degrees of freedom are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from linkages import (
    Builder,
    about,
    at,
    bennett,
    closed,
    four_bar_pose,
    free,
    pinned,
    planar_chain,
    sarrus,
    sarrus_pose,
    spatial_loop,
)

import rbd
from rbd.constraints import FunctionConstraint, JointLock, KnifeEdge, LoopClosure
from rbd.constraints.manifold import ConstraintManifold
from rbd.mechanism import mobility
from rbd.mechanism.degrees_of_freedom import _regular

NORTON = (40.0, 120.0, 80.0, 100.0)


def four_bar(a: float, b: float, c: float, d: float) -> rbd.model.checked_model.CheckedModel:
    return planar_chain((a, b, c), d)


class TestFourBar:
    """The linkage of the text, and loops of more bars."""

    @pytest.mark.parametrize(("kind", "redundant"), [("planar", 0), ("point", 1), ("revolute", 3)])
    def test_a_four_bar_has_one_freedom_however_it_is_closed(self, kind: str, redundant: int):
        """3 (4 - 1 - 4) + 4 = 1, n - rank J = 3 - 2, and it moves; rows out of the plane are told to be redundant."""
        state = rbd.State(four_bar(*NORTON), four_bar_pose(*NORTON, np.deg2rad(40.0)))
        found = mobility(state, [pinned(kind)])
        assert (found.count.value, found.instantaneous, found.finite, found.rank) == (1, 1, 1, 2)
        assert found.count.planar and found.count.formula == "planar: 3 (4 - 1 - 4) + 4 = 1"
        assert found.branches == (1,) and found.moves and not found.over_constrained and not found.singular
        assert [r.row for r in found.redundant] == [("pin", i) for i in range(2, 2 + redundant)]
        assert all(r.follows_from == () for r in found.redundant)

    def test_a_welded_four_bar_is_a_structure(self):
        """Six rows at the last pin lock its hinge: 3 (4 - 1 - 4) + 3 = 0."""
        q = four_bar_pose(*NORTON, np.deg2rad(40.0))
        build = planar_chain(NORTON[:3], NORTON[3])
        here = rbd.State(build, q).frame("end").X_WF
        build.model.addFrame(pin.Frame("seat", 0, 0, here, pin.FrameType.OP_FRAME))
        robot = rbd.model.checked_model.CheckedModel(build.model)
        found = mobility(rbd.State(robot, q), [LoopClosure("weld", "seat", "end", kind="rigid")])
        assert (found.count.value, found.instantaneous, found.finite) == (0, 0, 0)
        assert found.branches == () and found.motion.tried == 0  # nothing moves: no motion is looked for, and none is told
        assert found.verdict.startswith("a structure:") and not found.moves

    @pytest.mark.parametrize("size", [1e-4, 1.0, 1e3])
    def test_size_does_not_matter(self, size: float):
        """A watchmaker's four-bar and a bridge's have the same singular values."""
        lengths = tuple(size * np.array([1.0, 3.0, 2.0, 2.5]))
        q = four_bar_pose(*lengths, 0.7)
        found = mobility(rbd.State(four_bar(*lengths), q), [pinned("revolute")])
        one = mobility(rbd.State(four_bar(1.0, 3.0, 2.0, 2.5), q), [pinned("revolute")])
        assert (found.count, found.rank, found.finite) == (one.count, one.rank, one.finite)
        np.testing.assert_allclose(found.singular_values, one.singular_values, rtol=1e-9, atol=1e-12)

    def test_chains_of_bars_have_one_freedom_a_bar_more(self):
        """A loop of k bars in a plane: k - 3."""
        for k in (5, 6, 8):
            robot = planar_chain((1.0,) * (k - 1), 1.5)
            found = mobility(closed(robot, [pinned()], np.linspace(0.3, 0.9, k - 1)), [pinned()])
            assert (found.count.value, found.instantaneous, found.finite) == (k - 3,) * 3


class TestSingularConfigurations:
    """Where J allows more than moves."""

    def test_a_flat_parallelogram_has_two_ways_to_go_on(self):
        """J allows two degrees of freedom of velocity; as a parallelogram or crossed it moves with one."""
        found = mobility(rbd.State(four_bar(1.0, 2.0, 1.0, 2.0), [0.0, 0.0, -np.pi]), [pinned()])
        assert (found.count.value, found.instantaneous, found.finite) == (1, 2, 1)
        assert found.branches == (1, 1) and found.singular
        assert "2 branches were found, of 1, 1 degrees of freedom" in found.verdict

    def test_near_its_flat_pose_a_parallelogram_has_one(self):
        """The other branch only comes near."""
        q = np.array([0.02, -0.02, -np.pi + 0.02])
        found = mobility(rbd.State(four_bar(1.0, 2.0, 1.0, 2.0), q), [pinned("point")])
        assert (found.instantaneous, found.finite, found.branches) == (1, 1, (1,))

    def test_a_change_point_without_equal_bars_has_two_ways_too(self):
        """A + b = c + d, laid flat."""
        found = mobility(rbd.State(four_bar(1.0, 2.0, 1.5, 1.5), [0.0, 0.0, np.pi]), [pinned()])
        assert (found.instantaneous, found.finite, found.branches) == (2, 1, (1, 1))

    def test_a_stretched_string_of_bars_only_gives_a_little(self):
        """A + b + c = d: two degrees of freedom of velocity, and nowhere to go."""
        found = mobility(rbd.State(four_bar(1.0, 1.0, 1.0, 3.0), np.zeros(3)), [pinned()])
        assert (found.count.value, found.instantaneous, found.finite) == (1, 2, 0)
        assert not found.moves and "infinitesimally mobile" in found.verdict

    def test_a_stretched_triangle_only_gives_a_little(self):
        """Two bars in line between their pivots: a structure by the count, shaky, and rigid."""
        found = mobility(rbd.State(planar_chain((1.0, 1.0), 2.0), np.zeros(2)), [pinned()])
        assert (found.count.value, found.instantaneous, found.finite) == (0, 1, 0)

    def test_a_stretched_pair_of_bars_carried_about_gives_a_little_everywhere(self):
        """On the coupler of a four-bar: velocities of dimension two at every pose, motions of one; that is no singularity."""
        build = Builder()
        for name, parent, x in (("crank", None, 0.0), ("coupler", "crank", 1.0), ("rocker", "coupler", 3.0)):
            build.joint(name, pin.JointModelRZ(), at(x), parent)
        build.joint("one", pin.JointModelRZ(), at(1.0), "coupler").joint("two", pin.JointModelRZ(), at(0.5), "one")
        build.frame("end", "rocker", at(2.0)).frame("pivot", None, at(2.5))
        build.frame("tip", "two", at(0.5)).frame("hook", "coupler", at(2.0))
        q = np.r_[four_bar_pose(1.0, 3.0, 2.0, 2.5, 0.7), 0.0, 0.0]
        found = mobility(rbd.State(build.robot(), q), [pinned(), LoopClosure("hung", "hook", "tip", kind="planar")])
        assert (found.count.value, found.instantaneous, found.finite) == (1, 2, 1)
        assert not found.singular and found.branches == (1,)
        assert found.verdict == "it moves with 1 degree of freedom; other velocities that J allows extend to no finite motion"


class TestOverConstrained:
    """Where more moves than the count allows."""

    def test_bennetts_linkage_moves_although_the_count_forbids_it(self):
        """6 (4 - 1 - 4) + 4 = -2 [Bennett1903]."""
        state = closed(bennett(), [pinned("revolute")], np.array([0.9, -1.0, 0.4]))
        found = mobility(state, [pinned("revolute")])
        assert (found.count.value, found.instantaneous, found.finite) == (-2, 1, 1)
        assert found.count.formula == "spatial: 6 (4 - 1 - 4) + 4 = -2"
        assert found.over_constrained and len(found.redundant) == 3 and "over-constrained" in str(found)

    def test_four_hinges_that_meet_by_chance_are_a_structure(self):
        """Bennett's linkage with one twist changed, its ground set to where it closes."""
        robot = spatial_loop([(1.0, 0.6), (1.4, 0.9), (1.0, 0.5), (1.4, 0.9)])
        q = np.array([0.9, -1.0, 0.4])
        robot.model.addFrame(pin.Frame("seat", 0, 0, rbd.State(robot, q).frame("end").X_WF, pin.FrameType.OP_FRAME))
        robot = rbd.model.checked_model.CheckedModel(robot.model)
        found = mobility(rbd.State(robot, q), [LoopClosure("hinge", "seat", "end", kind="revolute")])
        assert (found.count.value, found.instantaneous, found.finite) == (-2, 0, 0)

    def test_a_bennett_linkage_of_rounded_lengths_moves_within_the_rounding(self):
        """Lengths to 1e-7 break it by as much: refused at the usual tolerance, said to move at one that allows for it."""
        a, alpha, b = 1.0, 0.6, 1.4
        beta = float(np.arcsin(b * np.sin(alpha)))
        rounded = spatial_loop([(a, alpha), (b, beta + 1e-7), (a, alpha), (b, beta)])
        q = closed(bennett(), [pinned("revolute")], np.array([0.9, -1.0, 0.4])).q
        with pytest.raises(rbd.InputError, match="not assembled"):
            mobility(rbd.State(rounded, q), [pinned("revolute")])
        found = mobility(rbd.State(rounded, q), [pinned("revolute")], tolerance=1e-6)
        assert found.finite == 1

    def test_sarrus_linkage_goes_up_and_down(self):
        """Six hinges: counted 0, one degree of freedom, and its platform does not turn [Sarrus1853]."""
        robot, hinge = sarrus()
        state = rbd.State(robot, sarrus_pose(0.8))
        found = mobility(state, [hinge])
        assert (found.count.value, found.instantaneous, found.finite) == (0, 1, 1)
        z = found.motion.branches[0].tangent[:, 0]
        twist = state.frame("edge").J @ z
        assert np.abs(twist[[0, 1, 3, 4, 5]]).max() < 1e-9 < 0.1 < abs(twist[2])

    def test_four_hinges_that_meet_in_a_point_move(self):
        """The spherical four-bar: counted -2 as any in space."""
        robot = spatial_loop([(0.0, 0.5), (0.0, 1.1), (0.0, 0.9), (0.0, 1.2)])
        found = mobility(closed(robot, [pinned("revolute")], np.array([0.9, -1.4, 2.0])), [pinned("revolute")])
        assert (found.count.value, found.instantaneous, found.finite) == (-2, 1, 1)

    def test_a_parallelogram_with_a_third_crank_moves(self):
        """In the plane: 3 (5 - 1 - 6) + 6 = 0, and it moves as long as the cranks are equal and parallel."""
        q, angle = np.array([0.6, -0.6, 0.6, 0.6]), 0.6
        pins = [LoopClosure("ab", "a", "b", kind="planar"), LoopClosure("cd", "c", "d", kind="planar")]

        def three_cranks(third: float) -> rbd.mechanism.Mobility:
            build = Builder()
            build.joint("crank", pin.JointModelRZ(), at()).joint("coupler", pin.JointModelRZ(), at(1.0), "crank")
            build.joint("second", pin.JointModelRZ(), at(2.0)).joint("third", pin.JointModelRZ(), at(1.0))
            build.frame("a", "second", at(1.0)).frame("b", "coupler", at(2.0)).frame("c", "third", at(third))
            tip = np.array([1.0, 0.0]) + (third - 1.0) * np.array([np.cos(angle), np.sin(angle)])  # where it is now
            return mobility(rbd.State(build.frame("d", "coupler", at(*tip)).robot(), q), pins)

        equal, shorter = three_cranks(1.0), three_cranks(0.8)
        assert (equal.count.value, equal.instantaneous, equal.finite) == (0, 1, 1) and equal.over_constrained
        assert (shorter.count.value, shorter.finite) == (0, 0)

    def test_self_stresses_push_nothing(self):
        """J^T f = 0, one for each redundant row."""
        constraints = [pinned("revolute")]
        state = closed(bennett(), constraints, np.array([0.9, -1.0, 0.4]))
        found = mobility(state, constraints)
        assert found.self_stresses.shape == (5, 3)
        J = constraints[0].rows(state).J
        assert np.abs(J.T @ found.self_stresses).max() < 1e-12
        assert np.linalg.matrix_rank(found.self_stresses) == 3


class TestRows:
    """What rows are named, refused and counted."""

    def test_rows_that_repeat_others_are_named(self):
        """Two locks on one joint: the second follows from the first, or the first from the second."""
        robot = free(pin.JointModelRZ(), pin.JointModelRX())
        locks = [JointLock(name, "j0", position=0.0) for name in ("one", "two")]
        found = mobility(rbd.State(robot, np.zeros(2)), locks)
        assert (found.rows, found.rank, found.finite) == (2, 1, 1)
        row = found.redundant[0]
        assert {row.row, *row.follows_from} == {("one", 0), ("two", 0)}
        assert "follows from" in str(found)

    def test_a_robot_without_constraints_moves_with_all_it_has(self, talos: rbd.Robot):
        """38 degrees of freedom, counted 6 (34 - 1 - 33) + 38."""
        found = mobility(talos.at(), [])
        assert (found.count.value, found.instantaneous, found.finite) == (38, 38, 38)

    def test_a_humanoid_on_its_soles_keeps_26_freedoms(self, talos: rbd.Robot):
        """Contacts that hold are anchored where they are; two soles take twelve."""
        found = mobility(talos.standing(), talos.soles(friction=None))
        assert (found.count.value, found.instantaneous, found.finite) == (26, 26, 26)
        assert found.redundant == () and not found.velocity_only

    def test_a_knife_edge_is_said_to_constrain_velocity_alone(self):
        """Two degrees of freedom of velocity; of configuration see integrability."""
        robot = free(pin.JointModelPlanar())
        found = mobility(rbd.State(robot, pin.neutral(robot.model)), [KnifeEdge("blade", "j0")])
        assert found.velocity_only and (found.instantaneous, found.finite) == (2, 2)
        assert "velocity alone" in found.verdict

    def test_off_the_constraints_it_is_refused_with_the_row_and_the_distance(self):
        """A four-bar whose pin is 0.1 m off."""
        robot = planar_chain((1.0, 1.0), 1.9)
        with pytest.raises(rbd.InputError, match=r"row 0 of 'pin' is off by 0\.1"):
            mobility(rbd.State(robot, np.zeros(2)), [pinned()])

    def test_contacts_that_can_slip_are_refused_by_name(self, talos: rbd.Robot):
        """Mobility is of what holds."""
        with pytest.raises(rbd.InputError, match="left_sole.*can break or slip"):
            mobility(talos.standing(), talos.soles(friction=0.5))

    def test_two_constraints_of_one_name_are_refused(self):
        """Redundant rows go by name."""
        robot = free(pin.JointModelRZ())
        with pytest.raises(rbd.errors.DuplicateName, match="lock"):
            mobility(rbd.State(robot, np.zeros(1)), [JointLock("lock", "j0", position=0.0)] * 2)

    def test_only_parallel_axes_are_counted_in_a_plane(self):
        """Three hinges about z and a slider across them are planar; about a tilted axis, or a slider along z, they are not."""
        kinds = (pin.JointModelRZ(), pin.JointModelPX(), pin.JointModelRZ())
        assert mobility(rbd.State(free(*kinds), np.full(3, 0.3)), []).count.planar
        for other in (pin.JointModelRX(), pin.JointModelPZ()):
            assert not mobility(rbd.State(free(*kinds, other), np.full(4, 0.3)), []).count.planar
        tilted = Builder().joint("a", pin.JointModelRZ(), at(R=about("x", 0.4))).joint("b", pin.JointModelRZ(), at(1.0), "a")
        assert mobility(rbd.State(tilted.robot(), np.ones(2)), []).count.planar

    def test_what_is_printed_says_how_it_was_found(self):
        """Formula, rank, tolerance, seed, and that it is no proof."""
        text = str(mobility(rbd.State(four_bar(1.0, 2.0, 1.0, 2.0), [0.0, 0.0, -np.pi]), [pinned()], seed=3))
        for words in ("3 (4 - 1 - 4) + 4 = 1", "n - rank J = 3 - 1", "1e-08", "directions tried", "seed 3", "not a proof"):
            assert words in text


def surface(phi: Callable[[np.ndarray], object], jacobian: Callable[[np.ndarray], object], n: int) -> rbd.mechanism.Mobility:
    """Mobility at the origin of a point in a plane or in space whose coordinates x, y, z satisfy phi = 0."""
    robot = free(*(kind() for kind in (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)[:n]))
    constraint = FunctionConstraint("phi", phi, jacobian=lambda q: np.array(jacobian(q), float).reshape(-1, n))
    return mobility(rbd.State(robot, np.zeros(n)), [constraint])


class TestFiniteMotionOfSurfaces:
    """What the method makes of points of varieties that are drawn in every book: J vanishes at all of them."""

    def test_a_plane_and_a_line_through_it(self):
        """X y = x z = 0: branches of two degrees of freedom and of one."""
        found = surface(lambda q: [q[0] * q[1], q[0] * q[2]], lambda q: [[q[1], q[0], 0.0], [q[2], 0.0, q[0]]], 3)
        assert (found.instantaneous, found.finite, found.branches) == (3, 2, (2, 1)) and found.singular

    def test_a_cone_has_two_freedoms_at_its_apex(self):
        """X^2 + y^2 = z^2, where J allows all three velocities."""
        found = surface(lambda q: [q[0] ** 2 + q[1] ** 2 - q[2] ** 2], lambda q: [2 * q[0], 2 * q[1], -2 * q[2]], 3)
        assert (found.instantaneous, found.finite, found.branches) == (3, 2, (2,))

    def test_three_planes_have_two_freedoms_where_they_meet(self):
        """X y z = 0: lines where two planes meet are singular themselves and are not taken for more."""
        found = surface(lambda q: [q[0] * q[1] * q[2]], lambda q: [q[1] * q[2], q[0] * q[2], q[0] * q[1]], 3)
        assert (found.instantaneous, found.finite) == (3, 2)

    def test_a_cusp_can_be_left(self):
        """Y^2 = x^3: two arms, both to one side."""
        found = surface(lambda q: [q[1] ** 2 - q[0] ** 3], lambda q: [-3 * q[0] ** 2, 2 * q[1]], 2)
        assert (found.instantaneous, found.finite, found.branches) == (2, 1, (1, 1))

    @pytest.mark.parametrize("power", [2, 3, 4])
    def test_a_line_counted_twice_or_more_is_a_line(self, power: int):
        """X^k = 0: along y it moves, across it only gives a little, here as everywhere."""
        found = surface(lambda q: [q[0] ** power], lambda q: [power * q[0] ** (power - 1), 0.0], 2)
        assert (found.instantaneous, found.finite) == (2, 1) and not found.singular

    def test_a_point_is_a_point(self):
        """X^2 + y^2 + z^2 = 0."""
        found = surface(lambda q: [q @ q], lambda q: 2.0 * q, 3)
        assert (found.instantaneous, found.finite, found.branches) == (3, 0, ())

    def test_two_points_beside_each_other_are_points(self):
        """X^2 (x - 0.1) = 0: what is found a step away stands alone there, so nothing moves."""
        found = surface(lambda q: [q[0] ** 2 * (q[0] - 0.1)], lambda q: [3.0 * q[0] ** 2 - 0.2 * q[0]], 1)
        assert (found.instantaneous, found.finite, found.branches) == (1, 0, ())

    def test_a_point_where_two_planes_meet_is_looked_at_beside(self):
        """X y z = 0 on the x axis has no rank; a step off, on one plane, it has one, and two degrees of freedom."""
        robot = free(pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ())
        phi = FunctionConstraint(
            "phi", lambda q: [q[0] * q[1] * q[2]], jacobian=lambda q: np.array([[q[1] * q[2], q[0] * q[2], q[0] * q[1]]])
        )
        q = np.array([0.5, 0.0, 0.0])
        held = ConstraintManifold(rbd.State(robot, q), [phi])
        point, tangent = _regular(held, held.at(q), np.random.default_rng(0))
        off = np.sort(np.abs(point.q))
        assert off[0] < 1e-7 < off[1] and tangent.shape == (3, 2)

    def test_a_platform_on_six_legs_moves_if_it_is_similar_to_its_base(self):
        """Two regular hexagons, leg to leg: with six legs of one length it screws up and down; otherwise six legs hold it."""
        base = 2.0 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(6) * np.pi / 3.0])

        def legs(q: np.ndarray, platform: np.ndarray) -> np.ndarray:
            return np.linalg.norm(q[:3] + platform @ pin.Quaternion(q[3:]).matrix().T - base, axis=1)

        def rates(platform: np.ndarray, q: np.ndarray) -> np.ndarray:
            R = pin.Quaternion(q[3:]).matrix()
            along = (q[:3] + platform @ R.T - base) @ R / legs(q, platform)[:, None]  # in the platform's axes
            return np.hstack([along, np.cross(platform, along)])

        robot, q = free(pin.JointModelFreeFlyer()), np.array([0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0])
        moved = pin.integrate(robot.model, q, np.linspace(-0.3, 0.4, 6))
        uneven = base[:, [1, 0, 2]] * [0.5, 0.3, 1.0] + [0.1, 0.0, 0.0]
        for platform, expected in ((0.6 * base, 1), (uneven, 0)):
            lengths = legs(q, platform)
            hold = FunctionConstraint("legs", lambda q, p=platform, at=lengths: legs(q, p) - at)
            J = partial(rates, platform)
            assert np.abs(J(moved) - hold.rows(rbd.State(robot, moved)).J).max() < 1e-8
            found = mobility(rbd.State(robot, q), [replace(hold, jacobian=J)])
            assert (found.count.value, found.finite) == (0, expected)

    def test_a_row_of_rhombi_laid_flat_has_a_way_for_each(self):
        """N loops lose N ranks; each may fold or stay, N + 1 ways in all, each of one degree of freedom."""
        for n in (1, 2):
            robot = rbd.mechanism.n_four_bar(n)
            found = mobility(robot.at())
            assert (found.instantaneous, found.finite) == (n + 1, 1) and len(found.branches) == n + 1
