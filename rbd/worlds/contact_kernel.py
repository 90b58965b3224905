"""Impulses of contact points and joints under the law, by Newton's method, for one world or eight.

    find w in its sets,   y = Q'^T D Q w + c   paired with it:   w = P(w - y)

Rows are those of *sites*: three of a body that touches at one point, six of one that touches at several, one of a joint; D is
the sites' mobility J M^-1 J^T. Q w is a force and a moment about the site's point; w of a point is in the world's axes, in
units in which its mobility is of order one; Q' has the points' arms at the end of the step. With V the slope of P, point by
point M = (I - (1 - k) V)^-1 V and h = (I - (1 - k) V)^-1 (P - w):

    (I + C^T Q M Q'^T C) g = C^T Q h,      dw = h - M Q'^T C g,      D = C C^T

as in `rbd.solvers.newton_kernel`, of which this is the form without branches: worlds whose points stick, slip and are open at
different times take the same steps, and what is solved stands still. D may be singular: a column of C without mobility is zero.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.kernels import compiled, inlined
from rbd.worlds.lanes import Number, above, largest, load, root, spread, store
from rbd.worlds.layout import (
    ACROSS,
    ALONG,
    ARM,
    EDGE,
    FELT,
    FIRST,
    GAP,
    IDLE,
    LEAST,
    LEFT,
    LIGHT,
    MANY,
    MERIT,
    MERITS,
    MU,
    NORMAL,
    OFFSET,
    POINT,
    SHIFT,
    SIDE,
    SIZE,
    SQUARE,
    STICK,
    STILL,
    UNIT,
    Law,
)
from rbd.worlds.sites_kernel import Sites
from rbd.worlds.spatial_kernel import Nine, Three, cross, dot, minus, plus, put, three, times, turned

MOST, TRIES, EARLY, GROWS, AGAIN, OPEN, LAST = 32, 7, 3, 4.0, 8, 20, 4
"""Newton's steps; halvings of one; the first in which the sum of squares may grow, and how much; the steps before which worlds
that are not solved begin again, with all points sticking, and with all open; steps of worlds that were solved alone."""
SOLVED = 5e-9
"""Scaled residual of the law at which a world stands still."""
FOUND = 1e-8
"""That at which its answer is taken, if a further step has not halved it."""
DEPENDENT, TINY = 1e-13, 1e-300
PROXIMAL = 1e-7
"""Compliance in Newton's matrix."""


@compiled
def factor(law: Law, rows: int) -> None:
    """Write C; a column is zero where its row depends on those before."""
    zero = spread(law.w, 0.0)
    for i in range(rows):
        for j in range(i + 1):
            x = load(law.mobility, i * rows + j)
            for k in range(j):
                x = x - load(law.factor, i * rows + k) * load(law.factor, j * rows + k)
            if j < i:
                store(law.factor, i * rows + j, x * load(law.answer, j))
            else:
                enough = DEPENDENT * load(law.mobility, i * rows + i)
                inverse = above(x, enough, 1.0 / root(above(x, enough, x, zero + 1.0)), zero)
                store(law.factor, i * rows + i, x * inverse)
                store(law.answer, i, inverse)


@compiled
def evaluate(sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, w: Array, law: Law) -> None:
    """Write P(w - y) - w of all parts, their slopes, the merit and the sum of squares.

    The merit is the largest of the parts': velocities of points that touch over their least scale; what else is missing over
    the part's weight, or that scale, whichever makes it more. So it is no less than the scaled residuals of the law in
    `rbd.problem.residuals`.
    """
    zero, one, k3 = spread(w, 0.0), spread(w, 1.0), 3 * len(sites.arm)
    loads(sites, active, count, starts, w, law)
    for i in range(rows):
        x = zero
        for j in range(rows):
            x = x + load(law.mobility, i * rows + j) * load(law.load, j)
        store(law.answer, i, x)
    top, square = zero, zero
    for a in range(count):
        s = active[a]
        i, size = starts[a], sites.site[s, SIZE]
        if size == 1:
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                q, unit = 8 * l, load(law.single, 8 * l + 3)
                x = load(w, k3 + l)
                p = x - unit * (load(law.single, q) + load(law.answer, i))
                low, high = load(law.single, q + 1), load(law.single, q + 2)
                inside = above(p, low, one, zero) * above(high, p, one, zero)
                gap = above(p, high, high, above(low, p, low, p)) - x
                store(law.single, q + 4, gap)
                store(law.single, q + 5, inside)
                square = square + gap * gap
                least, still, held = load(law.single, q + 7), load(law.single, q + 6), above(x, zero, x, -x)
                light = 1.0 / above(held, least, held, least)
                far = above(gap, zero, gap, -gap) * above(light, still, light, still)
                top = above(far, top, far, top)
            continue
        turn = three(law.answer, i + 3) if size == 6 else (zero, zero, zero)
        linear = three(law.answer, i)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            q = POINT * c
            n, mu, unit, x = three(law.point, q + NORMAL), load(law.point, q + MU), load(law.point, q + UNIT), three(w, 3 * c)
            u = plus(three(law.point, q + OFFSET), plus(linear, cross(turn, three(law.point, q + FELT))))
            p = minus(x, times(unit, u))
            normal = dot(n, p)
            along = minus(p, times(normal, n))
            length = root(dot(along, along) + TINY)
            e = times(1.0 / length, along)
            open_ = above(normal, zero, zero, one) if coulomb else above(normal + mu * length, zero, zero, one)
            touching = one - open_
            if coulomb:
                reach = mu * normal
                slips = above(length, reach, touching, zero)
                share = above(length, reach, reach / length, one)
                pressed = normal
            else:
                slips = above(length, mu * normal, touching, zero)
                pressed = above(length, mu * normal, (normal + mu * length) / (1.0 + mu * mu), normal)
                share = above(length, mu * normal, mu * pressed / length, one)
            # P: the normal part `pressed` and the share of the tangent one; open points have none
            gap = minus(times(touching, plus(times(pressed, n), times(share, along))), x)
            idle = load(law.point, q + IDLE)
            gap = times(1.0 - idle, gap)
            put(law.point, q + GAP, gap)
            live = 1.0 - idle
            store(law.point, q + STICK, live * (touching - slips))
            store(law.point, q + EDGE, live * slips)
            store(law.point, q + SIDE, live * slips * share / (1.0 - (1.0 - PROXIMAL) * share * slips))
            put(law.point, q + ACROSS, cross(n, e))
            put(law.point, q + ALONG, e)
            least, held, still = load(law.point, q + LIGHT), dot(n, x), load(law.point, q + STILL)
            square = square + dot(gap, gap)
            moves = times(touching - slips, gap)  # the part of the gap that is of the velocity alone
            if coulomb:
                moves = plus(moves, times(slips * dot(n, gap), plus(n, times(mu, e))))
            pushes, across = minus(gap, moves), minus(x, times(held, n))
            rubs, slide = root(dot(across, across)), minus(along, across)
            held_by = above(slips, 0.5, rubs, held)
            light = 1.0 / above(held_by, least, held_by, least)
            far, out = root(dot(pushes, pushes)), live * (rubs - mu * held)
            # the angle between force and slip grows with the velocity's part in it, at most by this
            turned_by = light * (1.0 + rubs / root(dot(slide, slide) + TINY))
            scale = above(still, light, above(still, turned_by, turned_by, still), light)
            far = above(far, out, far, out) * scale
            top = above(far, top, far, top)
            far = still * root((1.0 + mu * mu) * dot(moves, moves))  # that along n also widens what holds it across
            top = above(far, top, far, top)
    store(law.merit, MERIT, top)
    store(law.merit, SQUARE, square)


@compiled
def loads(sites: Sites, active: Array, count: int, starts: Array, w: Array, law: Law) -> None:
    """Write Q w."""
    zero, k3 = spread(w, 0.0), 3 * len(sites.arm)
    for a in range(count):
        s = active[a]
        i, size = starts[a], sites.site[s, SIZE]
        if size == 1:
            x = zero
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                x = x + load(law.single, 8 * l + 3) * load(w, k3 + l)
            store(law.load, i, x)
            continue
        f, m = (zero, zero, zero), (zero, zero, zero)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            x = times(load(law.point, POINT * c + UNIT), three(w, 3 * c))
            f, m = plus(f, x), plus(m, cross(three(law.point, POINT * c + ARM), x))
        put(law.load, i, f)
        if size == 6:
            put(law.load, i + 3, m)


@inlined
def easing(law: Law, q: int, coulomb: bool) -> Nine:
    """M of a point: what its weights change by for accelerations against them."""
    n, e, s, mu = (
        three(law.point, q + NORMAL),
        three(law.point, q + ALONG),
        three(law.point, q + ACROSS),
        load(law.point, q + MU),
    )
    stick, slip, side = load(law.point, q + STICK), load(law.point, q + EDGE), load(law.point, q + SIDE)
    edge, hold = plus(times(mu, e), n), stick * (1.0 / PROXIMAL)
    met = n if coulomb else times(1.0 / (1.0 + mu * mu), edge)
    a, b = times(slip * (1.0 / PROXIMAL), edge), times(side, s)
    return (
        hold + a[0] * met[0] + b[0] * s[0], a[0] * met[1] + b[0] * s[1], a[0] * met[2] + b[0] * s[2],
        a[1] * met[0] + b[1] * s[0], hold + a[1] * met[1] + b[1] * s[1], a[1] * met[2] + b[1] * s[2],
        a[2] * met[0] + b[2] * s[0], a[2] * met[1] + b[2] * s[1], hold + a[2] * met[2] + b[2] * s[2],
    )  # fmt: skip


@compiled
def newton_step(sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, law: Law) -> None:
    """Write Newton's step into `law.move`."""
    zero, one, k3, B, T = spread(law.w, 0.0), spread(law.w, 1.0), 3 * len(sites.arm), law.block, law.turned
    for a in range(count):
        s = active[a]
        i, size = starts[a], sites.site[s, SIZE]
        end = i + size
        if size == 1:
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                inside = load(law.single, 8 * l + 5)
                store(law.move, k3 + l, load(law.single, 8 * l + 4) * (1.0 + inside * ((1.0 - PROXIMAL) / PROXIMAL)))
            weight = zero
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                unit = load(law.single, 8 * l + 3)
                weight = weight + load(law.single, 8 * l + 5) * unit * unit * (1.0 / PROXIMAL)
            for j in range(end):
                store(T, i * rows + j, weight * load(law.factor, i * rows + j))
            continue
        for r in range(36):
            store(B, r, zero)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            q = POINT * c
            M, gap, unit = easing(law, q, coulomb), three(law.point, q + GAP), load(law.point, q + UNIT)
            put(law.move, 3 * c, plus(gap, times(1.0 - PROXIMAL, turned(M, gap))))
            square, r, felt = unit * unit, three(law.point, q + ARM), three(law.point, q + FELT)
            x, y, z = (M[0], M[3], M[6]), (M[1], M[4], M[7]), (M[2], M[5], M[8])
            x, y, z = times(square, x), times(square, y), times(square, z)
            put_columns(B, 0, x, y, z)
            if size == 6:
                put_columns(B, 18, cross(r, x), cross(r, y), cross(r, z))
                # -M [felt]x: M (e x felt) of each direction e of turning
                u = minus(times(felt[1], z), times(felt[2], y))
                v = minus(times(felt[2], x), times(felt[0], z))
                w = minus(times(felt[0], y), times(felt[1], x))
                put_columns(B, 3, u, v, w)
                put_columns(B, 21, cross(r, u), cross(r, v), cross(r, w))
        for e in range(size):
            for j in range(end):
                t = zero
                for d in range(max(0, j - i), size):
                    t = t + load(B, 6 * e + d) * load(law.factor, (i + d) * rows + j)
                store(T, (i + e) * rows + j, t)
    loads(sites, active, count, starts, law.move, law)
    A, g = law.system, law.answer
    for i in range(rows):
        t = zero
        for k in range(i, rows):
            t = t + load(law.factor, k * rows + i) * load(law.load, k)
        store(g, i, t)
        for a in range(count):
            for j in range(starts[a], starts[a] + sites.site[active[a], SIZE]):
                t = one if i == j else zero
                for k in range(max(i, starts[a]), rows):  # rows of the sites before know nothing of this one
                    t = t + load(law.factor, k * rows + i) * load(T, k * rows + j)
                store(A, i * rows + j, t)
    for k in range(rows):
        pivot = 1.0 / load(A, k * rows + k)
        store(A, k * rows + k, pivot)
        y = load(g, k)
        for i in range(k + 1, rows):
            f = load(A, i * rows + k) * pivot
            store(g, i, load(g, i) - f * y)
            for j in range(k + 1, rows):
                store(A, i * rows + j, load(A, i * rows + j) - f * load(A, k * rows + j))
    for b in range(rows):
        i = rows - 1 - b
        t = load(g, i)
        for j in range(i + 1, rows):
            t = t - load(A, i * rows + j) * load(g, j)
        store(g, i, t * load(A, i * rows + i))
    for b in range(rows):  # C g, from the last row up
        i = rows - 1 - b
        t = zero
        for j in range(i + 1):
            t = t + load(law.factor, i * rows + j) * load(g, j)
        store(g, i, t)
    for a in range(count):
        s = active[a]
        i, size = starts[a], sites.site[s, SIZE]
        if size == 1:
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                x = load(law.single, 8 * l + 5) * load(law.single, 8 * l + 3) * (1.0 / PROXIMAL) * load(g, i)
                store(law.move, k3 + l, load(law.move, k3 + l) - x)
            continue
        turn = three(g, i + 3) if size == 6 else (zero, zero, zero)
        linear = three(g, i)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            q = POINT * c
            u = times(load(law.point, q + UNIT), plus(linear, cross(turn, three(law.point, q + FELT))))
            put(law.move, 3 * c, minus(three(law.move, 3 * c), turned(easing(law, q, coulomb), u)))


@inlined
def put_columns(B: Array, i: int, x: Three, y: Three, z: Three) -> None:
    """Add three columns to a block of three rows of six numbers, from entry i on."""
    for r in range(3):
        store(B, i + 6 * r, load(B, i + 6 * r) + x[r])
        store(B, i + 6 * r + 1, load(B, i + 6 * r + 1) + y[r])
        store(B, i + 6 * r + 2, load(B, i + 6 * r + 2) + z[r])


@compiled
def solved(
    sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, fresh: Number, law: Law, which: Number,
    most: int,
) -> int:  # fmt: skip
    """Newton's steps from the weights in `law.w`, and how many; `law.best` gets the best found, `law.merit` how good they are.

    At most `most`, of the worlds in which `which` is one. Worlds that are `fresh`, and later those that are not solved yet,
    begin with all points sticking, by weights of least norm: of several weights for one motion these are seldom at the edge of
    a cone, where Newton's method is slow.
    """
    zero, one, k3 = spread(law.w, 0.0), spread(law.w, 1.0), 3 * len(sites.arm)
    factor(law, rows)
    begun(sites, active, count, fresh, law)
    evaluate(sites, active, count, starts, rows, coulomb, law.w, law)
    store(law.merit, LEAST, load(law.merit, MERIT))
    copied(sites, active, count, law.w, law.best, one)
    waits = above(load(law.merit, LEAST), SOLVED, which, zero)
    stick, early = fresh * waits, 0
    for step in range(most):
        if largest(waits) == 0.0:
            return step
        if step == AGAIN or step == OPEN:
            stick, early = waits if step == AGAIN else zero, step
            begun(sites, active, count, waits, law)
            if step == OPEN:
                unshifted(sites, active, count, waits, law)
                store(law.merit, LEAST, above(waits, 0.5, 1e30 * one, load(law.merit, LEAST)))  # of another problem
            evaluate(sites, active, count, starts, rows, coulomb, law.w, law)
        if largest(stick) > 0.0:
            stuck(sites, active, count, stick, law)
        newton_step(sites, active, count, starts, rows, coulomb, law)
        before, t = load(law.merit, SQUARE), waits
        for _ in range(TRIES):
            for a in range(count):
                s, first = active[a], sites.site[active[a], FIRST]
                single = sites.site[s, SIZE] == 1
                low = k3 + first if single else 3 * first
                for i in range(low, low + sites.site[s, MANY] * (1 if single else 3)):
                    x = load(law.w, i)
                    store(law.new, i, above(t, zero, x + t * load(law.move, i), x))
            evaluate(sites, active, count, starts, rows, coulomb, law.new, law)
            allowed = before * (GROWS * one if step < early + EARLY else 1.0 - 1e-4 * t) + 1e30 * stick
            fine = above(load(law.merit, SQUARE), allowed, zero, above(load(law.merit, SQUARE), -1.0, one, zero))
            fine = above(waits, 0.5, fine, one)
            if largest(one - fine) == 0.0:
                break
            t = above(fine, 0.5, t, 0.5 * t)
        copied(sites, active, count, law.new, law.w, one)
        better = above(load(law.merit, LEAST), load(law.merit, MERIT), one, zero)
        copied(sites, active, count, law.w, law.best, better)
        least = load(law.merit, LEAST)
        stalls = above(least, FOUND, zero, above(load(law.merit, MERIT), 0.5 * least, one, zero))
        least = above(better, 0.5, load(law.merit, MERIT), least)
        store(law.merit, LEAST, least)
        waits = above(least, SOLVED, waits, zero) * (1.0 - stalls)
        stick = zero
    return most


@compiled
def polished(sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, law: Law) -> None:
    """Take some more of Newton's steps in worlds that were solved alone, by methods with other scales."""
    zero, one = spread(law.w, 0.0), spread(law.w, 1.0)
    left = load(law.merit, LEFT)
    copied(sites, active, count, law.best, law.w, one)
    solved(sites, active, count, starts, rows, coulomb, zero, law, above(left, 0.5, zero, above(left, 0.0, one, zero)), LAST)
    store(law.merit, LEFT, above(left, 0.5, one, zero))


@compiled
def begun(sites: Sites, active: Array, count: int, which: Number, law: Law) -> None:
    """Set the weights to zero in lanes where `which` is one."""
    zero, k3 = spread(law.w, 0.0), 3 * len(sites.arm)
    for a in range(count):
        s = active[a]
        first, many, single = sites.site[s, FIRST], sites.site[s, MANY], sites.site[s, SIZE] == 1
        low = k3 + first if single else 3 * first
        for i in range(low, low + many * (1 if single else 3)):
            store(law.w, i, above(which, 0.5, zero, load(law.w, i)))


@compiled
def unshifted(sites: Sites, active: Array, count: int, which: Number, law: Law) -> None:
    """Let friction oppose the velocity at the end of the step: it may be that none opposes that in its middle."""
    for a in range(count):
        s = active[a]
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY] if sites.site[s, SIZE] > 1 else 0):
            shift = times(which, three(law.point, POINT * c + SHIFT))
            put(law.point, POINT * c + OFFSET, minus(three(law.point, POINT * c + OFFSET), shift))
            put(law.point, POINT * c + SHIFT, minus(three(law.point, POINT * c + SHIFT), shift))


@compiled
def stuck(sites: Sites, active: Array, count: int, which: Number, law: Law) -> None:
    """Let Newton's next step, from no weights, hold all points within reach: its modes, and -y in place of P(-y)."""
    zero = spread(law.w, 0.0)
    for a in range(count):
        s = active[a]
        if sites.site[s, SIZE] == 1:
            continue
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            q = POINT * c
            unit, live = load(law.point, q + UNIT), 1.0 - load(law.point, q + IDLE)
            store(law.point, q + STICK, above(which, 0.5, live, load(law.point, q + STICK)))
            store(law.point, q + EDGE, above(which, 0.5, zero, load(law.point, q + EDGE)))
            for r in range(3):
                y = -(unit * load(law.point, q + OFFSET + r)) * live
                store(law.point, q + GAP + r, above(which, 0.5, y, load(law.point, q + GAP + r)))


@compiled
def copied(sites: Sites, active: Array, count: int, x: Array, y: Array, which: Number) -> None:
    """Copy the weights of the active sites from x to y, in lanes where `which` is one."""
    k3 = 3 * len(sites.arm)
    for a in range(count):
        s = active[a]
        first, many, single = sites.site[s, FIRST], sites.site[s, MANY], sites.site[s, SIZE] == 1
        low = k3 + first if single else 3 * first
        for i in range(low, low + many * (1 if single else 3)):
            store(y, i, above(which, 0.5, load(x, i), load(y, i)))


@inlined
def offsets(sizes: tuple[int, ...]) -> Array:
    """Where each of some arrays begins in one, and the end."""
    out = np.zeros(len(sizes) + 1, np.int64)
    for i in range(len(sizes)):
        out[i + 1] = out[i] + sizes[i]
    return out


@inlined
def law_in(space: Array, sites: Sites, n: int) -> Law:
    """The contact problem's memory, at the beginning of some."""
    k, l, s, rows = len(sites.arm), len(sites.single), len(sites.site), 0
    for a in range(s):
        rows += sites.site[a, SIZE]
    w, square = 3 * k + l, rows * rows
    at = offsets((rows * n, 6 * rows, square, square, square, POINT * k, 8 * l, w, w, w, w, s, 36, square, rows, rows, MERITS))
    return Law(
        space[at[0] : at[1]], space[at[1] : at[2]], space[at[2] : at[3]], space[at[3] : at[4]], space[at[4] : at[5]],
        space[at[5] : at[6]], space[at[6] : at[7]], space[at[7] : at[8]], space[at[8] : at[9]], space[at[9] : at[10]],
        space[at[10] : at[11]], space[at[11] : at[12]], space[at[12] : at[13]], space[at[13] : at[14]],
        space[at[14] : at[15]], space[at[15] : at[16]], space[at[16] : at[17]],
    )  # fmt: skip


def law_size(n: int, sites: Sites) -> int:
    """Rows of that memory."""
    k, l, s, rows = len(sites.arm), len(sites.single), len(sites.site), int(sites.site[:, SIZE].sum())
    return rows * (n + 8) + 4 * rows * rows + POINT * k + 8 * l + 4 * (3 * k + l) + s + 36 + MERITS
