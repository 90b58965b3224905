"""Robots: load them by name or file, stand them up, find their soles and loops, merge two, tell what is wrong with a model."""
