"""`ContactSchedule`: when each contact is wanted; and which of these touch, on which a step of control counts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from rbd.arrays import as_float, check_flag, check_number
from rbd.constraints.constraint import Constraint, member
from rbd.constraints.contact_points import ALWAYS, PointSource, sources_of
from rbd.constraints.terrain.on_terrain import rests
from rbd.control.schedules import INSTANT, AcceptedStep, ContactTouch, TouchesWhenRead
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, listed_items
from rbd.model.checked_model import CheckedModel

Interval: TypeAlias = tuple[float, float]


def smooth(x: float) -> float:
    """From 0 at 0 to 1 at 1, with no slope at either end: 3 x^2 - 2 x^3; constant beyond."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass(frozen=True, eq=False)
class ContactSchedule(Displayed):
    """Times at which contacts are wanted; a contact that is not named is always wanted.

    Before the end of an interval the force that the contact may carry falls to zero, and after its start it rises from zero,
    each within a time `fade`: 3 x^2 - 2 x^3 of its full force, with x the part of the fade that has passed. Motor torques then
    do not jump where a foot is lifted or put down.

    Attributes:
        intervals: {contact: [(start, end), ...]} [s]; -math.inf and math.inf: from before the motion, for ever. They are
            sorted. A contact with no interval is never wanted.
        fade: How long a force takes to fade [s]; 0: it does not fade.
        flight: Whether all contacts may be in the air at once. `WholeBodyController`, which knows all contacts, refuses such a
            schedule otherwise.
        parts: {contact: [(start, end, corners), ...]}: from start to end [s] only these of its corners are to touch, by their
            numbers from 0: two are an edge, about which a sole turns.

    Raises:
        InputError: what is not {name: intervals}; times that are not numbers, an interval that does not last, two intervals
            of one contact that overlap or follow each other without a time between; a fade that is no time.

    Example:
        >>> one_step = rbd.control.ContactSchedule({"right_sole": [(-np.inf, 1.0), (1.6, np.inf)]}, fade=0.1)
        >>> [one_step.wants("right_sole", t) for t in (0.9, 1.3, 1.6)]
        [True, False, True]
        >>> [round(one_step.share("right_sole", t), 3) for t in (0.9, 0.95, 0.99, 1.3, 1.61, 1.7)]
        [1.0, 0.5, 0.028, 0.0, 0.028, 1.0]
    """

    intervals: Mapping[str, Sequence[Interval]]
    _: KW_ONLY
    fade: float = 0.05
    flight: bool = False
    parts: Mapping[str, Sequence[tuple[float, float, tuple[int, ...]]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expected = "{contact: [(start, end), ...]} [s], e.g. {'left_sole': [(0.0, 1.0), (1.6, math.inf)]}"
        check_kind("intervals of ContactSchedule", self.intervals, Mapping, expected)
        check_number("fade of ContactSchedule", self.fade, 0.0, expected="a time >= 0 [s]")
        check_flag("flight of ContactSchedule", self.flight)
        checked = {name: _checked(name, given) for name, given in self.intervals.items()}
        object.__setattr__(self, "intervals", checked)

    def interval(self, contact: str, t: float) -> Interval | None:
        """The interval of a contact at a time [s], start <= t < end; None if it is not wanted then.

        A contact that is not named has the interval (-inf, inf).
        """
        for start, end in self.intervals.get(contact, _ALWAYS):
            if start - INSTANT <= t < end - INSTANT:
                return start, end
        return None

    def wants(self, contact: str, t: float) -> bool:
        """Whether a contact is wanted at a time [s]."""
        return self.interval(contact, t) is not None

    def part(self, contact: str, t: float) -> tuple[int, ...] | None:
        """Which corners of a contact are to touch at a time [s]; None: all."""
        return next((which for start, end, which in self.parts.get(contact, ()) if start <= t < end), None)

    def wanted(self, t: float) -> tuple[str, ...]:
        """The contacts of this schedule that are wanted at a time [s], in its order."""
        return tuple(name for name in self.intervals if self.wants(name, t))

    def fade_in(self, contact: str, t: float, since: float | None = None) -> float:
        """How far the force of a contact has risen at a time [s], from 0 to 1; 0 where it is not in contact.

        Args:
            contact: Its name.
            t: Time [s].
            since: When it touched, if not at the start of its interval [s], but later or earlier: its force rises from then.
        """
        found = self.interval(contact, t)
        if since is None:
            if found is None:
                return 0.0
            since = found[0]
        return smooth((t - since) / self.fade) if self.fade > 0.0 else 1.0

    def fade_out(self, contact: str, t: float) -> float:
        """How little the force of a contact has fallen at a time [s], from 1 to 0, towards the end of its interval.

        1 where it is not wanted: before the start of an interval nothing falls.
        """
        found = self.interval(contact, t)
        return 1.0 if found is None or self.fade <= 0.0 else smooth((found[1] - t) / self.fade)

    def share(self, contact: str, t: float) -> float:
        """The part of its full force that a contact may carry at a time [s], in [0, 1]; 0 where it is not wanted."""
        return min(self.fade_in(contact, t), self.fade_out(contact, t))

    def normal_force(
        self,
        t: float,
        most: float,
        since: Mapping[str, float] | None = None,
        carried: Mapping[str, float] | None = None,
    ) -> dict[str, Interval]:
        """{contact: (least, most) of its normal force [N]}, of contacts whose force fades in or out at a time.

        Args:
            t: Time [s].
            most: Full force [N]: what the bound rises to, and falls from; there is no bound outside of fades.
            since: {contact: when it touched [s]} of those that are in contact; None: those that are wanted, each since the
                start of its interval.
            carried: {contact: what it carried when its fade out began [N]}: what its bound falls from.
        """
        times: Mapping[str, float | None] = dict.fromkeys(self.wanted(t)) if since is None else since
        carried, bounds = carried or {}, dict[str, Interval]()
        for name, began in times.items():
            rise, fall = self.fade_in(name, t, began), self.fade_out(name, t)
            if rise < 1.0 or fall < 1.0:
                bounds[name] = 0.0, min(rise * most, fall * carried.get(name, most))
        return bounds

    def in_flight(self, contacts: Iterable[str]) -> Interval | None:
        """The first time, from 0 on, in which none of these contacts is wanted, (start, end) [s]; None if there is none.

        Args:
            contacts: Names; of none of them, none is in the air.
        """
        names = list(contacts)
        together = sorted(each for name in names for each in self.intervals.get(name, _ALWAYS))
        reached = 0.0
        for start, end in together:
            if start > reached + INSTANT:
                return reached, start
            reached = max(reached, end)
        return None if not names or reached == math.inf else (reached, math.inf)

    def swing(self, contact: str, t: float) -> Interval | None:
        """The time around t in which a contact is not wanted: (end of its last interval, start of its next) [s]; None if it is.

        -inf or inf where there is no such interval.
        """
        if self.wants(contact, t):
            return None
        given = self.intervals[contact]
        before = [end for _, end in given if end - INSTANT <= t]
        after = [start for start, _ in given if start - INSTANT > t]
        return max(before, default=-math.inf), min(after, default=math.inf)


_ALWAYS = ((-math.inf, math.inf),)


def _checked(name: str, given: object) -> tuple[Interval, ...]:
    """The intervals of a contact, sorted."""
    check_kind("a contact of ContactSchedule", name, str, "a name, e.g. 'left_sole'")
    found = sorted(_pair(name, each) for each in listed_items(f"intervals of {name!r:.80}", given, "[(start, end), ...] [s]"))
    for (start, end), (then, last) in zip(found[:-1], found[1:], strict=True):
        if then <= end + INSTANT:
            raise InputError(
                f"intervals ({start:g}, {end:g}) and ({then:g}, {last:g}) of {name!r:.80} overlap, or leave no time between "
                f"them; expected one interval, ({start:g}, {max(end, last):g}), or a time in the air."
            )
    return tuple(found)


def _pair(name: str, given: object) -> Interval:
    pair = () if isinstance(given, str | bytes) or not isinstance(given, Iterable) else tuple(given)
    start, end = (as_float(x) for x in pair) if len(pair) == 2 else (math.nan, math.nan)
    if math.isnan(start) or math.isnan(end):
        raise InputError(f"an interval of {name!r:.80} is {given!r:.80}; expected two times (start, end) [s].")
    if not start + 2.0 * INSTANT < end or start == math.inf or end == -math.inf:
        raise InputError(
            f"interval ({start:g}, {end:g}) of {name!r:.80} is empty; expected an end after its start [s]: (start, end), and "
            "math.inf for a contact that stays."
        )
    return start, end


TOUCHES = 1e-4
"""A point touches up to this distance [m], where it was not told."""
LEAVES = 0.02
"""A foot that is lifted may touch for so long [s], or for a fade, before it counts as unplanned."""
NEAR = 5e-4
"""A contact that was counted on is, until all its points are farther than this [m]: one that carries little leaves by far less,
for a step or two, and comes back when it is pushed down."""


class SeenContacts(NamedTuple):
    """What is planned, what touches (all of it, or some), what is counted on, and how they differ, as (contact, kind).

    Attributes:
        since: {contact that is counted on: when it touched [s]}; -inf from the start of the motion.
    """

    planned: tuple[str, ...]
    touching: tuple[str, ...]
    since: dict[str, float]
    different: list[tuple[str, str]]


class ContactWatch:
    """Follows the contacts of a motion, from one step of control to the next.

    A contact counts from when it touches with any of its points and is wanted, or will be within a fade, until it is not
    wanted, or none of its points is near. Late in its swing, one that touches with all its points counts before it is
    wanted. Its force rises from then, or as before if it was lost for less than a fade.

    What carries a robot alone counts until another contact does, late as that may be, unless the schedule has a flight.

    Args:
        contacts: Those of the controller.
        schedule: When they are wanted.
        early: After this share of a swing, what touches has landed.
    """

    def __init__(self, contacts: Sequence[Constraint], schedule: ContactSchedule, early: float) -> None:
        self.contacts, self.schedule, self.early = contacts, schedule, early
        self.names = frozenset(c.name for c in contacts)
        self._carrying = frozenset(c.name for c in contacts if hasattr(c, "friction"))  # not loops
        self._always = frozenset(c.name for c in contacts if not lifts(c))
        self.since: dict[str, float] = {}
        self._lost: dict[str, tuple[float, float]] = {}
        self._until: dict[str, float] = {}
        self._sources: dict[str, PointSource] = {}
        self._joints: dict[str, int | None] = {}
        self._start: float | None = None

    def see(self, step: AcceptedStep) -> SeenContacts:
        """The contacts at the beginning of a step."""
        t, begins = step.t, self._start is None
        if self._start is None:
            self._check_given(step)
            self._start = t
        planned, touching, different = list[str](), list[str](), list[tuple[str, str]]()
        since, over = dict[str, float](), list[str]()
        for contact in self.contacts:
            name = contact.name
            wanted = self.schedule.wants(name, t)
            some, whole, counts = self._counts(contact, step)
            if wanted:
                planned.append(name)
            if some:
                touching.append(name)
            if counts:
                since[name] = -math.inf if begins else self._since(name, t)
                if not wanted:
                    different.append((name, "early"))
                if not whole:
                    different.append((name, "partial"))
            elif wanted:
                if name in self._carrying:  # not limits of joints, which act where they must
                    different.append((name, "late"))
                if name in self.since:
                    self._lost[name] = self.since[name], t
            elif some and name in self.since:
                over.append(name)
            elif some and t - self._until.get(name, -math.inf) > max(self.schedule.fade, LEAVES) + INSTANT:
                different.append((name, "unplanned"))
        if over and not self.schedule.flight and not self._carried(since, step):
            since |= {name: self.since[name] for name in over}
            different += [(name, "overdue") for name in over]
        different += [(each, "unplanned") for each in self._others(step, planned)]
        self.since = since
        self._until |= dict.fromkeys(since, t)
        return SeenContacts(tuple(planned), tuple(touching), since, different)

    def lands(self, step: AcceptedStep) -> bool:
        """Whether a contact counts that did not when the last step of control was taken."""
        return any(self._counts(c, step)[2] for c in self.contacts if c.name not in self.since and c.name not in self._always)

    def _counts(self, contact: Constraint, step: AcceptedStep) -> tuple[bool, bool, bool]:
        """Whether some of a contact's points touch, whether all do, and whether it is counted on."""
        name, t = contact.name, step.t
        some, whole, near = self._touches(contact, step, self.schedule.part(name, t))
        wanted = self.schedule.wants(name, t)
        soon = wanted or self.schedule.wants(name, t + self.schedule.fade)
        held = whole or (near and name in self.since) or (some and soon)
        return some, whole, held and (wanted or self._late_in_swing(name, t))

    def _check_given(self, step: AcceptedStep) -> None:
        """Refuse a simulation without any contact, where one is wanted: nothing would carry what the controller counts on.

        Raises:
            InputError: naming those that are wanted.
        """
        if not isinstance(step.contacts, TouchesWhenRead) or step.contacts:
            return
        wanted = [c.name for c in self.contacts if c.name in self._carrying and self.schedule.wants(c.name, step.t)]
        if wanted:
            raise InputError(
                f"WholeBodyController counts on {', '.join(wanted):.80}, and the simulation has no contacts. Give them to "
                "both: rbd.simulate(state, contacts, controller=...)."
            )

    def _since(self, name: str, t: float) -> float:
        """Since when a contact counts, which its force rises from [s]: as before, where it was lost for less than a fade."""
        if name in self.since:
            return self.since[name]
        before, lost = self._lost.get(name, (t, -math.inf))
        return before if t - lost <= self.schedule.fade + INSTANT else t

    def _carried(self, contacts: Collection[str], step: AcceptedStep) -> bool:
        """Whether a robot is carried without further contacts: by these, of which loops do not count, or by a fixed base."""
        return not self._carrying.isdisjoint(contacts) or not len(step.state.robot.unactuated)

    def bounds(self, step: AcceptedStep, full: float, carried: Mapping[str, float]) -> dict[str, Interval]:
        """Bounds of normal forces that fade [N], as of `ContactSchedule.normal_force`.

        Together they allow at least the full force, or the robot would fall: less is scaled up to it, unless there is a flight.
        """
        bounds = self.schedule.normal_force(step.t, full, self.since, carried)
        carrying = self._carrying.intersection(self.since)
        if self.schedule.flight or not carrying.issubset(bounds) or not len(step.state.robot.unactuated):
            return bounds
        total = sum(bounds[name][1] for name in self.since if name in carrying)
        if total >= full:
            return bounds
        scale = math.inf if total < 1e-6 * full else full / total
        free = {name: (0.0, bounds[name][1] * scale) for name in carrying if math.isfinite(scale)}
        return {name: free.get(name, each) for name, each in bounds.items() if name in free or name not in carrying}

    def _late_in_swing(self, name: str, t: float) -> bool:
        """Whether a contact that is not wanted will be soon, so that what touches has landed early."""
        swing = self.schedule.swing(name, t)
        assert swing is not None and self._start is not None
        start, end = max(swing[0], self._start), swing[1]
        return t - start >= self.early * (end - start) - INSTANT

    def _others(self, step: AcceptedStep, planned: Sequence[str]) -> list[str]:
        """What touches of constraints that the controller does not have: "name", or "name: shape" where shapes have names.

        Not the shapes of bodies whose own contacts are planned; not what always acts, as loops and joint friction.
        """
        if self.names.issuperset(step.contacts):
            return []
        robot, out = step.state.robot, list[str]()
        feet = {self._joint(robot, frame) for frame in frames_of(self.contacts, planned)}
        for name, touch in step.contacts.items():
            if name in self.names:
                continue
            if touch.names:
                shapes = dict.fromkeys(_shape(touch.names[i]) for i in _met(touch))
                out += [f"{name}: {shape}" for shape in shapes if self._joint(robot, shape) not in feet]
            elif _met(touch):
                out.append(name)
        return out

    def _bodies(self, step: AcceptedStep) -> Counter[int | None]:
        """{joint: how many points of the collision shapes that it carries touch}."""
        told = [touch for name, touch in step.contacts.items() if name not in self.names and touch.names]
        return Counter(self._joint(step.state.robot, _shape(touch.names[i])) for touch in told for i in _met(touch))

    def _joint(self, robot: CheckedModel, name: str) -> int | None:
        """The joint that carries a frame, or the link of a collision shape, "link_0"; None if there is none of this name."""
        if name not in self._joints:
            frames = [frame for frame in (name, name.rpartition("_")[0]) if robot.model.existFrame(frame)]
            found = [int(robot.model.frames[robot.model.getFrameId(frame)].parentJoint) for frame in frames]
            self._joints[name] = found[0] if found else None
        return self._joints[name]

    def _touches(self, contact: Constraint, step: AcceptedStep, part: tuple[int, ...] | None) -> tuple[bool, bool, bool]:
        """Whether some of a contact's points touch, whether all do, and whether any is near; measured where it was not told.

        Of a part of it, its points. A contact of a body whose collision shapes are told touches with these. On terrain it is
        whole where it rests on three points: what is over no piece, or beside one, has none.
        """
        if contact.name in step.inactive:
            return False, False, False
        if contact.name in self._always:
            return True, True, True
        told, of = step.contacts.get(contact.name), slice(None) if part is None else list(part)
        uneven = callable(member(member(contact, "on"), "heights_of"))
        if told is not None:
            if uneven:
                of = [i for i, label in enumerate(told.names) if rests(label, part)]
            gaps, n = np.asarray(told.gaps)[of], int(np.count_nonzero(np.asarray(told.touches)[of]))
        else:
            if contact.name not in self._sources:
                self._sources[contact.name] = sources_of((contact,), step.state)[0]
            gaps = self._sources[contact.name].gaps(step.state, step.t)[slice(None) if uneven else of]
            n = int(np.count_nonzero(gaps <= TOUCHES))
        whole = n >= min(len(part or contact.corners), 3) if uneven else 0 < n == len(gaps)  # type: ignore[attr-defined]
        near = n > 0 or bool((gaps <= NEAR).any())
        if told is not None or whole or not step.contacts:
            return n > 0, whole, near
        shapes = self._bodies(step)[self._joint(step.state.robot, str(member(contact, "frame")))]
        return n + shapes > 0, shapes >= min(len(gaps), 3), shapes > 0 or near


def _met(touch: ContactTouch) -> list[int]:
    """Which points touch that need not: loops and friction of joints, which always act, have gaps of -inf."""
    return np.flatnonzero(np.asarray(touch.touches) & (np.asarray(touch.gaps) > ALWAYS)).tolist()


def _shape(label: str) -> str:
    """The collision shape of a point's label."""
    return label.partition(":")[0]


def frames_of(contacts: Sequence[Constraint], names: Collection[str]) -> set[str]:
    """Frames of the robot to which some of the contacts are fixed."""
    frames = (member(contact, "frame") for contact in contacts if contact.name in names)
    return {frame for frame in frames if isinstance(frame, str)}


def lifts(contact: Constraint) -> bool:
    """Whether a contact can be lifted: it only pushes. Bilateral contacts and loops cannot."""
    bilateral = hasattr(contact, "friction") and member(contact, "friction") is None
    return not bilateral and member(contact, "loop_dof") is None
