"""`StateStatus`: the result at each of many states: solved, inaccurate, or in a word why there is no answer."""

from __future__ import annotations

from enum import IntEnum

from rbd.errors import Reason
from rbd.problem.answer import Status


class StateStatus(IntEnum):
    """What became of one of many states; `solutions.reason_codes` says more where it has no answer, `solutions.reasons` all.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> v = np.zeros((2, solo.nv))
        >>> v[1, 2] = -0.1  # the second falls onto its feet
        >>> solutions = rbd.solve_many(solo, solo.standing().q, v, np.zeros(solo.nu), solo.feet())
        >>> [rbd.answers.many.StateStatus(status).words for status in solutions.status]
        ['solved', 'contact moves']
        >>> [str(rbd.errors.Reason.of_code(code)) for code in solutions.reason_codes]
        ['', 'contact_moves: impact']
    """

    SOLVED = 0
    """Every scaled residual is at most 1e-9."""
    INACCURATE = 1
    """Every scaled residual is at most 1e-7."""
    FAILED = 2
    """No answer within 1e-7 was found, though no proof that there is none."""
    INFEASIBLE = 3
    """The constraints contradict each other."""
    CONTACT_MOVES = 4
    """A contact approaches, which is an impact, or moves as the law does not cover: `ContactMoves`."""
    BAD_INPUT = 5
    """Not finite, a quaternion off the unit sphere, or refused by a constraint: `InputError`."""
    UNSUPPORTED = 6
    """The solver cannot take the problem: `Unsupported`."""
    CANNOT_MOVE = 7
    """No torques and forces within their limits move the robot so: `CannotMove`."""

    @property
    def words(self) -> str:
        """In words, e.g. "contact moves"."""
        return self.name.lower().replace("_", " ")

    @property
    def reason(self) -> Reason:
        """The reason that it stands for, without detail; `NONE` where there is an answer."""
        return _REASON[self]

    @classmethod
    def of_answer(cls, status: Status) -> StateStatus:
        """The status of a state whose answer has this status.

        Args:
            status: Of the answer.
        """
        return cls[status.name]

    @classmethod
    def of_reason(cls, reason: Reason) -> StateStatus:
        """The status of a state that has no answer for this reason; `FAILED` for what has no status of its own.

        Args:
            reason: Of the error.
        """
        return _STATUS.get(reason) or _STATUS.get(reason.kind, cls.FAILED)


_REASON: dict[StateStatus, Reason] = {
    StateStatus.SOLVED: Reason.NONE,
    StateStatus.INACCURATE: Reason.NONE,
    StateStatus.FAILED: Reason.NO_SOLUTION,
    StateStatus.INFEASIBLE: Reason.CONTRADICTION,
    StateStatus.CONTACT_MOVES: Reason.CONTACT_MOVES,
    StateStatus.BAD_INPUT: Reason.BAD_INPUT,
    StateStatus.UNSUPPORTED: Reason.UNSUPPORTED,
    StateStatus.CANNOT_MOVE: Reason.CANNOT_MOVE,
}
_STATUS: dict[Reason, StateStatus] = {
    Reason.UNKNOWN_NAME: StateStatus.BAD_INPUT,
    Reason.DUPLICATE_NAME: StateStatus.BAD_INPUT,
    Reason.NOT_AT_REST: StateStatus.CONTACT_MOVES,
    Reason.CANNOT_HOLD: StateStatus.CANNOT_MOVE,
    **{reason: status for status, reason in _REASON.items() if reason is not Reason.NONE},
}
