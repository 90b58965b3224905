"""External forces among the marks: the arrow of a push, and what of the external forces cannot be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.state import State
from rbd.visual.marks.arrows import force_arrow, moment_marks, tip_of
from rbd.visual.marks.mark import Label, Mark, Sizes, number, numbers
from rbd.visual.style import PUSH_COLOR


@runtime_checkable
class Push(Protocol):
    """An external force at a frame, like `rbd.ExternalForce`: only the members that a picture needs."""

    @property
    def frame(self) -> str:
        """Name of the frame that is pushed."""

    @property
    def force(self) -> Sequence[float] | Array:
        """Force in W, shape (3,) [N]."""

    @property
    def offset(self) -> Sequence[float] | Array:
        """Point of application from the frame's origin, in frame axes, shape (3,) [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class ShownPush:
    """An external force on the robot.

    Attributes:
        name: The frame that is pushed.
        point: Where it acts, in W, shape (3,) [m].
        force: In W, shape (3,) [N].
        moment: In addition to that of the force's lever arm, in W, shape (3,) [N m].
    """

    name: str
    point: Array
    force: Array
    moment: Array

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        lines = [f"|f| {number(float(np.linalg.norm(self.force)))} N", f"force on the robot {numbers(self.force)} N"]
        if self.moment.any():
            lines.append(f"moment {numbers(self.moment)} N m")
        return (*lines, f"acts at {numbers(self.point)} m")


def pushes(state: State, external: object) -> tuple[list[ShownPush], list[str]]:
    """The external forces that have a place in the picture, and what is left out of it, in words.

    Args:
        state: The robot.
        external: What `rbd.solve` takes: `ExternalForce` objects, or one, or a generalised force, or None.

    Raises:
        InputError: if `external` is none of these.
    """
    if external is None:
        return [], []
    model, given = state.robot, external
    if isinstance(given, Push):
        given = [given]
    if isinstance(given, str | bytes) or not isinstance(given, Iterable) or (isinstance(given, np.ndarray) and not given.ndim):
        raise InputError(f"external is {external!r:.80}; expected ExternalForces, or one generalised force (nv,).")
    entries = given if isinstance(given, np.ndarray) else list(given)
    if all(isinstance(push, Push) for push in entries):
        return [_shown(state, push) for push in entries], []
    try:
        generalised = np.asarray(entries, float)
    except (TypeError, ValueError, OverflowError):
        generalised = np.zeros(0)
    if generalised.shape != (model.nv,) or not np.isfinite(generalised).all():
        odd = next((push for push in entries if not isinstance(push, Push)), entries)
        raise InputError(
            f"external holds {type(odd).__name__} {odd!r:.80}; expected ExternalForces, or one generalised force "
            f"of shape ({model.nv},), finite."
        )
    if not generalised.any():
        return [], []
    most = int(np.abs(generalised).argmax())
    where = model.joints.velocities[most].name
    return [], [
        "The generalised external force is not drawn: it has no point of application. "
        f"Its largest entry is {number(float(generalised[most]))} at {where}."
    ]


def _shown(state: State, push: Any) -> ShownPush:
    point = np.array(state.frame(push.frame, push.offset).X_WF.translation)
    moment = np.asarray(getattr(push, "moment", np.zeros(3)), float)
    return ShownPush(push.frame, point, np.asarray(push.force, float), moment)


def push_marks(place: int, push: ShownPush, sizes: Sizes) -> list[Mark]:
    """The arrow of an external force from the point where it acts, and the arc of its moment."""
    label = Label(f"push on {push.name}", push.lines, tip_of(push.point, push.force, sizes))
    arrow = force_arrow(push.point, push.force, sizes)
    marks = [Mark(f"pushes/{place}", arrow, PUSH_COLOR, seen_through=True, layer="pushes", label=label)]
    arc = moment_marks(f"pushes/{place}_moment", f"push on {push.name}", push.point, push.moment, PUSH_COLOR, sizes)
    return [*marks, *arc]
