"""The repair of a motion over its whole length: stances, paths of the feet, the centroid's program, whole-body poses."""
