"""What a contact on terrain rests on at a state: the plane under it, and the corners of the part of it that rests there."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, locked, zeros
from rbd.constraints.surface import UP, cone_of
from rbd.constraints.terrain.on_terrain import BESIDE, OnTerrain
from rbd.constraints.terrain.touches import Touches
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.ground import TOUCHES, Ground, motion_of
from rbd.problem.rows import Rows

SAME_NORMAL = 1e-6
"""Normals that differ by less than this are of one plane."""
SAME_MOTION = 1e-9
"""Velocities and accelerations of pieces that differ by less than this are the same [m/s, m/s2]."""
_AT_REST = zeros(9)[None]
_MOST = 256
"""Contacts of a robot whose sources are kept."""
_sources: WeakKeyDictionary[CheckedModel, dict[Any, OnTerrain]] = WeakKeyDictionary()


def resting_rows(contact: Any, state: State) -> Rows:
    """The rows of a contact on terrain: those of what rests, with the depths of points that are inside of pieces.

    Raises:
        InputError: as of `resting_on`.
    """
    resting, found, source = resting_on(contact, state)
    rows: Rows = resting.rows(state)
    deep = np.flatnonzero(found.gaps < -TOUCHES)
    if len(deep):
        inside = [(source.name_of(found, int(m)), -float(found.gaps[m])) for m in deep]
        rows = replace(rows, overlaps=tuple(inside))
    return rows


def resting_on(contact: Any, state: State) -> tuple[Any, Touches, OnTerrain]:
    """(the same contact on the plane under it, what it touches, its source).

    It has the corners of the part that rests there, in the same axes and about the same centre. The plane has the velocity and
    acceleration of its piece at the time of the state; an anchor moves with it.

    Where nothing of it is within a millimetre of the terrain, it has all its corners, and the plane below its centre.

    Raises:
        InputError: where it is over no terrain, or rests on two planes that are inclined to each other, or move differently.
    """
    known = _sources.setdefault(state.robot, {})
    source = known.get(contact)
    if source is None:
        if len(known) >= _MOST:
            known.clear()
        source = known[contact] = OnTerrain([contact], state)
    found, R, p = source.touches(state, TOUCHES)
    X_WP = pin.SE3(R[0], p[0]) * source.placements[0]
    k = len(contact.corners)
    up = X_WP.rotation[:, 2] if k > 2 else UP
    under = np.flatnonzero(found.normals @ up > BESIDE)
    if not len(under):
        below = contact.on.at(state.t).ground_at(*X_WP.translation[:2].tolist())
        n, rates = np.asarray(below.normal), np.concatenate([x[:3] for x in motion_of(below)]).tolist() * below.moves
        flat = _on_plane(contact, tuple(n.tolist()), float(below.height), contact.corners.tobytes(), k, tuple(rates))
        return flat, found, source
    normals = found.normals[under]
    if np.abs(normals - normals[0]).max() > SAME_NORMAL:
        raise InputError(
            f"contact {contact.name!r} rests on two planes of the terrain, inclined to each other: its forces have no common "
            "axes. Give its corners as contacts of their own, rbd.PointContact, or simulate it: there each point has "
            "the normal of its own plane."
        )
    rates = found.rates[found.which[under, 3]] if len(found.rates) else _AT_REST
    if np.abs(rates - rates[0]).max() > SAME_MOTION:
        raise InputError(
            f"contact {contact.name!r} rests on two pieces of the terrain that move differently, and it cannot follow both. "
            "Give its corners as contacts of their own, rbd.PointContact, or simulate it from when they do not yet: there each "
            "point has the motion of its piece."
        )
    n, place = normals[0], found.places[under] - found.gaps[under, None] * normals
    local = contact.corners
    if not (len(under) == k and (found.which[under, 0] == 0).all()):
        local = np.round((found.places[under] - X_WP.translation) @ X_WP.rotation, 12)
    if k > 2:
        while len(local) < 3:  # an edge, or a corner: the same forces from three corners
            local = np.vstack([local, local[-1:]])
    height, corners = round(float(n @ place[0]), 12), local.tobytes() if k > 1 else b""
    belt, shift = rates[0, 6:], ()
    motion = (*(rates[0, :3] + belt - float(belt @ n) * n).tolist(), *rates[0, 3:6].tolist()) if rates[0].any() else ()
    if contact.anchor is not None:
        shift = tuple(contact.on.pieces[found.which[under[0], 3]].shift(state.t).tolist())
    return _on_plane(contact, tuple(n.tolist()), height, corners, len(local), motion, shift), found, source


def shift_under(contact: Any, state: State) -> Array:
    """How far the piece under a contact has moved at the time of a state, in W, shape (3,) [m]; zero where nothing is."""
    _, found, _ = resting_on(contact, state)
    return contact.on.pieces[found.which[0, 3]].shift(state.t) if len(found.gaps) else zeros(3)


@lru_cache(maxsize=1024)
def _on_plane(
    contact: Any,
    normal: tuple[float, ...],
    height: float,
    corners: bytes,
    k: int,
    motion: tuple[float, ...],
    shift: tuple[float, ...] = (),
) -> Any:
    n = np.array(normal)
    velocity, acceleration = (motion[:3], motion[3:]) if motion else (None, None)
    ground = Ground(point=height * n, normal=n / np.linalg.norm(n), velocity=velocity, acceleration=acceleration)
    anchor = contact.anchor
    if any(shift):
        anchor = anchor + shift if len(contact.corners) == 1 else pin.SE3(anchor.rotation, anchor.translation + shift)
    out = contact._again(on=ground, anchor=anchor)
    if k < 2 or len(contact.corners) == 1:
        return out
    own: Array = locked(np.frombuffer(corners).reshape(k, 3).copy())
    if len(contact.corners) == 2:
        return out._again(corners=own)
    out.__dict__.update(corners=own, cone=cone_of(contact.name, own, contact.friction, contact.facets))
    return out
