"""What identification starts from: base parameters, the equations, the model as a prior, and sizes of parameters."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, ModelWarning
from rbd.model.checked_model import CheckedModel
from rbd.model.inertial import body_names, inertial_parameters, joint_velocities
from rbd.motion.identification.combinations import BaseParameters, base_parameters
from rbd.motion.identification.consistent import Prior
from rbd.motion.identification.data import Assembly, MeasuredMotion
from rbd.motion.identification.possible import is_possible, made_possible, size_of
from rbd.motion.sensor_noise import SensorNoise

BROAD = 10.0
"""Standard deviation of rotor inertia, damping and dry friction before the data, over the scale of the force."""


@dataclass(frozen=True, eq=False)
class Setup:
    """The problem before any data were read.

    Attributes:
        base: The base parameters.
        data: What gives the equations.
        prior: The model.
        unit: Typical size of each base parameter, shape (r,).
    """

    base: BaseParameters
    data: Assembly
    prior: Prior
    unit: Array

    @classmethod
    def of(cls, motions: tuple[MeasuredMotion, ...], columns: Sequence[str], spread: float, noise: SensorNoise | None) -> Setup:
        """Of checked arguments of `rbd.identify`."""
        robot = motions[0].robot
        theta = _possible(robot, inertial_parameters(robot))
        base = base_parameters(robot, columns=columns)
        data, driven = Assembly(motions, base, columns, noise), joint_velocities(robot)
        rotors, none = np.array(robot.model.armature, float)[driven], np.zeros(len(driven))
        inertia = "inertia" in columns
        values = [theta.ravel()] if inertia else []
        values += [rotors if column == "rotor_inertia" else none for column in columns if column != "inertia"]
        bodies = np.flatnonzero(theta[:, 0] > 0.0) if inertia else np.zeros(0, int)
        wide = np.tile(BROAD * data.scale[driven], len(columns) - inertia)
        sizes = np.concatenate([_sizes(theta).ravel() if inertia else np.zeros(0), wide])
        prior = Prior(np.concatenate(values), bodies, wide, 1.0 / (4.0 * spread**2))
        return cls(base, data, prior, np.linalg.norm(base.B * sizes, axis=1))


def _sizes(theta: Array) -> Array:
    """Typical sizes of all bodies' parameters, shape (bodies, 10); zero of bodies without mass."""
    return np.array([size_of(each) if each[0] > 0.0 else np.zeros(10) for each in theta])


def _possible(robot: CheckedModel, theta: Array) -> Array:
    """The model's parameters, impossible bodies changed, with a warning."""
    names = body_names(robot)
    wrong = [i for i, each in enumerate(theta) if each[0] > 0.0 and not is_possible(each)]
    negative = [names[i] for i, each in enumerate(theta) if each[0] < 0.0]
    if negative:
        raise InputError(f"bodies of {robot.name} have negative mass: {', '.join(negative)}.")
    out = theta.copy()
    for i in wrong:
        out[i] = made_possible(theta[i])
    if wrong:
        warnings.warn(
            f"no body can have the inertia of {', '.join(names[i] for i in wrong)} in {robot.name}: the second moments about "
            "its centre of mass are raised to be positive before the data are fitted.",
            ModelWarning,
            stacklevel=4,
        )
    return out
