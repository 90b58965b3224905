"""`find_equilibrium` and `find_steady_motion`: states at rest without acceleration, and motions of constant velocity."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.answers.least_constraint import solve
from rbd.answers.solution import Solution
from rbd.arrays import Array, as_float, lazy, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.manifold import ConstraintManifold, own_or
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSteadyState, RbdError, RbdWarning
from rbd.errors.inputs import check_kind
from rbd.mechanism.small_motion.linearisation import linearise
from rbd.mechanism.small_motion.linearised import Linearised
from rbd.mechanism.small_motion.steady_search import Condition, FoundState, Search, held_together
from rbd.mechanism.small_motion.tangent_space import ad_matrix
from rbd.model.external import External
from rbd.model.state import State, checked, with_values
from rbd.statics.equilibrium import hold

ACCEPTED = 1e-8
"""Largest residual of a steady state that is returned [m, rad; m/s; m/s2]."""
FREE = "free"


@dataclass(frozen=True, eq=False, repr=False)
class SteadyState(Displayed):
    """An equilibrium or a steady motion, with the residuals that certify it and what small motion about it does.

    Attributes:
        state: Where it is, and how fast; v is zero at an equilibrium.
        tau: Motor torques that go with it, shape (nu,).
        solution: The answer of `rbd.solve` there, with the forces.
        acceleration: Largest `|a|` of that answer [m/s2, rad/s2], of bodies of revolution in axes that do not spin with them.
        residual: Largest error of positions, velocities and accelerations, of a motion a little ahead too.
        freedoms: Dimension of the steady states around it, this one's symmetries among them.
        moved: How far it is from the start, the largest entry of the difference of q [rad, or robot's lengths].
        iterations: Newton's steps.

    Example:
        >>> pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[2.0]), masses=[1.0])
        >>> found = rbd.find_equilibrium(pendulum.at([-1.2]))
        >>> found.state.q.round(6), found.linearised.stable  # None: it swings without damping
        (array([-1.570796]), None)
    """

    state: State
    tau: Array
    solution: Solution
    acceleration: float
    residual: float
    freedoms: int
    moved: float
    iterations: int
    constraints: tuple[Constraint, ...]
    external: External

    @lazy
    def linearised(self) -> Linearised:
        """The linear equations of small motion about it, computed on first use; see `rbd.linearise`."""
        return linearise(self.state, self.constraints, self.tau, external=self.external)

    @property
    def stable(self) -> bool | None:
        """As `Linearised.stable`: None where modes oscillate without damping."""
        return self.linearised.stable

    def __str__(self) -> str:
        what = "steady motion" if self.state.v.any() else "equilibrium"
        around = f"{self.freedoms} directions of such states around it" if self.freedoms else "none beside it"
        lines = [
            f"{what.capitalize()} of {self.state.robot.name}: |a| <= {self.acceleration:.1e}, other residuals up to "
            f"{self.residual:.1e}; {around}; found in {self.iterations} steps, {self.moved:.3g} from the start",
        ]
        try:
            lines.append(self.linearised.verdict)
        except RbdError as error:
            lines.append(f"No linear equations: {error}")
        return "\n".join(lines)


def find_equilibrium(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    tau: Array | Sequence[float] | str | None = None,
    external: External = None,
    fixed: Mapping[str, object] | None = None,
    loops: bool = True,
) -> SteadyState:
    """The equilibrium nearest to a state: a configuration on the constraints with a = 0 at v = 0.

    Newton's method on the constraints, each step the least change that solves the linearised equations; where it is stuck it
    goes downhill in the energy first. Contacts hold during the search, and the answer is checked under the contact law. It
    finds stable and unstable equilibria alike.

    Args:
        state: Where to start; its velocity is not used.
        constraints: As of `solve`; None for the loops and wheels of the robot's file. Contacts without an anchor are anchored
            here.
        tau: Motor torques, shape (nu,) [N, N m], constant; None: zero. "free": those that hold are found too, for the pose
            nearest to the start that some torques hold, of least effort as `rbd.hold` finds them.
        external: Other forces, as of `solve`.
        fixed: {joint: value that is kept}, as `State.with_joints` takes them.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The equilibrium, with its residuals; `found.linearised` says whether it is stable.

    Raises:
        InputError: wrong sizes, NaN.
        JointNotFound: with the nearest names.
        NoSteadyState: none was found from here, or friction does not hold it; with the nearest state.
        NotDifferentiable: the search meets a singular pose, where motions branch.
        CannotHold: no torques within the limits hold it (of "free").

    Example:
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> found = rbd.find_equilibrium(bars.at("assembled"), bars.loops())
        >>> print(f"{found.acceleration < 1e-9}, {found.linearised.modes()[0].frequency:.4f} Hz")
        True, ...
    """
    robot = checked(state).robot
    given = own_or(robot, constraints, loops)
    found, free = _search(state.with_velocity(robot.zero_v), given, fixed, None, (), tau, external)
    torques = hold(found.state, given, external=external).tau if free else found.tau
    return _answer(state, found, torques, given, external)


def find_steady_motion(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    fixed: Mapping[str, object] | None = None,
    speeds: Mapping[str, float] | None = None,
    conditions: Sequence[Condition] = (),
    tau: Array | Sequence[float] | str | None = None,
    external: External = None,
    loops: bool = True,
) -> SteadyState:
    """The steady motion nearest to a state: q and v whose v' is zero now and stays zero, v of a base in its own axes.

    Rolling, cruising, turning and spinning at constant rates: along such a motion nothing changes but coordinates on which
    nothing depends (a place on the ground, a direction, a wheel's angle). Constraints and a = 0 are imposed at three times of
    the motion with constant v; each Newton step is the least change that solves them.

    Args:
        state: Where to start, near the motion: its velocity is used.
        constraints: As of `solve`; None for the loops and wheels of the robot's file.
        fixed: {joint: value that is kept}, as `State.with_joints` takes them.
        speeds: {velocity: value that is kept}: a joint with one degree of freedom, or an entry as "root_joint.vx" [m/s, rad/s].
        conditions: Functions of the state that are to vanish, for what is no joint's value: a lean, a radius.
        tau: As of `find_equilibrium`; "free": torques of least norm that go with it.
        external: Other forces, as of `solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The steady motion, with its residuals; `found.linearised` says whether it is stable.

    Raises:
        InputError: wrong sizes, NaN, a condition that is not finite.
        JointNotFound: with the nearest names.
        NoSteadyState: none was found from here, or contacts slip; with the nearest state.
        NotDifferentiable: the search meets a singular pose, where motions branch.

    Example:
        >>> coin = rbd.load_robot("rolling_disk")
        >>> start = coin.at("upright", [1.0, 0.0, 0.0, 0.0, 3.0, 0.0])
        >>> found = rbd.find_steady_motion(start, speeds={"root_joint.wy": 3.0})
        >>> print(found.state.v.round(6), f"{found.residual < 1e-9}")
        [...] True
    """
    given = own_or(checked(state).robot, constraints, loops)
    if not isinstance(conditions, list | tuple) or not all(map(callable, conditions)):
        raise InputError(
            f"conditions are {conditions!r:.80}; expected functions of the state, e.g. [lambda state: state.q[2] - 1]."
        )
    found, _ = _search(state, given, fixed, {} if speeds is None else speeds, conditions, tau, external)
    return _answer(state, found, found.tau, given, external)


def _search(
    state: State,
    constraints: Sequence[Constraint],
    fixed: Mapping[str, object] | None,
    speeds: Mapping[str, float] | None,
    conditions: Sequence[Condition],
    tau: Array | Sequence[float] | str | None,
    external: External,
) -> tuple[FoundState, bool]:
    """(the steady state that the search ends in, whether its torques were free); an equilibrium where `speeds` is None."""
    free, torques = _torques(state, tau)
    start, kept, still = _started(state, fixed, speeds)
    held = tuple(held_together(c) for c in constraints)
    moving, manifold = np.flatnonzero(~still), ConstraintManifold.about(start, held)
    search = Search(
        held, manifold, external, np.flatnonzero(~kept), moving[:0] if speeds is None else moving, free, tuple(conditions)
    )
    found = search.run(start, torques)
    _check(found, "equilibrium" if speeds is None else "steady motion")
    return found, free


def _torques(state: State, tau: Array | Sequence[float] | str | None) -> tuple[bool, Array]:
    """(whether they are free, torques)."""
    if isinstance(tau, str):
        if tau != FREE:
            raise InputError(f"tau is {tau!r:.80}; expected torques (nu,), None for zero, or 'free'.")
        return True, np.zeros(state.robot.nu)
    return False, state.robot.check_tau(tau)


def _started(
    state: State, fixed: Mapping[str, object] | None, speeds: Mapping[str, float] | None
) -> tuple[State, Array, Array]:
    """(the state with the values given, which entries of dq are kept, which of v)."""
    robot = state.robot
    kept, still = np.zeros(robot.nv, bool), np.zeros(robot.nv, bool)
    q, v = with_values(robot, state.q, {} if fixed is None else fixed, argument="fixed"), state.v.copy()
    for name in {} if fixed is None else fixed:
        kept[robot.joints[name].v] = True
    check_kind("speeds", speeds, Mapping | None, "a mapping {velocity: value}, e.g. {'root_joint.vx': 5.0}")
    for name, value in (speeds or {}).items():
        at = robot.joints.velocity(name)
        number = as_float(value)
        if at.stop - at.start != 1 or not np.isfinite(number):
            entries = ", ".join(repr(c.name) for c in robot.joints.velocities[at])
            raise InputError(f"speed of {name!r:.80} is {value!r:.80}; expected one finite number, of one of {entries}.")
        v[at], still[at] = number, True
    return State(robot, q, v, t=state.t), kept, still


def _check(found: FoundState, what: str) -> None:
    """Refuse what is no steady state."""
    if found.residual > ACCEPTED:
        state, names = found.state, [c.name for c in found.state.robot.joints.velocities]
        worst = int(np.abs(found.acceleration).argmax()) if len(names) else 0
        raise NoSteadyState(
            f"no {what} of {state.robot.name} was found from this start: after {found.iterations} steps the nearest state "
            f"still has a residual of {found.residual:.3g}, and {names[worst]!r} accelerates by "
            f"{found.acceleration[worst]:.3g}. Start nearer to one, let torques be found (tau='free'), or keep fewer values; "
            "`error.state` has the nearest.",
            state=state,
            acceleration=max_abs(found.acceleration),
        )


def _answer(
    start: State, found: FoundState, tau: Array, constraints: tuple[Constraint, ...], external: External
) -> SteadyState:
    """The record, its answer checked under the law of contact."""
    state, robot = found.state, found.state.robot
    with warnings.catch_warnings(action="ignore", category=RbdWarning):
        solution = solve(state, tau, constraints, external=external)
    acceleration = max_abs(solution.a + ad_matrix(robot, found.spin) @ state.v)
    if acceleration > 1e-6:
        raise NoSteadyState(
            f"{robot.name} would be steady here if its contacts held, and under the law of contact it accelerates by "
            f"{acceleration:.3g} (m/s2 or rad/s2): they slip or open. Give more friction, or friction=None.",
            state=state,
            acceleration=acceleration,
        )
    moved = max_abs(pin.difference(robot.model, start.q, state.q) / robot.joints.scale)
    return SteadyState(
        state, tau, solution, acceleration, found.residual, found.freedoms, moved, found.iterations, constraints, external
    )
