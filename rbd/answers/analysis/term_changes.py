"""How the terms of the equations that an answer satisfies change along directions of the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array


@dataclass(frozen=True, eq=False)
class Change:
    """How the terms of the equations change along n directions, at fixed a and f.

    Attributes:
        force: S^T tau + tau_ext + J^T f - (M a + h), shape (nv, n).
        internal: J^T of internal forces, shape (nv, d, n).
        c: Accelerations of the rows, shape (m, n).
        u: Velocities of the rows, shape (m, n).
        resultants: {constraint: force in world axes, shape (k, n)}, of those that change.
    """

    force: Array
    internal: Array
    c: Array
    u: Array
    resultants: dict[str, Array]

    @classmethod
    def none(cls, nv: int, m: int, d: int, force: Array) -> Change:
        """A change of the force alone."""
        n = force.shape[1]
        return cls(force, np.zeros((nv, d, n)), np.zeros((m, n)), np.zeros((m, n)), {})

    def by(self, T: Array) -> Change:
        """The change along other directions, the columns of T, shape (n, k)."""
        resultants = {name: df @ T for name, df in self.resultants.items()}
        return Change(self.force @ T, self.internal @ T, self.c @ T, self.u @ T, resultants)

    def add(self, other: Change) -> None:
        """Add the change of other constraints."""
        self.force[:] += other.force
        self.internal[:] += other.internal
        self.c[:] += other.c
        self.u[:] += other.u
        self.resultants.update(other.resultants)

    def plus(self, other: Change) -> Change:
        """The sum of both changes, of the same constraints."""
        resultants = {name: df + other.resultants[name] for name, df in self.resultants.items()}
        return Change(self.force + other.force, self.internal + other.internal, self.c + other.c, self.u + other.u, resultants)
