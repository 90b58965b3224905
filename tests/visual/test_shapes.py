"""Triangles: arrows and cones of the right size, shapes of the right volume, Collada files read whole."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.visual import shapes
from rbd.visual.marks import primitives
from rbd.visual.robot_meshes import read_collada

COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><contributor><authoring_tool>{tool}</authoring_tool></contributor>
<unit meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="red-fx"><profile_COMMON><technique sid="c"><lambert>
<diffuse><color>1 0 0 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="red"><instance_effect url="#red-fx"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 100 0 0 100 200 0 0 200 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1" material="paint"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount><p>0 1 2 3</p>
</polylist>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<p>0 0 2 0 3 0</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>0 0 100</translate><instance_geometry url="#g">
<bind_material>
<technique_common><instance_material symbol="paint" target="#red"/>
</technique_common></bind_material></instance_geometry>
</node></visual_scene></library_visual_scenes></COLLADA>"""


def test_an_arrow_of_no_force_is_not_drawn():
    """A zero vector has no direction: nothing to draw, and no division by zero."""
    assert primitives.arrow(np.zeros(3), np.zeros(3), radius=0.01).empty


def test_the_friction_cone_opens_along_the_normal_with_the_right_angle():
    """The rim is at tan(angle) = mu, whatever the normal."""
    axes = shapes.axes_along(np.array([1.0, 2.0, -0.5]))
    around = rbd.problem.FrictionCone(0.6).rim()
    cone = primitives.fan(np.ones(3), 1.0 + 0.2 / np.hypot(1.0, 0.6) * around @ axes.T).points - 1.0
    rim = cone[np.linalg.norm(cone, axis=1) > 1e-9]
    normal = rim @ axes[:, 2]
    assert np.allclose(np.linalg.norm(rim, axis=1), 0.2)
    assert np.allclose(np.linalg.norm(rim - normal[:, None] * axes[:, 2], axis=1) / normal, 0.6)


@pytest.mark.parametrize(
    "mesh, volume",
    [
        (shapes.ball(1.0), 4.0 / 3.0 * np.pi),
        (shapes.box(np.array([1.0, 2.0, 3.0])), 48.0),
        (shapes.cylinder(1.0, 2.0), 2.0 * np.pi),
        (shapes.capsule(1.0, 2.0), 2.0 * np.pi + 4.0 / 3.0 * np.pi),
    ],
    ids=["ball", "box", "cylinder", "capsule"],
)
def test_shapes_enclose_their_volume_with_outward_triangles(mesh, volume):
    """Sum of signed tetrahedra: positive and within the facets' few per cent of the closed form."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(volume, rel=0.03)


def test_sharp_edges_are_split_and_round_ones_are_not():
    """A cube's eight corners become twenty-four; a tube of 32 facets keeps its vertices."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
        + [[1, 5, 7], [1, 7, 3]]
    )
    assert len(shapes.creased(shapes.Mesh(cube, faces)).vertices) == 24
    tube = shapes.revolved([(1.0, 0.0), (1.0, 1.0)], smooth=True)
    assert len(shapes.creased(tube).vertices) == len(tube.vertices) == 64


@pytest.mark.parametrize("tool, top", [("Blender", [1.0, -1.0, 2.0]), ("VCGLib | MeshLab", [1.0, 2.0, 1.0])])
def test_collada_parts_keep_triangles_colours_unit_and_up_axis(tool, top, tmp_path):
    """A 1 x 2 m red quadrangle and one bare triangle, written in centimetres; MeshLab's Y_UP means nothing."""
    file = tmp_path / "part.dae"
    file.write_text(COLLADA.format(tool=tool), encoding="utf-8")
    red, bare = read_collada(file)
    assert red.rgba == (1.0, 0.0, 0.0, 1.0) and bare.rgba is None
    assert red.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and bare.mesh.faces.tolist() == [[0, 2, 3]]
    assert np.allclose(red.mesh.vertices[2], top)


def test_axes_of_no_direction_are_the_worlds():
    """Else the third points along it, and they are a rotation."""
    assert np.array_equal(shapes.axes_along(np.zeros(3)), np.eye(3))
    R = shapes.axes_along(np.array([0.0, 3.0, -4.0]))
    assert np.abs(R[:, 2] - [0.0, 0.6, -0.8]).max() < 1e-15 and np.abs(R.T @ R - np.eye(3)).max() < 1e-15
    assert abs(np.linalg.det(R) - 1.0) < 1e-15


def test_the_outermost_points_reach_as_far_as_all(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch):
    """300 of 5,000 at most, whichever are looked at together: to 2 % of the size as far in any direction as all."""
    points = rng.normal(size=(5000, 3)) * [3.0, 1.0, 0.3]
    few = shapes.outermost(points)
    towards = rng.normal(size=(100, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    reach, of_all = ((towards @ x.T).max(axis=1) for x in (few, points))
    assert len(few) <= 300 and (of_all - reach).max() < 0.02 * of_all.max()
    monkeypatch.setattr(shapes, "_BLOCK", len(points))
    assert np.array_equal(shapes.outermost(points), few)
