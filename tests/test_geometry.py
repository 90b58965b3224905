"""Meshes inside the package folders only, boxes in place of lost ones, and soles from collision shapes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from forked import alone

import rbd
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.errors import FrameNotFound, InputError, ModelError, ModelWarning
from rbd.model.meshes import Geometry, _equivalent_box, load_geometry
from rbd.robots.feet import flat_underside
from rbd.visual.robot_meshes import robot_parts

MM = 1e-3
ROUNDING_M = 1e-12  # Pinocchio and coal keep origins and sizes as doubles

TETRAHEDRON = np.array([[[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
                        [[0, 0, 0], [0, 0, 1], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)  # fmt: skip


def stl(triangles=TETRAHEDRON, count=None) -> bytes:
    """A binary STL."""
    facets = b"".join(bytes(12) + t.astype("<f4").tobytes() + bytes(2) for t in triangles)
    return bytes(80) + (len(triangles) if count is None else count).to_bytes(4, "little") + facets


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
DAE = b"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def urdf(mesh: str, *, more: str = "", inertial: str = "") -> str:
    """A base with a mesh, on which an arm turns."""
    inertial = inertial or '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    shape = f"<geometry>{mesh}</geometry>" if mesh.startswith("<") else f'<geometry><mesh filename="{mesh}"/></geometry>'
    return f"""<robot name="it"><link name="base">{inertial}
<visual><origin xyz="0 0 3"/>{shape}</visual><collision>{shape}</collision>{more}</link>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""


@pytest.fixture
def package(tmp_path) -> Path:
    """A folder with a package that has good meshes, beside a secret one that is not for it."""
    meshes = tmp_path / "ws" / "my_robot" / "meshes"
    meshes.mkdir(parents=True)
    for name, data in {"good.stl": stl(), "good.obj": OBJ, "good.dae": DAE}.items():
        (meshes / name).write_bytes(data)
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "plan.stl").write_bytes(stl())
    return meshes.parent


def load(package: Path, text: str) -> rbd.Robot:
    file = package / "urdf" / "it.urdf"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)
    return rbd.load_robot(file, package_dirs=[package.parent])


def only(geometry: pin.GeometryModel) -> pin.GeometryObject:
    (obj,) = geometry.geometryObjects
    return obj


# Where meshes may be


@pytest.mark.parametrize(
    "name", ["package://my_robot/meshes/good.stl", "package://my_robot/meshes/good.obj", "package://my_robot/meshes/good.dae",
             "../meshes/good.stl", "my_robot/meshes/../meshes/good.stl", "file://{}/meshes/good.stl", "{}/meshes/good.stl"]
)  # fmt: skip
def test_meshes_of_the_package_are_loaded(package, name):
    """By package, by path from the robot's file or from a package folder, and by absolute path."""
    robot = load(package, urdf(name.format(package)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shapes = robot.visual_model, robot.collision_model
    for shape in shapes:
        obj = only(shape)
        assert isinstance(obj.geometry, coal.BVHModelBase) and obj.geometry.num_tris == 4
        assert Path(obj.meshPath) == (package / "meshes" / Path(name).name).resolve()


@pytest.mark.parametrize(
    "name", ["package://../secret/plan.stl", "package://my_robot/../../secret/plan.stl", "../../../secret/plan.stl",
             "file://{}/secret/plan.stl", "{}/secret/plan.stl", "package://my_robot/meshes/link.stl",
             "package://my_robot/away/plan.stl", "package:///{}/secret/plan.stl", "{}/secret/none.stl"]
)  # fmt: skip
def test_a_mesh_outside_the_package_folders_is_not_opened(package, name):
    """Not by dots, not by an absolute path, not through a link to a file or a folder: a box is drawn, and it is said."""
    top = package.parents[1]
    (package / "meshes" / "link.stl").symlink_to(top / "secret" / "plan.stl")
    (package / "away").symlink_to(top / "secret")
    robot = load(package, urdf(name.format(top)))
    with pytest.warns(ModelWarning, match="package_dirs=") as told:
        assert isinstance(only(robot.visual_model).geometry, coal.Box)
    assert "package folders" in str(told[0].message) or "is not there" in str(told[0].message)
    assert name.format(top) in str(told[0].message)
    with pytest.warns(ModelWarning, match="collision geometry of it has boxes in place of 1 mesh"):
        assert isinstance(only(robot.collision_model).geometry, coal.Box)


def test_the_environment_gives_no_other_folders(package, monkeypatch):
    """Pinocchio would look along ROS_PACKAGE_PATH too; only what the robot was loaded with counts."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parents[1]))
    with pytest.warns(ModelWarning, match="package://secret/plan.stl' is not there"):
        assert isinstance(only(load(package, urdf("package://secret/plan.stl")).visual_model).geometry, coal.Box)


def test_a_link_inside_the_packages_is_followed(package):
    """A link that stays inside is no harm."""
    (package / "meshes" / "same.stl").symlink_to(package / "meshes" / "good.stl")
    assert isinstance(only(load(package, urdf("../meshes/same.stl")).visual_model).geometry, coal.BVHModelBase)


def test_another_folder_may_be_given(package):
    """`package_dirs` opens it."""
    file = package / "it.urdf"
    file.write_text(urdf("package://secret/plan.stl"))
    robot = rbd.load_robot(file, package_dirs=[package.parents[1]])
    assert isinstance(only(robot.visual_model).geometry, coal.BVHModelBase)


@pytest.mark.skipif(not sys.platform.startswith("linux") or not Path("/usr/bin/strace").exists(), reason="needs strace")
def test_the_kernel_sees_no_file_opened_outside(package, tmp_path):
    """No call opens the secret mesh, nor the materials that an OBJ names outside."""
    secret = package.parents[1] / "secret"
    (secret / "plan.mtl").write_text("newmtl a\n")
    (package / "meshes" / "evil.obj").write_bytes(b"mtllib ../../../secret/plan.mtl\n" + OBJ)
    more = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        for name in (f"{secret}/plan.stl", "package://my_robot/meshes/evil.obj", "package://my_robot/meshes/good.stl")
    )
    (package / "it.urdf").write_text(urdf("package://../secret/plan.stl", more=more))
    code = f"import rbd; r = rbd.load_robot({str(package / 'it.urdf')!r}, package_dirs=[{str(package.parent)!r}])\n"
    code += "print(len(r.visual_model.geometryObjects), len(r.collision_model.geometryObjects))"
    trace = tmp_path / "trace"
    run = ["/usr/bin/strace", "-f", "-e", "trace=open,openat,openat2,creat", "-o", trace, sys.executable, "-W", "ignore", "-c"]
    done = subprocess.run([*run, code], capture_output=True, text=True, timeout=60)
    if done.returncode and "ptrace" in done.stderr:
        pytest.skip("strace is not permitted here")
    assert done.stdout.split() == ["4", "1"], done.stderr
    opened = trace.read_text()
    assert "good.stl" in opened and str(secret) not in opened and "secret/plan" not in opened


# Meshes that cannot be read

BROKEN = {
    "missing.stl": None,
    "empty.stl": b"",
    "empty.dae": b"",
    "empty.obj": b"",
    "noise.stl": np.random.default_rng(1).bytes(3000),
    "noise.dae": np.random.default_rng(2).bytes(3000),
    "noise.obj": np.random.default_rng(3).bytes(3000),
    "short.stl": stl(count=400_000_000),
    "cut.stl": stl()[:-30],
    "nan.stl": stl(np.full((4, 3, 3), np.nan)),
    "vast.stl": stl(TETRAHEDRON * np.float32(3e38)),
    "words.stl": b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0",
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n",
    "nan.obj": OBJ.replace(b"1 0 0", b"nan 0 0"),
    "cut.dae": DAE[:400],
    "nan.dae": DAE.replace(b"1 0 0 0 1", b"NaN 0 0 0 1"),
    "far.dae": DAE.replace(b"<p>0 2 1", b"<p>0 2 99999999"),
    "doctype.dae": DAE.replace(b"<COLLADA", b"<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA"),
    "endless.ply": b"ply\nformat ascii 1.0\nelement vertex 1000000000\nproperty float x\nend_header\n",
    "folder.stl": "folder",
    "pipe.stl": "pipe",
}


def test_broken_meshes_are_boxes_and_end_nothing(package):
    """Missing, empty, cut, noise, not numbers, a pipe, a format that hangs: one box each, and one warning that names all.

    In a process of its own, lest one ends it.
    """
    for name, data in BROKEN.items():
        file = package / "meshes" / name
        if data == "pipe":
            os.mkfifo(file)
        elif data == "folder":
            file.mkdir()
        elif data is not None:
            file.write_bytes(data)
    shapes = [f'<visual><geometry><mesh filename="../meshes/{name}"/></geometry></visual>' for name in [*BROKEN, "good.stl"]]
    (package / "urdf").mkdir()
    (package / "urdf" / "it.urdf").write_text(urdf('<sphere radius="1"/>', more="".join(shapes)))

    def load() -> tuple[list[str], int, list[str]]:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("ignore")
            robot = rbd.load_robot(package / "urdf" / "it.urdf", package_dirs=[package.parent])
            warnings.simplefilter("always")
            parts = robot_parts(robot)
        shapes = [type(o.geometry).__name__ for o in robot.visual_model.geometryObjects]
        return shapes, len(parts), [str(warning.message) for warning in told]

    shapes, parts, (message,) = alone(load)
    assert (shapes, parts) == (["Sphere", *["Box"] * len(BROKEN), "BVHModelOBBRSS"], len(BROKEN) + 2)
    assert f"boxes in place of {len(BROKEN)} meshes" in message and "load_robot(..., package_dirs=[folder])" in message
    assert "missing.stl' is not there" in message and "more" in message


def unchecked(package: Path, *shapes: str) -> Geometry:
    """The visual geometry of a base with these shapes, of a text that nobody looked at before."""
    robot = load(package, urdf('<sphere radius="1"/>'))
    more = "".join(f"<visual><geometry>{shape}</geometry></visual>" for shape in shapes)
    element = ElementTree.fromstring(urdf('<sphere radius="1"/>', more=more))
    return load_geometry(robot.model, element, robot.urdf, [package.parent], pin.GeometryType.VISUAL)


def test_a_bad_scale_spoils_its_own_shape_alone(package):
    """The same file elsewhere is drawn, also where another file breaks the first pass and all are read anew."""
    (package / "meshes" / "broken.dae").write_bytes(DAE.replace(b"</triangles>", b""))
    good, bad = (f'<mesh filename="../meshes/good.stl" scale="{scale}"/>' for scale in ("1 1 1", "0 1 1"))
    for others, count in (((good, bad), 1), ((bad, good), 1), ((good, bad, '<mesh filename="../meshes/broken.dae"/>'), 2)):
        found = unchecked(package, *others)
        assert f"has boxes in place of {count} mesh" in found.complaint and len(found.stand_ins) == len(others) - 1
        kinds = [type(each.geometry).__name__ for each in found.model.geometryObjects]
        assert kinds == ["Sphere", *("BVHModelOBBRSS" if each == good else "Box" for each in others)]


def test_shapes_that_cannot_be_built_are_left_out_with_the_reason(package):
    """A file of other links than the model's: no mesh is to blame, and nothing is drawn."""
    robot = load(package, urdf("../meshes/good.stl"))
    element = ElementTree.fromstring(urdf("../meshes/good.stl").replace('"base"', '"pedestal"'))
    found = load_geometry(robot.model, element, robot.urdf, [package.parent], pin.GeometryType.VISUAL)
    assert found.model.ngeoms == 0 and re.match("is left out, as it cannot be built: .{5,}[.]$", found.complaint)


def test_a_link_without_an_inertia_gets_a_small_box_too():
    """Nothing tells how large it is; nor do a mass alone, or words."""
    moments = '<inertia ixx="1" iyy="1" izz="{}"/>'
    assert _equivalent_box(None) is None
    for inside in ('<mass value="1"/>', moments.format(1), '<mass value="1"/>' + moments.format("one")):
        assert _equivalent_box(ElementTree.fromstring(f"<inertial>{inside}</inertial>")) is None
    sides = _equivalent_box(ElementTree.fromstring('<inertial><mass value="6"/>' + moments.format(1) + "</inertial>"))
    assert sides == pytest.approx([1.0, 1.0, 1.0])  # a cube of 6 kg and 1 m has m a^2 / 6


def test_a_file_to_repair_is_not_blamed_on_the_folders(package):
    """A mesh that is there but broken: the advice is to repair it."""
    (package / "meshes" / "empty.stl").write_bytes(b"")
    with pytest.warns(ModelWarning, match=r"'../meshes/empty.stl' is empty. Repair"):
        assert load(package, urdf("../meshes/empty.stl")).visual_model.ngeoms == 1


def test_the_box_in_place_of_a_mesh_has_the_inertia_of_its_link(package):
    """A uniform box of sides a, b, c has the moments m (b^2 + c^2) / 12, ...: that box is drawn, where its mass is."""
    a, b, c, m = 0.3, 0.2, 0.1, 2.0
    moments = m / 12.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    inertial = (
        f'<inertial><origin xyz="0.1 0.2 0.3" rpy="0 0 0.5"/><mass value="{m}"/><inertia ixx="{moments[0]}" '
        f'iyy="{moments[1]}" izz="{moments[2]}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    with pytest.warns(ModelWarning):
        box = only(load(package, urdf("package://none/a.stl", inertial=inertial)).visual_model)
    assert np.allclose(2.0 * box.geometry.halfSide, [a, b, c], atol=1e-6)
    assert np.allclose(box.placement.translation, [0.1, 0.2, 0.3])
    assert np.allclose(box.placement.rotation, pin.rpy.rpyToMatrix(0.0, 0.0, 0.5))


@pytest.mark.parametrize("inertia", ["1 1 9", "0 0 0", "-1 -1 -1"])
def test_a_link_with_an_odd_inertia_gets_a_small_box(package, inertia):
    """Five centimetres, in the place of the mesh."""
    xx, yy, zz = inertia.split()
    text = f'<inertial><mass value="1"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}"/></inertial>'
    assert _equivalent_box(ElementTree.fromstring(text)) is None
    more = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    with pytest.warns(ModelWarning):
        box = load(package, urdf("package://none/a.stl", more=more)).visual_model.geometryObjects[0]
    assert np.allclose(box.geometry.halfSide, 0.025) and box.placement.translation[2] == 3.0


@pytest.mark.parametrize("file", ["../../secret/plan.stl", "{}/secret/plan.stl", "meshes/none.stl", "meshes/empty.stl"])
def test_meshes_of_an_mjcf_are_contained_too(package, file):
    """A small box stands in for a mesh that is outside, missing or empty."""
    top = package.parents[1]
    (package / "meshes" / "empty.stl").write_bytes(b"")
    text = f"""<mujoco model="it"><asset><mesh name="a" file="{file.format(top)}"/>
<mesh name="b" file="meshes/good.stl"/></asset>
<worldbody><body name="base"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom type="mesh" mesh="a"/><geom type="mesh" mesh="b"/>
<body name="arm"><joint name="hinge" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
</body></worldbody></mujoco>"""
    path = package / "it.xml"
    path.write_text(text)
    model = pin.buildModelFromMJCF(str(path))
    found = load_geometry(model, ElementTree.fromstring(text), path, [package], pin.GeometryType.VISUAL)
    assert "boxes in place of 1 mesh" in found.complaint
    stand_in, mesh = found.model.geometryObjects
    assert found.stand_ins == {stand_in.name}
    assert 2.0 * stand_in.geometry.halfSide == pytest.approx([0.05] * 3)
    assert mesh.geometry.num_tris == 4


# Soles


def outline(sole) -> np.ndarray:
    """Corners of a sole in the frame's own axes, shape (k, 3)."""
    return np.array([sole.placement.act(corner) for corner in sole.corners])


def reach(one: np.ndarray, other: np.ndarray) -> float:
    """How far the corners of one polygon lie outside another [m]; zero or less when inside."""
    return max(-inside_distance(corner, convex_hull(other)) for corner in one)


def box_foot(xyz="0.03 0 -0.05", rpy="0 0 0", shape='<box size="0.2 0.1 0.02"/>') -> str:
    return urdf('<box size="1 1 1"/>').replace(
        '<collision><geometry><box size="1 1 1"/></geometry></collision>',
        f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>',
    )


def test_a_box_foot_gives_its_own_underside(package):
    """Corners, centre and axes of a box's lower face, exactly; the contact bears the name of its frame."""
    robot = load(package, box_foot())
    (sole,) = robot.soles_from_collision(["base"], friction=0.4, facets=8)
    assert (sole.name, sole.frame, sole.friction, sole.facets) == ("base", "base", 0.4, 8)
    assert np.abs(sole.placement.translation - [0.03, 0.0, -0.06]).max() < ROUNDING_M
    assert np.abs(sole.placement.rotation - np.eye(3)).max() < ROUNDING_M
    assert {tuple(corner) for corner in np.round(sole.corners, 12)} == {(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.05, 0.05)}


def test_down_is_where_the_state_says(package):
    """Lying on its side, the box's side is the sole: the same frame, another face."""
    robot = load(package, box_foot())
    q = robot.neutral()
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(np.pi / 2.0, 0.0, 0.0)).coeffs()  # its -y is down
    (sole,) = robot.soles_from_collision(["base"], at=robot.at(q))
    assert np.abs(sole.placement.translation - [0.03, -0.05, -0.05]).max() < ROUNDING_M
    assert np.abs(sole.placement.rotation[:, 2] - [0.0, 1.0, 0.0]).max() < ROUNDING_M
    assert np.ptp(sole.corners, axis=0) == pytest.approx([0.2, 0.02, 0.0])


@pytest.mark.parametrize("lean", [0.02, -0.2])
def test_a_foot_that_leans_is_still_flat_along_itself(package, lean):
    """The patch leans with the foot, for the robot will be set on it."""
    robot = load(package, box_foot(rpy=f"0 {lean} 0"))
    (sole,) = robot.soles_from_collision(["base"])
    z = pin.rpy.rpyToMatrix(0.0, lean, 0.0)[:, 2]
    assert np.abs(sole.placement.rotation[:, 2] - z).max() < 1e-9
    assert np.ptp(sole.corners, axis=0) == pytest.approx([0.2, 0.1, 0.0])


def test_soles_found_are_those_of_the_catalogue(talos, g1):
    """Talos within 6 mm (its heel bulges beyond the catalogue's rectangle), G1's four balls exactly."""
    for robot, tolerance in ((talos, 6 * MM), (g1, 1e-9)):
        known = robot.soles()
        found = robot.soles_from_collision([sole.frame for sole in known])
        for one, other in zip(known, found, strict=True):
            a, b = outline(one), outline(other)
            assert reach(a[:, :2], b[:, :2]) < tolerance and reach(b[:, :2], a[:, :2]) < tolerance
            assert np.ptp(np.r_[a[:, 2], b[:, 2]]) < min(1 * MM, tolerance)
            assert np.abs(other.placement.rotation - one.placement.rotation).max() < 1e-9


def test_romeos_sole_holds_the_catalogues():
    """The catalogue took four of the mesh's vertices, heel to toe; the hull has the bulge between them too, 17 mm wide."""
    robot = rbd.load_robot("romeo")
    for one, other in zip(robot.soles(), robot.soles_from_collision(["l_sole", "r_sole"]), strict=True):
        a, b = outline(one), outline(other)
        assert reach(a[:, :2], b[:, :2]) < 0.1 * MM and reach(b[:, :2], a[:, :2]) < 18 * MM
        assert abs(np.ptp(a[:, 0]) - np.ptp(b[:, 0])) < 0.1 * MM
        assert np.ptp(np.r_[a[:, 2], b[:, 2]]) < 1 * MM and len(other.corners) <= 8


def test_a_robot_stands_on_the_soles_found(talos):
    """Found soles carry Talos's weight."""
    state = talos.standing()
    held = rbd.hold(state, talos.soles_from_collision(["left_sole_link", "right_sole_link"]))
    assert sum(f[2] for f in held.forces.values()) == pytest.approx(talos.mass * 9.81, rel=1e-9)


def test_round_shapes_give_their_lowest_points():
    """Three balls of other sizes on one plane; a cylinder on its end; a capsule on its side is an edge."""
    balls = [(coal.Sphere(r), pin.SE3(np.eye(3), np.array([x, y, r]))) for r, x, y in ((0.1, 0, 0), (0.2, 1, 0), (0.3, 0, 1))]
    found = flat_underside(balls, np.eye(3))
    assert np.abs(found.corners + found.X_FP.translation[:2] - [[0, 0], [1, 0], [0, 1]]).max() < 1e-9
    assert found.X_FP.translation[2] == pytest.approx(0.0, abs=1e-12)
    drum = flat_underside([(coal.Cylinder(0.1, 0.4), pin.SE3.Identity())], np.eye(3))
    assert np.linalg.norm(drum.corners, axis=1) == pytest.approx(0.1, abs=MM) and drum.X_FP.translation[2] == -0.2
    lying = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.0), np.zeros(3))
    edge = flat_underside([(coal.Capsule(0.1, 0.4), lying)], np.eye(3))
    assert len(edge.corners) == 2 and np.ptp(edge.corners, axis=0).max() == pytest.approx(0.4)
    with pytest.raises(ModelError, match="no collision shape that has points"):
        flat_underside([(coal.Halfspace(np.array([0.0, 0, 1]), 0.0), pin.SE3.Identity())], np.eye(3))


def test_feet_without_a_flat_underside_are_refused_in_words(package):
    """A ball: use a point contact, and here. No collision shape, or only the box in place of a lost mesh: give corners."""
    ball = load(package, box_foot(xyz="0.1 0 0", shape='<sphere radius="0.05"/>'))
    with pytest.raises(ModelError, match=r"touches level ground with a point.*PointContact\(name, 'base'.*\(0.1, 0, -0.05\)"):
        ball.soles_from_collision(["base"])
    with pytest.raises(ModelError, match="'arm' of it: its file gives no collision shape"):
        ball.soles_from_collision(["arm"])
    lost = load(package, urdf("package://none/foot.stl"))
    with pytest.warns(ModelWarning), pytest.raises(ModelError, match="its collision meshes cannot be had"):
        lost.soles_from_collision(["base"])
    go2 = rbd.load_robot("go2")
    with pytest.raises(ModelError, match="with a point"):  # a ball as a mesh
        go2.soles_from_collision(["FL_foot"])


def test_wrong_arguments_are_refused(talos, g1):
    """Names, lists and states are checked."""
    for wrong in ("left_sole_link", None):
        with pytest.raises(InputError, match="expected a list of frames"):
            talos.soles_from_collision(wrong)
    with pytest.raises(FrameNotFound, match="left_sole_link"):
        talos.soles_from_collision(["left_sole_lin"])
    with pytest.raises(InputError, match="expected a State of talos"):
        talos.soles_from_collision(["left_sole_link"], at=g1.at())
    assert talos.soles_from_collision([]) == []
