"""Rows that hold at a state as J v = u, and which velocities are independent under them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from rbd.arrays import Array, as_array, check_finite, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.errors import InputError
from rbd.mechanism.closure import SINGULAR, listed, unmet
from rbd.mechanism.coordinates import coordinates_of
from rbd.mechanism.held import CLOSED, of_its_file
from rbd.model.state import State
from rbd.problem.cones import Box, Free, NonNegative
from rbd.problem.rows import Rows

_OWN = re.compile(r"(.+)\[(\d+)\]")

Rates = Mapping[str, "float | Sequence[float] | Array"]


def independent_velocities(
    state: State, constraints: Sequence[Constraint] | None = None, *, prefer: Sequence[str] = ()
) -> tuple[str, ...]:
    """Names of velocities that, once known, decide all others: as many as there are freedoms here.

    The others are chosen one after the other, each the column of J that is farthest from those chosen before (pivoted QR
    [GolubVanLoan2013]); the independent ones are left over. At a singular pose there are more than elsewhere.

    Args:
        state: The robot, assembled.
        constraints: As for `velocity_partition`.
        prefer: Joints that shall be independent where that is possible, as those with motors.

    Raises:
        InputError: As `velocity_partition`.
        JointNotFound: with the nearest names.
    """
    held = HeldVelocities(state, constraints)
    if isinstance(prefer, str) or not isinstance(prefer, list | tuple):
        raise InputError(f"prefer is {prefer!r:.80}; expected a list of joints' names.")
    last = np.zeros(state.robot.nv, bool)
    for joint in prefer:
        last[held.place(joint)] = True
    free = independent_columns(held.J * held.coordinates.metric, last)
    return tuple(held.coordinates.names[i] for i in free)


def independent_columns(J: Array, last: Array | None = None) -> list[int]:
    """Columns left when the best conditioned basis is taken out one by one; those marked `last` are taken last."""
    n = J.shape[1]
    last = np.zeros(n, bool) if last is None else last
    left, R = list(range(n)), J.copy()
    size = float(np.linalg.norm(J, 2)) if J.size else 0.0
    for group in (~last, last):
        while True:
            norms = np.linalg.norm(R, axis=0)
            candidates = [i for i in left if group[i] and norms[i] > SINGULAR * size]
            if not candidates or size == 0.0:
                break
            # The first of those within a thousandth of the longest, so that rounding does not choose.
            most = max(norms[i] for i in candidates)
            pivot = next(i for i in candidates if norms[i] >= 0.999 * most)
            unit = R[:, pivot] / norms[pivot]
            R = R - np.outer(unit, unit @ R)
            left.remove(pivot)
    return left


class HeldVelocities:
    """Rows that hold at a state: J v = u."""

    def __init__(self, state: State, constraints: Sequence[Constraint] | None) -> None:
        if not isinstance(state, State):
            raise InputError(f"a State was expected first, got {type(state).__name__}. Make one: rbd.State(robot, q).")
        self.state, self.coordinates = state, coordinates_of(state.robot)
        self.given = of_its_file(state.robot) if constraints is None else listed(constraints)
        rows = self.rows(state if not state.v.any() else state.with_velocity(state.robot.zero_v))
        self.J = np.vstack([np.zeros((0, state.robot.nv)), *(r.J for r in rows)])
        self.u = np.concatenate([np.zeros(0), *(-r.velocity for r in rows)])
        self.row_names = [r.name for r in rows for _ in range(len(r))]

    def rows(self, state: State) -> list[Rows]:
        """The rows that hold.

        Raises:
            InputError: something can slip or break, or is not assembled.
        """
        out = []
        for r in rows_of(state, self.given):
            if not len(r) or isinstance(r.cone, Box | NonNegative):
                continue  # a stop pushes when the forces say so; friction in a joint resists
            if not isinstance(r.cone, Free):
                raise InputError(
                    f"{r.name!r:.80} can slip or break ({type(r.cone).__name__}): whether it holds, forces decide, rbd.solve. "
                    "Give it friction=None to hold it."
                )
            error, _ = unmet(r)
            if max_abs(error) > CLOSED * max(1.0, self.coordinates.reach):
                raise InputError(
                    f"{state.robot.name} is not assembled: {r.name!r:.80} is off by {max_abs(error):.3g} m (or rad). "
                    "Close it first, with rbd.mechanism.assemble."
                )
            out.append(r)
        return out

    def place(self, name: str) -> slice:
        """Where a velocity of this name stands in v.

        Raises:
            JointNotFound: with the nearest names.
        """
        own = _OWN.fullmatch(name) if isinstance(name, str) and name not in self.coordinates.places else None
        if own is None:
            return self.coordinates.columns(name)
        span, k = self.coordinates.columns(own[1]), int(own[2][:9])
        if k >= span.stop - span.start:
            raise InputError(f"{name!r:.80}: joint {own[1]!r:.80} has {span.stop - span.start} velocities, counted from 0.")
        return slice(span.start + k, span.start + k + 1)

    def values(self, known: Rates, what: str) -> tuple[Array, Array]:
        """(which velocities are known, their values), both (nv,)."""
        if not isinstance(known, Mapping):
            raise InputError(f"known is {known!r:.80}; expected a mapping {{joint: {what}}}, e.g. {{'crank': 1.0}}.")
        mask, out = np.zeros(self.state.robot.nv, bool), np.zeros(self.state.robot.nv)
        for name, value in known.items():
            at = self.place(name)
            given = np.atleast_1d(as_array(f"known {what} of {name!r:.80}", value))
            if given.shape != (at.stop - at.start,):
                raise InputError(f"known {what} of {name!r:.80} has shape {given.shape}; expected ({at.stop - at.start},).")
            check_finite(f"known {what} of {name!r:.80}", given)
            if mask[at].any():
                raise InputError(f"known {what} of {name!r:.80} is given twice: once for the joint, once for a part of it.")
            mask[at], out[at] = True, given
        return mask, out
