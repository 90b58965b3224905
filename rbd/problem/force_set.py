"""`ForceSet`: the force sets of a problem as weights on generators, reduced by what velocities already determine.

Forces are f = G w with weights w in a product of simple sets (lines, half-lines, intervals, circular cones); each
weight is paired with one entry of y = H^T c + offset, the acceleration of its point. G and H are the same for contacts at rest;
`rbd.problem.contact_motion` gives the forces left to a contact that moves. At rest, w and y obey the law: y in K* (convex), or
y + mu |y_t| n in K* (coulomb), complementary to w.

With pyramids in place of circular cones (`ForceSet.pyramids`) every weight has separate bounds. The n-facet pyramid
*circumscribes* the friction cone, its first facet across the contact's x axis (n = 4 reads |fx|, |fy| <= mu fz): rays at
(2k + 1) pi / n with tangential radius mu / cos(pi / n). The *inscribed* one has radius mu.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise

import numpy as np

from rbd.arrays import Array, block_diagonal, lazy, locked
from rbd.errors import InputError
from rbd.problem.cones import HALF_LINE, Cone, Part, checked_generators, nearest_weights, project_cones, pyramid
from rbd.problem.contact_motion import REST_SPEED, MotionJudge, Opening, Sliding
from rbd.problem.programs import within
from rbd.problem.rows import Rows

_TURNS = 1e-11
"""Centripetal accelerations up to this are rounding [m/s2]."""


@dataclass(frozen=True, eq=False)
class Element:
    """One simple set: of a row, or of a point.

    Attributes:
        rows: Number of its constraint.
        number: Its number among the elements of its constraint.
        shape: The set, all contacts at rest.
        columns: Its columns in the force set.
        source: Its columns among the generators of all constraints.
        facets: Rays of the pyramid that replaces its cone; 0 where none does.
        at_points: Forces (tangent, tangent, normal) at the points of its constraint that its generators make, shape (3k, dim);
            None where that is not known.
    """

    rows: int
    number: int
    shape: Part
    columns: slice
    source: slice
    facets: int = 0
    at_points: Array | None = None

    @property
    def mu(self) -> float:
        """Friction coefficient; zero without friction."""
        return self.shape.mu

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.columns.stop - self.columns.start)

    @property
    def is_cone(self) -> bool:
        """Whether its columns are those of a circular cone: tangent, tangent, normal."""
        return not self.facets and self.size == 3


@dataclass(frozen=True, eq=False)
class ForceSet:
    """Stacked sets of forces as weights on columns, p in all.

    Attributes:
        G: Forces of unit weights, shape (m, p).
        H: Directions of the accelerations, y = H^T c + offset, shape (m, p); G itself where no point slides.
        offset: Centripetal part of y, shape (p,): corners of a turning patch; zero else.
        lower: Bounds of the weights, shape (p,): -inf for lines and for the columns of circular cones.
        upper: Upper bounds of the weights, shape (p,); inf where there is none.
        push: Force of a unit weight on its point, in contact axes (tangent, tangent, normal), shape (p, 3).
        elements: The simple sets, in the order of their columns.
        slices: The columns of each constraint, in the order of the rows.
        sliding: Points whose friction follows their motion.
        openings: Points that move away: their forces are zero.
        impact: Message: which contact approaches, an impact; empty where none does.
    """

    G: Array
    H: Array
    offset: Array
    lower: Array
    upper: Array
    push: Array
    elements: tuple[Element, ...]
    slices: tuple[slice, ...]
    sliding: tuple[Sliding, ...] = ()
    openings: tuple[Opening, ...] = ()
    impact: str = ""

    @classmethod
    def of(cls, rows: Sequence[Rows], rest_speed: float = REST_SPEED) -> ForceSet:
        """The sets of stacked rows, with circular cones, and with their velocities taken into account.

        Args:
            rows: The rows.
            rest_speed: Contacts that move no faster count as at rest [m/s, rad/s].
        """
        resting = at_rest(*[r.cone for r in rows])
        if resting.bilateral:
            return resting
        # Whether rows rest does not depend on other rows: the same rows always have the same columns. The norm comes
        # first, a tenth of `speed`.
        moves = [not np.vdot(r.velocity, r.velocity) <= rest_speed**2 and not r.speed <= rest_speed for r in rows]
        if not any(moves):
            return resting
        velocities = [r.velocity if fast else None for r, fast in zip(rows, moves, strict=True)]
        return _stacked([r.cone for r in rows], [r.name for r in rows], velocities, rest_speed)

    @property
    def size(self) -> int:
        """Number of columns p."""
        return int(self.G.shape[1])

    @lazy
    def cone_at(self) -> Array:
        """First columns of the circular cones (tangent, tangent, normal), shape (k,)."""
        return locked(np.array([e.columns.start for e in self.elements if e.is_cone], int))

    @lazy
    def mu(self) -> Array:
        """Their friction coefficients, shape (k,)."""
        return locked(np.array([e.mu for e in self.elements if e.is_cone], float))

    @lazy
    def facets(self) -> tuple[int, ...]:
        """Facets of the pyramids that replace the cones, ascending."""
        return tuple(sorted({e.shape.facets for e in self.elements if e.shape.facets}))

    @lazy
    def pyramids(self) -> ForceSet:
        """The same with circumscribed pyramids in place of circular cones; itself where there are none."""
        return self.with_pyramids() if len(self.mu) else self

    def with_pyramids(self, *, inscribed: bool = False, facing: Array | None = None) -> ForceSet:
        """The same with each circular cone replaced by a pyramid.

        Args:
            inscribed: Take the pyramid inside the cone (radius mu) in place of the one around it (mu / cos(pi / n)).
            facing: Of each cone a tangential direction in its first two entries, shape (p,): its pyramid is turned about the
                normal until a facet faces there. The pyramid around a cone touches it in the middle of a facet.
        """
        rays, elements, firsts = list[Array](), list[Element](), list[int]()
        for e in self.elements:
            facets, at = e.shape.facets if e.is_cone else 0, len(firsts)
            block = _rays(e.mu, facets, inscribed=inscribed) if facets else _ONE
            rays.append(block if facing is None or not facets else _facing(facing[e.columns]) @ block)
            firsts += [e.columns.start] * (facets or 1)
            elements.append(replace(e, columns=slice(at, len(firsts)), facets=facets))
        lower = np.where(np.isin(firsts, self.cone_at), 0.0, self.lower[firsts])
        return self.exchanged(rays, lower, self.upper[firsts], elements)

    def exchanged(self, blocks: Sequence[Array], lower: Array, upper: Array, elements: Sequence[Element]) -> ForceSet:
        """The same with other columns.

        Args:
            blocks: Of each element its old columns by its new ones.
            lower: Bounds of the new weights, shape (p,).
            upper: Upper bounds, likewise.
            elements: The sets with their new columns.
        """
        E = block_diagonal(blocks)
        G = locked(self.G @ E)
        new = {old.columns.start: e.columns.start for old, e in zip(self.elements, elements, strict=True)}
        return replace(
            self, G=G, H=G if self.H is self.G else locked(self.H @ E), offset=locked(self.offset @ E), lower=locked(lower),
            upper=locked(upper), push=locked(E.T @ self.push), elements=tuple(elements),
            slices=column_slices(elements, len(self.slices)),
            sliding=tuple([replace(s, column=new[s.column]) for s in self.sliding]),
        )  # fmt: skip

    @lazy
    def is_line(self) -> Array:
        """Which weights are unbounded, or belong to a circular cone, shape (p,)."""
        return ~self.below & ~self.above

    @lazy
    def bilateral(self) -> bool:
        """Whether every weight is unbounded: all constraints are bilateral."""
        return not len(self.mu) and bool(self.is_line.all())

    @lazy
    def has_lines(self) -> bool:
        """Whether some weight is free; without circular cones."""
        return bool(self.is_line.any())

    @lazy
    def has_intervals(self) -> bool:
        """Whether some weight has a finite upper bound, or a finite lower bound other than zero."""
        return bool((self.above | (self.below & (self.lower != 0.0))).any())

    @lazy
    def below(self) -> Array:
        """Which weights have a lower bound, shape (p,)."""
        return np.isfinite(self.lower)

    @lazy
    def above(self) -> Array:
        """Which weights have an upper bound, shape (p,)."""
        return np.isfinite(self.upper)

    @lazy
    def finite_lower(self) -> Array:
        """Lower bounds, zero where there is none, shape (p,)."""
        return np.where(self.below, self.lower, 0.0)

    @lazy
    def finite_upper(self) -> Array:
        """Upper bounds, zero where there is none, shape (p,)."""
        return np.where(self.above, self.upper, 0.0)

    @lazy
    def bound_size(self) -> Array:
        """Sum of the finite bounds' absolute values, shape (p,)."""
        return np.abs(self.finite_lower) + np.abs(self.finite_upper)

    @lazy
    def cone_columns(self) -> Array:
        """Columns of the circular cones, shape (k, 3)."""
        return self.cone_at[:, None] + np.arange(3)

    @lazy
    def only_cones(self) -> bool:
        """Whether every column is one of a circular cone."""
        return 3 * len(self.mu) == self.size

    @lazy
    def starts(self) -> Array:
        """First columns of the elements, shape (e,)."""
        return np.array([e.columns.start for e in self.elements], int)

    @lazy
    def widths(self) -> Array:
        """Numbers of columns of the elements, shape (e,)."""
        return np.diff(self.starts, append=self.size)

    @lazy
    def element_at(self) -> Array:
        """Number of each column's element, shape (p,)."""
        return np.repeat(np.arange(len(self.elements)), self.widths)

    @lazy
    def normal_share(self) -> Array:
        """Shares of the columns in their element's normal, shape (p,): a cone's third column, a pyramid's columns equally."""
        out = 1.0 / self.widths[self.element_at]
        out[self.cone_columns] = 0.0, 0.0, 1.0
        return out

    def sums(self, columns: Array) -> Array:
        """Sums over the columns of each element, shape (..., e), of an array of shape (..., p)."""
        return np.asarray(np.add.reduceat(columns, self.starts, axis=-1)) if self.size else columns

    @lazy
    def normals(self) -> Array:
        """Columns of the elements' normals, shape (m, e)."""
        return self.sums(self.G * self.normal_share)

    @lazy
    def reach(self) -> float:
        """Smallest sum of absolute entries of a column of H, 1 at most."""
        return float(np.abs(self.H).sum(axis=0).min(initial=1.0))

    @lazy
    def slipping(self) -> tuple[int, ...]:
        """Indices of the constraints with points that slide, or corners of a patch that turns."""
        slides, turns = {s.column for s in self.sliding}, (np.abs(self.offset) > _TURNS) & (self.lower < self.upper)
        told = {e.rows for e in self.elements if e.columns.start in slides or turns[e.columns].any()}
        return tuple(sorted(told))

    def accelerations(self, c: Array, *, coulomb: bool = False) -> Array:
        """Accelerations paired with weights, shape (p,): H^T c + offset; with mu |y_t| added along normals if `coulomb`."""
        y = self.H.T @ c + self.offset
        if coulomb and len(self.mu):
            y[self.cone_at + 2] += self.mu * np.hypot(y[self.cone_at], y[self.cone_at + 1])
        return np.asarray(y)

    def project(self, w: Array) -> Array:
        """The nearest weights in the product of the sets."""
        out = np.minimum(np.maximum(w, self.lower), self.upper)
        if len(self.mu):
            out[self.cone_columns] = project_cones(w[self.cone_columns], self.mu)
        return out

    def point_map(self, constraint: int) -> Array | None:
        """Forces at a contact's points that weights make, in its axes, shape (3k, p); None where they are not at points."""
        own = [e for e in self.elements if e.rows == constraint]
        if not own or any(e.at_points is None for e in own):
            return None
        out = np.zeros((len(own[0].at_points), self.size))  # type: ignore[arg-type]
        for e in own:
            out[:, e.columns] = e.at_points @ self.push[e.columns, 3 - e.shape.dim :].T
        return out

    def point_accelerations(self, y: Array, constraint: int) -> Array:
        """Accelerations of the points of a unilateral contact, shape (k, 3), in its axes, of `accelerations` (p,)."""
        own = [e for e in self.elements if e.rows == constraint]
        given = np.concatenate([y[e.columns] @ self.push[e.columns, 3 - e.shape.dim :] for e in own])
        at = np.hstack([e.at_points for e in own])  # type: ignore[misc]
        return np.asarray(given @ np.linalg.pinv(at)).reshape(-1, 3)

    def weights_of(self, f: Array) -> Array:
        """Weights within the sets whose row forces are nearest to f, shape (p,).

        Where circular cones share rows (corners of a patch) projected gradients are used, slow and approximate.
        """
        if not len(self.mu):
            return within(self.G, f, self.lower, self.upper)
        return nearest_weights(self.G, f, self.project, 2000)

    def gap(self, y: Array) -> Array:
        """Distance of each acceleration from the values that its set allows, whatever the weight, shape (p,).

        A line allows 0, a half-line any y >= 0; the distance to a circular cone's dual is in the entry of its normal.
        """
        out = np.where(self.below, 0.0, np.maximum(y, 0.0)) + np.where(self.above, 0.0, np.maximum(-y, 0.0))
        if len(self.mu):
            Y = y[self.cone_columns]
            out[self.cone_columns] = 0.0
            out[self.cone_at + 2] = np.linalg.norm(project_cones(-Y, self.mu), axis=1)  # the distance to K*, by Moreau
        return out

    def slack(self, w: Array, y: Array) -> Array:
        """|weight x acceleration| of each column, for weights in their sets, shape (p,); zero where complementary.

        For a circular cone it is in the entry of its normal.
        """
        out = (w - self.finite_lower) * self.below * np.maximum(y, 0.0)
        out += (self.finite_upper - w) * self.above * np.maximum(-y, 0.0)
        if len(self.mu):
            out[self.cone_columns] = 0.0
            out[self.cone_at + 2] = np.abs((w[self.cone_columns] * y[self.cone_columns]).sum(axis=1))
        return out


@lru_cache(maxsize=512)  # a contact's set never changes: computed once
def at_rest(*cones: Cone) -> ForceSet:
    """The stacked sets of several constraints, all contacts at rest."""
    return _stacked(cones, [""] * len(cones), [None] * len(cones), REST_SPEED)


def _stacked(cones: Sequence[Cone], names: Sequence[str], velocities: Sequence[Array | None], rest_speed: float) -> ForceSet:
    """The stacked sets of several constraints with the velocities of their rows; None where they are at rest."""
    sources = [checked_generators(cone) for cone in cones]
    B = block_diagonal([local for local, _ in sources])
    u, inward = np.zeros(B.shape[1]), np.zeros(B.shape[1])
    judge, at = MotionJudge(rest_speed), 0
    elements: list[Element] = []
    bounds: list[tuple[float, float]] = []
    push, pull, blocks = [_NO_POINTS], [np.zeros((0, 0))], [np.zeros((0, 0))]
    for i, (cone, (local, shapes), velocity) in enumerate(zip(cones, sources, velocities, strict=True)):
        points, start, own = cone.at_points, at, slice(at, at + local.shape[1])
        if velocity is not None:
            u[own], inward[own] = local.T @ velocity, cone.inward(velocity)
            if points is not None and 3 * len(shapes) > len(points) and all(shape == HALF_LINE for shape in shapes):
                u[own] = _speeds_of_rays(names[i], cone, points, u[own], rest_speed)
        for number, shape in enumerate(shapes):
            source, first = slice(at, at + shape.dim), len(bounds)
            given, felt, lower, upper = judge.judge((names[i], number, len(shapes)), shape, u[source], first)
            told = None if points is None else points[:, at - start : source.stop - start]
            elements.append(Element(i, number, shape, slice(first, first + len(given)), source, 0, told))
            bounds += [(lower, upper)] * len(given)
            push.append(given)
            blocks.append(given[:, 3 - shape.dim :].T)
            pull.append(felt[:, 3 - shape.dim :].T)
            at = source.stop
    E = block_diagonal(pull)  # for accelerations; where points slide, forces have another one
    H = locked(B @ E)
    lower_all, upper_all = np.array(bounds).reshape(-1, 2).T
    return ForceSet(
        locked(B @ block_diagonal(blocks)) if judge.sliding else H,
        H,
        locked(inward @ E),
        locked(lower_all.copy()),
        locked(upper_all.copy()),
        locked(np.vstack(push)),
        tuple(elements),
        column_slices(elements, len(cones)),
        tuple(judge.sliding),
        tuple(judge.openings),
        judge.impact,
    )


def _speeds_of_rays(name: str, cone: Cone, points: Array, u: Array, rest_speed: float) -> Array:
    """Velocities along half-lines, of points whose forces are those of rays alone: the normal speed of each point.

    Args:
        name: Of the rows.
        cone: Their set.
        points: Its forces at points, shape (3k, p).
        u: Velocities along its generators, shape (p,).
        rest_speed: Up to this speed a point is at rest [m/s].

    Raises:
        InputError: a point slides: rays do not say which force opposes its motion.
    """
    out = u.copy()
    for forces in points.reshape(-1, 3, len(u)):
        acts = forces.any(axis=0)
        velocity = np.linalg.lstsq(forces[:, acts].T, u[acts], rcond=None)[0]
        speed = float(np.hypot(*velocity[:2]))
        if speed > rest_speed >= abs(velocity[2]):
            raise InputError(
                f"{name!r:.80} slides at {speed:.3g} m/s, and its set of forces, {type(cone).__name__}, is made of half-lines "
                "alone: these do not say which of its forces opposes the motion. Expected a SecondOrderCone among its parts, "
                "as rbd.problem.FrictionCone and EllipticCone have."
            )
        out[acts] = velocity[2]
    return out


def _facing(w: Array) -> Array:
    """Rotation about the normal, from the first tangent to the direction of w = (tangent, tangent, normal), shape (3, 3)."""
    size = math.hypot(w[0], w[1])
    x, y = (w[0] / size, w[1] / size) if size else (1.0, 0.0)
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


_rays, _ONE, _NO_POINTS = lru_cache(maxsize=64)(pyramid), np.ones((1, 1)), np.zeros((0, 3))


def column_slices(elements: Sequence[Element], count: int) -> tuple[slice, ...]:
    """The columns of each of so many constraints."""
    widths = [0] * count
    for e in elements:
        widths[e.rows] += e.size
    return tuple([slice(i, j) for i, j in pairwise(accumulate(widths, initial=0))])
