"""The certificate of an answer: every equation of the law, recomputed in physical units, and its scale.

Scaled row by row and point by point: each residual is divided by the terms of its row (`rbd.problem.residuals`), and the
largest quotient counts. A light body that sinks is not hidden by a heavy one that does not.

Every row of an equation has a separate scale: a finger of a milligram is checked as strictly as the pelvis that carries it.
A row whose terms are all near zero would have no scale. Every scale has a lower bound: for accelerations, 1 m/s2 (rad/s2);
for forces, the force that accelerates the coordinate, or the row, at 1 m/s2, at most 1 N.

    equations of motion, row i     max(|M| |a|, |rhs|, |J|^T |f|)_i,                    at least min(1, M_ii)
    row i of a constraint          (|J| |a| + |bias| + |feedback|)_i,                   at least 1
    column h of a set              |h|^T (the above)
    force of row i                 |f_i|,                                               at least min(1, 1 / D_ii)
    weights of a point             sum of |weights| of its columns, and bounds (*),      at least min(1, 1 / (n^T D n))
    momentum, component k          max(|A_g| |a| + |bias|, |wrench|, forces with their arms)_k,
                                                                                        at least min(1, max_j |A_g|_kj)

with D = J M^-1 J^T, and n the column of the point's normal. (*) Without bounds where distances to the law are measured. One
lever arm is the radius of gyration, with the largest of the linear terms: rounding of the forces on a base turns the body
about its centre of mass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, add_wrench, is_finite, lazy, max_abs
from rbd.displayed import Displayed
from rbd.problem.force_set import ForceSet
from rbd.problem.gauss_problem import CONVEX, GaussProblem, Law
from rbd.problem.law_distance import STILLEST, bound_distances, largest_distance, points_of

SOLVED = 1e-9
"""Scaled residuals up to this are `solved`."""
ENOUGH = 0.1 * SOLVED
"""Scaled residuals below this are not refined further."""
USABLE = 1e-7
"""Scaled residuals up to this are `inaccurate`; above, there is no answer."""

_UNITS = {"stationarity": "N", "feasibility": "m/s2", "cone": "N", "complementarity": "N m/s2", "centroidal": "N"}


class Residual(float):
    """A residual in physical units, the largest entry, with its `scaled` value as an attribute.

    `scaled` is the largest quotient of an entry and the terms of its row or point. It may belong to another entry: 1e-8 N
    may be the largest residual and negligible against the 800 N on a pelvis, while 1e-10 N are a tenth of what moves a finger.
    """

    scaled: float

    def __new__(cls, value: float, scaled: float) -> Residual:
        """The largest entry, and the largest quotient of an entry and the size of its terms."""
        self = super().__new__(cls, value)
        self.scaled = scaled
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return Residual, (float(self), self.scaled)


@dataclass(frozen=True, eq=False, repr=False)
class Residuals(Displayed):
    """How far an answer is from the equations of its law; largest entries, zero for an exact answer.

    Each is a float in physical units with an attribute `scaled`, the largest entry over its scale; see
    `rbd.problem.residuals`.

    Attributes:
        values: The five below in order, in physical units; the last is None where it does not apply.
        answer: What the residuals are of: (problem, a, f, weights, law).
    """

    values: tuple[float, float, float, float, float | None]
    answer: tuple[GaussProblem, Array, Array, Array | None, Law]

    @property
    def stationarity(self) -> Residual:
        """|M a - rhs - J^T f| [N, N m]; row by row over max(|M||a|, |rhs|, |J|^T|f|), at least min(1, M_ii)."""
        return self._residual(0)

    @property
    def feasibility(self) -> Residual:
        """Distance of y = J a + offset to the set that the law admits [m/s2, rad/s2].

        Convex law: to K*. Of pyramids, along their rays as given; of true cones, point by point. Coulomb's law: how fast
        points sink. Scaled by |J||a| + |bias| + |feedback|, at least 1: how fast a point sinks by the terms of its normal
        row alone.
        """
        return self._residual(1)

    @property
    def cone(self) -> Residual:
        """Distance of f to K [N, N m]; row by row over |f_i|, at least the force that moves the row at 1 m/s2, or 1 N."""
        return self._residual(2)

    @property
    def complementarity(self) -> Residual:
        """|weight x acceleration|, the worst of the rays or points [N m/s2]; scaled, a point's distance to its law.

        Under Coulomb's law: normal force x normal acceleration, and f_t . y_t + mu f_n |y_t|, which vanishes where friction
        opposes the slip. The distance is what force or acceleration must change by, over its own scale, so that they are
        complementary (`rbd.problem.law_distance`): no product of two middling numbers passes as a small one.
        """
        return self._residual(3)

    @property
    def centroidal(self) -> Residual | None:
        """Contact wrenches plus weight plus external forces, less the rate of centroidal momentum [N, N m].

        About the centre of mass; each of the six components over its largest term, at least what a unit acceleration of one
        coordinate makes, or 1. It uses no contact Jacobian where the constraints have resultants, so it catches a wrong J.
        None where there is no floating base: the base's reaction is unknown.
        """
        return None if self.values[4] is None else self._residual(4)

    @property
    def scaled(self) -> dict[str, float]:
        """{equation: scaled residual}, centroidal left out where there is none."""
        return {name: r.scaled for name, r in self._given()}

    @property
    def worst(self) -> float:
        """The largest scaled residual; NaN if any is."""
        found = list(self.scaled.values())
        return math.nan if any(x != x for x in found) else max(found)

    def less_than(self, other: Residuals) -> bool:
        """Whether the worst is smaller than another's; NaN is larger than any number."""
        mine, theirs = self.worst, other.worst
        return mine < theirs or (math.isnan(theirs) and not math.isnan(mine))

    def within(self, tolerance: float) -> bool:
        """Whether every scaled residual is at most `tolerance`; False if any is NaN."""
        known: dict[float, bool] = self.__dict__.setdefault("_verdicts", {})
        found = known.get(tolerance)
        if found is None:
            found = known[tolerance] = self._within(tolerance)
        return found

    def _within(self, tolerance: float) -> bool:
        i = -1
        for x in self.values:
            i += 1
            if x is None or x == 0.0:
                continue
            # Residuals small against lower bounds of the scales pass without the scales themselves. NaN fails all comparisons.
            if not (self._at_most(i, x) <= tolerance or self._of(i) <= tolerance):
                return False
        return True

    def under(self, law: Law, weights: Array) -> Residuals:
        """The certificate of the same acceleration and row forces under another law; stationarity is reused.

        Args:
            law: The other law.
            weights: Of the columns of `problem.force_set_of(law)`.
        """
        P, a, f, _, _ = self.answer
        found = _judged(self.values[0], self.values[4], (P, a, f, weights, law))
        found.__dict__["scales"] = self.scales
        return found

    @lazy
    def scales(self) -> Scales:
        """The scales of all equations."""
        P, a, f, _, _ = self.answer
        return Scales(P, a, f)

    def _at_most(self, i: int, value: float) -> float:
        """An upper bound of the scaled residual of equation i, cheap."""
        P = self.answer[0]
        if i in (0, 4):
            least = P.least_inertia if i == 0 else P.least_momentum
        elif P.bilateral:
            least = 1.0
        elif i == 1:
            least = P.force_set_of(self.answer[4]).reach
        elif i == 2:
            least = 1.0 / max(1.0, max_abs(P.delassus.diagonal()))
        else:
            return self._farthest
        return value / least if least > 0.0 else math.inf

    @lazy
    def _farthest(self) -> float:
        return self._terms.most()

    def _of(self, i: int) -> float:
        """The scaled residual of equation i."""
        known: dict[int, float] = self.__dict__.setdefault("_known", {})
        if i not in known:
            value = self.values[i]
            assert value is not None
            known[i] = value if not 0.0 < value < math.inf else self._quotient(i)
        return known[i]

    def _quotient(self, i: int) -> float:
        P, a, f, _, _ = self.answer
        if i == 0:
            return _over(P.M @ a - P.rhs - P.J.T @ f, self.scales.equations)
        if i == 4:
            return _over(np.array(_imbalance(P, a, f)), self.scales.momentum)
        if i == 2:
            return _over(self._terms.off_cone, self.scales.row_forces)
        return float(self._quotients[i == 3].max(initial=0.0))

    @lazy
    def _terms(self) -> _Terms:
        return _terms(*self.answer)

    @lazy
    def _quotients(self) -> tuple[Array, Array]:
        return self._terms.over(self.scales)

    def _residual(self, i: int) -> Residual:
        value = self.values[i]
        return Residual(math.nan, math.nan) if value is None else Residual(value, self._of(i))

    def _given(self) -> list[tuple[str, Residual]]:
        every = ((name, getattr(self, name)) for name in _UNITS)
        return [(name, r) for name, r in every if r is not None]

    def __getstate__(self) -> dict[str, object]:
        return {"values": self.values, "answer": self.answer}  # all other cached values can be recomputed

    def __str__(self) -> str:
        return ", ".join(f"{name} {float(r):.1e} {_UNITS[name]}" for name, r in self._given())


def residuals_of(problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law | str = CONVEX) -> Residuals:
    """The certificate of acceleration a and row forces f under a law.

    Args:
        problem: The problem that is solved.
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,).
        weights: Of the columns of `problem.force_set_of(law)`; if None and rows can break, the best ones are computed.
        law: A `Law`, or its string.
    """
    law = Law.of(law)
    P, answer = problem, (problem, a, f, weights, law)
    if not math.isfinite(np.vdot(a, a) + np.vdot(f, f)):
        nan = math.nan
        return Residuals((nan, nan, nan, nan, None if P.balance is None else nan), answer)
    stationarity, centroidal = max_abs(P.M @ a - P.rhs - P.J.T @ f), None
    if P.balance is not None:
        centroidal = max(map(abs, _imbalance(P, a, f)))
    if P.bilateral:
        return Residuals((stationarity, max_abs(P.J @ a + P.offset), 0.0, 0.0, centroidal), answer)
    return _judged(stationarity, centroidal, answer)


def _judged(
    stationarity: float, centroidal: float | None, answer: tuple[GaussProblem, Array, Array, Array | None, Law]
) -> Residuals:
    terms = _terms(*answer)
    gap, off_cone, slack = max_abs(terms.gap), max_abs(terms.off_cone), max_abs(terms.slack)
    found = Residuals((stationarity, gap, off_cone, slack, centroidal), answer)
    found.__dict__["_terms"] = terms
    return found


class _Terms:
    """Residuals between row accelerations and row forces: `gap` and `slack` per generator column, `off_cone` per row.

    Attributes:
        gap: Distance of accelerations to the admissible set [m/s2].
        slack: Weight x acceleration where one of them must be zero [N m/s2].
        off_cone: Force less G w [N].
        slices: The columns of each constraint.
        over: By column, the gaps over the scales of their own points, and distances to the law.
        most: An upper bound of these distances.
    """

    __slots__ = ("gap", "most", "off_cone", "over", "slack", "slices")  # frozen dataclasses cost two microseconds more

    def __init__(
        self,
        gap: Array,
        slack: Array,
        off_cone: Array,
        slices: Sequence[slice],
        over: Callable[[Scales], tuple[Array, Array]],
        most: Callable[[], float],
    ) -> None:
        self.gap, self.slack, self.off_cone, self.slices, self.over, self.most = gap, slack, off_cone, slices, over, most


def _terms(P: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law) -> _Terms:
    c = P.J @ a + P.offset
    if P.bilateral:
        none = np.zeros(len(c))
        return _Terms(np.abs(c), none, none, list(P.slices.values()), lambda scales: (np.abs(c) / scales.rows, none), float)
    return _of_set(P.force_set_of(law), P.force_set, c, f, weights, coulomb=law.kind == "coulomb")


def _of_set(T: ForceSet, circular: ForceSet, c: Array, f: Array, weights: Array | None, *, coulomb: bool) -> _Terms:
    w = T.project(T.weights_of(f) if weights is None else weights)
    y = T.accelerations(c)
    if coulomb and T.only_cones:
        gap, slack = np.zeros(len(y)), np.zeros(len(y))
    else:
        gap, slack = T.gap(y), T.slack(w, y)
    if len(T.mu):
        n = T.cone_at + 2
        (y_1, y_2, y_n), (w_1, w_2, w_n) = y[T.cone_columns.T], w[T.cone_columns.T]
        slip, sinks = np.hypot(y_1, y_2), np.maximum(-y_n, 0.0)
        if coulomb:
            presses, rubs = np.abs(w_n * y_n), np.abs(w_1 * y_1 + w_2 * y_2 + T.mu * w_n * slip)
            gap[n], slack[n] = sinks, np.maximum(presses, rubs)

    def over(scales: Scales) -> tuple[Array, Array]:
        along, pushes = scales.along(T), scales.pushes(T, w)
        gaps, far = gap / along, bound_distances(T, w, y, along, pushes[T.element_at])
        if len(T.mu):
            of_normal = along[n]
            gaps[n] = sinks / of_normal
            if not coulomb:
                across = np.maximum(T.mu * slip - np.maximum(y_n, 0.0), 0.0)
                gaps[n] = np.maximum(gaps[n], across / (T.mu * along[T.cone_at] + of_normal))
        elif T.size > len(T.elements):  # pyramids: normal and tangential acceleration separately
            point, normal = T.element_at, T.sums(y * T.normal_share)
            falls = (np.maximum(-normal, 0.0) / (np.abs(T.normals).T @ scales.rows))[point]
            across = np.maximum(normal[point] - y - np.maximum(normal, 0.0)[point], 0.0)
            gaps = np.where((T.widths[point] > 1) & ~T.above, np.maximum(falls, across / along), gaps)
        points = points_of(T)
        if len(points.mu):
            far[~points.alone] = 0.0
            given, felt = (y, along) if circular is T else (circular.accelerations(c), scales.along(circular))
            at, push = circular.cone_columns, pushes[points.elements]
            far[points.at] = points.distances(points.forces(T, w), given[at], felt[at], push, coulomb=coulomb)
        return gaps, far

    def most() -> float:
        if T is circular and (quick := STILLEST * max_abs(y) / T.reach) <= ENOUGH:  # nothing moves: no point is looked at
            return quick
        return largest_distance(T, w, y, slack, coulomb=coulomb)

    return _Terms(gap, slack, f - T.G @ w, T.slices, over, most)


def _over(miss: Array, scales: Array) -> float:
    return float((np.abs(miss) / scales).max(initial=0.0))


@np.errstate(all="ignore")  # overflow is reported in the message
def blame(problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law = CONVEX) -> str:
    """Message: the constraint with the largest scaled residual, and how large it is.

    If values or their squares are NaN or infinite: the first constraint with such a force, else the whole motion.
    """
    if not problem.m:
        return "no constraint"
    for rows in problem.rows:
        if not is_finite(f[problem.slices[rows.name]]):
            return f"{rows.name} was given no finite force"
    if not is_finite(a):
        return "the constraints were given no finite acceleration"
    terms, scales = _terms(problem, a, f, weights, law), Scales(problem, a, f)
    gaps, slacks = terms.over(scales)
    off = np.abs(terms.off_cone) / scales.row_forces
    found = [(-1.0, "")]
    for rows, columns in zip(problem.rows, terms.slices, strict=True):
        own = problem.slices[rows.name]
        for quotient, value, words in (
            (gaps[columns], terms.gap[columns], "cannot hold: residual {:.2g} m/s2"),
            (off[own], terms.off_cone[own], "leaves its cone: by {:.2g} N"),
            (slacks[columns], terms.slack[columns], "pushes while it separates: by {:.2g} N m/s2"),
        ):
            most = float(quotient.max(initial=-1.0))
            found.append((math.inf if math.isnan(most) else most, f"{rows.name} {words.format(max_abs(value))}"))
    return max(found)[1]


def _imbalance(P: GaussProblem, a: Array, f: Array) -> list[float]:
    """Rate of centroidal momentum less the wrenches that cause it, shape (6,); needs a problem with a balance."""
    b = P.balance
    assert b is not None
    rate = (b.A_g @ a + b.rate_bias).tolist()
    total, com = b.wrench.tolist(), b.com.tolist()
    at = 0
    for rows in P.rows:
        part = f[at : at + len(rows)]
        at += len(rows)
        if rows.patch is not None and rows.patch.against is not None:
            continue  # between two bodies: an internal force, action and reaction cancel
        if rows.resultant is not None and rows.patch is not None:
            add_wrench(total, (rows.resultant @ part).tolist(), rows.patch.point.tolist(), com)
        elif b.base is not None:
            point, axes = b.base
            force = rows.J[:, :6].T @ part
            add_wrench(total, [*(axes @ force[:3]).tolist(), *(axes @ force[3:]).tolist()], point.tolist(), com)
    return [x - y for x, y in zip(rate, total, strict=True)]


def centroidal_terms(problem: GaussProblem) -> tuple[Array, Array, Array]:
    """(A_g_dot v, weight and external wrenches w, C), shapes (6,), (6,), (6, m): momentum needs A_g a + A_g_dot v = w + C f.

    Of a problem with a balance.
    """
    b = problem.balance
    assert b is not None
    rest, still = np.array(_imbalance(problem, np.zeros(len(problem.rhs)), np.zeros(problem.m))), np.zeros(len(problem.rhs))
    each = [rest - _imbalance(problem, still, unit) for unit in np.eye(problem.m)]
    return b.rate_bias, b.wrench, np.array(each).reshape(-1, 6).T


class Scales:
    """Sizes of the equations' terms at one answer, in physical units."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array) -> None:
        self._given = problem, a, f

    @lazy
    def equations(self) -> Array:
        """Of the equations of motion, shape (nv,) [N, N m]."""
        P, a, f = self._given
        terms = np.maximum(np.abs(P.M) @ np.abs(a), np.abs(P.rhs))
        return np.maximum(np.maximum(terms, np.abs(P.J).T @ np.abs(f)), np.minimum(P.M.diagonal(), 1.0))

    @lazy
    def rows(self) -> Array:
        """Of the rows' accelerations, shape (m,) [m/s2, rad/s2]."""
        P, a, _ = self._given
        return np.maximum(np.abs(P.J) @ np.abs(a) + P.offset_size, 1.0)

    @lazy
    def row_forces(self) -> Array:
        """Of the rows' forces, shape (m,) [N, N m]."""
        P, _, f = self._given
        return np.maximum(np.abs(f), least_forces(P.delassus.diagonal()))

    @lazy
    def momentum(self) -> Array:
        """Of the six components of the rate of centroidal momentum, shape (6,) [N, N m]."""
        P, a, f = self._given
        b = P.balance
        assert b is not None
        A = np.abs(b.A_g)
        own = np.maximum(np.maximum(A @ np.abs(a) + np.abs(b.rate_bias), np.abs(b.wrench)), np.minimum(A.max(axis=1), 1.0))
        for rows, part in zip(P.rows, P.slices.values(), strict=True):
            if rows.patch is not None and rows.patch.against is not None:
                continue
            if rows.resultant is not None and rows.patch is not None:
                wrench, point = np.abs(rows.resultant) @ np.abs(f[part]), rows.patch.point
            elif b.base is not None:
                point, axes = b.base
                force = np.abs(rows.J[:, :6]).T @ np.abs(f[part])
                wrench = np.concatenate([np.abs(axes) @ force[:3], np.abs(axes) @ force[3:]])
            else:
                continue
            own[: len(wrench)] = np.maximum(own[: len(wrench)], wrench)
            x, y, z = np.abs(point - b.com)
            own[3:] = np.maximum(own[3:], np.array([[0.0, z, y], [z, 0.0, x], [y, x, 0.0]]) @ wrench[:3])
        # Moments about the centre of mass: those about the base, less the moment of the forces with the arm between.
        own[3:] = np.maximum(own[3:], np.sqrt(A[3:].max() / max(A[:3].max(), 1e-300)) * own[:3].max())
        return own

    def of_columns(self, weights: Array | None, law: Law) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns of the law's weights; of the rows where all are bilateral.

        Args:
            weights: As `Answer.weights`; None where all rows are bilateral.
            law: As `Answer.law`.
        """
        P = self._given[0]
        if P.bilateral or weights is None:
            return self.rows, self.row_forces
        return self.of_set(P.force_set_of(law), weights)

    def of_set(self, T: ForceSet, w: Array) -> tuple[Array, Array]:
        """(accelerations, weights) of the columns of a force set, shapes (p,).

        The columns of a cone, or of its pyramid, share the scale of their weights; of a cone the two tangential ones share that
        of their accelerations.

        Args:
            T: The set.
            w: Its weights, shape (p,).
        """
        pushes = np.maximum(self.pushes(T, w), T.sums((np.abs(w) + T.bound_size) * (T.normal_share > 0.0)))
        return self.along(T), pushes[T.element_at]

    def along(self, T: ForceSet) -> Array:
        """Of the accelerations of the columns of a force set, shape (p,)."""
        along = np.abs(T.H).T @ self.rows + np.abs(T.offset)
        if len(T.mu):
            i, j, _ = T.cone_columns.T
            along[i] = along[j] = np.maximum(along[i], along[j])
        return along

    def pushes(self, T: ForceSet, w: Array) -> Array:
        """Of the weights of the elements of a force set, bounds left out, shape (e,)."""
        mobility = np.einsum("ij,ij->j", T.normals, self._given[0].delassus @ T.normals)
        return np.maximum(T.sums(np.abs(w) * (T.normal_share > 0.0)), least_forces(mobility))


def least_forces(mobility: Array | Sequence[float]) -> Array:
    """The force that accelerates a point of that mobility [1/kg] at 1 m/s2, 1 N at most."""
    return 1.0 / np.maximum(mobility, 1.0)
