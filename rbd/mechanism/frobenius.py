"""Integrability of velocity constraints, taken together: Frobenius's theorem on the velocities that they allow.

Lie brackets are those of velocity fields on a robot's configurations, whose velocities are no derivatives of coordinates. A
field X gives a velocity X(q), shape (nv,), at every configuration. With q' = v read as Pinocchio does (a floating base's v in
the base's axes), the bracket is

    [X, Y] = dY . X - dX . Y + ad(X) Y ,

ad the structure constants of these velocities: zero for joints whose v is the derivative of q, w x u and the like for bodies
that rotate. Without the last term a skate on a planar joint, whose row is the constant (0, 1, 0), would seem to be integrable.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from rbd.arrays import Array, as_array, check_positive, check_seed, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.function import FIRST, NODES
from rbd.constraints.manifold import ConstraintManifold, LinearisedRows, null_space, own_or
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.mechanism.degrees_of_freedom import random_unit
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked

Fields = Callable[[Array], Array]
"""q -> dimensionless velocities, shape (nv, k), one column a field."""

STEP = 0.01
"""Step of the differences, dimensionless."""

_DEEPEST = 5
"""Largest depth of nested brackets; each level costs (6 dim D) times the one before."""

_EVALUATIONS = 400_000


@dataclass(frozen=True, eq=False)
class PointReport:
    """Growth vector and ranks at one configuration.

    Attributes:
        q: Shape (nq,).
        rank: Of the constraints' Jacobian A.
        growth: Dimensions of D, D + [D, D], D + [D, D] + [D, [D, D]], ... until they stop growing.
        gap: (smallest singular value that counted as a new direction, None where none did; largest that did not), of brackets
            in dimensionless form.
        complete: Whether it stopped growing; False where brackets deeper than were taken might add more.
        regular: Whether the rank is the same at two configurations nearby; where it is not, D is not smooth here, and what
            brackets show concerns only the rows that are independent here.
    """

    q: Array
    rank: int
    growth: tuple[int, ...]
    gap: tuple[float | None, float]
    complete: bool
    regular: bool


@dataclass(frozen=True, eq=False, repr=False)
class Integrability(Displayed):
    """Whether velocity constraints are holonomic, with the numbers of degrees of freedom of velocity and configuration.

    Attributes:
        names: Constraints.
        velocities: n.
        reports: Point by point.
        tolerance: Singular values of brackets above it count as new directions.
        seed: Of the points, if they were drawn.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> found = rbd.mechanism.integrability(arm.at(), [rbd.VelocityConstraint("belt", [1.0, 1.0])])
        >>> found.holonomic, found.velocity_dof, found.configuration_dof
        (True, 1, 1)
    """

    names: tuple[str, ...]
    velocities: int
    reports: tuple[PointReport, ...]
    tolerance: float
    seed: int

    @property
    def points(self) -> Array:
        """Configurations that were examined, shape (k, nq)."""
        return np.array([r.q for r in self.reports])

    @property
    def growth(self) -> tuple[int, ...]:
        """Growth vector, where the constraints' rank is largest: that of most points, of the longest reach where tied."""
        most = max(r.rank for r in self.reports)
        found = Counter(r.growth for r in self.reports if r.rank == most)
        return max(found, key=lambda g: (found[g], g[-1]))

    @property
    def velocity_dof(self) -> int:
        """Dimension of D: degrees of freedom of velocity."""
        return self.growth[0]

    @property
    def configuration_dof(self) -> int:
        """Dimension of the configurations that can be reached: D with all its brackets."""
        return self.growth[-1]

    @property
    def holonomic(self) -> bool:
        """Whether brackets add no direction at any of the points: the constraints are integrable to positions."""
        return all(len(r.growth) == 1 for r in self.reports)

    @property
    def agreed(self) -> bool:
        """Whether all points gave the same rank and the same growth vector."""
        return len({(r.rank, r.growth) for r in self.reports}) == 1

    @property
    def complete(self) -> bool:
        """Whether the growth vector stopped growing at all points."""
        return all(r.complete for r in self.reports)

    def __str__(self) -> str:
        n, d, c = self.velocities, self.velocity_dof, self.configuration_dof
        moves = f"{d} {'degree of freedom' if d == 1 else 'degrees of freedom'} of velocity"
        what = ", ".join(self.names) if self.names else "no constraints"
        if self.holonomic:
            verdict = f"holonomic: {moves} and as many of configuration; {n - d} functions of q stay constant"
        elif c == n:
            verdict = f"nonholonomic: {moves}, yet {n} of configuration: all nearby can be reached"
        else:
            verdict = f"nonholonomic: {moves}, {c} of configuration; of {n - d} constraints together {n - c} can be integrated"
        lines = [f"{what}: {verdict}", f"growth vector {self.growth} of {n}"]
        low, high = max(r.gap[1] for r in self.reports), [r.gap[0] for r in self.reports if r.gap[0] is not None]
        new = f"new directions are {min(high):.2g} or more, " if high else ""
        lines.append(
            f"looked at {len(self.reports)} configurations, seed {self.seed}; of brackets {new}what counts as zero is at most "
            f"{low:.1e} (tolerance {self.tolerance:g}); numerical, not a proof"
        )
        if not all(r.regular for r in self.reports):
            lines.append("singular points among them: the rank of the constraints is higher nearby; choose others")
        if not self.complete:
            lines.append("it was still growing: deeper brackets were not taken, so more configurations may be in reach")
        if not self.agreed:
            found = Counter((r.rank, r.growth) for r in self.reports)
            each = "; ".join(f"rank {rank}, growth {growth}: {k} points" for (rank, growth), k in found.items())
            lines.append(f"the points differ: {each}")
        return "\n".join(lines)


def integrability(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    points: Array | Sequence[Array] | None = None,
    seed: int = 0,
    tolerance: float = 1e-6,
    loops: bool = True,
) -> Integrability:
    """Whether velocity constraints A(q) v = 0, taken together, are holonomic, and the dimension that they leave.

    D(q) is the kernel of A(q). By Frobenius' theorem there are n - dim D functions of q that stay constant if and only if the
    bracket of any two fields in D is in D again. Where it is not, brackets are added until the dimension stops growing: its
    last value is the number of degrees of freedom of configuration (Chow's theorem), the first that of velocity.

    Constraints are tested together: two that are nonholonomic each may be holonomic as a pair. Brackets contain the structure
    constants of v (see the module), of fields P(q) b, with P the projector onto D(q) and b constant. The
    derivatives are sixth-order differences with steps of 0.01, so smooth constraints are distinguished at 1e-6 with
    a margin; `PointReport.gap` shows it. Only rows that are independent at a point are used near it.

    Args:
        state: Of the robot; its velocity is not used.
        constraints: Bilateral constraints, of position too; None for the loops and wheels of the robot's file.
        points: Configurations to examine, shape (k, nq); where some rows have positions, near them. By default three are
            drawn within a unit of the state's in each velocity, and projected onto the rows that have positions.
        seed: Of the draws.
        tolerance: Singular values of brackets above it count as new directions.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: points that are invalid, or off the constraints; none found on the constraints.

    Example:
        >>> skate = rbd.testing.box()
        >>> blade = rbd.KnifeEdge("blade", "box")
        >>> flat = rbd.VelocityConstraint("flat", np.eye(6)[[2, 3, 4]])  # it neither rises nor tilts
        >>> found = rbd.mechanism.integrability(rbd.State(skate, [0, 0, 0, 0, 0, 0, 1]), [blade, flat])
        >>> found.holonomic, found.velocity_dof, found.configuration_dof
        (False, 2, 3)
    """
    tolerance, seed = check_positive("tolerance", tolerance, 0.1), check_seed(seed)
    robot = checked(state).robot
    held = own_or(robot, constraints, loops)
    starts = _drawn(state, held, seed) if points is None else _given(robot, held, points)
    reports = tuple(_look(held, at, tolerance) for held, at in starts)
    names = tuple(dict.fromkeys(name for held, _ in starts for name, _ in held.names))
    return Integrability(names, robot.nv, reports, tolerance, seed)


def _given(
    robot: CheckedModel, constraints: Sequence[Constraint], points: Array | Sequence[Array]
) -> list[tuple[ConstraintManifold, LinearisedRows]]:
    listed = np.atleast_2d(as_array("points", points))
    if listed.ndim != 2 or not len(listed) or listed.shape[1] != robot.nq:
        raise InputError(f"points have shape {listed.shape}; expected (k, {robot.nq}): configurations.")
    return [(held, held.check_assembled()) for held in (ConstraintManifold(State(robot, q), constraints) for q in listed)]


def _drawn(state: State, constraints: Sequence[Constraint], seed: int) -> list[tuple[ConstraintManifold, LinearisedRows]]:
    """Three configurations on the rows that have positions."""
    robot, rng, out = state.robot, np.random.default_rng(seed), []
    for _ in range(30):
        q = pin.integrate(robot.model, state.q, rng.uniform(-1.0, 1.0, size=robot.nv))
        at = ConstraintManifold(State(robot, pin.normalize(robot.model, q)), constraints)
        if at.placed.any():
            found = at.project(at.q)
            if max_abs(found.error) > 1e-10:
                continue
            at = ConstraintManifold(State(robot, found.q), constraints)
        here = at.at(at.q)
        if _regular(at, here):
            out.append((at, here))
        if len(out) == 3:
            return out
    raise InputError(
        f"no three regular configurations of {robot.name} that satisfy the constraints were found in 30 draws, seed {seed}. "
        "Give points=, e.g. from rbd.mechanism.assemble."
    )


def _look(held: ConstraintManifold, at: LinearisedRows, tolerance: float) -> PointReport:
    """The growth vector at one configuration."""
    B, _ = null_space(at.A)
    rank, n = held.n - B.shape[1], held.n
    kept = _pivots(at.A.T, rank)

    def D(q: Array) -> Array:
        """B without its components in the row space of A: smooth where A has full rank."""
        Q, _ = np.linalg.qr(held.at(q).A[kept].T)
        return B - Q @ (Q.T @ B)

    growth, span, least, most = [B.shape[1]], B, np.inf, 0.0
    newest: Fields = D
    pairs = [(i, j) for i in range(B.shape[1]) for j in range(i + 1, B.shape[1])]
    cost, complete = 1, growth[0] <= 1
    for _ in range(_DEEPEST):
        cost *= 6 * max(1, B.shape[1])
        if not pairs or growth[-1] == n:
            complete = True
            break
        if cost > _EVALUATIONS:
            break
        found = brackets(held, D, newest, pairs)(at.q)
        fresh = found - span @ (span.T @ found)
        U, s, _ = np.linalg.svd(fresh, full_matrices=False)
        added = int((s > tolerance).sum())
        least, most = min([least, *s[:added]]), max([most, *s[added:]])
        if not added:
            complete = True
            break
        span = np.hstack([span, U[:, :added]])
        growth.append(span.shape[1])
        newest = brackets(held, D, newest, [pairs[c] for c in _pivots(fresh, added)])
        pairs = [(i, j) for i in range(B.shape[1]) for j in range(added)]
    ends = float(least) if least < np.inf else None, float(most)
    return PointReport(at.q, rank, tuple(growth), ends, complete or growth[-1] == n, _regular(held, at))


def _regular(held: ConstraintManifold, at: LinearisedRows) -> bool:
    """Whether the rank is the same at two configurations nearby that satisfy the rows that have positions."""
    (B, _), rng = null_space(at.A), np.random.default_rng(0)
    near = (held.project(held.move(at.q, 0.05 * random_unit(rng, B))) for _ in range(2 if B.shape[1] else 0))
    return all(null_space(there.A)[0].shape[1] >= B.shape[1] for there in near)


def _pivots(A: Array, rank: int) -> Array:
    """Columns that span those of A, as many as its rank, ascending."""
    return np.sort(qr(A, mode="r", pivoting=True)[1][:rank])


def ad(robot: CheckedModel, X: Array, Y: Array) -> Array:
    """The bracket of velocities that are constant in body axes, shape (nv,) [velocity squared]."""
    out = np.zeros(robot.nv)
    for piece in robot.joints.pieces:
        x, y = X[piece.v : piece.v + piece.nv], Y[piece.v : piece.v + piece.nv]
        if piece.kind == "sphere":
            out[piece.v : piece.v + 3] = np.cross(x, y)
        elif piece.kind == "plane":
            out[piece.v : piece.v + 2] = -x[2] * y[1] + y[2] * x[1], x[2] * y[0] - y[2] * x[0]
        elif piece.kind == "space":
            out[piece.v : piece.v + 3] = np.cross(x[3:], y[:3]) - np.cross(y[3:], x[:3])
            out[piece.v + 3 : piece.v + 6] = np.cross(x[3:], y[3:])
    return out


def derivative(held: ConstraintManifold, fields: Fields, q: Array, z: Array) -> Array:
    """Derivatives of the components of fields along z, shape (nv, k), by sixth-order differences."""
    length = float(np.linalg.norm(z))
    if length < 1e-12:
        return np.zeros_like(fields(q))
    values = [w * fields(held.move(q, (node * STEP / length) * z)) for w, node in zip(FIRST, NODES, strict=True)]
    return np.sum(values, axis=0) * (length / STEP)


def brackets(held: ConstraintManifold, X: Fields, Y: Fields, pairs: Sequence[tuple[int, int]]) -> Fields:
    """The fields [X_i, Y_j] of the pairs (i, j)."""
    D = held.scale

    def fields(q: Array) -> Array:
        x, y = X(q), Y(q)
        rises = {i: derivative(held, Y, q, x[:, i]) for i in {i for i, _ in pairs}}
        falls = {j: derivative(held, X, q, y[:, j]) for j in {j for _, j in pairs}}
        columns = [rises[i][:, j] - falls[j][:, i] + ad(held.robot, D * x[:, i], D * y[:, j]) / D for i, j in pairs]
        return np.column_stack(columns) if columns else np.zeros((held.n, 0))

    return fields
