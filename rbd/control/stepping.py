"""`step`: torques and contact forces for which tasks are met as well as limits allow, at one state.

minimise    1/2 sum cost_i (A_i x - wanted_i)^2 + 1/2 r_a |a|^2 + 1/2 r_f |w / m|^2          x = (a, f)
subject to  M a + h = S^T tau + tau_ext + J^T f                                    f = G w, w within its bounds
            J a + J_dot v = -k J v                                                 contacts keep still
            |tau| <= limit,    a_least <= a <= a_most
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, listed
from rbd.control.limits import Limits, acceleration_bounds
from rbd.control.task_terms import Task
from rbd.errors import NoSolution
from rbd.model.dynamics import External, generalised
from rbd.model.state import State
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import at_rest
from rbd.solvers.strict_qp import solve_strict
from rbd.statics.actuation import Actuation
from rbd.statics.effort import DEFAULT
from rbd.statics.loads import Loads, contact_rows

REGULARISATION = (1e-4, 1e-4)


@dataclass(frozen=True, eq=False, repr=False)
class TaskActuation(Actuation):
    """Torques and forces of a step of whole-body control.

    Attributes:
        missed: {task: wanted less reached, shape (m,)}.
    """

    missed: Mapping[str, Array] = field(default_factory=dict)


def step(
    state: State,
    tasks: Sequence[Task],
    contacts: Sequence[Constraint] = (),
    *,
    t: float = 0.0,
    limits: Limits = Limits(),  # noqa: B008  a frozen record of settings
    external: External = None,
    normal_force: Mapping[str, tuple[float, float]] | None = None,
    contact_damping: float = 50.0,
) -> TaskActuation:
    """The torques and forces of least cost.

    Args:
        state: The robot at (q, v).
        tasks: What is wanted, each with a cost.
        contacts: Contacts, loops and other constraints that hold: they are kept as they are.
        t: Time, for targets that are functions of it [s].
        limits: Limits of torques, joint positions and velocities.
        external: Other forces, as of `rbd.solve`.
        normal_force: {contact: (least, most)}: bounds on its normal force [N].
        contact_damping: k: velocities of contacts decay at this rate [1/s].
    """
    robot, nv = state.robot, state.robot.nv
    given = listed(contacts)
    rows = tuple(
        replace(r, velocity=np.zeros(len(r)), feedback=contact_damping * r.velocity) for r in contact_rows(state, given)
    )
    sets = at_rest(*[r.cone for r in rows])
    if len(sets.mu):
        sets = sets.with_pyramids(inscribed=True)
    p, unit, mass = sets.size, robot.mass * 9.81, robot.mass
    J = np.concatenate([np.zeros((0, nv)), *[r.J for r in rows]])
    need = state.h if external is None else state.h - generalised(state, external)[0]
    JG = J.T @ sets.G * unit
    H, g = np.zeros((nv + p, nv + p)), np.zeros(nv + p)
    index = np.arange(nv + p)
    H[index[:nv], index[:nv]] = REGULARISATION[0]
    H[index[nv:], index[nv:]] = REGULARISATION[1] * 9.81**2
    terms = [task.terms(state, t) for task in tasks]
    at = {r.name: i for i, r in enumerate(rows)}
    ends = np.cumsum([0, *[len(r) for r in rows]])
    parts = []
    for each in terms:
        if not each.contact:
            A = np.concatenate([each.A, np.zeros((len(each.A), p))], axis=1)
        elif each.contact not in at:
            continue
        else:
            i = at[each.contact]
            A = np.zeros((len(each.A), nv + p))
            A[:, nv:] = each.A @ np.asarray(rows[i].resultant)[: each.A.shape[1]] @ sets.G[ends[i] : ends[i + 1]] * unit
        H += (A.T * each.cost) @ A
        g -= A.T @ (each.cost * each.wanted)
        parts.append((each, A))
    limit = robot.effort_limit * (np.inf if limits.torque is None else limits.torque)
    size = np.where(np.isfinite(limit), limit, unit)
    rhs = np.concatenate([np.zeros(0), *[-r.bias - r.feedback for r in rows]])
    dynamics = np.concatenate([state.M, -JG], axis=1)
    idle, motors = robot.idle, robot.motors
    C = np.concatenate(
        [dynamics[idle] / unit, np.concatenate([J, np.zeros((len(J), p))], axis=1), dynamics[motors] / size[:, None]]
    )
    low = np.concatenate([-need[idle] / unit, rhs, (-limit - need[motors]) / size])
    high = np.concatenate([-need[idle] / unit, rhs, (limit - need[motors]) / size])
    least, most = acceleration_bounds(state, limits)
    found = solve_strict(
        H, g, np.concatenate([least, sets.lower / unit]), np.concatenate([most, sets.upper / unit]), C, low, high
    )
    if not found.solved:
        raise NoSolution(f"no step of {robot.name}")
    a, w = found.x[:nv], found.x[nv:] * unit
    loads = Loads(state, rows, sets, state.M @ a + need)
    tau, _ = loads.torques(w)
    return TaskActuation(
        a, tau, w, loads, given, external, DEFAULT, 0.0, REST_SPEED, DEFAULT.program(loads), found.iterations, "DAQP", True,
        {each.name: each.wanted - A[:, : nv + p] @ found.x for each, A in parts},
    )  # fmt: skip
