"""`estimate_forces`: contact forces from measured configuration, velocity, acceleration and torques; at an instant, over time.

The unknown is f in M a + h - tau_ext - S^T tau = J^T f, f in the contacts' sets: circular friction cones, half-lines, lines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_finite
from rbd.constraints.constraint import Constraint, rows_of, with_loops
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, generalised
from rbd.model.sampled_motion import SampledMotion
from rbd.model.state import State, checked
from rbd.motion.force_estimate import ForceEstimate, fit_forces
from rbd.motion.sensor_noise import SensorNoise, checked_noise, force_scale, whitening
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.rows import Rows
from rbd.statics.force_balance import contact_rows


def estimate_forces(
    state: State,
    a: Array,
    contacts: Sequence[Constraint],
    tau: Array | None = None,
    *,
    noise: SensorNoise | None = None,
    external: External = None,
    loops: bool = True,
) -> ForceEstimate:
    """Contact forces that explain a measured motion: M a + h - tau_ext - S^T tau = J^T f, by weighted least squares.

    f is in the contacts' sets, whatever their velocity: a measured sole is never quite at rest. With torques every coordinate
    counts; without them those that no motor drives, six of a floating base: one foot's wrench follows from them, of two feet
    only the sum, and `ForceEstimate.open` says what is not known. Of forces that fit as well, those of least norm are given.

    Weights are those of the noise, to first order. Without noise they are equal, each coordinate over its effort limit or,
    where no motor is, over the weight (times the radius of gyration about its axis).

    Args:
        state: The measured configuration and velocity.
        a: The measured acceleration, shape (nv,) [m/s2, rad/s2]; of a floating base in the base's axes, as `Solution.a`.
        contacts: What touches, loops and other constraints, each with its own name. None: what is left unexplained is told.
        tau: Measured motor torques, shape (nu,) [N, N m].
        noise: Standard deviations of the sensors.
        external: Other forces of the world that are known: generalised (nv,), or `ExternalForce`s and springs
            (`rbd.constraints.forces`).
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: wrong sizes, NaN, unknown frames; noise that does not fit; no equation: a fixed base without torques.
        DuplicateName: two constraints of one name.
        NoSolution: the least squares over the friction cones was not solved.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet()
        >>> estimate = rbd.estimate_forces(state, np.zeros(solo.nv), feet, rbd.hold(state, feet).tau)
        >>> estimate.forces["front_left"].round(3)
        array([-0.457, -0.389,  6.131])
    """
    robot = checked(state).robot
    a = robot.check_v(a, "a")
    tau = None if tau is None else robot.check_tau(tau)
    noise = checked_noise(robot, noise, torques=tau is not None)
    given = with_loops(robot, contacts, loops)
    rows = contact_rows(state, given, stacklevel=3)
    need = state.M @ a + state.h
    if external is not None:
        need -= generalised(state, external)[0]
    if tau is not None:
        need[robot.motors] -= tau
    if noise is None:
        return fitted(state, rows, need, tau)
    torques = tau is not None
    first = fitted(state, rows, need, tau, noise.covariance(state, a, None, torques=torques))
    if not np.any(noise.of("q", robot.nv)):
        return first
    acting = _acting(given, rows, first.row_forces, external)
    return fitted(state, rows, need, tau, noise.covariance(state, a, acting, torques=torques))


def _acting(given: Sequence[Constraint], rows: Sequence[Rows], f: Array, external: External) -> Callable[[State], Array]:
    """tau_ext + J^T f at a state near, for fixed row forces.

    A constraint that has other rows there, as a limit that is not reached, counts as unchanged.
    """

    def at(state: State) -> Array:
        out = np.zeros(state.robot.nv) if external is None else generalised(state, external)[0]
        first = 0
        for known, near in zip(rows, rows_of(state, given), strict=True):
            part = f[first : first + len(known)]
            first += len(known)
            out = out + (near if len(near) == len(known) else known).J.T @ part
        return out

    return at


def fitted(
    state: State, rows: Sequence[Rows], need: Array, tau: Array | None, covariance: Array | None = None
) -> ForceEstimate:
    """Contact forces that explain a generalised force.

    Args:
        state: The measured state.
        rows: Rows of the contacts.
        need: The generalised force, shape (nv,) [N, N m].
        tau: Measured torques, shape (nu,), or None.
        covariance: Of the generalised force, shape (nv, nv), which gives the weights; None: equal ones.

    Raises:
        InputError: no equation is without unknown torques.
    """
    robot = state.robot
    check_measured(robot, tau)
    measured = np.ones(robot.nv, bool)
    if tau is None:
        measured[robot.actuated] = False
    sets: ForceSet = at_rest(*[r.cone for r in rows])
    J = np.concatenate([np.zeros((0, robot.nv)), *[r.J for r in rows]])
    E = (J.T @ sets.G)[measured]
    scale = force_scale(state)[measured]
    W = whitening(None if covariance is None else covariance[np.ix_(measured, measured)], scale)
    fit = fit_forces(E, need[measured], W, sets, robot.force_unit)
    of_rows = None if covariance is None else sets.G @ fit.covariance(E, W) @ sets.G.T
    return ForceEstimate(state, tuple(rows), measured, need.copy(), sets, fit, of_rows, tau)


def check_measured(robot: CheckedModel, tau: object) -> None:
    """Refuse a robot each of whose coordinates has a motor, without torques.

    Raises:
        InputError: it is so.
    """
    if tau is None and not len(robot.unactuated):
        raise InputError(
            f"every coordinate of {robot.name} has a motor, so its motion alone says nothing of contact forces; give the "
            "measured torques, tau."
        )


@dataclass(frozen=True, eq=False, repr=False)
class ForceHistory(Displayed):
    """Contact forces estimated at each time of a motion, as arrays over time.

    Attributes:
        t: Times, shape (n,) [s].
        estimates: One a time.
        names: The contacts.
        touches: Which of them were taken to touch, shape (n, k), of truth values.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> rest = rbd.simulate(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [face], duration=0.02, step=1e-2)
        >>> history = rbd.motion.estimate_forces_along(rest, [face])
        >>> history.forces["face"].round(3)
        array([[0. ,  0. , 98.1,  0. ,  0. ,  0. ],
               [ 0. ,  0. , 98.1,  0. ,  0. ,  0. ],
               [ 0. ,  0. , 98.1,  0. ,  0. ,  0. ]])
    """

    t: Array
    estimates: Sequence[ForceEstimate]
    names: tuple[str, ...]
    touches: Array

    @property
    def forces(self) -> dict[str, Array]:
        """{contact: forces (n, 3) or wrenches (n, 6)}, on the robot, world axes [N, N m]; zero where it does not touch."""
        return {name: self._stacked([e.forces.get(name) for e in self.estimates]) for name in self.names}

    @property
    def deviations(self) -> dict[str, Array] | None:
        """Their standard deviations, as `ForceEstimate.deviations`; None without noise."""
        each = [e.deviations for e in self.estimates]
        if any(d is None for d in each):
            return None
        return {name: self._stacked([None if d is None else d.get(name) for d in each]) for name in self.names}

    @property
    def net(self) -> Array:
        """Wrenches of all contacts with the surroundings about the centre of mass, shape (n, 6) [N, N m]."""
        return np.array([e.net for e in self.estimates])

    @property
    def residual(self) -> Array:
        """What no allowed contact force explains, shape (n, nv) [N, N m]."""
        return np.array([e.residual for e in self.estimates])

    @property
    def tau(self) -> Array:
        """The torques measured; without them, those that go with motion and forces, shape (n, nu) [N, N m]."""
        return np.array([e.tau for e in self.estimates])

    @property
    def chi_square(self) -> Array:
        """`ForceEstimate.chi_square`, shape (n,)."""
        return np.array([e.chi_square for e in self.estimates])

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, i: int) -> ForceEstimate:
        return self.estimates[i]

    def __repr__(self) -> str:
        return f"ForceHistory({len(self)} times, {self.t[0]:g} to {self.t[-1]:g} s, {', '.join(self.names)})"

    @staticmethod
    def _stacked(each: Sequence[Array | None]) -> Array:
        width = max((len(x) for x in each if x is not None), default=0)
        return np.array([np.zeros(width) if x is None or not len(x) else x for x in each])


def estimate_forces_along(
    motion: SampledMotion,
    contacts: Sequence[Constraint],
    tau: Array | None = None,
    *,
    a: Array | None = None,
    touches: Array | None = None,
    noise: SensorNoise | None = None,
    external: External = None,
    loops: bool = True,
) -> ForceHistory:
    """`estimate_forces` at every time of a motion.

    Args:
        motion: A trajectory or a reference motion: robot, t, q, v and, where it is not given, a.
        contacts: What may touch.
        tau: Measured motor torques, shape (n, nu) [N, N m], e.g. `trajectory.tau`.
        a: Accelerations in place of the motion's, shape (n, nv).
        touches: Which contacts touch when, shape (n, k), of truth values; all of them if not given. In the air a foot carries
            nothing, and without torques only this says so.
        noise: Standard deviations of the sensors.
        external: Other forces of the world that are known, the same at all times.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: sizes that do not fit, and as `estimate_forces`, with the number of the frame.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> motion = rbd.simulate(slides, [face], duration=0.02, step=1e-2)
        >>> rbd.motion.estimate_forces_along(motion, [face]).net[:, :3].round(3)
        array([[-49.05,  0.  ,  98.1 ],
               [-49.05,  0.  ,  98.1 ],
               [-49.05,  0.  ,  98.1 ]])
    """
    given, frames = with_loops(motion.robot, contacts, loops), len(motion.t)
    accelerations = frame_rows("a", getattr(motion, "a", None) if a is None else a, frames, motion.robot.nv)

    def estimate(i: int, state: State, acting: Sequence[Constraint], torque: Array | None) -> ForceEstimate:
        return estimate_forces(state, accelerations[i], acting, torque, noise=noise, external=external, loops=False)

    return history_of(motion, tau, checked_touches(touches, frames, contacts, given), given, estimate)


def history_of(
    motion: SampledMotion,
    tau: Array | None,
    touching: Array,
    contacts: Sequence[Constraint],
    estimate: Callable[[int, State, Sequence[Constraint], Array | None], ForceEstimate],
) -> ForceHistory:
    """Contact forces frame by frame.

    Args:
        motion: Its robot, t, q and v are read.
        tau: Measured torques, shape (n, nu), or None.
        touching: Which contacts touch when, shape (n, k).
        contacts: All of them.
        estimate: Gives those of a frame, by its number, state, touching contacts and torques.

    Raises:
        InputError: sizes that do not fit.
    """
    frames, robot = len(motion.t), motion.robot
    torques = None if tau is None else frame_rows("tau", tau, frames, robot.nu)
    out = []
    for i in range(frames):
        acting = [c for c, yes in zip(contacts, touching[i], strict=True) if yes]
        state = State(robot, motion.q[i], motion.v[i], t=float(motion.t[i]))
        out.append(estimate(i, state, acting, None if torques is None else torques[i]))
    return ForceHistory(np.array(motion.t), tuple(out), tuple(c.name for c in contacts), touching)


def frame_rows(what: str, value: object, frames: int, size: int) -> Array:
    """One row a frame, shape (frames, size).

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    if value is None:
        raise InputError(f"the motion has no {what}; give {what}, shape ({frames}, {size}), or use MomentumObserver.")
    return as_finite(what, value, (frames, size), meaning=": a row a frame, a column a coordinate")


def checked_touches(touches: object, frames: int, given: Sequence[Constraint], all_: Sequence[Constraint]) -> Array:
    """Which of all constraints touch when, shape (frames, k); loops that the robot adds to those given always hold.

    Raises:
        InputError: another shape, or no truth values.
    """
    count = len(given)
    held = np.ones((frames, len(all_)), bool)
    if touches is None:
        return held
    try:
        out = np.array(touches)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"touches is no array of truth values: {error}.") from None
    if out.dtype != bool or out.shape != (frames, count):
        raise InputError(
            f"touches has shape {out.shape} of {out.dtype}; expected ({frames}, {count}) truth values, a column a contact."
        )
    held[:, :count] = out
    return held
