"""Shapes of a robot's file: to draw, to collide, and to find the undersides of its feet."""

from rbd.geometry.loading import Geometry, load_geometry
from rbd.geometry.underside import Underside, flat_underside, sole_of

__all__ = ["Geometry", "Underside", "flat_underside", "load_geometry", "sole_of"]
