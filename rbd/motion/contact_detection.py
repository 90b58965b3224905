"""`find_contacts`: which points of a robot touch the floor during a motion, and whether they stick or slide there."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag, check_number
from rbd.constraints.contact import Contact
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_lanes import LEAST, REST_SPEED, TOUCHES_M, slopes
from rbd.motion.contact_timeline import ContactTimeline, FloorPoints, stretches
from rbd.motion.frame_terms import carriers, placements
from rbd.motion.reference_motion import Motion
from rbd.motion.terrain_lanes import OverTerrain

APART_M = 0.004
"""A point that is on the floor stays there up to 4 mm above `TOUCHES_M` [m]."""
TOUCH_HEIGHT, TOUCH_SPEED = 0.03, 0.25
"""A foot is meant to touch from this height [m] and below this speed [m/s]; no longer 4 mm higher, or 1.4 times as fast."""
EDGE = 0.3
"""A sole that is tilted by more is meant to touch with its low edge only [rad]."""
_FASTER, _SPEED_S = 1.4, 0.1
_FIT, _NEAR_M = 0.25, 2e-3
"""The fitted floor is this quantile of the lowest points of slow frames, and z = 0 where that is within 2 mm."""
NOISE = 3.0
"""How many standard deviations of noise are no slip."""
NOTHING = "nothing touches the floor"
LONGEST_FLIGHT = 1.0
"""A time without contacts as long as this is noted [s]."""


def find_contacts(
    motion: Motion,
    *,
    bodies: bool = False,
    ground: float | str | Terrain | None = None,
    touch_height: float = TOUCH_HEIGHT,
    touch_speed: float = TOUCH_SPEED,
    rest_speed: float = REST_SPEED,
) -> ContactTimeline:
    """Which points touch the floor, as meant; which of these are raised above it, and which slide, in each frame.

    A point is on the floor from 6 mm, with hysteresis up to 10 mm. Retargeted feet hover, with tilted soles: so a foot
    whose lowest corner is lower than `touch_height` and slower than `touch_speed` touches as meant, until it is 4 mm higher or
    1.4 times as fast: with all corners of its sole, or with those of its low edge where it is tilted by more than 17 degrees.
    Its contact begins within 6 mm, and ends 10 mm, above the median height at which it stands. Points that touch so and are not
    on the floor are `raised`. Other bodies touch with what is on the floor.

    Its speed along the floor decides whether a point that touches holds or slides: the slope of its position over 0.3 s, or
    over three frames where that is less, within the stretch of time in which it touches. The limit is `rest_speed` and three
    standard deviations of what the decimals of the data leave in the slope (four decimals show 10 mm/s to 0.5).

    Args:
        motion: The motion.
        bodies: Whether other bodies than the feet can touch, by their collision shapes; without known feet
            they always can.
        ground: Height of the level floor [m]; "fit": of the lowest points while they are slow, the lower quartile; None:
            `motion.ground` where that was given, else fitted, and 0 where this is within 2 mm. Or an `rbd.Terrain`: a sole
            stands on the piece that it is nearest to, with the part of it that is over that piece's top.
        touch_height: Height up to which a foot is meant to touch [m]; 0.006: only what is on the floor touches.
        touch_speed: Speed up to which a foot is meant to touch [m/s].
        rest_speed: Fastest motion of a point that holds [m/s].

    Raises:
        InputError: no motion, a ground, a height or a speed that is none, a robot without anything that could touch.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
        >>> rbd.motion.find_contacts(hop).intervals("front_left")
        [(0.0, 0.06), (0.56, 0.6)]
    """
    check_kind("motion", motion, Motion, "an rbd.Motion: rbd.Motion.read('dance.csv', robot='g1')")
    check_flag("bodies", bodies)
    slow = check_number("rest_speed", rest_speed, 0.0, 1e3, expected="a speed of 0 or more [m/s]")
    moves = check_number("touch_speed", touch_speed, 0.0, 1e3, expected="a speed of 0 or more [m/s]")
    high = check_number("touch_height", touch_height, 0.0, 10.0, expected="a height of 0 to 10 [m]")
    points = FloorPoints.of(motion.robot, bodies=bodies)
    R, p = placements(motion.robot, motion.q)
    level, notes = _ground(motion, ground, fixed := points.places(R, p))
    over = OverTerrain.of(level, points, R, p) if isinstance(level, Terrain) else None
    if over is not None:
        points, fixed = over.points, over.corners
    heights, speed = over.heights if over is not None else fixed[..., 2] - level, _speeds(motion.t, fixed)
    rests = True if over is None else over.rests
    firm = held(heights, min(TOUCHES_M, high)) & rests
    touches = firm | (_meant(points, heights, speed, high, moves) & rests) if high > TOUCHES_M else firm
    kept = touches.any(axis=0) | _feet(points)
    points, fixed, heights, touches, firm = points.some(kept), fixed[:, kept], heights[:, kept], touches[:, kept], firm[:, kept]
    notes += _nothing_touches(motion.t, touches)
    sigma = None if motion.derivation is None else motion.derivation.noise_q
    spread = place_noise(motion.robot, points, motion.q, sigma)
    speeds, noise = slopes(motion.t, fixed[..., :2], firm, spread)
    if (touches != firm).any():  # stretches of points on the floor are not prolonged by those in which they are raised
        longer, more = slopes(motion.t, fixed[..., :2], touches, spread)
        speeds, noise = np.where(firm, speeds, longer), np.where(firm, noise, more)
    slides = touches & (speeds > slow + NOISE * noise)
    found = ContactTimeline(motion.t, points, touches, slides, heights, speeds, fixed, level, noise, touches & ~firm, notes)
    return found if over is None else over.of_timeline(found, kept)


def _ground(motion: Motion, given: float | str | Terrain | None, places: Array) -> tuple[float | Terrain, tuple[str, ...]]:
    """(height of the floor [m] or the terrain, what to note of it)."""
    if isinstance(given, str) and given != "fit":
        raise InputError(f"ground is {given!r:.80}; expected 'fit', a height [m], an rbd.Terrain, or None.")
    if given is None and motion.ground_given:
        given = motion.ground
    if isinstance(given, Terrain):
        return given, ()
    if given is not None and not isinstance(given, str):
        return check_number("ground", given, -1e5, 1e5, expected="'fit', a height [m], an rbd.Terrain, or None"), ()
    level = fitted_ground(motion.t, places)
    if given is None and abs(level) <= _NEAR_M:
        return 0.0, ()
    return level, (f"the floor was fitted at z = {level:.4f} m, where the lowest points are while they are slow.",)


def fitted_ground(t: Array, places: Array) -> float:
    """The lower quartile of the lowest point's height, over the frames in which it is slower than `TOUCH_SPEED` [m]."""
    n, z, speed = len(places), places[..., 2], _speeds(t, places)
    lowest = z.argmin(axis=1)
    low, slow = z[np.arange(n), lowest], speed[np.arange(n), lowest] <= TOUCH_SPEED
    return float(np.quantile(low[slow] if np.count_nonzero(slow) >= LEAST else low, _FIT, method="lower"))


def _speeds(t: Array, places: Array) -> Array:
    """Speeds of points in space over 0.1 s, shape (n, k) [m/s]."""
    n = len(t)
    i = np.minimum(np.searchsorted(t, t - 0.5 * _SPEED_S - 1e-9), np.maximum(np.arange(n) - 1, 0))
    j = np.maximum(np.searchsorted(t, t + 0.5 * _SPEED_S + 1e-9, side="right") - 1, np.minimum(np.arange(n) + 1, n - 1))
    return np.asarray(np.linalg.norm(places[j] - places[i], axis=2) / np.maximum(t[j] - t[i], 1e-9)[:, None])


def held(heights: Array, height: float, also: Array | bool = True, still: Array | bool = True) -> Array:
    """Which points touch, by hysteresis: from a height, where `also`, to 4 mm above it, while `still`, shape (n, k)."""
    near, stays = (heights <= height) & also, (heights <= height + APART_M) & still
    out = np.empty_like(near)
    on = near[0] if len(near) else near
    for i in range(len(heights)):
        out[i] = on = near[i] | (on & stays[i])
    return out


def _meant(points: FloorPoints, heights: Array, speed: Array, height: float, fastest: float) -> Array:
    """Which points touch as meant, on the floor or not, shape (n, k): of a sole all, or those of its low edge."""
    n = len(heights)
    out = np.zeros(heights.shape, bool)
    feet, tilts = _feet(points), points.tilts(heights)
    for own in (np.flatnonzero(points.group == g) for g in np.unique(points.group[feet])):
        z = heights[:, own]
        lowest = z.argmin(axis=1)
        low, fast = z.min(axis=1), speed[np.arange(n), own[lowest]]
        on = held(low[:, None], height, (fast <= fastest)[:, None], (fast <= _FASTER * fastest)[:, None])[:, 0]
        edge = (tilts[:, points.group[own[0]]] > EDGE)[:, None]
        for a, b in stretches(on):
            level = max(float(np.median(low[a:b])), 0.0) + TOUCHES_M
            begins = 0 if a == 0 else int(np.argmax(low[a:b] <= level))
            ends = 0 if b == n else int(np.argmax(low[a:b][::-1] <= level + APART_M))
            out[a + begins : b - ends, own] = True
        out[:, own] &= ~edge | (z <= low[:, None] + TOUCHES_M + APART_M)
    return out


def _nothing_touches(t: Array, touches: Array) -> tuple[str, ...]:
    """A note of the longest time in which nothing touches, where that is a second or more."""
    gaps = [(float(t[b - 1] - t[a]), a, b) for a, b in stretches(np.asarray(~touches.any(axis=1)))]
    long, a, b = max(gaps, default=(0.0, 0, 0))
    if long < LONGEST_FLIGHT:
        return ()
    return (
        f"{NOTHING} for {long:.2f} s, from {t[a]:.2f} to {t[b - 1]:.2f} s, longer than any jump: another floor "
        "(ground=), a step or a chair that the file does not have, or other bodies than feet (bodies=True, --bodies)?",
    )


def place_noise(robot: CheckedModel, points: FloorPoints, q: Array, sigma: Array | None) -> Array:
    """Standard deviation of the points' positions along the floor at the middle frame, shape (k,) [m]."""
    if sigma is None or not sigma.any():
        return np.zeros(len(points))
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, q[len(q) // 2])
    R, p = placements(robot, q[len(q) // 2][None])
    places, moves = points.places(R, p)[0], carriers(robot)
    out = np.empty(len(points))
    for j, (place, joint) in enumerate(zip(places, points.joint, strict=True)):
        J = data.J[:3] + np.cross(data.J[3:].T, place).T
        out[j] = np.sqrt(0.5 * np.square(J[:2] * sigma * moves[joint]).sum())
    return out


def _feet(points: FloorPoints) -> Array:
    """Which points are corners of feet, not of shapes."""
    feet = np.array([isinstance(contact, Contact) for contact in points.contacts])
    return np.asarray(feet[points.group])
