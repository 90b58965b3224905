"""The pairs of moving bodies that touch in a record, whatever points an engine lists for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.audits.record import WORLD, Record


@dataclass(frozen=True, eq=False)
class BodyPairs:
    """The p pairs of bodies that touch at any of a record's k points, or of several records.

    A force is that on the body whose joint has the larger number: the world feels none.

    Attributes:
        names: Of each pair, in words.
        joints: Joints that carry the bodies, that which feels the force first, shape (p, 2); 0 is the world.
        of: Pair of each point, shape (k,).
        signs: 1 where the record's force is on the first body of the pair, else -1, shape (k,).
    """

    names: tuple[str, ...]
    joints: Array
    of: Array
    signs: Array

    @classmethod
    def of_records(cls, records: Sequence[Record]) -> tuple[BodyPairs, ...]:
        """Those of records of one robot, numbered alike."""
        ends = np.concatenate([record.joints[record.contact_bodies] for record in records])
        bodies = np.concatenate([np.array(record.bodies)[record.contact_bodies] for record in records])
        forth = ends[:, 0] >= ends[:, 1]
        joints, at, of = np.unique(np.sort(ends, axis=1)[:, ::-1], axis=0, return_index=True, return_inverse=True)
        pairs = [bodies[i, :: 1 if forth[i] else -1].tolist() for i in at]
        names = tuple([first if second == WORLD else f"{first} on {second}" for first, second in pairs])
        sizes = np.cumsum([len(record.contact_at) for record in records])[:-1]
        each = zip(np.split(of.reshape(-1), sizes), np.split(np.where(forth, 1.0, -1.0), sizes), strict=True)
        return tuple([cls(names, joints, of, signs) for of, signs in each])

    def forces(self, record: Record) -> Array:
        """Resultant of each pair in each frame, in W, shape (n, p, 3) [N]."""
        out = np.zeros((record.n, len(self.names), 3))
        np.add.at(out, (record.contact_at, self.of), self.signs[:, None] * record.forces)
        return out

    def on(self, record: Record, frame: int, pair: int) -> Array:
        """Numbers of the points of a pair in a frame."""
        points = record.of_frame(frame)
        return points.start + np.flatnonzero(self.of[points.start : points.stop] == pair)

    def centre(self, record: Record, frame: int, pair: int) -> Array:
        """Centre of pressure of a pair in a frame, in W, shape (3,) [m]; NaN where it does not push."""
        at = self.on(record, frame, pair)
        push = np.maximum(np.einsum("ki,ki->k", record.forces[at], record.normals[at]), 0.0)
        return push @ record.points[at] / push.sum() if push.any() else np.full(3, np.nan)
