"""Axes, corners and placements of contacts: what is given, checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_vector3, check_finite, is_finite
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.ground import Ground, On


def check_names(name: str, frame: str) -> None:
    """Refuse what is no word.

    Raises:
        InputError: naming which of the two.
    """
    for what, value in (("name", name), ("frame", frame)):
        if not isinstance(value, str) or not value:
            raise InputError(f"the {what} of a contact is {value!r:.80}; expected a word, e.g. 'left_sole'.")


def check_state(state: State, name: str) -> None:
    """Refuse what is no State.

    Raises:
        InputError: with the contact's name.
    """
    if not isinstance(state, State):
        raise InputError(f"rows of {name!r} want a State, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")


def contact_axes(normal: Array) -> Array:
    """R_WP with the normal as third column, the first along W's x as far as it goes (W's y for a normal along x)."""
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t1 = along - (along @ normal) * normal
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(normal, t1), normal])


def unit_normal(name: str, normal: Sequence[float] | Array) -> Array:
    """A normal, its length made one to rounding.

    Raises:
        InputError: if it is not of unit length to 1e-6.
    """
    n = as_vector3(f"normal of contact {name!r}", normal)
    length = float(np.linalg.norm(n))
    if abs(length - 1.0) > 1e-6:
        raise InputError(f"normal of contact {name!r} has length {length:.6g}; expected a unit vector.")
    return n / length


def patch_corners(
    name: str, half_lengths: Sequence[float] | Array | None, corners: Sequence[Sequence[float]] | Array | None
) -> Array:
    """Corners of a patch from its half sizes or as given, shape (k, 3) [m].

    Raises:
        InputError: both or neither are given, or the patch has no area.
    """
    if (half_lengths is None) == (corners is None):
        raise InputError(f"contact {name!r} wants half_lengths=(X, Y) or corners=, one of the two.")
    if half_lengths is not None:
        half = as_array(f"half_lengths of contact {name!r}", half_lengths)
        if half.shape != (2,) or not (half > 0.0).all() or not is_finite(half):
            raise InputError(f"half_lengths of contact {name!r} are {half_lengths!r:.80}; expected two lengths > 0 [m].")
        X, Y = half
        return np.array([[X, Y, 0.0], [X, -Y, 0.0], [-X, -Y, 0.0], [-X, Y, 0.0]])
    given = as_array(f"corners of contact {name!r}", corners)
    if given.ndim != 2 or given.shape[1] not in (2, 3) or len(given) < 3:
        raise InputError(
            f"corners of contact {name!r} have shape {given.shape}; expected (k, 2) or (k, 3) with k >= 3. "
            "For one point use PointContact, for two LineContact."
        )
    check_finite(f"corners of contact {name!r}", given)
    out = np.zeros((len(given), 3))
    out[:, : given.shape[1]] = given
    spread = np.linalg.svd(out - out.mean(axis=0), compute_uv=False)
    if spread[1] <= 1e-9 * max(spread[0], 1e-300) or spread[0] == 0.0:
        raise InputError(f"corners of contact {name!r} lie on one line; a patch needs an area. For a line use LineContact.")
    return out


def ground_of(
    name: str,
    on: On,
    against: str | None,
    velocity: Sequence[float] | Array | None,
    anchor: pin.SE3 | None,
    normal: Array | None = None,
) -> tuple[Ground | None, Ground | None]:
    """(the plane that was given, the plane that it is measured from: that, or the one through the anchor).

    A contact with another body, or with a ground that carries it away from its anchor, is not measured.

    Args:
        name: The contact's.
        on: As given.
        against: Frame of another body, or None.
        velocity: Of the ground's surface, or None.
        anchor: Where the contact first touched, or None.
        normal: Of a contact that has one; by default the anchor's z.

    Raises:
        InputError: what is no plane; a plane together with another body, or with another normal.
    """
    plane = Ground.of(name, on)
    if plane is not None and against is not None:
        raise InputError(f"contact {name!r} has both on= and against=: it touches the ground, or the body of {against!r}.")
    if plane is not None and normal is not None and float(np.abs(normal - np.asarray(plane.normal)).max()) > 1e-6:
        raise InputError(
            f"normal of contact {name!r} is {np.round(normal, 6).tolist()}, and that of the ground it is on is "
            f"{np.round(np.asarray(plane.normal), 6).tolist()}; leave normal= out, or give both the same."
        )
    if plane is not None or anchor is None or against is not None or velocity is not None:
        return plane, plane
    n = anchor.rotation[:, 2] if normal is None else normal
    return None, Ground(point=anchor.translation, normal=n / np.linalg.norm(n))


def rigid_placement(what: str, placement: pin.SE3 | Array | None) -> pin.SE3:
    """A placement as a pin.SE3; the identity for None.

    Args:
        what: What it is, for messages.
        placement: pin.SE3, a 4 x 4 matrix, or None.

    Raises:
        InputError: if it is no rigid placement.
    """
    if placement is None:
        return pin.SE3.Identity()
    matrix = placement.homogeneous if isinstance(placement, pin.SE3) else as_array(what, placement)
    R = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
    if not is_finite(matrix) or np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise InputError(f"{what} is no rigid placement; expected pin.SE3 or a 4 x 4 matrix.")
    return pin.SE3(R, matrix[:3, 3])
