"""Contact schedules: when contacts are wanted, how their forces fade, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rbd
from rbd.control import ContactSchedule

INF = math.inf


def test_a_contact_is_wanted_from_start_to_before_end():
    """Half-open intervals; times that are off by rounding are the same."""
    schedule = ContactSchedule({"foot": [(1.6, INF), (-INF, 1.0)]})
    assert schedule.intervals["foot"] == ((-INF, 1.0), (1.6, INF))
    assert [schedule.wants("foot", t) for t in (-5.0, 0.0, 0.999, 1.0, 1.59, 1.6, 100.0)] == [1, 1, 1, 0, 0, 1, 1]
    assert not schedule.wants("foot", sum([0.1] * 10))  # 0.9999999999999999
    assert schedule.wants("foot", math.nextafter(1.6, 0.0))


def test_what_is_not_named_is_always_wanted():
    """And has its full force."""
    schedule = ContactSchedule({"foot": []})
    assert schedule.wants("other", 3.0) and schedule.share("other", 3.0) == 1.0
    assert not schedule.wants("foot", 0.0) and schedule.share("foot", 0.0) == 0.0
    assert schedule.wanted(0.0) == ()


def test_force_falls_to_zero_before_the_end_and_rises_from_zero_after_the_start():
    """3 x^2 - 2 x^3 over the fade: without a jump, nor a jump of its slope."""
    schedule = ContactSchedule({"foot": [(0.5, 1.0)]}, fade=0.1)
    t = np.linspace(0.4, 1.1, 7001)
    share = np.array([schedule.share("foot", x) for x in t])
    x = (t - 0.5) / 0.1
    rising = (t >= 0.5) & (t <= 0.6)
    assert np.abs(share[rising] - (3 * x**2 - 2 * x**3)[rising]).max() < 1e-9
    assert share[t < 0.5].max() == share[t > 1.0].max() == 0.0
    assert share[(t > 0.6) & (t < 0.9)].min() == 1.0
    assert np.abs(np.diff(share)).max() < 1.6e-4 / 0.1  # the steepest slope is 1.5 / fade
    assert np.abs(share - share[::-1]).max() < 1e-9  # it falls as it rises: 0.75 is the middle of the times


def test_a_short_interval_never_carries_its_full_force():
    """Both fades bound it."""
    schedule = ContactSchedule({"foot": [(0.0, 0.08)]}, fade=0.05)
    assert max(schedule.share("foot", t) for t in np.linspace(0.0, 0.08, 81)) == pytest.approx(0.896)  # 3 x^2 - 2 x^3, x = 0.8


def test_without_fading_a_force_is_full_or_nothing():
    """With a fade of no length."""
    schedule = ContactSchedule({"foot": [(0.0, 1.0)]}, fade=0.0)
    assert [schedule.share("foot", t) for t in (0.0, 0.9999, 1.0)] == [1.0, 1.0, 0.0]


def test_a_force_rises_from_when_the_contact_touched():
    """Late, early, or long ago; it falls before the end of the interval."""
    schedule = ContactSchedule({"foot": [(-INF, 0.5), (1.0, 2.0)]}, fade=0.1)
    assert schedule.fade_in("foot", 1.15, since=1.1) == pytest.approx(0.5)
    assert schedule.fade_in("foot", 0.95, since=0.9) == pytest.approx(0.5)
    assert schedule.fade_in("foot", 1.0, since=-INF) == 1.0
    assert schedule.fade_in("foot", 1.0) == schedule.fade_in("foot", 0.9) == 0.0
    assert [schedule.fade_out("foot", t) for t in (0.45, 1.95)] == pytest.approx([0.5, 0.5])
    assert schedule.fade_out("foot", 0.95) == schedule.fade_out("other", 0.45) == 1.0


def test_bounds_of_normal_forces_are_those_of_what_fades():
    """Others have none."""
    schedule = ContactSchedule({"left": [(0.0, 1.0)], "right": [(0.5, INF)]}, fade=0.1)
    assert schedule.normal_force(0.3, 800.0) == {}
    bounds = schedule.normal_force(0.95, 800.0)
    assert list(bounds) == ["left"] and bounds["left"] == pytest.approx((0.0, 400.0))
    assert schedule.normal_force(0.55, 800.0)["right"] == pytest.approx((0.0, 400.0))
    assert schedule.normal_force(0.52, 800.0, {"left": -INF, "other": 0.5}).keys() == {"other"}
    assert schedule.normal_force(0.95, 800.0, {"left": -INF}, {"left": 90.0})["left"] == pytest.approx((0.0, 45.0))
    assert schedule.normal_force(0.95, 800.0, {"left": 0.9}, {"left": 900.0})["left"] == pytest.approx((0.0, 400.0))


def test_the_first_time_in_flight_is_found():
    """From 0 on, among the contacts that are given; those not named are always there."""
    schedule = ContactSchedule({"left": [(-1.0, 1.0), (1.5, 2.0)], "right": [(0.8, 1.2), (1.9, INF)]})
    assert schedule.in_flight(["left", "right"]) == (1.2, 1.5)
    assert schedule.in_flight(["left", "right", "hand"]) is None
    assert schedule.in_flight([]) is None
    assert schedule.in_flight(["left"]) == (1.0, 1.5)
    assert schedule.in_flight(["right"]) == (0.0, 0.8)
    ends = ContactSchedule({"left": [(0.0, 1.0)], "right": [(0.0, 2.0)]})
    assert ends.in_flight(["left", "right"]) == (2.0, INF)
    meets = ContactSchedule({"left": [(0.0, 1.0)], "right": [(1.0, INF)]})
    assert meets.in_flight(["left", "right"]) is None


def test_a_swing_lasts_from_the_last_interval_to_the_next():
    """None while the contact is wanted."""
    schedule = ContactSchedule({"foot": [(0.0, 1.0), (1.6, 2.0)]})
    assert schedule.swing("foot", 0.5) is None and schedule.swing("other", 0.5) is None
    assert schedule.swing("foot", 1.0) == schedule.swing("foot", 1.3) == (1.0, 1.6)
    assert schedule.swing("foot", -1.0) == (-INF, 0.0) and schedule.swing("foot", 2.5) == (2.0, INF)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([("foot", [(0.0, 1.0)])], "expected {contact: "),
        ({3: [(0.0, 1.0)]}, "a contact of ContactSchedule is 3"),
        ({"foot": 1.0}, "intervals of 'foot' is 1.0"),
        ({"foot": "now"}, "intervals of 'foot' is 'now'"),
        ({"foot": (0.0, 1.0)}, "an interval of 'foot' is 0.0"),
        ({"foot": [(0.0, 1.0, 2.0)]}, "expected two times"),
        ({"foot": [("0", "1")]}, "expected two times"),
        ({"foot": [(0.0, math.nan)]}, "expected two times"),
        ({"foot": [(1.0, 1.0)]}, r"interval \(1, 1\) of 'foot' is empty"),
        ({"foot": [(2.0, 1.0)]}, r"interval \(2, 1\) of 'foot' is empty"),
        ({"foot": [(INF, INF)]}, "is empty"),
        ({"foot": [(-INF, -INF)]}, "is empty"),
        ({"foot": [(0.0, 1.0), (0.5, 2.0)]}, r"overlap.*expected one interval, \(0, 2\)"),
        ({"foot": [(0.0, 3.0), (0.5, 2.0)]}, r"overlap.*expected one interval, \(0, 3\)"),
        ({"foot": [(1.0, 2.0), (0.0, 1.0)]}, "leave no time between them"),
    ],
)
def test_wrong_intervals_are_refused(given: object, message: str):
    """With what was given, and what was expected."""
    with pytest.raises(rbd.errors.InputError, match=message):
        ContactSchedule(given)


@pytest.mark.parametrize("given", [{"fade": -0.1}, {"fade": math.nan}, {"fade": INF}, {"fade": "0.1"}, {"flight": 1}])
def test_wrong_settings_are_refused(given: dict[str, object]):
    """By name."""
    with pytest.raises(rbd.errors.InputError, match=f"{next(iter(given))} of ContactSchedule is"):
        ContactSchedule({}, **given)
