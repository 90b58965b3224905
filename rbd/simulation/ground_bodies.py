"""Bodies that touch the ground: their points, the rows that keep them at rest, and their motion in Pinocchio's data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.kept import MOST_BODIES, keep
from rbd.arrays import Array, cross_matrix, rank_of, rows_from
from rbd.constraints.ground_points import OnGround
from rbd.model.checked_model import CheckedModel

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


class TouchingBodies:
    """The bodies of contacts with ground at rest: what of them does not change with where the ground is.

    Args:
        robot: The robot.
        grounds: The contacts.

    Attributes:
        bodies: In the order of their joints.
        covered: Whether each can be held still, by `Body.size` rows.
        joints: Their joints, shape (n,).
        size: Number of all their rows.
        of: The body of each point, shape (k,).
        arms: Where each point is in its joint's axes, shape (k, 3) [m].
        centred: The same from its contact's centre.
        patches: Which bodies have six rows, shape (n,).
        spread: Velocities of the points, in joint axes, by the bodies' (v, w), shape (k, 3, 6n).
        of_rows: The same by velocities of the rows, shape (k, 3, rows).
        shares: Forces of least norm at the points for forces on the rows, shape (k, 3, rows).
        row_velocity: Velocities of the rows by the bodies' (v, w), shape (rows, 6n).
        agrees: Whether the equations of motion were found to be those of M and h; None before they were compared.
        spare: Workspaces that no motion uses.
    """

    def __init__(self, robot: CheckedModel, grounds: Sequence[OnGround]) -> None:
        points: dict[int, list[tuple[int, Array]]] = {}
        k = 0
        for ground in grounds:
            joint, X_JF = robot.site(ground.contact.frame)
            for x in ground.local:
                points.setdefault(joint, []).append((k, (X_JF * ground.X_FP).act(x)))
                k += 1
        self.bodies = [Body(j, [i for i, _ in of], np.array([x for _, x in of])) for j, of in sorted(points.items())]
        self.covered = all([body.size and body.joint for body in self.bodies])
        self.joints = np.array([body.joint for body in self.bodies])
        n, ends = len(self.bodies), np.cumsum([body.size for body in self.bodies]).tolist()
        self.size = ends[-1]
        self.of, self.arms, self.patches = np.zeros(k, int), np.zeros((k, 3)), np.array([b.size == 6 for b in self.bodies])
        self.spread, self.row_velocity = np.zeros((k, 3, 6 * n)), np.zeros((self.size, 6 * n))
        self.of_rows, self.shares = np.zeros((k, 3, self.size)), np.zeros((k, 3, self.size))
        for b, body in enumerate(self.bodies):
            rows, six = slice(ends[b] - body.size, ends[b]), slice(6 * b, 6 * b + 6)
            S = np.array([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in body.arms])
            self.of[body.points], self.arms[body.points] = b, body.arms
            self.spread[body.points, :, six] = S
            if body.size:
                own = np.eye(3)[None] if body.size == 3 else S
                self.of_rows[body.points, :, rows] = own
                self.shares[body.points, :, rows] = np.linalg.pinv(own.reshape(-1, body.size).T).reshape(-1, 3, body.size)
                self.row_velocity[rows, six] = S[0] if body.size == 3 else np.eye(6)
        placements = [robot.site(ground.contact.frame)[1] * ground.X_FP for ground in grounds]
        self.centred = np.concatenate([g.local @ X.rotation.T for g, X in zip(grounds, placements, strict=True)])
        self.agrees: bool | None = None
        self.spare: list[Workspace] = []

    @classmethod
    def prepared(cls, robot: CheckedModel, grounds: Sequence[OnGround]) -> TouchingBodies:
        """Those of a robot and its contacts: computed once, and kept while the robot is in use."""
        known, key = robot.kept_bodies, (cls, *[ground.contact for ground in grounds])
        found: TouchingBodies | None = known.get(key)
        if found is None:
            found = cls(robot, grounds)
            keep(known, key, found, MOST_BODIES)
        return found

    def workspace(self, model: pin.Model) -> Workspace:
        """A workspace that no other motion uses."""
        try:
            return self.spare.pop()
        except IndexError:
            return Workspace(model, self.bodies)


class Workspace:
    """Pinocchio's data of one motion, of megabytes for a humanoid, and views of them.

    Attributes:
        data: The data.
        models: What holds the bodies still.
        contacts: Their data.
        places: Placements of all joints, a view of the data: row j has R_Wj by columns, then p_Wj.
        rates: Velocities (v, w) of all joints in their axes, likewise.
        accelerations: Their spatial accelerations, likewise.
        patch_rates: Velocities (v, w) of the bodies with six rows, as `pin.constraintDynamics` leaves them.
        forces: Forces at all joints.
        pushed: Those of the bodies.
    """

    def __init__(self, model: pin.Model, bodies: Sequence[Body]) -> None:
        self.data, n = model.createData(), model.njoints
        self.models, self.contacts = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for body in bodies:
            self.models.append(body.pinocchio(model))
            self.contacts.append(self.models[len(self.models) - 1].createData())
        pin.initConstraintDynamics(model, self.data, self.models, self.contacts)
        self.places = rows_from([(X.rotation, X.translation) for X in (self.data.oMi[j] for j in range(n))], 12)
        self.rates, self.accelerations = (
            rows_from([(V.linear, V.angular) for V in (of[j] for j in range(n))], 6) for of in (self.data.v, self.data.a)
        )
        held = [contact.contact1_velocity for body, contact in zip(bodies, self.contacts, strict=True) if body.size == 6]
        self.patch_rates = rows_from([(V.linear, V.angular) for V in held], 6)
        self.forces = pin.StdVec_Force()
        for _ in range(n):
            self.forces.append(pin.Force.Zero())
        self.pushed = [self.forces[body.joint] for body in bodies]


MOST_SPARE = 2
"""Workspaces that are kept with a set of contacts."""


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

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        """The matrix; and of each product, which entry of R's and which of x it has."""
        return self._matrix, self._place, self._other

    def __call__(self, X: Array, x: Array) -> Array:
        """Shape (p,), from the placements of the bodies and x, each one after the other."""
        out: Array = self._matrix.dot(X.take(self._place) * x.take(self._other))
        return out
