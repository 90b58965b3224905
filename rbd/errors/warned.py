"""Warnings: there is an answer, and something about it, or about what was given, that its user should know."""

from __future__ import annotations

import sys
from types import FrameType

from rbd.errors.reasons import plain


class RbdWarning(UserWarning):
    """Base of all warnings of `rbd`.

    Example:
        >>> import warnings
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", rbd.errors.RbdWarning)  # all of them, and no other package's
        ...     print(rbd.solve(bars.at("assembled"), [1e6], bars.loops()).status)
        solved
    """

    def __init__(self, *message: object) -> None:
        super().__init__(*plain(message))


class EffortLimitWarning(RbdWarning):
    """A given torque is beyond the limit that the robot's file states.

    Example:
        >>> import warnings
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.EffortLimitWarning)
        ...     rbd.solve(bars.at("assembled"), [1e6], bars.loops())
        Traceback (most recent call last):
            ...
        rbd.errors.EffortLimitWarning: tau of crank_joint is 1e+06, beyond its effort limit of ...
    """


class SpeedLimitWarning(RbdWarning):
    """A joint is faster than the `speed_limit` of its `rbd.Motor`.

    Example:
        >>> import warnings
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> arm = arm.with_motors({"joint_1": rbd.Motor(speed_limit=5.0)})
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.SpeedLimitWarning)
        ...     rbd.inverse_dynamics(arm.at([0.0], [6.0]), [0.0], [])
        Traceback (most recent call last):
            ...
        rbd.errors.SpeedLimitWarning: joint_1 moves at 6 rad/s, faster than the 5 rad/s of its motor.
    """


class JointLimitWarning(RbdWarning):
    """A joint of a state is beyond the limits of the robot's file, or of the `rbd.JointLimit` that is given for it.

    Example:
        >>> import warnings
        >>> talos = rbd.load_robot("talos")
        >>> bent = talos.standing().with_joints({"arm_left_4_joint": -90})
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.JointLimitWarning)
        ...     rbd.hold(bent, talos.soles())
        Traceback (most recent call last):
            ...
        rbd.errors.JointLimitWarning: joints of talos are beyond their limits: 'arm_left_4_joint' is at -90 rad, of ...
    """


class InaccurateWarning(RbdWarning):
    """An answer's residuals are above 1e-9, though at most 1e-7, scaled; or those of a simulation's record are above 1e-7.

    Also of `rbd.identify`, where much of the weight is left unexplained, and of `rbd.simulate` with force elements that are too
    stiff for `RungeKutta4` or `DormandPrince8`, and with steps that make energy.

    Example:
        >>> import warnings
        >>> one, two = (rbd.Rows(name, [[1.0, 0.0]], [c], rbd.problem.Free(1)) for name, c in (("one", 0.0), ("two", 2e-8)))
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     answer = rbd.solve_problem(rbd.GaussProblem(np.eye(2), np.ones(2), [one, two]))
        >>> print(seen[0].category.__name__, answer.status, f"{answer.residuals.feasibility:.0e}")
        InaccurateWarning inaccurate 1e-08
    """


class NonUniqueMotionWarning(RbdWarning):
    """More than one motion satisfies the contact law; the answer is one of them, `Solution.others` has others.

    Example:
        >>> import warnings
        >>> grounds = {"left": rbd.Ground(normal=(1, 0, 0)), "right": rbd.Ground(normal=(-1, 0, 0))}
        >>> walls = [rbd.PointContact(side, "box", friction=1.0, on=ground) for side, ground in grounds.items()]
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     jammed = rbd.solve(rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1]), [], walls)
        >>> print(seen[0].category.__name__, *(f"{each.a[2]:.2f} m/s2" for each in (jammed, *jammed.others)))
        NonUniqueMotionWarning 0.00 m/s2 -9.81 m/s2
    """


class PoorExcitationWarning(RbdWarning):
    """Measured motions tell less of some base parameters than the model does; those stay near the model.

    Example:
        >>> import warnings
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> rest = rbd.Motion.of_arrays(arm, np.arange(5.0), np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 2)))
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     found = rbd.identify(rbd.motion.identification.MeasuredMotion(rest, np.tile([19.62, 4.905], (5, 1))))
        >>> print(seen[0].category.__name__, found.certificate.rank, "of", found.base.rank)
        PoorExcitationWarning 2 of 6
    """


class MovingConstraintWarning(RbdWarning):
    """A bilateral constraint moves, J v is not zero: only its acceleration is prescribed, and it moves on at that velocity.

    Example:
        >>> import warnings
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> turning = arm.at().with_velocity([0.0, 4.0])
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.MovingConstraintWarning)
        ...     rbd.solve(turning, [0.0, 0.0], [rbd.JointLock("elbow", "joint_2")])
        Traceback (most recent call last):
            ...
        rbd.errors.MovingConstraintWarning: bilateral constraints of chain move: 'elbow' at 4 m/s or rad/s. Only ...
    """


class OpeningContactWarning(RbdWarning):
    """A contact, or some of its points, separates: its force is zero. `Solution.opening` names it.

    Example:
        >>> import warnings
        >>> rising = rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1], [0, 0, 0.5, 0, 0, 0])
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     solution = rbd.solve(rising, [], [rbd.PointContact("corner", "box", friction=0.5)])
        >>> print(seen[0].category.__name__, solution.opening, solution.forces["corner"])
        OpeningContactWarning ('corner',) [0. 0. 0.]
    """


class DistantContactWarning(RbdWarning):
    """A contact is more than a millimetre off its plane, or two bodies inside each other; it is solved as if it touched.

    In `simulate` also: a contact that can break has no ground, and stands on the plane through its first pose. Of a robot with
    balls for feet also: a ball's lowest point is more than a millimetre beside the contact point, see `rbd.Robot.feet`.

    Example:
        >>> import warnings
        >>> solo = rbd.load_robot("solo12")
        >>> above = solo.standing().q + 0.02 * np.eye(solo.nq)[2]
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.DistantContactWarning)
        ...     rbd.solve(rbd.State(solo, above), np.zeros(12), solo.feet())
        Traceback (most recent call last):
            ...
        rbd.errors.DistantContactWarning: contacts of solo12 are off the ground that they stand on: 'front_left' 20 mm ...
    """


class LoopNotClosedWarning(RbdWarning):
    """A loop is not closed at the state that was solved; the answer is that of the mechanism with its gap.

    Example:
        >>> import warnings
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.LoopNotClosedWarning)
        ...     rbd.solve(bars.at(), [0.0], bars.loops())  # at neutral all bars are in line
        Traceback (most recent call last):
            ...
        rbd.errors.LoopNotClosedWarning: loop 'coupler_pin' is open by 0.5 (m, or rad) at this state, ...
    """


class ModelWarning(RbdWarning):
    """A robot file loads, but part of its contents is missing or ignored.

    Example:
        >>> import warnings
        >>> rod = '<robot name="rod"><link name="rod"><inertial><mass value="1"/><inertia ixx="1" iyy="0.1" izz="0.1" '
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.ModelWarning)
        ...     rbd.load_robot(text=rod + 'ixy="0" ixz="0" iyz="0"/></inertial></link></robot>')
        Traceback (most recent call last):
            ...
        rbd.errors.ModelWarning: rod: 1 link has an inertia that no body has ('rod'). rbd.doctor(robot) lists everything.
    """


class ForceElementWarning(RbdWarning):
    """A force element has an unusual constant, as a negative stiffness, or a file has its name alone.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.ForceElementWarning)
        ...     rbd.Spring("hand", to=(0, 0, 2), stiffness=-100.0, rest=1.0)
        Traceback (most recent call last):
            ...
        rbd.errors.ForceElementWarning: stiffness of 'spring from hand to the ground at (0, 0, 2)' is -100: ...
    """


class RelaxedLimitsWarning(RbdWarning):
    """A step of whole-body control cannot keep all contacts and joint limits: it violates them by the least.

    Example:
        >>> import warnings
        >>> box = rbd.testing.box()
        >>> floor = rbd.PointContact("floor", "box", friction=0.5)
        >>> rising = rbd.PointContact("rising", "box", friction=0.5, on=rbd.Ground(acceleration=(0, 0, 1.0)))
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     found = rbd.control.step(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [floor, rising])
        >>> print(seen[0].category.__name__, f"{found.violation.worst:.2f} m/s2")
        RelaxedLimitsWarning 0.50 m/s2
    """


class NotSteadyWarning(RbdWarning):
    """A state is linearised that is neither an equilibrium nor a steady motion: the equations hold at this instant alone.

    Example:
        >>> import warnings
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", rbd.errors.NotSteadyWarning)
        ...     rbd.linearise(arm.at([0.0]))
        Traceback (most recent call last):
            ...
        rbd.errors.NotSteadyWarning: ... is linearised about a state that is no equilibrium: it accelerates by up to ...
    """


class StudyWarning(RbdWarning):
    """A study ended early, or goes on with what another version computed: its dataset is usable, and says what is missing.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     warnings.warn("Ctrl-C after 340 of 1,000 samples", rbd.errors.StudyWarning)  # as rbd.study does
        >>> print(seen[0].category.__name__)
        StudyWarning
    """


def stacklevel_of_user() -> int:
    """The `stacklevel` with which a warning of the calling function names the line of the user's own code.

    For what is called at a depth that varies, as a controller is by integrators: the first caller outside this package.
    """
    frame: FrameType | None = sys._getframe(1)
    level = 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "rbd":
        frame, level = frame.f_back, level + 1
    return level
