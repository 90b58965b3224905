"""Four-bars: their class by Grashof's condition, and the pins of one in a robot, for lengths and transmission angle.

Of four bars pinned in a loop, with s the shortest, l the longest and p, q the others, some bar can turn round relative to all
others if and only if s + l <= p + q [Grashof1883]. Which one then follows from the place of the shortest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from rbd.arrays import Array, as_finite
from rbd.constraints.constraint import Constraint, closes_loop, frames_of, loop_dof
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State, checked
from rbd.robots.linkage import lengths
from rbd.robots.standard_linkages import too_long

Pin: TypeAlias = int | tuple[str, ...]
CHANGE = 1e-9
"""Difference of s + l and p + q, over the sum of all four, up to which they are equal."""
_BY_SHORTEST = {
    "input": ("crank-rocker", "the input turns round, the output swings"),
    "coupler": ("double rocker", "input and output swing, the coupler turns round"),
    "output": ("rocker-crank", "the output turns round, the input swings"),
    "ground": ("double crank", "input and output turn round; also called drag link"),
}


@dataclass(frozen=True)
class FourBarClass(Displayed):
    """Class of a planar four-bar by its lengths, by Grashof's condition.

    With s the shortest, l the longest, p and q the other two::

        s + l < p + q     "double crank" where the ground is the shortest, "crank-rocker" where the input is, "rocker-crank"
                          where the output is, "double rocker" where the coupler is
        s + l = p + q     "change point": all bars can lie in line, and branches meet there
        s + l > p + q     "triple rocker": no bar turns round

    Attributes:
        input: Length of the bar that is driven, from the ground to the coupler [m].
        coupler: Of the coupler [m].
        output: Of the bar from the coupler to the ground [m].
        ground: Distance of the pins on the ground [m].

    Raises:
        InputError: a length that is no number above zero, lengths that do not close.

    Example:
        >>> found = rbd.mechanism.FourBarClass(40.0, 120.0, 80.0, 100.0)
        >>> found.kind, found.grashof, round(float(np.degrees(found.transmission_angle(np.radians(40.0)))), 2)
        ('crank-rocker', True, 37.03)
    """

    input: float
    coupler: float
    output: float
    ground: float

    def __post_init__(self) -> None:
        given = dict(zip(("input", "coupler", "output", "ground"), self.lengths, strict=True))
        lengths("the four-bar", **given)
        if missing := too_long(**given):
            raise InputError(missing)

    @property
    def lengths(self) -> tuple[float, float, float, float]:
        """(input, coupler, output, ground) [m]."""
        return self.input, self.coupler, self.output, self.ground

    @property
    def excess(self) -> float:
        """(s + l) - (p + q) [m]: below zero a bar can turn round."""
        return 2.0 * (min(self.lengths) + max(self.lengths)) - sum(self.lengths)

    @property
    def grashof(self) -> bool:
        """Whether s + l <= p + q: some bar can turn round relative to the others."""
        return self.excess <= CHANGE * sum(self.lengths)

    @property
    def kind(self) -> str:
        """Name of its class: crank-rocker, rocker-crank, double crank, double rocker, change point or triple rocker."""
        if abs(self.excess) <= CHANGE * sum(self.lengths):
            return "change point"
        return _BY_SHORTEST[self._shortest][0] if self.grashof else "triple rocker"

    def transmission_angle(self, angle: float | Array) -> Array:
        """Angle between coupler and output at their pin [rad], in [0, pi], by the cosine rule; NaN where it does not close.

            cos mu = (b^2 + c^2 - a^2 - d^2 + 2 a d cos angle) / (2 b c)

        The output's torque is c sin(mu) times the force along a coupler without mass: near 0 and pi little is transmitted.

        Args:
            angle: Of the input bar from the ground, from its own pin towards the other: one, or an array [rad].
        """
        a, b, c, d = self.lengths
        cos = np.cos(np.asarray(as_finite("angle", np.atleast_1d(angle), ("n",)))).reshape(np.shape(angle))
        x = (b * b + c * c - a * a - d * d + 2.0 * a * d * cos) / (2.0 * b * c)
        return np.asarray(np.arccos(np.where(np.abs(x) <= 1.0 + 1e-12, np.clip(x, -1.0, 1.0), np.nan)))

    @property
    def _shortest(self) -> str:
        return ("input", "coupler", "output", "ground")[self.lengths.index(min(self.lengths))]

    def __str__(self) -> str:
        s, p, q, l = sorted(self.lengths)  # noqa: E741  # the letters of the condition
        sign = "=" if self.kind == "change point" else "<" if self.grashof else ">"
        does = {"change point": "all bars can lie in line, where branches meet", "triple rocker": "no bar turns round"}
        means = does.get(self.kind) or _BY_SHORTEST[self._shortest][1]
        a, b, c, d = self.lengths
        return (
            f"{self.kind}: {means}\n  input {a:.6g}, coupler {b:.6g}, output {c:.6g}, ground {d:.6g} m; "
            f"Grashof: {s:.6g} + {l:.6g} {sign} {p:.6g} + {q:.6g}"
        )


class FourBarPins(NamedTuple):
    """The pins of a four-bar in a robot: ground and input, input and coupler, coupler and output, output and ground.

    Attributes:
        pins: Of each its joint's number, or the two frames that close the loop.
        normal: Of the plane, in W, shape (3,).
        turned: Whether the second of these frames belongs to the bar before the pin.
    """

    pins: tuple[Pin, ...]
    normal: Array
    turned: bool

    def bars(self, state: State) -> Array:
        """Vectors along input, coupler, output and ground, each from its pin to the next, in the plane, shape (4, 3) [m]."""
        places = [self._places(state, pin) for pin in self.pins]
        ways = np.array([after[0] - before[1] for before, after in zip(places, [*places[1:], places[0]], strict=True)])
        return np.asarray(ways - np.outer(ways @ self.normal, self.normal))

    def classified(self, state: State) -> FourBarClass | None:
        """Its class, by the lengths of its bars; None where a length is zero, or they cannot close."""
        try:
            return FourBarClass(*map(float, np.linalg.norm(self.bars(state), axis=1)))
        except InputError:
            return None

    def transmission_angle(self, state: State) -> float:
        """Angle between coupler and output at their pin [rad], in [0, pi]."""
        _, b, c, _ = self.bars(state)
        return float(np.arctan2(np.linalg.norm(np.cross(-b, c)), -b @ c))

    def middle(self, state: State) -> Array:
        """Middle of the coupler in W, shape (3,) [m]."""
        one, other = self._places(state, self.pins[1])[1], self._places(state, self.pins[2])[0]
        return np.asarray(0.5 * (one + other))

    def _places(self, state: State, pin: Pin) -> tuple[Array, Array]:
        """Where a pin is on the bar before it, and on the bar after it."""
        if isinstance(pin, int):
            place = state.joint_places([pin])[1][0]
            return place, place
        a, b = (state.frame(name).X_WF.translation for name in pin)
        return (b, a) if self.turned else (a, b)


def four_bar_pins(state: State, constraints: Sequence[Constraint], joint: str = "") -> FourBarPins | None:
    """The pins of the four-bar that a mechanism is; None if it is none, or if the joint is none of its two on the ground.

    Args:
        state: Any state of it.
        constraints: Those that hold: one closes the loop, over three hinges with parallel axes.
        joint: The driven joint; "": the first with a motor of those on the ground, else the first.
    """
    robot = checked(state).robot
    closures = [c for c in constraints if closes_loop(c)]
    if len(closures) != 1:
        return None
    frames = frames_of(closures[0])
    one, other = (list(robot.model.supports[robot.site(frame)[0]]) for frame in frames)
    common = sum(1 for a, b in zip(one, other, strict=False) if a == b)
    before, after = one[common:], other[common:]
    ids = [*before, *after]
    hinges = [robot.joints[robot.model.names[j]] for j in ids]
    if len(ids) != 3 or not all(hinge.nv == 1 and hinge.is_angle for hinge in hinges):
        return None
    axes = state.joint_motion(ids)[2][3:6, [hinge.v.start for hinge in hinges]].T
    carried = closures[0].rows(state).resultant
    if np.linalg.norm(np.cross(axes, axes[0]), axis=1).max() > 1e-9 or carried is None:
        return None
    across = carried[:3] - np.outer(axes[0], axes[0] @ carried[:3])  # of a slide in the plane the rank is one
    if loop_dof(closures[0], state, axes[0]) != 1 or np.linalg.matrix_rank(across, 1e-9) != 2:
        return None
    pins: list[Pin] = [*before, frames, *reversed(after)]
    ends = [robot.model.names[pin] if isinstance(pin, int) else "" for pin in (pins[0], pins[-1])]
    driven = joint or next((name for name in ends if name in robot.actuated_names), ends[0] or ends[1])
    if driven not in ends:
        return None
    turned = driven == ends[1]
    return FourBarPins(tuple(reversed(pins) if turned else pins), axes[0], turned)
