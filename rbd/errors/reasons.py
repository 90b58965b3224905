"""`Reason`: why there is no answer, in one enumeration: of errors, of rows of many answers, of frames of motions."""

from __future__ import annotations

from enum import StrEnum


class Reason(StrEnum):
    """Why there is no answer; its value is text, e.g. "cannot_hold: friction", and `code` a number that arrays store.

    Example:
        >>> try:
        ...     rbd.load_robot("solo13")
        ... except rbd.RbdError as error:
        ...     print(error.reason, error.reason.code)
        unknown_name 11
    """

    code: int

    def __new__(cls, value: str, code: int) -> Reason:
        """A member of this text and number."""
        out = str.__new__(cls, value)
        out._value_, out.code = value, code
        return out

    NONE = "", 0
    FAILED = "failed", 1
    INPUT = "bad_input", 10
    UNKNOWN_NAME = "unknown_name", 11
    NO_SOLUTION = "no_solution", 30
    CANNOT_HOLD = "cannot_hold", 40
    CANNOT_HOLD_FRICTION = "cannot_hold: friction", 41
    CANNOT_HOLD_MOTOR = "cannot_hold: motor", 42
    OTHER_ERROR = "other_error", 90
    NOT_RUN = "not_run", 99

    @classmethod
    def of(cls, error: BaseException) -> Reason:
        """The reason that an error has; `OTHER_ERROR` of one that is not this package's."""
        found = getattr(error, "reason", None)
        return found if isinstance(found, cls) else cls.OTHER_ERROR
