"""What a constraint is: a name, and rows at a state; and what else a kind may say of itself.

`name` and `rows(state)` are all that `rbd.solve` and smooth motion need. The members below are optional; the rest of the
package asks for them through the functions of this module, which know the default where one is absent.

    points(state, t)              its points of contact, a `ContactPoints`; t: seconds since a ground that moves was given.
                                  Absent: simulation takes its rows, and their `error` for the gap
    source(start)                 the same, prepared at the start of a motion, a `Source`: for speed alone. None: there is none
    anchored(state)               the same constraint, its place put where it is: of kinds whose rows may have no `error`
    with_margin(margin)           the same, its points seen from farther away [m]: of points that come and go
    on                            what it touches, `rbd.Ground` or `rbd.Body`: a ground with a velocity carries it along
    friction, with_friction(mu)   its coefficient, None where bilateral; the same with another one
    frames                        names of the frames that it joins: one on the ground, two between bodies
    loop_dof(state, normal)  of a joint that closes a loop: how many relative velocities it leaves, of six; or, where all
                                  moves across `normal`, of three. `rbd.solve` warns of one that is open
    check(robot)                  refuses a robot that has not what it names; absent: its frames are looked up
    renamed(prefix, placement)    the same on a robot whose names begin so and whose world stands at a placement
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.ground import Ground
from rbd.problem.rows import Rows

Found = TypeVar("Found")
Kind = TypeVar("Kind")


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
        InputError: if something in the list is no constraint, or its rows have another name than it.
    """
    out = []
    for constraint in listed(constraints):
        if isinstance(constraint, type) or not callable(getattr(constraint, "rows", None)):
            raise InputError(f"{constraint!r:.80} is no constraint: it has no rows(state). Give contacts, e.g. robot.soles().")
        r = constraint.rows(state)
        if not isinstance(r, Rows):
            raise InputError(
                f"constraint {getattr(constraint, 'name', constraint)!r:.80} gave a {type(r).__name__} in place of rbd.Rows."
            )
        if r.name != getattr(constraint, "name", None):
            name = made(constraint).name
            raise InputError(f"the rows of constraint {name!r:.80} are named {r.name!r:.80}; expected its own name.")
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


def made(constraint: Any) -> Constraint:
    """What was made, if it is a constraint.

    Raises:
        InputError: it is none.
    """
    named = isinstance(getattr(constraint, "name", None), str) and callable(getattr(constraint, "rows", None))
    if isinstance(constraint, type) or not named:
        raise InputError(f"{constraint!r:.80} is no constraint: it wants a name and rows(state), as rbd.JointLock has.")
    out: Constraint = constraint
    return out


def member(constraint: object, name: str) -> Any:
    """An optional member of a constraint; None where its kind has none."""
    return getattr(constraint, name, None)


def ground_of(constraint: Constraint) -> Ground | None:
    """The ground that a constraint touches; None where it touches a body, or nothing is known."""
    on = member(constraint, "on")
    return on if isinstance(on, Ground) else None


def is_carried(constraint: Constraint) -> bool:
    """Whether it stands on a ground that moves, and so has no place to be."""
    ground = ground_of(constraint)
    return ground is not None and ground.velocity is not None


def anchored(constraint: Constraint, rows: Rows, state: State) -> Constraint:
    """A constraint whose rows give no error is put where it is at a state, unless its ground carries it along; others stay.

    Args:
        constraint: Any.
        rows: Its rows at the state.
        state: Where.
    """
    put = member(constraint, "anchored")
    if rows.error is not None or is_carried(constraint) or not callable(put):
        return constraint
    out: Constraint = put(state)
    return out


def has_friction(constraint: Constraint) -> bool:
    """Whether it has a coefficient of friction that can be another one, zero included."""
    return member(constraint, "friction") is not None and callable(member(constraint, "with_friction"))


def frames_of(constraint: Constraint) -> tuple[str, ...]:
    """The frames that it joins, one on the ground, two between bodies; none of constraints on joints and functions."""
    return tuple(member(constraint, "frames") or ())


def loop_dof(constraint: Constraint, state: State, normal: Array | None) -> int | None:
    """Relative velocities that a joint which closes a loop leaves, see above; None of what is no such joint."""
    count = member(constraint, "loop_dof")
    return count(state, normal) if callable(count) else None


def closes_loop(constraint: Constraint) -> bool:
    """Whether it is a joint that closes a loop."""
    return callable(member(constraint, "loop_dof"))


def check_on(constraint: Constraint, robot: CheckedModel) -> None:
    """Refuse a robot that has not what a constraint names.

    Raises:
        FrameNotFound: a frame that is not there, with the nearest names.
        InputError: as its kind says.
    """
    check = member(constraint, "check")
    if callable(check):
        check(robot)
    else:
        for frame in frames_of(constraint):
            robot.site(frame)


def renamed(constraint: Kind, prefix: str, placement: pin.SE3 | None) -> Kind:
    """The same constraint on a robot whose names begin with a prefix, and whose world stands at a placement (None: in W).

    Raises:
        InputError: its kind cannot, or this one cannot be moved.
    """
    rename = member(constraint, "renamed")
    if not callable(rename):
        raise InputError(f"{constraint!r:.80} is no contact; expected PointContact, SurfaceContact or LineContact.")
    made: Kind = rename(prefix, placement)
    return made
