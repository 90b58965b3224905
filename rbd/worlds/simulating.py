"""`simulate_many`: many worlds of one robot over time, with their residuals: `Trajectories`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from rbd.answers.many.states import Friction
from rbd.arrays import Array, as_array, check_flag, check_positive, check_whole
from rbd.constraints.constraint import Constraint
from rbd.control.schedules import Push
from rbd.errors import InaccurateWarning, InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.gauss_problem import Law
from rbd.simulation.progress_bar import progress_of
from rbd.simulation.run import MOST_STEPS
from rbd.worlds.beginning import begun, check_torques
from rbd.worlds.stepping import EachWorld, Servo, WorldPushes, Worlds
from rbd.worlds.trajectories import Trajectories

Torques: TypeAlias = Callable[[float, Array, Array], Array]
Begin: TypeAlias = State | Sequence[State] | tuple[CheckedModel, Array, Array]


def simulate_many(
    states: Begin,
    contacts: Sequence[Constraint] = (),
    *,
    duration: float,
    step: float,
    tau: Array | None = None,
    controller: Servo | Torques | None = None,
    every: int = 1,
    law: Law | str = "coulomb",
    friction: Friction = None,
    mass: EachWorld | Mapping[str, EachWorld] | None = None,
    gravity: Sequence[float] | Array | None = None,
    ground: EachWorld = 0.0,
    damping: Mapping[str, EachWorld] | None = None,
    pushes: WorldPushes | Push | Sequence[WorldPushes | Push] = (),
    record: int | None = None,
    loops: bool = True,
    threads: int | None = 1,
    progress: bool = True,
) -> Trajectories:
    """The motions of n worlds of one robot, eight at a time in the lanes of the processor, each step with its residual.

    The law and the equations are those of `rbd.simulate`; steps are not divided where points touch, leave or come to rest:
    order 2 between such events, 1 across them. Each argument has one value for all worlds, or one a world. A world in which
    a step has no solution, or whose numbers are not finite, stops, and the others go on: `trajectories.stopped`.

    Args:
        states: One state, a sequence of states of one robot, or (robot, q, v) with arrays (n, nq) and (n, nv).
        contacts: Points, edges and soles on planes or terrain at rest, with friction; `JointLimit`, `JointFriction`. A sole on
            terrain touches with its corners alone.
        duration: Simulated time [s].
        step: Length of a step [s].
        tau: Motor torques, shape (nu,) or (n, nu) [N, N m]; with a `Servo` they are added to its own.
        controller: A `Servo`; or a function of time, q (n, nq) and v (n, nv) that returns torques (n, nu).
        every: Steps between calls of that function.
        law: "coulomb" or "convex".
        friction: Coefficients in place of the contacts' own, as of `rbd.solve_many`.
        mass: Factor of all masses and inertias, a number or (n,); or {link: factor}.
        gravity: Shape (3,) or (n, 3) [m/s2]; None: the robot's.
        ground: Height added to all ground, a number or (n,) [m].
        damping: {joint: viscous damping, a number or (n,)} [N s/m, N m s/rad].
        pushes: `WorldPushes` and `rbd.control.Push`.
        record: Steps between samples; None: the first and the last alone.
        loops: Whether the robot's own loops hold, which are not supported: a robot that has some is refused.
        threads: How many; None: one a core. The numbers are the same, bit by bit.
        progress: Show a bar on a terminal where it takes long.

    Returns:
        The motions, as arrays over worlds and samples; after Ctrl-C those recorded until then, `trajectories.interrupted`.

    Raises:
        InputError: arrays of wrong sizes or not finite, torques of a controller that are; steps that are too long for a
            stiffness.
        Unsupported: joints or constraints that are not covered, by name.
        UnknownName: links, joints or frames that the robot does not have.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> mu = np.array([0.25, 0.5, 1.0])
        >>> worlds = rbd.simulate_many(slides, [face], duration=0.6, step=1e-3, friction=mu)
        >>> worlds.q[:, -1, 0].round(4), (1.0 / (2 * mu * 9.81)).round(4)  # v^2 / (2 mu g)
        (array([0.2039, 0.1019, 0.051 ]), array([0.2039, 0.1019, 0.051 ]))
    """
    robot, q, v = _begin(states)
    check_positive("duration", duration, 1e9, "s")
    check_positive("step", step, 10.0, "s")
    check_flag("progress", progress)
    if duration / step > MOST_STEPS:
        raise InputError(f"{duration:g} s by {step:g} s are {duration / step:.3g} steps; expected at most {MOST_STEPS:,}.")
    steps = round(duration / step)
    if abs(steps * step - duration) > 1e-9 * duration:
        raise InputError(f"a duration of {duration:g} s is {duration / step:.6g} steps of {step:g} s; expected a whole number.")
    every = check_whole("every", every, 10**9)
    stride = steps if record is None else min(check_whole("record", record, 10**9), steps)
    servo, asked = (controller, None) if isinstance(controller, Servo) else (None, controller)
    if asked is not None and (isinstance(asked, type) or not callable(asked)):
        raise InputError(
            f"controller is {controller!r:.80}; expected an rbd.worlds.Servo, or a function of t, q and v that gives torques."
        )
    given: dict[str, Any] = dict(
        states=(robot, q, v), contacts=contacts, tau=tau, every=every, step=step, law=law, controller=servo, friction=friction,
        mass=mass, gravity=gravity, ground=ground, damping=damping, pushes=pushes, loops=loops,
    )  # fmt: skip
    worlds = begun(given, threads)
    kept, interrupted = _Record(worlds, steps // stride + (steps % stride > 0) + 1), False
    kept.add()
    with progress_of([0.0, duration], shown=progress) as shown:
        try:
            while worlds.steps < steps:
                if asked is not None and worlds.steps % every == 0:
                    worlds.drive(tau=_torques(asked, worlds))
                ahead = min(stride - worlds.steps % stride, steps - worlds.steps, _MOST)
                worlds.advance(ahead if asked is None else min(ahead, every - worlds.steps % every))
                if worlds.steps % stride == 0 or worlds.steps == steps:
                    kept.add()
                shown(worlds.t)
        except KeyboardInterrupt:
            if kept.at < 2:  # nothing was recorded
                raise
            interrupted = True
    done = kept.trajectories(given, asked, interrupted)
    if said := done.inaccurate:
        warnings.warn(said, InaccurateWarning, stacklevel=2)
    return done


def _torques(asked: Torques, worlds: Worlds) -> Array:
    """What a controller wants now."""
    what = f"the controller at t = {worlds.t:.6g} s"
    try:
        found = asked(worlds.t, worlds.q, worlds.v)
    except Exception as error:  # a controller of the user can raise any exception
        raise InputError(f"{what} failed: {type(error).__name__} was raised ({error!s:.300}).") from error
    tau = as_array(f"torques of {what}", found)
    check_torques(f"torques of {what}", tau, worlds)
    return tau


_MOST = 1_000
"""Steps between looks at the keyboard."""


def _begin(states: Begin) -> tuple[CheckedModel, Array, Array]:
    """(robot, q, v) of what was given."""
    if isinstance(states, State):
        return states.robot, states.q, states.v
    if isinstance(states, tuple) and len(states) == 3 and isinstance(states[0], CheckedModel):
        return states
    some = [each for each in states if isinstance(each, State)] if isinstance(states, Sequence) else []
    if not some or len(some) < len(states):
        raise InputError(
            f"states is {states!r:.80}; expected a State, a list of states of one robot, or (robot, q, v) with one row a world."
        )
    robot = some[0].robot
    for i, state in enumerate(some):
        if not state.robot.is_like(robot):
            raise InputError(f"state {i} is of {state.robot.name}, the first of {robot.name}; expected one robot.")
    return robot, np.array([state.q for state in some]), np.array([state.v for state in some])


class _Record:
    """The samples of a run."""

    def __init__(self, worlds: Worlds, samples: int) -> None:
        n, robot, k = worlds.n, worlds.robot, len(worlds.touching.sites.arm)
        self.worlds, self.at = worlds, 0
        self.t, self.q, self.v = (
            np.zeros(samples),
            np.full((n, samples, robot.nq), np.nan),
            np.full((n, samples, robot.nv), np.nan),
        )
        self.residual, self.depth, self.turn = (np.zeros((n, samples)) for _ in range(3))
        self.points = np.zeros((n, samples, k, 3))

    def add(self) -> None:
        """The worlds as they are now; those that stopped have no state."""
        i, worlds = self.at, self.worlds
        goes = worlds.stopped < 0
        self.t[i], self.at = worlds.t, i + 1
        self.q[goes, i], self.v[goes, i] = worlds.q[goes], worlds.v[goes]
        self.residual[:, i], self.depth[:, i], self.turn[:, i] = worlds.residual, worlds.depth, worlds.turn
        self.points[:, i] = worlds.point_forces
        worlds.forget()

    def trajectories(self, given: Mapping[str, Any], asked: Torques | None, interrupted: bool) -> Trajectories:
        """What was recorded."""
        worlds, n = self.worlds, self.at
        return Trajectories(
            worlds.robot, self.t[:n], self.q[:, :n], self.v[:, :n], self.residual[:, :n], self.depth[:, :n],
            self.turn[:, :n], self.points[:, :n], worlds.stopped, worlds.rescued, dict(worlds.refused),
            worlds.touching.points, given, asked, interrupted,
        )  # fmt: skip
