"""`ManyAnswers`: the arrays over states that all kinds of answers have, and the warnings of single answers, counted."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from rbd.answers.many.states import ManyStates
from rbd.answers.many.world_forces import forces_of
from rbd.arrays import Array, lazy, locked
from rbd.constraints.constraint import Constraint, is_open
from rbd.constraints.distance_warnings import joint_bounds
from rbd.errors import (
    DistantContactWarning,
    EffortLimitWarning,
    InaccurateWarning,
    InputError,
    JointLimitWarning,
    LoopNotClosedWarning,
    MovingConstraintWarning,
    NonUniqueMotionWarning,
    OpeningContactWarning,
    RbdError,
    RbdWarning,
    Reason,
    SpeedLimitWarning,
)
from rbd.problem.answer import ACCELERATION, CERTIFICATE, FORCES, Answer, StateStatus, force_variables
from rbd.problem.rows import Rows
from rbd.records import Axis, Field, dataset

if TYPE_CHECKING:
    import xarray

RESIDUALS = ("stationarity", "feasibility", "cone", "complementarity", "centroidal")
"""Their names in the order of `Residuals.values`."""
OF_FORCES = ("forces", "corner_forces", "friction_used", "centre_of_pressure")
"""What follows from the weights when it is first read."""


_ONE = {line.name: line for line in (*CERTIFICATE, *FORCES)}


@dataclass(frozen=True, eq=False, repr=False)
class ManyAnswers:
    """Answers at n states of one robot, as arrays; row i is NaN where there is no answer at state i.

    Attributes:
        states: The robot, q, v and what acts at each state.
        a: Accelerations, shape (n, nv) [m/s2, rad/s2].
        residuals: {equation: scaled residual, shape (n,)}, recomputed from each answer; as `Residuals.scaled`.
        status: A `StateStatus` of each state, shape (n,), integers.
        reason_codes: `rbd.errors.Reason.code` of each state, shape (n,), integers; 0 where there is an answer.
        reasons: {state: message} where it is not solved.
        method_codes: Which of `methods` answered, shape (n,), integers; -1 where none did.
        methods: Names of the methods that answered.
        one_by_one: Which states were answered one by one, by `rbd.solve`'s way for all constraints, shape (n,), truth values.
        warned: {what: states that a single answer would have warned of, shape (n,), truth values}; only kinds that occurred.
    """

    states: ManyStates
    a: Array
    residuals: Mapping[str, Array]
    status: Array
    reason_codes: Array
    reasons: Mapping[int, str]
    method_codes: Array
    methods: tuple[str, ...]
    one_by_one: Array
    warned: Mapping[str, Array]
    _sheet: Sheet

    fields: ClassVar[tuple[Field, ...]] = (
        replace(_ONE["status"], value=None),
        replace(_ONE["worst_residual"], value=lambda found: found.worst),
        replace(_ONE["residuals"], value=None),
        ACCELERATION,
        Field("tau", ("motor",), "{}", "motor torques, by motor", default=False),
        replace(_ONE["forces"], value=lambda found: force_variables(found.forces, found.friction_used)),
        *(replace(_ONE[name], value=None) for name in ("corner_forces", "friction_used", "centre_of_pressure")),
        Field("q", ("position",), "{}", "configuration", lambda found: found.states.q, default=False),
        Field("v", ("velocity",), "{}/s", "velocities", lambda found: found.states.v, default=False),
        Field("method", (), "", "method that found it", default=False),
    )

    @property
    def forces(self) -> Mapping[str, Array]:
        """{constraint: (n, 3) of a point, (n, 6) of a surface}, on the robot, world axes [N, N m]; row forces (n, m) of others.

        Zero where it is inactive. Computed when it is first read, as are the next three.
        """
        return self._tables["forces"]

    @property
    def corner_forces(self) -> Mapping[str, Array]:
        """{contact: forces at its corners (n, k, 3)}, world axes [N]."""
        return self._tables["corner_forces"]

    @property
    def friction_used(self) -> Mapping[str, Array]:
        """{contact: `|f_t| / (mu f_n)` of its net force, shape (n,)}; NaN without load or coefficient."""
        return self._tables["friction_used"]

    @property
    def centre_of_pressure(self) -> Mapping[str, Array]:
        """{contact: point of the patch's plane, in W, shape (n, 3) [m]}; NaN without load."""
        return self._tables["centre_of_pressure"]

    @lazy
    def _tables(self) -> dict[str, dict[str, Array]]:
        return self._sheet.with_forces(self._chosen).tables

    def _chosen(self, i: int) -> tuple[Answer, Mapping[str, Array]]:
        """The answer of state i, and forces at its corners, where its forces are one choice of many."""
        raise NotImplementedError

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates."""
        return self.states.robot.coordinate_axes

    def __len__(self) -> int:
        return len(self.status)

    @property
    def answered(self) -> Array:
        """At which states there is an answer, solved or inaccurate, shape (n,), of truth values."""
        return np.asarray(self.status <= StateStatus.INACCURATE)

    @property
    def worst(self) -> Array:
        """The largest scaled residual of each state, shape (n,); NaN where nothing was solved."""
        if not self.residuals:
            return np.full(len(self), np.nan)
        return np.asarray(np.fmax.reduce(list(self.residuals.values())))

    @property
    def method(self) -> Array:
        """Which method answered at each state, shape (n,), words as in `Answer.method`; empty where none did."""
        return np.array([*self.methods, ""])[self.method_codes]

    @property
    def counts(self) -> dict[str, int]:
        """{status in words: number of states}, those that occur."""
        found, numbers = np.unique(self.status, return_counts=True)
        return {StateStatus(code).words: int(n) for code, n in zip(found.tolist(), numbers, strict=True)}

    def index(self, i: int) -> int:
        """A state's number, from 0, of one counted from the end too.

        Raises:
            InputError: no whole number.
            IndexError: there is no such state.
        """
        if isinstance(i, bool) or not isinstance(i, int | np.integer):
            raise InputError(
                f"a state's number is {i!r:.80}; expected a whole number. Arrays over all states are in its fields."
            )
        if not -len(self) <= i < len(self):
            raise IndexError(f"there is no state {int(i)}: there are {len(self)}.")
        return int(i) % len(self)

    def to_xarray(self) -> xarray.Dataset:
        """An xarray.Dataset of all arrays, with named dimensions, labels and units.

        Needs the extra `study`: pip install 'rbd-contact[study]'.

        Raises:
            InputError: xarray is not installed; names the extra.
        """
        robot, along = self.states.robot, {"state": np.arange(len(self))}
        friction = Field("", (), "1", "", lambda found: found.states.friction, "friction_{}", "coefficient of {}")
        named = [each for line in (*self.fields, friction) for each in line.variables(self)]
        about = {"title": f"{len(self)} states of {robot.name}", "frames": "W, z up; forces are those on the robot"}
        return dataset(named, along, about).assign_coords(robot.unit_coordinates)

    def _told(self) -> list[str]:
        """Lines: methods, warnings and the first reason of each kind."""
        lines = []
        for i, name in enumerate(self.methods):
            if count := int((self.method_codes == i).sum()):
                lines.append(f"  {count:>8} by {name or 'the solver'}")
        lines += [f"  {int(some.sum()):>8} with a warning: {what}" for what, some in self.warned.items()]
        for code in np.unique(self.status[self.status > StateStatus.SOLVED]).tolist():
            first = int(np.argmax(self.status == code))
            lines.append(f"  {int((self.status == code).sum()):>8} {StateStatus(code).words}, the first at state {first}:")
            lines.append(f"           {self.reasons.get(first, ''):.300}")
        return lines

    def _worst_words(self) -> str:
        worst = self.worst[self.answered]
        return f"worst residual {worst.max():.1e}" if len(worst) else "no answers"

    def __repr__(self) -> str:
        told = ", ".join(f"{n} {words}" for words, n in self.counts.items()) or "no states"
        return f"{type(self).__name__}({len(self)} states of {self.states.robot.name!r}: {told}; {self._worst_words()})"

    def __str__(self) -> str:
        return "\n".join([repr(self), *self._told()])


class BlockAnswer(NamedTuple):
    """What a plan finds at n states.

    Attributes:
        good: Which are certified, shape (n,), truth values; the other rows mean nothing.
        a: Accelerations, shape (n, nv).
        w: Weights of the plan's columns, shape (n, p).
        misses: Upper bounds of the scaled residuals, in the order of `RESIDUALS`, shape (n, 5).
        methods: What found them, words, shape (n,).
        chosen: Whose forces are one choice of many, which are chosen when they are first read, shape (n,), truth values.
        warned: {what: states that a single answer would have warned of, shape (n,), truth values}.
    """

    good: Array
    a: Array
    w: Array
    misses: Array
    methods: Array
    chosen: Array
    warned: dict[str, Array]


class Sheet:
    """The arrays of n answers while they are filled, state by state or block by block."""

    def __init__(self, states: ManyStates) -> None:
        self.states, self.n = states, len(states)
        self.a, self.weights = np.full((self.n, states.robot.nv), np.nan), np.zeros((self.n, 0))
        self.tables: dict[str, dict[str, Array]] = {kind: {} for kind in (*OF_FORCES, "residuals", "warned")}
        self.status = np.full(self.n, StateStatus.FAILED, np.int8)
        self.reason_codes = np.full(self.n, Reason.NO_SOLUTION.code, np.int16)
        self.reasons: dict[int, str] = {}
        self.codes = np.full(self.n, -1, np.int8)
        self.methods: dict[str, int] = {}
        self.one_by_one, self.chosen = np.zeros(self.n, bool), np.zeros(self.n, bool)

    def table(self, kind: str, name: str, *shape: int) -> Array:
        """The array of one name, rows of at least this shape; NaN where nothing was written."""
        found = self.tables[kind].get(name)
        if found is None:
            found = self.tables[kind][name] = np.full((self.n, *shape), np.nan)
        elif found.shape[1] < shape[0]:  # rows and points of some kinds appear and disappear
            wider = np.zeros((self.n, *shape))
            wider[:, : found.shape[1]] = found
            found = self.tables[kind][name] = wider
        return found

    def column(self, kind: str, name: str) -> Array:
        """One number a state."""
        found = self.tables[kind].get(name)
        if found is None:
            empty = np.zeros(self.n, bool) if kind == "warned" else np.full(self.n, np.nan)
            found = self.tables[kind][name] = empty
        return found

    def code(self, method: str) -> int:
        """The number of a method."""
        return self.methods.setdefault(method, len(self.methods))

    def refuse_bad_input(self) -> None:
        """The states that are no input."""
        for i, message in self.states.refused.items():
            self.refuse(i, InputError(f"at state {i}: {message}"))

    def refuse(self, i: int, error: RbdError) -> None:
        """State i has no answer, for the reason that an error gives."""
        reason = Reason.of(error)
        self.status[i], self.reason_codes[i] = StateStatus.of_reason(reason), reason.code
        self.reasons[i] = str(error)

    def write(self, i: int, answer: Answer, corners: Mapping[str, Array]) -> None:
        """The answer of state i, with its residuals; NaN where its residuals say that it is none.

        Args:
            i: The state.
            answer: Its answer.
            corners: Forces at the corners of its contacts.
        """
        self.status[i], self.reason_codes[i] = StateStatus.of_answer(answer.status), answer.status.reason.code
        for name, value in answer.residuals.scaled.items():
            self.column("residuals", name)[i] = value
        self.codes[i] = self.code(answer.method or answer.solver)
        self.one_by_one[i] = True
        if self.status[i] > StateStatus.INACCURATE:
            self.reasons[i] = answer.reason or answer.worst
            return
        self.a[i] = answer.a
        self.write_forces(i, answer, corners)

    def write_forces(self, i: int, answer: Answer, corners: Mapping[str, Array]) -> None:
        """Those of state i; arguments as of `write`."""
        for name, force in answer.forces.items():
            _put(self.table("forces", name, len(force)), i, force)
        for name, force in corners.items():
            _put(self.table("corner_forces", name, len(force), 3), i, force)
        for name, contact in answer.contacts.items():
            used, pressure = contact.friction_used, contact.centre_of_pressure
            self.column("friction_used", name)[i] = np.nan if used is None else used
            self.table("centre_of_pressure", name, 3)[i] = np.nan if pressure is None else pressure

    def write_block(self, part: Array, found: BlockAnswer) -> None:
        """The certified rows of a block.

        Args:
            part: Numbers of its states.
            found: Their answers.
        """
        good, at, p = found.good, part[found.good], found.w.shape[1]
        self.widen(p)
        self.a[at], self.weights[at, :p], self.chosen[at] = found.a[good], found.w[good], found.chosen[good]
        self.status[at], self.reason_codes[at] = StateStatus.SOLVED, Reason.NONE.code
        for method in dict.fromkeys(found.methods[good].tolist()):
            self.codes[part[good & (found.methods == method)]] = self.code(method)
        for name, values in zip(RESIDUALS[:4], found.misses.T, strict=False):
            self.column("residuals", name)[at] = values[good]
        for what, some in found.warned.items():
            if some.any():
                self.column("warned", what)[at] = some[good]

    def put(self, part: Array, other: Sheet) -> None:
        """What another sheet has of some states, whose numbers here are consecutive."""
        for name in ("a", "status", "reason_codes", "one_by_one", "chosen"):
            getattr(self, name)[part] = getattr(other, name)
        self.widen(other.weights.shape[1])
        self.weights[part, : other.weights.shape[1]] = other.weights
        codes = np.array([*(self.code(method) for method in other.methods), -1])
        self.codes[part] = codes[other.codes]
        self.reasons.update({int(part[i]): told for i, told in other.reasons.items()})
        for kind, tables in other.tables.items():
            for name, values in tables.items():
                if values.ndim == 1:
                    self.column(kind, name)[part] = values
                else:
                    _put(self.table(kind, name, *values.shape[1:]), part, values)

    def widen(self, p: int) -> None:
        """Room for the weights of p columns."""
        if p > self.weights.shape[1]:
            self.weights = np.pad(self.weights, ((0, 0), (0, p - self.weights.shape[1])))

    def with_forces(self, chosen: Callable[[int], tuple[Answer, Mapping[str, Array]]]) -> Sheet:
        """The same with forces of the answers in blocks.

        Args:
            chosen: The answer of a state whose forces are one choice of many, and those at its corners.
        """
        out, lost = copy(self), self.status > StateStatus.INACCURATE
        out.tables = {kind: {name: x.copy() for name, x in self.tables[kind].items()} for kind in OF_FORCES}
        some = np.flatnonzero(~lost & ~self.one_by_one)
        for kind, name, part, values in forces_of(self.states, some, self.weights) if len(some) else ():
            if kind == "friction_used":
                out.column(kind, name)[part] = values
            else:
                _put(out.table(kind, name, *values.shape[1:]), part, values)
        for i in np.flatnonzero(self.chosen).tolist():
            out.write_forces(i, *chosen(i))
        for x in [x for table in out.tables.values() for x in table.values()]:
            x[lost] = np.nan
            locked(x)
        return out

    def fields(self) -> dict[str, Any]:
        """The fields of a `ManyAnswers`, read-only."""
        tables = [x for kind in ("residuals", "warned") for x in self.tables[kind].values()]
        for array in (self.a, self.weights, self.status, self.reason_codes, self.codes, self.one_by_one, *tables):
            locked(array)
        warned = {what: some for what, some in self.tables["warned"].items() if some.any()}
        residuals = {name: self.tables["residuals"][name] for name in RESIDUALS if name in self.tables["residuals"]}
        return {
            "states": self.states, "a": self.a, "residuals": residuals, "warned": warned, "status": self.status,
            "reason_codes": self.reason_codes, "reasons": self.reasons, "method_codes": self.codes,
            "methods": tuple(self.methods), "one_by_one": self.one_by_one, "_sheet": self,
        }  # fmt: skip


def _put(table: Array, at: Any, values: Array) -> None:
    """Values of one state, or of many, into rows that may be longer."""
    table[at] = 0.0
    table[at, : values.shape[np.ndim(at)]] = values


TORQUE, DISTANT, MOVES, OPENED, LOOP, SEVERAL, INACCURATE, SPEED, LIMIT = (
    "a torque is beyond its effort limit",
    "a contact is off its plane",
    "a bilateral constraint moves",
    "a contact separates and carries no force",
    "a loop is open",
    "more than one motion satisfies the law",
    "inaccurate",
    "a joint is faster than its motor can turn",
    "a joint is beyond its limits",
)
WARNINGS: dict[str, type[RbdWarning]] = {
    TORQUE: EffortLimitWarning,
    DISTANT: DistantContactWarning,
    MOVES: MovingConstraintWarning,
    OPENED: OpeningContactWarning,
    LOOP: LoopNotClosedWarning,
    SEVERAL: NonUniqueMotionWarning,
    INACCURATE: InaccurateWarning,
    SPEED: SpeedLimitWarning,
    LIMIT: JointLimitWarning,
}
"""The warning of each kind."""


def of_rows(constraints: Sequence[Constraint], rows: Sequence[Rows]) -> list[str]:
    """Kinds that the rows of one state give."""
    told = [DISTANT] if any(r.overlaps or r.gaps_off_plane is not None for r in rows) else []
    if any(is_open(constraint, r) for constraint, r in zip(constraints, rows, strict=True)):
        told.append(LOOP)
    return told


def beyond_limits(states: ManyStates) -> Array:
    """At which states some joint is beyond its limits, shape (n,), of truth values; see `warn_of_limits`."""
    low, high = joint_bounds(states.robot, states.constraints)
    with np.errstate(invalid="ignore"):
        return np.asarray(((states.q < low) | (states.q > high)).any(axis=1))


def warn(found: ManyAnswers, *, stacklevel: int) -> None:
    """One warning for each kind that occurred.

    Args:
        found: The answers.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    for what, some in found.warned.items():
        warnings.warn(
            f"{what} at {int(some.sum())} of {len(found)} states of {found.states.robot.name}, the first of them state "
            f"{int(some.argmax())}; `.warned[{what!r}]` says which, and the answer of one state says more.",
            WARNINGS[what],
            stacklevel=stacklevel + 1,
        )
