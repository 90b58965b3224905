"""What constraints are to a plan: the forces that their weights put on bodies and joints.

A *column* is the force of one unit weight of a constraint's set of forces, with the place and the axes in which it is constant:
of its body, of the surface, of an edge, along a rod. Contacts and loops act between two bodies, or a body and the ground, which
may move. Columns make *elements*: intervals of one weight, and friction cones of three.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.contact_bodies import NO_MOTION, OF_BASE, OF_BASE_TWO, OF_BODY, OF_LINK, Site
from rbd.arrays import Array, rank_of, zeros
from rbd.constraints.contact import Contact
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.joint import JointCoupling, JointFriction, JointLock
from rbd.constraints.loop import LoopClosure
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.checked_model import CheckedModel
from rbd.problem.cones import Cone, Free, checked_generators
from rbd.problem.force_set import ForceSet
from rbd.problem.ground import Body, Ground, motion_of

_ONE_LINE = 1e-9
"""Spread of points across a line, over that along it, up to which they are on it."""
_ALL = 12
"""Up to this number of points, all are taken into account from the start."""
_NONE = zeros(3)
_X = np.array([1.0, 0.0, 0.0])


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
        ground: The ground that it is on, if that follows a motion of time: `motion` is then where its velocity is given.
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
    ground: Ground | None = None


JointColumn: TypeAlias = tuple[tuple[int, float], ...]
"""Torques of a unit weight: (dof, torque)."""


class Source(NamedTuple):
    """A constraint of a plan.

    Attributes:
        name: Its name.
        cone: The set of its forces.
        columns: Forces of unit weights, in the order of the set's generators.
        contacts: The constraint itself, if it is a contact.
        drive: The constraint itself, if it drives the joint of its one column.
    """

    name: str
    cone: Cone
    columns: Sequence[Column | JointColumn]
    contacts: Sequence[Contact] = ()
    drive: DrivenJoint | None = None


def site_of(columns: Sequence[Column]) -> Site:
    """The rows of a body: at its one point, or at the centre of its points, without turns about their line; those of a loop."""
    kernel, first, R = law_kernel(), columns[0], np.eye(3)
    made = partial(Site, first.joint, base=first.base, motion=first.motion)
    if first.axes == kernel.LINK:
        return made(pin.SE3(R, first.point), 1, OF_LINK, turn=first.turn)
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
    elif on is not None and on.moves:
        about = [np.nan] * 3 if on.about is None else on.about
        base, motion = 0, tuple(np.concatenate([*motion_of(on), about, X.translation]).tolist())
    if not joint or joint == base or (base == 0 and isinstance(on, Body)):
        return None
    n = contact.normal
    timed = on if isinstance(on, Ground) and on.motion is not None else None
    made = partial(Column, joint, base=base, motion=motion, ground=timed)
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
    """Of a loop: forces, and moments of a hinge, a weld or a cross, on the body of frame_b, in axes of that of frame_a.

    Of a rod or rope the force along it, on the body of frame_b. Of a rope it is there where that is taut: `ConstraintDynamics`.
    """
    (base, X_a), (joint, X_b), kernel = robot.site(loop.frame_a), robot.site(loop.frame_b), law_kernel()
    if joint == base:
        return None
    if loop.is_link:
        length, sign = np.nan if loop.length is None else loop.length, -1.0 if loop.kind == "rope" else 1.0
        given = (*X_a.translation.tolist(), length, sign, *NO_MOTION[5:])
        point, end = X_b.translation, X_a.translation
        return Source(loop.name, loop.cone, [Column(joint, _X, point, kernel.LINK, _NONE, end, base, NO_MOTION, loop, given)])
    axes = loop.turning_axes
    turned = X_b.rotation @ loop.directions
    turn = NO_MOTION if axes is None else tuple(np.concatenate([turned.ravel(), axes.ravel()]).tolist())
    made = partial(Column, joint, point=X_b.translation, along=X_a.translation, base=base, closes=loop, turn=turn)
    forces = [made(X_a.rotation @ F, axes=kernel.SURFACE) for F in loop.directions.T[: loop.slides]]
    moments = [made(row, axes=kernel.LOOP_MOMENT) for row in np.eye(3)[: loop.size - loop.slides]]
    return Source(loop.name, loop.cone, [*forces, *moments])


def source_of(robot: CheckedModel, constraint: object) -> Source | None:
    """Of a constraint whose rows are the same at each state, or follow a motion of time in one joint; None for others."""
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
    if type(constraint) is DrivenJoint:
        joint = robot.joints.with_one_freedom(constraint.joint, constraint.name)
        return Source(constraint.name, Free(1), [((joint.v.start, 1.0),)], drive=constraint)
    if type(constraint) is JointCoupling:
        one, other = constraint._joints(robot)
        return Source(constraint.name, Free(1), [((one.v.start, 1.0), (other.v.start, -constraint.ratio))])
    return None


def elements_of(made: Any, T: ForceSet, columns: Any, m: int) -> tuple[Any, bool]:
    """The elements, and whether all forces on the m rows are forces of columns.

    Of points with the world's axes forces of least norm are those in their bodies' axes, turned: for orthonormal axes only.
    """
    force, moment, arm, _, body = columns
    kernel = law_kernel()
    moment = np.where(body[:, 1:2] >= kernel.EDGE, 0.0, moment)
    Q, first = np.zeros((m, T.size)), np.array([e.columns.start for e in T.elements], np.int64)
    turns, even = np.flatnonzero((body[:, 1] != kernel.BODY) & (body[:, 1] != kernel.ROWS)), True
    axes = force.copy()
    for three in turns[: len(turns) // 3 * 3].reshape(-1, 3):
        F = force[three]
        even &= bool((np.diff(three) == 1).all()) and float(np.abs(F @ F.T - np.eye(3)).max()) < 1e-14
        axes[three] = np.eye(3)
    even &= len(turns) % 3 == 0
    body[turns[::3], 4] = even
    for j, (k, kind, at, width, _) in enumerate(body.tolist()):
        wrench = np.concatenate([axes[j], moment[j] + np.cross(arm[j], axes[j])])
        if kind == kernel.ROWS:
            wrench = np.eye(6)[int(force[j, 0])]
        Q[at : at + width, j] = wrench[:width] if k >= 0 else force[j, :1]
    mu = np.array([e.mu if e.is_cone else 0.0 for e in T.elements], float)
    share = np.ascontiguousarray(np.linalg.pinv(Q)) if even and Q.size else np.zeros((T.size, m))
    starts, normals = np.ones(len(first), bool), first + np.where(mu > 0.0, 2, 0)
    if (mu > 0.0).sum() > _ALL:
        starts = mu == 0.0
        for k in np.unique(body[normals[~starts], 0]):
            here = np.flatnonzero((mu > 0.0) & (body[normals, 0] == k))
            starts[here[spread_out(arm[normals[here]], 4)]] = True
    begin = share
    if not starts.all() and share.any():
        some = np.isin(T.element_at, np.flatnonzero(starts))
        begin = np.zeros(share.shape)
        begin[some] = np.linalg.pinv(Q[:, some])
    closed = even and (not m or rank_of(Q, 1e-9) == m)
    return made(first, T.lower[first], T.upper[first], mu, share, starts, begin), closed


def spread_out(points: Array, count: int) -> list[int]:
    """Numbers of some points that are far from each other."""
    away, out = np.linalg.norm(points - points.mean(axis=0), axis=1), list[int]()
    for _ in range(min(count, len(points))):
        out.append(int(away.argmax()))
        step = np.linalg.norm(points - points[out[-1]], axis=1)
        away = step if len(out) == 1 else np.minimum(away, step)
    return out
