"""Constrained accelerations of a robot on fixed contacts by Pinocchio's contact dynamics, without M, J and J_dot v as arrays.

For contacts of full row rank `pin.constraintDynamics` gives the acceleration that holds all their bodies still and the
forces f_0 on them, with the factors of the operational-space inertia L = (J M^-1 J^T)^-1. A row acceleration s then costs

    f = f_0 + L s,        a = a_0 + M^-1 J^T L s

and every contact law is a problem in the few rows of the contact bodies:

    sticking    s = 0, if the corner forces of minimum norm are inside their cones
    slipping    D = G^T L^-1 G,  y = D w - G^T L^-1 f_0,  forces f = G w, weights w and accelerations y under the law

What was found is judged by another route, `rbd.prepared.certificate`. What is not covered gets None, and is solved the
general way: contacts of other kinds, on moving ground or on bodies, two on one body, linearly dependent rows.

Source: [Carpentier2021] for the factors of constrained dynamics.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.model.forks import renewed_after_fork
from rbd.prepared.certificate import Certificate
from rbd.prepared.sites import Site, covered
from rbd.problem.force_set import at_rest
from rbd.problem.residuals import SOLVED

_DEPENDENT = 1e-9
"""Pivots of the contact rows below this, over the largest: rows that may be dependent go the general way."""
_SETTINGS = (1e-10, 1e-10, 0.0, 1)
"""Of Pinocchio's proximal iterations: a single one, without regularisation, is exact where rows are independent."""
_TURNS = 1e-13
"""Centripetal accelerations up to this are rounding [m/s2]."""
MOST = 16
"""Sets of contacts that are kept with a robot."""


class Found(NamedTuple):
    """Acceleration and forces of one law.

    Attributes:
        a: Acceleration, shape (nv,).
        forces: Row forces, shape (m,), in the order and axes of the contacts' rows.
        weights: Of the columns of the contacts' force set, shape (p,); None where all are bilateral.
        method: What found them.
        steps: Newton's steps.
    """

    a: Array
    forces: Array
    weights: Array | None
    method: str
    steps: int = 0


class ContactDynamics:
    """Contacts of one robot, prepared: all that is constant, and the memory for what is not.

    Everything is used under `lock`.

    Attributes:
        robot: The robot.
        contacts: The contacts, in the order of their rows.
        bilateral: Whether none can break or slip.
        lock: For `held`, `solve` and what they leave.
        certificate: Judges what was found.
    """

    def __init__(self, robot: CheckedModel, contacts: tuple[Contact, ...]) -> None:
        self.robot, self.contacts, self.lock = robot, contacts, threading.Lock()
        self.model = model = robot.model
        self.sites = [Site.of(robot, contact) for contact in contacts]
        self._data = data = model.createData()
        self._models, self._datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for site in self.sites:
            made = site.pinocchio(model)
            self._models.append(made)
            self._datas.append(made.createData())
        pin.initConstraintDynamics(model, data, self._models, self._datas)
        self._settings = pin.ProximalSettings(*_SETTINGS)
        self._factors = data.constraint_chol
        self._velocities = [each.contact1_velocity for each in self._datas]
        self.m = m = sum(site.size for site in self.sites)
        self._target = np.zeros(m + model.nv)
        T = at_rest(*[contact.cone for contact in contacts])
        self.force_set, self.bilateral = T, T.bilateral
        self.G = np.ascontiguousarray(self._in_rows(T.G))
        self._least_norm = np.linalg.pinv(self.G)
        k = len(T.mu)
        self._inside = np.zeros((2 * k, 2 * T.size))
        for i, (at, mu) in enumerate(zip(T.cone_at.tolist(), T.mu.tolist(), strict=True)):
            self._inside[i, at + 2] = 1.0
            self._inside[k + i, T.size + at : T.size + at + 3] = -1.0, -1.0, mu * mu
        self._weights_and_squares = np.empty(2 * T.size)
        self.certificate = Certificate(robot, data, self.sites, self.G, T)
        renewed_after_fork(self)

    def _in_rows(self, G: Array) -> Array:
        """G with the rows of points turned from contact axes to Pinocchio's, world axes."""
        out, at = G.copy(), 0
        for site in self.sites:
            if site.turn is not None:
                out[at : at + 3] = site.turn @ out[at : at + 3]
            at += site.size
        return out

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock."""
        self.lock = threading.Lock()

    def held(self, q: Array, v: Array, generalised: Array, *, at_rest: bool) -> tuple[Array, Array] | None:
        """(a, row forces in Pinocchio's axes) that hold the contact bodies; None if the rows may be dependent.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau + tau_ext, shape (nv,).
            at_rest: v is zero.
        """
        a = pin.constraintDynamics(self.model, self._data, q, v, generalised, self._models, self._datas, self._settings)
        m = self.m
        pivots = self._factors.D[:m]
        least = pivots[pivots.argmax()]  # all are negative
        if not least < _DEPENDENT * pivots[pivots.argmin()]:
            return None
        forces = self._data.lambda_c.copy()
        if not at_rest:
            turning = self._centripetal()
            if turning is not None:
                a += self.moved(turning)
                forces += self._factors.getOperationalSpaceInertiaMatrix() @ turning
        return a, forces

    def _centripetal(self) -> Array | None:
        """Row accelerations -(w x v) of patches that move: what Pinocchio's spatial acceleration lacks; None if zero."""
        out, at, moves = np.zeros(self.m), 0, False
        for site, velocity in zip(self.sites, self._velocities, strict=True):
            if site.size == 6:
                x, y, z, p, q, r = velocity.vector.tolist()
                turn = (q * z - r * y, r * x - p * z, p * y - q * x)
                if not max(map(abs, turn)) <= _TURNS:
                    out[at : at + 3] = turn
                    moves = True
            at += site.size
        return -out if moves else None

    def speeds(self) -> list[float]:
        """Speeds of the frictional contacts [m/s, rad/s], the largest of a point and of the turning of a patch."""
        out = []
        for site, velocity in zip(self.sites, self._velocities, strict=True):
            x = velocity.vector
            if site.frictional:
                out.append(max_abs(x if site.size == 6 else x[:3]))
        return out

    def moved(self, s: Array) -> Array:
        """Change of the acceleration by row accelerations s, shape (nv,)."""
        target = self._target
        target[: self.m] = s
        return self._factors.solve(target)[self.m :]

    def sticking(self, forces: Array) -> Array | None:
        """Weights of minimum norm of row forces, if they are in their cones."""
        n, both = self.force_set.size, self._weights_and_squares
        w = self._least_norm.dot(forces)
        both[:n] = w
        np.multiply(w, w, both[n:])
        room = self._inside.dot(both)
        return w if room[room.argmin()] >= 0.0 else None

    def in_contact_axes(self, forces: Array) -> Array:
        """Row forces as the contacts' rows have them, from Pinocchio's."""
        at = 0
        for site in self.sites:
            if site.turn is not None:
                forces[at : at + 3] = site.turn.T @ forces[at : at + 3]
            at += site.size
        return forces

    def answer(self, q: Array, v: Array, generalised: Array, *, coulomb: bool, rest_speed: float) -> Found | None:
        """Acceleration and forces under a contact law, certified; None where the general way has to be taken.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau + tau_ext, shape (nv,).
            coulomb: Coulomb's law; else the convex one.
            rest_speed: A frictional contact that moves faster goes the general way [m/s, rad/s].
        """
        still = np.vdot(v, v) == 0.0
        with self.lock:
            found = self.held(q, v, generalised, at_rest=still)
            if found is None or not self.certificate.touches():
                return None
            a, forces = found
            if self.bilateral:
                w, method = None, "closed form"
            else:
                if not still and max(self.speeds()) > rest_speed:
                    return None
                w, method = self.sticking(forces), "closed form: all points stick"
                if w is None:
                    return None
            judge = self.certificate
            if not judge.stationarity(q, v, a, forces, generalised) <= SOLVED:
                return None
            if not max_abs(judge.row_accelerations(at_rest=still, turned=False)) <= 0.1 * SOLVED:
                return None
            return Found(a, self.in_contact_axes(forces), w, method)


def prepared(robot: CheckedModel, contacts: tuple[object, ...]) -> ContactDynamics | None:
    """The prepared form of a robot's contacts, kept with the robot; None where they are not covered.

    Raises:
        FrameNotFound: with the nearest names.
    """
    kept: dict[tuple[object, ...], ContactDynamics | None] = robot.kept
    try:
        return kept[contacts]
    except KeyError:
        pass
    while len(kept) >= MOST:  # the oldest; another thread may be faster
        kept.pop(next(iter(kept)), None)
    made = kept[contacts] = ContactDynamics(robot, contacts) if covered(robot, contacts) else None  # type: ignore[arg-type]
    return made
