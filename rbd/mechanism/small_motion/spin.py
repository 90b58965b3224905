"""Spin of bodies of revolution: motion in which a body turns about its own axis of symmetry, seen from axes that do not.

A coin that rolls straight on has a constant velocity, and in its own axes, which turn with it, one that turns. For a free
body that is symmetric about an axis (unit twist e), axes that turn slower by eta = s e serve as well: there the velocity v of
a steady motion is constant,

    v' + ad(eta) v = 0        q_s(t) = q_0 (+) t (v - eta)

The coin's place and direction are those of q_s, and its own q = q_s (+) t eta.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.mechanism.frobenius import ad
from rbd.model.checked_model import CheckedModel

_EQUAL = 1e-9
"""Principal moments of inertia that differ by less, relative, are equal."""


def ad_matrix(robot: CheckedModel, v: Array) -> Array:
    """The matrix of ad(v), shape (nv, nv): ad(v) y is the bracket of v and y, both constant in body axes."""
    return np.column_stack([ad(robot, v, along) for along in np.eye(robot.nv)])


def spin_axes(robot: CheckedModel) -> Array:
    """Unit twists about the axes of symmetry of free bodies of revolution, as columns, shape (nv, k).

    Of free-flyers and ball joints without joints beyond them. Of a body with three equal moments each axis through its centre
    of mass: three columns.
    """
    model, out = robot.model, []
    parents = set(int(model.parents[i]) for i in range(1, model.njoints))
    for joint in robot.joints.values():
        piece = joint.pieces[0]
        if len(joint.pieces) > 1 or piece.kind not in ("space", "sphere") or joint.id in parents:
            continue
        body = model.inertias[joint.id]
        moments, axes = np.linalg.eigh(body.inertia)
        close = np.abs(np.diff(moments)) <= _EQUAL * max_abs(moments)
        chosen = {(True, True): (0, 1, 2), (True, False): (2,), (False, True): (0,)}.get((bool(close[0]), bool(close[1])), ())
        for k in chosen:
            twist, axis, offset = np.zeros(robot.nv), axes[:, k], np.cross(body.lever, axes[:, k])
            if piece.kind == "sphere":
                if max_abs(offset) > 1e-12:
                    continue
                twist[piece.v : piece.v + 3] = axis
            else:
                twist[piece.v : piece.v + 6] = np.concatenate([offset, axis])
            out.append(twist)
    return np.array(out).reshape(-1, robot.nv).T


def fitted_spin(robot: CheckedModel, v: Array, a: Array) -> Array:
    """The eta with the least a + ad(eta) v, shape (nv,); zero without bodies of revolution, or where none is needed."""
    axes = spin_axes(robot)
    if not axes.shape[1] or not v.any() or max_abs(a) < 1e-12:
        return np.zeros(robot.nv)
    return axes @ np.linalg.lstsq(ad_matrix(robot, v) @ axes, a, rcond=1e-9)[0]
