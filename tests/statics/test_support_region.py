"""Support regions: closed forms, an independent linear program, and what is empty or without end."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

import rbd
from rbd.errors import DistantContactWarning, DuplicateName, NotAtRest
from rbd.statics import support_region

URDF = Path(__file__).parents[2] / "urdf"
BOX = rbd.load_robot(URDF / "box.urdf")
AT = BOX.at(np.array([0.3, -0.2, 0.5, 0.0, 0.0, math.sin(0.2), math.cos(0.2)]))  # away from the origin, turned by 0.4 rad
METRE = 1.0
PYRAMIDS = ("inscribed", "circumscribed")


def hand(friction: float = 0.5) -> rbd.PointContact:
    """Talos' left hand on a wall at its left."""
    return rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=friction)


def chimney(lean: float, friction: float, half_width: float = 0.2) -> list[rbd.PointContact]:
    """Two points of the box, at (0, +-half_width, 0) in W, on walls whose normals lean up from the horizontal by an angle."""
    R = AT.base_pose().rotation
    out = []
    for name, side in (("left", 1.0), ("right", -1.0)):
        normal = np.array([0.0, -side * math.cos(lean), math.sin(lean)])
        at = R.T @ np.array([0.0, side * half_width, 0.0])
        out.append(rbd.PointContact(name, "box", offset=at, friction=friction, on=rbd.Ground(normal=normal)))
    return out


def reach(corners: np.ndarray, d: np.ndarray) -> float:
    """How far a polygon goes along a direction."""
    return float((corners @ d).max())


def around(count: int) -> np.ndarray:
    angle = np.arange(count) * (2.0 * np.pi / count)
    return np.column_stack([np.cos(angle), np.sin(angle)])


class ByHand:
    """The same question once more, in W, from corner points and Pinocchio's Jacobians: facets as inequalities, not rays."""

    def __init__(self, state: rbd.State, contacts: list, friction: str, torque_limits: bool) -> None:
        robot = state.robot
        model, data = robot.model, robot.model.createData()
        pin.computeJointJacobians(model, data, state.q)
        gravity = pin.computeGeneralizedGravity(model, data, state.q)
        weight = robot.mass * 9.81
        balance, cones, torques = [], [], []
        for contact in contacts:
            patch = contact.rows(state).patch
            shape = math.cos(math.pi / contact.facets) if friction == "inscribed" else 1.0
            for corner in patch.corners_W:
                balance.append(np.vstack([np.eye(3), pin.skew(corner)]))
                t, s, n = patch.axes.T
                for k in range(contact.facets):
                    angle = 2.0 * math.pi * k / contact.facets
                    cones.append((len(balance) - 1, math.cos(angle) * t + math.sin(angle) * s - shape * contact.friction * n))
                frame = model.frames[robot.frame_id(contact.frame)]
                J = pin.getJointJacobian(model, data, frame.parentJoint, pin.WORLD)
                torques.append(J[:3] - pin.skew(corner) @ J[3:])
        self.count = 3 * len(balance)
        lever = np.zeros((6, 2))
        lever[3, 1], lever[4, 0] = -1.0, 1.0  # the moment of the weight at c, taken over: c x (0, 0, -1)
        self.A = np.hstack([np.hstack(balance), lever])
        self.b = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        rows = np.zeros((len(cones), self.count + 2))
        for row, (i, g) in zip(rows, cones, strict=True):
            row[3 * i : 3 * i + 3] = g
        sides = np.zeros(len(rows))
        if torque_limits:
            T = np.hstack([(J.T * weight)[6:] for J in torques]) / robot.effort_limit[:, None]
            T, t = np.hstack([T, np.zeros((len(T), 2))]), gravity[6:] / robot.effort_limit
            rows, sides = np.vstack([rows, T, -T]), np.concatenate([sides, 1.0 + t, 1.0 - t])
        self.rows, self.sides = rows, sides

    def reach(self, d: np.ndarray) -> float:
        """How far the centre of mass may be along a direction."""
        cost = np.append(np.zeros(self.count), -d)
        answer = linprog(cost, self.rows, self.sides, self.A, self.b, bounds=(None, None), method="highs-ds")
        assert answer.status == 0, answer.message
        return -answer.fun


@pytest.mark.parametrize("torque_limits", [False, True])
@pytest.mark.parametrize(("with_hand", "friction"), [(False, "inscribed"), (True, "inscribed"), (True, "circumscribed")])
def test_talos_region_is_that_of_an_independent_linear_program(talos, with_hand, friction, torque_limits, exhaustive):
    """Both reach equally far, to a micrometre: along 120 directions, 40 with a hand or torque limits, or 360 exhaustively."""
    state, contacts = talos.standing(), [*talos.soles(0.7), *([hand()] if with_hand else [])]
    region = support_region(state, contacts, friction=friction, torque_limits=torque_limits)
    by_hand = ByHand(state, contacts, friction, torque_limits)
    for d in around(360 if exhaustive else 40 if with_hand or torque_limits else 120):
        assert abs(reach(region.vertices, d) - by_hand.reach(d)) < 1e-6 * METRE
    assert region.bounded and not region.empty and region.residual < 1e-9


def test_talos_on_its_soles_takes_eight_programs(talos):
    """Four corners and four edges: each needs one program, and none is solved twice."""
    region = support_region(talos.standing(), talos.soles(0.7), friction="inscribed")
    corners = np.vstack([sole.rows(talos.standing()).patch.corners_W[:, :2] for sole in talos.soles()])
    low, high = corners.min(axis=0), corners.max(axis=0)  # two soles side by side
    assert region.programs == 8 and len(region.vertices) == 4
    assert abs(region.area - np.prod(high - low)) < 1e-12
    assert np.abs(region.vertices.min(axis=0) - low).max() < 1e-12
    assert abs(region.distance() - min(*(state_com(talos) - low), *(high - state_com(talos)))) < 1e-12


def state_com(talos: rbd.Robot) -> np.ndarray:
    return talos.standing().com[:2]


@pytest.mark.parametrize("friction", ["cone", *PYRAMIDS])
def test_a_tilted_rectangle_carries_what_is_above_it(friction):
    """On a slope within friction the region is the sole's outline seen from above: forces along a slope have no say in it."""
    tilt, half = 0.3, np.array([0.15, 0.05])
    R = pin.utils.rotate("y", tilt)
    X_WP = pin.SE3(R, np.array([0.1, 0.2, 0.3]))
    X_WB = AT.base_pose()
    sole = rbd.SurfaceContact("sole", "box", half_lengths=half, placement=X_WB.actInv(X_WP), friction=0.6)
    region = support_region(AT, [sole], friction=friction)
    assert len(region.vertices) == 4
    assert abs(region.area - 4.0 * half[0] * half[1] * math.cos(tilt)) < 1e-9
    expected = X_WP.translation[:2] + np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * half * [math.cos(tilt), 1.0]
    for corner in expected:
        assert np.abs(region.vertices - corner).sum(axis=1).min() < 1e-9


@pytest.mark.parametrize("friction", ["cone", *PYRAMIDS])
def test_too_steep_a_slope_carries_nothing_and_the_certificate_holds(friction):
    """Beyond the angle of friction the region is empty: the multipliers are a motion that weight drives and friction allows."""
    tilt = 0.3
    R = pin.utils.rotate("y", tilt)
    placement = AT.base_pose().actInv(pin.SE3(R, np.zeros(3)))
    share = math.cos(math.pi / 4.0) if friction == "inscribed" else 1.0  # a facet of the inner pyramid is so near
    steep = 0.99 * math.tan(tilt) / share
    for mu, empty in ((steep, True), (steep / 0.98, False)):
        sole = rbd.SurfaceContact("sole", "box", half_lengths=(0.15, 0.05), placement=placement, friction=mu)
        region = support_region(AT, [sole], friction=friction)
        assert region.empty == empty
    sole = sole.with_friction(steep)
    region = support_region(AT, [sole], friction=friction)
    assert region.area == 0.0 and region.distance() == -math.inf and "empty" in str(region)
    proof, loads = region.contradiction, region.loads
    drift = -np.linalg.solve(np.diag(loads.row_size), proof.y)  # a twist of the base, as every joint of the box is
    velocity = loads.sets.G.T @ (loads.J @ drift)
    power = float(drift @ -loads.need)
    turns = np.abs((AT.base_pose().rotation @ drift[3:])[:2]).sum()  # about level axes: there the place of c would count
    assert power > 100.0 * turns * loads.unit * 10.0 > 0.0 or (power > 0.1 and turns < 1e-12)  # gravity drives it for any c
    if friction == "cone":  # by Clarabel's certificate, to its tolerance
        assert min(n - steep * math.hypot(t, s) for t, s, n in velocity.reshape(-1, 3)) > -1e-5 * np.abs(drift).max()
    else:
        assert velocity.min() > -1e-9


@pytest.mark.parametrize("friction", ["cone", "circumscribed"])
def test_a_chimney_whose_walls_lean_back(friction):
    """Two points on walls that lean by a, friction angle b < a: half the width is d sin 2b / sin 2a, on the line between them.

    The forces' lines meet above or below the centre of mass: d - y over d + y is the ratio of their slopes, tan(a - b) over
    tan(a + b) at the end.
    """
    for a, b in ((0.5, 0.3), (0.7, 0.1), (0.9, 0.6)):
        region = support_region(AT, chimney(a, math.tan(b)), friction=friction)
        end = 0.2 * math.sin(2 * b) / math.sin(2 * a)
        assert region.vertices.shape == (2, 2) and region.bounded
        middle = AT.com[:2]
        expected = middle + np.array([[0.0, -end], [0.0, end]])
        assert np.abs(region.vertices - expected).max() < 1e-7
        assert region.area < 1e-9 and region.residual < 1e-6


@pytest.mark.parametrize("friction", ["cone", "circumscribed"])
@pytest.mark.parametrize(("lean", "angle"), [(0.0, 0.3), (0.5, 0.6)])
def test_a_chimney_in_which_one_can_wedge_has_no_end(lean, angle, friction):
    """Where the line between the points is inside both cones they can press without end, and hold any lever along it."""
    region = support_region(AT, chimney(lean, math.tan(angle)), friction=friction)
    assert not region.bounded and region.area == math.inf and "without end" in str(region)
    assert np.abs(np.abs(region.directions @ [0.0, 1.0]) - 1.0).max() < 1e-9 and len(region.directions) == 2
    assert abs(region.directions.sum()) < 1e-9


@pytest.mark.parametrize("friction", ["cone", "circumscribed"])
def test_one_wall_carries_nothing(friction):
    """A point on an upright wall: friction may be any, the push away is not balanced."""
    assert support_region(AT, chimney(0.0, 5.0)[:1], friction=friction).empty


def test_a_held_patch_carries_the_centre_of_mass_anywhere():
    """A bolted foot takes any moment: the plane is the region."""
    region = support_region(AT, [rbd.SurfaceContact("bolted", "box", half_lengths=(0.1, 0.1), friction=None)])
    ways = region.directions
    assert not region.bounded
    for d in around(16):  # they span the plane
        assert (ways @ d).max() > 0.1


def test_a_point_carries_what_is_above_it():
    """One held point: the region is that point."""
    region = support_region(AT, [rbd.PointContact("pin", "box", offset=(0.1, 0.0, 0.0), friction=None)])
    expected = (AT.base_pose() * np.array([0.1, 0.0, 0.0]))[:2]
    assert region.vertices.shape == (1, 2) and np.abs(region.vertices - expected).max() < 1e-9 and region.area == 0.0


@pytest.mark.parametrize("torque_limits", [False, True])
def test_true_cones_are_between_the_pyramids_and_to_the_stated_gap(talos, torque_limits):
    """The inner polygon is inside the region of outer pyramids, the outer one around that of inner pyramids; 24 facets."""
    state, soles = talos.standing(), talos.soles(0.7, facets=24)
    contacts = [*soles, rbd.PointContact(
        "hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=0.5, facets=24
    )]  # fmt: skip
    inner, outer = (support_region(state, contacts, friction=f, torque_limits=torque_limits) for f in PYRAMIDS)
    for gap in (1e-3, 1e-4):
        region = support_region(state, contacts, torque_limits=torque_limits, area_gap=gap)
        assert 0.0 < region.area_gap <= gap and region.residual < 1e-6
        for d in around(90):
            assert reach(region.vertices, d) <= reach(outer.vertices, d) + 1e-7 * METRE
            assert reach(inner.vertices, d) <= reach(region.outer, d) + 1e-7 * METRE


def test_forces_at_a_corner_carry_the_weight_at_that_corner(talos):
    """Newton and Euler in W: forces sum to the weight, their moments about the corner's plumb line to nothing level."""
    state = talos.standing()
    region = support_region(state, [*talos.soles(0.7), hand()], torque_limits=True)
    weight = talos.mass * 9.81
    for i, corner in enumerate(region.vertices):
        total, about = np.zeros(3), np.zeros(3)
        for row in region.loads.rows:
            wrench = region.forces(i)[row.name]
            total += wrench[:3]
            about += np.cross(row.patch.point - np.append(corner, 0.0), wrench[:3])
            about += wrench[3:] if len(wrench) == 6 else 0.0
        assert np.abs(total - [0.0, 0.0, weight]).max() < 1e-6 and np.abs(about).max() < 1e-6
        assert (np.abs(region.tau(i)) <= talos.effort_limit * (1.0 + 1e-9)).all()


def test_torque_limits_only_take_away(talos):
    """Within limits the region is smaller; with a hand on the wall by much, which the arm's motors cannot use."""
    state, contacts = talos.standing(), [*talos.soles(0.7), hand()]
    free, limited = (support_region(state, contacts, torque_limits=x) for x in (False, True))
    for d in around(36):
        assert reach(limited.vertices, d) <= reach(free.outer, d) + 1e-9
    assert limited.area < 0.5 * free.area


def test_a_margin_is_that_much_less_friction(talos):
    """Leaving 20 % of 0.5 unused is a coefficient of 0.4."""
    state = talos.standing()
    given = support_region(state, [*talos.soles(0.5), hand(0.5)], margin=0.2, friction="inscribed")
    lower = support_region(state, [*talos.soles(0.4), hand(0.4)], friction="inscribed")
    assert abs(given.area - lower.area) < 1e-9 and given.area < support_region(state, [*talos.soles(0.5), hand()]).area


def test_motors_too_weak_for_the_pose_leave_no_region_and_are_named(g1):
    """A shoulder that can hold nothing up: no place of the centre of mass helps, and the region names it."""
    model = g1.model.copy()
    limits = model.effortLimit.copy()
    limits[g1.joints["left_shoulder_pitch_joint"].v.start] = 1e-6
    model.effortLimit = limits
    weak = rbd.model.checked_model.CheckedModel(model)
    region = support_region(rbd.State(weak, g1.standing().q), g1.soles(0.7), torque_limits=True)
    assert region.empty and region.motors_in_the_way == ("left_shoulder_pitch_joint",)
    assert "left_shoulder_pitch_joint" in str(region)


def test_a_joint_without_a_motor_must_balance_too():
    """With a shoulder that no motor drives the arm would fall: no place of the centre of mass changes that."""
    robot = rbd.load_robot("talos", passive=["arm_left_2_joint"])
    region = support_region(robot.standing(), robot.soles(0.7))
    assert region.empty and region.contradiction.gap > 1e-6
    with pytest.raises(rbd.CannotHold):
        rbd.hold(robot.standing(), robot.soles(0.7))


def test_other_constraints_may_carry_too(talos):
    """Two hands that press each other change no region; joint friction helps motors. They are counted."""
    state, soles = talos.standing(), talos.soles(0.7)
    fists = rbd.PointContact("fists", "gripper_left_base_link", on=rbd.Body("gripper_right_base_link"), friction=0.5)
    alone = support_region(state, soles, friction="inscribed")
    more = support_region(state, [*soles, fists, *talos.joint_frictions()], torque_limits=True, friction="inscribed")
    assert abs(alone.area - more.area) < 1e-9 and more.residual < 1e-9
    assert f"left_sole, right_sole, fists and {len(talos.joint_frictions())} more constraints" in str(more)


def test_bad_input_is_refused_before_anything_is_solved(talos):
    """What is no contact, no rest, no friction, no floating base."""
    state, soles = talos.standing(), talos.soles()
    for wrong in (
        {"contacts": []}, {"friction": "round"}, {"margin": 1.0}, {"margin": math.nan}, {"area_gap": 0.0},
        {"torque_limits": "yes"}, {"contacts": "soles"},
    ):  # fmt: skip
        with pytest.raises(rbd.InputError):
            support_region(**{"state": state, "contacts": soles} | wrong)
    with pytest.raises(DuplicateName):
        support_region(state, [soles[0], soles[0]])
    with pytest.raises(NotAtRest):
        support_region(state.with_velocity(np.full(talos.nv, 0.1)), soles)
    with pytest.raises(NotAtRest, match="left_sole"):
        support_region(state, talos.soles(on=rbd.Ground(point=(0, 0, 0), velocity=(0.1, 0, 0))))
    arm = rbd.load_robot("panda", root="fixed")
    with pytest.raises(rbd.InputError, match="fixed to the world"):
        support_region(arm.at(), [rbd.PointContact("tip", "panda_hand", friction=0.5)])
    pair = rbd.robots.merge_robots(BOX, BOX, placement=pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])), names=("a_", "b_"))
    with pytest.raises(rbd.InputError, match="is 2 robots"):
        support_region(pair.at(), [rbd.PointContact("corner", "a_box", friction=0.5)])
    with pytest.raises(rbd.InputError, match="corner"):
        support_region(state, soles).forces(4)
    with pytest.warns(DistantContactWarning) as caught:
        support_region(state, talos.soles(on=-0.1))
    assert caught[0].filename == __file__


def test_a_region_that_goes_far_is_cut_and_says_so():
    """Solo12's file lets motors hold a hundred times its weight: wedged between walls its region ends far outside the frame."""
    solo = rbd.load_robot("solo12")
    feet = [
        rbd.PointContact(f.name, f.frame, offset=f.offset, friction=1.5, on=rbd.Ground(normal=(0, side, 0)))
        for f in solo.feet()
        for side in [1.0 if "right" in f.name else -1.0]
    ]
    free = support_region(solo.standing(), feet, friction="circumscribed")
    limited = support_region(solo.standing(), feet, friction="circumscribed", torque_limits=True)
    assert not free.bounded and free.cut
    assert limited.bounded and limited.cut and "cut at 10 m" in str(limited) and limited.residual < 1e-6
    assert abs(np.abs(limited.vertices - limited.vertices.mean(axis=0)).max() - 10.0) < 1.0


def test_an_area_that_was_not_reached_is_told(talos, monkeypatch):
    """After the last program the polygons stand, with their true gap, and a warning."""
    from rbd.statics import planar_projection

    monkeypatch.setattr(planar_projection, "POLYGON_PROGRAMS", 20)
    with pytest.warns(rbd.errors.InaccurateWarning, match="20 programs") as caught:
        region = support_region(talos.standing(), [*talos.soles(0.7), hand()])
    assert region.area_gap > 1e-4 and caught[0].filename == __file__
