"""Gymnasium over many worlds (extra `envs`): standing, pushes, motions to follow; importing it registers them."""

from functools import partial as _partial

from rbd.envs.environments import RandomPushes, RobotEnv, RobotVectorEnv, register as _register
from rbd.modules import submodule as _submodule

__all__ = ["RandomPushes", "RobotEnv", "RobotVectorEnv"]

_register()
__getattr__ = _partial(_submodule, __name__)
