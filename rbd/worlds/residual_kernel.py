"""The residuals of a step, by another way than its answer: the equation of motion and the contact law.

The equation by the accelerations of the centres of mass, from a second copy of the masses; the law by the velocities of the
bodies after the step.
"""

from __future__ import annotations

from rbd.arrays import Array
from rbd.kernels import compiled
from rbd.worlds.contact_kernel import evaluate
from rbd.worlds.lanes import Number, above, load, root, spread, store
from rbd.worlds.layout import BODY, DEEP, FELT, FIRST, MANY, MERIT, OFFSET, POINT, SIZE, Given, Law, Space
from rbd.worlds.near_kernel import of_site, zeros
from rbd.worlds.sites_kernel import Sites, site_point
from rbd.worlds.spatial_kernel import (
    cross,
    dot,
    minus,
    nine,
    plus,
    put,
    six,
    three,
    times,
    times_symmetric,
    turned,
    turned_symmetric,
)
from rbd.worlds.tree_kernel import ROWS, A, P, R, S, Tree, U, V


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
                    three(work, k * ROWS + V), three(work, k * ROWS + V + 3), three(work, k * ROWS + A),
                    three(work, k * ROWS + A + 3),
                )  # fmt: skip
            s, z, rate = three(work, o + S), three(work, o + S + 3), load(space.v, i)
            x = (load(space.end, i) - load(v, i)) * (1.0 / h)
            a = plus(a, plus(times(x, s), times(rate, plus(cross(w, s), cross(l, z)))))
            b = plus(b, plus(times(x, z), times(rate, cross(w, z))))
            l, w = plus(l, times(rate, s)), plus(w, times(rate, z))
        spins = above(dot(w, w), spins, dot(w, w), spins)
        put(work, o + V, l)
        put(work, o + V + 3, w)
        put(work, o + A, a)
        put(work, o + A + 3, b)
        Q = nine(work, o + R)
        x = plus(three(work, o + P), turned(Q, three(given.checked, 11 * j + 1)))
        u = plus(l, cross(w, x))
        force = times(load(given.checked, 11 * j), plus(plus(a, cross(b, x)), cross(w, u)))
        E = turned_symmetric(Q, six(given.checked, 11 * j + 4))
        spin, moment = times_symmetric(E, w), times_symmetric(E, b)
        put(work, o + U, minus(force, three(space.pushes, 6 * j)))
        put(work, o + U + 3, minus(plus(plus(moment, cross(w, spin)), cross(x, force)), three(space.pushes, 6 * j + 3)))
        size = size + root(dot(force, force)) + load(given.checked, 11 * j)  # at least what accelerates it at 1 m/s2
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
        x = x + (load(given.checked, 11 * j + 10) + load(space.damping, j - free)) * a - load(space.acc, 5 * free + j)
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
    tree: Tree, sites: Sites, active: Array, count: int, starts: Array, rows: int, coulomb: bool, free_end: Array, law: Law,
    space: Space,
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
    return load(law.merit, MERIT)
