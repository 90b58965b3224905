"""URDF and SRDF: shapes, rotors and postures that no robot has are refused or told by name, and what is right is read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import ModelError, ModelWarning

INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
CORNERS = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1))


def urdf(folder: Path, shape: str = "", *, kind: str = "collision", dynamics: str = "", more: str = "") -> Path:
    """A base with a shape, on which an arm turns."""
    drawn = f"<{kind}><geometry>{shape}</geometry></{kind}>" if shape else ""
    path = folder / "it.urdf"
    path.write_text(f"""<robot name="it"><link name="base">{INERTIAL}{drawn}</link><link name="arm">{INERTIAL}</link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>{dynamics}
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint>{more}</robot>""")
    return path


SHAPES = {
    '<sphere radius="-1"/>': "the sphere in the {} shape of link 'base' has radius '-1'; expected 1e-09 m or more",
    '<sphere radius="0"/>': "radius '0'",
    '<sphere radius="1e-320"/>': "radius '1e-320'",
    '<sphere radius="nan"/>': "radius is 'nan'; expected a finite number",
    '<sphere radius="1_0"/>': "radius is '1_0'",
    '<sphere radius="1 2"/>': "radius is '1 2'",
    '<sphere radius="1e300"/>': "radius is '1e300'",
    "<sphere/>": "radius is missing",
    '<box size="1 -1 1"/>': "the box in the {} shape of link 'base' has size '1 -1 1'",
    '<box size="1 1"/>': "size is '1 1'; expected 3 finite numbers",
    '<cylinder radius="1" length="0"/>': "the cylinder in the {} shape of link 'base' has length '0'",
    '<capsule radius="-0.1" length="1"/>': "the capsule in the {} shape of link 'base' has radius '-0.1'",
    '<mesh filename="m.obj" scale="1 0 1"/>': "the mesh in the {} shape of link 'base' has the scale '1 0 1'",
    '<mesh filename="m.obj" scale="1 1e-300 1"/>': "the scale '1 1e-300 1'",
    '<mesh filename="m.obj" scale="1 inf 1"/>': "scale is '1 inf 1'",
    '<mesh filename="m.obj" scale="2"/>': "scale is '2'; expected 3 finite numbers",
}


@pytest.mark.parametrize("kind", ["collision", "visual"])
@pytest.mark.parametrize("shape", SHAPES)
def test_sizes_that_no_body_has_are_refused_by_the_links_name(tmp_path: Path, shape: str, kind: str) -> None:
    """Negative, zero, denormal, missing, no numbers: urdfdom takes them, and such a sphere rests at z = -1."""
    with pytest.raises(ModelError, match=SHAPES[shape].format(kind)):
        rbd.load_robot(urdf(tmp_path, shape, kind=kind))


def test_an_origin_of_a_shape_is_finite(tmp_path: Path) -> None:
    """Where a shape is can be no number either."""
    path = urdf(tmp_path, '<sphere radius="1"/>')
    path.write_text(path.read_text().replace("<collision>", '<collision><origin xyz="0 nan 0"/>'))
    with pytest.raises(ModelError, match="the origin of the collision shape of link 'base': xyz is '0 nan 0'"):
        rbd.load_robot(path)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (-2.0, -1.0, -0.5)])
def test_a_mirrored_mesh_stands_on_its_mirrored_underside(tmp_path: Path, scale: tuple[float, float, float]) -> None:
    """A corner of a box, mirrored: its sole is the mirrored triangle, or where z is mirrored its lowest point."""
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    (tmp_path / "m.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = urdf(tmp_path, f'<mesh filename="m.obj" scale="{scale[0]} {scale[1]} {scale[2]}"/>')
    found = rbd.load_robot(path).collision_model.geometryObjects[0]
    expected = np.array(CORNERS) * scale
    assert np.abs(np.sort(found.geometry.vertices(), axis=0) - np.sort(expected, axis=0)).max() < 1e-7  # read as floats
    if scale[2] > 0.0:
        robot = rbd.load_robot(path)
        (sole,) = robot.soles_from_collision(["base"])
        ground = np.array([sole.placement.act(corner) for corner in sole.corners])
        assert np.abs(np.sort(ground, axis=0) - np.sort(expected[:3], axis=0)).max() < 1e-7


@pytest.mark.parametrize("root", ["free_flyer", "fixed"])
def test_the_rotor_of_a_urdf_is_in_the_mass_matrix(tmp_path: Path, root: rbd.robots.loop_file.Root) -> None:
    """<dynamics armature> adds its value to its own joint's entry of M, and to no other term."""
    bare, robot = (rbd.load_robot(urdf(tmp_path, dynamics=f'<dynamics armature="{a}"/>'), root=root) for a in (0, 0.3))
    difference = robot.at().M - bare.at().M
    assert abs(difference[-1, -1] - 0.3) < 1e-15 and np.count_nonzero(difference) == 1
    assert np.array_equal(robot.at().h, bare.at().h)
    for wrong in ("-1", "nan", "1_0"):
        with pytest.raises(ModelError, match=f"joint 'hinge'.*armature.*{wrong}"):
            rbd.load_robot(urdf(tmp_path, dynamics=f'<dynamics armature="{wrong}"/>'), root=root)


@pytest.mark.parametrize("part", [
    '<transmission name="t"><joint name="hinge"/><actuator name="a"><motorInertia>0.1</motorInertia></actuator></transmission>',
    '<transmission name="t"><joint name="hinge"/><x:rotor_inertia xmlns:x="u" value="2"/></transmission>',
])  # fmt: skip
def test_a_rotor_that_is_not_in_M_is_told_by_its_joint(tmp_path: Path, part: str) -> None:
    """It is in a warning, not in M: what readers make of motorInertia depends on their idea of the gear."""
    with pytest.warns(ModelWarning, match="1 joint has a rotor inertia that is not in M .'hinge'."):
        robot = rbd.load_robot(urdf(tmp_path, more=part))
    (finding,) = [f for f in rbd.doctor(robot).warnings if f.kind == "armature"]
    assert finding.where == "hinge" and "rotors=True" in finding.text
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbd.load_robot(urdf(tmp_path, more=part.replace("0.1", "0").replace('value="2"', 'value="0"')))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1 2", "1_0", "", " ", "0x1", "1,5", "1e999", "\u0661"])
def test_a_posture_is_made_of_numbers(tmp_path: Path, value: str) -> None:
    """Python's own reader takes 1_0 for ten; a joint with one coordinate has one number."""
    path = urdf(tmp_path)
    state = f"<group_state name='home' group='all'><joint name='hinge' value='{value}'/></group_state>"
    path.with_suffix(".srdf").write_text(f"<robot name='it'>{state}</robot>")
    with pytest.raises(ModelError, match=r"it.srdf: joint 'hinge' of the posture 'home': value is "):
        rbd.load_robot(path)
    path.with_suffix(".srdf").write_text(f"<robot name='it'>{state.replace('hinge', 'another')}</robot>")
    if value not in ("1 2", "", " "):
        with pytest.raises(ModelError, match="joint 'another' of the posture 'home': value is "):
            rbd.load_robot(path)


def test_a_posture_of_a_robot_that_is_loaded_otherwise_is_taken(tmp_path: Path) -> None:
    """A base's seven numbers, where the base is welded or has none of that kind; a name that the robot has not."""
    path = urdf(tmp_path)
    joints = "<joint name='root_joint' value='0 0 1 0 0 0 1'/><joint name='hinge' value='0.5'/><joint name='x' value='1'/>"
    path.with_suffix(".srdf").write_text(f"<robot name='it'><group_state name='home'>{joints}</group_state></robot>")
    assert rbd.load_robot(path).posture("home").tolist() == [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.5]
    assert rbd.load_robot(path, root="fixed").posture("home").tolist() == [0.5]
    assert rbd.load_robot(path, root="planar").posture("home")[-1] == 0.5
    path.with_suffix(".srdf").write_text(path.with_suffix(".srdf").read_text().replace("0 0 0 1'", "0 0 0 0'"))
    with pytest.raises(ModelError, match="joint 'root_joint' of the posture 'home' has a zero quaternion"):
        rbd.load_robot(path)


@pytest.mark.parametrize(
    "text", ["offset: nan", "offset: .nan", "offset: .inf", "ratio: 1_0", "ratio: 0x10", "ratio: '2'", "ratio: 1 2"]
)
def test_a_loop_file_is_made_of_numbers(tmp_path: Path, text: str) -> None:
    """Neither YAML's words for infinity nor Python's underscores."""
    path = urdf(tmp_path)
    ratio = "" if "ratio" in text else "ratio: 1, "
    path.with_suffix(".loops.yaml").write_text(f"couplings: [{{name: g, joint: hinge, to: hinge, {ratio}{text}}}]")
    with pytest.raises(ModelError, match="(ratio|offset) of couplings.0. .'g'. is .*; expected a finite number"):
        rbd.load_robot(path)


@pytest.mark.parametrize("mjcf", [False, True])
def test_the_doctor_works_when_the_file_is_gone(tmp_path: Path, mjcf: bool) -> None:
    """What was found when it was loaded, and a note; a copy of the robot knows it too."""
    if mjcf:
        path = tmp_path / "it.xml"
        air = '<option density="1.2"/>'
        weight = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        path.write_text(f'<mujoco>{air}<worldbody><body name="b"><joint name="j"/>{weight}</body></worldbody></mujoco>')
    else:
        path = urdf(tmp_path, dynamics='<dynamics damping="2"/>')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = rbd.load_robot(path)
    before = rbd.doctor(robot)
    path.unlink()
    after = rbd.doctor(robot)
    assert before.warnings and (after.errors, after.warnings) == (before.errors, before.warnings)
    assert after.notes[:-1] == before.notes
    assert after.notes[-1].where == path.name and "no longer there" in str(after)


def test_pinocchio_itself_takes_such_shapes(tmp_path: Path) -> None:
    """Why they are refused here: urdfdom builds a sphere of radius -1 without a word."""
    path = urdf(tmp_path, '<sphere radius="-1"/>')
    model = pin.buildModelFromUrdf(str(path))
    assert pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION).geometryObjects[0].geometry.radius == -1.0
