"""How each contact point of a record misses the laws of contact: its force by newtons, its motion by metres a second.

A force within the cone allows a point no motion; one on the cone lets it slide against friction, under Coulomb's law along the
surface, under the convex law while it leaves with u_n = mu |u_t|; no force lets it leave. So the set of velocities that go with
a force is a point, a ray or a cone, and a law is missed by the distance of u from that set, and of f from the cone [N].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.audits.kinematics import Balance
from rbd.audits.record import Record
from rbd.displayed import Displayed
from rbd.problem.cones import project_cones


@dataclass(frozen=True, eq=False)
class PointLaws(Displayed):
    """Forces and motions of k points along and across their normals, and by how much they miss each law.

    A point is judged by the velocity u that its step led to; without a step by that of its frame. Where that is nearly zero,
    and friction does not oppose it, u is what its acceleration would make of it within a short time.

    Attributes:
        push: Normal force, shape (k,) [N].
        drag: Tangential force, in W, shape (k, 3) [N].
        leave: Normal velocity, above zero where the bodies part, shape (k,) [m/s].
        slip: Tangential velocity, in W, shape (k, 3) [m/s].
        share: |drag| over friction times push, shape (k,); 1 on the cone, NaN where friction is not known or zero.
        free: Which points have no force to speak of, shape (k,).
        edge: Which forces are on their cone, or outside, shape (k,).
        outside: Distance of the force from its cone, shape (k,) [N].
        coulomb: Distance of the velocity from those that Coulomb's law allows with this force, shape (k,) [m/s].
        convex: The same of the convex law.
        power: Power of the contact on both bodies, shape (k,) [W]: above zero it makes energy.
    """

    push: Array
    drag: Array
    leave: Array
    slip: Array
    share: Array
    free: Array
    edge: Array
    outside: Array
    coulomb: Array
    convex: Array
    power: Array

    @classmethod
    def of(
        cls,
        record: Record,
        balance: Balance,
        friction: Array,
        *,
        least: float,
        on_cone: float,
        still: float,
        after: float,
        angle: float,
    ) -> PointLaws:
        """Of all points of a record.

        Args:
            record: The record.
            balance: The motion of its points.
            friction: Coefficients, shape (k,); NaN where not known.
            least: Force up to which a point counts as free [N].
            on_cone: Share of the friction from which a force is on its cone.
            still: Speed up to which a point without a step is judged by its acceleration [m/s], unless it slides: friction on
                its cone opposes its velocity.
            after: The time for which this lasts [s].
            angle: Within which friction opposes a velocity [degrees].
        """
        f, n, h = record.forces, record.normals, record.step[record.contact_at][:, None]
        push, drag = _split(f, n)
        pull, known = np.linalg.norm(drag, axis=1), ~np.isnan(friction)
        mu = np.where(known, friction, 0.0)
        local = np.column_stack([pull, np.zeros_like(pull), push])
        outside = np.where(known, np.linalg.norm(local - project_cones(local, mu), axis=1), np.maximum(-push, 0.0))
        most = mu * np.maximum(push, 0.0)
        share = np.where(known & (mu > 0.0), pull / np.maximum(most, 1e-12 * (1.0 + pull)), np.nan)
        free, edge, smooth = np.hypot(pull, push) <= least, share >= on_cone, known & (mu == 0.0)
        along = drag / np.maximum(pull, 1e-300)[:, None]
        u = balance.u + h * balance.w
        _, slip = _split(u, n)
        slides = edge & (np.einsum("ki,ki->k", slip, along) <= -np.cos(np.radians(angle)) * np.linalg.norm(slip, axis=1))
        rests = (h[:, 0] == 0.0) & (np.linalg.norm(u, axis=1) <= still) & ~slides
        u = np.where(rests[:, None], after * balance.w, u)
        leave, slip = _split(u, n)
        forth = np.maximum(-np.einsum("ki,ki->k", slip, along), 0.0)  # against the friction
        on_edge = np.hypot(leave, np.linalg.norm(slip + forth[:, None] * along, axis=1))
        size, speed = np.linalg.norm(u, axis=1), np.linalg.norm(slip, axis=1)
        coulomb = np.where(edge, on_edge, size)
        ray = mu[:, None] * n - along
        amount = np.maximum(np.einsum("ki,ki->k", u, ray), 0.0) / (1.0 + mu**2)
        convex = np.where(edge, np.linalg.norm(u - amount[:, None] * ray, axis=1), size)
        dual = project_cones(np.column_stack([speed, np.zeros_like(speed), leave]), 1.0 / np.maximum(mu, 1e-6))
        near = ~(record.gaps > 0.0)  # where the surfaces are apart, anything goes
        without = near * np.maximum(-leave, 0.0), near * np.hypot(dual[:, 0] - speed, dual[:, 2] - leave)
        coulomb, convex = (
            np.where(free, y, np.where(smooth, np.abs(leave), z)) for y, z in zip(without, (coulomb, convex), strict=True)
        )
        power = np.einsum("ki,ki->k", f, balance.u + 0.5 * h * balance.w)
        return cls(push, drag, leave, slip, share, free, edge, outside, coulomb, convex, power)

    def allowed(self, speed: float, angle: float) -> Array:
        """By how much a velocity may miss a law, shape (k,) [m/s]: a speed, or an angle of its direction [degrees]."""
        size = np.hypot(np.linalg.norm(self.slip, axis=1), self.leave)
        return np.maximum(speed, np.sin(np.radians(angle)) * size)


def _split(x: Array, n: Array) -> tuple[Array, Array]:
    """(parts along the normals, shape (k,), the rest, shape (k, 3)) of vectors."""
    along = np.einsum("ki,ki->k", x, n)
    return along, x - along[:, None] * n
