"""Constraints on joints: limits, locks, couplings, dry friction; and those that a robot's file states.

A joint's coordinate is its angle [rad] or its displacement [m]; the row force is a torque [N m] or a force [N] along that
coordinate, as a motor's would be. Damping is not a constraint: give it as an external force -d v.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rbd.arrays import Array, as_finite, as_float, check_number, locked
from rbd.constraints.constraint import PerRobot
from rbd.constraints.contact_points import Group, Measured, Structure
from rbd.constraints.surface import check_state, check_words
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.input_files import read_xml
from rbd.model.joints import UNLIMITED, Joint
from rbd.model.state import State
from rbd.problem.cones import Bounds, Free, NonNegative
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

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        if self.position is not None:
            object.__setattr__(self, "position", _vector(self.name, "position", self.position))

    def anchored(self, state: State) -> JointLock:
        """The same lock at the joint's position at a state."""
        check_state(state, self.name)
        return JointLock(self.name, self.joint, position=state.q[state.robot.joints[self.joint].q])

    @property
    def prescribes(self) -> str:
        """The joint whose motion it gives."""
        return self.joint

    def rows(self, state: State) -> Rows:
        """One row a degree of freedom of the joint.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a position of the wrong size, or off the unit sphere.
        """
        check_state(state, self.name)
        joint = state.robot.joints[self.joint]
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
        robot.joints[self.joint]


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

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint, to=self.to)
        if self.joint == self.to:
            raise InputError(f"{self.name!r:.80} couples joint {self.joint!r:.80} to itself. Lock it with rbd.JointLock.")
        for what, value in (("ratio", self.ratio), ("offset", self.offset)):
            check_number(f"{what} of {self.name!r:.80}", value, -1e100, 1e100, expected="a finite number")

    def rows(self, state: State) -> Rows:
        """One bilateral row; see the class.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        check_state(state, self.name)
        one, other = self._joints(state.robot)
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
        self._joints(robot)

    def _joints(self, robot: CheckedModel) -> tuple[Joint, Joint]:
        return robot.joints.with_one_freedom(self.joint, self.name), robot.joints.with_one_freedom(self.to, self.name)

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
    _cone: Bounds = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        check_number(f"torque of {self.name!r:.80}", self.torque, 0.0, 1e100, expected="a finite number >= 0")
        bound = np.array([float(self.torque)])
        object.__setattr__(self, "_cone", Bounds(-bound, bound))

    def rows(self, state: State) -> Rows:
        """One row along the joint's coordinate.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        check_state(state, self.name)
        at = state.robot.joints.with_one_freedom(self.joint, self.name).v
        J = np.zeros((1, state.robot.nv))
        J[0, at] = 1.0
        return Rows(self.name, J, np.zeros(1), self._cone, state.v[at].copy())


def _vector(name: str, what: str, value: float | Sequence[float] | Array) -> Array:
    given = as_finite(f"{what} of {name!r:.80}", value, (), ("n",), meaning=": a number, or the joint's part of q")
    return locked(np.atleast_1d(given))


_SIDES = {(True, False): "lower", (False, True): "upper", (True, True): "both", (False, False): ""}


@dataclass(frozen=True, eq=False)
class JointLimit(Displayed):
    """A joint limit: at a bound it pushes the joint back, and never pulls.

    One row where the joint is at a bound or beyond it, none elsewhere (two where its range is as narrow as `margin`)::

        lower bound   y = +q'',  error = q - lower      the limit's torque on the joint is +f
        upper bound   y = -q'',  error = upper - q      the limit's torque on the joint is -f

    with f >= 0 in both: `solution.forces[name]` is its torque or force, `J^T f` the generalised force, which at an upper
    bound is negative. J_dot v is zero. The limit is rigid: a joint that moves into it needs an impact, and is refused.

    Attributes:
        name: The constraint's role, e.g. "left_knee_stop".
        joint: A joint with one degree of freedom that is not continuous.
        lower: Lower bound [rad] or [m]; by default that of the robot's file, -inf for none.
        upper: Upper bound [rad] or [m]; by default that of the robot's file, inf for none.
        margin: Distance within which the joint is at its bound [rad] or [m].

    Raises:
        InputError: bounds that are not numbers or are swapped, a negative margin.

    Example:
        >>> pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> stop = rbd.JointLimit("stop", "joint_1", lower=0.0)
        >>> solution = rbd.solve(pendulum.at([0.0]), [0.0], [stop])  # horizontal: the stop carries m g / 2
        >>> solution.a.round(3), solution.forces["stop"].round(3)
        (array([0.]), array([4.905]))
    """

    name: str
    joint: str
    lower: float | None = field(default=None, kw_only=True)
    upper: float | None = field(default=None, kw_only=True)
    margin: float = field(default=1e-6, kw_only=True)
    _stop: PerRobot[Stop] = field(default_factory=lambda: PerRobot(_stop), init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        for side in ("lower", "upper"):
            value = getattr(self, side)
            if value is not None and math.isnan(as_float(value)):
                raise InputError(f"{side} of {self.name!r:.80} is {value!r:.80}; expected a number, or None for the file's.")
        check_number(f"margin of {self.name!r:.80}", self.margin, 0.0, 1e100, expected="a finite number >= 0")
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise InputError(f"{self.name!r:.80} has its bounds swapped: lower is {self.lower:g}, upper is {self.upper:g}.")

    def bounds(self, robot: CheckedModel) -> tuple[float, float]:
        """(lower, upper) on this robot [rad] or [m]; infinite where there is none.

        Raises:
            JointNotFound: with the nearest names.
            InputError: the joint has several degrees of freedom, is continuous, or has no bound.
        """
        check_kind(f"the robot of {self.name!r:.80}", robot, CheckedModel, "a robot: rbd.load_robot(name)")
        stop = self._stop.of(self, robot)
        return stop.lower, stop.upper

    def side(self, state: State) -> str:
        """The bound at which the joint is: "lower", "upper", "both", or "" for none."""
        check_state(state, self.name)
        stop = self._stop.of(self, state.robot)
        q = state.q[stop.q]
        return _SIDES[bool(q - stop.lower <= self.margin), bool(stop.upper - q <= self.margin)]

    def rows(self, state: State) -> Rows:
        """One row at a bound, else none; see the class.

        Raises:
            JointNotFound: with the nearest names.
            InputError: as `bounds`.
        """
        check_state(state, self.name)
        stop = self._stop.of(self, state.robot)
        q = float(state.q[stop.q])
        distances = q - stop.lower, stop.upper - q
        if min(distances) > self.margin:
            return stop.nothing
        signs = [s for s, distance in zip((1.0, -1.0), distances, strict=True) if distance <= self.margin]
        m, at = len(signs), stop.v
        J = np.zeros((m, state.robot.nv))
        J[:, at] = signs
        error = np.array([d for d in distances if d <= self.margin])
        return Rows(self.name, J, np.zeros(m), NonNegative(m), J[:, at] * state.v[at], error)

    def stop(self, robot: CheckedModel) -> Stop:
        """Its indices and bounds on a robot; errors as `bounds`."""
        return self._stop.of(self, robot)

    def source(self, start: State) -> Stops:
        """Its bounds as points of a motion, at any distance."""
        return Stops([self], start)


@dataclass(frozen=True, eq=False)
class Stop:
    """A limit on a robot: the joint's indices in q and v, its bounds, and its rows away from them."""

    q: int
    v: int
    lower: float
    upper: float
    nothing: Rows


def _stop(limit: JointLimit, robot: CheckedModel) -> Stop:
    name, joint = limit.name, limit.joint
    found = robot.joints.with_one_freedom(joint, name)
    if found.is_continuous:
        raise InputError(
            f"{name!r:.80}: joint {joint!r:.80} is continuous, so it has no bound. "
            "Lock it with rbd.JointLock, or state its limits in the robot's file."
        )
    low = found.lower if limit.lower is None else float(limit.lower)
    high = found.upper if limit.upper is None else float(limit.upper)
    low, high = (-math.inf if low < -UNLIMITED else low), (math.inf if high > UNLIMITED else high)
    if low == -math.inf and high == math.inf:
        raise InputError(
            f"{name!r:.80}: joint {joint!r:.80} of {robot.name} has no bound, neither in its file nor given. "
            "Give lower= or upper=."
        )
    if low > high:
        raise InputError(f"{name!r:.80}: joint {joint!r:.80} has lower bound {low:g} above its upper one, {high:g}.")
    return Stop(
        found.q.start, found.v.start, low, high, Rows(name, locked(np.zeros((0, robot.nv))), np.zeros(0), NonNegative(0))
    )


class Stops:
    """Joint limits as points of a motion: one row a bound, computed together."""

    def __init__(self, limits: Sequence[JointLimit], start: State) -> None:
        self.limits, robot = tuple(limits), start.robot
        sides = [(limit, i) for limit in limits for i in (0, 1) if math.isfinite(limit.bounds(robot)[i])]
        places = [limit._stop.of(limit, robot) for limit, _ in sides]
        k = len(sides)
        self.q, self.v = np.array([p.q for p in places], int), np.array([p.v for p in places], int)
        self.sign = np.array([-1.0 if i else 1.0 for _, i in sides])
        self.bound = np.array([p.upper if i else p.lower for p, (_, i) in zip(places, sides, strict=True)])
        self.J = np.zeros((k, robot.nv))
        self.J[np.arange(k), self.v] = self.sign
        owners, which = tuple(limit.name for limit, _ in sides), tuple(i for _, i in sides)
        self.structure = Structure(owners, which, (NonNegative(1),) * k)
        self.nothing = np.zeros(k)

    @classmethod
    def joined(cls, sources: Sequence[Stops], start: State) -> Stops:
        """Several sources as one."""
        return cls([limit for source in sources for limit in source.limits], start)

    @property
    def group(self) -> Group:
        """All joint limits are computed together."""
        return Stops.joined, ()

    def at(self, state: State, t: float) -> Measured:
        """The points, whose gaps are the distances to all bounds."""
        gap = self.gaps(state, t)
        return Measured(self.structure, self.J, self.sign * state.v[self.v], self.nothing, gap, self.nothing)

    def gaps(self, state: State, t: float) -> Array:
        """Distances to all bounds."""
        return self.sign * (state.q[self.q] - self.bound)


def joint_limits(robot: CheckedModel, *, margin: float = 1e-6) -> list[JointLimit]:
    """Limits of every joint with one degree of freedom and a bound, named "<joint>_limit"; most are inactive at a time.

    One constraint a joint, for both bounds. Continuous joints, and those with several DOF (a floating base),
    have none.

    Args:
        robot: The robot.
        margin: Distance within which a joint is at its bound [rad] or [m].

    Raises:
        InputError: not a robot, or a negative margin.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> limits = rbd.constraints.joint_limits(solo)
        >>> len(limits), limits[0].name, limits[0].bounds(solo)
        (12, 'FL_HAA_limit', (-10.0, 10.0))
    """
    limited = [j for j in _checked(robot).joints.values() if min(-j.lower, j.upper) < math.inf]
    return [JointLimit(f"{joint.name}_limit", joint.name, margin=margin) for joint in limited]


def joint_frictions(robot: CheckedModel) -> list[JointFriction]:
    """Dry friction of every joint with one degree of freedom for which the file states it, named "<joint>_friction".

    `friction` of a URDF's <dynamics>, `frictionloss` of an MJCF's joint. Damping is not included.

    Args:
        robot: The robot.

    Raises:
        InputError: not a robot.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> frictions = rbd.constraints.joint_frictions(talos)
        >>> print(len(frictions), frictions[0])
        20 JointFriction(name='torso_1_joint_friction', joint='torso_1_joint', torque=1.0)
    """
    rough = [joint for joint in _checked(robot).joints.values() if joint.friction > 0.0]
    return [JointFriction(f"{joint.name}_friction", joint.name, joint.friction) for joint in rough]


def mimics(robot: Any) -> list[JointCoupling]:
    """Couplings by a URDF's <mimic> tags, named "<joint>_mimic": q_joint = multiplier q_other + offset.

    The loader leaves every joint free, with a separate motor; these rows couple them. Joints that do not move, or that
    mimic one that does not, are left out.

    Args:
        robot: Of `rbd.load_robot`: its file is read again.

    Raises:
        InputError: a robot without a URDF file.
        ModelError: a file that has changed since.

    Example:
        >>> panda = rbd.load_robot("panda", root="fixed")
        >>> [(each.joint, each.to, each.ratio) for each in rbd.constraints.mimics(panda)]
        [('panda_finger_joint2', 'panda_finger_joint1', 1.0)]
    """
    path = getattr(_checked(robot), "urdf", None)
    if not isinstance(path, Path):
        raise InputError(f"{robot.name} has no file to read mimics from; use rbd.load_robot, or give rbd.JointCoupling.")
    root = read_xml(path, robot.limits)
    if root.tag != "robot":
        raise InputError(
            f"{path.name} is an MJCF file, and mimics are read from a URDF's <mimic> tags. "
            "Give rbd.JointCoupling(name, joint, to, ratio=...)."
        )
    return [coupling for joint in root.findall("joint") for coupling in _coupling(robot, joint)]


def _coupling(robot: CheckedModel, joint: ElementTree.Element) -> list[JointCoupling]:
    mimic, name = joint.find("mimic"), joint.get("name", "")
    if mimic is None:
        return []
    to, known = mimic.get("joint", ""), robot.joints
    if not all(n in known and known[n].nv == 1 for n in (name, to)):
        return []
    ratio, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0")))
    return [JointCoupling(f"{name}_mimic", name, to, ratio=ratio, offset=offset)]


def _checked(robot: CheckedModel) -> CheckedModel:
    check_kind("the robot", robot, CheckedModel, "a robot: rbd.load_robot(name)")
    return robot
