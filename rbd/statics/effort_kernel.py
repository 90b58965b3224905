"""Compiled: torques and forces of least effort for a wanted motion on prepared constraints, and how far they are from it.

The program is that of `rbd.statics.effort`, in the weights of a plan's columns over the body weight:

    minimise sum_i p_i (t - T x)_i^2 + sum_j r_j x_j^2     subject to     A x = b,   t - T x within its bounds,   x in its sets
"""

from __future__ import annotations

import numpy as np

from rbd.answers.prepared.certificate_kernel import _own
from rbd.answers.prepared.law_kernel import COLUMN_TYPES, TABLE, Columns, pushed
from rbd.arrays import Array
from rbd.kernels import COUNT, NUMBER, array, compiled, signature
from rbd.solvers.conic_kernel import most_of, newton, projected
from rbd.solvers.small_systems import add_product, add_transposed

_SURELY = 0.1
"""Columns slower than this times the rest speed are at rest, and so are the rows of their constraint."""
_BEYOND = 1e-9
"""A torque beyond its limit by less, over the limit, is there by rounding."""


@compiled
def _unit_loads(
    columns: Columns, units: Array, gear: Array, motions: Array, X: Array, J: Array, last: Array, parent: Array, out: Array
) -> None:
    """Write the generalised forces of unit weights, shape (p, nv); arguments as of `least_effort`."""
    load, F, m = np.empty(9), np.empty(3), np.empty(3)
    out[:] = 0.0
    for j in range(len(out)):
        k = columns.body[j, 0]
        if k >= 0:
            F[0], F[1], F[2], m[0], m[1], m[2] = _own(columns, j, motions, X)
            for a in range(3):
                load[a] = X[k, a] * F[0] + X[k, 3 + a] * F[1] + X[k, 6 + a] * F[2]
                load[3 + a] = X[k, a] * m[0] + X[k, 3 + a] * m[1] + X[k, 6 + a] * m[2]
                load[6 + a] = columns.arm[j, a]
            pushed(J, X[k], last[k], load, parent, out[j])
    for i in range(len(units)):
        out[units[i, 0], units[i, 1]] += gear[i]


def _least_effort(
    force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array, motions: Array, X: Array,
    J: Array, last: Array, parent: Array, v: Array, rest: float, need: Array, motors: Array, idle: Array, limit: Array,
    least: Array, most: Array, inertia: Array, p: Array, r: Array, unit: float, lower: Array, upper: Array, cones: Array,
    mu: Array, w: Array, tau: Array, rate: Array, z: Array,
) -> int:  # fmt: skip
    """Steps of Newton's method to the least effort; negative where it was not found, or where a column is not at rest.

    Args:
        force: Of `Columns`, as are the next four, in the axes of joints.
        moment: As there.
        arm: As there.
        along: As there.
        body: As there.
        units: As of `certificate_kernel.act`.
        gear: As there.
        motions: As there.
        X: Poses of the joints, as of `row_kernel.row_terms`.
        J: World Jacobian.
        last: The last dof that moves each joint.
        parent: Of each dof, -1 of the first.
        v: Velocity, shape (n,).
        rest: Largest speed at rest [m/s, rad/s].
        need: M a + h - tau_ext, shape (n,).
        motors: Their places in v, shape (nu,).
        idle: The others, shape (e,).
        limit: What torques are divided by, shape (nu,).
        least: Bounds of torques.
        most: Upper bounds.
        inertia: Least sizes of the equations without motors [N, N m], shape (e,).
        p: Weights of the squares of torques over `limit`, shape (nu,).
        r: Of the squares of forces over `unit`, shape (c,).
        unit: The body weight [N].
        lower: Bounds of the weights [N], shape (c,).
        upper: Upper bounds.
        cones: Columns of the cones, shape (k, 3).
        mu: Their coefficients.
        w: Weights of the columns [N]; written.
        tau: Torques, written.
        rate: Multipliers of the equations without motors, where these are, as velocities, shape (n,); written.
        z: Multipliers of the torques' bounds, written.
    """
    c, loads, u = len(w), np.empty((len(w), len(v))), np.zeros(len(w))
    _unit_loads(Columns(force, moment, arm, along, body), units, gear, motions, X, J, last, parent, loads)
    add_product(loads, v, u)
    if not most_of(u) <= _SURELY * rest:
        return -1
    by_dof = np.ascontiguousarray(loads.T)
    size, y = np.maximum(inertia, np.abs(need[idle])) / unit, np.zeros(len(idle))
    for k in range(len(idle)):
        size[k] = max(size[k], most_of(by_dof[idle[k]]))
    A, b, t = by_dof[idle] / size.reshape((-1, 1)), need[idle] / (size * unit), need[motors] / limit
    T, H, g = by_dof[motors] * (unit / limit).reshape((-1, 1)), np.diag(2.0 * r), np.zeros(c)
    add_transposed(T, -2.0 * p * t, g)
    for k in range(len(t)):
        for j in range(c):
            x = 2.0 * p[k] * T[k, j]
            if x != 0.0:
                for l in range(c):
                    H[j, l] += x * T[k, l]
    w[:], z[:], low, high = 0.0, 0.0, t - most / limit, t - least / limit
    steps = newton(H, g, A, b, T, low, high, lower / unit, upper / unit, cones, mu, True, w, y, z)
    w *= unit
    left = need.copy()
    add_transposed(loads, -w, left)
    load = left[motors]
    inside = np.minimum(np.maximum(load, least), most)
    tau[:] = np.where(np.abs(load - inside) <= _BEYOND * limit, inside, load)
    rate[idle] = y / (size * unit)
    return int(steps)


_WRITTEN, _INDEX = array(1, written=True), array(1, COUNT)
least_effort = compiled(
    _least_effort,
    signature(
        COUNT, *COLUMN_TYPES, TABLE, array(1), array(2), array(2), array(2, layout="A"), _INDEX, _INDEX, array(1), NUMBER,
        array(1), _INDEX, _INDEX, *[array(1)] * 6, NUMBER, array(1), array(1), TABLE, array(1), *[_WRITTEN] * 4,
    ),
)  # fmt: skip


def _excess(
    force: Array, moment: Array, arm: Array, along: Array, body: Array, units: Array, gear: Array, motions: Array, X: Array,
    twists: Array, rate: Array, unit: float, r: Array, w: Array, lower: Array, upper: Array, cones: Array, mu: Array,
    tau: Array, z: Array, limit: Array, least: Array, most: Array,
) -> float:  # fmt: skip
    """How far weights and torques are, over the unit and their limits, from what their multipliers tell: zero at the least.

    Weights answer with r = 2 r w / unit less the velocities, times the unit, that `rate` gives the columns: x = P(x - r).

    Args:
        force: Of `Columns`, as are the next four, in the axes of joints.
        moment: As there.
        arm: As there.
        along: As there.
        body: As there.
        units: As of `certificate_kernel.act`.
        gear: As there.
        motions: As there.
        X: Poses of the joints.
        twists: Their velocities at `rate`.
        rate: Those, and of motors (2 p tau / limit + z) / limit.
        unit: As of `least_effort`, as are the next eleven.
        r: As there.
        w: As there.
        lower: As there.
        upper: As there.
        cones: As there.
        mu: As there.
        tau: As there.
        z: As there.
        limit: As there.
        least: As there.
        most: As there.
    """
    columns, c, use = Columns(force, moment, arm, along, body), len(w), tau / limit
    F, t = np.empty(3), np.empty(3)
    u, inside, single, V = np.zeros(c), np.empty(c), np.empty(c), np.empty((len(mu), 3, 3))
    for i in range(len(units)):
        u[units[i, 0]] += gear[i] * rate[units[i, 1]]
    for j in range(c):
        if body[j, 0] >= 0:
            F[0], F[1], F[2], t[0], t[1], t[2] = _own(columns, j, motions, X)
            s, Q = arm[j], twists[body[j, 0]]
            u[j] = F[0] * (Q[0] + Q[4] * s[2] - Q[5] * s[1]) + F[1] * (Q[1] + Q[5] * s[0] - Q[3] * s[2])
            u[j] += F[2] * (Q[2] + Q[3] * s[1] - Q[4] * s[0]) + t[0] * Q[3] + t[1] * Q[4] + t[2] * Q[5]
    projected((1.0 - 2.0 * r) * w / unit + unit * u, lower / unit, upper / unit, cones, mu, inside, single, V)
    return max(
        most_of(w / unit - inside), most_of(use - np.minimum(np.maximum(use + z, least / limit), most / limit))
    )  # fmt: skip


excess = compiled(
    _excess,
    signature(
        NUMBER, *COLUMN_TYPES, TABLE, array(1), *[array(2)] * 3, array(1), NUMBER, *[array(1)] * 4, TABLE, *[array(1)] * 6
    ),
)  # fmt: skip
