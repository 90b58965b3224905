"""A robot and its contacts as arrays for the kernels: the tree, the sites that may touch, the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import Contact
from rbd.constraints.contact_points import sources_of
from rbd.constraints.ground_points import PlanePoints
from rbd.constraints.joint import JointFriction, JointLimit
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, Unsupported
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.worlds.layout import RUB, STOP, Ground
from rbd.worlds.sites_kernel import Sites
from rbd.worlds.tree_kernel import HINGE, SLIDE, Tree

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
FREE = "JointModelFreeFlyer"


@dataclass(frozen=True, eq=False)
class Packed:
    """A robot's tree.

    Attributes:
        robot: The robot.
        tree: For the kernels.
        turns: Of each joint, from 0 on, the rotation from its own axes to those in which it turns about z.
    """

    robot: CheckedModel
    tree: Tree
    turns: tuple[Array, ...]

    @property
    def dofs(self) -> list[int]:
        """The velocity index of each body's joint."""
        return [int(v) for v in self.robot.model.idx_vs[1:]]

    @property
    def names(self) -> list[str]:
        """Of the joints with one degree of freedom."""
        return list(self.robot.model.names)[1 + self.tree.free :]

    @property
    def driven(self) -> Array:
        """Those of these joints that have motors, in the order of tau, shape (nu,)."""
        own = self.dofs[self.tree.free :]
        return np.array([own.index(int(v)) for v in self.robot.actuated], int)

    @property
    def at(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """(joints, their places in q) of those with one number there, and of those with cosine and sine."""
        model, free = self.robot.model, self.tree.free
        own = range(1 + free, model.njoints)
        found = []
        for size in (1, 2):
            some = [j for j in own if model.joints[j].nq == size]
            found.append((np.array([j - 1 - free for j in some], int), np.array([model.idx_qs[j] for j in some], int)))
        return found[0], found[1]

    @classmethod
    def of(cls, robot: CheckedModel) -> Packed:
        """That of a robot.

        Raises:
            Unsupported: it has other joints than hinges, slides and one floating base at its root, which are named.
        """
        model = robot.model
        free = int(model.njoints > 1 and model.joints[1].shortname() == FREE)
        parent, kind, placement, turns = [], [], [], [np.eye(3)]
        for j in range(1, model.njoints):
            axis, slides = _axis(robot, j) if j > free else ((0.0, 0.0, 1.0), False)
            C = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(axis)).toRotationMatrix()
            turns.append(C)
            X, P = model.jointPlacements[j], turns[model.parents[j]]
            parent.append(model.parents[j] - 1)
            kind.append(SLIDE if slides else HINGE)
            placement.append(np.r_[(P.T @ X.rotation @ C).ravel(), P.T @ X.translation])
        tree = Tree(np.array(parent, int), np.array(kind, int), np.array(placement).reshape(len(parent), 12), free)
        return cls(robot, tree, tuple(turns))

    @property
    def inertia(self) -> Array:
        """Mass, centre of mass, inertia about it (xx, xy, xz, yy, yz, zz) and armature of each body, shape (11 n,)."""
        model, out = self.robot.model, []
        for j in range(1, model.njoints):
            I, C = model.inertias[j], self.turns[j]
            E = C.T @ I.inertia @ C
            one = model.joints[j].nv == 1
            armature = model.armature[model.idx_vs[j]] if one else 0.0
            out += [I.mass, *(C.T @ I.lever), E[0, 0], E[0, 1], E[0, 2], E[1, 1], E[1, 2], E[2, 2], armature]
        return np.array(out)


def _axis(robot: CheckedModel, j: int) -> tuple[Any, bool]:
    """Axis of a joint of one degree of freedom, and whether it slides along it."""
    joint = robot.model.joints[j]
    kind = joint.shortname().removeprefix("JointModel")
    if kind in ("RX", "RY", "RZ", "PX", "PY", "PZ"):
        return _AXES[kind[1]], kind[0] == "P"
    if kind in ("RevoluteUnaligned", "PrismaticUnaligned"):
        return joint.extract().axis, kind[0] == "P"
    if kind in ("RUBX", "RUBY", "RUBZ"):
        return _AXES[kind[3]], False
    if kind == "RevoluteUnboundedUnaligned":
        return joint.extract().axis, False
    raise Unsupported(
        f"joint {robot.model.names[j]!r} of {robot.name} is a {joint.shortname()}; simulate_many takes hinges, slides, and one "
        "floating base at the root. rbd.simulate takes it."
    )


@dataclass(frozen=True, eq=False)
class Touching:
    """What a robot may touch, and the joints with stops and dry friction.

    Attributes:
        sites: For the kernels, with its points in the order of the bodies.
        order: The contacts' points in that order, shape (k,).
        points: {contact: its points, in the order of the contacts}.
        friction: Coefficient of each point, in the order of the sites, shape (k,).
        ground: What is under the points, for the kernels.
        joints: {body: (lower, upper, dry friction)}.
    """

    sites: Sites
    order: Array
    points: dict[str, slice]
    friction: Array
    ground: Ground
    joints: dict[int, tuple[float, float, float]]

    @classmethod
    def of(cls, packed: Packed, constraints: Sequence[Constraint], start: State) -> Touching:
        """That of some constraints.

        Raises:
            InputError: a contact without a plane.
            Unsupported: others than contacts with friction on ground at rest, joint limits and dry friction, by name.
        """
        robot, joints, singles = packed.robot, dict[int, tuple[float, float, float]](), list[tuple[int, int]]()
        contacts = list[Any]()
        for given in constraints:
            if isinstance(given, JointLimit | JointFriction):
                b = packed.dofs.index(robot.joints.with_one_freedom(given.joint, given.name).v.start)
                low, high, rubs = joints.get(b, (-np.inf, np.inf, 0.0))
                if isinstance(given, JointLimit):
                    low, high = given.bounds(robot)
                else:
                    rubs = given.torque
                joints[b] = low, high, rubs
                singles.append((b, STOP if isinstance(given, JointLimit) else RUB))
            elif isinstance(given, Contact) and isinstance(given.friction, float | int) and given.friction > 0.0:
                contacts.append(given)
            else:
                raise Unsupported(
                    f"{getattr(given, 'name', given)!r:.80} is a {type(given).__name__}; simulate_many takes contacts at "
                    "points, along edges and over patches with a coefficient of friction above zero, on ground at rest, "
                    "JointLimit and JointFriction. rbd.simulate takes it."
                )
        body, local, plane, on = list[int](), list[Array](), list[Array](), list[tuple[int, int]]()
        faces, begins, known = list[Array](), [0], dict[int, tuple[int, int]]()
        points, at = dict[str, slice](), 0
        for contact in contacts:
            if contact.on is None and contact.anchor is None:
                raise InputError(
                    f"{contact.name!r:.80} has no plane: it would touch where it is, in each world at another height. Give "
                    "on=0.0, or the ground on which it stands."
                )
            joint, X = robot.site(contact.frame)
            if joint == 0:
                raise Unsupported(f"{contact.name!r:.80} is fixed to the world; simulate_many takes contacts of moving bodies.")
            corners = X.act(contact.placement) if isinstance(contact.placement, pin.SE3) else X
            k = len(contact.corners)
            body += [joint - 1] * k
            local += [corners.act(corner) for corner in contact.corners]
            points[contact.name] = slice(at, at + k)
            at += k
            if isinstance(contact.on, Terrain):
                terrain = contact.on
                if id(terrain) not in known:
                    first = len(begins) - 1
                    for piece in terrain.pieces:
                        if piece.moved is not None or piece.rates is not None:
                            raise Unsupported(f"{piece.name!r:.80} of the terrain moves; simulate_many takes terrain at rest.")
                        faces += [face for f, face in enumerate(piece.faces) if f not in piece.inner]
                        begins.append(len(faces))
                    known[id(terrain)] = first, len(begins) - 1
                on += [known[id(terrain)]] * k
                plane += [np.zeros(4)] * k
                continue
            (source,) = sources_of([contact], start)
            if not isinstance(source, PlanePoints) or source.surface is not None:
                raise Unsupported(f"the ground of {contact.name!r:.80} moves; simulate_many takes ground at rest.")
            on += [(0, 0)] * k
            plane += [np.r_[R[:, 2], height] for R, height in zip(source.axes, source.height, strict=True)]
        sites, order = sites_of(packed, body, np.array(local).reshape(-1, 3), singles)
        mu = np.repeat([float(c.friction) for c in contacts], [len(c.corners) for c in contacts])
        ground = Ground(
            np.array(plane).reshape(-1, 4)[order], np.array(on, int).reshape(-1, 2)[order], np.array(begins, int),
            np.array(faces).reshape(-1, 4),
        )  # fmt: skip
        return cls(sites, order, points, mu[order] if len(mu) else np.zeros(0), ground, joints)

    def sorted_points(self, name: str) -> Array:
        """Where the points of a contact are in the order of the sites."""
        own = self.points[name]
        return np.flatnonzero((self.order >= own.start) & (self.order < own.stop))


def sites_of(packed: Packed, body: Sequence[int], local: Array, singles: Sequence[tuple[int, int]]) -> tuple[Sites, Array]:
    """(sites, the order in which they take the points) of points on bodies and of joints.

    Args:
        packed: The tree.
        body: The body of each point, shape (k,).
        local: Each point in its joint's axes, shape (k, 3).
        singles: (body, 0 of dry friction or 1 of a stop) of each joint's row.
    """
    tree, turns = packed.tree, packed.turns
    order = np.argsort(np.asarray(body, int), kind="stable")
    of = np.asarray(body, int)[order]
    arms = np.array([turns[b + 1].T @ x for b, x in zip(of, local[order], strict=True)]).reshape(-1, 3)
    table, places, paths, single = list[tuple[int, ...]](), list[Array](), list[list[int]](), list[int]()
    for b in np.unique(of).tolist():
        own = np.flatnonzero(of == b)
        table.append((b, 6 if np.ptp(arms[own], axis=0).any() else 3, int(own[0]), len(own)))
        places.append(arms[own].mean(axis=0))
    for b in sorted({b for b, _ in singles}):
        kinds = [kind for c, kind in singles if c == b]
        table.append((b, 1, len(single), len(kinds)))
        single += kinds
        places.append(np.zeros(3))
    for b, *_ in table:
        path, j = [], int(b)
        while j >= tree.free:
            path.append(j)
            j = int(tree.parent[j])
        paths.append(path)
    common = [[j for j in paths[a] if j in set(paths[b])] for a in range(len(table)) for b in range(a + 1)]
    return (
        Sites(
            np.array(table, int).reshape(-1, 4), np.array(places).reshape(-1, 3), arms,
            *_listed(paths), *_listed(common), np.array(single, int),
        ),
        order,
    )  # fmt: skip


def _listed(parts: Sequence[Sequence[int]]) -> tuple[Array, Array]:
    """All numbers one after the other, and where those of each part begin."""
    return np.array([x for part in parts for x in part], int), np.cumsum([0, *map(len, parts)]).astype(int)
