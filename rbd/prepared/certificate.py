"""The certificate of a prepared answer, by another route than the one that found it.

`pin.rnea` at (q, v, a) with the contact forces on their bodies gives the torques that this motion takes: less those given,
that is the residual of the equations of motion, whose rows at a floating base are the balance of momentum. It leaves the
acceleration of every body, from which the row accelerations follow through constant matrices. Neither M, J and J_dot v, nor
the factors that found the answer, take part.

Each residual is divided by a lower bound of its scale (`rbd.problem.scales`), so an upper bound of the scaled one is judged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, block_diagonal, max_abs
from rbd.model.checked_model import CheckedModel
from rbd.prepared.sites import Site
from rbd.problem.force_set import ForceSet

_POSTURES, _MARGIN = 8, 0.25
_LEAST_PUSH = 1e-3
"""Lower bound of the scale of a point's force [N]: what accelerates a gram at 1 m/s2."""
_TINY = 1e-300


def least_inertia(robot: CheckedModel) -> Array:
    """An estimate from below of min(1, M_ii) at any posture, shape (nv,): a quarter of the least of a few random ones."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    q, least = pin.neutral(model), np.ones(model.nv)
    for _ in range(_POSTURES):
        pin.crba(model, data, q, pin.Convention.WORLD)
        least = np.minimum(least, _MARGIN * data.M.diagonal())
        q = pin.integrate(model, q, rng.uniform(-2.0, 2.0, model.nv))
    return least


class Certificate:
    """What judges the answers of one set of prepared contacts.

    Args:
        robot: The robot.
        data: Left by `pin.constraintDynamics` at the same q: the bodies' placements.
        sites: The contacts.
        G: Row forces of unit weights, in Pinocchio's axes.
        T: The contacts' force set.
    """

    def __init__(self, robot: CheckedModel, data: pin.Data, sites: Sequence[Site], G: Array, T: ForceSet) -> None:
        self._model = model = robot.model
        self._data, self._sites, self._accelerations_of_weights = data, sites, np.ascontiguousarray(G.T)
        self._cones, self._mu, self._only_cones = T.cone_columns, T.mu, T.only_cones
        self._per_inertia = 1.0 / least_inertia(robot)
        self._forces = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._forces.append(pin.Force.Zero())
        # References into the data: they follow it.
        joints = [site.joint for site in sites]
        self._slots = [self._forces[j] for j in joints]
        self._bodies = [(data.a_gf[j], data.oMi[j]) for j in joints]
        self._velocities = [data.v[j] for j in joints]
        self._points = any(site.size == 3 for site in sites)
        dual = [site.X_JC.toDualActionMatrix()[:, : site.size] for site in sites]
        self._dual, self._stacked_dual = dual, block_diagonal(dual)
        ends = np.cumsum([site.size for site in sites])
        self._rows = [slice(int(end) - site.size, int(end)) for end, site in zip(ends, sites, strict=True)]
        # Row accelerations from a - R^T g of each body and the third row of its R: gravity is along z.
        self._to_contact = [site.X_JC.toActionMatrixInverse() for site in sites]
        fall, n = float(model.gravity.linear[2]), len(sites)
        own = [A[: site.size] for A, site in zip(self._to_contact, sites, strict=True)]
        gravity = [fall * A[:, :3] for A in own]
        self._seen = np.zeros(9 * n)
        self._row_accelerations = np.hstack([block_diagonal(own), block_diagonal(gravity)])
        self._uprights = 6 * n
        level = [site for site in sites if site.plane is not None and site.plane.level]
        self._heights = [
            (data.oMi[site.joint], np.ascontiguousarray(site.corners), site.plane.height, site.within)
            for site in level
            if site.plane
        ]
        self._inclined = [site for site in sites if site.plane is not None and not site.plane.level]

    def touches(self) -> bool:
        """Whether every corner is near the plane on which it stands, where that is known."""
        for placement, corners, height, within in self._heights:
            gap = corners.dot(placement.rotation[2])
            gap += placement.translation[2] - height
            if not abs(gap[gap.argmax()]) <= within or not abs(gap[gap.argmin()]) <= within:
                return False
        for site in self._inclined:
            assert site.plane is not None
            X = self._data.oMi[site.joint]
            if not np.abs(site.plane.distances(site.corners @ X.rotation.T + X.translation)).max() <= site.within:
                return False
        return True

    def stationarity(self, q: Array, v: Array, a: Array, forces: Array, generalised: Array) -> float:
        """Residual of the equations of motion, scaled; leaves the bodies' accelerations for `row_accelerations`.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Acceleration, shape (nv,).
            forces: Row forces in Pinocchio's axes, shape (m,).
            generalised: S^T tau + tau_ext, shape (nv,).
        """
        if self._points:
            for slot, dual, rows, site, (_, X) in zip(
                self._slots, self._dual, self._rows, self._sites, self._bodies, strict=True
            ):
                slot.vector = dual.dot(forces[rows] if site.size == 6 else X.rotation.T.dot(forces[rows]))
        else:
            wrenches, at = self._stacked_dual.dot(forces), 0
            for slot in self._slots:
                slot.vector = wrenches[at : at + 6]
                at += 6
        left = pin.rnea(self._model, self._data, q, v, a, self._forces)
        left -= generalised
        left *= self._per_inertia
        return max_abs(left)

    def row_accelerations(self, *, at_rest: bool, turned: bool = True) -> Array:
        """J a + J_dot v by the bodies' accelerations, in Pinocchio's axes, shape (m,).

        Args:
            at_rest: v is zero.
            turned: In Pinocchio's axes; else those of points are in their bodies' axes.
        """
        seen, at, up = self._seen, 0, self._uprights
        for acceleration, X in self._bodies:
            seen[at : at + 6] = acceleration.vector
            seen[up : up + 3] = X.rotation[2]
            at += 6
            up += 3
        c = self._row_accelerations.dot(seen)
        if not at_rest:
            for rows, A, velocity in zip(self._rows, self._to_contact, self._velocities, strict=True):
                x, y, z, p, q, r = A.dot(velocity.vector).tolist()
                c[rows.start : rows.start + 3] += q * z - r * y, r * x - p * z, p * y - q * x
        if turned and self._points:
            for rows, site, (_, X) in zip(self._rows, self._sites, self._bodies, strict=True):
                if site.size == 3:
                    c[rows] = X.rotation.dot(c[rows])
        return c

    def law(self, c: Array, w: Array, *, coulomb: bool) -> float:
        """Residual of the contact law at points in cones, scaled: how fast they sink, and their distance to the law.

        Args:
            c: Row accelerations in Pinocchio's axes.
            w: Weights in their cones, shape (3k,).
            coulomb: Coulomb's law; else the convex one.
        """
        y, p, mu = self._accelerations_of_weights.dot(c).reshape(-1, 3), w.reshape(-1, 3), self._mu
        y_n, slip = y[:, 2], np.hypot(y[:, 0], y[:, 1])
        worst = max(0.0, -float(y_n.min()))
        if not coulomb:
            worst = max(worst, float(((mu * slip - np.maximum(y_n, 0.0)) / (1.0 + mu)).max()))
        push = np.maximum(np.sqrt(np.einsum("ij,ij->i", p, p)), _LEAST_PUSH)
        x = p - push[:, None] * y
        t, n = np.hypot(x[:, 0], x[:, 1]), x[:, 2]
        if coulomb:
            normal = np.maximum(n, 0.0)
        else:
            normal = np.where(t <= mu * n, n, np.maximum((mu * t + n) / (1.0 + mu * mu), 0.0))
        x[:, :2] *= np.minimum(mu * normal / np.maximum(t, _TINY), 1.0)[:, None]
        x[:, 2] = normal
        x -= p
        return max(worst, float((np.abs(x).max(axis=1) / push).max()))
