"""SciPy's optimisers within their limits: an answer, or a word why there is none; never another library's error."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.problem import programs
from rbd.problem.programs import Outcome, Work, linear_program, nonnegative, within


def test_a_linear_program_tells_how_it_ended():
    """Least x + y over x + 2 y >= 2, x, y >= 0: 1 at (0, 1); its multiplier is 1/2."""
    A, b = np.array([[-1.0, -2.0]]), np.array([-2.0])
    found = linear_program(np.ones(2), A, b, bounds=(0.0, None))
    assert found.solved and found.value == pytest.approx(1.0) and found.x == pytest.approx([0.0, 1.0])
    assert found.lower == pytest.approx([-0.5])
    assert linear_program(np.ones(2), A, b).outcome is Outcome.UNBOUNDED
    assert linear_program(np.ones(1), np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0])).outcome is Outcome.INFEASIBLE


@pytest.mark.parametrize(("limit", "value"), [("PROGRAM_PIVOTS", 1), ("PROGRAM_SECONDS", 0.0)])
def test_at_its_limit_a_linear_program_is_not_found(monkeypatch, limit, value, rng):
    """Forty rows take more than one pivot, and more than no time."""
    A = rng.normal(size=(40, 20))
    cost, b = -np.abs(A).sum(axis=0), np.ones(40)
    assert linear_program(cost, np.abs(A), b, bounds=(0.0, None)).solved
    monkeypatch.setattr(programs, limit, value)
    found = linear_program(cost, np.abs(A), b, bounds=(0.0, None))
    assert found.outcome is Outcome.NOT_FOUND and np.isnan(found.value) and not found.x.size


def test_what_is_no_program_is_not_found():
    """NaN, infinity, crossed bounds."""
    A = np.eye(2)
    for cost, b in (([np.nan, 0.0], [1.0, 1.0]), ([1.0, 1.0], [np.inf, 1.0])):
        assert linear_program(np.array(cost), A, np.array(b)).outcome is Outcome.NOT_FOUND
    assert not linear_program(np.ones(2), A, np.ones(2), bounds=[(1.0, 0.0), (0.0, 1.0)]).solved
    assert nonnegative(np.full((2, 2), np.nan), np.ones(2)) is None
    assert nonnegative(np.zeros((2, 0)), np.ones(2)).shape == (0,)
    assert np.array_equal(nonnegative(np.zeros((0, 3)), np.zeros(0)), np.zeros(3))


def test_nonnegative_least_squares_gives_up_at_its_limit(monkeypatch, rng):
    """The limit is pivots for each unknown."""
    A = rng.normal(size=(30, 20))
    x = nonnegative(A, A @ np.abs(rng.normal(size=20)))
    assert x is not None and (x >= 0.0).all()
    monkeypatch.setattr(programs, "LEAST_SQUARES_PIVOTS", 0.05)
    assert nonnegative(A, A @ np.ones(20)) is None


def test_least_squares_between_bounds_never_leaves_them():
    """The nearest to (2, -1, 0.5) in a box is the clipped point; without room it is the bound."""
    one = np.ones(3)
    assert within(np.eye(3), np.array([2.0, -1.0, 0.5]), 0.0 * one, one) == pytest.approx([1.0, 0.0, 0.5])
    assert np.array_equal(within(np.eye(3), 2.0 * one, one, one), one)  # no room


def test_bounded_least_squares_lie_on_the_bounds_that_hold_them(rng):
    """Stationarity: no slope where x is free, outwards where a bound holds it, to the last bit; also of too few rows."""
    for rows in (12, 30):
        A, b = rng.normal(size=(rows, 20)), rng.normal(size=rows)
        lower, upper = -rng.uniform(0.0, 0.1, 20), rng.uniform(0.0, 0.1, 20)
        lower[3] = upper[3] = 0.05  # no room
        x = within(A, b, lower, upper)
        slope, low, high = A.T @ (A @ x - b), x == lower, x == upper
        assert (low | high).sum() > 3 and x[3] == 0.05
        assert np.abs(slope[~(low | high)]).max(initial=0.0) < 1e-10
        assert (slope[low & ~high] > -1e-10).all() and (slope[high & ~low] < 1e-10).all()
    free = within(A, b, np.full(20, -np.inf), np.full(20, np.inf))
    assert free == pytest.approx(np.linalg.lstsq(A, b, rcond=None)[0], abs=1e-12)
    assert np.array_equal(within(A, b, upper, upper), upper)
    refused = within(np.full((2, 2), np.nan), np.ones(2), np.array([0.1, -1.0]), np.ones(2))
    assert np.array_equal(refused, [0.1, 0.0])


def test_work_is_spent():
    """And once gone, stays gone."""
    work = Work(10.0)
    assert work.spend(6.0) and not work.spend(6.0) and work.left < 0.0 and not work.spend(0.0)
