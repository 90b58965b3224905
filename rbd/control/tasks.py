"""Tasks of the centre of mass, of a frame and of a posture: each follows its target as a damped spring.

With e the target less where the robot is, k the gain and zeta the damping ratio, both, and `PostureTask`, want::

    e'' + 2 zeta sqrt(k) e' + k e = 0

so that with zeta = 1 an error decays as (1 + sqrt(k) t) exp(-sqrt(k) t). With the velocity and the acceleration of a
`Reference` the law holds for targets that move; without them these count as zero. Rows of cost zero are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_vector3, check_finite, lazy
from rbd.constraints.constraint import PerRobot
from rbd.control.task_terms import (
    Cost,
    FollowingTask,
    Reference,
    Target,
    TaskTerms,
    as_reference,
    check_near,
    checked_costs,
    checked_name,
    checked_rates,
    checked_vector,
    is_near,
    target_of,
)
from rbd.errors import InputError, JointNotFound, nearest
from rbd.errors.inputs import check_choice, check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.placement import rigid_placement
from rbd.model.state import State, checked

_WORLD = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False)
class ComTask(FollowingTask):
    """The centre of mass follows a point, in world axes.

    With k the gain and zeta the damping ratio, its error e = c* - c decays by e'' + 2 zeta sqrt(k) e' + k e = 0. Its rows are
    A = J_c, the Jacobian of the centre of mass.

    Attributes:
        target: Where it is wanted, shape (3,) [m], or a `State`: where it is there. Or a `Reference` with velocity and
            acceleration, or a function of t [s].
        cost: One of all axes, or one each, shape (3,), of (m/s2)^2.
        gain: k [1/s2].
        damping_ratio: zeta.
        name: Its name among the tasks.

    Raises:
        InputError: a target of another shape, negative or infinite costs, gains, damping ratios.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> lower = rbd.control.ComTask(state.com - [0.0, 0.0, 0.01], cost=1e4, gain=100.0)
        >>> motors = rbd.control.step(state, [lower], feet)
        >>> a = (state.centroidal()[0] @ motors.a)[:3] / solo.mass
        >>> print(a.round(3))  # 100 times 1 cm, downwards
        [0. 0. -1.]
    """

    target: Target
    _: KW_ONLY
    cost: Cost = 1.0
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = "com"

    def __post_init__(self) -> None:
        self._settle(cost=3)

    def _reference(self, target: Any, t: float | None) -> Reference:
        ref = as_reference(target)
        value = ref.value.com if isinstance(ref.value, State) else ref.value
        return Reference(checked_vector(value, 3, "", t, self.name), *checked_rates(ref, 3, t, self.name))

    def terms(self, state: State, t: float) -> TaskTerms:
        """Three rows at a state and a time [s]: the acceleration of the centre of mass; fewer where costs are zero.

        Raises:
            InputError: what a function gives as the target is no point.
        """
        ref, (k, d) = self._at(t), self._law
        A_g, bias, mass = checked(state).centroidal()
        J = A_g[:3] / mass
        wanted = ref.acceleration + k * (ref.value - state.com) + d * (ref.velocity - J @ state.v) - bias[:3] / mass
        return TaskTerms.unchecked(self.name, J, wanted, np.asarray(self.cost))


@dataclass(frozen=True, eq=False)
class FrameTask(FollowingTask):
    """A frame of the robot, or a point fixed to it, follows a pose, a position or an orientation.

    With k the gain and zeta the damping ratio, the position error e = p* - p decays by e'' + 2 zeta sqrt(k) e' + k e = 0. The
    error of the orientation is the rotation vector in world axes from R to R*, e = log(R* R^T). It obeys the same law exactly
    while the frame turns about an axis that is fixed, and to first order in general. For any angular velocities w, w*::

        d/dt (k/2 |e|^2 + 1/2 |w* - w|^2) = -2 zeta sqrt(k) |w* - w|^2

    so that this energy never grows [Bullo1995]; at half a turn the direction of the way back is not determined. A is the
    frame's Jacobian.

    Attributes:
        frame: Name of the frame.
        target: A pose, pin.SE3 or shape (4, 4); a position, shape (3,) [m], which leaves the orientation free; or an
            orientation R_WF, shape (3, 3), which leaves the position free; or a `State`: the pose that it has there. Or a
            `Reference` of one of them, with velocity and acceleration in world axes, of a pose shape (6,), linear then angular,
            of the others (3,); or a function of t [s].
        offset: The point that is to be at the target, in the frame's axes, from its origin [m].
        position_cost: One of all axes, or one each, shape (3,), of (m/s2)^2.
        orientation_cost: The same, of (rad/s2)^2.
        axes: Axes of the costs: "world", or "frame", those of the frame.
        gain: k [1/s2].
        damping_ratio: zeta.
        name: Its name among the tasks; the frame's if not given.

    Raises:
        InputError: a target that is none of these, negative or infinite costs, gains, damping ratios.
        FrameNotFound: the robot of a `State` that is the target has no such frame; of other targets, see `check`.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> state, soles = talos.standing(), talos.soles(friction=0.7)
        >>> place = state.frame("gripper_left_joint").X_WF.translation + [0.05, 0.0, 0.05]
        >>> hand = rbd.control.FrameTask("gripper_left_joint", place, gain=25.0, position_cost=1e4)
        >>> motors = rbd.control.step(state, [hand, rbd.control.PostureTask(state)], soles)
        >>> print((state.frame("gripper_left_joint").J[:3] @ motors.a).round(2))  # 25 times 5 cm, forwards and up
        [1.25 0. 1.25]
    """

    frame: str
    target: Target
    _: KW_ONLY
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)
    position_cost: Cost = 1.0
    orientation_cost: Cost = 1.0
    axes: str = "world"
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.frame, str) or not self.frame:
            raise InputError(f"frame of a task is {self.frame!r:.80}; expected the name of a frame. See robot.frames().")
        said = f"of task {checked_name(self.name, self.frame)!r:.80}"
        check_choice(f"axes {said}", self.axes, ("world", "frame"))
        object.__setattr__(self, "offset", as_vector3(f"offset {said}", self.offset))
        self._settle(self.frame, position_cost=3, orientation_cost=3)

    def _reference(self, target: Any, t: float | None) -> Reference:
        """With a `_Place` as its value, and rates of all six axes."""
        ref = as_reference(target)
        if isinstance(ref.value, _Place):
            return ref
        value = ref.value
        if isinstance(value, State):
            value = value.frame(self.frame, np.asarray(self.offset)).X_WF
        place = _place(self.name, value, t)
        m = 6 if place.R is not None and place.p is not None else 3
        rates = checked_rates(ref, m, t, self.name)
        if m == 3:
            rates = _of_six(rates[0], place.R is not None), _of_six(rates[1], place.R is not None)
        return Reference(place, *rates)

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without the frame.

        Raises:
            FrameNotFound: with the nearest names.
        """
        robot.site(self.frame)

    @lazy
    def _placement(self) -> pin.SE3:
        return pin.SE3(np.eye(3), np.asarray(self.offset))

    @lazy
    def _costs(self) -> dict[tuple[bool, bool], Array]:
        """{(position, orientation): costs of six rows}."""
        six = np.concatenate([np.asarray(self.position_cost), np.asarray(self.orientation_cost)])
        return {kind: six * np.repeat(kind, 3) for kind in ((True, True), (True, False), (False, True))}

    def terms(self, state: State, t: float) -> TaskTerms:
        """Rows at a state and a time [s]: the acceleration of the point, then the angular one, in the axes of the costs.

        Six rows; those of cost zero, and those that a position or an orientation leaves free, are left out.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: what a function gives as the target is none.
        """
        ref, (k, d) = self._at(t), self._law
        p, R = ref.value
        X, J, v, bias = checked(state).moving(self.frame, self._placement, _WORLD)
        e = np.zeros(6)
        if p is not None:
            e[:3] = p - X.translation
        if R is not None:
            e[3:] = pin.log3(R @ X.rotation.T)
        wanted = ref.acceleration + k * e + d * (ref.velocity - v) - bias
        if self.axes == "frame":
            back = X.rotation.T
            J = np.concatenate([back @ J[:3], back @ J[3:]])
            wanted = np.concatenate([back @ wanted[:3], back @ wanted[3:]])
        return TaskTerms.unchecked(self.name, J, wanted, self._costs[p is not None, R is not None])


class _Place(NamedTuple):
    """Where a frame is wanted: its position, shape (3,), its orientation, shape (3, 3); None where it is free."""

    p: Array | None
    R: Array | None


def _of_six(rate: Array, angular: bool) -> Array:
    out = np.zeros(6)
    out[3 * angular :][:3] = rate
    return out


def _place(name: str, value: Any, t: float | None) -> _Place:
    """A pose, a position or an orientation.

    Raises:
        InputError: none of them.
    """
    if isinstance(value, pin.SE3):
        p, R = value.translation.copy(), value.rotation.copy()
        if is_near(p) and _is_rotation(R):
            return _Place(p, R)
    said = target_of(name, t)
    found = as_array(said, value.homogeneous if isinstance(value, pin.SE3) else value)
    if found.shape == (4, 4):
        X = rigid_placement(said, found)
        check_near(said, p := X.translation.copy())
        return _Place(p, X.rotation.copy())
    check_near(said, found.ravel())
    if found.shape == (3, 3):
        if not _is_rotation(found):
            raise InputError(f"{said} is no rotation: R^T R is not 1 to 1e-6, or it reflects.")
        return _Place(None, found)
    if found.shape != (3,):
        raise InputError(
            f"{said} has shape {found.shape}; expected a pose, pin.SE3 or (4, 4), a position (3,), or an orientation (3, 3)."
        )
    return _Place(found, None)


def _is_rotation(R: Array) -> bool:
    """Whether R^T R is 1 to 1e-6, and R turns to the right."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return determinant > 0.0 and bool(np.abs(R.T @ R - np.eye(3)).max() <= 1e-6)


@dataclass(frozen=True, eq=False)
class PostureTask(FollowingTask):
    """The joints with motors follow a posture.

    With k the gain and zeta the damping ratio, the errors e of sliding joints and of hinges decay by
    e'' + 2 zeta sqrt(k) e' + k e = 0, of continuous hinges up to half a turn from the target; those of joints with several axes
    as the orientation of a `FrameTask`. A selects the joints.

    Attributes:
        target: The posture, q, shape (nq,), or a `State` with it; of a floating base and of passive joints it is not used. Or a
            `Reference` of one of them, with velocity and acceleration, shape (nv,) [rad/s or m/s]; or a function of t [s].
        joints: Names of the joints that follow it; None: all that have a motor.
        cost: One of all joints, one each in the order of `joints`, or {joint: cost}, 1 of the others, of (rad/s2 or m/s2)^2.
        gain: k [1/s2].
        damping_ratio: zeta.
        name: Its name among the tasks.

    Raises:
        InputError: a posture of another size, negative or infinite costs, gains, damping ratios.
        JointNotFound: a joint that is not there or has no motor; at construction if the target is a `State`.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> state, soles = talos.standing(), talos.soles(friction=0.7)
        >>> bent = state.with_joints({"arm_left_4_joint": -1.2})
        >>> arm = rbd.control.PostureTask(bent, gain=16.0, cost={"arm_left_4_joint": 1e4})
        >>> motors = rbd.control.step(state, [arm], soles)
        >>> elbow = talos.joints["arm_left_4_joint"]
        >>> print(motors.a[elbow.v].round(1), (16.0 * (bent.q - state.q)[elbow.q]).round(1))
        [-10.8] [-10.8]
    """

    target: Target
    _: KW_ONLY
    joints: Sequence[str] | None = None
    cost: Cost | Mapping[str, float] = 1.0
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = "posture"
    _on: PerRobot[_Posture] = field(default_factory=lambda: PerRobot(_posture), init=False, repr=False)

    def __post_init__(self) -> None:
        self._settle()
        object.__setattr__(self, "joints", _names(self.name, self.joints))
        object.__setattr__(self, "cost", _costs(self.name, self.cost))
        if not callable(self.target) and isinstance(self.target.value, State):
            self.check(self.target.value.robot)

    def _reference(self, target: Any, t: float | None) -> Reference:
        """Its arrays copied, so that nobody changes them; their sizes are checked when the robot is known."""
        ref = as_reference(target)
        return ref if t is not None else Reference(*(_frozen(self.name, part) for part in ref))

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joints that are named, and one of another size than the target.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a target, or costs, of another size.
        """
        self._on.of(self, robot)

    def terms(self, state: State, t: float) -> TaskTerms:
        """One row a joint at a state and a time [s]: its acceleration; those of cost zero are left out.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a target, or costs, of another size.
        """
        robot = checked(state).robot
        on, (k, d) = self._on.of(self, robot), self._law
        ref = _on_robot(self.name, self._at(t), robot, t) if callable(self.target) else on.fixed
        at = on.columns
        e = pin.difference(robot.model, state.q, ref.value)[at]
        wanted = ref.acceleration[at] + k * e + d * (ref.velocity[at] - state.v[at])
        return TaskTerms.unchecked(self.name, on.A, wanted, on.cost)


class _Posture(NamedTuple):
    """A posture task on one robot: its coordinates in v, its rows, their costs; and the target, if it is constant."""

    columns: slice | Array
    A: Array
    cost: Array
    fixed: Reference


def _names(task: str, joints: Sequence[str] | None) -> tuple[str, ...] | None:
    if joints is None:
        return None
    names = () if isinstance(joints, str) or not np.iterable(joints) else tuple(joints)
    if not names or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        raise InputError(f"joints of task {task!r:.80} are {joints!r:.80}; expected a list of names, each once.")
    return names


def _costs(task: str, cost: Any) -> float | Array | dict[str, float]:
    """Costs as they were given, copied; how many joints there are is not known yet."""
    said = f"cost of task {task!r:.80}"
    if isinstance(cost, Mapping):
        return {joint: float(checked_costs(f"{said} of joint {joint!r:.80}", each, 1)[0]) for joint, each in cost.items()}
    found = as_array(said, cost)
    if found.ndim > 1:
        raise InputError(f"{said} has shape {found.shape}; expected one number, one of each joint, or {{joint: cost}}.")
    costs = checked_costs(said, found, found.size, "joint")
    return costs if found.ndim else float(costs[0])


def _frozen(task: str, part: Any) -> Any:
    """A finite copy of an array that was given."""
    if part is None or isinstance(part, State):
        return part
    found = as_array(target_of(task, None), part)
    check_finite(target_of(task, None), found)
    return found


def _on_robot(task: str, ref: Reference, robot: CheckedModel, t: float | None) -> Reference:
    """The reference of a posture task, checked: q, velocity and acceleration of all joints."""
    value = ref.value
    if isinstance(value, State):
        if value.robot is not robot and (value.robot.nq, list(value.robot.joints)) != (robot.nq, list(robot.joints)):
            raise InputError(f"{target_of(task, t)} is a state of {value.robot.name}; expected one of {robot.name}.")
        q = value.q
    else:
        try:
            q = robot.check_q(value)
        except InputError as error:
            raise InputError(f"{target_of(task, t)}: {error}") from None
    return Reference(q, *checked_rates(ref, robot.nv, t, task))


def _posture(task: PostureTask, robot: CheckedModel) -> _Posture:
    """What a posture task is on a robot.

    Raises:
        JointNotFound: a joint that is not there, or has no motor.
        InputError: costs or a target of another size.
    """
    names = dict.fromkeys(robot.actuated_names) if task.joints is None else task.joints
    of_joint = {name: [i for i, other in zip(robot.actuated.tolist(), robot.actuated_names, strict=True) if other == name]
                for name in names}  # fmt: skip
    for name in names:
        if not of_joint[name]:
            robot.joint_id(name)
            raise JointNotFound(
                f"joint {name!r:.80} of task {task.name!r:.80} has no motor; {nearest(name, robot.actuated_names)}."
            )
    if isinstance(task.cost, Mapping):
        for name in task.cost:
            check_known(f"cost of task {task.name!r:.80} has joint", name, of_joint, JointNotFound)
        costs = np.array([float(task.cost.get(name, 1.0)) for name in of_joint])
    else:
        costs = checked_costs(f"cost of task {task.name!r:.80}", task.cost, len(of_joint), "joint")
    cost = np.repeat(costs, [len(each) for each in of_joint.values()])
    columns = np.array([i for each in of_joint.values() for i in each], int)[cost > 0.0]
    cost = cost[cost > 0.0]
    fixed = Reference(None) if callable(task.target) else _on_robot(task.name, task.target, robot, None)
    if np.array_equal(columns, robot.actuated):
        return _Posture(robot.motors, robot.actuation, cost, fixed)
    return _Posture(columns, np.eye(robot.nv)[columns], cost, fixed)
