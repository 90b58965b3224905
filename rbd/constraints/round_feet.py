"""Round feet: the ball of a foot, whose lowest point is another in each posture, and the warning of a contact point beside it.

A contact at a point is fixed to its body. Where the body is a ball of centre c and radius r in the frame's axes, and up is the
ground's normal, the ground touches it at

    p = c - r R_WF^T up

which the leg moves as it turns: by r times the angle. `rbd.Robot.feet(at=state)` takes the point of a state.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rbd.arrays import Array
from rbd.errors import DistantContactWarning
from rbd.problem.ground import TOUCHES
from rbd.problem.rows import Rows
from rbd.records import joined

if TYPE_CHECKING:
    from rbd.model.state import State

C = TypeVar("C")


@dataclass(frozen=True, slots=True)
class Ball:
    """The ball of a round foot.

    Attributes:
        centre: In the foot's frame F, (x, y, z) [m].
        radius: [m].
    """

    centre: tuple[float, float, float]
    radius: float

    def lowest(self, R_WF: Array, up: Array) -> Array:
        """Its lowest point along `up`, a unit vector in W, in F, shape (3,) [m]."""
        return np.asarray(self.centre - self.radius * (up @ R_WF))

    def lowest_W(self, state: State, frame: str, up: Array) -> Array:
        """Its lowest point in W, shape (3,) [m]."""
        X_WF = state.frame(frame).X_WF
        return np.asarray(X_WF.act(np.array(self.centre)) - self.radius * up)


def with_ball(contact: C, ball: Ball | None) -> C:
    """The same contact at a point of a round foot."""
    out = copy.copy(contact)
    out.__dict__["ball"] = ball
    return out


def warn_of_balls(state: State, constraints: Iterable[object], *, stacklevel: int) -> tuple[str, ...]:
    """Warn of contacts more than a millimetre beside the lowest points of their balls; the names of these contacts.

    Args:
        state: The robot.
        constraints: Its constraints; those that are no contacts of round feet are left out.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    balls: list[Any] = [c for c in constraints if getattr(c, "ball", None) is not None]
    if not balls:
        return ()
    beside = {}
    for contact in balls:
        arm = contact.ball.lowest(state.frame(contact.frame).X_WF.rotation, contact.normal) - contact.placement.translation
        if (far := float(np.linalg.norm(arm))) > TOUCHES:
            beside[contact.name] = f"{contact.name!r:.80} {1e3 * far:.3g} mm"
    if beside:
        warnings.warn(
            f"round feet of {state.robot.name} touch the ground beside their contact points: {joined(list(beside.values()))}. "
            "The points are the lowest of another posture, and forces act there. Take them at this state, "
            "robot.feet(at=state); or let balls roll, rbd.RollingBall(name, frame, radius=..., friction=...).",
            DistantContactWarning,
            stacklevel=stacklevel,
        )
    return tuple(beside)


def other_rows(rows: Sequence[Rows], names: tuple[str, ...]) -> Sequence[Rows]:
    """Rows but those of some names, of which a warning was given."""
    return [r for r in rows if r.name not in names] if names else rows
