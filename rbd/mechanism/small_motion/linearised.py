"""`Linearised`: the linear equations of small motion, their eigenvalues and modes, and their certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, lazy
from rbd.displayed import Displayed, drawing
from rbd.errors import Unsupported
from rbd.mechanism.small_motion.modes import (
    INVARIANT,
    Mode,
    Spectrum,
    controllable,
    in_phase,
    largest_entry,
    shares_of,
    spectrum_of,
)
from rbd.mechanism.small_motion.tangent_space import TangentSpace, ad_matrix, spin_axes
from rbd.model.state import State
from rbd.records import counted

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

STEADY = 1e-6
"""Largest acceleration [m/s2, rad/s2] of a motion that counts as steady, and largest relative change of A along it."""
_SHOWN = 12


@dataclass(frozen=True, eq=False, repr=False)
class Linearised(Displayed):
    """The linear equations x' = A x + B dtau of small motion about a state, x = (x_q, x_v) on the constraint manifold.

    A change of the state is dq = T_q x_q on the tangent space, as pin.integrate takes it, and dv = G x_q + T_v x_v.

    Attributes:
        state: The equilibrium, or the steady motion at one instant.
        tau: Its torques, shape (nu,).
        A: Shape (n, n) [1/s, with the units of x].
        B: By motor torques, shape (n, nu).
        space: The changes that the constraints allow: which entries of dq and dv are coordinates, T_q, G, T_v, and ranks.
        spin: eta, the part of v with which bodies of revolution turn about their own axes, seen from axes that do not, shape
            (nv,); zero of other robots. dq and dv are in those axes (`rbd.mechanism.small_motion.tangent_space`).
        modes_of_contacts: {constraint: mode of each part}, "holds", "sticks" or "presses".
        method: "derivatives", or "differences" with the reason.
        acceleration: Largest |a| of the state [m/s2, rad/s2]: zero at an equilibrium and on a steady motion.
        variation: As `difference`, a little ahead on the motion; zero of a steady motion.
        invariance: How far A leaves the allowed changes, relative: zero but for rounding.
        difference: Largest relative difference of A x + B dtau from slopes of the true motion (by `rbd.solve`, on the
            constraints), in random directions.

    Example:
        >>> sleigh = rbd.load_robot("chaplygin_sleigh")
        >>> for speed in (2.0, -2.0):
        ...     print(rbd.linearise(sleigh.at(None, [speed, 0.0, 0.0])).verdict.partition(";")[0])
        Stable: all modes decay but the neutral ones
        Unstable: 1 mode grows, the fastest by e in 0.283 s
    """

    state: State
    tau: Array
    A: Array
    B: Array
    space: TangentSpace
    spin: Array
    modes_of_contacts: dict[str, tuple[str, ...]]
    method: str
    acceleration: float
    variation: float
    invariance: float
    difference: float

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the entries of x_q: those of dq that are its coordinates."""
        return tuple(self.state.robot.joints.velocities[i].name for i in self.space.positions)

    @property
    def velocities(self) -> tuple[str, ...]:
        """Names of the entries of x_v."""
        return tuple(self.state.robot.joints.velocities[i].name for i in self.space.velocities)

    @lazy
    def _scale(self) -> Array:
        scale = self.state.robot.joints.scale
        return np.concatenate([scale[self.space.positions], scale[self.space.velocities]])

    @property
    def n(self) -> int:
        """Number of coordinates, n_q + n_v."""
        return len(self.A)

    @lazy
    def _spectrum(self) -> Spectrum:
        scale, nv = self._scale, self.state.robot.nv
        A = self.A * scale / scale[:, None]
        C = (self.space.basis[nv:] * scale) / self.state.robot.joints.scale[:, None]
        return spectrum_of(A, C, self._turned() / scale[:, None])

    def _turned(self) -> Array:
        """Turns of spinning bodies of revolution about their axes, with the velocity in axes that turn along, shape (n, j)."""
        robot, nv = self.state.robot, self.state.robot.nv
        axes = spin_axes(robot) if self.spin.any() else np.zeros((nv, 0))
        return np.vstack([axes, ad_matrix(robot, self.state.v) @ axes])[self.space.picked]

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of A by descending real part, shape (n - s,) [1/s], without the s of symmetries, which are neutral."""
        return self._spectrum.values.copy()

    @property
    def symmetries(self) -> Array:
        """Directions dq on which nothing depends, as columns, shape (nv, s): a place on the ground, the angle of a wheel."""
        T_q = self.space.T_q
        return T_q @ (self._scale[:, None] * self._spectrum.S)[: T_q.shape[1]]

    @lazy
    def zero(self) -> float:
        """Parts of eigenvalues up to this count as zero [1/s]: 1e-7 of the largest."""
        return INVARIANT * float(np.abs(self._spectrum.values).max(initial=0.0))

    @lazy
    def controllable(self) -> int:
        """Dimension of the x that the motors reach, of `n`."""
        scale = self._scale
        return controllable(self.A * scale / scale[:, None], self.B / scale[:, None])

    @property
    def steady(self) -> bool:
        """Whether the state is an equilibrium or a steady motion, to 1e-6: else A holds at this instant alone."""
        return self.acceleration <= STEADY and self.variation <= STEADY

    def modes(self) -> tuple[Mode, ...]:
        """The modes, one for a pair of complex eigenvalues, by descending real part; symmetries have none.

        Raises:
            Unsupported: the state is not steady, so that eigenvalues say nothing about its small motion.
        """
        if not self.steady:
            raise Unsupported(f"{self._unsteady} rbd.find_equilibrium and rbd.find_steady_motion find states that have modes.")
        return self._modes

    @property
    def _unsteady(self) -> str:
        """What is said of a state that is not steady."""
        moves = f"it accelerates by up to {self.acceleration:.3g} (m/s2 or rad/s2)"
        if self.acceleration <= STEADY:
            moves = f"its equations change by {self.variation:.2g}, relative, a little ahead"
        return f"Not a steady state: {moves}. A and B hold at this instant alone, and eigenvalues decide nothing."

    @lazy
    def _modes(self) -> tuple[Mode, ...]:
        found, robot, nv = self._spectrum, self.state.robot, self.state.robot.nv
        scale, names = robot.joints.scale, [c.name for c in robot.joints.velocities]
        size = float(np.abs(found.values).max(initial=0.0))
        error = max(self.invariance, self.difference) * max(1.0, float(np.abs(self.A).max(initial=0.0)))
        out = []
        for k in np.flatnonzero(found.values.imag >= -INVARIANT * size):  # of a pair one
            value, zero = found.values[k], max(self.zero, found.condition[k] * error)
            inner = self.space.basis @ (self._scale * found.right[:, k])
            outer = self.space.basis @ (self._scale * found.whole[:, k])
            largest, of_velocity = largest_entry(inner[:nv], inner[nv:], scale)
            whole = (inner if of_velocity else outer) / largest
            dq, dv = in_phase(0.0 * whole[:nv] if of_velocity else whole[:nv], whole[nv:], scale)
            shares = shares_of(inner[nv:] if of_velocity else inner[:nv], scale, names)
            moved = self._moved(value) if len(self.tau) else None
            out.append(
                Mode(
                    complex(value), dq, dv, shares, of_velocity, moved, found.condition[k] * error, zero, self.state, self.spin
                )
            )
        return tuple(out)

    def _moved(self, value: complex) -> bool:
        """Whether (A_p - value, B_p) has full rank, symmetries left out."""
        found, B = self._spectrum, self._spectrum.P.T @ (self.B / self._scale[:, None])
        largest = float(np.abs(B).max(initial=0.0)) or 1.0
        size = float(np.abs(found.reduced).max(initial=0.0)) or 1.0
        both = np.hstack([(found.reduced - value * np.eye(len(B))) / size, B / largest])
        return bool(np.linalg.svd(both, compute_uv=False)[-1] > INVARIANT)

    @property
    def stable(self) -> bool | None:
        """False if a mode grows, True if all others than neutral zeros decay, None where modes oscillate without damping.

        Raises:
            Unsupported: the state is not steady.
        """
        modes = self.modes()
        if any(mode.grows for mode in modes):
            return False
        return None if any(mode.neutral and mode.frequency for mode in modes) else True

    @property
    def verdict(self) -> str:
        """Stable or not, in words; of a state that is not steady, this."""
        if not self.steady:
            return self._unsteady
        modes, s = self._modes, self._spectrum.S.shape[1]
        growing = [mode for mode in modes if mode.grows]
        still = [mode for mode in modes if mode.neutral and not mode.frequency]
        if growing:
            fastest = min(mode.time_constant for mode in growing)
            what = f"Unstable: {counted(len(growing), 'mode grows', 'modes grow')}, the fastest by e in {fastest:.3g} s"
        elif self.stable is None:
            free = sum(mode.neutral and mode.frequency > 0.0 for mode in modes)
            what = (
                f"Stable to first order: {counted(free, 'mode oscillates', 'modes oscillate')} without damping, and none grows"
            )
        elif all(mode.neutral for mode in modes):
            what = (
                "Neutral: no mode grows or decays" if modes else "No mode: nothing can move, or nothing depends on how it does"
            )
        else:
            what = "Stable: all modes decay" + (" but the neutral ones" if still else "")
        rest = [f"{counted(len(still), 'eigenvalue is', 'eigenvalues are')} zero, of neighbouring steady states"] * bool(still)
        rest += [f"nothing depends on {counted(s, 'direction', 'directions')} of position"] * bool(s)
        return "; ".join([what, *rest]) + "."

    def changed(self, x: Sequence[float] | Array) -> State:
        """The state that differs from `state` by x: q (+) T_q x_q, v + G x_q + T_v x_v; on the constraints to first order.

        Args:
            x: Shape (n,).

        Raises:
            InputError: wrong size, not finite.
        """
        given = as_finite("x", x, (self.n,), meaning=f": {', '.join(self.positions)}, then velocities")
        robot, change = self.state.robot, self.space.basis @ given
        q = pin.integrate(robot.model, self.state.q, change[: robot.nv])
        return State(robot, pin.normalize(robot.model, q), self.state.v + change[robot.nv :], t=self.state.t)

    def plot(self, ax: Axes) -> list[Artist]:
        """Its eigenvalues in the complex plane, on axes; see `rbd.visual.plot_eigenvalues`."""
        return drawing("plot_eigenvalues")(ax, self)

    def __str__(self) -> str:
        moving = "a steady motion" if self.state.v.any() else "an equilibrium"
        moving = moving if self.steady else "a state that is not steady"
        lines = [
            self.verdict,
            f"{self.state.robot.name} about {moving}: {counted(len(self.positions), 'coordinate', 'coordinates')} of position, "
            f"{len(self.velocities)} of velocity; {counted(self.space.m, 'row', 'rows')} of constraints of rank "
            f"{self.space.rank_v}, {self.space.rank_q} of them of position",
        ]
        modes = self._modes if self.steady else ()
        lines += [f"  {mode}" for mode in modes[:_SHOWN]]
        if len(modes) > _SHOWN:
            lines.append(f"  and {len(modes) - _SHOWN} more modes, of smaller real parts")
        if len(self.tau):
            lines.append(
                f"{counted(len(self.tau), 'motor reaches', 'motors reach')} {self.controllable} of {self.n} dimensions"
            )
        lines.append(
            f"largest acceleration of the state {self.acceleration:.1e}, change along the motion {self.variation:.1e}; "
            f"A by {self.method.partition(':')[0]}: off the constraints by {self.invariance:.1e}, from differences of the "
            f"true motion by {self.difference:.1e} (relative)"
        )
        return "\n".join(lines)
