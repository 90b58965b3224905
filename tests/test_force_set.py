"""The true sets of rows: columns, bounds, and what velocities have decided; against the physics of points, corner by corner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import block_diagonal
from rbd.problem.cones import project_cones, pyramid
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.corner_cones import LineCone, WrenchCone
from rbd.problem.force_set import ForceSet
from rbd.testing import box

FAST = 10 * REST_SPEED


def rows_with(cone, velocity=None, name="rows", J=None) -> rbd.Rows:
    """Rows of a cone, J the identity unless given."""
    m = cone.dim
    given = {} if velocity is None else {"velocity": np.array(velocity, float)}
    return rbd.Rows(name, np.eye(m) if J is None else J, np.zeros(m), cone, **given)


def square(mu=0.5) -> WrenchCone:
    """A sole of half lengths 0.2 and 0.1."""
    return WrenchCone(np.array([[0.2, 0.1, 0], [0.2, -0.1, 0], [-0.2, -0.1, 0], [-0.2, 0.1, 0]]), mu)


class TestAtRest:
    """No velocity: G and H are the generators, and parts keep their bounds."""

    def test_columns_and_bounds_are_those_of_the_sets(self):
        """A line, a half-line, an interval and a cone, in order; cones alone are free in each column."""
        cone = rbd.problem.Product(
            [rbd.problem.Free(1), rbd.problem.NonNegative(1), rbd.problem.Bounds([-1.0], [2.0]), rbd.problem.FrictionCone(0.5)]
        )
        T = ForceSet.of([rows_with(cone)])
        assert T.G == pytest.approx(np.eye(6)) and T.H is T.G
        assert T.lower.tolist() == [-np.inf, 0.0, -1.0, -np.inf, -np.inf, -np.inf]
        assert T.upper.tolist() == [np.inf, np.inf, 2.0, np.inf, np.inf, np.inf]
        assert T.cone_at.tolist() == [3] and T.mu.tolist() == [0.5] and T.slices == (slice(0, 6),)
        assert not T.offset.any() and T.sliding == () and T.openings == () and T.impact == ""

    def test_constraints_stand_one_after_the_other(self):
        """Block-diagonal G; each constraint has its columns, and a sole with friction twelve."""
        T = ForceSet.of(
            [
                rows_with(rbd.problem.Free(2), name="held"),
                rows_with(square(), name="sole"),
                rows_with(rbd.problem.NonNegative(1)),
            ]
        )
        assert T.slices == (slice(0, 2), slice(2, 14), slice(14, 15)) and T.G.shape == (9, 15) and T.size == 15
        assert T.G[2:8, 2:14] == pytest.approx(square().corner_map)
        assert not T.G[:2, 2:].any() and not T.G[2:8, 14:].any() and T.G[8, 14] == 1.0
        assert T.cone_columns.tolist() == [[2, 3, 4], [5, 6, 7], [8, 9, 10], [11, 12, 13]]

    def test_without_friction_a_cone_is_its_normal(self):
        """FrictionCone(0), a sole with friction 0: one half-line a point, along the normal."""
        T = ForceSet.of([rows_with(rbd.problem.FrictionCone(0.0), name="point"), rows_with(square(0.0), name="sole")])
        assert T.size == 5 and not len(T.mu) and (T.lower == 0.0).all()
        assert T.G[:3, 0] == pytest.approx([0, 0, 1]) and T.G[3:, 1:] == pytest.approx(square().corner_map[:, 2::3])

    def test_no_rows_have_no_columns(self):
        """And nothing breaks on them."""
        T = ForceSet.of([])
        assert T.size == 0 and T.project(np.zeros(0)).shape == (0,) and T.accelerations(np.zeros(0), coulomb=True).shape == (0,)

    def test_speeds_up_to_the_limit_are_rest(self):
        """1e-6 m/s: the very same parts, kept from one problem to the next and not to be written on."""
        still, slow = (
            rows_with(rbd.problem.FrictionCone(0.5)),
            rows_with(rbd.problem.FrictionCone(0.5), [REST_SPEED, 0.0, -REST_SPEED]),
        )
        T = ForceSet.of([slow])
        assert ForceSet.of([still]) is T
        with pytest.raises(ValueError, match="read-only"):
            T.G[0, 0] = 2.0


class TestMoving:
    """What each velocity leaves of a set."""

    @pytest.mark.parametrize("angle", [0.0, 1.0, -2.0])
    def test_a_sliding_point_is_one_column_against_its_motion(self, angle):
        """G = (-mu t, 1), H = normal, weight >= 0."""
        t = np.array([np.cos(angle), np.sin(angle)])
        T = ForceSet.of([rows_with(rbd.problem.FrictionCone(0.7), [*(3.0 * t), 0.0], "toe")])
        assert T.G == pytest.approx(np.r_[-0.7 * t, 1.0][:, None]) and T.H == pytest.approx(np.array([[0, 0, 1.0]]).T)
        (s,) = T.sliding
        assert (s.rows, s.corner, s.column, s.mu) == ("toe", 0, 0, 0.7)
        assert s.direction == pytest.approx(tuple(t)) and s.speed == pytest.approx(3.0)
        assert (T.lower[0], T.upper[0], len(T.mu)) == (0.0, np.inf, 0)
        assert T.accelerations(np.array([5.0, 6.0, 7.0]), coulomb=True) == pytest.approx([7.0])

    def test_a_point_that_leaves_carries_nothing(self):
        """Bounds [0, 0], whatever its tangential velocity; its name is told."""
        for tangential in (0.0, 2.0):
            T = ForceSet.of([rows_with(rbd.problem.FrictionCone(0.7), [tangential, 0.0, FAST], "toe")])
            assert (
                [o.rows for o in T.openings] == ["toe"]
                and T.lower.tolist() == T.upper.tolist() == [0.0]
                and not T.sliding
                and not T.impact
            )

    def test_a_point_that_comes_in_is_an_impact(self):
        """In words, with its name and speed; the first of several."""
        T = ForceSet.of(
            [
                rows_with(rbd.problem.FrictionCone(0.7), [0, 0, -0.25], "toe"),
                rows_with(rbd.problem.NonNegative(1), [-9.0], "stop"),
            ]
        )
        assert "'toe' approaches at 0.25 m/s" in T.impact
        assert "'stop' approaches at 9 m/s" in ForceSet.of([rows_with(rbd.problem.NonNegative(1), [-9.0], "stop")]).impact

    def test_a_stop_that_is_left_carries_nothing(self):
        """NonNegative rows one by one: the second moves away, the first keeps its half-line."""
        T = ForceSet.of([rows_with(rbd.problem.NonNegative(2), [0.0, 1.0])])
        assert T.upper.tolist() == [np.inf, 0.0] and [o.rows for o in T.openings] == ["rows"]

    def test_a_smooth_point_may_slide(self):
        """Without friction the tangential velocity decides nothing."""
        T = ForceSet.of([rows_with(rbd.problem.FrictionCone(0.0), [3.0, 0.0, 0.0])])
        assert not T.sliding and T.G == pytest.approx(np.array([[0, 0, 1.0]]).T) and T.upper[0] == np.inf

    @pytest.mark.parametrize(("velocity", "bound"), [(2.0, -3.0), (-2.0, 5.0)])
    def test_dry_friction_stands_at_the_bound_against_the_motion(self, velocity, bound):
        """Box(-3, 5): all of -3 against a positive rate, all of 5 against a negative one."""
        T = ForceSet.of([rows_with(rbd.problem.Bounds([-3.0], [5.0]), [velocity])])
        assert T.lower.tolist() == T.upper.tolist() == [bound]

    def test_an_interval_without_that_bound_keeps_its_choice(self):
        """Nothing finite stands against the motion."""
        T = ForceSet.of([rows_with(rbd.problem.Bounds([-np.inf], [5.0]), [2.0])])
        assert T.lower[0] == -np.inf and T.upper[0] == 5.0

    def test_rows_that_hold_do_not_mind_moving(self):
        """Free rows at any velocity: lines."""
        T = ForceSet.of([rows_with(rbd.problem.Free(3), [1.0, -2.0, 3.0])])
        assert np.isinf(T.lower).all() and np.isinf(T.upper).all() and T.G == pytest.approx(np.eye(3))

    def test_others_are_not_touched_by_one_that_moves(self):
        """A sliding point between a point at rest and a held row: their columns are as they were."""
        rows = [
            rows_with(rbd.problem.FrictionCone(0.4), name="rest"),
            rows_with(rbd.problem.FrictionCone(0.6), [0, 1.0, 0], "slides"),
            rows_with(rbd.problem.Free(1), [5.0], "held"),
        ]
        T = ForceSet.of(rows)
        assert T.slices == (slice(0, 3), slice(3, 4), slice(4, 5)) and T.cone_at.tolist() == [0] and T.mu.tolist() == [0.4]
        assert T.G[:, :3] == pytest.approx(np.eye(7)[:, :3]) and T.G[:, 4] == pytest.approx(np.eye(7)[6])
        assert T.G[3:6, 3] == pytest.approx([0, -0.6, 1]) and T.H[3:6, 3] == pytest.approx([0, 0, 1])


class TestMovingSole:
    """A patch's corners move each in their own way."""

    def test_corners_of_a_turning_sole_slide_each_in_its_own_direction(self):
        """The velocity of corner p is v + w x p; friction is against it."""
        v, w, cone = np.array([0.3, -0.1, 0.0]), np.array([0.0, 0.0, 2.0]), square()
        T = ForceSet.of([rows_with(cone, [*v, *w], "sole")])
        assert [s.corner for s in T.sliding] == [0, 1, 2, 3]
        for i, s in enumerate(T.sliding):
            u = v + np.cross(w, cone.corners[i])
            assert s.direction == pytest.approx(tuple(u[:2] / np.linalg.norm(u))) and s.speed == pytest.approx(
                np.linalg.norm(u)
            )
            force = np.array([*(-0.5 * u[:2] / np.linalg.norm(u)), 1.0])
            assert T.G[:, s.column] == pytest.approx(np.r_[force, np.cross(cone.corners[i], force)])
            assert T.H[:, s.column] == pytest.approx(np.r_[0, 0, 1, np.cross(cone.corners[i], [0, 0, 1])])

    def test_a_tipping_sole_stands_on_its_edge(self):
        """Turning about the edge x = .2: its two corners are cones at rest, the others carry nothing."""
        w, edge = np.array([0.0, 0.5, 0.0]), np.array([0.2, 0.0, 0.0])
        T = ForceSet.of([rows_with(square(), [*-np.cross(w, edge), *w], "sole")])
        assert {o.rows for o in T.openings} == {"sole"} and T.cone_at.tolist() == [0, 3] and T.size == 8 and not T.sliding
        assert T.upper[6:].tolist() == [0.0, 0.0]
        # corners of the edge move towards the centre's side with w^2 L, here -x
        assert T.offset[:6] == pytest.approx(np.tile([-0.25 * 0.2, 0, 0], 2))

    @pytest.mark.parametrize("friction", [0.0, 0.5])
    def test_y_is_the_acceleration_of_the_corners(self, friction):
        """H^T c + offset, against second differences of a tumbling box's corners on the curve q (+) (v t + a t^2/2)."""
        rng = np.random.default_rng(8)
        robot = box(2.0, (0.4, 0.2, 0.1))
        sole = rbd.SurfaceContact("sole", "box", half_lengths=(0.2, 0.1), friction=friction)
        q, v, a = pin.neutral(robot.model), rng.normal(size=6), rng.normal(size=6)
        rows = sole.rows(rbd.State(robot, q, v))
        # upwards at every corner, so that all of them open, whatever they do along the ground
        T = ForceSet.of([rbd.Rows("sole", rows.J, rows.bias, rows.cone, velocity=rows.velocity + [0, 0, 50.0, 0, 0, 0])])
        y = T.accelerations(rows.J @ a + rows.bias, coulomb=False)
        h = 1e-3

        def corners(t: float) -> np.ndarray:
            X = pin.XYZQUATToSE3(pin.integrate(robot.model, q, v * t + 0.5 * a * t * t))
            return np.array([X.act(corner) for corner in sole.corners])

        second = (-corners(2 * h) + 16 * corners(h) - 30 * corners(0) + 16 * corners(-h) - corners(-2 * h)) / (12 * h * h)
        assert y == pytest.approx(second[:, 2], abs=1e-6) and np.abs(T.offset).max() > 0.05

    def test_at_rest_corners_have_no_centripetal_part(self):
        """A sole that translates: the offset is zero."""
        assert not ForceSet.of([rows_with(square(), [0.3, 0, 0, 0, 0, 0])]).offset.any()

    def test_a_lines_ends_move_as_a_soles_corners_on_that_line(self):
        """A line of half length .2 turning about its normal, and a sole's corners at the same places: the same columns."""
        line = LineCone(0.2, 0.5)
        ends = WrenchCone(np.array([[0.2, 0, 0], [-0.2, 0, 0]]), 0.5)
        v, w = np.array([0.3, 0.1, 0.0]), np.array([0.0, 0.0, 1.5])
        T, S = ForceSet.of([rows_with(line, [*v, *w[1:]])]), ForceSet.of([rows_with(ends, [*v, *w])])
        five = [0, 1, 2, 4, 5]
        assert T.G == pytest.approx(S.G[five]) and T.H == pytest.approx(S.H[five]) and T.offset == pytest.approx(S.offset)
        assert [s.direction for s in T.sliding] == [s.direction for s in S.sliding]

    def test_a_product_of_soles_turns_each_by_its_own_rate(self):
        """Two soles in one constraint: the offsets are those of the soles by themselves."""
        one, two = [0.1, 0, 0, 0, 0, 1.0], [0, 0.2, 0, 0, 0, -3.0]
        both = ForceSet.of([rows_with(rbd.problem.Product([square(), square(0.3)]), [*one, *two])])
        apart = [ForceSet.of([rows_with(square(mu), u)]) for mu, u in ((0.5, one), (0.3, two))]
        assert both.offset == pytest.approx(np.concatenate([T.offset for T in apart]))
        assert both.G[:6, :4] == pytest.approx(apart[0].G) and both.G[6:, 4:] == pytest.approx(apart[1].G)
        assert [s.corner for s in both.sliding] == list(range(8))


class TestWeights:
    """Projection, distances, products, forces."""

    parts = ForceSet.of(
        [
            rows_with(
                rbd.problem.Product([rbd.problem.Free(1), rbd.problem.NonNegative(1), rbd.problem.Bounds([-1.0], [2.0])]),
                name="singles",
            ),
            rows_with(rbd.problem.FrictionCone(0.5), name="point"),
        ]
    )

    def test_projected_weights_are_the_nearest(self):
        """In their sets, and no other weights in the sets are nearer: 200 drawn ones."""
        rng = np.random.default_rng(2)
        for _ in range(20):
            w = 3.0 * rng.normal(size=6)
            p = self.parts.project(w)
            assert self.parts.project(p) == pytest.approx(p, abs=1e-14)
            assert p[0] == w[0] and p[1] >= 0.0 and -1.0 <= p[2] <= 2.0 and np.hypot(p[3], p[4]) <= 0.5 * p[5] + 1e-14
            others = [self.parts.project(3.0 * rng.normal(size=6)) for _ in range(200)]
            assert min(np.linalg.norm(w - o) for o in others) >= np.linalg.norm(w - p)

    def test_cones_project_as_the_cone_says(self):
        """Row by row as `FrictionCone.project`."""
        rng = np.random.default_rng(6)
        W, mu = rng.normal(size=(50, 3)), rng.uniform(0.1, 2.0, 50)
        expected = np.array([rbd.problem.FrictionCone(m).project(w) for w, m in zip(W, mu, strict=True)])
        assert project_cones(W, mu) == pytest.approx(expected, abs=1e-14)

    def test_the_gap_is_how_far_a_part_is_from_where_it_may_be(self):
        """A line's motion, a half-line's sinking; an interval's is no matter; a cone's distance to its dual, closed form."""
        y = np.array([-0.3, -0.2, 7.0, 3.0, 4.0, 1.0])
        gap = self.parts.gap(y)
        assert gap[:3] == pytest.approx([0.3, 0.2, 0.0]) and gap[3:5].tolist() == [0.0, 0.0]
        # |y_t| = 5, dual |y_t| <= y_n / .5, so the distance is (mu |y_t| - y_n) / sqrt(1 + mu^2)
        assert gap[5] == pytest.approx((0.5 * 5.0 - 1.0) / np.sqrt(1.25))
        assert not self.parts.gap(np.array([0.0, 0.5, -7.0, 3.0, 4.0, 2.5])).any()

    def test_the_slack_is_weight_times_acceleration(self):
        """Of intervals from the bound that the motion asks for; of cones the inner product."""
        w, y = np.array([5.0, 2.0, 1.5, 0.1, -0.2, 1.0]), np.array([0.0, 3.0, -2.0, 1.0, 1.0, 0.4])
        slack = self.parts.slack(w, y)
        assert slack == pytest.approx([0.0, 6.0, (2.0 - 1.5) * 2.0, 0.0, 0.0, abs(0.1 - 0.2 + 0.4)])
        assert self.parts.slack(w, np.array([0, 0, 2.0, 0, 0, 0]))[2] == pytest.approx((1.5 - -1.0) * 2.0)

    def test_de_saxces_term_makes_slipping_complementary(self):
        """The force (-mu, 0, 1) against a slip of 2 along x: with mu |y_t| on the normal their product is zero, else not."""
        w, c = np.array([-0.5, 0.0, 1.0]), np.array([2.0, 0.0, 0.0])
        T = ForceSet.of([rows_with(rbd.problem.FrictionCone(0.5))])
        assert T.accelerations(c, coulomb=True) == pytest.approx([2.0, 0.0, 1.0])
        assert T.slack(w, T.accelerations(c, coulomb=True))[2] == pytest.approx(0.0, abs=1e-15)
        assert T.slack(w, T.accelerations(c, coulomb=False))[2] == pytest.approx(1.0) and c.tolist() == [2.0, 0.0, 0.0]

    def test_fixed_weights_answer_to_nothing(self):
        """What opens, and dry friction that rubs: no gap and no slack, whatever the acceleration."""
        T = ForceSet.of(
            [
                rows_with(rbd.problem.FrictionCone(0.5), [0, 0, 1.0]),
                rows_with(rbd.problem.Bounds([-3.0], [5.0]), [1.0], "joint"),
            ]
        )
        for y in (np.array([-4.0, 2.0]), np.array([4.0, -2.0])):
            assert not T.gap(y).any() and not T.slack(T.project(np.array([9.0, 9.0])), y).any()
        assert T.project(np.array([9.0, 9.0])).tolist() == [0.0, -3.0]

    def test_point_forces_add_up_to_the_row_forces(self):
        """Of a sole whose edge rests while the rest opens, and of one that slides: the corner map of them is G w."""
        rng, cone = np.random.default_rng(9), square()
        for velocity in ([0.0] * 6, [0.3, 0, 0, 0, 0, 1.0], [0, 0, 0.1, 0, 0.5, 0]):
            T = ForceSet.of([rows_with(rbd.problem.Free(2), name="held"), rows_with(cone, velocity, "sole")])
            w = T.project(rng.uniform(0.5, 2.0, T.size))
            forces = (T.point_map(1) @ w).reshape(-1, 3)
            assert (
                T.point_map(0) is None
                and forces.shape == (4, 3)
                and cone.corner_map @ forces.ravel() == pytest.approx((T.G @ w)[2:])
            )

    @pytest.mark.parametrize("velocity", [[0.0] * 6, [0.3, 0.1, 0, 0, 0, 1.0]])
    def test_weights_are_found_from_forces(self, velocity):
        """Any weights in the sets that make the force, of corners at rest and of sliding ones."""
        rng = np.random.default_rng(12)
        T = ForceSet.of([rows_with(square(), velocity)])
        f = T.G @ T.project(rng.uniform(0.5, 2.0, T.size) * 10.0)
        w = T.weights_of(f)
        assert T.G @ w == pytest.approx(f, abs=1e-6) and T.project(w) == pytest.approx(w, abs=1e-12)

    def test_weights_with_equal_bounds_are_left_where_they_are(self):
        """Two columns of which one is fixed at 3: the other makes up the rest, within its own bounds."""

        def weights(lower, upper, force):
            """Of boxes that push on one row together."""
            T = replace(ForceSet.of([rows_with(rbd.problem.Bounds(lower, upper))]), G=np.ones((1, len(lower))))
            return T.weights_of(np.array([force]))

        assert weights([3.0, 0.0], [3.0, 1.5], 5.0) == pytest.approx([3.0, 1.5]) and weights([1.0], [1.0], 1.0) == [1.0]


class TestPyramids:
    """Pyramids in place of circular cones: a linear map of the circular form, in rest and in motion."""

    def test_rays_stand_for_cones_and_all_else_stays(self):
        """A line, a cone of four facets and a half-line: one, four and one columns; pushes are rays, facets are remembered."""
        T = ForceSet.of(
            [rows_with(rbd.problem.Product([rbd.problem.Free(1), rbd.problem.FrictionCone(0.5), rbd.problem.NonNegative(1)]))]
        )
        R = T.pyramids
        assert R.G == pytest.approx(T.G @ block_diagonal([np.eye(1), pyramid(0.5, 4), np.eye(1)])) and R.H is R.G
        assert R.lower.tolist() == [-np.inf, 0.0, 0.0, 0.0, 0.0, 0.0] and np.isposinf(R.upper).all() and not len(R.mu)
        assert [e.size for e in R.elements] == [1, 4, 1] and [e.facets for e in R.elements] == [0, 4, 0]
        assert R.push[1:5].T == pytest.approx(pyramid(0.5, 4)) and R.facets == T.facets == (4,) and R.slices == (slice(0, 6),)
        assert R.normals == pytest.approx(T.normals) == np.delete(np.eye(5), [1, 2], axis=1) and R.pyramids is R

    def test_inscribed_pyramids_are_inside(self):
        """Radius mu in place of mu / cos(pi / n)."""
        inside, around = (
            ForceSet.of([rows_with(rbd.problem.FrictionCone(0.5, 6))]).with_pyramids(inscribed=x) for x in (True, False)
        )
        assert np.hypot(*inside.G[:2]) == pytest.approx(np.full(6, 0.5))
        assert np.hypot(*around.G[:2]) == pytest.approx(np.full(6, 0.5 / np.cos(np.pi / 6)))

    def test_what_velocities_decide_stays_decided(self):
        """A point that leaves, one that slides, one at rest: a weight of zero, a coupled column, and four rays."""
        cone = rbd.problem.FrictionCone(0.5)
        rows = [rows_with(cone, u, name) for name, u in (("off", [0, 0, 1.0]), ("slides", [1.0, 0, 0]), ("rests", None))]
        T = ForceSet.of(rows)
        R = T.pyramids
        assert T.slices == (slice(0, 1), slice(1, 2), slice(2, 5)) and R.slices == (slice(0, 1), slice(1, 2), slice(2, 6))
        assert R.upper[0] == 0.0 and R.G[3:6, 1] == pytest.approx([-0.5, 0, 1]) and R.H[3:6, 1] == pytest.approx([0, 0, 1])
        assert R.openings == T.openings and [s.column for s in R.sliding] == [1] and R.slipping == T.slipping == (1,)

    def test_rays_feel_the_corners_of_a_turning_patch(self):
        """A sole that tips about its edge: along the rays of the edge's corners, their centripetal accelerations too."""
        w, edge, c = np.array([0.0, 0.5, 0.0]), np.array([0.2, 0.0, 0.0]), np.arange(6.0)
        T = ForceSet.of([rows_with(square(), [*-np.cross(w, edge), *w])])
        R, axes = T.pyramids, T.accelerations(c)
        stands = [(e, r) for e, r in zip(T.elements, R.elements, strict=True) if e.is_cone]
        assert len(stands) == 2 and R.slipping == T.slipping == (0,)
        for e, r in stands:
            assert T.offset[e.columns] == pytest.approx([-0.05, 0, 0])  # -w^2 x
            assert R.accelerations(c)[r.columns] == pytest.approx(axes[e.columns] @ pyramid(0.5, 4))
