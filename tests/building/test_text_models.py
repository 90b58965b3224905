"""Robots from a text in memory: the same as from a file, without one, wherever a robot goes."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model import output_files
from rbd.robots import LoopFile

URDF = Path(__file__).parents[2] / "urdf"
INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
MJCF = """
<mujoco model="swing"><compiler angle="radian"/><option gravity="0 0 -3"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="pivot" type="hinge" axis="0 1 0" armature="0.1" damping="0"/>
    <inertial pos="0 0 -0.5" mass="2" diaginertia="0.1 0.1 0.01"/><geom type="capsule" size="0.05 0.4" pos="0 0 -0.5"/></body>
  <body name="rest" pos="1 0 0"><freejoint name="free"/><geom type="sphere" size="0.1" mass="1"/></body>
</worldbody><equality><connect body1="rest" body2="arm" anchor="0 0 0"/></equality>
<keyframe><key name="up" qpos="3 1 0 0 1 0 0 0"/></keyframe></mujoco>
"""


@pytest.fixture(autouse=True)
def no_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """None of these makes a temporary folder or leaves a file in the working folder."""

    def refuse() -> Path:
        raise AssertionError("a temporary folder was wanted")

    monkeypatch.setattr(output_files, "new_folder", refuse)
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)
    yield
    assert not os.listdir(empty)


def four_bar() -> rbd.Robot:
    """The four-bar of urdf/, from its texts."""
    loops = LoopFile.of_text((URDF / "four_bar.loops.yaml").read_text(), "four_bar.loops.yaml")
    return rbd.load_robot(text=(URDF / "four_bar.urdf").read_text(), loops=loops)


def same(one: rbd.Robot, other: rbd.Robot) -> bool:
    """Whether two robots have the same numbers, names, motors, postures and loops."""
    postures = one.postures.keys() == other.postures.keys()
    postures = postures and all(np.array_equal(q, other.postures[name]) for name, q in one.postures.items())
    loops = [str(loop) for loop in one.loops()] == [str(loop) for loop in other.loops()]
    return bool(one.model == other.model and one.passive == other.passive and postures and loops and one.name == other.name)


@pytest.mark.parametrize("path", sorted(URDF.glob("*.urdf")), ids=lambda path: path.stem)
def test_a_text_gives_the_robot_of_its_file(path: Path) -> None:
    """Of every model here, bit by bit, from a string or from bytes; its doctor finds the same."""
    closing = path.with_suffix(".loops.yaml")
    loops = LoopFile.of_text(closing.read_text(), closing.name) if closing.is_file() else True
    file = rbd.load_robot(path)
    for text in (path.read_text(), path.read_bytes()):
        robot = rbd.load_robot(text=text, loops=loops)
        assert same(robot, file) and robot.source.in_memory and not file.source.in_memory
        assert (robot.urdf.name, robot.urdf.is_file()) == (path.name, False)
        assert rbd.doctor(robot) == rbd.doctor(file) == robot.report


def test_an_mjcf_text_gives_the_robot_of_its_file(tmp_path: Path) -> None:
    """Keyframes, gravity, rotor inertia and the <equality> are those of the file; `loops=None` opens it."""
    path = tmp_path / "swing.xml"
    path.write_text(MJCF)
    robot, file = rbd.load_robot(text=MJCF), rbd.load_robot(path)
    assert same(robot, file) and robot.gravity.tolist() == [0.0, 0.0, -3.0]
    assert robot.urdf.name == "swing.xml" and sorted(robot.postures) == ["qpos0", "up"]
    assert len(robot.loops()) == 1 and not rbd.load_robot(text=MJCF, loops=None).loops()
    again = pickle.loads(pickle.dumps(robot))
    assert same(again, file) and len(again.visual_model.geometryObjects) == 2


def test_it_travels(tmp_path: Path) -> None:
    """To another process by its pickle, with its shapes and its doctor; as deep copies it is independent."""
    robot = four_bar()
    copied = copy.deepcopy(robot)
    assert same(copied, robot) and copied.model is not robot.model and rbd.doctor(copied) == robot.report
    (tmp_path / "sent").write_bytes(pickle.dumps(robot))
    code = """import pickle, sys, rbd
robot = pickle.load(open(sys.argv[1], "rb"))
print(robot.digest, robot.urdf.name, robot.visual_model.ngeoms, len(robot.loops()), rbd.doctor(robot).notes[0].where)"""
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "sent")], capture_output=True, text=True, timeout=120)
    expected = f"{robot.digest} four_bar.urdf {robot.visual_model.ngeoms} 1 coupler_pin"
    assert done.stdout.strip() == expected, done.stderr


@pytest.mark.parametrize("ending", [".npz", ".nc"])
def test_a_trajectory_brings_its_robot_back(tmp_path: Path, ending: str) -> None:
    """Its file has the robot's text and its loops': nothing else is needed to read it."""
    if ending == ".nc":
        pytest.importorskip("xarray")
    robot = four_bar()
    swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.02, step=0.01, progress=False)
    swing.save(tmp_path / f"swing{ending}")
    again = rbd.Trajectory.load(tmp_path / f"swing{ending}")
    assert isinstance(again.robot, rbd.Robot) and same(again.robot, robot) and np.array_equal(again.q, swing.q)
    assert np.isfinite(rbd.solve(again[-1].state, [0.0], again.robot.loops()).a).all()


def test_a_motion_file_brings_its_robot_back(tmp_path: Path) -> None:
    """Its own, and not the robot of that name which comes with the package."""
    loops = LoopFile.of_text((URDF / "four_bar.loops.yaml").read_text().replace("0.69813", "0.5"), "four_bar.loops.yaml")
    text = (URDF / "four_bar.urdf").read_text().replace('value="0.12"', 'value="7"')
    robot = rbd.load_robot(text=text, loops=loops)
    assert robot.mass == pytest.approx(7.12)
    q = robot.at("assembled").q
    motion = rbd.Motion.from_function(robot, lambda t: q, np.linspace(0.0, 1.0, 5))
    motion.save(tmp_path / "rest.npz")
    again = rbd.Motion.read(tmp_path / "rest.npz").robot
    assert isinstance(again, rbd.Robot) and same(again, robot)


def test_a_trajectory_of_an_mjcf_text(tmp_path: Path) -> None:
    """With its <equality> closed, or open as it was loaded."""
    for loops in (True, None):
        robot = rbd.load_robot(text=MJCF, loops=loops)
        state = rbd.State(robot, rbd.mechanism.assemble(robot.at()).q) if loops else robot.at()
        rbd.simulate(state, duration=0.01, step=0.01, progress=False).save(tmp_path / "swing.npz")
        again = rbd.Trajectory.load(tmp_path / "swing.npz").robot
        assert isinstance(again, rbd.Robot) and same(again, robot)


def test_its_feet_and_soles(tmp_path: Path) -> None:
    """From its collision shapes, as from a file's."""
    path = URDF / "walker.urdf"
    feet = ["left_foot", "right_foot"]
    robot, file = rbd.load_robot(text=path.read_text(), feet=feet), rbd.load_robot(path, feet=feet)
    assert str(robot.soles()) == str(file.soles())
    assert np.array_equal(robot.standing().q, file.standing().q)
    assert str(robot.soles_from_collision(feet)) == str(file.soles_from_collision(feet))


def test_meshes_come_from_the_folders_that_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a path relative to the folder or by package://; never from the working folder, which a text does not know."""
    folder = tmp_path / "meshes"
    (folder / "own").mkdir(parents=True)
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    lines = ["o tetrahedron", *(f"v {x} {y} {z}" for x, y, z in corners), "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
    (folder / "own" / "part.obj").write_text("\n".join(lines))
    for name in ("own/part.obj", "package://own/part.obj"):
        shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        text = f'<robot name="part"><link name="part">{INERTIAL}{shape}</link></robot>'
        robot = rbd.load_robot(text=text, package_dirs=[folder])
        assert not robot.collision_stand_ins and robot.collision_model.geometryObjects[0].geometry.num_vertices == 4
        assert not robot.report.warnings  # type: ignore[union-attr]
        with monkeypatch.context() as here:
            here.chdir(folder)
            with pytest.warns(rbd.errors.ModelWarning, match="mesh is missing"):
                alone = rbd.load_robot(text=text)
            with pytest.warns(rbd.errors.ModelWarning, match="boxes in place of 1 mesh"):
                assert alone.collision_stand_ins


def test_includes_of_an_mjcf_come_from_the_folders_that_are_named(tmp_path: Path) -> None:
    """Else the include is refused by name."""
    (tmp_path / "more.xml").write_text(
        '<mujocoinclude><body name="b"><freejoint/><geom size="0.1" mass="1"/></body></mujocoinclude>'
    )
    text = '<mujoco model="m"><worldbody><include file="more.xml"/></worldbody></mujoco>'
    assert rbd.load_robot(text=text, package_dirs=[tmp_path]).nv == 6
    with pytest.raises(rbd.errors.ModelError, match=r"more\.xml"):
        rbd.load_robot(text=text)


TEXT = f'<robot name="two"><link name="a">{INERTIAL}</link></robot>'
REFUSED: dict[str, dict[str, Any]] = {
    "larger than": {"text": TEXT, "limits": rbd.model.FileLimits(max_bytes=20)},
    "DOCTYPE": {"text": f"<!DOCTYPE r [<!ENTITY x 'y'>]>{TEXT}"},
    "degrees of freedom": {"text": TEXT, "limits": rbd.model.FileLimits(max_dof=3)},
    "UTF-8": {"text": b"\xff" + TEXT.encode()},
    "unclosed token": {"text": "<robot"},
}


@pytest.mark.parametrize("message", REFUSED)
def test_a_text_from_memory_is_checked_as_a_file_is(message: str) -> None:
    """Its size, its degrees of freedom, its document type, its encoding, its XML."""
    with pytest.raises(rbd.errors.ModelError, match=message):
        rbd.load_robot(**REFUSED[message])


def test_a_name_of_a_text_is_no_path() -> None:
    """A robot may be called like a path; messages and pickles still have a plain name, and nothing is read there."""
    for name in ("/etc/passwd", "../up", "a b", "x" * 300):
        robot = rbd.load_robot(text=f'<robot name="{name}"><link name="a">{INERTIAL}</link></robot>')
        assert robot.source.in_memory and robot.name == name and "/" not in robot.urdf.name
        assert pickle.loads(pickle.dumps(robot)).source.in_memory


NONSENSE: dict[str, tuple[dict[str, Any], str]] = {
    "neither": ({}, "no robot is named"),
    "both": ({"name_or_path": "solo12", "text": "<robot/>"}, "expected one of them"),
    "a number": ({"text": 3}, "as a string or as bytes"),
    "a path as text": ({"text": "urdf/box.urdf"}, r"load_robot\(path\)"),
    "a text as path": ({"name_or_path": '\n <robot name="x"/>'}, r"load_robot\(text=...\)"),
    "no character": ({"text": "<\ud800"}, "UTF-8"),
}


@pytest.mark.parametrize("what", NONSENSE)
def test_nonsense_is_refused(what: str) -> None:
    """With what came, and what to do."""
    given, message = NONSENSE[what]
    with pytest.raises(rbd.InputError, match=message):
        rbd.load_robot(**given)


def test_a_loop_file_of_text_is_checked() -> None:
    """As the file is: unknown keys by name, no YAML, no text."""
    with pytest.raises(rbd.errors.ModelError, match=r"mine\.yaml: the file has a key 'rot'; .*root"):
        LoopFile.of_text("rot: fixed", "mine.yaml")
    with pytest.raises(rbd.errors.ModelError, match="cannot be read as YAML"):
        LoopFile.of_text("{a: [")
    with pytest.raises(rbd.InputError, match="as a string"):
        LoopFile.of_text(b"root: fixed")  # type: ignore[arg-type]
    with pytest.raises(rbd.errors.ModelError, match="larger than"):
        LoopFile.of_text(" " * 300_000)


def test_capsules_of_a_urdf_are_shapes() -> None:
    """A <capsule>, at which Pinocchio's reader drops all shapes of a file, is drawn and touches; other shapes stay."""
    shape = "<{0}><geometry><capsule radius='0.1' length='0.5'/></geometry></{0}>"
    shape += "<{0}><geometry><sphere radius='0.2'/></geometry></{0}>"
    text = f"<robot name='r'><link name='a'>{INERTIAL}{shape.format('visual')}{shape.format('collision')}</link></robot>"
    robot = rbd.load_robot(text=text)
    for model in (robot.visual_model, robot.collision_model):
        capsule, ball = (g.geometry for g in model.geometryObjects)
        assert (capsule.radius, capsule.halfLength, ball.radius) == (0.1, 0.25, 0.2)
    robot = rbd.load_robot(text=text, feet=["a"])
    assert robot.standing().q[2] == pytest.approx(0.35)  # the capsule's lower end


def test_a_ball_joint_of_a_urdf_is_that_of_an_mjcf(rng: np.random.Generator) -> None:
    """Type "spherical": M, bias and frames as of MuJoCo's ball joint in the same place, with a hinge before and behind it."""
    link = '<link name="{0}"><inertial><origin xyz="0.1 0.2 -0.3"/><mass value="2"/>'
    link += '<inertia ixx="1" iyy="2" izz="2.5" ixy="0.1" ixz="0" iyz="0"/></inertial></link>'
    hinge = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 -1"/>'
    hinge += '<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="{3}" velocity="7"/><dynamics armature="0.3"/></joint>'
    ball = '<joint name="b" type="spherical"><parent link="one"/><child link="two"/>'
    ball += '<origin xyz="0 0 -1" rpy="0.3 0.2 0.1"/></joint><link name="tip"/>'
    tip = '<joint name="t" type="fixed"><parent link="two"/><child link="tip"/><origin xyz="0 0 -0.5"/></joint>'
    text = f"""<robot name="r"><link name="base"/>{"".join(link.format(x) for x in ("one", "two", "three"))}
      {hinge.format("a", "base", "one", 5)}{ball}{hinge.format("c", "two", "three", 6)}{tip}</robot>"""
    inertial = '<inertial pos="0.1 0.2 -0.3" mass="2" fullinertia="1 2 2.5 0.1 0 0"/>'
    turn = " ".join(map(repr, pin.Quaternion(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1)).coeffs()[[3, 0, 1, 2]].tolist()))
    mjcf = f"""<mujoco model="r"><compiler angle="radian"/><worldbody>
      <body name="one" pos="0 0 -1"><joint name="a" type="hinge" axis="0 1 0" armature="0.3"/>{inertial}
      <body name="two" pos="0 0 -1" quat="{turn}"><joint name="b" type="ball"/>{inertial}<site name="tip" pos="0 0 -0.5"/>
      <body name="three" pos="0 0 -1"><joint name="c" type="hinge" axis="0 1 0" armature="0.3"/>{inertial}
      </body></body></body></worldbody></mujoco>"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one, other = rbd.load_robot(text=text, root="fixed"), rbd.load_robot(text=mjcf, root="fixed")
    assert list(one.joints) == list(other.joints) == ["a", "b", "c"] and (one.nq, one.nv, one.nu) == (6, 5, 5)
    for _ in range(5):
        q = pin.integrate(one.model, pin.neutral(one.model), rng.normal(size=5))
        v = rng.normal(size=5)
        mine, theirs = one.at(q, v), other.at(q, v)
        assert np.allclose(mine.M, theirs.M, atol=1e-13) and np.allclose(mine.h, theirs.h, atol=1e-12)
        assert np.allclose(mine.frame("tip").X_WF.homogeneous, theirs.frame("tip").X_WF.homogeneous, atol=1e-14)
    assert one.joints["a"].upper == 2.0 and one.joints["c"].speed == 7.0 and one.joints["b"].upper == np.inf
    assert one.effort_limit.tolist() == [5.0, np.inf, np.inf, np.inf, 6.0]
