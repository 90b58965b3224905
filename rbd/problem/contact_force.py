"""What a contact carries, in the words of the field: normal, tangential, friction used, centre of pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.problem.cones import NonNegative, Product, WrenchCone
from rbd.problem.rows import Patch, Rows

CARRIES_NOTHING_N = 1e-6
"""A normal force below this [N] carries nothing: no friction ratio and no centre of pressure are given."""


@dataclass(frozen=True, eq=False)
class ContactForce:
    """One contact's force and where it acts.

    Attributes:
        force: On the robot, world axes, shape (3,) [N].
        normal: Along the contact's normal [N]; positive pushes.
        tangential: Size of the rest [N].
        friction_used: |f_t| / (mu f_n), of the true cone: above 1 where a circumscribed pyramid lets it; None where
            there is no coefficient or nothing is carried. Of a surface: of its net force.
        centre_of_pressure: Point of the patch's plane about which the tangential moment vanishes, in W, shape (3,) [m];
            None where the foot carries nothing.
    """

    force: Array
    normal: float
    tangential: float
    friction_used: float | None
    centre_of_pressure: Array | None

    @classmethod
    def of(cls, patch: Patch, force: Array) -> ContactForce:
        """Parts of a contact's force (3,) or wrench (6,), given at the patch's point in world axes."""
        f = patch.axes.T @ force[:3]
        normal, tangential = float(f[2]), math.hypot(f[0], f[1])
        if normal < CARRIES_NOTHING_N:
            return cls(force[:3], normal, tangential, None, None)
        used = None if not patch.friction else tangential / (patch.friction * normal)
        cop = patch.point
        if len(force) == 6:
            t = patch.axes.T @ force[3:]
            cop = patch.point + patch.axes @ np.array([-t[1] / normal, t[0] / normal, 0.0])
        return cls(force[:3], normal, tangential, used, cop)

    def __str__(self) -> str:
        used = "-" if self.friction_used is None else f"{100 * self.friction_used:.1f} %"
        cop = self.centre_of_pressure
        # + 0.0 turns the -0.000 of rounding into 0.000
        where = "-" if cop is None else "(" + ", ".join(f"{x + 0.0:.3f}" for x in np.round(cop, 3)) + ") m"
        return f"{self.normal:>9.3f} N{self.tangential:>11.3f} N{used:>15}  {where}"


def corner_split(rows: Rows, f: Array) -> Array:
    """Corner forces (k, 3) in world axes that make row forces f: of minimum norm, whatever their signs."""
    assert rows.patch is not None
    k = len(rows.patch.corners)
    if not len(f):
        return np.zeros((k, 3))
    if k == 1:
        assert rows.resultant is not None
        return (rows.resultant @ f)[:3].reshape(1, 3)
    if isinstance(rows.cone, Product | NonNegative):  # points side by side: the row forces are theirs
        local = np.zeros((k, 3))
        local[:, 3 - len(f) // k :] = f.reshape(k, -1)
    else:
        local = np.linalg.lstsq(corner_map(rows), f, rcond=None)[0].reshape(k, 3)
    return local @ rows.patch.axes.T


def corner_map(rows: Rows) -> Array:
    """Row forces of corner forces in contact axes, shape (5 or 6, 3k); a line feels no moment about itself."""
    assert rows.patch is not None
    C = WrenchCone(rows.patch.corners, 0.0).corner_map
    return np.delete(C, 3, axis=0) if len(rows) == 5 else C
