"""Singularities of a mechanism: configurations at which velocities gain or lose a degree of freedom, also along a motion.

Three matrices define them, each by its rank compared with the rank nearby:

    configuration   J                      J allows more velocities here than nearby; motions may branch
    output          J, columns of all but the inputs         the others can move with the inputs locked (type 2)
    input           J, columns of all but the outputs        the inputs can move while the output is at rest (type 1)

Types are those of [GosselinAngeles1990]; both at once is their type 3. [ParkKim1999] distinguish the first from the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.linalg import svdvals

from rbd.arrays import Array, as_array, check_positive, check_seed, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.manifold import RANK, ConstraintManifold, LinearisedRows, rank_of
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import listed_items
from rbd.mechanism.degrees_of_freedom import FAR, ROUGH, neighbours
from rbd.model.state import State, checked

KINDS = {
    "configuration": "J loses rank: more velocities are allowed here than nearby",
    "output": "with the inputs locked the rest can move (type 2)",
    "input": "the inputs can move while the output is at rest (type 1)",
}

SINGULAR = 1e-6
"""A configuration is singular where the ratio of singular values is below this."""


@dataclass(frozen=True, eq=False, repr=False)
class Singularity(Displayed):
    """One kind of singularity at one configuration, or the distance from it.

    Attributes:
        kind: "configuration", "output" or "input".
        q: The configuration, shape (nq,).
        distance: Smallest singular value that is not zero nearby, over the largest one; dimensionless.
        singular: Whether the distance is zero.
        lost: Loss of rank compared with configurations nearby.
        velocities: A basis of the velocities that define the kind, shape (k, nv), largest entry 1: allowed by J
            ("configuration"), and with the inputs ("output") or the outputs ("input") at rest. Empty where there are none.
        joints: The joints that move in them.
        at: Position along a motion: index in the list, fractions between two; 0 for a single configuration.
    """

    kind: str
    q: Array
    distance: float
    singular: bool
    lost: int
    velocities: Array
    joints: tuple[str, ...]
    at: float = 0.0

    def __str__(self) -> str:
        if not self.singular:
            return f"{self.kind}: regular, {self.distance:.3g} away"
        return f"{self.kind}: singular; {KINDS[self.kind]}; moving: {', '.join(self.joints) or 'none'}"


@dataclass(frozen=True, eq=False, repr=False)
class Singularities(Displayed):
    """The kinds of singularity at one configuration, each with its distance and the velocities that show it.

    Attributes:
        kinds: {kind: its singularity}; "output" only with inputs named, "input" only with outputs named.
        points: Number of configurations examined for the ranks nearby.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> found = rbd.mechanism.singularities(robot.at("assembled"), inputs=["crank_joint"])
        >>> found.singular, sorted(found.kinds)
        ((), ['configuration', 'output'])
    """

    kinds: dict[str, Singularity]
    points: int

    @property
    def singular(self) -> tuple[str, ...]:
        """The kinds of which the configuration is singular."""
        return tuple(kind for kind, found in self.kinds.items() if found.singular)

    def __str__(self) -> str:
        return "\n".join(map(str, self.kinds.values()))


@dataclass(frozen=True, eq=False, repr=False)
class SingularitiesAlong(Displayed):
    """The singularities that a motion passes, and the distance from each kind along it.

    Attributes:
        found: The singularities, in the order of the motion.
        distances: {kind: distance at each configuration given, shape (k,)}.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(-1.0, 1.0), steps=20)
        >>> passed = rbd.mechanism.singularities_along(robot.at("assembled"), path=path, outputs=["rocker_joint"])
        >>> [each.kind for each in passed.found], passed.distances["input"].shape
        (['input'], (21,))
    """

    found: tuple[Singularity, ...]
    distances: dict[str, Array]

    def __str__(self) -> str:
        lines = [f"at {s.at:.6g}: {s}" for s in self.found]
        nearest = [f"{kind} {float(d.min()):.3g}" for kind, d in self.distances.items()]
        return "\n".join([*(lines or ["no singularity found"]), "smallest distances given: " + ", ".join(nearest)])


def singularities(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    inputs: Sequence[str] = (),
    outputs: str | Sequence[str] = (),
    tolerance: float = SINGULAR,
    seed: int = 0,
    loops: bool = True,
) -> Singularities:
    """The kinds of singularity of a configuration, with the velocities that define them.

    A rank is low if it is lower than at configurations about 0.1 away that satisfy the constraints; there must be some.

    Args:
        state: A robot at a configuration that satisfies the constraints; its velocity is not used.
        constraints: Bilateral constraints; None for the loops and wheels of its file.
        inputs: Joints that are driven; none: kind "output" is not examined.
        outputs: The driven output: joints, or the name of one frame (all its six velocities); none: kind "input"
            is not examined.
        tolerance: Distances below count as zero.
        seed: Of the directions of the configurations nearby.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        JointNotFound, FrameNotFound: with the nearest names.
        InputError: the state is off the constraints, or all joints are inputs or outputs.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 1.0, 1.0, 1.0, crank_angle=1.0)
        >>> flat = rbd.mechanism.assemble(robot.at("assembled"), fixed={"crank_joint": 0.0}).q
        >>> rbd.mechanism.singularities(robot.at(flat), inputs=["crank_joint"]).singular
        ('configuration', 'output')
    """
    tolerance, seed = check_positive("tolerance", tolerance, 0.1), check_seed(seed)
    held = ConstraintManifold(state, constraints, loops=loops)
    at = held.check_assembled()
    matrices = _Matrices(held, inputs, outputs)
    nearby = [p for p in neighbours(held, at, FAR, np.random.default_rng(seed), 12) if p is not None]
    kinds = {}
    for kind, of in matrices.of.items():
        rank = max([rank_of(svdvals(of(at))), *(rank_of(svdvals(of(p)), ROUGH) for p in nearby)])
        kinds[kind] = matrices.judge(kind, at, rank, tolerance)
    return Singularities(kinds, 1 + len(nearby))


def singularities_along(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    path: Array,
    inputs: Sequence[str] = (),
    outputs: str | Sequence[str] = (),
    tolerance: float = SINGULAR,
    loops: bool = True,
) -> SingularitiesAlong:
    """The singularities that a motion passes, each refined between the configurations given.

    Where a distance is smallest among its neighbours it is minimised by golden sections, on the straight line from
    one configuration to the next, projected onto the constraints. Two singularities of one kind between the same
    configurations count as one; so does one that is only touched there.

    Args:
        state: Where contacts without an anchor are anchored and rows are scaled, e.g. at the path's beginning.
        constraints: As for `singularities`. The ranks for comparison are the largest along the path.
        path: Configurations in order, shape (k, nq), near enough to the constraints to be projected; or a `Trace`, or
            another object with such an array as its `q`.
        inputs: As for `singularities`.
        outputs: As for `singularities`.
        tolerance: As for `singularities`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(-1.0, 1.0), steps=20)
        >>> passed = rbd.mechanism.singularities_along(robot.at("assembled"), path=path, outputs=["rocker_joint"])
        >>> angles = rbd.mechanism.link_angles(robot.at(passed.found[0].q))
        >>> print(passed.found[0].kind, f"{angles['crank']:.4f} {angles['coupler']:.4f}")  # crank and coupler in line
        input -0.7688 -0.7688
    """
    tolerance = check_positive("tolerance", tolerance, 0.1)
    robot = checked(state).robot
    given = as_array("path", getattr(path, "q", path))
    if given.ndim != 2 or given.shape[1] != robot.nq or not len(given):
        raise InputError(f"path has shape {given.shape}; expected (k, {robot.nq}): configurations in order.")
    held = ConstraintManifold(state, constraints, loops=loops)
    matrices = _Matrices(held, inputs, outputs)
    along = [held.project(State(robot, q).q) for q in given]
    for k, point in enumerate(along):
        if (off := max_abs(point.error)) > 1e-6:
            raise InputError(f"configuration {k} of the path cannot be brought onto the constraints; {off:.3g} is left.")
    found: list[Singularity] = []
    distances = {}
    for kind, of in matrices.of.items():
        values = [svdvals(of(point)) for point in along]
        rank = max(map(rank_of, values))
        d = np.array([_distance(s, rank) for s in values])
        distances[kind] = d
        for k in _minima(d):
            at, point = _refined(held, along, k, of, rank)
            judged = matrices.judge(kind, point, rank, tolerance, at)
            if judged.singular and not any(s.kind == kind and abs(s.at - at) < 1e-3 for s in found):
                found.append(judged)
    return SingularitiesAlong(tuple(sorted(found, key=lambda s: s.at)), distances)


class _Matrices:
    """The matrices whose ranks define the kinds, as functions of a configuration."""

    def __init__(self, held: ConstraintManifold, inputs: Sequence[str], outputs: str | Sequence[str]) -> None:
        self.held = held
        self.of: dict[str, Callable[[LinearisedRows], Array]] = {"configuration": lambda p: p.A}
        self.columns = {"configuration": np.arange(held.n)}
        driven = _columns(held, "inputs", inputs)
        if len(driven):
            self._without("output", driven)
        if isinstance(outputs, str):
            frame, robot = outputs, held.robot
            robot.frame_id(frame)
            scale = np.r_[np.full(3, 1.0 / robot.joints.length), np.ones(3)]
            self.columns["input"] = np.arange(held.n)
            self.of["input"] = lambda p: np.vstack([p.A, scale[:, None] * p.state.frame(frame).J.reshape(6, -1) * held.scale])
        else:
            moved = _columns(held, "outputs", outputs)
            if len(moved):
                self._without("input", moved)

    def _without(self, kind: str, locked: Array) -> None:
        rest = np.setdiff1d(np.arange(self.held.n), locked)
        if not len(rest):
            what = "inputs" if kind == "output" else "outputs"
            raise InputError(f"all joints are among the {what}; expected some beside them.")
        self.columns[kind] = rest
        self.of[kind] = lambda p: p.A[:, rest]

    def judge(self, kind: str, point: LinearisedRows, rank: int, tolerance: float, at: float = 0.0) -> Singularity:
        """The singularity of one kind at a configuration, given the usual rank."""
        A, held = self.of[kind](point), self.held
        _, s, Vt = np.linalg.svd(A)
        zero = max(tolerance, RANK) * (s[0] if len(s) and s[0] > 0.0 else 1.0)
        here = min(int((s > zero).sum()), rank)
        Z = np.zeros((len(Vt) - here, held.n))
        Z[:, self.columns[kind]] = Vt[here:]
        moving = np.abs(Z).max(axis=0, initial=0.0)
        v = Z * held.scale
        v /= np.maximum(np.abs(v).max(axis=1, initial=0.0), 1e-300)[:, None]
        v[np.abs(v) < 1e-12] = 0.0
        velocities = held.robot.joints.velocities
        joints = dict.fromkeys(velocities[i].joint for i in range(held.n) if moving[i] > 1e-6)
        return Singularity(kind, point.q, _distance(s, rank), here < rank, rank - here, v, tuple(joints), at)


def _columns(held: ConstraintManifold, what: str, joints: Sequence[str]) -> Array:
    """Indices in v of the joints named."""
    named = np.zeros(held.n, bool)
    for name in listed_items(what, joints, "a list of joints' names"):
        named[held.robot.joints[name].v] = True
    return np.flatnonzero(named)


def _distance(s: Array, rank: int) -> float:
    """The smallest singular value that is usually not zero, over the largest."""
    return float(s[rank - 1] / s[0]) if rank and s[0] > 0.0 else 1.0


def _minima(d: Array) -> list[int]:
    """Indices of a sequence's local minima; of equal neighbours, the first."""
    left, right = np.append(np.inf, d[:-1]), np.append(d[1:], np.inf)
    return np.flatnonzero((d < left) & (d <= right) & ~((d == right) & (d > 0.5))).tolist()


def _refined(
    held: ConstraintManifold, along: Sequence[LinearisedRows], k: int, of: Callable[[LinearisedRows], Array], rank: int
) -> tuple[float, LinearisedRows]:
    """(position, singularity) nearest to singular between the neighbours of configuration k."""

    def distance(p: LinearisedRows) -> float:
        return _distance(svdvals(of(p)), rank)

    low, high = max(0, k - 1), min(len(along) - 1, k + 1)

    def point(t: float) -> LinearisedRows:
        i = min(int(t), len(along) - 2)
        if i < 0 or t == int(t):
            return along[int(t)]
        return held.project(held.move(along[i].q, (t - i) * held.way(along[i].q, along[i + 1].q)))

    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = float(low), float(high)
    x, y = b - ratio * (b - a), a + ratio * (b - a)
    fx, fy = distance(point(x)), distance(point(y))
    while abs(b - a) > 1e-11 * max(1.0, a, b):
        if fx > fy:  # seen from the other end
            a, x, fx, b, y, fy = b, y, fy, a, x, fx
        b, y, fy = y, x, fx
        x = b - ratio * (b - a)
        fx = distance(point(x))
    best = min((float(k), 0.5 * (a + b)), key=lambda t: distance(point(t)))
    return best, point(best)
