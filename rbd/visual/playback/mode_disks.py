"""Disks at the points of contacts: their colour is the mode of the point, they are filled by the share of friction used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.simulation.simulated_motion import OPEN, SLIPS, STICKS, Event
from rbd.visual.playback.trajectory_charts import normals_of
from rbd.visual.style import IMPACT, MODE_COLORS

OFF_GROUND = 5e-3
"""Points that are no farther from z = 0 are on the floor [m]."""
IMPACT_SECONDS = 1.0 / 30.0
"""So long after a touch with a speed a point has the colour of an impact [s]: a picture at the usual rate."""
AT_LIMIT = 1.0 - 1e-3
"""A point of a contact that slips, and uses less of its friction, sticks."""


@dataclass(frozen=True, eq=False)
class Disks:
    """Disks at the points of a contact, in the colours of their modes.

    Attributes:
        colors: {mode: its colour}.
        codes: Mode of each point, as its place in `colors`, shape (n, k).
        normals: In W, shape (n, k, 3).
        used: |f_t| / (mu f_n) of each point, from 0 to 1, shape (n, k); NaN where it is not known: such disks are full.
    """

    colors: Mapping[str, str]
    codes: Array
    normals: Array
    used: Array

    def at(self, samples: Array) -> Disks:
        """Those of the samples with these numbers, shape (m,)."""
        return replace(self, codes=self.codes[samples], normals=self.normals[samples], used=self.used[samples])


def contact_disks(
    t: Array,
    points: Mapping[str, Array],
    forces: Mapping[str, Array],
    modes: Mapping[str, Sequence[str]],
    friction: Mapping[str, float],
    events: Iterable[Event],
) -> dict[str, Disks]:
    """{contact: disks at its points}, of contacts whose normal is known: of soles, and of points on the floor z = 0.

    A point without a force is open; others have the mode of their contact, but where that slips, a point within its cone
    sticks. For a thirtieth of a second after a touch with a speed, the mode is "impact".

    Args:
        t: Times, shape (n,) [s].
        points: Of each contact in W, shape (n, k, 3) [m]; NaN where there is none.
        forces: At the points, shape (n, k, 3) [N].
        modes: Of each contact at each time.
        friction: Coulomb's coefficient of each contact that has one.
        events: With the touches.
    """
    place, found = {mode: i for i, mode in enumerate(MODE_COLORS)}, dict[str, Disks]()
    for name, p in points.items():
        f, words = np.asarray(forces[name], float), [str(mode) for mode in modes.get(name, ())]
        normal = _normal(np.asarray(p, float), f)
        if normal is None or len(words) != len(t) or not set(words) <= set(place):
            continue
        size, along = np.linalg.norm(f, axis=2), np.einsum("nki,ni->nk", f, normal)
        sideways, mu = np.linalg.norm(f - along[:, :, None] * normal[:, None], axis=2), friction.get(name, 0.0)
        known = (along > 0.0) & (mu > 0.0)
        used = np.where(known, np.minimum(1.0, sideways / np.where(known, mu * along, 1.0)), np.nan)
        codes = np.where(size > 0.0, np.array([place[word] for word in words])[:, None], place[OPEN])
        codes[(codes == place[SLIPS]) & (used < AT_LIMIT)] = place[STICKS]
        for event in events:
            if event.name == name and event.kind == "touches" and event.speed > 0.0 and 0 <= event.point < codes.shape[1]:
                first, last = np.searchsorted(t, [event.t, event.t + IMPACT_SECONDS])
                codes[first : max(last, first + 1), event.point] = place[IMPACT]
        used[codes == place[IMPACT]] = np.nan
        found[name] = Disks(MODE_COLORS, codes, np.repeat(normal[:, None], codes.shape[1], axis=1), used)
    return found


def _normal(points: Array, forces: Array) -> Array | None:
    """The unit normal of a contact at each time, shape (n, 3); None if it is not known."""
    found = normals_of(points, forces)
    if found is not None:
        return found if np.isfinite(found).all() else None
    heights = np.where(np.linalg.norm(forces, axis=2) > 0.0, points[:, :, 2], 0.0)
    on_the_floor = (np.abs(np.nan_to_num(heights)) <= OFF_GROUND).all() and (forces[:, :, 2] >= 0.0).all()
    return np.tile([0.0, 0.0, 1.0], (len(points), 1)) if on_the_floor else None
