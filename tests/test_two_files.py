"""`rbd.doctor(robot, beside=other)`: a URDF beside an MJCF of the same robot; and a xacro, which is no robot yet."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.errors import InputError, ModelError

URDF = """
<robot name="leg">
  <link name="base"><inertial><mass value="4"/>
    <inertia ixx="0.04" iyy="0.05" izz="0.06" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="thigh"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
  <link name="shin"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="left_hip_joint" type="revolute"><parent link="base"/><child link="thigh"/><origin xyz="0 0.1 0"/>
    <axis xyz="0 1 0"/><limit lower="-1.5708" upper="1" effort="35" velocity="20"/></joint>
  <joint name="left_knee_joint" type="revolute"><parent link="thigh"/><child link="shin"/>
    <origin xyz="0 0 -0.4" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 0 -1"/><limit lower="0" upper="2" effort="35" velocity="0"/></joint>
</robot>
"""
MJCF = """
<mujoco model="leg"><compiler angle="radian"/><worldbody><body name="base"><freejoint name="anything"/>
  <inertial pos="0 0 0" mass="4" diaginertia="0.04 0.05 0.06"/>
  <body name="thigh" pos="0 0.1 0"><joint name="left_hip_joint" axis="0 1 0" range="-1.571 1"/>
    <inertial pos="0 0 -0.2" mass="2" fullinertia="0.01 0.02 0.015 0.001 0 0"/>
    <body name="shin" pos="0 0 -0.4" quat="0.70710678 0.70710678 0 0"><joint name="left_knee" axis="0 0 -1" range="0 2"/>
      <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body></body></body></worldbody>
  <actuator><motor joint="left_hip_joint" ctrlrange="-35 35"/><motor joint="left_knee" ctrlrange="-35 35"/></actuator>
</mujoco>
"""


def found(urdf: str, other: str) -> dict[tuple[str, str], str]:
    """{(kind, where): text} of the differences."""
    robot, other = rbd.load_robot(text=urdf), rbd.load_robot(text=other)
    return {(issue.kind, issue.where): issue.text for issue in rbd.doctor(robot, beside=other).differences}


def test_a_urdf_and_an_mjcf_of_one_robot_agree():
    """Up to the roundings of files; a base's name is made up, and a knee is a knee joint."""
    assert found(URDF, MJCF) == {}


KNEE = "left_knee_joint (left_knee)"


@pytest.mark.parametrize(
    ("urdf", "mjcf", "kind", "where", "says"),
    [
        (("", ""), ('"left_knee" ctrlrange="-35 35"', '"left_knee" ctrlrange="-50 50"'), "effort", KNEE, "35 N m here, 50 N m"),
        (
            ("", ""),
            ('<motor joint="left_knee" ctrlrange="-35 35"/>', ""),
            "effort",
            KNEE,
            "has a motor here, and none in leg.xml",
        ),
        (("", ""), ('range="0 2"', 'range="0 2.1"'), "limit", KNEE, "0 to 2 rad here, 0 to 2.1 rad in leg.xml"),
        (("", ""), (' range="0 2"', ""), "limit", KNEE, "0 to 2 rad here, no limit to no limit rad in leg.xml"),
        (("", ""), ('range="0 2"', 'range="0 2" armature="0.1"'), "armature", KNEE, "rotor inertia in M: 0 kg m2 here, 0.1"),
        (("", ""), ('range="0 2"', 'range="0 2" damping="2"'), "damping", KNEE, "0 N m s/rad here, 2 N m s/rad in leg.xml"),
        (("", ""), ('range="0 2"', 'range="0 2" frictionloss="0.2"'), "dry friction", KNEE, "0 N m here, 0.2 N m in leg.xml"),
        (("", ""), ('mass="1"', 'mass="1.2"'), "mass", KNEE, "what it carries: 1 kg here, 1.2 kg in leg.xml"),
        (("", ""), ('mass="1"', 'mass="1.2"'), "mass", "leg", "all moving bodies: 7 kg here, 7.2 kg in leg.xml"),
        (("", ""), ('pos="0 0 -0.2"', 'pos="0 0 -0.21"'), "centre", "left_hip_joint", "(0, 0.1, -0.2) m here at q = 0"),
        (("", ""), ("0.015 0.001", "0.015 0"), "inertia", "left_hip_joint", "principal moments"),
        (("", ""), ('pos="0 0 -0.4" quat', 'pos="0 0 -0.42" quat'), "place", KNEE, "(0, 0.1, -0.4) m here at q = 0"),
        (('xyz="0 0 -1"', 'xyz="0 0 1"'), ("", ""), "axis", KNEE, "(0, -1, 0) here at q = 0, (0, 1, 0) in leg.xml"),
        (("left_knee_joint", "right_knee"), ("", ""), "joint", "right_knee", "is not in leg.xml"),
        (("left_knee_joint", "right_knee"), ("", ""), "joint", "left_knee", "is in leg.xml alone"),
        (
            ("", ""),
            ('<joint name="left_knee"', '<joint type="slide" name="left_knee"'),
            "joint",
            KNEE,
            "moves by rad in 1 degree",
        ),
    ],
)
def test_what_differs_is_told_by_its_joint(urdf, mjcf, kind, where, says):
    """Each change is found under its name, with both numbers."""
    assert says in found(URDF.replace(*urdf), MJCF.replace(*mjcf))[kind, where]


def test_speeds_are_compared_where_both_state_them():
    """An MJCF has no place for them, which is no difference."""
    slower = found(URDF, URDF.replace('velocity="20"', 'velocity="12"'))
    assert slower == {("speed", "left_hip_joint"): "20 rad/s here, 12 rad/s in leg.urdf"}


def test_the_report_and_the_command_line_have_the_differences(tmp_path: Path):
    """35 N m here and 50 there; nothing is an error, so the exit code is 0."""
    one, two = tmp_path / "leg.urdf", tmp_path / "leg.xml"
    one.write_text(URDF)
    two.write_text(MJCF.replace('"left_knee" ctrlrange="-35 35"', '"left_knee" ctrlrange="-50 50"'))
    report = rbd.doctor(rbd.load_robot(one), beside=rbd.load_robot(two))
    assert report.ok and report.beside == "leg.xml"
    assert str(report).splitlines()[0] == "leg: 0 errors, 0 warnings, 1 difference from leg.xml"
    answer = CliRunner().invoke(app, ["info", str(one), "--beside", str(two)])
    assert answer.exit_code == 0, answer.stderr
    assert "35 N m here, 50 N m in leg.xml" in answer.stdout
    answer = CliRunner().invoke(app, ["info", str(one), "--beside", str(tmp_path / "none.xml")])
    assert answer.exit_code == 2 and "no file" in answer.stderr


def test_what_is_said_of_several_joints_alike_is_said_once():
    """One line with the numbers, and the joints below it; the finding of each is in `differences`."""
    other = rbd.load_robot(text=MJCF.replace(' range="', ' armature="0.01" range="'))
    report = rbd.doctor(rbd.load_robot(text=URDF), beside=other)
    assert [issue.kind for issue in report.differences] == ["armature"] * 2
    head, line, names = str(report).splitlines()
    assert head.endswith("2 differences from leg.xml")
    assert line.split() == "differs armature these 2: rotor inertia in M: 0 kg m2 here, 0.01 kg m2 in leg.xml".split()
    assert names.split(", ") == ["                     left_hip_joint", KNEE]


@pytest.mark.parametrize(("other", "says"), [("leg.xml", "beside is str"), (None, "beside is the robot itself")])
def test_what_is_no_second_robot_is_refused(other, says):
    """A path is not loaded: its package folders and options are the caller's."""
    robot = rbd.load_robot("solo12")
    with pytest.raises(InputError, match=says):
        rbd.doctor(robot, beside=robot if other is None else other)


def test_a_xacro_is_told_how_to_be_expanded(tmp_path: Path):
    """By the command; a file that was expanded still has the namespace and comments, and loads."""
    macros = URDF.replace('<robot name="leg">', '<robot name="leg" xmlns:xacro="http://www.ros.org/wiki/xacro">')
    path = tmp_path / "leg.urdf.xacro"
    path.write_text(macros.replace("</robot>", '<xacro:property name="m" value="1"/></robot>'))
    with pytest.raises(ModelError, match=r"leg.urdf.xacro is a xacro: its <xacro:property>.*xacro leg.urdf.xacro > leg.urdf"):
        rbd.load_robot(path)
    path.write_text(macros.replace("</robot>", "<!-- <xacro:leg/> --></robot>"))
    assert rbd.load_robot(path).mass == 7.0
