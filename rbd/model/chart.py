"""Local coordinates about a configuration, because q is not an element of a vector space.

    q = q0 (+) xi            xi' = T(xi)^-1 v            T(xi) = d(q0 (+) xi) / d(xi), in the axes that v is given in

xi has the size of v. Of joints whose v is the derivative of their coordinates T is the identity; of planar, spherical and
floating joints it is the right Jacobian of the group's exponential, whose inverse, with ad the bracket with xi, is

    T^-1 = 1 + ad / 2 + ad^2 / 12 - ad^4 / 720 + ...

Near xi = 0 it is evaluated here to rounding. Pinocchio's Jacobians of exponential and logarithm are wrong by 2e-9 (planar:
8e-9) where xi is around 1e-3, by which the energy of a smooth motion would drift. An integrator of any order on (xi, v) has
the same order on (q, v) [MuntheKaas1999], and unit quaternions stay on their sphere, as q0 (+) xi is always on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.model.checked_model import CheckedModel

_NEAR = 1.0
"""Up to this angle [rad] the series is used; beyond, T is Pinocchio's, whose errors are then rounding."""
_EXACT = (720.0, 30240.0, 1209600.0, 47900160.0, 1307674368000.0 / 691.0, 74724249600.0)
_SERIES = (
    *(1.0 / x for x in _EXACT),
    *(2.0 * sum(n ** (-2.0 * k) for n in range(1, 20)) / (2.0 * math.pi) ** (2 * k) for k in range(8, 15)),
)
"""|B_2k| / (2k)! = 2 zeta(2k) / (2 pi)^2k of Bernoulli's numbers from k = 2; the first is 1 / 12."""
Vector = tuple[float, float, float]


class Charts:
    """The charts of one robot: knows which of its velocities are no derivatives of coordinates."""

    def __init__(self, robot: CheckedModel) -> None:
        self.model = robot.model
        self.pieces = [(p.kind, p.v) for p in robot.joints.pieces if p.kind in ("sphere", "plane", "space")]
        curved = [range(p.v, p.v + p.nv) for p in robot.joints.pieces if p.kind in ("sphere", "plane", "space")]
        turns = {"sphere": (0, 1, 2), "plane": (2,), "space": (3, 4, 5)}
        self.turning = np.array([at + i for kind, at in self.pieces for i in turns[kind]], dtype=int)
        self.curved = np.array([i for span in curved for i in span], dtype=int)

    def at(self, q0: Array) -> Chart:
        """The chart about a configuration."""
        return Chart(self, q0)


class Chart:
    """Coordinates xi, shape (nv,), of the configurations about q0."""

    def __init__(self, charts: Charts, q0: Array) -> None:
        self._charts, self.q0 = charts, q0

    def q(self, xi: Array) -> Array:
        """The configuration q0 (+) xi, shape (nq,)."""
        return pin.integrate(self._charts.model, self.q0, xi)

    def rate(self, xi: Array, v: Array) -> Array:
        """The derivative xi' = T(xi)^-1 v, shape (nv,)."""
        curved, model = self._charts.curved, self._charts.model
        if not len(curved):
            return v
        if max_abs(xi[self._charts.turning]) < _NEAR:
            out, x, u = v.copy(), xi.tolist(), v.tolist()
            for kind, at in self._charts.pieces:
                if kind == "space":
                    out[at : at + 6] = _space_rate(x[at : at + 6], u[at : at + 6])
                elif kind == "sphere":
                    out[at : at + 3] = _turn_rate(x[at : at + 3], u[at : at + 3], *_coefficients(x[at : at + 3]))
                else:
                    out[at : at + 2] = _plane_rate(x[at : at + 3], u[at : at + 3])
            return out
        T = pin.dIntegrate(model, self.q0, xi, pin.ARG1)
        out = v.copy()
        out[curved] = np.linalg.solve(T[np.ix_(curved, curved)], v[curved])
        return out


def _coefficients(turn: Sequence[float]) -> tuple[float, float]:
    """(c, dc / ds), s the square of the angle: T^-1 = 1 + P / 2 + c P^2 of rotations, with P = turn x."""
    s = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    c = slope = 0.0
    for term in reversed(_SERIES):
        slope = slope * s + c
        c = c * s + term
    return 1.0 / 12.0 + s * c, c + s * slope


def _turn_rate(x: Sequence[float], w: Sequence[float], c: float, _: float = 0.0) -> Vector:
    """T^-1 w of a rotation."""
    first = _cross(x, w)
    second = _cross(x, first)
    return tuple(a + 0.5 * b + c * d for a, b, d in zip(w, first, second, strict=True))  # type: ignore[return-value]  # three


def _space_rate(xi: Sequence[float], u: Sequence[float]) -> tuple[float, ...]:
    """T^-1 u of a pose, linear then angular: its upper right block is the derivative of the rotations' along the shift."""
    shift, turn, v, w = xi[:3], xi[3:], u[:3], u[3:]
    c, slope = _coefficients(turn)
    slope *= 2.0 * (shift[0] * turn[0] + shift[1] * turn[1] + shift[2] * turn[2])
    turned, moved, swept = _cross(turn, w), _cross(turn, v), _cross(shift, w)
    first = (moved[0] + swept[0], moved[1] + swept[1], moved[2] + swept[2])
    again, second, other = _cross(turn, turned), _cross(turn, first), _cross(shift, turned)
    linear = [a + 0.5 * b + c * (d + e) + slope * f for a, b, d, e, f in zip(v, first, second, other, again, strict=True)]
    return *linear, *(a + 0.5 * b + c * d for a, b, d in zip(w, turned, again, strict=True))


def _plane_rate(xi: Sequence[float], u: Sequence[float]) -> tuple[float, float]:
    """The linear part of T^-1 u of a pose in the plane, (x, y, angle); the angular part is that of u."""
    x, y, turn = xi
    vx, vy, w = u
    c = _coefficients((0.0, 0.0, turn))[0] * turn
    return (
        vx + 0.5 * (w * y - turn * vy) + c * (w * x - turn * vx),
        vy + 0.5 * (turn * vx - w * x) + c * (w * y - turn * vy),
    )


def _cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
