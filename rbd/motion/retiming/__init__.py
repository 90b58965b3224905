"""The timing of a motion along its path: the fastest, or the least slowed, that a robot can do."""
