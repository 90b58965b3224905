"""A controller that holds a posture: PD on the joints, on top of the torques that carry the weight through what touches.

    tau = tau_0 - K (q - q*) - D v,        clipped at the effort limits

with gains of what touches now (`rbd.control.gains`): every small motion that the contacts allow is an
oscillator of the frequency and the damping ratio that are asked for. Where a robot stands on all that it was given, tau_0 is
that of `rbd.hold`, whose contact forces are within their cones. PD on the gravity torques of the posture that is wanted, and
not of the present one, is [Takegaki1981]'s; to first order in the distance both are the same here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.points import Source, Structure
from rbd.constraints.sources import sources_of
from rbd.control.gains import Gains, posture_gains
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Box, Free
from rbd.statics.equilibrium import hold

TOUCHING = 1e-5
"""A point whose gap is at most this [m] is taken for one that carries. Far above what contacts are kept to, and so small that
a foot which is stiffly held a moment too long moves by no more."""


@dataclass(frozen=True, eq=False)
class HoldPosture:
    """Torques that hold a posture: gravity compensation through the contacts, and PD on the joints, within the effort limits.

    It looks at which points touch, as a robot with switches in its soles would, and changes its gains with them: a leg in the
    air feels little inertia, and gains of a standing leg would shake it. It remembers nothing, so runs are repeatable.

    Attributes:
        state: The posture; joints are held where they are in it. Its velocity plays no part.
        contacts: What it stands on, and its loops, as given to `rbd.simulate`; nothing of an arm that is fixed.
        frequency: Natural frequency w of every motion that the contacts allow [rad/s]; well below 1 / step. The stiffer, the
            smaller the push that tips a foot.
        damping_ratio: zeta; 1 is critical.

    Raises:
        InputError: a frequency or damping ratio that is none; what is no state or no constraint.
        CannotHold: a posture that the motors cannot hold on its contacts, if all of them touch; says which limit is in the way.
        NotAtRest: the ground moves.

    >>> stand = rbd.control.HoldPosture(state, robot.feet(0.7))
    """

    state: State
    contacts: Sequence[Constraint] = ()
    _: KW_ONLY
    frequency: float = 5.0
    damping_ratio: float = 1.0
    _sources: tuple[Source, ...] = field(init=False, repr=False)
    _start: State = field(init=False, repr=False)
    _structures: tuple[Structure, ...] = field(init=False, repr=False)
    _known: dict[bytes, Gains] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.state, State):
            raise InputError(f"HoldPosture wants a State first, got {type(self.state).__name__}; e.g. robot.standing().")
        if not 0.0 < as_float(self.frequency) < 1e6:
            raise InputError(f"frequency of HoldPosture is {self.frequency!r:.80}; expected a number > 0 [rad/s].")
        if not 0.0 <= as_float(self.damping_ratio) < 1e6:
            raise InputError(f"damping_ratio of HoldPosture is {self.damping_ratio!r:.80}; expected >= 0 (1: critical).")
        still = self.state.with_velocity(self.state.robot.zero_v)
        rows_of(still, self.contacts)  # which says what is no list of constraints
        sources = tuple(sources_of(tuple(self.contacts), still))
        start = [source.at(still, 0.0) for source in sources]
        touching = _touching([m.gap for m in start])
        torque = hold(still, self.contacts).tau if touching.all() else None
        put = object.__setattr__
        put(self, "contacts", tuple(self.contacts))
        put(self, "_sources", sources)
        put(self, "_start", still)
        put(self, "_structures", tuple(m.structure for m in start))
        put(self, "_known", {})
        self._known[touching.tobytes()] = self._gains_at(still, self._structures, touching, torque)

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
        return np.clip(tau, -robot.effort_limit, robot.effort_limit)

    def gains(self, state: State, t: float = 0.0) -> Gains:
        """Torque, stiffness and damping for what touches at a state.

        Raises:
            InputError: a state of another robot.
        """
        if state.robot is not self.state.robot:
            raise InputError(f"HoldPosture was made for {self.state.robot.name}, and got a state of {state.robot.name}.")
        touching = _touching([source.gaps(state, t) for source in self._sources])
        if len(touching) != sum(len(s.owners) for s in self._structures):  # points that come and go: those that are there now
            now = [source.at(state, t) for source in self._sources]
            still = state if not state.v.any() else state.with_velocity(state.robot.zero_v)
            return self._gains_at(still, [m.structure for m in now], _touching([m.gap for m in now]))
        key = touching.tobytes()
        found = self._known.get(key)
        if found is None:  # of the posture, whatever came before: the same in every run
            found = self._known[key] = self._gains_at(self._start, self._structures, touching)
        return found

    def _gains_at(self, still: State, structures: Sequence[Structure], touching: Array, torque: Array | None = None) -> Gains:
        """The gains at a state at rest, for the points of the given structures that touch."""
        none = np.zeros(0, int)
        holding = np.concatenate([none.astype(bool), *[_holding(s) for s in structures]])
        mask = np.repeat(touching & holding, np.concatenate([none, *[s.widths for s in structures]]))

        def rows_at(state: State) -> Array:
            J = [source.at(state, 0.0).J for source in self._sources]
            return np.concatenate([np.zeros((0, state.robot.nv)), *J])[mask]

        return posture_gains(still, rows_at, torque, float(self.frequency), float(self.damping_ratio))


def _touching(gaps: Sequence[Array]) -> Array:
    """Which points are taken for ones that carry, shape (k,), of the gaps of each source."""
    return np.concatenate([np.zeros(0), *gaps]) <= TOUCHING


def _holding(structure: Structure) -> Array:
    """Which points keep a body from moving into them, shape (k,): contacts and what holds; neither stops nor friction."""
    cones = structure.cones
    if cones and cones[0].dim == 1 and not isinstance(cones[0], Free):  # stops
        return np.zeros(len(cones), bool)
    return np.array([not isinstance(cone, Box) for cone in cones], bool)
