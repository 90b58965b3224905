"""The plane of a contact over time, from its points alone: its normal, and how far the centre of pressure is from the edge."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull

UPRIGHT = float(np.cos(np.pi / 4.0))
"""Contacts whose normal leans more than 45 degrees do not carry weight from below."""
_FLAT = 1e-6
"""Points whose spread along one axis is less than this share of their largest, both squared, are in a plane or on a line."""


def normals_of(points: Array, forces: Array) -> Array | None:
    """Unit normal of a contact at each time, shape (n, 3), on the side to which it mostly pushes the robot; None if unknown.

    It is that of the plane through the loaded points. Where fewer than three are loaded, or they lie on a line, it is the one
    of the nearest time before that had one, else of the first such time: a foot that tips does not turn the ground. Unknown
    are those of single points, of edges, and of contacts whose loaded points are not in one plane.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m]; NaN where there is none.
        forces: At the points, shape (n, k, 3) [N].
    """
    n, k = points.shape[:2]
    if k < 3:
        return None
    there = np.isfinite(points).all(axis=2) & (np.linalg.norm(forces, axis=2) > 0.0)
    count = there.sum(axis=1)
    clean = np.where(there[:, :, None], points, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = clean.sum(axis=1) / count[:, None]
    arms = np.where(there[:, :, None], points - centre[:, None], 0.0)
    spread = np.einsum("nki,nkj->nij", arms, arms)
    known = count >= 3
    if not known.any():
        return None
    sizes, axes = np.linalg.eigh(np.where(known[:, None, None], spread, np.eye(3)))
    known &= sizes[:, 1] > _FLAT * sizes[:, 2]
    if not known.any() or (sizes[known, 0] > _FLAT * sizes[known, 2]).any():
        return None
    normal = axes[:, :, 0]
    normal = normal * np.where(normal @ normal[int(known.argmax())] < 0.0, -1.0, 1.0)[:, None]
    if np.einsum("ni,ni->", normal[known], forces.sum(axis=1)[known]) < 0.0:
        normal = -normal
    last = np.maximum.accumulate(np.where(known, np.arange(n), -1))
    found: Array = normal[np.where(last < 0, int(known.argmax()), last)]
    return found


def edge_distances(points: Array, forces: Array) -> Array | None:
    """Distance of the centre of pressure from the edge of its sole at each time, shape (n,) [m]; None if it is no flat sole.

    NaN while it carries no load. The edge is the convex hull of its points, the centre of pressure the mean of the points
    weighted by their normal forces; a pull counts as none.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m].
        forces: At the points, shape (n, k, 3) [N].
    """
    normal = normals_of(points, forces)
    if normal is None:
        return None
    complete = np.isfinite(points).all(axis=(1, 2))
    i = int(complete.argmax())
    if not complete.any():
        return None
    arms = points[i] - points[i].mean(axis=0)
    _, sizes, axes = np.linalg.svd(arms)
    flat = arms @ axes[:2].T
    hull = convex_hull(flat)
    if len(hull) < 3 or sizes[2] ** 2 > _FLAT * sizes[0] ** 2:
        return None
    around = [int(((flat - corner) ** 2).sum(axis=1).argmin()) for corner in hull]
    load = np.maximum(np.einsum("nki,ni->nk", forces, normal), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = np.einsum("nk,nki->ni", load, np.where(complete[:, None, None], points, np.nan)) / load.sum(axis=1)[:, None]
    begin, end = points[:, around], points[:, np.roll(around, -1)]
    edge = end - begin
    across = np.cross(edge, centre[:, None] - begin)
    far = np.linalg.norm(across, axis=2) / np.linalg.norm(edge, axis=2)
    nearest: Array = far.min(axis=1)
    return nearest


def carries_weight(points: Array, forces: Array) -> bool:
    """Whether a contact can support the robot from below: its normal, or its force where none is known, points up.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m].
        forces: At the points, shape (n, k, 3) [N].
    """
    normal = normals_of(points, forces)
    mean = np.nan_to_num(forces).sum(axis=(0, 1)) if normal is None else normal.mean(axis=0)
    return bool(mean[2] > UPRIGHT * float(np.linalg.norm(mean)))
