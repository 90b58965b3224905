"""Rows of bilateral constraints as conditions on a velocity, and the columns of J that are independent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rbd.arrays import Array, as_array, check_finite, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.manifold import CLOSED, StackedRows, own_or
from rbd.errors import InputError
from rbd.mechanism.closure import SINGULAR, position_residual
from rbd.model.state import State, check_state

Rates = Mapping[str, "float | Sequence[float] | Array"]


def independent_columns(J: Array, last: Array | None = None) -> list[int]:
    """Columns left after selecting the best conditioned basis one by one; those marked `last` are selected last."""
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


class BilateralVelocities:
    """Rows of bilateral constraints at a state, as conditions on its velocity: J v = u."""

    def __init__(self, state: State, constraints: Sequence[Constraint] | None, loops: bool) -> None:
        self.state, self.joints = check_state(state), state.robot.joints
        self.given = own_or(state.robot, constraints, loops)
        found = self.rows(state if not state.v.any() else state.with_velocity(state.robot.zero_v))
        self.J, self.u, self.row_names = found.J, -found.velocity, [name for name, _ in found.names]

    def rows(self, state: State) -> StackedRows:
        """The bilateral rows.

        Raises:
            InputError: a constraint can slip or break, or is not assembled.
        """
        out = []
        for r in rows_of(state, self.given):
            if not len(r) or r.cone.bounded or r.cone.one_sided:
                continue  # joint limits and friction depend on forces
            if not r.cone.bilateral:
                raise InputError(
                    f"{r.name!r:.80} can slip or break ({type(r.cone).__name__}): forces decide whether it sticks (rbd.solve). "
                    "Give it friction=None to make it bilateral."
                )
            error, _ = position_residual(r)
            if max_abs(error) > CLOSED * max(1.0, self.joints.reach):
                raise InputError(
                    f"{state.robot.name} is not assembled: {r.name!r:.80} is off by {max_abs(error):.3g} m (or rad). "
                    "Close it first, with rbd.mechanism.assemble."
                )
            out.append(r)
        return StackedRows(state, out)

    def values(self, known: Rates, what: str) -> tuple[Array, Array]:
        """(which velocities are known, their values), both (nv,)."""
        if not isinstance(known, Mapping):
            raise InputError(f"known is {known!r:.80}; expected a mapping {{joint: {what}}}, e.g. {{'crank': 1.0}}.")
        mask, out = np.zeros(self.state.robot.nv, bool), np.zeros(self.state.robot.nv)
        for name, value in known.items():
            at = self.joints.velocity(name)
            given = np.atleast_1d(as_array(f"known {what} of {name!r:.80}", value))
            if given.shape != (at.stop - at.start,):
                raise InputError(f"known {what} of {name!r:.80} has shape {given.shape}; expected ({at.stop - at.start},).")
            check_finite(f"known {what} of {name!r:.80}", given)
            if mask[at].any():
                raise InputError(f"known {what} of {name!r:.80} is given twice: once for the joint, once for a part of it.")
            mask[at], out[at] = True, given
        return mask, out
