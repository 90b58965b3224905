"""`WalkPlan`: footsteps, and a motion of the centre of mass over them with forces within friction cones at all times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from rbd.arrays import Array, lazy
from rbd.centroid import CentroidCosts, CentroidPlan, CentroidProgram
from rbd.control.contact_schedule import ContactSchedule
from rbd.control.schedules import INSTANT
from rbd.control.task_terms import Reference
from rbd.control.walking.footsteps import Floor, Footstep
from rbd.control.walking.swings import Swing, smooth
from rbd.displayed import Displayed, drawing
from rbd.errors import NoSolution
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import minimum_jerk_way
from rbd.records import counted

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

FRICTION_SHARE = 0.8
"""Share of the friction that the plan uses."""
EVERY, COARSE = 0.1, 0.2
"""Time between two of the plan's times [sqrt(h / g)]; of one that is made on the way, at most: two in each overlap."""
LEVEL = 0.04
"""`Gait.tilt` in the costs of a gait in which the body is to stay level [rad]."""
PASSES, AGREED = 8, 1e-5
"""How often moments are linearised again, at most; and the residual at which they are not."""
COM, HEIGHT, ACCELERATION, JERK, FORCE_RATE, SHIFT, MOMENT = 0.057, 0.01, 0.2, 1.8, 1.5, 0.3, 4.0
"""Costs of the plan (`CentroidCosts`), in units of h, g and sqrt(h / g): so robots of all sizes move alike. Angular momentum
costs as much where the body would tilt by `Gait.tilt` in one of these times, its rate where that changed within a quarter.
Legs keep the height; a plan that may jump or sink takes up a push with forces that no leg has."""
LIFTED, RISES, RISES_ON_TERRAIN, HIGHEST = 0.1, 0.45, 0.9, 0.5
"""Angle by which a heel rises at least; for each h that its foot goes forwards, and on terrain; and at most [rad]. With 0.9 on
level ground Romeo falls; with 0.45 on stairs two frames of Talos jump."""
SAG = 0.03
"""On terrain it walks lower by this, over h: legs reach farther."""
AHEAD, REST = 7.0, 3.0
"""A plan that is made on the way has the steps that begin so soon; after the last one it comes to rest for so long
[sqrt(h / g)]."""
FORWARD, OUTWARD, INWARD = 0.6, 0.45, 0.3
"""Feet come apart from where they stand by at most so much, over h; two feet nearer by this share of their distance."""
SOONEST = 0.5
"""Nearer before its landing a foothold is not changed, and a foot is not put down sooner [sqrt(h / g)]."""
ELSEWHERE = 1.0
"""A foot that is about to land may land so late, to be put elsewhere [sqrt(h / g)]."""
FASTEST = 0.8
"""Speed at which a foot in the air is put elsewhere, over sqrt(g h)."""
LATE = 0.1
"""A plan that is made on the way counts on a foot so long after it is to land: disturbed ones land late [sqrt(h / g)]."""
QUICKER, QUICKEST, QUICK_FOR = 0.6, 1.2, 5.0
"""Where feet may hurry, times of steps are shorter by this factor, but no swing than this, for so long [sqrt(h / g)]."""


@dataclass(frozen=True, eq=False)
class WalkPlan(Displayed):
    """Footsteps, and the centre of mass over them.

    Example:
        >>> plan = rbd.control.Walk(rbd.load_robot("solo12"), 2, gait="trot").plan
        >>> [(step.foot, round(step.start, 2)) for step in plan.footsteps[:2]], plan.com(0.0).velocity.round(3) + 0.0
        ([('front_left', 0.44), ('hind_right', 0.44)], array([0., 0., 0.]))

    Attributes:
        robot: Whose plan it is.
        floor: What is walked on, and by which feet.
        swings: {foot: its ways through the air, in order}.
        poses: {foot: pose of its contact's centre at the start}.
        t: Times, shape (n,) [s].
        centroid: Centre of mass, rate of angular momentum and forces at these times.
        fade: Forces of feet rise and fall within this time [s].
        inertia: See `Planner`.
        tilts: Whether the body, level at the first time, rolls and pitches with the angular momentum; else it stays level.
        until: From when on it knows no more steps though there are [s]; infinite where it has all.
    """

    robot: CheckedModel
    floor: Floor
    swings: Mapping[str, tuple[Swing, ...]]
    poses: Mapping[str, pin.SE3]
    t: Array
    centroid: CentroidPlan
    fade: float
    inertia: Array
    tilts: bool
    until: float = math.inf

    @property
    def footsteps(self) -> tuple[Footstep, ...]:
        """Where and when feet are put down, in order of their landing."""
        found = [Footstep(foot, s.end, s.start, s.landing) for foot, own in self.swings.items() for s in own]
        return tuple(sorted(found, key=lambda step: (step.end, step.foot)))

    @property
    def duration(self) -> float:
        """When it has come to rest [s]."""
        return float(self.t[-1])

    @lazy
    def schedule(self) -> ContactSchedule:
        """When which foot carries."""
        times = {foot: [(lands, lifted) for _, lands, lifted in self.stays(foot)] for foot in self.swings}
        return ContactSchedule(times, fade=self.fade, flight=True)

    def stays(self, foot: str) -> list[tuple[pin.SE3, float, float]]:
        """(pose, first time, last time) of each stay of a foot on the ground."""
        own = self.swings[foot]
        poses = [self.poses[foot], *(s.end for s in own)]
        first, last = [-math.inf, *(s.landing for s in own)], [*(s.start for s in own), math.inf]
        return list(zip(poses, first, last, strict=True))

    @lazy
    def _com(self) -> CubicSpline:
        return CubicSpline(self.t, self.centroid.com)

    @lazy
    def _moment(self) -> CubicSpline:
        return CubicSpline(self.t, self.centroid.moment)

    @lazy
    def _momentum(self) -> Any:
        return self._moment.antiderivative()

    @lazy
    def _angle(self) -> Any:
        return self._momentum.antiderivative()

    def com(self, t: float) -> Reference:
        """Centre of mass, its velocity and acceleration."""
        within = min(max(t, float(self.t[0])), self.duration)
        p, v, a = (self._com(within, i) for i in range(3))
        return Reference(p, v, a) if within == t else Reference(p, np.zeros(3), np.zeros(3))

    def momentum(self, t: float) -> Reference:
        """Momentum about the centre of mass, and its rate: the angular one; the linear one is left to `com`."""
        within = min(max(t, float(self.t[0])), self.duration)
        L, rate = np.zeros(6), np.zeros(6)
        if within == t:
            L[3:], rate[3:] = self.centroid.start + self._momentum(within), self._moment(within)
        return Reference(L, rate)

    def tilt(self, t: float, turned: float) -> Array:
        """Rotation vector of roll and pitch that the angular momentum brings about, its rate and acceleration, shape (3, 3).

        Of a robot that moves as one body, and of small angles: integral of the momentum, it and its rate, over the inertia.

        Args:
            t: Time [s].
            turned: By how much the robot has turned since the start [rad].
        """
        if not self.tilts:
            return np.zeros((3, 3))
        R = pin.rpy.rpyToMatrix(0.0, 0.0, turned)
        within, first = min(max(t, float(self.t[0])), self.duration), float(self.t[0])
        total = self._angle(within) - self._angle(first) + (within - first) * self.centroid.start
        known = self.momentum(t)
        level = np.array([total, known.value[3:], known.velocity[3:]]) @ np.linalg.inv(R @ self.inertia @ R.T) / self.robot.mass
        return np.asarray(level * [1.0, 1.0, 0.0])

    def swing(self, foot: str, t: float) -> Swing | None:
        """The last way through the air that has begun, else the first; None of a foot that stays."""
        own = self.swings[foot]
        return next((s for s in reversed(own) if s.start <= t), own[0] if own else None)

    def placed(self, foot: str, t: float) -> pin.SE3:
        """Where a foot is, or on its way."""
        s = self.swing(foot, t)
        return self.poses[foot] if s is None else s.at(min(max(t, s.start), s.landing))[0]

    def outline(self, foot: str, X: pin.SE3) -> Array:
        """Corners of a foot that is at a pose, in W, shape (k, 3) [m]; on the ground where that pose is below it."""
        return self._above(np.array([X.act(corner) for corner in self.floor.feet[foot].corners]))

    def way(self, swing: Swing, n: int) -> Array:
        """Points of a foot's way through the air, from when it is known, shape (n, 3) [m]; none below the ground."""
        return self._above(np.array([swing.at(t)[0].translation for t in np.linspace(swing.known, swing.landing, n)]))

    def _above(self, points: Array) -> Array:
        points[:, 2] = np.maximum(points[:, 2], [self.floor.top(x, y) for x, y, _ in points])
        return points

    def turn(self, t: float) -> float:
        """By how much the soles have turned since the start, in the mean [rad]; of points, from their places."""
        soles = [f for f, contact in self.floor.feet.items() if len(contact.corners) > 1]
        if soles:
            turns = [self.placed(f, t).rotation @ self.poses[f].rotation.T for f in soles]
            return float(np.mean([math.atan2(R[1, 0], R[0, 0]) for R in turns]))
        now = [self.placed(f, t) for f in self.poses]
        a, b = (np.array([X.translation[:2] for X in each]) for each in (self.poses.values(), now))
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        return math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())

    def __str__(self) -> str:
        taken, moved = counted(len(self.footsteps), "step"), np.linalg.norm((self.centroid.com[-1] - self.centroid.com[0])[:2])
        return f"{self.robot.name} takes {taken} in {self.duration:.2f} s, its centre of mass moves by {moved:.3f} m"

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> list[Artist]:
        """Footprints from above, ways of feet from the side, and which foot stands when; see `rbd.visual.plot_walk`."""
        return drawing("plot_walk")(axes, self)


@dataclass(frozen=True, eq=False)
class Planner:
    """What plans of a walk have in common.

    Attributes:
        robot: Whose walk it is.
        floor: What is walked on.
        poses: {foot: pose of its contact's centre at the start}.
        points: {foot: where forces of the plan act on it, shape (k, 3)}.
        com: The centre of mass at the start [m].
        yaw: Heading at the start [rad].
        h: Height of the centre of mass over the feet [m].
        unit: sqrt(h / g) [s].
        friction: Coulomb's coefficient.
        lift: Height of feet over what is below them [m].
        fade: See `WalkPlan`.
        tilt: See `Gait`.
        overlap: See `Gait`.
        inertia: Of the robot that turns over its feet, see `inertia_on_feet`, shape (3, 3) [m2].
    """

    robot: CheckedModel
    floor: Floor
    poses: Mapping[str, pin.SE3]
    points: Mapping[str, Array]
    com: Array
    yaw: float
    h: float
    unit: float
    friction: float
    lift: float
    fade: float
    tilt: float
    overlap: float
    inertia: Array

    def over(self, steps: Sequence[Footstep]) -> WalkPlan:
        """A plan over footsteps, from rest to rest."""
        swings: dict[str, list[Swing]] = {foot: [] for foot in self.poses}
        for step in sorted(steps, key=lambda step: step.start):
            begin = swings[step.foot][-1].end if swings[step.foot] else self.poses[step.foot]
            swings[step.foot].append(self.way(step.foot, begin, step.pose, step.start, step.end - step.start))
        end = max((s.end for s in steps), default=0.0) + REST * self.unit
        ready = {foot: tuple(own) for foot, own in swings.items()}
        return self.plan(ready, 0.0, end, (self.com, np.zeros(3), np.zeros(3)), EVERY, {})[0]

    def way(self, foot: str, begin: pin.SE3, end: pin.SE3, start: float, T: float) -> Swing:
        """From one foothold to the next, over what lies between."""
        a, b = begin.translation, end.translation
        out = Swing(begin, end, start, T, max(a[2], b[2]) + self.lift, **self._heel(foot, begin, b - a))
        return out.over(self.floor.tops(foot, begin, b), self.lift) if self.floor.uneven else out

    def _heel(self, foot: str, begin: pin.SE3, way: Array) -> dict[str, Any]:
        """A heel rises: flat, a sole that is lifted or behind the body takes more than ankles bend."""
        corners = np.asarray(self.floor.feet[foot].corners)
        ahead = begin.rotation @ self.poses[foot].rotation.T @ [math.cos(self.yaw), math.sin(self.yaw), 0.0]
        far = float(ahead @ way) / self.h
        if len(corners) < 3:
            return {}
        left = np.cross(begin.rotation[:, 2], ahead)
        toes = float(((corners - corners.mean(axis=0)) @ begin.rotation.T @ ahead).max())
        share = RISES_ON_TERRAIN if self.floor.uneven else RISES
        return {"heel": min(max(LIFTED, share * far), HIGHEST) * left, "toes": toes}

    def plan(
        self,
        swings: Mapping[str, tuple[Swing, ...]],
        begin: float,
        end: float,
        start: tuple[Array, Array, Array],
        every: float,
        shifts: Mapping[tuple[str, int], float],
    ) -> tuple[WalkPlan, dict[tuple[str, int], Array]]:
        """(plan, by how far footholds are shifted) between two times.

        Args:
            swings: {foot: its ways through the air}.
            begin: First time [s].
            end: Last time [s].
            start: Centre of mass, its velocity, and angular momentum at the first time.
            every: Time between two of its times [sqrt(h / g)].
            shifts: {(foot, number of its swing): by how far its foothold may be shifted [m]}.
        """
        late = LATE * self.unit if shifts else 0.0
        t = np.linspace(begin, end, max(round((end - begin) / (every * self.unit)), 8) + 1)
        none: Any = None
        draft = WalkPlan(self.robot, self.floor, swings, self.poses, t, none, self.fade, self.inertia, self.tilt > 0.0)
        number = {key: i for i, key in enumerate(shifts)}
        points, touches, stance, normals, placed = [], [], [], [], dict[str, list[pin.SE3]]()
        for foot in self.floor.feet:
            inner, own = self.points[foot], swings[foot]
            placed[foot] = [draft.placed(foot, x) for x in t]
            points.append(np.array([[X.act(p) for p in inner] for X in placed[foot]]))
            begun = np.searchsorted([s.start + INSTANT for s in own], t)
            landed = np.searchsorted([s.landing + late - INSTANT for s in own], t)
            on = begun <= landed
            which = np.array([number.get((foot, k - 1), -1) for k in landed])
            touches.append(np.repeat(on[:, None], len(inner), axis=1))
            stance.append(np.repeat(np.where(on, which, -1)[:, None], len(inner), axis=1))
            ups = np.array([X.rotation[:, 2] for X in placed[foot]])
            normals.append(np.repeat(ups[:, None], len(inner), axis=1))
        program = CentroidProgram(
            float(t[1] - t[0]), self.robot.mass, self.robot.gravity, np.concatenate(points, axis=1),
            np.concatenate(touches, axis=1), FRICTION_SHARE * self.friction, self._reference(draft, placed),
            np.zeros((len(t), 3)), np.concatenate(stance, axis=1) if shifts else None, self._bounds(draft, shifts),
            (False, True), start=start, normals=None if self.floor.level else np.concatenate(normals, axis=1),
            costs=self._costs(),
        )  # fmt: skip
        found = program.solve()
        for _ in range(PASSES):
            if found.residual < AGREED:
                break
            found = program.solve(found)
        moved = {key: found.shifts[i] for key, i in number.items()}
        return replace(draft, centroid=found), moved

    def _costs(self) -> CentroidCosts:
        h, unit = self.h, self.unit
        g = h / unit**2
        radian = 0.5 * float(self.inertia[0, 0] + self.inertia[1, 1]) / (g * unit)
        return CentroidCosts(
            com=COM * h, height=HEIGHT * h, momentum=MOMENT * radian * (self.tilt or LEVEL) / unit,
            acceleration=ACCELERATION * g, jerk=JERK * g / unit, force_rate=FORCE_RATE / unit, shift=SHIFT * h,
            turning=radian * (self.tilt or LEVEL),
        )  # fmt: skip

    def _reference(self, draft: WalkPlan, placed: Mapping[str, Sequence[pin.SE3]]) -> Array:
        """Over the middle of the feet, at the height at which it stands."""
        t, middle = draft.t, []
        for foot, poses in placed.items():
            places = np.array([X.translation for X in poses])
            for k, x in enumerate(t):  # of the footholds, not of the foot in the air
                way = draft.swing(foot, x)
                if way is not None:
                    a, b = way.begin.translation[2], way.end.translation[2]
                    places[k, 2] = a + smooth(x - way.start, way.T)[0] * (b - a)
            middle.append(places)
        place, feet = np.mean(middle, axis=0), np.mean([X.translation for X in self.poses.values()], axis=0)
        turned = np.array([draft.turn(x) for x in t])
        (x, y, z), c, s = self.com - feet, np.cos(turned), np.sin(turned)
        low = SAG * self.h if self.floor.uneven else 0.0
        begins = minimum_jerk_way((t / (REST * self.unit)).clip(0.0, 1.0))
        return np.asarray(place + np.column_stack([c * x - s * y, s * x + c * y, z - low * begins]))

    def _bounds(self, draft: WalkPlan, shifts: Mapping[tuple[str, int], float]) -> tuple[Array, Array] | None:
        """(G, h), G d >= h: how far footholds may be shifted, and how near and how far feet may come to each other."""
        if not shifts:
            return None
        rows, least, number = list[Array](), list[float](), {key: i for i, key in enumerate(shifts)}

        def add(of: Mapping[tuple[str, int], Array], bound: float) -> None:
            row = np.zeros((len(shifts), 2))
            for key, way in of.items():
                if key in number:
                    row[number[key]] += way
            if row.any():
                rows.append(row.ravel())
                least.append(bound)

        for key, far in shifts.items():
            for way in np.vstack([np.eye(2), -np.eye(2)]):
                add({key: way}, -far)
        two, stood = len(self.poses) == 2, {f: X.translation for f, X in self.poses.items()}
        for one, other in combinations(self.poses, 2):
            own, others = ([(k - 1, *each) for k, each in enumerate(draft.stays(f))] for f in (one, other))
            for i, X, first, last in own:
                for j, Y, begins, ends in others:
                    if max(first, begins) > min(last, ends) + 0.5 * self.unit:
                        continue
                    turn = draft.turn(max(first, begins, draft.t[0]))
                    R = pin.rpy.rpyToMatrix(0.0, 0.0, turn)[:2, :2]
                    want = R @ (stood[one] - stood[other])[:2]
                    body = R @ pin.rpy.rpyToMatrix(0.0, 0.0, self.yaw)[:2, :2]
                    off = (X.translation - Y.translation)[:2] - want
                    for axis, most, aside in zip(body.T, (FORWARD, OUTWARD), (False, two), strict=True):
                        apart = float(axis @ want)
                        for sign in (1.0, -1.0):
                            inward = aside and sign * apart > 0.0
                            bound = INWARD * abs(apart) if inward else most * self.h
                            add({(one, i): sign * axis, (other, j): -sign * axis}, min(-bound - sign * float(axis @ off), 0.0))
        return np.array(rows), np.array(least)

    def again(self, plan: WalkPlan, t: float, com: Array, v: Array, L: Array, hurry: bool) -> WalkPlan:
        """A plan from a state on the way: footholds that are still to come are shifted as balance needs, the body comes level.

        Args:
            plan: The one before.
            t: Time [s].
            com: Centre of mass.
            v: Its velocity.
            L: Angular momentum.
            hurry: Whether feet may be put down, or lifted, sooner.

        Raises:
            NoSolution: there is none.
        """
        found, failed = list[WalkPlan](), list[NoSolution]()
        for by in self._sooner(plan, t) if hurry else (0.0,):
            try:
                some = self._quicker(sooner(plan, t, by), t) if hurry else plan
                found.append(self._again(some, t, (com, v, L)))
            except NoSolution as error:
                failed.append(error)
        if not found:
            raise failed[0]
        return min(found, key=lambda each: each.centroid.cost)

    def _sooner(self, plan: WalkPlan, t: float) -> list[float]:
        """By how much sooner feet in the air may land, or (negative) later and elsewhere; or the next be lifted [s]."""
        swings = [s for own in plan.swings.values() for s in own]
        left = min((s.landing - t for s in swings if s.start < t < s.landing), default=0.0)
        if left > 0.0:
            least = SOONEST * self.unit
            early = [by for by in ((1.0 - share) * (left - least) for share in (0.6, 0.2)) if by > 1e-3]
            return [0.0, *early, *(by for by in (left - ELSEWHERE * self.unit,) if by < -1e-3)]
        wait = min((s.start - t for s in swings if s.start >= t), default=0.0)
        return [0.0, *(share * wait for share in (0.5, 1.0) if wait > 0.1 * self.unit)]

    def _quicker(self, plan: WalkPlan, t: float) -> WalkPlan:
        """The same footholds, with quicker steps for a while after the foot in the air has landed, and all others sooner.

        From a landing to the next the capture point's distance from where the foot pushes grows by exp(time / sqrt(h / g)), and
        may be the larger at the landing the shorter that time is: a wide stance, with room for errors.
        """
        swings = [s for own in plan.swings.values() for s in own]
        first = max((s.landing for s in swings if s.start < t < s.landing), default=t)
        last = first + QUICK_FOR * self.unit
        shortest = min((s.T for s in swings if first <= s.start < last), default=0.0)
        factor = min(max(QUICKER, QUICKEST * self.unit / shortest), 1.0) if shortest else 1.0

        def moved(x: float) -> float:
            return first + factor * min(x - first, last - first) + max(x - last, 0.0)

        def quicker(s: Swing) -> Swing:
            return replace(s, start=moved(s.start), T=moved(s.landing) - moved(s.start)) if s.start >= first else s

        return replace(plan, swings={foot: tuple(map(quicker, own)) for foot, own in plan.swings.items()})

    def _again(self, plan: WalkPlan, t: float, start: tuple[Array, Array, Array]) -> WalkPlan:
        ahead, shifts = t + AHEAD * self.unit, dict[tuple[str, int], float]()
        some, beyond = dict[str, tuple[Swing, ...]](), False
        for foot, own in plan.swings.items():
            some[foot] = tuple(s for s in own if s.start < ahead)
            beyond |= len(some[foot]) < len(own)
            for k, s in enumerate(some[foot]):
                left = s.landing - max(t, s.start)
                if left > SOONEST * self.unit:
                    shifts[foot, k] = FASTEST * self.h / self.unit * (left - 0.8 * SOONEST * self.unit)
        end = max([t, *(s.landing for own in some.values() for s in own)]) + REST * self.unit
        found, moved = self.plan(some, t, end, start, min(COARSE, max(0.5 * abs(self.overlap), EVERY)), shifts)
        swings = dict[str, tuple[Swing, ...]]()
        later = np.mean(list(moved.values()), axis=0) if moved and not self.floor.uneven else np.zeros(2)
        for foot, own in plan.swings.items():
            out = list[Swing]()
            for k, s in enumerate(own):
                d = moved.get((foot, k), later if s.start >= ahead else np.zeros(2))
                X = self.floor.shifted(foot, s.end, d)
                if out and out[-1] is not own[k - 1]:
                    s = self.way(foot, out[-1].end, X, s.start, s.T)
                elif np.abs(d).max() > 1e-4:
                    s = s.redirected(t, X, s.landing)
                out.append(s)
            swings[foot] = tuple(out)
        return replace(found, swings=swings, until=t + 0.5 * AHEAD * self.unit if beyond else math.inf)


def sooner(plan: WalkPlan, t: float, by: float) -> WalkPlan:
    """The same footholds, from a time on all sooner: feet in the air land sooner, later ones are lifted and land sooner."""
    if not by:
        return plan
    out = dict[str, tuple[Swing, ...]]()
    for foot, own in plan.swings.items():
        out[foot] = tuple(
            s if s.landing <= t else s.redirected(t, s.end, s.landing - by) if s.start < t else replace(s, start=s.start - by)
            for s in own
        )
    return replace(plan, swings=out)
