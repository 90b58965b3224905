"""Figures by Matplotlib: curves, regions, planar chains."""
