"""Is a capture fit to be mapped; does a map agree with itself."""
