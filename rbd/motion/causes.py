"""Why a frame of a motion is not possible: the causes, each as a mask over frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.motors import Motor, TorqueLines
from rbd.motion.contact_detection import NOISE
from rbd.motion.frame_terms import FrameTerms, numbers_of, wrench_scale
from rbd.motion.reference_motion import Motion
from rbd.solvers.cone_least_squares import nearest_in_cones

CAUSES = (
    "floats", "sinks", "slides", "friction", "tips", "motor", "joint limit", "speed limit", "torque-speed", "jump",
    "self-collision", "tilted sole", "hovering foot", "grasp",
)  # fmt: skip
FIGURES = {
    "balance": ("floats", "friction", "tips"),
    "feet": ("tilted sole", "hovering foot", "slides", "sinks"),
    "motors": ("motor", "torque-speed", "speed limit", "joint limit"),
}
"""{figure of a motion: the causes that it is without}; jumps, self-collisions and grasps are of none."""
SINKS_M = 0.01
"""A point lower than this below the floor sinks [m]."""
_SAME = 1e-6
"""Missing wrenches that differ by less of the weight are the same."""
EXCESS = 0.01
"""A torque beyond its limit by less, over the limit, is there by the tolerance of the program."""
_GRIP = 10.0
"""A coefficient of friction that holds anything."""
_WIDE_M = 1.5
"""Half the side of a floor under the robot on which nothing tips [m]."""
_JUMP = 0.03
"""Steps off the mean of their neighbours by less are no jumps [m, rad] ..."""
_USUAL = 8.0
"""... nor by less than this many times what is usual within half a second."""
_ROUND = 1e-6
"""Limits exceeded by less are exceeded by rounding [rad, rad/s]."""


def without_balance(
    terms: FrameTerms,
    places: Array,
    touches: Array,
    b: Array,
    most: Array,
    mu: float,
    ground: float | Array,
    axes: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Masks (floats, friction, tips) of frames in which the base misses a wrench, each of shape (n,).

    It tips if the same friction, and slips if the same soles, would do with all the other in abundance; if only both do,
    it does both. It floats if nothing touches, or if not even both do: it falls faster than it could.

    Args:
        terms: The equations of motion of these frames.
        places: Points, shape (n, k, 3).
        touches: Shape (n, k).
        b: Scaled wrench that is needed, shape (n, 6).
        most: How much may be missing, shape (n,).
        mu: Friction.
        ground: Height of the floor, or of that under the robot in each frame, shape (n,) [m].
        axes: Of what is under the points; see `ContactTimeline`.
    """
    scale = wrench_scale(terms.robot)
    n, something = len(b), np.asarray(touches.any(axis=1))
    corners = np.array([[x, y, 0.0] for x in (-_WIDE_M, _WIDE_M) for y in (-_WIDE_M, _WIDE_M)])
    under = np.column_stack([terms.com[:, :2], np.broadcast_to(ground, n)])
    if axes is not None:  # a floor that is inclined as what one of the points is on
        R = axes[np.arange(n), touches.argmax(axis=1)]
        corners = corners @ R.transpose(0, 2, 1)
        axes = np.concatenate([axes, np.repeat(R[:, None], 4, axis=1)], axis=1)
    wide = np.concatenate([places, under[:, None] + corners], axis=1)
    floor = np.concatenate([touches, np.ones((n, 4), bool)], axis=1)

    def enough(frames: Array, at: Array, on: Array, friction: float) -> Array:
        out = np.zeros(n, bool)
        own = None if axes is None else axes[frames, : at.shape[1]]
        A = terms.some(frames).wrench_map(at[frames], on[frames], own) * (scale[0] / scale)[:, None, None]
        out[frames] = np.linalg.norm(nearest_in_cones(A, b[frames], friction).left, axis=1) <= most[frames]
        return out

    slips, tips = enough(something, places, touches, _GRIP), enough(something, wide, floor, mu)
    neither = something & ~slips & ~tips
    both = enough(neither, wide, floor, _GRIP)
    return ~something | (neither & ~both), slips | both, tips | both


def needed(A: Array, b: Array, some: Array, size: Array, most: Array, mu: float) -> Array:
    """Frames that need a force at some of the points, shape (n,): without these more is missing than may be.

    A foot that the robot could as well lift does not carry, and may glide along the floor, or hover.

    Args:
        A: Scaled map of forces at the points that touch, shape (n, 6, k, 3).
        b: Scaled wrench that is needed, shape (n, 6).
        some: The points, shape (n, k).
        size: What is missing with all points, shape (n,).
        most: How much may be missing, shape (n,).
        mu: Friction.
    """
    out = np.zeros(len(b), bool)
    at = np.flatnonzero(some.any(axis=1))
    if len(at):
        left = nearest_in_cones(np.where(some[at][:, None, :, None], 0.0, A[at]), b[at], mu).left
        out[at] = np.linalg.norm(left, axis=1) > np.maximum(most[at], size[at] + _SAME)
    return out


def needs_raised(A: Array, b: Array, tilted: Array, hovers: Array, size: Array, most: Array, mu: float) -> tuple[Array, Array]:
    """Masks (tilted sole, hovering foot) of frames that need a force where nothing is on the floor, shapes (n,).

    If either would do without the other, it is both.

    Args:
        A: Scaled map of forces at the points that touch as meant, shape (n, 6, k, 3).
        b: Scaled wrench that is needed, shape (n, 6).
        tilted: Points that a tilt raises, shape (n, k).
        hovers: Points of feet of which none is on the floor, shape (n, k).
        size: What is missing with all points, shape (n,).
        most: How much may be missing, shape (n,).
        mu: Friction.
    """
    found = [needed(A, b, some, size, most, mu) for some in (tilted, hovers)]
    either = needed(A, b, tilted | hovers, size, most, mu) & ~found[0] & ~found[1]
    return found[0] | (either & tilted.any(axis=1)), found[1] | (either & hovers.any(axis=1))


def beyond_position(motion: Motion) -> Array:
    """By how much each coordinate is beyond its joint's limits, noise of the data aside, shape (n, nq) [m, rad]."""
    robot, out = motion.robot, np.zeros_like(motion.q)
    i, k = numbers_of(robot)
    q, low, high = motion.q[:, i], robot.model.lowerPositionLimit[i], robot.model.upperPositionLimit[i]
    slack = _ROUND + (0.0 if motion.derivation is None else NOISE * motion.derivation.noise_q[k])
    out[:, i] = np.maximum(np.maximum(low - q, q - high) - slack, 0.0)
    return out


def speed_limits(robot: CheckedModel) -> Array:
    """Limits of the velocities, shape (nv,) [m/s, rad/s]; infinite where the file has none, and of the base."""
    limit = np.array(robot.model.velocityLimit)
    limit[(limit <= 0.0) | (limit > 1e100)] = np.inf
    limit[:6] = np.inf
    return limit


def beyond_speed(motion: Motion) -> Array:
    """By how much each velocity is beyond its joint's limit, noise aside, shape (n, nv) [m/s, rad/s]."""
    limit = speed_limits(motion.robot)
    noise = 0.0 if motion.derivation is None else NOISE * motion.derivation.noise_v
    out = np.maximum(np.abs(motion.v) - limit - noise - _ROUND, 0.0)
    out[:, :6] = 0.0
    return np.asarray(out)


def speed_curves(robot: CheckedModel, given: Mapping[str, tuple[float, float]] | None) -> dict[str, Motor]:
    """{joint: a motor with its torque-speed line}, checked.

    Raises:
        InputError: an unknown joint, or numbers that are not positive.
    """
    out = {}
    expected = "{joint: (stall torque [N m], no-load speed [rad/s])}"
    check_kind("torque_speed", given, Mapping | None, expected)
    for name, curve in (given or {}).items():
        check_known(f"torque_speed names what is no motor of {robot.name},", name, robot.actuated_names)
        try:
            stall, fastest = (as_float(x) for x in curve)
        except (TypeError, ValueError):
            stall = fastest = np.nan
        if not (0.0 < stall < np.inf and 0.0 < fastest < np.inf):
            raise InputError(f"torque_speed[{name!r:.80}] is {curve!r:.80}; expected (stall torque, no-load speed), both > 0.")
        out[name] = Motor(torque_speed=[(0.0, stall), (fastest, 0.0)])
    return out


def torque_bounds(
    robot: CheckedModel, v: Array, torque_limits: bool | float, torque_speed: Mapping[str, tuple[float, float]] | None
) -> tuple[Array, Array]:
    """(least, most) torques at velocities v (n, nv), shapes (n, nu): of the robot's limits and lines, and of curves given.

    Args:
        robot: The robot.
        v: Its velocities.
        torque_limits: As of `check_motion`: whether the robot's limits and lines count, or a share of them.
        torque_speed: As of `check_motion`.
    """
    least, most = robot.limits_at(v)
    if not isinstance(torque_limits, bool | np.bool_):
        least, most = least * as_float(torque_limits), most * as_float(torque_limits)
    elif not torque_limits:
        least, most = np.full_like(least, -np.inf), np.full_like(most, np.inf)
    if curves := speed_curves(robot, torque_speed):
        stall = np.array([motor.standstill if (motor := curves.get(name)) else np.inf for name in robot.actuated_names])
        slow, fast = TorqueLines(robot.actuated, robot.actuated_names, curves).limits(v, stall)
        least, most = np.maximum(least, slow), np.minimum(most, fast)
    return least, most


def beyond_curves(tau: Array, bounds: tuple[Array, Array], limit: Array) -> Array:
    """Frames in which a motor is beyond what it has at its speed, though not beyond its limit at rest, shape (n,).

    Args:
        tau: Torques, shape (n, nu).
        bounds: Of `torque_bounds`.
        limit: Torque limits at rest, shape (nu,).
    """
    least, most = bounds
    size = np.maximum(np.maximum(-least, most).max(axis=0, initial=0.0), 0.0)  # at rest, or in braking
    over = np.maximum(least - tau, tau - most) > EXCESS * np.minimum(size, 1e300)
    return np.asarray((over & (np.abs(tau) <= limit * (1.0 + EXCESS))).any(axis=1))


def jumps(motion: Motion) -> Array:
    """Frames before and after a step of the data that its neighbours do not explain, shape (n,).

    A step of a coordinate, less what its v, or v and a, explain, that is off the mean of those before and after it by 0.03 (m,
    rad), and by eight times of what is usual within half a second, and by more than both of its neighbours are.
    """
    n, model = motion.n, motion.robot.model
    out = np.zeros(n, bool)
    if n < 5:
        return out
    steps = np.array([pin.difference(model, motion.q[i], motion.q[i + 1]) for i in range(n - 1)])
    dt = np.diff(motion.t)
    v, a = motion.v, motion.a
    rest = steps / dt[:, None] - 0.5 * (v[:-1] + v[1:])
    half = max(3, round(0.25 / float(np.median(dt))))
    high = np.ones_like(steps, bool)
    for rates in (rest, rest - (a[:-1] - a[1:]) * dt[:, None] / 12.0):  # the a of one instant says nothing of a whole frame
        odd = np.zeros_like(steps)
        odd[1:-1] = np.abs(rates[1:-1] - 0.5 * (rates[:-2] + rates[2:])) * dt[1:-1, None]
        high &= odd > _JUMP
        high[1:-1] &= (odd[1:-1] >= odd[:-2]) & (odd[1:-1] >= odd[2:])
        for i in np.flatnonzero(high.any(axis=1)):
            high[i] &= odd[i] > _USUAL * np.median(odd[max(0, i - half) : i + half + 1], axis=0)
    at = np.flatnonzero(high.any(axis=1))
    out[at] = out[at + 1] = True
    return out
