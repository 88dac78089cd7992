"""A colour camera from images of a board: corners, the camera that explains them, what it lacks."""
