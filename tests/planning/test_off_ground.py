"""Links off the ground: distances against Coal's and against corners, the bound between knots, what is kept off and refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.convex.convex_shapes import polyhedron
from rbd.errors import CannotPlan
from rbd.motion.frame_terms import placements
from rbd.motion.ground_clearance import ROOM_M, OverGround
from rbd.motion.self_collision import DEEP_M
from rbd.planning import Plan
from rbd.planning.curve import Curve
from rbd.planning.kept_off import MEASURED, _bounds, off_ground, over_ground
from rbd.planning.stays import planned_contacts

LOW, TOP = 0.06, 0.08


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def stage(top: float = TOP) -> rbd.Terrain:
    """A floor, and a box between the feet, under the knees of the hind legs."""
    return rbd.Terrain.boxes(((-1.0, -1.0, -0.5), (1.0, 1.0, 0.0)), ((-0.15, -0.3, 0.0), (-0.05, 0.3, top)))


def bow(solo: rbd.Robot, T: float = 1.0, **given: Any) -> Plan:
    """The centre of mass goes down by 6 cm, with which hind knees would be 5 mm inside the box, and up again."""
    stand = solo.standing()
    keys: dict[float, Any] = {0.0: stand, 0.5: {"com": stand.com - [0.0, 0.0, LOW]}, 1.0: stand}
    keys = {t: key for t, key in keys.items() if t <= T}
    return rbd.plan(solo, keys, {foot.name: True for foot in solo.feet()}, progress=False, **{"ground": stage()} | given)


@pytest.fixture(scope="module")
def kept(solo: rbd.Robot) -> Plan:
    return bow(solo)


def links_over(plan: Plan, ground: Any = None) -> OverGround:
    """Its links over its ground, or over another."""
    contacts = plan.contacts if ground is None else replace(plan.contacts, contacts=tuple(plan.robot.feet(on=ground)))
    found = over_ground(contacts, plan.floor if ground is None else ground, 0.0)
    assert found is not None
    return found


def knees(plan: Plan, t: np.ndarray) -> np.ndarray:
    """How far hulls of the hind upper legs are from the box at times, by Coal, shape (n, 2) [m]."""
    box, at = coal.Box(0.1, 0.6, TOP), coal.Transform3s(np.eye(3), np.array([-0.1, 0.0, 0.5 * TOP]))
    own = [x.shape for x in links_over(plan).shapes if x.link in ("HL_UPPER_LEG", "HR_UPPER_LEG")]
    R, p = placements(plan.robot, plan.curve.at(t)[0])

    def gap(k: int, shape: Any) -> float:
        X = pin.SE3(R[k, shape.joint], p[k, shape.joint]) * shape.X_JC
        placed = coal.Transform3s(X.rotation, X.translation)
        return float(coal.distance(box, at, shape.coal, placed, coal.DistanceRequest(), coal.DistanceResult()))

    return np.array([[gap(k, shape) for shape in own] for k in range(len(t))])


def test_knees_are_kept_off_a_box(kept: Plan, solo: rbd.Robot):
    """They would be 5 mm inside, and are 5 mm off; the trunk goes down all the same."""
    t = np.linspace(0.0, 1.0, 101)
    assert kept.certified and knees(kept, t).min() > 5e-3
    free = bow(solo, clearance=None)
    assert free.between.off_ground is None and -8e-3 < knees(free, t).min() < -2e-3
    assert kept.state(0.5).com[2] == pytest.approx(free.state(0.5).com[2], abs=6e-3)
    assert "'HL_UPPER_LEG' comes nearest, to 'box 1'" in str(kept).replace("HR", "HL")


def test_the_least_clearance_is_that_of_a_fine_grid(kept: Plan):
    """Of the link that comes nearest: no more than on 2,001 instants, and less by no more than it may bend in a knot."""
    off = kept.between.off_ground
    assert off is not None and off.holds
    link, piece, gap, t = off.nearest
    dense = knees(kept, np.linspace(0.0, 1.0, 2001)).min()
    assert link in ("HL_UPPER_LEG", "HR_UPPER_LEG") and piece == "box 1" and 0.0 <= dense - gap < 1e-3
    assert knees(kept, np.linspace(t, t + 0.02, 41)).min() == pytest.approx(dense, abs=1e-3)


def test_a_clearance_is_kept(solo: rbd.Robot):
    """Of 15 mm, above a lower box."""
    plan = bow(solo, ground=stage(0.06), clearance=0.015)
    off = plan.between.off_ground
    assert plan.certified and off is not None and 0.015 <= off.nearest[2] < 0.015 + ROOM_M + MEASURED


def test_a_plan_that_was_changed_is_noticed(kept: Plan):
    """The same motion over a box that is 2 cm higher, and one that sinks by 2 cm between two knots: named, with depth."""
    off = off_ground(kept.curve, links_over(kept, stage(TOP + 0.02)))
    t, said, limit = off.worst
    depth = 0.02 - knees(kept, np.linspace(0.0, 1.0, 201)).min()
    assert not off.holds and limit.kind == "ground" and "_UPPER_LEG' may come to be" in said and "mm inside 'box 1'" in said
    assert float(said.split(" be ")[1].split(" mm")[0]) == pytest.approx(1e3 * depth, abs=1.0) and 0.4 < t < 0.6
    spline = type(kept.curve.spline)(kept.curve.t, kept.curve.spline(kept.curve.t))
    middle = len(kept.curve.t) // 2
    spline.c = spline.c.copy()
    spline.c[0, middle, 2] -= 4.0 * 0.02 / np.diff(kept.curve.t)[middle] ** 3
    assert not off_ground(replace(kept.curve, spline=spline), links_over(kept)).holds


def test_a_keyframe_inside_a_box_is_refused_by_name(solo: rbd.Robot):
    """The last one, which a plan meets exactly."""
    with pytest.raises(CannotPlan, match=r"keyframe at 0.5 s 'H._UPPER_LEG' is 4.\d mm inside 'box 1'") as caught:
        bow(solo, T=0.5)
    assert caught.value.t == (0.5,) and caught.value.limits[0].kind == "ground"


@pytest.mark.parametrize("height", [0.06, 0.1])
def test_a_foot_goes_over_a_wall_or_is_refused_by_name(solo: rbd.Robot, height: float):
    """2 cm thick, between its places: 6 cm high; 10 cm in half a second are too high."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    wall = rbd.Terrain.boxes(((-1.0, -1.0, -0.5), (1.0, 1.0, 0.0)), ((0.225, 0.1, 0.0), (0.245, 0.3, height)))
    place = next(f for f in solo.feet() if f.name == "front_left").points(stand).positions[0] + [0.1, 0.0, 0.0]
    given = {0.0: stand, 2.0: {"front_left": place}}, feet | {"front_left": [(0.0, 0.5), (1.0, 2.0)]}
    if height > 0.06:
        with pytest.raises(CannotPlan, match=r"'front_left' may come to be .* mm inside 'box 1'") as caught:
            rbd.plan(solo, *given, ground=wall, rate=50.0, progress=False)
        assert caught.value.plan is not None and [limit.name for limit in caught.value.limits] == ["front_left"]
        return
    plan = rbd.plan(solo, *given, ground=wall, rate=100.0, progress=False)
    foot = [plan.robot.feet()[0].points(plan.state(t)).positions[0] for t in np.linspace(0.5, 1.0, 201)]
    assert plan.certified and wall.distances(np.array(foot)).min() > -1e-3 and max(x[2] for x in foot) > height


def tilted() -> rbd.Terrain:
    """A box with edges and corners upwards."""
    X = pin.SE3(pin.utils.rotate("y", 0.3), np.array([0.05, 0.0, -0.1]))
    return rbd.Terrain({"box": (coal.Box(0.3, 0.25, 0.2), X)})


@pytest.mark.parametrize("uneven", [False, True])
def test_distances_are_those_of_coal(solo: rbd.Robot, rng: np.random.Generator, uneven: bool):
    """At random poses near to a slope, or to a box whose edges and corners some links are nearest to."""
    box = tilted()
    slope = rbd.Ground(point=(0.0, 0.0, -0.1), normal=(0.28, 0.0, 0.96))
    ground: Any = box if uneven else slope
    over = OverGround.of(solo, solo.feet(on=ground), ground, np.zeros((1, 3)))
    q = np.array([pin.integrate(solo.model, solo.neutral(), rng.normal(0.0, 0.4, solo.nv)) for _ in range(30)])
    q[:, :3] = rng.uniform(-0.1, 0.1, (30, 3)) + [0.0, 0.0, 0.15]
    R, p = placements(solo, q)
    found, exact, edges = {}, {}, 0
    for i, j, near in over.near(R, p, 0.1):
        found |= {(i, int(k)): gap for k, gap in zip(near.frames, near.gap, strict=True)}
        faces = np.abs(near.normal @ over.pieces[j].faces[:, :3].T).max(axis=1)
        edges += int((faces < 1.0 - 1e-6).sum())
    for i, one in enumerate(over.shapes):
        if one.contacts:
            continue  # less what is near to their points
        for k in range(len(q)):
            X = pin.SE3(R[k, one.joint], p[k, one.joint]) * one.shape.X_JC
            placed, result = coal.Transform3s(X.rotation, X.translation), coal.DistanceResult()
            piece = polyhedron("box", over.pieces[0].vertices).coal if uneven else coal.Halfspace(slope.normal, slope.height)
            gap = coal.distance(piece, coal.Transform3s(), one.shape.coal, placed, coal.DistanceRequest(), result)
            if 0.0 < gap < 0.1:
                exact[i, k] = gap
    assert len(exact) > 30 and max(abs(found[key] - gap) for key, gap in exact.items()) < 1e-6
    assert (edges > 10) == uneven


def test_links_are_no_nearer_than_the_bound(solo: rbd.Robot, rng: np.random.Generator):
    """Between knots of a fast random motion beside a tilted box, on a fine grid; the bound is within 2 mm of some."""
    box = tilted()
    over = OverGround.of(solo, solo.feet(on=box), box, np.zeros((1, 3)))
    t, start = np.linspace(0.0, 0.4, 9), solo.neutral()
    start[:3] = 0.0, 0.0, 0.3
    curve = Curve.of(solo, t, np.array([pin.integrate(solo.model, start, rng.normal(0.0, 0.12, solo.nv)) for _ in t]))
    begin = np.linspace(0.0, 0.395, 80)
    end, within = begin + 5e-3, 0.1
    R, p = placements(solo, curve.at(np.linspace(begin, end, 9).ravel())[0])
    dense = {(i, j): np.full(len(R), within) for i in range(len(over.shapes)) for j in range(len(over.pieces))}
    for i, j, near in over.near(R, p, within):
        dense[i, j][near.frames] = near.gap
    left = []
    for i, j, some, gaps in _bounds(curve, over, begin, end, within):
        left.append(dense[i, j].reshape(9, -1).min(axis=0)[some] - gaps)
    off = np.concatenate(left)
    assert len(off) > 200 and off.min() > -1e-9 and np.quantile(off, 0.1) < 2e-3


def test_what_a_contact_exempts(talos: rbd.Robot):
    """A foot from what it stands on, but for 2 mm; a hand whose point is inside its links from its rail; not its elbow."""
    stand = talos.standing()
    place = stand.frame("gripper_left_base_link").X_WF.translation
    rail = rbd.Terrain.boxes((tuple(place - [0.05, 0.05, 0.05]), tuple(place + [0.05, 0.05, 0.0])))
    hand = rbd.PointContact("hand", "gripper_left_base_link", friction=0.5, on=rail)
    feet = {foot.name: True for foot in talos.feet()}
    supports = planned_contacts(talos, {0.0: stand, 1.0: stand}, feet | {hand: True}, friction=0.6, ground=0.0)
    over = over_ground(supports, 0.0, 0.01)
    assert over is not None
    least = {shape.link: kept.tolist() for shape, kept in zip(over.shapes, over.least, strict=True)}
    assert [piece.name for piece in over.pieces] == ["the ground", "box 0"]
    assert least["leg_left_6_link"] == [-DEEP_M, 0.0]
    assert least["gripper_left_base_link"] == least["gripper_left_fingertip_1_link"] == [0.0, -np.inf]
    assert least["arm_left_4_link"] == least["leg_left_4_link"] == [0.01, 0.01]
    own = rbd.PointContact("hand", "gripper_left_base_link", friction=0.5, on=rbd.Ground(point=tuple(place)))
    supports = planned_contacts(talos, {0.0: stand, 1.0: stand}, feet | {own: True}, friction=0.6, ground=0.0)
    over = over_ground(supports, 0.0, 0.0)
    assert over is not None and [piece.name for piece in over.pieces] == ["the ground"]  # not the plane through the hand
