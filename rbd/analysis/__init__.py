"""What can be said of an answer beyond its residuals.

What is unique, which force was chosen, which rows contradict each other, how the answer changes.

Arrays only; `rbd.Solution` is the door.
"""
