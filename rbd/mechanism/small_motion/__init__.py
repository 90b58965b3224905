"""Small motion about equilibria and steady motions: linear equations, eigenvalues, modes; and finding such states."""

from functools import partial as _partial

from rbd.mechanism.small_motion.finding import SteadyState, find_equilibrium, find_steady_motion
from rbd.mechanism.small_motion.linearisation import linearise
from rbd.mechanism.small_motion.linearised import Linearised
from rbd.mechanism.small_motion.modes import Mode
from rbd.modules import submodule as _submodule

__all__ = ["Linearised", "Mode", "SteadyState", "find_equilibrium", "find_steady_motion", "linearise"]


__getattr__ = _partial(_submodule, __name__)
