"""A convex quadratic over bounds and circular cones: closed forms, conditions of the least, gaps, sets without an inside."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.problem.cones import project_cones
from rbd.problem.conic import ConeSet, Separable, interior, least, least_squares
from rbd.problem.programs import Work

MU = 0.6
CONE = ConeSet(np.zeros((0, 3)), np.zeros(0), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
CAPPED = ConeSet(np.array([[0.0, 0.0, -1.0]]), np.array([-1.0]), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
INSIDE = np.array([0.0, 0.0, 0.5])


# By the dual: weighted squares over equations, bounds and cones


def cones(k: int, mu: float | np.ndarray, R: np.ndarray, b: np.ndarray, target: np.ndarray) -> Separable:
    """1/2 |y - target|^2 over R y = b in k cones."""
    free = np.full(3 * k, np.inf)
    return Separable(np.ones(3 * k), -target, R, b, -free, free, np.arange(3 * k).reshape(k, 3), np.broadcast_to(mu, k))


def test_without_equations_it_is_the_projection(rng):
    """Inside, on the edge, at the apex."""
    p = rng.normal(size=(200, 3))
    y, _ = least_squares(cones(200, 0.6, np.zeros((0, 600)), np.zeros(0), p.ravel()))
    assert np.array_equal(y.reshape(-1, 3), project_cones(p, np.full(200, 0.6)))


@pytest.mark.parametrize("k", [1, 4, 100])
def test_the_conditions_of_the_least_hold(k, rng):
    """R y = b to rounding; y is the projection of target + R^T lam, which proves it the least."""
    for _ in range(20):
        mu, r = 10.0 ** rng.uniform(-2, 1, k), min(6, 3 * k - 1)
        R, inside = rng.normal(size=(r, 3 * k)), rng.normal(size=(k, 3))
        inside[:, 2] = 1.5 * np.hypot(inside[:, 0], inside[:, 1]) / mu + 0.1
        P = cones(k, mu, R, R @ inside.ravel(), rng.normal(size=3 * k))
        y, lam = least_squares(P)
        assert np.abs(R @ y - P.b).max() <= 1e-12 * np.abs(R).max() * np.abs(y).sum()
        assert y.reshape(-1, 3) == pytest.approx(project_cones((lam @ R - P.c).reshape(-1, 3), mu), abs=1e-12)


def test_weights_and_bounds():
    """Least y1^2 + 4 y2^2 with y1 + y2 = 5: (4, 1); with y1 <= 3: (3, 2)."""
    R, b, free = np.ones((1, 2)), np.array([5.0]), np.full(2, np.inf)
    none = np.zeros((0, 3), int)
    P = Separable(np.array([2.0, 8.0]), np.zeros(2), R, b, -free, free, none, np.zeros(0))
    assert least_squares(P)[0] == pytest.approx([4.0, 1.0])
    bounded = Separable(P.d, P.c, R, b, -free, np.array([3.0, np.inf]), none, np.zeros(0))
    assert least_squares(bounded)[0] == pytest.approx([3.0, 2.0])


def test_a_set_without_an_inside_has_no_multipliers():
    """Two normals that add up to zero, between tangents that rub: only the apex is left, and no finite multiplier holds it."""
    R = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]])
    target = np.array([1.0, 0.0, 1.0, -1.0, 2.0, 1.0])
    found = least_squares(cones(2, 0.6, R, np.zeros(1), target))
    assert found is None or np.abs(found[0]).max() < 1e-9


def test_an_empty_set_and_no_work_have_no_answer():
    """A normal force of -1 is in no cone."""
    R = np.array([[0.0, 0.0, 1.0]])
    assert least_squares(cones(1, 0.6, R, np.array([-1.0]), np.zeros(3))) is None
    good = cones(1, 0.6, R, np.array([1.0]), np.zeros(3))
    assert least_squares(good)[0] == pytest.approx([0.0, 0.0, 1.0])
    assert least_squares(good, work=Work(0.0)) is None


def test_equations_beyond_newtons_method_have_no_answer():
    """0 y = 1, whose derivative is zero; and a row of 1e80, whose products would leave double precision."""
    free = np.full(2, np.inf)
    for R, b in ((np.zeros((1, 2)), 1.0), (np.array([[1e80, 0.0]]), 1e80)):
        P = Separable(np.ones(2), np.zeros(2), R, np.array([b]), -free, free, np.zeros((0, 3), int), np.zeros(0))
        assert least_squares(P) is None


# By a barrier, from inside


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-10])
def test_a_linear_function_ends_on_the_rim_within_the_gap(gap, rng):
    """Over |t| <= mu n, n <= 1 the largest d . (t, n) is max(0, mu |d_t| + d_n); it is never passed."""
    for _ in range(20):
        d = rng.normal(size=3)
        z = least(np.zeros((3, 3)), -d, CAPPED, INSIDE, gap)
        best = max(0.0, MU * np.hypot(d[0], d[1]) + d[2])
        assert CAPPED.margin(z) > 0.0 and best - gap <= d @ z < best


def test_the_nearest_point_of_a_cone(rng):
    """Least |z - p|^2: the projection, in closed form; inside, on the edge, at the apex."""
    found = set()
    for _ in range(60):
        p = rng.normal(size=3)
        z = least(np.eye(3), -p, CONE, INSIDE, 1e-13)
        exact = project_cones(p[None], np.array([MU]))[0]
        assert 0.5 * (z @ z - exact @ exact) - p @ (z - exact) <= 1e-13 + 1e-15  # what the gap promises
        assert z == pytest.approx(exact, abs=1e-6)
        found.add("apex" if not exact.any() else "inside" if exact is p or np.array_equal(exact, p) else "edge")
    assert found == {"apex", "inside", "edge"}


def test_a_point_inside_is_found_from_the_boundary():
    """From the apex, which is in the set but not inside; a cone pressed flat has no inside."""
    centre = interior(CAPPED, np.zeros(3), 0.01)
    assert centre is not None and CAPPED.margin(centre) > 0.005
    near = np.array([0.0, 0.0, 0.01])  # inside, and not by enough
    deeper = interior(CAPPED, near, 0.01)
    assert deeper is not None and 0.0 < CAPPED.margin(near) < 0.01 - 1e-3 < CAPPED.margin(deeper)
    assert interior(CAPPED, INSIDE, 0.01) is INSIDE
    flat = ConeSet(np.array([[0.0, 0.0, -1.0]]), np.zeros(1), CAPPED.C, CAPPED.at, CAPPED.mu)
    assert interior(flat, np.zeros(3), 0.01) is None
    assert flat.widened(1e-10).margin(np.zeros(3)) == pytest.approx(1e-10)


@pytest.mark.parametrize("gap", [1e-3, 1e-9])
def test_over_bounds_alone_the_least_is_the_clipped_point(gap):
    """Least |z - p|^2 / 2 over 0 <= z <= 1, no cones: p brought between the bounds, coordinate by coordinate."""
    p = np.array([-0.5, 0.3, 2.0])
    sides, bounds = np.vstack([np.eye(3), -np.eye(3)]), np.r_[np.zeros(3), -np.ones(3)]
    unit = ConeSet(sides, bounds, np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
    z = least(np.eye(3), -p, unit, np.full(3, 0.5), gap)
    exact = np.clip(p, 0.0, 1.0)
    assert unit.margin(z) > 0.0
    assert 0.5 * (z - p) @ (z - p) - 0.5 * (exact - p) @ (exact - p) <= gap


def test_a_gap_below_rounding_leaves_a_point_inside(rng):
    """Where steps no longer lessen the value in its digits the path ends: inside still, and as near as digits go."""
    for _ in range(5):
        d = rng.normal(size=3)
        z = least(np.zeros((3, 3)), -d, CAPPED, INSIDE, 1e-40)
        best = max(0.0, MU * np.hypot(d[0], d[1]) + d[2])
        assert CAPPED.margin(z) > 0.0 and best - 1e-9 <= d @ z <= best + 1e-15
