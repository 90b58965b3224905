"""Singularities against closed forms: links in line, dead centres, change points."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from linkages import Builder, at, bennett, closed, four_bar_pose, pinned, planar_chain

import rbd
from rbd.constraints import LoopClosure
from rbd.mechanism import singularities, singularities_along
from rbd.mechanism.singular_configurations import _minima

LENGTHS = (3.0, 1.5, 2.0, 2.5)  # no link turns right round


def slider_crank(a: float = 1.0, b: float = 2.5) -> rbd.model.checked_model.CheckedModel:
    """A crank and a rod about z, and a slider along x, which the rod's tip is pinned to."""
    build = Builder("slider_crank").joint("crank", pin.JointModelRZ(), at()).joint("rod", pin.JointModelRZ(), at(a), "crank")
    build.joint("slider", pin.JointModelPX(), at())
    return build.frame("end", "rod", at(b)).frame("pivot", "slider", at()).robot()


def slider_crank_poses(angles: np.ndarray, a: float = 1.0, b: float = 2.5) -> np.ndarray:
    """Q at crank angles, the slider in front."""
    rod = -np.arcsin(a * np.sin(angles) / b)
    return np.column_stack([angles, rod - angles, a * np.cos(angles) + b * np.cos(rod)])


def in_line(q: np.ndarray) -> float:
    """sin(th3 - th2) of a four-bar: coupler and rocker in line where it is zero."""
    return float(np.sin(q[2]))


class TestFourBar:
    """Coupler and rocker in line, and change points."""

    def test_the_distance_of_the_passive_joints_is_that_of_their_determinant(self):
        """Det J2 = L2 L3 sin(th3 - th2); in joint coordinates the product of both singular values of J2."""
        a, b, c, d = LENGTHS
        robot = planar_chain((a, b, c), d)
        for crank in (0.3, 0.5, 0.7):
            q = four_bar_pose(a, b, c, d, crank)
            J2 = pinned().rows(rbd.State(robot, q)).J[:, 1:]
            assert abs(abs(np.linalg.det(J2)) - b * c * abs(in_line(q))) < 1e-12
            found = singularities(rbd.State(robot, q), [pinned()], inputs=["j0"]).kinds["output"]
            assert not found.singular and 0.0 < found.distance < 1.0

    def test_driven_at_the_crank_it_is_singular_where_coupler_and_rocker_are_in_line(self):
        """The crank angle there is cos th1 = (a^2 + d^2 - (b + c)^2) / 2 a d; the crank's lock leaves the other two loose."""
        a, b, c, d = LENGTHS
        crank = np.arccos((a * a + d * d - (b + c) ** 2) / (2.0 * a * d))
        A = a * np.array([np.cos(crank), np.sin(crank)])
        coupler = np.arctan2(-A[1], d - A[0])
        robot = planar_chain((a, b, c), d)
        found = singularities(rbd.State(robot, [crank, coupler - crank, 0.0]), [pinned()], inputs=["j0"], outputs=["j2"])
        assert found.singular == ("output",)
        output = found.kinds["output"]
        assert output.lost == 1 and output.distance < 1e-9 and output.joints == ("j1", "j2")
        v = output.velocities[0]
        assert np.abs(pinned().rows(rbd.State(robot, output.q)).J @ v).max() < 1e-9 and v[0] == 0.0
        assert "inputs locked" in str(found)

    def test_it_is_found_along_the_motion(self):
        """From one elbow to the other through the limit of the crank, which turns back there."""
        a, b, c, d = LENGTHS
        limit = np.arccos((a * a + d * d - (b + c) ** 2) / (2.0 * a * d))
        angles = limit - np.linspace(0.9, 0.02, 20)
        there = [four_bar_pose(a, b, c, d, x, -1.0) for x in angles]
        back = [four_bar_pose(a, b, c, d, x, 1.0) for x in angles[::-1]]
        robot = planar_chain((a, b, c), d)
        found = singularities_along(rbd.State(robot, there[0]), [pinned()], path=np.array(there + back), inputs=["j0"])
        output = [s for s in found.found if s.kind == "output"]
        assert len(output) == 1 and 19.0 < output[0].at < 20.0
        assert abs(output[0].q[0] - limit) < 1e-12 and abs(in_line(output[0].q)) < 1e-9
        assert [s for s in found.found if s.kind == "configuration"] == []
        assert found.distances["output"].shape == (40,) and "output: singular" in str(found)

    def test_a_flat_parallelogram_is_singular_in_every_way(self):
        """J loses rank; with it J2, and the rest."""
        robot = planar_chain((1.0, 2.0, 1.0), 2.0)
        flat = singularities(rbd.State(robot, [0.0, 0.0, -np.pi]), [pinned()], inputs=["j0"], outputs=["j2"])
        assert flat.singular == ("configuration", "output", "input") and flat.points > 4
        bent = singularities(rbd.State(robot, [0.5, -0.5, -np.pi + 0.5]), [pinned()], inputs=["j0"], outputs=["j2"])
        assert bent.singular == () and "regular" in str(bent)

    def test_a_turning_parallelogram_passes_two_change_points(self):
        """At 0 and 180 degrees of its crank, met between the configurations given."""
        robot = planar_chain((1.0, 2.0, 1.0), 2.0)
        angles = np.linspace(-0.4, 3.5, 40)
        path = np.column_stack([angles, -angles, angles - np.pi])
        found = [
            s for s in singularities_along(rbd.State(robot, path[0]), [pinned()], path=path).found if s.kind == "configuration"
        ]
        assert len(found) == 2
        np.testing.assert_allclose([s.q[0] for s in found], [0.0, np.pi], atol=1e-6)  # rounding: errors grow with squares here

    def test_a_traced_motion_is_taken_as_it_is(self):
        """The rocker of a crank-rocker turns back where crank and coupler are in line: twice a turn, by the law of cosines."""
        a, b, c, d = 1.0, 3.0, 2.0, 2.5
        robot = rbd.mechanism.four_bar(a, b, c, d)
        turn = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=np.linspace(0.0, 6.2, 50))
        found = singularities_along(robot.at(turn.q[0]), path=turn, inputs=["crank_joint"], outputs=["rocker_joint"])
        assert [s.kind for s in found.found] == ["input", "input"]
        rockers = sorted(rbd.mechanism.link_angles(robot.at(s.q))["rocker"] for s in found.found)
        expected = sorted(np.pi - np.arccos((c * c + d * d - reach**2) / (2.0 * c * d)) for reach in (b - a, b + a))
        np.testing.assert_allclose(rockers, expected, atol=1e-9)


class TestDeadCentres:
    """Slider-crank and five-bar."""

    def test_a_piston_cannot_start_its_crank_at_a_dead_centre(self):
        """Driven by the slider, with crank and rod in line, at 0 and 180 degrees: the crank can move with the slider locked."""
        robot, poses = slider_crank(), slider_crank_poses(np.linspace(-0.5, 4.0, 60))
        pin_here = LoopClosure("wrist", "pivot", "end", kind="planar")
        found = singularities_along(rbd.State(robot, poses[0]), [pin_here], path=poses, inputs=["slider"])
        assert {s.kind for s in found.found} == {"output"}
        np.testing.assert_allclose([s.q[0] for s in found.found], [0.0, np.pi], atol=1e-9)
        assert all(s.joints == ("crank", "rod") for s in found.found)

    def test_driven_by_the_crank_the_slider_rests_there(self):
        """The same two poses lose the slider's freedom: type 1."""
        robot, poses = slider_crank(), slider_crank_poses(np.linspace(-0.5, 4.0, 60))
        wrist = [LoopClosure("wrist", "pivot", "end", kind="planar")]
        for outputs in (["slider"], "pivot"):
            found = singularities_along(
                rbd.State(robot, poses[0]),
                wrist,
                path=poses,
                inputs=["crank"],
                outputs=outputs,
            )
            assert {s.kind for s in found.found} == {"input"}
            np.testing.assert_allclose([s.q[0] for s in found.found], [0.0, np.pi], atol=1e-9)
            assert np.abs(found.found[0].velocities[0][2]) < 1e-9

    def test_a_five_bar_is_loose_where_its_outer_links_are_in_line(self):
        """Type 2: its two cranks locked, the joint between the outer links can move."""
        build = Builder("five_bar")
        build.joint("left", pin.JointModelRZ(), at()).joint("left_outer", pin.JointModelRZ(), at(1.0), "left")
        build.joint("right", pin.JointModelRZ(), at(1.6)).joint("right_outer", pin.JointModelRZ(), at(1.0), "right")
        robot = build.frame("pivot", "left_outer", at(1.2)).frame("end", "right_outer", at(1.2)).robot()
        E1 = np.array([np.cos(2.0), np.sin(2.0)])
        path = []
        for phi in np.linspace(-0.6, 0.3, 31):  # turn the left outer link; the right leg follows, by the law of cosines
            P = E1 + 1.2 * np.array([np.cos(phi), np.sin(phi)])
            x, y = P - (1.6, 0.0)
            r = np.hypot(x, y)
            knee = np.arccos((r * r - 1.0 - 1.44) / 2.4)
            right = np.arctan2(y, x) - np.arctan2(1.2 * np.sin(knee), 1.0 + 1.2 * np.cos(knee))
            path.append([2.0, phi - 2.0, right, knee])
        found = singularities_along(rbd.State(robot, path[0]), [pinned()], path=np.array(path), inputs=["left", "right"])
        assert [s.kind for s in found.found] == ["output"]
        q = found.found[0].q
        assert abs(np.sin((q[2] + q[3]) - (q[0] + q[1]))) < 1e-9
        assert found.found[0].joints == ("left_outer", "right_outer")


class TestAskedWrongly:
    """What is no singularity, and what is refused."""

    def test_an_over_constrained_loop_is_not_singular_for_its_redundant_rows(self):
        """Ranks are compared with those nearby on the motion, not with the number of rows."""
        state = closed(bennett(), [pinned("revolute")], np.array([0.9, -1.0, 0.4]))
        found = singularities(state, [pinned("revolute")], inputs=["j0"])
        assert found.singular == () and set(found.kinds) == {"configuration", "output"}

    def test_names_are_checked(self):
        """An unknown joint, an unknown frame, all joints driven, text for a list."""
        robot = planar_chain(LENGTHS[:3], LENGTHS[3])
        state = rbd.State(robot, four_bar_pose(*LENGTHS, 0.5))
        for wrong, words in (
            ({"inputs": ["j9"]}, "no joint 'j9'"),
            ({"inputs": ["j0", "j1", "j2"]}, "all joints"),
            ({"inputs": "j0"}, "list of joints"),
            ({"outputs": "tip"}, "no frame 'tip'"),
        ):
            with pytest.raises(rbd.InputError, match=words):
                singularities(state, [pinned()], **wrong)

    def test_a_path_off_the_constraints_is_refused(self):
        """Bars too short to close at all."""
        robot = planar_chain((1.0, 1.0), 5.0)
        with pytest.raises(rbd.InputError, match="configuration 0 of the path"):
            singularities_along(rbd.State(robot, np.zeros(2)), [pinned()], path=np.array([[0.3, 0.3], [0.2, 0.2]]))
        with pytest.raises(rbd.InputError, match="expected"):
            singularities_along(rbd.State(robot, np.zeros(2)), [pinned()], path=np.zeros(2))


@pytest.mark.parametrize(
    ("distances", "least"),
    [
        ([3.0, 1.0, 2.0], [1]),
        ([1.0, 2.0, 3.0], [0]),
        ([3.0, 2.0, 1.0], [2]),
        ([1.0, 0.0, 0.0, 1.0], [1]),
        ([1.0, 1.0, 1.0], []),
    ],
)
def test_the_least_distances_along_a_path_are_found_at_its_ends_too(distances: list[float], least: list[int]):
    """Of a path that comes nearer, its end; of one that goes away, its beginning; of a level one far from zero, none."""
    assert _minima(np.array(distances)) == least
