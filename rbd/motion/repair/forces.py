"""Forces of the centroid's program on a robot's poses: what they ask of its motors, and what they do to its feet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rbd.arrays import Array
from rbd.centroid import CentroidPlan
from rbd.motion.frame_terms import carriers
from rbd.motion.repair.feet import Feet
from rbd.motion.repair.posture import TORQUE_SHARE, Reference
from rbd.motion.repair.sweep import Sweep

NEAR_TORQUE = 0.8
"""Torques beyond this share of what is used of their limits are rows of the centroid's program."""


def torque_rows(
    reference: Reference,
    feet: Feet,
    sweep: Sweep,
    plan: CentroidPlan,
    places: Callable[[Array, Array], Array],
    group: Array,
) -> tuple[Array, Array, Array]:
    """(at, C, h), C f <= h: forces with which motors of legs keep their limits, where those of a plan come near them.

    Args:
        reference: What the poses stay near to, with the limits.
        feet: The feet.
        sweep: The poses, without the forces.
        plan: The forces.
        places: Where forces act, for feet at R, p.
        group: Which foot each of them belongs to, shape (k,).
    """
    feet = feet.at(sweep.R, sweep.p)
    actuated = np.asarray(reference.robot.actuated)
    moves = carriers(reference.robot)[feet.joint][:, actuated]
    legs = moves.any(axis=0)
    J = sweep.J[:, :, None, actuated[legs]]
    points = places(feet.R, feet.p).swapaxes(1, 2)[..., None]
    by_force = (J[:, :3] + np.cross(J[:, 3:], points, axis=1)).transpose(0, 3, 2, 1)
    by_force *= moves[group][:, legs].T[:, :, None]
    need = sweep.need[:, actuated[legs]]
    tau = need - np.einsum("njki,nki->nj", by_force, plan.forces)
    bounds, found = [TORQUE_SHARE * np.abs(x[:, legs]) for x in reference.torques(sweep.v)], []
    size = np.maximum(*bounds)
    for sign, limit in zip((-1.0, 1.0), bounds, strict=True):
        at, j = np.nonzero((sign * tau > NEAR_TORQUE * limit) & (size > 0.0))
        unit = size[at, j]
        found.append((at, -sign * by_force[at, j] / unit[:, None, None], (limit - sign * need)[at, j] / unit))
    at, C, h = (np.concatenate(x) for x in zip(*found, strict=True))
    return at, C, h


def wrenches_on(plan: CentroidPlan, places: Array, group: Array, p: Array) -> Array:
    """Forces of a plan on feet, and moments about their origins p, in W, shape (n, F, 2, 3) [N, N m].

    Args:
        plan: The plan.
        places: Where its forces act, shape (n, k, 3) [m].
        group: Which foot each of them belongs to, shape (k,).
        p: Origins of the feet, shape (n, F, 3) [m].
    """
    out = np.zeros((*p.shape[:2], 2, 3))
    for f in range(p.shape[1]):
        own = group == f
        force = plan.forces[:, own]
        out[:, f, 0] = force.sum(axis=1)
        out[:, f, 1] = np.cross(places[:, own] - p[:, f, None], force).sum(axis=1)
    return out
