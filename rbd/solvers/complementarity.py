"""All solutions of a small mixed linear complementarity problem, by a tree of modes.

Find w with lower <= w <= upper and y = A w + b such that each entry is in a mode:

    FREE   y = 0, lower <= w <= upper
    LOW    w = lower, y >= 0
    HIGH   w = upper, y <= 0

An entry without bounds is always FREE, one with lower = upper is fixed and its y does not matter. A need not be
symmetric. Solutions differ only if their motions V w do: weights with the same motion are the same solution.

A node of the tree fixes modes of some entries. Two solutions w, w' of it have (w - w')^T A (w - w') <= 0 and equal zero y on
the entries that are FREE; where that implies V (w - w') = 0 the node has at most one motion, found by
pivoting. Else the tree branches. So a problem whose symmetric part is positive definite costs one pivoting, and the worst case
all its modes. Source: [CottlePangStone1992], chapters 3 (uniqueness) and 4 (pivoting).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import SQUARED, Array, null_space
from rbd.problem import programs
from rbd.problem.programs import Work, least_distance
from rbd.solvers import qp

FREE, LOW, HIGH, OPEN = 0, 1, 2, -1
"""Modes of an entry; OPEN is undecided."""

SAME = 1e-7
"""Motions nearer to each other than this, relative, are one."""

_SVD, _PROGRAM = 20.0, 2e6
"""Multiplications of an SVD, over the cube of its size; cost of a linear program beyond ten times that."""


@dataclass(frozen=True, eq=False)
class Mixed:
    """The problem.

    Attributes:
        A: Shape (p, p).
        b: Shape (p,).
        V: Takes weights to the motion, shape (n, p); |V dw| = 0 means the same motion.
        lower: Shape (p,); -inf where there is none.
        upper: Shape (p,); inf where there is none.
        first: Entries to branch on first.
        budget: Nodes of the tree to visit at most.
        work: Multiplications in them at most.
    """

    A: Array
    b: Array
    V: Array
    lower: Array
    upper: Array
    first: Sequence[int] = ()
    budget: int = programs.MODE_NODES
    work: float = programs.MODE_WORK


@dataclass(frozen=True, eq=False)
class FoundSolutions:
    """Solutions of different motion.

    Attributes:
        weights: One solution a motion, of least norm in its mode, shape (p,) each.
        family: For each, whether its mode contains a family of motions; it is then the one of least norm.
        member: For each, whether it belongs to the family of another, e.g. as an end of it.
        complete: Whether every solution was found, apart from inner members of families.
    """

    weights: tuple[Array, ...]
    family: tuple[bool, ...]
    member: tuple[bool, ...]
    complete: bool


def all_solutions(problem: Mixed) -> FoundSolutions:
    """Every motion that solves the problem, within budget and work."""
    tree = _Tree(problem)
    tree.visit(tree.root)
    member = [tree.belongs(i) for i in range(len(tree.weights))]
    return FoundSolutions(tuple(tree.weights), tuple(tree.family), tuple(member), not tree.cut)


@dataclass
class _Tree:
    problem: Mixed
    weights: list[Array] = field(default_factory=list)
    family: list[bool] = field(default_factory=list)
    modes: list[Array] = field(default_factory=list)
    visited: int = 0
    cut: bool = False

    def __post_init__(self) -> None:
        P = self.problem
        self.work = Work(P.work)
        self.fixed = P.lower == P.upper
        lines = ~np.isfinite(P.lower) & ~np.isfinite(P.upper)
        self.root = np.where(lines, FREE, np.where(self.fixed, LOW, OPEN))
        self.scale = float(np.abs(P.A.diagonal()).max(initial=0.0)) or 1.0
        bounds = np.concatenate([P.lower[np.isfinite(P.lower)], P.upper[np.isfinite(P.upper)]])
        # Scale of accelerations; without free ones, those of forces at their bounds.
        self.load = float(np.abs(P.b).max(initial=0.0)) or self.scale * float(np.abs(bounds).max(initial=0.0)) or 1.0
        chosen = [i for i in P.first if self.root[i] == OPEN]
        self.order = chosen + [i for i in np.flatnonzero(self.root == OPEN).tolist() if i not in chosen]
        self.low, self.high = np.isfinite(P.lower), np.isfinite(P.upper)

    def visit(self, modes: Array) -> bool:
        """Search below a node; True if the node has one motion and it was found."""
        self.visited += 1
        if self.visited > self.problem.budget or self.work.left < 0.0:
            self.cut = True
            return False
        undecided = [i for i in self.order if modes[i] == OPEN]
        if not undecided:
            return self._leaf(modes)
        single = self._one_motion(modes)
        settled = self._pivot(modes) if single else None
        if settled is not None:
            return settled
        if len(undecided) > 4 and self._infeasible(modes):
            return False
        i, found = undecided[0], False
        for mode, possible in ((FREE, True), (LOW, self.low[i]), (HIGH, self.high[i])):
            if possible and not (found and single):
                branch = modes.copy()
                branch[i] = mode
                found = self.visit(branch) or found
        return found and single

    def _leaf(self, modes: Array) -> bool:
        w, _, motions = self.solve(modes)
        if w is None:
            return False
        self._keep(w, modes, motions > 0)
        return True

    def _keep(self, w: Array, modes: Array, family: bool) -> None:
        V = self.problem.V
        motion = V @ w
        for other in self.weights:
            gap = float(np.linalg.norm(V @ (w - other)))
            if gap <= SAME * max(float(np.linalg.norm(motion)), self.load / math.sqrt(self.scale)):
                return
        self.weights.append(w)
        self.family.append(family)
        self.modes.append(modes)

    def belongs(self, i: int) -> bool:
        """Whether the i-th solution meets the equations of the mode of an earlier family."""
        P, w = self.problem, self.weights[i]
        y = P.A @ w + P.b
        slack_w, slack_y = self._rounding(w)
        for family, modes in zip(self.family[:i], self.modes[:i], strict=True):
            off = np.where(modes == LOW, w - P.lower, w - P.upper)[(modes != FREE) & ~self.fixed]
            still = y[modes == FREE]
            if family and np.abs(off).max(initial=0.0) <= slack_w and np.abs(still).max(initial=0.0) <= slack_y:
                return True
        return False

    def _one_motion(self, modes: Array) -> bool:
        """Whether the modes decided so far leave one motion at most, whatever the remaining modes (at least one)."""
        P = self.problem
        moving = np.flatnonzero(modes <= FREE)  # FREE or OPEN
        A, free = P.A[np.ix_(moving, moving)], modes[moving] == FREE
        N = null_space(A[free], SQUARED)
        self.work.spend(_SVD * float(len(moving)) ** 3)
        size, turned = np.linalg.eigh(0.5 * N.T @ (A + A.T) @ N)
        if size[0] < -SQUARED * self.scale:
            return False
        still = P.V[:, moving] @ (N @ turned[:, size <= SQUARED * self.scale])
        # |V z|^2 = z^T A z where A is symmetric: zero to 1e-11 is zero to its root in V.
        return bool(np.abs(still).max(initial=0.0) <= 10.0 * math.sqrt(SQUARED * self.scale))

    def _infeasible(self, modes: Array) -> bool:
        """Whether a linear program finds no w that meets the signs, ignoring complementarity."""
        P = self.problem
        # Diagonal entries of size one, where they are not near zero: HiGHS works to 1e-7.
        size = 1.0 / np.sqrt(np.maximum(np.abs(P.A.diagonal()), 1e-6 * self.scale))
        unit = self.load / math.sqrt(self.scale)
        A, b = size[:, None] * P.A * size, size * P.b / unit
        lower, upper = P.lower / (size * unit), P.upper / (size * unit)
        moving, decided = modes <= FREE, (modes > FREE) & ~self.fixed
        base = np.where(modes == LOW, P.lower, np.where(modes == HIGH, P.upper, 0.0)) / (size * unit)
        known = A @ np.where(moving, 0.0, base) + b
        A, I = A[:, moving], np.eye(len(b))[:, moving]
        has_low, has_high = moving & self.low, moving & self.high
        up = (decided & (modes == LOW)) | ((modes == OPEN) & self.low & ~self.high)  # y >= 0
        down = (decided & (modes == HIGH)) | ((modes == OPEN) & self.high & ~self.low)
        C = np.vstack([I[has_low], -I[has_high], A[up], -A[down]])
        l = np.concatenate([lower[has_low], -upper[has_high], -known[up], known[down]])
        free = modes == FREE
        self.work.spend(_PROGRAM + 10.0 * _SVD * float(len(b)) ** 3)
        violation = qp.least_violation(A[free], -known[free], C, l)
        return violation > 1e-6

    def _pivot(self, modes: Array) -> bool | None:
        """Whether a node with at most one motion has one; None where pivoting does not decide.

        Principal block pivoting from all undecided entries FREE; single entries where blocks do not help.
        """
        P = self.problem
        undecided = np.flatnonzero(modes == OPEN)
        now = np.where(modes == OPEN, FREE, modes)
        fewest, patience = len(now) + 1, 5
        for _ in range(3 * len(undecided) + 10):
            w, trial, motions = self.solve(now)
            if w is not None:
                self._keep(w, now, motions > 0)
                return True
            if trial is None or self.work.left < 0.0:
                return None
            y = P.A @ trial + P.b
            state, x, z = now[undecided], trial[undecided], y[undecided]
            new = np.select(
                [(state == FREE) & (x < P.lower[undecided]), (state == FREE) & (x > P.upper[undecided]),
                 (state == LOW) & (z < 0.0), (state == HIGH) & (z > 0.0)],
                [LOW, HIGH, FREE, FREE], state,
            )  # fmt: skip
            wrong = np.flatnonzero(new != state)
            if not len(wrong):  # the node's one motion violates the modes fixed so far, unless other weights satisfy them
                touches = undecided[np.abs(z) <= self._rounding(trial)[1]]
                now = now.copy()
                now[touches] = FREE
                return self._leaf(now)
            if len(wrong) < fewest:
                fewest, patience = len(wrong), 5
            elif patience:
                patience -= 1
            else:
                wrong = wrong[-1:]  # Murty's rule: it ends where A is a P-matrix
            now = now.copy()
            now[undecided[wrong]] = new[wrong]
        return None

    def solve(self, modes: Array) -> tuple[Array | None, Array | None, int]:
        """(w, trial, motions) of a full assignment of modes.

        w meets all of its signs and is of least norm, or is None; trial meets its zeros alone, or is None; motions is the
        number of directions in which the motion can vary within the mode.
        """
        P = self.problem
        E = np.flatnonzero(modes == FREE)
        w = np.where(modes == LOW, P.lower, np.where(modes == HIGH, P.upper, 0.0))
        y = P.A @ w + P.b
        if not len(E):
            return (w if self._signs(w, y, modes) else None), w, 0
        A = P.A[np.ix_(E, E)]
        self.work.spend(_SVD * float(len(E)) ** 3)
        U, s, Vt = np.linalg.svd(A)
        kept = s > SQUARED * max(float(s[0]), SQUARED * self.scale)
        inverse = (Vt[kept].T / s[kept]) @ U[:, kept].T
        x = -inverse @ y[E]
        x -= inverse @ (A @ x + y[E])  # one step of refinement
        w[E] = x
        y = P.A @ w + P.b
        if np.abs(y[E]).max() > 100.0 * self._rounding(w)[1]:
            return None, None, 0  # these zeros contradict each other
        if kept.all():
            return (w if self._signs(w, y, modes) else None), w, 0
        N = np.zeros((len(w), int((~kept).sum())))
        N[E] = Vt[~kept].T
        moved = P.V @ N
        motions = int(np.linalg.matrix_rank(moved, tol=10.0 * math.sqrt(SQUARED * self.scale)))
        z = self._inside(w, y, N, modes)
        return (None if z is None else w + N @ z), w, motions

    def _signs(self, w: Array, y: Array, modes: Array) -> bool:
        """Whether bounds and signs are met, up to rounding."""
        P = self.problem
        slack_w, slack_y = self._rounding(w)
        away = (y * np.where(modes == LOW, 1.0, -1.0))[(modes != FREE) & ~self.fixed]
        return bool((w >= P.lower - slack_w).all() and (w <= P.upper + slack_w).all() and (away >= -slack_y).all())

    def _rounding(self, w: Array) -> tuple[float, float]:
        """Tolerances of weights, and of accelerations."""
        size = float((np.abs(self.problem.A) @ np.abs(w)).max(initial=0.0))
        return 1e-9 * max(self.load / self.scale, float(np.abs(w).max(initial=0.0))), 1e-9 * max(self.load, size)

    def _inside(self, w: Array, y: Array, N: Array, modes: Array) -> Array | None:
        """The least z for which w + N z meets the signs, or None: least distance by nonnegative least squares."""
        P = self.problem
        AN, free = P.A @ N, modes == FREE
        low, high = free & self.low, free & self.high
        up, down = (modes == LOW) & ~self.fixed, (modes == HIGH) & ~self.fixed
        C = np.vstack([N[low], -N[high], AN[up] / self.scale, -AN[down] / self.scale])
        d = np.concatenate([P.lower[low] - w[low], w[high] - P.upper[high], -y[up] / self.scale, y[down] / self.scale])
        unit = max(self.load / self.scale, float(np.abs(w).max(initial=0.0)))
        d = d / unit - 1e-12  # z in units of w; with a margin, so that exact equality does not fail by rounding
        flat = np.abs(C).max(axis=1, initial=0.0) < 1e-9
        if (d[flat] > 1e-9).any():
            return None
        if (d <= 0.0).all():
            return np.zeros(N.shape[1])
        found = least_distance(C[~flat], d[~flat])
        return None if found is None else unit * found[0]
