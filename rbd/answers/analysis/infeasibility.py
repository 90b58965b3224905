"""Infeasible constraints: an irreducible conflicting set of rows, with its Farkas certificate.

The rows require y = J a + offset in K*. By Farkas' lemma [Farkas1902] no acceleration does so if (and, for pyramids and
bilateral rows, only if) there are forces f in K with

    J^T f = 0     and     f . offset = -1 :

forces whose sum on every body is zero, with f . offset not zero. Then f . y = -1 for every a, while f . y >= 0
for all y in K*: whatever the motion, some row is violated by at least 1 / sum |f_i|. The forces of the least violation
(`rbd.answers.analysis.conditions`) are such ones. Minimal such forces are the vertices of a polyhedron, and their supports are
the irreducible contradictions [GleesonRyan1990]: rows are left out one after another as long as a violation is left.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rbd.answers.analysis.conditions import Conditions, conditions_of
from rbd.arrays import RANK, Array, largest_first, max_abs, null_space, range_of
from rbd.displayed import Displayed
from rbd.problem.force_set import at_rest
from rbd.problem.gauss_problem import CONVEX, GaussProblem, Law, checked
from rbd.problem.programs import CERTIFICATE_LEFT_OUT, CERTIFICATE_PROGRAMS, CERTIFICATE_SETS

CONTRADICTS = 1e-8
"""Rows that can be satisfied to this, over max(1, |offset|), do not contradict each other: that is rounding."""
BALANCED = 1e-12
"""Largest |J^T f| of a certificate, over sum |f_i| times the longest row of J."""
_NAMED = 8  # constraints named in a message


@dataclass(frozen=True, eq=False, repr=False)
class Contradiction(Displayed):
    """Rows that no acceleration satisfies together, though any proper subset can be satisfied.

    Other rows of the problem may contradict each other, too: leave one of these out and search again.

    Attributes:
        rows: {constraint: names of its rows or points that take part}; empty for a constraint with only one.
        certificate: {constraint: row forces f, shape (m,)}: in K, J^T f = 0, and work -1 on the required motion. Zero for
            constraints that take no part. [1 / (m/s2)], as work is scaled to one.
        violation: Every motion violates some of these rows by at least this [m/s2, rad/s2]; for a point with friction, its
            distance to the dual cone.
        smallest: No set of fewer constraints, nor fewer rows of these, contradicts itself: all were tried. False: another
            set might be smaller, as the search ended at a limit (`rbd.problem.programs`).
        unbalanced: Largest entry of `|J^T f|`. The certificate is valid for motions with `sum |a_i| < 1 / unbalanced`.
        law: The law whose rows they are.
        met: {bilateral constraint: the feasible part of its required -offset, shape (m,)}, by least
            squares over all bilateral rows, in their units [m/s2, rad/s2].
        unmet: {bilateral constraint: the infeasible part}; zero where they agree. met + unmet = -offset.

    Example:
        >>> up = rbd.Rows("up", J=np.eye(1), bias=np.array([-1.0]), cone=rbd.problem.Free(1))  # a = 1
        >>> down = rbd.Rows("down", J=np.eye(1), bias=np.array([1.0]), cone=rbd.problem.Free(1))  # a = -1
        >>> found = rbd.answers.analysis.contradiction(rbd.GaussProblem(M=np.eye(1), rhs=np.zeros(1), rows=[up, down]))
        >>> print(found.who, found.violation, found.certificate["up"])
        'up' and 'down' 1.0 [0.5]
    """

    rows: Mapping[str, tuple[str, ...]]
    certificate: Mapping[str, Array]
    violation: float
    smallest: bool
    unbalanced: float
    law: Law
    met: Mapping[str, Array]
    unmet: Mapping[str, Array]

    @property
    def who(self) -> str:
        """The names of the rows, e.g. "'left_sole' (normal) and 'right_sole' (tangent x, normal)"."""
        named = [f"{name!r:.60}" + (f" ({', '.join(words)})" if any(words) else "") for name, words in self.rows.items()]
        if len(named) > _NAMED:
            named = [*named[: _NAMED - 1], f"{len(named) - _NAMED + 1} others"]
        return named[0] if len(named) == 1 else f"{', '.join(named[:-1])} and {named[-1]}"

    @property
    def claim(self) -> str:
        """Message: which constraints contradict each other, and by how much."""
        each = "contradicts itself" if len(self.rows) == 1 else "contradict each other"
        return f"{self.who} {each}; every motion misses some of these rows by {self.violation:.3g} m/s2 (rad/s2) or more"

    @property
    def unmet_most(self) -> str:
        """Message: the infeasible part of the bilateral rows; empty where they agree."""
        sizes = {name: max_abs(s) for name, s in self.unmet.items()}
        rounding = CONTRADICTS * max([1.0, *(max_abs(x) for x in self.met.values())])
        beyond = [name for name in sizes if sizes[name] > rounding]
        worst = [beyond[i] for i in largest_first([sizes[name] for name in beyond])]
        if not worst:
            return ""
        said = ", ".join(f"{name!r:.60} {sizes[name]:.3g}" for name in worst[:4])
        return f"Bilateral rows cannot be met, by up to [m/s2, rad/s2]: {said}{', ...' if len(worst) > 4 else ''}."

    def __str__(self) -> str:
        size = "No smaller set does." if self.smallest else "A smaller set was not excluded."
        lines = [
            f"{self.claim} (law {self.law}). {size}",
            "Certificate: these row forces balance on every body, and do work -1 on whatever motion is required of them:",
        ]
        lines += [f"  {name:<16} {_numbers(self.certificate[name])}" for name in self.rows]
        if self.unmet_most:
            lines.append("The part of the bilateral rows that cannot be met (least squares) [m/s2, rad/s2]:")
            lines += [f"  {name:<16} {_numbers(s)}" for name, s in self.unmet.items() if max_abs(s) > CONTRADICTS]
        return "\n".join(lines)


def contradiction(problem: GaussProblem, law: Law | str = CONVEX) -> Contradiction | None:
    """A smallest set of rows that contradict each other under a law, with its certificate; None if none was found.

    Contradictions within rounding (`CONTRADICTS`) do not count. Every certificate is verified before it is returned. None
    concerns only y in K*: a point that already slides can have no answer for another reason (Painleve), which
    `Solution.reason` gives; and circular cones that are disjoint only at infinity have no certificate.

    Args:
        problem: The rows, with their velocities.
        law: A `Law`, or its string: "bilateral", "convex" (circular cones), "convex, 4 facets" or "coulomb". The last requires
            of a point at rest only that it does not penetrate, so that certificates push along normals there.

    Raises:
        InputError: if the problem or the law is not one.

    Example:
        >>> up = rbd.Rows("up", J=np.eye(1), bias=np.array([-1.0]), cone=rbd.problem.Free(1))  # a = 1
        >>> down = rbd.Rows("down", J=np.eye(1), bias=np.array([1.0]), cone=rbd.problem.Free(1))  # a = -1
        >>> print(rbd.answers.analysis.contradiction(rbd.GaussProblem(M=np.eye(1), rhs=np.zeros(1), rows=[up, down])).claim)
        'up' and 'down' contradict each other; every motion misses some of these rows by 1 m/s2 (rad/s2) or more
    """
    law = Law.of(law)
    search = _ConflictSearch(conditions_of(checked(problem), law))
    if (found := search.farkas(frozenset(range(len(search.asked.members))))) is None:
        return None
    of_rows = {
        r.name: frozenset(i for i, m in enumerate(search.asked.members) if m.rows == r.name and len(search.asked.span[i]))
        for r in problem.rows
    }
    found, few_constraints = search.smallest([g for g in of_rows.values() if g], found)
    singles = [frozenset([i]) for g in of_rows.values() if g & found.members for i in sorted(g)]
    found, few_rows = search.smallest(singles, found)
    taking_part = {name: sorted(own & found.members) for name, own in of_rows.items()}
    words = {name: tuple(search.words(i, found) for i in own) for name, own in taking_part.items() if own}
    certificate = {name: found.force[part].copy() for name, part in problem.slices.items()}
    met, unmet = split(problem)
    return Contradiction(
        words, certificate, found.violation, few_constraints and few_rows, found.unbalanced, law, met, unmet
    )  # fmt: skip


def split(problem: GaussProblem) -> tuple[dict[str, Array], dict[str, Array]]:
    """(met, unmet): what the bilateral constraints require, -offset, split into its feasible and infeasible part.

    By least squares over all bilateral rows, in their units. Shapes (m,) each; met + unmet = -offset.
    """
    held = {r.name: len(r) for r in problem.rows if at_rest(r.cone).bilateral and len(r)}
    if not held:
        return {}, {}
    at = np.concatenate([np.arange(problem.m)[problem.slices[name]] for name in held])
    U = range_of(problem.J[at])
    required = -problem.offset[at]
    met = U @ (U.T @ required)
    met_by, unmet_by = (np.split(x, np.cumsum([*held.values()])[:-1]) for x in (met, required - met))
    return dict(zip(held, met_by, strict=True)), dict(zip(held, unmet_by, strict=True))


def _numbers(x: Array) -> str:
    # Rounding before adding zero turns -0.0000 into 0.
    return np.array2string(np.round(x, 4) + 0.0, precision=4)


@dataclass(frozen=True, eq=False)
class _Farkas:
    """A verified certificate: row forces (m,) that do work -1, and {member that takes part: force of a point with friction}."""

    force: Array
    push: Mapping[int, Array]
    violation: float
    unbalanced: float

    @property
    def members(self) -> frozenset[int]:
        """Numbers of the members that take part."""
        return frozenset(self.push)


class _ConflictSearch:
    """Certificates of subsets of the members."""

    def __init__(self, asked: Conditions) -> None:
        self.asked = asked
        self.longest = float(np.linalg.norm(self.asked.A, axis=1).max(initial=0.0))
        self.tried: dict[frozenset[int], _Farkas | None] = {}
        self.programs = 0
        self.complete = True
        """Whether every program so far was solved within its limits."""

    def farkas(self, members: frozenset[int]) -> _Farkas | None:
        """A certificate with forces on these members only, or None."""
        if members not in self.tried:
            self.tried[members] = None if self._independent(members) else self._solved(members)
        return self.tried[members]

    def smallest(self, groups: Sequence[frozenset[int]], found: _Farkas) -> tuple[_Farkas, bool]:
        """(certificate, whether all sets were tried) on the fewest groups of members found; none of them can be left out."""
        kept = [g for g in groups if g & found.members]
        for g in list(kept):
            if self.programs >= CERTIFICATE_LEFT_OUT:
                return found, False
            without = [h for h in kept if h is not g]
            fewer = self.farkas(frozenset().union(*without)) if g in kept else None
            if fewer is not None:
                found, kept = fewer, [h for h in without if h & fewer.members]
        sets, last = CERTIFICATE_SETS, self.programs + CERTIFICATE_PROGRAMS
        for size in range(1, len(kept)):
            sets -= math.comb(len(groups), size)
            for some in combinations(groups, size) if sets >= 0 else ():
                if self.programs >= last:
                    return found, False
                if (fewer := self.farkas(frozenset().union(*some))) is not None:
                    return fewer, self.complete
        return found, sets >= 0 and self.complete

    def words(self, member: int, found: _Farkas) -> str:
        """Names of the parts of a constraint that take part."""
        said, push = self.asked.members[member].part, found.push[member]
        if not push.any():
            return said
        along = "normal" if math.hypot(push[0], push[1]) <= 1e-9 * push[2] else "friction cone"
        return f"{said}, {along}" if said else along

    def _independent(self, members: frozenset[int]) -> bool:
        """Whether the members' rows are independent, so that all accelerations are possible: no search needed."""
        stacked = np.concatenate([self.asked.A[:0], *(self.asked.span[i] for i in members)])
        if not len(stacked):
            return True
        length = np.linalg.norm(stacked, axis=1)
        if len(stacked) > stacked.shape[1] or length.min() <= RANK * self.longest:
            return False
        return float(np.linalg.svd(stacked / length[:, None], compute_uv=False)[-1]) > 1e-6

    def _solved(self, members: frozenset[int]) -> _Farkas | None:
        """The certificate that the least violation is, made exact to rounding, with every condition checked."""
        C = self.asked.only(members)
        self.programs += 1
        answer, _, _ = C.violation(np.ones(len(C.force)))
        self.complete &= answer.solved
        z = _balanced(C, answer.x, self.longest)
        work = float(C.b @ z)
        if not work < 0.0:
            return None
        some = z != 0.0
        push = {int(i): z[C.member == i] @ C.push[C.member == i] for i in np.unique(C.member[some])}
        rubs = C.push.any(axis=1)
        total = float(np.abs(z[~rubs]).sum()) + sum(float(np.linalg.norm(f)) for f in push.values())
        violation = -work / total
        if violation <= CONTRADICTS * max(1.0, max_abs(C.b[some])):
            return None
        z = z / -work
        unbalanced = max_abs(C.A.T @ z)
        if unbalanced > BALANCED * float(np.abs(z).sum()) * self.longest:
            return None
        return _Farkas(C.force @ z, {i: f / -work for i, f in push.items()}, violation, unbalanced)


def _balanced(C: Conditions, z: Array, longest: float) -> Array:
    """The nearest z with A^T z = 0 on the same support and the same edges of cones; what changes its sign is left out.

    Args:
        C: The conditions.
        z: Multipliers, shape (k,).
        longest: Norm of the longest row of all conditions.
    """
    most = 1e-7 * max_abs(z)
    rays = np.eye(len(z))
    pushed = np.linalg.norm(z[C.cones], axis=1)
    edge = (pushed > most) & (C.mu * z[C.cones[:, 2]] - np.hypot(z[C.cones[:, 0]], z[C.cones[:, 1]]) < 1e-9 * pushed)
    for cone in C.cones[edge]:  # the edge itself in place of the normal
        rays[cone, cone[2]] = z[cone] / z[cone[2]]
    inside = np.zeros(len(z), bool)
    inside[C.cones[~edge]] = True
    some = np.abs(z) > most
    some[C.cones[:, :2]] = (~edge & (pushed > most))[:, None]
    rows = rays.T @ C.A
    length = np.linalg.norm(rows, axis=1)
    length[length <= RANK * longest] = longest or 1.0
    x = z * length
    while some.any():
        out = np.zeros(len(z))
        N = null_space((rows[some] / length[some, None]).T, unit=True)
        for _ in range(2):  # twice is exact to rounding
            out[some] = N @ (N.T @ x[some])
        out[np.abs(out) <= 1e-12 * max_abs(out)] = 0.0
        wrong = ~C.holds & ~inside & (out < 0.0)
        if not wrong.any():
            return np.asarray(rays @ (out / length))
        some &= ~wrong
    return np.zeros(len(z))
