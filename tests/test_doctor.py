"""The doctor: what is refused and what is said about a robot after Pinocchio has built it."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_urdf_file import BODY, GOOD, INERTIA, hinge, more, swapped, written
from work import calls

import rbd
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.robots import catalogue

URDF = Path(__file__).parents[1] / "urdf"
LIGHT = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'


def inertia(**moments: float) -> str:
    return "<inertia " + " ".join(f'i{k}="{moments.get(k, 0.0)}"' for k in ("xx", "xy", "xz", "yy", "yz", "zz")) + "/>"


def kinds(report: rbd.robots.ModelReport) -> dict[str, int]:
    found = [finding.kind for finding in report.warnings]
    return {kind: found.count(kind) for kind in dict.fromkeys(found)}


# ------------------------------------------------------------------------------------------------------- refused


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (more('<link name="tip"/>' + hinge("swing", "foot", "tip", "revolute")), r"joint 'swing' \('tip'\) have no inertia"),
        (more(f'<link name="tip">{LIGHT}</link>' + hinge("swing", "foot", "tip", "prismatic")), "joint 'swing'.*M is singular"),
        (
            more('<link name="a"/><link name="b"/>' + hinge("s", "foot", "a", "revolute") + hinge("t", "a", "b", "revolute")),
            r"joint 't' \('b'\) have no inertia",
        ),
        (
            more('<link name="a"/><link name="b"/>' + hinge("s", "foot", "a", "revolute") + hinge("t", "a", "b")),
            r"joint 's' \('a', 'b'\) have no inertia",
        ),
        (swapped(BODY, LIGHT, 3), "joint 'ankle'"),
        (swapped(INERTIA, inertia(xx=-1.0, yy=0.1, zz=0.1), 3), r"'ankle' \('foot'\) have an indefinite inertia.*negative"),
        (swapped(INERTIA, inertia(yy=0.1, zz=0.1), 3).replace('<origin xyz="0 0 -0.1" rpy="0 0 0.5"/>', ""), "joint 'ankle'"),
        (swapped(INERTIA, inertia(xx=-1.0, yy=-1.0, zz=-1.0), 0), "joint 'root_joint'|joint 'hip'"),
        (swapped(INERTIA, inertia(xx=0.1, yy=0.1, zz=0.1, xy=5.0), 3), "M is singular|negative eigenvalue"),
        (f'<robot name="r"><link name="ball">{LIGHT}</link></robot>', r"joint 'root_joint' \('ball'\) have no inertia"),
    ],
)
def test_a_joint_with_nothing_beyond_it_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    """A tip without inertia, or one that pulls M below zero, is named: its joint and its links."""
    with pytest.raises(ModelError, match=says) as caught:
        rbd.load_robot(written(tmp_path, text))
    assert str(caught.value).startswith("mine.urdf: ")


UNSOUND = {"romeo_full": "RThumb3", "alex_psyonic_hands": "index_q1"}


@pytest.mark.parametrize(("name", "says"), UNSOUND.items())
def test_a_users_copy_of_an_unsound_robot_is_refused(name: str, says: str, tmp_path: Path) -> None:
    """Full Romeo's fingertips leave M singular in each pose; a hand of Alex mimics no joint."""
    copy = tmp_path / "copy.urdf"
    copy.write_bytes(catalogue.find(name).urdf.read_bytes())
    with pytest.raises(ModelError, match=says):
        rbd.load_robot(copy)


def test_massless_bodies_inside_a_chain_are_fine() -> None:
    """The human has nineteen of them, and M is regular wherever its axes do not line up."""
    robot = rbd.load_robot("human")
    assert sum(inertia.mass == 0.0 for inertia in robot.model.inertias[2:]) == 19
    assert rbd.doctor(robot).ok


def test_a_light_finger_on_a_heavy_robot_is_fine(tmp_path: Path) -> None:
    """A gram at a millimetre is an inertia: relative smallness alone is no singular matrix."""
    tiny = f'<inertial><mass value="1e-3"/>{inertia(xx=1e-9, yy=1e-9, zz=1e-9)}</inertial>'
    text = more(f'<link name="tip">{tiny}</link>' + hinge("swing", "foot", "tip", "revolute"))
    robot = rbd.load_robot(written(tmp_path, text.replace('<mass value="1"/>', '<mass value="100"/>')))
    assert np.linalg.eigvalsh(robot.at().M)[0] > 0.0


# -------------------------------------------------------------------------------------------------------- warned


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (inertia(xx=-1e-3, yy=0.1, zz=0.1), "one is negative"),
        (inertia(xx=0.01, yy=0.01, zz=0.1), "the largest is more than the sum of the others"),
        (inertia(), "1 kg without extension"),
        (inertia(yy=0.1, zz=0.1), "1 kg without extension"),
    ],
)
def test_inertias_that_no_body_has_are_said_once(tmp_path: Path, body: str, says: str) -> None:
    """Real robots have them: the link is named, the robot loads, and the doctor's report says which moments."""
    path = written(tmp_path, swapped(INERTIA, body, 2))
    with pytest.warns(ModelWarning, match=r"mine: 1 link has an inertia that no body has \('shin'\)") as caught:
        robot = rbd.load_robot(path)
    assert len(caught) == 1 and caught[0].filename == __file__
    (finding,) = (f for f in rbd.doctor(robot).warnings if f.kind == "inertia")
    assert finding.where == "shin" and says in finding.text


def test_a_rod_a_plate_and_a_rounded_file_are_bodies(tmp_path: Path) -> None:
    """Triangle equalities are bodies, up to the file's rounding."""
    for body in (inertia(xx=1e-9, yy=0.1, zz=0.1), inertia(xx=0.05, yy=0.05, zz=0.1), inertia(xx=0.1, yy=0.1, zz=0.1)):
        robot = rbd.load_robot(written(tmp_path, swapped(INERTIA, body, 2)))
        assert "inertia" not in kinds(rbd.doctor(robot))


def test_all_there_is_to_say_of_the_good_file(tmp_path: Path) -> None:
    """One line on load: damping of the hip, the ankle without limit, which mimics the hip."""
    with pytest.warns(ModelWarning) as caught:
        robot = rbd.load_robot(written(tmp_path, GOOD))
    assert [str(w.message) for w in caught] == [
        "mine: 1 motor has no effort limit ('ankle'); 1 joint has damping or friction, which act where "
        "robot.joint_damping() or joint_frictions() are given ('hip'); "
        "1 joint mimics another in the file, and is free here ('ankle'). rbd.doctor(robot) lists everything."
    ]
    report = rbd.doctor(robot)
    assert report.ok and kinds(report) == {"effort": 1, "friction": 1, "mimic": 1}
    assert "damping 0.1 and dry friction 0.2" in str(report) and "0 errors, 3 warnings" in str(report)


def test_a_sound_robot_loads_in_silence() -> None:
    """No finding, no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = rbd.load_robot("go2")
    assert rbd.doctor(robot) == rbd.robots.ModelReport("go2", (), ())
    assert str(rbd.doctor(robot)) == "go2: 0 errors, 0 warnings. Nothing is wrong with it."


def test_postures_outside_the_limits_are_said() -> None:
    """simple_humanoid's half_sitting is outside four limits."""
    robot = rbd.load_robot("simple_humanoid")
    assert "1 posture is outside the joint limits ('half_sitting')" in rbd.doctor(robot).summary()
    (finding,) = (f for f in rbd.doctor(robot).warnings if f.kind == "posture")
    assert "KNEE" in finding.text or "outside the limits, by up to" in finding.text


def test_missing_meshes_are_named_and_none_is_opened(tmp_path: Path) -> None:
    """By their existence: a file that is there is not looked into."""
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "here.stl").write_text("no mesh at all")
    names = ("package://pack/here.stl", "package:///pack/here.stl", "pack/here.stl", str(tmp_path / "pack" / "here.stl"))
    shapes = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in (*names, "package://pack/gone.dae")
    )
    path = written(tmp_path, swapped('<link name="eye"/>', f'<link name="eye">{shapes}</link>'))
    with pytest.warns(ModelWarning, match=r"1 mesh is missing \('package://pack/gone.dae'\)"):
        rbd.load_robot(path)
    with pytest.warns(ModelWarning, match="2 meshes are missing"):
        rbd.load_robot(written(tmp_path, path.read_text().replace("pack/here.stl", "pack/nowhere.stl", 1)))


def test_a_planar_joint_moves_in_its_own_plane(tmp_path: Path) -> None:
    """Pinocchio passes over its axis; one that is not z is said."""
    text = more(f'<link name="slab">{BODY}</link>' + hinge("slide", "base", "slab", "planar"))
    with pytest.warns(ModelWarning, match=r"1 planar joint has an axis that is not its z \('slide'\)"):
        rbd.load_robot(written(tmp_path, text))


@pytest.mark.parametrize(("name", "count"), [("talos", 5), ("icub", 14)])
def test_strange_bodies_of_real_robots(name: str, count: int) -> None:
    """Talos has five bodies without extension, iCub fourteen that are none: counted by hand in their files."""
    assert kinds(rbd.doctor(rbd.load_robot(name)))["inertia"] == count


@pytest.mark.parametrize(("name", "most"), [("talos", 50_000), ("human", 22_000)])
def test_loading_stays_fast(name: str, most: int) -> None:
    """The calls of a load, doctor included, once the first has filled the caches (33,393 for Talos, 14,329 for the human)."""
    rbd.load_robot(name)
    assert calls(lambda: rbd.load_robot(name)) < most


@pytest.mark.parametrize("nonsense", [None, "talos", 3, [], object()])
def test_the_doctor_wants_a_robot(nonsense: object) -> None:
    """A name is no robot."""
    with pytest.raises(InputError, match="doctor wants a robot"):
        rbd.doctor(nonsense)  # type: ignore[arg-type]


def test_a_file_that_changed_since_is_told(tmp_path: Path) -> None:
    """Mass that the file has and the model has not is an error of the report."""
    path = written(tmp_path, GOOD)
    robot = rbd.load_robot(path)
    written(tmp_path, GOOD.replace('<mass value="1"/>', '<mass value="2"/>', 1))
    report = rbd.doctor(robot)
    assert not report.ok and report.errors[0].kind == "mass"
    assert "the moving links of the file weigh 5 kg, and the model 4 kg" in str(report)


def _spoil(model: pin.Model, what: str) -> None:
    """Change a model as its owner can, after it was checked."""
    if what in ("number", "mass"):
        model.inertias[1].mass = np.nan if what == "number" else -1.0
    elif what == "limit":
        low = np.array(model.lowerPositionLimit)
        knee = model.joints[model.getJointId("knee")].idx_q
        low[knee] = 1.0 + model.upperPositionLimit[knee]
        model.lowerPositionLimit = low
    elif what == "name":
        model.names[2] = model.names[1]


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("number", "the bodies at joint 'root_joint' have a mass, inertia or origin that is not finite"),
        ("mass", "the bodies at joint 'root_joint' weigh -1 kg"),
        ("limit", "joint 'knee' has its limits swapped"),
        ("name", "two joints are called 'root_joint'; expected different names"),
    ],
)
def test_a_model_that_was_changed_since_is_told(tmp_path: Path, what: str, says: str) -> None:
    """What loading refuses in a file, the doctor finds in a model."""
    robot = rbd.load_robot(written(tmp_path, GOOD))
    _spoil(robot.model, what)
    found = next(finding for finding in rbd.doctor(robot).errors if finding.kind == what)
    assert says in found.text and found.where == re.findall("'(.*?)'", found.text)[0]


def test_a_body_that_the_file_got_since_is_told(tmp_path: Path) -> None:
    """By its name: the model has none of it."""
    path = written(tmp_path, GOOD)
    robot = rbd.load_robot(path)
    written(tmp_path, more(f'<link name="toe">{BODY}</link>' + hinge("bend", "foot", "toe", "revolute")))
    found = {finding.where for finding in rbd.doctor(robot).errors if finding.kind == "body"}
    assert found == {"toe"}


def test_a_loop_that_is_defined_nowhere_is_told(tmp_path: Path) -> None:
    """A hinge whose axes point oppositely however the joints stand has no place at which it is closed."""
    text = (URDF / "four_bar.urdf").read_text()
    (tmp_path / "four_bar.urdf").write_text(text)
    flipped = '<link name="flipped"/><joint name="flip" type="fixed"><origin rpy="3.141592653589793 0 0"/>'
    flipped += '<parent link="rocker_tip"/><child link="flipped"/></joint></robot>'
    (tmp_path / "four_bar.urdf").write_text(text.replace("</robot>", flipped))
    loops = (URDF / "four_bar.loops.yaml").read_text().replace("kind: planar", "kind: revolute")
    loops = loops.replace("frame_b: rocker_tip", "frame_b: flipped")
    (tmp_path / "four_bar.loops.yaml").write_text(loops)
    (found,) = [each for each in rbd.doctor(rbd.load_robot(tmp_path / "four_bar.urdf")).notes if each.kind == "loop"]
    assert found.where == "coupler_pin" and "no place at which it is closed: it is not defined in these postures" in found.text


# ---------------------------------------------------------------------------------------------------------- MJCF

INERTIAL = '<inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.1 0.1"/>'
JOINT = '<joint name="j" type="hinge" axis="0 1 0" range="-1 1"/>'
ARM = f'<mujoco model="m"><worldbody><body name="b">{JOINT}{INERTIAL}<body name="c"><joint name="k"/>{INERTIAL}</body></body>'
ARM += "</worldbody></mujoco>"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('axis="0 1 0"', 'axis="0 0 0"', "axis too small in joint .'j', line"),
        ('axis="0 1 0"', 'axis="0 nan 0"', "<joint> 'j': axis is '0 nan 0'"),
        ('axis="0 1 0"', 'axis="0 1"', "attribute 'axis' does not have enough data"),
        ('range="-1 1"', 'range="1 -1"', "joint 'j' has its limits swapped"),
        ('mass="1"', 'mass="-1"', "mass and inertia of moving bodies must be larger.*'b', line"),
        ('mass="1"', 'mass="1e-13"', "body 'b' has a mass of 1e-13 kg"),
        ('mass="1"', 'mass="inf"', "<inertial>: mass is 'inf'"),
        ('diaginertia="0.1', 'diaginertia="nan', "<inertial>: diaginertia"),
        ('pos="0 0 -0.5"', 'pos="0 0 1e300"', "body_ipos of body 'b' has the number 1e.300"),
        ('name="b"', 'name="b" quat="0 0 0 0"', "zero quaternion is not allowed .'body', line"),
        ('name="k"', 'name="j"', "repeated name 'j' in joint"),
        ('name="c"', 'name="b"', "repeated name 'b' in body"),
        ('name="k"', 'name="universe"', "joint 'universe'"),
        ('<body name="c"', '<include file="x.xml"/><body name="c"', "<include> is not read"),
        ("<worldbody>", '<asset><mesh file="../../secret.stl"/></asset><worldbody>', "'../../secret.stl', outside the folder"),
        ("<worldbody>", '<asset><mesh file="/etc/passwd"/></asset><worldbody>', "'/etc/passwd', outside the folder"),
        ("<worldbody>", '<compiler meshdir=".."/><asset><mesh file="x.stl"/></asset><worldbody>', "outside the folder"),
        ("<mujoco", "<!DOCTYPE m><mujoco", "DOCTYPE"),
        (f'<joint name="k"/>{INERTIAL}', '<joint name="k"/>', "mass and inertia of moving bodies must be larger.*'c', line"),
    ],
)
def test_a_broken_mjcf_file_is_refused_by_name(tmp_path: Path, old: str, new: str, says: str) -> None:
    """What Pinocchio would drop, count as zero, or crash on."""
    assert rbd.load_robot(written(tmp_path, ARM, "arm.xml")).mass == 2.0
    with pytest.raises(ModelError, match=says):
        rbd.load_robot(written(tmp_path, ARM.replace(old, new, 1), "broken.xml"))


# -------------------------------------------------------------------------------------------- another Pinocchio


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("__version__ = '3.4.0'\nclass Model: pass", "finds version 3.4.0 at .*by PYTHONPATH.*unset PYTHONPATH"),
        ("__version__ = '4.0.9'\nclass Model: pass", "rbd needs pip's, 4.1 or later"),
        ("class Pinocchio: 'a plugin of nose'", "knows no robots: .*pip uninstall pinocchio"),
        ("import no_such_module", "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise RuntimeError('made for another Python')", "cannot be imported: RuntimeError: made for another"),
    ],
)
def test_another_pinocchio_is_named(tmp_path: Path, content: str, says: str) -> None:
    """ROS's on PYTHONPATH, or PyPI's package of that name: one ImportError of ours, with what to do."""
    (tmp_path / "pinocchio").mkdir()
    (tmp_path / "pinocchio" / "__init__.py").write_text(content)
    code = "try: import rbd\nexcept ImportError as e: print(type(e).__name__, type(e).__mro__[1].__name__, e)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={"PYTHONPATH": str(tmp_path)})
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("WrongPinocchio RbdError 'import pinocchio' finds ")
    assert re.search(says, run.stdout), run.stdout
    assert str(tmp_path) in run.stdout
