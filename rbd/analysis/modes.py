"""Contact modes of an answer: each point sticks, slips or opens; each row holds, presses or yields.

While nothing changes its mode the inequalities of a law are equations. Allowed changes of the weights are columns Phi, and
what must stay zero are the accelerations along columns Psi, the same but where friction slips:

    holds     a row that holds, a force inside an interval    a unit column each
    presses   a ray, whose acceleration is zero               a unit column
    sticks    a point, whose acceleration is zero             its three columns; of a pyramid, all its rays
    slips     starts to slip along e = y_t / |y_t|            Phi = (-mu e, 1); Psi = n (coulomb), (-mu e, 1) (convex)
    slides    slid already, along t                           Phi = (-mu t, 1), Psi = n
    opens     moves away: carries nothing                     none
    yields    a force at its bound                            none
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array
from rbd.problem.answer import Answer
from rbd.problem.cones import Interval, SecondOrderCone
from rbd.problem.problem import GaussProblem

RESOLUTION = 1e-6
"""Accelerations and forces up to this count as zero, scaled as the residuals are."""


@dataclass(frozen=True)
class Part:
    """A part of a constraint's set: a row, a ray, a point.

    Attributes:
        rows: Number of its constraint.
        number: Its number among the parts of its constraint.
        columns: Its columns in the law's generator form.
        source: First of its columns among the generators of all constraints.
        dim: Number of those.
        mu: Friction coefficient; zero without friction.
        interval: Whether it is a force between two bounds.
    """

    rows: int
    number: int
    columns: tuple[int, ...]
    source: int
    dim: int
    mu: float
    interval: bool = False


@dataclass(frozen=True, eq=False)
class Generators:
    """The law's sets in generator form, as `rbd.problem.parts.Parts`, with the answer's weights and their accelerations y.

    Rays where the law speaks of facets, the rows themselves where all hold.
    """

    G: Array
    H: Array
    lower: Array
    upper: Array
    w: Array
    y: Array
    parts: tuple[Part, ...]
    cone_at: frozenset[int]


@dataclass(frozen=True, eq=False)
class Slip:
    """A point that starts to slip.

    Attributes:
        columns: Its two tangential columns.
        direction: e, the unit vector of its tangential acceleration, shape (2,).
        rate: mu / |y_t|: friction force per normal force that a sideways acceleration turns away.
        active: Its number among the active columns; its weight is the normal force.
    """

    columns: slice
    direction: Array
    rate: float
    active: int

    @property
    def turning(self) -> Array:
        """-rate (1 - e e^T): how the friction of a unit normal force answers a change of y_t, shape (2, 2)."""
        return -self.rate * (np.eye(2) - np.outer(self.direction, self.direction))


@dataclass(frozen=True)
class Need:
    """Room that a force must have: `sign * s + level >= 0`; of a cone, `sign * s_n >= |s_t|`.

    Attributes:
        part: Whose.
        active: Number of the active column; of a cone, of its first.
        sign: 1, -1, or a cone's mu.
        level: [N].
        unit: What the room is measured against [N].
        cone: Whether it is a cone.
    """

    part: Part
    active: int
    sign: float
    level: float
    unit: float
    cone: bool = False


@dataclass(eq=False)
class Modes:
    """The active columns of an answer.

    Attributes:
        generators: The sets.
        true_parts: Whether the sets are the problem's `parts`.
        phi: Allowed changes of the weights, p-vectors.
        psi: Accelerations that stay zero, p-vectors.
        start: The answer's weights of the columns `phi`.
        slips: Points that start to slip.
        needs: Inequalities that must hold strictly.
        words: {part: what it does}.
    """

    generators: Generators
    true_parts: bool
    phi: list[Array] = field(default_factory=list)
    psi: list[Array] = field(default_factory=list)
    start: list[float] = field(default_factory=list)
    slips: list[Slip] = field(default_factory=list)
    needs: list[Need] = field(default_factory=list)
    words: dict[Part, str] = field(default_factory=dict)

    def put(self, phi: Array, psi: Array, weight: float) -> int:
        """An active column; returns its number."""
        self.phi.append(phi)
        self.psi.append(psi)
        self.start.append(float(weight))
        return len(self.start) - 1

    def unit(self, j: int) -> Array:
        """The j-th unit vector, shape (p,)."""
        out = np.zeros(len(self.generators.w))
        out[j] = 1.0
        return out


def modes_of(answer: Answer) -> Modes:
    """The active columns of an answer; whether its forces have room is left to be checked."""
    P = answer.problem
    true_parts = not (answer.weights is None or P.bilateral or answer.law.facets)
    modes = Modes(_generators(answer, true_parts), true_parts)
    along, push = answer.residuals.scales.of_columns(answer.weights, answer.law)
    still, coulomb = RESOLUTION * along, answer.law.kind == "coulomb"
    sliding = {s.column for s in P.parts.sliding} if true_parts else set()
    for part in modes.generators.parts:
        if part.columns[0] in modes.generators.cone_at:
            modes.words[part] = _cone(modes, part, still, float(push[part.columns[0]]), coulomb)
            continue
        words = [_weight(modes, part, j, float(still[j]), float(push[j])) for j in part.columns]
        if part.columns[0] in sliding and words == ["presses"]:
            words = ["slides"]
        if len(words) > 1 and part.mu:  # rays of a pyramid
            words = ["sticks" if set(words) == {"presses"} else "slips" if "presses" in words else words[0]]
        modes.words[part] = words[0]
    return modes


def _weight(modes: Modes, part: Part, j: int, still: float, unit: float) -> str:
    """A line, a ray or an interval."""
    C = modes.generators
    low, high = C.lower[j], C.upper[j]
    if low == high:  # rubbing against its motion, or moving away
        return "yields" if part.interval else "opens"
    bounded = np.isfinite(low), np.isfinite(high)
    if any(bounded) and abs(C.y[j]) > still:
        return "yields" if all(bounded) else "opens"
    k = modes.put(modes.unit(j), modes.unit(j), C.w[j])
    unit = min(unit, high - low)
    if bounded[0]:
        modes.needs.append(Need(part, k, 1.0, -float(low), unit))
    if bounded[1]:
        modes.needs.append(Need(part, k, -1.0, float(high), unit))
    return "presses" if any(bounded) and not all(bounded) else "holds"


def _cone(modes: Modes, part: Part, still: Array, unit: float, coulomb: bool) -> str:
    """A second-order cone."""
    at, mu = part.columns[0], part.mu
    y, w = modes.generators.y[at : at + 3], modes.generators.w[at : at + 3]
    t, n = float(np.hypot(y[0], y[1])), float(y[2])
    of_slip, of_normal = float(still[at]), float(still[at + 2])
    if t <= of_slip and abs(n) <= of_normal:
        first = [modes.put(modes.unit(j), modes.unit(j), modes.generators.w[j]) for j in part.columns][0]
        modes.needs.append(Need(part, first, mu, 0.0, unit, cone=True))
        return "sticks"
    if n > of_normal if coulomb else n - mu * t > of_normal + mu * of_slip:
        return "opens"
    e = y[:2] / t
    phi = modes.unit(at + 2)
    phi[at : at + 2] = -mu * e
    k = modes.put(phi, modes.unit(at + 2) if coulomb else phi, w[2])
    modes.needs.append(Need(part, k, 1.0, 0.0, unit))
    modes.slips.append(Slip(slice(at, at + 2), e, mu / t, k))
    return "slips"


def _generators(answer: Answer, true_parts: bool) -> Generators:
    """The sets that the answer's weights belong to."""
    P, w = answer.problem, answer.weights
    c = P.J @ answer.a + P.offset
    if w is None or P.bilateral:
        free = np.full(P.m, np.inf)
        return Generators(np.eye(P.m), np.eye(P.m), -free, free, answer.multipliers, c, tuple(_parts(P, "rows")), frozenset())
    if not true_parts:
        R = P.rays
        return Generators(R.G, R.G, R.lower, R.upper, w, R.G.T @ c, tuple(_parts(P, "rays")), frozenset())
    T = P.parts
    y, cone_at = T.accelerations(c, coulomb=False), frozenset(int(j) for j in T.cone_at)
    return Generators(T.G, T.H, T.lower, T.upper, w, y, tuple(_parts(P, "parts")), cone_at)


def _parts(P: GaussProblem, form: str) -> Iterator[Part]:
    """Every part with its columns, as rows that hold, as rays, or as true parts."""
    source = column = 0
    for i, rows in enumerate(P.rows):
        if form == "rows":
            for number in range(len(rows)):
                yield Part(i, number, (column + number,), column + number, 1, 0.0)
            column += len(rows)
            continue
        sets = rows.cone.generators()[1]
        for number, part in enumerate(sets):
            mu = part.mu if isinstance(part, SecondOrderCone) else 0.0
            if form == "rays":
                count = part.facets if isinstance(part, SecondOrderCone) else part.dim
                columns = tuple(range(column, column + count))
                column += count
            else:
                span = P.parts.slices[i]
                columns = tuple(int(j) + span.start for j in np.flatnonzero(P.parts.point[span] == number))
            yield Part(i, number, columns, source, part.dim, mu, isinstance(part, Interval))
            source += part.dim
