"""What constraints are to a plan: the forces that their weights put on bodies and joints.

A *column* is the force of one unit weight of a constraint's set of forces, with the place and the axes in which it is constant:
of its body, of the surface, of an edge. Contacts and loops act between two bodies, or a body and the ground, which may move.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from types import ModuleType
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.contact_bodies import NO_MOTION, OF_BASE, OF_BASE_TWO, OF_BODY, Site
from rbd.arrays import Array, zeros
from rbd.constraints.contact import Contact
from rbd.constraints.joint import JointCoupling, JointFriction, JointLock
from rbd.constraints.loop import LoopClosure
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.checked_model import CheckedModel
from rbd.problem.cones import Cone, Free, checked_generators
from rbd.problem.ground import Body, motion_of

_ONE_LINE = 1e-9
"""Spread of points across a line, over that along it, up to which they are on it."""
_NONE = zeros(3)


@cache
def law_kernel() -> ModuleType:
    """`rbd.answers.prepared.law_kernel`, imported with the first plan that needs it."""
    from rbd.answers.prepared import law_kernel

    return law_kernel


class Column(NamedTuple):
    """A force on the body of one joint: F and a moment m at a point, in the joint's axes.

    Attributes:
        joint: The joint.
        force: F, in `axes` of `law_kernel`.
        point: The point.
        axes: As of `law_kernel`: of the body, the surface or an edge.
        moment: m; of an edge the surface's normal.
        along: The direction of an edge; where a loop has the point on its other body.
        base: As of `Site`.
        motion: As of `Site`.
        closes: The loop that it is of.
        turn: As of `Site`.
    """

    joint: int
    force: Array
    point: Array
    axes: int = 0
    moment: Array = _NONE
    along: Array = _NONE
    base: int = -1
    motion: tuple[float, ...] = NO_MOTION
    closes: LoopClosure | None = None
    turn: tuple[float, ...] = NO_MOTION


JointColumn: TypeAlias = tuple[tuple[int, float], ...]
"""Torques of a unit weight: (dof, torque)."""


class Source(NamedTuple):
    """A constraint of a plan.

    Attributes:
        name: Its name.
        cone: The set of its forces.
        columns: Forces of unit weights, in the order of the set's generators.
        contacts: The constraint itself, if it is a contact.
    """

    name: str
    cone: Cone
    columns: Sequence[Column | JointColumn]
    contacts: Sequence[Contact] = ()


def site_of(columns: Sequence[Column]) -> Site:
    """The rows of a body: at its one point, or at the centre of its points, without turns about their line; those of a loop."""
    kernel, first, R = law_kernel(), columns[0], np.eye(3)
    made = partial(Site, first.joint, base=first.base, motion=first.motion)
    if first.closes is not None:
        x, y = first.force, columns[1].force
        R = np.column_stack([x, y, np.cross(x, y)])
        kind = OF_BASE_TWO if first.closes.slides == 2 else OF_BASE
        return made(pin.SE3(R, first.point), len(columns), kind, turn=first.turn)
    points = np.array([c.point for c in columns])
    centre, size = points.mean(axis=0), 6
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=True)
    if not any(c.axes == kernel.EDGE_MOMENT or (c.axes < kernel.EDGE and c.moment.any()) for c in columns):
        if (points == points[0]).all():
            centre, size = points[0], 3
        elif spread[1] <= _ONE_LINE * spread[0]:
            z = axes[0]
            x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
            x /= np.linalg.norm(x)
            R, size = np.column_stack([x, np.cross(z, x), z]), 5
    return made(pin.SE3(R, centre), size, OF_BODY)


def _contact(robot: CheckedModel, contact: Contact) -> Source | None:
    """Of a contact at a point, along an edge, or over a patch."""
    cone, k, kernel, on = contact.cone, len(contact.corners), law_kernel(), contact.on
    if isinstance(on, Terrain):  # what it rests on changes with the state
        return None
    G, _ = checked_generators(cone)
    joint, X_JF = robot.site(contact.frame)
    base, motion, R_BS, X = -1, NO_MOTION, np.eye(3), X_JF * contact.placement
    if isinstance(on, Body):
        base, X_BF = robot.site(on.frame)
        R_BS = X_BF.rotation
    elif on is not None and on.motion is not None:
        return None
    elif on is not None and on.moves:
        about = [np.nan] * 3 if on.about is None else on.about
        base, motion = 0, tuple(np.concatenate([*motion_of(on), about, X.translation]).tolist())
    if not joint or joint == base or (base == 0 and isinstance(on, Body)):
        return None
    n = contact.normal
    made = partial(Column, joint, base=base, motion=motion)
    x, up = X.rotation[:, 0], _NONE if n is None else R_BS @ n
    columns, at = list[Column](), np.eye(3) if k == 1 and cone.bilateral else cone.at_points
    for j in range(G.shape[1]):
        if at is None:
            if k != 2:
                columns.append(made(X.rotation @ G[:3, j], X.translation, kernel.BODY, X.rotation @ G[3:, j]))
            elif n is not None and cone.bilateral:
                F = np.eye(3)[j % 3 + j // 3]
                columns.append(made(F, X.translation, kernel.EDGE + j // 3, up, x))
            else:
                return None
            continue
        forces = at[:, j].reshape(-1, 3)
        acts = np.flatnonzero(forces.any(axis=1))
        if len(acts) != 1:
            return None
        F, point = forces[acts[0]], X.act(contact.corners[acts[0]])
        if k == 1:
            turned = F if contact.turned is None else contact.turned @ F
            columns.append(made(R_BS @ turned, point, kernel.SURFACE))
        elif k == 2 and n is not None:
            columns.append(made(F, point, kernel.EDGE, up, x))
        else:
            columns.append(made(X.rotation @ F, point))
    return Source(contact.name, cone, columns, [contact])


def _loop(robot: CheckedModel, loop: LoopClosure) -> Source | None:
    """Of a loop: forces, and moments of a hinge, a weld or a cross, on the body of frame_b, in axes of that of frame_a."""
    (base, X_a), (joint, X_b), kernel = robot.site(loop.frame_a), robot.site(loop.frame_b), law_kernel()
    if joint == base or loop.kind in ("rod", "rope"):  # of a direction that changes
        return None
    axes = loop.turning_axes
    turned = X_b.rotation @ loop.directions
    turn = NO_MOTION if axes is None else tuple(np.concatenate([turned.ravel(), axes.ravel()]).tolist())
    made = partial(Column, joint, point=X_b.translation, along=X_a.translation, base=base, closes=loop, turn=turn)
    forces = [made(X_a.rotation @ F, axes=kernel.SURFACE) for F in loop.directions.T[: loop.slides]]
    moments = [made(row, axes=kernel.LOOP_MOMENT) for row in np.eye(3)[: loop.size - loop.slides]]
    return Source(loop.name, loop.cone, [*forces, *moments])


def source_of(robot: CheckedModel, constraint: object) -> Source | None:
    """Of a constraint whose rows are the same at each state; None for others."""
    if isinstance(constraint, Contact):
        return _contact(robot, constraint)
    if type(constraint) is LoopClosure:
        return _loop(robot, constraint)
    if type(constraint) is JointFriction:
        joint = robot.joints.with_one_freedom(constraint.joint, constraint.name)
        return Source(constraint.name, constraint._cone, [((joint.v.start, 1.0),)])
    if type(constraint) is JointLock:
        joint = robot.joints[constraint.joint]
        if joint.nv > 1 and constraint.position is not None:
            return None
        return Source(constraint.name, Free(joint.nv), [((dof, 1.0),) for dof in range(joint.v.start, joint.v.stop)])
    if type(constraint) is JointCoupling:
        one, other = constraint._joints(robot)
        return Source(constraint.name, Free(1), [((one.v.start, 1.0), (other.v.start, -constraint.ratio))])
    return None
