"""Newton's method on sparse problems, beside the dense one: bounds, cones in the plane and in space, many contacts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import block_diag, csr_array

import rbd
from rbd.audits.bench import spheres_in_a_box
from rbd.problem.force_set import ForceSet
from rbd.solvers.newton import scaled
from rbd.solvers.sparse_newton import FOUND, SparseProblem, solve_sparse


def drawn(seed: int, points: int, singles: int) -> tuple[np.ndarray, np.ndarray, ForceSet]:
    """D, y_free and the sets of a few half-lines, intervals and cones on a body of 12 freedoms."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(singles + 3 * points, 12))
    cones = [rbd.problem.NonNegative(1), rbd.problem.Bounds([-1.0], [1.0])][:singles] + [rbd.problem.FrictionCone(0.6)] * points
    ends = np.cumsum([cone.dim for cone in cones])[:-1]
    rows = [
        rbd.Rows(f"{i}", part, bias=np.zeros(len(part)), cone=cone)
        for i, (part, cone) in enumerate(zip(np.split(J, ends), cones, strict=True))
    ]
    return J @ J.T, rng.normal(size=len(J)), ForceSet.of(rows)


class TestOneProblem:
    """Against the law, recomputed, and closed forms."""

    @pytest.mark.parametrize("seed", range(4))
    def test_weights_obey_the_law_with_bounds_and_cones(self, seed):
        """It is w = P(w - y), and the weights are in their sets: both recomputed from the problem as it was given."""
        D, y, T = drawn(seed, 4, 2)
        S = scaled(D, y, T)
        w, merit, _ = solve_sparse(SparseProblem.of_scaled(S))
        assert merit <= FOUND
        f = S.weights(w)
        np.testing.assert_allclose(T.project(f), f, atol=1e-12)
        c = D @ f + y
        assert (c[0] > -1e-11) and abs(c[0] * f[0]) < 1e-11
        assert abs(c[1]) < 1e-11 or abs(f[1] + np.sign(c[1])) < 1e-11
        at = np.arange(2, 14).reshape(4, 3)
        slip = np.linalg.norm(c[at[:, :2]], axis=1)
        np.testing.assert_allclose((c[at[:, :2]] * f[at[:, :2]]).sum(axis=1), -0.6 * f[at[:, 2]] * slip, atol=1e-11)
        assert (c[at[:, 2]] > -1e-11).all() and np.abs(c[at[:, 2]] * f[at[:, 2]]).max() < 1e-11

    def test_the_scaled_problem_is_that_of_the_dense_solver(self):
        """The same numbers, whether scaled here or there."""
        D, y, T = drawn(0, 3, 2)
        S = scaled(D, y, T)
        mine = SparseProblem.of(csr_array(D), y, np.full((3, 2), 0.6), T.lower[:2], T.upper[:2])
        np.testing.assert_allclose(mine.D.toarray(), S.D, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(mine.unit, S.unit, rtol=1e-14)
        np.testing.assert_allclose(mine.q, S.q, rtol=1e-14)

    def test_sweeps_alone_solve_contacts_that_do_not_touch_each_other(self):
        """One sweep is exact where every contact is alone: each is solved by itself."""
        rng = np.random.default_rng(1)
        blocks = [part @ part.T + np.eye(3) for part in rng.normal(size=(20, 3, 3))]
        S = SparseProblem.of(csr_array(block_diag(blocks)), rng.normal(size=60), np.full((20, 2), 0.5))
        assert S.merit(S.sweeps(np.zeros(60), 1)) < 1e-14

    def test_without_contacts_that_push_nothing_is_computed(self):
        """Zero is the answer of contacts that open."""
        S = SparseProblem.of(csr_array(np.eye(3)), np.array([0.0, 0.0, 1.0]), np.full((1, 2), 0.5))
        w, merit, steps = solve_sparse(S)
        assert not w.any() and merit == 0.0 and steps == 0


class TestManyContacts:
    """By the solvers that users call."""

    def test_a_problem_of_many_bodies_takes_the_sparse_way(self):
        """From 100 contacts on the method's name says it; with fewer the dense way gives the same motion: all at rest."""
        problem = spheres_in_a_box(4, 3)
        found = rbd.solve_problem(problem.gauss)
        assert len(problem.mu) >= 100 and found.method == "cones: sparse Newton"
        assert found.residuals.within(1e-10) and np.abs(found.a).max() < 1e-12
        few = rbd.solve_problem(spheres_in_a_box(3, 2).gauss)
        assert few.method != "cones: sparse Newton" and np.abs(few.a).max() < 1e-12
