"""The equations of an answer, written a second time: from `docs/reference/theory.md`, without the code that computed it.

Two views. `of_arrays` judges a least-constraint problem given as arrays. `of_robot` judges accelerations and world forces on a
Pinocchio model: the equation of motion by `rnea` with the forces on the bodies (no M, no Jacobian of the package), the motion
of each contact point by forward kinematics, the rate of momentum about the centre of mass.

Every row, and every point, is measured against its own terms, so that a milligram counts as much as a kilogram:

    equation of motion, row i    sum_j |M_ij a_j| + |rhs_i| + sum_r |J_ri f_r|
    acceleration of a row        sum_j |J_rj a_j| + |bias_r| + |feedback_r|;       of a point: the largest of its rows
    force of a point             |f|, or what would give the point the acceleration above, if that is more
    momentum                     the terms of each of the six components

with four floors. A row whose terms vanish is measured against `FREE` of what motors, weight and each constraint force alone
would make it do; an equation of motion against `ROUNDING` of sqrt(M_ii) max_j sqrt(M_jj) (|a_j| + |a_free_j|), the size of the
rounding of any factorisation, and of what its joint carries. An acceleration is measured at least against `DIGITS` of
|J| |M^-1| (|M| |a| + |rhs| + |J^T f|), as the last digits of the equations of motion move it: a joint that keeps still while
its robot falls has no terms but those. A contact law is judged by how far the point is from satisfying it, not by a product
of force and acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls

Array = NDArray[np.float64]

FREE = 1e-3
ROUNDING = 1e-6
DIGITS = 1e-8
"""Within 1e-7 of it: five times the rounding of each term [Skeel1980]."""
REST = 1e-6
"""A contact that can slip or break is at rest up to this speed [m/s]."""
LWA = pin.LOCAL_WORLD_ALIGNED


@dataclass
class Certificate:
    """Ratios of what is missed to its own terms, by equation: {equation: (largest ratio, where)}."""

    found: dict[str, tuple[float, str]] = field(default_factory=dict)

    def add(self, equation: str, where: str, missed: float, size: float) -> None:
        """Note a miss of a given size; NaN counts as infinite."""
        ratio = 0.0 if missed == 0.0 else math.inf if not math.isfinite(missed) or size <= 0.0 else missed / size
        if equation not in self.found or ratio > self.found[equation][0]:
            self.found[equation] = ratio, where

    @property
    def worst(self) -> float:
        """The largest ratio."""
        return max((ratio for ratio, _ in self.found.values()), default=0.0)

    def __str__(self) -> str:
        ordered = sorted(self.found.items(), key=lambda each: -each[1][0])
        return ", ".join(f"{equation} {ratio:.1e} ({where})" for equation, (ratio, where) in ordered[:3])


# -- the law of one point -------------------------------------------------------------------------------------------------


def cone_distance(p: Array, mu: float) -> float:
    """Distance of a force (tangent, tangent, normal) to the cone |p_t| <= mu p_n."""
    t, n = math.hypot(p[0], p[1]), float(p[2])
    if t <= mu * n:
        return 0.0
    return math.hypot(t, n) if mu * t <= -n else (t - mu * n) / math.hypot(1.0, mu)


def _nearest_in_cone(p: Array, mu: float) -> Array:
    t, n = math.hypot(p[0], p[1]), float(p[2])
    if t <= mu * n:
        return p
    if mu * t <= -n:
        return np.zeros(3)
    edge = np.array([mu * p[0] / t, mu * p[1] / t, 1.0]) / math.hypot(1.0, mu)
    return float(edge @ p) * edge


def rays_of(mu: float, facets: int) -> Array:
    """Unit rays of the pyramid around the cone, |p_t . e_k| <= mu p_n for e_k at 2 pi k / facets, as columns."""
    if mu == 0.0:
        return np.array([[0.0], [0.0], [1.0]])
    angle = math.pi * (2.0 * np.arange(facets) + 1.0) / facets
    outer = mu / math.cos(math.pi / facets)
    out = np.array([outer * np.cos(angle), outer * np.sin(angle), np.ones(facets)])
    return out / np.linalg.norm(out, axis=0)


def _nearest_in_pyramid(p: Array, mu: float, facets: int) -> Array:
    size = float(np.abs(p).max())
    if size == 0.0:
        return p
    R = rays_of(mu, facets)
    return size * (R @ nnls(R, p / size)[0])


def point_miss(law: str, mu: float, facets: int, p: Array, c: Array, u: Array, force: float, rate: float) -> float:
    """How far a point that pushes and rubs is from its law, as a ratio.

    Args:
        law: "coulomb", "convex" (circular cones), or "convex, 4 facets" (pyramids).
        mu: Friction coefficient.
        facets: Of the pyramid.
        p: Force on the robot, (tangent, tangent, normal).
        c: Acceleration, likewise.
        u: Velocity, likewise.
        force: What p is measured against.
        rate: What c is measured against.
    """
    p_t, p_n, c_n = p[:2], float(p[2]), float(c[2])
    size = float(np.linalg.norm(p)) / force
    if u[2] > REST:  # leaves
        return size
    speed = math.hypot(u[0], u[1])
    if mu == 0.0 or speed > REST:  # the tangential force is decided, and the normal one pushes or the point opens
        along = np.zeros(2) if mu == 0.0 else -mu * p_n * u[:2] / speed
        off = float(np.linalg.norm(p_t - along)) / force
        return max(off, -p_n / force, -c_n / rate, min(abs(p_n) / force, abs(c_n) / rate))
    if law == "coulomb":
        slip = math.hypot(c[0], c[1])
        modes = [
            max(size, -c_n / rate),
            max(float(np.linalg.norm(c)) / rate, cone_distance(p, mu) / force),
        ]
        if slip > 0.0:
            off = float(np.linalg.norm(p_t + mu * p_n * c[:2] / slip))
            modes.append(max(abs(c_n) / rate, off / force, -p_n / force))
        return min(modes)
    moved = p - (force / rate) * c  # p is the nearest force of the set to it exactly where p and c are complementary
    nearest = _nearest_in_pyramid(moved, mu, facets) if "facets" in law else _nearest_in_cone(moved, mu)
    return float(np.linalg.norm(p - nearest)) / force


# -- a problem in arrays --------------------------------------------------------------------------------------------------


def _cross(r: Array) -> Array:
    """The matrix of r x."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


class _Arrays:
    def __init__(self, M: Array, rhs: Array, rows: Sequence[object], a: Array, law: str) -> None:
        self.out, self.law, self.a = Certificate(), law, a
        self.root = np.sqrt(np.diag(M))
        scaled = M / np.outer(self.root, self.root)
        self.inverse = np.linalg.inv(scaled) / np.outer(self.root, self.root)
        self.a_free = np.linalg.solve(scaled, rhs / self.root) / self.root
        self.pushed, self.load = np.zeros((len(rhs), 0)), float(np.abs(rhs).max())
        self.M, self.rhs, self.digits = M, rhs, np.zeros(len(rhs))

    def forces(self, columns: Sequence[Array]) -> None:
        """Generalised forces of the constraints, one column each, shapes (nv, k)."""
        given = np.hstack([self.pushed, *columns])
        self.pushed = self.inverse @ given
        terms = np.abs(self.M) @ np.abs(self.a) + np.abs(self.rhs) + np.abs(given).sum(axis=1)
        self.digits = DIGITS * np.abs(self.inverse) @ terms

    def sizes(self, J: Array, bias: Array) -> tuple[Array, Array]:
        """(own terms, what each force alone would do) of rows' accelerations."""
        alone = np.abs(J) @ np.abs(self.a_free) + np.abs(J @ self.pushed).sum(axis=1)
        return np.abs(J) @ np.abs(self.a) + np.abs(bias), alone + np.abs(bias)

    def push(self, J: Array, p: Array, rate: float) -> float:
        """What a point's force is measured against."""
        mobility = float(np.linalg.norm(J @ self.inverse @ J.T, 2)) if J.size else 0.0
        # On what cannot move, as a link that is welded to the ground, any force is as good as another.
        return max(float(np.linalg.norm(p)), rate / mobility if mobility > 0.0 else self.load)

    def held(self, name: str, J: Array, c: Array, bias: Array, more: Array | float = 0.0) -> None:
        """Rows that hold; `more` are terms that cancel in J and bias themselves."""
        own, free = self.sizes(J, bias)
        own = own + more
        floor = FREE * max(own.max(initial=0.0), free.max(initial=0.0))
        # J is a difference of two bodies' Jacobians where they are tied: its entries are rounded as those are.
        floor = max(floor, DIGITS * float(np.abs(J).max(initial=0.0)) * float(np.abs(self.a).max()))
        floor = max(floor, float((np.abs(J) @ self.digits).max(initial=0.0)))
        for k in range(len(c)):
            self.out.add("holds", f"{name}[{k}]", abs(float(c[k])), max(float(own[k]), floor))

    def point(
        self, name: str, mu: float, facets: int, J: Array, p: Array, c: Array, u: Array, terms: Array, free: Array
    ) -> None:
        """A point of three rows (tangent, tangent, normal)."""
        used = slice(2, 3) if mu == 0.0 else slice(0, 3)
        rate = max(float(terms[used].max()), FREE * float(free[used].max()))
        force = self.push(J[used], p, rate)
        if force == 0.0:
            return
        u = np.array([0.0, 0.0, u[2]]) if mu == 0.0 else u
        self.out.add("point", name, point_miss(self.law, mu, facets, p, c, u, force, max(rate, 1e-300)), 1.0)

    def entry(self, name: str, J: Array, f: float, c: float, u: float, bias: float, lo: float, hi: float) -> None:
        """A row whose force stays between bounds; a stop if they are 0 and infinity."""
        own, free = self.sizes(J[None], np.array([bias]))
        rate = max(float(own[0]), FREE * float(free[0]), float(np.abs(J) @ self.digits))
        force = self.push(J[None], np.array([f]), rate)
        if force == 0.0:
            return
        if math.isinf(hi) and u > REST:
            missed = abs(f - lo)
        elif abs(u) > REST and math.isfinite(lo if u > 0.0 else hi):
            missed = abs(f - (lo if u > 0.0 else hi))
        else:
            missed = abs(f - min(max(f - (force / rate) * c if rate else f, lo), hi))
        self.out.add("bound", name, missed, force)


def of_arrays(
    M: Array, rhs: Array, rows: Sequence[object], a: Array, f: Array, corners: dict[str, Array], law: str
) -> Certificate:
    """The certificate of accelerations and row forces of a problem given as arrays.

    Args:
        M: Inertia, shape (nv, nv).
        rhs: Generalised force without constraints, shape (nv,).
        rows: Objects with name, J, bias, feedback, velocity and cone; cones are told by their class and numbers alone.
        a: Acceleration, shape (nv,).
        f: Row forces, stacked, shape (m,).
        corners: {rows: forces of a patch's corners in its own axes, shape (k, 3)}.
        law: "coulomb", "convex", "convex, n facets" or "bilateral".
    """
    A = _Arrays(M, rhs, rows, a, law)
    if not (np.isfinite(a).all() and np.isfinite(f).all()):
        A.out.add("finite", "a or f", math.nan, 1.0)
        return A.out
    pushed, terms, at = np.zeros(len(rhs)), np.abs(M) @ np.abs(a) + np.abs(rhs), 0
    J = np.concatenate([np.zeros((0, len(rhs))), *[r.J for r in rows]])  # type: ignore[attr-defined]
    A.forces([J.T * f])
    for r in rows:
        part = f[at : at + len(r.bias)]  # type: ignore[attr-defined]
        at += len(part)
        pushed += r.J.T @ part  # type: ignore[attr-defined]
        terms += np.abs(r.J).T @ np.abs(part)  # type: ignore[attr-defined]
        _judge(A, r.name, r.cone, r.J, part, r.bias + r.feedback, r.velocity, corners.get(r.name))  # type: ignore[attr-defined]
    floor = ROUNDING * A.root * float((A.root * (np.abs(a) + np.abs(A.a_free))).max())
    missed = np.abs(M @ a - rhs - pushed)
    for i in range(len(rhs)):
        A.out.add("motion", f"coordinate {i}", float(missed[i]), max(float(terms[i]), float(floor[i])))
    return A.out


def _judge(A: _Arrays, name: str, cone: object, J: Array, f: Array, bias: Array, u: Array, corners: Array | None) -> None:
    kind, c = type(cone).__name__, J @ A.a + bias
    if kind == "Free":
        A.held(name, J, c, bias)
    elif kind == "NonNegative":
        for k in range(len(f)):
            A.entry(f"{name}[{k}]", J[k], float(f[k]), float(c[k]), float(u[k]), float(bias[k]), 0.0, math.inf)
    elif kind == "Bounds":
        for k in range(len(f)):
            lo, hi = float(cone.lo[k]), float(cone.hi[k])  # type: ignore[attr-defined]
            A.entry(f"{name}[{k}]", J[k], float(f[k]), float(c[k]), float(u[k]), float(bias[k]), lo, hi)
    elif kind == "FrictionCone":
        own, free = A.sizes(J, bias)
        A.point(name, cone.mu, cone.facets, J, f, c, u, own, free)  # type: ignore[attr-defined]
    elif kind == "Product":
        at = 0
        for k, one in enumerate(cone.cones):  # type: ignore[attr-defined]
            part = slice(at, at + one.dim)
            at += one.dim
            _judge(A, f"{name}.{k}", one, J[part], f[part], bias[part], u[part], None)
    elif kind in ("WrenchCone", "LineCone"):
        _judge_patch(A, name, cone, J, f, bias, u, corners)
    else:
        raise TypeError(f"no law is written for {kind}")


def _judge_patch(A: _Arrays, name: str, cone: object, J: Array, f: Array, bias: Array, u: Array, corners: Array | None) -> None:
    if type(cone).__name__ == "LineCone":  # turns about the line are in no row
        wide = np.zeros((6, 5))
        wide[[0, 1, 2, 4, 5], range(5)] = 1.0
        f = wide @ f
        J, bias, u = wide @ J, wide @ bias, wide @ u
        arms = np.array([[cone.half_length, 0.0, 0.0], [-cone.half_length, 0.0, 0.0]])  # type: ignore[attr-defined]
    else:
        arms = cone.corners  # type: ignore[attr-defined]
    assert corners is not None and corners.shape == arms.shape
    wrench = np.concatenate([corners.sum(axis=0), np.cross(arms, corners).sum(axis=0)])
    size = np.concatenate([np.abs(corners).sum(axis=0), (np.abs(arms)[:, [1, 2, 0]] * np.abs(corners)[:, [2, 0, 1]]
                           + np.abs(arms)[:, [2, 0, 1]] * np.abs(corners)[:, [1, 2, 0]]).sum(axis=0)])  # fmt: skip
    if type(cone).__name__ == "LineCone":
        wrench[3] = f[3]
    for k in range(6):
        floor = 1e-3 * float(size[3 * (k // 3) : 3 * (k // 3) + 3].max())
        A.out.add("corners", f"{name}[{k}]", abs(float(wrench[k] - f[k])), max(float(size[k]), floor, abs(float(f[k]))))
    w = u[3:]
    own, free = A.sizes(J, bias)
    for k, (arm, p) in enumerate(zip(arms, corners, strict=True)):
        G = np.hstack([np.eye(3), -_cross(arm)])  # velocity and acceleration of the corner from those of the patch
        inward = np.cross(w, np.cross(w, arm))
        c = G @ (J @ A.a + bias) + inward
        terms, without = (np.abs(G) @ x + np.abs(inward) for x in (own, free))
        A.point(f"{name}[{k}]", cone.mu, cone.facets, G @ J, p, c, G @ u, terms, without)  # type: ignore[attr-defined]


def least_miss(M: Array, rows: Sequence[object], facets: int = 16) -> float:
    """Least largest violation of the rows by any acceleration, over the largest bias, by a linear program (HiGHS).

    Rows that hold must be at rest, points must open or rest: c along every ray of the pyramid *around* the cone is not
    negative, which is stricter than what the circular cone asks. Rows are scaled to unit length in the metric of M; NaN if
    HiGHS fails.
    """
    root = np.sqrt(np.diag(M))
    L = np.linalg.cholesky(M / np.outer(root, root))
    equal, above = [], []
    for r in rows:
        _conditions(r.cone, r.J, r.bias + r.feedback, r.velocity, facets, equal, above)  # type: ignore[attr-defined]
    if not equal and not above:
        return 0.0
    A = np.array([line for line, _ in equal + above])
    b = np.array([value for _, value in equal + above])
    W = np.linalg.solve(L, (A / root).T).T
    length = np.linalg.norm(W, axis=1)
    length[length <= 1e-12 * length.max(initial=0.0)] = max(float(length.max(initial=0.0)), 1.0)
    W, b = W / length[:, None], b / length
    size = float(np.abs(b).max())
    if size == 0.0:
        return 0.0
    e, n, one = len(equal), W.shape[1], np.ones((len(b), 1))
    lines = np.vstack([np.hstack([-W, -one]), np.hstack([W[:e], -one[:e]])])
    values = np.concatenate([b, -b[:e]]) / size
    found = linprog(
        np.r_[np.zeros(n), 1.0], lines, values, bounds=[*[(None, None)] * n, (0.0, None)], method="highs",
        options={"time_limit": 5.0},
    )  # fmt: skip
    return float(found.x[-1]) if found.status == 0 else math.nan


def _conditions(cone: object, J: Array, bias: Array, u: Array, facets: int, equal: list, above: list) -> None:
    kind = type(cone).__name__
    if kind == "Free":
        equal += list(zip(J, bias, strict=True))
    elif kind == "NonNegative":
        above += [(row, b) for row, b, speed in zip(J, bias, u, strict=True) if speed <= REST]
    elif kind == "Product":
        at = 0
        for one in cone.cones:  # type: ignore[attr-defined]
            part = slice(at, at + one.dim)
            at += one.dim
            _conditions(one, J[part], bias[part], u[part], facets, equal, above)
    elif kind == "Bounds":
        for k, (lo, hi) in enumerate(zip(cone.lo, cone.hi, strict=True)):  # type: ignore[attr-defined]
            if math.isinf(hi) and math.isinf(lo):
                equal.append((J[k], bias[k]))
            elif math.isinf(hi) or math.isinf(lo):
                sign = 1.0 if math.isinf(hi) else -1.0
                if sign * u[k] <= REST:
                    above.append((sign * J[k], sign * bias[k]))
    else:
        if kind == "FrictionCone":
            points = [(np.eye(3), np.zeros(3))]
        else:
            if kind == "LineCone":
                wide = np.zeros((6, 5))
                wide[[0, 1, 2, 4, 5], range(5)] = 1.0
                J, bias, u = wide @ J, wide @ bias, wide @ u
                arms = np.array([[cone.half_length, 0.0, 0.0], [-cone.half_length, 0.0, 0.0]])  # type: ignore[attr-defined]
            else:
                arms = cone.corners  # type: ignore[attr-defined]
            points = [(np.hstack([np.eye(3), -_cross(r)]), np.cross(u[3:], np.cross(u[3:], r))) for r in arms]
        for G, inward in points:
            speed = G @ u
            if speed[2] > REST:
                continue
            slides = math.hypot(speed[0], speed[1]) > REST
            R = rays_of(0.0 if slides else cone.mu, facets)  # type: ignore[attr-defined]
            above += list(zip(R.T @ G @ J, R.T @ (G @ bias + inward), strict=True))


# -- a robot --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Touch:
    """Points that push and rub: a point contact, the corners of a sole, the ends of a line.

    Attributes:
        name: Of the contact.
        joint: Joint whose body carries the points.
        points: In the joint's axes, shape (k, 3) [m].
        axes: R_WC, columns tangent, tangent, normal.
        mu: Friction coefficient.
        facets: Of the pyramids.
        pushes: Force at each point, world axes, shape (k, 3) [N].
    """

    name: str
    joint: int
    points: Array
    axes: Array
    mu: float
    facets: int
    pushes: Array


@dataclass(frozen=True)
class Held:
    """A point (3 rows), a line (5) or a patch (6) that holds.

    Attributes:
        name: Of the contact.
        joint: Joint whose body carries it.
        placement: X_JP; x along a line.
        kind: "point", "line" or "sole".
        wrench: On the robot at P's origin, world axes, shape (6,).
    """

    name: str
    joint: int
    placement: pin.SE3
    kind: str
    wrench: Array


@dataclass(frozen=True)
class Loop:
    """Two placements on two bodies kept together.

    Attributes:
        name: Of the closure.
        joint_a: Its first body; 0 is the ground.
        joint_b: Its second.
        X_a: Placement on the first body.
        X_b: Placement on the second.
        kind: "point", "planar", "revolute" or "rigid".
        axis: Of the hinge or the plane, unit, in the axes of the first.
        wrench: As the package tells it: on body b at frame_b's origin, world axes; on body a where b is the ground.
    """

    name: str
    joint_a: int
    joint_b: int
    X_a: pin.SE3
    X_b: pin.SE3
    kind: str
    axis: Array
    wrench: Array


@dataclass(frozen=True)
class Coordinate:
    """A row on one joint coordinate: "lock", "stop" (sign * v'_i >= 0, pushes) or "friction" (within +- limit).

    Attributes:
        name: Of the constraint.
        index: In v.
        kind: See above.
        force: Generalised force of the row.
        sign: Of a stop: +1 at the lower bound, -1 at the upper.
        limit: Of friction.
    """

    name: str
    index: int
    kind: str
    force: float
    sign: float = 1.0
    limit: float = 0.0


class _Body:
    """A model at (q, v, a): fresh data for each quantity."""

    def __init__(self, model: pin.Model, q: Array, v: Array, a: Array) -> None:
        self.model, self.q, self.v, self.a = model, q, v, a
        self.data, self.still = model.createData(), model.createData()
        pin.computeJointJacobians(model, self.data, q)
        pin.forwardKinematics(model, self.data, q, v, a)
        pin.forwardKinematics(model, self.still, q, v, np.zeros(model.nv))

    def point(self, joint: int, at: Array) -> tuple[Array, Array, Array, Array, Array]:
        """(position, J, velocity, acceleration, J_dot v) of a point of a body: (3,), (6, nv), (6,), (6,), (6,), world axes."""
        X = pin.SE3(np.eye(3), at)
        nv = self.model.nv
        if joint == 0:
            return at, np.zeros((6, nv)), np.zeros(6), np.zeros(6), np.zeros(6)
        return (
            self.data.oMi[joint].act(at),
            np.reshape(pin.getFrameJacobian(self.model, self.data, joint, X, LWA), (6, nv)),
            pin.getFrameVelocity(self.model, self.data, joint, X, LWA).vector,
            pin.getFrameClassicalAcceleration(self.model, self.data, joint, X, LWA).vector,
            pin.getFrameClassicalAcceleration(self.model, self.still, joint, X, LWA).vector,
        )

    def rotation(self, joint: int) -> Array:
        return np.array(self.data.oMi[joint].rotation) if joint else np.eye(3)


def of_robot(
    model: pin.Model,
    q: Array,
    v: Array,
    a: Array,
    force: Array,
    things: Sequence[Touch | Held | Loop | Coordinate],
    law: str,
    *,
    laws: bool = True,
    still: bool = False,
) -> Certificate:
    """The certificate of an acceleration and of forces on a robot.

    Of a robot that is held still (`still`) an equation of equilibrium, and a force's place in its cone, are measured against
    `FREE` of the weight that the joint carries at least.

    Args:
        model: Pinocchio's model.
        q: Configuration.
        v: Velocity.
        a: Acceleration.
        force: Generalised force of motors and world, S^T tau + tau_ext, shape (nv,).
        things: What constrains it, with the forces.
        law: As `of_arrays`.
        still: Whether it is held still.
        laws: Whether contact laws are judged too; else only the balance of forces and that forces lie in their cones.
    """
    B = _Body(model, q, v, a)
    M = pin.crba(model, model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    free = model.createData()
    nle = np.array(pin.rnea(model, free, q, v, np.zeros(model.nv)))
    carried = [f.vector for f in free.f]
    A = _Arrays(M, force - nle, (), a, law)
    if not (np.isfinite(a).all() and all(np.isfinite(_numbers(x)).all() for x in things)):
        A.out.add("finite", "a or forces", math.nan, 1.0)
        return A.out
    world = [np.zeros(6) for _ in range(model.njoints)]  # wrench on each body about W's origin
    terms, extra = np.abs(M) @ np.abs(a) + np.abs(nle) + np.abs(force), force.copy()
    outside: list[tuple[Array, Array]] = []  # (where, wrench) of what is not the robot's own

    columns: list[Array] = []
    later: list[Callable[[], None]] = []  # laws are judged when all forces are known

    def put(joint: int, at: Array, J: Array, wrench: Array) -> None:
        nonlocal terms
        columns.append(J.T * wrench)
        world[joint] += np.concatenate([wrench[:3], wrench[3:] + np.cross(at, wrench[:3])])
        terms = terms + np.abs(J).T @ np.abs(wrench)

    for x in things:
        if isinstance(x, Coordinate):
            extra[x.index] += x.force
            terms[x.index] += abs(x.force)
            columns.append(x.force * np.eye(model.nv)[:, [x.index]])
            later.append(partial(_judge_coordinate, A, x, v, laws))
        elif isinstance(x, Touch):
            for k, (at, p) in enumerate(zip(x.points, x.pushes, strict=True)):
                where, J, u, c, bias = B.point(x.joint, at)
                wrench = np.concatenate([p, np.zeros(3)])
                put(x.joint, where, J, wrench)
                outside.append((where, wrench))
                R, k_name = x.axes, f"{x.name}[{k}]"
                seen = R.T @ J[:3], R.T @ p, R.T @ c[:3], R.T @ u[:3], R.T @ bias[:3]
                least = FREE * float(np.linalg.norm(carried[x.joint][:3])) if still else 0.0
                later.append(partial(_judge_point, A, k_name, x.mu, x.facets, *seen, laws, least))
        elif isinstance(x, Held):
            where, J, _, c, bias = B.point(x.joint, x.placement.translation)
            put(x.joint, where, J, x.wrench)
            outside.append((where, x.wrench))
            R = B.rotation(x.joint) @ x.placement.rotation
            later.append(partial(_judge_held, A, B, x, R, J, c, bias, laws))
        else:
            _judge_loop(A, B, x, put, outside, later, laws)
    A.forces(columns)
    for judge in later:
        judge()
    fext = pin.StdVec_Force()
    for joint, wrench in enumerate(world):
        fext.append(B.data.oMi[joint].actInv(pin.Force(wrench)) if joint else pin.Force.Zero())
    missed = np.abs(pin.rnea(model, model.createData(), q, v, a, fext) - extra)
    floor = ROUNDING * A.root * float((A.root * (np.abs(a) + np.abs(A.a_free))).max())
    for joint in range(1, model.njoints):
        through = max(float(np.linalg.norm(carried[joint][:3])), float(np.linalg.norm(carried[joint][3:])))
        for i in range(model.joints[joint].idx_v, model.joints[joint].idx_v + model.joints[joint].nv):
            size = max(float(terms[i]), float(floor[i]), (FREE if still else ROUNDING) * through)
            A.out.add("motion", f"coordinate {i}", float(missed[i]), size)
    if model.joints[1].nv == 6 and all(model.parents[j] != 0 for j in range(2, model.njoints)) and not np.any(force[:6]):
        _judge_momentum(A, model, q, v, a, outside)
    return A.out


def _numbers(x: Touch | Held | Loop | Coordinate) -> Array:
    return np.ravel(x.pushes if isinstance(x, Touch) else x.force if isinstance(x, Coordinate) else x.wrench)


def _judge_point(
    A: _Arrays, name: str, mu: float, facets: int, J: Array, p: Array, c: Array, u: Array, bias: Array, laws: bool, least: float
) -> None:
    own, free = A.sizes(J, bias)
    if laws:
        A.point(name, mu, facets, J, p, c, u, own, free)
    else:
        rate = max(float(own.max()), FREE * float(free.max()))
        A.out.add("cone", name, cone_distance(p, mu), max(least, A.push(J, p, rate)))


def _judge_coordinate(A: _Arrays, x: Coordinate, v: Array, laws: bool) -> None:
    J = np.zeros(len(v))
    J[x.index] = 1.0
    if not laws:
        off = {"lock": 0.0, "stop": max(0.0, -x.sign * x.force), "friction": max(0.0, abs(x.force) - x.limit)}[x.kind]
        A.out.add("cone", x.name, off, abs(x.force))
    elif x.kind == "lock":
        A.held(x.name, J[None], A.a[x.index : x.index + 1], np.zeros(1))
    elif x.kind == "stop":
        i = x.index
        A.entry(x.name, x.sign * J, x.sign * x.force, x.sign * float(A.a[i]), x.sign * float(v[i]), 0.0, 0.0, math.inf)
    else:
        A.entry(x.name, J, x.force, float(A.a[x.index]), float(v[x.index]), 0.0, -x.limit, x.limit)


def _judge_held(A: _Arrays, B: _Body, x: Held, R: Array, J: Array, c: Array, bias: Array, laws: bool) -> None:
    if not laws:
        return
    lin, ang = R.T @ J[:3], R.T @ J[3:]
    A.held(x.name, lin, R.T @ c[:3], R.T @ bias[:3])
    if x.kind == "sole":
        A.held(x.name, ang, R.T @ c[3:], R.T @ bias[3:])
    elif x.kind == "line":  # x cross x'' of the line's direction, from a point a metre along it
        _, J1, _, c1, b1 = B.point(x.joint, x.placement.act(np.array([1.0, 0.0, 0.0])))
        turn = _cross(np.array([1.0, 0.0, 0.0])) @ R.T
        A.held(x.name, (turn @ (J1 - J)[:3])[1:], (turn @ (c1 - c)[:3])[1:], (turn @ (b1 - bias)[:3])[1:])
        slack = float(abs((R.T @ x.wrench[3:])[0]))
        A.out.add("corners", x.name, slack, float(np.linalg.norm(x.wrench)))
    else:
        A.out.add("corners", x.name, float(np.abs(x.wrench[3:]).max()), float(np.linalg.norm(x.wrench)))


def _judge_loop(
    A: _Arrays,
    B: _Body,
    x: Loop,
    put: Callable[[int, Array, Array, Array], None],
    outside: list[tuple[Array, Array]],
    later: list[Callable[[], None]],
    laws: bool,
) -> None:
    """With d = p_b - p_a, seen in the turning axes of a: its second rate is R^T (d'' - 2 w x d' - w' x d + w x (w x d))."""
    pa, Ja, ua, ca, ba = B.point(x.joint_a, x.X_a.translation)
    pb, Jb, ub, cb, bb = B.point(x.joint_b, x.X_b.translation)
    on_b = x.wrench if x.joint_b else -x.wrench
    put(x.joint_b, pb, Jb, on_b)
    J_here = B.point(x.joint_a, x.X_a.translation + B.rotation(x.joint_a).T @ (pb - pa))[1]
    put(x.joint_a, pb, J_here, -on_b)
    if not (x.joint_a and x.joint_b):
        outside.append((pb, on_b if x.joint_b else -on_b))
    if laws:
        R = B.rotation(x.joint_a) @ x.X_a.rotation
        later.append(partial(_judge_closed, A, x, R, (pa, Ja, ua, ca, ba), (pb, Jb, ub, cb, bb)))


def _judge_closed(A: _Arrays, x: Loop, R: Array, a: tuple[Array, ...], b: tuple[Array, ...]) -> None:
    (pa, Ja, ua, ca, ba), (pb, Jb, ub, cb, bb) = a, b
    d, d1, w = pb - pa, ub[:3] - ua[:3], ua[3:]

    def seen(ca: Array, cb: Array) -> Array:
        return R.T @ (cb[:3] - ca[:3] - 2.0 * np.cross(w, d1) - np.cross(ca[3:], d) + np.cross(w, np.cross(w, d)))

    def alone(J: Array, bias: Array) -> float:
        """The largest of the terms that the two bodies put in, before they cancel: each is rounded for itself."""
        return float(max((np.abs(J) @ np.abs(A.a) + np.abs(bias)).max(), FREE * (np.abs(J) @ np.abs(A.a_free)).max()))

    J = R.T @ (Jb[:3] - Ja[:3] + _cross(d) @ Ja[3:])
    c, bias = seen(ca, cb), seen(ba, bb)
    more = max(alone(Ja[:3], ba[:3]), alone(Jb[:3], bb[:3]))
    flat = np.eye(3) - np.outer(x.axis, x.axis)
    if x.kind == "planar":
        A.held(x.name, flat @ J, flat @ c, flat @ bias, more)
        A.out.add("corners", x.name, abs(float(x.axis @ R.T @ x.wrench[:3])), float(np.linalg.norm(x.wrench)))
        return
    A.held(x.name, J, c, bias, more)
    if x.kind == "point":
        return
    # The relative turn: w_r = R^T (w_b - w_a), w_r' = R^T (w_b' - w_a' - w_a x (w_b - w_a)). Frames that stand together.
    r = ub[3:] - ua[3:]
    JR, cR, bR = R.T @ (Jb - Ja)[3:], R.T @ (cb[3:] - ca[3:] - np.cross(w, r)), R.T @ (bb[3:] - ba[3:] - np.cross(w, r))
    keep = flat if x.kind == "revolute" else np.eye(3)
    A.held(f"{x.name} turn", keep @ JR, keep @ cR, keep @ bR, max(alone(Ja[3:], ba[3:]), alone(Jb[3:], bb[3:])))


def _judge_momentum(A: _Arrays, model: pin.Model, q: Array, v: Array, a: Array, outside: Sequence[tuple[Array, Array]]) -> None:
    data = model.createData()
    pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
    rate, com = np.array(data.dhg.vector), np.array(data.com[0])
    total = np.concatenate([pin.computeTotalMass(model) * model.gravity.linear, np.zeros(3)])
    Ag = np.array(pin.computeCentroidalMap(model, model.createData(), q))
    size = np.abs(Ag) @ np.abs(a) + np.abs(rate) + np.abs(total)
    for where, wrench in outside:
        arm = where - com
        part = np.concatenate([wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])])
        total = total + part
        turning = np.abs(wrench[3:]) + np.linalg.norm(arm) * np.linalg.norm(wrench[:3])
        size = size + np.concatenate([np.abs(wrench[:3]), turning])
    # The rounding of each body's share: about the world's origin, where Pinocchio adds them up.
    reach = float(np.linalg.norm(com)) + 1.0
    for k in range(6):
        floor = ROUNDING * float(size[:3].max()) * (1.0 if k < 3 else reach)
        A.out.add("momentum", f"component {k}", abs(float(rate[k] - total[k])), max(float(size[k]), floor))
