"""Contacts that are left open: onto a box and over a gap without being told which foot; refusals with what was tried."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import CannotPlan, InputError
from rbd.planning.contact_search import BUDGET, FLIGHT, PUSH, ContactSearch, _inside, grasps
from rbd.planning.stays import centre_of


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def moved(robot: rbd.Robot, by: list[float]) -> dict[str, Any]:
    """Where feet are put down: all where they stand, moved by the same."""
    stand, out = robot.standing(), dict[str, Any]()
    for foot in robot.feet():
        X = centre_of(stand, foot)
        out[foot.name] = pin.SE3(X.rotation, X.translation + by) if len(foot.corners) > 1 else X.translation + by
    return out


def box(height: float) -> rbd.Terrain:
    """In front of the feet of Talos."""
    return rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), ((0.25, -1.0, 0.0), (1.5, 1.0, height)))


def gap(width: float) -> rbd.Terrain:
    """In front of the feet of Solo12."""
    return rbd.Terrain.boxes(((-1.0, -1.0, -0.5), (0.22, 1.0, 0.0)), ((0.22 + width, -1.0, -0.5), (2.0, 1.0, 0.0)))


def test_onto_a_box(talos: rbd.Robot, exhaustive: bool):
    """20 cm: one foot, then the other; certified. In an exhaustive run it is followed without a violated step."""
    terrain = box(0.2)
    keys = {0.0: talos.standing(), 5.0: moved(talos, [0.4, 0.0, 0.2])}
    plan = rbd.plan(talos, keys, "search", ground=terrain, progress=False)
    assert plan.certified and plan.state(5.0).com[2] > plan.state(0.0).com[2] + 0.15
    spans = {foot.name: plan.contacts.intervals(foot.name) for foot in talos.feet()}
    assert all(len(own) == 2 for own in spans.values())
    (a, b), (c, d) = sorted((own[0][1], own[1][0]) for own in spans.values())
    assert 0.0 < a < b < c < d < 5.0
    if exhaustive:
        follow(plan, terrain)


def follow(plan: rbd.planning.Plan, terrain: rbd.Terrain, *hands: Any) -> None:
    """Simulated to the end."""
    controller, feet = rbd.control.follow(plan), [*plan.robot.feet(friction=0.6, on=terrain), *hands]
    T = plan.duration + 0.2
    run = rbd.simulate(plan.state(0.0), feet, duration=T, step=2e-3, controller=controller, progress=False)
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(plan.state(plan.duration).com, abs=1e-4)


def test_over_a_gap(solo: rbd.Robot, exhaustive: bool):
    """15 cm, over which a foot of Solo12 reaches: eight steps, none into the gap; planned and followed in an exhaustive run."""
    terrain, keys = gap(0.15), {0.0: solo.standing(), 12.0: moved(solo, [0.75, 0.0, 0.0])}
    search = search_of(solo, keys, terrain)
    steps = next(search.sequences())
    assert len(steps) == 8
    for step in steps:
        assert not 0.22 - 0.015 < step.X.translation[0] < 0.37 + 0.015
    if exhaustive:
        plan = rbd.plan(solo, keys, "search", ground=terrain, progress=False)
        assert plan.certified
        follow(plan, terrain)


def search_of(robot: rbd.Robot, keys: Any, ground: Any, friction: float = 0.6) -> ContactSearch:
    """As `rbd.plan` makes it."""
    return ContactSearch.of(robot, keys, friction=friction, ground=ground, limited=robot, self_collision=True)


def test_steps_are_held_on_the_other_feet(solo: rbd.Robot):
    """The centre of mass is in the support region of those that stand, feet are where they are said to be, swings rise."""
    search = search_of(solo, {0.0: solo.standing(), 4.0: moved(solo, [0.1, 0.02, 0.0])}, 0.0, friction=0.7)
    steps, feet = next(search.sequences()), solo.feet(friction=0.7, on=0.0)
    assert sorted(step.foot for step in steps) == [0, 1, 2, 3]
    at = [centre_of(solo.standing(), foot).translation for foot in feet]
    for step in steps:
        others = [foot for i, foot in enumerate(feet) if i != step.foot]
        for state in (step.lift, step.land):
            at[step.foot] = step.X.translation if state is step.land else at[step.foot]
            for foot, place in zip(feet, at, strict=True):
                assert centre_of(state, foot).translation == pytest.approx(place, abs=1e-9)
            region = rbd.statics.support_region(rbd.State(solo, state.q), others)
            assert region.distance() > 5e-3
    supports = search.contacts(steps)
    t = np.linspace(0.0, 4.0, 401)
    _, p, free = supports.on_knots(t).paths(t)
    heights = p[:, :, 2] - p[0, :, 2]
    assert (heights[free == 0.0] == pytest.approx(0.0, abs=1e-9)) and (heights.max(axis=0) > 0.9 * supports.lift).all()


def test_a_gap_that_is_leapt(solo: rbd.Robot, exhaustive: bool):
    """40 cm, wider than a step: two leaps, no foot lands in the gap; planned and followed in an exhaustive run."""
    terrain, keys = gap(0.4), {0.0: solo.standing(), 3.0: moved(solo, [0.9, 0.0, 0.0])}
    search = search_of(solo, keys, terrain)
    leaps = next(search.leaps())
    assert len(leaps) == 2 and any("leap of" in words and "out of reach" in words for words in search.tried)  # one of 90 cm
    for leap in leaps:
        x = np.array([X.translation[0] for X in leap.to])
        assert ((x < 0.22 - 0.015 + 1e-9) | (x > 0.62 + 0.015 - 1e-9)).all()
        way = leap.land.com - leap.off.com  # it flies as fast as it is after 0.2 s from rest at constant acceleration
        assert way[0] / FLIGHT == pytest.approx(2.0 * (leap.off.com - leap.low.com)[0] / PUSH, rel=1e-6)
    supports = search.contacts(leaps)
    spans = {foot.name: supports.intervals(foot.name) for foot in solo.feet()}
    assert supports.flies and len(set(map(str, spans.values()))) == 1
    (a, b), (c, d), (e, f) = spans["front_left"]
    assert (a, f) == (0.0, 3.0) and [c - b, e - d] == pytest.approx([FLIGHT, FLIGHT])
    with pytest.raises(CannotPlan, match="leaps take 1.4 s .* give 1.75 s or more"):
        search_of(solo, {0.0: solo.standing(), 1.5: keys[3.0]}, terrain).contacts(leaps)
    if exhaustive:
        assert next(search.sequences(), None) is None  # it cannot be stepped over
        plan = rbd.plan(solo, keys, "search", ground=terrain, progress=False)
        assert plan.certified
        follow(plan, terrain)


def test_a_gap_that_is_too_wide(solo: rbd.Robot):
    """80 cm: refused within the budget, with each step and leap that was tried and what stopped it."""
    keys = {0.0: solo.standing(), 9.0: moved(solo, [1.3, 0.0, 0.0])}
    with pytest.raises(CannotPlan, match="steps and leaps were tested, and 0 sequences of them planned") as caught:
        rbd.plan(solo, keys, "search", ground=gap(0.8), progress=False)
    tried = caught.value.tried
    assert 8 <= len(tried) <= BUDGET + 48 and any("out of reach" in words for words in tried)
    assert any("no place near" in words for words in tried) and any("leap of" in words for words in tried)
    assert any(foot.name in words for words in tried for foot in solo.feet())


def test_a_box_that_is_too_high(talos: rbd.Robot):
    """90 cm: neither foot gets there from the ground."""
    keys = {0.0: talos.standing(), 5.0: moved(talos, [0.4, 0.0, 0.9])}
    with pytest.raises(CannotPlan, match="0 sequences of them planned") as caught:
        rbd.plan(talos, keys, "search", ground=box(0.9), progress=False)
    assert {"left_sole", "right_sole"} <= {words.split("'")[1] for words in caught.value.tried}


def rail_of(robot: rbd.Robot) -> rbd.PointContact:
    """The left hand, which may touch the top of a rail beside it."""
    at = robot.standing().frame("gripper_left_base_link").X_WF.translation + [0.15, 0.02, -0.03]
    low, high = at - [0.07, 0.07, 0.05], at + [0.45, 0.06, 0.0]
    rail = rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), (tuple(low), tuple(high)))
    return rbd.PointContact("hand", "gripper_left_base_link", friction=0.5, on=rail)


def test_a_hand_on_a_rail_where_legs_are_too_weak(talos: rbd.Robot, exhaustive: bool):
    """65 % of the legs' torques: neither leg lifts it onto 20 cm, and it does with a hand; planned in an exhaustive run."""
    legs = {name: x for name, x in zip(talos.actuated_names, talos.effort_limit, strict=True) if name.startswith("leg")}
    weak, hand = talos.with_motors({name: rbd.Motor(limit=0.65 * x) for name, x in legs.items()}), rail_of(talos)
    keys, terrain = {0.0: weak.standing(), 6.0: moved(weak, [0.4, 0.0, 0.2])}, box(0.2)
    search = ContactSearch.of(
        weak, keys, friction=0.6, ground=terrain, limited=weak, self_collision=True, hands=[hand]
    )  # fmt: skip
    alone, *held = search.supports()
    assert alone == () and len(held) == 4 and next(search.sequences(), None) is None
    assert any("a torque limit prevents it" in words for words in search.tried)
    search = replace(search, held=held[0], tested={})
    steps = next(search.sequences())
    assert sorted(step.foot for step in steps) == [0, 1]
    for step in steps:
        other = search.feet[1 - step.foot]
        for state in (step.lift, step.land):
            assert centre_of(state, hand).translation == pytest.approx(held[0][0][1], abs=1e-9)
            assert rbd.hold(rbd.State(weak, state.q), [other, hand]).forces["hand"][2] > 10.0
    spans = search.contacts(steps)
    assert spans.intervals("hand")[0][0] < min(spans.intervals(foot.name)[0][1] for foot in search.feet)
    assert spans.intervals("hand")[0][1] > max(spans.intervals(foot.name)[1][0] for foot in search.feet)
    if exhaustive:
        plan = rbd.plan(weak, keys, "search", ground=terrain, hands=[hand], progress=False)
        assert plan.certified and plan.contacts.intervals("hand") and plan.torque_use <= 1.0
        follow(plan, terrain, hand)


def test_places_of_hands(talos: rbd.Robot):
    """On a wall the nearest point; on a rail points of its top, the nearest first; none where it is too far."""
    wall = rbd.PointContact("hand", "gripper_left_base_link", friction=0.5, on=rbd.Ground(point=(0.5, 0, 0), normal=(-1, 0, 0)))
    assert np.array(grasps(wall, np.array([0.1, 0.2, 1.0]))) == pytest.approx(np.array([[0.5, 0.2, 1.0]]))
    hand = rail_of(talos)
    at = talos.standing().frame("gripper_left_base_link").X_WF.translation
    places = np.array(grasps(hand, at))
    far = np.linalg.norm(places - at, axis=1)
    assert len(places) == 4 and (np.diff(far) >= 0.0).all() and places[:, 2] == pytest.approx(at[2] - 0.03)
    assert grasps(hand, at + [0.0, 3.0, 0.0]) == []


def test_the_nearest_place_that_is_well_inside():
    """Of a unit square: on the way to its middle, half as far from an edge; where it is inside already, itself."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert _inside(np.array([-0.5, 0.5]), square) == pytest.approx([0.25, 0.5], abs=0.05)
    assert _inside(np.array([0.4, 0.6]), square) == pytest.approx([0.4, 0.6])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"contacts": "searching"}, "contacts of plan is 'searching'.*search"),
        ({"keyframes": {0.0: "standing", 1.0: "standing", 2.0: "standing"}}, "expected two, the first and the last"),
        ({"keyframes": ["standing"]}, "expected two"),
        ({"ground": None}, "expected a height, Ground or Terrain"),
        ({"hands": [rbd.PointContact("hand", "FL_FOOT", friction=0.5)]}, "a point and its surface"),
        ({"hands": ["FL_FOOT"]}, "a hand of plan"),
        ({"hands": [rbd.PointContact("hand", "FL_FOOT", friction=0.5)], "contacts": {"front_left": True}}, "give them among"),
    ],
)
def test_words(solo: rbd.Robot, given: dict[str, Any], said: str):
    """What is no search."""
    right: dict[str, Any] = {"keyframes": {0.0: "standing", 1.0: "standing"}, "contacts": "search", "progress": False}
    with pytest.raises(InputError, match=said):
        rbd.plan(solo, **(right | given))
