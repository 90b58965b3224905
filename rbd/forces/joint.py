"""Springs and dampers in joints: torques that the joints' positions and velocities determine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_float
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State


@dataclass(frozen=True, eq=False)
class JointSpring(Displayed):
    """A linear spring in a joint with one degree of freedom: tau = preload - k (q - q_0).

    Attributes:
        joint: The joint.
        stiffness: k [N m/rad, N/m].
        rest: q_0, where it is relaxed [rad, m].
        preload: Torque at q_0 [N m, N].

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> spring = rbd.forces.JointSpring(arm.actuated_names[0], stiffness=20.0)
        >>> spring.generalised(arm.at([0.1]))[0]
        array([-2.])
    """

    joint: str
    stiffness: float = field(kw_only=True)
    rest: float = field(default=0.0, kw_only=True)
    preload: float = field(default=0.0, kw_only=True)

    @property
    def name(self) -> str:
        """The joint's."""
        return self.joint

    def _stretch(self, state: State) -> float:
        return state.robot.joints[self.joint].coordinate(state.q) - self.rest

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench) at a state; the wrench is zero, as the torque is inside the robot."""
        tau = np.zeros(state.robot.nv)
        tau[state.robot.joints[self.joint].v] = self.preload - self.stiffness * self._stretch(state)
        return tau, np.zeros(6)

    def derivatives(self, state: State) -> tuple[Array, Array]:
        """(dtau/dq, dtau/dv), shapes (nv, nv)."""
        nv, at = state.robot.nv, state.robot.joints[self.joint].v.start
        by_q = np.zeros((nv, nv))
        by_q[at, at] = -self.stiffness
        return by_q, np.zeros((nv, nv))

    def energy(self, state: State) -> float:
        """1/2 k (q - q_0)^2 - preload (q - q_0) [J]."""
        x = self._stretch(state)
        return 0.5 * self.stiffness * x * x - self.preload * x

    def dissipation(self, state: State) -> float:
        """Zero."""
        return 0.0


@dataclass(frozen=True, eq=False)
class JointDamping(Displayed):
    """Viscous damping in joints: tau = -d v.

    Attributes:
        damping: {joint: d [N m s/rad, N s/m]}.

    Raises:
        InputError: negative damping.
    """

    damping: Mapping[str, float]
    name: str = "joint_damping"

    def __post_init__(self) -> None:
        for joint, d in self.damping.items():
            if not as_float(d) >= 0.0:
                raise InputError(f"damping of {joint!r:.80} is {d!r:.80}; expected a number from 0.")

    def _diagonal(self, state: State) -> Array:
        d = np.zeros(state.robot.nv)
        for joint, value in self.damping.items():
            d[state.robot.joints[joint].v] = value
        return d

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench) at a state; the wrench is zero."""
        return -self._diagonal(state) * state.v, np.zeros(6)

    def derivatives(self, state: State) -> tuple[Array, Array]:
        """(dtau/dq, dtau/dv), shapes (nv, nv)."""
        return np.zeros((state.robot.nv, state.robot.nv)), -np.diag(self._diagonal(state))

    def energy(self, state: State) -> float:
        """Zero."""
        return 0.0

    def dissipation(self, state: State) -> float:
        """v^T d v [W]."""
        return float(state.v @ (self._diagonal(state) * state.v))
