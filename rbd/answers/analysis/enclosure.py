"""Intervals that contain the exact answer of a posed problem, by Krawczyk's test on the equations of its contact modes.

The posed problem is M, rhs, J, offset, the columns G, H of its force set, bounds and friction coefficients, all taken as exact
doubles. With the modes of `rbd.answers.analysis.contact_modes` fixed, its law is a square system F(z) = 0 in z = (a, s):

    M a - rhs - J^T G w(s, a) = 0,      psi_k^T (H^T (J a + offset) + o) = 0 for each active column k

    w = sum_k phi_k s_k;  a point that starts to slip: w_t = -mu s y_t / |y_t|, and y_n = 0 (coulomb) or y_n = mu |y_t| (convex)

It is linear where nothing starts to slip. With R near F'(z0)^-1 and Z = {|z - z0| <= v}: if |R F(z0)| + |I - R F'(Z)| v < v,
then Z holds exactly one zero of F, and it is in z0 - R F(z0) + (I - R F'(Z)) (Z - z0) [Rump2010]. Then every inequality of the
law is checked over these intervals, strictly. All of it is done with `rbd.intervals`.

Of linearly dependent columns an independent subset is enclosed, and the others' weights stay those of the answer, or, where
these are on the edge of their sets, those farthest inside: any admissible forces with this motion will do. Rounded dependent
rows contradict each other in exact arithmetic. `Enclosure.missed` bounds how far those that are left out are from zero: the
answer is exact for offsets that differ by no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rbd.answers.analysis.active_set import inmost, room_of
from rbd.answers.analysis.contact_modes import modes_of
from rbd.arrays import RANK, Array, lapack
from rbd.displayed import Displayed
from rbd.errors import NotEnclosed
from rbd.intervals import TINY, Intervals, above, bounded_by, positive_definite, product, products, residual, sums
from rbd.problem.answer import Answer
from rbd.problem.force_set import Element
from rbd.problem.residuals import SOLVED

ONLY = "the problem has exactly one motion"
OF_MODES = "the problem has exactly one motion with these modes"
NEARBY = "the problem has exactly one motion with these modes near the answer"
SHARED = "the problem has exactly one motion with these modes and these shares of the load near the answer"
_ROOM = 1e-9
"""Weights nearer to the edge of their sets, over their unit, are moved inside, where other forces cause the same motion."""


@dataclass(frozen=True, eq=False, repr=False)
class Enclosure(Displayed):
    """Intervals that contain the exact answer of the posed problem, its doubles taken as exact.

    Attributes:
        a: Acceleration, shape (nv,) [m/s2, rad/s2].
        forces: {constraint: its force or wrench on the robot in world axes, as `Solution.forces`} [N, N m]; of forces that are
            not unique, one admissible choice.
        unique: {constraint: whether no other row forces of these modes cause this motion}, judged in floating point.
        modes: {constraint: mode of each of its parts, as "sticks"}.
        scope: What was shown: `ONLY`, of all motions (the law is a convex one and M was shown to be positive definite);
            `OF_MODES`; `NEARBY`, where a point starts to slip; `SHARED`, where points share loads that are not unique.
        missed: {constraint: bound of its dependent rows' accelerations [m/s2, rad/s2]}: they follow from the others but for the
            rounding of J. What is enclosed is the exact answer of the problem whose offsets of these rows are changed by that
            much at most. Constraints whose rows hold exactly are left out.
        margin: The least room of all inequalities: (constraint, number of its part, mode, room in N, N m, m/s2 or rad/s2).
        distance: Bounds of how far the answer is from the exact one: of a [m/s2, rad/s2], of unique row forces [N, N m].

    Example:
        >>> box = rbd.testing.box(mass=2.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.5)
        >>> enclosure = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [corner]).enclosure()
        >>> force = enclosure.forces["corner"]
        >>> bool(force.lower[2] <= 19.62 <= force.upper[2]), enclosure.modes
        (True, {'corner': ('sticks',)})
    """

    a: Intervals
    forces: Mapping[str, Intervals]
    unique: Mapping[str, bool]
    modes: Mapping[str, tuple[str, ...]]
    scope: str
    missed: Mapping[str, float]
    margin: tuple[str, int, str, float]
    distance: tuple[float, float]

    @property
    def width(self) -> tuple[float, float]:
        """(widest interval of a [m/s2, rad/s2], of the forces that are unique [N, N m])."""
        forces = [float(f.width.max(initial=0.0)) for name, f in self.forces.items() if self.unique[name]]
        return float(self.a.width.max(initial=0.0)), max(forces, default=0.0)

    def __str__(self) -> str:
        of_a, of_forces = self.width
        lines = [f"{self.scope}, and it is in these intervals"]
        lines.append(f"  widest: {of_a:.1e} m/s2 (rad/s2) of a, {of_forces:.1e} N (N m) of the forces that are unique")
        lines.append(f"  the answer is within {self.distance[0]:.1e} m/s2 (rad/s2) and {self.distance[1]:.1e} N (N m) of it")
        for name, words in self.modes.items():
            told = ", ".join(f"{words.count(word)} {word}" if len(words) > 1 else word for word in dict.fromkeys(words))
            lines.append(f"  {name:<16} {told or 'no rows'}{'' if self.unique[name] else '; its forces are not unique'}")
        if self.margin[0]:
            name, part, word, room = self.margin
            lines.append(f"  nearest to a limit: {name}, part {part + 1}, {word}, by {room:.3g}")
        for name, bound in self.missed.items():
            lines.append(f"  rows of {name} that depend on others hold to {bound:.1e} m/s2 (rad/s2)")
        return "\n".join(lines)


def enclosure_of(answer: Answer) -> Enclosure:
    """The intervals around an answer within tolerance.

    Args:
        answer: Solved.

    Raises:
        NotEnclosed: where the test fails, or an answer with residuals above 1e-9 is as far from what it finds.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # what overflows fails every test
        return _Enclosing(answer).enclosure()


def _unit(t: Array, more: Intervals) -> tuple[tuple[float, Intervals], Array, Intervals]:
    """((|x|, more of it), x / |x|, more of it) of x = t + more, shape (2,), with twice the digits.

    |x| = q + rho / (q + |x|) with rho = |x|^2 - q^2; x / |x| = e + (x - e |x|) / |x|. Without `more` each is a double.
    """
    high, low, rad = sums(np.concatenate(products(t, t)), TINY)
    square = Intervals(low, rad) + (more * (t * 2.0))[0] + (more * (t * 2.0))[1] + more[0] * more[0] + more[1] * more[1]
    q = float(np.sqrt(high))
    p, rest = products(np.array(q), np.array(q))
    rho = square + (high - p) - rest  # high - p is exact, as both are near
    length = (Intervals.exact(high) + square).sqrt()
    q_more = rho / (length + q)
    e = t / q
    p, rest = products(e, np.array(q))
    return (q, q_more), e, (more - e * q_more + (t - p) - rest) / length


class _Enclosing:
    """The system of an answer's modes, and the tests."""

    def __init__(self, answer: Answer) -> None:
        P, self._modes, self._answer = answer.problem, modes_of(answer), answer
        modes, T = self._modes, self._modes.sets
        self._P, self._T, self._coulomb = P, T, answer.law.kind == "coulomb"
        if T.impact:
            raise NotEnclosed(f"{T.impact}.")
        k = len(modes.start)
        self._Phi = np.array(modes.phi).reshape(k, -1).T if k else np.zeros((T.size, 0))
        self._Psi = np.array(modes.psi).reshape(k, -1).T if k else np.zeros((T.size, 0))
        self._slips = modes.slips
        self._at = self._Psi.argmax(axis=0) if k else np.zeros(0, int)  # the column of each active weight itself
        for slip in modes.slips:
            self._at[slip.active] = slip.columns.stop
        self._fixed = np.zeros(T.size)  # weights at their bounds
        for j in np.flatnonzero(~self._Phi.any(axis=1)):
            low, high = float(T.lower[j]), float(T.upper[j])
            at = low if low == high or modes.y[j] > 0.0 else high
            self._fixed[j] = at if np.isfinite(at) else 0.0  # of a cone that opens
        self._start = np.array(modes.start)
        self._choose()
        self._HJ = product(T.H.T, P.J)

    def _choose(self) -> None:
        """An independent subset of the active columns; weights of the others that leave room inside the sets."""
        X = self._P.whitened @ (self._T.G @ self._Phi)
        k, unit = X.shape[1], np.linalg.norm(X, axis=0)
        unit[unit == 0.0] = 1.0
        self._kernel, self._weakest = np.zeros((k, 0)), -1
        if not k:
            self._free = self._held = np.zeros(0, int)
            return
        QR, order, _, _, _ = lapack.dgeqp3(X / unit)
        order, pivots = order - 1, np.abs(QR.diagonal())
        rank = int((pivots > RANK).sum())
        self._free, self._held = np.sort(order[:rank]), np.sort(order[rank:])
        self._weakest = int(order[rank - 1]) if rank else -1
        if rank < k:
            N = np.zeros((k, k - rank))
            N[order[:rank]] = -np.linalg.solve(np.triu(QR[:rank, :rank]), QR[:rank, rank:])
            N[order[rank:]] = np.eye(k - rank)
            self._kernel = N / unit[:, None]
            self._kernel /= np.linalg.norm(self._kernel, axis=0)
            needs = self._modes.needs
            if needs and room_of(needs, self._start).min() < _ROOM:
                self._start = inmost(needs, self._start, self._kernel, nearly=True)[0]
        if not np.array_equal(self._T.G @ self._Phi, self._T.H @ self._Psi):  # friction: fewer accelerations than forces
            Y = self._P.whitened @ (self._T.H @ self._Psi)
            length = np.linalg.norm(Y, axis=0)
            QR, order, _, _, _ = lapack.dgeqp3(Y / np.where(length > 0.0, length, 1.0))
            fewer = int((np.abs(QR.diagonal()) > RANK).sum())
            if fewer < rank:
                self._free, self._held = np.sort(order[:fewer] - 1), np.sort(order[fewer:] - 1)
                self._weakest = int(order[fewer - 1] - 1) if fewer else -1

    def enclosure(self) -> Enclosure:
        """All of it."""
        nv, z = self._P.nv, np.concatenate([self._answer.a, self._start[self._free]])
        K = self._jacobian(z, np.zeros(len(z)))  # of modes without slips, everywhere
        R, v = self._inverse(K, z), None
        for _ in range(2 if self._slips else 1):
            z = z - R @ self._residual(z)[0][0]
        (high, low, rad), y = self._residual(z)
        step = product(R, Intervals(-high, above(np.abs(low) + rad, 2)))
        E = self._contraction(R, K)
        for _ in range(6):
            v = bounded_by(E, step.size)
            if v is None or not self._slips:
                break
            wide = self._contraction(R, self._jacobian(z, v))
            if (above(step.size + wide @ v, len(z) + 1) < v).all():
                E = wide
                break
            E, v = wide, None
        if v is None:
            raise self._not_regular(E, z)
        moved = Intervals(step.mid, above(step.rad + E @ v, len(z) + 2))
        found = Intervals.exact(z) + moved
        s = Intervals(self._start.copy(), np.zeros(len(self._start)))
        s.mid[self._free], s.rad[self._free] = found.mid[nv:], found.rad[nv:]
        y = y + product(self._HJ, moved[:nv])
        margin = self._check_inequalities(s, y)
        a, w = found[:nv], self._weights(s, y)
        f = product(self._T.G, w)
        return Enclosure(
            a, {r.name: self._force(i, f) for i, r in enumerate(self._P.rows)}, self._unique(), self._words(),
            self._scope(), self._missed(y), margin, self._distance(a, f),
        )  # fmt: skip

    def _weights(self, s: Intervals, y: Intervals) -> Intervals:
        """W of the active columns' weights, shape (p,)."""
        w = self._weights_but_of_slips(s)
        for slip in self._slips:
            rubs = -(self._friction(slip.columns) * s[slip.active]) * self._direction(y, slip.columns)
            w.mid[slip.columns], w.rad[slip.columns] = rubs.mid, rubs.rad
        return w

    def _weights_but_of_slips(self, s: Intervals) -> Intervals:
        w = Intervals(self._fixed.copy(), np.zeros(self._T.size))
        w.mid[self._at], w.rad[self._at] = s.mid, s.rad
        return w

    def _friction(self, columns: slice) -> float:
        T = self._T
        return T.elements[T.element_at[columns.start]].mu

    @staticmethod
    def _direction(y: Intervals, columns: slice) -> Intervals:
        """Y_t / |y_t|, shape (2,)."""
        t = y[columns]
        return t / (t[0] * t[0] + t[1] * t[1]).sqrt()

    def _accelerations(self, a: Array) -> tuple[Array, Array, Array]:
        """(high, low, rad) of H^T (J a + offset) + o, shape (p,)."""
        P, T = self._P, self._T
        high, low, rad = residual([(P.J, a)], [P.offset])
        return residual([(T.H.T, high), (T.H.T, low)], [T.offset], above(np.abs(T.H).T @ rad, len(rad)))

    def _residual(self, z: Array) -> tuple[tuple[Array, Array, Array], Intervals]:
        """((high, low, rad) of F(z), accelerations at z)."""
        P, T, nv = self._P, self._T, self._P.nv
        s = self._start.copy()
        s[self._free] = z[nv:]
        high, low, rad = self._accelerations(z[:nv])
        y = Intervals(high, above(np.abs(low) + rad, 2))
        w = self._weights_but_of_slips(Intervals.exact(s))
        w_low, speeds = Intervals(np.zeros(T.size), w.rad), list[tuple[float, Intervals]]()
        for slip in self._slips:
            at, load = slip.columns, float(s[slip.active])
            found, e, e_low = _unit(high[at], Intervals(low[at], rad[at]))
            push, push_low = products(np.array(-self._friction(at)), np.array(load))
            rubs, rest = products(push, e)
            others = (e_low * push) + (e_low * push_low) + rest + Intervals.exact(e) * push_low
            w.mid[at], w_low.mid[at], w_low.rad[at] = rubs, others.mid, others.rad
            speeds.append(found)
        f, f_low, f_rad = residual([(T.G, w.mid), (T.G, w_low.mid)], [], above(np.abs(T.G) @ w_low.rad, T.size))
        off = residual([(P.M, z[:nv]), (-P.J.T, f), (-P.J.T, f_low)], [-P.rhs], above(np.abs(P.J).T @ f_rad, len(f)))
        at_rows = self._at[self._free]
        still = [high[at_rows], low[at_rows], rad[at_rows]]
        for slip, (length, more) in zip(self._slips, speeds, strict=True) if not self._coulomb else ():
            for i in np.flatnonzero(self._free == slip.active):
                mu = self._friction(slip.columns)
                terms = np.array([still[0][i], still[1][i], *products(np.array(-mu), np.array(length))])
                still[0][i], still[1][i], still[2][i] = sums(terms, above(still[2][i] + (more * mu).size, 1))
        return (np.r_[off[0], still[0]], np.r_[off[1], still[1]], np.r_[off[2], still[2]]), y

    def _jacobian(self, z: Array, v: Array) -> Intervals:
        """F' over the box |z' - z| <= v."""
        P, T, nv, free = self._P, self._T, self._P.nv, self._free
        K = Intervals(np.zeros((len(z), len(z))), np.zeros((len(z), len(z))))
        top = Intervals.exact(P.M)
        columns, rows = Intervals.exact(T.G @ self._Phi), Intervals.exact(T.H @ self._Psi)
        columns = Intervals(columns.mid.copy(), columns.rad.copy())
        rows = Intervals(rows.mid.copy(), rows.rad.copy())
        if self._slips:
            high, low, rad = self._accelerations(z[:nv])
            y = Intervals(high, above(np.abs(low) + rad + self._HJ.size @ v[:nv], nv + 4))
            s = Intervals(self._start.copy(), np.zeros(len(self._start)))
            s.mid[free], s.rad[free] = z[nv:], v[nv:]
            for slip in self._slips:
                at, mu, load = slip.columns, self._friction(slip.columns), s[slip.active]
                t = y[at]
                speed = (t[0] * t[0] + t[1] * t[1]).sqrt()
                e = t / speed
                turn = Intervals(np.eye(2), np.zeros((2, 2))) - e[:, None] * e[None, :]
                G, H = T.G[:, at], T.H[:, at]
                top = top + product(product(product(P.J.T, G), turn * (load * mu / speed)), product(H.T, P.J))
                rubs = product(G, -(e * mu)) + T.G[:, at.stop]
                columns.mid[:, slip.active], columns.rad[:, slip.active] = rubs.mid, rubs.rad
                if not self._coulomb:
                    lifts = product(H, -(e * mu)) + T.H[:, at.stop]
                    rows.mid[:, slip.active], rows.rad[:, slip.active] = lifts.mid, lifts.rad
        right, below = -product(P.J.T, columns[:, free]), product(rows[:, free].T, P.J)
        for block, part in (((slice(nv), slice(nv)), top), ((slice(nv), slice(nv, None)), right)):
            K.mid[block], K.rad[block] = part.mid, part.rad
        K.mid[nv:, :nv], K.rad[nv:, :nv] = below.mid, below.rad
        return K

    def _inverse(self, K: Intervals, z: Array) -> Array:
        """About the inverse of the midpoints."""
        try:
            R = np.linalg.inv(K.mid)
        except np.linalg.LinAlgError:
            R = np.full(K.shape, np.nan)
        if not np.isfinite(R).all():
            raise self._not_regular(np.full(K.shape, np.inf), z)
        return R

    @staticmethod
    def _contraction(R: Array, K: Intervals) -> Array:
        """Bounds of |I - R K|, shape (n, n)."""
        E = product(R, K)
        return above(np.abs(np.eye(len(R)) - E.mid) + E.rad, 3)

    def _check_inequalities(self, s: Intervals, y: Intervals) -> tuple[str, int, str, float]:
        """Refuse unless every inequality of the law is strict; the least room.

        Raises:
            NotEnclosed: naming the one that is not.
        """
        least: tuple[str, int, str, float] = ("", 0, "", np.inf)
        rooms: list[tuple[Element, str, Intervals]] = []
        for need in self._modes.needs:
            k = need.active
            value = s[k] * need.sign + need.level
            if need.cone:
                value = s[k + 2] * need.sign - (s[k] * s[k] + s[k + 1] * s[k + 1]).sqrt()
            rooms.append((need.element, "its force is {} inside its set", value))
        for e in self._T.elements:
            rooms += [(e, "it separates at {}", value) for value in self._apart(e, y)]
        for slip in self._slips:
            t = y[slip.columns]
            element = self._T.elements[self._T.element_at[slip.columns.start]]
            rooms.append((element, "it slips at {}", (t[0] * t[0] + t[1] * t[1]).sqrt()))
        for e, words, value in rooms:
            name, mode, lower = self._P.rows[e.rows].name, self._modes.words[e], float(value.lower)
            if not value.positive().all():
                of = sum(other.rows == e.rows for other in self._T.elements)
                unit = "N or N m" if "force" in words else "m/s2 or rad/s2"
                raise NotEnclosed(
                    f"{name!r}, point {e.number + 1} of {of}, {mode}: {words.format(f'{float(value.mid):.3g} {unit}')}, and "
                    f"more than {float(value.rad):.1g} is needed to tell it from the limit. On the other side of the limit the "
                    "mode is another one. Move q, tau or the push a little.",
                    constraint=name, row=e.number, value=float(value.mid), needed=float(value.rad),
                )  # fmt: skip
            least = min(least, (name, e.number, mode, lower), key=lambda room: room[3])
        return least

    def _apart(self, e: Element, y: Intervals) -> list[Intervals]:
        """What must be above zero where a part carries nothing, or is at its bound."""
        T, at = self._T, e.columns
        if e.is_cone:
            if self._Phi[at].any():
                return []
            t = y[at.start : at.start + 2]
            lifts = y[at.start + 2]
            return [lifts if self._coulomb else lifts - e.mu * (t[0] * t[0] + t[1] * t[1]).sqrt()]
        idle = [j for j in range(at.start, at.stop) if not self._Phi[j].any() and T.lower[j] < T.upper[j]]
        return [y[j] if self._fixed[j] == T.lower[j] else -y[j] for j in idle]

    def _distance(self, a: Intervals, f: Intervals) -> tuple[float, float]:
        """(of the answer's acceleration, of its unique row forces): bounds of their distance from the exact ones.

        Raises:
            NotEnclosed: residuals above 1e-9, and the force of a row, or the inertia force of a coordinate, as far off.
        """
        given, scales = self._answer, self._answer.residuals.scales
        same = ~(np.abs(self._T.G @ self._Phi @ self._kernel) > RANK).any(axis=1)  # not unique: others will do
        off = np.where(same, (f - given.multipliers).size, 0.0)
        if not given.residuals.within(SOLVED):
            far = np.where(same, off - 2.0 * f.rad, 0.0) / scales.row_forces
            if far.max(initial=0.0) > SOLVED:
                i = int(far.argmax())
                rows = next(r for r in self._P.rows if i < self._P.slices[r.name].stop)
                row = i - self._P.slices[rows.name].start
                raise NotEnclosed(
                    f"{rows.name!r}, row {row + 1}: the force of the answer is {off[i]:.2g} N (N m) from the exact one, "
                    f"{f.mid[i]:.12g}; expected at most {SOLVED * scales.row_forces[i]:.1g}. Solve again, to smaller "
                    "residuals.",
                    constraint=rows.name, row=row, value=-float(far[i]), needed=-SOLVED,
                )  # fmt: skip
            moved = np.abs(self._P.M @ (given.a - a.mid)) / scales.equations
            if moved.max(initial=0.0) > SOLVED:
                i = int(moved.argmax())
                raise NotEnclosed(
                    f"coordinate {i} of the answer's acceleration, {given.a[i]:.12g}, is not the exact one, {a.mid[i]:.12g}: M "
                    f"times the difference is {moved[i]:.2g} of the terms of its equation; expected at most 1e-9. Solve again, "
                    "to smaller residuals.",
                    row=i, value=-float(moved[i]), needed=-SOLVED,
                )  # fmt: skip
        return float((a - given.a).size.max(initial=0.0)), float(off.max(initial=0.0))

    def _not_regular(self, E: Array, z: Array) -> NotEnclosed:
        """The error where the system could not be shown to have one zero near z."""
        T, nv = self._T, self._P.nv
        sizes = np.nan_to_num(E.sum(axis=1), nan=np.inf)
        i = int(sizes.argmax())
        k, size = int(self._free[i - nv]) if i >= nv else self._weakest, float(sizes[i])
        contracts = f"the test contracts by {size:.2g}, and less than 1 is needed" if np.isfinite(size) else "the test fails"
        if self._slips and not np.isfinite(size):  # a slip without a direction
            t = [self._accelerations(z[:nv])[0][slip.columns] for slip in self._slips]
            k = self._slips[int(np.argmin(np.linalg.norm(t, axis=1)))].active
            contracts = f"it slips at {np.linalg.norm(t, axis=1).min():.2g} m/s2"
        if k < 0:
            return NotEnclosed("the inertia matrix M could not be shown to be regular.", value=1.0, needed=size)
        e = T.elements[T.element_at[self._at[k]]]
        name = self._P.rows[e.rows].name
        return NotEnclosed(
            f"{name!r}, part {e.number + 1}, {self._modes.words[e]}: its rows are too near to depending on others, or its slip "
            f"too near to none, to show that there is one motion with these modes: {contracts}. Leave out redundant rows, or "
            "move q, tau or the push a little.",
            constraint=name, row=e.number, value=-size, needed=-1.0,
        )  # fmt: skip

    def _force(self, i: int, f: Intervals) -> Intervals:
        rows = self._P.rows[i]
        own = f[self._P.slices[rows.name]]
        return own if rows.resultant is None else product(rows.resultant, own)

    def _unique(self) -> dict[str, bool]:
        loose = np.abs(self._T.G @ self._Phi @ self._kernel)
        return {name: not (loose[part] > RANK).any() for name, part in self._P.slices.items()}

    def _words(self) -> dict[str, tuple[str, ...]]:
        said = self._modes.words
        return {r.name: tuple(word for e, word in said.items() if e.rows == i) for i, r in enumerate(self._P.rows)}

    def _scope(self) -> str:
        T, P = self._T, self._P
        rubs = self._coulomb and any(e.mu for e in T.elements)
        same = T.G is T.H or np.array_equal(T.G, T.H)
        regular = positive_definite(P.M, P.factor)
        if not rubs and same and regular:
            return ONLY
        associated = np.array_equal(T.G @ self._Phi, T.H @ self._Psi)
        if len(self._held) and not (associated and regular and not self._slips):
            return SHARED
        return NEARBY if self._slips else OF_MODES

    def _missed(self, y: Intervals) -> dict[str, float]:
        """Bounds of the accelerations of the columns that are left out; of constraints all of whose rows are zero, none."""
        T, out = self._T, dict[str, float]()
        at = self._at
        rows = np.array([T.elements[T.element_at[j]].rows for j in at], int)
        slips = {slip.active for slip in self._slips}
        for i, r in enumerate(self._P.rows):
            held = [k for k in self._held if rows[k] == i]
            moves = T.offset[T.slices[i]].any() or slips & set(held)
            if not held or not moves and int((rows[self._free] == i).sum()) == len(r):  # as many as rows: all rows are zero
                continue
            off = [float(y[at[k]].size) for k in held if self._coulomb or k not in slips]
            out[r.name] = max(off, default=0.0)
        return out
