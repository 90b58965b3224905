"""Motions of points that already slide: one, none or several (Painleve's paradox).

The force on a sliding point is N (-mu t, 1), N >= 0, and its normal acceleration is y = D N + y_0, with
D = n^T J M^-1 J^T (n - mu t). Friction couples tangent and normal, so D is not symmetric: the force may pull the point down
more than it pushes it up. Where D < 0 a point that would leave anyway (y_0 > 0) may also stay, and one that would sink has
no answer among accelerations. Source: [Painleve1895]; [GenotBrogliato1999] for the regions of the rod.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, islice, product

import numpy as np

from rbd.arrays import SQUARED, Array, max_abs, null_space
from rbd.problem.answer import Answer
from rbd.problem.contact_motion import Sliding
from rbd.problem.gauss_problem import COULOMB, GaussProblem, checked
from rbd.problem.residuals import SOLVED
from rbd.solvers.complementarity import SAME, Mixed, all_solutions
from rbd.solvers.kkt import constrained
from rbd.solvers.newton import scaled, solve_newton, steps_from
from rbd.solvers.refinement import NEAR, by_newton, refined

STARTS = 64
"""Largest number of loaded/separating combinations as Newton's starts, where contacts at rest have friction too."""
COMPLIANCES = tuple(10.0 ** (-0.5 * i) for i in range(2, 15))
"""Sequence of the points' compliances, over their mobility: from 0.1 to 1e-7."""

_OF_MANY = "with so many sliding points not all motions were searched: this is the limit as the points' compliance vanishes"


@dataclass(frozen=True, eq=False)
class SlidingAnswers:
    """The motions that satisfy Coulomb's law.

    Attributes:
        found: (a, f, w) with different motions, of shapes (nv,), (m,), (p,): acceleration, row forces, weights of
            `problem.force_set`. The first has the least Gauss function 1/2 |a - a_free|_M^2. Of two motions, leaving
            comes before contact, as on slightly compliant ground: where the contact force lets a point sink,
            compliant ground has no stable equilibrium. Where the friction depends on how a patch shares its load, and
            that is undetermined, a family of motions is represented by the one with weights of minimum norm; its ends
            come last.
        complete: Whether there are no others.
        reason: Message: why there is none, or which several there are; empty where there is one.
    """

    found: tuple[tuple[Array, Array, Array], ...]
    complete: bool
    reason: str


def sliding_answers(problem: GaussProblem) -> SlidingAnswers:
    """All motions, under Coulomb's law, of a problem whose contacts may slide already.

    Without friction at contacts at rest this is exact: all solutions of the complementarity problem of the weights, by
    `rbd.solvers.complementarity`. Otherwise: the answers of Newton's method from every combination of loaded and separating
    sliding contacts; then `complete` is False.

    Every answer is within 1e-9, scaled, by `rbd.problem.residuals`.

    Raises:
        InputError: if it is no GaussProblem.
    """
    P = checked(problem)
    if P.force_set.impact:
        return SlidingAnswers((), True, P.force_set.impact)
    return _Search(P).answers()


class _Search:
    """One problem y = A w + b, with V from weights to motion: |V dw| is the change of a in the metric of inertia."""

    def __init__(self, P: GaussProblem) -> None:
        T = P.force_set
        self.P, self.T = P, T
        A, b = T.H.T @ P.delassus @ T.G, T.H.T @ P.free_row_acceleration + T.offset
        # Columns of cones at rest have no bounds: initially lines, as of sticking contacts.
        self.mixed = Mixed(A, b, P.whitened @ T.G, T.lower, T.upper, [s.column for s in T.sliding])

    def answers(self) -> SlidingAnswers:
        """All motions found, in order."""
        found = all_solutions(self.mixed)
        good = [i for i, w in enumerate(found.weights) if self._holds(w)]
        family = any(found.family[i] for i in good)
        good.sort(key=lambda i: (found.member[i], self._gauss(found.weights[i])))
        weights = [self.T.project(found.weights[i]) for i in good]
        complete, even = found.complete and not family and len(good) == len(found.weights), family
        if not (found.complete or weights):
            weights = [w for w in self._yielding() if self._holds(w)]
            if weights and not len(self.T.mu):
                answer = self._certified(weights[0])
                assert answer.weights is not None
                return SlidingAnswers(((answer.a, answer.multipliers, answer.weights),), False, _OF_MANY)
        if len(self.T.mu):
            weights, complete = self._by_newton(found.weights, weights, family), False
        undecided = [name for w in weights for name in self._undecided(w)]
        certified = [self._certified(w) for w in weights]
        answers = tuple((s.a, s.multipliers, s.weights) for s in certified if s.weights is not None)
        if not answers:
            return SlidingAnswers((), complete, self._why_none(complete))
        if family or (undecided and len(self.T.mu)):
            return SlidingAnswers(answers, False, self._family_words(undecided, even))
        return SlidingAnswers(answers, complete, self._several_words(weights) if len(answers) > 1 else "")

    def _holds(self, w: Array) -> bool:
        return self._certified(w).residuals.within(SOLVED)

    def _certified(self, w: Array) -> Answer:
        """The answer of given weights, refined where they are near a solution."""
        w = self.T.project(w)
        f = self.T.G @ w
        found = Answer(self.P, constrained(self.P, f), f, w, COULOMB, "ConeSolver", 1, 0.0)
        if found.residuals.within(SOLVED) or not found.residuals.within(NEAR):
            return found
        S = scaled(self.mixed.A, self.mixed.b, self.T)
        return refined(found, by_newton(S, self.T, coulomb=True), self.T)

    def _gauss(self, w: Array) -> float:
        moved = self.mixed.V @ w
        return 0.5 * float(moved @ moved)

    def _by_newton(self, stuck: tuple[Array, ...], known: list[Array], family: bool) -> list[Array]:
        """Weights of further motions by Newton's method, from starts with patches loaded or not."""
        new: list[Array] = []
        V = self.mixed.V
        for w0 in self._starts(stuck):
            w = solve_newton(self.mixed.A, self.mixed.b, self.T, w0, coulomb=True)[0]
            size = max(1.0, float(np.linalg.norm(V @ w)))
            if all(np.linalg.norm(V @ (u - w)) > SAME * size for u in known + new) and self._holds(w):
                new.append(self.T.project(w))
        if not family:
            return sorted(known + new, key=self._gauss)
        return known + sorted(new, key=self._gauss)  # the member of minimum norm is known; these are other members

    def _yielding(self) -> Iterator[Array]:
        """Limits of the answers with compliant points as the compliance vanishes, as far as Newton's method follows.

        With compliance k on the diagonal of the scaled A answers are isolated, and each is a guess of the next one's modes.
        """
        S = scaled(self.mixed.A, self.mixed.b, self.T)
        w = np.zeros(len(S.q))
        for k in COMPLIANCES:
            w, merit, _ = steps_from(S, w, coulomb=True, iterations=60, proximal=0.0, soft=k)
            if merit > 1e-10:
                return
        yield self.T.project(S.weights(w))

    def _undecided(self, w: Array) -> list[str]:
        """The contacts whose loads can change together with the motion, each contact point staying in its mode."""
        M, T = self.mixed, self.T
        scale, y, small = float(np.abs(M.A.diagonal()).max()), M.A @ w + M.b, 1e-9 * max_abs(w)
        free = (w > M.lower + small) & (w < M.upper - small)
        K = np.where(free[:, None], M.A, scale * np.eye(len(w)))  # K dw = 0 preserves the modes: y = 0, or w where it is
        for i, mu in zip(T.cone_at.tolist(), T.mu.tolist(), strict=True):
            at, t, n, rate = slice(i, i + 2), float(np.hypot(w[i], w[i + 1])), float(w[i + 2]), float(np.hypot(y[i], y[i + 1]))
            if n <= small:
                K[i : i + 3] = scale * np.eye(len(w))[i : i + 3]
            elif t > (1.0 - 1e-6) * mu * n and rate > 1e-9 * max_abs(M.b):  # slips: w_t = -mu w_n d, d along y_t
                d = y[at] / rate
                turns = scale * mu * n / rate * (np.eye(2) - np.outer(d, d)) @ M.A[at]
                K[at] = turns
                K[at, at] += scale * np.eye(2)
                K[at, i + 2] += scale * mu * d
                K[at] /= 1.0 + scale * mu * n / rate
        N = null_space(K, SQUARED)
        _, moved, turned = np.linalg.svd(M.V @ N, full_matrices=False)
        changes = N @ turned[moved > 1e-5 * np.sqrt(scale)].T
        return [r.name for r, c in zip(self.P.rows, T.slices, strict=True) if max_abs(changes[c].ravel()) > 1e-6]

    def _starts(self, stuck: tuple[Array, ...]) -> Iterator[Array]:
        """Weights with the contacts at rest stuck, and every combination of sliding patches loaded or not."""
        M = self.mixed
        yield from (self.T.project(w) for w in stuck)
        groups = list(_groups(self.T.sliding).values())
        for presses in islice(product((True, False), repeat=len(groups)), STARTS):
            free = np.isinf(M.lower) & np.isinf(M.upper)
            free[[s.column for group, on in zip(groups, presses, strict=True) if on for s in group]] = True
            w = np.where(free, 0.0, np.where(np.isfinite(M.lower), M.lower, M.upper))
            w[free] = np.linalg.lstsq(M.A[np.ix_(free, free)], -(M.A @ w + M.b)[free], rcond=1e-10)[0]
            yield self.T.project(w)
        yield self.T.project(np.zeros(len(M.b)))

    def _why_none(self, complete: bool) -> str:
        """Message naming the conflict: bilateral rows, points that sink under more normal force, or all sliding points."""
        M, sliding = self.mixed, self.T.sliding
        what = "no motion" if complete else "no motion found, though not all were searched"
        own = np.array([s.column for s in sliding], int)
        D = M.A[np.ix_(own, own)]
        holds = np.isinf(M.lower) & np.isinf(M.upper)
        holds[self.T.cone_columns.ravel()] = False
        if holds.any():
            inner, free = M.A[np.ix_(holds, holds)], M.b[holds]
            inverse = np.linalg.pinv(inner, rcond=1e-10)
            if max_abs(inner @ (inverse @ free) - free) > 1e-6 * max(1.0, max_abs(free)):
                names = [r.name for r, c in zip(self.P.rows, self.T.slices, strict=True) if holds[c].any()]
                return f"{what}: bilateral rows contradict each other, among {_listed(map(repr, names))}"
            D = D - M.A[np.ix_(own, holds)] @ inverse @ M.A[np.ix_(holds, own)]
        at, value = _sinking(D)
        if not at:
            names_of = _listed(_name(s, sliding) for s in sliding)
            return f"{what}: of {names_of} (sliding) neither contact nor breaking satisfies the law"
        one, names_of = len(at) == 1, _listed(_name(sliding[i], sliding) for i in at)
        return (
            f"{what}: {names_of} {'slides' if one else 'slide'} at {sliding[at[0]].speed:.3g} m/s, and a larger normal "
            f"force makes {'it' if one else 'them'} sink faster (Painleve's paradox: "
            f"n . J M^-1 J^T (n - mu t) = {value:.3g} < 0 at mu = {sliding[at[0]].mu:g}); only an impact without collision, "
            "which no acceleration is, or less friction would end it"
        )

    def _several_words(self, weights: list[Array]) -> str:
        """Message: what the sliding contacts do in each motion."""
        tells, groups = [], _groups(self.T.sliding)
        for w in weights[:4]:
            load = {name: sum(float(w[s.column]) for s in group) for name, group in groups.items()}
            leaves = {name: N <= 1e-9 * max_abs(w) for name, N in load.items()}
            tells.append(", ".join(f"{n!r} leaves" if leaves[n] else f"{n!r} carries {load[n]:.4g} N" for n in load))
        listed = "; ".join(f"({i}) {tell}" for i, tell in enumerate(tells, 1))
        more = f"; and {len(weights) - 4} more" if len(weights) > 4 else ""
        return f"{len(weights)} motions satisfy Coulomb's law: {listed}{more}"

    def _family_words(self, undecided: list[str], even: bool) -> str:
        names = _listed(repr(name) for name in dict.fromkeys(undecided or _groups(self.T.sliding)))
        which = (
            "the first shares it most evenly (least norm), the last are ends of the family"
            if even
            else "the first is one of them"
        )
        return (
            f"a family of motions satisfies Coulomb's law: rigid bodies do not determine how the points of {names} share the "
            f"load, and the friction depends on it; {which}"
        )


def _sinking(D: Array) -> tuple[tuple[int, ...], float]:
    """Smallest set of points that accelerate downwards under a newton shared among them, and how fast; () if none."""
    for size in range(1, min(len(D), 4) + 1):
        means = {at: float(D[np.ix_(at, at)].mean()) for at in islice(combinations(range(len(D)), size), 2000)}
        worst = min(means, key=lambda at: means[at])
        if means[worst] < 0.0:
            return worst, means[worst]
    return (), 0.0


def _groups(sliding: tuple[Sliding, ...]) -> dict[str, list[Sliding]]:
    """{rows: their points that slide}."""
    out: dict[str, list[Sliding]] = {}
    for s in sliding:
        out.setdefault(s.rows, []).append(s)
    return out


def _name(point: Sliding, sliding: tuple[Sliding, ...]) -> str:
    alone = sum(s.rows == point.rows for s in sliding) == 1
    return repr(point.rows) if alone else f"corner {point.corner} of {point.rows!r}"


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    if len(every) > 4:
        return ", ".join(every[:4]) + f" and {len(every) - 4} more"
    return " and ".join(filter(None, (", ".join(every[:-1]), every[-1])))
