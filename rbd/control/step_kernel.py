"""Compiled: the program of a step of whole-body control in arrays, and how far an answer is from its equations."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.conic_kernel import most_of
from rbd.solvers.newton_kernel import project
from rbd.solvers.small_systems import add_product, add_transposed

_PLANNED = 0.75
"""Share of A with which braking is planned."""
_RETURN = 0.5
"""A joint beyond its limit comes back by this share of what it is beyond in each time d."""
_BEYOND = 1e-9
"""A torque beyond its limit by less, over the limit, is there by rounding."""


@compiled
def _add(factor: float, x: Array, y: Array) -> None:
    """Add a multiple of x to y."""
    for i in range(len(y)):
        y[i] += factor * x[i]


def _optimality(
    H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, p: int, x: Array,
    y: Array, z: Array, bounds: Array,
) -> float:  # fmt: skip
    """How far a point is from the minimiser: the worst equation, bound, gradient and complementarity, scaled.

    Args:
        H: As of `minimised`, as are the next nine.
        g: As there.
        A: As there.
        b: As there.
        C: As there.
        low: As there.
        high: As there.
        lower: As there.
        upper: As there.
        p: As there.
        x: What is judged, as are the next three, of the shapes there.
        y: As there.
        z: As there.
        bounds: As there.
    """
    pull, pushed, gradient, missed, reached = np.zeros(len(g)), np.zeros(len(g)), g.copy(), -b, np.zeros(len(low))
    add_transposed(H, x, pull)
    add_transposed(A, y, pushed)
    gradient += pull - pushed
    add_transposed(C, -z, gradient)
    gradient[:p] -= bounds
    add_product(A, x, missed)
    add_product(C, x, reached)
    size = max(1.0, most_of(pull), most_of(g[p:]), most_of(pushed))
    moving = max(1.0, most_of(x[p:]), most_of(b))
    own, push = np.concatenate((x[:p], reached)), np.concatenate((bounds, z))
    below, above = own - np.concatenate((lower[:p], low)), np.concatenate((upper[:p], high)) - own
    passed = most_of(np.minimum(np.minimum(below, above), 0.0))
    at = most_of(np.where(push == 0.0, 0.0, push * np.where(push > 0.0, below, above)))
    worst = max(most_of(gradient) / size, most_of(missed) / moving, passed / moving, at / size)
    return worst if math.isfinite(most_of(gradient) + most_of(missed)) else math.inf


optimality = compiled(
    _optimality,
    signature(NUMBER, array(2), array(1), array(2), array(1), array(2), *[array(1)] * 4, COUNT, *[array(1)] * 4),
)


def _assembled(
    M: Array, need: Array, J: Array, offset: Array, G: Array, unit: float, idle: Array, motors: Array, A: Array, wanted: Array,
    cost: Array, K: Array, k: Array, limit: Array, weakest: Array, strongest: Array, normals: Array, lightest: Array,
    heaviest: Array, limited: Array, least: Array, most: Array, per_weight: Array, H: Array, g: Array, E: Array, b: Array,
    C: Array, low: Array, high: Array,
) -> None:  # fmt: skip
    """Write J^T G, and a step's program but for the bounds of its weights.

    Args:
        M: Joint-space inertia, shape (nv, nv).
        need: h - tau_ext, shape (nv,).
        J: Jacobian of the contacts, shape (m, nv).
        offset: Their bias and feedback, shape (m,).
        G: Their forces of unit weights, shape (m, p).
        unit: The body weight [N].
        idle: Coordinates without motors, shape (e,).
        motors: The others, shape (nu,).
        A: Rows of tasks, shape (t, nv).
        wanted: What they are wanted to be.
        cost: What missing it costs.
        K: Cost of forces over the unit, its squares, shape (p, p).
        k: And its linear part, shape (p,).
        limit: Effort limits, inf where there is none, shape (nu,).
        weakest: Bounds of torques at this speed.
        strongest: Upper bounds.
        normals: Rows of bounds on normal forces, shape (c, p).
        lightest: These bounds, over the unit.
        heaviest: Upper bounds.
        limited: Coordinates with a bound, shape (j,).
        least: Bounds of all accelerations, shape (nv,).
        most: Upper bounds.
        per_weight: Written: J^T G, shape (nv, p).
        H: Written, zero before, as are the next four: of `Conic`, in (w / unit, a).
        g: As there.
        E: Its equations: of motion, over the unit, and of the contacts.
        b: Their right-hand sides.
        C: Its rows between bounds: of motors over their limits, or over the unit, of normal forces, of joints.
        low: Written: these bounds.
        high: Written: upper bounds.
    """
    p, e, nu, first = len(k), len(idle), len(motors), len(motors) + len(normals)
    per_weight[:] = 0.0
    for i in range(len(G)):
        for c in range(len(need)):
            if J[i, c] != 0.0:
                _add(J[i, c], G[i], per_weight[c])
    H[:p, :p], g[:p] = K, k
    for i in range(len(A)):
        for c in range(len(need)):
            if A[i, c] != 0.0:
                _add(cost[i] * A[i, c], A[i], H[p + c, p:])
                g[p + c] -= cost[i] * A[i, c] * wanted[i]
    E[:e, :p], E[:e, p:], b[:e] = -per_weight[idle], M[idle] / unit, -need[idle] / unit
    E[e:, p:], b[e:] = J, -offset
    size = np.where(limit < math.inf, limit, unit)
    low[:nu], high[:nu] = (weakest - need[motors]) / size, (strongest - need[motors]) / size
    C[:nu, :p], C[:nu, p:] = per_weight[motors] * (-unit / size).reshape((nu, 1)), M[motors] / size.reshape((nu, 1))
    C[nu:first, :p], low[nu:first], high[nu:first] = normals, lightest, heaviest
    for i in range(len(limited)):
        C[first + i, p + limited[i]] = 1.0
        low[first + i], high[first + i] = least[limited[i]], most[limited[i]]


assembled = compiled(
    _assembled,
    signature(
        None, array(2), array(1), array(2), array(1), array(2), NUMBER, array(1, COUNT), array(1, COUNT), array(2),
        array(1), array(1), array(2), *[array(1)] * 4, array(2), array(1), array(1), array(1, COUNT), array(1), array(1),
        array(2, written=True), array(2, written=True), array(1, written=True), array(2, written=True),
        array(1, written=True), array(2, written=True), array(1, written=True), array(1, written=True),
    ),
)  # fmt: skip


def _judged(
    M: Array, need: Array, J: Array, offset: Array, per_weight: Array, unit: float, idle: Array, motors: Array, x: Array,
    lower: Array, upper: Array, push: Array, spans: Array, mu: Array, least: Array, most: Array, limit: Array, limited: Array,
    lowest: Array, highest: Array, w: Array, tau: Array, load: Array,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """(balance, contacts, cones, torques, joints, torques over their limits): what an answer misses; it is written.

    Args:
        M: As of `assembled`, as are the next seven.
        need: As there.
        J: As there.
        offset: As there, less the violation that is allowed.
        per_weight: As there.
        unit: As there.
        idle: As there.
        motors: As there.
        x: Weights over the unit and accelerations.
        lower: Bounds of these weights.
        upper: Upper bounds.
        push: Force of a unit weight on its point, shape (p, 3).
        spans: First columns of the pyramids, and those after their last, shape (k, 2).
        mu: Their coefficients, shape (k,).
        least: Bounds of torques, shape (nu,).
        most: Upper bounds.
        limit: Effort limits, inf where there is none.
        limited: As of `assembled`.
        lowest: Bounds of these accelerations, with the violation that is allowed.
        highest: Upper bounds.
        w: Written: weights [N], shape (p,).
        tau: Written: torques, shape (nu,).
        load: Written: M a + need, shape (nv,).
    """
    p, cones = len(w), 0.0
    a, load[:], missed = x[p:], need, offset.copy()
    w[:] = np.minimum(np.maximum(x[:p], lower[:p]), upper[:p]) * unit
    add_transposed(M, a, load)
    add_product(J, a, missed)
    total = load.copy()
    add_product(per_weight, -w, total)
    for k in range(len(mu)):
        f = np.zeros(3)
        for j in range(spans[k, 0], spans[k, 1]):
            _add(w[j], push[j], f)
        if not np.hypot(f[0], f[1]) <= mu[k] * f[2]:
            normal, factor, _ = project(f[0], f[1], f[2], mu[k], False)
            cones = max(cones, abs(f[2] - normal), abs(f[0] - factor * f[0]), abs(f[1] - factor * f[1]))
    inside, bounded = np.minimum(np.maximum(total[motors], least), most), a[limited]
    tau[:] = np.where(np.abs(total[motors] - inside) <= _BEYOND * limit, inside, total[motors])
    beyond = np.abs(tau - inside)
    passed = most_of(np.minimum(np.minimum(bounded - lowest, highest - bounded), 0.0))
    return most_of(total[idle]), most_of(missed), cones, most_of(beyond), passed, most_of(beyond / np.minimum(limit, 1e300))


judged = compiled(
    _judged,
    signature(
        (NUMBER,) * 6, array(2), array(1), array(2), array(1), array(2), NUMBER, array(1, COUNT), array(1, COUNT), array(1),
        array(1), array(1), array(2), array(2, COUNT), *[array(1)] * 4, array(1, COUNT), array(1), array(1),
        *[array(1, written=True)] * 3,
    ),
)  # fmt: skip


@compiled
def _towards(room: float, v: float, A: float, d: float) -> float:
    """The most acceleration towards a limit at a distance `room`, of a joint that approaches it at v."""
    P = _PLANNED * A
    if not 0.5 * d * v > room:
        most = (math.sqrt(P * (P * d * d + 8.0 * room - 4.0 * d * v)) - P * d - 2.0 * v) / (2.0 * d)
    elif room > 0.0:
        most = v * v / (-2.0 * room)
    else:
        most = (_RETURN * room / d - v) / d
    return max(most, -A)


def _acceleration_bounds(
    q: Array, v: Array, of_q: Array, of_v: Array, lowest: Array, highest: Array, fastest: Array, A: float, d: float,
    margin: float, position: bool, velocity: bool, least: Array, most: Array,
) -> None:  # fmt: skip
    """Write the bounds of accelerations of joints with limits; see `rbd.control.motion_limits`.

    Args:
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        of_q: Where the joints are in q, shape (j,).
        of_v: In v.
        lowest: Their lowest positions, or -inf.
        highest: Their highest positions, or inf.
        fastest: Their speeds, or inf.
        A: Braking.
        d: Horizon.
        margin: Distance from limits of positions.
        position: Whether positions are limited.
        velocity: Whether speeds are.
        least: Written, shape (nv,).
        most: Written, shape (nv,).
    """
    for j in range(len(of_q)):
        x, k = q[of_q[j]], of_v[j]
        upper = lower = math.inf
        if position:
            upper = _towards(highest[j] - x - margin, v[k], A, d)
            lower = _towards(x - lowest[j] - margin, -v[k], A, d)
        if velocity:
            upper = min(upper, max((fastest[j] - v[k]) / d, -A))
            lower = min(lower, max((fastest[j] + v[k]) / d, -A))
        lower = -lower
        if lower > upper:  # the room between two limits is too small for both
            lower = upper = 0.5 * (lower + upper)
        least[k], most[k] = lower, upper


acceleration_bounds = compiled(
    _acceleration_bounds,
    signature(
        None, array(1), array(1), array(1, COUNT), array(1, COUNT), *[array(1)] * 3, NUMBER, NUMBER, NUMBER, FLAG, FLAG,
        array(1, written=True), array(1, written=True),
    ),
)  # fmt: skip
