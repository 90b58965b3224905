"""The QP room: one sign, one retry policy, and a linear program that tells whether constraints can be met."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

import rbd
from rbd.arrays import identity, zeros
from rbd.problem.programs import Work
from rbd.solvers import qp


def _solve(H, g, A=None, b=None, C=None, l=None):
    return next(iter(qp.attempts(H, g, A, b, C, l)))


def test_a_multiplier_is_a_force_with_its_sign(rng):
    """H x + g = A^T y + C^T z: z >= 0 where a bound holds."""
    one, between = np.eye(1), {"C": np.array([[1.0], [-1.0]]), "l": np.array([0.0, -10.0])}
    pushed = _solve(one, np.array([3.0]), **between)
    assert pushed.x == pytest.approx([0.0], abs=1e-9) and pushed.z == pytest.approx([3.0, 0.0])
    pulled = _solve(one, np.array([-20.0]), **between)
    assert pulled.x == pytest.approx([10.0]) and pulled.z == pytest.approx([0.0, 10.0])
    held = _solve(one, np.array([3.0]), A=one, b=np.array([1.0]))
    assert held.x == pytest.approx([1.0]) and held.y == pytest.approx([4.0])


def test_random_programs_satisfy_their_optimality_conditions(rng):
    """Stationarity, feasibility, complementarity, recomputed, at the first setting.

    ProxSuite calls an answer solved whose multipliers push at bounds 1e-3 away, unless its duality gap is asked for.
    """
    for _ in range(60):
        n = 8
        B = rng.normal(size=(n, n))
        H, g = B @ B.T + 0.1 * np.eye(n), rng.normal(size=n)
        A, C = rng.normal(size=(2, n)), rng.normal(size=(5, n))
        x0 = rng.normal(size=n)
        b, l = A @ x0, C @ x0 - rng.uniform(size=5)
        r = _solve(H, g, A, b, C, l)
        assert np.abs(H @ r.x + g - A.T @ r.y - C.T @ r.z).max() < 1e-8
        assert np.abs(A @ r.x - b).max() < 1e-8
        assert (C @ r.x > l - 1e-8).all() and (r.z > -1e-9).all()
        assert np.abs(r.z * (C @ r.x - l)).max() < 1e-7


def test_one_result_a_setting_until_the_caller_stops():
    """Attempts are made when asked for, and their iterations add up."""
    one = np.eye(1)
    results = list(qp.attempts(one, -one[0], None, None, one, np.zeros(1)))
    assert len(results) == len(qp.POLICY)
    assert [r.iterations for r in results] == sorted(r.iterations for r in results)
    assert all(r.x == pytest.approx([1.0]) for r in results)


@pytest.mark.parametrize("what", ["H", "g", "A", "b", "C", "l"])
def test_nan_never_reaches_proxsuite(what):
    """It would run on for seconds and call the answer solved."""
    one = np.eye(1)
    given = {"H": one, "g": one[0], "A": one, "b": one[0], "C": one, "l": -one[0]}
    given[what] = np.full_like(given[what], np.nan)
    with pytest.raises(rbd.InputError, match="QP"):
        _solve(**given)


def test_least_violation_tells_whether_constraints_can_be_met(rng):
    """Zero where they can; where x = 0 and x = 1 are asked for, one half."""
    one = np.ones((1, 1))
    none = np.zeros((0, 1))
    both = np.ones((2, 1))
    assert qp.least_violation(both, np.array([0.0, 1.0]), none, np.zeros(0)) == pytest.approx(0.5)
    assert qp.least_violation(one, np.zeros(1), one, np.array([-1.0])) == pytest.approx(0.0, abs=1e-9)
    assert qp.least_violation(none, np.zeros(0), np.array([[1.0], [-1.0]]), np.array([1.0, 0.0])) == pytest.approx(0.5)
    A = rng.normal(size=(3, 6))
    assert qp.least_violation(A, rng.normal(size=3), np.zeros((0, 6)), np.zeros(0)) == pytest.approx(0.0, abs=1e-8)


def test_nonnegative_least_squares_beside_proxsuite(rng):
    """The point nearest to zero over A x = b, C x >= l: the same from both, multipliers too; equations that repeat."""
    for _ in range(20):
        A, C = rng.normal(size=(2, 6)), rng.normal(size=(12, 6))
        inside = rng.normal(size=6)
        b, l = A @ inside, C @ inside - rng.uniform(0.0, 1.0, 12)
        first, second = islice(qp.attempts(identity(6), zeros(6), A, b, C, l), 2)
        assert second.x == pytest.approx(first.x, abs=1e-7)
        assert second.z == pytest.approx(first.z, abs=1e-6) and (second.z >= 0.0).all()
        assert A.T @ second.y + C.T @ second.z == pytest.approx(second.x, abs=1e-10)
        twice = qp._nearest_to_zero(np.vstack([A, A]), np.r_[b, b], C, l, 0)
        assert twice is not None and twice.x == pytest.approx(first.x, abs=1e-7)


def test_rows_that_cannot_be_met_have_no_nearest_point():
    """X >= 1 and -x >= 1."""
    assert qp._nearest_to_zero(None, None, np.array([[1.0], [-1.0]]), np.ones(2), 0) is None


def test_settings_end_with_their_work(rng):
    """One attempt where there is no work for more; else every setting."""
    C = rng.normal(size=(5, 3))
    H = 2.0 * np.eye(3)
    assert len(list(qp.attempts(H, np.ones(3), None, None, C, -np.ones(5)))) == len(qp.POLICY)
    steps = 3 * next(qp.attempts(H, np.ones(3), None, None, C, -np.ones(5))).iterations
    spent = Work(8.0 * steps)  # a step costs the square of the 3 unknowns and 5 rows
    assert len(list(qp.attempts(H, np.ones(3), None, None, C, -np.ones(5), work=spent))) == 1 and spent.left < 0.0
    spent = Work(1.0)
    assert len(list(qp.attempts(H, np.ones(3), None, None, C, -np.ones(5), work=spent))) == 1 and spent.left < 0.0


def test_no_rows_are_never_violated():
    """Nothing asked: zero, whatever x."""
    assert qp.least_violation(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0)) == 0.0


def test_the_nearest_point_without_its_pivots_is_not_found(monkeypatch):
    """At least 1 of one coordinate: 1 with a push of 1; at the limit of nonnegative least squares, None."""
    found = qp._nearest_to_zero(None, None, np.ones((1, 1)), np.ones(1), 0)
    assert found is not None and found.x == pytest.approx([1.0]) and found.z == pytest.approx([1.0])
    monkeypatch.setattr("rbd.problem.programs.nonnegative", lambda *_: None)
    assert qp._nearest_to_zero(None, None, np.ones((1, 1)), np.ones(1), 0) is None
