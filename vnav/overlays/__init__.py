"""What moves with the camera in every image: found, and left out."""
