"""`WorldCertificate`: the steps of one world, taken again and checked by Pinocchio and by the residuals of `rbd.solve`.

Nothing of the kernels is used but the states, impulses and arguments of each step. With all terms at q_m = q (+) h/2 v and v_h,
a base's velocity in the world's axes, a = (v+ - v) / h and f = p / h, the step is an answer of a `GaussProblem`:

    M a = S^T tau + tau_ext - h + J^T f,        y = (u + apart + shift) / h  and f under the law

    u = J v+ + h/2 J_dot v         of the points; of those of a sole, J with the sole as it is turned at the end, on the ground
    apart = 1/2 gap / h            of a closed point; of one above its surface, where it is at the arrival, over what is left
    shift                          of points that slide throughout: friction opposes their velocity in the middle

The time s of an arrival follows from q+ = q (+) s v (+) (h - s) v+. Torques of servos and dampers are at the mean velocity.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, check_whole
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import state_at
from rbd.problem.cones import Bounds, Cone, FrictionCone, NonNegative, Product
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import residuals_of
from rbd.problem.rows import Rows
from rbd.worlds import layout as rows
from rbd.worlds.beginning import begun, check_torques
from rbd.worlds.near_kernel import SHARE, SPEED
from rbd.worlds.stepping import Worlds


@dataclass(frozen=True, eq=False, repr=False)
class WorldCertificate(Displayed):
    """How far the steps of one world are from the equations of their scheme, by Pinocchio.

    Attributes:
        world: Its number.
        step: Length of a step [s].
        steps: Numbers of the steps that were checked, from 0, shape (s,).
        equation: Of the equations of motion, scaled as of `rbd.problem.residuals`, shape (s,).
        law: Of the contact law, scaled likewise, shape (s,).
        path: Of q+ = q (+) s v (+) (h - s) v+, over the step's motion or 1e-6 m (rad), shape (s,).
        depth: How deep a point is below its surface at the beginning of the step, shape (s,) [m].
        turning: By how much velocities of points that carry force, on soles as they are turned at the end, differ from
            J v+ + h/2 J_dot v, shape (s,) [m/s].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> worlds = rbd.simulate_many(slides, [face], duration=0.3, step=1e-3, friction=np.array([0.25, 0.5, 1.0]))
        >>> certificate = worlds.certify(1)
        >>> len(certificate.steps), certificate.worst < 1e-8
        (300, True)
    """

    world: int
    step: float
    steps: Array
    equation: Array
    law: Array
    path: Array
    depth: Array
    turning: Array

    @property
    def worst(self) -> float:
        """The largest scaled residual of equations, law and path."""
        return float(max(x.max(initial=0.0) for x in (self.equation, self.law, self.path)))

    def __str__(self) -> str:
        if not len(self.steps):
            return f"world {self.world}: no steps"
        lines = [
            f"world {self.world}: {len(self.steps)} steps of {self.step:g} s checked, largest scaled residual {self.worst:.1e}"
        ]
        for name, x in (("equations of motion", self.equation), ("contact law", self.law), ("path", self.path)):
            lines.append(f"{name}: {x.max():.1e} at t = {self.steps[x.argmax()] * self.step:.6g} s")
        return "\n".join([*lines, f"depth: {self.depth.max():.1e} m"])


def certificate(
    given: Mapping[str, Any], asked: Callable[..., Array] | None, world: int, samples: tuple[Array, Array, Array], every: int
) -> WorldCertificate:
    """That of a world of a run.

    Args:
        given: The arguments of `simulate_many`, `states` as (robot, q, v).
        asked: The controller, if it is a function.
        world: Its number.
        samples: (number of steps, q, v) of its samples, shapes (T,), (T, nq) and (T, nv), NaN after it stopped.
        every: Steps between those that are checked.

    Raises:
        InputError: the steps do not lead to the samples again.
    """
    every = check_whole("every", every, 10**9)
    many = begun(given)
    one, calls = many.only(world), given["every"]
    check = _Check(one)
    at = {int(n): i for i, n in enumerate(samples[0])}
    found = []
    while True:
        i = at.get(one.steps)
        if i is not None and np.isfinite(samples[1][i]).all():
            _check_same(world, one, samples[1][i], samples[2][i])
        if one.steps >= int(samples[0][-1]):
            break
        if asked is not None:
            if one.steps % calls == 0:
                many.advance(one.steps - many.steps)
                tau = as_array("torques of the controller", asked(many.t, many.q, many.v))
                check_torques("torques of the controller", tau, many)
                many.drive(tau=tau)
                one.drive(tau=np.broadcast_to(tau, (many.n, tau.shape[-1]))[world])
        checked = one.steps % every == 0
        start = check.start() if checked else None
        one.advance()
        if one.stopped[0] >= 0:
            break
        if start is not None:
            found.append((one.steps - 1.0, *check.residuals(start)))
    table = np.array(found).reshape(-1, 6).T
    return WorldCertificate(world, one.step, table[0].astype(int), *table[1:])


def _check_same(world: int, one: Worlds, q: Array, v: Array) -> None:
    """Refuse a run that is another than the one recorded."""
    if np.array_equal(one.q[0], q) and np.array_equal(one.v[0], v):
        return
    off = max(np.abs(one.q[0] - q).max(), np.abs(one.v[0] - v).max())
    raise InputError(
        f"world {world}, simulated again, is off by {off:.3g} at t = {one.t:.6g} s; expected the same numbers. Its certificate "
        "would be of another motion. A controller that keeps memory must begin anew: give a new simulate_many a new one."
    )


@dataclass(frozen=True)
class _Start:
    """What there is before a step, a base's velocity in the world's axes, and its rate in the first half of the step."""

    q: Array
    x: Array
    v: Array
    rate: Array
    impulse: Array


@dataclass(frozen=True)
class _Frame:
    """Terms at a state with a base's velocity in the world's axes: Jacobian and its rate's product of all joints, about W."""

    places: tuple[Array, Array]
    J: Array
    bias: Array


class _Part(NamedTuple):
    """Rows with what they must obey: y = J a + ... and forces f in a set, under the law."""

    name: str
    J: Array
    y: Array
    cone: Cone
    f: Array


class _Check:
    """One world, and what its steps are checked with."""

    def __init__(self, one: Worlds) -> None:
        self.one, self.free, self.touching = one, one.packed.tree.free, one.touching
        self.nv, self.k = one.robot.nv, len(one.touching.sites.arm)
        self.table = {name: x[0, :, 0] for name, x in one._given.items()}
        self.robot = self._robot()
        model, sites, turns = self.robot.model, self.touching.sites, one.packed.turns
        self.joints = list(range(1, model.njoints))
        self.moves = np.array([self.robot.joints.carrying(j) for j in self.joints])
        self.body, self.broad, place = np.zeros(self.k, int), np.zeros(self.k, bool), np.zeros((self.k, 3))
        for (b, size, first, many), r in zip(sites.site, sites.place, strict=True):
            if size > 1:
                own = slice(first, first + many)
                self.body[own], self.broad[own], place[own] = b, size == 6, turns[b + 1] @ r
        self.local = np.array([turns[b + 1] @ r for b, r in zip(self.body, sites.arm, strict=True)]).reshape(-1, 3)
        self.place = np.where(self.broad[:, None], place, self.local)

    def _robot(self) -> CheckedModel:
        """The robot with the masses and the gravity of the world."""
        own, first = self.table["checked"].reshape(-1, rows.INERTIA), self.one.packed.inertia.reshape(-1, rows.INERTIA)
        sizes = [np.abs(x[:, [0, 4, 7, 9]]).sum(axis=1) for x in (own, first)]
        robot = copy.deepcopy(self.one.robot)
        for j, (a, b) in enumerate(zip(*sizes, strict=True), start=1):
            I, factor = robot.model.inertias[j], a / b if b > 0.0 else 1.0
            if a != b:
                robot.model.inertias[j] = pin.Inertia(I.mass * factor, I.lever, I.inertia * factor)
        robot.model.gravity.linear = self.table["world"][:3]
        return robot

    def start(self) -> _Start:
        """The world as it is."""
        one, before = self.one, self.one._before[0, :, 0]
        rate = 1.75 * before[: self.nv] - 0.75 * before[self.nv : 2 * self.nv]
        return _Start(one.q[0], one._q[0, :, 0].copy(), one._v[0, :, 0].copy(), rate, one._impulse[0, :, 0].copy())

    def moved(self, q: Array, v: Array, h: float) -> Array:
        """Q (+) h v, a base's velocity in the world's axes."""
        out = pin.integrate(self.robot.model, q, h * v)
        if self.free:
            R = pin.exp3(h * v[3:6]) @ pin.Quaternion(q[3:7]).toRotationMatrix()
            out[:3], out[3:7] = q[:3] + h * v[:3], pin.Quaternion(R).coeffs()
        return out

    def residuals(self, start: _Start) -> tuple[float, float, float, float, float]:
        """(equation, law, path, depth, turning) of the step that led from a state to the present one."""
        one, h, free = self.one, self.one.step, self.free
        end, p = one._v[0, :, 0], one._impulse[0, :, 0]
        q_m, v_h = self.moved(start.q, start.v, 0.5 * h), start.v + 0.5 * h * start.rate
        T = np.eye(self.nv)
        if free:
            T[:3, :3] = T[3:6, 3:6] = pin.Quaternion(q_m[3:7]).toRotationMatrix()
        v_b = T.T @ v_h
        state = state_at(self.robot, q_m, v_b)
        R, x, J_W = state.joint_motion(self.joints)
        turned = np.zeros(self.nv)  # a base's acceleration in axes that turn, less that in axes at rest
        if free:
            turned[:3] = -np.cross(v_b[3:6], v_b[:3])
        M, h_w = T @ state.M @ T.T, T @ (state.h + state.M @ turned)
        J, bias = J_W[:6] @ T.T, J_W[6:] * v_b + J_W[:6] * turned
        frame = _Frame((R, x), J, bias)
        a, f = (end - start.v) / h, p / h
        force = self._acting(start, end, v_h, frame)
        s, path = self._path(start, end)
        points, depth, turning = self._contacts(start, end, v_h, frame, f, s)
        singles, law = self._singles(start, end, f, s), Law("coulomb" if one.coulomb else "convex")
        found: list[tuple[float, float]] = []
        for some in [[each] for each in points] or [[]]:
            given = [*some, *singles]
            problem = GaussProblem(M, force - h_w, [Rows(part.name, part.J, part.y - part.J @ a, part.cone) for part in given])
            forces = np.concatenate([np.zeros(0), *(part.f for part in given)])
            scaled = residuals_of(problem, a, forces, None, law).scaled
            worst = max(scaled[name] for name in ("feasibility", "cone", "complementarity"))
            found.append((worst, scaled["stationarity"]))
        worst, equation = min(found)
        return equation, worst, path, depth, turning

    def _acting(self, start: _Start, end: Array, v_h: Array, frame: _Frame) -> Array:
        """S^T tau + tau_ext: motors, dampers and pushes."""
        h, free, out, t = self.one.step, self.free, np.zeros(self.nv), self.one.t - self.one.step
        for j, row in enumerate(self.table_now("joint").reshape(-1, rows.JOINT)):
            i = 6 * free + j
            angle = start.x[7 * free + j] + 0.5 * h * start.v[i]
            still, d, limit = row[rows.FEED] + row[rows.STIFF] * (row[rows.TARGET] - angle), row[rows.DAMP], row[rows.LIMIT]
            mean = 0.5 * (start.v[i] + end[i])
            wanted = (still - d * start.v[i]) / (1.0 + 0.5 * h * d * row[rows.MOBILE])
            motor = still - d * mean if abs(wanted) < limit else np.copysign(limit, wanted)
            out[i] = motor - row[rows.VISCOUS] * mean
        R, x = frame.places
        for b, push in zip(self.one._push_bodies, self.table["push"].reshape(-1, rows.PUSH), strict=True):
            part = max(0.0, min(push[10], t + h) - max(push[9], t)) / h
            at = x[b] + R[b] @ self.one.packed.turns[b + 1] @ push[:3]
            wrench = part * np.r_[push[3:6], push[6:9] + np.cross(at, push[3:6])]
            out += (frame.J * self.moves[b]).T @ wrench
        return out

    def table_now(self, name: str) -> Array:
        """What acts in the world now: torques change."""
        return self.one._given[name][0, :, 0]

    def _surface(self, points: Array) -> tuple[Array, Array]:
        """(distances, normals) of points from what is below them."""
        ground, height = self.touching.ground, self.table["world"][3]
        gap, normal = np.zeros(len(points)), np.zeros((len(points), 3))
        for c, x in enumerate(points):
            first, last = ground.pieces[c]
            if first == last:
                normal[c], gap[c] = (
                    ground.plane[c, :3],
                    ground.plane[c, :3] @ x - ground.plane[c, 3] - ground.plane[c, 2] * height,
                )
                continue
            best = (np.inf, normal[c])
            for piece in range(first, last):
                face = ground.face[ground.faces[piece] : ground.faces[piece + 1]]
                d = face[:, :3] @ (x - [0.0, 0.0, height]) - face[:, 3]
                best = min(best, (d.max(), face[d.argmax(), :3]), key=lambda each: each[0])
            gap[c], normal[c] = best
        return gap, normal

    def _apart(self, gap: Array, rate: Array, s: float, most: Array | float = np.inf) -> Array:
        """Velocities that points have to be left or given: y_n = u_n + apart."""
        h, near = self.one.step, self.one.step**2 * float(np.linalg.norm(self.table["world"][:3])) + 1e-12
        later = np.minimum(np.maximum(gap + s * rate, 0.0) / max(h - s, 1e-3 * h), most)
        return np.where(gap < near, np.maximum(SHARE * gap / h, -0.1), later)

    def _contacts(
        self, start: _Start, end: Array, v_h: Array, frame: _Frame, force: Array, s: float
    ) -> tuple[list[_Part], float, float]:
        """(the points, friction against the velocity in the middle or at the end; depth; what soles' turning changes)."""
        h, k, half = self.one.step, self.k, 0.5 * self.one.step
        if not k:
            return [], 0.0, 0.0
        R, x = (each[self.body] for each in frame.places)
        P, Q = (x + np.einsum("cij,cj->ci", R, r) for r in (self.local, self.place))
        gap, n = self._surface(P)
        moves = self.moves[self.body]
        of = frame.J * moves[:, None]  # (k, 6, nv)
        a0, alpha = np.split(moves @ frame.bias.T, 2, axis=1)
        (l, w), (e, spin), (b, turn) = (np.split(of @ v, 2, axis=1) for v in (v_h, end, start.v))
        rate_P, rate_Q = (a0 + _cross(alpha, z) + _cross(w, l + _cross(w, z)) for z in (P, Q))
        middle, begin = l + _cross(w, P), b + _cross(turn, P) - half * rate_P
        plain, arm = e + _cross(spin, P) + half * rate_P, P - Q
        felt = arm + half * _cross(w, arm)
        felt = felt - (gap + half * np.vecdot(n, middle))[:, None] * n
        u = np.where(
            self.broad[:, None], e + _cross(spin, Q) + half * rate_Q + _cross(spin + half * alpha, felt), plain
        )  # fmt: skip
        rate = np.vecdot(n, begin)
        now = gap - half * rate - 0.5 * half * half * np.vecdot(n, rate_P - _cross(w, _cross(w, arm)))
        shift, along = (z - np.vecdot(n, z)[:, None] * n for z in (begin - middle, middle))
        slides = np.vecdot(along, along) > 16.0 * np.vecdot(shift, shift) + 1e-12
        slides &= np.vecdot(n, start.impulse[: 3 * k].reshape(k, 3)) > 0.0
        slides &= now < h * h * np.linalg.norm(self.table["world"][:3]) + 1e-12
        if abs(s - half) > 1e-6 * h:
            slides[:] = False
        E = np.array([_axes(z) for z in n])
        J = (E @ (of[:, :3] + np.cross(of[:, 3:], P[:, :, None], axis=1))).reshape(3 * k, self.nv)
        y = u + self._apart(now, rate, s, SPEED + 4.0 * np.abs(rate))[:, None] * n
        f = np.einsum("cij,cj->ci", E, force[: 3 * k].reshape(k, 3)).ravel()
        cone = Product([FrictionCone(float(mu)) for mu in self.table["friction"]])
        live = now < h * (3.0 + 2.0 * np.linalg.norm(middle, axis=1))
        parts = [
            _Part("points", J, np.einsum("cij,cj->ci", E, y + z).ravel() / h, cone, f)
            for z in ((slides[:, None] * shift, 0.0) if slides.any() else (0.0,))
        ]
        depth, turning = (
            -now[live].min(initial=0.0),
            np.abs(u - plain)[force[: 3 * k].reshape(k, 3).any(axis=1)].max(initial=0.0),
        )
        return parts, float(depth), float(turning)

    def _singles(self, start: _Start, end: Array, force: Array, s: float) -> list[_Part]:
        """Joints with dry friction, and the nearer stop of those with stops."""
        found: list[_Part] = []
        h, free, table = self.one.step, self.free, self.table_now("joint").reshape(-1, rows.JOINT)
        for b, size, first, many in self.touching.sites.site:
            for l in range(first, first + many) if size == 1 else ():
                j, i, f = b - free, 5 * free + b, force[3 * self.k + l]
                row, e = table[j], np.eye(self.nv)[i : i + 1]
                if self.touching.sites.single[l] == rows.RUB:
                    bound = np.array([row[rows.RUBS]])
                    found.append(_Part(f"friction {l}", e, end[i : i + 1] / h, Bounds(-bound, bound), np.array([f])))
                    continue
                low, high = start.x[7 * free + j] - row[rows.LOW], row[rows.HIGH] - start.x[7 * free + j]
                sign, gap = (-1.0, high) if low > high else (1.0, low)
                if np.isfinite(gap):
                    y = sign * end[i] + self._apart(np.array([gap]), np.array([sign * start.v[i]]), s)
                    found.append(_Part(f"stop {l}", sign * e, y / h, NonNegative(1), np.array([sign * f])))
        return found

    def _path(self, start: _Start, end: Array) -> tuple[float, float]:
        """(time of the step at which the velocity changes, how far the end is from where it leads)."""
        one, h, free = self.one, self.one.step, self.free
        x, places = one._q[0, :, 0], [*range(3 * free), *range(7 * free, len(start.x))]
        rates = [*range(3 * free), *range(6 * free, self.nv)]
        change = end[rates] - start.v[rates]
        missing = x[places] - start.x[places] - h * end[rates]
        square = change @ change
        s = float(-missing @ change / square) if square > 1e-16 else 0.5 * h
        if abs(s - 0.5 * h) * np.sqrt(square) < 1e-13 + 1e-12 * np.abs(x[places]).max(initial=0.0):
            s = 0.5 * h
        there = self.moved(self.moved(start.q, start.v, s), end, h - s)
        off = pin.difference(self.robot.model, one.q[0], there)
        return s, float(np.abs(off).max() / max(h * np.abs(start.v).max(), h * np.abs(end).max(), 1e-6))


def _cross(a: Array, b: Array) -> Array:
    """A x b, row by row: a third of the cost of np.cross."""
    (x, y, z), (r, s, t) = a.T, b.T
    return np.stack([y * t - z * s, z * r - x * t, x * s - y * r], axis=1)


def _axes(n: Array) -> Array:
    """Two tangents and the normal, by rows."""
    least = np.eye(3)[np.abs(n).argmin()]
    t = least - (n @ least) * n
    t = t / np.linalg.norm(t)
    return np.array([t, np.cross(n, t), n])
