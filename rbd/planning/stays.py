"""Keyframes and contacts of a plan: where each contact stands, when, and how it moves between."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.ndimage import maximum_filter1d

from rbd.arrays import Array, as_float, lazy
from rbd.constraints.contact import Contact
from rbd.constraints.convex.polygons import convex_hull, inside_distance, nearest_on_edge
from rbd.constraints.surface import On
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.walking.footsteps import BESIDE, Floor, centre_of
from rbd.control.walking.swings import Swing
from rbd.errors import CannotReach, InputError
from rbd.errors.inputs import check_kind, check_known
from rbd.mechanism.pose_search import find_pose
from rbd.model.state import State
from rbd.motion.repair.feet import blend
from rbd.robots.robot import Robot

OFF_M, OFF_RAD = 1e-3, 5e-3
"""Keyframes within one stay agree on where a contact is up to this [m, rad]; it is so near to its surface [m]."""
EXACT = 1e-9
"""A keyframe that is off by more is put onto the stay."""
CLEARS, LIFT = 0.03, 0.06
"""A contact on its way is raised by this over the higher of both places, or by this share of h if that is less [m]."""
UPWARD = 0.5
"""The centre of mass of a keyframe is over the middle of those contacts whose normal has a larger upward part."""
LAG = 0.6
"""In flight, contacts lag behind the centre of mass by about this share of its rise, where they leave and where they land."""
LEAVES = 0.35
"""Share of its way through the air in which a contact is led on its way with all weight."""


@dataclass(frozen=True, eq=False)
class Stay:
    """A contact stands from one instant to another.

    Attributes:
        start: First instant [s].
        end: Last instant [s].
        X: Pose of its centre.
        normal: Of what it stands on, shape (3,).
        corners: Its corners, those over an edge moved to what rests, in its axes, shape (k, 3) [m].
    """

    start: float
    end: float
    X: pin.SE3
    normal: Array
    corners: Array

    def holds(self, t: float) -> bool:
        """Whether it stands at a time, both ends counted."""
        return self.start - 1e-9 <= t <= self.end + 1e-9


@dataclass(frozen=True, eq=False)
class PlannedContacts:
    """Contacts of a plan over time.

    Attributes:
        robot: The robot.
        contacts: The contacts.
        stays: Of each, in order.
        keys: (time, state) of each keyframe.
        lift: See `LIFT` [m].
    """

    robot: Robot
    contacts: tuple[Contact, ...]
    stays: tuple[tuple[Stay, ...], ...]
    keys: tuple[tuple[float, State], ...]
    lift: float

    def intervals(self, name: str) -> list[tuple[float, float]]:
        """(first time, last time) of each stay of a contact [s]."""
        return [(s.start, s.end) for s in self.stays[[c.name for c in self.contacts].index(name)]]

    def stages(self, name: str) -> list[tuple[float, float, tuple[int, ...]]]:
        """(start, end, which corners) of each stay: all of them."""
        corners = tuple(range(len(next(c for c in self.contacts if c.name == name).corners)))
        return [(start, end, corners) for start, end in self.intervals(name)]

    def on_knots(self, t: Array) -> PlannedContacts:
        """The same, stays and keyframes moved to the nearest of times t: a keyframe at the end of a stay remains there."""

        def nearest(x: float) -> float:
            return float(t[np.abs(t - x).argmin()])

        moved = [[replace(s, start=nearest(s.start), end=nearest(s.end)) for s in own] for own in self.stays]
        return replace(self, stays=tuple(map(tuple, moved)), keys=tuple((nearest(x), state) for x, state in self.keys))

    def corners(self, t: Array) -> list[Array]:
        """Where each contact's corners are at times, in its axes, shapes (n, k, 3) [m]: of what rests where it stands."""
        out = []
        for contact, own in zip(self.contacts, self.stays, strict=True):
            each = np.tile(np.asarray(contact.corners), (len(t), 1, 1))
            for s in own:
                each[[s.holds(x) for x in t]] = s.corners
            out.append(each)
        return out

    def on(self, t: Array) -> Array:
        """Which contacts stand at times, shape (n, contacts)."""
        return np.array([[any(s.holds(x) for s in own) for own in self.stays] for x in t])

    @property
    def flies(self) -> bool:
        """Whether nothing stands for a time."""
        ends = [s.end for own in self.stays for s in own if s.end < self.keys[-1][0] - 1e-9]
        return any(not any(s.start - 1e-9 <= t + 1e-6 <= s.end + 1e-9 for own in self.stays for s in own) for t in ends)

    def standing(self, t: float) -> tuple[Contact, ...]:
        """Those that stand at a time."""
        return tuple(c for c, own in zip(self.contacts, self.stays, strict=True) if any(s.holds(t) for s in own))

    @lazy
    def _ways(self) -> tuple[tuple[tuple[Swing, bool, bool], ...], ...]:
        """(way, whether it stood before, whether it stands after) between stays and keyframes of each contact."""
        return tuple(tuple(self._between(i)) for i in range(len(self.contacts)))

    def _between(self, i: int) -> Iterator[tuple[Swing, bool, bool]]:
        own, contact = self.stays[i], self.contacts[i]
        nodes = [(s.start, s.end, s.X, True) for s in own]
        nodes += [(t, t, centre_of(state, contact), False) for t, state in self.keys if not any(s.holds(t) for s in own)]
        nodes.sort(key=lambda node: node[0])
        for (_, start, a, stood), (end, _, b, stands) in zip(nodes[:-1], nodes[1:], strict=True):
            rise = b.translation[2] - a.translation[2]
            lifts = stood and stands and self._flight(0.5 * (start + end)) is None  # else it rises with the body
            top = max(a.translation[2], b.translation[2]) + self.lift * lifts
            way = Swing(a, b, start, end - start, top)
            if stood and stands and abs(rise) > 0.5 * self.lift:
                way = replace(way, forward=(0.3, 0.75), high=(0.4, 0.65))
            if lifts and isinstance(contact.on, Terrain):
                tops = Floor(contact.on, {contact.name: contact}, math.inf).tops(contact.name, a, b.translation)
                if tops.max() > way.top - self.lift + EXACT:  # something higher lies between
                    beside = BESIDE * (len(tops) - 1) / float(np.linalg.norm(b.translation - a.translation))
                    way = way.over(maximum_filter1d(tops, 2 * math.ceil(beside) + 1), CLEARS)
            yield way, stood, stands

    def _flight(self, t: float) -> float | None:
        """How far contacts rise in a flight at a time [m]; None where something stands."""
        if any(s.holds(t) for own in self.stays for s in own):
            return None
        start = max((s.end for own in self.stays for s in own if s.end < t), default=t)
        end = min((s.start for own in self.stays for s in own if s.start > t), default=t)
        T = max(end - start, 1e-9)
        y = 4.0 * (t - start) * (end - t) / T**2  # of the centre of mass, whose speed they do not have where they leave
        return float(np.linalg.norm(self.robot.gravity) * T**2 / 8.0 * (1.0 + LAG) * y**2 / (y + LAG))

    def paths(self, t: Array) -> tuple[Array, Array, Array]:
        """(R, p, free) of contacts' axes at times: shapes (n, F, 3, 3), (n, F, 3) [m] and (n, F); see `Goals.free`."""
        n, F = len(t), len(self.contacts)
        R, p, free = np.empty((n, F, 3, 3)), np.empty((n, F, 3)), np.zeros((n, F))
        for i, (contact, own) in enumerate(zip(self.contacts, self.stays, strict=True)):
            back = pin.SE3(np.eye(3), -np.asarray(contact.corners).mean(axis=0))
            for k, x in enumerate(t):
                X = next((s.X for s in own if s.holds(x)), None)
                if X is None:
                    way, stood, stands = next(w for w in self._ways[i] if x <= w[0].landing + 1e-9)
                    u = min(max((x - way.start) / way.T, 0.0), 1.0)
                    X = way.at(way.start + u * way.T)[0]
                    edges = [v for v, counts in ((u, stood), (1.0 - u, stands)) if counts]
                    free[k, i] = np.prod(blend(np.array(edges) / LEAVES))
                    if not stood and not any(s.start > x for s in own):
                        free[k, i] = 2.0  # it stands no more
                    flight = self._flight(x)
                    if flight is not None:  # feet rise with the body
                        X = pin.SE3(X.rotation, X.translation + [0.0, 0.0, flight])
                X = X * back
                R[k, i], p[k, i] = X.rotation, X.translation
        return R, p, free


def planned_contacts(
    robot: Robot, keyframes: Mapping[float, Any], contacts: Mapping[Any, Any], *, friction: float, ground: On
) -> PlannedContacts:
    """Contacts and keyframes of a plan, checked against each other; arguments as of `rbd.plan`."""
    check_kind("keyframes of plan", keyframes, Mapping, "{time: state, posture or targets of rbd.find_pose}")
    check_kind("contacts of plan", contacts, Mapping, "{foot or contact: [(start, end), ...] or True}")
    if not contacts:
        raise InputError("contacts of plan is {}; expected when each stands, {'left_sole': [(0.0, 1.0), (1.6, 3.0)], ...}.")
    times = sorted(_time(t) for t in keyframes)
    if len(times) < 2 or len(set(times)) != len(keyframes):
        raise InputError(f"keyframes of plan are at {times}; expected two or more different times [s].")
    by_name = robot.source.feet or any(isinstance(key, str) for key in contacts)
    feet = {foot.name: foot for foot in (robot.feet(friction=friction, on=ground) if by_name else ())}
    known, spans = list[Contact](), list[list[tuple[float, float]]]()
    for key, given in contacts.items():
        if isinstance(key, str):
            check_known("contacts of plan have", key, feet)
        contact = feet[key] if isinstance(key, str) else key
        check_kind("a contact of plan", contact, Contact, "the name of a foot, or a contact: rbd.PointContact(...)")
        known.append(contact)
        spans.append(_spans(contact.name, given, times))
    by_time = {_time(t): given for t, given in keyframes.items()}
    states, stays = dict[float, State](), [list[Stay | None]([None] * len(each)) for each in spans]
    for t in sorted(times, key=lambda t: isinstance(by_time[t], Mapping)):  # poses that are given say where contacts stand
        there = [(i, k) for i, each in enumerate(spans) for k, (a, b) in enumerate(each) if a - 1e-9 <= t <= b + 1e-9]
        placed = {known[i]: stay for i, k in there if (stay := stays[i][k]) is not None}
        stands, earlier = [known[i] for i, _ in there], [x for x in states if x < t]
        states[t] = _pose(robot, t, by_time[t], placed, stands, feet, ground, states[max(earlier)] if earlier else None)
        for i, k in there:
            normal, corners = _touched(known[i], states[t], t)
            stays[i][k] = stays[i][k] or Stay(*spans[i][k], centre_of(states[t], known[i]), normal, corners)
    keys = [(t, states[t]) for t in times]
    for contact, own, each in zip(known, stays, spans, strict=True):
        for stay, (a, b) in zip(own, each, strict=True):
            if stay is None:
                raise InputError(
                    f"{contact.name!r:.80} is to stand from {a:g} to {b:g} s, and no keyframe says where: give one within that "
                    f"time; keyframes are at {times} s."
                )
    h = float(keys[0][1].com[2] - np.mean([s.X.translation[2] for own in stays for s in own[:1] if s is not None] or [0.0]))
    ready = tuple(tuple(s for s in own if s is not None) for own in stays)
    return PlannedContacts(robot, tuple(known), ready, tuple(keys), min(CLEARS, LIFT * max(abs(h), 0.05)) if h else CLEARS)


def _time(t: Any) -> float:
    x = as_float(t)
    if not math.isfinite(x):
        raise InputError(f"a keyframe of plan is at {t!r:.40}; expected a time [s].")
    return x


def _spans(name: str, given: Any, times: Sequence[float]) -> list[tuple[float, float]]:
    """(start, end) of each stay within the plan's time, in order."""
    first, last = times[0], times[-1]
    if given is True:
        return [(first, last)]
    try:
        out = sorted((max(as_float(a), first), min(as_float(b), last)) for a, b in given)
    except (TypeError, ValueError):
        raise InputError(f"times of {name!r:.80} are {given!r:.80}; expected [(start, end), ...] [s], or True.") from None
    for (a, b), later in zip(out, [*(x for x, _ in out[1:]), math.inf], strict=True):
        if not a < b < later:
            raise InputError(
                f"{name!r:.80} is to stand from {a:g} to {b:g} s, and the next time from {later:g} s; expected a start, a "
                f"later end between {first:g} and {last:g} s, and a next start after it."
            )
    return out


def _pose(
    robot: Robot, t: float, given: Any, placed: Mapping[Contact, Stay], stands: Sequence[Contact],
    feet: Mapping[str, Contact], ground: On, before: State | None,
) -> State:  # fmt: skip
    """The state of a keyframe, with the contacts that stand where they stand."""
    held: dict[Any, Any] = {}
    for contact, stay in placed.items():
        held[contact.name if contact.name in feet else contact] = stay.X if len(contact.corners) > 1 else stay.X.translation
    if isinstance(given, str):
        given, before = {}, robot.at(given)
    if not isinstance(given, Mapping):
        state = robot.at(given) if not isinstance(given, State) else given.on(robot)
        off = max((_off(contact, stay, state, t) for contact, stay in placed.items()), default=0.0)
        return state if off < EXACT else find_pose(robot, held, ground=ground, posture=state, com=state.com).state
    targets = dict(given)
    com = targets.pop("com", None)
    named = {key if isinstance(key, str) else getattr(key, "name", key) for key in targets}
    targets |= {key: X for key, X in held.items() if getattr(key, "name", key) not in named}
    for contact in stands:  # where it stands is found
        if contact not in placed and contact.name not in named:
            targets[contact.name if contact.name in feet else contact] = None
    try:
        found = find_pose(robot, targets, ground=ground, posture=before, com=com).state
        under = [X.translation[:2] for X in (centre_of(found, c) for c in stands) if X.rotation[2, 2] > UPWARD]
        if com is None and under:
            found = find_pose(robot, targets, ground=ground, posture=found, com=np.mean(under, axis=0)).state
    except CannotReach as error:
        error.args = (f"the keyframe at {t:g} s is out of reach: {error.args[0]}",)
        raise
    except InputError as error:  # a foot beyond the border of its terrain, among others
        error.args = (f"targets of the keyframe at {t:g} s, of {', '.join(sorted(map(repr, named))):.120}: {error.args[0]}",)
        raise
    for contact, stay in placed.items():
        _off(contact, stay, found, t)
    return found


def _touched(contact: Contact, state: State, t: float) -> tuple[Array, Array]:
    """(normal of what a contact stands on, shape (3,); corners of what rests of it, as `Stay.corners`).

    One that floats, is inside its surface, or beyond the border of its terrain is refused.
    """
    points, corners = contact.points(state), np.asarray(contact.corners)
    if points is None:
        return np.asarray(centre_of(state, contact).rotation[:, 2]), corners
    if not len(points.gaps) and isinstance(contact.on, Terrain):
        raise InputError(
            f"{contact.name!r:.80} is to stand at {t:g} s, and the keyframe has it where no terrain is within 1 mm: over a "
            "gap, beyond a border, or in the air; give a pose of rbd.find_pose, or its targets as the keyframe."
        )
    gap = np.asarray(points.gaps)
    worst = float(gap[np.abs(gap).argmax()]) if len(gap) else 0.0
    floats = contact.on is not None and np.abs(gap).min(initial=np.inf if len(gap) else 0.0) >= OFF_M
    if floats or worst < -OFF_M:
        where = "inside" if worst < 0.0 else "above"
        raise InputError(
            f"{contact.name!r:.80} is to stand at {t:g} s, and the keyframe has it {1e3 * abs(worst):.1f} mm {where} its "
            "surface; give a pose of rbd.find_pose, or its targets as the keyframe."
        )
    if isinstance(contact.on, Terrain) and len(corners) > 1:
        X = centre_of(state, contact) * pin.SE3(np.eye(3), -corners.mean(axis=0))
        corners = resting_corners(corners, (points.positions - X.translation) @ X.rotation)
    return np.asarray(points.axes.reshape(-1, 3, 3)[0, :, 2]), corners


def resting_corners(corners: Array, rests: Array) -> Array:
    """Corners of a sole, those outside of the hull of points that rest moved to its edge, shape (k, 3), in its axes [m]."""
    out, hull = corners.copy(), convex_hull(rests[:, :2])
    for corner in out:
        if inside_distance(corner[:2], hull) < -EXACT:
            corner[:2] = nearest_on_edge(corner[:2], hull)
    return out


def _off(contact: Contact, stay: Stay, state: State, t: float) -> float:
    """How far a contact that stands is from where it stands [m]; refused if that is far."""
    D = stay.X.actInv(centre_of(state, contact))
    off, turned = float(np.linalg.norm(D.translation)), float(np.linalg.norm(pin.log3(D.rotation)))
    turned *= len(contact.corners) > 1
    if off > OFF_M or turned > OFF_RAD:
        raise InputError(
            f"{contact.name!r:.80} is to stand from {stay.start:g} to {stay.end:g} s, and the keyframe at {t:g} s has it "
            f"{1e3 * off:.1f} mm and {math.degrees(turned):.1f} degrees from where it stood before; let it leave between, or "
            "give the same place."
        )
    return max(off, turned)


def coefficient_of(contact: Contact) -> float:
    """Its coefficient of friction; a contact whose friction is of another kind is refused."""
    if not isinstance(contact.friction, float | int):
        raise InputError(
            f"{contact.name!r:.80} has friction {contact.friction!r:.40}; plans take Coulomb's coefficient, "
            "contact.with_friction(0.6)."
        )
    return float(contact.friction)
