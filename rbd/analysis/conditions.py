"""The conditions that rows put on an acceleration: A a + b = 0 of bilateral rows, A a + b >= 0 of unilateral ones.

A law with forces f = F z, z in a product of lines, half-lines and friction cones, asks that y = F^T (J a + offset) be zero
along lines, not negative along half-lines, and in the dual of each cone. Forces between two bounds, and contacts that open,
ask nothing. Coulomb's law asks of a point at rest that it does not sink, and no more; so does a point that slides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, block_diagonal
from rbd.problem.cones import Free, LineCone, NonNegative, SecondOrderCone, WrenchCone, project_cones
from rbd.problem.force_set import Element, ForceSet
from rbd.problem.law import Law
from rbd.problem.problem import GaussProblem
from rbd.problem.rows import Rows


@dataclass(frozen=True)
class Member:
    """What a constraint may be split into: a scalar row, or a point that pushes and rubs.

    Attributes:
        rows: The constraint's name.
        part: Which of its rows or points, in words; empty where it has but one.
    """

    rows: str
    part: str


@dataclass(frozen=True, eq=False)
class Round:
    """A point under a circular friction cone: y = A a + b (tangent, tangent, normal) must obey |y_t| <= y_n / mu.

    Attributes:
        member: Its number among the members.
        force: Row forces of unit forces on the point, shape (m, 3).
        A: Shape (3, nv).
        b: Shape (3,).
        mu: Friction coefficient.
    """

    member: int
    force: Array
    A: Array
    b: Array
    mu: float

    def sunk(self, a: Array, more: Array | float = 0.0) -> Array:
        """The force in the friction cone that y works against: its length is y's distance to the dual cone, shape (3,)."""
        return project_cones(-(self.A @ a + self.b + more)[None], np.array([self.mu]))[0]


@dataclass(frozen=True, eq=False)
class Conditions:
    """k scalar conditions y = A a + b, and what is not scalar in `rounds`.

    Attributes:
        force: Row forces of unit multipliers, shape (m, k).
        A: Shape (k, nv).
        b: Shape (k,) [m/s2, rad/s2].
        holds: y = 0 where true, y >= 0 else, shape (k,).
        push: Unit force on a point that rubs (tangent, tangent, normal), shape (k, 3); zero of scalar rows.
        member: Number of the member that each belongs to, shape (k,).
        rounds: Points under circular cones.
        members: What the numbers stand for.
        span: For each member, the rows of which its conditions are combinations, shape (1 or 3, nv); none, of a member
            that asks nothing.
    """

    force: Array
    A: Array
    b: Array
    holds: Array
    push: Array
    member: Array
    rounds: tuple[Round, ...]
    members: tuple[Member, ...]
    span: tuple[Array, ...]

    def only(self, kept: frozenset[int]) -> Conditions:
        """Those of some members."""
        rounds = tuple(r for r in self.rounds if r.member in kept)
        return replace(self._of(np.isin(self.member, list(kept))), rounds=rounds)

    def thinned(self, carries: Array) -> Conditions:
        """Of each circular cone with rays that carry, those alone; `carries` has shape (k,)."""
        busy = [c.member for c in self.rounds if carries[self.member == c.member].any()]
        return self._of(carries | ~np.isin(self.member, busy))

    def _of(self, at: Array) -> Conditions:
        return replace(
            self, force=self.force[:, at], A=self.A[at], b=self.b[at], holds=self.holds[at], push=self.push[at],
            member=self.member[at],
        )  # fmt: skip

    def with_rays(self, rays: list[tuple[Round, Array]]) -> Conditions:
        """With one more condition r . y >= 0 for each ray r of a round's cone, a unit vector, shape (3,)."""
        if not rays:
            return self
        return replace(
            self,
            force=np.column_stack([self.force, *[c.force @ r for c, r in rays]]),
            A=np.vstack([self.A, *[r @ c.A for c, r in rays]]),
            b=np.r_[self.b, [r @ c.b for c, r in rays]],
            holds=np.r_[self.holds, [False] * len(rays)],
            push=np.vstack([self.push, *[r for _, r in rays]]),
            member=np.r_[self.member, [c.member for c, _ in rays]],
        )

    def fan(self) -> Conditions:
        """With a first fan of nine rays for each circular cone."""
        turn = np.arange(8) * (math.pi / 4.0)
        rays = []
        for c in self.rounds:
            around = np.vstack([c.mu * np.cos(turn), c.mu * np.sin(turn), np.ones(8)]) / math.hypot(c.mu, 1.0)
            rays += [(c, r) for r in around.T] + [(c, np.array([0.0, 0.0, 1.0]))]
        return self.with_rays(rays)


def conditions_of(problem: GaussProblem, law: Law) -> Conditions:
    """What a law asks of the rows of a problem.

    Args:
        problem: The rows, with their velocities.
        law: As `Answer.law`.
    """
    P, T = problem, problem.force_set_of(law)
    generators = block_diagonal([r.cone.generators()[0] for r in P.rows])
    members, span, rounds = [], [], []
    force, b, pushes = [np.zeros((P.m, 0))], [np.zeros(0)], [np.zeros((0, 3))]
    holds: list[bool] = []
    member: list[int] = []
    for number, e in enumerate(T.elements):
        r = P.rows[e.rows]
        members.append(Member(r.name, _words(r, e, generators[P.slices[r.name], e.source])))
        if e.is_cone and law.kind != "coulomb":
            H = T.H[:, e.columns]
            rounds.append(Round(number, H, H.T @ P.J, H.T @ P.offset + T.offset[e.columns], e.mu))
            span.append(rounds[-1].A)
            continue
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
        span.append((H @ np.linalg.pinv(push.T) if e.facets else H).T @ P.J)  # of a pyramid, the three axes of its point
    F = np.hstack(force)
    return Conditions(
        F, F.T @ P.J, np.concatenate(b), np.array(holds, bool), np.vstack(pushes), np.array(member, int),
        tuple(rounds), tuple(members), tuple(span),
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
    rubs = isinstance(e.shape, SecondOrderCone)
    return H, offset, _ALONG_NORMAL if rubs else np.zeros((1, 3)), bool(T.below[at]), bool(T.above[at])


_ALONG_NORMAL = np.array([[0.0, 0.0, 1.0]])
_AXES = ("tangent x", "tangent y", "normal", "turn about x", "turn about y", "turn about the normal")


def _words(r: Rows, e: Element, local: Array) -> str:
    """Which of a constraint's rows or points an element is; `local` are its columns among the rows."""
    if isinstance(r.cone, WrenchCone | LineCone):
        return f"corner {e.number + 1}" if len(r.cone.corners) > 1 else "the corner"
    touched = np.flatnonzero(np.abs(local).max(axis=1))
    first = int(touched[0]) if len(touched) else 0
    if r.patch is not None and isinstance(r.cone, Free | NonNegative):
        axes = {1: _AXES[2:3], 3: _AXES[:3], 5: (*_AXES[:3], *_AXES[4:]), 6: _AXES}.get(len(r))
        if axes is not None:
            return axes[first]
    if len(r) <= e.shape.dim:
        return ""
    return f"row {first + 1}" if len(touched) == 1 else f"rows {first + 1} to {int(touched[-1]) + 1}"
