"""Gaps of contact points: tolerances of contact, times at which gaps close within a step, and correction of positions.

A closed point stays closed up to a gap of `loose`: an unloaded corner may hover by the error of a step. An open point is in
contact from a gap of `tight` on, which is zero to rounding. So no contact begins early, however slow or small. Both are
relative to the size of the bodies that move with the point (or to one metre, if they are larger): a motion of small bodies is
the same as that of large ones, scaled.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from rbd.arrays import Array, each_times, inertia_factor, lazy, max_abs
from rbd.constraints.manifold import ZERO
from rbd.constraints.stabilisation import Baumgarte
from rbd.mechanism.projection import Projection, correction, project_position
from rbd.mechanism.redundant_accelerations import OWED
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.simulated_motion import Stabilisation
from rbd.simulation.stacked_points import PointLayout, PointMatching, Points, Snapshot

LOOSE = 1e-7
"""Over the size: the largest gap of a point that stays closed."""
TIGHT = 1e-12
"""Over the size: the largest gap of a point that makes contact."""
CLOSED = 1e-9
"""Over the size: closed points are not corrected below this gap or depth."""
PARALLEL = 1e-4
"""Directions in which rows of points that press have singular values below this, over the largest, are left alone."""
_ROUNDING = 16.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class GapTolerances:
    """Tolerances of the points of a layout, each of shape (k,) [m, rad].

    Attributes:
        layout: The points.
        loose: The largest gap of a point that stays closed.
        tight: The largest gap of a point that makes contact.
        size: Size of the bodies that move with the point, at most 1.
    """

    layout: PointLayout
    loose: Array
    tight: Array
    size: Array

    @lazy
    def least_loose(self) -> float:
        """The least of `loose`."""
        return float(self.loose.min(initial=np.inf))

    @lazy
    def least_size(self) -> float:
        """The least of `size`."""
        return float(self.size.min(initial=np.inf))


@dataclass(frozen=True, eq=False)
class BodySizes:
    """Sizes that scale the tolerances of gaps, computed at the start of a simulation.

    Attributes:
        sizes: Size of the bodies that move with each coordinate, shape (nv,) [m].
        prismatic: Which coordinates belong to prismatic joints, shape (nv,).
        far: Largest coordinate.
        touch: The largest gap of a point that makes contact [m, rad]; None: `TIGHT` of the size.
    """

    sizes: Array
    prismatic: Array
    far: float
    touch: float | None = None

    @classmethod
    def of(cls, start: State, touch: float | None = None) -> BodySizes:
        """The scales of the robot of a state."""
        return cls(_sizes(start), solids_of(start.robot).prismatic, max_abs(start.q), touch)

    def tolerances(self, at: Snapshot, known: GapTolerances | None = None) -> GapTolerances:
        """The tolerances of a snapshot's points: `known`, if it has the same layout."""
        layout = at.layout
        if known is not None and known.layout is layout:
            return known
        moves = at.J[layout.normals] != 0.0
        placed = np.concatenate([np.zeros(0, bool), *[np.full(len(m.gap), m.points is not None) for m in at.sources]])
        size = np.where(moves, self.sizes, 1.0).min(axis=1, initial=1.0)
        # Without a position the gap is a length only if just a prismatic joint moves it; else it may be an angle.
        size = np.where(placed | ((moves.sum(axis=1) == 1) & (moves & self.prismatic).any(axis=1)), size, 1.0)
        tight = (TIGHT * size if self.touch is None else self.touch) + _ROUNDING * (size + max(self.far, max_abs(at.state.q)))
        return GapTolerances(layout, np.maximum(LOOSE * size, tight), tight, size)


def _sizes(start: State) -> Array:
    """Size for each coordinate: of the bodies connected with it to one joint of the world, shape (nv,) [m].

    The size is the largest distance of a body's centre of mass, or its joint if all masses are points, from the centre of
    mass, plus that body's radius of gyration; one metre if that is zero, or larger.
    """
    solids, out = solids_of(start.robot), np.ones(start.robot.nv)
    R, p = start.joint_places(range(1, len(solids.roots) + 1))
    centres = p + each_times(R, solids.levers)
    for root in np.unique(solids.roots):
        tree = solids.roots == root
        heavy = tree & (solids.masses > 0.0)
        if not heavy.any():
            continue
        masses = solids.masses[heavy]
        middle = masses @ centres[heavy] / masses.sum()
        size = float((np.linalg.norm(centres[heavy] - middle, axis=1) + solids.gyration[heavy]).max())
        if size <= 1e-12:
            size = float(np.linalg.norm(p[heavy] - middle, axis=1).max())
        out[tree[solids.joint]] = size if 1e-12 < size < 1.0 else 1.0
    return out


@dataclass(frozen=True, eq=False)
class Solids:
    """The bodies of a robot's n joints, in their axes, and the joints of its coordinates; the world's is left out.

    Attributes:
        roots: The joint of the world from which each hangs, shape (n,).
        masses: Shape (n,) [kg].
        levers: Centres of mass, shape (n, 3) [m].
        gyration: Radii of gyration, zero without mass, shape (n,) [m].
        joint: Index of each coordinate's joint, shape (nv,).
        prismatic: Which coordinates belong to prismatic joints, shape (nv,).
    """

    roots: Array
    masses: Array
    levers: Array
    gyration: Array
    joint: Array
    prismatic: Array


_SOLIDS: WeakKeyDictionary[CheckedModel, Solids] = WeakKeyDictionary()


def solids_of(robot: CheckedModel) -> Solids:
    """The bodies of a robot, computed once."""
    found = _SOLIDS.get(robot)
    if found is not None:
        return found
    model = robot.model
    joints = range(1, model.njoints)
    roots = [0] * model.njoints
    for j in joints:
        roots[j] = roots[model.parents[j]] if model.parents[j] else j
    solids = [model.inertias[j] for j in joints]
    masses, moments = (np.array(x) for x in ([s.mass for s in solids], [np.trace(s.inertia) for s in solids]))
    gyration = np.sqrt(np.maximum(moments, 0.0) / (2.0 * np.where(masses > 0.0, masses, 1.0)))
    slides = [model.joints[j].shortname().startswith("JointModelP") and model.nvs[j] == 1 for j in joints]
    joint = np.repeat(np.arange(len(roots) - 1), list(model.nvs)[1:])
    levers = np.array([s.lever for s in solids]).reshape(-1, 3)
    found = _SOLIDS[robot] = Solids(np.array(roots[1:]), masses, levers, gyration, joint, np.array(slides, bool)[joint])
    return found


@dataclass(frozen=True, eq=False)
class Correction:
    """Correction of positions: closed points by projection, bilateral constraints by projection or feedback.

    Attributes:
        points: The contact points.
        projection: Settings of the projection.
        bilateral: Whether bilateral constraints are projected too.
        feedback: Baumgarte's feedback for bilateral constraints, if used.
    """

    points: Points
    projection: Projection
    bilateral: bool
    feedback: Baumgarte | None

    @classmethod
    def of(cls, points: Points, given: Stabilisation) -> Correction:
        """From a motion's `stabilisation`."""
        projected, feedback = isinstance(given, Projection), given if isinstance(given, Baumgarte) else None
        return cls(points, given if isinstance(given, Projection) else Projection(), projected, feedback)

    def in_place(self, at: Snapshot, gaps: GapTolerances) -> bool:
        """Whether no position needs a correction, whichever points are closed; a quick test."""
        lowest, highest, _ = at.extremes
        return not at.layout.bilateral and max(-lowest, highest) <= CLOSED * gaps.least_size

    def positions(self, at: Snapshot, t: float, closed: Array, size: Array) -> Snapshot:
        """The snapshot with its position projected.

        Args:
            at: The points at the end of the step.
            t: Its time [s].
            closed: Which points are corrected in both directions, shape (k,).
            size: Size of the bodies that move with each point, shape (k,) [m].
        """
        layout, ground = at.layout, at.ground
        held = layout.held if self.bilateral else np.zeros(len(at.error), bool)
        pressed = layout.pushes & (closed | (at.gap < -CLOSED * size))
        size = size[pressed]
        if max_abs(at.error[held]) <= self.projection.tolerance and max_abs(at.gap[pressed] / size) <= CLOSED:
            return at
        rows = np.concatenate([np.flatnonzero(held), layout.normals[pressed]])
        units = np.concatenate([np.ones(int(held.sum())), size])
        known = {id(at.state): at}

        def equations(state: State) -> tuple[Array, Array]:
            now = known[id(state)] = known.get(id(state)) or (self.points if ground is None else ground).at(state, t)
            if now.layout is not layout:  # points have entered or left the contact set: the next step continues
                return at.J[:0], at.error[:0]
            error = np.concatenate([now.error[held], now.gap[pressed]]) / units
            return now.gap if ground is not None else now.J[rows] / units[:, None], error

        def by_bodies(state: State, gap: Array, error: Array) -> Array:
            assert ground is not None
            return ground.toward(state, pressed, gap)

        if ground is not None:
            return known[id(project_position(at.state, equations, self.projection, by_bodies))]
        # Faces that are tilted by a hair against each other would be met by a way along both.
        zero = PARALLEL if len(size) else ZERO
        return known[id(project_position(at.state, equations, self.projection, zero=zero))]

    def owes(self, start: Snapshot, end: Snapshot, pressed: Array, moved: Array) -> bool:
        """Whether most of the error at a step's end was there at its start, or is the way of points that it stops.

        It is then of a state given, of points that are new there, or of impacts below the speed of a bounce.

        The work of its correction is then none that the step makes.

        Args:
            start: The points at its start.
            end: The points at its end.
            pressed: Which of those press, shape (k,).
            moved: How far points would have gone by the mean of their velocity at the start and none, shape (k,).
        """
        match = PointMatching(start.layout, end.layout)
        gap, error = match.points(start.gap, np.inf), match.rows(start.error)
        held = end.layout.held if self.bilateral else np.zeros(len(end.error), bool)
        now = max(max_abs(end.gap[pressed]), max_abs(end.error[held]))
        return max(max_abs(gap[pressed]), max_abs(error[held]), max_abs(moved[pressed])) > 0.5 * now

    def velocities(self, at: Snapshot, t: float, rests: Array | None = None) -> Snapshot:
        """The snapshot with the nearest velocity, in the inertia metric, that its bilateral constraints allow.

        After a step J v has an error of O(h^2), by which the J_dot v of linearly dependent rows would contradict each other,
        and by which what stands on ground that moves would be behind it.

        Args:
            at: The points at the end of the step.
            t: Its time [s].
            rests: Further rows that are at rest: of points that press, shape (p,).
        """
        held, zero = at.layout.held, max(ZERO, OWED * at.drift)
        if rests is not None and rests.any():
            held, zero = held | rests, max(zero, PARALLEL)
        rate = at.velocity[held]
        if max_abs(rate) <= self.projection.tolerance:
            return at
        state = at.state
        less = correction(inertia_factor(state.M), at.J[held], rate, zero=zero)
        return self.points.at(state.with_velocity(state.v - less), t)

    def wanted(self, layout: PointLayout, u: Array, error: Array, h: float) -> Array | float:
        """Velocities of bilateral rows after a time h, shape (p,), required by Baumgarte's feedback; 0.0 without it.

        It is one implicit Euler step of error'' + 2 zeta w error' + w^2 error = 0 from (error, u), stable at any h. u is the
        velocity required in the step before: the state's velocity differs from it by O(h^2), and these differences must not
        add up.
        """
        if self.feedback is None:
            return 0.0
        w, zeta = float(self.feedback.frequency), float(self.feedback.damping_ratio)
        return np.where(layout.held, (u - h * w * w * error) / (1.0 + 2.0 * zeta * w * h + (w * h) ** 2), 0.0)


def first_crossing(gap: Array, rate: Array, gap_end: Array, rate_end: Array, h: float) -> float:
    """Time at which the first of several gaps becomes zero, by the cubic through both ends, in (0, h) [s].

    Args:
        gap: At the beginning, positive, shape (k,).
        rate: Their rates at the beginning.
        gap_end: Gaps after h, negative, shape (k,).
        rate_end: Their rates after h.
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
        low, high = (x, high) if ((a * x + b) * x + r) * x + g > 0.0 else (low, x)
    return 0.5 * (low + high)
