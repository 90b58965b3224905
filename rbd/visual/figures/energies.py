"""The energies of a motion as curves: for plots and for charts on pages."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.visual.style import CONTACT_COLORS

TOTAL_COLOR = "#1a1a1a"


class EnergyCurve(NamedTuple):
    """One curve: its name, its colour, and its values at the samples [J], shape (n,)."""

    name: str
    color: str
    values: Array


def energy_curves(shown: Any) -> list[EnergyCurve]:
    """Kinetic, potential (from its start) and total energy; then, where there are any, of springs, and work of dampers.

    Args:
        shown: A `Trajectory`, or a part of it with `kinetic`, `potential`, and if known `elastic` and `dissipated`.
    """
    n = len(shown.kinetic)
    elastic, taken = (getattr(shown, name, np.zeros(n)) for name in ("elastic", "dissipated"))
    potential, taken = shown.potential - shown.potential[0], taken - taken[:1]
    out = [EnergyCurve("kinetic", CONTACT_COLORS[0], shown.kinetic)]
    out.append(EnergyCurve("potential, from its start", CONTACT_COLORS[2], potential))
    out.append(EnergyCurve("total", TOTAL_COLOR, shown.kinetic + potential + elastic))
    if elastic.any():
        out.append(EnergyCurve("in springs", CONTACT_COLORS[3], elastic))
    if taken.any():
        out.append(EnergyCurve("work taken by dampers", CONTACT_COLORS[4], taken))
    return out
