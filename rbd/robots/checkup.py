"""`doctor`: what is wrong with a loaded robot and its file."""

from __future__ import annotations

from dataclasses import replace

from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.files import read
from rbd.robots.diagnosis import ModelIssue, ModelReport, examine
from rbd.robots.loop_file import ROOTS
from rbd.robots.robot import Robot


def doctor(robot: Robot) -> ModelReport:
    """What is wrong with a robot, and what of its file the dynamics leave out.

    Errors: masses and inertias that are not finite, negative masses, joints whose outboard bodies leave M singular or
    indefinite, mass lost between file and model, swapped limits. Warnings: inertias that no body has, postures outside
    limits, missing meshes, missing effort limits, damping and friction, mimicked joints, loops that no posture closes. Notes:
    loops and wheels, and where the loops are closed. M is tried at neutral and at
    random configurations (the same ones each time); no mesh is opened.

    Where the file is no longer there, what was found when it was loaded, and a note that says so.

    Raises:
        InputError: not a robot.
        ModelError: its file is broken since.
    """
    if not isinstance(robot, CheckedModel) or not hasattr(robot, "source"):
        raise InputError(f"doctor wants a robot, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
    source = robot.source
    if robot.report is not None and not source.urdf.is_file():
        gone = ModelIssue("file", source.urdf.name, "is no longer there; this is what was found when it was loaded")
        return replace(robot.report, notes=(*robot.report.notes, gone))
    file = read(source.urdf, robot.limits, base=ROOTS[robot.root], folders=source.package_dirs, leave_out=robot.leave_out)
    return examine(robot, file, robot.postures, source.package_dirs)
