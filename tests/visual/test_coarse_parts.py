"""Pieces of a robot with fewer triangles, for small pictures."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.visual import shapes
from rbd.visual.robot_meshes import coarse, robot_parts
from rbd.visual.shapes import Mesh, clustered


def enclosed(mesh: Mesh) -> float:
    """Volume inside a closed mesh whose triangles face outward [m^3]."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def test_a_clustered_ball_keeps_its_size_with_fewer_triangles():
    """Its box shrinks by less than a cell, its volume by a few per cent, and its triangles still face outward."""
    fine = shapes.revolved([(np.sin(a), -np.cos(a)) for a in np.linspace(0.0, np.pi, 101)], smooth=True, segments=200)
    few = clustered(fine, 0.1)
    assert len(few.faces) < 0.15 * len(fine.faces)
    assert np.ptp(few.vertices, axis=0) == pytest.approx(np.ptp(fine.vertices, axis=0), abs=0.1)
    assert enclosed(few) == pytest.approx(enclosed(fine), rel=0.03)


def test_a_box_larger_than_the_cells_is_not_changed():
    """Corners that lie apart stay where they are, and edges stay sharp: each corner still has a vertex for each side."""
    box = shapes.box(np.array([0.5, 0.4, 0.3]))
    few = clustered(box, 0.05)
    assert len(few.faces) == 12 and len(few.vertices) == 24
    assert enclosed(few) == pytest.approx(0.48)


def test_a_sheet_thinner_than_a_cell_keeps_both_sides():
    """Its two sides fall together; one faces up, one down."""
    few = clustered(shapes.box(np.array([0.5, 0.5, 1e-4])), 0.01)
    a, b, c = (few.vertices[few.faces[:, i]] for i in range(3))
    up = np.cross(b - a, c - a)[:, 2] / 2.0
    assert np.ptp(few.vertices[:, 2]) == pytest.approx(0.0, abs=1e-12)
    assert up[up > 0.0].sum() == pytest.approx(1.0) and up[up < 0.0].sum() == pytest.approx(-1.0)


def test_a_mesh_without_triangles_stays_empty():
    """No vertex, no cell."""
    assert not len(clustered(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), 0.01).faces)


def test_no_point_of_a_coarse_robot_is_far_from_the_robot(talos):
    """Pieces keep their boxes within a cell; a piece that is smaller than a cell is left out."""
    cell = 0.006
    fine = {part.name: part for part in robot_parts(talos)}
    few = coarse(robot_parts(talos), cell)
    assert sum(len(part.mesh.faces) for part in few) < 0.75 * sum(len(part.mesh.faces) for part in fine.values())
    for part in few:
        for side in (np.min, np.max):
            kept, whole = side(part.mesh.vertices, axis=0), side(fine[part.name].mesh.vertices, axis=0)
            assert kept == pytest.approx(whole, abs=cell)
    assert coarse(robot_parts(talos), 10.0) == ()
