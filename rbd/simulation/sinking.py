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

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times, lazy
from rbd.constraints.constraint import Constraint, ground_of, member
from rbd.constraints.ground_points import OnGround
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.contact_gaps import solids_of

SHARE = 0.25
"""Share of the robot's mass in bodies below the floor from which on it has sunk."""
LOW = 0.5
"""Bodies are looked at once the base is lower than this share of its height at the start; before, a step costs 1 us more."""
LEVEL = 0.5
"""Least cosine of the angle between a floor's normal and the vertical."""


@dataclass(frozen=True, eq=False)
class Floor:
    """The floors of one robot.

    Attributes:
        robot: The robot, or several merged.
        contacts: Names of the contacts on these floors.
        normals: Normal of each floor, shape (m, 3).
        heights: Distance of each from W's origin along its normal, shape (m,) [m].
        place: Where the position of the robot's base begins in q.
        low: Height of the base below which its bodies are looked at [m].
        joints: Joints of the bodies that begin above, shape (n,).
        levers: Centres of mass of these bodies in their joints' axes, shape (n, 3) [m].
        shares: Their shares of the robot's mass, shape (n,).
    """

    robot: CheckedModel
    contacts: tuple[str, ...]
    normals: Array
    heights: Array
    place: int
    low: float
    joints: Array
    levers: Array
    shares: Array

    @classmethod
    def of(cls, start: State, constraints: Sequence[Constraint]) -> tuple[Floor, ...]:
        """The floors of each robot of a state: of those that stand on given points."""
        robot, solids = start.robot, solids_of(start.robot)
        model, gravity = robot.model, float(np.linalg.norm(robot.gravity))
        grounds = [ground for c in constraints if (ground := _ground(c, start)) is not None]
        out = []
        for base in sorted({int(root) for root in solids.roots}):
            tree = np.flatnonzero(solids.roots == base) + 1
            own = [g for g in grounds if robot.site(g.contact.frame)[0] in tree and _is_level(g.normal, robot)]
            motors = np.isin(solids.joint[robot.actuated] + 1, tree)
            if not own or not gravity or not motors.any() or model.joints[base].shortname() != "JointModelFreeFlyer":
                continue
            planes = [_plane(g.normal, g.height) for g in own]
            planes += [plane for c in constraints if (plane := _plane_of_shapes(c)) is not None]
            normals, heights = (np.array(x) for x in zip(*dict.fromkeys(planes), strict=True))
            masses = solids.masses[tree - 1]
            place = model.joints[base].idx_q
            high = float((normals @ start.q[place : place + 3] - heights).max())
            floor = cls(
                robot, tuple(g.contact.name for g in own), normals, heights, place, LOW * high, tree,
                solids.levers[tree - 1], masses / masses.sum(),
            )  # fmt: skip
            above = floor._heights(start) > 0.0
            out.append(floor._only(above))
        return tuple(out)

    def _only(self, kept: Array) -> Floor:
        """The same for some of the bodies."""
        return Floor(
            self.robot, self.contacts, self.normals, self.heights, self.place, self.low, self.joints[kept],
            self.levers[kept], self.shares[kept],
        )  # fmt: skip

    @lazy
    def _planes(self) -> list[list[float]]:
        """Normal and height of each floor as numbers of Python, whose sums take a third of the time."""
        return [[*normal, height] for normal, height in zip(self.normals.tolist(), self.heights.tolist(), strict=True)]

    def _heights(self, state: State) -> Array:
        """Height of each body's centre of mass above the lowest of the floors below it, shape (n,) [m]."""
        R, p = state.joint_places(self.joints.tolist())
        centres = p + each_times(R, self.levers)
        return np.asarray((centres @ self.normals.T - self.heights).max(axis=1))

    def sunk(self, state: State) -> str:
        """Message: how far the robot has sunk, through the floor of which contacts; empty if it has not."""
        x, y, z = state.q[self.place : self.place + 3].tolist()
        for a, b, c, height in self._planes:
            if a * x + b * y + c * z - height > self.low:
                return ""
        heights = self._heights(state)
        share = float(self.shares[heights < 0.0].sum())
        if share < SHARE:
            return ""
        deepest = int(heights.argmin())
        return (
            f"{self.robot.name} sinks through the floor: bodies with {100.0 * share:.0f} % of its mass are below the plane of "
            f"{', '.join(map(repr, self.contacts)):.200}, {_link(self.robot, int(self.joints[deepest]))!r:.80} by "
            f"{-heights[deepest]:.3g} m. That floor supports the points of these contacts alone. Give its other shapes too, "
            'rbd.CollisionContacts("bodies", robot), or may_sink=True to go on'
        )


def _ground(constraint: Constraint, start: State) -> OnGround | None:
    """The points of a contact with friction on ground that does not rise; None for other constraints."""
    source = member(constraint, "source")
    found = source(start) if callable(source) and not _is_of_shapes(constraint) else None
    return found if isinstance(found, OnGround) and found.contact.friction and not found.rise else None


def _is_level(normal: Array, robot: CheckedModel) -> bool:
    return bool(-(normal @ robot.gravity) > LEVEL * np.linalg.norm(robot.gravity))


def _is_of_shapes(constraint: Constraint) -> bool:
    """Whether its points appear and disappear."""
    return callable(member(constraint, "with_margin"))


def _plane_of_shapes(constraint: Constraint) -> tuple[tuple[float, ...], float] | None:
    """The plane on which all shapes of a robot touch, or some; None if there is none."""
    ground = ground_of(constraint)
    if not _is_of_shapes(constraint) or not member(constraint, "ground") or ground is None or ground.point is None:
        return None
    normal = np.asarray(ground.normal, float)
    normal = normal / np.linalg.norm(normal)
    return _plane(normal, float(normal @ np.asarray(ground.point)))


def _plane(normal: Array, height: float) -> tuple[tuple[float, ...], float]:
    """Normal and height, to a rounding that makes one floor of the same for two soles."""
    return tuple(np.round(normal, 12).tolist()), round(height, 12)


def _link(robot: CheckedModel, joint: int) -> str:
    """Name of the first link that a joint carries; of the joint if none has one."""
    frames = (f.name for f in robot.model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)
    return next(frames, robot.model.names[joint])
