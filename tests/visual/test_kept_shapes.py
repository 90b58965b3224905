"""Drawn shapes kept on disk: the second page of a robot is the same and reads no mesh; whatever has changed is made anew."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import ModelWarning
from rbd.visual.kept_shapes import CODE
from rbd.visual.robot_layers import collision_parts
from rbd.visual.robot_meshes import EDGE, robot_parts

CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def write_stl(path: Path, size: float) -> None:
    """A tetrahedron of this size."""
    triangles = size * CORNERS[FACES]
    each = [struct.pack("<12fH", 0.0, 0.0, 0.0, *map(float, corners.ravel()), 0) for corners in triangles]
    path.write_bytes(bytes(80) + struct.pack("<I", len(each)) + b"".join(each))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A robot's file with a mesh, and a folder for what is kept."""
    shape = '<geometry><mesh filename="part.stl"/></geometry>'
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    link = f'<link name="body">{mass}<visual>{shape}</visual><collision>{shape}</collision></link>'
    (tmp_path / "one.urdf").write_text(f'<robot name="one">{link}</robot>')
    write_stl(tmp_path / "part.stl", 1.0)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path


def drawn(place: Path) -> str:
    """The page of the robot, loaded anew."""
    robot = rbd.load_robot(place / "one.urdf")
    with rbd.visual.Scene(robot) as scene:
        scene.show(rbd.State(robot, robot.neutral()))
        return scene.page()


def kept(place: Path) -> set[Path]:
    return set((place / "kept").glob("*.shapes"))


def test_the_second_page_is_the_same_and_reads_no_mesh(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Byte by byte; what reads shapes is not called again."""
    first = drawn(place)
    assert len(kept(place)) == 2  # drawn shapes, and those of collision
    monkeypatch.setattr("rbd.robots.body_shapes.load_geometry", None)
    assert drawn(place) == first


def test_a_spoilt_file_is_made_anew(place: Path) -> None:
    """One byte other, cut off, empty, or no file of ours at all: the page is the same, and the file right afterwards."""
    first = drawn(place)
    right = {file: file.read_bytes() for file in kept(place)}
    for spoil in (
        lambda x: x[:-9] + bytes([x[-9] ^ 1]) + x[-8:],
        lambda x: x[: len(x) // 2],
        lambda x: b"",
        lambda x: b"shapes" * 99,
    ):
        for file, data in right.items():
            file.write_bytes(spoil(data))
        assert drawn(place) == first
        assert {file: file.read_bytes()[:32] for file in right} == {file: data[:32] for file, data in right.items()}


def test_another_mesh_under_the_same_name_is_another_robot(place: Path) -> None:
    """Its content counts, not its name or date."""
    first = drawn(place)
    write_stl(place / "part.stl", 2.0)
    second = drawn(place)
    assert second != first
    assert len(kept(place)) == 4
    write_stl(place / "part.stl", 1.0)
    assert drawn(place) == first
    assert len(kept(place)) == 4


def test_other_code_makes_shapes_anew(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What an older version kept has another name, whichever of the modules has changed."""
    drawn(place)
    for n, module in enumerate(CODE, 2):
        (place / module.name).write_bytes(module.read_bytes() + b"#")
        changed = [place / each.name if each == module else each for each in CODE]
        monkeypatch.setattr("rbd.visual.kept_shapes.CODE", tuple(changed))
        drawn(place)
        assert len(kept(place)) == 2 * n


def test_shapes_in_memory_are_drawn_as_they_are(place: Path) -> None:
    """A shape that was added by hand is drawn, and is not kept."""
    drawn(place)
    robot = rbd.load_robot(place / "one.urdf")
    ball = pin.GeometryObject("ball", 1, 0, pin.SE3.Identity(), robot.visual_model.geometryObjects[0].geometry)
    robot.visual_model.addGeometryObject(ball)
    assert [part.name for part in robot_parts(robot)] == ["body_0", "ball"]
    assert [shape.part.link for shape in collision_parts(robot)] == ["body"]
    assert len(kept(place)) == 2


def test_boxes_in_place_of_meshes_are_not_kept(place: Path) -> None:
    """Each page warns of a mesh that cannot be read or is not there."""
    for spoil in (lambda: (place / "part.stl").write_bytes(b"solid nothing"), lambda: (place / "part.stl").unlink()):
        spoil()
        for _ in range(2):
            with pytest.warns(ModelWarning, match="boxes in place of 1 mesh"):
                drawn(place)
        assert not kept(place)


def test_a_missing_mesh_is_an_outline_with_a_name(place: Path) -> None:
    """Of the link's collision shape, a cylinder of 0.3 m and 0.8 m: bars along the edges of the box around it; else a box."""
    file = place / "one.urdf"
    cylinder = '<collision><geometry><cylinder radius="0.3" length="0.8"/></geometry></collision>'
    text = file.read_text().partition("<collision>")[0] + cylinder + "</link></robot>"
    (place / "part.stl").unlink()
    for written, half in ((text, [0.3, 0.3, 0.4]), (file.read_text(), [0.5 * np.sqrt(6.0)] * 3)):
        file.write_text(written)
        robot = rbd.load_robot(file)
        with pytest.warns(ModelWarning, match="boxes in place of 1 mesh"):
            (part,) = robot_parts(robot)
        assert (part.missing, part.link) == (True, "body")
        half = np.minimum(half, 0.5)  # the box of equal inertia has sides of 1 m at most
        thick = EDGE * 2.0 * half.max()
        away = np.abs(np.abs(part.mesh.vertices) - half) < thick + 1e-9
        assert (away.sum(axis=1) >= 2).all()  # on an edge: at the ends of two of the three sides
        assert np.abs(part.mesh.vertices).max(axis=0) == pytest.approx(half + thick, rel=0.05)
        with rbd.visual.Scene(robot) as scene:
            scene.show(rbd.State(robot, robot.neutral()))
            page = scene.page()
        assert "Outlines: the meshes of body are missing." in page
        assert "an outline: its mesh is missing" in page
