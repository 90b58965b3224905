"""`Walk`: a controller that walks, with footsteps, timing and motion of the centre of mass of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, check_flag, check_number, check_whole
from rbd.constraints.contact import Contact
from rbd.constraints.surface import On, plane_of
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.control_log import ControlLog
from rbd.control.force_tasks import MomentumTask
from rbd.control.motion_limits import Limits
from rbd.control.schedules import AcceptedStep, check_model
from rbd.control.task_terms import Reference, Task, TaskTerms
from rbd.control.tasks import ComTask, FrameTask, PostureTask
from rbd.control.walking.arms import ArmsGiven, HeldArms, arms_of, given_arms, leg_joints
from rbd.control.walking.footsteps import FLAT, Floor, Footstep, centre_of, steps_of
from rbd.control.walking.gaits import TWO, Gait, gait_of, heading_of, roles_of
from rbd.control.walking.legs import carrying, check_legs, inertia_on_feet, turning_range
from rbd.control.walking.plan import Planner, WalkPlan
from rbd.control.walking.swings import smooth
from rbd.control.whole_body import WholeBodyController
from rbd.displayed import Displayed
from rbd.errors import CannotReach, InputError, NoSolution
from rbd.errors.inputs import check_kind, check_known, listed_items
from rbd.mechanism.pose_search import find_pose
from rbd.model.joints import Joint
from rbd.model.state import State
from rbd.problem.ground import Ground
from rbd.robots.robot import Robot

MARGIN = 1e-4
"""Joints stop so far before their limits [rad, m]: positions drift by some 1e-5 while torques are held."""
OFF, FAR = 0.02, 0.04
"""A capture point that is so far off the plan's, over h, makes a new plan; one that may also hurry feet ..."""
ROLLS = 0.115
"""A plan that rolls the body by more is refused [rad]: of eight robots in a pace those that roll by less walk, others fall."""
AGAIN = 0.25
"""... but not more often than every [sqrt(h / g)]."""
SIZE = 0.877
"""Costs and gains of tasks are those of a robot of this h [m]; on four feet they grow with smaller h, as lengths and times do.
On two they do not: with larger ones G1 (h = 0.67 m) fell after pushes that it takes up with these."""
WEIGHED = 1.0
"""Time in which what the model weighs too much or too little is taken up [sqrt(h / g)]."""
STARTS = 3.0
"""When the first foot is lifted [sqrt(h / g)]."""
WEAK = 1.15
"""A walk is refused if forces of its plan need more than this many times a joint's torque limit; on point feet, more than the
limit itself. Where they need less, the centre of mass sinks a little. Romeo's first steps need 1.04; a human who fell on
stairs of 7 cm needed 1.25."""
RISE = 0.18
"""A foot is put at most so much higher or lower than the others, over h."""
REACHED = 0.1
"""A footstep is out of reach where feet or the centre of mass are off by more in every pose, over h."""
LONGEST, TURNS, TURNED = 2.0, 0.5, 0.5
"""Most that the body moves in one swing and overlap, in strides of its gait; most that it turns in it [rad]; and on two feet,
as a share of the angle between them that legs allow: a foot turns by twice as much before the other follows."""
BETWEEN, BEHIND, QUICK = 3, 1e-3, 0.9
"""Speeds are checked at three times as many poses of a swing as torques; a joint within 1e-3 rad of its pose has reached it.
Nine tenths of its speed have to be enough: of Romeo, who turns at 0.15 rad/s, and falls at 0.17, hips need 0.85 and 0.94."""
EASY, SHORTER, SHORTEST = 0.4, 0.8, 0.3
"""On two feet and a plane, joints need at most 0.4 of their speeds to go forwards; strides that are not given are shortened by
0.8 until they do, to 0.3 of their length. The usual one of Romeo needs 0.6: his hips lag behind, the body pitches, and he
falls; of others at most 0.2. Walks aside and turns that need more stand. On stairs strides have to fit."""
_Pose = tuple[float, State]
"""When, and how the robot stands then."""
_Poses = tuple[list[_Pose], list[tuple[Footstep, list[_Pose]]]]
"""Poses of a plan, and more of them of each swing."""


class Walk(Displayed):
    """A controller of `rbd.simulate` that walks: footsteps, their times, the centre of mass over them, and feet in the air.

    The plan has the feet put down by the gait in its order, each time where the standing robot has it, seen from a body that
    moves with the velocity; over them the centroid's program (`rbd.centroid`) finds a motion of the centre of mass whose forces
    are in the friction cones of the corners that stand, at all times, with the least angular momentum. A whole-body controller
    follows it: centre of mass, angular momentum, base, feet in the air, posture.

    With h the height of the centre of mass over the feet and c its place, x = c + sqrt(h / g) c' is the capture point. Where
    it is off the plan's by more than 2 % of h, the rest of the walk is planned anew from there, at most every 0.25 sqrt(h / g):
    footholds to come are shifted, as far as feet come and stay on their own side; where it is off by more than 4 %, feet are
    put down or lifted sooner, or put down later and elsewhere, if that costs less, and the steps after are quicker: x runs away
    from where a foot pushes by exp(t / sqrt(h / g)), so over a shorter step it may begin farther off, with room for errors.
    So pushes are taken up by steps.

    Arms swing against the legs, a hand by 0.4 of how far the foot of the other side is before its own, held aside by as little
    as keeps them 3 cm from legs and trunk in poses of the plan.

    Not considered: collisions of legs, but for the least distance of two feet; limits of joints and torques in the plan, which
    the controller keeps as well as it can (`log`).

    Args:
        robot: The robot, with two or four feet.
        steps: How many times a foot (of four: a group of the gait) is lifted; or `Footstep` records in any order.
        velocity: (forwards, to the left, turn to the left) of the body [m/s, m/s, rad/s]; None: forwards, as usual of the gait,
            but on two feet and a plane with shorter strides where joints would need more than 40 % of their speeds; forwards or
            backwards faster than that is refused.
            Forwards is along x of the base, or where toes clearly point backwards (iCub's), along -x.
        terrain: What it walks on: a plane, a height [m], or `rbd.Terrain`; a sole is put down where it rests wholly, at most
            20 cm before or behind, and feet clear what lies between.
        gait: "walk" of two feet; "crawl", "trot", "pace", "bound" of four; or a `Gait`. None: the first of these.
        friction: Coulomb's coefficient of the contacts; the plan uses 80 % of it.
        state: Where it starts, at rest on its feet; None: standing on the ground under its standing posture, facing along x.
        model: The model with which it computes, of the same joints; None: the robot itself.
        adapts: Whether it plans again on the way; not in gaits with flight, whose tilt a new plan does not know.
        arms: Whether arms swing, where there is one on each side; False: they follow the posture of the start. Or
            {joint: angle} [rad], also of head and trunk: held at these from the first step on; or a function of time that
            gives them.

    Attributes:
        robot: The robot.
        state: Where it starts.
        contacts: Its feet.
        gait: The gait.
        plan: What it follows now, a `WalkPlan`.
        plans: (time, plan) of those that were made on the way.

    Raises:
        InputError: velocities that are too fast, with the limit; gaits that take too much of torques or speeds, or roll too
            far; a footstep without a place to stand on; one out of reach, with the nearest place that is not; wrong kinds.
        ModelError: a robot without feet; two feet that are points; feet that joints move in too few directions.
        SingularInertia: M is singular where it starts.
        CannotReach: it cannot stand on the ground where it starts.
        NoSolution: there is no motion of the centre of mass over the footsteps.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> walk = rbd.control.Walk(solo, 2, gait="trot")
        >>> run = rbd.simulate(walk.state, walk.contacts, duration=walk.duration, step=2e-3, controller=walk, progress=False)
        >>> print(f"{run.com[-1, 0] - run.com[0, 0]:.3f} m, {walk.log.violations} violated steps")
        0.042 m, 0 violated steps
    """

    _costs: ClassVar[tuple[float, Any, float, float, float]] = 1000.0, 10.0, 0.5, 0.35, 0.07
    """Of the centre of mass, of how the base is turned, of the posture, of that of a leg that stands, and of one in the air.

    A leg that is nearly straight bends its knee by 170 rad/s2 to lift its foot. Where its posture costs 0.5 then, half of this
    is left to the body: iCub and a human jumped on stairs, and fell; they and G1 climb them at 0.05 to 0.1. Where legs that
    stand cost 0.005, G1 stretches a knee until it turns over; at 0.2 Romeo falls on a slope, and at 0.5 iCub on stairs."""

    def __init__(
        self,
        robot: Robot,
        steps: int | Sequence[Footstep] = 6,
        velocity: Sequence[float] | Array | None = None,
        *,
        terrain: On = 0.0,
        gait: str | Gait | None = None,
        friction: float = 0.6,
        state: State | None = None,
        model: Robot | None = None,
        adapts: bool = True,
        arms: ArmsGiven = True,
    ) -> None:
        check_kind("the robot of Walk", robot, Robot, "a robot: rbd.load_robot(name)")
        check_model("Walk", model)
        check_flag("adapts of Walk", adapts)
        check_number("friction of Walk", friction, 1e-3, 1e3, expected="a coefficient above 0")
        on = terrain if isinstance(terrain, Terrain) else plane_of("Walk", terrain)
        self.robot = robot
        robot.feet(friction=friction, on=on)  # refuses a robot without
        if not robot.floating:
            raise InputError(f"{robot.name} has no floating base, and cannot walk; load it without root=.")
        if state is None:
            state = standing_on(robot, on)
        check_kind("state of Walk", state, State, "a State of its robot")
        self.state = state.on(robot)
        self.contacts = robot.feet(friction=friction, on=on, at=self.state)
        feet = {foot.name: foot for foot in self.contacts}
        poses = contacts_at(self.state, self.contacts)
        centres = np.array([X.translation for X in poses.values()])
        self._base = robot.model.names[robot.bases[0]]
        R = self.state.frame(self._base).X_WF.rotation
        yaw = heading_of(self.state, self.contacts)
        h = float(self.state.com[2] - centres[:, 2].mean())
        if not h > 0.0:
            raise InputError(f"the centre of mass of {robot.name} is {h:.3g} m above its feet; expected it over them.")
        check_legs(self.state, self.contacts, h)
        unit = math.sqrt(h / float(np.linalg.norm(robot.gravity)))
        self.gait = gait_of(gait, len(feet))
        roles, floor = roles_of(robot, self.contacts, centres, yaw), Floor(on, feet, RISE * h)
        poses |= {name: floor.pose(name, X.translation, yaw) for name, X in poses.items() if len(feet[name].corners) == 1}
        self._planner = Planner(
            robot, floor, poses, carrying(self.state, self.contacts, h), self.state.com, yaw, h, unit, friction,
            self.gait.lift * h, min(0.05, max(0.4 * self.gait.overlap * unit, 0.004)), self.gait.tilt,
            self.gait.overlap, inertia_on_feet(self.state, self.contacts),
        )  # fmt: skip
        self._two = tuple(roles[side] for side in TWO) if len(feet) == 2 else ()
        self._legs = {name: self._leg(feet[name]) for name in self._two}
        if isinstance(steps, int | np.integer):
            n, whole = check_whole("steps of Walk", int(steps), 10_000), self._advance(velocity)
            counted = partial(steps_of, floor, poses, roles, self.gait, n, start=STARTS * unit, unit=unit, yaw=yaw)
            poses_of_plan, swings = self._planned(counted(whole))
            if self._two and whole[0] and not isinstance(on, Terrain):
                poses_of_plan, swings = self._easy(counted, whole, (poses_of_plan, swings), given=velocity is not None)
        else:
            poses_of_plan, swings = self._planned(self._given(steps))
        for step, poses_of_swing in swings:
            self._check_speed(step, poses_of_swing)
        self.adapts, self.plan, self.plans = adapts, self._first, list[tuple[float, WalkPlan]]()
        self._arms = self._arms_of(arms, poses_of_plan)
        self._again, self._lift = -math.inf, np.zeros(3)
        self._seen: tuple[float, float, float] | None = None
        self._control = WholeBodyController(
            self._tasks(R), self.contacts, schedule=self.plan.schedule, robot=model, limits=Limits(margin=MARGIN)
        )

    @property
    def duration(self) -> float:
        """When the first plan has come to rest [s]."""
        return self._first.duration

    @property
    def log(self) -> ControlLog:
        """What it did since the start of the motion."""
        return self._control.log

    @property
    def every(self) -> float | None:
        """Time between two steps of control [s]; None: every step of the simulation is one."""
        return self._control.every

    def reset(self) -> None:
        """Forget the motion until now."""
        self.plan, self._again, self.plans = self._first, -math.inf, []
        self._seen, self._lift = None, np.zeros(3)
        self._control.reset()

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: plan again where that is needed, and compute the torques that are held.

        Raises:
            InputError: a state of another robot than before.
            NoSolution: no torques were found.
        """
        if self.adapts and not self.gait.flies:
            self._weigh(step.state, step.t)
            self._adapt(step.state, step.t)
        self._control.accepted(step)
        A_g, rate, _ = step.state.centroidal()
        self._seen = step.t, float(A_g[2] @ step.state.v), float(A_g[2] @ self._control.actuation.a + rate[2])

    def __call__(self, state: State, t: float) -> Array:
        """The torques that are held, shape (nu,) [N, N m].

        Raises:
            InputError: a state of another robot; or it was not told of a step.
        """
        return self._control(state, t)

    def __str__(self) -> str:
        return f"{self._first}{f'; planned {len(self.plans)} times more on the way' if self.plans else ''}"

    def _tasks(self, R: Array) -> list[Task]:
        """What is followed; the base more firmly where it is to tilt, all more firmly by small robots on four feet."""
        com, firm, *_ = self._costs
        firm, size = 100.0 if self.gait.tilt else firm, 1.0 if len(self.contacts) == 2 else self._planner.h / SIZE
        tasks: list[Task] = [
            ComTask(self._com, cost=com / size**2, gain=60.0 / size),
            MomentumTask(self._momentum, angular_cost=3.0 / size**4, gain=5.0 / math.sqrt(size)),
            FrameTask(self._base, partial(self._turned, R), orientation_cost=firm, gain=80.0 / size),
            _Posture(self.state.q if self._arms is None else self._posture, gain=40.0 / size, costs=self._posture_costs),
        ]
        for foot in self.contacts:
            offset = foot.placement.act(foot.corners.mean(axis=0))
            tasks.append(
                FrameTask(
                    foot.frame, partial(self._foot, foot), offset=offset, position_cost=1000.0 / size**2,
                    orientation_cost=200.0, gain=400.0 / size, name=foot.name,
                )
            )  # fmt: skip
        return tasks

    def _posture_costs(self, t: float) -> Array:
        """Cost of the posture of each joint with a motor; on four feet those of legs count as others."""
        *_, usual, standing, in_air = self._costs
        out = np.full(len(self.robot.actuated_names), usual)
        for foot, leg in self._legs.items():
            swing = self.plan.swing(foot, t)
            out[leg] = standing if swing is None or not swing.start <= t < swing.landing else in_air
        return out

    def _leg(self, foot: Contact) -> list[int]:
        """Where a leg's joints are among those with a motor."""
        of_leg = leg_joints(self.robot, [foot])
        return [k for k, name in enumerate(self.robot.actuated_names) if self.robot.joints[name].id in of_leg]

    def _advance(self, velocity: Any) -> Array:
        """How far the body moves forwards and aside, and turns, in one swing and overlap [m, rad]."""
        gait, planner = self.gait, self._planner
        period, stride = (gait.swing + gait.overlap) * planner.unit, gait.stride * planner.h
        if velocity is None:
            return np.array([stride, 0.0, 0.0])
        v = as_finite("velocity of Walk", velocity, (3,))
        turns = TURNS
        if self._two and v[2]:
            turns = min(turns, TURNED * turning_range(self.robot, self.state, planner.poses, self._two[0]))
        most = np.array([LONGEST * stride, 0.5 * LONGEST * stride, turns]) / period
        if (np.abs(v) > most * (1.0 + 1e-9)).any():
            raise InputError(
                f"velocity of Walk is {np.round(v, 4).tolist()}; expected at most {most[0]:.3g} m/s forwards or backwards, "
                f"{most[1]:.3g} m/s aside and {most[2]:.3g} rad/s of {self.robot.name} in this gait, or a longer stride."
            )
        return v * period

    def _given(self, steps: Any) -> list[Footstep]:
        """Footsteps of a user, checked."""
        out = listed_items("steps of Walk", steps, "a number, or a list of rbd.control.Footstep")
        before: dict[str, float] = {}
        for step in sorted(out, key=lambda one: getattr(one, "start", 0.0)):
            check_kind("a step of Walk", step, Footstep, "rbd.control.Footstep(foot, pose, start, end)")
            check_known("a step of Walk is of foot", step.foot, self._planner.poses)
            if step.start < before.get(step.foot, 0.0):
                raise InputError(
                    f"{step.foot!r:.80} is to be lifted at {step.start:g} s; it stands from {before.get(step.foot, 0.0):g} s."
                )
            before[step.foot] = step.end
            x, y, z = step.pose.translation
            height, n = self._planner.floor.height(x, y)
            off = (z - height) * float(n[2])
            if abs(off) > 1e-3 or float(n @ step.pose.rotation[:, 2]) < 1.0 - FLAT:
                raise InputError(
                    f"the step of {step.foot!r:.80} to {np.round([x, y, z], 3).tolist()} is {1e3 * abs(off):.1f} mm "
                    f"{'above' if off > 0 else 'inside'} the ground, or leans on it; expected z = {height:.4f} m, and its "
                    f"axis z along {np.round(n, 3).tolist()}."
                )
        return out

    def _planned(self, steps: Sequence[Footstep]) -> _Poses:
        """Make the first plan; its poses, see `_check_reach`."""
        self._first = self._planner.over(steps)
        self._check_roll()
        return self._check_reach()

    def _easy(self, counted: Callable[[Array], list[Footstep]], whole: Array, planned: _Poses, *, given: bool) -> _Poses:
        """The plan with shorter strides where joints need too much of their speed to go forwards; strides given are refused."""
        first, share, tried = self._first, 1.0, planned
        if given and whole[1:].any():
            tried = self._planned(counted(whole * [1.0, 0.0, 0.0]))
        while any(self._behind(poses, EASY)[0] > BEHIND for _, poses in tried[1]):
            share *= SHORTER
            if share < SHORTEST:
                break
            tried = self._planned(counted(share * whole * [1.0, 0.0, 0.0]))
        if not given and share >= SHORTEST:
            return tried
        if SHORTEST <= share < 1.0:
            period = (self.gait.swing + self.gait.overlap) * self._planner.unit
            way = "forwards" if whole[0] > 0.0 else "backwards"
            raise InputError(
                f"{self.robot.name} is too slow to walk {way} at {abs(whole[0]) / period:.3g} m/s: its legs would need more "
                f"than {EASY:.0%} of their speeds, hips lag behind, and it falls. Give at most "
                f"{share * abs(whole[0]) / period:.3g} m/s, or a gait with longer swings."
            )
        self._first = first
        return planned

    def _check_reach(self) -> _Poses:
        """Poses of the plan and their times, and more of them of each swing.

        Refused are footsteps without a pose, or with one that takes too large torques.
        """
        plan, out, swings = self._first, list[_Pose](), list[tuple[Footstep, list[_Pose]]]()
        for step in plan.footsteps:
            known = list[_Pose]()
            for i, t in enumerate(np.linspace(step.start, step.end, 3 * BETWEEN + 1).tolist()):
                targets = places_of(self.contacts, {foot.name: plan.placed(foot.name, t) for foot in self.contacts})
                near = self._carried(t)
                try:
                    near = find_pose(self.robot, targets, posture=near, com=plan.com(t).value).state
                    known.append((t, near))
                    if i % BETWEEN == 0:
                        self._check_strength(near, t)
                        out.append((t, near))
                except CannotReach as error:
                    worst = max((max(miss.distance, 0.1 * miss.angle) for miss in error.misses.values()), default=math.inf)
                    if worst < REACHED * self._planner.h:
                        continue
                    pose = near if error.q is None else State(self.robot, error.q)
                    reached = contacts_at(pose, self.contacts)[step.foot].translation
                    place = np.round(step.pose.translation, 3).tolist()
                    raise InputError(
                        f"the step of {step.foot!r:.80} to {place} m, {step.start:.2f} to {step.end:.2f} s, is out of reach: "
                        f"at {t:.2f} s the nearest pose is {1e3 * worst:.0f} mm off, with this foot at "
                        f"{np.round(reached, 3).tolist()} m. Give shorter steps, or a slower velocity."
                    ) from error
            swings.append((step, known))
        return out, swings

    def _behind(self, poses: Sequence[_Pose], share: float) -> tuple[float, Joint | None]:
        """How far a joint of the legs, at this share of its speed, is behind its pose when a foot lands [rad], and which."""
        legs = leg_joints(self.robot, self.contacts)
        joints = [j for j in self.robot.joints.values() if j.nq == 1 and j.id in legs]
        speed, at = np.array([j.speed for j in joints]), [j.q.start for j in joints]
        if not poses or not joints:
            return 0.0, None
        reached, before = poses[0][1].q[at], poses[0][0]
        for t, pose in poses[1:]:
            far = share * speed * (t - before)
            reached, before = reached + np.clip(pose.q[at] - reached, -far, far), t
        behind = np.abs(poses[-1][1].q[at] - reached)
        return float(behind.max()), joints[int(behind.argmax())]

    def _check_speed(self, step: Footstep, poses: Sequence[_Pose]) -> None:
        """Refuse a swing after which a joint of the legs, at 90 % of its speed, is behind its pose when the foot lands."""
        behind, joint = self._behind(poses, QUICK)
        if joint is not None and behind > BEHIND:
            raise InputError(
                f"{self.robot.name} is too slow for this walk: {joint.name!r:.80}, at {QUICK:.0%} of {joint.speed:.3g} rad/s, "
                f"is {behind:.3f} rad behind when {step.foot!r:.80} lands at {step.end:.2f} s. Give a slower velocity, or a "
                "gait with longer swings."
            )

    def _arms_of(self, given: Any, poses: Sequence[_Pose]) -> HeldArms | None:
        """How arms are held; None: as at the start."""
        start, robot = self.state.q, self.robot
        if not isinstance(given, bool):
            return given_arms(robot, self.contacts, start, given)
        arms = arms_of(self.state, self.contacts, self._planner.yaw, self._planner.h) if given and self._two else ()
        found = HeldArms(robot, start, start, arms)
        return found.clear_in([pose.q for _, pose in poses], [self._lead(t) for t, _ in poses]) if arms else None

    def _lead(self, t: float) -> float:
        """How far the right foot is before the left one, more than at the start [m]."""
        left, right = self._two
        angle = self._planner.yaw + self.plan.turn(t)
        off = self.plan.placed(right, t).translation - self.plan.placed(left, t).translation
        start, poses = self._planner.yaw, self._planner.poses
        at_first = poses[right].translation - poses[left].translation
        return float(off[:2] @ [math.cos(angle), math.sin(angle)] - at_first[:2] @ [math.cos(start), math.sin(start)])

    def _posture(self, t: float) -> Reference:
        """Where joints are to be: as at the start, but for the arms."""
        assert self._arms is not None
        dt, T, model = 1e-3, STARTS * self._planner.unit, self.robot.model
        swings = bool(self._arms.arms)
        before, now, after = (
            self._arms.posture(x, float(smooth(x, T)[0]), self._lead(x) if swings else 0.0) for x in (t - dt, t, t + dt)
        )
        ahead, behind = pin.difference(model, now, after), pin.difference(model, before, now)
        return Reference(now, (ahead + behind) / (2.0 * dt), (ahead - behind) / dt**2)

    def _carried(self, t: float) -> State:
        """The posture of the start, moved with the plan's centre of mass and turned with it."""
        q, plan = self.state.q.copy(), self._first
        X, R = pin.XYZQUATToSE3(q[:7]), pin.rpy.rpyToMatrix(0.0, 0.0, plan.turn(t))
        place = plan.com(t).value + R @ (X.translation - self.state.com)
        q[:7] = pin.SE3ToXYZQUAT(pin.SE3(R @ X.rotation, place))
        return State(self.robot, q)

    def _check_roll(self) -> None:
        """Refuse plans that roll the body far."""
        plan, x = self._first, self.state.frame(self._base).X_WF.rotation[:, 0]
        roll = max(abs(float(x @ plan.tilt(t, 0.0)[0])) for t in plan.t)
        if roll > ROLLS:
            raise InputError(
                f"in this gait the body of {self.robot.name} would roll by {roll:.2f} rad; at most {ROLLS} is taken. Give "
                "another gait, or a rbd.control.Gait with shorter swings."
            )

    def _check_strength(self, pose: State, t: float) -> None:
        """Refuse what takes more than the torque limits: tau = J_c^T F - sum J_i^T f_i, all bodies accelerated alike."""
        robot, plan = self.robot, self._first
        forces = plan.centroid.forces[min(int(np.searchsorted(plan.t, t)), len(plan.centroid.forces) - 1)]
        places = [(f, f.placement.act(p)) for f in self.contacts for p in self._planner.points[f.name]]
        J = np.array([pose.frame(f.frame, p).J[:3, robot.motors] for f, p in places])
        of_com = pose.centroidal()[0][:3, robot.motors] / robot.mass
        use = robot.torque_use((forces.sum(axis=0) @ of_com - np.einsum("kd,kdj->j", forces, J))[None])[0]
        j = int(use.argmax())
        if use[j] > (WEAK if len(places) > len(self.contacts) else 1.0):
            raise InputError(
                f"{robot.name} is too weak for this walk: at {t:.2f} s the plan's forces take {use[j]:.2f} times the torque "
                f"limit of {robot.joints.at_v(int(np.arange(robot.nv)[robot.motors][j])).name!r}. Give a gait with more feet "
                "on the ground, lower stairs, or a slower velocity."
            )

    def _adapt(self, state: State, t: float) -> None:
        """Plan again where the capture point is off the plan's."""
        unit, (A_g, _, mass) = self._planner.unit, state.centroidal()
        momentum = A_g @ state.v
        v = momentum[:3] / mass
        far = self._far(state, v, t)
        if t < self._again or (far < OFF and t < self.plan.until):
            return
        self._again = t + AGAIN * unit
        try:
            self.plan = self._planner.again(self.plan, t, state.com, v, momentum[3:], far > FAR)
        except NoSolution:  # the plan before goes on
            return
        self.plans.append((t, self.plan))
        self._control.reschedule(self.plan.schedule)

    def _far(self, state: State, v: Array, t: float) -> float:
        """How far the capture point is off the plan's, over h, with a velocity v of the centre of mass."""
        known = self.plan.com(t)
        off = (state.com - known.value) + self._planner.unit * (v - known.velocity)
        return float(np.linalg.norm(off[:2])) / self._planner.h

    def _weigh(self, state: State, t: float) -> None:
        """Take up what a model weighs too much or too little: how much less c was accelerated than the step before expected."""
        if self._seen is None:
            return
        (before, momentum, expected), (A_g, _, mass) = self._seen, state.centroidal()
        off = (float(A_g[2] @ state.v - momentum) / (t - before) - expected) / mass
        self._lift[2] -= min((t - before) / (WEIGHED * self._planner.unit), 1.0) * (off + self._lift[2])

    def _com(self, t: float) -> Reference:
        known = self.plan.com(t)
        return known._replace(acceleration=np.asarray(known.acceleration) + self._lift)

    def _momentum(self, t: float) -> Reference:
        return self.plan.momentum(t)

    def _turned(self, R: Array, t: float) -> Reference:
        """How the base is turned: with the feet, and tilted as the angular momentum has it."""
        dt = 1e-3
        before, turn, after = (self.plan.turn(t + by) for by in (-dt, 0.0, dt))
        angle, rate, acceleration = self.plan.tilt(t, turn)
        rate[2] = (after - before) / (2.0 * dt)
        return Reference(pin.exp3(angle) @ pin.rpy.rpyToMatrix(0.0, 0.0, turn) @ R, rate, acceleration)

    def _foot(self, foot: Contact, t: float) -> Reference:
        """Where a foot in the air is to be; of a point its place alone."""
        swing = self.plan.swing(foot.name, t)
        X, v, a = (self.plan.poses[foot.name], np.zeros(6), np.zeros(6)) if swing is None else swing.at(t)
        a[:3] += self._lift
        if len(foot.corners) == 1:
            return Reference(X.translation, v[:3], a[:3])
        return Reference(pin.SE3(X.rotation @ foot.placement.rotation.T, X.translation), v, a)


@dataclass(frozen=True, eq=False)
class _Posture(PostureTask):
    """A posture whose costs change with time: `costs(t)`, shape (joints,)."""

    costs: Callable[[float], Array]

    def terms(self, state: State, t: float) -> TaskTerms:
        rows = super().terms(state, t)
        return TaskTerms.unchecked(rows.name, rows.A, rows.wanted, self.costs(t))


def contacts_at(state: State, feet: Sequence[Contact]) -> dict[str, pin.SE3]:
    """{foot: pose of the middle of its contact}."""
    return {foot.name: centre_of(state, foot) for foot in feet}


def places_of(feet: Sequence[Contact], poses: Mapping[str, pin.SE3]) -> dict[Any, Any]:
    """Targets of `find_pose`: poses of soles, places of points."""
    return {f.name: poses[f.name] if len(f.corners) > 1 else poses[f.name].translation for f in feet}


def standing_on(robot: Robot, on: Ground | Terrain) -> State:
    """The standing posture on a plane or terrain, its centre of mass as high over the feet as on level ground.

    In place, but turned where it does not face along x.

    Raises:
        CannotReach: the ground is too uneven there.
    """
    feet, state = robot.feet(friction=None), robot.standing()
    yaw = heading_of(state, feet)
    if abs(yaw) > FLAT:
        middle = np.mean([X.translation for X in contacts_at(state, feet).values()], axis=0)
        turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, -yaw), np.zeros(3))
        turn.translation = middle - turn.rotation @ middle
        q = state.q.copy()
        q[:7] = pin.SE3ToXYZQUAT(turn * pin.XYZQUATToSE3(q[:7]))
        state = State(robot, q)
    floor, poses = Floor(on, {foot.name: foot for foot in feet}, math.inf), contacts_at(state, feet)
    yaws = {name: math.atan2(X.rotation[1, 0], X.rotation[0, 0]) for name, X in poses.items()}
    wanted = {name: floor.pose(name, X.translation, yaws[name]) for name, X in poses.items()}
    rise = np.array([wanted[name].translation[2] - X.translation[2] for name, X in poses.items()])
    if np.ptp(rise) < FLAT and all(X.rotation[2, 2] > 1.0 - FLAT**2 for X in wanted.values()):
        q = state.q.copy()
        q[2] += rise.mean()
        return State(robot, q)
    return find_pose(robot, places_of(feet, wanted), posture=state, com=state.com + [0.0, 0.0, rise.mean()]).state
