"""Convex hulls and distances to their edges, by closed forms and by SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from rbd.constraints.convex.polygons import convex_hull, inside_distance

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def area(hull: np.ndarray) -> float:
    """Signed: positive if the corners go round counterclockwise."""
    x, y = hull.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("seed", range(20))
def test_hull_of_a_cloud_is_scipys(seed: int) -> None:
    """Same area and same corners as Qhull's, counterclockwise, none twice."""
    points = np.random.default_rng(seed).normal(size=(3 + seed, 2)) * 10.0 ** (seed % 4 - 1)
    hull, qhull = convex_hull(points), ConvexHull(points)
    assert abs(area(hull) - qhull.volume) < 1e-9 * qhull.volume
    corners = points[qhull.vertices]
    assert {tuple(np.round(p, 12)) for p in hull} == {tuple(np.round(p, 12)) for p in corners}
    assert len(hull) == len(corners)


def test_points_inside_on_edges_and_twice_are_no_corners() -> None:
    """The hull of a square with points inside it, on its edges and repeated corners has four corners."""
    extra = np.array([[1.0, 1.0], [1.0, 0.0], [2.0, 1.0], [0.0, 0.0], [2.0, 2.0]])
    hull = convex_hull(np.vstack([extra, SQUARE]))
    assert sorted(map(tuple, hull)) == sorted(map(tuple, SQUARE))
    assert area(hull) == 4.0


@pytest.mark.parametrize(
    ("points", "corners"),
    [
        (np.zeros((0, 2)), 0),
        ([[1.0, 2.0]], 1),
        ([[1.0, 2.0], [1.0, 2.0]], 1),
        ([[0.0, 0.0], [1.0, 1.0]], 2),
        ([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0], [0.25, 0.25]], 2),
    ],
)
def test_hulls_without_area(points: np.ndarray, corners: int) -> None:
    """No point, one point, and points on a line, whose ends alone are kept."""
    assert len(convex_hull(np.array(points))) == corners


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((1.0, 1.0), 1.0),
        ((0.25, 1.0), 0.25),
        ((1.9, 0.3), 0.1),
        ((1.0, 0.0), 0.0),
        ((2.0, 2.0), 0.0),
        ((3.0, 1.0), -1.0),
        ((1.0, -0.5), -0.5),
        ((5.0, 6.0), -5.0),
        ((-3.0, -4.0), -5.0),
    ],
)
def test_distance_to_the_edge_of_a_square(point: tuple[float, float], distance: float) -> None:
    """Closed form: positive inside, zero on the edge, negative outside, where corners are the nearest points too."""
    assert abs(inside_distance(np.array(point), convex_hull(SQUARE)) - distance) < 1e-15


@pytest.mark.parametrize("seed", range(10))
def test_inside_distance_is_the_least_of_the_half_planes(seed: int) -> None:
    """Inside a convex polygon the nearest edge is the nearest line: Qhull's equations give the same number."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(12, 2))
    hull, equations = convex_hull(points), ConvexHull(points).equations
    for p in rng.normal(size=(50, 2)):
        least = -(equations[:, :2] @ p + equations[:, 2]).max()
        found = inside_distance(p, hull)
        assert (found > 0.0) == (least > 0.0)
        assert abs(found - least) < 1e-12 if least > 0.0 else found <= least + 1e-12


def test_of_a_line_or_a_point_everything_is_outside() -> None:
    """Two feet on points: the distance to the segment between them, with a minus sign; none of no contact."""
    line = convex_hull(np.array([[0.0, 0.0], [0.0, 2.0]]))
    assert inside_distance(np.array([3.0, 1.0]), line) == -3.0
    assert inside_distance(np.array([0.0, 1.0]), line) == 0.0
    assert inside_distance(np.array([3.0, 6.0]), line) == -5.0
    assert inside_distance(np.array([3.0, 4.0]), np.zeros((1, 2))) == -5.0
    assert inside_distance(np.zeros(2), np.zeros((0, 2))) == -math.inf
