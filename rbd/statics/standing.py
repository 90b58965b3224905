"""A robot at rest on its contacts: its `Loads`, and the contact forces and torques for given weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float, as_vector3
from rbd.constraints.constraint import Constraint, listed, with_loops
from rbd.errors import InputError
from rbd.model.checked_model import FARTHEST
from rbd.model.state import State, checked
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.motion_forces import narrowed
from rbd.problem.rows import Rows
from rbd.statics.loads import Loads, contact_rows, refuse_motion

FRICTIONS = ("cone", "inscribed", "circumscribed")
SMALLEST_GAP = 1e-6
"""Least area between an inner and an outer polygon that can be asked for [m2]: a hundred programs a square metre's edge."""
_FELT = 1e-12
"""A motor that feels less of a contact force as large as the robot's weight, over its limit, feels none."""


def standing_loads(
    state: State, contacts: Sequence[Constraint], friction: str, margin: float = 0.0, loops: bool = True
) -> Loads:
    """The loads of a robot at rest on its contacts.

    Args:
        state: The pose; v must be zero.
        contacts: At least one.
        friction: "cone", "inscribed" or "circumscribed".
        margin: Share of each coefficient of friction that is left unused.
        loops: Whether the robot's own loops hold.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
        InputError: no contacts, no weight, a friction or a margin that is none.
    """
    robot = checked(state).robot
    refuse_motion(state)
    rows = given_rows(state, with_loops(robot, contacts, loops), stacklevel=4)
    refuse_motion(state, rows)
    sets = force_sets(rows, friction, margin)
    if not robot.mass * float(np.linalg.norm(robot.gravity)) > 0.0:
        raise InputError(f"{robot.name} has no weight (its mass, or gravity, is zero): it stands nowhere.")
    return Loads(state, rows, sets, state.h)


def given_rows(state: State, contacts: Sequence[Constraint], *, stacklevel: int = 3) -> tuple[Rows, ...]:
    """Rows of at least one contact; a warning names those off the planes that they stand on."""
    given = listed(contacts)
    if not given:
        raise InputError("contacts are empty; expected what the robot stands on, e.g. robot.soles().")
    return contact_rows(checked(state), given, stacklevel=stacklevel + 1)


def place(what: str, value: Sequence[float] | Array) -> Array:
    """Three numbers of metres, shape (3,), none of them so large that rounding would eat the rest."""
    out = as_vector3(what, value)
    if np.abs(out).max() > FARTHEST:
        raise InputError(f"{what} reaches {np.abs(out).max():.3g} m; at most {FARTHEST:g} is taken.")
    return out


def check_area_gap(area_gap: float) -> float:
    """The largest area between inner and outer polygon [m2].

    Raises:
        InputError: what is no number from 1e-6 to 1e6.
    """
    gap = as_float(area_gap)
    if not SMALLEST_GAP <= gap <= 1e6:
        raise InputError(f"area_gap is {area_gap!r:.80}; expected an area of {SMALLEST_GAP:g} m2 or more.")
    return gap


def force_sets(rows: Sequence[Rows], friction: str, margin: float = 0.0) -> ForceSet:
    """Sets of the forces of contacts at rest: circular cones, or pyramids inside or around them."""
    share = as_float(margin)
    if not 0.0 <= share < 1.0:
        raise InputError(f"margin is {margin!r:.80}; expected a share of friction to leave unused, from 0 to below 1.")
    if not isinstance(friction, str) or friction not in FRICTIONS:
        raise InputError(f"friction is {friction!r:.80}; expected one of {', '.join(map(repr, FRICTIONS))}.")
    sets = narrowed(at_rest(*[r.cone for r in rows]), share)
    return sets if friction == "cone" else sets.with_pyramids(inscribed=friction == "inscribed")


def names_of(rows: Sequence[Rows]) -> str:
    """The contacts by name, as text; of many, and of other constraints, the number."""
    contacts = [r.name for r in rows if r.patch is not None]
    told = contacts[:6]
    more = len(rows) - len(told)
    return ", ".join(told) + (f"{' and ' if told else ''}{more} more constraint{'s' if more > 1 else ''}" if more else "")


def friction_words(sets: ForceSet) -> str:
    """The sets as text: "circular cones", or which pyramids."""
    if len(sets.mu):
        return "circular cones"
    facets = sorted({e.facets for e in sets.elements if e.facets})
    return f"pyramids of {' and '.join(map(str, facets))} facets" if facets else "no friction"


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Torque limits as rows low <= C (x, p) <= high, of the motors whose limits matter.

    Left out are those that feel neither contact forces nor parameters, and are within their limits.

    Attributes:
        motors: Their numbers, shape (q,).
        C: Shape (q, p + k).
        low: Shape (q,).
        high: Shape (q,).
        size: What each row of torques over limits was divided by, for numbers around one, shape (q,).
    """

    motors: Array
    C: Array
    low: Array
    high: Array
    size: Array

    @classmethod
    def of(cls, loads: Loads, more: Array) -> TorqueRows:
        """With parameters of which a unit carries so much torque over the limits, shape (nu, k)."""
        C = np.hstack([loads.T, more])
        top = np.abs(C).max(axis=1, initial=0.0)
        motors = np.flatnonzero(loads.limited & ((top > _FELT) | (np.abs(loads.t) > 1.0)))
        size, t = np.maximum(1.0, top[motors]), loads.t[motors]
        return cls(motors, C[motors] / size[:, None], (t - 1.0) / size, (t + 1.0) / size, size)

    @classmethod
    def none(cls, loads: Loads, parameters: int) -> TorqueRows:
        """Without limits."""
        no = np.zeros(0)
        return cls(np.zeros(0, int), np.zeros((0, loads.sets.size + parameters)), no, no, no)


def contact_forces(loads: Loads, x: Array) -> dict[str, Array]:
    """{contact: force (3,) or wrench (6,) at the patch's centre, world axes}; row forces where rows have no resultant.

    Args:
        loads: The loads.
        x: Weights over the unit, shape (p,).
    """
    f, out, at = loads.sets.G @ x * loads.unit, {}, 0
    for r in loads.rows:
        part = f[at : at + len(r)]
        at += len(r)
        out[r.name] = part.copy() if r.resultant is None else np.asarray(r.resultant @ part)
    return out


def torques_left(loads: Loads, x: Array, more: Array | None = None) -> tuple[Array, Array]:
    """(tau, left), recomputed from the rows' forces: motor torques (nu,), and what is left where no motor is [N, N m].

    Args:
        loads: The loads.
        x: Weights over the unit, shape (p,).
        more: Generalised force beside them, shape (nv,).
    """
    robot = loads.state.robot
    load = loads.need - loads.J.T @ (loads.sets.G @ x) * loads.unit
    if more is not None:
        load = load - more
    return load[robot.actuated], load[robot.unactuated]


def outside(loads: Loads, x: Array) -> float:
    """How far forces are outside their sets [N]."""
    w = x * loads.unit
    return float(np.abs(w - loads.sets.project(w)).max(initial=0.0))
