"""Motions of G1 that `rbd.simulate` makes under a small whole-body controller: a squat, a crouch, four steps, a fall.

The controller is a script for tests: it knows the robot, the ground and the time exactly. At each step it solves a program in
accelerations and forces at the corners of the soles that stand,

    min  sum of weights |A a - b|^2     of the centre of mass, the trunk, the foot that swings, angular momentum, posture
    s.t. base rows of M a + h = J^T f,  soles that stand do not accelerate,  f in friction pyramids,  |tau| within limits,

and applies tau = (M a + h - J^T f) of the motors.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

import rbd.solvers.qp  # first: it chooses ProxSuite's build, whose bits do not depend on the place of memory

import proxsuite  # isort: skip
from scipy.linalg import solve_banded

import rbd
from rbd.arrays import Array
from rbd.simulation import TimeStepping

GRAVITY = 9.81
RATE = 300
"""Steps a second."""
FRICTION = 0.7
SHARE = 0.9
"""Of the limits of torque, and of the soles and the friction, that the controller uses."""


def quintic(u: float) -> tuple[float, float, float]:
    """From 0 to 1 for u from 0 to 1, at rest at both ends, with both derivatives."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * (1.0 - u)) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)


@dataclass(frozen=True)
class Swing:
    """A foot goes from one place to another, from one time to another."""

    begin: float
    end: float
    foot: int
    start: Array
    goal: Array
    height: float = 0.04

    def at(self, t: float) -> Array:
        """Position, velocity and acceleration, shape (3, 3); after its end it sinks until it touches."""
        span = self.end - self.begin
        u = (t - self.begin) / span
        there = np.array(quintic(u / 0.9)) / [1.0, 0.9 * span, (0.9 * span) ** 2]
        up = np.array(quintic(2.0 * u if u < 0.5 else 2.0 - 2.0 * u)) * [1.0, 2.0 / span, 4.0 / span**2]
        up[1] *= 1.0 if u < 0.5 else -1.0
        out = np.outer(there, self.goal - self.start) + np.outer(up, [0.0, 0.0, self.height])
        out[0] += self.start
        if t > self.end:
            out[:2, 2] -= [0.03 * (t - self.end), 0.03]
        return out


@dataclass(frozen=True)
class Plan:
    """What the centre of mass and the feet are to do; tables over time at steps of 1 ms."""

    duration: float
    com: Array
    swings: Sequence[Swing] = ()

    def com_at(self, t: float) -> Array:
        """Position, velocity and acceleration, shape (3, 3)."""
        x = min(t * 1000.0, len(self.com) - 1.001)
        i = int(x)
        return (i + 1.0 - x) * self.com[i] + (x - i) * self.com[i + 1]

    def swing(self, t: float, low: Sequence[float]) -> Swing | None:
        """The one under way; it ends when the foot touches, and not before."""
        begun = [s for s in self.swings if s.begin <= t + 1e-9]
        if not begun:
            return None
        last = begun[-1]
        flying = t < last.begin + 0.6 * (last.end - last.begin) or (low[last.foot] > 2e-5 and t < last.end + 0.1)
        return last if flying else None


def up_and_down(start: rbd.State, depth: float, times: Sequence[float], *, back: bool) -> Plan:
    """A crouch by a depth [m], held, and up again: times of its beginning, its low end, its way back and its end [s]."""
    t = np.arange(0.0, times[-1] + 1e-9, 1e-3)
    com = np.zeros((len(t), 3, 3))
    com[:, 0] = start.com
    ways = [(times[0], times[1], -depth)] + ([(times[2], times[3], depth)] if back else [])
    for begin, end, way in ways:
        span = end - begin
        com[:, :, 2] += [way * np.array(quintic((x - begin) / span)) / [1.0, span, span**2] for x in t]
    return Plan(float(t[-1]), com)


def steps(start: rbd.State, soles: Sequence[rbd.SurfaceContact], count: int = 4) -> Plan:
    """Steps of 0.15 m, the last beside the other foot; the centre of mass as an inverted pendulum over the feet that stand."""
    length, single, double, begin, rest = 0.15, 0.6, 0.25, 0.9, 0.7
    first = [sole.rows(start).patch.point.copy() for sole in soles]
    at, swings, stops = [p.copy() for p in first], [], [(0.0, start.com[:2]), (begin - double - 0.1, start.com[:2])]
    t, foot = begin, 1
    for k in range(count):
        stand = at[1 - foot]
        goal = at[foot].copy()
        goal[0] = stand[0] + (length if k < count - 1 else 0.0)
        swings.append(Swing(t, t + single, foot, at[foot], goal))
        inside = stand[:2] - [0.0, 0.01 * np.sign(stand[1])]
        stops += [(t, inside), (t + single, inside)]
        at[foot], foot, t = goal, 1 - foot, t + single + double
    end = 0.5 * (at[0] + at[1])[:2] + start.com[:2] - 0.5 * (first[0] + first[1])[:2]
    stops += [(t, end), (t + rest, end)]
    times = np.arange(0.0, t + rest + 1e-9, 1e-3)
    pressure = np.stack([np.interp(times, [x for x, _ in stops], [y[i] for _, y in stops]) for i in (0, 1)], axis=1)
    w2 = GRAVITY / start.com[2]
    band = np.zeros((3, len(times)))  # x - x'' / w2 = pressure, at rest at both ends
    band[1], band[0, 2:], band[2, :-2] = 1.0 + 2e6 / w2, -1e6 / w2, -1e6 / w2
    band[1, [0, -1]] = 1.0
    x = solve_banded((1, 1), band, pressure)
    com = np.zeros((len(times), 3, 3))
    com[:, 0], com[:, 0, :2] = start.com, x
    com[:, 1, :2], com[:, 2, :2] = np.gradient(x, 1e-3, axis=0), (x - pressure) * w2
    return Plan(float(times[-1]), com, tuple(swings))


@dataclass
class WholeBody:
    """Torques that make a robot follow a plan."""

    start: rbd.State
    soles: Sequence[rbd.SurfaceContact]
    plan: Plan
    programs: dict[tuple[int, ...], proxsuite.proxqp.dense.QP] = field(default_factory=dict)
    failed: int = 0

    def __call__(self, state: rbd.State, t: float) -> Array:
        """Torques (nu,) [N m]."""
        robot, nv = state.robot, state.robot.nv
        feet = [state.moving(sole.frame, sole.placement, pin.LOCAL_WORLD_ALIGNED) for sole in self.soles]
        low = [float((X.act(p))[2]) for (X, *_), sole in zip(feet, self.soles, strict=True) for p in sole.corners]
        swing = self.plan.swing(t, [min(low[:4]), min(low[4:])])
        stand = tuple(f for f in (0, 1) if swing is None or f != swing.foot)
        H, g = np.diag(np.full(nv, 1e-4)), np.zeros(nv)
        for A, b, weight in self._tasks(state, feet, swing, t):
            H += weight * A.T @ A
            g -= weight * A.T @ b
        unit = robot.mass * GRAVITY
        push = np.concatenate([self._rays(f).T @ feet[f][1] for f in stand]) * unit
        m, limit = len(push), SHARE * robot.effort_limit
        hold = np.concatenate([feet[f][1] for f in stand])
        stop = np.concatenate([-feet[f][3] - 50.0 * feet[f][2] for f in stand])
        base = np.concatenate([state.M[:6], -push[:, :6].T], axis=1) / unit
        equal = np.concatenate([base, np.concatenate([hold, np.zeros((len(hold), m))], axis=1)])
        motors = np.concatenate([state.M[6:], -push[:, 6:].T], axis=1) / limit[:, None]
        cost = np.zeros((nv + m, nv + m))
        cost[:nv, :nv], cost[nv:, nv:] = H, 1e-2 * np.eye(m)
        x = self._solved(
            stand, cost, np.concatenate([g, np.zeros(m)]), equal, np.concatenate([-state.h[:6] / unit, stop]),
            motors, -1.0 - state.h[6:] / limit, 1.0 - state.h[6:] / limit,
        )  # fmt: skip
        tau = (state.M @ x[:nv] + state.h - push.T @ np.maximum(x[nv:], 0.0))[6:]
        return np.clip(tau, -limit, limit)

    def _tasks(self, state: rbd.State, feet: list, swing: Swing | None, t: float) -> list[tuple[Array, Array, float]]:
        """(A, b, weight): A a = b is wanted."""
        nv, v, mass = state.robot.nv, state.v, state.robot.mass
        R = pin.Quaternion(state.q[3:7]).toRotationMatrix()
        lever = pin.skew(state.com - state.q[:3])
        # The base rows of M a + h are the force, and the moment about the base, of what acts on the whole robot but gravity.
        linear = R @ state.M[:3]
        angular = R @ state.M[3:6] - lever @ linear
        wanted = self.plan.com_at(t)
        goal = wanted[2] + 60.0 * (wanted[0] - state.com) + 15.5 * (wanted[1] - linear @ v / mass)
        force = R @ state.h[:3]
        trunk = np.eye(3, nv, 3)
        joints = np.eye(nv - 6, nv, 6)
        away = pin.difference(state.robot.model, state.q, self.start.q)[6:]
        easy = np.full(nv - 6, 0.5)
        easy[:12] = 0.02  # the legs do the other tasks
        scale = np.sqrt(easy)
        out = [
            (linear / mass, goal - force / mass + [0.0, 0.0, GRAVITY], 100.0),
            (angular, -3.0 * angular @ v - (R @ state.h[3:6] - lever @ force), 0.02),
            (trunk, -80.0 * pin.log3(R) - 18.0 * v[3:6], 10.0),
            (scale[:, None] * joints, scale * (40.0 * away - 12.6 * v[6:]), 1.0),
        ]
        if swing is not None:
            X, J, velocity, bias = feet[swing.foot]
            place, rate, more = swing.at(t)
            move = more + 400.0 * (place - X.translation) + 40.0 * (rate - velocity[:3])
            turn = -400.0 * X.rotation @ pin.log3(X.rotation) - 40.0 * velocity[3:]
            out += [(J[:3], move - bias[:3], 100.0), (J[3:], turn - bias[3:], 20.0)]
        return out

    def _rays(self, foot: int) -> Array:
        """Wrenches of the edges of friction pyramids inside the cones, at corners within the sole, shape (6, 4 corners)."""
        mu = SHARE * FRICTION / np.sqrt(2.0)
        edges = np.array([[mu, mu, 1.0], [mu, -mu, 1.0], [-mu, mu, 1.0], [-mu, -mu, 1.0]]).T
        return np.concatenate([np.concatenate([edges, pin.skew(SHARE * p) @ edges]) for p in self.soles[foot].corners], axis=1)

    def _solved(self, stand: tuple[int, ...], *given: Array) -> Array:
        """Solution of the program, starting from the one of the step before with the same feet."""
        H, g, equal, right, motors, low, high = given
        free = len(g) - 16 * len(stand)
        program = self.programs.get(stand)
        if program is None:
            program = self.programs[stand] = proxsuite.proxqp.dense.QP(len(g), len(right), len(low), True)
            for name, value in {"eps_abs": 1e-8, "eps_rel": 0.0, "max_iter": 1000}.items():
                setattr(program.settings, name, value)
            program.settings.initial_guess = proxsuite.proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            least = np.concatenate([np.full(free, -1e20), np.zeros(len(g) - free)])
            program.init(H, g, equal, right, motors, low, high, least, np.full(len(g), 1e20))
        else:
            program.update(H, g, equal, right, motors, low, high)
        program.solve()
        self.failed += program.results.info.status != proxsuite.proxqp.PROXQP_SOLVED
        return np.array(program.results.x)


def _simulated(plan: Plan, robot: rbd.Robot, start: rbd.State, soles: Sequence[rbd.SurfaceContact]) -> rbd.Trajectory:
    controller = WholeBody(start, soles, plan)
    hold = rbd.control.ZeroOrderHold(controller, period=1.0 / RATE)
    out = rbd.simulate(
        start, soles, duration=plan.duration, step=1.0 / RATE, controller=hold, integrator=TimeStepping(), progress=False
    )
    if controller.failed:
        raise AssertionError(f"{controller.failed} programs of the controller were not solved.")
    return out


def squat(robot: rbd.Robot) -> rbd.Trajectory:
    """Down by 6 cm and up again, in 2 s."""
    start, soles = robot.standing(), robot.soles(FRICTION)
    return _simulated(up_and_down(start, 0.06, [0.1, 0.9, 1.0, 1.8, 2.0], back=True), robot, start, soles)


def crouch(robot: rbd.Robot) -> rbd.Trajectory:
    """Down by 12 cm, and stay there, in 1.2 s."""
    start, soles = robot.standing(), robot.soles(FRICTION)
    return _simulated(up_and_down(start, 0.12, [0.1, 0.9, 1.2], back=False), robot, start, soles)


def four_steps(robot: rbd.Robot) -> rbd.Trajectory:
    """Four steps of 0.15 m, in 4.75 s."""
    start, soles = robot.standing(), robot.soles(FRICTION)
    return _simulated(steps(start, soles), robot, start, soles)


def fall(robot: rbd.Robot) -> rbd.Trajectory:
    """Over the front edges of its soles, the last 0.5 s after a push at the pelvis; nothing else touches the floor yet."""
    start, soles = robot.standing(), robot.soles(FRICTION)
    hold = rbd.control.HoldPosture(start, soles, frequency=12.0)
    limit = SHARE * robot.effort_limit

    def stiff(state: rbd.State, t: float) -> Array:
        return np.clip(hold(state, t), -limit, limit)

    push = rbd.control.Push("pelvis", (70.0, 0.0, 0.0), start=0.1, duration=0.3)
    with warnings.catch_warnings():  # 0.12 % of it, as the push begins
        warnings.filterwarnings("ignore", "the steps of g1 lose energy")
        out = rbd.simulate(
            start, soles, duration=1.1, step=1.0 / RATE, controller=rbd.control.ZeroOrderHold(stiff, period=1.0 / RATE),
            external=push, integrator=TimeStepping(), progress=False,
        )  # fmt: skip
    return out[round(0.6 * RATE) :]
