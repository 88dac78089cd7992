"""Two frames to the transformation between them: claim 3, S3 to S5."""
