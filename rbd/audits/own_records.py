"""Records of `rbd`'s own answers and motions, for comparison with other engines, and to audit the audit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rbd.answers.analysis.sensitivity import StateOrigin
from rbd.answers.solution import Solution
from rbd.arrays import Array
from rbd.audits.record import WORLD, Record
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.model.external import External, generalised
from rbd.model.state import State
from rbd.problem.rows import Rows
from rbd.simulation.trajectory import Trajectory


def from_solutions(solutions: Sequence[Solution]) -> Record:
    """The record of answers of `rbd.solve` for one robot, one frame each, a second apart.

    Contacts become points with the forces of `solution.corner_forces`; what has no points, or no law (bilateral contacts), is
    among the known forces.

    Raises:
        InputError: no solutions, or those of problems in arrays, which have no robot.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> stand = rbd.solve(solo.standing(), np.zeros(solo.nu), solo.feet())
        >>> report = rbd.audit(rbd.audits.from_solutions([stand]))
        >>> report.ok, report.obeys
        (True, 'both')
    """
    listed = list(solutions)
    if not listed or not all(isinstance(each, Solution) and isinstance(each.problem.origin, StateOrigin) for each in listed):
        raise InputError("expected solutions of rbd.solve(state, tau, contacts), one or more.")
    frames = _Frames()
    for each in listed:
        problem, origin = each.problem, each.problem.origin
        assert isinstance(origin, StateOrigin)
        known = problem.rhs + origin.state.h
        for constraint, rows in zip(origin.constraints, problem.rows, strict=True):
            if _is_judged(rows):
                frames.add(constraint, rows, each.corner_forces[rows.name])
            else:
                known = known + rows.J.T @ each.multipliers[problem.slices[rows.name]]
        frames.end(origin.state, each.a, known)
    return frames.record(np.arange(float(len(listed))), f"rbd.solve, {listed[0].law} law")


def from_trajectory(trajectory: Trajectory, contacts: Sequence[Constraint], *, external: External = None) -> Record:
    """The record of a motion of `rbd.simulate`, its contacts as points.

    Args:
        trajectory: The motion, its accelerations true ones.
        contacts: All its constraints, as they were given to `rbd.simulate`.
        external: Other forces that acted, besides its force elements.

    Raises:
        InputError: a constraint of the trajectory that is not among those given, with the nearest.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> start = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0])
        >>> slide = rbd.simulate(start, [floor], duration=0.3, step=0.01)
        >>> rbd.audit(rbd.audits.from_trajectory(slide, [floor])).obeys
        'coulomb'
    """
    robot, given = trajectory.robot, {each.name: each for each in contacts}
    for name in trajectory.forces:
        check_known("contacts have no constraint", name, given)
    frames = _Frames()
    for i in range(len(trajectory)):
        state = State(robot, trajectory.q[i], trajectory.v[i], t=float(trajectory.t[i]))
        known = generalised(state, trajectory.elements)[0] + generalised(state, external)[0]
        known[robot.actuated] += trajectory.tau[i]
        for name, force in trajectory.forces.items():
            rows = given[name].rows(state)
            if _is_judged(rows) and name in trajectory.points:
                frames.add(given[name], rows, trajectory.point_forces[name][i], tilted=True)
            elif rows.resultant is None:
                known += rows.J.T @ force[i]
            else:
                known += rows.J.T @ np.linalg.lstsq(rows.resultant, force[i], rcond=None)[0]
        frames.end(state, trajectory.a[i], known)
    return frames.record(trajectory.t, f"rbd.simulate, {trajectory.law} law")


class _Frames:
    """Frames and their points, one after the other."""

    def __init__(self) -> None:
        self.states: list[State] = []
        self.a: list[Array] = []
        self.tau: list[Array] = []
        self.points: dict[str, list[Any]] = {
            name: [] for name in ("contact_at", "contact_bodies", "points", "normals", "friction", "forces", "gaps")
        }

    def add(self, constraint: Constraint, rows: Rows, forces: Array, *, tilted: bool = False) -> None:
        """The points of a contact, of the next frame; of motions in which a sole may tilt, each with the ground's normal."""
        patch = rows.patch
        assert patch is not None
        there = np.flatnonzero(~np.isnan(forces).any(axis=1))
        axes, k = np.broadcast_to(patch.corner_axes, (len(forces), 3, 3))[there], len(there)
        mu, n = patch.friction, axes[:, :, 2]
        if tilted and patch.turned is None and patch.on is not None and patch.on.normal is not None:
            n = np.broadcast_to(np.asarray(patch.on.normal), (k, 3))
        gaps = np.full(k, np.nan) if patch.gaps is None else patch.gaps[there]
        values = {
            "contact_at": np.full(k, len(self.states)),
            "contact_bodies": np.array([[getattr(constraint, "frame", ""), patch.against or WORLD]] * k).reshape(k, 2),
            "points": patch.corners_W[there], "normals": n,
            "friction": np.full(k, float(mu) if isinstance(mu, float | int) else np.nan), "forces": forces[there], "gaps": gaps,
        }  # fmt: skip
        for name, x in values.items():
            self.points[name].append(x)

    def end(self, state: State, a: Array, tau: Array) -> None:
        """A frame is complete, with its known forces."""
        self.states.append(state)
        self.a.append(a)
        self.tau.append(tau)

    def record(self, t: Array, engine: str) -> Record:
        """All of them."""
        points: dict[str, Any] = {name: np.concatenate(parts) for name, parts in self.points.items() if parts}
        q, v = np.array([s.q for s in self.states]), np.array([s.v for s in self.states])
        return Record.of_arrays(self.states[0].robot, t=t, q=q, v=v, a=self.a, tau=self.tau, engine=engine, **points)


def _is_judged(rows: Rows) -> bool:
    """Whether it is a contact that can break, with points."""
    return rows.patch is not None and rows.patch.friction is not None
