"""Torques of a reference motion: inverse dynamics at times along it, on the contacts that touch at each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact_points import Source
from rbd.control.torques import inverse_dynamics, inverse_dynamics_many
from rbd.errors import CannotMove, RbdError
from rbd.mechanism.projection import project_acceleration, project_velocity
from rbd.model.checked_model import CheckedModel
from rbd.model.interpolation import cubic, cubic_rate, interpolated_q
from rbd.model.sampled_motion import SampledAccelerations
from rbd.model.state import State

NEAR = 1e-3
"""A contact of the reference whose nearest point is this near [m] touches."""
_TOLD = 6  # stretches of time that a message names


@dataclass(frozen=True, eq=False)
class TorqueReference:
    """A motion at closely spaced times, with the motors' torques for it.

    Attributes:
        t: Times, shape (n,) [s].
        q: Configurations, shape (n, nq).
        v: Velocities, those of contacts removed, shape (n, nv).
        a: Accelerations, those of contacts removed, shape (n, nv).
        tau: Motor torques, shape (n, nu) [N, N m].
        changed: Times at which the nearest possible acceleration took the place of the motion's own, shape (m,) [s].
        moved: Largest velocity that contacts of the motion had [m/s, rad/s], removed here.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    changed: Array
    moved: float


def sampled(motion: SampledAccelerations, longest: float) -> tuple[Array, Array, Array, Array]:
    """(t, q, v, a) of a motion at its own times and evenly between them, `longest` apart at most [s]."""
    own = np.asarray(motion.t, float)
    if len(own) < 2:
        return own, np.array(motion.q, float), np.array(motion.v, float), np.array(motion.a, float)
    parts = np.maximum(np.ceil(np.diff(own) / longest - 1e-9), 1).astype(int)
    first = np.repeat(own[:-1], parts)
    share = np.concatenate([np.arange(n) / n for n in parts])
    t = np.append(first + share * np.repeat(np.diff(own), parts), own[-1])
    q = interpolated_q(motion.robot, own, np.asarray(motion.q), np.asarray(motion.v), t)
    v, a = np.asarray(motion.v), np.asarray(motion.a)
    return t, q, cubic(own, v, a, t), cubic_rate(own, v, a, t)


def touching_contacts(sources: Sequence[Source], contacts: Sequence[Constraint], state: State) -> tuple[int, ...]:
    """Which contacts touch at a state, by the gap of their nearest point; loops and other constraints always do."""
    nearest = dict.fromkeys((c.name for c in contacts), -np.inf)
    for source in sources:
        measured = source.at(state, 0.0)
        for name in dict.fromkeys(measured.structure.owners):
            own = [o == name for o in measured.structure.owners]
            nearest[name] = float(np.min(measured.gap[own]))
    return tuple(i for i, c in enumerate(contacts) if nearest[c.name] <= NEAR)


def reference_of(
    motion: SampledAccelerations,
    contacts: Sequence[Constraint],
    touching: Sequence[tuple[int, ...]],
    samples: tuple[Array, Array, Array, Array],
    torques: str,
) -> TorqueReference:
    """The torques at each sample.

    Args:
        motion: The motion.
        contacts: Contacts, loops and other constraints.
        touching: Which of them touch at each sample.
        samples: As `sampled` gives them.
        torques: "exact", "nearest", "weight" or "none".

    Raises:
        CannotMove: with "exact" and "weight", where inverse dynamics has no answer; names the times and the first cause.
    """
    robot = motion.robot
    t, q, v, a = samples
    if torques == "weight":
        v, a = np.zeros_like(v), np.zeros_like(a)
    v, a, moved = _kept(robot, q, v, a, contacts, touching)
    tau = np.zeros((len(t), robot.nu))
    refused: dict[int, str] = {}
    if torques != "none":
        for chosen, run in groupby(range(len(t)), touching.__getitem__):
            at = np.fromiter(run, int)
            some = [contacts[i] for i in chosen]
            found = inverse_dynamics_many(robot, q[at], v[at], a[at], some, loops=False)
            tau[at] = found.tau
            refused.update({int(at[i]): reason for i, reason in found.reasons.items()})
    if refused and torques != "nearest":
        _refuse(motion, contacts, touching, (t, q, v, a), refused)
    for i in refused:
        tau[i], a[i] = _nearest(robot, q[i], v[i], a[i], [contacts[k] for k in touching[i]])
    # Of the torques without dynamics only the torques are: the reference moves as before.
    if torques == "weight":
        v, a, moved = _kept(robot, q, samples[2], samples[3], contacts, touching)
    return TorqueReference(t, q, v, a, tau, t[sorted(refused)], moved)


def _kept(
    robot: CheckedModel, q: Array, v: Array, a: Array, contacts: Sequence[Constraint], touching: Sequence[tuple[int, ...]]
) -> tuple[Array, Array, float]:
    """Velocities and accelerations with contacts at rest, nearest in the metric of inertia; and how fast contacts moved."""
    v, a, moved = v.copy(), a.copy(), 0.0
    for i, chosen in enumerate(touching):
        if not chosen:
            continue
        state, some = State(robot, q[i], v[i]), [contacts[k] for k in chosen]
        moved = max(moved, *(float(np.abs(c.rows(state).velocity).max(initial=0.0)) for c in some))
        still = project_velocity(state, some, loops=False)
        v[i], a[i] = still.v, project_acceleration(still, a[i], some, loops=False).a
    return v, a, moved


def _nearest(robot: CheckedModel, q: Array, v: Array, a: Array, contacts: Sequence[Constraint]) -> tuple[Array, Array]:
    """(torques, accelerations) of the nearest possible acceleration; without contacts those that gravity leaves."""
    try:
        found: Any = inverse_dynamics(State(robot, q, v), a, contacts, loops=False)
    except CannotMove as error:
        found = error.nearest()
    return found.tau, found.a


def _refuse(
    motion: SampledAccelerations,
    contacts: Sequence[Constraint],
    touching: Sequence[tuple[int, ...]],
    samples: tuple[Array, Array, Array, Array],
    refused: dict[int, str],
) -> None:
    t, q, v, a = samples
    robot, first = motion.robot, min(refused)
    stretches = []
    for _, run in groupby(enumerate(sorted(refused)), lambda x: x[1] - x[0]):
        at = [i for _, i in run]
        stretches.append(f"{t[at[0]]:.3f} s" if len(at) == 1 else f"{t[at[0]]:.3f} to {t[at[-1]]:.3f} s")
    more = f" and {len(stretches) - _TOLD} more" if len(stretches) > _TOLD else ""
    words = (
        f"no torques and contact forces give {robot.name} this motion at {', '.join(stretches[:_TOLD])}{more}. "
        "Use torques='nearest' for those of the nearest possible acceleration there, or a motion that "
        "rbd.check_motion finds possible."
    )
    try:
        inverse_dynamics(State(robot, q[first], v[first]), a[first], [contacts[k] for k in touching[first]], loops=False)
    except CannotMove as error:
        raise CannotMove(
            f"{words} At {t[first]:.3f} s: {error}", limits=error.limits, irreducible=error.irreducible,
            certificate=error.certificate, missing=error.missing, excess=error.excess, nearest=error.nearest,
            reason=error.reason,
        ) from None  # fmt: skip
    except RbdError as error:
        raise CannotMove(f"{words} At {t[first]:.3f} s: {error}") from None
    raise CannotMove(f"{words} At {t[first]:.3f} s: {refused[first]}")
