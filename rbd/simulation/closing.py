"""Positions put right after a step, and when a point comes through its surface."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array, largest
from rbd.mechanism.projection import ZERO, Projection, correction, inertia_factor, project_position
from rbd.mechanism.stage_solver import OWED
from rbd.model.state import State
from rbd.simulation.motion import Motion
from rbd.simulation.nearness import CLOSED, Nearness
from rbd.simulation.snapshot import Points, Snapshot


class Closing:
    """Puts positions back: of what holds, if that is kept by projection, and of points that are closed or too deep."""

    def __init__(self, motion: Motion, points: Points, nearness: Nearness) -> None:
        self.points, self.nearness = points, nearness
        given = motion.stabilisation
        self.holds = isinstance(given, Projection)
        self.projection = given if isinstance(given, Projection) else Projection()

    def put_right(self, at: Snapshot, t: float, closed: Array) -> Snapshot:
        """The snapshot with positions put right.

        Args:
            at: Where the step came to.
            t: Its time [s].
            closed: Which points are pulled as well as pushed to their surface, shape (k,).
        """
        layout = at.layout
        held = layout.held if self.holds else np.zeros(len(at.error), bool)
        size = self.nearness.of(at).size
        pressed = layout.pushes & (closed | (at.gap < -CLOSED * size))
        size = size[pressed]
        if largest(at.error[held]) <= self.projection.tolerance and largest(at.gap[pressed] / size) <= CLOSED:
            return at
        rows = np.concatenate([np.flatnonzero(held), layout.normals[pressed]])
        units = np.concatenate([np.ones(int(held.sum())), size])
        seen = {id(at.state): at}

        def equations(state: State) -> tuple[Array, Array]:
            now = seen[id(state)] = seen.get(id(state)) or self.points.at(state, t)
            if now.layout is not layout:  # points have come into sight or gone: the rest is the next step's
                return at.J[:0], at.error[:0]
            return now.J[rows] / units[:, None], np.concatenate([now.error[held], now.gap[pressed]]) / units

        return seen[id(project_position(at.state, equations, self.projection))]

    def stilled(self, at: Snapshot, t: float) -> Snapshot:
        """The snapshot with the velocity that is nearest, in the inertia metric, to its own and that what holds allows.

        A step leaves J v off by O(h^2). Where rows repeat each other, their J_dot v then contradict each other by as much.
        """
        held = at.layout.held
        rate = at.velocity[held]
        if largest(rate) <= self.projection.tolerance:
            return at
        state, zero = at.state, max(ZERO, OWED * at.drift)
        less = correction(inertia_factor(state), at.J[held], rate, zero=zero)
        return self.points.at(state.with_velocity(state.v - less), t)


def first_crossing(gap: Array, rate: Array, gap_end: Array, rate_end: Array, h: float) -> float:
    """When the first of several gaps becomes zero, by the cubic through both ends, in (0, h) [s].

    Args:
        gap: At the beginning, positive, shape (k,).
        rate: Their rates there.
        gap_end: After h, negative, shape (k,).
        rate_end: Their rates there.
        h: Length of the step [s].
    """
    first = h
    for g, r, g1, r1 in zip(gap.tolist(), rate.tolist(), gap_end.tolist(), rate_end.tolist(), strict=True):
        first = min(first, _root(g, r * h, g1, r1 * h) * h)
    return first


def _root(g: float, r: float, g1: float, r1: float) -> float:
    """The root in (0, 1) of the cubic with values g > 0 > g1 and slopes r, r1: by bisection and secants."""
    a, b = 2.0 * (g - g1) + r + r1, 3.0 * (g1 - g) - 2.0 * r - r1

    def value(x: float) -> float:
        return ((a * x + b) * x + r) * x + g

    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if value(middle) > 0.0:
            low = middle
        else:
            high = middle
        if high - low < 1e-15 or math.isclose(low, high, rel_tol=1e-15):
            break
    return 0.5 * (low + high)
