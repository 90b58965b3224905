"""Bodies that touch the ground: their points, the rows that hold them still, and their motion as views of Pinocchio's data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, rank_of
from rbd.constraints.ground_points import OnGround
from rbd.model.state import State

INDEPENDENT = 1e-6
"""Singular values below this, over the largest, are those of points on a line, or of dependent rows."""


class Body:
    """The points of one joint's body.

    Args:
        joint: The joint's number.
        points: Their indices.
        arms: Where they are in the joint's axes, shape (k, 3) [m].

    Attributes:
        size: Rows that hold it still: 3 of a single point, 6 of several that are not on a line; 0 of others.
    """

    def __init__(self, joint: int, points: Sequence[int], arms: Array) -> None:
        self.joint, self.points, self.arms = joint, np.array(points), arms
        spread = np.concatenate([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in arms])
        self.size = 3 if len(arms) == 1 else 6 if rank_of(spread, INDEPENDENT) == 6 else 0

    def pinocchio(self, model: pin.Model) -> pin.RigidConstraintModel:
        """What holds it still, in the joint's axes."""
        kind = pin.ContactType.CONTACT_3D if self.size == 3 else pin.ContactType.CONTACT_6D
        place = pin.SE3(np.eye(3), self.arms[0] if self.size == 3 else np.zeros(3))
        return pin.RigidConstraintModel(kind, model, self.joint, place, pin.LOCAL)


def bodies_of(grounds: Sequence[OnGround], start: State) -> list[Body]:
    """The bodies of the points of several contacts, in the order of their joints."""
    of: dict[int, list[tuple[int, Array]]] = {}
    i = 0
    for ground in grounds:
        joint, X_JF = start.robot.site(ground.contact.frame)
        for x in ground.local:
            of.setdefault(joint, []).append((i, (X_JF * ground.X_FP).act(x)))
            i += 1
    return [Body(joint, [i for i, _ in points], np.array([x for _, x in points])) for joint, points in sorted(of.items())]


class TurnedMap:
    """The map (R, x) -> G^T R S x of every point, R of its body, as one constant matrix on products of R's and x's entries.

    Args:
        axes: G of each point, shape (k, 3, 3).
        body: The body of each point, shape (k,).
        S: Shape (k, 3, n).
    """

    def __init__(self, axes: Array, body: Array, S: Array) -> None:
        k, n = len(S), int(body.max()) + 1
        each = np.zeros((k, 3, n, 3, 3, S.shape[2]))
        each[np.arange(k), :, body] = np.einsum("icr,ief->irecf", axes, S)
        whole = each.reshape(3 * k, -1)
        used = np.flatnonzero(whole.any(axis=0))
        of_body, e, c, self._other = np.unravel_index(used, (n, 3, 3, S.shape[2]))
        self._matrix, self._place = whole[:, used].copy(), 12 * of_body + 3 * e + c

    def __call__(self, X: Array, x: Array) -> Array:
        """Shape (p,), from the placements of the bodies and x, each one after the other."""
        out: Array = self._matrix.dot(X.take(self._place) * x.take(self._other))
        return out


def views_of(data: pin.Data, n: int) -> tuple[Array, Array, Array]:
    """Placements, velocities and accelerations of all joints, shapes (n, 12), (n, 6), (n, 6): views that follow the data."""
    places = rows_from([(X.rotation, X.translation) for X in (data.oMi[j] for j in range(n))], 12)
    v, a = (rows_from([(V.linear, V.angular) for V in (of[j] for j in range(n))], 6) for of in (data.v, data.a))
    return places, v, a


def rows_from(parts: Sequence[tuple[Array, Array]], size: int) -> Array:
    """A view of blocks of memory at equal distances, one a row, shape (n, size): each has the first part, then the second."""
    if not parts:
        return np.zeros((0, size))
    at = np.array([[x.__array_interface__["data"][0] for x in pair] for pair in parts])
    first, steps = parts[0][0], np.diff(at[:, 0])
    step = int(steps[0]) if len(steps) else 8 * size
    assert (steps == step).all() and (at[:, 1] - at[:, 0] == 8 * first.size).all(), "Pinocchio's data are laid out otherwise"
    return np.lib.stride_tricks.as_strided(first, (len(parts), size), (step, 8))
