"""A controller that holds a posture: PD on the joints, plus torques that support the weight through the contacts.

    tau = tau_0 - K (q - q*) - D v,        clipped at the effort limits

with gains for the points that touch now: every small motion that the contacts allow is an oscillator of the frequency and the
damping ratio that are requested. If all given contacts touch, tau_0 is that of `rbd.hold`, whose contact
forces are within their cones. PD on the gravity torques of the posture that is wanted, and not of the present one, is
[Takegaki1981]'s; to first order in the distance both are the same here.

The gains follow from the inertia that the motors feel through the contacts. Let C be the rows of bilateral constraints
and of the points that touch, Z the motions that they leave, of unit inertia, and P the motion that motor rates belong to:

    C Z = 0,   Z^T M Z = 1,   y = P q_motors,   P S Z = 1            (P by least squares, strong motors counting most)

Motor torques P^T u make the accelerations y'' = u of these motions, so with h the weight and T how it tips,

    tau = P^T (Z^T h) - P^T (w^2 + T) P (q - q*) - 2 zeta w P^T P v     gives     y'' + 2 zeta w y' + w^2 y = 0

for every small motion that the contacts allow. T is the derivative of Z^T (S^T tau + C^T f - h) along Z at constant torques and
forces; only what tips is in it, not what gravity itself brings back. P^T P is the inertia that the motors feel [Khatib1987]: of
a fixed arm M, of a standing robot's ankles that of the body above them, where the diagonal of M knows of the foot alone.

One number a joint in its place would leave the frequencies of a standing humanoid 12 (Talos) to 17 times (G1) apart, and 1 ms
would be too long a step for the fastest where the slowest is well damped. Without T, Talos buckles below w = 17, G1 below 26.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field

import numpy as np
import pinocchio as pin
import scipy.linalg

from rbd.arrays import ABOVE_ZERO, Array, check_number
from rbd.constraints.constraint import Constraint, rows_of, with_loops
from rbd.constraints.contact_points import PointSource, Structure, sources_of
from rbd.control.schedules import AcceptedStep
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, generalised
from rbd.model.state import State
from rbd.problem.cones import Bounds, Free
from rbd.statics.equilibrium import hold

TOUCHING = 1e-5
"""A point whose gap is at most this [m] counts as in contact. Far above the error of contacts, and so small that
a foot held stiffly for a little too long moves by no more."""
RANK = 1e-4
"""Motions with less motor velocity than this, over the largest, are not controllable, e.g. of a body that tips on an edge."""
NUDGE = 1e-4
"""Displacement of the posture in the test for tipping [s sqrt(N m), of unit inertia]."""


@dataclass(frozen=True, eq=False)
class Gains:
    """Control law of a posture while the same points touch: tau = torque - stiffness (q - q*) - damping v.

    Attributes:
        torque: Shape (nu,) [N, N m]: no motor accelerates under it; of least sum (tau / limit)^2. Zero in free fall.
        stiffness: Shape (nu, nu) [N/m, N m/rad].
        damping: Shape (nu, nu) [N s/m, N m s/rad].
    """

    torque: Array
    stiffness: Array
    damping: Array


def posture_gains(
    sources: Sequence[PointSource],
    state: State,
    touching: Array,
    torque: Array | None,
    frequency: float,
    damping_ratio: float,
    external: External = None,
) -> Gains:
    """The gains at a posture, for the points that touch, and all bilateral constraints.

    Args:
        sources: The points of contacts and other constraints; C are the rows of those that hold the robot.
        state: The posture, at rest.
        touching: Which points touch, shape (k,); all if the posture has another number of points.
        torque: In place of the one computed here, shape (nu,); it must be in equilibrium.
        frequency: w [rad/s].
        damping_ratio: zeta.
        external: Other forces of the world, which count as the weight does.
    """

    def load(near: State) -> Array:
        return near.h if external is None else near.h - generalised(near, external)[0]

    structures = [source.at(state, 0.0).structure for source in sources]
    holding = np.concatenate([np.zeros(0, bool), *[_holding_points(s) for s in structures]])
    points = touching if len(touching) == len(holding) else np.ones(len(holding), bool)
    mask = np.repeat(points & holding, np.concatenate([np.zeros(0, int), *[s.widths for s in structures]]))

    def rows_at(near: State) -> Array:
        J = [source.at(near, 0.0).J for source in sources]
        return np.concatenate([np.zeros((0, near.robot.nv)), *J])[mask]

    robot = state.robot
    C = rows_at(state)
    Z = _motions(state.M, C)
    scale = torque_scale(robot)
    P = scipy.linalg.pinv(Z[robot.actuated] * scale[:, None], rtol=RANK) * scale if robot.nu else np.zeros((Z.shape[1], 0))
    tau = P.T @ (Z.T @ load(state)) if torque is None else torque
    tips = _tipping(state, load, rows_at, C, Z, tau)
    w = frequency
    return Gains(tau, P.T @ (w * w * np.eye(len(tips)) + tips) @ P, 2.0 * damping_ratio * w * P.T @ P)


def check_oscillation(whose: str, frequency: float, damping_ratio: float) -> None:
    """Refuse what is no frequency, or no damping ratio.

    Raises:
        InputError: naming the controller.
    """
    check_number(f"frequency of {whose}", frequency, ABOVE_ZERO, 1e6, expected="a number > 0 [rad/s]")
    check_number(f"damping_ratio of {whose}", damping_ratio, 0.0, 1e6, expected=">= 0 (1: critical)")


def torque_scale(robot: CheckedModel) -> Array:
    """Scale of each motor's torque, shape (nu,): its limit; without one, body weight times a metre, as in `hold`."""
    return np.where(np.isfinite(robot.effort_limit), robot.effort_limit, robot.force_unit)


def _motions(M: Array, C: Array) -> Array:
    """Z: all motions with C Z = 0, of unit inertia, shape (nv, nv - rank)."""
    U = scipy.linalg.cholesky(M)
    if not len(C):
        return scipy.linalg.solve_triangular(U, np.eye(len(M)))
    left, size, _ = scipy.linalg.svd(scipy.linalg.solve_triangular(U, C.T, trans="T"))
    rank = int((size > 1e-9 * size[0]).sum())
    return scipy.linalg.solve_triangular(U, left[:, rank:])


def _tipping(
    state: State, load: Callable[[State], Array], rows_at: Callable[[State], Array], C: Array, Z: Array, tau: Array
) -> Array:
    """T without what brings back: symmetric, no eigenvalue below zero, shape (n, n) [1/s2]."""
    robot = state.robot
    motors = np.zeros(robot.nv)
    motors[robot.actuated] = tau
    # Where the contacts do not carry the weight it falls with a; seen from there, it is at rest.
    carried = load(state)
    a = Z @ (Z.T @ (motors - carried))
    f = np.linalg.lstsq(C.T, carried + state.M @ a - motors, rcond=None)[0] if len(C) else np.zeros(0)

    def force(z: Array) -> Array:
        near = State(robot, pin.integrate(robot.model, state.q, z), t=state.t)
        return Z.T @ (motors + rows_at(near).T @ f - load(near) - near.M @ a)

    n = Z.shape[1]
    T = np.array([(force(NUDGE * z) - force(-NUDGE * z)) / (2.0 * NUDGE) for z in Z.T]).reshape(n, n)
    size, directions = np.linalg.eigh(0.5 * (T + T.T))
    return (directions * np.maximum(size, 0.0)) @ directions.T


@dataclass(frozen=True, eq=False)
class HoldPosture(Displayed):
    """Controller that holds a posture: gravity compensation through the contacts, PD on the joints, within effort limits.

    It looks at which points touch, as a robot with switches in its soles would, and changes its gains with them: a leg in the
    air feels little inertia, and gains of a standing leg would shake it. It has no memory, so runs are repeatable.

    Attributes:
        state: The posture; joints are held at its angles. Its velocity is not used.
        contacts: Its contacts and loops, as given to `rbd.simulate`; none for a fixed arm.
        frequency: Natural frequency w of every motion that the contacts allow [rad/s]; well below 1 / step. The stiffer, the
            smaller the push that tips a foot.
        damping_ratio: zeta; 1 is critical.
        external: Other forces of the world that it counts on, such as springs, at rest: it holds the posture against them, and
            against what of them tips. By default none: it gives way to forces that it is not told of.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: an invalid frequency or damping ratio; not a state, or not constraints.
        CannotHold: a posture that the motors cannot hold on its contacts, if all touch; names the limit that prevents it.
        NotAtRest: the ground moves.

    Example:
        >>> solo = rbd.load_robot("solo12", root="fixed")
        >>> stand = rbd.control.HoldPosture(solo.at("standing"))
        >>> bent = solo.at("standing").with_joints({"FL_KFE": -1.2})
        >>> for state in (solo.at("standing"), bent):  # gravity compensation, and against the bend of the third joint
        ...     print(stand(state, 0.0)[:3].round(3))
        [ 0.099  0.097 -0.027]
        [ 0.101  0.092 -0.032]
    """

    state: State
    contacts: Sequence[Constraint] = ()
    _: KW_ONLY
    frequency: float = 5.0
    damping_ratio: float = 1.0
    external: External = None
    loops: bool = True
    _sources: tuple[PointSource, ...] = field(init=False, repr=False)
    _start: State = field(init=False, repr=False)
    _known: dict[bytes, Gains] = field(init=False, repr=False)
    _off: list[frozenset[str]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_kind("state of HoldPosture", self.state, State, "a State, e.g. robot.standing()")
        check_oscillation("HoldPosture", self.frequency, self.damping_ratio)
        still = self.state.with_velocity(self.state.robot.zero_v)
        contacts = with_loops(still.robot, self.contacts, self.loops)
        rows_of(still, contacts)  # which raises if it is not a list of constraints
        sources = tuple(sources_of(contacts, still))
        touching = touching_points(sources, still, 0.0)
        torque = hold(still, contacts, external=self.external, loops=False).tau if touching.all() else None
        self.__dict__.update(contacts=contacts, _sources=sources, _start=still, _known={}, _off=[frozenset()])
        self._known[touching.tobytes()] = self._gains_at(still, touching, torque)

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a state and a time [s], shape (nu,) [N, N m].

        Raises:
            InputError: a state of another robot.
        """
        robot = self.state.robot
        gains = self.gains(state, t)
        motors = robot.motors
        back = pin.difference(robot.model, state.q, self.state.q)[motors]
        tau = gains.torque + gains.stiffness @ back - gains.damping @ state.v[motors]
        return np.clip(tau, *robot.limits_at(state.v))

    def reset(self) -> None:
        """A motion begins: no contact is known to be switched off."""
        self._off[:] = [frozenset()]

    def accepted(self, step: AcceptedStep) -> None:
        """Notes which contacts are switched off: they do not count as touching."""
        self._off[:] = [step.inactive]

    def gains(self, state: State, t: float = 0.0) -> Gains:
        """Torque, stiffness and damping for the contacts at a state.

        Raises:
            InputError: a state of another robot.
        """
        if not self.state.robot.is_like(state.robot):
            raise InputError(f"HoldPosture was made for {self.state.robot.name}, and got a state of {state.robot.name}.")
        touching = touching_points(self._sources, state, t, self._off[0])
        key = touching.tobytes()
        if len(key) != len(next(iter(self._known))):  # points that come and go: those that are there now
            return self._gains_at(state if not state.v.any() else state.with_velocity(state.robot.zero_v), touching)
        found = self._known.get(key)
        if found is None:  # from the posture, not from earlier states: the same in every run
            found = self._known[key] = self._gains_at(self._start, touching)
        return found

    def _gains_at(self, still: State, touching: Array, torque: Array | None = None) -> Gains:
        """The gains at a state at rest, for the points that touch."""
        w, zeta = float(self.frequency), float(self.damping_ratio)
        return posture_gains(self._sources, still, touching, torque, w, zeta, self.external)


def touching_points(sources: Sequence[PointSource], state: State, t: float, off: frozenset[str] = frozenset()) -> Array:
    """Which points count as in contact, shape (k,): those that are near enough, but of constraints that are switched off."""
    touching = np.concatenate([np.zeros(0), *[source.gaps(state, t) for source in sources]]) <= TOUCHING
    if off:
        owners = [owner for source in sources for owner in source.at(state, t).structure.owners]
        touching &= ~np.array([owner in off for owner in owners], bool)
    return touching


def _holding_points(structure: Structure) -> Array:
    """Which points are contacts or bilateral constraints, shape (k,); not joint limits, not dry friction."""
    cones = structure.cones
    if cones and cones[0].dim == 1 and not isinstance(cones[0], Free):  # joint limits
        return np.zeros(len(cones), bool)
    return np.array([not isinstance(cone, Bounds) for cone in cones], bool)
