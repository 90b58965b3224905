"""Motions in contact with a closed form, up to a quadrature or a pendulum between impacts: published cases, nothing of `rbd`.

Planar places are (x, z, angle), the angle about +y, from x to -z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from courses import Course, G, Stop
from scipy.integrate import quad

Array = np.ndarray


@dataclass(frozen=True)
class Ladder:
    """A rod of length 2 l against a wall at x = 0, its foot out at +x; smooth, from rest at `start` from the floor.

    On both: (I + m l^2) th'^2 / 2 = m g l (sin th0 - sin th); the wall's force m x'' is zero at sin th = 2/3 sin th0, for
    any I. The rod's x axis points from foot to head, up to the left: its angle about +y is th - pi. Rough ends: see `rough`.
    """

    mass: float
    half: float
    inertia: float
    start: float

    @property
    def fall(self) -> float:
        """What drives it: m g l / (I + m l^2)."""
        return self.mass * G * self.half / (self.inertia + self.mass * self.half**2)

    @property
    def leaving_angle(self) -> float:
        """From the floor [rad]."""
        return math.asin(2.0 / 3.0 * math.sin(self.start))

    def time_to(self, angle: float) -> float:
        """By quadrature; th = th0 - u^2 takes the singularity of the start away."""
        s0 = math.sin(self.start)

        def integrand(u: float) -> float:
            if u < 1e-9:
                return 2.0 / math.sqrt(2.0 * self.fall * math.cos(self.start))
            # sin a - sin b = 2 cos((a + b) / 2) sin((a - b) / 2), without cancellation
            drop = 2.0 * math.cos(self.start - u * u / 2.0) * math.sin(u * u / 2.0)
            return 2.0 * u / math.sqrt(2.0 * self.fall * drop)

        assert s0 > math.sin(angle)
        return float(quad(integrand, 0.0, math.sqrt(self.start - angle), epsabs=1e-13, epsrel=1e-13)[0])

    def place(self, th: float, rate: float) -> Array:
        """(x, z, angle, and their rates) on floor and wall."""
        l, c, s = self.half, math.cos(th), math.sin(th)
        return np.array([l * c, l * s, th - math.pi, -l * s * rate, l * c * rate, rate])

    def course(self, until: float) -> Course:
        """On both, then on the floor alone; events "leaves" and "flat"."""
        out, l = Course(), self.half

        def both(t: float, y: Array) -> Array:
            return np.array([y[1], -self.fall * math.cos(y[0])])

        # Wall: N = m x'' = m (-l sin th th'' - l cos th th'^2)
        wall: dict[str, Stop] = {"leaves": lambda t, y: self.fall * math.sin(y[0]) - y[1] ** 2}
        t, y, _ = out.phase(both, np.array([self.start, 0.0]), 0.0, until, wall, lambda y: self.place(*y))
        if t >= until:
            return out
        vx, x0, t0 = -l * math.sin(y[0]) * y[1], l * math.cos(y[0]), t
        m, i = self.mass, self.inertia

        def floor(t: float, y: Array) -> Array:
            c, s = math.cos(y[0]), math.sin(y[0])
            N = m * (G - l * s * y[1] ** 2) / (1.0 + m * l * l * c * c / i)
            return np.array([y[1], -N * l * c / i])

        state = np.array([*y, x0])

        def shown(y: Array) -> Array:
            th, rate, x = y
            return np.array([x, l * math.sin(th), th - math.pi, vx, l * math.cos(th) * rate, rate])

        flat: dict[str, Stop] = {"flat": lambda t, y: float(y[0])}
        out.phase(lambda t, y: np.append(floor(t, y), vx), state, t0, until, flat, shown)
        return out

    def rough(self, until: float, floor: float, wall: float) -> Course:
        """Sliding with friction at both ends, until it leaves the wall; N below and W at the wall from two equations."""
        m, l, i = self.mass, self.half, self.inertia

        def forces(y: Array) -> tuple[float, float, float]:
            th, rate = y
            c, s = math.cos(th), math.sin(th)
            # foot = middle + l (c, -s) bears (-mu1 N, N); head = middle + l (-c, s) bears (W, mu2 W)
            turn = l / i * np.array([floor * s - c, s + wall * c])  # th'' of N and W
            A = np.array([[1.0, wall], [-floor, 1.0]]) / m + np.outer([-l * c, l * s], turn)
            N, W = np.linalg.solve(A, [G - l * rate**2 * s, -l * rate**2 * c])
            return float(N), float(W), float(turn @ [N, W])

        out = Course()
        stops: dict[str, Stop] = {"leaves": lambda t, y: forces(y)[1]}
        show = lambda y: self.place(*y)  # noqa: E731
        out.phase(lambda t, y: np.array([y[1], forces(y)[2]]), np.array([self.start, 0.0]), 0.0, until, stops, show)
        return out


@dataclass(frozen=True)
class RimlessWheel:
    """McGeer's wheel of point feet, legs l, 2 a apart, down a slope: a pendulum between plastic impacts.

    j = I / (m l^2). The stance leg is at th from the slope's normal, from -a to a:

        th'' = g sin(th + slope) / (l (1 + j))            w_-^2 = w_+^2 + 4 g sin a sin(slope) / (l (1 + j))
        w_+ = eta w_-        eta = (cos 2a + j) / (1 + j)        w_* = w_+ of the cycle = sqrt(gain eta^2 / (1 - eta^2))

    Source: McGeer, Passive Dynamic Walking, 1990; the published number is for j = 0, where it is after the impact.
    """

    leg: float = 1.0
    half_angle: float = math.pi / 8.0
    slope: float = 0.08
    j: float = 0.0
    g: float = G

    @property
    def eta(self) -> float:
        """What an impact leaves of the rate."""
        return (math.cos(2.0 * self.half_angle) + self.j) / (1.0 + self.j)

    @property
    def gain(self) -> float:
        """What a step adds to the square of the rate."""
        return 4.0 * self.g * math.sin(self.half_angle) * math.sin(self.slope) / (self.leg * (1.0 + self.j))

    @property
    def cycle(self) -> float:
        """Rate after each impact in the limit [rad/s]."""
        return math.sqrt(self.gain * self.eta**2 / (1.0 - self.eta**2))

    def course(self, rate: float, until: float) -> Course:
        """From just after an impact: (th, rate, feet passed); events "impact"."""
        out, t, passed = Course(), 0.0, 0
        y = np.array([-self.half_angle, rate])
        k = self.g / (self.leg * (1.0 + self.j))
        while t < until:
            stops: dict[str, Stop] = {"impact": lambda t, y: self.half_angle - y[0], "falls back": lambda t, y: y[0] + 2.0}
            show = lambda y, n=passed: np.array([*y, n])  # noqa: E731
            t, y, word = out.phase(lambda t, y: np.array([y[1], k * math.sin(y[0] + self.slope)]), y, t, until, stops, show)
            y, passed = np.array([-self.half_angle, self.eta * y[1]]), passed + (word == "impact")
        return out


@dataclass(frozen=True)
class RockingBlock:
    """Housner's block, half width b and half height h, rocking from edge to edge without slip and without bounce.

    th its tilt, R^2 = b^2 + h^2, tan al = b / h, I0 = I + m R^2: I0 th'' = -m g R sin(al - |th|) sign th; at th = 0 the rate
    keeps the fraction 1 - 2 m R^2 sin^2 al / I0, 1 - 3/2 sin^2 al of a uniform block. Source:
    Housner, The Behavior of Inverted Pendulum Structures during Earthquakes, 1963.
    """

    mass: float
    width: float
    height: float
    inertia: float

    @property
    def radius(self) -> float:
        """R."""
        return math.hypot(self.width, self.height)

    @property
    def slenderness(self) -> float:
        """Angle al."""
        return math.atan2(self.width, self.height)

    @property
    def about_edge(self) -> float:
        """I0."""
        return self.inertia + self.mass * self.radius**2

    @property
    def kept(self) -> float:
        """What an impact leaves of the rate."""
        return 1.0 - 2.0 * self.mass * self.radius**2 * math.sin(self.slenderness) ** 2 / self.about_edge

    def course(self, tilt: float, until: float, rate: float = 0.0) -> Course:
        """From a tilt about +y, on the right edge: (x, z, angle, and their rates), edges at -b and b; events "impact"."""
        out, t, y = Course(), 0.0, np.array([tilt, rate])
        side = 1.0 if tilt > 0.0 else -1.0
        k = self.mass * G * self.radius / self.about_edge
        while t < until:
            stops: dict[str, Stop] = {"impact": lambda t, y, s=side: s * float(y[0])}
            show = lambda y, s=side: self.place(y, s)  # noqa: E731
            rates = lambda t, y, s=side: np.array([y[1], -s * k * math.sin(self.slenderness - s * y[0])])  # noqa: E731
            if side * y[1] > 0.0:  # up to its turning point: it starts on both edges, and is not to be stopped there
                t, y, _ = out.phase(rates, y, t, until, {"turns": lambda t, y, s=side: s * float(y[1])}, show)
            t, y, word = out.phase(rates, y, t, until, stops, show)
            y, side = np.array([0.0, self.kept * y[1]]), -side
            if word and abs(y[1]) < 1e-7:  # it rocks for ever, in a time that ends
                out.still(self.place(np.zeros(2), side), until)
                return out
        return out

    def place(self, y: Array, side: float) -> Array:
        """Centre of mass of the block turned by y[0] about the edge at side * b."""
        th, w = y
        c, s = math.cos(th), math.sin(th)
        ax, az = -side * self.width, self.height  # from the edge; a turn about +y takes (x, z) to (c x + s z, -s x + c z)
        rx, rz = c * ax + s * az, -s * ax + c * az
        return np.array([side * self.width + rx, rz, th, w * rz, -w * rx, w])


def bounces(height: float, restitution: float, count: int) -> Array:
    """Times [s] at which a ball dropped from a height touches the floor: sqrt(2 h / g) (1 + 2 e + ... + 2 e^k)."""
    k = np.arange(count)
    return math.sqrt(2.0 * height / G) * (1.0 + 2.0 * np.cumsum(np.where(k > 0, restitution**k, 0.0)))


def bouncing_height(height: float, restitution: float, t: float) -> tuple[float, float]:
    """(height, velocity) of a bouncing point at t; zeros after the last bounce, at sqrt(2 h / g) (1 + e) / (1 - e)."""
    fall = math.sqrt(2.0 * height / G)
    if t <= fall:
        return height - G * t * t / 2.0, -G * t
    if t >= fall * (1.0 + restitution) / (1.0 - restitution):
        return 0.0, 0.0
    start, k = fall, 1
    while start + 2.0 * fall * restitution**k < t:
        start, k = start + 2.0 * fall * restitution**k, k + 1
    s, up = t - start, G * fall * restitution**k
    return up * s - G * s * s / 2.0, up - G * s


def oscillator_with_dry_friction(mass: float, stiffness: float, torque: float, start: float, t: float) -> tuple[float, float]:
    """(q, q') at t of a mass on a spring with dry friction f, from rest: half cosines about -+ f / k, then rest for good.

    Each half period pi / w takes 2 f / k off the amplitude; it stays where |q| <= f / k at a turning point.
    """
    w, band = math.sqrt(stiffness / mass), torque / stiffness
    q, s = start, t
    while abs(q) > band:
        centre = math.copysign(band, q)  # friction pushes away from where it goes to
        if s < math.pi / w:
            return centre + (q - centre) * math.cos(w * s), -(q - centre) * w * math.sin(w * s)
        q, s = 2.0 * centre - q, s - math.pi / w
    return q, 0.0


def ball_on_cloth(v: Array, w: Array, radius: float, friction: float, t: float) -> tuple[Array, Array, Array, float]:
    """(way, v, w, time of rolling) at t of a uniform ball on a level rough plane: a parabola until it rolls, then a line.

    The point that touches slips at u = v + w x (-r z); its direction stays, its speed falls at 7/2 mu g; v falls at mu g along
    u. All shape (3,), in W, z up. Source: Euler's theorem of billiards, Coriolis, on billiards, 1835.
    """
    z = np.array([0.0, 0.0, 1.0])
    u = v - radius * np.cross(w, z)
    speed = float(np.linalg.norm(u))
    along = u / speed if speed > 0.0 else np.zeros(3)
    rolls = speed / (3.5 * friction * G)
    s = min(t, rolls)
    slowed = v - friction * G * s * along
    way = v * s - friction * G * s * s / 2.0 * along + slowed * (t - s)
    return way, slowed, w + 2.5 * friction * G / radius * s * np.cross(z, along), rolls


def symmetric_top(axial: float, across: float, w: Array, t: float) -> Array:
    """Angular velocity in the body's axes at t of a torque-free body that is symmetric about z.

    Source: Kane, Likins and Levinson, Spacecraft Dynamics, 1983.
    """
    s = (across - axial) / across * w[2] * t
    c, n = math.cos(s), math.sin(s)
    return np.array([w[0] * c + w[1] * n, -w[0] * n + w[1] * c, w[2]])
