"""A convex quadratic over bounds and circular cones: closed forms, conditions of the least, gaps, sets without an inside."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.problem.cones import project_cones
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.programs import Work
from rbd.solvers.conic_newton import by_dual, solve_conic

MU = 0.6


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


# By Clarabel and Newton's method


def cone(linear: np.ndarray, squares: float = 0.0, upper: float = np.inf) -> Conic:
    """1/2 squares |z|^2 + linear . z over one cone, whose normal is at most `upper`."""
    z = Unknowns(3, squares, linear, cones=np.arange(3)[None], mu=np.array([MU]))
    return Conic.of({"z": z}, between=[({"z": np.array([[0.0, 0.0, 1.0]])}, -np.inf, upper)])


def test_a_linear_function_ends_on_the_rim(rng):
    """Over |t| <= mu n, n <= 1 the largest d . (t, n) is max(0, mu |d_t| + d_n)."""
    for _ in range(20):
        d = rng.normal(size=3)
        found = solve_conic(cone(-d, upper=1.0), newton=False)
        assert found.solved and MU * found.x[2] - np.hypot(found.x[0], found.x[1]) > -1e-9 and found.x[2] < 1.0 + 1e-9
        assert d @ found.x == pytest.approx(max(0.0, MU * np.hypot(d[0], d[1]) + d[2]), abs=1e-9)


def test_the_nearest_point_of_a_cone(rng):
    """Least |z - p|^2: the projection, in closed form; inside, on the edge, at the apex."""
    found = set()
    for _ in range(60):
        p = rng.normal(size=3)
        exact = project_cones(p[None], np.array([MU]))[0]
        assert solve_conic(cone(-p, 1.0), newton=False).x == pytest.approx(exact, abs=1e-9)
        found.add("apex" if not exact.any() else "inside" if np.array_equal(exact, p) else "edge")
    assert found == {"apex", "inside", "edge"}


def test_over_bounds_alone_the_least_is_the_clipped_point():
    """Least |z - p|^2 / 2 over 0 <= z <= 1, no cones: p brought between the bounds, coordinate by coordinate."""
    p = np.array([-0.5, 0.3, 2.0])
    program = Conic.of({"z": Unknowns(3, 1.0, -p, 0.0, 1.0)})
    assert solve_conic(program, newton=False).x == pytest.approx(np.clip(p, 0.0, 1.0), abs=1e-9)
