"""Sets as they are given, and loads over a box of poses: each joint is an uncertain number, which changes what forces do.

`rbd.robust.pose_bounds` has gravity g(q), Jacobians of contact points and of pushed points as middle + sum of d_i slopes + what
is of second order, bounded. Slopes become columns and `turns` of the loads, the rest their rounding bounds. The planes of
contacts stay as they are in the middle of the box, and their points move with their links; the base stays.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rbd.arrays import Array, lazy
from rbd.constraints.constraint import Constraint
from rbd.errors import DistantContactWarning, Unsupported
from rbd.errors.inputs import check_kind
from rbd.model.state import State
from rbd.robust.centres import Placed
from rbd.robust.pose_bounds import Boxed, PoseBounds, Taylor, bounds_over_poses, middles
from rbd.robust.sets import Boxes, Masses, Member, boxes_of, masses_of, middle_of
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.statics.force_balance import ForceBalance

_AGREES = 1e-9
"""Bounds and the rows of contacts are the same in the middle of the box, to this."""


@dataclass(frozen=True, eq=False)
class GivenSet:
    """A set as it is given, and its loads: over all of it, over parts of its box of poses, at one pose.

    Attributes:
        state: The pose; joints of the box may be anywhere in it.
        contacts: As of `rbd.robust.hold`, and so are all up to `loops`.
        pushes: Of it.
        friction: Of it.
        mass: Of it.
        com: Of it.
        joints: {joint: (low, high) [rad, m]}, or none.
        loops: Of it.
        place: Where the centre of mass of every member is, seen along gravity on z = 0, shape (2,) [m]; None: where its pose
            and its masses put it.
        apart: Whether contacts may be off their planes, as at the poses of a box.
    """

    state: State
    contacts: Sequence[Constraint]
    pushes: object
    friction: float | Mapping[str, float] | None
    mass: Masses
    com: Boxes
    joints: Boxed | None
    loops: bool
    place: Array | None = None
    apart: bool = False

    @lazy
    def whole(self) -> UncertainLoads:
        """The loads of all members."""
        return self.anywhere if self.place is None else self.places.at(self.place)

    @lazy
    def places(self) -> Placed:
        """The loads as they change with the place of the centre of mass."""
        return Placed.of(self.anywhere)

    @lazy
    def anywhere(self) -> UncertainLoads:
        """The loads with the centre of mass where the pose has it; with a place, what the box of poses changes leaves it."""
        check_kind("joints", self.joints, Mapping | None, "{joint: (lowest, highest)} [rad, m]")
        return self._over(self.joints, None) if self.joints else self._alone()

    def part(self, within: Mapping[int, tuple[float, float]]) -> UncertainLoads:
        """The loads over a part of the box of poses, whose numbers t of the whole's joints are within intervals."""
        assert self.joints is not None
        inner = dict(self.joints)
        for i, ends in within.items():
            name, _, q, r = self.whole.links[i]
            low, high = (q + t * r if abs(t) < 1.0 else self.joints[name][int(t > 0.0)] for t in ends)
            inner[name] = low, high
        found = self._over(inner, self.whole.balance)  # planes stay as in the middle of the whole
        return found if self.place is None else Placed.of(found).at(self.place)

    def at_place(self, place: Array) -> GivenSet:
        """The set with the centre of mass of every member at a place; it had one."""
        found = replace(self, place=place)
        found.__dict__["places"] = self.places  # known
        return found

    def pose_of(self, member: Member) -> dict[str, float]:
        """The joints of a member, within the box also where rounding put them beyond its ends."""
        ends = self.joints or {}
        return {name: float(np.clip(q, *ends[name])) for name, q in member.joints.items()}

    def at_pose(self, joints: Mapping[str, float]) -> GivenSet:
        """The set at one pose of its box."""
        return replace(self, state=posed(self.state, joints), joints=None, apart=True)

    def _alone(self) -> UncertainLoads:
        with warnings.catch_warnings():  # points move with their links, off planes that stay: that is what a box means
            if self.apart:
                warnings.simplefilter("ignore", DistantContactWarning)
            return UncertainLoads.of(
                self.state, self.contacts, self.pushes, self.friction, self.mass, self.com, self.loops
            )  # fmt: skip

    def _over(self, joints: Boxed, planes: ForceBalance | None) -> UncertainLoads:
        middle = self.at_pose(middles(self.state.robot, joints))._alone()
        return over_poses(middle, self.contacts, joints, self.mass, self.com, planes, self.place is not None)


def posed(state: State, joints: Mapping[str, float]) -> State:
    """The state at rest with some joints elsewhere [rad, m]; a joint without end has two coordinates."""
    q = state.q.copy()
    for name, value in joints.items():
        joint = state.robot.model.joints[state.robot.joint_id(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return State(state.robot, q)


def over_poses(
    loads: UncertainLoads,
    contacts: Sequence[Constraint],
    joints: Boxed,
    mass: Any = None,
    com: Any = None,
    planes: ForceBalance | None = None,
    placed: bool = False,
) -> UncertainLoads:
    """The loads over a box of poses.

    Args:
        loads: In the middle of the box.
        contacts: As given.
        joints: {joint: (low, high) [rad, m]}.
        mass: As of `rbd.robust.hold`.
        com: As of `rbd.robust.hold`.
        planes: Whose contacts' axes are kept; None: those of the loads.
        placed: Whether the centre of mass stays where the middle of the box has it, so that a floating base bears the same.

    Raises:
        Unsupported: contacts that do not act at points of one link, on the ground; pushes with moments; joints of other kinds.
    """
    state, robot = loads.state, loads.state.robot
    heavy, boxes = masses_of(robot, mass), boxes_of(robot, com)
    points: dict[str, tuple[str, Array]] = {}
    for c, row in zip(contacts, loads.balance.rows, strict=False):
        for i, offset in enumerate(_offsets(state, c, row)):
            points[f"{row.name}/{i}"] = c.frame, offset  # type: ignore[attr-defined]
    for i, push in enumerate(loads.pushes):
        if np.asarray(push.corners).shape[1] != 3:
            raise Unsupported(
                f"pushes at {push.frame!r:.80} have moments; over a box of joints forces alone are known: give (k, 3)."
            )
        points[f"push/{i}"] = push.frame, np.asarray(push.offset)
    for link in [*[each[0] for each in heavy.values()], *[each[0] for each in boxes.values()]]:
        points[f"link/{link}"] = link, middle_of(robot, link)
    for link, widths in boxes.values():
        for axis in range(3):
            points[f"link/{link}/{axis}"] = link, middle_of(robot, link) + widths[axis] * np.eye(3)[axis]
    bounds = bounds_over_poses(state, joints, points)
    return _with(loads, bounds, heavy, boxes, planes, placed)


def _offsets(state: State, contact: Constraint, row: Any) -> Array:
    """Points of a contact in the axes of its frame, shape (k, 3) [m]."""
    patch = row.patch
    if patch is None or patch.against is not None or not isinstance(getattr(contact, "frame", None), str):
        raise Unsupported(
            f"{row.name!r:.80} is no contact of one link with the ground: over a box of joints only those are known."
        )
    X_WF = state.frame(contact.frame).X_WF  # type: ignore[attr-defined]
    return np.array([X_WF.actInv(p) for p in np.atleast_2d(patch.corners_W)])


def _with(
    loads: UncertainLoads,
    bounds: PoseBounds,
    heavy: Mapping[int, Any],
    boxes: Mapping[int, Any],
    planes: ForceBalance | None,
    placed: bool,
) -> UncertainLoads:
    robot, sets, reach = loads.state.robot, loads.balance.sets, bounds.reach
    g = Taylor.fixed(robot.gravity, reach)
    P: Taylor | None = None
    for i, row in enumerate((planes or loads.balance).rows):
        given = sets.point_map(i)
        if given is None or row.patch is None:
            raise Unsupported(
                f"{row.name!r:.80} does not act at points: over a box of joints only contacts at points are known."
            )
        for k in range(len(given) // 3):
            act = Taylor.fixed(row.patch.axes @ given[3 * k : 3 * k + 3], reach)
            part = bounds.jacobians[f"{row.name}/{k}"].T @ act
            P = part if P is None else P + part
    if P is None or (planes is None and np.abs(P.mid - loads.balance.per_weight).max() > _AGREES * (1.0 + np.abs(P.mid).max())):
        raise Unsupported(
            "what the contacts' forces do is not known over a box of joints; give point or surface contacts on the ground."
        )
    P = P.straight
    same = np.zeros(robot.nv, bool)
    if placed:
        at = robot.model.joints[robot.bases[0]].idx_v
        same[at : at + 6] = True
    load, radius = _fixed_at(bounds.gravity, same, loads.state.h), loads.load_radius.copy()
    for joint, (link, least, most) in heavy.items():
        J = bounds.jacobians[f"link/{link}"].T
        more, half = 0.5 * (least + most) - float(robot.model.inertias[joint].mass), 0.5 * (most - least)
        weight = J @ g
        load = load - Taylor.fixed(more * np.eye(robot.nv), reach) @ _fixed_at(weight, same, weight.mid)
        radius += half * np.where(same, 0.0, weight.moved)
    for joint, (link, widths) in boxes.items():
        most = heavy.get(joint, ("", 0.0, float(robot.model.inertias[joint].mass)))[2]
        for axis in np.flatnonzero(widths):
            turned = (bounds.jacobians[f"link/{link}/{axis}"] - bounds.jacobians[f"link/{link}"]).T @ g
            radius += most * turned.moved
    load = load.straight
    corners, own = np.repeat(load.mid[None], len(loads.corners), axis=0), np.zeros((len(reach), *loads.corners.shape))
    pushed_radius = np.zeros_like(corners)
    for v, w in enumerate(loads.components):
        for i in range(len(loads.pushes)):
            pushed = (bounds.jacobians[f"push/{i}"].T @ Taylor.fixed(w[3 * i : 3 * i + 3], reach)).straight
            corners[v] -= pushed.mid
            own[:, v] -= pushed.slopes * reach[:, None]
            pushed_radius[v] += pushed.rad
    n = len(loads.columns)
    balance = replace(loads.balance)
    balance.__dict__["per_weight"] = P.mid
    names = tuple([*loads.names, *[f"joint {name}" for name in bounds.joints]])
    links = tuple(
        [
            *loads.links,
            *[(name, -2, float(q), float(r)) for name, q, r in zip(bounds.joints, bounds.middle, reach, strict=True)],
        ]
    )
    columns, unsure = np.vstack([loads.columns, load.slopes * reach[:, None]]), radius + load.rad + pushed_radius.max(axis=0)
    return replace(
        loads, balance=balance, corners=corners, columns=columns, names=names, links=links,
        mass=np.append(loads.mass, np.zeros(len(reach))), load_radius=unsure,
        forces_radius=loads.forces_radius + P.rad,
        turns={n + i: (P.slopes[i] * reach[i], own[i]) for i in range(len(reach))},
    )  # fmt: skip


def _fixed_at(x: Taylor, rows: Array, value: Array) -> Taylor:
    """A vector whose chosen rows do not depend on the pose."""
    mid, rad, kept = np.where(rows, value, x.mid), np.where(rows, 0.0, x.rad), np.where(rows, 0.0, 1.0)
    return Taylor(mid, x.slopes * kept, x.bends * kept, rad, x.reach)
