"""Derivatives of an answer with respect to configuration, velocity, torques and external forces.

The equations of the answer are differentiated with the contact modes fixed (`rbd.answers.analysis.active_set` where nothing
slips
or opens, else `rbd.answers.analysis.active_set`). The dynamics' part, d(M a + h), and that of external forces, of points and
of patches on ground at rest, d(J^T f) and d(J a + J_dot v), are Pinocchio's analytical derivatives
(`rbd.model.derivatives`); that of any other constraint is taken by differences of its rows on the manifold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate

import numpy as np
import pinocchio as pin

from rbd.answers.analysis.active_set import CONSISTENT, ActiveSet, HeldRows
from rbd.answers.analysis.parameters import ParameterDerivatives, by_parameter, checked_parameters
from rbd.answers.analysis.state_changes import Change, derivatives_of, projections, slopes
from rbd.arrays import RANK, Array, rank_of, zeros
from rbd.constraints.fixed_rows import FixedRows, are_constant, fixed_rows_of
from rbd.constraints.loop import rows_function
from rbd.displayed import Displayed
from rbd.errors import NotDifferentiable, Unsupported
from rbd.model.derivatives import FixedPose, StateDerivatives, state_derivatives
from rbd.model.external import External, ExternalForce
from rbd.model.inertial import HasRows
from rbd.model.state import State
from rbd.problem.answer import Answer, Status
from rbd.problem.cones import Cone
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.rows import Rows


@dataclass(frozen=True, eq=False)
class ForceDerivatives:
    """Derivatives of a constraint's force (k = 3) or wrench (k = 6), on the robot, in world axes.

    For a constraint without a resultant, of its row forces. World axes: the rotation of the contact is included.

    Attributes:
        dq: Per change of configuration on the tangent space, shape (k, nv).
        dv: Per change of velocity, shape (k, nv).
        dtau: Per motor torque, shape (k, nu).
        dexternal: Per generalised external force, shape (k, nv).
    """

    dq: Array
    dv: Array
    dtau: Array
    dexternal: Array


@dataclass(frozen=True, eq=False, repr=False)
class Derivatives(Displayed):
    """Derivatives of an answer by q, v, torques and external forces, contact modes fixed; None for what is not unique.

    A change dq is in the tangent space: q becomes pin.integrate(q, dq), dq of a floating base linear then angular in the
    base's axes, as v. All else is constant: tau, the numbers of v, and external forces in the axes in which they were given.
    A sticking contact sticks for any dq and dv (its rows have no gap and no speed), so the derivatives are those
    of its formula J a + J_dot v = 0. It is the robot's derivative along J v = 0, as a contact that starts to slide
    changes its mode.

    Attributes:
        da_dq: Shape (nv, nv).
        da_dv: Shape (nv, nv).
        da_dtau: Shape (nv, nu).
        da_dexternal: By generalised external force, shape (nv, nv): of a force f_W at a point P, multiply by J_P^T f_W.
        df_dq: Of the row forces `Solution.multipliers`, shape (m, nv); None unless all of them are unique.
        df_dv: Of the row forces, shape (m, nv); None unless all are unique.
        df_dtau: Of the row forces, shape (m, nu); None unless all are unique.
        df_dexternal: Of the row forces, shape (m, nv); None unless all are unique.
        forces: {constraint: derivatives of `Solution.forces`}, None for a force that is not unique.
        active: {constraint: mode of each part of its set}: "holds", "sticks", "presses" (without friction), "slips" (begins
            to), "slides" (already), "opens", or "yields" (a force at its bound).
        not_unique: Names of the constraints whose forces are not unique.
        along_constraints: Whether those by q and v hold along the constraints alone, where rows are redundant on them and
            contradict each other beside them (a Bricard's closing hinge). A change off them counts as its projection onto them.
        parameters: {parameter: derivatives by it}, of those asked for.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet()
        >>> derivatives = rbd.solve(state, rbd.hold(state, feet).tau, feet).derivatives()
        >>> derivatives.da_dtau.shape, derivatives.active["front_left"], derivatives.not_unique
        ((18, 12), ('sticks',), ())
    """

    da_dq: Array
    da_dv: Array
    da_dtau: Array
    da_dexternal: Array
    df_dq: Array | None
    df_dv: Array | None
    df_dtau: Array | None
    df_dexternal: Array | None
    forces: dict[str, ForceDerivatives | None]
    active: dict[str, tuple[str, ...]]
    not_unique: tuple[str, ...]
    along_constraints: bool = False
    parameters: dict[str, ParameterDerivatives] = field(default_factory=dict)

    def __str__(self) -> str:
        said = [f"{name} {_counted(words)}" for name, words in self.active.items()]
        lost = f"; not unique: forces of {', '.join(self.not_unique)}" if self.not_unique else ""
        sizes = f"nv = {self.da_dtau.shape[0]}, nu = {self.da_dtau.shape[1]}"
        only = "; by q and v along the constraints alone" if self.along_constraints else ""
        return "\n  ".join([f"{sizes}, held: {'; '.join(said) or 'nothing'}{lost}{only}", *map(str, self.parameters.values())])


def _counted(words: tuple[str, ...]) -> str:
    """E.g. "sticks (3), opens (1)"."""
    return ", ".join(f"{word} ({words.count(word)})" for word in dict.fromkeys(words)) or "is inactive"


@dataclass(frozen=True, eq=False, slots=True)
class StateOrigin:
    """The state, constraints and external forces that a problem was assembled from.

    Attributes:
        state: The robot at (q, v).
        constraints: In the order of the problem's rows.
        external: External forces.
    """

    state: State
    constraints: tuple[HasRows, ...]
    external: External

    def derivatives(self, answer: Answer, parameters: Sequence[str] = ()) -> Derivatives:
        """Derivatives of an answer to the problem; see `Derivatives`.

        Raises:
            InputError: unknown parameters.
            NotDifferentiable: at a change of contact mode, if the problem was not solved, or where the answer is discontinuous.
        """
        if answer.status not in (Status.SOLVED, Status.INACCURATE):
            raise NotDifferentiable(
                f"this is no answer ({answer.status}: {answer.worst}), so it has no derivatives. Solve it first."
            )
        asked = checked_parameters(parameters)
        chain = _Chain(self, answer)
        found = chain.derivatives()
        by = {name: by_parameter(name, self.state, self.external, answer, chain.active, found.not_unique) for name in asked}
        return replace(found, parameters=by) if by else found

    def __reduce__(self) -> tuple[type[LeftBehind], tuple[()]]:
        return LeftBehind, ()

    def __copy__(self) -> StateOrigin:
        return self  # the object is constant

    def __deepcopy__(self, memo: dict[int, object]) -> StateOrigin:
        return self


@dataclass(frozen=True)
class LeftBehind:
    """In place of a `StateOrigin` in another process: with the state each answer would carry the whole robot."""

    def derivatives(self, answer: Answer, parameters: Sequence[str] = ()) -> Derivatives:
        """Always refused.

        Raises:
            Unsupported: always.
        """
        raise Unsupported(
            "this answer was solved in another process, and its state stayed there. Call derivatives() before sending it, "
            "or solve again here."
        )


class _Chain:
    """Maps changes of the state to changes of the answer."""

    def __init__(self, origin: StateOrigin, answer: Answer) -> None:
        self.origin, self.answer, self._pushed = origin, answer, _pushes(origin.external)
        self.robot, self.nv = origin.state.robot, origin.state.robot.nv
        fixed, held = [fixed_rows_of(c) for c in origin.constraints], None
        poses = [rows for rows in fixed if rows is not None]
        if (
            len(poses) == len(fixed) and getattr(answer, "_assemble", None) is not None
        ):  # where all is held or sticks, Pinocchio's derivatives have M and J, too
            ends = accumulate(rows.size for rows in poses)
            forces = [answer.multipliers[end - rows.size : end] for rows, end in zip(poses, ends, strict=True)]
            self._found: StateDerivatives | None = self._differentiated(poses, forces)
            self.problem = _problem_of(origin, answer, poses, self._found, len(self._pushed))
            held = HeldRows.of(answer, self.problem)
        if held is None:
            self._found, self.problem = None, answer.problem
            held = HeldRows.of(answer, self.problem)
        self.active, self.m = held or ActiveSet(answer), self.problem.m
        acting = [(c, r, f) for c, r, f in zip(origin.constraints, self.problem.rows, fixed, strict=True) if len(r)]
        self.fixed = [(f, r) for _, r, f in acting if f is not None]
        self.constant = [r for c, r, f in acting if f is None and are_constant(c, r)]
        self.others = [(c, r) for c, r, f in acting if f is None and not are_constant(c, r)]
        self._rows = rows_function(self.robot, [c for c, _ in self.others])

    def _differentiated(self, fixed: Sequence[FixedRows], forces: Sequence[Array]) -> StateDerivatives:
        """Derivatives with forces on the rows of poses."""
        poses = [pose for pose, _ in self._pushed] + [rows.pose for rows in fixed]
        wrenches = [wrench for _, wrench in self._pushed] + [rows.wrench(f) for rows, f in zip(fixed, forces, strict=True)]
        return state_derivatives(self.origin.state, self.answer.a, poses, wrenches)

    def derivatives(self) -> Derivatives:
        """All derivatives."""
        robot, active = self.robot, self.active
        by_q, by_v = self._by_state()
        along = None
        try:
            (a_q, f_q), (a_v, f_v) = self._answered(by_q, by_v)
        except NotDifferentiable:
            if len(active.internal.T):
                along = projections(self.origin.state, self.origin.constraints, active.words, by_q.u)
            if along is None:
                raise
            Q, G, V = along
            by_q, by_v = by_q.by(Q).plus(by_v.by(G)), by_v.by(V)
            (a_q, f_q), (a_v, f_v) = self._answered(by_q, by_v)
        a_external, f_external = active.by_force()
        a_tau, f_tau = a_external[:, robot.motors].copy(), f_external[:, robot.motors].copy()
        lost = self._not_unique()
        forces: dict[str, ForceDerivatives | None] = {}
        for r in self.problem.rows:
            span = self.problem.slices[r.name]
            each = [df[span].copy() if r.resultant is None else r.resultant @ df[span] for df in (f_q, f_v, f_tau, f_external)]
            for df, by in zip(each[:2], (by_q, by_v), strict=True):
                df += by.resultants.get(r.name, 0.0)
            forces[r.name] = None if r.name in lost else ForceDerivatives(*each)
        df_q, df_v, df_tau, df_external = (None if active.internal.size else df for df in (f_q, f_v, f_tau, f_external))
        return Derivatives(
            a_q, a_v, a_tau, a_external, df_q, df_v, df_tau, df_external, forces, active.words, lost, along is not None
        )  # fmt: skip

    def _answered(self, by_q: Change, by_v: Change) -> list[tuple[Array, Array]]:
        """(da, df) of both changes."""
        self._check_internal(by_q)
        return [self.active.derivative(x.force, x.c, x.u) for x in (by_q, by_v)]

    def _by_state(self) -> tuple[Change, Change]:
        """Changes of the terms with q and with v."""
        by_q, by_v = self._of_fixed()
        if not self.others:
            return by_q, by_v
        others_q, others_v = map(self._of_others, slopes(self._sample, self.origin.state))
        return by_q.plus(others_q), by_v.plus(others_v)

    def _of_fixed(self) -> tuple[Change, Change]:
        """Changes of M a + h, of external forces and of rows that are constant or fixed to bodies: Pinocchio's derivatives."""
        P, f, nv, internal = self.problem, self.answer.multipliers, self.nv, self.active.internal
        fixed = [rows for rows, _ in self.fixed]
        found = self._found or self._differentiated(fixed, [f[P.slices[r.name]] for _, r in self.fixed])
        by_q = Change.none(nv, self.m, internal.shape[1], found.force_dq)
        by_v = Change.none(nv, self.m, internal.shape[1], found.force_dv)
        for (rows, r), moved in zip(self.fixed, found.poses[len(self._pushed) :], strict=True):
            span, own = P.slices[r.name], rows.rows
            by_q.c[span], by_q.u[span] = moved.acceleration_dq[own], moved.velocity_dq[own]
            by_v.c[span], by_v.u[span] = moved.acceleration_dv[own], moved.J[own]
            if moved.force_dq is not None:
                by_q.resultants[r.name] = moved.force_dq
        for r in self.constant:
            by_v.u[P.slices[r.name]] = r.J
        for i, more in enumerate(internal.T if self.fixed else ()):  # J^T f is linear in f
            other = self._differentiated(fixed, [(f + more)[P.slices[r.name]] for _, r in self.fixed])
            by_q.internal[:, i] = other.force_dq - found.force_dq
        for change, more in zip((by_q, by_v), derivatives_of(self.origin.external, self.origin.state), strict=True):
            change.force[:] += more
        return by_q, by_v

    def _sample(self, state: State) -> Array:
        """Terms of the other constraints at a state, at the answer's a and f, in one vector.

        J^T f, then J^T of the internal forces; c; velocities; and each constraint's force in world axes. Empty where a
        constraint has other rows than at the answer: e.g. a joint that is off its limit.

        Raises:
            NotDifferentiable: if a constraint has another set of forces there.
        """
        P, a, f = self.problem, self.answer.a, self.answer.multipliers
        force, internal = np.zeros(self.nv), np.zeros((self.nv, self.active.internal.shape[1]))
        c, u, resultants = [], [], []
        for r, (_, known) in zip(self._rows(state), self.others, strict=True):
            part = P.slices[known.name]
            if len(r) != len(known):
                return np.zeros(0)
            if not _same_set(r.cone, known.cone) and not self._fills(known):
                raise NotDifferentiable(
                    f"the set of forces of {known.name!r} changes with the state; derivatives need constant sets."
                )
            force = force + r.J.T @ f[part]
            internal += r.J.T @ self.active.internal[part]
            c.append(r.J @ a + r.bias + r.feedback)
            u.append(r.velocity)
            resultants.append(np.zeros(0) if r.resultant is None else r.resultant @ f[part])
        return np.concatenate([force, internal.ravel(), *c, *u, *resultants])

    def _fills(self, rows: Rows) -> bool:
        """Whether all its points stick, and their forces make any of its rows': where its set ends does not matter then."""
        return set(self.active.words[rows.name]) == {"sticks"} and rank_of(rows.cone.generators()[0]) == len(rows)

    def _of_others(self, by: Array) -> Change:
        """The change of the other constraints, by the slopes of `_sample`."""
        nv, d, P = self.nv, self.active.internal.shape[1], self.problem
        out = Change.none(nv, self.m, d, by[:nv])
        m = sum(len(r) for _, r in self.others)
        internal, c, u, rest = np.split(by[nv:], np.cumsum([nv * d, m, m]))
        out.internal[:] = internal.reshape(nv, d, nv)
        for _, r in self.others:
            span, k = P.slices[r.name], len(r)
            out.c[span], c = c[:k], c[k:]
            out.u[span], u = u[:k], u[k:]
            if r.resultant is not None:
                out.resultants[r.name], rest = rest[: len(r.resultant)], rest[len(r.resultant) :]
        return out

    def _check_internal(self, by_q: Change) -> None:
        """Refuse if internal forces here would move the robot at a state nearby, where the rows are not redundant."""
        scale = float(np.abs(self.answer.multipliers).max(initial=0.0))
        for force in by_q.internal.transpose(1, 0, 2):
            if np.abs(self.active.response(force)).max() * scale > CONSISTENT * max(1.0, np.abs(self.answer.a).max()):
                raise NotDifferentiable(
                    "rows are linearly dependent in this configuration and not nearby (it is singular), so the motion "
                    "jumps. Move q a little, or leave out the redundant rows."
                )

    def _not_unique(self) -> tuple[str, ...]:
        """Constraints whose force an internal force can change."""
        P, internal = self.problem, self.active.internal
        parts = [(r, internal[P.slices[r.name]]) for r in P.rows if internal.size]
        felt = [(r.name, part if r.resultant is None else r.resultant @ part) for r, part in parts]
        return tuple(name for name, part in felt if np.abs(part).max(initial=0.0) > RANK)


_WORLD = np.eye(3)
_STILL = 1e-9
"""Rest speed of contacts that surely rest [m/s, rad/s]."""


def _problem_of(
    origin: StateOrigin, answer: Answer, fixed: Sequence[FixedRows], found: StateDerivatives, first: int
) -> GaussProblem:
    """The problem of constraints that are all of poses: J of their derivatives, from the first on, and M; without forces."""
    rows = []
    for c, at, moved in zip(origin.constraints, fixed, found.poses[first:], strict=True):
        own, J, R = at.rows, moved.J[at.rows], moved.R
        resultant = np.zeros((6, 6)) if at.size == 6 else R[:, own]
        if at.size == 6:
            resultant[:3, :3] = resultant[3:, 3:] = R
        bias = moved.acceleration[own] - J @ answer.a
        rows.append(Rows.unchecked(c.name, J, bias, c.cone, J @ origin.state.v, None, resultant, None))  # type: ignore[attr-defined]
    return GaussProblem(found.M, zeros(len(found.M)), rows, None, origin, _STILL, from_state=True)


def _same_set(one: Cone, other: Cone) -> bool:
    """Whether two sets of forces are the same."""
    if one == other:
        return True
    (G, parts), (other_G, other_parts) = one.generators(), other.generators()
    return parts == other_parts and np.array_equal(G, other_G)


def _pushes(external: External) -> list[tuple[FixedPose, Array]]:
    """Where external forces act, with axes of the world, and (force, moment) there; a generalised force does not change."""
    given = (external,) if isinstance(external, ExternalForce) else external if isinstance(external, Sequence) else ()
    return [
        (FixedPose(e.frame, pin.SE3(_WORLD, np.asarray(e.offset)), _WORLD), np.concatenate([e.force, e.moment]))
        for e in given
        if isinstance(e, ExternalForce)
    ]
