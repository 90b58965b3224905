"""Errors of what is given: a name, a robot file, a state, a solver, a Pinocchio."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from types import UnionType
from typing import Any

from rbd.errors.reasons import InputError, RbdError, Reason


class UnknownName(InputError):
    """A name is not in the model; the message has the nearest names.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> for look_up, name in ((solo.frame_id, "FL_FOTT"), (solo.joint_id, "FL_KNE")):
        ...     try:
        ...         look_up(name)
        ...     except rbd.errors.UnknownName as error:
        ...         print(str(error).split(",")[0])
        no frame 'FL_FOTT' in solo12; nearest: 'FL_FOOT'
        no joint 'FL_KNE' in solo12; nearest: 'FL_KFE'
    """

    reason = Reason.UNKNOWN_NAME


class UnknownRobot(UnknownName):
    """No robot or file has this name.

    Example:
        >>> rbd.load_robot("solo13")
        Traceback (most recent call last):
            ...
        rbd.errors.UnknownRobot: no robot 'solo13'; nearest: 'solo12', ...
    """

    reason = Reason.UNKNOWN_ROBOT


class FrameNotFound(UnknownName):
    """No frame of the robot has this name.

    Example:
        >>> rbd.PointContact("foot", "FL_FOTT").rows(rbd.load_robot("solo12").standing())
        Traceback (most recent call last):
            ...
        rbd.errors.FrameNotFound: no frame 'FL_FOTT' in solo12; nearest: 'FL_FOOT', ...
    """

    reason = Reason.UNKNOWN_FRAME


class JointNotFound(UnknownName):
    """No joint of the robot has this name.

    Example:
        >>> rbd.load_robot("solo12").joint_id("FL_KNE")
        Traceback (most recent call last):
            ...
        rbd.errors.JointNotFound: no joint 'FL_KNE' in solo12; nearest: 'FL_KFE', ...
    """

    reason = Reason.UNKNOWN_JOINT


class DuplicateName(InputError):
    """Two constraints share one name, so their forces could not be distinguished.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> rbd.solve(solo.standing(), np.zeros(12), [*solo.feet(), *solo.feet(friction=None)])
        Traceback (most recent call last):
            ...
        rbd.errors.DuplicateName: two constraints are named 'front_left'; give each its own name.
    """

    reason = Reason.DUPLICATE_NAME


class ModelError(RbdError):
    """A robot file is missing, broken, or not a robot.

    Example:
        >>> rbd.load_robot("my_robot.urdf")
        Traceback (most recent call last):
            ...
        rbd.errors.ModelError: no file 'my_robot.urdf', neither from ...
    """

    reason = Reason.MODEL_ERROR


class ContactMoves(RbdError):
    """A contact that can break or slip has a velocity that the law does not cover: an impact, or sliding.

    Example:
        >>> falling = rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1], [0, 0, -0.5, 0, 0, 0])
        >>> rbd.solve(falling, [], [rbd.PointContact("corner", "box", friction=0.5)])
        Traceback (most recent call last):
            ...
        rbd.errors.ContactMoves: contact 'corner' approaches at 0.5 m/s: an impact, which no acceleration answers ...
    """

    reason = Reason.CONTACT_MOVES


class BadEvent(InputError):
    """An event of a simulation is no finite number, is zero throughout, or chatters.

    Raised at the start of a motion; after it, it is the cause of a `SimulationStopped`.

    Example:
        >>> box = rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1])
        >>> rbd.simulate(box, duration=0.1, step=0.01, events=[lambda state: state.q])
        Traceback (most recent call last):
            ...
        rbd.errors.BadEvent: event 'event 1' gave an array of shape (7,) at t = 0 s; expected one number. ...
    """

    reason = Reason.BAD_EVENT


class NotAtRest(RbdError):
    """Statics was requested for a moving robot.

    Example:
        >>> rising = rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1], [0, 0, 0.5, 0, 0, 0])
        >>> rbd.hold(rising, [rbd.PointContact("corner", "box", friction=0.5)])
        Traceback (most recent call last):
            ...
        rbd.errors.NotAtRest: statics wants a robot at rest, and |v| reaches 0.5. Use State(robot, q) with v = 0.
    """

    reason = Reason.NOT_AT_REST


class Unsupported(RbdError):
    """The solver cannot take the problem; raised before it starts.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> rbd.solve(solo.standing(), np.zeros(12), solo.feet(friction=0.7), solver=rbd.KKT())
        Traceback (most recent call last):
            ...
        rbd.errors.Unsupported: KKT takes bilateral constraints, and 'front_left' has forces in a FrictionCone. ...
    """

    reason = Reason.UNSUPPORTED


class NotDifferentiable(RbdError):
    """The answer has no derivatives: on one side of it a contact sticks, on the other it slips or opens.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.5)
        >>> lift = rbd.ExternalForce("box", (0.0, 0.0, 98.1))  # as much as its weight
        >>> rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [corner], external=lift).derivatives()
        Traceback (most recent call last):
            ...
        rbd.errors.NotDifferentiable: 'corner' is at a change of contact mode: ...
    """

    reason = Reason.NOT_DIFFERENTIABLE


class NotEnclosed(RbdError):
    """No intervals around an answer were shown to contain the exact one: a row is too near a limit, or the answer is off.

    Attributes:
        constraint: Name of the constraint whose row is too near a limit; empty where none is.
        row: Number of its row or point, from 0; of the coordinate, where there is no constraint.
        value: What was found.
        needed: The value must be above this.

    Example:
        >>> box = rbd.testing.box(mass=8.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.5)
        >>> lift = rbd.ExternalForce("box", (0.0, 0.0, 78.48))  # as much as its weight
        >>> rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [corner], external=lift).enclosure()
        Traceback (most recent call last):
            ...
        rbd.errors.NotEnclosed: 'corner', point 1 of 1, sticks: its force is ...
    """

    reason = Reason.NOT_ENCLOSED

    def __init__(
        self, message: str, *, constraint: str = "", row: int = 0, value: float = math.nan, needed: float = 0.0
    ) -> None:
        super().__init__(message)
        self.constraint, self.row, self.value, self.needed = constraint, row, value, needed


class SingularInertia(RbdError):
    """The joint-space inertia matrix is not positive definite.

    Example:
        >>> rbd.GaussProblem(np.diag([1.0, 0.0]), np.ones(2), [])  # the second coordinate moves no mass
        Traceback (most recent call last):
            ...
        rbd.errors.SingularInertia: M(2 x 2) is not positive definite (leading minor 2); a joint carries no inertia, ...
    """

    reason = Reason.SINGULAR_INERTIA


class PictureError(RbdError):
    """A page or a screenshot could not be made.

    Example:
        >>> with rbd.visual.Scene(rbd.testing.box()) as scene:
        ...     scene.export("box.html")
        Traceback (most recent call last):
            ...
        rbd.errors.PictureError: the scene is empty: call scene.show(state, solution) first.
    """

    reason = Reason.PICTURE_ERROR


class WrongPinocchio(RbdError, ImportError):
    """`import pinocchio` finds a module other than pip's Pinocchio, or a library of the system is missing; with the remedy.

    Example:
        >>> rbd.installation.check(np)  # as if NumPy were what `import pinocchio` finds
        Traceback (most recent call last):
            ...
        rbd.errors.WrongPinocchio: 'import pinocchio' finds ..., which knows no robots: ... Try: unset PYTHONPATH, ...
    """

    reason = Reason.WRONG_PINOCCHIO


def listed_items(what: str, value: object, expected: str, *, alone: bool = False) -> list[Any]:
    """The items of a list, or of another object that gives some one by one.

    Args:
        what: Its name, for the message.
        value: The list.
        expected: What is expected, for the message: "a list of joints' names".
        alone: Whether a string stands for a list of itself.

    Raises:
        InputError: a string, or no list.
    """
    if alone and isinstance(value, str):
        return [value]
    try:
        return list(None if isinstance(value, str | bytes) else value)  # type: ignore[call-overload]
    except TypeError:
        raise InputError(f"{what} is {value!r:.80}; expected {expected}.") from None


def check_different(names: Sequence[str], what: str) -> None:
    """Refuse names of which two are the same.

    Args:
        names: The names.
        what: What they are of, for the message: "contacts".

    Raises:
        DuplicateName: the first that is there twice.
    """
    if len(names) != len(set(names)):
        twice = next(name for name in names if names.count(name) > 1)
        raise DuplicateName(f"two {what} are named {twice!r:.80}; give each its own name.")


def check_choice(what: str, value: object, known: Iterable[str]) -> str:
    """One of some words.

    Args:
        what: What the word is, for the message.
        value: The word.
        known: The words that it may be.

    Raises:
        InputError: it is none of them; names the nearest.
    """
    known = list(known)
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{what} is {shown(value)}; {nearest(value, known)}. Expected one of {', '.join(known)}.")
    return value


def check_known(what: str, name: object, known: Iterable[str], kind: type[InputError] = UnknownName) -> None:
    """Refuse a name that is none of some.

    Args:
        what: The beginning of the message: "no parameter".
        name: The name.
        known: The names that there are.
        kind: The error.

    Raises:
        InputError: `kind`, with the nearest names.
    """
    known = list(known)
    if not (isinstance(name, str) and name in known):
        raise kind(f"{what} {shown(name)}; {nearest(name, known)}.")


def check_kind(what: str, value: object, kind: type | UnionType, expected: str) -> None:
    """Refuse a value of another kind.

    Args:
        what: What it is, for the message.
        value: The value.
        kind: What it must be an instance of.
        expected: What was expected, in words.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what} is {shown(value)}; expected {expected}.")


def shown(value: object) -> str:
    """A value for an error message, at most 80 letters."""
    return "a number of many digits" if isinstance(value, int) and abs(value) > 2**200 else f"{value!r:.80}"


def nearest(name: object, names: Iterable[str], *, count: int = 4) -> str:
    """The names most like `name`, quoted, for the end of an error message.

    Example:
        >>> rbd.errors.nearest("left_sol", ["left_sole", "right_sole", "head"])
        "nearest: 'left_sole', 'right_sole'"
    """
    known, name = list(names), name[:100] if isinstance(name, str) else shown(name)
    if not known:
        return "there are none"
    close = difflib.get_close_matches(name, known, n=count, cutoff=0.5)
    if not close:
        lower = str(name).lower()
        close = [n for n in known if lower and lower in n.lower()][:count]
    if close:
        return "nearest: " + ", ".join(repr(n) for n in close)
    return "there are " + ", ".join(repr(n) for n in known[:8]) + (", ..." if len(known) > 8 else "")
