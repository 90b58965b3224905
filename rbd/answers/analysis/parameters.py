"""Derivatives of an answer by parameters of robot, contacts and springs, by the same equations as those by q and v.

With the contact modes fixed (`rbd.answers.analysis.active_set`), a parameter p changes the answer as the generalised force does
that it adds at fixed a and f:

    friction        f_t = -mu f_n t of what slips or slides, so df_t/dmu = -f_n t; the convex law's y_n = mu |y_t| besides
    mass            -Y_b theta_b / m_b: all ten inertial parameters of body b grow with its mass, as of a uniform density
    inertia         -Y, the regressor's column of one inertial parameter, the others fixed
    rotor_inertia   -a_i e_i
    gravity         m J_com^T
    stiffness, damping, rest, preload      dtau/dp of the force element

Y is `rbd.dynamics.regressor`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.answers.analysis.active_set import ActiveSet, HeldRows
from rbd.arrays import Array, as_array, largest_first
from rbd.displayed import Displayed
from rbd.errors import InputError, UnknownName, nearest
from rbd.errors.inputs import check_kind, check_known
from rbd.model.external import External, elements_of
from rbd.model.inertial import body_names, inertia_columns, inertial_parameters, joint_velocities, parameter_names
from rbd.model.state import State
from rbd.problem.answer import Answer

OF_ELEMENTS = ("stiffness", "damping", "rest", "preload")
"""Parameters of force elements."""
PARAMETERS = ("friction", "mass", "inertia", "rotor_inertia", "gravity", *OF_ELEMENTS)
"""What an answer can be differentiated by."""


@dataclass(frozen=True, eq=False, repr=False)
class ParameterDerivatives(Displayed):
    """Derivatives of an answer by one kind of parameter: a column a label; contact modes are fixed, and so are q, v and tau.

    - "friction": each constraint with friction, by its coefficient. Zero where all its points stick.
    - "mass": each body that has one, by its mass [kg], at fixed centre of mass and fixed radii of gyration: all ten inertial
      parameters grow in proportion, as of a uniform density. A body is all that moves with a joint, and has the name of its
      first link.
    - "inertia": each of the ten inertial parameters of each body alone, "pelvis.m", "pelvis.mc_x", ..., see
      `rbd.dynamics.regressor`. "pelvis.m" is a point mass at the origin of its joint.
    - "rotor_inertia": each joint velocity [kg m2, kg], at the joint.
    - "gravity": x, y and z of the acceleration of gravity in W [m/s2].
    - "stiffness", "damping", "rest", "preload": each spring or damper in `external`, in the units of it.

    Attributes:
        parameter: Its name.
        labels: What each column belongs to, n of them.
        da: Of the acceleration, shape (nv, n).
        df: Of the row forces `Solution.multipliers`, shape (m, n); None unless all of them are unique.
        forces: {constraint: of its force or wrench in world axes, shape (k, n)}, None where it is not unique.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> floor = rbd.PointContact("floor", "box", friction=0.5)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> found = rbd.solve(slides, [], [floor]).derivatives(parameters=["friction", "mass"]).parameters
        >>> found["friction"].of("floor")[:3].round(3)  # -g: it brakes with mu g
        array([-9.81,  0.  ,  0.  ])
        >>> found["mass"].forces["floor"][:, 0].round(3)  # (-mu g, 0, g)
        array([-4.905,  0.   ,  9.81 ])
    """

    parameter: str
    labels: tuple[str, ...]
    da: Array
    df: Array | None
    forces: dict[str, Array | None]

    def of(self, label: str) -> Array:
        """Derivative of the acceleration by the parameter of one label, shape (nv,).

        Raises:
            UnknownName: with the nearest labels.
        """
        return np.asarray(self.da[:, self._column(label)])

    def force_of(self, label: str, constraint: str) -> Array | None:
        """Derivative of a constraint's force in world axes by the parameter of one label, shape (k,); None: not unique.

        Raises:
            UnknownName: with the nearest names.
        """
        check_known("no constraint", constraint, self.forces)
        found, column = self.forces[constraint], self._column(label)
        return None if found is None else np.asarray(found[:, column])

    def _column(self, label: str) -> int:
        check_known(f"no {self.parameter} of", label, self.labels)
        return self.labels.index(label)

    def __str__(self) -> str:
        size = np.abs(self.da).max(axis=0, initial=0.0)
        most = [f"{self.labels[i]} ({size[i]:.3g})" for i in largest_first(size)[:3]]
        return f"by {self.parameter} of {len(self.labels)}; largest |da|: {', '.join(most) or 'none'}"


def checked_parameters(parameters: Sequence[str]) -> tuple[str, ...]:
    """Names of parameters, each once.

    Raises:
        InputError: not a sequence of names.
        UnknownName: with the nearest ones.
    """
    given = (parameters,) if isinstance(parameters, str) else parameters
    check_kind("parameters", given, Sequence, "names, e.g. ('friction', 'mass')")
    for name in given:
        if not isinstance(name, str) or name not in PARAMETERS:
            raise UnknownName(f"no parameter {name!r:.80}; {nearest(name, PARAMETERS)}. There are {', '.join(PARAMETERS)}.")
    return tuple(dict.fromkeys(given))


def by_parameter(
    name: str, state: State, external: External, answer: Answer, equations: HeldRows | ActiveSet, not_unique: Sequence[str]
) -> ParameterDerivatives:
    """Derivatives of an answer by one kind of parameter.

    Args:
        name: A member of `PARAMETERS`.
        state: The robot at (q, v).
        external: External forces.
        answer: The answer there.
        equations: Those of the answer, factorised.
        not_unique: Constraints whose forces are not unique.

    Raises:
        InputError: a parameter of springs, and there is none that has it.
        NotDifferentiable: how points that slip share the load is not unique, and decides it.
    """
    P = answer.problem
    if name == "friction":
        labels = tuple(r.name for r in P.rows if any(getattr(part, "mu", 0.0) for part in r.cone.generators()[1]))
        da, df = equations.by_friction(labels)
    else:
        columns = _added_forces(name, state, external, answer.a)
        labels = tuple(columns)
        force = np.column_stack([np.zeros((P.nv, 0)), *columns.values()])
        nothing = np.zeros((P.m, len(labels)))
        da, df = equations.derivative(force, nothing, nothing)
    forces: dict[str, Array | None] = {}
    for r in P.rows:
        part = df[P.slices[r.name]]
        forces[r.name] = None if r.name in not_unique else part.copy() if r.resultant is None else r.resultant @ part
    return ParameterDerivatives(name, labels, da, None if equations.internal.size else df, forces)


def _added_forces(name: str, state: State, external: External, a: Array) -> dict[str, Array]:
    """{label: generalised force that a unit of the parameter adds at fixed a and f, shape (nv,)}."""
    robot = state.robot
    if name in ("mass", "inertia"):
        columns = -inertia_columns(state, a)
        if name == "inertia":
            return dict(zip(parameter_names(robot), columns.T, strict=True))
        each = zip(body_names(robot), inertial_parameters(robot), np.hsplit(columns, columns.shape[1] // 10), strict=True)
        return {body: Y @ theta / theta[0] for body, theta, Y in each if theta[0]}
    if name == "rotor_inertia":
        own = np.eye(robot.nv)
        return {robot.joints.velocities[i].name: -a[i] * own[i] for i in joint_velocities(robot)}
    if name == "gravity":
        return dict(zip("xyz", state.centroidal()[0][:3], strict=True))
    out: dict[str, Array] = {}
    for element in elements_of(external):
        for label, force in _of_element(element, state, name).items():
            if label in out:
                raise InputError(f"two force elements are named {label!r:.80}; give each its own name.")
            out[label] = force
    if not out:
        names = [element.name for element in elements_of(external)]
        raise InputError(
            f"no {name} to differentiate by: external has {', '.join(names) or 'no springs or dampers'}. Give force elements "
            f"that have one, e.g. external=[rbd.JointSpring('knee', {name}=...)]."
        )
    return out


def _of_element(element: Any, state: State, parameter: str) -> dict[str, Array]:
    """{label: dtau/dparameter, shape (nv,)} of one element; empty where it has none."""
    if parameter not in getattr(element, "parameters", ()):
        return {}
    found = element.parameter_force(state, parameter)
    several = isinstance(found, Mapping)
    named = {f"{element.name}.{key}": value for key, value in found.items()} if several else {element.name: found}
    forces = {label: as_array(f"force by {parameter} of {label}", value) for label, value in named.items()}
    return {name: state.robot.check_v(force, f"the force by {parameter} of {name!r:.80}") for name, force in forces.items()}
