"""The shortest plan that is found where times are free: all of them longer or shorter by one factor, but those of flights.

How long contacts need at least, by the momentum of the whole plan, is found first; nothing shorter is tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rbd.errors import CannotPlan
from rbd.planning.helping import halved
from rbd.planning.momentum import Momentum
from rbd.planning.stays import PlannedContacts

STEP, NEAR = 2.0, 1.1
"""The factor by which times are doubled or halved at first; and the factor between the longest duration without a plan and the
shortest with one at which the search ends."""
PLANS = 8
"""Plans that are tried at most."""
SHORTEST, HALVED = 1.0 / 16.0, 10
"""Times are not made shorter by more than this; how often the range of the least factor is halved."""

T = TypeVar("T")


def stretched(supports: PlannedContacts, factor: float) -> PlannedContacts:
    """The same poses and contacts, all times longer by a factor but those in which nothing stands."""
    first = supports.keys[0][0]
    air = [(first + start, first + end) for start, end in Momentum.of(supports).flights]

    def later(t: float) -> float:
        flown = sum(min(max(t - start, 0.0), end - start) for start, end in air)
        return first + factor * (t - first - flown) + flown

    stays = tuple(tuple(replace(s, start=later(s.start), end=later(s.end)) for s in own) for own in supports.stays)
    return replace(supports, stays=stays, keys=tuple((later(t), state) for t, state in supports.keys))


def shortest(supports: PlannedContacts, planned: Callable[[PlannedContacts], T]) -> T:
    """The shortest that was found, by steps from the times given and then by halves.

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
        return best
    assert failed is not None
    failed.args = (f"with {low:.3g} times as much time neither: {failed.args[0]}",)
    raise failed


def _least(supports: PlannedContacts) -> float:
    """The least factor at which contacts can give the momentum; at least `SHORTEST`."""
    low, high = np.log(SHORTEST), 0.0

    def refused(factor: float) -> bool:
        return Momentum.of(stretched(supports, factor)).refused

    while high < 4.0 and refused(np.exp(high)):
        low, high = high, high + 0.5
    return halved(refused, low, high, HALVED)[0]
