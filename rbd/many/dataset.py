"""Answers at many states as an xarray.Dataset: every array with the names of its dimensions and entries, and units."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.many.status import StateStatus
from rbd.model.joints import FORCE_OF
from rbd.modules import xarray_or_error

if TYPE_CHECKING:
    import xarray

AXES, SPATIAL = ["x", "y", "z"], ["fx", "fy", "fz", "mx", "my", "mz"]


def dataset_of(found: Any) -> xarray.Dataset:
    """All arrays of a `ManyAnswers` over the dimension `state`; constraints stand in the names of variables: force_left_sole.

    Raises:
        InputError: xarray is not installed; names the extra.
    """
    xr, robot = xarray_or_error(), found.states.robot
    variables: dict[str, Any] = {
        "q": (["state", "position"], found.states.q),
        "v": (["state", "velocity"], found.states.v),
        "a": (["state", "velocity"], found.a),
        "status": ("state", found.status, {"meaning": ", ".join(f"{int(code)} {code.words}" for code in StateStatus)}),
        "method": ("state", found.method),
    }
    variables["tau"] = (["state", "motor"], found.tau)
    for name, values in found.residuals.items():
        variables[f"residual_{name}"] = ("state", values, {"units": "1", "long_name": "scaled residual"})
    for name, values in found.states.friction.items():
        variables[f"friction_{_key(name)}"] = ("state", values, {"units": "1", "long_name": f"coefficient of {name}"})
    coords: dict[str, Any] = {
        "state": np.arange(len(found)),
        "position": [c.name for c in robot.joints.positions],
        "velocity": [c.name for c in robot.joints.velocities],
        "motor": np.array([c.name for c in robot.motor_coordinates], str),
        "velocity_unit": ("velocity", [f"{c.unit}/s" for c in robot.joints.velocities]),
        "motor_unit": ("motor", np.array([FORCE_OF[c.unit] for c in robot.motor_coordinates], str)),
        "axis": AXES,
    }
    for name, values in found.forces.items():
        key, contact, m = _key(name), name in found.friction_used, values.shape[1]
        coords[f"{key}_row"] = SPATIAL[:m] if contact and m in (3, 6) else np.arange(m).astype(str)
        unit = "N, then N m" if contact and m == 6 else "N" if contact else "N or N m"
        variables[f"force_{key}"] = (["state", f"{key}_row"], values, {"units": unit, "long_name": f"force of {name}"})
    for name, values in found.corner_forces.items():
        variables[f"corner_forces_{_key(name)}"] = (["state", f"{_key(name)}_corner", "axis"], values, {"units": "N"})
    for name, values in found.friction_used.items():
        variables[f"friction_used_{_key(name)}"] = ("state", values, {"units": "1"})
    for name, values in found.centre_of_pressure.items():
        variables[f"centre_of_pressure_{_key(name)}"] = (["state", "axis"], values, {"units": "m"})
    about = {"title": f"{len(found)} states of {robot.name}", "frames": "W, z up; forces are those on the robot"}
    return xr.Dataset(variables, coords, about)


def _key(name: str) -> str:
    return re.sub(r"\W", "_", name)
