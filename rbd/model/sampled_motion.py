"""A motion as samples over time: protocols, configurations between samples, and many quaternions at once."""

from __future__ import annotations

from collections.abc import Sequence
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


def minimum_jerk_way(s: Array) -> Array:
    """10 s^3 - 15 s^4 + 6 s^5: from 0 to 1 with two derivatives zero at both ends [Flash1985]."""
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)))


def flat_coordinates(robot: CheckedModel, q: Array) -> Array:
    """Positions and continuous angles of configurations, shape (n, nv): those that v are rates of; zero for rotations in space.

    Positions of a body are in the world's axes, not in its own as v.
    """
    x = np.zeros((len(q), robot.nv))
    for p in robot.joints.pieces:
        k = p.unit.start
        x[:, p.v : p.v + k] = q[:, p.q : p.q + k]
        if p.kind in ("circle", "plane"):
            x[:, p.v + k] = np.unwrap(np.arctan2(q[:, p.q + k + 1], q[:, p.q + k]))
    return x


def from_flat(robot: CheckedModel, x: Array, turns: Sequence[Array]) -> Array:
    """The inverse of `flat_coordinates`, shape (n, nq), with quaternions for each of `quaternions`."""
    q = np.empty((len(x), robot.nq))
    for p in robot.joints.pieces:
        k = p.unit.start
        q[:, p.q : p.q + k] = x[:, p.v : p.v + k]
        if p.kind in ("circle", "plane"):
            q[:, p.q + k], q[:, p.q + k + 1] = np.cos(x[:, p.v + k]), np.sin(x[:, p.v + k])
    for (at, _), turn in zip(quaternions(robot), turns, strict=True):
        q[:, at] = turn
    return q


def quaternions(robot: CheckedModel) -> list[tuple[slice, slice]]:
    """(its place in q, that of its spin in v) of each rotation in space."""
    turning = [p for p in robot.joints.pieces if p.kind in ("sphere", "space")]
    return [(slice(p.q + p.nq - 4, p.q + p.nq), slice(p.v + p.nv - 3, p.v + p.nv)) for p in turning]


def to_world(robot: CheckedModel, q: Array, x: Array, *, inverse: bool = False) -> Array:
    """Rates, shape (n, nv), those of bodies' positions turned from their own axes into the world's, or back."""
    out = x.copy()
    for p in robot.joints.pieces:
        if p.kind == "space":
            R = q[:, p.q + 3 : p.q + 7]
            out[:, p.v : p.v + 3] = rotated(conjugate(R) if inverse else R, x[:, p.v : p.v + 3])
        elif p.kind == "plane":
            c, s, u = q[:, p.q + 2, None], q[:, p.q + 3, None], x[:, p.v : p.v + 2]
            out[:, p.v : p.v + 2] = c * u + (-s if inverse else s) * _left_of(u)
    return out


def spin_terms(robot: CheckedModel, v: Array) -> Array:
    """What a classical acceleration has beyond the rate of a velocity's own components: w x v of bodies, shape (n, nv)."""
    out = np.zeros_like(v)
    for p in robot.joints.pieces:
        if p.kind == "space":
            out[:, p.v : p.v + 3] = np.cross(v[:, p.v + 3 : p.v + 6], v[:, p.v : p.v + 3])
        elif p.kind == "plane":
            out[:, p.v : p.v + 2] = v[:, p.v + 2, None] * _left_of(v[:, p.v : p.v + 2])
    return out


def own_rates(robot: CheckedModel, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """(v, a) along bodies' own axes, of first and second derivatives of positions in the world's, shapes (n, nv)."""
    v = to_world(robot, q, v, inverse=True)
    return v, to_world(robot, q, a, inverse=True) - spin_terms(robot, v)


def _left_of(u: Array) -> Array:
    """Vectors of a plane turned by a right angle, shape (n, 2)."""
    return np.stack([-u[:, 1], u[:, 0]], axis=1)


def interpolated_q(robot: CheckedModel, t: Array, q: Array, v: Array, times: Array) -> Array:
    """Configurations at times within t, shape (m, nq): to the fourth order in the time step, with continuous velocity."""
    x = cubic(t, flat_coordinates(robot, q), to_world(robot, q, v), times)
    return from_flat(robot, x, [_turned(t, q[:, at], v[:, spin], times) for at, spin in quaternions(robot)])


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
