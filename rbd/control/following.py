"""`follow`: the whole-body controller of a reference motion, its tasks and contact schedule made from that motion.

The tasks want what the motion does, by decreasing cost: where the centre of mass goes, where feet in the air go, the angular
momentum, how the base is turned, and the joints. A foot that has not touched when it was to goes on downwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_number
from rbd.constraints.constraint import Constraint, member
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.contact_schedule import ContactSchedule, Interval
from rbd.control.force_tasks import MomentumTask
from rbd.control.motion_limits import Limits
from rbd.control.schedules import check_model, checked_period
from rbd.control.task_terms import Reference, Task
from rbd.control.tasks import ComTask, FrameTask, PostureTask
from rbd.control.tracking import checked_motion, sampled
from rbd.control.whole_body import WholeBodyController
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import SampledAccelerations
from rbd.model.state import State, state_at
from rbd.robots.carried import carried_by

SINKS = 0.05
"""Speed at which the target of a foot goes down that has not landed [m/s] ..."""
AHEAD = 0.03
"""... from so long before it is to land [s] ..."""
DEEPEST = 0.01
"""... and how far at most [m]."""
SOON = 0.006
"""After a flight it goes down as fast as the centre of mass falls, from so long before it is to land [s]."""
FADE = 0.03
"""Forces of contacts rise and fall within this time [s]."""
FACETS = 8
"""Of the pyramids inside the friction cones: with four, quick clips on one foot fall."""
BRIDGED = 0.1
"""No foot carries for less than this [s] where a motion does not fly, but changes feet."""
NEAREST, BRAKES = 1e-3, 2.0
"""Joints count as no nearer to their limits [rad, m]; `Limits.braking` over the deceleration that the motion needs, of which
limits count on three quarters."""
_EVERY = 5e-3  # s between samples; the motion goes on from the nearest one with constant acceleration


class ContactTimes(Protocol):
    """When which contacts of a motion touch, as `rbd.motion.ContactTimeline` says."""

    @property
    def contacts(self) -> Sequence[Constraint]:
        """The contacts."""

    def intervals(self, name: str) -> list[tuple[float, float]]:
        """(first time, last time) of each stretch in which a contact touches [s]."""

    def stages(self, name: str) -> list[tuple[float, float, tuple[int, ...]]]:
        """(start, end, which) of each stretch in which the same corners of a contact touch [s]."""


class FollowedMotion(SampledAccelerations, Protocol):
    """Samples of a motion, and its contacts."""

    @property
    def contacts(self) -> ContactTimes | None:
        """When which of them touch; None where that is not known."""


@dataclass(frozen=True, eq=False)
class MotionTargets:
    """What the tasks of `follow` want at a time, from one state of the robot for all of them.

    Attributes:
        robot: The model of the controller.
        t: Times, shape (n,) [s].
        q: Shape (n, nq).
        v: Shape (n, nv).
        a: Shape (n, nv).
        times: {contact: when it touches [s]}.
        held: How long torques are held [s]: accelerations are those half of it later, as they are on average over that time.
        falls: {when a flight ends [s]: how fast the centre of mass falls then [m/s]}.
        last: The last time that was asked for, with the state and accelerations there; empty at first.
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array
    times: dict[str, list[Interval]]
    held: float
    falls: dict[float, float] = field(init=False)
    last: list[tuple[float, State, Array]] = field(init=False, default_factory=list)

    def at(self, t: float) -> tuple[State, Array]:
        """(state, accelerations) of the motion; before its start and after its end its pose there, at rest."""
        if not self.last or self.last[0][0] != t:
            within = min(max(t, float(self.t[0])), float(self.t[-1]))
            i = int(np.searchsorted(self.t, within))
            i -= i > 0 and within - self.t[i - 1] < self.t[i] - within
            dt, moves = within - self.t[i], float(within == t)
            q = pin.integrate(self.robot.model, self.q[i], dt * (self.v[i] + 0.5 * dt * self.a[i]))
            state = state_at(self.robot, q, moves * (self.v[i] + dt * self.a[i]), t)
            self.last[:] = [(t, state, moves * self._acceleration(within + 0.5 * self.held))]
        return self.last[0][1:]

    def __post_init__(self) -> None:
        every, falls = sorted(each for own in self.times.values() for each in own), dict[float, float]()
        reached = every[0][0] if every else 0.0
        for start, end in every:
            if start > reached:
                state = self.at(start)[0]
                falls[start] = -float((state.centroidal()[0][2] @ state.v) / self.robot.mass)
            reached = max(reached, end)
        object.__setattr__(self, "falls", falls)

    def _acceleration(self, t: float) -> Array:
        """On the straight line between two samples; zero after the last one."""
        if t > self.t[-1]:
            return np.zeros(self.robot.nv)
        i = max(int(np.searchsorted(self.t, t)), 1)
        s = (t - self.t[i - 1]) / (self.t[i] - self.t[i - 1])
        return np.asarray((1.0 - s) * self.a[i - 1] + s * self.a[i])

    def com(self, t: float) -> Reference:
        """The centre of mass."""
        state, a = self.at(t)
        A_g, bias, mass = state.centroidal()
        return Reference(state.com, A_g[:3] @ state.v / mass, (A_g[:3] @ a + bias[:3]) / mass)

    def momentum(self, t: float) -> Reference:
        """The momentum about the centre of mass."""
        state, a = self.at(t)
        A_g, bias, _ = state.centroidal()
        return Reference(A_g @ state.v, A_g @ a + bias)

    def posture(self, t: float) -> Reference:
        """The joints."""
        state, a = self.at(t)
        return Reference(state.q, state.v, a)

    def base(self, name: str, t: float) -> Reference:
        """The orientation of a base."""
        X, v, a = self._moving(name, pin.SE3.Identity(), t)
        return Reference(X.rotation, v[3:], a[3:])

    def hand(self, name: str, t: float) -> Reference:
        """The pose of a frame."""
        return Reference(*self._moving(name, pin.SE3.Identity(), t))

    def foot(self, contact: Any, offset: Array, t: float) -> Reference:
        """The pose of a foot, or the place of a point foot; about when it is to touch its target sinks."""
        X, v, a = self._moving(contact.frame, pin.SE3(np.eye(3), offset), t)
        place = X.translation.copy()
        for start, end in self.times[contact.name]:
            falls = self.falls.get(start, 0.0)
            ahead, speed, deepest = (SOON, falls, math.inf) if falls > SINKS else (AHEAD, SINKS, DEEPEST)
            if start - ahead <= t < end and 0.0 < (depth := speed * (t - max(start - ahead, float(self.t[0])))):
                place[2] -= min(depth, deepest)
                v[2] -= speed * (depth < deepest)
        return Reference(place, v[:3], a[:3]) if len(contact.corners) == 1 else Reference(pin.SE3(X.rotation, place), v, a)

    def _moving(self, frame: str, X_FP: pin.SE3, t: float) -> tuple[pin.SE3, Array, Array]:
        state, a = self.at(t)
        X, J, v, bias = state.moving(frame, X_FP, pin.LOCAL_WORLD_ALIGNED)
        return X, np.array(v), J @ a + bias


def bridged(times: dict[str, list[Interval]]) -> dict[str, list[Interval]]:
    """The same contacts, in which a foot that leaves about when the next one lands stays until that one carries.

    Lanes tell frames: between two feet that change in an instant they leave some out. Forces of both fade, and so overlap.
    """
    out: dict[str, list[Interval]] = {name: [] for name in times}
    for name, own in times.items():
        others = [each for other, intervals in times.items() if other != name for each in intervals]
        for k, (start, end) in enumerate(own):
            again = own[k + 1][0] if k + 1 < len(own) else math.inf
            if not any(x <= end - FADE and y >= end for x, y in others):
                end = next((min(x + FADE, again - FADE) for x, _ in sorted(others) if end - FADE < x <= end + BRIDGED), end)
            out[name].append((start, end))
    return out


def follow(
    motion: FollowedMotion,
    *,
    robot: CheckedModel | None = None,
    friction: float = 0.6,
    every: float | None = 4e-3,
) -> WholeBodyController:
    """The controller that follows a motion on its contacts: torques within limits, and feedback that takes up disturbances.

    Its times are those of the simulation, which begins at that of its state: `motion.state(0)` has the first. Before the motion
    begins its first pose is held, after its end its last one. It should be possible
    (`rbd.check_motion`): what it misses of balance, friction or torque the controller has to miss as well, and falls where that
    is much. Tasks, with their costs and gains (k; momentum: 1/s), each with velocity and acceleration of the motion::

        centre of mass         10000    100
        feet in the air, each   1000    900      place; of soles also orientation, 200
        angular momentum          30      5
        orientation of the base    5    100
        joints                     1    100
        hands that carry, each    30    900      place; of orientation, 3

    Feet touch when `motion.contacts` says so, and forces rise and fall within 30 ms. Where one or two of a foot's corners
    touch for more than 0.1 s it stands on these, and turns about that edge as the motion does; else on its whole sole. From
    30 ms before a foot is to touch its target sinks at 50 mm/s, by 10 mm at most, until it does: one that is late would
    otherwise hover, and the robot fall. After a flight it sinks as fast as the centre of mass falls, from 6 ms before: a foot
    that slowed down instead, and touched early, would be lifted again by its own torques.

    Accelerations are those of the motion in the middle of the time for which torques are held; those at its beginning are late
    by half of it. Joints may brake as hard as the motion does near the ends of their ranges (`Limits.braking`).

    On terrain (`motion.ground`) its feet touch that; where it has a coefficient of friction the controller counts on that one.

    What the motion's robot carries (`motion.carrying`) the controller reckons with; in `robot` it may weigh more or less.

    Args:
        motion: An `rbd.Motion` with contacts; or what has a robot, t, q, v, a and contacts. Of a robot on a fixed base it needs
            none.
        robot: The model with which the controller computes, of the same joints; None: that of the motion.
        friction: Coulomb's coefficient that the controller counts on; at most that of the floor.
        every: Time between two steps of control [s]; None: every step of the simulation is one.

    Returns:
        A controller for `rbd.simulate`, to be given with the robot's feet, `robot.feet(on=motion.ground)`; other tasks or
        limits by `dataclasses.replace`.

    Raises:
        InputError: no motion, one without contacts, one that touches with other bodies than feet; numbers out of range.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> stand = talos.standing()
        >>> bent = stand.with_joints({"arm_left_4_joint": -1.4, "arm_right_4_joint": -0.4})
        >>> wave = rbd.motion.minimum_jerk(talos, [stand.q, bent.q, stand.q], [0.0, 0.3, 0.6])
        >>> wave = wave.with_contacts(rbd.motion.find_contacts(wave))
        >>> controller = rbd.control.follow(wave)
        >>> run = rbd.simulate(wave.state(0), talos.soles(), duration=0.6, step=4e-3, controller=controller, progress=False)
        >>> off = rbd.motion.MotionDifference.of(run, wave)
        >>> print(f"base {1e3 * np.abs(off.base).max():.1f} mm, joints {off.joint_rms:.4f} rad")
        base 0.8 mm, joints 0.0076 rad
    """
    checked_motion(motion)
    check_model("follow", robot)
    friction = check_number("friction of follow", friction, 1e-6, 1e3, expected="a coefficient above 0")
    held = 0.0 if every is None else checked_period("every of follow", every)
    if robot is not None:
        State(motion.robot, motion.q[0]).on(robot)  # which raises if its joints differ
    model, begin, end = robot or motion.robot, float(motion.t[0]), float(motion.t[-1])
    lanes: ContactTimes | None = getattr(motion, "contacts", None)
    if lanes is None and len(model.unactuated):
        raise InputError(
            f"the motion of {model.name} has no contacts, and follow wants to know when its feet touch: give it "
            "motion.with_contacts(rbd.motion.find_contacts(motion)) of a motion that is possible, or the repaired one, "
            "rbd.check_motion(motion).repaired(), which has them."
        )
    feet, times, parts = list[Any](), dict[str, list[Interval]](), dict[str, list[tuple[float, float, tuple[int, ...]]]]()
    for contact in () if lanes is None else lanes.contacts:
        each = [] if lanes is None else [(x, y) for x, y in lanes.intervals(contact.name) if x < y]
        if (corners := member(contact, "corners")) is not None:
            feet.append(contact)
            stages = [] if lanes is None or len(corners) < 3 else lanes.stages(contact.name)
            parts[contact.name] = [each for each in stages if len(each[2]) < 3 and each[1] - each[0] > BRIDGED]
            times[contact.name] = [(x if x > begin else -math.inf, y if y < end else math.inf) for x, y in each]
        elif each:
            raise InputError(
                f"the motion touches with {contact.name!r:.80} from {each[0][0]:.3f} to {each[0][1]:.3f} s, and follow knows "
                "feet alone: name its frame as a foot, rbd.load_robot(file, feet=[...]), or leave that contact out, "
                "motion.with_contacts(motion.contacts.of(names, intervals))."
            )
    times = bridged(times)
    t, q, v, a = sampled(motion, _EVERY)
    targets = MotionTargets(model, t, q, v, a, times, held)
    tasks: list[Task] = [
        ComTask(targets.com, cost=10000.0, gain=100.0),
        MomentumTask(targets.momentum, angular_cost=30.0, gain=5.0),
        PostureTask(targets.posture, cost=1.0, gain=100.0),
    ]
    for name in [model.model.names[joint] for joint in model.bases]:
        tasks.append(FrameTask(name, partial(targets.base, name), orientation_cost=5.0, gain=100.0))
    for foot in feet:
        offset = foot.placement.act(foot.corners.mean(axis=0))
        target = partial(targets.foot, foot, offset)
        tasks.append(
            FrameTask(
                foot.frame, target, offset=offset, position_cost=1000.0, orientation_cost=200.0, gain=900.0, name=foot.name
            )
        )
    for hand in dict.fromkeys(name for each in carried_by(motion.robot) for name in each.grasps):
        tasks.append(FrameTask(hand, partial(targets.hand, hand), position_cost=30.0, orientation_cost=3.0, gain=900.0))
    # A foot is lifted when the motion lifts it: one that were kept until the other lands would be dragged along.
    schedule = ContactSchedule(times, fade=FADE, flight=True, parts=parts)
    if isinstance(ground := member(motion, "ground"), Terrain):
        feet, friction = [foot.with_ground(ground) for foot in feet], friction if ground.friction is None else ground.friction
    contacts = [foot.with_friction(friction, facets=FACETS) for foot in feet]
    return WholeBodyController(tasks, contacts, schedule=schedule, every=every, robot=robot, limits=_limits(model, q, v, a))


def _limits(robot: CheckedModel, q: Array, v: Array, a: Array) -> Limits:
    """Limits within which joints come as near to the ends of their ranges at speed as the motion itself does."""
    usual = Limits()
    joints, d = usual.joints(robot), usual.horizon
    x, speed, sign = q[:, joints.q], np.abs(v[:, joints.at]), np.sign(v[:, joints.at])
    then = speed + d * sign * a[:, joints.at]
    room = np.where(sign > 0.0, joints.highest - x, x - joints.lowest) - 0.5 * d * (speed + then)
    needs = np.maximum(then, 0.0) ** 2 / (2.0 * np.maximum(room, NEAREST))
    return replace(usual, braking=max(usual.braking, BRAKES * float(needs.max(initial=0.0))))
