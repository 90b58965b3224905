"""Many small least-squares problems over friction cones at once, in NumPy: semismooth Newton on their duals.

    minimise  sum_j phi_j(u_j) + 1/(2 sigma) |w - w0|^2,  u = d - A w,  w in a product of circular friction cones

with phi_j(u) = weight_j u^2 / 2, and beyond |u| = 1 in rows that are limited steep_j (|u| - 1)^2 / 2 more. The dual has an
unknown for each row of A, and its gradient is piecewise smooth: Newton's method ends after a few steps. Source: Li, Sun, Toh, A
highly efficient semismooth Newton augmented Lagrangian method for solving Lasso problems, SIAM J. Optim. 28 (2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.problem.cones import project_cones, projection

STEPS = 80
EXACT = 1e-13
"""Newton's method ends where the gradient is this, over numbers around one."""
_ROUNDING = 1e-15
"""Of sigma A^T r over sigma and the largest entry of r: what is left of the gradient by rounding."""
_HALVINGS = 30
_ARMIJO = 1e-4
_INSIDE = np.array([0.0, 0.0, 1e-100])
"""Added where Newton's method starts: of points at the apex it takes the slope inside the cone, and saves a step."""
_SIGMAS = (1e2, 1e4) + 10 * (1e6,)
"""Of the rounds of the proximal point algorithm, each started from the last."""
_REPEATED = 2
"""How often what balance misses is added to its aim."""
_SETTLED = 1e-8
"""A problem is done where a round moves its dual answer by less than this share of it, or by `EXACT`."""


@dataclass(frozen=True, eq=False)
class ConeFits:
    """Answers of many problems.

    Attributes:
        w: Forces, each in its cone, shape (n, k, 3): tangent, tangent, normal.
        left: u = d - A w, shape (n, m).
        gradient: What is left of the dual gradient, largest entry, shape (n,).
        steps: Newton's steps taken of each, shape (n,).
    """

    w: Array
    left: Array
    gradient: Array
    steps: Array


@dataclass(frozen=True, eq=False)
class Stage:
    """One problem of a row that ends at the one wanted, each started from the dual answer of the one before.

    Attributes:
        sigma: |w|^2 / (2 sigma) is part of what is made least.
        weight: Of the rows, shape (m,).
        steep: Cost of what exceeds 1 in a row; zero: it is not limited, shape (m,).
    """

    sigma: float
    weight: Array
    steep: Array


def nearest_in_cones(A: Array, d: Array, mu: float) -> ConeFits:
    """Forces in friction cones that make |d - A w| least, of n problems, by the proximal point algorithm.

    Columns of zeros are of points that are not there. Of many such forces they are near those of least norm.

    Args:
        A: Shape (n, m, k, 3), entries around one.
        d: Shape (n, m).
        mu: Coulomb's coefficient of all points.
    """
    m = A.shape[1]
    return staged_fits(A, d, mu, [Stage(sigma, np.ones(m), np.zeros(m)) for sigma in _SIGMAS], proximal=True)


def staged_fits(A: Array, d: Array, mu: float, stages: Sequence[Stage], *, exact: int = 0, proximal: bool = False) -> ConeFits:
    """Answers of the last of some stages, of n problems; other arguments as `nearest_in_cones`.

    From a cold start Newton's method needs many steps where weights differ by many decades; stages that part them by and by
    need a few each.

    Args:
        A: Shape (n, m, k, 3).
        d: Shape (n, m).
        mu: Coulomb's coefficient of all points.
        stages: The problems.
        exact: The first rows are met to rounding: the last stage is solved again with what they missed added to d, as in the
            method of multipliers.
        proximal: What is kept small is |w - w0|, with w0 of the stage before; problems that no longer change are done.
    """
    n, m, k, _ = A.shape
    flat, aim, at = A.reshape(n, m, 3 * k), d.copy(), np.arange(n)
    near = flat  # those of the problems that are not done
    w, r, steps, gradient = np.zeros((n, k, 3)), np.zeros((n, m)), np.zeros(n, int), np.zeros(n)
    rounds = len(stages) + (_REPEATED if exact else 0)
    for number in range(rounds if A.size else 0):
        stage = stages[min(number, len(stages) - 1)]
        if number >= len(stages):
            aim[:, :exact] += _left(flat, d, w)[:, :exact]
        w0 = w[at] if proximal else np.zeros_like(w)
        found, gradient[at], more = _newton(near, aim[at], w0, r[at], mu, _Rows(stage.weight, stage.steep), stage.sigma)
        steps[at] += more
        moved = np.abs(found - r[at]).max(axis=1, initial=0.0)
        r[at] = found
        w[at] = project_cones(w0 + stage.sigma * _pull(near, found).reshape(w0.shape), mu)
        if proximal:
            going = moved > EXACT + _SETTLED * np.abs(found).max(axis=1, initial=0.0)
            at, near = at[going], near if going.all() else near[going]
        if not len(at):
            break
    return ConeFits(w, _left(flat, d, w), gradient, steps)


def _left(flat: Array, d: Array, w: Array) -> Array:
    return d - np.matmul(flat, w.reshape(*flat.shape[::2], 1))[..., 0]


@dataclass(frozen=True, eq=False)
class _Rows:
    """The conjugates phi*_j of the rows' costs."""

    weight: Array
    steep: Array

    def value(self, r: Array) -> Array:
        """Sum of phi*_j(r_j), shape (n,)."""
        size = np.abs(r)
        over = size - self.weight
        beyond = 0.5 * self.weight + over + 0.5 * over**2 / (self.weight + self.steep)
        return np.asarray(np.where((self.steep > 0.0) & (over > 0.0), beyond, 0.5 * size**2 / self.weight).sum(axis=1))

    def slope(self, r: Array) -> tuple[Array, Array]:
        """(phi*', phi*''), each of shape (n, m)."""
        beyond = (self.steep > 0.0) & (np.abs(r) > self.weight)
        steep = 1.0 / (self.weight + self.steep)
        u = np.where(beyond, np.sign(r) * (1.0 + (np.abs(r) - self.weight) * steep), r / self.weight)
        return u, np.where(beyond, steep, 1.0 / self.weight)


def _pull(A: Array, r: Array) -> Array:
    return np.matmul(r[:, None], A)[:, 0]


def _newton(A: Array, d: Array, w0: Array, r: Array, mu: float, rows: _Rows, sigma: float) -> tuple[Array, Array, Array]:
    """(r, largest entry of the gradient, steps) at the least of phi*(r) - d r + |P(w0 + sigma A^T r)|^2 / (2 sigma)."""
    n, m, _ = A.shape
    k = w0.shape[1]
    r = r.copy()
    gradient, steps, at = np.full(n, np.inf), np.zeros(n, int), np.arange(n)
    size = np.maximum(1.0, np.abs(d).max(axis=1, initial=0.0))
    x = w0 + sigma * _pull(A, r).reshape(n, k, 3) + _INSIDE
    value, push = _dual(x, r, d, mu, rows, sigma)
    for _ in range(STEPS):
        u, curve = rows.slope(r[at])
        g = u - d[at] + np.matmul(A, push[at][..., None])[..., 0]
        gradient[at] = np.abs(g).max(axis=1, initial=0.0)
        open_ = gradient[at] > EXACT * size[at] + _ROUNDING * sigma * np.abs(r[at]).max(axis=1, initial=0.0)
        if not open_.all():
            at, A, g, curve = at[open_], A[open_], g[open_], curve[open_]
        if not len(at):
            break
        V = sigma * projection(np.moveaxis(x[at], -1, 0), mu).slopes(mu)
        bent = np.empty((len(at), m, k, 3))
        np.matmul(A.reshape(bent.shape).swapaxes(1, 2), V, out=bent.swapaxes(1, 2))
        H = np.matmul(bent.reshape(A.shape), A.swapaxes(1, 2))
        H[:, np.arange(m), np.arange(m)] += curve
        step = -np.linalg.solve(H, g[..., None])[..., 0]
        steps[at] += 1
        moved = _line_search(x, value, push, r, at, step, g, A, d, mu, rows, sigma)
        if not moved.all():
            at, A = at[moved], A[moved]
    return r, gradient, steps


def _line_search(
    x: Array, value: Array, push: Array, r: Array, at: Array, step: Array, g: Array, A: Array, d: Array, mu: float, rows: _Rows,
    sigma: float,
) -> Array:  # fmt: skip
    """Move r, x and what `_dual` says of them by steps that lessen it, halved where a whole one does not; which of them did."""
    fall = (g * step).sum(axis=1)
    along = sigma * _pull(A, step).reshape(len(at), -1, 3)
    length, todo, moved = 1.0, np.arange(len(at)), np.zeros(len(at), bool)
    for _ in range(_HALVINGS):
        i = at[todo]
        tried, there = r[i] + length * step[todo], x[i] + length * along[todo]
        found, pushed = _dual(there, tried, d[i], mu, rows, sigma)
        rounding = 1e-14 * np.maximum(1.0, np.abs(value[i]))
        good = found <= value[i] + _ARMIJO * length * fall[todo] + rounding
        done = i[good]
        r[done], x[done], value[done], push[done] = tried[good], there[good], found[good], pushed[good]
        moved[todo[good]] = True
        todo = todo[~good]
        if not len(todo):
            break
        length *= 0.5
    return moved


def _dual(x: Array, r: Array, d: Array, mu: float, rows: _Rows, sigma: float) -> tuple[Array, Array]:
    """(the dual's value, the forces P(x)), shapes (n,) and (n, 3 k)."""
    push = project_cones(x, mu).reshape(len(x), -1)
    return rows.value(r) - (d * r).sum(axis=1) + (push**2).sum(axis=1) / (2.0 * sigma), push
