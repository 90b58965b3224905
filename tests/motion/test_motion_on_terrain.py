"""Motions checked on terrain: stepping onto a box, soles over edges, slopes, and a plane of one box."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.motion import MotionReport, find_contacts

TALOS = rbd.load_robot("talos")
STAND = TALOS.standing()
TIMES = np.linspace(0.0, 0.4, 21)
CORNERS = np.array([(STAND.frame(s.frame).X_WF * s.placement).act(c) for s in TALOS.soles() for c in s.corners])
FRONT, BACK = CORNERS[:, 0].max(), CORNERS[:, 0].min()


def standing(X: pin.SE3 | None = None) -> rbd.Motion:
    q = np.tile(STAND.q, (len(TIMES), 1))
    moved = (X or pin.SE3.Identity()) * pin.XYZQUATToSE3(STAND.q[:7])
    q[:, :7] = pin.SE3ToXYZQUAT(moved)
    return rbd.Motion.of_arrays(TALOS, TIMES, q, trust=True)


def check(motion: rbd.Motion, ground: rbd.Terrain | float | None = None, **given: float) -> MotionReport:
    return rbd.check_motion(motion, ground=ground, self_collision=False, progress=False, **given)


def up_to(edge: float, z: float = 0.0) -> rbd.Terrain:
    return rbd.Terrain.boxes([(-3, -3, -1), (edge, 3, z)])


def causes(report: MotionReport) -> set[str]:
    return {cause for cause in rbd.motion.CAUSES if report.of_cause(cause).any()}


def stepping() -> tuple[rbd.Motion, rbd.Terrain]:
    """Talos puts its right foot onto a box of 8 cm, with its weight on the left one, and holds it above first."""
    left, right = ((STAND.frame(s.frame).X_WF * s.placement).translation for s in TALOS.soles())
    com = (*left[:2], STAND.com[2] - 0.02)
    places = [right, right + [0.0, 0.0, 0.14], right + [0.25, 0.0, 0.14], right + [0.25, 0.0, 0.08]]
    poses = [
        rbd.find_pose(TALOS, {"left_sole": pin.SE3(np.eye(3), left), "right_sole": pin.SE3(np.eye(3), place)}, com=com).state.q
        for place in places
    ]
    poses, times = [poses[0], *poses, poses[-1]], [0.0, 0.3, 1.1, 1.9, 2.7, 3.0]
    edge = right[0] + 0.12
    return rbd.motion.minimum_jerk(TALOS, poses, times, rate=25.0), rbd.Terrain.boxes(
        [(-3, -3, -1), (edge, 3, 0)], [(edge, -3, -1), (3, 3, 0.08)]
    )


def test_a_step_onto_a_box():
    """It is possible on the box, where the contacts begin and end as planned, and sinks, floats or hovers on others."""
    motion, terrain = stepping()
    report = check(motion, terrain)
    assert report.share_possible == 1.0, str(report)
    (first, second) = report.lanes.intervals("right_sole")
    assert first[0] == 0.0 and 0.3 <= first[1] < 0.6 and 2.4 < second[0] <= 2.7 and second[1] == 3.0
    assert report.lanes.intervals("left_sole") == [(0.0, 3.0)]
    at_end = report.lanes.touches[-1]
    np.testing.assert_allclose(report.lanes.places[-1, at_end, 2], [0.0] * 4 + [0.08] * 4, atol=1e-9)
    assert find_contacts(motion).intervals("right_sole") == [first]
    shifted = rbd.Terrain.boxes([(-3, -3, -1), (0.6, 3, 0)], [(0.6, -3, -1), (3, 3, 0.08)])
    assert check(motion, shifted).lanes.intervals("right_sole") == [first]
    riser = rbd.Terrain.boxes([(-3, -3, -1), (FRONT - 0.05, 3, 0)], [(FRONT - 0.05, -3, -1), (3, 3, 0.08)])
    toes = check(motion, riser)  # toes 5 cm inside of the box's front
    assert toes.of_cause("sinks")[0] and toes.lanes.heights[0].min() == pytest.approx(-0.05, abs=1e-9)


def test_over_an_edge():
    """Half soles carry while their part on the top does; then the robot tips, and the report says over what."""
    whole = check(standing(), up_to(3.0))
    assert whole.share_possible == 1.0 and len(whole.lanes.names) == 8
    for over in (0.03, 0.08):
        part = check(standing(), up_to(FRONT - over))
        assert part.share_possible == 1.0
        assert part.lanes.places[..., 0].max() == pytest.approx(FRONT - over, abs=1e-12)
        assert np.nanmin(part.edge_margin) < np.nanmin(whole.edge_margin) + 1e-9
    tips = check(standing(), up_to(FRONT - 0.15))
    assert causes(tips) == {"tips"} and tips.why(0, 5) == ["tips, left_sole and right_sole stand over an edge"]
    assert "stand over an edge" in str(tips)


@pytest.mark.parametrize("over", [0.06, 0.09, 0.096, 0.098, 0.13])
def test_what_rests_is_what_holds(over):
    """A standing motion is possible over an edge where `hold` on the same terrain finds torques."""
    terrain = up_to(FRONT - over)
    try:
        rbd.hold(STAND, TALOS.soles(friction=0.7, on=terrain))
        holds = True
    except rbd.CannotHold:
        holds = False
    assert (check(standing(), terrain, threshold=1e-6).share_possible == 1.0) == holds


def test_a_corner_cut_off():
    """An edge across a corner leaves five points: the outline's two crossings in its place."""
    X = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.25 * np.pi), np.array([FRONT - 0.02, 0.0, -1.0]))
    lanes = check(standing(), rbd.Terrain({"bar": (coal.Box(0.3, 3.0, 2.0), X)})).lanes
    assert lanes.names[8:] == ("right_sole 3b",)
    rests = lanes.places[0, lanes.touches[0]]
    assert len(rests) == 9
    assert np.abs(((rests - X.translation) @ X.rotation)[:, 0]).max() == pytest.approx(0.15, abs=1e-9)


@pytest.mark.parametrize(
    ("terrain", "expected"),
    [
        (up_to(3.0, 0.012), {"sinks"}),
        (up_to(3.0, -0.01), {"hovering foot"}),
        (up_to(3.0, -0.06), {"floats"}),
        (rbd.Terrain.boxes([(5, 5, -1), (6, 6, 0)]), {"floats"}),
    ],
)
def test_too_low_and_too_high(terrain, expected):
    assert causes(check(standing(), terrain)) == expected


def test_slope():
    """On a slope the cones are about its normal: it needs a friction of the slope's tangent; the terrain's own one counts."""
    angle, (low, high) = 0.06, (0.04, 0.07)
    X = pin.SE3(pin.rpy.rpyToMatrix(0.0, angle, 0.0), np.zeros(3))

    def slope(friction: float | None = None) -> rbd.Terrain:
        return rbd.Terrain({"slope": rbd.Ground(point=(0, 0, 0), normal=X.rotation[:, 2])}, friction=friction)

    report = check(standing(X), slope(), threshold=1e-3)
    assert report.share_possible == 1.0
    np.testing.assert_allclose(report.forces.sum(axis=1), np.tile([0, 0, TALOS.mass * 9.81], (21, 1)), atol=1e-3)
    assert causes(check(standing(X), slope(low), threshold=1e-3)) == {"friction"}
    assert check(standing(X), slope(high), friction=0.01, threshold=1e-3).share_possible == 1.0


def test_one_box_is_the_plane():
    """A motion that hops, tilts and slips has the same verdicts on one box as on the plane of its top."""
    q, (up, on) = STAND.q.copy(), np.eye(TALOS.nq)[[2, 0]]
    tilted = q.copy()
    tilted[TALOS.joints["leg_left_5_joint"].q] += 0.1
    motion = rbd.motion.minimum_jerk(TALOS, [q, q + 0.1 * up, tilted, q + 0.05 * on], [0.0, 0.3, 0.6, 1.0], rate=50.0)
    box, plane = check(motion, up_to(3.0)), check(motion, 0.0)
    np.testing.assert_array_equal(box.causes, plane.causes)
    np.testing.assert_allclose(box.missing_scaled, plane.missing_scaled, atol=1e-12)
    assert len(causes(plane)) >= 3


def test_a_motion_keeps_its_terrain(tmp_path):
    """It is checked on the terrain that it was made with; what a level floor needs is refused, or not done in silence."""
    motion, terrain = stepping()
    kept = rbd.Motion.of_arrays(TALOS, motion.t, motion.q, motion.v, motion.a, ground=terrain, trust=True)
    report = rbd.check_motion(kept, progress=False)
    assert report.lanes.ground is terrain and report.share_possible == 1.0
    assert "terrain of 2 pieces" in report.summary()["ground_m"] and "terrain of 2 pieces" in str(report)
    with pytest.raises(rbd.InputError, match="lifted on a level floor"):
        report.lifted()
    with pytest.raises(rbd.InputError, match=r"a \.csv cannot hold terrain of 2 pieces"):
        kept.save(tmp_path / "step.csv")
    for name, kind in (("step.npz", "motion"), ("step.pkl", "gmr")):
        kept.with_contacts(report.lanes, report.forces).save(tmp_path / name, kind=kind)
        read = rbd.Motion.read(tmp_path / name, robot=TALOS, progress=False)
        assert isinstance(read.ground, rbd.Terrain) and read.ground.names == terrain.names
        np.testing.assert_array_equal(read.contacts.touches, report.lanes.touches)
        np.testing.assert_allclose(read.contacts.places, report.lanes.places, atol=1e-6)
        assert check(read).share_possible == 1.0
    with pytest.raises(rbd.InputError, match="level floor to mirror"):
        kept.mirror()
    with pytest.raises(rbd.InputError, match=r"an rbd\.Terrain"):
        find_contacts(motion, ground=np.ones(2))


def test_ball_feet():
    """Point feet stand on what is under each of them."""
    solo = rbd.load_robot("solo12")
    q: Array = solo.standing().q
    motion = rbd.motion.minimum_jerk(solo, [q, q], [0.0, 0.4], rate=50.0)
    foot = solo.standing().frame(solo.feet()[0].frame).X_WF.translation
    hole = rbd.Terrain.boxes([(-2, -2, -1), (2, foot[1] - 0.05, 0)], [(-2, foot[1] - 0.05, -1), (foot[0] - 0.05, 2, 0)])
    assert check(motion, up_to(3.0)).share_possible == 1.0
    assert not check(motion, hole).lanes.of_contact("front_left").any()


def test_feet_are_put_onto_treads():
    """A step whose terrain is a centimetre lower and a box 1 cm lower still is repaired onto both."""
    motion, terrain = stepping()
    edge = terrain.pieces[0].box[3]
    lower = rbd.Terrain.boxes([(-3, -3, -1), (edge, 3, -0.01)], [(edge, -3, -1), (3, 3, 0.06)])
    before = check(motion, lower)
    assert before.share_possible < 0.1
    after = check(before.repaired(progress=False), lower)
    assert after.share_possible > 0.95, str(after)
    end = after.lanes.touches[-1]
    np.testing.assert_allclose(after.lanes.places[-1, end, 2], [-0.01] * 4 + [0.06] * 4, atol=2e-3)


@pytest.mark.parametrize("over", [8e-4, 0.03])
@pytest.mark.parametrize("tilt", [0.0, -1e-6, 1e-5, -1e-4, -1e-3])
def test_a_sole_tilted_by_a_hair_rests_on_all_of_its_part(over, tilt):
    """Heels lower by a micrometre do not leave the toes in the air: all points of the part over the tread are known."""
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.3 * tilt, tilt, 0.0), np.array([0.0, 0.0, 0.0]))
    lanes = find_contacts(standing(pose), ground=up_to(FRONT - over))
    rests = lanes.places[0, lanes.touches[0]]
    assert len(rests) == 8
    assert rests[:, 0].max() == pytest.approx(FRONT - over, abs=1e-9)
    np.testing.assert_allclose(rests[:, 0].min(), BACK, atol=2e-3)
    expected = [X[2] for X in (pose.act(np.array([x, y, 0.0])) for x, y in rests[:, :2])]
    np.testing.assert_allclose(rests[:, 2], expected, atol=3e-6)


def test_a_sole_is_put_onto_its_tread():
    """A step that would hang 8 cm over the far edge is moved onto it by as little as carries; the notes say so."""
    motion, terrain = stepping()
    edge, toes = terrain.pieces[0].box[3], FRONT + 0.25
    short = rbd.Terrain.boxes([(-3, -3, -1), (edge, 3, -0.01)], [(edge, -3, -1), (toes - 0.08, 3, 0.06)])
    repaired = check(motion, short).repaired(progress=False)
    after = check(repaired, short)
    assert after.share_possible > 0.97, str(after)
    assert any("was put onto box 1" in note for note in repaired.notes), repaired.notes
    foot = rbd.State(TALOS, repaired.q[-1]).frame(TALOS.soles()[1].frame).X_WF * TALOS.soles()[1].placement
    corners = np.array([foot.act(c) for c in TALOS.soles()[1].corners])
    over = corners[:, 0].max() - (toes - 0.08)
    assert 0.0 < over <= 0.125 * np.ptp(corners[:, 0]) + 1e-3  # the inner three quarters are on the tread


def test_a_step_is_raised_over_what_lies_between():
    """A board, 7 cm high, between two places of a foot, into which the reference steps, is passed without touching it."""
    foot = TALOS.soles()[1]
    start = (STAND.frame(foot.frame).X_WF * foot.placement).translation
    flat = rbd.find_pose(
        TALOS,
        {"left_sole": (STAND.frame(TALOS.soles()[0].frame).X_WF * TALOS.soles()[0].placement),
         "right_sole": pin.SE3(np.eye(3), start + [0.3, 0.0, 0.0])},
    ).state.q  # fmt: skip
    reference = rbd.motion.minimum_jerk(TALOS, [STAND.q, STAND.q, flat, flat], [0.0, 1.0, 2.4, 3.4], rate=25.0)
    X = pin.SE3(np.eye(3), start + [0.15, 0.0, 0.0])
    board = rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0)), "board": (coal.Box(0.02, 0.25, 0.14), X)})
    report = check(reference, board)
    assert least_distance_of(reference, board) < -0.005  # it is 2 cm wide
    repaired = report.repaired(progress=False)
    assert least_distance_of(repaired, board) > -1e-3
    assert check(repaired, board).share_possible > 0.97, str(check(repaired, board))


def least_distance_of(motion: rbd.Motion, terrain: rbd.Terrain) -> float:
    """Of the right sole's corners, middles of sides and centre, from a terrain over a motion [m]."""
    foot = TALOS.soles()[1]
    mixed = np.vstack([foot.corners, 0.5 * (foot.corners + np.roll(foot.corners, 1, axis=0)), foot.corners.mean(axis=0)])
    points = [(rbd.State(TALOS, q).frame(foot.frame).X_WF * foot.placement).act(c) for q in motion.q for c in mixed]
    return float(terrain.distances(np.array(points)).min())


def test_feet_take_the_normal_of_a_slope():
    """A level stance over a slope of 8 degrees: soles are laid onto it, and forces are in cones about its normal."""
    slope = np.tan(np.deg2rad(8.0))
    q = np.tile(STAND.q, (41, 1))
    q[:, 2] += slope * CORNERS[:, 0].mean()
    terrain = rbd.Terrain({"slope": rbd.Ground(point=(0, 0, 0), normal=(-slope, 0.0, 1.0) / np.hypot(1.0, slope))})
    level = rbd.Motion.of_arrays(TALOS, np.linspace(0.0, 1.0, 41), q, trust=True)
    before = check(level, terrain, friction=0.4)
    assert before.share_possible < 0.1
    repaired = before.repaired(progress=False)
    after = check(repaired, terrain, friction=0.4)
    assert after.share_possible == 1.0, str(after)
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(1.0, slope)
    for sole in TALOS.soles():
        axis = (rbd.State(TALOS, repaired.q[20]).frame(sole.frame).X_WF * sole.placement).rotation[:, 2]
        assert np.arccos(min(axis @ normal, 1.0)) < 1e-3
    assert check(repaired, terrain, friction=0.5 * slope).share_possible < 0.1
