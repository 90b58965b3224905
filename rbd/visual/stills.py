"""`still`: a small picture of a robot in a pose, drawn here, without a browser or a plotting package."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.checked_model import CheckedModel
from rbd.motion.frame_terms import placements
from rbd.robots.robot import Robot
from rbd.visual.marks.terrain import surface_of
from rbd.visual.robot_meshes import drawable, robot_parts
from rbd.visual.style import WRENCH_COLOR

STEP_M = 5e-3
"""Distance of the points by which surfaces are drawn, about [m]."""
FINER = 2
"""Pixels are drawn this many times finer along each side, and averaged."""
SEEN_FROM = (1.0, -0.75, 0.3)
"""Direction from the robot to the camera, in axes that turn with its heading."""
LIGHT = np.array([0.45, -0.35, 0.82])
SHADOW, PAPER = 214.0, 255.0
TREAD, SHADE = (168.0, 80.0), 0.84
"""Grey of terrain: in the dark, and what straight light adds; and what a shadow leaves of it."""
AROUND = 0.25
"""Terrain is drawn this far around the robot [m]."""
LOWER_M = 0.02
"""It is seen from behind where the ground is higher by more than this in front [m]."""
_POINTS: WeakKeyDictionary[Robot, tuple[Array, ...]] = WeakKeyDictionary()


def still(
    robot: CheckedModel,
    q: Array,
    *,
    ground: float | Terrain = 0.0,
    push: Sequence[float] | Array = (0.0, 0.0, 0.0),
    size: int = 200,
) -> bytes:
    """A picture of a robot in a pose from the front, over its shadow, as PNG; with the missing force as an arrow.

    Its surfaces are drawn as points, the nearest in each pixel, in parallel projection; nothing but NumPy is used. Light falls
    straight down: the shadow of a point is on what is under it. Where terrain rises ahead, it is seen from behind.

    Args:
        robot: A robot with meshes, or whatever its file has in their place.
        q: Its configuration.
        ground: Height of the floor [m], or the terrain, which is drawn too.
        push: A force over the weight, in W: an arrow from the base, a metre for the weight.
        size: Pixels along each side.

    Raises:
        InputError: a bare model.
    """
    (R,), (p,) = placements(robot, q[None])
    places, light, color = surface_points(robot, R, p)
    shade = color * (0.45 + 0.6 * light)
    heading = np.arctan2(R[1, 1, 0], R[1, 0, 0])
    turn = np.array([[np.cos(heading), -np.sin(heading), 0.0], [np.sin(heading), np.cos(heading), 0.0], [0.0, 0.0, 1.0]])
    back = turn @ SEEN_FROM / np.linalg.norm(SEEN_FROM)
    if isinstance(ground, Terrain):
        back *= _side(ground, places, back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    arrow = _arrow(p[1], np.asarray(push, float), back)
    if isinstance(ground, Terrain):
        floor, surface = shadow_on(ground, places), _surface(ground, places)
    else:
        floor, surface = (places * [1.0, 1.0, 0.0] + [0.0, 0.0, ground], np.full((len(places), 3), SHADOW), -1e3), None
    groups = [floor, (places, shade, 0.0), (arrow, _rgb(WRENCH_COLOR, len(arrow)), 1e3)]
    groups += [] if surface is None else [surface]
    points = np.concatenate([x for x, _, _ in groups])
    image = np.stack([points @ right, -(points @ up)], axis=1)
    framed = image[: len(points) - (0 if surface is None else len(surface[0]))]
    low, high = framed.min(axis=0), framed.max(axis=0)
    fine = FINER * size
    scale = (fine - 8.0) / max((high - low).max(), 1e-6)
    at = np.floor((image - 0.5 * (low + high)) * scale + 0.5 * fine).astype(int)
    depth = points @ back + np.concatenate([np.full(len(x), z) for x, _, z in groups])
    colors = np.concatenate([each for _, each, _ in groups]).clip(0.0, 255.0)
    inside = ((at >= 0) & (at < fine)).all(axis=1)
    at, depth, colors = at[inside], depth[inside], colors[inside]
    order = np.argsort(depth)
    at, nearest = at[order], np.full(fine * fine, -1)
    wide = max(int(np.ceil(STEP_M * scale)), 1)  # of a point's square [fine pixels], so that surfaces have no holes
    for dx in range(wide):
        for dy in range(wide):
            last = np.full(fine * fine, -1)  # of several points in a pixel the last is kept
            last[(at[:, 1] + dy).clip(0, fine - 1) * fine + (at[:, 0] + dx).clip(0, fine - 1)] = np.arange(len(at))
            nearest = np.maximum(nearest, last)
    picture = np.vstack([colors[order], np.full((1, 3), PAPER)])[nearest]
    return _png(picture.reshape(size, FINER, size, FINER, 3).mean(axis=(1, 3)).round().astype(np.uint8))


_Points: TypeAlias = tuple[Array, Array, float]
"""Places in W, shape (k, 3) [m]; colours, shape (k, 3); and by how much nearer to the camera they count [m]."""


def shadow_on(terrain: Terrain, places: Array) -> _Points:
    """The shadows of points, shape (k, 3), on what is under each of them; of those with nothing under them none."""
    heights = terrain.heights_of(places)
    under = np.isfinite(heights)
    floor = places[under] - heights[under, None] * [0.0, 0.0, 1.0]
    grounds = np.full((len(floor), 3), SHADE * sum(TREAD))
    return floor, grounds, 2.0 * STEP_M


def _side(terrain: Terrain, places: Array, back: Array) -> Array:
    """Signs by which a direction to the camera points to where the ground is lower: from behind where it rises ahead."""
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    spots = middle + np.outer([1.0, -1.0], 2.0 * AROUND * back) * [1.0, 1.0, 0.0]
    ahead, behind = spots[:, 2] - terrain.heights_of(spots)
    return np.array([-1.0, -1.0, 1.0] if ahead > behind + LOWER_M else [1.0, 1.0, 1.0])


def _surface(terrain: Terrain, places: Array) -> _Points:
    """Points on a terrain around a robot."""
    mesh = surface_of(terrain, places.min(axis=0) - AROUND, places.max(axis=0) + AROUND, 0.5 * AROUND)
    points, normals = _on_part(mesh.vertices[mesh.faces], 0.7 * STEP_M)  # nothing behind it fills holes
    dark, more = TREAD
    return points, np.tile(dark + more * _lit(normals), 3), 0.0


def _lit(normals: Array) -> Array:
    """How straight light falls on surfaces, on either side, 0 to 1, shape (k, 1)."""
    return np.asarray(np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT))))[:, None]


def surface_points(robot: CheckedModel, R: Array, p: Array) -> tuple[Array, Array, Array]:
    """(place in W [m], light 0 to 1, colour) of points on a robot's surfaces, its joints at (R, p), of `placements`."""
    joint, local, normal, color = _points(drawable(robot))
    light = _lit(np.matmul(R[joint], normal[:, :, None])[..., 0])
    return np.matmul(R[joint], local[:, :, None])[..., 0] + p[joint], light, color


def _points(robot: Robot) -> tuple[Array, ...]:
    """(joint, place in its axes, normal, colour) of points on the surfaces of a robot."""
    if robot not in _POINTS:
        rows = [_on_part(part.mesh.vertices[part.mesh.faces]) for part in robot_parts(robot)]
        frames = [(part.placement.rotation, part.placement.translation) for part in robot_parts(robot)]
        sizes = [len(places) for places, _ in rows]
        _POINTS[robot] = (
            np.repeat([part.joint for part in robot_parts(robot)], sizes),
            np.concatenate([places @ R.T + p for (places, _), (R, p) in zip(rows, frames, strict=True)]),
            np.concatenate([normals @ R.T for (_, normals), (R, _) in zip(rows, frames, strict=True)]),
            np.concatenate([_rgb(part.color, n) for part, n in zip(robot_parts(robot), sizes, strict=True)]),
        )
    return _POINTS[robot]


def _on_part(corners: Array, step: float = STEP_M) -> tuple[Array, Array]:
    """(points about `step` apart on triangles (n, 3, 3), their normals): centres of small ones, more on large ones."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    normal = across / np.maximum(2.0 * area, 1e-12)[:, None]
    draw = np.random.default_rng(0)
    many = np.floor(area / (0.5 * step**2) + draw.random(len(area))).astype(int)  # tiny ones now and then
    i = np.repeat(np.arange(len(area)), many)
    u, v = draw.random((2, len(i), 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a, b, c = corners[i].swapaxes(0, 1)
    return a + u * (b - a) + v * (c - a), normal[i]


def _arrow(start: Array, push: Array, back: Array) -> Array:
    """Points of an arrow of a force over the weight."""
    length = float(np.linalg.norm(push))
    if length < 0.02:
        return np.zeros((0, 3))
    along = push / length
    side = np.cross(back, along)
    side /= max(float(np.linalg.norm(side)), 1e-9)
    s, w = (x.ravel() for x in np.meshgrid(np.linspace(0.0, 1.0, 400), np.linspace(-1.0, 1.0, 25)))
    head = np.minimum(0.12 / min(length, 1.0), 0.5)
    width = np.where(s > 1.0 - head, 0.04 * (1.0 - s) / head, 0.01)
    return np.asarray(start + np.outer(s * min(length, 1.0), along) + np.outer(w * width, side))


def _rgb(color: str, n: int) -> Array:
    return np.tile([float(int(color[i : i + 2], 16)) for i in (1, 3, 5)], (n, 1))


def _png(pixels: Array) -> bytes:
    """A picture of bytes, shape (height, width, 3), as a PNG file."""
    height, width, _ = pixels.shape
    rows = np.hstack([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)]).tobytes()
    parts = (b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")
    chunks = (struct.pack(">I", len(x)) + kind + x + struct.pack(">I", zlib.crc32(kind + x)) for kind, x in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)
