"""Limits of joints and speeds, and bodies apart and off the ground, at every instant of a plan.

Extremes of a cubic and of its rate are at ends and where derivatives are zero: exact. Of two shapes a time h apart

    gap(t)  >=  (gap_0 + gap_1 - D) / 2 - e_1 - e_2,        e = h^2 / 8 max (|c''| + r |u''|)

with D the most by which points of one move against points of the other from one end to the other, and e how far a point of a
shape of reach r about its centre c is from the straight line between its places at the ends (u: a unit vector fixed to it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, each_times
from rbd.model.checked_model import CheckedModel
from rbd.motion.causes import speed_limits
from rbd.motion.frame_terms import numbers_of, placements
from rbd.motion.ground_clearance import OverGround
from rbd.motion.self_collision import DEEP_M, BodyPairs
from rbd.planning.bounds import Bounds
from rbd.planning.curve import Curve
from rbd.planning.kept_off import HALVED, OffGround, off_ground
from rbd.statics.limits import Limit

MEASURED = 0.03
"""Shapes that are farther apart are not measured [m]."""
ROUNDING = 1e-6
"""Limits of joints count as kept up to this, as `rbd.check_motion` has it [m, rad]."""


@dataclass(frozen=True, eq=False)
class Between:
    """How near a plan comes to limits of joints and to itself, at all times.

    Attributes:
        beyond: How far each joint is beyond its limits at most, negative inside, shape (joints,) [m, rad].
        speed: Its largest share of its speed limit, shape (joints,).
        at: When these are worst, shape (2, joints) [s].
        names: Of the joints.
        gaps: (when bodies may come nearest to each other, how far apart they are then at least) [s, m]. Distances of more than
            3 cm are not measured, and count as 3 cm.
        off_ground: How near links come to the ground; None: not kept off, or neither shapes nor ground are known.
    """

    beyond: Array
    speed: Array
    at: Array
    names: tuple[str, ...]
    gaps: tuple[float, float]
    off_ground: OffGround | None

    @property
    def holds(self) -> bool:
        """Whether all of it is within limits; bodies that overlap by less than 2 mm count as apart."""
        inside = self.beyond.max(initial=0.0) <= ROUNDING and self.speed.max(initial=0.0) <= 1.0
        return bool(inside and self.gaps[1] >= -DEEP_M and (self.off_ground is None or self.off_ground.holds))

    @property
    def worst(self) -> tuple[float, str, tuple[Limit, ...]]:
        """(instant, what is beyond its limit there, that limit of a link over the ground)."""
        i, k = int(self.beyond.argmax()), int(self.speed.argmax())
        if self.beyond[i] > ROUNDING:
            return float(self.at[0, i]), f"{self.names[i]!r} is {self.beyond[i]:.2g} rad or m beyond its limit", ()
        if self.speed[k] > 1.0:
            return float(self.at[1, k]), f"{self.names[k]!r} is at {self.speed[k]:.0%} of its speed limit", ()
        if self.off_ground is not None and not self.off_ground.holds:
            t, said, limit = self.off_ground.worst
            return t, said, (limit,)
        return self.gaps[0], f"two bodies of the robot may overlap, by {-1e3 * self.gaps[1]:.1f} mm at most", ()


def joint_limits(robot: CheckedModel, keys: Array) -> tuple[Array, Array]:
    """(least, most) of the coordinates of `numbers_of`, shapes (k,) [m, rad]: limits, or where keyframes (n, nq) have them."""
    i, _ = numbers_of(robot)
    of, model = keys[:, i], robot.model
    return np.minimum(model.lowerPositionLimit[i], of.min(axis=0)), np.maximum(model.upperPositionLimit[i], of.max(axis=0))


def between(curve: Curve, keys: Array, bodies: BodyPairs | None, over: OverGround | None, halved: int = HALVED) -> Between:
    """That of a curve; joints may be where keyframes (n, nq) have them; distances only of what is given.

    An interval in which a link may be nearer to the ground than its clearance is halved, at most `halved` times.
    """
    robot = curve.robot
    model, (_, k), (low, high) = robot.model, numbers_of(robot), joint_limits(robot, keys)
    least, most = curve.extremes(0)
    beyond = np.maximum(low - least[:, k], most[:, k] - high)
    slow, fast = curve.extremes(1)
    share = (np.maximum(-slow, fast) / speed_limits(robot))[:, k]
    at = curve.t[np.array([beyond.argmax(axis=0), share.argmax(axis=0)])]
    names = np.repeat(list(model.names), [joint.nv for joint in model.joints])
    gaps = (float(curve.t[0]), MEASURED) if bodies is None else _gaps(curve, bodies)
    off = None if over is None else off_ground(curve, over, halved)
    return Between(beyond.max(axis=0), share.max(axis=0), at, tuple(names[k].tolist()), gaps, off)


def _gaps(curve: Curve, bodies: BodyPairs) -> tuple[float, float]:
    """(time, bound of how far bodies are apart there): the least of all intervals, halved where they may touch."""
    start, end, found = curve.t[:-1], curve.t[1:], list[tuple[float, float]]()
    for i in range(HALVED + 1):
        least = _apart(curve, bodies, start, end)
        again = (least < 0.0) & (i < HALVED)
        found += zip(least[~again], start[~again], strict=True)
        if not again.any():
            break
        a, b = start[again], end[again]
        middle = 0.5 * (a + b)
        start, end = np.concatenate([a, middle]), np.concatenate([middle, b])
    gap, t = min(found)
    return float(t), float(gap)


def _apart(curve: Curve, bodies: BodyPairs, start: Array, end: Array) -> Array:
    """How far bodies are apart at least, in m intervals, shape (m,) [m]; at most `MEASURED`."""
    robot, m, h = curve.robot, len(start), end - start
    R, p = placements(robot, curve.at(np.concatenate([start, end]))[0])
    shapes = [shape for *_, shape in bodies.shapes]
    joint, reach = np.array([s.joint for s in shapes]), np.array([s.reach for s in shapes])
    centre = np.array([s.centre for s in shapes])
    c = (p[:, joint] + each_times(R[:, joint], np.broadcast_to(centre, (2 * m, *centre.shape)))).reshape(2, m, -1, 3)
    moved = c[1] - c[0]
    turned = np.linalg.norm(R[m:] - R[:m], axis=(2, 3))[:, joint] * reach
    bounds = Bounds.of(robot, curve.sizes(start, end))
    far = np.linalg.norm(centre, axis=1) + reach
    bent = (bounds.place[2, joint].T + bounds.turn[2, joint].T * far) * h[:, None] ** 2 / 8.0
    out, first = np.full(m, MEASURED), {}
    for i, j, near in bodies.near(R, p, MEASURED):
        gap = np.full(2 * m, MEASURED)
        gap[near.frames] = near.gap
        first[i, j] = gap
    for i, j in bodies.pairs:
        if bodies.at_rest(i, j) < -DEEP_M:
            continue
        gaps = first.get((i, j), np.full(2 * m, MEASURED)).reshape(2, m)
        sweep = np.linalg.norm(moved[:, j] - moved[:, i], axis=1) + turned[:, i] + turned[:, j]
        out = np.minimum(out, 0.5 * (gaps.sum(axis=0) - sweep) - bent[:, i] - bent[:, j])
    return out
