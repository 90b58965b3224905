"""Stances of feet and their paths: flat on their treads and fixed while they stand, smooth above what lies between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times, lazy
from rbd.centroid.program import inner_corners
from rbd.constraints.contact import Contact
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import minimum_jerk_way
from rbd.motion.contact_timeline import stretches
from rbd.motion.frame_terms import placements
from rbd.motion.repair.treads import (
    Tread,
    height_at,
    nearest_within,
    needed_rise,
    part_on,
    raise_of,
    sole_points,
    tilts_of,
)

LEAST_STANCE, LEAST_SWING, BOTH = 0.12, 0.3, 0.1
"""Shortest stance and shortest step [s]; and how long two feet share the load where one takes it from the other."""
DRIFT, TURN = 0.06, 0.45
"""A foot that moves farther [m], or turns farther [rad], while it stands, makes one more step where there is time for one."""
STEP = 0.3
"""Duration of such a step [s]."""
APART = 0.12
"""Least time between it and other changes of the feet [s]."""
FLIGHT, FAST, FLIGHTS = 0.05, 0.7, (0.06, 0.8)
"""Nothing stands where the lowest foot is this high [m] or the slowest this fast [m/s], from so long to so long [s]."""
CLEAR = 0.04
"""Height of the lowest corner in the middle of a step, at least [m]."""
SMOOTH = 0.03
"""Standard deviation of the filter of positions of feet [s]."""
LEAN = 0.1
"""Soles that stand on an edge lean on it from this pitch on [rad]; others are put flat."""
WIDTH = 1e-3
"""Corners so near to the foremost or hindmost one are on the same edge [m]."""


@dataclass(frozen=True, eq=False)
class Feet:
    """The feet of a robot over n frames: F frames fixed to bodies, with corners.

    Attributes:
        joint: Which joint carries each, shape (F,).
        R_J: Orientation of each foot in its joint's axes, shape (F, 3, 3).
        p_J: Its origin, shape (F, 3) [m].
        corners: Points in its own axes, one array (k, 3) a foot [m].
        flat: Which of them are surfaces: their orientation matters, shape (F,).
        R: Orientations in W, shape (n, F, 3, 3).
        p: Origins in W, shape (n, F, 3) [m].
        dt: Time between frames [s].
        lean: Pitch of soles on an edge, positive on the toes, zero of flat ones, shape (n, F) [rad].
        planes: Of what is under each, as of `Tread`, shape (n, F, 3); headings and tilts are those on it.
    """

    joint: Array
    R_J: Array
    p_J: Array
    corners: tuple[Array, ...]
    flat: Array
    R: Array
    p: Array
    dt: float
    lean: Array
    planes: Array

    @classmethod
    def of(cls, robot: CheckedModel, frames: Sequence[Contact | str], q: Array, dt: float) -> Feet:
        """Those of configurations, shape (n, nq); also of frames, which count as surfaces."""
        sites, corners = list[tuple[int, pin.SE3]](), list[Array]()
        for frame in frames:
            joint, X = robot.site(frame if isinstance(frame, str) else frame.frame)
            sites.append((joint, X if isinstance(frame, str) else X * frame.placement))
            corners.append(np.zeros((1, 3)) if isinstance(frame, str) else frame.corners)
        flat = [isinstance(frame, str) or len(frame.corners) > 2 for frame in frames]
        none = np.zeros((0, len(sites), 3))
        found = cls(
            np.array([joint for joint, _ in sites], int), np.array([X.rotation for _, X in sites]).reshape(-1, 3, 3),
            np.array([X.translation for _, X in sites]).reshape(-1, 3), tuple(corners), np.array(flat, bool), none, none, dt,
            np.zeros((len(q), len(sites))), np.zeros((len(q), len(sites), 3)),
        )  # fmt: skip
        return found.at(*placements(robot, q))

    def at(self, R: Array, p: Array) -> Feet:
        """The same feet where joints are placed so, as `placements`."""
        turned, n = R[:, self.joint], len(p)
        if len(self.planes) != n:  # of other frames
            return replace(self, lean=np.zeros((n, len(self.joint))), planes=np.zeros((n, len(self.joint), 3))).at(R, p)
        return replace(self, R=turned @ self.R_J, p=p[:, self.joint] + np.matmul(turned, self.p_J[:, :, None])[..., 0])

    @lazy
    def low(self) -> Array:
        """Height of the lowest corner of each foot, shape (n, F) [m]."""
        low = [(self.p[:, f, 2, None] + self.R[:, f, 2] @ c.T).min(axis=1) for f, c in enumerate(self.corners)]
        return np.array(low).reshape(len(self.corners), len(self.p)).T

    @lazy
    def over(self) -> Array:
        """Height of the lowest corner of each foot over its plane, shape (n, F) [m]."""
        out = np.empty(self.p.shape[:2])
        for f, c in enumerate(self.corners):
            P = self.p[:, f, None] + c @ self.R[:, f].swapaxes(1, 2)
            plane = self.planes[:, f, None]
            out[:, f] = (P[..., 2] - plane[..., 0] - plane[..., 1] * P[..., 0] - plane[..., 2] * P[..., 1]).min(axis=1)
        return out

    @lazy
    def tilts(self) -> Array:
        """Rotations that take z to the normals of the planes, shape (n, F, 3, 3)."""
        return tilts_of(self.planes)

    @lazy
    def on_plane(self) -> Array:
        """Orientations from where the planes are level, shape (n, F, 3, 3)."""
        return np.asarray(self.tilts.swapaxes(-1, -2) @ self.R)

    @lazy
    def yaw(self) -> Array:
        """Heading of each foot, without jumps, shape (n, F) [rad]."""
        return np.unwrap(np.arctan2(self.on_plane[..., 1, 0], self.on_plane[..., 0, 0]), axis=0)

    @lazy
    def tilt(self) -> Array:
        """Rotation of each foot from its plane in its own heading, as a rotation vector, shape (n, F, 3) [rad]."""
        return rotation_vectors(turned(-self.yaw) @ self.on_plane)

    def leaning(self, on: Array, edges: Array) -> Feet:
        """The same feet, which lean on their toes or heels about frames in which they are to stand on an edge alone.

        Args:
            on: Which feet stand, shape (n, F).
            edges: Which of them on an edge alone.
        """
        pitch = blurred(self.tilt[..., 1], SMOOTH / self.dt)
        x = np.where(self.flat, np.maximum(np.abs(pitch) / LEAN - 1.0, 0.0), 0.0)
        lean = np.sign(pitch) * LEAN * np.where(x < 1.0, 0.5 * x**2, x - 0.5)
        for f in range(len(self.corners)):
            for a, b in stretches(lean[:, f] != 0.0):
                k = a + np.flatnonzero(on[a:b, f])
                turns = len(k) and np.ptp(self.yaw[k, f]) > TURN
                if not edges[a:b, f].any() or len(k) * self.dt < LEAST_STANCE or turns:
                    lean[a:b, f] = 0.0
        return replace(self, lean=lean)

    def edge(self, f: int, side: int) -> Array:
        """Which corners of a sole are on its toe edge, side 1, or its heel edge, -1; all of 0."""
        x = side * self.corners[f][:, 0]
        return np.asarray(x >= x.max() - WIDTH)

    def raised(self, f: int) -> Array:
        """How its lean about an edge moves the origin of a foot from where it were flat, in its heading, shape (n, 3) [m]."""
        c, s, z = np.cos(self.lean[:, f]), np.sin(self.lean[:, f]), self.corners[f][:, 2].min()
        x = np.where(s > 0.0, self.corners[f][:, 0].max(), self.corners[f][:, 0].min())
        return np.column_stack([(1.0 - c) * x - s * z, np.zeros(len(c)), (1.0 - c) * z + s * x])

    def carrying(self, on: Array) -> list[Array]:
        """Which corners of each foot carry where they stand, shape (n, F): arrays (n, k)."""
        sides, out = np.sign(self.lean), []
        for f in range(len(self.corners)):
            edges = np.array([self.edge(f, side) for side in (-1, 0, 1)])
            out.append(on[:, f, None] & edges[1 + sides[:, f].astype(int)])
        return out

    @lazy
    def places(self) -> Array:
        """x, y [m] and yaw [rad] of each foot were it flat on the edge on which it leans, shape (n, F, 3)."""
        yaw, out = self.yaw, np.dstack([self.p[..., :2], self.yaw])
        for f in range(len(self.corners)):
            out[:, f, :2] -= each_times(self.tilts[:, f] @ turned(yaw[:, f]), self.raised(f))[:, :2]
        return out

    def sole(self, f: int, place: Array, tread: Tread) -> tuple[Array, Array]:
        """Corners of a flat foot on a tread, and of what carries of it, from its place, along x and y, shapes (k, 2) [m]."""
        R, corners = tilts_of(tread.plane) @ turned(place[2:])[0], self.corners[f]
        flat = corners @ R[:2].T
        return flat, inner_corners(flat)

    @lazy
    def smooth(self) -> Array:
        """Origins without what is faster than about 5 Hz, shape (n, F, 3) [m]."""
        return blurred(self.p, SMOOTH / self.dt)

    @lazy
    def speed(self) -> Array:
        """Speed of each origin, shape (n, F) [m/s]."""
        return np.asarray(np.linalg.norm(np.gradient(self.smooth, self.dt, axis=0), axis=2))

    def error(self, R: Array, p: Array) -> Array:
        """What turns and moves each foot to a pose, in that pose's axes: (position, rotation vector), shape (n, F, 6)."""
        back = R.swapaxes(-1, -2)
        return np.concatenate([np.matmul(back, (p - self.p)[..., None])[..., 0], -rotation_vectors(back @ self.R)], axis=2)


@dataclass(frozen=True, eq=False)
class Stance:
    """A foot stands from one frame to another.

    Attributes:
        foot: Its index.
        first: First frame.
        last: Last frame.
        place: x, y [m] and yaw [rad].
        tread: On which it stands.
        put: How far it was moved so that what carries of the sole is on the tread, shape (2,) [m].
        part: What carries where the tread is too narrow for that, in the foot's axes, shape (k, 3) [m]; no rows: all of it.
    """

    foot: int
    first: int
    last: int
    place: Array
    tread: Tread = field(default_factory=lambda: Tread.level(0.0))
    put: Array = field(default_factory=lambda: np.zeros(2))
    part: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def frames(self) -> slice:
        """Those in which it stands."""
        return slice(self.first, self.last + 1)

    def moved_to(self, feet: Feet) -> Stance:
        """The stance at the mean place and heading that its foot has now."""
        place = feet.places[self.frames, self.foot].mean(axis=0)
        place[2] += 2.0 * np.pi * np.round((self.place[2] - place[2]) / (2.0 * np.pi))
        return replace(self, place=place).put_on_tread(feet)

    def found_on(self, terrain: Terrain, feet: Feet, otherwise: float) -> Stance:
        """The stance on the nearest tread of a terrain; where there is none, on a level one at a height [m]."""
        z = float(np.median(feet.low[self.frames, self.foot]))
        sole, inner = feet.sole(self.foot, self.place, Tread.level(z))
        return replace(self, tread=Tread.under(terrain, self.place[:2], sole, inner, z, otherwise))

    def put_on_tread(self, feet: Feet) -> Stance:
        """Moved by as little as puts what carries of the sole onto the tread, and all of it beside what rises there."""
        sole, inner = feet.sole(self.foot, self.place, self.tread)
        A, b = self.tread.rows(sole, inner)
        if not len(A):
            return self
        xy = nearest_within(self.place[:2], A, b)
        rests, part = part_on(self.tread, xy + inner), np.zeros((0, 3))
        if (self.tread.edges[:, :2] @ (xy + inner).T > self.tread.edges[:, 2:]).any() and len(rests):
            R, low = tilts_of(self.tread.plane) @ turned(self.place[2:])[0], float(feet.corners[self.foot][:, 2].min())
            part = np.linalg.solve(R[:2, :2], (rests - xy - low * R[:2, 2]).T).T
            part = np.column_stack([part, np.full(len(rests), low)])
        return replace(self, place=np.array([*xy, self.place[2]]), put=self.put + xy - self.place[:2], part=part)

    def overhang(self, feet: Feet) -> float:
        """How far its sole is beyond the edge of its tread [m]; 0 where all of it is over the tread."""
        edges, (sole, _) = self.tread.edges, feet.sole(self.foot, self.place, self.tread)
        beyond = edges[:, :2] @ (self.place[:2] + sole).T - edges[:, 2:]
        return max(float(beyond.max(initial=0.0)), 0.0)


def standing(on: Array, feet: Feet, ground: Array) -> Array:
    """Which feet stand when, shape (n, F): as meant, without stances and steps too short to make, and never none.

    Changes of feet share the load for a time. A foot that drifts or turns while it is down makes one more step where it moves
    most.

    Args:
        on: Which feet touch as meant, shape (n, F).
        feet: The feet of the same motion.
        ground: Height of what is under each foot, shape (n, F) [m].
    """
    dt, n = feet.dt, len(feet.p)
    on = on.copy()
    low, speed = feet.low - ground, feet.speed
    flies = np.zeros(n, bool)
    for a, b in stretches((low.min(axis=1) > FLIGHT) | (speed.min(axis=1) > FAST)):
        flies[a:b] = FLIGHTS[0] < (b - a) * dt < FLIGHTS[1]
    on[flies] = False
    for _ in range(2):
        for f in range(on.shape[1]):
            _drop_short(on, f, feet)
        for a, b in stretches(~on.any(axis=1) & ~flies):
            if a > 0 and (b - a) * dt < 0.25:
                on[a:b] = on[a - 1]
            else:
                near = (low[a:b] / 0.03 + speed[a:b] / 0.25).argmin(axis=1)
                on[np.arange(a, b), near] = True
    _more_steps(on, feet)
    return _shared(on, dt)


def _others(on: Array, f: int) -> Array:
    """Frames in which some other foot stands."""
    return np.asarray(np.delete(on, f, axis=1).any(axis=1))


def _drop_short(on: Array, f: int, feet: Feet) -> None:
    """Stances that are too short become part of a step; steps that are too short end, or become longer where others stand."""
    n, dt = len(on), feet.dt
    for a, b in stretches(on[:, f]):
        if (b - a) * dt < LEAST_STANCE and a > 0 and b < n:
            on[a:b, f] = False
    for a, b in stretches(~on[:, f]):
        if a == 0 or b == n or (b - a) * dt >= LEAST_SWING:
            continue
        far = float(np.linalg.norm(feet.smooth[b - 1, f, :2] - feet.smooth[a, f, :2]))
        if far < 0.02 and (b - a) * dt < 0.12:
            on[a:b, f] = True
        else:
            more = int(np.ceil((LEAST_SWING / dt - (b - a)) / 2))
            wider = slice(max(a - more, 0), b + more)
            on[wider, f] &= ~_others(on, f)[wider]


def _more_steps(on: Array, feet: Feet) -> None:
    dt, n = feet.dt, len(on)
    half, edge = round(0.5 * STEP / dt), round(APART / dt)
    place, yaw = feet.smooth[..., :2], feet.yaw
    score = feet.speed + 0.15 * np.abs(np.gradient(blurred(yaw, SMOOTH / dt), dt, axis=0))
    for _ in range(12):
        before = on.copy()
        for f in range(on.shape[1]):
            steady = _all_within(_others(on, f), half + edge)
            for a, b in stretches(on[:, f]):
                if np.ptp(place[a:b, f], axis=0).max() < DRIFT and not (feet.flat[f] and np.ptp(yaw[a:b, f]) > TURN):
                    continue
                free = np.zeros(n, bool)
                free[a + half + edge : max(b - half - edge, 0)] = True
                free &= steady
                if free.any():
                    k = int(np.argmax(np.where(free, score[:, f], -1.0)))
                    on[k - half : k + half + 1, f] = False
        if np.array_equal(on, before):
            return


def _all_within(x: Array, reach: int) -> Array:
    """Whether all within `reach` frames of each frame are true; those beyond the ends do not count."""
    off = np.concatenate([[0], np.cumsum(~x)])
    at = np.arange(len(x))
    return np.asarray(off[np.minimum(at + reach + 1, len(x))] == off[np.maximum(at - reach, 0)])


def _shared(on: Array, dt: float) -> Array:
    """With stances made longer at both ends so that two feet share the load for `BOTH` where one takes it from the other."""
    n, half, wide = len(on), round(0.5 * BOTH / dt), on.copy()
    for f in range(on.shape[1]):
        held = _others(on, f)
        for a, b in stretches(on[:, f]):
            if b < n and not held[max(b - 2 * half, 0) : b].all():
                wide[b : b + half, f] = True
            if a > 0 and not held[a : a + 2 * half].all():
                wide[max(a - half, 0) : a, f] = True
        for a, b in stretches(~wide[:, f]):
            if (b - a) * dt < 0.15 and a > 0 and b < n:
                wide[a:b, f] = on[a:b, f]
    return wide


def stances_of(on: Array, feet: Feet) -> list[Stance]:
    """The stances of lanes: each at the mean place and heading of its frames, in which slow ones count more."""
    weight = 1.0 / (feet.speed + 0.02) ** 2
    places, out = feet.places, []
    for f in range(on.shape[1]):
        for a, b in stretches(on[:, f]):
            w = weight[a:b, f]
            out.append(Stance(f, a, b - 1, w @ places[a:b, f] / w.sum()))
    return out


def paths(stances: Sequence[Stance], feet: Feet, terrain: Terrain | None = None) -> tuple[Array, Array, Array]:
    """(R, p, free) of the feet: fixed in stances, flat on their treads or on an edge, smooth and above the ground between.

    Shapes (n, F, 3, 3), (n, F, 3) [m] and (n, F): how free they are, from 0 in stances to 1 in the middle of steps.

    Args:
        stances: All stances.
        feet: The feet of the reference, whose height, tilt and way are kept in the middle of a step.
        terrain: What lies between; over it steps are raised.
    """
    R, p, free = feet.R.copy(), feet.p.copy(), np.zeros(feet.p.shape[:2])
    smooth, yaw, low, tilt, tilts = feet.smooth, feet.yaw, feet.over, feet.tilt, feet.tilts
    n = len(p)
    for f, corners in enumerate(feet.corners):
        own = [s for s in stances if s.foot == f]
        raised, leans, around = feet.raised(f), np.zeros((n, 3)), sole_points(corners)
        leans[:, 1] = feet.lean[:, f]
        for s in own:
            at = s.frames
            R_s = tilts_of(s.tread.plane) @ turned(s.place[2:])[0]
            down = _lowest(R_s[None] if feet.flat[f] else tilts[s.first : s.first + 1, f], s.tread.plane[None], corners)
            p[at, f] = [*s.place[:2], height_at(s.tread.plane, s.place[:2]) - down.item()] + raised[at] @ R_s.T
            R[at, f] = R_s @ rotations(leans[at]) if feet.flat[f] else feet.R[at, f]
        for before, after in zip([None, *own], [*own, None], strict=True):
            a, b = (-1 if before is None else before.last), (n if after is None else after.first)
            k = np.arange(a + 1, b)
            if not len(k):
                continue
            u = (k - a) / (b - a)
            along, up = np.ones(len(k)), np.ones(len(k))
            if before is not None:
                along, up = along * blend((u - 0.15) / 0.35), up * blend(u / 0.35)
            if after is not None:
                along, up = along * blend((0.85 - u) / 0.35), up * blend((1.0 - u) / 0.35)
            now = np.column_stack([smooth[k, f, :2], yaw[k, f]])
            if before is not None and after is not None:
                between = before.place + blend((u - 0.15) / 0.7)[:, None] * (after.place - before.place)
            else:
                one = before or after
                between = now if one is None else np.tile(one.place, (len(k), 1))
            R_k, back = turned(between[:, 2]), 1.0 - along[:, None]
            between[:, :2] += each_times(tilts[k, f] @ R_k, raised[k])[:, :2]
            place = now + back * (between - now)
            w = tilt[k, f] + back * (leans[k] - tilt[k, f])
            R[k, f] = tilts[k, f] @ turned(place[:, 2]) @ rotations(w) if feet.flat[f] else feet.R[k, f]
            height = up * np.maximum(low[k, f], CLEAR if before is not None or after is not None else 0.0)
            free[k, f], p[k, f, :2] = along, place[:, :2]
            plane = feet.planes[k, f]
            p[k, f, 2] = plane[:, 0] + (plane[:, 1:] * place[:, :2]).sum(axis=1) + height - _lowest(R[k, f], plane, corners)
            if terrain is not None and before is not None and after is not None:
                points = p[k, f, None] + around @ R[k, f].swapaxes(1, 2)
                p[k, f, 2] += raise_of(needed_rise(terrain, points, plane, u), u)
    return R, p, free


def _lowest(R: Array, planes: Array, corners: Array) -> Array:
    """Height of the lowest corner of a foot over a plane through its origin, for k rotations and planes, shape (k,) [m]."""
    up = R[:, 2] - planes[:, 1, None] * R[:, 0] - planes[:, 2, None] * R[:, 1]
    return np.asarray((up @ corners.T).min(axis=1))


def planes_of(stances: Sequence[Stance], under: Array) -> Array:
    """Planes under each foot, shape (n, F, 3), those of its stances; between, they rise early in steps up, and fall late.

    Args:
        stances: All stances, on their treads.
        under: Height of what was found under each foot, shape (n, F) [m]: of feet without stances.
    """
    n = len(under)
    out = np.stack([under, np.zeros_like(under), np.zeros_like(under)], axis=-1)
    for f in range(under.shape[1]):
        own = [s for s in stances if s.foot == f]
        for s in own:
            out[s.frames, f] = s.tread.plane
        for before, after in zip([None, *own], [*own, None], strict=True):
            ends = [one for one in (before or after, after or before) if one is not None]
            if not ends:
                continue
            a, b = (-1 if before is None else before.last), (n if after is None else after.first)
            low, high = (height_at(one.tread.plane, one.place[:2]) for one in ends)
            u = (np.arange(a + 1, b) - a) / (b - a)
            w = blend(u / 0.4 if high > low else (u - 0.6) / 0.4)
            out[a + 1 : b, f] = ends[0].tread.plane + w[:, None] * (ends[1].tread.plane - ends[0].tread.plane)
    return out


def blend(u: Array) -> Array:
    """From 0 to 1 with two derivatives zero at both ends, and constant beyond them."""
    return minimum_jerk_way(np.clip(u, 0.0, 1.0))


def blurred(x: Array, sigma: float) -> Array:
    """Frames averaged by a normal distribution, `sigma` frames wide."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(x, max(sigma, 1e-6), axis=0, mode="nearest"))


def turned(yaw: Array) -> Array:
    """Rotations about z, shapes (..., 3, 3) and (...)."""
    out = np.zeros((*yaw.shape, 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(yaw)
    out[..., 1, 0] = np.sin(yaw)
    out[..., 0, 1], out[..., 2, 2] = -out[..., 1, 0], 1.0
    return out


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors of rotations, shapes (..., 3) and (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()).reshape(R.shape[:-1])


def rotations(w: Array) -> Array:
    """Rotations of rotation vectors, shapes (n, 3, 3) and (n, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(w).as_matrix())
