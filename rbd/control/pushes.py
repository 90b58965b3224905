"""Pushes: forces that begin and end at given times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.model.external_force import External, ExternalForce
from rbd.model.state import State

ExternalAt: TypeAlias = Callable[[State, float], External]
"""Forces of the world at a state and a time [s]."""
INSTANT = 1e-9
"""Times nearer than this [s] are the same: sums of steps are off by rounding, and a step that begins where a push ends must be
free of it."""


@dataclass(frozen=True, eq=False)
class Push:
    """A constant force from one time to another: give it to `rbd.simulate` as `external`.

    It acts at start <= t < start + duration. With both on the edges of steps its impulse is force * duration; else it is right
    to a step's worth.

    Attributes:
        frame: Frame of the robot.
        force: In world axes, shape (3,) [N].
        start: When it begins [s].
        duration: How long it lasts [s].
        moment: In world axes, beside the force's own, shape (3,) [N m].
        offset: Where it acts, from the frame's origin in the frame's axes, shape (3,) [m].

    Raises:
        InputError: vectors that are not three finite numbers, a time that is not finite, a duration that is not above zero.

    >>> push = rbd.control.Push("torso_2_link", (0.0, 20.0, 0.0), start=1.0, duration=0.1)
    """

    frame: str
    force: Sequence[float] | Array
    _: KW_ONLY
    start: float
    duration: float
    moment: Sequence[float] | Array = (0.0, 0.0, 0.0)
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)
    _force: ExternalForce = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not abs(as_float(self.start)) < 1e9:
            raise InputError(f"start of the push at {self.frame!r:.80} is {self.start!r:.80}; expected a time [s].")
        if not 0.0 < as_float(self.duration) < 1e9:
            raise InputError(f"duration of the push at {self.frame!r:.80} is {self.duration!r:.80}; expected more than 0 s.")
        given = ExternalForce(self.frame, self.force, self.moment, self.offset)
        for what in ("force", "moment", "offset"):
            object.__setattr__(self, what, getattr(given, what))
        object.__setattr__(self, "_force", given)

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return float(self.start) + float(self.duration)

    @property
    def impulse(self) -> Array:
        """Force times duration, shape (3,) [N s]."""
        return np.asarray(self.force) * float(self.duration)

    def acts(self, t: float) -> bool:
        """Whether it acts at a time [s]."""
        return float(self.start) - INSTANT <= t < self.end - INSTANT

    def __call__(self, state: State, t: float) -> tuple[ExternalForce, ...]:
        """What acts at a time [s]: the force, or nothing."""
        return (self._force,) if self.acts(t) else ()

    def __str__(self) -> str:
        x, y, z = (float(x) for x in self.force)
        return f"({x:g}, {y:g}, {z:g}) N at {self.frame} from {float(self.start):g} to {self.end:g} s"


@dataclass(frozen=True, eq=False)
class Pushes:
    """Several pushes, and loads that always act: all that act at a time add up.

    Attributes:
        pushes: `Push`es and `ExternalForce`s.

    Raises:
        InputError: something else among them.
    """

    pushes: Sequence[Push | ExternalForce]

    def __post_init__(self) -> None:
        given = self.pushes
        if isinstance(given, str | bytes) or not isinstance(given, Sequence):
            raise InputError(f"pushes is {given!r:.80}; expected a list of rbd.control.Push and rbd.ExternalForce.")
        for push in given:
            if not isinstance(push, Push | ExternalForce):
                raise InputError(f"pushes hold {push!r:.80}; expected rbd.control.Push or rbd.ExternalForce.")
        object.__setattr__(self, "pushes", tuple(given))

    def __call__(self, state: State, t: float) -> tuple[ExternalForce, ...]:
        """All forces that act at a time [s]."""
        out: list[ExternalForce] = []
        for push in self.pushes:
            out += (push,) if isinstance(push, ExternalForce) else push(state, t)
        return tuple(out)
