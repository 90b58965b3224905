"""Outlines, round parts, hulls of meshes, and the few points that stand for many."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from rbd.constraints.convex.closest_points import meeting
from rbd.constraints.convex.convex_shapes import ConvexShape, RoundPart, ball, convex_shape, rim, spread
from rbd.constraints.convex.polygons import MOST_POINTS, across, convex_hull, inside, on_edge, outline, overlap
from rbd.errors import ModelError

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def shape_of(geometry: coal.CollisionGeometry, placement: pin.SE3 | None = None) -> ConvexShape:
    """A shape of joint 1."""
    return convex_shape(pin.GeometryObject("shape", 1, 0, pin.SE3.Identity() if placement is None else placement, geometry))


def mesh_of(points: np.ndarray) -> coal.BVHModelBase:
    """A mesh with these vertices."""
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(0, len(points))
    mesh.addVertices(points)
    mesh.endModel()
    return mesh


def test_an_outline_is_the_convex_hull(rng):
    """The same corners as `rbd.constraints.convex.polygons.convex_hull`, and only them; of one place one, of a line two."""
    for _ in range(20):
        points = rng.normal(size=(15, 2))
        corners = points[outline([tuple(p) for p in points.tolist()])]
        assert {tuple(p) for p in np.round(corners, 12)} == {tuple(p) for p in convex_hull(points)}
    assert len(outline([(0.0, 0.0), (1e-10, 0.0)])) == 1
    assert outline([(0.0, 0.0), (2.0, 2.0), (1.0, 1.0)]) == [0, 1]


def test_the_overlap_of_two_outlines():
    """Shifted squares share a square; a line is cut; parallel lines share a stretch; lines that cross, nothing."""
    shifted = [(x + 0.5, y + 0.25) for x, y in SQUARE]
    assert {(round(x, 12), round(y, 12)) for x, y in overlap(SQUARE, shifted)} == {
        (0.5, 0.25), (1.0, 0.25), (1.0, 1.0), (0.5, 1.0),
    }  # fmt: skip
    line = [(-1.0, 0.5), (0.25, 0.5)]
    assert sorted(set(overlap(line, SQUARE))) == sorted(set(overlap(SQUARE, line))) == [(0.0, 0.5), (0.25, 0.5)]
    assert overlap([(0.0, 0.0), (2.0, 0.0)], [(1.0, 0.0), (3.0, 0.0)]) == [(1.0, 0.0), (2.0, 0.0)]
    assert overlap([(0.0, 0.0), (2.0, 0.0)], [(1.0, -1.0), (1.0, 1.0)]) == []
    assert overlap(SQUARE, [(x + 2.0, y) for x, y in SQUARE]) == []


def test_inside_and_on_the_edge():
    """The middle is inside; the edge is not, and says its number."""
    assert inside((0.5, 0.5), SQUARE) and not inside((1.0, 0.5), SQUARE) and not inside((0.5, 0.5), SQUARE[:2])
    assert on_edge((2.0, 0.0), SQUARE) == on_edge((-0.5, 1.0), SQUARE) == -1  # on the line of an edge, beyond its end
    assert [on_edge(p, SQUARE) for p in ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5), (0.5, 0.5))] == [0, 1, 2, 3, -1]


@pytest.mark.parametrize(
    "part",
    [
        ball(np.array([0.1, 0.2, 0.3]), 0.4),
        rim(np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.0, 0.8]), 0.4, 0),
        RoundPart(np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.3])),
    ],
)
def test_the_lowest_point_wanders_as_its_derivative(part, rng):
    """`wander` is the derivative of `lowest` along a turn of `up`, by central differences."""
    for _ in range(5):
        up = rng.normal(size=3)
        up /= np.linalg.norm(up)
        w = rng.normal(size=3)
        rate = np.cross(w, up)
        ahead, behind = (part.lowest(pin.exp3(sign * 1e-5 * w) @ up) for sign in (1.0, -1.0))
        assert np.abs((ahead - behind) / 2e-5 - part.wander(up, rate)).max() < 1e-8


def test_a_mesh_is_its_convex_hull(rng):
    """Points inside are dropped, faces point outwards, and Coal measures from the same hull."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    points = np.vstack([corners, rng.uniform(0.1, 0.9, (50, 3))])
    shape = shape_of(mesh_of(points), pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.5, 0.0, 0.0])))
    assert len(shape.vertices) == 8 and len(shape.faces) == 6
    assert (shape.vertices @ shape.faces[:, :3].T <= shape.faces[:, 3] + 1e-12).all()
    ball = shape_of(coal.Sphere(0.1))
    centre = shape.vertices.mean(axis=0)
    met = meeting(ball, pin.SE3(np.eye(3), centre + shape.faces[0, :3] * 0.65), shape, pin.SE3.Identity(), 1.0)
    assert met is not None and abs(met.crossings[0].gap - 0.05) < 1e-12
    assert np.abs(met.normal - shape.faces[0, :3]).max() < 1e-12


def test_a_flat_mesh_touches_with_its_corners():
    """A sheet has no hull with a volume: its points stay."""
    points = np.array([(x, y, 0.0) for x in (0, 1) for y in (0, 1)], float)
    shape = shape_of(mesh_of(points))
    assert len(shape.low(np.array([0.0, 0.0, 1.0]), 0.1)[0]) == 4 and len(shape.faces) == 0


@pytest.mark.parametrize("lean", [0.0, 1e-4])
def test_a_sheet_lies_on_a_box_with_its_corners(lean):
    """Turned about y by an angle, 1 mm above: each gap is that of its corner, x tan(lean) from the middle's."""
    sheet = shape_of(mesh_of(np.array([(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])))
    X = pin.SE3(pin.rpy.rpyToMatrix(0.0, lean, 0.0), np.array([0.0, 0.0, 0.501]))
    found = meeting(sheet, X, shape_of(coal.Box(1.0, 1.0, 1.0)), pin.SE3.Identity(), 0.01)
    assert found is not None and np.abs(found.normal - [0.0, 0.0, 1.0]).max() < 1e-3 and len(found.crossings) == 4
    for crossing in found.crossings:
        x = crossing.position[0]
        assert abs(abs(x) - 0.1) < 1e-6 and abs(crossing.gap - (1e-3 - x * np.tan(lean))) < 1e-9


def test_shapes_far_apart_do_not_meet():
    """Half a metre is more than a margin of 0.4 m, and less than one of 0.6 m."""
    one, other = shape_of(coal.Box(1.0, 1.0, 1.0)), shape_of(coal.Sphere(0.1))
    above = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.1]))
    assert meeting(other, above, one, pin.SE3.Identity(), 0.4) is None
    near = meeting(other, above, one, pin.SE3.Identity(), 0.6)
    assert near is not None and [c.gap for c in near.crossings] == pytest.approx([0.5], abs=1e-9)


def test_a_coin_that_lies_flat_has_no_lowest_point_that_wanders():
    """All of its rim is equally low."""
    coin = rim(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.4, 0)
    up, rate = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.2, 0.0])
    assert np.isnan(coin.lowest(up)).all() and coin.wander(up, rate).tolist() == [0.0, 0.0, 0.0] and not coin.stands(up)


SOLIDS = [coal.Box(0.2, 0.3, 0.1), coal.Cylinder(0.1, 0.4), coal.Cone(0.1, 0.4), coal.Capsule(0.1, 0.4)]


@pytest.mark.parametrize("geometry", [*SOLIDS, coal.Ellipsoid(0.1, 0.2, 0.3)])
def test_the_ball_around_a_shape_holds_all_of_it(geometry, rng):
    """No point of a shape is farther from `centre` than `reach`, in any direction."""
    shape = shape_of(geometry, pin.SE3.Random())
    for _ in range(50):
        up = rng.normal(size=3)
        up /= np.linalg.norm(up)
        assert shape.lowest(up) >= shape.centre @ up - shape.reach - 1e-12


def test_the_ball_around_an_egg_beside_a_corner_holds_both():
    """An egg of 0.1, 0.1 and 0.3 m at the origin and a corner 0.5 m along x: the box of both has its middle at x = 0.2.

    The egg's own middle is 0.2 m from there, and no point of it is farther than 0.3 m from that; the corner is at 0.3 m.
    """
    egg, corner = RoundPart(np.zeros(3), np.diag([0.1, 0.1, 0.3])), np.array([[0.5, 0.0, 0.0]])
    shape = ConvexShape("both", 1, corner, (egg,), np.zeros((0, 4)), coal.Sphere(0.5), pin.SE3.Identity())
    assert shape.centre == pytest.approx([0.2, 0.0, 0.0], abs=1e-15)
    top = egg.lowest(np.array([0.0, 0.0, -1.0]))
    assert np.linalg.norm(top - shape.centre) == pytest.approx(np.hypot(0.2, 0.3)) and shape.reach >= np.hypot(0.2, 0.3)
    assert shape.reach == pytest.approx(0.5)


def test_a_plane_is_no_shape():
    """What has no points is refused in words that follow its name."""
    with pytest.raises(ModelError, match="is a Halfspace, which has no points"):
        shape_of(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0))


def test_of_many_points_the_lowest_and_the_outermost_are_chosen(rng):
    """The eight lowest, and the farthest in eight directions; a point far above is not reached by tipping."""
    low = np.column_stack([0.01 * rng.normal(size=(30, 2)), 1e-5 * np.arange(30)])
    feet = np.array([(0.1 * x, 0.1 * y, 0.002) for x in (-1, 1) for y in (-1, 1)])
    rim = np.array([(0.2 * x, 0.2 * y, 0.2) for x in (-1, 1) for y in (-1, 1)])
    points = np.vstack([low, feet, rim])
    chosen = spread(points, points[:, 2], np.array([0.0, 0.0, 1.0])).tolist()
    assert chosen == [*range(8), 30, 31, 32, 33]
    few = points[:MOST_POINTS]
    assert spread(few, few[:, 2], np.array([0.0, 0.0, 1.0])).tolist() == list(range(MOST_POINTS))


def test_a_face_with_many_corners_keeps_eight():
    """A prism with 40 corners above and below: eight of each, evenly apart to one corner; a ball keeps all but at its poles."""
    angles = 2.0 * np.pi * np.arange(40) / 40.0
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(40)])
    prism = shape_of(mesh_of(np.vstack([rim, rim + [0.0, 0.0, 1.0]])))
    assert len(prism.vertices) == 16
    below = prism.vertices[prism.vertices[:, 2] == 0.0]
    corners = np.sort(np.arctan2(below[:, 1], below[:, 0]))
    assert np.diff(corners, append=corners[0] + 2.0 * np.pi).max() < 2.0 * np.pi * (1.0 / 8.0 + 1.0 / 40.0) + 1e-12
    turns = np.linspace(0.1, np.pi - 0.1, 20)
    ball = np.vstack([np.column_stack([np.sin(t) * rim[:, :2], np.full(40, np.cos(t))]) for t in turns])
    assert len(shape_of(mesh_of(ball)).vertices) == 800 - 2 * 32


def test_across_is_a_right_handed_plane(rng):
    """Two unit vectors and n make a rotation."""
    for n in (*np.eye(3), *rng.normal(size=(20, 3))):
        n = n / np.linalg.norm(n)
        R = np.vstack([across(n), n])
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-15 and np.linalg.det(R) > 0.0


def test_boxes_that_overlap_by_rounding_have_a_distance():
    """A box that tips over another's edge: Coal's finest tolerance ends in -1.8e308 m here; the edge is on the box's face."""
    table, brick = shape_of(coal.Box(1.0, 1.0, 0.3)), shape_of(coal.Box(0.2, 0.2, 0.1))
    lean = 1.9215385741250376e-04
    X_1 = pin.SE3(np.eye(3), np.array([1.22719e-14, 0.0, 0.15]))
    X_2 = pin.SE3(pin.rpy.rpyToMatrix(0.0, lean, 0.0), np.array([4.9544572993417824e-01, 0.0, 3.5000088548688102e-01]))
    edge = X_2.actInv(X_1.act(np.array([0.5, 0.0, 0.15])))
    met = meeting(brick, X_2, table, X_1, 1e-3)
    assert met is not None
    assert abs(min(c.gap for c in met.crossings) - (-0.05 - edge[2])) < 1e-11
    assert abs(met.normal @ X_2.rotation[:, 2] - 1.0) < 1e-9


@pytest.mark.parametrize("depth", [1e-12, 1e-9, 3e-8, 1e-6, 1e-4, 1e-2])
def test_the_depth_of_boxes_is_along_the_face_that_is_least_deep(depth):
    """For any small turn about z; not along another face, 0.7 m away, which Coal names at times."""
    table, brick = shape_of(coal.Box(1.0, 1.0, 0.3)), shape_of(coal.Box(0.2, 0.2, 0.1))
    for k in range(20):
        X = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.1 * k), np.array([0.02 * k, 0.1, 0.2 - depth]))
        met = meeting(brick, X, table, pin.SE3.Identity(), 1e-3)
        assert met is not None and abs(met.normal[2] - 1.0) < 1e-9
        assert abs(min(c.gap for c in met.crossings) + depth) < 1e-12
