"""A hop of a robot of four feet, as several tests plan it."""

from __future__ import annotations

import rbd
from rbd.planning import Plan

LIFT, LAND, END = 0.4, 0.7, 1.1


def hop_of(robot: rbd.Robot) -> Plan:
    """Nothing stands from 0.4 to 0.7 s; the centre of mass rises by 11 cm."""
    stand = robot.standing()
    low, off = ({"com": stand.com - [0.0, 0.0, by]} for by in (0.06, 0.02))
    keys = {0.0: stand, 0.25: low, LIFT: off, LAND: off, 0.85: low, END: stand}
    return rbd.plan(robot, keys, {foot.name: [(0.0, LIFT), (LAND, END)] for foot in robot.feet()}, progress=False)
