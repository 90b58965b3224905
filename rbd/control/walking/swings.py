"""Curves of feet in the air: smooth in position and orientation, over what lies between two footholds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.sampled_motion import minimum_jerk_way

SINKS = 0.04
"""Speed at which the target of a foot goes down that has not landed [m/s]."""
DEEPEST = 0.02
"""And how far at most [m]."""

WAYS = (
    ((0.0, 0.9), (0.5, 0.5)),
    ((0.1, 0.9), (0.45, 0.55)),
    ((0.2, 0.85), (0.45, 0.6)),
    ((0.2, 0.8), (0.4, 0.65)),
    ((0.3, 0.75), (0.4, 0.65)),
)
"""When a foot moves forwards, and when it is high, as shares of its swing: the first way that clears what lies between."""

HEEL = 0.7
"""A heel is up until this share of a swing."""


def to_rest(t: float, T: float, way: Any, v: Any, a: Any) -> Array:
    """Displacement, velocity and acceleration after t of a motion that covers a way in a time T and ends at rest.

    It begins with a velocity v and an acceleration a: a polynomial of degree five; numbers, or arrays of one shape.
    """
    if t >= T:
        return np.array([way, 0.0 * way, 0.0 * way])
    u, v, a = t / T, v * T, a * T**2  # in units of T
    rest = way - v - 0.5 * a, -v - a, -a
    c3 = 10.0 * rest[0] - 4.0 * rest[1] + 0.5 * rest[2]
    c4 = -15.0 * rest[0] + 7.0 * rest[1] - rest[2]
    c5 = 6.0 * rest[0] - 3.0 * rest[1] + 0.5 * rest[2]
    return np.array([
        v * u + 0.5 * a * u**2 + c3 * u**3 + c4 * u**4 + c5 * u**5,
        (v + a * u + 3.0 * c3 * u**2 + 4.0 * c4 * u**3 + 5.0 * c5 * u**4) / T,
        (a + 6.0 * c3 * u + 12.0 * c4 * u**2 + 20.0 * c5 * u**3) / T**2,
    ])  # fmt: skip


def smooth(t: float, T: float) -> Array:
    """From 0 to 1 in a time T, at rest at both ends: value, rate, acceleration, shape (3,)."""
    return to_rest(max(t, 0.0), T, 1.0, 0.0, 0.0)


def bump(t: float, T: float) -> Array:
    """From 0 to 1 and back in a time T, with no rate and no acceleration at either end: value, rate, acceleration."""
    u = min(max(t / T, 0.0), 1.0)
    w, dw = u - u * u, 1.0 - 2.0 * u
    return 64.0 * np.array([w**3, 3.0 * w**2 * dw / T, (6.0 * w * dw**2 - 6.0 * w**2) / T**2])


@dataclass(frozen=True, eq=False)
class Swing:
    """A foot's way from one foothold to the next.

    Attributes:
        begin: Pose of the contact's centre where it is lifted.
        end: Where it is put down.
        start: When it is lifted [s].
        T: How long it takes [s].
        top: Height of the way [m].
        forward: (when it begins to move forwards, when it ends), as shares of T.
        high: (when it is at its height, until when), as shares of T.
        heel: Rotation vector by which its heel rises about its toes, most at 0.35 T, shape (3,) [rad].
        toes: How far the toes are from its centre [m].
        since: When its end was changed last [s]; None: never.
        state: Where it was then, its velocity and acceleration, shape (3, 3).
    """

    begin: pin.SE3
    end: pin.SE3
    start: float
    T: float
    top: float
    forward: tuple[float, float] = (0.0, 0.9)
    high: tuple[float, float] = (0.5, 0.5)
    heel: Array | None = None
    toes: float = 0.0
    since: float | None = None
    state: Array | None = None

    @property
    def landing(self) -> float:
        """When it is put down [s]."""
        return self.start + self.T

    @property
    def known(self) -> float:
        """From when on `at` tells where it is: before its end was changed last, it was on another way [s]."""
        return self.start if self.since is None else self.since

    def at(self, t: float) -> tuple[pin.SE3, Array, Array]:
        """(pose, velocity, acceleration) of the contact's centre, rates in world axes, shapes (6,)."""
        a, b, u = self.begin.translation, self.end.translation, t - self.start
        path = np.zeros((3, 6))
        if self.since is None or self.state is None:
            s = smooth(u - self.forward[0] * self.T, (self.forward[1] - self.forward[0]) * self.T)
            up, down = smooth(u, self.high[0] * self.T), smooth(u - self.high[1] * self.T, (1.0 - self.high[1]) * self.T)
            path[0, :3] = a
            path[:, :2] += s[:, None] * (b - a)[:2]
            path[:, 2] += up * (self.top - a[2]) + down * (b[2] - self.top)
        else:
            passed, left = t - self.since, self.landing - self.since
            s, place = smooth(passed, left), self.state[0]
            path[:, :2] = to_rest(passed, self.forward[1] * left, (b - place)[:2], *self.state[1:, :2])
            path[:, 2:3] = to_rest(passed, left, (b - place)[2:], *self.state[1:, 2:])
            path[:, 2] += max(0.7 * (self.top - b[2]) - (place[2] - b[2]), 0.0) * bump(passed, left)
            path[0, :3] += place
        axis = pin.log3(self.end.rotation @ self.begin.rotation.T)
        path[1:, 3:] = s[1:, None] * axis
        R = pin.exp3(s[0] * axis)
        if self.heel is not None and self.since is None:
            b, about = bump(u, HEEL * self.T), R @ self.heel
            path[:, 2] += self.toes * float(np.linalg.norm(self.heel)) * b  # so its toes are no lower
            path[1, 3:] += b[1] * about
            path[2, 3:] += b[2] * about + b[1] * np.cross(s[1] * axis, about)
            R = R @ pin.exp3(b[0] * self.heel)
        if u > self.T:
            depth = SINKS * (u - self.T)
            path[0, 2] -= min(depth, DEEPEST)
            path[1, 2] -= SINKS * (depth < DEEPEST)
        return pin.SE3(R @ self.begin.rotation, path[0, :3]), path[1], path[2]

    def over(self, tops: Array, lift: float) -> Swing:
        """The same, higher by `lift` than what lies between, and as early and late over it as that takes.

        Args:
            tops: How high that is, at equal distances from the first place to the last, shape (n,) [m].
            lift: How much higher it passes [m].
        """
        out, share = replace(self, top=max(self.top, float(tops.max()) + lift)), np.linspace(0.0, 1.0, len(tops))
        for forward, high in WAYS:
            out = replace(out, forward=forward, high=high)
            u = self.start + self.T * share
            z = np.array([out.at(x)[0].translation[2] for x in u])
            s = minimum_jerk_way(((share - forward[0]) / (forward[1] - forward[0])).clip(0.0, 1.0))
            if (z > np.interp(s, share, tops) - 1e-3)[(s > 0.0) & (s < 1.0)].all():
                break
        return out

    def redirected(self, t: float, end: pin.SE3, landing: float) -> Swing:
        """To another foothold, at another time, from where it is at a time on."""
        if t <= self.start:
            return replace(self, end=end, T=landing - self.start)
        X, v, a = self.at(t)
        return replace(self, begin=X, end=end, T=landing - self.start, since=t, state=np.array([X.translation, v[:3], a[:3]]))
