"""GaussProblem: Gauss's problem in arrays, without a robot."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.errors import DuplicateName, SingularInertia
from rbd.problem.rows import Rows


@pytest.fixture
def problem(rng) -> rbd.GaussProblem:
    """Five coordinates, a held pair, a stop and a rubbing point."""
    A = rng.normal(size=(5, 5))
    rows = [
        Rows("bar", rng.normal(size=(2, 5)), rng.normal(size=2), rbd.problem.Free(2), feedback=rng.normal(size=2)),
        Rows("idle", np.zeros((0, 5)), np.zeros(0), rbd.problem.NonNegative(0)),
        Rows("stop", rng.normal(size=(1, 5)), rng.normal(size=1), rbd.problem.NonNegative(1)),
        Rows("toe", rng.normal(size=(3, 5)), rng.normal(size=3), rbd.problem.FrictionCone(0.5)),
    ]
    return rbd.GaussProblem(A @ A.T + np.eye(5), rng.normal(size=5), rows)


def test_terms_are_stacked_in_the_order_of_the_rows(problem):
    """J, bias and offset = bias + feedback; slices find each constraint again."""
    P = problem
    assert P.nv == 5 and P.m == 6
    assert [(n, s.start, s.stop) for n, s in P.slices.items()] == [("bar", 0, 2), ("idle", 2, 2), ("stop", 2, 3), ("toe", 3, 6)]
    for rows in P.rows:
        part = P.slices[rows.name]
        assert np.array_equal(P.J[part], rows.J) and np.array_equal(P.bias[part], rows.bias)
        assert np.array_equal(P.offset[part], rows.bias + rows.feedback)


def test_free_acceleration_delassus_and_whitening_are_their_formulas(problem):
    """M a_free = rhs; delassus = J M^-1 J^T = W^T W; rows accelerate freely at J a_free + offset."""
    P = problem
    inverse = np.linalg.inv(P.M)
    assert np.allclose(P.M @ P.a_free, P.rhs, rtol=1e-12, atol=1e-12)
    assert np.allclose(P.delassus, P.J @ inverse @ P.J.T, rtol=1e-11, atol=1e-12)
    assert np.allclose(P.whitened.T @ P.whitened, P.delassus, rtol=1e-11, atol=1e-12)
    assert np.allclose(P.free_row_acceleration, P.J @ P.a_free + P.offset, rtol=1e-12, atol=1e-12)
    assert np.allclose(P.M @ P.solve_M(np.arange(5.0)), np.arange(5.0), rtol=1e-12, atol=1e-12)


def test_the_rays_of_all_rows_stand_side_by_side(problem):
    """Block-diagonal, in the order of the rows; slices find each constraint's again."""
    P = problem
    assert P.force_set.pyramids.G.shape == (6, 2 + 0 + 1 + 4) and P.force_set.facets == (4,)
    assert not P.bilateral and P.cone.dim == 6
    for rows, part in zip(P.rows, P.force_set.pyramids.slices, strict=True):
        block = P.force_set.pyramids.G[:, part].copy()
        block[P.slices[rows.name]] = 0.0
        assert not block.any()
    assert [(s.start, s.stop) for s in P.force_set.pyramids.slices] == [(0, 2), (2, 2), (2, 3), (3, 7)]


def test_a_problem_without_constraints_is_free_motion():
    """No rows: a = a_free, and every stack is empty but has its shape."""
    P = rbd.GaussProblem(2.0 * np.eye(3), np.array([2.0, 4.0, 6.0]))
    assert P.a_free == pytest.approx([1.0, 2.0, 3.0], rel=1e-14)
    assert P.J.shape == (0, 3) and P.offset.shape == (0,) and P.bilateral
    assert P.force_set.pyramids.G.shape == (0, 0) and P.delassus.shape == (0, 0)
    for solver in (rbd.ProxQP(), rbd.KKT()):
        solution = solver.solve(P)
        assert solution.status == "solved" and np.array_equal(solution.a, P.a_free)


def test_a_problem_whose_constraints_are_all_idle_is_free_motion():
    """Inactive constraints give zero rows, never none."""
    idle = Rows("idle", np.zeros((0, 2)), np.zeros(0), rbd.problem.NonNegative(0))
    for solver in (rbd.ProxQP(), rbd.KKT()):
        solution = solver.solve(rbd.GaussProblem(np.eye(2), np.ones(2), [idle]))
        assert solution.status == "solved" and solution.a.tolist() == [1.0, 1.0]
        assert solution.forces["idle"].shape == (0,)


def _toe(**changed) -> Rows:
    return Rows(**({"name": "toe", "J": np.ones((1, 2)), "bias": np.zeros(1), "cone": rbd.problem.Free(1)} | changed))


@pytest.mark.parametrize(
    ("error", "what", "arguments"),
    [
        (rbd.InputError, "square", {"M": np.ones((2, 3))}),
        (rbd.InputError, "square", {"M": np.ones(2)}),
        (rbd.InputError, "rhs", {"rhs": np.zeros(3)}),
        (rbd.InputError, "M is not finite", {"M": np.array([[1.0, np.nan], [np.nan, 1.0]])}),
        (rbd.InputError, "rhs is not finite", {"rhs": np.array([np.inf, 0.0])}),
        (rbd.InputError, "not symmetric", {"M": np.array([[1.0, 0.1], [0.0, 1.0]])}),
        (rbd.InputError, "'toe'.*columns", {"rows": [_toe(J=np.ones((1, 3)))]}),
        (rbd.InputError, "not finite", {"rows": [_toe(J=np.array([[np.nan, 0.0]]))]}),
        (rbd.InputError, "not finite", {"rows": [_toe(bias=np.array([np.inf]))]}),
        (rbd.InputError, "not finite", {"rows": [_toe(feedback=np.array([np.nan]))]}),
        (DuplicateName, "'toe'", {"rows": [_toe(), _toe()]}),
    ],
)
def test_bad_arrays_are_refused_before_any_solver_sees_them(error, what, arguments):
    """ProxSuite runs on NaN and calls it solved, so nothing that is not finite gets there."""
    with pytest.raises(error, match=what):
        rbd.GaussProblem(**({"M": np.eye(2), "rhs": np.zeros(2), "rows": [_toe()]} | arguments))


def test_an_inertia_that_is_not_positive_definite_is_named():
    """A singular M has no free acceleration."""
    with pytest.raises(SingularInertia, match="positive definite"):
        _ = rbd.GaussProblem(np.diag([1.0, 0.0]), np.zeros(2)).a_free
    with pytest.raises(SingularInertia, match="positive definite"):
        rbd.KKT().solve(rbd.GaussProblem(np.diag([1.0, -1.0]), np.zeros(2), [_toe()]))


@pytest.mark.parametrize("unit", [1e-15, 1e-6, 1.0, 1e6, 1e12])
def test_inertia_is_judged_by_its_own_size(unit):
    """Grams or tonnes: what is regular, singular or unsymmetric in kilograms is so in any unit of mass."""
    regular = np.array([[2.0, 1.0], [1.0, 2.0]])
    a = rbd.GaussProblem(unit * regular, unit * np.array([3.0, 3.0])).a_free
    assert a == pytest.approx([1.0, 1.0], rel=1e-14)
    barely = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-14]])  # positive definite by rounding alone
    with pytest.raises(SingularInertia, match="coordinate 1"):
        rbd.GaussProblem(unit * barely, np.zeros(2))
    rbd.GaussProblem(unit * (regular + [[0.0, 1e-10], [0.0, 0.0]]), np.zeros(2))  # rounding
    with pytest.raises(rbd.InputError, match="not symmetric"):
        rbd.GaussProblem(unit * (regular + [[0.0, 1e-7], [0.0, 0.0]]), np.zeros(2))


def test_a_light_body_beside_a_heavy_one_is_regular():
    """Each pivot is compared with its own coordinate's inertia: 1e-6 kg beside 1e9 kg is no rounding."""
    P = rbd.GaussProblem(np.diag([1e9, 1e-6]), np.array([2e9, 3e-6]))
    assert P.a_free == pytest.approx([2.0, 3.0], rel=1e-14)


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
def test_a_singular_inertia_is_an_error_in_every_solver(solver):
    """Never an answer."""
    for rows in ([], [_toe()]):
        with pytest.raises(SingularInertia):
            solver.solve(rbd.GaussProblem(np.zeros((2, 2)), np.ones(2), rows))


class TestWhatAVelocityDecides:
    """Force sets of rows that move: equal bounds where there is no choice left."""

    def test_a_moving_interval_stands_against_its_motion(self):
        """Each component by itself, and an infinite bound is none to stand at; below 1e-6 nothing is decided."""
        box = rbd.problem.Bounds([-1.0, -2.0, -3.0, -np.inf], [1.0, 2.0, 3.0, 4.0])
        rows = Rows("rub", np.eye(4), np.zeros(4), box, velocity=np.array([0.1, -0.1, 0.9e-6, 0.1]))
        R = rbd.GaussProblem(np.eye(4), np.zeros(4), [rows]).force_set.pyramids
        assert R.lower.tolist() == [-1.0, 2.0, -3.0, -np.inf] and R.upper.tolist() == [-1.0, 2.0, 3.0, 4.0]

    def test_what_opens_carries_nothing(self):
        """A cone that leaves is a weight of zero, none of one that rests; lines stay lines."""
        cone = rbd.problem.Product([rbd.problem.FrictionCone(0.5), rbd.problem.Free(1), rbd.problem.NonNegative(2)])
        rows = Rows("all", np.eye(6), np.zeros(6), cone, velocity=np.array([0.1, 0.0, 0.2, 5.0, 0.3, 0.0]))
        P = rbd.GaussProblem(np.eye(6), np.zeros(6), [rows])
        assert P.force_set.pyramids.upper.tolist() == [0.0] + [np.inf, 0.0, np.inf]
        assert P.force_set.pyramids.lower.tolist() == [0.0] + [-np.inf, 0.0, 0.0] and P.force_set.slipping == ()

    def test_rows_at_rest_share_their_rays(self, problem):
        """Nothing is copied on the usual path."""
        again = rbd.GaussProblem(problem.M, problem.rhs, problem.rows)
        assert problem.openings == problem.force_set.slipping == () and again.force_set.pyramids is problem.force_set.pyramids

    def test_what_slides_or_tips_is_slipping(self):
        """A point that slides under friction, and a patch whose corners have centripetal accelerations; nothing smooth."""
        patch = rbd.problem.WrenchCone([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]], 0.5)

        def slipping(cone, velocity):
            rows = Rows("row", np.eye(cone.dim), np.zeros(cone.dim), cone, velocity=np.array(velocity, float))
            found = rbd.GaussProblem(np.eye(cone.dim), np.zeros(cone.dim), [rows]).force_set.slipping
            return [[rows][i].name for i in found]

        assert slipping(rbd.problem.FrictionCone(0.5), [0.1, 0.0, 0.0]) == ["row"]
        assert slipping(patch, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) == ["row"]
        assert slipping(patch, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) == []
        assert slipping(rbd.problem.FrictionCone(0.0), [0.1, 0.0, 0.0]) == [] == slipping(rbd.problem.Free(2), [1.0, 1.0])


def test_rows_are_judged_one_by_one_when_all_together_are_too_large_to_be_squared():
    """Two of 1.1e154, whose squares add up beyond the largest number: each is taken alone, and so are both."""
    rows = [rbd.Rows(name, np.array([[1.1e154]]), np.zeros(1), rbd.problem.Free(1)) for name in "ab"]
    problem = rbd.GaussProblem(np.eye(1), np.ones(1), rows)
    assert problem.m == 2 and np.isinf(np.vdot(problem.J, problem.J))
    with pytest.raises(rbd.InputError, match="J of rows 'b'"):
        rbd.GaussProblem(
            np.eye(1), np.ones(1), [rows[0], rbd.Rows("b", np.array([[np.inf]]), np.zeros(1), rbd.problem.Free(1))]
        )
