"""What is drawn of a robot: meshes, or bones with ellipsoids of inertia where its file has nothing to see."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual.collada import read_collada
from rbd.visual.robot_meshes import inertia_ellipsoids, robot_parts, skeleton

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
