"""Dynamics of a tree of bodies, as articulated bodies, for one world or eight.

All vectors are in the world's axes, all spatial ones about O, the place of the base (of a robot without one, the world's
origin), so that inertias and forces of bodies add up as they are [Featherstone2008] section 7.3. A spatial vector is linear
first.

    S = (p x z, z) of a hinge at p, (z, 0) of a slide        v_i = v_parent + S qd        c_i = v_i x S qd
    I_A = I + sum over children (I_A - U U^T / d)            U = I_A S,   d = S . U + armature + damping h/2
    qdd = (tau - S . p_A - U . (a_parent + c_i)) / d         a_i = a_parent + c_i + S qdd

Velocities of a base are those of its origin and of its turning, both in the world's axes; their rates are classical.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rbd.arrays import Array
from rbd.kernels import compiled, inlined
from rbd.worlds.lanes import Number, load, store
from rbd.worlds.spatial_kernel import (
    Three,
    cross,
    dot,
    less,
    less_nine,
    minus,
    nine,
    plus,
    put,
    put_nine,
    put_six,
    rotation,
    six,
    three,
    times,
    times_symmetric,
    turned,
    turned_back,
    turned_symmetric,
)

HINGE, SLIDE = 0, 1
"""Kinds of joints."""
R, P, S, V, C, U, D, W, IA, PA = 0, 9, 12, 18, 24, 30, 36, 37, 38, 59
"""Rows of a body: rotation, place, axis, velocity, v x S qd, U, 1/d, tau - S . p_A, inertia (6, 9, 6), bias force."""
A = IA
"""Where the body's acceleration is, once its inertia is used up."""
ROWS = 65
BASE_ROWS = 27
"""Of the base's factor: the inverses of its six pivots, and fifteen entries of L."""


class Tree(NamedTuple):
    """A robot's joints of one degree of freedom, parents first, and its base.

    Attributes:
        parent: The body that carries each body: -1 the base or the world, shape (n,).
        kind: HINGE or SLIDE, shape (n,).
        placement: R (9) and p (3) of each joint in the body that carries it; the joint's axis is z; shape (n, 12).
        free: 1 where there is a floating base, whose body comes first; else 0.
    """

    parent: Array
    kind: Array
    placement: Array
    free: int


TURNS, TURN = 1.0 / (2.0 * math.pi), (2.0 * math.pi, 2.4492935982947064e-16)
WHOLE = 1.5 * 2.0**52
"""Added and taken away again, it rounds a number to a whole one. 2 pi is the sum of two numbers."""


@inlined
def sine_cosine(t: Number) -> tuple[Number, Number]:
    """Sin t and cos t, to rounding of t: series at a 32nd of t less whole turns, doubled five times."""
    turns = (t * TURNS + WHOLE) - WHOLE
    u = ((t - turns * TURN[0]) - turns * TURN[1]) * 0.03125
    g = u * u
    s = u * (1.0 + g * (-1.0 / 6.0 + g * (1.0 / 120.0 + g * (-1.0 / 5040.0 + g * (1.0 / 362880.0 - g * (1.0 / 39916800.0))))))
    c = g * (-0.5 + g * (1.0 / 24.0 + g * (-1.0 / 720.0 + g * (1.0 / 40320.0 - g * (1.0 / 3628800.0)))))
    for _ in range(5):
        s, c = 2.0 * s * (1.0 + c), -2.0 * s * s
    return s, 1.0 + c


@inlined
def momentum(work: Array, o: int, l: Three, w: Three) -> tuple[Three, Three]:
    """Inertia at row o, times a spatial velocity (l, w)."""
    B = nine(work, o + 6)
    return (
        plus(times_symmetric(six(work, o), l), turned(B, w)),
        plus(times_symmetric(six(work, o + 15), w), turned_back(B, l)),
    )


@compiled
def places(tree: Tree, x: Array, work: Array) -> None:
    """Write rotation, place and axis of each body: x is the base's position and quaternion, then the joints'."""
    n, at = len(tree.parent), 7 if tree.free else 0
    if tree.free:
        put_nine(work, R, rotation(load(x, 3), load(x, 4), load(x, 5), load(x, 6)))
        zero = load(x, 0) * 0.0
        put(work, P, (zero, zero, zero))
    for j in range(tree.free, n):
        o, k, G = j * ROWS, tree.parent[j], tree.placement[j]
        t = load(x, at + j - tree.free)
        one = t * 0.0 + 1.0
        if k >= 0:
            Q, p = nine(work, k * ROWS + R), three(work, k * ROWS + P)
            a = turned(Q, (one * G[0], one * G[3], one * G[6]))
            b = turned(Q, (one * G[1], one * G[4], one * G[7]))
            z = turned(Q, (one * G[2], one * G[5], one * G[8]))
            p = plus(p, turned(Q, (one * G[9], one * G[10], one * G[11])))
        else:
            a, b, z = (
                (one * G[0], one * G[3], one * G[6]),
                (one * G[1], one * G[4], one * G[7]),
                (one * G[2], one * G[5], one * G[8]),
            )
            p = (one * G[9], one * G[10], one * G[11])
        if tree.kind[j] == HINGE:
            s, c = sine_cosine(t)
            a, b = plus(times(c, a), times(s, b)), minus(times(c, b), times(s, a))
            put(work, o + S, cross(p, z))
            put(work, o + S + 3, z)
        else:
            p = plus(p, times(t, z))
            put(work, o + S, z)
            put(work, o + S + 3, times(t * 0.0, z))
        put_nine(work, o + R, (a[0], b[0], z[0], a[1], b[1], z[1], a[2], b[2], z[2]))
        put(work, o + P, p)


@compiled
def free_motion(
    tree: Tree,
    inertia: Array,
    v: Array,
    tau: Array,
    damping: Array,
    gravity: Array,
    pushes: Array,
    base: Array,
    work: Array,
    acc: Array,
) -> None:
    """Write the accelerations without contacts, and the factors of the inertia.

    Args:
        tree: The tree, `places` called.
        inertia: Mass, centre of mass and inertia about it (6) of each body, then its joint's armature, shape (11 n,).
        v: Velocity (nv,).
        tau: Of the joints.
        damping: Added to the armature.
        gravity: Shape (3,).
        pushes: Force and moment about O on each body, shape (6 n,).
        base: Written: the base's factor.
        work: Written.
        acc: Written.
    """
    n, free = len(tree.parent), tree.free
    g = three(gravity, 0)
    for j in range(n):
        o, k, m = j * ROWS, tree.parent[j], load(inertia, 11 * j)
        Q = nine(work, o + R)
        x = plus(three(work, o + P), turned(Q, three(inertia, 11 * j + 1)))
        if j < free:
            l, w = three(v, 0), three(v, 3)
            put(work, o + C, times(-1.0, cross(w, l)))
            put(work, o + C + 3, times(m * 0.0, w))
        else:
            rate = load(v, 5 * free + j)
            s, z = times(rate, three(work, o + S)), times(rate, three(work, o + S + 3))
            l, w = s, z
            if k >= 0:
                l, w = three(work, k * ROWS + V), three(work, k * ROWS + V + 3)
                put(work, o + C, plus(cross(w, s), cross(l, z)))
                put(work, o + C + 3, cross(w, z))
                l, w = plus(l, s), plus(w, z)
            else:
                put(work, o + C, times(m * 0.0, s))
                put(work, o + C + 3, times(m * 0.0, s))
        put(work, o + V, l)
        put(work, o + V + 3, w)
        h = times(m, plus(l, cross(w, x)))
        E = turned_symmetric(Q, six(inertia, 11 * j + 4))
        y = times(m, x)
        xx, yy, zz = x[0] * y[0], x[1] * y[1], x[2] * y[2]
        D6 = (E[0] + yy + zz, E[1] - x[0] * y[1], E[2] - x[0] * y[2], E[3] + xx + zz, E[4] - x[1] * y[2], E[5] + xx + yy)
        turns = plus(times_symmetric(D6, w), cross(y, l))
        zero = m * 0.0
        put_six(work, o + IA, (m, zero, zero, m, zero, m))
        put_nine(work, o + IA + 6, (zero, y[2], -y[1], -y[2], zero, y[0], y[1], -y[0], zero))
        put_six(work, o + IA + 15, D6)
        put(work, o + PA, minus(cross(w, h), three(pushes, 6 * j)))
        put(work, o + PA + 3, minus(plus(cross(w, turns), cross(l, h)), three(pushes, 6 * j + 3)))
    for b in range(n - free):
        j = n - 1 - b
        o, k = j * ROWS, tree.parent[j]
        s, z = three(work, o + S), three(work, o + S + 3)
        u, t = momentum(work, o + IA, s, z)
        put(work, o + U, u)
        put(work, o + U + 3, t)
        d = 1.0 / (dot(s, u) + dot(z, t) + load(inertia, 11 * j + 10) + load(damping, j - free))
        pl, pw = three(work, o + PA), three(work, o + PA + 3)
        e = load(tau, j - free) - dot(s, pl) - dot(z, pw)
        store(work, o + D, d)
        store(work, o + W, e)
        if k < 0:
            continue
        q = k * ROWS
        a, c = three(work, o + C), three(work, o + C + 3)
        X, Y, Z = six(work, o + IA), nine(work, o + IA + 6), six(work, o + IA + 15)
        f, i = times(d, u), times(d, t)
        X, Z = less(X, f, u), less(Z, i, t)
        Y = less_nine(Y, f, t)
        for r in range(6):
            store(work, q + IA + r, load(work, q + IA + r) + X[r])
            store(work, q + IA + 15 + r, load(work, q + IA + 15 + r) + Z[r])
        for r in range(9):
            store(work, q + IA + 6 + r, load(work, q + IA + 6 + r) + Y[r])
        pl = plus(plus(pl, times(e, f)), plus(times_symmetric(X, a), turned(Y, c)))
        pw = plus(plus(pw, times(e, i)), plus(times_symmetric(Z, c), turned_back(Y, a)))
        put(work, q + PA, plus(three(work, q + PA), pl))
        put(work, q + PA + 3, plus(three(work, q + PA + 3), pw))
    if free:
        factor_base(work, base)
        # a + c of the base, less gravity: I_A (a + c - g) = -p_A
        a, c = base_solved(base, times(-1.0, three(work, PA)), times(-1.0, three(work, PA + 3)))
        put(work, A, a)
        put(work, A + 3, c)
        put(acc, 0, plus(minus(a, three(work, C)), g))
        put(acc, 3, c)
    for j in range(free, n):
        o, k = j * ROWS, tree.parent[j]
        if k >= 0:
            a, c = three(work, k * ROWS + A), three(work, k * ROWS + A + 3)
        else:
            a, c = times(-1.0, g), times(load(work, o + D) * 0.0, g)
        a, c = plus(a, three(work, o + C)), plus(c, three(work, o + C + 3))
        rate = load(work, o + D) * (load(work, o + W) - dot(three(work, o + U), a) - dot(three(work, o + U + 3), c))
        store(acc, 5 * free + j, rate)
        put(work, o + A, plus(a, times(rate, three(work, o + S))))
        put(work, o + A + 3, plus(c, times(rate, three(work, o + S + 3))))


@compiled
def factor_base(work: Array, base: Array) -> None:
    """Write the inverses of the pivots, and L, of L D L^T: the inertia of the whole robot as seen by its base."""
    X, Y, Z = six(work, IA), nine(work, IA + 6), six(work, IA + 15)
    # columns of the lower triangle
    a0 = X[0]
    i0 = 1.0 / a0
    l1, l2, l3, l4, l5 = X[1] * i0, X[2] * i0, Y[0] * i0, Y[1] * i0, Y[2] * i0
    a1 = X[3] - l1 * X[1]
    b2, b3, b4, b5 = X[4] - l2 * X[1], Y[3] - l3 * X[1], Y[4] - l4 * X[1], Y[5] - l5 * X[1]
    i1 = 1.0 / a1
    m2, m3, m4, m5 = b2 * i1, b3 * i1, b4 * i1, b5 * i1
    a2 = X[5] - l2 * X[2] - m2 * b2
    c3, c4, c5 = Y[6] - l3 * X[2] - m3 * b2, Y[7] - l4 * X[2] - m4 * b2, Y[8] - l5 * X[2] - m5 * b2
    i2 = 1.0 / a2
    n3, n4, n5 = c3 * i2, c4 * i2, c5 * i2
    a3 = Z[0] - l3 * Y[0] - m3 * b3 - n3 * c3
    d4, d5 = Z[1] - l4 * Y[0] - m4 * b3 - n4 * c3, Z[2] - l5 * Y[0] - m5 * b3 - n5 * c3
    i3 = 1.0 / a3
    o4, o5 = d4 * i3, d5 * i3
    a4 = Z[3] - l4 * Y[1] - m4 * b4 - n4 * c4 - o4 * d4
    e5 = Z[4] - l5 * Y[1] - m5 * b4 - n5 * c4 - o5 * d4
    i4 = 1.0 / a4
    p5 = e5 * i4
    a5 = Z[5] - l5 * Y[2] - m5 * b5 - n5 * c5 - o5 * d5 - p5 * e5
    put_six(base, 0, (i0, i1, i2, i3, i4, 1.0 / a5))
    put_six(base, 6, (l1, l2, m2, l3, m3, n3))
    put_nine(base, 12, (l4, m4, n4, o4, l5, m5, n5, o5, p5))


@inlined
def base_lower(base: Array, f: Three, m: Three) -> tuple[Three, Three]:
    """L^-1 of (f, m)."""
    a = f[0]
    b = f[1] - load(base, 6) * a
    c = f[2] - load(base, 7) * a - load(base, 8) * b
    x = m[0] - load(base, 9) * a - load(base, 10) * b - load(base, 11) * c
    y = m[1] - load(base, 12) * a - load(base, 13) * b - load(base, 14) * c - load(base, 15) * x
    z = m[2] - load(base, 16) * a - load(base, 17) * b - load(base, 18) * c - load(base, 19) * x - load(base, 20) * y
    return (a, b, c), (x, y, z)


@inlined
def base_upper(base: Array, f: Three, m: Three) -> tuple[Three, Three]:
    """L^-T D^-1 of (f, m)."""
    z = m[2] * load(base, 5)
    y = m[1] * load(base, 4) - load(base, 20) * z
    x = m[0] * load(base, 3) - load(base, 15) * y - load(base, 19) * z
    c = f[2] * load(base, 2) - load(base, 11) * x - load(base, 14) * y - load(base, 18) * z
    b = f[1] * load(base, 1) - load(base, 8) * c - load(base, 10) * x - load(base, 13) * y - load(base, 17) * z
    a = (
        f[0] * load(base, 0)
        - load(base, 6) * b
        - load(base, 7) * c
        - load(base, 9) * x
        - load(base, 12) * y
        - load(base, 16) * z
    )
    return (a, b, c), (x, y, z)


@inlined
def base_solved(base: Array, f: Three, m: Three) -> tuple[Three, Three]:
    """The base's acceleration by a force and a moment."""
    a, b = base_lower(base, f, m)
    return base_upper(base, a, b)
