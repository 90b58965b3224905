"""Forces that the world applies beside the constraints: a push, a load, a wind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array, add_wrench, three
from rbd.errors import InputError
from rbd.state import State


@dataclass(frozen=True, eq=False)
class ExternalForce:
    """A force and a moment on the robot at a named frame, in world axes.

    Attributes:
        frame: Frame of the robot.
        force: Shape (3,) [N], world axes.
        moment: Shape (3,) [N m], world axes, beside the force's own moment arm.
        offset: Where the force acts, from the frame's origin in the frame's axes, shape (3,) [m].

    Raises:
        InputError: if a vector is not three finite numbers.
    """

    frame: str
    force: Sequence[float] | Array
    moment: Sequence[float] | Array = (0.0, 0.0, 0.0)
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for what in ("force", "moment", "offset"):
            object.__setattr__(self, what, three(f"{what} of the external force at {self.frame!r}", getattr(self, what)))


External: TypeAlias = Array | Sequence[float] | Sequence[ExternalForce] | ExternalForce | None


def generalised(state: State, external: External) -> tuple[Array, Array]:
    """(tau_ext, wrench): what external forces are in the equations of motion, and about the centre of mass.

    Args:
        state: Where the robot is.
        external: Generalised force (nv,), or `ExternalForce`s, or None.

    Returns:
        tau_ext, shape (nv,), the sum of J_P^T (force, moment); and the same forces as one wrench about the centre of mass,
        in world axes, shape (6,). Of a generalised force, the wrench is its base part; it means nothing on a fixed base.
    """
    robot, wrench = state.robot, [0.0] * 6
    if external is None:
        return np.zeros(robot.nv), np.zeros(6)
    if isinstance(external, ExternalForce):
        external = (external,)
    forces = [e for e in external if isinstance(e, ExternalForce)]
    if forces and len(forces) == len(external):
        tau_ext, com = np.zeros(robot.nv), state.com.tolist()
        for e in forces:
            at = state.frame(e.frame, e.offset)
            given = np.concatenate([e.force, e.moment])
            tau_ext += at.J.T @ given
            add_wrench(wrench, given.tolist(), at.X_WF.translation.tolist(), com)
        return tau_ext, np.array(wrench)
    if forces:
        raise InputError("external mixes ExternalForce with something else; give one kind: (nv,) numbers, or ExternalForces.")
    if len(external) == 0:
        return np.zeros(robot.nv), np.zeros(6)
    tau_ext = robot.check_v(np.asarray(external), "external")
    if robot.floating:
        X_WB = state.frame(robot.model.names[1]).X_WF
        base = [*(X_WB.rotation @ tau_ext[:3]), *(X_WB.rotation @ tau_ext[3:6])]
        add_wrench(wrench, base, X_WB.translation.tolist(), state.com.tolist())
    return tau_ext, np.array(wrench)
