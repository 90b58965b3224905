"""A convex quadratic over bounds and circular cones: closed forms, conditions of the least, gaps, sets without an inside."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.answers.analysis.extent import cone_program, least, widened
from rbd.problem.cones import project_cones
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.programs import Work
from rbd.solvers.conic_newton import by_dual

MU = 0.6
CONE = cone_program(np.zeros((0, 3)), np.zeros(0), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
CAPPED = cone_program(np.array([[0.0, 0.0, -1.0]]), np.array([-1.0]), np.eye(3)[None], np.zeros((1, 3)), np.array([MU]))
INSIDE = np.array([0.0, 0.0, 0.5])


# By the dual: weighted squares over equations, bounds and cones


def cones(k: int, mu: float | np.ndarray, R: np.ndarray, b: np.ndarray, target: np.ndarray) -> Conic:
    """1/2 |y - target|^2 over R y = b in k cones."""
    y = Unknowns(3 * k, 1.0, -target, cones=np.arange(3 * k).reshape(k, 3), mu=np.broadcast_to(mu, k))
    return Conic.of({"y": y}, [({"y": R}, b)])


def test_without_equations_it_is_the_projection(rng):
    """Inside, on the edge, at the apex."""
    p = rng.normal(size=(200, 3))
    y, _ = by_dual(cones(200, 0.6, np.zeros((0, 600)), np.zeros(0), p.ravel()))
    assert np.array_equal(y.reshape(-1, 3), project_cones(p, np.full(200, 0.6)))


@pytest.mark.parametrize("k", [1, 4, 100])
def test_the_conditions_of_the_least_hold(k, rng):
    """R y = b to rounding; y is the projection of target + R^T lam, which proves it the least."""
    for _ in range(20):
        mu, r = 10.0 ** rng.uniform(-2, 1, k), min(6, 3 * k - 1)
        R, inside = rng.normal(size=(r, 3 * k)), rng.normal(size=(k, 3))
        inside[:, 2] = 1.5 * np.hypot(inside[:, 0], inside[:, 1]) / mu + 0.1
        P = cones(k, mu, R, R @ inside.ravel(), rng.normal(size=3 * k))
        y, lam = by_dual(P)
        assert np.abs(R @ y - P.b).max() <= 1e-12 * np.abs(R).max() * np.abs(y).sum()
        assert y.reshape(-1, 3) == pytest.approx(project_cones((lam @ R - P.g).reshape(-1, 3), mu), abs=1e-12)


def test_weights_and_bounds():
    """Least y1^2 + 4 y2^2 with y1 + y2 = 5: (4, 1); with y1 <= 3: (3, 2)."""
    for upper, least_y in ((np.inf, [4.0, 1.0]), (np.array([3.0, np.inf]), [3.0, 2.0])):
        program = Conic.of({"y": Unknowns(2, np.array([2.0, 8.0]), upper=upper)}, [({"y": np.ones((1, 2))}, np.array([5.0]))])
        assert by_dual(program)[0] == pytest.approx(least_y)


def test_a_set_without_an_inside_has_no_multipliers():
    """Two normals that add up to zero, between tangents that rub: only the apex is left, and no finite multiplier holds it."""
    R = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]])
    target = np.array([1.0, 0.0, 1.0, -1.0, 2.0, 1.0])
    found = by_dual(cones(2, 0.6, R, np.zeros(1), target))
    assert found is None or np.abs(found[0]).max() < 1e-9


def test_an_empty_set_and_no_work_have_no_answer():
    """A normal force of -1 is in no cone."""
    R = np.array([[0.0, 0.0, 1.0]])
    assert by_dual(cones(1, 0.6, R, np.array([-1.0]), np.zeros(3))) is None
    good = cones(1, 0.6, R, np.array([1.0]), np.zeros(3))
    assert by_dual(good)[0] == pytest.approx([0.0, 0.0, 1.0])
    assert by_dual(good, work=Work(0.0)) is None


def test_equations_beyond_newtons_method_have_no_answer():
    """0 y = 1, whose derivative is zero; and a row of 1e80, whose products would leave double precision."""
    for R, b in ((np.zeros((1, 2)), 1.0), (np.array([[1e80, 0.0]]), 1e80)):
        assert by_dual(Conic.of({"y": Unknowns(2, 1.0)}, [({"y": R}, np.array([b]))])) is None


# By Clarabel, with the excess judged by multipliers


def test_a_linear_function_ends_on_the_rim_within_the_gap(rng):
    """Over |t| <= mu n, n <= 1 the largest d . (t, n) is max(0, mu |d_t| + d_n)."""
    for _ in range(20):
        d = rng.normal(size=3)
        z = least(np.zeros((3, 3)), -d, CAPPED, Work(1e12))
        assert z is not None and MU * z[2] - np.hypot(z[0], z[1]) > -1e-9 and z[2] < 1.0 + 1e-9
        assert d @ z == pytest.approx(max(0.0, MU * np.hypot(d[0], d[1]) + d[2]), abs=1e-9)


def test_the_nearest_point_of_a_cone(rng):
    """Least |z - p|^2: the projection, in closed form; inside, on the edge, at the apex."""
    found = set()
    for _ in range(60):
        p = rng.normal(size=3)
        z = least(np.eye(3), -p, CONE, Work(1e12))
        exact = project_cones(p[None], np.array([MU]))[0]
        assert z == pytest.approx(exact, abs=1e-9)
        found.add("apex" if not exact.any() else "inside" if np.array_equal(exact, p) else "edge")
    assert found == {"apex", "inside", "edge"}


def test_over_bounds_alone_the_least_is_the_clipped_point():
    """Least |z - p|^2 / 2 over 0 <= z <= 1, no cones: p brought between the bounds, coordinate by coordinate."""
    p = np.array([-0.5, 0.3, 2.0])
    sides, bounds = np.vstack([np.eye(3), -np.eye(3)]), np.r_[np.zeros(3), -np.ones(3)]
    unit = cone_program(sides, bounds, np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
    assert least(np.eye(3), -p, unit, Work(1e12)) == pytest.approx(np.clip(p, 0.0, 1.0), abs=1e-9)


def test_without_work_nothing_is_found_and_a_set_can_be_widened():
    """A cone pressed flat has no inside; widened, its apex is inside by so much."""
    assert least(np.eye(3), np.ones(3), CONE, Work(0.0)) is None
    flat = widened(cone_program(-np.eye(3)[2:], np.zeros(1), np.eye(3)[None], np.zeros((1, 3)), np.array([MU])), 1e-10)
    apex = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e-10 / MU])  # z = 0, and its u
    assert np.abs(flat.A @ apex - flat.b).max() < 1e-25 and (flat.C @ apex - flat.low) == pytest.approx(1e-10)
    assert MU * apex[5] == pytest.approx(1e-10)
