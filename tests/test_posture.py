"""Postures by name, and a base placed so that the feet are flat and the robot in balance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError, ModelError
from rbd.robots.posture import configuration, corner_points, place_on_ground, semantic_postures, stand


def tilted(robot: rbd.Robot, q: np.ndarray, rpy: tuple[float, float, float], at: tuple[float, float, float]) -> np.ndarray:
    """The configuration with its base turned and moved."""
    X = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(at)) * pin.XYZQUATToSE3(q[:7])
    return np.concatenate([pin.SE3ToXYZQUAT(X), q[7:]])


def test_half_sitting_is_read_as_pinocchio_reads_it(talos: rbd.Robot) -> None:
    """Joints of the SRDF's group state by name; the base's pose too."""
    model = talos.model.copy()
    pin.loadReferenceConfigurations(model, str(talos.source.srdf), False)
    expected = model.referenceConfigurations["half_sitting"]
    assert np.abs(talos.posture("half_sitting") - pin.normalize(model, expected)).max() < 1e-12


@pytest.mark.parametrize("name", ["romeo", "solo12", "anymal_b", "hyq", "bolt", "panda", "icub"])
def test_postures_of_srdf_files_are_pinocchios(name: str) -> None:
    """Every group state of the file is there, its joints at Pinocchio's values, the base left to `standing`."""
    robot = rbd.load_robot(name)
    model = robot.model.copy()
    pin.loadReferenceConfigurations(model, str(robot.source.srdf), False)
    for entry in model.referenceConfigurations:
        if entry.key() not in robot.source.postures:
            assert np.abs(robot.posture(entry.key())[7:] - entry.data()[7:]).max() < 1e-12


def test_joints_are_placed_by_name(talos: rbd.Robot) -> None:
    """Named joints at their values, the others neutral; names that the robot has not are passed over."""
    q = configuration(talos, {"leg_left_4_joint": 0.5, "no_such_joint": 3.0, "arm_left_1_joint": [0.25]})
    expected = talos.neutral()
    expected[talos.model.joints[talos.joint_id("leg_left_4_joint")].idx_q] = 0.5
    expected[talos.model.joints[talos.joint_id("arm_left_1_joint")].idx_q] = 0.25
    assert np.array_equal(q, expected)


def test_an_endless_joint_takes_its_angle() -> None:
    """One angle of a continuous joint becomes (cos, sin); two numbers are taken as they are."""
    robot = rbd.load_robot("tiago_dual", root="fixed")
    i, joint = next((i, j) for i, j in enumerate(robot.model.joints) if j.nq == 2 and j.nv == 1)
    for given in (0.7, [0.7], [np.cos(0.7), np.sin(0.7)]):
        q = configuration(robot, {robot.model.names[i]: given})
        assert np.abs(q[joint.idx_q : joint.idx_q + 2] - [np.cos(0.7), np.sin(0.7)]).max() < 1e-15


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "cannot be read as XML"),
        ("<robot><group_state", "cannot be read as XML"),
        (
            "<robot><group_state name='up'><joint name='leg_left_4_joint' value='half'/></group_state></robot>",
            "leg_left_4_joint.*'up'.*'half'",
        ),
    ],
)
def test_a_broken_srdf_is_said_to_be_broken(talos: rbd.Robot, tmp_path: Path, text: str, says: str) -> None:
    """With the file's name, and with the joint and the value where one is no number."""
    (tmp_path / "mine.srdf").write_text(text)
    with pytest.raises(ModelError, match=rf"mine\.srdf.*{says}"):
        semantic_postures(talos, tmp_path / "mine.srdf")


@pytest.mark.parametrize("name", ["talos", "g1", "human", "romeo"])
@pytest.mark.parametrize("rpy", [(0.3, 0.0, 0.0), (-0.2, 0.4, 2.0), (np.pi, 0.0, 0.0), (0.0, 1.5, -1.0)])
def test_wherever_the_base_was_the_soles_come_flat(name: str, rpy: tuple[float, float, float]) -> None:
    """Tilted, turned over, lifted: normals of the soles vertical and all corners at z = 0, to 1e-9; joints untouched."""
    robot = rbd.load_robot(name)
    feet = robot.feet(friction=None)
    q = tilted(robot, robot.standing().q, rpy, (1.0, -2.0, 3.0))
    found = stand(robot, q, feet)
    state = rbd.State(robot, found)
    assert np.abs(corner_points(state, feet)[:, 2]).max() < 1e-9
    for foot in feet:
        patch = foot.rows(state).patch
        assert patch is not None and np.abs(patch.axes[:, 2] - [0.0, 0.0, 1.0]).max() < 1e-9
    assert np.array_equal(found[7:], q[7:])


def test_a_robot_that_stands_is_left_alone(talos: rbd.Robot) -> None:
    """Standing again changes nothing, and a heading is kept: only the tilt is undone."""
    feet, q = talos.feet(friction=None), talos.standing().q
    assert np.abs(stand(talos, q, feet) - q).max() < 1e-12
    turned = tilted(talos, q, (0.0, 0.0, 1.1), (0.5, 0.6, 0.0))
    assert np.abs(stand(talos, turned, feet) - turned).max() < 1e-12


def test_with_one_leg_drawn_up_the_lowest_foot_is_on_the_ground(talos: rbd.Robot) -> None:
    """Feet of two heights: no corner below z = 0, and one at it."""
    q = talos.standing().q.copy()
    for joint, angle in (("leg_left_3_joint", -0.2), ("leg_left_4_joint", 0.4), ("leg_left_5_joint", -0.2)):
        q[talos.model.joints[talos.joint_id(joint)].idx_q] += angle
    feet = talos.feet(friction=None)
    heights = corner_points(rbd.State(talos, stand(talos, q, feet)), feet)[:, 2]
    assert abs(heights.min()) < 1e-12 and heights.max() > 0.01


@pytest.mark.parametrize("bend", [-0.3, -0.05, 0.0, 0.1, 0.4])
def test_on_two_points_a_robot_is_turned_until_it_balances(bend: float) -> None:
    """Bolt with both thighs swung: its centre of mass comes over the line of its feet, to 1e-9 m, and can be held there."""
    robot = rbd.load_robot("bolt")
    feet, q = robot.feet(), robot.standing().q.copy()
    for joint in ("FL_HFE", "FR_HFE"):
        q[robot.model.joints[robot.joint_id(joint)].idx_q] += bend
    state = rbd.State(robot, stand(robot, q, feet))
    (left, right), com = corner_points(state, feet), state.com
    along = (left - right)[:2] / np.linalg.norm((left - right)[:2])
    off = (com - right)[:2]
    assert abs(off[0] * along[1] - off[1] * along[0]) < 1e-9
    assert np.abs([left[2], right[2]]).max() < 1e-12
    assert rbd.hold(state, feet).residuals.stationarity < 1e-9


@pytest.mark.parametrize("name", ["solo12", "anymal_c", "go2"])
def test_four_points_come_to_one_floor(name: str) -> None:
    """A tilted quadruped: the plane of its points is made level."""
    robot = rbd.load_robot(name)
    feet = robot.feet(friction=None)
    q = tilted(robot, robot.standing().q, (0.3, -0.2, 1.0), (0.0, 0.0, 2.0))
    assert np.abs(corner_points(rbd.State(robot, stand(robot, q, feet)), feet)[:, 2]).max() < 1e-9


def test_on_one_point_a_robot_keeps_its_attitude() -> None:
    """Nothing tells which way is up for it: only its height changes, until the point is on the ground."""
    box = rbd.load_robot(Path(__file__).parents[1] / "urdf" / "box.urdf")
    q = tilted(box, box.neutral(), (0.3, 0.2, 0.1), (1.0, 2.0, 3.0))
    stood = stand(box, q, [rbd.PointContact("foot", "box", offset=(0.05, 0.0, -0.1))])
    assert np.abs(np.delete(stood - q, 2)).max() < 1e-15
    assert abs(box.at(stood).frame("box", (0.05, 0.0, -0.1)).X_WF.translation[2]) < 1e-15


class TestPlaceOnGround:
    """`place_on_ground`: the base moved and turned until contacts lie on their ground."""

    BOX = Path(__file__).parents[1] / "urdf" / "box.urdf"

    @pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
    def test_it_is_how_a_robot_stands(self, name: str) -> None:
        """One code: from a tilted and lifted base the same pose as `standing`, but for heading and place; v is kept."""
        robot = rbd.load_robot(name)
        standing, v = robot.standing(), np.linspace(-1.0, 1.0, robot.nv)
        tilt = tilted(robot, standing.q, (0.2, -0.1, 0.0), (0.0, 0.0, 1.0))
        placed = place_on_ground(robot.at(tilt, v), robot.feet())
        assert np.array_equal(placed.q, rbd.State(robot, stand(robot, tilt, robot.feet(None))).q)
        assert abs(placed.q[2] - standing.q[2]) < 1e-12 and np.array_equal(placed.q[7:], standing.q[7:])
        assert np.array_equal(placed.v, v)

    def test_on_a_ramp_it_is_turned_by_the_ramps_slope(self, talos: rbd.Robot) -> None:
        """From standing: by atan(0.3) about the ramp's level line, every corner on the ramp."""
        slope = np.arctan(0.3)
        ramp = rbd.Ground(point=(0.2, 0.0, 0.1), normal=(-np.sin(slope), 0.0, np.cos(slope)))
        soles = talos.soles(on=ramp)
        placed = place_on_ground(talos.standing(), soles)
        assert np.abs(np.concatenate([sole.rows(placed).patch.gaps for sole in soles])).max() < 1e-12
        R = placed.base_pose().rotation @ talos.standing().base_pose().rotation.T
        assert np.abs(pin.log3(R) - [0.0, -slope, 0.0]).max() < 1e-12

    def test_on_stairs_each_foot_lies_on_its_own(self, talos: rbd.Robot) -> None:
        """Legs bent for a step of 0.1 m, the base then tilted and lifted: both soles come to their planes."""
        fitting = rbd.find_pose(talos, {"left_sole": (0.2, 0.085, 0.1), "right_sole": (0.0, -0.085, 0.0)})
        q = tilted(talos, fitting.q, (0.1, -0.2, 0.7), (0.3, 0.0, 1.5))
        soles = talos.soles(on={"left_sole": 0.1})
        placed = place_on_ground(talos.at(q), soles)
        assert np.abs(np.concatenate([sole.rows(placed).patch.gaps for sole in soles])).max() < 1e-12
        assert abs(placed.com[2] - fitting.state.com[2]) < 1e-12 and np.array_equal(placed.q[7:], fitting.q[7:])

    def test_between_two_walls(self) -> None:
        """A box as wide as a chimney: its sides come onto both walls, though their normals add up to nothing."""
        box, X_turned = (
            rbd.load_robot(self.BOX),
            pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2.0, 0.0), np.array([-0.1, 0.0, 0.0])),
        )
        left = rbd.SurfaceContact("left", "box", half_lengths=(0.05, 0.05), placement=X_turned,
                                  on=rbd.Ground(point=(0.9, 0, 0), normal=(1.0, 0.0, 0.0)))  # fmt: skip
        X_back = pin.SE3(pin.rpy.rpyToMatrix(0.0, -np.pi / 2.0, 0.0), np.array([0.1, 0.0, 0.0]))
        right = rbd.SurfaceContact("right", "box", half_lengths=(0.05, 0.05), placement=X_back,
                                   on=rbd.Ground(point=(1.1, 0, 0), normal=(-1.0, 0.0, 0.0)))  # fmt: skip
        q = tilted(box, box.neutral(), (0.2, -0.3, 0.25), (0.4, 0.5, 0.6))
        placed = place_on_ground(box.at(q), [left, right])
        assert max(np.abs(c.rows(placed).patch.gaps).max() for c in (left, right)) < 1e-12
        assert placed.q[0] == pytest.approx(1.0, abs=1e-12) and placed.q[1:3] == pytest.approx([0.5, 0.6], abs=1e-9)

    def test_a_ground_of_which_only_the_normal_is_known_goes_through_the_origin(self) -> None:
        """And one of which nothing is known is z = 0."""
        box, n = rbd.load_robot(self.BOX), np.array([0.0, 0.6, 0.8])
        q = tilted(box, box.neutral(), (0.0, 0.0, 0.0), (0.3, 0.2, 1.0))
        for on, normal in ((rbd.Ground(normal=n), n), (None, np.array([0.0, 0.0, 1.0]))):
            side = rbd.SurfaceContact("side", "box", half_lengths=(0.1, 0.1), on=on)
            X_WB = place_on_ground(box.at(q), [side]).base_pose()
            assert abs(X_WB.translation @ normal) < 1e-15 and np.abs(X_WB.rotation[:, 2] - normal).max() < 1e-15

    def test_points_one_above_the_other_say_nothing_of_the_tilt(self) -> None:
        """The lower one comes to the ground."""
        box = rbd.load_robot(self.BOX)
        points = [rbd.PointContact(f"{z}", "box", offset=(0.0, 0.0, z)) for z in (0.1, -0.1)]
        with pytest.warns(rbd.errors.DistantContactWarning, match="'0.1' up to 200 mm above"):
            placed = place_on_ground(box.at(), points)
        assert np.abs(placed.q - [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]).max() < 1e-15

    def test_what_cannot_be_placed_is_refused(self, talos: rbd.Robot) -> None:
        """A base that is fixed or slides, no contacts, one with a body, what is no contact, no state."""
        panda, cart = rbd.load_robot("panda", root="fixed"), rbd.load_robot(self.BOX, root="planar")
        for robot in (panda, cart):
            with pytest.raises(InputError, match="no single floating base"):
                place_on_ground(robot.at(), [rbd.PointContact("p", robot.frames()[-1])])
        state, on_body = talos.standing(), rbd.PointContact("palm", "torso_2_link", on=rbd.Body("base_link"))
        for contacts, says in (
            ([], "contacts is empty"),
            ([on_body], "'palm' is with a body"),
            ([rbd.JointLock("lock", "arm_left_4_joint")], "'lock' is not a contact"),
            ([3], "3 is no constraint"),
            (talos.soles()[0], "single constraint"),
        ):
            with pytest.raises(InputError, match=says):
                place_on_ground(state, contacts)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="State of a robot was expected"):
            place_on_ground(talos, talos.soles())  # type: ignore[arg-type]
