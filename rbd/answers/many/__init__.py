"""Many states of one robot at once: answers as arrays over states, each with its residuals."""

from rbd.answers.many.solving import Solutions, solve_many
from rbd.modules import submodule as _submodule
from rbd.problem.answer import StateStatus

__all__ = ["Solutions", "StateStatus", "solve_many"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
