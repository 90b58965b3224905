"""`StepProgram`, the quadratic program of a step of whole-body control: its minimiser, or its least violation.

    minimise    1/2 x . H x + g . x         x = (w, a): weights of the contact forces, bounded, and accelerations
    subject to  A x = b                     equations of motion without motors; contacts, loops
                low <= C x <= high          torques over their limits, normal forces, joint limits

DAQP solves the program: first without limits of torques and with few of joints; if that answer passes one, with all, without
equations that depend on others. Every answer is judged by `StepProgram.optimality`; where it is none, Clarabel is asked, whose
answer Newton's method makes exact.

Equations of motion, friction pyramids, normal forces and torque limits are kept always: for any torques and forces within
them there is an acceleration. What accelerations of contacts and of joints miss is least in the sum of squares,

    minimise    1/2 |D (J a - wanted)|^2 + 1/2 |D s|^2     subject to     least - s <= a <= most + s, and all else,

with D = 1 for translations, and a lever arm for rotations. A proximal point method ends at the minimiser: each of its steps
adds 1/2 r |x - x_before|^2, so that DAQP has a strictly convex program. Among all accelerations with that violation the tasks
then choose: rows between bounds with a multiplier hold as equations at all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.control.motion_limits import step_kernel
from rbd.problem.conic import Conic
from rbd.problem.residuals import SOLVED
from rbd.solvers.conic_newton import solve_conic
from rbd.solvers.qp import independent_rows, solve_strict


class StepPoint(NamedTuple):
    """A point of a `StepProgram`, with multipliers that are positive at lower bounds.

    Attributes:
        x: Weights of forces and accelerations, shape (p + nv,).
        y: Of the equations, shape (m,).
        z: Of the rows between bounds, shape (q,).
        bounds: Of the bounds of weights, shape (p,).
        iterations: Of the method.
        method: "DAQP", "Clarabel" or "Newton".
    """

    x: Array
    y: Array
    z: Array
    bounds: Array
    iterations: int
    method: str


@dataclass(frozen=True, eq=False)
class StepProgram:
    """The quadratic program of a step.

    Attributes:
        conic: In (w, a), without cones; numbers around one, H positive definite; only weights have bounds of their own.
        p: How many weights there are.
        contacts: Which equations are of contacts and loops; those before are of motion.
        forces: Which of the rows between bounds are of w alone: they are kept always. Those before are of motors.
        joints: Which of them are limits of joints, the last ones.
    """

    conic: Conic
    p: int
    contacts: slice
    forces: slice
    joints: slice

    def optimality(self, point: StepPoint) -> float:
        """How far a point is from the minimiser: the worst equation, bound, gradient and complementarity, scaled."""
        return float(step_kernel().optimality(*self.conic.arrays[:9], self.p, *point[:4]))


_NEAR = 20.0
"""Accelerations of joints are bounded from the beginning where a bound is nearer to zero [rad/s2, m/s2]."""
_FAR = 1e-6
"""What is farther from the optimality conditions has most likely no answer."""


def minimiser(program: StepProgram, *, possible: bool = False) -> tuple[StepPoint | None, float]:
    """(the minimiser, its `optimality`) by the first method within 1e-9, else by the best; None if none has one.

    Args:
        program: To be solved.
        possible: Whether it is known to have an answer: no method's verdict ends the search.
    """
    best, least, off = None, math.inf, math.inf
    for method in (partial(by_daqp, few=True), by_daqp, by_clarabel):
        if method is by_clarabel and off > _FAR and not possible:
            break  # there is none, or DAQP left a contradicting equation out
        point, solved = method(program)
        off = program.optimality(point)
        if solved and off < least:
            best, least = point, off
        if least <= SOLVED:
            break
    return best, least


def by_daqp(program: StepProgram, *, few: bool = False) -> tuple[StepPoint, bool]:
    """(where DAQP ends, whether that is an answer), without the equations that depend on others.

    Weights that are fixed are left out: DAQP takes them for equations, and where these and the others determine everything it
    may find no answer.

    Args:
        program: The program.
        few: With all equations, and of the rows of motors and joints those that are likely to bind.
    """
    P, p, forces, fixed = program.conic, program.p, program.forces, program.conic.lower == program.conic.upper
    free: Array | slice = np.flatnonzero(~fixed) if fixed.any() else slice(None)
    between: Array | slice = slice(None)
    if few:
        near = np.minimum(-P.low, P.high) < _NEAR
        near[: forces.start], near[forces] = False, True
        between = near.nonzero()[0]
    x, y, z = np.where(fixed, P.lower, 0.0), np.zeros(len(P.b)), np.zeros(len(P.low))
    A, C, H, away = P.A[:, free], P.C[between], P.H[free], P.C[between] @ x
    kept: Array | slice = slice(None) if few else independent_rows(A)
    b, lower, upper = (P.b - P.A @ x)[kept], P.lower[:p][~fixed[:p]], P.upper[:p][~fixed[:p]]
    bottom, top = np.concatenate([b, P.low[between] - away]), np.concatenate([b, P.high[between] - away])
    found = solve_strict(
        H[:, free], (P.g + P.H @ x)[free], lower, upper, np.concatenate([A[kept], C[:, free]]), bottom, top
    )  # fmt: skip
    x[free], y[kept], z[between] = found.x, found.y[: len(b)], found.y[len(b) :]
    bounds = found.z
    if fixed.any():
        bounds = P.answer_of_X(x, y, z)[:p]  # what holds the fixed weights
        bounds[~fixed[:p]] = found.z
    return StepPoint(x, y, z, bounds, found.iterations, "DAQP"), found.solved


def by_clarabel(program: StepProgram) -> tuple[StepPoint, bool]:
    """(where Clarabel ends, True), made exact by Newton's method on the active set that it sees."""
    P = program.conic
    found = solve_conic(P, newton=False, tolerance=SOLVED)
    answer = P.answer_of_X(found.x, found.y, found.z)
    bounds = np.where(np.isfinite(np.where(answer > 0.0, P.lower, P.upper)), answer, 0.0)[: program.p]
    return StepPoint(found.x, found.y, found.z, bounds, found.iterations, found.method), True


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


def relaxed(step: StepProgram, contact_sizes: Array, joint_sizes: Array) -> Relaxed | None:
    """The program with the least violation; None where it was not found.

    Args:
        step: The program.
        contact_sizes: What accelerations of contacts are multiplied by, shape (m,).
        joint_sizes: Likewise of joints, shape (j,).
    """
    P, p, nv, contacts, joints = step.conic, step.p, len(step.conic.g) - step.p, step.contacts, step.joints
    idle, motors, j = contacts.start, step.forces.start, joints.stop - joints.start
    n = motors + p + j  # torques less their own part, weights, what joints pass
    right = np.zeros((nv, 1 + n))
    right[:idle, 0] = P.b[:idle]
    right[range(idle, nv), range(1, 1 + motors)] = 1.0
    right[:, 1 + motors : 1 + motors + p] = -np.concatenate([P.A[:idle, :p], P.C[:motors, :p]])
    try:
        found = np.linalg.solve(np.concatenate([P.A[:idle, p:], P.C[:motors, p:]]), right)
    except np.linalg.LinAlgError:  # a singular inertia
        return None
    a_0, B = found[:, 0], found[:, 1:]
    J, wanted = P.A[contacts, p:], P.b[contacts]
    A = contact_sizes[:, None] * (J @ B)
    H, g = A.T @ A, A.T @ (contact_sizes * (J @ a_0 - wanted))
    H.flat[(n - j) * (n + 1) :: n + 1] = 1.0
    r = _PROXIMAL * max(1.0, float(H.diagonal().max()))
    H.flat[:: n + 1] += r
    at = P.C[joints, p:]
    passes = at @ B
    passes[:, n - j :] = np.diag(1.0 / joint_sizes)
    own = at @ a_0
    C = np.zeros((step.forces.stop - motors, n))
    C[:, motors : motors + p] = P.C[step.forces, :p]
    C = np.concatenate([C, passes])
    low, high = (np.concatenate([side[step.forces], side[joints] - own]) for side in (P.low, P.high))
    lower, upper = np.concatenate([P.low[:motors], P.lower[:p]]), np.concatenate([P.high[:motors], P.upper[:p]])
    x = np.zeros(n)
    for _ in range(_STEPS):
        answer = solve_strict(H, g - r * x, lower, upper, C, low, high)
        if not answer.solved:
            return None
        moved, x = max_abs(answer.x - x), answer.x
        if r * moved <= _STILL * max(1.0, max_abs(g)):
            break
    a = a_0 + B @ x
    missed, values = J @ a - wanted, at @ a
    passed = np.maximum(0.0, np.maximum(P.low[joints] - values, values - P.high[joints]))
    seen = SEEN * max(1.0, max_abs(a))
    z = np.concatenate([answer.z[:motors], answer.y])
    z[joints] = np.where(passed > seen, 1.0, z[joints])
    face = _on_face(P, np.concatenate([x[motors : motors + p], a]), z, answer.z[motors : motors + p])
    return Relaxed(replace(step, conic=face), missed, passed, seen)


def _on_face(P: Conic, x: Array, z: Array, bounds: Array) -> Conic:
    """The program on all points with the violation of x: what has a multiplier is an equation, or fixed.

    Right-hand sides are those of this point, so that rounding leaves it possible.
    """
    rows, held = P.C @ x, np.abs(z) > _HELD
    lower, upper, p = P.lower.copy(), P.upper.copy(), len(bounds)
    upper[:p][bounds > _HELD], lower[:p][bounds < -_HELD] = lower[:p][bounds > _HELD], upper[:p][bounds < -_HELD]
    return replace(
        P,
        A=np.concatenate([P.A, P.C[held]]),
        b=np.concatenate([P.A @ x, rows[held]]),
        low=np.where(held, -np.inf, np.minimum(P.low, rows)),
        high=np.where(held, np.inf, np.maximum(P.high, rows)),
        lower=lower,
        upper=upper,
    )
