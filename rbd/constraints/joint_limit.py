"""Joint limits: rows if a joint is at a bound, and the bounds as points of a motion.

A joint's coordinate is its angle [rad] or its displacement [m]; the row force is a torque [N m] or a force [N] along that
coordinate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_float
from rbd.constraints.constraint import PerRobot
from rbd.constraints.contact_points import Group, Measured, Structure
from rbd.constraints.surface import check_number, check_state, check_words
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import UNLIMITED
from rbd.model.state import State
from rbd.problem.cones import NonNegative
from rbd.problem.rows import Rows

_SIDES = {(True, False): "lower", (False, True): "upper", (True, True): "both", (False, False): ""}


@dataclass(frozen=True, eq=False)
class JointLimit(Displayed):
    """A joint limit: at a bound it pushes the joint back, and never pulls.

    One row where the joint is at a bound or beyond it, none elsewhere (two where its range is as narrow as `margin`)::

        lower bound   y = +q'',  error = q - lower      the limit's torque on the joint is +f
        upper bound   y = -q'',  error = upper - q      the limit's torque on the joint is -f

    with f >= 0 in both: `solution.forces[name]` is its torque or force, `J^T f` the generalised force, which at an upper
    bound is negative. J_dot v is zero. The limit is rigid: a joint that moves into it needs an impact, and is refused.

    Attributes:
        name: The constraint's role, e.g. "left_knee_stop".
        joint: A joint with one degree of freedom that is not continuous.
        lower: Lower bound [rad] or [m]; by default that of the robot's file, -inf for none.
        upper: Upper bound [rad] or [m]; by default that of the robot's file, inf for none.
        margin: Distance within which the joint is at its bound [rad] or [m].

    Raises:
        InputError: bounds that are not numbers or are swapped, a negative margin.

    Example:
        >>> pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> stop = rbd.JointLimit("stop", "joint_1", lower=0.0)
        >>> solution = rbd.solve(pendulum.at([0.0]), [0.0], [stop])  # horizontal: the stop carries m g / 2
        >>> solution.a.round(3), solution.forces["stop"].round(3)
        (array([0.]), array([4.905]))
    """

    name: str
    joint: str
    lower: float | None = field(default=None, kw_only=True)
    upper: float | None = field(default=None, kw_only=True)
    margin: float = field(default=1e-6, kw_only=True)
    _stop: PerRobot[_Stop] = field(default_factory=lambda: PerRobot(_stop), init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a constraint on a joint", name=self.name, joint=self.joint)
        for side in ("lower", "upper"):
            value = getattr(self, side)
            if value is not None and math.isnan(as_float(value)):
                raise InputError(f"{side} of {self.name!r:.80} is {value!r:.80}; expected a number, or None for the file's.")
        check_number(self.name, "margin", self.margin, least=0.0)
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise InputError(f"{self.name!r:.80} has its bounds swapped: lower is {self.lower:g}, upper is {self.upper:g}.")

    def bounds(self, robot: CheckedModel) -> tuple[float, float]:
        """(lower, upper) on this robot [rad] or [m]; infinite where there is none.

        Raises:
            JointNotFound: with the nearest names.
            InputError: the joint has several degrees of freedom, is continuous, or has no bound.
        """
        if not isinstance(robot, CheckedModel):
            raise InputError(f"bounds of {self.name!r:.80} want a robot, got {type(robot).__name__}.")
        stop = self._stop.of(self, robot)
        return stop.lower, stop.upper

    def side(self, state: State) -> str:
        """The bound at which the joint is: "lower", "upper", "both", or "" for none."""
        check_state(state, self.name)
        stop = self._stop.of(self, state.robot)
        q = state.q[stop.q]
        return _SIDES[bool(q - stop.lower <= self.margin), bool(stop.upper - q <= self.margin)]

    def rows(self, state: State) -> Rows:
        """One row at a bound, else none; see the class.

        Raises:
            JointNotFound: with the nearest names.
            InputError: as `bounds`.
        """
        check_state(state, self.name)
        stop = self._stop.of(self, state.robot)
        q = float(state.q[stop.q])
        distances = q - stop.lower, stop.upper - q
        if min(distances) > self.margin:
            return stop.nothing
        signs = [s for s, distance in zip((1.0, -1.0), distances, strict=True) if distance <= self.margin]
        m, at = len(signs), stop.v
        J = np.zeros((m, state.robot.nv))
        J[:, at] = signs
        error = np.array([d for d in distances if d <= self.margin])
        return Rows(self.name, J, np.zeros(m), NonNegative(m), J[:, at] * state.v[at], error)

    def source(self, start: State) -> Stops:
        """Its bounds as points of a motion, at any distance."""
        return Stops([self], start)


@dataclass(frozen=True, eq=False)
class _Stop:
    """A limit on a robot: the joint's indices in q and v, its bounds, and its rows away from them."""

    q: int
    v: int
    lower: float
    upper: float
    nothing: Rows


def _stop(limit: JointLimit, robot: CheckedModel) -> _Stop:
    name, joint = limit.name, limit.joint
    found = robot.joints.with_one_freedom(joint, name)
    if found.is_continuous:
        raise InputError(
            f"{name!r:.80}: joint {joint!r:.80} is continuous, so it has no bound. "
            "Lock it with rbd.JointLock, or state its limits in the robot's file."
        )
    low = found.lower if limit.lower is None else float(limit.lower)
    high = found.upper if limit.upper is None else float(limit.upper)
    low, high = (-math.inf if low < -UNLIMITED else low), (math.inf if high > UNLIMITED else high)
    if low == -math.inf and high == math.inf:
        raise InputError(
            f"{name!r:.80}: joint {joint!r:.80} of {robot.name} has no bound, neither in its file nor given. "
            "Give lower= or upper=."
        )
    if low > high:
        raise InputError(f"{name!r:.80}: joint {joint!r:.80} has lower bound {low:g} above its upper one, {high:g}.")
    nothing = Rows(name, np.zeros((0, robot.nv)), np.zeros(0), NonNegative(0))
    nothing.J.flags.writeable = False
    return _Stop(found.q.start, found.v.start, low, high, nothing)


class Stops:
    """Joint limits as points of a motion: one row a bound, computed together."""

    def __init__(self, limits: Sequence[JointLimit], start: State) -> None:
        self.limits, robot = tuple(limits), start.robot
        sides = [(limit, i) for limit in limits for i in (0, 1) if math.isfinite(limit.bounds(robot)[i])]
        places = [limit._stop.of(limit, robot) for limit, _ in sides]
        k = len(sides)
        self.q, self.v = np.array([p.q for p in places], int), np.array([p.v for p in places], int)
        self.sign = np.array([-1.0 if i else 1.0 for _, i in sides])
        self.bound = np.array([p.upper if i else p.lower for p, (_, i) in zip(places, sides, strict=True)])
        self.J = np.zeros((k, robot.nv))
        self.J[np.arange(k), self.v] = self.sign
        owners, which = tuple(limit.name for limit, _ in sides), tuple(i for _, i in sides)
        self.structure = Structure(owners, which, (NonNegative(1),) * k)
        self.nothing = np.zeros(k)

    @classmethod
    def joined(cls, sources: Sequence[Stops], start: State) -> Stops:
        """Several sources as one."""
        return cls([limit for source in sources for limit in source.limits], start)

    @property
    def group(self) -> Group:
        """All joint limits are computed together."""
        return Stops.joined, ()

    def at(self, state: State, t: float) -> Measured:
        """The points, whose gaps are the distances to all bounds."""
        gap = self.gaps(state, t)
        return Measured(self.structure, self.J, self.sign * state.v[self.v], self.nothing, gap, self.nothing)

    def gaps(self, state: State, t: float) -> Array:
        """Distances to all bounds."""
        return self.sign * (state.q[self.q] - self.bound)
