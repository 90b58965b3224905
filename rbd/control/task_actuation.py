"""`TaskActuation`: torques and forces of a step of whole-body control, with what tasks missed and a compact certificate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, lazy
from rbd.control.limits import Limits, joints_at_bounds
from rbd.displayed import Displayed
from rbd.problem.answer import Status
from rbd.problem.residuals import SOLVED, USABLE
from rbd.statics.actuation import Actuation

_AT = 1e-6
"""A torque this near to its limit, over the limit, or an acceleration to its bound, over 1 rad/s2, is at it."""


@dataclass(frozen=True)
class StepCertificate(Displayed):
    """How far a step is from its equations, its limits and the least cost: computed in every step, zero for an exact one.

    Attributes:
        balance: |M a + h - tau_ext - J^T f| where there is no motor [N, N m].
        contacts: |J a + J_dot v + k J v|, less the violation that was allowed [m/s2, rad/s2].
        cones: Distance of the points' forces from their circular friction cones [N].
        torques: By how much a torque is beyond its limit [N, N m].
        joints: By how much an acceleration is beyond its bound, less the violation that was allowed [rad/s2, m/s2].
        optimality: How far torques and forces are from those of least cost: gradient, bounds and complementarity of the
            quadratic program by its multipliers, scaled.
        scaled: The same six, in order, over their sizes.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state = solo.standing()
        >>> found = rbd.control.step(state, [rbd.control.PostureTask(state.q)], solo.feet(friction=0.7))
        >>> found.certificate.worst < 1e-9
        True
    """

    balance: float
    contacts: float
    cones: float
    torques: float
    joints: float
    optimality: float
    scaled: tuple[float, ...]

    @property
    def worst(self) -> float:
        """The largest scaled residual; NaN if any is."""
        return math.nan if any(x != x for x in self.scaled) else max(self.scaled)

    @property
    def status(self) -> Status:
        """SOLVED up to 1e-9, INACCURATE up to 1e-7, else FAILED."""
        worst = self.worst
        return Status.SOLVED if worst <= SOLVED else Status.INACCURATE if worst <= USABLE else Status.FAILED

    def __str__(self) -> str:
        return (
            f"balance {self.balance:.1e} N, contacts {self.contacts:.1e} m/s2, cones {self.cones:.1e} N, torques "
            f"{self.torques:.1e} N m, joints {self.joints:.1e} rad/s2, optimality {self.optimality:.1e}"
        )


@dataclass(frozen=True, eq=False)
class Violation(Displayed):
    """By how much contacts and joint limits are violated, where no torques and forces within their limits keep them.

    Attributes:
        contacts: {contact or loop: accelerations of its rows beyond what is wanted, shape (m,) [m/s2, rad/s2]}.
        joints: {joint: by how much its acceleration is beyond the bound [rad/s2, m/s2]}.

    Example:
        >>> import warnings
        >>> box = rbd.testing.box()
        >>> floor = rbd.PointContact("floor", "box", friction=0.5)
        >>> rising = rbd.PointContact("rising", "box", friction=0.5, on=rbd.Ground(acceleration=(0, 0, 1.0)))
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", rbd.errors.RelaxedLimitsWarning)
        ...     found = rbd.control.step(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [floor, rising])
        >>> print(found.violation)
        'floor' accelerates by 0.5 m/s2, 'rising' accelerates by 0.5 m/s2
    """

    contacts: Mapping[str, Array]
    joints: Mapping[str, float]

    @property
    def worst(self) -> float:
        """The largest entry [m/s2, rad/s2]."""
        return max([float(np.abs(x).max()) for x in self.contacts.values()] + [*self.joints.values(), 0.0])

    def __str__(self) -> str:
        told = [f"{name!r:.80} accelerates by {np.abs(x).max():.3g} m/s2" for name, x in self.contacts.items()]
        told += [f"{name!r:.80} is {x:.3g} rad/s2 beyond its limit" for name, x in self.joints.items()]
        return ", ".join(told[:6]) + (f" and {len(told) - 6} more" if len(told) > 6 else "")


@dataclass(frozen=True, eq=False, repr=False)
class TaskActuation(Actuation):
    """Torques and forces of a step of whole-body control: an `rbd.Actuation`, with what tasks missed.

    Its `residuals` are those of every answer, for contacts that keep as still as the step wants them; `certificate`, computed
    in the step, also proves that no other torques and forces have less cost.

    Attributes:
        missed: {task: wanted less reached, shape (m,)}: accelerations, or forces over the mass [m/s2, rad/s2].
        certificate: How far the step is from its equations, its limits, and the least cost.
        violation: By how much contacts and joint limits are violated; None where they are kept.
        limits: Those that were given.
        moving: {contact: speed}: contacts that move faster than `rest_speed` [m/s, rad/s]: they are brought to rest.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> up = rbd.control.ComTask(state.com + [0.0, 0.0, 0.01], gain=100.0)
        >>> found = rbd.control.step(state, [up], feet)
        >>> print(found.status, f"{found.missed['com'][2]:.3f} m/s2 missed of 1")
        solved 0.045 m/s2 missed of 1
    """

    missed: Mapping[str, Array] = field(default_factory=dict)
    certificate: StepCertificate = StepCertificate(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,))
    violation: Violation | None = None
    limits: Limits = Limits()
    moving: Mapping[str, float] = field(default_factory=dict)

    @property
    def status(self) -> Status:
        """What the certificate amounts to."""
        return self.certificate.status

    @lazy
    def at_limit(self) -> dict[str, tuple[str, ...]]:
        """{"torque", "position", "velocity": joints at that limit}, of those that some joint is at."""
        robot, out = self.state.robot, dict[str, tuple[str, ...]]()
        (least, most), slack = self.limits.torque_bounds(self.state), _AT * np.minimum(self.limits.torques(robot), 1e300)
        loaded = (self.tau <= least + slack) | (self.tau >= most - slack)
        if loaded.any():
            out["torque"] = tuple(name for name, is_at in zip(robot.actuated_names, loaded, strict=True) if is_at)
        out.update(joints_at_bounds(self.limits, self.state, self.a, _AT))
        return out

    def __repr__(self) -> str:
        relaxed = "" if self.violation is None else f", violated by {self.violation.worst:.2g}"
        return f"TaskActuation({self.state.robot.name!r}, {self.status}{relaxed}, worst residual {self.certificate.worst:.1e})"

    def _outcome(self) -> str:
        return "held" if self.still else "meets its tasks at least cost"

    def __str__(self) -> str:
        lines = [super().__str__()]
        missed = {name: float(np.abs(off).max()) for name, off in self.missed.items() if off.any()}
        if missed:
            lines.append(f"  missed [m/s2, rad/s2]: {', '.join(f'{name} {most:.3g}' for name, most in missed.items())}")
        lines += [f"  {kind} limits: {', '.join(names)}" for kind, names in self.at_limit.items()]
        lines += [f"  {name} moves at {speed:.3g} m/s, and is brought to rest" for name, speed in self.moving.items()]
        if self.violation is not None:
            lines.append(f"  violated: {self.violation}")
        return "\n".join(lines)
