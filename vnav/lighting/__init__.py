"""Light that moves with the camera: how it falls off from the centre, found and taken off."""
