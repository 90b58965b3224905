"""Errors where no motion, force, pose or assembly was found, and of a study that ended early; most carry what was found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rbd.errors.reasons import InputError, RbdError, Reason


class NoSolution(RbdError):
    """There is no answer within tolerance, or none was found; the message names the worst row or the contradiction.

    Attributes:
        problem: The `GaussProblem` that was to be solved, or None where no contact problem was posed.
        result: The best `Solution` that was found, residuals and all, or None.
        contradiction: The `Contradiction`: constraints that contradict each other, with the certificate; or None.

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

    reason = Reason.NO_SOLUTION

    def __init__(
        self,
        message: str,
        *,
        problem: Any = None,
        result: Any = None,
        contradiction: Any = None,
        nearest: Callable[..., Any] | None = None,
        reason: Reason | None = None,
    ) -> None:
        super().__init__(message, reason=reason)
        self.problem = problem
        self.result = result
        self.contradiction = contradiction
        self._nearest = nearest

    def nearest(self, *, weights: Mapping[str, float | np.ndarray] | None = None) -> Any:
        """The `NearestMotion` that violates the constraints least, by the same solver.

        See `rbd.answers.solution.nearest_motion`.

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
    """A step of a simulation has no solution, a robot sinks through its floor, or a function of the user raised an error.

    The user's error is `__cause__`.

    Attributes:
        state: The last `State` that was reached, or None.
        t: Its time [s].
        names: The constraints that were active.
        trajectory: The `Trajectory` that was computed until then; None if not even the first sample was.

    Example:
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> def careless(state, t):
        ...     return [np.sqrt(0.042 - t)]  # not a number after 0.042 s
        >>> try:
        ...     with np.errstate(invalid="ignore"):
        ...         rbd.simulate(bars.at("assembled"), bars.loops(), duration=1.0, step=0.01, controller=careless)
        ... except rbd.errors.SimulationStopped as error:
        ...     print(f"{error.t:.2f} s, {len(error.trajectory)} samples, active: {error.names}")
        0.04 s, 5 samples, active: ('coupler_pin',)
    """

    reason = Reason.SIMULATION_STOPPED

    def __init__(
        self,
        message: str,
        *,
        state: Any = None,
        t: float = 0.0,
        names: tuple[str, ...] = (),
        trajectory: Any = None,
        cause: Exception | None = None,
        reason: Reason | None = None,
    ) -> None:
        super().__init__(message, reason=reason)
        if isinstance(cause, NoSolution):
            self.problem, self.result, self.contradiction = cause.problem, cause.result, cause.contradiction
            self._nearest = cause._nearest
        self.state, self.t, self.names, self.trajectory = state, t, names, trajectory


class CannotMove(NoSolution):
    """No motor torques within their limits, with forces that the motion allows, move the robot as wanted.

    Attributes:
        limits: An irreducible set of `rbd.statics.limits.Limit`: all of them together cannot be kept, and any of them left out
            lets the rest be kept. Empty where the certificate was not found.
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

    reason = Reason.CANNOT_MOVE

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
        reason: Reason | None = None,
    ) -> None:
        super().__init__(message, reason=reason)
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


class CannotPlan(CannotMove):
    """There is no plan over the contacts from keyframe to keyframe, or none was found; what is missing, as of `CannotMove`.

    Attributes:
        t: Instants at which the nearest plan is not certified [s].
        plan: The `rbd.planning.Plan` that came nearest; None where the centre of mass already has no motion.
        momentum: The `rbd.planning.MomentumCertificate` that contacts cannot give the momentum that keyframes ask for, those
            between included where there is a nearest plan; or None. Without such a plan `certificate` is that.
        tried: With contacts="search", what was tried in vain, in words.
        helps: {what: least factor of it that would do}, the smallest first: "friction" and "torque" at the instant that is
            named, or what `MomentumCertificate.helps` has.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> stand = solo.standing()
        >>> feet = {foot.name: True for foot in solo.feet()}
        >>> far = {"com": stand.com + [0.1, 0.0, 0.0]}
        >>> try:
        ...     rbd.plan(solo, {0.0: stand, 0.12: far, 0.24: stand}, feet, friction=0.2, progress=False)
        ... except rbd.errors.CannotPlan as error:
        ...     print(len(error.t) > 0, error.plan.certified)
        True False
    """

    reason = Reason.CANNOT_PLAN

    def __init__(
        self,
        message: str,
        *,
        t: tuple[float, ...] = (),
        plan: Any = None,
        momentum: Any = None,
        tried: tuple[str, ...] = (),
        helps: Mapping[str, float] | None = None,
        **told: Any,
    ) -> None:
        super().__init__(message, **told)
        self.t, self.plan, self.momentum, self.tried, self.helps = t, plan, momentum, tried, dict(helps or {})


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

    reason = Reason.CANNOT_HOLD


class CannotAssemble(NoSolution):
    """The constraints could not be met: loops that cannot close, a start too far away, contradictory fixed values.

    Attributes:
        q: The nearest configuration found, shape (nq,), or None.
        distances: {constraint: length of its error there} [m, rad], of those that are not met.
        minimum: Whether the distance is a true minimum there: no small motion makes it less.
        elsewhere: A configuration that meets them, reached from another start, or None where none was found.

    Example:
        >>> bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        >>> try:
        ...     rbd.mechanism.assemble(bars.at(), bars.loops(), fixed={"crank_joint": 0.7, "rocker_joint": 0.3})
        ... except rbd.errors.CannotAssemble as error:
        ...     print({name: round(gap, 4) for name, gap in error.distances.items()}, error.minimum)
        {'coupler_pin': 0.6462} True
    """

    reason = Reason.CANNOT_ASSEMBLE

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
        certificate: An `OutOfReach`: two points farther apart than the links between them, so that there is no pose; or None.
        without: Targets without which, one at a time, the others are satisfied.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> try:
        ...     rbd.find_pose(solo, {"FL_FOOT": (5.0, 0.0, 0.0), "FR_FOOT": (0.0, 0.0, 0.0)})
        ... except rbd.errors.CannotReach as error:
        ...     print(f"{error.certificate.short:.2f} m too far apart; without {error.without}")
        4.15 m too far apart; without ('FL_FOOT', 'FR_FOOT')
    """

    reason = Reason.CANNOT_REACH

    def __init__(
        self,
        message: str,
        *,
        q: np.ndarray | None = None,
        misses: Mapping[str, Any] | None = None,
        minimum: bool = False,
        slope: float = 0.0,
        limits: Mapping[str, float] | None = None,
        certificate: Any = None,
        without: tuple[str, ...] = (),
    ) -> None:
        super().__init__(message, reason=None if certificate is None else Reason.OUT_OF_REACH)
        self.q, self.minimum, self.slope, self.certificate, self.without = q, minimum, slope, certificate, without
        self.misses = {} if misses is None else dict(misses)
        self.limits = {} if limits is None else dict(limits)


class SingularPose(NoSolution):
    """At this pose the known velocities do not determine the others; the message names them.

    Example:
        >>> flat = rbd.mechanism.four_bar(1.0, 1.0, 1.0, 1.0)  # at neutral all bars are in line
        >>> rbd.mechanism.velocity_partition(flat.at(), flat.loops(), {"crank_joint": 1.0})
        Traceback (most recent call last):
            ...
        rbd.errors.SingularPose: the known rates ('crank_joint') do not decide those of 'coupler_joint', 'rocker_joint': ...
    """

    reason = Reason.SINGULAR_POSE


class NoSteadyState(NoSolution):
    """No equilibrium, or no steady motion, was found from this start; the message names what is left, and the worst joint.

    Attributes:
        state: The nearest `State` that was found, or None.
        acceleration: Its largest acceleration [m/s2, rad/s2].

    Example:
        >>> box = rbd.testing.box(mass=2.0)
        >>> try:
        ...     rbd.find_equilibrium(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]))  # nothing carries it
        ... except rbd.errors.NoSteadyState as error:
        ...     print(f"{error.acceleration:.2f} m/s2")
        9.81 m/s2
    """

    reason = Reason.NO_STEADY_STATE

    def __init__(self, message: str, *, state: Any = None, acceleration: float = 0.0) -> None:
        super().__init__(message)
        self.state, self.acceleration = state, acceleration


class StudyStopped(RbdError):
    """A study ended before all samples were computed: a full disk, a store that went away, a chunk that kills its workers.

    What was finished is kept: with `out=`, the same call goes on from there.

    Attributes:
        dataset: What is kept, as `rbd.study` returns it, `ok` False and `reason` "not_run" where nothing was computed; None
            where it could not be read.

    Example:
        >>> try:
        ...     raise rbd.errors.StudyStopped("push.zarr cannot be written: No space left on device.", dataset=None)
        ... except rbd.RbdError as error:
        ...     print(error, error.dataset)
        push.zarr cannot be written: No space left on device. None
    """

    reason = Reason.STUDY_STOPPED

    def __init__(self, message: str, *, dataset: Any = None) -> None:
        super().__init__(message)
        self.dataset = dataset
