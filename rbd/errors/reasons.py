"""`Reason`: why there is no answer, in one enumeration; and `RbdError`, the root of all errors, each of which has one."""

from __future__ import annotations

import operator
import re
from enum import StrEnum
from typing import SupportsIndex

from rbd.displayed import Displayed


class Reason(StrEnum):
    """Why there is no answer: text as "cannot_hold: friction", the number `code` that arrays store, and its `meaning`.

    Every error has one, `error.reason`. A number stands for one reason for ever: none is used again.

    Attributes:
        code: Its number, 0 to 99.
        meaning: What it says, in a sentence.

    Example:
        >>> try:
        ...     rbd.load_robot("solo13")
        ... except rbd.RbdError as error:
        ...     print(error.reason, error.reason.code, error.reason.kind, error.reason.meaning, sep="; ")
        unknown_name: robot; 15; unknown_name; No robot and no file has this name.
        >>> print(rbd.errors.Reason.of_code(42))
        cannot_hold: motor
    """

    code: int
    meaning: str

    def __new__(cls, value: str, code: int = 0, meaning: str = "") -> Reason:
        """A member of this text, number and meaning."""
        out = str.__new__(cls, value)
        out._value_, out.code, out.meaning = value, code, meaning
        return out

    NONE = "", 0, "There is an answer."

    BAD_INPUT = "bad_input", 10, "An argument is wrong, or a number is not finite."
    UNKNOWN_NAME = "unknown_name", 11, "A name is not in the model."
    DUPLICATE_NAME = "duplicate_name", 12, "Two constraints, or two rows, have one name."
    MODEL_ERROR = "model_error", 13, "A robot file is missing, broken or not a robot."
    WRONG_PINOCCHIO = "wrong_pinocchio", 14, "Another package is found in place of Pinocchio."
    UNKNOWN_ROBOT = "unknown_name: robot", 15, "No robot and no file has this name."
    UNKNOWN_FRAME = "unknown_name: frame", 16, "No frame of the robot has this name."
    UNKNOWN_JOINT = "unknown_name: joint", 17, "No joint of the robot has this name."
    BAD_EVENT = "bad_input: event", 18, "An event of a simulation is no finite number, is zero throughout, or chatters."

    CONTACT_MOVES = "contact_moves", 20, "A contact has a velocity that the law does not cover."
    CONTACT_MOVES_IMPACT = "contact_moves: impact", 21, "A contact approaches its surface: an impact."
    CONTACT_MOVES_SLIDES = "contact_moves: slides", 22, "A contact slides, and the law solves contacts at rest only."
    CONTACT_MOVES_HELD = "contact_moves: held", 23, "A constraint that holds its rows at rest has a velocity."
    NOT_AT_REST = "not_at_rest", 24, "Statics of a robot, or on a ground, that moves."
    UNSUPPORTED = "unsupported", 25, "The solver cannot take this kind of problem."
    SINGULAR_INERTIA = "singular_inertia", 26, "The inertia matrix is not positive definite."
    NOT_DIFFERENTIABLE = "not_differentiable", 27, "The answer is at a change of contact mode and has no derivatives."
    NOT_ENCLOSED = "not_enclosed", 28, "No intervals that contain the exact answer were found: the answer is too near a limit."

    NO_SOLUTION = "no_solution", 30, "No answer within tolerance was found; that there is none is not proved."
    CONTRADICTION = "no_solution: contradiction", 31, "The constraints contradict each other."
    CANNOT_ASSEMBLE = "cannot_assemble", 32, "Loops do not close, or not from this start."
    CANNOT_REACH = "cannot_reach", 33, "No pose that satisfies the targets was found."
    OUT_OF_REACH = "cannot_reach: proved", 34, "No pose satisfies the targets: the links between them are too short."
    SINGULAR_POSE = "singular_pose", 35, "The known motions do not decide the others at this pose."
    NO_STEADY_STATE = "no_steady_state", 36, "No equilibrium, or no steady motion, was found from this start."
    CANNOT_PLAN = "cannot_plan", 37, "No motion over these contacts was found that is possible at every instant."

    CANNOT_HOLD = "cannot_hold", 40, "The pose cannot be held; which limit prevents it was not searched, or not found."
    CANNOT_HOLD_FRICTION = "cannot_hold: friction", 41, "More friction would hold the pose."
    CANNOT_HOLD_MOTOR = "cannot_hold: motor", 42, "A motor's torque limit prevents it; contact forces alone balance the pose."
    CANNOT_HOLD_SUPPORT = (
        "cannot_hold: support",
        43,
        "No contact forces balance the pose, whatever the friction: it tips, or a contact would have to pull.",
    )
    CANNOT_HOLD_PASSIVE = "cannot_hold: passive joint", 44, "A joint without motor would need torque."
    CANNOT_HOLD_NO_CONTACT = "cannot_hold: no contact", 45, "No contact is given, so that nothing carries the weight."
    CANNOT_HOLD_UNDECIDED = (
        "cannot_hold: undecided",
        46,
        "Neither forces nor a proof that there are none were found: the pose is within 1e-6 of a limit.",
    )
    CANNOT_HOLD_FRICTION_MARGIN = (
        "cannot_hold: friction margin",
        47,
        "Friction holds the pose, but not with the margin that was asked for.",
    )
    CANNOT_HOLD_FRICTION_AND_MOTOR = (
        "cannot_hold: friction and motor",
        48,
        "Friction prevents it; with more of it a motor's torque limit does.",
    )
    CANNOT_HOLD_REQUEST = (
        "cannot_hold: request",
        49,
        "What was asked of normal forces or centres of pressure prevents it.",
    )

    CANNOT_MOVE = "cannot_move", 50, "The motion is not possible; which limit prevents it was not searched, or not found."
    CANNOT_MOVE_FRICTION = "cannot_move: friction", 51, "Friction is among the limits that prevent the motion."
    CANNOT_MOVE_MOTOR = "cannot_move: motor", 52, "A motor's torque limit prevents it; contact forces alone balance the motion."
    CANNOT_MOVE_SUPPORT = (
        "cannot_move: support",
        53,
        "No contact forces balance the motion: the robot tips, or a contact would have to pull.",
    )
    CANNOT_MOVE_PASSIVE = "cannot_move: passive joint", 54, "A joint without motor would need torque."
    CANNOT_MOVE_NO_CONTACT = "cannot_move: no contact", 55, "No contact is given, so that nothing carries the weight."
    CANNOT_MOVE_UNDECIDED = (
        "cannot_move: undecided",
        56,
        "Neither forces nor a proof that there are none were found: the motion is within 1e-6 of a limit.",
    )
    CANNOT_MOVE_FRICTION_MARGIN = (
        "cannot_move: friction margin",
        57,
        "Friction allows the motion, but not with the margin that was asked for.",
    )
    CANNOT_MOVE_REQUEST = (
        "cannot_move: request",
        58,
        "What was asked of normal forces or centres of pressure prevents it.",
    )
    CANNOT_MOVE_CONTACT = "cannot_move: contact motion", 59, "The contacts do not allow the wanted acceleration."

    SIMULATION_STOPPED = "simulation_stopped", 60, "A simulation ended early by an error."
    STOPPED_SINKS = "simulation_stopped: sinks", 61, "The robot sinks through its floor."
    STOPPED_NO_SOLUTION = "simulation_stopped: no solution", 62, "A step has no solution, or none was found."
    STOPPED_BAD_INPUT = "simulation_stopped: bad input", 63, "A controller or a force of the user gave what cannot be taken."
    STOPPED_OTHER = "simulation_stopped: other error", 64, "A controller, force or constraint of the user raised an error."
    INTERRUPTED = "interrupted", 65, "Ctrl-C ended it."
    STOPPED_BAD_EVENT = (
        "simulation_stopped: event",
        66,
        "An event is a bad one: see bad_input: event.",
    )
    EVENT = "event", 67, "An event with `terminal` ended it."
    STOPPED_NO_EVENT = "simulation_stopped: no event", 68, "An event that is required did not happen: it is nowhere zero."

    NOT_POSSIBLE = "not_possible", 70, "A frame of a motion is not possible."
    NOT_POSSIBLE_FLOATS = "not_possible: floats", 71, "Nothing touches the floor, or it falls faster than it could."
    NOT_POSSIBLE_SINKS = "not_possible: sinks", 72, "A point is more than 10 mm below the floor."
    NOT_POSSIBLE_SLIDES = "not_possible: slides", 73, "A foot that must carry slides."
    NOT_POSSIBLE_FRICTION = "not_possible: friction", 74, "The feet would slip; more friction would do."
    NOT_POSSIBLE_TIPS = "not_possible: tips", 75, "The robot tips; larger soles would do."
    NOT_POSSIBLE_MOTOR = "not_possible: motor", 76, "A torque is beyond its limit."
    NOT_POSSIBLE_JOINT_LIMIT = "not_possible: joint limit", 77, "A joint is beyond its limit."
    NOT_POSSIBLE_SPEED_LIMIT = "not_possible: speed limit", 78, "A joint is faster than its limit."
    NOT_POSSIBLE_TORQUE_SPEED = "not_possible: torque-speed", 79, "A motor's torque is beyond what it has at this speed."
    NOT_POSSIBLE_JUMP = "not_possible: jump", 80, "The data jump from this frame to the next or from the one before."
    NOT_POSSIBLE_SELF_COLLISION = "not_possible: self-collision", 81, "Two bodies of the robot overlap."
    NOT_POSSIBLE_TILTED_SOLE = "not_possible: tilted sole", 82, "Of a sole that must carry, part is above the floor."
    NOT_POSSIBLE_HOVERING_FOOT = "not_possible: hovering foot", 83, "A foot that must carry is above the floor."
    NOT_POSSIBLE_GRASP = "not_possible: grasp", 84, "Two hands that hold one object move against each other."

    PICTURE_ERROR = "picture_error", 85, "A page or a screenshot could not be made."
    CONTRACT_BROKEN = "contract_broken", 86, "A constraint, task or solver violates its contract."
    CONSTRAINT_WRONG = "contract_broken: constraint", 87, "A constraint violates its contract."
    SOLVER_WRONG = "contract_broken: solver", 88, "A solver violates its contract."
    TASK_WRONG = "contract_broken: task", 89, "A task violates its contract."

    OTHER_ERROR = "other_error", 90, "An error that is not one of this package's; the message names it."
    STUDY_STOPPED = "study_stopped", 91, "A study ended early by an error."
    NOT_RUN = "not_run", 99, "The sample was not computed, as the study ended before."

    @property
    def kind(self) -> Reason:
        """The reason without its detail: `CANNOT_HOLD` of `CANNOT_HOLD_FRICTION`; itself where it has none."""
        return Reason(self.partition(":")[0])

    @property
    def detail(self) -> str:
        """What stands after the colon: "friction" of "cannot_hold: friction"; empty where it has none."""
        return self.partition(": ")[2]

    @classmethod
    def of(cls, error: BaseException) -> Reason:
        """The reason of an error; `OTHER_ERROR` of one that is not this package's.

        Args:
            error: Any exception.
        """
        found = getattr(error, "reason", None)
        return found if isinstance(found, cls) else cls.OTHER_ERROR

    @classmethod
    def of_code(cls, code: SupportsIndex) -> Reason:
        """The reason with this number.

        Args:
            code: As `code`, and as arrays of reasons store it.

        Raises:
            InputError: there is none.
        """
        try:
            return _OF_CODE[operator.index(code)]
        except (TypeError, KeyError):
            known = ", ".join(map(str, _OF_CODE))
            raise InputError(f"the code of a reason is {code!r:.80}; expected one of {known}.") from None

    @classmethod
    def of_cause(cls, cause: str) -> Reason:
        """The reason of a cause of `rbd.motion.CAUSES`: `NOT_POSSIBLE_TIPS` of "tips".

        Args:
            cause: One of `rbd.motion.CAUSES`.

        Raises:
            InputError: it is none of them.
        """
        try:
            return cls(f"not_possible: {cause}")
        except ValueError:
            known = ", ".join(reason.detail for reason in cls if reason.kind is cls.NOT_POSSIBLE and reason.detail)
            raise InputError(f"cause is {cause!r:.80}; expected one of {known}.") from None


_OF_CODE = {reason.code: reason for reason in Reason}


class RbdError(Displayed, Exception):
    """The root of all errors that `rbd` raises on purpose.

    Attributes:
        reason: Its `Reason`: of its class, or a more precise one, as "cannot_hold: friction".

    Example:
        >>> for name in ("solo12", "solo13"):
        ...     try:
        ...         print(rbd.load_robot(name))
        ...     except rbd.RbdError as error:
        ...         print(type(error).__name__, error)
        Robot('solo12', nq=19, nv=18, nu=12, mass=2.500 kg)
        UnknownRobot no robot 'solo13'; nearest: 'solo12', 'solo', 'solo8', 'so101'. rbd.robots.catalogue.names() has them all.
    """

    reason: Reason = Reason.OTHER_ERROR

    def __init__(self, *message: object, reason: Reason | None = None) -> None:
        super().__init__(*plain(message))
        if reason is not None:
            self.reason = reason


_SCALAR = re.compile(
    r"\bnp\.(?:(?:float|int|uint|complex|longdouble|longlong|ulonglong|clongdouble|str_|bytes_|datetime)\w*"
    r"\((b?'(?:\\.|[^'\\])*'?|b?\"(?:\\.|[^\"\\])*\"?|[\w.+-]*)\)?|(True|False)_|\w*(?=;))"
)
"""NumPy's words for one number or text, as np.float64(0.06), np.str_('knee'), np.True_, also where a message cuts them off."""


def plain(message: tuple[object, ...]) -> tuple[object, ...]:
    """A message with numbers as they are typed, in place of NumPy's words for them."""
    return tuple([_SCALAR.sub(r"\1\2", part) if isinstance(part, str) else part for part in message])


class InputError(RbdError, ValueError):
    """An argument is wrong: the message gives the value, what was expected, what to try.

    Example:
        >>> rbd.PointContact("foot", "FL_FOOT", friction=-0.5)
        Traceback (most recent call last):
            ...
        rbd.errors.InputError: friction is -0.5; expected a finite number >= 0, or None for a bilateral contact.
    """

    reason = Reason.BAD_INPUT
