"""Assembly modes of a mechanism, found from many random starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.errors import CannotAssemble, InputError
from rbd.mechanism.assembly import TOLERANCE, check_descent, check_flag, distances
from rbd.mechanism.closure import Closure, Misfit, rank_of
from rbd.mechanism.coordinates import Beyond
from rbd.mechanism.descent import descend, settle
from rbd.mechanism.held import check_seed
from rbd.mechanism.independent import independent_columns
from rbd.model.checked_model import CheckedModel

SAME = 1e-5
"""Two poses are one if no coordinate differs by more [rad, m]: at a singular pose errors of 1e-12 leave 1e-6."""

MOST_TRIES = 1_000_000
_STEP = 0.02
"""How far along a direction that J allows it is looked whether a motion goes on, in units of `Closure.metric`."""


@dataclass(frozen=True, eq=False)
class Branch:
    """One way to put the mechanism together.

    Attributes:
        q: Its configuration, shape (nq,), angles in (-pi, pi] where limits let them.
        hits: How many starts ended there.
        residual: Largest entry of the errors [m, rad].
        singular: Whether the constraints lose rank there: another branch meets it, or it is flat.
        beyond_limits: Joints outside the limits of the robot's file.
    """

    q: Array
    hits: int
    residual: float
    singular: bool
    beyond_limits: tuple[Beyond, ...]


@dataclass(frozen=True, eq=False)
class Branches:
    """All branches that were found. That there are no others is not proved.

    Attributes:
        found: Ordered by their coordinates.
        tries: Random starts.
        closed: Starts that reached the constraints; the others ended in a minimum of the distance.
        since_new: Starts since the last new branch was found.
        seed: Of the starts.
        skipped: Constraints without a say, and why.
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
            lines.append(f"  {i}: q = {np.array2string(b.q, precision=6, suppress_small=True)}, {b.hits} hits{marks}")
        lines += [f"  not asked: {why}" for why in self.skipped]
        return "\n".join(lines)


def branches(
    robot: CheckedModel,
    constraints: Sequence[Constraint] | None,
    *,
    fixed: Mapping[str, object] | None = None,
    seed: int = 0,
    tries: int = 200,
    within_limits: bool = False,
    tolerance: float = TOLERANCE,
    max_iterations: int = 100,
) -> Branches:
    """All ways to assemble a mechanism that many random starts find.

    A start draws every joint over its limits, or over one turn, or (sliding, without limits) over the robot's reach, and goes
    down to the constraints as `assemble` does. Poses that differ by whole turns are one.

    Args:
        robot: The robot.
        constraints: As for `assemble`; None for the loops and wheels of its file.
        fixed: {joint: value} held exactly: enough of them that nothing can move.
        seed: Of the starts: the same seed finds the same.
        tries: How many starts.
        within_limits: Only poses within the limits of the robot's file; if not, those outside are marked.
        tolerance: As for `assemble`.
        max_iterations: Of each start.

    Returns:
        The branches, each with its number of hits. No proof that they are all.

    Raises:
        CannotAssemble: no start closes; says the least distance that is left.
        InputError: the mechanism can still move, so that its poses are a continuum: says what to fix. And as `assemble`.

    >>> print(rbd.mechanism.branches(robot, robot.loops(), fixed={"crank": 0.7}))
    """
    rng = np.random.default_rng(check_seed(seed))
    if isinstance(tries, bool) or not isinstance(tries, int) or not 1 <= tries <= MOST_TRIES:
        raise InputError(f"tries is {tries!r:.80}; expected a whole number from 1 to {MOST_TRIES}.")
    check_descent(tolerance, max_iterations)
    check_flag("within_limits", within_limits)
    closure = Closure(robot, constraints, fixed, within_limits=within_limits)
    poses: list[Misfit] = []
    hits: list[int] = []
    singular: list[bool] = []
    nearest: Misfit | None = None
    refusal: InputError | None = None
    closed = last_new = 0
    for i in range(tries):
        try:
            start = closure.at(closure.pin(closure.coordinates.draw(rng)))
            found = descend(closure, start, tolerance=tolerance, most=max_iterations)
        except InputError as error:  # of this draw, or of all: then what was given is wrong
            refusal = refusal or error
            continue
        if not found.closed:
            if nearest is None or found.misfit.error @ found.misfit.error < nearest.error @ nearest.error:
                nearest = found.misfit
            continue
        closed += 1
        same = [k for k, pose in enumerate(poses) if closure.coordinates.distance(pose.q, found.misfit.q) < SAME]
        if same:
            hits[same[0]] += 1
            continue
        poses.append(found.misfit)
        singular.append(_is_singular(closure, found.misfit, tolerance, max_iterations))
        hits.append(1)
        last_new = i
    if not poses:
        if nearest is None:
            assert refusal is not None  # a draw that is not refused closes, or comes near
            raise refusal
        raise _none(closure, nearest, tries, tolerance)
    out = []
    for pose, n, flat in zip(poses, hits, singular, strict=True):
        q = closure.coordinates.canonical(pose.q, closure.held)
        out.append(Branch(q, n, pose.residual, flat, closure.coordinates.beyond_limits(q)))
    out.sort(key=lambda b: tuple(np.round(b.q, 5) + 0.0))
    return Branches(tuple(out), tries, closed, tries - 1 - last_new, seed, closure.skipped)


def _is_singular(closure: Closure, at: Misfit, tolerance: float, most: int) -> bool:
    """Whether the constraints lose rank at a pose that is alone there.

    Raises:
        InputError: it is not alone: a step in a direction that J allows, brought back onto the constraints, leads on.
    """
    n = len(closure.free)
    J = at.J if len(at.J) else np.zeros((1, n))
    _, s, Vt = np.linalg.svd(J)
    null = Vt[rank_of(s) :]
    for z in [sign * _STEP * row for row in null for sign in (1.0, -1.0)]:
        there = descend(closure, closure.at(closure.move(at.q, z)), tolerance=tolerance, most=most)
        if not there.closed or np.linalg.norm(closure.way(at.q, there.misfit.q)) < 0.3 * _STEP:
            continue
        J = there.misfit.J if len(there.misfit.J) else np.zeros((1, n))
        free = [closure.coordinates.names[i] for i in closure.free[independent_columns(J)]]
        held = f" with {', '.join(map(repr, closure.fixed))} fixed"[:200] if closure.fixed else ""
        raise InputError(
            f"{closure.robot.name} can still move: {len(free)} freedom{'s' * (len(free) != 1)} left{held}, so its poses are a "
            f"continuum, not branches. Fix as many joints, e.g. {', '.join(map(repr, free))}."[:600]
        )
    return len(null) > 0


def _none(closure: Closure, nearest: Misfit, tries: int, tolerance: float) -> CannotAssemble:
    name, fixed = closure.robot.name, ", ".join(map(repr, closure.fixed))
    bottom = settle(closure, nearest)
    left = distances(bottom.misfit, tolerance)
    named = ", ".join(f"{row!r:.80} {d:.6g}" for row, d in list(left.items())[:6])
    return CannotAssemble(
        f"{name} does not close from any of {tries} starts; nearest it is apart by {named} m (or rad)"
        f"{', a true minimum of the distance' * bottom.minimum}. Check lengths and frames"
        f"{f', and the fixed values of {fixed:.200}' if fixed else ''}.",
        q=bottom.misfit.q,
        distances=left,
        minimum=bottom.minimum,
    )
