"""Convex shapes: their vertices, faces and closest points."""
