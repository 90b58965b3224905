"""Time steps of many worlds: eight at once, block after block, each step with its residuals.

A step of length h from (q, v), as of `rbd.simulation.time_step` but for the velocity in its middle, which follows from the
accelerations of the two steps before:

    q_m = q (+) h/2 v,   v_h = v + h/2 (7/4 a_1 - 3/4 a_2)
    M(q_m) v+ = M v + h (S^T tau + tau_ext - h(q_m, v_h)) + J(q_m)^T p,      u(v+) obeys the law
    q+ = q_m (+) h/2 v+

u = J v+ + h/2 J_dot v is the velocity of the points at the end of the step. Order 2 while no point touches, leaves, or begins to
slide. Where one arrives at the time s of the step, q+ = q (+) s v (+) (h - s) v+, and v+ is that after the impact: order 1.

    u_n >= -a_share g/h of a closed point, whose gap g is a rounding error;  u_n >= -g_s / (h - s) of one above its plane

The residuals are those of another way: the equation of motion by the accelerations of the centres of mass, from a second copy of
the masses, and the law by the velocities of the bodies after the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, inlined, signature
from rbd.worlds.contact_kernel import (
    ARM,
    ARRIVAL,
    ARRIVES,
    BODY,
    DEEP,
    FELT,
    FIRST,
    FOUND,
    GAP,
    IDLE,
    LEAST,
    LEFT,
    MANY,
    MERIT,
    MU,
    NORMAL,
    OFFSET,
    POINT,
    SCALE,
    SHIFT,
    SIZE,
    TINY,
    UNIT,
    SITE_TYPES,
    Law,
    Sites,
    evaluate,
    law_in,
    law_size,
    loads,
    mobility,
    offsets,
    site_point,
    solved,
)
from rbd.worlds.lanes import Number, above, largest, load, root, spread, store
from rbd.worlds.spatial_kernel import Three, cross, dot, minus, nine, plus, put, six, three, times, turned, turned_symmetric
from rbd.worlds.tree_kernel import C, D, P, R, ROWS, S, U, V, W, Tree, base_upper, free_motion, places

STIFF, DAMP, TARGET, FEED, LIMIT, VISCOUS, RUBS, LOW, HIGH = range(9)
"""Rows of a joint: gains and target of its motor, its torque, the limit of both, then damping, dry friction and range of the joint."""
JOINT = 9
RUB, STOP = 0, 1
"""What a single row is: dry friction of its joint, or a stop."""
PUSH = 12
"""Rows of a push: place in its body (3), force and moment in the world's axes (3, 3), beginning, end, and none."""
INERTIA = 11
"""Numbers of a body: mass, centre of mass, inertia about it, armature of its joint."""
WORLD = 4
"""Rows of a world: gravity (3), height of the ground."""
EQUATION, CONTACT, DEPTH, RESCUED, STOPPED, TURN = range(6)
"""Rows of what is told of a world: largest residuals of equation and law, largest depth [m], steps solved alone, whether it
stopped: 0, or the number of the step plus one; and the largest angle by which a body turned in a step [rad]."""
TOLD = 6
WILD = 1.0
"""A world in which a body turns by more than this in a step [rad] stops."""
MOBILITY = 3.0
"""Of each scaled point: between fewest steps of points that slide, 1, and of those that strike, 10."""
SHARE = 0.5
"""Part of a gap that a closed point loses a step."""
BLOCK, STEP, PART, HOW_MANY, HOW_WIDE, ACTIVE = range(6)
"""Where a run is: its block, step and part of it (1: impulses of some worlds are to be found alone); how many sites are active, how
many rows they have; and where the active sites and their first rows begin."""


class Ground(NamedTuple):
    """What the points may touch.

    Attributes:
        plane: Normal and height of the plane of each point, shape (k, 4); unused where it is on pieces.
        pieces: First and last piece under each point, shape (k, 2); none: on its plane.
        faces: Where those of a piece begin, shape (pieces + 1,).
        face: Outward normals and distances from the origin, shape (faces, 4).
    """

    plane: Array
    pieces: Array
    faces: Array
    face: Array


class Given(NamedTuple):
    """What acts in the worlds of one block: rows by lanes.

    Attributes:
        inertia: As of `free_motion`, shape (11 n,).
        proof: The same, for the residuals.
        joint: Shape (JOINT joints,).
        world: Shape (WORLD,).
        friction: Shape (k,).
        push: Shape (PUSH pushes,).
    """

    inertia: Array
    proof: Array
    joint: Array
    world: Array
    friction: Array
    push: Array


class Space(NamedTuple):
    """Working memory of one block: rows by lanes."""

    x: Array
    y: Array
    v: Array
    acc: Array
    end: Array
    free: Array
    work: Array
    base: Array
    tau: Array
    damping: Array
    pushes: Array


@inlined
def moved(q: Array, v: Array, h: Number, free: int, out: Array) -> None:
    """Write q (+) h v."""
    if free:
        put(out, 0, plus(three(q, 0), times(h, three(v, 0))))
        w = times(0.5 * h, three(v, 3))
        square = dot(w, w)
        # sin|w|/|w| and cos|w| by their series: |w| is half the angle of a step
        s = 1.0 - square * (1.0 / 6.0) * (1.0 - square * (1.0 / 20.0) * (1.0 - square * (1.0 / 42.0) * (1.0 - square * (1.0 / 72.0))))
        c = 1.0 - square * 0.5 * (1.0 - square * (1.0 / 12.0) * (1.0 - square * (1.0 / 30.0) * (1.0 - square * (1.0 / 56.0))))
        r, u = times(s, w), load(q, 6)
        p = three(q, 3)
        z = plus(plus(times(c, p), times(u, r)), cross(r, p))
        e = c * u - dot(r, p)
        unit = 1.0 / root(dot(z, z) + e * e)
        put(out, 3, times(unit, z))
        store(out, 6, unit * e)


@compiled
def moved_all(q: Array, v: Array, h: Number, free: int, n: int, out: Array) -> None:
    """Write q (+) h v of base and joints."""
    moved(q, v, h, free, out)
    for j in range(n - free):
        store(out, 7 * free + j, load(q, 7 * free + j) + h * load(v, 6 * free + j))


@compiled
def surface(ground: Ground, c: int, height: Number, x: Three) -> tuple[Number, Three]:
    """Distance of a point from the ground, and the normal there."""
    zero = height * 0.0
    if ground.pieces[c, 0] == ground.pieces[c, 1]:
        n = (zero + ground.plane[c, 0], zero + ground.plane[c, 1], zero + ground.plane[c, 2])
        return dot(n, x) - ground.plane[c, 3] - n[2] * height, n
    nearest, n = zero + 1e30, (zero, zero, zero + 1.0)
    for p in range(ground.pieces[c, 0], ground.pieces[c, 1]):
        out, m = zero - 1e30, (zero, zero, zero)
        for f in range(ground.faces[p], ground.faces[p + 1]):
            g = ground.face[f]
            d = g[0] * x[0] + g[1] * x[1] + g[2] * (x[2] - height) - g[3]
            m = (above(d, out, zero + g[0], m[0]), above(d, out, zero + g[1], m[1]), above(d, out, zero + g[2], m[2]))
            out = above(d, out, d, out)
        n = (above(nearest, out, m[0], n[0]), above(nearest, out, m[1], n[1]), above(nearest, out, m[2], n[2]))
        nearest = above(nearest, out, out, nearest)
    return nearest, n


@compiled
def forces(tree: Tree, given: Given, push_body: Array, t: float, h: float, q: Array, v: Array, space: Space) -> None:
    """Write torques of the joints, what adds to their inertia, and forces on the bodies about O."""
    free, n, half = tree.free, len(tree.parent), 0.5 * h
    for j in range(n - free):
        o, i = JOINT * j, 6 * free + j
        k, d, limit = load(given.joint, o + STIFF), load(given.joint, o + DAMP), load(given.joint, o + LIMIT)
        still = load(given.joint, o + FEED) + k * (load(given.joint, o + TARGET) - load(space.x, 7 * free + j))
        wanted = still - d * load(space.v, i)
        low = above(-limit, wanted, 1.0 + 0.0 * k, 0.0 * k)
        high = above(wanted, limit, 1.0 + 0.0 * k, 0.0 * k)
        inside = 1.0 - low - high
        rate, viscous = load(v, i), load(given.joint, o + VISCOUS)
        motor = above(inside, 0.5, still - d * rate, above(high, 0.5, limit, -limit))
        store(space.tau, j, motor - viscous * rate)
        store(space.damping, j, half * (viscous + inside * d))
    for r in range(6 * n):
        store(space.pushes, r, spread(space.v, 0.0))
    for p in range(len(push_body)):
        o, b = PUSH * p, push_body[p]
        begins, ends = load(given.push, o + 9), load(given.push, o + 10)
        last, first = above(ends, t + h, t + h + 0.0 * ends, ends), above(t, begins, t + 0.0 * ends, begins)
        part = (last - first) * (1.0 / h)
        part = above(part, 0.0, part, 0.0 * part)
        f, m = times(part, three(given.push, o + 3)), times(part, three(given.push, o + 6))
        at = plus(three(space.work, b * ROWS + P), turned(nine(space.work, b * ROWS + R), three(given.push, o)))
        put(space.pushes, 6 * b, plus(three(space.pushes, 6 * b), f))
        put(space.pushes, 6 * b + 3, plus(three(space.pushes, 6 * b + 3), plus(m, cross(at, f))))


@inlined
def of_site(tree: Tree, sites: Sites, s: int, work: Array, v: Array) -> tuple[Three, Three]:
    """Velocity about O of a site's body, of generalised velocities."""
    zero = spread(v, 0.0)
    l, w = (zero, zero, zero), (zero, zero, zero)
    if tree.free:
        l, w = three(v, 0), three(v, 3)
    for k in range(sites.path_start[s], sites.path_start[s + 1]):
        j = sites.path[k]
        x, o = load(v, 5 * tree.free + j), j * ROWS
        l, w = plus(l, times(x, three(work, o + S))), plus(w, times(x, three(work, o + S + 3)))
    return l, w


@compiled
def touched(
    tree: Tree, sites: Sites, ground: Ground, given: Given, h: float, q: Array, v: Array, before: Array, impulse: Array,
    moves: Number, space: Space, law: Law, active: Array,
) -> tuple[int, Number, Number]:  # fmt: skip
    """Write what is near a surface and how it moves: (sites, time of the step at which one arrives, whether one does)."""
    work, half, count, zero, one, free = space.work, 0.5 * h, 0, spread(v, 0.0), spread(v, 1.0), tree.free
    origin = three(space.x, 0) if free else (zero, zero, zero)
    height = load(given.world, 3)
    g = three(given.world, 0)
    near = h * h * root(dot(g, g)) + 1e-12
    slow = 2.0 * h * root(dot(g, g)) + 1e-12
    arrival = half * one
    arrives = zero
    for s in range(len(sites.site)):
        b, first, many = sites.site[s, BODY], sites.site[s, FIRST], sites.site[s, MANY]
        o, live = b * ROWS, zero
        if sites.site[s, SIZE] == 1:
            continue
        Q, p, l, w = nine(work, o + R), three(work, o + P), three(work, o + V), three(work, o + V + 3)
        for c in range(first, first + many):
            r = sites.arm[c]
            x = plus(p, turned(Q, (one * r[0], one * r[1], one * r[2])))
            gap, n = surface(ground, c, height, plus(x, origin))
            u = plus(l, cross(w, x))
            put(law.point, POINT * c + ARM, x)
            put(law.point, POINT * c + NORMAL, n)
            store(law.point, POINT * c + MU, gap)
            reach = h * (3.0 + 2.0 * root(dot(u, u)))
            idle = above(gap, reach, one, above(moves, 0.5, zero, one))
            store(law.point, POINT * c + IDLE, idle)
            live = above(idle, 0.5, live, one)
        store(law.live, s, live)
        if largest(live) == 0.0:
            continue
        active[count] = s
        count += 1
        bl, bw = zeros(zero), zeros(zero)
        if free:
            bl = three(work, C)
        for k in range(sites.path_start[s], sites.path_start[s + 1]):
            j = sites.path[k]
            bl, bw = plus(bl, three(work, j * ROWS + C)), plus(bw, three(work, j * ROWS + C + 3))
        el, ew = of_site(tree, sites, s, work, space.end)
        vl, vw = of_site(tree, sites, s, work, v)
        place = site_point(sites, s, work)
        spin, lift = plus(ew, times(half, bw)), plus(bl, cross(w, plus(l, cross(w, place))))
        stop = plus(plus(el, cross(ew, place)), times(half, plus(plus(bl, cross(bw, place)), cross(w, plus(l, cross(w, place))))))
        for c in range(first, first + many):
            x, n, gap = three(law.point, POINT * c + ARM), three(law.point, POINT * c + NORMAL), load(law.point, POINT * c + MU)
            middle = plus(l, cross(w, x))
            bias = plus(plus(bl, cross(bw, x)), cross(w, middle))
            start, rigid = minus(plus(vl, cross(vw, x)), times(half, bias)), plus(lift, cross(bw, x))
            # At the end, the body's turning at the arm as it is turned then, on the ground: sliding of all points of a body can
            # stop at once, whatever their gaps.
            arm = minus(x, place)
            felt = plus(arm, times(half, cross(w, arm)))
            felt = minus(felt, times(gap + half * dot(n, middle), n)) if sites.site[s, SIZE] == 6 else zeros(zero)
            end = plus(stop, cross(spin, felt))
            put(law.point, POINT * c + FELT, felt)
            u = dot(n, start)
            gap = gap - half * u - 0.5 * half * half * dot(n, rigid)
            store(law.point, POINT * c + MU, gap)
            put(law.point, POINT * c + OFFSET, end)
            # of points that slide throughout, friction opposes the velocity in the middle
            along = minus(middle, times(dot(n, middle), n))
            shift = minus(start, middle)
            shift = minus(shift, times(dot(n, shift), n))
            pressed = three(impulse, 3 * c)
            slides = above(dot(along, along), 16.0 * dot(shift, shift) + 1e-12, one, zero) * above(dot(n, pressed), zero, one, zero)
            put(law.point, POINT * c + SHIFT, times(slides, shift))
            store(law.point, POINT * c + GAP, u)
            # arrival: the point is above its surface, or just on it, approaches, and would be below at the end
            live = 1.0 - load(law.point, POINT * c + IDLE)
            passes = above(-slow, u, one, zero) * above(-near, gap + half * (u + dot(n, end)), one, zero) * live
            passes = passes * above(gap, -near, one, zero)
            time = above(gap, zero, gap / above(-u, TINY, -u, one), zero)
            time = above(time, h * one, h * one, time)
            arrival = above(passes, 0.5, above(arrives, 0.5, above(arrival, time, time, arrival), time), arrival)
            arrives = above(passes, 0.5, one, arrives)
    left = above(h - arrival, 1e-3 * h, h - arrival, 1e-3 * h * one)
    for a in range(count):
        s = active[a]
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            n, gap, u = three(law.point, POINT * c + NORMAL), load(law.point, POINT * c + MU), load(law.point, POINT * c + GAP)
            shift = three(law.point, POINT * c + SHIFT)
            closed = above(near, gap, one, zero)
            back = SHARE * gap * (1.0 / h)
            back = above(-back, 0.1, -0.1 * one, back)
            later = gap + arrival * u
            later = above(later, zero, later, zero) / left
            apart = above(closed, 0.5, back, later)
            shift = times(closed * (1.0 - arrives), shift)
            put(law.point, POINT * c + SHIFT, shift)
            put(law.point, POINT * c + OFFSET, plus(three(law.point, POINT * c + OFFSET), plus(times(apart, n), shift)))
            store(law.point, POINT * c + MU, load(given.friction, c))
            x = site_point(sites, s, work)
            put(law.point, POINT * c + ARM, minus(three(law.point, POINT * c + ARM), x))
            # told: the depth of a point at the beginning of the step
            live = 1.0 - load(law.point, POINT * c + IDLE)
            deep = above(-gap, zero, -gap, zero) * live
            store(law.merit, DEEP, above(deep, load(law.merit, DEEP), deep, load(law.merit, DEEP)))
    k3 = 3 * len(sites.arm)
    for s in range(len(sites.site)):
        if sites.site[s, SIZE] != 1:
            continue
        l, j = sites.site[s, FIRST], sites.site[s, BODY] - free
        i, live = 6 * free + j, zero
        for c in range(l, l + sites.site[s, MANY]):
            rate, end = load(v, i), load(space.end, i)
            if sites.single[c] == RUB:
                size = h * load(given.joint, JOINT * j + RUBS)
                store(law.single, 8 * c, end)
                store(law.single, 8 * c + 1, -size)
                store(law.single, 8 * c + 2, size)
                live = above(moves, 0.5, one, zero)
                continue
            at = load(q, 7 * free + j)
            low, high = at - load(given.joint, JOINT * j + LOW), load(given.joint, JOINT * j + HIGH) - at
            upper = above(low, high, one, zero)
            gap = above(upper, 0.5, high, low)
            u = above(upper, 0.5, -rate, rate)
            reach = h * (3.0 + 4.0 * above(u, zero, u, -u))
            near_stop = above(reach, gap, moves, zero)
            live = above(near_stop, 0.5, one, live)
            last = above(upper, 0.5, -end, end)
            passes = above(-slow, u, one, zero) * above(zero, gap + half * (u + last), one, zero) * near_stop
            passes = passes * above(gap, -1e-6, one, zero)
            time = above(gap, zero, gap / above(-u, TINY, -u, one), zero)
            apart = above(gap, 1e-9, gap / h, SHARE * gap / h)
            apart = above(passes, 0.5, zero, apart)
            apart = above(-apart, 0.1, -0.1 * one, apart)
            store(law.single, 8 * c, end + above(upper, 0.5, -apart, apart))
            big = 1e30 * near_stop
            store(law.single, 8 * c + 1, above(upper, 0.5, -big, zero))
            store(law.single, 8 * c + 2, above(upper, 0.5, zero, big))
        store(law.live, s, live)
        if largest(live) > 0.0:
            active[count] = s
            count += 1
    return count, arrival, arrives


@inlined
def zeros(zero: Number) -> Three:
    """Three zeros."""
    return zero, zero, zero


@compiled
def scaled(sites: Sites, active: Array, count: int, starts: Array, rows: int, impulse: Array, law: Law) -> None:
    """Write the units of the parts, and the weights of the impulses of the step before."""
    k3 = 3 * len(sites.arm)
    one, zero = spread(impulse, 1.0), spread(impulse, 0.0)
    for a in range(count):
        s, i = active[a], starts[a]
        if sites.site[s, SIZE] == 1:
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                x = load(law.mobility, i * rows + i)
                unit = 1.0 / root(above(x, 1e-20, x, one))
                store(law.single, 8 * l + 3, unit)
                store(law.single, 8 * l + 1, load(law.single, 8 * l + 1) / unit)
                store(law.single, 8 * l + 2, load(law.single, 8 * l + 2) / unit)
                store(law.w, k3 + l, load(impulse, k3 + l) / unit * load(law.live, s))
            continue
        linear, turning = zero, zero
        for r in range(3):
            linear = linear + load(law.mobility, (i + r) * rows + i + r)
            if sites.site[s, SIZE] == 6:
                turning = turning + load(law.mobility, (i + 3 + r) * rows + i + 3 + r)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            r = three(law.point, POINT * c + ARM)
            x = (linear + dot(r, r) * turning) * (1.0 / 3.0)
            unit = root(MOBILITY / above(x, 1e-20, x, one))
            store(law.point, POINT * c + UNIT, unit)
            live = (1.0 - load(law.point, POINT * c + IDLE)) / unit
            put(law.w, 3 * c, times(live, three(impulse, 3 * c)))


@compiled
def struck(tree: Tree, sites: Sites, active: Array, count: int, starts: Array, rows: int, law: Law, space: Space) -> None:
    """Add what the impulses Q w do to the velocities in `space.end`."""
    n, free, work, zero = len(tree.parent), tree.free, space.work, spread(space.v, 0.0)
    for j in range(n):
        store(work, j * ROWS + W, zero)
    f, m = zeros(zero), zeros(zero)
    for a in range(count):
        s = active[a]
        for i in range(starts[a], starts[a] + sites.site[s, SIZE]):
            x = load(law.load, i)
            for k in range(sites.path_start[s], sites.path_start[s + 1]):
                o = sites.path[k] * ROWS
                store(work, o + W, load(work, o + W) + x * load(law.lift, i * n + sites.path[k]))
            if free:
                f, m = plus(f, times(x, three(law.base, 6 * i))), plus(m, times(x, three(law.base, 6 * i + 3)))
    if free:
        f, m = base_upper(space.base, f, m)
        put(work, CHANGE, f)
        put(work, CHANGE + 3, m)
        put(space.end, 0, plus(three(space.end, 0), f))
        put(space.end, 3, plus(three(space.end, 3), m))
    for j in range(free, n):
        o, k = j * ROWS, tree.parent[j]
        l, w = zeros(zero), zeros(zero)
        if k >= 0:
            l, w = three(work, k * ROWS + CHANGE), three(work, k * ROWS + CHANGE + 3)
        x = load(work, o + D) * (load(work, o + W) - dot(three(work, o + U), l) - dot(three(work, o + U + 3), w))
        put(work, o + CHANGE, plus(l, times(x, three(work, o + S))))
        put(work, o + CHANGE + 3, plus(w, times(x, three(work, o + S + 3))))
        store(space.end, 5 * free + j, load(space.end, 5 * free + j) + x)


CHANGE = 38
"""Row of a body from which on its change of velocity is."""


@compiled
def equation_residual(
    tree: Tree, given: Given, sites: Sites, active: Array, count: int, starts: Array, h: float, v: Array, law: Law, space: Space
) -> Number:  # fmt: skip
    """What is missing in the equations of motion with the velocities at the end of the step, over the forces in them.

    By Newton's and Euler's equations of each body about its centre of mass. Row DEEP of `law.merit` gets the largest angle by
    which a body turns.
    """
    n, free, work, zero = len(tree.parent), tree.free, space.work, spread(v, 0.0)
    g = three(given.world, 0)
    size, far, spins = zero, zero + 1e-3, zero
    for j in range(n):
        o, k, i = j * ROWS, tree.parent[j], 5 * free + j
        if j < free:
            l, w = three(space.v, 0), three(space.v, 3)
            a = times(1.0 / h, minus(three(space.end, 0), three(v, 0)))
            b = times(1.0 / h, minus(three(space.end, 3), three(v, 3)))
            a = minus(minus(a, cross(w, l)), g)
        else:
            l, w, a, b = zeros(zero), zeros(zero), times(-1.0, g), zeros(zero)
            if k >= 0:
                l, w, a, b = (
                    three(work, k * ROWS + V), three(work, k * ROWS + V + 3), three(work, k * ROWS + CHANGE),
                    three(work, k * ROWS + CHANGE + 3),
                )  # fmt: skip
            s, z, rate = three(work, o + S), three(work, o + S + 3), load(space.v, i)
            x = (load(space.end, i) - load(v, i)) * (1.0 / h)
            a = plus(a, plus(times(x, s), times(rate, plus(cross(w, s), cross(l, z)))))
            b = plus(b, plus(times(x, z), times(rate, cross(w, z))))
            l, w = plus(l, times(rate, s)), plus(w, times(rate, z))
        spins = above(dot(w, w), spins, dot(w, w), spins)
        put(work, o + V, l)
        put(work, o + V + 3, w)
        put(work, o + CHANGE, a)
        put(work, o + CHANGE + 3, b)
        Q = nine(work, o + R)
        x = plus(three(work, o + P), turned(Q, three(given.proof, 11 * j + 1)))
        u = plus(l, cross(w, x))
        force = times(load(given.proof, 11 * j), plus(plus(a, cross(b, x)), cross(w, u)))
        E = turned_symmetric(Q, six(given.proof, 11 * j + 4))
        spin = (E[0] * w[0] + E[1] * w[1] + E[2] * w[2], E[1] * w[0] + E[3] * w[1] + E[4] * w[2], E[2] * w[0] + E[4] * w[1] + E[5] * w[2])
        moment = (E[0] * b[0] + E[1] * b[1] + E[2] * b[2], E[1] * b[0] + E[3] * b[1] + E[4] * b[2], E[2] * b[0] + E[4] * b[1] + E[5] * b[2])
        put(work, o + U, minus(force, three(space.pushes, 6 * j)))
        put(work, o + U + 3, minus(plus(plus(moment, cross(w, spin)), cross(x, force)), three(space.pushes, 6 * j + 3)))
        size = size + root(dot(force, force)) + load(given.proof, 11 * j)  # at least what accelerates it at 1 m/s2
        x = three(work, o + P)
        far = above(dot(x, x), far, dot(x, x), far)
    for a in range(count):
        s, i = active[a], starts[a]
        o = sites.site[s, BODY] * ROWS
        if sites.site[s, SIZE] == 1:
            continue
        x, f, m = site_point(sites, s, work), three(law.load, i), zeros(zero)
        if sites.site[s, SIZE] == 6:
            m = three(law.load, i + 3)
        put(work, o + U, minus(three(work, o + U), times(1.0 / h, f)))
        put(work, o + U + 3, minus(three(work, o + U + 3), times(1.0 / h, plus(m, cross(x, f)))))
    worst, far = zero, root(far)
    for e in range(n - free):
        j = n - 1 - e
        o, k = j * ROWS, tree.parent[j]
        f, m = three(work, o + U), three(work, o + U + 3)
        a = (load(space.end, 5 * free + j) - load(v, 5 * free + j)) * (1.0 / h)
        x = dot(three(work, o + S), f) + dot(three(work, o + S + 3), m) - load(space.tau, j - free)
        x = x + (load(given.proof, 11 * j + 10) + load(space.damping, j - free)) * a - load(space.acc, 5 * free + j)
        x = x / (far if tree.kind[j] == 0 else zero + 1.0)
        worst = above(x, worst, x, above(-x, worst, -x, worst))
        if k >= 0:
            put(work, k * ROWS + U, plus(three(work, k * ROWS + U), f))
            put(work, k * ROWS + U + 3, plus(three(work, k * ROWS + U + 3), m))
    if free:
        for r in range(6):
            x = load(work, U + r) / (far if r > 2 else zero + 1.0)
            worst = above(x, worst, x, above(-x, worst, -x, worst))
    store(law.merit, DEEP, h * root(spins))
    return worst / size


@compiled
def law_residual(
    tree: Tree, sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, free_end: Array, law: Law, space: Space
) -> Number:  # fmt: skip
    """How far the points' impulses are from P of themselves less their velocities after the step: those of their bodies."""
    zero = spread(space.v, 0.0)
    for a in range(count):
        s, i = active[a], starts[a]
        if sites.site[s, SIZE] == 1:
            j = 5 * tree.free + sites.site[s, BODY]
            change = load(space.end, j) - load(free_end, j)
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                store(law.single, 8 * l, load(law.single, 8 * l) + change)
        else:
            x = site_point(sites, s, space.work)
            l, w = of_site(tree, sites, s, space.work, space.end)
            m, z = of_site(tree, sites, s, space.work, free_end)
            l, w = minus(l, m), minus(w, z)
            for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                u = plus(l, cross(w, plus(x, three(law.point, POINT * c + FELT))))
                put(law.point, POINT * c + OFFSET, plus(three(law.point, POINT * c + OFFSET), u))
        for r in range(rows * sites.site[s, SIZE]):
            store(law.mobility, i * rows + r, zero)
    evaluate(sites, active, count, starts, rows, coulomb, law.best, law)
    return load(law.merit, MERIT) / load(law.merit, SCALE)


@compiled
def begun_step(
    tree: Tree, sites: Sites, ground: Ground, given: Given, push_body: Array, t: float, h: float, coulomb: bool,
    q: Array, v: Array, before: Array, impulse: Array, told: Array, space: Space, law: Law, whole: Array,
) -> bool:  # fmt: skip
    """The first part of a step of one block, up to the impulses; whether those of some world were not found."""
    n, free, half = len(tree.parent), tree.free, 0.5 * h
    nv, zero, one = n + 5 * free, spread(v, 0.0), spread(v, 1.0)
    active, starts = whole[ACTIVE : ACTIVE + len(sites.site)], whole[ACTIVE + len(sites.site) :]
    moves = above(load(told, STOPPED), 0.5, zero, one)
    store(law.merit, LEFT, zero)
    if largest(moves) == 0.0:
        return False
    moved_all(q, v, half * one, free, n, space.x)
    for i in range(nv):
        store(space.v, i, load(v, i) + half * (1.75 * load(before, i) - 0.75 * load(before, nv + i)))
    places(tree, space.x, space.work)
    forces(tree, given, push_body, t, h, q, v, space)
    free_motion(tree, given.inertia, space.v, space.tau, space.damping, given.world, space.pushes, space.base, space.work, space.acc)
    for i in range(nv):
        store(space.end, i, load(v, i) + h * load(space.acc, i))
    store(law.merit, DEEP, load(told, DEPTH))
    count, arrival, arrives = touched(tree, sites, ground, given, h, q, v, before, impulse, moves, space, law, active)
    whole[HOW_MANY], whole[HOW_WIDE] = count, 0
    store(told, DEPTH, load(law.merit, DEEP))
    store(law.merit, ARRIVAL, arrival)
    store(law.merit, ARRIVES, arrives)
    if count == 0:
        return False
    rows = mobility(tree, sites, active, count, starts, space.work, space.base, law)
    whole[HOW_WIDE] = rows
    scaled(sites, active, count, starts, rows, impulse, law)
    solved(sites, active, count, starts, rows, coulomb, arrives, law)
    least, enough = load(law.merit, LEAST), FOUND * load(law.merit, SCALE)
    left = above(least, enough, one, above(least, -1.0, zero, one)) * moves
    store(law.merit, LEFT, left)
    return largest(left) > 0.0


@compiled
def ended_step(
    tree: Tree, sites: Sites, given: Given, number: int, h: float, coulomb: bool,
    q: Array, v: Array, before: Array, impulse: Array, told: Array, space: Space, law: Law, whole: Array,
) -> None:  # fmt: skip
    """The second part of a step of one block, in place: from the impulses to the residuals and the next state."""
    n, free = len(tree.parent), tree.free
    nv, k3, zero, one = n + 5 * free, 3 * len(sites.arm), spread(v, 0.0), spread(v, 1.0)
    active, starts = whole[ACTIVE : ACTIVE + len(sites.site)], whole[ACTIVE + len(sites.site) :]
    count, rows, contact = whole[HOW_MANY], whole[HOW_WIDE], zero
    moves, failed = above(load(told, STOPPED), 0.5, zero, one), load(law.merit, LEFT)
    if largest(moves) == 0.0:
        return
    for i in range(nv):
        store(space.acc, i, zero)
    for i in range(k3 + len(sites.single)):
        store(impulse, i, zero)
    if count:
        loads(sites, active, count, starts, law.best, law)
        for i in range(nv):
            store(space.free, i, load(space.end, i))
        struck(tree, sites, active, count, starts, rows, law, space)
        contact = law_residual(tree, sites, active, count, starts, rows, coulomb, space.free, law, space)
        for a in range(count):
            s = active[a]
            if sites.site[s, SIZE] == 1:
                store(space.acc, 5 * free + sites.site[s, BODY], load(law.load, starts[a]) * (1.0 / h))
            for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                if sites.site[s, SIZE] == 1:
                    store(impulse, k3 + c, load(law.best, k3 + c) * load(law.single, 8 * c + 3))
                else:
                    put(impulse, 3 * c, times(load(law.point, POINT * c + UNIT), three(law.best, 3 * c)))
    equation = equation_residual(tree, given, sites, active, count, starts, h, v, law, space)
    turn = load(law.merit, DEEP)
    fine = above(equation, -1.0, above(turn, WILD, zero, one), zero) * (1.0 - failed)  # NaN anywhere is in the equation
    store(told, TURN, above(turn * fine * moves, load(told, TURN), turn, load(told, TURN)))
    lost = above(fine, 0.5, zero, moves)
    store(told, STOPPED, above(lost, 0.5, one * (number + 1.0), load(told, STOPPED)))
    store(told, EQUATION, above(equation * fine * moves, load(told, EQUATION), equation, load(told, EQUATION)))
    store(told, CONTACT, above(contact * fine * moves, load(told, CONTACT), contact, load(told, CONTACT)))
    goes, arrival = fine * moves, load(law.merit, ARRIVAL)
    moved_all(q, v, arrival, free, n, space.x)
    moved_all(space.x, space.end, h - arrival, free, n, space.y)
    for i in range(n + 6 * free):
        store(q, i, above(goes, 0.5, load(space.y, i), load(q, i)))
    strikes, known = load(law.merit, ARRIVES) if count else zero, goes * load(before, 2 * nv)
    for i in range(nv):
        x, last = load(space.end, i), load(before, i)
        unstruck = above(strikes, 0.5, load(space.free, i), x)  # without the impact
        a = above(goes, 0.5, (unstruck - load(v, i)) * (1.0 / h), last)
        store(before, nv + i, above(known, 0.5, above(strikes, 0.5, a, last), a))
        store(before, i, a)
        store(v, i, above(goes, 0.5, x, load(v, i)))
    store(before, 2 * nv, goes)


def advance_blocks(
    parent: Array, kind: Array, placement: Array, free: int,
    site: Array, place: Array, arm: Array, path: Array, path_start: Array, common: Array, common_start: Array, single: Array,
    plane: Array, pieces: Array, faces: Array, face: Array, push_body: Array,
    inertia: Array, proof: Array, joint: Array, world: Array, friction: Array, push: Array,
    q: Array, v: Array, before: Array, impulse: Array, told: Array, space: Array, whole: Array,
    last: int, number: int, steps: int, t: float, h: float, coulomb: bool,
) -> None:  # fmt: skip
    """Steps of some blocks of worlds, in place; it ends before the last where impulses were not found: see `whole`.

    Args:
        parent: As of `Tree`, as are the next three.
        kind: As there.
        placement: As there.
        free: As there.
        site: As of `Sites`, as are the next seven.
        place: As there.
        arm: As there.
        path: As there.
        path_start: As there.
        common: As there.
        common_start: As there.
        single: As there: RUB or STOP.
        plane: As of `Ground`, as are the next three.
        pieces: As there.
        faces: As there.
        face: As there.
        push_body: The body of each push.
        inertia: As of `Given`, one for all blocks, or one each, as are the next five.
        proof: As there.
        joint: As there.
        world: As there.
        friction: As there.
        push: As there.
        q: Configurations, shape (blocks, rows, lanes); written.
        v: Velocities, a base's in the world's axes; written.
        before: Accelerations of the step before and the one before it, and whether there was one, shape (blocks, 2 nv + 1, lanes);
            written.
        impulse: Impulses of the step before, of points in the world's axes; written.
        told: Shape (blocks, TOLD, lanes); written.
        space: Working memory, shape (rows, lanes).
        whole: Integers: block, step and part to begin with, and those reached; then what is active, shape (ACTIVE + 2 sites,).
        last: The block after the last.
        number: How many steps were before.
        steps: How many.
        t: Time at their beginning [s].
        h: Length of a step [s].
        coulomb: Coulomb's law; else the convex one.
    """
    tree = Tree(parent, kind, placement, free)
    sites = Sites(site, place, arm, path, path_start, common, common_start, single)
    ground = Ground(plane, pieces, faces, face)
    n, nv = len(parent), len(parent) + 5 * free
    parts = offsets((n + 6 * free, n + 6 * free, nv, nv, nv, nv, n * ROWS, 21, n, n, 6 * n))
    room = Space(
        space[parts[0] : parts[1]], space[parts[1] : parts[2]], space[parts[2] : parts[3]], space[parts[3] : parts[4]],
        space[parts[4] : parts[5]], space[parts[5] : parts[6]], space[parts[6] : parts[7]], space[parts[7] : parts[8]],
        space[parts[8] : parts[9]], space[parts[9] : parts[10]], space[parts[10] : parts[11]],
    )  # fmt: skip
    law = law_in(space[parts[11] :], sites, n)
    while whole[BLOCK] < last:
        b = whole[BLOCK]
        given = Given(
            inertia[min(b, len(inertia) - 1)], proof[min(b, len(proof) - 1)], joint[min(b, len(joint) - 1)],
            world[min(b, len(world) - 1)], friction[min(b, len(friction) - 1)], push[min(b, len(push) - 1)],
        )  # fmt: skip
        while whole[STEP] < steps:
            i = whole[STEP]
            if whole[PART] == 0 and begun_step(
                tree, sites, ground, given, push_body, t + i * h, h, coulomb, q[b], v[b], before[b], impulse[b], told[b],
                room, law, whole,
            ):  # fmt: skip
                whole[PART] = 1
                return
            whole[PART] = 0
            ended_step(
                tree, sites, given, number + i, h, coulomb, q[b], v[b], before[b], impulse[b], told[b], room, law, whole
            )
            whole[STEP] += 1
        whole[BLOCK] += 1
        whole[STEP] = 0


def size_of(n: int, free: int, sites: Sites) -> int:
    """Rows of the working memory."""
    return 2 * (n + 6 * free) + 4 * (n + 5 * free) + n * ROWS + 21 + 8 * n + law_size(n, sites)


_WHOLE, _TABLE, _BLOCKS = array(1, COUNT), array(2, COUNT), array(3, written=True)
advance = compiled(
    advance_blocks,
    signature(
        None, _WHOLE, _WHOLE, array(2), COUNT, *SITE_TYPES, array(2), _TABLE, _WHOLE, array(2), _WHOLE, *[array(3)] * 6,
        *[_BLOCKS] * 5, array(2, written=True), array(1, COUNT, written=True), COUNT, COUNT, COUNT, NUMBER, NUMBER, FLAG,
    ),
    unlocked=True,
)  # fmt: skip
"""Of arrays with `LANES` lanes."""
advance_alone = compiled(advance_blocks)
"""The same for one world a block: arrays without the last dimension. It is compiled where it is first called."""
