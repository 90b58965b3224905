"""The shortest plan that is found where times are free: all of them longer or shorter by one factor, but those of flights.

How long contacts need at least, by the momentum of the whole plan, is found first; nothing shorter is tried. Then the times
between keyframes and changes of contacts are shared out by what moves, and made shorter again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rbd.arrays import Array
from rbd.errors import CannotPlan
from rbd.planning.helping import halved
from rbd.planning.momentum import Momentum
from rbd.planning.stays import PlannedContacts

STEP, NEAR = 2.0, 1.1
"""The factor by which times are doubled or halved at first; and the factor between the longest duration without a plan and the
shortest with one at which the search ends."""
PLANS, SHARED = 8, 4
"""Plans that are tried at most; and with times that are shared out."""
SHORTER = 1.25
"""The factor by which the first of these is shorter than what was found before."""
LEAST_WAY, SWINGS = 0.03, 1.0 / 3.0
"""Of what gets how much time: a way of the centre of mass that is added to all [m]; a contact's counts as this share of it."""
SHORTEST, HALVED = 1.0 / 16.0, 10
"""Times are not made shorter by more than this; how often the range of the least factor is halved."""

SAME = 9
"""Decimals of a second to which times are rounded: those that agree count as one."""

T = TypeVar("T")


def stretched(supports: PlannedContacts, factor: float) -> PlannedContacts:
    """The same poses and contacts, all times longer by a factor but those in which nothing stands."""
    t, flies = _changes(supports)
    return _retimed(supports, t, np.where(flies, 1.0, factor) * np.diff(t))


def shared_out(supports: PlannedContacts) -> PlannedContacts:
    """The same poses, contacts and duration; each part between keyframes and changes of contacts gets time by what moves.

    Flights keep their times.
    """
    t, flies = _changes(supports)
    known = np.array([x for x, _ in supports.keys]), np.array([state.com for _, state in supports.keys])
    ways = np.zeros(len(t) - 1)
    for own in filter(None, supports.stays):
        ends, places = [x for s in own for x in (s.start, s.end)], [s.X.translation for s in own for _ in range(2)]
        ways = np.maximum(ways, np.linalg.norm(np.diff(_between(t, np.array(ends), np.array(places)), axis=0), axis=1))
    parts, h = parts_of(_between(t, *known), ways), np.diff(t)
    return _retimed(supports, t, np.where(flies, h, parts * h[~flies].sum() / parts[~flies].sum()))


def parts_of(com: Array, ways: Array) -> Array:
    """What time from place to place grows with, shape (n - 1,): the root of what moves, as at equal accelerations.

    That is the way of the centre of mass, or a third of that of a contact.

    Args:
        com: Places of the centre of mass in turn, shape (n, 3) [m].
        ways: How far a contact is moved before each of them but the first, shape (n - 1,) [m].
    """
    return np.sqrt(LEAST_WAY + np.maximum(np.linalg.norm(np.diff(com, axis=0), axis=1), SWINGS * ways))


def _changes(supports: PlannedContacts) -> tuple[Array, Array]:
    """(times of keyframes and of changes of contacts, shape (n,); whether nothing stands between two, shape (n - 1,))."""
    first = supports.keys[0][0]
    ends = [x for own in supports.stays for s in own for x in (s.start, s.end)]
    t = np.unique(np.round([*(x for x, _ in supports.keys), *ends], SAME))
    middle = 0.5 * (t[:-1] + t[1:]) - first
    return t, np.array([any(start < x < end for start, end in Momentum.of(supports).flights) for x in middle])


def _between(t: Array, known: Array, places: Array) -> Array:
    return np.column_stack([np.interp(t, known, x) for x in places.T])


def _retimed(supports: PlannedContacts, t: Array, parts: Array) -> PlannedContacts:
    """The same, with other times between those of `_changes`."""
    after = t[0] + np.concatenate([[0.0], np.cumsum(parts)])

    def later(x: float) -> float:
        return float(after[np.abs(t - x).argmin()])

    stays = tuple(tuple(replace(s, start=later(s.start), end=later(s.end)) for s in own) for own in supports.stays)
    return replace(supports, stays=stays, keys=tuple((later(x), state) for x, state in supports.keys))


def shortest(supports: PlannedContacts, planned: Callable[[PlannedContacts], T]) -> T:
    """The shortest that was found, by steps from the times given and then by halves; then with times that are shared out.

    Args:
        supports: Poses and contacts, with times to begin with.
        planned: Plan these, or raise `CannotPlan`.

    Raises:
        CannotPlan: none was found; that of the longest.
    """
    low, high, best, failed = _least(supports), np.inf, None, None
    factor = max(1.0, low)
    for _ in range(PLANS):
        try:
            best = planned(stretched(supports, factor))
            high = factor
        except CannotPlan as error:
            failed = error if best is None else failed
            low = factor
        if high < NEAR * low:
            break
        factor = low * STEP if best is None else max(high / STEP, np.sqrt(low * high))
    if best is not None:
        return _shorter(shared_out(stretched(supports, high)), planned, best)
    assert failed is not None
    failed.args = (f"with {low:.3g} times as much time neither: {failed.args[0]}",)
    raise failed


def _shorter(supports: PlannedContacts, planned: Callable[[PlannedContacts], T], best: T) -> T:
    """The shortest with these shares of the time, or what was found before, in as much time."""
    low, high, factor = SHORTEST, 1.0, 1.0 / SHORTER
    for _ in range(SHARED):
        some = stretched(supports, factor)
        try:
            if Momentum.of(some).refused:
                raise CannotPlan("the momentum excludes it")
            best, high = planned(some), factor
        except CannotPlan:
            low = factor
        if high < NEAR * low:
            break
        factor = np.sqrt(low * high) if low > SHORTEST else high / SHORTER
    return best


def _least(supports: PlannedContacts) -> float:
    """The least factor at which contacts can give the momentum; at least `SHORTEST`."""
    low, high = np.log(SHORTEST), 0.0

    def refused(factor: float) -> bool:
        return Momentum.of(stretched(supports, factor)).refused

    while high < 4.0 and refused(np.exp(high)):
        low, high = high, high + 0.5
    return halved(refused, low, high, HALVED)[0]
