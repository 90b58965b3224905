"""The centroid's program: centre of mass, rate of angular momentum and contact forces over a whole motion, by one cone program.

    m (c[k-1] - 2 c[k] + c[k+1]) / dt^2 = sum_i f_i + m g,        L_dot = sum_i (p_i - c) x f_i,        |f_t| <= mu f_n

The moment is bilinear in c and f. About a plan (c0, F0) that is known, F = sum f_i, it is

    (p - c) x f  =  (p - c0) x f - (c - c0) x F0

to second order; `CentroidProgram.solve` is called again from its own answer until the two agree. Where stances may shift, by d,
their force f0 of the plan before turns with them: d x f0. Forces between the times are means of those at the times, so in their
cones. The centroid first, whole-body poses second, is the division of [Dai2014]. SI units, world axes, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rbd.arrays import Array, cross_matrices, each_times
from rbd.constraints.convex.polygons import across
from rbd.displayed import Displayed
from rbd.errors import NoSolution

INNER = 0.75
"""Forces of plans act at the corners of soles made smaller by this."""
STOPPED = 1e-5
"""Where the solver makes no more progress, errors of its rows by less are taken, over the weight: `residual` tells them."""


@dataclass(frozen=True)
class CentroidCosts(Displayed):
    """What a unit of cost is: sizes of deviations that matter equally.

    Example:
        >>> rbd.centroid.CentroidCosts(com=0.02).force_rate
        5.0

    Attributes:
        com: Of the centre of mass from the reference [m].
        momentum: Of the rate of angular momentum from the reference, over the weight [m].
        acceleration: Of the centre of mass's acceleration from the reference [m/s2].
        jerk: Of the centre of mass [m/s3].
        force: Of forces, over the weight.
        force_rate: Change of forces over the weight in a second [1/s].
        shift: Of a stance that lasts a quarter of a second [m].
        excess: Of a row of `CentroidProgram.limits` beyond its limit.
        turning: Of the angular momentum, over the weight [m s]; infinite: it costs nothing.
        height: Of the centre of mass's height from the reference [m]; None: as `com`.
    """

    com: float = 0.05
    momentum: float = 4.0 / 330.0
    acceleration: float = 2.0
    jerk: float = 60.0
    force: float = 3.0
    force_rate: float = 5.0
    shift: float = 0.04
    excess: float = 0.4
    turning: float = np.inf
    height: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class CentroidPlan(Displayed):
    """A motion of the centroid in n times with forces at k points, of `CentroidProgram.solve`.

    Example:
        >>> still = np.tile([0.02, 0.0, 0.5], (30, 1))
        >>> sole = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.05, 0.05)])
        >>> points, on, down = np.tile(sole, (30, 1, 1)), np.ones((30, 4), bool), np.array([0.0, 0.0, -9.81])
        >>> plan = rbd.centroid.CentroidProgram(1 / 60, 35.0, down, points, on, 0.6, still, np.zeros((30, 3))).solve()
        >>> plan.status, plan.forces.sum(axis=1)[15].round(0) + 0.0
        ('Solved', array([  0.,   0., 343.]))

    Attributes:
        com: Centre of mass, shape (n, 3) [m].
        moment: Rate of angular momentum about it, shape (n, 3) [N m].
        forces: At the points, shape (n, k, 3) [N]; zero where they do not touch.
        shifts: Of the stances along the floor, shape (stances, 2) [m].
        status: What the solver said.
        cost: Half the sum of squares that the program minimises.
        residual: Largest error of the balance of forces and of moments about the plan's own centre of mass, over the weight,
            and over the weight times 0.3 m: what the linearised moment leaves.
        start: Angular momentum at the first time, shape (3,) [N m s]; zero where the program was given none.
    """

    com: Array
    moment: Array
    forces: Array
    shifts: Array
    status: str
    cost: float
    residual: float
    start: Array

    def __repr__(self) -> str:
        n, k, _ = self.forces.shape
        return f"CentroidPlan({n} times, {k} points, {self.status}, residual {self.residual:.1e})"


@dataclass(frozen=True, eq=False, repr=False)
class CentroidProgram(Displayed):
    """The nearest motion of the centroid to a reference that contacts can bring about.

    Example:
        >>> out = np.tile([0.15, 0.0, 0.5], (30, 1))
        >>> sole = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.05, 0.05)])
        >>> points, on, down = np.tile(sole, (30, 1, 1)), np.ones((30, 4), bool), np.array([0.0, 0.0, -9.81])
        >>> still = np.zeros((30, 3))
        >>> program = rbd.centroid.CentroidProgram(1 / 60, 35.0, down, points, on, 0.6, out, still, rests=(True, True))
        >>> plan = program.solve()  # 5 cm beyond the edge it could not rest
        >>> plan = program.solve(plan)
        >>> bool(plan.com[0, 0] < 0.11), bool(plan.residual < 0.01)
        (True, True)

    Attributes:
        dt: Time between two of the n times [s].
        mass: Of the robot [kg].
        gravity: Shape (3,) [m/s2].
        points: Places that may touch, shape (n, k, 3) [m].
        touches: Which of them do, shape (n, k).
        friction: Coulomb's coefficient.
        com: Reference of the centre of mass, shape (n, 3) [m].
        moment: Reference of the rate of angular momentum, shape (n, 3) [N m].
        stance: Which stance moves each point, shape (n, k); -1: none. Stances shift along the floor as wholes.
        bounds: (G, h): shifts d of all stances, one after the other, keep G d >= h, shapes (m, 2 stances) and (m,)
        rests: Whether the centre of mass is at rest, and in balance, at the first and at the last time.
        limits: (at, C, h): the sum of C_i . f_i over the points is at most h, softly, in m rows of times `at`, as torques of
            motors have it; shapes (m,), (m, k, 3) [1/N] and (m,).
        start: (centre of mass, its velocity, angular momentum) at the first time, shapes (3,) [m, m/s, N m s]; None: they are
            free, or at rest.
        end: Centre of mass at the last time, shape (3,) [m]; None: it is free.
        costs: See `CentroidCosts`.
        normals: Of what is under the points: their friction cones are about these, shape (n, k, 3); None: level.
        least: Points press with this at least, shape (n, k) [N]; None: with nothing.
        fixed: (at, D): D times (centre of mass, its acceleration, moment over the mass) is that of the references in m rows of
            times `at`: what the robot cannot change; shapes (m,) and (m, 9).
    """

    dt: float
    mass: float
    gravity: Array
    points: Array
    touches: Array
    friction: float
    com: Array
    moment: Array
    stance: Array | None = None
    bounds: tuple[Array, Array] | None = None
    rests: tuple[bool, bool] = (False, False)
    limits: tuple[Array, Array, Array] | None = None
    start: tuple[Array, Array, Array] | None = None
    end: Array | None = None
    costs: CentroidCosts = field(default_factory=CentroidCosts)
    normals: Array | None = None
    least: Array | None = None
    fixed: tuple[Array, Array] = (np.zeros(0, int), np.zeros((0, 9)))

    def __repr__(self) -> str:
        n, k = self.touches.shape
        return f"CentroidProgram({n} times, {k} points, {self.stances} stances that shift)"

    def solve(self, about: CentroidPlan | None = None) -> CentroidPlan:
        """The plan; moments linearised about another one, by default the reference with forces that carry its weight.

        Raises:
            NoSolution: the solver ended without an answer, in its words.
        """
        import clarabel
        from scipy.sparse import csc_matrix, triu

        n, unit = len(self.com), self.weight
        k, i = np.nonzero(self.touches)
        E, S = len(k), self.stances
        force, shift = 6 * n + 3 * np.arange(E), 6 * n + 3 * E  # columns: c, moment, forces, shifts, excesses
        over, (times, C, most) = shift + 2 * S, self._limits()
        excess = over + np.arange(len(times))
        turning, T = over + len(times), 3 * n * bool(self.costs.turning < np.inf)  # columns of the angular momentum
        com = self.com if about is None else about.com
        cross = cross_matrices((self.points if about is None else self._places(about.shifts))[k, i] - com[k])
        total = (self._acceleration(com) - self.gravity) * self.mass / unit
        turned = cross_matrices(total)

        A, b = _Rows(), np.concatenate([np.tile(self.gravity * self.mass / unit, n), -each_times(turned, com).ravel()])
        xyz = np.arange(3)
        for at, factor in zip(_around(n), (1.0, -2.0, 1.0), strict=True):
            A.put(3 * np.arange(n), 3 * at, xyz, xyz, factor * self.mass / (unit * self.dt**2))
        A.put(3 * k, force, xyz, xyz, -1.0)
        low = 3 * n + 3 * np.arange(n)
        A.put(low, low, xyz, xyz, 1.0)
        A.block(3 * n + 3 * k, force, -cross)
        A.block(low, 3 * np.arange(n), -turned)
        if S and about is not None:
            s, moved = self._stance()[k, i], about.forces[k, i] / unit
            on = s >= 0
            turns = cross_matrices(moved[on])[:, :, :2]
            A.block(3 * n + 3 * k[on], shift + 2 * s[on], turns)
            np.add.at(b[3 * n :].reshape(n, 3), k[on], each_times(turns, about.shifts[s[on]]))
        at_rest = np.array([k for k, rests in zip((0, 1, n - 2, n - 3), np.repeat(self.rests, 2), strict=True) if rests], int)
        still = 6 * n + 3 * np.arange(len(at_rest))
        for beside, factor in ((0, -1.0), (1, 1.0)):  # three places are the same at an end
            A.put(still, 3 * (at_rest + beside), xyz, xyz, factor)
        given = np.zeros((0, 3)) if self.start is None else np.array([self.start[0], self.dt * self.start[1]])
        last = 6 * n + 3 * len(at_rest) + 3 * np.arange(self.end is not None)
        A.put(last, np.full(len(last), 3 * (n - 1)), xyz, xyz, 1.0)
        given = given if self.end is None else np.vstack([self.end, given])
        begins = 6 * n + 3 * len(at_rest) + 3 * np.arange(len(last), len(given))
        for column, *factors in ((0, 1.0, -1.5), (3, 0.0, 2.0), (6, 0.0, -0.5)):  # the first acceleration is the second
            for first, weight in zip(begins, factors, strict=False):
                A.put(np.array([first]), np.array([column]), xyz, xyz, weight)
        # L[k] - L[k-1] = dt (L_dot[k-1] + L_dot[k]) / 2
        sums = 6 * n + 3 * len(at_rest) + 3 * len(given) + 3 * np.arange(T // 3)
        for rows, columns, factor in (
            (sums, turning + 3 * np.arange(n), 1.0), (sums[1:], turning + 3 * np.arange(n - 1), -1.0),
            (sums[1:], low[1:], -0.5 * self.dt), (sums[1:], low[:-1], -0.5 * self.dt),
        ):  # fmt: skip
            A.put(rows, columns[: len(rows)], xyz, xyz, factor)
        alone = 6 * n + 3 * len(at_rest) + given.size + T
        (still_at, D), g = self.fixed, unit / self.mass
        own = alone + np.arange(len(D))
        A.block(own, 3 * still_at, D[:, None, :3] / (g * self.dt**2))
        for beside, factor in ((-1, 1.0), (0, -2.0), (1, 1.0)):
            A.block(own, 3 * (still_at + beside), factor * D[:, None, 3:6] / (g * self.dt**2))
        A.block(own, 3 * (n + still_at), D[:, None, 6:])
        known = np.hstack([self.com / self.dt**2, self._acceleration(self.com), self.moment / self.mass]) / g
        there = np.sum(D * known[still_at], axis=1)
        equal = alone + len(D)
        L = np.zeros(T)
        if self.start is not None:
            L[:3] = self.start[2][: min(T, 3)] / unit
        G, h = (np.zeros((0, 2 * S)), np.zeros(0)) if self.bounds is None else self.bounds
        A.block(np.array([equal]), np.array([shift]), -G[None])
        rows, numbers = equal + len(h) + np.arange(len(times)), self._numbers()[times]
        which, point = np.nonzero(numbers >= 0)
        A.block(rows[which], force[numbers[which, point]], unit * C[which, point][:, None])
        for each in (rows, rows + len(times)):
            A.put(each, excess, [0], [0], -1.0)
        pressed = np.flatnonzero(self._least()[k, i] > 0.0)
        up = np.tile([0.0, 0.0, 1.0], (E, 1)) if self.normals is None else self.normals[k, i]
        loads = equal + len(h) + 2 * len(times) + np.arange(len(pressed))
        A.block(loads, force[pressed], -up[pressed][:, None])
        m = len(h) + 2 * len(times) + len(pressed)
        cone = equal + m + 3 * np.arange(E)
        if self.normals is None:
            for row, column, factor in ((0, 2, self.friction), (1, 0, 1.0), (2, 1, 1.0)):
                A.put(cone + row, force + column, [0], [0], -factor)
        else:
            A.block(cone, force, -self._cones(self.normals[k, i]))

        R, t = self._wanted(k, i, force, shift, T)
        M = A.matrix(equal + m + 3 * E, turning + T)
        cones = [clarabel.ZeroConeT(equal), *[clarabel.NonnegativeConeT(m)] * (m > 0), *[clarabel.SecondOrderConeT(3)] * E]
        least = self._least()[k, i][pressed] / unit
        excesses = np.concatenate([-h, most, np.zeros(len(times)), -least])
        side = np.concatenate([b, np.zeros(3 * len(at_rest)), given.ravel(), L, there, excesses, np.zeros(3 * E)])
        P, g = csc_matrix(triu(R.T @ R)), -(R.T @ t)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads, settings.max_iter = False, 1, 100
        settings.tol_gap_abs = settings.tol_gap_rel = 1e-5
        for careful in (False, True):  # refinement takes half of the time
            settings.iterative_refinement_enable, settings.tol_feas = careful, 1e-7 if careful else 1e-6
            found = clarabel.DefaultSolver(P, g, M, side, cones, settings).solve()
            x, status = np.asarray(found.x), str(found.status)
            if status == "Solved" and np.isfinite(x).all():
                break
        near = status == "AlmostSolved" or (status in ("InsufficientProgress", "MaxIterations") and found.r_prim < STOPPED)
        if not (near or status == "Solved") or not np.isfinite(x).all():
            raise NoSolution(f"the centroid's program of {n} times and {E} forces ended with {status!r}.")
        f = np.zeros((n, self.points.shape[1], 3))
        f[k, i] = unit * x[6 * n : shift].reshape(E, 3)
        plan = CentroidPlan(
            x[: 3 * n].reshape(n, 3), unit * x[3 * n : 6 * n].reshape(n, 3), f, x[shift:over].reshape(S, 2), status,
            float(found.obj_val + 0.5 * t @ t), np.inf, np.zeros(3) if self.start is None else self.start[2],
        )
        return replace(plan, residual=self._residual(plan))

    @property
    def weight(self) -> float:
        """Mass times gravity [N]."""
        return self.mass * float(np.linalg.norm(self.gravity))

    @property
    def stances(self) -> int:
        """How many stances may shift."""
        return 0 if self.stance is None else int(self.stance.max(initial=-1)) + 1

    def _numbers(self) -> Array:
        """Of the force at each point, shape (n, k); -1 in the air, where it is zero."""
        return np.where(self.touches, np.cumsum(self.touches).reshape(self.touches.shape) - 1, -1)

    def _cones(self, normals: Array) -> Array:
        """(mu n, t1, t2) as rows, shape (E, 3, 3): a force f is in its cone where |(t1 . f, t2 . f)| <= mu n . f."""
        different, at = np.unique(normals, axis=0, return_inverse=True)
        axes = np.array([[self.friction * n, *across(n)] for n in different]).reshape(-1, 3, 3)
        return np.asarray(axes[at.ravel()])

    def _limits(self) -> tuple[Array, Array, Array]:
        return self.limits or (np.zeros(0, int), np.zeros((0, *self.points.shape[1:])), np.zeros(0))

    def _least(self) -> Array:
        return np.zeros(self.touches.shape) if self.least is None else self.least

    def _stance(self) -> Array:
        return np.full(self.touches.shape, -1) if self.stance is None else self.stance

    def _places(self, shifts: Array) -> Array:
        """The points with their stances shifted."""
        out, s = self.points.copy(), self._stance()
        if self.stances:
            out[..., :2] += np.where((s >= 0)[..., None], shifts[s], 0.0)
        return out

    def _acceleration(self, com: Array) -> Array:
        before, at, after = _around(len(com))
        return np.asarray((com[before] - 2.0 * com[at] + com[after]) / self.dt**2)

    def _wanted(self, k: Array, i: Array, force: Array, shift: int, T: int) -> tuple[Any, Array]:
        """(R, t) of the cost |R x - t|^2 / 2."""
        n, E, S, w, dt = len(self.com), len(k), self.stances, self.costs, self.dt
        share = np.sqrt(60.0 * dt)  # a sum over times, as an integral over time
        R, xyz = _Rows(), np.arange(3)
        c = 3 * np.arange(n)
        near = share / np.array([w.com, w.com, w.com if w.height is None else w.height])
        for axis in range(3):
            R.put(c + axis, c + axis, xyz[:1], xyz[:1], near[axis])
        R.put(3 * n + c, 3 * n + c, xyz, xyz, share / w.momentum)
        t = [(near * self.com).ravel(), share * self.moment.ravel() / (self.weight * w.momentum)]
        row = 6 * n
        for at, factor in zip(_around(n), (1.0, -2.0, 1.0), strict=True):
            R.put(row + c, 3 * at, xyz, xyz, share * factor / (dt**2 * w.acceleration))
        t.append(share * self._acceleration(self.com).ravel() / w.acceleration)
        row += 3 * n
        for step, factor in enumerate((-1.0, 3.0, -3.0, 1.0)):
            R.put(row + c[: n - 3], c[: n - 3] + 3 * step, xyz, xyz, share * factor / (dt**3 * w.jerk))
        row += 3 * max(n - 3, 0)
        R.put(row + 3 * np.arange(E), force, xyz, xyz, share / w.force)
        row += 3 * E
        number = self._numbers()
        at, point = np.nonzero((number[:-1] >= 0) | (number[1:] >= 0))
        rows = row + 3 * np.arange(len(at))
        for which, sign in ((number[at, point], -1.0), (number[at + 1, point], 1.0)):
            there = which >= 0
            R.put(rows[there], force[which[there]], xyz, xyz, sign * share / (dt * w.force_rate))
        row += 3 * len(at)
        if S:
            stands = np.zeros((n, S + 1), bool)
            stands[k, self._stance()[k, i]] = True
            count = stands[:, :S].sum(axis=0)
            R.put(row + 2 * np.arange(S), shift + 2 * np.arange(S), xyz[:2], xyz[:2], np.sqrt(4.0 * dt * count) / w.shift)
            row += 2 * S
        excesses = len(self._limits()[0])
        R.put(row + np.arange(excesses), shift + 2 * S + np.arange(excesses), [0], [0], share / w.excess)
        row, turning = row + excesses, shift + 2 * S + excesses
        R.put(row + 3 * np.arange(T // 3), turning + 3 * np.arange(T // 3), xyz, xyz, share / w.turning)
        out = np.zeros(row + T)
        known = np.concatenate(t)
        out[: len(known)] = known
        return R.matrix(row + T, turning + T), out

    def _residual(self, plan: CentroidPlan) -> float:
        places = self._places(plan.shifts)
        force = plan.forces.sum(axis=1) - self.mass * (self._acceleration(plan.com) - self.gravity)
        moment = np.cross(places - plan.com[:, None], plan.forces).sum(axis=1) - plan.moment
        return float(max(np.abs(force).max() / self.weight, np.abs(moment).max() / (0.3 * self.weight)))


def inner_corners(corners: Array, share: float = INNER) -> Array:
    """Corners of soles, nearer to their middle by a quarter, or to a share, shape (..., k, 2) or (..., k, 3) [m]."""
    middle = corners.mean(axis=-2, keepdims=True)
    return np.asarray(middle + share * (corners - middle))


class _Rows:
    """A sparse matrix, put together from blocks."""

    def __init__(self) -> None:
        self.parts: list[tuple[Array, Array, Array]] = []

    def put(self, rows: Array, columns: Array, r: Any, c: Any, value: Any) -> None:
        """The same diagonal block at places (row, column): entries (r, c) of it have a value."""
        i, j = np.add.outer(rows, r).ravel(), np.add.outer(columns, c).ravel()
        self.parts.append((i, j, np.broadcast_to(np.asarray(value, float).reshape(-1, 1), (len(rows), len(r))).ravel()))

    def block(self, rows: Array, columns: Array, values: Array) -> None:
        """A block of its own, values (places, r, c), at each place."""
        _, r, c = values.shape
        i = np.broadcast_to(rows[:, None, None] + np.arange(r)[:, None], values.shape)
        j = np.broadcast_to(columns[:, None, None] + np.arange(c), values.shape)
        self.parts.append((i.ravel(), j.ravel(), values.ravel()))

    def matrix(self, rows: int, columns: int) -> Any:
        from scipy.sparse import csc_matrix

        i, j, x = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        return csc_matrix((x, (i, j)), shape=(rows, columns))


def _around(n: int) -> tuple[Array, Array, Array]:
    """The three times of the second difference at each time; those of its neighbour at the first and the last."""
    at = np.clip(np.arange(n), 1, max(n - 2, 1))
    return at - 1, at, at + 1
