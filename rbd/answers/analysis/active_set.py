"""Derivatives of an answer by the implicit function theorem, for fixed contact modes, or with every row held.

With the modes of `rbd.answers.analysis.contact_modes` fixed, an answer satisfies equations, and a change of their terms changes
it by

    M+ da - J^T Phi ds = r + J^T f',        Psi^T (J da + c') = 0,        df = Phi ds + f'

r is the change of the forces and inertia forces without the multipliers', c' that of the rows' accelerations at fixed a.
f' is the rotation of sliding points' friction; M+ is M with, for each point that starts to slip, N mu/|y_t| (1 - e e^T) between
its tangential rows, as its friction turns with its acceleration.

    M da - J^T df = r,        J da = -c

r is the change of the forces and inertia forces without the multipliers', c that of the rows' accelerations at fixed a. With
L L^T = M, X = L^-1 J^T = Q R and Q orthonormal, N = L^-1 - Q Q^T L^-1 and B = L^-T X (X^T X)^-1,

    da = N^T N r - B c,        df = -B^T r - (X^T X)^-1 c

It covers rows of full rank alone: the rest, and all other modes, is `rbd.answers.analysis.active_set`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from rbd.answers.analysis.contact_modes import RESOLUTION, Modes, Need, modes_of
from rbd.arrays import RANK, Array, blas, block_diagonal, lapack, max_abs
from rbd.errors import NotDifferentiable
from rbd.problem.answer import Answer
from rbd.problem.cones import Cone
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.solvers.conic_newton import interior_point, solve_conic

CONSISTENT = 1e-6
"""Largest residual of redundant rows after a change, over its largest entry."""


class ActiveSet:
    """The equations that an answer satisfies, factorised once.

    Args:
        answer: A solved answer.

    Attributes:
        words: {constraint: mode of each of its parts}, as in `rbd.answers.analysis.contact_modes`.
        internal: Internal forces: row forces that cause no motion, as columns, shape (m, d).

    Raises:
        NotDifferentiable: at a change of contact mode.
    """

    def __init__(self, answer: Answer) -> None:
        P = self._problem = answer.problem
        self._modes = modes_of(answer)
        self._convex = answer.law.kind == "convex"
        T, k = self._modes.sets, len(self._modes.start)
        self._Phi = np.array(self._modes.phi).reshape(k, -1).T if k else np.zeros((T.size, 0))
        self._Psi = np.array(self._modes.psi).reshape(k, -1).T if k else np.zeros((T.size, 0))
        self._J = T.H.T @ P.J  # for the accelerations y
        self.words: dict[str, tuple[str, ...]] = {
            r.name: tuple(word for e, word in self._modes.words.items() if e.rows == i) for i, r in enumerate(P.rows)
        }
        self._factorise()
        _check_room(answer, self._modes, self._kernel)
        forces = T.G @ self._Phi @ self._kernel
        self.internal = forces[:, np.abs(forces).max(axis=0, initial=0.0) > RANK] if P.m else forces

    def _factorise(self) -> None:
        """L L^T = M+, and bases of the active force and acceleration directions, in the metric of inertia."""
        P, T, M = self._problem, self._modes.sets, self._problem.M.copy()
        for slip in self._modes.slips:
            E = T.G[:, slip.columns].T @ P.J
            M -= self._modes.start[slip.active] * E.T @ slip.turning @ E
        L, info = lapack.dpotrf(M, lower=1, clean=1)
        if info:
            raise NotDifferentiable("a slipping point has negative normal force: solve again, to scaled residuals below 1e-9.")
        self._E = lapack.dtrtri(L, lower=1)[0]  # L^-1; dtrsm of as many columns starts threads, and takes 4 ms
        X, Y = self._E @ (P.J.T @ (T.G @ self._Phi)), self._E @ (self._J.T @ self._Psi)
        self._U, self._to_weights, self._kernel = _bases(X)
        self._V, self._to_answers, self._repeated = _bases(Y)
        if self._U.shape[1] != self._V.shape[1]:
            raise NotDifferentiable(
                f"friction couples {self._U.shape[1]} independent forces to {self._V.shape[1]} independent accelerations: how "
                "the points that slip share the load is not unique, and it decides the motion. Under Coulomb's law that is so "
                "of a patch that slips on more than three corners. Use fewer corners, or the convex law."
            )
        self._meeting = self._V.T @ self._U
        if self._meeting.size and np.linalg.svd(self._meeting, compute_uv=False)[-1] <= RANK:
            raise NotDifferentiable(
                "friction jams the sliding contacts (Painleve): near this answer there is no motion, or more than one."
            )

    def derivative(self, r: Array, c: Array, u: Array, rubs: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """(da, df): change of the acceleration and of the row forces, shapes (nv, n) and (m, n).

        Args:
            r: Change of forces less inertia forces at fixed a and f, shape (nv, n) [N, N m].
            c: Change of the rows' accelerations at fixed a, shape (m, n).
            u: Change of the rows' velocities, shape (m, n).
            rubs: Change of the sets of forces, or None: of the row forces at fixed weights, shape (m, n), and of the
                accelerations that stay zero, at fixed a, shape (k, n).

        Raises:
            NotDifferentiable: if rows are redundant here and not after the change, or if the change depends on a
                force distribution that the motion does not determine.
        """
        P, T = self._problem, self._modes.sets
        forces, y = self._turning(u)
        y = y + T.H.T @ c
        start = np.array(self._modes.start)
        weights = self._turned(start, y)
        b = -(self._Psi.T @ y)
        if rubs is not None:
            forces, b = forces + rubs[0], b - rubs[1]
        p, z = self._motion(r + P.J.T @ (forces + T.G @ weights), b, c)
        da = self._back(z)
        dy = self._J @ da + y
        weights += self._Phi @ (self._to_weights @ p)
        weights += self._turned(start, dy - y)
        self._check_shares(dy, da)
        return da, forces + T.G @ weights

    def _turned(self, loads: Array, y: Array) -> Array:
        """Change of the weights as the friction of what starts to slip turns with y, by loads of the active columns."""
        out = np.zeros_like(y)
        for slip in self._modes.slips:
            out[slip.columns] = loads[slip.active] * slip.turning @ y[slip.columns]
        return out

    def by_force(self) -> tuple[Array, Array]:
        """(da, df) by a generalised force, shapes (nv, nv) and (m, nv); errors as `derivative`."""
        nv, m = self._problem.nv, self._problem.m
        return self.derivative(np.eye(nv), np.zeros((m, nv)), np.zeros((m, nv)))

    def by_friction(self, names: Sequence[str]) -> tuple[Array, Array]:
        """(da, df) by the friction coefficient of each of some constraints, shapes (nv, n) and (m, n); errors as `derivative`.

        A point that slips or slides rubs with f_t = -mu f_n t, so that its force changes by f_t / mu at fixed f_n. Under the
        convex law its acceleration is y_n = mu |y_t| besides. What sticks is not affected.
        """
        P, T, modes = self._problem, self._modes.sets, self._modes
        w, n = modes.w, len(names)
        forces, answers = np.zeros((P.m, n)), np.zeros((len(modes.start), n))
        loose = np.zeros((P.m, self._kernel.shape[1], n))
        shares = self._Phi @ self._kernel
        generators = block_diagonal([r.cone.generators()[0] for r in P.rows])
        for i, name in enumerate(names):
            row = [r.name for r in P.rows].index(name)
            changed = np.zeros(T.size)  # of the accelerations, by that of the columns
            for e in T.elements:
                if e.rows != row or not e.mu or modes.words[e] == "sticks":
                    continue
                tangents, push = generators[:, e.source][:, :2], T.push[e.columns, :2] / e.mu
                forces[:, i] += tangents @ (w[e.columns] @ push)
                loose[:, :, i] += tangents @ (push.T @ shares[e.columns])
                if e.facets:  # rays at rest: y_j is the acceleration of the point along ray j
                    point = np.linalg.lstsq(T.push[e.columns], modes.y[e.columns], rcond=None)[0]
                    changed[e.columns] = push @ point[:2]
            answers[:, i] = self._Psi.T @ changed
            for slip in modes.slips if self._convex else ():
                if T.elements[T.element_at[slip.columns.start]].rows == row:
                    answers[slip.active, i] -= slip.direction @ modes.y[slip.columns]
        self._check_friction(float(np.abs(forces).max(initial=0.0)), loose)
        nothing = np.zeros((P.m, n))
        return self.derivative(np.zeros((P.nv, n)), nothing, nothing, (forces, answers))

    def _check_friction(self, most: float, loose: Array) -> None:
        """Refuse if undetermined forces affect how friction changes."""
        scale = float(np.abs(self._modes.start).max(initial=0.0))
        for i in range(loose.shape[2] if loose.shape[1] else 0):
            moved = self.response(self._problem.J.T @ loose[:, :, i])
            if np.abs(moved).max(initial=0.0) * scale > CONSISTENT * max(1.0, most):
                raise NotDifferentiable(
                    "how the points that slip share the load is not unique, and it decides what more friction does. Use "
                    "fewer contact points, three at most."
                )

    def response(self, r: Array) -> Array:
        """Acceleration by a generalised force r under the active constraints, shape (nv, n)."""
        return self._back(self._motion(r, np.zeros((len(self._modes.start), r.shape[1])), np.zeros((1, r.shape[1])))[1])

    def _back(self, z: Array) -> Array:
        """L^-T z."""
        return np.asarray(self._E.T @ z)

    def _motion(self, r: Array, b: Array, c: Array) -> tuple[Array, Array]:
        """(p, z): z = L^T da = L^-1 r + U p with Psi^T J da = b."""
        left = np.abs(self._repeated.T @ b).max(initial=0.0)
        if left > CONSISTENT * max(1.0, float(np.abs(c).max(initial=0.0))):
            raise NotDifferentiable(
                f"rows are linearly dependent here, and contradict each other nearby (by {left:.2g} m/s2 per unit): "
                "the answer does not change smoothly. Leave out the redundant rows; a sole is one SurfaceContact."
            )
        free = self._E @ r
        p = np.linalg.solve(self._meeting, self._to_answers.T @ b - self._V.T @ free)
        return p, free + self._U @ p

    def _turning(self, u: Array) -> tuple[Array, Array]:
        """(forces, y): effect of a change of velocities on sliding friction and on centripetal accelerations."""
        P, T, w, n = self._problem, self._modes.sets, self._modes.w, u.shape[1]
        forces, y = np.zeros((P.m, n)), np.zeros((T.size, n))
        if not n or T.bilateral or not any(r.speed > P.rest_speed for r in P.rows):
            return forces, y
        generators = block_diagonal([r.cone.generators()[0] for r in P.rows])
        sliding = {s.column: s for s in T.sliding}
        offset = np.vstack([_centripetal_change(r, u[P.slices[r.name]]) for r in P.rows])
        for e in T.elements:
            own = offset[e.source]
            y[e.columns] = T.push[e.columns] @ own if e.facets else own[-e.size :]
            if (s := sliding.get(e.columns.start)) is not None:
                tangents, t = generators[:, e.source][:, :2], np.array(s.direction)
                turned = tangents.T @ u
                turned -= np.outer(t, t @ turned)
                forces -= w[s.column] * s.mu / s.speed * (tangents @ turned)
        return forces, y

    def _check_shares(self, dy: Array, da: Array) -> None:
        """Refuse if undetermined internal forces affect how friction turns."""
        load = float(np.abs(self._modes.start).max(initial=0.0))
        for n in self._kernel.T:
            turned = self._turned(load * n, dy)
            if not turned.any():
                continue
            moved = self.response(self._problem.J.T @ (self._modes.sets.G @ turned))
            if np.abs(moved).max() > CONSISTENT * max(1.0, float(np.abs(da).max())):
                raise NotDifferentiable(
                    "a patch slips without turning, and how its corners share the load is not unique; yet that decides how "
                    "its friction resists a turn. Use fewer contact points, three at most."
                )


def _bases(X: Array) -> tuple[Array, Array, Array]:
    """(U, T, N): an orthonormal basis of X's columns, X T = U, and unit vectors with X N = 0."""
    length = np.linalg.norm(X, axis=0)
    length[length == 0.0] = 1.0
    U, s, Vt = np.linalg.svd(X / length, full_matrices=True)
    rank = int((s > RANK).sum())
    N = Vt[rank:].T / length[:, None]
    return U[:, :rank], Vt[:rank].T / s[:rank] / length[:, None], N / np.linalg.norm(N, axis=0)


def _centripetal_change(rows: Rows, u: Array) -> Array:
    """Derivative of the centripetal accelerations of a set's points, quadratic in the velocity, along a change of it."""
    cone, v = rows.cone, rows.velocity
    return np.column_stack([0.5 * (cone.inward(v + du) - cone.inward(v - du)) for du in u.T])


def _check_room(answer: Answer, modes: Modes, kernel: Array) -> None:
    """Refuse unless some weights, with the same motion, satisfy the modes' inequalities strictly.

    The largest slack that all can have, over their units, is a conic program in internal forces and that slack.
    """
    start, needs = np.array(modes.start), modes.needs
    room = room_of(needs, start)
    if room.min(initial=1.0) > RESOLUTION:
        return
    if kernel.shape[1]:
        inner, optimal = inmost(needs, start, kernel)
        room = room_of(needs, inner)
        if room.min() > RESOLUTION:
            return
        if not optimal:
            raise NotDifferentiable(
                "whether the forces lie strictly inside their sets, without which there are no derivatives, was not decided: a "
                "conic program gave up. Move q, tau or the push a little."
            )
    _refuse(answer, modes, needs[int(np.flatnonzero(room <= room.min() + RESOLUTION)[0])])  # of several alike the first


def inmost(needs: list[Need], start: Array, kernel: Array, *, nearly: bool = False) -> tuple[Array, bool]:
    """(weights with the same motion whose least slack, over its unit, is the largest; whether they are surely those).

    Args:
        needs: The inequalities.
        start: Weights, shape (k,).
        kernel: Directions that cause no motion, shape (k, d).
        nearly: A point well inside is enough, in a third of the time.
    """
    d = kernel.shape[1]
    shift = kernel * max(need.unit for need in needs)
    rows, cones = [need for need in needs if not need.cone], [need for need in needs if need.cone]
    at, of_cones = (np.array([need.active for need in some], int) for some in (rows, cones))
    sign, unit = (np.array([getattr(need, what) for need in rows]) for what in ("sign", "unit"))
    mu, scale = np.array([need.sign for need in cones]), np.repeat([need.unit for need in cones], 3)
    triples, k = (of_cones[:, None] + np.arange(3)).ravel(), 3 * len(cones)
    less = np.zeros((k, 1))
    less[2::3, 0] = -1.0 / mu  # of each normal force
    forces = Unknowns(k, cones=np.arange(k).reshape(-1, 3), mu=mu)
    pushed = {"internal": shift[triples] / scale[:, None], "slack": less, "forces": -np.eye(k)}
    slack = {"internal": (sign / unit)[:, None] * shift[at], "slack": -np.ones((len(rows), 1))}
    program = Conic.of(
        {"internal": Unknowns(d), "slack": Unknowns(1, linear=-1.0, upper=1.0), "forces": forces},
        [(pushed, -start[triples] / scale)],
        [(slack, -(sign * start[at] + [need.level for need in rows]) / unit, math.inf)],
    )
    found = interior_point(program) if nearly else solve_conic(program, newton=False)
    return (start + shift @ found.x[:d] if np.isfinite(found.x).all() else start), found.solved


def room_of(needs: list[Need], s: Array) -> Array:
    """Slack of each force, over its unit, shape (len(needs),)."""
    out = np.zeros(len(needs))
    for i, need in enumerate(needs):
        k = need.active
        given = need.sign * s[k + 2] - np.hypot(s[k], s[k + 1]) if need.cone else need.sign * s[k] + need.level
        out[i] = given / need.unit
    return out


def _refuse(answer: Answer, modes: Modes, need: Need) -> None:
    e = need.element
    rows, y = answer.problem.rows[e.rows], modes.y[e.columns]
    raise NotDifferentiable(
        f"{rows.name!r} is at a change of contact mode: its part {e.number} {modes.words[e]} (acceleration "
        f"{np.abs(y).max():.1e} m/s2), and no forces with this motion are more than {RESOLUTION * need.unit:.1e} N from the "
        "edge of its set. On one side of this answer the mode stays, on the other it slips, breaks or yields, with different "
        "derivatives. Move q, tau or the push a little, or take one-sided differences of rbd.solve."
    )


INDEPENDENT = 1e-6
"""Least pivot of X^T X over its diagonal: singular values of X above 1e-3, far from those that count as zero."""
ROOM = 1e-3
"""Corner forces this far inside their cones, over the largest row force, are no change of mode; nearer ones go another way."""


class HeldRows:
    """The equations of such an answer, factorised once.

    Attributes:
        words: {constraint: "holds" of each row or "sticks" of each corner}.
        internal: Row forces that cause no motion: none, shape (m, 0).
    """

    def __init__(self, problem: GaussProblem, words: dict[str, tuple[str, ...]], factor: Array) -> None:
        P = problem
        self.words, self.internal, self._R = words, np.zeros((P.m, 0)), factor
        E = lapack.dtrtri(P.factor, lower=1)[0]  # as above
        if not P.m:
            self._free, self._B = E.T @ E, np.zeros((P.nv, 0))
            return
        Q = blas.dtrsm(1.0, factor, P.whitened, side=1)
        N = E - Q @ (Q.T @ E)
        self._free = N.T @ N
        self._B = E.T @ blas.dtrsm(1.0, factor, Q, side=1, trans_a=1)

    @classmethod
    def of(cls, answer: Answer, problem: GaussProblem) -> HeldRows | None:
        """The equations, or None where they are not surely those of the answer to a problem."""
        P = problem
        words = {}
        c = None
        load = max(1.0, max_abs(answer.multipliers))
        for r in P.rows:
            if answer.weights is None or r.cone.bilateral or not len(r):
                words[r.name] = ("holds",) * len(r)
                continue
            span, (inverse, mu) = P.slices[r.name], _split(r.cone)
            c = P.J @ answer.a + P.offset if c is None else c
            if not mu or r.speed > 0.1 * P.rest_speed or max_abs(c[span]) > 0.1 * RESOLUTION:
                return None
            w = (inverse @ answer.multipliers[span]).reshape(-1, 3)
            room = (mu * w[:, 2] - np.hypot(w[:, 0], w[:, 1])).min()
            if not room > ROOM * mu * load:
                return None
            words[r.name] = ("sticks",) * len(w)
        factor, info = lapack.dpotrf(P.delassus, lower=0, clean=1) if P.m else (np.zeros((0, 0)), 0)
        if info or (factor.diagonal() ** 2 < INDEPENDENT * P.delassus.diagonal()).any():
            return None
        return cls(P, words, factor)

    def derivative(self, r: Array, c: Array, u: Array) -> tuple[Array, Array]:
        """(da, df): change of the acceleration and of the row forces, shapes (nv, n) and (m, n).

        Args:
            r: Change of forces less inertia forces at fixed a and f, shape (nv, n) [N, N m].
            c: Change of the rows' accelerations at fixed a, shape (m, n).
            u: Change of the rows' velocities, shape (m, n); it has no effect.
        """
        if not len(c):
            return self._free @ r, c
        return self._free @ r - self._B @ c, -(self._B.T @ r) - lapack.dpotrs(self._R, c)[0]

    def by_force(self) -> tuple[Array, Array]:
        """(da, df) by a generalised force, shapes (nv, nv) and (m, nv)."""
        return self._free.copy(), -self._B.T

    def by_friction(self, names: Sequence[str]) -> tuple[Array, Array]:
        """(da, df) by friction coefficients: zero, as nothing slips, shapes (nv, n) and (m, n)."""
        return np.zeros((len(self._free), len(names))), np.zeros((len(self.internal), len(names)))

    def response(self, r: Array) -> Array:
        """Acceleration by a generalised force r under the rows, shape (nv, n)."""
        return self._free @ r


@lru_cache(maxsize=256)
def _split(cone: Cone) -> tuple[Array, float]:
    """(map from row forces to weights of minimum norm, their coefficient); zero of sets that are not all friction of one."""
    G, parts = cone.generators()
    return np.linalg.pinv(G), parts[0].mu if len({part.mu for part in parts}) == 1 else 0.0
