"""Cameras as recorders and other tools write them: one module a format."""
