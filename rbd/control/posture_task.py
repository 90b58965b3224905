"""The task of a posture: joints with motors follow a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, check_finite, lazy
from rbd.constraints.constraint import PerRobot
from rbd.control.task_terms import (
    Cost,
    Reference,
    Target,
    TaskTerms,
    as_reference,
    checked_costs,
    checked_law,
    checked_name,
    checked_rates,
    reference_at,
    target_of,
)
from rbd.displayed import Displayed
from rbd.errors import InputError, JointNotFound, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, check_state


@dataclass(frozen=True, eq=False)
class PostureTask(Displayed):
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
        object.__setattr__(self, "name", checked_name(self.name))
        checked_law(self.name, self.gain, self.damping_ratio)
        object.__setattr__(self, "joints", _names(self.name, self.joints))
        object.__setattr__(self, "cost", _costs(self.name, self.cost))
        if not callable(self.target):
            ref = as_reference(self.target)
            object.__setattr__(self, "target", Reference(*(_frozen(self.name, part) for part in ref)))
            if isinstance(ref.value, State):
                self.check(ref.value.robot)

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joints that are named, and one of another size than the target.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a target, or costs, of another size.
        """
        self._on.of(self, robot)

    @lazy
    def _law(self) -> tuple[float, float]:
        return checked_law(self.name, self.gain, self.damping_ratio)

    def terms(self, state: State, t: float) -> TaskTerms:
        """One row a joint at a state and a time [s]: its acceleration; those of cost zero are left out.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a target, or costs, of another size.
        """
        robot = check_state(state).robot
        on, (k, d) = self._on.of(self, robot), self._law
        target = self.target
        ref = on.fixed if not callable(target) else _on_robot(self.name, reference_at(self.name, target, t), robot, t)
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
    """A copy of an array that was given, so that nobody changes it; its size is checked when the robot is known."""
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
            if name not in of_joint:
                raise JointNotFound(f"cost of task {task.name!r:.80} has joint {name!r:.80}; {nearest(name, of_joint)}.")
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
