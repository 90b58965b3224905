"""`Mode`: one way in which small motion grows, decays or oscillates; eigenvalues without those of symmetries.

A direction of positions on which nothing depends (the place of a bicycle on its plane, the angle of its wheel) belongs to an
eigenvalue that is zero or, where the axes turn with the motion, imaginary. With the velocities that change with it these
zeros make Jordan blocks, in which an error e of the matrix moves eigenvalues by its root sqrt(e). So the subspace of all x
that never change a velocity (the one that velocities do not observe) is split off first,

    A (S, P) = (S, P) (A_s, A_sp; 0, A_p)

and the modes are those of A_p.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float, largest_first, max_abs, null_space, range_of
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError
from rbd.model.state import State

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_NAMED = 3
"""So many coordinates are named in a mode's title."""
_LEAST = 0.05
"""Smaller shares are not named."""


@dataclass(frozen=True, eq=False, repr=False)
class Mode(Displayed):
    """A mode of small motion: dq(t) = Re(dq exp(lambda t)), of a pair of complex eigenvalues or of one real eigenvalue.

    Attributes:
        eigenvalue: lambda [1/s], of a pair the one with positive imaginary part.
        dq: Its shape: change of the configuration on the tangent space, shape (nv,); its largest entry (in radians, or parts
            of the robot's length, symmetries left out) is 1. Real where all move in phase, else complex.
        dv: Change of v that belongs to it, shape (nv,).
        shares: {coordinate of v: its part of the squared shape}, descending, symmetries left out; of angles in radians and
            lengths over the robot's length.
        of_velocity: Whether the shape changes velocities alone (dq is zero then), and the shares are those of dv.
        motors_move_it: Whether the motors can change it (Popov, Belevitch, Hautus); None without motors.
        uncertainty: How far the eigenvalue may be off: its condition number times the error of A [1/s].
        zero: Real and imaginary parts up to this count as zero [1/s].
        state: The state about which it is a mode.
        spin: As `Linearised.spin`.

    Example:
        >>> pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[2.0], angles="vertical"), masses=[1.0])
        >>> (mode,) = rbd.linearise(pendulum.at([-0.5 * np.pi])).modes()
        >>> print(f"{mode.frequency:.4f} Hz, damping ratio {abs(mode.damping_ratio):.0f}; {mode.words}")
        0.4317 Hz, damping ratio 0; oscillates without damping
    """

    eigenvalue: complex
    dq: Array
    dv: Array
    shares: dict[str, float]
    of_velocity: bool
    motors_move_it: bool | None
    uncertainty: float
    zero: float
    state: State = field(repr=False)
    spin: Array = field(repr=False)

    @property
    def frequency(self) -> float:
        """Oscillations per second, Im(lambda) / (2 pi) [Hz]; zero if it does not oscillate."""
        return 0.0 if abs(self.eigenvalue.imag) <= self.zero else abs(self.eigenvalue.imag) / (2.0 * np.pi)

    @property
    def natural_frequency(self) -> float:
        """|lambda| / (2 pi) [Hz]: of the same mode without damping."""
        return abs(self.eigenvalue) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """-Re(lambda) / |lambda|: 1 of a decay without oscillation, 0 without damping, negative where it grows; NaN of zero."""
        size = abs(self.eigenvalue)
        if size <= self.zero:
            return float("nan")
        return 0.0 if self.neutral else -self.eigenvalue.real / size

    @property
    def time_constant(self) -> float:
        """1 / |Re(lambda)| [s], in which it decays or grows by the factor e; inf if it does neither."""
        return float("inf") if self.neutral else 1.0 / abs(self.eigenvalue.real)

    @property
    def grows(self) -> bool:
        """Whether it grows."""
        return self.eigenvalue.real > self.zero

    @property
    def decays(self) -> bool:
        """Whether it decays."""
        return self.eigenvalue.real < -self.zero

    @property
    def neutral(self) -> bool:
        """Whether it neither grows nor decays: the linear equations do not decide what becomes of it."""
        return not self.grows and not self.decays

    @property
    def words(self) -> str:
        """What it does, in words."""
        if not self.frequency:
            return "grows" if self.grows else "decays" if self.decays else "stays as it is (neighbouring states are steady too)"
        return "oscillates " + ("and grows" if self.grows else "and decays" if self.decays else "without damping")

    @property
    def title(self) -> str:
        """What moves most, e.g. "steer 62 %, roll 31 %"."""
        named = [(name, share) for name, share in self.shares.items() if share >= _LEAST][:_NAMED]
        what = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in named)
        return f"speed: {what}" if self.of_velocity else what

    def at(self, t: float, amplitude: float = 0.1) -> State:
        """The state at a time, of a motion that begins with this amplitude of its largest entry [rad, robot's lengths].

        Of a moving robot the motion without the mode is added. The constraints are satisfied to first order.

        Args:
            t: [s].
            amplitude: At t = 0.

        Raises:
            InputError: numbers that are not finite, or so large that the mode has grown by e^50.
        """
        state, robot = self.state, self.state.robot
        time, size = as_float(t), as_float(amplitude)
        if not (abs(time) < 1e6 and abs(self.eigenvalue.real * time) <= 50.0 and abs(size) <= 1e3):
            raise InputError(
                f"t is {t!r:.80}, amplitude {amplitude!r:.80}; expected numbers, a time within fifty of the time constant "
                f"{self.time_constant:.3g} s, and an amplitude up to 1000."
            )
        factor = size * np.exp(self.eigenvalue * time)
        q = pin.integrate(robot.model, state.q, time * (state.v - self.spin))
        q = pin.integrate(robot.model, q, np.real(factor * self.dq))
        q = pin.integrate(robot.model, q, time * self.spin)
        return State(robot, pin.normalize(robot.model, q), state.v + np.real(factor * self.dv), t=state.t + time)

    def pose(self, factor: complex = 0.1) -> State:
        """The state's configuration changed by Re(factor dq), at rest; the constraints are satisfied to first order.

        Args:
            factor: Amplitude of its largest entry [rad, robot's lengths] times exp(i phase).

        Raises:
            InputError: a factor that is no number up to 1000.
        """
        robot = self.state.robot
        if isinstance(factor, bool) or not isinstance(factor, int | float | complex | np.number) or not abs(factor) <= 1e3:
            raise InputError(f"factor is {factor!r:.80}; expected a real or complex number of at most 1000.")
        q = pin.integrate(robot.model, self.state.q, np.real(complex(factor) * self.dq))
        return State(robot, pin.normalize(robot.model, q), t=self.state.t)

    def scene(self, **options: Any) -> Any:
        """A `rbd.visual.Scene` with its two poses of largest displacement; see `rbd.visual.mode_scene`."""
        return drawing("mode_scene")(self, **options)

    def plot(self, ax: Axes, **options: Any) -> list[Artist]:
        """Bars of its shape on axes; see `rbd.visual.plot_mode`."""
        return drawing("plot_mode")(ax, self, **options)

    def export(self, path: str | os.PathLike[str], **options: Any) -> Path:
        """Write it as an HTML page that plays one period for ever; see `rbd.visual.export_mode`."""
        return drawing("export_mode")(self, path, **options)

    def __str__(self) -> str:
        real = "0" if self.neutral else f"{self.eigenvalue.real:+.6g}"
        parts = [real + (f" +- {abs(self.eigenvalue.imag):.6g} i" if self.frequency else "") + " 1/s", self.words]
        if self.frequency:
            parts.append(f"{self.frequency:.4g} Hz, damping ratio {self.damping_ratio:.3g}")
        if not self.neutral:
            parts.append(f"time constant {self.time_constant:.4g} s")
        if self.motors_move_it is False:
            parts.append("no motor changes it")
        return f"{self.title}: {', '.join(parts)}"


def largest_entry(dq: Array, dv: Array, scale: Array) -> tuple[complex, bool]:
    """(largest entry over its scale of dq, or of dv where dq is zero; whether it is of dv)."""
    sizes, speeds = np.abs(dq) / scale, np.abs(dv) / scale
    of_velocity = max_abs(sizes) <= 1e-7 * max_abs(speeds)
    k = int(speeds.argmax() if of_velocity else sizes.argmax())
    return complex((dv if of_velocity else dq)[k] / scale[k]) or 1.0 + 0.0j, of_velocity


def in_phase(dq: Array, dv: Array, scale: Array) -> tuple[Array, Array]:
    """(dq, dv), each real where it is but for rounding."""
    real = [max_abs(np.abs(part.imag) / scale) <= 1e-9 * max_abs(np.abs(part) / scale) for part in (dq, dv)]
    return dq.real if real[0] else dq, dv.real if real[1] else dv


def shares_of(shape: Array, scale: Array, names: list[str]) -> dict[str, float]:
    """{coordinate: part of the squared shape}, descending."""
    squares = (np.abs(shape) / scale) ** 2
    total = float(squares.sum()) or 1.0
    order = largest_first(squares)
    return {names[i]: float(squares[i]) / total for i in order if squares[i] > 1e-9 * total}


INVARIANT = 1e-7
"""Changes up to this part of the largest count as none."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The eigenvalues and eigenvectors of A, those of symmetries apart.

    Attributes:
        S: Orthonormal basis of the positions on which nothing depends, shape (n, s), in scaled coordinates.
        values: The other eigenvalues, shape (n - s,), by descending real part [1/s].
        right: Eigenvectors x of unit length without their parts along S, columns, shape (n, n - s).
        whole: The same eigenvectors with their parts along S; these parts are zero where they do not exist (Jordan blocks).
        P: Orthonormal basis of what is perpendicular to S, shape (n, n - s).
        reduced: A_p, shape (n - s, n - s).
        condition: |y| |x|, of left and right eigenvectors with y^H x = 1: how much an error of A changes the eigenvalue,
            shape (n - s,).
    """

    S: Array
    values: Array
    right: Array
    whole: Array
    P: Array
    reduced: Array
    condition: Array


def spectrum_of(A: Array, C: Array, known: Array | None = None) -> Spectrum:
    """The spectrum of A, with the symmetries that no velocity C x observes split off.

    Args:
        A: Shape (n, n), in scaled coordinates.
        C: Velocities of x, shape (k, n), in scaled units.
        known: Further symmetries, which may change velocities, as columns, shape (n, j); those with A x = 0 are taken.
    """
    n, size = len(A), float(np.abs(A).max(initial=0.0)) or 1.0
    S = null_space(C / max(1.0, float(np.abs(C).max(initial=0.0))), INVARIANT, unit=True)
    while S.shape[1]:
        AS = A @ S
        out = null_space((AS - S @ (S.T @ AS)) / size, INVARIANT, unit=True)
        if out.shape[1] == S.shape[1]:
            break
        S = np.linalg.qr(S @ out)[0] if out.shape[1] else S[:, :0]
    for x in () if known is None else known.T:
        x = x / max(1e-300, float(np.linalg.norm(x)))
        fresh = x - S @ (S.T @ x)
        if np.linalg.norm(A @ x) <= INVARIANT * size and np.linalg.norm(fresh) > 1e-3:
            S = np.column_stack([S, fresh / np.linalg.norm(fresh)])
    P = np.linalg.svd(S.T)[2][S.shape[1] :].T if S.shape[1] else np.eye(n)
    A_p, A_s, A_sp = P.T @ A @ P, S.T @ A @ S, S.T @ A @ P
    values, vectors = np.linalg.eig(A_p) if len(A_p) else (np.zeros(0, complex), np.zeros((0, 0), complex))
    order = np.lexsort((-values.imag, -np.round(values.real / size, 12)))
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    vectors /= np.linalg.norm(vectors, axis=0)
    # A defective A_p has no inverse of its eigenvectors: the pseudo-inverse's large entries say so by the condition.
    left = np.linalg.pinv(vectors, rcond=1e-15).conj().T if len(values) else vectors
    along = np.zeros((S.shape[1], len(values)), complex)
    for k, value in enumerate(values):
        shifted = value * np.eye(S.shape[1]) - A_s
        if S.shape[1] and np.linalg.svd(shifted, compute_uv=False)[-1] > INVARIANT * size:
            along[:, k] = np.linalg.solve(shifted, A_sp @ vectors[:, k])
    right = P @ vectors
    condition = np.linalg.norm(left, axis=0) * np.linalg.norm(vectors, axis=0)
    return Spectrum(S, values, right, right + S @ along, P, A_p, condition)


def controllable(A: Array, B: Array) -> int:
    """Dimension of the x that inputs reach: of B, A B, A^2 B, ..., orthonormal directions one step at a time."""
    size = float(np.abs(A).max(initial=0.0)) or 1.0
    largest = float(np.linalg.norm(B, axis=0).max(initial=0.0))
    reached = range_of(B / largest, INVARIANT, unit=True) if largest else np.zeros((len(A), 0))
    newest = reached
    while newest.shape[1] and reached.shape[1] < len(A):
        more = A @ newest / size
        more -= reached @ (reached.T @ more)
        more -= reached @ (reached.T @ more)
        newest = range_of(more, INVARIANT, unit=True)
        reached = np.hstack([reached, newest])
    return reached.shape[1]
