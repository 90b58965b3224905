"""MJCF files, read as MuJoCo reads them; what cannot be expressed is refused or reported by name."""

from rbd.model.mjcf.building import build, passive
from rbd.model.mjcf.include import carry_out_includes
from rbd.model.mjcf.mesh_data import hull as convex_hull
from rbd.model.mjcf.meshes import Surface
from rbd.model.mjcf.reading import LEAVABLE, Mjcf, read_mjcf
from rbd.model.mjcf.shapes import Shape
from rbd.modules import submodule as _submodule

__all__ = [
    "LEAVABLE",
    "Mjcf",
    "Shape",
    "Surface",
    "build",
    "carry_out_includes",
    "convex_hull",
    "passive",
    "read_mjcf",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
