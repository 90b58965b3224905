"""Strictly convex programs by DAQP: signs, dependent equations, what it must not be trusted with, the same bits."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import daqp
import numpy as np
import pytest

from rbd.errors import InputError
from rbd.solvers.qp import independent_rows, solve_strict

Array = np.ndarray
NONE, INF = np.zeros(0), np.inf
ONE = np.array([[1.0, 1.0]])


def solved(
    H: Array, g: list[float], C: Array, low: list[float], high: list[float], lower: Array = NONE, upper: Array = NONE
) -> tuple[Array, Array, Array, bool]:
    """(x, z, y, whether it is solved)."""
    found = solve_strict(H, np.array(g), lower, upper, C, np.array(low, float), np.array(high, float))
    return found.x, found.z, found.y, found.solved


def test_multipliers_are_forces() -> None:
    """H x + g = z + C^T y: positive at lower bounds, negative at upper ones, of rows and of bounds."""
    x, _, y, ok = solved(np.eye(2), [-1.0, -1.0], ONE, [-INF], [1.0])
    assert ok and x == pytest.approx([0.5, 0.5]) and y == pytest.approx([-0.5])
    x, _, y, ok = solved(np.eye(2), [1.0, 1.0], ONE, [-1.0], [INF])
    assert ok and x == pytest.approx([-0.5, -0.5]) and y == pytest.approx([0.5])
    x, z, y, ok = solved(np.eye(2), [1.0, -3.0], ONE, [-INF], [9.0], np.array([-0.5]), np.array([INF]))
    assert ok and x == pytest.approx([-0.5, 3.0]) and z == pytest.approx([0.5]) and y == pytest.approx([0.0])
    x, z, y, ok = solved(np.eye(2), [0.0, 0.0], ONE, [1.0], [1.0], np.array([0.7]), np.array([0.7]))
    assert ok and x == pytest.approx([0.7, 0.3]) and y == pytest.approx([0.3]) and z == pytest.approx([0.4])


def test_random_programs_meet_their_optimality_conditions() -> None:
    """Bounds, rows, equations; condition numbers up to 1e8: to 1e-9."""
    rng = np.random.default_rng(0)
    for i in range(200):
        n, q = int(rng.integers(2, 30)), int(rng.integers(0, 40))
        R = rng.normal(size=(n, n))
        H = R @ R.T + 10.0 ** -(i % 7) * np.eye(n)
        g, C, middle = rng.normal(size=n), rng.normal(size=(q, n)), rng.normal(size=n)
        width = np.where(rng.random(q) < 0.1 * min(1.0, n / max(q, 1)), 0.0, rng.uniform(0.0, 1.0, q))
        k = int(rng.integers(0, n + 1))
        lower, upper = middle[:k] - rng.uniform(0.1, 1.0, k), np.where(rng.random(k) < 0.5, INF, middle[:k] + 0.5)
        found = solve_strict(H, g, lower, upper, C, C @ middle - width, C @ middle + width)
        assert found.solved
        x, pull = found.x, np.concatenate([found.z, np.zeros(n - k)])
        assert np.abs(H @ x + g - pull - C.T @ found.y).max() < 1e-9 * max(1.0, np.abs(g).max(), np.abs(H @ x).max())
        rows, bottom = np.concatenate([x[:k], C @ x]), np.concatenate([lower, C @ middle - width])
        top, y = np.concatenate([upper, C @ middle + width]), np.concatenate([found.z, found.y])
        assert (rows > bottom - 1e-9).all() and (rows < top + 1e-9).all()
        room = np.where(y > 0.0, rows - bottom, np.where(y < 0.0, top - rows, 0.0))
        assert (np.abs(y * room) < 1e-9 * max(1.0, np.abs(y).max())).all()


def test_equations_that_are_given_twice_are_no_harm() -> None:
    """Alike, and twice as large; where they contradict each other there is no answer."""
    for factor in (1.0, 2.0):
        C = np.array([[1.0, 1.0], [factor, factor]])
        x, _, y, ok = solved(np.eye(2), [0.0, 0.0], C, [1.0, factor], [1.0, factor])
        assert ok and x == pytest.approx([0.5, 0.5]) and C.T @ y == pytest.approx(x)
        assert not solved(np.eye(2), [0.0, 0.0], C, [1.0, 2.0 * factor], [1.0, 2.0 * factor])[3]


def test_what_has_no_answer_is_not_called_solved() -> None:
    """Rows that exclude each other, bounds that cross (no step is taken), zero that is to be one, an H that bends down."""
    twice = np.concatenate([ONE, ONE])
    assert not solved(np.eye(2), [0.0, 0.0], twice, [-INF, 1.0], [-1.0, INF])[3]
    crossed = solve_strict(np.eye(2), np.zeros(2), NONE, NONE, ONE, np.ones(1), -np.ones(1))
    assert not crossed.solved and crossed.iterations == 0
    assert not solved(np.eye(2), [0.0, 0.0], np.zeros((1, 2)), [1.0], [1.0])[3]
    assert not solved(np.diag([1.0, -1.0]), [0.0, -1.0], ONE, [-INF], [9.0])[3]


def test_numbers_that_are_none_are_refused() -> None:
    """DAQP itself calls programs with NaN solved."""
    bad, zero = np.nan, np.zeros(1, np.int32)
    assert daqp.solve(np.eye(2), np.array([-1.0, -1.0]), np.array([[bad, 1.0]]), np.ones(1), -np.ones(1), zero)[2] == 1
    for H, g, C, high in (
        (np.diag([1.0, bad]), [0.0, 0.0], ONE, [1.0]),
        (np.eye(2), [bad, 0.0], ONE, [1.0]),
        (np.eye(2), [0.0, 0.0], np.array([[bad, 1.0]]), [1.0]),
        (np.eye(2), [0.0, 0.0], ONE, [bad]),
        (np.eye(2), [INF, 0.0], ONE, [1.0]),
    ):
        with pytest.raises(InputError, match="not finite"):
            solved(H, g, C, [-INF], high)


def test_independent_rows_span_the_others() -> None:
    """Of random rows with multiples and sums among them, and zero rows."""
    rng = np.random.default_rng(1)
    E = rng.normal(size=(6, 10))
    E = np.concatenate([E, 3.0 * E[:2], E[2:3] - 1e-3 * E[4:5], np.zeros((1, 10))])[rng.permutation(10)]
    kept = independent_rows(E)
    assert len(kept) == 6 == np.linalg.matrix_rank(E[kept]) and (np.diff(kept) > 0).all()
    assert len(independent_rows(np.zeros((0, 4)))) == 0 == len(independent_rows(np.zeros((3, 4))))


def test_the_same_program_gives_the_same_bits() -> None:
    """Wherever its numbers lie in memory, in one thread and in four; and its arrays are left as they are."""
    rng = np.random.default_rng(2)
    n = 20
    R = rng.normal(size=(n, n))
    H, g, C, h = R @ R.T + 0.01 * np.eye(n), rng.normal(size=n), rng.normal(size=(40, n)), rng.uniform(0.0, 1.0, 40)
    before = [each.copy() for each in (H, g, C, h)]

    def bits(offset: int) -> bytes:
        moved = np.empty(n * n + 8)[offset : offset + n * n].reshape(n, n)
        moved[:] = H
        return solve_strict(moved, g, NONE, NONE, C, -h, h).x.tobytes()

    with ThreadPoolExecutor(4) as pool:
        found = [bits(k % 8) for k in range(40)] + list(pool.map(lambda k: bits(k % 8), range(200)))
    assert len(set(found)) == 1
    assert all((a == b).all() for a, b in zip(before, (H, g, C, h), strict=True))
