"""`ContactSchedule`: when each contact is wanted, and how much force it may carry while it fades in and out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TypeAlias

from rbd.arrays import as_float, check_flag
from rbd.control.accepted_steps import INSTANT
from rbd.displayed import Displayed
from rbd.errors import InputError

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

    def __post_init__(self) -> None:
        if not isinstance(self.intervals, Mapping):
            raise InputError(
                f"intervals of ContactSchedule are {self.intervals!r:.80}; expected {{contact: [(start, end), ...]}} [s], e.g. "
                "{'left_sole': [(0.0, 1.0), (1.6, math.inf)]}."
            )
        if not 0.0 <= as_float(self.fade) < math.inf:
            raise InputError(f"fade of ContactSchedule is {self.fade!r:.80}; expected a time >= 0 [s].")
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


def _checked(name: object, given: object) -> tuple[Interval, ...]:
    """The intervals of a contact, sorted."""
    if not isinstance(name, str):
        raise InputError(f"ContactSchedule names a contact {name!r:.80}; expected a name, e.g. 'left_sole'.")
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise InputError(f"intervals of {name!r:.80} are {given!r:.80}; expected [(start, end), ...] [s].")
    found = sorted(_pair(name, each) for each in given)
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
