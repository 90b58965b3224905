"""Contacts that are left open: which foot is put down where, one after the other, between two poses, and which hand helps.

Footholds are on the way of each foot, where a whole foot stands (`Floor`). A step is possible where the robot can stand still
on the other feet at both places of the foot: in reach, bodies apart, forces within friction, torques within limits. Each
sequence that is found so is planned. Where steps do not get there, leaps are tried, in which all feet leave the ground at once
and land on the next places of their ways; and where these do not, a hand is put onto its own surface before the first step and
taken away after the last, at places near to where it is.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.constraints.contact import Contact
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.constraints.surface import On, plane_of
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.walking.footsteps import Floor
from rbd.control.walking.walk import places_of
from rbd.errors import CannotMove, CannotPlan, CannotReach, InputError
from rbd.errors.inputs import check_kind
from rbd.mechanism.pose_search import FoundPose, quick_pose
from rbd.model.state import State
from rbd.motion.frame_terms import placements
from rbd.motion.self_collision import DEEP_M, BodyPairs
from rbd.planning.distances import apart
from rbd.planning.free_times import parts_of
from rbd.planning.helping import limited as limited_to
from rbd.planning.stays import PlannedContacts, Stay, centre_of, planned_contacts
from rbd.problem.ground import Ground
from rbd.robots.robot import Robot
from rbd.statics.equilibrium import hold

STEPS = (1, 2, 3, 4, 6)
"""Numbers of steps of each foot that are tried, one after the other."""
BUDGET, PLANNED = 60, 3
"""Steps that are tested, and sequences that are planned, at most."""
DEPTH = 0.5
"""The centre of mass stays near, but as far from the edges of what stands as this share of their distance from its middle."""
TORQUES = 0.95
"""Share of the torque limits with which a step has to be held: what it takes to move is left."""
STARTS = 3
"""Further starts of the search for a pose, which begins at the one before."""
GRASPS, GRID, AROUND = 4, 0.1, 0.5
"""Places of each hand that are tried; how far they are from each other, and from where the hand is, at most [m]."""
LEANS = (0.0, 0.2)
"""The centre of mass is this share of the way from feet to a hand, the first with which a step is possible."""
PUSH, FLIGHT = 0.2, 0.3
"""How long a leap takes to leave the ground, and to come to rest; and how long nothing stands, on level ground [s]."""
LEAPS, FIXED = 12, 0.8
"""Leaps that are tested, at most; the share of the time that they may take."""
OFF, CROUCH, ROOM = 0.09, 0.035, 0.25
"""In a leap the centre of mass leaves the ground and lands lower than it stands by this share of its height over the feet, and
crouches by so much more [m]. Where it leaves and lands legs have to reach farther, by this share of its way from there."""
SAME = 1e-3
"""A foot whose places are nearer to each other does not step [m]."""


@dataclass(frozen=True, eq=False)
class Step:
    """A foot is put down elsewhere.

    Attributes:
        foot: Its number.
        X: Where.
        lift: The pose in which it is lifted.
        land: The pose in which it is put down.
    """

    foot: int
    X: pin.SE3
    lift: State
    land: State

    def stages(self, at: Sequence[pin.SE3]) -> list[Stage]:
        """Up to where it is lifted and where it lands, from where feet are."""
        way = float(np.linalg.norm(self.X.translation - at[self.foot].translation))
        return [Stage(self.lift, lifts=(self.foot,)), Stage(self.land, way, lands={self.foot: self.X})]


@dataclass(frozen=True, eq=False)
class Leap:
    """All feet leave the ground at once, and land elsewhere.

    Attributes:
        to: Where each lands.
        low: The pose from which it pushes off.
        off: In which it leaves the ground.
        land: In which it lands.
        caught: In which it comes to rest.
        flight: How long nothing stands [s].
    """

    to: tuple[pin.SE3, ...]
    low: State
    off: State
    land: State
    caught: State
    flight: float

    def stages(self, _: Sequence[pin.SE3]) -> list[Stage]:
        """Down, off the ground, onto it, and at rest."""
        feet = range(len(self.to))
        return [
            Stage(self.low), Stage(self.off, time=PUSH, lifts=tuple(feet)),
            Stage(self.land, time=self.flight, lands=dict(zip(feet, self.to, strict=True))), Stage(self.caught, time=PUSH),
        ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stage:
    """What comes before a keyframe, and changes there.

    Attributes:
        pose: The keyframe.
        way: How far a contact is moved before it [m].
        time: How long it takes [s]; None: by what moves.
        lifts: Feet that are lifted there.
        lands: Where feet land there.
    """

    pose: State
    way: float = 0.0
    time: float | None = None
    lifts: tuple[int, ...] = ()
    lands: Mapping[int, pin.SE3] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ContactSearch:
    """Steps from one pose to another.

    Attributes:
        ends: First and last pose with all feet on the ground.
        robot: Whose limits are kept.
        ground: What feet stand on.
        floor: The same, with places for whole feet.
        friction: Of the feet.
        bodies: Pairs of bodies that are apart; None: they may overlap.
        hands: Contacts that may help, each with its own surface.
        held: (hand, place) of those that rest during all steps.
        tried: What was tried in vain, in words.
        tested: Steps and leaps that were tested, and what came of them.
    """

    ends: PlannedContacts
    robot: Robot
    ground: On
    floor: Floor
    friction: float
    bodies: BodyPairs | None
    hands: tuple[Contact, ...] = ()
    held: tuple[tuple[Contact, Array], ...] = ()
    tried: list[str] = field(default_factory=list)
    tested: dict[tuple[Any, ...], Step | Leap | str] = field(default_factory=dict)

    @classmethod
    def of(
        cls, robot: Robot, keyframes: Mapping[float, Any], *, friction: float, ground: On, limited: Robot, self_collision: bool,
        hands: Sequence[Contact] = (),
    ) -> ContactSearch:  # fmt: skip
        """Between two keyframes, in both of which all feet stand; other arguments as of `rbd.plan`."""
        times = sorted(keyframes) if isinstance(keyframes, Mapping) else []
        if len(times) != 2:
            raise InputError(f"keyframes of plan are at {times}; with contacts='search' expected two, the first and the last.")
        if not isinstance(ground, Ground | Terrain | float | int):
            raise InputError(f"ground of plan is {ground!r:.80}; with contacts='search' expected a height, Ground or Terrain.")
        first, last = times
        stays = [(first, 0.75 * first + 0.25 * last), (0.25 * first + 0.75 * last, last)]
        feet = {foot.name: stays for foot in robot.feet(friction=friction, on=ground)}
        ends = planned_contacts(robot, keyframes, feet, friction=friction, ground=ground)
        on = ground if isinstance(ground, Terrain) else plane_of("plan", ground)
        floor = Floor(on, {foot.name: foot for foot in ends.contacts}, math.inf)
        for hand in hands:
            check_kind("a hand of plan", hand, Contact, "a contact with its surface: rbd.PointContact('hand', frame, on=...)")
            if hand.on is None or len(hand.corners) != 1:
                raise InputError(
                    f"{hand.name!r:.80} is a hand of plan with {len(hand.corners)} points on {hand.on!r:.80}; expected a "
                    "point and its surface, rbd.PointContact('hand', frame, on=rbd.Ground(...))."
                )
        bodies = BodyPairs.of(robot) if self_collision else None
        return cls(ends, limited_to(limited, TORQUES), ground, floor, friction, bodies, tuple(hands))

    @property
    def feet(self) -> tuple[Contact, ...]:
        """The feet."""
        return self.ends.contacts

    def first(self, planned: Callable[[PlannedContacts], Any]) -> Any:
        """The plan over the first sequence that has one.

        Raises:
            CannotPlan: none was found; with what was tried.
        """
        last, count, tested, left = None, 0, 0, PLANNED
        for held in self.supports():
            search = replace(self, held=held, tested={})
            found: list[Iterator[Sequence[Step | Leap]]] = [search.sequences(), *[search.leaps()] * (not held)]
            for moves in (x for own in found for x in islice(own, left if held else PLANNED)):
                count, left = count + 1, left - bool(held)
                try:
                    return planned(search.contacts(moves))
                except (CannotPlan, CannotReach, InputError) as error:
                    words = [word for move in moves for word in self._words_of(move)]
                    self.tried.append(f"{', '.join([*search.held_words, *words])}: {error}")
                    last = error
            tested += len(search.tested)
            if not left:
                break
        said = f"{tested} steps and leaps were tested, and {count} sequences of them planned"
        raise CannotPlan(
            f"no sequence of contacts of {self.robot.name} was found: {said}. {'; '.join(self.tried[-4:])}",
            tried=tuple(self.tried), plan=getattr(last, "plan", None), momentum=getattr(last, "momentum", None),
            helps=getattr(last, "helps", None),
        ) from last  # fmt: skip

    def supports(self) -> Iterator[tuple[tuple[Contact, Array], ...]]:
        """Hands that rest during all steps: none, then each hand at each of its places, the nearest first."""
        yield ()
        first, last = (state for _, state in self.ends.keys)
        for hand in self.hands:
            at = 0.5 * (centre_of(first, hand).translation + centre_of(last, hand).translation)
            places = grasps(hand, at)
            if not places:
                self.tried.append(f"{hand.name!r:.80} finds no place within {AROUND:g} m of {at.round(2).tolist()} m")
            yield from (((hand, p),) for p in places)

    @property
    def held_words(self) -> list[str]:
        """Where hands rest, in words."""
        return [f"{hand.name!r:.80} at ({p[0]:.2f}, {p[1]:.2f}, {p[2]:.2f}) m" for hand, p in self.held]

    def sequences(self) -> Iterator[list[Step]]:
        """Steps from the first to the last pose, few of each foot first."""
        found = set[tuple[Any, ...]]()
        for n in STEPS:
            for steps in self._of(self._places(n)):
                key = tuple((step.foot, *step.X.translation.round(6)) for step in steps)
                if key not in found:
                    found.add(key)
                    yield steps

    def leaps(self) -> Iterator[list[Leap]]:
        """Leaps from the first to the last pose, few first."""
        for n in STEPS:
            places = self._places(n)
            most = max(map(len, places))
            if any(len(own) not in (1, most) for own in places) or most == 1:
                continue
            leaps, before = list[Leap](), self.ends.keys[0][1]
            for k in range(1, most):
                at, to = ([own[min(i, len(own) - 1)] for own in places] for i in (k - 1, k))
                key = ("leap", *np.round([x for X in (*at, *to) for x in X.translation], 6))
                if sum(x[0] == "leap" for x in self.tested) >= LEAPS:
                    break
                self.tested[key] = leap = self._leap(at, to, before)
                if isinstance(leap, str):
                    self.tried.append(f"{', '.join(self._words_of(to))}: {leap}")
                    break
                leaps.append(leap)
                before = leap.caught
            else:
                yield leaps

    def _leap(self, at: list[pin.SE3], to: list[pin.SE3], before: State) -> Leap | str:
        """The leap, or why it is none."""
        for X in (at, to):
            if far := self._far(X):
                return far
        state = self.ends.keys[0][1]
        from_feet = state.com - np.mean([own[0].X.translation for own in self.ends.stays], axis=0)
        start, end = (np.mean([X.translation for X in each], axis=0) + from_feet for each in (at, to))
        g = float(np.linalg.norm(self.robot.gravity))
        low = g * FLIGHT**2 / 8.0  # over the higher of both places
        high = low + abs(float(end[2] - start[2]))
        flight = math.sqrt(2.0 * low / g) + math.sqrt(2.0 * high / g)
        # At constant acceleration it is as fast when it leaves as in the flight, and the legs carry more than the weight.
        ahead, more = 0.5 * PUSH / (PUSH + flight) * (end - start), 1.0 + math.sqrt(2.0 * high / g) / PUSH
        down = OFF * from_feet[2] * np.eye(3)[2]
        ahead[2] = 0.0
        places = [start - down - [0.0, 0.0, CROUCH], start + ahead - down, end - ahead - down, end - down - [0.0, 0.0, CROUCH]]
        poses = [before]
        try:
            for com, X in zip(places, (at, at, to, to), strict=True):
                poses.append(self._pose(X, com, poses[-1]))
            for pose, X, way in ((poses[2], at, ahead), (poses[3], to, -ahead)):  # legs are not straight there
                self._pose(X, pose.com + ROOM * way, pose)
            for pose in (poses[1], poses[4]):
                hold(State(limited_to(self.robot, 1.0 / more), pose.q), self.feet, margin=0.1)
        except (CannotReach, InputError) as error:
            return str(error)
        except CannotMove as error:
            return f"pushes with {more:.2g} times its weight: {str(error).split('. ')[0]}"
        overlaps = [words for pose in poses[1:] if (words := self._overlap(pose))]
        if overlaps:
            return f"bodies overlap: {overlaps[0]}"
        _, crouched, off, land, caught = poses
        return Leap(tuple(to), crouched, off, land, caught, flight)

    def _places(self, n: int) -> list[list[pin.SE3]]:
        """Footholds of each foot, the first and the last among them."""
        out = []
        for foot, (a, b) in zip(self.feet, self.ends.stays, strict=True):
            way = b.X.translation - a.X.translation
            own, moves = [a.X], np.linalg.norm(way) > SAME or np.linalg.norm(pin.log3(a.X.rotation.T @ b.X.rotation)) > SAME
            for k in range(1, n) if moves else ():
                X = pin.SE3.Interpolate(a.X, b.X, k / n)
                yaw, along = math.atan2(X.rotation[1, 0], X.rotation[0, 0]), way[:2] / (np.linalg.norm(way[:2]) or 1.0)
                try:
                    own.append(self.floor.nearest(foot.name, X.translation, yaw, along, float(X.translation[2])))
                except InputError:
                    x, y = X.translation[:2]
                    self.tried.append(f"{foot.name!r:.80} finds no place near ({x:.2f}, {y:.2f}) m on which all of it rests")
            out.append([*own, b.X] if moves else own)
        return out

    def _of(self, places: list[list[pin.SE3]]) -> Iterator[list[Step]]:
        """From place to place, first with those that are farthest on their way, the feet as near to each other as can be."""
        goal = tuple(len(own) - 1 for own in places)
        queue: list[tuple[int, int, int, tuple[int, ...], list[Step]]] = [(sum(goal), 0, 0, (0,) * len(goal), [])]
        closed, count = set[tuple[int, ...]](), 0
        while queue:
            *_, node, steps = heapq.heappop(queue)
            if node == goal:
                yield steps
                continue
            if node in closed:
                continue
            closed.add(node)
            for f in (f for f, last in enumerate(goal) if node[f] < last):
                then = (*node[:f], node[f] + 1, *node[f + 1 :])
                at = [own[i] for own, i in zip(places, node, strict=True)]
                step = self._tested(at, f, places[f][then[f]], steps)
                if isinstance(step, Step):
                    count += 1
                    left = [last - i for i, last in zip(then, goal, strict=True) if last]
                    heapq.heappush(queue, (sum(left), max(left) - min(left), count, then, [*steps, step]))

    def _tested(self, at: list[pin.SE3], f: int, X: pin.SE3, steps: list[Step]) -> Step | str:
        """The step, or why it is none."""
        key = (f, *np.round([*X.translation, *(x for own in at for x in own.translation)], 6))
        if key not in self.tested:
            if len(self.tested) >= BUDGET // (1 + bool(self.held) * len(self.hands)):
                return "not tested"
            self.tested[key] = found = self._step(at, f, X, steps[-1].land if steps else self.ends.keys[0][1])
            if isinstance(found, str):
                self.tried.append(f"{', '.join([*self.held_words, self._words(f, X)])}: {found}")
        known = self.tested[key]
        assert not isinstance(known, Leap)
        return known

    def _step(self, at: list[pin.SE3], f: int, X: pin.SE3, before: State) -> Step | str:
        stands = [foot for i, foot in enumerate(self.feet) if i != f]
        if not stands:
            return "no other foot is left to stand on"
        if far := self._far([X if i == f else own for i, own in enumerate(at)]):
            return far
        under = [X.act(c - np.mean(c0, axis=0))[:2] for X, c0 in self._corners(at, f) for c in c0]
        near = _inside(before.com[:2], convex_hull(np.array(under)))
        leans = [near + share * (p[:2] - near) for _, p in self.held for share in LEANS]
        stands += [hand for hand, _ in self.held]
        found: Step | str = ""
        for com in leans or [near]:
            found = self._stood(at, f, X, before, com, stands)
            if isinstance(found, Step):
                break
        return found

    def _stood(self, at: list[pin.SE3], f: int, X: pin.SE3, before: State, com: Array, stands: list[Contact]) -> Step | str:
        """The step with the centre of mass at a place, shape (2,), or why it is none."""
        try:
            lift = self._pose(at, com, before)
            land = self._pose([X if i == f else own for i, own in enumerate(at)], com, lift)
            for state in (lift, land):
                hold(State(self.robot, state.q), stands, margin=0.1)
        except (CannotReach, InputError) as error:  # a foot may be beyond the border of its terrain
            return str(error)
        except CannotMove as error:
            return str(error).split(". ")[0]
        overlaps = [self._overlap(state) for state in (lift, land)]
        return f"bodies overlap: {' '.join(overlaps).strip()}" if any(overlaps) else Step(f, X, lift, land)

    def _far(self, at: list[pin.SE3]) -> str:
        """Why feet at these places are out of reach of each other in whatever pose; empty where they are not."""
        stays = [(c, Stay(0.0, 0.0, X, X.rotation[:, 2], np.asarray(c.corners))) for c, X in zip(self.feet, at, strict=True)]
        stays += [(c, Stay(0.0, 0.0, pin.SE3(np.eye(3), p), np.zeros(3), np.asarray(c.corners))) for c, p in self.held]
        pairs = (apart(self.robot, x, y) for i, x in enumerate(stays) for y in stays[i + 1 :])
        worst = max(pairs, key=lambda x: x.distance - x.longest, default=None)
        if worst is None or worst.distance <= worst.longest:
            return ""
        return f"out of reach ({' and '.join(worst.names)} are {worst.distance:.2f} m apart, {worst.longest:.2f} m at most)"

    def _corners(self, at: list[pin.SE3], f: int) -> list[tuple[pin.SE3, Array]]:
        """(pose, corners) of the feet that stand."""
        return [(X, np.asarray(c.corners)) for i, (X, c) in enumerate(zip(at, self.feet, strict=True)) if i != f]

    def _pose(self, at: list[pin.SE3], com: Array, before: State) -> State:
        places = places_of(self.feet, {c.name: X for c, X in zip(self.feet, at, strict=True)}) | dict(self.held)
        found = quick_pose(self.ends.robot, places, ground=self.ground, posture=before, com=com, starts=STARTS)
        if isinstance(found, FoundPose):
            return found.state
        raise CannotReach(f"out of reach ({', '.join(found)})" if found else "out of reach", misses=found)

    def _overlap(self, state: State) -> str:
        if self.bodies is None:
            return ""
        pairs = self.bodies.near(*placements(self.robot, state.q[None]), within=-DEEP_M)
        names = (f"{self.bodies.shapes[i][1]!r:.40} and {self.bodies.shapes[j][1]!r:.40}" for i, j, _ in pairs)
        return next(names, "")

    def _words_of(self, move: Step | Leap | Sequence[pin.SE3]) -> list[str]:
        """Where feet are put down, in words."""
        if isinstance(move, Step):
            return [self._words(move.foot, move.X)]
        return ["leap of " + " and ".join(self._words(f, X) for f, X in enumerate(move.to if isinstance(move, Leap) else move))]

    def _words(self, f: int, X: pin.SE3) -> str:
        x, y, z = np.round(X.translation, 2) + 0.0
        return f"{self.feet[f].name!r:.80} to ({x:.2f}, {y:.2f}, {z:.2f}) m"

    def contacts(self, moves: Sequence[Step | Leap]) -> PlannedContacts:
        """Keyframes and contacts of a sequence: each step, and what is before, between and after, gets time by what moves.

        Hands are put down before the first step, and taken away after the last.

        Raises:
            CannotPlan: leaps take more time than there is.
        """
        (start, first), (end, last) = self.ends.keys
        at, more = [own[0].X for own in self.ends.stays], bool(self.held)
        grasped, freed = (
            max((float(np.linalg.norm(p - centre_of(state, hand).translation)) for hand, p in self.held), default=0.0)
            for state in (first, last)
        )
        stages = [Stage(self._pose(at, first.com[:2], first), grasped)] * more
        for move in moves:
            new = move.stages(at)
            stages += new
            for stage in new:
                at = [stage.lands.get(f, X) for f, X in enumerate(at)]
        stages += [Stage(stages[-1].pose)] * more + [Stage(last, freed)]
        fixed = sum(stage.time or 0.0 for stage in stages)
        if fixed > FIXED * (end - start):
            least = math.ceil(100.0 * fixed / FIXED - 1e-6) / 100.0
            raise CannotPlan(f"leaps take {fixed:.2g} s without what is between; give {least:g} s or more", t=())
        com = np.array([first.com, *(stage.pose.com for stage in stages)])
        parts = parts_of(com, np.array([stage.way for stage in stages]))
        given_time = np.array([stage.time is not None for stage in stages])
        parts *= (end - start - fixed) / parts[~given_time].sum()
        parts[given_time] = [stage.time for stage in stages if stage.time is not None]
        t = (start + np.cumsum(parts)).tolist()
        t[-1] = end
        keys: dict[float, Any] = {start: first} | {x: stage.pose for x, stage in zip(t, stages, strict=True)}
        lands, stays = [start] * len(self.feet), [list[tuple[float, float]]() for _ in self.feet]
        for x, stage in zip(t, stages, strict=True):
            for f in stage.lifts:
                stays[f].append((lands[f], x))
            for f in stage.lands:
                lands[f] = x
        each = zip(self.feet, stays, lands, strict=True)
        given: dict[Any, Any] = {foot.name: [*own, (land, end)] for foot, own, land in each}
        given |= {hand: [(t[0], t[-2])] for hand, _ in self.held}
        return planned_contacts(self.ends.robot, keys, given, friction=self.friction, ground=self.ground)


def grasps(hand: Contact, at: Array) -> list[Array]:
    """Places on a hand's surface near to one, the nearest first, shapes (3,) [m]: of a plane its projection."""
    if not isinstance(hand.on, Terrain):
        plane = plane_of(hand.name, hand.on if isinstance(hand.on, Ground) else as_float(hand.on))
        n = np.asarray(plane.normal)
        return [at - (n @ (at - np.asarray(plane.point))) * n]
    found = list[Array]()
    steps = np.arange(-AROUND, AROUND + 0.5 * GRID, GRID)
    for x in steps:
        for y in steps:
            try:
                plane = hand.on.ground_at(at[0] + x, at[1] + y)
            except InputError:
                continue
            n, p = np.asarray(plane.normal), np.asarray(plane.point)
            z = float(p[2] - (n[0] * (at[0] + x - p[0]) + n[1] * (at[1] + y - p[1])) / n[2])
            found.append(np.array([at[0] + x, at[1] + y, z]))
    near = sorted((p for p in found if np.linalg.norm(p - at) < AROUND), key=lambda p: float(np.linalg.norm(p - at)))
    return near[:: max(len(near) // GRASPS, 1)][:GRASPS]


def _inside(com: Array, hull: Array) -> Array:
    """The first place on the way to the middle of a hull that is well inside, shape (2,)."""
    middle = hull.mean(axis=0)
    deep = DEPTH * inside_distance(middle, hull)
    return next((x for s in np.linspace(0.0, 1.0, 21) if inside_distance(x := com + s * (middle - com), hull) >= deep), middle)
