"""Forces that the world applies beside the constraints: a push, a load, a wind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array, add_wrench, as_array, as_vector3
from rbd.errors import InputError
from rbd.model.state import State


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
            object.__setattr__(self, what, as_vector3(f"{what} of the external force at {self.frame!r}", getattr(self, what)))


External: TypeAlias = Array | Sequence[float] | Sequence[ExternalForce] | ExternalForce | None


def generalised(state: State, external: External) -> tuple[Array, Array]:
    """(tau_ext, wrench): what external forces are in the equations of motion, and about the centre of mass.

    Args:
        state: Where the robot is.
        external: Generalised force (nv,), or `ExternalForce`s, or None.

    Returns:
        tau_ext, shape (nv,), the sum of J_P^T (force, moment); and the same forces as one wrench about the centre of mass,
        in world axes, shape (6,). Of a generalised force, the wrench is its bases' part; it means nothing on a fixed base.
    """
    robot = state.robot
    if external is None:
        return np.zeros(robot.nv), np.zeros(6)
    if isinstance(external, np.ndarray):
        return _generalised_force(state, external)
    if isinstance(external, ExternalForce):
        external = (external,)
    if not isinstance(external, Sequence) or isinstance(external, str | bytes):
        raise InputError(f"external is {external!r:.80}; {_WANTED}")
    pushes = [e for e in external if isinstance(e, ExternalForce)]
    if len(pushes) < len(external):
        if pushes:
            raise InputError(f"external mixes ExternalForce with something else; {_WANTED}")
        return _generalised_force(state, external)
    tau_ext, wrench, com = np.zeros(robot.nv), [0.0] * 6, state.com.tolist()
    for push in pushes:
        at = state.frame(push.frame, push.offset)
        given = np.concatenate([push.force, push.moment])
        tau_ext += at.J.T @ given
        add_wrench(wrench, given.tolist(), at.X_WF.translation.tolist(), com)
    return tau_ext, np.array(wrench)


_WANTED = "expected ExternalForces, e.g. [rbd.ExternalForce(frame, (0, 80, 0))], or one generalised force (nv,)."


def _generalised_force(state: State, external: Array | Sequence[float] | Sequence[ExternalForce]) -> tuple[Array, Array]:
    robot, wrench = state.robot, [0.0] * 6
    tau_ext = as_array("external", external)
    if tau_ext.shape in ((3,), (6,)) and len(tau_ext) != robot.nv:
        raise InputError(f"external has {len(tau_ext)} entries, and a generalised force {robot.nv}; {_WANTED}")
    tau_ext = robot.check_v(tau_ext, "external")
    for joint in robot.bases:  # the part of a base is the resultant on its robot, about its origin, in its axes
        X_WB, at = state.base_pose(joint), robot.model.joints[joint].idx_v
        base = [*(X_WB.rotation @ tau_ext[at : at + 3]), *(X_WB.rotation @ tau_ext[at + 3 : at + 6])]
        add_wrench(wrench, base, X_WB.translation.tolist(), state.com.tolist())
    return tau_ext, np.array(wrench)
