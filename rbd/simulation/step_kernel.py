"""The compiled arithmetic of a step: floating bases, points of bodies in contact.

Arrays are written, not returned: to make one of Numba's into one of NumPy's takes a microsecond.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.answers.prepared.row_kernel import (
    JOINT,
    ROW,
    SIZE,
    TERM_TYPES,
    Terms,
    accelerated,
    all_rows,
    holding_forces,
    row_forces,
    terms_in,
)
from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.problem.residuals import SOLVED
from rbd.simulation.velocity_problem import EXACT as ENOUGH, FINE, QUICK, ROUNDING, STILL
from rbd.solvers.kkt_kernel import holding
from rbd.solvers.newton_kernel import EXACT, MOST_STEPS, PROXIMAL, Problem, Settings, damped_steps, loads, project, room_of
from rbd.solvers.small_systems import add_product, pivoted_factor, pivoted_solve, product

UNDECIDED, REST, LEAST, NEWTON = range(4)
"""How a step was found: not; all points stick, by forces of least norm; active points do, likewise; otherwise."""
EARLY = 6
"""First steps from open points in which the sum of squares may grow."""
_REPEATS = 1e-11
"""Pivots up to this are of linearly dependent rows."""
_TURNS = 1e-16
"""Centripetal changes of velocity in a step up to this are rounding [m/s]."""


@compiled
def _rotation(q: Array, at: int, R: Array) -> None:
    x, y, z, w = q[at + 3], q[at + 4], q[at + 5], q[at + 6]
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@compiled
def _carried(v: Array, i: int, R: Array, S: Array) -> tuple[float, float, float]:
    """Turn the linear part of v at i from the axes R to the axes S, in place; what it is in the world's."""
    x = R[0, 0] * v[i] + R[0, 1] * v[i + 1] + R[0, 2] * v[i + 2]
    y = R[1, 0] * v[i] + R[1, 1] * v[i + 1] + R[1, 2] * v[i + 2]
    z = R[2, 0] * v[i] + R[2, 1] * v[i + 1] + R[2, 2] * v[i + 2]
    for k in range(3):
        v[i + k] = S[0, k] * x + S[1, k] * y + S[2, k] * z
    return x, y, z


@compiled
def _turn(out: Array, v: Array, h: float, i: int) -> None:
    x, y, z, a, b, c = v[i], v[i + 1], v[i + 2], v[i + 3], v[i + 4], v[i + 5]
    out[i] += h * (b * z - c * y)
    out[i + 1] += h * (c * x - a * z)
    out[i + 2] += h * (a * y - b * x)


def _turned(start: Array, v: Array, h: float, bases: Array, out: Array) -> None:
    """Write `Bases.turned`."""
    out[:] = start
    for n in range(len(bases)):
        _turn(out, v, h, bases[n, 1])


@compiled
def _place(q: Array, out: Array, v: Array, h: float, at: int, i: int, R: Array) -> None:
    """Put the base's origin into `out`; R is left at R_WB of q."""
    _rotation(q, at, R)
    for k in range(3):
        out[at + k] = q[at + k] + h * (R[k, 0] * v[i] + R[k, 1] * v[i + 1] + R[k, 2] * v[i + 2])


def _middle(q: Array, out: Array, v: Array, v_h: Array, h: float, bases: Array, moves: Array) -> None:
    """Write (v, v_h, end, mean) of `Bases.middle` into `moves`; the bases' origins are put into `out`."""
    one, two, end, mean, R, S = moves[0], moves[1], moves[2], moves[3], np.empty((3, 3)), np.empty((3, 3))
    one[:], two[:] = v, v_h
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, 0.5 * h, at, i, R)
        _rotation(out, at, S)
        _carried(one, i, R, S)
        _carried(two, i, R, S)
    end[:], mean[:] = one, one
    for n in range(len(bases)):
        _turn(end, two, h, bases[n, 1])
        _turn(mean, two, 0.5 * h, bases[n, 1])


def _moved(q: Array, out: Array, v: Array, h: float, bases: Array, carried: Array) -> None:
    """Write the velocity of `Bases.moved`; the bases' origins are put into `out`."""
    R, S = np.empty((3, 3)), np.empty((3, 3))
    carried[:] = v
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, h, at, i, R)
        _rotation(out, at, S)
        _carried(carried, i, R, S)


@compiled
def _turned_to(X: Array, at: int, G: Array, x: float, y: float, z: float, out: Array) -> None:
    """G^T R (x, y, z) of the body whose placement begins at `at`."""
    for r in range(3):
        out[3 + r] = X[at + r] * x + X[at + 3 + r] * y + X[at + 6 + r] * z
    for r in range(3):
        out[r] = G[0, r] * out[3] + G[1, r] * out[4] + G[2, r] * out[5]


def _points(
    X: Array, V: Array, gaps: Array, height: Array, of: Array, axes: Array, arms: Array, gap: Array, velocity: Array
) -> tuple[float, float, float]:
    """Write gap and velocity of all points; the least and the largest gap, and the least velocity along a normal."""
    lowest, highest, approach, own = math.inf, -math.inf, math.inf, np.empty(6)
    gap[:] = -height
    add_product(gaps, X, gap)
    for i in range(len(gap)):
        b, x, y, z = 6 * of[i], arms[i, 0], arms[i, 1], arms[i, 2]
        p, q, s = V[b + 3], V[b + 4], V[b + 5]
        _turned_to(X, 12 * of[i], axes[i], V[b] + q * z - s * y, V[b + 1] + s * x - p * z, V[b + 2] + p * y - q * x, own)
        velocity[3 * i : 3 * i + 3] = own[:3]
        lowest, highest, approach = min(lowest, gap[i]), max(highest, gap[i]), min(approach, own[2])
    return lowest, highest, approach


@compiled
def _row_velocities(terms: Terms, x: Array, parent: Array, out: Array) -> None:
    """Write J x = W^T (L x)."""
    out[:] = 0.0
    for i in range(len(x)):
        total, p = terms.L[i, i] * x[i], parent[i]
        while p >= 0:
            total += terms.L[i, p] * x[p]
            p = parent[p]
        for r in range(len(out)):
            out[r] += terms.W[i, r] * total


@compiled
def _columns(
    X: Array, twists: Array, sites: Array, of: Array, axes: Array, arms: Array, felt: Array, centripetal: Array
) -> None:
    """Write what the points' velocities are in those of the rows of their bodies, and w x (w x r) of points of patches."""
    d = np.empty(3)
    for j in range(len(felt)):
        i, e = j // 3, j % 3
        joint, size, arm = sites[of[i], JOINT], sites[of[i], SIZE], arms[i]
        for r in range(3):
            d[r] = 0.0
            for c in range(3):
                d[r] += X[joint, 3 * r + c] * axes[i, c, e]
        felt[j, 0], felt[j, 1], felt[j, 2], centripetal[j] = d[0], d[1], d[2], 0.0
        if size > 3:
            felt[j, 3] = arm[1] * d[2] - arm[2] * d[1]
            felt[j, 4] = arm[2] * d[0] - arm[0] * d[2]
            felt[j, 5] = arm[0] * d[1] - arm[1] * d[0]
            along, turns, square = 0.0, 0.0, 0.0
            for r in range(3):
                w = twists[joint, 3 + r]
                along += w * d[r]
                turns += w * arm[r]
                square += w * w
            centripetal[j] = along * turns - square * (d[0] * arm[0] + d[1] * arm[1] + d[2] * arm[2])


@compiled
def _add_felt(felt: Array, first: Array, width: Array, moved: Array, velocity: Array) -> None:
    """Add what the points' velocities are in those of the rows to `velocity`."""
    for j in range(len(velocity)):
        for r in range(width[j // 3]):
            velocity[j] += felt[j, r] * moved[first[j // 3] + r]


@compiled
def _least(X: Array, sites: Array, of: Array, axes: Array, shares: Array, F: Array, mu: Array, h: float, f: Array) -> bool:
    """Write impulses of least norm for forces on the rows; whether all are in their cones."""
    inside, own = True, np.empty(3)
    for i in range(len(mu)):
        at = X[sites[of[i], JOINT]]
        product(shares[i], F, own)
        for r in range(3):
            f[3 * i + r] = 0.0
        for c in range(3):
            x = at[c] * own[0] + at[3 + c] * own[1] + at[6 + c] * own[2]
            for r in range(3):
                f[3 * i + r] += axes[i, c, r] * x
        if not np.hypot(f[3 * i], f[3 * i + 1]) <= mu[i] * f[3 * i + 2]:
            inside = False
        for r in range(3):
            f[3 * i + r] *= h
    return inside


@compiled
def _by_newton(given: Problem, parts: Array, guess: Array, coulomb: bool, f: Array) -> float:
    """How far impulses f are from their law, scaled: by Newton's method from a guess; infinite where it is too far."""
    unit, rate, columns, offset, w = np.empty(len(given.mu)), 0.0, given.columns.copy(), given.offset.copy(), np.zeros(len(f))
    least = 0.0
    for i in range(len(unit)):
        at, d, size = given.first[i], given.width[i], 0.0
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                for s in range(d):
                    total += columns[j, r] * given.D[at + r, at + s] * columns[j, s]
            size = max(size, total)
        unit[i] = size
        least = max(least, 1e-12 * size)
    for i in parts:
        unit[i] = 1.0 / math.sqrt(max(unit[i], least if least > 0.0 else 1.0))
        for j in range(3 * i, 3 * i + 3):
            offset[j] *= unit[i]
            rate = max(rate, abs(offset[j]))
            for r in range(given.width[i]):
                columns[j, r] *= unit[i]
    rate = rate if rate > 0.0 else 1.0
    for i in parts:
        w[3 * i : 3 * i + 3] = guess[3 * i : 3 * i + 3] / (unit[i] * rate)
    problem = Problem(
        given.D, given.c, columns, columns, offset / rate, given.first, given.width, given.lower, given.upper,
        given.mu.copy(),
    )  # fmt: skip
    room, none, exact, merit = room_of(problem), np.zeros(len(f)), max(ENOUGH, ROUNDING / rate), math.inf
    soft = np.zeros(len(unit))
    for attempt in range(3):
        # Then for rows that are nearly dependent, which the steps' own regularisation stalls; then from all points open.
        early, most = (EARLY, MOST_STEPS) if attempt == 2 else (0, QUICK)
        settings = Settings(soft, none, FINE if attempt == 1 else PROXIMAL, early, most, coulomb)
        if attempt == 2:
            w[:] = 0.0
        merit, _ = damped_steps(problem, parts, w, settings, EXACT, room)
        if merit <= exact:
            break
    f[:] = 0.0
    for i in parts:
        j, size = 3 * i, unit[i] * rate
        normal, factor, _ = project(w[j] * size, w[j + 1] * size, w[j + 2] * size, given.mu[i], False)
        f[j], f[j + 1], f[j + 2] = factor * w[j] * size, factor * w[j + 1] * size, normal
    return merit if merit <= SOLVED else math.inf  # as the general way accepts it


@compiled
def _mobility(given: Problem, rows: Array) -> Array:
    """Accelerations of some of the points' rows by unit forces on them."""
    D, moved = np.zeros((len(rows), len(rows))), np.empty(len(given.D))
    for e in range(len(rows)):
        at, moved[:] = given.first[rows[e] // 3], 0.0
        for r in range(given.width[rows[e] // 3]):
            for s in range(len(moved)):
                moved[s] += given.columns[rows[e], r] * given.D[at + r, s]
        for c in range(len(rows)):
            at = given.first[rows[c] // 3]
            for r in range(given.width[rows[c] // 3]):
                D[e, c] += moved[at + r] * given.columns[rows[c], r]
    return D


@compiled
def _at_rest(given: Problem, parts: Array, guess: Array, f: Array) -> tuple[float, bool]:
    """`kkt_kernel.holding` of some points."""
    rows, w, none = (3 * parts.reshape(-1, 1) + np.arange(3)).ravel(), np.empty(3 * len(parts)), np.empty(0)
    D, cones = _mobility(given, rows), 3 * np.arange(len(parts))
    found = holding(D, given.offset[rows], guess[rows], STILL, True, True, cones, given.mu[parts], none, none, w)
    f[:] = 0.0
    f[rows] = w
    return found


def _advance(
    M: Array, J: Array, bias: Array, X: Array, twists: Array, rates: Array, parent: Array, sites: Array, places: Array,
    units: Array, gear: Array, fall: Array, v: Array, generalised: Array, space: Array,
    start: Array, mean: Array, u: Array, guess: Array, shift: Array, active: Array, h: float, coulomb: bool,
    of: Array, axes: Array, arms: Array, shares: Array, mu: Array, end: Array, f: Array, velocity: Array,
) -> tuple[int, float]:  # fmt: skip
    """(how it was found, how far the points are from their law, scaled) of the velocity and impulses after a step.

    Args:
        M: As of `row_kernel.row_terms`, as are the next fourteen.
        J: As there.
        bias: As there.
        X: As there.
        twists: As there.
        rates: As there.
        parent: As there.
        sites: As there.
        places: As there.
        units: As there.
        gear: As there.
        fall: As there.
        v: As there.
        generalised: As there.
        space: As there.
        start: Velocity to which h a is added, shape (n,).
        mean: As of `StepEquations`; shape (0,): None.
        u: Velocities of the points at the beginning, shape (3k,).
        guess: Impulses to start from, shape (3k,).
        shift: Added to u+ only in the contact law, shape (3k,); shape (0,): None.
        active: Which points are active, shape (k,).
        h: Length of the step [s].
        coulomb: Coulomb's law; else the convex one.
        of: The body of each point.
        axes: R_WC of each point.
        arms: Where each point is in its body's axes.
        shares: Forces of least norm at active points for forces on the rows, shape (k, 3, rows); NaN: they do not hold all.
        mu: Friction coefficients.
        end: Written: the velocity.
        f: Written: impulses of the points.
        velocity: Written: velocities of the points at the end; not if all are at rest.
    """
    n, m, k = len(parent), shares.shape[2], len(mu)
    terms, F, moved = terms_in(space, n, m), np.empty(m), np.zeros(m)
    all_rows(M, J, bias, X, twists, rates, parent, sites, places, units, gear, fall, v, generalised, terms)
    if holding_forces(terms, F) != m:
        return UNDECIDED, math.inf
    a, part, turns, rests = np.empty(n), 1.0, 0.0, len(shift) == 0
    if len(mean):  # velocities of the rows that the motion which holds them would have
        accelerated(terms, terms.z, parent, F, a)
        end[:] = mean + 0.5 * h * a
        _row_velocities(terms, end, parent, moved)
        part = 0.5
    else:
        for i in range(k):
            if not active[i]:
                continue
            rests = rests and u[3 * i] == 0.0 and u[3 * i + 1] == 0.0 and u[3 * i + 2] == 0.0
    for i in range(len(sites)):
        for r in range(sites[i, ROW], sites[i, ROW] + sites[i, SIZE]):
            turns += terms.velocity[r] ** 2 if sites[i, SIZE] > 3 else 0.0
    if rests and turns * h <= _TURNS:
        if len(mean):
            row_forces(terms, moved.copy(), -1.0 / h, F)
        if _least(X, sites, of, axes, shares, F, mu, h, f):
            accelerated(terms, terms.z, parent, F, a)
            end[:] = start + h * a
            return REST, 0.0
    felt, centripetal, first, width = np.empty((3 * k, 6)), np.empty(3 * k), sites[of, ROW], sites[of, SIZE]
    _columns(X, twists, sites, of, axes, arms, felt, centripetal)
    moved += h * terms.free
    for j in range(3 * k):
        velocity[j] = part * h * centripetal[j] + (0.0 if len(mean) else u[j])
    _add_felt(felt, first, width, moved, velocity)
    none, parts, how, merit = np.empty(0), np.flatnonzero(active), NEWTON, math.inf
    given = Problem(terms.mobility, np.zeros(m), felt, felt, velocity, first, width, none, none, mu)
    if len(shift) == 0:
        merit, least = _at_rest(given, parts, guess, f)
        how = LEAST if least else NEWTON
    if not merit <= STILL:
        law = Problem(given.D, given.c, felt, felt, velocity + shift if len(shift) else velocity, first, width, none, none, mu)
        how, merit = NEWTON, _by_newton(law, parts, guess, coulomb, f)
        if not merit < math.inf:
            return UNDECIDED, merit
    loads(given, parts, f, F)
    accelerated(terms, terms.z, parent, F / h, a)
    end[:] = start + h * a
    product(terms.mobility, F, moved)
    _add_felt(felt, first, width, moved, velocity)
    return how, merit


def _toward(
    M: Array, J: Array, bias: Array, X: Array, twists: Array, rates: Array, parent: Array, sites: Array, places: Array,
    units: Array, gear: Array, fall: Array, v: Array, generalised: Array, space: Array,
    of: Array, axes: Array, arms: Array, shares: Array, mu: Array, closes: Array, gap: Array, out: Array,
) -> None:  # fmt: skip
    """Write the least displacement in the metric of M that closes the gaps of some points; arguments as of `_advance`."""
    m, k, chosen = shares.shape[2], len(gap), np.flatnonzero(closes)
    terms, felt, w, f = terms_in(space, len(parent), m), np.empty((3 * k, 6)), np.zeros(3 * k), np.empty(m)
    all_rows(M, J, bias, X, twists, rates, parent, sites, places, units, gear, fall, v, generalised, terms)
    _columns(X, twists, sites, of, axes, arms, felt, np.empty(3 * k))
    none, first, width = np.empty(0), sites[of, ROW], sites[of, SIZE]
    given = Problem(terms.mobility, f, felt, felt, w, first, width, none, none, mu)
    D, order = _mobility(given, 3 * chosen + 2), np.empty(len(chosen), np.int64)
    scale = 1.0 / np.sqrt(np.diag(D))
    D *= scale.reshape(-1, 1) * scale
    x = -gap[chosen] * scale
    pivoted_solve(D, order, pivoted_factor(D, order, _REPEATS), x)
    w[3 * chosen + 2] = x * scale
    loads(given, chosen, w, f)
    accelerated(terms, np.zeros(len(parent)), parent, f, out)


def _wrenches(X: Array, f: Array, of: Array, axes: Array, arms: Array, out: Array) -> None:
    """Write the wrenches on the bodies in their joints' axes of forces at their points in the points' own."""
    w = np.empty(3)
    out[:] = 0.0
    for i in range(len(of)):
        G, x, at, b = axes[i], arms[i], 12 * of[i], 6 * of[i]
        for r in range(3):
            w[r] = G[r, 0] * f[3 * i] + G[r, 1] * f[3 * i + 1] + G[r, 2] * f[3 * i + 2]
        fx = X[at] * w[0] + X[at + 1] * w[1] + X[at + 2] * w[2]
        fy = X[at + 3] * w[0] + X[at + 4] * w[1] + X[at + 5] * w[2]
        fz = X[at + 6] * w[0] + X[at + 7] * w[1] + X[at + 8] * w[2]
        out[b], out[b + 1], out[b + 2] = out[b] + fx, out[b + 1] + fy, out[b + 2] + fz
        out[b + 3] += x[1] * fz - x[2] * fy
        out[b + 4] += x[2] * fx - x[0] * fz
        out[b + 5] += x[0] * fy - x[1] * fx


def _residual(
    X: Array, V: Array, lifts: Array, gravity: Array, of: Array, axes: Array, arms: Array, mu: Array, taken: Array,
    applied: Array, a: Array, f: Array, u: Array, end: Array, h: float,
) -> float:  # fmt: skip
    """`GroundDynamics.residual`, from the generalised forces that the motion takes and the bodies' motion.

    Args:
        X: Placements of the bodies.
        V: Their velocities.
        lifts: Their spatial accelerations less that of gravity.
        gravity: In world axes.
        of: The body of each point.
        axes: R_WC of each point.
        arms: Where each point is in its body's axes.
        mu: Friction coefficients.
        taken: Generalised forces that the motion takes, less those of the contact forces.
        applied: Those given.
        a: Acceleration.
        f: Forces of the points.
        u: Velocities of the points at the beginning.
        end: The same at the end.
        h: Length of the half step [s].
    """
    size = largest = max(1.0, np.abs(f).max())
    off, most = 0.0, 1.0
    for i in range(len(a)):
        size, off, most = max(size, abs(applied[i])), max(off, abs(taken[i] - applied[i])), max(most, abs(a[i]))
    outside, moved, A, turned = 0.0, 0.0, np.empty(6), np.empty(6)
    for i in range(len(of)):
        outside = max(outside, np.hypot(f[3 * i], f[3 * i + 1]) - mu[i] * f[3 * i + 2])
        if f[3 * i] == 0.0 and f[3 * i + 1] == 0.0 and f[3 * i + 2] == 0.0:
            continue
        at, b, (x, y, z) = 12 * of[i], 6 * of[i], (arms[i, 0], arms[i, 1], arms[i, 2])
        for r in range(3):
            A[r], A[3 + r] = lifts[b + r], lifts[b + 3 + r]
            for c in range(3):
                A[r] += X[at + 3 * r + c] * gravity[c]
        p, q, s = V[b + 3], V[b + 4], V[b + 5]
        # of the point: v + w x r, and a + alpha x r + w x (v + w x r)
        vx, vy, vz = V[b] + q * z - s * y, V[b + 1] + s * x - p * z, V[b + 2] + p * y - q * x
        ax = A[0] + A[4] * z - A[5] * y + q * vz - s * vy
        ay = A[1] + A[5] * x - A[3] * z + s * vx - p * vz
        az = A[2] + A[3] * y - A[4] * x + p * vy - q * vx
        _turned_to(X, at, axes[i], ax, ay, az, turned)
        for r in range(3):
            moved = max(moved, abs(h * turned[r] + u[3 * i + r] - end[3 * i + r]))
    return max(off / size, moved / (h * most), outside / largest)


_WRITTEN, _WHOLE, _TABLE, _FLAGS, _ROOM = (
    array(1, written=True),
    array(1, COUNT),
    array(2, COUNT),
    array(1, FLAG),
    array(2, written=True),
)
_PLACES = (_WHOLE, array(3), array(2))
_POINTS = (*_PLACES, array(3), array(1))
_STEP = (*[array(1)] * 5, _FLAGS, NUMBER, FLAG)
advance = compiled(_advance, signature((COUNT, NUMBER), *TERM_TYPES, *_STEP, *_POINTS, _WRITTEN, _WRITTEN, _WRITTEN))
toward = compiled(_toward, signature(None, *TERM_TYPES, *_POINTS, _FLAGS, array(1), _WRITTEN))
turned = compiled(_turned, signature(None, array(1), array(1), NUMBER, _TABLE, _WRITTEN))
middle = compiled(_middle, signature(None, array(1), _WRITTEN, array(1), array(1), NUMBER, _TABLE, _ROOM))
moved = compiled(_moved, signature(None, array(1), _WRITTEN, array(1), NUMBER, _TABLE, _WRITTEN))
points = compiled(
    _points, signature((NUMBER, NUMBER, NUMBER), array(1), array(1), array(2), array(1), *_PLACES, _WRITTEN, _WRITTEN)
)
wrenches = compiled(_wrenches, signature(None, array(1), array(1), *_PLACES, _WRITTEN))
residual = compiled(_residual, signature(NUMBER, *[array(1)] * 4, *_PLACES, *[array(1)] * 7, NUMBER))
