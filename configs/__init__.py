"""Presets: each file holds only its differences from the defaults in vnav.config."""
