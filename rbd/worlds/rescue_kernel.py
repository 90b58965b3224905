"""The contact problem of one world of a block, and its answer written back."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, array, compiled, signature
from rbd.solvers.law_kernel import PROBLEM
from rbd.solvers.newton_kernel import Problem
from rbd.worlds.contact_kernel import law_in
from rbd.worlds.lanes import lane, put_lane
from rbd.worlds.layout import (
    ACTIVE,
    ALONE,
    ARM,
    FELT,
    FIRST,
    HOW_MANY,
    HOW_WIDE,
    IDLE,
    LEFT,
    MANY,
    MU,
    NORMAL,
    OFFSET,
    POINT,
    SIZE,
    UNIT,
    Law,
)
from rbd.worlds.sites_kernel import SITE_TYPES, Sites


@compiled
def problem_of(
    sites: Sites, active: Array, count: int, starts: Array, rows: int, law: Law, of: int
) -> tuple[Problem, Array, Array]:  # fmt: skip
    """(the problem of one lane, not scaled; the axes of its points, shape (k, 3, 3); which single or point each part is)."""
    cones, singles = 0, 0
    for a in range(count):
        s = active[a]
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            if sites.site[s, SIZE] == 1:
                singles += 1
            elif lane(law.point, POINT * c + IDLE, of) < 0.5:
                cones += 1
    parts, p = singles + cones, singles + 3 * cones
    D, columns, offset, whose = np.zeros((rows, rows)), np.zeros((p, 6)), np.zeros(p), np.zeros(parts, np.int64)
    felt = np.zeros((p, 6))
    first, width = np.zeros(parts, np.int64), np.zeros(parts, np.int64)
    lower, upper, mu, axes = np.zeros(singles), np.zeros(singles), np.zeros(cones), np.zeros((cones, 3, 3))
    for i in range(rows):
        for j in range(rows):
            D[i, j] = lane(law.mobility, i * rows + j, of)
    at, cone = 0, 0
    for a in range(count):
        s = active[a]
        for c in range(sites.site[s, FIRST], sites.site[s, FIRST] + sites.site[s, MANY]):
            if sites.site[s, SIZE] == 1:
                unit = lane(law.single, 8 * c + 3, of)
                columns[at, 0] = felt[at, 0] = 1.0
                offset[at], whose[at] = lane(law.single, 8 * c, of), c
                first[at], width[at] = starts[a], 1
                lower[at], upper[at] = unit * lane(law.single, 8 * c + 1, of), unit * lane(law.single, 8 * c + 2, of)
                at += 1
            elif lane(law.point, POINT * c + IDLE, of) < 0.5:
                i, E = singles + 3 * cone, axes[cone]
                for r in range(3):
                    E[2, r] = lane(law.point, POINT * c + NORMAL + r, of)
                least = 0
                for r in range(3):
                    if abs(E[2, r]) < abs(E[2, least]):
                        least = r
                square = math.sqrt(1.0 - E[2, least] ** 2)
                for r in range(3):
                    E[0, r] = ((1.0 if r == least else 0.0) - E[2, least] * E[2, r]) / square
                for r in range(3):
                    E[1, r] = E[2, (r + 1) % 3] * E[0, (r + 2) % 3] - E[2, (r + 2) % 3] * E[0, (r + 1) % 3]
                for e in range(3):
                    for r in range(3):
                        columns[i + e, r] = felt[i + e, r] = E[e, r]
                        offset[i + e] += E[e, r] * lane(law.point, POINT * c + OFFSET + r, of)
                        if sites.site[s, SIZE] == 6:
                            y, z = (r + 1) % 3, (r + 2) % 3
                            push, pull = POINT * c + ARM, POINT * c + FELT
                            columns[i + e, 3 + r] = (
                                lane(law.point, push + y, of) * E[e, z] - lane(law.point, push + z, of) * E[e, y]
                            )
                            felt[i + e, 3 + r] = (
                                lane(law.point, pull + y, of) * E[e, z] - lane(law.point, pull + z, of) * E[e, y]
                            )
                mu[cone], whose[singles + cone] = lane(law.point, POINT * c + MU, of), c
                first[singles + cone], width[singles + cone] = starts[a], sites.site[s, SIZE]
                cone += 1
    return Problem(D, np.zeros(rows), columns, felt, offset, first, width, lower, upper, mu), axes, whose


def _left_problem(
    site: Array, place: Array, arm: Array, path: Array, path_start: Array, common: Array, common_start: Array, single: Array,
    space: Array, whole: Array, n: int, of: int,
) -> tuple[Problem, Array, Array]:  # fmt: skip
    """As `problem_of`, of a lane whose impulses were not found."""
    sites, s = Sites(site, place, arm, path, path_start, common, common_start, single), len(site)
    law = law_in(space, sites, n)
    return problem_of(sites, whole[ACTIVE : ACTIVE + s], whole[HOW_MANY], whole[ACTIVE + s :], whole[HOW_WIDE], law, of)


def _take(
    site: Array, place: Array, arm: Array, path: Array, path_start: Array, common: Array, common_start: Array, single: Array,
    space: Array, n: int, of: int, axes: Array, whose: Array, w: Array,
) -> None:  # fmt: skip
    """Write the impulses found for a lane, which is then no longer left."""
    law = law_in(space, Sites(site, place, arm, path, path_start, common, common_start, single), n)
    singles = len(whose) - len(axes)
    for at in range(singles):
        put_lane(law.best, 3 * len(arm) + whose[at], of, w[at] / lane(law.single, 8 * whose[at] + 3, of))
    for cone in range(len(axes)):
        c = whose[singles + cone]
        for r in range(3):
            x = 0.0
            for e in range(3):
                x += axes[cone, e, r] * w[singles + 3 * cone + e]
            put_lane(law.best, 3 * c + r, of, x / lane(law.point, POINT * c + UNIT, of))
    put_lane(law.merit, LEFT, of, ALONE)


_SPACE, _AXES, _WHOSE = array(2, written=True), array(3, written=True), array(1, COUNT, written=True)
left_problem = compiled(
    _left_problem, signature((PROBLEM, _AXES, _WHOSE), *SITE_TYPES, _SPACE, array(1, COUNT, written=True), COUNT, COUNT),
)  # fmt: skip
take = compiled(_take, signature(None, *SITE_TYPES, _SPACE, COUNT, COUNT, _AXES, _WHOSE, array(1, written=True)))
