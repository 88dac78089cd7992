"""vnav: from a folder of RGB-D frames to a map, a located photo and a planned path."""

__version__ = "0.1.0"
