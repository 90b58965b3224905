"""The least violation of contacts and joint limits, where a step of whole-body control has no answer that keeps them.

Equations of motion, friction pyramids, normal forces and torque limits are kept always: for any torques and forces within
them there is an acceleration. What accelerations of contacts and of joints miss is least in the sum of squares,

    minimise    1/2 |D (J a - wanted)|^2 + 1/2 |D s|^2     subject to     least - s <= a <= most + s, and all else,

with D = 1 for translations, and a lever arm for rotations. A proximal point method ends at the minimiser: each of its steps
adds 1/2 r |x - x_before|^2, so that DAQP has a strictly convex program. Among all accelerations with that violation the tasks
then choose: rows between bounds with a multiplier hold as equations at all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.control.step_program import StepProgram
from rbd.solvers.strict_qp import solve_strict

_PROXIMAL = 1e-10
_STEPS = 100
_STILL = 1e-12
_HELD = 1e-8
"""A row with a larger multiplier holds at every acceleration of least violation."""
SEEN = 1e-9
"""A violation is none that is less, over the accelerations [m/s2, rad/s2]."""


class Relaxed(NamedTuple):
    """A program whose contacts and joint limits may be violated, by the least.

    Attributes:
        program: With that violation allowed, and no more.
        contacts: By how much the accelerations of the contacts' equations miss what is wanted, shape (m,).
        joints: By how much rows of joint limits are passed, shape (j,).
        seen: What is no more is rounding.
    """

    program: StepProgram
    contacts: Array
    joints: Array
    seen: float

    @property
    def violated(self) -> bool:
        """Whether anything is."""
        return max(max_abs(self.contacts), max_abs(self.joints)) > self.seen


def relaxed(program: StepProgram, contacts: slice, contact_sizes: Array, joints: slice, joint_sizes: Array) -> Relaxed | None:
    """The program with the least violation; None where it was not found.

    Args:
        program: Of a step: its first equations, and its first rows between bounds, are the equations of motion.
        contacts: Which of its equations are of contacts and loops.
        contact_sizes: What their accelerations are multiplied by, shape (m,).
        joints: Which of its rows between bounds are limits of joints.
        joint_sizes: Likewise, shape (j,).
    """
    idle, p, j = contacts.start, len(program.k), joints.stop - joints.start
    motors, forces = slice(0, len(program.g) - idle), program.of_forces
    n = motors.stop + p + j  # torques less their own part, weights, what joints pass
    right = np.zeros((len(program.g), 1 + n))
    right[:idle, 0] = program.e[:idle]
    right[range(idle, len(right)), range(1, 1 + motors.stop)] = 1.0
    right[:, 1 + motors.stop : 1 + motors.stop + p] = -np.concatenate([program.F[:idle], program.W[motors]])
    try:
        found = np.linalg.solve(np.concatenate([program.E[:idle], program.T[motors]]), right)
    except np.linalg.LinAlgError:  # a singular inertia
        return None
    a_0, B = found[:, 0], found[:, 1:]
    J, wanted = program.E[contacts], program.e[contacts]
    A = contact_sizes[:, None] * (J @ B)
    H, g = A.T @ A, A.T @ (contact_sizes * (J @ a_0 - wanted))
    H.flat[(n - j) * (n + 1) :: n + 1] = 1.0
    r = _PROXIMAL * max(1.0, float(H.diagonal().max()))
    H.flat[:: n + 1] += r
    at = program.T[joints]
    passes = at @ B
    passes[:, n - j :] = np.diag(1.0 / joint_sizes)
    own = at @ a_0
    C = np.zeros((forces.stop - forces.start, n))
    C[:, motors.stop : motors.stop + p] = program.W[forces]
    C = np.concatenate([C, passes])
    low = np.concatenate([program.low[forces], program.low[joints] - own])
    high = np.concatenate([program.high[forces], program.high[joints] - own])
    lower = np.concatenate([program.low[motors], program.lower])
    upper = np.concatenate([program.high[motors], program.upper])
    x = np.zeros(n)
    for _ in range(_STEPS):
        answer = solve_strict(H, g - r * x, lower, upper, C, low, high)
        if not answer.solved:
            return None
        moved, x = max_abs(answer.x - x), answer.x
        if r * moved <= _STILL * max(1.0, max_abs(g)):
            break
    a = a_0 + B @ x
    w, k = x[motors.stop : motors.stop + p], motors.stop
    missed, values = J @ a - wanted, at @ a
    passed = np.maximum(0.0, np.maximum(program.low[joints] - values, values - program.high[joints]))
    seen = SEEN * max(1.0, max_abs(a))
    t = np.concatenate([answer.z[:k], answer.y])
    t[joints] = np.where(passed > seen, 1.0, t[joints])
    return Relaxed(_on_face(program, a, w, t, answer.z[k : k + p]), missed, passed, seen)


def _on_face(program: StepProgram, a: Array, w: Array, t: Array, z: Array) -> StepProgram:
    """The program on all points with the violation of (a, w): what has a multiplier is an equation, or fixed.

    Right-hand sides are those of this point, so that rounding leaves it possible.
    """
    rows = program.T @ a + program.W @ w
    held = np.abs(t) > _HELD
    lower, upper = program.lower.copy(), program.upper.copy()
    upper[z > _HELD], lower[z < -_HELD] = lower[z > _HELD], upper[z < -_HELD]
    return replace(
        program,
        E=np.concatenate([program.E, program.T[held]]),
        F=np.concatenate([program.F, program.W[held]]),
        e=np.concatenate([program.E @ a + program.F @ w, rows[held]]),
        low=np.where(held, -np.inf, np.minimum(program.low, rows)),
        high=np.where(held, np.inf, np.maximum(program.high, rows)),
        lower=lower,
        upper=upper,
    )
