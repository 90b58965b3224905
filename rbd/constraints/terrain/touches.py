"""What flat plates touch of convex pieces at one state, by the compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Polytopes

_ROOM = 64
"""Points of one plate for which there is room at first."""


class Touches:
    """What plates touch at one state: k points.

    Attributes:
        places: On the plates, in W, shape (k, 3) [m].
        normals: Out of the terrain, shape (k, 3).
        gaps: Along them, shape (k,) [m].
        which: Kind, two numbers, piece, - and plate of each, shape (k, 6); see `touching_kernel`.
    """

    __slots__ = ("gaps", "normals", "places", "plates", "ups", "ways", "which")

    def __init__(
        self,
        pieces: Callable[[Array, Array], Polytopes],
        plates: Array,
        at: Array,
        ups: Array,
        radii: Array,
        margin: float,
    ) -> None:
        far = margin + float(radii.max(initial=0.0))
        low, high = plates.min(axis=0) - far, plates.max(axis=0) + far
        arrays, most, k = pieces(low, high), _ROOM * len(ups), -1
        while k < 0:  # where many pieces are near, with more room
            places, normals, ways = np.empty((3, most, 3))
            gaps, which, most = np.empty(most), np.zeros((most, 6), int), 4 * most
            k = kernel().touching(plates, at, ups, radii, margin, *arrays, places, normals, gaps, which, ways)
        self.places, self.normals, self.gaps, self.which, self.ways = (x[:k] for x in (places, normals, gaps, which, ways))
        self.plates, self.ups = plates, ups


@cache
def kernel() -> ModuleType:
    """The compiled functions, which are compiled or read from the disk when they are first asked for."""
    from rbd.constraints.terrain import touching_kernel

    return touching_kernel


@cache
def motion_kernel() -> ModuleType:
    """The compiled functions of the points' motion."""
    from rbd.constraints.terrain import motion_kernel as compiled_functions

    return compiled_functions
