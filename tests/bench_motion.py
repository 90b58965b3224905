"""A minute of a G1's motion at 30 Hz, as from a file: read, checked, reported."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from bench_timing import Row, once

import rbd

FRAMES, RATE = 1800, 30.0
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
    return out
