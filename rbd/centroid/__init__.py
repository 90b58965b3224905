"""Motions of the centre of mass with contact forces in friction cones at all times: convex programs over a whole motion."""

from rbd.centroid.program import CentroidCosts, CentroidPlan, CentroidProgram

__all__ = ["CentroidCosts", "CentroidPlan", "CentroidProgram"]
