"""Bodies in contact at many states: two calls of Pinocchio for each state, into existing arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import blas

from rbd.answers.prepared.contact_bodies import DEPENDENT, TURNS, ContactBodies
from rbd.answers.prepared.sites import Site
from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel


class Places(NamedTuple):
    """Where the bodies are at n states.

    Attributes:
        R: Orientations R_WJ of the joints, shape (bodies, n, 3, 3).
        p: Their origins in W, shape (bodies, n, 3) [m].
        independent: At which states the rows are linearly independent, shape (n,), truth values.
    """

    R: Array
    p: Array
    independent: Array


class BlockBodies(ContactBodies):
    """The bodies of a robot that contacts touch, at the states of a block; everything is used under `lock`.

    Attributes:
        rows: The rows of each contact.
    """

    def __init__(self, robot: CheckedModel, sites: Sequence[Site]) -> None:
        super().__init__(robot, sites)
        self.rows, data = self._rows, self._data
        # Views of the data: they follow it, and nothing is made where they are read.
        joints = [site.joint for site in sites]
        self._wrench_views = [self._forces[j].vector for j in joints]
        self._poses = [(data.oMi[j].rotation, data.oMi[j].translation) for j in joints]
        self._acceleration_views = [data.a_gf[j].vector for j in joints]
        self._velocity_views = [velocity.vector[: site.size] for velocity, site in zip(self._velocities, sites, strict=True)]
        self._twist_views = [data.v[j].vector for j in joints]

    def motions(
        self, q: Array, v: Array, generalised: Array, a: Array, f: Array, judge: Callable[[int, bool], None], clear: Array,
        rest_speed: float,
    ) -> Places:  # fmt: skip
        """Hold the bodies at each state: accelerations and row forces go into a and f.

        Args:
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            generalised: S^T tau + tau_ext, shape (n, nv).
            a: Accelerations, shape (n, nv); written.
            f: Row forces, shape (n, m); written.
            judge: Called with a state's number, and whether its contacts rest, while the factors are of that state; it may
                change its a and f.
            clear: It is not called where contacts rest and the row forces make all of clear @ f positive, shape (j, m).
            rest_speed: Contacts that are slower for certain rest [m/s, rad/s].
        """
        n, j, data, factors, moves = len(q), len(clear), self._data, self._factors, np.any(v, axis=1).tolist()
        R, p, pivots = np.empty((len(self.sites), n, 3, 3)), np.empty((len(self.sites), n, 3)), np.empty((n, self.m))
        run, fixed = pin.constraintDynamics, (self._models, self._datas, self._settings)
        model = self._model
        run(model, data, q[0], v[0], generalised[0], *fixed)
        force, own_pivots = data.lambda_c, factors.D[: self.m]  # views that follow
        bodies = [(*pose, R[k], p[k]) for k, pose in enumerate(self._poses)]
        square = blas.ddot  # a third of ndarray.dot's time
        velocities, slow = self._velocity_views, min(TURNS, rest_speed**2)  # |w x v| is at most half the square of (v, w)
        i = -1
        for q_i, v_i, generalised_i in zip(q, v, generalised, strict=True):
            i += 1
            a[i] = run(model, data, q_i, v_i, generalised_i, *fixed)
            f[i] = force
            pivots[i] = own_pivots
            for rotation, translation, rotations, translations in bodies:
                rotations[i] = rotation
                translations[i] = translation
            rests = True
            if moves[i]:
                for velocity in velocities:
                    rests = rests and square(velocity, velocity) <= slow
                if not rests:
                    turning = self._centripetal()
                    if turning is not None:
                        a[i] += self.moved(turning)
                        f[i] += self.inertia() @ turning
            if j and rests:
                room = clear.dot(force)
                if room[room.argmin()] >= 0.0:
                    continue
            judge(i, rests)
        turned = np.ascontiguousarray(pivots.T)
        with np.errstate(invalid="ignore"):  # all are negative
            return Places(R, p, turned.max(axis=0) < DEPENDENT * turned.min(axis=0))

    def loads(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Places]:
        """What a wanted motion takes, and through what forces act, at each state.

        Args:
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv).

        Returns:
            M a + h, shape (n, nv); the rows' Jacobians (n, m, nv) and speeds (n, contacts), the largest entries [m/s, rad/s];
            where the bodies are.
        """
        n, model, data, nc = len(q), self._model, self._data, len(self.sites)
        need, J = np.empty((n, model.nv)), np.empty((n, self.m, model.nv))
        R, p, u = np.empty((nc, n, 3, 3)), np.empty((nc, n, 3)), np.empty((nc, n, 6))
        axes = {3: pin.LOCAL_WORLD_ALIGNED, 6: pin.LOCAL}
        fixed = [
            (rows, site.size, site.joint, site.X_JC, axes[site.size]) for rows, site in zip(self._rows, self.sites, strict=True)
        ]
        bodies = [
            (*pose, twist, R[k], p[k], u[k]) for k, (pose, twist) in enumerate(zip(self._poses, self._twist_views, strict=True))
        ]
        for i in range(n):
            need[i] = pin.rnea(model, data, q[i], v[i], a[i])
            pin.computeJointJacobians(model, data, q[i])
            for rows, size, joint, X, seen in fixed:
                J[i, rows] = pin.getFrameJacobian(model, data, joint, X, seen).reshape(6, -1)[:size]
            for rotation, translation, twist, rotations, translations, twists in bodies:
                rotations[i] = rotation
                translations[i] = translation
                twists[i] = twist
        speeds = np.empty((n, nc))
        for k, site in enumerate(self.sites):
            speeds[:, k] = np.abs(u[k] @ self._to_contact[k].T)[:, : site.size].max(axis=1)
        return need, J, speeds, Places(R, p, np.ones(n, bool))

    def checked(self, q: Array, v: Array, generalised: Array, a: Array, f: Array, places: Places) -> tuple[Array, Array]:
        """(residuals of the equations of motion over lower bounds of their scales, row accelerations), by `pin.rnea`.

        Args:
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            generalised: S^T tau + tau_ext, shape (n, nv).
            a: Accelerations, shape (n, nv).
            f: Row forces, shape (n, m).
            places: As `motions` left them.

        Returns:
            Shapes (n, nv) and (n, m).
        """
        n, moves, sites = len(q), bool(v.any()), list(zip(range(len(self.sites)), self.sites, self._rows, strict=True))
        left, x, u = np.empty((n, self._model.nv)), np.empty((len(sites), n, 6)), np.zeros((len(sites), n, 6))
        wrenches = np.empty((len(sites), n, 6))
        for k, site, rows in sites:
            own = f[:, rows] if site.size == 6 else np.einsum("nij,ni->nj", places.R[k], f[:, rows])
            wrenches[k] = own @ self._dual[k].T
        bodies = list(zip(self._wrench_views, wrenches, self._acceleration_views, x, strict=True))
        twists = list(zip(self._twist_views, u, strict=True)) if moves else []
        run, model, data, forces = pin.rnea, self._model, self._data, self._forces
        i = -1
        for q_i, v_i, a_i in zip(q, v, a, strict=True):
            i += 1
            for slot, wrench, _, _ in bodies:
                slot[:] = wrench[i]
            left[i] = run(model, data, q_i, v_i, a_i, forces)
            for _, _, acceleration, seen in bodies:
                seen[i] = acceleration
            for twist, seen in twists:
                seen[i] = twist
        left -= generalised
        left *= self._per_inertia
        left /= np.maximum(np.abs(a), 1.0)  # M_ii |a_i| is a term of row i
        gravity, c = np.array(self._model.gravity.linear), np.empty((n, self.m))
        for k, site, rows in sites:
            x[k, :, :3] += gravity @ places.R[k]  # rnea leaves a - R^T g
            own = x[k] @ self._to_contact[k].T
            if moves:
                x_1, x_2, x_3, w_1, w_2, w_3 = self._to_contact[k] @ u[k].T
                own[:, 0] += w_2 * x_3 - w_3 * x_2
                own[:, 1] += w_3 * x_1 - w_1 * x_3
                own[:, 2] += w_1 * x_2 - w_2 * x_1
            c[:, rows] = own if site.size == 6 else np.einsum("nij,nj->ni", places.R[k], own[:, :3])
        return left, c
