"""`check_task`: the rows of a task and its J_dot v against the value that it is about, along curves of the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array
from rbd.control.task_terms import Task, TaskTerms
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State, check_state
from rbd.testing.constraint_check import STEPS, Times, deviations
from rbd.testing.solver_check import TaskWrong


@dataclass(frozen=True)
class TaskReport(Displayed):
    """What `check_task` compared, and the largest deviations found, scaled as the tolerance is.

    Attributes:
        name: The task's name.
        rows: Number of rows.
        jacobian: Deviation of A v from the value's rate.
        jdot_v: Deviation of A a + J_dot v from the value's second derivative.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> report = rbd.testing.check_task(rbd.control.ComTask([0.0, 0.0, 0.9]), lambda state: state.com, talos.standing())
        >>> report.rows, report.jacobian < 1e-8, report.jdot_v < 1e-8
        (3, True, True)
    """

    name: str
    rows: int
    jacobian: float
    jdot_v: float


def check_task(
    task: Task,
    value: Callable[[State], Array | float],
    state: State,
    *,
    t: float = 0.0,
    seed: int = 0,
    draws: int = 5,
    tolerance: float = 1e-7,
) -> TaskReport:
    """Deviations of a task's A and J_dot v from the differences of its value along curves of the robot; raises if large.

    Along q(t) = q (+) (v t + a t^2 / 2), for drawn v and a, the rows of a task about a value y(q) must give::

        A v  =  y'        A a + J_dot v  =  y''

    to sixth order in the step. J_dot v is found from `wanted` at v, at -v and at rest, as what is even in
    v and zero at rest. Feedback on the error and its rate, and feed-forward, cancel there: they are not checked.

    Args:
        task: A task of accelerations.
        value: What it is about, y of shape (m,), or a number; for angular velocities in world axes, the rotation vector from
            the orientation at `state`.
        state: Where; a generic posture sees more than a symmetric one.
        t: The time at which the task is asked [s].
        seed: Of the drawn velocities and accelerations.
        draws: How many.
        tolerance: Largest deviation, over max(1, largest term).

    Raises:
        TaskWrong: with the row and the numbers.
        InputError: a task of a contact's force, one without rows here, or a value of another size.

    Example:
        >>> class Apart:
        ...     name = "apart"
        ...     def terms(self, state, t):  # two feet, along x in the world
        ...         one, other = state.frame("FL_FOOT"), state.frame("FR_FOOT")
        ...         return rbd.control.TaskTerms("apart", (one.J - other.J)[:1], (other.bias - one.bias)[:1], [1.0])
        >>> def apart(state):
        ...     return (state.frame("FL_FOOT").X_WF.translation - state.frame("FR_FOOT").X_WF.translation)[0]
        >>> report = rbd.testing.check_task(Apart(), apart, rbd.load_robot("solo12").standing())
        >>> report.rows, report.jacobian < 1e-8, report.jdot_v < 1e-8
        (1, True, True)
    """
    rng, robot = np.random.default_rng(seed), check_state(state).robot
    still = _terms(task, state.with_velocity(robot.zero_v), t)
    worst = {"A v": 0.0, "A a + J_dot v": 0.0}
    for _ in range(draws):
        v, a = rng.normal(size=robot.nv), rng.normal(size=robot.nv)
        there, back = (_terms(task, state.with_velocity(each), t) for each in (v, -v))
        bias = still.wanted - 0.5 * (there.wanted + back.wanted)
        given = {"A v": still.A @ v, "A a + J_dot v": still.A @ a + bias}
        wrong = ""
        for step in STEPS:
            times = Times(step)
            nodes = [State(robot, pin.integrate(robot.model, state.q, v * s + 0.5 * a * s * s)) for s in times.nodes]
            along = np.array([np.atleast_1d(as_array(f"value of task {task.name!r:.80}", value(node))) for node in nodes])
            if along.shape[1:] != still.wanted.shape:
                raise InputError(
                    f"the value of task {task.name!r:.80} has shape {along.shape[1:]}; its rows are {len(still.A)}."
                )
            seen = {"A v": times.first(along), "A a + J_dot v": times.second(along)}
            found = {what: deviations(given[what], seen[what]) for what in given}
            bad = [what for what, gap in found.items() if not gap.max() <= tolerance]
            if not bad:
                break
            i = int(np.argmax(found[bad[0]]))
            wrong = wrong or (
                f"{task.name!r}: {bad[0]} of row {i} is {given[bad[0]][i]:.9g}, and the value's differences say "
                f"{seen[bad[0]][i]:.9g} (tolerance {tolerance:g}). Look for a wrong sign, frame or axis, or a term left out."
            )
        else:
            raise TaskWrong(wrong)
        worst = {what: max(most, float(found[what].max())) for what, most in worst.items()}
    return TaskReport(task.name, len(still.A), worst["A v"], worst["A a + J_dot v"])


def _terms(task: Task, state: State, t: float) -> TaskTerms:
    terms = task.terms(state, t)
    if terms.contact or not len(terms.A):
        raise InputError(f"task {task.name!r:.80} has no rows of accelerations here; a value has no differences to compare.")
    return terms
