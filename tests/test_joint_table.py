"""The joint table: parts of q, v, a and tau by names and patterns, and the joint of an entry."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import DuplicateName, InputError, JointNotFound
from rbd.model.joint_table import Joints

SOLO = rbd.load_robot("solo12")
PANDA = rbd.load_robot("panda", root="fixed", passive=["panda_joint7"])


@pytest.mark.parametrize("robot", [SOLO, PANDA], ids=lambda robot: robot.name)
def test_indices_are_those_of_each_joint(robot: rbd.Robot) -> None:
    """Of every joint, alone and all together; at_q, at_v and at_tau are their inverses."""
    table = robot.joints
    for joint in table.values():
        assert table.q_of(joint.name).tolist() == list(range(joint.q.start, joint.q.stop))
        assert table.v_of([joint.name]).tolist() == list(range(joint.v.start, joint.v.stop))
        assert all(table.at_q(i) is joint for i in table.q_of(joint.name))
        assert all(table.at_v(i) is joint for i in table.v_of(joint.name))
        printed = re.search(r"q\[(\d+):(\d+)\].*?, v\[(\d+):(\d+)\]", repr(joint))  # slices, as `joint.q` is, also of one entry
        assert printed and [int(x) for x in printed.groups()] == [joint.q.start, joint.q.stop, joint.v.start, joint.v.stop]
    assert table.q_of(list(table)).tolist() == list(range(robot.nq))
    assert table.v_of("*").tolist() == list(range(robot.nv))
    assert table.tau_of("*").tolist() == list(range(robot.nu))
    assert [table.at_tau(i).name for i in range(robot.nu)] == list(robot.actuated_names)
    for k, name in enumerate(robot.actuated_names):
        assert table.tau_of(name).tolist() == [k]
    assert [table.q_of(c.name).tolist() for c in table.positions] == [[i] for i in range(robot.nq)]


def test_order_is_that_of_the_names() -> None:
    """What is written by names is read by names."""
    names = ["HR_KFE", "FL_HAA", "FR_HFE"]
    state = SOLO.standing()
    q, wanted = state.q.copy(), np.array([0.1, 0.2, 0.3])
    q[SOLO.joints.q_of(names)] = wanted
    assert np.array_equal(q, state.with_joints(dict(zip(names, wanted, strict=True))).q)
    v = np.zeros(SOLO.nv)
    v[SOLO.joints.v_of(names)] = wanted
    moving = state.with_joint_velocities(dict(zip(names, wanted, strict=True)))
    assert np.array_equal(v, moving.v)
    assert np.array_equal(SOLO.joints.coordinates(q, names), wanted)
    assert moving.with_joint_velocities({"root_joint.vz": 2.0}).v[2] == 2.0
    assert moving.with_joint_velocities({"root_joint": np.arange(6.0)}).v[:6].tolist() == [0, 1, 2, 3, 4, 5]


def test_patterns_stand_for_all_that_match() -> None:
    """Joints first, else single entries; what two patterns find counts once."""
    table = SOLO.joints
    assert table.matching("*_KFE") == ("FL_KFE", "FR_KFE", "HL_KFE", "HR_KFE")
    assert table.matching(["FL_*", "*_KFE"]) == ("FL_HAA", "FL_HFE", "FL_KFE", "FR_KFE", "HL_KFE", "HR_KFE")
    assert table.q_of("root_joint.q?").tolist() == [3, 4, 5, 6]
    assert table.v_of("root_joint.[vw]z").tolist() == [2, 5]
    assert table.coordinates(SOLO.standing().q).shape == (12,)  # the base has several
    assert PANDA.joints.tau_of("panda_joint?").tolist() == [0, 1, 2, 3, 4, 5]  # the seventh has no motor


def test_continuous_joints_have_cosine_and_sine_in_q_and_an_angle() -> None:
    """`coordinates` gives the angle."""
    robot = rbd.load_robot("tiago", root="fixed")
    name = next(joint.name for joint in robot.joints.values() if joint.is_continuous)
    state = robot.at().with_joints({name: 2.5})
    assert np.abs(state.q[robot.joints.q_of(name)] - [np.cos(2.5), np.sin(2.5)]).max() < 1e-15
    assert abs(robot.joints.coordinates(state.q, name)[0] - 2.5) < 1e-15


def test_names_that_nothing_has_are_refused_with_the_nearest() -> None:
    """Also patterns; and indices beyond the end, joints without a motor, and values of a wrong size."""
    table = SOLO.joints
    for ask in (table.q_of, table.v_of, table.tau_of, table.matching):
        with pytest.raises(JointNotFound, match="FL_KFE"):
            ask("FL_KFF")
        with pytest.raises(JointNotFound, match="no joint matches"):
            ask(["FL_*", "XL_*"])
        with pytest.raises(DuplicateName, match="twice"):
            ask(["FL_KFE", "FL_KFE"])
        for nonsense in (3, [3], None, b"FL_KFE"):
            with pytest.raises(InputError):
                ask(nonsense)
    with pytest.raises(InputError, match="'root_joint' of solo12 has no motor"):
        table.tau_of(["FL_KFE", "root_joint"])
    with pytest.raises(InputError, match="panda_joint7"):
        PANDA.joints.tau_of("panda_joint[7]")
    for at in (table.at_q, table.at_v, table.at_tau):
        for nonsense in (-1, 100, 1.5, True, "FL_KFE", None):
            with pytest.raises(InputError, match="is no entry"):
                at(nonsense)
    with pytest.raises(InputError, match="shape"):
        table.coordinates(np.zeros(3))
    with pytest.raises(InputError, match="several|degrees of freedom"):
        table.coordinates(SOLO.standing().q, "root_joint")
    state = SOLO.standing()
    for values in ({"FL_KFE": [1.0, 2.0]}, {"root_joint": 1.0}, {"FL_KFE": np.nan}, [1.0]):
        with pytest.raises(InputError):
            state.with_joint_velocities(values)
    with pytest.raises(JointNotFound, match="FL_KFE"):
        state.with_joint_velocities({"FL_KFF": 1.0})


def test_joints_are_named_by_what_they_do() -> None:
    """URDF's words and the axis: of a built robot as it was built, of Pinocchio's other joints by their kinds."""
    models = {
        "revolute about -y": pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0])),
        "revolute about (0, 0.6, 0.8)": pin.JointModelRevoluteUnaligned(np.array([0.0, 0.6, 0.8])),
        "continuous about z": pin.JointModelRUBZ(),
        "prismatic along x": pin.JointModelPX(),
        "helical about z": pin.JointModelHZ(0.1),
        "planar": pin.JointModelPlanar(),
        "spherical": pin.JointModelSpherical(),
        "floating": pin.JointModelFreeFlyer(),
        "translation along x, y, z": pin.JointModelTranslation(),
    }
    chain = pin.Model()
    for name, joint in models.items():
        chain.addJoint(chain.njoints - 1, joint, pin.SE3.Random(), name)
    both = pin.JointModelComposite(pin.JointModelRX())
    both.addJoint(pin.JointModelPY(), pin.SE3.Identity())
    chain.addJoint(chain.njoints - 1, both, pin.SE3.Identity(), "revolute about x, then prismatic along y")
    for name, joint in Joints(chain, "chain").items():
        assert joint.words == name
    assert rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0).joints["crank_joint"].words == "continuous about -y"
