"""Inertial parameters of a robot's bodies, and the regressor in which the equations of motion are linear.

A body is a link with all that is fixed to it: what moves with one joint. Its ten parameters are, in the axes of its joint's
frame and about that frame's origin O, with c the centre of mass from O,

    m,   m c_x, m c_y, m c_z,   I_xx, I_xy, I_yy, I_xz, I_yz, I_zz,        I = I_c + m (c . c 1 - c c^T)

in this order, which is Pinocchio's. M(q) a + h(q, v) is linear in them: Y(q, v, a) theta [Atkeson1986].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, null_space
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked

PARAMETERS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Names of the ten parameters of a body, in their order."""
COLUMNS = ("inertia", "rotor_inertia", "damping", "dry_friction")
"""What a regressor can have columns for."""


class HasRows(Protocol):
    """Protocol: gives rows at a state."""

    @property
    def name(self) -> str:
        """Its name."""

    def rows(self, state: State) -> Any:
        """Its `rbd.Rows`."""


def body_names(robot: CheckedModel) -> tuple[str, ...]:
    """A name for each body, in the order of the joints: that of its first link, or of its joint where it has none.

    Example:
        >>> rbd.dynamics.body_names(rbd.load_robot("solo12"))[:3]
        ('base_link', 'FL_SHOULDER', 'FL_UPPER_LEG')
    """
    model = robot.model
    names: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint:
            names.setdefault(frame.parentJoint, frame.name)
    return tuple(names.get(i, model.names[i]) for i in range(1, model.njoints))


def inertial_parameters(robot: CheckedModel) -> Array:
    """The ten parameters of each body, shape (bodies, 10) [kg, kg m, kg m2], in the order of `body_names`.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> rbd.dynamics.body_names(box), rbd.dynamics.inertial_parameters(box)[0, :4]
        (('box',), array([10.,  0.,  0.,  0.]))
    """
    model = robot.model
    return np.array([model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]).reshape(-1, 10)


@dataclass(frozen=True, eq=False, repr=False)
class Regressor(Displayed):
    """The equations of motion as a linear function of parameters: Y theta + known = P (M a + h).

    With viscous damping d and dry friction c among the parameters, Y theta + known = P (M a + h + d v + c sign(v)): what the
    motors, the surroundings and the contacts supply.

    Attributes:
        Y: Shape (k, p).
        names: Of the parameters, shape (p,): "pelvis.m", "pelvis.mc_x", ..., "knee.rotor_inertia", "knee.damping".
        theta: Their values in the model, shape (p,); damping and friction are in no term of the model, so zero.
        known: What has no column, shape (k,) [N, N m]: that of rotor inertia, where it was not asked for.
        P: Shape (k, nv): the identity; with contacts, a basis of the generalised forces that no contact force has a part in,
            P J^T = 0, with orthonormal rows.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[2.0])
        >>> state, a = arm.at([0.3], [0.5]), np.array([1.5])
        >>> found = rbd.dynamics.regressor(state, a)
        >>> print(found)
        1 equation in 10 parameters of 1 body
        >>> (found.Y @ found.theta).round(6), rbd.dynamics.inverse_dynamics(state, a).round(6)
        (array([10.371851]), array([10.371851]))
    """

    Y: Array
    names: tuple[str, ...]
    theta: Array
    known: Array
    P: Array

    def __str__(self) -> str:
        (k, p), bodies = self.Y.shape, sum(name.endswith(".m") for name in self.names)
        return (
            f"{k} equation{'s' * (k != 1)} in {p} parameters"
            + f" of {bodies} bod{'y' if bodies == 1 else 'ies'}" * bool(bodies)
            + ", without contact forces" * (len(self.P) < self.P.shape[1])
        )


def regressor(
    state: State,
    a: Array,
    contacts: Sequence[HasRows] = (),
    *,
    columns: Sequence[str] = ("inertia",),
) -> Regressor:
    """The matrix Y(q, v, a) with Y theta = M a + h, theta the inertial parameters of all bodies [Atkeson1986].

    Its columns are those of the bodies in the order of `body_names`, ten each: m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz,
    I_yz, I_zz, about the origin of the joint's frame and in its axes. Gravity is the model's. With contacts, their unknown
    forces are eliminated: the equations are multiplied by a basis P of the null space of J.

    Args:
        state: The robot at (q, v).
        a: Acceleration, shape (nv,).
        contacts: Constraints whose forces are not known.
        columns: What is a parameter: "inertia", "rotor_inertia" (about the joint, times a_i), "damping" (times v_i) and
            "dry_friction" (times the sign of v_i); the last three have a column for each joint velocity but those of a base.

    Returns:
        Y with names, the model's values and P. Y has less than full column rank: `rbd.motion.identification.base_parameters`
        finds the combinations that can be known.

    Raises:
        InputError: wrong sizes, not finite; unknown columns.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, a = solo.standing(), np.zeros(solo.nv)
        >>> free = rbd.dynamics.regressor(state, a)
        >>> on_feet = rbd.dynamics.regressor(state, a, solo.feet())
        >>> free.Y.shape, on_feet.Y.shape, free.names[:3]
        ((18, 130), (6, 130), ('base_link.m', 'base_link.mc_x', 'base_link.mc_y'))
        >>> bool(np.allclose(on_feet.Y @ on_feet.theta, on_feet.P @ rbd.dynamics.inverse_dynamics(state, a)))
        True
    """
    robot = checked(state).robot
    asked = checked_columns(columns)
    Y, known = columns_at(state, robot.check_v(a, "a"), asked)
    P = np.eye(robot.nv) if isinstance(contacts, Sequence) and not len(contacts) else free_of_forces(state, contacts)
    return Regressor(
        P @ Y, parameter_names(robot, asked), parameter_values(robot, asked, inertial_parameters(robot)), P @ known, P
    )


def columns_at(state: State, a: Array, columns: Sequence[str]) -> tuple[Array, Array]:
    """(Y, known) of `regressor` without contacts, names and checks, shapes (nv, p) and (nv,)."""
    robot = state.robot
    driven = joint_velocities(robot)
    own = np.eye(robot.nv)[:, driven]
    rotors = np.array(robot.model.armature, float) * a
    factors = {"rotor_inertia": a, "damping": state.v, "dry_friction": np.sign(state.v)}
    parts = [inertia_columns(state, a) if column == "inertia" else own * factors[column][driven] for column in columns]
    known = np.zeros(robot.nv)
    if "inertia" not in columns:
        known = state.M @ a + state.h - rotors
    if "rotor_inertia" not in columns:
        known = known + rotors
    return np.hstack(parts), known


def inertia_columns(state: State, a: Array) -> Array:
    """The columns of the bodies' inertia, shape (nv, 10 bodies)."""
    robot, q, v = state.robot, state.q, state.v
    found = robot.pool.compute(lambda data: np.array(pin.computeJointTorqueRegressor(robot.model, data, q, v, a)))
    return found.reshape(robot.nv, -1)


def checked_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Names of groups of columns, in the order of `COLUMNS`.

    Raises:
        InputError: unknown ones, with the nearest names, or none.
    """
    given = (columns,) if isinstance(columns, str) else columns
    if not isinstance(given, Sequence) or not len(given):
        raise InputError(f"columns is {columns!r:.80}; expected names out of {', '.join(COLUMNS)}.")
    for name in given:
        check_choice("a group of columns", name, COLUMNS)
    return tuple(name for name in COLUMNS if name in given)


def parameter_names(robot: CheckedModel, columns: Sequence[str] = ("inertia",)) -> tuple[str, ...]:
    """Names of the parameters of a regressor: "pelvis.m", ..., "knee.damping"."""
    velocities = [robot.joints.velocities[i].name for i in joint_velocities(robot)]
    own = {"inertia": [f"{b}.{x}" for b in body_names(robot) for x in PARAMETERS]}
    return tuple(name for column in columns for name in own.get(column, [f"{v}.{column}" for v in velocities]))


def parameter_values(robot: CheckedModel, columns: Sequence[str], bodies: Array) -> Array:
    """The model's parameters in the order of `parameter_names`: the bodies' (k, 10), rotors as in M, zeros of friction."""
    driven = joint_velocities(robot)
    own = {"inertia": bodies.ravel(), "rotor_inertia": np.array(robot.model.armature, float)[driven]}
    return np.concatenate([own.get(column, np.zeros(len(driven))) for column in columns])


def joint_velocities(robot: CheckedModel) -> Array:
    """Indices in v of all joints but floating bases, which have no rotor, no damping and no friction."""
    own = [range(joint.v.start, joint.v.stop) for joint in robot.joints.values() if joint.kind != "FreeFlyer"]
    return np.concatenate([np.zeros(0, int), *own])


def free_of_forces(state: State, contacts: Sequence[HasRows]) -> Array:
    """Combinations of the equations of motion without the forces of some constraints, shape (k, nv), with orthonormal rows."""
    check_kind("contacts", contacts, Sequence, "a list of contacts, e.g. robot.soles()")
    rows = [np.asarray(check_rows(contact).rows(state).J) for contact in contacts]
    return null_space(np.concatenate([np.zeros((0, state.robot.nv)), *rows])).T


def check_rows(constraint: HasRows) -> HasRows:
    """What gives rows.

    Raises:
        InputError: it has no method `rows`, or is a class.
    """
    if not callable(getattr(constraint, "rows", None)) or isinstance(constraint, type):
        raise InputError(f"{constraint!r:.80} is no constraint: it has no rows(state). Give a contact, e.g. robot.soles()[0].")
    return constraint
