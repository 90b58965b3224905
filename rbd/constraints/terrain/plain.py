"""Terrain as plain data, for files: its corners, faces and heights to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.arrays import as_finite
from rbd.constraints.terrain.pieces import Heights, Piece
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError


def plain_of(terrain: Terrain) -> dict[str, Any]:
    """A terrain as numbers, words and lists."""
    pieces = [[name, _data(solid)] for name, solid in zip(terrain.names, terrain.solids, strict=True)]
    return {"friction": terrain.friction, "pieces": pieces}


def _data(solid: Piece | Heights) -> dict[str, Any]:
    names = ("z", "spacing", "origin") if isinstance(solid, Heights) else ("faces", "vertices")
    loops = {} if isinstance(solid, Heights) else {"loops": [list(loop) for loop in solid.loops]}
    return {name: getattr(solid, name).tolist() for name in names} | loops


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
    return Piece(name, faces, vertices, loops)
