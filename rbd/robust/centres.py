"""`Placed`: how loads change with the place of the centre of mass.

With masses within intervals the load of a member is a + sum of t_i D_i. Where its centre of mass is at x instead of c, on the
base it is

    h - J_w^T ((x - c) x M g),      M and M c linear in t,

so that a and D_i are linear in x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.world import along_gravity
from rbd.robust.program import Way
from rbd.robust.sets import middle_of
from rbd.robust.uncertain_loads import UncertainLoads


@dataclass(frozen=True, eq=False)
class Placed:
    """The loads where the centre of mass is at a place, linear in it.

    Attributes:
        loads: With the centre of mass of every member at `origin`.
        origin: On z = 0, shape (2,) [m].
        corners: What a metre along x and y adds to the loads at the corners, shape (2, k, nv).
        columns: To the columns, shape (2, n, nv).
    """

    loads: UncertainLoads
    origin: Array
    corners: Array
    columns: Array

    @classmethod
    def of(cls, L: UncertainLoads) -> Placed:
        """The places of a set of loads; its own centres of mass are where they are.

        Raises:
            InputError: gravity whose lines do not meet the plane z = 0.
        """
        state, robot, g = L.state, L.state.robot, L.state.robot.gravity
        origin = along_gravity(g, state.com)
        at, turned = robot.model.joints[robot.bases[0]].idx_v, np.zeros((3, robot.nv))
        turned[:, at + 3 : at + 6] = state.base_pose(robot.bases[0]).rotation
        middle, moment, columns = robot.mass, robot.mass * state.com, L.columns.copy()
        for i, (link, column, kilograms, half) in enumerate(L.links):
            if column == i:
                c = np.array(state.frame(link, middle_of(robot, link)).X_WF.translation)
                more = kilograms - float(robot.model.inertias[robot.site(link)[0]].mass)
                middle, moment = middle + more, moment + more * c
                columns[i] -= turned.T @ np.cross(half * (state.com - c), g)
        corners = L.corners - turned.T @ np.cross(middle * state.com - moment, g)
        ways = [-turned.T @ np.cross(axis, g) for axis in np.eye(3)[:2]]
        return cls(
            L.with_corners(corners, L.components, columns), origin,
            np.array([np.tile(middle * way, (len(corners), 1)) for way in ways]),
            np.array([np.outer(L.mass, way) for way in ways]),
        )  # fmt: skip

    def at(self, place: Array) -> UncertainLoads:
        """The loads with the centre of mass at a place, shape (2,) on z = 0."""
        off, L = place - self.origin, self.loads
        corners = L.corners + np.tensordot(off, self.corners, 1)
        return L.with_corners(corners, L.components, L.columns + np.tensordot(off, self.columns, 1))

    def ways(self, direction: Array) -> tuple[Way, Way]:
        """What a metre along a direction adds to the loads, and one across it."""
        across = np.array([-direction[1], direction[0]])
        both = [Way(np.tensordot(d, self.corners, 1), np.tensordot(d, self.columns, 1)) for d in (direction, across)]
        return both[0], both[1]
