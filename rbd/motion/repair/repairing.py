"""The repair of a motion: stances, feet, the centroid's program and whole-body poses in turn, until they agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rbd.arrays import Array, lazy
from rbd.centroid import CentroidProgram
from rbd.centroid.program import inner_corners
from rbd.constraints.contact import Contact
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.model.sampled_motion import cubic, cubic_rate, interpolated_q
from rbd.motion.contact_lanes import lanes_of
from rbd.motion.contact_timeline import AGAIN, ContactTimeline
from rbd.motion.derivation import low_passed
from rbd.motion.grasps import Grasps
from rbd.motion.reference_motion import Motion
from rbd.motion.repair.feet import Feet, Stance, blurred, paths, planes_of, stances_of, standing
from rbd.motion.repair.forces import torque_rows, wrenches_on
from rbd.motion.repair.posture import Goals, Reference, posed
from rbd.motion.repair.sweep import Sweep
from rbd.motion.repair.treads import Tread, normals_of
from rbd.motion.self_collision import BodyPairs
from rbd.robots.robot import Robot

FAST, DEEP = 0.1, 0.01
"""A foot that is faster than this [m/s] while it is this deep [m] is on its way through a tread: it does not stand."""
EARLY = 0.1
"""An edge of a sole carries so long before the sole leans on it, and after [s]."""
FRICTION_SHARE = 0.86
"""Share of the friction that is used."""
FILTER = 6.0
"""What is faster in the reference is not followed [Hz]."""
SLOWEST, FASTEST = 45.0, 75.0
"""Rates at which poses are computed [Hz]."""
SOON = 0.25
"""Stances that follow one another within this time must be within reach of each other, too [s]."""
NEAREST, FARTHEST = 1.0, 1.8
"""Least and largest distance of two feet that shifts may lead to, over that where the robot stands."""
REST, SLOW = 0.4, 0.1
"""How long it stands before and after the motion [s], where the base is slower than this [m/s, rad/s]."""
LEAST_FRAMES = 8
"""A motion of fewer has no course to repair."""
STIFFNESS = (0.1, 0.1, 0.1, 0.2, 0.4, 0.7, 1.0, 1.0)
"""How stiffly poses follow the plan's forces, from pass to pass: stiff from the start, arms swing wildly."""
LEVEL_TURNS, TURNS = (4, 2), (2, 2, 2, 2, 2, 3, 3, 6)
"""Steps of Gauss-Newton with loose stances; in each pass."""
OWN = (0.0, 0.5, 0.8, 1.0, 1.0, 1.0, 1.0, 1.0)
"""Share of the rate of angular momentum that was reached, the mean of plan and poses, in what the next plan stays near to."""
SETTLED = 4e-3
"""Where the last step of a pass is shorter, poses and plan agree [m, rad]."""


@dataclass(frozen=True, eq=False)
class Course:
    """A motion under repair, at n equal times.

    Attributes:
        reference: What the poses stay near to.
        feet: Feet of the reference.
        on: Which stand, shape (n, F).
        stances: Their stances.
        ground: Height of the floor [m], or the terrain.
        friction: Coefficient that is used.
        bodies: Pairs of bodies that are kept apart.
        stride: Distances of the feet from each other where the robot stands, shape (F, F) [m].
        kept: Frames whose poses stay as they are.
        rests: Whether it stands at rest before, and after.
        contacts: The feet, as contacts.
        raised: How much higher it is than the reference that was given [m].
        start: Time of the first pose [s].
    """

    reference: Reference
    feet: Feet
    on: Array
    stances: tuple[Stance, ...]
    ground: float | Terrain
    friction: float
    bodies: BodyPairs | None
    stride: Array
    kept: Feet | None
    rests: tuple[bool, bool]
    contacts: tuple[Contact, ...]
    raised: float
    start: float

    def paths(self, shifts: Array | None = None) -> tuple[Array, Array, Array]:
        """(R, p, free) of the feet, where stances are shifted along the floor."""
        moved = [s if shifts is None else replace(s, place=s.place + [*shifts[i], 0.0]) for i, s in enumerate(self.stances)]
        return paths(moved, self.feet, self.ground if isinstance(self.ground, Terrain) else None)

    @lazy
    def spots(self) -> tuple[tuple[int, int, Array, Array], ...]:
        """(foot, side, points in its axes, frames in which they count, shape (n,)), of each set of points at which forces act.

        They are corners of soles made smaller, side 0; of their toe and heel edges, 1 and -1; and of the part that carries on a
        tread that is too narrow.
        """
        out, feet, n = [], self.feet, len(self.on)
        for f, corners in enumerate(feet.corners):
            whole = np.ones(n, bool)
            for s in self.stances:
                if s.foot == f and len(s.part):
                    whole[s.frames] = False
                    out.append((f, 0, s.part, np.isin(np.arange(n), np.r_[s.frames])))
            for side in (0, 1, -1) if feet.flat[f] and feet.lean[:, f].any() else (0,):
                some = corners[feet.edge(f, side)]
                out.append((f, side, inner_corners(some), whole))
        return tuple(out)

    def places(self, R: Array, p: Array) -> Array:
        """Where forces act, for feet placed so, shape (n, k, 3) [m]."""
        return np.concatenate([x @ R[:, f].swapaxes(1, 2) + p[:, f, None] for f, _, x, _ in self.spots], axis=1)

    @lazy
    def group(self) -> Array:
        """Which foot each of these points belongs to, shape (k,)."""
        return np.repeat([f for f, *_ in self.spots], [len(x) for _, _, x, _ in self.spots])

    def touches(self) -> Array:
        """Which of these points carry, shape (n, k): of leaning soles those of the edge, also a little before and after."""
        from scipy.ndimage import maximum_filter1d

        out, near = [], 2 * round(EARLY / self.feet.dt) + 1
        for f, side, x, counts in self.spots:
            lean = self.feet.lean[:, f]
            on = lean == 0.0
            if side:
                on = (side * lean >= 0.0) & (maximum_filter1d(side * lean, near) > 0.0)
            out.append(np.repeat((on & counts & self.on[:, f])[:, None], len(x), axis=1))
        return np.concatenate(out, axis=1)

    def program(self, com: Array, moment: Array, limits: tuple[Array, Array, Array] | None = None) -> CentroidProgram:
        """The centroid's program about a reference of the centre of mass and of the rate of angular momentum."""
        stance = np.full(self.on.shape, -1)
        for i, s in enumerate(self.stances):
            stance[s.frames, s.foot] = i
        robot, group = self.reference.robot, self.group
        normals = normals_of(self.feet.planes)[:, group] if isinstance(self.ground, Terrain) else None
        return CentroidProgram(
            self.reference.dt, robot.mass, robot.gravity, self.places(*self.paths()[:2]), self.touches(), self.friction, com,
            moment, stance[:, group], self.bounds(), self.rests, limits, normals=normals,
        )  # fmt: skip

    def bounds(self) -> tuple[Array, Array]:
        """(G, h), G d >= h: shifts d of feet that stand at once, or soon after, bring them no nearer and no farther apart.

        And they keep soles on their treads.
        """
        rows, least, soon = list[Array](), list[float](), round(SOON / self.feet.dt)
        for i, s in enumerate(self.stances):
            for a, c in zip(*s.tread.rows(*self.feet.sole(s.foot, s.place, s.tread)), strict=True):
                row = np.zeros((len(self.stances), 2))
                row[i] = -a
                rows.append(row.ravel())
                least.append(min(float(a @ s.place[:2]) - c, 0.0))
        for (i, one), (j, other) in combinations(enumerate(self.stances), 2):
            if one.foot == other.foot or max(one.first, other.first) > min(one.last, other.last) + soon:
                continue
            way = one.place[:2] - other.place[:2]
            far = float(np.linalg.norm(way))
            if far < 1e-6:
                continue
            row = np.zeros((len(self.stances), 2))
            row[i], row[j] = way / far, -way / far
            near = NEAREST * self.stride[one.foot, other.foot]
            rows += [row.ravel(), -row.ravel()]
            least += [min(near - far, 0.0), -max(FARTHEST * self.stride[one.foot, other.foot] - far, 0.0)]
        return np.array(rows).reshape(-1, 2 * len(self.stances)), np.array(least)

    def solved(self, done: Callable[[float], None]) -> Repaired:
        """Poses that move as their contacts allow."""
        course, reference, feet, kept = self, self.reference, self.feet, self.kept
        robot, dt, q = reference.robot, reference.dt, reference.q
        sweep = Sweep.of(robot, q, dt)
        com, grasps = sweep.com, Grasps.of(robot, q)
        moment = first = blurred(sweep.moment, 0.03 / dt)
        for turns in LEVEL_TURNS:  # where would the feet stand, were they level, but free to move along the floor?
            R, p, free = course.paths()
            q, sweep, _ = posed(q, reference, feet, Goals(R, p, free, com, None, kept, grasps), self.bodies, turns)
            now = feet.at(sweep.R, sweep.p)
            course = replace(course, stances=tuple(s.moved_to(now) for s in course.stances))
        plan, stiff, last = course.program(com, moment).solve(), 0.0, np.inf
        for i, (least, own, turns) in enumerate(zip(STIFFNESS, OWN, TURNS, strict=True)):
            if stiff == 1.0 and last < SETTLED:
                break
            stiff = 1.0 if last < SETTLED else least
            plan = course.program(com, moment, torque_rows(reference, feet, sweep, plan, self.places, self.group)).solve(plan)
            R, p, free = course.paths(plan.shifts)
            goals = Goals(R, p, free, plan.com, wrenches_on(plan, self.places(R, p), self.group, p), kept, grasps)
            q, _, last = posed(q, reference, feet, goals, self.bodies, turns, stiff)
            sweep = Sweep.of(robot, q, dt)
            com = np.column_stack([com[:, :2], sweep.com[:, 2]])
            moment = own * (0.5 * plan.moment + 0.5 * sweep.moment) + (1.0 - own) * first
            done((i + 1.0) / len(STIFFNESS))
        places = np.array([s.place[:2] for s in self.stances]).reshape(-1, 2)
        moved = np.array([s.place[:2] for s in course.stances]).reshape(-1, 2) + plan.shifts - places
        return Repaired(course, sweep, feet.at(sweep.R, sweep.p).error(R, p), np.linalg.norm(moved, axis=1))


@dataclass(frozen=True, eq=False)
class Repaired:
    """What became of a course.

    Attributes:
        course: The course, with the stances that were reached.
        sweep: The poses.
        foot_errors: By how far feet are off their paths, shape (n, F, 6) [m, rad].
        moved: How far stances are from where the reference's feet stand, shape (stances,) [m].
    """

    course: Course
    sweep: Sweep
    foot_errors: Array
    moved: Array


def repaired(
    motion: Motion,
    lanes: ContactTimeline,
    friction: float,
    torques: Callable[[Array], tuple[Array, Array]],
    level: float | Terrain,
    *,
    self_collision: bool,
    slower: float,
    keep: Sequence[str],
    done: Callable[[float], None],
) -> tuple[Motion, Repaired]:
    """The repaired motion with its contacts, and how it was found; see `MotionReport.repaired`.

    Args:
        motion: The reference.
        lanes: Its contacts, as meant.
        friction: Coulomb's coefficient.
        torques: (least, most) torques at velocities.
        level: Height of the floor on which it is put [m], or the terrain.
        self_collision: Whether bodies are kept apart.
        slower: How many times as long it takes.
        keep: Frames whose poses stay as they are.
        done: Called with the share that is done.
    """
    robot = motion.robot
    contacts = [c for c in lanes.contacts if isinstance(c, Contact)]
    if not contacts or motion.n < LEAST_FRAMES:
        raise InputError(
            f"{motion.source} has {motion.n} frames, and {robot.name} {len(contacts)} feet; expected {LEAST_FRAMES} frames or "
            "more of a robot with feet: rbd.load_robot(file, feet=[...])."
        )
    t, frames = _times(motion)
    dt = float(t[1] - t[0])
    q = interpolated_q(robot, motion.t, motion.q, motion.v, t.clip(motion.t[0], motion.t[-1]))
    raised = 0.0 if isinstance(level, Terrain) else level - lanes.zero
    q[:, 2] += raised
    q = low_passed(robot, q, FILTER * dt)
    feet = Feet.of(robot, contacts, q, dt)
    some, every = (lanes.points.group_reduced(of, lanes.touches[frames]) for of in (np.logical_or, np.logical_and))
    own = [g for g, contact in enumerate(lanes.contacts) if isinstance(contact, Contact)]
    under = lanes.under(own)[frames] + raised
    touches, terrain = some[:, own], level if isinstance(level, Terrain) else None
    if terrain is not None:
        touches = touches & ~((feet.low - under < -DEEP) & (feet.speed > FAST))
    on = standing(touches, feet, under)
    stances = tuple(on_treads(stances_of(on, feet), feet, under, terrain))
    feet = replace(feet, dt=slower * dt, planes=planes_of(stances, under))
    feet = feet.leaning(on, on & some[:, own] & ~every[:, own])
    treads = [s.tread for s in stances]
    stances = tuple(replace(s, tread=tread).put_on_tread(feet) for s, tread in zip(stances_of(on, feet), treads, strict=True))
    rest = Feet.of(robot, contacts, (robot.standing().q if isinstance(robot, Robot) else q[0])[None], dt).p[0]
    course = Course(
        Reference.of(robot, q, slower * dt, feet, torques), feet, on, stances, level, FRICTION_SHARE * friction,
        BodyPairs.of(robot) if self_collision else None, np.linalg.norm(rest[:, None] - rest, axis=2),
        Feet.of(robot, keep, q, dt) if keep else None,
        (bool(t[0] < motion.t[0] and on[0].any()), bool(t[-1] > motion.t[-1] + 0.5 * dt and on[-1].any())),
        tuple(contacts), raised, motion.t[0] + slower * float(t[0] - motion.t[0]),
    )  # fmt: skip
    t = motion.t[0] + slower * (t - motion.t[0])
    found = course.solved(done)
    return _made(motion, lanes, found, t, slower), found


def on_treads(stances: Sequence[Stance], feet: Feet, under: Array, terrain: Terrain | None) -> list[Stance]:
    """Stances on the treads that are under them; without a terrain at the height that was found.

    Args:
        stances: All stances.
        feet: The feet.
        under: Height of what was found under each foot, shape (n, F) [m].
        terrain: The terrain, if it is one.
    """
    out = []
    for s in stances:
        z = float(np.median(under[s.frames, s.foot]))
        out.append(replace(s, tread=Tread.level(z)) if terrain is None else s.found_on(terrain, feet, z))
    return out


def _times(motion: Motion) -> tuple[Array, Array]:
    """(equal times, at most `FASTEST` a second, the nearest frame of the motion at each).

    A motion that begins or ends slowly is taken to stand still for a while before or after: so its ends are in balance.
    """
    steps, rate = motion.n - 1, motion.rate
    if rate > FASTEST:
        steps = max(int(np.ceil(steps / np.ceil(rate / FASTEST))), LEAST_FRAMES)
    elif rate < SLOWEST:
        steps *= int(np.ceil(SLOWEST / rate))
    dt = motion.duration / steps
    rests = [round(REST / dt) * bool(np.linalg.norm(motion.v[i, :6]) < SLOW) for i in (0, -1)]
    t = motion.t[0] + dt * np.arange(-rests[0], steps + 1 + rests[1])
    return t, nearest_in(motion.t, t)


def nearest_in(times: Array, t: Array) -> Array:
    """Index of the nearest of increasing times to each t."""
    at = np.searchsorted(times, t).clip(1, len(times) - 1)
    return at - (t - times[at - 1] < times[at] - t)


def _made(motion: Motion, lanes: ContactTimeline, found: Repaired, t: Array, slower: float) -> Motion:
    """The poses as a motion at the times of the reference, with its contacts."""
    robot, sweep, course = motion.robot, found.sweep, found.course
    points = lanes.points.some(~np.char.endswith(lanes.names, AGAIN)) if isinstance(course.ground, Terrain) else lanes.points
    on = np.zeros((len(course.on), len(points)), bool)
    for contact, carry in zip(course.contacts, course.feet.carrying(course.on), strict=True):
        on[:, points.group == lanes.contacts.index(contact)] = carry
    wanted = motion.t[0] + slower * (motion.t - motion.t[0])
    near = nearest_in(t, wanted)
    q, v, a, on = sweep.q[near], sweep.v[near], sweep.a[near], on[near]
    if np.abs(t[near] - wanted).max() > 1e-6:
        q = interpolated_q(robot, t, sweep.q, sweep.v, wanted)
        v, a = cubic(t, sweep.v, sweep.a, wanted), cubic_rate(t, sweep.v, sweep.a, wanted)
    out = Motion.of_arrays(
        robot, wanted, q, v, a, source=f"repaired {motion.title}", ground=course.ground, quaternion="xyzw", trust=True
    )
    return out.with_contacts(lanes_of(out, points, on, course.ground))
