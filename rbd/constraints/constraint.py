"""What a constraint is: a name, and rows at a state.

A kind may have more, which simulation and controllers use where it is there:

    anchored(state)         the same constraint, its place put where it is at a state: of contacts that know no place
    with_margin(margin)     the same, its points seen from farther away [m]: of contacts that come and go
    points(state)           a `ContactPoints`: where these touch, with labels that stay while points come and go
    velocity, acceleration  of the ground that it stands on, if that moves
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.rows import Rows

Found = TypeVar("Found")


class Constraint(Protocol):
    """Anything that gives named rows at a state; inactive ones give zero rows."""

    @property
    def name(self) -> str:
        """The role it plays, unique in a problem."""

    def rows(self, state: State) -> Rows:
        """Its rows at this state."""


def rows_of(state: State, constraints: Sequence[Constraint]) -> list[Rows]:
    """Each constraint's rows at a state, in order.

    Raises:
        InputError: if something in the list is no constraint.
    """
    out = []
    for constraint in listed(constraints):
        if isinstance(constraint, type) or not callable(getattr(constraint, "rows", None)):
            raise InputError(f"{constraint!r:.80} is no constraint: it has no rows(state). Give contacts, e.g. robot.soles().")
        r = constraint.rows(state)
        if not isinstance(r, Rows):
            raise InputError(f"constraint {constraint.name!r} gave a {type(r).__name__} in place of rbd.Rows.")
        out.append(r)
    return out


def listed(constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
    """Constraints as a tuple.

    Raises:
        InputError: if it is no list.
    """
    if isinstance(constraints, str | bytes):
        raise InputError(f"constraints are {constraints!r:.80}; expected a list, e.g. robot.soles().")
    if hasattr(constraints, "rows"):
        raise InputError("constraints is a single constraint; give a list, [constraint].")
    try:
        return tuple(constraints)
    except TypeError:
        raise InputError(f"constraints are {constraints!r:.80}; expected a list, e.g. robot.soles().") from None


class PerRobot(Generic[Found]):
    """What a constraint looks up on a robot, once a robot.

    Args:
        find: Takes the constraint and the robot.
    """

    def __init__(self, find: Callable[[Any, CheckedModel], Found]) -> None:
        self._find = find
        self._found: tuple[CheckedModel, Found] | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return PerRobot, (self._find,)  # what was found belongs to one robot, in one process

    def of(self, constraint: object, robot: CheckedModel) -> Found:
        """What was found; raises what `find` raises."""
        found = self._found
        if found is None or found[0] is not robot:
            self._found = found = robot, self._find(constraint, robot)
        return found[1]
