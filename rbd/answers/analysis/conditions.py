"""Conditions that rows impose on an acceleration, A a + b = 0 or >= 0, and their least violation if they are infeasible.

A law with forces f = F z, z in a product of lines, half-lines and friction cones, requires that y = F^T (J a + offset) be zero
along lines, not negative along half-lines, and in the dual of each cone. Forces between two bounds, and contacts that open,
give no condition. Coulomb's law requires of a point at rest or sliding only that it does not penetrate.

The least violation is the smallest change of the rows that makes them feasible,

    minimise 1/2 |W s|^2     subject to     J a + offset + s in K*     for some a

Rows in the units they are given in, W a diagonal of weights. Its dual is a program in f = W^2 s in K,

    minimise 1/2 |W^-1 f|^2 + f . offset     subject to     J^T f = 0 ,

so that the violation itself certifies that there is no answer (see `rbd.answers.analysis.infeasibility`), and J^T f = 0, c + s
in K*, f . (c + s) = 0 together show that no violation is smaller. `rbd.solvers.conic_newton` solves it; `Conic.miss` checks
these, whatever the solver says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, as_array, block_diagonal, max_abs
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.problem.conic import Conic, ConicAnswer, Unknowns
from rbd.problem.force_set import Element, ForceSet
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.rows import Rows
from rbd.solvers.conic_newton import solve_conic

ROUNDING = 1e-11
"""A violation up to this, over max(1, |offset|), counts as none."""


@dataclass(frozen=True)
class ConditionMember:
    """The smallest part of a constraint: a scalar row, or a point with friction.

    Attributes:
        rows: The constraint's name.
        part: Name of the row or point; empty where there is only one.
    """

    rows: str
    part: str


@dataclass(frozen=True, eq=False)
class Conditions:
    """k conditions y = A a + b: y = 0, y >= 0, or of the three of a circular cone (tangent, tangent, normal) |y_t| <= y_n / mu.

    Attributes:
        force: Row forces of unit multipliers, shape (m, k).
        A: Shape (k, nv).
        b: Shape (k,) [m/s2, rad/s2].
        holds: Where y = 0, shape (k,).
        push: Unit force on a point with friction (tangent, tangent, normal), shape (k, 3); zero for scalar rows.
        member: Number of the member that each belongs to, shape (k,).
        cones: The three conditions of each circular cone, shape (r, 3).
        mu: Their friction coefficients, shape (r,).
        members: The members, by their numbers.
        span: For each member, rows that span its conditions, shape (1 or 3, nv); none for a member
            without conditions.
    """

    force: Array
    A: Array
    b: Array
    holds: Array
    push: Array
    member: Array
    cones: Array
    mu: Array
    members: tuple[ConditionMember, ...]
    span: tuple[Array, ...]

    def only(self, kept: frozenset[int]) -> Conditions:
        """The conditions of some members."""
        at = np.isin(self.member, list(kept))
        number, round_ = np.cumsum(at) - 1, at[self.cones[:, 0]]
        return replace(
            self, force=self.force[:, at], A=self.A[at], b=self.b[at], holds=self.holds[at], push=self.push[at],
            member=self.member[at], cones=number[self.cones[round_]], mu=self.mu[round_],
        )  # fmt: skip

    def violation(self, weights: Array) -> tuple[ConicAnswer, Array, float]:
        """(the answer of the dual program in z over a scale, the violation s, shape (m,), that scale: max(1, |b|)).

        Args:
            weights: Diagonal of W, shape (m,).
        """
        rate, G = max(1.0, max_abs(self.b)), self.force / weights[:, None]
        lower = np.where(self.holds, -math.inf, 0.0)
        lower[self.cones] = -math.inf
        z = Unknowns(len(self.b), G.T @ G, self.b / rate, lower, cones=self.cones, mu=self.mu)
        program = Conic.of({"z": z}, [({"z": self.A.T}, np.zeros(self.A.shape[1]))])
        found = solve_conic(program, newton=False)  # forces that balance are not unique
        return found, rate * (G @ found.x) / weights, rate


def conditions_of(problem: GaussProblem, law: Law) -> Conditions:
    """The conditions of a law on the rows of a problem.

    Args:
        problem: The rows, with their velocities.
        law: As `Answer.law`.
    """
    P, T = problem, problem.force_set_of(law)
    generators = block_diagonal([r.cone.generators()[0] for r in P.rows])
    members, span, cones, mu = [], [], [], []
    force, b, pushes = [np.zeros((P.m, 0))], [np.zeros(0)], [np.zeros((0, 3))]
    holds, member = list[bool](), list[int]()
    for number, e in enumerate(T.elements):
        r = P.rows[e.rows]
        members.append(ConditionMember(r.name, _words(r, e, generators[P.slices[r.name], e.source])))
        if e.is_cone and law.kind != "coulomb":
            H, offset, push, bounded_below, bounded_above = T.H[:, e.columns], T.offset[e.columns], np.eye(3), True, False
            cones.append(len(member) + np.arange(3))
            mu.append(e.mu)
        else:
            H, offset, push, bounded_below, bounded_above = _asked(T, e)
        if bounded_below and bounded_above:  # any acceleration is allowed
            span.append(np.zeros((0, P.nv)))
            continue
        sign = -1.0 if bounded_above else 1.0
        force.append(sign * H)
        b.append(sign * (H.T @ P.offset + offset))
        pushes.append(push)
        holds += [not (bounded_below or bounded_above)] * len(push)
        member += [number] * len(push)
        span.append((H @ np.linalg.pinv(push.T) if e.facets else H).T @ P.J)  # for a pyramid, the three axes of its point
    F = np.hstack(force)
    return Conditions(
        F, F.T @ P.J, np.concatenate(b), np.array(holds, bool), np.vstack(pushes), np.array(member, int),
        np.array(cones, int).reshape(-1, 3), np.array(mu), tuple(members), tuple(span),
    )  # fmt: skip


def _asked(T: ForceSet, e: Element) -> tuple[Array, Array, Array, bool, bool]:
    """(columns of forces, offsets of their accelerations, forces on the point, whether weights end below, and above)."""
    H, offset, push = T.H[:, e.columns], T.offset[e.columns], T.push[e.columns]
    if e.is_cone:  # under Coulomb's law
        return H[:, 2:], offset[2:], _ALONG_NORMAL, True, False
    if e.facets:
        length = np.linalg.norm(push, axis=1)
        return H / length, offset / length, push / length[:, None], True, False
    at = e.columns.start
    return H, offset, _ALONG_NORMAL if e.mu else np.zeros((1, 3)), bool(T.below[at]), bool(T.above[at])


_ALONG_NORMAL = np.array([[0.0, 0.0, 1.0]])
_AXES = ("tangent x", "tangent y", "normal", "turn about x", "turn about y", "turn about the normal")


def _words(r: Rows, e: Element, local: Array) -> str:
    """Which of a constraint's rows or points an element is; `local` are its columns among the rows."""
    if e.at_points is not None and not r.cone.separate and len(r) > 3:
        k, at = len(e.at_points) // 3, int(np.flatnonzero(np.abs(e.at_points).max(axis=1))[0]) // 3
        return f"corner {at + 1}" if k > 1 else "the corner"
    touched = np.flatnonzero(np.abs(local).max(axis=1))
    first = int(touched[0]) if len(touched) else 0
    if r.patch is not None and (r.cone.bilateral or r.cone.one_sided):
        axes = {1: _AXES[2:3], 3: _AXES[:3], 5: (*_AXES[:3], *_AXES[4:]), 6: _AXES}.get(len(r))
        if axes is not None:
            return axes[first]
    if len(r) <= e.shape.dim:
        return ""
    return f"row {first + 1}" if len(touched) == 1 else f"rows {first + 1} to {int(touched[-1]) + 1}"


def smallest_violation(P: GaussProblem, law: Law, weights: Array | None = None) -> tuple[Array, float]:
    """(s, optimality): the violation, shape (m,) [m/s2, rad/s2], and the largest scaled residual of its conditions.

    Args:
        P: Any problem; one with an answer has s = 0.
        law: As `Answer.law`.
        weights: Diagonal of W, shape (m,); ones if not given.
    """
    found, s, rate = conditions_of(P, law).violation(np.ones(P.m) if weights is None else weights)
    if max_abs(s) <= ROUNDING * rate:
        return np.zeros(P.m), found.miss
    return np.where(np.abs(s) > 1e-15 * rate, s, 0.0), found.miss


def row_weights(P: GaussProblem, given: Mapping[str, float | Array] | None) -> Array:
    """Diagonal of W, shape (m,), from {constraint: weight of its rows}; ones for constraints not named.

    Raises:
        InputError: unknown constraints, weights that are not positive.
    """
    out = np.ones(P.m)
    if given is None:
        return out
    if not isinstance(given, Mapping):
        raise InputError(f"weights are {given!r:.80}; expected {{constraint: weight}}.")
    for name, value in given.items():
        check_known("weights: no constraint", name, P.slices, InputError)
        w = as_array(f"weight of {name!r}", value)
        m = len(out[P.slices[name]])
        if w.shape not in ((), (m,)) or not ((w > 1e-100) & (w < 1e100)).all():
            raise InputError(f"weight of {name!r} is {value!r:.80}; expected one number > 0, or {m} of them.")
        out[P.slices[name]] = w
    return out


def relaxed(P: GaussProblem, s: Array) -> GaussProblem:
    """The problem whose rows have s added to their feedback."""
    added = {r.name: s[P.slices[r.name]] for r in P.rows}
    rows = [replace(r, feedback=r.feedback + added[r.name]) if added[r.name].any() else r for r in P.rows]
    return replace(P, rows=rows, origin=None, from_state=True)
