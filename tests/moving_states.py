"""Random moving states whose velocities the contacts allow, and accelerations that keep the contacts still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint

LEG = Path(__file__).parents[1] / "urdf" / "parallel_leg.urdf"
NAMES = ("talos", "g1", "solo12", "leg")


@dataclass(frozen=True, eq=False)
class Moving:
    """A robot that moves.

    Attributes:
        state: At (q, v); v keeps the contacts still.
        contacts: What it stands on, or its loops.
    """

    state: rbd.State
    contacts: Sequence[Constraint]


def robot(name: str) -> rbd.Robot:
    """One of `NAMES`; "leg" has three loops, two motors and six passive joints."""
    return rbd.load_robot(LEG) if name == "leg" else rbd.load_robot(name)


def drawn(one: rbd.Robot, rng: np.random.Generator, *, friction: float = 0.7, speed: float = 0.3) -> Moving:
    """Standing, joints about a tenth of a radian off, the feet wherever they then are; or the leg in any of its poses."""
    if one.loops():
        start = one.at("assembled")
        q = rbd.mechanism.assemble(one.at(pin.integrate(one.model, start.q, rng.uniform(-0.25, 0.25, one.nv))), one.loops()).q
        contacts: Sequence[Constraint] = one.loops()
    else:
        step = np.concatenate([np.zeros(6), 0.1 * rng.normal(size=one.nv - 6)])
        q = rbd.robots.posture.stand(one, pin.integrate(one.model, one.standing().q, step), one.feet())
        contacts = one.feet(friction, on=None)
    held = [c.with_friction(None) if hasattr(c, "with_friction") else c for c in contacts]
    state = rbd.mechanism.project_velocity(rbd.State(one, q, speed * rng.normal(size=one.nv)), held)
    return Moving(state, contacts)


def still_at_contacts(moving: Moving, a: Array) -> Array:
    """The acceleration nearest to `a`, entry by entry, with J a + J_dot v = 0 in all rows of the contacts."""
    rows = [c.rows(moving.state) for c in moving.contacts]
    J, bias = np.concatenate([r.J for r in rows]), np.concatenate([r.bias for r in rows])
    for _ in range(2):
        a = a - np.linalg.lstsq(J, J @ a + bias, rcond=1e-10)[0]
    return np.asarray(a)
