"""The barrier's path: closed forms over cones, its gap, and sets without an inside."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.analysis.barrier import ConeSet, interior, least
from rbd.problem.force_set import project_cones

MU = 0.6
CONE = ConeSet(np.zeros((0, 3)), np.zeros(0), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
CAPPED = ConeSet(np.array([[0.0, 0.0, -1.0]]), np.array([-1.0]), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
INSIDE = np.array([0.0, 0.0, 0.5])


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
