"""Other forces of the world than those of constraints: pushes, generalised forces, and force elements such as springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeGuard

import numpy as np

from rbd.arrays import Array, add_wrench, as_array, as_finite, as_vector3, is_finite
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_different
from rbd.model.state import State, checked


@dataclass(frozen=True, eq=False)
class ExternalForce(Displayed):
    """A force and a moment on the robot at a named frame, in world axes: a push, a load, wind.

    Attributes:
        frame: Frame of the robot.
        force: Shape (3,) [N], world axes.
        moment: Shape (3,) [N m], world axes, in addition to that of the force's lever arm.
        offset: Where the force acts, from the frame's origin in the frame's axes, shape (3,) [m].

    Raises:
        InputError: if a vector is not three finite numbers.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> lift = rbd.ExternalForce("box", (0.0, 0.0, 120.0), offset=(0.1, 0.0, 0.0))
        >>> rbd.solve(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), [], external=[lift]).a[:3].round(3)  # (120 - 98.1) N over 10 kg
        array([0.  , 0.  , 2.19])
    """

    frame: str
    force: Sequence[float] | Array
    moment: Sequence[float] | Array = (0.0, 0.0, 0.0)
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for what in ("force", "moment", "offset"):
            object.__setattr__(self, what, as_vector3(f"{what} of the external force at {self.frame!r}", getattr(self, what)))


class ForceElement(Protocol):
    """Protocol of force elements: forces that the state determines, e.g. of springs. They go where `external` goes.

    Those of `rbd.constraints.forces` are force elements; so is any object with `name`, `generalised`, `energy` and
    `dissipation`. If it has
    `derivatives(state)` too, (dtau/dq on the tangent space, dtau/dv), shapes (nv, nv), it is used; else they are taken by
    differences (`rbd.answers.analysis.state_changes`). What it returns is checked: sizes, and that it is finite.
    """

    @property
    def name(self) -> str:
        """Its name, for messages, records and drawings; no two elements that act together have the same."""

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench): what it adds to tau_ext, shape (nv,), and its wrench from outside the robot about the centre of mass.

        The wrench is in world axes, shape (6,) [N, N m]: that of the ground on the robot. Forces between two bodies of the
        robot, and those in joints, have none.
        """

    def energy(self, state: State) -> float:
        """Potential energy [J], zero where it is relaxed."""

    def dissipation(self, state: State) -> float:
        """Power that it takes out of the motion [W]; zero of a spring."""


External: TypeAlias = Array | Sequence[float] | Sequence[ExternalForce | ForceElement] | ExternalForce | ForceElement | None


def is_element(given: object) -> TypeGuard[ForceElement]:
    """Whether it is a force element: it has a method `generalised`, and is no class.

    Raises:
        InputError: it has that one, and not the others that a force element must have.
    """
    if isinstance(given, type) or not callable(getattr(given, "generalised", None)):
        return False
    name = getattr(given, "name", None)
    missing = [method for method in ("energy", "dissipation") if not callable(getattr(given, method, None))]
    if missing or not isinstance(name, str) or not name:
        lacks = f"no {' and no '.join(missing)}" if missing else f"the name {name!r:.80}"
        raise InputError(
            f"external holds {type(given).__name__}, which has generalised(state), but {lacks}; a force element has a name, "
            "generalised, energy and dissipation, see rbd.model.external.ForceElement."
        )
    return True


def acting(external: External) -> tuple[object, list[ExternalForce], list[ForceElement]]:
    """(the generalised force, None where there is none; the pushes; the force elements) that external forces are.

    Raises:
        InputError: neither an external force nor a force element; of a force element, as `is_element` refuses it.
    """
    if external is None or isinstance(external, np.ndarray):
        return external, [], []
    if isinstance(external, ExternalForce) or is_element(external):
        external = (external,)
    if not isinstance(external, Sequence) or isinstance(external, str | bytes):
        raise InputError(f"external is {external!r:.80}; {_EXPECTED}")
    pushes = [each for each in external if isinstance(each, ExternalForce)]
    elements = [each for each in external if is_element(each)]
    if len(pushes) + len(elements) == len(external):
        return None, pushes, elements
    if pushes or elements:
        raise InputError(f"external mixes forces and springs with something else; {_EXPECTED}")
    return external, [], []


def elements_of(external: External) -> tuple[ForceElement, ...]:
    """The force elements among external forces; errors as `acting`."""
    return tuple(acting(external)[2])


def has_pushes(external: External) -> bool:
    """Whether there are forces other than those of force elements: pushes, or a generalised force; errors as `acting`."""
    force, pushes, _ = acting(external)
    return force is not None or bool(pushes)


def generalised(state: State, external: External) -> tuple[Array, Array]:
    """(tau_ext, wrench): what external forces are in the equations of motion, and about the centre of mass.

    Args:
        state: Where the robot is.
        external: Generalised force (nv,), or `ExternalForce` objects and force elements, or None.

    Returns:
        tau_ext, shape (nv,), the sum of J_P^T (force, moment); and the same forces as one wrench about the centre of mass,
        in world axes, shape (6,). For a generalised force, the wrench is its part on the bases, undefined on a fixed base.

    Raises:
        InputError: no such forces, sizes that do not fit, or an element without a force at this state.
        DuplicateName: two force elements of one name.
    """
    robot = checked(state).robot
    force, pushes, elements = acting(external)
    if force is not None:
        return _generalised_force(state, force)
    tau_ext, wrench, com = np.zeros(robot.nv), [0.0] * 6, state.com.tolist() if pushes else []
    for push in pushes:
        at = state.frame(push.frame, push.offset)
        given = np.concatenate([push.force, push.moment])
        tau_ext += at.J.T @ given
        add_wrench(wrench, given.tolist(), at.X_WF.translation.tolist(), com)
    total = np.array(wrench)
    check_different([element.name for element in elements], "force elements")
    for element in elements:
        tau, outside = applied(element, state)
        tau_ext += tau
        total += outside
    return tau_ext, total


def applied(element: ForceElement, state: State) -> tuple[Array, Array]:
    """(tau, wrench) of a force element, as of `ForceElement.generalised`, checked.

    Raises:
        InputError: it returns something else than two arrays of these sizes, or what is not finite; with the element's name.
    """
    found = element.generalised(state)
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError(f"generalised(state) of {element.name!r:.80} is {found!r:.80}; expected (tau (nv,), wrench (6,)).")
    parts = []
    for what, value, size in (("tau", found[0], state.robot.nv), ("wrench", found[1], 6)):
        sound = type(value) is np.ndarray and value.dtype == float and value.shape == (size,) and is_finite(value)
        parts.append(value if sound else as_finite(f"{what} of {element.name!r:.80}", value, (size,)))
    return parts[0], parts[1]


_EXPECTED = (
    "expected ExternalForces and force elements, e.g. [rbd.ExternalForce(frame, (0, 80, 0)), rbd.JointSpring(joint, "
    "stiffness=20)], or one generalised force (nv,)."
)


def _generalised_force(state: State, external: object) -> tuple[Array, Array]:
    robot, wrench = state.robot, [0.0] * 6
    tau_ext = as_array("external", external)
    if tau_ext.shape in ((3,), (6,)) and len(tau_ext) != robot.nv:
        raise InputError(f"external has {len(tau_ext)} entries, and a generalised force {robot.nv}; {_EXPECTED}")
    tau_ext = robot.check_v(tau_ext, "external")
    for joint in robot.bases:  # the part of a base is the resultant on its robot, about its origin, in its axes
        X_WB, at = state.base_pose(joint), robot.model.joints[joint].idx_v
        base = [*(X_WB.rotation @ tau_ext[at : at + 3]), *(X_WB.rotation @ tau_ext[at + 3 : at + 6])]
        add_wrench(wrench, base, X_WB.translation.tolist(), state.com.tolist())
    return tau_ext, np.array(wrench)
