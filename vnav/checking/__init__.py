"""Is a capture fit to be mapped."""
