"""Detection of touching points between two states, and position correction after a step.

A point that was closed stays closed up to a gap of `loose`: a corner that carries nothing may hover by the error of a step.
A point that was open touches at `tight`, where its gap is zero to rounding. So nothing strikes early, slow or small as it may
be. Both are relative to the size of the bodies that move with the point (or to one metre, if they are larger): a motion of
small bodies is the same as that of large ones, scaled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, inertia_factor, max_abs
from rbd.mechanism.projection import ZERO, Projection, correction, project_position
from rbd.mechanism.stage_solver import OWED
from rbd.model.state import State
from rbd.simulation.contact_points import Layout, Points, Snapshot
from rbd.simulation.motion import Motion

LOOSE = 1e-7
"""Over the size: the largest gap of a point that stays closed."""
TIGHT = 1e-12
"""Over the size: the largest gap of a point that has come to touch."""
CLOSED = 1e-9
"""Over the size: closed points are left alone up to this gap or depth."""
_ROUNDING = 16.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Near:
    """Tolerances of the points of a layout, each of shape (k,) [m, rad].

    Attributes:
        loose: The largest gap of a point that stays closed.
        tight: The largest gap of a point that has come to touch.
        size: Of what moves with the point, at most 1.
    """

    loose: Array
    tight: Array
    size: Array


class Nearness:
    """Tolerances of gaps in one simulation; sizes are those at its start.

    Args:
        start: Where it starts.
    """

    def __init__(self, start: State) -> None:
        self._sizes, self._slides, self._far = _sizes(start), _sliding(start), max_abs(start.q)
        self._last: tuple[Layout, Near] | None = None

    def of(self, at: Snapshot) -> Near:
        """Of the points of a snapshot; made once for a layout."""
        if self._last is None or self._last[0] is not at.layout:
            self._last = at.layout, self._near(at)
        return self._last[1]

    def _near(self, at: Snapshot) -> Near:
        layout = at.layout
        moves = at.J[layout.normals] != 0.0
        placed = np.concatenate([np.zeros(0, bool), *[np.full(len(m.gap), m.points is not None) for m in at.sources]])
        size = np.where(moves, self._sizes, 1.0).min(axis=1, initial=1.0)
        # What has no place has a gap in metres only where a slider has it to itself; else it may be an angle.
        size = np.where(placed | ((moves.sum(axis=1) == 1) & (moves & self._slides).any(axis=1)), size, 1.0)
        tight = TIGHT * size + _ROUNDING * (size + max(self._far, max_abs(at.state.q)))
        return Near(np.maximum(LOOSE * size, tight), tight, size)


def _sizes(start: State) -> Array:
    """Of each coordinate: the size of the bodies that hang, together with it, from one joint of the world, shape (nv,) [m].

    The size is the farthest that a body's centre of mass, or its joint if all masses are points, is from the centre of mass of
    all, and that body's radius of gyration; one metre where that is nothing, or more.
    """
    model = start.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, start.q)
    roots = [0] * model.njoints
    for j in range(1, model.njoints):
        roots[j] = roots[model.parents[j]] if model.parents[j] else j
    out = np.ones(model.nv)
    for root in set(roots[1:]):
        tree = [j for j in range(1, model.njoints) if roots[j] == root]
        heavy = [j for j in tree if model.inertias[j].mass > 0.0]
        if not heavy:
            continue
        masses = np.array([model.inertias[j].mass for j in heavy])
        centres = np.array([data.oMi[j].act(model.inertias[j].lever) for j in heavy])
        moments = np.array([np.trace(model.inertias[j].inertia) for j in heavy])
        gyration = np.sqrt(np.maximum(moments, 0.0) / (2.0 * masses))
        middle = masses @ centres / masses.sum()
        size = float((np.linalg.norm(centres - middle, axis=1) + gyration).max())
        if size <= 1e-12:
            size = max(float(np.linalg.norm(data.oMi[j].translation - middle)) for j in heavy)
        for j in tree:
            out[model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = size if 1e-12 < size < 1.0 else 1.0
    return out


def _sliding(start: State) -> Array:
    """Which coordinates belong to joints that slide along an axis, shape (nv,)."""
    model = start.robot.model
    out = np.zeros(model.nv, bool)
    for j in range(1, model.njoints):
        if model.joints[j].shortname().startswith("JointModelP") and model.nvs[j] == 1:
            out[model.idx_vs[j]] = True
    return out


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
        if max_abs(at.error[held]) <= self.projection.tolerance and max_abs(at.gap[pressed] / size) <= CLOSED:
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
        if max_abs(rate) <= self.projection.tolerance:
            return at
        state, zero = at.state, max(ZERO, OWED * at.drift)
        less = correction(inertia_factor(state.M), at.J[held], rate, zero=zero)
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
    """The root in (0, 1) of the cubic with values g > 0 > g1 and slopes r, r1, to 1e-15: by bisection."""
    a, b = 2.0 * (g - g1) + r + r1, 3.0 * (g1 - g) - 2.0 * r - r1
    low, high = 0.0, 1.0
    for _ in range(50):
        x = 0.5 * (low + high)
        if ((a * x + b) * x + r) * x + g > 0.0:
            low = x
        else:
            high = x
    return 0.5 * (low + high)
