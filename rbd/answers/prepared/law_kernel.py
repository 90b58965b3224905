"""Compiled: from the rows of bodies and joints to the constraints' forces.

A *column* is a force of unit weight: a force F and a moment m on a body at a point r of it, or torques in joints. An *element*
is a set of weights: an interval of one column, or a friction cone of three (tangent, tangent, normal). What it can resist
follows from its velocity, as in `rbd.problem.contact_motion`:

    rests     its set, as it is
    slides    f = N (-mu t, 1), N >= 0, along its velocity t; y is its normal acceleration
    opens     f = 0
    rubs      dry friction of a joint that moves: its bound that opposes the motion
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rbd.answers.prepared.row_kernel import (
    BASE,
    JOINT,
    Terms,
    accelerated,
    all_rows,
    holding_forces,
    terms_in,
)
from rbd.arrays import Array
from rbd.constraints.surface import STEEPEST
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.law_kernel import search
from rbd.solvers.newton_kernel import FOUND, Problem
from rbd.solvers.small_systems import product

RESTS, SLIDES, OPENS, RUBS = range(4)
"""What an element does."""
BODY, SURFACE, EDGE, EDGE_MOMENT, LOOP_MOMENT, ROWS, LINK = range(7)
"""Axes of a column's force: of its body; of the surface; of an edge, along it, across it, and normal less its part along it.

Of an edge's moment likewise; of a loop's, the row as F; a row of its site, by number; last along a rod or rope.
The surface is the world, or the body that is touched.
"""
HELD, NEWTON, NOTHING = range(3)
"""How an answer was found: all elements rest, with weights of least norm; by Newton's method; not at all."""
_ROUNDING = 1e-13
"""Centripetal accelerations up to this are rounding [m/s2]."""
_DOUBTFUL = 4.0
"""Where an element is slower than this times the rest speed, the rows of its constraint may be below it: not decided here."""


class Columns(NamedTuple):
    """The columns, in axes of their sites, or of joints for the certificate.

    Attributes:
        force: F, shape (p, 3); of a joint's column its factor first.
        moment: m about the point, in axes of the body, shape (p, 3); of an edge the surface's normal, in its own.
        arm: r, in axes of the body, shape (p, 3).
        along: Of an edge its direction, in axes of the body, shape (p, 3).
        body: Integers, shape (p, 5): its site, -1 for joints' rows; the axes of F; its first row; how many; whether it is the
            first of three that are orthonormal, at one point, not in axes of the body. For the certificate: its joint; the
            axes of F; the joint of its surface, -1 at rest; its site; whether `along` is where that has the point.
    """

    force: Array
    moment: Array
    arm: Array
    along: Array
    body: Array


class Elements(NamedTuple):
    """The elements.

    Attributes:
        first: Their first columns, shape (e,).
        lower: Bounds of an interval's weight, shape (e,).
        upper: Upper bounds.
        mu: Friction of a cone, zero for an interval.
        share: Weights of least norm by forces on the rows, of orthonormal three in the axes of their sites, shape (p, m).
        starts: Elements with which Newton's method begins, shape (e,), truth values.
        begin: As `share`, with weights of these elements alone.
    """

    first: Array
    lower: Array
    upper: Array
    mu: Array
    share: Array
    starts: Array
    begin: Array


@compiled
def _edge(columns: Columns, j: int, R: Array) -> tuple[Array, Array]:
    """Across the edge of a column and normal to it, in axes of the body, R of these in the surface; NaN where too steep."""
    x, n, y, z, along = columns.along[j], columns.moment[j], np.empty(3), np.empty(3), 0.0
    for a in range(3):
        z[a] = R[0, a] * n[0] + R[1, a] * n[1] + R[2, a] * n[2]
        along += z[a] * x[a]
    square = 0.0
    for a in range(3):
        z[a] -= along * x[a]
        square += z[a] * z[a]
    scale = 1.0 / math.sqrt(square) if abs(along) <= STEEPEST else math.nan
    for a in range(3):
        z[a] *= scale
    y[0], y[1], y[2] = z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]
    return y, z


@compiled
def _turned(columns: Columns, j: int, R: Array) -> tuple[float, float, float]:
    """The force, or an edge's moment, of a column in axes of the body, of those of the surface; R of these in the surface."""
    x, y, z = columns.force[j, 0], columns.force[j, 1], columns.force[j, 2]
    if columns.body[j, 1] == SURFACE:
        return (
            R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
            R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
            R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
        )
    A, B = _edge(columns, j, R)
    C = columns.along[j]
    return x * C[0] + y * A[0] + z * B[0], x * C[1] + y * A[1] + z * B[1], x * C[2] + y * A[2] + z * B[2]


@compiled
def _placed(site: Array, place: Array, X: Array, twists: Array, R: Array, w: Array) -> None:
    """Write R of a site in its surface, and how it turns against that, in its own axes."""
    joint, base = site[JOINT], site[BASE]
    for a in range(3):
        w[a] = 0.0
        for b in range(3):
            R[a, b] = X[joint, a] * place[b] + X[joint, 3 + a] * place[3 + b] + X[joint, 6 + a] * place[6 + b]
            w[a] += place[3 * b + a] * twists[joint, 3 + b]
    if base < 0:
        return
    for a in range(3):
        turns = place[15 + a]
        if base > 0:
            turns = X[base, a] * twists[base, 3] + X[base, 3 + a] * twists[base, 4] + X[base, 6 + a] * twists[base, 5]
        for b in range(3):
            w[b] -= R[a, b] * turns
    if base > 0:
        world = R.copy()
        for a in range(3):
            for b in range(3):
                R[a, b] = 0.0
                for c in range(3):
                    R[a, b] += X[base, 3 * a + c] * world[c, b]


@compiled
def _felt(columns: Columns, sites: Array, places: Array, X: Array, twists: Array, felt: Array, offset: Array) -> None:
    """Write the columns in the rows of their sites, and what their accelerations have beside those.

    That is F . w x (w x r); of an edge's moment e, (w . x)(w . e x x): that of the direction x (LineContact's rows).
    """
    R, w, last = np.empty((3, 3)), np.empty(3), -1
    for j in range(len(offset)):
        k, axes, width = columns.body[j, 0], columns.body[j, 1], columns.body[j, 3]
        F0, F1, F2, offset[j] = columns.force[j, 0], columns.force[j, 1], columns.force[j, 2], 0.0
        if k < 0:
            felt[j, 0] = F0
            continue
        if axes == ROWS:
            felt[j, int(F0)] = 1.0
            continue
        if k != last:
            last = k
            _placed(sites[k], places[k], X, twists, R, w)
        if axes != BODY:
            F0, F1, F2 = _turned(columns, j, R)
        if axes == EDGE_MOMENT:
            F, x, turns, across = (F0, F1, F2), columns.along[j], 0.0, 0.0
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                turns, across = turns + w[a] * x[a], across + w[a] * (F[b] * x[c] - F[c] * x[b])
                if a < width - 3:
                    felt[j, 3 + a] = F[a]
            offset[j] = turns * across
            continue
        r0, r1, r2 = columns.arm[j, 0], columns.arm[j, 1], columns.arm[j, 2]
        felt[j, 0], felt[j, 1], felt[j, 2] = F0, F1, F2
        if width > 3:
            own = 0.0 if axes == EDGE else 1.0
            felt[j, 3] = own * columns.moment[j, 0] + r1 * F2 - r2 * F1
            felt[j, 4] = own * columns.moment[j, 1] + r2 * F0 - r0 * F2
            if width > 5:
                felt[j, 5] = own * columns.moment[j, 2] + r0 * F1 - r1 * F0
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        if square > 0.0:
            along, turns = w[0] * F0 + w[1] * F1 + w[2] * F2, w[0] * r0 + w[1] * r1 + w[2] * r2
            offset[j] = along * turns - square * (F0 * r0 + F1 * r1 + F2 * r2)


@compiled
def decide(elements: Elements, u: Array, rest: float, coulomb: bool, modes: Array) -> bool:
    """Write what each element does, of velocities u of the columns; False if that is not for this way to decide.

    It is not if something approaches, or slides under the convex law; or where a constraint's rows may rest.
    """
    for e in range(len(modes)):
        j, mu, low, high = elements.first[e], elements.mu[e], elements.lower[e], elements.upper[e]
        modes[e] = RESTS
        if mu == 0.0 and low == -math.inf and high == math.inf:
            continue
        size = abs(u[j])
        if mu > 0.0:  # as of `rbd.problem.contact_motion.MotionJudge`, by whose rows it is then judged
            size = max(np.hypot(u[j], u[j + 1]), abs(u[j + 2]))
        if not size > rest:
            if not size <= rest:
                return False
            continue
        if size <= _DOUBTFUL * rest:
            return False
        if mu == 0.0 and not (low == 0.0 and high == math.inf):
            if math.isfinite(low if u[j] > 0.0 else high):
                modes[e] = RUBS
            continue
        normal = u[j] if mu == 0.0 else u[j + 2]
        if normal < -rest:
            return False
        if normal > rest:
            modes[e] = OPENS
        elif mu > 0.0 and np.hypot(u[j], u[j + 1]) > rest:
            if not coulomb:
                return False
            modes[e] = SLIDES
    return True


@compiled
def _least(
    share: Array, columns: Columns, sites: Array, places: Array, X: Array, twists: Array, f: Array, w: Array
) -> None:  # fmt: skip
    """Write weights of least norm, w = share f, of orthonormal three turned into their axes."""
    product(share, f, w)
    R, turns, last = np.empty((3, 3)), np.empty(3), -1
    for j in range(len(w)):
        if columns.body[j, 4]:
            k, w0, w1, w2 = columns.body[j, 0], w[j], w[j + 1], w[j + 2]
            if k != last:
                last = k
                _placed(sites[k], places[k], X, twists, R, turns)
            for e in range(j, j + 3):
                F0, F1, F2 = _turned(columns, e, R)
                w[e] = F0 * w0 + F1 * w1 + F2 * w2


@compiled
def _inside(elements: Elements, w: Array, modes: Array, cones: bool) -> bool:
    """Whether the weights of all elements at rest, or of the cones among them, are in their sets."""
    for e in range(len(elements.first)):
        j, mu = elements.first[e], elements.mu[e]
        if mu > 0.0:
            if modes[e] == RESTS and not np.hypot(w[j], w[j + 1]) <= mu * w[j + 2]:
                return False
        elif not cones and not elements.lower[e] <= w[j] <= elements.upper[e]:
            return False
    return True


@compiled
def _by_newton(
    terms: Terms, elements: Elements, columns: Columns, felt: Array, offset: Array, u: Array, modes: Array,
    start: Array, coulomb: bool, w: Array,
) -> tuple[float, int, bool]:  # fmt: skip
    """`search` over the elements that are not open; w in the columns at rest."""
    count, singles, cones, sliding = len(modes), 0, 0, False
    for e in range(count):
        if elements.mu[e] > 0.0 and modes[e] == RESTS:
            cones += 1
        elif modes[e] != OPENS:
            singles += 1
    p, parts, d = singles + 3 * cones, singles + cones, felt.shape[1]
    push, pull, apart, guess = np.zeros((p, d)), np.zeros((p, d)), np.zeros(p), np.zeros(p)
    lower, upper, mu = np.empty(singles), np.empty(singles), np.empty(cones)
    first, width, whose = np.empty(parts, np.int64), np.empty(parts, np.int64), np.empty(parts, np.int64)
    i, k = 0, singles
    for e in range(count):
        if modes[e] == OPENS:
            continue
        j, cone = elements.first[e], elements.mu[e] > 0.0 and modes[e] == RESTS
        if cone:
            at, c, mu[k - singles] = k, 3 * k - 2 * singles, elements.mu[e]
            for a in range(3):
                push[c + a], pull[c + a] = felt[j + a], felt[j + a]
                apart[c + a], guess[c + a] = offset[j + a], start[j + a]
            k += 1
        else:
            at, normal = i, j + 2 if elements.mu[e] > 0.0 else j
            pull[i], push[i], apart[i], guess[i] = felt[normal], felt[normal], offset[normal], start[normal]
            lower[i], upper[i] = elements.lower[e], elements.upper[e]
            if modes[e] == SLIDES:
                sliding = True
                speed = math.sqrt(u[j] * u[j] + u[j + 1] * u[j + 1])
                for r in range(d):
                    push[i, r] -= elements.mu[e] * (u[j] * felt[j, r] + u[j + 1] * felt[j + 1, r]) / speed
                guess[i], lower[i], upper[i] = max(start[normal], 0.0), 0.0, math.inf
            elif modes[e] == RUBS:
                lower[i] = upper[i] = elements.lower[e] if u[j] > 0.0 else elements.upper[e]
            i += 1
        first[at], width[at], whose[at] = columns.body[j, 2], columns.body[j, 3], e
    seeds, used = np.empty(parts, np.int64), 0
    for at in range(parts):
        if at < singles or elements.starts[whose[at]]:
            seeds[used] = at
            used += 1
    found = np.empty(p)
    given = Problem(terms.mobility, terms.free, push, pull, apart, first, width, lower, upper, mu)
    merit, steps, convex = search(given, guess, coulomb, sliding, seeds[:used], found)
    w[:] = 0.0
    for at in range(parts):
        e = whose[at]
        j = elements.first[e]
        if at >= singles:
            for a in range(3):
                w[j + a] = found[3 * at - 2 * singles + a]
        elif modes[e] == SLIDES:
            speed = math.sqrt(u[j] * u[j] + u[j + 1] * u[j + 1])
            w[j], w[j + 1] = -elements.mu[e] * found[at] * u[j] / speed, -elements.mu[e] * found[at] * u[j + 1] / speed
            w[j + 2] = found[at]
        else:
            w[j] = found[at]
    return merit, steps, convex


@compiled
def pushed(J: Array, X: Array, i: int, load: Array, parent: Array, generalised: Array) -> None:
    """Add J^T of a force of the world, of the pose of its joint and the last dof that moves it."""
    f, r, p, m = load[:3], load[6:], np.empty(3), np.empty(3)
    for a in range(3):
        p[a] = X[9 + a] + X[a] * r[0] + X[3 + a] * r[1] + X[6 + a] * r[2]
    m[0] = load[3] + p[1] * f[2] - p[2] * f[1]
    m[1] = load[4] + p[2] * f[0] - p[0] * f[2]
    m[2] = load[5] + p[0] * f[1] - p[1] * f[0]
    while i >= 0:
        for a in range(3):
            generalised[i] += J[a, i] * f[a] + J[3 + a, i] * m[a]
        i = parent[i]


def _answer(
    M: Array, J: Array, h: Array, X: Array, twists: Array, rates: Array, parent: Array, sites: Array, places: Array,
    units: Array, gear: Array, fall: Array, v: Array, generalised: Array, space: Array, loaded: Array, loads: Array,
    force: Array, moment: Array, arm: Array, along: Array, body: Array,
    first: Array, lower: Array, upper: Array, mu: Array, share: Array, starts: Array, begin: Array,
    core: int, rest: float, coulomb: bool, closed: bool, repeated: bool, a: Array, w: Array, modes: Array, u: Array,
) -> tuple[int, int, bool]:  # fmt: skip
    """(how it was found, steps, whether rows depend on each other) of the acceleration a and weights w, under the law.

    Args:
        M: As of `row_kernel.row_terms`, as are the next fourteen.
        J: As there.
        h: As there.
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
        loaded: Joint and last dof of the bodies that forces of the world push, shape (l, 2).
        loads: Force and moment there, axes of the world, and the point in the joint's axes, shape (l, 9).
        force: Of `Columns`, as are the next four, in the axes of their sites.
        moment: As there.
        arm: As there.
        along: As there.
        body: As there.
        first: Of `Elements`, as are the next six.
        lower: As there.
        upper: As there.
        mu: As there.
        share: As there.
        starts: As there.
        begin: As there.
        core: Number of the rows of sites and of bilateral joints' rows, which come first.
        rest: Largest speed at rest [m/s, rad/s].
        coulomb: Coulomb's law; else the convex one.
        closed: Whether all forces on the rows are forces of columns.
        repeated: Whether there are more constraint rows than these.
        a: Written.
        w: Weights of the columns at rest; written.
        modes: Written.
        u: Velocities of the columns; written.
    """
    columns, elements = Columns(force, moment, arm, along, body), Elements(first, lower, upper, mu, share, starts, begin)
    n, m, p = len(parent), share.shape[1], len(w)
    terms, f, felt, offset = terms_in(space, n, m), np.empty(m), np.zeros((p, 6)), np.empty(p)
    given = generalised.copy()
    for e in range(len(loaded)):
        pushed(J, X[loaded[e, 0]], loaded[e, 1], loads[e], parent, given)
    all_rows(M, J, h, X, twists, rates, parent, sites, places, units, gear, fall, v, given, terms)
    _felt(columns, sites, places, X, twists, felt, offset)
    still = True
    for j in range(p):
        u[j] = 0.0
        for r in range(columns.body[j, 3]):
            u[j] += felt[j, r] * terms.velocity[columns.body[j, 2] + r]
        still = still and abs(offset[j]) <= _ROUNDING
    if not decide(elements, u, rest, coulomb, modes):
        return NOTHING, 0, False
    for mode in modes:
        still = still and mode == RESTS
    independent = holding_forces(terms, f)
    if independent < 0:
        return NOTHING, 0, False
    _least(share, columns, sites, places, X, twists, f, w)
    how, steps = HELD, 0
    if not (closed and still and _inside(elements, w, modes, False)):
        start = np.empty(p)
        _least(begin, columns, sites, places, X, twists, f, start)
        how, (merit, steps, convex) = NEWTON, _by_newton(terms, elements, columns, felt, offset, u, modes, start, coulomb, w)
        if not merit <= FOUND:
            return NOTHING, steps, independent < m
        f[:] = 0.0
        for j in range(p):
            for r in range(columns.body[j, 3]):
                f[columns.body[j, 2] + r] += felt[j, r] * w[j]
    if how == NEWTON and coulomb and convex and (repeated or independent < m):  # not jammed by internal forces?
        least = np.empty(p)
        _least(share, columns, sites, places, X, twists, f, least)
        if not (closed and independent >= core and _inside(elements, least, modes, True)):
            return NOTHING, steps, independent < m
    accelerated(terms, terms.z, parent, f, a)
    return how, steps, independent < m


_WRITTEN, _WHOLE, TABLE = array(1, written=True), array(1, COUNT), array(2, COUNT)
COLUMN_TYPES = (array(2), array(2), array(2), array(2), TABLE)
ELEMENT_TYPES = (_WHOLE, array(1), array(1), array(1), array(2), array(1, FLAG), array(2))
answer = compiled(
    _answer,
    signature(
        (COUNT, COUNT, FLAG), array(2, layout="A"), array(2, layout="A"), array(1), array(2), array(2), array(2), _WHOLE,
        TABLE, array(2), TABLE, array(1), array(1), array(1), array(1), _WRITTEN, TABLE, array(2),
        *COLUMN_TYPES, *ELEMENT_TYPES, COUNT, NUMBER, FLAG, FLAG, FLAG,
        _WRITTEN, _WRITTEN, array(1, COUNT, written=True), _WRITTEN,
    ),
)  # fmt: skip
