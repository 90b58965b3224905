"""Motions in contact from reduced equations, integrated between events: truth without a contact solver, nothing of `rbd`.

Planar places are (x, z, angle), the angle about +y, from x to -z. `Course` strings phases of smooth motion together, each
integrated by DOP853 to 1e-12, with the event that ends it found on its dense output.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

G = 9.81
Array = np.ndarray
Rate = Callable[[float, Array], Array]
Stop = Callable[[float, Array], float]


@dataclass
class Course:
    """A motion in phases: `at(t)` gives its coordinates, `events` when which phase ended.

    Attributes:
        ends: Times at which phases end [s].
        pieces: Coordinates over time in each.
        events: (time, word) of each end that has a word.
    """

    ends: list[float] = field(default_factory=list)
    pieces: list[Callable[[float], Array]] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)

    def phase(
        self, rate: Rate, y: Array, t: float, until: float, stops: dict[str, Stop], show: Callable[[Array], Array]
    ) -> tuple[float, Array, str]:
        """Integrate until a stop falls through zero; its word, or "" at the end."""
        events = [_falling(stop) for stop in stops.values()]
        out = solve_ivp(rate, (t, until), y, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True, events=events or None)
        assert out.status >= 0, out.message
        self.ends.append(float(out.t[-1]))
        self.pieces.append(lambda s: show(out.sol(s)))
        word = ""
        if out.status == 1:
            word = next(w for w, found in zip(stops, out.t_events, strict=True) if found.size)
            self.events.append((self.ends[-1], word))
        return self.ends[-1], out.y[:, -1], word

    def still(self, y: Array, until: float) -> None:
        """At rest from here."""
        self.ends.append(until)
        self.pieces.append(lambda s: y)

    def at(self, t: float) -> Array:
        """Coordinates at a time [s] within the course."""
        k = int(np.searchsorted(self.ends, t))
        return self.pieces[min(k, len(self.pieces) - 1)](t)

    def when(self, word: str) -> list[float]:
        """Times of the events of this word [s]."""
        return [t for t, w in self.events if w == word]


def _falling(stop: Stop) -> Stop:
    def event(t: float, y: Array) -> float:
        return stop(t, y)

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    return event


@dataclass(frozen=True)
class OnePoint:
    """A planar rigid body of which one point touches a rough floor z = 0: it sticks, slips or is open, with no impacts.

    Place (x, z, angle) of the centre of mass; the point is `offset` (along the body's x and z) from it. At a point with
    arm (ax, az) in W: v_t = x' + az w, v_n = z' - ax w; their derivatives hold - w^2 (ax, az) besides; the torque about +y
    of a force (f, N) there is az f - ax N.
    """

    mass: float
    inertia: float
    offset: tuple[float, float]
    friction: float

    def arm(self, angle: float) -> tuple[float, float]:
        """The way from the centre of mass to the point, in W."""
        c, s = math.cos(angle), math.sin(angle)
        u, w = self.offset
        return c * u + s * w, -s * u + c * w

    def delassus(self, angle: float) -> Array:
        """J M^-1 J^T of (tangent, normal), shape (2, 2)."""
        ax, az = self.arm(angle)
        m, i = 1.0 / self.mass, 1.0 / self.inertia
        return np.array([[m + az * az * i, -ax * az * i], [-ax * az * i, m + ax * ax * i]])

    def velocity(self, y: Array) -> Array:
        """(v_t, v_n) of the point."""
        ax, az = self.arm(y[2])
        return np.array([y[3] + az * y[5], y[4] - ax * y[5]])

    def free(self, y: Array) -> Array:
        """Its acceleration without contact."""
        ax, az = self.arm(y[2])
        return np.array([-ax * y[5] ** 2, -G - az * y[5] ** 2])

    def force(self, y: Array, mode: str) -> Array:
        """(f, N) in the mode "open", "sticks", "slips+" or "slips-" (the sign of v_t)."""
        D, b = self.delassus(y[2]), self.free(y)
        if mode == "open":
            return np.zeros(2)
        if mode == "sticks":
            return np.linalg.solve(D, -b)
        along = np.array([-self.friction * (1.0 if mode == "slips+" else -1.0), 1.0])
        return along * (-b[1] / (D[1] @ along))

    def rate(self, mode: str) -> Rate:
        """Derivative of y = (x, z, angle, and their rates) in a mode."""

        def of(t: float, y: Array) -> Array:
            f, N = self.force(y, mode)
            ax, az = self.arm(y[2])
            return np.concatenate([y[3:], [f / self.mass, N / self.mass - G, (az * f - ax * N) / self.inertia]])

        return of

    def course(self, y: Array, until: float, mode: str, stops: dict[str, Stop] | None = None) -> Course:
        """From y in a mode; events "slips", "sticks", "leaves", and those of `stops`, at which it ends."""
        out, t, given, y = Course(), 0.0, stops or {}, np.asarray(y, float)
        while t < until:
            t, y, word = out.phase(self.rate(mode), y, t, until, self._stops(mode) | given, lambda y: y)
            if word in given or not word:
                return out
            mode = self._next(y, word)
        return out

    def _stops(self, mode: str) -> dict[str, Stop]:
        if mode == "open":
            return {}
        if mode == "sticks":

            def within(t: float, y: Array) -> float:
                f, N = self.force(y, mode)
                return self.friction * N - abs(f)

            return {"slips": within}
        sign = 1.0 if mode == "slips+" else -1.0
        return {
            "sticks": lambda t, y: sign * float(self.velocity(y)[0]),
            "leaves": lambda t, y: float(self.force(y, mode)[1]),
        }

    def _next(self, y: Array, word: str) -> str:
        f, N = self.force(y, "sticks")
        if word == "leaves":
            return "open"
        if word == "slips" or abs(f) > self.friction * N:
            return "slips-" if f > 0.0 else "slips+"  # it gives way against the force that held it
        return "sticks"

    def impact(self, y: Array, restitution: float) -> tuple[Array, Array, str]:
        """(y after, impulse (t, n), "sticks" or "slips") of its point running into the floor.

        Newton's law for the normal, Coulomb's between impulses and velocity after: it sticks if the impulse that stops it is
        within the cone, else it slips with (-mu s, 1) p_n, s the sign of the velocity after.
        """
        D, u = self.delassus(y[2]), self.velocity(y)
        stick = np.linalg.solve(D, -np.array([u[0], (1.0 + restitution) * u[1]]))
        found = []
        if abs(stick[0]) <= self.friction * stick[1]:
            found.append((stick, "sticks"))
        for s in (1.0, -1.0):
            along = np.array([-self.friction * s, 1.0])
            p = along * (-(1.0 + restitution) * u[1] / (D[1] @ along))
            if p[1] >= 0.0 and s * (u + D @ p)[0] > 0.0:
                found.append((p, "slips"))
        assert len(found) == 1, found
        p, mode = found[0]
        ax, az = self.arm(y[2])
        change = [p[0] / self.mass, p[1] / self.mass, (az * p[0] - ax * p[1]) / self.inertia]
        return np.concatenate([y[:3], y[3:] + change]), p, mode


def rod_inertia(mass: float, half: float) -> float:
    """That of a thin rod of length 2 l about its middle: m l^2 / 3."""
    return mass * half * half / 3.0


def falling_rod(mass: float, half: float, friction: float, start: float, until: float, **more: Stop) -> Course:
    """A thin rod from rest at `start` from the vertical, its foot on rough ground; coordinates as `OnePoint`.

    The body's x axis points from foot to head: the angle about +y is that from the vertical less pi/2.
    """
    body = OnePoint(mass, rod_inertia(mass, half), (-half, 0.0), friction)
    y = np.array([half * math.sin(start), half * math.cos(start), start - math.pi / 2.0, 0.0, 0.0, 0.0])
    return body.course(y, until, "sticks", dict(more))


def pendulum_on_a_stop(length: float, start: float, stop: float, restitution: float, until: float) -> Course:
    """A point mass from rest at `start` from hanging that runs into a stop at a smaller angle: (q, q'); events "impact".

    Without restitution it stays there where its weight presses it on, at stop > 0; at stop < 0 it swings back from rest.
    """
    out, t, y = Course(), 0.0, np.array([start, 0.0])
    turns: dict[str, Stop] = {"turns": lambda t, y: float(y[1])}
    impact: dict[str, Stop] = {"impact": lambda t, y: float(y[0]) - stop}

    def rate(t: float, y: Array) -> Array:
        return np.array([y[1], -G / length * math.sin(y[0])])

    while t < until:
        if y[1] > 0.0:  # up to its turning point: it starts on the stop, and is not to be stopped there
            t, y, _ = out.phase(rate, y, t, until, turns, lambda y: y)
        t, y, word = out.phase(rate, y, t, until, impact, lambda y: y)
        y = np.array([stop, -restitution * y[1]])
        if word and y[1] < 1e-7:
            if stop > 0.0:
                out.still(np.array([stop, 0.0]), until)
            else:
                out.phase(rate, np.array([stop, 0.0]), t, until, {"turns": lambda t, y: float(y[1]) + 1e-9}, lambda y: y)
            return out
    return out


@dataclass(frozen=True)
class Tripod:
    """A body that slides and spins on three points: the loads follow from moments, and the friction from the loads.

    Points (X_i, Y_i) about the centre of mass, at height h above the floor: sum N = m g, and no torque about x and y:
    sum (Y_i N_i + h f_yi) = 0, sum (X_i N_i + h f_xi) = 0, f_i = -mu N_i v_i / |v_i|. `spin_inertia` is about z.
    """

    mass: float
    spin_inertia: float
    height: float
    friction: float
    points: Array

    def loads(self, y: Array) -> tuple[Array, Array, Array]:
        """(N (3,), f (3, 2), arms (3, 2)) at y = (x, y, turn, and their rates)."""
        c, s = math.cos(y[2]), math.sin(y[2])
        arms = self.points @ np.array([[c, s], [-s, c]])
        v = y[3:5] + y[5] * np.column_stack([-arms[:, 1], arms[:, 0]])
        along = -self.friction * v / np.linalg.norm(v, axis=1)[:, None]
        A = np.vstack([np.ones(3), (arms + self.height * along).T])
        N = np.linalg.solve(A, [self.mass * G, 0.0, 0.0])
        return N, along * N[:, None], arms

    def rate(self, t: float, y: Array) -> Array:
        """Derivative of y; the last entry is the work of friction."""
        N, f, arms = self.loads(y)
        a = f.sum(axis=0) / self.mass
        turn = float((arms[:, 0] * f[:, 1] - arms[:, 1] * f[:, 0]).sum()) / self.spin_inertia
        v = y[3:5] + y[5] * np.column_stack([-arms[:, 1], arms[:, 0]])
        return np.array([*y[3:6], *a, turn, float((f * v).sum())])

    def energy(self, y: Array) -> float:
        """Kinetic [J]."""
        return float(self.mass * (y[3:5] @ y[3:5]) + self.spin_inertia * y[5] ** 2) / 2.0

    def course(self, v: Array, spin: float, until: float) -> Course:
        """(x, y, turn, their rates, work of friction), while all three points slide."""
        out, y = Course(), np.array([0.0, 0.0, 0.0, *v, spin, 0.0])
        out.phase(self.rate, y, 0.0, until, {"one stands": lambda t, y: self.slowest(y) - 1e-3}, lambda y: y)
        return out

    def slowest(self, y: Array) -> float:
        """Speed of the slowest point [m/s]."""
        c, s = math.cos(y[2]), math.sin(y[2])
        arms = self.points @ np.array([[c, s], [-s, c]])
        return float(np.linalg.norm(y[3:5] + y[5] * np.column_stack([-arms[:, 1], arms[:, 0]]), axis=1).min())
