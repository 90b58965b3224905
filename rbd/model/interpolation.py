"""Configurations between frames: cubic in time on the manifold, through q with v at both ends."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.model.rotations import conjugate, exponential, logarithm, product, rotated


def between(t: Array, times: Array) -> tuple[Array, Array, Array]:
    """(frame before, time since it over the step, step) of times within t."""
    i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    h = t[i + 1] - t[i]
    return i, (times - t[i]) / h, h


def cubic(t: Array, x: Array, rate: Array, times: Array) -> Array:
    """Numbers between frames, by the cubic with the given rates at both ends, shape (m, k)."""
    i, s, h = between(t, times)
    s, h = s[:, None], h[:, None]
    change = x[i + 1] - x[i]
    begin, end = h * rate[i], h * rate[i + 1]
    return np.asarray(x[i] + s * (begin + s * ((3.0 * change - 2.0 * begin - end) + s * (begin + end - 2.0 * change))))


def cubic_rate(t: Array, x: Array, rate: Array, times: Array) -> Array:
    """Rates of these cubics, shape (m, k): those given at the frames, to the third order in the time step between them."""
    i, s, h = between(t, times)
    s, h = s[:, None], h[:, None]
    slope = (x[i + 1] - x[i]) / h
    begin, end = rate[i], rate[i + 1]
    return np.asarray(begin + s * (2.0 * (3.0 * slope - 2.0 * begin - end) + 3.0 * s * (begin + end - 2.0 * slope)))


def interpolated_q(robot: CheckedModel, t: Array, q: Array, v: Array, times: Array) -> Array:
    """Configurations at times within t, shape (m, nq): to the fourth order in the time step, with continuous velocity."""
    out = np.empty((len(times), robot.nq))
    numbers = [(p.q, p.v) for p in robot.joints.pieces if p.kind == "number"]
    if numbers:
        at_q, at_v = (list(x) for x in zip(*numbers, strict=True))
        out[:, at_q] = cubic(t, q[:, at_q], v[:, at_v], times)
    for p in robot.joints.pieces:
        own, rate = q[:, p.q : p.q + p.nq], v[:, p.v : p.v + p.nv]
        to = out[:, p.q : p.q + p.nq]
        if p.kind in ("circle", "plane"):
            angle = cubic(t, np.unwrap(np.arctan2(own[:, -1], own[:, -2]))[:, None], rate[:, -1:], times)
            to[:, -2:] = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
            if p.kind == "plane":
                c, s = own[:, 2, None], own[:, 3, None]
                world = c * rate[:, :2] + s * np.stack([-rate[:, 1], rate[:, 0]], axis=1)
                to[:, :2] = cubic(t, own[:, :2], world, times)
        elif p.kind in ("sphere", "space"):
            to[:, -4:] = _turned(t, own[:, -4:], rate[:, -3:], times)
            if p.kind == "space":
                to[:, :3] = cubic(t, own[:, :3], rotated(own[:, 3:], rate[:, :3]), times)
    return out


def _turned(t: Array, x: Array, w: Array, times: Array) -> Array:
    """Quaternions between frames: the cubic of the rotation vectors from the frame before, with spins w at both ends."""
    i, s, h = between(t, times)
    y = logarithm(product(conjugate(x[i]), x[i + 1]))
    end = _inverse_jacobian(y, w[i + 1])
    s, h = s[:, None], h[:, None]
    begin, end = h * w[i], h * end
    vector = s * (begin + s * ((3.0 * y - 2.0 * begin - end) + s * (begin + end - 2.0 * y)))
    return product(x[i], exponential(vector))


def _inverse_jacobian(y: Array, w: Array) -> Array:
    """Rates of rotation vectors y whose rotations spin with w about their own axes: Jr(y)^-1 w, shape (n, 3)."""
    angle = np.linalg.norm(y, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    return np.asarray(w + 0.5 * np.cross(y, w) + factor[:, None] * np.cross(y, np.cross(y, w)))
