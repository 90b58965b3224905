"""Grasps of two hands that hold one object: where the second hand is to be, and how far it is from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rbd.arrays import Array, lazy
from rbd.model.checked_model import CheckedModel
from rbd.motion.frame_terms import placements
from rbd.motion.repair.feet import Feet
from rbd.robots.carried import Carried, carried_by


@dataclass(frozen=True, eq=False)
class Grasps:
    """The k objects that a robot holds in two hands, in n frames.

    Attributes:
        things: The objects.
        first: The frames of their first hands.
        second: Those of their second ones.
    """

    things: Sequence[Carried]
    first: Feet
    second: Feet

    @classmethod
    def of(cls, robot: CheckedModel, q: Array) -> Grasps:
        """Those of a robot in configurations, shape (n, nq); only where it holds something are its joints placed."""
        things = [each for each in carried_by(robot) if len(each.grasps) == 2]
        none = np.zeros((0, robot.nq))
        found = cls(things, *(Feet.of(robot, [each.grasps[i] for each in things], none, 1.0) for i in range(2)))
        nowhere = np.zeros((len(q), 1, 3, 3)), np.zeros((len(q), 1, 3))
        return found.at(*(placements(robot, q) if things else nowhere))

    def at(self, R: Array, p: Array) -> Grasps:
        """The same where joints are placed so."""
        return replace(self, first=self.first.at(R, p), second=self.second.at(R, p))

    @property
    def goals(self) -> tuple[Array, Array]:
        """(R, p) of the second hands as the first ones are, shapes (n, k, 3, 3) and (n, k, 3) [m]."""
        X: list[Any] = [each.second for each in self.things]
        R, p = np.array([x.rotation for x in X]).reshape(-1, 3, 3), np.array([x.translation for x in X]).reshape(-1, 3)
        return self.first.R @ R, self.first.p + np.matmul(self.first.R, p[:, :, None])[..., 0]

    @lazy
    def errors(self) -> Array:
        """How far the second hands are from there, shape (n, k, 2) [m, rad]."""
        if not self.things:
            return np.zeros((len(self.first.p), 0, 2))
        off = self.second.error(*self.goals)
        return np.asarray(np.linalg.norm(off.reshape(*off.shape[:2], 2, 3), axis=3))

    def words(self, first: int, end: int) -> str:
        """The object whose grasp is left most from one frame up to another: "of box by 12 mm and 3 degrees"."""
        far = self.errors[first:end].max(axis=0)
        i = int(far[:, 0].argmax())
        return f"of {self.things[i].name} by {1e3 * far[i, 0]:.1f} mm and {np.degrees(far[i, 1]):.1f} degrees"
