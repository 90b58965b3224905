"""What a contact on terrain rests on at a state: the plane under it, and the corners of the part of it that rests there."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, locked
from rbd.constraints.surface import UP, cone_of
from rbd.constraints.terrain.on_terrain import BESIDE, OnTerrain
from rbd.constraints.terrain.touches import Touches
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.ground import TOUCHES, Ground
from rbd.problem.rows import Rows

SAME_NORMAL = 1e-6
"""Normals that differ by less than this are of one plane."""
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

    It has the corners of the part that rests there, in the same axes and about the same centre.

    Where nothing of it is within a millimetre of the terrain, it has all its corners, and the plane below its centre.

    Raises:
        InputError: where it is over no terrain, or rests on two planes that are inclined to each other.
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
        below = contact.on.ground_at(*X_WP.translation[:2].tolist())
        flat = _on_plane(contact, tuple(np.asarray(below.normal).tolist()), float(below.height), contact.corners.tobytes(), k)
        return flat, found, source
    normals = found.normals[under]
    if np.abs(normals - normals[0]).max() > SAME_NORMAL:
        raise InputError(
            f"contact {contact.name!r} rests on two planes of the terrain, inclined to each other: its forces have no common "
            "axes. Give its corners as contacts of their own, rbd.PointContact, or simulate it: there each point has "
            "the normal of its own plane."
        )
    n, place = normals[0], found.places[under] - found.gaps[under, None] * normals
    local = contact.corners
    if not (len(under) == k and (found.which[under, 0] == 0).all()):
        local = np.round((found.places[under] - X_WP.translation) @ X_WP.rotation, 12)
    if k > 2:
        while len(local) < 3:  # an edge, or a corner: the same forces from three corners
            local = np.vstack([local, local[-1:]])
    height, corners = round(float(n @ place[0]), 12), local.tobytes() if k > 1 else b""
    return _on_plane(contact, tuple(n.tolist()), height, corners, len(local)), found, source


@lru_cache(maxsize=1024)
def _on_plane(contact: Any, normal: tuple[float, ...], height: float, corners: bytes, k: int) -> Any:
    n = np.array(normal)
    out = contact._again(on=Ground(point=height * n, normal=n / np.linalg.norm(n)))
    if k < 2 or len(contact.corners) == 1:
        return out
    own: Array = locked(np.frombuffer(corners).reshape(k, 3).copy())
    if len(contact.corners) == 2:
        return out._again(corners=own)
    out.__dict__.update(corners=own, cone=cone_of(contact.name, own, contact.friction, contact.facets))
    return out
