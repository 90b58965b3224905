"""What a study keeps of motions, of poses, and of limits of standing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.errors import Reason
from rbd.mechanism.pose_search import FoundPose
from rbd.model.state import State
from rbd.motion.causes import CAUSES
from rbd.motion.report import MotionReport
from rbd.problem.programs import Outcome, linear_program
from rbd.simulation.trajectory import Trajectory
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.studies.outputs.fields import OutputField, ResultType, number, one


def _final(what: str) -> Callable[[Trajectory], list[Named]]:
    def of(run: Trajectory) -> list[Named]:
        variable = naming.coordinates(what, getattr(run, what)[-1], run.robot)[1]
        return [(f"final_{what}", replace(variable, long_name=f"{variable.long_name} at the end"))]

    return of


def _end_reason(run: Trajectory) -> list[Named]:
    code = np.asarray(run.end_reason.code, np.int16)
    return [("end_reason", Variable(code, (), "", "why it ended early", {}, {x.code: x.name.lower() for x in Reason}))]


def _final_com(run: Trajectory) -> list[Named]:
    return [("final_com", replace(naming.com(run.com[-1])[1], long_name="centre of mass in W at the end"))]


def _largest_tau(run: Trajectory) -> list[Named]:
    tau = naming.coordinates("tau", np.abs(run.tau).max(axis=0), run.robot)[1]
    return [("largest_tau", replace(tau, long_name="largest torque of each motor"))]


def _worst_torque(run: Trajectory) -> float:
    return float(run.robot.torque_use(run.tau, run.v).max(initial=0.0))


def _largest_force(run: Trajectory) -> list[Named]:
    return [
        (
            f"largest_force_{naming.key(name)}",
            Variable(np.asarray(_longest(run.forces[name])), (), "N", f"largest force of {name}"),
        )
        for name in run.contacts
    ]


def _longest(forces: Array) -> float:
    return float(np.linalg.norm(forces[:, :3], axis=1).max(initial=0.0))


def _residual(name: str) -> Callable[[Trajectory], float]:
    return lambda run: float(run.residuals[name].max(initial=0.0))


def _shares(report: MotionReport) -> list[Named]:
    return [
        found
        for i, cause in enumerate(CAUSES)
        for found in number(
            f"share_{naming.key(cause.replace('-', '_'))}",
            float(report.causes[:, i].mean()),
            "1",
            f"share of the frames that are not possible: {cause}",
        )
    ]


def _largest(values: Array) -> Any:
    return np.nanmax(values) if np.isfinite(values).any() else np.nan


def _edge(report: MotionReport) -> Any:
    return -_largest(-report.edge_margin)


_MOTIONS = {
    "rbd.simulation.trajectory.Trajectory": ResultType(
        {
            **one("worst_residual", "largest scaled residual of the contact law, over the motion", _residual("law")),
            **one("penetration", "depth of the deepest contact, over the motion", _residual("penetration"), "m or rad"),
            **one("drift", "largest position error of the bilateral constraints", _residual("drift"), "m or rad"),
            **one("duration", "time from the first sample to the last", lambda run: run.duration, "s"),
            **one("ended_early", "whether it ended before the time that was asked for", lambda run: bool(run.interrupted), ""),
            "end_reason": OutputField("why it ended early: a code of rbd.errors.Reason; 0 if it did not", _end_reason),
            **one("interrupted", "when and why it ended early, in words", lambda run: run.interrupted, "", default=False),
            "final_q": OutputField("configuration at the end", _final("q")),
            "final_v": OutputField("velocities at the end", _final("v")),
            "final_com": OutputField("centre of mass in W at the end", _final_com),
            **one("lowest_com", "lowest height of the centre of mass", lambda run: run.com[:, 2].min(), "m"),
            **one("energy_change", "energy at the end less that at the beginning", lambda r: r.energy[-1] - r.energy[0], "J"),
            **one("motor_work", "work of the motors", lambda run: run.motor_work[-1], "J"),
            **one("worst_torque", "largest share of a motor limit that is used", _worst_torque),
            "largest_tau": OutputField("largest torque of each motor", _largest_tau, False),
            "largest_forces": OutputField("largest force of each contact", _largest_force, False),
            **one("events", "number of beginnings and ends of contact", lambda run: len(run.events), default=False),
        },
        ("worst_residual", "penetration", "drift"),
    ),
    "rbd.motion.report.MotionReport": ResultType(
        {
            **one("share_possible", "share of the frames that are possible", lambda report: report.share_possible),
            **one("score", "0 to 100, as MotionReport.score", lambda report: report.score),
            "causes": OutputField("share of the frames with each cause: share_floats, share_motor, ...", _shares),
            **one("missing_median", "median of the missing wrench, scaled", lambda report: np.median(report.missing_scaled)),
            **one("missing_largest", "largest missing wrench, scaled", lambda r: r.missing_scaled.max(initial=0.0)),
            **one("open_median", "median of its standard deviation by noise", lambda report: np.median(report.open)),
            **one("worst_torque", "largest share of a motor limit", lambda r: r.used_torque.max(initial=0.0)),
            **one("friction_used", "largest |f_t| / (mu f_n) of a contact", lambda report: _largest(report.used_friction)),
            **one("edge_margin", "smallest distance of a centre of pressure from the edge", _edge, "m"),
            **one("frames", "number of frames", lambda report: report.n, default=False),
            **one("duration", "time from the first frame to the last", lambda r: r.motion.duration, "s", default=False),
        }
    ),
}  # fmt: skip
"""What is kept of each class."""


def _q(state: State) -> list[Named]:
    return [naming.coordinates("q", state.q, state.robot)]


def _v(state: State) -> list[Named]:
    return [naming.coordinates("v", state.v, state.robot)]


def _com(state: State) -> list[Named]:
    return [naming.com(state.com)]


def _of_pose(found: FoundPose) -> list[Named]:
    return _q(found.state)


_POSES = {
    "rbd.model.state.State": ResultType(
        {
            "q": OutputField("configuration", _q),
            "v": OutputField("velocities", _v),
            "com": OutputField("centre of mass in W", _com),
        }
    ),
    "rbd.mechanism.pose_search.FoundPose": ResultType(
        {
            **one("worst_error", "largest error of targets and loops", lambda found: found.worst, "m or rad"),
            "q": OutputField("configuration", _of_pose),
            "com": OutputField("centre of mass in W", lambda found: _com(found.state)),
            **one("moved", "distance of the joints from the posture", lambda found: found.moved, "rad"),
            **one("at_limits", "number of joints at a limit", lambda found: len(found.at_limits), default=False),
            **one("starts", "number of starts of the search", lambda found: found.starts, default=False),
        },
        ("worst_error",),
    ),
}
"""What is kept of each class."""


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
_STANDING = {
    "rbd.statics.pushes.PushLimits": ResultType(
        {
            **one(
                "residual", "largest error of all pushes: of balance, forces outside cones, torques", lambda x: x.residual, "N"
            ),
            "push_limit": OutputField("largest push in each direction; NaN where none holds it", _limits),
            "push_least": OutputField(
                "smallest push in each direction that holds it; zero where it is held without one", _least
            ),
            "push_bound": OutputField("what no push in each direction can exceed, proven", _bounds),
            "push_direction": OutputField("unit vector of each direction, in W", _directions, False),
            "gives_way": OutputField("the limits that give way first in each direction", _gives_way, False),
        },
        ("residual",),
    ),
    "rbd.statics.regions.SupportRegion": ResultType(
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
    "rbd.statics.zero_moment_point.ZmpRegion": ResultType(
        {
            **one("area", "area of the region; infinite where it has no end", lambda region: region.area, "m2"),
            **_REGION,
            **_RADIUS,
        }
    ),
}
"""What is kept of each class."""

KINDS = _MOTIONS | _POSES | _STANDING
