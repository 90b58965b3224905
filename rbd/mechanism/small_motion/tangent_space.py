"""The changes of a state that its constraints allow, their coordinates, and spin of bodies of revolution.

A change of the state (q, v) is (dq, dv), dq in the tangent space as pin.integrate takes it. With the rows that are held, of
Jacobian J, and J_h those of them that hold a position, it is allowed where

    J_h dq = 0        J dv + D dq = 0        D = d(J v - u)/dq at fixed v

D is zero at rest. Rows of velocity alone (rolling, edges) leave more freedoms of position than of velocity. Independent
entries of dq and of dv are chosen by pivoting; they are the reduced coordinates x = (x_q, x_v), and

    dq = T_q x_q        dv = G x_q + T_v x_v

A coin that rolls straight on has a constant velocity, and in its own axes, which turn with it, one that turns. For a free
body that is symmetric about an axis (unit twist e), axes that turn slower by eta = s e serve as well: there the velocity v of
a steady motion is constant,

    v' + ad(eta) v = 0        q_s(t) = q_0 (+) t (v - eta)

The coin's place and direction are those of q_s, and its own q = q_s (+) t eta.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.answers.analysis.contact_modes import modes_of
from rbd.answers.analysis.state_changes import STEP, slope
from rbd.arrays import Array, max_abs
from rbd.constraints.constraint import is_carried
from rbd.constraints.manifold import RANK, ConstraintManifold, StackedRows, null_space
from rbd.errors import InputError, Unsupported
from rbd.mechanism.constraint_error import farthest_columns
from rbd.mechanism.frobenius import ad
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.answer import Answer

ON = 1e-8
"""Largest error of the rows [m, rad; m/s, rad/s] at a state on its constraints."""
_HELD = ("holds", "sticks", "presses")


@dataclass(frozen=True, eq=False)
class TangentSpace:
    """The allowed changes of a state and their coordinates.

    Attributes:
        positions: Entries of dq that are coordinates, shape (n_q,), int.
        velocities: Entries of dv that are coordinates, shape (n_v,), int.
        T_q: Shape (nv, n_q); its rows `positions` are the identity.
        T_v: Shape (nv, n_v); its rows `velocities` are the identity.
        G: Shape (nv, n_q); its rows `velocities` are zero.
        rank_q: Rank of the rows that hold a position.
        rank_v: Rank of all held rows.
        m: Number of held rows.
    """

    positions: Array
    velocities: Array
    T_q: Array
    T_v: Array
    G: Array
    rank_q: int
    rank_v: int
    m: int

    @property
    def basis(self) -> Array:
        """(dq, dv) of the coordinates, shape (2 nv, n)."""
        return np.block([[self.T_q, np.zeros_like(self.T_v)], [self.G, self.T_v]])

    @property
    def picked(self) -> Array:
        """The entries of (dq, dv) that are coordinates, shape (n,)."""
        return np.concatenate([self.positions, len(self.T_q) + self.velocities]).astype(int)


def check_on(held: StackedRows) -> None:
    """Refuse a state that violates its constraints.

    Raises:
        InputError: naming the worst row, its error and the cure.
    """
    for what, sizes, unit, cure in (
        ("is off by", held.error, "m or rad", "Put it there first, with rbd.mechanism.assemble."),
        ("moves at", held.velocity, "m/s or rad/s", "rbd.mechanism.project_velocity gives the nearest that is allowed."),
    ):
        if max_abs(sizes) > ON:
            worst = int(np.abs(sizes).argmax())
            name, row = held.names[worst]
            raise InputError(
                f"the state is not on its constraints: row {row} of {name!r:.80} {what} {abs(float(sizes[worst])):.3g} "
                f"({unit}); expected at most {ON:g}. {cure}"
            )


def held_rows(answer: Answer, words: dict[str, tuple[str, ...]]) -> Array:
    """Combinations of the problem's rows that stay zero, shape (k, m).

    Raises:
        Unsupported: a contact slips or opens, or a force is at its bound: then no constraint is left of which small motion
            has a linear law on both sides.
    """
    for name, said in words.items():
        other = next((word for word in said if word not in _HELD), None)
        if other is not None:
            raise Unsupported(
                f"{name!r:.80} {other} at this state, so small motion about it is not linear (its contact mode changes). Leave "
                "it out, or give it friction=None, or take torques (rbd.hold) with which it sticks."
            )
    if not answer.problem.m:
        return np.zeros((0, 0))
    modes = modes_of(answer)
    psi = np.array(modes.psi).reshape(len(modes.start), -1)
    return psi @ modes.sets.H.T


def allowed_changes(state: State, manifold: ConstraintManifold, S: Array) -> TangentSpace:
    """The allowed changes of a state.

    Args:
        state: The state, on its constraints.
        manifold: Its constraints.
        S: Combinations of their rows that are held, shape (k, m).
    """
    here, nv, scale = manifold.rows(state), state.robot.nv, state.robot.joints.scale
    placed = np.ones(len(here.J), bool) if here.placed is None else here.placed
    of_positions = ~((np.abs(S) > 1e-12) & ~placed).any(axis=1)
    J, D = S @ here.J, S @ velocity_slopes(state, manifold, here)
    J_h = J[of_positions]
    T_q, positions, _ = coordinates(J_h, scale)
    T_v, velocities, weights = coordinates(J, scale)
    G = np.zeros((nv, len(positions)))
    if D.any():
        z = np.linalg.lstsq(weights[:, None] * J * scale, -(weights[:, None] * D) @ T_q, rcond=RANK)[0]
        G = scale[:, None] * z
        G -= T_v @ G[velocities]
    return TangentSpace(positions, velocities, T_q, T_v, G, nv - len(positions), nv - len(velocities), len(J))


def coordinates(J: Array, scale: Array) -> tuple[Array, Array, Array]:
    """(T, chosen, weights): a basis of the changes with J d = 0, with T[chosen] the identity, and the rows' scales.

    Args:
        J: Shape (m, nv).
        scale: Unit of each entry, shape (nv,).
    """
    sizes = np.linalg.norm(J * scale, axis=1)
    most = float(sizes.max(initial=0.0))
    # A row of rounding errors gets the scale of a small one: normalised it would count.
    weights = 1.0 / np.maximum(sizes, 1e-6 * most) if most else np.ones(len(J))
    N, _ = null_space(weights[:, None] * J * scale, RANK)
    chosen = independent_rows(N)
    T = np.linalg.solve(N[chosen].T, N.T).T if N.shape[1] else N
    T = scale[:, None] * T / scale[chosen]
    T[chosen] = np.eye(len(chosen))
    return T, chosen, weights


def independent_rows(N: Array) -> Array:
    """Rows of a basis that make an invertible square, well conditioned, ascending, shape (d,).

    The row farthest from those already chosen is next, as in a pivoted QR; of rows as far, the first one, so that rounding does
    not decide between the sides of a symmetric robot.
    """
    return np.sort(farthest_columns(N.T, np.arange(len(N)), 1.0 - 1e-6, 0.0)[0][: N.shape[1]]).astype(int)


def slopes_along(sample: Callable[[Array], Array], directions: Array, here: Array, what: str) -> Array:
    """Derivatives of a sample at zero along each direction, shape (m, k), by differences; {} in `what` is its number."""
    found = [
        slope(lambda h, along=along: sample(h * along), here, STEP, what.format(i))  # type: ignore[misc]
        for i, along in enumerate(directions)
    ]
    return np.array(found).reshape(len(directions), len(here)).T


def velocity_slopes(state: State, manifold: ConstraintManifold, here: StackedRows) -> Array:
    """D = d(J v - u)/dq at fixed v, shape (m, nv), by differences of the sixth order; zero at rest on ground at rest."""
    robot, v = state.robot, state.v
    if not len(here.J) or not (v.any() or any(is_carried(c) for c in manifold.constraints)):
        return np.zeros((len(here.J), robot.nv))

    def velocity(step: Array) -> Array:
        return manifold.rows(State(robot, pin.integrate(robot.model, state.q, step), v, t=state.t)).velocity

    return slopes_along(velocity, np.eye(robot.nv), here.velocity, "q[{}]")


_EQUAL = 1e-9
"""Principal moments of inertia that differ by less, relative, are equal."""


def ad_matrix(robot: CheckedModel, v: Array) -> Array:
    """The matrix of ad(v), shape (nv, nv): ad(v) y is the bracket of v and y, both constant in body axes."""
    return np.column_stack([ad(robot, v, along) for along in np.eye(robot.nv)])


def spin_axes(robot: CheckedModel) -> Array:
    """Unit twists about the axes of symmetry of free bodies of revolution, as columns, shape (nv, k).

    Of free-flyers and ball joints without joints beyond them. Of a body with three equal moments each axis through its centre
    of mass: three columns.
    """
    model, out = robot.model, []
    parents = set(int(model.parents[i]) for i in range(1, model.njoints))
    for joint in robot.joints.values():
        piece = joint.pieces[0]
        if len(joint.pieces) > 1 or piece.kind not in ("space", "sphere") or joint.id in parents:
            continue
        body = model.inertias[joint.id]
        moments, axes = np.linalg.eigh(body.inertia)
        close = np.abs(np.diff(moments)) <= _EQUAL * max_abs(moments)
        chosen = {(True, True): (0, 1, 2), (True, False): (2,), (False, True): (0,)}.get((bool(close[0]), bool(close[1])), ())
        for k in chosen:
            twist, axis, offset = np.zeros(robot.nv), axes[:, k], np.cross(body.lever, axes[:, k])
            if piece.kind == "sphere":
                if max_abs(offset) > 1e-12:
                    continue
                twist[piece.v : piece.v + 3] = axis
            else:
                twist[piece.v : piece.v + 6] = np.concatenate([offset, axis])
            out.append(twist)
    return np.array(out).reshape(-1, robot.nv).T


def fitted_spin(robot: CheckedModel, v: Array, a: Array) -> Array:
    """The eta with the least a + ad(eta) v, shape (nv,); zero without bodies of revolution, or where none is needed."""
    axes = spin_axes(robot)
    if not axes.shape[1] or not v.any() or max_abs(a) < 1e-12:
        return np.zeros(robot.nv)
    return axes @ np.linalg.lstsq(ad_matrix(robot, v) @ axes, a, rcond=1e-9)[0]
