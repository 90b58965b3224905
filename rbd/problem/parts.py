"""The force sets of a problem as a product of elementary cones, with what velocities already decide.

Forces are f = G w with weights w in a product of simple parts; each weight answers to one entry of y = H^T c + offset, the
acceleration of its point. G and H are the same for contacts at rest. A contact that moves has lost its choice:

    opening     (u_n > 0)              carries nothing: its weight is 0, whatever y
    sliding     (u_n = 0, u_t != 0)    f = N (-mu u_t / |u_t|, 1), N >= 0, y = c_n: a coupled row, G != H
    approaching (u_n < 0)              an impact: no acceleration answers it
    rubbing     (an interval, u != 0)  the weight stands at the bound against the motion

with u = G^T velocity. At rest, w and y obey the law: y in K* (convex), or y + mu |y_t| n in K* (coulomb), complementary to w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.cones import Cone, HalfLine, Interval, Line, LineCone, Part, Product, SecondOrderCone, WrenchCone
from rbd.problem.openings import Opening
from rbd.problem.programs import between
from rbd.problem.rays import column_reach
from rbd.problem.rows import Rows

REST_SPEED = 1e-6
"""A contact that can break or slip is at rest up to this speed [m/s, rad/s], unless its problem says otherwise."""


@dataclass(frozen=True)
class Sliding:
    """A point that slides: its force is N (-mu t, 1).

    Attributes:
        rows: Name of its rows.
        corner: Number of the point among the cones of its rows.
        column: Its column of G and H.
        mu: Friction coefficient.
        direction: Unit vector t of its tangential velocity, in contact axes.
        speed: [m/s].
    """

    rows: str
    corner: int
    column: int
    mu: float
    direction: tuple[float, float]
    speed: float


@dataclass(frozen=True, eq=False)
class Parts:
    """Stacked sets in generator form, p columns in all.

    Attributes:
        G: Forces of unit weights, shape (m, p).
        H: What measures the accelerations, y = H^T c + offset, shape (m, p); G itself where nothing slides.
        offset: Centripetal part of y, shape (p,): corners of a turning patch; zero else.
        lower: Bounds of the weights, shape (p,): -inf for lines and for the columns of second-order cones.
        upper: Likewise.
        cone_at: First columns of the second-order cones (tangent, tangent, normal), shape (k,).
        mu: Their friction coefficients, shape (k,).
        slices: The columns of each constraint, in the order of the rows.
        point: Number of each column's point among the points of its rows, shape (p,).
        push: Force of a unit weight on its point, in contact axes (tangent, tangent, normal), shape (p, 3).
        sliding: Points whose friction follows their motion.
        openings: Points that move away: their forces are zero.
        impact: Why no acceleration can answer, in words; empty where nothing approaches.
    """

    G: Array
    H: Array
    offset: Array
    lower: Array
    upper: Array
    cone_at: Array
    mu: Array
    slices: tuple[slice, ...]
    point: Array
    push: Array
    sliding: tuple[Sliding, ...] = ()
    openings: tuple[Opening, ...] = ()
    impact: str = ""

    @property
    def opening(self) -> tuple[str, ...]:
        """Names of the rows with points that move away."""
        return tuple(dict.fromkeys(point.rows for point in self.openings))

    @property
    def size(self) -> int:
        """Number of columns p."""
        return self.G.shape[1]

    @lazy
    def reach(self) -> tuple[float, float]:
        """(smallest sum of absolute entries of a column of H, 1 at most; largest of one of G, at least 1)."""
        return column_reach(self.H, self.G)

    @lazy
    def bound_size(self) -> Array:
        """Sum of the finite bounds' absolute values, shape (p,)."""
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        return np.where(low, np.abs(self.lower), 0.0) + np.where(high, np.abs(self.upper), 0.0)

    @lazy
    def only_cones(self) -> bool:
        """Whether every column is one of a second-order cone."""
        return 3 * len(self.mu) == self.size

    @lazy
    def cone_columns(self) -> Array:
        """Columns of the second-order cones, shape (k, 3)."""
        return self.cone_at[:, None] + np.arange(3)

    def accelerations(self, c: Array, *, coulomb: bool) -> Array:
        """What the weights answer to, shape (p,): H^T c + offset; with mu |y_t| added along normals if `coulomb`."""
        y = self.H.T @ c + self.offset
        if coulomb and len(self.mu):
            y[self.cone_at + 2] += self.mu * np.hypot(y[self.cone_at], y[self.cone_at + 1])
        return y

    def project(self, w: Array) -> Array:
        """The nearest weights in the product of the parts."""
        out = np.minimum(np.maximum(w, self.lower), self.upper)
        if len(self.mu):
            out[self.cone_columns] = project_cones(w[self.cone_columns], self.mu)
        return out

    def at_points(self, w: Array, columns: slice) -> Array:
        """Forces, of weights, or accelerations, of y, at the points of one contact that pushes, shape (k, 3), in its axes.

        Args:
            w: Weights or accelerations, shape (p,).
            columns: The contact's columns, of `slices`.
        """
        at = self.point[columns]
        out = np.zeros((int(at.max(initial=-1)) + 1, 3))
        np.add.at(out, at, w[columns, None] * self.push[columns])
        return out

    def weights_of(self, f: Array) -> Array:
        """Weights within the parts that make the row forces f as nearly as can be, shape (p,); by projected gradients.

        Where second-order cones share rows (corners of a patch) it is slow and near, not exact.
        """
        if not len(self.mu):
            return bounded_weights(self.G, f, self.lower, self.upper)
        step = 1.0 / max(float(np.linalg.norm(self.G, 2)) ** 2, 1e-300)
        w = ahead = self.project(np.linalg.lstsq(self.G, f, rcond=None)[0])
        for i in range(2000):
            new = self.project(ahead - step * (self.G.T @ (self.G @ ahead - f)))
            if np.abs(new - w).max() <= 1e-15 * max(1.0, np.abs(w).max()):
                break
            w, ahead = new, new + i / (i + 3.0) * (new - w)
        return w

    def gap(self, y: Array) -> Array:
        """How far each acceleration is from where its part allows, whatever the weight, shape (p,).

        A line must keep still, a half-line may open; a second-order cone's distance to its dual stands at its normal.
        """
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        out = np.where(below, 0.0, np.maximum(y, 0.0)) + np.where(above, 0.0, np.maximum(-y, 0.0))
        if len(self.mu):
            Y = y[self.cone_columns]
            # K* is the cone about the normal with slope 1/mu: |y_t| <= y_n / mu.
            dual = _project(Y, np.ones(1), self.mu)
            out[self.cone_columns] = 0.0
            out[self.cone_at + 2] = np.linalg.norm(Y - dual, axis=1)
        return out

    def slack(self, w: Array, y: Array) -> Array:
        """|weight x acceleration| of each part, for weights in their sets, shape (p,); zero where complementary.

        Of a second-order cone it stands at its normal.
        """
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        from_low = np.where(low, w - np.where(low, self.lower, 0.0), 0.0)
        to_high = np.where(high, np.where(high, self.upper, 0.0) - w, 0.0)
        out = from_low * np.maximum(y, 0.0) + to_high * np.maximum(-y, 0.0)
        if len(self.mu):
            out[self.cone_columns] = 0.0
            out[self.cone_at + 2] = np.abs((w[self.cone_columns] * y[self.cone_columns]).sum(axis=1))
        return out


def bounded_weights(G: Array, f: Array, lower: Array, upper: Array) -> Array:
    """Weights within their bounds, equal ones among them, that make the force f as nearly as can be, shape (p,)."""
    w, free = lower.copy(), lower < upper
    if free.any():
        w[free] = between(G[:, free], f - G[:, ~free] @ lower[~free], lower[free], upper[free])
    return w


def project_cones(W: Array, mu: Array) -> Array:
    """The nearest points of the cones |w_t| <= mu w_n to the rows of W, shape (k, 3)."""
    return _project(W, mu, np.ones(1))


def _project(W: Array, s: Array, r: Array) -> Array:
    """Nearest points of the cones r |w_t| <= s w_n."""
    t, n = np.hypot(W[:, 0], W[:, 1]), W[:, 2]
    inside = r * t <= s * n
    if inside.all():
        return W
    polar = s * t <= -r * n
    size: Array = s * s + r * r
    along = (s * t + r * n) / size  # length along the edge (s, r)
    scale = np.where(t > 0.0, s * along / np.where(t > 0.0, t, 1.0), 0.0)
    edge = np.column_stack([scale * W[:, 0], scale * W[:, 1], r * along])
    return np.where(inside[:, None], W, np.where(polar[:, None], 0.0, edge))


def parts_of(rows: Sequence[Rows], rest_speed: float = REST_SPEED) -> Parts:
    """The parts of stacked rows, their velocities regarded.

    Args:
        rows: The rows.
        rest_speed: What moves no faster is at rest [m/s, rad/s].
    """
    at_rest = _at_rest(tuple([r.cone for r in rows]))
    if not any([r.speed > rest_speed for r in rows]):
        return at_rest
    return _Moving(rows, at_rest, rest_speed).parts()


@lru_cache(maxsize=512)
def _at_rest(cones: tuple[Cone, ...]) -> Parts:
    """The parts of sets, all contacts at rest; kept, as a robot's contacts keep their cones."""
    builder = _Builder(sum(c.dim for c in cones))
    row = 0
    for cone in cones:
        local, parts = cone.generators()
        G = np.zeros((builder.m, local.shape[1]))
        G[row : row + cone.dim] = local
        row += cone.dim
        column = 0
        for i, part in enumerate(parts):
            block = G[:, column : column + part.dim]
            column += part.dim
            if isinstance(part, SecondOrderCone):
                builder.put_cone(i, part.mu, block)
            else:
                builder.put(i, block, block, np.zeros(1), _NORMAL, *bounds(part))
        builder.end_rows()
    return builder.parts()


_NORMAL = np.array([[0.0, 0.0, 1.0]])


class _Builder:
    """Columns collected one part at a time."""

    def __init__(self, m: int) -> None:
        self.m = m
        self.G: list[Array] = []
        self.H: list[Array] = []
        self.offset: list[float] = []
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.cone_at: list[int] = []
        self.mu: list[float] = []
        self.point: list[int] = []
        self.push: list[Array] = []
        self.slices: list[slice] = []

    def put(self, i: int, G: Array, H: Array, offset: Array, push: Array, lower: float, upper: float) -> None:
        """Columns of one part, the i-th point of its rows, all with the same bounds."""
        self.G += list(G.T)
        self.H += list(H.T)
        self.offset += offset.tolist()
        self.point += [i] * len(offset)
        self.push += list(push)
        self.lower += [lower] * len(offset)
        self.upper += [upper] * len(offset)

    def put_cone(self, i: int, mu: float, G: Array, offset: Array = np.zeros(3)) -> None:  # noqa: B008
        """Three columns of a second-order cone; one half-line where there is no friction."""
        if mu == 0.0:
            return self.put(i, G[:, 2:], G[:, 2:], offset[2:], _NORMAL, 0.0, np.inf)
        self.cone_at.append(len(self.lower))
        self.mu.append(mu)
        self.put(i, G, G, offset, np.eye(3), -np.inf, np.inf)

    def end_rows(self) -> None:
        """What was put since the last call belongs to one constraint."""
        self.slices.append(slice(self.slices[-1].stop if self.slices else 0, len(self.lower)))

    def parts(self, sliding: Sequence[Sliding] = (), openings: Sequence[Opening] = (), impact: str = "") -> Parts:
        """All of them."""
        p = len(self.lower)
        G = np.array(self.G).reshape(p, self.m).T
        H = np.array(self.H).reshape(p, self.m).T if sliding else G
        offset, lower, upper = np.array(self.offset), np.array(self.lower), np.array(self.upper)
        cone_at, mu = np.array(self.cone_at, int), np.array(self.mu)
        point, push = np.array(self.point, int), np.array(self.push).reshape(p, 3)
        for array in (G, H, offset, lower, upper, cone_at, mu, point, push):
            array.flags.writeable = False  # kept for the next problem
        return Parts(
            G, H, offset, lower, upper, cone_at, mu, tuple(self.slices), point, push, tuple(sliding), tuple(openings), impact
        )


def bounds(part: Part) -> tuple[float, float]:
    """Bounds of a part's weights; none of a line's, nor of a second-order cone's, which are bounded together."""
    if isinstance(part, HalfLine):
        return 0.0, np.inf
    if isinstance(part, Interval):
        return part.lo, part.hi
    return -np.inf, np.inf


class _Moving:
    """Parts where some rows have a velocity."""

    def __init__(self, rows: Sequence[Rows], at_rest: Parts, rest_speed: float) -> None:
        self.build, self.rest_speed = _Builder(at_rest.G.shape[0]), rest_speed
        self.sliding: list[Sliding] = []
        self.openings: list[Opening] = []
        self.impact = ""
        row = 0
        for r in rows:
            self._add_rows(r, row)
            row += len(r)
            self.build.end_rows()

    def parts(self) -> Parts:
        """All of them."""
        return self.build.parts(self.sliding, self.openings, self.impact)

    def _add_rows(self, r: Rows, row: int) -> None:
        local, parts = r.cone.generators()
        G = np.zeros((self.build.m, local.shape[1]))
        G[row : row + len(r)] = local
        # What is at rest is at rest whatever else moves: the same rows have the same parts in every company.
        u = r.velocity if r.speed > self.rest_speed else np.zeros(len(r))
        velocity, inward = local.T @ u, centripetal(r.cone, u)
        at = 0
        for i, part in enumerate(parts):
            span = slice(at, at + part.dim)
            at += part.dim
            self._add(r.name, (i, len(parts)), part, G[:, span], velocity[span], inward[span])

    def _add(self, name: str, point: tuple[int, int], part: Part, G: Array, u: Array, offset: Array) -> None:
        i, _ = point
        if isinstance(part, Line):
            self.build.put(i, G, G, offset, _NORMAL, *bounds(part))
        elif isinstance(part, Interval):
            low, high = bounds(part)
            against = low if u[0] > 0.0 else high
            rubs = abs(u[0]) > self.rest_speed and np.isfinite(against)
            self.build.put(i, G, G, offset, _NORMAL, *((against, against) if rubs else (low, high)))
        else:
            self._add_unilateral(name, point, part, G, u, offset)

    def _add_unilateral(self, name: str, point: tuple[int, int], part: Part, G: Array, u: Array, offset: Array) -> None:
        (i, of), normal, n, rest = point, float(u[-1]), G[:, -1:], self.rest_speed
        mu = part.mu if isinstance(part, SecondOrderCone) else 0.0
        speed = float(np.hypot(u[0], u[1])) if mu else 0.0
        if normal < -rest and not self.impact:
            self.impact = f"{name!r} approaches at {-normal:.3g} m/s: an impact, which no acceleration answers"
        if abs(normal) > rest:
            if normal > 0.0:
                self.openings.append(Opening(name, i, of, normal))
            self.build.put(i, n, n, offset[-1:], _NORMAL, 0.0, 0.0)
        elif not mu:
            self.build.put(i, n, n, offset[-1:], _NORMAL, 0.0, np.inf)
        elif speed > rest:
            t = u[:2] / speed
            push = np.array([[-mu * t[0], -mu * t[1], 1.0]])
            self.sliding.append(Sliding(name, i, len(self.build.lower), mu, (float(t[0]), float(t[1])), speed))
            self.build.put(i, G @ push.T, n, offset[-1:], push, 0.0, np.inf)
        else:
            self.build.put_cone(i, mu, G, offset)


def centripetal(cone: Cone, velocity: Array) -> Array:
    """G^T's missing part of the corners' accelerations, w x (w x p) for a patch that turns with w, shape (p,)."""
    if isinstance(cone, Product):
        ends = np.cumsum([c.dim for c in cone.cones])[:-1]
        return np.concatenate([centripetal(c, v) for c, v in zip(cone.cones, np.split(velocity, ends), strict=True)])
    local, parts = cone.generators()
    if not isinstance(cone, WrenchCone | LineCone):
        return np.zeros(local.shape[1])
    # Of a line turns about itself leave the points where they are, and its rows are accelerations of its direction.
    w = velocity[3:] if isinstance(cone, WrenchCone) else np.array([0.0, velocity[3], velocity[4]])
    inward = np.cross(w, np.cross(w, cone.corners))
    return (inward if parts[0].dim == 3 else inward[:, 2:]).ravel()
