"""Assembling a mechanism: from a rough configuration onto its constraints, and all its assembly modes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_positive, check_seed, check_whole, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.descent import Descent, descend, displacement, minimise
from rbd.displayed import Displayed
from rbd.errors import CannotAssemble, InputError
from rbd.mechanism.constraint_error import (
    ASIDE,
    Closure,
    ConstraintResidual,
    around,
    independent_columns,
    position_residual,
)
from rbd.mechanism.idle import told
from rbd.mechanism.poses import LimitViolation, beyond_limits, canonical, draw, joints_in_words, moved_in_words
from rbd.model.state import State, checked
from rbd.problem.rows import Rows
from rbd.records import counted

TOLERANCE = 1e-12
STARTS = 24
"""Further starts, with a separate seed, before a loop is reported as not closing."""


@dataclass(frozen=True, eq=False, repr=False)
class Assembly(Displayed):
    """A configuration that satisfies the constraints, as `assemble` finds it, with its residual.

    Attributes:
        state: The robot there, at rest; `q` is its configuration, shape (nq,).
        residual: Largest entry of the errors [m, rad].
        iterations: Steps taken.
        moved: Distance from the start to q, the shorter way for angles [rad, m].
        rows: The constraints' rows at q, at rest.
        dof: Free velocities less the rank of the rows' Jacobian: degrees of freedom left at q, at first order.
        skipped: Constraints that were skipped, with the reason.
        beyond_limits: Joints outside the limits of the robot's file.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> found = rbd.mechanism.assemble(robot.at(), fixed={"crank_joint": 1.0})
        >>> print(found.dof, found.residual < 1e-12, f"moved {found.moved:.2f} rad")
        0 True moved 2.23 rad
    """

    state: State
    residual: float
    iterations: int
    moved: float
    rows: tuple[Rows, ...]
    dof: int
    skipped: tuple[str, ...]
    beyond_limits: tuple[LimitViolation, ...]

    @property
    def q(self) -> Array:
        """The configuration, shape (nq,)."""
        return self.state.q

    def __str__(self) -> str:
        lines = [
            f"assembled to {self.residual:.1e} in {counted(self.iterations, 'step')}, "
            f"{moved_in_words(self.state.robot, self.moved)}; {counted(self.dof, 'degree')} of freedom left"
        ]
        lines += [f"  not asked: {why}" for why in self.skipped]
        lines += [f"  beyond its limits: {joint}" for joint in self.beyond_limits]
        return "\n".join(lines)


def assemble(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    fixed: Mapping[str, object] | None = None,
    within_limits: bool = False,
    within: float = math.inf,
    tolerance: float = TOLERANCE,
    max_iterations: int = 100,
    loops: bool = True,
) -> Assembly:
    """A configuration on the constraints near that of a state, with its residual.

    Levenberg-Marquardt steps on the manifold of configurations; see `rbd.constraints.descent`. Redundant rows
    do no harm. From far away it can end on another branch than intended: check `moved`, or give `within`.

    Args:
        state: Where to start; its velocity is not used.
        constraints: Loops, locks, couplings, bilateral contacts with an anchor, functions of q; None for the loops
            and wheels of the robot's file. Velocity constraints are skipped, and named. Joint limits (`rbd.JointLimit`) are
            inequalities.
        fixed: {joint: value} exact values: an angle [rad], a displacement [m], or the joint's part of q.
        within_limits: Keep every joint within the limits of the robot's file. If not, violations are reported.
        within: Largest accepted distance from the start, as in `Assembly.moved`.
        tolerance: Largest entry of the errors [m, rad]. Mechanisms of kilometres need more than the default.
        max_iterations: Largest number of evaluations.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The configuration with its residual and properties.

    Raises:
        CannotAssemble: names the rows and their distance; whether it is a true minimum of the distance, whether
            another start closes (so this one was too far away), and which fixed values contradict the constraints.
        InputError: no constraint with an error, one that can slip or break, values of a wrong size.
        JointNotFound: an unknown fixed joint.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> found = rbd.mechanism.assemble(robot.at("assembled"), fixed={"crank_joint": 0.7})
        >>> angles = rbd.mechanism.link_angles(robot.at(found.q))
        >>> {link: round(angle, 4) for link, angle in angles.items()}
        {'ground': 0.0, 'crank': 0.7, 'coupler': 0.7921, 'coupler_tip': 0.7921, 'rocker': 1.9563, 'rocker_tip': 1.9563}
    """
    if not as_float(within) > 0.0:
        raise InputError(f"within is {within!r:.80}; expected a number > 0 [rad, m], or inf.")
    check_descent(tolerance, max_iterations)
    check_flag("within_limits", within_limits)
    robot, q0 = checked(state).robot, state.q
    closure = Closure(robot, constraints, fixed, within_limits=within_limits, loops=loops, t=state.t)
    found = descend(closure, closure.start(q0), tolerance=tolerance, most=max_iterations)
    if not found.closed:
        found = _from_lower_down(closure, found, tolerance, max_iterations)
    end = found.at
    moved = float(np.linalg.norm(displacement(robot, q0, end.q)))
    if moved > within:
        raise CannotAssemble(
            f"{robot.name} closes, but {moved_in_words(robot, moved)}, and at most {within:g} is allowed: the start is too "
            "far away, or this is another branch. Give a nearer one; see rbd.mechanism.branches for all branches.",
            q=end.q,
            elsewhere=end.q,
        )
    beyond = beyond_limits(robot, end.q)
    return Assembly(end.state, end.residual, found.steps, moved, end.rows, len(end.null), closure.skipped, beyond)


def _from_lower_down(
    closure: Closure, found: Descent[ConstraintResidual], tolerance: float, most: int
) -> Descent[ConstraintResidual]:
    """Descends again from a saddle point; raises the diagnosis if that does not close either."""
    bottom = minimise(closure, found.at)
    again = descend(closure, bottom.at, tolerance=tolerance, most=most)
    if again.closed:
        return Descent(again.at, found.steps + again.steps, True)
    raise _failure(closure, bottom.at, tolerance, most, minimum=bottom.minimum)


def _failure(closure: Closure, at: ConstraintResidual, tolerance: float, most: int, *, minimum: bool) -> CannotAssemble:
    robot, left = closure.robot, distances(at, tolerance)
    named = ", ".join(f"{row!r:.80} is {_apart(d)} apart" for row, d in list(left.items())[:6])
    say = [f"{robot.name} does not close: {named or 'nothing is left'}."]
    floor = 1e3 * np.finfo(float).eps * robot.joints.reach
    elsewhere = None
    if at.residual < max(floor, 10.0 * tolerance):
        say.append(f"The residual is rounding of lengths of {robot.joints.reach:.3g} m; give tolerance={floor:.0e}.")
    else:
        elsewhere, least = _other_starts(closure, tolerance, most)
        say.append("No small motion reduces it: a true minimum of the distance." if minimum else "The number of steps ran out.")
        if elsewhere is not None:
            say.append(
                f"From another start it closes, {float(np.linalg.norm(displacement(robot, at.q, elsewhere))):.3g} away "
                "[rad, m] (`error.elsewhere`): this start is too far away. Give a nearer one, or see rbd.mechanism.branches."
            )
        elif len(closure.free):
            say.append(
                f"None of {STARTS} other starts closes either; the smallest distance was {_apart(least)}. It looks as if "
                "the loops cannot close: check lengths, frames and fixed values."
            )
        if closure.fixed and elsewhere is None:
            say.append(_without_each_fixed(closure, at.q, tolerance, most))
    return CannotAssemble(" ".join(say), q=at.q, distances=left, minimum=minimum, elsewhere=elsewhere)


def check_descent(tolerance: float, max_iterations: int, what: str = "max_iterations") -> None:
    """Refuse invalid settings.

    Raises:
        InputError: with what was expected.
    """
    check_positive("tolerance", tolerance, 1e-3, "m, rad")
    check_whole(what, max_iterations, 100_000)


def distances(at: ConstraintResidual, tolerance: float) -> dict[str, float]:
    """{constraint: length of its error}, of the violated ones, the largest first [m, rad]."""
    errors = {r.name: position_residual(r)[0] for r in at.rows}
    out = {name: float(np.linalg.norm(error)) for name, error in errors.items() if max_abs(error) > tolerance}
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _other_starts(closure: Closure, tolerance: float, most: int) -> tuple[Array | None, float]:
    """A configuration that closes, from seeded starts, and the smallest distance found."""
    rng, least = np.random.default_rng(0), math.inf
    for _ in range(STARTS if len(closure.free) else 0):
        try:
            found = descend(closure, closure.at(closure.inside(draw(closure.robot, rng))), tolerance=tolerance, most=most)
        except InputError:  # a constraint may be undefined at a start
            continue
        if found.closed:
            return found.at.q, 0.0
        least = min(least, float(np.linalg.norm(found.at.error)))
    return None, least


def _without_each_fixed(closure: Closure, q: Array, tolerance: float, most: int) -> str:
    """Message: which fixed joints, each freed alone, let the loops close, and their values then."""
    free, out = [], []
    for joint in closure.fixed:
        others = {name: value for name, value in closure.fixed.items() if name != joint}
        less = Closure(closure.robot, closure.constraints, others, loops=False, t=closure.t)
        found = descend(less, less.start(q), tolerance=tolerance, most=most)
        free += [joint] * found.closed
        if found.closed and (moved := closure.robot.joints[joint]).nv == 1:
            out.append(f"{joint!r:.80} at {moved.coordinate(found.at.q):.6g} (not {closure.fixed[joint]!r:.40})")
    if not free:
        return f"Freeing any one of the fixed joints ({', '.join(map(repr, closure.fixed))}) does not help."[:300]
    if len(closure.fixed) > 1:
        return f"The fixed values contradict each other: with one free it closes, at {' or '.join(out) or ', '.join(free)}."
    return f"The fixed value prevents it: it closes with {out[0] if out else free[0]}."


def _apart(distance: float) -> str:
    return f"{distance:.6g} m (or rad)"


SAME = 1e-5
"""Two poses are the same if no coordinate differs by more [rad, m]: at a singular pose errors of 1e-12 leave 1e-6."""

MOST_TRIES = 1_000_000


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Displayed):
    """One assembly mode of a mechanism, as `branches` finds it.

    Attributes:
        state: The robot there, at rest; `q` is its configuration, shape (nq,), angles in (-pi, pi] where limits allow.
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

    state: State
    hits: int
    residual: float
    singular: bool
    beyond_limits: tuple[LimitViolation, ...]
    joints: tuple[str, ...] = ()

    @property
    def q(self) -> Array:
        """The configuration, shape (nq,)."""
        return self.state.q


@dataclass(frozen=True, eq=False, repr=False)
class Branches(Displayed):
    """All assembly modes that `branches` found, without proof of completeness.

    Attributes:
        found: Ordered by their coordinates.
        tries: Random starts.
        closed: Starts that reached the constraints; the others ended in a minimum of the distance.
        since_new: Starts since the last new branch was found.
        seed: Of the starts.
        skipped: Constraints that were skipped, with the reason.
        idle: Links that turn by themselves and were left at rest: poses that differ by such turns count as one.

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
    idle: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.found)

    @property
    def q(self) -> Array:
        """The configurations, shape (k, nq)."""
        return np.array([branch.q for branch in self.found])

    @property
    def unseen(self) -> float:
        """An estimate of how many branches were not found, from how often the others were: f1 (f1 - 1) / (2 (f2 + 1)).

        f1 branches were hit once, f2 twice (Chao's estimate, bias-corrected [Chao1984]). It is a lower bound of the mean, for
        starts that are independent: branches of which a start has less chance than of all that were found can be missing
        where it is zero. About f1 / closed is the chance that the next start ends on a new one.
        """
        once, twice = (sum(branch.hits == k for branch in self.found) for k in (1, 2))
        return once * (once - 1) / (2.0 * (twice + 1))

    def __str__(self) -> str:
        k, more = len(self.found), f"; by their hits {self.unseen:.3g} more" if self.unseen else ""
        lines = [
            f"{k} branch{'es' * (k != 1)} in {self.tries} tries (seed {self.seed}; {self.closed} closed), the last new "
            f"one {self.since_new} tries before the end{more}. That there are no more is not proved."
        ]
        for i, b in enumerate(self.found):
            marks = "".join([", singular" * b.singular, *(f"; beyond its limits: {joint}" for joint in b.beyond_limits)])
            lines.append(f"  branch {i}: {', '.join(b.joints)}; {b.hits} hit{'s' * (b.hits != 1)}{marks}")
        lines += [f"  not asked: {why}" for why in self.skipped]
        lines += [f"  idle: {body} turns by itself" for body in self.idle]
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
    moved onto the constraints as in `assemble`. Poses that differ by whole turns count as one, and those that differ by idle
    freedoms, such as the spin of a link between two balls.

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
    robot = checked(state).robot
    closure = Closure(robot, constraints, fixed, within_limits=within_limits, loops=loops, t=state.t)
    poses: list[tuple[ConstraintResidual, bool]] = []  # each with whether it is singular
    hits = Counter[int]()
    nearest: ConstraintResidual | None = None
    refusal: InputError | None = None
    closed = last_new = 0
    for i in range(tries):
        try:
            closure.resting = False
            start = closure.at(closure.inside(draw(robot, rng)))
            found = descend(closure, start, tolerance=tolerance, most=max_iterations)
            closure.resting = True
        except InputError as error:  # of this draw, or of all draws: then the arguments are wrong
            refusal = refusal or error
            continue
        if not found.closed:
            if nearest is None or found.at.error @ found.at.error < nearest.error @ nearest.error:
                nearest = found.at
            continue
        closed += 1
        at = closure.rested(found.at)
        known = next((k for k, (pose, _) in enumerate(poses) if closure.apart(pose.q, at.q) < SAME), len(poses))
        hits[known] += 1
        if known == len(poses):
            poses.append((at, _is_singular(closure, at, tolerance, max_iterations)))
            last_new = i
    if not poses:
        if nearest is None:
            assert refusal is not None  # a draw that is not refused ends on the constraints, or near them
            raise refusal
        raise _no_start_closes(closure, nearest, tries, tolerance)
    out = []
    for k, (pose, flat) in enumerate(poses):
        q = canonical(robot, pose.q, closure.held)
        words = joints_in_words(robot, q, without=closure.fixed)
        out.append(Branch(State(robot, q), hits[k], pose.residual, flat, beyond_limits(robot, q), words))
    out.sort(key=lambda b: tuple(np.round(b.q, 5) + 0.0))
    return Branches(tuple(out), tries, closed, tries - 1 - last_new, seed, closure.skipped, told(closure.idle or []))


def _is_singular(closure: Closure, at: ConstraintResidual, tolerance: float, most: int) -> bool:
    """Whether the constraints lose rank at an isolated pose.

    Raises:
        InputError: it is not isolated: a step along a direction that J allows, projected onto the constraints, moves.
    """
    for there in around(closure, at, tolerance=tolerance, most=most):
        if np.linalg.norm(closure.way(at.q, there.q)) < 0.3 * ASIDE:
            continue
        free = closure.coordinate_names(independent_columns(there.J))
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
