"""Where a photo was taken: search, hypotheses, verification, verdict."""
