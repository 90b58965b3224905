"""Bodies in contact: what holds them still, and what judges their motion.

For bodies of full row rank, `rbd.answers.prepared.row_kernel` gives the acceleration a_0 that holds them all still and the
forces f_0 on them, from Pinocchio's M, h and joint Jacobians, with the factors of the operational-space inertia
L = (J M^-1 J^T)^-1. A row acceleration s then costs

    f = f_0 + L s,        a = a_0 + M^-1 J^T L s

The judgement takes another route: `pin.rnea` at (q, v, a) with the contact forces on their bodies.

Rows are three of a point in world axes, or in its body's; six of a patch in its own. What Pinocchio leaves
of the bodies is read as arrays, X of placements (R_WJ by columns, then p_WJ), V of velocities (v, w) and A of accelerations in
joint axes, one body after the other: of one state, shape (12 or 6 times the bodies,), or of n, with n first. What follows from
them is one product with a constant matrix, of the entries or of products of two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, block_diagonal, rows_from
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel

WORLD = pin.Convention.WORLD
"""Of `pin.crba`: leaves the joints' Jacobians in world axes."""
MOST, MOST_BODIES = 64, 16
"""Sets of contacts, and of bodies in contact, that are kept with a robot."""
MOST_SPARE = 2
"""Workspaces that are kept with a set of bodies."""

OF_BODY, OF_BASE, OF_BASE_TWO, OF_LINK = 0, 2, 3, 4
"""Axes of rows, as of `row_kernel`, which imports Numba."""
NO_MOTION = (0.0,) * 18
"""Of ground at rest, and of what does not turn."""


@dataclass(frozen=True, eq=False)
class Site:
    """The place of one contact on the body of one joint.

    Attributes:
        joint: The joint's number.
        X_JC: From the joint to the contact's centre and axes.
        size: Number of rows: 3 of a point, in world axes; 6 of a patch, in its own.
        axes: Of the rows, as of `row_kernel`; None: as said. Of the surface's, R of X_JC turns them.
        base: The joint of the body that it is on; 0: ground that moves; -1: ground at rest.
        turn: Of a hinge, weld or cross R of its frame on the joint, by rows, and its axes, as of `row_kernel.loop_turn`; of a
            rod its other end on the other body, its length, NaN if none was given, and the sign of its row.
        motion: Of ground that moves: its velocity and acceleration (6 each), and the point where these are given, in the world;
            NaN for the point in the joint's axes that follows.
    """

    joint: int
    X_JC: pin.SE3
    size: int
    axes: int | None = None
    base: int = -1
    motion: tuple[float, ...] = NO_MOTION
    turn: tuple[float, ...] = NO_MOTION


class JointEntry(NamedTuple):
    """An entry of a row of joints: velocities of the row are sums of `gear` times those of its dofs."""

    row: int
    dof: int
    gear: float


@cache
def row_kernel() -> ModuleType:
    """`rbd.answers.prepared.row_kernel`, imported with the first bodies that need it: it imports Numba."""
    from rbd.answers.prepared import row_kernel

    return row_kernel


class Workspace:
    """The dynamics of bodies in contact at one state, and its memory; views of Pinocchio's data follow them.

    Attributes:
        data: Pinocchio's.
        sites: Of the sites, as of `row_kernel.body_rows`, shape (sites, 48).
        row_forces: Forces on the rows that hold them, as `held` left them, shape (m,).
        mobility: J M^-1 J^T of the rows, likewise, shape (m, m).
        row_rates: J v of the rows, likewise, shape (m,).
        forces: Forces at all joints, for `pin.rnea`.
        places: Placements of all joints, one after the other, a view: R_Wj by columns, then p_Wj.
        rates: Velocities (v, w) of all joints in their axes, likewise.
        lifts: Their spatial accelerations less that of gravity, as `pin.rnea` leaves them.
        pushes: Forces (f, moment) at all joints, a view of `forces`.
        read: What `row_kernel` reads of Pinocchio's data.
        fixed: What it reads of the model, the sites and the joints' rows.
        memory: What it writes.
    """

    def __init__(self, model: pin.Model, sites: Sequence[Site], units: Sequence[JointEntry] = ()) -> None:
        self._model, self.data, self.forces = model, model.createData(), pin.StdVec_Force()
        for _ in range(model.njoints):
            self.forces.append(pin.Force.Zero())
        n, joints, data = model.nv, range(model.njoints), self.data
        m = sum(site.size for site in sites) + len({unit.row for unit in units})
        self.places = rows_from([(X.rotation, X.translation) for X in (data.oMi[j] for j in joints)], 12).reshape(-1)
        self.rates, self.lifts, self.pushes = (
            rows_from([(x.linear, x.angular) for x in (parts[j] for j in joints)], 6).reshape(-1)
            for parts in (data.v, data.a_gf, self.forces)
        )
        starts = np.cumsum([0, *(site.size for site in sites)])
        last = [-1, *(model.idx_vs[j] + model.nvs[j] - 1 for j in joints if j)]
        kinds = [
            (s.joint, last[s.joint], at, s.size, int(s.size == 3) if s.axes is None else s.axes, s.base, last[max(s.base, 0)])
            for s, at in zip(sites, starts, strict=False)
        ]
        places = [[*site.X_JC.rotation.ravel(), *site.X_JC.translation, *site.motion, *site.turn] for site in sites]
        self.sites = np.array(places, dtype=float).reshape(-1, 48)
        self._kernel, self._parents = row_kernel(), np.array(data.parents_fromRow, dtype=np.int64)
        self.memory = np.zeros(self._kernel.size_of(n, m))
        terms = self._kernel.terms_in(self.memory, n, m)
        self.mobility, self.row_rates, self.row_forces = terms.mobility, terms.velocity, np.zeros(m)
        self.read = (
            data.M.reshape(n, n),  # of one degree of freedom Pinocchio gives vectors
            data.J.reshape(6, n),
            data.nle,
            self.places.reshape(-1, 12),
            self.rates.reshape(-1, 6),
            self.lifts.reshape(-1, 6),
        )
        self.fixed = (
            self._parents,
            np.array(kinds, dtype=np.int64).reshape(-1, 7),
            self.sites,
            np.array([unit[:2] for unit in units], dtype=np.int64).reshape(-1, 2),
            np.array([unit.gear for unit in units], dtype=float),
            np.array(model.gravity.linear),
        )

    def terms(self, model: pin.Model, q: Array, v: Array) -> None:
        """Compute what `row_kernel` reads, of a model with the same joints, perhaps other rotor inertias."""
        pin.crba(model, self.data, q, WORLD)
        pin.nonLinearEffects(model, self.data, q, v)

    def held(self, q: Array, v: Array, generalised: Array, model: pin.Model | None = None) -> Array | None:
        """Acceleration a that gives every row none, J a + J_dot v = 0; None if rows may be dependent.

        The forces for it are `row_forces`.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau + tau_ext, shape (nv,).
            model: In place of the robot's, one with other rotor inertias.
        """
        a = np.empty(len(v))
        self.terms(self._model if model is None else model, q, v)
        firm = self._kernel.row_terms(*self.read, *self.fixed, v, generalised, self.memory, a, self.row_forces)
        return a if firm else None


class Workspaces:
    """Workspaces of a model and its rows, each for one user at a time.

    Args:
        model: The model.
        sites: Places of the rows of bodies.
        units: Entries of the rows of joints.
    """

    def __init__(self, model: pin.Model, sites: Sequence[Site], units: Sequence[JointEntry] = ()) -> None:
        self._of, self.spare = (model, sites, units), list[Workspace]()

    def taken(self) -> Workspace:
        """A workspace that nobody else uses, until it is `put_back`."""
        try:
            return self.spare.pop()
        except IndexError:
            return Workspace(*self._of)

    def put_back(self, space: Workspace) -> None:
        """The end of the use of a workspace."""
        if len(self.spare) < MOST_SPARE:
            self.spare.append(space)

    @contextmanager
    def workspace(self) -> Iterator[Workspace]:
        """A workspace for the block."""
        space = self.taken()
        try:
            yield space
        finally:
            self.put_back(space)


class ContactBodies(Workspaces):
    """The bodies of a robot that contacts touch, as `prepared` and a time step have them: what is constant.

    Attributes:
        robot: The robot.
        sites: The contacts' places on their bodies, in the order of the rows.
        joints: Their joints, shape (sites,).
        rows: The rows of each.
        m: Number of rows.
        row_rates: Velocities of the rows by those (v, w) of the bodies; points in the joint's axes. Shape (m, 6 sites).
    """

    def __init__(self, robot: CheckedModel, sites: Sequence[Site]) -> None:
        super().__init__(robot.model, sites)
        self.robot, self.sites, self.joints = robot, tuple(sites), np.array([site.joint for site in sites])
        ends = np.cumsum([site.size for site in sites]).tolist()
        self.rows, self.m = [slice(end - site.size, end) for end, site in zip(ends, sites, strict=True)], ends[-1]
        self.row_rates = block_diagonal([site.X_JC.toActionMatrixInverse()[: site.size] for site in sites])
        #: Where the bodies are among all joints' placements, and among their velocities.
        self._twelve, self._six = ((size * self.joints[:, None] + np.arange(size)).ravel() for size in (12, 6))

    @classmethod
    def of(cls, robot: CheckedModel, sites: Sequence[Site]) -> ContactBodies:
        """Those of a robot, by the values of their sites: contacts are often made anew, with another friction."""
        key = cls, value_of(tuple(sites))
        found: ContactBodies | None = robot.kept_bodies.get(key)
        if found is None:
            found = cls(robot, sites)
            keep(robot.kept_bodies, key, found, MOST_BODIES)
        return found

    def placements(self, space: Workspace) -> Array:
        """X of the bodies, as `held` left it, shape (12 sites,)."""
        return space.places[self._twelve]

    def velocities(self, space: Workspace) -> Array:
        """V of the bodies, as Pinocchio's kinematics or `inverse_dynamics` left it, shape (6 sites,)."""
        return space.rates[self._six]

    def lifts(self, space: Workspace) -> Array:
        """Their spatial accelerations less that of gravity, as `inverse_dynamics` left them, shape (6 sites,)."""
        return space.lifts[self._six]

    def inverse_dynamics(self, space: Workspace, q: Array, v: Array, a: Array, wrenches: Array) -> Array:
        """M a + h less the generalised forces of wrenches on the bodies in joint axes, shapes (nv,) and (6 sites,)."""
        space.pushes[self._six] = wrenches
        return np.asarray(pin.rnea(self.robot.model, space.data, q, v, a, space.forces))


def rotations(X: Array) -> Array:
    """R_WJ of placements of bodies, shape (..., bodies, 3, 3)."""
    return X.reshape(*X.shape[:-1], -1, 12)[..., :9].reshape(*X.shape[:-1], -1, 3, 3).swapaxes(-1, -2)


def gap_map(body: Array, arms: Array, normals: Array, bodies: int) -> Array:
    """Heights n . (R x + p) of points by the placements X of their bodies: a matrix, shape (k, 12 bodies).

    Args:
        body: The body of each point, shape (k,).
        arms: x, where it is in the body's axes, shape (k, 3) [m].
        normals: n, shape (k, 3).
        bodies: How many.
    """
    k = np.arange(len(arms))
    out = np.zeros((len(arms), bodies, 12))
    out[k, body, :9] = (arms[:, :, None] * normals[:, None]).reshape(-1, 9)
    out[k, body, 9:] = normals
    return out.reshape(len(arms), 12 * bodies)


def plane_gaps(robot: CheckedModel, contacts: Sequence[Contact], joints: Sequence[int]) -> tuple[Array, Array]:
    """(`gap_map` of the corners of contacts whose plane is known, by the placements of some joints; heights of the planes)."""
    points, normals, heights, bodies = list[Array](), list[Array](), list[float](), list[int]()
    for contact in contacts:
        if contact.plane is not None:
            joint, X_JF = robot.site(contact.frame)
            X, k = X_JF * contact.placement, len(contact.corners)
            points += [X.act(corner) for corner in contact.corners]
            normals += [np.asarray(contact.plane.normal)] * k
            heights += [contact.plane.height] * k
            bodies += [list(joints).index(joint)] * k
    gaps = gap_map(np.array(bodies, int), np.reshape(points, (-1, 3)), np.reshape(normals, (-1, 3)), len(joints))
    return gaps, np.array(heights)


def keep(kept: dict[Any, Any], key: object, value: object, most: int) -> None:
    """Store a value under a key; if there are `most` values already, the oldest is removed."""
    while len(kept) >= most:  # another thread may have removed it
        kept.pop(next(iter(kept)), None)
    kept[key] = value


def value_of(x: Any) -> Any:
    """A key that objects of this package with the same values share; of a user's own the objects themselves.

    `rbd.model.content_hash.digest` reads users' objects too, and takes twenty times as long.
    """
    if isinstance(x, np.ndarray):
        return x.shape, x.tobytes()
    if isinstance(x, pin.SE3):
        return x.homogeneous.tobytes()
    if isinstance(x, tuple | list):
        return tuple([value_of(part) for part in x])
    names = _given_names(x.__class__)
    return x if names is None else (type(x), *[value_of(getattr(x, name)) for name in names])


@cache
def _given_names(kind: type) -> tuple[str, ...] | None:
    """The fields that an object of this package was made of; None of others."""
    own = is_dataclass(kind) and kind.__module__.startswith("rbd.")
    return tuple([f.name for f in fields(kind) if f.repr]) if own else None
