"""Motors of MJCF files are MuJoCo's: which joints have one, gear, ctrlrange and forcerange; the models of gymnasium load."""

from __future__ import annotations

import sys
import warnings
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import mjcf_twin
import numpy as np
import pytest

import rbd
from rbd.errors import ModelError, ModelWarning

MOTORS = {
    "ant": 8,
    "half_cheetah": 6,
    "hopper": 3,
    "humanoid": 17,
    "humanoidstandup": 17,
    "inverted_double_pendulum": 1,
    "inverted_pendulum": 1,
    "pusher_v5": 7,
    "reacher": 2,
    "swimmer": 2,
    "walker2d": 6,
    "walker2d_v5": 6,
}
"""Models of the package gymnasium, and how many motors each has."""
SPRINGS = {"half_cheetah", "humanoid", "humanoidstandup"}
"""Those with springs in joints."""

# Of its own, with what such files have: an included file of default classes, motors with gears and both ranges, some by
# class and some by themselves, three joints of a trunk without any, several joints on a body, a weight for all.
CLASSES = """<mujocoinclude>
  <default>
    <joint armature="0.01" damping="0.1" limited="true"/>
    <geom density="1000" contype="1"/>
    <motor ctrllimited="true" ctrlrange="-1 1"/>
    <default class="leg">
      <joint axis="0 -1 0" range="-150 0"/>
      <motor gear="100"/>
      <default class="foot"><joint range="-45 45"/><motor gear="40" ctrlrange="-.5 .5" forcerange="-0.3 0.3"/></default>
    </default>
  </default>
</mujocoinclude>"""
WALKER = """<mujoco model="stroller">
  <compiler angle="degree" inertiafromgeom="true" settotalmass="24"/>
  <include file="classes.xml"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 9"/>
    <body name="torso" pos="0 0 1.2">
      <joint name="x" type="slide" axis="1 0 0" limited="false" armature="0" damping="0"/>
      <joint name="z" type="slide" axis="0 0 1" limited="false" armature="0" damping="0" ref="1.2"/>
      <joint name="turn" axis="0 1 0" limited="false" armature="0" damping="0"/>
      <geom type="capsule" size="0.05 0.2"/>
      <body name="left" pos="0 0 -.2" childclass="leg"><joint name="left_hip"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0 0 -.4"/>
        <body name="left_shin" pos="0 0 -.4"><joint name="left_knee"/><joint name="left_twist" axis="0 0 1" range="-9 9"/>
          <geom type="capsule" size="0.04" fromto="0 0 0 0 0 -.4"/>
          <body name="left_foot" pos="0 0 -.4" childclass="foot"><joint name="left_ankle"/>
            <geom type="capsule" size="0.06" fromto="-.05 0 0 .15 0 0"/></body></body></body>
      <body name="right" pos="0 0 -.2" childclass="leg"><joint name="right_hip" actuatorfrcrange="-60 60"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0 0 -.8"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="a" joint="left_ankle" class="foot"/>
    <motor name="b" joint="right_hip" class="leg"/>
    <motor name="c" joint="left_hip" class="leg" gear="-70"/>
    <general name="d" joint="left_knee" gear="20" gainprm="3" ctrlrange="-1 1" ctrllimited="true"/>
  </actuator>
</mujoco>"""


def load(path: Path, **more) -> rbd.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return rbd.load_robot(path, **more)


def same_as_mujoco(robot: rbd.Robot, path: Path) -> None:
    """M, gravity and joint limits at several configurations, masses, motors and their limits."""
    model = mjcf_twin.compiled(path)
    assert not isinstance(model, str), model
    assert mjcf_twin.differences(robot, model) == [] and mjcf_twin.motor_limits(robot, model) == []
    assert robot.nu == model.nu and robot.mass == pytest.approx(float(model.body_mass[1:].sum()), rel=1e-12)


@pytest.fixture
def stroller(tmp_path: Path) -> Path:
    """The walker, with its classes in a file beside it."""
    (tmp_path / "classes.xml").write_text(CLASSES)
    path = tmp_path / "stroller.xml"
    path.write_text(WALKER)
    return path


def test_gears_and_ranges_of_classes_are_limits_at_the_joints(stroller):
    """The gear times the control range, cut by the force range and by the joint's own: four motors of eight joints."""
    robot = load(stroller)
    assert robot.actuated_names == ("left_hip", "left_knee", "left_ankle", "right_hip")  # in the order of v
    # -70 of the control; 20 times 3; 40 times the force's 0.3 rather than times the control's 0.5; 100, cut at the joint to 60
    assert robot.effort_limit == pytest.approx([70.0, 60.0, 12.0, 60.0], rel=1e-12)
    assert robot.passive == {"x", "z", "turn", "left_twist"}
    same_as_mujoco(robot, stroller)


def test_the_doctor_names_joints_without_a_motor(stroller):
    """As notes: they are passive, which the file means."""
    robot = load(stroller)
    told = {note.where: note.text for note in rbd.doctor(robot).notes if note.kind == "passive"}
    assert set(told) == robot.passive and all("has no actuator at it: it is passive" in text for text in told.values())
    assert not [f for f in rbd.doctor(robot).warnings if f.kind == "passive"]
    driven = robot.with_motors({"left_twist": rbd.Motor(limit=5.0)})
    assert "left_twist" not in {note.where for note in rbd.doctor(driven).notes if note.kind == "passive"}
    assert not [f for f in rbd.doctor(load(stroller, leave_out=["actuators"])).notes if f.kind == "passive"]


def test_motors_of_mjcf_may_have_lines(stroller):
    """Those of the file, with what `with_motors` adds; the others keep the file's limits."""
    robot = load(stroller).with_motors({"left_knee": rbd.Motor(torque_speed=[(0, 60), (5, 0)], rotor_inertia=1e-4, gear=20)})
    assert robot.effort_limit == pytest.approx([70.0, 60.0, 12.0, 60.0], rel=1e-12)
    assert robot.torque_limits(np.full(robot.nv, 2.5))[1] == pytest.approx([70.0, 30.0, 12.0, 60.0], rel=1e-12)
    at = robot.joints["left_knee"].v.start
    assert robot.model.armature[at] == pytest.approx(0.04) and load(stroller).model.armature[at] == pytest.approx(0.01)


def gymnasium_folder() -> Path | None:
    """Where the models of the package are; None where it is not installed. It is not imported."""
    try:
        return Path(str(distribution("gymnasium").locate_file("gymnasium/envs/mujoco/assets")))
    except PackageNotFoundError:
        return None


@pytest.mark.skipif(gymnasium_folder() is None, reason="wants the models of gymnasium: pip install gymnasium")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("name", MOTORS)
def test_models_of_gymnasium_are_mujocos(name: str):
    """M, gravity, masses, limits and motors: six motors of walker2d's nine joints, seventeen of humanoid's."""
    folder = gymnasium_folder()
    assert folder is not None
    path = folder / f"{name}.xml"
    robot = load(path, leave_out=["springs"] if name in SPRINGS else [])
    assert robot.nu == MOTORS[name]
    same_as_mujoco(robot, path)
    if name == "walker2d":
        assert robot.nv == 9 and robot.passive == {"rootx", "rootz", "rooty"} and (robot.effort_limit == 100.0).all()
    if name == "humanoid":
        assert robot.effort_limit.max() == pytest.approx(120.0) and robot.effort_limit.min() == pytest.approx(10.0)


BALL = '<joint name="j" axis="0 1 0"/><geom class="thin" type="capsule" fromto="0 0 0 0 0 .3"/>'
WRITERS = {
    "replicate": (
        f'<replicate count="3" offset="0.5 0 0.1" euler="0 0 10"><body name="b">{BALL}</body></replicate>',
        '<motor joint="j1" class="thin" ctrlrange="-2 2"/>',
        ["j1"],
        [14.0],
    ),
    "attach": (
        '<body name="hull" pos="0 0 1"><freejoint/><geom size=".1 .1 .1" type="box"/>'
        '<frame pos="0.3333333333333333 0 0"><attach model="leg" body="leg" prefix="l_"/></frame></body>',
        '<motor joint="l_hip" ctrlrange="-3 3" gear="2"/>',
        ["l_hip"],
        [6.0],
    ),
}
LEG = """<mujoco model="leg"><worldbody><body name="leg"><joint name="hip" axis="0 1 0"/>
<geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/></body></worldbody></mujoco>"""


def writer_file(folder: Path, tag: str) -> Path:
    """A file with an element that writes others."""
    (folder / "leg.xml").write_text(LEG)
    world, motors, _, _ = WRITERS[tag]
    models = '<asset><model name="leg" file="leg.xml"/></asset>' if tag == "attach" else ""
    path = folder / f"{tag}.xml"
    path.write_text(
        '<mujoco><default><default class="thin"><geom size="0.02"/><motor gear="7"/></default></default>'
        f"{models}<worldbody>{world}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    return path


@pytest.mark.parametrize("tag", WRITERS)
def test_elements_that_write_others_go_through_mujocos_reader(tmp_path, tag):
    """To all digits, and again in `doctor`."""
    path = writer_file(tmp_path, tag)
    robot = load(path)
    same_as_mujoco(robot, path)
    assert list(robot.actuated_names) == WRITERS[tag][2] and robot.effort_limit == pytest.approx(WRITERS[tag][3], rel=1e-12)
    assert rbd.doctor(robot).ok


def test_without_mujoco_a_file_is_refused_with_the_name_of_the_extra(stroller, monkeypatch):
    """What to install, or what to do without it."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ModelError, match=r"stroller.xml: MJCF files are read by MuJoCo.*pip install 'rbd-contact\[mujoco\]'"):
        load(stroller)


@pytest.mark.parametrize(
    ("inside", "says"),
    [
        ('<replicate count="1000000000"><geom size=".1"/></replicate>', "its <replicate> writes more than 1000000 elements"),
        ('<replicate count="2"><body><joint/></body></replicate>', "MuJoCo refuses it: .*mass and inertia of moving bodies"),
        ('<body><geom size=".1"/><attach model="x" prefix="a"/></body>', "MuJoCo refuses it: .*'attach', line 1"),
    ],
)
def test_what_mujoco_refuses_is_refused_in_its_words(tmp_path, inside, says):
    """Also what it would fill the memory with."""
    path = tmp_path / "m.xml"
    path.write_text(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
    with pytest.raises(ModelError, match=says):
        load(path)
