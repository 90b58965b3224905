"""Axes, corners, placements and force sets of contacts: what is given, checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_finite, is_finite, numbers, three
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone, LineCone, NonNegative, WrenchCone

UP = np.array([0.0, 0.0, 1.0])
_ALONG = 0.7
"""Largest cosine between line and normal: 45 degrees off the surface it is no line contact any more."""


def check_words(whose: str, **words: object) -> None:
    """Refuse names that are no words.

    Args:
        whose: Whose they are, for messages.
        words: What each is: what was given.

    Raises:
        InputError: naming which.
    """
    for what, value in words.items():
        if not isinstance(value, str) or not value:
            raise InputError(f"the {what} of {whose} is {value!r:.80}; expected a word, e.g. 'left_sole'.")


def check_state(state: State, name: str) -> None:
    """Refuse what is no State.

    Raises:
        InputError: with the constraint's name.
    """
    if not isinstance(state, State):
        raise InputError(f"rows of {name!r:.80} want a State, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")


def contact_axes(normal: Array) -> Array:
    """R_WP with the normal as third column, the first along W's x as far as it goes (W's y for a normal along x)."""
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t1 = along - (along @ normal) * normal
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(normal, t1), normal])


def edge_axes(name: str, x: Array, n: Array) -> Array:
    """R_WP of an edge along x: z is the normal n less its part along the edge.

    Raises:
        InputError: the edge stands more than 45 degrees off the surface.
    """
    along = float(n @ x)
    if not abs(along) <= _ALONG:
        raise InputError(
            f"the line of contact {name!r} stands {90.0 - np.rad2deg(np.arccos(min(1.0, abs(along)))):.0f} degrees off its "
            "surface; expected one that lies on it (up to 45 are taken). Is the placement's x along the line?"
        )
    z = n - along * x
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


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
    matrix = placement.homogeneous if isinstance(placement, pin.SE3) else numbers(what, placement)
    R = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
    if not is_finite(matrix) or np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise InputError(f"{what} is no rigid placement; expected pin.SE3 or a 4 x 4 matrix.")
    return pin.SE3(R, matrix[:3, 3])


def cone_of(corners: Array, friction: float | None, facets: int) -> Cone:
    """Set of a contact's row forces."""
    k = len(corners)
    if friction is None:
        return Free({1: 3, 2: 5}.get(k, 6))
    mu = float(friction)
    if k == 1:
        return FrictionCone(mu, facets) if mu else NonNegative(1)
    return LineCone(float(corners[0, 0]), mu, facets) if k == 2 else WrenchCone(corners, mu, facets)


def anchor_of(name: str, anchor: pin.SE3 | Sequence[float] | Array | None, *, point: bool) -> pin.SE3 | None:
    """Where it first touched, as a placement."""
    if anchor is None:
        return None
    if point:
        return pin.SE3(np.eye(3), three(f"anchor of contact {name!r}", anchor))
    return rigid_placement(f"anchor of contact {name!r}", anchor)


def corners_of(name: str, corners: object, X_FP: pin.SE3) -> tuple[Array, pin.SE3]:
    """(corners from the centre, shape (k, 3), the placement of the centre): of a point W's axes, of an edge x along it."""
    given = numbers(f"corners of contact {name!r}", corners)
    if given.ndim != 2 or given.shape[1] not in (2, 3) or not len(given):
        raise InputError(f"corners of contact {name!r} have shape {given.shape}; expected (k, 2) or (k, 3) with k >= 1.")
    check_finite(f"corners of contact {name!r}", given)
    out = np.zeros((len(given), 3))
    out[:, : given.shape[1]] = given
    if len(out) == 1:
        return np.zeros((1, 3)), pin.SE3(np.eye(3), X_FP.act(out[0]))
    spread = np.linalg.svd(out - out.mean(axis=0), compute_uv=False)
    if len(out) > 2:
        if spread[1] <= 1e-9 * max(spread[0], 1e-300) or spread[0] == 0.0:
            raise InputError(f"corners of contact {name!r} lie on one line; a patch needs an area. For a line use LineContact.")
        return out, X_FP
    half = 0.5 * (out[0] - out[1])
    length = float(np.linalg.norm(half))
    if not length > 0.0:
        raise InputError(f"the two corners of contact {name!r} are one point; for a point use PointContact.")
    if half[1] or half[2] or half[0] < 0.0 or (out[0] + out[1]).any():
        x = half / length
        y = np.cross(UP, x) if abs(x[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        z = np.cross(x, y / np.linalg.norm(y))
        X_FP = X_FP * pin.SE3(np.column_stack([x, np.cross(z, x), z]), 0.5 * (out[0] + out[1]))
    return np.array([[length, 0.0, 0.0], [-length, 0.0, 0.0]]), X_FP
