"""Answers for contacts on ground at rest, in the few rows of the bodies in contact; constants are computed once.

    sticking    s = 0, if the corner forces of minimum norm are inside their cones
    slipping    y = G^T (L^-1 G w - L^-1 f_0),  forces f = G w, weights w and accelerations y under the law

with L and f_0 of `rbd.answers.prepared.contact_bodies`, which also judges what was found. What is not covered gets None, and is
solved the general way: contacts of other kinds, on moving ground or on bodies, two on one body, linearly dependent rows.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from rbd.answers.prepared.contact_bodies import ContactBodies
from rbd.answers.prepared.sites import kept_bodies, kept_form
from rbd.arrays import Array, max_abs
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.problem.force_set import ForceSet, at_rest
from rbd.solvers.contact_newton import ContactNewton, law_residual
from rbd.solvers.newton import FOUND

DOUBTFUL = 1e-6
"""Upper bounds of the scaled residuals above this are not looked into: the general way is taken."""
_FEW = 16
"""Points up to which one matrix tells which are inside their cones."""


class FoundForces(NamedTuple):
    """Acceleration and forces under a law.

    Attributes:
        a: Acceleration, shape (nv,).
        forces: Row forces, shape (m,), in the order and axes of the contacts' rows.
        weights: Of the columns of the contacts' force set, shape (p,); None where all are bilateral.
        method: What found them.
        steps: Newton's steps.
        worst: Upper bound of its largest scaled residual. Above `SOLVED` the scales themselves have to judge.
        moving: (number, velocity [m/s, rad/s]) of each bilateral contact that moves.
    """

    a: Array
    forces: Array
    weights: Array | None
    method: str
    steps: int = 0
    worst: float = 0.0
    moving: tuple[tuple[int, float], ...] = ()


class ContactDynamics:
    """Contacts of one robot, prepared.

    Attributes:
        bodies: The bodies in contact, which sets of contacts with other friction share.
        force_set: Of the contacts at rest.
        bilateral: Whether none can break or slip.
        G: Row forces of unit weights, in the axes of `bodies`, shape (m, p).
    """

    def __init__(self, bodies: ContactBodies, contacts: tuple[Contact, ...]) -> None:
        self.bodies = bodies
        self.force_set = T = at_rest(*[contact.cone for contact in contacts])
        self.bilateral = T.bilateral
        self._turns = [contact.turned for contact in contacts]
        self._turned = any(turn is not None for turn in self._turns)
        self._frictional = [i for i, contact in enumerate(contacts) if contact.friction is not None]
        self._held = [i for i, contact in enumerate(contacts) if contact.friction is None]
        self.G = self._turn_back(T.G) if self._turned else T.G
        self._pull = np.ascontiguousarray(self.G.T)
        self._least_norm = np.ascontiguousarray(_pseudo_inverse(T) if not self._turned else np.linalg.pinv(self.G))
        self._room = _room_of(T) if len(T.mu) <= _FEW else None
        self._weights_and_squares = np.empty(2 * T.size)
        self._newton = ContactNewton(self.G, T.mu) if T.only_cones else None
        planes = [(c.plane, c, X, site) for c, X, site in zip(contacts, bodies.placements, bodies.sites, strict=True)]
        self._planes = [
            (plane, X, site.in_joint_axes(c.corners), plane.level, plane.height) for plane, c, X, site in planes if plane
        ]

    def _turn_back(self, G: Array) -> Array:
        """G with the rows of points in world axes."""
        out = G.copy()
        for turn, rows in self._point_rows():
            out[rows] = turn @ out[rows]
        return out

    def _in_contact_axes(self, forces: Array) -> Array:
        if self._turned:
            for turn, rows in self._point_rows():
                forces[rows] = turn.T @ forces[rows]
        return forces

    def _point_rows(self) -> list[tuple[Array, slice]]:
        ends = np.cumsum([site.size for site in self.bodies.sites]).tolist()
        return [(turn, slice(end - 3, end)) for turn, end in zip(self._turns, ends, strict=True) if turn is not None]

    def touches(self, within: float) -> bool:
        """Whether every corner is near the plane on which it stands, where that is known; after `bodies.held`."""
        for plane, X, corners, level, height in self._planes:
            if level:
                gaps = corners.dot(X.rotation[2])
                gaps += X.translation[2] - height
            else:
                gaps = plane.distances(corners @ X.rotation.T + X.translation)
            if not -within <= gaps[gaps.argmin()] or not gaps[gaps.argmax()] <= within:
                return False
        return True

    def sticking(self, forces: Array) -> tuple[Array, bool]:
        """(weights of minimum norm of row forces, whether they are in their cones)."""
        w = self._least_norm.dot(forces)
        return w, self.inside(w)

    def inside(self, w: Array) -> bool:
        """Whether weights are in their cones, shape (p,)."""
        T = self.force_set
        if self._room is None:
            return in_cones(w, T.cone_at, T.mu) if self._newton is None else _inside(w.reshape(-1, 3).T, T.mu)
        both = self._weights_and_squares
        both[: T.size] = w
        np.multiply(w, w, both[T.size :])
        room = self._room.dot(both)
        return bool(room[room.argmin()] >= 0.0)

    def answer(
        self, q: Array, v: Array, generalised: Array, *, coulomb: bool, rest_speed: float, within: float
    ) -> FoundForces | None:
        """Acceleration and forces under a contact law, certified; None where the general way has to be taken.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau + tau_ext, shape (nv,).
            coulomb: Coulomb's law; else the convex one.
            rest_speed: If a frictional contact moves faster, the general way is taken [m/s, rad/s].
            within: If a corner is farther off its plane, the general way is taken [m].
        """
        bodies, still = self.bodies, blas.ddot(v, v) == 0.0
        with bodies.lock:
            held = bodies.held(q, v, generalised, at_rest=still)
            if held is None or not self.touches(within):
                return None
            a, forces = held
            w, fixed = None, () if still else self._held
            moving = tuple([(i, speed) for i in fixed if (speed := bodies.speed(i)) > rest_speed])
            if not self.bilateral:
                if not still and max(map(bodies.speed, self._frictional)) > rest_speed:
                    return None
                w, inside = self.sticking(forces)
                if not inside:
                    found = self._slipping(q, v, generalised, a, forces, w, coulomb=coulomb, still=still)
                    return found if found is None or not moving else found._replace(moving=moving)
                forces = self.G.dot(w)  # what is judged are the corner forces
            worst = bodies.stationarity(q, v, a, forces, generalised)
            worst = max(worst, 10.0 * max_abs(bodies.row_accelerations(at_rest=still, turned=False)))
            if not worst <= DOUBTFUL:
                return None
            return FoundForces(a, self._in_contact_axes(forces), w, "closed form", 0, worst, moving)

    def _slipping(
        self, q: Array, v: Array, generalised: Array, a: Array, held: Array, start: Array, *, coulomb: bool, still: bool
    ) -> FoundForces | None:
        """The law where the forces that hold all bodies are not in their cones; searched from weights `start`."""
        if self._newton is None:
            return None
        bodies = self.bodies
        mobility = bodies.mobility()
        found = self._newton.found(mobility, -mobility.dot(held), start, coulomb=coulomb)
        if not found.merit <= FOUND:
            return None
        w = found.weights
        forces = self.G.dot(w)
        a += bodies.moved(mobility.dot(forces - held))
        worst = bodies.stationarity(q, v, a, forces, generalised)
        c = bodies.row_accelerations(at_rest=still)
        worst = max(worst, law_residual(self._pull.dot(c), w, self.force_set.mu, coulomb=coulomb))
        if not worst <= DOUBTFUL:
            return None
        return FoundForces(a, self._in_contact_axes(forces), w, "cones: Newton", found.steps, worst)


def in_cones(w: Array, at: Array, mu: Array) -> bool:
    """Whether the weights of each cone (tangent, tangent, normal from column `at` on) are in it."""
    return _inside((w[at], w[at + 1], w[at + 2]), mu)


def _inside(w: Array | tuple[Array, Array, Array], mu: Array) -> bool:
    """`in_cones`, of all tangential and normal weights."""
    x, y, n = w
    n = mu * n
    room = n * n - x * x - y * y
    return bool(n[n.argmin()] >= 0.0 and room[room.argmin()] >= 0.0)


def _room_of(T: ForceSet) -> Array:
    """Maps weights over their squares to n, and mu^2 n^2 - x^2 - y^2, of each cone: both are positive inside."""
    k = len(T.mu)
    out = np.zeros((2 * k, 2 * T.size))
    for i, (at, mu) in enumerate(zip(T.cone_at.tolist(), T.mu.tolist(), strict=True)):
        out[i, at + 2] = 1.0
        out[k + i, T.size + at : T.size + at + 3] = -1.0, -1.0, mu * mu
    return out


@lru_cache(maxsize=256)
def _pseudo_inverse(T: ForceSet) -> Array:
    return np.asarray(np.linalg.pinv(T.G))


def prepared(robot: CheckedModel, contacts: tuple[object, ...]) -> ContactDynamics | None:
    """The prepared form of a robot's contacts, kept with the robot; None where they are not covered.

    Raises:
        FrameNotFound: with the nearest names.
    """
    found: ContactDynamics | None = kept_form(robot, contacts, contacts, _made)
    return found


def _made(robot: CheckedModel, contacts: tuple[Contact, ...]) -> ContactDynamics:
    return ContactDynamics(kept_bodies(robot, contacts, ContactBodies), contacts)
