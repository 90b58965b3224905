"""Columns of a constraint Jacobian, split into those of known velocities (J1) and of unknown ones (J2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, lazy
from rbd.errors import InputError
from rbd.mechanism.closure import rank_of


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of the constraints' Jacobian, parted into those of known and of unknown velocities.

    Attributes:
        known: Names of the known velocities: those of `robot.joints.velocities` ("crank", "base.wz").
        unknown: Names of the others.
        J_known: J1, shape (m, known).
        J_unknown: J2, shape (m, unknown).
        singular_values: Of J2, with velocities that slide in units of the robot's length, shape (min(m, unknown),).
    """

    known: tuple[str, ...]
    unknown: tuple[str, ...]
    J_known: Array
    J_unknown: Array
    singular_values: Array

    @property
    def rank(self) -> int:
        """Rank of J2."""
        return rank_of(self.singular_values)

    @property
    def sigma_min(self) -> float:
        """Least singular value of J2 [m]; zero where it has fewer rows than columns."""
        s = self.singular_values
        return float(s[-1]) if len(s) and len(s) == len(self.unknown) else 0.0

    @property
    def condition(self) -> float:
        """Largest singular value of J2 over its least; one if nothing is unknown."""
        if not self.unknown:
            return 1.0
        return float(self.singular_values[0] / self.sigma_min) if self.sigma_min > 0.0 else np.inf

    @lazy
    def determinant(self) -> float:
        """Det J2 with its sign, for a square J2; the sign changes with the order of rows and columns.

        Of a four-bar driven by its crank it is b c sin(th3 - th4) [m2] (coupler b at th3, rocker c at th4 from the ground):
        negative on the branch `assembled`, positive on `crossed`, zero where they meet.

        Raises:
            InputError: J2 is not square; `volume` has no sign and exists for all.
        """
        m, n = self.J_unknown.shape
        if m != n:
            names = ", ".join(self.unknown[:8]) or "none"
            raise InputError(f"J2 has {m} rows and {n} columns ({names}), and so no determinant; see `volume`.")
        return float(np.linalg.det(self.J_unknown))

    @lazy
    def volume(self) -> float:
        """sqrt(det(J2^T J2)): |det J2| if it is square, apart from zero rows."""
        gram = self.J_unknown.T @ self.J_unknown
        return float(np.sqrt(max(0.0, np.linalg.det(gram)))) if self.unknown else 1.0

    @lazy
    def influence(self) -> Array:
        """-J2^+ J1, shape (unknown, known): derivative of each unknown velocity by each known one."""
        return -np.linalg.lstsq(self.J_unknown, self.J_known, rcond=None)[0]
