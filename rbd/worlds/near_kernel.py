"""What is near a surface or a stop, how it moves, and the units of the problem of its impulses."""

from __future__ import annotations

from rbd.arrays import Array
from rbd.kernels import compiled, inlined
from rbd.worlds.contact_kernel import TINY
from rbd.worlds.lanes import Number, above, largest, load, root, spread, store
from rbd.worlds.layout import (
    ARM,
    BODY,
    DEEP,
    FELT,
    FIRST,
    GAP,
    HIGH,
    IDLE,
    JOINT,
    LIGHT,
    LOW,
    MANY,
    MU,
    NORMAL,
    OFFSET,
    POINT,
    RUB,
    RUBS,
    SHIFT,
    SIZE,
    STILL,
    UNIT,
    Given,
    Ground,
    Law,
    Space,
)
from rbd.worlds.sites_kernel import Sites, site_point
from rbd.worlds.spatial_kernel import Three, cross, dot, minus, nine, plus, put, three, times, turned
from rbd.worlds.tree_kernel import ROWS, C, P, R, S, Tree, V

MOBILITY = 3.0
"""Of each scaled point: between fewest steps of points that slide, 1, and of those that strike, 10."""
SPEED = 10.0
"""With four times its own: the largest speed [m/s] with which an open point may be allowed to approach."""
ROUNDING = 1e-5
"""Part of a point's velocity without impulses that counts in its scale: 5e-9 of that is some two hundred roundings."""
SHARE = 0.5
"""Part of a gap that a closed point loses a step."""


@inlined
def zeros(zero: Number) -> Three:
    """Three zeros."""
    return zero, zero, zero


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


@inlined
def stop_at(given: Given, j: int, i: int, at: int, q: Array, v: Array, end: Array) -> tuple[Number, Number, Number, Number]:
    """Of the nearer stop of a joint its gap, that gap's rate before and after the step, and whether it is the upper one."""
    x, rate, last = load(q, at), load(v, i), load(end, i)
    low, high = x - load(given.joint, JOINT * j + LOW), load(given.joint, JOINT * j + HIGH) - x
    upper = above(low, high, 0.0 * rate + 1.0, 0.0 * rate)
    return (
        above(upper, 0.5, high, low), above(upper, 0.5, -rate, rate), above(upper, 0.5, -last, last), upper,
    )  # fmt: skip


@inlined
def arriving(
    gap: Number, u: Number, last: Number, live: Number, h: float, near: Number, slow: Number, arrival: Number, arrives: Number
) -> tuple[Number, Number]:  # fmt: skip
    """When something first arrives in the step, and whether something does, with one more: a point, or a joint at a stop.

    It arrives if it is above its surface or just on it, approaches faster than `slow`, and would be below at the end.

    Args:
        gap: Its distance.
        u: Rate of that at the beginning of the step.
        last: Rate at its end, without impulses.
        live: Whether it counts.
        h: Length of the step [s].
        near: Gaps up to this are of closed points [m].
        slow: Speeds up to this are no arrivals [m/s].
        arrival: When the first of the others does.
        arrives: Whether one of them does.
    """
    passes = above(-slow, u, live, 0.0 * live) * above(-near, gap + 0.5 * h * (u + last), live, 0.0 * live)
    passes = passes * above(gap, -near, live, 0.0 * live)
    time = above(gap, 0.0 * gap, gap / above(-u, TINY, -u, 1.0 + 0.0 * u), 0.0 * gap)
    time = above(time, h + 0.0 * time, h + 0.0 * time, time)
    first = above(arrives, 0.5, above(arrival, time, time, arrival), time)
    return above(passes, 0.5, first, arrival), above(passes, 0.5, 1.0 + 0.0 * arrives, arrives)


@compiled
def touched(
    tree: Tree, sites: Sites, ground: Ground, given: Given, h: float, q: Array, v: Array, impulse: Array, moves: Number,
    space: Space, law: Law, active: Array,
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
        stop = plus(
            plus(el, cross(ew, place)), times(half, plus(plus(bl, cross(bw, place)), cross(w, plus(l, cross(w, place)))))
        )
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
            slides = above(dot(along, along), 16.0 * dot(shift, shift) + 1e-12, one, zero) * above(
                dot(n, pressed), zero, one, zero
            )
            put(law.point, POINT * c + SHIFT, times(slides, shift))
            store(law.point, POINT * c + GAP, u)
            live = 1.0 - load(law.point, POINT * c + IDLE)
            arrival, arrives = arriving(gap, u, dot(n, end), live, h, near, slow, arrival, arrives)
    for s in range(len(sites.site)):
        if sites.site[s, SIZE] != 1:
            continue
        j = sites.site[s, BODY] - free
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            if sites.single[c] == RUB:
                continue
            gap, u, last, _ = stop_at(given, j, 6 * free + j, 7 * free + j, q, v, space.end)
            arrival, arrives = arriving(gap, u, last, moves, h, near, slow, arrival, arrives)
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
            # no more than any speed that a point may have: the largest offset is the scale of what Newton's method leaves
            fast = SPEED + 4.0 * above(u, zero, u, -u)
            later = above(later, fast, fast, later)
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
    for s in range(len(sites.site)):
        if sites.site[s, SIZE] != 1:
            continue
        l, j = sites.site[s, FIRST], sites.site[s, BODY] - free
        i, live = 6 * free + j, zero
        for c in range(l, l + sites.site[s, MANY]):
            end = load(space.end, i)
            if sites.single[c] == RUB:
                size = h * load(given.joint, JOINT * j + RUBS)
                store(law.single, 8 * c, end)
                store(law.single, 8 * c + 1, -size)
                store(law.single, 8 * c + 2, size)
                live = above(moves, 0.5, one, zero)
                continue
            gap, u, _, upper = stop_at(given, j, i, 7 * free + j, q, v, space.end)
            reach = h * (3.0 + 4.0 * above(u, zero, u, -u))
            near_stop = above(reach, gap, moves, zero)
            live = above(near_stop, 0.5, one, live)
            later = gap + arrival * u
            apart = above(near, gap, SHARE * gap / h, above(later, zero, later, zero) / left)
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


@compiled
def begin_weights(
    sites: Sites, active: Array, count: int, starts: Array, rows: int, impulse: Array, h: float, law: Law
) -> None:  # fmt: skip
    """Write the units and the scales of the parts, and weights to begin with: as the impulses of the last steps go on.

    The least scales are those of `rbd.problem.residuals`, times h: 1 m/s2, and the force that accelerates the part so, at most
    1 N; and of a velocity ROUNDING of that without impulses.
    """
    k3 = 3 * len(sites.arm)
    one, zero, older = spread(impulse, 1.0), spread(impulse, 0.0), k3 + len(sites.single)
    for a in range(count):
        s, i = active[a], starts[a]
        if sites.site[s, SIZE] == 1:
            for l in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
                x = load(law.mobility, i * rows + i)
                unit = 1.0 / root(above(x, 1e-20, x, one))
                store(law.single, 8 * l + 3, unit)
                store(law.single, 8 * l + 1, load(law.single, 8 * l + 1) / unit)
                store(law.single, 8 * l + 2, load(law.single, 8 * l + 2) / unit)
                light, u = h * unit, load(law.single, 8 * l)
                store(law.single, 8 * l + 6, 1.0 / (unit * (h + ROUNDING * above(u, zero, u, -u))))
                store(law.single, 8 * l + 7, above(unit, 1.0, h / unit, light))
                x = 2.0 * load(impulse, k3 + l) - load(impulse, older + k3 + l)
                store(law.w, k3 + l, x / unit * load(law.live, s))
            continue
        linear, turning = zero, zero
        for r in range(3):
            linear = linear + load(law.mobility, (i + r) * rows + i + r)
            if sites.site[s, SIZE] == 6:
                turning = turning + load(law.mobility, (i + 3 + r) * rows + i + 3 + r)
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            r = three(law.point, POINT * c + ARM)
            size = (linear + dot(r, r) * turning) * (1.0 / 3.0)
            unit = root(MOBILITY / above(size, 1e-20, size, one))
            store(law.point, POINT * c + UNIT, unit)
            u, light = three(law.point, POINT * c + OFFSET), (h / MOBILITY) * unit
            store(law.point, POINT * c + STILL, 1.0 / (unit * (h + ROUNDING * root(dot(u, u)))))
            store(law.point, POINT * c + LIGHT, above(light * unit, h, h / unit, light))
            live = (1.0 - load(law.point, POINT * c + IDLE)) / unit
            x, last = three(impulse, 3 * c), three(impulse, older + 3 * c)
            if sites.site[s, SIZE] == 6:  # points of soles share their load in many ways: differences of differences mislead
                x = minus(times(2.0, x), last)
            else:
                x = plus(times(3.0, minus(x, last)), three(impulse, 2 * older + 3 * c))
            put(law.w, 3 * c, times(live, x))
