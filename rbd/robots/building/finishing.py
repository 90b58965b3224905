"""The robot of a model in the making, with the warnings that its user did not ask for."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import replace
from typing import Any

from rbd.errors import ModelWarning
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import LoopFile
from rbd.robots.robot import Robot

DELIBERATE = ("effort",)
"""Kinds of warnings of the doctor that a user of the builder has asked for: a motor whose limit was not given."""


def finished(text: str, loops: LoopFile, thin: Collection[str], **options: Any) -> Robot:
    """The robot of two texts. A `ModelWarning` has what the doctor finds, without motors whose limit was not given.

    Args:
        text: The URDF.
        loops: The loop file.
        thin: Bodies without extension that were asked for, which are left out of the warning too.
        options: More for `load_robot`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = load_robot(text=text, loops=loops, **options)
    report = robot.report
    assert report is not None
    kept = [f for f in report.warnings if f.kind not in DELIBERATE and not (f.kind == "inertia" and f.where in thin)]
    if kept:
        warnings.warn(replace(report, warnings=tuple(kept)).summary(), ModelWarning, stacklevel=3)
    return robot
