"""Times that are free: longer where none is possible as given, shorter where one is; flights keep theirs."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.errors import CannotPlan, InputError
from rbd.planning import free_times
from rbd.planning.free_times import LEAST_WAY, NEAR, PLANS, SHARED, _least, parts_of, shared_out, shortest, stretched
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
    """Within ten percent, of a motion that is possible from some factor on; none is tried that the momentum excludes."""
    tried = list[float]()

    def planned(supports: PlannedContacts) -> float:
        assert not Momentum.of(supports).refused or len(tried) == 0
        tried.append((supports.keys[-1][0] - 0.2) / 0.4)
        if tried[-1] < max(least, _least(leap)) - 1e-12:
            raise CannotPlan("too fast")
        return tried[-1]

    found, bound = shortest(leap, planned), max(least, _least(leap))
    assert bound * (1.0 - 1e-9) <= found <= NEAR * bound * (1.0 + 1e-9)
    assert len(tried) <= PLANS + SHARED


def test_what_moves_far_gets_time(solo: rbd.Robot):
    """Four times the way takes twice the time, but for what all get; a contact's way counts as a third."""
    x = np.outer(np.cumsum([0.0, 0.1 - LEAST_WAY, 0.4 - LEAST_WAY, 0.0]), [1.0, 0.0, 0.0])
    assert parts_of(x, np.array([0.0, 0.0, 0.3])) == pytest.approx(np.sqrt([0.1, 0.4, LEAST_WAY + 0.1]))
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    near, far = ({"com": stand.com + [by, 0.0, 0.0]} for by in (0.01, 0.07))  # ways of 1, 6 and 0 cm
    given = planned_contacts(solo, {0.0: stand, 1.0: near, 2.0: far, 3.0: far}, feet, friction=0.6, ground=0.0)
    t = np.array([t for t, _ in shared_out(given).keys])
    assert np.diff(t) == pytest.approx(3.0 * np.sqrt([0.04, 0.09, 0.03]) / np.sqrt([0.04, 0.09, 0.03]).sum(), rel=1e-6)


def test_a_flight_keeps_its_time_where_others_are_shared_out(leap: PlannedContacts):
    """And the duration is the same."""
    shared = shared_out(leap)
    spans = [(s.start, s.end) for s in shared.stays[0]]
    assert spans[1][0] - spans[0][1] == pytest.approx(0.2) and shared.keys[-1][0] == pytest.approx(0.6)


def test_shared_times_are_shorter(solo: rbd.Robot):
    """Three parts, of which the one that moves needs a second: 3 s in equal parts, and 2.1 s by their ways; within 10 %."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    far = {"com": stand.com + [0.07, 0.0, 0.0]}
    keys = {0.0: stand, 1.0: {"com": stand.com}, 2.0: far, 3.0: far}
    given = planned_contacts(solo, keys, feet, friction=0.6, ground=0.0)

    def planned(supports: PlannedContacts) -> float:
        t = np.array([t for t, _ in supports.keys])
        if (np.diff(t) < [0.1, 1.0, 0.1]).any():
            raise CannotPlan("too fast")
        return float(t[-1])

    least = (2.0 * np.sqrt(LEAST_WAY) + np.sqrt(LEAST_WAY + 0.07)) / np.sqrt(LEAST_WAY + 0.07)
    assert least <= shortest(given, planned) <= NEAR * least < 3.0


def test_where_none_is_found_the_longest_is_told(leap: PlannedContacts):
    """With its factor."""

    def planned(supports: PlannedContacts) -> float:
        raise CannotPlan(f"not in {supports.keys[-1][0]:.0f} s")

    with pytest.raises(CannotPlan, match=r"with \d+.* times as much time neither: not in \d+ s"):
        shortest(leap, planned)


def test_a_squat_gets_as_much_time_as_it_needs(solo: rbd.Robot, monkeypatch: pytest.MonkeyPatch):
    """12 cm down and up in 0.16 s is none; what is found is certified, slower, and keeps to its keyframes."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    keys = {0.0: stand, 0.08: {"com": stand.com - [0.0, 0.0, 0.12]}, 0.16: stand}
    monkeypatch.setattr(free_times, "PLANS", 4)
    monkeypatch.setattr(free_times, "SHARED", 0)
    with pytest.raises(CannotPlan):
        rbd.plan(solo, keys, feet, progress=False)
    plan = rbd.plan(solo, keys, feet, times="free", progress=False)
    assert plan.certified and 0.16 < plan.duration < 0.8
    assert plan.contacts.keys[1][0] == pytest.approx(0.5 * plan.duration, abs=0.5 * (plan.curve.t[1] - plan.curve.t[0]) + 1e-9)


def test_words(solo: rbd.Robot):
    """Times that are neither."""
    with pytest.raises(InputError, match="times of plan is 'fre'; .*'free'"):
        rbd.plan(solo, {0.0: "standing", 1.0: "standing"}, {foot.name: True for foot in solo.feet()}, times="fre")
