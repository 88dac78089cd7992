"""What the map predicts to be seen from a pose, and what of it the photo shows."""
