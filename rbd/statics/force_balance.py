"""`ForceBalance`: what contact forces must balance, in rows with motors and without, scaled; and a robot at rest.

M a + h - tau_ext = S^T tau + J^T G w      the equations of motion, for a wanted motion (at rest: a = 0, v = 0)
A x = b                                    its rows without a motor: bases and passive joints; x = w / unit
tau / limit = t - T x                      its rows with one; limits are those at rest, and `bounds` those at this speed
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import BELOW_ONE, Array, as_vector3, check_number, lazy
from rbd.constraints.constraint import Constraint, listed, rows_of, with_loops
from rbd.constraints.distance_warnings import warn_of_distant, warn_of_limits
from rbd.errors import InputError, NotAtRest
from rbd.errors.inputs import check_choice, check_different
from rbd.model.checked_model import FARTHEST
from rbd.model.joints import Joint
from rbd.model.state import State, checked
from rbd.problem.conic import Unknowns
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.motion_forces import narrowed
from rbd.problem.rows import Rows, by_rows

_BEYOND = 1e-9
"""A torque beyond its limit by less, over the limit, is there by rounding."""

AT_REST = 1e-9
"""Largest |v| of a robot at rest."""


def contact_rows(state: State, contacts: Sequence[Constraint], *, stacklevel: int | None = 3) -> tuple[Rows, ...]:
    """Rows of constraints, each with its own name; warnings name contacts off their planes, and joints beyond their limits.

    Args:
        state: The robot.
        contacts: The constraints.
        stacklevel: Of the warnings: 2 for the line that called this; None for none.

    Raises:
        DuplicateName: two of one name.
    """
    rows = tuple(rows_of(state, contacts))
    check_different([r.name for r in rows], "contacts")
    if stacklevel is not None:
        warn_of_limits(state, contacts, stacklevel=stacklevel + 1)
        warn_of_distant(state, contacts, rows, stacklevel=stacklevel + 1)
    return rows


def refuse_motion(state: State, rows: Sequence[Rows] = ()) -> None:
    """Refuse a robot that moves, and contacts with a ground that does.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
    """
    if (speed := float(np.abs(state.v).max(initial=0.0))) > AT_REST:
        raise NotAtRest(f"statics wants a robot at rest, and |v| reaches {speed:.3g}. Use State(robot, q) with v = 0.")
    for r in rows:  # at v = 0, J_dot v of a ground at rest is zero
        if r.speed > AT_REST or np.abs(r.bias).max(initial=0.0) > AT_REST:
            raise NotAtRest(f"statics wants a ground at rest, and what {r.name!r} touches, or drives, moves. Use rbd.solve.")


@dataclass(frozen=True, eq=False)
class ForceBalance:
    """The equations of motion of a wanted motion, with the sets of the forces that it allows.

    Attributes:
        state: The robot at (q, v).
        given: The rows of the contacts and other constraints, or what gives them when they are first asked for.
        sets: The forces that may act, as weights on p columns: f = G w.
        need: M a + h - tau_ext, shape (nv,) [N, N m]: what torques and forces must come to.
        stacked: (J, bias and feedback) of the rows, where they are known already.
        terms: Size of what adds up to `need`, shape (nv,) [N, N m]: where it cancels, what is left is rounding of it.
    """

    state: State
    given: Sequence[Rows] | Callable[[], Sequence[Rows]]
    sets: ForceSet
    need: Array
    stacked: tuple[Array, Array] | None = None
    terms: Array | None = None

    @lazy
    def rows(self) -> Sequence[Rows]:
        """The rows."""
        return self.given() if callable(self.given) else self.given

    @lazy
    def unit(self) -> float:
        """The body weight [N]; 1 without gravity."""
        return self.state.robot.force_unit

    @lazy
    def J(self) -> Array:
        """Stacked Jacobian, shape (m, nv)."""
        if self.stacked is not None:
            return self.stacked[0]
        return np.concatenate([r.J for r in self.rows]) if self.rows else np.zeros((0, self.state.robot.nv))

    def accelerations(self, a: Array) -> Array:
        """Of the rows, J a + bias + feedback, shape (m,) [m/s2, rad/s2]."""
        if self.stacked is not None:
            return np.asarray(self.stacked[0] @ a + self.stacked[1])
        return np.concatenate([np.zeros(0), *[r.J @ a + r.bias + r.feedback for r in self.rows]])

    @lazy
    def per_weight(self) -> Array:
        """Generalised forces of unit weights, J^T G, shape (nv, p)."""
        return np.asarray(self.J.T @ self.sets.G)

    @lazy
    def limit(self) -> Array:
        """Effort limits at rest, shape (nu,); without a stated one the body weight times one metre."""
        limit = self.state.robot.effort_limit
        return np.where(np.isfinite(limit), limit, self.unit)

    @lazy
    def limited(self) -> Array:
        """Which motors have a stated limit, shape (nu,), of truth values."""
        return np.isfinite(self.state.robot.effort_limit)

    @lazy
    def bounds(self) -> tuple[Array, Array]:
        """(least, most) torques over `limit`, shapes (nu,): -1 and 1 but where a torque-speed line leaves less."""
        least, most = self.state.robot.limits_at(self.state.v)
        return least / self.limit, most / self.limit

    @lazy
    def idle_joints(self) -> list[tuple[Joint, list[int]]]:
        """(joint, its indices in v that no motor drives), of bases and passive joints."""
        still = set(self.state.robot.unactuated.tolist())
        found = [
            (joint, sorted(still.intersection(range(joint.v.start, joint.v.stop))))
            for joint in self.state.robot.joints.values()
        ]
        return [(joint, where) for joint, where in found if where]

    @lazy
    def row_size(self) -> Array:
        """What the rows without motors are divided by, shape (e,): a passive finger is balanced as well as a base.

        The largest of its terms, at least what moves it at 1 m/s2 (rad/s2), or 1 N, over the unit.
        """
        still = self.state.robot.idle
        need = np.abs(self.need if self.terms is None else self.terms)[still]
        top = np.maximum(np.abs(self.per_weight[still]).max(axis=1, initial=0.0), need / self.unit)
        return np.maximum(top, self.state.robot.least_inertia[still] / self.unit)

    @lazy
    def A(self) -> Array:
        """Rows without motors, of weights over the unit, shape (e, p)."""
        return self.per_weight[self.state.robot.idle] / self.row_size[:, None]

    @lazy
    def b(self) -> Array:
        """What they must come to, shape (e,)."""
        return self.need[self.state.robot.idle] / (self.row_size * self.unit)

    @lazy
    def T(self) -> Array:
        """Torques over their limits that a unit of each weight carries, shape (nu, p)."""
        return self.per_weight[self.state.robot.motors] * (self.unit / self.limit)[:, None]

    @lazy
    def t(self) -> Array:
        """Torques over their limits without contact forces, shape (nu,)."""
        return self.need[self.state.robot.motors] / self.limit

    @lazy
    def within(self) -> tuple[Array, Array]:
        """(low, high) of T x at torques within their bounds, shapes (nu,)."""
        least, most = self.bounds
        return self.t - most, self.t - least

    @property
    def torque_rows(self) -> tuple[dict[str, Array], Array, Array]:
        """({"forces": T}, low, high) of the motors with a stated limit: rows between bounds of a program."""
        low, high = self.within
        return {"forces": self.T[self.limited]}, low[self.limited], high[self.limited]

    @lazy
    def lower(self) -> Array:
        """Lower bounds of weights over the unit, shape (p,)."""
        return self.sets.lower / self.unit

    @lazy
    def upper(self) -> Array:
        """Upper bounds, likewise."""
        return self.sets.upper / self.unit

    def block(self, squares: float = 0.0) -> Unknowns:
        """The weights over the unit as unknowns of a program."""
        sets = self.sets
        return Unknowns(sets.size, squares, 0.0, self.lower, self.upper, sets.cone_columns, sets.mu)

    def columns(self, forces: Array) -> tuple[Array, Array]:
        """(in rows without motors, in torques over limits): further generalised forces, shape (nv, k) [N, N m]."""
        robot = self.state.robot
        return forces[robot.unactuated] / (self.unit * self.row_size)[:, None], forces[robot.motors] / self.limit[:, None]

    def torques(self, w: Array) -> tuple[Array, Array]:
        """(tau, left): motor torques beside the weights w [N], and what is left where no motor is, shapes (nu,) and (e,).

        A torque that is beyond its limit by rounding is put onto it.
        """
        robot = self.state.robot
        load = self.need - self.per_weight @ w
        least, most = self.bounds
        return onto_limits(load[robot.actuated], least * self.limit, most * self.limit, self.limit), load[robot.unactuated]


def onto_limits(tau: Array, least: Array, most: Array, size: Array) -> Array:
    """Torques, those that are beyond a limit by rounding, over their size, put onto it."""
    inside = np.minimum(np.maximum(tau, least), most)
    return np.where(np.abs(tau - inside) <= _BEYOND * size, inside, tau)


SMALLEST_GAP = 1e-6
"""Least area between an inner and an outer polygon that can be asked for [m2]: a hundred programs a square metre's edge."""


def standing_loads(
    state: State, contacts: Sequence[Constraint], friction: str, margin: float = 0.0, loops: bool = True
) -> ForceBalance:
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
    return ForceBalance(state, rows, sets, state.h)


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
    return check_number("area_gap", area_gap, SMALLEST_GAP, 1e6, expected=f"an area of {SMALLEST_GAP:g} m2 or more")


def force_sets(rows: Sequence[Rows], friction: str, margin: float = 0.0) -> ForceSet:
    """Sets of the forces of contacts at rest: circular cones, or pyramids inside or around them."""
    share = check_number("margin", margin, 0.0, BELOW_ONE, expected="a share of friction to leave unused, from 0 to below 1")
    check_choice("friction", friction, ("cone", "inscribed", "circumscribed"))
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


def contact_forces(loads: ForceBalance, x: Array) -> dict[str, Array]:
    """{contact: force (3,) or wrench (6,) at the patch's centre, world axes}; row forces where rows have no resultant.

    Args:
        loads: The loads.
        x: Weights over the unit, shape (p,).
    """
    return {r.name: r.force_of(part) for r, part in by_rows(loads.rows, loads.sets.G @ x * loads.unit)}


def torques_left(loads: ForceBalance, x: Array, more: Array | None = None) -> tuple[Array, Array]:
    """(tau, left), recomputed from the rows' forces: motor torques (nu,), and what is left where no motor is [N, N m].

    Args:
        loads: The loads.
        x: Weights over the unit, shape (p,).
        more: Generalised force beside them, shape (nv,).
    """
    robot = loads.state.robot
    load = loads.need - loads.J.T @ (loads.sets.G @ x) * loads.unit - (0.0 if more is None else more)
    return load[robot.actuated], load[robot.unactuated]


def outside(loads: ForceBalance, x: Array) -> float:
    """How far forces are outside their sets [N]."""
    w = x * loads.unit
    return float(np.abs(w - loads.sets.project(w)).max(initial=0.0))
