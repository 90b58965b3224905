"""Which forces of one motion are unique, and the ranges of those that are not.

The same acceleration under the same law admits a convex set of forces (`rbd.answers.analysis.admissible_forces`). Over it each
normal force has a smallest and a largest value, both attained (`rbd.answers.analysis.extent`). A resultant is unique if no
direction of the set changes it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from rbd.answers.analysis.admissible_forces import Admissible
from rbd.answers.analysis.contact_modes import modes_of
from rbd.answers.analysis.extent import End, Reach
from rbd.arrays import Array, blas, rank_of
from rbd.displayed import Displayed
from rbd.problem.answer import CARRIES_NOTHING_N, Answer
from rbd.problem.gauss_problem import Law
from rbd.problem.programs import ENDS_WORK, Work
from rbd.problem.residuals import SOLVED, residuals_of
from rbd.problem.rows import Patch
from rbd.records import Field


@dataclass(frozen=True, eq=False)
class Attained:
    """Forces that give the same motion under the same law, certified by its residuals.

    Attributes:
        multipliers: Row forces, as `Solution.multipliers`.
        weights: As `Solution.weights`.
        corner_forces: As `Solution.corner_forces`.
    """

    multipliers: Array
    weights: Array | None
    corner_forces: dict[str, Array]

    def times(self, factor: float) -> Attained:
        """These forces times a factor above zero."""
        weights = None if self.weights is None else factor * self.weights
        return Attained(factor * self.multipliers, weights, {name: factor * f for name, f in self.corner_forces.items()})


@dataclass(frozen=True, eq=False)
class Range:
    """Range of one number with the same motion under the same law.

    Attributes:
        lowest: Smallest value; -inf where there is none, NaN where it was not found.
        highest: Largest value; inf where there is none, NaN where it was not found.
        value: Value for the forces that were returned.
        at_lowest: Forces with the smallest value; None where infinite, not found, or not attained within the
            certificate.
        at_highest: Forces with the largest value, or None as in `at_lowest`.
        unique: Whether all forces give one value; False also where that was not found.
    """

    lowest: float
    highest: float
    value: float
    at_lowest: Attained | None
    at_highest: Attained | None
    unique: bool

    @property
    def found(self) -> bool:
        """Whether both limits were found within `rbd.problem.programs.ENDS_WORK`."""
        return not (math.isnan(self.lowest) or math.isnan(self.highest))

    def times(self, factor: float) -> Range:
        """The range of the number times a factor above zero."""
        low, high = (None if x is None else x.times(factor) for x in (self.at_lowest, self.at_highest))
        return Range(factor * self.lowest, factor * self.highest, factor * self.value, low, high, self.unique)

    def digits(self, least: float) -> str:
        """Its text to four digits, as impulses of small robots are small; zero up to a size."""
        ends = [self.value] if self.unique else [self.lowest, self.highest]
        return " .. ".join("?" if math.isnan(x) else "0" if abs(x) <= least else f"{x:.4g}" for x in ends)

    def __str__(self) -> str:
        if self.unique:
            return _short(self.value)
        return f"{_short(self.lowest)} .. {_short(self.highest)}"


@dataclass(frozen=True, eq=False)
class ContactUniqueness(Displayed):
    """Uniqueness of one contact's forces, with their ranges.

    Attributes:
        name: The contact's name.
        normal: Its normal force [N].
        corners: The normal force of each of its corners [N]. A bilateral contact has no corner law: its corners may pull.
        share: Its vertical force (world z) over that of all contacts with the ground together; for a robot at rest without
            other forces, its share of the weight. None for a contact between two bodies, or where that sum is not unique or
            zero.
        unique_wrench: Whether its net force (for a point) or wrench is unique.
        unique_centre_of_pressure: Whether the centre of pressure is unique; None where it is unloaded.
    """

    name: str
    normal: Range
    corners: tuple[Range, ...]
    share: Range | None
    unique_wrench: bool
    unique_centre_of_pressure: bool | None

    @property
    def unique_normal(self) -> bool:
        """Whether its normal force is unique."""
        return self.normal.unique

    def __str__(self) -> str:
        point = len(self.corners) == 1
        pressure = self.unique_centre_of_pressure and not point
        what = [("force" if point else "wrench", self.unique_wrench), ("normal", self.unique_normal)]
        unique = ", ".join(word for word, holds in [*what, ("centre of pressure", pressure)] if holds) or "nothing"
        lowest, highest = min(r.lowest for r in self.corners), max(r.highest for r in self.corners)
        corners = "-" if point else f"{_short(lowest)} .. {_short(highest)}"
        share = "-" if self.share is None else _percent(self.share)
        return f"{self.name:<16} {str(self.normal):>21}{share:>20}{corners:>22}  {unique}"


@dataclass(frozen=True, eq=False, repr=False)
class Uniqueness(Displayed):
    """Which forces of one motion are unique, and the ranges of the others; from `solution.uniqueness()`.

    Attributes:
        law: The law that the forces obey.
        rows: Number of constraint rows m.
        rank: Of J.
        active_rank: Rank of J^T over the forces that the law admits: an open point has none, a slipping one only one direction.
        row_freedom: Dimension of the row forces that give the same motion; zero where they are unique.
        corner_freedom: The same for corner forces (with row forces of constraints that are not contacts).
        force_choice: Which of these forces were returned.
        contacts: {contact: uniqueness of its forces}.
        others: {constraint that is not a contact: ranges of its row forces, in its units}.
        motion_freedom: Dimension of the family of motions, with the same contact modes, that satisfy Coulomb's law; zero under
            the other laws, whose motion is unique, and where it is isolated. The ranges are of the motion returned.
        exact: Whether the limits are exact, to 1e-9 of the forces; False where the circular cones leave no interior and were
            widened by 1e-10.
        found: Whether all limits and dimensions were found within `rbd.problem.programs.ENDS_WORK`. Others are NaN,
            printed as "?"; if the dimension of the set was not found, `row_freedom` and `corner_freedom` are upper bounds.
        quantity: "force", or "impulse" of `rbd.impact`: its ranges are in N s and N m s.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> unique = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face]).uniqueness()
        >>> unique.row_freedom, unique.corner_freedom  # one wrench, many ways to share it between four corners
        (0, 6)
    """

    law: Law
    rows: int
    rank: int
    active_rank: int
    row_freedom: int
    corner_freedom: int
    force_choice: str
    contacts: dict[str, ContactUniqueness]
    others: dict[str, tuple[Range, ...]]
    motion_freedom: int
    exact: bool
    found: bool = True
    quantity: str = "force"

    fields: ClassVar[tuple[Field, ...]] = (
        Field("row_freedom", (), "1", "dimension of the row forces of the same motion; 0: unique"),
        Field("corner_freedom", (), "1", "the same of the forces at corners"),
        Field("motion_freedom", (), "1", "dimension of the family of motions; 0: one motion"),
        Field(
            "normal_ranges", (), "N", "lowest and highest normal force of each contact with the same motion",
            lambda unique: {
                f"{end}_{name}": getattr(contact.normal, end)
                for name, contact in unique.contacts.items()
                for end in ("lowest", "highest")
            },
            "normal_{}", "normal force, {}",
        ),
        Field(
            "limits_exact", (), "", "whether the ranges are exact, to 1e-9", lambda unique: unique.exact, certificate=True
        ),
        Field("limits_found", (), "", "whether all ranges were found", lambda unique: unique.found, certificate=True),
    )  # fmt: skip

    def as_impulses(self, speed: float, choice: str) -> Uniqueness:
        """The same for impulses, where forces are impulses over a speed, as in `Impact.solution`.

        Args:
            speed: The speed [m/s].
            choice: Which impulses were returned.
        """
        others = {name: tuple(r.times(speed) for r in ranges) for name, ranges in self.others.items()}
        return replace(self, others=others, force_choice=choice, quantity="impulse")

    def __repr__(self) -> str:
        what = self.quantity
        return f"Uniqueness({self.row_freedom} internal {what}s of the rows, {self.corner_freedom} of the corners)"

    def __str__(self) -> str:
        lines = [
            f"law: {self.law}; {self.rows} rows of rank {self.rank}; active rows: rank {self.active_rank}",
            f"internal {self.quantity}s: {self.row_freedom} of the rows, {self.corner_freedom} of the corners; "
            f"returned: {self.force_choice}",
        ]
        if self.motion_freedom:
            lines.append(
                f"the motion is one of a family of dimension {self.motion_freedom}: the distribution of the "
                "load over slipping points is not determined, and their friction depends on it"
            )
        if self.contacts:
            lines.append(f"  {'contact':<16}{'normal force [N]':>22}{'share of the weight':>20}{'one corner [N]':>22}  unique")
        lines += [f"  {contact}" for contact in self.contacts.values()]
        text: Callable[[Range], str] = str
        if self.quantity == "impulse":
            least = 1e-9 * max((abs(r.value) for ranges in self.others.values() for r in ranges), default=0.0)
            text = partial(Range.digits, least=least)
        lines += [f"  {name:<16} {self.quantity} {', '.join(map(text, ranges))}" for name, ranges in self.others.items()]
        if not self.exact:
            lines.append("  The cones have no interior here: ends are those of cones wider by 1e-10.")
        if not self.found:
            lines.append(f"  ?: not found within {ENDS_WORK:.0e} multiplications; fewer contacts take less.")
        if any(math.isinf(r.lowest) or math.isinf(r.highest) for r in self._ranges()):
            lines.append(
                f"  inf: unbounded; contacts may push, or bilateral ones pull, against each other with any {self.quantity}."
            )
        return "\n".join(lines)

    def _ranges(self) -> list[Range]:
        own = [r for c in self.contacts.values() for r in (c.normal, *c.corners)]
        return own + [r for ranges in self.others.values() for r in ranges]


def uniqueness_of(
    adm: Admissible, a: Array, law: Law, corner_forces: Mapping[str, Array], choice: str, f: Array, motion_freedom: int = 0
) -> Uniqueness:
    """Uniqueness of the forces of one motion; computed for `rbd.Solution.uniqueness`.

    Args:
        adm: The forces that give the same motion under the same law.
        a: The motion, shape (nv,).
        law: The law.
        corner_forces: Corner forces that were returned, {contact: (k, 3)}.
        choice: Which forces these are.
        f: Row forces that were returned, shape (m,).
        motion_freedom: See `Uniqueness`.
    """
    return _Asker(adm, a, law, corner_forces, f).answer(choice, motion_freedom)


class _Asker:
    def __init__(self, adm: Admissible, a: Array, law: Law, corner_forces: Mapping[str, Array], f: Array) -> None:
        self.adm, self.a, self.law = adm, a, law
        self.reach = Reach(adm, Work(ENDS_WORK))
        stacked = adm.corners @ adm.start + adm.corners_at
        for name, span in adm.spans.items():
            stacked[span] = corner_forces[name].ravel() if name in adm.has_corners else f[adm.problem.slices[name]]
        self.returned = stacked
        self.ends: dict[bytes, End] = {}

    def answer(self, choice: str, motion_freedom: int) -> Uniqueness:
        adm, P = self.adm, self.adm.problem
        vertical = self._vertical()
        patches = {rows.name: rows.patch for rows in P.rows if rows.patch is not None and rows.name in adm.has_corners}
        contacts = {name: self._contact(name, patch, vertical) for name, patch in patches.items()}
        others = {
            name: tuple(self._range(function) for function in np.eye(len(self.returned))[span])
            for name, span in adm.spans.items()
            if name not in adm.has_corners and span.stop > span.start
        }
        row_freedom = rank_of(adm.rows @ self.reach.directions, unit=True)
        found = self.reach.known and all(end.found for end in self.ends.values())
        return Uniqueness(
            self.law, P.m, adm.rank, adm.active_rank, row_freedom, self.reach.dimension, choice, contacts, others,
            motion_freedom, not self.reach.thin, found,
        )  # fmt: skip

    def _along(self, name: str, direction: Array) -> Array:
        """The function that maps the stacked corner forces to a contact's net force along a world direction."""
        span = self.adm.spans[name]
        return self._on(span, np.tile(direction, (span.stop - span.start) // 3))

    def _on(self, span: slice, factors: Array) -> Array:
        """The function of the stacked corner forces with these factors on a part of them, zero on the rest."""
        out = np.zeros(len(self.returned))
        out[span] = factors
        return out

    def _vertical(self) -> Array | None:
        """The function that gives the share of the vertical force of all contacts with the ground; None where that is zero.

        None also where it is not unique.
        """
        up, on_ground = np.array([0.0, 0.0, 1.0]), np.zeros(len(self.returned))
        for rows in self.adm.problem.rows:
            if rows.name in self.adm.has_corners and rows.patch is not None and rows.patch.against is None:
                on_ground += self._along(rows.name, up)
        total = float(on_ground @ self.returned)
        if abs(total) < CARRIES_NOTHING_N or not self.reach.is_unique((on_ground @ self.adm.corners)[None]):
            return None
        return on_ground / total

    def _contact(self, name: str, patch: Patch, vertical: Array | None) -> ContactUniqueness:
        n, span = patch.axes[:, 2], self.adm.spans[name]
        normal = self._range(self._along(name, n))
        normals = np.broadcast_to(patch.corner_axes, ((span.stop - span.start) // 3, 3, 3))[:, :, 2]
        corners = [self._range(self._on(slice(span.start + 3 * i, span.start + 3 * i + 3), m)) for i, m in enumerate(normals)]
        share = self._range(self._on(span, vertical[span])) if vertical is not None and patch.against is None else None
        wrench = self.reach.is_unique(self.adm.rows[self.adm.problem.slices[name]])
        return ContactUniqueness(name, normal, tuple(corners), share, wrench, self._pressure(name, patch, normal))

    def _pressure(self, name: str, patch: Patch, normal: Range) -> bool | None:
        """Whether moments about the centre of pressure vanish for all forces of the set."""
        if not (normal.highest > CARRIES_NOTHING_N or normal.value > CARRIES_NOTHING_N):
            return None
        if len(patch.corners) == 1:
            return True
        stacked = self.returned
        if normal.value <= CARRIES_NOTHING_N:  # use a force that is not zero
            if normal.at_highest is None:
                return False
            x = self._largest(self._along(name, patch.axes[:, 2])).x
            assert x is not None
            stacked = self.adm.corners @ x + self.adm.corners_at
        axes, k, span = patch.axes, len(patch.corners), self.adm.spans[name]
        local = stacked[span].reshape(k, 3) @ axes
        at = (patch.corners[:, :2] * local[:, 2:]).sum(axis=0) - (patch.corners[:, 2:] * local[:, :2]).sum(axis=0)
        at = at / local[:, 2].sum()
        moments = np.zeros((2, len(stacked)))
        for j in range(2):
            arms = np.outer(patch.corners[:, j] - at[j], axes[:, 2]) - np.outer(patch.corners[:, 2], axes[:, j])
            moments[j, span] = arms.ravel()
        return self.reach.is_unique(moments @ self.adm.corners)

    def _range(self, function: Array) -> Range:
        """Range over the set of a linear function of the stacked corner forces."""
        value = float(function @ self.returned)
        if self.reach.is_unique((function @ self.adm.corners)[None]):
            own = self._attained(self.adm.start)
            return Range(value, value, value, own, own, True)
        high, low = self._largest(function), self._largest(-function)
        highest = max(high.value, value) if high.found else math.nan
        lowest = min(-low.value, value) if low.found else math.nan
        return Range(lowest, highest, value, self._attained(low.x), self._attained(high.x), False)

    def _largest(self, function: Array) -> End:
        """`Reach.largest` of a function of the stacked corner forces; cached, as the same functions recur."""
        scale = float(np.abs(function).max())
        key = np.round(function / scale, 14).tobytes()
        if key not in self.ends:
            end = self.reach.largest(function @ self.adm.corners)
            value = (end.value + float(function @ self.adm.corners_at)) / scale
            self.ends[key] = replace(end, value=value)
        end = self.ends[key]
        return replace(end, value=end.value * scale)

    def _attained(self, x: Array | None) -> Attained | None:
        if x is None:
            return None
        f, w = self.adm.forces(x), self.adm.law_weights(x)
        given = residuals_of(self.adm.problem, self.a, f, w, self.law)
        return Attained(f, w, self.adm.corner_forces(x)) if given.within(SOLVED) else None


def motion_freedom(answer: Answer) -> int:
    """Dimension of the family of motions with the same contact modes; zero where the motion is isolated.

    Under the convex law and where all rows are bilateral the motion is the minimum of a strictly convex function: unique. Under
    Coulomb's law friction depends on the load of each point. Where a patch slips and turns on more than three corners statics
    does not determine the loads, each distribution changes the friction, and a family of motions satisfies the law.

    With the forces that can change, J^T Phi, and the accelerations that must stay zero, Psi^T J, it is the rank of the first
    less that of the second (see `rbd.answers.analysis.contact_modes`), in the metric of inertia. Motions with other modes are
    not searched.
    """
    if answer.law.kind != "coulomb":
        return 0
    P, modes = answer.problem, modes_of(answer)
    if not modes.phi:
        return 0
    T = modes.sets
    return _rank(P.factor, P.J.T @ (T.G @ np.array(modes.phi).T)) - _rank(P.factor, P.J.T @ (T.H @ np.array(modes.psi).T))


def _rank(L: Array, X: Array) -> int:
    X = blas.dtrsm(1.0, L, X, lower=1)
    length = np.linalg.norm(X, axis=0)
    return rank_of(X / np.where(length > 0.0, length, 1.0), unit=True)


def _short(value: float, digits: int = 2) -> str:
    if math.isnan(value):
        return "?"
    if math.isinf(value):
        return "inf" if value > 0.0 else "-inf"
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0 turns the -0.00 of rounding into 0.00


def _percent(share: Range) -> str:
    if share.unique:
        return f"{100.0 * share.value:.1f} %"
    ends = [_short(100.0 * x, 1) for x in (share.lowest, share.highest)]
    return " .. ".join(ends) + (" %" if math.isfinite(share.highest - share.lowest) else "")
