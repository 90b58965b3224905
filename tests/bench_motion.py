"""A minute of a G1's motion at 30 Hz, as from a file: read, checked, reported."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from bench_timing import Row, once

import rbd

FRAMES, RATE, AUDIT_RATE = 1800, 30.0, 60.0
MARKS = {False: (3.0,), True: (4.0,)}
"""Seconds, without and with self-collision."""


def swaying(robot: rbd.Robot) -> rbd.Motion:
    """Arms and waist that swing slowly, on both feet."""
    names = [f"{side}_{joint}_joint" for side in ("left", "right") for joint in ("shoulder_pitch", "elbow")]
    at = [robot.joints[name].q.start for name in (*names, "waist_yaw_joint")]
    t = np.arange(FRAMES) / RATE
    q = np.repeat(robot.standing().q[None], FRAMES, axis=0)
    q[:, at] += 0.3 * np.sin(2.0 * np.pi * t[:, None] / np.array([2.0, 3.0, 4.0, 5.0, 6.0]))
    return rbd.Motion.of_arrays(robot, t, q)


def audited(robot: rbd.Robot) -> rbd.audits.Record:
    """The same at 60 Hz, with the forces of its feet that `rbd.check_motion` found."""
    motion = swaying(robot).resample(AUDIT_RATE)
    report = rbd.check_motion(motion, self_collision=False)
    frame, point = np.nonzero(report.lanes.touches)
    carriers = {f.parentJoint: f.name for f in robot.model.frames if f.type == pin.BODY}
    return rbd.audits.Record.of_arrays(
        robot, t=motion.t, q=motion.q, v=motion.v, a=motion.a, tau=report.tau, contact_at=frame,
        contact_bodies=np.array([carriers[j] for j in report.lanes.points.joint])[point],
        points=report.lanes.places[frame, point], normals=np.tile([0.0, 0.0, 1.0], (len(frame), 1)), friction=0.7,
        forces=report.forces[frame, point], gaps=report.lanes.heights[frame, point],
    )  # fmt: skip


def motion_rows(robot: rbd.Robot) -> list[Row]:
    """Reading, checking, printing and saving; the robot and compiled code are at hand."""
    out = []
    with tempfile.TemporaryDirectory() as folder:
        file, kept = Path(folder) / "sways.csv", Path(folder) / "report.npz"
        swaying(robot).save(file, header=False)
        rbd.check_motion(swaying(robot).cut(0.0, 1.0))  # first calls compile
        for collision, marks in MARKS.items():

            def work(collision: bool = collision) -> str:
                report = rbd.check_motion(rbd.Motion.read(file, robot=robot, rate=RATE), self_collision=collision)
                report.save(kept)
                return str(report)

            what = "a minute of motion at 30 Hz read, checked, reported" + (", with self-collision" if collision else "")
            out.append(Row(what, {robot.name: once(work)}, "s", marks))
        record = audited(robot)
        record.save(kept)

        def judge() -> str:
            return str(rbd.audit(rbd.audits.Record.read(kept)))

        judge()
        minute = {robot.name: once(judge)}
        out.append(Row("a minute at 60 Hz with its contact forces read, audited, reported", minute, "s", (5.0,)))
        frame = {robot.name: 1e3 * once(lambda: rbd.audit(record)) / record.n}
        out.append(Row("the same, a frame, without file and table", frame, "ms", (1.0,)))
    return out
