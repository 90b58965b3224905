"""The conic program of a set of loads: forces at its corners, corrections for its columns, of the largest margin or extent.

    maximise margin, or s          at each corner:       P f + S^T tau = L + s L'
                                   for each column i:    P F_i + S^T tau_i + P_i f = D_i + s D'_i
    |f_t| + sum_i |F_it| + margin <= friction (f_n - sum_i |F_in|), and likewise for bounds and torques

Sparse, as the corrections meet only in the sums. Forces are over the robot's weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from rbd.arrays import Array
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.solvers.conic_newton import clarabel_settings

_ENOUGH = 1.0
"""A margin of the robot's weight is not exceeded."""
_LEAST = 1e6
"""Nor is one less than minus this, over the weight."""
_FARTHEST = 1e6
"""No number of the program is looked for beyond."""
_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Held:
    """What the program found.

    Attributes:
        value: The margin [N, N m], or s; -inf where there is no answer.
        forces: At the corners, shape (k, p) [N].
        corrections: For the columns at each corner, shape (k, n, p) [N].
        torque: Of all members, shape (nu,); or none for torques of each.
        gain: Torques of a unit push, shape (nu, d).
        velocities: Multipliers of the corners, shape (k, nv): they prove that the value is no larger.
        aside: The number r of `free`, up to which the answer goes.
    """

    value: float
    forces: Array
    corrections: Array
    torque: Array
    gain: Array
    velocities: Array
    aside: float


@dataclass(frozen=True, eq=False)
class Way:
    """What a unit of an extent s adds to a set of loads.

    Attributes:
        corners: To the loads at the corners, shape (k, nv).
        columns: To the columns, shape (n, nv).
        turns: To what a column changes in the loads at corners, of an uncertain pose: {its number: shape (k, nv)}.
        radius: To the bound of a load's rounding, shape (nv,); zero if not given.
    """

    corners: Array
    columns: Array
    turns: Mapping[int, Array] = field(default_factory=dict)
    radius: Array | float = 0.0

    @classmethod
    def between(cls, first: UncertainLoads, second: UncertainLoads) -> Way:
        """From one set of loads to another."""
        turns = {i: second.turns[i][1] - own for i, (_, own) in first.turns.items()}
        columns, radius = second.columns - first.columns, second.load_radius - first.load_radius
        return cls(second.corners - first.corners, columns, turns, radius)

    def at(self, corner: int, t: Array) -> Array:
        """To the load of a member, shape (nv,)."""
        return np.asarray(self.corners[corner] + t @ self.slopes(corner))

    def slopes(self, corner: int) -> Array:
        """How that changes with each t, shape (n, nv)."""
        out = self.columns.copy()
        for i, own in self.turns.items():
            out[i] += own[corner]
        return out

    def of_corner(self, corner: int) -> Way:
        """The same of one corner alone."""
        own = {i: of[corner : corner + 1] for i, of in self.turns.items()}
        return Way(self.corners[corner : corner + 1], self.columns, own, self.radius)


def right_inverse(loads: UncertainLoads) -> Array:
    """X with P X = 1 in the idle rows, to the bits that a certificate has, shape (p, i)."""
    A = loads.balance.per_weight[loads.state.robot.unactuated]
    return np.round(np.linalg.pinv(A) * 2.0**30) / 2.0**30 if A.size else np.zeros((A.shape[1], 0))


@dataclass(frozen=True, eq=False)
class Repair:
    """How forces that miss the load of a pose in the idle rows are repaired, as the verifier bounds it.

    Attributes:
        sizes: |X| of a right inverse of the idle rows of P, shape (p, i).
        error: Bounds E of P X - 1 there, shape (i, i).
    """

    sizes: Array
    error: Array

    @classmethod
    def of(cls, loads: UncertainLoads, turns: Mapping[int, tuple[Array, Array]]) -> Repair | None:
        """At the middle of a part, whose columns that turn are given; None where none does."""
        if not turns:
            return None
        idle, X = loads.state.robot.unactuated, right_inverse(loads)
        E = np.abs(loads.balance.per_weight[idle] @ X - np.eye(len(idle))) + loads.forces_radius[idle] @ np.abs(X)
        return cls(np.abs(X), E + sum(np.abs(S[idle] @ X) for S, _ in turns.values()))


class _Rows:
    """Rows of a sparse matrix with their sides, put together block by block."""

    def __init__(self) -> None:
        self.parts: list[tuple[Array, Array, Array]] = []
        self.sides: list[Array] = []
        self.count = 0

    def add(self, blocks: Sequence[tuple[Array, Array]], side: Array) -> None:
        """Rows of sum of matrix times unknowns, given by their numbers; with their side."""
        for matrix, columns in blocks:
            at, of = np.nonzero(matrix)
            self.parts.append((self.count + at, columns[of], matrix[at, of]))
        self.sides.append(side)
        self.count += len(side)


def largest(
    loads: UncertainLoads,
    corners: Array,
    columns: Array,
    torques: str = "each",
    *,
    components: Array | None = None,
    margin: float | None = None,
    ways: Way | None = None,
    free: Way | None = None,
    at_most: float = np.inf,
    turns: Mapping[int, tuple[Array, Array]] | None = None,
    repair: Repair | None = None,
) -> Held:
    """The largest margin of a set, or with a margin given the largest s along `ways`.

    Args:
        loads: What carries them.
        corners: L, shape (k, nv) [N, N m].
        columns: D, shape (n, nv).
        torques: "each", "one" or "affine".
        components: Pushes at the corners, shape (k, d); for "affine".
        margin: What is kept; None: it is maximised.
        ways: What s adds; with a margin.
        free: The same of a further number r, up to `at_most` of either sign, which adds r times these.
        at_most: Larger s are not looked for.
        turns: {number of a column: (what it changes in P, shape (nv, p), and in the loads at corners, shape (k, nv))}.
        repair: What products of columns that turn miss, and how that is repaired, is taken off the margins of forces.
    """
    import clarabel

    balance, sets = loads.balance, loads.balance.sets
    robot, U, P = balance.state.robot, balance.unit, balance.per_weight
    nv, p = P.shape
    (k, n), nu, motors = (len(corners), len(columns)), len(robot.actuated), robot.actuated
    S = np.zeros((nv, nu))
    S[motors, np.arange(nu)] = 1.0
    low, high = (np.asarray(x) / U for x in loads.limits)
    limited = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    cones = sets.cone_columns
    bounded = np.array([j for j in range(p) if j not in set(cones.ravel().tolist())], int)
    own, d = torques == "each", 0 if components is None or torques != "affine" else components.shape[1]

    count = 0

    def new(*shape: int) -> Array:
        nonlocal count
        out = count + np.arange(int(np.prod(shape))).reshape(shape)
        count += out.size
        return out

    s, r, x, F = new(1), new(int(free is not None)), new(k, p), new(k, n, p)
    tau, change = (new(k, nu), new(k, n, nu)) if own else (new(1, nu), new(k, 0, nu))
    K, sizes, lengths, torque_sizes = new(d, nu), new(k, n, p), new(k, n, len(cones)), new(*change.shape)
    one, I = np.ones((1, 1)), np.eye(max(p, nu, 1))
    turned, X = dict(turns or {}), np.zeros((p, 0)) if repair is None else repair.sizes
    fixes, absolute, R = new(k, X.shape[1]), new(k, p * (repair is not None)), loads.forces_radius
    wide = sum((np.abs(S_i) for S_i, _ in turned.values()), np.zeros_like(P))
    nothing = Way(np.zeros_like(corners), np.zeros_like(columns))
    along, beside = ways or nothing, free or nothing
    along_columns, beside_columns = ([way.slopes(v) for v in range(k)] for way in (along, beside))
    spreads = np.broadcast_to(along.radius, nv)[:, None] / U
    fixed, takes = (0.0, 1.0) if margin is None else (margin / U, 0.0)
    all_sizes, keep, more = np.ones((1, n)), np.full((1, 1), takes), np.ones((1, change.shape[1]))

    equal, above, round_ = _Rows(), _Rows(), _Rows()  # equations; rows at most their sides; cones of three rows, axis first
    for v in range(k):
        law = [(S, tau[v if own else 0])] + [(S * components[v, i], K[i]) for i in range(d) if components is not None]
        ends = [(-along.corners[v][:, None] / U, s), *([(-beside.corners[v][:, None] / U, r)] if len(r) else [])]
        squares = [(0.5 * S_i, F[v, i]) for i, (S_i, _) in turned.items()]
        equal.add([(P, x[v]), *squares, *law, *ends], corners[v] / U)
    for v in range(k):
        for i in range(n):
            law = [(S, change[v, i])] if own else []
            law += [(turned[i][0], x[v])] if i in turned else []
            ends = [(-along_columns[v][i][:, None] / U, s), *([(-beside_columns[v][i][:, None] / U, r)] if len(r) else [])]
            side = columns[i] + (turned[i][1][v] if i in turned else 0.0)
            equal.add([(P, F[v, i]), *law, *ends], side / U)
            for sign in (1.0, -1.0):
                above.add([(sign * I[:p, :p], F[v, i]), (-I[:p, :p], sizes[v, i])], np.zeros(p))
                if own:
                    above.add([(sign * I[:nu, :nu], change[v, i]), (-I[:nu, :nu], torque_sizes[v, i])], np.zeros(nu))
            for c, (a, b, _) in enumerate(cones):
                round_.add([(-np.eye(3), np.array([lengths[v, i, c], F[v, i, a], F[v, i, b]]))], np.zeros(3))
        for c, ((a, b, t), mu) in enumerate(zip(cones, sets.mu, strict=True)):
            axis = np.concatenate([[x[v, t]], sizes[v, :, t], lengths[v, :, c], s])
            weights = np.concatenate([[-mu], np.full(n, mu), np.ones(n), [takes]])
            matrix = np.zeros((3, len(axis) + 2))
            matrix[0, :-2], matrix[1, -2], matrix[2, -1] = weights, -1.0, -1.0
            shift = np.vstack([mu * X[t] + X[a] + X[b], np.zeros((2, X.shape[1]))])
            round_.add([(matrix, np.concatenate([axis, [x[v, a], x[v, b]]])), (shift, fixes[v])], np.array([-fixed, 0.0, 0.0]))
        for j in bounded:
            for sign, end in ((-1.0, -sets.lower[j]), (1.0, sets.upper[j])):
                if np.isfinite(end):
                    row = [(sign * one, x[v, j : j + 1]), (all_sizes, sizes[v, :, j]), (X[j : j + 1], fixes[v]), (keep, s)]
                    above.add(row, np.array([end / U - fixed]))
        for j in limited if own or d or v == 0 else []:
            law = [(one, tau[v if own else 0, j : j + 1])]
            law += [(one * components[v, i], K[i, j : j + 1]) for i in range(d) if components is not None]
            unsure, at_row = list[tuple[Array, Array]](), motors[j : j + 1]
            if repair is not None and own and wide[at_row].any():  # products and repair move torques
                either = wide[at_row] + R[at_row]
                unsure = [((np.abs(P[at_row]) + either) @ X, fixes[v]), (R[at_row], absolute[v])]
                unsure += [(either, sizes[v, i]) for i in range(n)]
            for sign, end in ((-1.0, -low[j]), (1.0, high[j])):
                if np.isfinite(end):
                    row = [*[(sign * m, at) for m, at in law], (more, torque_sizes[v, :, j]), (keep, s)]
                    above.add([*row, *unsure], np.array([end - fixed]))
    if repair is not None:
        idle = robot.unactuated
        for v in range(k):
            spent = [(R[idle], absolute[v]), *[(R[idle], sizes[v, i]) for i in range(n)]]
            for sign in (1.0, -1.0):
                above.add([(sign * I[:p, :p], x[v]), (-I[:p, :p], absolute[v])], np.zeros(p))
            for i, (S_i, _) in turned.items():
                for j in range(n):
                    if j in turned and j < i:
                        continue
                    turns_i = [(S_i[idle] * (0.5 if i == j else 1.0), F[v, j])]
                    turns_i += [(turned[j][0][idle], F[v, i])] if j in turned and j != i else []
                    at_rows = np.flatnonzero(sum(np.abs(part).sum(axis=1) for part, _ in turns_i) > 0.0)
                    product = new(len(at_rows))
                    for sign in (1.0, -1.0):
                        chosen = [(sign * part[at_rows], of) for part, of in turns_i]
                        above.add([*chosen, (-np.eye(len(at_rows)), product)], np.zeros(len(at_rows)))
                    spent.append((np.eye(len(idle))[:, at_rows], product))
            left = repair.error - np.eye(len(idle))
            above.add([*spent, (left, fixes[v]), (spreads[idle], s)], -loads.load_radius[idle] / U)
    above.add([(one, s)], np.array([_ENOUGH if margin is None else min(at_most, _FARTHEST)]))
    above.add([(-one, s)], np.array([_LEAST if margin is None else 0.0]))
    if len(r):
        above.add([(np.array([[1.0], [-1.0]]), r)], np.full(2, min(at_most, _FARTHEST)))

    rows = [equal, above, round_]
    offsets = np.cumsum([0, *[r.count for r in rows]])
    parts = [(at + o, of, m) for r, o in zip(rows, offsets[:-1], strict=True) for at, of, m in r.parts]
    at, of, values = (np.concatenate([part[i] for part in parts]) for i in range(3))
    M = sparse.csc_matrix((values, (at, of)), shape=(int(offsets[-1]), count))
    side = np.concatenate([np.zeros(0), *[each for r in rows for each in r.sides]])
    g = np.zeros(count)
    g[s] = -1.0
    kinds = [clarabel.ZeroConeT(equal.count), clarabel.NonnegativeConeT(above.count)]
    kinds += [clarabel.SecondOrderConeT(3)] * (round_.count // 3)
    settings = clarabel_settings(_TOLERANCE)
    settings.time_limit = np.inf  # its steps end it: on a busy machine a proof has as many parts as on an idle one
    found = clarabel.DefaultSolver(sparse.csc_matrix((count, count)), g, M, side, kinds, settings).solve()
    X, z = np.asarray(found.x), np.asarray(found.z)
    if "Infeasible" in str(found.status) or not (np.isfinite(X).all() and np.isfinite(z).all()):
        X = np.full(count, np.nan)
    value = -np.inf if np.isnan(X).any() else float(X[s[0]]) * (U if margin is None else 1.0)
    none = np.zeros((nu, 0))
    return Held(
        value, X[x] * U, X[F] * U, X[tau[0]] * U if not own else np.zeros(0), X[K].T * U if d else none,
        -z[: k * nv].reshape(k, nv), float(X[r].sum()),
    )  # fmt: skip
