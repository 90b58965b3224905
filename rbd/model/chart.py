"""Local coordinates about a configuration, because q is not an element of a vector space.

    q = q0 (+) xi            xi' = T(xi)^-1 v            T(xi) = d(q0 (+) xi) / d(xi), in the axes that v is given in

xi has the size of v. Of joints whose v is the derivative of their coordinates T is the identity; of planar, spherical and
floating joints it is the right Jacobian of the group's exponential. An integrator of any order on (xi, v) has the same order on
(q, v) [MuntheKaas1999], and unit quaternions stay on their sphere, as q0 (+) xi is always on it.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
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
