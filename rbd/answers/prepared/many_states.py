"""Prepared contacts at many states: Pinocchio's contact dynamics for each state, the rest in array operations over blocks.

What is found at a state, and what judges it, is that of `rbd.answers.prepared.contact_dynamics` and
`rbd.solvers.contact_newton`: the accelerations that hold all contact bodies, the corner forces of minimum norm where these are
in their cones, else Newton's method on the few rows of the bodies; then `pin.rnea`, and the accelerations of the bodies that it
leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rbd.answers.prepared.contact_bodies import BlockBodies, Places
from rbd.answers.prepared.contact_dynamics import ContactDynamics, in_cones
from rbd.answers.prepared.sites import keep, kept_bodies, kept_form
from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.problem.answer import CARRIES_NOTHING_N
from rbd.problem.corner_cones import WrenchCone
from rbd.problem.ground import TOUCHES
from rbd.problem.residuals import SOLVED
from rbd.solvers.contact_newton import LEAST_PUSH, ContactNewton, point_misses
from rbd.solvers.newton import FOUND

BLOCK = 512
"""States whose working arrays are in memory at a time; of two soles on a Talos 1.5 MB."""
METHODS = ("closed form", "closed form", "cones: Newton")
"""Words for bilateral contacts, those that stick, and those that slip or open."""
_COEFFICIENTS = 64
"""Sets of coefficients for which Newton's method is kept."""
_SIDES = 8
"""Of the pyramids inside and around the cones, which decide most states in one product."""


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
        method: Which of `METHODS` found them, shape (n,).
        distant: Which have a contact off its plane, shape (n,).
        moving: Which have a bilateral contact with a velocity, shape (n,).
        still: Largest acceleration of a contact point [m/s2], or of a bilateral row, shape (n,).
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


class ContactBlocks(ContactDynamics):
    """Prepared contacts with what blocks of states need."""

    bodies: BlockBodies

    def __init__(self, bodies: BlockBodies, contacts: tuple[Contact, ...]) -> None:
        super().__init__(bodies, contacts)
        T, self._contacts = self.force_set, contacts
        self._mu, self._lines = T.mu, np.setdiff1d(np.arange(T.size), T.cone_columns)
        self._splits = [
            np.linalg.pinv(WrenchCone(c.corners, 0.0).corner_map).T if len(c.corners) > 1 else None for c in contacts
        ]
        self._newtons: dict[bytes, ContactNewton] = {}
        turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        sides = np.stack([-np.cos(turn), -np.sin(turn), np.zeros(_SIDES)], axis=1)
        inscribed, around = [np.zeros((0, bodies.m))], [np.zeros((0, bodies.m))]
        for at, mu in zip(T.cone_at.tolist(), T.mu.tolist(), strict=True):
            for faces, radius in ((inscribed, mu * np.cos(np.pi / _SIDES)), (around, mu)):
                sides[:, 2] = radius
                faces.append(sides @ self._least_norm[at : at + 3])
        self._surely, self._possibly = np.asfortranarray(np.concatenate(inscribed)), np.asfortranarray(np.concatenate(around))

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
        n, T, moving = len(q), self.force_set, np.zeros(len(q), bool)
        a, f, w = np.empty(v.shape), np.empty((n, self.bodies.m)), np.zeros((n, T.size))
        method = np.full(n, 0 if self.bilateral else 1, np.int8)

        speed, own, possibly, least_norm = self.bodies.speed, self._newton, self._possibly.dot, self._least_norm.dot
        target, compiled = self.bodies.target, not coulomb

        def judge(i: int, rests: bool) -> None:
            """Row i, where the bodies were held: by which method its forces obey the law, -1 where none does."""
            held = f[i]
            if not rests and self._held:
                moving[i] = max(map(speed, self._held)) > rest_speed
            if self.bilateral:
                return
            if not rests and max(map(speed, self._frictional)) > rest_speed:
                method[i] = -1
                return
            newton = own if mu is None else self._newton_of(mu[i])
            if compiled and newton is not None:
                known = newton.release(self.bodies.mobility(), held, w[i], target, self._least_norm)
                if known:
                    if known == 2:
                        a[i] += self.bodies.moved_to_target()
                        method[i] = 2
                    return
            if mu is None:
                room = possibly(held)
                sticks = room[room.argmin()] >= 0.0 and self.inside(least_norm(held))
            else:
                sticks = in_cones(least_norm(held), T.cone_at, mu[i])
            if not sticks:
                method[i] = 2 if self._slips(newton, a[i], held, w[i], coulomb) else -1

        with self.bodies.lock:
            places = self.bodies.motions(
                q, v, generalised, a, f, judge, self._surely if mu is None else self._surely[:0], rest_speed
            )
            if not self.bilateral:
                stick = method <= 1
                w[stick] = f[stick] @ self._least_norm.T
            method[~places.independent] = -1
            found = self.judged(q, v, generalised, a, f, w, places, method, coulomb=coulomb, mu=mu)
            return replace(found, moving=moving)

    def judged(
        self, q: Array, v: Array, generalised: Array, a: Array, f: Array, w: Array, places: Places, method: Array, *,
        coulomb: bool, mu: Array | None,
    ) -> BlockAnswer:  # fmt: skip
        """The certificate of n answers, and what they are in world axes; under the bodies' lock.

        Args:
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            generalised: S^T tau + tau_ext, shape (n, nv).
            a: Accelerations, shape (n, nv).
            f: Row forces in the axes of the bodies, shape (n, m).
            w: Weights of the force set, shape (n, p).
            places: Where the bodies are.
            method: Numbers of what found them, shape (n,); -1 where nothing did.
            coulomb: Coulomb's law; else the convex one.
            mu: As of `solve`.
        """
        n = len(q)
        left, c = self.bodies.checked(q, v, generalised, a, f, places)
        used = np.broadcast_to(self._mu, (n, len(self._mu))) if mu is None else mu
        residuals = self._residuals(left, c, f, w, used, coulomb)
        worst = np.maximum.reduce(list(residuals.values()))
        with np.errstate(invalid="ignore"):
            found = (method >= 0) & (worst <= SOLVED)
        still = np.abs(c if self.bilateral else c @ self.G).max(axis=1)
        return self._in_world(found, a, f, w, used, residuals, method, places, still)

    def _newton_of(self, mu: Array) -> ContactNewton | None:
        """Newton's method with other coefficients; sweeps repeat them."""
        if not self.force_set.only_cones:
            return None
        key = mu.tobytes()
        found = self._newtons.get(key)
        if found is None:
            found = ContactNewton(self.G, mu)
            keep(self._newtons, key, found, _COEFFICIENTS)
        return found

    def _slips(self, newton: ContactNewton | None, a: Array, f: Array, w: Array, coulomb: bool) -> bool:
        """One row by Newton's method on the rows of the contact bodies, in place; whether it found an answer."""
        if newton is None:
            return False
        mobility = self.bodies.mobility()
        free = -mobility.dot(f)
        found = newton.found(mobility, free, self._least_norm.dot(f), coulomb=coulomb)
        if not found.merit <= FOUND:
            return False
        a += self.bodies.moved(mobility.dot(found.wrench - f))
        f[:], w[:] = found.wrench, found.weights
        return True

    def _residuals(self, left: Array, c: Array, f: Array, w: Array, mu: Array, coulomb: bool) -> dict[str, Array]:
        """Upper bounds of the scaled residuals, as `rbd.solvers.contact_newton` has them."""
        T = self.force_set
        # States along the last axis: maxima are four times as fast.
        out = {"stationarity": np.abs(np.ascontiguousarray(left.T)).max(axis=0)}
        if self.bilateral:
            none = np.zeros(len(left))
            return out | {"feasibility": np.abs(c).max(axis=1), "cone": none, "complementarity": none}
        y, at = c @ self.G, T.cone_columns.ravel()
        sinks, outside, far = point_misses(y[:, at], w[:, at], mu, coulomb=coulomb)
        off = np.abs(f - w @ self.G.T) / np.maximum(np.abs(f), LEAST_PUSH)
        sinks = np.maximum(np.abs(y[:, self._lines]).max(axis=1, initial=0.0), sinks)
        return out | {"feasibility": sinks, "cone": np.maximum(outside, off.max(axis=1)), "complementarity": far}

    def _in_world(
        self, found: Array, a: Array, f: Array, w: Array, mu: Array, residuals: dict[str, Array], method: Array,
        places: Places, still: Array,
    ) -> BlockAnswer:  # fmt: skip
        n, T = len(a), self.force_set
        distant = np.zeros(n, bool)
        forces, corners, friction, pressures = [], [], [], []
        for k, (contact, site, rows) in enumerate(zip(self._contacts, self.bodies.sites, self.bodies.rows, strict=True)):
            R, p, own, turn = places.R[k], places.p[k], f[:, rows], contact.turned
            centre = (R.reshape(-1, 3) @ site.X_JC.translation).reshape(n, 3) + p
            if site.size == 6:
                axes = (R.reshape(-1, 3) @ site.X_JC.rotation).reshape(n, 3, 3)
                forces.append(
                    np.concatenate([np.einsum("nij,nj->ni", axes, own[:, 3 * s : 3 * s + 3]) for s in (0, 1)], axis=1)
                )
                local = own
            else:
                axes = np.broadcast_to(np.eye(3) if turn is None else turn, (n, 3, 3))
                forces.append(own.copy())
                local = own if turn is None else own @ turn
            split = self._splits[k]
            if contact.friction is not None:
                points = w[:, T.slices[k]].reshape(n, -1, 3)
            else:
                points = local[:, None, :3] if split is None else (local @ split).reshape(n, -1, 3)
            corners.append(points @ axes.transpose(0, 2, 1))
            normal = local[:, 2]
            with np.errstate(invalid="ignore", divide="ignore"):
                loaded = np.where(normal >= CARRIES_NOTHING_N, normal, np.nan)
                if contact.friction is not None:
                    first = int(np.searchsorted(T.cone_at, T.slices[k].start))
                    friction.append(np.hypot(local[:, 0], local[:, 1]) / (mu[:, first] * loaded))
                else:
                    friction.append(np.full(n, np.nan))
                if site.size == 6:
                    at = np.stack([-local[:, 4] / loaded, local[:, 3] / loaded, 0.0 * loaded], axis=1)
                    pressures.append(centre + np.einsum("nij,nj->ni", axes, at))
                else:
                    pressures.append(np.where(np.isnan(loaded)[:, None], np.nan, centre))
            if contact.plane is not None:
                corners_W = site.in_joint_axes(contact.corners) @ R.transpose(0, 2, 1) + p[:, None]
                distant |= (np.abs(contact.plane.distances(corners_W.reshape(-1, 3))).reshape(n, -1) > TOUCHES).any(axis=1)
        return BlockAnswer(found, a, forces, corners, friction, pressures, residuals, method, distant, still, np.zeros(n, bool))


def prepared_blocks(robot: CheckedModel, contacts: tuple[object, ...]) -> ContactBlocks | None:
    """The prepared form of a robot's contacts for blocks of states, kept with the robot; None where they are not covered.

    Raises:
        FrameNotFound: with the nearest names.
    """
    found: ContactBlocks | None = kept_form(robot, (ContactBlocks, *contacts), contacts, _made)
    return found


def _made(robot: CheckedModel, contacts: tuple[Contact, ...]) -> ContactBlocks:
    return ContactBlocks(kept_bodies(robot, contacts, BlockBodies), contacts)
