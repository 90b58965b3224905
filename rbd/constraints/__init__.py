"""Constraints: each gives named rows with a set for its forces. They know no solver."""

from rbd.constraints.contact import PointContact, SurfaceContact

__all__ = ["PointContact", "SurfaceContact"]
