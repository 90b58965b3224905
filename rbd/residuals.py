"""The certificate of an answer: every equation of the law, recomputed in physical units and scaled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from rbd.arrays import Array, add_wrench, is_finite, largest, lazy
from rbd.problem import GaussProblem

SOLVED = 1e-9
"""Scaled residuals up to this are `solved`."""
USABLE = 1e-7
"""Scaled residuals up to this are `inaccurate`; above, there is no answer."""

_NONE = np.zeros(0)
_EQUATIONS = ("stationarity", "feasibility", "cone", "complementarity", "centroidal")
_UNITS = {"stationarity": "N", "feasibility": "m/s2", "cone": "N", "complementarity": "N m/s2", "centroidal": "N"}


class Residual(float):
    """A residual in physical units that also tells `scaled`, its size against the terms that make it up."""

    _scale: Callable[[], float]

    def __new__(cls, value: float, scale: Callable[[], float]) -> Residual:
        """The value, and how to find the scale (at least 1) if anyone asks."""
        self = super().__new__(cls, value)
        self._scale = scale
        return self

    @property
    def scaled(self) -> float:
        """The value over the size of its terms."""
        return float(self) / self._scale()

    def within(self, tolerance: float) -> bool:
        """Whether the scaled residual is at most `tolerance`; a scale is at least 1, and is looked up only if needed."""
        return float(self) <= tolerance or self.scaled <= tolerance

    def __reduce__(self) -> tuple[object, ...]:
        return _remade, (float(self), self._scale())


def _remade(value: float, scale: float) -> Residual:
    return Residual(value, lambda: scale)


@dataclass(frozen=True, eq=False)
class Residuals:
    """How far an answer is from the equations of its law; largest entries, zero for an exact answer.

    Attributes:
        stationarity: |M a - rhs - J^T f| [N, N m]; over max(1, |M||a|, |rhs|, |f|).
        feasibility: Distance of c = J a + offset to K* [m/s2, rad/s2], along its rays as they are given; over
            max(1, |J||a| + |bias|).
        cone: Distance of f to K [N, N m]; over the scale of stationarity.
        complementarity: |f . c|, the worst of the constraints [N m/s2]; over the product of the two scales.
        centroidal: Contact wrenches plus weight plus external forces, less the rate of centroidal momentum, about the
            centre of mass [N, N m]; over max(1, its largest term). It uses no contact Jacobian where the constraints
            have resultants, so it catches a wrong J. None where there is no floating base: the base's reaction is
            unknown.
    """

    stationarity: Residual
    feasibility: Residual
    cone: Residual
    complementarity: Residual
    centroidal: Residual | None

    @property
    def scaled(self) -> dict[str, float]:
        """{equation: scaled residual}, centroidal left out where there is none."""
        return {name: r.scaled for name, r in self._given()}

    @property
    def worst(self) -> float:
        """The largest scaled residual; NaN if any is."""
        found = [r.scaled for _, r in self._given()]
        return math.nan if any(x != x for x in found) else max(found)

    def within(self, tolerance: float) -> bool:
        """Whether every scaled residual is at most `tolerance`; False if any is NaN."""
        return all(r.within(tolerance) for _, r in self._given())

    def _given(self) -> list[tuple[str, Residual]]:
        every = ((name, getattr(self, name)) for name in _EQUATIONS)
        return [(name, r) for name, r in every if r is not None]

    def __str__(self) -> str:
        return ", ".join(f"{name} {float(r):.1e} {_UNITS[name]}" for name, r in self._given())


def residuals(problem: GaussProblem, a: Array, f: Array, weights: Array | None) -> Residuals:
    """The certificate of acceleration a and row forces f for the convex (or bilateral) law.

    Args:
        problem: What is answered.
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,).
        weights: Weights of `problem.rays`, shape (r,); where None and rows can break, the best that can be found.
    """
    P = problem
    if not (is_finite(a) and is_finite(f)):
        nan = _remade(math.nan, 1.0)
        return Residuals(nan, nan, nan, nan, nan)
    terms, scales = _Terms(P, a, f, weights), _Scales(P, a, f)
    return Residuals(
        stationarity=Residual(largest(P.M @ a - P.rhs - P.J.T @ f), scales.of_force),
        feasibility=Residual(largest(terms.gap), scales.of_rows),
        cone=Residual(largest(terms.off_cone), scales.of_force),
        complementarity=Residual(largest(terms.slack), lambda: scales.of_force() * scales.of_rows()),
        centroidal=_centroidal(P, a, f),
    )


class _Scales:
    """Sizes of the terms of the equations; at least 1, in their units."""

    def __init__(self, P: GaussProblem, a: Array, f: Array) -> None:
        self._given = P, a, f

    def of_force(self) -> float:
        """max(1, |M||a|, |rhs|, |f|)."""
        return self._force

    def of_rows(self) -> float:
        """max(1, |J||a| + |bias|)."""
        return self._rows

    @lazy
    def _force(self) -> float:
        P, a, f = self._given
        return max(1.0, largest(np.abs(P.M) @ np.abs(a)), largest(P.rhs), largest(f))

    @lazy
    def _rows(self) -> float:
        P, a, _ = self._given
        return max(1.0, largest(np.abs(P.J) @ np.abs(a) + np.abs(P.offset)))


class _Terms:
    """Row accelerations against row forces: `gap` and `slack` by ray (by row where all rows hold), `off_cone` by row."""

    def __init__(self, P: GaussProblem, a: Array, f: Array, weights: Array | None) -> None:
        c = P.J @ a + P.offset
        self.by_ray = not P.bilateral
        if not self.by_ray:
            self.gap, self.off_cone, self.slack = c, _NONE, _NONE
            return
        R = P.rays
        if weights is None:  # any weights within the bounds that make the force as nearly as can be
            weights = lsq_linear(R.G, f, (R.lower, R.upper), tol=1e-14).x
        w = np.minimum(np.maximum(weights, R.lower), R.upper)
        along = R.G.T @ c
        opens, closes = np.maximum(along, 0.0), np.maximum(-along, 0.0)
        below, above = np.isfinite(R.lower), np.isfinite(R.upper)
        # A line must keep still; a ray may open; a weight between two bounds is a matter of complementarity alone.
        self.gap = np.where(below, 0.0, opens) + np.where(above, 0.0, closes)
        self.slack = np.where(below, w - np.where(below, R.lower, 0.0), 0.0) * opens
        self.slack += np.where(above, np.where(above, R.upper, 0.0) - w, 0.0) * closes
        self.off_cone = f - R.G @ w


def blame(problem: GaussProblem, a: Array, f: Array, weights: Array | None) -> str:
    """The constraint that misses its equations most, and by how much, in words."""
    if not problem.m:
        return "no constraint"
    terms = _Terms(problem, a, f, weights)
    found = [(-1.0, "")]
    for i, rows in enumerate(problem.rows):
        part, ray = problem.slices[rows.name], problem.ray_slices[i]
        gap = largest(terms.gap[ray if terms.by_ray else part])
        off = largest(terms.off_cone[part]) if terms.by_ray else 0.0
        slack = largest(terms.slack[ray]) if terms.by_ray else 0.0
        found.append((gap, f"{rows.name} cannot hold: residual {gap:.2g} m/s2"))
        found.append((off, f"{rows.name} leaves its cone: by {off:.2g} N"))
        found.append((slack, f"{rows.name} pushes while it opens: by {slack:.2g} N m/s2"))
    return max(found)[1]


def _centroidal(P: GaussProblem, a: Array, f: Array) -> Residual | None:
    b = P.balance
    if b is None:
        return None
    rate = (b.A_g @ a + b.rate_bias).tolist()
    total, com = b.wrench.tolist(), b.com.tolist()
    for rows in P.rows:
        part = f[P.slices[rows.name]]
        if rows.resultant is not None and rows.patch is not None:
            add_wrench(total, (rows.resultant @ part).tolist(), rows.patch.point.tolist(), com)
        else:
            base = rows.J[:, :6].T @ part
            wrench = [*(b.base_axes @ base[:3]).tolist(), *(b.base_axes @ base[3:]).tolist()]
            add_wrench(total, wrench, b.base_point.tolist(), com)
    return Residual(
        max(abs(x - y) for x, y in zip(rate, total, strict=True)),
        lambda: max(1.0, max(map(abs, rate)), largest(b.wrench), largest(f)),
    )
