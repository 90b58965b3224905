"""A motion as samples over time, whoever made it: protocols of what simulations, files and references have in common."""

from __future__ import annotations

from typing import Protocol

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel


class SampledPoses(Protocol):
    """A robot's configurations at n times, as those of `rbd.Trajectory` and `rbd.Motion`."""

    @property
    def robot(self) -> CheckedModel:
        """The robot."""

    @property
    def t(self) -> Array:
        """Times, shape (n,) [s]."""

    @property
    def q(self) -> Array:
        """Configurations, shape (n, nq)."""


class SampledMotion(SampledPoses, Protocol):
    """The same with velocities."""

    @property
    def v(self) -> Array:
        """Velocities, shape (n, nv) [m/s, rad/s]."""


class SampledAccelerations(SampledMotion, Protocol):
    """The same with accelerations."""

    @property
    def a(self) -> Array:
        """Accelerations, shape (n, nv) [m/s2, rad/s2]."""
