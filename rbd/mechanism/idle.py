"""Idle freedoms: velocities at which one link of a loop turns by itself while all else is at rest, as a link between two balls.

A link between two balls spins about the line of their centres, a leg of a platform about that of its ends. Nothing else
moves with it, however far it turns: the other poses of a mechanism can be counted and followed as if it were at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, null_space
from rbd.model.inertial import body_names
from rbd.model.state import State

_REST = 1e-6
"""Velocity of a body, in units of the robot's length and of the largest velocity, below which it is at rest."""
_FAR = 0.5
"""Turn [rad] after which the loops must still be closed."""
_CLOSED = 1e-9


class IdleFreedom(NamedTuple):
    """An idle freedom.

    Attributes:
        joints: The joints of the bodies that turn as one.
        body: Name of the first of them.
    """

    joints: tuple[int, ...]
    body: str


def idle_freedoms(state: State, J: Array, free: Array, scale: Array, error: Callable[[Array], float]) -> list[IdleFreedom]:
    """The idle freedoms of a mechanism at a state: each body that can turn alone, or as one with others that do not bend.

    A freedom is idle if the bodies that move have one twist, others of the mechanism are at rest, the velocity is that of
    joints with several degrees of freedom, and a turn by 0.5 rad leaves the loops closed. A body with two such freedoms, as
    one that hangs on a single ball, has none.

    Args:
        state: The robot.
        J: Rows of its constraints over the free velocities, in units of `scale`, shape (m, free).
        free: Which velocities are free, shape (free,).
        scale: Unit of each, shape (free,).
        error: Largest error of the constraints after a displacement of the free velocities [m, rad].
    """
    T, N, out = _twists(state, free, scale), null_space(J, 1e-5), list[IdleFreedom]()
    names = body_names(state.robot)
    owner = np.array([state.robot.joints.velocities[i].joint for i in free])
    single = np.array([state.robot.joints[name].nv == 1 for name in owner], bool)
    claimed: set[int] = set()
    for b in range(len(T)):
        Z = N
        for c in range(len(T)):
            kept = Z @ null_space(T[c] @ Z, _REST, unit=True) if c != b else Z
            Z = kept if np.abs(T[b] @ kept).max(initial=0.0) > _REST else Z
        if b in claimed or Z.shape[1] != 1 or np.abs(Z[single]).max(initial=0.0) > _REST:
            continue
        z = Z[:, 0] / np.abs(Z).max()
        moving = np.abs(T @ z).max(axis=1) > _REST
        as_one = np.abs(T[moving] @ z - T[b] @ z).max() < _REST
        in_loop = np.abs(J[:, np.isin(owner, owner[np.abs(z) > _REST])]).max(initial=0.0) > _REST
        if as_one and in_loop and not moving.all() and error(_FAR * z) < _CLOSED * max(1.0, state.robot.joints.reach):
            joints = tuple((np.flatnonzero(moving) + 1).tolist())
            claimed |= {j - 1 for j in joints}
            out.append(IdleFreedom(joints, names[b]))
    return out


def idle_directions(state: State, J: Array, free: Array, scale: Array, idle: list[IdleFreedom]) -> Array:
    """Unit directions of idle freedoms, shape (k, free): velocities that J allows while all other bodies are at rest."""
    T = _twists(state, free, scale)
    rest = [np.delete(T, [j - 1 for j in each.joints], axis=0).reshape(-1, len(free)) for each in idle]
    each = [np.linalg.svd(np.concatenate([J, R, np.zeros((len(free), len(free)))]), full_matrices=False)[2][-1] for R in rest]
    return np.array(each).reshape(len(idle), len(free))


def _twists(state: State, free: Array, scale: Array) -> Array:
    """Jacobian of each body's twist at W's origin, lengths in units of the robot's, shape (bodies, 6, free)."""
    robot = state.robot
    J_W = pin.computeJointJacobians(robot.model, robot.model.createData(), state.q).reshape(6, -1)
    J_W[:3] /= robot.joints.length
    carries = np.array([robot.joints.carrying(j) for j in range(1, robot.model.njoints)])
    return np.asarray((J_W * carries[:, None])[:, :, free] * scale)


def told(idle: list[IdleFreedom]) -> tuple[str, ...]:
    """Names of the bodies that turn by themselves."""
    return tuple(each.body for each in idle)
