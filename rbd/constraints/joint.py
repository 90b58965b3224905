"""Constraints on joints: locks, couplings, dry friction; limits are in `rbd.constraints.joint_limit`.

A joint's coordinate is its angle [rad] or its displacement [m]; the row force is a torque [N m] or a force [N] along that
coordinate, as a motor's would be. Damping is not a constraint: give it as an external force -d v.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_array, check_finite
from rbd.constraints.constraint import PerRobot
from rbd.constraints.surface import check_number, check_state, check_words
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import Joint
from rbd.model.state import State
from rbd.problem.cones import Box, Free
from rbd.problem.rows import Rows


@dataclass(frozen=True, eq=False)
class JointLock(Displayed):
    """A locked joint: a brake, a pin, a joint that does not take part in the motion.

    Bilateral rows, one a degree of freedom of the joint (a floating base has six). Without `position` it is locked in place:
    y is its acceleration, and there is no error. With it the error is the joint's displacement from there, and y = error''::

        one DOF             error = q - position                                   (an angle of a continuous joint: wrapped)
        position in space   error = R_l^T (p - p_l),        J = R_l^T R            (l: the lock's)
        orientation         error = 2 x of R_l^T R,         J = s 1 + [x]          bias = -|w|^2 / 4 error

    (x, s) the quaternion of R_l^T R with s >= 0: the error's length is 2 sin(angle / 2), the rotation's angle to third
    order, and J is singular at 180 deg. Row forces are in the lock's axes. At the lock's position J is the identity.

    Attributes:
        name: The constraint's role, e.g. "elbow_brake".
        joint: Any joint.
        position: Locked position: an angle [rad] or displacement [m]; of joints with several degrees of freedom the part of q,
            shape (nq of the joint,), quaternions x, y, z, w. It moves nothing by itself: `Baumgarte` pulls towards it.

    Raises:
        InputError: a position with numbers that are not finite.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> brake = rbd.JointLock("brake", "FL_KFE")
        >>> solution = rbd.solve(solo.standing(), np.zeros(solo.nu), [*solo.feet(), brake])
        >>> print(abs(solution.accelerations["brake"][0]) < 1e-9, solution.forces["brake"].round(3))
        True [0.585]
    """

    name: str
    joint: str
    position: float | Sequence[float] | Array | None = field(default=None, kw_only=True)
    _joint: PerRobot[Joint] = field(default_factory=lambda: PerRobot(_any_joint), init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        if self.position is not None:
            object.__setattr__(self, "position", _vector(self.name, "position", self.position))

    def anchored(self, state: State) -> JointLock:
        """The same lock at the joint's position at a state."""
        check_state(state, self.name)
        return JointLock(self.name, self.joint, position=state.q[state.robot.joints[self.joint].q])

    def rows(self, state: State) -> Rows:
        """One row a degree of freedom of the joint.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a position of the wrong size, or off the unit sphere.
        """
        check_state(state, self.name)
        joint = self._joint.of(self, state.robot)
        span = joint.v
        J, bias, error, turns = np.zeros((joint.nv, state.robot.nv)), np.zeros(joint.nv), None, None
        if self.position is None:
            J[:, span] = np.eye(joint.nv)
        else:
            target = joint.target(self.name, np.asarray(self.position))
            error, J[:, span], bias = joint.difference(target, state.q, state.v)
            turns = joint.period
        return Rows(self.name, J, bias, Free(joint.nv), J[:, span] @ state.v[span], error, period=turns)

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joint.

        Raises:
            JointNotFound: with the nearest names.
        """
        self._joint.of(self, robot)


@dataclass(frozen=True, eq=False)
class JointCoupling(Displayed):
    """Linear coupling of two joints, e.g. by a gear: q_joint = ratio q_to + offset.

    One bilateral row: `y = q_joint'' - ratio q_to''`, J_dot v = 0, error = q_joint - ratio q_to - offset. Its force f is
    the torque on `joint`; -ratio f acts on `to`. The angle of a continuous joint is known up to turns, and so is the
    error: the nearest value is used; where both joints are continuous and neither ratio nor 1 / ratio is whole, there is none.

    Attributes:
        name: The constraint's role, e.g. "finger_gear".
        joint: The driven joint, with one degree of freedom.
        to: The driving joint, with one degree of freedom.
        ratio: Turns of `joint` for one of `to`; -1 for two equal gears that mesh.
        offset: q_joint where q_to is zero [rad] or [m].

    Raises:
        InputError: a ratio or offset that is not finite; a joint coupled to itself.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> gear = rbd.JointCoupling("gear", "rocker_joint", "crank_joint", ratio=-2.0)
        >>> gear.rows(robot.at("assembled")).J  # of the crank, the coupler, the rocker
        array([[2., 0., 1.]])
    """

    name: str
    joint: str
    to: str
    ratio: float = field(kw_only=True)
    offset: float = field(default=0.0, kw_only=True)
    _joints: PerRobot[tuple[Joint, Joint]] = field(default_factory=lambda: PerRobot(_both_joints), init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint, to=self.to)
        if self.joint == self.to:
            raise InputError(f"{self.name!r:.80} couples joint {self.joint!r:.80} to itself. Lock it with rbd.JointLock.")
        check_number(self.name, "ratio", self.ratio)
        check_number(self.name, "offset", self.offset)

    def rows(self, state: State) -> Rows:
        """One bilateral row; see the class.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        check_state(state, self.name)
        one, other = self._joints.of(self, state.robot)
        J = np.zeros((1, state.robot.nv))
        J[0, one.v], J[0, other.v] = 1.0, -self.ratio
        missed = one.coordinate(state.q) - self.ratio * other.coordinate(state.q) - self.offset
        period = self._period(turns=one.is_continuous, to_turns=other.is_continuous)
        if period > 0.0:
            missed = math.remainder(missed, period)
        error = None if math.isnan(period) else np.array([missed])
        turns = np.array([period]) if period > 0.0 else None
        return Rows(self.name, J, np.zeros(1), Free(1), J @ state.v, error, period=turns)

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without these joints, or on which they have several degrees of freedom.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        self._joints.of(self, robot)

    def _period(self, *, turns: bool, to_turns: bool) -> float:
        """Period up to which the error is known: 0 if exactly, NaN if not at all."""
        one, other = 2.0 * math.pi * turns, 2.0 * math.pi * abs(self.ratio) * to_turns
        if not one or not other:
            return one + other
        small, large = sorted((one, other))
        return small if abs(math.remainder(large, small)) < 1e-9 * small else math.nan


@dataclass(frozen=True, eq=False)
class JointFriction(Displayed):
    """Dry friction in a joint: at most `torque` at rest, `torque` against the motion when it moves.

    Its force f::

        at rest (|v| <= 1e-6)   |f| <= torque; f = -torque where the joint starts in the positive direction, and so on
        moving                  f = -torque sign(v)

    One row `y = q''`; its force f is in the interval [-torque, torque]. No viscous damping, no dependence on load.

    Attributes:
        name: The constraint's role, e.g. "knee_friction".
        joint: A joint with one degree of freedom.
        torque: Largest friction torque [N m], or force [N] of a prismatic joint; zero or more.

    Raises:
        InputError: a torque that is negative or not finite.

    Example:
        >>> pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> dry = rbd.JointFriction("dry", "joint_1", torque=2.0)
        >>> solution = rbd.solve(pendulum.at([0.0]), [0.0], [dry])  # horizontal: gravity's torque is m g / 2
        >>> solution.a.round(3), solution.forces["dry"].round(3)
        (array([-8.715]), array([2.]))
    """

    name: str
    joint: str
    torque: float
    _joint: PerRobot[Joint] = field(default_factory=lambda: PerRobot(_one_joint), init=False, repr=False)
    _cone: Box = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        check_number(self.name, "torque", self.torque, least=0.0)
        bound = np.array([float(self.torque)])
        object.__setattr__(self, "_cone", Box(-bound, bound))

    def rows(self, state: State) -> Rows:
        """One row along the joint's coordinate.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        check_state(state, self.name)
        at = self._joint.of(self, state.robot).v
        J = np.zeros((1, state.robot.nv))
        J[0, at] = 1.0
        return Rows(self.name, J, np.zeros(1), self._cone, state.v[at].copy())


def _any_joint(lock: JointLock, robot: CheckedModel) -> Joint:
    return robot.joints[lock.joint]


def _one_joint(friction: JointFriction, robot: CheckedModel) -> Joint:
    return robot.joints.with_one_freedom(friction.joint, friction.name)


def _both_joints(gear: JointCoupling, robot: CheckedModel) -> tuple[Joint, Joint]:
    return robot.joints.with_one_freedom(gear.joint, gear.name), robot.joints.with_one_freedom(gear.to, gear.name)


def _vector(name: str, what: str, value: float | Sequence[float] | Array) -> Array:
    out = np.atleast_1d(as_array(f"{what} of {name!r:.80}", value))
    if out.ndim != 1:
        raise InputError(f"{what} of {name!r:.80} has shape {out.shape}; expected a number, or the joint's part of q.")
    check_finite(f"{what} of {name!r:.80}", out)
    out.flags.writeable = False
    return out
