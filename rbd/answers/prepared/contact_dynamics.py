"""Answers at many states for contacts on ground at rest, each on a body of its own; constants are computed once.

A plan (`rbd.answers.prepared.constraint_dynamics`) finds the answer to each state; what judges them, and what they are in
world axes, is computed for a block of states in array operations. What is not covered gets None, and is solved one by one:
contacts of other kinds, on moving ground or on bodies, two on one body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.answers.prepared.constraint_dynamics import Plan
from rbd.answers.prepared.contact_bodies import (
    MOST,
    ContactBodies,
    Site,
    Workspace,
    covered,
    keep,
    plane_gaps,
    rotations,
)
from rbd.arrays import Array, each_times
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.problem.answer import CARRIES_NOTHING_N
from rbd.problem.corner_cones import WrenchCone
from rbd.problem.force_set import at_rest
from rbd.problem.ground import TOUCHES
from rbd.problem.residuals import SOLVED

BLOCK = 512
"""States whose working arrays are in memory at a time; of two soles on a Talos 1.5 MB."""


@dataclass(frozen=True, eq=False)
class BlockAnswer:
    """Answers at the n states of a block.

    Attributes:
        found: Which are certified, shape (n,), truth values; the other rows mean nothing.
        a: Accelerations, shape (n, nv).
        forces: Of each contact, world axes, shapes (n, 3) or (n, 6).
        corner_forces: Of each contact, world axes, shapes (n, k, 3).
        friction_used: Of each contact, shape (n,); NaN where there is none.
        centre_of_pressure: Of each contact, shape (n, 3); NaN where unloaded.
        residuals: {equation: upper bound of its scaled residual, shape (n,)}.
        method: Which of `METHODS` found them, shape (n,); -1 where none did.
        distant: Which have a contact off its plane, shape (n,).
        still: Largest acceleration of a contact point [m/s2], or of a bilateral row, shape (n,).
        moving: Which have a bilateral contact with a velocity, shape (n,).
    """

    found: Array
    a: Array
    forces: list[Array]
    corner_forces: list[Array]
    friction_used: list[Array]
    centre_of_pressure: list[Array]
    residuals: dict[str, Array]
    method: Array
    distant: Array
    still: Array
    moving: Array


class ContactDynamics:
    """Contacts of one robot, prepared.

    Attributes:
        bodies: The bodies in contact, which sets of contacts with other friction share.
        force_set: Of the contacts at rest.
        bilateral: Whether none can break or slip.
        G: Row forces of unit weights, in the axes of `bodies`, shape (m, p).
    """

    def __init__(self, bodies: ContactBodies, contacts: tuple[Contact, ...]) -> None:
        self.bodies, self._contacts = bodies, contacts
        self.force_set = T = at_rest(*[contact.cone for contact in contacts])
        self.bilateral = T.bilateral
        self.G = np.array(T.G, order="C")
        for contact, rows in zip(contacts, bodies.rows, strict=True):
            if contact.turned is not None:
                self.G[rows] = contact.turned @ self.G[rows]
        self._plan = Plan.of(bodies.robot, contacts)
        self._gaps, self._heights = plane_gaps(bodies.robot, contacts, bodies.joints.tolist())

    def off_plane(self, X: Array) -> Array:
        """Largest distance of a corner from the plane on which it stands, where that is known, shape (n,) [m]."""
        return np.abs(X @ self._gaps.T - self._heights).max(axis=1, initial=0.0)

    def solve(
        self, q: Array, v: Array, generalised: Array, *, coulomb: bool, rest_speed: float, mu: Array | None
    ) -> BlockAnswer:
        """Accelerations and forces at n states, certified.

        Args:
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            generalised: S^T tau + tau_ext, shape (n, nv).
            coulomb: Coulomb's law; else the convex one.
            rest_speed: States with a frictional contact that moves faster are not answered [m/s, rad/s].
            mu: Friction of the points at each state, shape (n, k); None: the contacts' own.
        """
        n, bodies, plan = len(q), self.bodies, self._plan
        a, w = np.zeros(v.shape), np.zeros((n, self.force_set.size))
        X, method, u = np.zeros((n, 12 * len(bodies.sites))), np.full(n, -1, np.int8), np.zeros(w.shape)
        modes = np.zeros((n, len(self.force_set.elements)), np.int8)
        with plan.workspace() as space:
            for i in range(n):
                found = plan.search(space, q[i], v[i], generalised[i], rest_speed, coulomb, None if mu is None else mu[i])
                X[i] = bodies.placements(space)
                if found is not None:
                    a[i], w[i], u[i], modes[i], method[i] = found.a, found.w, found.u, found.modes, found.how
            method[modes.any(axis=1)] = -1  # what slides or opens is judged alone
            moving = np.asarray((np.abs(u) > rest_speed).any(axis=1))
            return self.judged(space, q, v, generalised, a, w, X, method, moving, coulomb=coulomb, mu=mu)

    def judged(
        self, space: Workspace, q: Array, v: Array, generalised: Array, a: Array, w: Array, X: Array, method: Array,
        moving: Array, *, coulomb: bool, mu: Array | None,
    ) -> BlockAnswer:  # fmt: skip
        """The certificate of n answers, and what they are in world axes.

        Args:
            space: Used.
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            generalised: S^T tau + tau_ext, shape (n, nv).
            a: Accelerations, shape (n, nv).
            w: Weights of the force set, shape (n, p).
            X: Placements of the bodies, shape (n, 12 sites).
            method: Numbers of what found them, shape (n,); -1 where nothing did.
            moving: Which have a bilateral contact with a velocity, shape (n,).
            coulomb: Coulomb's law; else the convex one.
            mu: As of `solve`.
        """
        f = w @ self.G.T
        left, c = self.bodies.checked(space, q, v, generalised, a, f, X)
        c = self.bodies.in_row_axes(c, X)
        used = np.broadcast_to(self.force_set.mu, (len(q), len(self.force_set.mu))) if mu is None else mu
        # States along the last axis: maxima are four times as fast.
        residuals = {"stationarity": np.abs(np.ascontiguousarray(left.T)).max(axis=0), **self._misses(c, w, used, coulomb)}
        with np.errstate(invalid="ignore"):
            found = (method >= 0) & (np.maximum.reduce(list(residuals.values())) <= SOLVED)
        still = np.abs(c if self.bilateral else c @ self.G).max(axis=1)
        world = self._in_world(f, w, used, X)
        return BlockAnswer(found, a, *world, residuals, method, self.off_plane(X) > TOUCHES, still, moving)

    def _misses(self, c: Array, w: Array, mu: Array, coulomb: bool) -> dict[str, Array]:
        """Upper bounds of the scaled residuals of the law."""
        if self.bilateral:
            none = np.zeros(len(c))
            return {"feasibility": np.abs(c).max(axis=1), "cone": none, "complementarity": none}
        T, y = self.force_set, c @ self.G
        at = T.cone_columns.ravel()
        sinks, outside, far = point_misses(y[:, at], w[:, at], mu, coulomb=coulomb)
        lines = np.delete(y, at, axis=1)
        sinks = np.maximum(np.abs(lines).max(axis=1, initial=0.0), sinks)
        return {"feasibility": sinks, "cone": outside, "complementarity": far}

    def _in_world(self, f: Array, w: Array, mu: Array, X: Array) -> tuple[list[Array], list[Array], list[Array], list[Array]]:
        """Forces, corner forces, friction used and centres of pressure of each contact at n states, as of `BlockAnswer`."""
        n, T, R_WJ = len(f), self.force_set, rotations(X)
        forces, corners, friction, pressures = list[Array](), list[Array](), list[Array](), list[Array]()
        for k, (contact, site, rows) in enumerate(zip(self._contacts, self.bodies.sites, self.bodies.rows, strict=True)):
            R, own = R_WJ[:, k], f[:, rows]
            centre = R @ site.X_JC.translation + X[:, 12 * k + 9 : 12 * k + 12]
            if site.size == 6:
                axes, local = R @ site.X_JC.rotation, own
                forces.append(each_times(axes[:, None], own.reshape(n, 2, 3)).reshape(n, 6))
            else:
                turn = np.eye(3) if contact.turned is None else contact.turned
                axes, local = np.broadcast_to(turn, (n, 3, 3)), own @ turn
                forces.append(own.copy())
            if contact.friction is not None:
                points = w[:, T.slices[k]].reshape(n, -1, 3)
            elif len(contact.corners) > 1:
                points = (local @ _corner_split(contact)).reshape(n, -1, 3)
            else:
                points = local[:, None, :3]
            corners.append(points @ axes.transpose(0, 2, 1))
            with np.errstate(invalid="ignore", divide="ignore"):
                loaded = np.where(local[:, 2] >= CARRIES_NOTHING_N, local[:, 2], np.nan)
                if contact.friction is None:
                    friction.append(np.full(n, np.nan))
                else:
                    first = int(np.searchsorted(T.cone_at, T.slices[k].start))
                    friction.append(np.hypot(local[:, 0], local[:, 1]) / (mu[:, first] * loaded))
                if site.size == 6:
                    at = np.stack([-local[:, 4] / loaded, local[:, 3] / loaded, 0.0 * loaded], axis=1)
                    pressures.append(centre + each_times(axes, at))
                else:
                    pressures.append(np.where(np.isnan(loaded)[:, None], np.nan, centre))
        return forces, corners, friction, pressures


def _corner_split(contact: Contact) -> Array:
    """Forces of least norm at the corners of a patch, shape (6, 3 k), for unit wrenches."""
    return np.linalg.pinv(WrenchCone(contact.corners, 0.0).corner_map).T


def prepared(robot: CheckedModel, contacts: tuple[object, ...]) -> ContactDynamics | None:
    """The prepared form of a robot's contacts, kept with the robot; None where they are not covered.

    Raises:
        FrameNotFound: with the nearest names.
    """
    known: dict[object, ContactDynamics | None] = robot.kept
    try:
        return known[contacts]
    except KeyError:
        pass
    except TypeError:  # objects that cannot be keys
        return None
    found = None
    if covered(robot, contacts):
        given: tuple[Contact, ...] = contacts  # type: ignore[assignment]
        found = ContactDynamics(ContactBodies.of(robot, tuple([Site.of(robot, c) for c in given])), given)
    keep(known, contacts, found, MOST)
    return found


def point_misses(y: Array, w: Array, mu: Array, *, coulomb: bool) -> Array:
    """The largest of the points at each of n states, shape (3, n), scaled; NaN or infinite where a number is not finite.

    How far accelerations are from those allowed, weights from their cones, and both from their law.

    Args:
        y: Accelerations of the points (tangent, tangent, normal), shape (n, 3k).
        w: Weights, likewise.
        mu: Friction coefficients, shape (n, k).
        coulomb: Coulomb's law; else the convex one.
    """
    out = np.empty((len(y), 3))
    y, w, mu = (np.ascontiguousarray(each) for each in (y, w, mu))
    from rbd.solvers import law_kernel  # imports Numba

    law_kernel.point_misses(y, w, mu, coulomb, out)
    return out.T
