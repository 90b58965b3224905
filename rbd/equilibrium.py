"""Statics: the motor torques and contact forces that hold a robot still, and why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linprog

from rbd.arrays import Array
from rbd.cones import block_diagonal, rays
from rbd.contact_force import ContactForce, contact_force, corner_split
from rbd.dynamics import free_force
from rbd.errors import CannotHold, DuplicateName, NotAtRest
from rbd.external import External
from rbd.least_constraint import Constraint
from rbd.polygon import convex_hull, inside_distance
from rbd.rows import Rows
from rbd.solvers import qp
from rbd.state import State

AT_REST = 1e-9
"""Largest |v| of a robot at rest."""
FORCE_WEIGHT = 1e-4
"""Weight of sum (ray weight / body weight)^2 beside sum (tau / limit)^2: it chooses among forces that cost no torque."""


@dataclass(frozen=True, eq=False)
class Margins:
    """How far a held pose is from each limit; zero is at the limit.

    Attributes:
        torque: 1 - |tau| / limit of each motor, shape (nu,); 1 where the file states no limit.
        friction: {contact: 1 - |f_t| / (mu f_n)} of its net force; contacts without a coefficient are left out.
        centre_of_pressure: {surface: distance of the centre of pressure from the patch's edge [m], positive inside}.
    """

    torque: Array
    friction: dict[str, float]
    centre_of_pressure: dict[str, float]


@dataclass(frozen=True, eq=False)
class Hold:
    """Torques and forces that keep a robot still.

    Attributes:
        state: The pose.
        tau: Motor torques, shape (nu,) [N, N m]; nothing on the base or on passive joints.
        forces: {contact: force (3,) or wrench (6,) at the patch's centre}, on the robot, world axes [N, N m].
        corner_forces: {contact: (k, 3)}, each in the pyramid inscribed in its friction cone [N].
        residual: Largest entry of |h - S^T tau - tau_ext - J^T f|, recomputed [N, N m].
        rows: The contacts' rows, for pictures and tables.
    """

    state: State
    tau: Array
    forces: dict[str, Array]
    corner_forces: dict[str, Array]
    residual: float
    rows: tuple[Rows, ...]

    @cached_property
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return {r.name: contact_force(r.patch, self.forces[r.name]) for r in self.rows if r.patch is not None}

    @cached_property
    def margins(self) -> Margins:
        """How far torques, friction and centres of pressure are from their limits."""
        limit = self.state.robot.effort_limit
        friction, pressure = {}, {}
        for r in self.rows:
            if r.patch is None:
                continue
            c = self.contacts[r.name]
            if c.friction_used is not None:
                friction[r.name] = 1.0 - c.friction_used
            if len(r.patch.corners) > 2 and c.centre_of_pressure is not None:
                at = (c.centre_of_pressure - r.patch.point) @ r.patch.axes
                pressure[r.name] = inside_distance(at[:2], convex_hull(r.patch.corners[:, :2]))
        return Margins(1.0 - np.abs(self.tau) / limit, friction, pressure)

    def __str__(self) -> str:
        used = np.abs(self.tau) / self.state.robot.effort_limit
        worst = int(np.argmax(used))
        lines = [
            f"held: largest torque {100 * used[worst]:.1f} % of its limit ({self.state.robot.actuated_names[worst]}), "
            f"residual {self.residual:.1e} N"
        ]
        return "\n".join(lines + [f"  {name:<16}{c}" for name, c in self.contacts.items()])


def hold(state: State, contacts: Sequence[Constraint], *, external: External = None) -> Hold:
    """Motor torques that keep a robot at rest, and the contact forces that go with them.

    Minimises sum (tau / limit)^2, plus a small weight on the forces, subject to S^T tau + tau_ext + J^T f = h(q, 0),
    |tau| <= limit, and corner forces in the pyramids *inscribed* in the friction cones: what is found holds under the true
    cones too. A motor without a stated limit is weighed against body weight times one metre.

    Args:
        state: The pose; v must be zero.
        contacts: What it stands on; contacts that hold (friction=None) may pull.
        external: Other forces to hold against: generalised (nv,), or `ExternalForce`s.

    Raises:
        NotAtRest: if |v| exceeds 1e-9.
        CannotHold: naming the limit in the way: contacts that only push, friction, or a motor.
    """
    robot = state.robot
    if (speed := float(np.abs(state.v).max(initial=0.0))) > AT_REST:
        raise NotAtRest(f"hold wants a robot at rest, and |v| reaches {speed:.3g}. Use State(robot, q) with v = 0.")
    rows = tuple(c.rows(state) for c in contacts)
    if len({r.name for r in rows}) != len(rows):
        raise DuplicateName(f"two contacts share a name: {[r.name for r in rows]}.")
    statics = _Statics(state, rows, free_force(state, np.zeros(robot.nu), external)[0])
    w = statics.weights()
    f = statics.G @ w
    load = -statics.rhs - statics.J.T @ f  # what is left for the motors
    tau = load[robot.actuated]
    load[robot.actuated] = 0.0
    forces, corners, at, ray = {}, {}, 0, 0
    for r, R in zip(rows, statics.rays, strict=True):
        part, own = f[at : at + len(r)], w[ray : ray + R.G.shape[1]]
        at, ray = at + len(r), ray + R.G.shape[1]
        forces[r.name] = part.copy() if r.resultant is None else r.resultant @ part
        if r.patch is not None:
            corners[r.name] = corner_split(r, part, own, inscribed=True)
    return Hold(state, tau, forces, corners, float(np.abs(load).max()), rows)


class _Statics:
    """The unknown is w, the rays' weights: f = G w, and tau follows. Forces are in units of body weight."""

    def __init__(self, state: State, rows: tuple[Rows, ...], rhs: Array) -> None:
        robot = state.robot
        self.state, self.rows, self.rhs = state, rows, rhs
        self.rays = [rays(r.cone, inscribed=True) for r in rows]
        self.J = np.concatenate([r.J for r in rows]) if rows else np.zeros((0, robot.nv))
        self.G = block_diagonal([R.G for R in self.rays])
        none = np.zeros(0)
        self.lower = np.concatenate([R.lower for R in self.rays] or [none])
        self.upper = np.concatenate([R.upper for R in self.rays] or [none])
        self.unit = robot.mass * float(np.linalg.norm(robot.gravity)) or 1.0
        self.limit = robot.effort_limit
        motors = np.zeros(robot.nv, dtype=bool)
        motors[robot.actuated] = True
        per_ray = self.J.T @ self.G * self.unit
        self.A, self.b = per_ray[~motors], -rhs[~motors]  # no torque on the base, nor on passive joints
        self.T, self.t = per_ray[robot.actuated], -rhs[robot.actuated]  # tau = t - T x
        self.low, self.high = self.lower / self.unit, self.upper / self.unit

    def weights(self) -> Array:
        """The optimal weights, their equilibrium made exact."""
        r = len(self.lower)
        if not r:
            if np.abs(self.b).max(initial=0.0) > 1e-9 * self.unit:
                raise CannotHold(f"{self.state.robot.name} has no contact, so nothing carries its weight.")
            self._complain_if_overloaded(np.zeros(0))
            return np.zeros(0)
        scale = np.where(np.isfinite(self.limit), self.limit, self.unit)
        T, t = self.T / scale[:, None], self.t / scale
        H = 2.0 * (T.T @ T + FORCE_WEIGHT * np.eye(r))
        finite = np.isfinite(self.limit)
        C = np.vstack([np.eye(r), T[finite]])
        low = np.concatenate([self.low, t[finite] - 1.0])
        high = np.concatenate([self.high, t[finite] + 1.0])
        best, miss = None, np.inf
        for attempt in qp.attempts(H, -2.0 * T.T @ t, self.A / self.unit, self.b / self.unit, C, low, high):
            x = self._exact(np.clip(attempt.x, self.low, self.high))
            found = self._miss(x)
            if best is None or found < miss:
                best, miss = x, found
            if miss <= 1e-9:
                break
        assert best is not None
        if miss > 1e-7:
            self._explain()
        return best * self.unit

    def _miss(self, x: Array) -> float:
        """Largest violation of equilibrium, cones and torque limits, each relative to its scale."""
        out = float(np.abs(self.A @ x - self.b).max(initial=0.0)) / self.unit
        out = max(out, float(np.maximum(self.low - x, x - self.high).max(initial=0.0)))
        return max(out, float((np.abs(self.t - self.T @ x) / self.limit).max(initial=0.0)) - 1.0)

    def _exact(self, x: Array) -> Array:
        """X moved, within the weights that carry something, so that A x = b to rounding."""
        free = (x > self.low + 1e-6) & (x < self.high - 1e-6)
        for _ in range(2):
            x = x.copy()
            x[free] += np.linalg.lstsq(self.A[:, free], self.b - self.A @ x, rcond=1e-12)[0]
        return x

    def _explain(self) -> None:
        """Raise CannotHold with the limit in the way, found by linear programs (HiGHS)."""
        name = self.state.robot.name
        names = ", ".join(repr(r.name) for r in self.rows)
        if self._load(torques=False) is None:
            slippery = any(r.patch is not None and r.patch.friction is not None for r in self.rows)
            if slippery and self._friction_helps():
                raise CannotHold(f"{name} cannot be held on {names}: friction is in the way; with mu = 10 it could be.")
            raise CannotHold(
                f"{name} cannot be held on {names}: no forces that these contacts can give balance its weight (centre of mass "
                f"at x = {self.state.com[0]:.3f}, y = {self.state.com[1]:.3f} m{self._outside()}). Move it over its feet."
            )
        self._complain_if_overloaded(None)
        raise CannotHold(f"{name} can be held on {names} in principle, but no torques were found within tolerance.")

    def _outside(self) -> str:
        ground = [r.patch.point + r.patch.corners @ r.patch.axes.T for r in self.rows if r.patch is not None]
        if not ground:
            return ""
        d = inside_distance(self.state.com[:2], convex_hull(np.concatenate(ground)[:, :2]))
        return f", {-d:.3f} m outside the hull of the contact points" if d < 0.0 else ""

    def _complain_if_overloaded(self, x: Array | None) -> None:
        load = np.abs(self.t) / self.limit if x is not None else self._load(torques=True)
        assert load is not None
        over = np.flatnonzero(load > 1.0 + 1e-9)
        if len(over):
            worst = [self.state.robot.actuated_names[i] for i in over[np.argsort(-load[over])]]
            raise CannotHold(
                f"{self.state.robot.name} cannot be held: the torque limit of {', '.join(map(repr, worst[:4]))} is in the way; "
                f"even at best {worst[0]!r} needs {100 * load.max():.0f} % of its limit."
            )

    def _load(self, *, torques: bool) -> Array | None:
        """|tau| / limit with the largest as small as can be (anything if not `torques`); None if nothing balances."""
        r = len(self.lower)
        cost = np.r_[np.zeros(r), 1.0]
        bounds = [*zip(self.low, self.high, strict=True), (0.0, None)]
        finite = np.isfinite(self.limit) & torques
        T, t = self.T[finite] / self.limit[finite, None], self.t[finite] / self.limit[finite]
        one = np.ones((len(t), 1))
        A_ub, b_ub = np.vstack([np.c_[T, -one], np.c_[-T, -one]]), np.concatenate([t, -t])
        A_eq = np.c_[self.A, np.zeros(len(self.b))] / self.unit
        answer = linprog(cost, A_ub, b_ub, A_eq, self.b / self.unit, bounds=bounds, method="highs")
        return np.abs(self.t - self.T @ answer.x[:r]) / self.limit if answer.status == 0 else None

    def _friction_helps(self) -> bool:
        """Whether ten times the usual friction would balance the weight."""
        from dataclasses import replace

        rough = []
        for r in self.rows:
            cone = r.cone
            if hasattr(cone, "mu") and cone.mu > 0.0:
                cone = replace(cone, mu=10.0)  # type: ignore[type-var]
            rough.append(Rows(r.name, r.J, r.bias, cone, r.velocity, resultant=r.resultant, patch=r.patch))
        return _Statics(self.state, tuple(rough), self.rhs)._load(torques=False) is not None
