"""Friction problems in the form of FCLIB, and answers with residuals that are recomputed from the problem alone.

A local problem is given by W and q, a global one by M, H, f and w, which come down to a local one:

    u = W r + q                                       M v = H r + f,   u = H^T v + w
    u + mu |u_t| n in K*,  r in K,  r . (u + mu |u_t| n) = 0

r are contact forces or impulses and u their accelerations or velocities, contact by contact, **the normal first** (FCLIB's
order; elsewhere in `rbd` it is last): (n, t) in the plane, (n, t, t) in space, (n, t, t, m, m) where a moment of at most
mu_r r_n resists rolling. With rolling, De Saxce's term is mu |u_t| + mu_r |u_m|.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rbd.arrays import Array, as_finite, check_whole, lazy, max_abs
from rbd.displayed import Displayed
from rbd.errors import InputError, Unsupported
from rbd.errors.inputs import check_kind
from rbd.problem.cones import FrictionCone
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.solvers.sparse_newton import SparseProblem, solve_sparse

SOLVED = 1e-12
"""Largest natural map of an answer that is called solved."""
BADLY_SCALED = 1e-9
"""The same where the contacts' mobilities differ by more than `SPREAD`."""
SPREAD = 1e6
_DIMENSIONS = (2, 3, 5)
_SYMMETRIC = 1e-9
_REFINED = 3
_CORRECTIONS = 4
_ENOUGH = 0.1 * SOLVED


@dataclass(frozen=True, eq=False, repr=False)
class FrictionProblem(Displayed):
    """One friction problem, local (W, q) or global (M, H, f, w); matrices are sparse.

    Attributes:
        name: Its name, e.g. the file's.
        dim: Rows of a contact: 2, 3, or 5 with rolling.
        mu: Friction coefficients, shape (k,).
        mu_r: Of rolling [m], shape (k,); None where dim is not 5.
        W: Shape (k dim, k dim), of a local problem; need not be symmetric. None of a global one.
        q: Shape (k dim,).
        M: Inertia of a global problem, shape (nv, nv); None of a local one.
        H: Transposed Jacobian, shape (nv, k dim).
        f: Force, or momentum, of free motion, shape (nv,).
        w: Added to H^T v, shape (k dim,).
        about: What the file says of the problem.
        known: {name: r}: answers and guesses that came with it; not trusted.

    Raises:
        InputError: sizes that do not fit, entries that are not finite, friction below zero.

    Example:
        >>> wedge = rbd.audits.bench.FrictionProblem("drop", 3, mu=[0.5], W=np.diag([1.0, 1.0, 1.0]), q=[-1.0, 0.1, 0.0])
        >>> answer = rbd.audits.bench.solve(wedge)
        >>> print(answer.verdict, answer.r.round(3))
        solved [ 1.  -0.1  0. ]
    """

    name: str
    dim: int
    mu: Array
    mu_r: Array | None = None
    W: Any = None
    q: Array | None = None
    M: Any = None
    H: Any = None
    f: Array | None = None
    w: Array | None = None
    about: str = ""
    known: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what in ("name", "about"):
            check_kind(f"the {what} of a friction problem", getattr(self, what), str, "a text")
        check_kind("known", self.known, dict, "{name: forces}")
        if check_whole(f"{self.name}: the dimension", self.dim, 5) not in _DIMENSIONS:
            raise InputError(f"{self.name}: the dimension is {self.dim}; expected 2 or 3, or 5 with rolling.")
        mu = self._vector("mu", self.mu, "k")
        size = self.dim * len(mu)
        rolling = self._vector("mu_r", self.mu_r, len(mu)) if self.dim == 5 else None
        if (mu < 0.0).any() or (rolling is not None and (rolling < 0.0).any()):
            raise InputError(f"{self.name}: mu or mu_r of a contact is below zero; expected numbers of 0 or more.")
        object.__setattr__(self, "mu_r", rolling)
        if (self.W is None) == (self.M is None):
            raise InputError(f"{self.name}: expected W and q of a local problem, or M, H, f and w of a global one.")
        if self.W is not None:
            self._matrix("W", self.W, (size, size))
            self._vector("q", self.q, size)
        else:
            nv = len(self._vector("f", self.f, "nv"))
            self._matrix("M", self.M, (nv, nv))
            self._matrix("H", self.H, (nv, size))
            self._vector("w", self.w, size)

    def _vector(self, what: str, value: object, size: int | str) -> Array:
        out = as_finite(f"{self.name}: {what}", value, (size,))
        object.__setattr__(self, what, out)
        return out

    def _matrix(self, what: str, value: Any, shape: tuple[int, int]) -> None:
        from scipy.sparse import csr_array, issparse

        given = value if issparse(value) else as_finite(f"{self.name}: {what}", value, shape)
        out = csr_array(given, dtype=float)
        if out.shape != shape:
            raise InputError(f"{self.name}: {what} has shape {out.shape}; expected {shape}.")
        if not np.isfinite(out.data).all():
            raise InputError(f"{self.name}: {what} has an entry that is not finite.")
        object.__setattr__(self, what, out)

    def __repr__(self) -> str:
        kind = "local" if self.M is None else f"global, nv={len(self.f)}"  # type: ignore[arg-type]
        return f"FrictionProblem({self.name!r}, {kind}, dim={self.dim}, contacts={len(self.mu)})"

    @lazy
    def delassus(self) -> Any:
        """W, or H^T M^-1 H of a global problem, sparse, shape (k dim, k dim)."""
        if self.M is None:
            return self.W
        from scipy.sparse import csr_array

        return csr_array(self.H.T @ self._inverse @ self.H)

    @lazy
    def free(self) -> Array:
        """U without contact forces: q, or H^T M^-1 f + w, shape (k dim,)."""
        if self.M is None:
            assert self.q is not None
            return self.q
        return np.asarray(self.H.T @ (self._inverse @ self.f) + self.w)

    @lazy
    def _inverse(self) -> Any:
        """M^-1, body by body: the blocks of M that nothing couples, those of one size together."""
        from scipy.sparse import coo_array, csr_array
        from scipy.sparse.csgraph import connected_components

        M = self.M.tocoo()
        count, of = connected_components(self.M, directed=False)
        sizes = np.bincount(of, minlength=count)
        order, starts = np.argsort(of, kind="stable"), np.r_[0, np.cumsum(sizes)]
        place = np.empty(len(of), int)
        place[order] = np.arange(len(of)) - starts[of[order]]
        found = []
        for size in np.unique(sizes):
            some = np.flatnonzero(sizes == size)
            number = np.full(count, -1)
            number[some] = np.arange(len(some))
            blocks, mine = np.zeros((len(some), size, size)), number[of[M.row]] >= 0
            np.add.at(blocks, (number[of[M.row[mine]]], place[M.row[mine]], place[M.col[mine]]), M.data[mine])
            try:
                inverse = np.linalg.inv(blocks)
            except np.linalg.LinAlgError as error:
                raise InputError(f"{self.name}: M is singular; expected the inertia of bodies with mass.") from error
            at = order[starts[some][:, None] + np.arange(size)]
            found.append((inverse.ravel(), np.repeat(at, size, axis=1).ravel(), np.tile(at, size).ravel()))
        values, rows, columns = (np.concatenate(part) for part in zip(*found, strict=True))
        return csr_array(coo_array((values, (rows, columns)), M.shape))

    @lazy
    def gauss(self) -> GaussProblem:
        """The same problem as a `GaussProblem`, normals last, for the solvers of `rbd` that take Coulomb's law.

        A local problem has M = 1 and the J of W = J J^T, whose condition is the root of W's. A contact in the plane gets a
        second tangent, along which nothing moves.

        Raises:
            Unsupported: rolling; a W that is not symmetric.
            InputError: a W with eigenvalues below zero by more than 1e-7 of the largest.
        """
        if self.dim == 5:
            raise Unsupported(f"{self.name}: no force set of rbd resists rolling. Use rbd.audits.bench.solve(problem).")
        order = self.normals_last
        if self.M is not None:
            M, rhs, J, offset = self.M.toarray(), self.f, self.H.T.toarray()[order], self.w
        else:
            W = self.W.toarray()[np.ix_(order, order)]
            uneven = max_abs((W - W.T).ravel()) / (max_abs(W.ravel()) or 1.0)
            if uneven > _SYMMETRIC:
                raise Unsupported(
                    f"{self.name}: |W - W^T| is {uneven:.1e} of |W|, and W = J M^-1 J^T is symmetric. Use "
                    "rbd.audits.bench.solve(problem), which takes W as it is."
                )
            values, vectors = np.linalg.eigh(0.5 * (W + W.T))
            if values[0] < -1e-7 * values[-1]:
                raise InputError(f"{self.name}: W has the eigenvalue {values[0]:.2g}; expected none below zero.")
            M, rhs, J, offset = np.eye(len(W)), np.zeros(len(W)), vectors * np.sqrt(np.maximum(values, 0.0)), self.q
        assert rhs is not None and offset is not None
        rows = []
        for i, (mu, part, bias) in enumerate(
            zip(self.mu.tolist(), *(np.split(x, len(self.mu)) for x in (J, offset[order])), strict=True)
        ):
            if self.dim == 2:
                part, bias = np.insert(part, 1, 0.0, axis=0), np.insert(bias, 1, 0.0)
            rows.append(Rows(f"contact {i}", part, bias=bias, cone=FrictionCone(mu)))
        return GaussProblem(0.5 * (M + M.T), rhs, rows)

    @property
    def normals_last(self) -> Array:
        """Numbers of the rows with each contact's normal last, shape (k dim,)."""
        return np.roll(np.arange(self.dim * len(self.mu)).reshape(-1, self.dim), -1, axis=1).ravel()

    def forces_of(self, multipliers: Array) -> Array:
        """Row forces of `gauss`, stacked, as forces of this problem, shape (k dim,).

        Args:
            multipliers: Those of an answer, shape (3 k,).
        """
        return np.roll(multipliers.reshape(-1, 3), 1, axis=1)[:, : self.dim].ravel()

    @lazy
    def rates(self) -> Array:
        """Inertia of each contact: 1 over the largest diagonal entry of its block of W, shape (k,)."""
        size = np.abs(self.delassus.diagonal()).reshape(-1, self.dim).max(axis=1)
        return np.asarray(1.0 / np.maximum(size, 1e-12 * max_abs(size) or 1.0))

    @property
    def tolerance(self) -> float:
        """Natural map up to which an answer is solved: 1e-12, or 1e-9 where contacts' inertias differ by more than 1e6."""
        return BADLY_SCALED if self.rates.max() > SPREAD * self.rates.min() else SOLVED

    def answer(self, r: Array, solver: str = "", seconds: float = 0.0) -> FrictionAnswer:
        """Forces, normal first, shape (k dim,), as an answer with its residuals."""
        return FrictionAnswer(self, as_finite("r", r, (self.dim * len(self.mu),)), solver, seconds)


@dataclass(frozen=True, eq=False, repr=False)
class FrictionAnswer(Displayed):
    """Forces of a friction problem, judged by what the problem makes of them, whatever a solver claims.

    Attributes:
        problem: The problem.
        r: Forces or impulses, normal first, shape (k dim,).
        solver: Who found them.
        seconds: In what time of the processor [s].

    Example:
        >>> drop = rbd.audits.bench.FrictionProblem("drop", 3, mu=[0.5], W=np.eye(3), q=[-1.0, 2.0, 0.0])
        >>> wrong = drop.answer(np.array([1.0, 0.0, 0.0]))  # it slides, and nothing rubs
        >>> wrong.verdict, wrong.natural_map
        ('not solved', 0.2)
    """

    problem: FrictionProblem
    r: Array
    solver: str = ""
    seconds: float = 0.0

    @lazy
    def v(self) -> Array:
        """M^-1 (H r + f) of a global problem, shape (nv,); empty of a local one."""
        return self._motion[0].astype(float)

    @lazy
    def u(self) -> Array:
        """Recomputed accelerations or velocities, shape (k dim,)."""
        return self._motion[1].astype(float)

    @lazy
    def _motion(self) -> tuple[Array, Array]:
        """(v, u), in extended precision where the machine has it: M v = H r + f is refined, so that no condition counts."""
        P, r = self.problem, self.r.astype(np.longdouble)
        if P.M is None:
            return np.zeros(0), P.W.astype(np.longdouble) @ r + P.q
        M, H = P.M.astype(np.longdouble), P.H.astype(np.longdouble)
        load = H @ r + P.f
        v = np.zeros(len(load), np.longdouble)
        for _ in range(_REFINED):
            v = v + P._inverse @ (load - M @ v).astype(float)
        return v, H.T @ v + P.w

    @lazy
    def _dual(self) -> Array:
        """U with De Saxce's term, shape (k, dim)."""
        P = self.problem
        u = self.u.reshape(-1, P.dim).copy()
        u[:, 0] += P.mu * np.linalg.norm(u[:, 1:3], axis=1)
        if P.mu_r is not None:
            u[:, 0] += P.mu_r * np.linalg.norm(u[:, 3:], axis=1)
        return u

    @lazy
    def size(self) -> float:
        """The largest force of the problem: of the answer, or of a contact that alone stops its free motion."""
        P = self.problem
        stops = np.abs(P.free).reshape(-1, P.dim).max(axis=1) * P.rates
        return max(max_abs(self.r), max_abs(stops)) or 1.0

    @lazy
    def natural_map(self) -> float:
        """Largest entry of |r - P_K(r - rho (u + mu |u_t| n))|, over the largest force; rho is the contact's inertia.

        Zero for exact answers alone. P_K projects on the true cone, another way than the solver's equations.
        """
        return self._missed(self._dual)

    @lazy
    def convex_map(self) -> float:
        """The same of the convex law, |r - P_K(r - rho u)|: zero where points that slide also lift, at mu |u_t|."""
        return self._missed(self.u.reshape(self._dual.shape))

    def _missed(self, u: Array) -> float:
        P, r = self.problem, self.r.reshape(u.shape)
        return max_abs((r - _nearest(r - P.rates[:, None] * u, P.mu, P.mu_r)).ravel()) / self.size

    @lazy
    def fclib_error(self) -> float:
        """FCLIB's error: |r - P_K(r - (u + mu |u_t| n))| over |q|, Euclidean norms, with its rho of one."""
        P, r = self.problem, self.r.reshape(-1, self.problem.dim)
        return float(np.linalg.norm(r - _nearest(r - self._dual, P.mu, P.mu_r)) / (np.linalg.norm(P.free) or 1.0))

    @lazy
    def complementarity(self) -> float:
        """Largest |r . (u + mu |u_t| n)| of a contact, over the largest force and the largest free |u|."""
        power = np.abs((self.r.reshape(-1, self.problem.dim) * self._dual).sum(axis=1))
        return max_abs(power) / (self.size * (max_abs(self.problem.free) or 1.0))

    @lazy
    def outside(self) -> float:
        """Largest distance of a contact's force from its cone, over the largest force."""
        P, r = self.problem, self.r.reshape(-1, self.problem.dim)
        return max_abs((r - _nearest(r, P.mu, P.mu_r)).ravel()) / self.size

    @property
    def solved(self) -> bool:
        """Whether the natural map is within the problem's tolerance."""
        return self.natural_map <= self.problem.tolerance

    @property
    def verdict(self) -> str:
        """Either "solved" or "not solved", by `solved`."""
        return "solved" if self.solved else "not solved"

    def __repr__(self) -> str:
        return f"FrictionAnswer({self.problem.name!r}, {self.verdict}, natural map {self.natural_map:.1e})"


def _nearest(r: Array, mu: Array, mu_r: Array | None) -> Array:
    """The nearest forces in the cones |r_t| <= mu r_n, |r_m| <= mu_r r_n, shape (k, dim).

    Their normal N is zero, or that at which N - r_n = sum mu_i (|r_i| - mu_i N)_+; none, one or both of the discs cut.
    """
    discs = [(slice(1, 3), mu)] + ([] if mu_r is None else [(slice(3, 5), mu_r)])
    lengths = [np.linalg.norm(r[:, disc], axis=1) for disc, _ in discs]
    best, least = np.maximum(r[:, 0], 0.0), np.full(len(r), np.inf)
    for cut in np.ndindex(*(2,) * len(discs)):
        top, below = r[:, 0].copy(), np.ones(len(r))
        for used, t, (_, m) in zip(cut, lengths, discs, strict=True):
            top, below = top + used * m * t, below + used * m * m
        N = np.maximum(top / below, 0.0)
        rises = N - r[:, 0] - sum(m * np.maximum(t - m * N, 0.0) for t, (_, m) in zip(lengths, discs, strict=True))
        far = np.where((N == 0.0) & (rises > 0.0), 0.0, np.abs(rises))
        best, least = np.where(far < least, N, best), np.minimum(far, least)
    out = r.copy()
    out[:, 0] = best
    for t, (disc, m) in zip(lengths, discs, strict=True):
        out[:, disc] *= np.minimum(1.0, m * best / np.maximum(t, 1e-300))[:, None]
    return out


def solve(problem: FrictionProblem, guess: Array | None = None) -> FrictionAnswer:
    """The answer by `rbd.solvers.sparse_newton`, which takes any W as it is; see `FrictionAnswer.verdict`.

    Args:
        problem: The problem.
        guess: Forces to start from, shape (k dim,); zero by default.

    Example:
        >>> at_rest = rbd.audits.bench.FrictionProblem("a weight", 3, mu=[0.5], W=np.eye(3) / 2.0, q=[-9.81, 0.0, 0.0])
        >>> rbd.audits.bench.solve(at_rest).r
        array([19.62,  0.  ,  0.  ])
    """
    check_kind("problem", problem, FrictionProblem, "a FrictionProblem")
    start, P, order = time.process_time(), problem, problem.normals_last
    mu = np.column_stack([P.mu, P.mu if P.mu_r is None else P.mu_r])
    D, free = P.delassus[order][:, order], P.free[order]
    r = np.zeros(len(order)) if guess is None else as_finite("guess", guess, P.free.shape)[order]
    S = SparseProblem.of(D, free, mu)
    w, _, _ = solve_sparse(S, r / S.unit)
    best: FrictionAnswer | None = None
    for _ in range(_CORRECTIONS):
        r = np.empty(len(order))
        r[order] = S.unit * w
        found = P.answer(r, "sparse Newton", time.process_time() - start)
        if best is None or found.natural_map < best.natural_map:
            best = found
        if best.natural_map <= _ENOUGH:
            break
        # D and q of a global problem have the rounding of M's inverse; the recomputed u has not.
        S = SparseProblem.of(D, found.u[order] - D @ r[order], mu)
        w, _, _ = S.newton(r[order] / S.unit)
    assert best is not None
    return best
