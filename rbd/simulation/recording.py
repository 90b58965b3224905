"""Recording of a simulation: numbers at each recorded time, with the minimum-norm forces of the motion.

A step uses forces near those of the step before; four corners are redundant, and their internal sideways forces
would remain in the record. At a recorded time, with J and g = J^T f of the active points, as `rbd.solve` does:

    minimise |f|^2     subject to     J^T f = g,     f in its cones,     f_t against the sliding of sliding points

If the shortest f with J^T f = g is in the cones, it is the answer. Else `Solution.settled`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import groupby, pairwise
from operator import attrgetter, itemgetter
from typing import Any, TypeAlias

import numpy as np

from rbd.answers.solution import Solution
from rbd.arrays import Array, cross_rows, each_times, is_finite, lazy, max_abs
from rbd.constraints.contact_points import SLIDES, Structure
from rbd.errors import NoSolution
from rbd.model.dynamics import energies_and_momenta
from rbd.problem.cones import Bounds, Free
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.simulation.energy_balance import balance
from rbd.simulation.simulated_motion import HOLDS, OPEN, PUSHES, SLIPS, STICKS, ConstraintForce, Sample, SimulatedMotion
from rbd.simulation.stacked_points import PointPlaces, Snapshot, places_of, point_kernel, slide
from rbd.simulation.trajectory_fields import COLUMNS, ENERGY, ENTRIES, RESIDUALS, TIME
from rbd.simulation.velocity_problem import VelocityAnswer, active_rows

_FIRST_ROWS = 64
"""Rows of the columns at the start of a recording; doubled when they are full."""
_BLOCK = 64
"""Samples of steps whose forces are written at once: those before them are dropped."""
_DERIVED = ("kinetic", "potential", "momentum", "com")
"""Fields that follow from q and v: computed when the recording is read."""
_OWN = [TIME, *(c for c in (*COLUMNS, *RESIDUALS) if c is not ENERGY and c.name not in _DERIVED)]
_RECORDED = sorted(_OWN, key=lambda c: not c.dims)
"""What a sample has itself, in one row: vectors, then numbers."""
_vectors, _numbers = (attrgetter(*[c.name for c in _OWN if bool(c.dims) == vectors]) for vectors in (True, False))
Forces: TypeAlias = dict[tuple[str, str], Array]
"""{(field of a trajectory, constraint): its rows}."""
_DIGITS = 1e-14
"""Rounding of sums of forces, over the largest of their terms."""
_CARRIES = 1e-12
"""A point whose normal force is no larger is unloaded [N]."""


class Recording:
    """Collects samples in columns filled in place; of each sample `constraint_forces` is called once, and it is dropped.

    Energies, momentum and centre of mass follow from q and v, and are computed when the recording is read. Forces of time steps
    are written some at a time: a sample of a humanoid holds 20 kB and more, ten seconds at 1 ms would be half a gigabyte.

    Args:
        motion: The motion simulated. Its constraints have an entry even if they never act.

    Attributes:
        motion: The motion simulated.
    """

    def __init__(self, motion: SimulatedMotion) -> None:
        self.motion = motion
        self._count, self._rows = 0, _FIRST_ROWS
        ends = np.cumsum([0, *[c.size(motion.robot) for c in _RECORDED]]).tolist()
        self._parts = [slice(*ends) if c.dims else ends[0] for c, ends in zip(_RECORDED, pairwise(ends), strict=True)]
        self._whole, self._other = np.zeros((self._rows, ends[-1])), np.zeros(self._rows)
        self._columns = Forces()
        self._steps: list[tuple[int, StepForces]] = []
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
        n, given = self._count, sample.constraint_forces
        if n == self._rows:
            self._rows *= 2
            self._whole, self._other = (np.concatenate([x, np.zeros_like(x)]) for x in (self._whole, self._other))
            self._columns = {place: self._room(place, column.shape[1:], column) for place, column in self._columns.items()}
        row = self._whole[n]
        np.concatenate((*_vectors(sample), _numbers(sample)), out=row)
        self._other[n] = sample.other_work
        if not is_finite(row):
            for c, part in zip(_RECORDED, self._parts, strict=True):
                self._check(sample.t, row[part], c.name)
        if isinstance(given, StepForces):
            self._check(sample.t, given.force, "forces")
            self._steps.append((n, given))
        else:
            acting = _stacked(given())
            for (what, name), value in acting.items():
                if what != "modes":
                    self._check(sample.t, value, f"{what.replace('_', ' ')} of {name!r:.80}")
            self._write(slice(n, n + 1), acting)
        self._count = n + 1  # last, so that after Ctrl-C a sample is recorded whole or not at all
        if len(self._steps) >= _BLOCK:
            self._write_steps()

    def _check(self, t: float, value: Array, what: str) -> None:
        if not is_finite(value):
            raise NoSolution(f"at t = {t:.6g} s a number is not finite: {what}. Try shorter steps, or softer gains.")

    def _write_steps(self) -> None:
        """Write the forces of steps; if Ctrl-C interrupts it, it is done again."""
        for _, same in groupby(enumerate(self._steps), lambda each: (each[1][0] - each[0], each[1][1].alike)):
            members = [member for _, member in same]
            self._write(slice(members[0][0], members[-1][0] + 1), forces_of([forces for _, forces in members]))
        self._steps = []

    def _write(self, rows: slice, acting: Forces) -> None:
        """Write the forces of some samples."""
        for place, value in acting.items():
            shape = np.shape(value)[1:]
            self._column(place, shape)[(rows, *[slice(k) for k in shape])] = value

    def fields(self) -> dict[str, Any]:
        """The fields of a `Trajectory` with one row a sample.

        Forces are padded with zeros to the largest number of rows, points with NaN and their forces with zeros where there
        were fewer; a constraint without a force is open.
        """
        self._write_steps()
        out: dict[str, Any] = {field: {} for field in ENTRIES}
        n, robot = self._count, self.motion.robot
        for c, part in zip(_RECORDED, self._parts, strict=True):
            c.put(out, self._whole[:n, part].copy())
        out |= zip(_DERIVED, energies_and_momenta(robot, out["q"], out["v"]), strict=True)
        balanced = balance(self.motion, out, self._other[:n])
        ENERGY.put(out, balanced - balanced[:1])
        for (field, name), column in self._columns.items():
            out[field][name] = column[:n].astype(str) if field == "modes" else column[:n]
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
    found = _inside(at, active, answer.velocity, force, law)
    return _settled(at, active, answer.v, answer.velocity, force, law) if found is None else found


def _inside(at: Snapshot, active: Array, velocity: Array, force: Array, law: str) -> Array | None:
    """The shortest forces without the cones' boundaries, but for those of sliding points, if they are inside; else None."""
    layout, out = at.layout, np.empty(len(force))
    found = point_kernel().shortest(
        np.ascontiguousarray(at.reach), layout.widths, layout.normals, layout.pushes, layout.rubs, layout.slides, layout.mu,
        active, velocity, force, law == "coulomb", out,
    )  # fmt: skip
    return out if found and (not layout.boxed or _allowed(at, active, out)) else None


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
    weights = found.weights
    own = found.multipliers if weights is None or not np.isfinite(weights).all() else T.G @ weights
    # The velocity is recorded as the step made it: shorter forces that make another one do not belong to it.
    missed, size = np.abs(J.T @ (own - f)), np.abs(J).T
    if not (missed <= SOLVED * (size @ np.abs(own)) + _DIGITS * (size @ np.abs(f)).max()).all():
        return force
    out = np.zeros(len(force))
    out[index] = own
    return out


class StepForces:
    """Forces and modes of all constraints in a time step, as `Sample.constraint_forces`; those of many at once by `forces_of`.

    Args:
        at: The points.
        velocity: Their velocities by the contact law, shape (p,) [m/s, rad/s].
        names: All constraints, in order; those without points are open.
        force: Gives the row forces, shape (p,) [N, N m]; zero of inactive points.
    """

    def __init__(self, at: Snapshot, velocity: Array, names: Sequence[str], force: Callable[[], Array]) -> None:
        self.at, self.velocity, self.names, self._force = at, velocity, names, force

    @lazy
    def force(self) -> Array:
        """The row forces."""
        return self._force()

    @property
    def alike(self) -> tuple[object, ...]:
        """Equal for those that `forces_of` takes together."""
        at = self.at
        return at.layout.structures, at.ground or id(self)

    def __call__(self) -> Mapping[str, ConstraintForce]:
        """{constraint: its force}."""
        found = {place: value[0] for place, value in forces_of([self]).items()}
        return {
            name: ConstraintForce(
                found["forces", name], str(found["modes", name]), found.get(("points", name)), found.get(("point_forces", name))
            )
            for name in self.names
        }


def forces_of(steps: Sequence[StepForces]) -> Forces:
    """Forces, modes and points of n steps that are alike, shapes (n, ...)."""
    first, out, n = steps[0], Forces(), len(steps)
    layout, force = first.at.layout, np.array([step.force for step in steps])
    speed = slide(layout, np.array([step.velocity for step in steps]))
    for measured, (points, rows) in zip(places_of([step.at for step in steps]), layout.spans, strict=True):
        f, u = force[:, rows], speed[:, points]
        for owner, at, row in points_and_rows(measured.structure):
            _add_forces(out, owner, measured, f[:, row], u[:, at], at)
    for name in first.names:
        if ("forces", name) not in out:
            out["forces", name], out["modes", name] = np.zeros((n, 0)), np.full(n, OPEN)
    return out


def _stacked(acting: Mapping[str, ConstraintForce]) -> Forces:
    """The same of one sample that has its forces itself."""
    out = Forces()
    for name, x in acting.items():
        out["forces", name], out["modes", name] = x.force[None], np.array([x.mode])
        if x.points is not None:
            pushed = np.zeros_like(x.points) if x.point_forces is None else x.point_forces
            out["points", name], out["point_forces", name] = x.points[None], pushed[None]
    return out


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


def _add_forces(out: Forces, name: str, measured: PointPlaces, force: Array, speed: Array, at: slice) -> None:
    """Add the forces of one constraint, from those of its rows and the speeds of its points."""
    structure = measured.structure
    cones = structure.cones[at]
    bilateral, whole = isinstance(cones[0], Free), len(structure.owners) == len(cones)
    mode = np.full(len(force), HOLDS)
    if not bilateral:
        kind, normals = _kind_of(structure, at.start, at.stop)
        loaded = np.abs(force[:, normals]) > _CARRIES
        mode = np.where((loaded & (speed > SLIDES)).any(axis=1), SLIPS, np.where(loaded.any(axis=1), kind, OPEN))
    resultant = each_times(measured.to_world, force) if measured.to_world is not None and whole else force
    if measured.points is not None and measured.axes is not None:
        points, pushed = measured.points if measured.split else measured.points[:, at], point_forces(measured, force, at)
        if pushed is not None and measured.to_world is None and not bilateral:
            resultant = pushed.sum(axis=1)
            if measured.arms is not None:
                turns = cross_rows(measured.arms[:, at].reshape(-1, 3), pushed.reshape(-1, 3)).reshape(pushed.shape)
                resultant = np.concatenate([resultant, turns.sum(axis=1)], axis=1)
        out["points", name], out["point_forces", name] = points, np.zeros_like(points) if pushed is None else pushed
    out["forces", name], out["modes", name] = resultant, mode


def point_forces(measured: PointPlaces, force: Array, at: slice) -> Array | None:
    """Forces at the points of one contact in world axes, shape (n, k, 3) [N]; None where the rows are no forces at points.

    Args:
        measured: Where the points of its source are, at n states.
        force: Its row forces, shape (n, m).
        at: Its points among those of the source.
    """
    cones, axes = measured.structure.cones[at], measured.axes
    assert axes is not None
    if measured.split is not None:
        return np.array([measured.split(f) for f in force])
    if isinstance(cones[0], Free):  # one point, of a bilateral constraint
        return each_times(axes, force[:, None, :3]) if len(cones) == 1 and force.shape[1] >= 3 else None
    n, k, width = len(force), len(cones), cones[0].dim
    if measured.pushes is not None:  # of one contact
        starts = measured.structure.normals + 1 - measured.structure.widths
        pushed = np.add.reduceat(force[:, :, None] * measured.pushes, starts, axis=1)
    else:
        pushed = np.zeros((n, k, 3))
        pushed[:, :, 3 - width :] = force.reshape(n, k, width)
    return each_times(axes if axes.shape[1] == 1 else axes[:, at], pushed)
