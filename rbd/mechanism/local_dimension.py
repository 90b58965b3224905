"""Whether an admissible velocity extends to a finite motion: a numerical test at nearby configurations, not a proof.

The configurations that satisfy the constraints form a set V. At a regular point its dimension is n - rank J. Where the rank
of J drops there are velocities that J allows and no motion follows (a stretched string of bars), and velocities that begin
different motions (a flat parallelogram). So: small steps in all directions that J allows, each projected back onto the
constraints; from the points found, smaller steps, projected again. The number of independent directions among these is the
dimension of V there. A direction that extends to no motion is projected back to its start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.constraints.manifold import ConstraintManifold, Linearised, null_space

FAR, NEAR = 0.1, 0.02
"""Lengths of the first and of the second steps, without units (radians, or parts of the robot's length)."""

_MOVED = 0.1
"""A step has succeeded if this fraction of it remains after projection."""

_APART = 0.5
"""Sine of the angle above which two tangent spaces at distance `FAR` belong to two branches."""

_DIRECTIONS, _POINTS = 120, 24
"""Number of directions tried from a singular configuration, and of points examined in full."""

_KNOWN = 0.98
"""Cosine of the angle between a chord and the tangent of a curve found before from which it leads along that curve."""

ROUGH = 1e-5
"""Singular values count as zero at this fraction of the largest, at points found by Newton: where errors grow with the square
of the distance, an error of 1e-14 leaves the point 1e-7 away."""


@dataclass(frozen=True, eq=False)
class LocalBranch:
    """One branch of motion through a configuration.

    Attributes:
        dimension: Their degrees of freedom.
        point: A configuration on it nearby, shape (nq,).
        tangent: Velocities of the constraints there, without units, orthonormal, shape (nv, dimension).
        rank: Rank of J there.
    """

    dimension: int
    point: Array
    tangent: Array
    rank: int


@dataclass(frozen=True, eq=False)
class FiniteMotion:
    """The branches of motion found near a configuration.

    Attributes:
        dimension: The largest dimension of a branch; zero if nothing moves.
        branches: The branches found, largest first. Curves are distinguished by their tangents nearby, so
            that the two arms of a cusp are two and tangent curves are one; with more than one degree of freedom those of equal
            dimension are not distinguished.
        points: Configurations that were found and examined, this one first, shape (k, nq).
        tried: Number of directions tried from here.
        regular: Whether every velocity that J allows extends to a finite motion, so that there is one branch.
    """

    dimension: int
    branches: tuple[LocalBranch, ...]
    points: Array
    tried: int
    regular: bool


def finite_motion(held: ConstraintManifold, at: Linearised, seed: int) -> FiniteMotion:
    """The branches of motion that pass through an assembled configuration.

    Args:
        held: The constraints.
        at: The constraints at the configuration.
        seed: Of the directions.
    """
    rng = np.random.default_rng(seed)
    placed, loose = held.placed, ~held.placed
    N, _ = null_space(at.J, held.zero)
    rank = held.n - N.shape[1]
    here = LocalBranch(N.shape[1], at.q, N, rank)
    if rank == held.m or N.shape[1] == 0:  # by the implicit function theorem, or without rows
        return FiniteMotion(here.dimension, (here,) if here.dimension else (), at.q[None], 0, True)
    branches: list[LocalBranch] = []
    points: list[Linearised] = []
    tried = analysed = 0
    for near in _around(held, at, rng):
        tried += 1
        if near is None:
            continue
        points.append(near)
        chord = held.displacement(at.q, near.q)
        if any(b.dimension == 1 and abs(float(b.tangent[:, 0] @ chord)) > _KNOWN * np.linalg.norm(chord) for b in branches):
            continue
        analysed += 1
        point, tangent = _regular(held, near, rng) if placed.any() else (near, np.eye(held.n))
        if loose.any():
            tangent = tangent @ null_space(point.J[loose] @ tangent, held.zero)[0]
        found = LocalBranch(tangent.shape[1], point.q, tangent, _rank(held, point.J))
        if found.dimension and not any(_same(found, other) for other in branches):
            branches.append(found)
        if analysed == _POINTS or found.dimension == here.dimension:
            break
    branches.sort(key=lambda b: -b.dimension)
    looked = np.array([at.q, *[p.q for p in points]])
    dimension = branches[0].dimension if branches else 0
    if dimension == here.dimension:
        # V is in the smooth set of its independent rows, and fills it. Tangents that differ nearby belong to a
        # sharp bend, or to a branch that only passes near.
        return FiniteMotion(dimension, (here,), looked, tried, True)
    return FiniteMotion(dimension, tuple(branches), looked, tried, False)


def _around(held: ConstraintManifold, at: Linearised, rng: np.random.Generator) -> Iterator[Linearised | None]:
    """Points to examine, at distance `FAR`; without position rows any configuration."""
    if held.placed.any():
        return neighbours(held, at, FAR, rng, _DIRECTIONS)
    return iter([held.at(held.move(at.q, FAR * _unit(rng, np.eye(held.n)))) for _ in range(3)])


def _unit(rng: np.random.Generator, basis: Array) -> Array:
    z = basis @ rng.normal(size=basis.shape[1])
    return z / np.linalg.norm(z)


def neighbours(
    held: ConstraintManifold, at: Linearised, step: float, rng: np.random.Generator, directions: int
) -> Iterator[Linearised | None]:
    """For each direction of the kernel tried, the point found about one step away, or None."""
    K, _ = null_space(at.J[held.placed], held.zero)
    for _ in range(min(K.shape[1], 1) if K.shape[1] < 2 else (directions + 1) // 2):
        # At random: on the axes of a symmetric linkage the points are singular.
        z = _unit(rng, K)
        for start in (step * z, -step * z):
            found = held.project(held.move(at.q, start))
            moved = float(np.linalg.norm(held.displacement(at.q, found.q)))
            yield found if max_abs(found.error) <= held.tolerance and _MOVED * step <= moved <= 3.0 * step else None


def _regular(held: ConstraintManifold, at: Linearised, rng: np.random.Generator) -> tuple[Linearised, Array]:
    """(point, tangent space): this point, or a neighbouring one if the rank is higher there."""
    step = NEAR
    for _ in range(2):
        tangent, around = _tangent(held, at, step, rng)
        best = max(around, key=lambda p: _rank(held, p.J), default=at)
        if _rank(held, best.J) <= _rank(held, at.J):
            break
        at, step = best, 0.25 * step
    return at, tangent


def _rank(held: ConstraintManifold, J: Array) -> int:
    return held.rank(J, max(held.zero, ROUGH))


def _tangent(held: ConstraintManifold, at: Linearised, step: float, rng: np.random.Generator) -> tuple[Array, list[Linearised]]:
    """Orthonormal basis of the directions to the constraints' points around one of them, and these points."""
    K, _ = null_space(at.J[held.placed], held.zero)
    d = K.shape[1]
    around: list[Linearised] = []
    if d == 0:
        return K, around
    chords = np.zeros((2 * d + 1, held.n))
    for i in range(len(chords)):
        z = K[:, i] if i < d else _unit(rng, K)
        found = held.project(held.move(at.q, step * z))
        if max_abs(found.error) <= held.tolerance:
            chords[i] = held.displacement(at.q, found.q) / step
            around.append(found)
    _, s, Vt = np.linalg.svd(chords @ K)
    return K @ Vt[: int((s > _MOVED * np.sqrt(len(chords))).sum())].T, around


def _same(one: LocalBranch, other: LocalBranch) -> bool:
    """Whether two branches count as the same: of equal dimension, above one, or with nearly the same tangent."""
    if one.dimension != other.dimension:
        return False
    if one.dimension > 1:  # on a cone tangent planes differ from place to place
        return True
    return float(np.linalg.norm(one.tangent - other.tangent @ (other.tangent.T @ one.tangent), 2)) < _APART
