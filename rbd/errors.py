"""Every error and warning of `rbd`, in one tree.

::

    RbdError
      InputError (also a ValueError)    an argument is wrong; nothing was computed
        UnknownName                     a name that is not in the model; nearest names in the message
          UnknownRobot, FrameNotFound, JointNotFound
        DuplicateName                   two constraints, or two rows, under one name
      ModelError                        a robot file is missing, broken or not a robot
      ContactMoves                      a contact that can break or slip already moves
      NotAtRest                         statics of a moving robot
      Unsupported                       this solver cannot take this problem; the message gives the reason
      NotDifferentiable                 an answer at a change of contact mode has no derivatives
      SingularInertia                   M(q) is not positive definite
      NoSolution                        no answer within tolerance; carries problem and result
        CannotMove                      no motor torques and contact forces move the robot as wanted; names the limits
          CannotHold                    none hold it still
        CannotAssemble                  loops that do not close, or not from here; names the rows and the distance
        CannotReach                     no pose satisfies the targets, or none was found; with the nearest pose
        SingularPose                    here the known motions do not decide the others
        SimulationStopped               a step of a simulation has no solution, or a function of the user raised an error;
                                        carries what was computed till then
      PictureError                      a page or a screenshot could not be made
      WrongPinocchio (an ImportError)   another package, or ROS's, is found in place of pip's Pinocchio
      ContractBroken                    in rbd.testing: a constraint or a solver violates its contract
        ConstraintWrong, SolverWrong

    RbdWarning (a UserWarning)
      EffortLimitWarning                a torque given is beyond a motor's limit
      InaccurateWarning                 the answer is worse than 1e-9, though better than 1e-7; or a simulation recorded a
                                        residual above 1e-7
      LoopNotClosedWarning              a loop is not closed at this state, and is solved unchanged
      ModelWarning                      a robot file that loads, but is not what it seems
      NonUniqueMotionWarning            more than one motion satisfies the contact law; the answer is one of them
      OpeningContactWarning             a contact separates, and its force is zero
      DistantContactWarning             a contact is not on its plane
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np


class RbdError(Exception):
    """The root of all errors that `rbd` raises on purpose.

    Example:
        >>> for name in ("solo12", "solo13"):
        ...     try:
        ...         print(rbd.load_robot(name))
        ...     except rbd.RbdError as error:
        ...         print(type(error).__name__, error)
        Robot('solo12', nq=19, nv=18, nu=12, mass=2.500 kg)
        UnknownRobot no robot 'solo13'; nearest: 'solo12', 'solo', 'solo8', 'so101'. rbd.robots.catalogue.names() has them all.
    """


class InputError(RbdError, ValueError):
    """An argument is wrong: the message gives the value, what was expected, what to try.

    Example:
        >>> rbd.load_robot("solo12").standing().frame("FL_FOTT")
        Traceback (most recent call last):
            ...
        rbd.errors.FrameNotFound: no frame 'FL_FOTT' in solo12; nearest: 'FL_FOOT', ...
    """


class UnknownName(InputError):
    """A name is not in the model; the message has the nearest names."""


class UnknownRobot(UnknownName):
    """No robot or file has this name."""


class FrameNotFound(UnknownName):
    """No frame of the robot has this name."""


class JointNotFound(UnknownName):
    """No joint of the robot has this name."""


class DuplicateName(InputError):
    """Two constraints share one name, so their forces could not be distinguished."""


class ModelError(RbdError):
    """A robot file is missing, broken, or not a robot."""


class ContactMoves(RbdError):
    """A contact that can break or slip has a velocity that the law does not cover: an impact, or sliding."""


class NotAtRest(RbdError):
    """Statics was requested for a moving robot."""


class Unsupported(RbdError):
    """The solver cannot take the problem; raised before it starts."""


class NotDifferentiable(RbdError):
    """The answer has no derivatives: on one side of it a contact sticks, on the other it slips or opens."""


class SingularInertia(RbdError):
    """The joint-space inertia matrix is not positive definite."""


class NoSolution(RbdError):
    """There is no answer within tolerance, or none was found; the message names the worst row or the contradiction.

    Attributes:
        problem: The `GaussProblem` that was to be solved, or None where no contact problem was posed.
        result: The best `Solution` that was found, residuals and all, or None.
        contradiction: The `Contradiction`: constraints that contradict each other, with the proof; or None.

    Example:
        >>> box = rbd.testing.box()
        >>> floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2))
        >>> lift = rbd.SurfaceContact("lift", "box", half_lengths=(0.2, 0.2), on=rbd.Ground(acceleration=(0, 0, 1.0)))
        >>> try:
        ...     rbd.solve(rbd.State(box, [0, 0, 0.1, 0, 0, 0, 1]), [], [floor, lift])
        ... except rbd.NoSolution as error:
        ...     print(f"the nearest motion: {error.nearest().a[2]:.2f} m/s2 up")
        the nearest motion: 0.50 m/s2 up
    """

    def __init__(
        self,
        message: str,
        *,
        problem: Any = None,
        result: Any = None,
        contradiction: Any = None,
        nearest: Callable[..., Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.problem = problem
        self.result = result
        self.contradiction = contradiction
        self._nearest = nearest

    def nearest(self, *, weights: Mapping[str, float | np.ndarray] | None = None) -> Any:
        """The `NearestMotion` that violates the constraints least, by the same solver; see `rbd.solution.nearest_motion`.

        Args:
            weights: {constraint: weight of its rows}; 1 if not given.

        Raises:
            InputError: where no contact problem was posed, or on weights that are none.
            NoSolution: where it was not found within tolerance.
        """
        if self._nearest is None:
            raise InputError("there is no nearest motion: this error comes from no least-constraint problem.")
        return self._nearest(weights=weights)


class SimulationStopped(NoSolution):
    """A step of a simulation has no solution, or a function of the user raised an error in it, which is `__cause__`.

    Attributes:
        state: The last `State` that was reached, or None.
        t: Its time [s].
        names: The constraints that were active.
        trajectory: The `Trajectory` that was computed until then; None if not even the first sample was.
    """

    def __init__(
        self,
        message: str,
        *,
        state: Any = None,
        t: float = 0.0,
        names: tuple[str, ...] = (),
        trajectory: Any = None,
        cause: Exception | None = None,
    ) -> None:
        super().__init__(message)
        if isinstance(cause, NoSolution):
            self.problem, self.result, self.contradiction = cause.problem, cause.result, cause.contradiction
            self._nearest = cause._nearest
        self.state, self.t, self.names, self.trajectory = state, t, names, trajectory


class CannotMove(NoSolution):
    """No motor torques within their limits, with forces that the motion allows, move the robot as wanted.

    Attributes:
        limits: An irreducible set of `rbd.statics.limits.Limit`: all of them together cannot be kept, and any of them left out
            lets the rest be kept. Empty where the proof was not found.
        irreducible: Whether that is so; False where there were too many to leave each of them out in turn, or there are none.
        certificate: The `Certificate` that they cannot: multipliers of the equations of motion and of the limits; or None.
        missing: `Missing`: the least wrench on the base (and torques at passive joints) that would let contact forces
            balance the motion, torque limits aside; or None.
        excess: How far each torque is beyond its limit, over the limit, least in sum, where forces balance, shape (nu,); else
            None.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> a = rbd.mechanism.project_acceleration(state, 36.0 * np.eye(solo.nv)[0], feet).a  # far too fast forward
        >>> try:
        ...     rbd.inverse_dynamics(state, a, feet)
        ... except rbd.CannotMove as error:
        ...     print(sorted({limit.kind for limit in error.limits}), error.missing.force.round(2))
        ['base', 'push'] [ 46.25  0.   -30.75]
    """

    def __init__(
        self,
        message: str,
        *,
        limits: tuple[Any, ...] = (),
        irreducible: bool = False,
        certificate: Any = None,
        missing: Any = None,
        excess: np.ndarray | None = None,
        nearest: Callable[[], Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.limits, self.irreducible, self.certificate = limits, irreducible, certificate
        self.missing, self.excess = missing, excess
        self._nearest_possible = nearest

    def nearest(self, *, weights: Mapping[str, float | np.ndarray] | None = None) -> Any:
        """The `Actuation` of the reachable acceleration that is nearest in the inertia metric, each contact kept as it is.

        Keeping J a + J_dot v = 0 at the contacts makes it convex: Gauss's principle with motors that may choose.

        Args:
            weights: None: there are no weights to choose here.

        Raises:
            InputError: if weights are given.
            NoSolution: where nothing is reachable so, or it was not found within tolerance.
        """
        if weights is not None:
            raise InputError(f"weights is {weights!r:.80}; the nearest possible motion of a robot with motors has none.")
        if self._nearest_possible is None:
            raise InputError("there is no nearest motion: this error comes from no motion that was posed.")
        return self._nearest_possible()


class CannotHold(CannotMove):
    """No motor torques within the limits, with forces within the cones, keep this pose still.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> slope = rbd.Ground(normal=(0.6, 0.0, 0.8))  # 37 degrees, which needs a coefficient of 0.75
        >>> corner = rbd.PointContact("corner", "box", friction=0.5, on=slope)
        >>> rbd.hold(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [corner])
        Traceback (most recent call last):
            ...
        rbd.errors.CannotHold: box cannot be held on 'corner': friction prevents it; a coefficient of 0.75 ...
    """


class CannotAssemble(NoSolution):
    """The constraints could not be met: loops that cannot close, a start too far away, contradictory fixed values.

    Attributes:
        q: The nearest configuration found, shape (nq,), or None.
        distances: {constraint: length of its error there} [m, rad], of those that are not met.
        minimum: Whether the distance is a true minimum there: no small motion makes it less.
        elsewhere: A configuration that meets them, reached from another start, or None where none was found.
    """

    def __init__(
        self,
        message: str,
        *,
        q: np.ndarray | None = None,
        distances: Mapping[str, float] | None = None,
        minimum: bool = False,
        elsewhere: np.ndarray | None = None,
    ) -> None:
        super().__init__(message)
        self.q = q
        self.distances = {} if distances is None else dict(distances)
        self.minimum = minimum
        self.elsewhere = elsewhere


class CannotReach(NoSolution):
    """No pose within the joint limits satisfies the targets, or none was found.

    Attributes:
        q: The nearest pose, shape (nq,), or None.
        misses: {target: its error there, a distance [m] and an angle [rad]}, of the targets that are not satisfied.
        minimum: Whether it is a true minimum of the distance: its gradient is zero for free joints and points outwards at
            limits, and no curvature is negative. So no pose nearby is nearer; one far away can be.
        slope: Largest entry of the gradient for free joints, without units.
        limits: {joint: multiplier of its limit}, positive at upper limits, negative at lower ones.
        proof: An `OutOfReach`, which proves that there is no pose: points farther apart than the links between them; or None.
        without: Targets without which, one at a time, the others are satisfied.
    """

    def __init__(
        self,
        message: str,
        *,
        q: np.ndarray | None = None,
        misses: Mapping[str, Any] | None = None,
        minimum: bool = False,
        slope: float = 0.0,
        limits: Mapping[str, float] | None = None,
        proof: Any = None,
        without: tuple[str, ...] = (),
    ) -> None:
        super().__init__(message)
        self.q, self.minimum, self.slope, self.proof, self.without = q, minimum, slope, proof, without
        self.misses = {} if misses is None else dict(misses)
        self.limits = {} if limits is None else dict(limits)


class SingularPose(NoSolution):
    """At this pose the known velocities do not determine the others; the message names them."""


class PictureError(RbdError):
    """A page or a screenshot could not be made."""


class WrongPinocchio(RbdError, ImportError):
    """`import pinocchio` finds a module other than pip's Pinocchio; the message gives the remedy."""


class RbdWarning(UserWarning):
    """Base of all warnings of `rbd`."""


class EffortLimitWarning(RbdWarning):
    """A given torque is beyond the limit that the robot's file states."""


class InaccurateWarning(RbdWarning):
    """An answer's residuals are above 1e-9, though at most 1e-7, scaled; or those of a simulation's record are above 1e-7."""


class NonUniqueMotionWarning(RbdWarning):
    """More than one motion satisfies the contact law; the answer is one of them, `Solution.others` has others."""


class OpeningContactWarning(RbdWarning):
    """A contact, or some of its points, separates: its force is zero. `Solution.opening` names it."""


class DistantContactWarning(RbdWarning):
    """A contact is more than a millimetre off its plane; it is solved as if it touched."""


class LoopNotClosedWarning(RbdWarning):
    """A loop is not closed at the state that was solved; the answer is that of the mechanism with its gap."""


class ModelWarning(RbdWarning):
    """A robot file loads, but part of its contents is missing or ignored."""


def nearest(name: object, names: Iterable[str], *, count: int = 4) -> str:
    """The names most like `name`, quoted, for the end of an error message.

    Example:
        >>> rbd.errors.nearest("left_sol", ["left_sole", "right_sole", "head"])
        "nearest: 'left_sole', 'right_sole'"
    """
    known, name = list(names), str(name)[:100]
    if not known:
        return "there are none"
    close = difflib.get_close_matches(name, known, n=count, cutoff=0.5)
    if not close:
        lower = str(name).lower()
        close = [n for n in known if lower and lower in n.lower()][:count]
    if close:
        return "nearest: " + ", ".join(repr(n) for n in close)
    return "there are " + ", ".join(repr(n) for n in known[:8]) + (", ..." if len(known) > 8 else "")
