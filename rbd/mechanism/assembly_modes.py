"""All poses in which a mechanism closes with given joint values: its assembly modes, from random starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, check_flag, check_seed, check_whole
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed
from rbd.errors import CannotAssemble, InputError
from rbd.mechanism.assembly import TOLERANCE, check_descent, distances
from rbd.mechanism.bilateral_velocities import independent_columns
from rbd.mechanism.closure import ASIDE, Closure, ConstraintResidual, around, descend, minimise
from rbd.mechanism.poses import LimitViolation, beyond_limits, canonical, distance, draw, joints_in_words
from rbd.model.state import State, check_state

SAME = 1e-5
"""Two poses are the same if no coordinate differs by more [rad, m]: at a singular pose errors of 1e-12 leave 1e-6."""

MOST_TRIES = 1_000_000


@dataclass(frozen=True, eq=False)
class Branch(Displayed):
    """One assembly mode of a mechanism, as `branches` finds it.

    Attributes:
        q: Its configuration, shape (nq,), angles in (-pi, pi] where limits allow.
        hits: Number of starts that ended there.
        residual: Largest entry of the errors [m, rad].
        singular: Whether the constraints lose rank there: another branch meets it, or it is flat.
        beyond_limits: Joints outside the limits of the robot's file.
        joints: The joints that were not fixed in words, such as "coupler_joint -19.70 deg".

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> first = rbd.mechanism.branches(robot.at(), fixed={"crank_joint": 1.0}, tries=20).found[0]
        >>> first.joints, first.singular
        (('coupler_joint -124.57 deg', 'rocker_joint -140.07 deg'), False)
    """

    q: Array
    hits: int
    residual: float
    singular: bool
    beyond_limits: tuple[LimitViolation, ...]
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Branches(Displayed):
    """All assembly modes that `branches` found, without proof of completeness.

    Attributes:
        found: Ordered by their coordinates.
        tries: Random starts.
        closed: Starts that reached the constraints; the others ended in a minimum of the distance.
        since_new: Starts since the last new branch was found.
        seed: Of the starts.
        skipped: Constraints that were skipped, with the reason.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> both = rbd.mechanism.branches(robot.at(), fixed={"crank_joint": 1.0}, tries=20)
        >>> both.q.shape, both.closed, [branch.singular for branch in both.found]
        ((2, 6), 20, [False, False])
    """

    found: tuple[Branch, ...]
    tries: int
    closed: int
    since_new: int
    seed: int
    skipped: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.found)

    @property
    def q(self) -> Array:
        """The configurations, shape (k, nq)."""
        return np.array([branch.q for branch in self.found])

    def __str__(self) -> str:
        k = len(self.found)
        lines = [
            f"{k} branch{'es' * (k != 1)} in {self.tries} tries (seed {self.seed}; {self.closed} closed), the last new "
            f"one {self.since_new} tries before the end. That there are no more is not proved."
        ]
        for i, b in enumerate(self.found):
            marks = "".join([", singular" * b.singular, *(f"; beyond its limits: {joint}" for joint in b.beyond_limits)])
            lines.append(f"  branch {i}: {', '.join(b.joints)}; {b.hits} hit{'s' * (b.hits != 1)}{marks}")
        lines += [f"  not asked: {why}" for why in self.skipped]
        return "\n".join(lines)


def branches(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    fixed: Mapping[str, object] | None = None,
    seed: int = 0,
    tries: int = 200,
    within_limits: bool = False,
    tolerance: float = TOLERANCE,
    max_iterations: int = 100,
    loops: bool = True,
) -> Branches:
    """All assembly modes of a mechanism that many random starts find.

    A start draws every joint over its limits, or over one turn, or (prismatic, without limits) over the robot's reach, and is
    moved onto the constraints as in `assemble`. Poses that differ by whole turns count as one.

    Args:
        state: Of the robot; its configuration is not used, starts are drawn.
        constraints: As for `assemble`; None for the loops and wheels of the robot's file.
        fixed: {joint: value}, exact, of as many joints as there are degrees of freedom.
        seed: Of the starts: the same seed gives the same branches.
        tries: Number of starts.
        within_limits: Only poses within the limits of the robot's file; if not, those outside are marked.
        tolerance: As for `assemble`.
        max_iterations: Evaluations of each start.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The branches, each with its number of hits. No proof of completeness.

    Raises:
        CannotAssemble: no start closes; with the smallest distance found.
        InputError: the mechanism can still move, so that its poses are a continuum; names joints to fix. And as `assemble`.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> found = rbd.mechanism.branches(robot.at(), fixed={"crank_joint": 0.7}, tries=20)
        >>> [round(rbd.mechanism.link_angles(robot.at(branch.q))["rocker"], 4) for branch in found.found]
        [-2.3495, 1.9563]
    """
    rng = np.random.default_rng(check_seed(seed))
    check_whole("tries", tries, MOST_TRIES)
    check_descent(tolerance, max_iterations)
    check_flag("within_limits", within_limits)
    robot = check_state(state).robot
    closure = Closure(robot, constraints, fixed, within_limits=within_limits, loops=loops)
    poses: list[ConstraintResidual] = []
    hits: list[int] = []
    singular: list[bool] = []
    nearest: ConstraintResidual | None = None
    refusal: InputError | None = None
    closed = last_new = 0
    for i in range(tries):
        try:
            start = closure.at(closure.pin(draw(robot, rng)))
            found = descend(closure, start, tolerance=tolerance, most=max_iterations)
        except InputError as error:  # of this draw, or of all draws: then the arguments are wrong
            refusal = refusal or error
            continue
        if not found.closed:
            if nearest is None or found.at.error @ found.at.error < nearest.error @ nearest.error:
                nearest = found.at
            continue
        closed += 1
        same = [k for k, pose in enumerate(poses) if distance(robot, pose.q, found.at.q) < SAME]
        if same:
            hits[same[0]] += 1
            continue
        poses.append(found.at)
        singular.append(_is_singular(closure, found.at, tolerance, max_iterations))
        hits.append(1)
        last_new = i
    if not poses:
        if nearest is None:
            assert refusal is not None  # a draw that is not refused ends on the constraints, or near them
            raise refusal
        raise _no_start_closes(closure, nearest, tries, tolerance)
    out = []
    for pose, n, flat in zip(poses, hits, singular, strict=True):
        q = canonical(robot, pose.q, closure.held)
        words = joints_in_words(robot, q, without=closure.fixed)
        out.append(Branch(q, n, pose.residual, flat, beyond_limits(robot, q), words))
    out.sort(key=lambda b: tuple(np.round(b.q, 5) + 0.0))
    return Branches(tuple(out), tries, closed, tries - 1 - last_new, seed, closure.skipped)


def _is_singular(closure: Closure, at: ConstraintResidual, tolerance: float, most: int) -> bool:
    """Whether the constraints lose rank at an isolated pose.

    Raises:
        InputError: it is not isolated: a step along a direction that J allows, projected onto the constraints, moves.
    """
    for there in around(closure, at, tolerance=tolerance, most=most):
        if np.linalg.norm(closure.way(at.q, there.q)) < 0.3 * ASIDE:
            continue
        free = closure.names(independent_columns(there.J))
        held = f" with {', '.join(map(repr, closure.fixed))} fixed"[:200] if closure.fixed else ""
        raise InputError(
            f"{closure.robot.name} can still move: {len(free)} degree{'s' * (len(free) != 1)} of freedom left{held}, so its "
            f"poses are a continuum, not branches. Fix as many joints, e.g. {', '.join(map(repr, free))}."[:600]
        )
    return len(at.null) > 0


def _no_start_closes(closure: Closure, nearest: ConstraintResidual, tries: int, tolerance: float) -> CannotAssemble:
    name, fixed = closure.robot.name, ", ".join(map(repr, closure.fixed))
    bottom = minimise(closure, nearest)
    left = distances(bottom.at, tolerance)
    named = ", ".join(f"{row!r:.80} {d:.6g}" for row, d in list(left.items())[:6])
    return CannotAssemble(
        f"{name} does not close from any of {tries} starts; nearest it is apart by {named} m (or rad)"
        f"{', a true minimum of the distance' * bottom.minimum}. Check lengths and frames"
        f"{f', and the fixed values of {fixed:.200}' if fixed else ''}.",
        q=bottom.at.q,
        distances=left,
        minimum=bottom.minimum,
    )
