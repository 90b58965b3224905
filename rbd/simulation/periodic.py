"""Floquet multipliers: whether a periodic motion is stable, from differences of its whole period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_positive, max_abs
from rbd.constraints.constraint import Constraint
from rbd.constraints.manifold import ConstraintManifold, own_or
from rbd.control.schedules import Controller, ExternalAt
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.mechanism.projection import project_velocity
from rbd.mechanism.small_motion.tangent_space import TangentSpace, allowed_changes, check_on
from rbd.model.external import External
from rbd.model.state import State, checked
from rbd.simulation.integrators import DormandPrince8
from rbd.simulation.run import simulate
from rbd.simulation.simulated_motion import Integrator

RETURNS = 1e-6
"""Largest distance from its start at which a motion is after a period [rad, m, per second]."""
STEP = 1e-3
"""Change of a coordinate of the start [rad, or parts of the robot's length]; of a velocity, per part of a period below 1 s."""


@dataclass(frozen=True, eq=False)
class Floquet(Displayed):
    """Growth of small changes of a periodic motion over one period: x(T) = M x(0), x as of `rbd.mechanism.Linearised`.

    Attributes:
        state: The start of the motion.
        period: T [s].
        monodromy: M, shape (n, n).
        space: The changes that the constraints allow, with their coordinates.
        off: How far the motion is from its start after a period, its largest entry.
        difference: Largest difference of M by differences of second and of fourth order; M is the latter, which is closer.

    Example:
        >>> chain = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0], angles="vertical"), bodies="points", masses=[1.0])
        >>> hangs = rbd.simulation.floquet(chain.at([-np.pi / 2]), period=1.0)
        >>> hangs.multipliers.imag.round(6), hangs.stable  # of exp(+-i sqrt(g / l) T)
        (array([ 0.009501, -0.009501]), True)
    """

    state: State
    period: float
    monodromy: Array
    space: TangentSpace
    off: float
    difference: float

    @property
    def multipliers(self) -> Array:
        """Eigenvalues of M, the largest first, shape (n,), complex."""
        found = np.linalg.eigvals(self.monodromy).astype(complex)
        return found[np.lexsort((-found.imag, -np.abs(found).round(9)))]

    @property
    def stable(self) -> bool:
        """Whether no small change grows: all multipliers within the unit circle, or on it to the accuracy of M."""
        return bool(np.abs(self.multipliers).max(initial=0.0) <= 1.0 + max(RETURNS, self.difference))


def floquet(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    period: float,
    controller: Controller | None = None,
    external: External | ExternalAt = None,
    integrator: Integrator = DormandPrince8(rtol=1e-12, atol=1e-13),  # noqa: B008  a frozen record of settings
    loops: bool = True,
) -> Floquet:
    """Floquet multipliers of a periodic motion: of a mechanism that is driven, or that swings by itself.

    The motion is simulated over a period from its start and from four neighbours along each coordinate, which are put onto the
    constraints; differences of fourth order give the monodromy matrix.

    Args:
        state: The robot at the start, on its constraints, at the time of their motions.
        constraints: Bilateral ones; None for the loops and wheels of the robot's file.
        period: [s].
        controller: As of `rbd.simulate`; of the same period.
        external: As of `rbd.simulate`; of the same period.
        integrator: One whose steps are much more accurate than the changes, 1e-3.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: the state is off its constraints, or the motion is not where it began after a period.
        SimulationStopped: as `rbd.simulate`.

    Example:
        >>> chain = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0], angles="vertical"), bodies="points", masses=[1.0])
        >>> rbd.simulation.floquet(chain.at([np.pi / 2]), period=0.5).stable  # on its head
        False
    """
    robot, T = checked(state).robot, check_positive("period", period, 1e6, "s")
    given = own_or(robot, constraints, loops)
    manifold = ConstraintManifold.about(state, given)
    held = manifold.rows(state)
    check_on(held)
    space = allowed_changes(state, manifold, np.eye(len(held.J)))

    def end(change: Array) -> Array:
        q = pin.integrate(robot.model, state.q, change[: robot.nv])
        near = State(robot, manifold.project(q).q if manifold.placed.any() else q, state.v + change[robot.nv :], t=state.t)
        near = project_velocity(near, manifold.constraints, loops=False) if change.any() else state
        run = simulate(
            near, manifold.constraints, duration=T, step=T, controller=controller, external=external, integrator=integrator,
            progress=False, loops=False,
        )  # fmt: skip
        return np.concatenate([pin.difference(robot.model, state.q, run.q[-1]), run.v[-1] - state.v])

    off = max_abs(end(np.zeros(2 * robot.nv)))
    if off > RETURNS:
        raise InputError(
            f"the motion of {robot.name} is {off:.3g} (rad, m, or per second) from its start after {T:.6g} s; expected a "
            f"periodic one, to {RETURNS:g}. Give its period, and a start on it: simulate until it has settled."
        )
    columns = []
    for along, size in zip(space.basis.T, _sizes(space, robot.joints.scale, T), strict=True):
        one, two = (end(k * size * along) - end(-k * size * along) for k in (1.0, 2.0))
        columns.append(np.array([8.0 * one - two, 6.0 * one])[:, space.picked] / (12.0 * size))
    M, rough = np.array(columns).reshape(len(columns), 2, -1).transpose(1, 2, 0)
    return Floquet(state, T, M, space, off, max_abs((M - rough).ravel()))


def _sizes(space: TangentSpace, scale: Array, period: float) -> Array:
    return STEP * np.concatenate([scale[space.positions], scale[space.velocities] * max(1.0, 1.0 / period)])
