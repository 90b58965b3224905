"""The rows of many loop closures at one state, computed together: planar and point closures.

With t a row's direction, fixed in frame_a, and p_b the origin of frame_b, a row of x = R_a^T (p_b - p_a) moves at

    t . x' = (t, p_b x t) . (V_b - V_a)

where V = (linear, angular) is the velocity of a body, its linear part that of the point at W's origin. So one product with the
joints' Jacobian gives all rows, and with t' = w_a x t and p_b' = v_b,

    J_dot v = (t, p_b x t) . (V_b - V_a)' + (t', v_b x t + p_b x t') . (V_b - V_a)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.loop import LoopClosure
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.rows import Rows

FEWEST = 3
"""Fewer closures are faster one by one."""


class LoopStack:
    """Planar and point closures on one robot.

    Args:
        robot: The robot.
        loops: The closures.

    Raises:
        FrameNotFound: with the nearest names.
        InputError: both frames of a closure are on one body.
    """

    def __init__(self, robot: CheckedModel, loops: Sequence[LoopClosure]) -> None:
        for loop in loops:
            loop.check(robot)
        self.loops = tuple(loops)
        sites = [(robot.site(loop.frame_a), robot.site(loop.frame_b)) for loop in loops]
        self._joints = sorted({joint for pair in sites for joint, _ in pair})
        number = {joint: i for i, joint in enumerate(self._joints)}
        self._a, self._b = (np.array([number[pair[k][0]] for pair in sites]) for k in (0, 1))
        # In the axes of the joint of frame_a: three directions, of which the first two count in a planar closure; its origin.
        self._in_a = np.array(
            [
                np.column_stack([X_a.rotation @ loop.directions, X_a.translation])
                for loop, ((_, X_a), _) in zip(loops, sites, strict=True)
            ]
        )
        self._point_b = np.array([X_b.translation for _, (_, X_b) in sites])[:, :, None]
        carries = np.array([_carried_by(robot.model, joint) for joint in self._joints])
        self._counts = np.concatenate([np.arange(3) < loop.size for loop in loops])
        ends = np.cumsum([loop.size for loop in loops]).tolist()
        self.spans = [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]
        self._row = np.repeat(np.arange(len(loops)), [loop.size for loop in loops])
        relative = carries[self._b] - carries[self._a]
        self._moves, self._enters = np.concatenate([relative, carries[self._a]]).T.copy(), relative[self._row]
        #: The force on the ground is minus that on the robot.
        self.on_robot = [1.0 if b else -1.0 for _, (b, _) in sites]

    @classmethod
    def of(cls, robot: CheckedModel, constraints: Sequence[object]) -> LoopStack | None:
        """The stack of constraints that are all planar or point closures, `FEWEST` or more; else None."""
        loops = [c for c in constraints if type(c) is LoopClosure and c.kind in ("planar", "point")]
        return cls(robot, loops) if len(loops) == len(constraints) >= FEWEST else None

    def at(self, state: State) -> LoopRows:
        """Their rows at a state."""
        n = len(self.loops)
        R, p, J_W = state.joint_motion(self._joints)
        of_a = R.take(self._a, axis=0) @ self._in_a
        axes = of_a[:, :, :3]
        p_a = p.take(self._a, axis=0) + of_a[:, :, 3]
        p_b = p.take(self._b, axis=0) + (R.take(self._b, axis=0) @ self._point_b)[:, :, 0]
        moving = (J_W @ (self._moves * state.v[:, None])).T
        V, V_a = moving[:n], moving[n:, :6]  # V_b - V_a and its rate; V_a
        V_b = V[:, :6] + V_a
        v_b = V_b[:, :3] + _cross(V_b[:, 3:], p_b)
        each = np.concatenate([p_b, v_b, V_a[:, 3:], p_b - p_a, V], axis=1).take(self._row, axis=0)
        V, V_dot = each[:, 12:18], each[:, 18:]
        t = axes.transpose(0, 2, 1).reshape(-1, 3)[self._counts]
        turned = _cross(each[:, :9].reshape(-1, 3, 3), t[:, None])  # p_b, v_b and w_a x t
        t_dot = turned[:, 2]
        terms = np.concatenate([t, turned[:, 0]], axis=1)
        rates = np.concatenate([t_dot, turned[:, 1] + _cross(each[:, :3], t_dot)], axis=1)
        J = terms @ J_W[:6]
        J *= self._enters
        bias = np.vecdot(terms, V_dot) + np.vecdot(rates, V)
        return LoopRows(self, J, bias, np.vecdot(terms, V), np.vecdot(t, each[:, 9:12]), axes)


@dataclass(frozen=True, eq=False)
class LoopRows(Sequence[Rows]):
    """Rows of a stack at one state: stacked, and closure by closure as they are asked for.

    Attributes:
        stack: The closures.
        J: Shape (m, nv).
        bias: J_dot v, shape (m,).
        velocity: Shape (m,).
        error: Shape (m,).
        axes: Directions of each closure in W, as columns, shape (n, 3, 3).
    """

    stack: LoopStack
    J: Array
    bias: Array
    velocity: Array
    error: Array
    axes: Array

    @lazy
    def _made(self) -> list[Rows]:
        out = []
        for loop, s, sign, axes in zip(self.stack.loops, self.stack.spans, self.stack.on_robot, self.axes, strict=True):
            resultant = sign * axes[:, : loop.size]
            out.append(
                Rows.unchecked(loop.name, self.J[s], self.bias[s], loop.cone, self.velocity[s], self.error[s], resultant, None)
            )
        return out

    def forces(self, f: Array) -> dict[str, Array]:
        """The force of each closure in world axes, shape (3,) [N], of row forces (m,)."""
        loops, spans, signs = self.stack.loops, self.stack.spans, self.stack.on_robot
        return {
            loop.name: sign * (axes[:, : loop.size] @ f[s])
            for loop, s, sign, axes in zip(loops, spans, signs, self.axes, strict=True)
        }

    def __len__(self) -> int:
        return len(self.stack.loops)

    @overload
    def __getitem__(self, i: int) -> Rows: ...
    @overload
    def __getitem__(self, i: slice) -> list[Rows]: ...
    def __getitem__(self, i: int | slice) -> Rows | list[Rows]:
        return self._made[i]

    def __iter__(self) -> Iterator[Rows]:
        return iter(self._made)


def rows_function(robot: CheckedModel, constraints: Sequence[Constraint]) -> Callable[[State], Sequence[Rows]]:
    """Each constraint's rows as a function of the state, of loops together where that is faster."""
    stack = LoopStack.of(robot, constraints)
    return (lambda state: rows_of(state, constraints)) if stack is None else stack.at


def _carried_by(model: pin.Model, joint: int) -> Array:
    """Which velocities move a joint's body, shape (nv,), 1 or 0."""
    out = np.zeros(model.nv)
    for j in model.supports[joint]:
        if j:
            at = model.joints[j].idx_v
            out[at : at + model.joints[j].nv] = 1.0
    return out


def _cross(a: Array, b: Array) -> Array:
    """Cross products along the last axis: a third of the cost of np.cross."""
    return a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1) - a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
