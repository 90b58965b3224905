"""What is kept of limits of standing: of the largest pushes, and of the regions where it can stand."""

from __future__ import annotations

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.problem.programs import Outcome, linear_program
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.studies.kept.registry import Kept, Kind, one


def _directions(limits: PushLimits) -> list[Named]:
    about = "direction of the push, in W"
    return [("push_direction", Variable(limits.directions, ("direction", "axis"), "1", about, {"axis": naming.AXES}))]


def _limits(limits: PushLimits) -> list[Named]:
    return [("push_limit", Variable(limits.forces, ("direction",), "N", "largest push in each direction"))]


def _least(limits: PushLimits) -> list[Named]:
    return [("push_least", Variable(limits.least, ("direction",), "N", "smallest push in each direction that holds it"))]


def _bounds(limits: PushLimits) -> list[Named]:
    return [("push_bound", Variable(limits.bounds, ("direction",), "N", "proven bound of the push in each direction"))]


def _gives_way(limits: PushLimits) -> list[Named]:
    words = np.array([", ".join(str(limit) for limit in each) for each in limits.gives_way], str)
    return [("gives_way", Variable(words, ("direction",), "", "what gives way first in each direction"))]


def inscribed_radius(vertices: Array) -> float:
    """Radius of the largest circle in a flat convex polygon [m]; zero of fewer than three corners.

    Args:
        vertices: Corners in order, shape (k, 2), or (k, 3) in a plane [m].
    """
    if len(vertices) < 3:
        return 0.0
    middle = vertices.mean(axis=0)
    flat = (vertices - middle) @ np.linalg.svd(vertices - middle)[2][:2].T
    along = np.roll(flat, -1, axis=0) - flat
    length = np.linalg.norm(along, axis=1)
    some = length > 0.0
    normals = np.stack([along[some, 1], -along[some, 0]], axis=1) / length[some, None]
    level = (normals * flat[some]).sum(axis=1)
    # The middle is inside: normals point outwards, or all of them inwards, which is the polygon turned by half a turn.
    found = linear_program(np.array([0.0, 0.0, -1.0]), np.column_stack([normals, np.ones(len(normals))]), np.abs(level))
    return float(found.x[2]) if found.outcome is Outcome.SOLVED else np.nan


def _radius(region: SupportRegion | ZmpRegion) -> float:
    return inscribed_radius(region.vertices) if region.bounded else np.inf


_REGION = {
    **one("empty", "whether there is no such place", lambda region: region.empty, ""),
    **one("bounded", "whether the region ends everywhere", lambda region: region.bounded, ""),
    **one("cut", "whether it goes on beyond 10 m: area, distance and radius are then of the part within", lambda x: x.cut, ""),
}
_RADIUS = one("inscribed_radius", "radius of the largest circle inside", _radius, "m", default=False)
KINDS = {
    "rbd.statics.pushes.PushLimits": Kind(
        {
            **one(
                "residual", "largest error of all pushes: of balance, forces outside cones, torques", lambda x: x.residual, "N"
            ),
            "push_limit": Kept("largest push in each direction; NaN where none holds it", _limits),
            "push_least": Kept("smallest push in each direction that holds it; zero where it is held without one", _least),
            "push_bound": Kept("what no push in each direction can exceed, proven", _bounds),
            "push_direction": Kept("unit vector of each direction, in W", _directions, False),
            "gives_way": Kept("the limits that give way first in each direction", _gives_way, False),
        },
        ("residual",),
    ),
    "rbd.statics.regions.SupportRegion": Kind(
        {
            **one("residual", "largest error of the corners", lambda region: region.residual, "N"),
            **one("area", "area of the region; infinite where it has no end", lambda region: region.area, "m2"),
            **one(
                "com_distance", "distance of the centre of mass from the edge, positive inside", lambda x: x.com_to_edge[0], "m"
            ),
            **_REGION,
            **one("area_gap", "by how much the proven outer polygon is larger", lambda x: x.area_gap, "m2", default=False),
            **_RADIUS,
        },
        ("residual",),
    ),
    "rbd.statics.zero_moment_point.ZmpRegion": Kind(
        {
            **one("area", "area of the region; infinite where it has no end", lambda region: region.area, "m2"),
            **_REGION,
            **_RADIUS,
        }
    ),
}
"""What is kept of each class."""
