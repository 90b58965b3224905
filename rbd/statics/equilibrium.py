"""Statics: motor torques and contact forces that keep a robot at rest, or why there are none."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, is_finite, lazy
from rbd.constraints.constraint import Constraint, has_friction, rows_of
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.errors import CannotHold, DuplicateName, InaccurateWarning, NotAtRest
from rbd.least_constraint import warn_of_distant
from rbd.model.checked_model import CheckedModel
from rbd.model.dynamics import External, checked, free_force
from rbd.model.state import State
from rbd.problem.answer import ContactForce, corner_split
from rbd.problem.force_set import at_rest
from rbd.problem.programs import FRICTION_PROGRAMS, PROGRAM_PIVOTS, PROGRAM_SECONDS, Outcome, linear_program
from rbd.problem.residuals import SOLVED, USABLE
from rbd.problem.rows import Rows
from rbd.solvers import qp
from rbd.statics.least_friction import Balance, LimitReached, rounded_up

AT_REST = 1e-9
"""Largest |v| of a robot at rest."""
FORCE_WEIGHT = 1e-4
"""Weight of sum (ray weight / body weight)^2 relative to sum (tau / limit)^2: it selects among forces that need no torque."""
_LONG = 1e2  # for the rays of friction 100


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of a static equilibrium to each limit; zero is at the limit.

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
    """Torques and contact forces that keep a robot at rest.

    Attributes:
        state: The pose.
        tau: Motor torques, shape (nu,) [N, N m]; none on the base or on passive joints.
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

    @lazy
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return {r.name: ContactForce.of(r.patch, self.forces[r.name]) for r in self.rows if r.patch is not None}

    @lazy
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
        robot = self.state.robot
        used = np.abs(self.tau) / robot.effort_limit
        largest = "without motors"
        if robot.nu and np.isfinite(robot.effort_limit).any():
            worst = int(np.argmax(used))
            largest = f"largest torque {100 * used[worst]:.1f} % of its limit ({robot.actuated_names[worst]})"
        elif robot.nu:
            worst = int(np.argmax(np.abs(self.tau)))
            largest = f"largest torque {abs(self.tau[worst]):.4g} N m ({robot.actuated_names[worst]}; no limits are stated)"
        head = f"held: {largest}, residual {self.residual:.1e} N"
        return "\n".join([head] + [f"  {name:<16}{c}" for name, c in self.contacts.items()])


def hold(state: State, contacts: Sequence[Constraint], *, external: External = None) -> Hold:
    """Motor torques that keep a robot at rest, and the contact forces that go with them.

    Minimises sum (tau / limit)^2, plus a small weight on the forces, subject to S^T tau + tau_ext + J^T f = h(q, 0),
    |tau| <= limit, and corner forces in the pyramids *inscribed* in the friction cones: the result is valid under the circular
    cones too. A motor without a stated limit counts with body weight times one metre.

    Args:
        state: The pose; v must be zero.
        contacts: The contacts; bilateral contacts (friction=None) may pull.
        external: Other forces on the robot: generalised (nv,), or `ExternalForce`s.

    Raises:
        NotAtRest: if |v| exceeds 1e-9, or what a contact touches moves.
        CannotHold: naming what prevents equilibrium: unilateral contacts, friction, or a motor's limit.
    """
    robot = checked(state).robot
    if (speed := float(np.abs(state.v).max(initial=0.0))) > AT_REST:
        raise NotAtRest(f"hold wants a robot at rest, and |v| reaches {speed:.3g}. Use State(robot, q) with v = 0.")
    with suppress(TypeError):  # rows_of raises with a message
        contacts = tuple(contacts)
    rows = tuple(rows_of(state, contacts))
    if len(names := [r.name for r in rows]) != len(set(names)):
        twice = next(name for name in names if names.count(name) > 1)
        raise DuplicateName(f"two contacts are named {twice!r}; give each a different name.")
    warn_of_distant(robot, rows, stacklevel=3)
    for r in rows:  # at v = 0, J_dot v of a ground at rest is zero
        if r.speed > AT_REST or np.abs(r.bias).max(initial=0.0) > AT_REST:
            raise NotAtRest(f"hold wants a ground at rest, and what {r.name!r} touches moves. Use rbd.solve.")
    rhs, _ = free_force(state, np.zeros(robot.nu), external)
    statics = _Statics(state, contacts, rows, rhs)
    w = statics.weights()
    f = statics.G @ w
    load = -statics.rhs - statics.J.T @ f  # load on the motors
    tau = load[robot.actuated]
    load[robot.actuated] = 0.0
    forces, corners, at = {}, {}, 0
    for i, r in enumerate(rows):
        part = f[at : at + len(r)]
        at += len(r)
        forces[r.name] = part.copy() if r.resultant is None else r.resultant @ part
        if r.patch is not None:
            held = not len(r) or at_rest(r.cone).bilateral
            corners[r.name] = corner_split(r, part) if held else statics.sets.at_points(w, i) @ r.patch.axes.T
    return Hold(state, tau, forces, corners, float(np.abs(load).max()), rows)


class _Statics:
    """The static problem in x, the rays' weights over the body weight: f = G x, and tau follows."""

    def __init__(self, state: State, contacts: Sequence[Constraint], rows: tuple[Rows, ...], rhs: Array) -> None:
        robot = state.robot
        self.state, self.contacts, self.rows, self.rhs = state, contacts, rows, rhs
        self.sets = at_rest(*[r.cone for r in rows]).with_pyramids(inscribed=True)
        self.J = np.concatenate([r.J for r in rows]) if rows else np.zeros((0, robot.nv))
        self.G = self.sets.G
        self.unit = robot.mass * float(np.linalg.norm(robot.gravity)) or 1.0
        self.low, self.high = self.sets.lower / self.unit, self.sets.upper / self.unit
        self.limit = robot.effort_limit
        self.limited = np.isfinite(self.limit)
        idle = _indices(robot, robot.passive)
        base = np.setdiff1d(np.arange(robot.nv), np.concatenate([robot.actuated, idle]))
        per_ray = self.J.T @ self.G * self.unit
        self.still = np.concatenate([base, idle])  # no torque on the base, nor on passive joints
        self.A, self.b = per_ray[self.still], -rhs[self.still]
        self.least = np.minimum(state.M.diagonal()[self.still], 1.0)
        top = np.abs(self.A).max(axis=1, initial=0.0)
        self.row_size = np.where(top > 0.0, top, 1.0)  # a passive joint is balanced like the base
        self.passive = np.arange(len(base), len(self.still))
        self.T, self.t = per_ray[robot.actuated], -rhs[robot.actuated]  # tau = t - T x

    def weights(self) -> Array:
        """The optimal weights [N], with equilibrium exact to rounding.

        Raises:
            CannotHold: naming what prevents equilibrium.
        """
        # Linear programs first: on a program without a solution ProxSuite can run for seconds, or without end.
        self._refuse()
        r = len(self.low)
        if not r:
            return np.zeros(0)
        best, miss = np.zeros(r), np.inf
        for attempt in self._attempts():
            x = self._exact(np.clip(attempt, self.low, self.high))
            if (found := self._miss(x)) < miss:
                best, miss = x, found
            if miss <= SOLVED:
                return best * self.unit
        robot = self.state.robot
        if miss > USABLE:
            raise CannotHold(f"{robot.name} can be held in principle, but no torques were found within tolerance.")
        warnings.warn(f"{robot.name} is held with a relative error of {miss:.1e}.", InaccurateWarning, stacklevel=3)
        return best * self.unit

    def _attempts(self) -> Iterator[Array]:
        """Weights from the QP: for the rays as given, and where large friction makes them long, for unit rays."""
        length = np.linalg.norm(self.G, axis=0)
        scale = np.where(self.limited, self.limit, self.unit)
        for size in (np.ones(len(length)), 1.0 / length)[: 1 + bool((length > _LONG).any())]:
            T, t = self.T / scale[:, None] * size, self.t / scale
            H = 2.0 * (T.T @ T + FORCE_WEIGHT * np.diag(size**2))
            C = np.vstack([np.eye(len(size)), T[self.limited]])
            low = np.concatenate([self.low / size, t[self.limited] - 1.0])
            high = np.concatenate([self.high / size, t[self.limited] + 1.0])
            A, b = self.A / self.unit * size, self.b / self.unit
            for attempt in qp.attempts(H, -2.0 * T.T @ t, A, b, C, low, high):
                yield size * attempt.x

    def _unbalanced(self, x: Array) -> float:
        """Unbalanced load of unactuated coordinates, each row over the size of its terms (as in `rbd.problem.scales`)."""
        terms = np.maximum(np.maximum(np.abs(self.A) @ np.abs(x), np.abs(self.b)), self.least)
        return float((np.abs(self.A @ x - self.b) / terms).max(initial=0.0))

    def _miss(self, x: Array) -> float:
        """Largest violation of equilibrium, cones and torque limits, each relative to its scale; infinite for NaN."""
        if not is_finite(x):
            return np.inf
        out = max(self._unbalanced(x), float(np.maximum(self.low - x, x - self.high).max(initial=0.0)))
        return max(out, float((np.abs(self.t - self.T @ x) / self.limit).max(initial=0.0)) - 1.0)

    def _exact(self, x: Array) -> Array:
        """Correct x within its nonzero weights, so that A x = b to rounding, if possible."""
        tried = [x]
        for least in (1e-6, 1e-10):  # at a limit few weights are large: the small ones are needed then
            free, moved = (x > self.low + least) & (x < self.high - least), x.copy()
            for _ in range(2):
                left = (self.b - self.A @ moved) / self.row_size
                moved[free] += np.linalg.lstsq(self.A[:, free] / self.row_size[:, None], left, rcond=1e-12)[0]
            if self._unbalanced(moved) <= 1e-13 and self._miss(moved) <= SOLVED:
                return moved
            tried.append(moved)
        return min(tried, key=self._miss)

    def _refuse(self) -> None:
        """Raise CannotHold naming what prevents equilibrium, if anything does."""
        name, found = self.state.robot.name, self._least_excess()
        if found is None:
            raise CannotHold(f"{name} cannot be held{self._on()}: {self._why_unbalanced()}")
        over = np.flatnonzero(found[0] > 1e-7)
        if len(over):
            over = over[np.argsort(-found[0][over])][:4]
            needs = ", ".join(f"{self.state.robot.actuated_names[i]!r} needs {100 * (1 + found[0][i]):.4g} %" for i in over)
            raise CannotHold(f"{name} cannot be held: a torque limit prevents it. At best {needs} of its limit.")

    def _on(self) -> str:
        return " on " + ", ".join(repr(r.name) for r in self.rows) if self.rows else ""

    def _why_unbalanced(self) -> str:
        """Message: why no contact forces and no torques, of any size, balance the robot."""
        robot = self.state.robot
        if len(self.passive) and (found := self._least_excess(passive=True)) is not None:
            helped = sorted({robot.model.names[_joint_at(robot, self.still[i])] for i in self.passive[found[1] > 1e-7]})
            return f"{', '.join(map(repr, helped))} would need torque, and is passive."
        if not self.rows:
            return "it has no contact, so nothing carries its weight. Give contacts, e.g. robot.feet()."
        if words := self._why_friction():
            return words
        pushed = float(np.abs(self.rhs + self.state.h).max()) > 1e-9
        x, y, _ = np.round(self.state.com, 3) + 0.0
        return (
            f"no forces that its contacts can give balance its weight{' and the external forces' if pushed else ''} "
            f"(centre of mass at x = {x:.3f}, y = {y:.3f} m{self._outside()}). "
            + ("Push less, or move the centre of mass against the push." if pushed else "Move it over its feet.")
        )

    def _outside(self) -> str:
        patches = [r.patch for r in self.rows if r.patch is not None and r.patch.against is None]
        ground = [patch.point + patch.corners @ patch.axes.T for patch in patches]
        if not ground:
            return ""
        d = inside_distance(self.state.com[:2], convex_hull(np.concatenate(ground)[:, :2]))
        return f", seen from above {-1e3 * d:.1f} mm outside the hull of the contact points" if d < -1e-4 else ""

    def _why_friction(self) -> str:
        """Message: how much friction would suffice under circular cones; empty where none would."""
        if not any(has_friction(c) for c in self.contacts):
            return ""
        try:
            return self._friction_words()
        except LimitReached:
            return (
                f"whether more friction would do was not found within {FRICTION_PROGRAMS} linear programs. "
                "Try friction=10.0 at its contacts."
            )

    def _friction_words(self) -> str:
        if self._circular(as_given=True, limits=True).holds():
            mu = self._circular(limits=True, from_zero=True).least()
            enough = "" if mu is None else f" from a coefficient of {rounded_up(mu)} at every contact on"
            return (
                f"friction prevents it: circular cones would hold it{enough}, but the pyramids inside them, to which "
                "rbd.hold keeps, do not. Give the contacts more facets, e.g. facets=16."
            )
        if (mu := self._circular(limits=True).least()) is not None:
            return (
                f"friction prevents it; a coefficient of {rounded_up(mu)} at every contact would do with circular cones, and "
                "none below. rbd.hold keeps to the pyramids inside them: the more facets=, the less it asks beyond that."
            )
        if (mu := self._circular(limits=False).least()) is not None:
            return (
                f"friction prevents it, and then a torque limit: from a coefficient of {rounded_up(mu)} at every contact on, "
                "circular cones balance it, but motors would need more than their limits."
            )
        return ""

    def _circular(self, *, limits: bool, as_given: bool = False, from_zero: bool = False) -> Balance:
        """The same problem under circular cones: with the friction given, or with larger coefficients, or from zero on."""
        rough = self.contacts if as_given else tuple(_with_friction(c, 1.0) for c in self.contacts)
        rows = rows_of(self.state, rough)
        P, robot = at_rest(*[r.cone for r in rows]), self.state.robot
        J = np.concatenate([r.J for r in rows])
        per_weight = J.T @ P.G * self.unit
        own, yields = P.mu.copy(), np.zeros(len(P.mu), bool)
        for c, span in zip(self.contacts, P.slices, strict=True):
            at = (span.start <= P.cone_at) & (P.cone_at < span.stop)
            if has_friction(c):
                own[at], yields[at] = 0.0 if from_zero else c.friction, not as_given  # type: ignore[attr-defined]
        limited = self.limited if limits else np.zeros_like(self.limited)
        T, t = per_weight[robot.actuated][limited], self.t[limited]
        limit = self.limit[limited]
        return Balance(
            per_weight[self.still] / self.unit, self.b / self.unit, T / limit[:, None], t / limit,
            P.lower / self.unit, P.upper / self.unit, P.cone_at, own, yields,
        )  # fmt: skip

    def _least_excess(self, *, limits: bool = True, passive: bool = False) -> tuple[Array, Array] | None:
        """Least violation of torque limits: (over, idle), by a linear program (HiGHS); None if no forces balance even so.

        over, shape (nu,), is each torque's excess over its limit, relative; idle, shape (number of passive joints,), the
        torques that passive joints would need, over the body weight, where `passive` allows them. Their sum is minimal.
        """
        r = len(self.low)
        n, p = int(self.limited.sum()) * limits, len(self.passive) * passive
        if r + n + p == 0:
            return (np.zeros(len(self.limit)), np.zeros(0)) if self._miss(np.zeros(0)) <= SOLVED else None
        limit = self.limit[self.limited][:n]
        T, t = self.T[self.limited][:n] / limit[:, None], self.t[self.limited][:n] / limit
        give = np.zeros((len(self.b), p))
        give[self.passive[:p], np.arange(p)] = 1.0
        A_eq = np.hstack([self.A / self.unit, np.zeros((len(self.b), n)), give, -give])
        beside = np.hstack([-np.eye(n), np.zeros((n, 2 * p))])
        A_ub = np.vstack([np.hstack([T, beside]), np.hstack([-T, beside])])
        bounds = [*zip(self.low, self.high, strict=True), *[(0.0, None)] * (n + 2 * p)]
        cost = np.r_[np.zeros(r), np.ones(n + 2 * p)]
        b_ub = np.concatenate([1.0 + t, 1.0 - t])
        answer = linear_program(cost, A_ub, b_ub, A_eq, self.b / self.unit, bounds=bounds)
        if answer.outcome is Outcome.NOT_FOUND:
            raise CannotHold(
                f"{self.state.robot.name}: whether it can be held was not found within {PROGRAM_PIVOTS:,} pivots and "
                f"{PROGRAM_SECONDS:g} s of a linear program. Use fewer contacts, or contacts that are not redundant."
            )
        if not answer.solved:
            return None
        over = np.zeros(len(self.limit))
        over[np.flatnonzero(self.limited)[:n]] = answer.x[r : r + n]
        return over, answer.x[r + n : r + n + p] + answer.x[r + n + p :]


def _with_friction(contact: Constraint, mu: float) -> Constraint:
    """The contact with at least this coefficient, if it has one."""
    return contact.with_friction(max(mu, contact.friction)) if has_friction(contact) else contact  # type: ignore[attr-defined]


def _indices(robot: CheckedModel, joints: Iterable[str]) -> Array:
    """Indices in v of the coordinates of joints that could carry a motor, ascending."""
    found: list[int] = []
    for name in joints:
        joint = robot.model.joints[robot.joint_id(name)]
        if joint.shortname() != "JointModelFreeFlyer":
            found.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return np.array(sorted(found), dtype=int)


def _joint_at(robot: CheckedModel, index: int) -> int:
    """The joint that an index in v belongs to."""
    return next(i for i in range(1, robot.model.njoints) if 0 <= index - robot.model.joints[i].idx_v < robot.model.joints[i].nv)
