"""Answers at many states as an xarray.Dataset: every array with the names of its dimensions and entries, and units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.answers.many import naming
from rbd.model.joints import FORCE_OF
from rbd.modules import xarray_or_error

if TYPE_CHECKING:
    import xarray


def dataset_of(found: Any) -> xarray.Dataset:
    """All arrays of a `ManyAnswers` over the dimension `state`; constraints stand in the names of variables: force_left_sole.

    Raises:
        InputError: xarray is not installed; names the extra.
    """
    xr, robot = xarray_or_error(), found.states.robot
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"state": np.arange(len(found)), "axis": list(naming.AXES)}
    for name, variable in _variables(found):
        variables[name] = (["state", *variable.dims], variable.values, variable.attributes)
        coords |= {dim: np.array(labels, None if labels else str) for dim, labels in variable.labels.items()}
    coords["velocity_unit"] = ("velocity", [f"{c.unit}/s" for c in robot.joints.velocities])
    coords["motor_unit"] = ("motor", np.array([FORCE_OF[c.unit] for c in robot.motor_coordinates], str))
    variables["method"] = ("state", found.method)
    about = {"title": f"{len(found)} states of {robot.name}", "frames": "W, z up; forces are those on the robot"}
    return xr.Dataset(variables, coords, about)


def _variables(found: Any) -> Iterator[naming.Named]:
    states = found.states
    for name, values in (("q", states.q), ("v", states.v), ("a", found.a), ("tau", found.tau)):
        yield naming.coordinates(name, values, states.robot)
    yield naming.status(found.status)
    for name, values in found.residuals.items():
        yield naming.residual(name, values)
    for name, values in states.friction.items():
        yield naming.of_contact("friction", name, values)
    for name, values in found.forces.items():
        yield naming.force(name, values, contact=name in found.friction_used)
    for name, values in found.corner_forces.items():
        yield naming.corner_forces(name, values)
    for name, values in found.friction_used.items():
        yield naming.of_contact("friction_used", name, values)
    for name, values in found.centre_of_pressure.items():
        yield naming.centre_of_pressure(name, values)
