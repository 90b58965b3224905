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
        self._point_a, self._point_b = (np.array([pair[k][1].translation for pair in sites])[:, :, None] for k in (0, 1))
        carries = np.array([_carried_by(robot.model, joint) for joint in self._joints])
        # Directions in frame_a: of each closure three, of a planar one the first two count.
        self._axes = np.array([X_a.rotation @ loop.directions for loop, ((_, X_a), _) in zip(loops, sites, strict=True)])
        self._counts = np.concatenate([np.arange(3) < loop.size for loop in loops])
        ends = np.cumsum([loop.size for loop in loops]).tolist()
        self.spans = [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]
        self._row = np.repeat(np.arange(len(loops)), [loop.size for loop in loops])
        self._with_a, self._relative = carries[self._a].T.copy(), (carries[self._b] - carries[self._a]).T.copy()
        self._enters = self._relative.T[self._row].copy()
        #: The force on the ground is minus that on the robot.
        self.on_robot = [1.0 if b else -1.0 for _, (b, _) in sites]

    @classmethod
    def of(cls, robot: CheckedModel, constraints: Sequence[object]) -> LoopStack | None:
        """The stack of constraints that are all planar or point closures, `FEWEST` or more; else None."""
        loops = [c for c in constraints if type(c) is LoopClosure and c.kind in ("planar", "point")]
        return cls(robot, loops) if len(loops) == len(constraints) >= FEWEST else None

    def at(self, state: State) -> LoopRows:
        """Their rows at a state."""
        R, p, J_W = state.joint_motion(self._joints)
        R_a = R.take(self._a, axis=0)
        axes = R_a @ self._axes
        p_a = p.take(self._a, axis=0) + (R_a @ self._point_a)[:, :, 0]
        p_b = p.take(self._b, axis=0) + (R.take(self._b, axis=0) @ self._point_b)[:, :, 0]
        v = state.v[:, None]
        V = (J_W @ (self._relative * v)).T  # V_b - V_a and its rate
        V_a = (J_W[:6] @ (self._with_a * v)).T
        V_b = V[:, :6] + V_a
        v_b = V_b[:, :3] + _cross(V_b[:, 3:], p_b)
        t = axes.transpose(0, 2, 1).reshape(-1, 3)[self._counts]
        p_b, v_b, w_a, r, V = (x.take(self._row, axis=0) for x in (p_b, v_b, V_a[:, 3:], p_b - p_a, V))
        turned = _cross(w_a, t)
        terms = np.concatenate([t, _cross(p_b, t)], axis=1)
        rates = np.concatenate([turned, _cross(v_b, t) + _cross(p_b, turned)], axis=1)
        J = terms @ J_W[:6]
        J *= self._enters
        bias = np.vecdot(terms, V[:, 6:]) + np.vecdot(rates, V[:, :6])
        return LoopRows(self, J, bias, np.vecdot(terms, V[:, :6]), np.vecdot(t, r), axes)


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
    """Cross products row by row, shape (n, 3): a third of the cost of np.cross."""
    return a.take(_NEXT, axis=1) * b.take(_LAST, axis=1) - a.take(_LAST, axis=1) * b.take(_NEXT, axis=1)


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
