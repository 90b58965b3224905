"""Coulomb's law, or its convex relaxation, with circular cones: Pinocchio's ADMM, refined by Newton's method."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, lapack, lazy, max_abs
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.problem.answer import Answer
from rbd.problem.cones import pyramid
from rbd.problem.force_set import ForceSet
from rbd.problem.gauss_problem import CONVEX, COULOMB, GaussProblem, Law, checked
from rbd.problem.programs import SEARCH_WORK, Work
from rbd.problem.residuals import SOLVED
from rbd.solvers import qp
from rbd.solvers.conic_newton import interior_point
from rbd.solvers.kkt import KKT, constrained, independent_factor
from rbd.solvers.newton import FOUND, Scaled, family_limit, scaled, steps_from, yielding_steps
from rbd.solvers.pinocchio_admm import admm
from rbd.solvers.refinement import NEAR, by_newton, refined

_FACETS = 16
"""Facets of the inscribed pyramids that replace cones in the linear program of infeasibility."""
OPEN = (
    "rigid bodies do not determine how the points that slip share their load, and friction depends on it: of the motions "
    "that satisfy the law, this is the limit of equally compliant points as the compliance vanishes"
)
"""`Answer.reason` where the answer is one of a family."""
HELD = (
    "Coulomb's law admits {n} motions here: this one, and one in which points stick that slide or leave in it, jammed by "
    "internal forces; it is the convex law's"
)
"""`Answer.reason` where the convex law's answer satisfies Coulomb's law too."""
_RANDOM_STARTS = 4
_MANY, _SPARSE = 300, 0.3
"""Columns from which on a problem is tried as a sparse one, and the share of D's entries that may differ from zero then."""
_FIXED_POINT_STEPS = 12
_COMPLIANCES = (1e-2, 1e-3, 1e-4)
"""Of proximal rounds from an interior point that is too coarse for Newton's method, as with a friction of 1e6."""


@dataclass(frozen=True, kw_only=True)
class ConeSolver(Displayed):
    """Solver with circular friction cones, for Coulomb's law or its convex relaxation, on the Delassus form of the problem.

    Weights w in the product of the sets (`problem.force_set`) with::

        y = D w + H^T (J a_free + offset) + centripetal part,    D = H^T J M^-1 J^T G
        convex:   y in K*, w . y = 0                             coulomb:   y + mu |y_t| n in K*, complementary to w

    and f = G w, a = a_free + M^-1 J^T f. Rows of any kind: lines, half-lines, intervals, second-order cones. D may be
    singular (four corners of a sole): then w is one of many.

    Methods are tried in this order until an answer's residuals are `solved`; its `method` names the one that succeeded::

        1  "closed form": the forces that give every row zero acceleration, if they are in their sets: one linear solve
        2  "cones: ADMM, Newton": Pinocchio's ADMM from there, to 1e-6, and semismooth Newton steps (`rbd.solvers.newton`),
           usually two
        3  "cones: Newton": from 1 alone; under Coulomb's law also from all contacts open, and from the convex law's ADMM
        4  a linear program: if no acceleration satisfies the rows, the answer is `infeasible`
        5  "cones: interior point, Newton": an interior-point method for the convex law, then Newton; for Coulomb's law as a
           fixed point on De Saxce's term
        6  Coulomb's law only, "cones: Newton" from random weights

    Before these, under Coulomb's law, "cones: sparse Newton" (`rbd.solvers.sparse_newton`) where a hundred contacts or more are
    between many bodies, so that most entries of D are zero. No other motion is then looked for.

    Points that already slide have no friction cone: "modes of sliding points" (`rbd.solvers.sliding`).

    The order is by cost; figures in `docs/design/admm.md`. Under the convex law the motion is unique. Under Coulomb's it
    need not be, nor need there be one where the convex law has none [Acary2011]. Where a sole slides on four corners, how
    they share its load, so the friction and the motion, is not determined by rigid bodies: the answer is the
    limit of equally compliant points, see `Solution.reason`. Where points slide or leave that stick under the
    convex law, its motion is tried too: if it satisfies Coulomb's law it is in `Solution.others` (a box that falls
    between two walls might also be jammed). Else the answer is the first one found.

    Attributes:
        law: "coulomb" (maximal dissipation, not a minimum) or "convex" (Gauss's principle).
        starts: Under Coulomb's law, the number of starts, 1 to 20. Above 1, the solver continues after its first answer,
            and different motions are in `Solution.others`; an empty list is no proof of uniqueness.

    Raises:
        InputError: if `law` is neither, or `starts` is not a whole number from 1 to 20.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> push = [rbd.ExternalForce("box", (80.0, 0.0, 0.0))]
        >>> state = rbd.State(box, [0, 0, 0.1, 0, 0, 0, 1])
        >>> for law in ("coulomb", "convex"):
        ...     solution = rbd.solve(state, [], [face], external=push, solver=rbd.ConeSolver(law=law))
        ...     print(solution.law, solution.a[:3].round(3) , solution.forces["face"][:3].round(2))
        coulomb [ 2.114 0.     0.   ] [-58.86  0.    98.1 ]
        convex [1.554 0.    0.933] [-64.46   0.   107.43]
    """

    law: Law | str = COULOMB
    starts: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.law, Law | str) or str(self.law) not in ("coulomb", "convex"):
            raise InputError(f"law is {self.law!r:.80}; expected 'coulomb' or 'convex'.")
        object.__setattr__(self, "law", Law.of(self.law))
        if isinstance(self.starts, bool) or not isinstance(self.starts, int | np.integer) or not 1 <= self.starts <= 20:
            raise InputError(f"starts is {self.starts!r:.80}; expected a whole number from 1 to 20.")

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Names a contact that approaches; under the convex law, one that slides."""
        T = checked(problem).force_set
        if T.impact:
            return f"{T.impact}."
        if self.law == CONVEX and T.sliding:
            point = T.sliding[0]
            return (
                f"{point.rows!r} slides at {point.speed:.3g} m/s: its friction follows its motion, which the convex law does "
                "not describe. Use rbd.ConeSolver(law='coulomb')."
            )
        return None

    def solve(self, problem: GaussProblem) -> Answer:
        """The first answer that is `solved`, else the best one found, with a message in `reason`.

        Points that already slide have no friction cone: `rbd.solvers.sliding` searches their modes.
        """
        return self.solve_from(problem, None)

    def solve_from(
        self, problem: GaussProblem, weights: Array | None, since: float | None = None, *, others: bool = True
    ) -> Answer:
        """The same, its second step started from weights of `problem.force_set`, e.g. those of another law's answer.

        Args:
            problem: The problem to solve.
            weights: Shape (p,); None for those of the first step.
            since: Start of the search that this continues, by `time.perf_counter`.
            others: Whether the convex law's motion is looked for beside Coulomb's; a time step takes the first answer.
        """
        start = time.perf_counter() if since is None else since
        P = checked(problem)
        if P.bilateral:
            return replace(KKT().solve(P), solver="ConeSolver")
        if P.force_set.sliding:
            return _of_sliding(P, start)
        return _ConeSearch(P, Law.of(self.law), start).run(self.starts if self.law == COULOMB else 1, weights, others)


def _of_sliding(P: GaussProblem, start: float) -> Answer:
    """The first motion of a problem with sliding points, the others in `others`; zero forces where there is none."""
    from rbd.solvers.sliding import sliding_answers  # imported only where points slide

    answers = sliding_answers(P)
    found = answers.found or ((P.a_free.copy(), np.zeros(P.m), np.zeros(P.force_set.size)),)
    seconds = time.perf_counter() - start
    solutions = [
        Answer(P, a, f, w, COULOMB, "ConeSolver", 1, seconds, reason=answers.reason, method="modes of sliding points")
        for a, f, w in found
    ]
    return replace(solutions[0], others=tuple(solutions[1:]))


class _ConeSearch:
    """One problem without sliding points: starts, their answers, and the best of them."""

    def __init__(self, P: GaussProblem, law: Law, start: float) -> None:
        self.P, self.law, self.start = P, law, start
        self.coulomb = law == COULOMB
        self.redundant = independent_factor(P.delassus) is None
        self.iterations = 0
        self.work, self.step = Work(SEARCH_WORK), float(P.force_set.size) ** 3 + 1e4
        self.infeasible = False
        self.method = "closed form"
        self.best: Answer | None = None
        self.answers: list[Answer] = []

    def run(self, wanted: int, weights: Array | None = None, others: bool = True) -> Answer:
        """The answer, after `wanted` starts or the first answer, whichever is later; started from weights, if given.

        With `others` the convex law's motion is looked for, too.
        """
        T = self.P.force_set
        if wanted == 1 and weights is None and self.coulomb and self.by_sparse_newton():
            return self.answers[0]
        w = holding(self.P)
        first = T.project(w)
        holds = wanted == 1 and max_abs(first - w) <= 1e-13 * max_abs(w)
        if holds and (self._judge(first) or self._judge(self._firmer(first))):
            return self.answers[0]
        S = self.S
        given = None if weights is None else S.guess(T.project(weights))
        for i, (guess, proximal) in enumerate(self._starts(S, S.guess(first), given)):
            if (self.answers and i >= wanted) or self.work.left < 0.0:
                break
            w, merit, steps = steps_from(S, guess, coulomb=self.coulomb, iterations=25 if i < 3 else 40, proximal=proximal)
            self.iterations += steps
            self.work.spend(steps * self.step)
            opened = False
            if self.coulomb and merit < FOUND:
                w, more, opened = family_limit(S, w)
                self.iterations += more
            if self._judge(T.project(S.weights(w)), OPEN if opened else "") and wanted == 1:
                break
        if others and self.coulomb and self.answers and self._might_hold(self.answers[0]):
            self._try_convex(S, S.guess(first))
        return self._result()

    def _might_hold(self, found: Answer) -> bool:
        """Whether another motion, in which every loaded point sticks, may satisfy Coulomb's law.

        Let that motion have forces f' and accelerations c', and the found one f and c. |a' - a|_M^2 = -f'.c - f.c' + f.c, and
        the last two are not positive. So some point of the found motion has c outside K*: it slides faster than it leaves.
        Where loaded points slide and rows are independent there is practically none: another solve is not worth its cost.
        """
        P, T, w = self.P, self.P.force_set, found.weights
        assert w is not None
        at = T.cone_columns
        y = T.accelerations(P.J @ found.a + P.offset, coulomb=False)[at]
        terms, push = found.residuals.scales.of_columns(w, self.law)
        slip, still = np.hypot(y[:, 0], y[:, 1]), SOLVED * terms[at].max(axis=1)
        slides = (slip > still) & (y[:, 2] < T.mu * slip - still)
        loaded = w[at][:, 2] > SOLVED * push[at][:, 2]
        return bool(slides.any()) and (not (slides & loaded).any() or self.redundant)

    def _try_convex(self, S: Scaled, first: Array) -> None:
        """Record the convex law's motion if it satisfies Coulomb's law too."""
        kept, T = len(self.answers), self.P.force_set
        for guess in (
            lambda: self._by_admm(S, first, False, 1000),
            lambda: self._by_interior_point(S, np.zeros(len(first))),
        ):
            w, merit, steps = steps_from(S, guess(), coulomb=False, iterations=40)
            self.iterations += steps
            if merit < FOUND:
                break
        if self._judge(T.project(S.weights(w))) and len(self.answers) > kept:
            reason = HELD.format(n=len(self.answers))
            self.answers[0] = replace(self.answers[0], reason=". ".join(filter(None, (reason, self.answers[0].reason))))

    @lazy
    def W(self) -> Array:  # noqa: N802  as in the module's text
        """Accelerations of unit weights, in whitened coordinates, shape (nv, p)."""
        return self.P.whitened @ self.P.force_set.G

    @lazy
    def S(self) -> Scaled:  # noqa: N802
        """The problem, scaled."""
        T = self.P.force_set
        return scaled(self.W.T @ self.W, T.H.T @ self.P.free_row_acceleration + T.offset, T)

    def by_sparse_newton(self) -> bool:
        """Whether the steps of `rbd.solvers.sparse_newton` found an answer, of many contacts between many bodies."""
        if self.P.force_set.size < _MANY or np.count_nonzero(self.S.D) > _SPARSE * self.S.D.size:
            return False
        from rbd.solvers.sparse_newton import SparseProblem, solve_sparse  # imports scipy.sparse

        self.method = "cones: sparse Newton"
        w, _, self.iterations = solve_sparse(SparseProblem.of_scaled(self.S))
        return self._judge(self.P.force_set.project(self.S.weights(w)))

    def _firmer(self, w: Array) -> Array:
        """Weights that give every row zero acceleration, refined once: with large friction the last digits count."""
        P = self.P
        left = P.J @ constrained(P, P.force_set.G @ w) + P.offset
        return P.force_set.project(w - _split(P.force_set) @ np.linalg.lstsq(P.delassus, left, rcond=1e-12)[0])

    def _starts(self, S: Scaled, first: Array, given: Array | None) -> Iterator[tuple[Array, float]]:
        """(scaled weights, proximal term) to start Newton from, cheapest first."""
        if given is not None:
            yield self._by_admm(S, given, self.coulomb, 200), 1e-7
        yield self._by_admm(S, first, self.coulomb, 200), 1e-7
        self.method = "cones: Newton"
        yield first, 1e-7
        if self.coulomb:
            yield np.zeros(len(first)), 1e-7
        yield self._by_admm(S, first, False, 1000), 1e-7
        if not self.answers and qp.least_violation(*_conditions(S, self.W, coulomb=self.coulomb)) > 1e-6:
            self.infeasible = True  # by a linear program: no acceleration satisfies the rows, whatever the forces
            return
        extra = np.zeros(len(first))
        for _ in range(_FIXED_POINT_STEPS if self.coulomb else 1):
            w = self._by_interior_point(S, extra)
            yield w, 1e-6
            extra = de_saxce(S, S.D @ w + S.q)
        if not self.coulomb:
            for compliance in _COMPLIANCES:
                w, _ = yielding_steps(S, w, coulomb=False, compliance=compliance)
            yield w, 1e-6
            return
        self.method = "cones: Newton"
        rng = np.random.default_rng(0)
        for _ in range(_RANDOM_STARTS):
            yield rng.normal(size=len(first)), 1e-6

    def _by_admm(self, S: Scaled, guess: Array, coulomb: bool, iterations: int) -> Array:
        w, steps = admm(S, guess, coulomb=coulomb, iterations=iterations, tolerance=1e-6)
        self.iterations += steps
        self.method = "cones: ADMM, Newton"
        return w

    def _by_interior_point(self, S: Scaled, extra: Array) -> Array:
        found = interior_point(S.convex(extra))
        self.iterations += found.iterations
        self.work.spend(found.iterations * self.step)
        self.method = "cones: interior point, Newton"
        return found.x

    def _judge(self, w: Array, reason: str = "") -> bool:
        """Record the answer of given weights; whether it is `solved`."""
        f = self.P.force_set.G @ w
        a = constrained(self.P, f)
        seconds = time.perf_counter() - self.start
        found = Answer(
            self.P, a, f, w, self.law, "ConeSolver", self.iterations, seconds,
            reason=reason, redundant=self.redundant, method=self.method,
        )  # fmt: skip
        if not found.residuals.within(SOLVED) and found.residuals.within(NEAR):
            found = refined(found, by_newton(self.S, self.P.force_set, coulomb=self.coulomb), self.P.force_set)
        if not found.residuals.within(SOLVED):
            if self.best is None or found.residuals.less_than(self.best.residuals):
                self.best = found
            return False
        if all(max_abs(found.a - other.a) > 1e-6 * max(1.0, max_abs(found.a)) for other in self.answers):
            self.answers.append(found)
        return True

    def _result(self) -> Answer:
        if len(self.answers) == 1:
            return self.answers[0]  # it carries its certificate
        seconds = time.perf_counter() - self.start
        if self.answers:
            return replace(self.answers[0], seconds=seconds, others=tuple(self.answers[1:]))
        assert self.best is not None
        if self.infeasible:
            reason = "no acceleration satisfies the rows together, whatever the forces"
        elif self.work.left < 0.0:
            reason = f"no motion was found within {SEARCH_WORK:.0e} multiplications, and not all starts were tried"
        elif self.coulomb:
            reason = (
                "no motion that satisfies Coulomb's law was found, from any start; where the convex law has no answer, "
                "Coulomb's may have none"
            )
        else:
            reason = "the rows can barely be satisfied, or not at all: no method found weights within tolerance"
        return replace(self.best, seconds=seconds, iterations=self.iterations, infeasible=self.infeasible, reason=reason)


def of_many_contacts(P: GaussProblem, start: float) -> Answer | None:
    """The answer of Coulomb's law by `rbd.solvers.sparse_newton`; None where D is not sparse, or none was found.

    Args:
        P: Without sliding points.
        start: Of the search, by `time.perf_counter`.
    """
    if P.force_set.size < _MANY:
        return None
    search = _ConeSearch(P, COULOMB, start)
    return search.answers[0] if search.by_sparse_newton() else None


def holding(P: GaussProblem) -> Array:
    """Weights whose forces give every row zero acceleration, of minimum norm where not unique, shape (p,)."""
    R = independent_factor(P.delassus)
    c = P.free_row_acceleration
    f = np.linalg.lstsq(P.delassus, -c, rcond=1e-12)[0] if R is None else -lapack.dpotrs(R, c)[0]
    return _split(P.force_set) @ f


@lru_cache(maxsize=256)
def _split(parts: ForceSet) -> Array:
    """Minimum-norm weights of row forces, shape (p, m)."""
    return np.asarray(np.linalg.pinv(parts.G))


def de_saxce(S: Scaled, y: Array) -> Array:
    """De Saxce's term, mu |y_t| at the normal of each cone and zero elsewhere, shape (p,); scaled."""
    out, n = np.zeros(len(y)), S.order.singles
    out[n + 2 :: 3] = S.order.mu * np.hypot(y[n::3], y[n + 1 :: 3])
    return out


def _conditions(S: Scaled, W: Array, *, coulomb: bool) -> tuple[Array, Array, Array, Array]:
    """A z = b, C z >= l: the conditions on accelerations under either law, in whitened coordinates z.

    For a cone: under Coulomb's law, no penetration; under the convex law, the dual of the inscribed
    pyramid, which contains the dual of the cone.
    """
    n, order = S.order.singles, S.order
    columns = W if order.columns is None else W[:, order.columns]
    Y, y = (columns * (S.unit / S.rate)).T, S.q  # the scaled accelerations are Y z + y
    low, high = np.isfinite(S.lower), np.isfinite(S.upper)
    line, up, down = ~low & ~high, low & ~high, high & ~low
    C, l = [Y[:n][up], -Y[:n][down]], [-y[:n][up], y[:n][down]]
    for i, mu in enumerate(order.mu):
        rays = np.array([[0.0, 0.0, 1.0]]) if coulomb else pyramid(mu, _FACETS, inscribed=True).T
        at = slice(n + 3 * i, n + 3 * i + 3)
        C.append(rays @ Y[at])
        l.append(-rays @ y[at])
    return Y[:n][line], -y[:n][line], np.vstack(C), np.concatenate(l)
