"""MJCF files, read as MuJoCo reads them; what cannot be expressed is refused or reported by name."""

from rbd.model.mjcf.bodies import Shape
from rbd.model.mjcf.building import build, passive, springs
from rbd.model.mjcf.meshes import Surface, hull as convex_hull
from rbd.model.mjcf.reading import LEAVABLE, Mjcf, carry_out_includes, check_leave_out, read_mjcf
from rbd.modules import submodule as _submodule

__all__ = [
    "LEAVABLE",
    "Mjcf",
    "Shape",
    "Surface",
    "build",
    "carry_out_includes",
    "check_leave_out",
    "convex_hull",
    "passive",
    "read_mjcf",
    "springs",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
