"""Bilateral constraints stacked as functions of q: Jacobian, errors, and projection onto them.

Everything here is without units. A velocity is v = D z, with D the robot's own length for coordinates that slide and one for
those that turn; a row is divided by the largest norm that it has near the start. So ranks and singular values do not depend
on the unit of length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.errors import DuplicateName, InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.joint_coordinates import Piece, joint_motion
from rbd.model.state import State
from rbd.problem.cones import Line
from rbd.problem.rows import Rows

RANK = 1e-8
"""A singular value counts as zero at this fraction of the largest one (or of one, where all are small)."""

CLOSED = 1e-9
"""How far a configuration may be from the constraints [m, rad, over the rows' lengths] and still count as assembled."""

ITERATIONS = 100

RowName = tuple[str, int]
"""(constraint, its row, from 0)."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """What the constraints say at one configuration, without units.

    Attributes:
        q: The configuration, shape (nq,).
        J: Shape (m, nv), of z.
        error: Position errors, shape (m,); zero in rows that constrain velocity alone.
    """

    q: Array
    J: Array
    error: Array


class Held:
    """Constraints that hold, stacked.

    Args:
        state: Where and about which rows are measured; its velocity plays no part.
        constraints: Those that hold; None for the loops and wheels of the robot's file. Contacts without an anchor are
            anchored here.
        tolerance: How far off the constraints a configuration may be [m, rad, over the rows' norms]; above `CLOSED` for files
            whose lengths are rounded, and then singular values count as zero below ten times that.

    Attributes:
        robot: The robot.
        constraints: Those that have rows.
        q: The configuration of the state.
        names: (constraint, row) of each row.
        placed: Which rows have a position error, shape (m,), bool.
        metric: D, shape (nv,).
        length: The robot's own length [m].
        zero: Singular values count as zero at this fraction of the largest.

    Raises:
        InputError: no constraint, one that can break or slip, or one that moves by itself.
        DuplicateName: two under one name.
    """

    def __init__(self, state: State, constraints: Sequence[Constraint] | None, tolerance: float = CLOSED) -> None:
        if not isinstance(state, State):
            raise InputError(f"a State of a robot was expected first, got {state!r:.80}. Make one: rbd.State(robot, q).")
        self.robot: CheckedModel = state.robot
        self.tolerance, self.zero = tolerance, max(RANK, 10.0 * tolerance)
        self.q = state.q
        given = of_its_file(state.robot) if constraints is None else constraints
        at_rest = state.with_velocity(state.robot.zero_v)
        rows = rows_of(at_rest, given)
        kept = [(_anchored(c, r, at_rest), r) for c, r in zip(given, rows, strict=True) if len(r)]
        self.constraints = tuple(c for c, _ in kept)
        rows = rows_of(at_rest, self.constraints)
        _check(rows)
        self.names: tuple[RowName, ...] = tuple((r.name, i) for r in rows for i in range(len(r)))
        self.placed = np.concatenate([np.zeros(0, dtype=bool), *map(_placed, rows)])
        self._sizes = [len(r) for r in rows]
        self.length = characteristic_length(self.robot)
        self.metric = np.where(turning(self.robot), 1.0, self.length)
        self.weights = np.ones(len(self.names))
        norms = self._row_norms()
        most = float(norms.max(initial=0.0))
        if most > 0.0:  # A row of rounding alone stays one: divided by itself it would count.
            self.weights = 1.0 / np.maximum(norms, 1e-6 * most)

    def _row_norms(self) -> Array:
        """The largest norm of each row of J here and at three configurations about half a radian away, shape (m,)."""
        rng = np.random.default_rng(0)
        norms = np.linalg.norm(self.at(self.q).J, axis=1)
        for _ in range(3):
            z = rng.normal(size=self.n)
            try:
                there = self.at(self.move(self.q, 0.5 * z / np.linalg.norm(z)))
            except InputError:  # a constraint that is not defined there
                continue
            norms = np.maximum(norms, np.linalg.norm(there.J, axis=1))
        return norms

    @property
    def m(self) -> int:
        """Number of rows."""
        return len(self.names)

    @property
    def n(self) -> int:
        """Number of velocities."""
        return self.robot.nv

    def at(self, q: Array) -> Linearised:
        """J and errors at a configuration.

        Raises:
            InputError: if the number of rows has changed: a limit that was reached, say.
        """
        state = State(self.robot, q)
        rows = [c.rows(state) for c in self.constraints]
        if [len(r) for r in rows] != self._sizes:
            raise InputError(f"constraints of {self.robot.name} change their rows near the state (there {self._sizes}).")
        if not rows:
            return Linearised(state.q, np.zeros((0, self.n)), np.zeros(0))
        error = np.concatenate([np.zeros(len(r)) if r.error is None else r.error for r in rows])
        return Linearised(state.q, (np.vstack([r.J for r in rows]) * self.metric) * self.weights[:, None], error * self.weights)

    def move(self, q: Array, z: Array) -> Array:
        """The configuration reached from q by the displacement z, shape (nv,), without units."""
        return pin.normalize(self.robot.model, pin.integrate(self.robot.model, q, self.metric * z))

    def displacement(self, start: Array, end: Array) -> Array:
        """The displacement z from one configuration to another, shape (nv,), without units."""
        return pin.difference(self.robot.model, start, end) / self.metric

    def project(self, q: Array, *, iterations: int = ITERATIONS, within: float = 1e-14) -> Linearised:
        """The nearest point of the constraints that Levenberg's and Marquardt's steps reach; look at its `error`.

        The damping is |error|^2: quadratic convergence where the errors grow with the distance, also where rows repeat
        each other and where their rank changes [YamashitaFukushima2001]; slower where they only grow with its square.
        """
        at = self.at(q)
        here = self.placed
        cut = 1e-12 if self.tolerance <= CLOSED else self.zero
        for _ in range(iterations):
            size = max_abs(at.error)
            if size <= within:
                break
            U, s, Vt = np.linalg.svd(at.J[here], full_matrices=False)
            s = np.where(s > cut * max(1.0, float(s.max(initial=0.0))), s, 0.0)
            z = -(Vt.T * (s / (s * s + max(size * size, 1e-28)))) @ (U.T @ at.error[here])
            step = float(np.linalg.norm(z))
            try:
                nearer = self.at(self.move(at.q, z if step <= 0.5 else z * (0.5 / step)))
            except InputError:  # a constraint that is not defined there
                break
            if max_abs(nearer.error) > 0.999 * size and step < 1e-9:  # rounding
                break
            at = nearer
        return at

    def check_assembled(self) -> Linearised:
        """What holds at the state.

        Raises:
            InputError: if it is off the constraints, with the worst row and its distance.
        """
        at = self.at(self.q)
        if max_abs(at.error) > self.tolerance:
            worst = int(np.argmax(np.abs(at.error)))
            name, row = self.names[worst]
            off = abs(float(at.error[worst])) / float(self.weights[worst])
            raise InputError(
                f"{self.robot.name} is not assembled: row {row} of {name!r:.80} is off by {off:.3g} (m or rad). "
                "Close it first, with rbd.mechanism.assemble."
            )
        return at


def of_its_file(robot: CheckedModel) -> tuple[Constraint, ...]:
    """The loops and wheels that a robot's file states; empty where it states none."""
    return (*robot.loops(), *robot.wheels())


def kernel(J: Array, zero: float = RANK) -> tuple[Array, Array]:
    """(orthonormal basis of the kernel, shape (n, d); all singular values, shape (min(m, n),))."""
    if not len(J):
        return np.eye(J.shape[1]), np.zeros(0)
    _, s, Vt = np.linalg.svd(J)
    return Vt[rank_of(s, zero) :].T, s


def rank_of(singular_values: Array, zero: float = RANK) -> int:
    """How many singular values are above a fraction of the largest, or of one where all are small."""
    return int((singular_values > zero * max(1.0, float(singular_values.max(initial=0.0)))).sum())


def turning(robot: CheckedModel) -> Array:
    """Which velocities are angular, shape (nv,), bool. Joints that slide and turn at once (screws) count as turning."""
    out = np.ones(robot.nv, dtype=bool)
    for piece in pieces(robot):
        if piece.kind == "plane":
            out[piece.v : piece.v + 2] = False
        elif piece.kind == "space":
            out[piece.v : piece.v + 3] = False
    for joint in range(1, robot.model.njoints):
        name = robot.model.joints[joint].shortname()
        at, nv = robot.model.idx_vs[joint], robot.model.nvs[joint]
        if name.startswith("JointModelP") and nv == 1 or name == "JointModelTranslation":
            out[at : at + nv] = False
    return out


def pieces(robot: CheckedModel) -> list[Piece]:
    """The coordinates of all joints, in pieces that belong together."""
    return [piece for name in robot.joints() for piece in joint_motion(robot, name).pieces]


def joint_of_velocity(robot: CheckedModel) -> list[str]:
    """The joint of each velocity, shape (nv,)."""
    out = [""] * robot.nv
    for name in robot.joints():
        joint = robot.joint_id(name)
        for i in range(robot.model.idx_vs[joint], robot.model.idx_vs[joint] + robot.model.nvs[joint]):
            out[i] = name
    return out


def characteristic_length(robot: CheckedModel) -> float:
    """The largest distance between a joint and the next, or a frame on the same body [m]; one where there is none."""
    model = robot.model
    joints = [np.linalg.norm(model.jointPlacements[j].translation) for j in range(1, model.njoints) if model.parents[j]]
    frames = [np.linalg.norm(f.placement.translation) for f in model.frames if f.parentJoint]
    most = float(max([*joints, *frames], default=0.0))
    return most if most > 1e-9 else 1.0


def check_seed(seed: int) -> int:
    """A seed of draws.

    Raises:
        InputError: no whole number from 0.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed is {seed!r:.80}; expected a whole number from 0 to 2^63 - 1.")
    return int(seed)


def check_positive(what: str, value: float, most: float) -> float:
    """A number in (0, most].

    Raises:
        InputError: it is none.
    """
    found = as_float(value)
    if not 0.0 < found <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a number above 0, at most {most:g}.")
    return found


def _anchored(constraint: Constraint, rows: Rows, state: State) -> Constraint:
    """A contact that holds, held where it is: without an anchor its rows give no position."""
    anchored = getattr(constraint, "anchored", None)
    return anchored(state) if rows.error is None and callable(anchored) and _holds(rows) else constraint


def _holds(rows: Rows) -> bool:
    return all(isinstance(part, Line) for part in rows.cone.generators()[1])


def _placed(rows: Rows) -> Array:
    """Which rows have a position error."""
    if rows.error is None:
        return np.zeros(len(rows), dtype=bool)
    return np.ones(len(rows), dtype=bool) if rows.holonomic is None else np.asarray(rows.holonomic, dtype=bool)


def _check(rows: list[Rows]) -> None:
    seen: set[str] = set()
    for r in rows:
        if r.name in seen:
            raise DuplicateName(f"two constraints are called {r.name!r:.80}; give each its own name.")
        seen.add(r.name)
        if not _holds(r):
            raise InputError(
                f"{r.name!r:.80} can break or slip (its forces live in a {type(r.cone).__name__}); mobility is that of "
                "constraints that hold. Leave it out, or give it friction=None."
            )
        if max_abs(r.velocity) > 1e-12:
            raise InputError(f"{r.name!r:.80} moves by itself; mobility wants constraints at rest.")
