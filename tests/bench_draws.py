"""Random states and torques of a robot on two soles: which stick, and which slip or open under a law."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin
from bench_timing import DRAWS

import rbd
from rbd.constraints.contact import SurfaceContact
from rbd.errors import RbdWarning

Array = np.ndarray
MANY = 10_000
FRICTION = 0.7
STILL = 1e-6
"""A sole whose acceleration is below this sticks [m/s2, rad/s2]."""
Draw = tuple[Array, Array, Array]
"""q, v and tau."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Postures with noise, soles wherever they then are; velocities that leave the soles at rest; torques with noise.

    Attributes:
        robot: Whose.
        seed: Of all draws.
    """

    robot: rbd.Robot
    seed: int = 7
    kept: dict[tuple[str, int], list[Draw]] = field(default_factory=dict, repr=False)

    @cached_property
    def held(self) -> list[SurfaceContact]:
        """Bilateral soles."""
        return self.robot.soles(friction=None, on=None)

    @cached_property
    def frictional(self) -> list[SurfaceContact]:
        """Soles with friction, eight points in all."""
        return self.robot.soles(friction=FRICTION, on=None)

    @cached_property
    def rounded(self) -> list[SurfaceContact]:
        """The same with 32 points each, on a curve inside the sole's edge, all of them vertices: 64 points in all."""
        angle = 2.0 * np.pi * (np.arange(32) + 0.5) / 32
        round_ = np.column_stack([np.sign(f) * np.sqrt(np.abs(f)) for f in (np.cos(angle), np.sin(angle))])
        out = []
        for sole in self.frictional:
            corners = np.zeros((32, 3))
            corners[:, :2] = round_ * np.abs(sole.corners[:, :2]).max(axis=0)
            out.append(
                SurfaceContact(sole.name, sole.frame, corners=corners, placement=sole.placement, friction=FRICTION, on=None)
            )
        return out

    @cached_property
    def hold(self) -> Array:
        """Torques that hold the standing posture."""
        return rbd.hold(self.robot.standing(), self.robot.feet()).tau

    def random(self, rng: np.random.Generator, noise: float) -> Draw:
        """One state with torques within their limits, `noise` [N m] off those that hold it."""
        robot, limit = self.robot, self.robot.effort_limit
        q = pin.integrate(robot.model, robot.standing().q, 0.02 * rng.normal(size=robot.nv))
        q = np.clip(q, *robot.joints.limits)  # a warning of joints beyond their limits takes as long as a `constraintDynamics`
        v = self.resting(q, 0.1 * rng.normal(size=robot.nv))
        return q, v, np.clip(self.hold + noise * rng.normal(size=robot.nu), -limit, limit)

    def resting(self, q: Array, v: Array) -> Array:
        """V with the soles' motion taken out: where a sole moves, constraintDynamics' drift is another one."""
        model, data = self.robot.model, self._data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = np.vstack([pin.getFrameJacobian(model, data, model.getFrameId(sole.frame), pin.LOCAL) for sole in self.held])
        for _ in range(2):  # the second takes out the rounding of the first
            v = v - J.T @ np.linalg.solve(J @ J.T, J @ v)
        return np.asarray(v)

    @cached_property
    def _data(self) -> pin.Data:
        return self.robot.model.createData()

    def moves(self, q: Array, v: Array, a: Array) -> bool:
        """Whether a sole slips or opens at this acceleration, by forward kinematics."""
        model, data = self.robot.model, self._data
        pin.forwardKinematics(model, data, q, v, a)
        for sole in self.held:
            c = pin.getFrameClassicalAcceleration(model, data, model.getFrameId(sole.frame), pin.LOCAL)
            if np.abs(c.vector).max() > STILL:
                return True
        return False

    def sticking(self, n: int = DRAWS) -> list[Draw]:
        """Draws at which the soles stick, the corners of all contacts within their cones."""
        return self._drawn("sticking", n, 1.0, "coulomb", slips=False)

    def slipping(self, law: str, n: int = DRAWS) -> list[Draw]:
        """Draws at which a sole slips or opens under a law."""
        return self._drawn(law, n, 30.0, law, slips=True)

    def _drawn(self, kind: str, n: int, noise: float, law: str, *, slips: bool) -> list[Draw]:
        if (kind, n) not in self.kept:
            rng = np.random.default_rng([self.seed, n, len(kind)])
            self.kept[kind, n] = out = []
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RbdWarning)
                while len(out) < n:
                    tried = [self.random(rng, noise) for _ in range(min(n, 1000))]
                    found = self._accelerations(tried, law)
                    fitting = [
                        draw
                        for draw, a in zip(tried, found, strict=True)
                        if np.isfinite(a).all() and self.moves(*draw[:2], a) == slips
                    ]
                    out += fitting[: n - len(out)]
        return self.kept[kind, n]

    def _accelerations(self, draws: Sequence[Draw], law: str) -> Array:
        """Accelerations of draws on frictional soles, shape (n, nv); NaN where there is none."""
        if hasattr(rbd, "solve_many"):
            return rbd.solve_many(self.robot, *stacked(draws), self.frictional, law=law).a
        out = np.full((len(draws), self.robot.nv), np.nan)
        for row, (q, v, tau) in zip(out, draws, strict=True):
            found = rbd.solve(rbd.State(self.robot, q, v), tau, self.frictional, law=law, check=False)
            if found.status == "solved":
                row[:] = found.a
        return out

    def wanted(self, n: int = DRAWS) -> tuple[list[Draw], list[Draw]]:
        """(q, v, a) of motions on both soles where least effort takes no point's friction to its limit, and where it does."""
        rng = np.random.default_rng(self.seed)
        inside: list[Draw] = []
        at_limit: list[Draw] = []
        while min(len(inside), len(at_limit)) < n:
            q, v, _ = self.random(rng, 0.0)
            state = rbd.State(self.robot, q, v)
            free = state.M @ (0.5 * rng.normal(size=self.robot.nv)) + state.h  # the nearest that the soles allow to this
            a = rbd.solve(state, np.zeros(self.robot.nu), self.held, external=free).a
            try:
                found = rbd.inverse_dynamics(state, a, self.frictional)
            except rbd.CannotMove:
                continue
            least = min(float(np.nanmin(f, initial=1.0)) for f in found.margins.corner_friction.values())
            (at_limit if least <= found.margin + 1e-6 else inside).append((q, v, a))
        return inside[:n], at_limit[:n]


def stacked(draws: Sequence[Draw]) -> Draw:
    """Q (n, nq), v (n, nv) and tau (n, nu) of all draws."""
    q, v, tau = (np.array(each) for each in zip(*draws, strict=True))
    return q, v, tau
