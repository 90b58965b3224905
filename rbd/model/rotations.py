"""Many quaternions (x, y, z, w) at once: products, logarithms, rotated vectors, shortest paths."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array


def conjugate(x: Array) -> Array:
    """The inverse of unit quaternions, shape (..., 4)."""
    return x * np.array([-1.0, -1.0, -1.0, 1.0])


def product(x: Array, y: Array) -> Array:
    """The rotation y, then x, shape (..., 4); of shapes that broadcast."""
    a, b, c, d = np.moveaxis(x, -1, 0)
    e, f, g, h = np.moveaxis(y, -1, 0)
    parts = (
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )
    return np.stack(parts, axis=-1)


def logarithm(x: Array) -> Array:
    """Rotation vectors of unit quaternions, at most half a turn long, shape (..., 3)."""
    x = np.where(x[..., 3:] < 0.0, -x, x)
    sine = np.linalg.norm(x[..., :3], axis=-1)
    half = np.arctan2(sine, x[..., 3])
    ratio = np.where(sine > 1e-9, 2.0 * half / np.where(sine > 1e-9, sine, 1.0), 2.0)
    return np.asarray(x[..., :3] * ratio[..., None])


def exponential(w: Array) -> Array:
    """Unit quaternions of rotation vectors, shape (..., 4)."""
    angle = np.linalg.norm(w, axis=-1)
    ratio = 0.5 * np.sinc(angle / (2.0 * np.pi))
    return np.concatenate([w * ratio[..., None], np.cos(0.5 * angle)[..., None]], axis=-1)


def rotated(x: Array, p: Array) -> Array:
    """Vectors turned by unit quaternions, shape (..., 3)."""
    twice = 2.0 * np.cross(x[..., :3], p)
    return np.asarray(p + x[..., 3:] * twice + np.cross(x[..., :3], twice))


def interpolated(x: Array, y: Array, share: Array) -> Array:
    """Quaternions along the shortest paths from x to y, a share of each, shape (n, 4)."""
    return product(x, exponential(share[:, None] * logarithm(product(conjugate(x), y))))
