"""Plans of a walk that were followed one after another, as a page draws them: footholds to come, and the capture point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.control.walking.plan import WalkPlan
from rbd.errors import InputError
from rbd.visual.marks.regions import CapturePoint, Footprints, planned_footprints
from rbd.visual.playback.shown_motion import ShownMotion

EXPECTED = "expected walk.plan of a rbd.control.Walk or Balance, its walk.plans: [(time, plan), ...], or None"


@dataclass(frozen=True, eq=False)
class FollowedPlans:
    """Plans of a walk, each from a time on until that of the next.

    Attributes:
        plans: (time [s], plan), times increasing; minus infinity of a plan that is drawn throughout.
    """

    plans: tuple[tuple[float, WalkPlan], ...]

    @classmethod
    def of(cls, given: Any, shown: ShownMotion) -> FollowedPlans:
        """What a user gave: a plan, plans with their times, or None.

        Raises:
            InputError: something else; times that do not increase; plans of another robot than that of the motion.
        """
        pairs = [] if given is None else [(-math.inf, given)] if isinstance(given, WalkPlan) else given
        if not isinstance(pairs, list | tuple):
            raise InputError(f"plan is {given!r:.80}; {EXPECTED}.")
        for pair in pairs:
            if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[1], WalkPlan)):
                raise InputError(f"plan has {pair!r:.80}; {EXPECTED}.")
            if not pair[1].robot.is_like(shown.robot):
                raise InputError(f"plan is of {pair[1].robot.name}; expected one of {shown.robot.name}, whose motion it is.")
        times = [as_float(t) for t, _ in pairs]
        if any(map(math.isnan, times)) or any(b <= a for a, b in pairwise(times)):
            raise InputError(f"plan has the times {[t for t, _ in pairs]!r:.80}; expected numbers that increase [s].")
        return cls(tuple(zip(times, (plan for _, plan in pairs), strict=True)))

    def footprints(self) -> list[tuple[float, float, Footprints]]:
        """(from [s], until [s], footprints): of each plan those of the feet that land after its time, until the next plan."""
        ends = [*(t for t, _ in self.plans[1:]), math.inf]
        return [(t, end, one) for (t, plan), end in zip(self.plans, ends, strict=True) for one in planned_footprints(plan, t)]

    def capture_points(self, shown: ShownMotion, times: Array) -> Array:
        """The capture point c + c' / w on the ground at some times, w = sqrt(g / h), shape (n, 3) [m].

        With the height h of the centre of mass c over the first stance as the motion begins.
        """
        plan, robot = self.plans[0][1], shown.robot
        level = float(np.mean([X.translation[2] for X in plan.poses.values()]))
        data, places = robot.model.createData(), np.zeros((len(shown.t), 3))
        rate = 0.0
        for i, (q, v) in enumerate(zip(shown.q, shown.v, strict=True)):
            com = pin.centerOfMass(robot.model, data, np.array(q, float), np.array(v, float))
            rate = rate or math.sqrt(float(np.linalg.norm(robot.gravity)) / max(float(com[2]) - level, 1e-3))
            places[i] = com + data.vcom[0] / rate
        for place in places:
            height = plan.floor.top(place[0], place[1])
            place[2] = height if math.isfinite(height) else level
        return np.column_stack([np.interp(times, shown.t, column) for column in places.T])


def drawn_plans(
    given: Any, shown: ShownMotion, times: Array
) -> tuple[list[Footprints | CapturePoint], list[tuple[float, float]], Array]:
    """What is drawn of plans, from when until when each of it is shown [s], and how the last, the capture point, moves.

    Args:
        given: Of a user: a plan, plans with their times, or None.
        shown: The motion.
        times: Of its frames, shape (n,) [s].

    Returns:
        Footprints, and last the capture point at the first frame; a pair of times for each; displacements, shape (n, 3) [m].

    Raises:
        InputError: see `FollowedPlans.of`.
    """
    followed = FollowedPlans.of(given, shown)
    if not followed.plans:
        return [], [], np.zeros((0, 3))
    first, last = float(times[0]), float(times[-1]) + 1.0
    prints, points = followed.footprints(), followed.capture_points(shown, times)
    spans = [(min(max(t, first), last), min(end, last)) for t, end, _ in prints]
    return [*(one for _, _, one in prints), CapturePoint(points[0])], [*spans, (first, last)], points - points[0]
