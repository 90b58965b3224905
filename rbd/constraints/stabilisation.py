"""Baumgarte's stabilisation: feedback that corrects constraint drift."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rbd.arrays import Array, check_number, check_positive, zeros
from rbd.constraints.constraint import Constraint, frames_of, made
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.dynamics import constraint_hessian
from rbd.model.state import State
from rbd.problem.rows import Rows


@dataclass(frozen=True)
class Baumgarte(Displayed):
    """Feedback that makes the error of a constraint decay like a damped oscillator [Baumgarte1972].

    It is added to y = J a + J_dot v::

        feedback = 2 zeta w velocity + w^2 error,      so that      error'' + 2 zeta w error' + w^2 error = 0

    on bilateral rows. It is no physics: `solution.accelerations` leave it out, and `solution.feedback_acceleration` is
    its effect on the motion. A simulation's time step must be short against 1 / w.

    Rows without an `error` (a contact without an anchor) get only the velocity part, which stops their drift and does not
    undo it; see `Stabilised.acts_on`. For bilateral rows without a velocity J v is used.

    Unilateral rows (limits, normals of contacts that can break) are only pushed out of penetration:
    feedback = min(0, 2 zeta w velocity + w^2 error) where error <= 0, or where there is none (there w^2 error is left out);
    zero where error > 0. So no gap is closed and no separation is slowed. For a patch or a line that can break,
    the normal of its centre gets the feedback common to all corners. Friction gets none: tangents have no position error.

    Attributes:
        frequency: Natural frequency w [rad/s].
        damping_ratio: zeta; 1 is critical: the fastest without overshoot.

    Raises:
        InputError: a frequency that is not positive, a damping ratio that is negative, numbers that are not finite.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> brake = rbd.JointLock("brake", "joint_1", position=0.0)
        >>> pulled = rbd.constraints.Baumgarte(20.0).of(brake)
        >>> for lock in (brake, pulled):  # 0.01 rad off: left there, or brought back with 20^2 * 0.01 rad/s2
        ...     print(f"{rbd.solve(arm.at([0.01, 0.5]), [0.0, 0.0], [lock]).a[0]:.3f}")
        0.000
        -4.000
    """

    frequency: float
    damping_ratio: float = 1.0

    def __post_init__(self) -> None:
        check_positive("frequency of Baumgarte", self.frequency, 1e50, "rad/s")
        check_number("damping_ratio of Baumgarte", self.damping_ratio, 0.0, 1e50, expected="a number >= 0 (1: critical)")

    def of(self, constraint: Constraint) -> Stabilised:
        """The constraint with the same name, its rows with this feedback in place of any other.

        Raises:
            InputError: if it is not a constraint.
        """
        return Stabilised(constraint, self)

    def feedback(self, rows: Rows, velocity: Array | None = None) -> Array:
        """2 zeta w velocity + w^2 error, limited on unilateral rows, shape (m,) [m/s2, rad/s2].

        Args:
            rows: Rows of any constraint.
            velocity: Velocity in place of the rows', shape (m,).
        """
        u = 2.0 * float(self.damping_ratio) * float(self.frequency) * (rows.velocity if velocity is None else velocity)
        e = None if rows.error is None else float(self.frequency) ** 2 * rows.error
        return rows.cone.feedback(u, e)


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
        """The constraint's name."""
        return self.constraint.name

    @property
    def frames(self) -> tuple[str, ...]:
        """The constraint's frames."""
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

    def hessian(self, state: State) -> Array:
        """The constraint's, of whose bias feedback is no part: see `rbd.dynamics.constraint_hessian`."""
        return constraint_hessian(state, self.constraint)

    def acts_on(self, state: State) -> str:
        """Message: what is fed back at this state, "position and velocity", "velocity alone: ..." or "nothing: ..."."""
        rows = self.constraint.rows(state)
        if not len(rows):
            return f"nothing: {self.name!r:.80} has no rows at this state"
        if not rows.cone.keeps_position:
            return f"nothing: {self.name!r:.80} has forces in a {type(rows.cone).__name__}, which has no position to return to"
        if rows.error is None or (rows.holonomic is not None and not rows.holonomic.any()):
            return f"velocity alone: the rows of {self.name!r:.80} give no error, so position drift remains"
        return "position and velocity"
