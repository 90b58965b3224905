"""The forces of a record: the shortest of all with the same motion under the same law, and what they are of each constraint.

A step takes the forces next to those of the step before; four corners carry what three could, and what they push against each
other sideways would stay in the record. At a recorded moment, with J and g = J^T f of the points that act, as `rbd.solve` does:

    minimise |f|^2     subject to     J^T f = g,     f in its cones,     f_t against the sliding of what slides

Where the shortest of all f with J^T f = g lies in the cones, it is the answer. Else `Solution.settled`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import Array, max_abs
from rbd.constraints.points import Measured, Structure
from rbd.problem.cones import Free
from rbd.problem.problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.simulation.contact_points import SLIDES, Layout, Snapshot, slide
from rbd.simulation.events import HOLDS, OPEN, PUSHES, SLIPS, STICKS, Touch
from rbd.simulation.velocity_problem import VelocityAnswer, chosen_rows
from rbd.solution import Solution

_REPEATS = 1e-11
"""Pivots of J J^T up to this, over the largest, are of rows that repeat each other."""
_ROUNDS = 3
_EXACT = 1e-12
"""What of g may be missed, over its size."""
_CARRIES = 1e-12
"""A point whose normal force is no larger carries nothing [N]."""


def least_forces(at: Snapshot, active: Array, answer: VelocityAnswer, h: float, law: str) -> Array:
    """Row forces of least norm that move the robot as an answer's impulses do, shape (p,) [N, N m].

    Args:
        at: The points.
        active: Which of them act, shape (k,).
        answer: Impulses that obey the law, and what came of them.
        h: The time in which they act [s].
        law: "coulomb" or "convex".
    """
    force: Array = answer.impulse / h
    if answer.least or not at.layout.pushes.any() or not force.any():
        return force
    found = _inside(at, active, answer.velocity, force, at.J.T @ force, law)
    return _settled(at, active, answer.v, answer.velocity, force, law) if found is None else found


def _inside(at: Snapshot, active: Array, velocity: Array, force: Array, g: Array, law: str) -> Array | None:
    """The shortest forces without regard to the cones' sides, if they are inside; None if not."""
    layout = at.layout
    n = layout.normals
    normal = layout.pushes
    speed = slide(layout, velocity)
    slides = active & layout.slides & (speed > SLIDES)
    if layout.boxed and (slides & ~layout.rubs).any():
        return None  # a bound decides the force of dry friction
    lifts = normal & (velocity[n] > SLIDES + (layout.mu * speed if law == "convex" else 0.0))
    plain, rays = _rows_of(layout, active & ~lifts & ~slides), []
    for i in np.flatnonzero(slides & ~lifts).tolist():
        t, ray = slice(n[i] - 2, n[i]), np.zeros(len(force))
        size = float(np.hypot(*force[t]))
        ray[t] = layout.mu[i] * (force[t] / size if size > 0.0 else -velocity[t] / speed[i])
        ray[n[i]] = 1.0
        rays.append(ray / np.linalg.norm(ray))
    G = at.J[plain] if not rays else np.concatenate([at.J[plain], np.array(rays) @ at.J])
    y = _shortest(G, g) if len(G) else None
    if y is None:
        return None
    out = np.zeros(len(force))
    out[plain] = y[: len(plain)]
    if rays:
        out += y[len(plain) :] @ np.array(rays)
    return out if _allowed(at, active, out) else None


def _rows_of(layout: Layout, points: Array) -> Array:
    """Indices of the rows of some points."""
    return np.arange(len(layout.held)) if points.all() else np.flatnonzero(np.repeat(points, layout.widths))


def _shortest(G: Array, g: Array) -> Array | None:
    """The shortest y with G^T y = g, by the pivoted Cholesky factor of G G^T; None where none is exact enough."""
    D = G @ G.T
    L, pivots, rank, _ = lapack.dpstrf(D, lower=1, tol=_REPEATS * float(D.diagonal().max()))
    if not rank:
        return None
    L, pivots = np.tril(L[:, :rank]), pivots - 1
    R = lapack.dpotrf(L.T @ L, lower=0, clean=0)[0]  # its columns are independent: they have pivots
    L11, y, missed, enough = L[:rank], np.zeros(len(G)), g, _EXACT * max_abs(g)
    for _ in range(_ROUNDS):  # y = L z is in the range of G G^T, and so the shortest
        z = lapack.dpotrs(R, blas.dtrsv(L11, (G @ missed)[pivots[:rank]], lower=1))[0]
        y[pivots] += L @ z
        missed = g - G.T @ y
        if max_abs(missed) <= enough:
            return y
    return None


def _allowed(at: Snapshot, active: Array, force: Array) -> bool:
    """Whether forces are in their cones, and within bounds."""
    layout, n = at.layout, at.layout.normals
    slack = 1e-12 * max(1.0, max_abs(force))
    if (force[n][layout.pushes] < -slack).any():
        return False
    if layout.rubs.any():
        t = layout.tangents
        beyond = np.hypot(*force[t].T) - layout.mu[layout.rubs] * force[n][layout.rubs]
        if (beyond > slack).any():
            return False
    if not layout.boxed:
        return True
    boxes = [(i, c) for i, c in enumerate(layout.cones) if type(c).__name__ == "Box"]
    return all(abs(float((c.project(force[n[i] : n[i] + 1]) - force[n[i]])[0])) <= slack for i, c in boxes)


def _settled(at: Snapshot, active: Array, v: Array, velocity: Array, force: Array, law: str) -> Array:
    """The long way: the problem whose answer these forces are, at the level of velocity, and its shortest forces."""
    index, groups, parts = chosen_rows(at.layout, active)
    f, J, M = force[index], at.J[index], at.state.M
    u = np.where(at.layout.held, 0.0, velocity)[index]
    P = GaussProblem(M, M @ v - J.T @ f, [Rows(name, J[s], u[s] - J[s] @ v, cone) for name, s, cone in groups], from_state=True)
    found = Solution(P, v, f, parts.project(parts.H.T @ f), law, "TimeStepping", 1, 0.0).settled()
    out = np.zeros(len(force))
    out[index] = found.multipliers
    if found.weights is not None and np.isfinite(found.weights).all():
        out[index] = parts.G @ found.weights
    return out


def touches_of(snapshot: Snapshot, force: Array, speed: Array, names: Sequence[str]) -> Mapping[str, Touch]:
    """What each constraint does, of row forces and sliding speeds.

    Args:
        snapshot: The points.
        force: Row forces, shape (p,) [N, N m]; zero of what does not act.
        speed: How fast each point slides, shape (k,) [m/s].
        names: All constraints, in order; those that have no points do nothing.
    """
    out: dict[str, Touch] = {}
    layout = snapshot.layout
    for measured, (points, rows) in zip(snapshot.sources, layout.spans, strict=True):
        f, u = force[rows], speed[points]
        for owner, at, row in _groups(measured.structure):
            out[owner] = _touch(measured, f[row], u[at], at, row)
    return {name: out.get(name, Touch(np.zeros(0), OPEN)) for name in names}


def _groups(structure: Structure) -> list[tuple[str, slice, slice]]:
    """(constraint, its points, its rows) of a source's points; those of one constraint stand together."""
    out: list[tuple[str, slice, slice]] = []
    ends = np.cumsum(structure.widths)
    first = 0
    k = len(structure.owners)
    for i in range(k):
        if i == k - 1 or structure.owners[i + 1] != structure.owners[first]:
            begin = int(ends[first - 1]) if first else 0
            out.append((structure.owners[first], slice(first, i + 1), slice(begin, int(ends[i]))))
            first = i + 1
    return out


def _touch(measured: Measured, force: Array, speed: Array, at: slice, row: slice) -> Touch:
    structure = measured.structure
    cones = structure.cones[at]
    if isinstance(cones[0], Free):
        mode = HOLDS
    else:
        widths = structure.widths[at]
        normals = np.cumsum(widths) - 1
        loaded = np.abs(force[normals]) > _CARRIES
        slides = loaded & (speed > SLIDES)
        rubs = widths[0] == 3 or type(cones[0]).__name__ == "Box"
        mode = OPEN if not loaded.any() else SLIPS if slides.any() else STICKS if rubs else PUSHES
    whole = len(structure.owners) == len(cones)
    resultant = measured.to_world @ force if measured.to_world is not None and whole else force
    if measured.points is None or measured.axes is None:
        return Touch(resultant, mode)
    points, axes = measured.points[at], measured.axes
    if isinstance(cones[0], Free):  # one point, the centre of what holds
        return Touch(resultant, mode, points, (axes @ force[:3])[None] if len(points) == 1 and len(force) >= 3 else None)
    k, width = len(cones), cones[0].dim
    pushed = np.zeros((k, 3))
    pushed[:, 3 - width :] = force.reshape(k, width)
    pushed = np.einsum("kij,kj->ki", axes[at], pushed) if axes.ndim == 3 else pushed @ axes.T
    if measured.to_world is None:
        resultant = pushed.sum(axis=0)
        if measured.arms is not None:
            resultant = np.concatenate([resultant, np.cross(measured.arms[at], pushed).sum(axis=0)])
    return Touch(resultant, mode, points, pushed)
