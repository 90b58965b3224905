"""Motions of `bench_work`'s scenes by scripts of their own, neither `rbd.simulate` nor MuJoCo: Pinocchio's terms and SciPy.

A motion is smooth between its events (a push that ends, a point that touches, sticks, slips or lifts), and integrated there by
DOP853; events are located on its interpolant. What points at a common velocity do next is Coulomb's law between forces and
accelerations, and at an impact between impulses and velocities: a fixed point of projections onto the friction cones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

Array = np.ndarray
Torques = Callable[[Array, Array], Array]
"""Motor torques (nu,) of the joints' q and v."""
RTOL, ATOL = 1e-12, 1e-13
GRAVITY = 9.81
AIR, STICKS, SLIPS = "air", "sticks", "slips"
_SLOW, _BEGINS = 1e-8, 1e-10
"""A point that becomes slower stops; one that begins to slide is that fast from the start [m/s]."""
_DEEPER, _NEAR = 1e-11, 1e-8
"""A point that is so much deeper than where it lifted touches, and one so near to the floor may go on touching [m]."""


def sliding_crate(
    times: Array, *, length: float, height: float, gyration: float, mu: float, speed: float, pull: float, moment: float
) -> Array:
    """(x, z, angle) of the middle of a crate that slides on its face, and is tipped back by a pull about its rear edge.

    Flat: x'' = -(mu g + pull), until it stops, in closed form. Then about the edge, with th against the direction of motion::

        (k^2 + a^2 + c^2) th'' = pull (a sin th + c cos th) + moment - g (a cos th - c sin th)

    Args:
        times: When, shape (n,) [s].
        length: Half of it, a [m].
        height: Half of it, c [m].
        gyration: k, its radius about the middle [m].
        mu: Coulomb's coefficient, below a / c.
        speed: At the start [m/s].
        pull: Force at the middle, over mass, against the direction of motion [m/s2].
        moment: In addition, over mass [m2/s2].
    """
    a, c, slows = length, height, mu * GRAVITY + pull
    stops = speed / slows
    assert pull < mu * GRAVITY < GRAVITY * a / c and pull * c + moment > GRAVITY * a  # it slides flat, stays, and tips

    def turned(t: float, y: Array) -> list[float]:
        sin, cos = np.sin(y[0]), np.cos(y[0])
        push = pull * (a * sin + c * cos) + moment - GRAVITY * (a * cos - c * sin)
        return [y[1], push / (gyration**2 + a**2 + c**2)]

    pivots = solve_ivp(turned, (stops, times[-1]), [0.0, 0.0], method="DOP853", rtol=RTOL, atol=1e-14, dense_output=True).sol
    flat = np.minimum(times, stops)
    x, th = speed * flat - 0.5 * slows * flat**2, np.array([pivots(t)[0] if t > stops else 0.0 for t in times])
    return np.column_stack([x - a + a * np.cos(th) - c * np.sin(th), a * np.sin(th) + c * np.cos(th), th])


@dataclass(frozen=True)
class Site:
    """A place on a body that touches: a point, or a sole that is held whole."""

    frame: str
    offset: pin.SE3


class Robot:
    """A robot with a floating base: its equations of motion, and those of places on its bodies."""

    def __init__(self, model: pin.Model, sites: Sequence[Site], torques: Torques) -> None:
        self.model = pin.Model(model)
        self.sites = []
        for i, site in enumerate(sites):
            f = self.model.frames[self.model.getFrameId(site.frame)]
            added = pin.Frame(
                f"site {i}", f.parentJoint, self.model.getFrameId(site.frame), f.placement * site.offset, pin.OP_FRAME
            )
            self.sites.append(self.model.addFrame(added))
        self.data, self.torques, self.zero = self.model.createData(), torques, np.zeros(self.model.nv)

    def terms(self, q: Array, v: Array) -> tuple[Array, Array]:
        """(M, S^T tau - h); the places' Jacobians and J_dot v follow from the data."""
        model, data = self.model, self.data
        pin.crba(model, data, q, pin.Convention.WORLD)
        bias = pin.nonLinearEffects(model, data, q, v)
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, self.zero)
        pin.updateFramePlacements(model, data)
        return data.M, np.concatenate([np.zeros(6), self.torques(q[7:], v[6:])]) - bias

    def rows(self, i: int, n: int = 3) -> tuple[Array, Array]:
        """(J, J_dot v) of a place, shapes (n, nv) and (n,), in world axes."""
        at = self.sites[i], pin.LOCAL_WORLD_ALIGNED
        J = pin.getFrameJacobian(self.model, self.data, *at)[:n]
        return J, pin.getFrameClassicalAcceleration(self.model, self.data, *at).vector[:n]

    def rate(self, q: Array, v: Array) -> Array:
        """dq/dt, shape (nq,)."""
        x, y, z, w = q[3:7]
        a, b, c = 0.5 * v[3:6]
        turns = [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c]
        return np.concatenate([pin.Quaternion(q[3:7]).normalized().matrix() @ v[:3], turns, v[6:]])

    def split(self, y: Array) -> tuple[Array, Array]:
        """(q, v) of what is integrated, the quaternion made a unit one."""
        q = y[: self.model.nq].copy()
        q[3:7] /= np.linalg.norm(q[3:7])
        return q, y[self.model.nq :]


def pushed_stance(robot: Robot, q: Array, times: Array, push: Callable[[Array], Array], until: float) -> Array:
    """Q (n, nq) at times of a robot whose places are held whole, from rest; a push(q) (nv,) acts until a time."""

    def motion(pushed: bool) -> Callable[[float, Array], Array]:
        def rates(t: float, y: Array) -> Array:
            q, v = robot.split(y)
            M, force = robot.terms(q, v)
            if pushed:
                force = force + push(robot.data.oMf)
            rows = [robot.rows(i, 6) for i in range(len(robot.sites))]
            J, bias = np.vstack([J for J, _ in rows]), np.concatenate([b for _, b in rows])
            m = len(bias)
            K = np.block([[M, J.T], [J, np.zeros((m, m))]])
            return np.concatenate([robot.rate(q, v), np.linalg.solve(K, np.concatenate([force, -bias]))[: len(M)]])

        return rates

    y, out, begin = np.concatenate([q, np.zeros(robot.model.nv)]), [], 0.0
    for end, pushed in ((until, True), (times[-1], False)):
        inside = times[(times >= begin) & (times <= end)] if pushed else times[times > begin]
        at = np.unique(np.append(inside, end))
        found = solve_ivp(motion(pushed), (begin, end), y, method="DOP853", rtol=RTOL, atol=ATOL, t_eval=at)
        out += [robot.split(column)[0] for t, column in zip(found.t, found.y.T, strict=True) if t in inside]
        y, begin = found.y[:, -1], end
    return np.array(out)


class Dropped:
    """A robot that falls on a floor z = 0 with points: they touch (plastic), stick, slip and lift under Coulomb's law."""

    def __init__(self, robot: Robot, mu: float) -> None:
        self.robot, self.mu, self.modes = robot, mu, [AIR] * len(robot.sites)
        self.towards, self.floors = np.zeros((len(robot.sites), 2)), np.zeros(len(robot.sites))
        self.events: list[tuple[float, int, str]] = []

    def motion(self, q: Array, v: Array, times: Array) -> Array:
        """Q (n, nq) at times."""
        y, t, out = np.concatenate([q, v]), 0.0, []
        while True:
            watched = [self._event(i, kind) for i in range(len(self.modes)) for kind in self._ways_out(i)]
            inside = times[times >= t]
            found = solve_ivp(
                self._rates, (t, times[-1]), y, method="DOP853", rtol=RTOL, atol=ATOL, dense_output=True, max_step=2e-3,
                events=[event for _, _, event in watched],
            )  # fmt: skip
            t = float(found.t[-1])
            out += [self.robot.split(found.sol(at))[0] for at in inside if at < t or found.status == 0]
            if found.status == 0:
                return np.array(out)
            hit = next((i, kind) for (i, kind, _), at in zip(watched, found.t_events, strict=True) if len(at))
            y = self._after(*hit, found.sol(t))
            self.events.append((t, *hit))

    def _ways_out(self, i: int) -> tuple[str, ...]:
        return {AIR: ("touches",), STICKS: ("lifts", "slips"), SLIPS: ("lifts", "stops")}[self.modes[i]]

    def _event(self, i: int, kind: str) -> tuple[int, str, Callable[[float, Array], float]]:
        def value(t: float, y: Array) -> float:
            q, v = self.robot.split(y)
            if kind == "touches":
                pin.framesForwardKinematics(self.robot.model, self.robot.data, q)
                return float(self.robot.data.oMf[self.robot.sites[i]].translation[2] - self.floors[i])
            _, forces = self._acceleration(q, v)
            if kind == "lifts":
                return float(forces[i, 2])
            if kind == "slips":
                return float(self.mu * forces[i, 2] - np.hypot(*forces[i, :2]))
            return float(np.hypot(*(self.robot.rows(i)[0] @ v)[:2])) - _SLOW

        value.terminal, value.direction = True, -1.0  # type: ignore[attr-defined]
        return i, kind, value

    def _rates(self, t: float, y: Array) -> Array:
        q, v = self.robot.split(y)
        return np.concatenate([self.robot.rate(q, v), self._acceleration(q, v)[0]])

    def _acceleration(self, q: Array, v: Array) -> tuple[Array, Array]:
        """(a, forces (k, 3)) with the modes that points have."""
        M, force = self.robot.terms(q, v)
        rows, pushes, bias, shares = [], [], [], []
        for i, mode in enumerate(self.modes):
            J, b = self.robot.rows(i)
            if mode == STICKS:
                rows.append(J), pushes.append(J), bias.append(b), shares.append((i, np.eye(3)))
            elif mode == SLIPS:
                along = (J @ v)[:2] + _BEGINS * self.towards[i]
                w = np.array([*(-self.mu / np.hypot(*along) * along), 1.0])
                rows.append(J[2:]), pushes.append(w[None] @ J), bias.append(b[2:]), shares.append((i, w[None]))
        forces = np.zeros((len(self.modes), 3))
        if not rows:
            return np.linalg.solve(M, force), forces
        J, P, b = np.vstack(rows), np.vstack(pushes), np.concatenate(bias)
        solved = np.linalg.solve(M, np.column_stack([force, P.T]))
        lam = np.linalg.solve(J @ solved[:, 1:], -b - J @ solved[:, 0])
        at = 0
        for i, share in shares:
            forces[i] = lam[at : at + len(share)] @ share
            at += len(share)
        return solved[:, 0] + solved[:, 1:] @ lam, forces

    def _after(self, i: int, kind: str, y: Array) -> Array:
        """Velocities and modes after an event of a point."""
        q, v = self.robot.split(y)
        M, force = self.robot.terms(q, v)
        heights = [self.robot.data.oMf[site].translation[2] for site in self.robot.sites]
        closed = [k for k, mode in enumerate(self.modes) if mode != AIR or heights[k] < _NEAR]
        rows = [self.robot.rows(k) for k in closed]
        self.modes, self.floors = [AIR] * len(self.modes), np.minimum(0.0, heights) - _DEEPER
        J, bias = np.vstack([J for J, _ in rows]), np.concatenate([b for _, b in rows])
        bent = np.linalg.solve(M, J.T)
        if (J @ v)[2::3].min() < -1e-7:
            v = v + bent @ self._coulomb(J @ bent, J @ v, [None] * len(closed)).ravel()
        u = (J @ v).reshape(-1, 3)
        still = (np.abs(u).max(axis=1) < 3.0 * _SLOW).repeat(3)
        v = v - bent[:, still] @ np.linalg.solve((J @ bent)[np.ix_(still, still)], u.ravel()[still])
        u = (J @ v).reshape(-1, 3)
        near = [k for k in range(len(closed)) if u[k, 2] < 1e-7]
        if not near:
            return np.concatenate([q, v])
        at = (3 * np.array(near)[:, None] + np.arange(3)).ravel().astype(int)
        along = [u[k, :2] / np.hypot(*u[k, :2]) if np.hypot(*u[k, :2]) > 2.0 * _SLOW else None for k in near]
        G, c = (J @ bent)[np.ix_(at, at)], (J @ np.linalg.solve(M, force) + bias)[at]
        forces = self._coulomb(G, c, along)
        moved = (G @ forces.ravel() + c).reshape(-1, 3)
        for k, f, a, way in zip(near, forces, moved, along, strict=True):
            if f[2] > 1e-9:
                slides = way is not None or np.hypot(*a[:2]) > 1e-6 or (kind == "slips" and closed[k] == i)
                self.modes[closed[k]] = SLIPS if slides else STICKS
                self.towards[closed[k]] = -f[:2] / np.hypot(*f[:2]) if slides else 0.0
        return np.concatenate([q, v])

    def _coulomb(self, G: Array, c: Array, along: Sequence[Array | None]) -> Array:
        """Forces (k, 3) in their cones with G f + c under Coulomb's law; opposite to the direction of points that slide."""
        f, r = np.zeros(len(c)), 1.0 / np.linalg.eigvalsh(G)[-1]
        for _ in range(200_000):
            before, u = f.copy(), G @ f + c
            for k, way in enumerate(along):
                span = slice(3 * k, 3 * k + 3)
                if way is None:
                    shifted = u[span] + [0.0, 0.0, self.mu * np.hypot(*u[span][:2])]
                    f[span] = _in_cone(f[span] - r * shifted, self.mu)
                else:
                    f[span] = max(0.0, f[span][2] - r * u[span][2]) * np.array([*(-self.mu * way), 1.0])
            if np.abs(f - before).max() <= 1e-15 * np.abs(f).max():
                break
        return f.reshape(-1, 3)


def _in_cone(x: Array, mu: float) -> Array:
    """The nearest point of a friction cone."""
    t = np.hypot(*x[:2])
    if t <= mu * x[2]:
        return x
    if mu * t <= -x[2]:
        return np.zeros(3)
    normal = (mu * t + x[2]) / (1.0 + mu**2)
    return np.array([*(x[:2] * (mu * normal / t)), normal])
