"""`StepProblem`: a step of whole-body control at one state, as a quadratic program; `TaskActuation`, its answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np

from rbd.arrays import Array, check_finite, filled, identity, is_finite, lazy, max_abs, zeros
from rbd.constraints.constraint import Constraint
from rbd.control.motion_limits import Limits, joints_at_bounds, step_kernel
from rbd.control.step_program import Relaxed, StepProgram, relaxed
from rbd.control.task_terms import Task, TaskTerms, checked_tasks
from rbd.displayed import Displayed
from rbd.errors import InputError, UnknownName, nearest
from rbd.errors.inputs import check_kind
from rbd.model.external import External, generalised
from rbd.model.state import State
from rbd.problem.answer import Status
from rbd.problem.conic import Conic
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.residuals import SOLVED, USABLE
from rbd.problem.rows import Rows, by_rows
from rbd.records import Field, joined
from rbd.statics.actuation import Actuation
from rbd.statics.effort import Effort
from rbd.statics.force_balance import ForceBalance, contact_rows

_AT = 1e-6
"""A torque this near to its limit, over the limit, or an acceleration to its bound, over 1 rad/s2, is at it."""


@dataclass(frozen=True)
class StepCertificate(Displayed):
    """How far a step is from its equations, its limits and the least cost: computed in every step, zero for an exact one.

    Attributes:
        balance: |M a + h - tau_ext - J^T f| where there is no motor [N, N m].
        contacts: |J a + J_dot v + k J v|, less the violation that was allowed [m/s2, rad/s2].
        cones: Distance of the points' forces from their circular friction cones [N].
        torques: By how much a torque is beyond its limit [N, N m].
        joints: By how much an acceleration is beyond its bound, less the violation that was allowed [rad/s2, m/s2].
        optimality: How far torques and forces are from those of least cost: gradient, bounds and complementarity of the
            quadratic program by its multipliers, scaled.
        scaled: The same six, in order, over their sizes.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state = solo.standing()
        >>> found = rbd.control.step(state, [rbd.control.PostureTask(state.q)], solo.feet(friction=0.7))
        >>> found.certificate.worst < 1e-9
        True
    """

    balance: float
    contacts: float
    cones: float
    torques: float
    joints: float
    optimality: float
    scaled: tuple[float, ...]

    @property
    def worst(self) -> float:
        """The largest scaled residual; NaN if any is."""
        return math.nan if any(x != x for x in self.scaled) else max(self.scaled)

    @property
    def status(self) -> Status:
        """SOLVED up to 1e-9, INACCURATE up to 1e-7, else FAILED."""
        worst = self.worst
        return Status.SOLVED if worst <= SOLVED else Status.INACCURATE if worst <= USABLE else Status.FAILED

    def __str__(self) -> str:
        return (
            f"balance {self.balance:.1e} N, contacts {self.contacts:.1e} m/s2, cones {self.cones:.1e} N, torques "
            f"{self.torques:.1e} N m, joints {self.joints:.1e} rad/s2, optimality {self.optimality:.1e}"
        )


@dataclass(frozen=True, eq=False)
class Violation(Displayed):
    """By how much contacts and joint limits are violated, where no torques and forces within their limits keep them.

    Attributes:
        contacts: {contact or loop: accelerations of its rows beyond what is wanted, shape (m,) [m/s2, rad/s2]}.
        joints: {joint: by how much its acceleration is beyond the bound [rad/s2, m/s2]}.

    Example:
        >>> import warnings
        >>> box = rbd.testing.box()
        >>> floor = rbd.PointContact("floor", "box", friction=0.5)
        >>> rising = rbd.PointContact("rising", "box", friction=0.5, on=rbd.Ground(acceleration=(0, 0, 1.0)))
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", rbd.errors.RelaxedLimitsWarning)
        ...     found = rbd.control.step(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [floor, rising])
        >>> print(found.violation)
        'floor' accelerates by 0.5 m/s2, 'rising' accelerates by 0.5 m/s2
    """

    contacts: Mapping[str, Array]
    joints: Mapping[str, float]

    @property
    def worst(self) -> float:
        """The largest entry [m/s2, rad/s2]."""
        return max([float(np.abs(x).max()) for x in self.contacts.values()] + [*self.joints.values(), 0.0])

    def __str__(self) -> str:
        told = [f"{name!r:.80} accelerates by {np.abs(x).max():.3g} m/s2" for name, x in self.contacts.items()]
        told += [f"{name!r:.80} is {x:.3g} rad/s2 beyond its limit" for name, x in self.joints.items()]
        return joined(told)


@dataclass(frozen=True, eq=False, repr=False)
class TaskActuation(Actuation):
    """Torques and forces of a step of whole-body control: an `rbd.Actuation`, with what tasks missed.

    Its `residuals` are those of every answer, for contacts that keep as still as the step wants them; `certificate`, computed
    in the step, also shows that no other torques and forces have less cost.

    Attributes:
        missed: {task: wanted less reached, shape (m,)}: accelerations, or forces over the mass [m/s2, rad/s2].
        certificate: How far the step is from its equations, its limits, and the least cost.
        violation: By how much contacts and joint limits are violated; None where they are kept.
        limits: Those that were given.
        moving: {contact: speed}: contacts that move faster than `rest_speed` [m/s, rad/s]: they are brought to rest.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> up = rbd.control.ComTask(state.com + [0.0, 0.0, 0.01], gain=100.0)
        >>> found = rbd.control.step(state, [up], feet)
        >>> print(found.status, f"{found.missed['com'][2]:.3f} m/s2 missed of 1")
        solved 0.045 m/s2 missed of 1
    """

    missed: Mapping[str, Array] = field(default_factory=dict)
    certificate: StepCertificate = StepCertificate(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,))
    violation: Violation | None = None
    limits: Limits = Limits()
    moving: Mapping[str, float] = field(default_factory=dict)

    fields: ClassVar[tuple[Field, ...]] = (
        *(line for line in Actuation.fields if line.certificate),
        Field(
            "worst_certificate", (), "1", "largest error of the step: equations, limits, least cost",
            lambda step: step.certificate.worst, certificate=True,
        ),
        *(line for line in Actuation.fields if not line.certificate),
        Field(
            "missed", (), "m/s2 or rad/s2", "largest entry of what each task missed",
            lambda step: {name: max_abs(off) for name, off in step.missed.items()},
            "missed_{}", "largest entry of what {} missed",
        ),
        Field(
            "violation", (), "m/s2 or rad/s2", "by how much contacts and joint limits are violated",
            lambda step: 0.0 if step.violation is None else step.violation.worst,
        ),
    )  # fmt: skip

    @property
    def status(self) -> Status:
        """What the certificate amounts to."""
        return self.certificate.status

    @lazy
    def at_limit(self) -> dict[str, tuple[str, ...]]:
        """{"torque", "position", "velocity": joints at that limit}, of those that some joint is at."""
        robot, out = self.state.robot, dict[str, tuple[str, ...]]()
        (least, most), slack = self.limits.torque_bounds(self.state), _AT * np.minimum(self.limits.torques(robot), 1e300)
        loaded = (self.tau <= least + slack) | (self.tau >= most - slack)
        if loaded.any():
            out["torque"] = tuple(name for name, is_at in zip(robot.actuated_names, loaded, strict=True) if is_at)
        out.update(joints_at_bounds(self.limits, self.state, self.a, _AT))
        return out

    def _outcome(self) -> str:
        return "held" if self.still else "meets its tasks at least cost"

    def __str__(self) -> str:
        lines = [super().__str__()]
        missed = {name: float(np.abs(off).max()) for name, off in self.missed.items() if off.any()}
        if missed:
            lines.append(f"  missed [m/s2, rad/s2]: {', '.join(f'{name} {most:.3g}' for name, most in missed.items())}")
        lines += [f"  {kind} limits: {', '.join(names)}" for kind, names in self.at_limit.items()]
        lines += [f"  {name} moves at {speed:.3g} m/s, and is brought to rest" for name, speed in self.moving.items()]
        if self.violation is not None:
            lines.append(f"  violated: {self.violation}")
        return "\n".join(lines)


ACCELERATION_COST = 1e-4
"""r_a: cost of an acceleration of each coordinate, beside the tasks: it chooses where no task does."""
FORCE_COST = 1e-2
"""r_f: cost of a ray's force over the body weight, likewise."""
LENGTH = 0.1
"""Lever arm at which rotations of contacts count beside translations in a violation [m]: about half the length of a sole."""


@dataclass(frozen=True, eq=False)
class StepProblem:
    """What a step solves.

    Attributes:
        state: The robot at (q, v).
        contacts: What was given.
        external: Likewise.
        limits: Likewise.
        feedback: What brings velocities of contacts to rest, shape (m,) [m/s2, rad/s2].
        still: The equations of motion without acceleration, `need` = h - tau_ext; forces are rays of pyramids inside the
            friction cones.
        terms: Of the tasks.
        program: In (w / unit, a).
        torques: Least and largest torques, shapes (nu,).
        limited: Joints' coordinates with a bound, shape (j,).
    """

    state: State
    contacts: tuple[Constraint, ...]
    external: External
    limits: Limits
    feedback: Array
    still: ForceBalance
    terms: tuple[TaskTerms, ...]
    program: StepProgram
    torques: tuple[Array, Array]
    limited: Array

    @classmethod
    def of(
        cls,
        state: State,
        tasks: Sequence[Task],
        contacts: tuple[Constraint, ...],
        t: float,
        limits: Limits,
        external: External,
        normal_force: Mapping[str, tuple[float, float]] | None,
        damping: float,
        *,
        stacklevel: int | None,
    ) -> StepProblem:
        """Checked; a warning names contacts off the planes that they stand on, if a `stacklevel` is given.

        Raises:
            InputError: what is no task; terms that are not finite, or of a wrong shape.
            DuplicateName: two tasks, or two contacts, of one name.
            UnknownName: a force or bounds of a contact that was not given.
        """
        robot, nv = state.robot, state.robot.nv
        rows = contact_rows(state, contacts, stacklevel=None if stacklevel is None else stacklevel + 1)
        sets = _pyramids(at_rest(*[r.cone for r in rows]))
        J = _stacked([r.J for r in rows], nv)
        feedback = _joined([r.feedback if r.stabilised else damping * r.velocity for r in rows])
        offset = _joined([r.bias for r in rows]) + feedback
        if not (is_finite(J) and is_finite(offset)):
            _refuse(rows)
        need = state.h if external is None else state.h - generalised(state, external)[0]
        balance = ForceBalance(state, rows, sets, need, (J, offset))
        terms, unit, p = tuple([_terms(task, state, t) for task in checked_tasks(tasks)]), balance.unit, sets.size
        of_a = [each for each in terms if not each.contact]
        K, k = _force_cost(terms, rows, sets, unit)
        torques, limited = limits.torque_bounds(state), limits.joints(robot).at
        lower, upper = _weight_bounds(sets, unit, nv)
        W_n, low_n, high_n = np.zeros((0, p)), _NONE, _NONE
        check_kind("normal_force", normal_force, Mapping | None, "{contact: (least, most)} [N]")
        if normal_force:
            asked, low_n, high_n = Effort(normal_force=normal_force).rows(balance)
            W_n, low_n, high_n, upper = _without_zeros(asked["forces"], low_n, high_n, lower, upper)
        e, first, n = nv - robot.nu, robot.nu + len(low_n), p + nv
        last, m = first + len(limited), e + len(J)
        per_weight, g, b, low, high = np.empty((nv, p)), np.zeros(n), np.empty(m), np.empty(last), np.empty(last)
        H, E, C = np.zeros((n, n)), np.zeros((m, n)), np.zeros((last, n))
        H.flat[p * (n + 1) :: n + 1] = ACCELERATION_COST
        A, wanted, cost = (
            _stacked([each.A for each in of_a], nv),
            _joined([each.wanted for each in of_a]),
            _joined([each.cost for each in of_a]),
        )
        step_kernel().assembled(
            state.M.T, need, J, offset, sets.G, unit, robot.unactuated, robot.actuated, A, wanted, cost, K, k,
            limits.torques(robot), *torques, W_n, low_n, high_n, limited, *limits.accelerations(state), per_weight, H, g, E, b,
            C, low, high,
        )  # fmt: skip
        balance.__dict__["per_weight"] = per_weight
        conic = filled(  # without `Conic.of`, which takes a twentieth of a step
            Conic, H=H, g=g, A=E, b=b, C=C, low=low, high=high, lower=lower, upper=upper, cones=sets.cone_columns, mu=sets.mu,
            spans={},
        )  # fmt: skip
        program = StepProgram(conic, p, slice(e, m), slice(robot.nu, first), slice(first, last))
        return cls(state, contacts, external, limits, feedback, balance, terms, program, torques, limited)

    def relaxed(self) -> Relaxed | None:
        """The program with the least violation, rotations counting at a lever arm of `LENGTH`; None where it was not found."""
        joint_sizes = np.where(self.state.robot.joints.angular[self.limited], LENGTH, 1.0)
        return relaxed(self.program, np.concatenate([_NONE, *[_sizes(r) for r in self.still.rows]]), joint_sizes)

    def missed(self, a: Array, w: Array) -> dict[str, Array]:
        """{task: wanted less reached}, of accelerations and weights [N]."""
        out = {each.name: each.wanted - each.A @ a for each in self.terms if not each.contact}
        for each in self.terms:
            if each.contact:
                wrench = _resultant(each.name, each.contact, self.still.rows, self.still.sets) @ w
                out[each.name] = each.wanted - each.A @ wrench[: each.A.shape[1]]
        return out

    def loads(self, need: Array, feedback: Array, offset: Array) -> ForceBalance:
        """The equations of motion, the contacts as still as the step wants them; `need` is M a + h - tau_ext."""
        still = self.still
        return ForceBalance(self.state, partial(_at_rest, still.rows, feedback), still.sets, need, (still.J, offset))

    def violation(self, missed: Array, passed: Array, seen: float) -> Violation:
        """Accelerations that contacts miss, shape (m,), and by how much joints pass their bounds, shape (j,), by name.

        Constraints and joints that miss no more than `seen` are left out.
        """
        contacts = {r.name: part for r, part in by_rows(self.still.rows, missed) if max_abs(part) > seen}
        names = {joint.v.start: name for name, joint in self.state.robot.joints.items()}
        each = zip(self.limited.tolist(), passed.tolist(), strict=True)
        return Violation(contacts, {names[i]: x for i, x in each if x > seen})

    def moving(self) -> dict[str, float]:
        """{contact: speed} of those that move [m/s, rad/s]."""
        return {r.name: r.speed for r in self.still.rows if max_abs(r.velocity) > REST_SPEED}


_NONE = np.zeros(0)


@lru_cache(maxsize=128)
def _pyramids(sets: ForceSet) -> ForceSet:
    return sets.with_pyramids(inscribed=True) if len(sets.mu) else sets


def _at_rest(rows: Sequence[Rows], feedback: Array) -> tuple[Rows, ...]:
    return tuple([r.kept_still(part) for r, part in by_rows(rows, feedback)])


@lru_cache(maxsize=128)
def _weight_bounds(sets: ForceSet, unit: float, nv: int) -> tuple[Array, Array]:
    """Bounds of (w / unit, a): accelerations have none of their own."""
    free = np.full(nv, np.inf)
    return np.concatenate([sets.lower / unit, -free]), np.concatenate([sets.upper / unit, free])


def _refuse(rows: Sequence[Rows]) -> None:
    """Name the constraint that gives numbers which are not finite.

    Raises:
        InputError: always.
    """
    for r in rows:
        check_finite(f"rows of {r.name!r:.80}", np.concatenate([r.J, r.bias[:, None], r.velocity[:, None]], axis=1))
    raise InputError("the rows of all constraints together are too large.")


def _terms(task: Task, state: State, t: float) -> TaskTerms:
    """Of a task, of the right shape.

    Raises:
        InputError: others.
    """
    terms = task.terms(state, t)
    if type(terms) is not TaskTerms:
        check_kind(f"terms of task {task.name!r:.80}", terms, TaskTerms, "rbd.control.TaskTerms")
    if terms.name != task.name:
        raise InputError(f"the terms of task {task.name!r:.80} are named {terms.name!r:.80}; expected the task's name.")
    if not terms.contact and terms.A.shape[1] != state.robot.nv:
        raise InputError(
            f"A of task {task.name!r:.80} has shape {terms.A.shape}; expected (m, {state.robot.nv}), on accelerations."
        )
    return terms


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate(parts) if parts else _NONE


def _stacked(parts: Sequence[Array], nv: int) -> Array:
    """Matrices below each other, their rows contiguous."""
    return np.concatenate(parts, out=np.empty((sum(map(len, parts)), nv))) if parts else np.empty((0, nv))


def _force_cost(terms: Sequence[TaskTerms], rows: Sequence[Rows], sets: ForceSet, unit: float) -> tuple[Array, Array]:
    """(K, k) of weights over the unit.

    Raises:
        UnknownName: a contact that was not given.
        InputError: of another kind than its force.
    """
    K, k = FORCE_COST * identity(sets.size), zeros(sets.size)
    for each in terms:
        if each.contact:
            of = _resultant(f"task {each.name!r:.80}", each.contact, rows, sets)
            if each.A.shape[1] not in (3, len(of)):  # a force alone leaves the moment free
                wants = "a force, three numbers" if len(of) == 3 else "a wrench, six numbers"
                raise InputError(f"task {each.name!r:.80} has {each.A.shape[1]} columns; {each.contact!r:.80} has {wants}.")
            A = each.A @ of[: each.A.shape[1]] * unit
            weighed = A.T * each.cost
            K, k = K + weighed @ A, k - weighed @ each.wanted
    return K, k


def _resultant(asked_by: str, name: str, rows: Sequence[Rows], sets: ForceSet) -> Array:
    """Force or wrench of a contact of unit weights, in world axes, shape (3 or 6, p).

    Raises:
        UnknownName: a contact that was not given, with the nearest names.
        InputError: a constraint without one.
    """
    for r, G in by_rows(rows, sets.G):
        if r.name == name:
            if r.resultant is None or not len(r):
                raise InputError(f"{asked_by} is about {name!r:.80}, which has no force in world axes.")
            return np.asarray(r.resultant @ G)
    raise UnknownName(f"{asked_by} is about {name!r:.80}, which is no contact here; {nearest(name, [r.name for r in rows])}.")


def _without_zeros(W: Array, low: Array, high: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array, Array]:
    """(W, low, high, upper) where a normal force that may only be zero is zero of each ray, and no row."""
    zero, p = high <= 0.0, W.shape[1]
    if not zero.any():
        return W, low, high, upper
    pushes = (W[zero] > 0.0).any(axis=0) & (lower[:p] == 0.0)
    upper = upper.copy()
    upper[:p][pushes] = 0.0
    kept = ~zero | (W[:, lower[:p] < 0.0] != 0.0).any(axis=1)
    return W[kept], low[kept], high[kept], upper


def _sizes(r: Rows) -> Array:
    """1 of each row, `LENGTH` of those whose force is a pure moment."""
    if r.resultant is None or len(r.resultant) < 6:
        return np.ones(len(r))
    turns = ~r.resultant[:3].any(axis=0) & r.resultant[3:].any(axis=0)
    return np.where(turns, LENGTH, 1.0)
