"""What is drawn of a robot: meshes, or bones with ellipsoids of inertia where its file has nothing to see."""

from __future__ import annotations

import re
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import ModelWarning
from rbd.visual.robot_meshes import inertia_ellipsoids, read_collada, robot_parts, skeleton, triangles

ARM = """<robot name="arm"><link name="base"/><link name="bar">{shape}<inertial><origin xyz="0.2 0 0" rpy="0 0 0.4"/>
<mass value="3"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="bar"/><child link="tip"/><origin xyz="1 0 0"/></joint></robot>"""


def arm(tmp_path, moments, shape=""):
    """A bar that turns about z, 1 m long."""
    xx, yy, zz = moments
    (tmp_path / "arm.urdf").write_text(ARM.format(xx=xx, yy=yy, zz=zz, shape=shape))
    return rbd.load_robot(tmp_path / "arm.urdf", root="fixed")


def test_an_ellipsoid_has_the_inertia_of_its_body(tmp_path):
    """A uniform ellipsoid has the moments m (b^2 + c^2) / 5, ...: the one drawn has those semi-axes, at the mass's place."""
    a, b, c = 0.4, 0.2, 0.1
    robot = arm(tmp_path, 3.0 / 5.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b]))
    (part,) = inertia_ellipsoids(robot.model)
    vertices = part.mesh.placed(part.placement.rotation, part.placement.translation).vertices
    own = (vertices - [0.2, 0.0, 0.0]) @ pin.rpy.rpyToMatrix(0.0, 0.0, 0.4)  # in the inertia's own axes
    # The ball's grid does not hit every axis: its vertices lie on the ellipsoid, and reach its poles within 1 %.
    assert ((own / [a, b, c]) ** 2).sum(axis=1) == pytest.approx(1.0)
    assert np.abs(own).max(axis=0) == pytest.approx([a, b, c], rel=0.01)
    assert np.linalg.det(part.placement.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("moments", [(1.0, 1.0, 9.0), (1e9, 1e9, 1e9), (1e-12, 1e-12, 1e-12), (0.0, 0.0, 1.0)])
def test_an_inertia_that_no_body_has_breaks_nothing(tmp_path, moments):
    """Finite, no longer than 0.7 of the bone, no thinner than a hundredth of it."""
    for part in inertia_ellipsoids(arm(tmp_path, moments).model):
        size = np.abs(part.mesh.vertices).max(axis=0)
        assert np.isfinite(part.mesh.vertices).all() and size.max() <= 0.7 and size.min() >= 0.0099


def test_massless_bodies_have_no_ellipsoid(talos):
    """Human has 19 bodies without mass: bones, and no ellipsoids."""
    human = rbd.load_robot("human").model
    masses = [inertia.mass for inertia in human.inertias[1:]]
    assert len(inertia_ellipsoids(human)) <= sum(mass > 0.0 for mass in masses) < len(masses)
    assert len(inertia_ellipsoids(talos.model)) == talos.model.njoints - 1  # 5 links have moments that no body has


def test_a_robot_without_visuals_is_bones_ellipsoids_and_glass(tmp_path):
    """A skeleton with ellipsoids, and the collision shapes where there are any, seen through."""
    bare = robot_parts(arm(tmp_path, (0.1, 0.1, 0.1)))
    assert [part.name for part in bare] == ["hinge", "inertia of hinge"]
    assert len(skeleton(arm(tmp_path, (0.1, 0.1, 0.1)).model)) == 1
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    parts = robot_parts(arm(tmp_path, (0.1, 0.1, 0.1), ball))
    assert [part.name for part in parts] == ["hinge", "inertia of hinge", "bar_0"] and parts[-1].opacity < 0.5


def test_collada_with_vertices_that_are_not_there_is_refused(tmp_path):
    """Numbers beyond the list, below zero or no numbers would draw nonsense or end in an IndexError later."""
    text = """<COLLADA><library_visual_scenes><visual_scene><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><geometry id="g"><mesh><source id="p"><float_array>0 0 0 1 0 0 0 1 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>{}</p></triangles></mesh></geometry></COLLADA>"""
    (tmp_path / "a.dae").write_text(text.format("0 1 2"))
    assert len(read_collada(tmp_path / "a.dae")[0].mesh.faces) == 1
    for numbers in ("0 1 3", "0 1 -1", "0 1 nan"):
        (tmp_path / "a.dae").write_text(text.format(numbers))
        with pytest.raises(ValueError, match="not among its 3"):
            read_collada(tmp_path / "a.dae")


CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])


def hull_of(points: np.ndarray) -> coal.Convex:
    """A convex shape of these points, without faces of its own."""
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex(vertices, coal.StdVec_Triangle())


@pytest.mark.parametrize(
    ("geometry", "volume", "size"),
    [
        (coal.Sphere(0.5), 4.0 / 3.0 * np.pi * 0.5**3, (1.0, 1.0, 1.0)),
        (coal.Ellipsoid(0.1, 0.2, 0.3), 4.0 / 3.0 * np.pi * 0.1 * 0.2 * 0.3, (0.2, 0.4, 0.6)),
        (coal.Box(1.0, 2.0, 3.0), 6.0, (1.0, 2.0, 3.0)),
        (coal.Cylinder(0.5, 2.0), np.pi * 0.5**2 * 2.0, (1.0, 1.0, 2.0)),
        (coal.Capsule(0.5, 2.0), np.pi * 0.5**2 * 2.0 + 4.0 / 3.0 * np.pi * 0.5**3, (1.0, 1.0, 3.0)),
        (coal.Cone(0.5, 2.0), np.pi * 0.5**2 * 2.0 / 3.0, (1.0, 1.0, 2.0)),
        (hull_of(CORNERS), 6.0, (1.0, 2.0, 3.0)),
    ],
    ids=lambda x: type(x).__name__ if isinstance(x, coal.CollisionGeometry) else "",
)
def test_each_kind_of_shape_is_drawn_as_large_as_it_is(geometry, volume, size):
    """Its triangles face outward, and enclose its volume up to the facets' few per cent."""
    mesh = triangles(geometry)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(size, rel=0.01)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(volume, rel=0.03)


@pytest.mark.parametrize("geometry", [coal.Plane(np.array([0.0, 0.0, 1.0]), 0.0), hull_of(CORNERS[CORNERS[:, 0] == 0.0])])
def test_what_has_no_triangles_has_none(geometry):
    """Infinite planes, and hulls of points in a plane."""
    assert triangles(geometry) is None


def test_a_shape_that_cannot_be_drawn_is_named_and_the_rest_is_drawn(tmp_path):
    """A cloud of points among a robot's visuals; an infinite floor is left out in silence."""
    robot = arm(tmp_path, (0.1, 0.1, 0.1), '<visual><geometry><box size="1 1 1"/></geometry></visual>')
    cloud = coal.BVHModelOBBRSS()
    cloud.beginModel(0, 8)
    cloud.addVertices(CORNERS)
    cloud.endModel()
    floor = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    for name, geometry in (("dust", cloud), ("floor", floor)):
        robot.visual_model.addGeometryObject(pin.GeometryObject(name, 1, 0, pin.SE3.Identity(), geometry))
    with pytest.warns(ModelWarning, match=r"geometry 'dust' .BVHModelOBBRSS. has no triangles and is not drawn"):
        parts = robot_parts(robot)
    assert [part.name for part in parts] == ["bar_0"]


def test_a_point_mass_has_no_ellipsoid(tmp_path):
    """Of no moments at all there are no axes to draw."""
    assert inertia_ellipsoids(arm(tmp_path, (0.0, 0.0, 0.0)).model) == []


def test_an_empty_part_of_a_collada_file_is_passed_over(tmp_path):
    """A colour without triangles, beside one that has one; the URDF's scale counts."""
    red = '<effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse><color>1 0 0 1</color></diffuse></lambert>'
    red = f"<library_effects>{red}</technique></profile_COMMON></effect></library_effects>"
    red += '<library_materials><material id="red"><instance_effect url="#e"/></material></library_materials>'
    bound = '<technique_common><instance_material symbol="paint" target="#red"/></technique_common>'
    names = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    corners = '<float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array>'
    corners += f'<technique_common><accessor source="#pa" count="3" stride="3">{names}</accessor></technique_common>'
    of = '<input semantic="VERTEX" source="#v" offset="0"/>'
    (tmp_path / "two.dae").write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/>'
        f"<up_axis>Z_UP</up_axis></asset>{red}<library_geometries>"
        f'<geometry id="g"><mesh><source id="p">{corners}</source><vertices id="v"><input semantic="POSITION" source="#p"/>'
        f'</vertices><triangles count="0" material="paint">{of}<p></p></triangles><triangles count="1">{of}<p>0 1 2</p>'
        '</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>'
        f'<instance_geometry url="#g"><bind_material>{bound}</bind_material></instance_geometry></node>'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    assert [len(piece.mesh.faces) for piece in read_collada(tmp_path / "two.dae")] == [0, 1]
    mesh = '<visual><geometry><mesh filename="two.dae" scale="2 3 4"/></geometry></visual>'
    (part,) = robot_parts(arm(tmp_path, (0.1, 0.1, 0.1), mesh))
    assert len(part.mesh.faces) == 1 and np.ptp(part.mesh.vertices, axis=0).tolist() == [2.0, 3.0, 0.0]


def test_the_skeleton_of_a_closed_chain_has_all_its_bars(tmp_path):
    """Of a six-bar without visual shapes: each body reaches the points where loops are closed; a bar joins the pivots."""
    urdf = Path(__file__).parents[2] / "urdf"
    text = re.sub(r"<visual>.*?</visual>", "", (urdf / "six_bar.urdf").read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "bare.loops.yaml").write_text((urdf / "six_bar.loops.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    robot = rbd.load_robot(tmp_path / "bare.urdf")
    bones = {part.joint: part.mesh.vertices for part in robot_parts(robot) if part.opacity == 1.0}
    assert sorted(bones) == list(range(robot.model.njoints))
    thick = 0.02 * max(float(np.ptp(points, axis=0).max()) for points in bones.values())
    for loop in robot.loops():
        for frame in (loop.frame_a, loop.frame_b):
            joint, X_JF = robot.site(frame)
            assert np.linalg.norm(bones[joint] - X_JF.translation, axis=1).min() <= 2.0 * thick
    pivots = [robot.model.jointPlacements[j].translation for j in range(1, robot.model.njoints) if not robot.model.parents[j]]
    assert len(pivots) == 3
    for pivot in pivots:
        assert np.linalg.norm(bones[0] - pivot, axis=1).min() <= 2.0 * thick
