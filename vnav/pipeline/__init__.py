"""The chains of stages: building a map, extending one, locating many photos."""
