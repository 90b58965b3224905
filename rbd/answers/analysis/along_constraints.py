"""The changes of a state along its constraints, where their rows are redundant on them and not beside them.

The closing hinge of a Bricard or Bennett mechanism has more rows than it takes away freedoms, at every configuration that is
closed; beside those the rows contradict each other. There an answer has derivatives along the constraints alone. A change
(dq, dv) of a state is along them where

    J_h dq = 0        J dv + D dq = 0        D = d(J v - u)/dq at fixed v

with J_h those of the rows that hold a position. Singular configurations, of which the rank is higher nearby on the constraints,
have no such derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import RANK, Array, max_abs
from rbd.constraints.constraint import anchored, is_carried, rows_of
from rbd.constraints.manifold import ConstraintManifold, null_space
from rbd.errors import InputError
from rbd.model.dynamics import HasRows
from rbd.model.state import State

AHEAD = 0.02
"""How far away the rank is compared [rad, or parts of the robot's length]."""
CLOSED = 1e-10
"""Largest error of the rows, dimensionless, of a configuration that counts as on the constraints."""
SAME = 1e-7
"""Singular values up to this count as zero where the rank is compared: at a singular pose they are of the order of AHEAD."""
_HELD = ("holds", "sticks")


@dataclass(frozen=True, eq=False)
class Projections:
    """A change dq, and a change dv, count as (Q dq, G dq) and (0, V dv), which are along the constraints.

    A change along them stays as it is: Q dq = dq, G dq + V dv = dv. Others are projected, by the least in units of the joints.

    Attributes:
        Q: Shape (nv, nv).
        G: Shape (nv, nv); zero at rest.
        V: Shape (nv, nv).
    """

    Q: Array
    G: Array
    V: Array


def projections(
    state: State, constraints: Sequence[HasRows], words: Mapping[str, tuple[str, ...]], D: Array
) -> Projections | None:
    """The projections of changes of a state onto those along its constraints.

    Args:
        state: The robot at (q, v).
        constraints: Those of the answer.
        words: {constraint: mode of each of its parts}.
        D: Change of the rows' velocities with q at fixed v, shape (m, nv).

    Returns:
        Those, or None where a contact may slip or open, where the state is off its constraints, or where their rank is higher
        nearby on them.
    """
    if any(word not in _HELD for said in words.values() for word in said):
        return None
    at_rest = state.with_velocity(state.robot.zero_v)
    put = [anchored(c, r, at_rest) for c, r in zip(constraints, rows_of(at_rest, constraints), strict=True)]
    manifold = ConstraintManifold.unchecked(at_rest, put, [is_carried(c) for c in put])
    rows, scale = manifold.rows(state), manifold.scale
    if len(rows.J) != len(D) or not manifold.placed.any() or not _keeps_its_rank(manifold):
        return None
    T_q, T_v = (null_space(J * scale, RANK)[0] for J in (rows.J[manifold.placed], rows.J))
    Q, V = (scale[:, None] * (T @ T.T) / scale for T in (T_q, T_v))
    G = -scale[:, None] * np.linalg.lstsq(rows.J * scale, D @ Q, rcond=RANK)[0]
    return Projections(Q, G, V)


def _keeps_its_rank(manifold: ConstraintManifold) -> bool:
    """Whether the state is on the constraints, and the rank of its rows is the same at configurations nearby on them."""
    here = manifold.at(manifold.q)
    rank = manifold.rank(here.J[manifold.placed], RANK)
    return max_abs(here.error) <= CLOSED and set(ranks_nearby(manifold)) <= {rank}


def ranks_nearby(manifold: ConstraintManifold) -> Iterator[int]:
    """Ranks of the rows that hold a position at four configurations nearby on the constraints, of those that are found.

    A rank above that of the state says that it is singular: motions branch there.
    """
    here, held = manifold.at(manifold.q), manifold.placed
    free, _ = null_space(here.J[held], RANK)
    rng = np.random.default_rng(0)
    for along in (free @ rng.normal(size=free.shape[1]) for _ in range(2)):
        for side in (AHEAD, -AHEAD) if along.any() else ():
            try:
                there = manifold.project(manifold.move(manifold.q, side / max_abs(along) * along))
            except InputError:  # a constraint may be undefined there
                continue
            if max_abs(there.error) <= CLOSED:
                yield manifold.rank(there.J[held], SAME)
