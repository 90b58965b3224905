"""Time steps of many worlds: eight at once, block after block, each step with its residuals.

A step of length h from (q, v), as of `rbd.simulation.time_step` but for the velocity in its middle, which follows from the
accelerations of the two steps before:

    q_m = q (+) h/2 v,   v_h = v + h/2 (7/4 a_1 - 3/4 a_2)
    M(q_m) v+ = M v + h (S^T tau + tau_ext - h(q_m, v_h)) + J(q_m)^T p,      u(v+) obeys the law
    q+ = q_m (+) h/2 v+

u = J v+ + h/2 J_dot v is the velocity of the points at the end of the step. Order 2 while no point touches, leaves, or begins
to slide. Where one arrives at the time s of the step, q+ = q (+) s v (+) (h - s) v+, and v+ is that after the impact: order 1.

    u_n >= -g/2h of a closed point, so that it loses half of its gap g;     u_n >= -g_s / (h - s) of one above its plane

The residuals (`rbd.worlds.residual_kernel`) are found in another way than the answer.
"""

from __future__ import annotations

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, inlined, signature
from rbd.worlds.contact_kernel import FOUND, MOST, law_in, law_size, loads, offsets, polished, solved
from rbd.worlds.lanes import Number, above, largest, load, root, spread, store
from rbd.worlds.layout import (
    ACTIVE,
    ARRIVAL,
    ARRIVES,
    BLOCK,
    BODY,
    CONTACT,
    DAMP,
    DEEP,
    DEPTH,
    EQUATION,
    FEED,
    FIRST,
    HOW_MANY,
    HOW_WIDE,
    JOINT,
    LEAST,
    LEFT,
    LIMIT,
    MANY,
    MOBILE,
    PART,
    POINT,
    PUSH,
    SIZE,
    STEP,
    STIFF,
    STOPPED,
    TARGET,
    TURN,
    UNIT,
    VISCOUS,
    Given,
    Ground,
    Law,
    Space,
)
from rbd.worlds.near_kernel import begin_weights, touched, zeros
from rbd.worlds.residual_kernel import equation_residual, law_residual
from rbd.worlds.sites_kernel import SITE_TYPES, Sites, mobility
from rbd.worlds.spatial_kernel import cross, dot, nine, plus, put, three, times, turned
from rbd.worlds.tree_kernel import ROWS, A, D, P, R, S, Tree, U, W, base_upper, free_motion, places

WILD = 1.0
"""A world in which a body turns by more than this in a step [rad] stops."""


@inlined
def moved(q: Array, v: Array, h: Number, free: int, out: Array) -> None:
    """Write q (+) h v."""
    if free:
        put(out, 0, plus(three(q, 0), times(h, three(v, 0))))
        w = times(0.5 * h, three(v, 3))
        square = dot(w, w)
        # sin|w|/|w| and cos|w| by their series: |w| is half the angle of a step
        s = 1.0 - square * (1.0 / 6.0) * (
            1.0 - square * (1.0 / 20.0) * (1.0 - square * (1.0 / 42.0) * (1.0 - square * (1.0 / 72.0)))
        )
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
def forces(tree: Tree, given: Given, push_body: Array, t: float, h: float, q: Array, v: Array, space: Space) -> None:
    """Write torques of the joints, what adds to their inertia, and forces on the bodies about O."""
    free, n, half = tree.free, len(tree.parent), 0.5 * h
    for j in range(n - free):
        o, i = JOINT * j, 6 * free + j
        k, d, limit = load(given.joint, o + STIFF), load(given.joint, o + DAMP), load(given.joint, o + LIMIT)
        still = load(given.joint, o + FEED) + k * (load(given.joint, o + TARGET) - load(space.x, 7 * free + j))
        rate, viscous = load(v, i), load(given.joint, o + VISCOUS)
        # the torque in the middle of the step if nothing else moves the joint: a strong damper does not jump between its limits
        wanted = (still - d * rate) / (1.0 + half * d * load(given.joint, o + MOBILE))
        low = above(-limit, wanted, 1.0 + 0.0 * k, 0.0 * k)
        high = above(wanted, limit, 1.0 + 0.0 * k, 0.0 * k)
        inside = 1.0 - low - high
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
        put(work, A, f)
        put(work, A + 3, m)
        put(space.end, 0, plus(three(space.end, 0), f))
        put(space.end, 3, plus(three(space.end, 3), m))
    for j in range(free, n):
        o, k = j * ROWS, tree.parent[j]
        l, w = zeros(zero), zeros(zero)
        if k >= 0:
            l, w = three(work, k * ROWS + A), three(work, k * ROWS + A + 3)
        x = load(work, o + D) * (load(work, o + W) - dot(three(work, o + U), l) - dot(three(work, o + U + 3), w))
        put(work, o + A, plus(l, times(x, three(work, o + S))))
        put(work, o + A + 3, plus(w, times(x, three(work, o + S + 3))))
        store(space.end, 5 * free + j, load(space.end, 5 * free + j) + x)


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
    free_motion(
        tree, given.inertia, space.v, space.tau, space.damping, given.world, space.pushes, space.base, space.work, space.acc
    )
    for i in range(nv):
        store(space.end, i, load(v, i) + h * load(space.acc, i))
    store(law.merit, DEEP, load(told, DEPTH))
    count, arrival, arrives = touched(tree, sites, ground, given, h, q, v, impulse, moves, space, law, active)
    whole[HOW_MANY], whole[HOW_WIDE] = count, 0
    store(told, DEPTH, load(law.merit, DEEP))
    store(law.merit, ARRIVAL, arrival)
    store(law.merit, ARRIVES, arrives)
    if count == 0:
        return False
    rows = mobility(tree, sites, active, count, starts, space.work, space.base, law)
    whole[HOW_WIDE] = rows
    begin_weights(sites, active, count, starts, rows, impulse, h, law)
    solved(sites, active, count, starts, rows, coulomb, arrives, law, moves, MOST)
    least = load(law.merit, LEAST)
    left = above(least, FOUND, one, above(least, -1.0, zero, one)) * moves
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
    older = k3 + len(sites.single)
    for i in range(older):
        store(impulse, 2 * older + i, load(impulse, older + i))
        store(impulse, older + i, load(impulse, i))
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
    fine = above(1.0, equation, above(turn, WILD, zero, one), zero) * (1.0 - failed)  # NaN anywhere is in the equation
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
    for i in range(older):
        store(impulse, older + i, above(strikes, 0.5, load(impulse, i), load(impulse, older + i)))
        store(impulse, 2 * older + i, above(strikes, 0.5, load(impulse, i), load(impulse, 2 * older + i)))


def advance_blocks(
    parent: Array, kind: Array, placement: Array, free: int,
    site: Array, place: Array, arm: Array, path: Array, path_start: Array, common: Array, common_start: Array, single: Array,
    plane: Array, pieces: Array, faces: Array, face: Array, push_body: Array,
    inertia: Array, checked: Array, joint: Array, world: Array, friction: Array, push: Array,
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
        checked: As there.
        joint: As there.
        world: As there.
        friction: As there.
        push: As there.
        q: Configurations, shape (blocks, rows, lanes); written.
        v: Velocities, a base's in the world's axes; written.
        before: Accelerations of the last two steps, and whether there were two, shape (blocks, 2 nv + 1, lanes); written.
        impulse: Impulses of the last three steps, of points in the world's axes; written.
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
            inertia[min(b, len(inertia) - 1)], checked[min(b, len(checked) - 1)], joint[min(b, len(joint) - 1)],
            world[min(b, len(world) - 1)], friction[min(b, len(friction) - 1)], push[min(b, len(push) - 1)],
        )  # fmt: skip
        while whole[STEP] < steps:
            i = whole[STEP]
            if whole[PART] == 0 and begun_step(
                tree, sites, ground, given, push_body, (number + i) * h, h, coulomb, q[b], v[b], before[b], impulse[b], told[b],
                room, law, whole,
            ):  # fmt: skip
                whole[PART] = 1
                return
            if whole[PART] == 1:
                count = whole[HOW_MANY]
                polished(
                    sites, whole[ACTIVE : ACTIVE + len(site)], count, whole[ACTIVE + len(site) :], whole[HOW_WIDE], coulomb, law
                )
            whole[PART] = 0
            ended_step(tree, sites, given, number + i, h, coulomb, q[b], v[b], before[b], impulse[b], told[b], room, law, whole)
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
"""The same for one world a block: arrays without the last dimension. Not compiled."""
