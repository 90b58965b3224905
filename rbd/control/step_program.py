"""`StepProgram`, the quadratic program of a step of whole-body control: its minimiser, or its least violation.

    minimise    1/2 a^T H a + g^T a + 1/2 w^T K w + k^T w
    subject to  E a + F w = e                       equations of motion without motors; contacts, loops
                low <= T a + W w <= high            torques over their limits, normal forces, joint limits
                lower <= w <= upper                 weights of the contact forces

`rbd.control.step_program` solves it.

DAQP solves the program in x = (w, a): first without limits of torques and with few of joints, then with all, if that answer
passes one. Every answer is judged by `StepProgram.optimality`; where it is none, equations
that depend on others are left out, and the optimality conditions are solved on DAQP's active set; then ProxSuite likewise.

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
from rbd.problem.residuals import SOLVED
from rbd.solvers.qp import POLICY, attempts, independent_rows, solve_strict


class StepPoint(NamedTuple):
    """A point of a `StepProgram`, with multipliers that are positive at lower bounds.

    Attributes:
        a: Accelerations, shape (nv,).
        w: Weights of forces, shape (p,).
        y: Of the equations, shape (m,).
        t: Of the rows between bounds, shape (q,).
        z: Of the bounds of w, shape (p,).
        iterations: Of the method.
        method: "DAQP" or "ProxSuite".
    """

    a: Array
    w: Array
    y: Array
    t: Array
    z: Array
    iterations: int
    method: str


@dataclass(frozen=True, eq=False)
class StepProgram:
    """The quadratic program of a step; numbers around one.

    Attributes:
        H: Shape (nv, nv), positive definite.
        g: Shape (nv,).
        K: Shape (p, p), positive definite.
        k: Shape (p,).
        E: Shape (m, nv).
        F: Shape (m, p).
        e: Shape (m,).
        T: Shape (q, nv).
        W: Shape (q, p).
        low: Shape (q,); -inf where there is none.
        high: Shape (q,); inf where there is none.
        lower: Shape (p,); -inf where there is none.
        upper: Shape (p,); inf where there is none.
        of_forces: Which of the rows between bounds are of w alone: they are kept always.
    """

    H: Array
    g: Array
    K: Array
    k: Array
    E: Array
    F: Array
    e: Array
    T: Array
    W: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    of_forces: slice

    def optimality(self, point: StepPoint) -> float:
        """How far a point is from the minimiser: the worst equation, bound, gradient and complementarity, scaled."""
        a, w, y, t, z, _, _ = point
        Ha, Kw, Ey, Fy = self.H @ a, self.K @ w, y @ self.E, y @ self.F
        size = max(1.0, max_abs(Ha), max_abs(self.g), max_abs(Kw), max_abs(Ey), max_abs(Fy))
        moving = max(1.0, max_abs(a), max_abs(self.e))
        gradient = np.concatenate([Ha + self.g - Ey - t @ self.T, Kw + self.k - Fy - t @ self.W - z])
        missed = self.E @ a + self.F @ w - self.e
        if not math.isfinite(np.vdot(gradient, gradient) + np.vdot(missed, missed)):
            return math.inf
        rows = self.T @ a + self.W @ w
        below, above = np.concatenate([rows - self.low, w - self.lower]), np.concatenate([self.high - rows, self.upper - w])
        multipliers = np.concatenate([t, z])
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
_PASSED = 1e-11
"""A row that is passed by more binds."""
_FAR = 1e-6
"""What is farther from the optimality conditions has most likely no answer."""
_PUSHES = 1e-14
"""A multiplier of the wrong sign that is less, over the largest, is rounding."""
_CORRECTIONS = 10
_RANK = 1e-15
_SETTINGS = 3
"""How many of ProxSuite's settings are tried."""


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
    few = _near(program)
    first, found = few.by_daqp()
    if found:
        yield first
    if found and not few.complete:
        first, found = WholeProgram(program).by_daqp()
        if found:
            yield first
    whole = WholeProgram(program, independent=True)
    second, solved = whole.by_daqp()
    if solved:
        yield second
    if not possible and program.optimality(second) > _FAR:
        return  # there is none, or DAQP left a contradicting equation out
    yield whole.on_active_set(second)
    for third in whole.by_proxsuite():
        yield third
        yield whole.on_active_set(third)


def _near(program: StepProgram) -> WholeProgram:
    """With the rows between bounds that are likely to bind: bounds near zero; others are judged when it is solved."""
    near = np.minimum(-program.low, program.high) < _NEAR
    near[: program.of_forces.start] = False  # torques
    near[program.of_forces] = True
    return WholeProgram(program, between=near.nonzero()[0])


class WholeProgram:
    """A program in x = (w, a), with some of its equations and of its rows between bounds; weights that are fixed are left out.

    DAQP takes fixed weights for equations, and where these and the others determine everything it may find no answer.

    Args:
        program: The program.
        independent: Leave out equations that depend on others.
        between: Which rows between bounds; all if not given.
    """

    def __init__(self, program: StepProgram, *, independent: bool = False, between: Array | None = None) -> None:
        P, nv, m = program, len(program.g), len(program.e)
        self.program = P
        self.between: Array | slice = slice(None) if between is None else between
        self.low, self.high = P.low[self.between], P.high[self.between]
        self.complete = len(self.low) == len(P.low)
        self.lower, self.upper, K, k, F, W, e = P.lower, P.upper, P.K, P.k, P.F, P.W, P.e
        fixed = P.lower == P.upper
        self.w, self.free = np.where(fixed, P.lower, 0.0), slice(None) if not fixed.any() else np.flatnonzero(~fixed)
        if not isinstance(self.free, slice):
            free, away = self.free, (W @ self.w)[self.between]
            self.lower, self.upper, self.low, self.high = P.lower[free], P.upper[free], self.low - away, self.high - away
            K, k, F, W, e = K[free][:, free], (k + K @ self.w)[free], F[:, free], W[:, free], e - F @ self.w
        p = self.p = len(k)
        self.H, self.g = np.zeros((p + nv, p + nv)), np.concatenate([k, P.g])
        self.H[:p, :p], self.H[p:, p:] = K, P.H
        rows = np.empty((m + len(self.low), p + nv))
        rows[:m, :p], rows[:m, p:] = F, P.E
        rows[m:, :p], rows[m:, p:] = W[self.between], P.T[self.between]
        self.kept: Array | slice = slice(None)
        if independent:
            self.kept = independent_rows(rows[:m])
            rows = np.concatenate([rows[self.kept], rows[m:]])
        self.rows, self.b = rows, e[self.kept]
        self.A, self.C = rows[: len(self.b)], rows[len(self.b) :]

    def by_daqp(self) -> tuple[StepPoint, bool]:
        """(where DAQP ends, whether that is an answer)."""
        low, high = np.concatenate([self.b, self.low]), np.concatenate([self.b, self.high])
        found = solve_strict(self.H, self.g, self.lower, self.upper, self.rows, low, high)
        return self._point(found.x, found.z, found.y, found.iterations, "DAQP"), found.solved

    def by_proxsuite(self) -> Iterator[StepPoint]:
        """One point a setting."""
        C = np.concatenate([np.eye(self.p, len(self.g)), self.C])
        low, high = np.concatenate([self.lower, self.low]), np.concatenate([self.upper, self.high])
        for found in attempts(self.H, self.g, self.A, self.b, C, low, high, policy=POLICY[:_SETTINGS]):
            y = np.concatenate([found.y, found.z[self.p :]])
            yield self._point(found.x, found.z[: self.p], y, found.iterations, "ProxSuite")

    def on_active_set(self, point: StepPoint) -> StepPoint:
        """The solution of the optimality conditions with the active set of a point, which is corrected where it is wrong."""
        p, m, n = self.p, len(self.b), len(self.g)
        rows = np.concatenate([np.eye(p, n), self.C])
        low, high = np.concatenate([self.lower, self.low]), np.concatenate([self.upper, self.high])
        pushes = np.concatenate([point.z[self.free], point.t[self.between]])
        side = np.where(low == high, 1.0, np.sign(pushes))
        x, y = np.concatenate([point.w[self.free], point.a]), np.zeros(m + len(side))
        for _ in range(_CORRECTIONS):
            held = side.nonzero()[0]
            B = np.concatenate([self.A, rows[held]])
            right = np.concatenate([-self.g, self.b, np.where(side > 0.0, low, high)[held]])
            system = np.block([[self.H, -B.T], [B, np.zeros((len(B), len(B)))]])
            both = np.linalg.lstsq(system, right, rcond=_RANK)[0]
            for _ in range(2):
                both += np.linalg.lstsq(system, right - system @ both, rcond=_RANK)[0]
            x, y = both[:n], np.zeros(m + len(side))
            y[:m], y[m + held] = both[n : n + m], both[n + m :]
            values, pushes = rows @ x, y[m:]
            wrong = (pushes * side < -_PUSHES * max_abs(pushes)) & (low < high)
            below, above = values < low - _PASSED, values > high + _PASSED
            if not (wrong | ((below | above) & (side == 0.0))).any():
                break
            side = np.where(wrong, 0.0, np.where(side == 0.0, 1.0 * below - 1.0 * above, side))
        y[m:][(y[m:] * side < 0.0) & (low < high)] = 0.0
        return self._point(x, y[m : m + p], np.concatenate([y[:m], y[m + p :]]), point.iterations, point.method)

    def _point(self, x: Array, z: Array, y: Array, iterations: int, method: str) -> StepPoint:
        P, p, m = self.program, self.p, len(self.b)
        of_equations, t = np.zeros(len(P.e)), np.zeros(len(P.low))
        of_equations[self.kept], t[self.between] = y[:m], y[m:]
        if isinstance(self.free, slice):
            return StepPoint(x[p:], x[:p], of_equations, t, z, iterations, method)
        w = self.w.copy()
        w[self.free] = x[:p]
        pull = P.K @ w + P.k - of_equations @ P.F - t @ P.W  # what holds the fixed weights
        pull[self.free] = z
        return StepPoint(x[p:], w, of_equations, t, pull, iterations, method)


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
