"""`Balance`: a controller that stands, and takes steps where its feet cannot hold what pushes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag
from rbd.constraints.surface import On
from rbd.control.contact_schedule import ContactSchedule
from rbd.control.schedules import AcceptedStep
from rbd.control.walking.plan import COM, WalkPlan
from rbd.control.walking.swings import Swing
from rbd.control.walking.walk import FAR, OFF, Walk
from rbd.errors import InputError, NoSolution
from rbd.model.state import State
from rbd.records import counted
from rbd.robots.robot import Robot

AGAIN = 0.12
"""Least time between two plans [sqrt(h / g)]."""
LIFT = 0.04
"""Height of feet in the air over what is below them, over h: lower than in a walk, so that they land sooner."""
SWINGS = (1.0, 1.4)
"""How long a foot that is lifted at once may be in the air [sqrt(h / g)]; the last, of one that follows."""
BETWEEN = 0.2
"""From when a foot is to land until the next is lifted [sqrt(h / g)]."""
STEP = 30.0
"""Cost of a step, in that of the centroid's program: fewer steps are better."""
QUICK, HASTE = 25.0, 100.0
"""Acceleration of a foot in the air [m/s2] that costs so much: legs that are thrown forward pull the trunk along."""
LOOK = 0.13
"""A push that acts is expected to last for so long [sqrt(h / g)]."""
LEVEL, FASTEST, AGREED = 0.27, 0.5, 1e-3
"""As of `rbd.control.walking.plan`: more angular momentum is allowed than in a walk, feet are not so quick from rest."""


class Balance(Walk):
    """A controller of `rbd.simulate` that stands on two feet and, pushed too far, comes to rest again by steps.

    With h the height of the centre of mass c over the feet, x = c + sqrt(h / g) c' is the capture point. Where it is off the
    plan's by more than 2 % of h, a new motion to rest is planned from the state, at most every 0.12 sqrt(h / g), by the
    centroid's program: on the feet as they stand; with a step of either foot, of two durations; and with another that follows.
    The place of each foothold is the program's, as far as feet come in the time; that of a foot in the air may land sooner.
    The plan of the least cost is followed, where each step costs something, and a hasty one more. What a single step cannot
    save is saved by those that are planned later.

    A push that acts, which is the rate of momentum less that of the contact forces, is expected to last for 0.13 sqrt(h / g).
    Impacts of feet count as pushes in the step in which they land. The plan goes on where a foot lands late. Feet stay where
    they were put down. It does not save every fall: Talos is saved from 80 N s at its torso forwards and backwards, and falls
    to the left from 65.

    Not considered: collisions of legs, but for the least distance of two feet; limits of joints and torques in the plan, which
    the controller keeps as well as it can (`log`).

    Args:
        robot: The robot, with two feet.
        terrain: What it stands on: a plane, a height [m], or `rbd.Terrain`.
        friction: Coulomb's coefficient of the contacts; the plan uses 80 % of it.
        state: Where it starts, at rest on its feet; None: standing on the ground under its standing posture.
        model: The model with which it computes, of the same joints; None: the robot itself.
        steps: Whether it takes steps; False: only motions on the feet as they stand are planned.

    Attributes:
        robot: The robot.
        state: Where it starts.
        contacts: Its feet.
        plan: What it follows now, a `WalkPlan`; its `footsteps` are those that it takes.
        plans: (time, plan) of all since the start.

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
        super().__init__(robot, [], terrain=terrain, friction=friction, state=state, model=model)
        check_flag("steps of Balance", steps)
        if len(self.contacts) != 2:
            raise InputError(
                f"{robot.name} has {counted(len(self.contacts), 'foot', 'feet')}; Balance takes steps with two. "
                "`rbd.control.Walk` walks with four, and takes up pushes on its way."
            )
        self.steps = steps
        self._before: tuple[float, Array, Array] | None = None
        self._planner = replace(
            self._planner, lift=LIFT * self._planner.h, level=LEVEL, fastest=FASTEST, agreed=AGREED, height=COM
        )  # fmt: skip
        self.reset()

    @property
    def duration(self) -> float:
        """When the plan that it follows has come to rest [s]."""
        return self.plan.duration

    def reset(self) -> None:
        """Forget the motion until now."""
        super().reset()
        self._before = None
        self._follow(self._first)

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: plan where that is needed, and compute the torques that are held.

        Raises:
            InputError: a state of another robot than before.
            NoSolution: no torques were found.
        """
        A_g, rate, mass = step.state.centroidal()
        momentum, pushed = A_g @ step.state.v, np.zeros(6)
        if self._before is not None:
            t, last, expected = self._before
            pushed = (momentum - last) / (step.t - t) - expected
        if step.t >= self._again:
            self._save(step, momentum + LOOK * self._planner.unit * pushed)
        self._control.accepted(step)
        self._before = step.t, momentum, A_g @ self._control.actuation.a + rate

    def __str__(self) -> str:
        n = len(self.plan.footsteps)
        taken = "has taken no steps" if not n else f"has taken, or takes, {counted(n, 'step')}"
        return f"{self.robot.name} stands, and {taken}"

    def _follow(self, plan: WalkPlan) -> None:
        """What carries the robot alone is not lifted before another foot has landed."""
        self.plan, wanted = plan, plan.schedule
        self._control.reschedule(ContactSchedule(wanted.intervals, fade=wanted.fade))

    def _save(self, step: AcceptedStep, momentum: Array) -> None:
        """A new plan, where the capture point is off."""
        t, state, unit = step.t, step.state, self._planner.unit
        v = momentum[:3] / self.robot.mass
        far = self._far(state, v, t)
        if far < OFF:
            return
        self._again = t + AGAIN * unit
        found = _Tried(self, t, (state.com, v, momentum[3:]), self.plan)
        found.go_on(far > FAR)
        if self.steps:
            found.step()
        if found.plans:
            best = found.best[1]
            self._follow(best)
            self.plans.append((t, best))


class _Tried:
    """Plans from one state, with their costs."""

    def __init__(self, balance: Balance, t: float, start: tuple[Array, Array, Array], plan: WalkPlan) -> None:
        self.planner, self.t, self.start, self.plan = balance._planner, t, start, plan
        self.plans = list[tuple[float, WalkPlan]]()
        self.begun = {foot: tuple(s for s in own if s.start < t) for foot, own in plan.swings.items()}
        self.to_come = sum(s.landing > t for own in plan.swings.values() for s in own)

    @property
    def best(self) -> tuple[float, WalkPlan]:
        """(cost, plan) of the least cost."""
        return min(self.plans, key=lambda each: each[0])

    def go_on(self, hurry: bool) -> None:
        """The plan as it is, from here; feet may be put down sooner."""
        try:
            found = self.planner.again(self.plan, self.t, *self.start, hurry)
        except NoSolution:
            return
        self.plans.append((self._cost(found, self.to_come), found))

    def step(self) -> None:
        """Steps that are not in the plan, unless one more would cost more than what is to be saved."""
        if self.plans and self.best[0] <= STEP * (self.to_come + 1):
            return
        unit, flying = self.planner.unit, [f for f, own in self.begun.items() if own and own[-1].landing > self.t]
        if flying:
            if self.to_come == 1:
                plan = self.best[1] if self.plans else self.plan
                self._follow(plan, flying[0], plan.swings[flying[0]][-1].landing)
            return
        before = len(self.plans)
        for foot in self.begun:
            for T in SWINGS:
                self._try(self._with(self.begun, foot, self.t, T * unit), 1)
        if len(self.plans) > before:
            cost, plan = self.best
            first = [f for f, own in plan.swings.items() if len(own) > len(self.begun[f])]
            if len(first) == 1 and cost > 2.0 * STEP:
                self._follow(plan, first[0], plan.swings[first[0]][-1].landing)

    def _follow(self, plan: WalkPlan, foot: str, landing: float) -> None:
        """The other foot follows."""
        other = next(f for f in self.begun if f != foot)
        unit = self.planner.unit
        self._try(self._with(plan.swings, other, landing + BETWEEN * unit, SWINGS[-1] * unit), 2)

    def _with(self, swings: Mapping[str, tuple[Swing, ...]], foot: str, at: float, T: float) -> Mapping[str, tuple[Swing, ...]]:
        """One more way of a foot through the air: to beside the other, as it stood at first."""
        poses = self.planner.poses
        other = next(f for f in swings if f != foot)
        here, there = (swings[f][-1].end if swings[f] else poses[f] for f in (foot, other))
        beside = there * poses[other].inverse() * poses[foot]
        end = self.planner.floor.shifted(foot, here, (beside.translation - here.translation)[:2])
        return {**swings, foot: (*swings[foot], self.planner.way(foot, here, pin.SE3(end), at, T))}

    def _try(self, swings: Mapping[str, tuple[Swing, ...]], more: int) -> None:
        try:
            found = self.planner.again(replace(self.plan, swings=swings), self.t, *self.start, False)
        except (NoSolution, InputError):
            return
        self.plans.append((self._cost(found, more), found))

    def _cost(self, plan: WalkPlan, steps: int) -> float:
        """The program's, of steps, and of feet that are lifted from now on and move fast."""
        out = plan.centroid.cost + STEP * steps
        for own in plan.swings.values():
            for s in own:
                if s.start >= self.t:
                    way = float(np.linalg.norm((s.end.translation - s.begin.translation)[:2]))
                    peak = 10.0 / math.sqrt(3.0) * way / ((s.forward[1] - s.forward[0]) * s.T) ** 2
                    out += HASTE * (peak / QUICK) ** 2
        return out
