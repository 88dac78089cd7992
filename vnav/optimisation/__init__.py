"""Pose graph, landmarks, bundle adjustment and the world frame."""
