"""Intervals contain exact results: against rational numbers, and mpmath with fifty digits."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from rbd.errors import InputError
from rbd.intervals import Intervals, U, above, bounded_by, positive_definite, product, residual, solve


def nasty(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Doubles of all sizes between 1e-30 and 1e30, zeros and cancelling pairs among them."""
    x = rng.standard_normal(shape) * 10.0 ** rng.integers(-30, 31, shape)
    x[rng.random(shape) < 0.1] = 0.0
    if shape[-1] > 1:
        x[..., 0] = -x[..., 1] * (1.0 + U * rng.integers(-4, 5, shape[:-1]))
    return x


def exact(x: np.ndarray) -> np.ndarray:
    """The same doubles as rational numbers."""
    return np.array([Fraction(float(value)) for value in np.ravel(x)], object).reshape(np.shape(x))


def holds(found: Intervals, true: np.ndarray) -> bool:
    """Whether rational numbers lie between the ends, which are doubles."""
    lower, upper = exact(found.lower), exact(found.upper)
    return bool(np.all(lower <= true) and np.all(true <= upper))


def members(rng: np.random.Generator, box: Intervals) -> np.ndarray:
    """Rational members, ends among them."""
    share = exact(np.clip(rng.uniform(-1.3, 1.3, box.shape), -1.0, 1.0))
    return exact(box.mid) + share * exact(box.rad)


@pytest.mark.parametrize("width", [0.0, 1e-12, 1e-2])
def test_sums_products_and_quotients_hold_the_exact_ones(width: float):
    """Of every member of the operands, taken as rational numbers."""
    rng = np.random.default_rng(41)
    for _ in range(30):
        a, b = (Intervals(x, width * np.abs(x)) for x in (nasty(rng, 12), nasty(rng, 12)))
        x, y = members(rng, a), members(rng, b)
        assert holds(a + b, x + y) and holds(a - b, x - y) and holds(a * b, x * y) and holds(-a, -x)
        apart = b.mid != 0.0
        assert holds(a[apart] / b[apart], x[apart] / y[apart])
        assert holds(a.hull(b), x) and holds(a.hull(b), y) and holds(a.hull(b).intersection(a), x)
    assert np.isinf((Intervals.exact(np.ones(1)) / np.zeros(1)).rad).all()


def test_products_of_matrices_hold_the_exact_ones_and_are_as_narrow_as_the_bound():
    """|fl(AB) - AB| <= n u |A||B|: the radius is that bound, and no more than two units above it."""
    rng = np.random.default_rng(42)
    for n in (1, 3, 24):
        A, B = nasty(rng, 4, n), nasty(rng, n, 3)
        found = product(A, B)
        assert holds(found, exact(A).dot(exact(B)))
        bound = n * U * (np.abs(A) @ np.abs(B))
        assert (found.rad <= 1.001 * bound + 1e-299).all() and (found.rad >= bound).all()
        wide = Intervals(A, 1e-3 * np.abs(A)), Intervals(B, 1e-3 * np.abs(B))
        assert holds(wide[0] @ wide[1], members(rng, wide[0]).dot(members(rng, wide[1])))
        assert holds(A @ wide[1], exact(A).dot(members(rng, wide[1])))


def test_residuals_have_twice_the_digits():
    """Of sums that cancel to rounding, the error is of the order of u^2 of their terms."""
    rng = np.random.default_rng(43)
    for n in (1, 2, 17, 64):
        A, x = rng.standard_normal((5, n)), rng.standard_normal(n) * 10.0 ** rng.integers(-6, 7, n)
        b = -(A @ x)
        high, low, rad = residual([(A, x)], [b])
        true = exact(A).dot(exact(x)) + exact(b)
        off = np.abs(true - exact(high) - exact(low))
        assert (off <= exact(rad)).all()
        assert (rad <= 4.0 * (n + 8) ** 2 * U * U * (np.abs(A) @ np.abs(x) + np.abs(b)) + 1e-299).all()


def test_roots_sines_and_cosines_hold_the_exact_ones():
    """Against fifty digits, at midpoints and inside, arguments up to 1e5."""
    rng = np.random.default_rng(44)
    with mpmath.workdps(50):
        for scale, width in ((1.0, 0.0), (1e5, 0.0), (3.0, 1e-9), (3.0, 0.3)):
            x = rng.uniform(-scale, scale, 60)
            box = Intervals(x, np.full(60, width))
            share = rng.uniform(-1.0, 1.0, 60)
            inner = [mpmath.mpf(float(m)) + mpmath.mpf(float(s)) * mpmath.mpf(width) for m, s in zip(x, share, strict=True)]
            for found, f in ((box.sin(), mpmath.sin), (box.cos(), mpmath.cos)):
                assert all(
                    mpmath.mpf(float(lo)) <= f(t) <= mpmath.mpf(float(hi))
                    for lo, hi, t in zip(found.lower, found.upper, inner, strict=True)
                )
                assert (found.rad <= 10.0 * U + width + width**2).all()
            roots = Intervals(np.abs(x) + width, box.rad).sqrt()
            for lo, hi, m, s in zip(roots.lower, roots.upper, x, share, strict=True):
                t = abs(mpmath.mpf(float(m))) + mpmath.mpf(width) * (1 + mpmath.mpf(float(s)))
                assert mpmath.mpf(float(lo)) <= mpmath.sqrt(t) * (1 + mpmath.mpf(U)) and mpmath.sqrt(t) * (1 - U) <= hi
    assert (Intervals.exact(np.array([1e6])).sin().rad == 2.0).all() and np.isnan(Intervals.exact(np.array([-1.0])).sqrt().rad)


def rational_solution(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of A x = b, by elimination in rational numbers."""
    rows = [[*row, right] for row, right in zip(exact(A), exact(b), strict=True)]
    n = len(rows)
    for i in range(n):
        pivot = next(k for k in range(i, n) if rows[k][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i and rows[k][i]:
                rows[k] = [x - rows[k][i] * y for x, y in zip(rows[k], rows[i], strict=True)]
    return np.array([row[n] for row in rows], object)


def test_verified_solutions_hold_the_rational_ones():
    """Also of a matrix of condition 1e10, whose solution plain floating point has to six digits; a few units wide."""
    rng = np.random.default_rng(45)
    for n, bad in ((1, 0), (6, 0), (9, 5), (9, 10)):
        U_, _, V = np.linalg.svd(rng.standard_normal((n, n)))
        A, b = U_ @ np.diag(np.logspace(0, -bad, n)) @ V, rng.standard_normal(n) * 100.0
        found = solve(A, b)
        assert found is not None and holds(found, rational_solution(A, b))
        assert (found.rad <= 4.0 * U * np.abs(found.mid) + 1e-10 * U * np.abs(found.mid).max()).all()
        wide = Intervals(A, 1e-3 * 10.0**-bad / n * np.abs(A))
        of_wide = solve(wide, b)
        assert of_wide is not None and holds(of_wide, rational_solution(A + 0.7 * wide.rad * rng.choice([-1, 1], A.shape), b))


def test_what_may_be_singular_is_refused():
    """A singular matrix, one that cannot be told from it, and a start that no box contracts to."""
    A = np.array([[1.0, 2.0], [2.0, 4.0]])
    assert solve(A, np.ones(2)) is None
    assert solve(Intervals(np.eye(2), np.full((2, 2), 0.6)), np.ones(2)) is None
    assert bounded_by(np.array([[0.0, 2.0], [0.6, 0.0]]), np.ones(2)) is None
    assert bounded_by(np.array([[0.0, 0.0], [np.nan, 0.0]]), np.ones(2)) is None


def test_positive_definiteness_is_shown_or_not():
    """Of a matrix with a least eigenvalue of 1e-9; not of one whose least eigenvalue is -1e-17."""
    A = np.diag([1.0, 1e-9])
    A[0, 1] = A[1, 0] = 1e-5
    assert positive_definite(A, np.linalg.cholesky(A))
    border = np.array([[1.0, 1.0], [1.0, 1.0 - 2.0 * U]])
    assert not positive_definite(border, np.array([[1.0, 0.0], [1.0, 1e-8]]))
    assert not positive_definite(np.eye(2), np.zeros((2, 2)))


def test_ends_are_checked_and_tests_are_strict():
    """Reversed, infinite or misshapen ends are refused; an interval is not in its own interior."""
    for lower, upper in ((1.0, 0.0), (0.0, np.inf), (np.nan, 1.0), (np.zeros(2), np.zeros(3)), ("a", 1.0)):
        with pytest.raises(InputError):
            Intervals.of(lower, upper)
    with pytest.raises(InputError, match="without a common number"):
        Intervals.of(0.0, 1.0).intersection(Intervals.of(2.0, 3.0))
    box = Intervals.of([0.0, 1.0], [1.0, 2.0])
    assert not box.inside(box).any() and box.inside(Intervals.of(-0.1, 2.1)).all()
    assert box.positive().tolist() == [False, True] and box.contains([0.5, 3.0]).tolist() == [True, False]
    assert (box.size >= box.upper).all() and str(box) == "intervals of shape (2,), widest 1.0e+00"
    lost = Intervals(np.array([1.0]), np.array([np.nan]))
    assert not (lost.positive() | lost.inside(Intervals.of(-9.0, 9.0)) | lost.contains(1.0)).any()
    assert above(np.array([1.0]), 0) > 1.0
