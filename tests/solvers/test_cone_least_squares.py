"""Many least-squares problems over friction cones, against nonnegative least squares on facets and against optimality."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from rbd.arrays import Array, cross_matrix
from rbd.problem.cones import project_cones
from rbd.solvers.cone_least_squares import Stage, _Rows, nearest_in_cones, staged_fits

FACETS = 64


def two_soles(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """(A, d) of a body over two soles, each of them there with a chance of 0.7, and wrenches near its weight."""
    points = np.array([[x + 0.035, y, -0.7] for s in (-0.1, 0.1) for x in (-0.085, 0.085) for y in (s - 0.03, s + 0.03)])
    A = np.zeros((n, 6, 8, 3))
    on = rng.random((n, 2)) < 0.7
    for j, p in enumerate(points):
        A[:, :3, j] = np.eye(3)
        A[:, 3:, j] = cross_matrix(p) / 0.3
        A[~on[:, j // 4], :, j] = 0.0
    spread = np.array([0.1, 0.1, 0.2, 0.05, 0.05, 0.02])
    return A, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) + rng.normal(size=(n, 6)) * spread


@pytest.mark.parametrize("mu", [0.0, 0.1, 0.7])
def test_the_nearest_lies_between_inscribed_and_circumscribed_pyramids(mu, rng):
    """Facets inside the cone leave more, facets around it less; with 64 they are close."""
    A, d = two_soles(rng, 60)
    found = nearest_in_cones(A, d, mu)
    left = np.linalg.norm(found.left, axis=1)
    assert (np.hypot(found.w[..., 0], found.w[..., 1]) <= mu * found.w[..., 2] + 1e-12).all()
    angles = 2.0 * np.pi * np.arange(FACETS) / FACETS
    for radius, sign in ((mu, 1.0), (mu / np.cos(np.pi / FACETS), -1.0)):
        rays = np.array([radius * np.cos(angles), radius * np.sin(angles), np.ones(FACETS)])
        for i in range(len(d)):
            other = nnls(np.concatenate([A[i, :, j] @ rays for j in range(8)], axis=1), d[i], maxiter=5000)[1]
            assert sign * (other - left[i]) >= -1e-9
            assert abs(other - left[i]) < 2e-3


def test_what_forces_make_leaves_nothing(rng):
    """A wrench of forces inside the cones is met to rounding."""
    A, _ = two_soles(rng, 200)
    w = project_cones(rng.normal(size=(200, 8, 3)) + [0.0, 0.0, 1.0], 0.7)
    d = np.einsum("nmkc,nkc->nm", A, w)
    assert np.abs(nearest_in_cones(A, d, 0.7).left).max() < 1e-11


def test_the_residual_is_polar_to_the_cone(rng):
    """Optimality: no force in a cone has a part along what is left, and the forces found none across."""
    A, d = two_soles(rng, 100)
    found = nearest_in_cones(A, d, 0.3)
    pull = np.einsum("nmkc,nm->nkc", A, found.left)
    assert (0.3 * np.hypot(pull[..., 0], pull[..., 1]) + pull[..., 2]).max() < 1e-9
    assert np.abs((pull * found.w).sum(axis=(1, 2))).max() < 1e-9


def test_one_step_solves_problems_whose_forces_are_inside_the_cones(rng):
    """There the least squares are plain ones, and Newton's method starts inside; of no problems there are no answers."""
    A, _ = two_soles(rng, 50)
    A = A[A.any(axis=(1, 3)).all(axis=1)]  # on both soles
    d, n = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) + 0.01 * rng.normal(size=(len(A), 6)), len(A)
    flat, rows = A.reshape(n, 6, 24), [Stage(1.0, np.ones(6), np.zeros(6))]
    back = flat.transpose(0, 2, 1)
    w = np.linalg.solve(back @ flat + np.eye(24), back @ d[..., None]).reshape(n, 8, 3)  # normal equations
    assert (np.hypot(w[..., 0], w[..., 1]) < 0.7 * w[..., 2]).all()
    found = staged_fits(A, d, 0.7, rows)
    assert found.w == pytest.approx(w, abs=1e-13)
    assert n > 10 and found.steps.tolist() == [1] * n
    assert staged_fits(A[:0], d[:0], 0.7, rows).left.shape == (0, 6)


def test_costs_of_rows_and_their_conjugates_are_duals(rng):
    """The largest r u - phi(u) over u is phi*(r), taken at phi*'(r), which the second derivative follows; phi by its words."""
    weight, steep = np.array([2.0, 0.5, 3.0]), np.array([0.0, 7.0, 0.2])
    rows, u = _Rows(weight, steep), np.linspace(-15.0, 15.0, 60001)[:, None]
    cost = 0.5 * weight * u**2 + 0.5 * steep * np.maximum(np.abs(u) - 1.0, 0.0) ** 2
    for r in 3.0 * rng.normal(size=(10, 3)):
        gain = r * u - cost
        assert rows.value(r[None]) == pytest.approx([gain.max(axis=0).sum()], abs=5e-7)  # of the grid
        found, curve = rows.slope(r[None])
        assert found[0] == pytest.approx(u[gain.argmax(axis=0), 0], abs=1e-3)
        assert curve[0] == pytest.approx((rows.slope(r[None] + 1e-7)[0] - found)[0] / 1e-7, rel=1e-6)


def test_limited_rows_stay_within_their_limits_where_they_can(rng):
    """A row with a limit of one is met by other forces with the same sum."""
    A = np.zeros((1, 3, 2, 3))
    A[0, 0, :, 2] = 1.0  # the sum of two normal forces is 2
    A[0, 1, 0, 2] = A[0, 2, 1, 2] = 1.0
    d = np.array([[2.0, 0.4, 2.5]])  # rows 0.4 - w1 and 2.5 - w2: the least squares are w1 = -0.05, w2 = 2.05, cut at w1 = 0
    weight = np.array([1e8, 1.0, 1.0])
    free = staged_fits(A, d, 0.5, [Stage(1e2, np.ones(3), np.zeros(3)), Stage(1e8, weight, np.zeros(3))])
    assert np.allclose(free.w[0, :, 2], [0.0, 2.0], atol=1e-6)
    d = np.array([[2.0, 2.4, 0.0]])  # w1 = 2, w2 = 0 leaves 0.4 and 0; a limit of one on -w2 does not bind
    tight = np.array([[2.0, 3.4, 0.2]])  # rows 3.4 - w1 and 0.2 - w2: at most w1 = 2 leaves 1.4: 0.4 beyond the limit
    steep = np.array([0.0, 1e4, 1e4])
    stages = [
        Stage(1e2, np.ones(3), np.zeros(3)),
        Stage(1e4, np.array([1e4, 1.0, 1.0]), 0.01 * steep),
        Stage(1e8, weight, steep),
    ]
    assert np.allclose(staged_fits(A, d, 0.5, stages).w[0, :, 2], [2.0, 0.0], atol=1e-4)
    assert np.allclose(staged_fits(A, tight, 0.5, stages).left[0, 1], 1.4, atol=1e-3)
