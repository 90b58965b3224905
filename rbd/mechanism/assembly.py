"""Assembling a mechanism: from a rough configuration onto its constraints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float, max_abs
from rbd.constraints.constraint import Constraint
from rbd.errors import CannotAssemble, InputError
from rbd.mechanism.closure import Closure, Misfit, rank_of, unmet
from rbd.mechanism.coordinates import Beyond
from rbd.mechanism.descent import Descent, descend, settle
from rbd.model.checked_model import CheckedModel
from rbd.problem.rows import Rows

TOLERANCE = 1e-12
STARTS = 24
"""Other starts that are tried, with a seed of their own, before loops are said not to close."""


@dataclass(frozen=True, eq=False)
class Assembly:
    """A configuration on the constraints.

    Attributes:
        q: The configuration, shape (nq,).
        residual: Largest entry of the errors [m, rad].
        iterations: Steps taken.
        moved: Length of the way from q0 to q as a velocity of unit time, angles by the short way round [rad, m].
        rows: The constraints' rows at q, at rest.
        freedoms: Free velocities less the rank of the rows' Jacobian: freedoms left at q, at first order.
        skipped: Constraints without a say, and why.
        beyond_limits: Joints outside the limits of the robot's file.
    """

    q: Array
    residual: float
    iterations: int
    moved: float
    rows: tuple[Rows, ...]
    freedoms: int
    skipped: tuple[str, ...]
    beyond_limits: tuple[Beyond, ...]

    def __str__(self) -> str:
        lines = [
            f"assembled to {self.residual:.1e} in {self.iterations} steps, {self.moved:.4g} from the start; "
            f"{self.freedoms} freedom{'s' * (self.freedoms != 1)} left"
        ]
        lines += [f"  not asked: {why}" for why in self.skipped]
        lines += [f"  beyond its limits: {joint}" for joint in self.beyond_limits]
        return "\n".join(lines)


def assemble(
    robot: CheckedModel,
    constraints: Sequence[Constraint] | None,
    q0: Array,
    *,
    fixed: Mapping[str, object] | None = None,
    within_limits: bool = False,
    within: float = math.inf,
    tolerance: float = TOLERANCE,
    max_iterations: int = 100,
) -> Assembly:
    """A configuration on the constraints near q0, with the residual that is left.

    Levenberg's and Marquardt's steps on the manifold of configurations; see `rbd.mechanism.descent`. Rows that repeat each
    other do no harm. From far away it may end in another branch than the one meant: look at `moved`, or give `within`.

    Args:
        robot: The robot.
        constraints: Loops, locks, couplings, held contacts with an anchor, functions of q; None for the loops
            and wheels of its file. Constraints of velocities alone are skipped, and named. Stops (`rbd.JointLimit`) are
            kept to one side.
        q0: Start, shape (nq,).
        fixed: {joint: value} held exactly: an angle [rad], a displacement [m], or the joint's part of q.
        within_limits: Keep every joint within the limits of the robot's file. If not, those beyond are reported.
        within: Farthest that q may be from q0, as `Assembly.moved` measures it; farther is refused.
        tolerance: Largest entry of the errors [m, rad]. Mechanisms of kilometres want more than the default: rounding.
        max_iterations: Most evaluations.

    Returns:
        The configuration and what is known of it.

    Raises:
        CannotAssemble: names the rows and the distance left; says whether it is a true minimum of the distance, whether
            another start closes (so this one was too far away), which fixed values contradict the constraints.
        InputError: no constraint with an error, one that can slip or break, values of a wrong size.
        JointNotFound: a fixed joint that is none.

    >>> found = rbd.mechanism.assemble(robot, robot.loops(), q0, fixed={"crank": 0.7})
    """
    if not as_float(within) > 0.0:
        raise InputError(f"within is {within!r:.80}; expected a number > 0 [rad, m], or inf.")
    check_descent(tolerance, max_iterations)
    check_flag("within_limits", within_limits)
    closure = Closure(robot, constraints, fixed, within_limits=within_limits)
    start = closure.start(q0)
    found = descend(closure, start, tolerance=tolerance, most=max_iterations)
    if not found.closed:
        found = _second_thoughts(closure, found, tolerance, max_iterations)
    misfit = found.misfit
    q0 = np.asarray(q0, float)
    moved = float(np.linalg.norm(closure.coordinates.way(q0, misfit.q)))
    if moved > within:
        raise CannotAssemble(
            f"{robot.name} closes, but {moved:.4g} from q0 [rad, m], and at most {within:g} is allowed: the start is too far "
            "away, or this is another branch. Give a nearer q0; see rbd.mechanism.branches for all branches.",
            q=misfit.q,
            elsewhere=misfit.q,
        )
    J = misfit.J if len(misfit.J) else np.zeros((1, len(closure.free)))
    rank = rank_of(np.linalg.svd(J, compute_uv=False))
    beyond = closure.coordinates.beyond_limits(misfit.q)
    return Assembly(
        misfit.q, misfit.residual, found.steps, moved, misfit.rows, len(closure.free) - rank, closure.skipped, beyond
    )


def _second_thoughts(closure: Closure, found: Descent, tolerance: float, most: int) -> Descent:
    """Off a saddle and down again; raises what is to be said if that does not close either."""
    bottom = settle(closure, found.misfit)
    again = descend(closure, bottom.misfit, tolerance=tolerance, most=most)
    if again.closed:
        return Descent(again.misfit, found.steps + again.steps, True, False)
    raise _failure(closure, bottom.misfit, tolerance, most, minimum=bottom.minimum)


def _failure(closure: Closure, at: Misfit, tolerance: float, most: int, *, minimum: bool) -> CannotAssemble:
    name, left = closure.robot.name, distances(at, tolerance)
    named = ", ".join(f"{row!r:.80} is {_apart(d)} apart" for row, d in list(left.items())[:6])
    say = [f"{name} does not close: {named or 'nothing is left'}."]
    floor = 1e3 * np.finfo(float).eps * closure.coordinates.reach
    elsewhere = None
    if at.residual < max(floor, 10.0 * tolerance):
        say.append(f"What is left is rounding of lengths of {closure.coordinates.reach:.3g} m; give tolerance={floor:.0e}.")
    else:
        elsewhere, least = _other_starts(closure, tolerance, most)
        say.append("Nothing nearby makes it less: a true minimum of the distance." if minimum else "The steps ran out there.")
        if elsewhere is not None:
            say.append(
                f"From another start it closes, {float(np.linalg.norm(closure.coordinates.way(at.q, elsewhere))):.3g} away "
                "[rad, m] (`error.elsewhere`): this start is too far away. Give a nearer q0, or see rbd.mechanism.branches."
            )
        elif len(closure.free):
            say.append(
                f"None of {STARTS} other starts closes either; the least that one left is {_apart(least)}. It looks as if "
                "the loops cannot close: check lengths, frames and fixed values."
            )
        if closure.fixed and elsewhere is None:
            say.append(_without_each_fixed(closure, at.q, tolerance, most))
    return CannotAssemble(" ".join(say), q=at.q, distances=left, minimum=minimum, elsewhere=elsewhere)


def distances(at: Misfit, tolerance: float) -> dict[str, float]:
    """{constraint: length of its error}, of those that are not met, the largest first [m, rad]."""
    out = {}
    for r in at.rows:
        error, _ = unmet(r)
        if max_abs(error) > tolerance:
            out[r.name] = float(np.linalg.norm(error))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _other_starts(closure: Closure, tolerance: float, most: int) -> tuple[Array | None, float]:
    """A configuration that closes, from seeded starts, and the least distance of any."""
    rng, least = np.random.default_rng(0), math.inf
    for _ in range(STARTS if len(closure.free) else 0):
        try:
            found = descend(closure, closure.at(closure.pin(closure.coordinates.draw(rng))), tolerance=tolerance, most=most)
        except InputError:  # a start where a constraint is not defined
            continue
        if found.closed:
            return found.misfit.q, 0.0
        least = min(least, float(np.linalg.norm(found.misfit.error)))
    return None, least


def _without_each_fixed(closure: Closure, q: Array, tolerance: float, most: int) -> str:
    """Which fixed joints, let go alone, let the loops close, and where they then are."""
    free, out = [], []
    for joint in closure.fixed:
        others = {name: value for name, value in closure.fixed.items() if name != joint}
        less = Closure(closure.robot, closure.constraints, others)
        found = descend(less, less.start(q), tolerance=tolerance, most=most)
        if not found.closed:
            continue
        free.append(joint)
        place = less.coordinates.places[joint]
        if place.nv == 1:
            out.append(f"{joint!r:.80} at {place.coordinate(found.misfit.q):.6g} (not {closure.fixed[joint]!r:.40})")
    if not free:
        return f"Letting go any one of the fixed joints ({', '.join(map(repr, closure.fixed))}) does not help."[:300]
    if len(closure.fixed) > 1:
        return f"The fixed values contradict each other: let go alone, it closes with {' or '.join(out) or ', '.join(free)}."
    return f"The fixed value is what prevents it: it closes with {out[0] if out else free[0]}."


def _apart(distance: float) -> str:
    return f"{distance:.6g} m (or rad)"


def check_descent(tolerance: float, max_iterations: int, what: str = "max_iterations") -> None:
    """Refuse settings that are none.

    Raises:
        InputError: with what was expected.
    """
    if not 0.0 < as_float(tolerance) <= 1e-3:
        raise InputError(f"tolerance is {tolerance!r:.80}; expected a number > 0, at most 1e-3 [m, rad].")
    if isinstance(max_iterations, bool) or not isinstance(max_iterations, int) or not 0 < max_iterations <= 100_000:
        raise InputError(f"{what} is {max_iterations!r:.80}; expected a whole number from 1 to 100000.")


def check_flag(what: str, value: bool) -> None:
    """Refuse what is neither True nor False.

    Raises:
        InputError: with what was expected.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} is {value!r:.80}; expected True or False.")
