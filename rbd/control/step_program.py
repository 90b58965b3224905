"""`StepProgram`, the quadratic program of a step of whole-body control: its minimiser, or its least violation.

    minimise    1/2 x . H x + g . x         x = (w, a): weights of the contact forces, bounded, and accelerations
    subject to  A x = b                     equations of motion without motors; contacts, loops
                low <= C x <= high          torques over their limits, normal forces, joint limits

DAQP solves the program: first without limits of torques and with few of joints, then with all, if that answer
passes one. Every answer is judged by `StepProgram.optimality`; where it is none, equations
that depend on others are left out, and then Clarabel is asked, whose answer Newton's method makes exact.

Equations of motion, friction pyramids, normal forces and torque limits are kept always: for any torques and forces within
them there is an acceleration. What accelerations of contacts and of joints miss is least in the sum of squares,

    minimise    1/2 |D (J a - wanted)|^2 + 1/2 |D s|^2     subject to     least - s <= a <= most + s, and all else,

with D = 1 for translations, and a lever arm for rotations. A proximal point method ends at the minimiser: each of its steps
adds 1/2 r |x - x_before|^2, so that DAQP has a strictly convex program. Among all accelerations with that violation the tasks
then choose: rows between bounds with a multiplier hold as equations at all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, max_abs
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
        P, p = self.conic, self.p
        Hx, Ay = P.H @ point.x, point.y @ P.A
        size = max(1.0, max_abs(Hx), max_abs(P.g[p:]), max_abs(Ay))
        moving = max(1.0, max_abs(point.x[p:]), max_abs(P.b))
        gradient = Hx + P.g - Ay - point.z @ P.C
        gradient[:p] -= point.bounds
        missed = P.A @ point.x - P.b
        if not math.isfinite(np.vdot(gradient, gradient) + np.vdot(missed, missed)):
            return math.inf
        rows, w = P.C @ point.x, point.x[:p]
        below, above = np.concatenate([rows - P.low, w - P.lower[:p]]), np.concatenate([P.high - rows, P.upper[:p] - w])
        multipliers = np.concatenate([point.z, point.bounds])
        held = multipliers.nonzero()[0]
        pushes = multipliers[held]
        room = np.where(pushes > 0.0, below[held], above[held])
        return max(
            max_abs(gradient) / size,
            max_abs(missed) / moving,
            -min(0.0, float(below.min(initial=0.0)), float(above.min(initial=0.0))) / moving,
            max_abs(pushes * room) / size,
        )


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
    best, least = None, math.inf
    for point in _attempts(program, possible=possible):
        found = program.optimality(point)
        if found < least:
            best, least = point, found
        if found <= SOLVED:
            break
    return best, least


def _attempts(program: StepProgram, *, possible: bool) -> Iterator[StepPoint]:
    near = np.minimum(-program.conic.low, program.conic.high) < _NEAR  # those that are likely to bind; others are judged
    near[: program.forces.start] = False  # torques
    near[program.forces] = True
    first, found = by_daqp(program, near.nonzero()[0])
    if found:
        yield first
    if found and not near.all():
        first, found = by_daqp(program)
        if found:
            yield first
    second, solved = by_daqp(program, independent=True)
    if solved:
        yield second
    if not possible and program.optimality(second) > _FAR:
        return  # there is none, or DAQP left a contradicting equation out
    yield by_clarabel(program)


def by_clarabel(program: StepProgram) -> StepPoint:
    """Where Clarabel ends, made exact by Newton's method on the active set that it sees."""
    P = program.conic
    found = solve_conic(P, newton=False, tolerance=SOLVED)
    answer = P.answer_of_X(found.x, found.y, found.z)
    bounds = np.where(np.isfinite(np.where(answer > 0.0, P.lower, P.upper)), answer, 0.0)[: program.p]
    return StepPoint(found.x, found.y, found.z, bounds, found.iterations, found.method)


def by_daqp(program: StepProgram, between: Array | slice = slice(None), *, independent: bool = False) -> tuple[StepPoint, bool]:
    """(where DAQP ends, whether that is an answer), with some of the equations and of the rows between bounds.

    Weights that are fixed are left out: DAQP takes them for equations, and where these and the others determine everything it
    may find no answer.

    Args:
        program: The program.
        between: Which rows between bounds; all if not given.
        independent: Leave out equations that depend on others.
    """
    P, p = program.conic, program.p
    fixed = P.lower == P.upper
    free: Array | slice = np.flatnonzero(~fixed) if fixed.any() else slice(None)
    x, y, z = np.where(fixed, P.lower, 0.0), np.zeros(len(P.b)), np.zeros(len(P.low))
    A, C, b, g, low, high = P.A, P.C[between], P.b, P.g, P.low[between], P.high[between]
    if fixed.any():
        away = C @ x
        b, g, low, high = b - A @ x, g + P.H @ x, low - away, high - away
        A, C = A[:, free], C[:, free]
    lower, upper = (bounds[:p][~fixed[:p]] for bounds in (P.lower, P.upper))
    kept: Array | slice = independent_rows(A) if independent else slice(None)
    rows, b, m = np.concatenate([A[kept], C]), b[kept], len(b[kept])
    bottom, top = np.concatenate([b, low]), np.concatenate([b, high])
    found = solve_strict(P.H[free][:, free], g[free], lower, upper, rows, bottom, top)
    x[free], y[kept], z[between], bounds = found.x, found.y[:m], found.y[m:], found.z
    if fixed.any():
        bounds = (P.H @ x + P.g - y @ P.A - z @ P.C)[:p]  # what holds the fixed weights
        bounds[~fixed[:p]] = found.z
    return StepPoint(x, y, z, bounds, found.iterations, "DAQP"), found.solved


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
