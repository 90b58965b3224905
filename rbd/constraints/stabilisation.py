"""Baumgarte's stabilisation: constraints that pull back what has drifted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, as_float, zeros
from rbd.constraints.constraint import Constraint, frames_of, made
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone, LineCone, NonNegative, Product, WrenchCone
from rbd.problem.rows import Rows


@dataclass(frozen=True)
class Baumgarte:
    """Feedback that makes the error of a constraint die out like a damped oscillator [Baumgarte1972].

        feedback = 2 zeta w velocity + w^2 error,      so that      error'' + 2 zeta w error' + w^2 error = 0

    on bilateral rows. It is no physics: `solution.accelerations` leave it out, and `solution.feedback_acceleration` is
    what it does to the motion. A step of simulation must be short against 1 / w.

    Rows without an `error` (a contact without an anchor) get the velocity part alone, which stops their drift and does not
    undo it; `Stabilised.acts_on` says which. Bilateral rows that give no velocity get J v.

    Rows that push (limits, normals of contacts that can break) are pushed out of what they have entered, and no more:
    feedback = min(0, 2 zeta w velocity + w^2 error) where error <= 0, or where there is none (there w^2 error is left out);
    zero where error > 0. So no gap is closed and nothing that leaves is held back. Of a patch or a line that can break,
    the normal of its centre gets what all its corners agree on. Friction gets none: its directions have no place to be.

    Attributes:
        frequency: Natural frequency w [rad/s].
        damping_ratio: zeta; 1 is critical: the fastest without overshoot.

    Raises:
        InputError: a frequency that is not positive, a damping ratio that is negative, anything not finite.

    >>> held = rbd.constraints.Baumgarte(20.0).of(rbd.JointLock("brake", "arm_left_4_joint", position=-1.5))
    """

    frequency: float
    damping_ratio: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < as_float(self.frequency) < 1e50:
            raise InputError(f"frequency of Baumgarte is {self.frequency!r:.80}; expected a number > 0 [rad/s].")
        if not 0.0 <= as_float(self.damping_ratio) < 1e50:
            raise InputError(f"damping_ratio of Baumgarte is {self.damping_ratio!r:.80}; expected a number >= 0 (1: critical).")

    def of(self, constraint: Constraint) -> Stabilised:
        """The constraint under its own name, its rows with this feedback (in place of any that they had).

        Raises:
            InputError: what is given is no constraint.
        """
        return Stabilised(constraint, self)

    def feedback(self, rows: Rows, velocity: Array | None = None) -> Array:
        """2 zeta w velocity + w^2 error, as far as it does no harm, shape (m,) [m/s2, rad/s2].

        Args:
            rows: Of any constraint.
            velocity: In place of the rows' own, shape (m,).
        """
        u = 2.0 * float(self.damping_ratio) * float(self.frequency) * (rows.velocity if velocity is None else velocity)
        e = None if rows.error is None else float(self.frequency) ** 2 * rows.error
        return _harmless(rows.cone, u, e)


@dataclass(frozen=True, eq=False)
class Stabilised:
    """A constraint whose rows carry `feedback`; made by `Baumgarte.of`.

    Attributes:
        constraint: The constraint itself.
        by: What computes the feedback.
    """

    constraint: Constraint
    by: Baumgarte

    def __post_init__(self) -> None:
        made(self.constraint)

    @property
    def name(self) -> str:
        """The constraint's own name."""
        return self.constraint.name

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that the constraint joins."""
        return frames_of(self.constraint)

    def rows(self, state: State) -> Rows:
        """The constraint's rows, with feedback."""
        rows = self.constraint.rows(state)
        if not isinstance(rows, Rows):
            raise InputError(f"constraint {self.name!r:.80} gave a {type(rows).__name__} in place of rbd.Rows.")
        if not len(rows):
            return rows
        silent = rows.velocity is zeros(len(rows)) and rows.J.shape[1] == len(state.v)
        return replace(rows, feedback=self.by.feedback(rows, rows.J @ state.v if silent else None))

    def acts_on(self, state: State) -> str:
        """What is fed back at this state, in words: "position and velocity", "velocity alone: ..." or "nothing: ..."."""
        rows = self.constraint.rows(state)
        if not len(rows):
            return f"nothing: {self.name!r:.80} has no rows at this state"
        if not _heard(rows.cone):
            return f"nothing: {self.name!r:.80} has forces in a {type(rows.cone).__name__}, which has no place to go back to"
        if rows.error is None or (rows.holonomic is not None and not rows.holonomic.any()):
            return f"velocity alone: the rows of {self.name!r:.80} give no error, so what has drifted stays"
        return "position and velocity"


def _heard(cone: Cone) -> bool:
    if isinstance(cone, Product):
        return any(_heard(part) for part in cone.cones)
    return isinstance(cone, Free | NonNegative | FrictionCone | WrenchCone | LineCone)


def _harmless(cone: Cone, u: Array, e: Array | None) -> Array:
    """Velocity part u and position part e (None: there is none) of the feedback, as much of both as a set can take."""
    if isinstance(cone, Product):
        ends = np.cumsum([part.dim for part in cone.cones])[:-1]
        errors = [None] * len(cone.cones) if e is None else np.split(e, ends)
        parts = zip(cone.cones, np.split(u, ends), errors, strict=True)
        return np.concatenate([_harmless(part, u_i, e_i) for part, u_i, e_i in parts])
    out = np.zeros(cone.dim)
    if isinstance(cone, Free):
        return u.copy() if e is None else u + e
    if isinstance(cone, NonNegative):
        return _pushed_out(u, e)
    if isinstance(cone, FrictionCone):
        out[2] = _pushed_out(u[2:], None if e is None else e[2:])[0]
    elif isinstance(cone, WrenchCone | LineCone):
        normals = cone.corner_map[:, 2::3]  # their transpose takes rows to the corners' normals
        out[2] = _pushed_out(normals.T @ u, None if e is None else normals.T @ e).max()
    return out


def _pushed_out(u: Array, e: Array | None) -> Array:
    """Never above zero, and zero where there is still a gap."""
    return np.minimum(0.0, u) if e is None else np.where(e <= 0.0, np.minimum(0.0, u + e), 0.0)
