"""The least-constraint problem in arrays: cones, rows, sets of forces, residuals. Knows NumPy, and no robot or solver."""
