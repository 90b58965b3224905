"""Changes of a state for derivatives: differences with an error where there is none, terms along directions, constraints.

The closing hinge of a Bricard or Bennett mechanism has more rows than it takes away freedoms, at every configuration that is
closed; beside those the rows contradict each other. There an answer has derivatives along the constraints alone. A change
(dq, dv) of a state is along them where

    J_h dq = 0        J dv + D dq = 0        D = d(J v - u)/dq at fixed v

with J_h those of the rows that hold a position. Singular configurations, of which the rank is higher nearby on the constraints,
have no such derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import RANK, Array, as_finite, max_abs
from rbd.constraints.manifold import ConstraintManifold, null_space
from rbd.errors import InputError, NotDifferentiable
from rbd.model.derivatives import Charts
from rbd.model.external import External, ForceElement, applied, elements_of
from rbd.model.inertial import HasRows
from rbd.model.state import State

SMOOTH = 1e-7
"""Largest error of a difference, over max(1, largest entry); up to 1e3 times as much if no step does better."""


@dataclass(frozen=True, eq=False)
class _Rule:
    """Differences from seven nodes: the slope, and two combinations of the values that vanish for smooth functions."""

    nodes: Array
    slope: Array
    lower_order: Array  # the fourth-order slope, less `slope`
    kink: Array  # half the jump of the slope at zero, of a function that is smooth on both sides


def _rules() -> tuple[_Rule, _Rule, _Rule]:
    both = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60.0
    ahead = np.array([-147, 360, -450, 400, -225, 72, -10]) / 60.0
    fourth, near = np.array([0, 1, -8, 0, 8, -1, 0]) / 12.0, np.array([-25, 48, -36, 16, -3, 0, 0]) / 12.0
    kink = np.array([1, -6, 15, -20, 15, -6, 1]) / 12.0  # 12 for |x|, 0 for x, x^2, ... x^5
    here = np.zeros(7)
    x = np.arange(7.0)
    return (
        _Rule(x - 3.0, both, fourth - both, kink),
        _Rule(x, ahead, near - ahead, here),
        _Rule(-x, -ahead, ahead - near, here),
    )


_RULES = _rules()
"""On both sides; ahead and behind, where the rows differ on the other side."""
STEP = 0.005 * 5.0**0.5
"""First step tried [rad, m]; irrational, so that it is no whole number of periods of the function."""


def slope(sample: Callable[[float], Array], here: Array, step: float, what: str) -> Array:
    """Derivative of a sample at zero, by differences of the sixth order with a step reduced until it converges.

    Raises:
        NotDifferentiable: if it has a kink, or different rows on the two sides.
    """
    best, miss = here, np.inf
    for _ in range(6):
        for rule in _RULES:
            values = [here if x == 0.0 else sample(step * x) for x in rule.nodes]
            if any(v.shape != here.shape for v in values):
                continue
            F = (np.array(values) - here) / step  # constant entries then have a slope of exactly zero
            found = rule.slope @ F
            off = np.maximum(np.abs(rule.lower_order @ F), np.abs(rule.kink @ F))
            worst = float((off / np.maximum(np.abs(found).max(initial=1.0), np.abs(here))).max(initial=0.0))
            if worst < miss:
                best, miss = found, worst
            break
        if miss <= SMOOTH:
            return best
        step /= 8.0
    if miss <= 1e3 * SMOOTH:
        return best
    raise NotDifferentiable(
        f"the constraints do not change smoothly with {what}: "
        + ("their rows appear and disappear." if miss == np.inf else f"its slopes on the two sides differ by {miss:.1e}.")
        + " Leave out the constraint (or its feedback), or move the state a little."
    )


def derivatives_of(external: External, state: State) -> tuple[Array, Array]:
    """(dtau_ext/dq on the tangent space, dtau_ext/dv) of all force elements among external forces, shapes (nv, nv).

    Those of pushes, whose point moves, are not in it: see `rbd.model.derivatives`.

    Raises:
        InputError: derivatives of a wrong size or not finite, with the element's name.
        NotDifferentiable: an element without derivatives of its own has a kink here.
    """
    nv = state.robot.nv
    by_q, by_v = np.zeros((nv, nv)), np.zeros((nv, nv))
    for element in elements_of(external):
        for total, found in zip((by_q, by_v), element_derivatives(element, state), strict=True):
            total += found
    return by_q, by_v


def element_derivatives(element: ForceElement, state: State) -> tuple[Array, Array]:
    """(dtau/dq on the tangent space, dtau/dv) of one element; by differences of the sixth order if it has none of its own.

    Raises:
        InputError: derivatives of a wrong size or not finite, with the element's name.
        NotDifferentiable: an element without derivatives of its own has a kink here.
    """
    nv = state.robot.nv
    own = getattr(element, "derivatives", None)
    if not callable(own):
        return slopes(lambda there: applied(element, there)[0], state, f" (force element {element.name!r:.80})")
    found = own(state)
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError(f"derivatives(state) of {element.name!r:.80} is {found!r:.80}; expected (dtau/dq, dtau/dv).")
    of = f"of {element.name!r:.80}"
    return as_finite(f"dtau/dq {of}", found[0], (nv, nv)), as_finite(f"dtau/dv {of}", found[1], (nv, nv))


def slopes(sample: Callable[[State], Array], state: State, of: str = "") -> tuple[Array, Array]:
    """(d/dq on the tangent space, d/dv) of a function of the state, by differences, shapes (k, nv).

    Args:
        sample: The function, whose values have shape (k,).
        state: Where.
        of: What it belongs to, for messages.

    Raises:
        NotDifferentiable: it has a kink here, or values of another shape on both sides.
    """
    robot, q, v, unit = state.robot, state.q, state.v, np.eye(state.robot.nv)
    here, chart = sample(state), Charts(state.robot).at(state.q)

    def along(moved: Callable[[Array], State], step: float, what: str) -> Array:
        def by(i: int) -> Array:
            return slope(lambda h: sample(moved(h * unit[i])), here, step, f"{what}[{i}]{of}")

        return np.column_stack([by(i) for i in range(robot.nv)])

    by_q = along(lambda dq: State(robot, chart.q(dq), v, t=state.t), STEP, "q")
    return by_q, along(lambda dv: State(robot, q, v + dv, t=state.t), 10.0 * STEP, "v")


@dataclass(frozen=True, eq=False)
class Change:
    """How the terms of the equations change along n directions, at fixed a and f.

    Attributes:
        force: S^T tau + tau_ext + J^T f - (M a + h), shape (nv, n).
        internal: J^T of internal forces, shape (nv, d, n).
        c: Accelerations of the rows, shape (m, n).
        u: Velocities of the rows, shape (m, n).
        resultants: {constraint: force in world axes, shape (k, n)}, of those that change.
    """

    force: Array
    internal: Array
    c: Array
    u: Array
    resultants: dict[str, Array]

    @classmethod
    def none(cls, nv: int, m: int, d: int, force: Array) -> Change:
        """A change of the force alone."""
        n = force.shape[1]
        return cls(force, np.zeros((nv, d, n)), np.zeros((m, n)), np.zeros((m, n)), {})

    def by(self, T: Array) -> Change:
        """The change along other directions, the columns of T, shape (n, k)."""
        resultants = {name: df @ T for name, df in self.resultants.items()}
        return Change(self.force @ T, self.internal @ T, self.c @ T, self.u @ T, resultants)

    def plus(self, other: Change) -> Change:
        """The sum of both changes."""
        mine, its = self.resultants, other.resultants
        resultants = {name: np.add(mine.get(name, 0.0), its.get(name, 0.0)) for name in {**mine, **its}}
        return Change(self.force + other.force, self.internal + other.internal, self.c + other.c, self.u + other.u, resultants)


AHEAD = 0.02
"""How far away the rank is compared [rad, or parts of the robot's length]."""
CLOSED = 1e-10
"""Largest error of the rows, dimensionless, of a configuration that counts as on the constraints."""
SAME = 1e-7
"""Singular values up to this count as zero where the rank is compared: at a singular pose they are of the order of AHEAD."""
_HELD = ("holds", "sticks")


def projections(
    state: State, constraints: Sequence[HasRows], words: Mapping[str, tuple[str, ...]], D: Array
) -> tuple[Array, Array, Array] | None:
    """(Q, G, V): a change dq, and a change dv, count as (Q dq, G dq) and (0, V dv), which are along the constraints.

    A change along them stays as it is: Q dq = dq, G dq + V dv = dv. Others are projected, by the least in units of the joints.

    Args:
        state: The robot at (q, v).
        constraints: Those of the answer.
        words: {constraint: mode of each of its parts}.
        D: Change of the rows' velocities with q at fixed v, shape (m, nv).

    Returns:
        Shapes (nv, nv), G zero at rest; None where a contact may slip or open, where the state is off its constraints, or
        where their rank is higher nearby on them.
    """
    if any(word not in _HELD for said in words.values() for word in said):
        return None
    manifold = ConstraintManifold.about(state, constraints)
    rows, scale = manifold.rows(state), manifold.scale
    if len(rows.J) != len(D) or not manifold.placed.any() or not _keeps_its_rank(manifold):
        return None
    T_q, T_v = (null_space(J * scale, RANK)[0] for J in (rows.J[manifold.placed], rows.J))
    Q, V = (scale[:, None] * (T @ T.T) / scale for T in (T_q, T_v))
    return Q, -scale[:, None] * np.linalg.lstsq(rows.J * scale, D @ Q, rcond=RANK)[0], V


def _keeps_its_rank(manifold: ConstraintManifold) -> bool:
    """Whether the state is on the constraints, and the rank of its rows is the same at configurations nearby on them."""
    here = manifold.at(manifold.q)
    return max_abs(here.error) <= CLOSED and set(ranks_nearby(manifold)) <= {manifold.rank(here.J, RANK)}


def ranks_nearby(manifold: ConstraintManifold) -> Iterator[int]:
    """Ranks of the rows that hold a position at four configurations nearby on the constraints, of those that are found.

    A rank above that of the state says that it is singular: motions branch there.
    """
    free, _ = null_space(manifold.at(manifold.q).J, RANK)
    rng = np.random.default_rng(0)
    for along in (free @ rng.normal(size=free.shape[1]) for _ in range(2)):
        for side in (AHEAD, -AHEAD) if along.any() else ():
            try:
                there = manifold.project(manifold.move(manifold.q, side / max_abs(along) * along))
            except InputError:  # a constraint may be undefined there
                continue
            if max_abs(there.error) <= CLOSED:
                yield manifold.rank(there.J, SAME)
