"""MJCF files, read as MuJoCo reads them; what cannot be expressed is refused or told by name."""

from rbd.mjcf.building import build, passive
from rbd.mjcf.include import carry_out_includes
from rbd.mjcf.mesh_data import hull as convex_hull
from rbd.mjcf.meshes import Surface
from rbd.mjcf.reading import LEAVABLE, Mjcf, read_mjcf
from rbd.mjcf.shapes import Shape

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
