"""`Trajectories`: the motions of many worlds, as arrays over worlds and samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.motion.reference_motion import Motion
from rbd.worlds.certificates import WorldCertificate, certificate

ENOUGH = 1e-8
"""Scaled residual above which a world is flagged."""
FAST = 0.25
"""Angle by which a body turns in a step [rad] above which a world is flagged: its steps are too long."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories(Displayed):
    """The motions of n worlds at T samples.

    Attributes:
        robot: The robot.
        t: Times, shape (T,) [s].
        q: Configurations, shape (n, T, nq); NaN after a world stopped.
        v: Velocities, shape (n, T, nv) [m/s, rad/s].
        residual: The largest scaled residual of equation of motion and contact law in the steps since the sample before,
            shape (n, T).
        depth: How deep a point was below its surface in these steps, shape (n, T) [m].
        turn: The largest angle by which a body turned in one of these steps, shape (n, T) [rad].
        points: Mean forces on the robot at the points in the last of these steps, world axes, shape (n, T, k, 3) [N].
        stopped: The step before which a world stopped, -1 where it did not, shape (n,).
        rescued: How many of its steps were solved alone, by the method for one world, shape (n,).
        refused: {world: message} of states that are no input.
        contacts: {contact: its points}.
        given: The arguments.
        controller: The function of the torques, or None.
        interrupted: Whether Ctrl-C ended the run before its duration.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> falls = rbd.State(box, [0, 0, 1, 0, 0, 0, 1])
        >>> gravity = [[0, 0, -1.62], [0, 0, -9.81]]  # on the Moon, on Earth
        >>> worlds = rbd.simulate_many(falls, [], duration=0.4, step=1e-2, gravity=gravity, record=10)
        >>> worlds.q[:, -1, 2].round(4), worlds.motion(1).n
        (array([0.8704, 0.2152]), 5)
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    residual: Array
    depth: Array
    turn: Array
    points: Array
    stopped: Array
    rescued: Array
    refused: Mapping[int, str]
    contacts: Mapping[str, slice]
    given: Mapping[str, Any] = field(repr=False)
    controller: Callable[..., Array] | None = field(repr=False)
    interrupted: bool = False

    def __len__(self) -> int:
        return len(self.q)

    @property
    def forces(self) -> dict[str, Array]:
        """{contact: mean force on the robot in the step before each sample, world axes, shape (n, T, 3)} [N]."""
        return {name: self.points[:, :, own].sum(axis=2) for name, own in self.contacts.items()}

    @property
    def flagged(self) -> Array:
        """The worlds that stopped, whose residual is above 1e-8, or with a body that turned by more than 0.25 rad in a step."""
        return np.flatnonzero((self.stopped >= 0) | (self.residual.max(axis=1) > ENOUGH) | (self.turn.max(axis=1) > FAST))

    @property
    def inaccurate(self) -> str:
        """Message: which worlds are flagged; empty if none is."""
        some = self.flagged
        if not len(some):
            return ""
        i = int(some[0])
        step = self.stopped[i]
        turn, residual = self.turn[i].max(), self.residual[i].max()
        fast = f"has a body that turns by {turn:.2g} rad in a step" if turn > FAST else ""
        what = f"stopped before step {step + 1}" if step >= 0 else fast or f"has a residual of {residual:.2g}"
        why = f": {self.refused[i]}" if i in self.refused else ""
        return (
            f"of {len(self)} worlds of {self.robot.name} {len(some)} are not accurate: world {i} {what}{why}. "
            "`trajectories.flagged` has their numbers; rbd.simulate with its state, and a shorter step, may find its motion."
        )

    def state(self, world: int, sample: int = -1) -> State:
        """The state of a world at a sample.

        Raises:
            InputError: no such world or sample, or the world had stopped.
        """
        self._check_number("world", world, len(self))
        self._check_number("sample", sample, len(self.t))
        if not np.isfinite(self.q[world, sample]).all():
            raise InputError(f"world {world} stopped before step {self.stopped[world] + 1}, before sample {sample}.")
        return State(self.robot, self.q[world, sample], self.v[world, sample], t=float(self.t[sample]))

    def motion(self, world: int) -> Motion:
        """The samples of one world, up to where it stopped, as a motion: to look at (`export`), check and follow.

        Raises:
            InputError: no such world, or fewer than three samples.
        """
        self.state(world, 0)
        known = np.isfinite(self.q[world]).all(axis=1)
        if known.sum() < 3:
            raise InputError(f"world {world} has {known.sum()} samples; expected 3 or more: simulate_many(..., record=10).")
        return Motion.of_arrays(self.robot, self.t[known], self.q[world, known], self.v[world, known], source=f"world {world}")

    @staticmethod
    def _check_number(what: str, value: int, n: int) -> None:
        if not isinstance(value, int | np.integer) or not -n <= value < n:
            raise InputError(f"{what} {value!r:.80} of {n}; expected a number from 0 to {n - 1}, or from -{n} to -1.")

    def certify(self, world: int, *, every: int = 1) -> WorldCertificate:
        """The certificate of a world: its steps, taken again, checked by Pinocchio and by the residuals of `rbd.solve`.

        The world is simulated alone with its own arguments, and must meet its samples to the last bit. A controller that is a
        function is asked once more, of all worlds, which are simulated with it. The steps of a world that stopped are checked
        up to there.

        Args:
            world: Its number.
            every: Steps between those that are checked.

        Raises:
            InputError: no such world, one whose state was no input, or other numbers than those of the samples.
        """
        self._check_number("world", world, len(self))
        world %= len(self)
        if world in self.refused:
            raise InputError(f"world {world} has no steps: {self.refused[world]}")
        steps = np.rint(self.t / self.given["step"]).astype(int)
        return certificate(self.given, self.controller, int(world), (steps, self.q[world], self.v[world]), every)

    def __str__(self) -> str:
        worst = float(self.residual.max(initial=0.0))
        lines = [
            f"{len(self)} worlds of {self.robot.name}, {self.t[-1]:g} s, {len(self.t)} samples",
            f"largest scaled residual {worst:.1e}, deepest point {self.depth.max(initial=0.0):.1e} m, "
            f"{int(self.rescued.sum())} steps solved alone",
        ]
        return "\n".join([*lines, *([self.inaccurate] if len(self.flagged) else [])])
