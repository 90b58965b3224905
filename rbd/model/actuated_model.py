"""The motors of a checked model: which joints have one, their torque limits at rest and in motion, and changes of them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Self, TypeVar

import numpy as np

from rbd.arrays import Array, as_array, check_finite, check_flag
from rbd.errors import InputError
from rbd.model.joints import FORCE_OF, Joints
from rbd.model.motors import Motor, Motors, TorqueLines, checked_motors, motors_of_plain, put_motors, torque_use
from rbd.model.travelling import Travelling

Model = TypeVar("Model", bound="ActuatedModel")


class ActuatedModel(Travelling):
    """What of a `CheckedModel` is about its motors; its attributes are described there."""

    name: str
    nv: int
    joints: Joints
    passive: frozenset[str]
    motor_data: Motors = MappingProxyType({})

    def _place_motors(self) -> None:
        """Make the tables of the motors: of all joints but free-flyers and passive ones."""
        driven = [joint for joint in self.joints.values() if joint.kind != "FreeFlyer" and joint.name not in self.passive]
        motors = [(joint.name, i) for joint in driven for i in range(joint.v.start, joint.v.stop)]
        self.actuated = self.joints.actuated = np.array([i for _, i in motors], dtype=int)
        self.unactuated = np.setdiff1d(np.arange(self.nv), self.actuated)
        self.actuated_names = tuple(n for n, _ in motors)
        self.nu = len(motors)
        self.motors, self.idle = _as_slice(self.actuated), _as_slice(self.unactuated)
        self.actuation = np.eye(self.nv)[self.actuated]
        limit = np.array(self.model.effortLimit, float)[self.actuated]
        # Zero, missing and +-DBL_MAX all mean that the file states no limit.
        self.effort_limit = np.where((limit <= 0.0) | (limit > 1e100) | ~np.isfinite(limit), np.inf, limit)
        for i, name in enumerate(self.actuated_names):
            motor = self.motor_data.get(name)
            if motor is not None and motor.standstill is not None:
                self.effort_limit[i] = motor.standstill
        self.torque_lines = TorqueLines(self.actuated, self.actuated_names, self.motor_data)

    def with_motors(self, motors: Mapping[str, Motor | None], *, others_passive: bool = False) -> Self:
        """The same robot with other motors; this one stays as it is.

        Args:
            motors: {joint: `rbd.Motor(limit=..., gear=..., ...)`}, at joints with one degree of freedom; None takes a joint's
                motor away. A passive joint that is named gets a motor. A joint's earlier `Motor` is replaced.
            others_passive: Whether joints that are not named lose their motors; by default they keep what they have.

        Returns:
            A new robot. Its `nu`, `effort_limit`, speed limits and M follow; it pickles and copies as any other.

        Raises:
            JointNotFound: an unknown joint, with the nearest names.
            InputError: what is no motor; a motor at a floating base, or at a joint with several degrees of freedom.

        Example:
            >>> solo = rbd.load_robot("solo12").with_motors({"FL_KFE": rbd.Motor(limit=1.5), "FR_KFE": None})
            >>> solo.nu, solo.effort_limit[:3], "FR_KFE" in solo.passive
            (11, array([1000. , 1000. ,    1.5]), True)
        """
        given = checked_motors(self.joints, motors, self.name)
        check_flag("others_passive", others_passive)
        rest = [name for name in self.actuated_names if name not in given] if others_passive else []
        out = copy.deepcopy(self)
        put_motors(out.model, out._as_made, out.joints, given)
        out._take_motors({**self.motor_data, **dict.fromkeys(rest), **given})
        return out

    def _take_motors(self, motors: Mapping[str, Motor | None]) -> None:
        """Have motors whose numbers are in the model already."""
        if not motors:
            return
        self.motor_data = MappingProxyType(dict(sorted(motors.items())))
        without = {name for name, motor in motors.items() if motor is None}
        self.passive = frozenset((self.passive - motors.keys()) | without)
        self._place_motors()

    def torque_limits(self, v: Array | None = None) -> tuple[Array, Array]:
        """(least, most) torques of the motors at a velocity: the effort limits, less where a torque-speed line limits driving.

        A motor drives its joint where tau and the joint's speed have one sign; in braking it has its torque at rest.

        Args:
            v: Velocity, shape (nv,), or several, (n, nv) [m/s, rad/s]; None: at rest.

        Returns:
            Two arrays (nu,), or (n, nu) [N, N m]; -inf and inf where there is no limit. Zero is between them.

        Raises:
            InputError: another shape, or numbers that are not finite.

        Example:
            >>> line = rbd.Motor(torque_speed=[(0.0, 3.0), (10.0, 0.0)])
            >>> solo = rbd.load_robot("solo12").with_motors({"FL_HAA": line})
            >>> [limit[0].item() for limit in solo.torque_limits(4.0 * np.ones(solo.nv))]
            [-3.0, 1.8]
        """
        if v is not None:
            v = as_array(f"v of {self.name}", v)
            if v.shape[-1:] != (self.nv,) or v.ndim > 2:
                raise InputError(f"v of {self.name} has shape {v.shape}; expected ({self.nv},) or (n, {self.nv}).")
            check_finite(f"v of {self.name}", v)
        least, most = self.limits_at(v)
        return least, most.copy()

    def limits_at(self, v: Array | None) -> tuple[Array, Array]:
        """`torque_limits` of a checked velocity; not to be changed in place."""
        return self.torque_lines.limits(v, self.effort_limit)

    def too_fast(self, v: Array) -> Array:
        """Which motors' joints are faster than the `speed_limit` of their `Motor`, of shape (nu,) or (n, nu), truth values.

        Speed limits that only the robot's file states do not count here: those are for controllers and `rbd.check_motion`.
        """
        given = [self.motor_data.get(name) for name in self.actuated_names]
        limit = [np.inf if motor is None or motor.speed_limit is None else motor.speed_limit for motor in given]
        return np.asarray(np.abs(v[..., self.actuated]) > limit)

    def torque_use(self, tau: Array | None, v: Array | None = None) -> Array:
        """Torques over their limits at a velocity, of shape (nu,) or (n, nu): 1 is at the limit, 0 where there is none.

        Args:
            tau: Motor torques, shape (nu,) or (n, nu) [N, N m]; None: zero.
            v: Velocity, shape (nv,) or (n, nv) [m/s, rad/s]; None: at rest.
        """
        return torque_use(np.zeros(self.nu) if tau is None else tau, *self.limits_at(v))

    def _extras(self) -> tuple[Any, ...]:
        return tuple(self.motor_data.items())

    def _take_extras(self, extras: tuple[Any, ...]) -> None:
        self._take_motors(dict(extras))


def with_plain_motors(robot: Model, plain: object) -> Model:
    """The robot with the motors of `plain_motors`; the same where there are none.

    Raises:
        InputError: what is no such data.
    """
    motors = motors_of_plain(plain)
    return robot.with_motors(motors) if motors else robot


def on_its_line(robot: ActuatedModel, motor: int, tau: float, v: Array) -> str:
    """A torque beyond a torque-speed line, in words: "35 N m at 12 rad/s, where its torque-speed line leaves 20 N m".

    Empty for a motor without a line, and for one that brakes or is at rest.
    """
    speed = float(v[robot.actuated[motor]])
    if not robot.torque_lines.has(motor) or tau * speed <= 0.0:
        return ""
    joint = robot.joints[robot.actuated_names[motor]]
    unit, most = FORCE_OF[joint.unit], abs(float(robot.torque_limits(v)[tau > 0.0][motor]))
    return f"{abs(tau):.4g} {unit} at {abs(speed):.4g} {joint.unit}/s, where its torque-speed line leaves {most:.4g} {unit}"


def beyond_limit(robot: ActuatedModel, motor: int, tau: float, v: Array) -> str:
    """A torque that is beyond its limit, in words."""
    limit = f"{tau:.4g}, beyond its effort limit of {robot.effort_limit[motor]:.4g} N m"
    return on_its_line(robot, motor, tau, v) or limit


def _as_slice(indices: Array) -> slice | Array:
    if len(indices) and (np.diff(indices) == 1).all():
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices
