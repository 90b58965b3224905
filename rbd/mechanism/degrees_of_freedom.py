"""Mobility, three ways: Gruebler's count, the velocities that J allows, and those that extend to a finite motion.

The configurations that satisfy the constraints form a set V. At a regular point its dimension is n - rank J. Where the rank
of J drops there are velocities that J allows and no motion follows (a stretched string of bars), and velocities that begin
different motions (a flat parallelogram). So: small steps in all directions that J allows, each projected back onto the
constraints; from the points found, smaller steps, projected again. The number of independent directions among these is the
dimension of V there. A direction that extends to no motion is projected back to its start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from rbd.arrays import Array, check_positive, check_seed, max_abs
from rbd.constraints.constraint import Constraint, loop_dof
from rbd.constraints.manifold import CLOSED, RANK, ConstraintManifold, LinearisedRows, RowName, null_space
from rbd.displayed import Displayed
from rbd.model.state import State
from rbd.records import Field, counted

_PARALLEL = 1e-9


@dataclass(frozen=True)
class Count(Displayed):
    """Mobility by Gruebler's count: M = k (N - 1 - j) + sum of f - others.

    It uses no lengths and no directions, except whether all motion is in parallel planes.

    Attributes:
        value: M.
        planar: Whether all motion is parallel to one plane; then k = 3, else k = 6.
        bodies: N, the ground among them; links connected by fixed joints count as one.
        joints: j, those of the file and the loop closures.
        joint_dof: f, one entry a joint.
        others: Rows of constraints that are not joints (couplings, functions, contacts, velocities); of a planar mechanism,
            only those that restrict motion within it.
    """

    value: int
    planar: bool
    bodies: int
    joints: int
    joint_dof: tuple[int, ...]
    others: int

    @property
    def formula(self) -> str:
        """The count with its numbers, e.g. "planar: 3 (4 - 1 - 4) + 4 = 1"."""
        k, kind = (3, "planar") if self.planar else (6, "spatial")
        others = f" - {self.others}" if self.others else ""
        return f"{kind}: {k} ({self.bodies} - 1 - {self.joints}) + {sum(self.joint_dof)}{others} = {self.value}"


@dataclass(frozen=True)
class RedundantRow:
    """A row that follows from others at this configuration.

    Attributes:
        row: (constraint, its row).
        follows_from: The rows that it is a combination of; empty where it is zero.
    """

    row: RowName
    follows_from: tuple[RowName, ...]

    def __str__(self) -> str:
        name = f"{self.row[0]}[{self.row[1]}]"
        if not self.follows_from:
            return f"{name} is zero here"
        return f"{name} follows from " + ", ".join(f"{n}[{i}]" for n, i in self.follows_from)


@dataclass(frozen=True, eq=False, repr=False)
class Mobility(Displayed):
    """How many degrees of freedom a mechanism has at a configuration: counted, instantaneous, and of finite motions.

    Attributes:
        count: Gruebler's and Kutzbach's count.
        velocities: n.
        rows: m, of the constraints.
        rank: Of J.
        singular_values: Of J, dimensionless (see `rbd.constraints.manifold`), shape (min(m, n),).
        zero: The fraction of the largest below which they count as zero.
        finite: Degrees of freedom of the motions that pass through here; the largest number, where branches differ.
        branches: The dimension of each branch of motion that was found; above one, equal ones are not distinguished.
        motion: The finite motions found, point by point.
        redundant: Rows that follow from others here.
        self_stresses: Row forces with J^T f = 0, shape (m, m - rank), each with 1 as its largest entry: forces that the
            constraints can exert on each other without motion.
        velocity_only: Whether some rows constrain only velocity; `finite` then refers to velocities, and
            `rbd.mechanism.integrability` gives the dimension of the reachable configurations.
        seed: Of the directions that were tried.
        driven: Constraints that follow a motion of time. J is that of a lock: each of their rows takes a degree of freedom,
            whatever the motion is.
        t: The time at which these were looked at [s].

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> found = rbd.mechanism.mobility(robot.at("assembled"))
        >>> found.count.planar, found.instantaneous, found.finite, found.over_constrained
        (True, 1, 1, False)
        >>> print(found.verdict)
        it moves with 1 degree of freedom: every velocity that J allows extends to a finite motion
    """

    count: Count
    velocities: int
    rows: int
    rank: int
    singular_values: Array
    zero: float
    motion: FiniteMotion
    redundant: tuple[RedundantRow, ...]
    self_stresses: Array
    velocity_only: bool
    seed: int
    driven: tuple[str, ...] = ()
    t: float = 0.0

    fields: ClassVar[tuple[Field, ...]] = (
        Field("counted", (), "1", "degrees of freedom that Gruebler and Kutzbach count", lambda found: found.count.value),
        Field("instantaneous", (), "1", "degrees of freedom of the velocities that J allows"),
        Field("finite", (), "1", "degrees of freedom of finite motions"),
        Field("rank", (), "1", "rank of J"),
        Field("singular", (), "", "whether the rank of J is lower here than nearby"),
        Field("driven", (), "", "names of constraints that follow a motion of time", lambda found: ", ".join(found.driven)),
        Field("verdict", (), "", "the conclusion, in words", default=False),
    )

    @property
    def instantaneous(self) -> int:
        """Dimension n - rank J of the velocities that J allows."""
        return self.velocities - self.rank

    @property
    def finite(self) -> int:
        """See the class."""
        return self.motion.dimension

    @property
    def branches(self) -> tuple[int, ...]:
        """See the class."""
        return tuple(b.dimension for b in self.motion.branches)

    @property
    def moves(self) -> bool:
        """Whether it has a finite motion."""
        return self.finite > 0

    @property
    def over_constrained(self) -> bool:
        """Whether it is over-constrained: its mobility exceeds Gruebler's count."""
        return self.finite > self.count.value

    @property
    def generic_rank(self) -> int:
        """Largest rank of J that was found on a branch, or here."""
        return max([self.rank, *(b.rank for b in self.motion.branches)])

    @property
    def singular(self) -> bool:
        """Whether the rank of J is lower here than nearby on the motion."""
        return self.rank < self.generic_rank

    @property
    def verdict(self) -> str:
        """Message: the conclusion from the three numbers."""
        if self.velocity_only:
            return f"{self.finite} degrees of freedom of velocity; some rows constrain velocity alone (see integrability)"
        if not self.instantaneous:
            if self.driven:
                return f"it moves as {self._drives} it, and in no other way"
            return "a structure: J allows no velocity"
        if not self.moves:
            return f"an infinitesimally mobile structure: {_dof(self.instantaneous)} of velocity, none of finite motion"
        if self.motion.regular:
            return f"it moves with {_dof(self.finite)}: every velocity that J allows extends to a finite motion"
        if self.singular:
            ways = counted(len(self.branches), "branch was found, of", "branches were found, of")
            dof = "degree of freedom" if self.branches == (1,) else "degrees of freedom"
            return f"a singular configuration: {ways} {', '.join(map(str, self.branches))} {dof}"
        return f"it moves with {_dof(self.finite)}; other velocities that J allows extend to no finite motion"

    @property
    def _drives(self) -> str:
        return f"{', '.join(map(repr, self.driven))} drive{'s' * (len(self.driven) == 1)}"

    def __str__(self) -> str:
        s, looked = self.singular_values, self.motion
        how = f"{looked.tried} directions tried {FAR:g} far, {len(looked.points) - 1} extended; seed {self.seed}"
        if not looked.tried:
            how = "J has full rank here" if self.rank == self.rows else "J allows nothing"
        lines = [self.verdict[0].upper() + self.verdict[1:] + "."]
        if self.over_constrained:
            lines.append(f"It is over-constrained: it moves although the count gives {self.count.value}.")
        if self.driven:
            lines.append(f"{self._drives} it: taken at t = {self.t:g} s, where these rows count as locks.")
        lines += [
            f"counted        {self.count.value:>3}   {self.count.formula}",
            f"instantaneous  {self.instantaneous:>3}   n - rank J = {self.velocities} - {self.rank}, of {self.rows} rows; "
            f"zero is {self.zero:.2g} of the largest singular value",
            f"finite         {self.finite:>3}   {how}; numerical, not a proof",
        ]
        if len(s):
            lines.append("singular values " + np.array2string(s, precision=3, max_line_width=110, threshold=12))
        if self.redundant:
            lines.append(f"{counted(len(self.redundant), 'redundant row', 'redundant rows')}, as many states of self-stress:")
            lines += [f"  {row}" for row in self.redundant[:8]]
            if len(self.redundant) > 8:
                lines.append(f"  and {len(self.redundant) - 8} more")
        return "\n".join(lines)


def mobility(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    tolerance: float = CLOSED,
    seed: int = 0,
    loops: bool = True,
) -> Mobility:
    """How many degrees of freedom a robot has under bilateral constraints: counted, instantaneous, and of finite motions.

    The three numbers::

        counted         k (N - 1 - j) + sum of f        Gruebler, Kutzbach: bodies and joints, k = 3 or 6
        instantaneous   n - rank J(q)
        finite          dimension of the configurations that satisfy the constraints, near q

    The second is at least the third. They differ where a velocity extends to no motion, and at singular configurations, where
    velocities begin different motions. The first ignores geometry: it is too small for over-constrained loops.

    Finite motion is searched with steps of 0.1 (radians, or parts of the robot's length) in directions of the kernel of J,
    projected onto the constraints by Newton's method, and 0.02 from points found. Where J has full rank the implicit function
    theorem is sufficient. It is numerical, not a proof: shorter motions are not detected, nor those that leave so
    slowly that steps of this length break the constraints by less than the tolerance. Joint limits are ignored.

    What follows a motion of time (`rbd.DrivenJoint`, a velocity constraint with b(t), moving ground) is taken at the time of
    the state: its rows take as many degrees of freedom as those of a lock.

    Args:
        state: A robot at a configuration that satisfies the constraints; its velocity is not used.
        constraints: Bilateral constraints; None for the loops and wheels of its file.
        tolerance: Largest constraint violation [m, rad, over the rows' lengths]: for files whose
            lengths are rounded. Singular values of J below ten times that, over the largest, count as zero.
        seed: Of the directions.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: the state is off the constraints, or one of them can break or slip.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 1.0, 1.0, 1.0, crank_angle=1.0)
        >>> flat = rbd.mechanism.assemble(robot.at("assembled"), fixed={"crank_joint": 0.0}).q  # the square lies flat
        >>> for q in (robot.posture("assembled"), flat):
        ...     found = rbd.mechanism.mobility(robot.at(q))
        ...     print(found.instantaneous, found.finite, found.singular)
        1 1 False
        2 1 True
    """
    tolerance, seed = check_positive("tolerance", tolerance, 1e-2), check_seed(seed)
    held = ConstraintManifold(state, constraints, tolerance=tolerance, loops=loops, driven=True)
    at = held.check_assembled()
    N, s = null_space(at.A, held.zero)
    rank = held.n - N.shape[1]
    redundant, stresses = _redundant(held, at.A, rank)
    found = finite_motion(held, at, seed)
    return Mobility(
        count(held, state, seed), held.n, held.m, rank, s, held.zero, found, redundant, stresses, not held.placed.all(), seed,
        held.driven, state.t,
    )  # fmt: skip


def _redundant(held: ConstraintManifold, J: Array, rank: int) -> tuple[tuple[RedundantRow, ...], Array]:
    """Rows that follow from others, by pivoted QR of J^T, and the self-stresses."""
    if rank == held.m:
        return (), np.zeros((held.m, 0))
    R, pivots = qr(J.T, mode="r", pivoting=True)
    shares = np.linalg.lstsq(R[:rank, :rank], R[:rank, rank:], rcond=None)[0]
    used = {i: np.sort(pivots[:rank][np.abs(share) > 1e-7]) for i, share in zip(pivots[rank:], shares.T, strict=True)}
    stresses = held.weights[:, None] * np.linalg.svd(J)[0][:, rank:]
    stresses /= np.abs(stresses).max(axis=0)
    return tuple(RedundantRow(held.names[i], tuple(held.names[k] for k in used[i])) for i in sorted(used)), stresses


def _dof(k: int) -> str:
    return counted(k, "degree of freedom", "degrees of freedom")


def count(held: ConstraintManifold, state: State, seed: int) -> Count:
    """Gruebler's count of a robot's joints and the constraints on it.

    Args:
        held: The constraints.
        state: Configuration at which axes are compared; parallel motion remains parallel.
        seed: Of the configurations at which rows of other constraints are compared.
    """
    model = held.robot.model
    normal = plane_normal(state)
    k = 6 if normal is None else 3
    tree = [model.nvs[j] for j in range(1, model.njoints) if model.nvs[j]]
    closures, others = [], 0
    for constraint in held.constraints:
        dof = loop_dof(constraint, state, normal)
        if dof is not None:
            closures.append(dof)
        else:
            rows = [i for i, (name, _) in enumerate(held.names) if name == constraint.name]
            others += len(rows) if normal is None else _generic_rank(held, rows, seed)
    each = (*tree, *closures)
    bodies, joints = len(tree) + 1, len(each)
    return Count(k * (bodies - 1 - joints) + sum(each) - others, normal is not None, bodies, joints, each, others)


def plane_normal(state: State) -> Array | None:
    """Unit normal, in W, of the plane to which every joint's motion is parallel; None if there is none.

    Axes parallel to n stay so if all rotation is about n.
    """
    model = state.robot.model
    # Twists at the origin of W: linear, angular.
    columns = pin.computeJointJacobians(model, model.createData(), state.q).reshape(6, -1).T
    turns = [c[3:] / np.linalg.norm(c[3:]) for c in columns if np.linalg.norm(c[3:]) > _PARALLEL]
    if turns:
        n = turns[0]
    else:
        _, s, Vt = np.linalg.svd(np.vstack([columns[:, :3], np.zeros((3, 3))]))
        if s[2] > _PARALLEL:
            return None
        n = Vt[2]
    if any(np.linalg.norm(np.cross(n, w)) > _PARALLEL for w in turns):
        return None
    if any(abs(float(c[:3] @ n)) > _PARALLEL * max(1.0, float(np.linalg.norm(c[:3]))) for c in columns):
        return None
    return n


def _generic_rank(held: ConstraintManifold, rows: list[int], seed: int) -> int:
    rng = np.random.default_rng(seed)
    return max(held.rank(held.at(held.move(held.q, rng.normal(size=held.n))).A[rows], RANK) for _ in range(3))


FAR, NEAR = 0.1, 0.02
"""Lengths of the first and of the second steps, without units (radians, or parts of the robot's length)."""

_MOVED = 0.1
"""A step has succeeded if this fraction of it remains after projection."""

_APART = 0.5
"""Sine of the angle above which two tangent spaces at distance `FAR` belong to two branches."""

_DIRECTIONS, _POINTS = 120, 24
"""Number of directions tried from a singular configuration, and of points examined in full."""

_KNOWN = 0.98
"""Cosine of the angle between a chord and the tangent of a curve found before from which it leads along that curve."""

ROUGH = 1e-5
"""Singular values count as zero at this fraction of the largest, at points found by Newton: where errors grow with the square
of the distance, an error of 1e-14 leaves the point 1e-7 away."""


@dataclass(frozen=True, eq=False)
class LocalBranch:
    """One branch of motion through a configuration.

    Attributes:
        dimension: Their degrees of freedom.
        point: A configuration on it nearby, shape (nq,).
        tangent: Velocities of the constraints there, without units, orthonormal, shape (nv, dimension).
        rank: Rank of J there.
    """

    dimension: int
    point: Array
    tangent: Array
    rank: int


@dataclass(frozen=True, eq=False)
class FiniteMotion:
    """The branches of motion found near a configuration.

    Attributes:
        dimension: The largest dimension of a branch; zero if nothing moves.
        branches: The branches found, largest first. Curves are distinguished by their tangents nearby, so
            that the two arms of a cusp are two and tangent curves are one; with more than one degree of freedom those of equal
            dimension are not distinguished.
        points: Configurations that were found and examined, this one first, shape (k, nq).
        tried: Number of directions tried from here.
        regular: Whether every velocity that J allows extends to a finite motion, so that there is one branch.
    """

    dimension: int
    branches: tuple[LocalBranch, ...]
    points: Array
    tried: int
    regular: bool


def finite_motion(held: ConstraintManifold, at: LinearisedRows, seed: int) -> FiniteMotion:
    """The branches of motion that pass through an assembled configuration.

    Args:
        held: The constraints.
        at: The constraints at the configuration.
        seed: Of the directions.
    """
    rng = np.random.default_rng(seed)
    placed, loose = held.placed, ~held.placed
    N, _ = null_space(at.A, held.zero)
    rank = held.n - N.shape[1]
    here = LocalBranch(N.shape[1], at.q, N, rank)
    if rank == held.m or N.shape[1] == 0:  # by the implicit function theorem, or without rows
        return FiniteMotion(here.dimension, (here,) if here.dimension else (), at.q[None], 0, True)
    branches: list[LocalBranch] = []
    points: list[LinearisedRows] = []
    tried = analysed = 0
    for near in _around(held, at, rng):
        tried += 1
        if near is None:
            continue
        points.append(near)
        chord = held.way(at.q, near.q)
        if any(b.dimension == 1 and abs(float(b.tangent[:, 0] @ chord)) > _KNOWN * np.linalg.norm(chord) for b in branches):
            continue
        analysed += 1
        point, tangent = _regular(held, near, rng) if placed.any() else (near, np.eye(held.n))
        if loose.any():
            tangent = tangent @ null_space(point.A[loose] @ tangent, held.zero)[0]
        found = LocalBranch(tangent.shape[1], point.q, tangent, _rank(held, point.A))
        if found.dimension and not any(_same(found, other) for other in branches):
            branches.append(found)
        if analysed == _POINTS or found.dimension == here.dimension:
            break
    branches.sort(key=lambda b: -b.dimension)
    looked = np.array([at.q, *[p.q for p in points]])
    dimension = branches[0].dimension if branches else 0
    if dimension == here.dimension:
        # V is in the smooth set of its independent rows, and fills it. Tangents that differ nearby belong to a
        # sharp bend, or to a branch that only passes near.
        return FiniteMotion(dimension, (here,), looked, tried, True)
    return FiniteMotion(dimension, tuple(branches), looked, tried, False)


def _around(held: ConstraintManifold, at: LinearisedRows, rng: np.random.Generator) -> Iterator[LinearisedRows | None]:
    """Points to examine, at distance `FAR`; without position rows any configuration."""
    if held.placed.any():
        return neighbours(held, at, FAR, rng, _DIRECTIONS)
    return iter([held.at(held.move(at.q, FAR * random_unit(rng, np.eye(held.n)))) for _ in range(3)])


def random_unit(rng: np.random.Generator, basis: Array) -> Array:
    """A vector of length one in a random direction of a space, by its orthonormal basis."""
    z = basis @ rng.normal(size=basis.shape[1])
    return z / np.linalg.norm(z)


def neighbours(
    held: ConstraintManifold, at: LinearisedRows, step: float, rng: np.random.Generator, directions: int
) -> Iterator[LinearisedRows | None]:
    """For each direction of the kernel tried, the point found about one step away, or None."""
    K, _ = null_space(at.J, held.zero)
    for _ in range(min(K.shape[1], 1) if K.shape[1] < 2 else (directions + 1) // 2):
        # At random: on the axes of a symmetric linkage the points are singular.
        z = random_unit(rng, K)
        for start in (step * z, -step * z):
            found = held.project(held.move(at.q, start))
            moved = float(np.linalg.norm(held.way(at.q, found.q)))
            yield found if max_abs(found.error) <= held.tolerance and _MOVED * step <= moved <= 3.0 * step else None


def _regular(held: ConstraintManifold, at: LinearisedRows, rng: np.random.Generator) -> tuple[LinearisedRows, Array]:
    """(point, tangent space): this point, or a neighbouring one if the rank is higher there."""
    step = NEAR
    for _ in range(2):
        tangent, around = _tangent(held, at, step, rng)
        best = max(around, key=lambda p: _rank(held, p.A), default=at)
        if _rank(held, best.A) <= _rank(held, at.A):
            break
        at, step = best, 0.25 * step
    return at, tangent


def _rank(held: ConstraintManifold, J: Array) -> int:
    return held.rank(J, max(held.zero, ROUGH))


def _tangent(
    held: ConstraintManifold, at: LinearisedRows, step: float, rng: np.random.Generator
) -> tuple[Array, list[LinearisedRows]]:
    """Orthonormal basis of the directions to the constraints' points around one of them, and these points."""
    K, _ = null_space(at.J, held.zero)
    d = K.shape[1]
    around: list[LinearisedRows] = []
    if d == 0:
        return K, around
    chords = np.zeros((2 * d + 1, held.n))
    for i in range(len(chords)):
        z = K[:, i] if i < d else random_unit(rng, K)
        found = held.project(held.move(at.q, step * z))
        if max_abs(found.error) <= held.tolerance:
            chords[i] = held.way(at.q, found.q) / step
            around.append(found)
    _, s, Vt = np.linalg.svd(chords @ K)
    return K @ Vt[: int((s > _MOVED * np.sqrt(len(chords))).sum())].T, around


def _same(one: LocalBranch, other: LocalBranch) -> bool:
    """Whether two branches count as the same: of equal dimension, above one, or with nearly the same tangent."""
    if one.dimension != other.dimension:
        return False
    if one.dimension > 1:  # on a cone tangent planes differ from place to place
        return True
    return float(np.linalg.norm(one.tangent - other.tangent @ (other.tangent.T @ one.tangent), 2)) < _APART
