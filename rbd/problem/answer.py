"""`Answer`: what a solver returns, with residuals, status, forces, and each contact's friction used and centre of pressure.

Residuals are recomputed from the problem, never taken from the solver. Analysis beyond them (force distribution,
uniqueness, why there is no answer, derivatives) belongs to `rbd.Solution`, which holds an answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any, ClassVar

import numpy as np

from rbd.arrays import Array, lazy, rank_of, zeros
from rbd.displayed import Displayed
from rbd.errors import Reason
from rbd.problem.cones import friction_used
from rbd.problem.corner_cones import WrenchCone
from rbd.problem.force_set import ForceSet
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import SOLVED, USABLE, Residuals, blame, residuals_of
from rbd.problem.rows import Patch, Rows, by_rows
from rbd.records import AXES, SPATIAL, Axis, Field, Variable, key, share, vector

CARRIES_NOTHING_N = 1e-6
"""Below this normal force [N] a contact counts as unloaded: no friction ratio and no centre of pressure are given."""


@dataclass(frozen=True, eq=False)
class ContactForce(Displayed):
    """One contact's force and where it acts.

    Attributes:
        force: On the robot, world axes, shape (3,) [N].
        normal: Along the contact's normal [N]; positive when it pushes.
        tangential: Norm of the tangential component [N].
        friction_used: |f_t| / (mu f_n), of the true cone: may exceed 1 in a circumscribed pyramid; None where
            there is no friction coefficient or no load. For a surface: of its net force; None on planes of different normals.
        centre_of_pressure: Point of the patch's plane about which the tangential moment vanishes, in W, shape (3,) [m];
            None where the foot is unloaded.
    """

    force: Array
    normal: float
    tangential: float
    friction_used: float | None
    centre_of_pressure: Array | None

    @classmethod
    def of(cls, patch: Patch, force: Array) -> ContactForce:
        """Parts of a contact's force (3,) or wrench (6,), given at the patch's point in world axes."""
        f = patch.axes.T @ force[:3]
        normal, tangential = float(f[2]), math.hypot(f[0], f[1])
        if normal < CARRIES_NOTHING_N:
            return cls(force[:3], normal, tangential, None, None)
        used = friction_used(patch.friction, f) if patch.turned is None else None
        cop = patch.point
        if len(force) == 6:
            t = patch.axes.T @ force[3:]
            cop = patch.point + patch.axes @ np.array([-t[1] / normal, t[0] / normal, 0.0])
        return cls(force[:3], normal, tangential, used, cop)

    def __str__(self) -> str:
        where = "-" if self.centre_of_pressure is None else f"{vector(self.centre_of_pressure)} m"
        return f"{self.normal:>9.3f} N{self.tangential:>11.3f} N{share(self.friction_used):>15}  {where}"


def corner_split(rows: Rows, f: Array) -> Array:
    """Minimum-norm corner forces (k, 3) in world axes, of either sign, that add up to row forces f."""
    assert rows.patch is not None
    k = len(rows.patch.corners)
    if not len(f):
        return np.zeros((k, 3))
    if k == 1:
        assert rows.resultant is not None
        return (rows.resultant @ f)[:3].reshape(1, 3)
    if rows.cone.separate:
        local = np.zeros((k, 3))
        local[:, 3 - len(f) // k :] = f.reshape(k, -1)
    else:
        local = np.linalg.lstsq(corner_map(rows), f, rcond=None)[0].reshape(k, 3)
    return local @ rows.patch.axes.T


def corners_of(rows: Rows, f: Array, sets: ForceSet, w: Array, number: int) -> Array:
    """Forces at the points of a contact (k, 3) in world axes: what its weights give, else the split of minimum norm.

    Args:
        rows: Rows with a patch.
        f: Its row forces, shape (m,).
        sets: The force set of all rows.
        w: All weights, shape (p,).
        number: Number of the contact among the rows.
    """
    assert rows.patch is not None
    at_points = sets.point_map(number) if len(rows) and not rows.cone.bilateral else None
    return corner_split(rows, f) if at_points is None else in_world(rows.patch, (at_points @ w).reshape(-1, 3))


def in_world(patch: Patch, forces: Array) -> Array:
    """Forces in the axes of a patch's corners, shape (k, 3), in world axes."""
    if patch.turned is None:
        return forces @ patch.axes.T
    return np.asarray((patch.corner_axes @ forces[:, :, None])[:, :, 0])


def at_corners(patch: Patch, forces: Array) -> Array:
    """Forces in world axes, shape (k, 3), in the axes of a patch's corners: tangent, tangent, normal."""
    return forces @ patch.axes if patch.turned is None else np.asarray((forces[:, None] @ patch.corner_axes)[:, 0])


def corner_map(rows: Rows) -> Array:
    """Row forces of corner forces in contact axes, shape (5 or 6, 3k); a line transmits no moment about its own axis."""
    assert rows.patch is not None
    C = WrenchCone(rows.patch.corners, 0.0).corner_map
    return np.delete(C, 3, axis=0) if len(rows) == 5 else C


class Status(StrEnum):
    """Status of an answer, by its residuals: solved, inaccurate, failed or infeasible.

    Example:
        >>> box = rbd.testing.box()
        >>> solution = rbd.solve(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), [])
        >>> print(solution.status is rbd.problem.Status.SOLVED, [str(status) for status in rbd.problem.Status])
        True ['solved', 'inaccurate', 'failed', 'infeasible']
    """

    SOLVED = "solved"
    """Every scaled residual is at most 1e-9."""
    INACCURATE = "inaccurate"
    """Every scaled residual is at most 1e-7; a warning is issued."""
    FAILED = "failed"
    """A scaled residual is above 1e-7, or a contact approaches, which is an impact: not an answer."""
    INFEASIBLE = "infeasible"
    """Infeasible: reported by the solver, or shown by a certificate (`Solution.contradiction`)."""

    @property
    def reason(self) -> Reason:
        """Why there is no answer: `NO_SOLUTION` of failed, `CONTRADICTION` of infeasible; `NONE` where there is one."""
        return {Status.FAILED: Reason.NO_SOLUTION, Status.INFEASIBLE: Reason.CONTRADICTION}.get(self, Reason.NONE)


class StateStatus(IntEnum):
    """What became of one of many states; `solutions.reason_codes` says more where it has no answer, `solutions.reasons` all.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> v = np.zeros((2, solo.nv))
        >>> v[1, 2] = -0.1  # the second falls onto its feet
        >>> solutions = rbd.solve_many(solo, solo.standing().q, v, np.zeros(solo.nu), solo.feet())
        >>> [rbd.answers.many.StateStatus(status).words for status in solutions.status]
        ['solved', 'contact moves']
        >>> [str(rbd.errors.Reason.of_code(code)) for code in solutions.reason_codes]
        ['', 'contact_moves: impact']
    """

    SOLVED = 0
    """Every scaled residual is at most 1e-9."""
    INACCURATE = 1
    """Every scaled residual is at most 1e-7."""
    FAILED = 2
    """No answer within 1e-7 was found, though no certificate that there is none."""
    INFEASIBLE = 3
    """The constraints contradict each other."""
    CONTACT_MOVES = 4
    """A contact approaches, which is an impact, or moves as the law does not cover: `ContactMoves`."""
    BAD_INPUT = 5
    """Not finite, a quaternion off the unit sphere, or refused by a constraint: `InputError`."""
    UNSUPPORTED = 6
    """The solver cannot take the problem: `Unsupported`."""
    CANNOT_MOVE = 7
    """No torques and forces within their limits move the robot so: `CannotMove`."""

    @property
    def words(self) -> str:
        """In words, e.g. "contact moves"."""
        return self.name.lower().replace("_", " ")

    @property
    def reason(self) -> Reason:
        """The reason that it stands for, without detail; `NONE` where there is an answer."""
        return _REASON[self]

    @classmethod
    def of_answer(cls, status: Status) -> StateStatus:
        """The status of a state whose answer has this status.

        Args:
            status: Of the answer.
        """
        return cls[status.name]

    @classmethod
    def of_reason(cls, reason: Reason) -> StateStatus:
        """The status of a state that has no answer for this reason; `FAILED` for what has no status of its own.

        Args:
            reason: Of the error.
        """
        return _STATUS.get(reason) or _STATUS.get(reason.kind, cls.FAILED)


_REASON: dict[StateStatus, Reason] = {
    StateStatus.SOLVED: Reason.NONE,
    StateStatus.INACCURATE: Reason.NONE,
    StateStatus.FAILED: Reason.NO_SOLUTION,
    StateStatus.INFEASIBLE: Reason.CONTRADICTION,
    StateStatus.CONTACT_MOVES: Reason.CONTACT_MOVES,
    StateStatus.BAD_INPUT: Reason.BAD_INPUT,
    StateStatus.UNSUPPORTED: Reason.UNSUPPORTED,
    StateStatus.CANNOT_MOVE: Reason.CANNOT_MOVE,
}
_STATUS: dict[Reason, StateStatus] = {
    Reason.UNKNOWN_NAME: StateStatus.BAD_INPUT,
    Reason.DUPLICATE_NAME: StateStatus.BAD_INPUT,
    Reason.NOT_AT_REST: StateStatus.CONTACT_MOVES,
    Reason.CANNOT_HOLD: StateStatus.CANNOT_MOVE,
    **{reason: status for status, reason in _REASON.items() if reason is not Reason.NONE},
}


STATE_STATUS = {int(code): code.name.lower() for code in StateStatus}
"""{code: its meaning}, for variables of codes."""


def force_variables(forces: Mapping[str, Array], contacts: Collection[str]) -> dict[str, Variable]:
    """{constraint: its force}: (3,) or (6,) of a contact, else one entry a row; a constraint without rows has one of zero.

    Args:
        forces: {constraint: shape (..., m)}.
        contacts: Those whose force or wrench is on the robot, in world axes.
    """
    found = {}
    for name, values in forces.items():
        m, dim = values.shape[-1], f"{key(name)}_row"
        if not m:  # a limit that is not reached
            values, m = np.zeros((*values.shape[:-1], 1)), 1
        contact = name in contacts and m in (3, 6)
        unit = "N or N m" if not contact else "N" if m == 3 else "N, then N m"
        labels = SPATIAL[:m] if contact else tuple(map(str, range(m)))
        found[name] = Variable(values, (dim,), unit, f"force of {name}", {dim: labels})
    return found


def _of_contacts(what: str) -> Callable[[Any], dict[str, Any]]:
    """A quantity of each contact; NaN where there is none."""

    def of(found: Any) -> dict[str, Any]:
        return {name: getattr(contact, what) for name, contact in found.contacts.items()}

    return of


CERTIFICATE = (
    Field(
        "status", (), "", "solved, inaccurate, failed, ...: a code of rbd.answers.many.StateStatus",
        lambda found: np.int8(StateStatus[found.status.name]), flags=STATE_STATUS, certificate=True,
    ),
    Field(
        "worst_residual", (), "1", "largest scaled residual: the certificate of the answer",
        lambda found: found.residuals.worst, certificate=True,
    ),
    Field(
        "residuals", (), "1", "scaled residual of each equation",
        lambda found: found.residuals.scaled, "residual_{}", "scaled residual: {}", default=False,
    ),
    Field(
        "residual_sizes", (), "N, N m, m/s2, N m/s2", "residual of each equation, its largest entry in its unit",
        lambda found: {name: float(getattr(found.residuals, name)) for name in found.residuals.scaled},
        "residual_size_{}", "residual: {}", default=False,
    ),
)  # fmt: skip
"""Fields of every answer that certify it."""
ACCELERATION = Field("a", ("velocity",), "{}/s2", "accelerations, by velocity coordinate")
FORCES = (
    Field(
        "forces", (), "N, N m", "force or wrench of each constraint, on the robot, world axes",
        lambda found: force_variables(found.forces, found.contacts), "force_{}",
    ),
    Field(
        "corner_forces", ("{}_corner", "axis"), "N", "forces at the corners of each contact, world axes",
        None, "corner_forces_{}", "forces at the corners of {}", default=False,
    ),
    Field(
        "normal_force", (), "N", "normal force of each contact",
        _of_contacts("normal"), "normal_force_{}", "normal force of {}", default=False,
    ),
    Field(
        "friction_used", (), "1", "|f_t| / (mu f_n) of each contact; NaN without load or coefficient",
        _of_contacts("friction_used"), "friction_used_{}", "|f_t| / (mu f_n) of {}",
    ),
    Field(
        "centre_of_pressure", ("axis",), "m", "centre of pressure of each contact in W; NaN without load",
        _of_contacts("centre_of_pressure"), "centre_of_pressure_{}", "centre of pressure of {}", default=False,
    ),
)  # fmt: skip
"""Fields of the forces of an answer."""


class Gauss(float):
    """Gauss's function 1/2 |a - a_free|_M^2 [N m/s2], the sum of the constraints' shares.

    A float that also carries `shares`: {name: 1/2 f_i . J_i (a - a_free)}. A share may be negative: one constraint
    can push where another already pulls.
    """

    shares: dict[str, float]

    def __new__(cls, total: float, shares: dict[str, float]) -> Gauss:
        """A total with its shares."""
        self = super().__new__(cls, total)
        self.shares = shares
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return Gauss, (float(self), self.shares)


@dataclass(frozen=True, eq=False, repr=False)
class Answer(Displayed):
    """What a solver gives: acceleration and constraint forces of one `GaussProblem`.

    Attributes:
        problem: What was solved.
        a: Acceleration, shape (nv,) [m/s2, rad/s2]; on a floating base, linear then angular in the base's axes.
        multipliers: Row forces f, stacked as the rows are, shape (m,) [N, N m], on the robot.
        weights: Coefficients of the generators in `problem.force_set_of(law)`, shape (p,); None where all rows are bilateral.
        law: The law whose residuals are given; a solver may give it as a string, e.g. "convex, 4 facets".
        solver: Name of the solver.
        iterations: Number of iterations of the solver.
        seconds: Time in the solver [s].
        infeasible: Whether the solver reports that no acceleration satisfies the rows; see `Solution.contradiction` for the
            certificate.
        others: Other motions that satisfy the same law, where the solver found some (Painleve's paradox, jammed
            points).
        reason: The solver's message: why there is no answer, or which several motions there are; else empty.
        redundant: Whether rows depend on each other, so that f is not unique; a `Solution` takes the one of minimum norm.
        method: Which of its methods found it, e.g. "closed form", "QP" or "cones: Newton"; empty if it has only one.

    Example:
        >>> wall = rbd.Rows("wall", J=np.array([[-1.0, 0.0]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
        >>> problem = rbd.GaussProblem(M=np.diag([2.0, 1.0]), rhs=np.array([6.0, 1.0]), rows=[wall])
        >>> answer = rbd.ProxQP().solve(problem)
        >>> print(answer.status, answer.a.round(9), answer.multipliers.round(9))
        solved [0. 1.] [6.]
    """

    problem: GaussProblem
    a: Array
    multipliers: Array
    weights: Array | None
    law: Law
    solver: str
    iterations: int
    seconds: float
    infeasible: bool = False
    others: tuple[Answer, ...] = ()
    reason: str = ""
    redundant: bool = False
    method: str = ""

    fields: ClassVar[tuple[Field, ...]] = (
        *CERTIFICATE,
        ACCELERATION,
        *FORCES,
        Field("gauss", (), "N m/s2", "Gauss's function 1/2 |a - a_free|_M^2", default=False),
        Field("method", (), "", "method that found it", lambda found: found.method or found.solver, default=False),
        Field("law", (), "", "law of the contact forces", lambda found: str(found.law), default=False),
    )

    def __post_init__(self) -> None:
        if type(self.law) is not Law:
            object.__setattr__(self, "law", Law.of(self.law))

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates; none of a problem in arrays."""
        return getattr(getattr(self.problem.origin, "state", None), "coordinate_axes", AXES)

    @property
    def no_answer(self) -> tuple[Reason, str] | None:
        """Why this is no answer, and a message; None where it is one."""
        status = self.status
        if status in (Status.SOLVED, Status.INACCURATE):
            return None
        return status.reason, self.reason or self.impact or self.worst

    @property
    def a_free(self) -> Array:
        """Acceleration without the constraints, shape (nv,)."""
        return self.problem.a_free

    @lazy
    def residuals(self) -> Residuals:
        """How far a and f are from the equations of the law; see `Residuals`."""
        return residuals_of(self.problem, self.a, self.multipliers, self.weights, self.law)

    @property
    def status(self) -> Status:
        """`Status` that the residuals give."""
        if self.impact:
            return Status.FAILED
        if self.residuals.within(SOLVED):
            return Status.SOLVED
        if self.residuals.within(USABLE):
            return Status.INACCURATE
        return Status.INFEASIBLE if self.infeasible else Status.FAILED

    @property
    def worst(self) -> str:
        """Message: the constraint with the largest residual, and how large it is."""
        return blame(self.problem, self.a, self.multipliers, self.weights, self.law)

    @lazy
    def forces(self) -> dict[str, Array]:
        """Force (3,) of a point, wrench (6,) of a surface at its centre: on the robot, world axes [N, N m].

        A constraint without a resultant (a function, a joint) gives its row forces (m,).
        """
        return {r.name: r.force_of(part) for r, part in by_rows(self.problem.rows, self.multipliers)}

    @lazy
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return {r.name: ContactForce.of(r.patch, self.forces[r.name]) for r in self.problem.rows if r.patch is not None}

    @lazy
    def accelerations(self) -> dict[str, Array]:
        """J a + J_dot v of each constraint, shape (m,), in the constraint's axes, without feedback [m/s2, rad/s2]."""
        c = self.problem.J @ self.a + self.problem.bias
        return {name: c[part] for name, part in self.problem.slices.items()}

    @property
    def opening(self) -> tuple[str, ...]:
        """Names of the contacts and joint limits that are inactive, in whole or at some points, because they already separate.

        Faster than `GaussProblem.rest_speed`; `problem.openings` has their points and speeds.
        """
        return tuple(dict.fromkeys(point.rows for point in self.problem.openings))

    @property
    def impact(self) -> str:
        """Message: which contact approaches, an impact, which `rbd.solve` refuses. Empty where none does."""
        return self.problem.force_set.impact

    @lazy
    def gauss(self) -> Gauss:
        """Gauss's function [N m/s2] and each constraint's share of it."""
        P = self.problem
        moved = self.a - P.a_free if P.m else zeros(P.nv)  # of free motion they differ by rounding alone
        work = self.multipliers * (P.J @ moved)
        shares = {name: 0.5 * float(work[part].sum()) for name, part in P.slices.items()}
        return Gauss(0.5 * float(moved @ P.M @ moved), shares)

    @lazy
    def rank(self) -> int:
        """Rank of J, at singular values above `rbd.arrays.RANK` times the largest."""
        return rank_of(self.problem.J)

    def __repr__(self) -> str:
        kind = type(self).__name__
        return f"{kind}({self.status}, law {str(self.law)!r}, {self.solver}, worst residual {self.residuals.worst:.1e})"
