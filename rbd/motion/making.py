"""Motions made from poses: minimum jerk between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.rotations import conjugate, exponential, logarithm, product
from rbd.motion.derivation import checked_times, own_rates
from rbd.motion.frames import check_rate, times_of
from rbd.motion.motion import Motion


def minimum_jerk(
    robot: CheckedModel, poses: Sequence[Array], times: Array, *, rate: float = 60.0, ground: float = 0.0
) -> Motion:
    """The motion through poses with minimum jerk between each two, at rest at each of them; v and a are exact.

    Each coordinate goes 10 s^3 - 15 s^4 + 6 s^5 of its way, s = 0 to 1: joints and positions along straight lines, rotations
    about one axis. Quintics from rest to rest have the least integral of the squared jerk [Flash1985].

    Args:
        robot: The robot.
        poses: Configurations, each of shape (nq,), two or more.
        times: When each of them is reached [s], increasing.
        rate: Frames a second.
        ground: Height of the floor [m].

    Raises:
        InputError: as many times as poses are expected, times that increase, configurations of this robot.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([0.0]), np.array([1.0])], [0.0, 1.0], rate=4.0)
        >>> motion.q[:, 0].round(4), motion.v[:, 0].round(4)
        (array([0.    , 0.1035, 0.5   , 0.8965, 1.    ]), array([0.    , 1.0547, 1.875 , 1.0547, 0.    ]))
    """
    if not isinstance(robot, CheckedModel):
        raise InputError(f"robot is a {type(robot).__name__}; expected a robot: rbd.load_robot('g1').")
    t, rate = checked_times(times), check_rate(rate)
    listed = isinstance(poses, list | tuple) or (isinstance(poses, np.ndarray) and poses.ndim == 2)
    if not listed or len(poses) != len(t) or len(t) < 2:
        raise InputError(f"poses is {poses!r:.80} for {len(t)} times; expected two or more configurations, one a time.")
    q = np.array([robot.check_q(pose) for pose in poses])
    at = times_of(float(t[0]), float(t[-1]), rate)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, None]
    s = (at - t[i])[:, None] / h
    way = s**3 * (10.0 + s * (6.0 * s - 15.0))
    speed = 30.0 * (s * (1.0 - s)) ** 2 / h
    rise = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / h**2
    out, v, a = np.empty((len(at), robot.nq)), np.empty((len(at), robot.nv)), np.empty((len(at), robot.nv))
    for p in robot.joints.pieces:
        own = q[:, p.q : p.q + p.nq]
        begin, end = own[i], own[i + 1]
        to, rates = out[:, p.q : p.q + p.nq], slice(p.v, p.v + p.nv)
        slides = {"number": 1, "plane": 2, "space": 3}.get(p.kind, 0)
        step = end[:, :slides] - begin[:, :slides]
        to[:, :slides] = begin[:, :slides] + way * step
        slide = turn = (speed * step, rise * step)
        if p.kind in ("circle", "plane"):
            angle = np.arctan2(begin[:, -1:], begin[:, -2:-1])
            change = np.arctan2(end[:, -1:], end[:, -2:-1]) - angle
            change = np.remainder(change + np.pi, 2.0 * np.pi) - np.pi
            to[:, -2:] = np.concatenate([np.cos(angle + way * change), np.sin(angle + way * change)], axis=1)
            turn = (speed * change, rise * change)
        elif p.kind in ("sphere", "space"):
            vector = logarithm(product(conjugate(begin[:, -4:]), end[:, -4:]))
            to[:, -4:] = product(begin[:, -4:], exponential(way * vector))
            turn = (speed * vector, rise * vector)
        v[:, rates], a[:, rates] = own_rates(p.kind, to, slide, turn)
    return Motion.of_arrays(robot, at, out, v, a, source="minimum jerk", ground=ground, quaternion="xyzw", trust=True)
