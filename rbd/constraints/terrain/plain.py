"""Terrain as plain data, for files: its corners, faces and heights to the last bit; motions of pieces at times.

Between these times a motion that is read is the polynomial of fifth order with the values and two derivatives at both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.arrays import Array, as_finite
from rbd.constraints.terrain.pieces import Heights, Piece
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.problem.motions import Motion, Speed


def plain_of(terrain: Terrain, times: Array | None = None) -> dict[str, Any]:
    """A terrain as numbers, words and lists; with motions at times that increase, shape (n,) [s]."""
    pieces = [[name, _data(solid, times)] for name, solid in zip(terrain.names, terrain.solids, strict=True)]
    return {"friction": terrain.friction, "pieces": pieces}


def _data(solid: Piece | Heights, times: Array | None) -> dict[str, Any]:
    if isinstance(solid, Heights):
        return {name: getattr(solid, name).tolist() for name in ("z", "spacing", "origin")}
    out = {"faces": solid.faces.tolist(), "vertices": solid.vertices.tolist(), "loops": [list(loop) for loop in solid.loops]}
    if solid.rates is not None and solid.rates[6:].any():
        out["velocity"] = solid.rates[6:].tolist()
    if solid.moved is not None and times is not None:
        out["motion"] = [np.unique(times).tolist(), [solid.moved.at(t).tolist() for t in np.unique(times).tolist()]]
    return out


def terrain_of(given: object) -> Terrain:
    """The terrain of `plain_of`.

    Raises:
        InputError: other data.
    """
    try:
        known: Any = given
        return Terrain({str(name): _solid(str(name), data) for name, data in known["pieces"]}, known["friction"])
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise InputError(f"a terrain in its header is {given!r:.80}; expected friction and pieces") from error


def _solid(name: str, data: Any) -> Piece | Heights:
    if "z" in data:
        return Heights.of(name, data["z"], data["spacing"], data["origin"])
    faces = as_finite("faces of a terrain's piece", data["faces"], ("f", 4))
    vertices = as_finite("corners of a terrain's piece", np.reshape(data["vertices"], (-1, 3)), ("v", 3))
    loops = tuple([tuple([int(i) for i in loop]) for loop in data["loops"]])
    if len(loops) != len(faces) or not all(0 <= i < len(vertices) for loop in loops for i in loop):
        raise InputError(f"piece {name!r:.80} of a terrain names corners that it does not have")
    piece = Piece(name, faces, vertices, loops)
    if "velocity" in data:
        return piece.moving(None, data["velocity"])
    return piece.moving(_motion(*data["motion"]), None) if "motion" in data else piece


def _motion(given: object, values: object) -> Motion:
    from scipy.interpolate import BPoly

    times = as_finite("times of a terrain's motion", given, ("n",))
    known = as_finite("motion of a terrain's piece", values, (len(times), 3, 3))
    if len(times) == 1:
        return Speed(known[0, 1], start=known[0, 0] - known[0, 1] * times[0])
    if not (np.diff(times) > 0.0).all():
        raise InputError("the times of a motion of a terrain's piece do not increase")
    return BPoly.from_derivatives(times, known)
