"""What is kept of motions: of a simulated one its end and its extremes, of a checked one its summary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.errors import Reason
from rbd.motion.causes import CAUSES
from rbd.motion.report import MotionReport
from rbd.simulation.trajectory import Trajectory
from rbd.studies.kept.registry import Kept, Kind, number, one


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


KINDS = {
    "rbd.simulation.trajectory.Trajectory": Kind(
        {
            **one("worst_residual", "largest scaled residual of the contact law, over the motion", _residual("law")),
            **one("penetration", "depth of the deepest contact, over the motion", _residual("penetration"), "m or rad"),
            **one("drift", "largest position error of the bilateral constraints", _residual("drift"), "m or rad"),
            **one("duration", "time from the first sample to the last", lambda run: run.duration, "s"),
            **one("ended_early", "whether it ended before the time that was asked for", lambda run: bool(run.interrupted), ""),
            "end_reason": Kept("why it ended early: a code of rbd.errors.Reason; 0 if it did not", _end_reason),
            **one("interrupted", "when and why it ended early, in words", lambda run: run.interrupted, "", default=False),
            "final_q": Kept("configuration at the end", _final("q")),
            "final_v": Kept("velocities at the end", _final("v")),
            "final_com": Kept("centre of mass in W at the end", _final_com),
            **one("lowest_com", "lowest height of the centre of mass", lambda run: run.com[:, 2].min(), "m"),
            **one("energy_change", "energy at the end less that at the beginning", lambda r: r.energy[-1] - r.energy[0], "J"),
            **one("motor_work", "work of the motors", lambda run: run.motor_work[-1], "J"),
            **one("worst_torque", "largest share of a motor limit that is used", _worst_torque),
            "largest_tau": Kept("largest torque of each motor", _largest_tau, False),
            "largest_forces": Kept("largest force of each contact", _largest_force, False),
            **one("events", "number of beginnings and ends of contact", lambda run: len(run.events), default=False),
        },
        ("worst_residual", "penetration", "drift"),
    ),
    "rbd.motion.report.MotionReport": Kind(
        {
            **one("share_possible", "share of the frames that are possible", lambda report: report.share_possible),
            **one("score", "0 to 100, as MotionReport.score", lambda report: report.score),
            "causes": Kept("share of the frames with each cause: share_floats, share_motor, ...", _shares),
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
