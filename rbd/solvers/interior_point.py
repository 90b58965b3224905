"""A primal-dual interior-point method for the convex law with circular cones: slow and robust, used if faster methods fail.

    minimise 1/2 w^T D w + q^T w   over w in the product of the parts; its gradient y = D w + q is the acceleration

Every part is s = E w - b in C, half-lines and second-order cones, which are self-dual; z in C is their
acceleration, D w + q = E^T z. Mehrotra's predictor and corrector in Nesterov and Todd's scaling.

Source: [Vandenberghe2010], sections 4 and 5; the scaling of second-order cones is section 4.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from rbd.arrays import Array
from rbd.solvers.newton import Scaled


@dataclass(frozen=True, eq=False)
class _Sides:
    """S = E w - b: `half` rows of half-lines first, then (axis, tangent, tangent) of each cone."""

    E: Array
    b: Array
    half: int

    def split(self, s: Array) -> tuple[Array, Array]:
        """Half-lines (half,), cones (k, 3)."""
        return s[: self.half], s[self.half :].reshape(-1, 3)


@np.errstate(all="ignore")  # where there is no answer the iterates diverge, which ends the loop
def solve_interior_point(problem: Scaled, *, extra: Array | float = 0.0, iterations: int = 60) -> tuple[Array, int]:
    """(weights, iterations) of the convex law, in the problem's units and order; not checked here.

    Args:
        problem: With a symmetric D.
        extra: Added to the free accelerations, shape (p,): De Saxce's term, constant.
        iterations: Largest number.
    """
    D, q, sides = problem.D, problem.q + extra, _sides(problem)
    E, b, p = sides.E, sides.b, len(problem.q)
    fixed = np.flatnonzero(problem.lower == problem.upper)
    unit = _unit(sides)
    degree = sides.half + len(problem.order.mu)
    w, s, z = np.zeros(p), unit.copy(), unit.copy()
    w[fixed] = problem.lower[fixed]
    best, least, steps = w, math.inf, 0
    while steps < iterations:
        steps += 1
        off_dual, off_primal = D @ w + q - E.T @ z, E @ w - b - s
        off_dual[fixed] = 0.0
        gap = float(s @ z)
        size = 1.0 + float(np.abs(w).max(initial=0.0))
        error = max(float(np.abs(off_dual).max(initial=0.0)), float(np.abs(off_primal).max(initial=0.0)), gap) / size
        if error < least:
            best, least = w.copy(), error
        if error < 1e-13 or not error < 1e100 or size > 1e15:
            break
        scaling = _Scaling(sides, s, z)
        inverse_square = scaling.inverse_square
        K = _added(D, sides, inverse_square)
        K[fixed], K[:, fixed] = 0.0, 0.0
        K[fixed, fixed] = 1.0
        K.flat[: problem.order.singles * (p + 1) : p + 1] += 1e-12  # dependent lines have no barrier
        lam = scaling.times(z)

        factor, pivots, info = lapack.dgetrf(K)
        if info != 0:
            break

        def move(
            u: Array,
            factor: Array = factor,
            pivots: Array = pivots,
            right: Array = E.T @ (inverse_square @ off_primal) + off_dual,
            off: Array = off_primal,
            scaling: _Scaling = scaling,
            inverse_square: Array = inverse_square,
        ) -> tuple[Array, Array, Array]:
            back = scaling.over(u)
            right = E.T @ back - right
            right[fixed] = 0.0
            dw = lapack.dgetrs(factor, pivots, right)[0]
            ds = E @ dw + off
            return dw, ds, back - inverse_square @ ds

        _, ds, dz = move(-lam)
        reach = min(1.0, _reach(sides, s, ds), _reach(sides, z, dz))
        target = (1.0 - reach) ** 3 * gap / max(degree, 1)
        corner = _product(sides, scaling.over(ds), scaling.times(dz))
        dw, ds, dz = move(_divide(sides, lam, target * unit - corner) - lam)
        reach = min(1.0, 0.99 * _reach(sides, s, ds), 0.99 * _reach(sides, z, dz))
        w, s, z = w + reach * dw, s + reach * ds, z + reach * dz
    return best, steps


def _sides(problem: Scaled) -> _Sides:
    order, p = problem.order, len(problem.q)
    n, free = order.singles, problem.lower < problem.upper
    low = np.flatnonzero(free & np.isfinite(problem.lower))
    high = np.flatnonzero(free & np.isfinite(problem.upper))
    half = len(low) + len(high)
    E, b = np.zeros((half + p - n, p)), np.zeros(half + p - n)
    E[np.arange(len(low)), low], b[: len(low)] = 1.0, problem.lower[low]
    E[np.arange(len(low), half), high], b[len(low) : half] = -1.0, -problem.upper[high]
    first = half + 3 * np.arange(len(order.mu))
    column = n + 3 * np.arange(len(order.mu))
    E[first, column + 2] = 1.0  # the axis; tangents over mu make the cone self-dual
    E[first + 1, column] = E[first + 2, column + 1] = 1.0 / order.mu
    return _Sides(E, b, half)


def _added(D: Array, sides: _Sides, square: Array) -> Array:
    """D + E^T square E. Each row of E has one entry, and `square` is diagonal over half-lines: no product of matrices."""
    K, half = D.copy(), sides.half
    column = np.abs(sides.E).argmax(axis=1)
    entry = sides.E[np.arange(len(column)), column]
    np.add.at(K, (column[:half], column[:half]), entry[:half] ** 2 * square.diagonal()[:half])
    cones, of = column[half:], entry[half:]
    K[np.ix_(cones, cones)] += of[:, None] * square[half:, half:] * of
    return K


def _unit(sides: _Sides) -> Array:
    out = np.zeros(len(sides.b))
    out[: sides.half] = 1.0
    out[sides.half :: 3] = 1.0
    return out


def _product(sides: _Sides, x: Array, y: Array) -> Array:
    """Jordan's product of x and y."""
    out = x * y
    (_, X), (_, Y), (_, O) = sides.split(x), sides.split(y), sides.split(out)
    O[:, 0] = (X * Y).sum(axis=1)
    O[:, 1:] = X[:, :1] * Y[:, 1:] + Y[:, :1] * X[:, 1:]
    return out


def _divide(sides: _Sides, x: Array, y: Array) -> Array:
    """Jordan's quotient u: its product with x is y."""
    out = np.empty_like(y)
    (h, X), (g, Y), (o, O) = sides.split(x), sides.split(y), sides.split(out)
    o[:] = g / h
    det = X[:, 0] ** 2 - X[:, 1] ** 2 - X[:, 2] ** 2
    across = X[:, 1] * Y[:, 1] + X[:, 2] * Y[:, 2]
    O[:, 0] = (X[:, 0] * Y[:, 0] - across) / det
    O[:, 1:] = (Y[:, 1:] - O[:, :1] * X[:, 1:]) / X[:, :1]
    return out


def _reach(sides: _Sides, s: Array, d: Array) -> float:
    """Largest step of s along d inside the sets."""
    (h, S), (e, T) = sides.split(s), sides.split(d)
    falls = e < 0.0
    out = float((-h[falls] / e[falls]).min(initial=math.inf))
    if len(S):
        # Roots of (s + t d)^T J (s + t d): the first positive one is the boundary of the cone.
        a = T[:, 0] ** 2 - T[:, 1] ** 2 - T[:, 2] ** 2
        b = S[:, 0] * T[:, 0] - S[:, 1] * T[:, 1] - S[:, 2] * T[:, 2]
        c = np.maximum(_det(S), 0.0)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        ends = (b * b >= a * c) & ((a < 0.0) | (b < 0.0))
        out = min(out, float((c[ends] / np.maximum(root[ends] - b[ends], 1e-300)).min(initial=math.inf)))
    return out


def _det(S: Array) -> Array:
    t = np.hypot(S[:, 1], S[:, 2])
    return np.asarray((S[:, 0] - t) * (S[:, 0] + t))


class _Scaling:
    """W with W z = W^-1 s, both sides of the central path."""

    def __init__(self, sides: _Sides, s: Array, z: Array) -> None:
        self.sides = sides
        (h, S), (g, Z) = sides.split(s), sides.split(z)
        self.line = np.sqrt(h / g)
        ds, dz = np.maximum(_det(S), 1e-300), np.maximum(_det(Z), 1e-300)
        S, Z = S / np.sqrt(ds)[:, None], Z / np.sqrt(dz)[:, None]
        middle = np.sqrt(np.maximum(0.5 * (1.0 + (S * Z).sum(axis=1)), 1e-300))
        flipped = Z * [1.0, -1.0, -1.0]
        self.v = (S + flipped) / (2.0 * middle)[:, None]
        self.eta = (ds / dz) ** 0.25

    def _apply(self, x: Array, sign: float, size: Array, line: Array) -> Array:
        out = np.empty_like(x)
        (h, X), (o, O) = self.sides.split(x), self.sides.split(out)
        o[:] = line * h
        v0, v1 = self.v[:, 0], sign * self.v[:, 1:]
        along = (v1 * X[:, 1:]).sum(axis=1)
        O[:, 0] = size * (v0 * X[:, 0] + along)
        O[:, 1:] = size[:, None] * (X[:, 1:] + v1 * (X[:, 0] + along / (1.0 + v0))[:, None])
        return out

    def times(self, x: Array) -> Array:
        """W x."""
        return self._apply(x, 1.0, self.eta, self.line)

    def over(self, x: Array) -> Array:
        """W^-1 x."""
        return self._apply(x, -1.0, 1.0 / self.eta, 1.0 / self.line)

    @property
    def inverse_square(self) -> Array:
        """W^-2, block-diagonal."""
        half, k = self.sides.half, len(self.eta)
        out = np.zeros((half + 3 * k, half + 3 * k))
        out.flat[: half * (half + 3 * k) : half + 3 * k + 1] = 1.0 / self.line**2
        flipped = self.v * [1.0, -1.0, -1.0]
        blocks = (2.0 * flipped[:, :, None] * flipped[:, None, :] - np.diag([1.0, -1.0, -1.0])) / self.eta[:, None, None] ** 2
        for i in range(k):
            at = slice(half + 3 * i, half + 3 * i + 3)
            out[at, at] = blocks[i]
        return out
