"""Many states of one robot, with torques, external forces and friction of each: checked and broadcast, in arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, lazy, locked
from rbd.constraints.constraint import Constraint, check_on, has_friction, made, member, with_loops
from rbd.errors import InputError, UnknownName, nearest
from rbd.errors.inputs import check_different
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.external import ExternalForce, ForceElement, acting, generalised, is_element
from rbd.model.joints import UNIT_TOLERANCE
from rbd.model.state import State
from rbd.problem.cones import Cone

Friction: TypeAlias = float | Sequence[float] | Array | Mapping[str, Any] | None
"""Coefficients in place of the contacts' own: a number, one a state (n,), or {contact: either}."""
ManyExternal: TypeAlias = Array | Sequence[Any] | ExternalForce | ForceElement | None
"""Generalised forces (nv,) or (n, nv), or `ExternalForce` objects and force elements that act at every state."""
Acting: TypeAlias = tuple[ExternalForce | ForceElement, ...]


_KEPT = 64
"""Sets of contacts with other friction that are kept."""


@dataclass(frozen=True, eq=False, repr=False)
class ManyStates:
    """n states of one robot, and what acts at each.

    An argument that is the same at all states is stored once: its array has n rows that share their memory.

    Attributes:
        robot: The robot.
        q: Configurations, shape (n, nq), quaternions normalised.
        v: Velocities, shape (n, nv).
        vectors: {"tau": (n, nu)} or {"a": (n, nv)}: what else was given, a row a state.
        constraints: As given.
        external: None, `ExternalForce` objects and force elements, or generalised forces (n, nv).
        friction: {contact: coefficients (n,)} where they replace those of the contacts.
        refused: {state: message} of states that are no input: not finite, or a quaternion off the unit sphere.
        t: Times, shape (n,) [s].
    """

    robot: CheckedModel
    q: Array
    v: Array
    vectors: Mapping[str, Array]
    constraints: tuple[Constraint, ...]
    external: Acting | Array | None
    friction: Mapping[str, Array]
    refused: Mapping[int, str]
    t: Array
    _made: dict[tuple[float, ...], tuple[Constraint, ...]] = field(default_factory=dict, repr=False)
    _applied: Array | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls,
        robot: CheckedModel,
        q: Array,
        v: Array | None,
        constraints: Sequence[Constraint],
        *,
        external: ManyExternal = None,
        friction: Friction = None,
        t: Array | float = 0.0,
        loops: bool = True,
        **vectors: Array | None,
    ) -> ManyStates:
        """Checked and broadcast; what is wrong at single states is noted in `refused`.

        Raises:
            InputError: what concerns all states: wrong sizes, numbers of states that differ, no robot, no constraints.
            UnknownName: frames that the robot does not have, friction of a contact that is not there.
            DuplicateName: two constraints of one name.
        """
        if not isinstance(robot, CheckedModel):
            raise InputError(f"a robot is wanted first, got {robot!r:.80}. Load one with rbd.load_robot(name).")
        given = _checked_constraints(robot, constraints, loops)
        tables = {"q": _Table("q", q, robot.nq, "nq")}
        tables["v"] = _Table("v", robot.zero_v if v is None else v, robot.nv, "nv")
        tables["t"] = _Table.column("t", t)
        for name, value in vectors.items():
            size, meaning = (robot.nu, "nu, one entry an actuated joint") if name == "tau" else (robot.nv, "nv")
            tables[name] = _Table(name, np.zeros(size) if value is None and name == "tau" else value, size, meaning)
        forces = _forces_of(robot, external)
        if isinstance(forces, _Table):
            tables["external"] = forces
        for name, value in _coefficients(given, friction).items():
            tables[f"friction of {name!r:.80}"] = _Table.column(f"friction of {name!r:.80}", value)
        n = _common({name: table.rows for name, table in tables.items()})
        refused: dict[int, str] = {}
        for table in tables.values():
            table.refuse(robot, n, refused)
        found = {name: table.broadcast(n) for name, table in tables.items()}
        mu = {name: found[f"friction of {name!r:.80}"][:, 0] for name in _coefficients(given, friction)}
        outer = found["external"] if isinstance(forces, _Table) else forces
        applied = None
        if isinstance(outer, tuple) and any([is_element(each) for each in outer]):
            applied = _applied(robot, found["q"], found["v"], outer, refused)
        vectors_found = {x: found[x] for x in vectors}
        return cls(robot, found["q"], found["v"], vectors_found, given, outer, mu, refused, found["t"][:, 0], _applied=applied)

    def __len__(self) -> int:
        return len(self.q)

    def part(self, some: Array) -> ManyStates:
        """Some of the states, which are consecutive."""
        at, first = slice(int(some[0]), int(some[-1]) + 1), int(some[0])
        external = self.external[at] if isinstance(self.external, np.ndarray) else self.external
        vectors, mu = ({name: x[at] for name, x in table.items()} for table in (self.vectors, self.friction))
        refused = {i - first: told for i, told in self.refused.items() if at.start <= i < at.stop}
        return replace(
            self, q=self.q[at], v=self.v[at], t=self.t[at], vectors=vectors, external=external, friction=mu, refused=refused,
            _made={}, _applied=None if self._applied is None else self._applied[at],
        )  # fmt: skip

    def state(self, i: int) -> State:
        """State i.

        Raises:
            InputError: it is no input.
        """
        self.refuse(i)
        return State(self.robot, self.q[i], self.v[i], t=float(self.t[i]))

    def refuse(self, i: int) -> None:
        """Raise what is wrong with state i.

        Raises:
            InputError: something is.
        """
        if i in self.refused:
            raise InputError(f"at state {i}: {self.refused[i]}")

    def external_at(self, i: int) -> Array | Acting | None:
        """The external forces at state i, as `rbd.solve` takes them."""
        return self.external[i] if isinstance(self.external, np.ndarray) else self.external

    def external_of(self, part: Array) -> Array:
        """tau_ext of some states, shape (n, nv)."""
        table = self._applied if self._applied is not None else self.external
        if isinstance(table, np.ndarray):
            return np.array(table[part])
        out = np.zeros((len(part), self.robot.nv))
        if self.external is not None:
            for row, i in zip(out, part.tolist(), strict=True):
                row += generalised(self.state(i), self.external)[0]
        return out

    def acting_on(self, part: Array) -> tuple[list[ExternalForce], Array]:
        """(forces of the world that plans take as they are, tau_ext of all else, shape (n, nv)) at some states."""
        _, pushes, elements = acting(self.external)
        if pushes and not elements:
            return pushes, np.zeros((len(part), self.robot.nv))
        return [], self.external_of(part)

    @lazy
    def point_friction(self) -> Array | None:
        """Coefficients of all points with friction, shape (n, k), NaN where plans cannot have another; None: contacts' own."""
        given = [(c, len(member(c, "corners")), member(c, "friction")) for c in self.constraints if has_friction(c)]
        columns = [
            np.broadcast_to(np.nan if isinstance(own, Cone) or not own else self.friction.get(c.name, own), len(self))
            for c, k, own in given if self.friction for _ in range(k)
        ]  # fmt: skip
        return np.stack(columns, axis=1) if columns else None

    def constraints_at(self, i: int) -> tuple[Constraint, ...]:
        """The constraints at state i, with its friction."""
        if not self.friction:
            return self.constraints
        mu = tuple([float(table[i]) for table in self.friction.values()])
        found = self._made.get(mu)
        if found is None:
            by_name = dict(zip(self.friction, mu, strict=True))
            found = tuple([
                c.with_friction(by_name[c.name]) if c.name in by_name else c  # type: ignore[attr-defined]
                for c in self.constraints
            ])  # fmt: skip
            if len(self._made) < _KEPT:  # sweeps repeat them
                self._made[mu] = found
        return found

    def __repr__(self) -> str:
        return f"ManyStates({len(self)} of {self.robot.name!r})"


class _Table:
    """An argument with a row a state, or one row for all of them."""

    def __init__(self, what: str, value: object, size: int, meaning: str) -> None:
        self.what, found = what, as_array(what, value)
        if found.ndim not in (1, 2) or found.shape[-1] != size:
            hint = " tau has no entry for the floating base." if what == "tau" and found.ndim else ""
            raise InputError(f"{what} has shape {found.shape}; expected ({size},) or (n, {size}): {meaning}.{hint}")
        self.rows = None if found.ndim == 1 else len(found)
        self.values = found.reshape(-1, size) if size else np.zeros((1 if found.ndim == 1 else len(found), 0))

    @classmethod
    def column(cls, what: str, value: object) -> _Table:
        """Of one number a state, or one for all."""
        found = as_array(what, value)
        if found.ndim > 1:
            raise InputError(f"{what} has shape {found.shape}; expected a number, or (n,), one a state.")
        return cls(what, found.reshape(-1, 1) if found.ndim else found.reshape(1), 1, "one number a state")

    def refuse(self, robot: CheckedModel, n: int, refused: dict[int, str]) -> None:
        """Note the rows that are no input; normalise quaternions.

        Raises:
            InputError: the one row for all states is none.
        """
        good = self._good(robot)
        for i in np.flatnonzero(~good).tolist():
            message = self._message(robot, self.values[i])
            if self.rows is None:
                raise InputError(message)
            for state in [i] if self.rows == n else range(n):  # one row given for n states
                refused.setdefault(state, message)

    def _good(self, robot: CheckedModel) -> Array:
        x = self.values
        with np.errstate(all="ignore"):
            if self.what.startswith("friction"):
                return np.asarray((x[:, 0] >= 0.0) & (x[:, 0] < 1e100))
            size = np.einsum("ij,ij->i", x, x)
            good = np.isfinite(size)
            if self.what in ("q", "v"):
                far = np.flatnonzero(~(size <= FARTHEST**2))  # a norm within it has entries within it
                good[far] &= np.abs(x[far]).max(axis=1, initial=0.0) <= FARTHEST
            if self.what == "q":
                units = [(p.q + p.unit.start, p.q + p.unit.stop) for p in robot.joints.pieces if p.unit.start < p.unit.stop]
                for begin, end in units:
                    norm = np.sqrt(np.einsum("ij,ij->i", x[:, begin:end], x[:, begin:end]))
                    good &= np.abs(norm - 1.0) <= UNIT_TOLERANCE
                    off = good & (np.abs(norm - 1.0) > 4e-16)  # two roundings
                    x[off, begin:end] /= norm[off, None]
        return np.asarray(good)

    def _message(self, robot: CheckedModel, row: Array) -> str:
        if self.what.startswith("friction"):
            return f"{self.what} is {row[0]}; expected a finite number of 0 or more."
        check = {"q": robot.check_q, "tau": robot.check_tau, "t": len}.get(self.what, lambda x: robot.check_v(x, self.what))
        try:
            check(row)
        except InputError as error:
            return str(error)
        return f"{self.what} is not finite."

    def broadcast(self, n: int) -> Array:
        """One row a state, read-only."""
        return locked(np.broadcast_to(self.values, (n, self.values.shape[1])) if len(self.values) != n else self.values)


def _common(rows: Mapping[str, int | None]) -> int:
    """The number of states."""
    counts = {name: n for name, n in rows.items() if n is not None}
    different = {n for n in counts.values() if n != 1}
    if len(different) > 1:
        told = ", ".join(f"{name} {n}" for name, n in counts.items())
        raise InputError(f"numbers of states differ: {told}. Give one row, or the same number of rows, in each argument.")
    return different.pop() if different else 1


def _checked_constraints(robot: CheckedModel, constraints: Sequence[Constraint], loops: bool) -> tuple[Constraint, ...]:
    given = with_loops(robot, constraints, loops)
    check_different([made(constraint).name for constraint in given], "constraints")
    for constraint in given:
        check_on(constraint, robot)
    return given


def _applied(robot: CheckedModel, q: Array, v: Array, external: Acting, refused: dict[int, str]) -> Array:
    """tau_ext of all states, shape (n, nv); where an element has no force, the state is refused with the reason."""
    out = np.zeros((len(q), robot.nv))
    for i in range(len(q)):
        if i in refused:
            continue
        try:
            out[i] = generalised(State(robot, q[i], v[i]), external)[0]
        except InputError as error:
            refused[i] = str(error)
    return out


def _forces_of(robot: CheckedModel, external: ManyExternal) -> _Table | Acting | None:
    if external is None:
        return None
    if isinstance(external, ExternalForce) or is_element(external):
        external = (external,)
    if not isinstance(external, np.ndarray):
        if not isinstance(external, Sequence) or isinstance(external, str | bytes):
            raise InputError(f"external is {external!r:.80}; {_WANTED}")
        known = [e for e in external if isinstance(e, ExternalForce) or is_element(e)]
        if len(known) == len(external):
            for each in known:
                if isinstance(each, ExternalForce):
                    robot.site(each.frame)
                elif callable(fits := getattr(each, "check_on", None)):
                    fits(robot)
            check_different([each.name for each in known if not isinstance(each, ExternalForce)], "force elements")
            return tuple(known)
        if known:
            raise InputError(f"external mixes forces and springs with something else; {_WANTED}")
    return _Table("external", external, robot.nv, f"nv; {_WANTED}")


_WANTED = "expected ExternalForces and force elements, or generalised forces (nv,) or (n, nv)."


def _coefficients(constraints: tuple[Constraint, ...], friction: Friction) -> dict[str, Any]:
    """{contact: its coefficients, as given}."""
    if friction is None:
        return {}
    replaced = [c.name for c in constraints if has_friction(c)]
    if not isinstance(friction, Mapping):
        if not replaced:
            raise InputError("friction is given, and no contact has a coefficient that it could replace.")
        return dict.fromkeys(replaced, friction)
    names = [c.name for c in constraints]
    for name in friction:
        if name not in names:
            raise UnknownName(f"friction is given for {name!r:.80}, which is no contact; {nearest(name, names)}.")
        if name not in replaced:
            raise InputError(f"friction is given for {name!r:.80}, which has no coefficient: it is bilateral, or no contact.")
    return dict(friction)
