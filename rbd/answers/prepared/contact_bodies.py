"""Constrained accelerations of bodies in contact by Pinocchio's contact dynamics, at one state and at many.

For bodies of full row rank `pin.constraintDynamics` gives the acceleration that holds them all still and the forces f_0 on
them, with the factors of the operational-space inertia L = (J M^-1 J^T)^-1. A row acceleration s then costs

    f = f_0 + L s,        a = a_0 + M^-1 J^T L s

The judgement takes another route. `pin.rnea` at (q, v, a) with the contact forces on their bodies gives the torques that this
motion takes: less those given, that is the residual of the equations of motion, whose rows at a floating base are the balance
of momentum. It leaves the acceleration of every body, from which the row accelerations follow through constant matrices.
Neither M, J and J_dot v as arrays, nor the factors that found the answer, take part.

Rows are in Pinocchio's axes: three of a point in world axes, six of a patch in its own.

Source: [Carpentier2021] for the factors of constrained dynamics.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import blas

from rbd.answers.prepared.sites import Site
from rbd.arrays import Array, block_diagonal, max_abs, zeros
from rbd.model.checked_model import CheckedModel
from rbd.model.data_pool import renewed_after_fork
from rbd.problem.residuals import SOLVED

DEPENDENT = 1e-9
"""Pivots of the contact rows below this, over the largest: rows that may be dependent."""
SETTINGS = (1e-10, 1e-10, 0.0, 1)
"""Of Pinocchio's proximal iterations: a single one, without regularisation, is exact where rows are independent."""
_STILL = 1e-15
"""Squares of a body's velocity up to this leave its centripetal acceleration in the rounding."""
TURNS = 1e-13
"""Centripetal accelerations up to this are rounding [m/s2]."""


class Workspace:
    """Pinocchio's contact dynamics of bodies, and its memory, of megabytes for a humanoid.

    Attributes:
        data: The data.
        models: What holds the bodies still.
        contacts: Its data.
        fixed: The last arguments of `pin.constraintDynamics`.
        factors: Of the constrained dynamics, as `held` left them.
        forces: Forces at all joints, for `pin.rnea`.
    """

    def __init__(self, model: pin.Model, sites: Sequence[Site]) -> None:
        self.data, self.models = model.createData(), pin.StdVec_RigidConstraintModel()
        self.contacts = pin.StdVec_RigidConstraintData()
        for site in sites:
            self.models.append(site.pinocchio(model))
            self.contacts.append(self.models[len(self.models) - 1].createData())
        pin.initConstraintDynamics(model, self.data, self.models, self.contacts)
        self.fixed = (self.models, self.contacts, pin.ProximalSettings(*SETTINGS))
        self.factors, self._size = self.data.constraint_chol, sum(site.size for site in sites)
        self.forces = pin.StdVec_Force()
        for _ in range(model.njoints):
            self.forces.append(pin.Force.Zero())

    def held(self, model: pin.Model, q: Array, v: Array, generalised: Array) -> Array | None:
        """Acceleration that gives every row none, of Pinocchio's spatial kind; None if rows may be dependent."""
        a = pin.constraintDynamics(model, self.data, q, v, generalised, *self.fixed)
        pivots = self.factors.D[: self._size]
        return a if pivots[pivots.argmax()] < DEPENDENT * pivots[pivots.argmin()] else None  # all are negative


class ContactBodies:
    """The bodies of a robot that contacts touch: what is constant, and the memory for what is not.

    Everything is used under `lock`, in the order `held`, `moved`, `stationarity`, `row_accelerations`.

    Attributes:
        robot: The robot.
        sites: The contacts' places on their bodies, in the order of the rows.
        m: Number of rows.
        lock: For all methods, and for what they leave.
        placements: Poses of the bodies in W, as `held` left them.
    """

    def __init__(self, robot: CheckedModel, sites: Sequence[Site]) -> None:
        self.robot, self.sites, self.lock = robot, tuple(sites), threading.Lock()
        self._model = model = robot.model
        self._workspace = space = Workspace(model, sites)
        self._data = data = space.data
        self._factors, self._forces = space.factors, space.forces
        self.m = m = sum(site.size for site in sites)
        ends = np.cumsum([site.size for site in sites])
        self._rows = [slice(int(end) - site.size, int(end)) for end, site in zip(ends, sites, strict=True)]
        self._target = np.zeros(m + model.nv)
        # References into the data: they follow it.
        joints = [site.joint for site in sites]
        self._slots = [self._forces[j] for j in joints]
        self.placements = [data.oMi[j] for j in joints]
        self._accelerations, self._twists = [data.a_gf[j] for j in joints], [data.v[j] for j in joints]
        self._velocities = [each.contact1_velocity for each in space.contacts]
        self._prepare_maps(np.array(model.gravity.linear))
        self._points = [i for i, site in enumerate(sites) if site.size == 3]
        self._per_inertia = 1.0 / robot.least_inertia
        renewed_after_fork(self)

    def _prepare_maps(self, gravity: Array) -> None:
        """Constant matrices: wrenches on the bodies, and row accelerations from those of the bodies.

        The latter are of a - R^T g of each body, and of the third row of its R where gravity is along z, else of R^T g.
        """
        self._gravity = gravity if gravity[:2].any() else None
        fall = float(gravity[2]) if self._gravity is None else 1.0
        self._dual = [site.X_JC.toDualActionMatrix()[:, : site.size] for site in self.sites]
        self._all_dual = block_diagonal(self._dual)
        self._to_contact = [site.X_JC.toActionMatrixInverse() for site in self.sites]
        own = [A[: site.size] for A, site in zip(self._to_contact, self.sites, strict=True)]
        self._accelerate = np.hstack([block_diagonal(own), block_diagonal([fall * A[:, :3] for A in own])])
        self._seen = np.zeros(9 * len(own))

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock."""
        self.lock = threading.Lock()

    def held(self, q: Array, v: Array, generalised: Array, *, at_rest: bool) -> tuple[Array, Array] | None:
        """(a, row forces) that hold the bodies, J a + J_dot v = 0; None if the rows may be dependent.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau + tau_ext, shape (nv,).
            at_rest: v is zero.
        """
        a = self._workspace.held(self._model, q, v, generalised)
        if a is None:
            return None
        forces = self._data.lambda_c.copy()
        if not at_rest:
            turning = self._centripetal()
            if turning is not None:
                a += self.moved(turning)
                forces += self.inertia() @ turning
        return a, forces

    def _centripetal(self) -> Array | None:
        """Row accelerations -(w x v) of patches that move: what Pinocchio's spatial acceleration lacks; None if zero."""
        out, moves = zeros(self.m), False
        for site, rows, velocity in zip(self.sites, self._rows, self._velocities, strict=True):
            u = velocity.vector
            if site.size == 6 and blas.ddot(u, u) > TURNS:  # |w x v| is at most half of that
                x, y, z, p, q, r = u.tolist()
                turn = (r * y - q * z, p * z - r * x, q * x - p * y)
                if not max(map(abs, turn)) <= TURNS:
                    out = out if moves else np.zeros(self.m)
                    out[rows.start : rows.start + 3] = turn
                    moves = True
        return out if moves else None

    def speed(self, i: int) -> float:
        """Largest entry of a site's velocity [m/s, rad/s], as `held` left it."""
        velocity = self._velocities[i].vector
        return max_abs(velocity if self.sites[i].size == 6 else velocity[:3])

    def inertia(self) -> Array:
        """Operational-space inertia L of the rows, shape (m, m)."""
        return np.asarray(self._factors.getOperationalSpaceInertiaMatrix())

    def mobility(self) -> Array:
        """L^-1 = J M^-1 J^T, shape (m, m)."""
        return np.asarray(self._factors.getInverseOperationalSpaceInertiaMatrix())

    @property
    def target(self) -> Array:
        """Where `moved_to_target` takes row accelerations from, shape (m or more,): its first m entries are to be written."""
        return self._target

    def moved_to_target(self) -> Array:
        """`moved`, by the row accelerations in `target`."""
        return np.asarray(self._factors.solve(self._target)[self.m :])

    def moved(self, s: Array) -> Array:
        """M^-1 J^T L s: the change of the acceleration by row accelerations s, shape (nv,)."""
        self._target[: self.m] = s
        return self.moved_to_target()

    def stationarity(self, q: Array, v: Array, a: Array, forces: Array, generalised: Array) -> float:
        """Residual of the equations of motion, scaled; leaves the bodies' accelerations for `row_accelerations`.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Acceleration, shape (nv,).
            forces: Row forces, shape (m,).
            generalised: S^T tau + tau_ext, shape (nv,).
        """
        if self._points:
            forces = forces.copy()
            for i in self._points:
                forces[self._rows[i]] = self.placements[i].rotation.T.dot(forces[self._rows[i]])
        wrenches, at = self._all_dual.dot(forces), 0
        for slot in self._slots:
            slot.vector = wrenches[at : at + 6]
            at += 6
        left = pin.rnea(self._model, self._data, q, v, a, self._forces)
        left -= generalised
        scaled = max_abs(left * self._per_inertia)
        # Bodies of a few grams may have accelerations of 1e5: then the terms of each equation are its scale.
        return scaled if scaled <= SOLVED else max_abs(left / np.maximum(self._terms(a), 1.0 / self._per_inertia))

    def _terms(self, a: Array) -> Array:
        """|M| |a|, shape (nv,), of the upper triangle that Pinocchio's contact dynamics left."""
        M, size = np.triu(np.abs(self._data.M)), np.abs(a)
        return np.asarray(M @ size + M.T @ size - M.diagonal() * size)

    def row_accelerations(self, *, at_rest: bool, turned: bool = True) -> Array:
        """J a + J_dot v by the bodies' accelerations that `stationarity` left, shape (m,).

        Args:
            at_rest: v is zero.
            turned: Points in world axes; else in those of their bodies.
        """
        seen, at, up = self._seen, 0, 6 * len(self.sites)
        for acceleration, X in zip(self._accelerations, self.placements, strict=True):
            seen[at : at + 6] = acceleration.vector
            seen[up : up + 3] = X.rotation[2] if self._gravity is None else self._gravity.dot(X.rotation)
            at += 6
            up += 3
        c = self._accelerate.dot(seen)
        if not at_rest:
            for rows, A, twist in zip(self._rows, self._to_contact, self._twists, strict=True):
                u = twist.vector
                if blas.ddot(u, u) > _STILL:
                    x, y, z, p, q, r = A.dot(u).tolist()
                    c[rows.start : rows.start + 3] += q * z - r * y, r * x - p * z, p * y - q * x
        if turned:
            for i in self._points:
                c[self._rows[i]] = self.placements[i].rotation.dot(c[self._rows[i]])
        return np.asarray(c)


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
        run, fixed = pin.constraintDynamics, self._workspace.fixed
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
