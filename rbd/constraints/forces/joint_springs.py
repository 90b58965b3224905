"""Springs and dampers in joints: torques that the joints' positions and velocities determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, locked
from rbd.constraints.constraint import PerRobot
from rbd.constraints.forces.coordinates import WIDEST, from_rest, inverse_left_jacobian, rotation_vector, too_far
from rbd.constraints.forces.element import ElementPicture, check_parameter
from rbd.constraints.forces.element_numbers import ByValue, damping_of, kept_as_data, number, stiffness_of
from rbd.constraints.surface import check_words
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.joints import Joint
from rbd.model.state import State


@kept_as_data
@dataclass(frozen=True, eq=False)
class JointSpring(ByValue, Displayed):
    """A spring in a joint: tau = preload - stiffness (q - rest). It goes where `external` goes.

    In a joint with one degree of freedom it is linear, and counts turns where the joint does; of a continuous joint, whose
    angle is (cos, sin), q - rest is taken within 170 degrees. In a ball joint `rest` is a unit quaternion and the torque,
    -stiffness times the rotation vector from it, has the same size about every axis. Springs between bodies that are
    not neighbours, and those of floating and planar bases, are `rbd.Spring` and `rbd.Bushing`.

    Args:
        joint: The joint.
        stiffness: k [N m/rad, N/m]; a negative one is taken with a warning.
        rest: q_0, where the torque is the preload [rad, m]; of a ball joint a quaternion (x, y, z, w), by default one.
        preload: Torque at q_0 [N m, N]; none in a ball joint.
        name: By default made of the joint's.

    Raises:
        InputError: numbers that are not finite. At a state: a joint with another number of degrees of freedom, an angle of
            more than 170 degrees of a ball joint or a continuous one.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> spring = rbd.JointSpring(arm.actuated_names[0], stiffness=20.0)
        >>> spring.generalised(arm.at([0.1]))[0], round(spring.energy(arm.at([0.1])), 12)
        (array([-2.]), 0.1)
    """

    joint: str
    stiffness: float = field(kw_only=True)
    rest: float | Sequence[float] | Array = field(default=0.0, kw_only=True)
    preload: float = field(default=0.0, kw_only=True)
    name: str = field(default=None, kw_only=True)  # type: ignore[assignment]  # made in __post_init__

    parameters = ("stiffness", "rest", "preload")

    def __post_init__(self) -> None:
        if not isinstance(self.joint, str):
            raise InputError(
                f"a joint spring is in {self.joint!r:.80}; expected the name of a joint, see robot.joints. Of several joints "
                "each has its own: [JointSpring(joint, stiffness=k) for joint, k in {'knee': 20.0}.items()]."
            )
        what = f"the spring in {self.joint!r:.80}"
        rest = as_finite(f"rest of {what}", self.rest, (), (4,), meaning=": a number, or the quaternion of a ball joint")
        if not np.abs(rest).max() <= FARTHEST:
            raise InputError(f"rest of {what} is {self.rest!r:.80}; expected finite numbers of at most {FARTHEST:g}.")
        if rest.shape and not abs(np.linalg.norm(rest) - 1.0) <= 1e-6:
            norm = f"{np.linalg.norm(rest):.6g}"
            raise InputError(f"rest of {what} is the quaternion {rest.tolist()!r:.80} of norm {norm}; expected norm 1.")
        self.__dict__.update(
            rest=rest / np.linalg.norm(rest) if rest.shape else float(rest),
            preload=number(f"preload of {what}", self.preload),
            stiffness=stiffness_of(what, self.stiffness),
            name=f"spring in {self.joint}" if self.name is None else self.name,
        )
        check_words(what, name=self.name)

    def check_on(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joint, or one whose joint cannot have such a spring.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint of another kind, or a rest that is not one of its kind.
        """
        self._joint(robot)

    def _joint(self, robot: CheckedModel) -> Joint:
        joint, ball = robot.joints[self.joint], not isinstance(self.rest, float)
        if joint.nv == 1:
            if ball:
                raise InputError(f"rest of {self.name!r:.80} is a quaternion, and the joint has one degree of freedom.")
        elif [piece.kind for piece in joint.pieces] == ["sphere"]:
            if self.preload or not (ball or self.rest == 0.0):
                raise InputError(
                    f"{self.name!r:.80} is in a ball joint; expected no preload, and a quaternion (x, y, z, w) as rest."
                )
        else:
            raise InputError(
                f"{self.name!r:.80}: joint {self.joint!r:.80} has {joint.nv} degrees of freedom ({joint.words}); a joint "
                "spring is in a joint with one, or in a ball joint. See rbd.Spring and rbd.Bushing."
            )
        return joint

    def _stretch(self, state: State) -> tuple[Joint, Array]:
        """(the joint, q - rest): shape (1,), of a ball joint the rotation vector (3,)."""
        joint, what = self._joint(state.robot), repr(self.name)[:82]
        if joint.nv == 1:
            assert isinstance(self.rest, float)
            q = joint.coordinate(state.q)
            return joint, np.array([from_rest(q, self.rest, what) if joint.is_continuous else q - self.rest])
        R = pin.Quaternion(state.q[joint.q]).toRotationMatrix()
        rest = np.eye(3) if isinstance(self.rest, float) else pin.Quaternion(np.asarray(self.rest)).toRotationMatrix()
        vector, angle = rotation_vector(rest.T @ R)
        if not angle <= WIDEST:
            raise too_far(what, angle, "A rotation vector is known up to half a turn.")
        return joint, vector

    def force(self, state: State) -> Array:
        """The joint's torque [N m, N], shape (1,), of a ball joint (3,)."""
        _, stretch = self._stretch(state)
        return self.preload - self.stiffness * stretch  # of a ball joint the vector has the same entries in both bodies' axes

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench) at a state; the wrench is zero, as the torque is inside the robot."""
        tau = np.zeros(state.robot.nv)
        tau[self._joint(state.robot).v] = self.force(state)
        return tau, np.zeros(6)

    def derivatives(self, state: State) -> tuple[Array, Array]:
        """(dtau/dq on the tangent space, dtau/dv), shapes (nv, nv)."""
        joint, stretch = self._stretch(state)
        by_q = np.zeros((state.robot.nv, state.robot.nv))
        # The tangent space is the moving body's; of its angular velocity the inverse left Jacobian of -x gives the rate of x.
        by_q[joint.v, joint.v] = -self.stiffness * (np.eye(1) if joint.nv == 1 else inverse_left_jacobian(-stretch))
        return by_q, np.zeros_like(by_q)

    def energy(self, state: State) -> float:
        """1/2 k (q - q_0)^2 - preload (q - q_0) [J]."""
        _, x = self._stretch(state)
        return float(0.5 * self.stiffness * x @ x - self.preload * x.sum())

    def dissipation(self, state: State) -> float:
        """Zero."""
        return 0.0

    def parameter_force(self, state: State, parameter: str) -> Array:
        """Derivative of tau by one of its `parameters`, shape (nv,); `rest` of a ball joint is refused."""
        check_parameter(self.name, parameter, self.parameters)
        joint, stretch = self._stretch(state)
        if joint.nv != 1 and parameter != "stiffness":
            raise InputError(f"{self.name!r:.80} is in a ball joint, where its torque has a derivative by stiffness alone.")
        out = np.zeros(state.robot.nv)
        out[joint.v] = -stretch if parameter == "stiffness" else self.stiffness if parameter == "rest" else 1.0
        return out

    def picture(self, state: State) -> ElementPicture:
        """The joint's place, axis and torque at a state, for drawings."""
        return _picture("joint spring", self._joint(state.robot), state, self.force(state))


@kept_as_data
@dataclass(frozen=True, eq=False, init=False)
class JointDamping(ByValue, Displayed):
    """Viscous damping in joints: tau = -d v. It goes where `external` goes; `robot.joint_damping()` is that of its file.

    Args:
        joint: The joint, with its `damping`; or {joint: damping} of several.
        damping: d [N m s/rad, N s/m], which holds for all velocities of a joint with several. A name may also be that of
            one velocity, as in `robot.joints.velocities`.
        name: For messages and records.

    Raises:
        InputError: negative damping, or a number that is not finite.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> damping = rbd.JointDamping({"joint_1": 0.5})
        >>> damping.generalised(arm.at([0.0], [2.0]))[0], damping.dissipation(arm.at([0.0], [2.0]))
        (array([-1.]), 2.0)
    """

    damping: Mapping[str, float]
    name: str

    parameters = ("damping",)

    def __init__(
        self,
        joint: str | Mapping[str, float] | None = None,
        damping: float | Mapping[str, float] | None = None,
        name: str = "joint_damping",
    ) -> None:
        given: Any = {joint: damping} if isinstance(joint, str) else damping if joint is None else joint
        if not isinstance(given, Mapping) or (joint is given and damping is not None):
            raise InputError(
                f"damping is {given!r:.80}; expected a joint and its damping, JointDamping('knee', damping=0.5), or {{joint: "
                "number}, e.g. {'knee': 0.5, 'hip': 0.8}."
            )
        check_words("joint damping", name=name)
        found = {each: damping_of(f"joint {each!r:.80}", d) for each, d in given.items()}
        self.__dict__.update(damping=MappingProxyType(found), name=name, _diagonal=PerRobot(_diagonal))

    def __reduce__(self) -> tuple[object, ...]:
        return JointDamping, (dict(self.damping), None, self.name)

    def check_on(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joints.

        Raises:
            JointNotFound: with the nearest names.
        """
        self.diagonal(robot)

    def diagonal(self, robot: CheckedModel) -> Array:
        """Damping of each velocity, shape (nv,), read-only; that of a name given twice, by joint and by velocity, adds up.

        Raises:
            JointNotFound: with the nearest names.
        """
        return self.__dict__["_diagonal"].of(self, robot)

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench) at a state; the wrench is zero."""
        return -self.diagonal(state.robot) * state.v, np.zeros(6)

    def derivatives(self, state: State) -> tuple[Array, Array]:
        """(dtau/dq, dtau/dv), shapes (nv, nv)."""
        d = self.diagonal(state.robot)
        return np.zeros((len(d), len(d))), -np.diag(d)

    def energy(self, state: State) -> float:
        """Zero."""
        return 0.0

    def dissipation(self, state: State) -> float:
        """v^T d v [W]."""
        return float(state.v @ (self.diagonal(state.robot) * state.v))

    def parameter_force(self, state: State, parameter: str) -> dict[str, Array]:
        """Derivatives of tau by the damping of each joint, {joint: (nv,)}."""
        check_parameter(self.name, parameter, self.parameters)
        out = {joint: np.zeros(state.robot.nv) for joint in self.damping}
        for joint, tau in out.items():
            at = state.robot.joints.velocity(joint)
            tau[at] = -state.v[at]
        return out


def _diagonal(element: JointDamping, robot: CheckedModel) -> Array:
    d = np.zeros(robot.nv)
    for joint, value in element.damping.items():
        d[robot.joints.velocity(joint)] += value
    return locked(d)


def _picture(kind: str, joint: Joint, state: State, force: Array) -> ElementPicture:
    _, p, J = state.joint_motion([joint.id])
    axis = None
    if joint.nv == 1:  # of a sliding joint the column's linear part, of a turning one and of a screw the angular one
        column = J[:6, joint.v.start]
        axis = column[3:] if column[3:].any() else column[:3]
    return ElementPicture(kind, np.concatenate([p, p]), axis, float(force[0]) if joint.nv == 1 else None)
