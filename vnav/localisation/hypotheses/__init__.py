"""Poses from matches: minimal solvers, RANSAC, refinement."""
