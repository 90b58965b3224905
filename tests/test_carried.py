"""Objects in a robot's hands: their weight and inertia in its equations of motion, by hand computation; bad input; files."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import DuplicateName, FrameNotFound, InputError, ModelWarning
from rbd.robots.robot import with_plain_things
from rbd.visual.robot_meshes import robot_parts

LEFT, RIGHT = "left_wrist_yaw_link", "right_wrist_yaw_link"
G = 9.81


def box(mass: float = 3.0, **given: Any) -> rbd.Carried:
    """A box of 3 kg between both hands of G1."""
    return rbd.Carried(mass, [LEFT, RIGHT], **{"size": (0.2, 0.3, 0.1), "name": "box", **given})


def test_a_weight_in_one_hand_moves_the_centre_of_mass_and_loads_floor_and_elbow(g1: rbd.Robot):
    """Centre of mass (M c + m p) / (M + m); the floor bears (M + m) g; the elbow m g times its lever."""
    state, m = g1.standing(), 3.0
    loaded = g1.carrying(rbd.Carried(m, [LEFT])).at(state.q)
    p, joint = state.frame(LEFT).X_WF.translation, state.frame("left_elbow_joint").X_WF
    assert loaded.com == pytest.approx((g1.mass * state.com + m * p) / (g1.mass + m), abs=1e-12)
    plain, held = (rbd.hold(each, g1.soles()) for each in (state, loaded))
    assert sum(f[2] for f in held.forces.values()) == pytest.approx((g1.mass + m) * G, abs=1e-5)
    moment = joint.rotation[:, 1] @ np.cross(p - joint.translation, [0.0, 0.0, m * G])  # the elbow turns about y
    elbow = g1.actuated_names.index("left_elbow_joint")
    assert abs(moment) > 0.5 and held.tau[elbow] - plain.tau[elbow] == pytest.approx(moment, abs=1e-9)


def test_two_hands_have_the_momentum_of_one_object_while_they_keep_their_grasp(g1: rbd.Robot):
    """Joints of legs and trunk and the base move the hands as one body: momentum is that of the object in one hand."""
    two = g1.carrying(box())
    one = g1.carrying(rbd.Carried(3.0, [LEFT], size=(0.2, 0.3, 0.1), placement=two.carried[0].placement))
    v = np.linspace(-1.0, 1.0, g1.nv)
    arms = [i for name, joint in g1.joints.items() if any(x in name for x in ("shoulder", "elbow", "wrist")) for i in [joint.v]]
    for i in arms:
        v[i] = 0.0
    for shares in ((0.5, 0.5), (0.8, 0.2), (0.0, 1.0)):
        shared = g1.carrying(box(shares=shares))
        A, bias, mass = shared.at(g1.standing().q, v).centroidal()
        A_1, bias_1, mass_1 = one.at(g1.standing().q, v).centroidal()
        assert mass == pytest.approx(mass_1) and A @ v == pytest.approx(A_1 @ v, abs=1e-10)
        assert bias == pytest.approx(bias_1, abs=1e-10)
    assert np.allclose(g1.carrying(box(shares=(1.0, 0.0))).standing().M, one.standing().M, atol=1e-12)


def test_the_inertia_is_that_of_a_box_or_what_is_given(g1: rbd.Robot):
    """m/12 (y^2 + z^2) about x; three moments, six entries and a matrix are the same; a cube of 500 kg/m3 by default."""
    assert np.diag(box(12.0).inertia) == pytest.approx([0.1, 0.05, 0.13])
    moments = box(inertia=(0.3, 0.4, 0.5))
    assert moments == box(inertia=(0.3, 0.0, 0.0, 0.4, 0.0, 0.5)) == box(inertia=np.diag([0.3, 0.4, 0.5]))
    assert rbd.Carried(4.0, [LEFT]).size == pytest.approx((0.2, 0.2, 0.2))
    placed = g1.carrying(box(placement=pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))))
    assert placed.carried[0].placement.translation.tolist() == [0.1, 0.0, 0.0]
    turned = g1.standing().with_joints({"left_elbow_joint": 0.5}).q
    assert not np.allclose(g1.carrying(box(), at=turned).carried[0].second, g1.carrying(box()).carried[0].second)


def test_shares_are_as_near_to_their_hands_as_masses_can_be(g1: rbd.Robot):
    """Of a box of length L between the hands: L / sqrt(12) from its middle, as two plates; together they are the box."""
    q = g1.standing().q
    way = g1.at(q).frame(LEFT).X_WF.translation - g1.at(q).frame(RIGHT).X_WF.translation
    assert abs(way[1]) > 0.4 and np.abs(way[[0, 2]]).max() < 1e-9
    thing = g1.carrying(box(size=(0.1, 0.4, 0.2))).carried[0]
    places = [X_JH.actInv(own.lever) for _, X_JH, own in thing.parts(g1)]
    assert np.array(places) == pytest.approx(0.4 / np.sqrt(12.0) * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), abs=1e-4)
    whole = sum((X_JH.actInv(own) for _, X_JH, own in thing.parts(g1)), pin.Inertia.Zero())
    assert np.allclose(whole.toDynamicParameters(), pin.Inertia.FromBox(3.0, 0.1, 0.4, 0.2).toDynamicParameters(), atol=1e-9)
    wide = g1.carrying(box(size=(0.1, 4.0, 0.2))).carried[0]  # longer than the way: the shares are in the hands
    for name, (_, _, own) in zip((LEFT, RIGHT), wide.parts(g1), strict=True):
        assert own.lever == pytest.approx(g1.site(name)[1].translation, abs=1e-9)


def test_a_copy_carries_the_same(g1: rbd.Robot):
    """Pickled, copied, under another gravity and with other motors; the plain robot stays as it is, and is another one."""
    mass, loaded = g1.mass, g1.carrying(box())
    copies = [pickle.loads(pickle.dumps(loaded)), copy.copy(loaded), copy.deepcopy(loaded)]
    assert all(x.carried == loaded.carried and x.is_like(loaded) and x.digest == loaded.digest for x in copies)
    for other in (loaded.with_gravity((0.0, 0.0, -1.62)), loaded.with_motors({"left_knee_joint": rbd.Motor(limit=50.0)})):
        assert other.carried == loaded.carried and other.mass == loaded.mass
    assert g1.mass == mass and not g1.carried and not g1.is_like(loaded) and g1.digest != loaded.digest
    assert g1.carrying(box(size=(0.1, 0.1, 0.1), inertia=box().inertia)).digest != loaded.digest
    assert loaded.mass == pytest.approx(mass + 3.0)


def test_the_box_is_drawn_in_the_first_hand(g1: rbd.Robot):
    """With the robot's meshes; and beside the skeleton of a robot without any."""
    [part] = [part for part in robot_parts(g1.carrying(box())) if part.name == "box"]
    assert part.joint == g1.site(LEFT)[0] and np.ptp(part.mesh.vertices, axis=0) == pytest.approx((0.2, 0.3, 0.1))
    arm = rbd.load_robot(Path(__file__).parents[1] / "urdf" / "four_bar.urdf")
    parts = robot_parts(arm.carrying(rbd.Carried(1.0, ["coupler_tip"], name="weight")))
    assert [part.name for part in parts].count("weight") == 1 and len(parts) == len(robot_parts(arm)) + 1


@pytest.mark.parametrize(
    "given, kind, said",
    [
        ({"mass": -1.0}, InputError, "mass of carried object 'object' is -1.0; expected a finite number from"),
        ({"mass": float("nan")}, InputError, "mass of carried object 'object' is nan"),
        ({"grasps": LEFT}, InputError, "expected a list of names"),
        ({"grasps": []}, InputError, "0 grasps; expected the frames of one hand or of two"),
        ({"grasps": [LEFT, RIGHT, "head_link"]}, InputError, "3 grasps"),
        ({"grasps": [LEFT, LEFT]}, DuplicateName, LEFT),
        ({"grasps": ["left_wrist_yaw_lnk"]}, FrameNotFound, "nearest: 'left_wrist_yaw_link'"),
        ({"grasps": ["universe"]}, InputError, "on the world; expected frames of bodies that move"),
        ({"grasps": [LEFT, "left_rubber_hand"]}, InputError, "on one body; expected one of them"),
        ({"inertia": (1.0, 1.0, 3.0)}, InputError, "an inertia that no body can have"),
        ({"inertia": (-1.0, 1.0, 1.0)}, InputError, "-1 is negative"),
        ({"size": (0.1, 0.1)}, InputError, "expected 3 finite numbers"),
        ({"placement": np.ones((4, 4))}, InputError, "placement of carried object 'object' is no rigid placement"),
        ({"second": pin.SE3.Identity()}, InputError, "a pose of its second grasp, and one grasp"),
        ({"grasps": [LEFT, RIGHT], "shares": (0.5, 0.6)}, InputError, "a sum of 1"),
    ],
)
def test_what_cannot_be_carried_is_refused(g1: rbd.Robot, given: dict[str, Any], kind: type[Exception], said: str):
    """With what came and what was expected."""
    with pytest.raises(kind, match=said.replace("(", r"\(")):
        g1.carrying(rbd.Carried(**{"mass": 1.0, "grasps": [LEFT], **given}))


def test_a_robot_takes_all_objects_in_one_call(g1: rbd.Robot):
    """None, a second call, two of one name, and what is no object are refused."""
    two = g1.carrying(box(), rbd.Carried(0.5, ["torso_link"], name="bag"))
    assert two.mass == pytest.approx(g1.mass + 3.5)
    for ask, said in (
        (g1.carrying, "0 objects are given"),
        (lambda: two.carrying(box()), "g1 carries box, 3 kg in .*; bag, 0.5 kg in torso_link, and 1 objects are given"),
        (lambda: g1.carrying(box(), box()), "two carried objects are named 'box'"),
        (lambda: g1.carrying(3.0), r"what is carried is 3.0; expected rbd.Carried\(mass"),
    ):
        with pytest.raises(InputError, match=said):
            ask()


def test_a_trajectory_file_tells_what_was_carried(g1: rbd.Robot, tmp_path: Path):
    """Loaded again with it; a plain robot that is given gets a warning; data that are no object an error."""
    loaded = g1.carrying(box())
    run = rbd.simulate(loaded.standing(), g1.soles(), duration=0.004, step=2e-3, progress=False)
    run.save(tmp_path / "run.npz")
    again = rbd.Trajectory.load(tmp_path / "run.npz")
    assert again.robot.carried == loaded.carried and again.robot.is_like(loaded)
    with pytest.warns(ModelWarning, match="is not as it was"):
        rbd.Trajectory.load(tmp_path / "run.npz", robot=g1)
    for plain in ([{"kg": 1.0}], ["box"], 3.0):
        with pytest.raises(InputError, match="carried objects in a file are"):
            with_plain_things(g1, plain)
