"""Contacts with fixed and moving ground, as points on its plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, lazy, zeros
from rbd.constraints.contact_points import Group, Measured, Structure
from rbd.constraints.surface import cone_of, contact_axes
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Cone
from rbd.problem.ground import Ground, motion_of


class OnGround:
    """A contact of a body with the ground: a toe, the corners of a sole, the ends of an edge; its points are in `Grounds`.

    The plane is that of `on`; or goes through the anchor; or through the contact's position at the
    start, with its normal then. A ground with a velocity along its normal moves the plane.

    Args:
        contact: A `rbd.constraints.contact.Contact` with a coefficient of friction, on ground.
        start: State at the start.
    """

    def __init__(self, contact: Any, start: State) -> None:
        self.contact, self.X_FP, self.local = contact, contact.placement, contact.corners
        friction, ground = contact.friction, contact.on
        assert ground is None or isinstance(ground, Ground)
        X_WP = start.moving(contact.frame, self.X_FP, pin.LOCAL)[0]
        self.R = _axes_at(contact, ground, X_WP)
        through = X_WP.translation if contact.anchor is None else getattr(contact.anchor, "translation", contact.anchor)
        if ground is not None and ground.point is not None:
            through = np.asarray(ground.point)
        elif ground is not None and contact.anchor is None:
            through = through - ground.shift(start.t)
        self.normal = self.R[:, 2]
        self.height = float(self.normal @ through)
        self.cone = cone_of(contact.name, self.local[:1], friction, int(contact.facets))
        self.surface = ground if ground is not None and ground.moves else None
        self.point_alone, self.alone = len(self.local) == 1, isinstance(friction, Cone) or self.surface is not None


def _under(surface: Ground, points: Array, velocity: Array) -> tuple[Array, Array]:
    """Velocity and acceleration (Coriolis' included) of moving ground under points that move, in W, shapes (k, 3)."""
    (u, W), (s, dW) = (np.split(x, 2) for x in motion_of(surface))
    r = np.zeros_like(points) if surface.about is None else points - surface.about
    turn = cross_matrix(W)
    under = u + r @ turn.T
    return under, s + r @ cross_matrix(dW).T + (r @ turn.T) @ turn.T + 2.0 * (velocity - under) @ turn.T


def _axes_at(contact: Any, ground: Ground | None, X_WP: pin.SE3) -> Array:
    """R_WC: contact axes at the start, or those of the anchor; for a patch, x along the projection of its x."""
    if len(contact.corners) == 1:
        return contact._axes  # of its normal
    if ground is not None and ground.normal is not None and (ground.point is not None or len(contact.corners) > 2):
        return contact_axes(np.asarray(ground.normal), X_WP.rotation[:, 0])
    if contact.normal is not None:
        return contact_axes(contact.normal)
    return (contact.anchor if isinstance(contact.anchor, pin.SE3) else X_WP).rotation.copy()


class PlanePoints:
    """Points that are fixed to bodies, each above a plane, computed together.

    Let V = (v_0, w) and A = (a_0, alpha) be spatial velocity and J_dot v of a joint's body at W's origin, P a point of it and d
    the direction of a row:

        J = (d, P x d) J_W over the joints that carry the body        velocity = J v
        bias = d . (a_0 + alpha x P + w x (v_0 + w x P))              the last term makes it classical

    Args:
        robot: The robot.
        structure: The points.
        joint: The joint of each point's body, shape (k,).
        local: Gives each point, and its arm from the contact's centre, in its joint's axes, shape (k, 3, 2) [m].
        axes: R_WC of each, shape (k, 3, 3), its normal last.
        height: n . x on the plane of each, shape (k,) [m].
        point_alone: Whether they are contacts at points, whose forces have no moments.
        surface: Moving ground under them all; None: at rest.

    Attributes:
        joints: Of their bodies.
        R: R_WC, shape (3, 3) of one contact, or (k, 3, 3) of each point.
    """

    def __init__(
        self,
        robot: CheckedModel,
        structure: Structure,
        joint: Sequence[int] | Array,
        local: Callable[[], Array],
        axes: Array,
        height: Array,
        *,
        point_alone: bool,
        surface: Ground | None = None,
    ) -> None:
        self.structure, self.point_alone, self.surface, self.axes, self.height = structure, point_alone, surface, axes, height
        self.R, self.joint = axes, np.asarray(joint)
        joints, self._body = np.unique(self.joint, return_inverse=True)
        self.joints = joints.tolist()
        self._robot, self._local, self._normal = robot, local, axes[:, :, 2].copy()

    @lazy
    def local(self) -> Array:
        """Each point, and its arm from the contact's centre, in its joint's axes, shape (k, 3, 2)."""
        return self._local()

    @lazy
    def _rows(self) -> tuple[Array, Array, Array, Array, Array]:
        """Constants of the rows, which steps by the bodies' motion do not need.

        The point of each, shape (m,); [d]_x^T of its direction d, which takes P to P x d; (d, P x d, d), the middle empty; and
        which coordinates move each joint, and each row, of zeros and ones, shapes (nv, joints) and (m, nv).
        """
        row = np.repeat(np.arange(len(self.joint)), self.structure.widths)
        d = np.concatenate([R[:, 3 - width :].T for R, width in zip(self.axes, self.structure.widths.tolist(), strict=True)])
        moves = np.column_stack([self._robot.joints.carrying(joint) for joint in self.joints])
        carries = moves.T[self._body[row]].copy()
        return row, np.array([cross_matrix(x).T for x in d]), np.concatenate([d, np.zeros_like(d), d], axis=1), moves, carries

    def at(self, state: State, t: float) -> Measured:
        """Their points at a state and a time [s]."""
        body, (row, turn, constant, moves, carries) = self._body, self._rows
        R, p, J_W = state.joint_motion(self.joints)
        both = R.take(body, axis=0) @ self.local  # np.take: a third of the cost of R[body]
        P = p.take(body, axis=0) + both[:, :, 0]
        terms = constant.copy()
        terms[:, 3:6] = (turn @ P.take(row, axis=0)[:, :, None])[:, :, 0]
        J = terms[:, :6] @ J_W[:6]
        J *= carries
        of_joints = J_W @ (moves * state.v[:, None])  # v_0, w, a_0, alpha of each
        turning = (_CROSS @ of_joints[3:6]).T.reshape(-1, 3, 3).take(body, axis=0)
        motion = of_joints.T.take(body, axis=0)
        v_P = motion[:, :3, None] + turning @ P[:, :, None]
        rate = np.concatenate([motion[:, 6:], (turning @ v_P)[:, :, 0]], axis=1)
        velocity, bias = J @ state.v, np.vecdot(terms, rate.take(row, axis=0))
        if self.surface is not None:
            u, s = _under(self.surface.at(state.t), P, v_P[:, :, 0])
            velocity, bias = (x - np.vecdot(terms[:, :3], y[row]) for x, y in ((velocity, u), (bias, s)))
        return Measured(
            self.structure, J, velocity, bias, self._above(P, t, state.t), zeros(len(row)),
            None, None if self.point_alone else both[:, :, 1], P, self.R,
        )  # fmt: skip

    def gaps(self, state: State, t: float) -> Array:
        """Distances of their points to their planes, shape (k,) [m]."""
        R, p = state.joint_places(self.joints)
        return self._above(p[self._body] + (R[self._body] @ self.local[:, :, :1])[:, :, 0], t, state.t)

    def _above(self, P: Array, t: float, now: float) -> Array:
        lift = 0.0
        if self.surface is not None:
            lift = self._normal @ self.surface.shift(t if self.surface.moved is None else now)
        return np.asarray(np.vecdot(P, self._normal) - (self.height + lift))


class Grounds(PlanePoints):
    """Points of contacts with the ground.

    Args:
        grounds: The contacts, all at points, or all of patches and edges; one that is `alone` is the only one.
        start: Any state of the robot.

    Attributes:
        members: The contacts.
    """

    def __init__(self, grounds: Sequence[OnGround], start: State) -> None:
        self.members, sites = tuple(grounds), [start.robot.site(ground.contact.frame) for ground in grounds]
        sizes = [len(ground.local) for ground in grounds]
        of = np.repeat(np.arange(len(grounds)), sizes)
        structure = Structure(
            tuple(grounds[j].contact.name for j in of.tolist()),
            tuple(i for size in sizes for i in range(size)),
            tuple(grounds[j].cone for j in of.tolist()),
        )
        super().__init__(
            start.robot, structure, np.array([joint for joint, _ in sites])[of], partial(_places, grounds, sites, of),
            np.array([ground.R for ground in grounds])[of], np.array([ground.height for ground in grounds])[of],
            point_alone=grounds[0].point_alone, surface=grounds[0].surface,
        )  # fmt: skip
        if len(grounds) == 1:
            self.R = grounds[0].R

    @classmethod
    def joined(cls, sources: Sequence[Grounds], start: State) -> Grounds:
        """Several sources as one."""
        return cls([member for source in sources for member in source.members], start)

    @property
    def group(self) -> Group | None:
        """Sources computed together: points; or patches and edges, whose resultants have moments.

        None on moving ground, and of sets that are no circular cones.
        """
        return None if self.members[0].alone else (Grounds.joined, self.point_alone)


def _places(grounds: Sequence[OnGround], sites: Sequence[tuple[int, pin.SE3]], of: Array) -> Array:
    """`PlanePoints.local` of contacts on frames at `sites`; `of`: the contact of each point."""
    patches = [X_JF * ground.X_FP for ground, (_, X_JF) in zip(grounds, sites, strict=True)]
    arms = np.concatenate([ground.local @ X.rotation.T for ground, X in zip(grounds, patches, strict=True)])
    return np.stack([arms + np.array([X.translation for X in patches])[of], arms], axis=2)


_CROSS = np.array([cross_matrix(e) for e in np.eye(3)]).reshape(3, 9).T.copy()
"""Maps w to [w]_x, row by row."""
