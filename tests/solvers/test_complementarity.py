"""All solutions of mixed complementarity problems, against brute force over every mode."""

import itertools

import numpy as np
import pytest

from rbd.problem.programs import least_distance
from rbd.solvers.complementarity import Mixed, all_solutions


def brute_force(A, b, lower, upper) -> list[np.ndarray]:
    """Every mode of every entry tried, by plain inversion: for regular blocks only."""
    found: list[np.ndarray] = []
    fixed = lower == upper
    for modes in itertools.product("flh", repeat=len(b)):
        m = np.array(modes)
        if (np.isinf(lower) & (m == "l")).any() or (np.isinf(upper) & (m == "h")).any() or (fixed & (m != "l")).any():
            continue
        w, free = np.where(m == "l", lower, np.where(m == "h", upper, 0.0)), m == "f"
        w[free] = np.linalg.solve(A[np.ix_(free, free)], -(A @ w + b)[free])
        y = A @ w + b
        inside = (w >= lower - 1e-9).all() and (w <= upper + 1e-9).all()
        if inside and (y[(m == "l") & ~fixed] >= -1e-9).all() and (y[m == "h"] <= 1e-9).all():
            if all(np.abs(w - u).max() > 1e-6 for u in found):
                found.append(w)
    return found


def random_bounds(rng, p) -> tuple[np.ndarray, np.ndarray]:
    """Lines, half-lines, intervals and fixed entries, mixed."""
    lower, upper = np.zeros(p), np.full(p, np.inf)
    for i, kind in enumerate(rng.choice(["half", "line", "interval", "fixed"], size=p, p=[0.6, 0.15, 0.2, 0.05])):
        if kind == "line":
            lower[i] = -np.inf
        elif kind == "interval":
            lower[i], upper[i] = -rng.random(), rng.random()
        elif kind == "fixed":
            lower[i] = upper[i] = rng.random()
    return lower, upper


@pytest.mark.parametrize("near_symmetric", [False, True])
def test_all_solutions_are_those_of_brute_force(near_symmetric, exhaustive):
    """150 or 300 random problems of up to 6 entries: none, one and several solutions, the same, completeness claimed."""
    rng = np.random.default_rng(3)
    counts = set()
    for _ in range(300 if exhaustive else 150):
        p = int(rng.integers(1, 7))
        A, b = rng.normal(size=(p, p)), rng.normal(size=p)
        if near_symmetric:
            A = A @ A.T + 0.3 * rng.normal(size=(p, p))
        lower, upper = random_bounds(rng, p)
        expected = brute_force(A, b, lower, upper)
        found = all_solutions(Mixed(A, b, np.eye(p), lower, upper))
        assert found.complete and len(found.weights) == len(expected) and not any(found.family + found.member)
        for w in expected:
            assert min(np.abs(w - u).max() for u in found.weights) < 1e-7 * max(1.0, np.abs(w).max())
        counts.add(min(len(expected), 3))
    assert counts == {0, 1, 2, 3} if not near_symmetric else counts >= {0, 1, 2}


def test_a_positive_definite_problem_takes_one_node():
    """A symmetric part that is positive definite proves one solution: no branch is visited, 20 half-lines or not."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        p = 20
        B = rng.normal(size=(p, p))
        S = rng.normal(size=(p, p))
        A, b = B @ B.T + 0.1 * np.eye(p) + (S - S.T), rng.normal(size=p)
        found = all_solutions(Mixed(A, b, np.eye(p), np.zeros(p), np.full(p, np.inf), budget=1))
        assert found.complete and len(found.weights) == 1
        w = found.weights[0]
        y = A @ w + b
        assert w.min() >= -1e-9 and y.min() >= -1e-9 and np.abs(w * y).max() < 1e-8


def test_where_blocks_of_pivots_go_round_in_circles_single_ones_end():
    """Five half-lines, the skew part of A thirty times as large as the rest: still one node (Murty's rule)."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        B, S = rng.normal(size=(2, 5, 5))
        A = 0.1 * B @ B.T + 0.01 * np.eye(5) + 30.0 * (S - S.T)
        found = all_solutions(Mixed(A, -np.ones(5), np.eye(5), np.zeros(5), np.full(5, np.inf), budget=1))
        assert found.complete and len(found.weights) == 1


def test_redundant_columns_of_one_motion_are_one_solution_of_least_norm():
    """Four legs at the corners of a square under a centred load W: W/4 each, though many splits carry it."""
    legs = np.array([[1.0, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])  # (tilt, tilt, lift) of each
    A, b = legs @ legs.T, np.full(4, -3.0)
    found = all_solutions(Mixed(A, b, legs.T, np.zeros(4), np.full(4, np.inf)))
    assert found.complete and len(found.weights) == 1 and not found.family[0]
    assert found.weights[0] == pytest.approx(np.full(4, 0.75), abs=1e-12)  # sum w = 3, shared by symmetry


def test_redundant_columns_keep_their_signs_where_least_norm_would_pull():
    """The load near one leg: the plain least-norm split pulls at the far one; the one returned is least within the signs."""
    legs = np.array([[1.0, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
    load = np.array([0.7, 0.7, 1.0])  # tilts and lift that the legs must answer
    A, b = legs @ legs.T, -legs @ load
    assert (np.linalg.pinv(legs.T) @ load).min() < -0.05
    found = all_solutions(Mixed(A, b, legs.T, np.zeros(4), np.full(4, np.inf)))
    w = found.weights[0]
    assert found.complete and len(found.weights) == 1 and w.min() >= -1e-12
    assert legs.T @ w == pytest.approx(load, abs=1e-9)
    assert w[2] == pytest.approx(0.0, abs=1e-12)  # the far leg: it would pull in the plain one


def test_a_family_of_motions_is_met_by_its_least_member_and_its_ends():
    """With y = w1 + w2 - 1 for both entries, and the motion is w itself: all of w1 + w2 = 1, w >= 0 solves it."""
    A, b = np.ones((2, 2)), -np.ones(2)
    found = all_solutions(Mixed(A, b, np.eye(2), np.zeros(2), np.full(2, np.inf)))
    assert [w.tolist() for w in found.weights] == [
        pytest.approx([0.5, 0.5]), pytest.approx([1.0, 0.0]), pytest.approx([0.0, 1.0])
    ]  # fmt: skip
    assert found.family == (True, False, False) and found.member == (False, True, True)


def test_entries_that_are_free_may_contradict_each_other():
    """With y = (w - 1, w - 2) of one line twice: no solution, and that is known."""
    found = all_solutions(
        Mixed(np.ones((2, 2)), np.array([-1.0, -2.0]), np.ones((1, 2)), np.full(2, -np.inf), np.full(2, np.inf))
    )
    assert found.weights == () and found.complete


def test_a_spent_budget_is_said():
    """Ten entries that each have two solutions make 1024; a tree of 100 nodes is not complete."""
    A, b = -np.eye(10), np.ones(10)
    found = all_solutions(Mixed(A, b, np.eye(10), np.zeros(10), np.full(10, np.inf), budget=100))
    assert not found.complete and len(found.weights) > 0
    small = all_solutions(Mixed(A[:4, :4], b[:4], np.eye(4), np.zeros(4), np.full(4, np.inf)))
    assert small.complete and len(small.weights) == 16


@pytest.mark.parametrize("stiff", [1e-24, 1.0, 1e12])
def test_a_linear_program_prunes_what_cannot_be_and_nothing_else(stiff):
    """Twelve entries like those above and one that no weights satisfy: none, in far fewer nodes than 4096; in any units.

    Six of them and one that nothing moves, zero but for rounding: all 64.
    """
    n = 12
    A, b = -np.eye(n + 1), np.ones(n + 1)
    b[n] = -1.0  # y = -w - 1 < 0 for all w >= 0
    V = np.sqrt(stiff) * np.eye(n + 1)
    found = all_solutions(Mixed(stiff * A, b, V, np.zeros(n + 1), np.full(n + 1, np.inf), budget=50))
    assert found.weights == () and found.complete
    A[n, n], b[n], some = 0.0, -1e-13, np.r_[:6, n]
    found = all_solutions(Mixed(stiff * A[np.ix_(some, some)], b[some], V[:6, some], np.zeros(7), np.full(7, np.inf)))
    assert len(found.weights) == 64 and found.complete


def test_the_least_distance_is_that_to_the_corner():
    """|z| least with z1 >= 1 and z1 + z2 >= 3 is (1.5, 1.5); contradictory bounds have none; loose ones give zero."""
    assert least_distance(np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([1.0, 3.0]))[0] == pytest.approx([1.5, 1.5])
    assert least_distance(np.array([[1.0], [-1.0]]), np.array([1.0, 0.5])) is None
    assert least_distance(np.array([[1.0], [-1.0]]), np.array([-1.0, -0.5]))[0] == pytest.approx([0.0])


def test_weights_that_repeat_each_other_are_shared_anew_where_a_decided_one_bears_none():
    """With t = w1 + w2 - w3: y1 = -t - 2 w2 - 2 = -y3, y2 = -t - w2 - 1; w1 in [-1, 1], w2 >= 0, w3 in [0, 1].

    Positive y1 asks w2 < 0, negative y1 leaves y2 < 0; y1 = 0 leaves t = -2 alone, so w = (-1, 0, 1).
    """
    A = np.array([[-1.0, -3.0, 1.0], [-1.0, -2.0, 1.0], [1.0, 3.0, -1.0]])
    V = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, -1.0]])
    found = all_solutions(Mixed(A, np.array([-2.0, -1.0, 2.0]), V, np.array([-1.0, 0.0, 0.0]), np.array([1.0, np.inf, 1.0])))
    assert found.complete and len(found.weights) == 1 and not found.family[0]
    assert found.weights[0] == pytest.approx([-1.0, 0.0, 1.0], abs=1e-9)


def test_the_least_distance_without_its_pivots_is_not_found(monkeypatch):
    """At the limit of nonnegative least squares: None, as of what cannot be met."""
    monkeypatch.setattr("rbd.problem.programs.nonnegative", lambda *_: None)
    assert least_distance(np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([1.0, 3.0])) is None


@pytest.mark.parametrize("loads", ["any", "pressing", "one is zero"])
@pytest.mark.parametrize(("stiff", "load"), [(1e-6, 1e4), (1e6, 1e-3), (1.0, 1e-12), (1.0, 1e12), (1e-9, 1e-9), (1e9, 1e9)])
def test_units_do_not_matter(stiff, load, loads):
    """A and b in other units: the same solutions, in theirs."""
    rng = np.random.default_rng(6)
    for _ in range(40):
        p = int(rng.integers(1, 6))
        A, b = rng.normal(size=(p, p)), rng.normal(size=p)
        if loads == "pressing":
            b = -np.abs(b)
        elif loads == "one is zero":
            b[0] = 0.0
        lower, upper = random_bounds(rng, p)
        expected = brute_force(A, b, lower, upper)
        unit = load / stiff
        found = all_solutions(Mixed(stiff * A, load * b, np.sqrt(stiff) * np.eye(p), lower * unit, upper * unit))
        assert found.complete and len(found.weights) == len(expected)
        for w in expected:
            assert min(np.abs(w - u / unit).max() for u in found.weights) < 1e-7 * max(1.0, np.abs(w).max())


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_what_is_zero_but_for_rounding_counts_as_zero(unit):
    """An entry that nothing moves, with b of -1e-13 of the load: taken for zero; with b of -1e-6 of it there is no solution."""
    A = np.diag([2.0, 0.0])
    for rounding, solutions in ((-1e-13, 1), (1e-13, 1), (0.0, 1), (-1e-6, 0)):
        b = unit * np.array([-4.0, rounding])
        found = all_solutions(Mixed(A, b, np.sqrt(A), np.zeros(2), np.array([np.inf, np.inf])))
        assert len(found.weights) == solutions and found.complete
        if solutions:
            assert found.weights[0] == pytest.approx([2.0 * unit, 0.0], abs=1e-9 * unit)


def test_rounding_is_that_of_the_forces_that_balance():
    """Given forces of 1e12 on an entry that nothing moves: 10 left of their balance is zero, 1e7 is not, whatever the load."""
    A = np.zeros((4, 4))
    A[0, 1:3], A[3, 3] = (-1.0, 1.0), 1.0  # y0 = w2 - w1; the last entry moves by itself
    for left, solutions in ((10.0, 1), (-10.0, 1), (-1e7, 0)):
        fixed = [1e12, 1e12 + left]
        lower, upper = np.array([0.0, *fixed, 0.0]), np.array([np.inf, *fixed, np.inf])
        found = all_solutions(Mixed(A, np.array([0.0, 0.0, 0.0, -1.0]), np.eye(4)[3:], lower, upper))
        assert len(found.weights) == solutions and found.complete
        if solutions:
            assert found.weights[0] == pytest.approx([0.0, *fixed, 1.0], rel=1e-12)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_without_free_accelerations_bounds_give_the_units(unit):
    """With b = 0 and A = -1 the ends of an interval and zero are solutions; half-lines with A = -1 leave zero alone."""
    for upper, expected in ((unit, [-2.0, 0.0, 1.0]), (0.0, [-2.0, 0.0])):
        found = all_solutions(Mixed(-np.eye(1), np.zeros(1), np.eye(1), np.array([-2.0 * unit]), np.array([upper])))
        assert sorted(float(w[0]) / unit for w in found.weights) == pytest.approx(expected, abs=1e-12)
    nothing = all_solutions(Mixed(-np.eye(6), np.zeros(6), np.eye(6), np.zeros(6), np.full(6, np.inf)))
    assert nothing.complete and [w.tolist() for w in nothing.weights] == [[0.0] * 6]
