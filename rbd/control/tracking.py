"""A controller that follows a reference motion: torques of inverse dynamics along it, and feedback.

    tau = tau_ref(t) + K(t) (q_ref(t) - q) + D(t) (v_ref(t) - v),        clipped at the effort limits

K and D give every small motion that the contacts allow the same frequency and damping ratio, as in
`rbd.control.posture_control`, at poses along the reference; or they are given, one number a joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, check_number
from rbd.constraints.constraint import Constraint, rows_of, with_loops
from rbd.constraints.contact_points import PointSource, sources_of
from rbd.control.posture_control import Gains, check_oscillation, posture_gains, touching_points
from rbd.control.schedules import AcceptedStep, check_model
from rbd.control.torques import inverse_dynamics, inverse_dynamics_many
from rbd.displayed import Displayed
from rbd.errors import CannotMove, InputError, RbdError
from rbd.errors.inputs import check_choice
from rbd.mechanism.projection import project_acceleration, project_velocity
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import SampledAccelerations, cubic, cubic_rate, interpolated_q
from rbd.model.state import State
from rbd.problem.conic import ConicAnswer
from rbd.problem.contact_motion import REST_SPEED
from rbd.records import joined
from rbd.statics.wanted_motion import MARGIN, EffortChoice, WantedMotion

NEAR = 1e-3
"""A contact of the reference whose nearest point is this near [m] touches."""
NEAREST_EVERY = 0.02
"""Where the motors cannot make the motion, nearest possible accelerations are computed this far apart [s]."""
_LEAST_EFFORT = EffortChoice.of(None, "cone", MARGIN, REST_SPEED, holds=False)
_TOLD = 6  # stretches of time that a message names


@dataclass(frozen=True, eq=False)
class TorqueReference:
    """A motion at closely spaced times, with the motors' torques for it.

    Attributes:
        t: Times, shape (n,) [s].
        q: Configurations, shape (n, nq).
        v: Velocities, those of contacts removed, shape (n, nv).
        a: Accelerations, those of contacts removed, shape (n, nv).
        tau: Motor torques, shape (n, nu) [N, N m].
        changed: Times at which the nearest possible acceleration took the place of the motion's own, shape (m,) [s].
        moved: Largest velocity that contacts of the motion had [m/s, rad/s], removed here.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    changed: Array
    moved: float


def checked_motion(motion: SampledAccelerations) -> None:
    """Refuse what has not a robot, t, q, v and a.

    Raises:
        InputError: naming it.
    """
    if not isinstance(getattr(motion, "robot", None), CheckedModel) or not all(hasattr(motion, x) for x in "tqva"):
        raise InputError(f"motion is {motion!r:.80}; expected an rbd.Motion: rbd.Motion.read('dance.csv', robot='g1').")


def sampled(motion: SampledAccelerations, longest: float) -> tuple[Array, Array, Array, Array]:
    """(t, q, v, a) of a motion at its own times and evenly between them, `longest` apart at most [s]."""
    own = np.asarray(motion.t, float)
    if len(own) < 2:
        return own, np.array(motion.q, float), np.array(motion.v, float), np.array(motion.a, float)
    parts = np.maximum(np.ceil(np.diff(own) / longest - 1e-9), 1).astype(int)
    first = np.repeat(own[:-1], parts)
    share = np.concatenate([np.arange(n) / n for n in parts])
    t = np.append(first + share * np.repeat(np.diff(own), parts), own[-1])
    q = interpolated_q(motion.robot, own, np.asarray(motion.q), np.asarray(motion.v), t)
    v, a = np.asarray(motion.v), np.asarray(motion.a)
    return t, q, cubic(own, v, a, t), cubic_rate(own, v, a, t)


def touching_contacts(sources: Sequence[PointSource], contacts: Sequence[Constraint], state: State) -> tuple[int, ...]:
    """Which contacts touch at a state, by the gap of their nearest point; loops and other constraints always do."""
    nearest = dict.fromkeys((c.name for c in contacts), -np.inf)
    for source in sources:
        measured = source.at(state, 0.0)
        for name in dict.fromkeys(measured.structure.owners):
            own = [o == name for o in measured.structure.owners]
            nearest[name] = float(np.min(measured.gap[own]))
    return tuple(i for i, c in enumerate(contacts) if nearest[c.name] <= NEAR)


def reference_of(
    motion: SampledAccelerations,
    contacts: Sequence[Constraint],
    touching: Sequence[tuple[int, ...]],
    samples: tuple[Array, Array, Array, Array],
    torques: str,
) -> TorqueReference:
    """The torques at each sample.

    Args:
        motion: The motion.
        contacts: Contacts, loops and other constraints.
        touching: Which of them touch at each sample.
        samples: As `sampled` gives them.
        torques: "exact", "nearest", "weight" or "none".

    Raises:
        CannotMove: with "exact" and "weight", where inverse dynamics has no answer; names the times and the first cause.
    """
    robot = motion.robot
    t, q, v, a = samples
    if torques == "weight":
        v, a = np.zeros_like(v), np.zeros_like(a)
    v, a, moved = _kept(robot, t, q, v, a, contacts, touching)
    tau, refused = np.zeros((len(t), robot.nu)), dict[int, str]()
    if torques != "none":
        for chosen, run in groupby(range(len(t)), touching.__getitem__):
            at, some = np.fromiter(run, int), tuple([contacts[i] for i in chosen])
            if torques == "nearest":
                refused.update(dict.fromkeys(_nearest(robot, t, q, v, a, tau, at, some), ""))
            else:
                refused.update(_possible(robot, t, q, v, a, tau, at, some))
    if refused and torques != "nearest":
        _refuse(motion, contacts, touching, (t, q, v, a), refused)
    # Of the torques without dynamics only the torques are: the reference moves as before.
    if torques == "weight":
        v, a, moved = _kept(robot, t, q, samples[2], samples[3], contacts, touching)
    return TorqueReference(t, q, v, a, tau, t[sorted(refused)], moved)


def _kept(
    robot: CheckedModel,
    t: Array,
    q: Array,
    v: Array,
    a: Array,
    contacts: Sequence[Constraint],
    touching: Sequence[tuple[int, ...]],
) -> tuple[Array, Array, float]:
    """Velocities and accelerations with contacts at rest, nearest in the metric of inertia; and how fast contacts moved."""
    v, a, moved = v.copy(), a.copy(), 0.0
    for i, chosen in enumerate(touching):
        if not chosen:
            continue
        state, some = State(robot, q[i], v[i], t=float(t[i])), [contacts[k] for k in chosen]
        moved = max(moved, *(float(np.abs(c.rows(state).velocity).max(initial=0.0)) for c in some))
        still = project_velocity(state, some, loops=False)
        v[i], a[i] = still.v, project_acceleration(still, a[i], some, loops=False).a
    return v, a, moved


def _possible(
    robot: CheckedModel, t: Array, q: Array, v: Array, a: Array, tau: Array, at: Array, contacts: Sequence[Constraint]
) -> dict[int, str]:
    """Write the torques of some samples; {sample: reason} of those that have none."""
    if not len(at):
        return {}
    found = inverse_dynamics_many(robot, q[at], v[at], a[at], contacts, t=t[at], loops=False)
    tau[at] = found.tau
    return {int(at[i]): reason for i, reason in found.reasons.items()}


def _nearest(
    robot: CheckedModel, t: Array, q: Array, v: Array, a: Array, tau: Array, at: Array, contacts: tuple[Constraint, ...]
) -> list[int]:
    """Write torques, and accelerations, of the nearest possible motion over samples of the same contacts; those that changed.

    Between two samples `NEAREST_EVERY` apart that both have no torques of their own both are linear.
    """
    share = np.floor((t[at] - t[at[0]]) / NEAREST_EVERY + 1e-6)
    coarse = at[np.unique(np.append(np.unique(share, return_index=True)[1], len(at) - 1))]
    bad = np.isin(at, list(_possible(robot, t, q, v, a, tau, coarse, contacts)))
    before = np.searchsorted(coarse, at, side="right") - 1
    after = np.minimum(before + 1, len(coarse) - 1)
    inside = bad[coarse[before] - at[0]] & bad[coarse[after] - at[0]] & ~np.isin(at, coarse)
    bad |= np.isin(at, list(_possible(robot, t, q, v, a, tau, at[~inside & ~np.isin(at, coarse)], contacts)))
    known: list[ConicAnswer] = []
    for i in at[bad].tolist():  # each from the one before
        wanted = WantedMotion.of(State(robot, q[i], v[i], t=float(t[i])), a[i], contacts, None, _LEAST_EFFORT)
        found = wanted.nearest(MARGIN, known)
        tau[i], a[i] = found.tau, found.a
    one, other = coarse[before[inside]], coarse[after[inside]]
    s = ((t[at[inside]] - t[one]) / (t[other] - t[one]))[:, None]
    for x in (tau, a):
        x[at[inside]] = (1.0 - s) * x[one] + s * x[other]
    return np.concatenate([at[bad], at[inside]]).tolist()


def _refuse(
    motion: SampledAccelerations,
    contacts: Sequence[Constraint],
    touching: Sequence[tuple[int, ...]],
    samples: tuple[Array, Array, Array, Array],
    refused: dict[int, str],
) -> None:
    t, q, v, a = samples
    robot, first = motion.robot, min(refused)
    stretches = []
    for _, run in groupby(enumerate(sorted(refused)), lambda x: x[1] - x[0]):
        at = [i for _, i in run]
        stretches.append(f"{t[at[0]]:.3f} s" if len(at) == 1 else f"{t[at[0]]:.3f} to {t[at[-1]]:.3f} s")
    words = (
        f"no torques and contact forces give {robot.name} this motion at {joined(stretches, _TOLD)}. "
        "Use torques='nearest' for those of the nearest possible acceleration there, or a motion that "
        "rbd.check_motion finds possible."
    )
    try:
        inverse_dynamics(
            State(robot, q[first], v[first], t=float(t[first])), a[first], [contacts[k] for k in touching[first]], loops=False
        )
    except CannotMove as error:
        raise CannotMove(
            f"{words} At {t[first]:.3f} s: {error}", limits=error.limits, irreducible=error.irreducible,
            certificate=error.certificate, missing=error.missing, excess=error.excess, nearest=error.nearest,
            reason=error.reason,
        ) from None  # fmt: skip
    except RbdError as error:
        raise CannotMove(f"{words} At {t[first]:.3f} s: {error}") from None
    raise CannotMove(f"{words} At {t[first]:.3f} s: {refused[first]}")


GAINS_EVERY = 0.1
"""Gains are computed at poses of the reference this far apart [s], and are linear between them."""


class Modelled(NamedTuple):
    """A motion with the model of a controller in place of its own robot; see `SampledAccelerations`."""

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False, repr=False)
class TrackingController(Displayed):
    """Controller that follows a motion: feed-forward torques from inverse dynamics, PD on the joints, within effort limits.

    Torques at times `every` apart make the motion on the contacts that touch then; velocities and accelerations of contacts are
    removed before, by the least change in the metric of inertia. Feedback gives each small motion that the points in contact
    now allow one frequency and one damping ratio; its gains are computed at poses of the motion 0.1 s apart, when first needed.
    After the end of the motion its last pose is held, with the last torques.

    Attributes:
        motion: An `rbd.Motion`, or what has a robot, t, q, v and a.
        contacts: Contacts and loops, as given to `rbd.simulate`. Of these each touches in the motion when one of its points is
            within a millimetre. None: those of `motion.contacts`, which touch when these say; none if it has none.
        frequency: Natural frequency of every motion that the contacts allow [rad/s]; well below 1 / step.
        damping_ratio: 1 is critical.
        stiffness: In place of the frequency: of each motor, a number or shape (nu,) [N/m, N m/rad].
        damping: With stiffness: of each motor, a number or shape (nu,) [N s/m, N m s/rad].
        torques: "exact": inverse dynamics, an error where it has no answer. "nearest": there, the torques of the nearest
            possible acceleration, 20 ms apart and linear between them. "weight": those that hold each pose at rest. "none":
            feedback alone.
        every: Time between computed torques [s], which are linear between them.
        robot: The model with which it computes, of the same joints as the motion's robot; another such robot can then be
            simulated, as a heavier one. None: the motion's, and that is simulated.
        reference: The motion at the times of the torques, with the torques.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: no motion, invalid gains, an unknown word.
        CannotMove: the motors cannot make the motion on its contacts; names the times, and the cause at the first of them.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> swing = rbd.motion.minimum_jerk(arm, [np.array([0.0]), np.array([1.0])], [0.0, 0.5])
        >>> follow = rbd.control.TrackingController(swing)
        >>> moved = rbd.simulate(swing.state(0), duration=0.5, step=1e-3, controller=follow, progress=False)
        >>> print(f"{abs(moved.q[-1, 0] - 1.0):.0e}")
        1e-05
    """

    motion: SampledAccelerations
    contacts: Sequence[Constraint] | None = None
    _: KW_ONLY
    frequency: float = 10.0
    damping_ratio: float = 1.0
    stiffness: float | Array | None = None
    damping: float | Array | None = None
    torques: str = "exact"
    every: float = 5e-3
    robot: CheckedModel | None = None
    loops: bool = True
    reference: TorqueReference = field(init=False, repr=False)
    _sources: tuple[PointSource, ...] = field(init=False, repr=False)
    _offsets: Array = field(init=False, repr=False)
    _knots: Array = field(init=False, repr=False)
    _model: CheckedModel = field(init=False, repr=False)
    _known: dict[tuple[int, bytes], Gains] = field(init=False, repr=False)
    _counts: dict[str, Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        motion = self.motion
        checked_motion(motion)
        check_choice("torques", self.torques, ("exact", "nearest", "weight", "none"))
        check_oscillation("TrackingController", self.frequency, self.damping_ratio)
        check_number("every", self.every, 1e-5, 1e6, expected="a time of 1e-5 s or more")
        check_model("TrackingController", self.robot)
        if self.robot is not None:
            State(motion.robot, motion.q[0]).on(self.robot)  # which raises if its joints differ
            motion = Modelled(self.robot, motion.t, motion.q, motion.v, motion.a)
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, _per_motor(name, getattr(self, name), motion.robot.nu))
        if (self.stiffness is None) != (self.damping is None):
            raise InputError("stiffness and damping of TrackingController go together; give both, or neither.")
        lanes = getattr(self.motion, "contacts", None) if self.contacts is None else None
        given = (() if lanes is None else lanes.contacts) if self.contacts is None else self.contacts
        contacts = with_loops(motion.robot, given, self.loops)
        samples = sampled(motion, float(self.every))
        start = State(motion.robot, samples[1][0])
        rows_of(start, contacts)  # which raises if it is not a list of constraints
        sources = tuple(sources_of(contacts, start))
        if lanes is None:
            touching = [touching_contacts(sources, contacts, State(motion.robot, q)) for q in samples[1]]
        else:
            on = np.array([lanes.of_contact(c.name) for c in given]).reshape(len(given), -1).T
            frames = np.clip(np.searchsorted(lanes.t, samples[0] + 1e-9, side="right") - 1, 0, len(lanes.t) - 1)
            held = range(len(given), len(contacts))
            touching = [(*np.flatnonzero(on[i]).tolist(), *held) for i in frames]
        found = reference_of(motion, contacts, touching, samples, self.torques)
        steps = [
            pin.difference(motion.robot.model, a, b)[motion.robot.motors] for a, b in zip(found.q, found.q[1:], strict=False)
        ]
        spacing = GAINS_EVERY / max(float(np.diff(found.t).min(initial=np.inf)), 1e-6) if len(found.t) > 1 else 1.0
        knots = np.unique(np.append(np.arange(0, len(found.t), max(1, round(spacing))), len(found.t) - 1))
        self.__dict__.update(
            contacts=contacts, reference=found, _model=motion.robot, _sources=sources, _knots=knots, _known={}, _counts={},
            _offsets=np.array(steps).reshape(len(steps), motion.robot.nu),
        )  # fmt: skip
        self.reset()

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a state and a time [s], shape (nu,) [N, N m].

        Raises:
            InputError: a state of another robot.
        """
        return np.clip(self._wanted(state, t), *self._model.limits_at(state.v))

    def reset(self) -> None:
        """Counts start at zero: a motion begins."""
        self._counts.update(steps=0, clipped=np.zeros(self._model.nu, int), any=0, off=frozenset())

    def accepted(self, step: AcceptedStep) -> None:
        """Counts the motors whose torque is clipped at the beginning of a step."""
        counts = self._counts
        counts["off"] = step.inactive
        over = self._model.torque_use(self._wanted(step.state, step.t), step.state.v) > 1.0
        counts["steps"] += 1
        counts["any"] += bool(over.any())
        counts["clipped"] += over

    @property
    def steps(self) -> int:
        """How many steps of a simulation were driven since it began."""
        return int(self._counts["steps"])

    @property
    def clipped(self) -> dict[str, int]:
        """{joint: in how many of these steps its torque was clipped at its limit}, of those that were."""
        counts = self._counts["clipped"]
        return {name: int(n) for name, n in zip(self.motion.robot.actuated_names, counts, strict=True) if n}

    def _wanted(self, state: State, t: float) -> Array:
        """Torques before they are clipped."""
        robot, ref = self._model, self.reference
        if self.robot is not None:
            state = state.on(self.robot)
        elif not robot.is_like(state.robot):
            raise InputError(
                f"TrackingController was made for {robot.name}, and got a state of {state.robot.name}. To follow with another "
                "model than that of the robot that is simulated, give it: TrackingController(..., robot=...)."
            )
        motors, n = robot.motors, len(ref.t)
        i = int(np.clip(np.searchsorted(ref.t, t, side="right") - 1, 0, max(n - 2, 0)))
        back = pin.difference(robot.model, state.q, ref.q[i])[motors]
        slower = -state.v[motors]
        if n < 2 or t < ref.t[0]:
            tau = ref.tau[0]
        elif t > ref.t[-1]:
            tau, back = ref.tau[-1], back + self._offsets[-1]
        else:
            h = ref.t[i + 1] - ref.t[i]
            s = (t - ref.t[i]) / h
            begin, end, change = h * ref.v[i, motors], h * ref.v[i + 1, motors], self._offsets[i]
            back = back + s * (begin + s * ((3.0 * change - 2.0 * begin - end) + s * (begin + end - 2.0 * change)))
            slower = slower + (1.0 - s) * ref.v[i, motors] + s * ref.v[i + 1, motors]
            tau = (1.0 - s) * ref.tau[i] + s * ref.tau[i + 1]
        K, D = self._gains(state, t)
        return np.asarray(tau + (K * back + D * slower if K.ndim < 2 else K @ back + D @ slower))

    def _gains(self, state: State, t: float) -> tuple[Array, Array]:
        """Stiffness and damping for the points that touch now: matrices, or one number a motor."""
        if self.stiffness is not None and self.damping is not None:
            return np.asarray(self.stiffness), np.asarray(self.damping)
        touching = touching_points(self._sources, state, t, self._counts["off"])
        at = self.reference.t[self._knots]
        k = int(np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 1))
        before = self._gains_at(k, touching)
        if k == len(at) - 1 or t <= at[0]:
            return before.stiffness, before.damping
        after, s = self._gains_at(k + 1, touching), (t - at[k]) / (at[k + 1] - at[k])
        return (1.0 - s) * before.stiffness + s * after.stiffness, (1.0 - s) * before.damping + s * after.damping

    def _gains_at(self, knot: int, touching: Array) -> Gains:
        """The gains at a pose of the reference while some points touch; from that pose alone, so the same in every run."""
        key = (knot, touching.tobytes())
        if key not in self._known:
            pose = State(self._model, self.reference.q[self._knots[knot]])
            w, zeta = float(self.frequency), float(self.damping_ratio)
            self._known[key] = posture_gains(self._sources, pose, touching, None, w, zeta)
        return self._known[key]

    def __repr__(self) -> str:
        ref = self.reference
        return f"TrackingController({self.motion.robot.name!r}, {ref.t[0]:g} to {ref.t[-1]:g} s, torques={self.torques!r})"

    def __str__(self) -> str:
        lines = [repr(self)]
        if len(self.reference.changed):
            lines.append(
                f"  {len(self.reference.changed)} of {len(self.reference.t)} torques are of the nearest possible motion"
            )
        if self.reference.moved > 1e-6:
            lines.append(f"  contacts of the motion move at up to {self.reference.moved:.3g} m/s, and are kept at rest")
        lines.append(f"  {self.steps} steps, {self._counts['any']} with clipped torques")
        lines += [f"    {name}: {n}" for name, n in self.clipped.items()]
        return "\n".join(lines)


def _per_motor(name: str, given: float | Array | None, nu: int) -> Array | None:
    if given is None:
        return None
    values = as_array(name, given)
    if values.shape not in ((), (nu,)) or not (values >= 0.0).all() or not np.isfinite(values).all():
        raise InputError(f"{name} of TrackingController is {given!r:.80}; expected a number of 0 or more, or {nu}.")
    return np.array(np.broadcast_to(values, (nu,)))
