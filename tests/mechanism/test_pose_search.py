"""Poses found: closed forms of planar arms, humanoids that reach, and what is said where they cannot."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from planar_models import IDENTITY, at, bar, checked
from scipy.optimize import minimize

import rbd
from rbd.constraints.descent import Residual, Space, minimise
from rbd.errors import CannotReach, DuplicateName, FrameNotFound, InputError
from rbd.mechanism.pose_targets import Target, read_targets
from rbd.model.checked_model import CheckedModel

URDF = Path(__file__).parents[2] / "urdf"
L1, L2 = 0.5, 0.3
MET = 1e-12
HANDS = {
    "talos": ("gripper_left_base_link", "gripper_right_base_link"),
    "g1": ("left_wrist_yaw_link", "right_wrist_yaw_link"),
}


def arm(*, elbow: tuple[float, float] | None = None) -> CheckedModel:
    """A planar arm of two bars, L1 and L2, fixed at the origin."""
    model = pin.Model()
    upper = bar(model, 0, IDENTITY, "upper", L1)
    bar(model, upper, at(L1), "fore", L2)
    robot = checked(model, "arm")
    if elbow is not None:
        robot.model.lowerPositionLimit[1], robot.model.upperPositionLimit[1] = elbow
    return robot


def closed_form(x: float, y: float, side: float) -> np.ndarray:
    """(shoulder, elbow) with the tip at (x, y), the elbow bent to one side."""
    elbow = side * math.acos((x * x + y * y - L1 * L1 - L2 * L2) / (2.0 * L1 * L2))
    return np.array([math.atan2(y, x) - math.atan2(L2 * math.sin(elbow), L1 + L2 * math.cos(elbow)), elbow])


def turned(angles: np.ndarray) -> np.ndarray:
    """Angles in [-pi, pi]."""
    return np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_planar_arm_finds_the_closed_form_on_its_side_of_the_elbow(rng: np.random.Generator, side: float) -> None:
    """Inverse kinematics of two bars: the law of cosines; the posture says on which side the elbow is."""
    robot = arm()
    for _ in range(40):
        r, angle = rng.uniform(abs(L1 - L2) + 0.02, L1 + L2 - 0.02), rng.uniform(-math.pi, math.pi)
        x, y = r * math.cos(angle), r * math.sin(angle)
        expected = closed_form(x, y, side)
        found = rbd.find_pose(robot, {"fore_tip": (x, y, 0.0)}, posture=expected + rng.uniform(-0.1, 0.1, 2))
        assert np.abs(turned(found.q - expected)).max() < 1e-10
        assert found.worst <= MET and found.starts == 1


def test_a_stretched_arm_still_reaches() -> None:
    """At L1 + L2 the arm is singular: errors grow with the square of the angle, and are met all the same."""
    found = rbd.find_pose(arm(), {"fore_tip": (0.0, L1 + L2, 0.0)}, posture=np.array([1.0, 0.8]))
    assert found.worst <= MET
    assert abs(found.q[1]) < 1e-5


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2])
def test_out_of_reach_the_distance_is_what_the_arm_lacks(angle: float) -> None:
    """|p| - (L1 + L2), the arm stretched towards it; that no pose at all reaches it is shown by the lengths alone."""
    r = 1.1
    p = np.array([r * math.cos(angle), r * math.sin(angle), 0.0])
    with pytest.raises(CannotReach, match="There is no pose") as caught:
        rbd.find_pose(arm(), {"fore_tip": p}, posture=np.array([-0.5, 1.0]))
    error = caught.value
    assert abs(error.misses["fore_tip"].distance - (r - L1 - L2)) < 1e-12
    assert np.abs(turned(error.q - [angle, 0.0])).max() < 1e-6
    assert error.minimum and error.slope < 1e-9 and not error.limits
    why = error.certificate
    assert why.apart == pytest.approx(r, abs=1e-15) and why.longest == pytest.approx(L1 + L2, abs=1e-15)


def test_too_near_the_distance_is_what_the_arm_cannot_fold() -> None:
    """|L1 - L2| - |p|, folded; lengths show nothing there, 24 other starts found nothing nearer."""
    with pytest.raises(CannotReach, match="None of 24 further starts ended nearer") as caught:
        rbd.find_pose(arm(), {"fore_tip": (0.05, 0.0, 0.0)}, posture=np.array([0.4, 1.0]))
    error = caught.value
    assert error.certificate is None and error.minimum
    assert abs(error.misses["fore_tip"].distance - (L1 - L2 - 0.05)) < 1e-12
    assert abs(abs(turned(error.q)[1]) - math.pi) < 1e-6


def test_from_a_saddle_the_search_goes_down() -> None:
    """Stretched away from a place out of reach every slope is zero, and it is the farthest that the tip can be."""
    with pytest.raises(CannotReach) as caught:
        rbd.find_pose(arm(), {"fore_tip": (1.0, 0.0, 0.0)}, posture=np.array([math.pi, 0.0]))
    assert caught.value.minimum
    assert abs(caught.value.misses["fore_tip"].distance - (1.0 - L1 - L2)) < 1e-12


def test_a_descent_that_is_cut_short_claims_no_minimum() -> None:
    """One Newton step from a bent pose is not the bottom, sixty are."""
    robot = arm()
    bounded = Within(robot, lengths_and_angles(robot, {"fore_tip": (1.0, 0.0, 0.0)}))
    start = bounded.at(np.array([1.0, 0.7]))
    assert not minimise(bounded, start, most=1).minimum and minimise(bounded, start).minimum
    saddle = bounded.at(np.array([math.pi, 0.0]))
    assert not minimise(bounded, saddle, most=0).minimum


def test_a_limit_that_stands_in_the_way_is_named() -> None:
    """The elbow bends by 0.5 rad at least: what is lacking is |p| less the chord, and the lower limit carries the slope."""
    chord, r = math.sqrt(L1 * L1 + L2 * L2 + 2.0 * L1 * L2 * math.cos(0.5)), 0.79
    robot = arm(elbow=(0.5, 2.0))
    with pytest.raises(CannotReach, match="at a limit: fore") as caught:
        rbd.find_pose(robot, {"fore_tip": (r, 0.0, 0.0)}, posture=np.array([0.1, 1.0]))
    error = caught.value
    assert error.q[1] == 0.5
    assert abs(error.misses["fore_tip"].distance - (r - chord)) < 1e-12
    tangential = L1 * L2 * math.sin(0.5) / chord  # of the chord's length, by the elbow's angle
    assert error.limits == {"fore": pytest.approx(-(r - chord) * tangential / robot.joints.length**2, rel=1e-9)}
    assert error.minimum and error.certificate is None


def test_a_limit_that_is_met_is_kept_exactly() -> None:
    """On the limit itself: the chord's length is reached with the elbow at its limit, to the last bit."""
    chord = math.sqrt(L1 * L1 + L2 * L2 + 2.0 * L1 * L2 * math.cos(0.5))
    robot = arm(elbow=(0.5, 2.0))
    found = rbd.find_pose(robot, {"fore_tip": (0.0, chord - 1e-13, 0.0)}, posture=np.array([1.0, 1.9]))
    assert 0.5 <= found.q[1] < 0.5 + 1e-6 and found.worst <= MET
    beyond = rbd.find_pose(robot, {"fore_tip": (0.0, 0.7, 0.0)}, posture=np.array([1.0, 3.0]))
    assert 0.5 <= beyond.q[1] <= 2.0 and beyond.worst <= MET


def test_talos_stands_wider_with_its_centre_of_mass_where_it_is_told(talos: rbd.Robot) -> None:
    """Feet 0.1 m farther apart, centre of mass over the left one: what State says of it, flat soles, held by torques."""
    targets = {"left_sole": (0.0, 0.135, 0.0), "right_sole": (0.0, -0.135, 0.0)}
    found = rbd.find_pose(talos, targets, com=(0.0, 0.1))
    state, soles = found.state, talos.soles()
    assert found.worst <= MET and found.starts == 1
    assert np.abs(state.com[:2] - [0.0, 0.1]).max() < MET
    for sole in soles:
        X_WP = state.frame(sole.frame).X_WF * sole.placement
        assert np.abs(X_WP.translation - targets[sole.name]).max() < MET
        assert np.abs(X_WP.rotation[:, 2] - [0.0, 0.0, 1.0]).max() < 1e-12
        assert np.abs(sole.rows(state).patch.gaps).max() < 1e-12
    within_limits(talos, found.q)
    held = rbd.hold(state, soles)
    left = rbd.solve(state, held.tau, soles).contacts["left_sole"].normal
    least = (0.1 + 0.135 - 0.062) / 0.27  # by the lever, both centres of pressure at the soles' left edges
    assert least * 9.81 * talos.mass < left < 9.81 * talos.mass


def test_a_hand_goes_to_a_point_while_the_feet_stay(talos: rbd.Robot) -> None:
    """A point of the wrist by a contact of one's own, its palm turned up by ((x, y, z), n), all six by an SE3."""
    standing = talos.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in talos.soles()}
    point = rbd.PointContact("knuckle", HANDS["talos"][0], offset=(0.02, 0.0, -0.05))
    place = np.array([0.45, 0.3, 1.1])
    found = rbd.find_pose(talos, {**stay, point: place})
    assert np.abs(found.state.frame(point.frame, point.offset).X_WF.translation - place).max() < MET
    up = rbd.find_pose(talos, {**stay, HANDS["talos"][0]: (place, (0.0, 0.6, 0.8))})
    X_WF = up.state.frame(HANDS["talos"][0]).X_WF
    assert np.abs(X_WF.rotation[:, 2] - [0.0, 0.6, 0.8]).max() < 1e-12 and np.abs(X_WF.translation - place).max() < MET
    six = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.4) @ X_WF.rotation, place)
    all_six = rbd.find_pose(talos, {**stay, HANDS["talos"][0]: six})
    assert np.abs(all_six.state.frame(HANDS["talos"][0]).X_WF.homogeneous - six.homogeneous).max() < 1e-12
    for pose in (found, up, all_six):
        assert pose.worst <= MET
        within_limits(talos, pose.q)
        for sole in talos.soles():
            there = pose.state.frame(sole.frame).X_WF * sole.placement
            assert np.abs(there.homogeneous - stay[sole.name].homogeneous).max() < 1e-12


def test_a_hand_may_lie_anywhere_on_a_wall(g1: rbd.Robot) -> None:
    """A frame on a plane is one row; a sole on a ramp lies flat on it, wherever it likes."""
    ramp = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(-0.1, 0.0, math.sqrt(0.99)))
    wall = rbd.Ground(point=(0.35, 0.0, 0.0), normal=(-1.0, 0.0, 0.0))
    hand = HANDS["g1"][0]
    found = rbd.find_pose(g1, {"left_sole": ramp, "right_sole": ramp, hand: wall})
    assert found.worst <= MET
    assert abs(found.state.frame(hand).X_WF.translation[0] - 0.35) < MET
    for sole in g1.soles(on=ramp):
        assert np.abs(sole.rows(found.state).patch.gaps).max() < 1e-11


def test_g1_crouches(g1: rbd.Robot) -> None:
    """Centre of mass 0.15 m lower over the same feet: knees bent by more, both alike, and motors can hold it."""
    standing = g1.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in g1.soles()}
    found = rbd.find_pose(g1, stay, com=standing.com - [0.0, 0.0, 0.15])
    assert found.worst <= MET and np.abs(found.state.com - standing.com + [0.0, 0.0, 0.15]).max() < MET
    knees = [found.q[g1.joints[f"{side}_knee_joint"].q][0] for side in ("left", "right")]
    assert min(knees) > standing.q[g1.joints["left_knee_joint"].q][0] + 0.3 and abs(knees[0] - knees[1]) < 0.05
    rbd.hold(found.state, g1.soles())


def test_points_stand_on_the_ground() -> None:
    """A quadruped's feet: one row each on the ground, three at a place; a height is a level ground."""
    robot = rbd.load_robot("solo12")
    feet = [foot.name for foot in robot.feet()]
    found = rbd.find_pose(robot, {**dict.fromkeys(feet[:3]), feet[3]: 0.05})
    gaps = np.concatenate([foot.rows(found.state).patch.gaps for foot in robot.feet(on={feet[3]: 0.05})])
    assert np.abs(gaps).max() < MET
    assert found.worst <= MET
    with pytest.raises(InputError, match="is a point contact, which has no axes"):
        rbd.find_pose(robot, {feet[0]: pin.SE3.Identity()})
    with pytest.raises(InputError, match="is a point contact, which has no direction"):
        rbd.find_pose(robot, {feet[0]: ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))})


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_what_can_be_reached_is_reached(name: str, request: pytest.FixtureRequest, exhaustive: bool) -> None:
    """Feet and hands where a random pose within the limits has them, all six of each foot: met to 1e-12 m and rad."""
    robot: rbd.Robot = request.getfixturevalue(name)
    rng, base = np.random.default_rng(7), robot.standing().q[:7]
    for i in range(50 if exhaustive else 8):
        q = np.concatenate([base, drawn(robot, rng)])
        z = np.zeros(robot.nv)
        z[:6] = rng.normal(size=6) * [0.3, 0.3, 0.2, 0.5, 0.5, 2.0]
        state = robot.at(pin.integrate(robot.model, q, z))
        targets: dict[object, object] = {f.name: state.frame(f.frame).X_WF * f.placement for f in robot.soles()}
        for hand in HANDS[name]:
            X_WF = state.frame(hand).X_WF
            targets[hand] = X_WF if i % 2 else X_WF.translation
        found = rbd.find_pose(robot, targets)
        assert found.worst <= MET
        assert set(found.misses) == set(targets) and not found.loops
        within_limits(robot, found.q)


def drawn(robot: rbd.Robot, rng: np.random.Generator) -> np.ndarray:
    """Joints anywhere within their limits."""
    return rng.uniform(robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:])


def within_limits(robot: rbd.Robot, q: np.ndarray) -> None:
    """Every joint is, to the last bit."""
    assert (q[7:] >= robot.model.lowerPositionLimit[7:]).all() and (q[7:] <= robot.model.upperPositionLimit[7:]).all()


def test_a_hand_too_far_away_is_told_with_its_proof(talos: rbd.Robot) -> None:
    """No small motion within the limits comes nearer: drawn ones do not, and differences of the distance say zero slope."""
    targets = {"left_sole": (0.0, 0.085, 0.0), "right_sole": (0.0, -0.085, 0.0), HANDS["talos"][0]: (2.0, 0.2, 0.6)}
    with pytest.raises(CannotReach, match="No small motion reduces the distance: a true minimum") as caught:
        rbd.find_pose(talos, targets)
    error = caught.value
    assert error.minimum and error.certificate is None and error.slope < 1e-9 and error.limits
    assert list(error.misses)[0] == HANDS["talos"][0] and 0.01 < error.misses[HANDS["talos"][0]].distance < 1.0
    assert HANDS["talos"][0] in error.without and HANDS["talos"][0] in str(error)
    check_certificate(talos, targets, error)


def test_draws_out_of_reach_are_certified(g1: rbd.Robot) -> None:
    """Both feet fixed, a wrist at 1.6 to 2 m from the centre of mass: at every answer the certificate holds."""
    rng, standing = np.random.default_rng(5), g1.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in g1.soles()}
    for _ in range(4):
        away = rng.normal(size=3) * [1.0, 1.0, 0.3]
        place = standing.com + rng.uniform(1.6, 2.0) * away / np.linalg.norm(away)
        targets = {**stay, HANDS["g1"][0]: place}
        with pytest.raises(CannotReach) as caught:
            rbd.find_pose(g1, targets)
        assert caught.value.minimum and caught.value.misses[HANDS["g1"][0]].distance > 0.01
        check_certificate(g1, targets, caught.value)


def check_certificate(robot: rbd.Robot, targets: dict, error: CannotReach) -> None:
    """Differences of the distance give the multipliers of the limits and zero elsewhere; drawn motions never reduce it."""
    bounded = Within(robot, lengths_and_angles(robot, targets))
    least = bounded.at(error.q).size2
    lower, upper = bounded.room(error.q)
    rng = np.random.default_rng(3)
    for size in (1e-1, 1e-2, 1e-3):
        for _ in range(60):
            z = np.clip(size * rng.normal(size=robot.nv), lower, upper)
            assert bounded.at(bounded.move(error.q, z)).size2 > least * (1.0 - 1e-12)
    for i, unit in enumerate(np.eye(robot.nv) * 1e-5):
        there = [bounded.at(pin.integrate(robot.model, error.q, bounded.scale * z)).size2 for z in (unit, -unit)]
        slope, name = 0.5 * (there[0] - there[1]) / 2e-5, robot.joints.velocities[i].name
        assert abs(slope + error.limits.get(name, 0.0)) < 1e-7
        if name in error.limits:  # and at a limit it points outwards
            assert (error.limits[name] > 0.0) == (upper[i] < 1e-12) and (error.limits[name] < 0.0) == (lower[i] > -1e-12)
    for name, miss in error.misses.items():  # distances, by the state's own kinematics
        asked = read_targets(robot, targets, 0.0, rbd.State(robot, pin.neutral(robot.model)))
        target = next(t for t in asked if t.name == name)
        X_WP = robot.at(error.q).frame(target.frame).X_WF * target.X_FP
        assert abs(float(np.linalg.norm(X_WP.translation - target.point)) - miss.distance) < 1e-12


class Within(Space[Residual]):
    """Errors of a robot's configurations within the limits of its joints, by a function of the state."""

    def __init__(self, robot: rbd.Robot, errors: Callable[[rbd.State], tuple[np.ndarray, np.ndarray]]) -> None:
        super().__init__(robot, limited=True)
        self.errors = errors

    def at(self, q: np.ndarray) -> Residual:
        """The errors at a configuration."""
        state = rbd.State(self.robot, q)
        e, J = self.errors(state)
        return Residual(state, e, J * self.scale)


def lengths_and_angles(robot: CheckedModel, targets: dict):
    """Errors of targets, lengths over the robot's own, written anew."""
    asked: list[Target] = read_targets(robot, targets, 0.0, rbd.State(robot, pin.neutral(robot.model)))

    def errors(state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
        found = [(*t.errors(state), t.angles) for t in asked]
        units = [np.append(np.full(len(e) - n, 1.0 / robot.joints.length), np.ones(n)) for e, _, n in found]
        return (
            np.concatenate([u * e for (e, _, _), u in zip(found, units, strict=True)]),
            np.concatenate([u[:, None] * J for (_, J, _), u in zip(found, units, strict=True)]),
        )

    return errors


def test_places_that_contradict_each_other_are_named(g1: rbd.Robot) -> None:
    """Two feet farther apart than two legs are long: shown by lengths; either of them left out, the other is met."""
    with pytest.raises(CannotReach, match="'left_sole' and 'right_sole' must be 3 m apart") as caught:
        rbd.find_pose(g1, {"left_sole": (0.0, 1.5, 0.0), "right_sole": (0.0, -1.5, 0.0)})
    error = caught.value
    assert set(error.without) == {"left_sole", "right_sole"} and error.certificate.names == ("left_sole", "right_sole")
    for one, other in (("left_sole", "right_sole"), ("right_sole", "left_sole")):
        assert error.misses[one].distance == pytest.approx(error.misses[other].distance, rel=0.05)


def test_a_loop_stays_closed() -> None:
    """The five-bar's hand goes where it is told, both its arms closed; each crank by the closed form of its two bars."""
    robot = rbd.load_robot(URDF / "five_bar.urdf")
    start = robot.at("assembled")
    hand = start.frame("left_arm_tip").X_WF.translation
    place = hand + [0.02, 0.0, -0.03]
    found = rbd.find_pose(robot, {"left_arm_tip": place}, posture="assembled")
    assert found.worst <= MET and list(found.loops) == ["hand"]
    for tip in ("left_arm_tip", "right_arm_tip"):
        assert np.abs(found.state.frame(tip).X_WF.translation[[0, 2]] - place[[0, 2]]).max() < 1e-11


def test_out_of_reach_a_loop_is_still_closed() -> None:
    """Its left arm stretched towards the place: the distance is |p - pivot| less two bars, though the right arm follows."""
    robot = rbd.load_robot(URDF / "five_bar.urdf")
    start = robot.at("assembled")
    pivot, elbow, tip = (start.frame(name).X_WF.translation for name in ("left_crank_joint", "left_arm_joint", "left_arm_tip"))
    reach = float(np.linalg.norm(elbow - pivot) + np.linalg.norm(tip - elbow))
    away = (tip - pivot) / np.linalg.norm(tip - pivot)
    with pytest.raises(CannotReach) as caught:
        rbd.find_pose(robot, {"left_arm_tip": pivot + (reach + 0.1) * away}, posture="assembled")
    error, there = caught.value, robot.at(caught.value.q)
    gap = there.frame("left_arm_tip").X_WF.translation - there.frame("right_arm_tip").X_WF.translation
    assert np.abs(gap[[0, 2]]).max() < 1e-9
    assert error.minimum and error.slope < 1e-9
    assert abs(error.misses["left_arm_tip"].distance - 0.1) < 1e-9


def test_the_pose_is_near_the_posture(talos: rbd.Robot) -> None:
    """What the targets do not need stays; and along the targets nothing nearby is nearer by more than a percent."""
    standing = talos.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in talos.soles()}
    same = rbd.find_pose(talos, stay)
    assert np.abs(pin.difference(talos.model, standing.q, same.q)).max() < 1e-9 and same.moved < 1e-9
    found = rbd.find_pose(talos, {**stay, HANDS["talos"][0]: (0.4, 0.3, 1.1)})
    right = [talos.joints[f"arm_right_{i}_joint"].q.start for i in range(1, 8)]
    assert np.abs(found.q[right] - standing.q[right]).max() < 1e-6
    # An independent optimiser finds little to gain: the joints' way and the base's tilt, the rest of the base next to free.
    bounded = Within(talos, lengths_and_angles(talos, {**stay, HANDS["talos"][0]: (0.4, 0.3, 1.1)}))
    weight = np.diag(np.concatenate([[0.03, 0.03, 0.03, 1.0, 1.0, 0.03], np.ones(32)]))

    def squared_way(z: np.ndarray) -> float:
        return float(np.square(weight @ bounded.way(standing.q, bounded.move(found.q, z))).sum())

    lower, upper = bounded.room(found.q)
    best = minimize(
        squared_way, np.zeros(talos.nv), method="SLSQP", bounds=list(zip(lower, upper, strict=True)), options={"maxiter": 60},
        constraints={"type": "eq", "fun": lambda z: bounded.at(bounded.move(found.q, z)).error},
    )  # fmt: skip
    assert np.abs(bounded.at(bounded.move(found.q, best.x)).error).max() < 1e-4
    assert squared_way(np.zeros(talos.nv)) < 1.02 * best.fun


def test_joints_that_came_to_a_limit_are_named(talos: rbd.Robot) -> None:
    """The torso leans to its limit; the grippers, which stand at theirs, are not named."""
    step = {"left_sole": (0.15, 0.12, 0.0), "right_sole": (-0.1, -0.12, 0.0), HANDS["talos"][0]: (0.55, 0.35, 1.25)}
    found = rbd.find_pose(talos, step, com=(0.02, 0.0))
    assert found.at_limits == ("torso_2_joint",) and "at a limit: torso_2_joint" in str(found)
    torso, gripper = talos.joints["torso_2_joint"], talos.joints["gripper_left_joint"]
    assert 0.0 <= torso.upper - torso.coordinate(found.q) < 1e-9 or 0.0 <= torso.coordinate(found.q) - torso.lower < 1e-9
    still = rbd.find_pose(talos, step)  # without com: of the hand's targets the gripper's own joint is none
    assert gripper.coordinate(still.q) == gripper.upper and gripper.name not in still.at_limits


def test_a_posture_may_be_a_name_an_array_or_a_state(talos: rbd.Robot) -> None:
    """All three lead to the same pose; joints beyond their limits are moved onto them first."""
    standing = talos.standing("half_sitting")
    feet = {"left_sole": (0.0, 0.1, 0.0), "right_sole": (0.0, -0.1, 0.0)}
    poses = [rbd.find_pose(talos, feet, posture=p) for p in ("half_sitting", standing.q, standing)]
    assert np.array_equal(poses[0].q, poses[1].q) and np.array_equal(poses[0].q, poses[2].q)
    q = standing.q.copy()
    q[talos.joints["leg_left_4_joint"].q] = -1.0
    within_limits(talos, rbd.find_pose(talos, feet, posture=q).q)


def test_the_same_question_has_the_same_answer(g1: rbd.Robot) -> None:
    """To the last bit: other starts are drawn with a seed of their own."""
    feet = {"left_sole": (0.1, 0.2, 0.0), "right_sole": (-0.1, -0.1, 0.1)}
    one, other = (rbd.find_pose(g1, feet) for _ in range(2))
    assert np.array_equal(one.q, other.q) and str(one) == str(other)
    assert "2 targets satisfied to" in str(one) and "left_sole" in str(one)


@pytest.mark.parametrize(
    ("targets", "kind", "says"),
    [
        ({}, InputError, "targets is {}; expected"),
        ([("left_sole", (0, 0, 0))], InputError, "expected {foot, contact or frame: place}"),
        ({3: (0, 0, 0)}, InputError, "3 is not a target"),
        ({"left_sol": (0, 0, 0)}, FrameNotFound, "no foot and no frame 'left_sol' in talos; nearest: 'left_sole'"),
        ({"left_sole": (0, 0)}, InputError, r"target of 'left_sole' has shape \(2,\)"),
        ({"left_sole": (0, 0, math.nan)}, InputError, "not finite"),
        ({"left_sole": (0, 0, 1e9)}, InputError, "at most 100000 m from the origin"),
        ({"left_sole": math.nan}, InputError, "expected"),
        ({"left_sole": "there"}, InputError, "expected real numbers"),
        ({"left_sole": ((0, 0, 0), (0, 0, 2))}, InputError, "direction for 'left_sole' has length 2"),
        ({"left_sole": rbd.Ground(normal=(0, 0, 1))}, InputError, "has no point"),
        ({"torso_2_link": None}, InputError, "A place is"),
        ({"torso_2_link": rbd.Ground(normal=(0, 0, 1))}, InputError, "has no point"),
        ({"left_sole": pin.SE3(2.0 * np.eye(3), np.zeros(3))}, InputError, "rotation is invalid"),
        ({rbd.PointContact("p", "nowhere"): (0, 0, 0)}, FrameNotFound, "nowhere"),
        ({rbd.PointContact("p", "torso_2_link", on=rbd.Body("base_link")): (0, 0, 0)}, InputError, "is with a body"),
        ({rbd.PointContact("left_sole", "torso_2_link"): (0, 0, 0), "left_sole": None}, DuplicateName, "two targets"),
    ],
)
def test_what_is_no_target_is_refused_first(talos: rbd.Robot, targets: object, kind: type, says: str) -> None:
    """By name, with what was expected, before any search."""
    with pytest.raises(kind, match=says):
        rbd.find_pose(talos, targets)  # type: ignore[arg-type]


def test_a_centre_of_mass_or_posture_that_is_none_is_refused(talos: rbd.Robot, g1: rbd.Robot) -> None:
    """Sizes, numbers that are not finite, another robot's state, an unknown name, no robot."""
    feet = {"left_sole": None}
    for com in ((1.0,), (0.0, math.inf), "here", (0.0, 1e9)):
        with pytest.raises(InputError, match="com"):
            rbd.find_pose(talos, feet, com=com)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="another robot"):
        rbd.find_pose(talos, feet, posture=g1.standing())
    with pytest.raises(InputError, match="half_sitting"):
        rbd.find_pose(talos, feet, posture="half_siting")
    with pytest.raises(InputError, match="q of talos has shape"):
        rbd.find_pose(talos, feet, posture=np.zeros(3))
    with pytest.raises(InputError, match="expected a robot"):
        rbd.find_pose("talos", feet)  # type: ignore[arg-type]
