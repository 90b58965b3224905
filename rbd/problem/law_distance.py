"""How far the forces and accelerations of points are from complementary: each point by its own distance to the law.

A product of force and acceleration is small where both are middling: 1e-5 of a force at 1e-4 of an acceleration. The distance
here is what one of them must change by, over its own scale (`rbd.problem.residuals`): the change that the law's natural map
makes,

    |w - P(w - r y)| / push,    r = push / along,

with P the projection on the point's set: w where the point opens, r y where it keeps still, and in between what is nearer. It
vanishes exactly where w and y obey the law. Of a bound it is min(room / push, |y| / along); under Coulomb's law P is that of
`rbd.solvers.newton`, with an r of tangents and one of the normal; under the convex law the nearest force in the cone or
pyramid, with one r, of the largest `along`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.cones import project_cones, pyramid
from rbd.problem.force_set import ForceSet

STILLEST = math.sqrt(3.0)
"""The distance of a bound, or a circular cone, is at most this times the largest entry of its acceleration, over its scale."""
_STILL = 1e-10
_ROUNDING = 1e-14
_TINY = 1e-300
_MANY = 32
"""Facets above which pyramids have no cheap bound."""
_FEW = 10.0
"""What the distance of a pyramid may be, over the accelerations of the rays that push: of rays beside them that just touch."""


@dataclass(frozen=True, eq=False)
class LawPoints:
    """The points with friction of a force set, k in all.

    Attributes:
        elements: Their numbers among the set's elements, shape (k,).
        at: The column that each is judged at, shape (k,): the normal of a circular cone, the first ray of a pyramid.
        mu: Friction coefficients, shape (k,).
        facets: Of the pyramids, shape (k,); 0 for circular cones.
        alone: Which columns belong to no point, shape (p,).
    """

    elements: Array
    at: Array
    mu: Array
    facets: Array
    alone: Array

    def forces(self, T: ForceSet, w: Array) -> Array:
        """Forces (tangent, tangent, normal) of weights, shape (k, 3)."""
        if not self.pyramids:
            return np.asarray(w[T.cone_columns])
        return np.asarray(np.add.reduceat(w[:, None] * T.push, T.starts, axis=0)[self.elements])

    @lazy
    def pyramids(self) -> bool:
        """Whether pyramids stand for the cones."""
        return bool(self.facets.any())

    @lazy
    def spread(self) -> float:
        """Least acceleration of rays that push, over the point's own, where the two belong together; 0 where unknown."""
        pairs = {(mu, n) for mu, n in zip(self.mu.tolist(), self.facets.tolist(), strict=True)}
        return min((_spread(mu, n) for mu, n in pairs), default=1.0)

    @np.errstate(all="ignore")  # of numbers near the largest that there are: what is NaN then is no answer
    def distances(self, p: Array, y: Array, along: Array, push: Array, *, coulomb: bool) -> Array:
        """Distances to the law, over their own scales, shape (k,).

        Args:
            p: Forces in their sets, shape (k, 3).
            y: Accelerations, shape (k, 3).
            along: What accelerations are measured against, shape (k, 3).
            push: What forces are, shape (k,); here it is |p| at least.
            coulomb: Coulomb's law; else the convex one.
        """
        push = np.maximum(push, np.sqrt(np.einsum("ij,ij->i", p, p)))
        if coulomb:
            nearest = project_cones(p - (push[:, None] / along) * y, self.mu, coulomb=True)
        else:
            nearest = self._nearest(p - (push / along.max(axis=1))[:, None] * y)
        return np.asarray(np.abs(p - nearest).max(axis=1) / push)

    def _nearest(self, moved: Array) -> Array:
        if not self.pyramids:
            return project_cones(moved, self.mu)
        out = moved.copy()
        for facets in np.unique(self.facets):
            some = np.flatnonzero(self.facets == facets)
            out[some] = nearest_in_pyramids(moved[some], self.mu[some], int(facets))
        return out


@lru_cache(maxsize=256)  # sets at rest are kept by their rows; those of moving rows come and go
def points_of(T: ForceSet) -> LawPoints:
    """The points with friction of a set."""
    some = [i for i, e in enumerate(T.elements) if e.facets or e.is_cone]
    of = [T.elements[i] for i in some]
    alone = np.ones(T.size, bool)
    for e in of:
        alone[e.columns] = False
    at = [e.columns.start + (0 if e.facets else 2) for e in of]
    mu, facets = np.array([e.mu for e in of], float), np.array([e.facets for e in of], int)
    return LawPoints(np.array(some, int), np.array(at, int), mu, facets, alone)


def bound_distances(T: ForceSet, w: Array, y: Array, along: Array, push: Array) -> Array:
    """Distances of columns with bounds of their own to their law, over their scales, shape (p,); zero of lines.

    Args:
        T: The set.
        w: Weights within their bounds, shape (p,).
        y: Their accelerations, shape (p,).
        along: What accelerations are measured against, shape (p,).
        push: What weights are, shape (p,).
    """
    low = np.minimum((w - T.finite_lower) * T.below / push, np.maximum(y, 0.0) / along)
    high = np.minimum((T.finite_upper - w) * T.above / push, np.maximum(-y, 0.0) / along)
    return np.asarray(np.maximum(low, high))


@np.errstate(all="ignore")
def largest_distance(T: ForceSet, w: Array, y: Array, slack: Array, *, coulomb: bool) -> float:
    """What the distances are at most, cheap: without the scales of single points.

    Args:
        T: The set.
        w: Weights in it, shape (p,).
        y: Their accelerations, shape (p,).
        slack: Weight x acceleration, shape (p,).
        coulomb: Coulomb's law; else the convex one.
    """
    points = points_of(T)
    if points.pyramids or not len(points.mu):
        out = np.abs(y[slack > 0.0]).max(initial=0.0) / T.reach
        if not points.pyramids:
            return float(out)
        return float(_FEW * out / points.spread) if points.spread > 0.0 else math.inf
    out = 0.0 if T.only_cones else np.abs(y[(slack > 0.0) & points.alone]).max(initial=0.0)
    p, moves = w[T.cone_columns], y[T.cone_columns]
    size = np.sqrt(np.einsum("ij,ij->i", p, p))
    loaded = ~(size == 0.0)
    still = STILLEST * (np.abs(moves).max(axis=1) * loaded).max()
    if still > _STILL * T.reach:
        # The change of the natural map grows with r, and r is at most this.
        moved = p - (np.maximum(size, 1.0) / T.reach)[:, None] * moves
        missed = np.abs(p - project_cones(moved, points.mu, coulomb=coulomb))
        all_of = missed.sum(axis=1) + 2.0 * points.mu * missed[:, 2] * coulomb
        still = np.minimum(still, T.reach * (all_of[loaded] / size[loaded]).max(initial=0.0))
    return float(np.maximum(out, still) / T.reach)  # NaN is the larger


@lru_cache(maxsize=256)
def _spread(mu: float, facets: int) -> float:
    """Least singular value of one, two or three rays of a pyramid, 1 at most."""
    if not facets:
        return 1.0
    if facets > _MANY:
        return 0.0
    rays = pyramid(mu, facets)  # alike whichever of them is the first
    chosen = [[0, i] for i in range(1, facets)] + [[0, *pair] for pair in combinations(range(1, facets), 2)]
    return min(1.0, *(float(np.linalg.svd(rays[:, some], compute_uv=False)[-1]) for some in chosen))


@lru_cache(maxsize=256)
def _facets(mu: bytes, facets: int) -> tuple[Array, Array]:
    """(unit rays, unit normals outwards) of pyramids, shapes (k, facets, 3); ray i stands between facets i and i + 1."""
    of = np.frombuffer(mu)
    turn = 2.0 * math.pi * np.arange(facets) / facets
    normals = np.empty((len(of), facets, 3))
    normals[:, :, 0], normals[:, :, 1], normals[:, :, 2] = np.cos(turn), np.sin(turn), -of[:, None]
    rays = np.array([pyramid(one, facets).T for one in of.tolist()])
    return rays / np.linalg.norm(rays, axis=2)[:, :, None], normals / np.sqrt(1.0 + of * of)[:, None, None]


def nearest_in_pyramids(moved: Array, mu: Array, facets: int) -> Array:
    """The nearest forces in the circumscribed pyramids, shape (k, 3): inside, on a facet, on a ray, or zero.

    Args:
        moved: Forces (tangent, tangent, normal), shape (k, 3).
        mu: Friction coefficients, shape (k,).
        facets: Of each pyramid; the first stands across the first tangent.
    """
    rays, normals = _facets(mu.tobytes(), facets)
    length = np.maximum(np.einsum("kfi,ki->kf", rays, moved), 0.0)
    beyond = np.einsum("kfi,ki->kf", normals, moved)
    on_facets = moved[:, None] - beyond[..., None] * normals
    slips = [np.einsum("kfi,kfi->kf", np.roll(normals, side, axis=1), on_facets) for side in (1, -1)]
    size = np.sqrt(np.einsum("ki,ki->k", moved, moved))[:, None]
    fits = (beyond > 0.0) & (np.maximum(*slips) <= _ROUNDING * size)
    choices = np.concatenate([length[..., None] * rays, on_facets], axis=1)
    to_rays = np.linalg.norm(moved[:, None] - choices[:, :facets], axis=2)
    far = np.concatenate([to_rays, np.where(fits, beyond, math.inf)], axis=1)
    out = choices[np.arange(len(mu)), far.argmin(axis=1)]
    inside = (beyond <= 0.0).all(axis=1)
    out[inside] = moved[inside]
    return np.asarray(out)
