"""Recording of a simulation: numbers at each recorded time, with the minimum-norm forces of the motion.

A step uses forces near those of the step before; four corners are redundant, and their internal sideways forces
would remain in the record. At a recorded time, with J and g = J^T f of the active points, as `rbd.solve` does:

    minimise |f|^2     subject to     J^T f = g,     f in its cones,     f_t against the sliding of sliding points

If the shortest f with J^T f = g is in the cones, it is the answer. Else `Solution.settled`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from rbd.answers.solution import Solution
from rbd.arrays import Array, blas, cross_rows, is_finite, lapack, max_abs
from rbd.constraints.contact_points import Structure
from rbd.errors import NoSolution
from rbd.model.dynamics import kinetic_energy, momentum, potential_energy
from rbd.problem.cones import Bounds, Free
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.simulation.energy_balance import balance
from rbd.simulation.simulated_motion import HOLDS, OPEN, PUSHES, SLIPS, STICKS, ConstraintForce, Sample, SimulatedMotion
from rbd.simulation.stacked_points import SLIDES, PointPlaces, Snapshot, slide
from rbd.simulation.trajectory_fields import COLUMNS, ENERGY, ENTRIES, RESIDUALS, TIME
from rbd.simulation.velocity_problem import VelocityAnswer, active_rows

_FIRST_ROWS = 64
"""Rows of the columns at the start of a recording; doubled when they are full."""
_WHOLE, _BALANCE = ("whole", ""), ("balance", "")
"""Columns that are no field of a trajectory: all numbers of the robot in one row, and the balance of energy."""
_RECORDED = sorted((TIME, *COLUMNS, *(c for c in RESIDUALS if c is not ENERGY)), key=lambda c: not c.dims)
"""What is in that row: vectors, then numbers."""
_REPEATS = 1e-11
"""Pivots of J J^T up to this, over the largest, are of linearly dependent rows."""
_ROUNDS = 3
_EXACT = 1e-12
"""Tolerance of g, over its size."""
_DIGITS = 1e-14
"""Rounding of sums of forces, over the largest of their terms."""
_CARRIES = 1e-12
"""A point whose normal force is no larger is unloaded [N]."""


class Recording:
    """Collects samples in columns filled in place; each is read once, with one call of its `constraint_forces`, and dropped.

    A `State` of a humanoid holds 20 kB and the closure behind its forces more: ten seconds at 1 ms would be half a gigabyte.

    Args:
        motion: The motion simulated. Its constraints have an entry even if they never act.

    Attributes:
        motion: The motion simulated.
    """

    def __init__(self, motion: SimulatedMotion) -> None:
        self.motion = motion
        self._count, self._rows = 0, _FIRST_ROWS
        self._columns: dict[tuple[str, str], Array] = {}
        for constraint in motion.constraints:
            self._column(("forces", constraint.name), (0,))
            self._column(("modes", constraint.name), ())

    def __len__(self) -> int:
        return self._count

    def add(self, sample: Sample) -> None:
        """Record a sample.

        Raises:
            NoSolution: one of its numbers is not finite; nothing is then recorded.
        """
        state, acting = sample.state, sample.constraint_forces()
        kinetic, potential = kinetic_energy(state), potential_energy(state)
        vectors = [state.q, state.v, sample.a, sample.tau, momentum(state), state.com]
        numbers = [sample.t, kinetic, potential, sample.motor_work, sample.elastic, sample.dissipated]
        numbers += [sample.law, sample.drift, sample.drift_rate, sample.penetration]
        row = {_WHOLE: np.concatenate([*vectors, numbers])}
        for name, x in acting.items():
            row["forces", name] = x.force
            if x.points is not None:
                row["points", name] = x.points
                row["point_forces", name] = np.zeros_like(x.points) if x.point_forces is None else x.point_forces
        if self._count == self._rows:
            self._rows *= 2
            self._columns = {place: self._room(place, column.shape[1:], column) for place, column in self._columns.items()}
        n = self._count
        for place, value in row.items():
            if not is_finite(value):
                bad = (c.name for c, x in zip(_RECORDED, [*vectors, *numbers], strict=True) if not is_finite(np.asarray(x)))
                what = next(bad, f"{place[0].replace('_', ' ')} of {place[1]!r:.80}")
                raise NoSolution(f"at t = {sample.t:.6g} s a number is not finite: {what}. Try shorter steps, or softer gains.")
            column = self._column(place, value.shape)
            if column.shape[1:] == value.shape:
                column[n] = value
            else:
                column[n][tuple([slice(k) for k in value.shape])] = value
        for name, x in acting.items():
            self._column(("modes", name), ())[n] = x.mode
        self._column(_BALANCE, ())[n] = balance(self.motion, sample, kinetic, potential)
        self._count += 1  # last, so that after Ctrl-C a sample is recorded whole or not at all

    def fields(self) -> dict[str, Any]:
        """The fields of a `Trajectory` with one row a sample.

        Forces are padded with zeros to the largest number of rows, points with NaN and their forces with zeros where there
        were fewer; a constraint without a force is open.
        """
        out: dict[str, Any] = {field: {} for field in ENTRIES}
        columns = {place: column[: self._count] for place, column in self._columns.items()}
        whole, balanced = columns.pop(_WHOLE), columns.pop(_BALANCE)
        ends = np.cumsum([c.size(self.motion.robot) for c in _RECORDED])
        for c, part in zip(_RECORDED, np.split(whole, ends[:-1], axis=1), strict=True):
            c.put(out, part if c.dims else part[:, 0])
        ENERGY.put(out, balanced - balanced[0])
        for (field, name), column in columns.items():
            out[field][name] = column.astype(str) if field == "modes" else column
        return out

    def _column(self, place: tuple[str, str], shape: tuple[int, ...]) -> Array:
        """The column of an array, whose rows have at least a shape."""
        column = self._columns.get(place)
        if column is None or (column.shape[1:] != shape and any(np.greater(shape, column.shape[1:]))):
            column = self._columns[place] = self._room(place, shape, column)
        return column

    def _room(self, place: tuple[str, str], shape: tuple[int, ...], column: Array | None) -> Array:
        """An empty column with rows of at least a shape, and the contents of another."""
        empty: Any = {"modes": OPEN, "points": np.nan}.get(place[0], 0.0)
        size = shape if column is None else np.maximum(shape, column.shape[1:]).tolist()
        out: Array = np.full((self._rows, *size), empty, object if place[0] == "modes" else float)
        if column is not None:
            out[tuple([slice(k) for k in column.shape])] = column
        return out


def least_forces(at: Snapshot, active: Array, answer: VelocityAnswer, h: float, law: str) -> Array:
    """Minimum-norm row forces with the same motion as an answer's impulses, shape (p,) [N, N m].

    Args:
        at: The points.
        active: Which of them are active, shape (k,).
        answer: Impulses that obey the law, with their velocities.
        h: The time in which they act [s].
        law: "coulomb" or "convex".
    """
    force: Array = answer.impulse / h
    if answer.least or not at.layout.pushes.any() or not force.any():
        return force
    found = _inside(at, active, answer.velocity, force, at.J.T @ force, law)
    return _settled(at, active, answer.v, answer.velocity, force, law) if found is None else found


def _inside(at: Snapshot, active: Array, velocity: Array, force: Array, g: Array, law: str) -> Array | None:
    """The shortest forces without the cones' boundaries, if they are inside; else None."""
    layout = at.layout
    n = layout.normals
    normal = layout.pushes
    speed = slide(layout, velocity)
    slides = active & layout.slides & (speed > SLIDES)
    if layout.boxed and (slides & ~layout.rubs).any():
        return None  # a bound determines the force of dry friction
    lifts = normal & (velocity[n] > SLIDES + (layout.mu * speed if law == "convex" else 0.0))
    plain, rays = np.flatnonzero(np.repeat(active & ~lifts & ~slides, layout.widths)), []
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
    rows = active_rows(at.layout, active, 1.0)
    f = force[rows.index]
    return max_abs(rows.sets.project(f) - f) <= 1e-12 * max(1.0, max_abs(f))


def _settled(at: Snapshot, active: Array, v: Array, velocity: Array, force: Array, law: str) -> Array:
    """The shortest forces from the velocity-level problem that these forces solve, where the closed form fails."""
    rows = active_rows(at.layout, active, 1.0)
    index, groups, T = rows.index, rows.groups, rows.sets
    f, J, M = force[index], at.J[index], at.state.M
    u = np.where(at.layout.held, 0.0, velocity)[index]
    P = GaussProblem(M, M @ v - J.T @ f, [Rows(name, J[s], u[s] - J[s] @ v, cone) for name, s, cone in groups], from_state=True)
    found = Solution(P, v, f, T.project(T.H.T @ f), Law(law), "TimeStepping", 1, 0.0).settled()
    own = found.multipliers
    if found.weights is not None and np.isfinite(found.weights).all():
        own = T.G @ found.weights
    # The velocity is recorded as the step made it: shorter forces that make another one do not belong to it.
    missed, size = np.abs(J.T @ (own - f)), np.abs(J).T
    if not (missed <= SOLVED * (size @ np.abs(own)) + _DIGITS * (size @ np.abs(f)).max()).all():
        return force
    out = np.zeros(len(force))
    out[index] = own
    return out


def constraint_forces(snapshot: Snapshot, force: Array, speed: Array, names: Sequence[str]) -> Mapping[str, ConstraintForce]:
    """The force and the mode of each constraint, from row forces and sliding speeds.

    Args:
        snapshot: The points.
        force: Row forces, shape (p,) [N, N m]; zero of inactive points.
        speed: Sliding speed of each point, shape (k,) [m/s].
        names: All constraints, in order; those without points are open.
    """
    out: dict[str, ConstraintForce] = {}
    layout = snapshot.layout
    for measured, (points, rows) in zip(snapshot.places, layout.spans, strict=True):
        f, u = force[rows], speed[points]
        for owner, at, row in points_and_rows(measured.structure):
            out[owner] = _force_of(measured, f[row], u[at], at, row)
    return {name: out.get(name, ConstraintForce(np.zeros(0), OPEN)) for name in names}


@lru_cache(maxsize=256)
def points_and_rows(structure: Structure) -> tuple[tuple[str, slice, slice], ...]:
    """(constraint, its points, its rows) of a source's points; those of one constraint are adjacent."""
    out: list[tuple[str, slice, slice]] = []
    point = row = 0
    for owner, members in groupby(zip(structure.owners, structure.widths.tolist(), strict=True), key=itemgetter(0)):
        widths = [width for _, width in members]
        out.append((owner, slice(point, point + len(widths)), slice(row, row + sum(widths))))
        point, row = point + len(widths), row + sum(widths)
    return tuple(out)


@lru_cache(maxsize=1024)
def _kind_of(structure: Structure, first: int, last: int) -> tuple[str, Array]:
    """(mode of one constraint's points where they are loaded and do not slide, their normals among its rows)."""
    widths = structure.widths[first:last]
    rubs = widths[0] == 3 or isinstance(structure.cones[first], Bounds)
    return STICKS if rubs else PUSHES, np.cumsum(widths) - 1


def _force_of(measured: PointPlaces, force: Array, speed: Array, at: slice, row: slice) -> ConstraintForce:
    structure = measured.structure
    cones = structure.cones[at]
    if isinstance(cones[0], Free):
        mode = HOLDS
    else:
        kind, normals = _kind_of(structure, at.start, at.stop)
        mode, pushes, speeds = OPEN, force[normals].tolist(), speed.tolist()
        for push, slides in zip(pushes, speeds, strict=True):
            if abs(push) > _CARRIES:
                mode = SLIPS if slides > SLIDES else kind if mode == OPEN else mode
    whole = len(structure.owners) == len(cones)
    resultant = measured.to_world @ force if measured.to_world is not None and whole else force
    if measured.points is None or measured.axes is None:
        return ConstraintForce(resultant, mode)
    points, pushed = measured.points[at], point_forces(measured, force, at)
    if pushed is not None and measured.to_world is None and not isinstance(cones[0], Free):
        resultant = pushed.sum(axis=0)
        if measured.arms is not None:
            resultant = np.concatenate([resultant, cross_rows(measured.arms[at], pushed).sum(axis=0)])
    return ConstraintForce(resultant, mode, points, pushed)


def point_forces(measured: PointPlaces, force: Array, at: slice) -> Array | None:
    """Forces at the points of one contact in world axes, shape (k, 3) [N]; None where the rows are no forces at points.

    Args:
        measured: Where the points of its source are.
        force: Its row forces, shape (m,).
        at: Its points among those of the source.
    """
    cones, axes = measured.structure.cones[at], measured.axes
    assert axes is not None
    if isinstance(cones[0], Free):  # one point, of a bilateral constraint
        return (axes @ force[:3])[None] if len(cones) == 1 and len(force) >= 3 else None
    k, width = len(cones), cones[0].dim
    if measured.pushes is not None:  # of one contact
        pushed = np.add.reduceat(force[:, None] * measured.pushes, measured.structure.normals + 1 - measured.structure.widths)
    else:
        pushed = np.zeros((k, 3))
        pushed[:, 3 - width :] = force.reshape(k, width)
    return np.einsum("kij,kj->ki", axes[at], pushed) if axes.ndim == 3 else pushed @ axes.T
