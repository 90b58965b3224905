"""What plates, balls and hulls touch of convex pieces at one state, and the rows of these points, by the compiled functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from types import ModuleType

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Plates, Polytopes, Spots
from rbd.model.state import State

_ROOM = 64
"""Points of one plate for which there is room at first."""


class Touches:
    """What plates touch at one state: k points.

    Attributes:
        plates: The plates.
        spots: The points; so the next four.
        places: On the plates, in W, shape (k, 3) [m].
        normals: Out of the terrain, shape (k, 3).
        gaps: Along them, shape (k,) [m].
        which: As of `Spots`.
        rates: Of the pieces, as of `Polytopes`.
    """

    __slots__ = ("gaps", "normals", "places", "plates", "rates", "spots", "which")

    def __init__(self, plates: Plates, spots: Spots, rates: Array) -> None:
        self.plates, self.spots, self.rates = plates, spots, rates
        self.places, self.normals, self.gaps, self.which, _ = spots

    @classmethod
    def of(cls, pieces: Callable[[Array, float, float], Polytopes], plates: Plates, margin: float, t: float = 0.0) -> Touches:
        """What is nearer than a margin [m], of the pieces near to some points at a time [s]."""
        arrays = pieces(plates.corners, margin + plates.radii.max(initial=0.0), t)
        touching = kernel("touching").touching
        spots = filled(_ROOM * len(plates.ups), lambda out: int(touching(plates, margin, arrays, out)))
        return cls(plates, spots, arrays.rates)

    def rows(
        self, state: State, joints: Sequence[int], body: Array, carries: Array, alongs: Array
    ) -> tuple[Array, Array, Array, Array]:
        """(R_WC (k, 3, 3), J (3k, nv), velocity and J_dot v relative to the pieces (3k,)), three rows a point, in contact axes.

        Args:
            state: Where they were found.
            joints: Of the bodies.
            body: The body of each plate, shape (plates,).
            carries: Which coordinates move each body, shape (bodies, nv).
            alongs: A direction in W for the first tangent of each plate, shape (plates, 3).
        """
        k, nv = len(self.gaps), len(state.v)
        out = np.empty((k, 3, 3)), np.empty((3 * k, nv)), np.empty(3 * k), np.empty(3 * k)
        J_W = state.joint_motion(joints)[2]
        kernel("motion").rows(self.spots, self.plates, self.rates, body, carries, J_W, state.v, alongs, *out)
        return out


def filled(most: int, run: Callable[[Spots], int]) -> Spots:
    """The points that a compiled function writes: with four times the room where it finds none for all of them."""
    k = -1
    while k < 0:
        places, normals, ways = np.empty((3, most, 3))
        out = Spots(places, normals, np.empty(most), np.zeros((most, 6), int), ways)
        k, most = run(out), 4 * most
    return Spots(*(x[:k] for x in out))


@cache
def kernel(name: str) -> ModuleType:
    """Compiled functions, which are compiled or read from the disk when they are first asked for."""
    return import_module(f"rbd.constraints.terrain.{name}_kernel")
