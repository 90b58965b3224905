"""What touches, and its mobility: what unit forces there do."""

from __future__ import annotations

from typing import NamedTuple

from rbd.arrays import Array
from rbd.kernels import COUNT, array, compiled
from rbd.worlds.lanes import load, spread, store
from rbd.worlds.layout import BODY, SIZE, Law
from rbd.worlds.spatial_kernel import Three, cross, dot, minus, nine, plus, put, three, times, turned
from rbd.worlds.tree_kernel import ROWS, D, P, R, S, Tree, U, base_lower


class Sites(NamedTuple):
    """What touches: bodies with points, and joints.

    Attributes:
        site: Integers, shape (s, 4).
        place: The site's point in its body, shape (s, 3).
        arm: Of each contact point in its body, shape (k, 3).
        path: Joints that move each site, from its body to the root, one after the other.
        path_start: Where those of a site begin, shape (s + 1,).
        common: Joints that move both of two sites.
        common_start: Where those of sites a and b <= a begin, at a (a + 1) / 2 + b, shape (s (s + 1) / 2 + 1,).
        single: The joint's velocity index of each single row, shape (l,).
    """

    site: Array
    place: Array
    arm: Array
    path: Array
    path_start: Array
    common: Array
    common_start: Array
    single: Array


_WHOLE = array(1, COUNT)
SITE_TYPES = (array(2, COUNT), array(2), array(2), _WHOLE, _WHOLE, _WHOLE, _WHOLE, _WHOLE)
"""Types of its fields."""


@compiled
def site_point(sites: Sites, s: int, work: Array) -> Three:
    """A site's point from O."""
    o, r = sites.site[s, BODY] * ROWS, sites.place[s]
    one = spread(work, 1.0)
    return plus(three(work, o + P), turned(nine(work, o + R), (one * r[0], one * r[1], one * r[2])))


@compiled
def mobility(tree: Tree, sites: Sites, active: Array, count: int, starts: Array, work: Array, base: Array, law: Law) -> int:
    """Write what unit forces on the active sites do, and D; how many rows they have.

    D is zero where a site is idle, lane by lane: so what one world does is not changed by sites that others need.
    """
    n, free, rows, zero, one = len(tree.parent), tree.free, 0, spread(work, 0.0), spread(work, 1.0)
    for a in range(count):
        s = active[a]
        starts[a] = rows
        b, size = sites.site[s, BODY], sites.site[s, SIZE]
        o = b * ROWS
        x = site_point(sites, s, work)
        for e in range(size):
            f, m = (zero, zero, zero), (zero, zero, zero)
            i = rows + e
            if size > 1:
                unit = (one if e % 3 == 0 else zero, one if e % 3 == 1 else zero, one if e % 3 == 2 else zero)
                if e < 3:
                    f, m = unit, cross(x, unit)
                else:
                    m = unit
            for k in range(sites.path_start[s], sites.path_start[s + 1]):
                j = sites.path[k]
                o = j * ROWS
                u = dot(three(work, o + S), f) + dot(three(work, o + S + 3), m)
                if size == 1 and j == b:
                    u = u + one
                store(law.lift, i * n + j, u)
                t = u * load(work, o + D)
                f = minus(f, times(t, three(work, o + U)))
                m = minus(m, times(t, three(work, o + U + 3)))
            if free:
                f, m = base_lower(base, f, m)
                put(law.base, 6 * i, f)
                put(law.base, 6 * i + 3, m)
        rows += size
    for a in range(count):
        s = active[a]
        live = load(law.live, s)
        for i in range(starts[a], starts[a] + sites.site[s, SIZE]):
            f, m = (zero, zero, zero), (zero, zero, zero)
            if free:
                f = (
                    load(law.base, 6 * i) * load(base, 0),
                    load(law.base, 6 * i + 1) * load(base, 1),
                    load(law.base, 6 * i + 2) * load(base, 2),
                )
                m = (
                    load(law.base, 6 * i + 3) * load(base, 3),
                    load(law.base, 6 * i + 4) * load(base, 4),
                    load(law.base, 6 * i + 5) * load(base, 5),
                )
            for b in range(a + 1):
                t = active[b]
                high, low = max(s, t), min(s, t)
                pair = high * (high + 1) // 2 + low
                both = live * load(law.live, t)
                for j in range(starts[b], min(starts[b] + sites.site[t, SIZE], i + 1)):
                    x = zero
                    if free:
                        x = dot(f, three(law.base, 6 * j)) + dot(m, three(law.base, 6 * j + 3))
                    for c in range(sites.common_start[pair], sites.common_start[pair + 1]):
                        k = sites.common[c]
                        x = x + load(law.lift, i * n + k) * load(law.lift, j * n + k) * load(work, k * ROWS + D)
                    x = both * x
                    store(law.mobility, i * rows + j, x)
                    store(law.mobility, j * rows + i, x)
    return rows
