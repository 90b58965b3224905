"""Rigid placements as users give them, checked."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, is_finite
from rbd.errors import InputError


def rigid_placement(what: str, placement: pin.SE3 | Array | None) -> pin.SE3:
    """A placement as a pin.SE3; the identity for None.

    Args:
        what: What it is, for messages.
        placement: pin.SE3, a 4 x 4 matrix, or None.

    Raises:
        InputError: if it is not a rigid placement.
    """
    if placement is None:
        return pin.SE3.Identity()
    matrix = placement.homogeneous if isinstance(placement, pin.SE3) else as_array(what, placement)
    R = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
    if not is_finite(matrix) or np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise InputError(f"{what} is no rigid placement; expected pin.SE3 or a 4 x 4 matrix.")
    return pin.SE3(R, matrix[:3, 3])
