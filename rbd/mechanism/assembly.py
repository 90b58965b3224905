"""Assembling a mechanism: from a rough configuration onto its constraints, or onto all its branches from many random starts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_whole, max_abs
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed
from rbd.errors import CannotAssemble, InputError
from rbd.mechanism.closure import Closure, ConstraintResidual, Descent, descend, minimise, position_residual
from rbd.mechanism.poses import LimitViolation, beyond_limits, displacement, draw
from rbd.model.state import State, check_state
from rbd.problem.rows import Rows

TOLERANCE = 1e-12
STARTS = 24
"""Further starts, with a separate seed, before a loop is reported as not closing."""


@dataclass(frozen=True, eq=False)
class Assembly(Displayed):
    """A configuration that satisfies the constraints, as `assemble` finds it, with its residual.

    Attributes:
        q: The configuration, shape (nq,).
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

    q: Array
    residual: float
    iterations: int
    moved: float
    rows: tuple[Rows, ...]
    dof: int
    skipped: tuple[str, ...]
    beyond_limits: tuple[LimitViolation, ...]

    def __str__(self) -> str:
        lines = [
            f"assembled to {self.residual:.1e} in {self.iterations} steps, {self.moved:.4g} from the start; "
            f"{self.dof} degree{'s' * (self.dof != 1)} of freedom left"
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

    Levenberg-Marquardt steps on the manifold of configurations; see `rbd.mechanism.closure`. Redundant rows
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
    robot, q0 = check_state(state).robot, state.q
    closure = Closure(robot, constraints, fixed, within_limits=within_limits, loops=loops)
    start = closure.start(q0)
    found = descend(closure, start, tolerance=tolerance, most=max_iterations)
    if not found.closed:
        found = _from_lower_down(closure, found, tolerance, max_iterations)
    end = found.at
    moved = float(np.linalg.norm(displacement(robot, q0, end.q)))
    if moved > within:
        raise CannotAssemble(
            f"{robot.name} closes, but {moved:.4g} from the start [rad, m], and at most {within:g} is allowed: the start is "
            "too far away, or this is another branch. Give a nearer one; see rbd.mechanism.branches for all branches.",
            q=end.q,
            elsewhere=end.q,
        )
    beyond = beyond_limits(robot, end.q)
    return Assembly(end.q, end.residual, found.steps, moved, end.rows, len(end.null), closure.skipped, beyond)


def _from_lower_down(closure: Closure, found: Descent, tolerance: float, most: int) -> Descent:
    """Descends again from a saddle point; raises the diagnosis if that does not close either."""
    bottom = minimise(closure, found.at)
    again = descend(closure, bottom.at, tolerance=tolerance, most=most)
    if again.closed:
        return Descent(again.at, found.steps + again.steps, True, False)
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
    if not 0.0 < as_float(tolerance) <= 1e-3:
        raise InputError(f"tolerance is {tolerance!r:.80}; expected a number > 0, at most 1e-3 [m, rad].")
    check_whole(what, max_iterations, 100_000)


def distances(at: ConstraintResidual, tolerance: float) -> dict[str, float]:
    """{constraint: length of its error}, of the violated ones, the largest first [m, rad]."""
    out = {}
    for r in at.rows:
        error, _ = position_residual(r)
        if max_abs(error) > tolerance:
            out[r.name] = float(np.linalg.norm(error))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _other_starts(closure: Closure, tolerance: float, most: int) -> tuple[Array | None, float]:
    """A configuration that closes, from seeded starts, and the smallest distance found."""
    rng, least = np.random.default_rng(0), math.inf
    for _ in range(STARTS if len(closure.free) else 0):
        try:
            found = descend(closure, closure.at(closure.pin(draw(closure.robot, rng))), tolerance=tolerance, most=most)
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
        less = Closure(closure.robot, closure.constraints, others, loops=False)
        found = descend(less, less.start(q), tolerance=tolerance, most=most)
        if not found.closed:
            continue
        free.append(joint)
        moved = closure.robot.joints[joint]
        if moved.nv == 1:
            out.append(f"{joint!r:.80} at {moved.coordinate(found.at.q):.6g} (not {closure.fixed[joint]!r:.40})")
    if not free:
        return f"Freeing any one of the fixed joints ({', '.join(map(repr, closure.fixed))}) does not help."[:300]
    if len(closure.fixed) > 1:
        return f"The fixed values contradict each other: with one free it closes, at {' or '.join(out) or ', '.join(free)}."
    return f"The fixed value prevents it: it closes with {out[0] if out else free[0]}."


def _apart(distance: float) -> str:
    return f"{distance:.6g} m (or rad)"
