"""Soft contact described: how far surfaces sink under their forces, and how fast they creep within the cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.audits.point_laws import PointLaws
from rbd.audits.record import Record
from rbd.displayed import Displayed

_FEW = 5
"""Points below which nothing is fitted."""


@dataclass(frozen=True)
class Softness(Displayed):
    """How two bodies give way, by medians over the points that push.

    Attributes:
        pair: The bodies.
        points: How many points push.
        stiffness: Normal force over depth [N/m]; inf where they do not sink, NaN where no depth is known.
        creep: Speed of sliding inside the cone, for a friction as large as its limit [m/s]; NaN where no force is inside.
    """

    pair: str
    points: int
    stiffness: float
    creep: float

    def __str__(self) -> str:
        gives = "" if np.isnan(self.stiffness) else f"; stiffness {self.stiffness / 1e3:.4g} kN/m"
        if np.isinf(self.stiffness):
            gives = "; does not sink"
        slow = "" if np.isnan(self.creep) else f"; creeps by {self.creep * 1e3:.3g} mm/s at its friction limit"
        return f"{self.pair}: {self.points} points push{gives}{slow}"


def softness_of(record: Record, laws: PointLaws) -> tuple[Softness, ...]:
    """Of each pair of bodies that touch, the one with most points first."""
    out = []
    pairs, of = np.unique(record.contact_bodies, axis=0, return_inverse=True)
    for j in range(len(pairs)):
        on = np.flatnonzero((of.ravel() == j) & ~laws.free & (laws.push > 0.0))
        if len(on) < _FEW:
            continue
        depth = -record.gaps[on]
        deep = depth > 1e-9
        stiffness = (
            np.nan
            if np.isnan(depth).all()
            else float(np.median(laws.push[on][deep] / depth[deep]))
            if deep.mean() > 0.5
            else np.inf
        )
        inside = on[(laws.share[on] < 0.99) & (laws.share[on] > 0.05)]
        speed = np.linalg.norm(laws.slip[inside], axis=1)
        creep = float(np.median(speed / laws.share[inside])) if len(inside) >= _FEW else np.nan
        out.append(Softness(record.pair(int(on[0])), len(on), stiffness, creep))
    return tuple(sorted(out, key=lambda each: -each.points))
