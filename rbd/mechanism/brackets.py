"""Lie brackets of velocity fields on a robot's configurations, whose velocities are no derivatives of coordinates.

A field X gives a velocity X(q), shape (nv,), at every configuration. With q' = v read as Pinocchio does (a floating base's v
in the base's own axes), the bracket is

    [X, Y] = dY . X - dX . Y + ad(X) Y ,

ad the structure constants of these velocities: zero for joints whose v is the derivative of q, w x u and the like for bodies
that turn. Without the last term a skate on a planar joint, whose row is the constant (0, 1, 0), would seem to be integrable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rbd.arrays import Array
from rbd.mechanism.held import Held, pieces
from rbd.model.checked_model import CheckedModel

Fields = Callable[[Array], Array]
"""q -> velocities without units, shape (nv, k), one column a field."""

STEP = 0.01
"""Step of the differences, without units."""

_NODES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0  # sixth order


def ad(robot: CheckedModel, X: Array, Y: Array) -> Array:
    """The bracket of velocities that are constant in their own axes, shape (nv,) [velocity squared]."""
    out = np.zeros(robot.nv)
    for piece in pieces(robot):
        x, y = X[piece.v : piece.v + piece.nv], Y[piece.v : piece.v + piece.nv]
        if piece.kind == "sphere":
            out[piece.v : piece.v + 3] = np.cross(x, y)
        elif piece.kind == "plane":
            out[piece.v : piece.v + 2] = -x[2] * y[1] + y[2] * x[1], x[2] * y[0] - y[2] * x[0]
        elif piece.kind == "space":
            out[piece.v : piece.v + 3] = np.cross(x[3:], y[:3]) - np.cross(y[3:], x[:3])
            out[piece.v + 3 : piece.v + 6] = np.cross(x[3:], y[3:])
    return out


def derivative(held: Held, fields: Fields, q: Array, z: Array) -> Array:
    """Derivatives of the components of fields along z, shape (nv, k), by sixth-order differences."""
    length = float(np.linalg.norm(z))
    if length < 1e-12:
        return np.zeros_like(fields(q))
    values = [w * fields(held.move(q, (node * STEP / length) * z)) for w, node in zip(_WEIGHTS, _NODES, strict=True)]
    return np.sum(values, axis=0) * (length / STEP)


def brackets(held: Held, X: Fields, Y: Fields, pairs: Sequence[tuple[int, int]]) -> Fields:
    """The fields [X_i, Y_j] of the pairs (i, j)."""
    D = held.metric

    def fields(q: Array) -> Array:
        x, y = X(q), Y(q)
        rises = {i: derivative(held, Y, q, x[:, i]) for i in {i for i, _ in pairs}}
        falls = {j: derivative(held, X, q, y[:, j]) for j in {j for _, j in pairs}}
        columns = [rises[i][:, j] - falls[j][:, i] + ad(held.robot, D * x[:, i], D * y[:, j]) / D for i, j in pairs]
        return np.column_stack(columns) if columns else np.zeros((held.n, 0))

    return fields
