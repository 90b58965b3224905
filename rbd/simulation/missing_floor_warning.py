"""Whether a robot that falls sinks through its floor, where only its soles are given as contacts with it.

A floor is the plane of a contact with friction on ground, whose normal opposes gravity. It supports the points of its contacts
alone: a robot that falls goes through it with all else. It counts as sunk if the bodies whose centres of mass are below all
floors have a quarter of its mass: an arm that reaches over the edge of a table, or a leg, has less. Bodies that begin
below a floor are left out. Only robots with motors and a floating base are looked at: of single bodies and mechanisms, the
contacts that are given are the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times, lazy
from rbd.constraints.constraint import Constraint, ground_of, member
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.contact_gaps import solids_of

SHARE = 0.25
"""Share of the robot's mass in bodies below the floor from which on it has sunk."""
LOW = 0.5
"""Bodies are looked at once the base is lower than this share of its height at the start; before, a step costs 1 us more."""
LEVEL = 0.5
"""Least cosine of the angle between a floor's normal and the vertical."""


class FallingBodies(NamedTuple):
    """Bodies of a robot.

    Attributes:
        joints: Their joints, shape (n,).
        levers: Centres of mass in their joints' axes, shape (n, 3) [m].
        shares: Shares of the robot's mass, shape (n,).
    """

    joints: Array
    levers: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class Floor:
    """The floors of one robot.

    Attributes:
        start: The start of the motion.
        base: Joint of the robot's floating base; several robots can be merged.
        contacts: Names of the contacts on these floors.
        normals: Normal of each floor, shape (m, 3).
        heights: Distance of each from W's origin along its normal, shape (m,) [m].
    """

    start: State
    base: int
    contacts: tuple[str, ...]
    normals: Array
    heights: Array

    @classmethod
    def of(cls, start: State, constraints: Sequence[Constraint]) -> tuple[Floor, ...]:
        """The floors of each robot of a state: of those that stand on given points."""
        robot, out = start.robot, []
        if not robot.nu or not robot.gravity.any():
            return ()
        down, steep = robot.gravity, LEVEL * np.linalg.norm(robot.gravity)
        grounds = [g for c in constraints if (g := _ground(c, start)) is not None and -(g.normal @ down) > steep]
        roots, joint = solids_of(robot).roots, solids_of(robot).joint
        driven = set(roots[joint[robot.actuated]].tolist())
        roots_of = [0 if (j := robot.site(g.contact.frame)[0]) == 0 else int(roots[j - 1]) for g in grounds]
        for base in sorted(driven.intersection(roots_of)):
            if robot.model.joints[base].shortname() != "JointModelFreeFlyer":
                continue
            own = [g for g, root in zip(grounds, roots_of, strict=True) if root == base]
            planes = [_plane(g.normal, g.height) for g in own]
            planes += [plane for c in constraints if (plane := _plane_of_shapes(c)) is not None]
            normals, heights = (np.array(x) for x in zip(*dict.fromkeys(planes), strict=True))
            out.append(cls(start, base, tuple(g.contact.name for g in own), normals, heights))
        return tuple(out)

    @lazy
    def _quick(self) -> tuple[int, float, list[list[float]]]:
        """(where the base's position begins in q, its height below which bodies are looked at, floors), as plain numbers."""
        place = self.start.robot.model.joints[self.base].idx_q
        high = float((self.normals @ self.start.q[place : place + 3] - self.heights).max())
        planes = [[*normal, height] for normal, height in zip(self.normals.tolist(), self.heights.tolist(), strict=True)]
        return place, LOW * high, planes

    @lazy
    def _bodies(self) -> FallingBodies:
        """The bodies that begin above one of the floors."""
        solids = solids_of(self.start.robot)
        tree = np.flatnonzero(solids.roots == self.base)
        whole = FallingBodies(tree + 1, solids.levers[tree], solids.masses[tree] / solids.masses[tree].sum())
        above = self._heights(self.start, whole) > 0.0
        return FallingBodies(*[x[above] for x in whole])

    def _heights(self, state: State, bodies: FallingBodies) -> Array:
        """Height of each body's centre of mass above the lowest of the floors, shape (n,) [m]."""
        R, p = state.joint_places(bodies.joints.tolist())
        return np.asarray(((p + each_times(R, bodies.levers)) @ self.normals.T - self.heights).max(axis=1))

    def sunk(self, state: State) -> str:
        """Message: how far the robot has sunk, through the floor of which contacts; empty if it has not."""
        place, low, planes = self._quick
        x, y, z = state.q[place : place + 3].tolist()
        for a, b, c, height in planes:
            if a * x + b * y + c * z - height > low:
                return ""
        robot, bodies = state.robot, self._bodies
        heights = self._heights(state, bodies)
        share = float(bodies.shares[heights < 0.0].sum())
        if share < SHARE:
            return ""
        deepest = int(heights.argmin())
        return (
            f"{robot.name} sinks through the floor: bodies with {100.0 * share:.0f} % of its mass are below the plane of "
            f"{', '.join(map(repr, self.contacts)):.200}; {_link(robot, int(bodies.joints[deepest]))!r:.80} by "
            f"{-heights[deepest]:.3g} m, the deepest. That floor supports the points of these contacts "
            'alone. Give its other shapes too, rbd.CollisionContacts("bodies", robot), or may_sink=True to go on'
        )


def _ground(constraint: Constraint, start: State) -> OnGround | None:
    """The points of a contact with friction on ground that does not rise; None for other constraints."""
    if member(constraint, "friction") is None or _is_of_shapes(constraint):
        return None
    source = member(constraint, "source")
    found = source(start) if callable(source) else None
    ground = found.members[0] if isinstance(found, Grounds) else None
    if ground is None or not ground.contact.friction:
        return None
    rises = ground.surface is not None and (ground.surface.moved is not None or bool(ground.normal @ ground.surface.shift(1.0)))
    return None if rises else ground


def _is_of_shapes(constraint: Constraint) -> bool:
    """Whether its points appear and disappear."""
    return callable(member(constraint, "with_margin"))


def _plane_of_shapes(constraint: Constraint) -> tuple[tuple[float, ...], float] | None:
    """The plane on which all shapes of a robot touch, or some; None if there is none."""
    ground = ground_of(constraint)
    if not _is_of_shapes(constraint) or not member(constraint, "ground") or ground is None or ground.point is None:
        return None
    if ground.moves:
        return None
    normal = np.asarray(ground.normal, float)
    normal = normal / np.linalg.norm(normal)
    return _plane(normal, float(normal @ np.asarray(ground.point)))


def _plane(normal: Array, height: float) -> tuple[tuple[float, ...], float]:
    """Normal and height, to a rounding that makes one floor of the same for two soles."""
    return tuple(np.round(normal, 12).tolist()), round(height, 12)


def _link(robot: CheckedModel, joint: int) -> str:
    """Name of the first link that a joint carries; of the joint if none has one."""
    known = robot.model
    return next((f.name for f in known.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY), known.names[joint])
