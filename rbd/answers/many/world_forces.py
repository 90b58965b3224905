"""What weights at many states are in world axes: forces, corner forces, friction used and centres of pressure."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from rbd.answers.many.states import ManyStates
from rbd.answers.prepared.constraint_dynamics import Plan, prepared
from rbd.answers.prepared.contact_bodies import rotations
from rbd.arrays import Array, each_times
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.problem.answer import CARRIES_NOTHING_N
from rbd.problem.cones import Cone, friction_used
from rbd.problem.corner_cones import WrenchCone


def forces_of(states: ManyStates, some: Array, weights: Array) -> Iterator[tuple[str, str, Array, Array]]:
    """(kind, constraint, numbers of states, values there) of answers by plans.

    Args:
        states: The states.
        some: Numbers of those answered.
        weights: Of the columns of their plans, shape (n, p) of all states, or more columns.
    """
    form = prepared(states.robot, states.constraints)
    assert form is not None
    for plan, at in form.plans(states.q[some]):
        part, G, row = some[at], plan.force_set.G, 0
        joints = [states.robot.site(contact.frame)[0] for source in plan.sources for contact in source.contacts]
        X = iter(_placements(states, plan, part, joints))
        for source, columns in zip(plan.sources, plan.force_set.slices, strict=True):
            w, m = weights[part, columns], len(G[row : row + source.cone.dim])
            f, row = w @ G[row : row + m, columns].T, row + m
            if not source.contacts:
                yield "forces", source.name, part, f
            for contact in source.contacts:
                mu = states.friction.get(source.name)
                for kind, values in _of_contact(states.robot, contact, w, f, next(X), None if mu is None else mu[part]):
                    yield kind, source.name, part, values


def _placements(states: ManyStates, plan: Plan, part: Array, joints: list[int]) -> Array:
    """Of some joints at some states, R_WJ by columns, then p_WJ, shape (joints, n, 12)."""
    out = np.empty((len(joints), len(part), 12))
    with plan.workspace() as space:
        places = space.places.reshape(-1, 12)
        for i, q in enumerate(states.q[part] if joints else ()):
            pin.forwardKinematics(states.robot.model, space.data, q)
            out[:, i] = places[joints]
    return out


def _of_contact(
    robot: CheckedModel, contact: Contact, w: Array, f: Array, X: Array, mu: Array | None
) -> Iterator[tuple[str, Array]]:
    """What a contact has at n states, of its weights w and row forces f, the placements of its joint, and its friction."""
    n, k, cone, X_JC = len(w), len(contact.corners), contact.cone, robot.site(contact.frame)[1] * contact.placement
    R_WJ = rotations(X)[:, 0]
    centre, axes = R_WJ @ X_JC.translation + X[:, 9:], R_WJ @ X_JC.rotation
    if k == 1:
        axes = np.broadcast_to(np.eye(3) if contact.turned is None else contact.turned, (n, 3, 3))
    elif k == 2 and contact.normal is not None:  # along the edge, and normal to the ground less its part along it
        x = axes[:, :, 0]
        z = contact.normal - (x @ contact.normal)[:, None] * x
        z /= np.linalg.norm(z, axis=1)[:, None]
        axes = np.stack([x, np.cross(z, x), z], axis=2)
    at = np.eye(3) if k == 1 and cone.bilateral else cone.at_points
    if at is None:
        local, points = f, (f @ np.linalg.pinv(WrenchCone(contact.corners, 0.0).corner_map).T).reshape(n, k, 3)
    else:
        points = (w @ at.T).reshape(n, k, 3)
        local = np.concatenate([points.sum(axis=1), np.cross(contact.corners, points).sum(axis=1)], axis=1)
    parts = local[:, : 3 if k == 1 else 6].reshape(n, -1, 3)
    yield "forces", (parts @ axes.transpose(0, 2, 1)).reshape(n, -1)
    yield "corner_forces", points @ axes.transpose(0, 2, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        load = np.where(local[:, 2] >= CARRIES_NOTHING_N, local[:, 2], np.nan)
        if isinstance(contact.friction, Cone):
            used = np.array(
                [np.nan if np.isnan(N) else friction_used(contact.friction, p) for N, p in zip(load, local, strict=True)]
            )
        else:
            used = np.hypot(local[:, 0], local[:, 1]) / (((contact.friction or np.nan) if mu is None else mu) * load)
        yield "friction_used", used
        arms = 0.0 * local[:, :3] if k == 1 else np.stack([-local[:, 4], local[:, 3], 0.0 * load], axis=1)
        yield "centre_of_pressure", centre + each_times(axes, arms / load[:, None])
