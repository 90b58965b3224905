"""Contact modes of an answer: each point sticks, slips or breaks contact; each row is an equality, active or inactive.

While no mode changes, the inequalities of a law are equations. Allowed changes of the weights are columns Phi, and
what must stay zero are the accelerations along columns Psi, the same but where friction slips:

    holds     a bilateral row, a force inside an interval     a unit column each
    presses   a ray, whose acceleration is zero               a unit column
    sticks    a point, whose acceleration is zero             its three columns; of a pyramid, all its rays
    slips     starts to slip along t = y_t / |y_t|            Phi = (-mu t, 1); Psi = n (coulomb), (-mu t, 1) (convex)
    slides    slid already, along t                           Phi = (-mu t, 1), Psi = n
    opens     separates: no force                          none
    yields    a force at its bound                            none
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import RANK, Array, blas, identity
from rbd.problem.answer import Answer
from rbd.problem.cones import HALF_LINE, Free, Interval
from rbd.problem.force_set import Element, ForceSet, at_rest

RESOLUTION = 1e-6
"""Accelerations and forces up to this count as zero, scaled as the residuals are."""


@dataclass(frozen=True, eq=False)
class Slip:
    """A point that starts to slip.

    Attributes:
        columns: Its two tangential columns.
        direction: t, the unit vector of its tangential acceleration, shape (2,).
        rate: mu / |y_t|: friction force per normal force that a sideways acceleration turns away.
        active: Its number among the active columns; its weight is the normal force.
    """

    columns: slice
    direction: Array
    rate: float
    active: int

    @property
    def turning(self) -> Array:
        """-rate (1 - t t^T): change of the friction of a unit normal force with y_t, shape (2, 2)."""
        return -self.rate * (np.eye(2) - np.outer(self.direction, self.direction))


@dataclass(frozen=True)
class Need:
    """Inequality on a force: `sign * s + level >= 0`; for a cone, `sign * s_n >= |s_t|`.

    Attributes:
        element: The element that it belongs to.
        active: Number of the active column; for a cone, of its first.
        sign: 1, -1, or a cone's mu.
        level: Constant term [N].
        unit: Scale of the slack [N].
        cone: Whether it is a cone.
    """

    element: Element
    active: int
    sign: float
    level: float
    unit: float
    cone: bool = False


@dataclass(eq=False)
class Modes:
    """The active columns of an answer.

    Attributes:
        sets: The sets of the answer's weights: rays where the law has facets, the rows themselves where all are bilateral.
        w: The weights, shape (p,).
        y: Their accelerations, shape (p,).
        phi: Allowed changes of the weights, p-vectors.
        psi: Accelerations that stay zero, p-vectors.
        start: The answer's weights of the columns `phi`.
        slips: Points that start to slip.
        needs: Inequalities that must be strict.
        words: {element: its mode}.
    """

    sets: ForceSet
    w: Array
    y: Array
    phi: list[Array] = field(default_factory=list)
    psi: list[Array] = field(default_factory=list)
    start: list[float] = field(default_factory=list)
    slips: list[Slip] = field(default_factory=list)
    needs: list[Need] = field(default_factory=list)
    words: dict[Element, str] = field(default_factory=dict)

    def put(self, phi: Array, psi: Array, weight: float) -> int:
        """An active column; returns its number."""
        self.phi.append(phi)
        self.psi.append(psi)
        self.start.append(float(weight))
        return len(self.start) - 1

    def unit(self, j: int) -> Array:
        """The j-th unit vector, shape (p,)."""
        return identity(len(self.w))[j].copy()


def modes_of(answer: Answer) -> Modes:
    """The active columns of an answer; strictness of its inequalities is checked elsewhere."""
    P, w = answer.problem, answer.weights
    if w is None or P.bilateral:
        T, w = at_rest(*[Free(len(r)) for r in P.rows]), answer.multipliers
    else:
        T = P.force_set_of(answer.law)
    modes = Modes(T, w, T.accelerations(P.J @ answer.a + P.offset))
    along, push = answer.residuals.scales.of_columns(answer.weights, answer.law)
    still, sliding = RESOLUTION * along, {s.column for s in T.sliding}
    for e in T.elements:
        first = e.columns.start
        if e.is_cone:
            modes.words[e] = _cone(modes, e, still, float(push[first]), answer.law.kind == "coulomb")
            continue
        words = [_weight(modes, e, j, float(still[j]), float(push[j])) for j in range(first, e.columns.stop)]
        if first in sliding and words == ["presses"]:
            words = ["slides"]
        if e.facets:
            words = ["sticks" if set(words) == {"presses"} else "slips" if "presses" in words else words[0]]
        modes.words[e] = words[0]
    return modes


IN_PICTURES = {"opens": "open", "yields": "slips", "presses": "pushes", "slides": "slips"}
"""{mode: the word for it of trajectories and pictures}, where that is another one."""


def modes_at_points(answer: Answer) -> dict[str, tuple[str, ...]]:
    """{contact: mode of each of its points}: "open", "sticks", "slips", "holds" or "pushes", as of a trajectory.

    Contacts whose points are not known are left out, and all of them where a solver gave no weights of its forces.
    """
    found: dict[str, tuple[str, ...]] = {}
    if answer.weights is None or answer.problem.bilateral:
        return found
    words = modes_of(answer).words
    for number, rows in enumerate(answer.problem.rows):
        own = [(e, word, e.at_points) for e, word in words.items() if e.rows == number]
        if rows.patch is None or not own or any(at is None for _, _, at in own):
            continue
        at_point: list[list[str]] = [[] for _ in rows.patch.corners]
        for _, word, at in own:
            assert at is not None
            for i in np.flatnonzero(np.abs(at).reshape(len(at) // 3, -1).any(axis=1)).tolist():
                at_point[i].append(IN_PICTURES.get(word, word))
        found[rows.name] = tuple(["slips" if "slips" in some else (some or ["open"])[0] for some in at_point])
    return found


def _weight(modes: Modes, element: Element, j: int, still: float, unit: float) -> str:
    """A line, a ray or an interval."""
    low, high = modes.sets.lower[j], modes.sets.upper[j]
    if low == high:  # dry friction against its motion, or separating
        return "yields" if isinstance(element.shape, Interval) and element.shape != HALF_LINE else "opens"
    bounded = np.isfinite(low), np.isfinite(high)
    if any(bounded) and abs(modes.y[j]) > still:
        return "yields" if all(bounded) else "opens"
    k = modes.put(modes.unit(j), modes.unit(j), modes.w[j])
    unit = min(unit, high - low)
    ends = (Need(element, k, 1.0, -float(low), unit), Need(element, k, -1.0, float(high), unit))
    modes.needs += [need for need, there in zip(ends, bounded, strict=True) if there]
    return "presses" if any(bounded) and not all(bounded) else "holds"


def _cone(modes: Modes, element: Element, still: Array, unit: float, coulomb: bool) -> str:
    """A second-order cone."""
    at, mu = element.columns.start, element.mu
    y, w = modes.y[at : at + 3], modes.w[at : at + 3]
    t, n = float(np.hypot(y[0], y[1])), float(y[2])
    of_slip, of_normal = float(still[at]), float(still[at + 2])
    if t <= of_slip and abs(n) <= of_normal:
        first = [modes.put(modes.unit(j), modes.unit(j), modes.w[j]) for j in range(at, at + 3)][0]
        modes.needs.append(Need(element, first, mu, 0.0, unit, cone=True))
        return "sticks"
    if n > of_normal if coulomb else n - mu * t > of_normal + mu * of_slip:
        return "opens"
    e = y[:2] / t
    phi = modes.unit(at + 2)
    phi[at : at + 2] = -mu * e
    k = modes.put(phi, modes.unit(at + 2) if coulomb else phi, w[2])
    modes.needs.append(Need(element, k, 1.0, 0.0, unit))
    modes.slips.append(Slip(slice(at, at + 2), e, mu / t, k))
    return "slips"


def feedback_acceleration(answer: Answer) -> Array:
    """The change of a by the feedback through the active rows, shape (nv,) [m/s2, rad/s2].

        da = M^-1 J^T G dw      with      H^T (J da + feedback) = 0

    over the columns whose weights can change, G of the forces and H of the accelerations that stay zero: all of bilateral rows,
    rays and half-lines that press, weights between their bounds, second-order cones that stick; for a contact that slips, one
    column along its force, its direction fixed. Where the active rows are the same without the feedback, a - da is exactly the
    acceleration without it, except for slipping circular cones, whose direction turns.
    """
    P = answer.problem
    fed = P.offset - P.bias
    if not any(r.stabilised for r in P.rows) or not fed.any():
        return np.zeros(P.nv)
    modes = modes_of(answer)
    G, H = (X @ np.reshape(x, (-1, X.shape[1])).T for X, x in ((modes.sets.G, modes.phi), (modes.sets.H, modes.psi)))
    B = P.whitened @ G
    if np.array_equal(G, H):  # least squares in the inertia metric, where feedback is contradictory
        moved = np.linalg.lstsq(B.T, -G.T @ fed, rcond=RANK)[0]
    else:
        moved = B @ np.linalg.lstsq((P.whitened @ H).T @ B, -H.T @ fed, rcond=RANK)[0]
    return np.asarray(blas.dtrsv(P.factor, moved, lower=1, trans=1))
