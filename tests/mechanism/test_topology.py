"""The words of the texts, of robots and linkages that have them in every book."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from linkages import Builder, at, free, pinned, planar_chain, sarrus, sarrus_pose
from states import at_neutral

import rbd
from rbd.constraints import JointLock, LoopClosure
from rbd.mechanism import classify

URDF = Path(__file__).parents[2] / "urdf"


class TestOpenChains:
    """Serial and branched."""

    @pytest.mark.parametrize(
        ("bars", "position", "pose"), [(1, (1, 0), (1, 0)), (2, (2, 0), (2, 0)), (3, (2, 1), (3, 0)), (4, (2, 2), (3, 1))]
    )
    def test_bars_in_a_plane(self, bars: int, position: tuple[int, int], pose: tuple[int, int]):
        """A tip has two degrees of freedom of position in a plane, three with its direction; the rest is redundancy."""
        words = classify(at_neutral(planar_chain((1.0,) * bars, 9.0)), [], end="end")
        end = words.end_points[0]
        assert (words.kind, words.closed, words.mobility, words.degrees_of_freedom) == ("serial", False, bars, bars)
        assert (end.position_dof, end.position_redundancy) == position and (end.pose_dof, end.pose_redundancy) == pose
        assert end.legs == 1 and words.base == "the ground"
        assert end.singular == (bars > 1)  # stretched out, as the neutral configuration is

    def test_an_arm_with_seven_joints_has_one_to_spare(self):
        """Panda: its hand's pose takes six; its fingers are no part of that chain, and make it branched."""
        words = classify(at_neutral(rbd.load_robot("panda", root="fixed")), end="panda_hand_tcp")
        end = words.end_points[0]
        assert words.kind == "branched" and words.mobility == 9 and words.ends == ("panda_leftfinger", "panda_rightfinger")
        assert (end.mobility, end.pose_dof, end.pose_redundancy, end.position_redundancy) == (7, 6, 1, 4)

    def test_an_arm_with_six_joints_is_serial_with_none_to_spare(self):
        """UR5."""
        words = classify(at_neutral(rbd.load_robot("ur5", root="fixed")), end="tool0")
        assert words.kind == "serial" and words.end_points[0].pose_redundancy == 0
        assert "serial chain: open. Its base is the ground" in str(words)

    def test_a_humanoid_in_the_air_is_a_branched_chain_on_its_base(self, talos: rbd.Robot):
        """Five ends, six degrees of freedom of a floating base."""
        words = classify(talos.at())
        assert (words.kind, words.base, words.mobility, len(words.ends)) == ("branched", "base_link", 38, 5)
        assert "6 of them those of a floating base" in str(words)

    def test_a_chain_held_in_the_middle_is_branched(self):
        """A path of three bodies floats as a serial chain from its end, and as a branched one from its middle."""
        build = Builder().joint("root", pin.JointModelFreeFlyer(), at()).joint("a", pin.JointModelRZ(), at(1.0), "root")
        assert classify(at_neutral(build.robot())).kind == "serial"
        assert classify(at_neutral(build.joint("b", pin.JointModelRZ(), at(-1.0), "root").robot())).kind == "branched"

    def test_every_model_of_our_own_has_words(self):
        """Of any URDF."""
        for path in sorted(URDF.glob("*.urdf")):
            words = classify(at_neutral(rbd.load_robot(path)), [], loops=False)
            assert words.mobility == words.degrees_of_freedom and words.loops == 0 and words.name in str(words)


class TestClosedChains:
    """Parallel and hybrid."""

    def test_a_four_bar_is_parallel(self):
        """One loop; its coupler stands on two legs."""
        robot = planar_chain((1.0, 1.2, 1.4), 1.5)
        words = classify(at_neutral(robot), [pinned()], end=["end", "j1"])
        assert (words.kind, words.loops, words.mobility, words.degrees_of_freedom) == ("parallel", 1, 1, 3)
        assert [end.legs for end in words.end_points] == [2, 2]
        assert words.end_points[1].position_dof == 1 and words.end_points[1].pose_redundancy == 0
        assert "closed, with 1 independent loop" in str(words) and "constraints remove 2" in str(words)

    def test_a_platform_on_three_legs(self):
        """Each leg two bars and a pin: 3 degrees of freedom in the plane, three legs, no redundancy."""
        build = Builder("3-RRR")
        for k, (x, y) in enumerate(((0.0, 0.0), (2.0, 0.0), (1.0, 1.8))):
            build.joint(f"hip{k}", pin.JointModelRZ(), at(x, y)).joint(f"knee{k}", pin.JointModelRZ(), at(0.8), f"hip{k}")
            if k == 0:
                build.joint("platform", pin.JointModelRZ(), at(0.8), "knee0")
        for k, (x, y) in enumerate(((0.5, 0.0), (0.2, 0.4)), start=1):
            build.frame(f"tip{k}", f"knee{k}", at(0.8)).frame(f"ear{k}", "platform", at(x, y))
        pins = [LoopClosure(f"pin{k}", f"ear{k}", f"tip{k}", kind="planar") for k in (1, 2)]
        words = classify(at_neutral(build.robot()), pins, end="platform")
        end = words.end_points[0]
        assert (words.kind, words.loops, words.mobility) == ("parallel", 2, 3)
        assert (end.legs, end.pose_dof, end.pose_redundancy, end.position_redundancy) == (3, 3, 0, 1)

    def test_an_arm_on_a_four_bar_is_hybrid(self):
        """Loops and a chain that hangs from them."""
        robot = planar_chain((1.0, 1.2, 1.4), 1.5)
        model = robot.model
        j = model.addJoint(2, pin.JointModelRZ(), at(0.6, 0.5), "arm")
        model.addJointFrame(j)
        model.appendBodyToJoint(j, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
        words = classify(at_neutral(rbd.model.checked_model.CheckedModel(model)), [pinned()], end="arm")
        assert (words.kind, words.loops, words.mobility, words.end_points[0].legs) == ("hybrid", 1, 2, 1)

    def test_a_humanoid_on_two_soles_is_closed_through_the_ground(self, talos: rbd.Robot):
        """Both feet stand, the arms are open chains: hybrid; on one sole nothing is closed."""
        two, one = talos.soles(friction=None), talos.soles(friction=None)[:1]
        words = classify(talos.standing(), two, end="base_link")
        assert (words.kind, words.loops, words.mobility, words.base) == ("hybrid", 1, 26, "the ground")
        assert words.end_points[0].legs == 2 and words.end_points[0].pose_dof == 6
        assert classify(talos.standing(), one).kind == "branched"

    def test_other_constraints_close_no_loop(self):
        """A lock takes a degree of freedom; the chain stays open."""
        words = classify(at_neutral(free(pin.JointModelRZ(), pin.JointModelRX())), [JointLock("lock", "j0", position=0.3)])
        assert (words.kind, words.loops, words.mobility) == ("serial", 0, 1)
        np.testing.assert_allclose(words.q, [0.3, 0.0], atol=1e-12)  # brought onto the lock

    def test_a_spatial_loop_has_its_true_mobility(self):
        """Sarrus' linkage, of which the count knows nothing."""
        robot, hinge = sarrus()
        words = classify(rbd.State(robot, sarrus_pose(0.7)), [hinge], end="edge")
        assert (words.mobility, words.loops, words.kind) == (1, 1, "parallel")
        assert (words.end_points[0].position_dof, words.end_points[0].pose_dof) == (1, 1)


class TestAskedWrongly:
    """What has no answer, and what is refused."""

    def test_loops_that_cannot_close_leave_the_mobility_open(self):
        """Bars too short: it is said, and the words that need no configuration are there."""
        words = classify(at_neutral(planar_chain((1.0, 1.0), 5.0)), [pinned()], end="end")
        assert words.mobility is None and words.q is None and words.end_points == () and words.loops == 1
        assert "no configuration was found" in str(words)

    def test_names_and_states_are_checked(self, talos: rbd.Robot):
        """An unknown frame; a name in place of a state."""
        with pytest.raises(rbd.errors.FrameNotFound, match="left_sole"):
            classify(talos.at(), end="left_sol")
        with pytest.raises(rbd.InputError, match="a State of a robot was expected first, got 'talos'"):
            classify("talos")
