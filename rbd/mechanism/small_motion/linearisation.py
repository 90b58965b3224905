"""`linearise`: the linear equations of small motion about an equilibrium or a steady motion, by differences of the true motion.

About a motion with constant v_0, q_0(t) = q_0 (+) v_0 t, a neighbour has the coordinates

    dq = q (-) q_0(t)        dv = v - v_0        dq' = P v + P_0 v_0        dv' = a(q, v)

P and P_0 are the derivatives of the difference by q and by q_0. To first order dq' = dv - ad(v_0) dq, where ad holds the
structure constants of these velocities (w x u and the like of a floating base): zero for joints with one degree of freedom.
Where a body of revolution spins by eta (`rbd.mechanism.small_motion.tangent_space`), v - eta takes the place of v in dq', and
dv' = a + ad(eta) v.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.answers.analysis.contact_modes import modes_of
from rbd.answers.analysis.sensitivity import Derivatives
from rbd.answers.analysis.state_changes import STEP, ranks_nearby, slope
from rbd.answers.least_constraint import solve
from rbd.answers.solution import Solution
from rbd.arrays import Array, check_flag, check_seed, max_abs
from rbd.constraints.constraint import Constraint, is_timed
from rbd.constraints.manifold import RANK, ConstraintManifold, own_or
from rbd.errors import NotDifferentiable, NotSteadyWarning, RbdWarning
from rbd.mechanism.small_motion.linearised import STEADY, Linearised
from rbd.mechanism.small_motion.tangent_space import (
    TangentSpace,
    ad_matrix,
    allowed_changes,
    check_on,
    fitted_spin,
    held_rows,
)
from rbd.model.derivatives import Charts
from rbd.model.external import External
from rbd.model.state import State, checked

DIRECTIONS = 2
"""Random directions in which A is compared with differences of the true motion, and one more a little ahead on it."""
AGREED = 1e-5
"""Largest relative difference of A from the true motion that passes; it is 1e-11 where all is smooth."""
AHEAD = 0.3
"""How far ahead on the motion A is compared, [rad, or parts of the robot's length]."""


def linearise(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    tau: Array | Sequence[float] | None = None,
    *,
    external: External = None,
    differences: bool = False,
    seed: int = 0,
    loops: bool = True,
) -> Linearised:
    """The linear equations x' = A x + B dtau of small motion about an equilibrium or a steady motion.

    x holds as many changes of positions and velocities as the constraints leave free: independent entries of (dq, dv),
    dq in the tangent space as pin.integrate takes it, v of a floating base in its own axes. About a motion with constant v_0,

        dq' = dv - ad(v_0) dq        dv' = da/dq dq + da/dv dv + da/dtau dtau

    with the derivatives of `solution.derivatives()` (contact modes fixed), restricted to the changes that the constraints
    allow: J_h dq = 0 and J dv + d(J v)/dq dq = 0. Constraints of velocity (rolling, edges) leave more freedoms of position
    than of velocity. Along a steady motion (rolling, cruising, spinning) nothing depends on where it has come to, so that A is
    constant. Neglected: all of second order, and that friction and unilateral contacts have limits.

    Args:
        state: The robot at (q_0, v_0), on its constraints.
        constraints: Constraints that hold: bilateral contacts, loops, wheels, contacts that stick; None for the loops and
            wheels of the robot's file.
        tau: Motor torques, shape (nu,) [N, N m], constant; None: zero.
        external: Other forces, as of `solve`; those of springs and dampers change with the state.
        differences: Take A by differences of `solve` also where there are derivatives.
        seed: Of the directions in which A is compared with differences of `solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        A, B, what x means, eigenvalues and modes, and how well A agrees with the true motion.

    Raises:
        InputError: wrong sizes, NaN, a state off its constraints (naming the row).
        Unsupported: a contact slips, slides, opens or yields at this state.
        NotDifferentiable: the motion does not change smoothly with the state: at a singular pose it branches.
        NoSolution: as `solve`.

    A state that accelerates gets a `NotSteadyWarning` with the size: A then holds at this instant alone.

    Example:
        >>> chain = rbd.planar.Chain(2, lengths=[1.0, 1.0], angles="vertical")
        >>> double = rbd.planar.to_robot(chain, bodies="points", masses=[1.0, 1.0])
        >>> small = rbd.linearise(double.at([-0.5 * np.pi, 0.0]))
        >>> np.sort(small.eigenvalues.imag**2 / 9.81).round(6)  # (2 - sqrt 2), (2 + sqrt 2)
        array([0.585786, 0.585786, 3.414214, 3.414214])
    """
    robot, seed = checked(state).robot, check_seed(seed)
    check_flag("differences", differences)
    given = own_or(robot, constraints, loops)
    torques = robot.check_tau(tau)
    manifold = ConstraintManifold.about(state, given)
    check_on(manifold.rows(state))
    solution = solve(state, torques, given, external=external)
    found, why = None, "differences were asked for"
    if not differences:
        try:
            found = solution.derivatives()
        except NotDifferentiable as error:
            why = str(error)
    words = _words(solution) if found is None else found.active
    S = held_rows(solution, words)
    space = allowed_changes(state, manifold, S)
    _check_rank(state, manifold)
    spin = fitted_spin(robot, state.v, solution.a)
    flow = Flow(state, torques, given, external, manifold, S, spin)
    rng = np.random.default_rng(seed)
    if found is None:
        A, B, invariance = _by_differences(flow, space, robot.nu)
    else:
        A, B, invariance = _reduced(full_matrix(state, found, spin), found.da_dtau, space)
    off, change = _compared(flow, space, A, B, rng, DIRECTIONS), 0.0
    speed = max_abs((state.v - spin) / robot.joints.scale)
    if speed:
        since = AHEAD / speed
        ahead = State(robot, pin.integrate(robot.model, state.q, since * (state.v - spin)), state.v, t=state.t + since)
        there = ConstraintManifold.about(ahead, given) if any(is_timed(c) for c in given) else manifold
        change = _compared(Flow(ahead, torques, given, external, there, S, spin), space, A, B, rng, 1)
    acceleration = max_abs(solution.a + ad_matrix(robot, spin) @ state.v)
    steady = acceleration <= STEADY and change <= STEADY
    _check_agreement(state, off, invariance if steady else 0.0, space)
    if not steady:
        _warn(state, acceleration, change)
    method = "derivatives" if found is not None else f"differences: {why}"
    return Linearised(state, torques, A, B, space, spin, words, method, acceleration, change, invariance, off)


def full_matrix(state: State, found: Derivatives, spin: Array) -> Array:
    """The matrix of (dq', dv') by (dq, dv) without constraints between them, shape (2 nv, 2 nv).

    Args:
        state: The steady motion.
        found: Derivatives of its acceleration.
        spin: eta of bodies of revolution, shape (nv,).
    """
    robot = state.robot
    carried, turning = ad_matrix(robot, state.v - spin), ad_matrix(robot, spin)
    return np.block([[-carried, np.eye(robot.nv)], [found.da_dq, found.da_dv + turning]])


def _reduced(full: Array, by_tau: Array, space: TangentSpace) -> tuple[Array, Array, float]:
    """(A, B, invariance): the matrices on the coordinates, and how far the rates leave the allowed changes."""
    basis, picked = space.basis, space.picked
    rates = full @ basis
    A = rates[picked]
    B = np.vstack([np.zeros_like(by_tau), by_tau])
    return A, B[picked], _relative(rates - basis @ A, rates)


def _relative(off: Array, size: Array) -> float:
    return float(np.abs(off).max(initial=0.0)) / max(1.0, float(np.abs(size).max(initial=0.0)))


def _by_differences(flow: Flow, space: TangentSpace, nu: int) -> tuple[Array, Array, float]:
    """A and B by differences of the true motion along each coordinate and each torque."""
    basis, picked, n = space.basis, space.picked, len(space.picked)
    pairs = [flow.slope(basis[:, i], np.zeros(nu)) for i in range(n)]
    X, F = (np.array([pair[k] for pair in pairs]).reshape(n, -1).T for k in (0, 1))
    A = np.linalg.solve(X[picked].T, F[picked].T).T if n else np.zeros((0, 0))
    B = np.array([flow.slope(np.zeros(len(basis)), along)[1][picked] for along in np.eye(nu)]).reshape(nu, n).T
    return A, B, _relative(F - basis @ (F[picked]), F) if n else 0.0


def _compared(flow: Flow, space: TangentSpace, A: Array, B: Array, rng: np.random.Generator, times: int) -> float:
    """Largest difference of A x + B dtau from slopes of the true motion in random directions, relative."""
    basis, picked, worst = space.basis, space.picked, 0.0
    for _ in range(times if len(picked) else 0):
        x, torques = rng.normal(size=(len(picked),)), rng.normal(size=(B.shape[1],))
        change: Array = basis @ (x / np.abs(x).max())
        tangent, rate = flow.slope(change, torques)
        told = A @ tangent[picked] + B @ torques
        worst = max(worst, _relative(rate[picked] - told, np.concatenate([told, rate])))
    return worst


def _check_agreement(state: State, off: float, invariance: float, space: TangentSpace) -> None:
    """Refuse a matrix that is not that of the true motion.

    Raises:
        NotDifferentiable: naming the difference.
    """
    if (worst := max(off, invariance)) > AGREED:
        raise NotDifferentiable(
            f"the linear equations of {state.robot.name} differ from its true motion by {worst:.2g}, relative: it does not "
            f"move smoothly here. Its constraints have rank {space.rank_v} of {space.m} rows; where the rank is higher nearby, "
            "the configuration is singular and motions branch (see rbd.mechanism.mobility). Take another one nearby."
        )


def _check_rank(state: State, manifold: ConstraintManifold) -> None:
    """Refuse a configuration where motions branch.

    Raises:
        NotDifferentiable: naming the ranks.
    """
    placed = manifold.placed
    rank = manifold.rank(manifold.at(state.q).J, RANK) if placed.any() else 0
    if rank < int(placed.sum()) and (most := max(ranks_nearby(manifold), default=rank)) > rank:
        raise NotDifferentiable(
            f"the configuration of {state.robot.name} is singular and motions branch there: its constraints have rank {rank} "
            f"of {int(placed.sum())} rows, and rank {most} nearby (see rbd.mechanism.mobility). Take another one nearby."
        )


def _words(solution: Solution) -> dict[str, tuple[str, ...]]:
    """Contact modes of an answer, by constraint."""
    modes, rows = modes_of(solution), solution.problem.rows
    return {r.name: tuple(word for e, word in modes.words.items() if e.rows == i) for i, r in enumerate(rows)}


def _warn(state: State, acceleration: float, change: float) -> None:
    if acceleration > STEADY:
        said = f"it accelerates by up to {acceleration:.3g} (m/s2 or rad/s2)"
    else:
        said = f"its linear equations change by {change:.2g}, relative, a little ahead on the motion"
    kind, cure = ("steady motion", "rbd.find_steady_motion") if state.v.any() else ("equilibrium", "rbd.find_equilibrium")
    warnings.warn(
        f"{state.robot.name} is linearised about a state that is no {kind}: {said}. A holds at this instant alone; {cure} "
        "finds one.",
        NotSteadyWarning,
        stacklevel=3,
    )


class Flow:
    """Rates of motion at states on the constraints, and their slopes.

    Args:
        state: The state of the motion with which others are compared.
        tau: Its torques, shape (nu,).
        constraints: Its constraints.
        external: Its external forces.
        manifold: The constraints' manifold.
        S: Combinations of the rows that are held, shape (k, m).
        spin: eta, shape (nv,).
    """

    def __init__(
        self,
        state: State,
        tau: Array,
        constraints: Sequence[Constraint],
        external: External,
        manifold: ConstraintManifold,
        S: Array,
        spin: Array,
    ) -> None:
        self._state, self._tau, self._constraints, self._external = state, tau, constraints, external
        self._manifold, self._S = manifold, S
        self._charts = Charts(state.robot)
        self._spin, self._turning = spin, ad_matrix(state.robot, spin)

    def slope(self, change: Array, torques: Array) -> tuple[Array, Array]:
        """(x', f') at the state: tangents of a curve on the constraints and of its rates, shapes (2 nv,).

        Args:
            change: (dq, dv) along which the curve begins, before its projection onto the constraints, shape (2 nv,).
            torques: Change of tau along the curve, shape (nu,).

        Raises:
            NotDifferentiable: the rates have a kink there.
        """
        with warnings.catch_warnings(action="ignore", category=RbdWarning):
            here = self._sample(0.0 * change, 0.0 * torques)
            found = slope(lambda h: self._sample(h * change, h * torques), here, STEP, "the state")
        n = len(change)
        return found[:n], found[n:]

    def _sample(self, change: Array, torques: Array) -> Array:
        """(dq, dv, dq', dv') at the state on the constraints that is nearest to a change, shape (4 nv,)."""
        state, robot = self._state, self._state.robot
        model, nv = robot.model, robot.nv
        q = pin.integrate(model, state.q, change[:nv])
        if self._manifold.constraints and self._manifold.placed.any() and change.any():
            q = self._manifold.project(q).q
        v = state.v + change[nv:]
        near = State(robot, q, v, t=state.t)
        if len(self._S):
            rows, scale = self._manifold.rows(near), robot.joints.scale
            v = v - scale * np.linalg.lstsq(self._S @ rows.J * scale, self._S @ rows.velocity, rcond=RANK)[0]
            near = State(robot, q, v, t=state.t)
        a = solve(near, self._tau + torques, self._constraints, external=self._external).a
        xi = pin.difference(model, state.q, near.q)
        chart = self._charts.at(state.q)
        moved = chart.rate(xi, v - self._spin) - chart.rate(-xi, state.v - self._spin)
        return np.concatenate([xi, v - state.v, moved, a + self._turning @ v])
