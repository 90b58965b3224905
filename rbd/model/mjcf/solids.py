"""Mass, centre of mass and moments of inertia of MJCF's shapes, for a density of one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array

_THIN = 1e-6
"""Thickness of an ellipsoid's shell [m], for which there is no closed form."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A body: mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m2], in the same axes.

    Of density one the mass is the volume [m3], or of a shell the area [m2].
    """

    mass: float
    centre: Array
    inertia: Array

    def scaled(self, factor: float) -> Solid:
        """The same of another density."""
        return Solid(self.mass * factor, self.centre, self.inertia * factor)

    def placed(self, R: Array, p: Array) -> Solid:
        """In other axes: R (3, 3) rotates its axes into them, p (3,) is the position of its origin."""
        return Solid(self.mass, p + R @ self.centre, R @ self.inertia @ R.T)


def joined(solids: list[Solid]) -> Solid:
    """Several combined, in common axes; zero if there are none."""
    mass = sum(solid.mass for solid in solids)
    if mass == 0.0:
        return Solid(0.0, solids[0].centre if len(solids) == 1 else np.zeros(3), np.zeros((3, 3)))
    centre = sum((solid.mass * solid.centre for solid in solids), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for solid in solids:
        arm = solid.centre - centre
        inertia += solid.inertia + solid.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Solid(mass, centre, inertia)


def shape_solid(kind: str, size: Array, *, shell: bool = False) -> Solid:
    """A sphere, capsule, cylinder, ellipsoid or box about its origin, axis along z.

    Args:
        kind: Which.
        size: Radius; radius and half length; three half lengths [m].
        shell: Whether only its surface weighs.
    """
    mass, moments = (_shell if shell else _full)(kind, size)
    return Solid(mass, np.zeros(3), np.diag(moments))


def _full(kind: str, size: Array) -> tuple[float, list[float]]:
    r = size[0]
    if kind == "sphere":
        mass = 4.0 / 3.0 * math.pi * r**3
        return mass, [0.4 * mass * r * r] * 3
    if kind == "cylinder":
        height = 2.0 * size[1]
        mass = math.pi * r * r * height
        across = mass * (3.0 * r * r + height * height) / 12.0
        return mass, [across, across, mass * r * r / 2.0]
    if kind == "capsule":
        height = 2.0 * size[1]
        ball, tube = 4.0 / 3.0 * math.pi * r**3, math.pi * r * r * height
        across = tube * (3.0 * r * r + height * height) / 12.0
        across += ball * (0.4 * r * r + height * height / 4.0 + 3.0 / 8.0 * height * r)
        return ball + tube, [across, across, tube * r * r / 2.0 + 0.4 * ball * r * r]
    a, b, c = (x * x for x in size)
    mass, share = (4.0 / 3.0 * math.pi, 0.2) if kind == "ellipsoid" else (8.0, 1.0 / 3.0)
    mass *= float(np.prod(size))
    return mass, [share * mass * (b + c), share * mass * (a + c), share * mass * (a + b)]


def _shell(kind: str, size: Array) -> tuple[float, list[float]]:
    r = size[0]
    if kind == "sphere":
        mass = 4.0 * math.pi * r * r
        return mass, [2.0 / 3.0 * mass * r * r] * 3
    if kind == "cylinder":
        height = 2.0 * size[1]
        side, lid = 2.0 * math.pi * r * height, math.pi * r * r
        across = side * (6.0 * r * r + height * height) / 12.0 + 2.0 * lid * (r * r / 4.0 + height * height / 4.0)
        return side + 2.0 * lid, [across, across, side * r * r + lid * r * r]
    if kind == "capsule":
        height = 2.0 * size[1]
        side, ball = 2.0 * math.pi * r * height, 4.0 * math.pi * r * r
        across = side * (6.0 * r * r + height * height) / 12.0
        across += ball * (2.0 / 3.0 * r * r + height * height / 4.0 + height * r / 2.0)
        return side + ball, [across, across, side * r * r + 2.0 / 3.0 * ball * r * r]
    if kind == "ellipsoid":
        (inner, inside), (outer, outside) = _full(kind, size), _full(kind, size + _THIN)
        a, b, c = (x**1.6075 for x in size)
        area = 4.0 * math.pi * ((a * b + b * c + a * c) / 3.0) ** (1.0 / 1.6075)  # Thomsen's, right to 1.1 %
        return area, [area / (outer - inner) * (y - x) for x, y in zip(inside, outside, strict=True)]
    x, y, z = 2.0 * size
    mass = 2.0 * (x * y + y * z + x * z)
    moments = []
    for a, b, c in ((x, y, z), (y, x, z), (z, x, y)):  # about the axis of a
        ends = 2.0 * b * c * (b * b + c * c) / 12.0
        sides = 2.0 * a * b * (b * b / 12.0 + c * c / 4.0) + 2.0 * a * c * (c * c / 12.0 + b * b / 4.0)
        moments.append(ends + sides)
    return mass, moments


def mesh_solid(vertices: Array, faces: Array, kind: str) -> Solid:
    """What a surface of triangles encloses, as MuJoCo counts it.

    Args:
        vertices: Corners (k, 3) [m].
        faces: Indices (m, 3), counter-clockwise as seen from outside.
        kind: "exact" subtracts the volume between the centre and a triangle that faces it; "legacy" adds that too; "shell"
            weighs the surface; "convex" is that of a convex hull, which is given in `faces`.

    Raises:
        ValueError: why there is none.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    areas = np.linalg.norm(normals, axis=1)
    if not areas.sum() > 1e-14:
        raise ValueError("has no surface")
    middle = areas @ corners.mean(axis=1) / areas.sum()
    if kind == "exact":
        _check_orientation(vertices, faces)
    if kind == "shell":
        return Solid(float(areas.sum()), middle, _inertia(np.einsum("f,fij->ij", areas / 12.0, _pairs(corners - middle))))
    volumes = np.einsum("fi,fi->f", corners[:, 0] - middle, normals) / 3.0
    volumes = np.abs(volumes) if kind == "legacy" else volumes
    if not volumes.sum() > 1e-14:
        raise ValueError("encloses no volume, or its triangles face inward; inertia='shell' weighs the surface")
    centre = volumes @ (0.75 * corners.mean(axis=1) + 0.25 * middle) / volumes.sum()
    corners = corners - centre
    around = np.einsum("fi,fi->f", corners[:, 0], normals) / 3.0
    around = np.abs(around) if kind == "legacy" else around
    if not around.sum() > 1e-14:
        raise ValueError("encloses no volume")
    return Solid(float(around.sum()), centre, _inertia(np.einsum("f,fij->ij", around / 20.0, _pairs(corners))))


def _check_orientation(vertices: Array, faces: Array) -> None:
    """Two triangles that share an edge go along it in opposite directions."""
    _, index = np.unique(vertices, axis=0, return_inverse=True)
    corners = index.reshape(-1)[faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    if len(np.unique(edges, axis=0)) < len(edges):
        raise ValueError("has triangles that do not all face outward, so that inertia='exact' means nothing")


def _pairs(corners: Array) -> Array:
    """Of each triangle sum_k x_k x_k^T + (sum_k x_k) (sum_k x_k)^T, shape (m, 3, 3)."""
    total = corners.sum(axis=1)
    return np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)


def _inertia(second: Array) -> Array:
    """Moments of inertia from second moments int x x^T dm."""
    return np.trace(second) * np.eye(3) - second
