"""Many states of one robot at once: answers as arrays over states, each with its residuals."""

from functools import partial as _partial

from rbd.answers.many.solving import Solutions, solve_many
from rbd.modules import submodule as _submodule
from rbd.problem.answer import StateStatus

__all__ = ["Solutions", "StateStatus", "solve_many"]


__getattr__ = _partial(_submodule, __name__)
