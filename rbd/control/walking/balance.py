"""`Balance`: a controller that stands, and takes steps where its feet cannot hold what pushes it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag
from rbd.centroid import CentroidPlan
from rbd.constraints.convex.polygons import convex_hull, inside_distance, nearest_on_edge
from rbd.constraints.surface import On
from rbd.control.schedules import AcceptedStep
from rbd.control.task_terms import Reference
from rbd.control.walking.plan import COARSE, REST, WalkPlan
from rbd.control.walking.swings import Swing, to_rest
from rbd.control.walking.walk import Walk, contacts_at
from rbd.errors import InaccurateWarning, InputError, NoSolution
from rbd.errors.warned import stacklevel_of_user
from rbd.model.external import generalised
from rbd.model.state import State
from rbd.records import counted
from rbd.robots.robot import Robot

SOLE = 1.2
"""The centre of pressure is kept inside the plan's points of a sole (`carrying`), scaled by this: nine tenths of the sole."""
LOOK = 0.13
"""A push that acts is expected to last for so long [sqrt(h / g)]."""
BEYOND, LEANS = 0.04, 0.05
"""A capture point outside the soles by so much is still held, by angular momentum: the centre of pressure that is asked for may
be outside by the second [h]."""
FEEDBACK = 0.6
"""On both feet the centre of pressure is farther from where it is to rest than the capture point, by this share."""
LIFT, DEEP = 0.05, 0.017
"""Height of feet in the air over what is below them; and how far below the ground their way ends, so that they land on time and
not slowly [h]."""
FADE = 0.07
"""Forces of feet rise and fall within this time; feet that are late are counted on after it [sqrt(h / g)]."""
TIMES, OTHER_TIMES = (0.7, 0.85, 1.0, 1.2, 1.4), (0.8, 1.0, 1.25)
"""How long a foot may be in the air [sqrt(h / g)]; and how its time left may change, as factors."""
AGAIN, SOONEST = 0.1, 0.3
"""Least time between two plans; a foot that lands sooner is not put elsewhere [sqrt(h / g)]."""
FASTEST = 4.0
"""Largest level acceleration of a foot in the air [g]: what hips of humanoids have for their legs, about."""
FORWARD, OUTWARD, INWARD = 0.8, 0.75, 0.2
"""Half-axes of the ellipse in which a foot is put down, about where it stands beside the other [h]; and by how much feet come
nearer to each other at most, as a share of their distance: so legs do not cross."""
STANDS = 1e-3
"""A foot that stands elsewhere than planned by more is there in the plan, too [h]."""
STRETCHED, NEAR = 0.6, 0.4
"""A foot farther from the capture point than this is put down nearer to the other [h], in an ellipse smaller by that factor."""
STEP, HASTE, TIME, MISS, DEPTH = 1.0, 0.3, 0.5, 100.0, 3
"""Costs of a step, of a foot that is as fast as it can be, of 1 sqrt(h / g) in the air, of a capture point h outside the feet
after the last step; and how many steps are looked ahead."""
_SHARES = np.linspace(0.0, 1.0, 15)


@dataclass(frozen=True)
class _Step:
    """A foot is put down at a place, shape (2,) [m], in a time [s]; cost of it and the steps after."""

    cost: float
    foot: str
    T: float
    place: Array


class Balance(Walk):
    """A controller of `rbd.simulate` that stands on two feet and, pushed too far, comes to rest again by steps.

    With h the height of the centre of mass c over the feet, w = sqrt(g / h) and z the centre of pressure, the capture point
    x = c + c' / w moves away from it:

        c'' = w^2 (c - z) + F / m,    x(T) = z + (x - z) exp(w T)    over a foot that stands, once the push F has ended

    It is held while it is over the soles, or beside them by less than 4 % of h. Else a foot is lifted at once: of either foot
    and five times T that one is taken after which x is over the feet, at the least cost of steps, time and acceleration; up to
    three steps are looked ahead. Until shortly before it lands the foot is put elsewhere, sooner or later, each 0.1 / w, from
    the state as it is then. So errors do not add up. A foot that is left far behind is put beside the other.

    The centre of pressure that is asked for brings x over the foothold at the landing; on both feet, to their middle. The
    centre of mass keeps its height. A whole-body controller finds torques and forces for it, and turns trunk and arms where the
    soles do not suffice.

    What pushes is what neither motors nor feet explain, M (v - v_before) / dt + h - S^T tau - J^T f with the forces f that the
    feet had in the step before; it is expected to last for 0.13 / w, and the controller counts on it in its next step.

    Not considered: collisions of legs, but for the least distance of two feet; the inertia of the leg in the air, limits of
    joints and torques in the plan, which the controller keeps as well as it can (`log`); slopes, in the motion of x. Constants
    are shares of h, g and sqrt(h / g); they were chosen on pushes of Talos with 80 N s. What was simulated is told in
    docs/reference/walking.md.

    Args:
        robot: The robot, with two feet.
        terrain: What it stands on: a plane, a height [m], or `rbd.Terrain`.
        friction: Coulomb's coefficient of the contacts.
        state: Where it starts, at rest on its feet; None: standing on the ground under its standing posture.
        model: The model with which it computes, of the same joints; None: the robot itself.
        steps: Whether it takes steps; False: it stays on the feet as they stand.

    Attributes:
        robot: The robot.
        state: Where it starts.
        contacts: Its feet.
        plan: What it follows now, a `WalkPlan`; its `footsteps` are those that it took or takes. Its centre of mass is that of
            the equations above, with one force, at z.
        plans: (time, plan) of all since the start.
        unsolved: Times of steps of control for which no torques were found [s]: those of the step before were held.

    Raises:
        InputError: a robot that has not two feet; wrong kinds.
        ModelError: a robot without feet.
        CannotReach: it cannot stand on the ground where it starts.

    Example:
        >>> g1 = rbd.load_robot("g1")
        >>> balance = rbd.control.Balance(g1)
        >>> print(balance)
        g1 stands, and has taken no steps
    """

    _costs: ClassVar[tuple[float, Any, float, float, float]] = 3000.0, np.array([1.0, 1.0, 10.0]), 5.0, 5.0, 5.0

    def __init__(
        self,
        robot: Robot,
        *,
        terrain: On = 0.0,
        friction: float = 0.6,
        state: State | None = None,
        model: Robot | None = None,
        steps: bool = True,
    ) -> None:
        super().__init__(robot, [], terrain=terrain, friction=friction, state=state, model=model, arms=False)
        check_flag("steps of Balance", steps)
        if len(self.contacts) != 2:
            raise InputError(
                f"{robot.name} has {counted(len(self.contacts), 'foot', 'feet')}; Balance takes steps with two. "
                "`rbd.control.Walk` walks with four, and takes up pushes on its way."
            )
        self.steps = steps
        h, unit = self._planner.h, self._planner.unit
        self._planner = replace(self._planner, lift=LIFT * h, fade=FADE * unit)
        self._first = replace(self._first, fade=FADE * unit, tilts=False)
        self._feet, self._w, yaw = {foot.name: foot for foot in self.contacts}, 1.0 / unit, self._planner.yaw
        self._ahead = np.array([math.cos(yaw), math.sin(yaw)])
        self._left = np.array([-self._ahead[1], self._ahead[0]])
        at = {foot: X.translation for foot, X in self._planner.poses.items()}
        self._other = dict(zip(at, reversed(at), strict=True))
        self._apart = {foot: float((p - at[self._other[foot]])[:2] @ self._left) for foot, p in at.items()}
        self._rest = self.state.com - np.mean(list(at.values()), axis=0)
        self._control = replace(self._control, external=self._known)
        self.reset()

    @property
    def duration(self) -> float:
        """When the plan that it follows has come to rest [s]."""
        return self.plan.duration

    def reset(self) -> None:
        """Forget the motion until now."""
        super().reset()
        self.unsolved = list[float]()
        self._before: tuple[float, State, Array] | None = None
        self._landed = dict.fromkeys(self._other, 0)
        self._tau, self._push = np.zeros(self.robot.nv), np.zeros(6)
        self._wanted = Reference(self.state.com, np.zeros(3), np.zeros(3))
        self._control.reschedule(self.plan.schedule)

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: plan where that is needed, and compute the torques that are held.

        Raises:
            InputError: a state of another robot than before.
            NoSolution: no torques were found for the first step; later those of the step before are held, with a warning.
        """
        t, state = step.t, step.state
        A_g, _, mass = state.centroidal()
        v = (A_g[:3] @ state.v) / mass
        self._tau = self._unexplained(step)
        self._push = generalised(state, self._tau)[1]
        self._land(step)
        x = (state.com + v / self._w)[:2] + LOOK * self._push[:2] / (mass * self._w**2)
        poses = contacts_at(state, self.contacts)
        soles = {name: self._sole(name, X) for name, X in poses.items()}
        if self.steps and t >= self._again:
            self._decide(t, state.com, x, poses, soles)
        self._wanted = self._followed(t, state.com, v, x, poses, soles)
        try:
            self._control.accepted(step)
        except NoSolution as error:
            if self._before is None:
                raise
            if not self.unsolved:
                text = f"at t = {t:.6g} s {self.robot.name} holds the torques of the step before: {error} Said once a motion: "
                warnings.warn(f"{text}`unsolved` of Balance has all times.", InaccurateWarning, stacklevel=stacklevel_of_user())
            self.unsolved.append(t)
        self._stand(poses)
        self._before = t, state, self._control(state, t)

    def __str__(self) -> str:
        n = len(self.plan.footsteps)
        taken = "has taken no steps" if not n else f"has taken, or takes, {counted(n, 'step')}"
        held = f"; no torques were found for {counted(len(self.unsolved), 'step')} of control" if self.unsolved else ""
        return f"{self.robot.name} stands, and {taken}{held}"

    def _known(self, state: State, t: float) -> Array:
        return self._tau

    def _com(self, t: float) -> Reference:
        return self._wanted

    def _momentum(self, t: float) -> Reference:
        return Reference(np.zeros(6), np.concatenate([np.zeros(3), self._push[3:]]))

    def _unexplained(self, step: AcceptedStep) -> Array:
        """Generalised forces of the step before that neither motors nor feet explain, shape (nv,)."""
        if self._before is None or not step.contacts.keys() >= self._feet.keys():
            return np.zeros(self.robot.nv)
        t, state, tau = self._before
        out = np.asarray(state.M @ (step.state.v - state.v)) / (step.t - t) + state.h
        out[state.robot.motors] -= tau
        for name, foot in self._feet.items():
            for p, f in zip(foot.corners, step.contacts[name].forces, strict=True):
                if f.any():
                    out -= state.frame(foot.frame, foot.placement.act(p)).J[:3].T @ f
        return out

    def _land(self, step: AcceptedStep) -> None:
        """A foot that touches late in its swing has landed, and stands from then on."""
        flying = self._flying
        if flying is None:
            return
        *before, s = self.plan.swings[flying]
        touch = step.contacts.get(flying)
        if step.t > s.start + 0.5 * s.T and touch is not None and touch.touches.any():
            self._landed[flying] += 1
            if step.t < s.landing:
                self._follow(replace(self.plan, swings={**self.plan.swings, flying: (*before, replace(s, T=step.t - s.start))}))
                self._again = step.t

    def _stand(self, poses: Mapping[str, pin.SE3]) -> None:
        """In the plan, feet that have landed and are counted on are where they stand."""
        for foot, own in self.plan.swings.items():
            if foot in self._control.actuation.contacts and 0 < len(own) <= self._landed[foot]:
                off = poses[foot].translation - own[-1].end.translation
                if np.linalg.norm(off[:2]) > STANDS * self._planner.h:
                    end = pin.SE3(own[-1].end.rotation, own[-1].end.translation + [*off[:2], 0.0])
                    swings = {**self.plan.swings, foot: (*own[:-1], replace(own[-1], end=end))}
                    self.plan = replace(self.plan, swings=swings)

    @property
    def _flying(self) -> str | None:
        """The foot in the air."""
        return next((foot for foot, own in self.plan.swings.items() if len(own) > self._landed[foot]), None)

    def _sole(self, foot: str, X: pin.SE3) -> Array:
        """Where a foot may have its centre of pressure: corners, shape (k, 2)."""
        return np.array([X.act(p)[:2] for p in SOLE * self._planner.points[foot]])

    def _follow(self, plan: WalkPlan) -> None:
        self.plan = plan
        self._control.reschedule(plan.schedule)

    def _decide(self, t: float, c: Array, x: Array, poses: Mapping[str, pin.SE3], soles: Mapping[str, Array]) -> None:
        """A step where x is not held; another foothold or time of the foot in the air."""
        h, unit, at = self._planner.h, self._planner.unit, {foot: X.translation[:2] for foot, X in poses.items()}
        shapes, foot = {f: soles[f] - p for f, p in at.items()}, self._flying
        if foot is None:
            far = max(at, key=lambda f: float(np.linalg.norm(at[f] - x)))
            if not self._held(x, *soles.values()):
                best = min((self._best(x, at, shapes, f) for f in at), key=lambda each: each.cost)
            elif np.linalg.norm(at[far] - x) > STRETCHED * h and self._held(x, soles[self._other[far]]):
                best = self._best(x, at, shapes, far, 1)
            else:
                return
            own = list(self.plan.swings[best.foot])
            if own and t - own[-1].landing < FADE * unit:
                return
            X = poses[best.foot]
            X = self._planner.floor.pose(best.foot, X.translation, math.atan2(X.rotation[1, 0], X.rotation[0, 0]))
            s = replace(self._planner.way(best.foot, X, self._foothold(best, X), t, best.T), heel=None)
            if not self._planner.floor.uneven:
                s = replace(s, forward=(0.0, 1.0))
        else:
            *own, s = self.plan.swings[foot]
            left = s.landing - t
            if left < SOONEST * unit:
                return
            at[foot] = s.end.translation[:2]
            best = self._best(x, at, shapes, foot, moving=(s, t))
            if abs(best.T - left) < 1e-9 and np.linalg.norm(best.place - at[foot]) < 0.005 * h:
                return
            s = s.redirected(t, self._foothold(best, s.end), t + best.T)
        self._again = t + AGAIN * unit
        plan = replace(self.plan, swings={**self.plan.swings, best.foot: (*own, s)})
        self._follow(self._predicted(plan, t, c, x, soles[self._other[best.foot]], s))
        self.plans.append((t, self.plan))

    def _foothold(self, best: _Step, X: pin.SE3) -> pin.SE3:
        """Pose of a foot that was at X, at its new place, and a little deeper than the ground."""
        Y = self._planner.floor.shifted(best.foot, X, best.place - X.translation[:2])
        height = self._planner.floor.height(*Y.translation[:2])[0]
        return pin.SE3(Y.rotation, np.array([*Y.translation[:2], height - DEEP * self._planner.h]))

    def _predicted(self, plan: WalkPlan, t: float, c: Array, x: Array, sole: Array, s: Swing) -> WalkPlan:
        """The plan with its centre of mass: over the foot that stands until the landing, then to rest over x."""
        w, mass, g, left = self._w, self.robot.mass, float(np.linalg.norm(self.robot.gravity)), s.landing - t
        z = _into(x, convex_hull(sole))
        times = np.linspace(t, s.landing + REST / w, max(round((left * w + REST) / COARSE), 8) + 1)
        u = np.minimum(times - t, left)[:, None]
        over = z + 0.5 * (x - z) * np.exp(w * u) + (c[:2] - z - 0.5 * (x - z)) * np.exp(-w * u)
        ends = z + (x - z) * math.exp(w * left)
        later = np.maximum(times - s.landing, 0.0)[:, None]
        over = np.where(later > 0.0, ends + (over - ends) * np.exp(-w * later), over)
        com = np.column_stack([over, np.full(len(times), c[2])])
        at = np.where(later > 0.0, ends, z)
        force = np.column_stack([mass * w**2 * (over - at), np.full(len(times), mass * g)])[:, None]
        still = np.zeros((len(times), 3))
        known = CentroidPlan(com, still, force, np.zeros((0, 2)), "Solved", 0.0, 0.0, still[0])
        return replace(plan, t=times, centroid=known)

    def _held(self, x: Array, *soles: Array) -> bool:
        """Whether x is over soles, or a little beside them."""
        return inside_distance(x, convex_hull(np.concatenate(soles))) >= -BEYOND * self._planner.h

    def _best(
        self,
        x: Array,
        at: Mapping[str, Array],
        shapes: Mapping[str, Array],
        foot: str,
        depth: int = DEPTH,
        moving: tuple[Swing, float] | None = None,
    ) -> _Step:
        """The best step of a foot, while x moves away from the other one; of one that moves at a time, how it goes on."""
        w, unit, h, other = self._w, self._planner.unit, self._planner.h, self._other[foot]
        sole = at[other] + shapes[other]
        z, held = _into(x, convex_hull(sole)), self._held(x, sole)
        left = 0.0 if moving is None else moving[0].landing - moving[1]
        best = _Step(math.inf, foot, left, at[foot])
        for T in [T * unit for T in TIMES] if moving is None else [factor * left for factor in OTHER_TIMES]:
            if moving is not None and T > left and moving[1] + T - moving[0].start > TIMES[-1] * unit:
                continue
            ends = z + (x - z) * math.exp(w * T)
            place, haste = self._placed(at[foot] if held else ends, at, foot, T, NEAR if held else 1.0, moving)
            if moving is not None and haste > 1.3 and T < left:
                continue
            cost = STEP + HASTE * haste**2 + TIME * T / unit
            miss = 0.0 if held else max(-inside_distance(ends, convex_hull(np.concatenate([sole, place + shapes[foot]]))), 0.0)
            if miss:
                cost += self._best(ends, {**at, foot: place}, shapes, other, depth - 1).cost if depth > 1 else MISS * miss / h
            if cost < best.cost:
                best = _Step(cost, foot, T, place)
        return best

    def _placed(
        self, x: Array, at: Mapping[str, Array], foot: str, T: float, share: float, moving: tuple[Swing, float] | None
    ) -> tuple[Array, float]:
        """(place, largest acceleration over the most that it may be) of a foot that is to be below x, as far as it comes."""
        h, other, apart = self._planner.h, at[self._other[foot]], self._apart[foot]
        u, side = float((x - other) @ self._ahead), math.copysign(1.0, apart)
        beside = side * float((x - other) @ self._left) - abs(apart)
        out = max(math.hypot(u / (share * FORWARD * h), beside / (share * OUTWARD * h)), 1.0)
        beside = max(beside / out, -INWARD * abs(apart))
        way = other + u / out * self._ahead + side * (abs(apart) + beside) * self._left - at[foot]
        begin = np.array([at[foot], np.zeros(2), np.zeros(2)])
        if moving is not None:
            X, v, a = moving[0].at(moving[1])
            begin = np.array([X.translation[:2], v[:2], a[:2]])
        most, peak = FASTEST * h * self._w**2, math.inf
        bent = np.array([to_rest(u * T, T, at[foot] - begin[0], begin[1], begin[2])[2] for u in _SHARES])
        more = (60.0 * _SHARES - 180.0 * _SHARES**2 + 120.0 * _SHARES**3)[:, None] * way / T**2
        for part in (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1, 0.0):
            peak = float(np.linalg.norm(bent + part * more, axis=1).max())
            if peak < most:
                break
        return at[foot] + part * way, peak / most

    def _followed(
        self, t: float, c: Array, v: Array, x: Array, poses: Mapping[str, pin.SE3], soles: Mapping[str, Array]
    ) -> Reference:
        """What the centre of mass is to do now."""
        flying = self._flying
        stand = [foot for foot in poses if foot != flying]
        places = np.array([poses[foot].translation for foot in stand])
        if flying is None:
            z = x + FEEDBACK * (x - places.mean(axis=0)[:2] - self._rest[:2])
        else:
            s = self.plan.swings[flying][-1]
            grows = math.exp(self._w * max(s.landing - t, FADE / self._w))
            z = (x * grows - s.end.translation[:2]) / (grows - 1.0)
        inside = _into(z, convex_hull(np.concatenate([soles[foot] for foot in stand])))
        out = float(np.linalg.norm(z - inside))
        z = inside + min(LEANS * self._planner.h / out, 1.0) * (z - inside) if out else z
        a = self._w**2 * (c[:2] - z) + self._push[:2] / self.robot.mass
        return Reference(np.array([*c[:2], places[:, 2].mean() + self._rest[2]]), np.array([*v[:2], 0.0]), np.array([*a, 0.0]))


def _into(p: Array, hull: Array) -> Array:
    """The nearest point of a hull."""
    return p if inside_distance(p, hull) >= 0.0 else nearest_on_edge(p, hull)
