"""`UncertainLoads`: all loads that the members of a set put on a robot at rest, as corners and columns, with rounding bounds.

With masses m_i, centres of mass c_i and pushes w at points P of the robot, contact forces and torques must come to

    g(m, m c) - J_P^T w,      g = - sum_i J_ci^T m_i gravity,

which is linear in (m_i, m_i c_i) and in w. Over the intervals of m_i and the boxes of c_i it stays within

    corner of the pushes + sum of t_i D_i,      t_i in [-1, 1],

one column D for each uncertain mass, at the link's middle centre of mass, and three for each uncertain centre of mass, of the
moments m_i (c_i - middle): within the largest mass times the half-widths of the box. Of a link with both, that holds a little
more than the members. Masses and moments move the load; friction "at least mu" takes part by the smallest, as its cones grow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import prod

import numpy as np

from rbd.arrays import Array, lazy
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError
from rbd.model.state import State
from rbd.robust.sets import Boxes, Masses, Member, PushSet, boxes_of, masses_of, middle_of, push_sets, with_least_friction
from rbd.statics.force_balance import ForceBalance, standing_loads

MOST_CORNERS = 4096
"""Of all pushes together."""
_OPERATIONS = 100
"""Of rounding, a joint, between a robot's file and an entry of a Jacobian or a load: at most

    66   rotations: two products of matrices (5 operations an entry each), sine, cosine and their matrix (12): 22 an entry, and
         an error e of each of 9 entries is one of 3 e of a rotation, which all that is carried shares;
     4   its place: a product with an arm and a sum;
    30   shared by all joints: axis x arm, axes of the contact, its map, products with masses and gravity (26 together, once),
         and one addition a body.

Errors of joints add up along the tree, to first order, each times the arms that follow: `_rounding` has all arms together.
"""
_ROUNDING = 2.0**-53


@dataclass(frozen=True, eq=False)
class UncertainLoads:
    """The set of loads, and the forces and torques that may carry them.

    Attributes:
        balance: The pose, its contacts with their least friction, and the load of the middle of all masses.
        pushes: The sets of pushes.
        corners: Loads at the corners of the pushes, shape (k, nv) [N, N m].
        components: The pushes there, shape (k, d) [N, N m].
        columns: D of each uncertain number, shape (n, nv) [N, N m].
        names: What each is: "mass of trunk", "x of the centre of mass of trunk".
        mass: What each adds to the robot's mass at t = 1, shape (n,) [kg]: zero of centres of mass.
        links: (link, number of its column of mass or -1, middle mass [kg], half-width [kg or m]) of each; of a joint -2, its
            middle and half-width [rad, m].
        load_radius: Bound of the rounding of a load, shape (nv,).
        forces_radius: Bound of the rounding of the generalised force of a unit contact force, shape (nv, p).
        turns: {number of a column: (what it changes in `balance.per_weight`, shape (nv, p); in each corner's load, beside its
            column, shape (k, nv))}, of joints of an uncertain pose.
    """

    balance: ForceBalance
    pushes: tuple[PushSet, ...]
    corners: Array
    components: Array
    columns: Array
    names: tuple[str, ...]
    mass: Array
    links: tuple[tuple[str, int, float, float], ...]
    load_radius: Array
    forces_radius: Array
    turns: Mapping[int, tuple[Array, Array]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        state: State,
        contacts: Sequence[Constraint],
        pushes: object = None,
        friction: float | Mapping[str, float] | None = None,
        mass: Masses = None,
        com: Boxes = None,
        loops: bool = True,
    ) -> UncertainLoads:
        """The set, checked; arguments as of `rbd.robust.hold`.

        Raises:
            InputError: sets that are empty, reversed or none; as `rbd.hold`.
            FrameNotFound, UnknownName: links, frames or contacts that are not there.
        """
        balance = standing_loads(state, with_least_friction(contacts, friction), "cone", 0.0, loops)
        robot, sets = state.robot, push_sets(pushes)
        if (count := prod(len(s.corners) for s in sets)) > MOST_CORNERS:
            raise InputError(
                f"the sets of pushes have {count:,} corners together; expected up to {MOST_CORNERS:,}: give fewer."
            )
        heavy, boxes = masses_of(robot, mass), boxes_of(robot, com)
        load, columns, names, moved, size = state.h.copy(), list[Array](), list[str](), list[float](), robot.mass
        links, masses = list[tuple[str, int, float, float]](), dict[int, int]()
        g = robot.gravity
        for joint, (link, least, most) in heavy.items():
            J = state.frame(link, middle_of(robot, link)).J
            load -= J[:3].T @ g * (0.5 * (least + most) - robot.model.inertias[joint].mass)
            size += 2.0 * most
            if most > least:
                columns.append(-J[:3].T @ g * (0.5 * (most - least)))
                names.append(f"mass of {link}")
                moved.append(0.5 * (most - least))
                masses[joint] = len(links)
                links.append((link, len(links), 0.5 * (least + most), 0.5 * (most - least)))
        for joint, (link, widths) in boxes.items():
            own = float(robot.model.inertias[joint].mass)
            _, least, most = heavy.get(joint, ("", own, own))
            found = state.frame(link)
            for axis in np.flatnonzero(widths):
                moment = found.X_WF.rotation[:, axis] * most * widths[axis]
                columns.append(-found.J[3:].T @ np.cross(moment, g))
                names.append(f"{'xyz'[axis]} of the centre of mass of {link}")
                moved.append(0.0)
                links.append((link, masses.get(joint, -1), 0.5 * (least + most), float(widths[axis])))
                size += most * widths[axis]
        points = [np.asarray(s.corners) for s in sets]
        pushed = [w @ state.frame(s.frame, s.offset).J[: w.shape[1]] for s, w in zip(sets, points, strict=True)]
        chosen = list(product(*[range(len(w)) for w in points]))
        corners = [load - sum([part[i] for part, i in zip(pushed, at, strict=True)], np.zeros(robot.nv)) for at in chosen]
        components = [np.concatenate([np.zeros(0), *[w[i] for w, i in zip(points, at, strict=True)]]) for at in chosen]
        rounding = _rounding(state, balance)
        largest = size * float(np.linalg.norm(g)) + sum(float(np.abs(s.corners).sum(axis=1).max()) for s in sets)
        return cls(
            balance, sets, np.array(corners), np.array(components), np.array(columns).reshape(-1, robot.nv), tuple(names),
            np.array(moved), tuple(links), np.full(robot.nv, rounding * largest), np.full(balance.per_weight.shape, rounding),
        )  # fmt: skip

    @property
    def state(self) -> State:
        """The pose."""
        return self.balance.state

    @lazy
    def limits(self) -> tuple[Array, Array]:
        """(least, most) torques at rest, shapes (nu,); infinite of motors without a stated limit."""
        return self.state.robot.limits_at(self.state.v)

    def load(self, corner: int, t: Array) -> Array:
        """The load of a member, shape (nv,) [N, N m]."""
        own = [t[i] * loads[corner] for i, (_, loads) in self.turns.items()]
        return np.asarray(self.corners[corner] + t @ self.columns + sum(own, np.zeros(self.corners.shape[1])))

    def within(self, t: Array) -> UncertainLoads:
        """The same about other numbers t: their loads and, at another pose, what forces do there."""
        corners = np.array([self.load(v, t) for v in range(len(self.corners))])
        if not self.turns:
            return replace(self, corners=corners)
        P = self.balance.per_weight + sum(t[i] * S for i, (S, _) in self.turns.items())
        balance = replace(self.balance)
        balance.__dict__["per_weight"] = P
        return replace(self, corners=corners, balance=balance)

    def slopes(self, corner: int, forces: Array) -> Array:
        """How the load less what forces balance of it changes with each t, shape (n, nv)."""
        out = self.columns.copy()
        for i, (S, loads) in self.turns.items():
            out[i] += loads[corner] - S @ forces
        return out

    def inside(self, t: Array) -> Array:
        """The same for a true member: of a link that is lighter than at most, moments of its centre of mass are less."""
        out = t.copy()
        for i, (_, column, middle, _) in enumerate(self.links):
            if column not in (-2, -1, i):
                half = self.links[column][3]
                out[i] *= (middle + t[column] * half) / (middle + half) * (1.0 - 2.0**-50)
        return out

    def member(self, corner: int, t: Array) -> Member:
        """What a member is in words of the user."""
        split = np.cumsum([0, *[np.asarray(s.corners).shape[1] for s in self.pushes]])
        pushed = dict[str, Array]()
        for s, a, b in zip(self.pushes, split[:-1], split[1:], strict=True):
            pushed[s.frame if s.frame not in pushed else f"{s.frame}, {len(pushed) + 1}"] = self.components[corner][a:b]
        mass, com = dict[str, float](), dict[str, Array]()
        for i, (link, column, middle, half) in enumerate(self.links):
            if column == i:
                mass[link] = middle + float(t[i]) * half
        for i, (link, column, middle, width) in enumerate(self.links):
            if column not in (-2, i):
                full = middle + (self.links[column][3] if column >= 0 else 0.0)
                now = middle + (float(t[column]) * self.links[column][3] if column >= 0 else 0.0)
                moved = float(t[i]) * width * full / now if now > 0.0 else 0.0
                com.setdefault(link, np.zeros(3))["xyz".index(self.names[i][0])] = moved
        joints = {name: q + float(t[i]) * r for i, (name, column, q, r) in enumerate(self.links) if column == -2}
        return Member(pushed, mass, com, joints)

    def with_corners(self, corners: Array, components: Array, columns: Array | None = None) -> UncertainLoads:
        """The same with other loads."""
        return replace(self, corners=corners, components=components, columns=self.columns if columns is None else columns)


def _rounding(state: State, balance: ForceBalance) -> float:
    """Bound of the rounding of an entry of J^T G, over the size of a unit force: operations of all joints times their arms."""
    model = state.robot.model
    arms = sum(float(np.linalg.norm(X.translation)) for X in model.jointPlacements)
    frames = max(float(np.linalg.norm(f.placement.translation)) for f in model.frames)
    reach = 2.0 + arms + float(np.abs(state.q).max(initial=0.0)) + frames
    return _OPERATIONS * model.njoints * _ROUNDING * reach * max(1.0, float(np.abs(balance.sets.G).max(initial=0.0)))
