"""Driven joints: a motor, a crank or a shaker that makes a joint follow a function of time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array
from rbd.constraints.surface import check_state, check_words
from rbd.displayed import Displayed
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Free
from rbd.problem.motions import Motion, Prescribed
from rbd.problem.rows import Rows


@dataclass(frozen=True, eq=False)
class DrivenJoint(Displayed):
    """A joint that follows a function of time, q = s(t): a crank at a given speed, a shaker, a cam.

    One bilateral row at the time t of the state, `State.t`::

        error = q - s(t)        velocity = q' - s'(t)        y = q'' - s''(t)

    s' must not jump: that is an impact, and is refused with its time; s'' may. The angle of a continuous joint is known up to
    turns. The drive is ideal: its force has no bound.

    Its force is the torque [N m], or force [N], that the drive adds to the joint's motor: tau + f drives the joint. Where no
    torque is given, as in `rbd.simulate` without a controller, f is all of it. `rbd.hold` and `rbd.inverse_dynamics` leave the
    whole torque to the drive where that is least effort: the motor of a driven joint then gives none.

    Attributes:
        name: The constraint's role, e.g. "motor".
        joint: A joint with one degree of freedom.
        motion: A function t -> (s, s', s''); a function t -> s, whose derivatives are taken by differences, to 1e-10 and 1e-9;
            a spline of SciPy's; or `rbd.Speed(rate, start=)`. s in [rad] or [m].

    Raises:
        InputError: no motion, or a spline that is not twice differentiable.

    Example:
        >>> engine = rbd.mechanism.slider_crank(0.045, 0.15)
        >>> drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(30.0, start=np.pi / 4))
        >>> start = rbd.mechanism.project_velocity(engine.at("assembled"), [drive])
        >>> turns = rbd.simulate(start, [drive], duration=0.05, step=1e-3)
        >>> print(turns.forces["drive"][::25].ravel().round(4))  # the torque, after 0, 0.75 and 1.5 rad
        [ 0.1876 -0.0582 -0.1422]
    """

    name: str
    joint: str
    motion: Motion
    _at: Prescribed = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        object.__setattr__(self, "_at", Prescribed(f"motion of {self.name!r:.80}", self.motion))

    def rows(self, state: State) -> Rows:
        """One bilateral row; see the class.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom; a motion that is not finite, or has no derivative here.
        """
        check_state(state, self.name)
        joint = state.robot.joints.with_one_freedom(self.joint, self.name)
        s, rate, acceleration = self.motion_at(state.t).tolist()
        J = np.zeros((1, state.robot.nv))
        J[0, joint.v] = 1.0
        missed = joint.coordinate(state.q) - s
        missed = math.remainder(missed, 2.0 * math.pi) if joint.is_continuous else missed
        velocity, error = J @ state.v - rate, np.array([missed])
        return Rows(self.name, J, np.array([-acceleration]), Free(1), velocity, error, period=joint.period)

    def motion_at(self, t: float) -> Array:
        """(s, s', s'') at a time [s], shape (3,)."""
        return self._at.at(t)

    @property
    def prescribes(self) -> str:
        """The joint whose motion it gives."""
        return self.joint

    def jump(self, since: float, t: float) -> float | None:
        """A time in an interval at which the joint's position or velocity would jump [s]; None if there is none."""
        return self._at.jump(since, t)

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot without the joint, or on which it has several degrees of freedom.

        Raises:
            JointNotFound: with the nearest names.
            InputError: a joint with several degrees of freedom.
        """
        robot.joints.with_one_freedom(self.joint, self.name)
