"""Times that are free: longer where none is possible as given, shorter where one is; flights keep theirs."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.errors import CannotPlan, InputError
from rbd.planning import free_times
from rbd.planning.free_times import NEAR, _least, shortest, stretched
from rbd.planning.momentum import Momentum
from rbd.planning.stays import PlannedContacts, planned_contacts


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def leap(solo: rbd.Robot) -> PlannedContacts:
    """30 cm on a slippery floor, in the air from 0.2 to 0.4 s."""
    stand = solo.standing()
    keys = {0.0: stand, 0.6: stand.q + 0.3 * np.eye(solo.nq)[0]}
    feet = {foot.name: [(0.0, 0.2), (0.4, 0.6)] for foot in solo.feet()}
    return planned_contacts(solo, keys, feet, friction=0.1, ground=0.0)


def test_flights_keep_their_time(leap: PlannedContacts):
    """Twice as much time on the ground, as much in the air, the same poses."""
    slow = stretched(leap, 2.0)
    assert [(s.start, s.end) for s in slow.stays[0]] == [pytest.approx((0.0, 0.4)), pytest.approx((0.6, 1.0))]
    assert slow.keys[-1][0] == pytest.approx(1.0) and slow.keys[-1][1] is leap.keys[-1][1]
    assert slow.stays[0][1].X is leap.stays[0][1].X


def test_nothing_shorter_than_the_momentum_allows_is_tried(leap: PlannedContacts):
    """From rest to rest over mu g T^2 / 2 at most, and longer: its legs have to reach the ground where they leave and land."""
    factor = _least(leap)
    assert Momentum.of(stretched(leap, 0.99 * factor)).refused and not Momentum.of(stretched(leap, 1.01 * factor)).refused
    T = stretched(leap, factor).keys[-1][0]
    assert T > 1.1 * np.sqrt(2.0 * 0.3 / (0.1 * 9.81))


@pytest.mark.parametrize("least", [0.3, 1.7, 5.0])
def test_the_shortest_that_is_possible_is_found(leap: PlannedContacts, least: float):
    """Within ten percent, of a motion that is possible from some factor on."""
    tried = list[float]()

    def planned(supports: PlannedContacts) -> float:
        tried.append((supports.keys[-1][0] - 0.2) / 0.4)
        if tried[-1] < max(least, _least(leap)) - 1e-12:
            raise CannotPlan("too fast")
        return tried[-1]

    found, bound = shortest(leap, planned), max(least, _least(leap))
    assert bound * (1.0 - 1e-9) <= found <= NEAR * bound * (1.0 + 1e-9)
    assert min(tried) >= _least(leap) * (1.0 - 1e-9)


def test_where_none_is_found_the_longest_is_told(leap: PlannedContacts):
    """With its factor."""

    def planned(supports: PlannedContacts) -> float:
        raise CannotPlan(f"not in {supports.keys[-1][0]:.0f} s")

    with pytest.raises(CannotPlan, match=r"with \d+.* times as much time neither: not in \d+ s"):
        shortest(leap, planned)


def test_a_squat_gets_as_much_time_as_it_needs(solo: rbd.Robot, monkeypatch: pytest.MonkeyPatch):
    """12 cm down and up in 0.16 s is none; what is found is proved, slower, and keeps to its keyframes."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    keys = {0.0: stand, 0.08: {"com": stand.com - [0.0, 0.0, 0.12]}, 0.16: stand}
    monkeypatch.setattr(free_times, "PLANS", 4)
    with pytest.raises(CannotPlan):
        rbd.plan(solo, keys, feet, progress=False)
    plan = rbd.plan(solo, keys, feet, times="free", progress=False)
    assert plan.proved and 0.16 < plan.duration < 0.8
    assert plan.contacts.keys[1][0] == pytest.approx(0.5 * plan.duration, abs=0.5 * (plan.curve.t[1] - plan.curve.t[0]) + 1e-9)


def test_words(solo: rbd.Robot):
    """Times that are neither."""
    with pytest.raises(InputError, match="times of plan is 'fre'; .*'free'"):
        rbd.plan(solo, {0.0: "standing", 1.0: "standing"}, {foot.name: True for foot in solo.feet()}, times="fre")
