"""`Constraint`: a name, and rows at a state; and the optional members of a kind of constraint.

`name` and `rows(state)` are sufficient for `rbd.solve` and smooth motion. The members below are optional; other modules of the
package read them through the functions of this module, which supply the default where one is absent.

    points(state, t)              its contact points, a `ContactPoints`; t: seconds since a moving ground was given.
                                  Absent: simulation takes its rows, and their `error` for the gap
    source(start)                 the same, prepared at the start of a motion, a `Source`, only for speed. None: there is none
    anchored(state)               the same constraint anchored at the current pose, for kinds whose rows can have no `error`
    with_margin(margin)           the same with another margin [m], for kinds whose points appear and disappear
    on                            what it touches, `rbd.Ground` or `rbd.Body`; a moving ground moves the contact too
    friction, with_friction(mu)   its coefficient, None where bilateral; the same with another one
    ball                          the ball with which it touches, `rbd.constraints.round_feet.Ball`: a robot is placed by it
    frames                        names of its frames: one on the ground, two between bodies
    loop_dof(state, normal)  for a loop closure: number of free relative velocities, of six; or, if all
                                  motion is across `normal`, of three. `rbd.solve` warns if it is open
    link(state)                   ends in W of what stands between its frames, as a rod, shape (2, 3): drawn as a line; or None
    check(robot)                  refuses a robot without the names that it uses; absent: its frames are checked
    renamed(prefix, placement)    the same on a robot with prefixed names and a displaced world
    prescribes                    name of the joint whose whole motion it gives: a lock, a drive
    jump(since, t)                of a constraint that depends on time: when its position or velocity jumps, None if never
    hessian(state)                H with J_dot v = v @ H @ v, shape (m, nv, nv), for `rbd.dynamics.constraint_hessian`; absent:
                                  from its rows at each two coordinates of v
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.errors import DuplicateName, InputError
from rbd.errors.inputs import check_kind, listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.ground import Ground
from rbd.problem.rows import Rows

Found = TypeVar("Found")
Kind = TypeVar("Kind")
OPEN = 1e-3
"""A loop that is open by more than this [m, rad] at the solved state gets a warning."""


class Constraint(Protocol):
    """Protocol: a name, and rows at a state; an inactive constraint gives zero rows."""

    @property
    def name(self) -> str:
        """The role it plays, unique in a problem."""

    def rows(self, state: State) -> Rows:
        """Its rows at this state."""


def rows_of(state: State, constraints: Sequence[Constraint]) -> list[Rows]:
    """Each constraint's rows at a state, in order.

    Raises:
        InputError: if an entry is not a constraint, or its rows have a different name.
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
            raise InputError(f"the rows of constraint {name!r:.80} are named {r.name!r:.80}; expected the constraint's name.")
        out.append(r)
    return out


def listed(constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
    """Constraints as a tuple.

    Raises:
        InputError: if it is not a list.
    """
    if hasattr(constraints, "rows"):
        raise InputError("constraints is a single constraint; give a list, [constraint].")
    if type(constraints) is WithLoops:
        return constraints
    return tuple(listed_items("constraints", constraints, "a list, e.g. robot.soles()"))


class WithLoops(tuple[Constraint, ...]):
    """Constraints of which it is decided already whether a robot's own loops are among them."""


def with_loops(robot: CheckedModel, constraints: Sequence[Constraint], loops: bool = True) -> tuple[Constraint, ...]:
    """The constraints given, then those of the robot's own loops that are not among them.

    A constraint with a loop's name and frames stands in its place, e.g. with `Baumgarte`'s feedback.

    Raises:
        InputError: if it is not a list, or `loops` is no truth value.
        DuplicateName: one between other frames has a loop's name.
    """
    check_kind("loops", loops, bool, "True or False: whether the robot's own loops hold")
    given, own = listed(constraints), robot.loops()
    if any([member(constraint, "prescribes") for constraint in given]):
        _check_drives(given)
    if not own or type(constraints) is WithLoops:
        return given
    known = {getattr(constraint, "name", None): constraint for constraint in given}
    for loop in own if loops else ():
        if frames_of(known.get(loop.name, loop)) != frames_of(loop):
            raise DuplicateName(
                f"a {type(known[loop.name]).__name__} is named {loop.name!r:.80}, as a loop of {robot.name}, which holds "
                "unless loops=False. Give it another name, or loops=False."
            )
    return WithLoops((*given, *[loop for loop in own if loops and loop.name not in known]))


def _check_drives(given: Sequence[Constraint]) -> None:
    """Refuse two constraints that give the motion of one joint, if one of them drives it.

    Raises:
        InputError: with their names.
    """
    known = dict[str, Constraint]()
    for one in given:
        joint = member(one, "prescribes")
        other = known.setdefault(joint, one) if joint else one
        if other is not one and (is_timed(one) or is_timed(other)):
            raise InputError(
                f"{other.name!r:.80} and {one.name!r:.80} both prescribe the motion of joint {joint!r:.80}: a joint follows "
                "one drive, and none while it is locked. Leave one of them out."
            )


class PerRobot(Generic[Found]):
    """Cache of a value that a constraint derives from a robot, computed once a robot.

    Args:
        find: Called with the constraint and the robot.
    """

    def __init__(self, find: Callable[[Any, CheckedModel], Found]) -> None:
        self._find = find
        self._found: tuple[CheckedModel, Found] | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return PerRobot, (self._find,)  # cached values belong to one robot, in one process

    def of(self, constraint: object, robot: CheckedModel) -> Found:
        """The value; raises what `find` raises."""
        found = self._found
        if found is None or found[0] is not robot:
            self._found = found = robot, self._find(constraint, robot)
        return found[1]


def made(constraint: Any) -> Constraint:
    """The object, if it is a constraint.

    Raises:
        InputError: it is not one.
    """
    named = isinstance(getattr(constraint, "name", None), str) and callable(getattr(constraint, "rows", None))
    if isinstance(constraint, type) or not named:
        raise InputError(f"{constraint!r:.80} is no constraint: it wants a name and rows(state), as rbd.JointLock has.")
    return constraint


def member(constraint: object, name: str) -> Any:
    """An optional member of a constraint; None if its kind does not have it."""
    return getattr(constraint, name, None)


def ground_of(constraint: Constraint) -> Ground | None:
    """The ground that a constraint touches; None if it touches a body, or an unknown surface."""
    on = member(constraint, "on")
    return on if isinstance(on, Ground) else None


def is_carried(constraint: Constraint) -> bool:
    """Whether it is on moving ground, or terrain that carries, and so has no fixed position."""
    return bool(member(member(constraint, "on"), "carries"))


def is_timed(constraint: Constraint) -> bool:
    """Whether it depends on time."""
    return callable(member(constraint, "jump"))


def anchored(constraint: Constraint, rows: Rows, state: State) -> Constraint:
    """The constraint, anchored at a state if its rows give no error and its ground does not move.

    Args:
        constraint: Any constraint.
        rows: Its rows at the state.
        state: Where to anchor it.
    """
    put = member(constraint, "anchored")
    if rows.error is not None or is_carried(constraint) or not callable(put):
        return constraint
    return put(state)


def has_friction(constraint: Constraint) -> bool:
    """Whether it has a coefficient of friction, zero included, that can be replaced."""
    return member(constraint, "friction") is not None and callable(member(constraint, "with_friction"))


def frames_of(constraint: Constraint) -> tuple[str, ...]:
    """Its frames, one on the ground, two between bodies; none for constraints on joints and functions."""
    return tuple(member(constraint, "frames") or ())


def loop_dof(constraint: Constraint, state: State, normal: Array | None) -> int | None:
    """Number of relative velocities that a loop closure leaves free, see above; None for other constraints."""
    count = member(constraint, "loop_dof")
    return count(state, normal) if callable(count) else None


def closes_loop(constraint: Constraint) -> bool:
    """Whether it is a loop closure."""
    return callable(member(constraint, "loop_dof"))


def is_open(constraint: Constraint, rows: Rows) -> bool:
    """Whether it is a loop that is open by more than `OPEN` at the state of its rows."""
    return closes_loop(constraint) and rows.error is not None and max_abs(rows.error) > OPEN


def check_on(constraint: Constraint, robot: CheckedModel) -> None:
    """Refuse a robot without the names that a constraint uses.

    Raises:
        FrameNotFound: an unknown frame, with the nearest names.
        InputError: as raised by its kind.
    """
    check = member(constraint, "check")
    if callable(check):
        check(robot)
    else:
        for frame in frames_of(constraint):
            robot.site(frame)


def renamed(constraint: Kind, prefix: str, placement: pin.SE3 | None) -> Kind:
    """The same constraint on a robot with prefixed names, whose world is at a placement (None: at W).

    Raises:
        InputError: if it cannot be renamed or moved.
    """
    rename = member(constraint, "renamed")
    if not callable(rename):
        raise InputError(f"{constraint!r:.80} is no contact; expected PointContact, SurfaceContact or LineContact.")
    return rename(prefix, placement)
