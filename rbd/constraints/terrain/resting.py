"""What a contact on terrain rests on at a state: the planes under it, and the corners of the part of it that rests there.

A contact that holds is rigid on whatever it rests: its rows are those of its pose. On one plane its forces are those of the
part that rests there; on planes of different normals each point has a friction cone about the normal of its own.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, locked, zeros
from rbd.constraints.surface import UP, cone_of, contact_axes
from rbd.constraints.terrain.on_terrain import BESIDE, OnTerrain
from rbd.constraints.terrain.touches import Touches
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Cone
from rbd.problem.corner_cones import UnevenCone
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
    """The rows of a contact on terrain: of what rests of it, with the depths of points that are inside of pieces.

    They have its own axes, about its own centre. Where nothing of it is within a millimetre of the terrain, it has all its
    corners, and the plane below its centre.

    Raises:
        InputError: where it is over no terrain, or rests on pieces that move differently.
    """
    found, X_WP, source = _touched(contact, state)
    rows = _rows(contact, state, found, X_WP)
    deep = np.flatnonzero(found.gaps < -TOUCHES)
    if len(deep):
        inside = [(source.name_of(found, int(m)), -float(found.gaps[m])) for m in deep]
        rows = replace(rows, overlaps=tuple(inside))
    return rows


def _touched(contact: Any, state: State) -> tuple[Touches, pin.SE3, OnTerrain]:
    """(what it touches, its pose, its source)."""
    known = _sources.setdefault(state.robot, {})
    source = known.get(contact)
    if source is None:
        if len(known) >= _MOST:
            known.clear()
        source = known[contact] = OnTerrain([contact], state)
    found, R, p = source.touches(state, TOUCHES)
    return found, pin.SE3(R[0], p[0]) * source.placements[0], source


def shift_under(contact: Any, state: State) -> Array:
    """How far the piece under a contact has moved at the time of a state, in W, shape (3,) [m]; zero where nothing is."""
    found = _touched(contact, state)[0]
    return contact.on.pieces[found.which[0, 3]].shift(state.t) if len(found.gaps) else zeros(3)


def _rows(contact: Any, state: State, found: Touches, X_WP: pin.SE3) -> Rows:
    k = len(contact.corners)
    up = X_WP.rotation[:, 2] if k > 2 else UP
    under = np.flatnonzero(found.normals @ up > BESIDE)
    if not len(under):
        below = contact.on.at(state.t).ground_at(*X_WP.translation[:2].tolist())
        rates = np.concatenate([x[:3] for x in motion_of(below)]).tolist() * below.moves
        corners = contact.corners.tobytes()
        return _of(_on_plane(contact, _tuple(below.normal), float(below.height), corners, k, tuple(rates)), state)
    normals, own = found.normals[under], contact.corners
    whole = len(under) == k and (found.which[under, 0] == 0).all()
    inclined = bool(np.abs(normals - normals[0]).max() > SAME_NORMAL)
    rates = found.rates[found.which[under, 3]] if len(found.rates) else _AT_REST
    if np.abs(rates - rates[0]).max() > SAME_MOTION or (inclined and rates[0, 6:].any()):
        raise InputError(
            f"contact {contact.name!r} rests on two pieces of the terrain that move differently, and it cannot follow both. "
            "Give its corners as contacts of their own, rbd.PointContact, or simulate it from when they do not yet: there each "
            "point has the motion of its piece."
        )
    shift: tuple[float, ...] = ()
    if contact.anchor is not None:
        shift = tuple(contact.on.pieces[found.which[under[0], 3]].shift(state.t).tolist())
    if inclined:
        under = under[np.lexsort((found.which[under, 1], found.which[under, 0]))]  # corners first, in their order
        own, corner = (found.places[under] - X_WP.translation) @ X_WP.rotation, found.which[under, 0] == 0
        own[corner] = contact.corners[found.which[under[corner], 1]]
        motion = _tuple(rates[0, :6]) if rates[0].any() else ()
        return _uneven_rows(contact, state, found.normals[under], own, motion, shift)
    n, place = normals[0], found.places[under] - found.gaps[under, None] * normals
    if not whole:
        own = np.round((found.places[under] - X_WP.translation) @ X_WP.rotation, 12)
    if k > 2:
        while len(own) < 3:  # an edge, or a corner: the same forces from three corners
            own = np.vstack([own, own[-1:]])
    height, corners = round(float(n @ place[0]), 12), own.tobytes() if k > 1 else b""
    belt = rates[0, 6:]
    motion = (*(rates[0, :3] + belt - float(belt @ n) * n).tolist(), *rates[0, 3:6].tolist()) if rates[0].any() else ()
    return _of(_on_plane(contact, _tuple(n), height, corners, len(own), motion, shift), state)


def _uneven_rows(
    contact: Any, state: State, normals: Array, own: Array, motion: tuple[float, ...], shift: tuple[float, ...]
) -> Rows:
    """The rows of its pose, with forces at points of different normals; `own`: from its centre, in its axes, shape (k, 3)."""
    n, friction = normals.sum(axis=0), contact.friction
    rows = _of(_held(contact, _tuple(n / np.linalg.norm(n)), motion, shift), state)
    patch = rows.patch
    assert patch is not None
    if friction is None:
        return rows
    own = own * ([0.0] * 3 if len(rows) == 3 else [1.0, 0.0, 0.0] if len(rows) == 5 else [1.0] * 3)
    turned = np.array([patch.axes.T @ contact_axes(normal, patch.axes[:, 0]) for normal in normals])
    cone = _uneven(own.tobytes(), turned.tobytes(), friction, contact.facets, len(rows))
    return replace(rows, cone=cone, patch=replace(patch, corners=cone.corners, turned=cone.axes, friction=friction, on=None))


def _of(contact: Any, state: State) -> Rows:
    rows: Rows = contact.rows(state)
    return rows


def _tuple(x: Any) -> tuple[float, ...]:
    return tuple(np.asarray(x).tolist())


@lru_cache(maxsize=1024)
def _held(contact: Any, normal: tuple[float, ...], motion: tuple[float, ...], shift: tuple[float, ...]) -> Any:
    """The same contact with all rows of its pose, on ground whose place is not known."""
    on = Ground(normal=np.array(normal), **_moving(motion))
    return contact._again(on=on, friction=None, anchor=_shifted(contact, shift))


def _moving(motion: tuple[float, ...]) -> dict[str, Any]:
    return {"velocity": motion[:3], "acceleration": motion[3:]} if motion else {}


def _shifted(contact: Any, shift: tuple[float, ...]) -> Any:
    """Its anchor, which moves with its piece."""
    anchor = contact.anchor
    if not any(shift):
        return anchor
    return anchor + shift if len(contact.corners) == 1 else pin.SE3(anchor.rotation, anchor.translation + shift)


@lru_cache(maxsize=256)
def _uneven(corners: bytes, axes: bytes, friction: float | Cone, facets: int, dim: int) -> UnevenCone:
    """The set of these points' forces: the same object at the same place."""
    return UnevenCone(np.frombuffer(corners).reshape(-1, 3), np.frombuffer(axes).reshape(-1, 3, 3), friction, facets, dim)


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
    ground = Ground(point=height * n, normal=n / np.linalg.norm(n), **_moving(motion))
    out = contact._again(on=ground, anchor=_shifted(contact, shift))
    if k < 2 or len(contact.corners) == 1:
        return out
    own: Array = locked(np.frombuffer(corners).reshape(k, 3).copy())
    if len(contact.corners) == 2:
        return out._again(corners=own)
    out.__dict__.update(corners=own, cone=cone_of(contact.name, own, contact.friction, contact.facets))
    return out
