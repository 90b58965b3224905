"""Torques and forces of least effort at many states in array operations, for states in which they are inside all limits.

    minimise sum_i p_i (t - T x)_i^2 + r |x|^2     subject to     A x = b

is one linear system a state. Where its x is inside the cones, and the torques are within their limits, it is the answer of
`rbd.statics.effort`; elsewhere, and for what is not covered here, the conic program is solved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rbd.answers.many.states import ManyStates
from rbd.answers.prepared.many import BlockAnswer, ContactBlocks
from rbd.arrays import Array
from rbd.problem.residuals import SOLVED
from rbd.statics.effort import Effort


class LeastEffort(NamedTuple):
    """What was found at the n states of a block.

    Attributes:
        answer: Forces, residuals, and which states are certified; the others mean nothing.
        tau: Motor torques, shape (n, nu).
    """

    answer: BlockAnswer
    tau: Array


def least_effort_of(
    blocks: ContactBlocks, states: ManyStates, part: Array, tau_ext: Array, a: Array, mu: Array | None, effort: Effort,
    margin: float, rest_speed: float,
) -> LeastEffort:  # fmt: skip
    """Torques and forces of wanted motions whose contact points all keep still.

    Args:
        blocks: The prepared contacts.
        states: The states.
        part: Numbers of those of this block, shape (n,).
        tau_ext: Generalised forces of the world, shape (n, nv).
        a: Wanted accelerations, shape (n, nv).
        mu: Friction of the points, shape (n, k); None: the contacts' own.
        effort: What is made least; one weight for all forces, and no bounds on them.
        margin: Of friction.
        rest_speed: Contacts that move faster are not answered.
    """
    robot, q, v, T = states.robot, states.q[part], states.v[part], blocks.force_set
    unit = robot.force_unit
    limit = np.where(np.isfinite(robot.effort_limit), robot.effort_limit, unit)
    with blocks.bodies.lock:
        need, J, speeds, places = blocks.bodies.loads(q, v, a)
        need -= tau_ext
        per_weight = J.transpose(0, 2, 1) @ blocks.G
        A, b = per_weight[:, robot.unactuated], need[:, robot.unactuated] / unit
        push, load = per_weight[:, robot.actuated] * (unit / limit)[:, None], need[:, robot.actuated] / limit
        x = _minimisers(push, load, A, b, effort.torque_weights(robot.actuated_names), float(effort.forces))  # type: ignore[arg-type]
        w = x * unit
        tau = (need - (per_weight @ w[:, :, None])[:, :, 0])[:, robot.actuated]
        generalised = tau_ext.copy()
        generalised[:, robot.actuated] += tau
        method = np.zeros(len(part), np.int8)
        answer = blocks.judged(q, v, generalised, a, w @ blocks.G.T, w, places, method, coulomb=True, mu=mu)
    own = np.broadcast_to(T.mu, (len(part), len(T.mu))) if mu is None else mu
    cones = w[:, T.cone_columns]
    with np.errstate(invalid="ignore"):
        inside = (np.hypot(cones[..., 0], cones[..., 1]) <= (1.0 - margin) * own * cones[..., 2]).all(axis=1)
        least, most = robot.limits_at(v)
        inside &= ((least <= tau) & (tau <= most)).all(axis=1)
        answer.found[:] &= inside & (speeds <= rest_speed).all(axis=1) & (answer.still <= SOLVED)
    return LeastEffort(answer, tau)


def _minimisers(push: Array, load: Array, A: Array, b: Array, p: Array, r: float) -> Array:
    """The x of each state, shape (n, p), exact in A x = b to rounding; NaN where rows of A are dependent.

    Args:
        push: Torques over their limits of unit x, shape (n, nu, p).
        load: Torques over their limits without forces, shape (n, nu).
        A: Shape (n, e, p).
        b: Shape (n, e).
        p: Weights of the torques, shape (nu,).
        r: Weight of x.
    """
    n, e, size = A.shape
    K, right = np.zeros((n, size + e, size + e)), np.zeros((n, size + e, 1))
    weighed = push.transpose(0, 2, 1) * p
    K[:, :size, :size] = weighed @ push
    K[:, range(size), range(size)] += r
    K[:, :size, size:], K[:, size:, :size] = A.transpose(0, 2, 1), A
    right[:, :size], right[:, size:, 0] = weighed @ load[:, :, None], b
    try:
        x = np.linalg.solve(K, right)[:, :size]
        left = b[:, :, None] - A @ x
        x += A.transpose(0, 2, 1) @ np.linalg.solve(A @ A.transpose(0, 2, 1), left)
    except np.linalg.LinAlgError:
        return np.full((n, size), np.nan)
    return np.asarray(x[:, :, 0])
