"""A motion as samples over time: protocols, configurations between samples, and many quaternions at once."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel


class SampledPoses(Protocol):
    """A robot's configurations at n times, as those of `rbd.Trajectory` and `rbd.Motion`."""

    @property
    def robot(self) -> CheckedModel:
        """The robot."""

    @property
    def t(self) -> Array:
        """Times, shape (n,) [s]."""

    @property
    def q(self) -> Array:
        """Configurations, shape (n, nq)."""


class SampledMotion(SampledPoses, Protocol):
    """The same with velocities."""

    @property
    def v(self) -> Array:
        """Velocities, shape (n, nv) [m/s, rad/s]."""


class SampledAccelerations(SampledMotion, Protocol):
    """The same with accelerations."""

    @property
    def a(self) -> Array:
        """Accelerations, shape (n, nv) [m/s2, rad/s2]."""


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
