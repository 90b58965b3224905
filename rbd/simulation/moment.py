"""What a simulation knows at one time: the state, the forces, and what happened since the time before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rbd.arrays import Array
from rbd.model.state import State

OPEN, STICKS, SLIPS, HOLDS, PUSHES = "open", "sticks", "slips", "holds", "pushes"
"""Modes of a constraint: no force; at rest; sliding; held whatever it takes; a stop or a smooth contact that pushes."""


@dataclass(frozen=True, eq=False)
class Touch:
    """What one constraint does to the robot at one time.

    Attributes:
        force: Force (3,) of a point, wrench (6,) of a surface at its centre: on the robot, world axes [N, N m]. A constraint
            without a resultant (a function, a joint) gives its row forces (m,); zeros where it is not active.
        mode: "open", "sticks", "slips", "holds" or "pushes"; of several points, that of the one that slips, else of the one
            that is closed.
        points: Where it touches, in W, shape (k, 3) [m]; None of what is no contact.
        point_forces: The force at each point, on the robot, world axes, shape (k, 3) [N]; None of what is no contact.
    """

    force: Array
    mode: str
    points: Array | None = None
    point_forces: Array | None = None


@dataclass(frozen=True)
class Event:
    """A beginning or an end of contact.

    Attributes:
        t: When [s].
        name: Of the constraint.
        kind: "touches" (with an impact, or softly), "leaves", "slips" or "sticks".
        point: Which of its points, from 0.
        speed: Of a touch: how fast it approached [m/s, rad/s]; else zero.
        impulse: Of a touch: normal impulse of the impact [N s, N m s]; else zero.
    """

    t: float
    name: str
    kind: str
    point: int = 0
    speed: float = 0.0
    impulse: float = 0.0

    def __str__(self) -> str:
        impact = f" at {self.speed:.3g} m/s, impulse {self.impulse:.3g} N s" if self.speed else ""
        return f"{self.t:.6f} s: {self.name}[{self.point}] {self.kind}{impact}"


@dataclass(frozen=True, eq=False)
class Moment:
    """A simulation at one time.

    Attributes:
        t: [s].
        state: Configuration and velocity.
        a: Acceleration at t, shape (nv,): M a + h = S^T tau + tau_ext + J^T f holds with the forces of `touches`.
        tau: Motor torques at t, shape (nu,) [N, N m].
        touches: Makes {constraint: what it does} when called; dear, so only where it is recorded.
        law: How far the forces are from the law they obey, scaled.
        drift: Largest position error of the constraints that hold [m, rad].
        drift_rate: Largest velocity error of the constraints that hold [m/s, rad/s].
        penetration: How deep the deepest contact is in what it touches [m, rad]; zero or more.
        events: What happened since the moment before, in order of time.
    """

    t: float
    state: State
    a: Array
    tau: Array
    touches: Callable[[], Mapping[str, Touch]]
    law: float = 0.0
    drift: float = 0.0
    drift_rate: float = 0.0
    penetration: float = 0.0
    events: tuple[Event, ...] = ()
