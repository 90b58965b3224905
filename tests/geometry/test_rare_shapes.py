"""Shapes and mesh files that are rare: cones, eggs, hulls, thin feet, numbers without bounds, transforms of Collada."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.convex.convex_shapes import convex_shape
from rbd.errors import ModelError, ModelWarning
from rbd.model.input_files import check_mesh, check_scale, find_mesh
from rbd.robots.feet import flat_underside
from rbd.visual.robot_meshes import read_collada

IDENTITY = pin.SE3.Identity()


def hull_of(points: np.ndarray) -> coal.ConvexBase:
    """A convex of coal's with these corners."""
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(0, len(points))
    mesh.addVertices(points)
    mesh.endModel()
    mesh.buildConvexHull(True, "Qt")
    return mesh.convex


def block(x: float, y: float, z: float) -> np.ndarray:
    """Corners of a box about the origin."""
    return np.array([(a, b, c) for a in (x, -x) for b in (y, -y) for c in (z, -z)])


# ---------------------------------------------------------------------------------------------------------- undersides


@pytest.mark.parametrize(
    ("shape", "lowest"),
    [
        (coal.Cone(0.1, 0.4), -0.2),  # on its rim
        (coal.Cylinder(0.1, 0.4), -0.2),
        (hull_of(block(0.1, 0.2, 0.3)), -0.3),
    ],
)
def test_a_shape_that_stands_flat_gives_its_underside(shape, lowest: float):
    """The corners of what it stands on, at its height; a rim's are 0.1 m from its axis."""
    found = flat_underside([(shape, IDENTITY)], np.eye(3))
    assert found.X_FP.translation[2] == pytest.approx(lowest, abs=1e-12)
    if not isinstance(shape, coal.ConvexBase) or isinstance(shape, coal.Cone | coal.Cylinder):
        assert np.linalg.norm(found.corners[:, :2], axis=1) == pytest.approx(0.1, abs=1e-3)
    else:
        assert np.abs(found.corners[:, :2]).max(axis=0) == pytest.approx([0.1, 0.2], abs=1e-12)


def test_the_lowest_point_of_an_egg_is_its_own():
    """Of x^2/a^2 + y^2/b^2 + z^2/c^2 = 1 turned by 30 degrees: height sqrt(sum (r n)^2); three eggs give a triangle."""
    turn = pin.utils.rotate("x", np.pi / 6.0)
    radii = np.array([0.1, 0.2, 0.3])
    eggs = [(coal.Ellipsoid(*radii), pin.SE3(turn, np.array([x, y, 0.0]))) for x, y in ((0, 0), (1, 0), (0, 1))]
    found = flat_underside(eggs, np.eye(3))
    assert found.X_FP.translation[2] == pytest.approx(-np.linalg.norm(radii * turn[2]), abs=1e-12)
    assert len(found.corners) == 3


def test_a_foot_as_thin_as_a_blade_is_an_edge():
    """A block of a tenth of a millimetre stands on the line along it."""
    found = flat_underside([(hull_of(block(0.1, 5e-5, 0.02)), IDENTITY)], np.eye(3))
    assert len(found.corners) == 2 and np.ptp(found.corners[:, 0]) == pytest.approx(0.2, abs=1e-6)


def test_a_hull_touches_as_the_mesh_it_is_of():
    """Coal's convex of a block has the block's corners; a mesh without vertices has none and is refused."""
    place = pin.SE3(pin.utils.rotate("z", np.pi / 2.0), np.array([1.0, 2.0, 3.0]))  # (x, y, z) comes to (1 - y, 2 + x, 3 + z)
    moved = [1.0, 2.0, 3.0] + block(0.2, 0.1, 0.3)
    for at, expected in ((IDENTITY, block(0.1, 0.2, 0.3)), (place, moved)):
        shape = convex_shape(pin.GeometryObject("hull", 1, 0, at, hull_of(block(0.1, 0.2, 0.3))))
        assert sorted(map(tuple, np.round(shape.vertices, 12).tolist())) == sorted(map(tuple, np.round(expected, 12).tolist()))
    empty = coal.BVHModelOBBRSS()
    with pytest.raises(ModelError, match="is a mesh without vertices"):
        convex_shape(pin.GeometryObject("empty", 1, 0, IDENTITY, empty))


# ----------------------------------------------------------------------------------------------------------- mesh files


@pytest.mark.parametrize("text", ["1 1", "1 1 1 1", "a b c", "1 0 1", "1 nan 1", "1 inf 1", "1 1 1e300", ""])
def test_a_scale_is_three_numbers(text: str):
    """Finite ones, none of them zero."""
    with pytest.raises(ModelError, match="has the scale .*; expected three finite numbers, none of them zero"):
        check_scale(text)
    assert check_scale(None).tolist() == [1.0, 1.0, 1.0] and check_scale("1 -2 0.5").tolist() == [1.0, -2.0, 0.5]


def test_a_mesh_is_a_file_of_the_package_and_of_a_sensible_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """No address of the network; none of gigabytes; none whose materials are elsewhere."""
    with pytest.raises(ModelError, match="begins with 'http'; expected package://, file:// or a path"):
        find_mesh("http://somewhere/a.stl", tmp_path, [tmp_path])
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    inside, outside = tmp_path / "good.obj", tmp_path / "bad.obj"
    inside.write_bytes(b"mtllib skin.mtl\n" + obj)
    outside.write_bytes(b"mtllib ../../secret.mtl\n" + obj)
    check_mesh(inside, [tmp_path])
    with pytest.raises(ModelError, match="names a material file outside the package folders"):
        check_mesh(outside, [tmp_path])
    monkeypatch.setattr("rbd.model.input_files.MOST_BYTES", 10)
    with pytest.raises(ModelError, match="is larger than 0 MiB"):
        check_mesh(inside, [tmp_path])


def test_meshes_as_large_as_a_planet_are_boxes(tmp_path: Path):
    """Coordinates of 1e30 m come from a broken file: a box stands in for it, and that is said."""
    (tmp_path / "huge.obj").write_bytes(b"v 0 0 0\nv 1e30 0 0\nv 0 1e30 0\nv 0 0 1e30\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    shape = '<visual><geometry><mesh filename="huge.obj"/></geometry></visual>'
    arm = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "it.urdf").write_text(
        f'<robot name="it"><link name="base">{arm}{shape}</link><link name="arm">{arm}</link>'
        '<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>'
    )
    robot = rbd.load_robot(tmp_path / "it.urdf", package_dirs=[tmp_path])
    with pytest.warns(ModelWarning, match="huge.obj' has coordinates that are not finite, or above"):
        (shown,) = robot.visual_model.geometryObjects
    assert isinstance(shown.geometry, coal.Box)
    assert shown.geometry.halfSide == pytest.approx([0.5] * 3)  # that of 1 kg and 1 kg m2, at most 1 m


# -------------------------------------------------------------------------------------------------------------- Collada


def scene(transforms: str, faces: str, effect: str = "<effect id='paint'/>", material: str = "red") -> str:
    """A square of four vertices under these transforms, its faces in these words."""
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_effects>{effect}</library_effects>
<library_materials><material id="skin"><instance_effect url="#paint"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{faces}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node>{transforms}<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="{material}" target="#skin"/></technique_common></bind_material></instance_geometry></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


TRIANGLES = (
    '<triangles material="red" count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 2 3</p></triangles>'
)
POLYLIST = (
    '<polylist material="red" count="2"><input semantic="VERTEX" source="#v" offset="0"/>'
    "<vcount>3 4</vcount><p>0 1 2 0 1 2 3</p></polylist>"
)
POLYGONS = '<polygons material="red" count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 3</p></polygons>'
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def read(tmp_path: Path, text: str):
    """The parts of a Collada file."""
    path = tmp_path / "it.dae"
    path.write_text(text)
    return [(part.mesh, part.rgba) for part in read_collada(path)]


@pytest.mark.parametrize(
    ("transforms", "expected"),
    [
        ("", SQUARE),
        ("<translate>1 2 3</translate>", SQUARE + [1, 2, 3]),
        ("<scale>2 3 4</scale>", SQUARE * [2, 3, 4]),
        ("<rotate>0 0 1 90</rotate>", SQUARE @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])),
        ("<translate>1 0 0</translate><scale>2 2 2</scale>", 2 * SQUARE + [1, 0, 0]),  # the last is applied first
        ("<matrix>1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1</matrix>", SQUARE + [5, 6, 7]),
    ],
)
def test_a_node_is_moved_as_its_transforms_say(tmp_path: Path, transforms: str, expected: np.ndarray):
    """In their order, from the outside in."""
    ((mesh, _),) = read(tmp_path, scene(transforms, TRIANGLES))
    assert np.abs(mesh.vertices - expected).max() < 1e-12


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        (TRIANGLES, [[0, 1, 2], [0, 2, 3]]),
        (POLYLIST, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]),
        (POLYGONS, [[0, 1, 2], [0, 2, 3]]),
    ],
)
def test_faces_of_any_number_of_corners_are_fans_of_triangles(tmp_path: Path, faces: str, expected: list):
    """Triangles, lists with their counts, and polygons one by one."""
    ((mesh, color),) = read(tmp_path, scene("", faces))
    assert mesh.faces.tolist() == expected and color is None  # its effect has no colour


def test_a_colour_is_that_of_the_effect(tmp_path: Path):
    """Diffuse; of a list without its counts there is no mesh."""
    effect = "<effect id='paint'><diffuse><color>0.1 0.2 0.3 1</color></diffuse></effect>"
    ((_, color),) = read(tmp_path, scene("", TRIANGLES, effect))
    assert color == (0.1, 0.2, 0.3, 1.0)
    ((_, none),) = read(tmp_path, scene("", TRIANGLES, effect, material="blue"))
    assert none is None
    with pytest.raises(ValueError, match="a <polylist> of a Collada file has no <vcount>"):
        read(tmp_path, scene("", POLYLIST.replace("<vcount>3 4</vcount>", "")).replace("xmlns=", "x="))
