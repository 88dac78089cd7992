"""A monocular extended Kalman filter with one-point RANSAC: [000 sections 2 and 3], [001 4]."""
