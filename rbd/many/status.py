"""`StateStatus`: the result at each of many states: solved, inaccurate, or the reason why there is no answer."""

from __future__ import annotations

from enum import IntEnum

from rbd.errors import CannotMove, ContactMoves, InputError, NotAtRest, RbdError, Unsupported
from rbd.problem.answer import Status


class StateStatus(IntEnum):
    """What became of one of many states; the message where it is not `SOLVED` is in `solutions.reasons`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> v = np.zeros((2, solo.nv))
        >>> v[1, 2] = -0.1  # the second falls onto its feet
        >>> solutions = rbd.solve_many(solo, solo.standing().q, v, np.zeros(solo.nu), solo.feet())
        >>> [rbd.many.StateStatus(status).words for status in solutions.status]
        ['solved', 'contact moves']
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


_OF_STATUS = {
    Status.SOLVED: StateStatus.SOLVED,
    Status.INACCURATE: StateStatus.INACCURATE,
    Status.FAILED: StateStatus.FAILED,
    Status.INFEASIBLE: StateStatus.INFEASIBLE,
}
_OF_ERROR = (
    (InputError, StateStatus.BAD_INPUT),
    ((ContactMoves, NotAtRest), StateStatus.CONTACT_MOVES),
    (Unsupported, StateStatus.UNSUPPORTED),
    (CannotMove, StateStatus.CANNOT_MOVE),
)


def status_of_answer(status: Status) -> StateStatus:
    """The status of a state whose answer has this status."""
    return _OF_STATUS[status]


def status_of_error(error: RbdError) -> StateStatus:
    """The status of a state that an error refuses."""
    kinds = [code for kind, code in _OF_ERROR if isinstance(error, kind)]
    return kinds[0] if kinds else StateStatus.FAILED
