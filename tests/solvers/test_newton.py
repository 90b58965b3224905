"""Newton's steps, Pinocchio's ADMM and the interior point on bare complementarity problems, against closed forms."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rbd.problem.cones import Bounds, Free, FrictionCone, NonNegative, Product
from rbd.problem.corner_cones import WrenchCone
from rbd.problem.force_set import ForceSet, at_rest
from rbd.solvers.admm import de_saxce
from rbd.solvers.conic_newton import interior_point
from rbd.solvers.newton import _gap, _matrix, last_step, order_of, scaled, solve_newton, steps_from, yielding_steps
from rbd.solvers.pinocchio_admm import admm

BOX = Bounds([-1.0, -np.inf, 0.3], [2.0, 1.0, 0.3])
MIXED = Product([FrictionCone(0.5), Free(1), BOX, FrictionCone(1.2), NonNegative(2), FrictionCone(0.1)])
"""Every kind of part, cones and others in turn."""


def parts(cone) -> ForceSet:
    """The parts of one set, at rest."""
    return at_rest(cone)


def spd(rng, p: int, rank: int | None = None) -> np.ndarray:
    """A random D of some rank."""
    A = rng.normal(size=(p, p if rank is None else rank))
    return A @ A.T


def missed(D, y_free, T: ForceSet, w, *, coulomb: bool) -> float:
    """How far w is from the law, by `ForceSet` alone: in its set, its acceleration where it may be, and no work."""
    y = D @ w + y_free
    if coulomb:
        y[T.cone_at + 2] += T.mu * np.hypot(y[T.cone_at], y[T.cone_at + 1])
    return max(np.abs(w - T.project(w)).max(), np.abs(T.gap(y)).max(), np.abs(T.slack(w, y)).max())


@pytest.mark.parametrize("coulomb", [False, True])
@pytest.mark.parametrize("rank", [None, 9, 5])
def test_every_kind_of_part_at_once(coulomb, rank, rng):
    """Lines, half-lines, intervals, a fixed force and three cones; D regular and singular. One start in ten may fail."""
    T, failed = parts(MIXED), 0
    for _ in range(60):
        D = spd(rng, T.size, rank)
        w_any = T.project(rng.normal(size=T.size))
        y_free = D @ rng.normal(size=T.size) if rank is None else -D @ w_any  # singular: w_any answers it, y = 0
        w, merit, steps = solve_newton(D, y_free, T, np.zeros(T.size), coulomb=coulomb)
        found = missed(D, y_free, T, w, coulomb=coulomb)
        assert (found < 1e-9) == (merit < 1e-10)  # the merit knows
        assert steps <= 50
        failed += merit > 1e-10
    assert failed <= (0 if rank is None else 6)
    w, merit, _ = solve_newton(np.eye(T.size), -w_any, T, np.zeros(T.size), coulomb=coulomb)
    assert merit < 1e-13 and np.abs(w - w_any).max() < 1e-13


def test_with_the_identity_the_convex_answer_is_the_projection(rng):
    """D = 1: the nearest weights to -y_free; every method finds them."""
    T = parts(MIXED)
    for _ in range(20):
        y_free = 2.0 * rng.normal(size=T.size)
        nearest, start = T.project(-y_free), np.zeros(T.size)
        w, merit, _ = solve_newton(np.eye(T.size), y_free, T, start, coulomb=False)
        assert merit < 1e-13 and np.abs(w - nearest).max() < 1e-12
        S = scaled(np.eye(T.size), y_free, T)
        theirs, _ = admm(S, S.guess(start), coulomb=False, iterations=2000, tolerance=1e-11)
        assert np.abs(S.weights(theirs) - nearest).max() < 1e-8
        inner = interior_point(S.convex()).x
        assert np.abs(S.weights(inner) - nearest).max() < 1e-6


def test_three_methods_agree_on_the_convex_law(rng):
    """Random dense problems of one to eight cones: the motion D w is the same by Newton, ADMM and the interior point."""
    compared = 0
    for k in range(1, 9):
        T = parts(Product([FrictionCone(mu) for mu in rng.uniform(0.1, 1.5, k)]))
        D, y_free = spd(rng, 3 * k), rng.normal(size=3 * k)
        S = scaled(D, y_free, T)
        start = S.guess(np.zeros(3 * k))
        w, merit, _ = steps_from(S, start, coulomb=False)
        assert merit < 1e-12
        inner = interior_point(S.convex()).x
        assert np.abs(S.D @ (inner - w)).max() < 1e-5  # it stops at a duality gap of 1e-13, which is a distance squared
        theirs, n = admm(S, start, coulomb=False, iterations=3000, tolerance=1e-10)
        if n <= 3000:
            compared += 1
            assert np.abs(S.D @ (theirs - w)).max() < 1e-6
    assert compared >= 4


@pytest.mark.parametrize(
    ("y_free", "law", "expected"),
    [
        ([0.5, 0.0, -2.0], True, [-0.5, 0.0, 2.0]),  # sticks: both laws
        ([0.5, 0.0, -2.0], False, [-0.5, 0.0, 2.0]),
        ([3.0, 4.0, -2.0], True, [-0.6, -0.8, 2.0]),  # slides: |w_t| = mu w_n against the motion, y_n = 0
        ([3.0, 4.0, -2.0], False, [-0.6 * 1.8, -0.8 * 1.8, 3.6]),  # w_n = (2 + mu 5) / (1 + mu^2), on the edge
        ([3.0, 4.0, 0.1], True, [0.0, 0.0, 0.0]),  # opens
        ([3.0, 4.0, 2.51], False, [0.0, 0.0, 0.0]),  # y in K*: |y_t| <= y_n / mu
    ],
)
def test_one_point_on_a_unit_mass(y_free, law, expected):
    """D = 1, mu = 0.5: sticks, slides or opens in closed form."""
    w, merit, _ = solve_newton(np.eye(3), np.array(y_free), parts(FrictionCone(0.5)), np.zeros(3), coulomb=law)
    assert merit < 1e-14 and w == pytest.approx(expected, abs=1e-12)


def test_a_nonsymmetric_matrix_is_taken(rng):
    """Half-lines with a P-matrix D, nonsymmetric as of sliding points: the one answer among all subsets of contacts."""
    T = parts(NonNegative(5))
    for _ in range(30):
        D = spd(rng, 5) + np.eye(5)
        skew = rng.normal(size=(5, 5))
        D = D + skew - skew.T  # symmetric part positive definite: exactly one answer
        y_free = 3.0 * rng.normal(size=5)
        w, merit, _ = solve_newton(D, y_free, T, np.zeros(5), coulomb=True)
        answers = []
        for presses in product([False, True], repeat=5):
            at = np.flatnonzero(presses)
            one = np.zeros(5)
            one[at] = np.linalg.solve(D[np.ix_(at, at)], -y_free[at])
            if one.min() >= 0.0 and (D @ one + y_free).min() >= -1e-12:
                answers.append(one)
        assert len(answers) == 1
        assert merit < 1e-12 and np.abs(w - answers[0]).max() < 1e-10


def test_units_change_nothing(rng):
    """Each contact's rows in other units, masses a million times larger: the same answer in those units."""
    T = parts(Product([FrictionCone(0.6), NonNegative(1), FrictionCone(0.3)]))
    D, y_free = spd(rng, 7, 6), rng.normal(size=7)
    y_free[[2, 6]] = -np.abs(y_free[[2, 6]])
    units = np.array([1e3, 1e3, 1e3, 1e-3, 1.0, 1.0, 1.0])
    for coulomb in (True, False):
        w, merit, steps = solve_newton(D, y_free, T, np.zeros(7), coulomb=coulomb)
        scaled_D = 1e-6 * D * units * units[:, None]
        other, same, again = solve_newton(scaled_D, 1e-2 * y_free * units, T, np.zeros(7), coulomb=coulomb)
        assert merit < 1e-13 and same < 1e-13 and again == steps
        assert D @ (other * units * 1e-4) == pytest.approx(D @ w, abs=1e-10)


def test_four_corners_share_rows_of_rank_six(rng):
    """A patch: 12 columns, rank 6. Weights are one of many; they answer all the same."""
    T = parts(WrenchCone(np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) * [0.1, 0.05, 0.0], 0.4))
    for coulomb in (True, False):
        for _ in range(20):
            A = spd(rng, 6)
            D, y_free = T.H.T @ A @ T.G, T.H.T @ (rng.normal(size=6) - [0, 0, 3, 0, 0, 0])
            w, merit, _ = solve_newton(D, y_free, T, np.zeros(12), coulomb=coulomb)
            assert merit < 1e-12 and missed(D, y_free, T, w, coulomb=coulomb) < 1e-8


def test_no_more_steps_than_asked_and_the_best_is_returned(rng):
    """Zero steps return the guess, projected, with its merit; more steps never give a worse one."""
    T = parts(Product([FrictionCone(0.5)] * 4))
    D, y_free, guess = spd(rng, 12), rng.normal(size=12), rng.normal(size=12)
    merits = []
    for n in range(8):
        w, merit, steps = solve_newton(D, y_free, T, guess, coulomb=True, iterations=n)
        merits.append(merit)
        assert steps <= n
        if n == 0:
            assert w == pytest.approx(T.project(guess), abs=1e-15)
    assert merits == sorted(merits, reverse=True)


def test_what_has_no_answer_ends():
    """A line that nothing moves and that should: the merit says so, at once, without a warning."""
    T = parts(Product([Free(1), FrictionCone(0.5)]))
    D = np.diag([0.0, 1.0, 1.0, 1.0])
    for coulomb in (True, False):
        w, merit, steps = solve_newton(D, np.array([1.0, 0.0, 0.0, -1.0]), T, np.zeros(4), coulomb=coulomb)
        assert merit > 0.1 and steps <= 50 and np.isfinite(w).all()
    S = scaled(D, np.array([1.0, 0.0, 0.0, -1.0]), T)
    assert interior_point(S.convex()).iterations <= 60 and np.isfinite(interior_point(S.convex()).x).all()


def test_the_order_of_columns_is_put_back(rng):
    """Cones stand last for Newton; weights come back where `ForceSet` has them."""
    T = parts(MIXED)
    order = order_of(T)
    assert order.singles == T.size - 9 and sorted(order.columns) == list(range(T.size))
    S = scaled(spd(rng, T.size), rng.normal(size=T.size), T)
    weights = rng.normal(size=T.size)
    assert S.weights(S.guess(weights)) == pytest.approx(weights, abs=1e-14)


def test_points_that_yield_less_and_less_come_to_the_rigid_answer(rng):
    """Corners of rank six, convex law: the compliance of the rounds is not in the answer, which meets D itself."""
    T = parts(WrenchCone(np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) * [0.1, 0.05, 0.0], 0.4))
    for _ in range(20):
        A = spd(rng, 6)
        D, y_free = T.H.T @ A @ T.G, T.H.T @ (rng.normal(size=6) - [0, 0, 3, 0, 0, 0])
        S = scaled(D, y_free, T)
        w, merit = yielding_steps(S, np.zeros(12), coulomb=False)
        assert merit < 1e-10 and missed(D, y_free, T, T.project(S.weights(w)), coulomb=False) < 1e-9
        exact, _, _ = steps_from(S, np.zeros(12), coulomb=False)
        assert np.abs(S.D @ (w - exact)).max() < 1e-9


def test_de_saxces_term_is_mu_times_the_sliding_speed(rng):
    """At the normal of each cone mu |y_t|, of both tangents, and nothing elsewhere."""
    T = parts(Product([NonNegative(2), FrictionCone(0.5), FrictionCone(1.5)]))
    S = scaled(np.eye(T.size), rng.normal(size=T.size), T)
    y = np.array([7.0, -8.0, 3.0, -4.0, 9.0, 5.0, 12.0, -2.0])
    assert de_saxce(S, y) == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.5 * 5.0, 0.0, 0.0, 1.5 * 13.0], abs=1e-14)


@pytest.mark.parametrize("coulomb", [False, True])
def test_newtons_matrix_is_the_slope_of_the_gap(coulomb, rng):
    """By central differences, row by row: of points that slip, stick and open, of lines and intervals."""
    T, slipping = parts(MIXED), 0
    for _ in range(40):
        S = scaled(spd(rng, T.size), rng.normal(size=T.size), T)
        w, h = rng.normal(size=T.size), 1e-6
        y = S.D @ w + S.q
        _, p, edges = _gap(S, w, y, coulomb)
        slipping += int(edges.slips.sum())
        found = _matrix(S, S.D - np.eye(T.size), p, edges, coulomb)
        for j, e in enumerate(np.eye(T.size)):
            ahead, behind = (_gap(S, w + s * e, S.D @ (w + s * e) + S.q, coulomb)[0] for s in (h, -h))
            assert -found[:, j] == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-5 * max(1.0, np.abs(found).max()))
    assert slipping > 20


@pytest.mark.parametrize("coulomb", [False, True])
def test_the_last_step_brings_weights_near_an_answer_onto_it(coulomb, rng):
    """A millionth off, in the right modes: what is left is of second order."""
    T, slipping = parts(MIXED), 0
    for _ in range(30):
        S = scaled(spd(rng, T.size) + np.eye(T.size), 3.0 * rng.normal(size=T.size), T)
        w, merit, _ = steps_from(S, np.zeros(T.size), coulomb=coulomb)
        assert merit < 1e-13
        slipping += int(_gap(S, w, S.D @ w + S.q, coulomb)[2].slips.sum())
        w = w + 1e-6 * rng.normal(size=T.size)
        w = w + last_step(S, w, S.D @ w + S.q, coulomb=coulomb)
        assert np.abs(_gap(S, w, S.D @ w + S.q, coulomb)[0]).max() < 1e-9
    assert slipping > 20


@pytest.mark.parametrize("mu", [0.25, 2.0])
@pytest.mark.parametrize("coulomb", [False, True])
def test_the_last_step_corrects_what_is_below_the_last_digit_of_the_weights(coulomb, mu):
    """D = 1 and a point that slips under a load of 8: its acceleration of 1e-18 along n, or the cone's edge, is undone."""
    S, edge = scaled(np.eye(3), np.array([1.0, 1.0, -1.0]), parts(FrictionCone(mu))), np.array([-mu, 0.0, 1.0])
    along = np.array([0.0, 0.0, 1.0]) if coulomb else edge
    y = 1e-9 * np.array([1.0, 0.0, 0.0 if coulomb else mu]) + 1e-18 * along  # it slips across what is loaded
    dw = last_step(S, 8.0 * edge, y, coulomb=coulomb)
    assert along @ dw == pytest.approx(-along @ y, rel=1e-3, abs=0.0) and np.abs(dw).max() < 1e-14


@pytest.mark.parametrize("most", [0, 1, 2])
def test_a_point_is_scaled_by_its_largest_mobility(most):
    """The two tangents and the normal of a cone have one unit, that of the largest diagonal entry, which becomes one."""
    D = np.eye(4)
    D[most, most] = 9.0
    S = scaled(D, np.array([1.0, 0.0, -2.0, 1.0]), parts(Product([FrictionCone(0.5), NonNegative(1)])))
    assert S.order.columns is not None and S.D.diagonal()[1:].max() == S.D[0, 0] == pytest.approx(1.0)
    assert S.unit[1:] == pytest.approx(np.full(3, S.unit[0] / 3.0))


def test_rows_that_repeat_each_other_and_do_not_yield_stop_newton_where_it_began():
    """D of rank one on two lines, without the proximal term: singular, so the guess comes back, and its merit with it."""
    problem = scaled(np.ones((2, 2)), np.array([1.0, 2.0]), parts(Free(2)))
    guess = np.array([0.5, -0.25])
    w, merit, steps = steps_from(problem, guess, coulomb=False, proximal=0.0)
    assert np.array_equal(w, guess) and steps == 0
    assert merit == pytest.approx(np.abs(problem.D @ guess + problem.q).max())


def test_the_interior_point_without_cones_is_the_clipped_answer(rng):
    """Half-lines alone and D = 1: w = max(0, -q), in closed form."""
    q = rng.normal(size=6)
    problem = scaled(np.eye(6), q, parts(NonNegative(6)))
    w = interior_point(problem.convex()).x
    assert problem.weights(w) == pytest.approx(np.maximum(-q, 0.0), abs=1e-7)
