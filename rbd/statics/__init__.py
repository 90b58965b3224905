"""Robots at rest: torques and contact forces that hold them, and the least friction that does."""
