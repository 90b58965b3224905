"""Disks at the points of contacts: their colour is the mode of the point, they are filled by the share of friction used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Piece
from rbd.constraints.terrain.terrain import Terrain
from rbd.problem.ground import Ground
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
    planes: Mapping[str, Ground] | None = None,
    terrains: Sequence[Terrain] = (),
) -> dict[str, Disks]:
    """{contact: disks at its points}, of contacts whose normals are known: see `contact_normals`.

    A point without a force is open; others have the mode of their contact, but where that slips, a point within its cone
    sticks. For a thirtieth of a second after a touch with a speed, the mode is "impact".

    Args:
        t: Times, shape (n,) [s].
        points: Of each contact in W, shape (n, k, 3) [m]; NaN where there is none.
        forces: At the points, shape (n, k, 3) [N].
        modes: Of each contact at each time.
        friction: Coulomb's coefficient of each contact that has one.
        events: With the touches.
        planes: Of contacts on planes that stay where they are.
        terrains: Those that contacts are on.
    """
    known_planes = planes or {}
    place, found = {mode: i for i, mode in enumerate(MODE_COLORS)}, dict[str, Disks]()
    for name, p in points.items():
        f, words = np.asarray(forces[name], float), [str(mode) for mode in modes.get(name, ())]
        normal = contact_normals(np.asarray(p, float), f, t, known_planes.get(name), terrains)
        if normal is None or len(words) != len(t) or not set(words) <= set(place):
            continue
        size, along = np.linalg.norm(f, axis=2), np.einsum("nki,nki->nk", f, normal)
        sideways, mu = np.linalg.norm(f - along[:, :, None] * normal, axis=2), friction.get(name, 0.0)
        known = (along > 0.0) & (mu > 0.0)
        used = np.where(known, np.minimum(1.0, sideways / np.where(known, mu * along, 1.0)), np.nan)
        codes = np.where(size > 0.0, np.array([place[word] for word in words])[:, None], place[OPEN])
        codes[(codes == place[SLIPS]) & (used < AT_LIMIT)] = place[STICKS]
        for event in events:
            if event.name == name and event.kind == "touches" and event.speed > 0.0 and 0 <= event.point < codes.shape[1]:
                first, last = np.searchsorted(t, [event.t, event.t + IMPACT_SECONDS])
                codes[first : max(last, first + 1), event.point] = place[IMPACT]
        used[codes == place[IMPACT]] = np.nan
        found[name] = Disks(MODE_COLORS, codes, normal, used)
    return found


def contact_normals(
    points: Array, forces: Array, t: Array, plane: Ground | None, terrains: Sequence[Terrain]
) -> Array | None:
    """The unit normals at the points of a contact at each time, shape (n, k, 3); None if they are not known.

    That of its plane, where it is on a plane that stays; else of the plane through its loaded points; else of the face of
    terrain that is within 5 mm of each loaded point, zero for points without a load; else of the floor z = 0.

    Args:
        points: In W, shape (n, k, 3) [m]; NaN where there is none.
        forces: At the points, shape (n, k, 3) [N].
        t: Times, shape (n,) [s].
        plane: The plane of the contact, where it is known and stays.
        terrains: Those that contacts are on.
    """
    n, k = points.shape[:2]
    if plane is not None:
        return np.tile(np.asarray(plane.normal, float), (n, k, 1))
    found = normals_of(points, forces)
    if found is not None:
        return np.repeat(found[:, None], k, axis=1) if np.isfinite(found).all() else None
    loaded = np.linalg.norm(forces, axis=2) > 0.0
    if terrains and loaded.any():
        out = np.zeros((n, k, 3))
        near, out[loaded] = _faces(terrains, points[loaded], forces[loaded], np.broadcast_to(t[:, None], (n, k))[loaded])
        if (near <= OFF_GROUND).all():
            return out
    heights = np.where(loaded, points[:, :, 2], 0.0)
    on_the_floor = (np.abs(np.nan_to_num(heights)) <= OFF_GROUND).all() and (forces[:, :, 2] >= 0.0).all()
    return np.tile([0.0, 0.0, 1.0], (n, k, 1)) if on_the_floor else None


def _faces(terrains: Iterable[Terrain], points: Array, forces: Array, t: Array) -> tuple[Array, Array]:
    """(distance from the nearest piece [m], normal of the face there) of each point, shapes (m,) and (m, 3)."""
    near, normals = np.full(len(points), np.inf), np.zeros((len(points), 3))
    for solid in (solid for terrain in terrains for solid in terrain.solids):
        there = points
        if isinstance(solid, Piece) and solid.moved is not None:
            there = points - [solid.shift(at) for at in t.tolist()]
        distance, normal = solid.face_at(there, forces)
        nearer = distance < near
        near[nearer], normals[nearer] = distance[nearer], normal[nearer]
    return near, normals
