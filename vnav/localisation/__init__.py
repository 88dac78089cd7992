"""Where a photo was taken: active search, DLT in RANSAC, refinement, verdict."""
