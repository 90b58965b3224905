"""Base parameters: the combinations of a robot's inertial parameters that its motion and torques can tell, and no others.

Y theta depends on fewer combinations than theta has entries. Of regressors at random states, stacked, a QR factorisation finds
the columns Y_1 that are no combination of those before them; the others are Y_2 = Y_1 K [Gautier1991]:

    Y theta = Y_1 beta,      beta = theta_1 + K theta_2

Bodies are in the order of the tree, so that what a joint does not tell of a body is added to the body that carries it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, largest_first
from rbd.displayed import Displayed
from rbd.errors.inputs import check_kind, check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.inertial import body_names, checked_columns, inertial_parameters, parameter_names, regressor
from rbd.model.state import State

DEPENDENT = 1e-8
"""A column of which less than this share is left without those before it is their combination."""
ROUNDING = 1e-12
"""A column up to this, over the largest, is zero."""
SAID = 1e-6
"""Smallest coefficient that is printed, over one, with parameters in units of the robot's mass and length."""
LISTED = 12
"""Largest number of combinations that are printed."""


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters(Displayed):
    """The identifiable combinations beta = B theta of a robot's parameters: Y theta = Y[:, columns] B theta.

    Attributes:
        names: Of the parameters theta, shape (p,).
        columns: Indices of the independent columns of the regressor, shape (r,): each combination has the name of its column.
        B: Shape (r, p); one at its own column, zero at the other independent ones.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> base = rbd.motion.identification.base_parameters(arm)
        >>> print(base)  # the mass of link 2 counts where its joint is: on link 1
        6 base parameters of 20
          link_1.mc_x  + 1 link_2.m
          link_1.mc_z
          link_1.I_yy  + 1 link_2.m
          link_2.mc_x
          link_2.mc_z
          link_2.I_yy
    """

    names: tuple[str, ...]
    columns: Array
    B: Array

    @property
    def rank(self) -> int:
        """How many they are."""
        return len(self.columns)

    @property
    def labels(self) -> tuple[str, ...]:
        """The name of each: that of its own column."""
        return tuple(self.names[i] for i in self.columns)

    def values(self, theta: Array) -> Array:
        """Beta of parameters, shape (r,)."""
        return np.asarray(self.B @ theta)

    def expression(self, i: int, most: int = 6) -> str:
        """The combination as text, e.g. "knee.I_yy  + 1 foot.m - 0.3 foot.mc_x", with so many terms at most."""
        own = self.columns[i]
        order = largest_first(np.abs(self.B[i]))  # equal ones in the order of the tree
        others = [j for j in order if j != own and abs(self.B[i, j]) > SAID]
        told = [f"{'+' if self.B[i, j] > 0.0 else '-'} {abs(self.B[i, j]):.4g} {self.names[j]}" for j in others[:most]]
        more = [f"and {len(others) - most} more"] if len(others) > most else []
        return "  ".join([self.names[own], " ".join([*told, *more])]).rstrip()

    def tells(self, name: str) -> bool:
        """Whether a parameter can be known by itself.

        Raises:
            InputError: no such parameter.
        """
        check_known("no parameter", name, self.names)
        return self.reaches(np.eye(len(self.names))[self.names.index(name)])

    def reaches(self, combination: Array) -> bool:
        """Whether a combination of the parameters, shape (p,), is one of the base parameters'."""
        left = combination - combination[self.columns] @ self.B
        return bool(np.abs(left).max(initial=0.0) <= SAID * np.abs(combination).max(initial=0.0))

    def __str__(self) -> str:
        lines = [f"{self.rank} base parameters of {len(self.names)}"]
        lines += [f"  {self.expression(i)}" for i in range(min(self.rank, LISTED))]
        if self.rank > LISTED:
            lines.append(f"  and {self.rank - LISTED} more: .expression(i)")
        return "\n".join(lines)


def base_parameters(robot: CheckedModel, *, columns: Sequence[str] = ("inertia",)) -> BaseParameters:
    """The base parameters of a robot, from its regressor at random states: what its motion and its torques can tell.

    Bodies without mass in the model, which only join others, are left out: they stay without.

    Args:
        robot: The robot.
        columns: As of `rbd.dynamics.regressor`.

    Raises:
        InputError: unknown columns.

    Example:
        >>> base = rbd.motion.identification.base_parameters(rbd.load_robot("solo12"))
        >>> base.rank, base.tells("FL_LOWER_LEG.m"), base.reaches(np.tile(np.eye(10)[0], 13))  # the total mass is told
        (94, False, True)
    """
    check_kind("robot", robot, CheckedModel, "a robot: rbd.load_robot('g1')")
    asked, rng, model = checked_columns(columns), np.random.default_rng(0), robot.model
    names = parameter_names(robot, asked)
    count = 4 + 2 * -(-len(names) // max(1, robot.nv))
    stack = []
    for _ in range(count):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2.0, 2.0, robot.nv))
        v, a = rng.uniform(-2.0, 2.0, (2, robot.nv))
        stack.append(regressor(State(robot, q, v), 10.0 * a, columns=asked).Y)
    Y = np.concatenate(stack)
    if "inertia" in asked:
        Y[:, : 10 * len(body_names(robot))] *= np.repeat(inertial_parameters(robot)[:, 0] != 0.0, 10)
    size = np.abs(Y).max(axis=0)
    moving = size > ROUNDING * float(size.max(initial=0.0))
    Y[:, ~moving] = 0.0
    scaled = Y / np.where(moving, size, 1.0)
    chosen = _independent(scaled)
    K = np.linalg.lstsq(scaled[:, chosen], scaled, rcond=None)[0]
    B = K * np.where(moving, size, 0.0) / size[chosen][:, None]
    B[np.abs(K) < DEPENDENT] = 0.0
    B[:, chosen] = np.eye(len(chosen))
    return BaseParameters(names, chosen, B)


def _independent(Y: Array) -> Array:
    """Indices of the columns that are no combination of those before them: of bodies, the nearest to the root."""
    Q, chosen, k = np.empty((len(Y), min(Y.shape))), [], 0
    for j, y in enumerate(Y.T):
        left = y.copy()
        for _ in range(2):  # once more against rounding
            left -= Q[:, :k] @ (left @ Q[:, :k])
        size = float(np.linalg.norm(left))
        if k < Q.shape[1] and size > DEPENDENT * float(np.linalg.norm(y)) and size > 0.0:
            Q[:, k] = left / size
            chosen.append(j)
            k += 1
    return np.array(chosen, int)
