"""The certificate of an answer: every equation of the law, recomputed in physical units and scaled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, add_wrench, largest, lazy
from rbd.parts import bounded_weights
from rbd.problem import GaussProblem

SOLVED = 1e-9
"""Scaled residuals up to this are `solved`."""
USABLE = 1e-7
"""Scaled residuals up to this are `inaccurate`; above, there is no answer."""

_UNITS = {"stationarity": "N", "feasibility": "m/s2", "cone": "N", "complementarity": "N m/s2", "centroidal": "N"}


class Residual(float):
    """A residual in physical units that also tells `scaled`, its size against the terms that make it up."""

    scaled: float

    def __new__(cls, value: float, scale: float) -> Residual:
        """The value, and the value over the scale."""
        self = super().__new__(cls, value)
        self.scaled = float(value) / scale
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return Residual, (float(self), float(self) / self.scaled if self.scaled else 1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Residuals:
    """How far an answer is from the equations of its law; largest entries, zero for an exact answer.

    Each is a float in physical units with an attribute `scaled`.

    Attributes:
        values: The five below in order, in physical units; the last is None where it does not apply.
        scales: What they are measured against; computed when first asked for.
    """

    values: tuple[float, float, float, float, float | None]
    scales: Scales

    @property
    def stationarity(self) -> Residual:
        """|M a - rhs - J^T f| [N, N m]; over max(1, |M||a|, |rhs|, |f|)."""
        return self._residual(0)

    @property
    def feasibility(self) -> Residual:
        """Distance of c~ to K* [m/s2, rad/s2]; over max(1, |J||a| + |bias|).

        c~ = J a + offset, for Coulomb's law plus mu |c_t| along the normal of each point. Of pyramids, along their rays as
        given; of true cones, point by point.
        """
        return self._residual(1)

    @property
    def cone(self) -> Residual:
        """Distance of f to K [N, N m]; over the scale of stationarity."""
        return self._residual(2)

    @property
    def complementarity(self) -> Residual:
        """|weight x acceleration|, the worst of the rays or points [N m/s2]; over the product of the two scales."""
        return self._residual(3)

    @property
    def centroidal(self) -> Residual | None:
        """Contact wrenches plus weight plus external forces, less the rate of centroidal momentum [N, N m].

        About the centre of mass; over max(1, its largest term). It uses no contact Jacobian where the constraints have
        resultants, so it catches a wrong J. None where there is no floating base: the base's reaction is unknown.
        """
        return None if self.values[4] is None else self._residual(4)

    @property
    def scaled(self) -> dict[str, float]:
        """{equation: scaled residual}, centroidal left out where there is none."""
        return {name: r.scaled for name, r in self._given()}

    @property
    def worst(self) -> float:
        """The largest scaled residual; NaN if any is."""
        found = list(self.scaled.values())
        return math.nan if any(x != x for x in found) else max(found)

    def within(self, tolerance: float) -> bool:
        """Whether every scaled residual is at most `tolerance`; False if any is NaN."""
        # Scales are at least 1: a small value passes without its scale. NaN fails both comparisons.
        return all([x is None or x <= tolerance or x / self._scale(i) <= tolerance for i, x in enumerate(self.values)])

    def _scale(self, i: int) -> float:
        s = self.scales
        if i == 3:
            return s.of_force * s.of_rows
        return s.of_rows if i == 1 else s.of_momentum if i == 4 else s.of_force

    def _residual(self, i: int) -> Residual:
        value = self.values[i]
        return Residual(math.nan if value is None else value, self._scale(i))

    def _given(self) -> list[tuple[str, Residual]]:
        every = ((name, getattr(self, name)) for name in _UNITS)
        return [(name, r) for name, r in every if r is not None]

    def __repr__(self) -> str:
        return f"Residuals({self})"

    def __str__(self) -> str:
        return ", ".join(f"{name} {float(r):.1e} {_UNITS[name]}" for name, r in self._given())


def residuals(problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: str = "convex") -> Residuals:
    """The certificate of acceleration a and row forces f under a law.

    Args:
        problem: What is answered.
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,).
        weights: Of `problem.rays` where the law speaks of facets, else of `problem.parts`; where None and rows can
            break, the best that can be found.
        law: "bilateral", "convex", "convex, 4 facets" or "coulomb".
    """
    P, scales = problem, Scales(problem, a, f)
    if not math.isfinite(np.vdot(a, a) + np.vdot(f, f)):
        return Residuals((math.nan,) * 5, scales)
    stationarity, centroidal = largest(P.M @ a - P.rhs - P.J.T @ f), _centroidal(P, a, f)
    if P.bilateral:
        return Residuals((stationarity, largest(P.J @ a + P.offset), 0.0, 0.0, centroidal), scales)
    terms = _terms(P, a, f, weights, law)
    gap, off_cone, slack = largest(terms.gap), largest(terms.off_cone), largest(terms.slack)
    return Residuals((stationarity, gap, off_cone, slack, centroidal), scales)


class Scales:
    """Sizes of the terms of the equations, in their units; at least 1."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array) -> None:
        self._given = problem, a, f

    @lazy
    def of_force(self) -> float:
        """max(1, |M||a|, |rhs|, |f|)."""
        P, a, f = self._given
        return max(1.0, largest(np.abs(P.M) @ np.abs(a)), largest(P.rhs), largest(f))

    @lazy
    def of_rows(self) -> float:
        """max(1, |J||a| + |bias|)."""
        P, a, _ = self._given
        return max(1.0, largest(np.abs(P.J) @ np.abs(a) + np.abs(P.offset)))

    @lazy
    def of_momentum(self) -> float:
        """max(1, rate of momentum, weight and external wrench, |f|)."""
        P, a, f = self._given
        if P.balance is None:
            return 1.0
        return max(1.0, largest(P.balance.A_g @ a + P.balance.rate_bias), largest(P.balance.wrench), largest(f))


@dataclass(frozen=True, eq=False)
class _Terms:
    """Row accelerations against row forces: `gap` and `slack` by column of the sets, `off_cone` by row."""

    gap: Array
    slack: Array
    off_cone: Array
    slices: Sequence[slice]


def _terms(P: GaussProblem, a: Array, f: Array, weights: Array | None, law: str) -> _Terms:
    c = P.J @ a + P.offset
    if P.bilateral:
        return _Terms(c, np.zeros(len(c)), np.zeros(len(c)), list(P.slices.values()))
    return _of_rays(P, c, f, weights) if "facets" in law else _of_parts(P, c, f, weights, coulomb=law == "coulomb")


def _of_rays(P: GaussProblem, c: Array, f: Array, weights: Array | None) -> _Terms:
    R = P.rays
    if weights is None:  # any weights within the bounds that make the force as nearly as can be
        weights = bounded_weights(R.G, f, R.lower, R.upper)
    w = np.minimum(np.maximum(weights, R.lower), R.upper)
    along = R.G.T @ c
    opens, closes = np.maximum(along, 0.0), np.maximum(-along, 0.0)
    # A line must keep still; a ray may open; a weight between two bounds is a matter of complementarity alone.
    gap = np.where(R.below, 0.0, opens) + np.where(R.above, 0.0, closes)
    slack = (w - R.finite_lower) * R.below * opens + (R.finite_upper - w) * R.above * closes
    return _Terms(gap, slack, f - R.G @ w, P.ray_slices)


def _of_parts(P: GaussProblem, c: Array, f: Array, weights: Array | None, *, coulomb: bool) -> _Terms:
    T = P.parts
    w = T.project(T.weights_of(f) if weights is None else weights)
    y = T.accelerations(c, coulomb=coulomb)
    return _Terms(T.gap(y), T.slack(w, y), f - T.G @ w, T.slices)


def blame(problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: str = "convex") -> str:
    """The constraint that misses its equations most, and by how much, in words."""
    if not problem.m:
        return "no constraint"
    terms = _terms(problem, a, f, weights, law)
    found = [(-1.0, "")]
    for rows, columns in zip(problem.rows, terms.slices, strict=True):
        gap, slack = largest(terms.gap[columns]), largest(terms.slack[columns])
        off = largest(terms.off_cone[problem.slices[rows.name]])
        found.append((gap, f"{rows.name} cannot hold: residual {gap:.2g} m/s2"))
        found.append((off, f"{rows.name} leaves its cone: by {off:.2g} N"))
        found.append((slack, f"{rows.name} pushes while it opens: by {slack:.2g} N m/s2"))
    return max(found)[1]


def _centroidal(P: GaussProblem, a: Array, f: Array) -> float | None:
    b = P.balance
    if b is None:
        return None
    rate = (b.A_g @ a + b.rate_bias).tolist()
    total, com = b.wrench.tolist(), b.com.tolist()
    at = 0
    for rows in P.rows:
        part = f[at : at + len(rows)]
        at += len(rows)
        if rows.patch is not None and rows.patch.against is not None:
            continue  # between two bodies: nothing from outside, by action and reaction
        if rows.resultant is not None and rows.patch is not None:
            add_wrench(total, (rows.resultant @ part).tolist(), rows.patch.point.tolist(), com)
        elif b.base is not None:
            point, axes = b.base
            force = rows.J[:, :6].T @ part
            add_wrench(total, [*(axes @ force[:3]).tolist(), *(axes @ force[3:]).tolist()], point.tolist(), com)
    return max([abs(x - y) for x, y in zip(rate, total, strict=True)])
