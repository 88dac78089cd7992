"""Scores of trajectories and photos, and many runs over the sequences of a suite."""
