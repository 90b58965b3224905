"""Cones by their rays: every second-order cone replaced by a pyramid, every set as weights on columns.

The n-facet pyramid *circumscribes* the friction cone, its first facet across the contact's x axis (n = 4 reads
|fx|, |fy| <= mu fz): rays at (2k + 1) pi / n with tangential radius mu / cos(pi / n). The *inscribed* one has radius mu.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.cones import Cone, Interval, Line, Part, Product, SecondOrderCone, pyramid


@dataclass(frozen=True, eq=False)
class Rays:
    """A polyhedral set as weights on columns: {G w : lower <= w <= upper}.

    Attributes:
        G: Columns, shape (dim, r).
        lower: Lower bounds of the weights, shape (r,): -inf for a line, 0 for a ray.
        upper: Upper bounds of the weights, shape (r,).
        starts: First columns of the points, shape (k,): a pyramid's rays are of one point, any other column is of its own.
        facets: Facets of the pyramids that stand for second-order cones; empty where there are none.
    """

    G: Array
    lower: Array
    upper: Array
    starts: Array
    facets: frozenset[int] = field(default=frozenset())

    @lazy
    def widths(self) -> Array:
        """Numbers of columns of the points, shape (k,)."""
        return np.diff(self.starts, append=self.G.shape[1])

    @lazy
    def normals(self) -> Array:
        """Columns of the points' normals, shape (dim, k): the mean of a pyramid's rays, any other column itself."""
        return self.mean(self.G)

    @lazy
    def reach(self) -> tuple[float, float]:
        """(smallest sum of a column's absolute entries, 1 at most; largest of a normal's, at least 1)."""
        return column_reach(self.G, self.normals)

    def mean(self, columns: Array) -> Array:
        """The mean over each point's columns, shape (..., k), of an array of shape (..., r)."""
        if not len(self.starts):
            return columns
        return np.asarray(np.add.reduceat(columns, self.starts, axis=-1) / self.widths)

    @lazy
    def all_lines(self) -> bool:
        """Whether every weight is free."""
        return bool(self.is_line.all())

    @lazy
    def has_lines(self) -> bool:
        """Whether some weight is free."""
        return bool(self.is_line.any())

    @lazy
    def has_intervals(self) -> bool:
        """Whether some weight has a finite bound other than zero from below."""
        return bool((self.above | (self.below & (self.lower != 0.0))).any())

    @lazy
    def below(self) -> Array:
        """Which weights have a lower bound, shape (r,)."""
        return np.isfinite(self.lower)

    @lazy
    def above(self) -> Array:
        """Which weights have an upper bound, shape (r,)."""
        return np.isfinite(self.upper)

    @lazy
    def finite_lower(self) -> Array:
        """Lower bounds, zero where there is none, shape (r,)."""
        return np.where(self.below, self.lower, 0.0)

    @lazy
    def finite_upper(self) -> Array:
        """Upper bounds, zero where there is none, shape (r,)."""
        return np.where(self.above, self.upper, 0.0)

    @lazy
    def bound_size(self) -> Array:
        """Sum of the finite bounds' absolute values, shape (r,)."""
        return np.abs(self.finite_lower) + np.abs(self.finite_upper)

    @lazy
    def is_line(self) -> Array:
        """Which weights are free, shape (r,)."""
        return ~self.below & ~self.above


def column_reach(H: Array, normals: Array) -> tuple[float, float]:
    """(smallest sum of absolute entries of a column of H, 1 at most; largest of a normal's, at least 1)."""
    return float(np.abs(H).sum(axis=0).min(initial=1.0)), float(np.abs(normals).sum(axis=0).max(initial=1.0))


@lru_cache(maxsize=512)
def stacked_rays(cones: tuple[Cone, ...]) -> Rays:
    """The rays of several sets side by side, G block-diagonal; kept, as a robot's contacts keep their cones."""
    return rays_of(Product(cones)) if cones else Rays(np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0, int))


@lru_cache(maxsize=512)  # contacts keep one cone for life: computed once a contact
def rays_of(cone: Cone, *, inscribed: bool = False) -> Rays:
    """The set with every second-order cone replaced by its pyramid, as weights on columns.

    Args:
        cone: Any set; hashable, as frozen dataclasses are.
        inscribed: Take the pyramid inside the cone (tangential radius mu) in place of the one around it
            (mu / cos(pi / n)).
    """
    G, parts = cone.generators()
    columns, facets, at = [], set(), 0
    lower: list[float] = []
    upper: list[float] = []
    starts: list[int] = []
    for part in parts:
        block = G[:, at : at + part.dim]
        at += part.dim
        if isinstance(part, SecondOrderCone):
            block = block @ pyramid(part.mu, part.facets, inscribed=inscribed)
            facets.add(part.facets)
        r = block.shape[1]
        starts.append(len(lower))
        columns.append(block)
        low, high = _bounds(part)
        lower += [low] * r
        upper += [high] * r
    together = np.hstack(columns) if columns else np.zeros((cone.dim, 0))
    first = _locked(np.array(starts, int))
    return Rays(_locked(together), _locked(np.array(lower)), _locked(np.array(upper)), first, frozenset(facets))


def _locked(array: Array) -> Array:
    array.flags.writeable = False
    return array


def _bounds(part: Part) -> tuple[float, float]:
    if isinstance(part, Line):
        return -math.inf, math.inf
    if isinstance(part, Interval):
        return part.lo, part.hi
    return 0.0, math.inf
