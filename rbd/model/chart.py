"""Local coordinates about a configuration, and floating bases over a step: q is no vector, its neighbourhood is.

    q = q0 (+) xi            xi' = T(xi)^-1 v            T(xi) = d(q0 (+) xi) / d(xi), in the axes that v is given in

xi has the size of v. Of joints whose v is the derivative of their coordinates T is the identity; of planar, spherical and
floating joints it is the right Jacobian of the group's exponential. An integrator of any order on (xi, v) has the same order on
(q, v) [MuntheKaas1999], and unit quaternions stay on their sphere, as q0 (+) xi is always on it.

Pinocchio has the velocity of a floating base in the base's axes: that of a body that spins and flies turns with it, and has
w x v in its accelerations. Integrated directly, the path of a step is an arc, with error O(h^2) from the straight line. With
`Bases` a step's velocities are those in axes frozen where the step looks at them, at its beginning or in its middle: a free
body follows its parabola at any step. Other joints are not affected.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs, zeros
from rbd.model.checked_model import CheckedModel

_NEAR = 1.0
"""Up to here [rad, m] the inverse of T is the Jacobian of the logarithm, which is faster; beyond pi that one jumps."""


class Charts:
    """The charts of one robot: knows which of its velocities are no derivatives of coordinates."""

    def __init__(self, robot: CheckedModel) -> None:
        self.model = robot.model
        curved = [range(p.v, p.v + p.nv) for p in robot.joints.pieces if p.kind in ("sphere", "plane", "space")]
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
        if max_abs(xi[curved]) < _NEAR:
            return pin.dDifference(model, self.q0, self.q(xi), pin.ARG1) @ v
        T = pin.dIntegrate(model, self.q0, xi, pin.ARG1)
        out = v.copy()
        out[curved] = np.linalg.solve(T[np.ix_(curved, curved)], v[curved])
        return out


class Bases:
    """The floating bases of a robot, or none."""

    def __init__(self, robot: CheckedModel) -> None:
        model = robot.model
        self.model, self.nv = model, robot.nv
        self.places = [(model.joints[j].idx_q, model.joints[j].idx_v) for j in robot.bases]

    def spin(self, v: Array) -> Array:
        """W x v of each base in its linear part, zero elsewhere, shape (nv,): a of the frozen axes less a of the base's."""
        if not self.places:
            return zeros(self.nv)
        out = np.zeros(self.nv)
        for _, i in self.places:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            out[i : i + 3] = b * z - c * y, c * x - a * z, a * y - b * x
        return out

    def turned(self, start: Array, v: Array, h: float) -> Array:
        """The velocity start + h W x v, shape (nv,): `spin` of v over a time h."""
        out = start.copy()
        for _, i in self.places:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            out[i] += h * (b * z - c * y)
            out[i + 1] += h * (c * x - a * z)
            out[i + 2] += h * (a * y - b * x)
        return out

    def moved(self, q: Array, v: Array, h: float, velocities: Sequence[Array] = ()) -> tuple[Array, list[Array]]:
        """Where v, frozen at q, leads in a time h, shape (nq,); and velocities in the axes of q, in those of that place.

        In plain floats, which take a third of the time of small arrays.
        """
        out: Array = pin.integrate(self.model, q, h * v)
        carried = list(velocities)
        for at, i in self.places:
            p, R = q[at : at + 7].tolist(), _rotation(q, at)
            x, y, z = _turned(R, v[i : i + 3].tolist())
            out[at : at + 3] = p[0] + h * x, p[1] + h * y, p[2] + h * z
            a, b, c, d, e, f, g, k, m = _rotation(out, at)
            for n, one in enumerate(carried):
                x, y, z = _turned(R, one[i : i + 3].tolist())
                carried[n] = one = one.copy()
                one[i : i + 3] = a * x + d * y + g * z, b * x + e * y + k * z, c * x + f * y + m * z
        return out, carried


def _rotation(q: Array, at: int) -> tuple[float, ...]:
    """R_WB of the base whose part of q begins at `at`, row by row."""
    x, y, z, w = q[at + 3 : at + 7].tolist()
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    return (
        1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy),
        2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx),
        2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy),
    )  # fmt: skip


def _turned(R: tuple[float, ...], v: Sequence[float]) -> tuple[float, float, float]:
    """The vector R v."""
    (a, b, c, d, e, f, g, h, i), (x, y, z) = R, v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z
