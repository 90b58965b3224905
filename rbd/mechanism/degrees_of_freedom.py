"""Mobility, three ways: Gruebler's count, the velocities that J allows, and the finite motions that these extend to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from rbd.arrays import Array, check_positive, check_seed
from rbd.constraints.constraint import Constraint, loop_dof
from rbd.constraints.manifold import CLOSED, RANK, ConstraintManifold, RowName, null_space
from rbd.displayed import Displayed
from rbd.mechanism.local_dimension import FAR, FiniteMotion, finite_motion
from rbd.model.state import State

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
            return "a structure: J allows no velocity"
        if not self.moves:
            return f"an infinitesimally mobile structure: {_dof(self.instantaneous)} of velocity, none of finite motion"
        if self.motion.regular:
            return f"it moves with {_dof(self.finite)}: every velocity that J allows extends to a finite motion"
        if self.singular:
            ways = _many(len(self.branches), "branch was found, of", "branches were found, of")
            dof = "degree of freedom" if self.branches == (1,) else "degrees of freedom"
            return f"a singular configuration: {ways} {', '.join(map(str, self.branches))} {dof}"
        return f"it moves with {_dof(self.finite)}; other velocities that J allows extend to no finite motion"

    def __repr__(self) -> str:
        return f"Mobility(counted {self.count.value}, instantaneous {self.instantaneous}, finite {self.finite})"

    def __str__(self) -> str:
        s, looked = self.singular_values, self.motion
        how = f"{looked.tried} directions tried {FAR:g} far, {len(looked.points) - 1} extended; seed {self.seed}"
        if not looked.tried:
            how = "J has full rank here" if self.rank == self.rows else "J allows nothing"
        lines = [self.verdict[0].upper() + self.verdict[1:] + "."]
        if self.over_constrained:
            lines.append(f"It is over-constrained: it moves although the count gives {self.count.value}.")
        lines += [
            f"counted        {self.count.value:>3}   {self.count.formula}",
            f"instantaneous  {self.instantaneous:>3}   n - rank J = {self.velocities} - {self.rank}, of {self.rows} rows; "
            f"zero is {self.zero:.2g} of the largest singular value",
            f"finite         {self.finite:>3}   {how}; numerical, not a proof",
        ]
        if len(s):
            lines.append("singular values " + np.array2string(s, precision=3, max_line_width=110, threshold=12))
        if self.redundant:
            lines.append(f"{_many(len(self.redundant), 'redundant row', 'redundant rows')}, as many states of self-stress:")
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
    held = ConstraintManifold(state, constraints, tolerance=tolerance, loops=loops)
    at = held.check_assembled()
    N, s = null_space(at.J, held.zero)
    rank = held.n - N.shape[1]
    redundant, stresses = _redundant(held, at.J, rank)
    found = finite_motion(held, at, seed)
    return Mobility(
        count(held, state, seed), held.n, held.m, rank, s, held.zero, found, redundant, stresses, not held.placed.all(), seed
    )


def _redundant(held: ConstraintManifold, J: Array, rank: int) -> tuple[tuple[RedundantRow, ...], Array]:
    """Rows that follow from others, by pivoted QR of J^T, and the self-stresses."""
    if rank == held.m:
        return (), np.zeros((held.m, 0))
    R, pivots = qr(J.T, mode="r", pivoting=True)
    shares = np.linalg.lstsq(R[:rank, :rank], R[:rank, rank:], rcond=None)[0]
    rows = []
    for j, i in enumerate(pivots[rank:]):
        used = np.sort(pivots[:rank][np.abs(shares[:, j]) > 1e-7])
        rows.append(RedundantRow(held.names[i], tuple(held.names[k] for k in used)))
    U = np.linalg.svd(J)[0][:, rank:]
    stresses = held.weights[:, None] * U
    stresses /= np.abs(stresses).max(axis=0)
    rows.sort(key=lambda r: held.names.index(r.row))
    return tuple(rows), stresses


def _many(k: int, one: str, several: str) -> str:
    return f"{k} {one if k == 1 else several}"


def _dof(k: int) -> str:
    return _many(k, "degree of freedom", "degrees of freedom")


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
    first = 0
    for constraint in held.constraints:
        m = sum(name == constraint.name for name, _ in held.names)
        dof = loop_dof(constraint, state, normal)
        if dof is not None:
            closures.append(dof)
        else:
            others += m if normal is None else _generic_rank(held, slice(first, first + m), seed)
        first += m
    each = (*tree, *closures)
    bodies, joints = len(tree) + 1, len(each)
    return Count(k * (bodies - 1 - joints) + sum(each) - others, normal is not None, bodies, joints, each, others)


def plane_normal(state: State) -> Array | None:
    """Unit normal, in W, of the plane to which every joint's motion is parallel; None if there is none.

    Axes parallel to n stay so if all rotation is about n.
    """
    model = state.robot.model
    data = model.createData()
    columns = pin.computeJointJacobians(model, data, state.q).reshape(6, -1).T  # twists at the origin of W: linear, angular
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


def _generic_rank(held: ConstraintManifold, rows: slice, seed: int) -> int:
    rng, most = np.random.default_rng(seed), 0
    for _ in range(3):
        J = held.at(held.move(held.q, rng.normal(size=held.n))).J[rows]
        most = max(most, held.rank(J, RANK))
    return most
