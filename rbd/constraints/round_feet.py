"""Round feet: the ball of a foot, whose lowest point is another in each posture, and the warning of a contact point beside it.

A contact at a point is fixed to its body. Where the body is a ball of centre c and radius r in the frame's axes, and up is the
ground's normal, the ground touches it at

    p = c - r R_WF^T up

which the leg moves as it turns: by r times the angle. `rbd.Robot.feet(at=state)` takes the point of a state.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import DistantContactWarning
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.ground import TOUCHES
from rbd.records import joined

MOST_LOOKED_AT = 100
"""Samples of a motion at which balls are looked at."""
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


def warn_of_balls(state: State, constraints: Sequence[object], *, stacklevel: int) -> tuple[str, ...]:
    """Warn of contacts more than a millimetre beside the lowest points of their balls; the names of these contacts.

    Args:
        state: The robot.
        constraints: Its constraints; those that are no contacts of round feet are left out.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    for contact in constraints:  # a few hundred nanoseconds where there is no ball
        if getattr(contact, "ball", None) is not None:
            break
    else:
        return ()
    balls = _round(constraints)
    far = {contact.name: _beside(contact, state) for contact in balls}
    told = {name: f"{name!r:.80} {1e3 * each:.3g} mm" for name, each in far.items() if each > TOUCHES}
    if told:
        warnings.warn(
            f"round feet of {state.robot.name} touch the ground beside their contact points: {joined(list(told.values()))}. "
            "The points are the lowest of another posture, and forces act there. Take them at this state, "
            "robot.feet(at=state); or let balls roll, rbd.RollingBall(name, frame, radius=..., friction=...).",
            DistantContactWarning,
            stacklevel=stacklevel,
        )
    return tuple(told)


def warn_of_rolling(
    start: State, q: Array, forces: Mapping[str, Array], constraints: Iterable[object], *, stacklevel: int
) -> None:
    """Warn of round feet that, while they carry, turn until another point is the lowest, by more than a millimetre.

    Args:
        start: The robot before the motion, whose own feet `warn_of_balls` names.
        q: Its configurations, shape (n, nq); at most `MOST_LOOKED_AT` of them are looked at.
        forces: {contact: its force, shape (n, 3)} [N].
        constraints: Its constraints.
        stacklevel: As of `warn_of_balls`.
    """
    balls = [contact for contact in _round(constraints) if not _beside(contact, start) > TOUCHES]
    if not balls:
        return
    some = np.unique(np.linspace(0, len(q) - 1, min(len(q), MOST_LOOKED_AT)).astype(int))
    states = [State(start.robot, each) for each in q[some]]
    far = {c.name: [_beside(c, x) for x, f in zip(states, forces[c.name][some], strict=True) if f.any()] for c in balls}
    told = [f"{name!r:.80} {1e3 * max(each):.3g} mm" for name, each in far.items() if max(each, default=0.0) > TOUCHES]
    if told:
        warnings.warn(
            f"round feet of {start.robot.name} turn on the ground in this motion until their lowest points are beside the "
            f"contact points, which are fixed to the feet: {joined(told)}. Let the balls roll: rbd.RollingBall(name, frame, "
            "radius=..., friction=...), its frame at the centre.",
            DistantContactWarning,
            stacklevel=stacklevel,
        )


def balls_beside(robot: CheckedModel, constraints: Iterable[object], q: Array) -> Array:
    """At which configurations, shape (n, nq), `warn_of_balls` names a contact, shape (n,), of truth values."""
    out, feet = np.zeros(len(q), bool), [(contact, *robot.site(contact.frame)) for contact in _round(constraints)]
    if not feet:
        return out
    data = robot.model.createData()
    for i, each in enumerate(q):
        pin.forwardKinematics(robot.model, data, each)
        out[i] = any(_off(contact, data.oMi[joint].rotation @ X_JF.rotation) > TOUCHES for contact, joint, X_JF in feet)
    return out


def _round(constraints: Iterable[object]) -> list[Any]:
    """Contacts at a fixed point of a ball; what rolls has none."""
    return [c for c in constraints if getattr(c, "ball", None) is not None and hasattr(c, "placement")]


def _beside(contact: Any, state: State) -> float:
    """How far a round foot's contact point is from its lowest point [m]."""
    return _off(contact, state.frame(contact.frame).X_WF.rotation)


def _off(contact: Any, R_WF: Array) -> float:
    return float(np.linalg.norm(contact.ball.lowest(R_WF, contact.normal) - contact.placement.translation))
