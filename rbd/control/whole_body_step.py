"""`step`: torques and contact forces with which tasks are met as well as limits allow, at one state.

    minimise    1/2 sum cost_i (A_i a - wanted_i)^2 + 1/2 r_a |a|^2 + 1/2 r_f |w / weight|^2
    subject to  M a + h = S^T tau + tau_ext + J^T f                                f = G w, w within its bounds
                J a + J_dot v = -k J v                                             contacts keep still
                |tau| <= limit,    least <= a <= most

tau is eliminated: the rows of the motors are bounds on M a + h - J^T G w. The rows G are those of pyramids inside the friction
cones. `rbd.control.step_program` solves it, `rbd.control.step_program` where contacts or joint limits cannot be kept.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, check_number, filled, max_abs
from rbd.constraints.constraint import Constraint, with_loops
from rbd.control.motion_limits import Limits, step_kernel
from rbd.control.step_problem import StepCertificate, StepProblem, TaskActuation
from rbd.control.step_program import Relaxed, StepPoint, minimiser
from rbd.control.task_terms import Task
from rbd.errors import InaccurateWarning, NoSolution, RbdWarning, RelaxedLimitsWarning
from rbd.errors.inputs import check_kind
from rbd.model.external import External
from rbd.model.state import State, checked
from rbd.problem.answer import Status
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import ForceSet
from rbd.problem.residuals import SOLVED
from rbd.statics.effort import DEFAULT

DAMPING = 50.0
"""Rate at which velocities of contacts decay [1/s]."""
_FASTEST = 1e6
"""Largest damping rate [1/s]."""


def step(
    state: State,
    tasks: Sequence[Task],
    contacts: Sequence[Constraint] = (),
    *,
    t: float = 0.0,
    limits: Limits = Limits(),  # noqa: B008  a frozen record of settings
    external: External = None,
    normal_force: Mapping[str, tuple[float, float]] | None = None,
    contact_damping: float = DAMPING,
    loops: bool = True,
) -> TaskActuation:
    """The torques and contact forces with which tasks are met at least cost, with a certificate.

    Equations of motion, friction pyramids inside the cones, bounds on normal forces and torque limits are always kept. Contacts
    and joint limits are kept where any torques and forces within these allow it; else their violation is the least, in the
    sum of squares of accelerations, and the tasks choose among all motions that have it: a `RelaxedLimitsWarning` tells it, and
    `violation` has it. The same input gives the same bits: nothing is remembered.

    Args:
        state: The robot at (q, v).
        tasks: What is wanted, each with a cost.
        contacts: Contacts, loops and other constraints: all their rows are kept as they are; those that move are brought to
            rest. Joint limits belong into `limits`.
        t: Time, for targets that are functions of it [s].
        limits: Limits of torques, joint positions and velocities.
        external: Other forces, as of `rbd.solve`.
        normal_force: {contact: (least, most)}: bounds on its normal force [N].
        contact_damping: k: velocities of contacts decay at this rate [1/s]; those of constraints with their own stabilisation
            by that one.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        An `rbd.Actuation` with what each task missed.

    Raises:
        InputError: on what is no task, no state, no bounds; on terms that are not finite or do not fit the robot.
        UnknownName: bounds or tasks of a contact that was not given.
        DuplicateName: two tasks, or two contacts, of one name.
        NoSolution: no answer was found within tolerance.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> state, soles = talos.standing(), talos.soles(friction=0.7)
        >>> tasks = [rbd.control.ComTask(state.com, cost=100.0), rbd.control.PostureTask(state.q)]
        >>> held = rbd.control.step(state, tasks, soles)
        >>> print(held.status, f"{held.forces['left_sole'][2] + held.forces['right_sole'][2]:.2f} N")
        solved 885.57 N
    """
    found = silent_step(
        state, tasks, contacts, t=t, limits=limits, external=external, normal_force=normal_force,
        contact_damping=contact_damping, loops=loops, stacklevel=4,
    )  # fmt: skip
    for category, text in complaints(found):
        warnings.warn(text, category, stacklevel=2)
    return found


def silent_step(
    state: State,
    tasks: Sequence[Task],
    contacts: Sequence[Constraint] = (),
    *,
    t: float = 0.0,
    limits: Limits = Limits(),  # noqa: B008  a frozen record of settings
    external: External = None,
    normal_force: Mapping[str, tuple[float, float]] | None = None,
    contact_damping: float = DAMPING,
    stacklevel: int | None = None,
    loops: bool = True,
) -> TaskActuation:
    """`step` without its warnings: that of distant contacts is given if a `stacklevel` is; `complaints` has the others.

    A controller calls it: filters of warnings are those of all threads, and so nothing here may change them.
    """
    checked(state)
    check_kind("limits", limits, Limits, "rbd.control.Limits(...)")
    problem = StepProblem.of(
        state,
        tasks,
        with_loops(state.robot, contacts, loops),
        check_number("t", t, -1e300, 1e300, expected="a time [s]"),
        limits,
        external,
        normal_force,
        check_number("contact_damping", contact_damping, 0.0, _FASTEST, expected="a rate of 0 or more [1/s]"),
        stacklevel=stacklevel,
    )
    (point, miss), eased = minimiser(problem.program), None
    if point is None or miss > SOLVED:
        eased = problem.relaxed()
        if eased is not None and not eased.violated:  # nothing need be: DAQP was wrong, or not exact enough
            eased = None
        point, miss = minimiser(problem.program if eased is None else eased.program, possible=True)
    if point is None:
        raise NoSolution(f"no torques and forces of {state.robot.name} were found for this step, even with contacts relaxed.")
    found = _actuation(problem, point, miss, eased)
    if found.status is Status.FAILED:
        raise NoSolution(
            f"the step of {state.robot.name} was found only to a scaled residual of {found.certificate.worst:.1e}: "
            f"{found.certificate}. Costs of tasks that differ by ten decades leave its program ill-conditioned."
        )
    return found


def complaints(found: TaskActuation) -> list[tuple[type[RbdWarning], str]]:
    """What a step warns of, each with its category: limits that were not kept, and residuals above 1e-9."""
    out = list[tuple[type[RbdWarning], str]]()
    if found.violation is not None:
        text = (
            f"{found.state.robot.name} cannot keep all contacts and joint limits; the least violation: {found.violation}. Ask "
            "for less, or leave out contacts that contradict each other."
        )
        out.append((RelaxedLimitsWarning, text))
    if found.status is Status.INACCURATE:
        worst = f"{found.certificate.worst:.1e} (solved is 1e-9)"
        out.append((InaccurateWarning, f"the step of {found.state.robot.name} has a scaled residual of {worst}."))
    return out


def _actuation(problem: StepProblem, point: StepPoint, optimality: float, eased: Relaxed | None) -> TaskActuation:
    """Torques and forces at a point of the program, with their certificate."""
    state, program, conic, still = problem.state, problem.program, problem.program.conic, problem.still
    robot, sets, unit, p, bounded = state.robot, still.sets, still.unit, program.p, program.joints
    offset, feedback = -conic.b[program.contacts], problem.feedback
    lowest, highest, a = conic.low[bounded], conic.high[bounded], point.x[p:]
    if eased is not None:
        offset, feedback = offset - eased.contacts, feedback - eased.contacts
        lowest, highest = lowest - eased.joints, highest + eased.joints
    w, tau, load = np.empty(p), np.empty(robot.nu), np.empty(robot.nv)
    balance, moved, cones, excess, passed, share = map(float, step_kernel().judged(
        state.M.T, still.need, still.J, offset, still.per_weight, unit, robot.unactuated, robot.actuated, point.x, conic.lower,
        conic.upper, sets.push, *_pyramids(sets), *problem.torques, problem.limits.torques(robot), problem.limited, lowest,
        highest, w, tau, load,
    ))  # fmt: skip
    moves, forces = max(1.0, max_abs(a), max_abs(conic.b)), max(unit, max_abs(load), max_abs(w))
    scaled = (balance / forces, moved / moves, cones / forces, share, passed / moves, optimality)
    return filled(
        TaskActuation, a=a, tau=tau, weights=w, loads=problem.loads(load, feedback, offset), constraints=problem.contacts,
        external=problem.external, effort=DEFAULT, margin=0.0, rest_speed=REST_SPEED, iterations=point.iterations,
        method=point.method, missed=problem.missed(a, w), limits=problem.limits, moving=problem.moving(),
        certificate=StepCertificate(balance, moved, cones, excess, passed, optimality, scaled),
        violation=None if eased is None else problem.violation(eased.contacts, eased.joints, eased.seen),
    )  # fmt: skip


@lru_cache(maxsize=128)
def _pyramids(sets: ForceSet) -> tuple[Array, Array]:
    """First columns of the pyramids and those after their last, shape (k, 2), and their friction coefficients."""
    each = [e for e in sets.elements if e.facets]
    spans = [(e.columns.start, e.columns.stop) for e in each]
    return np.array(spans, int).reshape(-1, 2), np.array([e.mu for e in each], float)
