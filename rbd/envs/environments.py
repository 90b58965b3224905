"""`RobotVectorEnv`: many robots on their feet as one vector environment of Gymnasium; `RobotEnv`, one of them; their ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_finite, check_number, check_positive, check_seed, check_whole
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed
from rbd.envs.rewards import Reference, gravity_in
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, check_known, listed_items
from rbd.modules import of_extra
from rbd.motion.reference_motion import Motion
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.worlds.stepping import Servo, WorldPushes, Worlds

gymnasium: Any = of_extra("gymnasium", "envs")
VectorEnv: Any = gymnasium.vector.VectorEnv
Env: Any = gymnasium.Env
Info = dict[str, Any]
MOST = 100.0
"""Bound of observed lengths, angles and speeds."""


@dataclass(frozen=True)
class RandomPushes(Displayed):
    """Pushes of random size and horizontal direction, one after the other, at random times.

    Attributes:
        speed: Least and greatest impulse over the robot's mass [m/s].
        pause: Least and greatest time before a push, after the reset or the last push [s].
        duration: How long a push lasts [s].
        frame: Frame of the robot that is pushed at its origin; None: its base.

    Example:
        >>> pushes = rbd.envs.RandomPushes((0.2, 0.4), duration=0.1)
        >>> envs = rbd.envs.RobotVectorEnv("solo12", 8, pushes=pushes)
        >>> _ = envs.reset(seed=1)
        >>> force = np.linalg.norm(envs.forces, axis=1)
        >>> bool((force > 0.2 * envs.robot.mass / 0.1).all() and (force < 0.4 * envs.robot.mass / 0.1).all())
        True
    """

    speed: tuple[float, float] = (0.0, 0.5)
    _: KW_ONLY
    pause: tuple[float, float] = (0.5, 1.5)
    duration: float = 0.1
    frame: str | None = None

    def __post_init__(self) -> None:
        check_range("speed", self.speed, 0.0, 1e3, "m/s")
        check_range("pause", self.pause, 0.0, 1e6, "s")
        check_positive("duration", self.duration, 1e3, "s")
        check_kind("frame", self.frame, str | None, "the name of a frame, or None")


class RobotVectorEnv(Displayed, VectorEnv):
    """Many robots of one kind on their feet, with servos at their joints, as a vector environment of Gymnasium.

    Action: of each motor the offset of its target from the standing posture (or the motion) over `reach`, and where `torque`
    is above zero as many torques, over `torque`; in [-1, 1], larger ones are cut off. The torques that hold the posture, or
    those of the motion by `rbd.check_motion`, are added.

    Observation: height of the base [m]; direction of gravity, velocity and angular velocity of the base, in its axes; offsets
    of the joints from the posture [rad, m], their velocities, the last action; of a motion also its angles and velocities now
    less the posture's. Cut off at 100, as float32.

    Reward: the mean of terms in [0, 1], see `info["reward"]` and docs/reference/environments.md.

    An episode ends (terminated) where the base is below `lowest` of its height, leans by more than `lean` from its reference,
    or the world has no solution (`info["stopped"]`). It is cut (truncated) after `max_episode_steps`, or where the motion ends.

    Args:
        robot: A floating robot with feet, or its name.
        num_envs: How many.
        motion: What to follow; None: to stand. It is sampled at the control rate, and an episode begins anywhere in it.
        pushes: `RandomPushes`, or None.
        contacts: Its feet on the ground; None: `robot.feet()` on z = 0. Floors of contacts are no obstacles for other bodies.
        step: Length of a step of the simulation [s].
        every: Steps between actions.
        reach: Offset of a target at an action of 1 [rad, m].
        torque: Torque at an action of 1 [N m, N]; 0: there are none.
        stiffness: Of the servos, a number or shape (nu,) [N m/rad]; None: weight times height, and at most I / step^2 with the
            inertia I that the motor feels while all else is free.
        damping: Likewise [N m s/rad]; None: 0.2 sqrt(height / g) of the stiffness, and at most I / step.
        friction: Least and greatest coefficient of all contacts, drawn at a reset; None: the contacts' own.
        mass: Least and greatest factor of all masses, drawn at a reset.
        speed: Greatest velocity of base and joints at a reset, each drawn [m/s, rad/s].
        lowest: Of the base, over its height in the reference.
        lean: Greatest angle of the base from its reference [rad].
        max_episode_steps: Actions in an episode; None: no limit.
        autoreset_mode: Of Gymnasium: NEXT_STEP, SAME_STEP, or DISABLED with `reset(options={"reset_mask": ...})`.
        threads: How many; the numbers are the same, bit by bit.
        render_mode: None; worlds are drawn by `rbd.visual`.

    Attributes:
        worlds: The `rbd.worlds.Worlds` beneath, with q, v, forces of the feet and residuals.
        forces: Of the next or present push of each world, shape (n, 3) [N].
        times: When it begins and ends, on the clock `worlds.t`, shape (n, 2) [s].

    Raises:
        InputError: arguments out of range; a robot without floating base; a motion of another robot.
        ModelError: no feet are known.
        CannotHold: its motors cannot hold the standing posture.

    Example:
        >>> import gymnasium
        >>> envs = gymnasium.make_vec("rbd/Stand-v0", num_envs=16, robot="solo12")
        >>> obs, info = envs.reset(seed=1)
        >>> obs, reward, terminated, truncated, info = envs.step(np.zeros((16, 12)))
        >>> obs.shape, bool(reward.min() > 0.9), bool(info["residual"].max() < 1e-8)
        ((16, 46), True, True)
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        robot: Robot | str,
        num_envs: int = 1,
        *,
        motion: Motion | None = None,
        pushes: RandomPushes | None = None,
        contacts: Sequence[Constraint] | None = None,
        step: float = 2e-3,
        every: int = 10,
        reach: float = 0.5,
        torque: float = 0.0,
        stiffness: float | Array | None = None,
        damping: float | Array | None = None,
        friction: tuple[float, float] | None = None,
        mass: tuple[float, float] = (1.0, 1.0),
        speed: float = 0.1,
        lowest: float = 0.6,
        lean: float = 1.0,
        max_episode_steps: int | None = 500,
        autoreset_mode: Any = gymnasium.vector.AutoresetMode.NEXT_STEP,
        threads: int | None = 1,
        render_mode: str | None = None,
    ) -> None:
        robot = load_robot(robot) if isinstance(robot, str) else robot
        check_kind("robot", robot, Robot, "an rbd.Robot that stands on feet, or its name")
        n, self.robot = check_whole("num_envs", num_envs), robot
        step, self.every = check_positive("step", step, 10.0, "s"), check_whole("every", every)
        if not robot.floating:
            raise InputError(f"{robot.name} has a fixed base; expected one that floats, on feet: solo12, go2, g1, talos.")
        if pushes is not None:
            check_kind("pushes", pushes, RandomPushes, "rbd.envs.RandomPushes, or None")
        if render_mode is not None:
            raise InputError(f"render_mode is {render_mode!r:.80}; expected None. Draw states with rbd.visual.")
        self.limit = None if max_episode_steps is None else check_whole("max_episode_steps", max_episode_steps)
        self.reach = check_positive("reach", reach, 10.0, "rad")
        self.torque = check_number("torque", torque, 0.0, 1e6, expected="a torque of 0 or more [N m]")
        self.ranges = {"mass": check_range("mass", mass, 1e-3, 1e3, "")}
        if friction is not None:
            self.ranges["friction"] = check_range("friction", friction, 1e-3, 1e3, "")
        self.speed = check_number("speed", speed, 0.0, MOST, expected="a speed of 0 or more")
        self.lowest = check_number("lowest", lowest, 0.0, 1.0, expected="a number from 0 to 1")
        self.least = np.cos(check_number("lean", lean, 0.01, np.pi, expected="an angle from 0.01 to pi"))
        self.mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.mode}
        standing = robot.standing()
        feet = listed_items("contacts", robot.feet(at=standing) if contacts is None else contacts, "a list of contacts")
        self.reference = Reference(robot, standing, feet, motion, step * self.every)
        self.pushes = pushes or RandomPushes((0.0, 0.0))
        nothing, zeros = np.zeros((n, 3)), np.zeros(n)
        alone = 1.0 / np.diag(pin.computeMinverse(robot.model, robot.model.createData(), standing.q))[robot.actuated]
        weight, fall = 9.81 * robot.mass, np.sqrt(self.reference.height / 9.81)
        k = (
            np.minimum(weight * self.reference.height, alone / step**2)
            if stiffness is None
            else as_array("stiffness", stiffness)
        )
        # stronger damping would turn a motor that is at its limit from one side to the other within a step
        d = np.minimum(0.2 * fall * k, alone / step) if damping is None else as_array("damping", damping)
        self.worlds = Worlds(
            robot, feet, np.tile(standing.q, (n, 1)), step=step, threads=threads, mass=zeros + 1.0,
            controller=Servo(k, d, target=np.zeros((n, robot.nu))),
            pushes=WorldPushes(self.pushes.frame or robot.model.names[1], nothing, start=zeros, duration=zeros),
        )  # fmt: skip
        self.num_envs, self.render_mode, self.spec, self.closed = n, None, None, False
        self.gains, self.driven = (k, d), self.worlds.packed.driven
        size, joints = robot.nu * (1 + (self.torque > 0.0)), robot.nv - 6
        bound = np.full(10 + 2 * joints + size + 2 * joints * (motion is not None), MOST, np.float32)
        bound[1:4] = bound[10 + 2 * joints : 10 + 2 * joints + size] = 1.0
        many, box = gymnasium.vector.utils.batch_space, gymnasium.spaces.Box
        self.single_observation_space = box(-bound, bound, dtype=np.float32)
        self.single_action_space = box(-1.0, 1.0, (size,), np.float32)
        self.observation_space, self.action_space = many(self.single_observation_space, n), many(self.single_action_space, n)
        self.forces, self.times, self._action = nothing, np.zeros((n, 2)), np.zeros((n, size))
        self._taken, self._at, self._done, self._ready = np.zeros(n, int), np.zeros(n, int), np.zeros(n, bool), False
        self._seen = np.zeros((n, len(bound)), np.float32)

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Array, Info]:
        """Put all robots at the start of an episode, or those of a mask, `options={"reset_mask": mask}`.

        The same seed gives the same bits from here on.

        Raises:
            InputError: a seed that is no whole number from 0; unknown options; a mask of another shape.
        """
        super().reset(seed=None if seed is None else check_seed(seed))
        given = {} if options is None else options
        check_kind("options", given, Mapping, '{"reset_mask": mask}, or None')
        for name in given:
            check_known("no option of reset is", name, ["reset_mask"])
        mask = given.get("reset_mask", np.ones(self.num_envs, bool))
        check_kind("reset_mask", mask, np.ndarray, f"an array of truth values, shape ({self.num_envs},)")
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise InputError(f"reset_mask has shape {mask.shape} of {mask.dtype}; expected ({self.num_envs},) of truth values.")
        if mask.all():
            self.worlds.steps = 0
        elif not self._ready:
            raise InputError("reset_mask chooses some worlds before the first reset of all; reset without options first.")
        self._ready = True
        self._begin(np.flatnonzero(mask))
        return self._seen.copy(), self._info(np.zeros(self.num_envs), np.zeros(self.num_envs, bool))

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, Info]:
        """Take one action in each world; worlds whose episode is over begin anew as `autoreset_mode` says.

        Returns:
            Observations, rewards, terminated, truncated, and info: `residual`, the largest scaled residual of the equation of
            motion and the contact law in these steps; `stopped`, whether the world has no solution; `reward`, the terms; of
            SAME_STEP `final_obs` and `final_info` where episodes ended.

        Raises:
            InputError: actions of a wrong shape or not finite, with the world; a step before a reset.
        """
        action = np.clip(as_finite("actions", actions, self.action_space.shape, meaning="one row a world"), -1.0, 1.0)
        over, worlds, disabled = self._done, self.worlds, self.mode == gymnasium.vector.AutoresetMode.DISABLED
        if not self._ready or (disabled and over.any()):
            which = f"the episode of world {np.flatnonzero(over)[0]} is over" if self._ready else "no episode has begun"
            raise InputError(f"{which}; call reset first.")
        nu, reference, before = self.robot.nu, self.reference, self._seen
        at = np.minimum(self._at + 1, reference.last)
        target = reference.angles[at][:, self.driven] + self.reach * action[:, :nu]
        feed = reference.tau[at] + (self.torque * action[:, nu:] if self.torque else 0.0)
        change, self._action, self._at = action - self._action, action, at
        worlds.drive(target=target, tau=feed)
        worlds.forget()
        worlds.advance(self.every)
        self._taken += 1
        stopped, q, v, residual = worlds.stopped >= 0, worlds.q, worlds.v, worlds.residual
        stopped |= ~(np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1))
        q[stopped], v[stopped] = reference.q[at[stopped]], 0.0
        (k, d), motors = self.gains, self.driven
        tau = feed + k * (target - reference.angles_of(q)[:, motors]) - d * v[:, 6 + motors]
        used = np.minimum(np.abs(tau) / self.robot.effort_limit, 1.0).max(axis=1)
        terms = reference.terms(at, q, v, change, worlds, used)
        self._seen = np.where(stopped[:, None], before, self._observation(q, v))
        upright = (gravity_in(q) * reference.gravity[at]).sum(axis=1)
        terminated = stopped | (q[:, 2] < self.lowest * reference.base[at, 2]) | (upright < self.least)
        truncated = np.zeros(self.num_envs, bool) if self.limit is None else self._taken >= self.limit
        if reference.motion is not None:
            truncated |= at == reference.last
        reward = np.where(terminated, 0.0, np.mean(list(terms.values()), axis=0))
        info = self._info(residual, stopped, terms)
        self._done = terminated | truncated
        if self.mode == gymnasium.vector.AutoresetMode.SAME_STEP and self._done.any():
            self._finish(info)
        elif self.mode == gymnasium.vector.AutoresetMode.NEXT_STEP and over.any():
            reward[over], terminated[over], truncated[over] = 0.0, False, False
            for value in (info["residual"], info["stopped"], *terms.values()):
                value[over] = 0.0
            self._done[over] = False
            self._begin(np.flatnonzero(over))
        self._push(np.flatnonzero(self.times[:, 1] <= worlds.t))
        return self._seen.copy(), reward, terminated, truncated, info

    def _finish(self, info: Info) -> None:
        """Note how the episodes ended that are over, and begin new ones."""
        done = self._done.copy()
        final = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(done):
            final[i] = self._seen[i].copy()
        kept = {name: value.copy() if isinstance(value, np.ndarray) else dict(value) for name, value in info.items()}
        info.update(final_obs=final, _final_obs=done, final_info=kept, _final_info=done)
        self._begin(np.flatnonzero(done))

    def _begin(self, which: Array) -> None:
        """New episodes in some worlds."""
        draw, m, worlds, reference = self.np_random, len(which), self.worlds, self.reference
        drawn = {name: draw.uniform(low, high, m) for name, (low, high) in self.ranges.items()}
        at = draw.integers(0, max(reference.last, 1), m)
        v = reference.v[at] + draw.uniform(-self.speed, self.speed, (m, self.robot.nv))
        worlds.vary(which, **drawn)
        worlds.set(reference.q[at], v, which)
        self._at[which], self._taken[which], self._done[which], self._action[which] = at, 0, False, 0.0
        self._push(which)
        self._seen[which] = self._observation(worlds.q, worlds.v)[which]

    def _push(self, which: Array) -> None:
        """Draw the next push of some worlds."""
        draw, m, (low, high) = self.np_random, len(which), self.pushes.speed
        if not m or not high:
            return
        size, angle = draw.uniform(low, high, m) * self.robot.mass / self.pushes.duration, draw.uniform(0.0, 2.0 * np.pi, m)
        start = self.worlds.t + draw.uniform(*self.pushes.pause, m)
        self.forces[which] = size[:, None] * np.stack([np.cos(angle), np.sin(angle), np.zeros(m)], axis=1)
        self.times[which] = np.stack([start, start + self.pushes.duration], axis=1)
        self.worlds.vary(which, force=self.forces[which], start=start, end=self.times[which, 1])

    def _observation(self, q: Array, v: Array) -> Array:
        reference, posture = self.reference, self.reference.posture
        parts = [q[:, 2:3], gravity_in(q), v[:, :6], reference.angles_of(q) - posture, v[:, 6:], self._action]
        if reference.motion is not None:
            parts += [reference.angles[self._at] - posture, reference.v[self._at, 6:]]
        high = self.single_observation_space.high
        return np.clip(np.concatenate(parts, axis=1).astype(np.float32), -high, high)

    def _info(self, residual: Array, stopped: Array, terms: Mapping[str, Array] | None = None) -> Info:
        all_of_them = np.ones(self.num_envs, bool)
        found = {"residual": residual, "stopped": stopped, **({} if terms is None else {"reward": dict(terms)})}
        return found | {f"_{name}": all_of_them.copy() for name in found}


class RobotEnv(Displayed, Env):
    """One robot on its feet as an environment of Gymnasium: `RobotVectorEnv` of one world, without autoreset.

    Args:
        robot: A floating robot with feet, or its name.
        max_episode_steps: As of `RobotVectorEnv`; `gymnasium.make` cuts episodes by itself.
        render_mode: None.
        options: The others of `RobotVectorEnv`.

    Example:
        >>> import gymnasium
        >>> env = gymnasium.make("rbd/Stand-v0", robot="go2")
        >>> obs, info = env.reset(seed=1)
        >>> obs, reward, terminated, truncated, info = env.step(np.zeros(12, np.float32))
        >>> obs.shape, reward > 0.9, terminated, info["residual"] < 1e-8
        ((46,), True, False, True)
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self, robot: Robot | str, *, max_episode_steps: int | None = None, render_mode: str | None = None, **options: Any
    ) -> None:
        mode = gymnasium.vector.AutoresetMode.DISABLED
        self.many = RobotVectorEnv(
            robot, 1, max_episode_steps=max_episode_steps, render_mode=render_mode, autoreset_mode=mode, **options
        )
        self.render_mode = render_mode
        self.observation_space, self.action_space = self.many.single_observation_space, self.many.single_action_space

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Array, Info]:
        """The start of an episode; the same seed gives the same bits from here on."""
        super().reset(seed=None if seed is None else check_seed(seed))
        self.many.np_random = self.np_random
        observation, info = self.many.reset(options=options)
        return observation[0], _first(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, Info]:
        """Take one action; errors as of `RobotVectorEnv.step`."""
        observation, reward, terminated, truncated, info = self.many.step(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)


def _first(info: Mapping[str, Any]) -> Info:
    """Of the only world."""
    found = {name: value for name, value in info.items() if not name.startswith("_")}
    return {name: _first(value) if isinstance(value, dict) else value[0].item() for name, value in found.items()}


def check_range(what: str, value: object, least: float, most: float, unit: str) -> tuple[float, float]:
    """Two numbers between which a third is drawn.

    Raises:
        InputError: they are none, out of bounds, or the second is the smaller.
    """
    low, high = as_finite(what, value, (2,), meaning="least and greatest")
    if not least <= low <= high <= most:
        within = f"{least:g} <= least <= greatest <= {most:g}{unit and f' [{unit}]'}"
        raise InputError(f"{what} is {value!r:.80}; expected {within}.")
    return float(low), float(high)


def _mode(value: Any) -> Any:
    """The mode of autoreset, or its name."""
    modes = gymnasium.vector.AutoresetMode
    for mode in modes:
        if isinstance(value, str | modes) and value in (mode, mode.value, mode.name):
            return mode
    raise InputError(f"autoreset_mode is {value!r:.80}; expected one of {', '.join(mode.name for mode in modes)}.")


TASKS: dict[str, dict[str, Any]] = {"Stand": {}, "PushRecovery": {"pushes": RandomPushes()}, "Track": {}}
"""{name in Gymnasium: arguments}; Track takes a motion."""


def register() -> None:
    """Make rbd/Stand-v0, rbd/PushRecovery-v0 and rbd/Track-v0 known to `gymnasium.make` and `gymnasium.make_vec`."""
    for name, arguments in TASKS.items():
        if f"rbd/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"rbd/{name}-v0", "rbd.envs:RobotEnv", max_episode_steps=500, vector_entry_point="rbd.envs:RobotVectorEnv",
                kwargs=arguments,
            )  # fmt: skip
