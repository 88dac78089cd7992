"""A path on the floor: projection to a grid, clearance, A*, smoothing."""
