"""`excitation`: how well some motions would tell the base parameters, before any torque is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, largest_first
from rbd.displayed import Displayed
from rbd.model.inertial import checked_columns
from rbd.motion.identification.combinations import BaseParameters
from rbd.motion.identification.data import UNTOLD, measured_motions
from rbd.motion.identification.setup import Setup

_LISTED = 5


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Displayed):
    """How well motions tell the base parameters: rank and condition of their equations.

    Attributes:
        base: The base parameters.
        singular_values: Of the equations, each over its `rbd.motion.sensor_noise.force_scale`, in relative changes of the base
            parameters, shape (r,), descending.
        directions: The relative changes that belong to them, as columns, shape (r, r).
        equations: How many there are.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> wave = lambda t: np.array([1.2 * np.sin(3.0 * t), 0.9 * np.cos(5.0 * t)])
        >>> both = rbd.Motion.from_function(arm, wave, np.linspace(0.0, 4.0, 81))
        >>> one = rbd.Motion.from_function(arm, lambda t: wave(t) * [0.0, 1.0], np.linspace(0.0, 4.0, 81))
        >>> print(rbd.motion.identification.excitation(both))
        6 of 6 combinations told by 162 equations, condition 101; least: link_1.mc_z, link_1.I_yy
        >>> print(rbd.motion.identification.excitation(one))
        4 of 6 combinations told by 162 equations, condition inf; least: link_1.mc_z, link_1.I_yy
    """

    base: BaseParameters
    singular_values: Array
    directions: Array
    equations: int

    @property
    def rank(self) -> int:
        """How many combinations are told."""
        s = self.singular_values
        return int((s > UNTOLD * s[0]).sum()) if len(s) and s[0] > 0.0 else 0

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; inf where some combination is not told."""
        s = self.singular_values
        return float(s[0] / s[-1]) if len(s) and self.rank == self.base.rank else float("inf")

    @property
    def weakest(self) -> tuple[str, ...]:
        """Labels of the base parameters in the combinations that are told least, the largest first."""
        s = self.singular_values
        least = s <= (max(s[-1] * (1.0 + 1e-6), UNTOLD * s[0]) if len(s) else 0.0)
        part = np.linalg.norm(self.directions[:, least], axis=1)  # of their space: single directions in it are arbitrary
        return tuple(self.base.labels[i] for i in largest_first(part)[:_LISTED] if part[i] > 0.1)

    def __str__(self) -> str:
        told = f"{self.rank} of {self.base.rank} combinations told by {self.equations} equations"
        return f"{told}, condition {self.condition:.3g}; least: {', '.join(self.weakest)}"

    def __repr__(self) -> str:
        return f"Excitation({self})"


def excitation(motions: object, *, columns: Sequence[str] = ("inertia",)) -> Excitation:
    """How well motions would tell the base parameters, all torques being measured: to choose motions before they are made.

    The equations are those of `rbd.identify`, each coordinate over its `rbd.motion.sensor_noise.force_scale` without effort
    limits, and the base parameters over their sizes in the model. A condition number below 100 is usually wanted [Gautier1991].

    Args:
        motions: As of `rbd.identify`; torques are not needed. Forces of contacts that are not in `forces` are eliminated.
        columns: As of `rbd.identify`.

    Raises:
        InputError: as `rbd.identify`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> crouch = solo.standing().with_joints({"FL_KFE": -1.2}).q
        >>> motion = rbd.motion.minimum_jerk(solo, [solo.standing().q, crouch], [0.0, 0.5], rate=60.0)
        >>> found = rbd.motion.identification.excitation(motion)
        >>> found.rank < found.base.rank == 94, found.condition
        (True, inf)
    """
    asked = checked_columns(columns)
    given = tuple(
        each if each.tau is not None else replace(each, tau=np.zeros((each.frames, each.robot.nu)))
        for each in measured_motions(motions)
    )
    posed = Setup.of(given, asked, 1.0, None)
    found = posed.data.compressed()
    _, s, Vt = np.linalg.svd(found.R * posed.unit)
    values = np.zeros(posed.base.rank)
    values[: len(s)] = s
    return Excitation(posed.base, values, Vt.T, found.count)
