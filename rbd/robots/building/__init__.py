"""Models in memory: `rbd.RobotBuilder`, and the solids of its bodies."""
