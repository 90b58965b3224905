"""Treads under stances: which one, where soles are put on it, what rises beside it; rises over what a step passes."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.motion.repair.treads import Tread, nearest_within, needed_rise, normals_of, part_on, raise_of, sole_points, tilts_of

SOLE = np.array([[0.12, 0.05], [-0.08, 0.05], [-0.08, -0.05], [0.12, -0.05]])
INNER = SOLE.mean(axis=0) + 0.75 * (SOLE - SOLE.mean(axis=0))
STAIRS = rbd.Terrain.stairs(0.1, 0.3, 3)


def on(terrain: rbd.Terrain, x: float, y: float, z: float) -> Tread:
    return Tread.under(terrain, np.array([x, y]), SOLE, INNER, z, 0.0)


def put(tread: Tread, x: float, y: float) -> Array:
    return nearest_within(np.array([x, y]), *tread.rows(SOLE, INNER))


def test_the_nearest_tread_counts():
    """Up or down and along the floor together: a foot between two treads goes to that of its own height."""
    assert on(STAIRS, 0.15, 0.0, 0.1).name == "box 1" and on(STAIRS, 0.15, 0.0, 0.13).name == "box 1"
    assert on(STAIRS, 0.28, 0.0, 0.2).name == "box 2" and on(STAIRS, 0.28, 0.0, 0.1).name == "box 1"
    assert on(STAIRS, 0.28, 0.0, -3.0).plane[0] == 0.0  # none is near: the level that was given
    seam = rbd.Terrain.boxes([(-1, -1, -1), (0, 1, 0)], [(0, -1, -1), (1, 1, 0)])
    x, y = put(on(seam, 0.02, 0.0, 0.0), 0.02, 0.0)
    assert (x, y) == (0.02, 0.0)  # a seam of level pieces is no edge


def test_soles_are_put_inside_edges_and_beside_walls():
    """The inner three quarters inside of an edge that drops, the whole sole beside what rises; nothing moves without need."""
    tread = on(STAIRS, 0.25, 0.0, 0.1)
    x, y = put(tread, 0.25, 0.0)
    assert x + 0.12 == pytest.approx(0.3 - 0.008, abs=1e-9) and y == pytest.approx(0.0, abs=1e-9)  # the riser of box 2
    x, _ = put(tread, 0.03, 0.0)
    assert x + INNER[:, 0].min() == pytest.approx(0.004, abs=1e-9)  # its own front edge
    assert put(tread, 0.15, 0.3).tolist() == [0.15, 0.3]
    beam = rbd.Terrain.boxes([(-1, -0.03, -1), (1, 0.03, 0)])
    narrow = on(beam, 0.0, 0.02, 0.0)
    x, y = put(narrow, 0.0, 0.02)
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-5)  # too narrow: in its middle
    np.testing.assert_allclose(np.abs(part_on(narrow, INNER)[:, 1]), 0.03, atol=1e-9)


def test_a_ramp_rises_where_it_meets_the_floor(rng: np.random.Generator):
    """A sole on the floor stays beside the line at which a half-space rises out of it."""
    up = np.array([-0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    ramp = rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0)), "ramp": rbd.Ground(point=(0.5, 0, 0), normal=up)})
    x, _ = put(on(ramp, 0.42, 0.0, 0.0), 0.42, 0.0)
    assert x + 0.12 == pytest.approx(0.5 - 0.008, abs=1e-6)
    tread = on(ramp, 0.9, 0.0, 0.12)
    np.testing.assert_allclose(tread.normal, up, atol=1e-12)
    planes = rng.normal(0.0, 0.3, (20, 3))
    R, n = tilts_of(planes), normals_of(planes)
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(R[:, :, 2], n, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


def test_the_nearest_point_of_random_rows(rng: np.random.Generator):
    """No point of a fine grid inside of the rows is nearer; rows without a point are missed by no more than at any other."""
    grid = np.array(np.meshgrid(*2 * [np.linspace(-2.0, 2.0, 161)])).reshape(2, -1).T
    empty = 0
    for _ in range(60):
        A = rng.normal(size=(rng.integers(1, 6), 2))
        A /= np.linalg.norm(A, axis=1)[:, None]
        b, p = rng.uniform(-0.6, 0.8, len(A)), rng.uniform(-1.0, 1.0, 2)
        x, off = nearest_within(p, A, b), grid @ A.T - b
        missed = off.max(axis=1)
        if (missed <= 0.0).any():
            assert (A @ x <= b + 1e-6).all()
            assert np.linalg.norm(x - p) <= np.linalg.norm(grid[missed <= 0.0] - p, axis=1).min() + 1e-6
        else:
            empty += (A @ x - b).max() > 1e-5
            assert (A @ x - b).max() <= missed.min() + 1e-5
    assert empty > 3


def test_rises_cover_what_is_needed(rng: np.random.Generator):
    """Nowhere less than needed; nothing at the ends; a step over a board is raised over it by the clearance."""
    u = np.arange(1, 40) / 40
    for _ in range(30):
        need = np.where(np.abs(u - rng.uniform(0.25, 0.75)) < 0.1, rng.uniform(0.0, 0.2), -1.0)
        lift = raise_of(need, u)
        assert (
            (lift >= need - 1e-12).all()
            and lift.max() <= 2.0 * max(need.max(), 0.0) + 1e-12
            and lift[[0, -1]].max() < 0.02 * max(lift.max(), 1e-9)
        )
    assert not raise_of(np.full(39, -0.01), u).any()
    late = raise_of(np.where(u > 0.95, 0.1, -1.0), u)
    assert late.max() <= 0.2 + 1e-12  # what is in the way as the foot lands cannot be passed: it is not thrown into the air
    solid = rbd.Terrain.boxes([(-0.01, -1, 0), (0.01, 1, 0.1)]).solids[0]
    board = rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0)), "board": solid})
    points = sole_points(np.column_stack([SOLE, np.zeros(4)]))
    way = np.column_stack([np.linspace(-0.3, 0.3, 39), np.zeros(39), 0.04 * np.sin(np.pi * u)])
    need = needed_rise(board, way[:, None] + points, np.zeros((39, 3)), u)
    over = (np.abs(way[:, :1] + points[:, 0]) <= 0.01).any(axis=1)
    front, back = way[:, 0] + points[:, 0].max(), way[:, 0] + points[:, 0].min()
    np.testing.assert_array_equal(over, (front >= -0.01) & (back <= 0.01))  # no gap between the points is as wide as the board
    clear = 0.025 * np.minimum(np.minimum(u, 1.0 - u) / 0.12, 1.0)
    np.testing.assert_allclose(need, np.where(over, 0.1 + clear - way[:, 2], -np.inf), atol=1e-12)
