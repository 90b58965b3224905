"""Points that slide in a step: which way friction points, and which of them stop."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.simulation.snapshot import Layout
from rbd.simulation.watch import SLIDES


def turned_back(layout: Layout, active: Array, u: Array, change: Array, pushed: Array) -> Array | None:
    """What takes a velocity after half a step more back by that half, where a point slides throughout; zero elsewhere.

    Args:
        layout: The points.
        active: Which of them act, shape (k,).
        u: Their velocities, shape (p,).
        change: By how much these change in half a step, shape (p,).
        pushed: Row forces or impulses before, shape (p,): what carried nothing had no friction to turn.
    """
    rows = layout.tangents
    if not len(rows) or not np.abs(u[rows]).max() > SLIDES:
        return None
    one, turned = u[rows], change[rows]
    speed = np.hypot(*one.T)
    slides = (speed > SLIDES) & (speed > 4.0 * np.hypot(*turned.T)) & (pushed[rows[:, 1] + 1] > 0.0) & active[layout.rubs]
    if not slides.any():
        return None
    out = np.zeros(len(u))
    out[rows[slides]] = -turned[slides]
    return out


def stopping(layout: Layout, u0: Array, u1: Array, pushed: Array) -> Array | None:
    """Which of the points that slide or rub stop or turn back between two velocities; None where none does."""
    if not layout.slides.any():
        return None
    rows, kept = layout.sliding_rows, layout.sliding_kept
    if not np.abs(u0[rows]).max() > 10.0 * SLIDES:
        return None
    one, two = u0[rows] * kept, u1[rows] * kept
    before = np.hypot(*one.T)
    turns = (np.hypot(*two.T) <= SLIDES) | ((one * two).sum(axis=1) < 0.0)
    stops = (pushed[layout.normals[layout.slides]] != 0.0) & (before > 10.0 * SLIDES) & turns
    return stops if stops.any() else None
