"""MJCF files, read by MuJoCo; what cannot be expressed is refused or reported by name."""

from functools import partial as _partial

from rbd.model.mjcf.includes import carry_out_includes
from rbd.model.mjcf.pinocchio_model import build, pose
from rbd.model.mjcf.reading import LEAVABLE, Mjcf, check_leave_out, of_compiled, read_mjcf
from rbd.modules import submodule as _submodule

__all__ = ["LEAVABLE", "Mjcf", "build", "carry_out_includes", "check_leave_out", "of_compiled", "pose", "read_mjcf"]


__getattr__ = _partial(_submodule, __name__)
