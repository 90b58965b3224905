"""`find_contacts`: which points of a robot touch the floor during a motion, and whether they stick or slide there."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_flag, check_number
from rbd.constraints.contact import Contact
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_timeline import ContactTimeline, FloorPoints
from rbd.motion.frame_terms import carriers, placements
from rbd.motion.reference_motion import Motion

TOUCHES_M = 0.006
"""A point begins to touch at this height over the floor [m] ..."""
LEAVES_M = 0.010
"""... and no longer touches above this one."""
SLOPE_S = 0.3
"""Window of the slope of a point's position, cut off where it does not touch [s]."""
REST_SPEED = 5e-3
"""A point that moves along the floor faster than this slides [m/s]."""
NOISE = 3.0
"""How many standard deviations of noise are no slip."""
_LEAST = 3
"""Frames that a slope needs."""


def find_contacts(
    motion: Motion, *, bodies: bool = False, ground: float | str | None = None, rest_speed: float = REST_SPEED
) -> ContactTimeline:
    """Which points touch the floor, and which of these slide, in each frame.

    Heights decide whether a point touches: from 6 mm, with hysteresis up to 10 mm. Its speed only decides whether it holds or
    slides: the slope of its position over 0.3 s, within the stretch of time in which it touches. The limit is `rest_speed` and
    three standard deviations of what the decimals of the data leave in the slope (four decimals show 10 mm/s to 0.5).

    Args:
        motion: The motion.
        bodies: Whether other bodies than the feet can touch, by their collision shapes; without known feet
            they always can.
        ground: Height of the level floor [m]; "fit": the median over the frames of the lowest point; None: `motion.ground`.
        rest_speed: Fastest motion of a point that holds [m/s].

    Raises:
        InputError: no motion, a ground or a speed that is none, a robot without anything that could touch.

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
    points = FloorPoints.of(motion.robot, bodies=bodies)
    R, p = placements(motion.robot, motion.q)
    places = points.places(R, p)
    notes: tuple[str, ...] = ()
    if isinstance(ground, str):
        if ground != "fit":
            raise InputError(f"ground is {ground!r:.80}; expected 'fit', a height [m], or None.")
        level = fitted_ground(places)
        notes = (f"the floor was fitted at z = {level:.4f} m, the median over the frames of the lowest point.",)
    else:
        height = motion.ground if ground is None else ground
        level = check_number("ground", height, -1e5, 1e5, expected="'fit', a height [m], or None")
    heights = places[..., 2] - level
    touches = held_on(heights)
    kept = touches.any(axis=0) | _feet(points)
    if not kept.all():
        points, places, heights, touches = points.some(kept), places[:, kept], heights[:, kept], touches[:, kept]
    sigma = None if motion.derivation is None else motion.derivation.noise_q
    speeds, noise = slopes(motion.t, places[..., :2], touches, place_noise(motion.robot, points, motion.q, sigma))
    slides = touches & (speeds > slow + NOISE * noise)
    return ContactTimeline(motion.t, points, touches, slides, heights, speeds, places, level, noise, notes)


def fitted_ground(places: Array) -> float:
    """The median over frames of the lowest point's height [m]."""
    return float(np.median(places[..., 2].min(axis=1)))


def held_on(heights: Array) -> Array:
    """Which points touch, by hysteresis, shape (n, k)."""
    near, off = heights <= TOUCHES_M, heights > LEAVES_M
    out = np.empty_like(near)
    on = heights[0] <= LEAVES_M
    for i in range(len(heights)):
        on = (on | near[i]) & ~off[i]
        out[i] = on
    return out


def slopes(t: Array, xy: Array, touches: Array, noise: Array) -> tuple[Array, Array]:
    """(speed along the floor, its standard deviation), each of shape (n, k) [m/s]: regressions within each stretch of contact.

    Args:
        t: Times, shape (n,) [s].
        xy: Positions, shape (n, k, 2) [m].
        touches: Shape (n, k).
        noise: Standard deviation of positions, shape (k,) [m].
    """
    n, k = touches.shape
    begin, end = np.searchsorted(t, t - 0.5 * SLOPE_S - 1e-9), np.searchsorted(t, t + 0.5 * SLOPE_S + 1e-9)
    i = np.arange(n)[:, None]
    starts = touches & ~np.vstack([np.zeros((1, k), bool), touches[:-1]])
    ends = touches & ~np.vstack([touches[1:], np.zeros((1, k), bool)])
    first = np.maximum(np.maximum.accumulate(np.where(starts, i, 0), axis=0), begin[:, None])
    last = np.minimum(np.minimum.accumulate(np.where(ends, i, n)[::-1], axis=0)[::-1] + 1, end[:, None])
    last = np.maximum(np.minimum(last, n), first)
    time, x = (t - t.mean())[:, None, None], xy - xy.mean(axis=0)
    of_time = np.broadcast_to(np.concatenate([time, time**2], axis=2), (n, k, 2))
    sums = np.concatenate([np.zeros((1, k, 6)), np.cumsum(np.concatenate([of_time, x, x * time], axis=2), axis=0)])
    count, column = np.maximum(last - first, 1), np.arange(k)
    T, TT, X, TX = np.split(sums[last, column] - sums[first, column], [1, 2, 4], axis=2)
    T, TT = T[..., 0], TT[..., 0]
    spread = TT - T**2 / count
    enough = touches & (last - first >= _LEAST) & (spread > 0.0)
    safe = np.where(enough, spread, 1.0)
    slope = (TX - (T / count)[..., None] * X) / safe[..., None]
    speed = np.where(enough, np.hypot(slope[..., 0], slope[..., 1]), np.where(touches, 0.0, np.nan))
    return speed, np.where(enough, noise / np.sqrt(safe), 0.0)


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
