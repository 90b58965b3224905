"""Derivatives of an answer with respect to configuration, velocity, torques and external forces.

The equations of the answer are differentiated with the contact modes fixed (`rbd.analysis.active_set`). The
dynamics' part, d(M a + h), is Pinocchio's analytical derivative of inverse dynamics; the constraints' part,
d(J^T f) and d(J a + J_dot v), is taken by differences of their rows on the manifold, for any kind of constraint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.analysis.active_set import CONSISTENT, ActiveSet
from rbd.arrays import RANK, Array
from rbd.errors import NotDifferentiable, Unsupported
from rbd.model.dynamics import External, HasRows, generalised
from rbd.model.state import State
from rbd.problem.answer import Answer, Status
from rbd.problem.cones import Cone
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
class Derivatives:
    """Derivatives of an answer with its contact modes fixed; None for values that are not unique.

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

    def __repr__(self) -> str:
        return f"Derivatives({self})"

    def __str__(self) -> str:
        said = [f"{name} {_counted(words)}" for name, words in self.active.items()]
        lost = f"; not unique: forces of {', '.join(self.not_unique)}" if self.not_unique else ""
        return f"nv = {self.da_dtau.shape[0]}, nu = {self.da_dtau.shape[1]}, held: {'; '.join(said) or 'nothing'}{lost}"


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

    def derivatives(self, answer: Answer) -> Derivatives:
        """Derivatives of an answer to the problem; see `Derivatives`.

        Raises:
            NotDifferentiable: at a change of contact mode, if the problem was not solved, or where the answer is discontinuous.
        """
        if answer.status not in (Status.SOLVED, Status.INACCURATE):
            raise NotDifferentiable(
                f"this is no answer ({answer.status}: {answer.worst}), so it has no derivatives. Solve it first."
            )
        return _Chain(self, answer).derivatives()

    def __reduce__(self) -> tuple[type[LeftBehind], tuple[()]]:
        return LeftBehind, ()

    def __copy__(self) -> StateOrigin:
        return self  # the object is constant

    def __deepcopy__(self, memo: dict[int, object]) -> StateOrigin:
        return self


@dataclass(frozen=True)
class LeftBehind:
    """In place of a `StateOrigin` in another process: with the state each answer would carry the whole robot."""

    def derivatives(self, answer: Answer) -> Derivatives:
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
        self.origin, self.answer, self.active = origin, answer, ActiveSet(answer)
        self.robot, self.nv, self.m = origin.state.robot, origin.state.robot.nv, answer.problem.m
        self.acting = [(c, r) for c, r in zip(origin.constraints, answer.problem.rows, strict=True) if len(r)]

    def derivatives(self) -> Derivatives:
        """All derivatives."""
        nv, state, robot = self.nv, self.origin.state, self.robot
        model, q, v = robot.model, state.q, state.v
        inverse = self._inverse_dynamics()
        by_q = self._differences(lambda i, h: State(robot, pin.integrate(model, q, _along(nv, i, h)), v), _STEP, "q")
        by_v = self._differences(lambda i, h: State(robot, q, v + _along(nv, i, h)), 10.0 * _STEP, "v")
        by_q, by_v = replace(by_q, force=by_q.force - inverse[0]), replace(by_v, force=by_v.force - inverse[1])
        self._check_internal(by_q)
        torque = np.zeros((nv, robot.nu))
        torque[robot.actuated, np.arange(robot.nu)] = 1.0
        changes = [by_q, by_v, self._of_forces(torque), self._of_forces(np.eye(nv))]
        found = [self.active.derivative(change.force, change.c, change.u) for change in changes]
        lost = self._not_unique()
        forces = {}
        for r in self.answer.problem.rows:
            span = self.answer.problem.slices[r.name]
            each = [_world(r, change.resultants[r.name], df[span]) for change, (_, df) in zip(changes, found, strict=True)]
            forces[r.name] = None if r.name in lost else ForceDerivatives(*each)
        (a_q, f_q), (a_v, f_v), (a_tau, f_tau), (a_external, f_external) = found
        motion = Derivatives(a_q, a_v, a_tau, a_external, None, None, None, None, forces, self.active.words, lost)
        if self.active.internal.size:
            return motion
        return replace(motion, df_dq=f_q, df_dv=f_v, df_dtau=f_tau, df_dexternal=f_external)

    def _inverse_dynamics(self) -> tuple[Array, Array]:
        """d(M a + h)/dq and /dv at fixed a, shapes (nv, nv)."""
        state, robot = self.origin.state, self.robot
        with robot.pool.lock:
            slot, ticket = robot.pool.take(
                lambda data: pin.computeRNEADerivatives(robot.model, data, state.q, state.v, self.answer.a)
            )
            out = slot.data.dtau_dq.copy(), slot.data.dtau_dv.copy()
            robot.pool.give_back(slot, ticket)
        return out

    def _of_forces(self, force: Array) -> _Change:
        """Change of the acceleration by a generalised force, shape (nv, n)."""
        n = force.shape[1]
        return _Change(force, *self._split(np.zeros((self._sample(self.origin.state)[self.nv :].size, n))))

    def _sample(self, state: State) -> Array:
        """Terms of constraints and external forces at a state, at the answer's a and f, in one vector.

        tau_ext + J^T f, then J^T of the internal forces; c; velocities; and each constraint's force in world axes. Empty
        where a constraint has other rows than at the answer: e.g. a joint that is off its limit.

        Raises:
            NotDifferentiable: if a constraint has another set of forces there.
        """
        P, a, f = self.answer.problem, self.answer.a, self.answer.multipliers
        force, _ = generalised(state, self.origin.external)
        internal = np.zeros((self.nv, self.active.internal.shape[1]))
        c, u, resultants = [], [], []
        for constraint, known in self.acting:
            r, part = constraint.rows(state), P.slices[known.name]
            if len(r) != len(known):
                return np.zeros(0)
            if not _same_set(r.cone, known.cone):
                raise NotDifferentiable(
                    f"the set of forces of {known.name!r} changes with the state; derivatives need constant sets."
                )
            force = force + r.J.T @ f[part]
            internal += r.J.T @ self.active.internal[part]
            c.append(r.J @ a + r.bias + r.feedback)
            u.append(r.velocity)
            resultants.append(f[part] if r.resultant is None else r.resultant @ f[part])
        return np.concatenate([force, internal.ravel(), *c, *u, *resultants])

    def _split(self, tail: Array) -> tuple[Array, Array, Array, dict[str, Array]]:
        """(internal, c, u, resultants) of the parts of samples after the forces, shapes (nv, d, n), (m, n), (m, n), (k, n)."""
        d, n, m = self.active.internal.shape[1], tail.shape[1], self.m
        internal, c, u, rest = np.split(tail, np.cumsum([self.nv * d, m, m]))
        out = {r.name: np.zeros((0, n)) for r in self.answer.problem.rows}
        for _, r in self.acting:
            k = len(r) if r.resultant is None else len(r.resultant)
            out[r.name], rest = rest[:k], rest[k:]
        return internal.reshape(self.nv, d, n), c, u, out

    def _differences(self, moved: Callable[[int, float], State], step: float, what: str) -> _Change:
        """The change along each coordinate, by differences of samples.

        Args:
            moved: The state a distance away along a coordinate.
            step: First distance tried.
            what: Name of the coordinates, for messages.
        """
        here = self._sample(self.origin.state)

        def along(i: int) -> Array:
            return _slope(lambda h: self._sample(moved(i, h)), here, step, f"{what}[{i}]")

        slopes = np.column_stack([along(i) for i in range(self.nv)])
        return _Change(slopes[: self.nv], *self._split(slopes[self.nv :]))

    def _check_internal(self, by_q: _Change) -> None:
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
        P, internal, lost = self.answer.problem, self.active.internal, []
        for _, r in self.acting:
            part = internal[P.slices[r.name]]
            if np.abs(part if r.resultant is None else r.resultant @ part).max(initial=0.0) > RANK:
                lost.append(r.name)
        return tuple(lost)


@dataclass(frozen=True, eq=False)
class _Change:
    """How the terms of the equations change along n directions, at fixed a and f.

    Attributes:
        force: S^T tau + tau_ext + J^T f - (M a + h), shape (nv, n).
        internal: J^T of internal forces, shape (nv, d, n).
        c: Accelerations of the rows, shape (m, n).
        u: Velocities of the rows, shape (m, n).
        resultants: {constraint: force in world axes, shape (k, n)}.
    """

    force: Array
    internal: Array
    c: Array
    u: Array
    resultants: dict[str, Array]


@dataclass(frozen=True, eq=False)
class _Rule:
    """Differences from seven nodes: the slope, and two combinations of the values that vanish for smooth functions."""

    nodes: Array
    slope: Array
    lower_order: Array  # the fourth-order slope, less `slope`
    kink: Array  # half the jump of the slope at zero, of a function that is smooth on both sides


def _rules() -> tuple[_Rule, _Rule, _Rule]:
    both = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60.0
    ahead = np.array([-147, 360, -450, 400, -225, 72, -10]) / 60.0
    fourth, near = np.array([0, 1, -8, 0, 8, -1, 0]) / 12.0, np.array([-25, 48, -36, 16, -3, 0, 0]) / 12.0
    kink = np.array([1, -6, 15, -20, 15, -6, 1]) / 12.0  # 12 for |x|, 0 for x, x^2, ... x^5
    here = np.zeros(7)
    x = np.arange(7.0)
    return (
        _Rule(x - 3.0, both, fourth - both, kink),
        _Rule(x, ahead, near - ahead, here),
        _Rule(-x, -ahead, ahead - near, here),
    )


_RULES = _rules()
"""On both sides; ahead and behind, where the rows differ on the other side."""
_STEP = 0.005 * 5.0**0.5
"""First step tried [rad, m]; irrational, so that it is no whole number of periods of the function."""
SMOOTH = 1e-7
"""Largest error of a difference, over max(1, largest entry); up to 1e3 times as much if no step does better."""


def _slope(sample: Callable[[float], Array], here: Array, step: float, what: str) -> Array:
    """Derivative of a sample at zero, by differences of the sixth order with a step reduced until it converges.

    Raises:
        NotDifferentiable: if it has a kink, or different rows on the two sides.
    """
    best, miss = here, np.inf
    for _ in range(6):
        for rule in _RULES:
            values = [here if x == 0.0 else sample(step * x) for x in rule.nodes]
            if any(v.shape != here.shape for v in values):
                continue
            F = (np.array(values) - here) / step  # constant entries then have a slope of exactly zero
            slope = rule.slope @ F
            off = np.maximum(np.abs(rule.lower_order @ F), np.abs(rule.kink @ F))
            worst = float((off / np.maximum(np.abs(slope).max(initial=1.0), np.abs(here))).max(initial=0.0))
            if worst < miss:
                best, miss = slope, worst
            break
        if miss <= SMOOTH:
            return best
        step /= 8.0
    if miss <= 1e3 * SMOOTH:
        return best
    raise NotDifferentiable(
        f"the constraints do not change smoothly with {what}: "
        + ("their rows appear and disappear." if miss == np.inf else f"its slopes on the two sides differ by {miss:.1e}.")
        + " Leave out the constraint (or its feedback), or move the state a little."
    )


def _along(n: int, i: int, distance: float) -> Array:
    """A vector along one coordinate, shape (n,)."""
    out = np.zeros(n)
    out[i] = distance
    return out


def _same_set(one: Cone, other: Cone) -> bool:
    """Whether two sets of forces are the same."""
    if one is other or one == other:
        return True
    (G, parts), (other_G, other_parts) = one.generators(), other.generators()
    return parts == other_parts and np.array_equal(G, other_G)


def _world(r: Rows, turned: Array, df: Array) -> Array:
    """Change of a force in world axes, where it turns by `turned` and its row forces change by df."""
    return turned + (df if r.resultant is None else r.resultant @ df)
