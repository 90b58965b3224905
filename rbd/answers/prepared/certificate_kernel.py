"""Compiled: the certificate of what `rbd.answers.prepared.law_kernel` found, around one call of `pin.rnea`.

Its columns are in the axes of joints, computed apart from those that found the answer. `act` puts the forces of weights on
their bodies; `pin.rnea` at (q, v, a) with them gives the residual of the equations of motion, and leaves the velocities and
accelerations of all bodies, from which `judged` has those of the columns, and how far each element is from its law.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.answers.prepared.law_kernel import (
    BODY,
    COLUMN_TYPES,
    EDGE,
    EDGE_MOMENT,
    ELEMENT_TYPES,
    LINK,
    LOOP_MOMENT,
    OPENS,
    RESTS,
    RUBS,
    SLIDES,
    SURFACE,
    TABLE,
    Columns,
    Elements,
    decide,
)
from rbd.answers.prepared.row_kernel import along_link, loop_turn
from rbd.arrays import Array
from rbd.kernels import FLAG, NUMBER, array, compiled, signature
from rbd.solvers.law_kernel import LEAST_PUSH, cone_miss

_EPSILON = float(np.finfo(float).eps)
_WRITTEN = array(1, written=True)


@compiled
def _to_body(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of the world in the axes of a body, R by columns."""
    return (
        R[0] * x + R[1] * y + R[2] * z,
        R[3] * x + R[4] * y + R[5] * z,
        R[6] * x + R[7] * y + R[8] * z,
    )


@compiled
def _to_world(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector in the axes of a body in those of the world."""
    return (
        R[0] * x + R[3] * y + R[6] * z,
        R[1] * x + R[4] * y + R[7] * z,
        R[2] * x + R[5] * y + R[8] * z,
    )


@compiled
def _seen(columns: Columns, j: int, X: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector in axes of a column's surface, in those of its joint."""
    base = columns.body[j, 2]
    if base > 0:
        x, y, z = _to_world(X[base], x, y, z)
    return _to_body(X[columns.body[j, 0]], x, y, z)


@compiled
def _of_loop(columns: Columns, j: int, given: Array, X: Array, w: Array, m: Array) -> tuple[float, float]:
    """Write the moment of a loop that turns, in its joint's axes; (what its acceleration has beside it, how far it is open).

    Args:
        columns: The columns.
        j: Which.
        given: Its row of the motions.
        X: Placements of the joints.
        w: How the body turns against the other.
        m: Written.
    """
    A, R, E, spin, extra, error = np.empty((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for c in range(3):  # axes of frame_a
        A[0, c], A[1, c], A[2, c] = _seen(columns, j, X, given[36 + c], given[39 + c], given[42 + c])
    for c in range(3):
        for a in range(3):
            spin[c] += A[a, c] * w[a]
            for b in range(3):
                R[c, b] += A[a, c] * given[18 + 3 * a + b]
    loop_turn(R, given[27:36].reshape((3, 3)), spin, E, extra, error)
    row = columns.force[j].argmax()
    for a in range(3):
        m[a] = A[a, 0] * E[row, 0] + A[a, 1] * E[row, 1] + A[a, 2] * E[row, 2]
    return extra[row], abs(error[row])


@compiled
def _of_link(columns: Columns, j: int, given: Array, X: Array, F: Array) -> float:
    """Write the force of a rod or rope, in its joint's axes; its length."""
    k, r, p, d = columns.body[j, 0], columns.arm[j], np.empty(3), np.empty(3)
    for a in range(3):
        p[a] = X[k, 9 + a] + X[k, a] * r[0] + X[k, 3 + a] * r[1] + X[k, 6 + a] * r[2]
    far = along_link(columns.along[j], X[columns.body[j, 2]], p, d)
    F[0], F[1], F[2] = _to_body(X[k], given[22] * d[0], given[22] * d[1], given[22] * d[2])
    return far


@compiled
def _turned(columns: Columns, j: int, motions: Array, X: Array) -> tuple[float, float, float, float, float, float]:
    """F and m, in its joint's axes, of a column that is not given in these."""
    F, n, axes = columns.force[j], columns.moment[j], columns.body[j, 1]
    if axes == SURFACE:
        F0, F1, F2 = _seen(columns, j, X, F[0], F[1], F[2])
        return F0, F1, F2, n[0], n[1], n[2]
    if axes == LOOP_MOMENT:
        m = np.zeros(3)
        _of_loop(columns, j, motions[columns.body[j, 3]], X, m, m)
        return 0.0, 0.0, 0.0, m[0], m[1], m[2]
    if axes == LINK:
        m = np.zeros(3)
        _of_link(columns, j, motions[columns.body[j, 3]], X, m)
        return m[0], m[1], m[2], 0.0, 0.0, 0.0
    x = columns.along[j]  # an edge: from the normal in the joint's axes
    n0, n1, n2 = _seen(columns, j, X, n[0], n[1], n[2])
    s = n0 * x[0] + n1 * x[1] + n2 * x[2]
    z0, z1, z2 = n0 - s * x[0], n1 - s * x[1], n2 - s * x[2]
    size = math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
    z0, z1, z2 = z0 / size, z1 / size, z2 / size
    y0, y1, y2 = z1 * x[2] - z2 * x[1], z2 * x[0] - z0 * x[2], z0 * x[1] - z1 * x[0]
    e0 = F[0] * x[0] + F[1] * y0 + F[2] * z0
    e1 = F[0] * x[1] + F[1] * y1 + F[2] * z1
    e2 = F[0] * x[2] + F[1] * y2 + F[2] * z2
    return (e0, e1, e2, 0.0, 0.0, 0.0) if axes == EDGE else (0.0, 0.0, 0.0, e0, e1, e2)


@compiled
def _own(columns: Columns, j: int, motions: Array, X: Array) -> tuple[float, float, float, float, float, float]:
    """The same of any column."""
    if columns.body[j, 1] != BODY:
        return _turned(columns, j, motions, X)
    F, m = columns.force, columns.moment
    return F[j, 0], F[j, 1], F[j, 2], m[j, 0], m[j, 1], m[j, 2]


@compiled
def _of_surface(
    columns: Columns, j: int, motions: Array, X: Array, twists: Array, lifts: Array, fall: Array, out: Array
) -> None:
    """Write what a column's surface does at its point, in axes of its joint: velocity, turning, and their rates.

    Also where the point is from the surface's origin, in axes of the surface.
    """
    k, base, r, d = columns.body[j, 0], columns.body[j, 2], columns.arm[j], out[4]
    for a in range(3):
        d[a] = X[k, 9 + a] + X[k, a] * r[0] + X[k, 3 + a] * r[1] + X[k, 6 + a] * r[2]
    V, A, g = np.zeros(6), np.zeros(6), np.zeros(3)
    if base > 0:
        d[0], d[1], d[2] = _to_body(X[base], d[0] - X[base, 9], d[1] - X[base, 10], d[2] - X[base, 11])
        g[0], g[1], g[2] = _to_body(X[base], fall[0], fall[1], fall[2])
        V[:], A[:] = twists[base], lifts[base]
    else:
        given = motions[columns.body[j, 3]]
        V[:], A[:] = given[:6], given[6:12]
        for a in range(3):
            if math.isnan(given[12 + a]):  # given at a point of the body
                d[a] -= X[k, 9 + a] + X[k, a] * given[15] + X[k, 3 + a] * given[16] + X[k, 6 + a] * given[17]
            else:
                d[a] -= given[12 + a]
    u0, u1, u2 = V[4] * d[2] - V[5] * d[1], V[5] * d[0] - V[3] * d[2], V[3] * d[1] - V[4] * d[0]
    s0 = A[0] + g[0] + A[4] * d[2] - A[5] * d[1] + V[4] * u2 - V[5] * u1
    s1 = A[1] + g[1] + A[5] * d[0] - A[3] * d[2] + V[5] * u0 - V[3] * u2
    s2 = A[2] + g[2] + A[3] * d[1] - A[4] * d[0] + V[3] * u1 - V[4] * u0
    if base > 0:  # spatial accelerations are classical ones less w x v
        s0 += V[4] * V[2] - V[5] * V[1]
        s1 += V[5] * V[0] - V[3] * V[2]
        s2 += V[3] * V[1] - V[4] * V[0]
    out[0, 0], out[0, 1], out[0, 2] = _seen(columns, j, X, V[0] + u0, V[1] + u1, V[2] + u2)
    out[1, 0], out[1, 1], out[1, 2] = _seen(columns, j, X, V[3], V[4], V[5])
    out[2, 0], out[2, 1], out[2, 2] = _seen(columns, j, X, s0, s1, s2)
    out[3, 0], out[3, 1], out[3, 2] = _seen(columns, j, X, A[3], A[4], A[5])


@compiled
def _missed(
    elements: Elements, e: int, mode: int, u: Array, y: Array, w: Array, coulomb: bool
) -> tuple[float, float, float]:  # fmt: skip
    """How far an element is from its law, scaled: its acceleration, its force, and both together."""
    j, mu = elements.first[e], elements.mu[e]
    if mu > 0.0 and mode == RESTS:
        return cone_miss(y[j], y[j + 1], y[j + 2], w[j], w[j + 1], w[j + 2], mu, coulomb)
    normal = j + 2 if mu > 0.0 else j
    x, rate, far = w[normal], y[normal], 0.0
    push = max(abs(x), LEAST_PUSH)
    if mu > 0.0:
        push = max(push, np.hypot(w[j], w[j + 1]))
        slip = 0.0
        if mode == SLIDES:
            slip = mu * x / np.hypot(u[j], u[j + 1])
        far = np.hypot(w[j] + slip * u[j], w[j + 1] + slip * u[j + 1]) / push
    if mode == OPENS:
        return 0.0, far + abs(x) / push, 0.0
    low, high = (0.0, math.inf) if mu > 0.0 else (elements.lower[e], elements.upper[e])
    if mode == RUBS:
        against = low if u[j] > 0.0 else high
        return 0.0, far + abs(x - against) / max(abs(against), LEAST_PUSH), 0.0
    if low == -math.inf and high == math.inf:
        return abs(rate), 0.0, 0.0
    outside = max(low - x, x - high, 0.0) / push
    sinks = 0.0
    if low > -math.inf and high == math.inf:
        sinks = max(-rate, 0.0)
    elif high < math.inf and low == -math.inf:
        sinks = max(rate, 0.0)
    return sinks, far + outside, abs(min(max(x - push * rate, low), high) - x) / push


@compiled
def _push_back(
    X: Array, k: int, base: int, w: float, F0: float, F1: float, F2: float, m0: float, m1: float, m2: float, pushes: Array
) -> None:
    """The opposite of a force on joint k on the body that it touches; moments are about the joints' origins."""
    A, B = X[k], X[base]
    G0, G1, G2 = _to_world(A, F0, F1, F2)
    m0, m1, m2 = _to_world(A, m0, m1, m2)
    d0, d1, d2 = A[9] - B[9], A[10] - B[10], A[11] - B[11]
    m0, m1, m2 = _to_body(B, m0 + d1 * G2 - d2 * G1, m1 + d2 * G0 - d0 * G2, m2 + d0 * G1 - d1 * G0)
    F0, F1, F2 = _to_body(B, G0, G1, G2)
    for i, x in enumerate((F0, F1, F2, m0, m1, m2)):
        pushes[base, i] -= w * x


@compiled
def _act_turned(columns: Columns, motions: Array, X: Array, w: Array, pushes: Array) -> None:
    """Add the forces of columns that are not given in their bodies' axes, or act on two bodies."""
    for j in range(len(w)):
        k, base = columns.body[j, 0], columns.body[j, 2]
        if k < 0 or (columns.body[j, 1] <= SURFACE and base < 0):
            continue
        F0, F1, F2, m0, m1, m2 = _own(columns, j, motions, X)
        r0, r1, r2 = columns.arm[j, 0], columns.arm[j, 1], columns.arm[j, 2]
        m0, m1, m2 = m0 + r1 * F2 - r2 * F1, m1 + r2 * F0 - r0 * F2, m2 + r0 * F1 - r1 * F0
        pushes[k, 0] += w[j] * F0
        pushes[k, 1] += w[j] * F1
        pushes[k, 2] += w[j] * F2
        pushes[k, 3] += w[j] * m0
        pushes[k, 4] += w[j] * m1
        pushes[k, 5] += w[j] * m2
        if base > 0:
            _push_back(X, k, base, w[j], F0, F1, F2, m0, m1, m2, pushes)


def _act(
    loaded: Array, loads: Array, force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array,
    motions: Array, X: Array, w: Array, pushes: Array, torque: Array,
) -> None:  # fmt: skip
    """Write the forces of weights and of the world on the bodies, in their joints' axes, and in joints.

    Args:
        loaded: As of `answer`.
        loads: As of `answer`.
        force: Of `Columns`, as are the next four, in the axes of joints.
        moment: As there.
        arm: As there.
        along: As there.
        body: As there.
        units: Column and dof of the entries of joints' columns, shape (u, 2).
        gear: The entries, shape (u,).
        motions: What surfaces do, and how loops turn, shape (sites, 45): `Site.motion`, `Site.turn`, R of a loop's frame_a.
        X: As of `answer`.
        w: Weights.
        pushes: Written, (f, moment) of all joints, shape (joints, 6).
        torque: Written, shape (nv,).
    """
    columns = Columns(force, moment, arm, along, body)
    torque[:], pushes[:] = 0.0, 0.0
    for e in range(len(loaded)):
        k, load = loaded[e, 0], loads[e]
        F0, F1, F2 = _to_body(X[k], load[0], load[1], load[2])
        m0, m1, m2 = _to_body(X[k], load[3], load[4], load[5])
        pushes[k, 0] += F0
        pushes[k, 1] += F1
        pushes[k, 2] += F2
        pushes[k, 3] += m0 + load[7] * F2 - load[8] * F1
        pushes[k, 4] += m1 + load[8] * F0 - load[6] * F2
        pushes[k, 5] += m2 + load[6] * F1 - load[7] * F0
    turned = False
    for j in range(len(w)):
        k = columns.body[j, 0]
        if k < 0 or columns.body[j, 1] > SURFACE or columns.body[j, 2] >= 0:
            turned = turned or k >= 0
            continue
        F0, F1, F2 = columns.force[j, 0], columns.force[j, 1], columns.force[j, 2]
        if columns.body[j, 1] == SURFACE:
            F0, F1, F2 = _to_body(X[k], F0, F1, F2)
        r0, r1, r2 = columns.arm[j, 0], columns.arm[j, 1], columns.arm[j, 2]
        pushes[k, 0] += w[j] * F0
        pushes[k, 1] += w[j] * F1
        pushes[k, 2] += w[j] * F2
        pushes[k, 3] += w[j] * columns.moment[j, 0] + w[j] * (r1 * F2 - r2 * F1)
        pushes[k, 4] += w[j] * columns.moment[j, 1] + w[j] * (r2 * F0 - r0 * F2)
        pushes[k, 5] += w[j] * columns.moment[j, 2] + w[j] * (r0 * F1 - r1 * F0)
    if turned:
        _act_turned(columns, motions, X, w, pushes)
    for i in range(len(units)):
        torque[units[i, 1]] += gear[i] * w[units[i, 0]]


act = compiled(
    _act,
    signature(
        None, TABLE, array(2), *COLUMN_TYPES, TABLE, array(1), array(2), array(2), array(1), array(2, written=True), _WRITTEN,
    ),
)  # fmt: skip


@compiled
def _motion_at(
    columns: Columns, j: int, X: Array, twists: Array, lifts: Array, fall: Array
) -> tuple[float, float, float, float, float, float]:
    """Velocity and acceleration of a column's point, in its joint's axes."""
    k, r0, r1, r2 = columns.body[j, 0], columns.arm[j, 0], columns.arm[j, 1], columns.arm[j, 2]
    V, A = twists[k], lifts[k]
    s0 = V[0] + V[4] * r2 - V[5] * r1
    s1 = V[1] + V[5] * r0 - V[3] * r2
    s2 = V[2] + V[3] * r1 - V[4] * r0
    g0, g1, g2 = _to_body(X[k], fall[0], fall[1], fall[2])
    g0 += A[0] + A[4] * r2 - A[5] * r1 + V[4] * s2 - V[5] * s1
    g1 += A[1] + A[5] * r0 - A[3] * r2 + V[5] * s0 - V[3] * s2
    g2 += A[2] + A[3] * r1 - A[4] * r0 + V[3] * s1 - V[4] * s0
    return s0, s1, s2, g0, g1, g2


@compiled
def _moves_turned(
    columns: Columns, motions: Array, X: Array, twists: Array, lifts: Array, fall: Array, u: Array, y: Array
) -> float:
    """Write velocities and accelerations of the columns of `_act_turned`; how far loops are open."""
    surface, moment_of_loop, open_by = np.zeros((5, 3)), np.empty(3), 0.0
    W = surface[1]
    for j in range(len(u)):
        k, axes, base = columns.body[j, 0], columns.body[j, 1], columns.body[j, 2]
        if k < 0 or (axes <= SURFACE and base < 0):
            continue
        F0, F1, F2, m0, m1, m2 = _own(columns, j, motions, X)
        V, A = twists[k], lifts[k]
        s0, s1, s2, g0, g1, g2 = _motion_at(columns, j, X, twists, lifts, fall)
        w0, w1, w2, t0, t1, t2 = V[3], V[4], V[5], A[3], A[4], A[5]
        if base >= 0:  # as the surface sees it
            _of_surface(columns, j, motions, X, twists, lifts, fall, surface)
            s0, s1, s2 = s0 - surface[0, 0], s1 - surface[0, 1], s2 - surface[0, 2]
            w0, w1, w2 = w0 - W[0], w1 - W[1], w2 - W[2]
            g0 -= surface[2, 0] + 2.0 * (W[1] * s2 - W[2] * s1)
            g1 -= surface[2, 1] + 2.0 * (W[2] * s0 - W[0] * s2)
            g2 -= surface[2, 2] + 2.0 * (W[0] * s1 - W[1] * s0)
            t0 -= surface[3, 0] + W[1] * w2 - W[2] * w1
            t1 -= surface[3, 1] + W[2] * w0 - W[0] * w2
            t2 -= surface[3, 2] + W[0] * w1 - W[1] * w0
        u[j] = F0 * s0 + F1 * s1 + F2 * s2 + (m0 * w0 + m1 * w1 + m2 * w2)
        y[j] = F0 * g0 + F1 * g1 + F2 * g2 + (m0 * t0 + m1 * t1 + m2 * t2)
        x = columns.along[j]
        if axes == EDGE_MOMENT:  # of the edge's direction
            across = w0 * (m1 * x[2] - m2 * x[1]) + w1 * (m2 * x[0] - m0 * x[2]) + w2 * (m0 * x[1] - m1 * x[0])
            y[j] += (w0 * x[0] + w1 * x[1] + w2 * x[2]) * across
        if axes == LOOP_MOMENT:
            W[0], W[1], W[2] = w0, w1, w2
            extra, gap = _of_loop(columns, j, motions[columns.body[j, 3]], X, W, moment_of_loop)
            y[j], open_by = y[j] + extra, max(open_by, gap)
        elif axes == LINK:  # its direction turns
            given = motions[columns.body[j, 3]]
            far = _of_link(columns, j, given, X, moment_of_loop)
            y[j] += given[22] * (s0 * s0 + s1 * s1 + s2 * s2 - u[j] * u[j]) / far
            if not math.isnan(given[21]):
                open_by = max(open_by, abs(far - given[21]))
        elif columns.body[j, 4]:
            gap = 0.0
            for c in range(3):
                gap += columns.force[j, c] * (surface[4, c] - x[c])
            open_by = max(open_by, abs(gap))
    return open_by


def _judged(
    left: Array, generalised: Array, torque: Array, per_inertia: Array, a: Array, v: Array, w: Array,
    force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array,
    motions: Array, first: Array, lower: Array, upper: Array, mu: Array, share: Array, starts: Array, begin: Array,
    X: Array, twists: Array, lifts: Array, fall: Array, rest: float, coulomb: bool, misses: Array,
) -> float:  # fmt: skip
    """The largest residual, over lower bounds of the scales, of the equations of motion and of the law; of an element the sum.

    Infinite where a number is not finite.

    Args:
        left: What `pin.rnea` gives with the forces of `act`, shape (nv,).
        generalised: S^T tau + tau_ext, shape (nv,).
        torque: Of `act`.
        per_inertia: Over lower bounds of M_ii, shape (nv,).
        a: Acceleration.
        v: Velocity.
        w: Weights.
        force: As of `act`.
        moment: As of `act`.
        arm: As of `act`.
        along: As of `act`.
        body: As of `act`.
        units: As of `act`.
        gear: As of `act`.
        motions: As of `act`.
        first: As of `answer`.
        lower: As of `answer`.
        upper: As of `answer`.
        mu: As of `answer`.
        share: As of `answer`.
        starts: As of `answer`.
        begin: As of `answer`.
        X: Placements of the joints, as Pinocchio left them.
        twists: Their velocities.
        lifts: Their spatial accelerations less gravity's.
        fall: Gravity.
        rest: As of `answer`.
        coulomb: As of `answer`.
        misses: Written, shape (5,): the largest of stationarity, and of feasibility, cone and complementarity of the law; how
            far loops are open.
    """
    columns, elements = Columns(force, moment, arm, along, body), Elements(first, lower, upper, mu, share, starts, begin)
    worst, p, largest, most = 0.0, len(w), 0.0, 0.0
    for j in range(p):
        most = max(most, abs(w[j]))
    for i in range(len(a)):
        largest = max(largest, max(abs(a[i]), 1.0) / per_inertia[i])
        missed = abs(left[i] - generalised[i] - torque[i]) * per_inertia[i] / max(abs(a[i]), 1.0)
        if not missed < math.inf:
            return math.inf
        worst = max(worst, missed)
    worst = max(worst, _EPSILON * most / largest) if p else worst  # what huge forces leave in sums is not known better
    misses[:] = 0.0
    misses[0] = worst
    u, y = np.zeros(p), np.zeros(p)
    for i in range(len(units)):
        u[units[i, 0]] += gear[i] * v[units[i, 1]]
        y[units[i, 0]] += gear[i] * a[units[i, 1]]
    turned = False
    for j in range(p):
        k = columns.body[j, 0]
        if k < 0 or columns.body[j, 1] > SURFACE or columns.body[j, 2] >= 0:
            turned = turned or k >= 0
            continue
        F0, F1, F2 = columns.force[j, 0], columns.force[j, 1], columns.force[j, 2]
        if columns.body[j, 1] == SURFACE:
            F0, F1, F2 = _to_body(X[k], F0, F1, F2)
        m0, m1, m2 = columns.moment[j, 0], columns.moment[j, 1], columns.moment[j, 2]
        s0, s1, s2, g0, g1, g2 = _motion_at(columns, j, X, twists, lifts, fall)
        u[j] = F0 * s0 + F1 * s1 + F2 * s2 + (m0 * twists[k, 3] + m1 * twists[k, 4] + m2 * twists[k, 5])
        y[j] = F0 * g0 + F1 * g1 + F2 * g2 + (m0 * lifts[k, 3] + m1 * lifts[k, 4] + m2 * lifts[k, 5])
    if turned:
        misses[4] = _moves_turned(columns, motions, X, twists, lifts, fall, u, y)
    for j in range(p):
        if not math.isfinite(u[j] + y[j] + w[j]):
            return math.inf
    modes = np.empty(len(elements.first), np.int64)
    if not decide(elements, u, rest, coulomb, modes):
        return math.inf
    for e in range(len(modes)):
        one, two, three = _missed(elements, e, modes[e], u, y, w, coulomb)
        misses[1], misses[2], misses[3] = max(misses[1], one), max(misses[2], two), max(misses[3], three)
        worst = max(worst, one + two + three)
    return worst


judged = compiled(
    _judged,
    signature(
        NUMBER, *[array(1)] * 7, *COLUMN_TYPES, TABLE, array(1), array(2), *ELEMENT_TYPES, *[array(2)] * 3, array(1),
        NUMBER, FLAG, _WRITTEN,
    ),
)  # fmt: skip


def _act_on_all(
    loaded: Array, loads: Array, force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array,
    motions: Array, X: Array, w: Array, pushes: Array, torque: Array,
) -> None:  # fmt: skip
    """`act` at n states, first axes of the last four."""
    for s in range(len(w)):
        act(loaded, loads, force, moment, arm, along, body, units, gear, motions, X[s], w[s], pushes[s], torque[s])


act_on_all = compiled(
    _act_on_all,
    signature(
        None, TABLE, array(2), *COLUMN_TYPES, TABLE, array(1), array(2), array(3), array(2), array(3, written=True),
        array(2, written=True),
    ),
)  # fmt: skip


def _all_judged(
    left: Array, generalised: Array, torque: Array, per_inertia: Array, a: Array, v: Array, w: Array,
    force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array,
    motions: Array, first: Array, lower: Array, upper: Array, mu: Array, share: Array, starts: Array, begin: Array,
    X: Array, twists: Array, lifts: Array, fall: Array, rest: float, coulomb: bool, misses: Array, worst: Array,
) -> None:  # fmt: skip
    """`judged` at n states, in `worst`; arrays that change with the state have them as first axis."""
    for s in range(len(worst)):
        worst[s] = judged(
            left[s], generalised[s], torque[s], per_inertia, a[s], v[s], w[s], force, moment, arm, along, body, units, gear,
            motions, first, lower, upper, mu[s], share, starts, begin, X[s], twists[s], lifts[s], fall, rest, coulomb,
            misses[s],
        )  # fmt: skip


all_judged = compiled(
    _all_judged,
    signature(
        None, *[array(2)] * 3, array(1), *[array(2)] * 3, *COLUMN_TYPES, TABLE, array(1), array(2), *ELEMENT_TYPES[:3],
        array(2), *ELEMENT_TYPES[4:], array(3), array(3), array(3), array(1), NUMBER, FLAG, array(2, written=True), _WRITTEN,
    ),
)  # fmt: skip
