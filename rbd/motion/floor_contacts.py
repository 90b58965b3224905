"""Contacts of a motion that is being integrated: those that its reference wants, where they touch; and those that land."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import Contact
from rbd.control.stepping import TaskActuation
from rbd.model.state import State
from rbd.motion.lanes import Lanes

LANDED = 1e-3
"""A contact touches when its lowest point is this near to the floor [m]; an unwanted one, when it is this far below."""
UNLOADED = 0.01
"""It ends when it carries less than this share of the weight."""


class FloorContacts:
    """Which points of a robot touch the floor now; changes with `update` from time to time.

    Attributes:
        lanes: The contacts of the reference.
        feet: Its contacts, in their order.
        friction: The coefficient, less the margin.
        margin: Share of the friction, and of each foot's size, that is not used.
        on: Which points touch, shape (k,).
    """

    def __init__(self, lanes: Lanes, friction: float, margin: float) -> None:
        self.lanes, self.friction, self.margin = lanes, (1.0 - margin) * friction, margin
        self.feet: Sequence[Constraint] = lanes.contacts
        self.on = np.zeros(len(lanes.points), bool)
        self._unplanned = np.zeros(len(lanes.contacts), bool)
        self._load = np.zeros(len(lanes.contacts))
        self._known: dict[tuple[int, bytes], Constraint] = {}

    def begin(self, touches: Array) -> None:
        """The points that touch first."""
        self.on = touches.copy()

    def update(self, state: State, frame: int) -> Array:
        """Which contacts touch at a state, shape (contacts,); by the frame of the reference that belongs to it."""
        points, wanted = self.lanes.points, self.lanes.touches[frame]
        R, p = state.joint_places(points.joint.tolist())
        low = (R @ points.local[:, :, None])[..., 0][:, 2] + p[:, 2] - points.radius - self.lanes.ground
        weight = state.robot.mass * float(np.linalg.norm(state.robot.gravity))
        for g in range(len(self.feet)):
            own = points.group == g
            if not own.any():
                continue
            lowest = float(low[own].min())
            planned, was = bool(wanted[own].any()), bool(self.on[own].any())
            if planned:
                touching = wanted[own] if was or lowest <= LANDED else np.zeros(own.sum(), bool)
            elif self._unplanned[g] and was and self._load[g] > UNLOADED * weight:
                touching = self.on[own]
            else:
                touching = low[own] <= lowest + LANDED if lowest < -LANDED else np.zeros(own.sum(), bool)
            self._unplanned[g] = not planned and touching.any()
            self.on[own] = touching
        return np.array([self.on[points.group == g].any() for g in range(len(self.feet))])

    def carried(self, answer: TaskActuation) -> None:
        """Told what the contacts carried."""
        for g, foot in enumerate(self.feet):
            forces = [f for name, f in answer.forces.items() if name == foot.name or name.startswith(f"{foot.name} ")]
            self._load[g] = sum(float(f[2]) for f in forces)

    def constraints(self, state: State) -> list[Constraint]:
        """The contacts of the points that touch; of a foot one with its corners, of other bodies one for each point."""
        out: list[Constraint] = []
        points = self.lanes.points
        for g, foot in enumerate(self.feet):
            own = np.flatnonzero(points.group == g)
            chosen = own[self.on[own]]
            if not len(chosen):
                continue
            if isinstance(foot, Contact):
                key = (g, self.on[own].tobytes())
                if key not in self._known:
                    corners = foot.corners[self.on[own]]
                    inner = corners + self.margin * (corners.mean(axis=0) - corners)
                    self._known[key] = Contact(
                        foot.name, foot.frame, corners=inner, placement=foot.placement, friction=self.friction,
                        facets=foot.facets,
                    )  # fmt: skip
                out.append(self._known[key])
                continue
            R, _ = state.joint_places(points.joint[chosen].tolist())
            for j, rotation in zip(chosen.tolist(), R, strict=True):
                place = points.local[j] - points.radius[j] * rotation.T[:, 2]
                frame = state.robot.model.names[int(points.joint[j])]
                out.append(Contact(points.names[j], frame, corners=place[None], friction=self.friction))
        return out
